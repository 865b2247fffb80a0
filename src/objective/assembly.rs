//! The sum over tets: value, gradient and Hessian of an energy with respect to the free vertices, in a fixed order.

use std::cmp::Ordering;
use std::ops::Range;

use rayon::prelude::*;

use super::element::{ElementDerivatives, centred_logs, gradient_from};
use super::gather::{Gather, edges, positions_in, put_block, split_columns};
use super::opening::{OpeningDerivatives, opening};
use super::unknowns::Tangent;
use super::{Barrier, Iterate, TetEnergy, Unknowns};
use crate::domain::Domain;
use crate::linalg::{Method, NewtonSystem, SparseError, Svd, reverse_cuthill_mckee, svd};
use crate::mesh::{Mat3, Orientation, TetId, Vec3, VertexId, orientation};

/// Tets a parallel task works on at once; fixed, so that partial sums do not depend on the number of threads.
pub(super) const CHUNK: usize = 1024;
/// Tets whose second derivatives are held at once: 820 bytes each, for all tets at once most of the memory. Few in tests, whose
/// meshes are small.
const BATCH: usize = if cfg!(test) { 100 } else { 1 << 16 };
/// How often vertices of triangles that have opened too far are taken half of their way back, before all of it.
const HALVINGS: usize = 6;
/// How near to its least opening, relatively, a triangle counts as there.
const AT_LEAST: f64 = 0.01;

/// The maps from tets to unknowns of one domain with some vertices free, and the workspace of its Newton systems.
///
/// Work is parallel over tets, then gathered per unknown in the order of the tets: the same bits for any number of
/// threads, without locks.
pub struct Assembly<'d> {
    domain: &'d Domain,
    unknowns: Unknowns,
    free: Vec<u32>,
    /// For each free vertex, its corners `4 * tet + local vertex`, tets ascending.
    corners: Gather,
    /// For each stored block of the system, its contributions `20 * tet + 2 * local pair + transposed`.
    blocks: Gather,
    system: NewtonSystem,
    /// Of a batch of tets, of all tets, and how far the contributions to each block were gone through; kept so that their memory
    /// is taken from the system once.
    elements: Vec<ElementDerivatives>,
    gradients: Vec<[Vec3; 4]>,
    cursors: Vec<usize>,
    gradient_scale: f64,
    /// Whether triangles at their least opening are held there; else that is the caller's.
    holds_openings: bool,
    /// For each vertex whether it is held since the last linearisation: at a triangle that may not open further and would.
    held: Vec<bool>,
}

impl<'d> Assembly<'d> {
    /// Prepares the sums over a domain some of whose vertices may move, their Newton systems solved by `method`.
    ///
    /// # Errors
    /// [`SparseError::TooLarge`] if the factor of the Newton system cannot be held.
    pub fn new(domain: &'d Domain, unknowns: &Unknowns, method: Method) -> Result<Self, SparseError> {
        let tets = domain.mesh().tets();
        // Contributions are packed into 32 bits.
        if tets.len() >= u32::MAX as usize / 20 {
            return Err(SparseError::TooLarge);
        }
        let mut free: Vec<u32> = unknowns.varying().collect();
        let mut unknown_of = positions_in(&free, unknowns.vertices());
        if method == Method::Iterative {
            let order = reverse_cuthill_mckee(free.len(), &edges(tets, &unknown_of));
            free = order.into_iter().map(|i| free[i as usize]).collect();
            unknown_of = positions_in(&free, unknowns.vertices());
        }
        let local = |tet: usize, v: usize| unknown_of[tets[tet][v].index()];
        let corners = Gather::new(
            free.len(),
            (0..tets.len()).flat_map(|t| (0..4).filter_map(move |v| Some((local(t, v)? as usize, (4 * t + v) as u32)))),
        );
        let edges = edges(tets, &unknown_of);
        let dimensions: Vec<usize> = free.iter().map(|&v| unknowns.dimensions(v as usize)).collect();
        let mut system = NewtonSystem::new(method, &dimensions, &edges)?;
        let points: Vec<Vec3> = free.iter().map(|&v| domain.mesh().points()[v as usize]).collect();
        system.place(&points)?;
        let slot = |row: u32, column: u32| {
            let (start, end) = (system.column_starts()[column as usize], system.column_starts()[column as usize + 1]);
            start + system.rows()[start..end].binary_search(&row).expect("every pair of a tet is in the pattern")
        };
        let blocks = Gather::new(
            system.rows().len(),
            (0..tets.len()).flat_map(|t| {
                ElementDerivatives::PAIRS.iter().enumerate().filter_map(move |(pair, &(v, w))| {
                    let (a, b) = (local(t, v)?, local(t, w)?);
                    Some((slot(a.max(b), a.min(b)), (20 * t + 2 * pair + usize::from(a < b)) as u32))
                })
            }),
        );
        Ok(Self {
            domain,
            unknowns: unknowns.clone(),
            free,
            corners,
            blocks,
            system,
            elements: Vec::new(),
            gradients: Vec::new(),
            cursors: Vec::new(),
            gradient_scale: 0.0,
            holds_openings: !unknowns.least_openings().is_empty(),
            held: vec![false; unknowns.vertices()],
        })
    }

    /// The same, which leaves it to the caller that no triangle opens beyond its least opening.
    pub fn leaving_openings(self) -> Self {
        Self { holds_openings: false, ..self }
    }

    /// How the vertices may move.
    pub fn unknowns(&self) -> &Unknowns {
        &self.unknowns
    }

    /// The vertices that may move; unknown `i` is the position of `free()[i]`.
    pub fn free(&self) -> &[u32] {
        &self.free
    }

    /// The domain.
    pub fn domain(&self) -> &'d Domain {
        self.domain
    }

    /// The map with these positions, decomposed.
    pub fn at(&self, image: Vec<Vec3>) -> Iterate {
        Iterate::new(self.domain, image)
    }

    /// The positions after a step along a direction, three entries an unknown.
    pub fn moved(&self, image: &[Vec3], direction: &[f64], step: f64) -> Vec<Vec3> {
        let mut moved = image.to_vec();
        for (d, &vertex) in direction.chunks_exact(3).zip(&self.free) {
            let position = &mut moved[vertex as usize];
            let to = *position + Vec3::new(d[0], d[1], d[2]) * step;
            *position = self.unknowns.retract(vertex as usize, position, to);
        }
        if self.holds_openings {
            self.close(image, &mut moved);
        }
        moved
    }

    /// The triangles of the boundary that are watched, each with its least opening.
    fn watched(&self) -> impl Iterator<Item = (&'d [VertexId; 3], f64)> {
        self.domain.boundary().triangles().iter().zip(self.unknowns.least_openings().iter().copied())
    }

    /// Takes vertices of triangles that have opened too far back towards where they were: half the way, half of what is left, and so on, and
    /// at last all of it. A step as a whole would be cut by one of them.
    fn close(&self, image: &[Vec3], moved: &mut [Vec3]) {
        for round in 0.. {
            let too_open = |moved: &[Vec3], &(triangle, least): &(&[VertexId; 3], f64)| {
                opening(triangle.map(|v| &moved[v.index()])).partial_cmp(&least).is_none_or(Ordering::is_lt)
            };
            let mut vertices: Vec<usize> = self
                .watched()
                .filter(|watched| too_open(moved, watched))
                .flat_map(|(triangle, _)| triangle.map(VertexId::index))
                .filter(|&v| moved[v] != image[v])
                .collect();
            if vertices.is_empty() {
                return;
            }
            vertices.sort_unstable();
            vertices.dedup();
            for v in vertices {
                let between = (image[v] + moved[v]) / 2.0;
                moved[v] = if round < HALVINGS { self.unknowns.retract(v, &image[v], between) } else { image[v] };
            }
        }
    }

    /// For each vertex whether it is of a triangle at its least opening that a step down the gradient would open further.
    fn at_least_opening(&self, image: &[Vec3], gradient: &[f64]) -> Vec<bool> {
        let mut held = vec![false; image.len()];
        let mut down = vec![Vec3::zeros(); image.len()];
        for (entries, &v) in gradient.chunks_exact(3).zip(&self.free) {
            let of_vertex = Vec3::from_column_slice(entries);
            down[v as usize] = -self.unknowns.tangent(v as usize, &image[v as usize], of_vertex);
        }
        for (triangle, least) in self.watched() {
            let corners = triangle.map(|v| &image[v.index()]);
            let change = || -> f64 {
                let gradient = OpeningDerivatives::of(corners).gradient;
                gradient.iter().zip(triangle).map(|(g, v)| g.dot(&down[v.index()])).sum()
            };
            if opening(corners) < least * (1.0 + AT_LEAST) && change() < 0.0 {
                triangle.iter().for_each(|v| held[v.index()] = true);
            }
        }
        held
    }

    /// How far the triangles that are watched have opened beyond their least openings, the farthest of them; at most 0 if none has.
    pub fn opened_too_far(&self, image: &[Vec3]) -> f64 {
        let beyond = |(triangle, least): (&[VertexId; 3], f64)| least - opening(triangle.map(|v| &image[v.index()]));
        self.watched().map(beyond).fold(f64::NEG_INFINITY, f64::max)
    }

    /// A triangle of the boundary that does not face away from the origin, by exact predicate; none is looked for where no
    /// vertex slides.
    pub fn turned_triangle(&self, image: &[Vec3]) -> Option<[VertexId; 3]> {
        let triangles = self.domain.boundary().triangles();
        let turned = |&&[a, b, c]: &&[VertexId; 3]| {
            let [a, b, c] = [a, b, c].map(|v| &image[v.index()]);
            orientation([&Vec3::zeros(), a, b, c]) != Orientation::Positive
        };
        triangles.iter().find(turned).copied().filter(|_| self.unknowns.slides())
    }

    /// The energy; `None` if a tet is flipped or the energy infinite.
    pub fn value<E: TetEnergy>(&self, energy: &E, iterate: &Iterate) -> Option<f64> {
        let chunk_sum = |(chunk, decompositions): (usize, &[Svd])| -> f64 {
            let tets = chunk * CHUNK..;
            tets.zip(decompositions).map(|(t, decomposition)| energy.value(t, decomposition.values)).sum()
        };
        let partial: Vec<f64> = iterate.decompositions().par_chunks(CHUNK).enumerate().map(chunk_sum).collect();
        let total: f64 = partial.iter().sum();
        total.is_finite().then_some(total)
    }

    /// The tets whose energy is infinite.
    pub fn infinite<E: TetEnergy>(&self, energy: &E, iterate: &Iterate) -> Vec<usize> {
        let tets = iterate.decompositions().par_iter().enumerate().with_min_len(CHUNK);
        tets.filter(|(t, tet)| !energy.value(*t, tet.values).is_finite()).map(|(t, _)| t).collect()
    }

    /// Whether the energy is finite on some tets.
    pub fn is_finite_on<E: TetEnergy>(&self, energy: &E, tets: &[usize], image: &[Vec3]) -> bool {
        let value = |t: usize| energy.value(t, svd(&self.domain.jacobian(TetId(t as u32), image)).values);
        tets.iter().all(|&t| value(t).is_finite())
    }

    /// Fills the Newton system with the Hessian, its elements' negative curvature multiplied by `negative`, and returns the gradient (three entries an
    /// unknown); `None` if a tet is flipped or the energy infinite.
    pub fn linearize<E: TetEnergy>(&mut self, energy: &E, iterate: &Iterate, negative: f64) -> Option<Vec<f64>> {
        let (domain, inverse_edges) = (self.domain, self.domain.inverse_edges());
        let tets = inverse_edges.len();
        self.gradients.resize(tets, Default::default());
        self.elements.resize(tets.min(BATCH), ElementDerivatives::default());
        self.cursors.clear();
        self.cursors.extend_from_slice(&self.blocks.starts[..self.blocks.starts.len() - 1]);
        self.system.values_mut().fill(0.0);
        let image = iterate.image();
        let corners_of = |tet: usize| domain.mesh().tets()[tet].each_ref().map(|v| &image[v.index()]);
        for first in (0..tets).step_by(BATCH) {
            let batch = first..tets.min(first + BATCH);
            let elements = &mut self.elements[..batch.len()];
            let finite = elements
                .par_iter_mut()
                .zip(&mut self.gradients[batch.clone()])
                .zip(&iterate.decompositions()[batch.clone()])
                .enumerate()
                .with_min_len(CHUNK)
                .map(|(at, ((element, gradient), decomposition))| {
                    let tet = first + at;
                    let Some(spectrum) = energy.spectrum(tet, decomposition.values, negative) else { return false };
                    let afterwards = domain.afterwards(TetId(tet as u32));
                    element.fill_before(decomposition, &spectrum, &inverse_edges[tet], afterwards);
                    for opening in energy.openings(tet) {
                        element.add_opening(opening, corners_of(tet));
                    }
                    *gradient = element.gradient;
                    true
                })
                .reduce(|| true, |a, b| a && b);
            if !finite {
                return None;
            }
            self.add_blocks(batch);
        }
        let gradients = &self.gradients;
        let whole = self.gather(|corner| gradients[corner / 4][corner % 4]);
        self.gradient_scale = self.sum_over_corners(|corner| gradients[corner / 4][corner % 4].norm());
        if self.holds_openings {
            self.held = self.at_least_opening(image, &whole);
        }
        self.project_blocks(image, &whole);
        Some(self.tangent(image, whole))
    }

    /// Adds to the system's blocks what a batch of tets contributes, in the order of the tets.
    fn add_blocks(&mut self, batch: Range<usize>) {
        let starts = self.system.column_starts().to_vec();
        let cursors = split_columns(&mut self.cursors, &starts, 1);
        let columns = split_columns(self.system.values_mut(), &starts, 9);
        let (blocks, elements) = (&self.blocks, &self.elements);
        columns.into_par_iter().zip(cursors).enumerate().with_min_len(64).for_each(|(column, (values, cursors))| {
            let height = cursors.len();
            for (k, cursor) in cursors.iter_mut().enumerate() {
                let end = blocks.starts[starts[column] + k + 1];
                let items = &blocks.items[*cursor..end];
                let count = items.iter().take_while(|&&item| item as usize / 20 < batch.end).count();
                if count == 0 {
                    continue;
                }
                *cursor += count;
                let mut sum = Mat3::from_fn(|r, c| values[c * 3 * height + 3 * k + r]);
                for &item in &items[..count] {
                    let (tet, pair, transposed) = (item as usize / 20, item as usize % 20 / 2, item % 2 == 1);
                    let block = &elements[tet - batch.start].hessian[pair];
                    sum += if transposed { block.transpose() } else { *block };
                }
                put_block(values, height, k, &sum);
            }
        });
    }

    /// Leaves of the system's blocks what acts on tangent vectors, where vertices slide; `whole` is the gradient in space.
    fn project_blocks(&mut self, image: &[Vec3], whole: &[f64]) {
        if !self.unknowns.slides() {
            return;
        }
        let tangents: Vec<Option<Tangent>> =
            self.free.iter().map(|&v| self.unknowns.tangent_space(v as usize, &image[v as usize])).collect();
        let frame = |tangent: &Option<Tangent>| tangent.as_ref().map_or_else(Mat3::identity, Tangent::frame);
        self.system.set_frames(tangents.iter().map(frame).collect());
        let starts = self.system.column_starts().to_vec();
        let rows = self.system.rows().to_vec();
        let (free, held) = (&self.free, &self.held);
        let columns = split_columns(self.system.values_mut(), &starts, 9);
        columns.into_par_iter().enumerate().with_min_len(64).for_each(|(column, values)| {
            let height = starts[column + 1] - starts[column];
            for k in 0..height {
                let mut sum = Mat3::from_fn(|r, c| values[c * 3 * height + 3 * k + r]);
                let row = rows[starts[column] + k] as usize;
                if let Some(tangent) = &tangents[row] {
                    sum = tangent.projection * sum;
                }
                if let Some(tangent) = &tangents[column] {
                    sum *= tangent.projection;
                    if row == column {
                        let stiffness = sum.norm().max(f64::MIN_POSITIVE);
                        if let Some((normal, radius)) = tangent.sphere {
                            // The sphere's curvature (Absil, Mahony and Sepulchre 2008, section 5.5).
                            let along = Vec3::from_column_slice(&whole[3 * row..3 * row + 3]).dot(&normal);
                            sum += tangent.projection * (-along / radius);
                        }
                        // It keeps the other coordinates at 0.
                        sum += tangent.complement * stiffness;
                    }
                }
                if held[free[row] as usize] || held[free[column] as usize] {
                    let stiffness = if row == column { sum.norm().max(f64::MIN_POSITIVE) } else { 0.0 };
                    sum = Mat3::identity() * stiffness;
                }
                put_block(values, height, k, &sum);
            }
        });
    }

    /// What of a vector of unknowns may vary at some positions.
    pub fn tangent(&self, image: &[Vec3], mut vector: Vec<f64>) -> Vec<f64> {
        if self.unknowns.slides() {
            for (entries, &v) in vector.chunks_exact_mut(3).zip(&self.free) {
                let whole = Vec3::from_column_slice(entries);
                let v = v as usize;
                let tangent = if self.held[v] { Vec3::zeros() } else { self.unknowns.tangent(v, &image[v], whole) };
                entries.copy_from_slice(tangent.as_slice());
            }
        }
        vector
    }

    /// The gradient of an energy; `None` if it is infinite.
    pub fn gradient<E: TetEnergy>(&self, energy: &E, iterate: &Iterate) -> Option<Vec<f64>> {
        let [gradient] = self.gradients_of(iterate, |tet, s| Some([energy.spectrum(tet, s, 1.0)?.slope]))?;
        Some(gradient)
    }

    /// The first two derivatives of a barrier's sum with respect to its bound.
    pub fn bound_derivatives(&self, barrier: &Barrier, iterate: &Iterate) -> Option<(f64, f64)> {
        let sums = self.sum_of_logs(iterate, |_, logs| {
            let [a, b, c] = logs.map(|log| barrier.bound_derivatives(log));
            [a.0 + b.0 + c.0, a.1 + b.1 + c.1]
        })?;
        Some((sums[0], sums[1]))
    }

    /// Sums of functions of a tet and its centred logs; `None` if a tet is flipped.
    pub fn sum_of_logs<const N: usize>(
        &self,
        iterate: &Iterate,
        terms: impl Fn(usize, [f64; 3]) -> [f64; N],
    ) -> Option<[f64; N]> {
        let mut sums = [0.0; N];
        for (tet, logs) in iterate.logs().enumerate() {
            for (sum, term) in sums.iter_mut().zip(terms(tet, logs?)) {
                *sum += term;
            }
        }
        Some(sums)
    }

    /// The sum of the norms of all contributions to the last linearised gradient: what its norm is small against.
    pub fn gradient_scale(&self) -> f64 {
        self.gradient_scale
    }

    /// The Newton system, filled by [`Assembly::linearize`].
    pub fn system(&mut self) -> &mut NewtonSystem {
        &mut self.system
    }

    /// The gradients of sums whose terms have the derivatives `slopes(tet, logs)` in the centred logs; `None` if a tet is
    /// flipped.
    pub fn gradients_of_logs<const N: usize>(
        &self,
        iterate: &Iterate,
        slopes: impl Fn(usize, [f64; 3]) -> [[f64; 3]; N] + Sync,
    ) -> Option<[Vec<f64>; N]> {
        self.gradients_of(iterate, |tet, s| {
            let slopes = slopes(tet, centred_logs(s)?);
            Some(slopes.map(|slope| {
                let mean = (slope[0] + slope[1] + slope[2]) / 3.0;
                [0, 1, 2].map(|i| (slope[i] - mean) / s[i])
            }))
        })
    }

    /// The gradients of sums whose terms have the derivatives `slopes(tet, s)` in the singular values.
    fn gradients_of<const N: usize>(
        &self,
        iterate: &Iterate,
        slopes: impl Fn(usize, [f64; 3]) -> Option<[[f64; 3]; N]> + Sync,
    ) -> Option<[Vec<f64>; N]> {
        let elements: Vec<[[Vec3; 4]; N]> = iterate
            .decompositions()
            .par_iter()
            .zip(self.domain.inverse_edges())
            .enumerate()
            .with_min_len(CHUNK)
            .map(|(t, (decomposition, inverse_edges))| {
                let afterwards = self.domain.afterwards(TetId(t as u32));
                // Not a number where there is no slope, found in the next line but one.
                let slopes = slopes(t, decomposition.values).unwrap_or([[f64::NAN; 3]; N]);
                slopes.map(|slope| gradient_from(decomposition, slope, inverse_edges, afterwards))
            })
            .collect();
        let exist = elements.iter().flatten().all(|gradient| !gradient[0].x.is_nan());
        let gradient = |sum: usize| self.tangent(iterate.image(), self.gather(|c| elements[c / 4][sum][c % 4]));
        exist.then(|| std::array::from_fn(gradient))
    }

    fn gather(&self, contribution: impl Fn(usize) -> Vec3 + Sync) -> Vec<f64> {
        (0..self.free.len())
            .into_par_iter()
            .with_min_len(CHUNK)
            .flat_map_iter(|unknown| {
                let sum: Vec3 = self.corners.of(unknown).iter().map(|&corner| contribution(corner as usize)).sum();
                [sum.x, sum.y, sum.z]
            })
            .collect()
    }

    fn sum_over_corners(&self, term: impl Fn(usize) -> f64 + Sync) -> f64 {
        let corners = self.corners.items.par_chunks(CHUNK);
        let partial: Vec<f64> = corners.map(|corners| corners.iter().map(|&c| term(c as usize)).sum()).collect();
        partial.iter().sum()
    }
}

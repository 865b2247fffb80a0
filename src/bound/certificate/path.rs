//! The central path of the relaxed problem of a sub-complex.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};

use super::dual::Level;
use super::relaxed::{Barrier, Block, COORDINATES, Position};
use crate::cancel::Cancel;
use crate::domain::Domain;
use crate::linalg::BlockCholesky;
use crate::mesh::{TetId, Vec3, VertexId};

/// Sufficient decrease of the Armijo rule.
const ARMIJO: f64 = 1e-4;
/// Halvings of a step before the line search gives up.
const HALVINGS: usize = 40;
/// Distance (in ln k) of the first level above the largest K of the map started from.
const FIRST_SLACK: f64 = 0.1;
/// Accuracy (in ln k) of the first stage: below it the inactive tets would inflate into the further coordinates.
const FIRST_ACCURACY: f64 = 0.2;
/// Growth of the weight from stage to stage.
const WEIGHT_RATIO: f64 = 5.0;
/// Half of the squared Newton decrement at which a stage counts as centred.
const CENTRED: f64 = 0.2;
/// Most Newton steps a stage: tets without weight may crawl for long and do not matter.
const STAGE_STEPS: usize = 60;
/// Size of the first random displacements into the further coordinates, in lengths of the shortest edge.
const FIRST_NOISE: f64 = 0.2;
/// Stiffness of the further coordinates, relative to the image's Gram matrix: as much as an inactive tet pushes outward.
const STIFFNESS: f64 = 9.0;

/// A point near the path that minimises, for a growing weight w, `w ln k` and the barriers of all tets over the free
/// positions and ln k, and how to go on.
pub(super) struct Path<'a> {
    relaxation: Relaxation<'a>,
    positions: Vec<Position>,
    state: State,
    weight: f64,
    /// 1 for the true Hessian; less, down to 0, where it is indefinite.
    negative: f64,
}

/// How a stage ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stage {
    /// Near the path.
    Centred,
    /// After the most steps a stage may take.
    Crawled,
    /// No step lowers the objective, or the time is over.
    Stuck,
}

struct Relaxation<'a> {
    domain: &'a Domain,
    tets: Vec<TetId>,
    /// Gradients of the barycentric coordinates of each tet.
    gradients: Vec<[Vec3; 4]>,
    /// The unknown of each vertex of each tet; none for vertices of the boundary.
    unknowns: Vec<[Option<u32>; 4]>,
    /// Stiffness of the coordinates beyond the third, a tet.
    stiffness: Vec<f64>,
    /// The positions started from, one a vertex of the domain.
    start: Vec<Position>,
    system: BlockCholesky,
    starts: Vec<usize>,
    rows: Vec<u32>,
}

/// The barriers at some positions and level.
struct State {
    log_level: f64,
    barriers: Vec<Barrier>,
    /// The sum of the barriers and the stiffness.
    value: f64,
}

/// A Newton step.
struct Step {
    direction: Vec<f64>,
    level_direction: f64,
    /// Derivative of the objective along the step, negative.
    slope: f64,
    /// Change of positions and ln k for a unit change of the weight along the path.
    tangent: Vec<f64>,
    level_tangent: f64,
}

impl<'a> Path<'a> {
    /// A start at the image, each free vertex displaced a little into the further coordinates at random; `None` if the image
    /// is no start (a tet without finite K) or the system cannot be held.
    pub(super) fn new(domain: &'a Domain, tets: Vec<TetId>, image: &[Vec3], largest_k: f64) -> Option<Self> {
        let (relaxation, free) = Relaxation::new(domain, tets, image)?;
        let lengths = relaxation.shortest_edges(&free);
        let mut random = ChaCha8Rng::seed_from_u64(0);
        let noise: Vec<Position> = lengths
            .iter()
            .map(|length| {
                Position::from_fn(|coordinate, _| {
                    let uniform = f64::from(random.next_u32()) / f64::from(u32::MAX) - 0.5;
                    if coordinate < 3 { 0.0 } else { length * uniform }
                })
            })
            .collect();
        let mut amplitude = FIRST_NOISE;
        let log_level = largest_k.ln() + FIRST_SLACK;
        for _ in 0..HALVINGS {
            let positions: Vec<Position> =
                free.iter().zip(&noise).map(|(v, noise)| relaxation.start[v.index()] + noise * amplitude).collect();
            if let Some(state) = relaxation.state(&positions, log_level) {
                let weight = 7.0 * relaxation.tets.len() as f64 / FIRST_ACCURACY;
                return Some(Self { relaxation, positions, state, weight, negative: 1.0 });
            }
            amplitude *= 0.5;
        }
        None
    }

    /// The tets.
    pub(super) fn tets(&self) -> &[TetId] {
        &self.relaxation.tets
    }

    /// The barriers of the tets.
    pub(super) fn barriers(&self) -> &[Barrier] {
        &self.state.barriers
    }

    /// ln k.
    pub(super) fn log_level(&self) -> f64 {
        self.state.log_level
    }

    /// How far, in ln k, a centred point may be above the least level: number of constraints / weight.
    pub(super) fn accuracy(&self) -> f64 {
        7.0 * self.relaxation.tets.len() as f64 / self.weight
    }

    /// Goes to the path at the present weight, then along its tangent to the next one.
    pub(super) fn stage(&mut self, cancel: &Cancel) -> Stage {
        for taken in 0.. {
            if cancel.is_due() {
                return Stage::Stuck;
            }
            let Some(step) = self.newton_step() else { return Stage::Stuck };
            let centred = taken > 0 && -step.slope < CENTRED;
            if centred || taken == STAGE_STEPS {
                return if centred { Stage::Centred } else { Stage::Crawled };
            }
            if !self.line_search(&step) {
                // Rounding decides: as centred as it gets.
                return if taken > 0 { Stage::Crawled } else { Stage::Stuck };
            }
            self.negative = (2.0 * self.negative).clamp(0.02, 1.0);
        }
        Stage::Stuck
    }

    /// Raises the weight and moves along the path's tangent, or as far as the barriers stay finite.
    pub(super) fn raise_weight(&mut self) {
        let next = self.weight * WEIGHT_RATIO;
        if let Some(step) = self.newton_step() {
            // The path is nearly linear in 1 / weight near its end.
            let mut length = self.weight * (1.0 - self.weight / next);
            for _ in 0..HALVINGS {
                let positions = moved(&self.positions, &step.tangent, length);
                let log_level = self.state.log_level + length * step.level_tangent;
                if let Some(state) = self.relaxation.state(&positions, log_level) {
                    (self.positions, self.state) = (positions, state);
                    break;
                }
                length *= 0.7;
            }
        }
        self.weight = next;
    }

    /// Solves the bordered Newton system; lowers `negative` until it is positive definite.
    fn newton_step(&mut self) -> Option<Step> {
        loop {
            let linear = self.relaxation.linearize(&self.state, self.negative);
            let system = &mut self.relaxation.system;
            // Rotations of the further coordinates change nothing.
            system.shift_diagonal(1e-10 * system.largest_diagonal());
            if system.factorize().is_ok() {
                let mut by_level = linear.mixed.clone();
                system.solve(&mut by_level);
                let schur = linear.by_level_twice - dot(&linear.mixed, &by_level);
                if schur > 0.0 {
                    let mut by_position = linear.gradient.clone();
                    system.solve(&mut by_position);
                    let level_gradient = self.weight + linear.by_level;
                    let level_direction = -(level_gradient - dot(&linear.mixed, &by_position)) / schur;
                    let direction: Vec<f64> =
                        by_position.iter().zip(&by_level).map(|(u, w)| -u - w * level_direction).collect();
                    let slope = dot(&linear.gradient, &direction) + level_gradient * level_direction;
                    let level_tangent = -1.0 / schur;
                    let tangent: Vec<f64> = by_level.iter().map(|w| -w * level_tangent).collect();
                    if slope < 0.0 {
                        return Some(Step { direction, level_direction, slope, tangent, level_tangent });
                    }
                }
            }
            self.negative = match self.negative {
                0.0 => return None,
                share if share > 0.02 => 0.3 * share,
                _ => 0.0,
            };
        }
    }

    fn line_search(&mut self, step: &Step) -> bool {
        let total = self.state.value + self.weight * self.state.log_level;
        let mut length = 1.0;
        for _ in 0..HALVINGS {
            let positions = moved(&self.positions, &step.direction, length);
            let log_level = self.state.log_level + length * step.level_direction;
            if let Some(state) = self.relaxation.state(&positions, log_level)
                && state.value + self.weight * log_level <= total + ARMIJO * length * step.slope
            {
                (self.positions, self.state) = (positions, state);
                return true;
            }
            length *= 0.5;
        }
        false
    }
}

/// First and second derivatives of the barriers' sum; the Hessian by positions is in the system.
struct Linear {
    gradient: Vec<f64>,
    /// Mixed derivatives by positions and ln k.
    mixed: Vec<f64>,
    by_level: f64,
    by_level_twice: f64,
}

impl<'a> Relaxation<'a> {
    /// Also the free vertices, in the order of the unknowns.
    fn new(domain: &'a Domain, tets: Vec<TetId>, image: &[Vec3]) -> Option<(Self, Vec<VertexId>)> {
        let mesh = domain.mesh();
        let gradients = tets.iter().map(|tet| {
            let inverse = &domain.inverse_edges()[tet.index()];
            let [g1, g2, g3] = [0, 1, 2].map(|row| inverse.row(row).transpose());
            [-(g1 + g2 + g3), g1, g2, g3]
        });
        let gradients = gradients.collect();
        let vertices = tets.iter().flat_map(|tet| mesh.tets()[tet.index()]);
        let mut free: Vec<VertexId> = vertices.filter(|&v| !domain.boundary().contains(v)).collect();
        free.sort_unstable();
        free.dedup();
        if free.is_empty() {
            return None;
        }
        let unknown = |v: VertexId| free.binary_search(&v).ok().map(|unknown| unknown as u32);
        let unknowns: Vec<[Option<u32>; 4]> = tets.iter().map(|tet| mesh.tets()[tet.index()].map(unknown)).collect();
        let mut edges = Vec::new();
        for tet in &unknowns {
            for row in tet.iter().flatten() {
                edges.extend(tet.iter().flatten().filter(|column| *column < row).map(|column| (*row, *column)));
            }
        }
        let system = BlockCholesky::with_block_size(COORDINATES, free.len(), &edges).ok()?;
        let (starts, rows) = (system.column_starts().to_vec(), system.rows().to_vec());
        let lifted = |p: &Vec3| Position::from_fn(|coordinate, _| if coordinate < 3 { p[coordinate] } else { 0.0 });
        let start = image.iter().map(lifted).collect();
        let stiffness = tets.iter().map(|&tet| STIFFNESS / domain.jacobian(tet, image).norm_squared()).collect();
        Some((Self { domain, tets, gradients, unknowns, stiffness, start, system, starts, rows }, free))
    }

    /// The length of the shortest image edge at each free vertex.
    fn shortest_edges(&self, free: &[VertexId]) -> Vec<f64> {
        let mut lengths = vec![f64::INFINITY; free.len()];
        for (tet, unknowns) in self.tets.iter().zip(&self.unknowns) {
            let corners = self.domain.mesh().tets()[tet.index()].map(|v| self.start[v.index()]);
            for (i, unknown) in unknowns.iter().enumerate() {
                let Some(unknown) = unknown else { continue };
                let length = &mut lengths[*unknown as usize];
                for other in (0..4).filter(|&other| other != i) {
                    *length = length.min((corners[i] - corners[other]).norm());
                }
            }
        }
        lengths
    }

    fn state(&self, positions: &[Position], log_level: f64) -> Option<State> {
        let level = Level::new(log_level);
        let mut value = 0.0;
        let mut barriers = Vec::with_capacity(self.tets.len());
        for (index, tet) in self.tets.iter().enumerate() {
            let vertices = self.domain.mesh().tets()[tet.index()];
            let corners: [&Position; 4] = std::array::from_fn(|i| match self.unknowns[index][i] {
                Some(unknown) => &positions[unknown as usize],
                None => &self.start[vertices[i].index()],
            });
            let edges = [1, 2, 3].map(|i| corners[i] - corners[0]);
            let columns = [0, 1, 2]
                .map(|column| (0..3).map(|i| edges[i] * self.gradients[index][i + 1][column]).sum::<Position>());
            let barrier = Barrier::new(columns, level)?;
            let beyond: f64 = columns.iter().map(|column| column.rows(3, COORDINATES - 3).norm_squared()).sum();
            value += barrier.value + self.stiffness[index] * beyond;
            barriers.push(barrier);
        }
        Some(State { log_level, barriers, value })
    }

    fn linearize(&mut self, state: &State, negative: f64) -> Linear {
        const SIZE: usize = COORDINATES;
        let count = SIZE * (self.starts.len() - 1);
        let mut linear =
            Linear { gradient: vec![0.0; count], mixed: vec![0.0; count], by_level: 0.0, by_level_twice: 0.0 };
        let values = self.system.values_mut();
        values.fill(0.0);
        for (index, barrier) in state.barriers.iter().enumerate() {
            let derivatives = barrier.derivatives();
            linear.by_level += derivatives.by_level;
            linear.by_level_twice += derivatives.by_level_twice;
            let unknowns = &self.unknowns[index];
            if unknowns.iter().all(Option::is_none) {
                continue;
            }
            let slopes = barrier.gradient(&derivatives, self.stiffness[index]);
            let mixed_slopes = barrier.mixed_gradient(&derivatives);
            let hessian = barrier.hessian(&derivatives, self.stiffness[index], negative);
            let on_axes = self.gradients[index].map(|gradient| barrier.axes.tr_mul(&gradient));
            for (row, by_row) in unknowns.iter().zip(&on_axes) {
                let Some(row) = *row else { continue };
                for coordinate in 0..SIZE {
                    let slot = SIZE * row as usize + coordinate;
                    for axis in 0..3 {
                        linear.gradient[slot] += by_row[axis] * slopes[axis][coordinate];
                        linear.mixed[slot] += by_row[axis] * mixed_slopes[axis][coordinate];
                    }
                }
                let half: [Block; 3] = [0, 1, 2].map(|b| {
                    let block = |a: usize| if a >= b { hessian[a][b] } else { hessian[b][a].transpose() };
                    (0..3).map(|a| block(a) * by_row[a]).sum::<Block>()
                });
                for (column, by_column) in unknowns.iter().zip(&on_axes) {
                    let Some(column) = column.filter(|&column| column <= row) else { continue };
                    let block = half[0] * by_column[0] + half[1] * by_column[1] + half[2] * by_column[2];
                    let (start, end) = (self.starts[column as usize], self.starts[column as usize + 1]);
                    let k = self.rows[start..end].binary_search(&row).expect("the pattern holds every pair of a tet");
                    for c in 0..SIZE {
                        let offset = SIZE * SIZE * start + c * SIZE * (end - start) + SIZE * k;
                        for r in 0..SIZE {
                            values[offset + r] += block[(r, c)];
                        }
                    }
                }
            }
        }
        linear
    }
}

fn moved(positions: &[Position], direction: &[f64], length: f64) -> Vec<Position> {
    let steps = direction.chunks_exact(COORDINATES);
    positions.iter().zip(steps).map(|(x, step)| x + Position::from_column_slice(step) * length).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

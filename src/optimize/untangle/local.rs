//! Untangling vertex by vertex, each tet's determinant measured against a size of its own.

use std::time::Instant;

use super::{Untangled, flipped_tets, most_steps};
use crate::domain::Domain;
use crate::linalg::{Svd, svd};
use crate::mesh::{Mat3, TetId, Vec3, edge_matrix};
use crate::optimize::{OptimizeSettings, TraceRow};

/// Sweeps over all vertices between two counts of flipped tets, and between two measures of sizes.
const COUNTED: usize = 5;
const SCALED: usize = 10;
/// Sweeps over all vertices at the start; then every fifth is, and the others are over those about flipped tets.
const WHOLE: usize = 20;
/// Rings of tets about the flipped ones whose vertices those others move.
const RINGS: usize = 4;
/// Sweeps without a flipped tet less after which the regularisation falls, by this factor.
const STALLED: usize = 40;
const FALL: f64 = 0.3;
/// Sweeps without a flipped tet less that end the attempt.
const PATIENCE: usize = 200;
/// The least regularisation at first, relative to a tet's size: where no tet about a vertex is flipped.
const FIRST_FLOOR: f64 = 1e-3;
/// The regularisation is so much of the determinant of the worst flip about a vertex.
const SHARE: f64 = 0.2;
/// The least width of a thick tet, as a part of its largest.
const LEAST_WIDTH: f64 = 0.2;
/// Sufficient decrease of the Armijo rule, and halvings of a step before a vertex is left where it is.
const ARMIJO: f64 = 1e-4;
const HALVINGS: usize = 20;

/// The shapes that the images of tets are compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shapes {
    /// Those of the domain.
    Own,
    /// The same, no thinner than a fifth of their size: where slivers of the domain are many, their images would have to be flat
    /// as well, and leave others no room. Whether an image is positive does not depend on the shape it is compared with.
    Thick,
}

/// Moves the vertices with `fixed[vertex] == false` one after the other, sweep by sweep, until every tet is positively oriented
/// by exact predicate; for starts whose tets differ in size by many orders, where one epsilon for all cannot suit.
///
/// The energy is that of [`crate::objective::Untangling`] (Garanzha et al. 2021, eq. 2-4) with the determinant in units of the
/// tet's own scale, (||J||^2 / 3)^(3/2) averaged geometrically over its neighbourhood and measured anew every ten sweeps; epsilon
/// is set for each vertex from the worst determinant about it. Each vertex takes one Newton step on its three coordinates, with
/// negative curvature counted as positive. Ends after as many sweeps as [`super::untangle()`] takes steps, or 200 without a flipped tet less, at the
/// latest, or when cancelled.
pub fn untangle_locally(
    domain: &Domain,
    start: &[Vec3],
    fixed: &[bool],
    shapes: Shapes,
    settings: &OptimizeSettings,
    observe: &mut dyn FnMut(&TraceRow),
) -> Untangled {
    let mut best = Untangled::of_start(domain, start);
    if best.resisting.is_empty() {
        return best;
    }
    let clock = Instant::now();
    let mut state = Local::new(domain, start.to_vec(), shapes);
    let free: Vec<usize> = (0..fixed.len()).filter(|&v| !fixed[v]).collect();
    let mut near = free.clone();
    let (mut sweeps, mut last_gain, mut floor) = (0, 0, FIRST_FLOOR);
    while sweeps < most_steps(settings) && sweeps - last_gain < PATIENCE && !settings.cancel.is_due() {
        if sweeps % SCALED == 0 {
            state.measure_scales();
        }
        let moved = if sweeps < WHOLE || sweeps % COUNTED == 0 { &free } else { &near };
        let energy: f64 = moved.iter().map(|&v| state.relax(v, floor)).sum();
        sweeps += 1;
        if sweeps % COUNTED > 0 {
            continue;
        }
        let flipped = flipped_tets(domain, &state.image);
        best.iterations = sweeps;
        best.seconds = clock.elapsed().as_secs_f64();
        observe(&TraceRow {
            phase: format!("untangle, {} flipped", flipped.len()).into(),
            iteration: sweeps,
            objective: energy,
            max_k: if flipped.is_empty() { f64::NAN } else { f64::INFINITY },
            mean_k: f64::INFINITY,
            step: 1.0,
            round: 0,
            progress: 0.0,
            seconds: best.seconds,
        });
        near = about(domain, &flipped, fixed);
        if flipped.len() < best.resisting.len() {
            best.positions.copy_from_slice(&state.image);
            best.resisting = flipped;
            last_gain = sweeps;
            if best.resisting.is_empty() {
                break;
            }
        } else if (sweeps - last_gain) % STALLED == 0 {
            floor *= FALL;
        }
    }
    best
}

/// The free vertices of some tets and of the rings of tets about them.
fn about(domain: &Domain, tets: &[TetId], fixed: &[bool]) -> Vec<usize> {
    let mesh = domain.mesh();
    let mut inside = vec![false; fixed.len()];
    tets.iter().flat_map(|tet| mesh.tets()[tet.index()]).for_each(|v| inside[v.index()] = true);
    for _ in 0..RINGS {
        let before = inside.clone();
        let touching = mesh.tets().iter().filter(|tet| tet.iter().any(|v| before[v.index()]));
        touching.flatten().for_each(|v| inside[v.index()] = true);
    }
    (0..fixed.len()).filter(|&v| inside[v] && !fixed[v]).collect()
}

/// A map in the making, with what a vertex needs of its tets.
struct Local<'d> {
    domain: &'d Domain,
    /// The inverse edge matrix of the shape that each tet is compared with.
    rest: Vec<Mat3>,
    image: Vec<Vec3>,
    /// For each tet the scale that its determinant is measured in.
    scales: Vec<f64>,
    /// For each vertex its corners `4 * tet + local vertex`, from `starts[vertex]` on.
    starts: Vec<usize>,
    corners: Vec<u32>,
    parts: Vec<Part>,
}

/// One tet as a function of one of its vertices, at the offset d from where it is:
/// ||J||^2 = n + 2 (J g) . d + |g|^2 |d|^2 and det J = determinant + (cof J g) . d, g being the vertex's gradient in the domain.
struct Part {
    norm: f64,
    norm_slope: Vec3,
    norm_curvature: f64,
    determinant: f64,
    determinant_slope: Vec3,
    scale: f64,
}

impl Part {
    /// ||J||^2 / 3 over (scale chi)^(2/3), and chi, at an offset.
    fn value(&self, offset: &Vec3, epsilon: f64) -> f64 {
        let norm = self.norm + 2.0 * self.norm_slope.dot(offset) + self.norm_curvature * offset.norm_squared();
        let determinant = self.determinant + self.determinant_slope.dot(offset);
        let (chi, ..) = regularised(determinant / self.scale, epsilon);
        norm.max(0.0) / (3.0 * (self.scale * chi).cbrt().powi(2))
    }
}

/// chi(d) = (d + sqrt(epsilon^2 + d^2)) / 2 and its first two derivatives over chi.
fn regularised(determinant: f64, epsilon: f64) -> (f64, f64, f64) {
    let root = determinant.hypot(epsilon);
    // For negative determinants the sum cancels; this form does not.
    let chi =
        if determinant >= 0.0 { 0.5 * (determinant + root) } else { 0.5 * epsilon * (epsilon / (root - determinant)) };
    (chi, 1.0 / root, 0.5 * (epsilon / root).powi(2) / root / chi)
}

impl<'d> Local<'d> {
    fn new(domain: &'d Domain, image: Vec<Vec3>, shapes: Shapes) -> Self {
        let tets = domain.mesh().tets();
        let mut starts = vec![0; image.len() + 1];
        tets.iter().flatten().for_each(|v| starts[v.index() + 1] += 1);
        for v in 0..image.len() {
            starts[v + 1] += starts[v];
        }
        let mut next = starts.clone();
        let mut corners = vec![0; 4 * tets.len()];
        for (corner, v) in (0..).zip(tets.iter().flatten()) {
            corners[next[v.index()]] = corner;
            next[v.index()] += 1;
        }
        let rest = match shapes {
            Shapes::Own => domain.inverse_edges().to_vec(),
            Shapes::Thick => domain.inverse_edges().iter().map(thick).collect(),
        };
        Self { domain, rest, image, scales: vec![1.0; tets.len()], starts, corners, parts: Vec::new() }
    }

    fn jacobian(&self, tet: usize) -> Mat3 {
        let corners = self.domain.mesh().tets()[tet].map(|v| self.image[v.index()]);
        edge_matrix(corners) * self.rest[tet]
    }

    fn corners_of(&self, vertex: usize) -> std::ops::Range<usize> {
        self.starts[vertex]..self.starts[vertex + 1]
    }

    /// (||J||^2 / 3)^(3/2) of each tet, its logarithm averaged over the tets of each vertex, then over the vertices of each tet.
    fn measure_scales(&mut self) {
        let logs: Vec<f64> = (0..self.scales.len())
            .map(|t| 1.5 * (self.jacobian(t).norm_squared() / 3.0).max(f64::MIN_POSITIVE).ln())
            .collect();
        let at_vertex = |v: usize| {
            let corners = &self.corners[self.corners_of(v)];
            corners.iter().map(|&corner| logs[corner as usize / 4]).sum::<f64>() / corners.len() as f64
        };
        let at_vertices: Vec<f64> = (0..self.image.len()).map(at_vertex).collect();
        for (scale, tet) in self.scales.iter_mut().zip(self.domain.mesh().tets()) {
            *scale = (tet.iter().map(|v| at_vertices[v.index()]).sum::<f64>() / 4.0).exp();
        }
    }

    /// One Newton step of a vertex; the energy of its tets before.
    fn relax(&mut self, vertex: usize, floor: f64) -> f64 {
        let mut parts = std::mem::take(&mut self.parts);
        parts.clear();
        parts.extend(self.corners[self.corners_of(vertex)].iter().map(|&corner| self.part(corner)));
        let worst = parts.iter().map(|part| part.determinant / part.scale).fold(0.0, f64::min);
        let epsilon = floor.hypot(SHARE * worst);
        let (value, gradient, hessian) = derivatives(&parts, epsilon);
        if value.is_finite()
            && let Some(step) = descent(&hessian, &gradient)
        {
            let slope = step.dot(&gradient);
            let mut length = 1.0;
            for _ in 0..HALVINGS {
                let offset = step * length;
                let trial: f64 = parts.iter().map(|part| part.value(&offset, epsilon)).sum();
                if trial < value && trial <= value + ARMIJO * length * slope {
                    self.image[vertex] += offset;
                    break;
                }
                length *= 0.5;
            }
        }
        self.parts = parts;
        value
    }

    fn part(&self, corner: u32) -> Part {
        let (tet, local) = (corner as usize / 4, corner as usize % 4);
        let rows = &self.rest[tet];
        let gradient = match local {
            0 => -(rows.row(0) + rows.row(1) + rows.row(2)).transpose(),
            _ => rows.row(local - 1).transpose(),
        };
        let jacobian = self.jacobian(tet);
        let [a, b, c] = [0, 1, 2].map(|i| Vec3::from(jacobian.column(i)));
        let cofactors = [b.cross(&c), c.cross(&a), a.cross(&b)];
        Part {
            norm: jacobian.norm_squared(),
            norm_slope: jacobian * gradient,
            norm_curvature: gradient.norm_squared(),
            determinant: a.dot(&cofactors[0]),
            determinant_slope: cofactors[0] * gradient.x + cofactors[1] * gradient.y + cofactors[2] * gradient.z,
            scale: self.scales[tet],
        }
    }
}

/// The inverse edge matrix of a tet made so thick that none of its widths is less than a part of the largest.
fn thick(inverse: &Mat3) -> Mat3 {
    let Svd { left, mut values, right } = svd(inverse);
    let most = values[2] / LEAST_WIDTH;
    if values[0] <= most {
        return *inverse;
    }
    values = values.map(|value| value.min(most));
    left * Mat3::from_diagonal(&values.into()) * right.transpose()
}

/// The sum of the energies of some tets, its gradient and its Hessian in a vertex.
fn derivatives(parts: &[Part], epsilon: f64) -> (f64, Vec3, Mat3) {
    let (mut value, mut gradient, mut hessian) = (0.0, Vec3::zeros(), Mat3::zeros());
    for part in parts {
        let (_, first, second) = regularised(part.determinant / part.scale, epsilon);
        let (first, second) = (first / part.scale, second / part.scale / part.scale);
        let energy = part.value(&Vec3::zeros(), epsilon);
        let (of_norm, of_determinant) = (2.0 * part.norm_slope / part.norm, part.determinant_slope);
        // Derivatives of the logarithm, and with them those of the energy.
        let slope = of_norm - 2.0 / 3.0 * first * of_determinant;
        value += energy;
        gradient += energy * slope;
        hessian += energy
            * (Mat3::identity() * (2.0 * part.norm_curvature / part.norm) - of_norm * of_norm.transpose()
                + 2.0 / 3.0 * (first * first - second) * of_determinant * of_determinant.transpose()
                + slope * slope.transpose());
    }
    (value, gradient, hessian)
}

/// The Newton direction, negative curvature counted as positive; `None` if it does not descend.
fn descent(hessian: &Mat3, gradient: &Vec3) -> Option<Vec3> {
    let eigen = hessian.symmetric_eigen();
    let floor = (1e-8 * eigen.eigenvalues.amax()).max(f64::MIN_POSITIVE);
    let along = eigen.eigenvectors.tr_mul(gradient);
    let step = -(eigen.eigenvectors
        * along.zip_map(&eigen.eigenvalues, |slope, curvature| slope / curvature.abs().max(floor)));
    (step.dot(gradient) < 0.0).then_some(step)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_agree_with_differences() {
        let part = |seed: f64, determinant: f64| Part {
            norm: 3.0 + seed,
            norm_slope: Vec3::new(0.3 * seed, -0.2, 0.1),
            norm_curvature: 0.7 + seed,
            determinant,
            determinant_slope: Vec3::new(-0.4, 0.5 * seed, 0.2),
            scale: 1.0 + 0.5 * seed,
        };
        let parts = [part(0.2, -0.3), part(0.9, 0.4), part(0.5, -0.01)];
        let epsilon = 0.1;
        let at = |offset: Vec3| parts.iter().map(|part| part.value(&offset, epsilon)).sum::<f64>();
        let (value, gradient, hessian) = derivatives(&parts, epsilon);
        assert!((value - at(Vec3::zeros())).abs() < 1e-14 * value);
        // Errors of h^2 times third and fourth derivatives, which grow with powers of 1 / epsilon, and of rounding.
        let h = 1e-4;
        let axes = [Vec3::x() * h, Vec3::y() * h, Vec3::z() * h];
        for i in 0..3 {
            let first = (at(axes[i]) - at(-axes[i])) / (2.0 * h);
            assert!((first - gradient[i]).abs() < 1e-5 * gradient.norm(), "{first} {}", gradient[i]);
            for j in 0..3 {
                let corners =
                    at(axes[i] + axes[j]) - at(axes[i] - axes[j]) - at(axes[j] - axes[i]) + at(-axes[i] - axes[j]);
                let second = corners / (4.0 * h * h);
                assert!((second - hessian[(i, j)]).abs() < 1e-4 * hessian.norm(), "{second} {}", hessian[(i, j)]);
            }
        }
    }
}

//! The star kernel of a solid: all points that see the whole surface, an intersection of half-spaces.

use std::collections::HashSet;

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT, SupportedConeT::NonnegativeConeT,
};

use super::Surface;
use crate::mesh::{Orientation, TriangleId, Vec3, orientation};

/// At most so many triangles are named in an error.
pub(super) const NAMED_FACES: usize = 8;

/// Planes that agree to this, in units of the solid's size, are one to the linear program. Far below the smallest radius
/// that counts, and above the rounding of coplanar triangles.
const SAME_PLANE: f64 = 1e-10;

/// The least radius, in units of the solid's size, at which a kernel counts: the solver's accuracy is about 1e-8.
const LEAST_RADIUS: f64 = 1e-7;

/// Why a solid has no usable kernel.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum KernelError {
    /// No point sees the whole surface.
    #[error(
        "the solid is not star-shaped: no point inside it sees these triangles (counted from 0) all from within: {faces:?}"
    )]
    NotStarShaped {
        /// Triangles whose half-spaces have no point in common, up to eight, the most decisive first.
        faces: Vec<u32>,
    },
    /// Each triangle is seen from within, but the surface winds around the point several times.
    #[error("the surface cuts through itself: it winds {times} times around its kernel")]
    WindsAround {
        /// How often.
        times: i64,
    },
    /// The solver gave up.
    #[error("the linear program for the kernel ended with {status}; check the solid for needle-like triangles")]
    Solver {
        /// Clarabel's status.
        status: String,
    },
}

/// The largest ball in the kernel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StarKernel {
    /// Its centre (a Chebyshev centre of the kernel): sees every triangle from within, by exact predicate.
    pub centre: Vec3,
    /// Its radius: the centre's distance from the nearest plane of a triangle; in the solid's units of length.
    pub radius: f64,
}

impl StarKernel {
    /// Finds it by linear programming: the largest r with `n.c + r <= n.p` for the plane (n, p) of every triangle.
    ///
    /// # Errors
    /// The solid is not star-shaped, with triangles that prove it; or the solver failed.
    pub fn of(surface: &Surface) -> Result<Self, KernelError> {
        let planes = Planes::of(surface);
        let (solution, multipliers) = planes.largest_ball()?;
        let centre = planes.to_solid(Vec3::from_column_slice(&solution[..3]));
        if solution[3] <= LEAST_RADIUS {
            // Infeasibility of r > 0 is a combination of planes with positive multipliers (Farkas).
            let mut order: Vec<usize> = (0..multipliers.len()).collect();
            order.sort_by(|&a, &b| multipliers[b].total_cmp(&multipliers[a]).then(a.cmp(&b)));
            let decisive = order.into_iter().filter(|&i| multipliers[i] > 1e-3).take(NAMED_FACES);
            let faces = decisive.map(|i| planes.triangles[i].0).collect();
            return Err(KernelError::NotStarShaped { faces });
        }
        let hidden = hidden_triangles(surface, &centre);
        if !hidden.is_empty() {
            let faces = hidden.iter().take(NAMED_FACES).map(|triangle| triangle.0).collect();
            return Err(KernelError::NotStarShaped { faces });
        }
        match winding_number(surface, &centre) {
            1 => Ok(Self { centre, radius: planes.clearance(&centre) }),
            times => Err(KernelError::WindsAround { times }),
        }
    }

    /// The point nearest to `target` in the kernel shrunk by `margin` (a length, less than [`StarKernel::radius`]).
    ///
    /// # Errors
    /// The solver failed.
    pub fn nearest(&self, surface: &Surface, target: &Vec3, margin: f64) -> Result<Vec3, KernelError> {
        let planes = Planes::of(surface);
        let nearest = planes.nearest(target, margin)?;
        // The margin is far above the solver's accuracy; should it fail all the same, the centre is a true answer.
        Ok(if hidden_triangles(surface, &nearest).is_empty() { nearest } else { self.centre })
    }
}

/// The triangles that a point sees edge-on or from behind, by exact predicate.
pub(super) fn hidden_triangles(surface: &Surface, centre: &Vec3) -> Vec<TriangleId> {
    let hidden = |triangle: &TriangleId| {
        let [a, b, c] = surface.corners(*triangle);
        orientation([centre, &a, &b, &c]) != Orientation::Positive
    };
    surface.ids().filter(hidden).collect()
}

/// How often the surface winds around a point off it: its total solid angle over 4 pi.
///
/// If every triangle is seen from within, central projection is a covering of the sphere, branched at most at vertices;
/// it is one-to-one, and the solid star-shaped, exactly if this is 1.
fn winding_number(surface: &Surface, centre: &Vec3) -> i64 {
    let solid_angle: f64 =
        surface.ids().map(|triangle| solid_angle(surface.corners(triangle).map(|p| p - centre))).sum();
    (solid_angle / (4.0 * std::f64::consts::PI)).round() as i64
}

/// The signed solid angle of a triangle seen from the origin, in (-2 pi, 2 pi) (van Oosterom and Strackee 1983).
fn solid_angle([a, b, c]: [Vec3; 3]) -> f64 {
    let [a, b, c] = [a.normalize(), b.normalize(), c.normalize()];
    2.0 * a.dot(&b.cross(&c)).atan2(1.0 + a.dot(&b) + b.dot(&c) + c.dot(&a))
}

/// The planes of a surface's triangles, coplanar ones once, in units of the solid: the bounding box has its centre at the
/// origin and a diagonal of 2.
struct Planes {
    origin: Vec3,
    unit: f64,
    normals: Vec<Vec3>,
    offsets: Vec<f64>,
    /// The first triangle in each plane.
    triangles: Vec<TriangleId>,
}

impl Planes {
    fn of(surface: &Surface) -> Self {
        let (low, high) = surface.bounding_box();
        let (origin, unit) = ((low + high) / 2.0, (high - low).norm() / 2.0);
        let mut planes = Self { origin, unit, normals: vec![], offsets: vec![], triangles: vec![] };
        let mut seen = HashSet::new();
        for triangle in surface.ids() {
            let corners = surface.corners(triangle).map(|p| (p - origin) / unit);
            let area_vector = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
            // Zero by underflow only: such a plane has no computable normal; the exact predicate checks it at the end.
            let Some(normal) = area_vector.try_normalize(0.0) else { continue };
            let offset = normal.dot(&((corners[0] + corners[1] + corners[2]) / 3.0));
            let key = [normal.x, normal.y, normal.z, offset].map(|x| (x / SAME_PLANE).round() as i64);
            if seen.insert(key) {
                planes.normals.push(normal);
                planes.offsets.push(offset);
                planes.triangles.push(triangle);
            }
        }
        planes
    }

    fn to_solid(&self, point: Vec3) -> Vec3 {
        self.origin + self.unit * point
    }

    /// The least distance of a point (in the solid's units) from a plane, negative outside the kernel.
    fn clearance(&self, point: &Vec3) -> f64 {
        let scaled = (point - self.origin) / self.unit;
        let distances = self.normals.iter().zip(&self.offsets).map(|(normal, offset)| offset - normal.dot(&scaled));
        self.unit * distances.fold(f64::INFINITY, f64::min)
    }

    /// Centre and radius, and the multiplier of each plane; these sum to 1.
    fn largest_ball(&self) -> Result<(Vec<f64>, Vec<f64>), KernelError> {
        let matrix = self.columns(true);
        solve(&CscMatrix::zeros((4, 4)), &[0.0, 0.0, 0.0, -1.0], &matrix, &self.offsets)
    }

    fn nearest(&self, target: &Vec3, margin: f64) -> Result<Vec3, KernelError> {
        let target = (target - self.origin) / self.unit;
        // Distances beyond the solid's size say nothing but a direction, and would spoil the solver's accuracy.
        let target = target.cap_magnitude(10.0);
        let offsets: Vec<f64> = self.offsets.iter().map(|offset| offset - margin / self.unit).collect();
        let linear: Vec<f64> = target.iter().map(|x| -x).collect();
        let (point, _) = solve(&CscMatrix::identity(3), &linear, &self.columns(false), &offsets)?;
        Ok(self.to_solid(Vec3::from_column_slice(&point)))
    }

    /// The constraint matrix with a row for each plane: its normal and, if asked for, a 1.
    fn columns(&self, with_radius: bool) -> CscMatrix<f64> {
        let rows = self.normals.len();
        let columns = if with_radius { 4 } else { 3 };
        let values = (0..columns).flat_map(|j| self.normals.iter().map(move |n| if j < 3 { n[j] } else { 1.0 }));
        let starts = (0..=columns).map(|j| j * rows).collect();
        let row_indices = (0..columns).flat_map(|_| 0..rows).collect();
        CscMatrix::new(rows, columns, starts, row_indices, values.collect())
    }
}

/// min x.P x / 2 + q.x subject to A x <= b: the solution and the multipliers.
fn solve(
    quadratic: &CscMatrix<f64>,
    linear: &[f64],
    matrix: &CscMatrix<f64>,
    bounds: &[f64],
) -> Result<(Vec<f64>, Vec<f64>), KernelError> {
    let failed = |status: String| KernelError::Solver { status };
    let cones: [SupportedConeT<f64>; 1] = [NonnegativeConeT(bounds.len())];
    let settings = DefaultSettings { verbose: false, max_threads: 1, ..Default::default() };
    let mut solver = DefaultSolver::new(quadratic, linear, matrix, bounds, &cones, settings)
        .map_err(|error| failed(error.to_string()))?;
    solver.solve();
    match solver.solution.status {
        SolverStatus::Solved | SolverStatus::AlmostSolved => Ok((solver.solution.x, solver.solution.z)),
        status => Err(failed(format!("{status:?}"))),
    }
}

#[cfg(test)]
pub(super) mod tests;

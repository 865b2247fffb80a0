//! The star kernel of a solid: all points that see the whole surface, an intersection of half-spaces.

use std::collections::HashSet;

use nalgebra::{Matrix4, Vector4};

use super::Surface;
use crate::linalg::QuadraticProgram;
use crate::mesh::{Mat3, Orientation, TriangleId, Vec3, View, orientation};

/// At most so many triangles are named in an error.
pub(super) const NAMED_FACES: usize = 8;

/// Planes that agree to this, in units of the solid's size, are one to the linear program. Far below the smallest radius
/// that counts, and above the rounding of coplanar triangles.
const SAME_PLANE: f64 = 1e-10;

/// Residual of the programs solved here, in units of the solid's size; one that ends above the second is not solved.
const ACCURACY: f64 = 1e-9;
const WORST_ACCURACY: f64 = 1e-7;

/// The least radius, in units of the solid's size, at which a kernel counts: no better than the worst accuracy.
const LEAST_RADIUS: f64 = 1e-7;

/// Planes with multipliers below this part of the largest take no part in a conflict: the solver leaves far less there.
const DECISIVE: f64 = 1e-3;

/// Why a solid has no usable kernel.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum KernelError {
    /// A surface of higher genus, which bounds no ball.
    #[error(
        "the surface has {handles} handle{s}, like a torus: such a solid is not star-shaped; fill the hole{s}",
        s = if *handles == 1 { "" } else { "s" }
    )]
    Handles {
        /// How many.
        handles: usize,
    },
    /// No point sees the whole surface.
    #[error(
        "the solid is not star-shaped: no point inside it sees all of these triangles from within: {faces:?} (counted \
         from 0, with polygons cut into triangles), around {at:.4?}; fill the dents that hide them from one another, or map it \
         by map.kind = \"spherical\", on a mesh by mesh.kind = \"tetgen\" or \"gmsh\""
    )]
    NotStarShaped {
        /// Triangles whose half-spaces have no point in common, up to eight, the most decisive first.
        faces: Vec<u32>,
        /// The centroids of the first two of them.
        at: Vec<[f64; 3]>,
    },
    /// Each triangle is seen from within, but the surface winds around the point several times.
    #[error("the surface cuts through itself: it winds {times} times around its kernel")]
    WindsAround {
        /// How often.
        times: i64,
    },
    /// The solver gave up.
    #[error(
        "the linear program for the kernel ended with a residual of {residual:.1e}; check the solid for needle-like triangles"
    )]
    Solver {
        /// By how much the conditions of optimality fail, in units of the solid's size.
        residual: f64,
    },
}

impl KernelError {
    fn not_star_shaped(surface: &Surface, faces: Vec<TriangleId>) -> Self {
        let centroid = |&face: &TriangleId| (surface.corners(face).iter().sum::<Vec3>() / 3.0).into();
        let at = faces.iter().take(2).map(centroid).collect();
        Self::NotStarShaped { faces: faces.into_iter().map(|face| face.0).collect(), at }
    }
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
        if surface.genus() > 0 {
            return Err(KernelError::Handles { handles: surface.genus() });
        }
        let planes = Planes::of(surface);
        let (solution, multipliers) = planes.largest_ball()?;
        let centre = planes.to_solid(solution.xyz());
        if solution[3] <= LEAST_RADIUS {
            // Infeasibility of r > 0 is a combination of planes with positive multipliers (Farkas).
            let mut order: Vec<usize> = (0..multipliers.len()).collect();
            order.sort_by(|&a, &b| multipliers[b].total_cmp(&multipliers[a]).then(a.cmp(&b)));
            let least = DECISIVE * multipliers[order[0]];
            let decisive = order.into_iter().filter(|&i| multipliers[i] > least).take(NAMED_FACES);
            return Err(KernelError::not_star_shaped(surface, decisive.map(|i| planes.triangles[i]).collect()));
        }
        let corners: Vec<[Vec3; 3]> = surface.ids().map(|triangle| surface.corners(triangle)).collect();
        match View::from(&centre, corners.iter().map(|corners| corners.each_ref())) {
            View::Covers(1) => Ok(Self { centre, radius: planes.clearance(&centre) }),
            View::Covers(times) => Err(KernelError::WindsAround { times }),
            View::FacesAway(_) => {
                let hidden = hidden_triangles(surface, &centre);
                Err(KernelError::not_star_shaped(surface, hidden.into_iter().take(NAMED_FACES).collect()))
            }
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
    fn largest_ball(&self) -> Result<(Vector4<f64>, Vec<f64>), KernelError> {
        let rows: Vec<Vector4<f64>> = self.normals.iter().map(|normal| normal.push(1.0)).collect();
        let linear = Vector4::new(0.0, 0.0, 0.0, -1.0);
        solve(&QuadraticProgram { quadratic: Matrix4::zeros(), linear, rows: &rows, bounds: &self.offsets })
    }

    fn nearest(&self, target: &Vec3, margin: f64) -> Result<Vec3, KernelError> {
        let target = (target - self.origin) / self.unit;
        // Distances beyond the solid's size say nothing but a direction, and would spoil the solver's accuracy.
        let target = target.cap_magnitude(10.0);
        let bounds: Vec<f64> = self.offsets.iter().map(|offset| offset - margin / self.unit).collect();
        let (quadratic, linear, rows) = (Mat3::identity(), -target, &self.normals);
        let (point, _) = solve(&QuadraticProgram { quadratic, linear, rows, bounds: &bounds })?;
        Ok(self.to_solid(point))
    }
}

/// The solution and the multipliers.
fn solve<const N: usize>(
    program: &QuadraticProgram<'_, N>,
) -> Result<(nalgebra::SVector<f64, N>, Vec<f64>), KernelError> {
    let optimum = program.solve(ACCURACY);
    // False for NaN.
    let solved = optimum.residual <= WORST_ACCURACY;
    if solved {
        Ok((optimum.point, optimum.multipliers))
    } else {
        Err(KernelError::Solver { residual: optimum.residual })
    }
}

#[cfg(test)]
pub(super) mod tests;

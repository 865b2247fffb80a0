//! Caraman's radial map of a star-shaped solid onto the unit ball (paper §2.4, eq. 19, 20).

use bvh::aabb::{Aabb, Bounded};
use bvh::bounding_hierarchy::BHShape;
use bvh::bvh::Bvh;
use bvh::ray::Ray;
use nalgebra::Point3;
use rayon::prelude::*;

use crate::domain::Domain;
use crate::mesh::{Mat3, TriangleId, Vec3};
use crate::solid::{ShellMesh, Surface};

/// A point of a star-shaped solid as its fraction of the ray from the star centre to the boundary.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadialCoordinates {
    /// u(x) = |x| / |zeta(x)| in [0, 1], measured from the centre (paper §2.4; printed inverted there).
    pub fraction: f64,
    /// Unit vector from the centre to zeta(x); zero at the centre itself.
    pub direction: Vec3,
}

/// Caraman's map f(x) = u(x)^a zeta(x)/|zeta(x)|, f(centre) = 0 (paper eq. 20).
///
/// Quasi-conformal onto the unit ball for every exponent a > 0; boundary points (u = 1) land on the sphere.
pub fn caraman(coordinates: &[RadialCoordinates], exponent: f64) -> Vec<Vec3> {
    coordinates.iter().map(|at| at.direction * at.fraction.powf(exponent)).collect()
}

/// A ray from the centre that meets no triangle of the surface.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "the ray from the centre through point {point} meets no triangle: the surface is not star-shaped about the centre"
)]
pub struct RayError {
    /// Index of the point.
    pub point: usize,
}

impl RadialCoordinates {
    /// The coordinates of a shell mesh's vertices, known from its construction.
    pub fn of_shell(shell: &ShellMesh) -> Vec<Self> {
        let centre = shell.mesh.points()[0];
        let at_centre = Self { fraction: 0.0, direction: Vec3::zeros() };
        let on_rays = shell.rays.iter().map(|&(vertex, fraction)| Self {
            fraction,
            direction: (shell.surface.points()[vertex.index()] - centre).normalize(),
        });
        std::iter::once(at_centre).chain(on_rays).collect()
    }
}

impl RadialCoordinates {
    /// The coordinates of all vertices of a mesh of the solid inside `surface`, those of its boundary at the ends of their rays.
    ///
    /// # Errors
    /// [`RayError`] if a ray misses the surface by more than rounding.
    pub fn of_domain(domain: &Domain, surface: &Surface, centre: Vec3, end: RayEnd) -> Result<Vec<Self>, RayError> {
        let mut coordinates = by_ray_casting(surface, centre, domain.mesh().points(), end)?;
        for (at, &on_boundary) in coordinates.iter_mut().zip(domain.boundary().vertex_mask()) {
            // With "farthest" a boundary point may lie before the end of its ray.
            if on_boundary && (end == RayEnd::Only || at.fraction > 1.0 - 1e-9) {
                at.fraction = 1.0;
            }
        }
        Ok(coordinates)
    }
}

/// Which boundary point of a ray is meant where a ray meets the boundary more than once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RayEnd {
    /// There is only one: the solid is star-shaped about the centre.
    Only,
    /// The farthest one: the paper's extension to other solids (§2.4).
    Farthest,
}

/// The boundary of a solid as a centre sees it: where the rays from the centre end. Kept for many rays.
pub struct Rays {
    cones: Vec<Cone>,
    hierarchy: Bvh<f64, 3>,
    /// The largest coordinate of a boundary point, from the centre.
    size: f64,
}

impl Rays {
    /// The rays from `centre` to `surface`.
    pub fn new(surface: &Surface, centre: Vec3) -> Self {
        let size = surface.points().iter().map(|p| (p - centre).amax()).fold(0.0, f64::max);
        let cone = |triangle| Cone::new(surface, centre, TriangleId(triangle), 1e-9 * size);
        let mut cones: Vec<Cone> = (0..surface.triangles().len() as u32).map(cone).collect();
        let hierarchy = Bvh::build(&mut cones);
        Self { cones, hierarchy, size }
    }

    /// One over the length of the ray in a direction, a unit vector; `None` if it misses the surface by more than rounding.
    ///
    /// In the cone of a triangle that the ray meets, with corners a, b, c seen from the centre, the direction is la + mb + nc and
    /// l + m + n is the value. Of a star-shaped solid the triangle of the largest least coefficient is taken, so a ray through an
    /// edge or a vertex finds one of its triangles, all of which give the same up to rounding.
    pub fn reciprocal_length(&self, direction: &Vec3, end: RayEnd) -> Option<f64> {
        let ray = Ray::new(Point3::origin(), *direction);
        // Rounding leaves the coefficients of a hit at an edge above -1e-9 of their sum.
        let hits = self
            .hierarchy
            .traverse_iterator(&ray, &self.cones)
            .filter_map(|cone| cone.coefficients(direction))
            .filter(|weights| weights.min() >= -1e-9 * weights.sum());
        let hit = match end {
            RayEnd::Only => hits.max_by(|a, b| a.min().total_cmp(&b.min())),
            RayEnd::Farthest => hits.min_by(|a, b| a.sum().total_cmp(&b.sum())),
        };
        hit.map(|weights| weights.sum())
    }
}

/// The coordinates of any points of the solid inside `surface`, by casting a ray from the centre through each. A point up to
/// rounding outside has u clamped to 1.
///
/// # Errors
/// [`RayError`] if a ray misses the surface by more than rounding.
pub fn by_ray_casting(
    surface: &Surface,
    centre: Vec3,
    points: &[Vec3],
    end: RayEnd,
) -> Result<Vec<RadialCoordinates>, RayError> {
    let rays = Rays::new(surface, centre);
    points
        .par_iter()
        .enumerate()
        .map(|(index, point)| {
            let offset = point - centre;
            if offset.norm() <= f64::EPSILON * rays.size {
                return Ok(RadialCoordinates { fraction: 0.0, direction: Vec3::zeros() });
            }
            let direction = offset.normalize();
            let reciprocal = rays.reciprocal_length(&direction, end).ok_or(RayError { point: index })?;
            Ok(RadialCoordinates { fraction: (offset.norm() * reciprocal).min(1.0), direction })
        })
        .collect()
}

/// A triangle of the surface with the inverse of its corners' matrix, relative to the centre.
struct Cone {
    inverse: Option<Mat3>,
    bounds: Aabb<f64, 3>,
    node: usize,
}

impl Cone {
    fn new(surface: &Surface, centre: Vec3, triangle: TriangleId, margin: f64) -> Self {
        let corners = surface.triangles()[triangle.index()].map(|v| surface.points()[v.index()] - centre);
        let low = corners[0].inf(&corners[1]).inf(&corners[2]);
        let high = corners[0].sup(&corners[1]).sup(&corners[2]);
        let margin = Vec3::from_element(margin);
        Self {
            inverse: Mat3::from_columns(&corners).try_inverse(),
            // Wider by a margin, since a ray in the plane of a box's face may count as missing it.
            bounds: Aabb::with_bounds((low - margin).into(), (high + margin).into()),
            node: 0,
        }
    }

    /// Coefficients of `direction` in the corners, if it points into the half-space of the triangle.
    fn coefficients(&self, direction: &Vec3) -> Option<Vec3> {
        let weights = self.inverse? * direction;
        (weights.sum() > 0.0).then_some(weights)
    }
}

impl Bounded<f64, 3> for Cone {
    fn aabb(&self) -> Aabb<f64, 3> {
        self.bounds
    }
}

impl BHShape<f64, 3> for Cone {
    fn set_bh_node_index(&mut self, index: usize) {
        self.node = index;
    }

    fn bh_node_index(&self) -> usize {
        self.node
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solid::{ShellSettings, Solid, shell_mesh};

    fn shell(solid: &Solid, centre: Vec3) -> ShellMesh {
        let settings = ShellSettings { subdivisions: 3, refinement: None, layers: 4, grading: 1.2 };
        shell_mesh(&solid.surface().unwrap(), centre, &settings).unwrap()
    }

    #[test]
    fn rays_agree_with_the_shell_through_edges_and_vertices() {
        for (solid, centre) in [(Solid::Cube, Vec3::zeros()), (Solid::Octahedron, Vec3::new(0.05, -0.1, 0.02))] {
            let shell = shell(&solid, centre);
            let known = RadialCoordinates::of_shell(&shell);
            // Cast against the coarse surface: every shell vertex on an edge or a corner of it is a hard case.
            let cast = by_ray_casting(&solid.surface().unwrap(), centre, shell.mesh.points(), RayEnd::Only).unwrap();
            for (a, b) in known.iter().zip(&cast) {
                // Both round at 1e-16 times the condition of a cone (below 100).
                assert!((a.fraction - b.fraction).abs() < 1e-13 && (a.direction - b.direction).norm() < 1e-13);
            }
        }
    }

    #[test]
    fn the_boundary_lands_on_the_sphere_and_the_exponent_bends_the_rays() {
        let shell = shell(&Solid::Icosahedron, Vec3::zeros());
        let coordinates = RadialCoordinates::of_shell(&shell);
        let image = caraman(&coordinates, 2.0);
        for (at, y) in coordinates.iter().zip(&image) {
            assert!((y.norm() - at.fraction.powi(2)).abs() < 1e-15);
        }
    }

    #[test]
    fn a_ray_that_misses_is_an_error() {
        let surface = Solid::Cube.surface().unwrap();
        let outside = Vec3::new(3.0, 0.0, 0.0);
        assert_eq!(
            by_ray_casting(&surface, outside, &[Vec3::new(4.0, 0.0, 0.0)], RayEnd::Only),
            Err(RayError { point: 0 })
        );
    }

    #[test]
    fn the_farthest_end_of_a_ray_that_leaves_and_enters_again() {
        // From outside a cube the ray along x meets it at 2 and at 4.
        let surface = Solid::Cube.surface().unwrap();
        let outside = Vec3::new(-3.0, 0.0, 0.0);
        let at = by_ray_casting(&surface, outside, &[Vec3::new(0.0, 0.1, 0.0)], RayEnd::Farthest).unwrap()[0];
        assert!((at.fraction - 0.75).abs() < 1e-15);
    }
}

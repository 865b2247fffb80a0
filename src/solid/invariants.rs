//! Invariants of a surface under conformal maps and under isometries (paper §1.1).

use std::f64::consts::PI;

use serde::Serialize;

use super::Surface;

/// The curvature of a surface of triangles, gathered at its vertices.
///
/// The mean curvature of the triangles' bends is that of an edge: `length x exterior dihedral angle / 2`, half of which goes
/// to each end (the half-tube formula of Lev, Saucan and Elber 2007 for a polyhedral surface). Divided by the vertex's cell,
/// a third of the area of its triangles, it is the mean curvature H at the vertex; positive on a convex solid, +1/R on a
/// sphere of radius R.
///
/// Where the triangles at a vertex form no pattern (6 around each vertex, opposite ones alike, in the limit), H converges in
/// the mean over a neighbourhood only, and the Willmore energy of finer and finer meshes stays above the surface's.
#[derive(Clone, Debug, PartialEq)]
pub struct Curvature {
    /// The cell area of each vertex; squared units of length.
    pub areas: Vec<f64>,
    /// H at each vertex; 1 / length.
    pub mean: Vec<f64>,
    /// The angle inside the solid at each edge, in the order of [`Surface::edges`]: radians in (0, 2 pi).
    pub dihedral_angles: Vec<f64>,
}

/// The integrals of a [`Curvature`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Invariants {
    /// The integral of H^2 (paper eq. 3 up to a constant), scale-free and invariant under conformal maps of space; at least
    /// 4 pi for smooth surfaces, 4 pi for spheres.
    pub willmore_energy: f64,
    /// The integral of H, a length, invariant under isometries; 4 pi R for a sphere.
    pub total_mean_curvature: f64,
    /// The area.
    pub area: f64,
}

impl Curvature {
    /// The curvature of a surface.
    pub fn of(surface: &Surface) -> Self {
        let count = surface.points().len();
        let mut areas = vec![0.0; count];
        for (id, triangle) in surface.ids().zip(surface.triangles()) {
            let third = surface.area_vector(id).norm() / 6.0;
            triangle.iter().for_each(|v| areas[v.index()] += third);
        }
        let mut bends = vec![0.0; count];
        let dihedral_angles: Vec<f64> = surface.edges().iter().map(|edge| surface.dihedral_angle(edge)).collect();
        for (edge, angle) in surface.edges().iter().zip(&dihedral_angles) {
            let [from, to] = edge.vertices;
            let length = (surface.points()[to.index()] - surface.points()[from.index()]).norm();
            let half = 0.25 * length * (PI - angle);
            bends[from.index()] += half;
            bends[to.index()] += half;
        }
        let mean = bends.iter().zip(&areas).map(|(bend, area)| bend / area).collect();
        Self { areas, mean, dihedral_angles }
    }

    /// The sums over the vertices.
    pub fn invariants(&self) -> Invariants {
        let over = |power: i32| self.mean.iter().zip(&self.areas).map(|(mean, area)| mean.powi(power) * area).sum();
        Invariants { willmore_energy: over(2), total_mean_curvature: over(1), area: over(0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solid::Solid;

    fn invariants(solid: Solid) -> Invariants {
        Curvature::of(&solid.surface().unwrap()).invariants()
    }

    #[test]
    fn the_integral_of_h_of_polyhedra_is_their_edge_formula() {
        // A box with sides a, b, c: 4 (a + b + c) of edge length, each with the exterior angle pi / 2.
        let size = [1.0, 2.0, 0.5];
        let curvature = Curvature::of(&Solid::Box { size }.surface().unwrap());
        let sums = curvature.invariants();
        assert!((sums.total_mean_curvature - 4.0 * 3.5 * PI / 4.0).abs() < 1e-13);
        assert!((sums.area - 7.0).abs() < 1e-13);
        let right = curvature.dihedral_angles.iter().filter(|angle| (**angle - PI / 2.0).abs() < 1e-14).count();
        let flat = curvature.dihedral_angles.iter().filter(|angle| (**angle - PI).abs() < 1e-14).count();
        // The barycentric cut halves each of the 12 edges and puts 8 more into each of the 6 faces.
        assert_eq!((right, flat), (24, 48));
    }

    #[test]
    fn spheres_converge_to_4_pi_at_second_order() {
        let error = |radius: f64, resolution: u32| {
            let sums = invariants(Solid::Ball { radius, resolution });
            let relative = |value: f64, exact: f64| (value / exact - 1.0).abs();
            [relative(sums.willmore_energy, 4.0 * PI), relative(sums.total_mean_curvature, 4.0 * PI * radius)]
        };
        let (coarse, middle, fine) = (error(2.5, 8), error(2.5, 16), error(2.5, 32));
        for i in 0..2 {
            // Each vertex but 12 has its triangles in pairs that are symmetric up to first order: the error is of second
            // order in the edge length, 4 for a halving; 3.4 leaves room for higher terms.
            assert!(fine[i] < 1e-3 && coarse[i] / middle[i] > 3.4 && middle[i] / fine[i] > 3.4);
        }
    }

    #[test]
    fn the_clifford_torus_converges_to_2_pi_squared_at_second_order() {
        let error = |resolution| {
            let torus = Solid::Torus { major_radius: 2f64.sqrt(), minor_radius: 1.0, resolution };
            let sums = invariants(torus);
            // The integral of H over a torus is 2 pi^2 R.
            let total = 2.0 * PI * PI * 2f64.sqrt();
            [sums.willmore_energy / (2.0 * PI * PI) - 1.0, sums.total_mean_curvature / total - 1.0].map(f64::abs)
        };
        let (coarse, middle, fine) = (error(32), error(64), error(128));
        for i in 0..2 {
            assert!(fine[i] < 1e-3 && coarse[i] / middle[i] > 3.4 && middle[i] / fine[i] > 3.4);
        }
    }

    #[test]
    fn an_inversion_keeps_the_willmore_energy_and_a_stretch_does_not() {
        let before = Solid::Torus { major_radius: 2f64.sqrt(), minor_radius: 1.0, resolution: 64 }.surface().unwrap();
        let moved = |map: &dyn Fn(&crate::mesh::Vec3) -> crate::mesh::Vec3| {
            let polygons = before.triangles().iter().map(|triangle| triangle.to_vec()).collect();
            let soup = crate::mesh::PolygonSoup::new(before.points().iter().map(map).collect(), polygons);
            Curvature::of(&Surface::from_soup(soup).unwrap()).invariants()
        };
        let from = crate::mesh::Vec3::new(0.0, 0.0, 3.0);
        let inverted = moved(&|p| (p - from) / (p - from).norm_squared());
        let stretched = moved(&|p| crate::mesh::Vec3::new(p.x, p.y, 2.0 * p.z));
        let exact = 2.0 * PI * PI;
        // Second order in the same number of segments, but of longer triangles.
        assert!((inverted.willmore_energy / exact - 1.0).abs() < 1e-2, "{inverted:?}");
        assert!(stretched.willmore_energy > 1.05 * exact, "{stretched:?}");
    }
}

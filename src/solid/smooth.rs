//! Ellipsoids and tori, triangulated: the vertices lie on the smooth surface.

use std::f64::consts::TAU;

use super::sphere::{self, SphereMesh};
use crate::mesh::{PolygonSoup, Vec3, VertexId};

/// The ellipsoid with the given semi-axes.
pub(super) fn ellipsoid(radii: [f64; 3], resolution: u32) -> PolygonSoup {
    let SphereMesh { directions, triangles } = sphere::subdivided(resolution);
    let points = directions.into_iter().map(|direction| direction.component_mul(&Vec3::from(radii))).collect();
    PolygonSoup::new(points, triangles.into_iter().map(|t| t.map(VertexId).to_vec()).collect())
}

/// The number of segments along the greater circle that makes them about as long as those round the tube.
pub(super) fn torus_segments(major_radius: f64, minor_radius: f64, resolution: u32) -> f64 {
    (f64::from(resolution) * major_radius / minor_radius).ceil()
}

/// The torus about the z-axis: `resolution` segments round the tube, [`torus_segments`] along it.
pub(super) fn torus(major_radius: f64, minor_radius: f64, resolution: u32) -> PolygonSoup {
    let (n, m) = (torus_segments(major_radius, minor_radius, resolution) as u32, resolution);
    let circle = |i: u32, n: u32| (TAU * f64::from(i) / f64::from(n)).sin_cos();
    let point = |i: u32, j: u32| {
        let ((sin, cos), (sin_tube, cos_tube)) = (circle(i, n), circle(j, m));
        let radius = major_radius + minor_radius * cos_tube;
        Vec3::new(radius * cos, radius * sin, minor_radius * sin_tube)
    };
    let points = (0..n * m).map(|index| point(index / m, index % m)).collect();
    let vertex = |i: u32, j: u32| VertexId((i % n) * m + j % m);
    let polygons = (0..n * m)
        .flat_map(|index| {
            let (i, j) = (index / m, index % m);
            let [a, b, c, d] = [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
            [vec![a, b, c], vec![a, c, d]]
        })
        .collect();
    PolygonSoup::new(points, polygons)
}

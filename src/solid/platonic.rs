//! The five Platonic solids, centred at the origin.

use super::polyhedron::Polyhedron;
use crate::mesh::Vec3;

/// The golden ratio.
pub(super) const GOLDEN: f64 = 1.618_033_988_749_895;

/// Vertices (1,1,1), (1,-1,-1), (-1,1,-1), (-1,-1,1).
pub(super) fn tetrahedron() -> Polyhedron {
    let points = vec![
        Vec3::new(1.0, 1.0, 1.0),
        Vec3::new(1.0, -1.0, -1.0),
        Vec3::new(-1.0, 1.0, -1.0),
        Vec3::new(-1.0, -1.0, 1.0),
    ];
    let directions: Vec<Vec3> = points.iter().map(|p| -p).collect();
    Polyhedron::from_face_directions(points, &directions)
}

/// A box of the given edge lengths.
pub(super) fn cuboid(size: [f64; 3]) -> Polyhedron {
    let mut polyhedron = Polyhedron::from_face_directions(cube_corners(), &axes());
    let half = Vec3::from(size) / 2.0;
    polyhedron.points.iter_mut().for_each(|p| p.component_mul_assign(&half));
    polyhedron
}

/// Vertices at distance 1 on the axes.
pub(super) fn octahedron() -> Polyhedron {
    Polyhedron::from_face_directions(axes(), &cube_corners())
}

/// Vertices (+-1, +-1, +-1) and the cyclic permutations of (0, +-g, +-1/g), g the golden ratio.
pub(super) fn dodecahedron() -> Polyhedron {
    Polyhedron::from_face_directions(dodecahedron_corners(), &icosahedron_corners())
}

/// Vertices: the cyclic permutations of (0, +-1, +-g), g the golden ratio.
pub(super) fn icosahedron() -> Polyhedron {
    Polyhedron::from_face_directions(icosahedron_corners(), &dodecahedron_corners())
}

fn axes() -> Vec<Vec3> {
    vec![Vec3::x(), -Vec3::x(), Vec3::y(), -Vec3::y(), Vec3::z(), -Vec3::z()]
}

fn cube_corners() -> Vec<Vec3> {
    let sign = |i: u32, bit: u32| if i >> bit & 1 == 0 { -1.0 } else { 1.0 };
    (0..8).map(|i| Vec3::new(sign(i, 0), sign(i, 1), sign(i, 2))).collect()
}

fn dodecahedron_corners() -> Vec<Vec3> {
    cube_corners().into_iter().chain(rectangles(GOLDEN, 1.0 / GOLDEN)).collect()
}

fn icosahedron_corners() -> Vec<Vec3> {
    rectangles(1.0, GOLDEN)
}

/// The cyclic permutations of (0, +-a, +-b).
fn rectangles(a: f64, b: f64) -> Vec<Vec3> {
    let corners = [(a, b), (-a, b), (a, -b), (-a, -b)];
    corners.iter().flat_map(|&(a, b)| [Vec3::new(0.0, a, b), Vec3::new(b, 0.0, a), Vec3::new(a, b, 0.0)]).collect()
}

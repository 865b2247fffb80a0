//! Prisms, pyramids and bipyramids over a regular polygon with sides of length 1; the axis is z.

use std::f64::consts::{PI, TAU};

use super::polyhedron::Polyhedron;
use crate::mesh::Vec3;

/// The prism between the planes z = -height/2 and z = height/2.
pub(super) fn prism(sides: u32, height: f64) -> Polyhedron {
    let points = [-height / 2.0, height / 2.0].iter().flat_map(|&z| ring(sides, z)).collect();
    let mut faces: Vec<Vec<u32>> = vec![(0..sides).rev().collect(), (sides..2 * sides).collect()];
    faces.extend(steps(sides).map(|(a, b)| vec![a, b, b + sides, a + sides]));
    Polyhedron { points, faces }
}

/// The pyramid with base at z = -height/4 and apex at z = 3 height/4: the centroid is the origin.
pub(super) fn pyramid(sides: u32, height: f64) -> Polyhedron {
    let mut points = ring(sides, -height / 4.0);
    points.push(Vec3::new(0.0, 0.0, 3.0 * height / 4.0));
    let mut faces: Vec<Vec<u32>> = vec![(0..sides).rev().collect()];
    faces.extend(steps(sides).map(|(a, b)| vec![a, b, sides]));
    Polyhedron { points, faces }
}

/// Two pyramids of the given height each on a common base in the plane z = 0.
pub(super) fn bipyramid(sides: u32, height: f64) -> Polyhedron {
    let mut points = ring(sides, 0.0);
    points.extend([Vec3::new(0.0, 0.0, height), Vec3::new(0.0, 0.0, -height)]);
    let faces = steps(sides).flat_map(|(a, b)| [vec![a, b, sides], vec![b, a, sides + 1]]).collect();
    Polyhedron { points, faces }
}

/// The regular polygon at height z, counter-clockwise seen from above.
fn ring(sides: u32, z: f64) -> Vec<Vec3> {
    let radius = 0.5 / (PI / f64::from(sides)).sin();
    (0..sides)
        .map(|i| {
            let (sin, cos) = (TAU * f64::from(i) / f64::from(sides)).sin_cos();
            Vec3::new(radius * cos, radius * sin, z)
        })
        .collect()
}

/// The sides of the polygon, as pairs of its vertices.
fn steps(sides: u32) -> impl Iterator<Item = (u32, u32)> {
    (0..sides).map(move |i| (i, (i + 1) % sides))
}

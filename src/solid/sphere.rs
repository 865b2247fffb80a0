//! Triangulations of the unit sphere.

use std::collections::HashMap;

use super::platonic;
use crate::mesh::Vec3;

/// Directions and triangles, counter-clockwise seen from outside.
pub(super) struct SphereMesh {
    pub(super) directions: Vec<Vec3>,
    pub(super) triangles: Vec<[u32; 3]>,
}

/// Divides each edge of the icosahedron in `resolution` and projects: 20 resolution^2 triangles of similar size.
pub(super) fn subdivided(resolution: u32) -> SphereMesh {
    let icosahedron = platonic::icosahedron();
    let (mut directions, mut triangles) = (Vec::new(), Vec::new());
    // The corners of the icosahedron on which a point depends, with their weights: equal on both sides of an edge,
    // which rounded coordinates need not be.
    let mut index_of: HashMap<[(u32, u32); 3], u32> = HashMap::new();
    for face in &icosahedron.faces {
        let mut vertex = |weights: [u32; 3]| {
            let mut key = [0, 1, 2].map(|i| if weights[i] == 0 { (u32::MAX, 0) } else { (face[i], weights[i]) });
            key.sort_unstable();
            *index_of.entry(key).or_insert_with(|| {
                let corners = key.iter().filter(|corner| corner.1 > 0);
                let sum: Vec3 = corners.map(|&(v, weight)| icosahedron.points[v as usize] * f64::from(weight)).sum();
                directions.push(sum.normalize());
                directions.len() as u32 - 1
            })
        };
        for i in 0..resolution {
            for j in 0..resolution - i {
                let k = resolution - i - j;
                let [a, b, c] = [[k, i, j], [k - 1, i + 1, j], [k - 1, i, j + 1]].map(&mut vertex);
                triangles.push([a, b, c]);
                if k > 1 {
                    triangles.push([b, vertex([k - 2, i + 1, j + 1]), c]);
                }
            }
        }
    }
    SphereMesh { directions, triangles }
}

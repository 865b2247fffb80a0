use std::time::Duration;

use proptest::prelude::*;

use super::*;
use crate::measure::measure;
use crate::mesh::{Mat3, TetMesh};

const MINUTE: Duration = Duration::from_secs(60);

/// The corner star of bounds.md's table (vertex_star_prototype.py): the cone at the origin over the triangle of directions,
/// whose sides have `segments` parts, and the edge opposite each corner exchanged so that no tet is locked. A second cone
/// from a point further out makes the vertices within the triangle interior ones of the mesh.
///
/// Returns the domain, the start of the prototype and the tets of the star.
fn corner_star(directions: [Vec3; 3], axis: Vec3, segments: usize) -> (Domain, Vec<Vec3>, Vec<TetId>) {
    let index = |i: usize, j: usize| (0..i).map(|i| segments + 1 - i).sum::<usize>() + j;
    let mut points = Vec::new();
    let mut on_side = Vec::new();
    let mut bubbles = Vec::new();
    for i in 0..=segments {
        for j in 0..=segments - i {
            let parts = [i, j, segments - i - j].map(|part| part as f64 / segments as f64);
            let sum: Vec3 = parts.iter().zip(&directions).map(|(part, direction)| direction * *part).sum();
            on_side.push(parts.contains(&0.0));
            bubbles.push((27.0 * parts.iter().product::<f64>()).cbrt() / sum.norm());
            points.push(sum.normalize());
        }
    }
    let mut triangles = Vec::new();
    for i in 0..segments {
        for j in 0..segments - i {
            triangles.push([index(i, j), index(i + 1, j), index(i, j + 1)]);
            if i + j + 1 < segments {
                triangles.push([index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)]);
            }
        }
    }
    for corner in [index(0, 0), index(segments, 0), index(0, segments)] {
        let at = triangles.iter().position(|triangle| triangle.contains(&corner)).unwrap();
        let [a, b]: [usize; 2] =
            triangles.remove(at).into_iter().filter(|&v| v != corner).collect::<Vec<_>>().try_into().unwrap();
        let at = triangles.iter().position(|triangle| triangle.contains(&a) && triangle.contains(&b)).unwrap();
        let far = triangles.remove(at).into_iter().find(|&v| v != a && v != b).unwrap();
        triangles.extend([[corner, a, far], [corner, far, b]]);
    }
    let apex = points.len();
    let flatten = Mat3::identity() - axis * axis.transpose();
    let mut image: Vec<Vec3> = points
        .iter()
        .zip(on_side.iter().zip(&bubbles))
        .map(|(p, (side, bubble))| flatten * p - if *side { Vec3::zeros() } else { axis * (0.6 * bubble) })
        .collect();
    // Outwards is away from the axis' sense: the directions point along minus the axis for the cube.
    let outward = directions.iter().sum::<Vec3>().normalize();
    points.extend([Vec3::zeros(), outward * 3.0]);
    image.extend([Vec3::zeros(), -axis * 3.0]);
    let star = triangles.iter().map(|&[a, b, c]| [apex, a, b, c]);
    let far = triangles.iter().map(|&[a, b, c]| [apex + 1, a, b, c]);
    let tets: Vec<[VertexId; 4]> = star.chain(far).map(|tet| tet.map(|v| VertexId(v as u32))).collect();
    let (mesh, _) = TetMesh::from_either_orientation(points, tets).unwrap();
    let tets = (0..triangles.len() as u32).map(TetId).collect();
    (Domain::new(mesh).unwrap(), image, tets)
}

fn cube_corner(segments: usize) -> (Domain, Vec<Vec3>, Vec<TetId>) {
    corner_star([-Vec3::x(), -Vec3::y(), -Vec3::z()], Vec3::repeat(1.0).normalize(), segments)
}

fn tetrahedron_corner(segments: usize) -> (Domain, Vec<Vec3>, Vec<TetId>) {
    let directions = [Vec3::new(0.0, -1.0, -1.0), Vec3::new(-1.0, 0.0, -1.0), Vec3::new(-1.0, -1.0, 0.0)];
    corner_star(directions.map(|d| d.normalize()), Vec3::repeat(1.0).normalize(), segments)
}

fn certified((domain, image, tets): (Domain, Vec<Vec3>, Vec<TetId>)) -> f64 {
    let certificate = search_on(&domain, &image, tets, MINUTE).expect("the start is a map of finite K");
    let level = check(&certificate, &domain, &image).unwrap();
    println!("certified {level}");
    level
}

#[test]
fn corner_stars_reach_the_values_of_the_prototype() {
    // The table of bounds.md, B6, where a conic solver found 6.240, 5.162, 4.867, 4.741 and 16.86, 13.80, 12.94, and the best
    // maps known have 6.851, 5.602, 5.216, 4.912 and 22.49, 17.82, 16.51.
    for (segments, least, best_map) in [(3, 6.2, 6.851), (6, 5.1, 5.602), (8, 4.8, 5.216), (12, 4.7, 4.912)] {
        let level = certified(cube_corner(segments));
        assert!(level >= least && level <= best_map, "{segments}: {level}");
    }
    for (segments, least, best_map) in [(3, 16.8, 22.49), (6, 13.7, 17.82), (8, 12.9, 16.51)] {
        let level = certified(tetrahedron_corner(segments));
        assert!(level >= least && level <= best_map, "{segments}: {level}");
    }
}

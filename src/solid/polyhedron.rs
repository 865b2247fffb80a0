//! Polyhedra with flat convex faces, and their barycentric subdivision.

use std::collections::HashMap;

use crate::mesh::{PolygonSoup, Vec3, VertexId};

/// Points and flat convex faces, counter-clockwise seen from outside.
pub(super) struct Polyhedron {
    pub(super) points: Vec<Vec3>,
    pub(super) faces: Vec<Vec<u32>>,
}

impl Polyhedron {
    /// The convex hull of points, if these are the directions of its faces: a face is the set of the points farthest in
    /// its direction.
    pub(super) fn from_face_directions(points: Vec<Vec3>, directions: &[Vec3]) -> Self {
        let face = |direction: &Vec3| {
            let height = |p: &Vec3| p.dot(direction);
            let top = points.iter().map(height).fold(f64::NEG_INFINITY, f64::max);
            // The generators' points are of order 1 and off by a few rounding errors, next to gaps of order 0.1.
            let mut face: Vec<u32> =
                (0..points.len() as u32).filter(|&v| height(&points[v as usize]) > top - 1e-9).collect();
            let centre = face.iter().map(|&v| points[v as usize]).sum::<Vec3>() / face.len() as f64;
            let first = points[face[0] as usize] - centre;
            let second = direction.cross(&first).normalize() * first.norm();
            let angle = |v: &u32| {
                let p = points[*v as usize] - centre;
                p.dot(&second).atan2(p.dot(&first))
            };
            face.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
            face
        };
        let faces = directions.iter().map(face).collect();
        Self { points, faces }
    }

    /// Cuts each face into the triangles (centroid, corner, edge midpoint), two for each of its edges.
    ///
    /// The shell mesher subdivides triangles regularly; from this start every face keeps its symmetry, and the finer
    /// edges point to the face's corners, where the dilatation is largest.
    ///
    /// Vertices are numbered corners first, then midpoints and centroids as the faces come.
    pub(super) fn barycentric(&self) -> PolygonSoup {
        let mut points = self.points.clone();
        let mut polygons = Vec::new();
        let mut midpoints: HashMap<[u32; 2], u32> = HashMap::new();
        for face in &self.faces {
            let corners = || face.iter().map(|&v| self.points[v as usize]);
            let centre = points.len() as u32;
            points.push(face_centroid(&corners().collect::<Vec<_>>()));
            for (i, &from) in face.iter().enumerate() {
                let to = face[(i + 1) % face.len()];
                let midpoint = *midpoints.entry([from.min(to), from.max(to)]).or_insert_with(|| {
                    points.push((self.points[from as usize] + self.points[to as usize]) / 2.0);
                    points.len() as u32 - 1
                });
                polygons.push([centre, from, midpoint].map(VertexId).to_vec());
                polygons.push([centre, midpoint, to].map(VertexId).to_vec());
            }
        }
        PolygonSoup::new(points, polygons)
    }
}

/// The centroid of a flat convex polygon's area.
fn face_centroid(corners: &[Vec3]) -> Vec3 {
    let (mut moment, mut area) = (Vec3::zeros(), 0.0);
    for pair in corners[1..].windows(2) {
        let triangle = (pair[0] - corners[0]).cross(&(pair[1] - corners[0])).norm();
        area += triangle;
        moment += triangle * ((pair[0] - corners[0]) + (pair[1] - corners[0])) / 3.0;
    }
    corners[0] + moment / area
}

//! Splits that make the boundary of a mesh a full subcomplex, so that no tet is locked.

use std::collections::HashSet;

use super::{Boundary, Subdivision, TetMesh, VertexId};

/// Halves interior edges that join boundary vertices, longest first, then splits interior faces whose vertices are all on
/// the boundary at their centres: then every interior edge and face has a vertex inside. A mesh that needs
/// nothing is left as it is.
///
/// Every tet with four boundary vertices is split, unless it is the whole mesh: what is locked with a fixed boundary
/// becomes free. New vertices lie inside, so the boundary is untouched.
pub fn full_boundary(mesh: &TetMesh, boundary: &Boundary) -> Subdivision {
    let on_boundary = |v: VertexId| boundary.vertex_mask().get(v.index()).is_some_and(|&on| on);
    let edges: HashSet<[VertexId; 2]> =
        boundary.triangles().iter().flat_map(|t| [[0, 1], [1, 2], [2, 0]].map(|e| sorted(e.map(|i| t[i])))).collect();
    let faces: HashSet<[VertexId; 3]> = boundary.triangles().iter().map(|&t| sorted(t)).collect();
    let mut splits = Subdivision::of(mesh);
    splits.split_edges(|edge| edge.iter().all(|&v| on_boundary(v)) && !edges.contains(&edge));
    splits.split_faces(|face| face.iter().all(|&v| on_boundary(v)) && !faces.contains(&face));
    splits
}

fn sorted<const N: usize>(mut simplex: [VertexId; N]) -> [VertexId; N] {
    simplex.sort_unstable();
    simplex
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Vec3;

    fn split(points: Vec<Vec3>, tets: &[[u32; 4]]) -> (TetMesh, Subdivision, TetMesh) {
        let tets = tets.iter().map(|t| t.map(VertexId)).collect();
        let mesh = TetMesh::from_either_orientation(points, tets).unwrap().0;
        let boundary = Boundary::of(&mesh).unwrap();
        let full = full_boundary(&mesh, &boundary);
        let split = full.mesh().unwrap();
        (mesh, full, split)
    }

    fn volume(mesh: &TetMesh) -> f64 {
        (0..mesh.tets().len() as u32)
            .map(|t| {
                let [a, b, c, d] = mesh.corners(crate::mesh::TetId(t));
                (b - a).cross(&(c - a)).dot(&(d - a)) / 6.0
            })
            .sum()
    }

    #[test]
    fn a_shared_face_is_split_at_its_centre() {
        let points = vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z(), Vec3::new(0.6, 0.7, 0.8)];
        let (mesh, full, split) = split(points, &[[0, 1, 2, 3], [1, 2, 3, 4]]);
        assert_eq!((full.edge_splits(), full.face_splits(), split.tets().len()), (0, 1, 6));
        assert!((volume(&split) - volume(&mesh)).abs() < 1e-15);
        assert_eq!(Boundary::of(&split).unwrap().triangles().len(), 6);
    }

    #[test]
    fn every_tet_of_a_cut_cube_is_freed() {
        // Kuhn's six tets round the diagonal 0-7: one interior edge, all vertices on the boundary.
        let points = (0..8).map(|i| Vec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64)).collect();
        let tets = [[0, 1, 3, 7], [0, 1, 5, 7], [0, 2, 3, 7], [0, 2, 6, 7], [0, 4, 5, 7], [0, 4, 6, 7]];
        let (mesh, full, split) = split(points, &tets);
        let boundary = Boundary::of(&split).unwrap();
        assert_eq!(boundary.triangles().len(), 12);
        assert_eq!((full.edge_splits(), split.tets().len()), (1, 12));
        assert!(split.tets().iter().all(|tet| tet.iter().any(|&v| !boundary.contains(v))));
        assert!((volume(&split) - 1.0).abs() < 1e-15);
        boundary.check_ball(&split).unwrap();
        assert_eq!(full_boundary(&split, &boundary), Subdivision::of(&split));
        let doubled = full.extend(mesh.points().iter().map(|p| p * 2.0).collect());
        assert!(doubled.iter().zip(split.points()).all(|(a, b)| (a - b * 2.0).norm() < 1e-15));
    }
}

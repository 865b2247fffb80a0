//! A collar: splits next to the boundary, where one interior vertex is the apex over several boundary faces.

use super::{Boundary, Subdivision, TetMesh, VertexId};

/// Halves the edges that join a boundary vertex to an interior one that is the apex over two or more boundary faces, longest
/// first, as long as there are at most `most_tets` tets.
///
/// The tets over boundary faces that share their apex can be given no shape each of their own: the largest K of maps with fixed
/// boundary values, and what is proved of it, sit there on nearly every solid that is not star-shaped. Halves of their edges give
/// each face vertices of its own. The boundary is untouched.
pub fn collar(mesh: &TetMesh, boundary: &Boundary, most_tets: usize) -> Subdivision {
    let on_boundary = |v: VertexId| boundary.contains(v);
    let mut faces_over = vec![0u32; mesh.points().len()];
    for tet in mesh.tets() {
        let mut inside = tet.iter().filter(|&&v| !on_boundary(v));
        if let (Some(apex), None) = (inside.next(), inside.next()) {
            faces_over[apex.index()] += 1;
        }
    }
    // New vertices are no apexes yet.
    let is_apex = |v: VertexId| faces_over.get(v.index()).is_some_and(|&count| count > 1);
    let is_old_boundary = |v: VertexId| v.index() < mesh.points().len() && on_boundary(v);
    let mut splits = Subdivision::of(mesh);
    splits.split_edges_within(most_tets, |[a, b]| is_apex(a) && is_old_boundary(b) || is_apex(b) && is_old_boundary(a));
    splits
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{TetId, Vec3, edge_matrix};

    /// An octahedron about its centre, the apex over all eight faces.
    fn octahedron() -> (TetMesh, Boundary) {
        let axes = [Vec3::x(), Vec3::y(), Vec3::z()];
        let points = [vec![Vec3::zeros()], axes.to_vec(), axes.map(|axis| -2.0 * axis).to_vec()].concat();
        let tets = (0..8).map(|i| [0, 1 + 3 * (i & 1), 2 + 3 * (i >> 1 & 1), 3 + 3 * (i >> 2)].map(VertexId)).collect();
        let mesh = TetMesh::from_either_orientation(points, tets).unwrap().0;
        let boundary = Boundary::of(&mesh).unwrap();
        (mesh, boundary)
    }

    #[test]
    fn every_edge_of_a_common_apex_is_halved_within_the_budget() {
        let (mesh, boundary) = octahedron();
        let whole = collar(&mesh, &boundary, usize::MAX);
        // Each of the six edges to the boundary once; the halves that remain join the apex to new vertices.
        assert_eq!((whole.edge_splits(), whole.face_splits()), (6, 0));
        let split = whole.mesh().unwrap();
        let volume = |mesh: &TetMesh| -> f64 {
            (0..mesh.tets().len() as u32).map(|t| edge_matrix(mesh.corners(TetId(t))).determinant() / 6.0).sum()
        };
        assert!((volume(&split) - volume(&mesh)).abs() < 1e-14);
        assert_eq!(Boundary::of(&split).unwrap().triangles().len(), 8);
        for most in 0..split.tets().len() {
            let some = collar(&mesh, &boundary, most);
            assert!(some.mesh().unwrap().tets().len() <= most.max(8));
            assert!(some.edge_splits() < 6);
        }
        assert_eq!(collar(&mesh, &boundary, split.tets().len()), whole);
    }
}

//! The features of a boundary that a report names: corners, sharp edges, flat faces, and whether it is convex.

use std::f64::consts::{PI, TAU};

use super::boundary::DisjointSets;
use super::{Boundary, BoundaryEdges, TetMesh, VertexId};

/// Deviation from flatness, in radians, from which an edge (dihedral angle against pi) counts as sharp and a vertex
/// (angle defect against 0) as a corner: 30 degrees.
///
/// Evidence: the bluntest Platonic edge, the icosahedron's, deviates by 41.8 degrees and the bluntest Platonic corner,
/// the dodecahedron's, has a defect of 36 degrees; a sphere cut into 300 triangles has edges that deviate by about 13
/// degrees and vertices with a defect of 5.
pub const SHARP: f64 = PI / 6.0;

/// Deviation from a straight dihedral angle, in radians, up to which two triangles count as one flat face: coordinates
/// written with 9 digits turn a triangle of a tenth of the solid's size by about 1e-8.
const FLAT: f64 = 1e-7;

/// Corners, sharp edges and flat faces of the boundary of a domain.
#[derive(Clone, Debug, PartialEq)]
pub struct Features {
    sharp_edges: Vec<bool>,
    corners: Vec<bool>,
    flat_faces: usize,
    convex: bool,
}

impl Features {
    /// Classifies the boundary's edges and vertices.
    ///
    /// An edge is sharp where the dihedral angle differs from pi by more than 30 degrees. A vertex is a corner where
    /// three or more sharp edges meet, or where its angle defect (2 pi minus the sum of the boundary triangles' angles
    /// there; 0 in flat faces and on straight edges, whatever their dihedral angle) exceeds 30 degrees in size, as at
    /// the tip of a finely triangulated cone.
    pub fn of(mesh: &TetMesh, boundary: &Boundary, edges: &BoundaryEdges) -> Self {
        let deviations: Vec<f64> = edges.edges().iter().map(|edge| edge.angle().value() - PI).collect();
        let sharp_edges: Vec<bool> = deviations.iter().map(|deviation| deviation.abs() > SHARP).collect();

        let mut sharp_at = vec![0; mesh.points().len()];
        let mut faces = DisjointSets::new(boundary.triangles().len());
        for ((edge, &sharp), deviation) in edges.edges().iter().zip(&sharp_edges).zip(&deviations) {
            if sharp {
                edge.ends.iter().for_each(|v| sharp_at[v.index()] += 1);
            }
            if deviation.abs() <= FLAT {
                faces.join(edge.triangles[0].0, edge.triangles[1].0);
            }
        }
        let mut angle_sum = vec![0.0; mesh.points().len()];
        for triangle in boundary.triangles() {
            for i in 0..3 {
                let [a, b, c] = [0, 1, 2].map(|j| mesh.points()[triangle[(i + j) % 3].index()]);
                angle_sum[triangle[i].index()] += (b - a).angle(&(c - a));
            }
        }
        let corners = (0..mesh.points().len())
            .map(|v| boundary.vertex_mask()[v] && (sharp_at[v] >= 3 || (TAU - angle_sum[v]).abs() > SHARP))
            .collect();
        let convex = edges.left_out().is_empty() && deviations.iter().all(|&deviation| deviation <= FLAT);
        Self { sharp_edges, corners, flat_faces: faces.count(), convex }
    }

    /// For each entry of [`BoundaryEdges::edges`], whether it is sharp.
    pub fn sharp_edges(&self) -> &[bool] {
        &self.sharp_edges
    }

    /// Whether a vertex is a corner of the boundary.
    pub fn is_corner(&self, vertex: VertexId) -> bool {
        self.corners[vertex.index()]
    }

    /// The number of flat faces: sets of triangles joined through edges that are straight within 1e-7 radians.
    pub fn flat_faces(&self) -> usize {
        self.flat_faces
    }

    /// Whether no dihedral angle exceeds pi (by more than 1e-7 radians): a closed surface that bounds a ball and is
    /// convex at every edge bounds a convex polyhedron (Tietze and Nakajima 1928).
    pub fn is_convex(&self) -> bool {
        self.convex
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Vec3;
    use crate::mesh::fixtures::{Polyhedron, cube, fan, hull};

    fn features(solid: &Polyhedron) -> Features {
        let mesh = fan(solid, Vec3::zeros());
        let boundary = Boundary::of(&mesh).unwrap();
        Features::of(&mesh, &boundary, &BoundaryEdges::of(&mesh, &boundary))
    }

    #[test]
    fn the_cube_has_8_corners_12_sharp_edges_6_faces() {
        let cube = features(&cube());
        assert_eq!((0..9).filter(|&v| cube.is_corner(VertexId(v))).count(), 8);
        assert_eq!(cube.sharp_edges().iter().filter(|&&sharp| sharp).count(), 12);
        assert_eq!(cube.flat_faces(), 6);
        assert!(cube.is_convex());
    }

    #[test]
    fn a_dented_cube_is_not_convex() {
        let mut solid = cube();
        solid.0[7] *= 0.5;
        assert!(!features(&solid).is_convex());
    }

    #[test]
    fn the_tip_of_a_fine_cone_is_a_corner_without_sharp_edges() {
        let rim = (0..40).map(|i| f64::from(i) * TAU / 40.0).map(|t| Vec3::new(t.cos(), t.sin(), -0.3));
        let cone = hull(std::iter::once(Vec3::new(0.0, 0.0, 1.0)).chain(rim).collect());
        let cone = features(&cone);
        assert!(cone.is_corner(VertexId(0)));
        // The rim is one sharp edge: two sharp edges a vertex, no corner.
        assert!((1..41).all(|v| !cone.is_corner(VertexId(v))));
        assert_eq!(cone.sharp_edges().iter().filter(|&&sharp| sharp).count(), 40);
    }
}

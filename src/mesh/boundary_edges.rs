//! The edges of the boundary of a mesh, with the tets around them and the angles there.

use super::angle::{Angle, dihedral_angle, tet_dihedral_angle};
use super::{Boundary, TetId, TetMesh, TriangleId, Vec3, VertexId};

/// An edge in which exactly two boundary triangles meet.
#[derive(Clone, Debug, PartialEq)]
pub struct BoundaryEdge {
    /// Its ends, the lower index first.
    pub ends: [VertexId; 2],
    /// The two boundary triangles; the first has the edge in the direction of `ends`, the second against it.
    pub triangles: [TriangleId; 2],
    /// The third corner of each of the two triangles.
    pub opposite: [VertexId; 2],
    /// The tets around the edge, by index, each with its dihedral angle there.
    pub fan: Vec<(TetId, Angle)>,
}

impl BoundaryEdge {
    /// The interior dihedral angle of the domain: the sum over the fan, in `(0, 2 pi)` for an embedded mesh.
    pub fn angle(&self) -> Angle {
        self.fan.iter().map(|&(_, angle)| angle).sum()
    }

    /// The interior dihedral angle between the images of the two boundary triangles, in `(0, 2 pi)`.
    ///
    /// For every piecewise-linear map with these boundary positions and positive determinants, the dihedral angles of
    /// the fan's images sum to this angle plus a whole number >= 0 of turns (0 if the map is injective at the edge).
    /// `None` where a triangle is degenerate or the two are folded onto each other, so that rounding cannot tell 0 from
    /// a whole turn.
    pub fn image_angle(&self, image: &[Vec3]) -> Option<Angle> {
        let at = |v: VertexId| &image[v.index()];
        // Seen along the edge's direction the solid lies clockwise of the first triangle.
        let angle = dihedral_angle(self.ends.map(at), at(self.opposite[1]), at(self.opposite[0]));
        // The nearest f64 to a whole turn is below it.
        (angle.lower() > 0.0 && angle.upper() < std::f64::consts::TAU).then_some(angle)
    }
}

/// All edges of the boundary at which it is a manifold, sorted by their ends.
///
/// Edges in which the number of boundary triangles is not two (possible only in meshes that are not balls) are left out.
#[derive(Clone, Debug, PartialEq)]
pub struct BoundaryEdges {
    edges: Vec<BoundaryEdge>,
    left_out: Vec<[VertexId; 2]>,
}

impl BoundaryEdges {
    /// Collects edges and fans; the order of the result depends on vertex and tet numbers only.
    pub fn of(mesh: &TetMesh, boundary: &Boundary) -> Self {
        let mut sides = Vec::with_capacity(3 * boundary.triangles().len());
        for (index, triangle) in (0..).zip(boundary.triangles()) {
            for i in 0..3 {
                let (from, to, opposite) = (triangle[i], triangle[(i + 1) % 3], triangle[(i + 2) % 3]);
                sides.push(([from.min(to), from.max(to)], from > to, TriangleId(index), opposite));
            }
        }
        sides.sort_unstable();
        let (mut edges, mut left_out) = (Vec::with_capacity(sides.len() / 2), Vec::new());
        for group in sides.chunk_by(|a, b| a.0 == b.0) {
            match group {
                [forward, backward] if !forward.1 && backward.1 => edges.push(BoundaryEdge {
                    ends: forward.0,
                    triangles: [forward.2, backward.2],
                    opposite: [forward.3, backward.3],
                    fan: Vec::new(),
                }),
                _ => left_out.push(group[0].0),
            }
        }
        let mut result = Self { edges, left_out };
        result.fill_fans(mesh, boundary);
        result
    }

    fn fill_fans(&mut self, mesh: &TetMesh, boundary: &Boundary) {
        /// The six edges of a tet, each with the two vertices that are not on it.
        const EDGES: [[usize; 4]; 6] =
            [[0, 1, 2, 3], [0, 2, 1, 3], [0, 3, 1, 2], [1, 2, 0, 3], [1, 3, 0, 2], [2, 3, 0, 1]];
        let at = |v: VertexId| &mesh.points()[v.index()];
        for (index, tet) in (0..).zip(mesh.tets()) {
            for [a, b, c, d] in EDGES.map(|edge| edge.map(|i| tet[i])) {
                if !(boundary.contains(a) && boundary.contains(b)) {
                    continue;
                }
                if let Some(position) = self.position([a, b]) {
                    let angle = tet_dihedral_angle([at(a), at(b)], at(c), at(d));
                    self.edges[position].fan.push((TetId(index), angle));
                }
            }
        }
    }

    /// The edges, sorted by their ends.
    pub fn edges(&self) -> &[BoundaryEdge] {
        &self.edges
    }

    /// The ends of the edges at which the boundary is not a manifold.
    pub fn left_out(&self) -> &[[VertexId; 2]] {
        &self.left_out
    }

    /// Where in [`BoundaryEdges::edges`] the edge between two vertices stands, if it is a boundary edge.
    pub fn position(&self, [a, b]: [VertexId; 2]) -> Option<usize> {
        self.edges.binary_search_by_key(&[a.min(b), a.max(b)], |edge| edge.ends).ok()
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI};

    use super::*;
    use crate::mesh::fixtures::{cube, fan};

    /// Up to the rounding of the expected angle.
    fn contains(angle: Angle, expected: f64) -> bool {
        angle.lower() <= expected * (1.0 + f64::EPSILON) && expected * (1.0 - f64::EPSILON) <= angle.upper()
    }

    fn meet(a: Angle, b: Angle) -> bool {
        a.lower() <= b.upper() && b.lower() <= a.upper()
    }

    #[test]
    fn the_cube_has_right_angles_and_flat_diagonals_inside_and_in_its_image() {
        let mesh = fan(&cube(), Vec3::new(0.1, 0.2, -0.3));
        let edges = BoundaryEdges::of(&mesh, &Boundary::of(&mesh).unwrap());
        assert_eq!((edges.edges().len(), edges.left_out().len()), (18, 0));
        let flat = edges.edges().iter().filter(|edge| contains(edge.angle(), PI)).count();
        let right = edges.edges().iter().filter(|edge| contains(edge.angle(), FRAC_PI_2));
        assert_eq!((flat, right.count()), (6, 12));
        for edge in edges.edges() {
            let image = edge.image_angle(mesh.points()).unwrap();
            assert!(meet(image, edge.angle()));
            assert_eq!(edge.fan.len(), 2);
        }
    }

    #[test]
    fn a_concave_edge_has_more_than_a_straight_angle() {
        // Pushing one corner of the cube inwards makes the flat diagonals through its neighbours concave.
        let mut solid = cube();
        solid.0[7] *= 0.5;
        let mesh = fan(&solid, Vec3::zeros());
        let edges = BoundaryEdges::of(&mesh, &Boundary::of(&mesh).unwrap());
        let concave = edges.edges().iter().filter(|edge| edge.angle().lower() > PI).count();
        assert!(concave > 0);
        for edge in edges.edges() {
            let image = edge.image_angle(mesh.points()).unwrap();
            assert!(meet(image, edge.angle()));
        }
    }

    #[test]
    fn folded_and_degenerate_images_have_no_angle() {
        let mesh = fan(&cube(), Vec3::zeros());
        let edges = BoundaryEdges::of(&mesh, &Boundary::of(&mesh).unwrap());
        let collapsed = vec![Vec3::x(); mesh.points().len()];
        let folded: Vec<Vec3> = mesh.points().iter().map(|p| Vec3::new(p.x, p.y, 0.0)).collect();
        for edge in edges.edges() {
            assert_eq!(edge.image_angle(&collapsed), None);
            let flat = edge.image_angle(&folded);
            assert!(flat.is_none_or(|angle| contains(angle, PI)));
        }
    }
}

//! Points and tets, all of positive volume.

use super::{Mat3, TetId, Unit, Vec3, VertexId};

/// Why points and tets are not a mesh.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// No tetrahedron at all.
    #[error("the mesh has no tetrahedra")]
    Empty,
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} has a coordinate that is not finite")]
    NotFinite {
        /// The vertex, counted from 0.
        vertex: u32,
    },
    /// A tet names a vertex that does not exist.
    #[error("tet {tet} names vertex {vertex}, but there are only {count} vertices (counted from 0)")]
    VertexOutOfRange {
        /// The tet, counted from 0.
        tet: u32,
        /// The vertex it names.
        vertex: u64,
        /// How many vertices there are.
        count: usize,
    },
    /// A tet names one vertex twice.
    #[error("tet {tet} names vertex {vertex} twice; remove it, or export the mesh again")]
    RepeatedVertex {
        /// The tet, counted from 0.
        tet: u32,
        /// The vertex named twice.
        vertex: u32,
    },
    /// A tet of the domain is flat.
    #[error("tet {tet} has zero volume: its four vertices lie in one plane; repair or remove it")]
    Flat {
        /// The tet, counted from 0.
        tet: u32,
    },
    /// A tet of the domain is inside out.
    #[error("tet {tet} has negative volume: exchange two of its vertices")]
    Negative {
        /// The tet, counted from 0.
        tet: u32,
    },
}

/// The sign of a tetrahedron's volume, decided exactly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Orientation {
    /// det(x1 - x0, x2 - x0, x3 - x0) > 0.
    Positive,
    /// The four points are coplanar.
    Flat,
    /// The determinant is negative: a flipped tet, if in an image.
    Negative,
}

/// The sign of det(b - a, c - a, d - a), exact by Shewchuk's adaptive predicate.
///
/// Coordinates must be finite. Underflow below about 1e-300 in the products is outside the predicate's guarantee.
pub fn orientation([a, b, c, d]: [&Vec3; 4]) -> Orientation {
    let coord = |p: &Vec3| robust::Coord3D { x: p.x, y: p.y, z: p.z };
    // robust's orient3d is positive where d lies below the plane abc seen counter-clockwise, hence the exchange.
    let sign = robust::orient3d(coord(a), coord(c), coord(b), coord(d));
    if sign > 0.0 {
        Orientation::Positive
    } else if sign < 0.0 {
        Orientation::Negative
    } else {
        Orientation::Flat
    }
}

/// A tetrahedral mesh: every index in range, no vertex twice in a tet, every volume positive by exact predicate.
///
/// Local numbering: seen from vertex 3, the vertices 0, 1, 2 run clockwise, so that
/// `det(x1 - x0, x2 - x0, x3 - x0) / 6` (paper eq. 24) is the positive volume. This is the order of VTK and Gmsh.
///
/// ```text
///          3
///         /|\
///        / | \        face opposite 0: 1 2 3      face opposite 1: 0 3 2
///       /  |  \       face opposite 2: 0 1 3      face opposite 3: 0 2 1
///      0 - | - 2      (each counter-clockwise seen from outside)
///       \  |  /
///        \ | /
///          1
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct TetMesh {
    points: Vec<Vec3>,
    tets: Vec<[VertexId; 4]>,
}

impl TetMesh {
    /// The faces of a tet as local vertex numbers, face `i` opposite vertex `i`, counter-clockwise seen from outside.
    pub const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

    /// Takes points and tets that must already be positively oriented.
    ///
    /// # Errors
    /// The first tet or vertex that breaks the type's invariant.
    pub fn new(points: Vec<Vec3>, tets: Vec<[VertexId; 4]>) -> Result<Self, MeshError> {
        check_indices(&points, &tets)?;
        for (index, tet) in tets.iter().enumerate() {
            match orientation(tet.map(|v| &points[v.index()])) {
                Orientation::Positive => {}
                Orientation::Flat => return Err(MeshError::Flat { tet: index as u32 }),
                Orientation::Negative => return Err(MeshError::Negative { tet: index as u32 }),
            }
        }
        Ok(Self { points, tets })
    }

    /// Takes points and tets of either orientation; a negative tet has its last two vertices exchanged.
    ///
    /// Returns how many tets were exchanged, for the caller to tell: tools differ in their convention.
    ///
    /// # Errors
    /// As [`TetMesh::new`], except for negative tets.
    pub fn from_either_orientation(
        points: Vec<Vec3>,
        mut tets: Vec<[VertexId; 4]>,
    ) -> Result<(Self, usize), MeshError> {
        check_indices(&points, &tets)?;
        let mut exchanged = 0;
        for (index, tet) in tets.iter_mut().enumerate() {
            match orientation(tet.map(|v| &points[v.index()])) {
                Orientation::Positive => {}
                Orientation::Flat => return Err(MeshError::Flat { tet: index as u32 }),
                Orientation::Negative => {
                    tet.swap(2, 3);
                    exchanged += 1;
                }
            }
        }
        Ok((Self { points, tets }, exchanged))
    }

    /// The same mesh with lengths counted in another unit.
    pub fn in_unit(&self, unit: Unit) -> Self {
        Self { points: unit.take_points(&self.points), tets: self.tets.clone() }
    }

    /// Vertex positions, indexed by [`VertexId`].
    pub fn points(&self) -> &[Vec3] {
        &self.points
    }

    /// Tets, indexed by [`TetId`].
    pub fn tets(&self) -> &[[VertexId; 4]] {
        &self.tets
    }

    /// The four corner positions of a tet.
    pub fn corners(&self, tet: TetId) -> [Vec3; 4] {
        self.tets[tet.index()].map(|v| self.points[v.index()])
    }
}

fn check_indices(points: &[Vec3], tets: &[[VertexId; 4]]) -> Result<(), MeshError> {
    if tets.is_empty() {
        return Err(MeshError::Empty);
    }
    if let Some(vertex) = points.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
        return Err(MeshError::NotFinite { vertex: vertex as u32 });
    }
    for (index, tet) in tets.iter().enumerate() {
        for (i, v) in tet.iter().enumerate() {
            if v.index() >= points.len() {
                return Err(MeshError::VertexOutOfRange { tet: index as u32, vertex: v.0.into(), count: points.len() });
            }
            if tet[..i].contains(v) {
                return Err(MeshError::RepeatedVertex { tet: index as u32, vertex: v.0 });
            }
        }
    }
    Ok(())
}

/// The edges `[x1 - x0, x2 - x0, x3 - x0]` of a tet as columns; its determinant is six times the tet's signed volume.
pub fn edge_matrix([x0, x1, x2, x3]: [Vec3; 4]) -> Mat3 {
    Mat3::from_columns(&[x1 - x0, x2 - x0, x3 - x0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orientation_has_the_sign_of_the_determinant() {
        let unit = [Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z()];
        let refs = |p: &[Vec3; 4]| orientation([&p[0], &p[1], &p[2], &p[3]]);
        assert_eq!(refs(&unit), Orientation::Positive);
        assert_eq!(refs(&[unit[0], unit[2], unit[1], unit[3]]), Orientation::Negative);
        // Exactness: a height far below the rounding of the naive determinant.
        let thin = |height: f64| {
            let far = Vec3::new(1e10, 1e10, 0.0);
            [far, far + Vec3::x(), far + Vec3::y(), far + Vec3::new(0.3, 0.3, height)]
        };
        assert_eq!(refs(&thin(1e-200)), Orientation::Positive);
        assert_eq!(refs(&thin(-1e-200)), Orientation::Negative);
        assert_eq!(refs(&thin(0.0)), Orientation::Flat);
    }

    #[test]
    fn faces_point_outward() {
        let mesh = TetMesh::new(vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z()], vec![[0, 1, 2, 3].map(VertexId)])
            .unwrap();
        let corners = mesh.corners(TetId(0));
        for (opposite, face) in TetMesh::FACES.iter().enumerate() {
            let [a, b, c] = face.map(|i| corners[i]);
            assert!((b - a).cross(&(c - a)).dot(&(a - corners[opposite])) > 0.0);
        }
    }

    #[test]
    fn bad_tets_are_named() {
        let points = vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z(), Vec3::new(1.0, 1.0, 0.0)];
        let build = |tet: [u32; 4]| TetMesh::new(points.clone(), vec![[0, 1, 2, 3].map(VertexId), tet.map(VertexId)]);
        assert_eq!(build([0, 1, 2, 9]), Err(MeshError::VertexOutOfRange { tet: 1, vertex: 9, count: 5 }));
        assert_eq!(build([0, 1, 1, 3]), Err(MeshError::RepeatedVertex { tet: 1, vertex: 1 }));
        assert_eq!(build([0, 1, 2, 4]), Err(MeshError::Flat { tet: 1 }));
        assert_eq!(build([0, 2, 1, 3]), Err(MeshError::Negative { tet: 1 }));
        assert_eq!(TetMesh::new(points.clone(), vec![]), Err(MeshError::Empty));
    }
}

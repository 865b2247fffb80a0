//! Hexahedral meshes of axis-parallel boxes of several sizes.

use super::{Vec3, VertexId};

/// Why points and cells are not a mesh of boxes. Numbers count from 0.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum VoxelMeshError {
    /// No cell at all.
    #[error("the mesh has no cells")]
    Empty,
    /// A cell names a vertex that does not exist.
    #[error("cell {cell} names vertex {vertex}, but there are only {count} vertices (counted from 0)")]
    VertexOutOfRange {
        /// The cell.
        cell: usize,
        /// The vertex it names.
        vertex: u32,
        /// How many vertices there are.
        count: usize,
    },
    /// The corners of a cell are not those of a box of positive size, in binary order.
    #[error("cell {cell} is no axis-parallel box with its corners in binary order")]
    NoBox {
        /// The cell.
        cell: usize,
    },
}

/// A mesh of axis-parallel boxes, each of positive size; neighbours may differ in size (a corner of a small one then lies
/// in the middle of an edge or face of a large one: a hanging node).
///
/// Local numbering: corner `i` lies on the upper side in x, y, z as bits 0, 1, 2 of `i` say (paper §3).
///
/// ```text
///        6 ------ 7
///       /|       /|        z
///      4 ------ 5 |        |  y
///      | 2 -----|-3        | /
///      |/       |/         |/
///      0 ------ 1          0 --- x
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct VoxelMesh {
    points: Vec<Vec3>,
    cells: Vec<[VertexId; 8]>,
}

impl VoxelMesh {
    /// Takes points and boxes.
    ///
    /// # Errors
    /// The first cell that is no box.
    pub fn new(points: Vec<Vec3>, cells: Vec<[VertexId; 8]>) -> Result<Self, VoxelMeshError> {
        if cells.is_empty() {
            return Err(VoxelMeshError::Empty);
        }
        for (index, cell) in cells.iter().enumerate() {
            if let Some(v) = cell.iter().find(|v| v.index() >= points.len()) {
                return Err(VoxelMeshError::VertexOutOfRange { cell: index, vertex: v.0, count: points.len() });
            }
            let corners = cell.map(|v| points[v.index()]);
            let (low, high) = (corners[0], corners[7]);
            let is_box = (0..3).all(|axis| low[axis] < high[axis] && high[axis].is_finite() && low[axis].is_finite())
                && (0..8)
                    .all(|i| (0..3).all(|axis| corners[i][axis] == if i >> axis & 1 == 0 { low } else { high }[axis]));
            if !is_box {
                return Err(VoxelMeshError::NoBox { cell: index });
            }
        }
        Ok(Self { points, cells })
    }

    /// Vertex positions, indexed by [`VertexId`].
    pub fn points(&self) -> &[Vec3] {
        &self.points
    }

    /// The boxes, corners in binary order.
    pub fn cells(&self) -> &[[VertexId; 8]] {
        &self.cells
    }

    /// The volume of all boxes together.
    pub fn volume(&self) -> f64 {
        self.cells.iter().map(|cell| (self.points[cell[7].index()] - self.points[cell[0].index()]).product()).sum()
    }

    /// The volume of the largest box.
    pub fn largest_volume(&self) -> f64 {
        let volumes =
            self.cells.iter().map(|cell| (self.points[cell[7].index()] - self.points[cell[0].index()]).product());
        volumes.fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_are_taken_and_anything_else_is_named() {
        let corner = |i: usize| Vec3::new((i & 1) as f64, 2.0 * (i >> 1 & 1) as f64, 0.5 * (i >> 2) as f64);
        let points: Vec<Vec3> = (0..8).map(corner).collect();
        let cell = std::array::from_fn(|i| VertexId(i as u32));
        let mesh = VoxelMesh::new(points.clone(), vec![cell]).unwrap();
        assert_eq!((mesh.volume(), mesh.largest_volume()), (1.0, 1.0));
        assert_eq!(VoxelMesh::new(points.clone(), vec![]), Err(VoxelMeshError::Empty));
        let mut other = cell;
        other[3] = VertexId(8);
        let out_of_range = VoxelMeshError::VertexOutOfRange { cell: 1, vertex: 8, count: 8 };
        assert_eq!(VoxelMesh::new(points.clone(), vec![cell, other]), Err(out_of_range));
        // VTK's order of a hexahedron's corners is another one.
        other = cell;
        other.swap(2, 3);
        assert_eq!(VoxelMesh::new(points.clone(), vec![other]), Err(VoxelMeshError::NoBox { cell: 0 }));
        let mut bent = points;
        bent[7].x += 1e-9;
        assert_eq!(VoxelMesh::new(bent, vec![cell]), Err(VoxelMeshError::NoBox { cell: 0 }));
    }
}

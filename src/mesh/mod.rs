//! Tetrahedral meshes, meshes of boxes, the polygon soups that surface files hold, their topology and their files.

pub mod angle;
mod boundary;
mod boundary_edges;
mod cells;
mod collar;
mod features;
#[cfg(test)]
pub(crate) mod fixtures;
mod flip;
mod full_boundary;
#[cfg(feature = "files")]
pub mod io;
mod mirrors;
mod place;
mod quality;
mod soup;
mod subdivision;
mod tet_mesh;
mod unit;
mod view;
mod voxel_mesh;

pub(crate) use boundary::DisjointSets;
pub use boundary::{Boundary, TopologyError};
pub use boundary_edges::{BoundaryEdge, BoundaryEdges};
pub use cells::Cells;
pub use collar::collar;
pub use features::{Features, SHARP};
pub(crate) use flip::Flipping;
pub use flip::{ChangeError, Flips, MeshChanges};
pub use full_boundary::full_boundary;
pub use mirrors::Mirrors;
pub use place::Place;
pub use quality::{Sliver, slivers, smallest_dihedral_angle};
pub use soup::{PolygonSoup, TetSoup};
pub use subdivision::Subdivision;
pub use tet_mesh::{MeshError, Orientation, TetMesh, edge_matrix, orientation};
pub use unit::Unit;
pub(crate) use view::View;
pub use voxel_mesh::{VoxelMesh, VoxelMeshError};

use serde::{Deserialize, Serialize};

pub use crate::linalg::{Mat3, Vec3};

/// Index of a vertex, counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct VertexId(pub u32);

/// Index of a tetrahedron, counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct TetId(pub u32);

/// Index of a triangle of a surface, counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct TriangleId(pub u32);

impl VertexId {
    /// The position in a vector that holds one entry a vertex.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

impl TetId {
    /// The position in a vector that holds one entry a tet.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

impl TriangleId {
    /// The position in a vector that holds one entry a triangle.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

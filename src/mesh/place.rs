//! Places in a domain, as reports name them.

use serde::{Deserialize, Serialize};

use super::{TetMesh, VertexId};

/// The place where a bound is attained or cells are active.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum Place {
    /// A vertex of the domain.
    Vertex {
        /// Its index, counted from 0.
        vertex: u32,
        /// Its position in the domain.
        position: [f64; 3],
    },
    /// An edge of the domain between two vertices.
    Edge {
        /// Its ends, counted from 0.
        vertices: [u32; 2],
        /// Its midpoint in the domain.
        midpoint: [f64; 3],
    },
    /// A triangle of the domain: of the boundary, or an interior one whose corners are all on the boundary.
    Face {
        /// Its corners, counted from 0.
        vertices: [u32; 3],
        /// Its centroid in the domain.
        centroid: [f64; 3],
    },
}

impl Place {
    /// The place of a vertex of `mesh`.
    pub fn vertex(mesh: &TetMesh, vertex: VertexId) -> Self {
        Self::Vertex { vertex: vertex.0, position: middle(mesh, [vertex]) }
    }

    /// The place of an edge of `mesh`.
    pub fn edge(mesh: &TetMesh, ends: [VertexId; 2]) -> Self {
        Self::Edge { vertices: ends.map(|v| v.0), midpoint: middle(mesh, ends) }
    }

    /// The place of a triangle of `mesh`.
    pub fn face(mesh: &TetMesh, corners: [VertexId; 3]) -> Self {
        Self::Face { vertices: corners.map(|v| v.0), centroid: middle(mesh, corners) }
    }
}

impl Place {
    /// Its vertices, counted from 0.
    pub fn vertices(&self) -> &[u32] {
        match self {
            Self::Vertex { vertex, .. } => std::slice::from_ref(vertex),
            Self::Edge { vertices, .. } => vertices,
            Self::Face { vertices, .. } => vertices,
        }
    }

    /// The vertex's position, or the middle of the edge or face, in the domain.
    pub fn position(&self) -> [f64; 3] {
        match *self {
            Self::Vertex { position, .. } => position,
            Self::Edge { midpoint, .. } => midpoint,
            Self::Face { centroid, .. } => centroid,
        }
    }
}

fn middle<const N: usize>(mesh: &TetMesh, vertices: [VertexId; N]) -> [f64; 3] {
    (vertices.iter().map(|v| mesh.points()[v.index()]).sum::<super::Vec3>() / N as f64).into()
}

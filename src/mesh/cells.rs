//! Tets or hexahedra: what estimators and pictures ask of both.

use std::collections::HashMap;

use super::{TetMesh, Vec3, VertexId, VoxelMesh};

/// The corners of a box's faces.
const BOX_FACES: [[usize; 4]; 6] = [[0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]];

/// The connectivity of a mesh.
#[derive(Clone, Copy, Debug)]
pub enum Cells<'a> {
    /// Tets in the order of [`TetMesh`].
    Tets(&'a [[VertexId; 4]]),
    /// Hexahedra with their corners in binary order, as in [`VoxelMesh`].
    Hexahedra(&'a [[VertexId; 8]]),
}

impl<'a> From<&'a TetMesh> for Cells<'a> {
    fn from(mesh: &'a TetMesh) -> Self {
        Self::Tets(mesh.tets())
    }
}

impl<'a> From<&'a VoxelMesh> for Cells<'a> {
    fn from(mesh: &'a VoxelMesh) -> Self {
        Self::Hexahedra(mesh.cells())
    }
}

impl<'a> Cells<'a> {
    /// How many cells.
    pub fn len(self) -> usize {
        match self {
            Self::Tets(tets) => tets.len(),
            Self::Hexahedra(cells) => cells.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// 4 or 8.
    pub fn corners_of_a_cell(self) -> usize {
        match self {
            Self::Tets(_) => 4,
            Self::Hexahedra(_) => 8,
        }
    }

    /// The vertices of a cell.
    pub fn vertices(self, cell: usize) -> &'a [VertexId] {
        match self {
            Self::Tets(tets) => &tets[cell],
            Self::Hexahedra(cells) => &cells[cell],
        }
    }

    /// The three corners that edges of the cell join to a corner, in the order in which they are counter-clockwise seen from
    /// outside or the reverse.
    pub(crate) fn neighbours(self, corner: usize) -> [usize; 3] {
        match self {
            Self::Tets(_) => TetMesh::FACES[corner],
            Self::Hexahedra(_) => [corner ^ 1, corner ^ 2, corner ^ 4],
        }
    }

    /// For each vertex its cells, in their order, each with the number of the corner that the vertex is.
    pub(crate) fn incidence(self, vertices: usize) -> Vec<Vec<(u32, u8)>> {
        let mut incidence = vec![Vec::new(); vertices];
        for cell in 0..self.len() {
            for (corner, vertex) in (0..).zip(self.vertices(cell)) {
                incidence[vertex.index()].push((cell as u32, corner));
            }
        }
        incidence
    }

    /// The positions of a tet's corners.
    pub(crate) fn tet(tet: &[VertexId; 4], points: &[Vec3]) -> [Vec3; 4] {
        tet.map(|v| points[v.index()])
    }

    /// The positions of a hexahedron's corners.
    pub(crate) fn hexahedron(cell: &[VertexId; 8], points: &[Vec3]) -> [Vec3; 8] {
        cell.map(|v| points[v.index()])
    }

    /// The faces that belong to one cell only, each with that cell.
    pub fn boundary_faces(self) -> Vec<(usize, Vec<VertexId>)> {
        let faces = |cell: usize| -> Vec<Vec<VertexId>> {
            let vertices = self.vertices(cell);
            match self {
                Self::Tets(_) => TetMesh::FACES.iter().map(|face| face.map(|i| vertices[i]).to_vec()).collect(),
                Self::Hexahedra(_) => BOX_FACES.iter().map(|face| face.map(|i| vertices[i]).to_vec()).collect(),
            }
        };
        let key = |face: &[VertexId]| {
            let mut key = face.to_vec();
            key.sort_unstable();
            key
        };
        let mut uses: HashMap<Vec<VertexId>, u32> = HashMap::new();
        (0..self.len()).for_each(|cell| faces(cell).iter().for_each(|face| *uses.entry(key(face)).or_default() += 1));
        let outer = |cell: usize| {
            let once = faces(cell).into_iter().filter(|face| uses[&key(face)] == 1);
            once.map(|face| (cell, face)).collect::<Vec<_>>()
        };
        (0..self.len()).flat_map(outer).collect()
    }
}

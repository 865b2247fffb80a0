//! What every reader of tetrahedra ends with: points and cells checked, cells that are no tets skipped or refused.

use super::tokens::Fault;
use crate::mesh::{TetSoup, Vec3, VertexId};

/// Named scalar arrays with one number a tet.
pub type CellData = Vec<(String, Vec<f64>)>;

/// A mesh and what its file says of each tet.
#[derive(Clone, Debug, PartialEq)]
pub struct TetFile {
    /// Points and tets.
    pub soup: TetSoup,
    /// The scalar arrays on the tets, in the file's order; NaN where a file gives a tet no value. Arrays of vectors are
    /// not read.
    pub cell_data: CellData,
    /// The arrays of vectors on the points, in the file's order; read of VTU files only.
    pub point_vectors: Vec<(String, Vec<Vec3>)>,
    /// How many vertices, lines, triangles and other cells of lower dimension were skipped.
    pub skipped_cells: usize,
}

/// Cells of mixed types, with vertices by position.
#[derive(Default)]
pub(super) struct Cells {
    tets: Vec<[i64; 4]>,
    /// The position of each tet among all cells.
    places: Vec<usize>,
    count: usize,
}

impl Cells {
    /// Takes the next cell, which is a tet.
    pub(super) fn push_tet(&mut self, vertices: [i64; 4]) {
        self.tets.push(vertices);
        self.places.push(self.count);
        self.count += 1;
    }

    /// Passes over cells of lower dimension.
    pub(super) fn skip(&mut self, count: usize) {
        self.count += count;
    }

    /// The mesh; `cell_data` has one number a cell of the file, skipped ones included.
    pub(super) fn finish(self, coordinates: Vec<f64>, mut cell_data: CellData) -> Result<TetFile, Fault> {
        let points = points(&coordinates)?;
        let vertex = |(tet, index): (usize, i64)| {
            let known = u32::try_from(index).ok().filter(|&index| (index as usize) < points.len());
            known.map(VertexId).ok_or_else(|| {
                let (cell, count) = (self.places[tet], points.len());
                (None, format!("cell {cell} names vertex {index}, but there are {count} vertices (all counted from 0)"))
            })
        };
        let mut tets = Vec::with_capacity(self.tets.len());
        for (tet, &[a, b, c, d]) in self.tets.iter().enumerate() {
            tets.push([vertex((tet, a))?, vertex((tet, b))?, vertex((tet, c))?, vertex((tet, d))?]);
        }
        let skipped_cells = self.count - tets.len();
        for (name, values) in &mut cell_data {
            if values.len() != self.count {
                let message = format!("the cell data \"{name}\" has {} numbers for {} cells", values.len(), self.count);
                return Err((None, message));
            }
            if skipped_cells > 0 {
                *values = self.places.iter().map(|&place| values[place]).collect();
            }
        }
        Ok(TetFile { soup: TetSoup { points, tets }, cell_data, point_vectors: Vec::new(), skipped_cells })
    }
}

/// Triples of numbers as vectors.
pub(super) fn vectors(numbers: &[f64]) -> Vec<Vec3> {
    numbers.chunks_exact(3).map(Vec3::from_column_slice).collect()
}

fn points(coordinates: &[f64]) -> Result<Vec<Vec3>, Fault> {
    let points = vectors(coordinates);
    if u32::try_from(points.len()).is_err() {
        return Err((None, format!("{} vertices are more than can be numbered (2^32)", points.len())));
    }
    match super::first_not_finite(&points) {
        Some(vertex) => {
            Err((None, format!("vertex {vertex} (counted from 0) has a coordinate that is not finite; repair it")))
        }
        None => Ok(points),
    }
}

//! VTK's lists of cells, of any type, made into tets.

use crate::mesh::io::tet_file::{CellData, Cells, TetFile};
use crate::mesh::io::tokens::Fault;

/// The number of a single point.
pub(super) const VERTEX: u8 = 1;
/// The number of a segment.
pub(super) const LINE: u8 = 3;
/// The number of a triangle.
pub(super) const TRIANGLE: u8 = 5;
/// VTK's number for a linear tetrahedron.
pub(super) const TETRA: u8 = 10;
/// VTK's number for a linear hexahedron.
pub(super) const HEXAHEDRON: u8 = 12;

/// An unstructured grid as both formats hold it.
#[derive(Default)]
pub(super) struct Grid {
    /// Three numbers a vertex.
    pub(super) coordinates: Vec<f64>,
    /// The vertices of all cells in a row.
    pub(super) connectivity: Vec<i64>,
    /// Where each cell ends in the row.
    pub(super) ends: Vec<i64>,
    /// VTK's number of each cell's type.
    pub(super) types: Vec<i64>,
    /// One number a cell.
    pub(super) cell_data: CellData,
}

impl Grid {
    /// Checks the lists against each other; cells of lower dimension are skipped, other volumes refused.
    pub(super) fn into_tets(self) -> Result<TetFile, Fault> {
        if self.ends.len() != self.types.len() {
            let message = format!("the file lists {} cells, but {} cell types", self.ends.len(), self.types.len());
            return Err((None, message));
        }
        let mut cells = Cells::default();
        let mut start = 0;
        for (cell, (&end, &kind)) in self.ends.iter().zip(&self.types).enumerate() {
            let vertices = usize::try_from(end).ok().and_then(|end| {
                let vertices = self.connectivity.get(start..end);
                start = end;
                vertices
            });
            let vertices = vertices.ok_or_else(|| {
                let count = self.connectivity.len();
                let message = format!(
                    "cell {cell} (counted from 0) ends at place {end} of the {count} in the connectivity, and begins at \
                     {start}: the offsets are wrong"
                );
                (None, message)
            })?;
            if is_lower_dimensional(kind) {
                cells.skip(1);
                continue;
            }
            if kind != i64::from(TETRA) {
                let what = name(kind).map_or_else(|| format!("of VTK's type {kind}"), str::to_owned);
                let message =
                    format!("cell {cell} (counted from 0) is {what}; only linear tetrahedra are read: split it first");
                return Err((None, message));
            }
            let tet = vertices.try_into().map_err(|_| {
                let message = format!("cell {cell} (counted from 0) is a tetrahedron of {} vertices", vertices.len());
                (None, message)
            })?;
            cells.push_tet(tet);
        }
        cells.finish(self.coordinates, self.cell_data)
    }
}

/// Empty cells, points, lines, triangles and other polygons, linear or not.
fn is_lower_dimensional(kind: i64) -> bool {
    matches!(kind, 0..=9 | 21..=23 | 28 | 30 | 34..=36 | 68..=70 | 75..=77)
}

fn name(kind: i64) -> Option<&'static str> {
    Some(match kind {
        11 => "a voxel",
        12 => "a hexahedron",
        13 => "a wedge (prism)",
        14 => "a pyramid",
        15 | 16 => "a pentagonal or hexagonal prism",
        24 | 71 | 78 => "a tetrahedron of second or higher order",
        25..=27 | 29 | 31..=33 | 37 | 72..=74 | 79..=81 => "a cell of second or higher order",
        42 => "a polyhedron",
        _ => return None,
    })
}

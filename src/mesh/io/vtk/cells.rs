//! VTK's lists of cells, of any type.

use std::collections::HashMap;

use crate::mesh::Vec3;
use crate::mesh::io::cells::{CellData, Cells, Contents, Shape};
use crate::mesh::io::tokens::Fault;

/// The number of a single point.
pub(super) const VERTEX: u8 = 1;
/// The number of a strip of triangles.
pub(super) const STRIP: i64 = 6;
/// The number of a polygon.
pub(super) const POLYGON: i64 = 7;
/// The number of a list of points or lines, of which nothing is wanted.
pub(super) const POLYLINE: i64 = 4;

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
    /// One vector a vertex; not of grids in several pieces.
    pub(super) point_vectors: Vec<(String, Vec<Vec3>)>,
}

impl Grid {
    /// Adds cells of one type.
    pub(super) fn extend(&mut self, connectivity: &[i64], ends: &[i64], kind: i64) {
        let start = self.connectivity.len() as i64;
        self.connectivity.extend_from_slice(connectivity);
        self.ends.extend(ends.iter().map(|end| end.saturating_add(start)));
        self.types.extend(ends.iter().map(|_| kind));
    }

    /// Several grids as one, with a vertex for each place: writers of pieces repeat those at the seams. Data that some of
    /// them lack is dropped.
    pub(super) fn joined(grids: Vec<Grid>) -> Result<Grid, Fault> {
        let mut all = Grid::default();
        let mut vertices: HashMap<[u64; 3], i64> = HashMap::new();
        for (index, grid) in grids.into_iter().enumerate() {
            if grid.ends.last().copied().unwrap_or(0) != grid.connectivity.len() as i64 {
                let message =
                    format!("the offsets of piece {index} (counted from 0) do not end where its connectivity does");
                return Err((None, message));
            }
            let number_of: Vec<i64> = grid
                .coordinates
                .chunks_exact(3)
                .map(|point| {
                    // Adding zero makes -0 and 0 the same bits.
                    let key = [point[0], point[1], point[2]].map(|x| (x + 0.0).to_bits());
                    *vertices.entry(key).or_insert_with(|| {
                        all.coordinates.extend_from_slice(point);
                        all.coordinates.len() as i64 / 3 - 1
                    })
                })
                .collect();
            let start = all.connectivity.len() as i64;
            // What is no vertex of the piece shall be none of the whole.
            let number = |v: i64| usize::try_from(v).ok().and_then(|v| number_of.get(v)).copied().unwrap_or(i64::MAX);
            all.connectivity.extend(grid.connectivity.into_iter().map(number));
            all.ends.extend(grid.ends.into_iter().map(|end| end.saturating_add(start)));
            all.types.extend(grid.types);
            if index == 0 {
                all.cell_data = grid.cell_data;
            } else {
                all.cell_data.retain_mut(|(name, values)| {
                    let more = grid.cell_data.iter().find(|(other, _)| other == name);
                    more.inspect(|(_, more)| values.extend_from_slice(more)).is_some()
                });
            }
        }
        Ok(all)
    }

    /// Checks the lists against each other; cells that are neither polygons nor volumes are skipped, volumes that cannot be
    /// split into tets refused.
    pub(super) fn into_contents(self) -> Result<Contents, Fault> {
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
            let Kind { name, shape, least, most } = Kind::of(kind, vertices.len()).ok_or_else(|| {
                let name = refused(kind).map_or_else(|| format!("of VTK's type {kind}"), str::to_owned);
                let message = format!("cell {cell} (counted from 0) is {name}, which is not read; split it into tets");
                (None, message)
            })?;
            if !(least..=most).contains(&vertices.len()) {
                // A polygon of too few vertices has no area; a volume must not be lost.
                if matches!(shape, Shape::Polygon(_) | Shape::Strip | Shape::Other) {
                    cells.skip(1);
                    continue;
                }
                let message = format!("cell {cell} (counted from 0) is {name} of {} vertices", vertices.len());
                return Err((None, message));
            }
            match kind {
                PIXEL => cells.push(shape, &[0, 1, 3, 2].map(|i| vertices[i])),
                VOXEL => cells.push(shape, &[0, 1, 3, 2, 4, 5, 7, 6].map(|i| vertices[i])),
                _ => cells.push(shape, vertices),
            }
        }
        let mut contents = cells.finish(self.coordinates, self.cell_data)?;
        contents.tets.point_vectors = self.point_vectors;
        Ok(contents)
    }
}

/// A rectangle and a box whose corners are in binary order.
const PIXEL: i64 = 8;
const VOXEL: i64 = 11;

/// What a cell is, and how few and how many vertices it may have.
struct Kind {
    name: &'static str,
    shape: Shape,
    least: usize,
    most: usize,
}

impl Kind {
    /// By VTK's number, for a cell of `count` vertices; none for volumes that are not read.
    fn of(kind: i64, count: usize) -> Option<Self> {
        let any = usize::MAX;
        let (name, shape, least, most) = match kind {
            0..=4 | 21 | 35 | 36 | 68 | 75 => ("a point or line", Shape::Other, 0, any),
            5 => ("a triangle", Shape::Polygon(3), 3, 3),
            STRIP => ("a strip of triangles", Shape::Strip, 3, any),
            POLYGON => ("a polygon", Shape::Polygon(count), 3, any),
            PIXEL | 9 => ("a quadrilateral", Shape::Polygon(4), 4, 4),
            22 | 34 | 69 | 76 => ("a triangle of second or higher order", Shape::Polygon(3), 3, any),
            23 | 28 | 30 | 70 | 77 => ("a quadrilateral of second or higher order", Shape::Polygon(4), 4, any),
            10 => ("a tetrahedron", Shape::Tet, 4, 4),
            VOXEL => ("a voxel", Shape::Hexahedron, 8, 8),
            12 => ("a hexahedron", Shape::Hexahedron, 8, 8),
            13 => ("a wedge (prism)", Shape::Prism, 6, 6),
            14 => ("a pyramid", Shape::Pyramid, 5, 5),
            24 => ("a tetrahedron of second order", Shape::Tet, 10, 10),
            71 | 78 => ("a tetrahedron of higher order", Shape::Tet, 4, any),
            25 | 29 | 33 => ("a hexahedron of second order", Shape::Hexahedron, 20, 27),
            72 | 79 => ("a hexahedron of higher order", Shape::Hexahedron, 8, any),
            26 | 31 | 32 => ("a wedge of second order", Shape::Prism, 12, 18),
            73 | 80 => ("a wedge of higher order", Shape::Prism, 6, any),
            27 | 37 => ("a pyramid of second order", Shape::Pyramid, 13, 19),
            74 | 81 => ("a pyramid of higher order", Shape::Pyramid, 5, any),
            _ => return None,
        };
        Some(Self { name, shape, least, most })
    }
}

/// Volumes that are not read.
fn refused(kind: i64) -> Option<&'static str> {
    Some(match kind {
        15 | 16 => "a pentagonal or hexagonal prism",
        41 => "a convex point set",
        42 => "a polyhedron",
        _ => return None,
    })
}

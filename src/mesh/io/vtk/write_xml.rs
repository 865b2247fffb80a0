//! VTU, the XML file of an unstructured grid that ParaView, PyVista and meshio read: written.
//!
//! Arrays stand inline, each as base64 of a header `[blocks, block size, size of the last block if partial, compressed
//! sizes ...]` followed by base64 of the zlib blocks. Indices are Int64: UInt64, which other writers use, arrives in
//! meshio as floats and cannot index.

use std::io::{self, Write};
use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use quick_xml::escape::escape;
use rayon::prelude::*;

use super::cells::{HEXAHEDRON, LINE, TETRA, TRIANGLE, VERTEX};
use crate::mesh::io::{WriteError, write_atomically};
use crate::mesh::{Vec3, VertexId};

/// VTK's own default block size is of this order; smaller blocks compress worse, larger ones gain nothing.
const BLOCK_BYTES: usize = 32_768;

/// VTK's order of a hexahedron's corners, each by its binary number: round the lower side, then round the upper one.
const HEXAHEDRON_ORDER: [usize; 8] = [0, 1, 3, 2, 4, 5, 7, 6];

/// A named array with one entry a point or one a cell.
#[derive(Clone, Debug)]
pub struct DataArray<'a> {
    /// The name under which a viewer lists it.
    pub name: &'a str,
    /// The entries.
    pub values: Values<'a>,
}

/// The entries of a [`DataArray`].
#[derive(Clone, Debug)]
pub enum Values<'a> {
    /// One number an entry; infinities and NaN arrive as such.
    Scalars(&'a [f64]),
    /// Three numbers an entry.
    Vectors(&'a [Vec3]),
    /// One yes or no an entry, as UInt8 1 or 0.
    Flags(&'a [bool]),
}

impl Values<'_> {
    fn len(&self) -> usize {
        match self {
            Values::Scalars(values) => values.len(),
            Values::Vectors(values) => values.len(),
            Values::Flags(values) => values.len(),
        }
    }
}

/// Writes a mesh with data on its points and cells.
///
/// # Errors
/// The path and the system's reason.
///
/// # Panics
/// When an array has not one entry a point or cell.
pub fn write_vtu(
    path: &Path,
    points: &[Vec3],
    tets: &[[VertexId; 4]],
    point_data: &[DataArray],
    cell_data: &[DataArray],
) -> Result<(), WriteError> {
    write_grid(path, points, TETRA, tets, point_data, cell_data)
}

/// Writes hexahedra, whose corners are in binary order as those of a [`crate::mesh::VoxelMesh`] and its images are, with data
/// on points and cells; VTK's own order has the third and fourth corner of each side exchanged.
///
/// # Errors
/// The path and the system's reason.
///
/// # Panics
/// When an array has not one entry a point or cell.
pub fn write_hexahedra_vtu(
    path: &Path,
    points: &[Vec3],
    cells: &[[VertexId; 8]],
    point_data: &[DataArray],
    cell_data: &[DataArray],
) -> Result<(), WriteError> {
    let cells: Vec<[VertexId; 8]> = cells.iter().map(|cell| HEXAHEDRON_ORDER.map(|i| cell[i])).collect();
    write_grid(path, points, HEXAHEDRON, &cells, point_data, cell_data)
}

/// Writes the triangles and edges of a surface, with data on points and on cells: first the triangles, then the edges.
///
/// # Errors
/// The path and the system's reason.
///
/// # Panics
/// When an array has not one entry a point or cell.
pub fn write_surface_vtu(
    path: &Path,
    points: &[Vec3],
    triangles: &[[VertexId; 3]],
    edges: &[[VertexId; 2]],
    point_data: &[DataArray],
    cell_data: &[DataArray],
) -> Result<(), WriteError> {
    let cells = triangles.iter().map(|triangle| (TRIANGLE, triangle.as_slice()));
    let cells: Vec<(u8, &[VertexId])> = cells.chain(edges.iter().map(|edge| (LINE, edge.as_slice()))).collect();
    write_cells(path, points, &cells, point_data, cell_data)
}

/// Writes points, each a cell of its own, with data on them.
///
/// # Errors
/// The path and the system's reason.
///
/// # Panics
/// When an array has not one entry a point.
pub fn write_points_vtu(path: &Path, points: &[Vec3], point_data: &[DataArray]) -> Result<(), WriteError> {
    let cells: Vec<[VertexId; 1]> = (0..points.len() as u32).map(|point| [VertexId(point)]).collect();
    write_grid(path, points, VERTEX, &cells, point_data, &[])
}

/// Writes cells of one type, their corners in VTK's order.
fn write_grid<const CORNERS: usize>(
    path: &Path,
    points: &[Vec3],
    kind: u8,
    cells: &[[VertexId; CORNERS]],
    point_data: &[DataArray],
    cell_data: &[DataArray],
) -> Result<(), WriteError> {
    let cells: Vec<(u8, &[VertexId])> = cells.iter().map(|cell| (kind, cell.as_slice())).collect();
    write_cells(path, points, &cells, point_data, cell_data)
}

/// Writes cells, each with its type and its corners in VTK's order.
fn write_cells(
    path: &Path,
    points: &[Vec3],
    cells: &[(u8, &[VertexId])],
    point_data: &[DataArray],
    cell_data: &[DataArray],
) -> Result<(), WriteError> {
    assert!(point_data.iter().all(|array| array.values.len() == points.len()), "one entry a point");
    assert!(cell_data.iter().all(|array| array.values.len() == cells.len()), "one entry a cell");
    let connectivity = integers(cells.iter().flat_map(|(_, corners)| *corners).map(|v| i64::from(v.0)));
    let offsets = integers(cells.iter().scan(0, |end, (_, corners)| {
        *end += corners.len() as i64;
        Some(*end)
    }));
    let kinds: Vec<u8> = cells.iter().map(|(kind, _)| *kind).collect();
    write_atomically(path, |file| {
        writeln!(
            file,
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" \
             header_type=\"UInt64\" compressor=\"vtkZLibDataCompressor\">\n<UnstructuredGrid>\n\
             <Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">",
            points.len(),
            cells.len()
        )?;
        writeln!(file, "<Points>")?;
        write_values(file, "Points", &Values::Vectors(points))?;
        writeln!(file, "</Points>\n<Cells>")?;
        write_array(file, "Int64", "connectivity", 1, &connectivity)?;
        write_array(file, "Int64", "offsets", 1, &offsets)?;
        write_array(file, "UInt8", "types", 1, &kinds)?;
        writeln!(file, "</Cells>\n<PointData>")?;
        point_data.iter().try_for_each(|array| write_values(file, array.name, &array.values))?;
        writeln!(file, "</PointData>\n<CellData>")?;
        cell_data.iter().try_for_each(|array| write_values(file, array.name, &array.values))?;
        writeln!(file, "</CellData>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>")
    })
}

fn integers(values: impl Iterator<Item = i64>) -> Vec<u8> {
    values.flat_map(i64::to_le_bytes).collect()
}

fn write_values(file: &mut dyn Write, name: &str, values: &Values) -> io::Result<()> {
    let floats = |values: &mut dyn Iterator<Item = f64>| values.flat_map(f64::to_le_bytes).collect::<Vec<u8>>();
    match values {
        Values::Scalars(values) => write_array(file, "Float64", name, 1, &floats(&mut values.iter().copied())),
        Values::Vectors(values) => {
            write_array(file, "Float64", name, 3, &floats(&mut values.iter().flat_map(|v| [v.x, v.y, v.z])))
        }
        Values::Flags(values) => {
            write_array(file, "UInt8", name, 1, &values.iter().map(|&flag| flag.into()).collect::<Vec<u8>>())
        }
    }
}

fn write_array(file: &mut dyn Write, kind: &str, name: &str, components: usize, bytes: &[u8]) -> io::Result<()> {
    let partial = bytes.len() % BLOCK_BYTES;
    let mut header = vec![bytes.len().div_ceil(BLOCK_BYTES), BLOCK_BYTES, partial];
    let blocks = bytes.par_chunks(BLOCK_BYTES).map(|block| {
        // Of coordinates more effort saves a tenth of the size at most, in three times the time.
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
        encoder.write_all(block)?;
        encoder.finish()
    });
    let blocks: Vec<Vec<u8>> = blocks.collect::<io::Result<_>>()?;
    header.extend(blocks.iter().map(Vec::len));
    let compressed = blocks.concat();
    // One component is the default; spelled out, meshio makes columns of shape (n, 1) of it.
    let components = if components == 1 { String::new() } else { format!(" NumberOfComponents=\"{components}\"") };
    let header: Vec<u8> = header.into_iter().flat_map(|size| (size as u64).to_le_bytes()).collect();
    let name = escape(name);
    writeln!(
        file,
        "<DataArray type=\"{kind}\" Name=\"{name}\"{components} format=\"binary\">\n{}{}\n\
         </DataArray>",
        STANDARD.encode(header),
        STANDARD.encode(compressed)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hexahedra_go_round_their_lower_and_then_their_upper_side() {
        // VTK File Formats, figure 2: the hexahedron's corners 0 to 7.
        let vtk = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]];
        assert_eq!(HEXAHEDRON_ORDER.map(|i| [i & 1, i >> 1 & 1, i >> 2]), vtk);
    }

    #[test]
    fn a_file_of_hexahedra_says_what_it_holds() {
        let points: Vec<Vec3> =
            (0..8).map(|i| Vec3::new((i & 1).into(), (i >> 1 & 1).into(), (i >> 2).into())).collect();
        let cell = std::array::from_fn(|i| VertexId(i as u32));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("voxel.vtu");
        let data = [DataArray { name: "K", values: Values::Scalars(&[1.5]) }];
        write_hexahedra_vtu(&path, &points, &[cell], &[], &data).unwrap();
        let file = crate::mesh::io::read_tet_file(&path).unwrap();
        assert_eq!(file.soup.notes, ["1 hexahedra were split into tets"]);
        assert_eq!(file.cell_data, [("K".to_owned(), vec![1.5; 6])]);
        let mesh = crate::mesh::TetMesh::new(file.soup.points, file.soup.tets).unwrap();
        assert_eq!(mesh.tets().len(), 6);
    }
}

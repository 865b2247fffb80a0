//! The format of a file that is written follows its ending.

use std::io;
use std::path::Path;

use super::vtk::{DataArray, Values, write_legacy, write_vtu};
use super::{CellData, WriteError, ending_of, gmsh, obj, off, ply, stl, tetgen, write_medit};
use crate::mesh::{PolygonSoup, Vec3, VertexId};

const USE_TET_ENDING: &str =
    "use one of .mesh (Medit), .vtu, .vtk (legacy VTK), .msh (Gmsh 4.1), .msh2 (Gmsh 2.2), .node or .ele (TetGen)";
const USE_SURFACE_ENDING: &str = "use one of .obj, .off, .ply, .stl";

/// Writes a tetrahedral mesh with named scalars on its cells; the file's ending (in any case) tells the format.
///
/// Reading gives every position and number back to the bit (the sign and digits of a NaN apart), and the tets as they
/// were. `.msh` is Gmsh's version 4.1; `.msh2` or `.msh22` is 2.2, as Gmsh itself has it. TetGen's `.node` and `.ele` are
/// always written as a pair.
///
/// # Errors
/// An unknown ending, a name that a format cannot hold, cell data for Medit (which has no place for it), or the
/// system's reason; always with the path.
///
/// # Panics
/// When an array of cell data has not one number a tet.
pub fn write_tets(
    path: &Path,
    points: &[Vec3],
    tets: &[[VertexId; 4]],
    cell_data: &CellData,
) -> Result<(), WriteError> {
    assert!(cell_data.iter().all(|(_, values)| values.len() == tets.len()), "one number a tet");
    check_names(path, cell_data)?;
    match ending_of(path).as_str() {
        "mesh" if !cell_data.is_empty() => {
            Err(WriteError::refused(path, "Medit's format holds no cell data", "use .vtu, .vtk, .msh or .node"))
        }
        "mesh" => write_medit(path, points, tets),
        "vtu" => {
            let arrays = cell_data.iter().map(|(name, values)| DataArray { name, values: Values::Scalars(values) });
            write_vtu(path, points, tets, &[], &arrays.collect::<Vec<_>>())
        }
        "vtk" => write_legacy(path, points, tets, cell_data),
        "msh" | "msh4" | "msh41" => gmsh::write_version_4(path, points, tets, cell_data),
        "msh2" | "msh22" => gmsh::write_version_2(path, points, tets, cell_data),
        "node" | "ele" => tetgen::write(path, points, tets, cell_data),
        ending => Err(unknown(path, ending, USE_TET_ENDING)),
    }
}

/// Whether [`write_tets`] knows the ending of `path`: to be asked before hours of work.
///
/// # Errors
/// The same refusal.
pub fn check_tets_can_be_written(path: &Path) -> Result<(), WriteError> {
    match ending_of(path).as_str() {
        "mesh" | "vtu" | "vtk" | "msh" | "msh4" | "msh41" | "msh2" | "msh22" | "node" | "ele" => Ok(()),
        ending => Err(unknown(path, ending, USE_TET_ENDING)),
    }
}

/// Writes a surface; the file's ending (in any case) tells the format: OBJ, OFF, PLY or STL.
///
/// Positions keep every bit, except in STL: it holds single precision, rounded to nearest, and triangles only, so that
/// larger polygons are cut into fans. A vertex that no polygon names is lost in STL, and to [`super::read_surface`] in OBJ.
///
/// # Errors
/// An unknown ending, a coordinate beyond STL's range, a polygon of more than 255 corners for PLY, or the system's
/// reason; always with the path.
pub fn write_surface(path: &Path, soup: &PolygonSoup) -> Result<(), WriteError> {
    match ending_of(path).as_str() {
        "obj" => obj::write(path, soup),
        "off" => off::write(path, soup),
        "ply" => ply::write(path, soup),
        "stl" => stl::write(path, soup),
        ending => Err(unknown(path, ending, USE_SURFACE_ENDING)),
    }
}

fn unknown(path: &Path, ending: &str, remedy: &'static str) -> WriteError {
    WriteError::refused(path, format!("unknown file ending {ending:?}"), remedy)
}

/// Names stand on lines, in quotes and in tables by name.
fn check_names(path: &Path, cell_data: &CellData) -> Result<(), WriteError> {
    for (index, (name, _)) in cell_data.iter().enumerate() {
        let fault = if name.trim() != name || name.is_empty() {
            "is empty or starts or ends with white space"
        } else if name.contains(|c: char| c.is_control() || c == '"') {
            "holds a quotation mark or a control character"
        } else if cell_data[..index].iter().any(|(other, _)| other == name) {
            "occurs twice"
        } else {
            continue;
        };
        return Err(WriteError::refused(path, format!("the name {name:?} of cell data {fault}"), "rename the array"));
    }
    Ok(())
}

/// Writes one polygon as a line: `start`, then each corner counted from `first`.
pub(super) fn write_polygon(file: &mut dyn io::Write, start: &str, polygon: &[VertexId], first: u64) -> io::Result<()> {
    write!(file, "{start}")?;
    polygon.iter().try_for_each(|v| write!(file, " {}", u64::from(v.0) + first))?;
    writeln!(file)
}

//! The format of a file that is written follows its ending.

use std::path::Path;

use super::format::ending_of;
use super::vtk::{DataArray, Values, write_legacy, write_vtu};
use super::{CellData, SurfaceFormat, TetFormat, WriteError, gmsh, tetgen, write_atomically, write_medit};
use crate::mesh::{PolygonSoup, Vec3, VertexId};

const USE_TET_ENDING: &str =
    "use one of .mesh (Medit), .vtu, .vtk (legacy VTK), .msh (Gmsh 4.1), .msh2 (Gmsh 2.2), .node or .ele (TetGen)";

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
    match TetFormat::of(path) {
        Some(TetFormat::Medit) if !cell_data.is_empty() => {
            Err(WriteError::refused(path, "Medit's format holds no cell data", "use .vtu, .vtk, .msh or .node"))
        }
        Some(TetFormat::Medit) => write_medit(path, points, tets),
        Some(TetFormat::Vtu) => {
            let arrays = cell_data.iter().map(|(name, values)| DataArray { name, values: Values::Scalars(values) });
            write_vtu(path, points, tets, &[], &arrays.collect::<Vec<_>>())
        }
        Some(TetFormat::Vtk) => write_legacy(path, points, tets, cell_data),
        Some(TetFormat::Gmsh) => gmsh::write_version_4(path, points, tets, cell_data),
        Some(TetFormat::Gmsh2) => gmsh::write_version_2(path, points, tets, cell_data),
        Some(TetFormat::TetGen) => tetgen::write(path, points, tets, cell_data),
        Some(TetFormat::MeditBinary | TetFormat::Pvtu) | None => Err(unknown(path)),
    }
}

/// Whether [`write_tets`] knows the ending of `path`: to be asked before hours of work.
///
/// # Errors
/// The same refusal.
pub fn check_tets_can_be_written(path: &Path) -> Result<(), WriteError> {
    match TetFormat::of(path) {
        Some(TetFormat::MeditBinary | TetFormat::Pvtu) | None => Err(unknown(path)),
        Some(_) => Ok(()),
    }
}

/// Writes a surface; the file's ending (in any case) tells the format, OFF or OBJ, which keep every bit of a position.
///
/// # Errors
/// Another ending, or the system's reason; with the path.
pub fn write_surface(path: &Path, surface: &PolygonSoup) -> Result<(), WriteError> {
    check_surface_can_be_written(path)?;
    let is_off = SurfaceFormat::of(path) == Some(SurfaceFormat::Off);
    // OFF counts from 0 and begins a face with its number of vertices, OBJ counts from 1 and names what a line holds.
    let (first, vertex) = if is_off { (0, "") } else { (1, "v ") };
    write_atomically(path, |file| {
        if is_off {
            writeln!(file, "OFF\n{} {} 0", surface.points.len(), surface.polygons.len())?;
        }
        surface.points.iter().try_for_each(|p| writeln!(file, "{vertex}{:?} {:?} {:?}", p.x, p.y, p.z))?;
        surface.polygons.iter().try_for_each(|polygon| {
            let start = if is_off { polygon.len().to_string() } else { "f".into() };
            let vertices: String = polygon.iter().map(|v| format!(" {}", v.0 + first)).collect();
            writeln!(file, "{start}{vertices}")
        })
    })
}

/// Whether [`write_surface`] knows the ending of `path`.
///
/// # Errors
/// The same refusal.
pub fn check_surface_can_be_written(path: &Path) -> Result<(), WriteError> {
    match SurfaceFormat::of(path) {
        Some(SurfaceFormat::Off | SurfaceFormat::Obj) => Ok(()),
        _ => Err(WriteError::refused(
            path,
            format!("surfaces are not written with the ending {:?}", ending_of(path)),
            "use .off or .obj",
        )),
    }
}

fn unknown(path: &Path) -> WriteError {
    let fault = match TetFormat::of(path) {
        None => format!("unknown file ending {:?}", ending_of(path)),
        Some(_) => format!("files with the ending {:?} are only read", ending_of(path)),
    };
    WriteError::refused(path, fault, USE_TET_ENDING)
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

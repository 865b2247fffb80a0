//! File formats, one per file.
//!
//! Every reader takes the whole file as bytes, so that a count in a header can be held against what is there before
//! anything is allocated for it.

mod atomic;
mod gmsh;
mod medit;
mod numbers;
mod obj;
mod off;
mod ply;
#[cfg(feature = "cli")]
mod points;
mod stl;
mod tet_file;
mod tetgen;
mod tokens;
mod vtk;
mod write;

pub use atomic::{WriteError, check_folder_is_writable, write_atomically};
pub use medit::{read_medit, write_medit};
#[cfg(feature = "cli")]
pub use points::{PointTable, check_points_can_be_written, read_points};
pub use tet_file::{CellData, TetFile};
pub use vtk::{DataArray, Values, write_hexahedra_vtu, write_points_vtu, write_surface_vtu, write_vtu};
pub use write::{check_tets_can_be_written, write_surface, write_tets};

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::{PolygonSoup, TetSoup, Vec3, VertexId};

/// The endings [`read_surface`] knows.
const SURFACE_ENDINGS: &str = ".obj, .off, .ply, .stl";
/// The endings [`read_tets`] knows.
const TET_ENDINGS: &str = ".mesh (Medit in ASCII), .vtu, .vtk, .msh (Gmsh 4.1 or 2.2), .node or .ele (TetGen)";

/// Why a file could not be read.
///
/// Lines count from 1, as editors do; vertices and faces from 0, as everywhere in this crate.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The operating system refused.
    #[error("cannot read {}: {source}", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The path names a directory.
    #[error("{} is a directory; name a file in it", path.display())]
    Directory {
        /// The path.
        path: PathBuf,
    },
    /// The file holds nothing.
    #[error("{} is empty; export it again", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The ending tells no format that is read here.
    #[error(
        "{}: unknown file ending \"{ending}\" for a {wanted}; surfaces are read from {SURFACE_ENDINGS}, meshes of tets from \
         {TET_ENDINGS}",
        path.display()
    )]
    UnknownEnding {
        /// The file.
        path: PathBuf,
        /// Its ending, without the dot; empty if there is none.
        ending: String,
        /// What was to be read.
        wanted: &'static str,
    },
    /// The text or the bytes do not follow the format.
    #[error("{}: {message}", place(path, *line))]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The line, where the format has lines and the fault can be tied to one.
        line: Option<usize>,
        /// What is wrong and, where that is not plain, what to do.
        message: String,
    },
    /// The file ends before everything it promises.
    #[error("{}: the file ends too early: {message}; export it again", place(path, *line))]
    Truncated {
        /// The file.
        path: PathBuf,
        /// The last line.
        line: Option<usize>,
        /// What was promised and what is there.
        message: String,
    },
    /// A coordinate is NaN or infinite.
    #[error("{}: vertex {vertex} (counted from 0) has a coordinate that is not finite; give it numbers", place(path, *line))]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// The vertex's line.
        line: Option<usize>,
        /// The vertex, in the order of the file.
        vertex: usize,
    },
    /// A face or cell names a vertex that does not exist.
    #[error(
        "{}: face {face} (counted from 0) names vertex {index}, but the file has {count} vertices, numbered from {first}; \
         correct it, or export the file again",
        place(path, *line)
    )]
    IndexOutOfRange {
        /// The file.
        path: PathBuf,
        /// The face's line.
        line: Option<usize>,
        /// The face or cell, in the order of the file.
        face: usize,
        /// The vertex as the file writes it.
        index: i128,
        /// How many vertices there are.
        count: usize,
        /// The number the format gives to the first vertex.
        first: u8,
    },
}

/// `path:line`, or the path alone.
fn place(path: &Path, line: Option<usize>) -> String {
    match line {
        Some(line) => format!("{}:{line}", path.display()),
        None => path.display().to_string(),
    }
}

/// Reads a surface; the file's ending (in any case) tells the format: OBJ, OFF, PLY or STL.
///
/// Polygons keep the file's order. Points are those of the file except that OBJ and STL points with equal coordinates
/// become one, since these formats (or their usual writers) repeat a point for each face or texture seam.
///
/// # Errors
/// [`ReadError`], with the path and, where the format allows it, the line or the element.
pub fn read_surface(path: &Path) -> Result<PolygonSoup, ReadError> {
    let ending = ending_of(path);
    let reader = match ending.as_str() {
        "obj" => obj::read,
        "off" => off::read,
        "ply" => ply::read,
        "stl" => stl::read,
        _ => return Err(ReadError::UnknownEnding { path: path.into(), ending, wanted: "surface" }),
    };
    reader(path, &read_bytes(path)?)
}

/// Reads a tetrahedral mesh; the file's ending (in any case) tells the format: Medit, VTU, legacy VTK, Gmsh or TetGen.
///
/// # Errors
/// [`ReadError`], with the path and, where the format allows it, the line.
pub fn read_tets(path: &Path) -> Result<TetSoup, ReadError> {
    read_tet_file(path).map(|file| file.soup)
}

/// Reads a tetrahedral mesh like [`read_tets`], and the scalars that the file gives on its cells.
///
/// Tets keep the file's order and orientation. Cells of lower dimension are skipped and counted; other volumes, which
/// cannot be skipped without a hole, are refused, and so are tets of higher order.
///
/// # Errors
/// [`ReadError`], with the path and, where the format allows it, the line.
pub fn read_tet_file(path: &Path) -> Result<TetFile, ReadError> {
    match ending_of(path).as_str() {
        "mesh" => read_tets_by(medit::parse, path),
        "vtu" => read_tets_by(vtk::parse_xml, path),
        "vtk" => read_tets_by(vtk::parse_legacy, path),
        "msh" | "msh2" | "msh22" | "msh4" | "msh41" => read_tets_by(gmsh::parse, path),
        "node" | "ele" => tetgen::read(path),
        ending => Err(ReadError::UnknownEnding { path: path.into(), ending: ending.into(), wanted: "mesh of tets" }),
    }
}

fn read_tets_by(parse: fn(&[u8]) -> Result<TetFile, tokens::Fault>, path: &Path) -> Result<TetFile, ReadError> {
    parse(&read_bytes(path)?).map_err(|(line, message)| ReadError::Malformed { path: path.into(), line, message })
}

/// Whether a file's ending is that of a surface format; any other is taken for a mesh's.
pub fn holds_a_surface(path: &Path) -> bool {
    SURFACE_ENDINGS.split(", ").any(|known| known[1..] == ending_of(path))
}

/// Whether a file's ending is that of a format that tets are read from.
pub fn holds_tets(path: &Path) -> bool {
    ["mesh", "vtu", "vtk", "msh", "msh2", "msh22", "msh4", "msh41", "node", "ele"].contains(&&*ending_of(path))
}

/// The file's ending in lower case, without the dot; empty if there is none.
fn ending_of(path: &Path) -> String {
    path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default()
}

/// The whole file; a directory or an empty file is refused.
fn read_bytes(path: &Path) -> Result<Vec<u8>, ReadError> {
    if path.is_dir() {
        return Err(ReadError::Directory { path: path.into() });
    }
    let bytes = std::fs::read(path).map_err(|source| ReadError::Open { path: path.into(), source })?;
    if bytes.iter().all(u8::is_ascii_whitespace) {
        return Err(ReadError::Empty { path: path.into() });
    }
    Ok(bytes)
}

/// Gives one index to all points with equal coordinates, in the order of first appearance.
#[derive(Default)]
struct Weld {
    points: Vec<Vec3>,
    index_of: HashMap<[u64; 3], VertexId>,
}

impl Weld {
    fn add(&mut self, point: Vec3) -> VertexId {
        // Adding zero makes -0 and 0 the same bits.
        let key = [point.x, point.y, point.z].map(|x| (x + 0.0).to_bits());
        *self.index_of.entry(key).or_insert_with(|| {
            self.points.push(point);
            VertexId(self.points.len() as u32 - 1)
        })
    }
}

/// The first vertex with a NaN or infinite coordinate.
fn first_not_finite(points: &[Vec3]) -> Option<usize> {
    points.iter().position(|point| !point.iter().all(|x| x.is_finite()))
}

#[cfg(test)]
mod tests;

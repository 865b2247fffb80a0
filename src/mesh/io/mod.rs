//! File formats, one per file.
//!
//! Every reader takes the whole file as bytes, so that a count in a header can be held against what is there before
//! anything is allocated for it.

mod atomic;
mod cells;
mod format;
mod freesurfer;
mod gifti;
mod gmsh;
mod medit;
mod numbers;
mod obj;
mod off;
mod ply;
#[cfg(feature = "cli")]
mod points;
mod stl;
mod tetgen;
mod text;
mod tokens;
mod vtk;
mod write;

#[cfg(feature = "cli")]
pub(crate) use text::{is_harmful, on_one_line};

pub use atomic::{WriteError, check_file_can_be_put, check_folder_is_writable, write_atomically};
pub use cells::{CellData, PointVectors, TetFile};
pub use format::{SurfaceFormat, TetFormat};
pub use medit::{read_medit, write_medit};
#[cfg(feature = "cli")]
pub use points::{PointTable, check_points_can_be_written, read_points, read_points_under};
pub use vtk::{DataArray, Values, write_hexahedra_vtu, write_points_vtu, write_surface_vtu, write_vtu};
pub use write::{check_surface_can_be_written, check_tets_can_be_written, write_surface, write_tets};

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use super::{PolygonSoup, TetSoup, Vec3, VertexId};
use cells::Contents;
use format::{ending_of, surface_endings, tet_endings};
use tokens::Fault;

/// Why a file could not be read.
///
/// Lines count from 1, as editors do; vertices and faces from 0, as everywhere in this crate.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The operating system refused.
    #[error("cannot read {}: {source}", shown_path(path))]
    Open {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The path names a directory.
    #[error("{} is a directory; name a file in it", shown_path(path))]
    Directory {
        /// The path.
        path: PathBuf,
    },
    /// The file holds nothing.
    #[error("{} is empty; export it again", shown_path(path))]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The ending tells no format that is read here.
    #[error(
        "{}: unknown file ending \"{ending}\" for a {wanted}; surfaces are read from {}, meshes of tets from {}",
        shown_path(path),
        surface_endings(),
        tet_endings()
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

/// A path as it may stand in a message: on one line, whatever its name holds.
pub(crate) fn shown_path(path: &Path) -> String {
    text::on_one_line(&path.to_string_lossy())
}

/// `path:line`, or the path alone.
fn place(path: &Path, line: Option<usize>) -> String {
    match line {
        Some(line) => format!("{}:{line}", shown_path(path)),
        None => shown_path(path),
    }
}

/// What a file of a solid holds.
#[derive(Clone, Debug, PartialEq)]
pub enum SolidFile {
    /// The polygons of its surface.
    Surface(PolygonSoup),
    /// Tets that fill it.
    Tets(TetSoup),
}

/// Reads a solid, as a surface or as tets: a file of cells that has polygons and no volumes holds a surface.
///
/// # Errors
/// [`ReadError`], with the path and, where the format allows it, the line or the element.
pub fn read_solid(path: &Path) -> Result<SolidFile, ReadError> {
    read_solid_and_vectors(path).map(|(solid, _)| solid)
}

/// The same with the arrays of vectors on the points that a VTU file has.
fn read_solid_and_vectors(path: &Path) -> Result<(SolidFile, PointVectors), ReadError> {
    let Some(format) = TetFormat::of(path) else {
        return Ok((SolidFile::Surface(read_surface(path)?), PointVectors::new()));
    };
    let mut contents = read_cells(path, format)?;
    let vectors = std::mem::take(&mut contents.tets.point_vectors);
    if contents.is_surface() {
        Ok((SolidFile::Surface(contents.into_surface().map_err(at(path))?), vectors))
    } else {
        Ok((SolidFile::Tets(contents.tets.soup), vectors))
    }
}

/// Reads a surface; the file's ending (in any case) tells the format: OBJ, OFF, PLY, STL, VTP, GIFTI (`.gii`,
/// `.gii.gz`), or one that cells are read from, which then has to hold polygons and no volumes. A file of another ending is
/// FreeSurfer's if it begins as these do.
///
/// Polygons keep the file's order and are not checked but for their indices. Points are those of the file except that OBJ
/// and STL points with equal coordinates become one, since these formats (or their usual writers) repeat a point for each
/// face or texture seam.
///
/// # Errors
/// [`ReadError`], with the path and, where the format allows it, the line or the element.
pub fn read_surface(path: &Path) -> Result<PolygonSoup, ReadError> {
    let text = || text::plain(path, read_bytes(path)?);
    match (SurfaceFormat::of(path), TetFormat::of(path)) {
        (Some(SurfaceFormat::Obj), _) => obj::read(path, &text()?),
        (Some(SurfaceFormat::Off), _) => off::read(path, &text()?),
        (Some(SurfaceFormat::Ply), _) => ply::read(path, &text()?),
        (Some(SurfaceFormat::Stl), _) => stl::read(path, read_bytes(path)?),
        (Some(SurfaceFormat::Vtp), _) => vtk::parse_xml(&text()?).and_then(Contents::into_surface).map_err(at(path)),
        (Some(SurfaceFormat::Gifti), _) => {
            gifti::parse(&read_bytes(path)?).and_then(Contents::into_surface).map_err(at(path))
        }
        (Some(SurfaceFormat::FreeSurfer), _) => {
            freesurfer::parse(&read_bytes(path)?).and_then(Contents::into_surface).map_err(at(path))
        }
        (None, Some(format)) => read_cells(path, format)?.into_surface().map_err(at(path)),
        (None, None) => Err(unknown(path, "surface")),
    }
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
/// Tets keep the file's order and orientation. Cells of lower dimension are skipped and counted. Tets of higher order are
/// read as linear ones, hexahedra, prisms and pyramids split into tets, with a note; other volumes, which cannot be skipped
/// without a hole, are refused.
///
/// # Errors
/// [`ReadError`], with the path and, where the format allows it, the line.
pub fn read_tet_file(path: &Path) -> Result<TetFile, ReadError> {
    let format = TetFormat::of(path).ok_or_else(|| unknown(path, "mesh of tets"))?;
    read_cells(path, format)?.into_tets().map_err(at(path))
}

fn read_cells(path: &Path, format: TetFormat) -> Result<Contents, ReadError> {
    let text = || text::plain(path, read_bytes(path)?);
    match format {
        TetFormat::Medit | TetFormat::MeditBinary => medit::parse(&text()?).map_err(at(path)),
        TetFormat::Vtu => vtk::parse_xml(&text()?).map_err(at(path)),
        TetFormat::Pvtu => vtk::read_pieces(path, &text()?),
        TetFormat::Vtk => vtk::parse_legacy(&text()?).map_err(at(path)),
        TetFormat::Gmsh | TetFormat::Gmsh2 => gmsh::parse(&text()?).map_err(at(path)),
        TetFormat::TetGen => tetgen::read(path),
    }
}

/// A fault as an error of the file.
fn at(path: &Path) -> impl Fn(Fault) -> ReadError {
    move |(line, message)| ReadError::Malformed { path: path.into(), line, message }
}

fn unknown(path: &Path, wanted: &'static str) -> ReadError {
    ReadError::UnknownEnding { path: path.into(), ending: ending_of(path), wanted }
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

/// Vertices with a NaN or infinite coordinate and their lines: a fault only where something names one.
#[derive(Default)]
struct NotFinite(Vec<(usize, Option<usize>)>);

impl NotFinite {
    fn check(&mut self, vertex: usize, point: &Vec3, line: Option<usize>) {
        if !point.iter().all(|x| x.is_finite()) {
            self.0.push((vertex, line));
        }
    }

    /// Fails with the first of them that is named.
    fn refuse<'a>(&self, path: &Path, named: impl Iterator<Item = &'a VertexId>) -> Result<(), ReadError> {
        if self.0.is_empty() {
            return Ok(());
        }
        let named: HashSet<usize> = named.map(|v| v.index()).collect();
        match self.0.iter().find(|(vertex, _)| named.contains(vertex)) {
            Some(&(vertex, line)) => Err(ReadError::NotFinite { path: path.into(), line, vertex }),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests;

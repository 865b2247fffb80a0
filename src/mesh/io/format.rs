//! The formats and the endings that tell them.

use std::path::Path;

use super::freesurfer;

/// A format that surfaces are read from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SurfaceFormat {
    /// Wavefront OBJ.
    Obj,
    /// Geomview's Object File Format.
    Off,
    /// Stanford PLY.
    Ply,
    /// STL.
    Stl,
    /// VTK's XML file of polygons.
    Vtp,
    /// GIFTI, plain or packed by gzip.
    Gifti,
    /// FreeSurfer's binary triangles, such as `lh.pial`.
    FreeSurfer,
}

/// A format that meshes of tets are read from and written in; those but TetGen's may hold a surface instead.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TetFormat {
    /// Medit.
    Medit,
    /// Medit, binary; read only.
    MeditBinary,
    /// VTK's XML file of cells.
    Vtu,
    /// A list of such files; read only.
    Pvtu,
    /// VTK's legacy format.
    Vtk,
    /// Gmsh, written in version 4.1; read in any.
    Gmsh,
    /// Gmsh, written in version 2.2; read in any.
    Gmsh2,
    /// TetGen's pair of vertices and tets.
    TetGen,
}

const SURFACES: [(&str, SurfaceFormat); 7] = [
    ("obj", SurfaceFormat::Obj),
    ("off", SurfaceFormat::Off),
    ("ply", SurfaceFormat::Ply),
    ("stl", SurfaceFormat::Stl),
    ("vtp", SurfaceFormat::Vtp),
    ("gii", SurfaceFormat::Gifti),
    ("gii.gz", SurfaceFormat::Gifti),
];

const TETS: [(&str, TetFormat); 12] = [
    ("mesh", TetFormat::Medit),
    ("meshb", TetFormat::MeditBinary),
    ("vtu", TetFormat::Vtu),
    ("pvtu", TetFormat::Pvtu),
    ("vtk", TetFormat::Vtk),
    ("msh", TetFormat::Gmsh),
    ("msh4", TetFormat::Gmsh),
    ("msh41", TetFormat::Gmsh),
    ("msh2", TetFormat::Gmsh2),
    ("msh22", TetFormat::Gmsh2),
    ("node", TetFormat::TetGen),
    ("ele", TetFormat::TetGen),
];

impl SurfaceFormat {
    /// The format of a file by its ending, in any case; FreeSurfer's, which has none, by the first bytes of a file whose ending
    /// tells nothing else.
    pub fn of(path: &Path) -> Option<Self> {
        find(&SURFACES, path).or_else(|| {
            (TetFormat::of(path).is_none() && freesurfer::has_mark(path)).then_some(SurfaceFormat::FreeSurfer)
        })
    }
}

impl TetFormat {
    /// The format of a file by its ending, in any case.
    pub fn of(path: &Path) -> Option<Self> {
        find(&TETS, path)
    }
}

/// The endings that surfaces are read from, for messages; those of meshes may hold a surface too.
pub(super) fn surface_endings() -> String {
    SURFACES.map(|(ending, _)| format!(".{ending}")).join(", ") + " or FreeSurfer's files of any ending (lh.pial)"
}

/// The endings that meshes of tets are read from, for messages.
pub(super) fn tet_endings() -> &'static str {
    ".mesh or .meshb (Medit), .vtu, .pvtu, .vtk, .msh (Gmsh), .node or .ele (TetGen)"
}

fn find<Format: Copy>(known: &[(&str, Format)], path: &Path) -> Option<Format> {
    let ending = ending_of(path);
    known.iter().find(|(known, _)| *known == ending).map(|(_, format)| *format)
}

/// The file's ending in lower case, without the dot, and with the one before it if gzip added its own; empty if there is none.
pub(super) fn ending_of(path: &Path) -> String {
    let ending = |path: &Path| path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
    let last = ending(path).unwrap_or_default();
    match ending(&path.with_extension("")) {
        Some(before) if last == "gz" => before + ".gz",
        _ => last,
    }
}

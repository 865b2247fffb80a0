//! TetGen: the surface as a piecewise linear complex (.poly), sizes on a background mesh, the result in Medit's format.

use std::fmt::Write;
use std::fs;
use std::path::Path;

use super::process::Ended;
use super::sizing::SizeGrid;
use super::{ExternalError, ExternalMesher, ExternalSettings, Job};
use crate::mesh::TetSoup;
use crate::mesh::io::read_medit;
use crate::solid::Surface;

const MESHER: ExternalMesher = ExternalMesher::TetGen;

/// Runs TetGen once.
pub(super) fn mesh(job: &Job, max_volume: Option<f64>) -> Result<TetSoup, ExternalError> {
    fs::write(job.folder.join("surface.poly"), poly(job.surface)).map_err(ExternalError::Files)?;
    if let Some(sizes) = &job.sizes {
        write_background(sizes, job.folder).map_err(ExternalError::Files)?;
    }
    let ended = job.program.run(&[&switches(job, max_volume), "surface.poly"], job.folder)?;
    if !ended.status.success() {
        let words = explanation(job).unwrap_or(ended.words);
        return Err(ExternalError::Failed { mesher: MESHER, status: ended.status.to_string(), words });
    }
    let output = job.folder.join("surface.mesh");
    if !output.exists() {
        return Err(ExternalError::NoMesh { mesher: MESHER, words: ended.words });
    }
    let soup =
        read_medit(&output).map_err(|source| ExternalError::Unreadable { mesher: MESHER, source: source.into() })?;
    if soup.tets.is_empty() {
        return Err(ExternalError::NoMesh { mesher: MESHER, words: ended.words });
    }
    Ok(soup)
}

/// p: fill the complex; M: merge no facets; Y: keep its triangles; q: quality; a: volume; m: sizes; g: write Medit, whose 17 digits are
/// exact; N, E, F: none of the other files; I: no counter in the file's name.
fn switches(job: &Job, max_volume: Option<f64>) -> String {
    let settings = job.settings;
    // M: by default TetGen merges triangles that bend by less than 0.1 degree, and so changes the solid: three of 100 random
    // polyhedra lost up to 1e-6 of their volume.
    let mut switches = String::from("-pM");
    if settings.keep_boundary {
        switches.push('Y');
    }
    // Asked for quality over a kept boundary with sizes, TetGen 1.5 may abort (an assertion in scoutpoint): then only if
    // the user insists.
    let usual = (!settings.keep_boundary || job.sizes.is_none()).then_some(ExternalSettings::QUALITY);
    // Rust writes these numbers without exponents, so that no letter passes for a switch.
    if let Some(ratio) = settings.quality.or(usual) {
        switches += &format!("q{ratio}");
    }
    if let Some(volume) = max_volume {
        switches += &format!("a{volume}");
    }
    if job.sizes.is_some() {
        switches.push('m');
    }
    switches + "gNEFI"
}

/// Why TetGen failed. It leaves a surface that cuts through itself without a word; asked to detect intersections it
/// names the triangles, numbered from 1.
fn explanation(job: &Job) -> Option<String> {
    let Ended { status, words } = job.program.run(&["-dNEFI", "surface.poly"], job.folder).ok()?;
    (status.success() && words.contains("are intersecting") && !words.contains("No faces")).then_some(words)
}

/// The surface as TetGen's .poly, a facet for each triangle.
fn poly(surface: &Surface) -> String {
    let mut text = format!("{} 3 0 0\n", surface.points().len());
    for (number, p) in surface.points().iter().enumerate() {
        let _ = writeln!(text, "{number} {:e} {:e} {:e}", p.x, p.y, p.z);
    }
    let _ = writeln!(text, "{} 0", surface.triangles().len());
    for [a, b, c] in surface.triangles().iter().map(|triangle| triangle.map(|v| v.0)) {
        let _ = writeln!(text, "1\n3 {a} {b} {c}");
    }
    // No holes, no regions.
    text + "0\n0\n"
}

/// The sizes as a background mesh: nodes, tets, and a size for each node.
fn write_background(grid: &SizeGrid, folder: &Path) -> std::io::Result<()> {
    let (mut nodes, mut sizes) = (format!("{} 3 0 0\n", grid.sizes.len()), format!("{} 1\n", grid.sizes.len()));
    for (number, size) in grid.sizes.iter().enumerate() {
        let p = grid.position(number);
        let _ = writeln!(nodes, "{number} {:e} {:e} {:e}", p.x, p.y, p.z);
        let _ = writeln!(sizes, "{size:e}");
    }
    let mut tets = format!("{} 4 0\n", grid.tets().count());
    for (number, [a, b, c, d]) in grid.tets().enumerate() {
        let _ = writeln!(tets, "{number} {a} {b} {c} {d}");
    }
    fs::write(folder.join("surface.b.node"), nodes)?;
    fs::write(folder.join("surface.b.ele"), tets)?;
    fs::write(folder.join("surface.b.mtr"), sizes)
}

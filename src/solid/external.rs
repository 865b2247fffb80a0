//! TetGen and Gmsh as meshers: programs that are run on temporary files, never linked, for their licences (AGPL, GPL).
//!
//! Neither is trusted. TetGen of Debian dies by an uncaught exception where it should explain, Gmsh may stop half way
//! and write what it has, and both overshoot the volume they were given. So the mesh that comes back is measured here:
//! its volume against the surface's, its boundary against the surface's triangles, its largest tet against the limit.

mod error;
mod gmsh;
mod process;
mod result;
mod sizing;
mod tetgen;

pub use error::ExternalError;
pub use sizing::Sizing;

use std::path::PathBuf;
use std::time::Duration;

use super::{MOST_TETS, Surface};
use crate::cancel::Cancel;
use crate::mesh::{TetId, TetMesh, TetSoup, edge_matrix};
use process::Program;
use sizing::SizeGrid;

/// A mesher that is a program of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExternalMesher {
    /// TetGen 1.5 or later.
    TetGen,
    /// Gmsh 4.7 or later.
    Gmsh,
}

impl ExternalMesher {
    /// The name of the program on PATH.
    fn program(self) -> &'static str {
        match self {
            Self::TetGen => "tetgen",
            Self::Gmsh => "gmsh",
        }
    }

    /// The environment variable that may name the program.
    fn variable(self) -> &'static str {
        match self {
            Self::TetGen => "QCBALL_TETGEN",
            Self::Gmsh => "QCBALL_GMSH",
        }
    }
}

impl std::fmt::Display for ExternalMesher {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::TetGen => "TetGen",
            Self::Gmsh => "Gmsh",
        })
    }
}

/// What an external mesher is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct ExternalSettings {
    /// Which one.
    pub mesher: ExternalMesher,
    /// Its program: a path, or a name to be found on PATH. Without it the environment variable QCBALL_TETGEN or
    /// QCBALL_GMSH decides, else the usual name on PATH.
    pub program: Option<PathBuf>,
    /// No tet is larger, in the surface's units cubed.
    pub max_volume: Option<f64>,
    /// TetGen only: the ratio of circumradius to shortest edge that its refinement aims at, more than 1; a regular
    /// tet has 0.61. `None` is [`ExternalSettings::QUALITY`], or no aim where a boundary is kept and sizes are given.
    pub quality: Option<f64>,
    /// Whether the boundary is exactly the surface's triangles, instead of a refinement of them on the same faces.
    pub keep_boundary: bool,
    /// The wanted edge lengths.
    pub sizing: Option<Sizing>,
    /// The program, and all its further runs for one mesh, are ended after this.
    pub time_limit: Duration,
}

impl ExternalSettings {
    /// The usual radius-edge ratio. TetGen proves its end for 2 and ends in practice for 1.2 and more; 1.4 costs about
    /// a tenth more tets than 2.
    pub const QUALITY: f64 = 1.4;
    /// The usual time limit: TetGen makes 20,000 tets a second, and never ends if the quality is out of reach.
    pub const TIME_LIMIT: Duration = Duration::from_secs(120);

    /// A mesher with everything else as usual: boundary refined as needed, no limits on size.
    pub fn new(mesher: ExternalMesher) -> Self {
        Self {
            mesher,
            program: None,
            max_volume: None,
            quality: None,
            keep_boundary: false,
            sizing: None,
            time_limit: Self::TIME_LIMIT,
        }
    }

    fn check(&self, surface: &Surface) -> Result<(), ExternalError> {
        let refuse = |message: String| Err(ExternalError::Settings(message));
        if let Some(volume) = self.max_volume {
            if !(volume.is_finite() && volume > 0.0) {
                return refuse(format!("max_volume is {volume}, but must be a positive number"));
            }
            let tets = surface.volume() / volume;
            if tets > MOST_TETS as f64 {
                return refuse(format!(
                    "max_volume {volume} asks for more than {tets:.1e} tets; {MOST_TETS} are allowed"
                ));
            }
        }
        match (self.quality, self.mesher) {
            (Some(_), ExternalMesher::Gmsh) => return refuse("Gmsh takes no quality; TetGen does".into()),
            (Some(ratio), _) if !(ratio.is_finite() && ratio > 1.0) => {
                return refuse(format!("quality is {ratio}, but must be a number greater than 1"));
            }
            _ => {}
        }
        if self.mesher == ExternalMesher::TetGen && !self.keep_boundary {
            // A sheet of thickness 0.01 and two triangles a side takes TetGen 80,000 tets.
            let (volume, area) = (surface.volume(), surface.area());
            let tets = area.powi(3) / (volume * volume);
            if tets > MOST_TETS as f64 {
                return Err(ExternalError::TooThin { thickness: 2.0 * volume / area, tets });
            }
        }
        self.sizing.as_ref().map_or(Ok(()), |sizing| sizing.check().map_err(ExternalError::Settings))
    }
}

/// One mesh to be made: what the drivers of both programs work from.
struct Job<'a> {
    surface: &'a Surface,
    settings: &'a ExternalSettings,
    sizes: Option<SizeGrid>,
    program: Program,
    folder: &'a std::path::Path,
}

/// Fills a surface with tets by running an external program.
///
/// The mesh's boundary is the surface, triangle for triangle if it is to be kept, else with more vertices on the same
/// faces; that it is a ball is left to [`crate::Domain::new`]. The program is ended when `cancel` says so.
///
/// # Errors
/// [`ExternalError`], with the program's own words if it said any.
pub fn external_mesh(
    surface: &Surface,
    settings: &ExternalSettings,
    cancel: &Cancel,
) -> Result<TetMesh, ExternalError> {
    settings.check(surface)?;
    let program = Program::find(settings, cancel)?;
    let folder = tempfile::tempdir().map_err(ExternalError::Files)?;
    let sizes = settings.sizing.as_ref().map(|sizing| SizeGrid::new(surface, sizing));
    let job = Job { surface, settings, sizes, program, folder: folder.path() };
    let Some(limit) = settings.max_volume else { return job.mesh(None) };
    within(limit, &job)
}

/// Whether a mesh fills a surface as one that [`external_mesh`] returns does: the same volume, and a vertex at each of the
/// surface's.
///
/// # Errors
/// How it does not.
pub fn check_filled(mesh: &TetMesh, surface: &Surface, settings: &ExternalSettings) -> Result<(), ExternalError> {
    let soup = TetSoup { points: mesh.points().to_vec(), tets: mesh.tets().to_vec(), notes: Vec::new() };
    result::checked(soup, surface, settings).map(drop)
}

impl Job<'_> {
    fn mesh(&self, max_volume: Option<f64>) -> Result<TetMesh, ExternalError> {
        let soup = match self.settings.mesher {
            ExternalMesher::TetGen => tetgen::mesh(self, max_volume),
            ExternalMesher::Gmsh => gmsh::mesh(self, max_volume),
        }?;
        result::checked(soup, self.surface, self.settings)
    }
}

/// Asks for less than the limit until the limit holds: TetGen's last optimization enlarges tets by up to a half, and
/// Gmsh knows edge lengths only.
fn within(limit: f64, job: &Job) -> Result<TetMesh, ExternalError> {
    /// Four were the most that a boundary that may be refined has needed.
    const ATTEMPTS: usize = 8;
    /// On a coarse boundary that is kept no wish makes the tets on it small, but all others tiny and the run slow: so
    /// this is the least part of the limit that is asked for, and a wish that changes little is the last.
    const LEAST: f64 = 0.1;
    let (mut asked, mut best) = (limit, f64::INFINITY);
    for _ in 0..ATTEMPTS {
        let mesh = job.mesh(Some(asked))?;
        let largest = largest_volume(&mesh);
        if largest <= limit {
            return Ok(mesh);
        }
        let stuck = job.settings.keep_boundary && largest > 0.8 * best;
        best = best.min(largest);
        if stuck || asked <= LEAST * limit {
            break;
        }
        asked = (asked * (0.95 * limit / largest).max(0.3)).max(LEAST * limit);
    }
    Err(ExternalError::TooCoarse {
        mesher: job.settings.mesher,
        largest: best,
        limit,
        boundary_was_kept: job.settings.keep_boundary,
    })
}

fn largest_volume(mesh: &TetMesh) -> f64 {
    (0..mesh.tets().len() as u32).map(|tet| tet_volume(mesh, TetId(tet))).fold(0.0, f64::max)
}

fn tet_volume(mesh: &TetMesh, tet: TetId) -> f64 {
    edge_matrix(mesh.corners(tet)).determinant() / 6.0
}

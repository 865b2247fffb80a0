//! One run from plan to report: a call for each stage.

use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::bound;
use crate::config::{DomainSource, InitialMap, Plan};
use crate::domain::Domain;
use crate::map::{RadialCoordinates, bijectivity, caraman};
use crate::measure::{Measured, bottleneck, measure};
use crate::mesh::io::{ReadError, read_surface};
use crate::mesh::{TetId, TopologyError, Vec3};
use crate::optimize::{OptimizeError, Outcome, TraceRow, optimize};
use crate::report::{BestBound, DomainFigures, MapRecord, Report, Times};
use crate::solid::{CentreError, ShellError, SolidError, Surface, SurfaceError, shell_mesh, star_centre};

/// Relative distance below the largest K within which a tet counts as active.
const ACTIVE: f64 = 1e-3;

/// Why a run could not be made from its plan.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The surface file cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The file's polygons are no closed surface.
    #[error("{}: {source}", path.display())]
    Surface {
        /// The surface file.
        path: PathBuf,
        /// What is wrong with it.
        source: SurfaceError,
    },
    /// A named solid cannot be made with its parameters.
    #[error("the solid cannot be made: {0}")]
    Solid(#[from] SolidError),
    /// There is no star centre, or not the one asked for.
    #[error("{origin}: {source}")]
    Centre {
        /// The solid or its file.
        origin: String,
        /// Why the centre does not serve.
        source: CentreError,
    },
    /// No shell mesh.
    #[error("{origin}: {source}")]
    Shell {
        /// The solid or its file.
        origin: String,
        /// Why it cannot be meshed.
        source: ShellError,
    },
    /// The mesh is not a ball.
    #[error("{origin}: {source}")]
    Topology {
        /// The solid or its file.
        origin: String,
        /// What is wrong.
        source: TopologyError,
    },
    /// The optimisation could not start.
    #[error("{origin}: {source}")]
    Optimize {
        /// The solid or its file.
        origin: String,
        /// Why.
        source: OptimizeError,
    },
    /// The threads asked for cannot be had.
    #[error("cannot start {threads} threads: {message}; ask for fewer")]
    Threads {
        /// How many were asked for.
        threads: usize,
        /// The system's word.
        message: String,
    },
}

/// Everything a run leaves behind.
#[derive(Debug)]
pub struct Finished {
    /// The record.
    pub report: Report,
    /// The domain.
    pub domain: Domain,
    /// Image positions of the radial map.
    pub initial: Vec<Vec3>,
    /// The optimised positions and the trace.
    pub outcome: Outcome,
    /// The radial map, measured.
    pub measured_initial: Measured,
    /// The optimised map, measured.
    pub measured: Measured,
    /// The tets that attain the largest K.
    pub active: Vec<TetId>,
}

impl Finished {
    /// The maps behind the report.
    pub fn record(&self) -> MapRecord<'_> {
        MapRecord {
            domain: &self.domain,
            initial: &self.initial,
            image: &self.outcome.positions,
            measured_initial: &self.measured_initial,
            measured: &self.measured,
            active: &self.active,
            trace: &self.outcome.trace,
        }
    }
}

/// Runs a plan on as many threads as it asks for; `observe` sees every row of the trace as it comes.
///
/// # Errors
/// What is wrong with the input, before any optimisation; how an optimisation ends is data in the report.
pub fn run(plan: &Plan, observe: &mut (dyn FnMut(&TraceRow) + Send)) -> Result<Finished, RunError> {
    // Zero asks rayon for all cores.
    let threads = plan.threads.unwrap_or(0);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|error| RunError::Threads { threads, message: error.to_string() })?;
    pool.install(|| stages(plan, observe))
}

fn stages(plan: &Plan, observe: &mut dyn FnMut(&TraceRow)) -> Result<Finished, RunError> {
    let start = Instant::now();
    let (origin, surface) = surface(&plan.domain)?;
    let at = |origin: &String| origin.clone();
    let centre =
        star_centre(&surface, &plan.centre).map_err(|source| RunError::Centre { origin: at(&origin), source })?;
    let shell = shell_mesh(&surface, centre.position, &plan.mesh)
        .map_err(|source| RunError::Shell { origin: at(&origin), source })?;
    let coordinates = RadialCoordinates::of_shell(&shell);
    let domain = Domain::new(shell.mesh).map_err(|source| RunError::Topology { origin: at(&origin), source })?;
    let InitialMap::Radial { exponent } = plan.map;
    let initial = caraman(&coordinates, exponent);
    let measured_initial = measure(&domain, &initial);
    let outcome = optimize(&domain, &initial, domain.boundary().vertex_mask(), &plan.optimize, observe)
        .map_err(|source| RunError::Optimize { origin: at(&origin), source })?;
    let measured = measure(&domain, &outcome.positions);
    let active = measured.active(ACTIVE);
    let bounds = bound::all(&domain, &outcome.positions, Some(centre.position), true);
    let bijectivity = bijectivity(&domain, &outcome.positions);
    let report = Report {
        name: plan.name.clone(),
        version: Report::VERSION,
        revision: Report::REVISION,
        config: plan.source.path().display().to_string(),
        config_hash: plan.source.hash().to_string(),
        overrides: plan.source.overrides().map(String::from).collect(),
        seed: plan.seed,
        domain: DomainFigures::of(&domain, origin, Some(&centre)),
        initial: measured_initial.summary.clone(),
        last: measured.summary.clone(),
        bijective: bijectivity.bijective,
        bijective_reason: bijectivity.reason,
        active: active.len(),
        bottleneck: bottleneck(&domain, &measured),
        best: BestBound::of(&bounds, measured.summary.max_k),
        bounds,
        stop: outcome.stop,
        iterations: outcome.trace.len() - 1,
        warnings: warnings(&surface),
        config_text: plan.source.text().to_string(),
        times: Times { threads: rayon::current_num_threads(), seconds: start.elapsed().as_secs_f64() },
    };
    Ok(Finished { report, domain, initial, outcome, measured_initial, measured, active })
}

/// The surface of the solid and where it comes from, in words.
fn surface(source: &DomainSource) -> Result<(String, Surface), RunError> {
    match source {
        DomainSource::Solid(solid) => Ok((solid.to_string(), solid.surface()?)),
        DomainSource::File(path) => {
            let surface = read(path)?;
            Ok((path.display().to_string(), surface))
        }
    }
}

fn read(path: &Path) -> Result<Surface, RunError> {
    Surface::from_soup(read_surface(path)?).map_err(|source| RunError::Surface { path: path.into(), source })
}

fn warnings(surface: &Surface) -> Vec<String> {
    let mut warnings = Vec::new();
    if surface.was_inside_out() {
        warnings.push("the surface was inside out; all its triangles were reversed".into());
    }
    warnings
}

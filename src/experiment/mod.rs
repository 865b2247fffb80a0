//! One run from plan to report: a call for each stage.

mod corners;
mod error;
mod leave;
mod mesher;
mod optimize_map;
mod record;
mod splits;
mod start;
mod warped;

use std::time::{Duration, Instant};

use crate::bound::certificate::{self, Certificate};
use crate::bound::confront;
use crate::cancel::Cancel;
use crate::config::Plan;
use crate::domain::Domain;
use crate::map::Corners;
use crate::measure::Measured;
use crate::mesh::io::shown_path;
use crate::mesh::{MeshChanges, TetId, Unit, Vec3};
use crate::optimize::{
    Freed, OptimizeSettings, Outcome, Polish, StopReason, Tangled, TraceRow, Untangled, flipped_tets,
    free_and_optimize_one_of,
};
use crate::refine::{RefinedMap, Unrefined, refine};
use crate::report::{MapRecord, RefinedFigures, Report, Times, UntanglingFigures, trace_hash};

pub use error::{Fault, RunError};
pub use leave::run_or_leave;
pub(crate) use leave::{left_before_map, run_and_tell_or_leave};
pub use optimize_map::{GivenMap, OptimizedMap, optimize_map, read_locks};
pub(crate) use record::{Course, Heading, bounds, record};
pub(crate) use start::Start;

pub(crate) use warped::mirrors;
use warped::optimize_warped;

/// Relative distance below the largest K within which a tet counts as active.
const ACTIVE: f64 = 1e-3;

/// What untangling, optimization and refinement made of a start.
struct Optimized {
    untangled: Untangled,
    /// How many tets of the start were flipped before any edge was halved.
    flipped_before: usize,
    /// How many edges were halved where tets resisted.
    refinement_splits: usize,
    outcome: Outcome,
    refined: Option<RefinedFigures>,
    /// What refinement did to the mesh.
    changes: MeshChanges,
}

/// Everything a run leaves behind.
#[derive(Debug)]
pub struct Finished {
    /// The record.
    pub report: Report,
    /// The domain.
    pub domain: Domain,
    /// The corners of the map, with their exponents; `None` where it is piecewise linear.
    pub corners: Option<Corners>,
    /// What refinement did to the mesh.
    pub changes: MeshChanges,
    /// Image positions started from.
    pub initial: Vec<Vec3>,
    /// The optimised positions and the trace.
    pub outcome: Outcome,
    /// The map started from, measured.
    pub measured_initial: Measured,
    /// The optimised map, measured.
    pub measured: Measured,
    /// The tets that attain the largest K.
    pub active: Vec<TetId>,
    /// The certificate of the bound "gram", if the plan asks for one and one was found.
    pub certificate: Option<Certificate>,
    /// The units in which lengths of the domain and of the images are counted here; reports and files give them back.
    pub units: [Unit; 2],
}

impl Finished {
    /// The maps behind the report.
    pub fn record(&self) -> MapRecord<'_> {
        MapRecord {
            domain: &self.domain,
            corners: self.corners.as_ref(),
            changes: &self.changes,
            initial: &self.initial,
            image: &self.outcome.positions,
            measured_initial: &self.measured_initial,
            measured: &self.measured,
            active: &self.active,
            trace: &self.outcome.trace,
            certificate: self.certificate.as_ref(),
            units: self.units,
        }
    }
}

/// What a run does, in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Files are read.
    Reading,
    /// The solid is meshed, or read, and mapped to begin with.
    Starting,
    /// Flipped tets are freed, if there are any, and the map is optimized: this stage has rows.
    Optimizing,
    /// The maps are measured.
    Measuring,
    /// A certificate is searched for.
    Certifying,
    /// The bounds are computed.
    Bounding,
    /// All is gathered in the record.
    Recording,
    /// The files are written.
    Writing,
    /// The page is made.
    Page,
}

/// As progress names it.
impl std::fmt::Display for Stage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Reading => "reading",
            Self::Starting => "meshing and mapping to begin with",
            Self::Optimizing => "optimizing",
            Self::Measuring => "measuring",
            Self::Certifying => "searching for a certificate",
            Self::Bounding => "computing the bounds",
            Self::Recording => "gathering the record",
            Self::Writing => "writing",
            Self::Page => "making the page",
        })
    }
}

/// What a run tells while it goes on.
#[derive(Clone, Copy, Debug)]
pub enum Event<'a> {
    /// A stage begins.
    Stage(Stage),
    /// An iteration is done.
    Row(&'a TraceRow),
}

/// Runs a plan on as many threads as it asks for; `observe` sees every row of the trace as it comes.
///
/// # Errors
/// What is wrong with the input, before any optimisation; how an optimisation ends is data in the report.
pub fn run(plan: &Plan, observe: &mut (dyn FnMut(&TraceRow) + Send)) -> Result<Finished, RunError> {
    run_and_tell(plan, &mut |event| {
        if let Event::Row(row) = event {
            observe(row);
        }
    })
}

/// [`run`], which tells its stages too.
///
/// # Errors
/// As [`run`].
pub fn run_and_tell(plan: &Plan, tell: &mut (dyn FnMut(Event) + Send)) -> Result<Finished, RunError> {
    on_threads(plan.threads.unwrap_or(0), || stages(plan, tell))?
}

/// The most threads that are started, whoever asks for more.
const MOST_THREADS: usize = 1024;

/// What rayon itself takes from the environment, or one a core where that is absurd. Never 0, at which rayon would look there
/// again.
fn threads_of_environment() -> usize {
    let asked = std::env::var("RAYON_NUM_THREADS").ok().and_then(|text| text.parse().ok());
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    asked.filter(|asked| (1..=MOST_THREADS).contains(asked)).unwrap_or_else(cores)
}

/// Keeps rayon from starting as many threads as an absurd environment asks for where no pool was asked for. To be called once,
/// before anything runs in parallel.
pub(crate) fn heed_environment() {
    if std::env::var_os("RAYON_NUM_THREADS").is_some() {
        // It fails only if there is a pool already, which is none the worse.
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads_of_environment()).build_global();
    }
}

/// Does a job on a pool of that many threads; 0 for all cores.
///
/// # Errors
/// [`RunError::Threads`].
pub fn on_threads<T: Send>(threads: usize, job: impl FnOnce() -> T + Send) -> Result<T, RunError> {
    let asked = if threads == 0 { threads_of_environment() } else { threads };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(asked.min(MOST_THREADS)).build();
    let pool = pool.map_err(|error| RunError::Threads { threads, message: error.to_string() })?;
    Ok(pool.install(job))
}

/// What ends the measuring of one of the two maps of a run, from now on: either may take half the time limit again, or a second.
pub(crate) fn measuring_from_now(settings: &OptimizeSettings) -> Cancel {
    let limit = settings.time_limit.map(|limit| (limit / 2).max(Duration::from_secs(1)));
    limit.map_or_else(|| settings.cancel.clone(), |limit| settings.cancel.within(limit))
}

fn stages(plan: &Plan, tell: &mut dyn FnMut(Event)) -> Result<Finished, RunError> {
    let clock = Instant::now();
    tell(Event::Stage(Stage::Starting));
    let cancel = &plan.optimize.cancel;
    let mut start = Start::of(plan)?;
    tell(Event::Stage(Stage::Optimizing));
    let Optimized { untangled, flipped_before, refinement_splits, outcome, refined, changes } =
        optimized(&mut start, plan, &mut |row| tell(Event::Row(row))).map_err(RunError::at(&start.origin.clone()))?;
    tell(Event::Stage(Stage::Measuring));
    let domain = &start.domain;
    // With the exponents arrived at, where corners have any.
    let measuring = || match plan.onto_ball {
        // What was asked for is told after a signal as well.
        true => measuring_from_now(&plan.optimize).or_a_second_more(),
        false => measuring_from_now(&plan.optimize),
    };
    let measured_initial = start.measure(&start.image, &measuring());
    let measured = start.measure(&outcome.positions, &measuring());
    if plan.certify.is_some() {
        tell(Event::Stage(Stage::Certifying));
    }
    // What bounds and their proofs call tets, where corners are powers.
    let elements = start.corners.as_ref().map(|corners| corners.elements(domain).domain);
    let tets = elements.as_ref().unwrap_or(domain);
    let search = |limit| certificate::search(tets, &outcome.positions, &cancel.within(limit));
    let certificate = plan.certify.and_then(search);
    tell(Event::Stage(Stage::Bounding));
    let bounds = bounds(&start, &outcome.positions, certificate.as_ref(), cancel);
    tell(Event::Stage(Stage::Recording));
    let files = format!("{} and the files it names", shown_path(plan.source.path()));
    confront(&bounds, tets, &outcome.positions, &measured.summary, &files)?;
    let course = Course {
        untangling: UntanglingFigures::of(domain, flipped_before, &untangled, refinement_splits),
        refined,
        stop: interrupted(cancel).unwrap_or(outcome.stop),
        kkt: outcome.kkt,
        tolerance: Some(plan.optimize.effort.accuracy(plan.optimize.tolerance)),
        iterations: outcome.trace.len().saturating_sub(1),
        times: Times::since(clock, untangled.seconds),
    };
    let heading = Heading { name: &plan.name, seed: plan.seed, source: &plan.source };
    let report = record(
        &heading,
        &start,
        &outcome.positions,
        (&measured_initial, &measured),
        bounds,
        course,
        trace_hash(&outcome.trace),
    );
    let active = measured.active(ACTIVE);
    let Start { domain, image: initial, corners, units, .. } = start;
    Ok(Finished {
        report,
        domain,
        corners,
        changes,
        initial,
        outcome,
        measured_initial,
        measured,
        active,
        certificate,
        units,
    })
}

/// Untangles and optimizes the images of the vertices, and the exponents of corners if the plan leaves them open, and refines. The start is on
/// the refined domain afterwards, where edges were halved.
fn optimized(start: &mut Start, plan: &Plan, observe: &mut dyn FnMut(&TraceRow)) -> Result<Optimized, Fault> {
    // One time limit for all that follows, and one polish at its end.
    let timed = plan.optimize.starting_now();
    let polish = if plan.refine.is_some() { Polish::None } else { timed.polish };
    let first = Plan { optimize: OptimizeSettings { polish, ..timed.clone() }, ..plan.clone() };
    let linear = without_powers(start, &first);
    let mut optimized = settled(start, &first, observe)?;
    if let Some((other, of_other)) = linear {
        let judging = timed.cancel.or_a_second_more();
        let k_of = |start: &Start, optimized: &Optimized| {
            let summary = start.measure(&optimized.outcome.positions, &judging).summary;
            if plan.onto_ball { summary.ball_k.map_or(f64::INFINITY, |k| k.certified) } else { summary.max_k }
        };
        if k_of(&other, &of_other) < k_of(start, &optimized) {
            (*start, optimized) = (other, of_other);
            // The search of powers is what ended so.
            optimized.outcome.stop = StopReason::of(&timed.cancel).unwrap_or(optimized.outcome.stop);
        }
    }
    refined(start, optimized, plan, &timed, observe)
}

/// The map without powers, where exponents are sought on a mesh whose edges from corner to corner were halved for them: on a coarse one that
/// costs more than powers gain. What is wrong with it is of no account.
fn without_powers(start: &Start, plan: &Plan) -> Option<(Start, Optimized)> {
    if !start.seeks_powers_on_halves(plan) {
        return None;
    }
    let (plan, mut start) = Start::without_powers(plan).ok()?;
    let optimized = settled(&mut start, &plan, &mut |_| {}).ok()?;
    optimized.untangled.resisting.is_empty().then_some((start, optimized))
}

/// The same without refinement.
fn settled(start: &mut Start, plan: &Plan, observe: &mut dyn FnMut(&TraceRow)) -> Result<Optimized, Fault> {
    let settings = &plan.optimize;
    if start.corners.is_none() && !plan.symmetric && !plan.onto_ball {
        let tangled = |start: &Start| Tangled {
            domain: start.domain.clone(),
            start: start.image.clone(),
            second: start.second.clone(),
            fixed: None,
            may_refine: !plan.keep_mesh,
        };
        let others = [Start::in_spherical, Start::over_collar];
        let (freed, outcome) = free_and_optimize_one_of(start, &others, tangled, settings, observe)?;
        start.take_freed(&freed);
        let Freed { untangled, flipped_before, refinement_splits, .. } = freed;
        return Ok(Optimized {
            untangled,
            flipped_before,
            refinement_splits,
            outcome,
            refined: None,
            changes: MeshChanges::default(),
        });
    }
    let flipped_before = flipped_tets(&start.domain, &start.image).len();
    let (untangled, outcome, corners) = optimize_warped(start, plan, observe)?;
    start.corners = corners;
    let changes = MeshChanges::default();
    Ok(Optimized { untangled, flipped_before, refinement_splits: 0, outcome, refined: None, changes })
}

/// The same after the refinement that the plan asks for, if it does.
fn refined(
    start: &mut Start,
    optimized: Optimized,
    plan: &Plan,
    settings: &OptimizeSettings,
    observe: &mut dyn FnMut(&TraceRow),
) -> Result<Optimized, Fault> {
    let Some(refinement) = &plan.refine else { return Ok(optimized) };
    let tets_before = start.domain.mesh().tets().len();
    let Optimized { outcome, .. } = optimized;
    let map = Unrefined {
        domain: start.domain.clone(),
        start: start.image.clone(),
        outcome,
        corners: start.corners.clone(),
        centre: start.centre.map(|centre| centre.position),
    };
    let map = refine(map, settings, refinement, observe)?;
    (start.domain, start.image, start.corners) = (map.domain, map.start, map.corners);
    let RefinedMap { max_k_before, end, rounds, changes, outcome, .. } = map;
    let surface = refinement.surface;
    let refined = Some(RefinedFigures { tets_before, surface, max_k_before, end, rounds });
    Ok(Optimized { outcome, refined, changes, ..optimized })
}

/// The stop reason of a run that was interrupted at any stage: what was to follow is not whole.
fn interrupted(cancel: &Cancel) -> Option<StopReason> {
    cancel.is_raised().then_some(StopReason::Cancelled)
}

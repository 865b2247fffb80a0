//! One run from plan to report: a call for each stage.

mod error;
mod optimize_map;
mod start;

use std::time::Instant;

use crate::bound::certificate::{self, Certificate};
use crate::bound::{self, LowerBound};
use crate::config::Plan;
use crate::dilatation::lower_bound;
use crate::domain::Domain;
use crate::map::bijectivity;
use crate::measure::{Measured, bottleneck, measure};
use crate::mesh::{TetId, Vec3};
use crate::optimize::{Outcome, TraceRow, untangle_and_optimize};
use crate::report::{BestBound, DomainFigures, Limit, MapRecord, Report, Times, UntanglingFigures};

pub use error::{Fault, RunError};
pub use optimize_map::{GivenMap, OptimizedMap, optimize_map, read_locks};
use start::Start;

/// Relative distance below the largest K within which a tet counts as active.
const ACTIVE: f64 = 1e-3;

/// Everything a run leaves behind.
#[derive(Debug)]
pub struct Finished {
    /// The record.
    pub report: Report,
    /// The domain.
    pub domain: Domain,
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
            certificate: self.certificate.as_ref(),
        }
    }
}

/// Runs a plan on as many threads as it asks for; `observe` sees every row of the trace as it comes.
///
/// # Errors
/// What is wrong with the input, before any optimisation; how an optimisation ends is data in the report.
pub fn run(plan: &Plan, observe: &mut (dyn FnMut(&TraceRow) + Send)) -> Result<Finished, RunError> {
    on_threads(plan.threads.unwrap_or(0), || stages(plan, observe))?
}

/// Does a job on a pool of that many threads; 0 for all cores.
///
/// # Errors
/// [`RunError::Threads`].
pub fn on_threads<T: Send>(threads: usize, job: impl FnOnce() -> T + Send) -> Result<T, RunError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|error| RunError::Threads { threads, message: error.to_string() })?;
    Ok(pool.install(job))
}

fn stages(plan: &Plan, observe: &mut dyn FnMut(&TraceRow)) -> Result<Finished, RunError> {
    let clock = Instant::now();
    let Start { origin, domain, centre, image: initial, map, splits, mut warnings } = Start::of(plan)?;
    let measured_initial = measure(&domain, &initial);
    let fixed = domain.boundary().vertex_mask();
    let (untangled, outcome) =
        untangle_and_optimize(&domain, &initial, fixed, &plan.optimize, observe).map_err(RunError::at(&origin))?;
    let measured = measure(&domain, &outcome.positions);
    let active = measured.active(ACTIVE);
    let mut bounds = bound::all(&domain, &outcome.positions, centre.map(|c| c.position), centre.is_some());
    let certificate = plan.certify.and_then(|limit| certificate::search(&domain, &outcome.positions, limit));
    bounds.extend(certificate.as_ref().and_then(|found| certificate::bound(found, &domain, &outcome.positions).ok()));
    warnings.extend(locked_warning(&domain, &bounds));
    let bijectivity = bijectivity(&domain, &outcome.positions);
    let report = Report {
        name: plan.name.clone(),
        version: Report::VERSION,
        revision: Report::REVISION,
        config: plan.source.path().display().to_string(),
        config_hash: plan.source.hash().to_string(),
        overrides: plan.source.overrides().map(String::from).collect(),
        seed: plan.seed,
        domain: DomainFigures::of(&domain, origin, centre.as_ref()),
        splits,
        map,
        initial: measured_initial.summary.clone(),
        untangling: UntanglingFigures::of(&domain, measured_initial.summary.flipped, &untangled),
        last: measured.summary.clone(),
        bijective: bijectivity.bijective,
        bijective_reason: bijectivity.reason,
        active: active.len(),
        bottleneck: bottleneck(&domain, &measured),
        best: BestBound::of(&bounds, measured.summary.max_k),
        limit: Limit::of(measured.summary.max_k, &bounds, Some((outcome.stop, outcome.kkt))),
        bounds,
        stop: outcome.stop,
        kkt: outcome.kkt,
        iterations: outcome.trace.len().saturating_sub(1),
        warnings,
        config_text: plan.source.text().to_string(),
        times: Times::since(clock, untangled.seconds),
    };
    Ok(Finished { report, domain, initial, outcome, measured_initial, measured, active, certificate })
}

/// Names the tets that a kept mesh locks, and what they force.
fn locked_warning(domain: &Domain, bounds: &[LowerBound]) -> Option<String> {
    /// More of them would not be read.
    const NAMED: usize = 8;
    let locked: Vec<u32> = domain.locked_tets().map(|tet| tet.0).collect();
    let forced = bounds.iter().find(|bound| bound.name == "locked")?;
    let named: Vec<String> = locked.iter().take(NAMED).map(u32::to_string).collect();
    Some(format!(
        "{} tets are locked, all their vertices being on the boundary: {}{}; whatever the inside does, they force K >= {}",
        locked.len(),
        named.join(", "),
        if locked.len() > NAMED { ", ..." } else { "" },
        lower_bound(forced.value)
    ))
}

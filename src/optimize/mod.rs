//! Moving the free vertices: the continuation, its engines, stop reasons and the trace.
//!
//! The minimax problem min max K is approached through soft maxima E_p of growing exponent p and ended by a primal-dual
//! interior-point method. Every accepted step keeps all image determinants positive, so a bijective start stays one.

mod argmin_phase;
mod choices;
mod damping;
mod displacement;
mod engine;
#[cfg(feature = "nlopt")]
mod epigraph;
mod error;
mod interior_point;
mod line_search;
mod minimax;
mod newton;
mod polish;
mod recorder;
mod region;
mod untangle;
mod warped;

use std::sync::Arc;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::cancel::Cancel;
use crate::domain::Domain;
use crate::linalg::{Method, SparseError};
use crate::mesh::{TetId, Vec3};
use crate::objective::{Assembly, Freedom, Iterate, Unknowns, opening};
pub use choices::{BoundaryValues, Effort, Objective, Polish, Start};
pub use engine::{Engine, MOST_TETS_CONSERVATIVE, MOST_TETS_QUADRATIC};
pub use error::OptimizeError;
use minimax::Ending;
pub use recorder::KktResidual;
use recorder::{Observe, PhaseEnd, Progress, Recorder};
use region::Region;
pub use untangle::{
    Freed, Refined, Shapes, Tangled, Untangled, flipped_tets, free_and_optimize_one_of, refine_and_untangle, untangle,
    untangle_and_optimize, untangle_locally,
};
pub use warped::{BestExponents, Warped};

/// Exponents of the continuation, each phase started from the last. Steps of about three: with larger ones the next
/// phase starts far from its minimum and ends in a worse local one.
const EXPONENTS: [f64; 7] = [1.0, 4.0, 16.0, 48.0, 128.0, 384.0, 1024.0];
/// The exponents up to here come before the interior-point method. It ends at the same map from higher ones, later.
const LAST_BEFORE_MINIMAX: f64 = 16.0;
/// The same for the engines that solve the epigraph form themselves; with max K still in the hundreds, as at radial starts,
/// their linear and quadratic models lead nowhere.
const LAST_BEFORE_EPIGRAPH: f64 = 48.0;
/// Share of the time up to the interior-point method on the meshes of 10,000 tets tried: 0.1 to 0.4.
const SHARE_BEFORE_MINIMAX: f64 = 0.2;
/// Share of the time up to the last phase of a soft maximum; a rough guess is all a progress bar needs.
const SHARE_BEFORE_LAST_PHASE: f64 = 0.7;
/// Share of the largest ln K above which tets belong to the region that a soft maximum settled on a coarser mesh is lowered on, and the rings
/// of tets about it.
const SOFT_REGION: (f64, usize) = (0.6, 3);
/// Free vertices from which the soft maxima's and the polish's systems are solved iteratively: with 1,200 that takes 0.6 to
/// 0.9 of the time of all with a sparse factor on cube, icosa and tetra-10k, and 1.4 on bumpy-10k; with more, ever less.
const ITERATIVE_FROM: usize = 1000;
/// Distance from a sphere, relative to its radius, within which a vertex is on it: the digits of files.
const ON_SPHERE: f64 = 1e-5;
/// Share of the limits that is the polish's.
const POLISH_SHARE: f64 = 0.15;
/// Largest KKT residual that counts as optimal.
pub(crate) const OPTIMAL: f64 = 1e-6;
/// Fall in ln K of a step which ends all but the last phase: 2e-4 was found enough, ending earlier costs more than it
/// saves.
const PHASE_TOLERANCE: f64 = 2e-4;

/// The least opening that triangles may slide to, if they do not start below it: they reach 45 degrees about their normals, and the radial
/// map from their cones onto the ball has K <= 4.3 (see [`opening`]).
const LEAST_OPENING: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// The settings of one optimisation.
#[derive(Clone, Debug, PartialEq)]
pub struct OptimizeSettings {
    /// What is minimised.
    pub objective: Objective,
    /// By which algorithm.
    pub engine: Engine,
    /// What follows a settled [`Objective::Max`].
    pub polish: Polish,
    /// How far [`Polish::Mean`] may let max K rise, relative, > 0. Default: 2e-4. With 1e-3 the mean falls little further on solids with
    /// fixed boundary values (cube-10k 2.564 instead of 2.57), but max K then lies above that of peers that stop 5e-4 above ours.
    pub rise: f64,
    /// Whether the boundary slides.
    pub boundary_values: BoundaryValues,
    /// How much work the largest K is worth.
    pub effort: Effort,
    /// Accuracy in ln K at which the last phase ends, > 0; with [`Effort::Quick`] it ends at 5e-3 in any case.
    pub tolerance: f64,
    /// Most iterations over all phases, untangling not counted, which takes up to 1000 of its own, or so many where they are more; 0 does neither.
    pub max_iterations: usize,
    /// Most wall time of untangling and optimizing together; a run measures its two maps in as much again. Where it is set, results depend on the machine's speed.
    pub time_limit: Option<Duration>,
    /// Ends the optimisation from outside, or at a deadline.
    pub cancel: Cancel,
}

impl OptimizeSettings {
    /// The same settings with the time limit as the deadline of [`OptimizeSettings::cancel`], counted from now.
    pub(crate) fn starting_now(&self) -> Self {
        let cancel = self.time_limit.map_or_else(|| self.cancel.clone(), |limit| self.cancel.within(limit));
        Self { cancel, ..self.clone() }
    }
}

impl Default for OptimizeSettings {
    fn default() -> Self {
        Self {
            objective: Objective::Max,
            engine: Engine::Newton,
            polish: Polish::Mean,
            rise: 2e-4,
            boundary_values: BoundaryValues::Fixed,
            effort: Effort::Normal,
            tolerance: 1e-6,
            max_iterations: 1000,
            time_limit: None,
            cancel: Cancel::default(),
        }
    }
}

/// Why an optimisation ended. A reason, never an error: bad input is refused before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StopReason {
    /// The largest K is at a stationary point: the residual of the Karush-Kuhn-Tucker conditions is at most 1e-6.
    Optimal,
    /// The last phase ended because its steps gained less than the tolerance; how far from stationary, the KKT residual tells.
    Converged,
    /// The iteration limit was reached.
    IterationLimit,
    /// The time limit was reached.
    TimeLimit,
    /// It was cancelled from outside.
    Cancelled,
    /// No step along the search direction lowered the objective in the last phase; of K onto the ball, that of the start is the least found.
    NoProgress,
    /// There is no free vertex.
    NothingFree,
    /// Tets of the start could not be untangled, so nothing was optimised.
    StillFlipped,
}

impl StopReason {
    /// Which of the two ends work, if it is to end.
    pub fn of(cancel: &Cancel) -> Option<Self> {
        let due = if cancel.is_raised() { Self::Cancelled } else { Self::TimeLimit };
        cancel.is_due().then_some(due)
    }
}

/// As reports and tables spell it.
impl std::fmt::Display for StopReason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.serialize(f)
    }
}

/// One iteration, as the progress line, trace.csv and the plots show it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TraceRow {
    /// The phase, e.g. `"p=48"`.
    pub phase: Arc<str>,
    /// Iteration over all phases, from 1; row 0 is the start.
    pub iteration: usize,
    /// The phase's objective in units of ln K: E_p, or the bound of the minimax problem.
    pub objective: f64,
    /// Largest K of the positions after the step.
    pub max_k: f64,
    /// Mean K of the positions after the step.
    pub mean_k: f64,
    /// Accepted step length along the search direction.
    pub step: f64,
    /// The round of refinement ([`crate::refine`]), 0 before the first.
    pub round: usize,
    /// Estimated share of the run that is done, in [0, 1], by its phases.
    pub progress: f64,
    /// Seconds since the start.
    pub seconds: f64,
}

/// How an optimisation ended.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Image positions: for [`Objective::Max`] the iterate of least measured max K, polished if asked; for soft maxima the
    /// last one.
    pub positions: Vec<Vec3>,
    /// Why it ended.
    pub stop: StopReason,
    /// How far the minimax solution, before any polish, is from stationary; `None` where the minimax phase was not reached.
    pub kkt: Option<KktResidual>,
    /// The tets that hold the largest K where it is, each with the multiplier of its constraint; they add up to 1 about. Empty
    /// where the minimax phase was not reached.
    pub multipliers: Vec<(TetId, f64)>,
    /// One row an iteration, and row 0 for the start.
    pub trace: Vec<TraceRow>,
}

impl Outcome {
    /// The outcome of a start that was not untangled with these settings.
    pub(crate) fn still_flipped(positions: Vec<Vec3>, settings: &OptimizeSettings) -> Self {
        let of_no_step = (settings.max_iterations == 0).then_some(StopReason::IterationLimit);
        let stop = StopReason::of(&settings.cancel).or(of_no_step).unwrap_or(StopReason::StillFlipped);
        Self { positions, stop, kkt: None, multipliers: Vec::new(), trace: Vec::new() }
    }
}

/// Moves the vertices with `fixed[vertex] == false` from `start` so that the objective falls; `observe` sees each row.
///
/// # Errors
/// A flipped start, a system that cannot be held, or an engine that cannot do it.
pub fn optimize(
    domain: &Domain,
    start: &[Vec3],
    fixed: &[bool],
    settings: &OptimizeSettings,
    observe: &mut dyn FnMut(&TraceRow),
) -> Result<Outcome, OptimizeError> {
    optimize_from(Start::Anywhere, domain, start, fixed, settings, observe)
}

/// [`optimize`], shorter from a start of which something is known.
///
/// # Errors
/// As [`optimize`].
pub fn optimize_from(
    known: Start,
    domain: &Domain,
    start: &[Vec3],
    fixed: &[bool],
    settings: &OptimizeSettings,
    observe: &mut dyn FnMut(&TraceRow),
) -> Result<Outcome, OptimizeError> {
    let settings = &OptimizeSettings { tolerance: settings.effort.accuracy(settings.tolerance), ..settings.clone() };
    settings.engine.check(settings.objective, settings.boundary_values)?;
    settings.engine.check_size(domain.mesh().tets().len())?;
    let unknowns = unknowns(domain, start, fixed, settings.boundary_values)?;
    optimize_unknowns(known, domain, start, &unknowns, settings, &mut |row, _| observe(row))
}

/// [`optimize_from`] with what may move known.
fn optimize_unknowns(
    known: Start,
    domain: &Domain,
    start: &[Vec3],
    unknowns: &Unknowns,
    settings: &OptimizeSettings,
    observe: &mut Observe<'_>,
) -> Result<Outcome, OptimizeError> {
    let mut iterate = Iterate::new(domain, start.to_vec());
    let flipped = iterate.decompositions().iter().filter(|tet| tet.values[2] <= 0.0).count();
    if flipped > 0 {
        return Err(OptimizeError::FlippedStart(flipped));
    }
    let mut recorder = Recorder::new(&iterate, settings, observe);
    let as_it_is = |stop, trace| Outcome { positions: start.to_vec(), stop, kkt: None, multipliers: Vec::new(), trace };
    // The preparations take seconds on a million tets.
    if settings.cancel.is_raised() {
        return Ok(as_it_is(StopReason::Cancelled, recorder.rows));
    }
    let mut assembly = Assembly::new(domain, unknowns, method(unknowns))?;
    if let Some(triangle) = assembly.turned_triangle(start) {
        return Err(OptimizeError::TurnedTriangle(triangle.map(|v| v.0)));
    }
    if assembly.free().is_empty() {
        return Ok(as_it_is(StopReason::NothingFree, recorder.rows));
    }
    let polished = settings.objective == Objective::Max && settings.polish == Polish::Mean;
    recorder.reserve(if polished { POLISH_SHARE } else { 0.0 });
    if let Some(rise) = polish::reach(assembly.free().len(), settings.rise).filter(|_| polished) {
        recorder.keep_candidates(rise);
    }
    let mut direct = None;
    // Phases look at the limit after their first step.
    let (end, kkt) = if settings.max_iterations == 0 {
        (PhaseEnd::Interrupted, None)
    } else {
        continuation(&mut assembly, &mut direct, &mut iterate, known, settings, &mut recorder)?
    };
    let multipliers = std::mem::take(&mut recorder.multipliers);
    let mut stop = match end {
        PhaseEnd::Converged if kkt.is_some_and(|kkt| kkt.largest() <= OPTIMAL) => StopReason::Optimal,
        PhaseEnd::Converged => StopReason::Converged,
        PhaseEnd::NoProgress => StopReason::NoProgress,
        PhaseEnd::Interrupted => recorder.interruption(),
    };
    let mut image = iterate.into_image();
    if settings.objective == Objective::Max {
        image.clone_from(&recorder.best);
        recorder.reserve(0.0);
        // Below K = 1 there is nothing to gain; after a limit the map may still have a better mean, but not after a cancel.
        let gains = recorder.best_k.ln() > settings.tolerance && recorder.iterations_left() > 0;
        if polished && gains && stop != StopReason::Cancelled {
            let (end, lowered) =
                polish::lower_mean(&mut assembly, &mut direct, settings.rise, settings.tolerance, &mut recorder)?;
            if end == PhaseEnd::Interrupted {
                stop = recorder.interruption();
            }
            image = lowered;
        }
        if let Polish::Lexicographic { levels } = settings.polish
            && end == PhaseEnd::Converged
            && minimax::next_levels(&assembly, &mut image, levels, settings, &mut recorder)? == PhaseEnd::Interrupted
        {
            stop = recorder.interruption();
        }
    }
    Ok(Outcome { positions: image, stop, kkt, multipliers, trace: recorder.rows })
}

/// What varies.
fn unknowns(
    domain: &Domain,
    start: &[Vec3],
    fixed: &[bool],
    values: BoundaryValues,
) -> Result<Unknowns, OptimizeError> {
    if values == BoundaryValues::Fixed {
        return Ok(Unknowns::of_mask(fixed));
    }
    let boundary = domain.boundary().vertex_mask();
    let radius = |v: usize| start[v].norm();
    let first = (0..start.len()).find(|&v| boundary[v]).unwrap_or(0);
    let of_first = start.get(first).map_or(0.0, |p| p.norm());
    let off = |v: &usize| boundary[*v] && !((radius(*v) - of_first).abs() <= ON_SPHERE * of_first && of_first > 0.0);
    if let Some(vertex) = (0..start.len()).find(off) {
        return Err(OptimizeError::NotOnSphere {
            vertex: vertex as u32,
            radius: radius(vertex),
            first: first as u32,
            of_first,
        });
    }
    let freedom = |(&fixed, &on_boundary): (&bool, &bool)| match (fixed, on_boundary) {
        (_, true) => Freedom::OnSphere,
        (true, false) => Freedom::Fixed,
        (false, false) => Freedom::Free,
    };
    let openings =
        domain.boundary().triangles().iter().map(|t| opening(t.map(|v| &start[v.index()])).min(LEAST_OPENING));
    let freedom = fixed.iter().zip(boundary).map(freedom).collect();
    Ok(Unknowns::new(freedom).with_least_openings(openings.collect()))
}

/// How the soft maxima's Newton systems are solved.
fn method(unknowns: &Unknowns) -> Method {
    if unknowns.count() < ITERATIVE_FROM { Method::Direct } else { Method::Iterative }
}

fn continuation<'d>(
    assembly: &mut Assembly<'d>,
    direct: &mut Option<Assembly<'d>>,
    iterate: &mut Iterate,
    known: Start,
    settings: &OptimizeSettings,
    recorder: &mut Recorder<'_>,
) -> Result<(PhaseEnd, Option<KktResidual>), SparseError> {
    let phase =
        |assembly: &mut Assembly<'_>, iterate: &mut Iterate, exponent, tolerance, recorder: &mut Recorder<'_>| {
            match settings.engine.soft_max_solver() {
                None => newton::soft_max_phase(assembly, iterate, exponent, tolerance, recorder),
                Some(solver) => argmin_phase::soft_max_phase(solver, assembly, iterate, exponent, tolerance, recorder),
            }
        };
    let last = match settings.objective {
        Objective::Max if settings.engine.solves_epigraph() => LAST_BEFORE_EPIGRAPH,
        Objective::Max => LAST_BEFORE_MINIMAX,
        Objective::SoftMax(exponent) => exponent,
    };
    let share = match settings.objective {
        Objective::Max => SHARE_BEFORE_MINIMAX,
        Objective::SoftMax(_) => SHARE_BEFORE_LAST_PHASE,
    };
    // No K lies below 1.
    let perfect = |recorder: &Recorder<'_>| {
        let above = recorder.best_k.ln();
        let kkt = KktResidual { primal: 0.0, dual: 0.0, complementarity: above };
        (settings.objective == Objective::Max && above <= settings.tolerance)
            .then_some((PhaseEnd::Converged, Some(kkt)))
    };
    let settled = known == Start::Settled;
    let before =
        EXPONENTS.into_iter().filter(|&p| !settled && (p < last || settings.objective == Objective::Max && p == last));
    for (index, exponent) in before.clone().enumerate() {
        if let Some(end) = perfect(recorder) {
            return Ok(end);
        }
        recorder.progress = share * index as f64 / before.clone().count() as f64;
        // A phase that makes no progress is no reason to end: the next one has another objective.
        if phase(assembly, iterate, exponent, PHASE_TOLERANCE, recorder) == PhaseEnd::Interrupted {
            return Ok((PhaseEnd::Interrupted, None));
        }
    }
    recorder.progress = share;
    #[cfg(feature = "nlopt")]
    if let Some(algorithm) = epigraph::algorithm(settings.engine) {
        *iterate = assembly.at(recorder.best.clone());
        return Ok((epigraph::epigraph_phase(algorithm, assembly, iterate, settings.tolerance, recorder), None));
    }
    if let Objective::SoftMax(exponent) = settings.objective {
        // Regions have no boundary whose triangles could be watched.
        let part = settled && !assembly.unknowns().slides();
        let region = part
            .then(|| Region::of_large_dilatation(assembly, iterate.image(), SOFT_REGION.0, SOFT_REGION.1, usize::MAX));
        if let Some(region) = region.flatten() {
            let mut of_region = Assembly::new(&region.domain, &region.unknowns, method(&region.unknowns))?;
            let mut image = iterate.image().to_vec();
            let mut part = of_region.at(region.restrict(&image));
            recorder.part = Some(region.part.clone());
            let end = phase(&mut of_region, &mut part, exponent, settings.tolerance, recorder);
            recorder.part = None;
            region.extend(part.image(), &mut image);
            *iterate = assembly.at(image);
            return Ok((end, None));
        }
        return Ok((phase(assembly, iterate, exponent, settings.tolerance, recorder), None));
    }
    let mut image = iterate.image().to_vec();
    let ending = minimax::minimax(assembly, direct, &mut image, settings, recorder)?;
    *iterate = assembly.at(image);
    if let Ending::Settled(end, kkt) = ending {
        return Ok((end, kkt));
    }
    // Too many tets decide: higher exponents come nearer to the largest K in any case.
    for exponent in EXPONENTS.into_iter().filter(|&p| p > last && p <= settings.effort.last_exponent()) {
        if phase(assembly, iterate, exponent, PHASE_TOLERANCE, recorder) == PhaseEnd::Interrupted {
            return Ok((PhaseEnd::Interrupted, None));
        }
    }
    if assembly.unknowns().slides() && settle_inside(assembly, settings, recorder)? == PhaseEnd::Interrupted {
        return Ok((PhaseEnd::Interrupted, None));
    }
    Ok((PhaseEnd::Converged, None))
}

/// Settles the largest K for the places on the sphere that the boundary has slid to, if the vertices inside are few enough: a brain that
/// the soft maxima took to 2.95 comes to 2.85.
fn settle_inside(
    assembly: &Assembly<'_>,
    settings: &OptimizeSettings,
    recorder: &mut Recorder<'_>,
) -> Result<PhaseEnd, SparseError> {
    let mut inside = assembly.unknowns().clone();
    let on_sphere: Vec<usize> = (0..inside.vertices()).filter(|&v| inside.of(v) == Freedom::OnSphere).collect();
    on_sphere.into_iter().for_each(|v| inside.fix(v));
    if inside.count() == 0 {
        return Ok(PhaseEnd::Converged);
    }
    // Only what is decomposed and which vertices move is asked of it.
    let part = Assembly::new(assembly.domain(), &inside, Method::Iterative)?;
    let mut image = recorder.best.clone();
    let ending = minimax::minimax(&part, &mut None, &mut image, settings, recorder)?;
    // They are of another problem.
    recorder.multipliers.clear();
    Ok(match ending {
        Ending::Settled(PhaseEnd::Interrupted, _) => PhaseEnd::Interrupted,
        _ => PhaseEnd::Converged,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::fixtures::{cube, fan, split};

    #[test]
    fn the_inside_is_settled_as_with_a_boundary_that_is_fixed() {
        let domain = Domain::new(split(&fan(&cube(), Vec3::new(0.1, -0.2, 0.05)))).unwrap();
        let onto_sphere = |x: &Vec3| if x.amax() == 1.0 { x.normalize() } else { x * 0.5 };
        let start: Vec<Vec3> = domain.mesh().points().iter().map(onto_sphere).collect();
        let fixed = domain.boundary().vertex_mask();
        let settings = OptimizeSettings { polish: Polish::None, ..OptimizeSettings::default() };
        let expected = optimize(&domain, &start, fixed, &settings, &mut |_| {}).unwrap();
        let sliding = unknowns(&domain, &start, fixed, BoundaryValues::Sliding).unwrap();
        let mut observe = |_: &TraceRow, _: &[Vec3]| {};
        let mut recorder = Recorder::new(&Iterate::new(&domain, start.clone()), &settings, &mut observe);
        let assembly = Assembly::new(&domain, &sliding, method(&sliding)).unwrap();
        let end = settle_inside(&assembly, &settings, &mut recorder).unwrap();
        // Both to within the tolerance; a sliding boundary would leave less.
        let k = expected.trace.iter().map(|row| row.max_k).fold(f64::INFINITY, f64::min);
        assert!(end == PhaseEnd::Converged && (recorder.best_k / k - 1.0).abs() < 1e-5, "{} {k}", recorder.best_k);
        assert!((0..start.len()).all(|v| !fixed[v] || recorder.best[v] == start[v]));
        assert!(recorder.best_k < 0.99 * expected.trace[0].max_k);
    }
}

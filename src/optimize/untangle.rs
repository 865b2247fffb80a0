//! From a map with flipped tets to one without: the regularised energy of Garanzha et al. 2021 with their schedule.

mod freed;
mod local;
mod refine;

pub use freed::{Freed, Tangled, free_and_optimize_one_of, untangle_and_optimize};
pub use local::{Shapes, untangle_locally};
pub use refine::{Refined, refine_and_untangle};

use std::collections::HashSet;
use std::time::Instant;

use super::damping::Shift;
use super::line_search::{ARMIJO, dot, line_search};
use super::region::Region;
use super::{OptimizeError, OptimizeSettings, TraceRow};
use crate::domain::Domain;
use crate::mesh::{Orientation, TetId, Vec3, orientation};
use crate::objective::{Assembly, Iterate, Unknowns, Untangling};

/// Newton steps at one epsilon; more of them per epsilon do not pay, since the next epsilon changes the problem.
const STEPS: usize = 3;
/// Relative fall of the energy in one step below which the next epsilon is due.
const STALLED: f64 = 1e-3;

/// Rings of tets about the flipped ones that are moved first.
const RINGS: usize = 4;
/// Steps without a tet less that end the attempt. Starts that could be untangled at all took up to 82 steps in all (400 meshes
/// of random star shapes); where none can, as when all neighbours of a free vertex are fixed about an empty kernel, epsilon
/// would fall for ever.
const PATIENCE: usize = 120;

/// What untangling led to.
#[derive(Clone, Debug)]
pub struct Untangled {
    /// Image positions with the fewest flipped tets seen.
    pub positions: Vec<Vec3>,
    /// Tets that are still not positive by exact predicate; empty on success.
    pub resisting: Vec<TetId>,
    /// Number of Newton steps.
    pub iterations: usize,
    /// Wall time.
    pub seconds: f64,
}

impl Untangled {
    fn of_start(domain: &Domain, start: &[Vec3]) -> Self {
        let resisting = flipped_tets(domain, start);
        Self { positions: start.to_vec(), resisting, iterations: 0, seconds: 0.0 }
    }
}

/// Most steps of an attempt: none where nothing is to be done but measuring, else no fewer than are usual, since an optimization that is
/// cut short is of no use to a map with flipped tets.
fn most_steps(settings: &OptimizeSettings) -> usize {
    const USUAL: usize = 1000;
    if settings.max_iterations == 0 { 0 } else { settings.max_iterations.max(USUAL) }
}

/// Tets whose image is not positively oriented, by exact predicate.
pub fn flipped_tets(domain: &Domain, image: &[Vec3]) -> Vec<TetId> {
    (0..)
        .map(TetId)
        .zip(domain.mesh().tets())
        .filter(|(_, tet)| orientation(tet.map(|v| &image[v.index()])) != Orientation::Positive)
        .map(|(id, _)| id)
        .collect()
}

/// Moves the vertices with `fixed[vertex] == false` until every tet is positively oriented by exact predicate.
///
/// First those near the flipped tets alone; all of them if that does not suffice. Minimises the energy [`Untangling`] by projected Newton while epsilon falls by the paper's schedule, under which the
/// least determinant becomes positive after finitely many steps if each minimisation reduces the energy enough (their
/// Theorem 1). Either attempt ends after 1000 steps or more, see [`OptimizeSettings::max_iterations`], or 120 without gain, at the latest; both end at
/// the time limit or when cancelled. A start without a flip is returned as it is.
///
/// # Errors
/// [`OptimizeError::System`] if the Newton system cannot be held.
pub fn untangle(
    domain: &Domain,
    start: &[Vec3],
    fixed: &[bool],
    settings: &OptimizeSettings,
    observe: &mut dyn FnMut(&TraceRow),
) -> Result<Untangled, OptimizeError> {
    let mut best = Untangled::of_start(domain, start);
    if best.resisting.is_empty() {
        return Ok(best);
    }
    let settings = &settings.starting_now();
    let flipped: HashSet<usize> = best.resisting.iter().map(|tet| tet.index()).collect();
    let unknowns = Unknowns::of_mask(fixed);
    let near = Region::around(domain, &unknowns, &|t| flipped.contains(&t), RINGS, usize::MAX);
    if let Some(near) = near.filter(|near| !near.is_whole(unknowns.count())) {
        let part = attempt(&near.domain, &near.restrict(start), &near.unknowns, settings, observe)?;
        near.extend(&part.positions, &mut best.positions);
        best.resisting = part.resisting.iter().map(|tet| near.part.tets[tet.index()]).collect();
        (best.iterations, best.seconds) = (part.iterations, part.seconds);
    }
    if !best.resisting.is_empty() && !settings.cancel.is_due() {
        let before = (best.iterations, best.seconds);
        best = attempt(domain, &best.positions, &unknowns, settings, observe)?;
        best.iterations += before.0;
        best.seconds += before.1;
    }
    Ok(best)
}

/// One attempt, with all vertices that are not fixed, at a start with flipped tets.
fn attempt(
    domain: &Domain,
    start: &[Vec3],
    unknowns: &Unknowns,
    settings: &OptimizeSettings,
    observe: &mut dyn FnMut(&TraceRow),
) -> Result<Untangled, OptimizeError> {
    let mut best = Untangled::of_start(domain, start);
    let clock = Instant::now();
    let mut assembly = Assembly::new(domain, unknowns, super::method(unknowns))?;
    let mut iterate = assembly.at(start.to_vec());
    let mut shift = Shift::new();
    let mut epsilon = first_epsilon(&iterate);
    let (mut iterations, mut last_gain) = (0, 0);
    let goes_on = |iterations| iterations < most_steps(settings) && !settings.cancel.is_due();
    while goes_on(iterations) && iterations - last_gain < PATIENCE {
        let energy = Untangling { epsilon };
        let Some(before) = assembly.value(&energy, &iterate) else { break };
        let mut after = before;
        for _ in 0..STEPS {
            let Some((value, step)) = newton_step(&mut assembly, &energy, &mut iterate, after, &mut shift) else {
                break;
            };
            let fall = (after - value) / after;
            after = value;
            iterations += 1;
            best.iterations = iterations;
            best.seconds = clock.elapsed().as_secs_f64();
            let flipped = flipped_tets(domain, iterate.image());
            observe(&TraceRow {
                phase: format!("untangle, {} flipped", flipped.len()).into(),
                iteration: iterations,
                objective: value,
                max_k: if flipped.is_empty() { f64::NAN } else { f64::INFINITY },
                mean_k: f64::INFINITY,
                step,
                round: 0,
                progress: 0.0,
                seconds: best.seconds,
            });
            if flipped.len() < best.resisting.len() {
                best.positions.copy_from_slice(iterate.image());
                best.resisting = flipped;
                last_gain = iterations;
                if best.resisting.is_empty() {
                    return Ok(best);
                }
            }
            if fall < STALLED || settings.cancel.is_due() {
                break;
            }
        }
        let next = next_epsilon(epsilon, least_determinant(&iterate), after / before);
        if next <= 0.0 {
            break;
        }
        epsilon = next;
    }
    Ok(best)
}

/// A regularisation of the size of the worst flip, or of the mean determinant where that is larger.
fn first_epsilon(iterate: &Iterate) -> f64 {
    let mean = determinants(iterate).map(f64::abs).sum::<f64>() / iterate.decompositions().len() as f64;
    (1e-2 * mean).max(0.2 * least_determinant(iterate).abs())
}

fn determinants(iterate: &Iterate) -> impl Iterator<Item = f64> + '_ {
    iterate.decompositions().iter().map(|decomposition| decomposition.values.iter().product())
}

fn least_determinant(iterate: &Iterate) -> f64 {
    determinants(iterate).fold(f64::INFINITY, f64::min)
}

/// The schedule of Garanzha et al. 2021, eq. 7: sigma = max(1/10, 1 - F(new) / F(old)).
fn next_epsilon(epsilon: f64, least: f64, ratio: f64) -> f64 {
    let sigma = (1.0 - ratio).max(0.1);
    let root = least.hypot(epsilon);
    if least < 0.0 { (1.0 - sigma * root / (least.abs() + root)) * epsilon } else { (1.0 - sigma) * epsilon }
}

/// One projected Newton step with Armijo's rule; the new value and the step length, or `None` if nothing falls.
fn newton_step(
    assembly: &mut Assembly<'_>,
    energy: &Untangling,
    iterate: &mut Iterate,
    value: f64,
    shift: &mut Shift,
) -> Option<(f64, f64)> {
    let gradient = assembly.linearize(energy, iterate, 0.0)?;
    let direction = shift.newton_direction(assembly, &gradient)?;
    let slope = dot(&gradient, &direction);
    let (step, value, trial) = line_search(assembly, energy, iterate, &direction, 1.0, |trial, step| {
        trial <= value + ARMIJO * step * slope && trial < value
    })?;
    *iterate = trial;
    Some((value, step))
}

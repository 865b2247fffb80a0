//! The end of the minimax continuation: a path of logarithmic barrier problems in the positions and a bound on ln K.
//!
//! minimise w t - sum over tets and i of ln(t^2 - 9 l_i^2), t the bound, w growing from stage to stage. At a minimiser the
//! slacks' multipliers add up, so t lies within about (number of terms) / w of a stationary value of ln max K.

use super::newton::{PhaseEnd, dot, factorize_damped, less_negative, moved};
use super::{KktResidual, Progress, Recorder};
use crate::mesh::Vec3;
use crate::objective::{Assembly, Barrier};

/// Sufficient decrease of the Armijo rule.
const ARMIJO: f64 = 1e-4;
/// Halvings of a step before the line search gives up.
const HALVINGS: usize = 40;
/// Growth of the weight from stage to stage.
const WEIGHT_RATIO: f64 = 1.0 / 0.3;
/// Half of the squared Newton decrement at which a stage counts as centred: far inside the region of fast convergence of
/// a self-concordant barrier, though ours is one only in ln s.
const CENTRED: f64 = 0.15;
/// Most Newton steps a stage: where the projected Hessian is far from the true one a stage converges slowly, and the
/// next one gains more.
const STAGE_STEPS: usize = 60;
/// Steps in a row, each lowering the objective by less than twice the tolerance in ln K, that end a stage: with a thousand
/// active tets on a curved surface (bumpy.obj in shells) stages crawl for hundreds of steps to gain 1e-5.
const SLOW_STEPS: usize = 3;
/// Distance (in ln K) of the first bound above the present max K.
const FIRST_SLACK: f64 = 0.0005;

/// A Newton step in positions and bound.
struct Step {
    /// Value of the barrier's sum.
    value: f64,
    direction: Vec<f64>,
    bound_direction: f64,
    /// Derivative of the objective along the step, negative.
    slope: f64,
    /// Tangent of the central path: change of positions and bound for a unit change of weight.
    tangent: Vec<f64>,
    bound_tangent: f64,
    residual: Residual,
}

/// How far positions, bound and the multipliers 1 / (weight * slack) are from stationary.
#[derive(Clone, Copy)]
struct Residual {
    /// Norm of the multipliers' combined gradient in the positions, relative to the sum of its parts' norms.
    dual: f64,
    /// |1 - sum of the multipliers|.
    multipliers: f64,
}

/// Follows the path until the complementarity gap is below `tolerance`, then centres until the dual residual is, too.
///
/// Returns also the residual of the Karush-Kuhn-Tucker conditions at the end, unless nothing was solved.
pub(super) fn barrier_phase(
    assembly: &mut Assembly<'_>,
    image: &mut Vec<Vec3>,
    tolerance: f64,
    recorder: &mut Recorder<'_>,
) -> (PhaseEnd, Option<KktResidual>) {
    let Some(largest) = assembly.largest_log(image) else { return (PhaseEnd::NoProgress, None) };
    let mut bound = 3.0 * largest + FIRST_SLACK;
    // The weight for which the first bound is stationary.
    let Some((first, _)) = assembly.bound_derivatives(&Barrier { bound }, image) else {
        return (PhaseEnd::NoProgress, None);
    };
    let mut weight = -first;
    let terms = 6.0 * assembly.domain().mesh().tets().len() as f64;
    let last_weight = (terms / tolerance).max(weight);
    let (first_weight, share) = (weight, recorder.progress);
    // 1 for the true Hessian; less, down to 0, where it is indefinite.
    let mut negative = 1.0;
    let mut kkt = None;
    loop {
        let (mut previous, mut slow) = (f64::INFINITY, 0);
        for taken in 0.. {
            let Some(step) = newton_step(assembly, image, bound, weight, &mut negative) else {
                return (PhaseEnd::NoProgress, kkt);
            };
            let Residual { dual, multipliers } = step.residual;
            kkt = Some(KktResidual { primal: 0.0, dual: dual.max(multipliers), complementarity: terms / weight });
            let last = weight >= last_weight;
            // At the last weight rounding of the slacks decides how far the residual falls: go on while it halves.
            let residual = dual.max(multipliers);
            let centred = -step.slope < CENTRED && (!last || residual < 0.1 * tolerance || residual > 0.5 * previous);
            previous = residual;
            if (taken > 0 && centred) || slow == SLOW_STEPS || taken == STAGE_STEPS {
                if last {
                    return (PhaseEnd::Converged, kkt);
                }
                let next = (weight * WEIGHT_RATIO).min(last_weight);
                // The path is nearly linear in 1 / weight near its end.
                follow(assembly, image, &mut bound, &step, weight * (1.0 - weight / next));
                weight = next;
                recorder.progress =
                    1.0 - (1.0 - share) * (last_weight / weight).ln() / (last_weight / first_weight).ln();
                break;
            }
            let Some((length, fall, trial, trial_bound)) = line_search(assembly, image, bound, weight, &step) else {
                // Rounding decides: as centred as it gets.
                return (if last { PhaseEnd::Converged } else { PhaseEnd::NoProgress }, kkt);
            };
            (*image, bound) = (trial, trial_bound);
            slow = if fall < 2.0 * tolerance * weight { slow + 1 } else { 0 };
            if recorder.record("barrier", bound, length, image) == Progress::Stop {
                return (PhaseEnd::Interrupted, kkt);
            }
            negative = (2.0 * negative).clamp(0.02, 1.0);
        }
    }
}

/// Solves the bordered Newton system; lowers `negative` until it is positive definite.
fn newton_step(
    assembly: &mut Assembly<'_>,
    image: &[Vec3],
    bound: f64,
    weight: f64,
    negative: &mut f64,
) -> Option<Step> {
    let barrier = Barrier { bound };
    let value = assembly.value(&barrier, image)?;
    let mixed = assembly.mixed_gradient(&barrier, image)?;
    let (first, second) = assembly.bound_derivatives(&barrier, image)?;
    loop {
        let gradient = factorize_damped(assembly, &barrier, image, negative)?;
        let mut by_bound = mixed.clone();
        assembly.system().solve(&mut by_bound);
        let schur = second - dot(&mixed, &by_bound);
        if schur > 0.0 {
            let mut by_position = gradient.clone();
            assembly.system().solve(&mut by_position);
            let bound_gradient = weight + first;
            let bound_direction = -(bound_gradient - dot(&mixed, &by_position)) / schur;
            let direction: Vec<f64> =
                by_position.iter().zip(&by_bound).map(|(u, w)| -u - w * bound_direction).collect();
            let slope = dot(&gradient, &direction) + bound_gradient * bound_direction;
            if slope < 0.0 {
                let bound_tangent = -1.0 / schur;
                let tangent: Vec<f64> = by_bound.iter().map(|w| -w * bound_tangent).collect();
                let residual = Residual {
                    dual: gradient.iter().map(|g| g * g).sum::<f64>().sqrt() / assembly.gradient_scale(),
                    multipliers: (bound_gradient / weight).abs(),
                };
                return Some(Step { value, direction, bound_direction, slope, tangent, bound_tangent, residual });
            }
        }
        *negative = less_negative(*negative)?;
    }
}

/// Halves the Newton step until it passes Armijo's rule, or doubles it as long as that lowers the objective further: where the
/// damped Hessian is far above the true one the step is too short by any factor.
fn line_search(
    assembly: &Assembly<'_>,
    image: &[Vec3],
    bound: f64,
    weight: f64,
    step: &Step,
) -> Option<(f64, f64, Vec<Vec3>, f64)> {
    let total = step.value + weight * bound;
    let attempt = |length: f64| {
        let trial = moved(assembly, image, &step.direction, length);
        let trial_bound = bound + length * step.bound_direction;
        let value = assembly.value(&Barrier { bound: trial_bound }, &trial)? + weight * trial_bound;
        (value <= total + ARMIJO * length * step.slope).then_some((value, (length, trial, trial_bound)))
    };
    let mut length = 1.0;
    for _ in 0..HALVINGS {
        if let Some((mut value, mut accepted)) = attempt(length) {
            while accepted.0 >= 1.0
                && let Some((longer_value, longer)) = attempt(2.0 * accepted.0)
                && longer_value < value
            {
                (value, accepted) = (longer_value, longer);
            }
            let (length, trial, trial_bound) = accepted;
            return Some((length, total - value, trial, trial_bound));
        }
        length *= 0.5;
    }
    None
}

/// Moves along the central path's tangent by `change` of the weight, or as far as the barrier stays finite.
fn follow(assembly: &Assembly<'_>, image: &mut Vec<Vec3>, bound: &mut f64, step: &Step, change: f64) {
    let mut length = change;
    for _ in 0..HALVINGS {
        let trial = moved(assembly, image, &step.tangent, length);
        let trial_bound = *bound + length * step.bound_tangent;
        if assembly.value(&Barrier { bound: trial_bound }, &trial).is_some() {
            (*image, *bound) = (trial, trial_bound);
            return;
        }
        length *= 0.7;
    }
}

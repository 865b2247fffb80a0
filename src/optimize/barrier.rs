//! The end of the minimax continuation: a path of logarithmic barrier problems in the positions and a bound on ln K.
//!
//! minimise w t - sum over tets and i of ln(t^2 - 9 l_i^2), t the bound, w growing from stage to stage. At a minimiser the
//! slacks' multipliers add up, so t lies within about (number of terms) / w of a stationary value of ln max K.

use super::newton::{PhaseEnd, dot, moved};
use super::{Progress, Recorder};
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
}

/// Follows the path until the bound is within `tolerance` of its limit, by the estimate above.
pub(super) fn barrier_phase(
    assembly: &mut Assembly<'_>,
    image: &mut Vec<Vec3>,
    tolerance: f64,
    recorder: &mut Recorder<'_>,
) -> PhaseEnd {
    let Some(largest) = assembly.largest_log(image) else { return PhaseEnd::NoProgress };
    let mut bound = 3.0 * largest + FIRST_SLACK;
    // The weight for which the first bound is stationary.
    let Some((first, _)) = assembly.bound_derivatives(&Barrier { bound }, image) else { return PhaseEnd::NoProgress };
    let mut weight = -first;
    // Of a tet's six factors t - 3 l_i and t + 3 l_i at most two can be active together, and few tets are.
    let last_weight = 2.0 * assembly.domain().mesh().tets().len() as f64 / tolerance;
    let (first_weight, share) = (weight, recorder.progress);
    // 1 for the true Hessian; less, down to 0, where it is indefinite.
    let mut negative = 1.0;
    loop {
        for taken in 0.. {
            let Some(step) = newton_step(assembly, image, bound, weight, &mut negative) else {
                return PhaseEnd::NoProgress;
            };
            if (taken > 0 && -step.slope < CENTRED) || taken == STAGE_STEPS {
                if weight >= last_weight {
                    return PhaseEnd::Converged;
                }
                let next = (weight * WEIGHT_RATIO).min(last_weight);
                // The path is nearly linear in 1 / weight near its end.
                follow(assembly, image, &mut bound, &step, weight * (1.0 - weight / next));
                weight = next;
                recorder.progress =
                    1.0 - (1.0 - share) * (last_weight / weight).ln() / (last_weight / first_weight).ln();
                break;
            }
            let Some((length, trial, trial_bound)) = line_search(assembly, image, bound, weight, &step) else {
                return PhaseEnd::NoProgress;
            };
            (*image, bound) = (trial, trial_bound);
            if recorder.record("barrier", bound, length, image) == Progress::Stop {
                return PhaseEnd::Interrupted;
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
        let gradient = assembly.linearize(&barrier, image, *negative)?;
        let system = assembly.system();
        // Rounding of a semidefinite matrix; far below the barrier's own curvature.
        system.shift_diagonal(1e-14 * system.largest_diagonal());
        if system.factorize().is_ok() {
            let mut by_bound = mixed.clone();
            system.solve(&mut by_bound);
            let schur = second - dot(&mixed, &by_bound);
            if schur > 0.0 {
                let mut by_position = gradient.clone();
                system.solve(&mut by_position);
                let bound_gradient = weight + first;
                let bound_direction = -(bound_gradient - dot(&mixed, &by_position)) / schur;
                let direction: Vec<f64> =
                    by_position.iter().zip(&by_bound).map(|(u, w)| -u - w * bound_direction).collect();
                let slope = dot(&gradient, &direction) + bound_gradient * bound_direction;
                let bound_tangent = -1.0 / schur;
                let tangent: Vec<f64> = by_bound.iter().map(|w| -w * bound_tangent).collect();
                if slope < 0.0 {
                    return Some(Step { value, direction, bound_direction, slope, tangent, bound_tangent });
                }
            }
        }
        if *negative == 0.0 {
            return None;
        }
        *negative = if *negative > 0.02 { 0.3 * *negative } else { 0.0 };
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
) -> Option<(f64, Vec<Vec3>, f64)> {
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
            return Some(accepted);
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

//! Projected Newton on the soft maximum at one exponent.

use super::damping::{Damping, Shift};
use super::line_search::{ARMIJO, dot, line_search};
use super::recorder::PhaseEnd;
use super::{Progress, Recorder};
use crate::linalg::REDUCTION;
use crate::objective::{Assembly, Iterate, SoftMax};

/// Longest multiple of the Newton step tried: ln of a sum has a negative rank-one term that makes the projected Newton
/// step too short by the factor that Sherman-Morrison gives, which is unbounded.
const LONGEST_STEP: f64 = 10.0;

/// Steps of a phase after which the tets' negative curvature is kept as well: without it, steps at a map of thin tets are hundreds of times
/// too short. The first steps, from farther away, are better without.
const PATIENCE: usize = 20;
/// Free vertices above which iterative solves are left at a larger share of the residual, and that share: with 40,000 the phases take
/// a step more in half the time. Below, more steps cost as much as is saved.
pub(super) const LARGE: usize = 20_000;
const ROUGH: f64 = 0.1;

/// Minimises E_p from `iterate` until a step lowers it by less than `tolerance` (in ln K).
pub(super) fn soft_max_phase(
    assembly: &mut Assembly<'_>,
    iterate: &mut Iterate,
    exponent: f64,
    tolerance: f64,
    recorder: &mut Recorder<'_>,
) -> PhaseEnd {
    let phase = format!("p={exponent}");
    let mut shift = Shift::new();
    let mut damping = Damping::new(assembly);
    let mut steps = 0;
    let reduction = if assembly.free().len() > LARGE { ROUGH } else { REDUCTION };
    assembly.system().end_at(reduction, recorder.cancel());
    loop {
        let Some(largest) = iterate.largest_log() else { return PhaseEnd::NoProgress };
        let energy = SoftMax::new(exponent, largest);
        let Some(sum) = assembly.value(&energy, iterate) else { return PhaseEnd::NoProgress };
        let newton = if steps < PATIENCE {
            assembly.linearize(&energy, iterate, 0.0).and_then(|gradient| {
                let direction = shift.newton_direction(assembly, &gradient)?;
                Some((gradient, direction))
            })
        } else {
            damping.newton_direction(assembly, &energy, iterate)
        };
        let Some((gradient, direction)) = newton else { return PhaseEnd::NoProgress };
        // A solve that was cut short is no direction to search along.
        if recorder.cancel().is_due() {
            return PhaseEnd::Interrupted;
        }
        steps += 1;
        let decrement = -dot(&gradient, &direction) / sum;
        if decrement <= 0.0 {
            return PhaseEnd::Converged;
        }
        let longest = if decrement < 1.0 - 1.0 / LONGEST_STEP { 1.0 / (1.0 - decrement) } else { LONGEST_STEP };
        let value = sum.ln();
        let accepted = line_search(assembly, &energy, iterate, &direction, longest, |trial, step| {
            trial.ln() <= value - ARMIJO * step * decrement
        });
        let Some((step, trial_sum, trial)) = accepted else { return PhaseEnd::NoProgress };
        *iterate = trial;
        let fall = energy.log_k(sum) - energy.log_k(trial_sum);
        if recorder.record(&phase, energy.log_k(trial_sum), step, iterate) == Progress::Stop {
            return PhaseEnd::Interrupted;
        }
        if fall < tolerance {
            return PhaseEnd::Converged;
        }
    }
}

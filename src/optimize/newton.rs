//! Projected Newton on the soft maximum at one exponent.

use super::damping::Shift;
use super::line_search::{ARMIJO, dot, line_search};
use super::recorder::PhaseEnd;
use super::{Progress, Recorder};
use crate::objective::{Assembly, Iterate, SoftMax};

/// Longest multiple of the Newton step tried: ln of a sum has a negative rank-one term that makes the projected Newton
/// step too short by the factor that Sherman-Morrison gives, which is unbounded.
const LONGEST_STEP: f64 = 10.0;

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
    assembly.system().heed(recorder.cancel());
    loop {
        let Some(largest) = iterate.largest_log() else { return PhaseEnd::NoProgress };
        let energy = SoftMax::new(exponent, largest);
        let (Some(sum), Some(gradient)) = (assembly.value(&energy, iterate), assembly.linearize(&energy, iterate, 0.0))
        else {
            return PhaseEnd::NoProgress;
        };
        let Some(direction) = shift.newton_direction(assembly, &gradient) else { return PhaseEnd::NoProgress };
        // A solve that was cut short is no direction to search along.
        if recorder.cancel().is_due() {
            return PhaseEnd::Interrupted;
        }
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

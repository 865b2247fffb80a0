//! The end of the minimax continuation: a logarithmic barrier in the positions and a bound on ln K.

use super::newton::{PhaseEnd, dot, factorize_shifted, moved};
use super::{Progress, Recorder};
use crate::mesh::Vec3;
use crate::objective::{Assembly, Barrier};

const ARMIJO: f64 = 1e-4;
const HALVINGS: usize = 30;

/// Minimises `t / mu - sum ln(t^2 - 9 l^2)` over positions and the bound t on ln K, mu falling from stage to stage.
pub(super) fn barrier_phase(
    assembly: &mut Assembly<'_>,
    image: &mut Vec<Vec3>,
    recorder: &mut Recorder<'_>,
) -> PhaseEnd {
    let Some(largest) = assembly.largest_log(image) else { return PhaseEnd::NoProgress };
    let mut bound = 3.0 * largest + 0.003;
    let Some((first, _)) = assembly.bound_derivatives(&Barrier { bound }, image) else { return PhaseEnd::NoProgress };
    let mut weight = -first;
    let target = 1e5 * assembly.domain().mesh().tets().len() as f64;
    loop {
        let mut small = 0;
        loop {
            let barrier = Barrier { bound };
            let (Some(value), Some(gradient), Some(mixed), Some((first, second))) = (
                assembly.value(&barrier, image),
                assembly.linearize(&barrier, image),
                assembly.mixed_gradient(&barrier, image),
                assembly.bound_derivatives(&barrier, image),
            ) else {
                return PhaseEnd::NoProgress;
            };
            if factorize_shifted(assembly).is_none() {
                return PhaseEnd::NoProgress;
            }
            let mut by_position = gradient.clone();
            assembly.system().solve(&mut by_position);
            let mut by_bound = mixed.clone();
            assembly.system().solve(&mut by_bound);
            let bound_gradient = weight + first;
            let mut schur = second - dot(&mixed, &by_bound);
            if schur <= 1e-14 * second {
                if std::env::var_os("DBG").is_some() {
                    eprintln!("schur {schur} second {second}");
                }
                schur = second; // decouple
                by_bound.iter_mut().for_each(|x| *x = 0.0);
            }
            let bound_step = -(bound_gradient - dot(&mixed, &by_position)) / schur;
            let bound_step = if by_bound.iter().all(|x| *x == 0.0) { -bound_gradient / schur } else { bound_step };
            let direction: Vec<f64> = by_position.iter().zip(&by_bound).map(|(u, w)| -u - w * bound_step).collect();
            let slope = dot(&gradient, &direction) + bound_gradient * bound_step;
            if slope >= 0.0 {
                return PhaseEnd::NoProgress;
            }
            let total = value + weight * bound;
            let mut step = 1.0;
            let mut accepted = None;
            for _ in 0..HALVINGS {
                let trial = moved(assembly, image, &direction, step);
                let trial_bound = bound + step * bound_step;
                if let Some(trial_value) = assembly.value(&Barrier { bound: trial_bound }, &trial) {
                    if trial_value + weight * trial_bound <= total + ARMIJO * step * slope {
                        accepted = Some((trial, trial_bound));
                        break;
                    }
                }
                step *= 0.5;
            }
            let Some((trial, trial_bound)) = accepted else { return PhaseEnd::NoProgress };
            *image = trial;
            bound = trial_bound;
            if recorder.record("barrier", bound, step, image) == Progress::Stop {
                return PhaseEnd::Interrupted;
            }
            if std::env::var_os("DBG").is_some() {
                eprintln!("slope {slope:.3e} weight {weight:.3e} step {step}");
            }
            small += 1;
            if -slope < 0.5 || small > 15 {
                break;
            }
        }
        if weight > target {
            return PhaseEnd::Converged;
        }
        weight /= 0.3;
    }
}

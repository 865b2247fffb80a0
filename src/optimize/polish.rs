//! After the bottleneck: lower the mean under a cap on the largest K.

use super::newton::{PhaseEnd, dot, factorize_damped, line_search};
use super::{Progress, Recorder};
use crate::objective::{Assembly, CappedMean, Iterate};

/// How far the cap on K lies above the largest K that was reached, relative to it. With 1e-3 the mean falls little further
/// (cube-10k 2.564 instead of 2.57), but max K then lies above that of peers that stop 5e-4 above ours.
pub(super) const CAP: f64 = 2e-4;
/// Weights of the mean against the cap's barrier. A tet has six barrier terms, so at the last weight the mean lies within
/// about 6 / 1000 of the least one under the cap, relative to a K of 1.
const WEIGHTS: [f64; 4] = [1.0, 10.0, 100.0, 1000.0];
/// Half of the squared Newton decrement, per tet, at which a weight's stage ends: far below the bias of the last weight.
const CENTRED: f64 = 1e-5;
/// Most Newton steps a weight.
const STAGE_STEPS: usize = 25;
/// Sufficient decrease of the Armijo rule.
const ARMIJO: f64 = 1e-4;

/// Minimises the sum of K_I + K_O (up to terms of order 1) under K <= exp(cap) for every tet, from `iterate` inside the cap.
pub(super) fn lower_mean(
    assembly: &mut Assembly<'_>,
    iterate: &mut Iterate,
    cap: f64,
    recorder: &mut Recorder<'_>,
) -> PhaseEnd {
    let centred = CENTRED * assembly.domain().mesh().tets().len() as f64;
    let mut negative = 1.0;
    for (stage, weight) in WEIGHTS.into_iter().enumerate() {
        recorder.progress = 1.0 - 0.1 * (1.0 - stage as f64 / WEIGHTS.len() as f64);
        let energy = CappedMean { weight, cap };
        for _ in 0..STAGE_STEPS {
            let Some(value) = assembly.value(&energy, iterate) else { return PhaseEnd::NoProgress };
            let Some(gradient) = factorize_damped(assembly, &energy, iterate, &mut negative, 0.0) else {
                return PhaseEnd::NoProgress;
            };
            let mut direction: Vec<f64> = gradient.iter().map(|g| -g).collect();
            assembly.system().solve(&mut direction);
            let slope = dot(&gradient, &direction);
            if -slope < centred {
                break;
            }
            let accepted = line_search(assembly, &energy, iterate, &direction, 1.0, |trial, step| {
                trial <= value + ARMIJO * step * slope
            });
            let Some((step, trial_value, trial)) = accepted else { break };
            *iterate = trial;
            let mean = trial_value / (weight * assembly.domain().mesh().tets().len() as f64);
            if recorder.record("mean", mean.ln(), step, iterate) == Progress::Stop {
                return PhaseEnd::Interrupted;
            }
            negative = (2.0 * negative).clamp(0.02, 1.0);
        }
    }
    PhaseEnd::Converged
}

//! After the bottleneck: lower the mean under a cap on the largest K.

use super::damping::NegativeShare;
use super::line_search::{ARMIJO, dot, line_search};
use super::recorder::PhaseEnd;
use super::{Progress, Recorder};
use crate::objective::{Assembly, CappedMean, Iterate};

/// How far the cap on K lies above the largest K that was reached, relative to it. With 1e-3 the mean falls little further
/// (cube-10k 2.564 instead of 2.57), but max K then lies above that of peers that stop 5e-4 above ours.
pub(super) const CAP: f64 = 2e-4;
/// Weights of the mean against the cap's barrier. A tet has six barrier terms, so at the last weight the mean lies within
/// about 6 / 1000 of the least one under the cap, relative to a K of 1.
const WEIGHTS: [f64; 4] = [1.0, 10.0, 100.0, 1000.0];
/// The squared Newton decrement, relative to the weight and per tet, at which a weight's stage ends: twice what the step would
/// gain in the mean of K_I + K_O. With a thirtieth of this the steps are 1.4 to 2.5 times as many on six meshes of 2,000 to
/// 20,000 tets, and the mean is within 5e-4 of the same.
const CENTRED: f64 = 3e-4;
/// Most Newton steps a weight.
const STAGE_STEPS: usize = 25;

/// Minimises the sum of K_I + K_O (up to terms of order 1) under K <= exp(cap) for every tet, from `iterate` inside the cap.
pub(super) fn lower_mean(
    assembly: &mut Assembly<'_>,
    iterate: &mut Iterate,
    cap: f64,
    recorder: &mut Recorder<'_>,
) -> PhaseEnd {
    let tets = assembly.domain().mesh().tets().len() as f64;
    let mut negative = NegativeShare::new();
    for (stage, weight) in WEIGHTS.into_iter().enumerate() {
        recorder.progress = 1.0 - 0.1 * (1.0 - stage as f64 / WEIGHTS.len() as f64);
        let energy = CappedMean { weight, cap };
        for _ in 0..STAGE_STEPS {
            let Some(value) = assembly.value(&energy, iterate) else { return PhaseEnd::NoProgress };
            let Some(gradient) = negative.factorize(assembly, &energy, iterate) else {
                return PhaseEnd::NoProgress;
            };
            let mut direction: Vec<f64> = gradient.iter().map(|g| -g).collect();
            assembly.system().solve(&mut direction);
            let slope = dot(&gradient, &direction);
            if -slope < CENTRED * weight * tets {
                break;
            }
            let accepted = line_search(assembly, &energy, iterate, &direction, 1.0, |trial, step| {
                trial <= value + ARMIJO * step * slope
            });
            let Some((step, trial_value, trial)) = accepted else { break };
            *iterate = trial;
            let mean = trial_value / (weight * tets);
            if recorder.record("mean", mean.ln(), step, iterate) == Progress::Stop {
                return PhaseEnd::Interrupted;
            }
            negative.raise();
        }
    }
    PhaseEnd::Converged
}

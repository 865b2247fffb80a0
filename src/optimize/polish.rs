//! After the bottleneck: lower the mean under a cap on the largest K.

use super::damping::NegativeShare;
use super::interior_point::{Goal, MOST_STEPS, OPENED, VIOLATION, interior_point_phase};
use super::line_search::{ARMIJO, dot, line_search};
use super::minimax::with_factor;
use super::newton::LARGE;
use super::recorder::PhaseEnd;
use super::{Progress, Recorder};
use crate::dilatation::Dilatation;
use crate::linalg::SparseError;
use crate::mesh::Vec3;
use crate::objective::{Assembly, CappedMean, Iterate};

/// Weights of the mean against the cap's barrier. A tet has six barrier terms, so at the last weight the mean lies within
/// about 6 / 1000 of the least one under the cap, relative to a K of 1.
const WEIGHTS: [f64; 4] = [1.0, 10.0, 100.0, 1000.0];
/// The last of them on large meshes: on 224,000 tets of a smooth solid the one after it lowers the mean from 1.2585 to 1.2549, in a
/// third of the time of all phases together.
const LAST_IF_LARGE: f64 = 100.0;
/// The squared Newton decrement, relative to the weight and per tet, at which a weight's stage ends: twice what the step would
/// gain in the mean of K_I + K_O. With a thirtieth of this the steps are 1.4 to 2.5 times as many on six meshes of 2,000 to
/// 20,000 tets, and the mean is within 5e-4 of the same.
const CENTRED: f64 = 3e-4;
/// Share of the residual that solves are left at: with a tenth of this a smooth solid of 110,000 tets takes 28 steps instead of 38, in 3.3
/// times the conjugate gradients.
const REDUCTION: f64 = 0.1;
/// Most Newton steps a weight.
const STAGE_STEPS: usize = 25;
/// Share of a full step below which a step is short: tets at the cap keep it so.
const SHORT: f64 = 0.1;
/// Short steps in a row that end a weight's stage, if none lowers the mean by more than the share [`POOR`]. On a refined cube of 100,000 tets a hundred
/// of them take five times as long as all before, and lower the mean from 2.46 to 2.37; but on a brain's pial surface, from 20.8 to 12.9.
const SHORT_STEPS: usize = 3;
/// See [`SHORT_STEPS`].
const POOR: f64 = 2e-3;

/// Free vertices up to which the interior-point method does it, with a factor: with 3,700 on a smooth shell in a fifth of the
/// time of the barrier, whose systems take hundreds of conjugate gradients there; with 1,200 to 3,200 on others in 0.6 to 1.1
/// of it. A factor of 20,000 takes longer than all.
const MOST_DIRECT: usize = 6000;
/// Accuracy of the mean, relative, at which the interior-point method ends.
const TOLERANCE: f64 = 2e-4;
/// Shares of the way from the start to the end that are tried until no K is above the cap.
const SHARES: [f64; 8] = [1.0, 0.98, 0.95, 0.9, 0.8, 0.6, 0.4, 0.2];

/// Relative rise of the largest K within which iterates before the best are tried first: on its way down the largest K takes the mean up
/// at last, and from where they are less than that above the cap, steps are longer than along it. Not so for the barrier, which needs a start
/// below the cap.
const REACH: f64 = 0.01;
/// Most steps from such a start; 7 to 16 are usual where they lead anywhere.
const STEPS_FROM_ABOVE: usize = 20;

/// How far above the best K iterates may lie that [`lower_mean`] begins with, where others than the best are any use.
pub(super) fn reach(free: usize, rise: f64) -> Option<f64> {
    (free <= MOST_DIRECT || rise >= REACH).then_some(rise.max(REACH))
}

/// Lowers the mean of the map of least mean under a cap on K, which lies above the least largest by `rise` relative to it, to what
/// goes with this tolerance in ln K; the positions.
pub(super) fn lower_mean<'d>(
    assembly: &mut Assembly<'d>,
    direct: &mut Option<Assembly<'d>>,
    rise: f64,
    tolerance: f64,
    recorder: &mut Recorder<'_>,
) -> Result<(PhaseEnd, Vec<Vec3>), SparseError> {
    let cap = recorder.best_k * (1.0 + rise);
    let (mean_before, start) = recorder.start_below(cap);
    // Iterates may have violated the cap, and the energy is not quite the mean: what is not better is not kept.
    let kept = |assembly: &Assembly<'_>, to: &Iterate, shares: &[f64], recorder: &mut Recorder<'_>| {
        shares.iter().find_map(|&share| {
            let way = start.iter().zip(to.image()).enumerate();
            let between = way.map(|(v, (from, to))| assembly.unknowns().retract(v, from, from + (to - from) * share));
            let trial = assembly.at(between.collect());
            let dilatations =
                || trial.decompositions().iter().map(|tet| Dilatation::of_singular_values(tet.values).k());
            let mean = dilatations().sum::<f64>() / trial.decompositions().len() as f64;
            let turned =
                assembly.turned_triangle(trial.image()).is_some() || assembly.opened_too_far(trial.image()) > OPENED;
            let is_better = dilatations().all(|k| k <= cap) && mean <= mean_before && !turned;
            is_better.then(|| {
                recorder.record("mean", mean.ln(), share, &trial);
                trial.into_image()
            })
        })
    };
    if assembly.free().len() > MOST_DIRECT {
        let mut iterate = assembly.at(start.clone());
        let end = barrier(assembly, &mut iterate, cap.ln(), tolerance, recorder);
        let lowered = kept(assembly, &iterate, &SHARES, recorder);
        return Ok((end, lowered.unwrap_or(start)));
    }
    let direct = with_factor(assembly, direct)?;
    let mut settle = |from: Vec<Vec3>, most_steps: usize, recorder: &mut Recorder<'_>| {
        let mut iterate = direct.at(from);
        let rim = vec![false; direct.domain().mesh().tets().len()];
        let (goal, tolerance) = (Goal::Mean(cap.ln() - VIOLATION), TOLERANCE.max(tolerance));
        let end = interior_point_phase(direct, &mut iterate, goal, tolerance, &rim, most_steps, recorder).end;
        (end, iterate)
    };
    let (_, above) = recorder.start_below(recorder.best_k * (1.0 + rise.max(REACH)));
    if above != start {
        let (end, iterate) = settle(above, STEPS_FROM_ABOVE, recorder);
        // All of the way or none: where steps from above are stuck beyond the cap, those from below are not.
        let lowered = kept(assembly, &iterate, &SHARES[..1], recorder);
        if lowered.is_some() || end == PhaseEnd::Interrupted {
            return Ok((end, lowered.unwrap_or(start)));
        }
    }
    let (end, iterate) = settle(start.clone(), MOST_STEPS, recorder);
    let lowered = kept(assembly, &iterate, &SHARES, recorder);
    Ok((end, lowered.unwrap_or(start)))
}

/// Minimises the sum of K_I + K_O (up to terms of order 1) under K <= exp(cap) for every tet, from `iterate` inside the cap.
fn barrier(
    assembly: &mut Assembly<'_>,
    iterate: &mut Iterate,
    cap: f64,
    tolerance: f64,
    recorder: &mut Recorder<'_>,
) -> PhaseEnd {
    let tets = assembly.domain().mesh().tets().len() as f64;
    let mut negative = NegativeShare::new();
    assembly.system().end_at(REDUCTION, recorder.cancel());
    let last = if assembly.free().len() > LARGE { LAST_IF_LARGE } else { f64::INFINITY };
    // What is left after a weight is a multiple of its inverse.
    for (stage, weight) in
        WEIGHTS.into_iter().enumerate().filter(|(_, weight)| 1.0 / weight >= tolerance && *weight <= last)
    {
        recorder.progress = 1.0 - 0.1 * (1.0 - stage as f64 / WEIGHTS.len() as f64);
        let energy = CappedMean { weight, cap };
        let mut short = 0;
        for _ in 0..STAGE_STEPS {
            let Some(value) = assembly.value(&energy, iterate) else { return PhaseEnd::NoProgress };
            let Some(gradient) = negative.factorize(assembly, &energy, iterate) else {
                return PhaseEnd::NoProgress;
            };
            let mut direction: Vec<f64> = gradient.iter().map(|g| -g).collect();
            assembly.system().solve(&mut direction);
            // A solve that was cut short is no direction to search along.
            if recorder.cancel().is_due() {
                return PhaseEnd::Interrupted;
            }
            let slope = dot(&gradient, &direction);
            if -slope < CENTRED * weight * tets {
                break;
            }
            let accepted = line_search(assembly, &energy, iterate, &direction, 1.0, |trial, step| {
                trial <= value + ARMIJO * step * slope
            });
            let Some((step, trial_value, trial)) = accepted else { break };
            *iterate = trial;
            let (mean, before) = (trial_value / (weight * tets), recorder.mean());
            if recorder.record("mean", mean.ln(), step, iterate) == Progress::Stop {
                return PhaseEnd::Interrupted;
            }
            let is_poor = step < SHORT && recorder.mean() > before * (1.0 - POOR);
            short = if is_poor { short + 1 } else { 0 };
            if short == SHORT_STEPS {
                break;
            }
            negative.raise();
        }
    }
    PhaseEnd::Converged
}

//! The minimax problem in its epigraph form by NLopt: the least t with 3 l_1 <= t and -3 l_3 <= t for every tet.

use std::cell::RefCell;

use nlopt::{Algorithm, Nlopt, SuccessState, Target};

use super::argmin_phase::half_extent;
use super::recorder::PhaseEnd;
use super::{Engine, Progress, Recorder};
use crate::objective::{Assembly, Iterate};

/// Value of the constraints of a flipped tet: finite, since NLopt's algorithms compute with it, and above every ln K that
/// matters, so that they shorten their step.
const FLIPPED: f64 = 1e3;
/// By how much NLopt may violate a constraint, in ln K.
const VIOLATION: f64 = 1e-9;
/// First step in positions (in units of the image's size) and ln K.
const FIRST_STEP: f64 = 0.05;
/// Distance of the first bound above the present ln max K, so that the start is inside.
const FIRST_SLACK: f64 = 1e-3;

/// The algorithm of an engine that solves the epigraph form.
pub(super) fn algorithm(engine: Engine) -> Option<Algorithm> {
    match engine {
        Engine::Mma => Some(Algorithm::Mma),
        Engine::Ccsaq => Some(Algorithm::Ccsaq),
        Engine::Slsqp => Some(Algorithm::Slsqp),
        Engine::Newton | Engine::Lbfgs | Engine::NewtonCg | Engine::TrustRegion => None,
    }
}

/// Minimises ln max K from `start` until NLopt sees t change by less than `tolerance`. There are no restarts: from an optimum
/// the dual problems of MMA and CCSAQ take minutes, since the crate cannot loosen their tolerance.
///
/// One row is recorded for each evaluation with gradients at a map without a flipped tet; the best of them counts, by its
/// measured K, not NLopt's t.
pub(super) fn epigraph_phase(
    algorithm: Algorithm,
    assembly: &Assembly<'_>,
    start: &Iterate,
    tolerance: f64,
    recorder: &mut Recorder<'_>,
) -> PhaseEnd {
    let Some(largest) = start.largest_log() else { return PhaseEnd::NoProgress };
    let evaluations_left = recorder.iterations_left();
    let time_left = recorder.cancel().time_left();
    let domain = assembly.domain();
    let tets = domain.mesh().tets();
    let unit = half_extent(start.image());
    let count = 3 * assembly.free().len() + 1;
    let mut unknown_of = vec![None; start.image().len()];
    for (unknown, &vertex) in assembly.free().iter().enumerate() {
        unknown_of[vertex as usize] = Some(unknown);
    }
    let objective = |x: &[f64], gradient: Option<&mut [f64]>, _: &mut ()| {
        if let Some(gradient) = gradient {
            gradient.fill(0.0);
            gradient[count - 1] = 1.0;
        }
        x[count - 1]
    };
    let recorder = RefCell::new(recorder);
    let constraints = |result: &mut [f64], x: &[f64], gradient: Option<&mut [f64]>, _: &mut ()| {
        let (displacement, bound) = (&x[..count - 1], x[count - 1]);
        let iterate = assembly.at(assembly.moved(start.image(), displacement, unit));
        let functions: Vec<_> = (0..tets.len()).map(|tet| iterate.functions(domain, tet)).collect();
        for (values, functions) in result.chunks_exact_mut(2).zip(&functions) {
            for side in 0..2 {
                values[side] = functions.map_or(FLIPPED, |functions| functions[side].value - bound);
            }
        }
        let Some(gradient) = gradient else { return };
        gradient.fill(0.0);
        for (tet, (rows, functions)) in gradient.chunks_exact_mut(2 * count).zip(&functions).enumerate() {
            for (side, row) in rows.chunks_exact_mut(count).enumerate() {
                row[count - 1] = -1.0;
                let Some(function) = functions.map(|functions| functions[side]) else { continue };
                for (slope, vertex) in function.gradient.iter().zip(&tets[tet]) {
                    if let Some(unknown) = unknown_of[vertex.index()] {
                        row[3 * unknown..3 * unknown + 3].copy_from_slice((slope * unit).as_slice());
                    }
                }
            }
        }
        if functions.iter().all(Option::is_some) {
            // NLopt watches the limits: the crate gives its callbacks no way to stop it.
            let _: Progress = recorder.borrow_mut().record(name(algorithm), bound, 1.0, &iterate);
        }
    };
    let mut solver = Nlopt::new(algorithm, count, objective, Target::Minimize, ());
    let mut set = vec![
        solver.add_inequality_mconstraint(2 * tets.len(), constraints, (), &vec![VIOLATION; 2 * tets.len()]),
        solver.set_ftol_abs(tolerance),
        solver.set_initial_step1(FIRST_STEP),
        solver.set_maxeval(u32::try_from(evaluations_left).unwrap_or(u32::MAX)),
    ];
    if let Some(left) = time_left {
        set.push(solver.set_maxtime(left.as_secs_f64().max(1e-3)));
    }
    if set.iter().any(Result::is_err) {
        return PhaseEnd::NoProgress;
    }
    let mut x = vec![0.0; count];
    x[count - 1] = 3.0 * largest + FIRST_SLACK;
    // Failures are ends like others: SLSQP says RoundoffLimited at an optimum, and the best iterate is kept.
    match solver.optimize(&mut x) {
        Ok((SuccessState::MaxEvalReached | SuccessState::MaxTimeReached, _)) => PhaseEnd::Interrupted,
        _ => PhaseEnd::Converged,
    }
}

fn name(algorithm: Algorithm) -> &'static str {
    match algorithm {
        Algorithm::Mma => "MMA",
        Algorithm::Ccsaq => "CCSAQ",
        _ => "SLSQP",
    }
}

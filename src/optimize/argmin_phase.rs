//! argmin's solvers on the soft maximum at one exponent: L-BFGS, Newton-CG and the trust region, in one loop.

use std::cell::RefCell;

use argmin::core::{CostFunction, IterState, Problem, Solver, State};
use argmin::solver::linesearch::{BacktrackingLineSearch, condition::ArmijoCondition};
use argmin::solver::newton::NewtonCG;
use argmin::solver::quasinewton::LBFGS;
use argmin::solver::trustregion::{Steihaug, TrustRegion};

use super::displacement::Displacement;
use super::line_search::ARMIJO;
use super::recorder::PhaseEnd;
use super::{Progress, Recorder};
use crate::mesh::Vec3;
use crate::objective::{Assembly, Iterate};

/// Corrections kept by L-BFGS: more than about 10 bring little on these energies and cost memory traffic.
const MEMORY: usize = 10;
/// Restarts without memory, after a line search failed or an iteration gained too little, before giving up.
const RESTARTS: usize = 5;
/// Factor on E_p for the solvers with conjugate gradients. Newton-CG of argmin 0.11 ends them when the *square* of the
/// residual is below half of the gradient's norm, which for a gradient below 1 is at once; Steihaug's gives up at a gradient
/// below an absolute bound. With this factor gradients of E_p of 1e-6 are still solved to a percent.
const SECOND_ORDER_SCALE: f64 = 1e10;
/// Most conjugate gradient steps an iteration.
const INNER_STEPS: usize = 200;
/// Relative residual at which Steihaug's conjugate gradients end.
const STEIHAUG_RESIDUAL: f64 = 1e-4;
/// First and largest radius of the trust region, in units of the image's size.
const RADII: (f64, f64) = (0.1, 10.0);
/// Rejected steps in a row, each of which quarters the radius, before a restart.
const REJECTIONS: usize = 12;

/// A solver of argmin.
#[derive(Clone, Copy, Debug)]
pub(super) enum ArgminSolver {
    Lbfgs,
    NewtonCg,
    TrustRegion,
}

/// What the loop needs to know about a solver.
struct Traits {
    name: &'static str,
    scale: f64,
    /// Iterations in a row that may leave the map as it is.
    rejections: usize,
}

/// Minimises E_p from `iterate` until `RESTARTS` restarts in a row gain less than `tolerance` (in ln K) each.
///
/// The line searches are plain backtracking: argmin's More-Thuente ends with `Ok` after two steps where the value is
/// infinite, and its Hager-Zhang fails (argmin issue 541). It does not ensure positive curvature, hence the restarts. The
/// trust region rejects infinite values like any that its model did not foresee.
pub(super) fn soft_max_phase(
    solver: ArgminSolver,
    assembly: &mut Assembly<'_>,
    iterate: &mut Iterate,
    exponent: f64,
    tolerance: f64,
    recorder: &mut Recorder<'_>,
) -> PhaseEnd {
    let phase = Phase { assembly: &RefCell::new(assembly), exponent, tolerance, unit: half_extent(iterate.image()) };
    let line_search =
        || BacktrackingLineSearch::new(ArmijoCondition::new(ARMIJO).expect("the constant lies in (0, 1)"));
    match solver {
        ArgminSolver::Lbfgs => {
            let traits = Traits { name: "L-BFGS", scale: 1.0, rejections: 0 };
            phase.descend(&traits, || LBFGS::new(line_search(), MEMORY), iterate, recorder)
        }
        ArgminSolver::NewtonCg => {
            let traits = Traits { name: "Newton-CG", scale: SECOND_ORDER_SCALE, rejections: 0 };
            phase.descend(&traits, || NewtonCG::new(line_search()), iterate, recorder)
        }
        ArgminSolver::TrustRegion => {
            let traits = Traits { name: "trust region", scale: SECOND_ORDER_SCALE, rejections: REJECTIONS };
            let solver = || {
                let inner = Steihaug::new().with_max_iters(INNER_STEPS as u64);
                let inner = inner.with_epsilon(STEIHAUG_RESIDUAL).expect("the residual is positive");
                let outer = TrustRegion::new(inner).with_radius(RADII.0).expect("the radius is positive");
                outer.with_max_radius(RADII.1).expect("the radius is positive")
            };
            phase.descend(&traits, solver, iterate, recorder)
        }
    }
}

/// Half of the longest side of the box around some points, or 1 if there is no extent.
pub(super) fn half_extent(points: &[Vec3]) -> f64 {
    let Some(first) = points.first() else { return 1.0 };
    let (low, high) = points.iter().fold((*first, *first), |(low, high), p| (low.inf(p), high.sup(p)));
    let half = 0.5 * (high - low).max();
    if half > 0.0 { half } else { 1.0 }
}

/// One exponent's minimisation.
struct Phase<'a, 'd> {
    assembly: &'a RefCell<&'a mut Assembly<'d>>,
    exponent: f64,
    tolerance: f64,
    unit: f64,
}

impl<'a, 'd> Phase<'a, 'd> {
    /// Runs fresh solvers, each from where the last one ended.
    fn descend<S, H>(
        &self,
        traits: &Traits,
        solver: impl Fn() -> S,
        iterate: &mut Iterate,
        recorder: &mut Recorder<'_>,
    ) -> PhaseEnd
    where
        S: Solver<Displacement<'a, 'd>, IterState<Vec<f64>, Vec<f64>, (), H, (), f64>>,
    {
        let name = format!("{} p={}", traits.name, self.exponent);
        let mut idle = 0;
        while idle <= RESTARTS {
            let displacement = self.displacement(iterate.image().to_vec(), traits.scale);
            let origin = vec![0.0; 3 * self.assembly.borrow().free().len()];
            let Ok(before) = displacement.cost(&origin) else { return PhaseEnd::NoProgress };
            let mut problem = Problem::new(displacement);
            let mut solver = solver();
            let state = IterState::new().param(origin).cost(before);
            let Ok((mut state, _)) = solver.init(&mut problem, state) else { return PhaseEnd::NoProgress };
            state.update();
            let (mut reached, mut rejected) = (before, 0);
            // The loop of argmin's executor, taken apart because its observers cannot borrow the domain.
            while let Ok((next, _)) = solver.next_iter(&mut problem, state) {
                state = next;
                state.update();
                state.increment_iter();
                let gain = (reached - state.get_cost()) / traits.scale;
                if gain == 0.0 && rejected < traits.rejections {
                    rejected += 1;
                    continue;
                }
                let (Some(displacement), Some(problem)) = (state.get_param(), &problem.problem) else { break };
                // Not a number either.
                if !(gain > 0.0 && gain.is_finite()) {
                    break;
                }
                *iterate = self.assembly.borrow().at(problem.moved(displacement));
                reached = state.get_cost();
                rejected = 0;
                if recorder.record(&name, reached / traits.scale, 1.0, iterate) == Progress::Stop {
                    return PhaseEnd::Interrupted;
                }
                if gain < self.tolerance {
                    break;
                }
            }
            idle = if (before - reached) / traits.scale < self.tolerance { idle + 1 } else { 0 };
        }
        PhaseEnd::Converged
    }

    fn displacement(&self, start: Vec<Vec3>, scale: f64) -> Displacement<'a, 'd> {
        let &Self { assembly, exponent, unit, .. } = self;
        // Each step of Newton-CG takes two products, one for the solve and one for the curvature.
        Displacement { assembly, start, exponent, unit, scale, products: 2 * INNER_STEPS }
    }
}

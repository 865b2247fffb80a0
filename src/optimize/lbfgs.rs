//! argmin's limited-memory BFGS on the soft maximum at one exponent: the first-order engine.

use argmin::core::{CostFunction, Error, Gradient, IterState, Problem, Solver, State};
use argmin::solver::linesearch::{BacktrackingLineSearch, condition::ArmijoCondition};
use argmin::solver::quasinewton::LBFGS;

use super::newton::{PhaseEnd, moved};
use super::{Progress, Recorder};
use crate::mesh::Vec3;
use crate::objective::{Assembly, SoftMax};

/// Corrections kept: more than about 10 bring little on these energies and cost memory traffic.
const MEMORY: usize = 10;
/// Restarts without the memory, after a line search failed or an iteration gained too little, before giving up.
const RESTARTS: usize = 5;

type Positions = IterState<Vec<f64>, Vec<f64>, (), (), (), f64>;

/// E_p as a function of the displacement of the free vertices from `start`; infinite where a tet is flipped.
struct Displacement<'a, 'd> {
    assembly: &'a Assembly<'d>,
    start: &'a [Vec3],
    exponent: f64,
}

impl CostFunction for Displacement<'_, '_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, displacement: &Self::Param) -> Result<f64, Error> {
        let image = moved(self.assembly, self.start, displacement, 1.0);
        let value = self.assembly.largest_log(&image).and_then(|largest| {
            let energy = SoftMax::new(self.exponent, largest);
            Some(energy.log_k(self.assembly.value(&energy, &image)?))
        });
        Ok(value.unwrap_or(f64::INFINITY))
    }
}

impl Gradient for Displacement<'_, '_> {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;

    fn gradient(&self, displacement: &Self::Param) -> Result<Vec<f64>, Error> {
        let image = moved(self.assembly, self.start, displacement, 1.0);
        let flipped = || Error::msg("the gradient was asked for at a map with a flipped tet");
        let largest = self.assembly.largest_log(&image).ok_or_else(flipped)?;
        let energy = SoftMax::new(self.exponent, largest);
        let sum = self.assembly.value(&energy, &image).ok_or_else(flipped)?;
        let scale = 1.5 / (self.exponent * sum);
        let mut gradient = self.assembly.gradient(&energy, &image).ok_or_else(flipped)?;
        gradient.iter_mut().for_each(|g| *g *= scale);
        Ok(gradient)
    }
}

/// Minimises E_p from `image` until `RESTARTS` restarts in a row gain less than `tolerance` (in ln K) each.
///
/// The line search is plain backtracking: argmin's More-Thuente ends with `Ok` after two steps where the value is
/// infinite, and its Hager-Zhang fails (argmin issue 541). It does not ensure positive curvature, hence the restarts.
pub(super) fn soft_max_phase(
    assembly: &Assembly<'_>,
    image: &mut Vec<Vec3>,
    exponent: f64,
    tolerance: f64,
    recorder: &mut Recorder<'_>,
) -> PhaseEnd {
    let phase = format!("L-BFGS p={exponent}");
    let mut idle = 0;
    while idle <= RESTARTS {
        let start = image.clone();
        let mut problem = Problem::new(Displacement { assembly, start: &start, exponent });
        let armijo = ArmijoCondition::new(1e-4).expect("the constant lies in (0, 1)");
        let mut solver = LBFGS::<_, Vec<f64>, Vec<f64>, f64>::new(BacktrackingLineSearch::new(armijo), MEMORY);
        let origin = Positions::new().param(vec![0.0; 3 * assembly.free().len()]);
        let Ok((mut state, _)) = solver.init(&mut problem, origin) else { return PhaseEnd::NoProgress };
        state.update();
        let before = state.get_cost();
        let mut reached = before;
        // The loop of argmin's executor, taken apart because its observers cannot borrow the domain.
        loop {
            let Ok((next, _)) = solver.next_iter(&mut problem, state) else { break };
            state = next;
            state.update();
            state.increment_iter();
            if !state.get_cost().is_finite() || state.get_cost() >= reached {
                break;
            }
            let Some(displacement) = state.get_param() else { break };
            *image = moved(assembly, &start, displacement, 1.0);
            if recorder.record(&phase, state.get_cost(), 1.0, image) == Progress::Stop {
                return PhaseEnd::Interrupted;
            }
            let gain = reached - state.get_cost();
            reached = state.get_cost();
            if gain < tolerance {
                break;
            }
        }
        idle = if before - reached < tolerance { idle + 1 } else { 0 };
    }
    PhaseEnd::Converged
}

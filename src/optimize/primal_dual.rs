//! The end of the minimax continuation: a primal-dual interior-point method for min t subject to g <= t, g = ln K_O and
//! g = ln K_I of every tet.
//!
//! Constraints near the bound carry multipliers of their own; all others have a logarithmic barrier. A primal barrier
//! alone, which takes its multipliers from slacks of 1e-11, loses their digits before the conditions of stationarity hold
//! to 1e-6, and with a thousand active tets on a curved surface it crawls: its steps may not leave the feasible set.
//! Here they may, at the price of [`PrimalDual::penalty`].

use super::newton::{PhaseEnd, Trials, dot, factorize_damped, less_negative, moved};
use super::{KktResidual, Progress, Recorder};
use crate::mesh::{TetId, Vec3};
use crate::objective::{Assembly, Barrier, Iterate, Multiplier, NearActive, PrimalDual, log_dilatations};

/// Distance (in ln K) of the first bound above the present max K.
const FIRST_SLACK: f64 = 0.0005;
/// A constraint carries a multiplier from where its slack is below this share of the bound. At ten times that share its
/// singular value could still not be a double one, see [`PrimalDual`].
const NEAR: f64 = 0.05;
/// Share of the largest multiplier above which a constraint counts as active.
const ACTIVE: f64 = 1e-3;
/// Complementarity, over all terms, below which the weights of active and other constraints part: the active ones' slacks
/// must keep their digits, while 6 terms a tet of the others must not add up.
const PARTING: f64 = 1e-4;
/// Share of the tolerance that the active constraints' complementarity may take up, and the others'.
const SHARES: (f64, f64) = (0.25, 0.1);
/// Bounds of the weights' factor from stage to stage: the largest, the least one until the weights part, the least one.
const FACTORS: (f64, f64, f64) = (0.2, 0.1, 0.02);
/// After a stage with more steps than this the next weight is not lowered faster than by the largest factor.
const HARD_STAGE: usize = 8;
/// Most Newton steps a stage.
const STAGE_STEPS: usize = 100;
/// The penalty as a multiple of the largest multiplier: above 1 it is exact. Within these limits it is left as it is.
const PENALTY: (f64, f64) = (1.5, 4.0);
/// Shift of the diagonal, relative to the squared scale of the constraints' gradients: far below the curvature that active
/// constraints give, it holds in place what only the weak barrier moves, which else drifts and shortens every step.
const SHIFT: f64 = 1e-6;
/// Sufficient decrease of the Armijo rule.
const ARMIJO: f64 = 1e-4;
/// Rounding of the merit function, relative to its value.
const ROUNDING: f64 = 1e-14;
/// Halvings of a step before the line search gives up.
const HALVINGS: usize = 30;
/// Share of the way to a multiplier's zero that a step may go.
const TO_THE_BOUNDARY: f64 = 0.995;

/// A near-active constraint, on one side (K_O or K_I) of a tet, at the present positions.
struct Row {
    tet: usize,
    side: usize,
    value: f64,
    gradient: [Vec3; 4],
    at: NearActive,
}

impl Row {
    /// The weight of the constraint's gradient in the condensed system.
    fn stiffness(&self) -> f64 {
        self.at.multiplier / self.at.slack
    }
}

/// How a phase ended.
pub(super) struct Settled {
    pub end: PhaseEnd,
    /// The bound on ln K; `None` if nothing was solved.
    pub bound: Option<f64>,
    /// Multipliers of near-active constraints: the tet, its side (0 for K_O, 1 for K_I), the multiplier.
    pub multipliers: Vec<(usize, usize, f64)>,
}

/// Minimises ln max K from `iterate` until the Karush-Kuhn-Tucker conditions hold to within `tolerance`.
pub(super) fn primal_dual_phase(
    assembly: &mut Assembly<'_>,
    iterate: &mut Iterate,
    tolerance: f64,
    recorder: &mut Recorder<'_>,
) -> Settled {
    let Some(mut stage) = Stage::first(assembly, iterate, tolerance) else {
        return Settled { end: PhaseEnd::NoProgress, bound: None, multipliers: Vec::new() };
    };
    let end = follow(assembly, iterate, &mut stage, recorder);
    let sides = |(tet, pair): (usize, &[Option<Multiplier>; 2])| {
        [0, 1].map(|side| pair[side].map(|multiplier| (tet, side, multiplier.value)))
    };
    let multipliers = stage.problem.near_active.iter().enumerate().flat_map(sides).flatten().collect();
    Settled { end, bound: Some(stage.problem.bound), multipliers }
}

/// Follows the path of centres.
fn follow(
    assembly: &mut Assembly<'_>,
    iterate: &mut Iterate,
    stage: &mut Stage,
    recorder: &mut Recorder<'_>,
) -> PhaseEnd {
    let tolerance = stage.tolerance;
    let share = recorder.progress;
    let first_weight = stage.weight;
    let mut negative = 1.0;
    loop {
        stage.select(iterate);
        let rows = stage.rows(assembly, iterate);
        let Some(system) = Bordered::new(assembly, iterate, &stage.problem, &mut negative) else {
            return PhaseEnd::NoProgress;
        };
        let (residual, centrality) = stage.residual(&system, &rows);
        let last = stage.is_last();
        if last && (residual.largest().max(centrality) < 0.7 * tolerance || stage.steps == STAGE_STEPS) {
            return PhaseEnd::Converged;
        }
        // As near to its centre as the stage's own gap asks for.
        let error = residual.dual.max(residual.primal).max(centrality);
        if !last && (error < stage.gap().max(0.1 * tolerance) || stage.steps == STAGE_STEPS) {
            stage.next(iterate);
            recorder.progress = 1.0
                - (1.0 - share) * (stage.weight / stage.last_weight()).ln().max(0.0)
                    / (first_weight / stage.last_weight()).ln().max(1e-9);
            continue;
        }
        let Some(length) = step(assembly, iterate, &mut stage.problem, &system, &rows) else {
            // At the last weights rounding decides: as centred as it gets.
            return if last { PhaseEnd::Converged } else { PhaseEnd::NoProgress };
        };
        stage.steps += 1;
        if recorder.record("minimax", stage.problem.bound, length, iterate) == Progress::Stop {
            return PhaseEnd::Interrupted;
        }
        negative = (2.0 * negative).clamp(0.02, 1.0);
    }
}

/// One problem of the path, for given weights of the barriers.
struct Stage {
    problem: PrimalDual,
    /// Weight of the active constraints' barrier.
    weight: f64,
    /// Number of active constraints, those with that weight.
    active: usize,
    steps: usize,
    tolerance: f64,
}

impl Stage {
    fn first(assembly: &Assembly<'_>, iterate: &Iterate, tolerance: f64) -> Option<Self> {
        let bound = 3.0 * iterate.largest_log()? + FIRST_SLACK;
        // The weight for which the first bound is stationary.
        let weight = -1.0 / assembly.bound_derivatives(&Barrier { bound }, iterate)?.0;
        let near_active = vec![[None; 2]; assembly.domain().mesh().tets().len()];
        let problem = PrimalDual { bound, rest_weight: weight, penalty: 1.0, near_active };
        Some(Self { problem, weight, active: 0, steps: 0, tolerance })
    }

    fn terms(&self) -> f64 {
        6.0 * self.problem.near_active.len() as f64
    }

    /// Complementarity of the active constraints at the stage's centre.
    fn gap(&self) -> f64 {
        self.active as f64 * self.weight
    }

    fn last_weight(&self) -> f64 {
        SHARES.0 * self.tolerance / self.active.max(1) as f64
    }

    fn last_rest_weight(&self) -> f64 {
        SHARES.1 * self.tolerance / self.terms()
    }

    fn is_last(&self) -> bool {
        self.weight <= self.last_weight() && self.problem.rest_weight <= self.last_rest_weight()
    }

    /// Gives multipliers to the constraints that have come near the bound, and sets the penalty.
    fn select(&mut self, iterate: &Iterate) {
        let problem = &mut self.problem;
        let weight = problem.rest_weight;
        for (tet, logs) in iterate.logs().enumerate() {
            let Some(logs) = logs else { continue };
            for (entry, (axis, factor)) in problem.near_active[tet].iter_mut().zip(PrimalDual::SIDES) {
                let slack = problem.bound - factor * logs[axis];
                if entry.is_none() && slack < NEAR * problem.bound {
                    *entry = Some(Multiplier { value: weight / slack.max(weight / problem.penalty), weight });
                }
            }
        }
        let largest = self.largest_multiplier();
        self.problem.penalty = self.problem.penalty.clamp(PENALTY.0 * largest, PENALTY.1 * largest);
        self.active = self.problem.near_active.iter().flatten().flatten().filter(|m| m.weight == self.weight).count();
    }

    fn largest_multiplier(&self) -> f64 {
        self.problem.near_active.iter().flatten().flatten().map(|m| m.value).fold(f64::MIN_POSITIVE, f64::max)
    }

    fn rows(&self, assembly: &Assembly<'_>, iterate: &Iterate) -> Vec<Row> {
        let mut rows = Vec::new();
        for (tet, pair) in self.problem.near_active.iter().enumerate() {
            if pair.iter().all(Option::is_none) {
                continue;
            }
            let Some(functions) = iterate.functions(assembly.domain(), tet) else { continue };
            for (side, (multiplier, function)) in pair.iter().zip(functions).enumerate() {
                if let Some(multiplier) = *multiplier {
                    let at = self.problem.at(multiplier, function.value);
                    rows.push(Row { tet, side, value: function.value, gradient: function.gradient, at });
                }
            }
        }
        rows
    }

    /// How far positions, bound and multipliers are from stationary, and from the stage's centre.
    fn residual(&self, system: &Bordered, rows: &[Row]) -> (KktResidual, f64) {
        let near: f64 = rows.iter().map(|row| row.at.slack * row.at.multiplier).sum();
        let residual = KktResidual {
            primal: rows.iter().map(|row| row.at.residual).fold(0.0, f64::max),
            dual: system.dual.max((1.0 - system.multipliers).abs()),
            complementarity: near + self.terms() * self.problem.rest_weight,
        };
        let centrality = rows.iter().map(|row| (row.at.slack * row.at.multiplier - row.at.weight).abs()).sum();
        (residual, centrality)
    }

    /// Lowers the weights, faster the nearer the end is.
    fn next(&mut self, iterate: &Iterate) {
        let parted = self.terms() * self.weight <= PARTING;
        let least = match parted {
            _ if self.steps > HARD_STAGE => FACTORS.0,
            false => FACTORS.1,
            true => FACTORS.2,
        };
        let factor = self.gap().sqrt().clamp(least, FACTORS.0);
        let last = self.last_weight();
        self.weight = (factor * self.weight).max(last).min(self.weight);
        let problem = &mut self.problem;
        let terms = 6.0 * problem.near_active.len() as f64;
        problem.rest_weight = if terms * self.weight > PARTING && self.weight > last {
            self.weight
        } else {
            (FACTORS.1 * problem.rest_weight).max(SHARES.1 * self.tolerance / terms).min(self.weight)
        };
        let largest = self.largest_multiplier();
        let problem = &mut self.problem;
        for (tet, logs) in iterate.logs().enumerate() {
            let Some(logs) = logs else { continue };
            for (entry, (axis, factor)) in problem.near_active[tet].iter_mut().zip(PrimalDual::SIDES) {
                // Not at once where it came in, or it would go to and fro.
                if problem.bound - factor * logs[axis] > 2.0 * NEAR * problem.bound {
                    *entry = None;
                } else if let Some(entry) = entry {
                    entry.weight = if entry.value > ACTIVE * largest { self.weight } else { problem.rest_weight };
                }
            }
        }
        self.steps = 0;
    }
}

/// The condensed Newton system in the positions, factorised, bordered by the bound.
struct Bordered {
    /// Right-hand sides: minus the step's sources in the positions and in the bound.
    positions: Vec<f64>,
    bound: f64,
    /// The bound's column, and the solution with it as the right-hand side.
    column: Vec<f64>,
    solved_column: Vec<f64>,
    /// What remains of the bound's diagonal entry after the positions are eliminated, positive.
    schur: f64,
    /// Norm of the Lagrangian's gradient in the positions relative to the sum of its parts' norms.
    dual: f64,
    /// Sum of all multipliers.
    multipliers: f64,
}

impl Bordered {
    /// Lowers `negative` until the system is positive definite; `None` if it never is.
    fn new(assembly: &mut Assembly<'_>, iterate: &Iterate, problem: &PrimalDual, negative: &mut f64) -> Option<Self> {
        let positions = assembly.gradient_of_logs(iterate, |tet, logs| problem.right_hand_slopes(tet, logs))?;
        let column = assembly.gradient_of_logs(iterate, |tet, logs| problem.mixed_slopes(tet, logs))?;
        let [bound, diagonal, multipliers] =
            assembly.sum_of_logs(iterate, |tet, logs| problem.bound_parts(tet, logs))?;
        loop {
            let gradient = factorize_damped(assembly, problem, iterate, negative, SHIFT)?;
            let dual = dot(&gradient, &gradient).sqrt() / assembly.gradient_scale();
            let mut solved_column = column.clone();
            assembly.system().solve(&mut solved_column);
            let schur = diagonal - dot(&column, &solved_column);
            if schur > 0.0 {
                return Some(Self { positions, bound: 1.0 + bound, column, solved_column, schur, dual, multipliers });
            }
            *negative = less_negative(*negative)?;
        }
    }

    /// The step for residuals of the rows larger by `errors` than they are.
    fn solve(&self, assembly: &mut Assembly<'_>, rows: &[Row], errors: &[f64]) -> Step {
        let tets = assembly.domain().mesh().tets();
        let vertices = assembly.domain().mesh().points().len();
        let mut extra = vec![Vec3::zeros(); vertices];
        let mut bound = self.bound;
        for (row, error) in rows.iter().zip(errors) {
            let force = row.stiffness() * error;
            for (g, v) in row.gradient.iter().zip(tets[row.tet]) {
                extra[v.index()] += g * force;
            }
            bound -= force;
        }
        let mut by_position = self.positions.clone();
        for (entries, &v) in by_position.chunks_exact_mut(3).zip(assembly.free()) {
            for axis in 0..3 {
                entries[axis] += extra[v as usize][axis];
            }
        }
        assembly.system().solve(&mut by_position);
        let bound = -(bound - dot(&self.column, &by_position)) / self.schur;
        let direction: Vec<f64> =
            by_position.iter().zip(&self.solved_column).map(|(u, column)| -u - column * bound).collect();
        let displacement = moved(assembly, &vec![Vec3::zeros(); vertices], &direction, 1.0);
        let change = |row: &Row| -> f64 {
            row.gradient.iter().zip(tets[row.tet]).map(|(g, v)| g.dot(&displacement[v.index()])).sum()
        };
        Step { changes: rows.iter().map(|row| change(row) - bound).collect(), direction, bound }
    }
}

/// A Newton step.
struct Step {
    direction: Vec<f64>,
    bound: f64,
    /// For each row the change of g - t to first order.
    changes: Vec<f64>,
}

/// Takes the Newton step, corrected to second order or shortened if the merit function does not fall; the share taken.
fn step(
    assembly: &mut Assembly<'_>,
    iterate: &mut Iterate,
    problem: &mut PrimalDual,
    system: &Bordered,
    rows: &[Row],
) -> Option<f64> {
    let value = assembly.value(problem, iterate)? + problem.bound;
    let newton = system.solve(assembly, rows, &[]);
    // The right-hand side is the merit's gradient but for the terms that remove the residuals.
    let restoring: f64 =
        rows.iter().zip(&newton.changes).map(|(row, change)| row.stiffness() * row.at.residual * change).sum();
    let slope = dot(&system.positions, &newton.direction) + system.bound * newton.bound - restoring;
    let mut trials = Trials::default();
    let mut attempt = |assembly: &Assembly<'_>, step: &Step, length: f64| {
        let image = moved(assembly, iterate.image(), &step.direction, length);
        let mut at_trial = problem.clone();
        at_trial.bound += length * step.bound;
        let (value_at_trial, trial) = trials.evaluate(assembly, &at_trial, image)?;
        let merit = value_at_trial + at_trial.bound;
        let enough = value + ARMIJO * length * slope.min(0.0) + ROUNDING * value.abs();
        (merit <= enough).then_some((length, trial, at_trial))
    };
    let correct = |assembly: &mut Assembly<'_>| -> Option<Step> {
        let trial = moved(assembly, iterate.image(), &newton.direction, 1.0);
        let errors: Vec<f64> = rows
            .iter()
            .zip(&newton.changes)
            .map(|(row, change)| {
                let functions = log_dilatations(assembly.domain(), TetId(row.tet as u32), &trial)?;
                Some(functions[row.side].value - row.value - change - newton.bound)
            })
            .collect::<Option<_>>()?;
        Some(system.solve(assembly, rows, &errors))
    };
    let accepted = attempt(assembly, &newton, 1.0)
        .or_else(|| correct(assembly).and_then(|corrected| attempt(assembly, &corrected, 1.0)))
        .or_else(|| (1..=HALVINGS).find_map(|halvings| attempt(assembly, &newton, 0.5f64.powi(halvings as i32))));
    let (length, trial, mut at_trial) = accepted?;
    let changes: Vec<f64> = rows
        .iter()
        .zip(&newton.changes)
        .map(|(row, change)| {
            row.at.weight / row.at.slack - row.at.multiplier + row.stiffness() * (row.at.residual + change)
        })
        .collect();
    let share = rows
        .iter()
        .zip(&changes)
        .filter(|(_, change)| **change < 0.0)
        .fold(1.0, |share: f64, (row, change)| share.min(-TO_THE_BOUNDARY * row.at.multiplier / change));
    for (row, change) in rows.iter().zip(&changes) {
        let value = row.at.multiplier + share * change;
        at_trial.near_active[row.tet][row.side] = Some(Multiplier { value, weight: row.at.weight });
    }
    (*iterate, *problem) = (trial, at_trial);
    Some(length)
}

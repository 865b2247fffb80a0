//! The condensed Newton system of the interior-point method: factorised once, solved for several targets.

use super::super::line_search::dot;
use crate::mesh::Vec3;
use crate::objective::{Assembly, Iterate, PrimalDual};

/// What must stay below its limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Constraint {
    /// ln K_O (side 0) or ln K_I (side 1), below the bound.
    Dilatation { side: usize },
    /// -opening of a triangle of the tet, which has this place in the list of near ones.
    Opening { place: usize },
}

/// A near-active constraint at the present positions.
pub(super) struct Row {
    pub tet: usize,
    pub of: Constraint,
    /// The value, and its derivatives with respect to the tet's vertices.
    pub value: f64,
    pub gradient: [Vec3; 4],
    /// What the value must stay below.
    pub limit: f64,
    pub slack: f64,
    pub multiplier: f64,
}

impl Row {
    pub(super) fn product(&self) -> f64 {
        self.slack * self.multiplier
    }

    /// Whether its limit is the bound.
    fn follows_bound(&self) -> bool {
        matches!(self.of, Constraint::Dilatation { .. })
    }

    /// The weight of the constraint's gradient in the condensed system.
    fn stiffness(&self) -> f64 {
        self.multiplier / self.slack
    }
}

/// The system in the positions, which the assembly holds factorised, and its border, the bound.
pub(super) struct System {
    /// Gradient of the Lagrangian in the positions, with the present weight of the barrier on the rest, and that barrier's
    /// with weight 1.
    lagrangian: Vec<f64>,
    rest: Vec<f64>,
    /// `None` if the bound is given.
    border: Option<Border>,
    /// The step to where all slacks times multipliers and the weight of the barrier are 0.
    pub predictor: Step,
}

/// The bound's row and column.
struct Border {
    column: Vec<f64>,
    solved_column: Vec<f64>,
    /// What remains of the diagonal entry after the positions are eliminated, positive.
    schur: f64,
    /// Derivative in the bound of the Lagrangian without the barrier on the rest, 1 - sum of multipliers, and of that barrier
    /// with weight 1.
    lagrangian: f64,
    rest: f64,
}

impl Border {
    /// Of this column, and the positions' solution for it; `None` if the whole is not positive definite.
    fn new(
        assembly: &Assembly<'_>,
        iterate: &Iterate,
        problem: &PrimalDual,
        rows: &[Row],
        column: Vec<f64>,
        solved_column: Vec<f64>,
    ) -> Option<Self> {
        let [rest, second] = assembly.sum_of_logs(iterate, |tet, logs| problem.rest_bound_derivatives(tet, logs))?;
        let bounded = || rows.iter().filter(|row| row.follows_bound());
        let diagonal = problem.rest_weight * second + bounded().map(Row::stiffness).sum::<f64>();
        let schur = diagonal - dot(&column, &solved_column);
        let lagrangian = 1.0 - bounded().map(|row| row.multiplier).sum::<f64>();
        (schur > 0.0).then_some(Self { column, solved_column, schur, lagrangian, rest })
    }

    /// The derivative of the Lagrangian in the bound, with this weight of the barrier on the rest.
    fn gradient(&self, rest_weight: f64) -> f64 {
        self.lagrangian + rest_weight * self.rest
    }
}

/// What a Newton step is to reach.
pub(super) struct Target {
    /// Weight of the barrier on the rest.
    pub rest_weight: f64,
    /// For each row the change of slack times multiplier, to first order.
    pub changes: Vec<f64>,
}

/// A Newton step, and the shares of it that leave slacks and multipliers positive.
pub(super) struct Step {
    pub positions: Vec<f64>,
    pub bound: f64,
    pub slacks: Vec<f64>,
    pub multipliers: Vec<f64>,
    pub primal: f64,
    pub dual: f64,
}

/// Share of the way to the zero of a slack or multiplier that a step may go.
const TO_THE_BOUNDARY: f64 = 0.995;

impl Step {
    /// Slack times multiplier of each row after the given shares of the step.
    pub(super) fn products<'s>(&'s self, rows: &'s [Row], primal: f64, dual: f64) -> impl Iterator<Item = f64> + 's {
        rows.iter()
            .enumerate()
            .map(move |(k, row)| (row.slack + primal * self.slacks[k]) * (row.multiplier + dual * self.multipliers[k]))
    }
}

impl System {
    /// Takes the factorised system of this gradient, bordered if the bound is free; `None` if the whole is not positive
    /// definite then.
    pub(super) fn new(
        assembly: &mut Assembly<'_>,
        iterate: &Iterate,
        problem: &PrimalDual,
        rows: &[Row],
        lagrangian: Vec<f64>,
        bound_is_free: bool,
    ) -> Option<Self> {
        let target = Target { rest_weight: 0.0, changes: rows.iter().map(|row| -row.product()).collect() };
        let right_hand_side = |assembly: &Assembly<'_>, rest: &[f64]| {
            right_hand_side(assembly, iterate.image(), problem, rows, &lagrangian, rest, &target)
        };
        let (rest, border, solved) = if bound_is_free {
            let slopes = |tet, logs| [problem.rest_slopes(tet, logs), problem.mixed_slopes(tet, logs)];
            let [rest, column] = assembly.gradients_of_logs(iterate, slopes)?;
            let mut solved = right_hand_side(assembly, &rest);
            let mut solved_column = column.clone();
            assembly.system().solve_pair([&mut solved, &mut solved_column]);
            (rest, Some(Border::new(assembly, iterate, problem, rows, column, solved_column)?), solved)
        } else {
            let [rest] = assembly.gradients_of_logs(iterate, |tet, logs| [problem.rest_slopes(tet, logs)])?;
            let mut solved = right_hand_side(assembly, &rest);
            assembly.system().solve(&mut solved);
            (rest, None, solved)
        };
        let predictor = step(assembly, rows, &target, solved, border.as_ref());
        Some(Self { lagrangian, rest, border, predictor })
    }

    /// The derivative of the Lagrangian in the bound; 0 if that is given.
    pub(super) fn bound_gradient(&self, rest_weight: f64) -> f64 {
        self.border.as_ref().map_or(0.0, |border| border.gradient(rest_weight))
    }

    /// The step from residuals as they are to the target.
    pub(super) fn solve(
        &self,
        assembly: &mut Assembly<'_>,
        image: &[Vec3],
        problem: &PrimalDual,
        rows: &[Row],
        target: &Target,
    ) -> Step {
        let mut solved = right_hand_side(assembly, image, problem, rows, &self.lagrangian, &self.rest, target);
        assembly.system().solve(&mut solved);
        step(assembly, rows, target, solved, self.border.as_ref())
    }
}

/// By how much a constraint's value and slack miss its limit.
fn residual(row: &Row) -> f64 {
    row.value + row.slack - row.limit
}

/// What a constraint adds to the gradient, in units of its own, on the way to a product changed by so much.
fn force(row: &Row, change: f64) -> f64 {
    (change + row.multiplier * residual(row)) / row.slack
}

/// What the positions are solved for: the gradient with the weight of the target, and the forces of the constraints.
fn right_hand_side(
    assembly: &Assembly<'_>,
    image: &[Vec3],
    problem: &PrimalDual,
    rows: &[Row],
    lagrangian: &[f64],
    rest: &[f64],
    target: &Target,
) -> Vec<f64> {
    let tets = assembly.domain().mesh().tets();
    let mut forces = vec![Vec3::zeros(); image.len()];
    for (row, change) in rows.iter().zip(&target.changes) {
        let force = force(row, *change);
        for (g, v) in row.gradient.iter().zip(tets[row.tet]) {
            forces[v.index()] += g * force;
        }
    }
    let more_rest = target.rest_weight - problem.rest_weight;
    let mut whole: Vec<f64> = lagrangian.iter().zip(rest).map(|(gradient, rest)| gradient + more_rest * rest).collect();
    for (entries, &v) in whole.chunks_exact_mut(3).zip(assembly.free()) {
        for axis in 0..3 {
            entries[axis] += forces[v as usize][axis];
        }
    }
    assembly.tangent(image, whole)
}

/// The step of the positions' solution `solved` with a given bound, and of the bound where that is free.
fn step(assembly: &Assembly<'_>, rows: &[Row], target: &Target, solved: Vec<f64>, border: Option<&Border>) -> Step {
    let tets = assembly.domain().mesh().tets();
    let mut positions: Vec<f64> = solved.iter().map(|u| -u).collect();
    let mut bound = 0.0;
    if let Some(border) = border {
        let bounded = rows.iter().zip(&target.changes).filter(|(row, _)| row.follows_bound());
        let pull: f64 = bounded.map(|(row, change)| force(row, *change)).sum();
        bound = (dot(&border.column, &solved) - border.gradient(target.rest_weight) + pull) / border.schur;
        for (entry, column) in positions.iter_mut().zip(&border.solved_column) {
            *entry -= column * bound;
        }
    }
    let mut displacement = vec![Vec3::zeros(); assembly.domain().mesh().points().len()];
    for (d, &v) in positions.chunks_exact(3).zip(assembly.free()) {
        displacement[v as usize] = Vec3::from_column_slice(d);
    }
    let (mut slacks, mut multipliers) = (Vec::with_capacity(rows.len()), Vec::with_capacity(rows.len()));
    for (row, change) in rows.iter().zip(&target.changes) {
        let of_value: f64 = row.gradient.iter().zip(tets[row.tet]).map(|(g, v)| g.dot(&displacement[v.index()])).sum();
        let of_limit = if row.follows_bound() { bound } else { 0.0 };
        let slack = of_limit - of_value - residual(row);
        slacks.push(slack);
        multipliers.push((change - row.multiplier * slack) / row.slack);
    }
    let primal = share(rows.iter().map(|row| row.slack).zip(&slacks));
    let dual = share(rows.iter().map(|row| row.multiplier).zip(&multipliers));
    Step { positions, bound, slacks, multipliers, primal, dual }
}

/// The share of changes of positive values that leaves them positive.
fn share<'c>(values: impl Iterator<Item = (f64, &'c f64)>) -> f64 {
    values
        .filter(|(_, change)| **change < 0.0)
        .fold(1.0, |share: f64, (value, change)| share.min(-TO_THE_BOUNDARY * value / change))
}

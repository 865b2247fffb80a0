//! The end of the minimax continuation: a primal-dual interior-point method for min t subject to g <= t, g = ln K_O and
//! g = ln K_I of every tet; or the least mean dilatation for a given t. Where vertices slide on a sphere, further constraints keep the triangles
//! of the boundary at their least openings.
//!
//! Constraints near the bound have a slack s > 0 and a multiplier each; all others have a logarithmic barrier. Each
//! factorisation serves a predictor, a corrector (Mehrotra 1992, doi 10.1137/0802028) and a few corrections of single
//! products s * multiplier (Gondzio 1996, doi 10.1007/BF00249643). Slacks need not be t - g until the end, so that iterates
//! may violate constraints. There is no merit function: with one, a thousand active tets on a curved surface cut most steps
//! to a tenth.

mod system;

use super::damping::{Damping, rounding};
use super::line_search::{HALVINGS, dot};
use super::recorder::PhaseEnd;
use super::{KktResidual, Progress, Recorder};
use crate::mesh::{Vec3, VertexId};
use crate::objective::{
    Assembly, Barrier, Iterate, NearActive, NearOpening, OpeningDerivatives, PrimalDual, TetFunction, opening,
};
use system::{Constraint, Row, Step, System, Target};

/// Distance of the first bound above the present ln max K: in ln K, and as a share of it where that is less. Where thousands of tets
/// come near the maximum together, a first centre from which they are seen saves half the steps.
const FIRST_SLACK: (f64, f64) = (0.1, 0.1);
/// Least slack of a constraint that comes near: as a share of the bound, and in ln K where the bound is given. It may be larger than the
/// distance, and must be where steps have led past the bound; where all start at the bound, small ones would hold every step back.
const LEAST_SLACK: (f64, f64) = (0.01, 0.001);
/// The first weight as a share of that for which the first bound is stationary: with all of it the first centres lie so far
/// above the maximum that few constraints are near them.
const FIRST_WEIGHT: f64 = 0.1;
/// Largest ln K and bound that a step may lead to, as a multiple of the first bound, and the largest ln K as one of the bound then.
const CEILING: f64 = 1.2;
const BEYOND: f64 = 1.3;
/// How much the mean may be expected to fall, relative: it sets the first weight where the bound is given.
const FIRST_GAIN: f64 = 0.3;
/// A constraint gets a multiplier where its slack is below the first share of the bound, and loses it above the second. At
/// larger shares its singular value could still become a double one, see [`PrimalDual`].
const NEAR: (f64, f64) = (0.2, 0.3);
/// The same of a triangle's opening beyond its least one.
const NEAR_OPENING: (f64, f64) = (0.1, 0.2);
/// Least slack of an opening that comes near, as [`LEAST_SLACK`].
const LEAST_SLACK_OF_OPENING: f64 = 0.01;
/// How far triangles may have opened beyond their least openings in what is kept: the reach of the tolerance.
pub(super) const OPENED: f64 = 1e-6;
/// Least share of the products s * multiplier that a step aims at.
const LEAST_CENTRING: f64 = 0.05;
/// Share of the tolerance that the products and the barrier on the rest may take up together.
const LAST_SHARE: f64 = 0.3;
/// Most corrections of single products a factorisation, how much longer a step each aims at, and the share of that which
/// it must gain to be kept.
const CORRECTIONS: (usize, f64, f64) = (3, 0.3, 0.1);
/// A product is left as it is between these multiples of the target.
const CENTRED: (f64, f64) = (0.1, 10.0);
/// Largest multiple by which a product may differ from the target after a step.
const PRODUCTS: f64 = 1e4;
/// Share of the tolerance that is as good as reached: what is reported is measured anew, with other rounding.
const REACHED: f64 = 0.7;
/// Largest violation of a given bound, in ln K.
pub(super) const VIOLATION: f64 = 1e-5;
/// Most Newton steps; 8 to 35 are usual, 44 the most seen where no vertex slides, 78 (tetra-10k) where they do.
pub(super) const MOST_STEPS: usize = 400;
/// Steps in a row below the second entry that end it.
const SHORT: (usize, f64) = (6, 1e-3);
/// Steps in a row that leave the weight as it is, after which it is lowered to this share in any case: few constraints may be
/// near a centre far above the maximum, and steps then go to and fro about it. Not so where vertices slide, whose first centre has
/// many constraints near it: there the predictor alone says when.
const IDLE: (usize, f64) = (5, 0.3);
/// After a step shorter than the first entry the weight may rise, up to the second one times what it was, and times the first one:
/// where ever more constraints come near, it has fallen too soon, and the steps to its centre are a hundredth of their length.
const RISE: (f64, f64) = (0.3, 3.0);
/// Length of a step after which the weight may fall in any case.
const LONG: f64 = 0.9;
/// How often the weight may rise before promises are believed no more: tetra-10k needs 23 of 78 steps for it where its boundary slides, and
/// nearly 400 steps if it may no more than 5 times. In a long thin solid with K in the hundreds promises are never kept, and 400 steps that
/// believe each of them lead nowhere.
const RISES: usize = 30;
/// Complementarity from which it is clear whether the multipliers stay away from the rim, and the share of them from where
/// a larger region is needed.
const RIM: (f64, f64) = (1e-3, 1e-2);
/// What the progress shows when all but the polish is done.
const BEFORE_POLISH: f64 = 0.9;
/// Shift of the diagonal, relative to the squared scale of the constraints' gradients: it holds in place what only the weak
/// barrier moves, which else drifts and shortens every step.
const SHIFT: f64 = 1e-9;

/// What is minimised.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Goal {
    /// The bound on ln K.
    Bound,
    /// The sum of K_I + K_O and four smaller terms of each tet, relative to its first value, with this bound.
    Mean(f64),
}

/// How a phase ended.
pub(super) struct Settled {
    pub end: PhaseEnd,
    /// The bound on ln K; `None` if nothing was solved.
    pub bound: Option<f64>,
    /// Multipliers of near-active constraints: the tet, its side (0 for K_O, 1 for K_I), the multiplier.
    pub multipliers: Vec<(usize, usize, f64)>,
    /// Those of triangles near their least opening, by their place in the boundary.
    pub openings: Vec<(usize, f64)>,
}

/// Minimises ln max K, or the mean, from `iterate` until the Karush-Kuhn-Tucker conditions hold to within `tolerance`, or until it is clear
/// that they cannot hold beyond the tets marked in `rim`, or for so many steps.
pub(super) fn interior_point_phase(
    assembly: &mut Assembly<'_>,
    iterate: &mut Iterate,
    goal: Goal,
    tolerance: f64,
    rim: &[bool],
    most_steps: usize,
    recorder: &mut Recorder<'_>,
) -> Settled {
    let Some(mut path) = Path::first(assembly, iterate, goal, tolerance) else {
        return Settled { end: PhaseEnd::NoProgress, bound: None, multipliers: Vec::new(), openings: Vec::new() };
    };
    let end = path.follow(assembly, iterate, rim, most_steps, recorder);
    recorder.admits = true;
    let sides = |(tet, pair): (usize, &[Option<NearActive>; 2])| {
        [0, 1].map(|side| pair[side].map(|constraint| (tet, side, constraint.multiplier)))
    };
    let multipliers = path.problem.near_active.iter().enumerate().flat_map(sides).flatten().collect();
    let openings = path.problem.openings.iter().map(|near| (near.triangle, near.constraint.multiplier)).collect();
    Settled { end, bound: Some(path.problem.bound), multipliers, openings }
}

/// The triangles of the boundary with a least opening.
fn watched(assembly: &Assembly<'_>) -> Vec<NearOpening> {
    let boundary = assembly.domain().boundary();
    let none = NearActive { slack: f64::INFINITY, multiplier: 0.0 };
    let least_openings = assembly.unknowns().least_openings().iter();
    let mut watched: Vec<NearOpening> = least_openings
        .zip(boundary.triangles().iter().zip(boundary.owners()))
        .enumerate()
        .map(|(triangle, (_, (corners, owner)))| {
            let tet = assembly.domain().mesh().tets()[owner.index()];
            let place = |corner: &VertexId| tet.iter().position(|v| v == corner).expect("a face of its tet");
            let corners = corners.each_ref().map(place);
            NearOpening { triangle, tet: owner.index(), corners, constraint: none }
        })
        .collect();
    watched.sort_by_key(|near| near.tet);
    watched
}

/// The present multipliers and slacks, and where they are to go.
struct Path {
    goal: Goal,
    problem: PrimalDual,
    tolerance: f64,
    /// Largest ln K that a step may lead to.
    ceiling: f64,
    /// The triangles of the boundary with a least opening, by their tets, ascending, without slack and multiplier.
    watched: Vec<NearOpening>,
}

impl Path {
    fn first(assembly: &Assembly<'_>, iterate: &Iterate, goal: Goal, tolerance: f64) -> Option<Self> {
        let tets = assembly.domain().mesh().tets().len();
        let (bound, rest_weight, mean_weight) = match goal {
            Goal::Bound => {
                let largest = 3.0 * iterate.largest_log()?;
                let bound = largest + FIRST_SLACK.0.min(FIRST_SLACK.1 * largest);
                let stationary = -1.0 / assembly.bound_derivatives(&Barrier { bound }, iterate)?.0;
                (bound, FIRST_WEIGHT * stationary, 0.0)
            }
            Goal::Mean(bound) => {
                let sum_of_tet = |logs: [f64; 3]| logs.iter().map(|log| 2.0 * (3.0 * log).cosh()).sum();
                let [sum] = assembly.sum_of_logs(iterate, |_, logs| [sum_of_tet(logs)])?;
                (bound, FIRST_GAIN / (6.0 * tets as f64), 1.0 / sum)
            }
        };
        let near_active = vec![[None; 2]; tets];
        let problem = PrimalDual { bound, rest_weight, mean_weight, near_active, openings: Vec::new() };
        let mut path = Self { goal, problem, tolerance, ceiling: CEILING * bound, watched: watched(assembly) };
        // Where the bound is free, multipliers that add up to 1 with those of the rest: with a tenth of that the first step
        // leads far away where few tets hold it back.
        let weight = if goal == Goal::Bound { rest_weight / FIRST_WEIGHT } else { rest_weight };
        path.select(assembly, iterate, weight);
        Some(path)
    }

    fn follow(
        &mut self,
        assembly: &mut Assembly<'_>,
        iterate: &mut Iterate,
        rim: &[bool],
        most_steps: usize,
        recorder: &mut Recorder<'_>,
    ) -> PhaseEnd {
        let slides = assembly.unknowns().slides();
        let mut damping = Damping::new(assembly);
        let (mut short, mut idle, mut rises) = (0, 0, 0);
        let share = recorder.progress;
        let mut first_gap = None;
        let first_weight = self.problem.rest_weight;
        let mut length: f64 = 1.0;
        for _ in 0..most_steps {
            self.select(assembly, iterate, self.problem.rest_weight);
            let Some(rows) = self.rows(assembly, iterate) else { return PhaseEnd::NoProgress };
            let Some((system, residual)) = self.system(assembly, iterate, &rows, &mut damping) else {
                return PhaseEnd::NoProgress;
            };
            let reached = residual.largest() < REACHED * self.tolerance
                && (self.goal == Goal::Bound || residual.primal < VIOLATION);
            // Optimal, or nearly at K = 1, below which there is nothing, or as good as it gets.
            if reached || self.problem.bound < REACHED * self.tolerance || short == SHORT.0 {
                return PhaseEnd::Converged;
            }
            let at_rim: f64 = rows.iter().filter(|row| rim[row.tet]).map(|row| row.multiplier).sum();
            if residual.complementarity < RIM.0 && at_rim > RIM.1 {
                return PhaseEnd::Converged;
            }
            let first = *first_gap.get_or_insert(residual.complementarity);
            let done = (first / residual.complementarity).ln() / (first / self.tolerance).ln();
            let (phase, last) = match self.goal {
                Goal::Bound => ("minimax", BEFORE_POLISH),
                Goal::Mean(_) => ("mean", 1.0),
            };
            recorder.progress = share + (last - share) * done.clamp(0.0, 1.0);
            let most = match length < RISE.0 {
                true => RISE.1 * self.problem.rest_weight.min(first_weight),
                false if idle >= IDLE.0 && !slides => IDLE.1 * self.problem.rest_weight,
                false => self.problem.rest_weight,
            };
            let most_promised = if length < LONG && rises < RISES { first_weight } else { 0.0 };
            let (step, weight) = self.step(assembly, iterate.image(), &system, &rows, most, most_promised);
            rises += usize::from(weight > self.problem.rest_weight.min(most));
            idle = if weight < 0.9 * self.problem.rest_weight { 0 } else { idle + 1 };
            let Some(taken) = self.advance(assembly, iterate, &rows, &step, weight) else {
                return PhaseEnd::NoProgress;
            };
            length = taken;
            short = if length < SHORT.1 { short + 1 } else { 0 };
            recorder.admits = assembly.opened_too_far(iterate.image()) <= OPENED;
            if recorder.record(phase, self.problem.bound, length, iterate) == Progress::Stop {
                return PhaseEnd::Interrupted;
            }
            damping.less();
        }
        PhaseEnd::Converged
    }

    /// Gives multipliers to the constraints that have come near the bound, and takes them from those that have left.
    fn select(&mut self, assembly: &Assembly<'_>, iterate: &Iterate, weight: f64) {
        self.select_openings(assembly, iterate.image(), weight);
        let problem = &mut self.problem;
        let least = match self.goal {
            Goal::Bound => LEAST_SLACK.0 * problem.bound,
            Goal::Mean(_) => LEAST_SLACK.1,
        };
        for (tet, logs) in iterate.logs().enumerate() {
            let Some(logs) = logs else { continue };
            for (entry, (axis, factor)) in problem.near_active[tet].iter_mut().zip(PrimalDual::SIDES) {
                let slack = problem.bound - factor * logs[axis];
                if slack > NEAR.1 * problem.bound {
                    *entry = None;
                } else if entry.is_none() && slack < NEAR.0 * problem.bound {
                    let slack = slack.max(least);
                    // As the barrier of this weight had it until now.
                    *entry = Some(NearActive { slack, multiplier: weight / slack });
                }
            }
        }
    }

    fn select_openings(&mut self, assembly: &Assembly<'_>, image: &[Vec3], weight: f64) {
        let triangles = assembly.domain().boundary().triangles();
        let least_openings = assembly.unknowns().least_openings();
        let mut before = std::mem::take(&mut self.problem.openings).into_iter().peekable();
        for watched in &self.watched {
            let kept = before.next_if(|near| near.triangle == watched.triangle);
            let least = least_openings[watched.triangle];
            let slack = opening(triangles[watched.triangle].each_ref().map(|v| &image[v.index()])) - least;
            if kept.is_some() && slack <= NEAR_OPENING.1 {
                self.problem.openings.extend(kept);
            } else if slack < NEAR_OPENING.0 {
                let slack = slack.max(LEAST_SLACK_OF_OPENING);
                let constraint = NearActive { slack, multiplier: weight / slack };
                self.problem.openings.push(NearOpening { constraint, ..*watched });
            }
        }
    }

    fn rows(&self, assembly: &Assembly<'_>, iterate: &Iterate) -> Option<Vec<Row>> {
        let mut rows = Vec::new();
        for (place, near) in self.problem.openings.iter().enumerate() {
            let tet = assembly.domain().mesh().tets()[near.tet];
            let derivatives = OpeningDerivatives::of(near.corners.map(|corner| &iterate.image()[tet[corner].index()]));
            let mut gradient = [Vec3::zeros(); 4];
            for (corner, g) in near.corners.into_iter().zip(derivatives.gradient) {
                gradient[corner] = -g;
            }
            let least = assembly.unknowns().least_openings()[near.triangle];
            let NearActive { slack, multiplier } = near.constraint;
            let of = Constraint::Opening { place };
            rows.push(Row { tet: near.tet, of, value: -derivatives.value, limit: -least, gradient, slack, multiplier });
        }
        for (tet, pair) in self.problem.near_active.iter().enumerate() {
            if pair.iter().all(Option::is_none) {
                continue;
            }
            for (side, (constraint, function)) in
                pair.iter().zip(iterate.functions(assembly.domain(), tet)?).enumerate()
            {
                if let Some(NearActive { slack, multiplier }) = *constraint {
                    let (of, limit) = (Constraint::Dilatation { side }, self.problem.bound);
                    let TetFunction { value, gradient } = function;
                    rows.push(Row { tet, of, value, limit, gradient, slack, multiplier });
                }
            }
        }
        Some(rows)
    }

    /// The factorised system, damped until it is positive definite, and how far all is from stationary; `None` if it never
    /// is.
    fn system(
        &self,
        assembly: &mut Assembly<'_>,
        iterate: &Iterate,
        rows: &[Row],
        damping: &mut Damping,
    ) -> Option<(System, KktResidual)> {
        let problem = &self.problem;
        let distance = |row: &Row| row.limit - row.value;
        let near: f64 = rows.iter().map(|row| row.multiplier * distance(row).abs()).sum();
        let mut residual = KktResidual {
            primal: rows.iter().map(|row| -distance(row)).fold(0.0, f64::max),
            dual: f64::INFINITY,
            complementarity: near + self.terms() * problem.rest_weight,
        };
        damping.measure(assembly, iterate.image());
        loop {
            let lagrangian = assembly.linearize(problem, iterate, damping.negative())?;
            let scale = assembly.gradient_scale();
            residual.dual = dot(&lagrangian, &lagrangian).sqrt() / scale;
            let system = assembly.system();
            system.shift_diagonal(rounding(system.largest_diagonal()).max(SHIFT * scale * scale));
            damping.shift(system);
            loop {
                if assembly.system().factorize().is_ok()
                    && let Some(system) =
                        System::new(assembly, iterate, problem, rows, lagrangian.clone(), self.goal == Goal::Bound)
                {
                    residual.dual = residual.dual.max(system.bound_gradient(problem.rest_weight).abs());
                    return Some((system, residual));
                }
                if damping.more(assembly.system())? {
                    break;
                }
            }
        }
    }

    /// Number of terms of the barrier, were it on all.
    fn terms(&self) -> f64 {
        6.0 * self.problem.near_active.len() as f64
    }

    /// The step to the next weight, and that weight, at most `most`; where the predictor promises more than the products, it may be up to `most_promised`.
    fn step(
        &self,
        assembly: &mut Assembly<'_>,
        image: &[Vec3],
        system: &System,
        rows: &[Row],
        most: f64,
        most_promised: f64,
    ) -> (Step, f64) {
        let problem = &self.problem;
        let count = rows.len().max(1) as f64;
        let present =
            if rows.is_empty() { problem.rest_weight } else { rows.iter().map(Row::product).sum::<f64>() / count };
        let affine = &system.predictor;
        let reached = affine.products(rows, affine.primal, affine.dual).sum::<f64>() / count;
        // Without a near constraint nothing tells how far to go.
        let centring = if rows.is_empty() { 1.0 } else { (reached / present).powi(3).clamp(LEAST_CENTRING, 1.0) };
        // The multipliers of the rest are the weight over slacks of the bound's size.
        let last = LAST_SHARE * self.tolerance * problem.bound.min(1.0) / (count + self.terms());
        let mut weight = (centring * present).min(most).max(last);
        // Where all is convex and multipliers are stationary, the bound lies above its least value by no more than the sum of the products.
        // A predictor that promises more tells of a way along which constraints are to come and go yet, and small products make its steps short.
        let promised = -affine.bound / count;
        if promised > present {
            weight = weight.max(promised.min(most_promised));
        }
        // The predictor aims at 0: of the way to the present weight itself its products say nothing.
        let trust = (1.0 - weight / problem.rest_weight).max(0.0).powi(2);
        let second_order = |k: usize| {
            trust * (affine.slacks[k] * affine.multipliers[k]).clamp(-CENTRED.1 * present, CENTRED.1 * present)
        };
        let changes = rows.iter().enumerate().map(|(k, row)| weight - row.product() - second_order(k)).collect();
        let mut target = Target { rest_weight: weight, changes };
        let mut best = system.solve(assembly, image, problem, rows, &target);
        for _ in 0..CORRECTIONS.0 {
            let longer = |share: f64| (share + CORRECTIONS.1).min(1.0);
            let (primal, dual) = (longer(best.primal), longer(best.dual));
            let missing: Vec<f64> = best
                .products(rows, primal, dual)
                .map(|product| {
                    (product.clamp(CENTRED.0 * weight, CENTRED.1 * weight) - product).max(-CENTRED.1 * weight)
                })
                .collect();
            for (change, missing) in target.changes.iter_mut().zip(&missing) {
                *change += missing;
            }
            let corrected = system.solve(assembly, image, problem, rows, &target);
            let gain = corrected.primal + corrected.dual - best.primal - best.dual;
            if gain < CORRECTIONS.1 * CORRECTIONS.2 {
                break;
            }
            best = corrected;
        }
        (best, weight)
    }

    /// Takes the step, halved until no tet is flipped, neither a K nor the bound above the ceiling, and no K too far above the bound; the
    /// share taken. What has no multiplier yet may be beyond the bound then.
    fn advance(
        &mut self,
        assembly: &Assembly<'_>,
        iterate: &mut Iterate,
        rows: &[Row],
        step: &Step,
        weight: f64,
    ) -> Option<f64> {
        let mut length = step.primal;
        let mut tried = 0;
        let trial = loop {
            let image = assembly.moved(iterate.image(), &step.positions, length);
            let bound = self.problem.bound + length * step.bound;
            if bound <= self.ceiling && assembly.turned_triangle(&image).is_none() {
                let trial = assembly.at(image);
                if trial.largest_log().is_some_and(|largest| 3.0 * largest <= self.ceiling.min(BEYOND * bound)) {
                    break trial;
                }
            }
            tried += 1;
            if tried > HALVINGS {
                return None;
            }
            length *= 0.5;
        };
        let problem = &mut self.problem;
        problem.bound += length * step.bound;
        problem.rest_weight = weight;
        let logs: Vec<_> = trial.logs().collect();
        for (k, row) in rows.iter().enumerate() {
            let distance = match row.of {
                Constraint::Dilatation { side } => {
                    let (axis, factor) = PrimalDual::SIDES[side];
                    problem.bound - factor * logs[row.tet]?[axis]
                }
                Constraint::Opening { place } => {
                    let near = &problem.openings[place];
                    let tet = assembly.domain().mesh().tets()[near.tet];
                    row.limit + opening(near.corners.map(|corner| &trial.image()[tet[corner].index()]))
                }
            };
            let slack = (row.slack + length * step.slacks[k]).max(distance);
            let multiplier = row.multiplier + step.dual * step.multipliers[k];
            let multiplier = multiplier.clamp(weight / PRODUCTS / slack, weight * PRODUCTS / slack);
            match row.of {
                Constraint::Dilatation { side } => {
                    problem.near_active[row.tet][side] = Some(NearActive { slack, multiplier });
                }
                Constraint::Opening { place } => problem.openings[place].constraint = NearActive { slack, multiplier },
            }
        }
        *iterate = trial;
        Some(length)
    }
}

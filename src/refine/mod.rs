//! Refinement where the largest K sits, so that the mesh is not what limits a map.
//!
//! A few tets decide the largest K, and how bad they are is an accident of the mesh: a finer mesh of the same solid may well end
//! at a larger K. The multipliers of the minimax problem name one place at a time, and one after the other takes as many rounds as
//! there are places. A soft maximum is low at all of them at once: each round halves the edges that gain most per tet,
//! carries the positions over on both sides, which changes no K, and lowers it again there. The largest K itself is settled at the end.
//!
//! Before a round's halvings tets of large K are flipped, 2-3 at a face or all about an edge (3-2, 4-4, ...), where that lowers the largest K of those that are
//! replaced: it costs no tets. Without, cube-100k ends at 5.885 after 8 rounds with 3 % more tets, with flips at 5.18.
//!
//! Edges of the boundary surface stay whole: the solid, its surface and the values there are what they were, so that K falls or
//! stays in every round, and what the boundary values alone prove ([`unchanging_bound`]) holds in all of them.
//!
//! Or edges of the surface are halved as well. The solid stays what it was, its sharp edges are those that they were; new vertices of the
//! surface go to the sphere, where the boundary map sends them, and slide from there if the boundary does. The image comes nearer to the ball, its angles
//! open, and K onto it rises with them. What is lowered and judged there is K onto the ball, as for the objective "ball", in the rounds
//! by a soft maximum; the map that is returned has the least certified one of all that were settled, the start among them. The map may be like powers at corners of the solid: their elements stay as they are but for the edges opposite to the
//! corners.

mod flips;
mod gain;
mod halving;
mod settings;
mod surface;

use serde::{Deserialize, Serialize};

use self::surface::Held;
use crate::bound::{BoundaryImage, LowerBound, best_applicable, edge_ratio, trace, vertex};
use crate::domain::Domain;
use crate::map::Corners;
use crate::measure::{Summary, measure, measure_onto_ball_until, measure_warped_onto_ball};
use crate::mesh::{BoundaryEdges, MeshChanges, TetId, Vec3, VertexId};
use crate::optimize::{
    Objective, OptimizeError, OptimizeSettings, Outcome, Polish, Start, StopReason, TraceRow, Warped, optimize_from,
};

pub use settings::{Budget, RefineSettings};
pub(crate) use surface::Middles;

/// Exponent of the soft maximum of the rounds. With 32 the rounds take longer, and what they end at is as often worse as better.
const EXPONENT: f64 = 16.0;
/// Fall in ln K of a step of the rounds below which there is no further one: with 1e-3 they end at the same maps, later.
const ROUGH: f64 = 4e-3;
/// The same two where edges of the surface are halved: there tets that a soft maximum of 16 leaves behind, which the maximum does not, draw
/// too many of the halves to them.
const OF_SURFACE: (f64, f64) = (32.0, 1e-3);
/// Problems of K onto the ball in a round: with three the rounds take as long again, and a cube ends at 4.95 instead of 5.03.
const PROBLEMS: usize = 1;

/// Why refinement ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RefineEnd {
    /// K is as near to a bound that refinement inside cannot change as was asked.
    BoundaryValues,
    /// The next round would add more tets than allowed.
    Budget,
    /// All rounds were made.
    Rounds,
    /// No tet that holds K has an edge that gains anything where it is halved.
    NoEdge,
    /// K onto the ball was larger after each round than before the first: the mesh is what it was.
    NoGain,
    /// There was nothing to refine for: the map was not settled, since tets are flipped or a limit ended it.
    NotSettled,
}

/// One round.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// How many tets were replaced by flips before.
    #[serde(default)]
    pub flipped: usize,
    /// How many edges were halved.
    pub edges: usize,
    /// How many tets there are since.
    pub tets: usize,
    /// The least largest K of a map so far, onto the ball where the surface is refined. That of a soft maximum is some way above what the mesh
    /// allows.
    pub max_k: f64,
}

/// A map that was optimized on a mesh that is to be refined for it.
#[derive(Clone, Debug)]
pub struct Unrefined {
    /// The domain.
    pub domain: Domain,
    /// The map that was optimized.
    pub start: Vec<Vec3>,
    /// What came of it, without a polish, which comes at the end, but not where the surface is refined.
    pub outcome: Outcome,
    /// Corner elements of the map, the tets around corners, where the surface is refined; `None` for a map that is piecewise linear.
    pub corners: Option<Corners>,
    /// The centre of a start whose boundary map is radial.
    pub centre: Option<Vec3>,
}

/// A map on a mesh that was refined for it.
#[derive(Clone, Debug)]
pub struct RefinedMap {
    /// The refined domain.
    pub domain: Domain,
    /// The start that was given, on it: new vertices are halfway between those they were put between; where the surface was refined, on the
    /// sphere at the boundary, and on their rays inside if the start is radial, which may flip thin tets.
    pub start: Vec<Vec3>,
    /// The map, with the rows of all rounds.
    pub outcome: Outcome,
    /// Its corner elements, with the exponents that they had.
    pub corners: Option<Corners>,
    /// The edges that were halved and the tets that were flipped.
    pub changes: MeshChanges,
    /// The largest K before the first of them, on the mesh as it was; `None` where the map was not settled.
    pub max_k_before: Option<f64>,
    /// The rounds.
    pub rounds: Vec<Round>,
    /// Why there was no further one.
    pub end: RefineEnd,
}

/// The largest of the bounds that no refinement inside changes, for all piecewise-linear maps of any such mesh with these boundary
/// positions: the trace of the surface's triangles, the ratio of the angles at its edges, and the solid angles at its vertices.
///
/// # Panics
/// If `image` has fewer positions than the domain has vertices.
pub fn unchanging_bound(domain: &Domain, image: &[Vec3]) -> Option<LowerBound> {
    let edges = BoundaryEdges::of(domain.mesh(), domain.boundary());
    let of_boundary = BoundaryImage::new(domain, &edges, image);
    let mut bounds = vertex(domain, &edges, of_boundary);
    bounds.extend(edge_ratio(domain, &edges, of_boundary));
    bounds.extend(trace(domain, image));
    best_applicable(&bounds).cloned()
}

/// Refines a mesh about the tets that hold the largest K of a map that was optimized on it, round by round, and settles it again; the
/// boundary's vertices are fixed, or slide on the sphere where the surface is refined.
///
/// The result is the same to the bit for any number of threads.
///
/// # Errors
/// As [`crate::optimize()`]; a map that is not onto the ball where the surface is to be refined.
pub fn refine(
    map: Unrefined,
    settings: &OptimizeSettings,
    refinement: &RefineSettings,
    observe: &mut dyn FnMut(&TraceRow),
) -> Result<RefinedMap, OptimizeError> {
    let Unrefined { domain, start, outcome, corners, centre } = map;
    let tets_before = domain.mesh().tets().len();
    let budget = refinement.tets.of(tets_before);
    let (changes, rounds) = (MeshChanges::default(), Vec::new());
    let mut refined =
        RefinedMap { domain, start, outcome, corners, changes, max_k_before: None, rounds, end: RefineEnd::NotSettled };
    let surface = refinement.surface;
    if !matches!(refined.outcome.stop, StopReason::Optimal | StopReason::Converged | StopReason::NoProgress) {
        if surface {
            refined.take_better_start(settings, observe);
        }
        return Ok(refined);
    }
    let middles = Middles { of_surface: surface, centre };
    let (exponent, rough) = if surface { OF_SURFACE } else { (EXPONENT, ROUGH) };
    let softly = OptimizeSettings {
        objective: Objective::SoftMax(exponent),
        polish: Polish::None,
        tolerance: settings.tolerance.max(rough),
        ..settings.clone()
    };
    let unchanging = || unchanging_bound(&refined.domain, &refined.outcome.positions);
    let bound = if surface { 1.0 } else { unchanging().map_or(1.0, |bound| bound.value) };
    if surface {
        // What is gained is gained over the best map of the mesh as it is.
        refined.settle_first_onto_ball(settings, observe)?;
    }
    // The map of least K so far; the outcome's is the soft maximum's. Where the surface is refined it is one of a coarser mesh for good.
    let mut best = refined.outcome.positions.clone();
    let mut kept = surface.then(|| refined.clone());
    let mut reached = refined.max_k(&best, surface, settings);
    refined.max_k_before = Some(reached);
    refined.end = loop {
        if reached <= bound * (1.0 + refinement.until) {
            break RefineEnd::BoundaryValues;
        }
        let round = refined.rounds.len() + 1;
        if round > refinement.rounds {
            break RefineEnd::Rounds;
        }
        if settings.cancel.is_due() || refined.outcome.trace.len() > settings.max_iterations {
            break RefineEnd::NotSettled;
        }
        // What they come to is kept if an edge is halved afterwards.
        let before = refined.flip(&best, reached, surface);
        let gains = refined.gains(2 * round <= refinement.rounds, &middles);
        // Flips may take more tets away than halving has added.
        let added = refined.domain.mesh().tets().len().saturating_sub(tets_before);
        let left = refinement.rounds + 1 - round;
        let most = tets_before.saturating_add(budget);
        let part = if surface {
            // Many times the tets there were: as many times more in each round, since what they are best for is seen on what there is.
            let now = (tets_before + added) as f64;
            (now * (most as f64 / now).powf(1.0 / left as f64)) as usize
        } else {
            tets_before + added + budget.saturating_sub(added) / left
        };
        let halves = match refined.halves([part, most], gains, &middles, &best) {
            Ok(halves) => halves,
            Err(end) => {
                if let Some(before) = before {
                    refined.changes.flips.pop();
                    refined.domain = before;
                    refined.corners = refined.corners.and_then(|corners| corners.around(&refined.domain).ok());
                }
                break end;
            }
        };
        let edges = halves.edges.len();
        let flipped = refined.changes.flips.last().filter(|_| before.is_some()).map_or(0, |flips| flips.old.len());
        refined.start = middles.extended_start(&halves.domain, &halves.edges, std::mem::take(&mut refined.start));
        (refined.domain, refined.corners) = (halves.domain, halves.corners);
        refined.changes.halved.extend(halves.edges);
        best = halves.best;
        if surface {
            refined.settle_onto_ball((round, PROBLEMS), halves.carried, &softly, observe)?;
        } else {
            refined.settle(round, &halves.carried, &softly, observe)?;
        }
        let max_k = refined.max_k(&refined.outcome.positions, surface, settings);
        // What K onto the ball is of a map that was ended is not known as that of the others is.
        let is_best = max_k < reached && !(surface && settings.cancel.is_due());
        if is_best {
            (reached, best) = (max_k, refined.outcome.positions.clone());
        }
        let tets = refined.domain.mesh().tets().len();
        refined.rounds.push(Round { flipped, edges, tets, max_k: reached });
        if is_best && surface {
            kept = Some(refined.clone());
        }
    };
    if let Some(kept) = kept {
        return refined.settled_onto_ball(kept, reached, settings, observe);
    }
    let round = refined.rounds.len();
    if (settings.polish != Polish::None || round > 0) && !settings.cancel.is_due() {
        let soft = std::mem::take(&mut refined.outcome.positions);
        refined.settle(round, &soft, settings, observe)?;
        if refined.max_k(&refined.outcome.positions, surface, settings) > reached * (1.0 + settings.rise) {
            refined.settle(round, &best, settings, observe)?;
        }
    } else {
        refined.outcome.positions = best;
        if let Some(due) = StopReason::of(&settings.cancel) {
            refined.leave(due, observe);
        }
    }
    Ok(refined)
}

impl RefinedMap {
    /// Flips tets of large K; the domain that was, if any were.
    fn flip(&mut self, best: &[Vec3], reached: f64, surface: bool) -> Option<Domain> {
        let (domain, flips) = self.flipped(best, reached, surface)?;
        self.changes.flips.push(flips);
        let before = std::mem::replace(&mut self.domain, domain);
        // No tet at a corner is flipped, but their numbers are others.
        self.corners = self.corners.take().and_then(|corners| corners.around(&self.domain).ok());
        Some(before)
    }

    /// The largest K of a map. That onto the ball, if it is asked for, is what is proved of it, or as far as points of the tets tell once the
    /// work is to end.
    fn max_k(&self, positions: &[Vec3], onto_ball: bool, settings: &OptimizeSettings) -> f64 {
        if !onto_ball {
            return measure(&self.domain, positions).summary.max_k;
        }
        // An element of a corner may be turned over where its tet is not.
        let elements = self.corners.as_ref().map(|corners| corners.elements(&self.domain).domain);
        if measure(elements.as_ref().unwrap_or(&self.domain), positions).summary.flipped > 0 {
            return f64::INFINITY;
        }
        let proved = || match &self.corners {
            Some(corners) => measure_warped_onto_ball(&self.domain, corners, positions, None, &settings.cancel),
            None => measure_onto_ball_until(&self.domain, positions, &settings.cancel),
        };
        let by_points =
            || Held::of(&self.domain, self.corners.as_ref(), positions).map_or(f64::INFINITY, |held| held.k());
        let proved = if settings.cancel.is_due() { None } else { proved().summary.ball_k };
        proved.filter(|k| !k.cut_short).map_or_else(by_points, |k| k.certified)
    }

    /// What is told where the map that is kept is not settled any more, and why. A round that lowered K by halving alone, or by the last bits, has no
    /// row of its own.
    fn leave(&mut self, why: StopReason, observe: &mut dyn FnMut(&TraceRow)) {
        if !self.rounds.is_empty() {
            self.tell_of_best(observe);
        }
        (self.end, self.outcome.stop) = (RefineEnd::NotSettled, why);
    }

    /// A row of the map that is returned, where it was taken over from a coarser mesh as it was: there are more tets to its mean now.
    fn tell_of_best(&mut self, observe: &mut dyn FnMut(&TraceRow)) {
        let Some(last) = self.outcome.trace.last().cloned() else { return };
        let elements = self.corners.as_ref().map(|corners| corners.elements(&self.domain).domain);
        let domain = elements.as_ref().unwrap_or(&self.domain);
        let Summary { max_k, mean_k, .. } = measure(domain, &self.outcome.positions).summary;
        let (iteration, objective) = (self.outcome.trace.len(), max_k.ln());
        let row = TraceRow { phase: "best".into(), iteration, objective, max_k, mean_k, step: 0.0, ..last };
        observe(&row);
        self.outcome.trace.push(row);
    }

    /// Lowers K onto the ball from positions that were settled on a coarser mesh, by so many problems at most.
    fn settle_onto_ball(
        &mut self,
        (round, problems): (usize, usize),
        positions: Vec<Vec3>,
        settings: &OptimizeSettings,
        observe: &mut dyn FnMut(&TraceRow),
    ) -> Result<(), OptimizeError> {
        let warped = Warped { domain: &self.domain, corners: self.corners.as_ref(), mirrors: None, onto_ball: true };
        let done = self.outcome.trace.len();
        let mut told = |row: &TraceRow| observe(&TraceRow { round, ..row.clone() });
        let settled = Outcome { positions, ..self.outcome.clone() };
        self.outcome = warped.settle_onto_ball(settled, problems, settings, &mut told)?;
        self.outcome.trace.iter_mut().skip(done).for_each(|row| row.round = round);
        Ok(())
    }

    /// Lowers K onto the ball on the mesh as it is, from the map that is there, or from the start where K onto the ball is below what that comes to: on coarse
    /// meshes a small K onto the polyhedron may go with a large one onto the ball.
    fn settle_first_onto_ball(
        &mut self,
        settings: &OptimizeSettings,
        observe: &mut dyn FnMut(&TraceRow),
    ) -> Result<(), OptimizeError> {
        self.settle_last_onto_ball(settings, observe)?;
        if self.take_better_start(settings, observe) {
            self.settle_last_onto_ball(settings, observe)?;
        }
        Ok(())
    }

    /// Takes the start in place of the map if K onto the ball is smaller there; whether it is.
    fn take_better_start(&mut self, settings: &OptimizeSettings, observe: &mut dyn FnMut(&TraceRow)) -> bool {
        let k = |image: &[Vec3]| self.max_k(image, true, settings);
        let is_better = k(&self.start) < k(&self.outcome.positions);
        if is_better {
            self.outcome.positions.clone_from(&self.start);
            self.tell_of_best(observe);
        }
        is_better
    }

    /// Lowers K onto the ball on the last mesh as far as it goes; what is no better by what is proved of it is left as it was.
    fn settle_last_onto_ball(
        &mut self,
        settings: &OptimizeSettings,
        observe: &mut dyn FnMut(&TraceRow),
    ) -> Result<(), OptimizeError> {
        let (rows, before) = (self.outcome.trace.len(), self.outcome.positions.clone());
        self.settle_onto_ball((self.rounds.len(), usize::MAX), before.clone(), settings, observe)?;
        if self.outcome.trace.len() > rows
            && self.max_k(&self.outcome.positions, true, settings) > self.max_k(&before, true, settings)
        {
            self.outcome.positions = before;
            self.tell_of_best(observe);
        }
        Ok(())
    }

    /// Settles K onto the ball on the last mesh; what was `kept` of an earlier one is settled where that is no better.
    fn settled_onto_ball(
        mut self,
        mut kept: Self,
        reached: f64,
        settings: &OptimizeSettings,
        observe: &mut dyn FnMut(&TraceRow),
    ) -> Result<Self, OptimizeError> {
        (kept.end, kept.max_k_before) = (self.end, self.max_k_before);
        if let Some(due) = StopReason::of(&settings.cancel) {
            kept.leave(due, observe);
            return Ok(kept);
        }
        if self.rounds.is_empty() {
            return Ok(kept);
        }
        let mut settle = |map: &mut Self| {
            let rows = map.outcome.trace.len();
            map.settle_last_onto_ball(settings, observe)?;
            if map.outcome.trace.len() == rows && rows <= settings.max_iterations {
                map.tell_of_best(observe);
            }
            Ok::<(), OptimizeError>(())
        };
        settle(&mut self)?;
        let ended = StopReason::of(&settings.cancel);
        if ended.is_none() && self.max_k(&self.outcome.positions, true, settings) <= reached {
            return Ok(self);
        }
        match (ended, kept.rounds.len()) {
            (Some(ended), _) => kept.leave(ended, observe),
            // It is settled.
            (None, 0) => kept.end = RefineEnd::NoGain,
            (None, _) => settle(&mut kept)?,
        }
        Ok(kept)
    }

    /// Optimizes from positions that were settled on a coarser mesh, and adds the rows to those of the rounds before.
    fn settle(
        &mut self,
        round: usize,
        positions: &[Vec3],
        settings: &OptimizeSettings,
        observe: &mut dyn FnMut(&TraceRow),
    ) -> Result<(), OptimizeError> {
        let mut rows = std::mem::take(&mut self.outcome.trace);
        let done = rows.len();
        let seconds = rows.last().map_or(0.0, |row| row.seconds);
        // Row 0 of each is the last map once more, on the new mesh.
        let in_sequence = |row: &TraceRow| TraceRow {
            iteration: done + row.iteration,
            round,
            seconds: seconds + row.seconds,
            ..row.clone()
        };
        let settings = OptimizeSettings {
            max_iterations: settings.max_iterations.saturating_sub(done.saturating_sub(1)),
            ..settings.clone()
        };
        let fixed = self.domain.boundary().vertex_mask();
        let mut told = |row: &TraceRow| observe(&in_sequence(row));
        self.outcome = optimize_from(Start::Settled, &self.domain, positions, fixed, &settings, &mut told)?;
        rows.extend(self.outcome.trace.iter().map(in_sequence));
        self.outcome.trace = rows;
        Ok(())
    }
}

/// The tets at each vertex.
fn tets_at_vertices(domain: &Domain) -> Vec<Vec<TetId>> {
    let mut at: Vec<Vec<TetId>> = vec![Vec::new(); domain.mesh().points().len()];
    for (id, tet) in (0..).map(TetId).zip(domain.mesh().tets()) {
        tet.iter().for_each(|v| at[v.index()].push(id));
    }
    at
}

/// The tets at an edge, of those at each vertex.
fn around<'m>(
    edge: [VertexId; 2],
    tets: &'m [[VertexId; 4]],
    at: &'m [Vec<TetId>],
) -> impl Iterator<Item = TetId> + 'm {
    at[edge[0].index()].iter().copied().filter(move |tet| tets[tet.index()].contains(&edge[1]))
}

fn pair(a: VertexId, b: VertexId) -> [VertexId; 2] {
    [a.min(b), a.max(b)]
}

#[cfg(test)]
mod tests;

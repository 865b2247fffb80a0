//! Refinement where the largest K sits, so that the mesh is not what limits a map.
//!
//! A few tets decide the largest K, and how bad they are is an accident of the mesh: a finer mesh of the same solid may well end
//! at a larger K. The multipliers of the minimax problem name one place at a time, and one after the other takes as many rounds as
//! there are places. A soft maximum is low at all of them at once: each round halves the edges that gain most per tet,
//! carries the positions over on both sides, which changes no K, and lowers it again there. The largest K itself is settled at the end.
//!
//! Edges of the boundary surface stay whole: the solid, its surface and the values there are what they were, so that K falls or
//! stays in every round, and what the boundary values alone prove ([`unchanging_bound`]) holds in all of them.
//!
//! Or edges of the surface are halved as well. The solid stays what it was, its sharp edges are those that they were; new vertices of the
//! surface go to the sphere, where the boundary map sends them, and slide from there if the boundary does. The image comes nearer to the ball, its angles
//! open, and K onto it rises with them. What is lowered and judged there is K onto the ball, as for the objective "ball", in the rounds
//! by a soft maximum.

mod gain;
mod halving;
mod settings;
mod surface;

use serde::{Deserialize, Serialize};

use self::surface::Held;
use crate::bound::{BoundaryImage, LowerBound, best_applicable, edge_ratio, trace, vertex};
use crate::domain::Domain;
use crate::measure::measure;
use crate::mesh::{BoundaryEdges, TetId, Vec3, VertexId};
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
    /// How many edges were halved.
    pub edges: usize,
    /// How many tets there are since.
    pub tets: usize,
    /// The least largest K of a map so far, onto the ball where the surface is refined. That of a soft maximum is some way above what the mesh
    /// allows.
    pub max_k: f64,
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
    /// The ends of the edges that were halved, in this order.
    pub halved: Vec<[VertexId; 2]>,
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
/// boundary's vertices are fixed, or slide on the sphere where the surface is refined. `outcome` is that of an optimization from `start`
/// without a polish, which comes here at the end, but not where the surface is refined; `centre` is that of a start whose boundary map is
/// radial.
///
/// The result is the same to the bit for any number of threads.
///
/// # Errors
/// As [`crate::optimize()`]; a map that is not onto the ball where the surface is to be refined.
pub fn refine(
    domain: Domain,
    start: Vec<Vec3>,
    outcome: Outcome,
    settings: &OptimizeSettings,
    refinement: &RefineSettings,
    centre: Option<Vec3>,
    observe: &mut dyn FnMut(&TraceRow),
) -> Result<RefinedMap, OptimizeError> {
    let tets_before = domain.mesh().tets().len();
    let budget = refinement.tets.of(tets_before);
    let (halved, rounds) = (Vec::new(), Vec::new());
    let mut refined =
        RefinedMap { domain, start, outcome, halved, max_k_before: None, rounds, end: RefineEnd::NotSettled };
    if !matches!(refined.outcome.stop, StopReason::Optimal | StopReason::Converged | StopReason::NoProgress) {
        return Ok(refined);
    }
    let surface = refinement.surface;
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
        let settled = refined.outcome.positions.clone();
        refined.settle_onto_ball((0, usize::MAX), settled, settings, observe)?;
    }
    // The map of least K so far; the outcome's is the soft maximum's. Where the surface is refined it is one of a coarser mesh for good.
    let mut best = refined.outcome.positions.clone();
    let mut kept = surface.then(|| refined.clone());
    let mut reached = refined.max_k(&best, surface);
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
        let gains = refined.gains(2 * round <= refinement.rounds, &middles);
        let added = refined.domain.mesh().tets().len() - tets_before;
        let left = refinement.rounds + 1 - round;
        let most = tets_before.saturating_add(budget);
        let part = if surface {
            // Many times the tets there were: as many times more in each round, since what they are best for is seen on what there is.
            let now = (tets_before + added) as f64;
            (now * (most as f64 / now).powf(1.0 / left as f64)) as usize
        } else {
            tets_before + added + (budget - added) / left
        };
        let halves = match refined.halves([part, most], gains, &middles, &best) {
            Ok(halves) => halves,
            Err(end) => break end,
        };
        let edges = halves.edges.len();
        refined.start = middles.extended_start(&halves.domain, &halves.edges, std::mem::take(&mut refined.start));
        refined.domain = halves.domain;
        refined.halved.extend(halves.edges);
        best = halves.best;
        if surface {
            refined.settle_onto_ball((round, PROBLEMS), halves.carried, &softly, observe)?;
        } else {
            refined.settle(round, &halves.carried, &softly, observe)?;
        }
        let max_k = refined.max_k(&refined.outcome.positions, surface);
        let is_best = max_k < reached;
        if is_best {
            (reached, best) = (max_k, refined.outcome.positions.clone());
        }
        let tets = refined.domain.mesh().tets().len();
        refined.rounds.push(Round { edges, tets, max_k: reached });
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
        if refined.max_k(&refined.outcome.positions, surface) > reached * (1.0 + settings.rise) {
            refined.settle(round, &best, settings, observe)?;
        }
    } else {
        refined.outcome.positions = best;
    }
    Ok(refined)
}

impl RefinedMap {
    /// The largest K of a map, onto the ball if that is asked for, and then as far as points of the tets tell.
    fn max_k(&self, positions: &[Vec3], onto_ball: bool) -> f64 {
        if onto_ball {
            Held::of(&self.domain, positions).map_or(f64::INFINITY, |held| held.k())
        } else {
            measure(&self.domain, positions).summary.max_k
        }
    }

    /// Lowers K onto the ball from positions that were settled on a coarser mesh, by so many problems at most.
    fn settle_onto_ball(
        &mut self,
        (round, problems): (usize, usize),
        positions: Vec<Vec3>,
        settings: &OptimizeSettings,
        observe: &mut dyn FnMut(&TraceRow),
    ) -> Result<(), OptimizeError> {
        let warped = Warped { domain: &self.domain, corners: None, mirrors: None, onto_ball: true };
        let done = self.outcome.trace.len();
        let mut told = |row: &TraceRow| observe(&TraceRow { round, ..row.clone() });
        let settled = Outcome { positions, ..self.outcome.clone() };
        self.outcome = warped.settle_onto_ball(settled, problems, settings, &mut told)?;
        self.outcome.trace.iter_mut().skip(done).for_each(|row| row.round = round);
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
        if settings.cancel.is_due() {
            return Ok(kept);
        }
        let mut settle = |map: &mut Self| {
            let (round, positions) = (map.rounds.len(), map.outcome.positions.clone());
            map.settle_onto_ball((round, usize::MAX), positions, settings, observe)
        };
        if self.rounds.is_empty() {
            return Ok(kept);
        }
        settle(&mut self)?;
        if self.max_k(&self.outcome.positions, true) <= reached {
            return Ok(self);
        }
        if kept.rounds.is_empty() {
            // It is settled.
            kept.end = RefineEnd::NoGain;
        } else {
            settle(&mut kept)?;
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
mod tests {
    use super::*;
    use crate::map::{RadialCoordinates, caraman};
    use crate::measure::ball_dilatation;
    use crate::mesh::{Boundary, Subdivision};
    use crate::optimize::{BoundaryValues, optimize};
    use crate::solid::{ShellSettings, Solid, shell_mesh};

    /// The cube in few tets and its radial map, optimized without a polish.
    fn cube(subdivisions: u32) -> (Domain, Vec<Vec3>, Outcome) {
        let settings = ShellSettings { subdivisions, refinement: None, layers: 2, grading: 1.0 };
        let shell = shell_mesh(&Solid::Cube.surface().unwrap(), Vec3::new(0.2, 0.1, -0.15), &settings).unwrap();
        let start = caraman(&RadialCoordinates::of_shell(&shell), 1.0);
        let domain = Domain::new(shell.mesh).unwrap();
        let settings = OptimizeSettings { polish: Polish::None, ..OptimizeSettings::default() };
        let outcome = optimize(&domain, &start, domain.boundary().vertex_mask(), &settings, &mut |_| {}).unwrap();
        (domain, start, outcome)
    }

    fn refined(refinement: &RefineSettings) -> (Domain, f64, RefinedMap) {
        let (domain, start, outcome) = cube(2);
        let before = measure(&domain, &outcome.positions).summary.max_k;
        let map = refine(domain.clone(), start, outcome, &OptimizeSettings::default(), refinement, None, &mut |_| {})
            .unwrap();
        (domain, before, map)
    }

    #[test]
    fn k_falls_from_round_to_round_on_the_same_solid_with_the_same_boundary() {
        let settings = RefineSettings { rounds: 6, tets: Budget::Share(1.0), until: 1e-3, surface: false };
        let (domain, before, map) = refined(&settings);
        assert!(!map.rounds.is_empty());
        let mut reached = before;
        for (number, round) in (1..).zip(&map.rounds) {
            // What is carried over has the same dilatations but for rounding.
            assert!(round.max_k <= reached * (1.0 + 1e-10), "round {number}: {} after {reached}", round.max_k);
            reached = round.max_k;
            let rows = map.outcome.trace.iter().filter(|row| row.round <= number);
            // The optimizer has decompositions of its own.
            assert!(rows.map(|row| row.max_k).fold(f64::INFINITY, f64::min) <= round.max_k * (1.0 + 1e-10));
        }
        assert!(reached < before * 0.999, "{before} -> {reached}");
        // The polish may give back 2e-4 of it.
        let found = measure(&map.domain, &map.outcome.positions).summary;
        assert!(found.flipped == 0 && found.max_k <= reached * (1.0 + 3e-4));
        let bound = unchanging_bound(&domain, &map.outcome.positions).unwrap().value;
        assert!(bound <= found.max_k, "{bound} {}", found.max_k);
        // Solid angles are sums over other tets.
        let again = unchanging_bound(&map.domain, &map.outcome.positions).unwrap().value;
        assert!((bound / again - 1.0).abs() < 1e-12, "{bound} {again}");
        assert!(map.outcome.trace.iter().enumerate().all(|(index, row)| row.iteration == index));

        let mut again = Subdivision::of(domain.mesh());
        again.halve(&map.halved).unwrap();
        assert_eq!(&again.mesh().unwrap(), map.domain.mesh());
        let surface = |domain: &Domain| {
            let mut triangles = domain.boundary().triangles().to_vec();
            triangles.iter_mut().for_each(|triangle| triangle.sort_unstable());
            triangles.sort_unstable();
            triangles
        };
        assert_eq!(surface(&domain), surface(&map.domain));
        Boundary::of(map.domain.mesh()).unwrap().check_ball(map.domain.mesh()).unwrap();
        let volume = |domain: &Domain| domain.volumes().iter().sum::<f64>();
        assert!((volume(&domain) / volume(&map.domain) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn it_ends_where_it_is_told_to_and_the_same_on_any_number_of_threads() {
        let settings = |rounds, tets, until| RefineSettings { rounds, tets, until, surface: false };
        let (domain, before, none) = refined(&settings(5, Budget::Tets(1), 0.02));
        assert_eq!((none.end, none.halved.len()), (RefineEnd::Budget, 0));
        assert!(measure(&domain, &none.outcome.positions).summary.max_k <= before * (1.0 + 3e-4));
        assert_eq!(refined(&settings(5, Budget::Share(1.0), 1e3)).2.end, RefineEnd::BoundaryValues);
        let (domain, _, two) = refined(&settings(2, Budget::Share(0.3), 1e-3));
        assert_eq!((two.end, two.rounds.len()), (RefineEnd::Rounds, 2));
        assert!(two.domain.mesh().tets().len() <= domain.mesh().tets().len() * 13 / 10);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        let again = pool.install(|| refined(&settings(2, Budget::Share(0.3), 1e-3)).2);
        assert_eq!((again.halved, again.outcome.positions), (two.halved, two.outcome.positions));

        let (domain, start, outcome) = cube(2);
        let cancelled = OptimizeSettings::default();
        cancelled.cancel.raise();
        let map = refine(domain, start, outcome, &cancelled, &RefineSettings::default(), None, &mut |_| {}).unwrap();
        assert_eq!((map.end, map.rounds.len()), (RefineEnd::NotSettled, 0));
    }

    #[test]
    fn a_start_that_could_not_be_untangled_is_left_as_it_is() {
        let (domain, start, _) = cube(2);
        let settings = OptimizeSettings::default();
        let outcome = Outcome::still_flipped(start.clone(), &settings);
        let map = refine(domain, start, outcome, &settings, &RefineSettings::default(), None, &mut |_| {});
        assert_eq!(map.unwrap().end, RefineEnd::NotSettled);
    }

    #[test]
    fn with_the_surface_the_solid_stays_and_k_onto_the_ball_falls() {
        let (domain, start, outcome) = cube(1);
        let centre = Vec3::new(0.2, 0.1, -0.15);
        let refinement = RefineSettings { rounds: 5, ..RefineSettings::of_surface() };
        let before = ball_dilatation(&domain, &outcome.positions).unwrap();
        let settings = OptimizeSettings::default();
        let refined = |outcome: &Outcome| {
            let (domain, start, outcome) = (domain.clone(), start.clone(), outcome.clone());
            refine(domain, start, outcome, &settings, &refinement, Some(centre), &mut |_| {}).unwrap()
        };
        let map = refined(&outcome);
        // What the rounds tell is at points of the tets, so below what is certified.
        assert!(map.max_k_before.unwrap() <= before.certified * (1.0 + 1e-10), "{map:?} {before:?}");
        let mut reached = map.max_k_before.unwrap();
        for round in &map.rounds {
            assert!(round.max_k <= reached, "{} after {reached}", round.max_k);
            reached = round.max_k;
        }
        let found = ball_dilatation(&map.domain, &map.outcome.positions).unwrap();
        assert!(found.certified < map.max_k_before.unwrap(), "{found:?} after {before:?}");
        // pi over the dihedral angle: no quasi-conformal map onto the ball has a smaller K.
        assert!(2.0 <= found.certified);

        // The same solid: all new vertices of the surface lie on the cube's faces, and its volume and its twelve edges stay.
        let mesh = map.domain.mesh();
        let (boundary, points) = (map.domain.boundary(), mesh.points());
        assert!(boundary.triangles().len() > domain.boundary().triangles().len());
        boundary.check_ball(mesh).unwrap();
        let volume = |domain: &Domain| domain.volumes().iter().sum::<f64>();
        assert!((volume(&map.domain) / 8.0 - 1.0).abs() < 1e-12 && (volume(&domain) / 8.0 - 1.0).abs() < 1e-12);
        for (v, point) in points.iter().enumerate().filter(|(v, _)| boundary.vertex_mask()[*v]) {
            assert!((point.amax() - 1.0).abs() < 1e-15, "vertex {v} at {point}");
            // Where the radial map sends it, in the start as in the end.
            let direction = (point - centre).normalize();
            assert!((map.outcome.positions[v] - direction).norm() < 1e-14, "vertex {v}");
            assert_eq!(map.start[v], map.outcome.positions[v]);
        }
        let mut again = Subdivision::of(domain.mesh());
        again.halve(&map.halved).unwrap();
        assert_eq!(&again.mesh().unwrap(), mesh);
        assert_eq!(Subdivision::before(mesh, &map.halved).as_ref(), Some(domain.mesh()));

        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        let again = pool.install(|| refined(&outcome));
        assert_eq!((again.halved, again.outcome.positions), (map.halved, map.outcome.positions));
    }

    #[test]
    fn middles_slide_on_the_sphere_with_a_boundary_that_slides() {
        let (domain, start, outcome) = cube(1);
        let refinement = RefineSettings { rounds: 4, tets: Budget::Share(3.0), ..RefineSettings::of_surface() };
        let settings = OptimizeSettings { boundary_values: BoundaryValues::Sliding, ..OptimizeSettings::default() };
        let map = refine(domain, start, outcome, &settings, &refinement, None, &mut |_| {}).unwrap();
        assert!(!map.rounds.is_empty());
        let on_sphere = map.domain.boundary().vertex_mask().iter().zip(&map.outcome.positions).filter(|(on, _)| **on);
        for (_, image) in on_sphere {
            assert!((image.norm() - 1.0).abs() < 1e-12, "{image}");
        }
        assert_eq!(measure(&map.domain, &map.outcome.positions).summary.flipped, 0);
    }
}

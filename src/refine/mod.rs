//! Refinement where the largest K sits, so that the mesh is not what limits a map.
//!
//! A few tets decide the largest K, and how bad they are is an accident of the mesh: a finer mesh of the same solid may well end
//! at a larger K. The multipliers of the minimax problem name one place at a time, and one after the other takes as many rounds as
//! there are places. A soft maximum is low at all of them at once: each round halves the edges that gain most per tet,
//! carries the positions over on both sides, which changes no K, and lowers it again there. The largest K itself is settled at the end.
//!
//! Edges of the boundary surface stay whole: the solid, its surface and the values there are what they were, so that K falls or
//! stays in every round, and what the boundary values alone prove ([`unchanging_bound`]) holds in all of them.

mod gain;

use std::collections::HashSet;

use serde::{Deserialize, Serialize};

use self::gain::Gain;
use crate::bound::{BoundaryImage, LowerBound, best_applicable, edge_ratio, trace, vertex};
use crate::domain::{Domain, edge_matrix};
use crate::measure::measure;
use crate::mesh::{BoundaryEdges, Subdivision, TetId, Vec3, VertexId};
use crate::optimize::{
    Objective, OptimizeError, OptimizeSettings, Outcome, Polish, Start, StopReason, TraceRow, flipped_tets,
    optimize_from,
};

/// Exponent of the soft maximum of the rounds. With 32 the rounds take longer, and what they end at is as often worse as better.
const EXPONENT: f64 = 16.0;
/// Fall in ln K of a step of the rounds below which there is no further one: with 1e-3 they end at the same maps, later.
const ROUGH: f64 = 4e-3;
/// Share of the largest gain below which no edge is halved in the first half of the rounds: on cube-100k, whose largest K is 3.6 times that of
/// the next tets, they spend what they may on tets that do not matter without it. In the second half all is spent.
const WORTHWHILE: f64 = 0.1;
/// The shape of a tet, its volume over the cube of its longest edge (0.118 for the regular one), below which no halving goes,
/// unless the tet that is halved is as bad. Thin tets at an edge of the solid may be what K sits on: with 1e-3 the cube of 100,000
/// tets stays at K = 27.
const WORST_SHAPE: f64 = 1e-6;

/// How far a mesh is refined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefineSettings {
    /// Most rounds; each may add its part of the tets.
    pub rounds: usize,
    /// Most tets that may be added in all.
    pub tets: Budget,
    /// Relative distance from [`unchanging_bound`] within which there is nothing left to gain.
    pub until: f64,
}

impl Default for RefineSettings {
    fn default() -> Self {
        Self { rounds: 8, tets: Budget::Share(0.1), until: 0.02 }
    }
}

/// A number of tets, written like 500 or "5 %".
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    /// So many.
    Tets(usize),
    /// This share of those that a mesh has.
    Share(f64),
}

impl std::str::FromStr for Budget {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let refused = || format!("{text:?} is no number of tets: write for example 500, or \"5 %\" of those there are");
        match text.trim().strip_suffix('%') {
            None => text.trim().parse().map(Self::Tets).map_err(|_| refused()),
            Some(percent) => match percent.trim().parse::<f64>() {
                Ok(percent) if percent >= 0.0 && percent.is_finite() => Ok(Self::Share(percent / 100.0)),
                _ => Err(refused()),
            },
        }
    }
}

impl Budget {
    /// The number for a mesh of so many tets.
    pub fn of(self, tets: usize) -> usize {
        match self {
            Self::Tets(count) => count,
            Self::Share(share) => (share * tets as f64) as usize,
        }
    }
}

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
    /// No tet that holds K has an edge that may be halved.
    NoEdge,
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
    /// The least largest K of a map on them so far. That of a soft maximum is some way above what the mesh allows.
    pub max_k: f64,
}

/// A map on a mesh that was refined for it.
#[derive(Clone, Debug)]
pub struct RefinedMap {
    /// The refined domain.
    pub domain: Domain,
    /// The start that was given, on it: new vertices are halfway between those they were put between.
    pub start: Vec<Vec3>,
    /// The map, with the rows of all rounds.
    pub outcome: Outcome,
    /// The ends of the edges that were halved, in this order.
    pub halved: Vec<[VertexId; 2]>,
    /// The largest K before the first of them; `None` where the map was not settled.
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
/// boundary's vertices are fixed. `outcome` is that of an optimization from `start` without a polish, which comes here at the end.
///
/// The result is the same to the bit for any number of threads.
///
/// # Errors
/// As [`crate::optimize()`].
pub fn refine(
    domain: Domain,
    start: Vec<Vec3>,
    outcome: Outcome,
    settings: &OptimizeSettings,
    refinement: &RefineSettings,
    observe: &mut dyn FnMut(&TraceRow),
) -> Result<RefinedMap, OptimizeError> {
    let tets_before = domain.mesh().tets().len();
    let (budget, most) = (refinement.tets.of(tets_before), |added| tets_before.saturating_add(added));
    let (halved, rounds) = (Vec::new(), Vec::new());
    let mut refined =
        RefinedMap { domain, start, outcome, halved, max_k_before: None, rounds, end: RefineEnd::NotSettled };
    if !matches!(refined.outcome.stop, StopReason::Optimal | StopReason::Converged | StopReason::NoProgress) {
        return Ok(refined);
    }
    let softly = OptimizeSettings {
        objective: Objective::SoftMax(EXPONENT),
        polish: Polish::None,
        tolerance: settings.tolerance.max(ROUGH),
        ..settings.clone()
    };
    let bound = unchanging_bound(&refined.domain, &refined.outcome.positions).map_or(1.0, |bound| bound.value);
    // The map of least K so far; the outcome's is the soft maximum's.
    let mut best = refined.outcome.positions.clone();
    let mut reached = refined.max_k(&best);
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
        let least = if 2 * round <= refinement.rounds { WORTHWHILE } else { 0.0 };
        let gains = refined.gains(least);
        let added = refined.domain.mesh().tets().len() - tets_before;
        let part = added + (budget - added) / (refinement.rounds + 1 - round);
        let subdivision = match refined.subdivided(most(part), &gains) {
            None if part < budget => refined.subdivided(most(budget), &gains),
            subdivision => subdivision,
        };
        let Some(subdivision) = subdivision else { break RefineEnd::Budget };
        if subdivision.edge_splits() == 0 {
            break RefineEnd::NoEdge;
        }
        // Where rounding makes the half of a thin tet flat, on either side, the round before was the last.
        let Ok(mesh) = subdivision.mesh() else { break RefineEnd::NoEdge };
        let domain = Domain::any_topology(mesh).expect("splits leave two tets to a face");
        let [carried, of_best] = [&refined.outcome.positions, &best].map(|p| subdivision.extend(p.clone()));
        if [&carried, &of_best].iter().any(|positions| !flipped_tets(&domain, positions).is_empty()) {
            break RefineEnd::NoEdge;
        }
        refined.take(domain, &subdivision);
        best = of_best;
        refined.settle(round, &carried, &softly, observe)?;
        let max_k = refined.max_k(&refined.outcome.positions);
        if max_k < reached {
            (reached, best) = (max_k, refined.outcome.positions.clone());
        }
        let tets = refined.domain.mesh().tets().len();
        refined.rounds.push(Round { edges: subdivision.edge_splits(), tets, max_k: reached });
    };
    let round = refined.rounds.len();
    if (settings.polish != Polish::None || round > 0) && !settings.cancel.is_due() {
        let soft = std::mem::take(&mut refined.outcome.positions);
        refined.settle(round, &soft, settings, observe)?;
        if refined.max_k(&refined.outcome.positions) > reached * (1.0 + settings.rise) {
            refined.settle(round, &best, settings, observe)?;
        }
    } else {
        refined.outcome.positions = best;
    }
    Ok(refined)
}

impl RefinedMap {
    fn max_k(&self, positions: &[Vec3]) -> f64 {
        measure(&self.domain, positions).summary.max_k
    }

    /// Goes over to the mesh that the subdivision made of this one.
    fn take(&mut self, domain: Domain, subdivision: &Subdivision) {
        self.domain = domain;
        self.start = subdivision.extend(std::mem::take(&mut self.start));
        let pair = |parents: &Vec<VertexId>| [parents[0], parents[1]];
        self.halved.extend(subdivision.parents().iter().map(pair));
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

    /// What halving edges inside gains, the best first, down to this share of the best.
    fn gains(&self, least: f64) -> Vec<Gain> {
        let tets = self.domain.mesh().tets();
        let sides = |t: &[VertexId; 3]| [[0, 1], [1, 2], [2, 0]].map(|[i, j]| pair(t[i], t[j]));
        let on_surface: HashSet<[VertexId; 2]> = self.domain.boundary().triangles().iter().flat_map(sides).collect();
        let at = tets_at_vertices(&self.domain);
        let allowed = |edge| !on_surface.contains(&edge) && self.keeps_shape(around(edge, tets, &at), edge);
        let mut gains = gain::gains(&self.domain, &self.outcome.positions, &at, &allowed);
        let best = gains.first().map_or(0.0, |gain| gain.value);
        gains.retain(|gain| gain.value >= least * best);
        gains
    }

    /// The mesh with these edges halved, as far as there are tets left for; `None` if there are none for the first.
    fn subdivided(&self, most_tets: usize, gains: &[Gain]) -> Option<Subdivision> {
        let tets = self.domain.mesh().tets();
        let at = tets_at_vertices(&self.domain);
        let mut count = tets.len();
        let (mut halved, mut wanted) = (Vec::new(), HashSet::new());
        for &Gain { edge, .. } in gains {
            count += around(edge, tets, &at).count();
            halved.push(edge);
            wanted.insert(edge);
            if count > most_tets {
                break;
            }
        }
        // A tet that is split twice counts once above: what is too many is left out again, the last first.
        let nothing = halved.is_empty();
        loop {
            let mut subdivision = Subdivision::of(self.domain.mesh());
            subdivision.split_edges(|edge| wanted.contains(&edge));
            if subdivision.tet_count() <= most_tets {
                return (nothing || !halved.is_empty()).then_some(subdivision);
            }
            for edge in halved.split_off(halved.len() * 19 / 20) {
                wanted.remove(&edge);
            }
        }
    }

    /// Whether the halves of these tets at an edge are well enough shaped.
    fn keeps_shape(&self, mut around: impl Iterator<Item = TetId>, edge: [VertexId; 2]) -> bool {
        let mesh = self.domain.mesh();
        let middle = edge.map(|v| mesh.points()[v.index()]).iter().sum::<Vec3>() / 2.0;
        around.all(|tet| {
            let corners = mesh.corners(tet);
            let least = shape(corners).min(WORST_SHAPE);
            edge.iter().all(|end| {
                let ids = mesh.tets()[tet.index()];
                let half = std::array::from_fn(|i| if ids[i] == *end { middle } else { corners[i] });
                shape(half) >= least
            })
        })
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

/// The volume of a tet over the cube of its longest edge.
fn shape(corners: [Vec3; 4]) -> f64 {
    let edges = (0..4).flat_map(|i| (0..i).map(move |j| (i, j)));
    let longest = edges.map(|(i, j)| (corners[i] - corners[j]).norm()).fold(0.0, f64::max);
    edge_matrix(corners).determinant() / (6.0 * longest.powi(3))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{RadialCoordinates, caraman};
    use crate::mesh::Boundary;
    use crate::optimize::optimize;
    use crate::solid::{ShellSettings, Solid, shell_mesh};

    /// The cube in few tets and its radial map, optimized without a polish.
    fn cube() -> (Domain, Vec<Vec3>, Outcome) {
        let settings = ShellSettings { subdivisions: 2, refinement: None, layers: 2, grading: 1.0 };
        let shell = shell_mesh(&Solid::Cube.surface().unwrap(), Vec3::new(0.2, 0.1, -0.15), &settings).unwrap();
        let start = caraman(&RadialCoordinates::of_shell(&shell), 1.0);
        let domain = Domain::new(shell.mesh).unwrap();
        let settings = OptimizeSettings { polish: Polish::None, ..OptimizeSettings::default() };
        let outcome = optimize(&domain, &start, domain.boundary().vertex_mask(), &settings, &mut |_| {}).unwrap();
        (domain, start, outcome)
    }

    fn refined(refinement: &RefineSettings) -> (Domain, f64, RefinedMap) {
        let (domain, start, outcome) = cube();
        let before = measure(&domain, &outcome.positions).summary.max_k;
        let map =
            refine(domain.clone(), start, outcome, &OptimizeSettings::default(), refinement, &mut |_| {}).unwrap();
        (domain, before, map)
    }

    #[test]
    fn k_falls_from_round_to_round_on_the_same_solid_with_the_same_boundary() {
        let settings = RefineSettings { rounds: 6, tets: Budget::Share(1.0), until: 1e-3 };
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
        let settings = |rounds, tets, until| RefineSettings { rounds, tets, until };
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

        let (domain, start, outcome) = cube();
        let cancelled = OptimizeSettings::default();
        cancelled.cancel.raise();
        let map = refine(domain, start, outcome, &cancelled, &RefineSettings::default(), &mut |_| {}).unwrap();
        assert_eq!((map.end, map.rounds.len()), (RefineEnd::NotSettled, 0));
    }

    #[test]
    fn a_start_that_could_not_be_untangled_is_left_as_it_is() {
        let (domain, start, _) = cube();
        let settings = OptimizeSettings::default();
        let outcome = Outcome::still_flipped(start.clone(), &settings);
        let map = refine(domain, start, outcome, &settings, &RefineSettings::default(), &mut |_| {});
        assert_eq!(map.unwrap().end, RefineEnd::NotSettled);
    }

    #[test]
    fn budgets_are_numbers_or_shares() {
        assert_eq!("500".parse(), Ok(Budget::Tets(500)));
        assert_eq!(" 12.5 % ".parse(), Ok(Budget::Share(0.125)));
        for text in ["", "-1", "5 percent", "-1 %", "inf %", "1e3"] {
            assert!(text.parse::<Budget>().unwrap_err().contains("\"5 %\""), "{text}");
        }
        assert_eq!([Budget::Tets(7), Budget::Share(0.05)].map(|budget| budget.of(100)), [7, 5]);
    }
}

//! Splits about the last tets that resist untangling.

use std::collections::HashSet;

use super::{Shapes, Untangled, untangle_locally};
use crate::domain::Domain;
use crate::mesh::{Subdivision, TetId, Vec3, VertexId};
use crate::optimize::{OptimizeSettings, TraceRow};

/// Rounds of splits; two were the most that any of 53 solids needed.
const ROUNDS: usize = 3;
/// With more resisting tets than this, splits make more of them: 28 became 385, and 48 became 13,516.
const FEW: usize = 24;
/// The most tets that may be added, as a share of all.
const MOST_ADDED: f64 = 0.02;

/// A domain that was refined where tets resisted, and what untangling led to there.
#[derive(Clone, Debug)]
pub struct Refined {
    /// The refined domain.
    pub domain: Domain,
    /// The start that was given, on the refined domain: new vertices are halfway between those they were put between.
    pub start: Vec<Vec3>,
    /// How many edges were halved.
    pub splits: usize,
    /// The map of the refined domain.
    pub untangled: Untangled,
}

/// Halves the interior edges of the resisting tets and untangles again, a few times; the vertices of the boundary are fixed.
///
/// Interior edges must have an end inside ([`crate::mesh::full_boundary`]). `None` if no tet resists, if more than 24 do, or if
/// the tets that would be added are more than 2 % of all: then refinement does more harm than good. What it leads to may still
/// have resisting tets, but fewer. Tets so thin that rounding makes halves of them flat are not refined either.
pub fn refine_and_untangle(
    domain: &Domain,
    start: &[Vec3],
    untangled: &Untangled,
    settings: &OptimizeSettings,
    observe: &mut dyn FnMut(&TraceRow),
) -> Option<Refined> {
    let most = domain.mesh().tets().len() + (MOST_ADDED * domain.mesh().tets().len() as f64) as usize;
    let mut best: Option<Refined> = None;
    for _ in 0..ROUNDS {
        let (domain, start, untangled, splits) = match &best {
            Some(best) => (&best.domain, &*best.start, &best.untangled, best.splits),
            None => (domain, start, untangled, 0),
        };
        let resisting = untangled.resisting.len();
        if resisting == 0 || resisting > FEW || settings.cancel.is_due() {
            break;
        }
        let subdivision = split(domain, &untangled.resisting);
        let Some(mesh) = subdivision.mesh().ok().filter(|mesh| mesh.tets().len() <= most) else { break };
        // A split of a ball is a ball, and any other topology stays as it is too.
        let refined = Domain::any_topology(mesh).expect("splits leave two tets to a face");
        let mut next = untangle_locally(
            &refined,
            &subdivision.extend(untangled.positions.clone()),
            refined.boundary().vertex_mask(),
            Shapes::Own,
            settings,
            observe,
        );
        next.iterations += untangled.iterations;
        next.seconds += untangled.seconds;
        let start = subdivision.extend(start.to_vec());
        let splits = splits + subdivision.edge_splits();
        best = Some(Refined { domain: refined, start, splits, untangled: next });
    }
    best.filter(|best| best.untangled.resisting.len() < untangled.resisting.len())
}

/// Halves those edges of some tets that are not edges of the boundary surface.
fn split(domain: &Domain, tets: &[TetId]) -> Subdivision {
    let on_surface: HashSet<[VertexId; 2]> = domain
        .boundary()
        .triangles()
        .iter()
        .flat_map(|t| [[0, 1], [1, 2], [2, 0]].map(|[i, j]| pair(t[i], t[j])))
        .collect();
    let edges: HashSet<[VertexId; 2]> = tets
        .iter()
        .map(|tet| domain.mesh().tets()[tet.index()])
        .flat_map(|tet| (0..4).flat_map(move |i| (0..i).map(move |j| pair(tet[i], tet[j]))))
        .filter(|edge| !on_surface.contains(edge))
        .collect();
    let mut subdivision = Subdivision::of(domain.mesh());
    subdivision.split_edges(|edge| edges.contains(&edge));
    subdivision
}

fn pair(a: VertexId, b: VertexId) -> [VertexId; 2] {
    [a.min(b), a.max(b)]
}

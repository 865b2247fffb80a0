//! Which edges are halved in a round, and the mesh and the maps after that.

use std::collections::{BTreeMap, HashMap, HashSet};

use super::gain::{self, Gain, Large};
use super::surface::{Held, Middles};
use super::{RefineEnd, RefinedMap, around, pair, tets_at_vertices};
use crate::domain::{Afterwards, Domain, edge_matrix};
use crate::map::Corners;
use crate::mesh::{Mat3, Subdivision, TetId, Vec3, VertexId};
use crate::objective::Iterate;
use crate::optimize::flipped_tets;

/// Share of the largest gain below which no edge is halved in the first half of the rounds: on cube-100k, whose largest K is 3.6 times that of
/// the next tets, they spend what they may on tets that do not matter without it. In the second half all is spent.
const WORTHWHILE: f64 = 0.1;
/// The shape of a tet, its volume over the cube of its longest edge (0.118 for the regular one), below which no halving goes,
/// unless the tet that is halved is as bad. Thin tets at an edge of the solid may be what K sits on: with 1e-3 the cube of 100,000
/// tets stays at K = 27.
pub(super) const WORST_SHAPE: f64 = 1e-6;
/// Length of an edge of the surface over that of the longest of its triangles from which it is halved; else that one is, and so on. A
/// thin triangle, one corner of which goes to the sphere, has a trace of large dilatation.
const LONG: f64 = 0.85;

/// The mesh after a round's halvings.
pub(super) struct Halves {
    pub domain: Domain,
    /// Its corner elements.
    pub corners: Option<Corners>,
    /// The ends of the edges, in this order.
    pub edges: Vec<[VertexId; 2]>,
    /// The map that was lowered last, on it.
    pub carried: Vec<Vec3>,
    /// The best one, on it.
    pub best: Vec<Vec3>,
}

impl RefinedMap {
    /// What halving edges gains, the best first; while it is `early`, down to a share of the best.
    pub(super) fn gains(&self, early: bool, middles: &Middles) -> Vec<Gain> {
        let (domain, positions) = (&self.domain, &self.outcome.positions);
        // Maps that come here have no flipped tet.
        let held = if middles.of_surface { Held::of(domain, self.corners.as_ref(), positions).ok() } else { None };
        let plain = || Iterate::new(domain, positions.clone()).log_dilatations();
        let Some(logs) = held.as_ref().map(|held| held.logs.clone()).or_else(plain) else { return Vec::new() };
        let factors: &[Vec<(Mat3, Afterwards)>] = held.as_ref().map_or(&[], |held| &held.factors);
        let large = Large { domain, image: positions, logs: &logs, factors };
        let tets = domain.mesh().tets();
        let at = tets_at_vertices(domain);
        let surface = SurfaceEdges::of(domain);
        let keeps_shape = |edge| self.keeps_shape(around(edge, tets, &at), edge);
        // The map is like a power at a corner on all scales: a smaller element gains nothing, and beyond it the map is linear. With edges at corners
        // halved, cube-1k ended at K 5.17 onto the ball after 6 rounds with the exponent 1.4, and at 4.48 without.
        let corners = corner_vertices(self.corners.as_ref());
        let is_at_corner = |edge: [VertexId; 2]| edge.iter().any(|v| corners.contains(v));
        let mut gains =
            gain::gains(&large, &at, &|edge| !surface.contains(edge) && !is_at_corner(edge) && keeps_shape(edge));
        if let Some(held) = &held {
            let mut of_surface: BTreeMap<[VertexId; 2], f64> = BTreeMap::new();
            for (edge, gain) in held.gains(&large) {
                *of_surface.entry(surface.longest_from(edge)).or_default() += gain;
            }
            let around = |edge| around(edge, tets, &at);
            let allowed =
                |edge| !is_at_corner(edge) && keeps_shape(edge) && middles.keep(domain, positions, edge, around(edge));
            let of_surface = of_surface.into_iter().filter(|(edge, _)| allowed(*edge));
            gains.extend(of_surface.map(|(edge, gain)| Gain { edge, value: gain / around(edge).count() as f64 }));
            gains.sort_by(|a, b| b.value.total_cmp(&a.value).then(a.edge.cmp(&b.edge)));
        }
        let best = gains.first().map_or(0.0, |gain| gain.value);
        // Where the surface is refined many more tets are added, and all places that hold K get some in each round.
        let least = if early && !middles.of_surface { WORTHWHILE } else { 0.0 };
        gains.retain(|gain| gain.value >= least * best);
        gains
    }

    /// The mesh with edges halved, of most gain first, as far as there are tets left for: up to the first number, or for the very first edge
    /// the second; and the maps on it.
    ///
    /// # Errors
    /// Why there is none.
    pub(super) fn halves(
        &self,
        [part, most]: [usize; 2],
        mut gains: Vec<Gain>,
        middles: &Middles,
        best: &[Vec3],
    ) -> Result<Halves, RefineEnd> {
        loop {
            let subdivision = match self.subdivided(part, &gains) {
                None if part < most => self.subdivided(most, &gains),
                subdivision => subdivision,
            };
            let subdivision = subdivision.ok_or(RefineEnd::Budget)?;
            if subdivision.edge_splits() == 0 {
                return Err(RefineEnd::NoEdge);
            }
            // Where rounding makes the half of a thin tet flat, on either side, the round before was the last.
            let mesh = subdivision.mesh().map_err(|_| RefineEnd::NoEdge)?;
            let domain = Domain::any_topology(mesh).expect("splits leave two tets to a face");
            let ends = |parents: &Vec<VertexId>| [parents[0], parents[1]];
            let edges: Vec<[VertexId; 2]> = subdivision.parents().iter().map(ends).collect();
            let carried = middles.extended(&domain, &edges, self.outcome.positions.clone());
            let best =
                if middles.of_surface { carried.clone() } else { middles.extended(&domain, &edges, best.to_vec()) };
            let flipped = flipped_tets(&domain, &carried);
            if flipped.is_empty() && flipped_tets(&domain, &best).is_empty() {
                let corners = self.corners.as_ref().map(|corners| corners.around(&domain)).transpose();
                let corners = corners.map_err(|_| RefineEnd::NoEdge)?;
                return Ok(Halves { domain, corners, edges, carried, best });
            }
            // Two middles on the sphere may turn over a tet that one of them leaves upright.
            let before = self.domain.mesh().points().len();
            let turning: HashSet<[VertexId; 2]> = flipped
                .iter()
                .flat_map(|tet| domain.mesh().tets()[tet.index()])
                .filter_map(|v| v.index().checked_sub(before).map(|new| pair(edges[new][0], edges[new][1])))
                .collect();
            let count = gains.len();
            gains.retain(|gain| !turning.contains(&gain.edge));
            if !middles.of_surface || gains.len() == count {
                return Err(RefineEnd::NoEdge);
            }
        }
    }

    /// The mesh with these edges halved, as far as there are tets left for; `None` if there are none for the first.
    fn subdivided(&self, most_tets: usize, gains: &[Gain]) -> Option<Subdivision> {
        let tets = self.domain.mesh().tets();
        let at = tets_at_vertices(&self.domain);
        let mut count = tets.len();
        // Flips may have made too many.
        if count > most_tets {
            return None;
        }
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

/// The corners of a map that are not linear.
pub(super) fn corner_vertices(corners: Option<&Corners>) -> HashSet<VertexId> {
    let exponents = corners.map(Corners::exponents).unwrap_or_default();
    exponents.into_iter().filter(|(_, exponent)| *exponent != 1.0).map(|(v, _)| v).collect()
}

/// The edges of the surface, with their triangles.
struct SurfaceEdges<'a> {
    domain: &'a Domain,
    triangles: HashMap<[VertexId; 2], Vec<usize>>,
}

impl<'a> SurfaceEdges<'a> {
    fn of(domain: &'a Domain) -> Self {
        let mut triangles: HashMap<[VertexId; 2], Vec<usize>> = HashMap::new();
        for (index, triangle) in domain.boundary().triangles().iter().enumerate() {
            edges_of(triangle).into_iter().for_each(|edge| triangles.entry(edge).or_default().push(index));
        }
        Self { domain, triangles }
    }

    fn contains(&self, edge: [VertexId; 2]) -> bool {
        self.triangles.contains_key(&edge)
    }

    /// The edge, or one that is halved in its stead, since it is [`LONG`] in its triangles.
    fn longest_from(&self, mut edge: [VertexId; 2]) -> [VertexId; 2] {
        let points = self.domain.mesh().points();
        let length = |[a, b]: &[VertexId; 2]| (points[a.index()] - points[b.index()]).norm();
        // Each is longer than the one before.
        loop {
            let triangles = self.triangles[&edge].iter().map(|index| self.domain.boundary().triangles()[*index]);
            let longest = triangles.flat_map(|triangle| edges_of(&triangle)).max_by(|a, b| {
                let by_length = length(a).total_cmp(&length(b));
                by_length.then(b.cmp(a))
            });
            match longest.filter(|longest| length(&edge) < LONG * length(longest)) {
                Some(longest) => edge = longest,
                None => return edge,
            }
        }
    }
}

/// The edges of a triangle, their smaller vertices first.
pub(super) fn edges_of(triangle: &[VertexId; 3]) -> [[VertexId; 2]; 3] {
    [[0, 1], [1, 2], [2, 0]].map(|[i, j]| pair(triangle[i], triangle[j]))
}

/// The volume of a tet over the cube of its longest edge.
pub(super) fn shape(corners: [Vec3; 4]) -> f64 {
    let edges = (0..4).flat_map(|i| (0..i).map(move |j| (i, j)));
    let longest = edges.map(|(i, j)| (corners[i] - corners[j]).norm()).fold(0.0, f64::max);
    edge_matrix(corners).determinant() / (6.0 * longest.powi(3))
}

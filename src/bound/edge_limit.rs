//! What the edge bound of piecewise-linear maps tends to when the boundary is refined, where the angles on the image side add up to pi.

use std::f64::consts::PI;

use super::check::{factor, three_halves_power};
use super::{BoundName, Kind, LowerBound, Place, Scope, strongest};
use crate::domain::Domain;
use crate::mesh::BoundaryEdges;
use crate::mesh::angle::Angle;

/// `(pi / alpha)^(3/2)` at the least convex dihedral angle alpha: the limit of [`super::edge_ratio()`] as the boundary mesh
/// is refined, so that the inscribed polyhedron's angle beta at the edge's image tends to pi.
///
/// It bounds the limit inferior of K over orientation-preserving piecewise-linear maps with the radial boundary values on
/// ever finer meshes (a theorem: `K >= (beta / alpha)^(3/2)` on each mesh). For *general* quasi-conformal maps
/// `K >= (pi / alpha)^(3/2)` is a conjecture, hence it is not certified for its scope, and applies to no single map.
///
/// Checked by `check::factor`.
pub fn edge_limit(domain: &Domain, edges: &BoundaryEdges) -> Option<LowerBound> {
    let convex = edges.edges().iter().map(|edge| (edge.angle(), edge.ends)).filter(|(angle, _)| angle.upper() < PI);
    let openings = convex.map(|(angle, ends)| (factor(Angle::ZERO.plus_half_turns(1), angle), ends));
    let (ratio, ends) = strongest(openings)?;
    Some(LowerBound {
        name: BoundName::EdgeLimit,
        source: BoundName::EdgeLimit.source(),
        kind: Kind::K,
        value: three_halves_power(ratio),
        scope: Scope::ShapeFixedTrace,
        certified: false,
        applies: false,
        reason: "proved only for the limit of PL maps whose image angle at this edge tends to pi (fine boundary)"
            .into(),
        place: Some(Place::edge(domain.mesh(), ends)),
    })
}

//! The wedge bound pi / alpha of the smooth problem (paper eq. 39, 44).

use std::f64::consts::PI;

use super::check::factor;
use super::{BoundName, Kind, LowerBound, Place, Scope, strongest};
use crate::domain::Domain;
use crate::mesh::BoundaryEdges;
use crate::mesh::angle::Angle;

/// `K_I >= pi / alpha` for every quasi-conformal homeomorphism of the solid onto the ball, alpha the least dihedral angle
/// of a convex edge; nothing for a solid without convex edges.
///
/// **Proof.** Let f(0) = 0 on the edge, L = log(1 / eps) and L' the logarithm of the corresponding ratio in
/// the image, up to a constant by quasi-symmetry. The ring eps < |x| < 1 has modulus 2 alpha / L^2 in the wedge and
/// 2 pi / L'^2 in the half-space, so L' >= L sqrt(pi / (alpha K_I)). The modulus of curves joining the edge's pieces
/// [-1, -eps] and [eps, 1] is alpha c L + O(1), that of their images, continua in the boundary plane, at least
/// pi c L' - O(1) (half of the Teichmuller ring), so L' <= L K_I alpha / pi. Together K_I >= pi / alpha; folding shows
/// that it is sharp.
///
/// It is **not** a bound for a piecewise-linear map onto a polyhedron inscribed in the ball, whose dihedral angle beta at
/// the edge's image is not pi (below it if convex): there [`super::edge_ratio()`] and [`super::fan()`] use the actual beta.
///
/// Checked by `check::factor`.
pub fn wedge(domain: &Domain, edges: &BoundaryEdges) -> Option<LowerBound> {
    let convex = edges.edges().iter().map(|edge| (edge.angle(), edge.ends)).filter(|(angle, _)| angle.upper() < PI);
    let openings = convex.map(|(angle, ends)| (factor(Angle::ZERO.plus_half_turns(1), angle), ends));
    let (value, ends) = strongest(openings)?;
    Some(LowerBound {
        name: BoundName::Wedge,
        source: BoundName::Wedge.source(),
        kind: Kind::Inner,
        value,
        scope: Scope::Shape,
        certified: true,
        applies: false,
        reason: "speaks of maps onto the smooth ball; the measured image is a polyhedron, whose angle at this edge is not pi"
            .into(),
        place: Some(Place::edge(domain.mesh(), ends)),
    })
}

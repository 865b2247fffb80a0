//! The ratio of dihedral angles at a boundary edge (paper eq. 42).

use super::boundary_image::half_turns;
use super::check::{factor, three_halves_power};
use super::{BoundName, BoundaryImage, Kind, LowerBound, Place, strongest, with_inner_and_outer};
use crate::domain::Domain;
use crate::mesh::{BoundaryEdge, BoundaryEdges};

/// `K >= q^(3/2)`, and `K_I >= q`, `K_O >= q`, where `q = max(beta / alpha, alpha / beta)` over the boundary edges, alpha
/// the dihedral angle in the domain and beta the one between the images of the two boundary triangles.
///
/// Holds for every orientation-preserving piecewise-linear map with these boundary positions, however the interior is
/// meshed. It improves paper eq. 42 (K >= beta / alpha) by the power 3/2, and uses the actual beta, not pi.
///
/// **Proof**. The fan bound ([`super::fan()`]) gives H >= tau on some tet of the edge, where tau solves
/// `sum 2 atan(tau tan(a_i / 2)) = beta` for beta >= alpha. Some tet has b_i / a_i >= beta / alpha = q, and
/// `tan(b/2) / tan(a/2) >= b / a` for b >= a since tan(x) / x increases. For beta < alpha exchange the roles.
///
/// Checked by `check::factor`. Edges whose image triangles are degenerate or folded bound nothing.
pub fn edge_ratio(domain: &Domain, edges: &BoundaryEdges, image: BoundaryImage) -> Option<LowerBound> {
    let (ratio, ends) =
        strongest(edges.edges().iter().filter_map(|edge| Some((angle_ratio(edge, image)?, edge.ends))))?;
    Some(LowerBound::of_mesh(
        BoundName::EdgeRatio,
        Kind::K,
        three_halves_power(ratio),
        Place::edge(domain.mesh(), ends),
        with_inner_and_outer("any PL map of this solid with these boundary positions", ratio),
    ))
}

fn angle_ratio(edge: &BoundaryEdge, image: BoundaryImage) -> Option<f64> {
    let (domain, principal) = (edge.angle(), edge.image_angle(image.positions())?);
    image
        .possible_angles(principal, domain, half_turns(edge.fan.len()))
        .map(|beta| factor(beta, domain))
        .reduce(f64::min)
        .filter(|ratio| ratio.is_finite())
}

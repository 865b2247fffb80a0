//! The fan bound: dihedral angles of the tets around a boundary edge.

use super::boundary_image::half_turns;
use super::check::fan::{exceeds, half_tangent};
use super::check::three_halves_power;
use super::{BoundName, BoundaryImage, Kind, LowerBound, Place, with_inner_and_outer};
use crate::domain::Domain;
use crate::linalg::interval::Interval;
use crate::mesh::angle::Angle;
use crate::mesh::{BoundaryEdge, BoundaryEdges};

/// `K >= tau^(3/2)`, and `K_I >= tau`, `K_O >= tau`, where tau is the largest over the boundary edges of the root of
/// `sum_i 2 atan(tau tan(a_i / 2)) = beta` if beta >= alpha, else of `sum_i 2 atan(tan(a_i / 2) / tau) = beta`; a_i are the
/// dihedral angles of the tets around the edge, alpha their sum (any below 2 pi), beta the angle between the images of
/// the two boundary triangles.
///
/// Holds for every orientation-preserving piecewise-linear map of this mesh with these boundary positions.
///
/// **Proof**. *One tet* (B2): a linear map A takes a wedge of angle a about the line e to one of angle b. In bases along and
/// across the edge A is block triangular with a 2x2 block Q across, so s1 >= |Q| = q1 and s3 <= q2, H >= q1 / q2. The
/// conformal structures of the plane form the hyperbolic plane, log(q1 / q2) is the distance moved, and the structures
/// in which two fixed rays make the angle t form a hypercycle at signed distance log tan(t / 2) from a geodesic; two
/// hypercycles of one axis are as far apart as their distances differ. Hence
/// `H >= tau = max(tan(b/2) / tan(a/2), its inverse)`, attained. *Fan*: H <= tau on all its tets confines each b_i to
/// `[2 atan(tan(a_i/2) / tau), 2 atan(tau tan(a_i/2))]`, and both ends' sums are strictly monotone in tau.
///
/// Checked by `check::fan::exceeds`, which the root is found with by bisection. Edges whose image triangles are degenerate or
/// folded bound nothing; there is no bound if all edges keep their angle.
pub fn fan(domain: &Domain, edges: &BoundaryEdges, image: BoundaryImage) -> Option<LowerBound> {
    let (mut best, mut ends) = (1.0, None);
    for edge in edges.edges() {
        // The best so far is the floor, which spares most edges the root finding.
        if let Some(stretch) = edge_stretch(edge, image, best).filter(|&stretch| stretch > best) {
            (best, ends) = (stretch, Some(edge.ends));
        }
    }
    Some(LowerBound::of_mesh(
        BoundName::Fan,
        Kind::K,
        three_halves_power(best),
        Place::edge(domain.mesh(), ends?),
        with_inner_and_outer("any PL map of this mesh with these boundary positions", best),
    ))
}

/// The larger of `floor` and the root tau at one edge; nothing where the boundary images determine no angle.
fn edge_stretch(edge: &BoundaryEdge, image: BoundaryImage, floor: f64) -> Option<f64> {
    let principal = edge.image_angle(image.positions())?;
    let angles: Vec<Angle> = edge.fan.iter().map(|&(_, angle)| angle).collect();
    image
        .possible_angles(principal, edge.angle(), half_turns(edge.fan.len()))
        .map(|beta| fan_stretch(&angles, beta, floor))
        .reduce(f64::min)
}

/// A lower end for the root tau >= 1 of the fan equation with domain angles `angles` and image angle `image`, or `floor`
/// if the root is not shown to be above it.
fn fan_stretch(angles: &[Angle], image: Angle, floor: f64) -> f64 {
    if !may_exceed(angles, image.value(), floor) {
        return floor;
    }
    let alpha: Angle = angles.iter().copied().sum();
    let half_tangents: Vec<Interval> = angles.iter().map(|&angle| half_tangent(angle)).collect();
    let exceeds = |tau: f64| exceeds(&half_tangents, alpha, image, tau);
    if !exceeds(floor) {
        return floor;
    }
    let (mut low, mut high) = (floor, 2.0 * floor);
    // Ends: intervals of angles do not exclude all tau.
    while high.is_finite() && exceeds(high) {
        (low, high) = (high, 2.0 * high);
    }
    while high > low * (1.0 + 4.0 * f64::EPSILON) {
        let middle = 0.5 * (low + high);
        if exceeds(middle) { low = middle } else { high = middle }
    }
    low
}

/// Whether the root may be above tau, as far as floats tell: intervals are left to edges that count.
fn may_exceed(angles: &[Angle], image: f64, tau: f64) -> bool {
    /// More than the rounding of the sums.
    const ROOM: f64 = 1e-9;
    let sum = |ratio: f64| -> f64 { angles.iter().map(|a| 2.0 * (ratio * (0.5 * a.value()).tan()).atan()).sum() };
    // Negated, so that NaN is left to the intervals.
    !(sum(tau) >= image + ROOM && sum(tau.recip()) <= image - ROOM)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn exactly(value: f64) -> Angle {
        Angle::within(Interval::exactly(value))
    }

    #[test]
    fn one_tet_has_the_closed_form() {
        // Computed apart from this, to four decimals.
        use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};
        for (from, to, power) in [(FRAC_PI_2, 3.0, 52.9535), (FRAC_PI_4, FRAC_PI_2, 3.7511), (1.2, 0.5, 4.3856)] {
            let tau = fan_stretch(&[exactly(from)], exactly(to), 1.0);
            let [narrow, wide] = [from, to].map(|angle: f64| (angle / 2.0).tan());
            assert!((tau - (wide / narrow).max(narrow / wide)).abs() < 1e-11);
            assert!((tau.powf(1.5) - power).abs() < 1e-4, "{from} {to} {tau}");
        }
    }

    #[test]
    fn equal_angles_open_as_one_of_them() {
        let tau = fan_stretch(&[exactly(0.5); 3], exactly(2.5), 1.0);
        let expected = (2.5f64 / 6.0).tan() / 0.25f64.tan();
        assert!((tau - expected).abs() < 1e-12 && tau <= expected);
    }

    proptest! {
        #[test]
        fn the_root_lies_above_the_ratio_of_angles_and_below_the_given_angles_stretch(
            pairs in prop::collection::vec((0.05..3.0f64, 0.05..3.0f64), 1..6)
        ) {
            let angles: Vec<Angle> = pairs.iter().map(|pair| exactly(pair.0)).collect();
            let (alpha, beta): (f64, f64) = (pairs.iter().map(|p| p.0).sum(), pairs.iter().map(|p| p.1).sum());
            let tau = fan_stretch(&angles, exactly(beta), 1.0);
            // The edge ratio below, and above the fan that has these very image angles.
            let achieved = pairs
                .iter()
                .map(|(a, b)| ((b / 2.0).tan() / (a / 2.0).tan()).ln().abs().exp())
                .fold(1.0, f64::max);
            prop_assert!(tau >= (beta / alpha).max(alpha / beta) * (1.0 - 1e-11));
            prop_assert!(tau <= achieved * (1.0 + 1e-14));
            // The floor only prunes.
            prop_assert_eq!(fan_stretch(&angles, exactly(beta), 2.0 * tau), 2.0 * tau);
        }
    }
}

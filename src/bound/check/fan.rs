//! The sums of the image angles of a fan of tets (docs of [`crate::bound::fan()`]).

use super::free_vertex::{Extreme, Term, Tet, extreme_angle};
use crate::linalg::interval::Interval;
use crate::mesh::angle::Angle;

/// An enclosure of tan(a / 2) for the dihedral angle a of a tet, from 0 to infinity where the angle may be 0 or pi.
///
/// A guess whose ends are verified by their arc tangents.
pub(in crate::bound) fn half_tangent(angle: Angle) -> Interval {
    let double_atan = |t: f64| Interval::exactly(2.0) * Interval::exactly(t).atan();
    let steps = || (0..60).map(|power| 4.0 * f64::EPSILON * 2f64.powi(power));
    let (low, high) = ((0.5 * angle.lower()).tan(), (0.5 * angle.upper()).tan());
    let lower = steps().map(|step| low / (1.0 + step)).find(|&t| t >= 0.0 && double_atan(t).upper <= angle.lower());
    let upper = steps().map(|step| high * (1.0 + step)).find(|&t| t >= 0.0 && double_atan(t).lower >= angle.upper());
    Interval { lower: lower.unwrap_or(0.0), upper: upper.unwrap_or(f64::INFINITY) }
}

/// `sum 2 atan(ratio t_i)`, the t_i not negative.
pub(in crate::bound) fn sum(half_tangents: &[Interval], ratio: Interval) -> Interval {
    let angle = |&t: &Interval| {
        let angle = (t * ratio).atan();
        angle + angle
    };
    half_tangents.iter().map(angle).sum()
}

/// Whether a fan of tets with the tangents of half their dihedral angles, alpha in sum, has an image angle so far above or below that
/// H > tau on one of them.
pub(in crate::bound) fn exceeds(half_tangents: &[Interval], alpha: Angle, image: Angle, tau: f64) -> bool {
    let tau = Interval::exactly(tau);
    if image.lower() > alpha.upper() {
        sum(half_tangents, tau).upper < image.lower()
    } else if image.upper() < alpha.lower() {
        sum(half_tangents, Interval::ONE / tau).lower > image.upper()
    } else {
        false
    }
}

/// Whether a fan whose first and last tet have a fixed face at the edge, with the terms for each that confine its angle, and the
/// tangents of half the angles of the tets between, has an image angle that shows K > `level` on one of its tets.
pub(in crate::bound) fn exceeds_with_ends(
    ends: [(&Tet, &[Term]); 2],
    between: &[Interval],
    image: Angle,
    level: f64,
) -> bool {
    // H <= k^(2/3) where K <= k.
    let ratio = Interval::exactly(level).cbrt().square();
    match ends.map(|(tet, terms)| extreme_angle(tet, level, terms)) {
        [Some(Extreme::Most(a)), Some(Extreme::Most(b))] => (a + b + sum(between, ratio)).upper < image.lower(),
        [Some(Extreme::Least(a)), Some(Extreme::Least(b))] => {
            (a + b + sum(between, Interval::ONE / ratio)).lower > image.upper()
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_tangents_enclose_those_of_known_angles() {
        // tan(pi / 8) = 2^(1/2) - 1, tan(pi / 4) = 1.
        let over = |n: f64| Angle::within(Interval::PI / Interval::exactly(n));
        for (angle, tangent) in [(over(4.0), 2f64.sqrt() - 1.0), (over(2.0), 1.0)] {
            let found = half_tangent(angle);
            assert!(found.lower < tangent && tangent < found.upper && found.upper - found.lower < 1e-13, "{found:?}");
        }
        let flat = half_tangent(over(1.0));
        // The enclosure of pi leaves 1e-15 or so.
        assert!(flat.lower > 1e13 && flat.upper.is_infinite());
        assert!(sum(&[flat], Interval::exactly(2.0)).upper >= std::f64::consts::PI);
        assert_eq!(half_tangent(Angle::ZERO).lower, 0.0);
    }
}

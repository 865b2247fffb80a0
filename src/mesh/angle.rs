//! Dihedral and solid angles, each with a bound on its own rounding error.

use std::f64::consts::{PI, TAU};
use std::iter::Sum;
use std::ops::{Add, Sub};

use super::Vec3;

/// An angle in radians or steradians that is known up to `error`: the true one lies in `[lower(), upper()]`.
///
/// The error is a first-order bound on rounding, taken generously (see [`UNIT_VECTOR_ERROR`]), not interval arithmetic
/// with directed rounding. It is infinite where the angle is not defined (a degenerate triangle, say).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Angle {
    /// The computed angle.
    pub value: f64,
    /// Bound on |computed - true|.
    pub error: f64,
}

/// Absolute error allowed for a product of three unit vectors, each the normalized difference of two positions: about
/// 4 eps a factor and 5 eps for the products and sums, hence below 20 eps in all.
const UNIT_VECTOR_ERROR: f64 = 32.0 * f64::EPSILON;

impl Angle {
    /// No angle at all.
    pub const ZERO: Self = Self { value: 0.0, error: 0.0 };

    /// The least value the angle can have.
    pub fn lower(self) -> f64 {
        self.value - self.error
    }

    /// The largest value the angle can have.
    pub fn upper(self) -> f64 {
        self.value + self.error
    }

    /// The angle with `multiple * pi` added, the rounding of which joins the error.
    pub fn plus_half_turns(self, multiple: i64) -> Self {
        let shift = multiple as f64 * PI;
        self + Self { value: shift, error: shift.abs() * f64::EPSILON }
    }

    /// The angle `atan2(sine, cosine)` when both have an error of at most [`UNIT_VECTOR_ERROR`].
    fn from_sine_cosine(sine: f64, cosine: f64) -> Self {
        let value = sine.atan2(cosine);
        let error = 2.0 * UNIT_VECTOR_ERROR / sine.hypot(cosine) + f64::EPSILON * value.abs();
        // NaN arises from coincident points only.
        if error.is_finite() { Self { value, error } } else { Self { value: 0.0, error: f64::INFINITY } }
    }
}

impl Add for Angle {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        let value = self.value + other.value;
        Self { value, error: self.error + other.error + f64::EPSILON * value.abs() }
    }
}

impl Sub for Angle {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self + Self { value: -other.value, error: other.error }
    }
}

impl Sum for Angle {
    fn sum<I: Iterator<Item = Self>>(angles: I) -> Self {
        angles.fold(Self::ZERO, Add::add)
    }
}

/// The angle in `[0, 2 pi)` by which the half-plane at the edge through `from` turns, counter-clockwise seen against the
/// direction `edge[0] -> edge[1]`, onto the one through `to`.
///
/// With unit vectors e along the edge and u, v from its start: `atan2(e . (u x v), (e x u) . (e x v))`. Both arguments
/// carry the factor |e x u||e x v|, so a point near the edge's line makes the error grow, and one on it infinite.
pub fn dihedral_angle(edge: [&Vec3; 2], from: &Vec3, to: &Vec3) -> Angle {
    let direction = (edge[1] - edge[0]).normalize();
    let (u, v) = ((from - edge[0]).normalize(), (to - edge[0]).normalize());
    let angle = Angle::from_sine_cosine(direction.dot(&u.cross(&v)), direction.cross(&u).dot(&direction.cross(&v)));
    if angle.value < 0.0 { angle + Angle { value: TAU, error: 0.0 } } else { angle }
}

/// The dihedral angle of a positively oriented tet at the edge opposite to the points `from` and `to`, in `[0, pi]`.
///
/// The caller need not know which of the two comes first: the angle of a tet is below pi.
pub fn tet_dihedral_angle(edge: [&Vec3; 2], from: &Vec3, to: &Vec3) -> Angle {
    let angle = dihedral_angle(edge, from, to);
    if angle.value > PI { Angle { value: TAU - angle.value, error: angle.error } } else { angle }
}

/// The solid angle of the trihedral cone at `apex` over the points a, b, c, in `[0, 2 pi]` steradians, irrespective of
/// their order.
///
/// van Oosterom and Strackee 1983: with unit vectors, `tan(omega / 2) = |a . (b x c)| / (1 + a.b + b.c + c.a)`.
pub fn tet_solid_angle(apex: &Vec3, [a, b, c]: [&Vec3; 3]) -> Angle {
    let [a, b, c] = [a, b, c].map(|p| (p - apex).normalize());
    let half = Angle::from_sine_cosine(a.dot(&b.cross(&c)).abs(), 1.0 + a.dot(&b) + b.dot(&c) + c.dot(&a));
    half + half
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dihedral_angles_turn_once_around() {
        let edge = [&Vec3::zeros(), &Vec3::z()];
        for degrees in [0.001f64, 30.0, 90.0, 179.0, 181.0, 270.0, 359.9] {
            let true_angle = degrees.to_radians();
            // Heights along the edge must not matter.
            let to = Vec3::new(3.0 * true_angle.cos(), 3.0 * true_angle.sin(), -0.7);
            let angle = dihedral_angle(edge, &Vec3::new(2.0, 0.0, 0.4), &to);
            assert!((angle.value - true_angle).abs() <= angle.error && angle.error < 1e-13, "{degrees} {angle:?}");
        }
    }

    #[test]
    fn points_on_the_line_of_the_edge_have_no_dihedral_angle() {
        let edge = [&Vec3::zeros(), &Vec3::z()];
        for from in [Vec3::zeros(), Vec3::z() * 2.0] {
            assert_eq!(dihedral_angle(edge, &from, &Vec3::x()).error, f64::INFINITY);
        }
    }

    #[test]
    fn solid_angles_of_an_octant_and_of_the_regular_tetrahedron() {
        let octant =
            tet_solid_angle(&Vec3::x(), [&(Vec3::x() * 2.0), &Vec3::new(1.0, 5.0, 0.0), &Vec3::new(1.0, 0.0, 0.1)]);
        assert!((octant.value - PI / 2.0).abs() <= octant.error && octant.error < 1e-13);
        let [p, q, r, s] = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]].map(Vec3::from);
        let regular = tet_solid_angle(&p, [&q, &s, &r]);
        assert!((regular.value - (23.0f64 / 27.0).acos()).abs() <= regular.error && regular.error < 1e-13);
    }
}

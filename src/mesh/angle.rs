//! Dihedral and solid angles, enclosed.

use std::iter::Sum;
use std::ops::Add;

use super::Vec3;
use crate::linalg::interval::{Interval, cross, difference, dot, norm_squared};

/// An angle in radians or steradians: the true one lies in `[lower(), upper()]`, all rounding accounted for, the positions it
/// was computed from being exact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Angle(Interval);

impl Angle {
    /// No angle at all.
    pub const ZERO: Self = Self(Interval::ZERO);

    /// The angle that lies in an interval.
    #[cfg(test)]
    pub(crate) const fn within(interval: Interval) -> Self {
        Self(interval)
    }

    /// The least value the angle can have.
    pub fn lower(self) -> f64 {
        self.0.lower
    }

    /// The largest value the angle can have.
    pub fn upper(self) -> f64 {
        self.0.upper
    }

    /// The middle of these; NaN for an angle that is not defined.
    pub fn value(self) -> f64 {
        self.0.middle()
    }

    /// All values the angle can have.
    pub(crate) fn interval(self) -> Interval {
        self.0
    }

    /// The angle times a number.
    pub(crate) fn times(self, factor: Interval) -> Self {
        Self(self.0 * factor)
    }

    /// The angle with `multiple * pi` added.
    pub fn plus_half_turns(self, multiple: i64) -> Self {
        Self(self.0 + Interval::exactly(multiple as f64) * Interval::PI)
    }
}

impl Add for Angle {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self(self.0 + other.0)
    }
}

impl Sum for Angle {
    fn sum<I: Iterator<Item = Self>>(angles: I) -> Self {
        angles.fold(Self::ZERO, Add::add)
    }
}

/// Cosine and sine, both times the same positive number, of the angle by which the half-plane at an edge through `from` turns
/// onto the one through `to`: with the edge e and u, v from its start `(e x u) . (e x v)` and `|e| e . (u x v)`.
fn turn(edge: [&Vec3; 2], from: &Vec3, to: &Vec3) -> [Interval; 2] {
    let direction = difference(edge[1], edge[0]);
    let (u, v) = (difference(from, edge[0]), difference(to, edge[0]));
    let sine = norm_squared(direction).sqrt() * dot(direction, cross(u, v));
    [dot(cross(direction, u), cross(direction, v)), sine]
}

/// The angle in `[0, 2 pi)` by which the half-plane at the edge through `from` turns, counter-clockwise seen against the
/// direction `edge[0] -> edge[1]`, onto the one through `to`.
///
/// Below 0, too, where 0 and a whole turn cannot be told apart; unbounded where a point may lie on the edge's line.
pub fn dihedral_angle(edge: [&Vec3; 2], from: &Vec3, to: &Vec3) -> Angle {
    let [cosine, sine] = turn(edge, from, to);
    let angle = Angle(Interval::angle(cosine, sine));
    if angle.upper() < 0.0 { angle.plus_half_turns(2) } else { angle }
}

/// The dihedral angle of a tet at the edge opposite to the points `from` and `to`, in `[0, pi]`.
///
/// The caller need not know which of the two comes first: the angle of a tet is below pi.
pub fn tet_dihedral_angle(edge: [&Vec3; 2], from: &Vec3, to: &Vec3) -> Angle {
    let [cosine, sine] = turn(edge, from, to);
    Angle(up_to_pi(Interval::angle(cosine, sine.abs())))
}

/// The solid angle of the trihedral cone at `apex` over the points a, b, c, in `[0, 2 pi]` steradians, irrespective of
/// their order.
///
/// van Oosterom and Strackee 1983: `tan(omega / 2) = |a . (b x c)| / (|a||b||c| + (a.b)|c| + (b.c)|a| + (c.a)|b|)` with the
/// vectors from the apex.
pub fn tet_solid_angle(apex: &Vec3, points: [&Vec3; 3]) -> Angle {
    let [a, b, c] = points.map(|p| difference(p, apex));
    let [la, lb, lc] = [a, b, c].map(|v| norm_squared(v).sqrt());
    let along = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb;
    let half = Angle(up_to_pi(Interval::angle(along, dot(a, cross(b, c)).abs())));
    half + half
}

/// The part of an angle that lies in `[0, pi]`, as the angle is known to.
fn up_to_pi(angle: Interval) -> Interval {
    angle.within(Interval { lower: 0.0, upper: Interval::PI.upper })
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    fn encloses(angle: Angle, expected: f64) -> bool {
        // The expected value has a rounding error of its own.
        let room = 4.0 * f64::EPSILON;
        angle.lower() <= expected + room && expected - room <= angle.upper() && angle.upper() - angle.lower() < 1e-13
    }

    #[test]
    fn dihedral_angles_turn_once_around() {
        let edge = [&Vec3::zeros(), &Vec3::z()];
        for degrees in [0.001f64, 30.0, 90.0, 179.0, 181.0, 270.0, 359.9] {
            let true_angle = degrees.to_radians();
            // Heights along the edge must not matter.
            let (from, to) =
                (Vec3::new(2.0, 0.0, 0.4), Vec3::new(3.0 * true_angle.cos(), 3.0 * true_angle.sin(), -0.7));
            assert!(encloses(dihedral_angle(edge, &from, &to), true_angle), "{degrees}");
            assert!(encloses(tet_dihedral_angle(edge, &to, &from), true_angle.min(2.0 * PI - true_angle)), "{degrees}");
        }
    }

    #[test]
    fn points_on_the_line_of_the_edge_have_no_dihedral_angle() {
        let edge = [&Vec3::zeros(), &Vec3::z()];
        for from in [Vec3::zeros(), Vec3::z() * 2.0] {
            assert_eq!(dihedral_angle(edge, &from, &Vec3::x()).interval(), Interval::WHOLE);
            assert!(tet_dihedral_angle(edge, &from, &Vec3::x()).value() > 1.5);
        }
    }

    #[test]
    fn solid_angles_of_an_octant_and_of_the_regular_tetrahedron() {
        let octant =
            tet_solid_angle(&Vec3::x(), [&(Vec3::x() * 2.0), &Vec3::new(1.0, 5.0, 0.0), &Vec3::new(1.0, 0.0, 0.1)]);
        assert!(encloses(octant, PI / 2.0), "{octant:?}");
        let [p, q, r, s] = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]].map(Vec3::from);
        assert!(encloses(tet_solid_angle(&p, [&q, &s, &r]), (23.0f64 / 27.0).acos()));
    }

    #[test]
    fn needles_keep_their_small_angles() {
        // Sides of 1 around a base of 1e-6: the solid angle is 1e-12 / 2 to first order, the next one 1e-12 of that.
        let [a, b] = [Vec3::new(1.0, 1e-6, 0.0), Vec3::new(1.0, 0.0, 1e-6)];
        let angle = tet_solid_angle(&Vec3::zeros(), [&Vec3::x(), &a, &b]);
        assert!((angle.value() / 5e-13 - 1.0).abs() < 1e-9 && angle.lower() > 0.0, "{angle:?}");
    }
}

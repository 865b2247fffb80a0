//! What has to be believed: the checkers of all bounds that are called proved.
//!
//! A bound is searched for in whatever way is quick; what is printed is what one of these functions accepted, in interval
//! arithmetic with outward rounding, from the positions of the domain's vertices and those of the boundary's images, which
//! are taken as exact. They use nothing of a search: it hands them a number, and where the theorem needs it a witness (vectors,
//! tangents, multipliers), any of which may be wrong without harm. A tet too thin for the intervals takes no part: its
//! place bounds nothing, or less.
//!
//! | bound | its checker | the search |
//! |---|---|---|
//! | locked | [`linear::locked`] | two singular vectors |
//! | trace, trace-smooth | [`linear::stretch_ratio`], [`linear::slant`] | none |
//! | edge-ratio, vertex, vertex-smooth, wedge, edge-limit | [`factor`] | none |
//! | fan | [`fan::exceeds`] | bisection |
//! | apex | [`free_vertex::excluded`] | cutting planes (`one_free_vertex`) |
//! | end-fan | [`fan::exceeds_with_ends`], [`linear::stretch_ratio`] | closed form (`end_fan`) |
//! | gram | [`super::certificate::check()`] | `certificate::search` |
//!
//! Beside these files: [`crate::linalg::interval`], the angles of [`crate::mesh::angle`], which tets meet at an edge or a vertex
//! ([`crate::mesh::BoundaryEdges`], [`crate::mesh::Boundary`]), the exact predicate [`crate::mesh::orientation`], on which
//! the positive orientation of the domain's tets and [`super::BoundaryImage::injective`] rest, and the theorem in the docs of each bound.

pub(super) mod fan;
pub(super) mod free_vertex;
pub(super) mod linear;

use crate::linalg::interval::{Interval, cross, dot};
use crate::mesh::angle::Angle;

/// The least factor between two angles that are not 0: `max(image / domain, domain / image) >= 1`, rounded down.
pub(super) fn factor(image: Angle, domain: Angle) -> f64 {
    let quotient = |over: Angle, under: Angle| (over.interval() / under.interval()).lower;
    quotient(image, domain).max(quotient(domain, image)).max(1.0)
}

/// `h^(3/2)`, at least 1, rounded down: the bound on K that a bound h on H = s1 / s3 gives.
pub(super) fn three_halves_power(h: f64) -> f64 {
    let h = Interval::exactly(h);
    (h * h.sqrt()).lower.max(1.0)
}

/// A point known to lie in intervals.
pub(super) type Point = [Interval; 3];

/// The difference of two such points.
pub(super) fn between(a: Point, b: Point) -> Point {
    [0, 1, 2].map(|i| a[i] - b[i])
}

/// The gradients of the barycentric coordinates of a tet of either orientation; nothing if intervals cannot tell its volume from
/// zero.
pub(super) fn gradients([x0, x1, x2, x3]: [Point; 4]) -> Option<[Point; 4]> {
    let [a, b, c] = [x1, x2, x3].map(|x| between(x, x0));
    let normals = [cross(b, c), cross(c, a), cross(a, b)];
    let inverse = dot(a, normals[0]).reciprocal()?;
    let [g1, g2, g3] = normals.map(|normal| normal.map(|entry| entry * inverse));
    Some([[0, 1, 2].map(|i| -(g1[i] + g2[i] + g3[i])), g1, g2, g3])
}

/// The largest of the numbers that a checker accepts among `guess (1 - e)`, e growing from 1e-15 by fours, while they exceed
/// `floor`.
///
/// What the intervals leave of a bound is at most four times what they have to take.
pub(super) fn accepted(guess: f64, floor: f64, mut accepts: impl FnMut(f64) -> bool) -> Option<f64> {
    let shortfalls = (0..25).map(|power| 1e-15 * 4f64.powi(power));
    let numbers = shortfalls.map(|shortfall| guess * (1.0 - shortfall)).take_while(|&number| number > floor);
    numbers.filter(|number| number.is_finite()).find(|&number| accepts(number))
}

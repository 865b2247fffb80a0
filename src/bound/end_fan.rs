//! The fan bound with the fixed faces of its end tets.

use std::f64::consts::FRAC_PI_2;

use super::boundary_image::half_turns;
use super::check::fan::{exceeds_with_ends, half_tangent};
use super::check::free_vertex::{Limit, Term, Tet, confinement};
use super::check::linear::stretch_ratio;
use super::check::{accepted, three_halves_power};
use super::{BoundName, BoundaryImage, Kind, LowerBound, Place};
use crate::cancel::Cancel;
use crate::domain::Domain;
use crate::linalg::interval::{Interval, exact_vector};
use crate::linalg::svd;
use crate::mesh::angle::Angle;
use crate::mesh::{BoundaryEdge, BoundaryEdges, Mat3, TetId, Vec3};

/// Golden sections of the search for an extreme angle: to the root of eps.
const SECTIONS: usize = 36;
/// Relative distance from the extreme position at which further half-spaces are taken, beyond the error of that position; what they
/// miss by is of the second order.
const APART: f64 = 1e-6;
/// Edges whose bound was not proved after which no others are looked at: in the images of thin solids, where rounding decides, there are as many
/// as there are edges, of a hundredth of a second each.
const MOST_UNPROVED: usize = 200;
/// Relative accuracy of the root.
const ACCURACY: f64 = 1e-9;

/// `K >= k` for the largest k for which at some boundary edge the image angle beta is outside of
///
/// ```text
/// [ b_min + b'_min + sum 2 atan(tan(a_i / 2) / k^(2/3)),  b_max + b'_max + sum 2 atan(k^(2/3) tan(a_i / 2)) ]
/// ```
///
/// where the sums are over the tets between the first and the last of the edge's fan, and `[b_min, b_max]`, `[b'_min, b'_max]`
/// are the image angles that these two can have with K <= k, given the images of their boundary faces.
///
/// Holds for every orientation-preserving piecewise-linear map of this mesh with these boundary positions. A fan of one tet is
/// locked, and is passed over.
///
/// **Proof**. The tets between are confined as in the fan bound (B2). *End tet*: as in the apex bound, the image q of its fourth vertex lies in
/// the half-spaces of [`super::apex()`] where K <= k. A combination of them with multipliers >= 0 is a half-space
/// again; one that is bounded by a plane through the edge bounds the angle. Where the trace of its boundary face is enough
/// ([`super::trace()`]), q has no place at all.
///
/// **Search**. Let r1 >= r2 be the singular values of the map M of the boundary face, P = r1 r2, and (v, z) the third column of
/// the Jacobian in the principal axes of M and the normal, det = P z > 0. By Schur complements, with `c = (k P z)^(1/3)` and
/// `d = (P z / k)^(1/3)`,
///
/// ```text
/// K_O <= k:  c >= r1, c >= z, v1^2 / (c^2 - r1^2) + v2^2 / (c^2 - r2^2) <= 1 - z^2 / c^2
/// K_I <= k:  d <= r2, d <= z, v1^2 / (r1^2 - d^2) + v2^2 / (r2^2 - d^2) <= z^2 / d^2 - 1
/// ```
///
/// hence `max(r1^3 / (k P), (P / k)^(1/2)) <= z <= min((k P)^(1/2), k r2^3 / P)`. If g is the unit normal of the edge's image in the
/// face's image, and m the stretch of the face across the edge, then the image angle b has
/// `cot b = (m cot a + g . v) / z`. At given z, `|g . v| <= h(z)`, the support function of the two concentric ellipses, the least
/// `(g^T (t Q + (1 - t) Q')^-1 g)^(1/2)` over t in [0, 1] for their forms Q and Q'. In u = 1 / z the extremes
/// `u m cot a -+ u h(1 / u)` are convex and concave: the set of all (v, z) is convex (see `one_free_vertex`), so h is concave, and u h(1 / u)
/// is its perspective. The half-spaces are those at the extreme position and beside it.
///
/// Checked by `check::fan::exceeds_with_ends`, a trace by `check::linear::stretch_ratio`. Edges that may be wound (several image angles are possible) or whose image is folded
/// bound nothing. Concave edges (alpha > pi) are like others.
pub fn end_fan(domain: &Domain, edges: &BoundaryEdges, image: BoundaryImage, cancel: &Cancel) -> Option<LowerBound> {
    let (mut best, mut ends, mut unproved) = (1.0, None, 0);
    for edge in edges.edges() {
        if unproved == MOST_UNPROVED || cancel.is_due() {
            break;
        }
        let Some(fan) = Fan::of(domain, edge, image) else { continue };
        // The best so far is the floor, which spares most edges the root finding.
        if fan.allows(best) {
            continue;
        }
        match accepted(fan.least(best), best, |level| fan.is_proved_above(level)) {
            Some(proved) => (best, ends) = (proved, Some(edge.ends)),
            None => unproved += 1,
        }
    }
    Some(LowerBound::of_mesh(
        BoundName::EndFan,
        Kind::K,
        best,
        Place::edge(domain.mesh(), ends?),
        "any PL map of this mesh with these boundary positions",
    ))
}

/// The tets around an edge and the angle between the images of its two boundary triangles.
struct Fan {
    ends: [EndTet; 2],
    /// The angles of the tets between.
    between: Vec<Angle>,
    /// The image angle.
    image: Angle,
}

impl Fan {
    fn of(domain: &Domain, edge: &BoundaryEdge, image: BoundaryImage) -> Option<Self> {
        let angle = edge.image_angle(image.positions())?;
        if edge.fan.len() < 2 || !image.is_unique(angle, half_turns(edge.fan.len())) {
            return None;
        }
        let owners = edge.triangles.map(|triangle| domain.boundary().owners()[triangle.index()]);
        let end = |side: usize| {
            let face = [edge.ends[0], edge.ends[1], edge.opposite[side]];
            let tet = domain.mesh().tets()[owners[side].index()];
            let free = tet.into_iter().find(|v| !face.contains(v))?;
            let [p, q, r] = face.map(|v| domain.mesh().points()[v.index()]);
            let corners = [p, q, r, domain.mesh().points()[free.index()]];
            EndTet::of(corners, face.map(|v| image.positions()[v.index()]), angle_of(edge, owners[side])?.value())
        };
        let ends = [end(0)?, end(1)?];
        let between = edge.fan.iter().filter(|(tet, _)| !owners.contains(tet)).map(|&(_, angle)| angle).collect();
        Some(Self { ends, between, image: angle })
    }

    /// Whether the image angle is possible with K <= k, but for rounding.
    fn allows(&self, k: f64) -> bool {
        let [Some(first), Some(last)] = self.ends.each_ref().map(|end| end.angles(k)) else { return false };
        let ratio = k.cbrt().powi(2);
        let tangents = || self.between.iter().map(|angle| (0.5 * angle.value()).tan());
        let least: f64 = tangents().map(|tangent| 2.0 * (tangent / ratio).atan()).sum();
        let most: f64 = tangents().map(|tangent| 2.0 * (tangent * ratio).atan()).sum();
        let angle = self.image.value();
        angle >= first[0] + last[0] + least && angle <= first[1] + last[1] + most
    }

    /// A k above `floor`, at which the angle is impossible, up to which it is.
    fn least(&self, floor: f64) -> f64 {
        let (mut low, mut high) = (floor, 2.0 * floor);
        while high.is_finite() && !self.allows(high) {
            (low, high) = (high, 2.0 * high);
        }
        while high > low * (1.0 + ACCURACY) {
            let middle = 0.5 * (low + high);
            if self.allows(middle) { high = middle } else { low = middle }
        }
        low
    }

    /// Whether the trace of an end, or half-spaces at the extreme positions prove K > k.
    fn is_proved_above(&self, k: f64) -> bool {
        if self.ends.iter().any(|end| end.has_no_place(k)) {
            return true;
        }
        let between: Vec<Interval> = self.between.iter().map(|&angle| half_tangent(angle)).collect();
        [Sense::Least, Sense::Most].into_iter().any(|sense| {
            let [Some(first), Some(last)] = self.ends.each_ref().map(|end| end.witness(k, sense)) else { return false };
            let ends = [(&first.0, &first.1[..]), (&last.0, &last.1[..])];
            exceeds_with_ends(ends, &between, self.image, k)
        })
    }
}

fn angle_of(edge: &BoundaryEdge, tet: TetId) -> Option<Angle> {
    edge.fan.iter().find(|(other, _)| *other == tet).map(|(_, angle)| *angle)
}

/// Which end of the range of an angle is sought.
#[derive(Clone, Copy, PartialEq)]
enum Sense {
    Least,
    Most,
}

/// A tet with a fixed face at the edge.
struct EndTet {
    /// The ends of the edge, the third corner of the face, the free one; and the images of the first three.
    corners: [Vec3; 4],
    image: [Vec3; 3],
    /// The map of the face from the edge's direction and the normal to it in the face, `[[along, shear], [0, across]]`.
    along: f64,
    shear: f64,
    across: f64,
    /// Squares of the singular values of the face's map, the larger one first.
    squares: [f64; 2],
    /// The components of g along the principal axes of the face's image.
    normal: [f64; 2],
    /// The product of the singular values.
    area: f64,
    /// m cot a.
    cotangent: f64,
}

impl EndTet {
    fn of(corners: [Vec3; 4], image: [Vec3; 3], angle: f64) -> Option<Self> {
        let [x1, x2, y2] = frame([corners[0], corners[1], corners[2]]);
        let [u1, u2, v2] = frame(image);
        let (along, across) = (u1 / x1, v2 / y2);
        let shear = (u2 - along * x2) / y2;
        let larger = 0.5 * ((along + across).hypot(shear) + (along - across).hypot(shear));
        let area = along * across;
        let squares = [larger.powi(2), (area / larger).powi(2)];
        // The axis of the larger one is an eigenvector of M M^T, which turns by half of this angle; g = (0, 1).
        let turn = 0.5 * (2.0 * shear * across).atan2(along.powi(2) + shear.powi(2) - across.powi(2));
        let normal = [turn.sin(), turn.cos()];
        let cotangent = across / angle.tan();
        let tet = Self { corners, image, along, shear, across, squares, normal, area, cotangent };
        [area, cotangent, squares[0], squares[1], shear].into_iter().all(f64::is_finite).then_some(tet)
    }

    /// The range of the image angle if K <= k; nothing if K > k whatever the fourth vertex does.
    fn angles(&self, k: f64) -> Option<[f64; 2]> {
        let extremes = [Sense::Least, Sense::Most].map(|sense| self.extreme(k, sense));
        let [Some((least, _)), Some((most, _))] = extremes else { return None };
        Some([least, most])
    }

    /// The extreme angle if K <= k, and the z at which it is attained.
    fn extreme(&self, k: f64, sense: Sense) -> Option<(f64, f64)> {
        let [larger, smaller] = self.squares;
        let area = self.area;
        let from = (larger.powf(1.5) / (k * area)).max((area / k).sqrt());
        let to = (k * area).sqrt().min(k * smaller.powf(1.5) / area);
        if from > to * (1.0 + 1e-12) {
            return None;
        }
        let sign = if sense == Sense::Most { 1.0 } else { -1.0 };
        let cotangent = |u: f64| u * (sign * self.cotangent - self.reach(k, u.recip()).0);
        let (u, value) = least_convex(cotangent, [to.recip(), from.recip()]);
        Some((FRAC_PI_2 - (sign * value).atan(), u.recip()))
    }

    /// h(z), the largest g . v, and the squares of the half-axes of the ellipse that attains it.
    fn reach(&self, k: f64, z: f64) -> (f64, [f64; 2]) {
        let square = z * z;
        let [above, below] = [k * self.area * z, self.area * z / k].map(|cube| cube.cbrt().powi(2));
        // Squared half-axes of the two ellipses; an empty one is a point.
        let room = |product: [f64; 2]| product[0].max(0.0) * product[1].max(0.0);
        let outer = self.squares.map(|s| room([above - s, 1.0 - square / above]));
        let inner = self.squares.map(|s| room([s - below, square / below - 1.0]));
        let weights = self.normal.map(|component| component.powi(2));
        let value = |axes: [f64; 2]| weights[0] * axes[0] + weights[1] * axes[1];
        let least = if value(inner) < value(outer) { inner } else { outer };
        // Stationary where sqrt(w_0 |p_0 - q_0|) (t p_1 + (1 - t) q_1) = sqrt(w_1 |p_1 - q_1|) (t p_0 + (1 - t) q_0).
        let forms = [outer, inner].map(|axes| axes.map(f64::recip));
        let roots = [0, 1].map(|i| (weights[i] * (forms[0][i] - forms[1][i]).abs()).sqrt());
        let (at_zero, at_one) =
            (roots[0] * forms[1][1] - roots[1] * forms[1][0], roots[0] * forms[0][1] - roots[1] * forms[0][0]);
        let t = at_zero / (at_zero - at_one);
        let mixed = [0, 1].map(|i| (t * forms[0][i] + (1.0 - t) * forms[1][i]).recip());
        let usable = (0.0..=1.0).contains(&t) && forms.as_flattened().iter().all(|form| form.is_finite());
        let axes = if usable && value(mixed) < value(least) { mixed } else { least };
        (value(axes).sqrt(), axes)
    }

    /// Whether the map of the face alone proves K > k.
    fn has_no_place(&self, k: f64) -> bool {
        let [p, q, r, _] = self.corners;
        stretch_ratio([p, q, r], self.image).is_some_and(|ratio| three_halves_power(ratio) > k)
    }

    /// The tet and terms that nearly prove the extreme angle.
    ///
    /// From half-spaces at the extreme position and beside it, three whose combination has neither a part along the edge nor
    /// a constant, those of the best angle; and as much of the volume's as makes up for rounding.
    fn witness(&self, k: f64, sense: Sense) -> Option<(Tet, Vec<Term>)> {
        let tet = Tet::in_order(self.corners.each_ref().map(exact_vector), self.image)?;
        let parts = |terms: &[Term]| {
            let found = confinement(&tet, k, terms)?;
            Some([found.constant, found.along, found.across, found.normal].map(Interval::middle))
        };
        let terms = self.half_spaces(k, sense)?;
        let sides: Vec<[f64; 4]> = terms.iter().map(|term| parts(&[*term])).collect::<Option<_>>()?;
        let mut best: Option<(f64, Vec<Term>)> = None;
        for (i, a) in sides.iter().enumerate() {
            for (j, b) in sides.iter().enumerate().take(i) {
                for (l, c) in sides.iter().enumerate().take(j) {
                    let weights = Vec3::new(a[0], b[0], c[0]).cross(&Vec3::new(a[1], b[1], c[1]));
                    let weights = weights * weights.sum().signum() / weights.amax();
                    let [across, normal] = [2, 3].map(|part| weights.dot(&Vec3::new(a[part], b[part], c[part])));
                    let turn = (normal / across).atan();
                    let (right_sense, gain) =
                        if sense == Sense::Most { (across < 0.0, -turn) } else { (across > 0.0, turn) };
                    let usable = right_sense && weights.iter().all(|weight| *weight >= 0.0) && gain.is_finite();
                    if usable && best.as_ref().is_none_or(|(found, _)| gain > *found) {
                        let chosen = [i, j, l].into_iter().zip(weights.iter());
                        best = Some((gain, chosen.map(|(i, &multiplier)| Term { multiplier, ..terms[i] }).collect()));
                    }
                }
            }
        }
        let (_, mut terms) = best?;
        let volume = Term { tet: 0, limit: Limit::Volume, multiplier: 1.0 };
        let [least, ..] = parts(&[volume])?;
        let found = confinement(&tet, k, &terms)?;
        let missing = -(found.constant - found.along.abs() * found.radius).lower;
        // Twice what is missing, for its own rounding.
        terms.push(Term { multiplier: (2.0 * missing / least).max(0.0), ..volume });
        Some((tet, terms))
    }

    /// The half-spaces of both dilatations at the extreme position and beside it.
    fn half_spaces(&self, k: f64, sense: Sense) -> Option<Vec<Term>> {
        let (_, z) = self.extreme(k, sense)?;
        let (reach, axes) = self.reach(k, z);
        let sign = if sense == Sense::Most { -1.0 } else { 1.0 };
        // v = E g / h with E the ellipse's squared half-axes; (sin, cos) of the turn are g's components.
        let [sine, cosine] = self.normal;
        let [first, second] = [axes[0] * sine, axes[1] * cosine].map(|part| sign * part / reach);
        let v = [first * cosine - second * sine, first * sine + second * cosine];
        if !v[0].is_finite() || !v[1].is_finite() {
            return None;
        }
        let [domain, image] = self.frames();
        let size = z.max(self.squares[0].sqrt()) * APART;
        let beside = [[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];
        let mut terms = Vec::new();
        for [along, up] in beside {
            #[rustfmt::skip]
            let jacobian = Mat3::new(
                self.along, self.shear, v[0] + along * size,
                0.0, self.across, v[1],
                0.0, 0.0, z * (1.0 + up * APART),
            );
            let decomposition = svd(&jacobian);
            let determinant: f64 = decomposition.values.iter().product();
            let vectors = |column: usize| {
                let [u, v] =
                    [decomposition.left, decomposition.right].map(|vectors| vectors.column(column).into_owned());
                (image * u, domain * v)
            };
            let (root, kappa) = (determinant.cbrt(), k.cbrt());
            let (u, v) = vectors(0);
            let outer = Limit::Outer { u, v, b: kappa / (3.0 * root.powi(2)) };
            let (u, v) = vectors(2);
            let inner = Limit::Inner { u, v, b: 2.0 * kappa / (3.0 * root) };
            terms.extend([outer, inner].map(|limit| Term { tet: 0, limit, multiplier: 1.0 }));
        }
        Some(terms)
    }

    /// Orthonormal columns along the edge, across it in the face, and normal to the face, in the domain towards the free vertex and
    /// in the image of the same handedness.
    fn frames(&self) -> [Mat3; 2] {
        let [p, q, r, free] = self.corners;
        let columns = |[p, q, r]: [Vec3; 3]| {
            let edge = (q - p).normalize();
            let side = r - p - edge * edge.dot(&(r - p));
            (edge, side.normalize())
        };
        let ((edge, side), (edge_image, side_image)) = (columns([p, q, r]), columns(self.image));
        let hand = edge.cross(&side).dot(&(free - p)).signum();
        [
            Mat3::from_columns(&[edge, side, edge.cross(&side) * hand]),
            Mat3::from_columns(&[edge_image, side_image, edge_image.cross(&side_image) * hand]),
        ]
    }
}

/// Two sides of a triangle in an orthonormal frame of its plane, `(x1, 0)` and `(x2, y2)`.
fn frame([p, q, r]: [Vec3; 3]) -> [f64; 3] {
    let (first, second) = (q - p, r - p);
    let length = first.norm();
    [length, first.dot(&second) / length, first.cross(&second).norm() / length]
}

/// The place and the least value of a convex function between two positive numbers, to the root of eps.
fn least_convex(f: impl Fn(f64) -> f64, [from, to]: [f64; 2]) -> (f64, f64) {
    const GOLDEN: f64 = 0.618_033_988_749_894_8;
    let (mut low, mut high) = (from, to);
    let at = |x: f64| (x, f(x));
    let mut left = at(to - GOLDEN * (to - from));
    let mut right = at(from + GOLDEN * (to - from));
    for _ in 0..SECTIONS {
        if left.1 <= right.1 {
            (high, right) = (right.0, left);
            left = at(high - GOLDEN * (high - low));
        } else {
            (low, left) = (left.0, right);
            right = at(low + GOLDEN * (high - low));
        }
    }
    // Not the ends themselves: an ellipse may vanish there, and only what is near is a limit.
    if left.1 <= right.1 { left } else { right }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::bound::check::free_vertex::Extreme;
    use crate::dilatation::Dilatation;

    /// The tet over a face with an edge of length 1, its third corner at (x, y) and the fourth at a dihedral angle, and the face's image.
    fn tet([x, y]: [f64; 2], [length, u, v]: [f64; 3], angle: f64) -> EndTet {
        let corners = [Vec3::zeros(), Vec3::x(), Vec3::new(x, y, 0.0), Vec3::new(0.3, angle.cos(), angle.sin())];
        EndTet::of(corners, [Vec3::zeros(), Vec3::x() * length, Vec3::new(u, v, 0.0)], angle).unwrap()
    }

    /// The differential of the cube's central projection at (1, 1, s) on the face x = 1, as images of an edge of length 1
    /// along z and of a third corner at distance 1: stretches cos^2 in the direction away from the face's centre and cos
    /// across it.
    fn cube_face(s: f64) -> [f64; 3] {
        let cosine = (2.0 + s * s).sqrt().recip();
        // Direction of the edge and normal to it in the face, of the face's coordinates (y, z).
        let radial = [s, 1.0].map(|x| x / (1.0 + s * s).sqrt());
        let image = |v: [f64; 2]| {
            let along = (v[0] * radial[0] + v[1] * radial[1]) * cosine.powi(2);
            let across = (v[0] * radial[1] - v[1] * radial[0]) * cosine;
            [along, across]
        };
        let (edge, corner) = (image([1.0, 0.0]), image([0.0, 1.0]));
        let length = edge[0].hypot(edge[1]);
        let dot = (edge[0] * corner[0] + edge[1] * corner[1]) / length;
        [length, dot, (edge[0] * corner[1] - edge[1] * corner[0]).abs() / length]
    }

    #[test]
    fn the_table_of_the_cubes_edge() {
        // Fans of n equal angles at (1, 1, s), opening from 90 to 180 degrees.
        let table =
            [(0.0, 2, 4.200), (0.0, 4, 3.042), (0.0, 6, 2.914), (0.9, 2, 4.606), (0.9, 4, 3.469), (0.9, 6, 3.243)];
        for (s, count, expected) in table {
            let angle = FRAC_PI_2 / count as f64;
            let end = || tet([0.0, 1.0], cube_face(s), angle);
            let exactly = |value: f64| Angle::within(Interval::exactly(value));
            let fan =
                Fan { ends: [end(), end()], between: vec![exactly(angle); count - 2], image: exactly(2.0 * FRAC_PI_2) };
            let found = fan.least(1.0);
            // Half a unit of the last decimal given.
            assert!((found - expected).abs() < 5.1e-4, "{s} {count}: {found} instead of {expected}");
            // The half-spaces lose 1e-6 squared, and the search the accuracy of its bisection.
            let proved = accepted(found, 1.0, |level| fan.is_proved_above(level)).unwrap();
            assert!(proved > found * (1.0 - 1e-7), "{s} {count}: {proved} instead of {found}");
            assert!(!fan.is_proved_above(found * (1.0 + 1e-7)));
        }
    }

    proptest! {
        #[test]
        fn no_linear_map_has_an_angle_outside_of_its_interval(
            entries in prop::array::uniform9(-1.0..1.0f64),
            corner in (-1.0..2.0f64, 0.1..2.0f64),
            fourth in prop::array::uniform3(0.05..1.0f64),
            left in 0.0..1.0f64,
        ) {
            let map = Mat3::from_row_slice(&entries);
            prop_assume!(map.determinant() > 1e-3);
            let k = Dilatation::of(&map).k();
            prop_assume!(k < 1e3);
            let edge = [Vec3::zeros(), Vec3::x(), Vec3::new(corner.0, corner.1, 0.0)];
            let free = Vec3::new(fourth[0], 2.0 * left - fourth[1], fourth[2]);
            let moved = edge.map(|p| map * p);
            let angle = |[a, b, c]: [Vec3; 3], d: Vec3| crate::mesh::angle::tet_dihedral_angle([&a, &b], &c, &d);
            let corners = [edge[0], edge[1], edge[2], free];
            let Some(tet) = EndTet::of(corners, moved, angle(edge, free).value()) else { return Ok(()) };
            let b = angle(moved, map * free).value();
            // The search is only a guess, off by the root of eps.
            let room = 1e-6 * k;
            let interval = tet.angles(k * (1.0 + 1e-12));
            prop_assert!(interval.is_some_and(|[least, most]| least <= b + room && b <= most + room), "{b} {interval:?} at {k}");
            // What is proved has no room, but for the rounding of the image by the map.
            for sense in [Sense::Least, Sense::Most] {
                let Some((checked, terms)) = tet.witness(k * (1.0 + 1e-9), sense) else { continue };
                let found = crate::bound::check::free_vertex::extreme_angle(&checked, k * (1.0 + 1e-9), &terms);
                match found {
                    Some(Extreme::Least(angle)) => prop_assert!(angle.lower <= b, "{angle:?} {b}"),
                    Some(Extreme::Most(angle)) => prop_assert!(angle.upper >= b, "{angle:?} {b}"),
                    None => {}
                }
            }
            // More is allowed with a larger K.
            let wider = tet.angles(2.0 * k).unwrap();
            prop_assert!(wider[0] <= interval.unwrap()[0] + room && wider[1] >= interval.unwrap()[1] - room);
        }
    }
}

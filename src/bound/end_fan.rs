//! The fan bound with the fixed faces of its end tets (bounds.md B3.3).

use std::f64::consts::FRAC_PI_2;

use super::trace::frame;
use super::{BoundaryImage, Kind, LowerBound, Place, rounded_down};
use crate::domain::Domain;
use crate::mesh::angle::Angle;
use crate::mesh::{BoundaryEdge, BoundaryEdges, TetId, Vec3};

/// Golden sections of the search for an extreme angle; what their bracket leaves open is charged.
const SECTIONS: usize = 36;
/// Radians by which the interval of each end tet is widened for rounding, which is below the root of eps.
const MARGIN: f64 = 1e-7;
/// Boundary triangles of worse condition (squared sides over twice the area) are left alone.
const WORST_CONDITION: f64 = 1e5;

/// `K >= k` for the largest k for which at some boundary edge the image angle beta is outside of
///
/// ```text
/// [ b_min + b'_min + sum 2 atan(tan(a_i / 2) / k^(2/3)),  b_max + b'_max + sum 2 atan(k^(2/3) tan(a_i / 2)) ]
/// ```
///
/// where the sums are over the tets between the first and the last of the edge's fan, and `[b_min, b_max]`, `[b'_min, b'_max]`
/// contain the image angles that these two can have with K <= k, given the images of their boundary faces.
///
/// Holds for every orientation-preserving piecewise-linear map of this mesh with these boundary positions. It is not below the fan
/// bound ([`super::fan()`]) by more than its margin for rounding. A fan of one tet is locked, and is passed over.
///
/// **Proof**. The tets between are confined as in the fan bound (B2). *End tet*: let r1 >= r2 be the singular values of the
/// map M of its boundary face, P = r1 r2, and (v, z) the third column of the Jacobian in the principal axes of M and the
/// normal, det = P z > 0. By Schur complements, with `c = (k P z)^(1/3)` and `d = (P z / k)^(1/3)`,
///
/// ```text
/// K_O <= k:  c >= r1, c >= z, v1^2 / (c^2 - r1^2) + v2^2 / (c^2 - r2^2) <= 1 - z^2 / c^2
/// K_I <= k:  d <= r2, d <= z, v1^2 / (r1^2 - d^2) + v2^2 / (r2^2 - d^2) <= z^2 / d^2 - 1
/// ```
///
/// hence `max(r1^3 / (k P), (P / k)^(1/2)) <= z <= min((k P)^(1/2), k r2^3 / P)`. If g is the unit normal of the edge's image in the
/// face's image, and m the stretch of the face across the edge, then the image angle b has
/// `cot b = (m cot a + g . v) / z`. At given z, `|g . v| <= h(z)`, the support function of the two concentric ellipses, the least
/// `(g^T (t Q + (1 - t) Q')^-1 g)^(1/2)` over t in [0, 1] for their forms Q and Q'; any t bounds it. In u = 1 / z the extremes
/// `u m cot a -+ u h(1 / u)` are convex and concave: the set of all (v, z) is convex (B4.3), so h is concave, and u h(1 / u)
/// is its perspective. A convex function in a bracket u0 < u1 < u2 is nowhere below the continuations of its two chords.
///
/// In floats: all intervals are widened by the errors of their angles and by a margin of 1e-7 for each end tet, and k is the lower end
/// of a bisection. Edges that may be wound (several image angles are possible), whose triangles are thin, or whose image is
/// folded bound nothing. Concave edges (alpha > pi) are like others.
pub fn end_fan(domain: &Domain, edges: &BoundaryEdges, image: BoundaryImage) -> Option<LowerBound> {
    let (mut best, mut ends) = (1.0, None);
    for edge in edges.edges() {
        let Some(fan) = Fan::of(domain, edge, image) else { continue };
        // The best so far is the floor, which spares most edges the root finding.
        if !fan.allows(best) {
            (best, ends) = (fan.least(best), Some(edge.ends));
        }
    }
    Some(LowerBound::of_mesh(
        "end-fan",
        "docs of qcball::bound::end_fan",
        Kind::K,
        rounded_down(best, 4.0 * f64::EPSILON)?,
        Place::edge(domain.mesh(), ends?),
        "any PL map of this mesh with these boundary positions",
    ))
}

/// The tets around an edge and the angle between the images of its two boundary triangles.
struct Fan {
    ends: [EndTet; 2],
    /// The tangents of half the angles of the tets between.
    between: Vec<f64>,
    /// The image angle, with the errors of all angles of the tets between.
    image: Angle,
}

impl Fan {
    fn of(domain: &Domain, edge: &BoundaryEdge, image: BoundaryImage) -> Option<Self> {
        let angle = edge.image_angle(image.positions())?;
        if edge.fan.len() < 2 || !image.is_unique(angle, std::f64::consts::PI * edge.fan.len() as f64) {
            return None;
        }
        let owners = edge.triangles.map(|triangle| domain.boundary().owners()[triangle.index()]);
        let end = |side: usize| {
            let [rest, moved] = [domain.mesh().points(), image.positions()].map(|positions: &[Vec3]| {
                frame([edge.ends[0], edge.ends[1], edge.opposite[side]].map(|v| positions[v.index()]))
                    .filter(|(_, condition)| *condition < WORST_CONDITION)
            });
            EndTet::of(rest?.0, moved?.0, angle_of(edge, owners[side])?)
        };
        let ends = [end(0)?, end(1)?];
        let between = edge.fan.iter().filter(|(tet, _)| !owners.contains(tet)).map(|(_, angle)| *angle);
        let error: f64 = between.clone().map(|angle| angle.error + 16.0 * f64::EPSILON).sum();
        let between = between.map(|angle| (0.5 * angle.value).tan()).collect();
        Some(Self { ends, between, image: Angle { value: angle.value, error: angle.error + error } })
    }

    /// Whether the image angle is not shown to be impossible with K <= k.
    fn allows(&self, k: f64) -> bool {
        let [Some(first), Some(last)] = self.ends.each_ref().map(|end| end.angles(k)) else { return false };
        let ratio = k.cbrt().powi(2);
        let least: f64 = self.between.iter().map(|tangent| 2.0 * (tangent / ratio).atan()).sum();
        let most: f64 = self.between.iter().map(|tangent| 2.0 * (tangent * ratio).atan()).sum();
        // The derivative of an arc tangent's argument is at most the ratio times that of the angle.
        let Angle { value, error } = self.image;
        let error = error * ratio;
        value + error >= first[0] + last[0] + least && value - error <= first[1] + last[1] + most
    }

    /// A k above `floor`, at which the angle is impossible, up to which it is.
    fn least(&self, floor: f64) -> f64 {
        let (mut low, mut high) = (floor, 2.0 * floor);
        while !self.allows(high) {
            (low, high) = (high, 2.0 * high);
        }
        while high > low * (1.0 + 1e-9) {
            let middle = 0.5 * (low + high);
            if self.allows(middle) { high = middle } else { low = middle }
        }
        low
    }
}

fn angle_of(edge: &BoundaryEdge, tet: TetId) -> Option<Angle> {
    edge.fan.iter().find(|(other, _)| *other == tet).map(|(_, angle)| *angle)
}

/// A tet with a fixed face at the edge.
struct EndTet {
    /// Squares of the singular values of the face's map, the larger one first.
    squares: [f64; 2],
    /// Squares of the components of g along the principal axes of the face's image.
    weights: [f64; 2],
    /// The product of the singular values.
    area: f64,
    /// m cot a.
    cotangent: f64,
    error: f64,
}

impl EndTet {
    /// The face as two frames `[x1, x2, y2]`: the edge is (x1, 0), the third corner (x2, y2).
    fn of([x1, x2, y2]: [f64; 3], [u1, u2, v2]: [f64; 3], angle: Angle) -> Option<Self> {
        // M = [[along, shear], [0, across]] from (edge, normal in the face) to the same of the image.
        let (along, across) = (u1 / x1, v2 / y2);
        let shear = (u2 - along * x2) / y2;
        let larger = 0.5 * ((along + across).hypot(shear) + (along - across).hypot(shear));
        let area = along * across;
        let squares = [larger.powi(2), (area / larger).powi(2)];
        // g = (0, 1), and g . M M^T g = across^2. For equal singular values any axes do.
        let share = ((across.powi(2) - squares[1]) / (squares[0] - squares[1])).clamp(0.0, 1.0);
        let weights = if share.is_finite() { [share, 1.0 - share] } else { [0.0, 1.0] };
        let tet = Self { squares, weights, area, cotangent: across / angle.value.tan(), error: angle.error };
        [tet.area, tet.cotangent, tet.error].into_iter().all(f64::is_finite).then_some(tet)
    }

    /// An interval that holds the image angle if K <= k; nothing if K > k whatever the fourth vertex does.
    fn angles(&self, k: f64) -> Option<[f64; 2]> {
        let [larger, smaller] = self.squares;
        let area = self.area;
        let from = (larger.powf(1.5) / (k * area)).max((area / k).sqrt());
        let to = (k * area).sqrt().min(k * smaller.powf(1.5) / area);
        if from > to * (1.0 + 1e-12) {
            return None;
        }
        let extreme = |sign: f64| {
            least_convex(|u| u * (sign * self.cotangent - self.reach(k, u.recip())), [to.recip(), from.recip()])
        };
        let [least, largest] = [-extreme(-1.0), extreme(1.0)];
        // The angle itself enters by its cotangent, as in B2 by its tangent.
        let margin = MARGIN + self.error * k;
        Some([FRAC_PI_2 - least.atan() - margin, FRAC_PI_2 - largest.atan() + margin])
    }

    /// h(z): the largest g . v.
    fn reach(&self, k: f64, z: f64) -> f64 {
        let square = z * z;
        let [above, below] = [k * self.area * z, self.area * z / k].map(|cube| cube.cbrt().powi(2));
        // Squared half-axes of the two ellipses; an empty one is a point.
        let room = |product: [f64; 2]| product[0].max(0.0) * product[1].max(0.0);
        let outer = self.squares.map(|s| room([above - s, 1.0 - square / above]));
        let inner = self.squares.map(|s| room([s - below, square / below - 1.0]));
        let forms = [outer, inner].map(|axes| axes.map(f64::recip));
        let value =
            |t: f64| -> f64 { (0..2).map(|i| self.weights[i] / (t * forms[0][i] + (1.0 - t) * forms[1][i])).sum() };
        // Stationary where sqrt(w_0 |p_0 - q_0|) (t p_1 + (1 - t) q_1) = sqrt(w_1 |p_1 - q_1|) (t p_0 + (1 - t) q_0).
        let roots = [0, 1].map(|i| (self.weights[i] * (forms[0][i] - forms[1][i]).abs()).sqrt());
        let (at_zero, at_one) =
            (roots[0] * forms[1][1] - roots[1] * forms[1][0], roots[0] * forms[0][1] - roots[1] * forms[0][0]);
        let stationary = at_zero / (at_zero - at_one);
        let own = |axes: [f64; 2]| self.weights[0] * axes[0] + self.weights[1] * axes[1];
        let mut least = own(outer).min(own(inner));
        if (0.0..=1.0).contains(&stationary) && forms.as_flattened().iter().all(|form| form.is_finite()) {
            least = least.min(value(stationary));
        }
        least.sqrt()
    }
}

/// A lower bound for the least value of a convex function between two positive numbers, off by what the bracket leaves open.
fn least_convex(f: impl Fn(f64) -> f64, [from, to]: [f64; 2]) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_894_8;
    let (mut low, mut high) = ((from, f(from)), (to, f(to)));
    let at = |x: f64| (x, f(x));
    let mut left = at(to - GOLDEN * (to - from));
    let mut right = at(from + GOLDEN * (to - from));
    for _ in 0..SECTIONS {
        if left.1 <= right.1 {
            (high, right) = (right, left);
            left = at(high.0 - GOLDEN * (high.0 - low.0));
        } else {
            (low, left) = (left, right);
            right = at(low.0 + GOLDEN * (high.0 - low.0));
        }
    }
    let middle = if left.1 <= right.1 { left } else { right };
    let chord = |near: (f64, f64), far: (f64, f64)| {
        (near.1 - middle.1).max(0.0) * ((far.0 - middle.0) / (middle.0 - near.0)).abs()
    };
    let open = chord(low, high).max(chord(high, low));
    let open = if open.is_finite() { open } else { 0.0 };
    middle.1.min(low.1).min(high.1) - open
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::dilatation::Dilatation;
    use crate::mesh::Mat3;

    fn exactly(value: f64) -> Angle {
        Angle { value, error: 0.0 }
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
        // bounds.md B6: fans of n equal angles at (1, 1, s), opening from 90 to 180 degrees.
        let table =
            [(0.0, 2, 4.200), (0.0, 4, 3.042), (0.0, 6, 2.914), (0.9, 2, 4.606), (0.9, 4, 3.469), (0.9, 6, 3.243)];
        for (s, count, expected) in table {
            let angle = FRAC_PI_2 / count as f64;
            let end = || EndTet::of([1.0, 0.0, 1.0], cube_face(s), exactly(angle)).unwrap();
            let fan = Fan {
                ends: [end(), end()],
                between: vec![(0.5 * angle).tan(); count - 2],
                image: exactly(2.0 * FRAC_PI_2),
            };
            let found = fan.least(1.0);
            // Half a unit of the last decimal given, and the margin for rounding.
            assert!((found - expected).abs() < 5.1e-4, "{s} {count}: {found} instead of {expected}");
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
            let (Some(rest), Some(image)) = (frame(edge), frame(moved)) else { return Ok(()) };
            let tet = EndTet::of(rest.0, image.0, angle(edge, free)).unwrap();
            let b = angle(moved, map * free).value;
            let interval = tet.angles(k * (1.0 + 1e-12));
            prop_assert!(interval.is_some_and(|[least, most]| least <= b && b <= most), "{b} {interval:?} at {k}");
            // More is allowed with a larger K.
            let wider = tet.angles(2.0 * k).unwrap();
            prop_assert!(wider[0] <= interval.unwrap()[0] && wider[1] >= interval.unwrap()[1]);
        }
    }
}

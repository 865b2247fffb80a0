//! Tets with three fixed vertices and one free one (docs of [`crate::bound::apex()`]).

use super::{Point, between, gradients};
use crate::bound::Kind;
use crate::linalg::interval::{Interval, cross, difference, dot, exact_vector, norm_squared};
use crate::mesh::{TetMesh, Vec3};

type Vector = [Interval; 3];

/// A tet whose map A is a function of the image q of one of its vertices: `A = e1 g1^T + e2 g2^T + (q - y0) g3^T`, y0 and
/// y0 + e1, y0 + e2 the images of the fixed vertices, g1, g2 and g3 the gradients of the barycentric coordinates.
///
/// `cof A` and `det A` are affine in q as well:
///
/// ```text
/// cof A = (e1 x e2) (g1 x g2)^T + (e2 x r) (g2 x g3)^T + (r x e1) (g3 x g1)^T        det A = (e1 x e2) . r  (g1 x g2) . g3        r = q - y0
/// ```
pub(in crate::bound) struct Tet {
    gradients: [Vector; 3],
    fixed: [Vec3; 3],
    edges: [Vector; 2],
    /// The least and the largest square of the stretch of an edge between fixed vertices.
    stretches: [Interval; 2],
    /// The squares of the distances of the free vertex from the fixed ones, in the domain.
    distances: [Interval; 3],
}

/// An inequality that the image of the free vertex obeys where the map of the tet has a dilatation of at most k.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::bound) enum Limit {
    /// From K_O <= k: `u . A v <= |u||v| |A| <= |u||v| (k d)^(1/3) <= a + b d`, the last if `27 a^2 b >= 4 k |u|^3 |v|^3`.
    Outer { u: Vec3, v: Vec3, b: f64 },
    /// From K_I <= k: `u . cof A v <= |u||v| |cof A| <= |u||v| k^(1/3) d^(2/3) <= a + b d`, the last if `27 a b^2 >= 4 k |u|^3 |v|^3`.
    Inner { u: Vec3, v: Vec3, b: f64 },
    /// From both, or one of them: `d = s1 s2 s3 >= s^3 / h^2` with s the stretch of a fixed edge, `s <= s1`, and `h >= s1 / s3`.
    Volume,
}

/// A limit of one of several tets and its multiplier.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::bound) struct Term {
    pub tet: usize,
    pub limit: Limit,
    pub multiplier: f64,
}

/// `constant + slope . (q - centre)`.
struct Affine {
    constant: Interval,
    slope: Vector,
}

/// The largest s1 / s3 where a dilatation of that kind is at most k: `K >= (s1 / s3)^(3/2)`, and `K_I, K_O >= s1 / s3`.
fn largest_ratio(kind: Kind, k: Interval) -> Interval {
    if kind == Kind::K { k.cbrt().square() } else { k }
}

impl Tet {
    /// A tet with corner `free` free; the image of that corner is not read. Nothing if intervals cannot tell the volume from zero.
    pub(in crate::bound) fn of(corners: [Point; 4], image: [Vec3; 4], free: usize) -> Option<Self> {
        let [p, q, r] = TetMesh::FACES[free];
        Self::in_order([p, q, r, free].map(|i| corners[i]), [p, q, r].map(|i| image[i]))
    }

    /// A tet, its free corner last, and the images of the others.
    pub(in crate::bound) fn in_order(corners: [Point; 4], fixed: [Vec3; 3]) -> Option<Self> {
        let [_, g1, g2, g3] = gradients(corners)?;
        let squares = [(0, 1), (1, 2), (2, 0)].map(|(i, j)| {
            norm_squared(difference(&fixed[i], &fixed[j])) / norm_squared(between(corners[i], corners[j]))
        });
        let by = |chosen: fn(f64, f64) -> f64| {
            let ends = |end: fn(&Interval) -> f64| squares.iter().map(end).reduce(chosen).unwrap_or(f64::NAN);
            Interval { lower: ends(|square| square.lower), upper: ends(|square| square.upper) }
        };
        Some(Self {
            gradients: [g1, g2, g3],
            edges: [1, 2].map(|i| difference(&fixed[i], &fixed[0])),
            fixed,
            stretches: [by(f64::min), by(f64::max)],
            distances: [0, 1, 2].map(|i| norm_squared(between(corners[3], corners[i]))),
        })
    }

    /// The centre, which is the image of a fixed vertex, and the radius of the least ball known to hold q where the dilatation is at
    /// most k: q is at most s1 times as far from the image as in the domain, and s1 <= h s3 <= h times the stretch of any fixed edge.
    fn ball(&self, ratio: Interval) -> (Vec3, Interval) {
        let of = |i: usize| (self.fixed[i], ratio * (self.stretches[0] * self.distances[i]).sqrt());
        [of(1), of(2)].into_iter().fold(of(0), |a, b| if b.1.upper < a.1.upper { b } else { a })
    }

    /// det A.
    fn determinant(&self, centre: &Vec3) -> Affine {
        let [e1, e2] = self.edges;
        let [g1, g2, g3] = self.gradients;
        let volume = dot(cross(g1, g2), g3);
        self.linear(cross(e1, e2).map(|entry| entry * volume), Interval::ZERO, centre)
    }

    /// `slope . (q - y0) + constant`.
    fn linear(&self, slope: Vector, constant: Interval, centre: &Vec3) -> Affine {
        Affine { constant: constant + dot(slope, difference(centre, &self.fixed[0])), slope }
    }

    /// `u . A v - a - b d`, or its like: not positive where the dilatation is at most k. Nothing for a tangent that is none.
    fn excess(&self, limit: Limit, kind: Kind, k: Interval, centre: &Vec3) -> Option<Affine> {
        let determinant = self.determinant(centre);
        let [e1, e2] = self.edges;
        let [g1, g2, g3] = self.gradients;
        let (left, right, b) = match limit {
            Limit::Volume => {
                let [_, largest] = self.stretches;
                let least = largest * largest.sqrt() / largest_ratio(kind, k).square();
                let slope = determinant.slope.map(|entry| -entry);
                return Some(Affine { constant: least - determinant.constant, slope });
            }
            Limit::Outer { u, v, b } => {
                let (u, v, b) = (exact_vector(&u), exact_vector(&v), positive(b)?);
                let along = dot(g3, v);
                let left = self.linear(
                    u.map(|entry| entry * along),
                    dot(u, e1) * dot(g1, v) + dot(u, e2) * dot(g2, v),
                    centre,
                );
                let right = (tangent_constant(k, u, v) / b).sqrt();
                (left, right, b)
            }
            Limit::Inner { u, v, b } => {
                let (u, v, b) = (exact_vector(&u), exact_vector(&v), positive(b)?);
                let constant = dot(u, cross(e1, e2)) * dot(cross(g1, g2), v);
                // u . (e2 x r) = r . (u x e2), u . (r x e1) = r . (e1 x u).
                let (second, third) = (dot(cross(g2, g3), v), dot(cross(g3, g1), v));
                let (along_second, along_third) = (cross(u, e2), cross(e1, u));
                let slope = [0, 1, 2].map(|i| along_second[i] * second + along_third[i] * third);
                (self.linear(slope, constant, centre), tangent_constant(k, u, v) / b.square(), b)
            }
        };
        Some(Affine {
            constant: left.constant - right - b * determinant.constant,
            slope: [0, 1, 2].map(|i| left.slope[i] - b * determinant.slope[i]),
        })
    }
}

fn positive(number: f64) -> Option<Interval> {
    (number > 0.0 && number.is_finite()).then_some(Interval::exactly(number))
}

/// `4 k |u|^3 |v|^3 / 27`.
fn tangent_constant(k: Interval, u: Vector, v: Vector) -> Interval {
    let square = norm_squared(u) * norm_squared(v);
    Interval::exactly(4.0) * k * square * square.sqrt() / Interval::exactly(27.0)
}

/// The sum of terms, not positive where every tet's dilatation is at most k; nothing if a term is none.
fn combination(tets: &[Tet], kind: Kind, k: Interval, terms: &[Term], centre: &Vec3) -> Option<Affine> {
    let mut sum = Affine { constant: Interval::ZERO, slope: [Interval::ZERO; 3] };
    for term in terms {
        let allowed = match term.limit {
            Limit::Outer { .. } => kind != Kind::Inner,
            Limit::Inner { .. } => kind != Kind::Outer,
            Limit::Volume => true,
        };
        let weight = Interval::exactly(term.multiplier);
        if !allowed || !term.multiplier.is_finite() || term.multiplier < 0.0 {
            return None;
        }
        let excess = tets[term.tet].excess(term.limit, kind, k, centre)?;
        sum.constant = sum.constant + weight * excess.constant;
        sum.slope = [0, 1, 2].map(|i| sum.slope[i] + weight * excess.slope[i]);
    }
    Some(sum)
}

/// Whether the terms prove that one of the tets, which share their free vertex, has a dilatation of that kind above `level` or no positive
/// determinant, wherever the free vertex goes.
///
/// Their sum is positive in a ball that holds every position with dilatations of at most `level`.
pub(in crate::bound) fn excluded(tets: &[Tet], kind: Kind, level: f64, terms: &[Term]) -> bool {
    let k = Interval::exactly(level);
    let balls = tets.iter().map(|tet| tet.ball(largest_ratio(kind, k)));
    let Some((centre, radius)) = balls.reduce(|a, b| if b.1.upper < a.1.upper { b } else { a }) else { return false };
    let least = combination(tets, kind, k, terms, &centre)
        .map(|sum| sum.constant - norm_squared(sum.slope).sqrt() * radius)
        .map_or(f64::NAN, |least| least.lower);
    least > 0.0
}

/// What terms say of a tet at the edge between its first two fixed corners where K <= k: `M . r + C <= 0` for the position r from the
/// image of the first.
#[derive(Clone, Copy, Debug)]
pub(in crate::bound) struct Confinement {
    /// C.
    pub constant: Interval,
    /// M's component along the edge.
    pub along: Interval,
    /// M's component in the plane of the fixed corners' images across the edge, towards the third, times a positive factor.
    pub across: Interval,
    /// M's component along the normal on which the determinant grows, times the same factor.
    pub normal: Interval,
    /// The radius of a ball that holds r.
    pub radius: Interval,
}

/// What the terms say; nothing if one of them is none.
pub(in crate::bound) fn confinement(tet: &Tet, level: f64, terms: &[Term]) -> Option<Confinement> {
    let k = Interval::exactly(level);
    let radius = largest_ratio(Kind::K, k) * (tet.stretches[0] * tet.distances[0]).sqrt();
    let sum = combination(std::slice::from_ref(tet), Kind::K, k, terms, &tet.fixed[0])?;
    let [edge, side] = tet.edges;
    let length = norm_squared(edge).sqrt();
    let normal = cross(edge, side);
    let [g1, g2, g3] = tet.gradients;
    // det A = normal . r times this.
    let volume = dot(cross(g1, g2), g3);
    let sign = if volume.lower > 0.0 {
        Interval::ONE
    } else if volume.upper < 0.0 {
        -Interval::ONE
    } else {
        return None;
    };
    Some(Confinement {
        constant: sum.constant,
        along: dot(sum.slope, edge) / length,
        // |normal x edge| = |normal| |edge|.
        across: dot(sum.slope, cross(normal, edge)),
        normal: sign * dot(sum.slope, normal) * length,
        radius,
    })
}

/// An end of the range of the dihedral angle between the images of a tet's two faces at an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::bound) enum Extreme {
    /// It is not below this.
    Least(Interval),
    /// It is not above this.
    Most(Interval),
}

/// The end of the range of the angle at the edge between the first two fixed corners that the terms prove where K <= `level`.
///
/// If C is at least the product of M's part along the edge and the radius of the ball, then `N . r <= 0` for the part N of M across the
/// edge: r is on one side of a half-plane at the edge. In the plane across the edge, with f towards the third corner's
/// image and z the normal along which the determinant grows, r has the direction `(cos b, sin b)`, 0 < b < pi, and
/// `N_f cos b + N_z sin b <= 0` says that `b` is not below, if N_f > 0, or not above, if N_f < 0, `pi / 2 + atan(N_z / N_f)`.
pub(in crate::bound) fn extreme_angle(tet: &Tet, level: f64, terms: &[Term]) -> Option<Extreme> {
    let Confinement { constant, along, across, normal, radius } = confinement(tet, level, terms)?;
    let spare = constant - along.abs() * radius;
    let angle = Interval::HALF_PI + (normal / across).atan();
    if spare.lower >= 0.0 && across.lower > 0.0 {
        Some(Extreme::Least(angle))
    } else if spare.lower >= 0.0 && across.upper < 0.0 {
        Some(Extreme::Most(angle))
    } else {
        None
    }
}

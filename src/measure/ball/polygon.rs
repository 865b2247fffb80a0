//! Convex polygons of directions: the directions of a tet's image in one cone, and parts of them.

use std::cmp::Ordering;

use super::cones::{Cap, Cone, beside};
use super::enclosure::{Norms, TetMap};
use crate::linalg::interval::{Interval, dot};
use crate::mesh::{Orientation, Vec3, orientation};

/// How far a direction may lie outside of the polygon that stands for it, relative to its length: far more than the rounding of
/// the corners made by some 60 cuts, each by a few units of the last place.
const ROUNDING: f64 = 1e-12;
/// What cutting leaves on the other side of a plane, relative: more than the rounding of a scalar product, so that nothing on
/// this side is lost.
const CUT: f64 = 1e-14;
/// Below this share of its diameter squared a polygon's area may be rounding, and below this share of its distance from 0 its diameter:
/// nothing is sampled from it. A tet that touches a cone in a vertex overlaps it so by rounding.
const THIN: f64 = 1e-9;

/// The directions in which a tet is seen from 0.
pub(super) struct Shadow {
    corners: [Vec3; 4],
    cap: Cap,
    /// The pairs of corners whose plane with 0 has the others on one side; turned so that it is the left one.
    sides: Vec<[Vec3; 2]>,
    /// Vectors g with g.q >= 0 on the whole tet, near the planes of the sides.
    planes: Vec<Vec3>,
}

impl Shadow {
    /// The shadow of a tet with these corners, one of which may be 0.
    pub fn of(corners: &[Vec3; 4]) -> Self {
        let directions: Vec<Vec3> = corners.iter().copied().filter(|p| *p != Vec3::zeros()).collect();
        let (mut sides, mut planes) = (Vec::new(), Vec::new());
        for i in 0..directions.len() {
            for j in 0..i {
                let side = |[a, b]: [usize; 2]| {
                    let others = (0..directions.len()).filter(|&k| k != i && k != j);
                    let of = |k: usize| triple(&directions[a], &directions[b], &directions[k]);
                    let left = others.clone().all(|k| of(k) != Orientation::Negative);
                    // Two corners on one ray from 0 make no plane: by theirs the tet would miss every cone.
                    (left && others.clone().any(|k| of(k) == Orientation::Positive))
                        .then(|| [directions[a], directions[b]])
                };
                let Some(side) = side([i, j]).or_else(|| side([j, i])) else { continue };
                sides.push(side);
                planes.extend(supporting(&side, corners));
            }
        }
        Self { corners: *corners, cap: Cap::of_tet(corners), sides, planes }
    }

    pub fn cap(&self) -> &Cap {
        &self.cap
    }

    /// Whether tet and cone are proved to have no inner point in common: by the plane of a side of either.
    pub fn misses(&self, cone: &Cone) -> bool {
        let [a, b, c] = &cone.corners;
        let beyond = |(p, q): (&Vec3, &Vec3), points: &[Vec3]| {
            points.iter().all(|point| triple(p, q, point) != Orientation::Positive)
        };
        [(a, b), (b, c), (c, a)].into_iter().any(|side| beyond(side, &self.corners))
            || self.sides.iter().any(|[p, q]| beyond((p, q), &cone.corners))
    }

    /// Whether tet and cone have no inner point in common, vertices near the planes of sides taken to lie on them (`pieces`).
    pub fn nearly_misses(&self, cone: &Cone) -> bool {
        let [a, b, c] = &cone.corners;
        // The rounded normal of others is none.
        let is_wide = |[p, q]: [&Vec3; 2]| p.cross(q).norm() > 1e-6 * p.norm() * q.norm();
        let beyond = |side: [&Vec3; 2], points: &[Vec3]| points.iter().all(|point| beside(side, point) <= 0.0);
        [[a, b], [b, c], [c, a]].into_iter().any(|side| beyond(side, &self.corners))
            || self.sides.iter().any(|[p, q]| is_wide([p, q]) && beyond([p, q], &cone.corners))
    }

    /// The corners of the polygon of directions in a cone; none if there are none.
    pub fn within(&self, cone: &Cone) -> Vec<Vec3> {
        let mut corners = cone.corners.to_vec();
        for plane in &self.planes {
            let room = CUT * plane.norm() * cone.corners.iter().map(|p| p.norm()).fold(0.0, f64::max);
            [corners, _] = cut(&corners, |p| plane.dot(p) + room, |p| *p, |p| p);
        }
        corners
    }

    /// Whether every side has its plane, so that polygons cut by them are the shadow up to rounding.
    fn is_exact(&self) -> bool {
        self.sides.len() == self.planes.len()
    }
}

/// The sign of det(a, b, c), exactly.
fn triple(a: &Vec3, b: &Vec3, c: &Vec3) -> Orientation {
    orientation([&Vec3::zeros(), a, b, c])
}

/// A vector near the normal of a side's plane, turned a little towards the side until the scalar product with each corner, in
/// intervals, is at least 0.
fn supporting([p, q]: &[Vec3; 2], corners: &[Vec3; 4]) -> Option<Vec3> {
    let (normal, middle) = (p.cross(q).normalize(), p.normalize() + q.normalize());
    [1e-15, 1e-13, 1e-11].into_iter().map(|turn| normal + middle * turn).find(|plane| {
        let exact = |p: &Vec3| <[f64; 3]>::from(*p).map(Interval::exactly);
        corners.iter().all(|corner| dot(exact(plane), exact(corner)).lower >= 0.0 || *corner == Vec3::zeros())
    })
}

/// A corner of a polygon.
#[derive(Clone, Copy)]
pub(super) struct Corner {
    /// A direction, as a point of the plane of the cone's triangle.
    direction: Vec3,
    /// The bounds of the map there.
    norms: Norms,
}

/// A convex polygon of directions in one cone.
pub(super) struct Polygon {
    corners: Vec<Corner>,
    /// Whether the corners are directions of the tet in the cone, up to rounding.
    pub is_sampled: bool,
}

impl Polygon {
    /// The directions of a tet in a cone; none if there are none.
    pub fn of(shadow: &Shadow, cone: &Cone, map: &TetMap) -> Option<Self> {
        let corners: Vec<Corner> = shadow.within(cone).iter().map(|direction| corner(map, cone, direction)).collect();
        let is_sampled = shadow.is_exact() && !is_thin(&corners);
        (!corners.is_empty()).then_some(Self { corners, is_sampled })
    }

    /// Upper bound of K in all its directions, of maps whose norms differ from this one's by the part `changed` of them at most.
    pub fn bound(&self, map: &TetMap, cone: &Cone, changed: f64) -> f64 {
        let least = self.corners.iter().map(|c| c.direction.norm_squared()).fold(f64::INFINITY, f64::min);
        // A few units of the last place are covered by the factor.
        let spread = self.farthest().0 * (1.0 + 1e-12) / 3.0;
        let near = least * (1.0 - 1e-12) - spread;
        let bent = if near > 0.0 { spread / near } else { f64::INFINITY };
        // |M(y) - M(y')| <= |y n^T - y' n^T| + 2 |y - y'| / |y|, where n.y = 1 and |y| = 1 / cos gamma <= 1 + sigma.
        let moved = 3.0 * ROUNDING * (1.0 + cone.sigma) + changed * cone.sigma;
        map.largest(self.norms(), bent * (1.0 + 1e-12) + moved)
    }

    /// The largest K at its corners, rounded up.
    pub fn largest_at_corners(&self, map: &TetMap) -> f64 {
        self.corners.iter().map(|corner| map.largest(corner.norms, 0.0)).fold(1.0, f64::max)
    }

    /// Both halves, cut across the line between the two corners farthest apart.
    pub fn halved(&self, map: &TetMap, cone: &Cone) -> [Self; 2] {
        let (_, [p, q]) = self.farthest();
        let (middle, along) = (p + q, q - p);
        let plane = along - middle * (along.dot(&middle) / middle.norm_squared());
        let parts =
            cut(&self.corners, |c| plane.dot(&c.direction), |c| c.direction, |direction| corner(map, cone, &direction));
        parts.map(|corners| Self { is_sampled: self.is_sampled && !is_thin(&corners), corners })
    }

    /// The square of the largest distance of two corners, and these; 0 for a single corner.
    fn farthest(&self) -> (f64, [Vec3; 2]) {
        let points = || self.corners.iter().map(|corner| corner.direction);
        let pairs =
            points().enumerate().flat_map(|(i, p)| points().skip(i).map(move |q| ((p - q).norm_squared(), [p, q])));
        pairs.reduce(|a, b| if b.0 > a.0 { b } else { a }).unwrap_or_default()
    }

    fn norms(&self) -> Norms {
        [0, 1].map(|side| self.corners.iter().map(|corner| corner.norms[side]).fold(0.0, f64::max))
    }
}

fn corner(map: &TetMap, cone: &Cone, direction: &Vec3) -> Corner {
    Corner { direction: *direction, norms: map.at(&cone.normal, direction) }
}

/// Both parts of a convex polygon, where a linear function is not negative and where it is not positive (Sutherland and
/// Hodgman); they share the corners made where it changes its sign.
fn cut<C: Copy>(
    corners: &[C],
    value: impl Fn(&C) -> f64,
    direction: impl Fn(&C) -> Vec3,
    corner: impl Fn(Vec3) -> C,
) -> [Vec<C>; 2] {
    let [mut kept, mut rest] = [(); 2].map(|()| Vec::with_capacity(corners.len() + 1));
    for (index, here) in corners.iter().enumerate() {
        let next = &corners[(index + 1) % corners.len()];
        let (at_here, at_next) = (value(here), value(next));
        if at_here >= 0.0 {
            kept.push(*here);
        }
        if at_here <= 0.0 {
            rest.push(*here);
        }
        if at_here * at_next < 0.0 {
            let made = corner(direction(here).lerp(&direction(next), at_here / (at_here - at_next)));
            kept.push(made);
            rest.push(made);
        }
    }
    [kept, rest]
}

/// Whether the polygon has next to no area, or is next to a point.
fn is_thin(corners: &[Corner]) -> bool {
    let Some((first, others)) = corners.split_first() else { return true };
    let spoke = |corner: &Corner| corner.direction - first.direction;
    let doubled: f64 = others.windows(2).map(|pair| spoke(&pair[0]).cross(&spoke(&pair[1])).norm()).sum();
    let longest = others.iter().map(|corner| spoke(corner).norm_squared()).fold(0.0, f64::max);
    if longest <= THIN * THIN * first.direction.norm_squared() {
        return true;
    }
    // Also where one of the two is NaN.
    matches!(doubled.partial_cmp(&(THIN * longest)), None | Some(Ordering::Less | Ordering::Equal))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tet_with_an_edge_along_a_ray_misses_no_cone_that_it_meets() {
        let corners = [Vec3::x() * 0.5, Vec3::x(), Vec3::new(1.0, 1.0, 0.0), Vec3::new(1.0, 0.0, 1.0)];
        let shadow = Shadow::of(&corners);
        let cone = Cone::over(&[Vec3::x(), Vec3::new(1.0, 2.0, 0.1), Vec3::new(1.0, 0.1, 2.0)]);
        let behind = Cone::over(&[Vec3::x(), Vec3::new(1.0, -2.0, -0.1), Vec3::new(1.0, -0.1, -2.0)]);
        assert!(!shadow.misses(&cone) && shadow.misses(&behind));
        assert!(shadow.within(&cone).len() >= 3);
    }
}

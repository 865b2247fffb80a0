//! The bound of a tet that is warped towards a corner of the solid.
//!
//! With the linear map J of the tet, the point x in it, v the corner, m.(x - v) = t the linear function of the warp and y the image of x, the
//! map onto the ball has the Jacobian, up to a factor,
//!
//! ```text
//! N = M(a) J R(u),   a = y / (n.y),   M(a) = I + a n^T - a a^T / |a|^2,   u = (x - v) / t,   R(u) = I + (p-1) u m^T
//! ```
//!
//! in one cone of the boundary. Over a simplex of points x_i of the tet, a is in the hull of the a_i and u in that of the u_i, u = sum w_i
//! u_i. Let L be the diameter of the a_i, c the least |a| of their hull, D that of the u_i, and l = |n| + 1/c, a Lipschitz
//! constant of M and of its inverse. Weights of sum 1 have sum w_i |a_i - sum w_k a_k|^2 <= L^2 / 3 (Jung), and so
//!
//! ```text
//! |N - sum w_i N(x_i)| <= (L^2 / (3 c^2) + l L k / (2 sqrt 3)) |J R| + l L D' / 3
//! ```
//!
//! The first term is the curvature of M ([`super`]). The second: a is no mean of the a_i with the weights w_i but with
//! w_i r_i / (sum w_k r_k), r_i = n.y_i / t_i; with k = max r / min r - 1 the two are k / 2 L / sqrt 3 apart at most (Cauchy and Schwarz). The third is the
//! product of the changes of M and of R, D' = |p-1| |m| max |J (u_i - u_k)|. The inverse R^-1 J^-1 M^-1 has the same bound, with
//! |R^-1 J^-1| and D' = |1/p - 1| |m J^-1| D. Norms are convex: those of the N(x_i), and this, bound the simplex. It falls fourfold where
//! a simplex is halved all ways. Where a corner of the simplex has no u, the corner of the solid itself, or no a, every M(a_i) is taken with every
//! R(u_k) instead, and the second and third term are not needed.
//!
//! Corners of simplices are known by weights of the tet's corners, which are taken as exact; that halving and cutting rounds them is
//! covered by [`ROUNDING`].
//!
//! # Vertices on the sides of cones
//!
//! A tet that touches a cone from outside in exact positions overlaps it by rounding in others, in a sliver on which K may be large. So
//! that this does not count, a vertex of the image that lies nearer than [`SNAP`] of its distance from 0 to the plane of a side of a cone is
//! taken to lie on it. There is a map whose vertices do, and differ from the given ones by no more: where several such planes meet in a vertex
//! they have a line in common, from 0 to a vertex of the boundary. The bound is that of the two maps: what the difference can do
//! to the tet's matrices is added. Tets that no warp reaches are so bounded where they else were far above what any point has.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::rc::Rc;

use super::cones::{Cone, Cones, SNAP, beside};
use super::enclosure::{ExactWarp, Norms, Pair, TetMap, shears};
use super::polygon::Shadow;
use super::{BallDilatation, Effort, attained, larger, of_tet, product};
use crate::cancel::Cancel;
use crate::linalg::interval::{Interval, exact_vector};
use crate::mesh::{Mat3, Vec3, edge_matrix};

/// Most simplices of one tet: next to the centre or to a corner, one may reach into dozens of cones.
const MOST: usize = 60_000;
/// How far a point may lie outside of the simplices that stand for it, relative, for each unit of cancellation: far more than the rounding
/// of some 40 halvings and cuts.
const ROUNDING: f64 = 1e-12;
/// Below this part of the tet a simplex may be rounding, and nothing is sampled from it.
pub(super) const THIN: f64 = 1e-9;

/// Weights of the corners of a tet, not all 0: a point of it, up to their sum.
pub(super) type Weights = [f64; 4];
/// Four points of a tet.
pub(super) type Simplex = [Weights; 4];

/// The whole tet.
const WHOLE: Simplex = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

/// A warped tet.
pub(super) struct WarpedTet<'a> {
    /// With the determinants of the map and the warp together.
    map: TetMap,
    warp: ExactWarp,
    /// The maps at the corners of the tet, before the radial map.
    at_corners: Vec<TetMap>,
    /// Upper bounds of |J R| and |R^-1 J^-1|.
    largest: Norms,
    /// The [`flatness`] of the tet, times the distance to which its vertices are known.
    uncertainty: f64,
    /// The corners, and the same from the apex; and their images.
    rest: [Vec3; 4],
    offsets: [Vec3; 4],
    image: [Vec3; 4],
    cones: &'a Cones,
}

/// What one corner of a simplex is in one cone.
struct Corner {
    /// M(a) and its inverse, and a; none at 0.
    radial: Option<(Pair, Vec3)>,
    /// R(u) and its inverse, and u; none at the apex.
    warp: Option<(Pair, Vec3)>,
    /// n.y / t.
    ratio: f64,
    /// By how much rounding is amplified.
    cancelled: f64,
    /// The norms of the map; none where it has no M or no R.
    norms: Option<Norms>,
}

/// The corners of a simplex; neighbours share them.
type Corners = [Rc<Corner>; 4];

/// A part of a tet's points in one cone.
struct Piece {
    bound: f64,
    cone: usize,
    simplex: Simplex,
    corners: Corners,
}

impl PartialEq for Piece {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Piece {}

impl PartialOrd for Piece {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Piece {
    fn cmp(&self, other: &Self) -> Ordering {
        self.bound.total_cmp(&other.bound).then(other.cone.cmp(&self.cone))
    }
}

impl<'a> WarpedTet<'a> {
    /// Takes the map of a tet and the warp about `apex`; its vertices, and those of the warp, may be `moved` by so much from those of the map
    /// that is bounded.
    pub fn new([rest, image]: [&[Vec3; 4]; 2], (warp, apex): (ExactWarp, &Vec3), cones: &'a Cones, moved: f64) -> Self {
        let map = TetMap::new(rest, image);
        let corners: Vec<[Interval; 3]> = rest.iter().filter(|corner| *corner != apex).map(exact_vector).collect();
        let at_corners = map.warped(&warp, &corners);
        let largest = [0, 1].map(|side| at_corners.iter().map(|map| map.norms()[side]).fold(0.0, f64::max));
        let offsets = rest.map(|corner| corner - apex);
        let uncertainty = moved * flatness(rest);
        Self {
            map: map.with_exponent(&warp),
            warp,
            at_corners,
            largest,
            uncertainty,
            rest: *rest,
            offsets,
            image: *image,
            cones,
        }
    }

    /// Upper bound of its K, before the radial map.
    pub fn k(&self) -> f64 {
        self.at_corners.iter().map(TetMap::k).fold(1.0, f64::max)
    }

    /// Bounds of K on the tet, of which what lies below `floor` need not be known better, nor than what is known when `cancel` is due, and what
    /// that took.
    pub fn bound(&self, floor: f64, cancel: &Cancel) -> (BallDilatation, Effort) {
        let (most, shadow) = (self.k(), Shadow::of(&self.image));
        let mut search = Search { tet: self, queue: BinaryHeap::new(), sampled: 1.0, effort: Effort::default() };
        if most.is_infinite() {
            return (BallDilatation::between(1.0, f64::INFINITY), search.effort);
        }
        if shadow.cap().is_all() {
            // 0 may lie inside, where no point has a direction.
            let of_maps =
                self.at_corners.iter().map(|map| of_tet(map, &self.image, false, self.cones, (floor, 1e-2), cancel));
            let nothing = (BallDilatation::between(1.0, 1.0), Effort::default());
            let (found, effort) = of_maps.fold(nothing, larger);
            return (BallDilatation { sampled: 1.0, ..found }, effort);
        }
        // Rounded down, so that no product with K is above the floor.
        let mut is_late = false;
        self.cones.for_each_near(shadow.cap(), (floor / most).next_down().next_down(), &mut |index| {
            is_late = is_late || cancel.is_due();
            if is_late {
                return;
            }
            search.effort.cones += 1;
            let cone = self.cones.get(index);
            let rough = product(most, cone.stretch);
            if rough <= floor || shadow.nearly_misses(cone) {
                return;
            }
            let piece = |simplex: Simplex| {
                let corners = simplex.each_ref().map(|weights| Rc::new(self.corner(cone, weights)));
                Piece { bound: rough, cone: index, simplex, corners }
            };
            if search.take(piece(WHOLE), floor, false) {
                return;
            }
            for simplex in within(&self.image, cone) {
                search.take(piece(simplex), floor, true);
            }
        });
        if is_late {
            let certified = product(most, self.cones.largest_stretch_near(shadow.cap()));
            return (BallDilatation { certified, sampled: search.sampled, cut_short: true }, search.effort);
        }
        while let Some(piece) = search.queue.pop() {
            let cut_short = cancel.is_due();
            if search.effort.polygons > MOST || cut_short {
                return (BallDilatation { certified: piece.bound, sampled: search.sampled, cut_short }, search.effort);
            }
            for half in self.halves(&piece) {
                search.take(half, floor, true);
            }
        }
        (BallDilatation::between(search.sampled, 1.0), search.effort)
    }

    fn corner(&self, cone: &Cone, weights: &Weights) -> Corner {
        let sum = |points: &[Vec3; 4]| {
            let exact = |axis: usize| {
                let terms = points.iter().zip(weights);
                terms.map(|(p, w)| Interval::exactly(p[axis]) * Interval::exactly(*w)).sum::<Interval>()
            };
            [0, 1, 2].map(exact)
        };
        let size = |points: &[Vec3; 4]| points.iter().zip(weights).map(|(p, w)| p.norm() * w).sum::<f64>();
        let middle = |vector: &[Interval; 3]| Vec3::from(vector.map(|x| x.middle()));
        let (y, offset) = (sum(&self.image), self.warp.offset(&self.rest, weights));
        let (normal, slope) = (middle(&cone.normal), middle(&self.warp.normal()));
        let (at, from) = (middle(&y), middle(&offset));
        let (distance, height) = (normal.dot(&at), slope.dot(&from));
        let radial = shears(&cone.normal, &y).map(|pair| (pair, at / distance));
        let warp = self.warp.factors(&offset).map(|pair| (pair, from / height));
        let norms = radial.as_ref().zip(warp.as_ref()).map(|((shear, _), (factor, _))| self.map.between(shear, factor));
        let cancelled = [(size(&self.image), at.norm()), (size(&self.offsets), from.norm())];
        let cancelled =
            cancelled.into_iter().map(|(all, left)| all / left).filter(|x| x.is_finite()).fold(1.0, f64::max);
        Corner { radial, warp, ratio: distance / height.abs(), cancelled, norms }
    }

    /// Upper bound of K on a simplex, by the matrices of one cone, and the largest K at its corners, rounded up; 1 where that is not known.
    fn on(&self, Piece { cone, simplex, corners, .. }: &Piece) -> [f64; 2] {
        let cone = self.cones.get(*cone);
        let radial: Vec<&(Pair, Vec3)> = corners.iter().filter_map(|corner| corner.radial.as_ref()).collect();
        let warps: Vec<&(Pair, Vec3)> = corners.iter().filter_map(|corner| corner.warp.as_ref()).collect();
        if radial.is_empty() || warps.is_empty() || !self.only_ends_lack(simplex, corners) {
            return [f64::INFINITY, 1.0];
        }
        let all = radial.len() == 4 && warps.len() == 4;
        let mut norms = [0.0f64; 2];
        let mut take = |found: Norms| (0..2).for_each(|side| norms[side] = norms[side].max(found[side]));
        if all {
            corners.iter().filter_map(|corner| corner.norms).for_each(take);
        } else {
            radial
                .iter()
                .for_each(|(shear, _)| warps.iter().for_each(|(factor, _)| take(self.map.between(shear, factor))));
        }
        // Pairs of different corners are attained nowhere.
        let at_corners = if all { self.map.largest(norms, 0.0) } else { 1.0 };
        let directions: Vec<Vec3> = radial.iter().map(|(_, a)| *a).collect();
        let projections: Vec<Vec3> = warps.iter().map(|(_, u)| *u).collect();
        let [normal, slope] = [cone.normal, self.warp.normal()].map(|v| Vec3::from(v.map(|x| x.middle())));
        let spread = largest_distance(&directions, |d| d.norm());
        let least = directions.iter().map(|a| a.norm_squared()).fold(f64::INFINITY, f64::min) - spread * spread / 3.0;
        if least.is_nan() || least <= 0.0 {
            return [f64::INFINITY, 1.0];
        }
        let steepness = normal.norm() + 1.0 / least.sqrt();
        let (forward, backward) = self.map.middles();
        let power = self.warp.exponent();
        let size = |points: &[Vec3]| points.iter().map(|p| p.norm()).fold(0.0, f64::max);
        let mut excess = [spread * spread / (3.0 * least); 2].map(|curvature| [curvature, 0.0]);
        if all {
            let ratios = corners.each_ref().map(|corner| corner.ratio);
            let [low, high] =
                [ratios.into_iter().fold(f64::INFINITY, f64::min), ratios.into_iter().fold(0.0, f64::max)];
            let apart = steepness * spread * (high / low - 1.0) / (2.0 * 3f64.sqrt());
            let changes = [
                (power - 1.0).abs() * slope.norm() * largest_distance(&projections, |d| (forward * d).norm()),
                (1.0 / power - 1.0).abs()
                    * (backward.transpose() * slope).norm()
                    * largest_distance(&projections, |d| d.norm()),
            ];
            for (terms, change) in excess.iter_mut().zip(changes) {
                terms[0] += apart;
                terms[1] += steepness * spread * change / 3.0;
            }
        }
        // How far M and R change where their arguments do by `ROUNDING`.
        let moved = steepness * size(&directions)
            + (power - 1.0).abs().max((1.0 / power - 1.0).abs()) * slope.norm() * size(&projections);
        let cancelled = corners.iter().map(|corner| corner.cancelled).fold(1.0, f64::max);
        let moved = 4.0 * ROUNDING * cancelled * moved * (1.0 + cone.sigma) * (1.0 + power.max(1.0 / power));
        let moved = moved + moved_by_snapping(&self.image);
        // The same for those of the tet, of which no height is more than those of its cone.
        let of_warp = 1.0 + (power - 1.0).abs().max((1.0 / power - 1.0).abs()) * slope.norm() * size(&projections);
        let moved = moved + 8.0 * self.uncertainty * of_warp;
        // The rounding of the terms themselves, of a few units of the last place times the cancellation, is below the factor.
        let larger = 1.0 + 1e-9 * cancelled;
        let bound = [0, 1].map(|side| {
            let [relative, absolute] = excess[side];
            norms[side] + ((relative * larger + moved) * self.largest[side] + absolute * larger)
        });
        [self.map.largest(bound.map(f64::next_up), 0.0), at_corners]
    }

    /// Whether corners without a direction or a projection are 0 or the apex: others are too near to a plane to be told.
    fn only_ends_lack(&self, simplex: &Simplex, corners: &Corners) -> bool {
        let is = |weights: &Weights, points: &[Vec3; 4]| {
            points.iter().zip(weights).all(|(point, weight)| *weight == 0.0 || *point == Vec3::zeros())
        };
        simplex.iter().zip(corners).all(|(weights, corner)| {
            (corner.radial.is_some() || is(weights, &self.image))
                && (corner.warp.is_some() || is(weights, &self.offsets))
        })
    }

    /// Both halves, cut through the middle of the edge along which M and R change most.
    fn halves(&self, Piece { bound, cone: index, simplex, corners }: &Piece) -> [Piece; 2] {
        let cone = self.cones.get(*index);
        let [normal, slope] =
            [cone.normal, self.warp.normal()].map(|v| v.map(|x| x.middle())).map(|v| Vec3::from(v).norm());
        let power = self.warp.exponent();
        let weight = slope * (power - 1.0).abs().max((1.0 / power - 1.0).abs());
        let far = |a: &Option<(Pair, Vec3)>, b: &Option<(Pair, Vec3)>| match (a, b) {
            (Some((_, a)), Some((_, b))) => (a - b).norm(),
            _ => 0.0,
        };
        // Where every M is taken with every R, both count still: next to 0, were it cut towards 0 first, all directions would be left to
        // every cut.
        let length = |(i, j): (usize, usize)| {
            far(&corners[i].radial, &corners[j].radial) * normal + far(&corners[i].warp, &corners[j].warp) * weight
        };
        let edges = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];
        let (i, j) = edges.into_iter().reduce(|a, b| if length(b) > length(a) { b } else { a }).unwrap_or((0, 1));
        // Halfway between two points, whatever the sums of their weights.
        let [of_i, of_j] = [i, j].map(|k| simplex[k].iter().sum::<f64>());
        let middle = std::array::from_fn(|k| 0.5 * (simplex[i][k] / of_i + simplex[j][k] / of_j));
        let at_middle = Rc::new(self.corner(cone, &middle));
        [i, j].map(|replaced| {
            let (mut simplex, mut corners) = (*simplex, corners.clone());
            (simplex[replaced], corners[replaced]) = (middle, at_middle.clone());
            Piece { bound: *bound, cone: *index, simplex, corners }
        })
    }
}

/// The square of a tet's longest edge over its sixfold volume, 1 / length.
fn flatness(corners: &[Vec3; 4]) -> f64 {
    largest_distance(corners, |edge| edge.norm_squared()) / edge_matrix(*corners).determinant()
}

/// What a move of the vertices of an image to planes near them does to the matrices of its tet: relative to its heights, of which none is less
/// than its volume over the square of its longest edge.
pub(super) fn moved_by_snapping(image: &[Vec3; 4]) -> f64 {
    8.0 * SNAP * image.iter().map(|p| p.norm()).fold(0.0, f64::max) * flatness(image)
}

/// The pieces of a tet that are above the floor.
struct Search<'t> {
    tet: &'t WarpedTet<'t>,
    queue: BinaryHeap<Piece>,
    sampled: f64,
    effort: Effort,
}

impl Search<'_> {
    /// Bounds a piece, which is inside of its cone or not, and queues it if it is and the bound is above the floor; whether it is not.
    fn take(&mut self, piece: Piece, floor: f64, inside: bool) -> bool {
        self.effort.polygons += 1;
        let [bound, at_corners] = self.tet.on(&piece);
        if inside && part(&piece.simplex) > THIN {
            self.sampled = self.sampled.max(attained(at_corners));
        }
        // Rounding aside, it is no larger than that of the whole.
        let piece = Piece { bound: bound.min(piece.bound), ..piece };
        let below = piece.bound <= floor;
        if inside && !below {
            self.queue.push(piece);
        }
        below
    }
}

/// The part of a tet's points in a cone, given by the corners of the image, in simplices.
pub(super) fn within(image: &[Vec3; 4], cone: &Cone) -> Vec<Simplex> {
    let [a, b, c] = &cone.corners;
    let is_flat = |simplex: &Simplex| (0..4).any(|i| simplex[..i].contains(&simplex[i]));
    [(a, b), (b, c), (c, a)].into_iter().fold(vec![WHOLE], |simplices, (p, q)| {
        let values = image.map(|y| beside([p, q], &y));
        simplices.iter().flat_map(|simplex| cut(simplex, &values)).filter(|simplex| !is_flat(simplex)).collect()
    })
}

/// The volume of a simplex, as a part of the tet's.
pub(super) fn part(simplex: &Simplex) -> f64 {
    let normalized = simplex.map(|weights| {
        let sum: f64 = weights.iter().sum();
        weights.map(|w| w / sum)
    });
    let rows: [Vec3; 4] = normalized.map(|w| Vec3::new(w[1], w[2], w[3]));
    Mat3::from_columns(&[rows[1] - rows[0], rows[2] - rows[0], rows[3] - rows[0]]).determinant().abs()
}

/// The part of a simplex where a linear function of the weights, given at the corners of the tet, is not negative.
fn cut(simplex: &Simplex, values: &[f64; 4]) -> Vec<Simplex> {
    let value = |weights: &Weights| weights.iter().zip(values).map(|(w, value)| w * value).sum::<f64>();
    let (kept, lost): (Vec<&Weights>, Vec<&Weights>) = simplex.iter().partition(|weights| value(weights) >= 0.0);
    let between = |inner: &Weights, outer: &Weights| -> Weights {
        let (a, b) = (value(inner), -value(outer));
        std::array::from_fn(|k| (inner[k] * b + outer[k] * a) / (a + b))
    };
    let prism = |[a, b, c]: [Weights; 3], [d, e, f]: [Weights; 3]| vec![[a, b, c, f], [a, b, e, f], [a, d, e, f]];
    match (kept.as_slice(), lost.as_slice()) {
        ([], _) => Vec::new(),
        (&[a], &[b, c, d]) => vec![[*a, between(a, b), between(a, c), between(a, d)]],
        (&[a, b], &[c, d]) => prism([*a, between(a, c), between(a, d)], [*b, between(b, c), between(b, d)]),
        (&[a, b, c], &[d]) => prism([*a, *b, *c], [between(a, d), between(b, d), between(c, d)]),
        _ => vec![*simplex],
    }
}

/// The largest size of the difference of two of some points.
fn largest_distance(points: &[Vec3], size: impl Fn(Vec3) -> f64) -> f64 {
    let pairs = points.iter().enumerate().flat_map(|(i, p)| points[..i].iter().map(move |q| p - q));
    pairs.map(size).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cutting_keeps_the_part_on_one_side() {
        for values in [[1.0, 2.0, 3.0, 4.0], [-1.0, 1.0, 1.0, 1.0], [-1.0, -2.0, 1.0, 3.0], [-1.0, -1.0, -1.0, 1.0]] {
            let parts = cut(&WHOLE, &values);
            let kept: f64 = parts.iter().map(part).sum();
            let lost: f64 = cut(&WHOLE, &values.map(|v| -v)).iter().map(part).sum();
            assert!((kept + lost - 1.0).abs() < 1e-14, "{values:?}: {kept} {lost}");
            for weights in parts.iter().flatten() {
                let value: f64 = weights.iter().zip(values).map(|(w, v)| w * v).sum();
                assert!(value > -1e-15);
            }
        }
        // One corner in four: (1 / (1 + 1))^3 of the tet.
        let corner: f64 = cut(&WHOLE, &[1.0, -1.0, -1.0, -1.0]).iter().map(part).sum();
        assert!((corner - 0.125).abs() < 1e-15);
    }
}

//! K onto the ball: of a map onto an inscribed polyhedron, followed by the radial map of that polyhedron onto the ball.
//!
//! The image of a mesh is a polyhedron Q, whose corners lie on a sphere about 0. Where Q is star-shaped about 0, moving its
//! points along their rays takes it onto the ball. On the cone over a boundary triangle with unit normal n, in the
//! direction u, that map has up to a factor the Jacobian
//!
//! ```text
//! M(u) = I + u v^T,   v = n / (n.u) - u,   |v| = tan gamma,   M(u)^-1 = I - u v^T,   det M(u) = 1
//! ```
//!
//! with gamma the angle between n and u: a shear with the singular values sigma, 1, 1 / sigma, sigma - 1 / sigma = tan gamma.
//! After a linear map J of a tet it has
//!
//! ```text
//! K_O = |M J|^3 / det J        K_I = |J^-1 M^-1|^3 det J        |.| the largest singular value
//! ```
//!
//! whose largest values over all tets and the directions of their images, [`BallDilatation`], are here enclosed. It is the
//! largest K of a quasi-conformal map of the solid onto the ball, so that whatever is proved of *all* such maps speaks of
//! it, however coarse the mesh; K alone, onto the polyhedron, is 1 for a cube inscribed in the ball.
//!
//! # The bound from above
//!
//! Points y of the triangle's plane stand for directions: with n.y = 1, `M = I + y n^T - P` and `M^-1 = I - y n^T + P`,
//! P = y y^T / |y|^2. The second derivative of P along a unit vector has the norm `2 r / |y|^3 <= 2 / |y|^2`, r the distance
//! of the line from 0. A convex polygon with corners y_i of diameter L lies in a disc of radius L / sqrt 3 (Jung), so for a
//! point `y = sum w_i y_i` of it `sum w_i |y_i - y|^2 <= L^2 / 3`; with m the least |y| there, Taylor's theorem says
//!
//! ```text
//! |M(y) - sum w_i M(y_i)| <= e,   e = L^2 / (3 m^2),   m^2 >= min |y_i|^2 - L^2 / 3
//! ```
//!
//! and the same of M^-1. Norms are convex: `|M(y) J| <= max |M(y_i) J| + e |J|`. So the corners bound the polygon, up to an
//! error that falls fourfold when it is halved both ways. Whole tets are passed over by `K <= K(J) sigma^3`.
//!
//! # After a warp of corners
//!
//! The map of a tet is then one of `J (I + (p-1) u n^T)` at each point ([`crate::map::corner`]), affine in u as its inverse is up to a
//! factor; the tets are cut into simplices in single cones, whose corners bound them up to a term of second order ([`pieces`]).
//!
//! All of this is computed in intervals from the positions as exact numbers, but for the corners of polygons: cutting rounds
//! them, by far less than [`polygon`]'s `ROUNDING`, which is added to e.

mod cones;
mod enclosure;
mod pieces;
mod polygon;
mod samples;

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{Measured, measure, measure_elements};
use crate::cancel::Cancel;
use crate::dilatation::null_is_infinite;
use crate::domain::Domain;
use crate::map::Corners;
use crate::mesh::{Orientation, TetId, Vec3, VertexId, View, orientation};
use cones::{Cap, Cone, Cones};
use enclosure::{ExactWarp, TetMap};
use pieces::WarpedTet;
use polygon::{Polygon, Shadow};
pub(crate) use samples::{Factor, OntoBall};

/// The largest K of a map onto the ball, between two numbers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BallDilatation {
    /// Proved: K is nowhere larger. Infinite where a tet is flipped, or too thin for intervals to tell.
    #[serde(deserialize_with = "null_is_infinite")]
    pub certified: f64,
    /// The largest K that was found at a point, at most `certified`; infinite where a tet is flipped.
    #[serde(deserialize_with = "null_is_infinite")]
    pub sampled: f64,
    /// Whether a deadline ended the search: `certified` is proved, but coarser than it would be.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub cut_short: bool,
}

impl BallDilatation {
    /// Two ends, as far apart as the search for them leaves them.
    fn between(sampled: f64, certified: f64) -> Self {
        Self { certified, sampled, cut_short: false }
    }
}

/// Why a map's image is not taken onto the ball by moving its points along their rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotOntoBall {
    /// The boundary positions lie on no sphere about 0.
    #[error("the image is not inscribed in a sphere about 0")]
    NotInscribed,
    /// The boundary image is not star-shaped about 0.
    #[error("the boundary image is not star-shaped about 0")]
    NotStarShaped,
}

/// How near the two ends of a [`BallDilatation`] are brought, relative, and how near where many tets tie: after so many
/// polygons, and so many more a tet, a few seconds of work.
const TOLERANCE: f64 = 1e-4;
/// See [`TOLERANCE`].
const ROUGH: f64 = 1e-2;
/// See [`TOLERANCE`].
const POLYGONS: (usize, usize) = (200_000, 10);
/// The work after which tets are bounded as a whole only, in [`Effort::work`], and so much more a tet. Ordinary meshes take 2 or 3 a tet;
/// but in an image as flat as a sheet a tet meets a share of all cones.
const WORK: (usize, usize) = (400_000, 8);
/// Cones of one tet after which is looked whether the work is due.
const LOOK: usize = 64;
/// Cones that are looked at in the time of one polygon, where they are needles and exact predicates have to tell.
const CONES_A_POLYGON: usize = 2;
/// How near the two ends are brought where there are warps.
const TOLERANCE_WARPED: f64 = 1e-3;
/// How far below the largest K at a corner one may be by rounding, relative, that is looked at in intervals as well.
const TIE: f64 = 1e-9;
/// Most polygons that one tet is given; what is then left of its bound stays.
const MOST_POLYGONS: usize = 4096;
/// Tets that are bounded at once; only between batches the largest K so far is looked at, so that it does not depend on the
/// number of threads.
const BATCH: usize = 256;

/// The largest K of the map of `domain` to `image` followed by the radial map of its image onto the ball.
///
/// Rotating or scaling the image changes nothing but rounding. The time is about that of a few evaluations a tet.
///
/// # Errors
/// The image is not a polyhedron inscribed in a sphere about 0 and star-shaped about 0.
///
/// # Panics
/// If `image` has fewer positions than the domain has vertices.
pub fn ball_dilatation(domain: &Domain, image: &[Vec3]) -> Result<BallDilatation, NotOntoBall> {
    warped_ball_dilatation(domain, None, image)
}

/// The same of the map after the warps of corners of the domain.
///
/// # Errors
/// As [`ball_dilatation`].
///
/// # Panics
/// As [`ball_dilatation`].
pub fn warped_ball_dilatation(
    domain: &Domain,
    corners: Option<&Corners>,
    image: &[Vec3],
) -> Result<BallDilatation, NotOntoBall> {
    let enclosed = enclosed(domain, corners, image, None, &Cancel::default())?;
    Ok(enclosed.expect("nobody cancels it"))
}

/// The same unless it is cancelled from outside, in which case it ends without a result; at a deadline what is left is bounded as a whole.
/// Of the `part` alone, if there is one: all other tets and their images are mirror images of its, but for at most [`SNAP`](cones::SNAP) of their distance.
fn enclosed(
    domain: &Domain,
    corners: Option<&Corners>,
    image: &[Vec3],
    part: Option<&[TetId]>,
    cancel: &Cancel,
) -> Result<Option<BallDilatation>, NotOntoBall> {
    let work = WORK.0 + WORK.1 * domain.mesh().tets().len();
    enclosed_by(domain, corners, image, part, cancel, work)
}

/// The same by so much work; what is then left is bounded as a whole.
fn enclosed_by(
    domain: &Domain,
    corners: Option<&Corners>,
    image: &[Vec3],
    part: Option<&[TetId]>,
    cancel: &Cancel,
    mut work: usize,
) -> Result<Option<BallDilatation>, NotOntoBall> {
    if cancel.is_raised() {
        return Ok(None);
    }
    let onto = OntoBall::new(domain, corners, image)?;
    let tets = domain.mesh().tets();
    let positions = |tet: usize| tets[tet].map(|v| image[v.index()]);
    let is_positive = |tet: usize| {
        let positions = positions(tet);
        positions.iter().all(|p| p.iter().all(|x| x.is_finite()))
            && orientation(positions.each_ref()) == Orientation::Positive
    };
    if !(0..tets.len()).into_par_iter().all(is_positive) {
        return Ok(Some(BallDilatation::between(f64::INFINITY, f64::INFINITY)));
    }
    let rest = |tet: usize| domain.mesh().corners(TetId(tet as u32));
    let map = |tet: usize| TetMap::new(&rest(tet), &positions(tet));
    // How far vertices of the domain are from those of one that is symmetric to the last bit.
    let points = domain.mesh().points();
    let extent = points.iter().map(|p| (p - points[0]).norm()).fold(0.0, f64::max);
    let moved = if part.is_some() { extent * cones::SNAP } else { 0.0 };
    let warped = |tet: usize| {
        let cone = onto.warped_cone(TetId(tet as u32))?;
        let at = |v: VertexId| &domain.mesh().points()[v.index()];
        let warp = ExactWarp::new(at(cone.corner), cone.base.map(at), cone.exponent);
        Some(WarpedTet::new([&rest(tet), &positions(tet)], (warp, at(cone.corner)), &onto.cones, moved))
    };
    // The tets that are looked at.
    let chosen: Vec<usize> =
        part.map_or_else(|| (0..tets.len()).collect(), |part| part.iter().map(|t| t.index()).collect());
    let goes_on = || !cancel.is_raised();
    let cones = &onto.cones;
    // Every direction of a boundary triangle is one of its tet. Of a warped tet points are looked at, since only at these its
    // direction and its own matrix are known together.
    let owners = domain.boundary().owners();
    let linear = |tet: &TetId| onto.warped_cone(*tet).is_none();
    // Where K is largest by plain arithmetic, and what ties with that, is looked at in intervals.
    let corners =
        |index: usize| cones.get(index).corners.map(|corner| (corner, onto.at_corner(owners[index], index, &corner)));
    let at_boundary: Vec<(f64, usize, Vec3)> = (0..owners.len())
        .into_par_iter()
        .filter(|index| linear(&owners[*index]))
        .flat_map_iter(|index| corners(index).map(|(corner, k)| (k, index, corner)))
        .filter(|(k, ..)| k.is_finite())
        .collect();
    let highest = at_boundary.iter().map(|(k, ..)| *k).fold(1.0, f64::max);
    let at_boundary =
        at_boundary.into_par_iter().filter(|(k, ..)| *k >= highest * (1.0 - TIE)).map(|(_, index, corner)| {
            let map = map(owners[index].index());
            attained(map.largest(map.at(&cones.get(index).normal, &corner), 0.0))
        });
    let of_warped = chosen.par_iter().map(|&tet| TetId(tet as u32)).filter(|tet| goes_on() && !linear(tet));
    let of_warped = of_warped.map(|tet| attained(onto.sampled(tet))).reduce(|| 1.0, f64::max);
    let found = BallDilatation::between(at_boundary.reduce(|| 1.0, f64::max).max(of_warped), 1.0);
    // Rounded down, so that no product with K is above what was found.
    let low = (found.sampled / cones.largest_stretch()).next_down().next_down();
    let may_exceed = |tet: usize| !linear(&TetId(tet as u32)) || TetMap::may_exceed(&rest(tet), &positions(tet), low);
    // Each tet as a whole, by the largest K that the radial map has in any cone that it may meet.
    let as_a_whole = |tet: usize| {
        let largest = warped(tet).map_or_else(|| map(tet).k(), |warped| warped.k());
        product(largest, cones.largest_stretch_near(&Cap::of_tet(&positions(tet))))
    };
    // Those of the largest bound first: once theirs are known, most of the others are passed over.
    let mut order: Vec<(f64, usize)> =
        chosen.into_par_iter().filter(|&tet| goes_on() && may_exceed(tet)).map(|tet| (as_a_whole(tet), tet)).collect();
    order.par_sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let of_linear = (0..tets.len() as u32).all(|tet| linear(&TetId(tet)));
    // From what was sampled.
    let first = found;
    let bounded = |snaps: bool, work: &mut usize| {
        let mut found = first;
        let room = if of_linear && !snaps { 1.0 } else { 1.0 + TOLERANCE_WARPED };
        let mut left = POLYGONS.0 + POLYGONS.1 * tets.len();
        for batch in order.chunks(BATCH) {
            let floor = found.certified.max(found.sampled * room);
            if batch[0].0 <= floor {
                break;
            }
            let is_late = cancel.is_due();
            if *work == 0 || is_late {
                found.certified = found.certified.max(batch[0].0);
                found.cut_short |= is_late;
                break;
            }
            let tolerance = if left > 0 { TOLERANCE } else { ROUGH };
            let bounded = batch.par_iter().filter(|(bound, _)| goes_on() && *bound > floor);
            let bounded = bounded.map(|&(_, tet)| match warped(tet) {
                None => of_tet(&map(tet), &positions(tet), snaps, cones, (floor, tolerance), cancel),
                Some(warped) => warped.bound(floor, cancel),
            });
            let (more, effort) = bounded.reduce(|| (found, Effort::default()), larger);
            (found, left) = (more, left.saturating_sub(effort.polygons));
            *work = work.saturating_sub(effort.work());
        }
        if !goes_on() {
            return None;
        }
        // What was passed over is no larger than either.
        Some(BallDilatation { certified: found.certified.max(found.sampled * room), ..found })
    };
    let Some(found) = bounded(false, &mut work) else { return Ok(None) };
    if !(of_linear && found.certified > found.sampled * (1.0 + ROUGH)) {
        return Ok(Some(found));
    }
    // Slivers that are there by rounding alone may have decided.
    let snapped = bounded(true, &mut work);
    Ok(snapped.map(|snapped| BallDilatation {
        certified: snapped.certified.max(found.sampled).min(found.certified),
        ..snapped
    }))
}

/// The same where there is one and it is not cancelled from outside before; of a part, and by a deadline, as in [`measure_warped_onto_ball`].
pub(crate) fn ball_dilatation_until(
    domain: &Domain,
    corners: Option<&Corners>,
    image: &[Vec3],
    chamber: Option<&[TetId]>,
    cancel: &Cancel,
) -> Option<BallDilatation> {
    enclosed(domain, corners, image, chamber, cancel).ok().flatten()
}

/// Measures a map, K onto the ball included where there is one.
///
/// # Panics
/// If `image` has fewer positions than the domain has vertices.
pub fn measure_onto_ball(domain: &Domain, image: &[Vec3]) -> Measured {
    measure_onto_ball_until(domain, image, &Cancel::default())
}

/// The same, without K onto the ball if it is cancelled from outside before that is found; of what a deadline leaves, the upper end is coarse.
///
/// # Panics
/// If `image` has fewer positions than the domain has vertices.
pub fn measure_onto_ball_until(domain: &Domain, image: &[Vec3], cancel: &Cancel) -> Measured {
    let mut measured = measure(domain, image);
    measured.summary.ball_k = ball_dilatation_until(domain, None, image, None, cancel);
    measured
}

/// The same of the map after the warps of corners of the domain, see [`measure_elements`]. Of a map that commutes with mirror planes of the
/// domain, K onto the ball is bounded on the tets `chamber` alone, of which all others and their images are mirror images but for rounding
/// (at most 1e-12 of the size of the domain, of the image): the bound is that of the symmetric map. Cancelled as [`measure_onto_ball_until`].
///
/// # Panics
/// If `image` has fewer positions than the domain has vertices.
pub fn measure_warped_onto_ball(
    domain: &Domain,
    corners: &Corners,
    image: &[Vec3],
    chamber: Option<&[TetId]>,
    cancel: &Cancel,
) -> Measured {
    let mut measured = measure_elements(domain, &corners.elements(domain), image);
    measured.summary.ball_k = ball_dilatation_until(domain, Some(corners), image, chamber, cancel);
    measured
}

/// The share of the ball's volume that the image fills, in (0, 1] up to rounding.
///
/// # Errors
/// As [`ball_dilatation`].
pub fn ball_fraction(domain: &Domain, image: &[Vec3]) -> Result<f64, NotOntoBall> {
    let triangles = onto_ball(domain, image)?;
    let radius = triangles.iter().flatten().map(|p| p.norm()).fold(0.0, f64::max);
    let volume: f64 = triangles.iter().map(|t| t[0].cross(&t[1]).dot(&t[2]) / radius.powi(3)).sum::<f64>() / 6.0;
    Ok(volume / (4.0 / 3.0 * std::f64::consts::PI))
}

/// The boundary triangles of the image, counter-clockwise seen from outside, if radial motion takes them onto a sphere.
fn onto_ball(domain: &Domain, image: &[Vec3]) -> Result<Vec<[Vec3; 3]>, NotOntoBall> {
    let boundary = domain.boundary();
    let radii = || image.iter().zip(boundary.vertex_mask()).filter(|(_, on)| **on).map(|(p, _)| p.norm());
    let least = radii().fold(f64::INFINITY, f64::min);
    // Files may have six digits. False for NaN, which the minimum passes over.
    if !(least > 0.0 && least.is_finite() && radii().all(|radius| radius <= least * (1.0 + 1e-5))) {
        return Err(NotOntoBall::NotInscribed);
    }
    let corners = |triangle: &[VertexId; 3]| triangle.map(|v| image[v.index()]);
    let triangles: Vec<[Vec3; 3]> = boundary.triangles().iter().map(corners).collect();
    match View::from(&Vec3::zeros(), triangles.iter().map(|t| t.each_ref())) {
        View::Covers(1) => Ok(triangles),
        _ => Err(NotOntoBall::NotStarShaped),
    }
}

/// A product of positive numbers, rounded up.
fn product(a: f64, b: f64) -> f64 {
    (a * b).next_up()
}

/// A K computed in intervals, as far below it as rounding may reach; 1 where they know no upper end.
fn attained(k: f64) -> f64 {
    if k.is_finite() { k * (1.0 - 1e-9) } else { 1.0 }
}

/// What bounds take.
#[derive(Clone, Copy, Default)]
struct Effort {
    /// Polygons, or simplices, that were looked into.
    polygons: usize,
    /// Cones that were looked at.
    cones: usize,
}

impl Effort {
    /// The time it takes, in that of a polygon.
    fn work(self) -> usize {
        self.polygons + self.cones / CONES_A_POLYGON
    }
}

/// What holds for two parts together.
fn larger((a, of_a): (BallDilatation, Effort), (b, of_b): (BallDilatation, Effort)) -> (BallDilatation, Effort) {
    let (certified, sampled) = (a.certified.max(b.certified), a.sampled.max(b.sampled));
    let effort = Effort { polygons: of_a.polygons + of_b.polygons, cones: of_a.cones + of_b.cones };
    (BallDilatation { certified, sampled, cut_short: a.cut_short || b.cut_short }, effort)
}

/// The largest K of one tet in the cones that its image meets, and what that took. What lies below `floor` need
/// not be known better, and nothing better than to `tolerance`, or than what is known when `cancel` is due. If it `snaps`, vertices near
/// the sides of cones are taken to lie on them ([`pieces`]).
fn of_tet(
    map: &TetMap,
    corners: &[Vec3; 4],
    snaps: bool,
    cones: &Cones,
    (floor, tolerance): (f64, f64),
    cancel: &Cancel,
) -> (BallDilatation, Effort) {
    let mut effort = Effort::default();
    if map.k().is_infinite() {
        return (BallDilatation::between(1.0, f64::INFINITY), effort);
    }
    let shadow = Shadow::of(corners);
    let moved = if snaps { pieces::moved_by_snapping(corners) } else { 0.0 };
    let mut search = Search { map, moved, queue: BinaryHeap::new(), sampled: 1.0, wanted: floor, tolerance };
    let misses = |cone: &Cone| if snaps { shadow.nearly_misses(cone) } else { shadow.misses(cone) };
    // Rounded down, so that no product with K is above the floor.
    let mut is_late = false;
    cones.for_each_near(shadow.cap(), (floor / map.k()).next_down().next_down(), &mut |index| {
        is_late = is_late || (effort.cones % LOOK == 0 && cancel.is_due());
        if is_late {
            return;
        }
        effort.cones += 1;
        let cone = cones.get(index);
        if product(map.k(), cone.stretch) > floor && !misses(cone) {
            Polygon::of(&shadow, cone, map).into_iter().for_each(|polygon| search.take(polygon, index, cone));
        }
    });
    if is_late {
        let certified = product(map.k(), cones.largest_stretch_near(shadow.cap()));
        return (BallDilatation { certified, sampled: search.sampled, cut_short: true }, effort);
    }
    while let Some(Queued { bound, index, polygon }) = search.queue.pop() {
        effort.polygons += 1;
        if bound <= search.wanted || effort.polygons > MOST_POLYGONS {
            return (BallDilatation::between(search.sampled, bound), effort);
        }
        if cancel.is_due() {
            return (BallDilatation { certified: bound, sampled: search.sampled, cut_short: true }, effort);
        }
        let cone = cones.get(index);
        polygon.halved(map, cone).into_iter().for_each(|half| search.take(half, index, cone));
    }
    (BallDilatation::between(search.sampled, 1.0), effort)
}

/// The polygons of one tet, and how far they are to be halved.
struct Search<'a> {
    map: &'a TetMap,
    /// What a move of its vertices may change of its norms, relative.
    moved: f64,
    queue: BinaryHeap<Queued>,
    /// The largest K found.
    sampled: f64,
    /// The bound that is near enough.
    wanted: f64,
    tolerance: f64,
}

impl Search<'_> {
    fn take(&mut self, polygon: Polygon, index: usize, cone: &Cone) {
        let at_corners = polygon.largest_at_corners(self.map);
        if polygon.is_sampled {
            // The corners are rounded.
            self.sampled = self.sampled.max(attained(at_corners));
        }
        // The bound comes no lower than what the corners have, whether the tet reaches them or not.
        self.wanted = self.wanted.max(at_corners * (1.0 + self.tolerance));
        self.queue.push(Queued { bound: polygon.bound(self.map, cone, self.moved), index, polygon });
    }
}

/// A polygon in the cone of that index; that of the largest bound first, equals in a fixed order.
struct Queued {
    bound: f64,
    index: usize,
    polygon: Polygon,
}

impl PartialEq for Queued {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Queued {}

impl PartialOrd for Queued {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Queued {
    fn cmp(&self, other: &Self) -> Ordering {
        self.bound.total_cmp(&other.bound)
    }
}

#[cfg(test)]
mod tests;

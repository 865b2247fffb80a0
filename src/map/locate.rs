//! In which tet of a mesh a point lies.

use bvh::aabb::{Aabb, Bounded};
use bvh::bounding_hierarchy::BHShape;
use bvh::bvh::Bvh;
use nalgebra::Point3;

use crate::mesh::{Orientation, TetId, TetMesh, Vec3, VertexId, orientation};

/// A point outside of every tet by at most this times the size of the mesh counts as one of the boundary: the points that
/// other programs put on a boundary are off it by their own rounding.
const SLACK: f64 = 1e-12;
/// The same in units in the last place of the largest coordinate, for solids that are small beside their distance from 0: the weighted mean of four
/// corners that the inverse gives is off by up to four of them in each coordinate, and the power at a corner stretches that by its exponent.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// Tets of positive volume in a hierarchy of boxes, for many questions.
pub(super) struct Locator {
    tets: Vec<Tet>,
    hierarchy: Bvh<f64, 3>,
    /// The largest distance outside at which a point is still found.
    slack: f64,
}

/// A tet that holds a point and the point's barycentric coordinates in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    pub tet: TetId,
    pub weights: [f64; 4],
}

impl Locator {
    /// Of tets that are positively oriented at `points`.
    pub fn new(points: &[Vec3], tets: &[[VertexId; 4]]) -> Self {
        let extent = |axis: usize| {
            let values = points.iter().map(|point| point[axis]);
            let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
            high - low
        };
        let farthest = points.iter().map(|point| point.amax()).fold(0.0, f64::max);
        let slack = SLACK * (0..3).map(extent).fold(0.0, f64::max) + ROUNDING * farthest;
        let tet = |(index, tet): (u32, &[VertexId; 4])| {
            let corners = tet.map(|v| points[v.index()]);
            Tet { index, corners, slack, node: 0 }
        };
        let mut tets: Vec<Tet> = (0..).zip(tets).map(tet).collect();
        let hierarchy = Bvh::build(&mut tets);
        Self { tets, hierarchy, slack }
    }

    /// The tet of the lowest number that holds the point, decided exactly; for a point that none holds the nearest one, if
    /// it is near enough. None for a point that is not finite.
    pub fn find(&self, point: &Vec3) -> Option<Place> {
        if !point.iter().all(|x| x.is_finite()) {
            return None;
        }
        let mut inside: Option<u32> = None;
        let mut beside: Option<(f64, u32)> = None;
        // Not the crate's iterator, whose stack ends at 32 levels: graded meshes make deep trees.
        for tet in self.hierarchy.traverse(&Point3::from(*point), &self.tets) {
            let index = tet.index;
            if inside.is_some_and(|best| best < index) {
                continue;
            }
            if tet.holds(point) {
                inside = Some(index);
            } else if inside.is_none() {
                let distance = tet.distance(point);
                if distance <= self.slack && beside.is_none_or(|best| (distance, index) < best) {
                    beside = Some((distance, index));
                }
            }
        }
        let index = inside.or(beside.map(|(_, index)| index))?;
        // Outside, rounding decides: the power at a corner would make much of its direction.
        let parts =
            self.tets[index as usize].parts(point).map(|part| if inside.is_none() { part.max(0.0) } else { part });
        let whole: f64 = parts.iter().sum();
        Some(Place { tet: TetId(index), weights: parts.map(|part| part / whole) })
    }
}

struct Tet {
    index: u32,
    corners: [Vec3; 4],
    /// By how much its box is wider.
    slack: f64,
    node: usize,
}

impl Tet {
    /// The tet with the point in the place of corner `i`, for each `i`.
    fn replaced(&self, point: &Vec3) -> [[Vec3; 4]; 4] {
        std::array::from_fn(|i| {
            let mut corners = self.corners;
            corners[i] = *point;
            corners
        })
    }

    fn holds(&self, point: &Vec3) -> bool {
        self.replaced(point).iter().all(|corners| orientation(corners.each_ref()) != Orientation::Negative)
    }

    /// Six times the volumes of the four tets between the point and the faces; exactly 0 where the point is a face's vertex.
    fn parts(&self, point: &Vec3) -> [f64; 4] {
        let [a, b, c, d] = self.corners.map(|corner| corner - point);
        let volume = |u: Vec3, v: Vec3, w: Vec3| u.dot(&v.cross(&w));
        [volume(b, c, d), -volume(a, c, d), volume(a, b, d), -volume(a, b, c)]
    }

    /// How far the point lies outside of the plane of a face, at most over the faces.
    fn distance(&self, point: &Vec3) -> f64 {
        let parts = self.parts(point);
        let outside = |face: usize| {
            let [i, j, k] = TetMesh::FACES[face].map(|corner| self.corners[corner]);
            let twice_the_area = (j - i).cross(&(k - i)).norm();
            if parts[face] < 0.0 { -parts[face] / twice_the_area } else { 0.0 }
        };
        (0..4).map(outside).fold(0.0, f64::max)
    }
}

impl Bounded<f64, 3> for Tet {
    fn aabb(&self) -> Aabb<f64, 3> {
        let [a, b, c, d] = self.corners;
        let slack = Vec3::from_element(self.slack);
        Aabb::with_bounds((a.inf(&b).inf(&c).inf(&d) - slack).into(), (a.sup(&b).sup(&c).sup(&d) + slack).into())
    }
}

impl BHShape<f64, 3> for Tet {
    fn set_bh_node_index(&mut self, index: usize) {
        self.node = index;
    }

    fn bh_node_index(&self) -> usize {
        self.node
    }
}

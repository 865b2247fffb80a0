//! The cones over the boundary triangles of an image, and which of them lie in a given part of the directions.

use super::enclosure::stretch;
use crate::linalg::interval::{Interval, cross};
use crate::mesh::Vec3;

/// More than the rounding of any angle here, in radians.
const ANGLE: f64 = 1e-12;
/// How near a vertex is to a plane through 0 that it is taken to lie on, relative to its distance from 0.
pub(super) const SNAP: f64 = 1e-12;
/// Cones in a leaf of the tree.
const LEAF: usize = 4;

/// The cone over one triangle, seen from 0.
pub(super) struct Cone {
    /// The triangle's corners, counter-clockwise from outside.
    pub corners: [Vec3; 3],
    /// A normal of its plane, of any length, away from 0.
    pub normal: [Interval; 3],
    /// Upper bound of sigma, the largest singular value of the radial map there: tan gamma is convex on the triangle.
    pub sigma: f64,
    /// Its cube, which is K of the radial map, rounded up.
    pub stretch: f64,
}

impl Cone {
    /// The cone over a triangle.
    pub fn over(corners: &[Vec3; 3]) -> Self {
        let [a, b, c] = corners.map(|p| <[f64; 3]>::from(p).map(Interval::exactly));
        let minus = |p: [Interval; 3]| [0, 1, 2].map(|i| p[i] - a[i]);
        let mut cone = Self { corners: *corners, normal: cross(minus(b), minus(c)), sigma: 1.0, stretch: 1.0 };
        cone.sigma = corners.iter().map(|corner| stretch(&cone.normal, corner)).fold(1.0, f64::max);
        cone.stretch = (cone.sigma * (cone.sigma * cone.sigma).next_up()).next_up();
        cone
    }
}

/// The directions within an angle from one of them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cap {
    /// A unit vector.
    centre: Vec3,
    /// In radians; pi for all directions.
    radius: f64,
}

impl Cap {
    const ALL: Self = Self { centre: Vec3::new(0.0, 0.0, 1.0), radius: std::f64::consts::PI };

    /// A cap around directions and all their convex combinations.
    pub fn around(directions: &[Vec3]) -> Self {
        let points: Vec<Self> =
            directions.iter().map(|direction| Self { centre: direction.normalize(), radius: 0.0 }).collect();
        let cap = Self::of(&points);
        // Only caps of less than a right angle are convex. False for NaN, of a direction 0.
        if cap.radius < 1.57 { cap } else { Self::ALL }
    }

    /// A cap around the directions in which a tet is seen from 0, which may be one of its corners.
    pub fn of_tet(corners: &[Vec3; 4]) -> Self {
        let directions: Vec<Vec3> = corners.iter().copied().filter(|p| *p != Vec3::zeros()).collect();
        Self::around(&directions)
    }

    /// A cap around caps.
    fn of(caps: &[Self]) -> Self {
        let sum: Vec3 = caps.iter().map(|cap| cap.centre).sum();
        let centre = sum.normalize();
        let radius = caps.iter().map(|cap| angle(&centre, &cap.centre) + cap.radius).fold(0.0, f64::max) + ANGLE;
        if centre.iter().all(|x| x.is_finite()) && radius < Self::ALL.radius {
            Self { centre, radius }
        } else {
            Self::ALL
        }
    }

    /// Whether it holds all directions.
    pub fn is_all(&self) -> bool {
        self.radius >= Self::ALL.radius
    }

    fn meets(&self, other: &Self) -> bool {
        angle(&self.centre, &other.centre) <= self.radius + other.radius + ANGLE
    }
}

/// det(p, q, y), up to rounding; 0 where y is taken to lie on the plane of 0, p and q.
pub(super) fn beside([p, q]: [&Vec3; 2], y: &Vec3) -> f64 {
    let normal = p.cross(q);
    let value = normal.dot(y);
    if value.abs() <= SNAP * normal.norm() * y.norm() { 0.0 } else { value }
}

fn angle(a: &Vec3, b: &Vec3) -> f64 {
    a.cross(b).norm().atan2(a.dot(b))
}

/// All cones, in a tree of caps.
pub(super) struct Cones {
    cones: Vec<Cone>,
    /// The cones in the order of the leaves.
    order: Vec<usize>,
    /// In preorder: the first child of a node follows it.
    nodes: Vec<Node>,
}

struct Node {
    cap: Cap,
    /// The largest stretch below it.
    stretch: f64,
    /// The node after all that are below this one.
    next: usize,
    /// The cones of a leaf, in `order`; none of other nodes.
    leaf: std::ops::Range<usize>,
}

impl Cones {
    /// The cones over triangles.
    pub fn new(triangles: &[[Vec3; 3]]) -> Self {
        let cones: Vec<Cone> = triangles.iter().map(Cone::over).collect();
        let caps: Vec<Cap> = triangles.iter().map(|corners| Cap::around(corners)).collect();
        let mut all = Self { cones, order: (0..triangles.len()).collect(), nodes: Vec::new() };
        all.build(0, triangles.len(), &caps);
        all
    }

    /// Adds the nodes of a part of `order`, halved along the coordinate in which its caps spread most.
    fn build(&mut self, start: usize, end: usize, caps: &[Cap]) -> Cap {
        let at = self.nodes.len();
        let part = &mut self.order[start..end];
        let stretch = part.iter().map(|&index| self.cones[index].stretch).fold(1.0, f64::max);
        self.nodes.push(Node { cap: Cap::ALL, stretch, next: 0, leaf: start..start });
        let cap = if part.len() <= LEAF {
            self.nodes[at].leaf = start..end;
            Cap::of(&part.iter().map(|&index| caps[index]).collect::<Vec<_>>())
        } else {
            let extreme = |pick: fn(&Vec3, &Vec3) -> Vec3| {
                part.iter().map(|&index| caps[index].centre).reduce(|a, b| pick(&a, &b)).unwrap_or_default()
            };
            let axis = (extreme(|a, b| a.sup(b)) - extreme(|a, b| a.inf(b))).imax();
            let key = |index: usize| caps[index].centre[axis];
            part.sort_unstable_by(|&a, &b| key(a).total_cmp(&key(b)).then(a.cmp(&b)));
            let middle = start.midpoint(end);
            let halves = [self.build(start, middle, caps), self.build(middle, end, caps)];
            Cap::of(&halves)
        };
        self.nodes[at].cap = cap;
        self.nodes[at].next = self.nodes.len();
        cap
    }

    pub fn get(&self, index: usize) -> &Cone {
        &self.cones[index]
    }

    /// The largest K of the radial map, rounded up.
    pub fn largest_stretch(&self) -> f64 {
        self.nodes.first().map_or(1.0, |root| root.stretch)
    }

    /// A bound of K of the radial map in the directions of a cap: the largest of all cones in a leaf of the tree that meets it.
    pub fn largest_stretch_near(&self, cap: &Cap) -> f64 {
        let (mut at, mut most) = (0, 1.0f64);
        while let Some(node) = self.nodes.get(at) {
            if node.stretch <= most || !node.cap.meets(cap) {
                at = node.next;
                continue;
            }
            if !node.leaf.is_empty() {
                most = node.stretch;
            }
            at += 1;
        }
        most
    }

    /// Visits, in a fixed order, at least all cones of more than that stretch with a direction in the cap.
    pub fn for_each_near(&self, cap: &Cap, stretch: f64, visit: &mut impl FnMut(usize)) {
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            if node.stretch <= stretch || !node.cap.meets(cap) {
                at = node.next;
                continue;
            }
            self.order[node.leaf.clone()].iter().for_each(|&index| visit(index));
            at += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solid::Solid;

    #[test]
    fn every_cone_is_near_its_own_directions_and_few_others_are() {
        let surface = Solid::Icosahedron.surface().unwrap();
        let mut triangles: Vec<[Vec3; 3]> = surface.ids().map(|id| surface.corners(id)).collect();
        for _ in 0..4 {
            let quarters = |[a, b, c]: [Vec3; 3]| {
                let [x, y, z] = [(a + b).normalize(), (b + c).normalize(), (c + a).normalize()];
                [[a, x, z], [x, b, y], [z, y, c], [x, y, z]]
            };
            triangles = triangles.into_iter().flat_map(|triangle| quarters(triangle.map(|p| p.normalize()))).collect();
        }
        let cones = Cones::new(&triangles);
        for (index, triangle) in triangles.iter().enumerate() {
            let mut near = Vec::new();
            cones.for_each_near(&Cap::around(&[triangle.iter().sum::<Vec3>()]), 0.0, &mut |cone| near.push(cone));
            assert!(near.contains(&index) && near.len() < 32, "{near:?}");
        }
        let mut all = Vec::new();
        cones.for_each_near(&Cap::around(&[Vec3::x(), -Vec3::x()]), 0.0, &mut |cone| all.push(cone));
        all.sort_unstable();
        assert!(all.into_iter().eq(0..triangles.len()));
        let most = cones.largest_stretch();
        for direction in [Vec3::x(), Vec3::new(0.3, -0.5, 0.8)] {
            let (cap, mut near) = (Cap::around(&[direction]), 1.0f64);
            cones.for_each_near(&cap, 0.0, &mut |cone| near = near.max(cones.get(cone).stretch));
            assert_eq!(cones.largest_stretch_near(&cap), near);
        }
        assert_eq!(cones.largest_stretch_near(&Cap::ALL), most);
        cones.for_each_near(&Cap::ALL, most, &mut |_| panic!("none is stretched more than the most"));
    }
}

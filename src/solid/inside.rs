//! Whether a point lies in the solid that a surface bounds: by the parity of a ray's crossings, decided exactly.

use bvh::aabb::{Aabb, Bounded, IntersectsAabb};
use bvh::bounding_hierarchy::BHShape;
use bvh::bvh::Bvh;

use super::Surface;
use crate::mesh::{Orientation, TriangleId, Vec3, orientation};

/// Where a point lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// In the open solid.
    Inside,
    /// On one of the triangles, exactly.
    Surface,
    /// Elsewhere.
    Outside,
}

/// The triangles of a surface in a hierarchy of boxes, for many questions.
pub struct InsideTest {
    triangles: Vec<Triangle>,
    hierarchy: Bvh<f64, 3>,
}

impl InsideTest {
    /// Builds the hierarchy.
    pub fn new(surface: &Surface) -> Self {
        let triangle = |id: TriangleId| Triangle { corners: surface.corners(id), node: 0 };
        let mut triangles: Vec<Triangle> = surface.ids().map(triangle).collect();
        let hierarchy = Bvh::build(&mut triangles);
        Self { triangles, hierarchy }
    }

    /// Where a point of finite coordinates lies.
    ///
    /// The ray runs in the direction +z. It is thought of as shifted by an infinitely small amount in x and a still smaller one
    /// in y, so that it meets no vertex and no edge, and every sign is that of an exact predicate: the parity is right for
    /// every closed surface, without a threshold. (The paper counts crossings closer than a threshold once.)
    pub fn side(&self, point: &Vec3) -> Side {
        let ray = Upward(*point);
        let mut crossings = 0;
        for triangle in self.hierarchy.traverse_iterator(&ray, &self.triangles) {
            let place = triangle.place(point);
            if place == Orientation::Flat && triangle.holds(point) {
                return Side::Surface;
            }
            crossings += usize::from(triangle.is_crossed(point, place));
        }
        if crossings % 2 == 1 { Side::Inside } else { Side::Outside }
    }
}

struct Triangle {
    corners: [Vec3; 3],
    node: usize,
}

impl Triangle {
    /// On which side of the triangle's plane a point lies.
    fn place(&self, point: &Vec3) -> Orientation {
        let [a, b, c] = &self.corners;
        orientation([a, b, c, point])
    }

    /// Whether a point of the triangle's plane lies in the closed triangle.
    fn holds(&self, point: &Vec3) -> bool {
        let [a, b, c] = &self.corners;
        let normal = (b - a).cross(&(c - a));
        // Looked at along the axis nearest to the normal, the triangle is not degenerate.
        let (x, y) = [(1, 2), (2, 0), (0, 1)][normal.iamax()];
        let signs = [(a, b), (b, c), (c, a)].map(|(from, to)| turn([x, y], from, to, point));
        signs.iter().all(|&sign| sign >= 0.0) || signs.iter().all(|&sign| sign <= 0.0)
    }

    /// Whether the shifted ray upward from the point, which is no point of the triangle, crosses it.
    fn is_crossed(&self, point: &Vec3, place: Orientation) -> bool {
        let [a, b, c] = &self.corners;
        let signs = [(a, b), (b, c), (c, a)].map(|(from, to)| shifted_turn(from, to, point));
        // Counter-clockwise seen from above, a triangle that lies above the point has it on the side away from its normal.
        match place {
            _ if signs.iter().all(|&sign| sign > 0.0) => place == Orientation::Negative,
            _ if signs.iter().all(|&sign| sign < 0.0) => place == Orientation::Positive,
            _ => false,
        }
    }
}

/// Twice the signed area of the triangle (from, to, point) seen along an axis, of which the sign is exact.
fn turn([x, y]: [usize; 2], from: &Vec3, to: &Vec3, point: &Vec3) -> f64 {
    let coord = |p: &Vec3| robust::Coord { x: p[x], y: p[y] };
    robust::orient2d(coord(from), coord(to), coord(point))
}

/// The sign of [`turn`] seen from above, for the point shifted in x, and less in y; 0 for an edge parallel to z only.
fn shifted_turn(from: &Vec3, to: &Vec3, point: &Vec3) -> f64 {
    let sign = turn([0, 1], from, to, point);
    let edge = to - from;
    // The derivatives of the area in the point's x and y.
    [sign, -edge.y, edge.x].into_iter().find(|&term| term != 0.0).unwrap_or(0.0)
}

impl Bounded<f64, 3> for Triangle {
    fn aabb(&self) -> Aabb<f64, 3> {
        let [a, b, c] = self.corners;
        Aabb::with_bounds(a.inf(&b).inf(&c).into(), a.sup(&b).sup(&c).into())
    }
}

impl BHShape<f64, 3> for Triangle {
    fn set_bh_node_index(&mut self, index: usize) {
        self.node = index;
    }

    fn bh_node_index(&self) -> usize {
        self.node
    }
}

/// The ray from a point in the direction +z. The crate's own ray misses boxes in the plane of whose faces it runs.
struct Upward(Vec3);

impl IntersectsAabb<f64, 3> for Upward {
    fn intersects_aabb(&self, bounds: &Aabb<f64, 3>) -> bool {
        let (low, high) = (bounds.min, bounds.max);
        low.x <= self.0.x && self.0.x <= high.x && low.y <= self.0.y && self.0.y <= high.y && self.0.z <= high.z
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;
    use std::path::Path;

    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{RngCore, SeedableRng};
    use rayon::prelude::*;

    use super::*;
    use crate::mesh::io::read_surface;
    use crate::solid::Solid;

    fn surfaces() -> Vec<Surface> {
        let solids = [
            Solid::Tetrahedron,
            Solid::Cube,
            Solid::Octahedron,
            Solid::Dodecahedron,
            Solid::Icosahedron,
            Solid::Prism { sides: 5, height: 0.7 },
            Solid::Pyramid { sides: 4, height: 1.3 },
            Solid::Bipyramid { sides: 5, height: 0.8 },
            Solid::Box { size: [1.0, 2.0, 3.0] },
            Solid::Ball { radius: 1.0, resolution: 4 },
            Solid::Ellipsoid { radii: [1.0, 2.0, 3.0], resolution: 4 },
            Solid::Torus { major_radius: 1.0, minor_radius: 0.4, resolution: 8 },
            Solid::SmoothStar { seed: 3, degree: 4, amplitude: 0.5, resolution: 4 },
            Solid::PolyhedralStar { seed: 5, amplitude: 0.6, resolution: 3 },
        ];
        let gem = read_surface(&Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/solids/gem.obj")).unwrap();
        let gem = Surface::from_soup(gem).unwrap();
        solids.iter().map(|solid| solid.surface().unwrap()).chain([gem]).collect()
    }

    /// How often the surface winds around a point: the sum of signed solid angles (van Oosterom and Strackee 1983) over 4 pi.
    fn winding_number(surface: &Surface, point: &Vec3) -> f64 {
        let angle = |id| {
            let [a, b, c] = surface.corners(id).map(|corner| corner - point);
            let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
            let below = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
            2.0 * a.dot(&b.cross(&c)).atan2(below)
        };
        surface.ids().map(angle).sum::<f64>() / (4.0 * PI)
    }

    #[test]
    fn parity_is_the_winding_number_at_random_points() {
        compare_with_winding_number(5_000);
    }

    #[test]
    #[ignore = "takes 15 s on a busy core"]
    fn parity_is_the_winding_number_at_many_random_points() {
        compare_with_winding_number(100_000);
    }

    fn compare_with_winding_number(count: usize) {
        for surface in surfaces() {
            let test = InsideTest::new(&surface);
            let (low, high) = surface.bounding_box();
            let (centre, half) = (0.5 * (low + high), 0.55 * (high - low));
            let mut random = ChaCha8Rng::seed_from_u64(11);
            let mut next = || (random.next_u64() >> 11) as f64 * 2f64.powi(-52) - 1.0;
            let points: Vec<Vec3> =
                (0..count).map(|_| centre + half.component_mul(&Vec3::new(next(), next(), next()))).collect();
            points.par_iter().for_each(|point| {
                let winding = winding_number(&surface, point);
                let expected = if winding.round() == 0.0 { Side::Outside } else { Side::Inside };
                assert!((winding - winding.round()).abs() < 1e-6, "{winding}");
                assert_eq!(test.side(point), expected, "{point:?}");
            });
        }
    }

    #[test]
    fn rays_through_vertices_and_edges_count_right() {
        // Points straight below and above each vertex and each middle of an edge.
        for surface in surfaces() {
            let test = InsideTest::new(&surface);
            let middles = surface.edges().iter().map(|edge| {
                let [a, b] = edge.vertices.map(|v| surface.points()[v.index()]);
                0.5 * (a + b)
            });
            let (low, high) = surface.bounding_box();
            let mut judged = 0;
            for target in surface.points().iter().copied().chain(middles) {
                for step in 1..5 {
                    let z = low.z - 0.1 + (high.z - low.z + 0.2) * (f64::from(step) / 5.0 + 1e-3);
                    let point = Vec3::new(target.x, target.y, z);
                    // On the surface, and in rounding's reach of it, the winding number says nothing: there its neighbours differ.
                    let near = |i: i32| point + 1e-9 * f64::from(i / 3 * 2 - 1) * Vec3::ith((i % 3) as usize, 1.0);
                    let windings: Vec<f64> = (0..6).map(|i| winding_number(&surface, &near(i))).collect();
                    // A neighbour on a face has a half, one on an edge another fraction.
                    let whole = windings[0].round();
                    if windings.iter().all(|&winding| (winding - whole).abs() < 1e-6) {
                        let expected = if whole == 0.0 { Side::Outside } else { Side::Inside };
                        assert_eq!(test.side(&point), expected, "{point:?} {windings:?}");
                        judged += 1;
                    }
                }
            }
            assert!(judged > surface.points().len(), "{judged}");
        }
    }

    #[test]
    fn points_of_the_surface_are_told_from_others() {
        for surface in surfaces() {
            let test = InsideTest::new(&surface);
            assert!(surface.points().iter().all(|vertex| test.side(vertex) == Side::Surface));
        }
        let cube = InsideTest::new(&Solid::Cube.surface().unwrap());
        for (point, side) in [
            ([1.0, 0.3, -0.2], Side::Surface),
            ([1.0f64.next_down(), 0.3, -0.2], Side::Inside),
            ([1.0f64.next_up(), 0.3, -0.2], Side::Outside),
            ([0.0, 0.0, -1.0], Side::Surface),
            ([0.0, 0.0, (-1.0f64).next_up()], Side::Inside),
            ([0.0, 0.0, (-1.0f64).next_down()], Side::Outside),
            ([1.0, 1.0, 0.1], Side::Surface),
            ([1.0, 1.0, -3.0], Side::Outside),
        ] {
            assert_eq!(cube.side(&point.into()), side, "{point:?}");
        }
    }
}

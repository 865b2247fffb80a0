//! Refining a triangle surface by splits that lie on it.

use std::collections::{BinaryHeap, HashMap, VecDeque};

use crate::mesh::Vec3;
use crate::solid::Surface;

/// Triangles as point numbers, counter-clockwise seen from outside, of a closed surface.
pub(super) struct Triangles {
    pub points: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
}

/// Splits every triangle into `n^2` similar ones; points on an edge are shared by its two triangles. What is there is given back
/// once it is not wanted any more.
pub(super) fn subdivide(surface: &Surface, n: u32, wanted: impl Fn() -> bool) -> Triangles {
    let mut points = surface.points().to_vec();
    let mut on_edge: HashMap<(u32, u32, u32), u32> = HashMap::new();
    let mut triangles = Vec::with_capacity(surface.triangles().len() * (n * n) as usize);
    for triangle in surface.triangles().iter().take_while(|_| wanted()) {
        let [a, b, c] = triangle.map(|v| v.0);
        let corners = [a, b, c].map(|v| surface.points()[v as usize]);
        // Lattice point (i, j): i steps from a towards b, j towards c.
        let mut lattice = HashMap::new();
        for i in (0..=n).take_while(|_| wanted()) {
            for j in 0..=n - i {
                let k = n - i - j;
                let mut edge_point = |low: u32, high: u32, steps: u32| {
                    // Counted from the smaller end, so that both triangles name and compute the point alike.
                    let (low, high, steps) = if low < high { (low, high, steps) } else { (high, low, n - steps) };
                    *on_edge.entry((low, high, steps)).or_insert_with(|| {
                        let t = f64::from(steps) / f64::from(n);
                        let (p, q) = (surface.points()[low as usize], surface.points()[high as usize]);
                        points.push(p * (1.0 - t) + q * t);
                        points.len() as u32 - 1
                    })
                };
                let index = match (i, j, k) {
                    (0, 0, _) => a,
                    (_, 0, 0) => b,
                    (0, _, 0) => c,
                    (i, 0, _) => edge_point(a, b, i),
                    (0, j, _) => edge_point(a, c, j),
                    (_, j, 0) => edge_point(b, c, j),
                    (i, j, k) => {
                        let sum = corners[0] * f64::from(k) + corners[1] * f64::from(i) + corners[2] * f64::from(j);
                        points.push(sum / f64::from(n));
                        points.len() as u32 - 1
                    }
                };
                lattice.insert((i, j), index);
            }
        }
        for i in (0..n).take_while(|_| wanted()) {
            for j in 0..n - i {
                triangles.push([lattice[&(i, j)], lattice[&(i + 1, j)], lattice[&(i, j + 1)]]);
                if i + j + 1 < n {
                    triangles.push([lattice[&(i + 1, j)], lattice[&(i + 1, j + 1)], lattice[&(i, j + 1)]]);
                }
            }
        }
    }
    Triangles { points, triangles }
}

/// The longest edge is the largest, of equals that of the smallest point numbers, so that splits come in a fixed order.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Edge {
    /// Bits of the squared length: ordered like the (non-negative) number.
    length: u64,
    ends: std::cmp::Reverse<(u32, u32)>,
}

impl Edge {
    fn new(points: &[Vec3], a: u32, b: u32) -> Self {
        let length = (points[a as usize] - points[b as usize]).norm_squared().to_bits();
        Self { length, ends: std::cmp::Reverse((a.min(b), a.max(b))) }
    }

    fn ends(self) -> (u32, u32) {
        self.ends.0
    }
}

/// The triangle on the left of each directed edge.
struct Sides(HashMap<(u32, u32), u32>);

impl Sides {
    fn of(triangles: &[[u32; 3]]) -> Self {
        let sides = triangles.iter().zip(0..).flat_map(|(t, index)| edges(t).map(|edge| (edge, index)));
        Self(sides.collect())
    }

    /// Splits the two triangles at an edge by a new point on it; they keep one half each, and the others are added.
    fn split(&mut self, triangles: &mut Vec<[u32; 3]>, (a, b): (u32, u32), middle: u32) -> [u32; 4] {
        let mut changed = [0; 4];
        for (side, (from, to)) in [(a, b), (b, a)].into_iter().enumerate() {
            let old = self.0[&(from, to)];
            let apex = apex(&triangles[old as usize], (from, to));
            let new = triangles.len() as u32;
            triangles[old as usize] = [from, middle, apex];
            triangles.push([middle, to, apex]);
            self.0.insert((from, middle), old);
            self.0.insert((middle, apex), old);
            self.0.insert((middle, to), new);
            self.0.insert((to, apex), new);
            self.0.insert((apex, middle), new);
            [changed[2 * side], changed[2 * side + 1]] = [old, new];
        }
        changed
    }
}

fn edges(triangle: &[u32; 3]) -> [(u32, u32); 3] {
    let [a, b, c] = *triangle;
    [(a, b), (b, c), (c, a)]
}

fn apex(triangle: &[u32; 3], (from, to): (u32, u32)) -> u32 {
    triangle.iter().copied().find(|&v| v != from && v != to).expect("a triangle has a third vertex")
}

/// Halves the longest edge, splitting its two triangles, as long as `more(its length, number of triangles)` says.
///
/// Since the longest edge of all is the longest of both its triangles, this is Rivara's longest-edge bisection: angles
/// stay bounded below by half the smallest angle of the start.
pub(super) fn halve_longest(mesh: &mut Triangles, more: impl Fn(f64, usize) -> bool) {
    let mut sides = Sides::of(&mesh.triangles);
    let each_once = mesh.triangles.iter().flat_map(edges).filter(|(a, b)| a < b);
    let mut queue: BinaryHeap<Edge> = each_once.map(|(a, b)| Edge::new(&mesh.points, a, b)).collect();
    while let Some(edge) = queue.pop() {
        if !more(f64::from_bits(edge.length).sqrt(), mesh.triangles.len()) {
            return;
        }
        let ((a, b), middle) = (edge.ends(), mesh.points.len() as u32);
        mesh.points.push((mesh.points[a as usize] + mesh.points[b as usize]) * 0.5);
        let changed = sides.split(&mut mesh.triangles, (a, b), middle);
        let apices = [changed[0], changed[2]].map(|t| mesh.triangles[t as usize][2]);
        queue.extend(apices.into_iter().chain([a, b]).map(|end| Edge::new(&mesh.points, middle, end)));
    }
}

/// Halves edges, seen from `centre`, until no triangle's image on the sphere has a [`stretch`] above `most_stretch`, or there
/// are so many triangles that `more(their number)` is false.
///
/// The edge that is halved is the longest, in the image, of both its triangles: from a triangle that is too large a path of
/// ever longer edges leads to it (Rivara's longest-edge propagation). So the images' angles stay bounded below by half the
/// smallest of the start, and those of long thin triangles grow.
pub(super) fn refine_onto_ball(mesh: &mut Triangles, centre: &Vec3, most_stretch: f64, more: impl Fn(usize) -> bool) {
    let mut images: Vec<Vec3> = mesh.points.iter().map(|p| (p - centre).normalize()).collect();
    let mut sides = Sides::of(&mesh.triangles);
    let longest = |images: &[Vec3], triangle: &[u32; 3]| {
        let [a, b, c] = edges(triangle).map(|(a, b)| Edge::new(images, a, b));
        a.max(b).max(c)
    };
    let mut queue: VecDeque<u32> = (0..mesh.triangles.len() as u32).collect();
    while let Some(index) = queue.pop_front() {
        let is_too_large = |triangle: &[u32; 3]| stretch(&triangle.map(|v| images[v as usize])) > most_stretch;
        if !is_too_large(&mesh.triangles[index as usize]) {
            continue;
        }
        if !more(mesh.triangles.len()) {
            return;
        }
        let mut edge = longest(&images, &mesh.triangles[index as usize]);
        loop {
            let (a, b) = edge.ends();
            let longer = [(a, b), (b, a)].map(|side| longest(&images, &mesh.triangles[sides.0[&side] as usize]));
            let next = longer[0].max(longer[1]);
            if next == edge {
                break;
            }
            edge = next;
        }
        // The point of the edge on the bisector of the angle at the centre.
        let ((a, b), middle) = (edge.ends(), mesh.points.len() as u32);
        let [p, q] = [a, b].map(|v| mesh.points[v as usize] - centre);
        let point = centre + (p * q.norm() + q * p.norm()) / (p.norm() + q.norm());
        mesh.points.push(point);
        images.push((point - centre).normalize());
        queue.push_back(index);
        queue.extend(sides.split(&mut mesh.triangles, (a, b), middle));
    }
}

/// K of the radial map of the triangle of three unit vectors, seen from 0, onto the sphere: sigma^3, where sigma - 1 / sigma
/// is the tangent of the angle between the triangle's normal and a corner, the same at all three (see
/// [`mod@crate::measure`]). Infinite where the triangle faces away.
fn stretch([a, b, c]: &[Vec3; 3]) -> f64 {
    let normal = (b - a).cross(&(c - a));
    let distance = normal.dot(a);
    if distance <= 0.0 {
        return f64::INFINITY;
    }
    let tangent = normal.cross(a).norm() / distance;
    (0.5 * (tangent + (tangent * tangent + 4.0).sqrt())).powi(3)
}

/// The largest K of the radial map onto the ball of the polyhedron inscribed in the sphere that the radial projection about
/// `centre` makes of a surface. It tends to 1 on fine surfaces, and is infinite where the centre does not see a triangle.
pub fn inscribed_stretch(surface: &Surface, centre: &Vec3) -> f64 {
    let image = |corner: Vec3| (corner - centre).normalize();
    surface.ids().map(|id| stretch(&surface.corners(id).map(image))).fold(1.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solid::{MOST_TETS_FOR_BALL, Refinement, ShellSettings, Solid, shell_mesh};

    fn settings(refinement: Refinement) -> ShellSettings {
        ShellSettings { subdivisions: 1, refinement: Some(refinement), layers: 3, grading: 1.0 }
    }

    #[test]
    fn the_stretch_of_an_inscribed_cube_is_its_closed_form() {
        // The solid's faces come as eight triangles, whose corners are not all on the sphere about the cube.
        let corners = [Vec3::new(1.0, 1.0, 1.0), Vec3::new(-1.0, 1.0, 1.0), Vec3::new(-1.0, -1.0, 1.0)];
        let sigma = (2f64.sqrt() + 6f64.sqrt()) / 2.0;
        assert!((stretch(&corners.map(|p| p.normalize())) - sigma.powi(3)).abs() < 1e-12);
        assert_eq!(stretch(&corners.map(|p| -p.normalize())), f64::INFINITY);
    }

    #[test]
    fn halving_reaches_the_length_and_the_count_and_keeps_the_volume() {
        let surface = Solid::Dodecahedron.surface().unwrap();
        let refined = |refinement| shell_mesh(&surface, Vec3::zeros(), &settings(refinement)).unwrap();
        let fine = refined(Refinement::EdgeLength(0.25));
        for triangle in fine.surface.triangles() {
            for i in 0..3 {
                let [p, q] = [triangle[i], triangle[(i + 1) % 3]].map(|v| fine.surface.points()[v.index()]);
                assert!((p - q).norm() <= 0.25);
            }
        }
        assert!((fine.surface.volume() - surface.volume()).abs() < 1e-12 * surface.volume());
        let counted = refined(Refinement::Cells(5000));
        // Each split adds two triangles of seven tets.
        assert!((5000..5000 + 14).contains(&counted.mesh.tets().len()));
    }

    #[test]
    fn the_ball_is_reached_with_some_hundred_triangles_whatever_the_solid() {
        let thin = Solid::Box { size: [1.0, 1.0, 40.0] };
        for solid in [Solid::Tetrahedron, Solid::Cube, Solid::Icosahedron, thin] {
            let surface = solid.surface().unwrap();
            let shell = shell_mesh(&surface, Vec3::zeros(), &settings(Refinement::Ball(1.3))).unwrap();
            assert!(inscribed_stretch(&surface, &Vec3::zeros()) > 1.3);
            assert!(inscribed_stretch(&shell.surface, &Vec3::zeros()) <= 1.3 + 1e-9);
            // A circumradius of 0.17 allows a triangle at most 0.04 of the sphere's 4 pi.
            let triangles = shell.surface.triangles().len();
            assert!((320..2000).contains(&triangles), "{solid}: {triangles}");
            assert!((shell.surface.volume() - surface.volume()).abs() < 1e-12 * surface.volume());
        }
    }

    #[test]
    fn the_ball_is_not_paid_for_with_millions_of_tets() {
        let surface = Solid::Cube.surface().unwrap();
        let settings = ShellSettings { layers: 1000, ..settings(Refinement::Ball(1.3)) };
        let shell = shell_mesh(&surface, Vec3::zeros(), &settings).unwrap();
        // Two triangles come with the split that goes beyond the limit.
        let (tets, a_triangle) = (shell.mesh.tets().len(), 3 * 1000 - 2);
        assert!(tets > MOST_TETS_FOR_BALL - a_triangle && tets <= MOST_TETS_FOR_BALL + 2 * a_triangle, "{tets}");
        assert!(inscribed_stretch(&shell.surface, &Vec3::zeros()) > 1.3);
    }
}

//! Cutting a polygon into triangles.

use std::f64::consts::TAU;

use crate::mesh::{Vec3, VertexId};

/// How far a flat polygon's vertices may lie from its plane, as a part of its largest extent.
///
/// Files with six significant digits bend flat polygons by about 1e-6. Above 1e-4 the choice of the diagonals begins to
/// change the solid, which a note then tells.
const PLANAR_TOLERANCE: f64 = 1e-4;

/// A polygon with more corners that has no fan is not looked into: the time grows with their square and more.
const MOST_CORNERS: usize = 1000;

/// Why a polygon cannot be cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PolygonError {
    /// One vertex twice.
    #[error("names vertex {vertex} twice, vertices at one place counting as one; name it once, or remove the polygon")]
    RepeatedVertex {
        /// The vertex.
        vertex: u32,
    },
    /// The outline crosses or touches itself, or has too many corners.
    #[error(
        "cannot be cut into triangles: its outline crosses itself, or it has more than 1000 corners; triangulate it"
    )]
    NotCut,
}

/// The triangles of a polygon, and what had to be done to it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Cut {
    /// None for a polygon without area.
    pub triangles: Vec<[VertexId; 3]>,
    /// How far its vertices lie from its plane, as a part of its largest extent; 0 for one that counts as flat.
    pub bend: f64,
    /// Whether it named a vertex several times in a row.
    pub repeats: bool,
}

/// Cuts a polygon: a flat one into the fan from its first vertex or from the first one whose fan triangulates it, a bent one
/// of four corners along its shorter diagonal, any other ear by ear, the one with the shortest diagonal first.
///
/// A fan triangulates the polygon if its triangles all turn the polygon's way, none has zero area and their angles at
/// the apex stay below a full turn; the convex polygon is the usual case, where only vertices on straight sides matter.
pub(super) fn cut(points: &[Vec3], polygon: &[VertexId]) -> Result<Cut, PolygonError> {
    let corners = without_repeats(polygon);
    let mut cut = Cut { repeats: corners.len() < polygon.len(), ..Cut::default() };
    let n = corners.len();
    let at = |i: usize| points[corners[i % n].index()];
    if n < 3 || (2..n).all(|i| collinear([at(0), at(1), at(i)])) && (1..n).all(|i| collinear([at(0), at(i), at(i + 1)]))
    {
        return Ok(cut);
    }
    let ids = |triangles: Vec<[usize; 3]>| triangles.into_iter().map(|t| t.map(|i| corners[i])).collect();
    if n == 3 {
        cut.triangles = ids(vec![[0, 1, 2]]);
        return Ok(cut);
    }
    // The vector area, relative to a vertex for the sake of polygons far from the origin.
    let area: Vec3 = (1..n - 1).map(|i| (at(i) - at(0)).cross(&(at(i + 1) - at(0)))).sum();
    let extent = (1..n).map(|i| (at(i) - at(0)).norm()).fold(0.0, f64::max);
    let Some(normal) = area.try_normalize(0.0) else {
        return Err(PolygonError::NotCut);
    };
    let bend = (1..n).map(|i| (at(i) - at(0)).dot(&normal).abs()).fold(0.0, f64::max) / extent;
    let is_flat = bend <= PLANAR_TOLERANCE;
    if !is_flat {
        cut.bend = bend;
    }
    let repeated = repeated(&corners);
    let fan = if is_flat && repeated.is_none() { fan(n, at, &normal) } else { None };
    let outline = Outline::new((0..n).map(at).collect(), &normal, &corners);
    let triangles = fan.or_else(|| outline.ears()).ok_or(match repeated {
        Some(vertex) => PolygonError::RepeatedVertex { vertex: vertex.0 },
        None => PolygonError::NotCut,
    })?;
    cut.triangles = ids(triangles);
    Ok(cut)
}

/// The polygon without vertices that follow themselves, and without the tips of spikes, from which it returns at once.
fn without_repeats(polygon: &[VertexId]) -> Vec<VertexId> {
    let mut corners: Vec<VertexId> = Vec::with_capacity(polygon.len());
    for &vertex in polygon {
        push(&mut corners, vertex);
    }
    // The same across the seam.
    while let [first, .., last] = corners[..] {
        let [second, before_last] = [corners[1], corners[corners.len() - 2]];
        if first == last || second == last || first == before_last {
            corners.pop();
            if second == last && first != last {
                corners.remove(0);
            }
        } else {
            break;
        }
    }
    corners
}

fn push(corners: &mut Vec<VertexId>, vertex: VertexId) {
    match corners[..] {
        [.., last] if last == vertex => {}
        [.., before, _] if before == vertex => {
            corners.pop();
        }
        _ => corners.push(vertex),
    }
}

fn repeated(corners: &[VertexId]) -> Option<VertexId> {
    let mut sorted = corners.to_vec();
    sorted.sort_unstable();
    sorted.windows(2).find(|pair| pair[0] == pair[1]).map(|pair| pair[0])
}

/// The first fan that triangulates a flat polygon.
fn fan(n: usize, at: impl Fn(usize) -> Vec3, normal: &Vec3) -> Option<Vec<[usize; 3]>> {
    let fan = |apex: usize| (1..n - 1).map(move |i| [apex, (apex + i) % n, (apex + i + 1) % n]);
    let triangulates = |apex: &usize| {
        let turn: Option<f64> = fan(*apex)
            .map(|triangle| {
                let [a, b, c] = triangle.map(&at);
                let turns_along = (b - a).cross(&(c - a)).dot(normal) > 0.0;
                (turns_along && !collinear([a, b, c])).then(|| (b - a).angle(&(c - a)))
            })
            .sum();
        turn.is_some_and(|turn| turn < TAU)
    };
    (0..n).find(triangulates).map(|apex| fan(apex).collect())
}

/// A polygon in a plane, counter-clockwise.
struct Outline<'a> {
    /// In space.
    points: Vec<Vec3>,
    /// In the coordinate plane that the polygon is nearest to.
    flat: Vec<robust::Coord<f64>>,
    corners: &'a [VertexId],
}

impl<'a> Outline<'a> {
    fn new(points: Vec<Vec3>, normal: &Vec3, corners: &'a [VertexId]) -> Self {
        let axis = normal.iamax();
        let (mut u, mut v) = ((axis + 1) % 3, (axis + 2) % 3);
        if normal[axis] < 0.0 {
            (u, v) = (v, u);
        }
        let flat = points.iter().map(|p| robust::Coord { x: p[u], y: p[v] }).collect();
        Self { points, flat, corners }
    }

    fn turn(&self, [a, b, c]: [usize; 3]) -> f64 {
        robust::orient2d(self.flat[a], self.flat[b], self.flat[c])
    }

    /// Cuts ear by ear; fails where the outline crosses itself. A vertex may occur twice, as along the cut to a hole.
    fn ears(&self) -> Option<Vec<[usize; 3]>> {
        let mut ring: Vec<usize> = (0..self.points.len()).collect();
        if ring.len() > MOST_CORNERS {
            return None;
        }
        let mut triangles = Vec::with_capacity(ring.len() - 2);
        while ring.len() > 3 {
            let n = ring.len();
            let ear = |place: usize| [ring[(place + n - 1) % n], ring[place], ring[(place + 1) % n]];
            let diagonal = |place: usize| {
                let [before, _, after] = ear(place);
                (self.points[after] - self.points[before]).norm_squared()
            };
            let mut places: Vec<usize> = (0..n).collect();
            places.sort_by(|&a, &b| diagonal(a).total_cmp(&diagonal(b)));
            let place = places.into_iter().find(|&place| {
                // Of four corners the three that are left are a triangle too.
                let rest = [ring[(place + 1) % n], ring[(place + 2) % n], ring[(place + 3) % n]];
                self.is_ear(ear(place), &ring) && (n > 4 || self.turn(rest) > 0.0)
            })?;
            triangles.push(ear(place));
            ring.remove(place);
        }
        let last = [ring[0], ring[1], ring[2]];
        (self.turn(last) > 0.0).then(|| {
            triangles.push(last);
            triangles
        })
    }

    /// Whether a triangle turns along and holds no other corner.
    fn is_ear(&self, ear: [usize; 3], ring: &[usize]) -> bool {
        let [a, b, c] = ear;
        let is_corner = |i: usize| ear.iter().any(|&corner| self.corners[corner] == self.corners[i]);
        let outside = |i: usize| [[a, b, i], [b, c, i], [c, a, i]].into_iter().any(|side| self.turn(side) < 0.0);
        self.turn(ear) > 0.0 && ring.iter().all(|&i| is_corner(i) || outside(i))
    }
}

/// Whether three points lie on one line, exactly: their projections on the three coordinate planes all do.
fn collinear(corners: [Vec3; 3]) -> bool {
    [(0, 1), (1, 2), (2, 0)].into_iter().all(|(i, j)| {
        let [a, b, c] = corners.map(|p| robust::Coord { x: p[i], y: p[j] });
        robust::orient2d(a, b, c) == 0.0
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(points: &[[f64; 3]]) -> Result<Cut, PolygonError> {
        let points: Vec<Vec3> = points.iter().map(|&p| p.into()).collect();
        let polygon: Vec<VertexId> = (0..points.len() as u32).map(VertexId).collect();
        cut(&points, &polygon)
    }

    fn triangles(points: &[[f64; 3]]) -> Vec<[u32; 3]> {
        of(points).unwrap().triangles.into_iter().map(|t| t.map(|v| v.0)).collect()
    }

    /// Twice the area in the plane z = const.
    fn area(points: &[[f64; 3]]) -> f64 {
        let points_of = |t: [u32; 3]| t.map(|i| Vec3::from(points[i as usize]));
        let turns = triangles(points).into_iter().map(points_of).map(|[a, b, c]| (b - a).cross(&(c - a)).z);
        turns.inspect(|&turn| assert!(turn > 0.0)).sum()
    }

    const SQUARE: [[f64; 3]; 4] = [[0., 0., 1.], [1., 0., 1.], [1., 1., 1.], [0., 1., 1.]];

    #[test]
    fn a_convex_polygon_is_fanned_from_its_first_vertex() {
        assert_eq!(triangles(&SQUARE), [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn a_vertex_on_a_side_moves_the_apex() {
        let mut house = SQUARE.to_vec();
        house.insert(1, [0.5, 0., 1.]);
        assert_eq!(triangles(&house), [[1, 2, 3], [1, 3, 4], [1, 4, 0]]);
    }

    #[test]
    fn a_bent_square_is_cut_along_its_shorter_diagonal_and_says_how_bent_it_is() {
        let mut bent = SQUARE;
        // The diagonal through the lifted corner is the longer one.
        bent[2][2] += 0.5;
        let found = of(&bent).unwrap();
        assert_eq!(found.triangles, [[3, 0, 1], [1, 2, 3]].map(|t| t.map(VertexId)));
        // The normal is along (-1/4, -1/4, 1), of length sqrt(9/8); the corner 1 lies 1/4 below the plane through 0.
        let expected = 0.25 / 1.125f64.sqrt() / 2.25f64.sqrt();
        assert!((found.bend - expected).abs() < 1e-12, "{found:?}");
        bent[2][2] = 1.0 + 1e-5;
        assert_eq!(of(&bent).unwrap().bend, 0.0);
    }

    #[test]
    fn concave_polygons_are_cut_ear_by_ear() {
        // A star of six points: no vertex sees all others.
        let star: Vec<[f64; 3]> = (0..12)
            .map(|i| {
                let (sin, cos) = (f64::from(i) * TAU / 12.0).sin_cos();
                let radius = if i % 2 == 0 { 1.0 } else { 0.2 };
                [radius * cos, radius * sin, 0.0]
            })
            .collect();
        // Twelve triangles about the centre, each of area 1/2 * 1 * 0.2 * sin 30.
        assert!((area(&star) - 12.0 * 0.2 * 0.5).abs() < 1e-14);
        // An arrow: the reflex corner is in the way of one diagonal.
        let arrow = [[0., 0., 0.], [2., -2., 0.5], [1., 0., 0.], [2., 2., 0.5]];
        assert_eq!(triangles(&arrow).len(), 2);
        assert!(area(&arrow) > 0.0);
        // A square with a square hole, entered and left along one cut.
        let points = [[0., 0.], [4., 0.], [4., 4.], [0., 4.], [1., 1.], [1., 3.], [3., 3.], [3., 1.]];
        let points: Vec<Vec3> = points.iter().map(|&[x, y]| Vec3::new(x, y, 0.0)).collect();
        let outline = [0, 1, 2, 3, 0, 4, 5, 6, 7, 4].map(VertexId);
        let found = cut(&points, &outline).unwrap().triangles;
        let corners = found.iter().map(|t| t.map(|v| points[v.index()]));
        let doubled: f64 = corners.map(|[a, b, c]| (b - a).cross(&(c - a)).z).sum();
        assert_eq!((found.len(), doubled), (8, 24.0));
    }

    #[test]
    fn repeats_and_spikes_go_and_what_has_no_area_has_no_triangles() {
        let points: Vec<Vec3> = SQUARE.iter().map(|&p| p.into()).collect();
        let of = |corners: &[u32]| {
            let polygon: Vec<VertexId> = corners.iter().map(|&v| VertexId(v)).collect();
            cut(&points, &polygon)
        };
        let whole = of(&[0, 1, 2, 3]).unwrap();
        for corners in [&[0, 0, 1, 2, 3][..], &[0, 1, 1, 1, 2, 3, 3, 0], &[0, 1, 2, 1, 2, 3], &[1, 0, 1, 2, 3, 0]] {
            let found = of(corners).unwrap();
            assert!(found.repeats && found.triangles.len() == 2, "{corners:?}: {found:?}");
        }
        assert_eq!(of(&[0, 0, 1, 2, 3]).unwrap().triangles, whole.triangles);
        for corners in [&[][..], &[0], &[0, 1], &[0, 0, 1], &[0, 1, 0], &[0, 1, 0, 1]] {
            assert!(of(corners).unwrap().triangles.is_empty(), "{corners:?}");
        }
        assert!(triangles(&[[0., 0., 0.], [1., 1., 1.], [3., 3., 3.], [2., 2., 2.]]).is_empty());
        // A bow tie.
        assert_eq!(of(&[0, 1, 3, 2]), Err(PolygonError::NotCut));
    }

    #[test]
    fn a_second_loop_that_turns_the_other_way_is_refused() {
        let mut points: Vec<Vec3> = SQUARE.iter().map(|&p| p.into()).collect();
        points.extend([Vec3::new(-0.5, 0.0, 1.0), Vec3::new(-0.5, -0.5, 1.0)]);
        let outline = [0, 1, 2, 3, 0, 5, 4].map(VertexId);
        assert_eq!(cut(&points, &outline), Err(PolygonError::RepeatedVertex { vertex: 0 }));
    }

    #[test]
    fn collinearity_is_exact() {
        assert!(triangles(&[[0.1, 0.1, 0.1], [0.2, 0.2, 0.2], [0.4, 0.4, 0.4]]).is_empty());
        assert_eq!(triangles(&[[0.1, 0.1, 0.1], [0.2, 0.2, 0.2], [0.4, 0.4, 0.4 + 1e-16]]).len(), 1);
    }
}

//! What is done to the polygons of a file before they are a surface: cut into triangles, vertices welded, and, on request,
//! small pieces left out and holes filled.

use std::collections::HashMap;

use super::SurfaceError;
use super::polygon::cut;
use crate::mesh::{DisjointSets, PolygonSoup, Vec3, VertexId};

/// What may be done to a surface file on request. What is done is told in notes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RepairSettings {
    /// Vertices no farther apart than this part of the bounding box's diagonal become one; in (0, 0.01]. Without it only
    /// vertices at the same place do, and these only where the surface is not closed otherwise.
    pub weld: Option<f64>,
    /// Whether only the piece with the largest area is kept.
    pub keep_largest: bool,
    /// Whether flat holes are filled.
    pub fill_holes: bool,
}

/// Triangles on the points of a soup.
pub(super) struct Triangles {
    pub points: Vec<Vec3>,
    pub triangles: Vec<[VertexId; 3]>,
    pub notes: Vec<String>,
}

impl Triangles {
    /// Cuts the polygons of a soup; one without area has no triangles.
    pub fn of(soup: &PolygonSoup) -> Result<Self, SurfaceError> {
        let mut triangles = Vec::with_capacity(2 * soup.polygons.len());
        let (mut repeats, mut empty, mut bent, mut bend) = (0usize, 0usize, 0usize, 0.0f64);
        for (polygon, vertices) in soup.polygons.iter().enumerate() {
            if let Some(vertex) = vertices.iter().find(|vertex| vertex.index() >= soup.points.len()) {
                return Err(SurfaceError::VertexOutOfRange { polygon, vertex: vertex.0, count: soup.points.len() });
            }
            if let Some(vertex) = vertices.iter().find(|v| !soup.points[v.index()].iter().all(|x| x.is_finite())) {
                return Err(SurfaceError::NotFinite { vertex: vertex.index() });
            }
            let cut = cut(&soup.points, vertices).map_err(|fault| SurfaceError::BadPolygon { polygon, fault })?;
            empty += usize::from(cut.triangles.is_empty());
            repeats += usize::from(cut.repeats && !cut.triangles.is_empty());
            bent += usize::from(cut.bend > 0.0);
            bend = bend.max(cut.bend);
            triangles.extend(cut.triangles);
        }
        let mut notes = soup.notes.clone();
        if repeats > 0 {
            notes.push(format!("{repeats} polygons name a vertex several times in a row, which counts once"));
        }
        if empty > 0 {
            notes.push(format!("{empty} polygons without area were dropped"));
        }
        if bent > 0 {
            notes.push(format!(
                "{bent} polygons are not flat, by up to {:.2} % of their size; they were cut into triangles along short diagonals",
                (1e4 * bend).ceil() / 100.0
            ));
        }
        Ok(Self { points: soup.points.clone(), triangles, notes })
    }

    /// Leaves out all pieces but the one with the largest area.
    pub fn keep_largest(&mut self) {
        let mut pieces = DisjointSets::new(self.triangles.len());
        for group in self.sides().chunk_by(|a, b| a.ends == b.ends) {
            group.iter().for_each(|side| pieces.join(group[0].triangle, side.triangle));
        }
        let roots: Vec<u32> = (0..self.triangles.len() as u32).map(|triangle| pieces.root(triangle)).collect();
        let mut areas = vec![0.0; roots.len()];
        for (triangle, &root) in self.triangles.iter().zip(&roots) {
            let [a, b, c] = triangle.map(|v| self.points[v.index()]);
            areas[root as usize] += (b - a).cross(&(c - a)).norm() / 2.0;
        }
        // The first of several that are as large.
        let largest = (0..areas.len()).rev().max_by(|&a, &b| areas[a].total_cmp(&areas[b]));
        let (before, count) = (self.triangles.len(), pieces.count());
        let mut kept = roots.iter().map(|&root| Some(root as usize) == largest);
        self.triangles.retain(|_| kept.next() == Some(true));
        if count > 1 {
            let dropped = before - self.triangles.len();
            self.notes.push(format!(
                "of {count} pieces the largest was kept; {dropped} triangles of the others were dropped"
            ));
        }
    }

    /// Fills every hole whose rim is one flat loop.
    pub fn fill_holes(&mut self) {
        // The rim runs against the triangles that have its edges.
        let mut next: HashMap<VertexId, Vec<VertexId>> = HashMap::new();
        let sides = self.sides();
        let open: Vec<&Side> =
            sides.chunk_by(|a, b| a.ends == b.ends).filter(|g| g.len() == 1).map(|g| &g[0]).collect();
        for side in &open {
            let [low, high] = side.ends;
            let (from, to) = if side.backward { (low, high) } else { (high, low) };
            next.entry(from).or_default().push(to);
        }
        let extent = |corners: &mut dyn Iterator<Item = Vec3>| {
            let first = corners.next().unwrap_or_default();
            let (low, high) = corners.fold((first, first), |(low, high), p| (low.inf(&p), high.sup(&p)));
            (high - low).norm()
        };
        let whole = extent(&mut self.triangles.iter().flatten().map(|v| self.points[v.index()]));
        let (mut filled, mut largest) = (0usize, 0.0f64);
        for start in open.iter().map(|side| side.ends[0]) {
            let Some(rim) = take_loop(&mut next, start) else { continue };
            // One that cannot be cut stays open, which is told later.
            let Ok(patch) = cut(&self.points, &rim) else { continue };
            if patch.bend == 0.0 && !patch.triangles.is_empty() {
                filled += 1;
                largest = largest.max(extent(&mut rim.iter().map(|v| self.points[v.index()])) / whole);
                self.triangles.extend(patch.triangles);
            }
        }
        if filled > 0 {
            let percent = (1000.0 * largest).ceil() / 10.0;
            self.notes.push(match filled {
                1 => format!("1 flat hole was filled, {percent} % of the solid's size"),
                _ => format!("{filled} flat holes were filled, the largest {percent} % of the solid's size"),
            });
        }
    }

    /// The sides of all triangles, sorted.
    fn sides(&self) -> Vec<Side> {
        let mut sides = Vec::with_capacity(3 * self.triangles.len());
        for (triangle, corners) in (0..).zip(&self.triangles) {
            for i in 0..3 {
                let (a, b) = (corners[i], corners[(i + 1) % 3]);
                sides.push(Side { ends: [a.min(b), a.max(b)], triangle, backward: a > b });
            }
        }
        sides.sort_unstable();
        sides
    }
}

/// A side of a triangle.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Side {
    ends: [VertexId; 2],
    triangle: u32,
    /// Whether the triangle runs it from the greater to the smaller vertex.
    backward: bool,
}

/// Takes the loop out of `next` that starts at a vertex; none where it parts, or was taken.
fn take_loop(next: &mut HashMap<VertexId, Vec<VertexId>>, start: VertexId) -> Option<Vec<VertexId>> {
    let mut rim = vec![start];
    loop {
        let only = match next.get(rim.last()?)?.as_slice() {
            [only] => *only,
            _ => return None,
        };
        if only == start {
            break;
        }
        // A loop that does not come back to its start parts somewhere.
        if rim.len() > next.len() {
            return None;
        }
        rim.push(only);
    }
    rim.iter().for_each(|vertex| drop(next.remove(vertex)));
    Some(rim)
}

/// The soup with one vertex for all at the same place (0 and -0 being one), and how many that spares.
pub(super) fn welded_at_once(soup: &PolygonSoup) -> (PolygonSoup, usize) {
    let mut first: HashMap<[u64; 3], VertexId> = HashMap::new();
    let number = (0..).map(VertexId).zip(&soup.points).map(|(vertex, point)| {
        // Adding zero makes -0 and 0 the same bits.
        *first.entry([point.x, point.y, point.z].map(|x| (x + 0.0).to_bits())).or_insert(vertex)
    });
    renumbered(soup, &number.collect::<Vec<_>>())
}

/// The soup with one vertex for all that are joined by steps no longer than `tolerance` times the diagonal.
pub(super) fn welded_within(soup: &PolygonSoup, tolerance: f64) -> (PolygonSoup, usize) {
    let finite = || soup.points.iter().filter(|point| point.iter().all(|x| x.is_finite()));
    let low = finite().copied().reduce(|a, b| a.inf(&b)).unwrap_or_default();
    let high = finite().copied().reduce(|a, b| a.sup(&b)).unwrap_or_default();
    let near = tolerance * (high - low).norm();
    let cell = |point: &Vec3| -> [i64; 3] { ((point - low) / near).map(|x| x.floor() as i64).into() };
    let mut sets = DisjointSets::new(soup.points.len());
    let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    for (vertex, point) in (0..).zip(&soup.points).filter(|(_, point)| point.iter().all(|x| x.is_finite())) {
        let [i, j, k] = cell(point);
        for shift in 0..27 {
            // Far away, where numbers are not told apart any more, cells may be the last ones.
            let neighbour = [(i, shift % 3), (j, shift / 3 % 3), (k, shift / 9)].map(|(x, d)| x.saturating_add(d - 1));
            for &other in cells.get(&neighbour).into_iter().flatten() {
                if (soup.points[other as usize] - point).norm() <= near {
                    sets.join(other, vertex);
                }
            }
        }
        cells.entry([i, j, k]).or_default().push(vertex);
    }
    let number: Vec<VertexId> = (0..soup.points.len() as u32).map(|vertex| VertexId(sets.root(vertex))).collect();
    renumbered(soup, &number)
}

fn renumbered(soup: &PolygonSoup, number: &[VertexId]) -> (PolygonSoup, usize) {
    let spared = number.iter().enumerate().filter(|(vertex, number)| *vertex != number.index()).count();
    let polygons = soup.polygons.iter().map(|polygon| polygon.iter().map(|v| number[v.index()]).collect());
    (PolygonSoup { points: soup.points.clone(), polygons: polygons.collect(), notes: soup.notes.clone() }, spared)
}

//! The flat faces of a triangulated polyhedron: coplanar triangles joined, straight edges too.

use std::collections::{BTreeMap, HashMap};

use crate::mesh::{DisjointSets, Vec3};
use crate::solid::Surface;

/// Deviation, in radians, up to which two triangles count as one flat face and two edges as one straight edge: as
/// [`crate::mesh::Features`] has it.
const FLAT: f64 = 1e-7;

/// The least distance of a face's centroid from a side's line, over the square root of the face's area, at which it sees
/// that side.
const SEES: f64 = 1e-3;

/// The faces, edges and corners of a polyhedron.
pub(super) struct Faces {
    /// The corners: where faces meet and no two edges make a straight one.
    pub points: Vec<Vec3>,
    /// The corners of each face, counter-clockwise seen from outside.
    pub loops: Vec<Vec<usize>>,
    /// The centroid of each face; it sees all sides of the face.
    pub centres: Vec<Vec3>,
    /// The edges that start at the corners of each face, in the order of its corners.
    pub sides: Vec<Vec<usize>>,
    /// The two ends of each edge.
    pub edges: Vec<[usize; 2]>,
}

/// Finds the faces. Triangles whose joint face has a hole, touches itself or is not seen by its centroid as a whole stay
/// what they are: faces of three sides.
pub(super) fn flat_faces(surface: &Surface) -> Faces {
    let normals: Vec<Vec3> = surface.ids().map(|triangle| surface.area_vector(triangle)).collect();
    let mut sets = DisjointSets::new(normals.len());
    for edge in surface.edges() {
        let [a, b] = edge.triangles.map(|triangle| normals[triangle.index()]);
        if a.cross(&b).norm().atan2(a.dot(&b)) <= FLAT {
            sets.join(edge.triangles[0].0, edge.triangles[1].0);
        }
    }
    let mut face_of: Vec<u32> = (0..normals.len() as u32).map(|triangle| sets.root(triangle)).collect();
    loop {
        let outlines = outlines(surface, &face_of);
        let is_face = |outline: &[usize]| outline.len() == 3 || centre(&at(surface, outline)).is_some();
        let bad: Vec<u32> =
            outlines.iter().filter(|(_, o)| !o.as_ref().is_some_and(|o| is_face(o))).map(|(face, _)| *face).collect();
        if bad.is_empty() {
            return numbered(surface, outlines.into_values().flatten().collect());
        }
        // Each round leaves fewer joint faces.
        for (triangle, face) in (0..).zip(&mut face_of) {
            if bad.binary_search(face).is_ok() {
                *face = triangle;
            }
        }
    }
}

fn at(surface: &Surface, outline: &[usize]) -> Vec<Vec3> {
    outline.iter().map(|&v| surface.points()[v]).collect()
}

/// The vertices around each face; none for a face that has a hole or touches itself.
fn outlines(surface: &Surface, face_of: &[u32]) -> BTreeMap<u32, Option<Vec<usize>>> {
    // Where the sides of each face lead from their starts, which are in order.
    let mut sides: BTreeMap<u32, Vec<(usize, usize)>> = BTreeMap::new();
    for edge in surface.edges() {
        let faces = edge.triangles.map(|triangle| face_of[triangle.index()]);
        let [a, b] = edge.vertices.map(|v| v.index());
        if faces[0] != faces[1] {
            sides.entry(faces[0]).or_default().push((a, b));
            sides.entry(faces[1]).or_default().push((b, a));
        }
    }
    let outline = |mut sides: Vec<(usize, usize)>| {
        sides.sort_unstable();
        if sides.windows(2).any(|pair| pair[0].0 == pair[1].0) {
            return None;
        }
        let first = sides[0].0;
        let next = |v: usize| sides.binary_search_by_key(&v, |side| side.0).ok().map(|place| sides[place].1);
        let outline: Vec<usize> =
            std::iter::successors(Some(first), |&v| next(v).filter(|&next| next != first)).take(sides.len()).collect();
        (outline.len() == sides.len()).then_some(outline)
    };
    sides.into_iter().map(|(face, sides)| (face, outline(sides))).collect()
}

/// The centroid of a flat polygon, if it sees all its sides from within.
fn centre(corners: &[Vec3]) -> Option<Vec3> {
    let first = corners[0];
    let fan = || corners[1..].windows(2).map(|pair| ((pair[0] - first).cross(&(pair[1] - first)), pair[0] + pair[1]));
    let area: Vec3 = fan().map(|(area, _)| area).sum();
    let normal = area.try_normalize(0.0)?;
    let moment: Vec3 = fan().map(|(area, ends)| (first + ends) / 3.0 * area.dot(&normal)).sum();
    let centre = moment / area.norm();
    let least = SEES * area.norm().sqrt();
    let sees = |(i, start): (usize, &Vec3)| {
        let along = corners[(i + 1) % corners.len()] - start;
        normal.dot(&along.cross(&(centre - start))) > least * along.norm()
    };
    corners.iter().enumerate().all(sees).then_some(centre)
}

/// Numbers corners and edges, and joins straight edges.
fn numbered(surface: &Surface, mut outlines: Vec<Vec<usize>>) -> Faces {
    let points = surface.points();
    let mut neighbours: Vec<Vec<usize>> = vec![Vec::new(); points.len()];
    for outline in &outlines {
        for (i, &v) in outline.iter().enumerate() {
            // The other direction is a side of another face.
            neighbours[v].push(outline[(i + 1) % outline.len()]);
        }
    }
    let is_straight = |v: usize| match *neighbours[v] {
        [a, b] => {
            let (to_a, to_b) = (points[a] - points[v], points[v] - points[b]);
            to_a.cross(&to_b).norm().atan2(to_a.dot(&to_b)) <= FLAT
        }
        _ => false,
    };
    let is_corner: Vec<bool> = (0..points.len()).map(|v| !neighbours[v].is_empty() && !is_straight(v)).collect();
    let numbers: Vec<usize> = is_corner
        .iter()
        .scan(0, |count, &is| {
            *count += usize::from(is);
            Some(*count - usize::from(is))
        })
        .collect();
    for outline in &mut outlines {
        outline.retain(|&v| is_corner[v]);
        outline.iter_mut().for_each(|v| *v = numbers[*v]);
    }
    let points: Vec<Vec3> = points.iter().zip(&is_corner).filter(|(_, is)| **is).map(|(point, _)| *point).collect();
    let mut edges = Vec::new();
    let mut numbers: HashMap<[usize; 2], usize> = HashMap::new();
    let mut sides = Vec::with_capacity(outlines.len());
    for outline in &outlines {
        let number = |(i, &v): (usize, &usize)| {
            let next = outline[(i + 1) % outline.len()];
            let ends = [v.min(next), v.max(next)];
            *numbers.entry(ends).or_insert_with(|| {
                edges.push(ends);
                edges.len() - 1
            })
        };
        sides.push(outline.iter().enumerate().map(number).collect());
    }
    let centre_of = |outline: &Vec<usize>| {
        let corners: Vec<Vec3> = outline.iter().map(|&v| points[v]).collect();
        // Of three corners the mean, however thin the triangle.
        centre(&corners).unwrap_or_else(|| corners.iter().sum::<Vec3>() / corners.len() as f64)
    };
    let centres = outlines.iter().map(centre_of).collect();
    Faces { points, loops: outlines, centres, sides, edges }
}

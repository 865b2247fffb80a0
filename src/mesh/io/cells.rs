//! What every reader of cells ends with: points and cells checked, tets kept, other volumes split into tets, polygons kept
//! aside for files that hold a surface.

use super::tokens::Fault;
use crate::mesh::{PolygonSoup, TetSoup, Vec3, VertexId};

/// Named scalar arrays with one number a tet.
pub type CellData = Vec<(String, Vec<f64>)>;

/// Named arrays with one vector a point.
pub type PointVectors = Vec<(String, Vec<Vec3>)>;

/// A mesh and what its file says of each tet.
#[derive(Clone, Debug, PartialEq)]
pub struct TetFile {
    /// Points and tets.
    pub soup: TetSoup,
    /// The scalar arrays on the tets, in the file's order; NaN where a file gives a tet no value. Arrays of vectors are
    /// not read.
    pub cell_data: CellData,
    /// The arrays of vectors on the points, in the file's order; read of VTU files only.
    pub point_vectors: PointVectors,
    /// How many vertices, lines, triangles and other cells of lower dimension were skipped.
    pub skipped_cells: usize,
}

/// What a file of cells holds: tets, or else polygons.
pub(super) struct Contents {
    pub(super) tets: TetFile,
    /// As the file has them, not checked.
    polygons: Vec<Vec<i64>>,
}

/// The kinds of cells; the first vertices of a cell of higher order are the corners of the linear one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shape {
    Tet,
    /// Round one side, then round the other.
    Hexahedron,
    Prism,
    /// Round the base, then the apex.
    Pyramid,
    /// A polygon of so many corners.
    Polygon(usize),
    /// A strip of triangles, every second one turned.
    Strip,
    /// Points, lines, and what else is no part of a solid or of its surface.
    Other,
}

/// Cells of mixed types, with vertices by position.
#[derive(Default)]
pub(super) struct Cells {
    tets: Vec<[i64; 4]>,
    /// The position of each tet's cell among all cells.
    places: Vec<usize>,
    polygons: Vec<Vec<i64>>,
    count: usize,
    skipped: usize,
    /// How many tets of higher order, hexahedra, prisms and pyramids there were.
    curved: usize,
    split: [usize; 3],
}

impl Cells {
    /// Takes the next cell, whose corners come first; the others of its vertices are left out.
    ///
    /// # Panics
    /// When there are fewer vertices than corners.
    pub(super) fn push(&mut self, shape: Shape, vertices: &[i64]) {
        let place = self.count;
        self.count += 1;
        match shape {
            Shape::Tet => {
                self.curved += usize::from(vertices.len() > 4);
                self.push_tet(place, [vertices[0], vertices[1], vertices[2], vertices[3]]);
            }
            Shape::Hexahedron | Shape::Prism | Shape::Pyramid => {
                let (faces, number): (&[&[usize]], usize) = match shape {
                    Shape::Hexahedron => (&HEXAHEDRON, 0),
                    Shape::Prism => (&PRISM, 1),
                    _ => (&PYRAMID, 2),
                };
                self.split[number] += 1;
                for tet in split(faces, vertices) {
                    self.push_tet(place, tet);
                }
            }
            Shape::Polygon(corners) => {
                self.skipped += 1;
                self.polygons.push(vertices[..corners].to_vec());
            }
            Shape::Strip => {
                self.skipped += 1;
                self.polygons.extend(triangles_of_strip(vertices));
            }
            Shape::Other => self.skipped += 1,
        }
    }

    /// Passes over cells of lower dimension that are of no interest.
    pub(super) fn skip(&mut self, count: usize) {
        self.count += count;
        self.skipped += count;
    }

    fn push_tet(&mut self, place: usize, tet: [i64; 4]) {
        self.tets.push(tet);
        self.places.push(place);
    }

    /// The mesh; `cell_data` has one number a cell of the file, skipped ones included.
    pub(super) fn finish(self, coordinates: Vec<f64>, mut cell_data: CellData) -> Result<Contents, Fault> {
        let points = vectors(&coordinates);
        if u32::try_from(points.len()).is_err() {
            return Err((None, format!("{} vertices are more than can be numbered (2^32)", points.len())));
        }
        let mut tets = Vec::with_capacity(self.tets.len());
        for (tet, &place) in self.tets.iter().zip(&self.places) {
            let mut vertices = [VertexId(0); 4];
            for (vertex, &index) in vertices.iter_mut().zip(tet) {
                *vertex = known(&points, place, index)?;
            }
            tets.push(vertices);
        }
        check_finite(&points, tets.iter().flatten())?;
        for (name, values) in &mut cell_data {
            if values.len() != self.count {
                let message = format!("the cell data \"{name}\" has {} numbers for {} cells", values.len(), self.count);
                return Err((None, message));
            }
            if tets.len() != self.count || self.split != [0; 3] {
                *values = self.places.iter().map(|&place| values[place]).collect();
            }
        }
        let notes = self.notes();
        let soup = TetSoup { points, tets, notes };
        let tets = TetFile { soup, cell_data, point_vectors: Vec::new(), skipped_cells: self.skipped };
        Ok(Contents { tets, polygons: self.polygons })
    }

    fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if self.curved > 0 {
            notes.push(format!(
                "{} tets of second or higher order were read as linear ones, their edges straight",
                self.curved
            ));
        }
        for (count, name) in self.split.into_iter().zip(["hexahedra", "prisms", "pyramids"]) {
            if count > 0 {
                notes.push(format!("{count} {name} were split into tets"));
            }
        }
        notes
    }
}

impl Contents {
    /// The polygons as a surface.
    ///
    /// # Errors
    /// Tets, which are no surface; no polygons; a polygon that names no vertex.
    pub(super) fn into_surface(self) -> Result<PolygonSoup, Fault> {
        let TetSoup { points, tets, notes } = self.tets.soup;
        if !tets.is_empty() {
            return Err((None, "the file holds tets, where a surface is wanted".into()));
        }
        if self.polygons.is_empty() {
            return Err((None, "the file holds neither tets nor polygons".into()));
        }
        let polygons = self.polygons.iter().enumerate().map(|(place, polygon)| {
            polygon.iter().map(|&index| known(&points, place, index)).collect::<Result<Vec<_>, _>>()
        });
        let polygons = polygons.collect::<Result<Vec<_>, _>>()?;
        check_finite(&points, polygons.iter().flatten())?;
        Ok(PolygonSoup { points, polygons, notes })
    }

    /// The tets.
    ///
    /// # Errors
    /// A surface in their place.
    pub(super) fn into_tets(self) -> Result<TetFile, Fault> {
        if self.is_surface() {
            return Err((None, "the file holds a surface, polygons without tets, where tets are wanted".into()));
        }
        Ok(self.tets)
    }

    /// Whether there are polygons and no tets.
    pub(super) fn is_surface(&self) -> bool {
        self.tets.soup.tets.is_empty() && !self.polygons.is_empty()
    }
}

/// Triples of numbers as vectors.
pub(super) fn vectors(numbers: &[f64]) -> Vec<Vec3> {
    numbers.chunks_exact(3).map(Vec3::from_column_slice).collect()
}

fn known(points: &[Vec3], cell: usize, index: i64) -> Result<VertexId, Fault> {
    let known = u32::try_from(index).ok().filter(|&index| (index as usize) < points.len());
    known.map(VertexId).ok_or_else(|| {
        let count = points.len();
        (None, format!("cell {cell} names vertex {index}, but there are {count} vertices (all counted from 0)"))
    })
}

/// The triangles of a strip.
pub(super) fn triangles_of_strip(strip: &[i64]) -> impl Iterator<Item = Vec<i64>> {
    strip.windows(3).enumerate().map(|(place, corners)| {
        let [a, b, c] = [corners[0], corners[1], corners[2]];
        if place % 2 == 0 { vec![a, b, c] } else { vec![b, a, c] }
    })
}

/// A vertex that nothing names may be anything.
fn check_finite<'a>(points: &[Vec3], mut named: impl Iterator<Item = &'a VertexId>) -> Result<(), Fault> {
    match named.find(|v| !points[v.index()].iter().all(|x| x.is_finite())) {
        Some(v) => {
            Err((None, format!("vertex {} (counted from 0) has a coordinate that is not finite; repair it", v.0)))
        }
        None => Ok(()),
    }
}

/// The sides of each kind of cell, counter-clockwise seen from outside.
const HEXAHEDRON: [&[usize]; 6] =
    [&[0, 3, 2, 1], &[4, 5, 6, 7], &[0, 1, 5, 4], &[1, 2, 6, 5], &[2, 3, 7, 6], &[3, 0, 4, 7]];
const PRISM: [&[usize]; 5] = [&[0, 2, 1], &[3, 4, 5], &[0, 1, 4, 3], &[1, 2, 5, 4], &[2, 0, 3, 5]];
const PYRAMID: [&[usize]; 5] = [&[0, 3, 2, 1], &[0, 1, 4], &[1, 2, 4], &[2, 3, 4], &[3, 0, 4]];

/// Cuts a convex cell into tets: every side from its least vertex, and the cell from its least over the sides that lack it.
///
/// Since only the order of the vertices decides, two cells cut their common side alike (Dompierre, Labbe, Vallet and
/// Camarero, *How to Subdivide Pyramids, Prisms and Hexahedra into Tetrahedra*, IMR 1999). A cell with a vertex in several
/// corners has fewer tets.
fn split(sides: &[&[usize]], vertices: &[i64]) -> Vec<[i64; 4]> {
    let sides = sides.iter().map(|side| side.iter().map(|&corner| vertices[corner]).collect::<Vec<i64>>());
    let least = sides.clone().flatten().min().expect("a cell has sides");
    let mut tets = Vec::with_capacity(6);
    for mut side in sides.filter(|side| !side.contains(&least)) {
        let start = (0..side.len()).min_by_key(|&i| side[i]).expect("a side has corners");
        side.rotate_left(start);
        for edge in side[1..].windows(2) {
            let tet = [least, side[0], edge[0], edge[1]];
            if side[0] != edge[0] && edge[0] != edge[1] && side[0] != edge[1] {
                tets.push(tet);
            }
        }
    }
    tets
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::*;
    use crate::mesh::TetMesh;

    /// A cell with its corners numbered as told, cut, as a mesh.
    fn cut(shape: Shape, points: &[[f64; 3]], numbers: &[i64]) -> TetMesh {
        let mut cells = Cells::default();
        cells.push(shape, numbers);
        let mut coordinates = vec![0.0; 3 * points.len()];
        for (&number, point) in numbers.iter().zip(points) {
            coordinates[3 * number as usize..][..3].copy_from_slice(point);
        }
        let TetSoup { points, tets, .. } = cells.finish(coordinates, vec![]).unwrap().tets.soup;
        // All of positive volume.
        TetMesh::new(points, tets).unwrap()
    }

    fn volume(mesh: &TetMesh) -> f64 {
        let tets = (0..mesh.tets().len() as u32).map(crate::mesh::TetId);
        tets.map(|tet| crate::mesh::edge_matrix(mesh.corners(tet)).determinant() / 6.0).sum()
    }

    #[test]
    fn every_numbering_of_a_cell_is_cut_into_its_volume() {
        let cube = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]];
        let cube = cube.map(|p| p.map(f64::from));
        let prism = [cube[0], cube[1], cube[3], cube[4], cube[5], cube[7]];
        let pyramid = [cube[0], cube[1], cube[2], cube[3], cube[4]];
        for seed in 0..200i64 {
            let shuffled = |n: i64| {
                let mut numbers: Vec<i64> = (0..n).collect();
                numbers.sort_by_key(|i| (i + 1) * (2 * seed + 1) * 7919 % 10007);
                numbers
            };
            let cut = [
                (Shape::Hexahedron, &cube[..], 1.0, 6),
                (Shape::Prism, &prism[..], 0.5, 3),
                (Shape::Pyramid, &pyramid[..], 1.0 / 3.0, 2),
            ]
            .map(|(shape, points, wanted, count)| {
                let mesh = cut(shape, points, &shuffled(points.len() as i64));
                ((volume(&mesh) - wanted).abs() < 1e-15, mesh.tets().len() == count)
            });
            assert_eq!(cut, [(true, true); 3], "{seed}");
        }
    }

    #[test]
    fn neighbours_cut_their_common_sides_alike() {
        // Two by two by two cubes with vertices numbered at random: only the 48 triangles of the outside belong to one tet.
        let number = |[i, j, k]: [i64; 3]| (i + 3 * j + 9 * k) * 20 % 27;
        let mut cells = Cells::default();
        for place in 0..8i64 {
            let [i, j, k] = [place % 2, place / 2 % 2, place / 4];
            let corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]];
            cells.push(Shape::Hexahedron, &corners.map(|[a, b, c]| number([i + a, j + b, k + c])));
        }
        let mut faces: HashMap<[i64; 3], usize> = HashMap::new();
        for tet in &cells.tets {
            for opposite in 0..4 {
                let mut face: Vec<i64> = (0..4).filter(|&i| i != opposite).map(|i| tet[i]).collect();
                face.sort_unstable();
                *faces.entry([face[0], face[1], face[2]]).or_default() += 1;
            }
        }
        assert_eq!(faces.values().filter(|&&count| count == 1).count(), 48);
        assert!(faces.values().all(|&count| count <= 2));
    }
}

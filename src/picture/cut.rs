//! What planes leave of a mesh, as polygons.

use std::str::FromStr;

use super::PictureError;
use super::figures::PanelFigures;
use crate::mesh::{Cells, Vec3, VertexId};

/// The tets that fill a box, all along the diagonal from its first to its last corner.
const BOX_TETS: [[usize; 4]; 6] = [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]];

/// A plane n . x = d of the domain; the side n . x > d is cut away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    normal: Vec3,
    offset: f64,
}

impl Cut {
    /// The plane with the normal n, of any length, and d.
    ///
    /// # Errors
    /// A normal of length 0, or a number that is not finite.
    pub fn new(normal: Vec3, offset: f64) -> Result<Self, PictureError> {
        let finite = normal.iter().all(|x| x.is_finite()) && offset.is_finite();
        if finite && normal != Vec3::zeros() { Ok(Self { normal, offset }) } else { Err(PictureError::Plane) }
    }

    /// Positive where cut away.
    fn distance(&self, point: &Vec3) -> f64 {
        self.normal.dot(point) - self.offset
    }
}

impl FromStr for Cut {
    type Err = PictureError;

    /// Reads `nx,ny,nz,d`.
    fn from_str(text: &str) -> Result<Self, PictureError> {
        let numbers: Vec<f64> = text.split(',').map(|number| number.trim().parse().unwrap_or(f64::NAN)).collect();
        match numbers.as_slice() {
            &[x, y, z, offset] => Self::new(Vec3::new(x, y, z), offset),
            _ => Err(PictureError::Plane),
        }
    }
}

/// A corner of a polygon.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Corner {
    /// Where it lies in the domain.
    pub(super) domain: Vec3,
    /// Where it is drawn.
    pub(super) shown: Vec3,
    /// The figure of the vertices there.
    pub(super) value: f64,
}

impl Corner {
    fn between(&self, other: &Self, part: f64) -> Self {
        Self {
            domain: self.domain.lerp(&other.domain, part),
            shown: self.shown.lerp(&other.shown, part),
            value: self.value + part * (other.value - self.value),
        }
    }
}

/// How the side from a corner to the next is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Side {
    /// Not at all.
    Hidden,
    /// As a thin line.
    Plain,
    /// In the colour of its figure.
    Edge(f64),
}

/// A flat piece of the boundary or of a section (in the image it may be bent where boxes are mapped).
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Polygon {
    /// Three or more corners, each with the side to the next.
    pub(super) corners: Vec<(Corner, Side)>,
    /// The cell it bounds or cuts.
    pub(super) cell: usize,
    /// Whether it lies on the boundary of the mesh.
    pub(super) boundary: bool,
}

impl Polygon {
    /// The part where the distance from a plane is at most 0 (or at least 0), if it is more than a segment. The new side is
    /// hidden.
    fn clipped(&self, cut: &Cut, sign: f64) -> Option<Self> {
        let distance = |corner: &Corner| sign * cut.distance(&corner.domain);
        let mut corners = Vec::with_capacity(self.corners.len() + 1);
        for (i, (from, side)) in self.corners.iter().enumerate() {
            let to = &self.corners[(i + 1) % self.corners.len()].0;
            let (start, end) = (distance(from), distance(to));
            let crossing = || from.between(to, start / (start - end));
            if start <= 0.0 {
                corners.push((from.clone(), if start == 0.0 && end > 0.0 { Side::Hidden } else { *side }));
                if start < 0.0 && end > 0.0 {
                    corners.push((crossing(), Side::Hidden));
                }
            } else if end < 0.0 {
                corners.push((crossing(), *side));
            }
        }
        (corners.len() >= 3).then_some(Self { corners, ..*self })
    }
}

/// The boundary of what is left when the points beyond all of `cuts` are taken away: the boundary of the mesh first, then the
/// sections.
pub(super) fn polygons(
    cells: Cells,
    domain: &[Vec3],
    shown: &[Vec3],
    figures: PanelFigures,
    cuts: &[Cut],
) -> Vec<Polygon> {
    let corner = |v: VertexId| Corner {
        domain: domain[v.index()],
        shown: shown[v.index()],
        value: figures.vertices.map_or(0.0, |values| values[v.index()]),
    };
    let side = |from: VertexId, to: VertexId| {
        let found = figures.edges.and_then(|edges| edges.get(&[from.min(to), from.max(to)]));
        found.map_or(Side::Plain, |value| Side::Edge(*value))
    };
    let mut polygons = Vec::new();
    for (cell, face) in cells.boundary_faces() {
        let next = |i: usize| face[(i + 1) % face.len()];
        let corners = face.iter().enumerate().map(|(i, &v)| (corner(v), side(v, next(i)))).collect();
        keep(Polygon { corners, cell, boundary: true }, cuts, &mut polygons);
    }
    for (index, cut) in cuts.iter().enumerate() {
        for cell in 0..cells.len() {
            let vertices = cells.vertices(cell);
            let (tets, side): (&[[usize; 4]], Side) = match cells {
                Cells::Tets(_) => (&[[0, 1, 2, 3]], Side::Plain),
                Cells::Hexahedra(_) => (&BOX_TETS, Side::Hidden),
            };
            for tet in tets {
                let whole = section(tet.map(|i| corner(vertices[i])), cut)
                    .map(|corners| corners.into_iter().map(|corner| (corner, side)).collect())
                    .map(|corners| Polygon { corners, cell, boundary: false });
                // What of the section lies beyond the other planes.
                let others = cuts.iter().enumerate().filter(|(other, _)| *other != index);
                let part = others.fold(whole, |part, (_, other)| part.and_then(|part| part.clipped(other, -1.0)));
                polygons.extend(part);
            }
        }
    }
    polygons
}

/// The convex parts of a polygon that are left.
fn keep(polygon: Polygon, cuts: &[Cut], polygons: &mut Vec<Polygon>) {
    if cuts.is_empty() {
        polygons.push(polygon);
        return;
    }
    let mut rest = Some(polygon);
    for cut in cuts {
        let Some(part) = rest else { return };
        polygons.extend(part.clipped(cut, 1.0));
        rest = part.clipped(cut, -1.0);
    }
}

/// Where a plane cuts a tet that is not cut away as a whole: three or four corners in their order round the section.
fn section(tet: [Corner; 4], cut: &Cut) -> Option<Vec<Corner>> {
    let distances = [0, 1, 2, 3].map(|i| cut.distance(&tet[i].domain));
    if distances.iter().all(|distance| *distance >= 0.0) || distances.iter().all(|distance| *distance < 0.0) {
        return None;
    }
    let mut corners: Vec<Corner> = (0..4).filter(|&i| distances[i] == 0.0).map(|i| tet[i].clone()).collect();
    for i in 0..4 {
        for j in 0..i {
            if distances[i] * distances[j] < 0.0 {
                corners.push(tet[i].between(&tet[j], distances[i] / (distances[i] - distances[j])));
            }
        }
    }
    if corners.len() < 3 {
        return None;
    }
    let middle = corners.iter().map(|corner| corner.domain).sum::<Vec3>() / corners.len() as f64;
    let first = corners[0].domain - middle;
    let second = cut.normal.cross(&first);
    let angle = |corner: &Corner| {
        let from = corner.domain - middle;
        // The second axis is as long as the first times the normal.
        (from.dot(&second) / cut.normal.norm()).atan2(from.dot(&first))
    };
    corners.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
    Some(corners)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{TetMesh, VoxelMesh};
    use crate::solid::{CentreChoice, ShellSettings, Solid, shell_mesh, star_centre};

    const NONE: PanelFigures = PanelFigures { vertices: None, edges: None };

    fn area(polygon: &Polygon) -> f64 {
        let at = |i: usize| polygon.corners[i].0.domain;
        let parts = (1..polygon.corners.len() - 1).map(|i| (at(i) - at(0)).cross(&(at(i + 1) - at(0))));
        parts.sum::<Vec3>().norm() / 2.0
    }

    fn areas(cells: Cells, points: &[Vec3], cuts: &[Cut]) -> [f64; 2] {
        let polygons = polygons(cells, points, points, NONE, cuts);
        [true, false].map(|boundary| polygons.iter().filter(|p| p.boundary == boundary).map(area).sum())
    }

    fn cut(normal: [f64; 3], offset: f64) -> Cut {
        Cut::new(normal.into(), offset).unwrap()
    }

    fn cube() -> TetMesh {
        let surface = Solid::Cube.surface().unwrap();
        let centre = star_centre(&surface, &CentreChoice::Kernel).unwrap();
        let settings = ShellSettings { subdivisions: 2, refinement: None, layers: 3, grading: 1.0 };
        shell_mesh(&surface, centre.position, &settings).unwrap().mesh
    }

    #[test]
    fn cuts_of_the_cube_leave_the_areas_of_its_faces_and_sections() {
        let mesh = cube();
        let areas = |cuts: &[Cut]| areas((&mesh).into(), mesh.points(), cuts);
        let close = |found: [f64; 2], expected: [f64; 2]| {
            assert!((0..2).all(|i| (found[i] - expected[i]).abs() < 1e-9), "{found:?}, not {expected:?}");
        };
        close(areas(&[]), [24.0, 0.0]);
        // Through tets, and along faces of the mesh, which belong to the tets that stay.
        close(areas(&[cut([2.0, 0.0, 0.0], 0.6)]), [24.0 - 4.0 - 4.0 * 2.0 * 0.7, 4.0]);
        close(areas(&[cut([1.0, 0.0, 0.0], 0.0)]), [24.0 - 4.0 - 8.0, 4.0]);
        // An octant: three squares of the surface against three inside.
        let octant = [cut([1.0, 0.0, 0.0], 0.0), cut([0.0, -1.0, 0.0], 0.0), cut([0.0, 0.0, 1.0], 0.0)];
        close(areas(&octant), [21.0, 3.0]);
        // The regular hexagon across the long diagonal, with sides of length 2^(1/2).
        close(areas(&[cut([1.0, 1.0, 1.0], 0.0)]), [12.0, 3.0 * 3f64.sqrt()]);
        // Nothing is beyond, or everything.
        close(areas(&[cut([0.0, 1.0, 0.0], 2.0)]), [24.0, 0.0]);
        close(areas(&[cut([0.0, 1.0, 0.0], -2.0)]), [0.0, 0.0]);
    }

    #[test]
    fn boxes_are_cut_like_tets() {
        let corner = |i: usize| Vec3::new((i & 1) as f64, 2.0 * (i >> 1 & 1) as f64, 3.0 * (i >> 2) as f64);
        let points: Vec<Vec3> = (0..8).map(corner).collect();
        let mesh = VoxelMesh::new(points.clone(), vec![std::array::from_fn(|i| VertexId(i as u32))]).unwrap();
        let found = areas((&mesh).into(), &points, &[cut([0.0, 0.0, 1.0], 1.0)]);
        assert!((found[0] - (2.0 + 6.0)).abs() < 1e-12 && (found[1] - 2.0).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn planes_are_read() {
        assert_eq!("1, 0,0,0.5".parse(), Ok(cut([1.0, 0.0, 0.0], 0.5)));
        for text in ["", "1,0,0", "0,0,0,1", "1,0,x,0", "inf,0,0,0", "1,0,0,0,0"] {
            assert_eq!(text.parse::<Cut>(), Err(PictureError::Plane), "{text}");
        }
    }
}

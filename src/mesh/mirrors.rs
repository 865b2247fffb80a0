//! Mirror planes of a mesh, and the part of it that they repeat.

use std::collections::{HashMap, HashSet};

use super::{Mat3, TetId, TetMesh, Vec3};

/// How near points must be to be the same, relative to the mesh's size: points of a mesh that was made alike on both sides of a plane
/// differ by rounding.
const SAME: f64 = 1e-8;

/// The group of symmetries of a mesh that its mirror planes through a point generate, and a chamber: the part between planes that the
/// group repeats.
#[derive(Clone, Debug)]
pub struct Mirrors {
    /// Unit normals, towards the chamber.
    planes: Vec<Vec3>,
    tets: Vec<TetId>,
    vertices: Vec<u32>,
    /// For each vertex of the mesh the vertex of the chamber, as its place in `vertices`, and the symmetry that takes that one there.
    of_vertex: Vec<(u32, Mat3)>,
    /// For each vertex of the chamber the projection to the planes that it lies on.
    within: Vec<Mat3>,
}

impl Mirrors {
    /// Finds the mirror planes of a mesh among those through `centre` that exchange two of the points `corners`: of a polyhedron they are
    /// all. `None` where there is no such plane, or a tet lies across one.
    pub fn of(mesh: &TetMesh, centre: &Vec3, corners: &[Vec3]) -> Option<Self> {
        let points: Vec<Vec3> = mesh.points().iter().map(|p| p - centre).collect();
        let size = points.iter().map(|p| p.amax()).fold(0.0, f64::max);
        let near = SAME * size;
        let places = Places::new(&points, near);
        let mut tets: HashSet<[u32; 4]> = mesh.tets().iter().map(|tet| sorted(tet.map(|v| v.0))).collect();
        tets.shrink_to_fit();
        let is_mirror = |normal: &Vec3| {
            let image: Option<Vec<u32>> = points.iter().map(|p| places.at(&reflected(p, normal))).collect();
            let goes =
                |image: &[u32]| mesh.tets().iter().all(|tet| tets.contains(&sorted(tet.map(|v| image[v.index()]))));
            image.is_some_and(|image| goes(&image))
        };
        let mut planes: Vec<Vec3> = Vec::new();
        let offsets: Vec<Vec3> = corners.iter().map(|corner| corner - centre).collect();
        for (i, p) in offsets.iter().enumerate() {
            for q in &offsets[..i] {
                let normal = (p - q).normalize();
                let known = |plane: &Vec3| plane.cross(&normal).norm() < SAME;
                if (p.norm() - q.norm()).abs() < near && !planes.iter().any(known) && is_mirror(&normal) {
                    planes.push(normal);
                }
            }
        }
        let inside: Vec3 = mesh.tets().first()?.iter().map(|v| points[v.index()]).sum::<Vec3>() * 0.25;
        planes.iter_mut().for_each(|plane| *plane *= plane.dot(&inside).signum());
        let in_chamber = |p: &Vec3| planes.iter().all(|plane| plane.dot(p) >= -near);
        let chosen: Vec<TetId> = (0u32..)
            .zip(mesh.tets())
            .filter(|(_, tet)| in_chamber(&(tet.iter().map(|v| points[v.index()]).sum::<Vec3>() * 0.25)))
            .map(|(tet, _)| TetId(tet))
            .collect();
        let of_tets = chosen.iter().flat_map(|tet| mesh.tets()[tet.index()]);
        let mut vertices: Vec<u32> = of_tets.map(|v| v.0).collect();
        vertices.sort_unstable();
        vertices.dedup();
        let whole = vertices.iter().all(|&v| in_chamber(&points[v as usize]));
        if planes.is_empty() || !whole {
            return None;
        }
        let place_of: HashMap<u32, u32> = vertices.iter().copied().zip(0..).collect();
        let folded = |p: &Vec3| -> Option<(u32, Mat3)> {
            let (mut p, mut back) = (*p, Mat3::identity());
            // A reflection takes a point nearer to the chamber; no group of planes needs as many.
            for _ in 0..100 {
                let Some(plane) = planes.iter().find(|plane| plane.dot(&p) < -near) else {
                    return Some((*place_of.get(&places.at(&p)?)?, back));
                };
                p = reflected(&p, plane);
                back *= Mat3::identity() - plane * plane.transpose() * 2.0;
            }
            None
        };
        let of_vertex: Option<Vec<(u32, Mat3)>> = points.iter().map(folded).collect();
        let within = vertices.iter().map(|&v| {
            let on = planes.iter().filter(|plane| plane.dot(&points[v as usize]).abs() <= near);
            projection(on)
        });
        Some(Self { within: within.collect(), of_vertex: of_vertex?, planes, tets: chosen, vertices })
    }

    /// The number of planes.
    pub fn planes(&self) -> usize {
        self.planes.len()
    }

    /// The tets of the chamber.
    pub fn tets(&self) -> &[TetId] {
        &self.tets
    }

    /// The vertices of the chamber, ascending.
    pub fn vertices(&self) -> &[u32] {
        &self.vertices
    }

    /// The place among the chamber's vertices of the one that a symmetry takes to this vertex.
    pub fn in_chamber(&self, vertex: usize) -> u32 {
        self.of_vertex[vertex].0
    }

    /// For each vertex of the chamber the projection to the planes that it lies on, and that a symmetric map keeps it on.
    pub fn within(&self) -> &[Mat3] {
        &self.within
    }

    /// Positions of the chamber's vertices, put on the planes that they are near to.
    pub fn folded(&self, image: &[Vec3]) -> Vec<Vec3> {
        self.vertices.iter().zip(&self.within).map(|(&v, within)| within * image[v as usize]).collect()
    }

    /// Positions of all vertices from those of the chamber's, by the symmetries about 0.
    pub fn unfolded(&self, chamber: &[Vec3]) -> Vec<Vec3> {
        self.of_vertex.iter().map(|(vertex, symmetry)| symmetry * chamber[*vertex as usize]).collect()
    }
}

fn reflected(p: &Vec3, normal: &Vec3) -> Vec3 {
    p - normal * (2.0 * normal.dot(p))
}

/// The projection to the planes with these unit normals, together.
fn projection<'n>(normals: impl Iterator<Item = &'n Vec3>) -> Mat3 {
    let mut projection = Mat3::identity();
    for normal in normals {
        let left = projection * normal;
        // Three planes may share a line.
        if left.norm() > 1e-6 {
            let unit = left.normalize();
            projection -= unit * unit.transpose();
        }
    }
    // What is left where three directions are taken away is rounding.
    if projection.trace() < 0.5 { Mat3::zeros() } else { projection }
}

fn sorted(mut tet: [u32; 4]) -> [u32; 4] {
    tet.sort_unstable();
    tet
}

/// Points by their place.
struct Places<'p> {
    points: &'p [Vec3],
    near: f64,
    /// Cells of four times the distance within which points are the same.
    cells: HashMap<[i64; 3], Vec<u32>>,
}

impl<'p> Places<'p> {
    fn new(points: &'p [Vec3], near: f64) -> Self {
        let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
        for (index, point) in (0..).zip(points) {
            cells.entry(Self::cell(point, near)).or_default().push(index);
        }
        Self { points, near, cells }
    }

    fn cell(point: &Vec3, near: f64) -> [i64; 3] {
        [0, 1, 2].map(|axis| (point[axis] / (4.0 * near)).floor() as i64)
    }

    /// The point at a place.
    fn at(&self, place: &Vec3) -> Option<u32> {
        let reach = Vec3::repeat(self.near);
        let [low, high] = [place - reach, place + reach].map(|end| Self::cell(&end, self.near));
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    let found = self.cells.get(&[x, y, z]).into_iter().flatten();
                    let is_there = |index: &&u32| (self.points[**index as usize] - place).amax() <= self.near;
                    if let Some(index) = { found }.find(is_there) {
                        return Some(*index);
                    }
                }
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solid::{CentreChoice, FlagSettings, Solid, flag_mesh, star_centre};

    #[test]
    fn solids_are_made_of_chambers() {
        let settings = FlagSettings { sectors: 2, rings: 3, layers: 2, grading: 1.5, layer_grading: 1.5 };
        for (solid, planes, order) in [
            (Solid::Tetrahedron, 6, 24),
            (Solid::Cube, 9, 48),
            (Solid::Octahedron, 9, 48),
            (Solid::Icosahedron, 15, 120),
            (Solid::Box { size: [1.0, 1.0, 2.0] }, 5, 16),
            (Solid::Prism { sides: 5, height: 1.0 }, 6, 20),
            (Solid::Pyramid { sides: 4, height: 1.0 }, 4, 8),
        ] {
            let surface = solid.surface().unwrap();
            let centre = star_centre(&surface, &CentreChoice::Kernel).unwrap().position;
            let mesh = flag_mesh(&surface, centre, &settings).unwrap().mesh;
            let mirrors = Mirrors::of(&mesh, &centre, surface.points()).unwrap();
            assert_eq!((mirrors.planes(), mesh.tets().len()), (planes, order * mirrors.tets().len()), "{solid:?}");
            // The mesh itself is a symmetric map of it.
            let image: Vec<Vec3> = mesh.points().iter().map(|p| p - centre).collect();
            let again = mirrors.unfolded(&mirrors.folded(&image));
            let off = again.iter().zip(&image).map(|(a, b)| (a - b).amax()).fold(0.0, f64::max);
            assert!(off < 1e-13 * mesh.points().iter().map(|p| p.amax()).fold(1.0, f64::max), "{solid:?}: {off}");
        }
        // Without a mirror plane.
        let surface = Solid::Cube.surface().unwrap();
        let mesh = flag_mesh(&surface, Vec3::new(0.1, 0.2, 0.3), &settings).unwrap().mesh;
        assert!(Mirrors::of(&mesh, &Vec3::new(0.1, 0.2, 0.3), surface.points()).is_none());
    }
}

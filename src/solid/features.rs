//! Sharp features of a surface: flat faces, sharp edges, corners.

use std::f64::consts::PI;

use super::Surface;
use crate::mesh::{DisjointSets, TriangleId, VertexId};

/// From which angles on an edge counts as flat or as sharp; radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FeatureAngles {
    /// Triangles belong to one flat face if the dihedral angle at their common edge differs from pi by less.
    pub flat: f64,
    /// An edge is sharp if its dihedral angle differs from pi by more; two sharp edges run on through a vertex if they
    /// turn by less.
    pub sharp: f64,
}

impl Default for FeatureAngles {
    /// Flat below 1e-4: files with six digits bend flat faces by about 1e-5, and a sphere would need 1e9 triangles to be
    /// as flat. Sharp above 20 degrees: all Platonic solids and prisms of up to 17 sides have only sharp edges, a ball
    /// of resolution 4 or more has none.
    fn default() -> Self {
        Self { flat: 1e-4, sharp: PI / 9.0 }
    }
}

/// The flat faces, sharp edges and corners of a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Features {
    face_of: Vec<u32>,
    face_count: usize,
    sharp_edges: Vec<usize>,
    corners: Vec<VertexId>,
}

impl Features {
    /// Finds them from the dihedral angles.
    pub fn of(surface: &Surface, angles: &FeatureAngles) -> Self {
        let mut faces = DisjointSets::new(surface.triangles().len());
        let mut sharp_edges = Vec::new();
        for (index, edge) in surface.edges().iter().enumerate() {
            let bend = (surface.dihedral_angle(edge) - PI).abs();
            if bend < angles.flat {
                faces.join(edge.triangles[0].0, edge.triangles[1].0);
            }
            if bend > angles.sharp {
                sharp_edges.push(index);
            }
        }
        // Roots are the smallest triangles of their sets: numbering them as they come numbers faces by first triangle.
        let mut face_of = vec![0; surface.triangles().len()];
        let mut face_count = 0;
        for triangle in 0..face_of.len() {
            let root = faces.root(triangle as u32) as usize;
            face_of[triangle] = if root == triangle { face_count } else { face_of[root] };
            face_count += u32::from(root == triangle);
        }
        let corners = corners(surface, &sharp_edges, angles.sharp);
        Self { face_of, face_count: face_count as usize, sharp_edges, corners }
    }

    /// Number of flat faces: maximal sets of triangles that are coplanar with their neighbours. For a polyhedron its
    /// number of faces, m of paper eq. 41; for a smooth surface the number of its triangles.
    pub fn face_count(&self) -> usize {
        self.face_count
    }

    /// The flat face of a triangle, in `0..face_count`, numbered by first triangle.
    pub fn face_of(&self, triangle: TriangleId) -> u32 {
        self.face_of[triangle.index()]
    }

    /// The sharp edges, as positions in [`Surface::edges`], in rising order.
    pub fn sharp_edges(&self) -> &[usize] {
        &self.sharp_edges
    }

    /// The vertices where sharp edges meet, end or turn: any number of sharp edges but two that run on through.
    pub fn corners(&self) -> &[VertexId] {
        &self.corners
    }
}

fn corners(surface: &Surface, sharp_edges: &[usize], turn: f64) -> Vec<VertexId> {
    let points = surface.points();
    let mut ends = vec![Vec::new(); points.len()];
    for &index in sharp_edges {
        let [from, to] = surface.edges()[index].vertices;
        let along = points[to.index()] - points[from.index()];
        ends[from.index()].push(along);
        ends[to.index()].push(-along);
    }
    let is_corner = |ends: &[crate::mesh::Vec3]| match ends {
        [] => false,
        [first, second] => first.angle(&-second) > turn,
        _ => true,
    };
    (0..).map(VertexId).zip(&ends).filter(|(_, ends)| is_corner(ends)).map(|(vertex, _)| vertex).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solid::Solid;

    /// Faces, sharp edges (as pieces: halves of the solid's edges for polyhedra) and corners.
    fn count(solid: Solid) -> (usize, usize, usize) {
        let features = Features::of(&solid.surface().unwrap(), &FeatureAngles::default());
        (features.face_count(), features.sharp_edges().len(), features.corners().len())
    }

    #[test]
    fn polyhedra_have_their_faces_edges_and_corners() {
        assert_eq!(count(Solid::Tetrahedron), (4, 2 * 6, 4));
        assert_eq!(count(Solid::Cube), (6, 2 * 12, 8));
        assert_eq!(count(Solid::Octahedron), (8, 2 * 12, 6));
        assert_eq!(count(Solid::Dodecahedron), (12, 2 * 30, 20));
        assert_eq!(count(Solid::Icosahedron), (20, 2 * 30, 12));
        assert_eq!(count(Solid::Prism { sides: 17, height: 1.0 }), (19, 2 * 51, 34));
        assert_eq!(count(Solid::Pyramid { sides: 5, height: 1.0 }), (6, 2 * 10, 6));
    }

    #[test]
    fn smooth_surfaces_have_no_sharp_edges() {
        assert_eq!(count(Solid::Ball { radius: 3.0, resolution: 4 }), (320, 0, 0));
    }

    #[test]
    fn a_round_rim_has_sharp_edges_but_no_corners() {
        // A prism with many sides: its two rims are sharp, its mantle is not.
        assert_eq!(count(Solid::Prism { sides: 60, height: 9.0 }), (62, 2 * 120, 0));
    }

    #[test]
    fn triangles_of_a_face_share_its_number() {
        let surface = Solid::Cube.surface().unwrap();
        let features = Features::of(&surface, &FeatureAngles::default());
        for triangle in surface.ids() {
            assert_eq!(features.face_of(triangle), triangle.0 / 8);
        }
    }
}

//! The feature of the domain on which the worst cells sit.

use std::mem::discriminant;

use serde::{Deserialize, Serialize};

use super::Measured;
use crate::domain::Domain;
use crate::mesh::{Boundary, BoundaryEdges, Features, Place, TetId, TetMesh, Vec3, VertexId};

/// Cells within this fraction of the largest K count as active: at an optimum several cells tie up to the optimizer's
/// tolerance, and one of them may be less telling than its neighbour.
const ACTIVE: f64 = 1e-3;

/// Where the largest dilatation sits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bottleneck {
    /// The feature of the domain's boundary.
    pub place: Place,
    /// Whether the active cells do not touch the boundary, so that `place` is only the nearest feature.
    pub interior: bool,
    /// The active cell of lowest index at the place.
    pub tet: TetId,
    /// How many cells have a K within 0.1 % of the largest.
    pub active: usize,
    /// On how many features of the same kind as `place` active cells sit: all corners of a symmetric solid, say. 1 if the
    /// active cells are inside.
    pub places: usize,
}

/// How telling a feature is; the least is reported, ties by the index of the vertex, edge or triangle.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Rank {
    Corner(VertexId),
    SharpEdge(usize),
    Face(usize),
}

/// The features of a domain's boundary, and for each vertex the sharpest at it.
struct Sharpest<'a> {
    mesh: &'a TetMesh,
    boundary: &'a Boundary,
    edges: BoundaryEdges,
    features: Features,
    at: Vec<Option<Rank>>,
}

impl<'a> Sharpest<'a> {
    fn of(mesh: &'a TetMesh, boundary: &'a Boundary) -> Self {
        let edges = BoundaryEdges::of(mesh, boundary);
        let features = Features::of(mesh, boundary, &edges);
        let mut at: Vec<Option<Rank>> = vec![None; mesh.points().len()];
        let mut offer = |vertex: VertexId, rank: Rank| {
            let slot = &mut at[vertex.index()];
            *slot = Some(slot.map_or(rank, |best| best.min(rank)));
        };
        for (index, triangle) in boundary.triangles().iter().enumerate() {
            for &vertex in triangle {
                offer(vertex, if features.is_corner(vertex) { Rank::Corner(vertex) } else { Rank::Face(index) });
            }
        }
        for (index, edge) in edges.edges().iter().enumerate().filter(|&(index, _)| features.sharp_edges()[index]) {
            edge.ends.iter().for_each(|&end| offer(end, Rank::SharpEdge(index)));
        }
        Self { mesh, boundary, edges, features, at }
    }

    /// The features of the sharpest kind on which cells sit, each with its cell of lowest index.
    fn under(&self, cells: &[TetId]) -> Vec<(Rank, TetId)> {
        let mut found: Vec<(Rank, TetId)> = cells
            .iter()
            .filter_map(|&tet| {
                let corners = self.mesh.tets()[tet.index()];
                let best = corners.iter().filter_map(|v| self.at[v.index()]).min()?;
                let own = own_sharp_edge(&corners, &self.edges, &self.features);
                Some((own.map_or(best, |own| preferred(best, own)), tet))
            })
            .collect();
        found.sort_unstable();
        found.dedup_by_key(|(rank, _)| *rank);
        let kind = found.first().map(|(rank, _)| discriminant(rank));
        found.retain(|(rank, _)| Some(discriminant(rank)) == kind);
        found
    }

    fn place(&self, rank: Rank) -> Place {
        match rank {
            Rank::Corner(vertex) => Place::vertex(self.mesh, vertex),
            Rank::SharpEdge(index) => Place::edge(self.mesh, self.edges.edges()[index].ends),
            Rank::Face(index) => Place::face(self.mesh, self.boundary.triangles()[index]),
        }
    }
}

/// All features on which active cells sit, of the kind of the one that [`bottleneck`] names, which is the first; none if the
/// cells are inside.
pub fn bottleneck_places(mesh: &TetMesh, boundary: &Boundary, active: &[TetId]) -> Vec<Place> {
    let sharpest = Sharpest::of(mesh, boundary);
    sharpest.under(active).into_iter().map(|(rank, _)| sharpest.place(rank)).collect()
}

/// The sharpest feature of the domain on which an active cell sits: a corner among the vertices of an active cell, else a
/// sharp edge at one of its vertices (rather one of the cell's own edges), else a boundary triangle at one of them.
/// [`Features`] defines corner and sharp.
///
/// If no active cell touches the boundary, the feature at the boundary vertex nearest to the centroid of the worst cell.
/// `None` only for a mesh without boundary vertices.
pub fn bottleneck(domain: &Domain, measured: &Measured) -> Option<Bottleneck> {
    let mesh = domain.mesh();
    let sharpest = Sharpest::of(mesh, domain.boundary());
    let active = measured.active(ACTIVE);
    let found = sharpest.under(&active);
    let (rank, tet, interior) = match found.first().copied() {
        Some((rank, tet)) => (rank, tet, false),
        None => {
            let (tet, _) =
                (0..).map(TetId).zip(&measured.dilatations).reduce(|a, b| if b.1.k() > a.1.k() { b } else { a })?;
            let centroid = mesh.corners(tet).iter().sum::<Vec3>() / 4.0;
            let nearest = sharpest
                .at
                .iter()
                .zip(mesh.points())
                .filter_map(|(rank, point)| Some(((*rank)?, (point - centroid).norm_squared())))
                .reduce(|a, b| if b.1 < a.1 { b } else { a })?;
            (nearest.0, tet, true)
        }
    };
    let (place, places) = (sharpest.place(rank), found.len().max(1));
    Some(Bottleneck { place, interior, tet, active: active.len(), places })
}

/// The first sharp boundary edge that is an edge of the cell itself.
fn own_sharp_edge(corners: &[VertexId; 4], edges: &BoundaryEdges, features: &Features) -> Option<usize> {
    let pairs = (0..4).flat_map(|i| (0..i).map(move |j| [corners[i], corners[j]]));
    pairs.filter_map(|ends| edges.position(ends)).filter(|&index| features.sharp_edges()[index]).min()
}

/// The cell's own sharp edge instead of another one at its vertices; a corner stays.
fn preferred(best: Rank, own: usize) -> Rank {
    if matches!(best, Rank::Corner(_)) { best } else { Rank::SharpEdge(own) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dilatation::Dilatation;
    use crate::measure::measure;
    use crate::mesh::fixtures::{cube, fan, split};

    /// The cube's fan, cut twice, so that there are cells at corners, at edges, at faces and inside.
    fn domain() -> Domain {
        Domain::new(split(&split(&fan(&cube(), Vec3::zeros())))).unwrap()
    }

    /// The identity, with one cell's K replaced by 5.
    fn worst_at(domain: &Domain, tet: usize) -> Measured {
        let mut measured = measure(domain, domain.mesh().points());
        measured.dilatations[tet] = Dilatation { inner: 5.0, outer: 2.0 };
        measured.summary.max_k = 5.0;
        measured
    }

    #[test]
    fn the_sharpest_feature_of_the_worst_cell_is_named() {
        let domain = domain();
        let features = |tet: &[VertexId; 4]| tet.iter().filter(|v| v.0 < 8).count();
        let tets = domain.mesh().tets();
        for (index, tet) in tets.iter().enumerate() {
            let found = bottleneck(&domain, &worst_at(&domain, index)).unwrap();
            assert_eq!((found.tet.index(), found.active, found.places), (index, 1, 1));
            assert_eq!(found.interior, features(tet) == 0);
            // Every boundary vertex of this mesh is a corner of the cube.
            let Place::Vertex { vertex, .. } = found.place else { panic!("{found:?}") };
            let lowest = tet.iter().map(|v| v.0).min().unwrap();
            assert!(found.interior || vertex == lowest);
        }
    }

    #[test]
    fn all_corners_of_a_symmetric_map_are_counted() {
        // The identity: every cell attains K = 1, so all eight corners are places.
        let domain = domain();
        let found = bottleneck(&domain, &measure(&domain, domain.mesh().points())).unwrap();
        assert_eq!((found.active, found.places), (domain.mesh().tets().len(), 8));
        let all: Vec<TetId> = (0..domain.mesh().tets().len() as u32).map(TetId).collect();
        let places = bottleneck_places(domain.mesh(), domain.boundary(), &all);
        assert_eq!((places.len(), &places[0]), (8, &found.place));
    }

    #[test]
    fn cells_on_an_edge_or_a_face_are_told_apart() {
        // A triangle of the top face cut in three and one edge of the cube cut in two by hand.
        let (mut points, mut faces) = cube();
        let on_face = points.len() as u32;
        points.push(Vec3::new(0.2, 0.1, 1.0));
        let on_edge = points.len() as u32;
        points.push(Vec3::new(0.0, -1.0, -1.0));
        let position = faces.iter().position(|face| face.iter().all(|&v| v & 4 != 0)).unwrap();
        let top = faces.remove(position);
        faces.extend((0..4).map(|i| vec![top[i], top[(i + 1) % 4], on_face]));
        for face in &mut faces {
            if let Some(i) = (0..face.len()).find(|&i| {
                let ends = [face[i], face[(i + 1) % face.len()]];
                ends == [0, 1] || ends == [1, 0]
            }) {
                // First, so that the triangles of the fan all start there.
                face.rotate_left(i + 1);
                face.insert(0, on_edge);
            }
        }
        let mesh = split(&split(&fan(&(points, faces), Vec3::zeros())));
        let domain = Domain::new(mesh).unwrap();
        let corners = |tet: &[VertexId; 4]| tet.iter().any(|v| v.0 < 8);
        let mut seen = [0, 0];
        for (index, tet) in domain.mesh().tets().iter().enumerate().filter(|(_, tet)| !corners(tet)) {
            let place = bottleneck(&domain, &worst_at(&domain, index)).unwrap().place;
            if tet.contains(&VertexId(on_edge)) {
                assert_eq!(place, Place::edge(domain.mesh(), [VertexId(0), VertexId(on_edge)]));
                seen[0] += 1;
            } else if tet.contains(&VertexId(on_face)) {
                assert!(matches!(place, Place::Face { vertices, .. } if vertices.contains(&on_face)));
                seen[1] += 1;
            }
        }
        assert!(seen.iter().all(|&count| count > 0));
    }
}

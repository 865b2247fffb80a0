//! Splits that make the boundary of a mesh a full subcomplex, so that no tet is locked.

use std::collections::{HashMap, HashSet};

use super::{Boundary, MeshError, TetMesh, VertexId};

/// A mesh whose boundary is a full subcomplex: every interior edge and face has a vertex inside.
#[derive(Clone, Debug, PartialEq)]
pub struct FullBoundary {
    /// The split mesh; the old vertices keep their numbers, the new ones follow.
    pub mesh: TetMesh,
    /// For each new vertex, the two or three vertices it is the mean of; they may be new ones themselves.
    pub parents: Vec<Vec<VertexId>>,
    /// Number of interior edges that were halved.
    pub edge_splits: usize,
    /// Number of interior faces that were split at their centre.
    pub face_splits: usize,
}

impl FullBoundary {
    /// Extends values at the old vertices to the new ones by the means that made them.
    pub fn extend(&self, mut values: Vec<super::Vec3>) -> Vec<super::Vec3> {
        for parents in &self.parents {
            let sum: super::Vec3 = parents.iter().map(|v| values[v.index()]).sum();
            values.push(sum / parents.len() as f64);
        }
        values
    }
}

/// Halves interior edges that join boundary vertices, longest first, then splits interior faces whose vertices are all on
/// the boundary at their centres (design.md §5.2). A mesh that needs nothing is returned as it is.
///
/// Every tet with four boundary vertices is split, unless it is the whole mesh: what is locked with a fixed boundary
/// becomes free. New vertices lie inside, so the boundary is untouched.
///
/// # Errors
/// A split tet so thin that rounding made it flat.
pub fn full_boundary(mesh: &TetMesh, boundary: &Boundary) -> Result<FullBoundary, MeshError> {
    let mut work = Splitting {
        points: mesh.points().to_vec(),
        tets: mesh.tets().to_vec(),
        on_boundary: boundary.vertex_mask().to_vec(),
        parents: Vec::new(),
    };
    let boundary_edges: HashSet<[u32; 2]> =
        boundary.triangles().iter().flat_map(|t| [[0, 1], [1, 2], [2, 0]].map(|e| sorted(e.map(|i| t[i].0)))).collect();
    let mut edge_splits = 0;
    loop {
        let mut tets_at: HashMap<[u32; 2], Vec<usize>> = HashMap::new();
        for (index, tet) in work.tets.iter().enumerate() {
            for i in 0..4 {
                for j in 0..i {
                    let edge = sorted([tet[i].0, tet[j].0]);
                    if edge.iter().all(|&v| work.on_boundary[v as usize]) && !boundary_edges.contains(&edge) {
                        tets_at.entry(edge).or_default().push(index);
                    }
                }
            }
        }
        if tets_at.is_empty() {
            break;
        }
        let mut edges: Vec<([u32; 2], Vec<usize>)> = tets_at.into_iter().collect();
        let squared = |edge: &[u32; 2]| (work.points[edge[0] as usize] - work.points[edge[1] as usize]).norm_squared();
        edges.sort_by(|(a, _), (b, _)| squared(b).total_cmp(&squared(a)).then(a.cmp(b)));
        // Edges without a common tet are split in one round; the longest one always is, so every round makes progress.
        let mut touched = vec![false; work.tets.len()];
        for (edge, tets) in edges {
            if tets.iter().any(|&t| touched[t]) {
                continue;
            }
            tets.iter().for_each(|&t| touched[t] = true);
            work.split(&edge.map(VertexId), &tets);
            edge_splits += 1;
        }
    }
    let boundary_faces: HashSet<[u32; 3]> = boundary.triangles().iter().map(|t| sorted(t.map(|v| v.0))).collect();
    let mut face_splits = 0;
    loop {
        let mut tets_at: HashMap<[u32; 3], Vec<usize>> = HashMap::new();
        for (index, tet) in work.tets.iter().enumerate() {
            for face in TetMesh::FACES {
                let face = sorted(face.map(|i| tet[i].0));
                if face.iter().all(|&v| work.on_boundary[v as usize]) && !boundary_faces.contains(&face) {
                    tets_at.entry(face).or_default().push(index);
                }
            }
        }
        let mut faces: Vec<([u32; 3], Vec<usize>)> = tets_at.into_iter().collect();
        faces.sort();
        let mut touched = vec![false; work.tets.len()];
        let before = face_splits;
        for (face, tets) in faces {
            if tets.iter().any(|&t| touched[t]) {
                continue;
            }
            tets.iter().for_each(|&t| touched[t] = true);
            work.split(&face.map(VertexId), &tets);
            face_splits += 1;
        }
        if face_splits == before {
            break;
        }
    }
    let mesh = TetMesh::new(work.points, work.tets)?;
    Ok(FullBoundary { mesh, parents: work.parents, edge_splits, face_splits })
}

struct Splitting {
    points: Vec<super::Vec3>,
    tets: Vec<[VertexId; 4]>,
    on_boundary: Vec<bool>,
    parents: Vec<Vec<VertexId>>,
}

impl Splitting {
    /// Puts a vertex at the mean of a simplex's vertices and replaces each of its tets by one for each of them.
    fn split(&mut self, simplex: &[VertexId], tets: &[usize]) {
        let new = VertexId(self.points.len() as u32);
        let sum: super::Vec3 = simplex.iter().map(|v| self.points[v.index()]).sum();
        self.points.push(sum / simplex.len() as f64);
        self.on_boundary.push(false);
        self.parents.push(simplex.to_vec());
        for &index in tets {
            let old = self.tets[index];
            for (number, replaced) in simplex.iter().enumerate() {
                let tet = old.map(|v| if v == *replaced { new } else { v });
                if number == 0 {
                    self.tets[index] = tet;
                } else {
                    self.tets.push(tet);
                }
            }
        }
    }
}

fn sorted<const N: usize>(mut simplex: [u32; N]) -> [u32; N] {
    simplex.sort_unstable();
    simplex
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Vec3;

    fn split(points: Vec<Vec3>, tets: &[[u32; 4]]) -> (TetMesh, FullBoundary) {
        let tets = tets.iter().map(|t| t.map(VertexId)).collect();
        let mesh = TetMesh::from_either_orientation(points, tets).unwrap().0;
        let boundary = Boundary::of(&mesh).unwrap();
        let full = full_boundary(&mesh, &boundary).unwrap();
        (mesh, full)
    }

    fn volume(mesh: &TetMesh) -> f64 {
        (0..mesh.tets().len() as u32)
            .map(|t| {
                let [a, b, c, d] = mesh.corners(crate::mesh::TetId(t));
                (b - a).cross(&(c - a)).dot(&(d - a)) / 6.0
            })
            .sum()
    }

    #[test]
    fn a_shared_face_is_split_at_its_centre() {
        let points = vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z(), Vec3::new(0.6, 0.7, 0.8)];
        let (mesh, full) = split(points, &[[0, 1, 2, 3], [1, 2, 3, 4]]);
        assert_eq!((full.edge_splits, full.face_splits, full.mesh.tets().len()), (0, 1, 6));
        assert!((volume(&full.mesh) - volume(&mesh)).abs() < 1e-15);
        assert_eq!(Boundary::of(&full.mesh).unwrap().triangles().len(), 6);
    }

    #[test]
    fn every_tet_of_a_cut_cube_is_freed() {
        // Kuhn's six tets round the diagonal 0-7: one interior edge, all vertices on the boundary.
        let points = (0..8).map(|i| Vec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64)).collect();
        let tets = [[0, 1, 3, 7], [0, 1, 5, 7], [0, 2, 3, 7], [0, 2, 6, 7], [0, 4, 5, 7], [0, 4, 6, 7]];
        let (mesh, full) = split(points, &tets);
        let boundary = Boundary::of(&full.mesh).unwrap();
        assert_eq!(boundary.triangles().len(), 12);
        assert_eq!((full.edge_splits, full.mesh.tets().len()), (1, 12));
        assert!(full.mesh.tets().iter().all(|tet| tet.iter().any(|&v| !boundary.contains(v))));
        assert!((volume(&full.mesh) - 1.0).abs() < 1e-15);
        boundary.check_ball(&full.mesh).unwrap();
        let again = full_boundary(&full.mesh, &boundary).unwrap();
        assert_eq!((again.mesh == full.mesh, again.edge_splits, again.face_splits), (true, 0, 0));
        let doubled = full.extend(mesh.points().iter().map(|p| p * 2.0).collect());
        assert!(doubled.iter().zip(full.mesh.points()).all(|(a, b)| (a - b * 2.0).norm() < 1e-15));
    }
}

//! A mesh whose simplices are split at their means, and what carries values over.

use std::collections::HashMap;

use super::{ChangeError, MeshChanges, MeshError, TetMesh, Vec3, VertexId};

/// A mesh under splits of edges and faces: old vertices keep their numbers, new ones follow, each the mean of a simplex that
/// was split. Tets are replaced where they stood, and the rest of each appended, so that splits elsewhere leave them alone.
#[derive(Clone, Debug, PartialEq)]
pub struct Subdivision {
    points: Vec<Vec3>,
    tets: Vec<[VertexId; 4]>,
    parents: Vec<Vec<VertexId>>,
    edge_splits: usize,
    face_splits: usize,
}

impl Subdivision {
    /// A mesh before any split.
    pub fn of(mesh: &TetMesh) -> Self {
        let (points, tets) = (mesh.points().to_vec(), mesh.tets().to_vec());
        Self { points, tets, parents: Vec::new(), edge_splits: 0, face_splits: 0 }
    }

    /// Halves the edges that are `wanted` (smaller vertex first), longest first, until there are none; a new edge may be wanted
    /// as well. Edges without a common tet are split in one round.
    pub fn split_edges(&mut self, wanted: impl Fn([VertexId; 2]) -> bool) {
        self.split_edges_within(usize::MAX, wanted);
    }

    /// The same, but no split that would make more than so many tets.
    pub fn split_edges_within(&mut self, most_tets: usize, wanted: impl Fn([VertexId; 2]) -> bool) {
        let squared = |points: &[Vec3], [a, b]: [VertexId; 2]| (points[a.index()] - points[b.index()]).norm_squared();
        self.edge_splits += self.split_all(most_tets, wanted, squared);
    }

    /// Splits the faces that are `wanted` (vertices ascending) at their centres, until there are none.
    pub fn split_faces(&mut self, wanted: impl Fn([VertexId; 3]) -> bool) {
        self.face_splits += self.split_all(usize::MAX, wanted, |_, _| 0.0);
    }

    /// Changes the mesh as refinement did, each halving and flip that of the mesh as it is then.
    ///
    /// # Errors
    /// The first that cannot be made.
    pub fn change(&mut self, changes: &MeshChanges) -> Result<(), ChangeError> {
        let (mut halved, mut flipped) = (0, 0);
        let halve = |mesh: &mut Self, from: usize, to: usize| {
            let made = mesh.halve(&changes.halved[from..to]);
            made.map_err(|(index, reason)| ChangeError::Halving(from + index, reason))
        };
        for flips in &changes.flips {
            if flips.after < halved || flips.after > changes.halved.len() {
                let reason = "it comes after fewer halvings than the one before, or after more than there are";
                return Err(ChangeError::Flip(flipped, reason.into()));
            }
            halve(self, halved, flips.after)?;
            flips.make(&mut self.tets).map_err(|error| match error {
                ChangeError::Flip(row, reason) => ChangeError::Flip(flipped + row, reason),
                other @ ChangeError::Halving(..) => other,
            })?;
            halved = flips.after;
            flipped += flips.old.len() + flips.new.len();
        }
        halve(self, halved, changes.halved.len())
    }

    /// Halves edges in this order, each of the mesh as it is then; the number of the first that is none, and why.
    fn halve(&mut self, edges: &[[VertexId; 2]]) -> Result<(), (usize, String)> {
        // The tets at each vertex, and some that were.
        let mut at: Vec<Vec<usize>> = vec![Vec::new(); self.points.len()];
        for (index, tet) in self.tets.iter().enumerate() {
            tet.iter().for_each(|v| at[v.index()].push(index));
        }
        for (index, edge) in edges.iter().enumerate() {
            let around = at.get(edge[0].index()).into_iter().flatten().copied();
            let mut tets: Vec<usize> = around.filter(|&tet| edge.iter().all(|v| self.tets[tet].contains(v))).collect();
            if tets.is_empty() || edge[0] == edge[1] {
                return Err((index, format!("there is no edge from vertex {} to {}", edge[0].0, edge[1].0)));
            }
            tets.sort_unstable();
            let before = self.tets.len();
            self.split(edge, &tets);
            self.edge_splits += 1;
            at.push(tets);
            for (index, tet) in self.tets.iter().enumerate().skip(before) {
                tet.iter().for_each(|v| at[v.index()].push(index));
            }
        }
        Ok(())
    }

    /// The mesh before [`Subdivision::change`] made these changes; `None` where it cannot have come from one so.
    pub fn before(mesh: &TetMesh, changes: &MeshChanges) -> Option<TetMesh> {
        let (mut points, mut tets) = (mesh.points().to_vec(), mesh.tets().to_vec());
        let mut flips = changes.flips.iter().rev().peekable();
        for (index, [replaced, _]) in changes.halved.iter().enumerate().rev() {
            while let Some(flips) = flips.next_if(|flips| flips.after == index + 1) {
                flips.undo(&mut tets)?;
            }
            points.pop()?;
            let middle = VertexId(points.len() as u32);
            let halves = tets.iter().filter(|tet| tet.contains(&middle)).count();
            tets.truncate(tets.len() - halves / 2);
            tets.iter_mut().flatten().filter(|v| **v == middle).for_each(|v| *v = *replaced);
        }
        while let Some(flips) = flips.next_if(|flips| flips.after == 0) {
            flips.undo(&mut tets)?;
        }
        let there = |v: &VertexId| v.index() < points.len();
        if flips.next().is_some() || !tets.iter().flatten().all(there) {
            return None;
        }
        TetMesh::new(points, tets).ok()
    }

    /// How many vertices there are now.
    pub fn vertex_count(&self) -> usize {
        self.points.len()
    }

    /// How many tets there are now.
    pub fn tet_count(&self) -> usize {
        self.tets.len()
    }

    /// The splits of edges.
    pub fn edge_splits(&self) -> usize {
        self.edge_splits
    }

    /// The splits of faces.
    pub fn face_splits(&self) -> usize {
        self.face_splits
    }

    /// For each new vertex, the two or three vertices it is the mean of; they may be new ones themselves.
    pub fn parents(&self) -> &[Vec<VertexId>] {
        &self.parents
    }

    /// Extends positions of the old vertices to the new ones by the means that made them.
    pub fn extend(&self, mut positions: Vec<Vec3>) -> Vec<Vec3> {
        for parents in &self.parents {
            positions.push(mean(&positions, parents));
        }
        positions
    }

    /// The mesh as it is now.
    ///
    /// # Errors
    /// A split tet so thin that rounding made it flat.
    pub fn mesh(&self) -> Result<TetMesh, MeshError> {
        TetMesh::new(self.points.clone(), self.tets.clone())
    }

    /// Splits the simplices of `N` vertices that are wanted, those of the largest `size` first and smaller vertices first among
    /// equals, until there are none or the next would make more than so many tets; returns how many.
    fn split_all<const N: usize>(
        &mut self,
        most_tets: usize,
        wanted: impl Fn([VertexId; N]) -> bool,
        size: impl Fn(&[Vec3], [VertexId; N]) -> f64,
    ) -> usize {
        let mut count = 0;
        loop {
            let mut tets_at: HashMap<[VertexId; N], Vec<usize>> = HashMap::new();
            for (index, tet) in self.tets.iter().enumerate() {
                for simplex in simplices::<N>(tet) {
                    if wanted(simplex) {
                        tets_at.entry(simplex).or_default().push(index);
                    }
                }
            }
            if tets_at.is_empty() {
                return count;
            }
            let mut simplices: Vec<(f64, [VertexId; N], Vec<usize>)> =
                tets_at.into_iter().map(|(simplex, tets)| (size(&self.points, simplex), simplex, tets)).collect();
            simplices.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            // The first always is split, so every round makes progress.
            let mut touched = vec![false; self.tets.len()];
            for (_, simplex, tets) in simplices {
                if tets.iter().any(|&t| touched[t]) {
                    continue;
                }
                if self.tets.len() + (N - 1) * tets.len() > most_tets {
                    return count;
                }
                tets.iter().for_each(|&t| touched[t] = true);
                self.split(&simplex, &tets);
                count += 1;
            }
        }
    }

    /// Puts a vertex at the mean of a simplex's vertices and replaces each of its tets by one for each of them.
    fn split(&mut self, simplex: &[VertexId], tets: &[usize]) {
        let new = VertexId(self.points.len() as u32);
        self.points.push(mean(&self.points, simplex));
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

fn mean(positions: &[Vec3], vertices: &[VertexId]) -> Vec3 {
    let sum: Vec3 = vertices.iter().map(|v| positions[v.index()]).sum();
    sum / vertices.len() as f64
}

/// The edges (`N` = 2) or faces (`N` = 3) of a tet, vertices ascending.
fn simplices<const N: usize>(tet: &[VertexId; 4]) -> impl Iterator<Item = [VertexId; N]> + '_ {
    (0..16_usize).filter(|members| members.count_ones() as usize == N).map(move |members| {
        let mut chosen = (0..4).filter(|i| members >> i & 1 == 1).map(|i| tet[i]);
        let mut simplex = [(); N].map(|()| chosen.next().expect("as many as bits are set"));
        simplex.sort_unstable();
        simplex
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Boundary, TetId};

    fn volume(mesh: &TetMesh) -> f64 {
        (0..mesh.tets().len() as u32)
            .map(|t| super::super::edge_matrix(mesh.corners(TetId(t))).determinant() / 6.0)
            .sum()
    }

    #[test]
    fn wanted_edges_and_faces_are_split_and_values_carried_over() {
        let points = vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z(), Vec3::new(0.6, 0.7, 0.8)];
        let tets = [[0, 1, 2, 3], [1, 3, 2, 4]].map(|tet| tet.map(VertexId)).to_vec();
        let mesh = TetMesh::from_either_orientation(points, tets).unwrap().0;
        let mut splits = Subdivision::of(&mesh);
        assert_eq!(splits.mesh().unwrap(), mesh);
        splits.split_faces(|face| face == [1, 2, 3].map(VertexId));
        splits.split_edges(|edge| edge == [0, 5].map(VertexId));
        assert_eq!((splits.face_splits(), splits.edge_splits(), splits.vertex_count()), (1, 1, 7));
        assert_eq!(splits.parents(), [[1, 2, 3].map(VertexId).to_vec(), [0, 5].map(VertexId).to_vec()]);
        // Three tets at the edge from 0 to the centre of the face, three beyond the face.
        let split = splits.mesh().unwrap();
        assert_eq!(split.tets().len(), 2 * 3 + 3);
        assert!((volume(&split) - volume(&mesh)).abs() < 1e-15);
        assert_eq!(Boundary::of(&split).unwrap().triangles().len(), 6);
        let mut again = Subdivision::of(&mesh);
        let halvings = |edges: &[[u32; 2]]| MeshChanges {
            halved: edges.iter().map(|edge| edge.map(VertexId)).collect(),
            flips: Vec::new(),
        };
        let edges = [[0, 1], [5, 2], [1, 2]];
        assert_eq!(again.change(&halvings(&edges)), Ok(()));
        let edges = edges.map(|edge| edge.map(VertexId));
        assert_eq!(again.edge_splits(), 3);
        let mut by_size = Subdivision::of(&mesh);
        edges
            .into_iter()
            .for_each(|edge| by_size.split_edges(|other| other == [edge[0].min(edge[1]), edge[0].max(edge[1])]));
        let sorted = |splits: &Subdivision| {
            let mut tets = splits.tets.clone();
            tets.iter_mut().for_each(|tet| tet.sort_unstable());
            tets.sort_unstable();
            tets
        };
        assert_eq!(sorted(&again), sorted(&by_size));
        let changes = halvings(&[[0, 1], [3, 2], [1, 2], [1, 5]]);
        let mut halved = Subdivision::of(&mesh);
        halved.change(&changes).unwrap();
        assert_eq!(Subdivision::before(&halved.mesh().unwrap(), &changes), Some(mesh.clone()));
        for none in [[0, 4], [0, 99]] {
            let error = again.clone().change(&halvings(&[[0, 3], none])).unwrap_err();
            assert!(
                matches!(&error, ChangeError::Halving(1, reason) if reason.contains("no edge from vertex 0")),
                "{error:?}"
            );
        }
        // A linear map of the old vertices is the same linear map of the new ones.
        let image = splits.extend(mesh.points().iter().map(|p| Vec3::new(p.x + p.y, 3.0 * p.y, p.z)).collect());
        for (p, q) in split.points().iter().zip(&image) {
            assert!((Vec3::new(p.x + p.y, 3.0 * p.y, p.z) - q).norm() < 1e-15);
        }
    }
}

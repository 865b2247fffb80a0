//! The boundary of a tetrahedral mesh, and whether the mesh is a topological ball.

use std::collections::HashMap;

use rayon::prelude::*;

use super::{TetId, TetMesh, VertexId};

/// Why a tetrahedral mesh is not a topological ball.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TopologyError {
    /// Three or more tets share one triangle.
    #[error("the triangle {face:?} belongs to {count} tets; a mesh of a solid has at most two at a triangle")]
    OverusedFace {
        /// The triangle's vertices.
        face: [u32; 3],
        /// How many tets share it.
        count: usize,
    },
    /// Two tets lie on the same side of a triangle that they share.
    #[error(
        "the tets {tets:?} lie on the same side of their common triangle {face:?}: the mesh is folded there and overlaps \
         itself; only the vertices of one of the two can be right"
    )]
    Folded {
        /// The triangle's vertices.
        face: [u32; 3],
        /// The two tets, counted from 0.
        tets: [u32; 2],
    },
    /// An edge of the boundary surface does not lie in exactly two boundary triangles.
    #[error(
        "the boundary is not a manifold surface at the edge {edge:?}: {count} boundary triangles meet there instead of two"
    )]
    BoundaryEdge {
        /// The edge's vertices.
        edge: [u32; 2],
        /// How many boundary triangles meet there.
        count: usize,
    },
    /// A vertex lies in no tet.
    #[error("vertex {vertex} belongs to no tet; remove it")]
    UnusedVertex {
        /// The vertex.
        vertex: u32,
    },
    /// The tets fall apart into several face-connected pieces.
    #[error(
        "the mesh has {count} pieces that are not joined through triangles, the smallest of {tets} tets, tet {tet} one of them; keep one"
    )]
    Disconnected {
        /// Number of face-connected pieces.
        count: usize,
        /// Tets of the smallest piece.
        tets: usize,
        /// The first of these, counted from 0.
        tet: u32,
    },
    /// The boundary surface touches itself at a vertex.
    #[error(
        "the boundary touches itself at vertex {vertex}: {sheets} sheets meet there; split the vertex or fill the gap beside it"
    )]
    PinchedVertex {
        /// The vertex.
        vertex: u32,
        /// How many fans of boundary triangles it has.
        sheets: usize,
    },
    /// The boundary has more than one piece.
    #[error(
        "the boundary has {count} separate pieces, the smallest of {triangles} triangles, vertex {vertex} on it: the solid has a cavity, \
         and a ball has none; fill it"
    )]
    Cavity {
        /// Number of pieces.
        count: usize,
        /// Triangles of the smallest piece.
        triangles: usize,
        /// The first vertex of these.
        vertex: u32,
    },
    /// The boundary is a surface of higher genus.
    #[error("the boundary has {handles} handle{s}, like a torus, and a ball has none; fill the hole{s}", s = if *handles == 1 { "" } else { "s" })]
    Handles {
        /// How many.
        handles: i64,
    },
    /// The boundary is a sphere, and the whole has the wrong Euler characteristic.
    #[error(
        "the mesh is not a ball: Euler characteristic {solid} (a ball has 1), of its boundary {boundary} (a sphere has 2); \
         tets that touch one another inside at an edge or a vertex alone are the usual cause"
    )]
    NotABall {
        /// Euler characteristic of the mesh.
        solid: i64,
        /// Euler characteristic of its boundary.
        boundary: i64,
    },
}

/// The boundary surface of a tetrahedral mesh.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Boundary {
    triangles: Vec<[VertexId; 3]>,
    owners: Vec<TetId>,
    contains: Vec<bool>,
}

impl Boundary {
    /// No boundary, for parts of a mesh, whose boundary nobody asks for.
    pub(crate) fn none(vertices: usize) -> Self {
        Self { triangles: Vec::new(), owners: Vec::new(), contains: vec![false; vertices] }
    }

    /// The same boundary as one of a part of the mesh: the triangles of those `tets`, its vertices named anew.
    pub(crate) fn part(&self, tets: &[TetId], vertices: usize, local: impl Fn(VertexId) -> VertexId) -> Self {
        let places: HashMap<TetId, u32> = tets.iter().copied().zip(0..).collect();
        let mut part = Self::none(vertices);
        for (triangle, owner) in self.triangles.iter().zip(&self.owners) {
            if let Some(&place) = places.get(owner) {
                let triangle = triangle.map(&local);
                triangle.iter().for_each(|v| part.contains[v.index()] = true);
                part.triangles.push(triangle);
                part.owners.push(TetId(place));
            }
        }
        part
    }

    /// Collects the triangles that belong to one tet only, in the order of the tets.
    ///
    /// The two tets of any other triangle must see it from opposite sides: since the volumes of both are positive by exact
    /// predicate, they do exactly if they run round it in opposite directions.
    ///
    /// # Errors
    /// [`TopologyError::OverusedFace`] where three or more tets share a triangle, else [`TopologyError::Folded`] where two lie
    /// on the same side of it.
    pub fn of(mesh: &TetMesh) -> Result<Self, TopologyError> {
        // Every tet's triangles, those of the same vertices side by side; each with its place and direction.
        let mut sides: Vec<([u32; 3], (u32, u8), bool)> = Vec::with_capacity(4 * mesh.tets().len());
        for (index, tet) in (0..).zip(mesh.tets()) {
            for (side, face) in (0..).zip(TetMesh::FACES) {
                let triangle = face.map(|i| tet[i].0);
                sides.push((sorted(triangle), (index, side), runs_upwards(triangle)));
            }
        }
        sides.par_sort_unstable();
        // The places of the triangles that have one tet, and the first of each fault.
        let mut places = Vec::new();
        let (mut overused, mut folded) = (None, None);
        for group in sides.chunk_by(|a, b| a.0 == b.0) {
            match *group {
                [(_, place, _)] => places.push(place),
                [(_, _, upwards), (_, _, other)] if upwards != other => {}
                [(face, first, _), (_, second, _)] => keep_first(&mut folded, second, face, first.0),
                [(face, first, _), ..] => keep_first(&mut overused, first, face, group.len()),
                [] => {}
            }
        }
        if let Some((_, face, count)) = overused {
            return Err(TopologyError::OverusedFace { face, count });
        }
        if let Some((second, face, first)) = folded {
            return Err(TopologyError::Folded { face, tets: [first, second.0] });
        }
        places.sort_unstable();
        let triangles: Vec<[VertexId; 3]> = places
            .iter()
            .map(|&(index, side)| TetMesh::FACES[usize::from(side)].map(|i| mesh.tets()[index as usize][i]))
            .collect();
        let owners = places.iter().map(|&(index, _)| TetId(index)).collect();
        let mut contains = vec![false; mesh.points().len()];
        triangles.iter().flatten().for_each(|v| contains[v.index()] = true);
        Ok(Self { triangles, owners, contains })
    }

    /// Boundary triangles, counter-clockwise seen from outside.
    pub fn triangles(&self) -> &[[VertexId; 3]] {
        &self.triangles
    }

    /// The one tet of each boundary triangle, in the order of [`Boundary::triangles`].
    pub fn owners(&self) -> &[TetId] {
        &self.owners
    }

    /// Whether a vertex lies on the boundary.
    pub fn contains(&self, vertex: VertexId) -> bool {
        self.contains[vertex.index()]
    }

    /// For each vertex, whether it lies on the boundary.
    pub fn vertex_mask(&self) -> &[bool] {
        &self.contains
    }

    /// Checks that the mesh is face-connected, its boundary a closed manifold sphere, and both Euler characteristics
    /// are those of a ball.
    ///
    /// Necessary for a ball, and sufficient up to knotted or exotic interiors that no mesher of a solid produces.
    ///
    /// # Errors
    /// The first condition that fails, with the place.
    pub fn check_ball(&self, mesh: &TetMesh) -> Result<(), TopologyError> {
        let mut used = vec![false; mesh.points().len()];
        let mut edges: Vec<[u32; 2]> = Vec::with_capacity(6 * mesh.tets().len());
        let mut faces: Vec<([u32; 3], u32)> = Vec::with_capacity(4 * mesh.tets().len());
        for (index, tet) in mesh.tets().iter().enumerate() {
            for i in 0..4 {
                used[tet[i].index()] = true;
                for j in 0..i {
                    edges.push([tet[i].0.min(tet[j].0), tet[i].0.max(tet[j].0)]);
                }
                faces.push((sorted(TetMesh::FACES[i].map(|l| tet[l].0)), index as u32));
            }
        }
        if let Some(vertex) = used.iter().position(|used| !used) {
            return Err(TopologyError::UnusedVertex { vertex: vertex as u32 });
        }
        faces.par_sort_unstable();
        let mut pieces = DisjointSets::new(mesh.tets().len());
        for pair in faces.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
            pieces.join(pair[0].1, pair[1].1);
        }
        if let Some((tets, tet)) = pieces.smallest() {
            return Err(TopologyError::Disconnected { count: pieces.count(), tets, tet });
        }
        edges.par_sort_unstable();
        edges.dedup();
        let face_count = (faces.len() + self.triangles.len()) / 2;
        let solid = mesh.points().len() as i64 - edges.len() as i64 + face_count as i64 - mesh.tets().len() as i64;

        let rim = self.edges();
        if let Some(edge) = rim.chunk_by(|a, b| a.0 == b.0).find(|triangles| triangles.len() != 2) {
            return Err(TopologyError::BoundaryEdge { edge: edge[0].0, count: edge.len() });
        }
        self.check_sheets(&rim)?;
        let on_boundary = self.contains.iter().filter(|&&on| on).count();
        let boundary = on_boundary as i64 - rim.len() as i64 / 2 + self.triangles.len() as i64;
        if boundary < 2 {
            return Err(TopologyError::Handles { handles: (2 - boundary) / 2 });
        }
        if solid != 1 || boundary != 2 {
            return Err(TopologyError::NotABall { solid, boundary });
        }
        Ok(())
    }
}

impl Boundary {
    /// The edges of the boundary triangles with the triangle and the corners there of their ends; those of one edge side by side.
    fn edges(&self) -> Vec<([u32; 2], usize, [usize; 2])> {
        let mut edges = Vec::with_capacity(3 * self.triangles.len());
        for (index, triangle) in self.triangles.iter().enumerate() {
            for (i, j) in [(0, 1), (1, 2), (2, 0)] {
                let [low, high] = if triangle[i] < triangle[j] { [i, j] } else { [j, i] };
                edges.push(([triangle[low].0, triangle[high].0], index, [low, high]));
            }
        }
        edges.par_sort_unstable();
        edges
    }

    /// That the boundary triangles are one piece, and that those of each vertex are one fan.
    fn check_sheets(&self, edges: &[([u32; 2], usize, [usize; 2])]) -> Result<(), TopologyError> {
        let mut pieces = DisjointSets::new(self.triangles.len());
        let mut corners = DisjointSets::new(3 * self.triangles.len());
        for pair in edges.chunks_exact(2) {
            let [(_, first, of_first), (_, second, of_second)] = [pair[0], pair[1]];
            pieces.join(first as u32, second as u32);
            for (one, other) in of_first.into_iter().zip(of_second) {
                corners.join((3 * first + one) as u32, (3 * second + other) as u32);
            }
        }
        let mut sheets = vec![0; self.contains.len()];
        for corner in 0..3 * self.triangles.len() {
            if corners.root(corner as u32) == corner as u32 {
                sheets[self.triangles[corner / 3][corner % 3].index()] += 1;
            }
        }
        if let Some(vertex) = sheets.iter().position(|&sheets| sheets > 1) {
            return Err(TopologyError::PinchedVertex { vertex: vertex as u32, sheets: sheets[vertex] });
        }
        if let Some((triangles, triangle)) = pieces.smallest() {
            let vertex = self.triangles[triangle as usize][0].0;
            return Err(TopologyError::Cavity { count: pieces.count(), triangles, vertex });
        }
        Ok(())
    }
}

/// Keeps the fault at the earliest place.
fn keep_first<T>(kept: &mut Option<((u32, u8), [u32; 3], T)>, place: (u32, u8), face: [u32; 3], what: T) {
    if kept.as_ref().is_none_or(|(earliest, ..)| place < *earliest) {
        *kept = Some((place, face, what));
    }
}

/// Whether the vertices, from the least one on, go on with the second: one of the two directions round a triangle.
fn runs_upwards([a, b, c]: [u32; 3]) -> bool {
    (a < b) as u8 + (b < c) as u8 + (c < a) as u8 == 2
}

fn sorted(mut face: [u32; 3]) -> [u32; 3] {
    face.sort_unstable();
    face
}

/// Union-find over `0..n`, path halving.
pub(crate) struct DisjointSets {
    parent: Vec<u32>,
    count: usize,
}

impl DisjointSets {
    pub(crate) fn new(n: usize) -> Self {
        Self { parent: (0..n as u32).collect(), count: n }
    }

    pub(crate) fn root(&mut self, mut a: u32) -> u32 {
        while self.parent[a as usize] != a {
            let grandparent = self.parent[self.parent[a as usize] as usize];
            self.parent[a as usize] = grandparent;
            a = grandparent;
        }
        a
    }

    pub(crate) fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        if a != b {
            // The smaller index stays root, so that the result does not depend on the order of joins.
            self.parent[a.max(b) as usize] = a.min(b);
            self.count -= 1;
        }
    }

    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// How many belong to the smallest of several sets, and the first of them; the first of equally small sets.
    fn smallest(&mut self) -> Option<(usize, u32)> {
        if self.count < 2 {
            return None;
        }
        let mut sizes = vec![0; self.parent.len()];
        for a in 0..self.parent.len() {
            sizes[self.root(a as u32) as usize] += 1;
        }
        // Roots are the first of their sets.
        (0..).zip(sizes).filter(|&(_, size)| size > 0).map(|(root, size)| (size, root)).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Vec3;

    fn two_tets(apex: u32) -> TetMesh {
        let points = vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z(), -Vec3::z()];
        let tets = vec![[0, 1, 2, 3].map(VertexId), [0, 2, 1, apex].map(VertexId)];
        TetMesh::new(points, tets).unwrap()
    }

    #[test]
    fn two_tets_at_a_face_are_a_ball() {
        let mesh = two_tets(4);
        let boundary = Boundary::of(&mesh).unwrap();
        assert_eq!(boundary.triangles().len(), 6);
        boundary.check_ball(&mesh).unwrap();
    }

    #[test]
    fn two_tets_on_the_same_side_of_a_face_are_named() {
        let points = vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z(), Vec3::new(0.2, 0.2, 0.5)];
        for (second, folded) in [([0, 1, 2, 4], true), ([0, 4, 1, 2], true), ([1, 2, 3, 4], false)] {
            let tets = vec![[2, 0, 1, 3].map(VertexId), second.map(VertexId)];
            // Whatever was exchanged before.
            let mesh = TetMesh::from_either_orientation(points.clone(), tets).unwrap().0;
            let face = [[0, 1, 2], [1, 2, 3]][usize::from(!folded)];
            let expected = TopologyError::Folded { face, tets: [0, 1] };
            assert_eq!(Boundary::of(&mesh).err(), Some(expected));
        }
        let mut far = points;
        far[4] = Vec3::new(0.2, 0.2, -0.5);
        let tets = vec![[2, 0, 1, 3].map(VertexId), [0, 1, 2, 4].map(VertexId)];
        assert!(Boundary::of(&TetMesh::from_either_orientation(far, tets).unwrap().0).is_ok());
    }

    #[test]
    fn tets_that_share_only_a_vertex_are_refused() {
        let mut points = vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z()];
        points.extend([-Vec3::x(), -Vec3::y(), -Vec3::z()]);
        let tets = vec![[0, 1, 2, 3].map(VertexId), [0, 5, 4, 6].map(VertexId)];
        let mesh = TetMesh::from_either_orientation(points, tets).unwrap().0;
        let boundary = Boundary::of(&mesh).unwrap();
        assert_eq!(boundary.check_ball(&mesh), Err(TopologyError::Disconnected { count: 2, tets: 1, tet: 0 }));
    }

    /// The cubes of an n x n x n grid that are wanted, six tets each.
    fn cubes(n: usize, wanted: impl Fn([usize; 3]) -> bool) -> TetMesh {
        let place = |[i, j, k]: [usize; 3]| ((i * (n + 1) + j) * (n + 1) + k) as u32;
        let mut tets = Vec::new();
        let mut used = std::collections::BTreeMap::new();
        for cube in (0..n.pow(3)).map(|c| [c / n / n, c / n % n, c % n]).filter(|cube| wanted(*cube)) {
            for axes in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]] {
                let mut corner = cube;
                let mut tet = vec![corner];
                for axis in axes {
                    corner[axis] += 1;
                    tet.push(corner);
                }
                tets.push([0, 1, 2, 3].map(|i| {
                    let next = used.len() as u32;
                    VertexId(used.entry(place(tet[i])).or_insert((next, tet[i])).0)
                }));
            }
        }
        let mut points = vec![Vec3::zeros(); used.len()];
        for (v, corner) in used.into_values() {
            points[v as usize] = Vec3::from(corner.map(|x| x as f64));
        }
        TetMesh::from_either_orientation(points, tets).unwrap().0
    }

    #[test]
    fn what_is_no_ball_is_told_by_its_kind_and_place() {
        let check = |wanted: fn([usize; 3]) -> bool| {
            let mesh = cubes(3, wanted);
            (Boundary::of(&mesh).unwrap().check_ball(&mesh), mesh)
        };
        assert_eq!(check(|_| true).0, Ok(()));
        // A cube of two triangles a side, left out in the middle.
        let (error, mesh) = check(|cube| cube != [1; 3]);
        let Err(TopologyError::Cavity { count: 2, triangles: 12, vertex }) = error else { panic!("{error:?}") };
        assert!(mesh.points()[vertex as usize].iter().all(|&x| x == 1.0 || x == 2.0));
        assert_eq!(check(|[i, j, _]| [i, j] != [1, 1]).0, Err(TopologyError::Handles { handles: 1 }));
        // A row of cubes whose last one touches the first at a corner, far from the cubes between.
        let row = [[1, 1, 1], [0, 1, 1], [0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3], [2, 2, 3], [2, 2, 2]];
        let mesh = cubes(4, |cube| row.contains(&cube));
        let error = Boundary::of(&mesh).unwrap().check_ball(&mesh);
        let Err(TopologyError::PinchedVertex { vertex, sheets: 2 }) = error else { panic!("{error:?}") };
        assert_eq!(mesh.points()[vertex as usize], Vec3::repeat(2.0));
    }
}

//! What a map may move, and how.

use crate::mesh::{Mat3, Vec3};

/// How a vertex may move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Freedom {
    /// Not at all.
    Fixed,
    /// Anywhere.
    Free,
    /// On the sphere about the origin on which it is.
    OnSphere,
}

/// For each vertex of a mesh how it may move. What varies has three coordinates in all systems; those of a vertex on a sphere
/// are kept to its tangent plane, and a step ends on the sphere again.
#[derive(Clone, Debug, PartialEq)]
pub struct Unknowns {
    freedom: Vec<Freedom>,
    least_openings: Vec<f64>,
}

impl Unknowns {
    /// Vertices that are fixed or free.
    pub fn of_mask(fixed: &[bool]) -> Self {
        Self::new(fixed.iter().map(|&fixed| if fixed { Freedom::Fixed } else { Freedom::Free }).collect())
    }

    /// One freedom a vertex.
    pub fn new(freedom: Vec<Freedom>) -> Self {
        Self { freedom, least_openings: Vec::new() }
    }

    /// The same with the least [`opening`](super::opening()) that each triangle of the mesh's boundary may come to.
    pub fn with_least_openings(self, least_openings: Vec<f64>) -> Self {
        Self { least_openings, ..self }
    }

    /// The least opening of each triangle of the boundary; empty where none is watched.
    pub fn least_openings(&self) -> &[f64] {
        &self.least_openings
    }

    /// Number of vertices.
    pub fn vertices(&self) -> usize {
        self.freedom.len()
    }

    /// How a vertex may move.
    pub fn of(&self, vertex: usize) -> Freedom {
        self.freedom[vertex]
    }

    /// Whether a vertex may not move.
    pub fn is_fixed(&self, vertex: usize) -> bool {
        self.freedom[vertex] == Freedom::Fixed
    }

    /// The vertices that may move, ascending.
    pub fn varying(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.freedom.len() as u32).filter(|&v| !self.is_fixed(v as usize))
    }

    /// Number of vertices that may move.
    pub fn count(&self) -> usize {
        self.varying().count()
    }

    /// Whether a vertex may move on a sphere.
    pub fn slides(&self) -> bool {
        self.freedom.contains(&Freedom::OnSphere)
    }

    /// Fixes a vertex.
    pub fn fix(&mut self, vertex: usize) {
        self.freedom[vertex] = Freedom::Fixed;
    }

    /// The outer normal of a vertex's sphere at its position; `None` if it is not on one.
    pub fn normal(&self, vertex: usize, position: &Vec3) -> Option<Vec3> {
        (self.of(vertex) == Freedom::OnSphere).then(|| position.normalize())
    }

    /// What of a vector at a vertex's position may vary.
    pub fn tangent(&self, vertex: usize, position: &Vec3, vector: Vec3) -> Vec3 {
        match self.normal(vertex, position) {
            Some(normal) => vector - normal * normal.dot(&vector),
            None => vector,
        }
    }

    /// A position to which a vertex was moved from one where it may be, brought back to where it may be.
    pub fn retract(&self, vertex: usize, from: &Vec3, to: Vec3) -> Vec3 {
        match self.of(vertex) {
            Freedom::OnSphere => to * (from.norm() / to.norm()),
            Freedom::Fixed | Freedom::Free => to,
        }
    }
}

/// The projection along a normal.
pub(super) fn projection(normal: &Vec3) -> Mat3 {
    Mat3::identity() - normal * normal.transpose()
}

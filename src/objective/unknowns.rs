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
/// are kept to its tangent plane, and a step ends on the sphere again. So are those of a vertex that is kept to planes through the origin.
#[derive(Clone, Debug, PartialEq)]
pub struct Unknowns {
    freedom: Vec<Freedom>,
    least_openings: Vec<f64>,
    /// The projection to the planes of each vertex; empty if none has any.
    within: Vec<Mat3>,
}

/// Where a vertex may move, to first order.
pub(super) struct Tangent {
    /// The projection to that space, and what is left.
    pub projection: Mat3,
    pub complement: Mat3,
    /// The outer normal of the vertex's sphere and its radius.
    pub sphere: Option<(Vec3, f64)>,
}

impl Tangent {
    /// Orthonormal columns of which the first span the space. Each is the longest column of what the projection leaves, so none is
    /// shorter than the root of a third of the dimensions left.
    pub(super) fn frame(&self) -> Mat3 {
        let mut rest = self.projection;
        let mut frame = Mat3::zeros();
        for mut axis in frame.column_iter_mut() {
            let longest = rest.column_iter().max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()));
            let along = longest.expect("three columns").try_normalize(0.5).unwrap_or_else(Vec3::zeros);
            axis.copy_from(&along);
            rest -= along * (along.transpose() * rest);
        }
        frame
    }
}

impl Unknowns {
    /// Vertices that are fixed or free.
    pub fn of_mask(fixed: &[bool]) -> Self {
        Self::new(fixed.iter().map(|&fixed| if fixed { Freedom::Fixed } else { Freedom::Free }).collect())
    }

    /// One freedom a vertex.
    pub fn new(freedom: Vec<Freedom>) -> Self {
        Self { freedom, least_openings: Vec::new(), within: Vec::new() }
    }

    /// The same with the least [`opening`](super::opening()) that each triangle of the mesh's boundary may come to.
    pub fn with_least_openings(self, least_openings: Vec<f64>) -> Self {
        Self { least_openings, ..self }
    }

    /// The least opening of each triangle of the boundary; empty where none is watched.
    pub fn least_openings(&self) -> &[f64] {
        &self.least_openings
    }

    /// The same, each vertex kept to the planes through the origin with this projection to them all, and to its sphere. One that
    /// is left no way to go is fixed.
    pub fn within(mut self, planes: &[Mat3]) -> Self {
        self.within = planes.to_vec();
        for vertex in 0..self.vertices() {
            if self.dimensions(vertex) == 0 {
                self.fix(vertex);
            }
        }
        self
    }

    /// In how many directions a vertex may move.
    pub(super) fn dimensions(&self, vertex: usize) -> usize {
        let of_planes = self.within.get(vertex).map_or(3, |planes| planes.trace().round() as usize);
        match self.of(vertex) {
            Freedom::Fixed => 0,
            Freedom::Free => of_planes,
            Freedom::OnSphere => of_planes.saturating_sub(1),
        }
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

    /// Whether a vertex is kept to a sphere or planes.
    pub fn slides(&self) -> bool {
        !self.within.is_empty() || self.freedom.contains(&Freedom::OnSphere)
    }

    /// Fixes a vertex.
    pub fn fix(&mut self, vertex: usize) {
        self.freedom[vertex] = Freedom::Fixed;
    }

    /// The outer normal of a vertex's sphere at its position; `None` if it is not on one.
    fn normal(&self, vertex: usize, position: &Vec3) -> Option<Vec3> {
        (self.of(vertex) == Freedom::OnSphere).then(|| position.normalize())
    }

    /// Where a vertex may move from its position; `None` if anywhere. The normal of its sphere, about the origin, lies in its planes.
    pub(super) fn tangent_space(&self, vertex: usize, position: &Vec3) -> Option<Tangent> {
        let normal = self.normal(vertex, position);
        let sphere = normal.map(|normal| (normal, position.norm()));
        match (self.within.get(vertex), normal) {
            (None, None) => None,
            (None, Some(normal)) => {
                let complement = normal * normal.transpose();
                Some(Tangent { projection: Mat3::identity() - complement, complement, sphere })
            }
            (Some(planes), normal) => {
                let projection = planes - normal.map_or(Mat3::zeros(), |normal| normal * normal.transpose());
                Some(Tangent { projection, complement: Mat3::identity() - projection, sphere })
            }
        }
    }

    /// What of a vector at a vertex's position may vary.
    pub fn tangent(&self, vertex: usize, position: &Vec3, vector: Vec3) -> Vec3 {
        let vector = self.within.get(vertex).map_or(vector, |planes| planes * vector);
        match self.normal(vertex, position) {
            Some(normal) => vector - normal * normal.dot(&vector),
            None => vector,
        }
    }

    /// A position to which a vertex was moved from one where it may be, brought back to where it may be.
    pub fn retract(&self, vertex: usize, from: &Vec3, to: Vec3) -> Vec3 {
        let to = self.within.get(vertex).map_or(to, |planes| planes * to);
        match self.of(vertex) {
            Freedom::OnSphere => to * (from.norm() / to.norm()),
            Freedom::Fixed | Freedom::Free => to,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_span_where_a_vertex_may_move() {
        let position = Vec3::new(0.3, -0.7, 0.2);
        // A plane and a line through the origin that hold the position, as those of mirrors do.
        let side = position.cross(&Vec3::x()).normalize();
        let plane = Mat3::identity() - side * side.transpose();
        let line = position * position.transpose() / position.norm_squared();
        for freedom in [Freedom::Free, Freedom::OnSphere] {
            for planes in [None, Some(Mat3::identity()), Some(plane), Some(line)] {
                let unknowns = Unknowns::new(vec![freedom]);
                let unknowns = planes.map_or(unknowns.clone(), |planes| unknowns.within(&[planes]));
                let dimensions = unknowns.dimensions(0);
                let Some(tangent) = unknowns.tangent_space(0, &position) else {
                    assert_eq!(dimensions, 3);
                    continue;
                };
                let frame = tangent.frame();
                let basis = frame.columns(0, dimensions);
                assert!((basis.tr_mul(&basis) - nalgebra::DMatrix::identity(dimensions, dimensions)).norm() < 1e-14);
                if !unknowns.is_fixed(0) {
                    assert!((basis * basis.transpose() - tangent.projection).norm() < 1e-14, "{freedom:?} {planes:?}");
                }
            }
        }
    }
}

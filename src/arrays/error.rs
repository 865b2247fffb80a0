//! What can be wrong with arrays.

use crate::bound::Contradiction;
use crate::map::{EvaluatorError, RayError};
use crate::mesh::{MeshError, TopologyError};
use crate::optimize::OptimizeError;
use crate::solid::{CentreError, ShellError, SurfaceError};
use crate::sphere::SphereError;

/// What is wrong with the arrays.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ArrayError {
    /// An array of another length than it must have.
    #[error("{array} has {found} rows, but there are {wanted} vertices; give one row a vertex, in the same order")]
    Length {
        /// Which array.
        array: &'static str,
        /// Its rows.
        found: usize,
        /// How many it must have.
        wanted: usize,
    },
    /// A boundary vertex whose image is not finite.
    #[error("row {row} of {array} holds a number that is not finite")]
    NotFinite {
        /// Which array.
        array: &'static str,
        /// The row.
        row: usize,
    },
    /// A setting out of its range.
    #[error("the exponent is {0}, but it must be a positive number")]
    Exponent(f64),
    /// A triangle with a vertex that there is not.
    #[error("row {row} of triangles is {triangle:?}, but there are {vertices} vertices, counted from 0")]
    NoSuchVertex {
        /// The row.
        row: usize,
        /// Its vertices.
        triangle: [u32; 3],
        /// How many there are.
        vertices: usize,
    },
    /// Points that are no vertices of the surface, so that nothing takes them anywhere.
    #[error(
        "{found} of the {points} points are vertices of the closed surface; drop points that no triangle names, and let points at \
         one place be one"
    )]
    NotVertices {
        /// How many points there are.
        points: usize,
        /// How many vertices.
        found: usize,
    },
    /// A surface whose solid is not star-shaped, which shells cannot fill.
    #[error(
        "the solid is not star-shaped: no point inside it sees all of the triangles {faces:?} from within; give tets that fill it, \
         or its file to a run, for which TetGen or Gmsh fills it"
    )]
    NotStarShaped {
        /// Triangles whose half-spaces have no point in common, counted from 0.
        faces: Vec<u32>,
    },
    /// The surface cannot be filled with shells of tets.
    #[error(transparent)]
    Shell(#[from] ShellError),
    /// A map that cannot be evaluated.
    #[error(transparent)]
    Evaluator(#[from] EvaluatorError),
    /// The tets are no mesh.
    #[error("{0} (tets and vertices are counted from 0)")]
    Mesh(#[from] MeshError),
    /// The mesh is not a ball.
    #[error("{0} (vertices are counted from 0)")]
    Topology(#[from] TopologyError),
    /// The triangles are no surface of a solid.
    #[error("the surface: {0}")]
    Triangles(#[source] SurfaceError),
    /// The boundary of the mesh is no surface of a solid.
    #[error("the boundary of the mesh: {0}")]
    Surface(#[from] SurfaceError),
    /// The solid is not star-shaped, or not about the centre asked for.
    #[error(transparent)]
    Centre(#[from] CentreError),
    /// The boundary has no map onto the sphere.
    #[error(transparent)]
    Sphere(#[from] SphereError),
    /// A vertex lies outside of the boundary.
    #[error(transparent)]
    Ray(#[from] RayError),
    /// The optimization could not start.
    #[error(transparent)]
    Optimize(#[from] OptimizeError),
    /// A bound is above what the map achieves: an error of this program.
    #[error(transparent)]
    Contradiction(#[from] Box<Contradiction>),
}

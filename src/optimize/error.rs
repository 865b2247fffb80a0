//! Why an optimisation could not start.

use super::Engine;
use crate::linalg::SparseError;
use crate::measure::NotOntoBall;

/// Why an optimisation could not start.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum OptimizeError {
    /// The start is not injective, so K is infinite there.
    #[error("{0} tets of the start are flipped or flat; the optimisation needs a start without any")]
    FlippedStart(usize),
    /// A boundary that is to slide on a sphere about the origin and is not on one.
    #[error(
        "of the image started from, vertex {vertex} of the boundary lies at the distance {radius} from the origin, and vertex {first} at {of_first} \
         (vertices are counted from 0): boundary values slide on a sphere about the origin only; keep them fixed, or start from a map onto the \
         ball"
    )]
    NotOnSphere {
        /// The vertex, counted from 0.
        vertex: u32,
        /// Its distance from the origin.
        radius: f64,
        /// The first vertex of the boundary.
        first: u32,
        /// Its distance.
        of_first: f64,
    },
    /// A boundary that is to slide and is no image of a sphere without folds.
    #[error(
        "of the image started from, the triangle {0:?} of the boundary does not face away from the origin (vertices are counted from 0): boundary \
         values slide where the image is star-shaped about it; keep them fixed, or start from a map onto the ball"
    )]
    TurnedTriangle([u32; 3]),
    /// A map that is to be improved onto the ball and is not onto it.
    #[error("{0}: the objective \"ball\" needs a start that is; take \"max\", or start from a map onto the ball")]
    NotOntoBall(#[from] NotOntoBall),
    /// The Newton system does not fit.
    #[error("the Newton system of this mesh cannot be held: {0}")]
    System(#[from] SparseError),
    /// An engine of NLopt in a build without it.
    #[error(
        "this build has no NLopt, which the engine \"{0}\" belongs to: build with the feature \"nlopt\", or use the engine \"newton\""
    )]
    NoNlopt(Engine),
    /// An engine that cannot keep vertices on a sphere.
    #[error(
        "the engine \"{0}\" cannot slide boundary values on the sphere: use the engine \"newton\", or keep them fixed"
    )]
    NotSliding(Engine),
    /// An engine for the largest K only.
    #[error(
        "the engine \"{0}\" minimizes the largest K only: for soft maxima use \"newton\", \"lbfgs\", \"newton-cg\" or \"trust-region\""
    )]
    NotForSoftMax(Engine),
    /// More tets than the engine can handle in minutes.
    #[error("the engine \"{engine}\" handles at most {most} tets, this mesh has {tets}: use the engine \"newton\"")]
    TooManyTets {
        /// The engine.
        engine: Engine,
        /// Its limit.
        most: usize,
        /// Number of tets.
        tets: usize,
    },
}

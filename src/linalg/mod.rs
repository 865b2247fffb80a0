//! The linear algebra that needs care here: intervals, the 3x3 singular value decomposition, the sparse SPD solve, small
//! quadratic programs.

mod coarse;
pub(crate) mod interval;
mod iterative;
mod ordering;
mod pattern;
mod quadratic_program;
mod reduction;
mod sparse;
mod svd;
mod system;

pub use iterative::{BlockConjugateGradients, REDUCTION};
pub use ordering::reverse_cuthill_mckee;
pub(crate) use quadratic_program::QuadraticProgram;
pub use sparse::{BlockCholesky, SparseError};
pub use svd::{LANES, Svd, svd, svds};
pub use system::{Method, NewtonSystem};

/// A point or vector of three-space.
pub type Vec3 = nalgebra::Vector3<f64>;
/// A 3x3 matrix.
pub type Mat3 = nalgebra::Matrix3<f64>;

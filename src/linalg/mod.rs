//! The two pieces of linear algebra that need care here: the 3x3 singular value decomposition and the sparse SPD solve.

mod sparse;
mod svd;

pub use sparse::{BlockCholesky, SparseError};
pub use svd::{Svd, svd};

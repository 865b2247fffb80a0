//! The two pieces of linear algebra that need care here: the 3x3 singular value decomposition and the sparse SPD solve.

mod svd;

pub use svd::{Svd, svd};

//! The Newton system: solved directly up to a size, iteratively above it.

use super::{BlockCholesky, BlockConjugateGradients, Mat3, SparseError, Vec3};
use crate::cancel::Cancel;

/// How Newton systems are solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// To rounding, by a sparse factor whose time grows with the square of the number of vertices.
    Direct,
    /// To a hundredth of the residual, in memory that grows with the number of vertices.
    Iterative,
}

/// A symmetric matrix of 3x3 blocks with a fixed pattern, solved again and again with new values.
pub enum NewtonSystem {
    /// By a sparse Cholesky factor.
    Direct(Box<BlockCholesky>),
    /// By preconditioned conjugate gradients.
    Iterative(Box<BlockConjugateGradients>),
}

macro_rules! delegate {
    ($self:ident, $system:ident => $call:expr) => {
        match $self {
            NewtonSystem::Direct($system) => $call,
            NewtonSystem::Iterative($system) => $call,
        }
    };
}

impl NewtonSystem {
    /// Prepares a matrix whose pattern is given as edges `(row, column)` with `row > column` between blocks; the diagonal is always
    /// there. A direct solve is one in a subspace of each block's unknowns with these dimensions, see [`NewtonSystem::set_frames`].
    ///
    /// # Errors
    /// [`SparseError::TooLarge`] if the factor of a direct solve cannot be held.
    pub fn new(method: Method, dimensions: &[usize], edges: &[(u32, u32)]) -> Result<Self, SparseError> {
        Ok(match method {
            Method::Direct => Self::Direct(Box::new(BlockCholesky::new(dimensions, edges)?)),
            Method::Iterative => Self::Iterative(Box::new(BlockConjugateGradients::new(dimensions.len(), edges))),
        })
    }

    /// From now on iterative solves end when the residual has fallen to this share, or at what they have reached when `cancel` is due.
    pub fn end_at(&mut self, reduction: f64, cancel: &Cancel) {
        if let Self::Iterative(system) = self {
            system.end_at(reduction, cancel);
        }
    }

    /// Says where the vertices lie, one point a block, which speeds up iterative solves of many.
    ///
    /// # Errors
    /// [`SparseError::TooLarge`].
    pub fn place(&mut self, points: &[Vec3]) -> Result<(), SparseError> {
        match self {
            Self::Direct(_) => Ok(()),
            Self::Iterative(system) => system.place(points),
        }
    }

    /// Start of each block column in [`NewtonSystem::rows`]; a block column of `m` blocks has `9 m` values.
    pub fn column_starts(&self) -> &[usize] {
        delegate!(self, system => system.column_starts())
    }

    /// Block rows, ascending within each block column, the diagonal first.
    pub fn rows(&self) -> &[u32] {
        delegate!(self, system => system.rows())
    }

    /// The values, to be filled before [`NewtonSystem::factorize`], laid out as in [`BlockCholesky`].
    pub fn values_mut(&mut self) -> &mut [f64] {
        delegate!(self, system => system.values_mut())
    }

    /// The product of the matrix of the present values with a vector.
    pub fn multiply(&mut self, vector: &[f64]) -> Vec<f64> {
        delegate!(self, system => system.multiply(vector))
    }

    /// Adds `shift` times the identity to the matrix.
    pub fn shift_diagonal(&mut self, shift: f64) {
        delegate!(self, system => system.shift_diagonal(shift));
    }

    /// Adds to each diagonal block a multiple of the identity.
    pub fn shift_blocks(&mut self, shifts: &[f64]) {
        delegate!(self, system => system.shift_blocks(shifts));
    }

    /// The largest entry of the diagonal.
    pub fn largest_diagonal(&self) -> f64 {
        delegate!(self, system => system.largest_diagonal())
    }

    /// Says the subspaces, each spanned by the first columns of its frame, which are orthonormal. Iterative solves are in all of space: what
    /// leads out of a subspace must be kept at zero by the matrix itself.
    pub fn set_frames(&mut self, frames: Vec<Mat3>) {
        if let Self::Direct(system) = self {
            system.set_frames(frames);
        }
    }

    /// Prepares the solves with the present values.
    ///
    /// # Errors
    /// [`SparseError::NotPositiveDefinite`].
    pub fn factorize(&mut self) -> Result<(), SparseError> {
        delegate!(self, system => system.factorize())
    }

    /// Replaces the right-hand side by the solution with the last factorisation, or an approximation of it.
    pub fn solve(&mut self, right_hand_side: &mut [f64]) {
        delegate!(self, system => system.solve(right_hand_side));
    }

    /// The same for two right-hand sides.
    pub fn solve_pair(&mut self, pair: [&mut [f64]; 2]) {
        match self {
            Self::Direct(system) => system.solve_pair(pair),
            Self::Iterative(system) => pair.into_iter().for_each(|right_hand_side| system.solve(right_hand_side)),
        }
    }
}

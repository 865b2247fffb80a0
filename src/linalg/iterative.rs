//! The sparse symmetric positive definite solve of large Newton systems: conjugate gradients with an incomplete Cholesky
//! factor of 3x3 blocks without fill, and on large meshes a coarse space beside it ([`super::coarse`]).
//!
//! Memory grows with the number of vertices only, and so does the time of a step; a direct factor of 80,000 vertices takes
//! 40 s and 5 GB.

use std::ops::Range;

use rayon::prelude::*;

use super::coarse::CoarseSpace;
use super::pattern::BlockPattern;
use super::{Mat3, SparseError, Vec3};
use crate::cancel::Cancel;

/// Fall of the residual, in the norm of the preconditioner, at which a solve ends: with a tenth of this Newton takes as many
/// steps on 100,000 tets, in a quarter more time; with ten times this up to half as many steps again on 10,000.
pub const REDUCTION: f64 = 1e-2;
/// Most iterations of a solve; what they reached is still a direction of descent.
const ITERATIONS: usize = 400;
/// First multiple of the diagonal by which it is raised where the incomplete factor breaks down, and the growth of that.
const RAISED: (f64, f64) = (1e-3, 8.0);
/// Largest such multiple: beyond it the matrix is not positive definite by far.
const MOST_RAISED: f64 = 1.0;
/// Vertices from which affine fields on groups of them are solved for directly. With 20,000 that costs as much as it saves on shells, and a
/// third of all on meshes by TetGen; on shells of 163,000 it saves two thirds of all.
const COARSE_FROM: usize = 40_000;
/// Vertices of a group, and the most groups: the factor of more costs as much as all else.
const GROUP: usize = 200;
const MOST_GROUPS: usize = 300;
/// Block rows a parallel task works on at least.
const TASK: usize = 512;

/// A symmetric matrix of 3x3 blocks with a fixed pattern, its values laid out as in [`super::BlockCholesky`].
pub struct BlockConjugateGradients {
    pattern: BlockPattern,
    values: Vec<f64>,
    /// For each block row its blocks left of the diagonal: (column, index of the block).
    left_starts: Vec<usize>,
    left: Vec<(u32, u32)>,
    /// The matrix's blocks, and those of the incomplete factor, whose diagonal blocks are stored inverted.
    blocks: Vec<Mat3>,
    factor: Vec<Mat3>,
    /// Ends a solve at what it has reached.
    cancel: Cancel,
    /// See [`REDUCTION`].
    reduction: f64,
    coarse: Option<CoarseSpace>,
}

impl BlockConjugateGradients {
    /// Takes the pattern as edges `(row, column)` with `row > column` between `block_count` blocks; the diagonal is always
    /// there.
    pub fn new(block_count: usize, edges: &[(u32, u32)]) -> Self {
        let pattern = BlockPattern::new(3, block_count, edges);
        let mut left_starts = vec![0; block_count + 1];
        for (_, row) in pattern.entries().filter(|(column, row)| row != column) {
            left_starts[row as usize + 1] += 1;
        }
        for i in 0..block_count {
            left_starts[i + 1] += left_starts[i];
        }
        let mut next = left_starts.clone();
        let mut left = vec![(0, 0); left_starts[block_count]];
        for (index, (column, row)) in pattern.entries().enumerate() {
            if row != column {
                left[next[row as usize]] = (column, index as u32);
                next[row as usize] += 1;
            }
        }
        let values = vec![0.0; pattern.value_count()];
        let blocks = vec![Mat3::zeros(); pattern.rows.len()];
        Self {
            pattern,
            values,
            left_starts,
            left,
            factor: blocks.clone(),
            blocks,
            cancel: Cancel::default(),
            reduction: REDUCTION,
            coarse: None,
        }
    }

    /// Start of each block column in [`Self::rows`].
    pub fn column_starts(&self) -> &[usize] {
        &self.pattern.column_starts
    }

    /// Block rows, ascending within each block column, the diagonal first.
    pub fn rows(&self) -> &[u32] {
        &self.pattern.rows
    }

    /// The values, to be filled before [`Self::factorize`].
    pub fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }

    /// Adds `shift` times the identity to the matrix.
    pub fn shift_diagonal(&mut self, shift: f64) {
        for entry in self.pattern.diagonal() {
            self.values[entry] += shift;
        }
    }

    /// Adds to each diagonal block a multiple of the identity.
    pub fn shift_blocks(&mut self, shifts: &[f64]) {
        for (index, entry) in self.pattern.diagonal().enumerate() {
            self.values[entry] += shifts[index / 3];
        }
    }

    /// The largest entry of the diagonal.
    pub fn largest_diagonal(&self) -> f64 {
        self.pattern.diagonal().map(|entry| self.values[entry]).fold(0.0, f64::max)
    }

    /// From now on solves end when the residual has fallen to this share, or early when `cancel` is due: on a million tets one takes
    /// seconds.
    pub fn end_at(&mut self, reduction: f64, cancel: &Cancel) {
        (self.reduction, self.cancel) = (reduction, cancel.clone());
    }

    /// Says where the vertices lie, one point a block: where they are many, fields that are affine on groups of them are from now on
    /// solved for directly within each iteration.
    ///
    /// # Errors
    /// [`SparseError::TooLarge`].
    pub fn place(&mut self, points: &[Vec3]) -> Result<(), SparseError> {
        let groups = (points.len() / GROUP).min(MOST_GROUPS);
        if points.len() >= COARSE_FROM {
            self.coarse = Some(CoarseSpace::new(&self.pattern, points, groups)?);
        }
        Ok(())
    }

    /// The product of the matrix of the present values with a vector.
    pub fn multiply(&mut self, vector: &[f64]) -> Vec<f64> {
        self.take_blocks();
        let vector: Vec<Vec3> = vector.chunks_exact(3).map(Vec3::from_column_slice).collect();
        let mut product = vec![Vec3::zeros(); vector.len()];
        self.multiply_into(&vector, &mut product);
        product.iter().flat_map(|v| [v.x, v.y, v.z]).collect()
    }

    /// The product with the blocks last taken from the values.
    fn multiply_into(&self, vector: &[Vec3], product: &mut [Vec3]) {
        product.par_iter_mut().enumerate().with_min_len(TASK).for_each(|(i, sum)| {
            let Range { start, end } = self.pattern.column(i);
            let mut total = self.blocks[start] * vector[i];
            for k in start + 1..end {
                total += self.blocks[k].tr_mul(&vector[self.pattern.rows[k] as usize]);
            }
            for &(column, k) in &self.left[self.left_starts[i]..self.left_starts[i + 1]] {
                total += self.blocks[k as usize] * vector[column as usize];
            }
            *sum = total;
        });
    }

    /// Computes the incomplete factor of the present values.
    ///
    /// # Errors
    /// [`SparseError::NotPositiveDefinite`] if that breaks down even after the diagonal is doubled.
    pub fn factorize(&mut self) -> Result<(), SparseError> {
        self.take_blocks();
        if let Some(coarse) = &mut self.coarse {
            coarse.factorize(&self.pattern, &self.blocks);
        }
        let mut raised = 0.0;
        while !self.incomplete_factor(raised) {
            raised = if raised == 0.0 { RAISED.0 } else { RAISED.1 * raised };
            if raised > MOST_RAISED {
                return Err(SparseError::NotPositiveDefinite);
            }
        }
        Ok(())
    }

    fn take_blocks(&mut self) {
        for column in 0..self.pattern.block_count() {
            let Range { start, end } = self.pattern.column(column);
            let height = 3 * (end - start);
            for k in start..end {
                self.blocks[k] = Mat3::from_fn(|r, c| self.values[9 * start + c * height + 3 * (k - start) + r]);
            }
        }
    }

    /// The incomplete factor of the matrix with its diagonal multiplied by 1 + `raised`; false if a pivot is not positive.
    fn incomplete_factor(&mut self, raised: f64) -> bool {
        self.factor.clone_from(&self.blocks);
        for column in 0..self.pattern.block_count() {
            let start = self.pattern.column_starts[column];
            for axis in 0..3 {
                self.factor[start][(axis, axis)] *= 1.0 + raised;
            }
        }
        for column in 0..self.pattern.block_count() {
            let Range { start, end } = self.pattern.column(column);
            let Some(cholesky) = self.factor[start].cholesky() else { return false };
            let Some(inverse) = cholesky.l().try_inverse() else { return false };
            self.factor[start] = inverse;
            for k in start + 1..end {
                self.factor[k] *= inverse.transpose();
            }
            for k in start + 1..end {
                let target = self.pattern.rows[k] as usize;
                let transposed = self.factor[k].transpose();
                // Both lists ascend: the rows of this column from k on, and those of the target column.
                let Range { start: mut at, end: target_end } = self.pattern.column(target);
                for below in k..end {
                    while at < target_end && self.pattern.rows[at] < self.pattern.rows[below] {
                        at += 1;
                    }
                    if at < target_end && self.pattern.rows[at] == self.pattern.rows[below] {
                        let update = self.factor[below] * transposed;
                        self.factor[at] -= update;
                    }
                }
            }
        }
        true
    }

    /// Applies the inverse of the incomplete factor's product, and adds what solves for the fields of groups.
    fn precondition(&mut self, residual: &[Vec3], result: &mut Vec<Vec3>) {
        result.clear();
        result.extend_from_slice(residual);
        for column in 0..self.pattern.block_count() {
            let Range { start, end } = self.pattern.column(column);
            let solved = self.factor[start] * result[column];
            result[column] = solved;
            for k in start + 1..end {
                result[self.pattern.rows[k] as usize] -= self.factor[k] * solved;
            }
        }
        for column in (0..self.pattern.block_count()).rev() {
            let Range { start, end } = self.pattern.column(column);
            let mut sum = result[column];
            for k in start + 1..end {
                sum -= self.factor[k].tr_mul(&result[self.pattern.rows[k] as usize]);
            }
            result[column] = self.factor[start].tr_mul(&sum);
        }
        if let Some(coarse) = &mut self.coarse {
            coarse.add_solution(residual, result);
        }
    }

    /// Replaces the right-hand side by an approximate solution, to a share of the residual, [`REDUCTION`] if nothing else was said, or to where the curvature
    /// is not positive or the iterations are used up or it is cancelled. The solution's product with the right-hand side is positive.
    pub fn solve(&mut self, right_hand_side: &mut [f64]) {
        let mut residual: Vec<Vec3> = right_hand_side.chunks_exact(3).map(Vec3::from_column_slice).collect();
        let mut solution = vec![Vec3::zeros(); residual.len()];
        let mut product = solution.clone();
        let mut preconditioned = Vec::with_capacity(residual.len());
        self.precondition(&residual, &mut preconditioned);
        let mut direction = preconditioned.clone();
        let first = dot(&residual, &preconditioned);
        let mut square = first;
        for iteration in 0..ITERATIONS {
            if square <= self.reduction * self.reduction * first || iteration > 0 && self.cancel.is_due() {
                break;
            }
            self.multiply_into(&direction, &mut product);
            let curvature = dot(&direction, &product);
            if curvature <= 0.0 {
                if iteration == 0 {
                    solution.clone_from(&direction);
                }
                break;
            }
            let length = square / curvature;
            for i in 0..residual.len() {
                solution[i] += direction[i] * length;
                residual[i] -= product[i] * length;
            }
            self.precondition(&residual, &mut preconditioned);
            let next = dot(&residual, &preconditioned);
            let share = next / square;
            square = next;
            for (d, p) in direction.iter_mut().zip(&preconditioned) {
                *d = p + *d * share;
            }
        }
        for (entries, v) in right_hand_side.chunks_exact_mut(3).zip(&solution) {
            entries.copy_from_slice(v.as_slice());
        }
    }
}

fn dot(a: &[Vec3], b: &[Vec3]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x.dot(y)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grid's Laplacian plus a share of the identity, times a positive definite 3x3 block.
    fn laplacian(side: u32, identity: f64) -> (BlockConjugateGradients, nalgebra::DMatrix<f64>) {
        let edges: Vec<(u32, u32)> = (0..side * side)
            .flat_map(|i| {
                [(i % side + 1 < side).then_some((i + 1, i)), (i + side < side * side).then_some((i + side, i))]
            })
            .flatten()
            .collect();
        let count = (side * side) as usize;
        let block = Mat3::new(4.0, 1.0, 0.5, 1.0, 3.0, 0.2, 0.5, 0.2, 2.0);
        let mut dense = identity * nalgebra::DMatrix::<f64>::identity(3 * count, 3 * count);
        for &(a, b) in &edges {
            let (a, b) = (3 * a as usize, 3 * b as usize);
            for (row, column, sign) in [(a, a, 1.0), (b, b, 1.0), (a, b, -1.0), (b, a, -1.0)] {
                let mut view = dense.view_mut((row, column), (3, 3));
                view += sign * block;
            }
        }
        let mut system = BlockConjugateGradients::new(count, &edges);
        let (starts, rows) = (system.column_starts().to_vec(), system.rows().to_vec());
        for column in 0..count {
            let height = starts[column + 1] - starts[column];
            for k in 0..height {
                for (r, c) in (0..9).map(|i| (i % 3, i / 3)) {
                    system.values_mut()[9 * starts[column] + c * 3 * height + 3 * k + r] =
                        dense[(3 * rows[starts[column] + k] as usize + r, 3 * column + c)];
                }
            }
        }
        (system, dense)
    }

    #[test]
    fn solves_a_block_laplacian_to_its_reduction() {
        let (mut system, dense) = laplacian(12, 0.1);
        let expected = nalgebra::DVector::from_fn(dense.nrows(), |i, _| (i as f64 * 0.7).sin());
        let right = &dense * &expected;
        for (got, want) in system.multiply(expected.as_slice()).iter().zip(right.iter()) {
            assert!((got - want).abs() < 1e-12);
        }
        system.factorize().unwrap();
        let mut solution = right.data.as_vec().clone();
        system.solve(&mut solution);
        // The norm of the residual in the preconditioner falls by REDUCTION; that of the error in the matrix by as much times
        // the root of the preconditioned condition number, which is below 100 for 12 x 12 points.
        let error = nalgebra::DVector::from_vec(solution) - &expected;
        let energy = |v: &nalgebra::DVector<f64>| v.dot(&(&dense * v)).sqrt();
        assert!(energy(&error) <= 10.0 * REDUCTION * energy(&expected));
    }

    #[test]
    fn what_is_not_positive_definite_is_refused_or_gives_a_direction_of_descent() {
        let (mut system, _) = laplacian(6, 0.1);
        system.shift_diagonal(-1e3);
        assert_eq!(system.factorize(), Err(SparseError::NotPositiveDefinite));
        // Slightly indefinite: the incomplete factor is of a raised diagonal, and the iteration ends at negative curvature.
        let (mut system, dense) = laplacian(6, -0.2);
        assert!(dense.symmetric_eigenvalues().min() < 0.0);
        system.factorize().unwrap();
        let gradient: Vec<f64> = (0..dense.nrows()).map(|i| 1.0 + 0.1 * (i as f64).sin()).collect();
        let mut direction = gradient.clone();
        system.solve(&mut direction);
        assert!(gradient.iter().zip(&direction).map(|(g, d)| g * d).sum::<f64>() > 0.0);
    }
}

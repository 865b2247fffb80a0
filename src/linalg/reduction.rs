//! The part of a matrix of 3x3 blocks in a subspace of each block's unknowns.

use super::pattern::BlockPattern;
use super::{Mat3, Vec3};

/// Subspaces of the unknowns of each block of a matrix A, and T^T A T for T their orthonormal bases.
pub(super) struct Reduction {
    dimensions: Vec<usize>,
    /// The first columns, as many as there are dimensions, are orthonormal and span the subspace; not asked for where that is all.
    pub frames: Vec<Mat3>,
    values: Vec<f64>,
}

impl Reduction {
    /// Subspaces of these dimensions, along the first axes until other frames are given.
    pub fn new(dimensions: &[usize], blocks: &BlockPattern) -> Self {
        let of_block = |(column, row): (u32, u32)| dimensions[column as usize] * dimensions[row as usize];
        let count = blocks.entries().map(of_block).sum();
        let frames = vec![Mat3::identity(); dimensions.len()];
        Self { dimensions: dimensions.to_vec(), frames, values: vec![0.0; count] }
    }

    /// The reduced values, by columns of their full height, of these values of the whole.
    pub fn reduce(&mut self, blocks: &BlockPattern, values: &[f64]) -> &[f64] {
        let mut start = 0;
        for column in 0..self.dimensions.len() {
            let rows = &blocks.rows[blocks.column(column)];
            let whole = &values[9 * blocks.column(column).start..][..9 * rows.len()];
            let height: usize = rows.iter().map(|&row| self.dimensions[row as usize]).sum();
            let mut offset = 0;
            for (k, &row) in rows.iter().enumerate() {
                let mut block = Mat3::from_fn(|r, c| whole[3 * rows.len() * c + 3 * k + r]);
                let dimension = self.dimensions[row as usize];
                if dimension != 3 {
                    block = self.frames[row as usize].tr_mul(&block);
                }
                if self.dimensions[column] != 3 {
                    block *= self.frames[column];
                }
                for c in 0..self.dimensions[column] {
                    let entries = &mut self.values[start + c * height + offset..][..dimension];
                    entries.iter_mut().enumerate().for_each(|(r, entry)| *entry = block[(r, c)]);
                }
                offset += dimension;
            }
            start += self.dimensions[column] * height;
        }
        &self.values
    }

    /// T^T b.
    pub fn restrict(&self, whole: &[f64]) -> Vec<f64> {
        let mut reduced = Vec::with_capacity(whole.len());
        for ((entries, &dimension), frame) in whole.chunks_exact(3).zip(&self.dimensions).zip(&self.frames) {
            match dimension {
                3 => reduced.extend_from_slice(entries),
                _ => reduced.extend(frame.tr_mul(&Vec3::from_column_slice(entries)).iter().take(dimension)),
            }
        }
        reduced
    }

    /// T x.
    pub fn extend(&self, mut reduced: &[f64], whole: &mut [f64]) {
        for ((entries, &dimension), frame) in whole.chunks_exact_mut(3).zip(&self.dimensions).zip(&self.frames) {
            let (of_block, rest) = reduced.split_at(dimension);
            match dimension {
                3 => entries.copy_from_slice(of_block),
                _ => {
                    let sum: Vec3 = of_block.iter().zip(frame.column_iter()).map(|(x, axis)| axis * *x).sum();
                    entries.copy_from_slice(sum.as_slice());
                }
            }
            reduced = rest;
        }
    }
}

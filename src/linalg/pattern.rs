//! The pattern of a symmetric matrix of square blocks, stored by block columns.

use std::ops::Range;

/// The blocks of the lower triangle: block column `j` holds `size * size` values for each of its blocks, as `size` scalar
/// columns of full height each (the diagonal block is stored whole).
pub(super) struct BlockPattern {
    pub size: usize,
    /// Start of each block column in the rows.
    pub column_starts: Vec<usize>,
    /// Block rows, ascending within each block column, the diagonal first.
    pub rows: Vec<u32>,
}

impl BlockPattern {
    /// The pattern of edges `(row, column)` with `row > column` between `block_count` blocks, and the diagonal.
    pub(super) fn new(size: usize, block_count: usize, edges: &[(u32, u32)]) -> Self {
        let mut entries: Vec<(u32, u32)> = edges.iter().map(|&(row, column)| (column, row)).collect();
        entries.extend((0..block_count as u32).map(|i| (i, i)));
        entries.sort_unstable();
        entries.dedup();
        let mut column_starts = vec![0; block_count + 1];
        for &(column, _) in &entries {
            column_starts[column as usize + 1] += 1;
        }
        for column in 0..block_count {
            column_starts[column + 1] += column_starts[column];
        }
        Self { size, column_starts, rows: entries.into_iter().map(|(_, row)| row).collect() }
    }

    pub(super) fn block_count(&self) -> usize {
        self.column_starts.len() - 1
    }

    /// The blocks of a block column.
    pub(super) fn column(&self, column: usize) -> Range<usize> {
        self.column_starts[column]..self.column_starts[column + 1]
    }

    /// All blocks as (column, row), by columns.
    pub(super) fn entries(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        (0..self.block_count())
            .flat_map(|column| self.rows[self.column(column)].iter().map(move |&row| (column as u32, row)))
    }

    /// Number of values.
    pub(super) fn value_count(&self) -> usize {
        self.size * self.size * self.rows.len()
    }

    /// The index of each entry of the diagonal among the values, block by block.
    pub(super) fn diagonal(&self) -> impl Iterator<Item = usize> + '_ {
        let size = self.size;
        (0..self.block_count()).flat_map(move |column| {
            let blocks = self.column(column);
            (0..size).map(move |c| size * size * blocks.start + c * size * blocks.len() + c)
        })
    }
}

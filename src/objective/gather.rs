//! From tets to unknowns: which contributions an unknown has, and where the blocks of a system stand.

use super::element::ElementDerivatives;
use crate::mesh::{Mat3, VertexId};

/// Lists of contributions, one list an unknown.
pub(super) struct Gather {
    pub starts: Vec<usize>,
    pub items: Vec<u32>,
}

impl Gather {
    /// Groups `(unknown, contribution)` pairs, which must come with contributions ascending for each unknown.
    pub fn new(count: usize, pairs: impl Iterator<Item = (usize, u32)> + Clone) -> Self {
        let mut starts = vec![0; count + 1];
        for (unknown, _) in pairs.clone() {
            starts[unknown + 1] += 1;
        }
        for i in 0..count {
            starts[i + 1] += starts[i];
        }
        let mut next = starts.clone();
        let mut items = vec![0; starts[count]];
        for (unknown, contribution) in pairs {
            items[next[unknown]] = contribution;
            next[unknown] += 1;
        }
        Self { starts, items }
    }

    pub fn of(&self, unknown: usize) -> &[u32] {
        &self.items[self.starts[unknown]..self.starts[unknown + 1]]
    }
}

/// For each of `count` vertices its position in a list.
pub(super) fn positions_in(list: &[u32], count: usize) -> Vec<Option<u32>> {
    let mut positions = vec![None; count];
    for (position, &vertex) in (0..).zip(list) {
        positions[vertex as usize] = Some(position);
    }
    positions
}

/// The pairs (larger, smaller) of unknowns that share a tet.
pub(super) fn edges(tets: &[[VertexId; 4]], unknown_of: &[Option<u32>]) -> Vec<(u32, u32)> {
    let pairs = tets.iter().flat_map(|tet| ElementDerivatives::PAIRS.map(|(v, w)| (tet[v], tet[w])));
    let mut edges: Vec<(u32, u32)> = pairs
        .filter_map(|(v, w)| Some((unknown_of[v.index()]?, unknown_of[w.index()]?)))
        .filter(|(a, b)| a != b)
        .map(|(a, b)| (a.max(b), a.min(b)))
        .collect();
    edges.sort_unstable();
    edges.dedup();
    edges
}

/// What belongs to each block column, of a list with `each` entries a block.
pub(super) fn split_columns<'v, T>(mut values: &'v mut [T], starts: &[usize], each: usize) -> Vec<&'v mut [T]> {
    starts
        .windows(2)
        .map(|pair| {
            let (column, rest) = std::mem::take(&mut values).split_at_mut(each * (pair[1] - pair[0]));
            values = rest;
            column
        })
        .collect()
}

/// Writes the `k`-th block of a block column of `height` blocks.
pub(super) fn put_block(values: &mut [f64], height: usize, k: usize, block: &Mat3) {
    for c in 0..3 {
        for r in 0..3 {
            values[c * 3 * height + 3 * k + r] = block[(r, c)];
        }
    }
}

//! Stretches from the lengths of edges (paper eq. 26).

use crate::mesh::{Cells, Vec3};

/// The largest and the least |e'| / |e| over the edges of a cell at one of its corners.
pub(super) fn at_corner(cells: Cells, cell: usize, corner: usize, domain: &[Vec3], image: &[Vec3]) -> [f64; 2] {
    let vertices = cells.vertices(cell);
    let length =
        |points: &[Vec3], other: usize| (points[vertices[other].index()] - points[vertices[corner].index()]).norm();
    let ratios = cells.neighbours(corner).map(|other| length(image, other) / length(domain, other));
    ratios.into_iter().map(|ratio| [ratio, ratio]).reduce(widen).expect("a corner has three edges")
}

/// The larger of the largest and the lesser of the least.
pub(super) fn widen(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0].max(b[0]), a[1].min(b[1])]
}

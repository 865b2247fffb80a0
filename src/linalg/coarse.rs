//! A coarse space for conjugate gradients: fields that are affine on each of some groups of neighbouring vertices.
//!
//! An incomplete factor takes an error out over a few edges; what varies slowly takes as many iterations as the mesh has
//! vertices across. With P the fields of the groups, `B r = (L L^T)^-1 r + P (P^T A P)^-1 P^T r` takes out both (the additive Schwarz
//! method with two levels; Nicolaides 1987). Affine fields hold the motions that dilatations do not see: translations, rotations
//! and changes of scale.

use super::pattern::BlockPattern;
use super::{BlockCholesky, Mat3, SparseError, Vec3};

/// Functions of a group: the constant and the three coordinates.
const MODES: usize = 4;
/// Unknowns of a group: a vector for each function.
const SIZE: usize = 3 * MODES;
/// The part of its norm that must be left of a function after the others are taken out of it; else it is taken for zero, as
/// that of one coordinate where the group lies in a plane.
const INDEPENDENT: f64 = 1e-3;

/// The groups, and the matrix restricted to their fields.
pub(super) struct CoarseSpace {
    /// The group of each block.
    group_of: Vec<u32>,
    /// The values of its group's functions at each block, orthonormal over the group.
    modes: Vec<[f64; MODES]>,
    /// For each block of the fine matrix the block of the coarse one that it adds to, and whether transposed.
    slots: Vec<(u32, bool)>,
    system: BlockCholesky,
    /// Whether the last matrix could be factorised; the space is passed over where not.
    is_factorised: bool,
    right_hand_side: Vec<f64>,
}

impl CoarseSpace {
    /// Groups of blocks that lie at these points, halved along their widest extent until there are at least `groups`.
    pub(super) fn new(pattern: &BlockPattern, points: &[Vec3], groups: usize) -> Result<Self, SparseError> {
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        let mut group_of = vec![0; points.len()];
        let mut modes = vec![[0.0; MODES]; points.len()];
        let mut count = 0;
        halve(&mut order, points, points.len().div_ceil(groups).max(SIZE), &mut |group| {
            orthonormal(group, points, &mut modes);
            group.iter().for_each(|&v| group_of[v as usize] = count);
            count += 1;
        });
        let pairs = || pattern.entries().map(|(column, row)| (group_of[column as usize], group_of[row as usize]));
        let mut edges: Vec<(u32, u32)> = pairs().filter(|(a, b)| a != b).map(|(a, b)| (a.max(b), a.min(b))).collect();
        edges.sort_unstable();
        edges.dedup();
        let system = BlockCholesky::with_block_size(SIZE, count as usize, &edges)?;
        let slot = |(a, b): (u32, u32)| {
            let (row, column) = (a.max(b), a.min(b) as usize);
            let (start, end) = (system.column_starts()[column], system.column_starts()[column + 1]);
            let k = system.rows()[start..end].binary_search(&row).expect("every pair of neighbours is in the pattern");
            ((start + k) as u32, a > b)
        };
        let slots = pairs().map(slot).collect();
        let right_hand_side = vec![0.0; SIZE * count as usize];
        Ok(Self { group_of, modes, slots, system, is_factorised: false, right_hand_side })
    }

    /// Restricts the matrix of these blocks to the space and factorises it.
    pub(super) fn factorize(&mut self, pattern: &BlockPattern, blocks: &[Mat3]) {
        let starts = self.system.column_starts().to_vec();
        let values = self.system.values_mut();
        values.fill(0.0);
        for (index, (column, row)) in pattern.entries().enumerate() {
            let (slot, transposed) = self.slots[index];
            let groups = [row, column].map(|v| self.group_of[v as usize]);
            let coarse_column = groups[0].min(groups[1]) as usize;
            let (start, end) = (starts[coarse_column], starts[coarse_column + 1]);
            let (height, k) = (SIZE * (end - start), slot as usize - start);
            let block = &blocks[index];
            let mut add = |left: &[f64; MODES], right: &[f64; MODES], block: &Mat3| {
                for b in 0..MODES {
                    for c in 0..3 {
                        let entries = &mut values[SIZE * SIZE * start + (3 * b + c) * height + SIZE * k..][..SIZE];
                        for a in 0..MODES {
                            let share = left[a] * right[b];
                            for r in 0..3 {
                                entries[3 * a + r] += share * block[(r, c)];
                            }
                        }
                    }
                }
            };
            let (of_row, of_column) = (&self.modes[row as usize], &self.modes[column as usize]);
            if transposed {
                add(of_column, of_row, &block.transpose());
            } else {
                add(of_row, of_column, block);
                if groups[0] == groups[1] && row != column {
                    add(of_column, of_row, &block.transpose());
                }
            }
        }
        // Functions that are zero.
        for column in 0..starts.len() - 1 {
            let height = SIZE * (starts[column + 1] - starts[column]);
            for c in 0..SIZE {
                let entry = &mut values[SIZE * SIZE * starts[column] + c * height + c];
                if *entry == 0.0 {
                    *entry = 1.0;
                }
            }
        }
        self.is_factorised = self.system.factorize().is_ok();
    }

    /// Adds to `result` the solution of the coarse system with the restriction of `residual`.
    pub(super) fn add_solution(&mut self, residual: &[Vec3], result: &mut [Vec3]) {
        if !self.is_factorised {
            return;
        }
        self.right_hand_side.fill(0.0);
        for ((entries, &group), modes) in residual.iter().zip(&self.group_of).zip(&self.modes) {
            let coarse = &mut self.right_hand_side[SIZE * group as usize..][..SIZE];
            for (a, mode) in modes.iter().enumerate() {
                for r in 0..3 {
                    coarse[3 * a + r] += mode * entries[r];
                }
            }
        }
        self.system.solve(&mut self.right_hand_side);
        for ((entries, &group), modes) in result.iter_mut().zip(&self.group_of).zip(&self.modes) {
            let coarse = &self.right_hand_side[SIZE * group as usize..][..SIZE];
            for (a, mode) in modes.iter().enumerate() {
                for r in 0..3 {
                    entries[r] += mode * coarse[3 * a + r];
                }
            }
        }
    }
}

/// Halves a set of points along its widest extent until no part has more than `most`, and hands them over.
fn halve(part: &mut [u32], points: &[Vec3], most: usize, take: &mut dyn FnMut(&[u32])) {
    if part.len() <= most {
        return take(part);
    }
    let extreme = |pick: fn(&Vec3, &Vec3) -> Vec3| {
        part.iter().map(|&v| points[v as usize]).reduce(|a, b| pick(&a, &b)).unwrap_or_default()
    };
    let axis = (extreme(|a, b| a.sup(b)) - extreme(|a, b| a.inf(b))).imax();
    part.sort_unstable_by(|&a, &b| points[a as usize][axis].total_cmp(&points[b as usize][axis]).then(a.cmp(&b)));
    let (left, right) = part.split_at_mut(part.len() / 2);
    halve(left, points, most, take);
    halve(right, points, most, take);
}

/// The constant and the coordinates on a group, made orthonormal by Gram and Schmidt.
fn orthonormal(group: &[u32], points: &[Vec3], modes: &mut [[f64; MODES]]) {
    let centre = group.iter().map(|&v| points[v as usize]).sum::<Vec3>() / group.len() as f64;
    for &v in group {
        let offset = points[v as usize] - centre;
        modes[v as usize] = [1.0, offset.x, offset.y, offset.z];
    }
    for mode in 0..MODES {
        let norm = |modes: &[[f64; MODES]]| group.iter().map(|&v| modes[v as usize][mode].powi(2)).sum::<f64>().sqrt();
        let before = norm(modes);
        for other in 0..mode {
            let share: f64 = group.iter().map(|&v| modes[v as usize][mode] * modes[v as usize][other]).sum();
            group.iter().for_each(|&v| modes[v as usize][mode] -= share * modes[v as usize][other]);
        }
        let after = norm(modes);
        let scale = if after > INDEPENDENT * before { after.recip() } else { 0.0 };
        group.iter().for_each(|&v| modes[v as usize][mode] *= scale);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The system of a grid's Laplacian plus a share of the identity, times a positive definite block, and the points.
    fn grid(sides: [usize; 3]) -> (BlockPattern, Vec<Mat3>, Vec<Vec3>) {
        let count: usize = sides.iter().product();
        let steps = [1, sides[0], sides[0] * sides[1]];
        let at = |v: usize| [0, 1, 2].map(|axis| v / steps[axis] % sides[axis]);
        let edges: Vec<(u32, u32)> = (0..count)
            .flat_map(|v| {
                (0..3).filter(move |&axis| at(v)[axis] + 1 < sides[axis]).map(move |axis| (v + steps[axis], v))
            })
            .map(|(row, column)| (row as u32, column as u32))
            .collect();
        let block = Mat3::new(4.0, 1.0, 0.5, 1.0, 3.0, 0.2, 0.5, 0.2, 2.0);
        let pattern = BlockPattern::new(3, count, &edges);
        let degree = |v: u32| edges.iter().filter(|(a, b)| *a == v || *b == v).count() as f64;
        let entry = |(column, row): (u32, u32)| if row == column { block * (degree(row) + 0.1) } else { -block };
        let blocks = pattern.entries().map(entry).collect();
        let points = (0..count).map(|v| Vec3::from(at(v).map(|x| x as f64))).collect();
        (pattern, blocks, points)
    }

    #[test]
    fn what_is_affine_on_each_group_is_solved_for() {
        // In the second all points lie in a plane, and one coordinate is no function of its own.
        for sides in [[6, 5, 4], [12, 10, 1]] {
            let (pattern, blocks, points) = grid(sides);
            let mut coarse = CoarseSpace::new(&pattern, &points, 4).unwrap();
            coarse.factorize(&pattern, &blocks);
            assert!(coarse.is_factorised);
            let gradient = Mat3::new(0.3, -1.0, 0.2, 0.5, 0.1, -0.4, 0.7, 0.2, -0.6);
            let field = |v: usize| gradient * points[v] * f64::from(coarse.group_of[v] + 1) + Vec3::new(1.0, 2.0, -3.0);
            let wanted: Vec<Vec3> = (0..points.len()).map(field).collect();
            let mut residual = vec![Vec3::zeros(); points.len()];
            for ((column, row), block) in pattern.entries().zip(&blocks) {
                let (row, column) = (row as usize, column as usize);
                residual[row] += block * wanted[column];
                if row != column {
                    residual[column] += block.tr_mul(&wanted[row]);
                }
            }
            let mut got = vec![Vec3::zeros(); points.len()];
            coarse.add_solution(&residual, &mut got);
            // The condition number of the grids is below 1e4.
            let worst = got.iter().zip(&wanted).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
            assert!(worst < 1e-10, "{sides:?} {worst}");
        }
    }
}

//! The multipliers of one tet: how they come from a barrier, and the trace condition, rounded to the safe side.

use super::interval::{Interval, dot};
use super::relaxed::{Barrier, Level};
use crate::mesh::{Mat3, Vec3};

/// The multipliers of one tet; S and R as their Cholesky factors, so that nothing has to be shown of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Multipliers {
    /// The lower triangle of L with `S = L L^T`: `[L11, L21, L22, L31, L32, L33]`.
    pub(super) lower: [f64; 6],
    /// The same for R.
    pub(super) upper: [f64; 6],
    /// rho.
    pub(super) trace: f64,
}

impl Multipliers {
    /// The multipliers of a barrier times `scale`, R and rho stretched so that they pass the trace condition of `level` with
    /// little to spare.
    pub(super) fn of(barrier: &Barrier, level: Level, scale: f64) -> Self {
        /// Left for the rounding of the traces and factors.
        const SPARE: f64 = 1e-13;
        let factor = |eigenvalues: &Vec3, scale: f64| -> [f64; 6] {
            let matrix = barrier.axes * Mat3::from_diagonal(&(eigenvalues * scale)) * barrier.axes.transpose();
            // Where rounding makes a huge ratio of eigenvalues indefinite, nothing is a multiplier, too.
            matrix.cholesky().map_or([0.0; 6], |factor| {
                let l = factor.l();
                [l[(0, 0)], l[(1, 0)], l[(1, 1)], l[(2, 0)], l[(2, 1)], l[(2, 2)]]
            })
        };
        let paid = level.ratio * barrier.upper.sum() + level.trace * barrier.trace;
        let stretch = (1.0 - SPARE) * barrier.lower.sum() / paid;
        Self {
            lower: factor(&barrier.lower, scale),
            upper: factor(&barrier.upper, scale * stretch),
            trace: barrier.trace * scale * stretch,
        }
    }

    /// Whether `tr S >= k^(4/3) tr R + (1 + k^(2/3) + k^(4/3)) rho`, rho >= 0, all rounded to the safe side.
    pub(super) fn satisfy_the_trace_condition(&self, level: f64) -> bool {
        let root = cube_root_above(level);
        let square = root * root;
        let trace = |factor: &[f64; 6]| {
            factor.iter().map(|&entry| Interval::exactly(entry)).fold(Interval::ZERO, |sum, entry| sum + entry * entry)
        };
        let (ratio, constant) = (square * square, Interval::exactly(1.0) + square + square * square);
        let paid = ratio * trace(&self.upper) + constant * Interval::exactly(self.trace);
        self.trace >= 0.0 && trace(&self.lower).lower >= paid.upper
    }

    /// `M = S - R - rho I`, enclosed.
    pub(super) fn form(&self) -> [[Interval; 3]; 3] {
        let square = |factor: &[f64; 6]| {
            let f = factor.map(Interval::exactly);
            let rows = [[f[0], Interval::ZERO, Interval::ZERO], [f[1], f[2], Interval::ZERO], [f[3], f[4], f[5]]];
            rows.map(|row| rows.map(|other| dot(row, other)))
        };
        let (lower, upper) = (square(&self.lower), square(&self.upper));
        [0, 1, 2].map(|i| {
            [0, 1, 2].map(|j| {
                let entry = lower[i][j] - upper[i][j];
                if i == j { entry - Interval::exactly(self.trace) } else { entry }
            })
        })
    }
}

/// An interval whose upper end is at least the cube root of `level`; that is verified, not taken from the library.
fn cube_root_above(level: f64) -> Interval {
    let mut root = level.cbrt();
    loop {
        let cube = Interval::exactly(root) * Interval::exactly(root) * Interval::exactly(root);
        if cube.lower >= level || !root.is_finite() {
            return Interval::exactly(root);
        }
        root = root.next_up();
    }
}

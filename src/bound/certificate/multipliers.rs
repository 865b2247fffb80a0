//! The multipliers of one tet: how they come from a search, and the trace condition, rounded to the safe side.

use super::dual::{Dual, Level};
use crate::linalg::interval::{Interval, dot};
use crate::mesh::Mat3;

/// The multipliers of one tet; S, T and R as their Cholesky factors and W as a product, so that nothing has to be shown of
/// them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Multipliers {
    /// The lower triangle of L with `S = L L^T`: `[L11, L21, L22, L31, L32, L33]`.
    pub(super) lower: [f64; 6],
    /// The same for T.
    pub(super) volume: [f64; 6],
    /// The same for R.
    pub(super) upper: [f64; 6],
    /// rho.
    pub(super) trace: f64,
    /// X and Y with `W = X Y^T`, row by row.
    pub(super) cofactor: [[f64; 9]; 2],
    /// eta and e.
    pub(super) determinant: [f64; 2],
}

impl Multipliers {
    /// The multipliers that were found times `scale`, R, rho and W multiplied so that they pass the trace condition of
    /// `level` with little to spare.
    pub(super) fn of(dual: &Dual, level: Level, scale: f64) -> Self {
        /// Left for the rounding of the traces and factors.
        const SPARE: f64 = 1e-13;
        let factor = |matrix: Mat3| -> [f64; 6] {
            // Where rounding makes a huge ratio of eigenvalues indefinite, nothing is a multiplier, too.
            matrix.cholesky().map_or([0.0; 6], |factor| {
                let l = factor.l();
                [l[(0, 0)], l[(1, 0)], l[(1, 1)], l[(2, 0)], l[(2, 1)], l[(2, 2)]]
            })
        };
        let [stretch, of_cofactor] = dual.stretch(level).map(|stretch| (1.0 - SPARE) * stretch * scale);
        let mut cofactor = [[0.0; 9]; 2];
        let svd = dual.cofactor.svd(true, true);
        if let (Some(u), Some(v_t)) = (svd.u, svd.v_t) {
            for (index, (row, column)) in (0..9).map(|index| (index, (index / 3, index % 3))) {
                let root = (svd.singular_values[column] * of_cofactor).sqrt();
                cofactor[0][index] = u[(row, column)] * root;
                cofactor[1][index] = v_t[(column, row)] * root;
            }
        }
        let [eta, e] = dual.determinant;
        Self {
            lower: factor(dual.lower * scale),
            volume: factor(dual.volume * scale),
            upper: factor(dual.upper * stretch),
            trace: dual.trace * stretch,
            cofactor,
            determinant: [eta * scale, e],
        }
    }

    /// Whether eta is not zero: the determinant, and so the orientation, is used.
    pub(super) fn is_oriented(&self) -> bool {
        self.determinant[0] != 0.0
    }

    /// Whether Q couples the coordinates.
    pub(super) fn couples_coordinates(&self) -> bool {
        self.is_oriented() || self.cofactor.iter().any(|factor| factor.iter().any(|&entry| entry != 0.0))
    }

    /// Whether `tr S + k^(2/3) (3 (det T)^(1/3) + 1.5 eta e) >= k^(4/3) tr R + c rho + k |W|_*` and rho, eta, e >= 0, all
    /// rounded to the safe side. The nuclear norm of `W = X Y^T` is at most half the sum of the squares of all entries of X
    /// and Y.
    pub(super) fn satisfy_the_trace_condition(&self, level: f64) -> bool {
        let root = Interval::exactly(level).cbrt();
        let square = root * root;
        let squares = |entries: &[f64]| {
            let squares = entries.iter().map(|&entry| Interval::exactly(entry) * Interval::exactly(entry));
            squares.fold(Interval::ZERO, |sum, square| sum + square)
        };
        let [l11, _, l22, _, _, l33] = self.volume.map(Interval::exactly);
        let product = l11 * l22 * l33;
        let mean = product.square().cbrt();
        let [eta, e] = self.determinant;
        let tangent = Interval::exactly(1.5) * Interval::exactly(eta) * Interval::exactly(e);
        let earned = squares(&self.lower) + square * (Interval::exactly(3.0) * mean + tangent);
        let norm = Interval::exactly(0.5) * (squares(&self.cofactor[0]) + squares(&self.cofactor[1]));
        let constant = Interval::exactly(1.0) + square + square * square;
        let paid =
            square * square * squares(&self.upper) + constant * Interval::exactly(self.trace) + square * root * norm;
        let signs = self.trace >= 0.0 && eta >= 0.0 && (e > 0.0 || (eta == 0.0 && e == 0.0));
        signs && earned.lower >= paid.upper
    }

    /// `M = S + T - R - rho I`, enclosed.
    pub(super) fn form(&self) -> [[Interval; 3]; 3] {
        let square = |factor: &[f64; 6]| {
            let f = factor.map(Interval::exactly);
            let rows = [[f[0], Interval::ZERO, Interval::ZERO], [f[1], f[2], Interval::ZERO], [f[3], f[4], f[5]]];
            rows.map(|row| rows.map(|other| dot(row, other)))
        };
        let (lower, volume, upper) = (square(&self.lower), square(&self.volume), square(&self.upper));
        [0, 1, 2].map(|i| {
            [0, 1, 2].map(|j| {
                let entry = lower[i][j] + volume[i][j] - upper[i][j];
                if i == j { entry - Interval::exactly(self.trace) } else { entry }
            })
        })
    }

    /// W, enclosed.
    pub(super) fn cofactor_form(&self) -> [[Interval; 3]; 3] {
        let rows = |factor: &[f64; 9]| [0, 1, 2].map(|i| [0, 1, 2].map(|j| Interval::exactly(factor[3 * i + j])));
        let (left, right) = (rows(&self.cofactor[0]), rows(&self.cofactor[1]));
        left.map(|row| right.map(|other| dot(row, other)))
    }

    /// `eta e^3 / 2`, enclosed.
    pub(super) fn constant(&self) -> Interval {
        let [eta, e] = self.determinant.map(Interval::exactly);
        Interval::exactly(0.5) * eta * e * e * e
    }
}

//! Convex quadratic programs with few unknowns and any number of inequalities.

use nalgebra::{Cholesky, SMatrix, SVector};

/// Part of the way to the nearest constraint that a step goes.
const STEP: f64 = 0.99;
/// Steps after which nothing better is expected; 10 to 25 are usual.
const MOST_STEPS: usize = 100;
/// A step shorter than this part of Newton's gains nothing: rounding has taken over.
const LEAST_STEP: f64 = 1e-6;

/// Minimize `x . P x / 2 + q . x` subject to `a_i . x <= b_i`, with P symmetric and positive semidefinite.
///
/// The inequalities are taken to have an inner point, and the minimum to be finite.
pub struct QuadraticProgram<'a, const N: usize> {
    /// P; zero for a linear program.
    pub quadratic: SMatrix<f64, N, N>,
    /// q.
    pub linear: SVector<f64, N>,
    /// The a_i.
    pub rows: &'a [SVector<f64, N>],
    /// The b_i.
    pub bounds: &'a [f64],
}

/// The best point found.
pub struct Optimum<const N: usize> {
    /// x; the middle of all solutions where there are several.
    pub point: SVector<f64, N>,
    /// A multiplier of each inequality, all positive.
    pub multipliers: Vec<f64>,
    /// By how much the conditions of optimality fail, in units of the data: the largest of infeasibility, dual infeasibility and gap.
    pub residual: f64,
}

/// x, and the slack and the multiplier of each inequality.
#[derive(Clone)]
struct Iterate<const N: usize> {
    point: SVector<f64, N>,
    slacks: Vec<f64>,
    multipliers: Vec<f64>,
}

impl<const N: usize> QuadraticProgram<'_, N> {
    /// Mehrotra's predictor-corrector method (S. Mehrotra, *On the implementation of a primal-dual interior point method*, SIAM J.
    /// Optim. 2, 1992), the slacks and multipliers eliminated: an N x N system a step. It ends at a residual of `accuracy`, or where
    /// rounding leaves no progress.
    pub fn solve(&self, accuracy: f64) -> Optimum<N> {
        let count = self.rows.len().max(1) as f64;
        let mut now = Iterate {
            point: SVector::zeros(),
            slacks: self.bounds.iter().map(|bound| bound.max(1.0)).collect(),
            multipliers: vec![(1.0 + self.linear.amax()) / count; self.rows.len()],
        };
        let (mut best, mut least) = (now.clone(), f64::INFINITY);
        for _ in 0..MOST_STEPS {
            let residual = self.residual(&now);
            if residual < least {
                (best, least) = (now.clone(), residual);
            }
            if residual.is_nan() || residual <= accuracy {
                break;
            }
            let Some(factor) = self.factor(&now) else { break };
            let gap = now.gap();
            // The predictor aims at a gap of 0; by what it reaches the corrector knows how far from the walls to stay.
            let none = vec![0.0; self.rows.len()];
            let ahead = self.direction(&now, &factor, 0.0, &none);
            let reached = now.moved(&ahead, now.longest_step(&ahead)).gap() / gap;
            let products: Vec<f64> = ahead.slacks.iter().zip(&ahead.multipliers).map(|(s, z)| s * z).collect();
            let direction = self.direction(&now, &factor, reached.powi(3) * gap / count, &products);
            let length = (STEP * now.longest_step(&direction)).min(1.0);
            if length.is_nan() || length < LEAST_STEP {
                break;
            }
            now = now.moved(&direction, length);
        }
        Optimum { point: best.point, multipliers: best.multipliers, residual: least }
    }

    /// `P x + q + sum z_i a_i`.
    fn dual(&self, at: &Iterate<N>) -> SVector<f64, N> {
        let forces = self.rows.iter().zip(&at.multipliers).fold(SVector::zeros(), |sum, (row, z)| sum + row * *z);
        self.quadratic * at.point + self.linear + forces
    }

    /// `a_i . x + s_i - b_i`.
    fn primal<'b>(&'b self, at: &'b Iterate<N>) -> impl Iterator<Item = f64> + 'b {
        let rows = self.rows.iter().zip(self.bounds).zip(&at.slacks);
        rows.map(|((row, bound), slack)| row.dot(&at.point) + slack - bound)
    }

    fn residual(&self, at: &Iterate<N>) -> f64 {
        let size = self.bounds.iter().fold(1.0_f64, |size, bound| size.max(bound.abs()));
        let infeasible = self.primal(at).fold(0.0_f64, |most, excess| most.max(excess.abs())) / size;
        let dual = self.dual(at).amax() / (1.0 + self.linear.amax());
        let value = at.point.dot(&(self.quadratic * at.point / 2.0 + self.linear));
        // NaN must not be passed over.
        [infeasible, dual, at.gap() / (1.0 + value.abs())]
            .into_iter()
            .fold(0.0, |most, x| if x <= most { most } else { x })
    }

    /// `P + sum (z_i / s_i) a_i a_i^T`, with as much on the diagonal as rounding may have taken away.
    fn factor(&self, at: &Iterate<N>) -> Option<Cholesky<f64, nalgebra::Const<N>>> {
        let mut matrix = self.quadratic;
        for ((row, slack), multiplier) in self.rows.iter().zip(&at.slacks).zip(&at.multipliers) {
            matrix += row * row.transpose() * (multiplier / slack);
        }
        for i in 0..N {
            matrix[(i, i)] *= 1.0 + 16.0 * f64::EPSILON;
        }
        let shift = SMatrix::identity() * (16.0 * f64::EPSILON * matrix.trace());
        Cholesky::new(matrix).or_else(|| Cholesky::new(matrix + shift))
    }

    /// Newton's step for `s_i z_i = target - product_i` and both feasibilities.
    fn direction(
        &self,
        at: &Iterate<N>,
        factor: &Cholesky<f64, nalgebra::Const<N>>,
        target: f64,
        products: &[f64],
    ) -> Iterate<N> {
        let excess: Vec<f64> = self.primal(at).collect();
        let pairs = at.slacks.iter().zip(&at.multipliers);
        let centring: Vec<f64> = pairs.zip(products).map(|((s, z), product)| s * z + product - target).collect();
        let mut right = -self.dual(at);
        for (i, row) in self.rows.iter().enumerate() {
            right += row * ((centring[i] - at.multipliers[i] * excess[i]) / at.slacks[i]);
        }
        let point = factor.solve(&right);
        let slacks: Vec<f64> = self.rows.iter().zip(&excess).map(|(row, excess)| -excess - row.dot(&point)).collect();
        let multipliers =
            (0..slacks.len()).map(|i| -(centring[i] + at.multipliers[i] * slacks[i]) / at.slacks[i]).collect();
        Iterate { point, slacks, multipliers }
    }
}

impl<const N: usize> Iterate<N> {
    fn gap(&self) -> f64 {
        self.slacks.iter().zip(&self.multipliers).map(|(slack, multiplier)| slack * multiplier).sum()
    }

    /// The longest step, up to 1, that leaves no slack or multiplier negative.
    fn longest_step(&self, direction: &Self) -> f64 {
        let slacks = self.slacks.iter().zip(&direction.slacks);
        let pairs = slacks.chain(self.multipliers.iter().zip(&direction.multipliers));
        pairs.filter(|(_, step)| **step < 0.0).fold(1.0, |longest, (value, step)| longest.min(-value / step))
    }

    fn moved(&self, direction: &Self, length: f64) -> Self {
        let along = |values: &[f64], steps: &[f64]| {
            values.iter().zip(steps).map(|(value, step)| value + length * step).collect()
        };
        Self {
            point: self.point + direction.point * length,
            slacks: along(&self.slacks, &direction.slacks),
            multipliers: along(&self.multipliers, &direction.multipliers),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3, Vector4};
    use proptest::prelude::*;

    /// The point of a box nearest to a target is known in closed form, and so are the multipliers.
    #[test]
    fn the_nearest_point_of_a_box_is_the_clamped_one() {
        let target = Vector3::new(0.25, 3.0, -7.0);
        let rows: Vec<Vector3<f64>> = (0..3).flat_map(|i| [1.0, -1.0].map(|sign| Vector3::ith(i, sign))).collect();
        let program = QuadraticProgram {
            quadratic: Matrix3::identity(),
            linear: -target,
            rows: &rows,
            bounds: &[1.0, 1.0, 2.0, 2.0, 3.0, 3.0],
        };
        let optimum = program.solve(1e-12);
        assert!(optimum.residual <= 1e-12);
        // The value is within the gap of the least one: |x - x*|^2 / 2 <= residual * (1 + |value|), here at most 30.
        assert!((optimum.point - Vector3::new(0.25, 2.0, -3.0)).norm() < (2.0 * 30e-12_f64).sqrt());
        for (multiplier, exact) in optimum.multipliers.iter().zip([0.0, 0.0, 1.0, 0.0, 0.0, 4.0]) {
            assert!((multiplier - exact).abs() < 1e-5, "{:?}", optimum.multipliers);
        }
    }

    proptest! {
        /// Weak duality: for multipliers that satisfy the dual constraints no feasible point has a smaller value than the dual.
        #[test]
        fn random_linear_programs_are_solved(
            normals in prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64), 0..60),
            bounds in prop::collection::vec(0.0..1.0_f64, 60),
        ) {
            let axes = (0..3).flat_map(|i| [1.0, -1.0].map(|sign| Vector3::ith(i, sign)));
            let rows = axes.chain(normals.into_iter().map(Vector3::from));
            let rows: Vec<Vector4<f64>> = rows.map(|row| row.push(row.norm())).collect();
            let bounds: Vec<f64> = [1.0; 6].into_iter().chain(bounds).take(rows.len()).collect();
            let linear = Vector4::new(0.0, 0.0, 0.0, -1.0);
            let program = QuadraticProgram { quadratic: SMatrix::zeros(), linear, rows: &rows, bounds: &bounds };
            let optimum = program.solve(1e-10);
            prop_assert!(optimum.residual <= 1e-10, "{}", optimum.residual);
            let dual: f64 = -bounds.iter().zip(&optimum.multipliers).map(|(b, z)| b * z).sum::<f64>();
            prop_assert!(optimum.multipliers.iter().all(|z| *z > 0.0));
            // The three residuals, with |x| at most 1 and multipliers whose sum is at most 1 / the least last entry.
            prop_assert!((linear.dot(&optimum.point) - dual).abs() < 1e-8, "{} {dual}", linear.dot(&optimum.point));
            for (row, bound) in rows.iter().zip(&bounds) {
                prop_assert!(row.dot(&optimum.point) <= bound + 1e-9);
            }
        }
    }
}

//! One tet of the relaxed problem: its logarithmic barrier with derivatives.

use nalgebra::{SMatrix, SVector, SymmetricEigen};

use super::dual::{Dual, Level};
use crate::mesh::{Mat3, Vec3};

/// Number of coordinates that free vertices may use in the relaxed problem: the three of space and a few more.
pub(super) const COORDINATES: usize = 6;
/// A position of the relaxed problem.
pub(super) type Position = SVector<f64, COORDINATES>;
/// A block of its Hessian.
pub(super) type Block = SMatrix<f64, COORDINATES, COORDINATES>;

/// The barrier of one tet at a Jacobian J, ln k and the minimising tau:
/// `-ln det(G - tau I) - ln det(a tau I - G) - ln(c tau - tr G)` with the Gram matrix G = J^T J of the Jacobian,
/// `a = k^(4/3)`, c as in [`Level`]. It is finite just where the relaxed problem allows G at the level k.
#[derive(Clone, Debug)]
pub(super) struct Barrier {
    /// The value.
    pub(super) value: f64,
    /// Eigenvectors of G, in the domain.
    pub(super) axes: Mat3,
    /// The columns of the Jacobian in these axes.
    images: [Position; 3],
    /// tau.
    tau: f64,
    /// The multipliers of `tau I <= G` on the axes: S.
    pub(super) lower: Vec3,
    /// The multipliers of `G <= a tau I` on the axes: R.
    pub(super) upper: Vec3,
    /// The multiplier of `tr G <= c tau`: rho.
    pub(super) trace: f64,
    level: Level,
}

/// First and second derivatives of a [`Barrier`] with tau eliminated.
pub(super) struct Derivatives {
    /// By the squared lengths of the images of the three axes.
    first: Vec3,
    /// Weights of the squares of the entries of a change of G, from `S dG S dG` and `R dG R dG`.
    entries: Mat3,
    /// Weights of products of diagonal entries of a change of G.
    diagonal: Mat3,
    /// First derivative by ln k.
    pub(super) by_level: f64,
    /// Second derivative by ln k.
    pub(super) by_level_twice: f64,
    /// Mixed derivatives by ln k and the squared lengths.
    mixed: Vec3,
}

impl Barrier {
    /// The barrier of the Jacobian with these columns; `None` outside of its domain.
    pub(super) fn new(columns: [Position; 3], level: Level) -> Option<Self> {
        let gram = Mat3::from_fn(|i, j| columns[i].dot(&columns[j]));
        if !gram.iter().all(|entry| entry.is_finite()) {
            return None;
        }
        let SymmetricEigen { eigenvectors: axes, .. } = gram.symmetric_eigen();
        let images =
            [0, 1, 2].map(|axis| (0..3).map(|column| columns[column] * axes[(column, axis)]).sum::<Position>());
        // More digits of small eigenvalues than the sum that the decomposition works with.
        let eigenvalues = Vec3::from_fn(|axis, _| images[axis].norm_squared());
        let tau = minimizing_tau(&eigenvalues, level)?;
        let lower = eigenvalues.map(|lambda| 1.0 / (lambda - tau));
        let upper = eigenvalues.map(|lambda| 1.0 / (level.ratio * tau - lambda));
        let trace = 1.0 / (level.trace * tau - eigenvalues.sum());
        let value = lower.iter().chain(&upper).map(|multiplier| multiplier.ln()).sum::<f64>() + trace.ln();
        value.is_finite().then_some(Self { value, axes, images, tau, lower, upper, trace, level })
    }

    /// `k`-free size of the tet's multipliers: `tau tr S`.
    pub(super) fn weight(&self) -> f64 {
        self.tau * self.lower.sum()
    }

    /// The multipliers in the coordinates of the domain.
    pub(super) fn dual(&self) -> Dual {
        let on_axes = |eigenvalues: &Vec3| self.axes * Mat3::from_diagonal(eigenvalues) * self.axes.transpose();
        Dual {
            lower: on_axes(&self.lower),
            volume: Mat3::zeros(),
            upper: on_axes(&self.upper),
            trace: self.trace,
            cofactor: Mat3::zeros(),
            determinant: [0.0; 2],
        }
    }

    pub(super) fn derivatives(&self) -> Derivatives {
        let Self { tau, lower, upper, trace, level, .. } = self;
        let [[ratio_1, ratio_2], [trace_1, trace_2]] = level.derivatives();
        let (a, c) = (level.ratio, level.trace);
        let (sum, squares) = (upper.sum(), upper.norm_squared());
        let trace_squared = trace * trace;
        let first = upper - lower + Vec3::repeat(*trace);
        // By tau, its own derivative being zero.
        let tau_twice = lower.norm_squared() + a * a * squares + c * c * trace_squared;
        let tau_gram = Vec3::from_fn(|i, _| -lower[i] * lower[i] - a * upper[i] * upper[i] - c * trace_squared);
        let tau_level =
            -ratio_1 * sum + tau * ratio_1 * a * squares - trace_1 * trace + tau * trace_1 * c * trace_squared;
        let level_gram = upper.map(|r| -tau * ratio_1 * r * r - tau * trace_1 * trace_squared);
        let by_level = -tau * (ratio_1 * sum + trace_1 * trace);
        let level_twice = -tau * (ratio_2 * sum + trace_2 * trace)
            + tau * tau * (ratio_1 * ratio_1 * squares + trace_1 * trace_1 * trace_squared);
        Derivatives {
            first,
            entries: lower * lower.transpose() + upper * upper.transpose(),
            diagonal: Mat3::repeat(trace_squared) - tau_gram * tau_gram.transpose() / tau_twice,
            by_level,
            by_level_twice: level_twice - tau_level * tau_level / tau_twice,
            mixed: level_gram - tau_gram * (tau_level / tau_twice),
        }
    }

    /// The gradient by the Jacobian's columns on the axes; `stiffness` times the squared length of the coordinates beyond
    /// the third is added to the barrier.
    pub(super) fn gradient(&self, derivatives: &Derivatives, stiffness: f64) -> [Position; 3] {
        [0, 1, 2].map(|axis| {
            let mut gradient = self.images[axis] * (2.0 * derivatives.first[axis]);
            for coordinate in 3..COORDINATES {
                gradient[coordinate] += 2.0 * stiffness * self.images[axis][coordinate];
            }
            gradient
        })
    }

    /// The mixed derivative by ln k and the Jacobian's columns on the axes.
    pub(super) fn mixed_gradient(&self, derivatives: &Derivatives) -> [Position; 3] {
        [0, 1, 2].map(|axis| self.images[axis] * (2.0 * derivatives.mixed[axis]))
    }

    /// The Hessian by the Jacobian's columns on the axes, blocks `[a][b]`, `b <= a`, with `negative` of the negative
    /// curvature that comes from G being quadratic; positive semidefinite if that is 0.
    pub(super) fn hessian(&self, derivatives: &Derivatives, stiffness: f64, negative: f64) -> [[Block; 3]; 3] {
        let outer = |a: usize, b: usize| self.images[a] * self.images[b].transpose();
        let outers: [[Block; 3]; 3] = [0, 1, 2].map(|a| [0, 1, 2].map(|b| outer(a, b)));
        let Derivatives { first, entries, diagonal, .. } = derivatives;
        let mut hessian = [[Block::zeros(); 3]; 3];
        for a in 0..3 {
            for b in 0..a {
                hessian[a][b] = outers[a][b] * (4.0 * diagonal[(a, b)]) + outers[b][a] * (2.0 * entries[(a, b)]);
            }
            hessian[a][a] = outers[a][a] * (4.0 * (entries[(a, a)] + diagonal[(a, a)]));
            for b in (0..3).filter(|&b| b != a) {
                hessian[a][a] += outers[b][b] * (2.0 * entries[(a, b)]);
            }
            for coordinate in 0..COORDINATES {
                let curvature = first[a] + if coordinate < 3 { 0.0 } else { stiffness };
                let curvature = if curvature < 0.0 { negative * curvature } else { curvature };
                hessian[a][a][(coordinate, coordinate)] += 2.0 * curvature;
            }
        }
        hessian
    }
}

/// The tau that minimises the barrier, which is convex in it, between the largest it must exceed and the smallest
/// eigenvalue; `None` if there is nothing between.
fn minimizing_tau(eigenvalues: &Vec3, level: Level) -> Option<f64> {
    /// Bisections and Newton steps: the latter alone need under 20.
    const STEPS: usize = 100;
    let (a, c, sum) = (level.ratio, level.trace, eigenvalues.sum());
    let (mut below, mut above) = ((eigenvalues.max() / a).max(sum / c), eigenvalues.min());
    if below.is_nan() || below >= above {
        return None;
    }
    let (floor, ceiling) = (below, above);
    let mut tau = 0.5 * (below + above);
    for _ in 0..STEPS {
        let (mut slope, mut curvature) = (0.0, 0.0);
        let mut add = |multiplier: f64, factor: f64| {
            slope += factor * multiplier;
            curvature += factor * factor * multiplier * multiplier;
        };
        for &lambda in eigenvalues.iter() {
            add(1.0 / (lambda - tau), 1.0);
            add(1.0 / (a * tau - lambda), -a);
        }
        add(1.0 / (c * tau - sum), -c);
        if slope > 0.0 {
            above = tau
        } else {
            below = tau
        }
        let newton = tau - slope / curvature;
        let next = if below < newton && newton < above { newton } else { 0.5 * (below + above) };
        if (next - tau).abs() <= 1e-15 * tau {
            break;
        }
        tau = next;
    }
    (floor < tau && tau < ceiling).then_some(tau)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(seed: usize, scale: f64) -> [Position; 3] {
        [0, 1, 2].map(|column| Position::from_fn(|row, _| scale * ((seed * 18 + column * 6 + row) as f64 * 1.7).sin()))
    }

    fn columns() -> [Position; 3] {
        let mut columns = wave(1, 0.2);
        (0..3).for_each(|i| columns[i][i] += [1.0, 1.3, 0.8][i]);
        columns
    }

    fn moved(direction: &[Position; 3], level_direction: f64, step: f64) -> f64 {
        let columns = columns();
        let columns = [0, 1, 2].map(|i| columns[i] + direction[i] * step);
        Barrier::new(columns, Level::new(6.0f64.ln() + level_direction * step)).unwrap().value
    }

    #[test]
    fn derivatives_match_differences() {
        let barrier = Barrier::new(columns(), Level::new(6.0f64.ln())).unwrap();
        let derivatives = barrier.derivatives();
        let gradient = barrier.gradient(&derivatives, 0.0);
        let mixed = barrier.mixed_gradient(&derivatives);
        let hessian = barrier.hessian(&derivatives, 0.0, 1.0);
        for seed in 2..12 {
            let (direction, level_direction) = (wave(seed, 1.0), (seed as f64).cos());
            // The same direction on the axes.
            let on_axes = [0, 1, 2]
                .map(|axis| (0..3).map(|column| direction[column] * barrier.axes[(column, axis)]).sum::<Position>());
            let along = |slopes: &[Position; 3]| (0..3).map(|axis| slopes[axis].dot(&on_axes[axis])).sum::<f64>();
            let first = along(&gradient) + derivatives.by_level * level_direction;
            let mut second =
                derivatives.by_level_twice * level_direction.powi(2) + 2.0 * level_direction * along(&mixed);
            for a in 0..3 {
                for b in 0..=a {
                    let form = on_axes[a].dot(&(hessian[a][b] * on_axes[b]));
                    second += if a == b { form } else { 2.0 * form };
                }
            }
            // Truncation h^2 times third and fourth derivatives of some hundreds; rounding 1e-15 / h and / h^2.
            let h = 1e-4;
            let [up, middle, down] = [1.0, 0.0, -1.0].map(|sign| moved(&direction, level_direction, sign * h));
            let scale = second.abs().max(10.0);
            assert!((first - (up - down) / (2.0 * h)).abs() < 1e-4 * scale, "{first} {}", (up - down) / (2.0 * h));
            let difference = (up + down - 2.0 * middle) / (h * h);
            assert!((second - difference).abs() < 1e-3 * scale, "{second} {difference}");
        }
    }

    #[test]
    fn the_barrier_is_finite_just_where_the_level_allows_the_gram_matrix() {
        // Singular values 2, 2^(1/2), 1: K = 2^(3/2), and all three conditions are equalities at that level.
        let columns =
            [0, 1, 2].map(|i| Position::from_fn(|row, _| if row == i { [2.0, 2f64.sqrt(), 1.0][i] } else { 0.0 }));
        let log = 1.5 * 2f64.ln();
        assert!(Barrier::new(columns, Level::new(log + 1e-9)).is_some());
        assert!(Barrier::new(columns, Level::new(log - 1e-9)).is_none());
    }

    #[test]
    fn the_multipliers_balance_each_other() {
        // Stationary in tau: tr S = k^(4/3) tr R + c rho.
        let level = Level::new(6.0f64.ln());
        let barrier = Barrier::new(columns(), level).unwrap();
        let paid = level.ratio * barrier.upper.sum() + level.trace * barrier.trace;
        assert!((barrier.lower.sum() / paid - 1.0).abs() < 1e-10);
    }
}

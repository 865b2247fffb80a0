//! The Lagrangian and the condensed Newton system of an interior-point method under the constraints 3 |l_i| <= t.

use super::element::Spectrum;
use super::{Barrier, LogEnergy, TetEnergy, centred_logs};

/// Near-active constraints with slacks and multipliers of their own, and a barrier on all others.
///
/// A tet's constraints are `g = ln K_O = 3 l_1 <= t` and `g = ln K_I = -3 l_3 <= t`. Where one holds with `g > 0.6 t`, its
/// singular value is simple (two equal ones make the other dilatation the square), so that g is smooth there; only such
/// constraints may be given multipliers. As a [`TetEnergy`] this is the Lagrangian without the bound's own term,
///
/// ```text
/// sum over near-active constraints of  multiplier * (g - t)
///   + rest_weight * sum over the other l_i of  -ln(t^2 - 9 l_i^2)
///   + mean_weight * sum over all l_i of  2 cosh(3 l_i)
/// ```
///
/// and `multiplier * (least - opening)` for triangles of the boundary that come near their least [opening](super::opening()).
/// Its second derivatives, though, are those of the condensed Newton system: the Lagrangian's Hessian plus
/// (multiplier / slack) times the outer products of the constraints' gradients.
#[derive(Clone, Debug)]
pub struct PrimalDual {
    /// The bound t on ln K.
    pub bound: f64,
    /// Weight of the barrier on all constraints that are not near-active.
    pub rest_weight: f64,
    /// Weight of the dilatations themselves, `K_I + K_O` and four smaller terms of each tet; 0 where only the bound is lowered.
    pub mean_weight: f64,
    /// For each tet its near-active constraints, of K_O and of K_I.
    pub near_active: Vec<[Option<NearActive>; 2]>,
    /// Triangles of the boundary that are near their least opening, by their tets, ascending.
    pub openings: Vec<NearOpening>,
}

/// A triangle of the boundary that is near its least opening.
#[derive(Clone, Copy, Debug)]
pub struct NearOpening {
    /// Its place in the list of the boundary's triangles.
    pub triangle: usize,
    /// A tet that has it as a face.
    pub tet: usize,
    /// Which of the tet's vertices its corners are.
    pub corners: [usize; 3],
    /// Its slack stands for opening - least.
    pub constraint: NearActive,
}

/// What a near-active constraint carries.
#[derive(Clone, Copy, Debug)]
pub struct NearActive {
    /// Stands for t - g, which it equals at a solution, > 0.
    pub slack: f64,
    /// The multiplier, > 0.
    pub multiplier: f64,
}

impl PrimalDual {
    /// For K_O and K_I: the axis of l whose multiple is the constraint's logarithm, and the factor.
    pub const SIDES: [(usize, f64); 2] = [(0, 3.0), (2, -3.0)];

    /// For each l_i of a tet: `near(factor, constraint)` of its near-active constraint, else `rest(l_i)`.
    fn each<T: Copy>(
        &self,
        tet: usize,
        logs: [f64; 3],
        near: impl Fn(f64, NearActive) -> T,
        rest: impl Fn(f64) -> T,
    ) -> [T; 3] {
        let mut values = logs.map(&rest);
        for ((axis, factor), constraint) in Self::SIDES.into_iter().zip(self.near_active[tet]) {
            if let Some(constraint) = constraint {
                values[axis] = near(factor, constraint);
            }
        }
        values
    }

    fn barrier(&self) -> Barrier {
        Barrier { bound: self.bound }
    }

    /// The derivatives in the l_i of the barrier on all other constraints, of weight 1.
    pub fn rest_slopes(&self, tet: usize, logs: [f64; 3]) -> [f64; 3] {
        self.each(tet, logs, |_, _| 0.0, |l| self.barrier().derivatives(l).0)
    }

    /// The derivatives in the l_i of the condensed system's column of the bound.
    pub fn mixed_slopes(&self, tet: usize, logs: [f64; 3]) -> [f64; 3] {
        self.each(
            tet,
            logs,
            |factor, c| -factor * c.multiplier / c.slack,
            |l| self.rest_weight * self.barrier().mixed_derivative(l),
        )
    }

    /// A tet's part of the first two derivatives in the bound of the barrier on all other constraints, of weight 1.
    pub fn rest_bound_derivatives(&self, tet: usize, logs: [f64; 3]) -> [f64; 2] {
        let [a, b, c] = self.each(tet, logs, |_, _| (0.0, 0.0), |l| self.barrier().bound_derivatives(l));
        [a.0 + b.0 + c.0, a.1 + b.1 + c.1]
    }
}

impl TetEnergy for PrimalDual {
    fn value(&self, tet: usize, s: [f64; 3]) -> f64 {
        let Some(logs) = centred_logs(s) else { return f64::INFINITY };
        let mut sum = 0.0;
        for (axis, log) in logs.into_iter().enumerate() {
            let side = Self::SIDES.iter().position(|&(of, _)| of == axis);
            sum += match side.and_then(|side| self.near_active[tet][side]) {
                Some(constraint) => constraint.multiplier * (3.0 * log.abs() - self.bound),
                None => self.rest_weight * LogEnergy::value(&self.barrier(), log),
            };
            sum += 2.0 * self.mean_weight * (3.0 * log).cosh();
        }
        sum
    }

    fn spectrum(&self, tet: usize, s: [f64; 3], negative: f64) -> Option<Spectrum> {
        let logs = centred_logs(s)?;
        let mut derivatives = self.each(
            tet,
            logs,
            |factor, c| (factor * c.multiplier, factor * factor * c.multiplier / c.slack),
            |l| {
                let (first, second) = self.barrier().derivatives(l);
                (self.rest_weight * first, self.rest_weight * second)
            },
        );
        if self.mean_weight > 0.0 {
            for (derivative, log) in derivatives.iter_mut().zip(logs) {
                derivative.0 += 6.0 * self.mean_weight * (3.0 * log).sinh();
                derivative.1 += 18.0 * self.mean_weight * (3.0 * log).cosh();
            }
        }
        // What has nothing but the barrier has no say in whether the system is definite.
        let far = self.mean_weight == 0.0 && self.near_active[tet].iter().all(Option::is_none);
        let finite = derivatives.iter().all(|d| d.0.is_finite() && d.1.is_finite());
        finite.then(|| Spectrum::of_logs(s, derivatives, if far { 0.0 } else { negative }))
    }

    fn openings(&self, tet: usize) -> &[NearOpening] {
        let first = self.openings.partition_point(|opening| opening.tet < tet);
        let count = self.openings[first..].partition_point(|opening| opening.tet == tet);
        &self.openings[first..first + count]
    }
}

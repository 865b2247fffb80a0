//! The merit function and the condensed Newton system of a primal-dual method for min t subject to 3 |l_i| <= t.

use super::element::Spectrum;
use super::{Barrier, LogEnergy, TetEnergy, centred_logs};

/// Near-active constraints with multipliers of their own, and a weak barrier on all others.
///
/// A tet's constraints are `g = ln K_O = 3 l_1 <= t` and `g = ln K_I = -3 l_3 <= t`. Where one holds with `g > 0.6 t`, its
/// singular value is simple (two equal ones make the other dilatation the square), so that g is smooth there; only such
/// constraints may be given multipliers. As a [`TetEnergy`] this is the merit function
///
/// ```text
/// sum over near-active constraints of  weight * phi(t - g)
///   + rest_weight * sum over the other l_i of  -ln(t^2 - 9 l_i^2)
/// ```
///
/// with phi = -ln, continued linearly below `weight / penalty`, so that a step may violate constraints at a price; its
/// derivatives, though, are those of the condensed Newton system: gradient of the Lagrangian, and its Hessian plus
/// (multiplier / slack) times the outer products of the constraints' gradients.
#[derive(Clone, Debug)]
pub struct PrimalDual {
    /// The bound t on ln K.
    pub bound: f64,
    /// Weight of the barrier on all constraints that are not near-active.
    pub rest_weight: f64,
    /// Slope of the merit function where a constraint is violated.
    pub penalty: f64,
    /// For each tet its near-active constraints, of K_O and of K_I.
    pub near_active: Vec<[Option<Multiplier>; 2]>,
}

/// What a near-active constraint carries.
#[derive(Clone, Copy, Debug)]
pub struct Multiplier {
    /// The multiplier, positive, without units; at a solution all add up to 1.
    pub value: f64,
    /// Weight of the constraint's barrier: the target of multiplier times slack.
    pub weight: f64,
}

/// A near-active constraint at a point.
#[derive(Clone, Copy, Debug)]
pub struct NearActive {
    /// The multiplier.
    pub multiplier: f64,
    /// See [`Multiplier::weight`].
    pub weight: f64,
    /// t - g, or `weight / penalty` if that is larger.
    pub slack: f64,
    /// g + slack - t, >= 0.
    pub residual: f64,
}

impl NearActive {
    /// Derivative of the right-hand side's terms with respect to g: `weight / slack` and what removes the residual.
    fn pull(&self) -> f64 {
        (self.weight + self.multiplier * self.residual) / self.slack
    }
}

impl PrimalDual {
    /// For K_O and K_I: the axis of l whose multiple is the constraint's logarithm, and the factor.
    pub const SIDES: [(usize, f64); 2] = [(0, 3.0), (2, -3.0)];

    /// A constraint of value g at this bound.
    pub fn at(&self, multiplier: Multiplier, value: f64) -> NearActive {
        let distance = self.bound - value;
        let slack = distance.max(multiplier.weight / self.penalty);
        NearActive { multiplier: multiplier.value, weight: multiplier.weight, slack, residual: slack - distance }
    }

    /// For each l_i of a tet: `near(factor, constraint)` of its near-active constraint, else `rest(l_i)`.
    fn each<T: Copy>(
        &self,
        tet: usize,
        logs: [f64; 3],
        near: impl Fn(f64, NearActive) -> T,
        rest: impl Fn(f64) -> T,
    ) -> [T; 3] {
        let mut values = logs.map(&rest);
        for ((axis, factor), multiplier) in Self::SIDES.into_iter().zip(self.near_active[tet]) {
            if let Some(multiplier) = multiplier {
                values[axis] = near(factor, self.at(multiplier, factor * logs[axis]));
            }
        }
        values
    }

    fn barrier(&self) -> Barrier {
        Barrier { bound: self.bound }
    }

    /// The derivatives in the l_i of the right-hand side of the condensed system.
    pub fn right_hand_slopes(&self, tet: usize, logs: [f64; 3]) -> [f64; 3] {
        self.each(tet, logs, |factor, c| factor * c.pull(), |l| self.rest_weight * self.barrier().derivatives(l).0)
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

    /// A tet's part of the right-hand side and of the diagonal entry that belong to the bound, and of the sum of all
    /// multipliers.
    pub fn bound_parts(&self, tet: usize, logs: [f64; 3]) -> [f64; 3] {
        let parts = self.each(
            tet,
            logs,
            |_, c| [-c.pull(), c.multiplier / c.slack, c.multiplier],
            |l| {
                let (first, second) = self.barrier().bound_derivatives(l);
                [first, second, -first].map(|part| self.rest_weight * part)
            },
        );
        [0, 1, 2].map(|i| parts[0][i] + parts[1][i] + parts[2][i])
    }
}

impl TetEnergy for PrimalDual {
    fn value(&self, tet: usize, s: [f64; 3]) -> f64 {
        let Some(logs) = centred_logs(s) else { return f64::INFINITY };
        self.each(
            tet,
            logs,
            |_, c| self.penalty * c.residual - c.weight * c.slack.ln(),
            |l| self.rest_weight * LogEnergy::value(&self.barrier(), l),
        )
        .iter()
        .sum()
    }

    fn spectrum(&self, tet: usize, s: [f64; 3], negative: f64) -> Option<Spectrum> {
        let logs = centred_logs(s)?;
        let derivatives = self.each(
            tet,
            logs,
            |factor, c| (factor * c.multiplier, factor * factor * c.multiplier / c.slack),
            |l| {
                let (first, second) = self.barrier().derivatives(l);
                (self.rest_weight * first, self.rest_weight * second)
            },
        );
        // What is far from active has no say in whether the system is definite.
        let far = self.near_active[tet].iter().all(Option::is_none);
        let finite = derivatives.iter().all(|d| d.0.is_finite() && d.1.is_finite());
        finite.then(|| Spectrum::of_logs(s, derivatives, if far { 0.0 } else { negative }))
    }
}

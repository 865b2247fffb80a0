//! The logarithmic barrier of the set {K <= exp(bound)}.

use super::LogEnergy;

/// One term of the barrier: `h(l) = -ln(t^2 - 9 l^2)`, t a bound on ln K, finite while `3 |l| < t`.
///
/// The sum over tets and the three l_i is smooth even where singular values coincide, and jointly convex in (l, t).
#[derive(Clone, Copy, Debug)]
pub struct Barrier {
    /// The bound t on ln K.
    pub bound: f64,
}

impl Barrier {
    /// The derivative of h' with respect to the bound: `-36 l t / (t^2 - 9 l^2)^2`.
    pub fn mixed_derivative(&self, log: f64) -> f64 {
        let slack = self.slack(log);
        -36.0 * log * self.bound / (slack * slack)
    }

    /// The first two derivatives of h with respect to the bound.
    pub fn bound_derivatives(&self, log: f64) -> (f64, f64) {
        let slack = self.slack(log);
        let first = -2.0 * self.bound / slack;
        (first, first * first - 2.0 / slack)
    }

    /// `t^2 - 9 l^2`, by factors, which keeps the digits near zero.
    fn slack(&self, log: f64) -> f64 {
        (self.bound - 3.0 * log) * (self.bound + 3.0 * log)
    }
}

impl LogEnergy for Barrier {
    fn value(&self, log: f64) -> f64 {
        if self.is_defined(log) { -self.slack(log).ln() } else { f64::INFINITY }
    }

    fn is_defined(&self, log: f64) -> bool {
        3.0 * log.abs() < self.bound
    }

    fn derivatives(&self, log: f64) -> (f64, f64) {
        let slack = self.slack(log);
        let first = 18.0 * log / slack;
        (first, first * first + 18.0 / slack)
    }
}

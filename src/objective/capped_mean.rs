//! The mean dilatation under a cap.

use super::{Barrier, LogEnergy};

/// `h(l) = weight * 2 cosh(3 l) - ln(t^2 - 9 l^2)`, t = `cap` a bound on ln K.
///
/// Since `K_O = exp(3 l_1)` and `K_I = exp(-3 l_3)`, the first terms of a tet add up to K_I + K_O and four smaller terms; the
/// others are a barrier that keeps K below exp(cap).
#[derive(Clone, Copy, Debug)]
pub struct CappedMean {
    /// Weight of the mean against the barrier, > 0.
    pub weight: f64,
    /// Bound on ln K.
    pub cap: f64,
}

impl LogEnergy for CappedMean {
    fn value(&self, log: f64) -> f64 {
        2.0 * self.weight * (3.0 * log).cosh() + LogEnergy::value(&Barrier { bound: self.cap }, log)
    }

    fn is_defined(&self, log: f64) -> bool {
        Barrier { bound: self.cap }.is_defined(log)
    }

    fn derivatives(&self, log: f64) -> (f64, f64) {
        let (first, second) = Barrier { bound: self.cap }.derivatives(log);
        (6.0 * self.weight * (3.0 * log).sinh() + first, 18.0 * self.weight * (3.0 * log).cosh() + second)
    }
}

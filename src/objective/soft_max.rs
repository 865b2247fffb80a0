//! The soft maximum of K, E_p.

use super::LogEnergy;

/// One term of the soft maximum: `h(l) = exp(2 p (l - c)) + exp(-2 p (l + c)) = 2 cosh(2 p l) exp(-2 p c)`.
///
/// The sum S over tets and the three l_i gives `E_p = 3 c + 3 ln(S) / (2 p)`, which lies above `ln max K` by at most
/// `3 ln(6 tets) / (2 p)` and tends to it as p grows; c, a log near the largest |l|, only keeps the exponentials in
/// range and drops out of E_p. For p = 1 the sum is rational in the invariants of J^T J.
#[derive(Clone, Copy, Debug)]
pub struct SoftMax {
    exponent: f64,
    centre: f64,
}

impl SoftMax {
    /// The exponent p > 0, and the largest |l| of the present map as the centre of the exponentials.
    pub fn new(exponent: f64, largest_log: f64) -> Self {
        Self { exponent, centre: largest_log }
    }

    /// E_p of a sum of terms: an upper estimate of ln max K.
    pub fn log_k(&self, sum: f64) -> f64 {
        3.0 * (self.centre + sum.ln() / (2.0 * self.exponent))
    }
}

impl LogEnergy for SoftMax {
    fn value(&self, log: f64) -> f64 {
        let rate = 2.0 * self.exponent;
        (rate * (log - self.centre)).exp() + (-rate * (log + self.centre)).exp()
    }

    fn derivatives(&self, log: f64) -> (f64, f64) {
        let rate = 2.0 * self.exponent;
        let (up, down) = ((rate * (log - self.centre)).exp(), (-rate * (log + self.centre)).exp());
        (rate * (up - down), rate * rate * (up + down))
    }
}

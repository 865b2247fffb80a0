//! Energies of piecewise-linear maps as sums over tets of an even function of the centred log singular values.
//!
//! With singular values s_i of a tet's Jacobian, `l_i = ln s_i - (ln s_1 + ln s_2 + ln s_3) / 3` and
//! `ln K = 3 max |l_i|`; every energy here is `sum over tets of h(l_1) + h(l_2) + h(l_3)`, so it is invariant under
//! similarities on either side of each tet, and a new energy is a new `h`.

mod assembly;
mod barrier;
mod element;
mod soft_max;

pub use assembly::Assembly;
pub use barrier::Barrier;
pub use element::{ElementDerivatives, centred_logs};
pub use soft_max::SoftMax;

/// An even, convex function of one centred log singular value, and its first two derivatives.
pub trait TetEnergy: Sync {
    /// h(l). Infinite where the energy is not defined (beyond a barrier).
    fn value(&self, log: f64) -> f64;
    /// h'(l), h''(l) at a point where h is finite.
    fn derivatives(&self, log: f64) -> (f64, f64);
}

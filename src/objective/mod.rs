//! Energies of piecewise-linear maps as sums over tets of a function of the Jacobian's singular values.
//!
//! With singular values s_i, `l_i = ln s_i - (ln s_1 + ln s_2 + ln s_3) / 3` and `ln K = 3 max |l_i|`; the energies of the
//! minimax continuation are `h(l_1) + h(l_2) + h(l_3)` with one even convex h each, invariant under similarities on either
//! side of each tet. The untangling energy is defined for flipped tets too.

mod assembly;
mod barrier;
mod capped_mean;
mod element;
mod extremes;
mod gather;
mod iterate;
mod opening;
mod primal_dual;
mod soft_max;
#[cfg(test)]
mod tests;
mod unknowns;
mod untangling;

pub use assembly::Assembly;
pub use barrier::Barrier;
pub use capped_mean::CappedMean;
pub use element::{ElementDerivatives, Spectrum, centred_logs};
pub use extremes::{TetFunction, log_dilatations, of_jacobian};
pub use iterate::Iterate;
pub use opening::{OpeningDerivatives, opening};
pub use primal_dual::{NearActive, NearOpening, PrimalDual};
pub use soft_max::SoftMax;
pub use unknowns::{Freedom, Unknowns};
pub use untangling::Untangling;

/// An isotropic energy of each tet: a function of its signed singular values.
pub trait TetEnergy: Sync {
    /// The energy of tet number `tet` at signed singular values `s[0] >= s[1] >= |s[2]|`; infinite where it is not defined.
    fn value(&self, tet: usize, s: [f64; 3]) -> f64;
    /// Its derivatives, negative curvature multiplied by `negative` in [0, 1]; `None` where it is infinite.
    fn spectrum(&self, tet: usize, s: [f64; 3], negative: f64) -> Option<Spectrum>;
    /// What is added to it for triangles of the tet on the boundary.
    fn openings(&self, _tet: usize) -> &[NearOpening] {
        &[]
    }
}

/// An even, convex function h of one centred log singular value, and its first two derivatives.
pub trait LogEnergy: Sync {
    /// h(l). Infinite where the energy is not defined (beyond a barrier).
    fn value(&self, log: f64) -> f64;
    /// Whether h is defined at l.
    fn is_defined(&self, _log: f64) -> bool {
        true
    }
    /// h'(l), h''(l) at a point where h is finite.
    fn derivatives(&self, log: f64) -> (f64, f64);
}

impl<E: LogEnergy> TetEnergy for E {
    fn value(&self, _tet: usize, s: [f64; 3]) -> f64 {
        centred_logs(s).map_or(f64::INFINITY, |logs| logs.iter().map(|&l| LogEnergy::value(self, l)).sum())
    }

    fn spectrum(&self, _tet: usize, s: [f64; 3], negative: f64) -> Option<Spectrum> {
        let logs = centred_logs(s)?;
        if !logs.iter().all(|&l| self.is_defined(l)) {
            return None;
        }
        let derivatives = logs.map(|l| self.derivatives(l));
        let finite = derivatives.iter().all(|d| d.0.is_finite() && d.1.is_finite());
        finite.then(|| Spectrum::of_logs(s, derivatives, negative))
    }
}

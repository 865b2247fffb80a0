//! What makes a Newton system positive definite: a shift of its diagonal, or less of the elements' negative curvature.

use crate::objective::{Assembly, Iterate, TetEnergy};

/// The smallest relative shift of the diagonal that is tried: the rounding of a semidefinite matrix.
const SMALLEST_SHIFT: f64 = 1e-13;
/// Share of the negative curvature below which none is tried.
const LEAST_NEGATIVE: f64 = 0.02;

/// The relative shift of the diagonal that factorised last, from which the next search starts.
pub(super) struct Shift(f64);

impl Shift {
    pub(super) fn new() -> Self {
        Self(SMALLEST_SHIFT)
    }

    /// Solves the assembled system for the step -H^-1 g; `None` if no shift makes the matrix positive definite.
    ///
    /// At high exponents most tets have no weight at all and their vertices' rows vanish: the smallest shift of the diagonal
    /// that factorises, relative to its largest entry, leaves such vertices where they are. It changes little from step to
    /// step, and a failed factorisation costs as much as a good one, so the search starts a little below the last one.
    pub(super) fn newton_direction(&mut self, assembly: &mut Assembly<'_>, gradient: &[f64]) -> Option<Vec<f64>> {
        let system = assembly.system();
        let largest = system.largest_diagonal();
        self.0 = (0.1 * self.0).max(SMALLEST_SHIFT);
        system.shift_diagonal(self.0 * largest);
        while system.factorize().is_err() {
            if self.0 >= 1.0 {
                return None;
            }
            system.shift_diagonal(99.0 * self.0 * largest);
            self.0 *= 100.0;
        }
        let mut direction: Vec<f64> = gradient.iter().map(|g| -g).collect();
        system.solve(&mut direction);
        direction.iter().all(|d| d.is_finite()).then_some(direction)
    }
}

/// The share of the elements' negative curvature that a system is tried with: what factorised last is doubled.
pub(super) struct NegativeShare(f64);

impl NegativeShare {
    pub(super) fn new() -> Self {
        Self(1.0)
    }

    pub(super) fn value(&self) -> f64 {
        self.0
    }

    /// After a system that was not positive definite; `None` if it had none.
    pub(super) fn lower(&mut self) -> Option<()> {
        self.0 = match self.0 {
            0.0 => return None,
            share if share > LEAST_NEGATIVE => 0.3 * share,
            _ => 0.0,
        };
        Some(())
    }

    /// After a step.
    pub(super) fn raise(&mut self) {
        self.0 = (2.0 * self.0).clamp(LEAST_NEGATIVE, 1.0);
    }

    /// Fills and factorises the system of an energy, with as much as leaves it positive definite; the gradient.
    pub(super) fn factorize<E: TetEnergy>(
        &mut self,
        assembly: &mut Assembly<'_>,
        energy: &E,
        iterate: &Iterate,
    ) -> Option<Vec<f64>> {
        loop {
            let gradient = assembly.linearize(energy, iterate, self.0)?;
            let system = assembly.system();
            system.shift_diagonal(rounding(system.largest_diagonal()));
            if system.factorize().is_ok() {
                return Some(gradient);
            }
            self.lower()?;
        }
    }
}

/// A shift for the rounding of a semidefinite matrix with this largest entry of the diagonal; far below the energies' own
/// curvature.
pub(super) fn rounding(largest_diagonal: f64) -> f64 {
    1e-14 * largest_diagonal
}

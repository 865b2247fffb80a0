//! What makes a Newton system positive definite: a shift of its diagonal, or less of the elements' negative curvature.

use crate::linalg::NewtonSystem;
use crate::mesh::Vec3;
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

/// First, least and largest shift of a vertex's rows, relative to 1 over its squared shortest edge.
const SHIFTS: (f64, f64, f64) = (1e-7, 1e-9, 1e6);
/// By what the shift is multiplied after a failure, and divided after a step.
const SHIFT_FACTORS: (f64, f64) = (6.0, 4.0);

/// How systems with negative curvature of the tets are made positive definite.
pub(super) enum Damping {
    /// With all vertices fixed or free.
    Negative(NegativeShare),
    /// Where vertices slide: with all of the negative curvature, and each vertex's rows shifted by a number over its squared
    /// shortest edge. Less of the curvature stalls there: cube-1k at 5.30 instead of 5.21.
    Edges {
        /// The number, without units but those of the energy.
        shift: f64,
        /// The squared length of each unknown's shortest edge in the image.
        squares: Vec<f64>,
    },
}

impl Damping {
    pub(super) fn new(assembly: &Assembly<'_>) -> Self {
        match assembly.unknowns().slides() {
            false => Self::Negative(NegativeShare::new()),
            true => Self::Edges { shift: SHIFTS.0, squares: Vec::new() },
        }
    }

    /// Takes the edges of an image.
    pub(super) fn measure(&mut self, assembly: &Assembly<'_>, image: &[Vec3]) {
        if let Self::Edges { squares, .. } = self {
            *squares = square_edges(assembly, image);
        }
    }

    /// The share of the elements' negative curvature to fill a system with.
    pub(super) fn negative(&self) -> f64 {
        match self {
            Self::Negative(share) => share.value(),
            Self::Edges { .. } => 1.0,
        }
    }

    /// Shifts a system that was filled so.
    pub(super) fn shift(&self, system: &mut NewtonSystem) {
        if let Self::Edges { shift, squares } = self {
            add_shifts(system, *shift, squares);
        }
    }

    /// After a system that was not positive definite: whether it must be filled anew, or has been shifted further; `None` if nothing is
    /// left to try.
    pub(super) fn more(&mut self, system: &mut NewtonSystem) -> Option<bool> {
        match self {
            Self::Negative(share) => share.lower().map(|()| true),
            Self::Edges { shift, squares } => {
                add_shifts(system, *shift * (SHIFT_FACTORS.0 - 1.0), squares);
                *shift *= SHIFT_FACTORS.0;
                (*shift < SHIFTS.2).then_some(false)
            }
        }
    }

    /// The gradient of an energy and the step -H^-1 g, damped until the matrix is positive definite; `None` if it never is.
    pub(super) fn newton_direction<E: TetEnergy>(
        &mut self,
        assembly: &mut Assembly<'_>,
        energy: &E,
        iterate: &Iterate,
    ) -> Option<(Vec<f64>, Vec<f64>)> {
        self.measure(assembly, iterate.image());
        loop {
            let gradient = assembly.linearize(energy, iterate, self.negative())?;
            let system = assembly.system();
            system.shift_diagonal(rounding(system.largest_diagonal()));
            self.shift(system);
            loop {
                if system.factorize().is_ok() {
                    let mut direction: Vec<f64> = gradient.iter().map(|g| -g).collect();
                    system.solve(&mut direction);
                    self.less();
                    return Some((gradient, direction));
                }
                if self.more(system)? {
                    break;
                }
            }
        }
    }

    /// After a step.
    pub(super) fn less(&mut self) {
        match self {
            Self::Negative(share) => share.raise(),
            Self::Edges { shift, .. } => *shift = (*shift / SHIFT_FACTORS.1).max(SHIFTS.1),
        }
    }
}

/// Adds to each vertex's rows a multiple of the identity: a number over its squared shortest edge.
fn add_shifts(system: &mut NewtonSystem, shift: f64, squares: &[f64]) {
    let shifts: Vec<f64> = squares.iter().map(|square| shift / square).collect();
    system.shift_blocks(&shifts);
}

/// For each unknown the squared length of its vertex's shortest edge in the image.
fn square_edges(assembly: &Assembly<'_>, image: &[Vec3]) -> Vec<f64> {
    let mut least = vec![f64::INFINITY; image.len()];
    for tet in assembly.domain().mesh().tets() {
        for (a, b) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)].map(|(a, b)| (tet[a].index(), tet[b].index())) {
            let square = (image[a] - image[b]).norm_squared();
            least[a] = least[a].min(square);
            least[b] = least[b].min(square);
        }
    }
    assembly.free().iter().map(|&v| least[v as usize]).collect()
}

/// A shift for the rounding of a semidefinite matrix with this largest entry of the diagonal; far below the energies' own
/// curvature.
pub(super) fn rounding(largest_diagonal: f64) -> f64 {
    1e-14 * largest_diagonal
}

//! Steps along a direction: backtracking until an energy accepts.

use crate::mesh::Vec3;
use crate::objective::{Assembly, Iterate, TetEnergy};

/// Sufficient decrease of Armijo's rule.
pub(super) const ARMIJO: f64 = 1e-4;
/// Halvings of a step before the line search gives up: below 1e-9 of the Newton step rounding decides.
pub(super) const HALVINGS: usize = 30;

/// Halves the step from `longest` until the energy at the trial passes `accept(energy, step)`; a flipped tet never does.
pub(super) fn line_search<E: TetEnergy>(
    assembly: &Assembly<'_>,
    energy: &E,
    iterate: &Iterate,
    direction: &[f64],
    longest: f64,
    accept: impl Fn(f64, f64) -> bool,
) -> Option<(f64, f64, Iterate)> {
    let mut step = longest;
    let mut trials = Trials::default();
    for _ in 0..HALVINGS {
        if let Some((value, trial)) =
            trials.evaluate(assembly, energy, assembly.moved(iterate.image(), direction, step))
            && accept(value, step)
        {
            return Some((step, value, trial));
        }
        step *= 0.5;
    }
    None
}

/// The trials of a line search, most of which fail because of the same few tets.
#[derive(Default)]
pub(super) struct Trials {
    /// Tets whose energy was infinite at the last trial that was decomposed; those are looked at first.
    infinite: Vec<usize>,
}

impl Trials {
    /// The energy at some positions and the iterate there; `None` if it is infinite.
    pub(super) fn evaluate<E: TetEnergy>(
        &mut self,
        assembly: &Assembly<'_>,
        energy: &E,
        image: Vec<Vec3>,
    ) -> Option<(f64, Iterate)> {
        if assembly.turned_triangle(&image).is_some() || !assembly.is_finite_on(energy, &self.infinite, &image) {
            return None;
        }
        let trial = assembly.at(image);
        let value = assembly.value(energy, &trial);
        if value.is_none() {
            self.infinite = assembly.infinite(energy, &trial);
        }
        Some((value?, trial))
    }
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

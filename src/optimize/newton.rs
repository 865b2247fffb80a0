//! Projected Newton on the soft maximum at one exponent.

use super::{Progress, Recorder};
use crate::mesh::Vec3;
use crate::objective::{Assembly, Iterate, SoftMax, TetEnergy};

/// Sufficient decrease of the Armijo rule.
const ARMIJO: f64 = 1e-4;
/// Longest multiple of the Newton step tried: ln of a sum has a negative rank-one term that makes the projected Newton
/// step too short by the factor that Sherman-Morrison gives, which is unbounded.
const LONGEST_STEP: f64 = 10.0;
/// Halvings of a step before the line search gives up: below 1e-9 of the Newton step rounding decides.
const HALVINGS: usize = 30;

/// How one phase at a fixed exponent ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PhaseEnd {
    Converged,
    NoProgress,
    Interrupted,
}

/// Minimises E_p from `iterate` until a step lowers it by less than `tolerance` (in ln K).
pub(super) fn soft_max_phase(
    assembly: &mut Assembly<'_>,
    iterate: &mut Iterate,
    exponent: f64,
    tolerance: f64,
    recorder: &mut Recorder<'_>,
) -> PhaseEnd {
    let phase = format!("p={exponent}");
    let mut shift = Shift::new();
    loop {
        let Some(largest) = iterate.largest_log() else { return PhaseEnd::NoProgress };
        let energy = SoftMax::new(exponent, largest);
        let (Some(sum), Some(gradient)) = (assembly.value(&energy, iterate), assembly.linearize(&energy, iterate, 0.0))
        else {
            return PhaseEnd::NoProgress;
        };
        let Some(direction) = shift.newton_direction(assembly, &gradient) else { return PhaseEnd::NoProgress };
        let decrement = -dot(&gradient, &direction) / sum;
        if decrement <= 0.0 {
            return PhaseEnd::Converged;
        }
        let longest = if decrement < 1.0 - 1.0 / LONGEST_STEP { 1.0 / (1.0 - decrement) } else { LONGEST_STEP };
        let value = sum.ln();
        let accepted = line_search(assembly, &energy, iterate, &direction, longest, |trial, step| {
            trial.ln() <= value - ARMIJO * step * decrement
        });
        let Some((step, trial_sum, trial)) = accepted else { return PhaseEnd::NoProgress };
        *iterate = trial;
        let fall = energy.log_k(sum) - energy.log_k(trial_sum);
        if recorder.record(&phase, energy.log_k(trial_sum), step, iterate) == Progress::Stop {
            return PhaseEnd::Interrupted;
        }
        if fall < tolerance {
            return PhaseEnd::Converged;
        }
    }
}

/// The smallest relative shift of the diagonal that is tried: the rounding of a semidefinite matrix.
const SMALLEST_SHIFT: f64 = 1e-13;

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

/// Fills and factorises the system of an energy, lowering `negative` until it is positive definite; the gradient.
pub(super) fn factorize_damped<E: TetEnergy>(
    assembly: &mut Assembly<'_>,
    energy: &E,
    iterate: &Iterate,
    negative: &mut f64,
    shift: f64,
) -> Option<Vec<f64>> {
    loop {
        let gradient = assembly.linearize(energy, iterate, *negative)?;
        let scale = assembly.gradient_scale();
        let system = assembly.system();
        // Rounding of a semidefinite matrix; far below the energies' own curvature.
        system.shift_diagonal((1e-14 * system.largest_diagonal()).max(shift * scale * scale));
        if system.factorize().is_ok() {
            return Some(gradient);
        }
        *negative = less_negative(*negative)?;
    }
}

/// The next smaller share of negative curvature to try; `None` after 0.
pub(super) fn less_negative(negative: f64) -> Option<f64> {
    match negative {
        0.0 => None,
        share if share > 0.02 => Some(0.3 * share),
        _ => Some(0.0),
    }
}

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
            trials.evaluate(assembly, energy, moved(assembly, iterate.image(), direction, step))
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
        if !assembly.is_finite_on(energy, &self.infinite, &image) {
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

/// The positions after a step of the free vertices along a direction.
pub(super) fn moved(assembly: &Assembly<'_>, image: &[Vec3], direction: &[f64], step: f64) -> Vec<Vec3> {
    let mut trial = image.to_vec();
    for (d, &vertex) in direction.chunks_exact(3).zip(assembly.free()) {
        trial[vertex as usize] += Vec3::new(d[0], d[1], d[2]) * step;
    }
    trial
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

//! What every engine reports its iterates to.

use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::{OptimizeSettings, StopReason, TraceRow};
use crate::cancel::Cancel;
use crate::dilatation::Dilatation;
use crate::mesh::{TetId, Vec3};
use crate::objective::Iterate;

/// Whether a phase goes on after an iteration was recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Progress {
    Continue,
    Stop,
}

/// How one phase ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PhaseEnd {
    Converged,
    NoProgress,
    Interrupted,
}

/// How far a minimax solution is from stationary: the Karush-Kuhn-Tucker conditions of min t subject to 3 |l_i| <= t.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct KktResidual {
    /// Largest violation of a constraint, in ln K.
    pub primal: f64,
    /// Norm of the multipliers' combined gradient relative to the sum of its parts' norms, or the distance of the
    /// multipliers' sum from 1 if that is larger.
    pub dual: f64,
    /// Sum of multiplier times slack over all constraints, in ln K.
    pub complementarity: f64,
}

impl KktResidual {
    /// The largest of the three.
    pub fn largest(&self) -> f64 {
        self.primal.max(self.dual).max(self.complementarity)
    }
}

/// The vertices and tets of a part of the mesh.
#[derive(Clone, Debug)]
pub(super) struct Part {
    pub vertices: Vec<u32>,
    pub tets: Vec<TetId>,
}

/// Takes K of each iterate's tets, keeps the best one and the trace, and watches the limits.
pub(super) struct Recorder<'a> {
    /// The last iterate, and K of each tet there.
    image: Vec<Vec3>,
    dilatations: Vec<f64>,
    /// What the positions passed to [`Recorder::record`] are; `None` for all vertices.
    pub(super) part: Option<Part>,
    start: Instant,
    max_iterations: usize,
    /// Share of the limits kept for the polish.
    reserved: f64,
    /// With the whole time limit as its deadline, and with what is not reserved of it.
    whole: Cancel,
    cancel: Cancel,
    observe: &'a mut dyn FnMut(&TraceRow),
    pub(super) rows: Vec<TraceRow>,
    pub(super) best: Vec<Vec3>,
    pub(super) best_k: f64,
    pub(super) mean_of_best: f64,
    /// See [`Outcome::multipliers`](super::Outcome::multipliers), one entry a constraint.
    pub(super) multipliers: Vec<(TetId, f64)>,
    /// See [`TraceRow::progress`]; set by the phases.
    pub(super) progress: f64,
}

impl<'a> Recorder<'a> {
    pub(super) fn new(start: &Iterate, settings: &OptimizeSettings, observe: &'a mut dyn FnMut(&TraceRow)) -> Self {
        let cancel = settings.starting_now().cancel;
        let mut recorder = Self {
            image: start.image().to_vec(),
            dilatations: Vec::new(),
            part: None,
            start: Instant::now(),
            max_iterations: settings.max_iterations,
            reserved: 0.0,
            whole: cancel.clone(),
            cancel,
            observe,
            rows: Vec::new(),
            best: start.image().to_vec(),
            best_k: f64::INFINITY,
            mean_of_best: f64::INFINITY,
            multipliers: Vec::new(),
            progress: 0.0,
        };
        recorder.record("start", f64::INFINITY, 0.0, start);
        recorder
    }

    /// Takes over positions and dilatations of what has changed.
    fn take(&mut self, iterate: &Iterate) {
        let dilatations = iterate.decompositions().iter().map(|tet| Dilatation::of_singular_values(tet.values).k());
        match &self.part {
            None => {
                self.image.copy_from_slice(iterate.image());
                self.dilatations.clear();
                self.dilatations.extend(dilatations);
            }
            Some(part) => {
                for (&v, position) in part.vertices.iter().zip(iterate.image()) {
                    self.image[v as usize] = *position;
                }
                for (t, dilatation) in part.tets.iter().zip(dilatations) {
                    self.dilatations[t.index()] = dilatation;
                }
            }
        }
    }

    /// Keeps a share of the limits for later; 0 gives it free again.
    pub(super) fn reserve(&mut self, share: f64) {
        self.reserved = share;
        let left = self.whole.time_left();
        self.cancel = left.map_or_else(|| self.whole.clone(), |left| self.whole.within(left.mul_f64(1.0 - share)));
    }

    /// Which limit stopped it.
    pub(super) fn interruption(&self) -> StopReason {
        // NLopt counts evaluations, of which there may be more than rows: the time tells.
        StopReason::of(&self.cancel).unwrap_or(StopReason::IterationLimit)
    }

    /// What ends the present phase.
    pub(super) fn cancel(&self) -> &Cancel {
        &self.cancel
    }

    pub(super) fn iterations_left(&self) -> usize {
        // Row 0 is the start.
        let limit = (self.max_iterations as f64 * (1.0 - self.reserved)).ceil() as usize;
        (limit + 1).saturating_sub(self.rows.len())
    }

    pub(super) fn record(&mut self, phase: &str, objective: f64, step: f64, iterate: &Iterate) -> Progress {
        self.take(iterate);
        let mean_k = self.dilatations.iter().sum::<f64>() / self.dilatations.len() as f64;
        let max_k = self.dilatations.iter().copied().fold(1.0, f64::max);
        if max_k < self.best_k {
            self.best_k = max_k;
            self.mean_of_best = mean_k;
            self.best.clear();
            self.best.extend_from_slice(&self.image);
        }
        let row = TraceRow {
            phase: phase.into(),
            iteration: self.rows.len(),
            objective,
            max_k,
            mean_k,
            step,
            round: 0,
            progress: self.progress,
            seconds: self.start.elapsed().as_secs_f64(),
        };
        (self.observe)(&row);
        self.rows.push(row);
        let stop = self.cancel.is_due() || self.iterations_left() == 0;
        if stop { Progress::Stop } else { Progress::Continue }
    }
}

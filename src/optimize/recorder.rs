//! What every engine reports its iterates to.

use std::time::{Duration, Instant};

use super::{Cancel, OptimizeSettings, StopReason, TraceRow};
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
    time_limit: Option<Duration>,
    /// Share of the limits kept for the polish.
    reserved: f64,
    cancel: Cancel,
    observe: &'a mut dyn FnMut(&TraceRow),
    pub(super) rows: Vec<TraceRow>,
    pub(super) best: Vec<Vec3>,
    pub(super) best_k: f64,
    pub(super) mean_of_best: f64,
    /// See [`TraceRow::progress`]; set by the phases.
    pub(super) progress: f64,
}

impl<'a> Recorder<'a> {
    pub(super) fn new(start: &Iterate, settings: &OptimizeSettings, observe: &'a mut dyn FnMut(&TraceRow)) -> Self {
        let mut recorder = Self {
            image: start.image().to_vec(),
            dilatations: Vec::new(),
            part: None,
            start: Instant::now(),
            max_iterations: settings.max_iterations,
            time_limit: settings.time_limit,
            reserved: 0.0,
            cancel: settings.cancel.clone(),
            observe,
            rows: Vec::new(),
            best: start.image().to_vec(),
            best_k: f64::INFINITY,
            mean_of_best: f64::INFINITY,
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
    }

    /// Which limit stopped it.
    pub(super) fn interruption(&self) -> StopReason {
        if self.cancel.is_raised() {
            return StopReason::Cancelled;
        }
        // NLopt counts evaluations, of which there may be more than rows: the time tells.
        let out_of_time = self.time_left().is_some_and(|left| left.is_zero());
        if out_of_time { StopReason::TimeLimit } else { StopReason::IterationLimit }
    }

    pub(super) fn time_left(&self) -> Option<Duration> {
        self.time_limit.map(|limit| limit.mul_f64(1.0 - self.reserved).saturating_sub(self.start.elapsed()))
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
            progress: self.progress,
            seconds: self.start.elapsed().as_secs_f64(),
        };
        (self.observe)(&row);
        self.rows.push(row);
        let out_of_time = self.time_left().is_some_and(|left| left.is_zero());
        let stop = out_of_time || self.cancel.is_raised() || self.iterations_left() == 0;
        if stop { Progress::Stop } else { Progress::Continue }
    }
}

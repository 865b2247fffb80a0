//! What every engine reports its iterates to.

use std::time::Instant;

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
    pub(super) max_iterations: usize,
    pub(super) cancel: Cancel,
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
            cancel: settings.starting_now().cancel,
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

    /// Which limit stopped it.
    pub(super) fn interruption(&self) -> StopReason {
        // NLopt counts evaluations, of which there may be more than rows: the time tells.
        StopReason::of(&self.cancel).unwrap_or(StopReason::IterationLimit)
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
        // Row 0 is the start.
        let stop = self.cancel.is_due() || self.rows.len() > self.max_iterations;
        if stop { Progress::Stop } else { Progress::Continue }
    }
}

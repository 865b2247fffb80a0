//! Moving the interior vertices: engines, stop reasons, the trace.

mod barrier;
mod newton;

use std::time::Instant;

use serde::Serialize;

use crate::domain::Domain;
use crate::measure::measure;
use crate::mesh::Vec3;
use crate::objective::Assembly;

/// Why an optimisation ended. A reason, never an error: bad input is refused before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum StopReason {
    /// The last stage's relative decrease fell below its tolerance.
    Converged,
    /// The iteration limit was reached.
    IterationLimit,
    /// The time limit was reached.
    TimeLimit,
    /// No step along the search direction lowered the objective.
    NoProgress,
    /// There is no free vertex.
    NothingFree,
}

/// One iteration, as the progress line, trace.csv and the plots show it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TraceRow {
    /// The phase, e.g. `"p=48"`.
    pub phase: String,
    /// Iteration over all phases, from 1; row 0 is the start.
    pub iteration: usize,
    /// The phase's objective.
    pub objective: f64,
    /// Largest K, measured.
    pub max_k: f64,
    /// Mean K, measured.
    pub mean_k: f64,
    /// Accepted step length along the search direction.
    pub step: f64,
    /// Seconds since the start.
    pub seconds: f64,
}

#[derive(PartialEq, Eq, Clone, Copy)]
enum Progress {
    Continue,
    Stop,
}

struct Recorder<'d> {
    domain: &'d Domain,
    start: Instant,
    rows: Vec<TraceRow>,
}

impl Recorder<'_> {
    fn record(&mut self, phase: &str, objective: f64, step: f64, image: &[Vec3]) -> Progress {
        let ks: Vec<f64> = (0..self.domain.mesh().tets().len() as u32)
            .map(|t| crate::dilatation::Dilatation::of(&self.domain.jacobian(crate::TetId(t), image)).k())
            .collect();
        let row = TraceRow {
            phase: phase.into(),
            iteration: self.rows.len(),
            objective,
            max_k: ks.iter().copied().fold(0.0, f64::max),
            mean_k: ks.iter().sum::<f64>() / ks.len() as f64,
            step,
            seconds: self.start.elapsed().as_secs_f64(),
        };
        eprintln!(
            "{} {} obj {:.5} max {:.5} mean {:.5} step {} {:.2}s",
            row.iteration,
            row.phase,
            row.objective.exp(),
            row.max_k,
            row.mean_k,
            step,
            row.seconds
        );
        self.rows.push(row);
        Progress::Continue
    }
}

/// temp
pub fn experiment(domain: &Domain, image: &mut Vec<Vec3>, ps: &[f64], tol: f64, barrier: bool) {
    let mut assembly = Assembly::new(domain, domain.boundary().vertex_mask()).unwrap();
    let mut recorder = Recorder { domain, start: Instant::now(), rows: vec![] };
    for &p in ps {
        let end = newton::soft_max_phase(&mut assembly, image, p, tol, &mut recorder);
        eprintln!("{end:?}");
    }
    if barrier {
        let end = barrier::barrier_phase(&mut assembly, image, &mut recorder);
        eprintln!("{end:?}");
    }
    let _ = measure;
}

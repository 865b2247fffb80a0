//! Moving the interior vertices: engines, stop reasons, the trace.

use serde::Serialize;

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

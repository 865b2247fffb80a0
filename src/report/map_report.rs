//! The record of an optimization of a given map.

use serde::Serialize;

use super::{BestBound, Limit, Splits, Times, UntanglingFigures};
use crate::bound::LowerBound;
use crate::measure::Summary;
use crate::optimize::{KktResidual, StopReason};

/// What `qcball optimize --json` prints.
#[derive(Clone, Debug, Serialize)]
pub struct MapReport {
    /// Number of vertices.
    pub vertices: usize,
    /// Number of tets.
    pub tets: usize,
    /// Number of tets all of whose vertices are fixed.
    pub locked: usize,
    /// Number of fixed vertices.
    pub fixed: usize,
    /// The splits that freed locked tets; `null` if there were none.
    pub splits: Option<Splits>,
    /// The map started from, measured.
    pub initial: Summary,
    /// How flipped tets of it were untangled; `null` if there were none.
    pub untangling: Option<UntanglingFigures>,
    /// The map arrived at, measured.
    #[serde(rename = "final")]
    pub last: Summary,
    /// Number of tets within 0.1 % of the largest K.
    pub active: usize,
    /// Lower bounds; none unless every boundary vertex is fixed.
    pub bounds: Vec<LowerBound>,
    /// The best of them and the gap to it.
    #[serde(flatten)]
    pub best: BestBound,
    /// What limits K, as far as bounds and optimizer tell.
    pub limit: Limit,
    /// Why the optimization ended.
    pub stop: StopReason,
    /// How far the minimax solution, before any polish, is from stationary; none where the minimax phase was not reached.
    pub kkt: Option<KktResidual>,
    /// Iterations over all phases.
    pub iterations: usize,
    /// What depends on the machine and its load.
    #[serde(flatten)]
    pub times: Times,
}

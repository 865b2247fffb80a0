//! What an optimization achieved: the part that the records of runs and of given maps share.

use serde::{Deserialize, Serialize};

use super::{BallFigures, BestBound, Limit, RefinedFigures, Splits, Times, UntanglingFigures};
use crate::bound::LowerBound;
use crate::measure::Summary;
use crate::optimize::{KktResidual, StopReason};

/// What an optimization started from and arrived at, and what is known of it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Achieved {
    /// The splits that freed locked tets of a given mesh; `null` if there were none.
    pub splits: Option<Splits>,
    /// The map started from, measured.
    pub initial: Summary,
    /// How flipped tets of that map were untangled; `null` if there were none.
    pub untangling: Option<UntanglingFigures>,
    /// How the mesh was refined where the largest K sits; `null` if that was not asked for.
    pub refined: Option<RefinedFigures>,
    /// The map arrived at, measured from its positions alone.
    #[serde(rename = "final")]
    pub last: Summary,
    /// Number of tets within 0.1 % of the final largest K.
    pub active: usize,
    /// Every lower bound that was computed; none unless every boundary vertex is fixed.
    pub bounds: Vec<LowerBound>,
    /// The largest bound that applies to the final map, and the gap to it.
    #[serde(flatten)]
    pub best: BestBound,
    /// What the map arrived at says of the maps of the solid onto the ball.
    #[serde(flatten)]
    pub ball: BallFigures,
    /// What limits K, as far as bounds and optimizer tell.
    pub limit: Limit,
    /// Why the optimization ended.
    pub stop: StopReason,
    /// How far the minimax solution, before any polish, is from stationary; none where the minimax phase was not reached.
    pub kkt: Option<KktResidual>,
    /// The accuracy in ln K at which the last phase was to end; `null` in records that are older than this figure.
    #[serde(default)]
    pub tolerance: Option<f64>,
    /// Iterations over all phases.
    pub iterations: usize,
    /// What depends on the machine and its load.
    #[serde(flatten)]
    pub times: Times,
}

/// The record of an optimization of a given map: what `qcball optimize --json` prints.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct MapReport {
    /// Number of vertices.
    pub vertices: usize,
    /// Number of tets.
    pub tets: usize,
    /// Number of tets all of whose vertices are fixed.
    pub locked: usize,
    /// Number of fixed vertices.
    pub fixed: usize,
    /// What the optimization achieved.
    #[serde(flatten)]
    pub achieved: Achieved,
}

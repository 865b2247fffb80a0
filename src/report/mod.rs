//! The record of a run, and the files, the summary and the page that are views of it.

mod achieved;
mod corners;
mod figures;
mod findings;
mod html;
mod limit;
mod machine;
mod results;
mod summary;
mod words;

pub use achieved::{Achieved, MapReport};
pub(crate) use corners::{CONE, CORNERS, read_corners};
pub use figures::{
    BallFigures, BestBound, CornerFigures, DistortionFigures, DomainFigures, MapFigures, RefinedFigures,
    RefinementFigures, Splits, UntanglingFigures,
};
pub(crate) use findings::{ball_lines, best_and_limit, bounds_list};
pub use html::{
    PageError, ShownMap, page_of_map, write_case_pages, write_pages, write_pages_of, write_pair, write_sweep_pages,
};
pub use limit::{Limit, LimitedBy};
pub(crate) use results::{CellRow, FILES, FLIPPED, FlippedRow, HALVED, HalvedRow, INCOMPLETE, START, trace_hash};
pub use results::{MapRecord, write_certificate, write_results, write_trace};
pub use summary::{map_summary, summary, summary_within, time_line};
pub use words::COLUMNS;
pub(crate) use words::dilatations;

use std::time::Instant;

use serde::{Deserialize, Serialize};

use crate::measure::Bottleneck;

/// Everything a reader needs to doubt a result; `report.json` holds it under these names, in this order.
///
/// An infinite number is `null` in JSON, and read as such again. For a given program, config and overrides every key but
/// those of [`Times`] is the same to the bit on any number of threads, unless a time limit ended the run.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Report {
    /// Name of the run.
    pub name: String,
    /// Version of qcball.
    pub version: String,
    /// Revision qcball was built from, `-modified` if its sources were, `unknown` outside a checkout.
    pub revision: String,
    /// The config's path as given.
    pub config: String,
    /// blake3 of the config's keys and values with the overrides, whatever their layout.
    pub config_hash: String,
    /// The overrides of the command line, in order.
    pub overrides: Vec<String>,
    /// Seed of the random solids.
    pub seed: u64,
    /// blake3 of the file the domain came from; `null` for built-in solids.
    pub input_hash: Option<String>,
    /// The domain.
    pub domain: DomainFigures,
    /// How the surface was refined, if the config left that to the program; else `null`.
    pub refinement: Option<RefinementFigures>,
    /// The map started from, before it was measured.
    #[serde(flatten)]
    pub map: MapFigures,
    /// The corners at which the map is like a power of the distance; `null` if it is piecewise linear.
    pub corners: Option<Vec<CornerFigures>>,
    /// How the final map spreads angles and volumes; of spherical starts only, and `null` if a tet is flipped.
    #[serde(default)]
    pub distortion: Option<DistortionFigures>,
    /// Whether the final map is a bijection onto its image.
    pub bijective: bool,
    /// Why it is, or is not, or is not known to be.
    pub bijective_reason: String,
    /// What the active tets sit on.
    pub bottleneck: Option<Bottleneck>,
    /// blake3 of the rows of `trace.csv` but for their seconds: it ties the two files to each other, and proves neither.
    pub trace_hash: String,
    /// What a reader should know before trusting the numbers.
    pub warnings: Vec<String>,
    /// The config's text.
    pub config_text: String,
    /// What the optimization achieved.
    #[serde(flatten)]
    pub achieved: Achieved,
}

/// The keys of a report that differ from one run to the next.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Times {
    /// Number of threads used.
    pub threads: usize,
    /// Seconds of the whole run.
    pub seconds: f64,
    /// Seconds of those that untangling took.
    pub untangling_seconds: f64,
    /// Processor seconds of the process so far, over all its threads; none where the system does not tell.
    pub cpu_seconds: Option<f64>,
    /// The most memory the process had resident so far, in MiB; none where the system does not tell.
    pub peak_memory_mib: Option<f64>,
}

impl Times {
    /// The times of work that began at `start`, and what the process has used so far.
    pub fn since(start: Instant, untangling_seconds: f64) -> Self {
        Self {
            threads: rayon::current_num_threads(),
            seconds: start.elapsed().as_secs_f64(),
            untangling_seconds,
            cpu_seconds: machine::cpu_seconds(),
            peak_memory_mib: machine::peak_memory_mib(),
        }
    }
}

impl Report {
    /// Version of this qcball.
    pub const VERSION: &'static str = env!("CARGO_PKG_VERSION");
    /// Revision this qcball was built from.
    pub const REVISION: &'static str = env!("QCBALL_REVISION");

    /// The report as it stands in `report.json`.
    pub fn to_json(&self) -> String {
        to_json(self)
    }
}

/// Pretty JSON with a line break at the end; infinite numbers become `null`.
///
/// # Panics
/// When a map's keys are not strings, which no type of this crate has.
pub fn to_json(value: &impl Serialize) -> String {
    serde_json::to_string_pretty(value).expect("string keys only") + "\n"
}

#[cfg(test)]
mod tests;

//! What is read from a process's report and trace.

use serde::Deserialize;

use crate::measure::Summary;
use crate::report::Achieved;

/// What one optimization gave.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figures {
    /// Number of tets.
    pub tets: usize,
    /// The map started from.
    pub first: MapFigures,
    /// The map arrived at.
    pub last: MapFigures,
    /// Iterations over all phases.
    pub iterations: usize,
    /// Seconds, without those of reading and writing files where the start was given.
    pub seconds: f64,
    /// Processor seconds of the whole process.
    pub cpu_seconds: Option<f64>,
    /// The most memory the process had resident, in MiB.
    pub peak_memory_mib: Option<f64>,
    /// The largest KKT residual; none where the minimax phase was not reached.
    pub kkt: Option<f64>,
    /// The best bound for maps of the mesh with its boundary, without a Gram certificate.
    pub best_bound: Option<f64>,
    /// Largest K / best bound.
    pub gap: Option<f64>,
    /// Why it ended.
    pub stop: String,
    /// How soon it had what other programs ended with.
    pub reached: Vec<Reach>,
}

/// How soon an optimization had what another program ended with.
#[derive(Clone, Debug, PartialEq)]
pub struct Reach {
    /// The program.
    pub peer: String,
    /// Our processor seconds up to its max K; none if we did not get there.
    pub ours: Option<f64>,
    /// Its processor seconds.
    pub theirs: f64,
}

/// The dilatations of one map; an infinite one is none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapFigures {
    /// Largest K.
    pub max_k: Option<f64>,
    /// Mean of K.
    pub mean_k: Option<f64>,
    /// Number of flipped tets.
    pub flipped: usize,
}

impl MapFigures {
    fn of(map: &Summary) -> Self {
        let [max_k, mean_k] = [map.max_k, map.mean_k].map(|k| Some(k).filter(|k| k.is_finite()));
        Self { max_k, mean_k, flipped: map.flipped }
    }
}

/// What is read of the JSON of `optimize` and of `run`.
#[derive(Deserialize)]
struct Printed {
    /// Of `optimize`.
    tets: Option<usize>,
    /// Of `run`.
    domain: Option<PrintedDomain>,
    #[serde(flatten)]
    achieved: Achieved,
}

#[derive(Deserialize)]
struct PrintedDomain {
    tets: usize,
}

/// The columns that are read of a trace.
#[derive(Clone, Copy, Debug, Deserialize)]
struct TraceLine {
    max_k: f64,
    seconds: f64,
}

impl Figures {
    /// The figures in a report's JSON and in its trace; `goals` are other programs with their max K and processor seconds.
    ///
    /// # Errors
    /// What is not as this version writes it.
    pub(super) fn read<'a>(
        json: &[u8],
        trace: &[u8],
        goals: impl Iterator<Item = (&'a str, f64, f64)>,
    ) -> Result<Self, String> {
        let printed: Printed =
            serde_json::from_slice(json).map_err(|error| format!("its report cannot be read: {error}"))?;
        let Achieved { initial, last, best, stop, kkt, iterations, times, .. } = printed.achieved;
        let lines: Vec<TraceLine> = csv::Reader::from_reader(trace)
            .deserialize()
            .collect::<Result<_, _>>()
            .map_err(|error| format!("its trace cannot be read: {error}"))?;
        // The trace has the time of a clock; other load on the machine delays us, but does not count as processor time.
        let share = times.cpu_seconds.filter(|_| times.seconds > 0.0).map_or(1.0, |cpu| cpu / times.seconds);
        let reached = goals.map(|(peer, max_k, theirs)| {
            let line = lines.iter().find(|line| line.max_k <= max_k);
            Reach {
                peer: peer.into(),
                ours: line.map(|line| (times.untangling_seconds + line.seconds) * share),
                theirs,
            }
        });
        Ok(Self {
            tets: printed.tets.or(printed.domain.map(|domain| domain.tets)).unwrap_or_default(),
            first: MapFigures::of(&initial),
            last: MapFigures::of(&last),
            iterations,
            seconds: times.seconds,
            cpu_seconds: times.cpu_seconds,
            peak_memory_mib: times.peak_memory_mib,
            kkt: kkt.map(|kkt| kkt.largest()),
            best_bound: best.best_bound,
            gap: best.gap,
            stop: stop.to_string(),
            reached: reached.collect(),
        })
    }
}

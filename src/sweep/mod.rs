//! Many runs from one config: the cases of its table `[sweep]`, each with a folder of its own, and an index over them.
//!
//! A case is known by the hash of what it asks for: the config with the case's settings and the file its domain comes from. What
//! has a folder under that name is done, whatever became of the process that did it, so a sweep that was killed goes on where it
//! was, and several processes can share the cases. It stays done when the program changes; the index tells the revision that did it.

mod folder;
mod index;
mod memory;
mod run;
mod slurm;
mod table;

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use crate::config::{ConfigError, DomainSource, Plan, Setting, SweepPlan};

pub use folder::{State, SweepFolder};
pub use index::{Tally, write_index};
pub(crate) use memory::memory_of;
pub use run::{Compute, Ended, Event, SweepSettings, run};
pub use slurm::{SlurmJob, write_slurm};
pub use table::{Comparison, Results, Table, TableError, TableFormat, USUAL_COLUMNS, compare};

/// Letters of an id: 48 bits, of which two in ten thousand cases agree with a chance of 2e-7.
const ID_LETTERS: usize = 12;

/// The cases of a sweep.
#[derive(Clone, Debug)]
pub struct Sweep {
    /// Its name.
    pub name: String,
    /// Number of threads of each case; `None` if the config leaves it open.
    pub threads: Option<usize>,
    /// The keys that are varied.
    pub keys: Vec<String>,
    /// The cases, in the order of the config.
    pub cases: Vec<Case>,
}

/// One run of a sweep.
#[derive(Clone, Debug)]
pub struct Case {
    /// Its place in the sweep, counted from 1.
    pub number: usize,
    /// 12 hexadecimal digits of a hash of its settings and the file of its domain.
    pub id: String,
    /// Its values of the sweep's keys.
    pub settings: Vec<Setting>,
    /// The run.
    pub plan: Plan,
}

impl Sweep {
    /// Reads a config with a table `[sweep]` and finds the ids of its cases.
    ///
    /// # Errors
    /// What is wrong with the config, with the line and key or the override to blame.
    pub fn read(path: &Path, overrides: &[String]) -> Result<Self, ConfigError> {
        let SweepPlan { name, threads, keys, cases, .. } = SweepPlan::read(path, overrides)?;
        let mut files = HashMap::new();
        let cases = cases.into_iter().enumerate().map(|(index, case)| {
            let id = id(&case.plan, &mut files);
            Case { number: index + 1, id, settings: case.settings, plan: case.plan }
        });
        Ok(Self { name, threads, keys, cases: cases.collect() })
    }
}

impl Case {
    /// The other revision of this program that did the case, if one did.
    pub fn other_revision(&self, folder: &SweepFolder) -> Option<String> {
        index::revision(&self.id, folder).filter(|revision| revision != crate::report::Report::REVISION)
    }

    /// Its settings as `--set` takes them, between blanks.
    pub fn in_words(&self) -> String {
        self.settings.iter().map(Setting::to_string).collect::<Vec<_>>().join(" ")
    }
}

/// `files` remembers the hashes of the files seen.
fn id(plan: &Plan, files: &mut HashMap<PathBuf, String>) -> String {
    let mut hasher = blake3::Hasher::new();
    let mut part = |text: &str| {
        hasher.update(text.as_bytes());
        hasher.update(b"\n");
    };
    part(plan.source.hash().as_str());
    if let DomainSource::Surface(path) | DomainSource::Mesh(path) = &plan.domain {
        part(files.entry(path.clone()).or_insert_with(|| content_hash(path)));
    }
    hasher.finalize().to_hex()[..ID_LETTERS].to_string()
}

/// A hash of a file and, since TetGen's meshes are pairs, of its companion. A file that cannot be read counts as empty: its
/// run will say why.
fn content_hash(path: &Path) -> String {
    let mut hasher = blake3::Hasher::new();
    let companion = match path.extension().and_then(|ending| ending.to_str()) {
        Some("node") => Some(path.with_extension("ele")),
        Some("ele") => Some(path.with_extension("node")),
        _ => None,
    };
    for path in [Some(path), companion.as_deref()].into_iter().flatten() {
        hasher.update(&std::fs::read(path).unwrap_or_default());
    }
    hasher.finalize().to_hex().to_string()
}

/// One of several equal shares of a sweep's cases, written I/N with 1 <= I <= N: the cases I, I + N, I + 2 N, ...
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    number: usize,
    of: usize,
}

impl Shard {
    /// Whether a case is in this share.
    pub fn holds(self, case: &Case) -> bool {
        (case.number - 1) % self.of == self.number - 1
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let read = || {
            let (number, of) = text.split_once('/')?;
            let (number, of) = (number.parse().ok()?, of.parse().ok()?);
            (1..=of).contains(&number).then_some(Self { number, of })
        };
        read().ok_or_else(|| "write I/N with 1 <= I <= N, for example 2/8".into())
    }
}

#[cfg(test)]
mod tests;

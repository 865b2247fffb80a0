//! A folder of meshes, each optimized by a process of its own, and the table of the results.
//!
//! A process a mesh, because the system tells the peak memory of a whole process only; and a mesh after the other, so that
//! their times can be compared.

mod child;
mod figures;
mod peers;
mod table;

use std::io;
use std::path::{Path, PathBuf};

use crate::cancel::Cancel;
use crate::config::BenchPlan;
use crate::mesh::io::{TetFormat, WriteError, check_file_can_be_put, shown_path, write_atomically};

use child::optimize_in_child;
pub use figures::{Figures, Reach};
pub use peers::{PeerRow, Peers};
use table::table;

/// What the name of a domain's file ends with, before the ending of its format.
const REST: &str = "-rest";
/// What the name of a start's file ends with.
const INIT: &str = "-init";

/// Why a bench cannot start.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// The folder of the meshes cannot be read.
    #[error("cannot read the folder of meshes {}: {source}", shown_path(path))]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The folder has no mesh.
    #[error(
        "there is no mesh in {}; a bench takes the files NAME{REST}.mesh (or another format of tets), each with NAME{INIT}.mesh \
         as its start if that is there",
        shown_path(path)
    )]
    NoMesh {
        /// The folder.
        path: PathBuf,
    },
    /// Every mesh is left out.
    #[error("no mesh of {} has {} in its name; there are {}", shown_path(path), wanted.join(" or "), found.join(", "))]
    NoneWanted {
        /// The folder.
        path: PathBuf,
        /// The parts of names asked for.
        wanted: Vec<String>,
        /// The names of the meshes.
        found: Vec<String>,
    },
    /// Two files claim one name.
    #[error("{} and {} are both the mesh {name}; remove one of them", shown_path(first), shown_path(second))]
    Twice {
        /// The name of the mesh.
        name: String,
        /// A file.
        first: PathBuf,
        /// The other.
        second: PathBuf,
    },
    /// The figures of other programs cannot be read.
    #[error("{}{}: {message}", shown_path(path), line.map(|line| format!(":{line}")).unwrap_or_default())]
    Peers {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1, where one is to blame.
        line: Option<u64>,
        /// What is wrong.
        message: String,
    },
    /// The program cannot be started for a mesh.
    #[error("cannot start {} for a mesh: {source}", shown_path(program))]
    Start {
        /// The program.
        program: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
}

/// A mesh to be optimized.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Case {
    /// The name of the files without their endings.
    pub name: String,
    /// The domain.
    pub rest: PathBuf,
    /// The start; `None` for the radial map.
    pub init: Option<PathBuf>,
}

/// The meshes of a folder, by name; with `only`, those that have any of its parts in their names.
///
/// # Errors
/// A folder that cannot be read or has none of them, or a name that two files claim.
pub fn cases(folder: &Path, only: &[String]) -> Result<Vec<Case>, BenchError> {
    let unreadable = |source| BenchError::Folder { path: folder.into(), source };
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        // TetGen's meshes are pairs of files, of which the one with the tets is enough.
        let is_second_of_pair = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("node"));
        if path.is_file() && TetFormat::of(&path).is_some() && !is_second_of_pair {
            files.push(path);
        }
    }
    files.sort();
    let stem = |path: &Path| path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let mut cases: Vec<Case> = Vec::new();
    for rest in &files {
        let stem_of_rest = stem(rest);
        let Some(name) = stem_of_rest.strip_suffix(REST).filter(|name| !name.is_empty()) else { continue };
        if let Some(other) = cases.iter().find(|case| case.name == name) {
            let (first, second) = (other.rest.clone(), rest.clone());
            return Err(BenchError::Twice { name: name.into(), first, second });
        }
        let init = files.iter().find(|file| stem(file) == format!("{name}{INIT}")).cloned();
        cases.push(Case { name: name.into(), rest: rest.clone(), init });
    }
    if cases.is_empty() {
        return Err(BenchError::NoMesh { path: folder.into() });
    }
    let found: Vec<String> = cases.iter().map(|case| case.name.clone()).collect();
    if !only.is_empty() {
        cases.retain(|case| only.iter().any(|part| case.name.contains(part)));
    }
    if cases.is_empty() {
        return Err(BenchError::NoneWanted { path: folder.into(), wanted: only.to_vec(), found });
    }
    // By name, which is not the order of the files where one name begins another.
    cases.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(cases)
}

/// The head of the table: what a reader must know to doubt the times.
#[derive(Clone, Debug)]
pub struct Conditions {
    /// The command line.
    pub command: String,
    /// Number of threads of each optimization.
    pub threads: usize,
    /// Number of processor cores this process may use.
    pub cores: Option<usize>,
    /// The system's load averages at the start, over 1, 5 and 15 minutes.
    pub load: Option<String>,
}

impl Conditions {
    /// Those of now.
    pub fn now(command: String, threads: usize) -> Self {
        let load = std::fs::read_to_string("/proc/loadavg").ok();
        let load = load.map(|text| text.split_whitespace().take(3).collect::<Vec<_>>().join(", "));
        Self { command, threads, cores: std::thread::available_parallelism().map(usize::from).ok(), load }
    }
}

/// One line of the table.
#[derive(Clone, Debug)]
pub struct Row {
    /// The mesh.
    pub name: String,
    /// Whether the start is the radial map for want of a given one.
    pub radial: bool,
    /// The figures, or why there are none.
    pub figures: Result<Figures, String>,
}

/// What optimizes the meshes.
#[derive(Clone, Debug)]
pub struct Processes {
    /// The command `qcball`.
    pub program: PathBuf,
    /// Ends the process of the mesh under way, and the bench.
    pub cancel: Cancel,
}

/// Optimizes the meshes one after the other, each in a process of its own; after each, the table at `out` is written anew and
/// `observe` sees its row. If it is cancelled, the rows are those of the meshes before.
///
/// # Errors
/// A table that cannot be written or a process that cannot be started. What is wrong with one mesh is data in its row.
pub fn run<E: From<BenchError> + From<WriteError>>(
    processes: &Processes,
    plan: &BenchPlan,
    conditions: &Conditions,
    cases: &[Case],
    peers: Option<&Peers>,
    out: &Path,
    mut observe: impl FnMut(&Row) -> Result<(), E>,
) -> Result<Vec<Row>, E> {
    check_file_can_be_put(out)?;
    let mut rows = Vec::new();
    for case in cases {
        let figures = optimize_in_child(processes, case, plan, conditions.threads, peers)?;
        if processes.cancel.is_raised() {
            break;
        }
        rows.push(Row { name: case.name.clone(), radial: case.init.is_none(), figures });
        let text = table(plan, conditions, &rows, cases.len(), peers);
        write_atomically(out, |file| file.write_all(text.as_bytes()))?;
        observe(&rows[rows.len() - 1])?;
    }
    Ok(rows)
}

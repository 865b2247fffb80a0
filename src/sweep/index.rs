//! The tables over a sweep's cases, made from their folders alone.

use std::fs;
use std::io;
use std::path::Path;

use serde::Serialize;
use serde_json::{Map, Value, json};

use super::folder::{State, SweepFolder};
use super::{Case, Sweep};
use crate::mesh::io::{WriteError, write_atomically};
use crate::report::Report;

/// A column of the tables: its name, and what of a report stands in it.
type Column = (&'static str, fn(&Report) -> Value);

/// The results in the index. None depends on the time or the threads.
const RESULTS: [Column; 25] = [
    ("vertices", |report| json!(report.domain.vertices)),
    ("tets", |report| json!(report.domain.tets)),
    ("locked", |report| json!(report.domain.locked)),
    ("radial_exponent", |report| json!(report.map.radial_exponent)),
    ("radial_smooth_k", |report| json!(report.map.radial_smooth_k)),
    ("initial_max_k", |report| json!(report.achieved.initial.max_k)),
    ("initial_mean_k", |report| json!(report.achieved.initial.mean_k)),
    ("initial_flipped", |report| json!(report.achieved.initial.flipped)),
    ("max_k", |report| json!(report.achieved.last.max_k)),
    ("mean_k", |report| json!(report.achieved.last.mean_k)),
    ("p50_k", |report| json!(report.achieved.last.p50_k)),
    ("p99_k", |report| json!(report.achieved.last.p99_k)),
    ("max_k_inner", |report| json!(report.achieved.last.max_k_inner)),
    ("max_k_outer", |report| json!(report.achieved.last.max_k_outer)),
    ("flipped", |report| json!(report.achieved.last.flipped)),
    ("active", |report| json!(report.achieved.active)),
    ("best_bound", |report| json!(report.achieved.best.best_bound)),
    ("gap", |report| json!(report.achieved.best.gap)),
    ("ball_k", |report| json!(report.achieved.last.ball_k.map(|k| k.certified))),
    ("ball_fraction", |report| json!(report.achieved.ball.ball_fraction)),
    ("ball_bound", |report| json!(report.achieved.ball.ball_bound)),
    ("bijective", |report| json!(report.bijective)),
    ("iterations", |report| json!(report.achieved.iterations)),
    ("stop", |report| json!(report.achieved.stop)),
    ("revision", |report| json!(report.revision)),
];
/// What is kept apart because it differs from one run to the next.
const TIMES: [Column; 3] = [
    ("threads", |report| json!(report.achieved.times.threads)),
    ("seconds", |report| json!(report.achieved.times.seconds)),
    ("untangling_seconds", |report| json!(report.achieved.times.untangling_seconds)),
];

/// How many cases are in which state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// All cases.
    pub cases: usize,
    /// Those that ended by themselves.
    pub done: usize,
    /// Of these, those whose map is not known to be bijective.
    pub not_bijective: usize,
    /// Those that failed.
    pub failed: usize,
    /// Of those done, those that another revision of the program did.
    pub other_revision: usize,
}

impl Tally {
    /// Counts cases by their folders.
    pub fn of<'a>(cases: impl IntoIterator<Item = &'a Case>, folder: &SweepFolder) -> Self {
        cases.into_iter().map(|case| Row::of(case, folder)).fold(Self::default(), |tally, row| tally.and(&row))
    }

    fn and(mut self, row: &Row) -> Self {
        self.cases += 1;
        match row.state {
            State::Done => self.done += 1,
            State::Failed => self.failed += 1,
            State::Incomplete | State::Missing => {}
        }
        if row.report.as_ref().is_some_and(|report| report.revision != Report::REVISION) {
            self.other_revision += 1;
        }
        if row.state == State::Done && !row.report.as_ref().is_some_and(|report| report.bijective) {
            self.not_bijective += 1;
        }
        self
    }
}

/// A case, and what its folder holds.
struct Row<'a> {
    case: &'a Case,
    state: State,
    report: Option<Report>,
    error: Option<String>,
}

/// A line of `index.jsonl`.
#[derive(Serialize)]
struct Line<'a> {
    case: usize,
    id: &'a str,
    status: &'static str,
    settings: Map<String, Value>,
    results: Option<Map<String, Value>>,
    error: Option<&'a str>,
}

impl<'a> Row<'a> {
    fn of(case: &'a Case, folder: &SweepFolder) -> Self {
        let state = folder.state(&case.id);
        let report = (state == State::Done).then(|| read(&folder.of_case(&case.id, state).join("report.json")));
        let error = (state == State::Failed).then(|| folder.error(&case.id)).flatten();
        Self { case, state, report: report.flatten(), error }
    }

    fn cells(&self, columns: &[Column]) -> Vec<String> {
        let of = |value: fn(&Report) -> Value| self.report.as_ref().map(|report| plain(&value(report)));
        columns.iter().map(|(_, value)| of(*value).unwrap_or_default()).collect()
    }

    fn line(&self) -> Line<'_> {
        Line {
            case: self.case.number,
            id: &self.case.id,
            status: self.state.name(),
            settings: self.case.settings.iter().map(|one| (one.key(), serde_json::json!(one.value))).collect(),
            results: self.report.as_ref().map(results_of),
            error: self.error.as_deref(),
        }
    }
}

/// The results of a run by the names of their columns.
pub(super) fn results_of(report: &Report) -> Map<String, Value> {
    RESULTS.iter().map(|(name, value)| (name.to_string(), value(report))).collect()
}

/// The revision of the program that did a case; `None` where it is not done.
pub(super) fn revision(id: &str, folder: &SweepFolder) -> Option<String> {
    let record = folder.of_case(id, State::Done).join("report.json");
    read(&record).map(|report| report.revision)
}

fn read(path: &Path) -> Option<Report> {
    serde_json::from_slice(&fs::read(path).ok()?).ok()
}

/// A text as a cell of a table: behind an apostrophe where a spreadsheet would take it for a formula.
pub(super) fn text_cell(text: &str) -> String {
    if text.starts_with(['=', '+', '-', '@', '\t', '\r']) { format!("'{text}") } else { text.to_string() }
}

/// A value as a cell of a table: nothing for `null`, text without quotes.
fn plain(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) => text_cell(text),
        other => other.to_string(),
    }
}

/// Writes `index.jsonl` and `index.csv`, settings and results of all cases in their order, and `timings.csv`.
///
/// For a given program and config the index is the same to the bit however the cases were shared out, interrupted and
/// resumed, once all are done.
///
/// # Errors
/// The file that could not be written.
pub fn write_index(sweep: &Sweep, folder: &SweepFolder) -> Result<Tally, WriteError> {
    let rows: Vec<Row> = sweep.cases.iter().map(|case| Row::of(case, folder)).collect();
    write_atomically(&folder.path().join("index.jsonl"), |file| {
        rows.iter()
            .try_for_each(|row| writeln!(file, "{}", serde_json::to_string(&row.line()).map_err(io::Error::other)?))
    })?;
    let first = ["case", "id", "status"].map(String::from);
    let names = |columns: &[Column]| columns.iter().map(|(name, _)| name.to_string()).collect::<Vec<_>>();
    let head = [&first[..], &sweep.keys, &names(&RESULTS), &["error".to_string()]].concat();
    let start = |row: &Row| [row.case.number.to_string(), row.case.id.clone(), row.state.name().to_string()];
    write_table(&folder.path().join("index.csv"), &head, &rows, |row| {
        let settings: Vec<String> = row.case.settings.iter().map(|one| plain(&serde_json::json!(one.value))).collect();
        [&start(row)[..], &settings, &row.cells(&RESULTS), &[row.error.as_deref().map(text_cell).unwrap_or_default()]]
            .concat()
    })?;
    let head = [&first[..], &names(&TIMES)].concat();
    write_table(&folder.path().join("timings.csv"), &head, &rows, |row| {
        [&start(row)[..], &row.cells(&TIMES)].concat()
    })?;
    Ok(rows.iter().fold(Tally::default(), Tally::and))
}

fn write_table(
    path: &Path,
    head: &[String],
    rows: &[Row],
    cells: impl Fn(&Row) -> Vec<String>,
) -> Result<(), WriteError> {
    write_atomically(path, |file| {
        let mut table = csv::Writer::from_writer(file);
        let written = std::iter::once(head.to_vec()).chain(rows.iter().map(cells));
        for record in written {
            table.write_record(record).map_err(|error| match error.into_kind() {
                csv::ErrorKind::Io(error) => error,
                other => io::Error::other(format!("{other:?}")),
            })?;
        }
        table.flush()
    })
}

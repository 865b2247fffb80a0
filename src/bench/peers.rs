//! The figures of other programs on the same meshes.

use std::collections::BTreeMap;
use std::path::Path;

use super::BenchError;

/// The columns that the file must have, in any order; others are left alone.
const COLUMNS: [&str; 5] = ["mesh", "peer", "max_k", "mean_k", "cpu_seconds"];
/// What stands where a program gave no figure.
const NOTHING: &str = "-";

/// One program's result on one mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct PeerRow {
    /// The program.
    pub peer: String,
    /// Largest K.
    pub max_k: f64,
    /// Mean of K.
    pub mean_k: f64,
    /// Processor seconds.
    pub cpu_seconds: f64,
}

/// What other programs reached, by mesh.
#[derive(Clone, Debug, Default)]
pub struct Peers(BTreeMap<String, Vec<PeerRow>>);

impl Peers {
    /// These and others.
    pub fn with(mut self, others: Self) -> Self {
        for (mesh, rows) in others.0 {
            self.0.entry(mesh).or_default().extend(rows);
        }
        self
    }

    /// Reads a CSV file with the columns mesh, peer, max_k, mean_k and cpu_seconds; a row with `-` for a figure is of a
    /// program that gave none, and is skipped.
    ///
    /// # Errors
    /// What is wrong, with its line.
    pub fn read(path: &Path) -> Result<Self, BenchError> {
        let fault = |line: Option<u64>, message: String| BenchError::Peers { path: path.into(), line, message };
        let unreadable = |error: csv::Error| {
            let line = error.position().map(csv::Position::line);
            let message = match error.into_kind() {
                csv::ErrorKind::Io(source) => format!("cannot read the peers' figures: {source}"),
                csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
                    format!("the row has {len} columns, but the first line has {expected_len}; quote texts with commas")
                }
                csv::ErrorKind::Utf8 { .. } => "the row is not UTF-8; save the file as UTF-8".into(),
                other => format!("the row cannot be read: {other:?}"),
            };
            fault(line, message)
        };
        let mut file = csv::ReaderBuilder::new().trim(csv::Trim::All).from_path(path).map_err(unreadable)?;
        let header = file.headers().map_err(unreadable)?;
        let place = |name: &&str| {
            header.iter().position(|column| column == *name).ok_or_else(|| {
                let wanted = COLUMNS.join(",");
                fault(Some(1), format!("there is no column `{name}`; the first line must name the columns {wanted}"))
            })
        };
        let places = COLUMNS.iter().map(place).collect::<Result<Vec<usize>, BenchError>>()?;
        let mut peers = Self::default();
        for record in file.records() {
            let record = record.map_err(unreadable)?;
            let line = record.position().map(csv::Position::line);
            let text = |column: usize| record.get(places[column]).expect("all rows are as long as the first");
            if let Some(nameless) = [0, 1].into_iter().find(|&column| text(column).is_empty()) {
                return Err(fault(line, format!("`{}` is empty; give a name", COLUMNS[nameless])));
            }
            if (2..COLUMNS.len()).any(|column| text(column) == NOTHING) {
                continue;
            }
            let number = |column: usize, least: f64| match text(column).parse::<f64>() {
                Ok(value) if value >= least => Ok(value),
                _ => {
                    let (name, given) = (COLUMNS[column], text(column));
                    Err(fault(line, format!("`{name}` is {given:?}; give a number of at least {least}, or {NOTHING}")))
                }
            };
            // Printed with few digits, a K of 1 may stand as a little less.
            let row = PeerRow {
                peer: text(1).into(),
                max_k: number(2, 0.99)?,
                mean_k: number(3, 0.99)?,
                cpu_seconds: number(4, 0.0)?,
            };
            peers.0.entry(text(0).into()).or_default().push(row);
        }
        Ok(peers)
    }

    /// The program with the smallest largest K on a mesh.
    pub fn best(&self, mesh: &str) -> Option<&PeerRow> {
        self.0.get(mesh)?.iter().min_by(|a, b| a.max_k.total_cmp(&b.max_k))
    }

    /// What one program reached on a mesh.
    pub fn row(&self, mesh: &str, peer: &str) -> Option<&PeerRow> {
        self.0.get(mesh)?.iter().find(|row| row.peer == peer)
    }
}

//! Tables of sweeps and runs for papers and terminals: chosen columns of one, or two side by side, case by case.

use std::collections::HashMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use super::index::{results_of, text_cell};
use crate::mesh::io::{on_one_line, shown_path};
use crate::report::Report;

/// The columns of a table for which none are asked.
pub const USUAL_COLUMNS: &str = "tets,max_k,mean_k,best_bound,gap,stop";
/// Two largest K this near, relatively, count as the same: the tolerance of the optimizer.
const SAME: f64 = 1e-6;

/// How a table is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum TableFormat {
    /// Aligned, for a terminal.
    Text,
    /// Comma-separated values, with all digits.
    Csv,
    /// Markdown.
    Md,
    /// A LaTeX tabular with the rules of booktabs.
    Latex,
}

/// Why there is no table.
#[derive(Debug, thiserror::Error)]
pub enum TableError {
    /// Neither a run's nor a sweep's folder.
    #[error("{} holds no results: a run's folder has report.json, a sweep's has index.jsonl", shown_path(path))]
    NoResults {
        /// The folder.
        path: PathBuf,
    },
    /// A file that cannot be read, or not as what it is.
    #[error("{}: {message}; make it anew by qcball sweep --index-only, or qcball run", shown_path(path))]
    Broken {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// A column that no case has.
    #[error("no case has the column {name:?}; there are {known}")]
    UnknownColumn {
        /// The column.
        name: String,
        /// Those that there are.
        known: String,
    },
    /// No case of one stands in the other.
    #[error("no case of {} has the settings of one of {}: the first varies {one}, the second {other}", shown_path(&paths[0]), shown_path(&paths[1]))]
    NothingInCommon {
        /// The two folders.
        paths: [PathBuf; 2],
        /// The keys that the first varies.
        one: String,
        /// The keys that the second varies.
        other: String,
    },
}

/// A run, or a case of a sweep.
#[derive(Clone, Debug)]
struct Row {
    number: u64,
    settings: Map<String, Value>,
    results: Map<String, Value>,
    seconds: Option<f64>,
}

/// The cases of a folder that are done.
#[derive(Clone, Debug)]
pub struct Results {
    folder: PathBuf,
    rows: Vec<Row>,
}

impl Results {
    /// Reads the index of a sweep, or the record of a run as its one case.
    ///
    /// # Errors
    /// A folder that is neither, or a file of it that cannot be read.
    pub fn read(folder: &Path) -> Result<Self, TableError> {
        let [record, index, timings] = ["report.json", "index.jsonl", "timings.csv"].map(|name| folder.join(name));
        let broken =
            |path: &Path, error: &dyn ToString| TableError::Broken { path: path.into(), message: error.to_string() };
        let text = |path: &Path| std::fs::read_to_string(path).map_err(|error| broken(path, &error));
        let rows = if record.is_file() {
            let report: Report = serde_json::from_str(&text(&record)?).map_err(|error| broken(&record, &error))?;
            let seconds = Some(report.achieved.times.seconds);
            vec![Row { number: 1, settings: Map::new(), results: results_of(&report), seconds }]
        } else if index.is_file() {
            let seconds = seconds(&timings).map_err(|error| broken(&timings, &error))?;
            let parse = |line: &str| -> Result<Option<Row>, TableError> {
                let line: Value = serde_json::from_str(line).map_err(|error| broken(&index, &error))?;
                let table = |name: &str| line[name].as_object().cloned();
                let number = line["case"].as_u64().unwrap_or_default();
                let seconds = seconds.get(&number).copied();
                Ok(table("results").map(|results| Row {
                    number,
                    settings: table("settings").unwrap_or_default(),
                    results,
                    seconds,
                }))
            };
            text(&index)?.lines().map(parse).filter_map(Result::transpose).collect::<Result<_, _>>()?
        } else {
            return Err(TableError::NoResults { path: folder.into() });
        };
        Ok(Self { folder: folder.into(), rows })
    }

    /// The keys that are varied, in the order of their names.
    fn keys(&self) -> Vec<String> {
        let mut keys: Vec<String> = self.rows.iter().flat_map(|row| row.settings.keys().cloned()).collect();
        keys.sort();
        keys.dedup();
        keys
    }

    fn keys_in_words(&self) -> String {
        let keys = self.keys();
        if keys.is_empty() { "nothing".into() } else { keys.join(", ") }
    }
}

fn seconds(path: &Path) -> Result<HashMap<u64, f64>, csv::Error> {
    if !path.is_file() {
        return Ok(HashMap::new());
    }
    let mut reader = csv::Reader::from_path(path)?;
    let head = reader.headers()?.clone();
    let place = |name: &str| head.iter().position(|column| column == name);
    let (Some(case), Some(seconds)) = (place("case"), place("seconds")) else { return Ok(HashMap::new()) };
    let rows =
        reader.into_records().map(|row| row.map(|row| Some((row[case].parse().ok()?, row[seconds].parse().ok()?))));
    rows.filter_map(Result::transpose).collect()
}

/// A table.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    head: Vec<String>,
    rows: Vec<Vec<Value>>,
}

impl Table {
    /// The settings of each case that is done, and the named columns of `index.csv`, `seconds` among them.
    ///
    /// # Errors
    /// A column that there is not.
    pub fn of(results: &Results, columns: &[String]) -> Result<Self, TableError> {
        let keys = results.keys();
        if let Some(first) = results.rows.first()
            && let Some(name) = columns.iter().find(|name| *name != "seconds" && !first.results.contains_key(*name))
        {
            let known: Vec<&str> = first.results.keys().map(String::as_str).chain(["seconds"]).collect();
            return Err(TableError::UnknownColumn { name: name.clone(), known: known.join(", ") });
        }
        let cell = |row: &Row, name: &String| match name.as_str() {
            "seconds" => row.seconds.map_or(Value::Null, Value::from),
            name => row.results.get(name).cloned().unwrap_or_default(),
        };
        let rows = results.rows.iter().map(|row| {
            let settings = keys.iter().map(|key| row.settings.get(key).cloned().unwrap_or_default());
            settings.chain(columns.iter().map(|name| cell(row, name))).collect()
        });
        Ok(Self { rows: rows.collect(), head: [keys, columns.to_vec()].concat() })
    }

    /// The table in a format; numbers other than of CSV with five digits after the point.
    pub fn write(&self, format: TableFormat) -> String {
        let digits = |value: &Value| match value {
            Value::Null => String::new(),
            Value::String(text) if format == TableFormat::Csv => text_cell(text),
            Value::String(text) => on_one_line(text),
            Value::Number(number) if number.is_f64() && format != TableFormat::Csv => {
                format!("{:.5}", number.as_f64().unwrap_or(f64::NAN))
            }
            other => other.to_string(),
        };
        let rows: Vec<Vec<String>> = self.rows.iter().map(|row| row.iter().map(digits).collect()).collect();
        match format {
            TableFormat::Csv => comma_separated(&self.head, &rows),
            TableFormat::Text => aligned(&self.head, &rows),
            TableFormat::Md => {
                let escaped = |row: &[String]| row.iter().map(|cell| cell.replace('|', "\\|")).collect::<Vec<_>>();
                let line = |row: &[String]| format!("| {} |\n", escaped(row).join(" | "));
                let rule: String =
                    (0..self.head.len()).map(|column| if self.is_numeric(column) { "--:|" } else { "---|" }).collect();
                line(&self.head) + &format!("|{rule}\n") + &rows.iter().map(|row| line(row)).collect::<String>()
            }
            TableFormat::Latex => {
                let line =
                    |row: &[String]| row.iter().map(|cell| for_latex(cell)).collect::<Vec<_>>().join(" & ") + " \\\\\n";
                let columns: String =
                    (0..self.head.len()).map(|column| if self.is_numeric(column) { 'r' } else { 'l' }).collect();
                let body: String = rows.iter().map(|row| line(row)).collect();
                format!(
                    "\\begin{{tabular}}{{{columns}}}\n\\toprule\n{}\\midrule\n{body}\\bottomrule\n\\end{{tabular}}\n",
                    line(&self.head)
                )
            }
        }
    }

    fn is_numeric(&self, column: usize) -> bool {
        self.rows.iter().all(|row| row[column].is_number() || row[column].is_null())
    }
}

fn comma_separated(head: &[String], rows: &[Vec<String>]) -> String {
    let mut table = csv::Writer::from_writer(Vec::new());
    for row in std::iter::once(head).chain(rows.iter().map(Vec::as_slice)) {
        table.write_record(row).expect("memory takes all rows of equal length");
    }
    String::from_utf8_lossy(&table.into_inner().expect("memory takes all that is written")).into_owned()
}

fn aligned(head: &[String], rows: &[Vec<String>]) -> String {
    let width = |column: usize| {
        let cells = std::iter::once(head).chain(rows.iter().map(Vec::as_slice)).map(|row| row[column].chars().count());
        cells.max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..head.len()).map(width).collect();
    let mut text = String::new();
    for row in std::iter::once(head).chain(rows.iter().map(Vec::as_slice)) {
        let cells: Vec<String> = row.iter().zip(&widths).map(|(cell, &width)| format!("{cell:>width$}")).collect();
        let _ = writeln!(text, "{}", cells.join("  ").trim_end());
    }
    text
}

fn for_latex(text: &str) -> String {
    let special = |c: char| match c {
        '&' | '%' | '$' | '#' | '_' | '{' | '}' => format!("\\{c}"),
        '\\' => "\\textbackslash{}".into(),
        '^' => "\\textasciicircum{}".into(),
        '~' => "\\textasciitilde{}".into(),
        '<' => "\\textless{}".into(),
        '>' => "\\textgreater{}".into(),
        other => other.to_string(),
    };
    text.chars().map(special).collect()
}

/// Two sweeps, or two runs, side by side.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// A row for each case that stands in both: its settings, K of the first and of the second and their ratio, likewise the mean, the
    /// seconds, and how each stopped.
    pub table: Table,
    /// What changed, in a sentence.
    pub sentence: String,
}

/// Sets the cases of two folders beside each other that have the same settings; two runs are compared whatever they are of.
///
/// # Errors
/// If none of the one stands in the other.
pub fn compare(one: &Results, other: &Results) -> Result<Comparison, TableError> {
    let known: HashMap<String, &Row> = other.rows.iter().map(|row| (key(row), row)).collect();
    let pairs: Vec<(&Row, &Row)> = one.rows.iter().filter_map(|row| Some((row, *known.get(&key(row))?))).collect();
    if pairs.is_empty() {
        let paths = [one, other].map(|results| results.folder.clone());
        return Err(TableError::NothingInCommon { paths, one: one.keys_in_words(), other: other.keys_in_words() });
    }
    let keys = one.keys();
    let mut head = vec!["case".to_string()];
    head.extend(keys.iter().cloned());
    for name in ["max_k", "mean_k", "seconds"] {
        head.extend([format!("{name} A"), format!("{name} B"), "B / A".into()]);
    }
    head.extend(["stop A", "stop B"].map(String::from));
    let (mut lower, mut same, mut higher, mut logs) = (0, 0, 0, Vec::new());
    let mut rows = Vec::new();
    for (a, b) in &pairs {
        let mut row = vec![Value::from(a.number)];
        row.extend(keys.iter().map(|key| a.settings.get(key).cloned().unwrap_or_default()));
        for name in ["max_k", "mean_k", "seconds"] {
            let of =
                |row: &Row| if name == "seconds" { row.seconds } else { row.results.get(name).and_then(Value::as_f64) };
            let ratio = of(a).zip(of(b)).map(|(a, b)| b / a);
            row.extend([of(a), of(b), ratio].map(|value| value.map_or(Value::Null, Value::from)));
            if name == "max_k"
                && let Some(ratio) = ratio
            {
                logs.push(ratio.ln());
                match ratio - 1.0 {
                    change if change < -SAME => lower += 1,
                    change if change > SAME => higher += 1,
                    _ => same += 1,
                }
            }
        }
        row.extend([a, b].map(|row| row.results.get("stop").cloned().unwrap_or_default()));
        rows.push(row);
    }
    let mean = (logs.iter().sum::<f64>() / logs.len().max(1) as f64).exp();
    let only = |all: &Results| all.rows.len() - pairs.len();
    let sentence = format!(
        "{} case{} in both, {} only in A, {} only in B; from A to B the largest K is lower in {lower}, the same to {SAME:e} in {same} and \
         higher in {higher}; geometric mean of B / A {mean:.6}",
        pairs.len(),
        if pairs.len() == 1 { "" } else { "s" },
        only(one),
        only(other)
    );
    Ok(Comparison { table: Table { head, rows }, sentence })
}

/// What tells a case from the others of its sweep.
fn key(row: &Row) -> String {
    // The order of the keys is that of their names.
    let sorted: std::collections::BTreeMap<_, _> = row.settings.iter().collect();
    serde_json::json!(sorted).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn results(cases: &[(f64, f64)]) -> Results {
        let row = |(number, &(setting, k)): (usize, &(f64, f64))| Row {
            number: number as u64 + 1,
            settings: Map::from_iter([("map.exponent".to_string(), json!(setting))]),
            results: Map::from_iter([("max_k".to_string(), json!(k)), ("stop".to_string(), json!("optimal"))]),
            seconds: Some(2.0),
        };
        Results { folder: "some".into(), rows: cases.iter().enumerate().map(row).collect() }
    }

    #[test]
    fn cases_are_matched_by_their_settings_and_changes_counted() {
        let one = results(&[(0.5, 4.0), (1.0, 4.0), (2.0, 5.0)]);
        let other = results(&[(2.0, 2.5), (1.0, 4.0), (3.0, 1.0)]);
        let compared = compare(&one, &other).unwrap();
        let ratios: Vec<&Value> = compared.table.rows.iter().map(|row| &row[4]).collect();
        assert_eq!(ratios, [&json!(1.0), &json!(0.5)]);
        assert!(compared.sentence.starts_with("2 cases in both, 1 only in A, 1 only in B;"), "{}", compared.sentence);
        assert!(
            compared.sentence.contains("lower in 1, the same to 1e-6 in 1 and higher in 0"),
            "{}",
            compared.sentence
        );
        // sqrt(1 * 1 / 2).
        assert!(compared.sentence.ends_with("0.707107"), "{}", compared.sentence);
        assert!(matches!(compare(&one, &results(&[(9.0, 1.0)])), Err(TableError::NothingInCommon { .. })));
    }

    #[test]
    fn a_table_has_each_format_s_own_signs() {
        let table = Table::of(&results(&[(0.5, 4.0)]), &["max_k".into(), "stop".into()]).unwrap();
        assert_eq!(table.write(TableFormat::Csv), "map.exponent,max_k,stop\n0.5,4.0,optimal\n");
        assert_eq!(
            table.write(TableFormat::Md),
            "| map.exponent | max_k | stop |\n|--:|--:|---|\n| 0.50000 | 4.00000 | optimal |\n"
        );
        let latex = table.write(TableFormat::Latex);
        assert!(
            latex.starts_with("\\begin{tabular}{rrl}\n\\toprule\nmap.exponent & max\\_k & stop \\\\\n\\midrule\n"),
            "{latex}"
        );
        assert_eq!(table.write(TableFormat::Text).lines().count(), 2);
        assert!(matches!(Table::of(&results(&[(0.5, 4.0)]), &["k".into()]), Err(TableError::UnknownColumn { .. })));
    }
}

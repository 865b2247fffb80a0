//! What the table `[sweep]` means: its keys, their values, and a plan for each case.

use std::cmp::Ordering;
use std::collections::HashMap;
use std::path::Path;

use glob::Pattern;
use serde::Deserialize;
use toml::Value;

use super::error::{ConfigError, Fault, reworded};
use super::{Axis, ConfigSource, Number, Plan, RangeTable, Seeds, Setting, SweepTable};
use crate::mesh::io::shown_path;

/// No sweep has more cases: a run takes seconds at least, and more are asked for by mistake.
pub const MOST_CASES: usize = 10_000;

const EXAMPLE: &str = "[sweep.grid]\n\"map.exponent\" = [0.5, 1, 2]\n\"mesh.layers\" = { from = 2, to = 8, step = 2 }";
/// What no result depends on, or what the sweep decides itself.
const NOT_VARIED: [&str; 3] = ["name", "threads", "sweep"];

/// The cases of a sweep, in the order of the config.
#[derive(Clone, Debug)]
pub struct SweepPlan {
    /// The config it was made from.
    pub source: ConfigSource,
    /// Name of the sweep.
    pub name: String,
    /// Number of threads of each case; `None` if the config leaves it open.
    pub threads: Option<usize>,
    /// The keys that are varied.
    pub keys: Vec<String>,
    /// The cases, at least one.
    pub cases: Vec<CasePlan>,
}

/// One run of a sweep.
#[derive(Clone, Debug)]
pub struct CasePlan {
    /// Its values of the sweep's keys, in their order.
    pub settings: Vec<Setting>,
    /// The run.
    pub plan: Plan,
}

impl SweepPlan {
    /// Reads a config with a table `[sweep]`, applies the overrides `key.path=value` to all cases and checks each case.
    ///
    /// # Errors
    /// The first fault, with the file, line and key or the override to blame, and what to do. Nothing is made for cases
    /// beyond [`MOST_CASES`].
    pub fn read(path: &Path, overrides: &[String]) -> Result<Self, ConfigError> {
        let (source, config) = ConfigSource::read(path, overrides)?;
        let at = |fault| source.error(fault);
        let Some(table) = &config.sweep else {
            let message = "there is no table [sweep]".to_string();
            return Err(at(Fault::at(&[], message, format!("say what is varied, for example\n{EXAMPLE}"))));
        };
        let axes = axes(&source, table).map_err(at)?;
        let keys: Vec<String> = axes.iter().flat_map(|axis| axis.keys.iter().map(|key| key.parts.join("."))).collect();
        let exclusions = exclusions(table, &keys).map_err(at)?;
        let mut excluding = vec![false; exclusions.len()];
        let mut cases = Vec::new();
        let mut first = HashMap::new();
        for number in 0..count(&axes).map_err(at)? {
            let settings = settings(&axes, number);
            let mut excluded = false;
            for (used, exclusion) in excluding.iter_mut().zip(&exclusions) {
                if exclusion.covers(&settings) {
                    (*used, excluded) = (true, true);
                }
            }
            if excluded {
                continue;
            }
            let (case_source, case_config) = source.with_settings(&settings)?;
            let plan =
                Plan::new(&case_source, &case_config).map_err(|fault| case_source.error(of_case(fault, &settings)))?;
            if let Some(before) = first.insert(case_source.hash(), in_words(&settings)) {
                let message = format!("two cases are the same run: {before}, and {}", in_words(&settings));
                return Err(at(Fault::at(&["sweep"], message, "give each key its values once")));
            }
            cases.push(CasePlan { settings, plan });
        }
        if let Some(unused) = excluding.iter().position(|used| !used) {
            let message = format!("entry {} of `sweep.exclude` leaves out no case", unused + 1);
            return Err(at(Fault::at(&["sweep", "exclude"], message, "correct its values, or remove it")));
        }
        let Some(any) = cases.first() else {
            let message = "every case is left out".to_string();
            return Err(at(Fault::at(&["sweep", "exclude"], message, "leave out fewer")));
        };
        Ok(Self { name: any.plan.name.clone(), threads: any.plan.threads, source, keys, cases })
    }
}

/// A case's settings as `--set` takes them, between commas.
fn in_words(settings: &[Setting]) -> String {
    settings.iter().map(Setting::to_string).collect::<Vec<_>>().join(", ")
}

fn of_case(fault: Fault, settings: &[Setting]) -> Fault {
    Fault { message: format!("{} (in the case {})", fault.message, in_words(settings)), ..fault }
}

/// Keys that are varied together, and their values row by row.
struct Together {
    keys: Vec<Key>,
    rows: Vec<Vec<Value>>,
}

/// A key that is varied.
struct Key {
    /// Its parts in the config.
    parts: Vec<String>,
    /// Where the table `[sweep]` has it.
    place: Vec<String>,
}

/// The axes in the order of the file, those of overrides after them and the seeds at last.
fn axes(source: &ConfigSource, table: &SweepTable) -> Result<Vec<Together>, Fault> {
    let read = |name: &str, table: &toml::Table| -> Result<Vec<(Key, Vec<Value>)>, Fault> {
        let mut found = flat(table, &[], &|_, value| !value.is_table() || looks_like_range(value));
        for (place, _) in &mut found {
            place.splice(0..0, ["sweep".to_string(), name.to_string()]);
        }
        found.sort_by_key(|(place, _)| source.position_of(place).unwrap_or(usize::MAX));
        found
            .into_iter()
            .map(|(place, value)| {
                let key = key(source, parts(&place[2..]), place.clone())?;
                Ok((key, values(&value, &place)?))
            })
            .collect()
    };
    let mut axes: Vec<Together> = Vec::new();
    if let Some(pattern) = &table.files {
        let place = ["sweep", "files"].map(String::from).to_vec();
        let key = key(source, ["domain", "file"].map(String::from).to_vec(), place)?;
        let rows = files(source.path(), pattern)?.into_iter().map(|file| vec![file.into()]).collect();
        axes.push(Together { keys: vec![key], rows });
    }
    for (key, values) in read("grid", &table.grid)? {
        axes.push(Together { keys: vec![key], rows: values.into_iter().map(|value| vec![value]).collect() });
    }
    axes.extend(together(read("zip", &table.zip)?)?);
    // Files first, then as in the config.
    let from = usize::from(table.files.is_some());
    axes[from..].sort_by_key(|axis| source.position_of(&axis.keys[0].place).unwrap_or(usize::MAX));
    if let Some(seeds) = &table.seeds {
        let place = ["sweep", "seeds"].map(String::from).to_vec();
        let seeds = match seeds {
            Value::Integer(count @ 1..) => Seeds::Count(*count),
            Value::Integer(count) => {
                let message = format!("`sweep.seeds` is {count}, but must be at least 1");
                return Err(Fault::at(&["sweep", "seeds"], message, "it is the number of seeds, or a list of them"));
            }
            other => Seeds::Axis(axis(other, &place)?),
        };
        let seeds = match seeds {
            Seeds::Count(count) => spread(
                &RangeTable { from: Number::Whole(0), to: Number::Whole(count - 1), step: None, steps: Some(count) },
                &place,
            )?,
            Seeds::Axis(Axis::List(list)) => list,
            Seeds::Axis(Axis::Range(range)) => spread(&range, &place)?,
        };
        let key = key(source, vec!["seed".into()], place)?;
        axes.push(Together { keys: vec![key], rows: seeds.into_iter().map(|seed| vec![seed]).collect() });
    }
    if axes.is_empty() {
        let message = "the sweep varies no key".to_string();
        return Err(Fault::at(&["sweep"], message, format!("say what is varied, for example\n{EXAMPLE}")));
    }
    check_apart(axes.iter().flat_map(|axis| &axis.keys))?;
    Ok(axes)
}

/// The files that a pattern matches, in the order of their names, relative to the config file.
fn files(config: &Path, pattern: &str) -> Result<Vec<String>, Fault> {
    let fault = |message, help: &str| Err(Fault::at(&["sweep", "files"], message, help));
    let folder = config.parent().unwrap_or(Path::new(""));
    // Only the pattern's own stars are meant, not those in the name of a folder above.
    let whole = Path::new(&Pattern::escape(&folder.to_string_lossy())).join(pattern);
    let found = match glob::glob(&whole.to_string_lossy()) {
        Ok(found) => found,
        Err(error) => return fault(format!("{pattern:?} is no pattern: {error}"), "for example \"parts/*.stl\""),
    };
    let mut names = Vec::new();
    for path in found.filter_map(Result::ok).filter(|path| path.is_file()) {
        match path.strip_prefix(folder).unwrap_or(&path).to_str() {
            Some(name) => names.push(name.to_string()),
            None => return fault(format!("{} has a name that is not UTF-8", shown_path(&path)), "rename it"),
        }
    }
    if names.is_empty() {
        return fault(format!("no file matches {pattern:?}"), "the pattern is relative to the config file");
    }
    Ok(names)
}

/// The entries of nested tables under the parts of their keys; `is_leaf` says which ends a key.
fn flat(
    table: &toml::Table,
    prefix: &[String],
    is_leaf: &dyn Fn(&[String], &Value) -> bool,
) -> Vec<(Vec<String>, Value)> {
    let mut found = Vec::new();
    for (name, value) in table {
        let place = [prefix, std::slice::from_ref(name)].concat();
        match value {
            Value::Table(inner) if !is_leaf(&place, value) => found.extend(flat(inner, &place, is_leaf)),
            _ => found.push((place, value.clone())),
        }
    }
    found
}

/// The parts of a key, whether it was written with dots between quotes or as nested tables.
fn parts(place: &[String]) -> Vec<String> {
    place.iter().flat_map(|part| part.split('.')).map(|part| part.trim().to_string()).collect()
}

fn key(source: &ConfigSource, parts: Vec<String>, place: Vec<String>) -> Result<Key, Fault> {
    let fault = |message: String, help: &str| Err(Fault { key: place.clone(), message, help: help.into() });
    let dotted = parts.join(".");
    if parts.iter().any(String::is_empty) {
        return fault(format!("`{dotted}` is no key: a part of it is empty"), "for example \"mesh.layers\"");
    }
    if NOT_VARIED.contains(&parts[0].as_str()) {
        return fault(format!("`{dotted}` cannot be varied: it changes no result"), "remove it from the sweep");
    }
    if let Some(typed) = source.override_of(&parts) {
        let message = format!("`{dotted}` is varied here, but also set by --set {typed}");
        return fault(message, "drop one of them");
    }
    Ok(Key { parts, place })
}

/// No key may be varied twice, and none together with a table it stands in.
fn check_apart<'a>(keys: impl Iterator<Item = &'a Key>) -> Result<(), Fault> {
    let mut seen: Vec<&Key> = Vec::new();
    for key in keys {
        let overlaps = |other: &&&Key| other.parts.starts_with(&key.parts) || key.parts.starts_with(&other.parts);
        if let Some(other) = seen.iter().find(overlaps) {
            let message =
                format!("`{}` is varied twice, also as `{}`", key.parts.join("."), other.place[1..].join("."));
            return Err(Fault { key: key.place.clone(), message, help: "keep one of them".into() });
        }
        seen.push(key);
    }
    Ok(())
}

/// The axis of the table `zip`, none if it is empty.
fn together(columns: Vec<(Key, Vec<Value>)>) -> Result<Option<Together>, Fault> {
    let Some((first, rows)) = columns.first() else { return Ok(None) };
    if let Some((key, values)) = columns.iter().find(|(_, values)| values.len() != rows.len()) {
        let message = format!(
            "`{}` has {} values, but `{}`, which goes together with it, has {}",
            key.parts.join("."),
            values.len(),
            first.parts.join("."),
            rows.len()
        );
        let help = "give the keys of `sweep.zip` equally many values, or move one to `sweep.grid`";
        return Err(Fault { key: key.place.clone(), message, help: help.into() });
    }
    let rows = (0..rows.len()).map(|row| columns.iter().map(|(_, values)| values[row].clone()).collect()).collect();
    Ok(Some(Together { keys: columns.into_iter().map(|(key, _)| key).collect(), rows }))
}

/// A table with a key of a range is one, a misspelt one too; any other holds keys of the config.
fn looks_like_range(value: &Value) -> bool {
    value.as_table().is_some_and(|table| ["from", "to", "step", "steps"].iter().any(|key| table.contains_key(*key)))
}

fn values(value: &Value, place: &[String]) -> Result<Vec<Value>, Fault> {
    match axis(value, place)? {
        Axis::List(list) => Ok(list),
        Axis::Range(range) => spread(&range, place),
    }
}

fn axis(value: &Value, place: &[String]) -> Result<Axis, Fault> {
    let dotted = place.join(".");
    let help = "give a list [0.5, 1, 2] or a range { from = 2, to = 8, step = 2 }";
    let fault = |message: String, help: String| Err(Fault { key: place.to_vec(), message, help });
    match value {
        Value::Array(list) if list.is_empty() => fault(format!("`{dotted}` has no values"), help.into()),
        Value::Array(list) if list.len() > MOST_CASES => too_many(list.len() as f64, place),
        Value::Array(list) => Ok(Axis::List(list.clone())),
        Value::Table(_) => RangeTable::deserialize(value.clone()).map(Axis::Range).or_else(|error| {
            let (message, help) = reworded(error.message(), None);
            fault(format!("`{dotted}`: {message}"), help)
        }),
        _ => fault(format!("`{dotted}` is neither a list nor a range"), help.into()),
    }
}

impl Number {
    fn real(self) -> f64 {
        match self {
            Self::Whole(number) => number as f64,
            Self::Real(number) => number,
        }
    }
}

/// The values of a range.
fn spread(range: &RangeTable, place: &[String]) -> Result<Vec<Value>, Fault> {
    /// Share of a step by which rounding may carry the last value beyond the end.
    const SLACK: f64 = 1e-9;
    let fault = |message: &str, help: &str| {
        Err(Fault { key: place.to_vec(), message: format!("`{}`: {message}", place.join(".")), help: help.into() })
    };
    let (from, to) = (range.from.real(), range.to.real());
    let (step, intervals) = match (range.step, range.steps) {
        (Some(step), None) => (step.real(), ((to - from) / step.real() + SLACK).floor()),
        (None, Some(1)) if from == to => (0.0, 0.0),
        (None, Some(steps @ 2..)) => ((to - from) / (steps - 1) as f64, (steps - 1) as f64),
        (None, Some(_)) => {
            return fault("a range from one number to another has 2 steps at least", "set steps = 2 or more");
        }
        _ => {
            return fault(
                "a range needs exactly one of `step` and `steps`",
                "for example { from = 2, to = 8, step = 2 }",
            );
        }
    };
    let stands_still = step == 0.0 && from != to;
    // The comparison also refuses what is not a number.
    if stands_still || !(from.is_finite() && to.is_finite() && step.is_finite() && intervals >= 0.0) {
        return fault("its step does not lead from `from` to `to`", "for example { from = 2, to = 8, step = 2 }");
    }
    if intervals >= MOST_CASES as f64 {
        return too_many(intervals + 1.0, place);
    }
    let given = [Some(range.from), Some(range.to), range.step];
    let whole = given.into_iter().flatten().all(|number| matches!(number, Number::Whole(_))) && step.fract() == 0.0;
    let value = |index: usize| {
        let exact = from + index as f64 * step;
        if whole {
            return Value::Integer(exact as i64);
        }
        // So that the third of 0.1, 0.2, ... is 0.3, as in a list, and not 0.30000000000000004.
        Value::Float(format!("{exact:.11e}").parse().unwrap_or(exact))
    };
    Ok((0..=intervals as usize).map(value).collect())
}

fn too_many<T>(count: f64, place: &[String]) -> Result<T, Fault> {
    let message = format!("the sweep has {count} cases or more, but {MOST_CASES} is the limit");
    let help = "give fewer values, put keys that go together in `sweep.zip`, or split the sweep into several configs";
    Err(Fault { key: place.to_vec(), message, help: help.into() })
}

/// The number of cases before exclusion.
fn count(axes: &[Together]) -> Result<usize, Fault> {
    let count: f64 = axes.iter().map(|axis| axis.rows.len() as f64).product();
    if count > MOST_CASES as f64 { too_many(count, &["sweep".to_string()]) } else { Ok(count as usize) }
}

/// Those of a case, counted from 0 with the last axis varying fastest.
fn settings(axes: &[Together], number: usize) -> Vec<Setting> {
    let mut rest = number;
    let mut rows: Vec<&Vec<Value>> = Vec::new();
    for axis in axes.iter().rev() {
        rows.push(&axis.rows[rest % axis.rows.len()]);
        rest /= axis.rows.len();
    }
    let pairs = axes.iter().zip(rows.into_iter().rev()).flat_map(|(axis, row)| axis.keys.iter().zip(row));
    pairs
        .map(|(key, value)| Setting { key: key.parts.clone(), value: value.clone(), place: key.place.clone() })
        .collect()
}

/// An entry of `sweep.exclude`.
struct Exclusion(Vec<(String, Value)>);

impl Exclusion {
    fn covers(&self, settings: &[Setting]) -> bool {
        self.0.iter().all(|(key, wanted)| {
            let value = settings.iter().find(|setting| setting.key() == *key).map(|setting| &setting.value);
            value.is_some_and(|value| {
                let any = wanted.as_array().is_some_and(|list| list.iter().any(|one| same(one, value)));
                any || same(wanted, value)
            })
        })
    }
}

/// Equal, or equal numbers of different types.
fn same(a: &Value, b: &Value) -> bool {
    let number = |value: &Value| value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64));
    match (number(a), number(b)) {
        (Some(a), Some(b)) => a.partial_cmp(&b) == Some(Ordering::Equal),
        _ => a == b,
    }
}

fn exclusions(table: &SweepTable, keys: &[String]) -> Result<Vec<Exclusion>, Fault> {
    let is_varied = |place: &[String]| keys.contains(&parts(place).join("."));
    let mut exclusions = Vec::new();
    for entry in &table.exclude {
        let entry = flat(entry, &[], &|place, _| is_varied(place));
        let fault = |message, help| Err(Fault::at(&["sweep", "exclude"], message, help));
        if let Some((place, _)) = entry.iter().find(|(place, _)| !is_varied(place)) {
            let known = keys.iter().map(|key| format!("`{key}`")).collect::<Vec<_>>().join(" or ");
            let wrong = parts(place).join(".");
            let (_, help) = reworded(&format!("unknown field `{wrong}`, expected {known}"), None);
            return fault(format!("`{wrong}` is no key that the sweep varies"), help);
        }
        if entry.is_empty() {
            return fault("an entry without keys would leave out every case".to_string(), "give it keys".to_string());
        }
        exclusions.push(Exclusion(entry.into_iter().map(|(place, value)| (parts(&place).join("."), value)).collect()));
    }
    Ok(exclusions)
}

#[cfg(test)]
mod tests;

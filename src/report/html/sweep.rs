//! The page of a sweep, from `index.jsonl` and the order of the columns in `index.csv`.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::chart::{Axis, Chart, Series, Style};
use super::page::{Page, paragraph, text};
use super::{PageError, read_text};
use crate::dilatation::lower_bound;
use crate::picture::dilatation_colours;

/// The columns that a table starts with; the settings follow, then the results.
const FIRST: [&str; 3] = ["case", "id", "status"];
/// The results that the others follow.
const FOREMOST: [&str; 6] = ["max_k", "mean_k", "best_bound", "gap", "bijective", "initial_max_k"];

/// The index of a sweep.
struct Index {
    cases: Vec<Value>,
    /// The keys that are varied, in the order of the config.
    settings: Vec<String>,
    /// The results.
    results: Vec<String>,
}

impl Index {
    fn read(folder: &Path) -> Result<Self, PageError> {
        let [lines, table] = ["index.jsonl", "index.csv"].map(|name| folder.join(name));
        let parse = |line: &str| serde_json::from_str(line).map_err(|error| PageError::broken(&lines, error));
        let cases: Vec<Value> = read_text(&lines)?.lines().map(parse).collect::<Result<_, _>>()?;
        let broken = |error| PageError::broken(&table, error);
        let mut table = csv::Reader::from_path(&table).map_err(broken)?;
        let columns: Vec<String> = table.headers().map_err(broken)?.iter().map(String::from).collect();
        let is_setting = |name: &String| cases.iter().any(|case| case["settings"].get(name).is_some());
        let (settings, results) = columns.into_iter().partition(is_setting);
        let is_result = |name: &String| !FIRST.contains(&name.as_str()) && name != "error";
        let mut results: Vec<String> = Vec::into_iter(results).filter(is_result).collect();
        results.sort_by_key(|name| FOREMOST.iter().position(|first| first == name).unwrap_or(FOREMOST.len()));
        Ok(Self { cases, settings, results })
    }

    /// The cases with finite K: case, largest and mean K.
    fn measured(&self) -> impl Iterator<Item = (&Value, [f64; 2])> {
        self.cases.iter().filter_map(|case| {
            let result = |name: &str| case["results"][name].as_f64();
            Some((case, [result("max_k")?, result("mean_k")?]))
        })
    }
}

/// Reads the folder of a sweep.
pub(super) fn page(folder: &Path) -> Result<Page, PageError> {
    let index = Index::read(folder)?;
    let front = front(&index);
    let mut charts = vec![scatter(&index, &front)];
    charts.extend(index.settings.iter().enumerate().map(|(number, key)| along(&index, number + 1, key)));
    let mut sections = vec![("In short".into(), in_short(&index, &front))];
    let mut shown = None;
    if front.is_empty() {
        charts.clear();
    } else {
        sections.push(("The cases against each other".into(), include_str!("sweep.html").into()));
        shown = Some(data(&index, folder));
    }
    sections.push(("The cases".into(), table(&index, folder)));
    let name = folder.canonicalize().unwrap_or_else(|_| folder.into());
    let name = name.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    Ok(Page { title: format!("qcball sweep: {name}"), sections, pictures: charts, sweep: shown, ..Page::default() })
}

/// The folders of the cases that are done, but that have no page.
pub(super) fn without_page(folder: &Path) -> Result<Vec<PathBuf>, PageError> {
    Ok(done(folder)?.into_iter().filter(|case| !case.join("report.html").is_file()).collect())
}

/// The folders of the cases that are done.
pub(super) fn done(folder: &Path) -> Result<Vec<PathBuf>, PageError> {
    let index = Index::read(folder)?;
    let id = |case: &Value| case["id"].as_str().filter(|_| case["status"] == "done").map(String::from);
    Ok(index.cases.iter().filter_map(id).map(|id| folder.join("cases").join(id)).collect())
}

/// What the charts of the page are drawn from.
fn data(index: &Index, folder: &Path) -> String {
    let columns: Vec<(&String, &str)> = index.settings.iter().map(|name| (name, "settings")).collect();
    let columns = [columns, index.results.iter().map(|name| (name, "results")).collect()].concat();
    let value = |value: &Value| match value {
        // Words, of which charts have an axis; a list is one.
        Value::Array(_) | Value::Object(_) | Value::Bool(_) => Value::from(value.to_string()),
        other => other.clone(),
    };
    let case = |case: &Value| {
        let values: Vec<Value> = columns.iter().map(|(name, group)| value(&case[group][name])).collect();
        json!({ "case": case["case"], "link": link(case, folder), "values": values })
    };
    json!({
        "keys": index.settings, "columns": columns.iter().map(|(name, _)| name).collect::<Vec<_>>(),
        "cases": index.cases.iter().map(case).collect::<Vec<_>>(), "colours": dilatation_colours(17),
    })
    .to_string()
}

/// The page of a case that is done, if it has one.
fn link(case: &Value, folder: &Path) -> Option<String> {
    let id = case["id"].as_str().filter(|_| case["status"] == "done")?;
    let page = format!("cases/{id}/report.html");
    folder.join(&page).is_file().then_some(page)
}

/// A result as a cell of a table: a dilatation or a ratio with five decimals, since columns are compared by eye; index.csv
/// has all digits.
fn result(value: &Value) -> String {
    match value.as_f64() {
        Some(x) if value.is_f64() => format!("{x:.5}"),
        _ => plain(value),
    }
}

/// A value in as few digits as it takes, at most five decimals.
fn plain(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        Value::Number(number) if number.is_f64() => {
            let x = number.as_f64().unwrap_or(f64::NAN);
            format!("{x:.5}").trim_end_matches('0').trim_end_matches('.').to_string()
        }
        other => other.to_string(),
    }
}

fn settings_in_words(case: &Value) -> String {
    let settings = case["settings"].as_object().into_iter().flatten();
    settings.map(|(key, value)| format!("{key} = {}", plain(value))).collect::<Vec<_>>().join(", ")
}

fn hover(case: &Value, [max, mean]: [f64; 2]) -> String {
    let settings = settings_in_words(case).replace(", ", "<br>");
    format!("case {}<br>{settings}<br>max K {max:.4}, mean K {mean:.4}", case["case"])
}

/// The cases that no other beats in one of largest and mean K without losing in the other, by rising largest K.
fn front(index: &Index) -> Vec<(&Value, [f64; 2])> {
    let mut cases: Vec<_> = index.measured().collect();
    cases.sort_by(|(_, a), (_, b)| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let mut least = f64::INFINITY;
    cases.retain(|(_, [_, mean])| {
        let better = *mean < least;
        least = least.min(*mean);
        better
    });
    cases
}

fn in_short(index: &Index, front: &[(&Value, [f64; 2])]) -> String {
    let count = |status: &str| index.cases.iter().filter(|case| case["status"] == status).count();
    let mut words = format!("{} cases over {}: {} done", index.cases.len(), index.settings.join(", "), count("done"));
    for status in ["failed", "incomplete", "missing"] {
        if count(status) > 0 {
            words += &format!(", {} {status}", count(status));
        }
    }
    let mut html = paragraph(&(words + "."));
    if let (Some((least_max, [max, _])), Some((least_mean, [_, mean]))) = (front.first(), front.last()) {
        html += &paragraph(&format!(
            "The smallest max K is {max:.4}, of case {} ({}); the smallest mean K is {mean:.4}, of case {} ({}). {} on \
             the Pareto front: no other case is better in one of the two and not worse in the other.",
            least_max["case"],
            settings_in_words(least_max),
            least_mean["case"],
            settings_in_words(least_mean),
            if front.len() == 1 { "1 case is".into() } else { format!("{} cases are", front.len()) }
        ));
    }
    for case in index.cases.iter().filter(|case| case["status"] == "failed").take(5) {
        let why = case["error"].as_str().unwrap_or("without a message");
        html += &format!("<p class=\"warning\">Case {} failed: {}</p>\n", case["case"], text(why));
    }
    html
}

fn scatter(index: &Index, front: &[(&Value, [f64; 2])]) -> Chart {
    let series = |name: &str, colour: usize, style: Style, cases: &[(&Value, [f64; 2])]| Series {
        hover: cases.iter().map(|(case, k)| hover(case, *k)).collect(),
        ..Series::new(name, colour, style, cases.iter().map(|(_, k)| *k).collect())
    };
    let all: Vec<_> = index.measured().collect();
    Chart {
        id: "max-mean".into(),
        title: "Largest against mean K, a point a case".into(),
        x: Axis::logarithmic_beyond(5.0, "max K", all.iter().map(|(_, k)| k[0])),
        y: Axis::logarithmic_beyond(5.0, "mean K", all.iter().map(|(_, k)| k[1])),
        series: vec![
            series("cases", 1, Style::Points, &all),
            series("Pareto front", 0, Style::Line, front),
            series("on the front", 0, Style::Points, front),
        ],
    }
}

/// The largest K over the values of one key.
fn along(index: &Index, number: usize, key: &str) -> Chart {
    let value = |case: &Value| case["settings"].get(key).cloned().unwrap_or_default();
    let numeric = index.measured().all(|(case, _)| value(case).is_number());
    let mut names: Vec<String> = Vec::new();
    let mut points = Vec::new();
    let mut hovers = Vec::new();
    for (case, k) in index.measured() {
        let value = value(case);
        let place = value.as_f64().filter(|_| numeric).unwrap_or_else(|| {
            let name = plain(&value);
            let place = names.iter().position(|known| *known == name).unwrap_or(names.len());
            if place == names.len() {
                names.push(name);
            }
            place as f64
        });
        points.push([place, k[0]]);
        hovers.push(hover(case, k));
    }
    let mut sorted = points.clone();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let groups = sorted.chunk_by(|a, b| a[0] == b[0]);
    let medians = groups.map(|group| [group[0][0], group[(group.len() - 1) / 2][1]]).collect();
    Chart {
        id: format!("axis-{number}"),
        title: format!("max K over {key}"),
        x: Axis { names, ..Axis::linear(key) },
        y: Axis::logarithmic_beyond(5.0, "max K", points.iter().map(|point| point[1])),
        series: vec![
            Series { hover: hovers, ..Series::new("cases", 1, Style::Points, points) },
            Series::new("median", 0, Style::Line, medians),
        ],
    }
}

/// The table; its script sorts and filters the rows.
fn table(index: &Index, folder: &Path) -> String {
    let any_error = index.cases.iter().any(|case| case["error"].is_string());
    let mut columns: Vec<(&str, Option<&str>)> = FIRST.iter().map(|name| (*name, None)).collect();
    columns.extend(index.settings.iter().map(|name| (name.as_str(), Some("settings"))));
    columns.extend(index.results.iter().map(|name| (name.as_str(), Some("results"))));
    columns.extend(any_error.then_some(("error", None)));
    let head: String = columns
        .iter()
        .map(|(name, _)| format!("<th aria-sort=\"none\"><button type=\"button\">{}</button></th>", text(name)))
        .collect();
    let mut rows = String::new();
    for (number, case) in index.cases.iter().enumerate() {
        rows += &format!("<tr data-case=\"{number}\">");
        for &(name, group) in &columns {
            let value = group.map_or(&case[name], |group| &case[group][name]);
            let shown = text(&match (name, group) {
                ("best_bound", Some("results")) => value.as_f64().map(lower_bound).unwrap_or_default(),
                (_, Some("results")) => result(value),
                _ => plain(value),
            });
            rows += &match (name, link(case, folder)) {
                ("id", Some(link)) => format!("<td><a href=\"{}\">{shown}</a></td>", text(&link)),
                _ if value.is_number() => format!("<td class=\"number\">{shown}</td>"),
                _ => format!("<td>{shown}</td>"),
            };
        }
        rows += "</tr>\n";
    }
    format!(
        "<p><label>Show only rows with <input id=\"filter\" type=\"search\" placeholder=\"cube max_k&lt;4\" size=\"40\"></label> \
         <output id=\"shown\"></output></p>\n<p class=\"small\">Words, and conditions on columns such as max_k&lt;4 or \
         status=done, between blanks. A click on a heading sorts.</p>\n<div class=\"scroll\" tabindex=\"0\" role=\"region\" \
         aria-label=\"Table of the cases\"><table id=\"cases\"><thead><tr>{head}</tr></thead><tbody>\n{rows}</tbody></table></div>\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_is_what_no_other_case_beats() {
        let case =
            |number: u32, max: f64, mean: f64| json!({ "case": number, "results": { "max_k": max, "mean_k": mean } });
        let mut cases =
            vec![case(1, 5.0, 2.0), case(2, 4.0, 3.0), case(3, 4.0, 2.5), case(4, 6.0, 2.0), case(5, 9.0, 1.5)];
        // A flipped map has no finite K, a failed case no results.
        cases.push(json!({ "case": 6, "results": { "max_k": null, "mean_k": null } }));
        cases.push(json!({ "case": 7, "results": null, "status": "failed" }));
        let index = Index { cases, settings: vec![], results: vec![] };
        let numbers: Vec<u64> = front(&index).iter().map(|(case, _)| case["case"].as_u64().unwrap()).collect();
        assert_eq!(numbers, [3, 1, 5]);
    }
}

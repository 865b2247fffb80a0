//! The page of two runs side by side, from their records, maps and traces.

use std::path::Path;

use super::chart::{Axis, Chart, Series, Style};
use super::page::{Page, chart, paragraph, text};
use super::run::{Columns, Shown, cumulative, histogram, sorted};
use super::viewer::viewer;
use crate::config::ConfigSource;
use crate::dilatation::{lower_bound, number, upper_bound};
use crate::report::{Report, summary};

/// The page of two runs, called A and B.
pub(super) fn page(runs: [&Shown; 2]) -> Page {
    let reports = runs.map(|run| run.report);
    let columns = runs.map(|run| Columns::of(run.cells));
    let (view, viewer) = viewer(&[runs[0].viewed(&columns[0], "A"), runs[1].viewed(&columns[1], "B")]);
    let finals = [("A", sorted(runs[0].cells, |cell| cell.k)), ("B", sorted(runs[1].cells, |cell| cell.k))];
    let charts = [histogram("Tets by their K, of the final maps", &finals), cumulative(&finals), convergence(&runs)];
    let sections = vec![
        ("In short".into(), in_short(reports)),
        ("Domains and images".into(), view),
        ("Dilatations".into(), format!("<div class=\"pair\">{}{}</div>\n", chart(&charts[0]), chart(&charts[1]))),
        ("Convergence".into(), chart(&charts[2])),
        ("All that was found".into(), summaries(reports)),
    ];
    let [a, b] = reports.map(|report| &report.name);
    Page { title: format!("qcball: {a} beside {b}"), sections, charts: charts.into(), viewer, ..Page::default() }
}

fn in_short(reports: [&Report; 2]) -> String {
    let [a, b] = reports;
    let mut words = format!("A is {} ({}), B is {} ({}).", a.name, a.domain.solid, b.name, b.domain.solid);
    let [before, after] = reports.map(|report| report.achieved.last.max_k);
    if before.is_finite() && after.is_finite() {
        let change = match after / before {
            ratio if (ratio - 1.0).abs() <= 1e-6 => "the same as".to_string(),
            ratio if ratio < 1.0 => format!("{:.2} % below", 100.0 * (1.0 - ratio)),
            ratio => format!("{:.2} % above", 100.0 * (ratio - 1.0)),
        };
        words += &format!(" The largest K of B, {}, is {change} that of A, {}.", number(after), number(before));
    }
    if a.revision != b.revision {
        words += &format!(" They are of different revisions of the program, {} and {}.", a.revision, b.revision);
    }
    paragraph(&words) + &figures(reports) + &settings(reports)
}

/// A figure of a run: as it is shown, and the number if ratios of it tell something.
type Figure = (String, Option<f64>);

/// The figures beside each other.
fn figures(reports: [&Report; 2]) -> String {
    let k = |value: f64| (number(value), Some(value));
    let some = |value: Option<f64>, shown: fn(f64) -> String| (value.map_or_else(|| "none".into(), shown), value);
    let count = |value: usize| (value.to_string(), Some(value as f64));
    let words = |words: String| (words, None);
    let of = |report: &Report| -> Vec<(&'static str, Figure)> {
        let (last, best) = (&report.achieved.last, report.achieved.best);
        vec![
            ("tets", count(report.domain.tets)),
            ("vertices", count(report.domain.vertices)),
            ("start", words(report.map.map.clone())),
            ("largest K of the start", k(report.achieved.initial.max_k)),
            ("largest K", k(last.max_k)),
            ("mean K", k(last.mean_k)),
            ("median K", k(last.p50_k)),
            ("99 % of the tets have K up to", k(last.p99_k)),
            ("largest K_I", k(last.max_k_inner)),
            ("largest K_O", k(last.max_k_outer)),
            ("best proved bound", some(best.best_bound, lower_bound)),
            ("gap", some(best.gap, upper_bound)),
            ("K onto the ball, at most", some(last.ball_k.map(|k| k.certified), upper_bound)),
            ("active tets", count(report.achieved.active)),
            ("flipped tets", count(last.flipped)),
            ("bijective", words(if report.bijective { "yes" } else { "no" }.into())),
            ("stopped", words(report.achieved.stop.to_string())),
            ("iterations", count(report.achieved.iterations)),
            ("seconds", (format!("{:.2}", report.achieved.times.seconds), Some(report.achieved.times.seconds))),
        ]
    };
    let [one, other] = reports.map(of);
    let row = |((name, a), (_, b)): (&(&str, Figure), &(&str, Figure))| {
        let ratio = a.1.zip(b.1).map(|(a, b)| b / a).filter(|ratio| ratio.is_finite());
        let ratio = ratio.map(|ratio| format!("{ratio:.4}")).unwrap_or_default();
        let cells = [&a.0, &b.0, &ratio].map(|cell| format!("<td class=\"number\">{}</td>", text(cell)));
        format!("<tr><td>{name}</td>{}</tr>\n", cells.concat())
    };
    let rows: String = one.iter().zip(&other).map(row).collect();
    format!(
        "<div class=\"scroll\" tabindex=\"0\"><table id=\"figures\"><thead><tr><th></th><th>A</th><th>B</th><th>B / A</th></tr></thead>\
         <tbody>{rows}</tbody></table></div>\n"
    )
}

/// The keys of the configs that differ.
fn settings(reports: [&Report; 2]) -> String {
    let read = |report: &Report| {
        let source = ConfigSource::of_text(Path::new(&report.config), report.config_text.clone(), &report.overrides);
        source.ok().map(|(source, _)| source.settings())
    };
    let [Some(one), Some(other)] = reports.map(read) else {
        return paragraph(
            "A config is of another version of the program, so that the two are not compared key by key.",
        );
    };
    let mut keys: Vec<&String> =
        one.keys().chain(other.keys()).filter(|key| one.get(*key) != other.get(*key)).collect();
    keys.sort();
    keys.dedup();
    if keys.is_empty() {
        return paragraph("The configs say the same.");
    }
    let cell =
        |value: Option<&String>| format!("<td>{}</td>", value.map_or_else(|| "not set".into(), |value| text(value)));
    let row =
        |key: &&String| format!("<tr><td>{}</td>{}{}</tr>\n", text(key), cell(one.get(*key)), cell(other.get(*key)));
    let rows: String = keys.iter().map(row).collect();
    format!(
        "<h3>Keys of the configs that differ</h3>\n<div class=\"scroll\" tabindex=\"0\"><table id=\"settings\"><thead><tr><th>key</th><th>A</th>\
         <th>B</th></tr></thead><tbody>{rows}</tbody></table></div>\n"
    )
}

fn convergence(runs: &[&Shown; 2]) -> Chart {
    let mut series = Vec::new();
    for (run, (name, [colour, of_bound])) in runs.iter().zip([("A", [0, 3]), ("B", [1, 4])]) {
        let points = run.trace.iter().enumerate().map(|(at, row)| [at as f64, row.max_k]).collect();
        let hover = |row: &crate::optimize::TraceRow| {
            format!("{name}: {}, iteration {}: max K {}", row.phase, row.iteration, number(row.max_k))
        };
        let hover = run.trace.iter().map(hover).collect();
        series.push(Series { hover, ..Series::new(name, colour, Style::Line, points) });
        if let Some(bound) = run.report.achieved.best.best_bound {
            let points = vec![[0.0, bound], [run.trace.len().saturating_sub(1) as f64, bound]];
            series.push(Series::new(format!("best bound of {name}"), of_bound, Style::Line, points));
        }
    }
    let values = runs.iter().flat_map(|run| run.trace.iter().map(|row| row.max_k));
    Chart {
        id: "trace".into(),
        title: "The largest K by iteration".into(),
        x: Axis::linear("iteration, over all phases"),
        y: Axis::logarithmic_beyond(2.0, "max K", values),
        series,
    }
}

fn summaries(reports: [&Report; 2]) -> String {
    let one = |(name, report): (&str, &Report)| {
        format!(
            "<figure><figcaption>{name}</figcaption><pre tabindex=\"0\">{}</pre></figure>\n",
            text(&summary(report))
        )
    };
    format!("<div class=\"pair\">{}</div>\n", ["A", "B"].into_iter().zip(reports).map(one).collect::<String>())
}

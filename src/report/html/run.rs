//! The page of a run, from `report.json`, `summary.txt`, `trace.csv`, `cells.csv`, `domain.vtu` and `image.vtu`.

use std::path::Path;

use serde::Deserialize;
use serde_json::{Value, json};

use super::chart::{Axis, Chart, Series, Style};
use super::page::{Page, chart, paragraph, text};
use super::surfaces::{CellValues, surfaces};
use super::{PageError, read_text};
use crate::dilatation;
use crate::mesh::io::read_tets;
use crate::mesh::{Boundary, TetMesh};
use crate::report::summary::{decimals, point};

/// Bins of a histogram of K.
const BINS: usize = 48;
/// Points of a cumulative curve.
const CURVE_POINTS: usize = 300;

/// A line of `cells.csv`.
#[derive(Deserialize)]
struct CellRow {
    k_initial: f64,
    k_inner: f64,
    k_outer: f64,
    k: f64,
    active: bool,
}

/// A line of `trace.csv`.
#[derive(Deserialize)]
struct Row {
    phase: String,
    iteration: usize,
    max_k: f64,
    mean_k: f64,
}

fn rows<T: for<'a> Deserialize<'a>>(path: &Path) -> Result<Vec<T>, PageError> {
    let mut reader = csv::Reader::from_path(path).map_err(|error| PageError::broken(path, error))?;
    reader.deserialize().map(|row| row.map_err(|error| PageError::broken(path, error))).collect()
}

/// Reads the folder of a run.
pub(super) fn page(folder: &Path) -> Result<Page, PageError> {
    let record = folder.join("report.json");
    let report: Value =
        serde_json::from_str(&read_text(&record)?).map_err(|error| PageError::broken(&record, error))?;
    let cells: Vec<CellRow> = rows(&folder.join("cells.csv"))?;
    let trace: Vec<Row> = rows(&folder.join("trace.csv"))?;
    let charts = [histogram(&cells), cumulative(&cells), convergence(&trace), ladder(&report)];
    let summary = std::fs::read_to_string(folder.join("summary.txt")).unwrap_or_default();
    let viewer = viewer(folder, &report, &cells)?;
    let sections = vec![
        ("In short".into(), in_short(&report, &summary)),
        (
            "Domain and image".into(),
            match viewer {
                Some(_) => include_str!("viewer.html").to_string(),
                None => paragraph("The boundary is too large for a page; open domain.vtu and image.vtu in ParaView."),
            },
        ),
        (
            "Dilatations before and after".into(),
            format!("<div class=\"pair\">{}{}</div>\n", chart(&charts[0]), chart(&charts[1])),
        ),
        ("Convergence".into(), chart(&charts[2])),
        ("Bounds".into(), chart(&charts[3]) + &bounds_table(&report)),
    ];
    let name = report["name"].as_str().unwrap_or("run");
    Ok(Page { title: format!("qcball: {name}"), sections, charts: charts.into(), viewer })
}

/// A dilatation with four decimals; `null` stands for infinity.
fn number(value: &Value) -> String {
    value.as_f64().map_or_else(|| "inf".into(), dilatation::number)
}

fn in_short(report: &Value, summary: &str) -> String {
    let of = |pointer: &str| number(report.pointer(pointer).unwrap_or(&Value::Null));
    let gap = report["gap"].as_f64().map_or_else(|| "none".into(), dilatation::upper_bound);
    let bound = report["best_bound"].as_f64().map_or_else(|| "none".into(), dilatation::lower_bound);
    let bijective = report["bijective"] == true;
    let cards = [
        ("largest K", of("/final/max_k")),
        ("mean K", of("/final/mean_k")),
        ("99 % of tets have K up to", of("/final/p99_k")),
        ("best proved bound", bound.clone()),
        ("gap", gap.clone()),
        ("bijective", if bijective { "yes" } else { "no" }.into()),
    ];
    let cards: String =
        cards.iter().map(|(name, value)| format!("<div><dt>{name}</dt><dd>{}</dd></div>", text(value))).collect();
    // Maps in closed form go onto images of their own.
    let start = match report["map"].as_str() {
        Some(map) if map.starts_with("farthest") => format!("onto the unit ball. From the map \"{map}\""),
        Some(map) if report["radial_exponent"].is_null() => {
            format!("by the map \"{map}\", whose values at the boundary were kept. From this map")
        }
        _ => "onto the unit ball. From the radial map".to_string(),
    };
    let mut words = format!(
        "A mesh of {tets} tets and {vertices} vertices ({solid}) was mapped {start} to the final one the largest K went from \
         {} to {} and the mean K from {} to {}, in {} iterations.",
        of("/initial/max_k"),
        of("/final/max_k"),
        of("/initial/mean_k"),
        of("/final/mean_k"),
        report["iterations"],
        solid = report["domain"]["solid"].as_str().unwrap_or("a given solid"),
        tets = report["domain"]["tets"],
        vertices = report["domain"]["vertices"],
    );
    if report["best_bound"].is_number() {
        words += &format!(" It is proved that no map of this mesh with this boundary has a largest K below {bound}");
        words +=
            &if report["gap"].is_number() { format!(": the map is within a factor of {gap}.") } else { ".".into() };
    }
    let mut html = format!("<dl class=\"cards\">{cards}</dl>\n{}", paragraph(&words));
    let reason = report["bijective_reason"].as_str().unwrap_or_default();
    html += &paragraph(&format!("The map is {}bijective: {reason}.", if bijective { "" } else { "not known to be " }));
    if let Some(limit) = report["limit"]["sentence"].as_str() {
        html += &paragraph(&format!("{}.", capital(limit)));
    }
    if let Some(place) = bottleneck(report) {
        html += &paragraph(&place);
    }
    for warning in report["warnings"].as_array().into_iter().flatten().filter_map(Value::as_str) {
        html += &format!("<p class=\"warning\">Warning: {}</p>\n", text(warning));
    }
    if !summary.is_empty() {
        html += &format!(
            "<details><summary>The whole summary</summary><pre tabindex=\"0\">{}</pre></details>\n",
            text(summary)
        );
    }
    let config = report["config_text"].as_str().unwrap_or_default();
    html + &format!(
        "<details><summary>The config</summary><pre tabindex=\"0\">{}</pre></details>\n<p class=\"small\">qcball {}, revision {}, config {}, \
         seed {}</p>\n",
        text(config),
        text(report["version"].as_str().unwrap_or("?")),
        text(report["revision"].as_str().unwrap_or("?")),
        text(report["config"].as_str().unwrap_or("?")),
        report["seed"]
    )
}

fn capital(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().map(|first| first.to_uppercase().chain(letters).collect()).unwrap_or_default()
}

/// The bottleneck's vertices and position in the domain.
fn place(report: &Value) -> Option<(Vec<usize>, [f64; 3])> {
    let place = report.pointer("/bottleneck/place")?;
    let position = ["position", "midpoint", "centroid"].iter().find_map(|key| place.get(key))?;
    let position = serde_json::from_value(position.clone()).ok()?;
    let vertices = match place.get("vertex") {
        Some(vertex) => vec![vertex.as_u64()? as usize],
        None => serde_json::from_value(place.get("vertices")?.clone()).ok()?,
    };
    Some((vertices, position))
}

fn bottleneck(report: &Value) -> Option<String> {
    let (vertices, position) = place(report)?;
    let decimals = decimals(report["domain"]["volume"].as_f64().unwrap_or(1.0));
    let bottleneck = &report["bottleneck"];
    let kind = match vertices.len() {
        1 => "vertex",
        2 => "edge",
        _ => "face",
    };
    let vertices: Vec<String> = vertices.iter().map(usize::to_string).collect();
    let count = bottleneck["places"].as_u64().unwrap_or(1);
    let others = if count > 1 { format!(", one of {count} such places") } else { String::new() };
    let inside = if bottleneck["interior"] == true { "inside the solid, nearest to" } else { "at" };
    Some(format!(
        "The bottleneck: {} tets have a K within 0.1 % of the largest, {inside} the {kind} {} at {}{others}. It is marked in the viewer.",
        bottleneck["active"],
        vertices.join("-"),
        point(position, decimals)
    ))
}

fn viewer(folder: &Path, report: &Value, cells: &[CellRow]) -> Result<Option<String>, PageError> {
    let [domain_path, image_path] = ["domain.vtu", "image.vtu"].map(|name| folder.join(name));
    let (domain, image) = (read_tets(&domain_path)?, read_tets(&image_path)?);
    if image.points.len() != domain.points.len() {
        return Err(PageError::broken(&image_path, "it has not as many vertices as domain.vtu"));
    }
    if cells.len() != domain.tets.len() {
        return Err(PageError::broken(&folder.join("cells.csv"), "it has not as many rows as domain.vtu has tets"));
    }
    let mesh = TetMesh::new(domain.points, domain.tets).map_err(|error| PageError::broken(&domain_path, error))?;
    let boundary = Boundary::of(&mesh).map_err(|error| PageError::broken(&domain_path, error))?;
    let column = |value: fn(&CellRow) -> f64| cells.iter().map(value).collect();
    let values = CellValues {
        inner: column(|cell| cell.k_inner),
        outer: column(|cell| cell.k_outer),
        start: column(|cell| cell.k_initial),
        active: cells.iter().map(|cell| cell.active).collect(),
    };
    let marker = place(report).and_then(|(vertices, position)| {
        let there: Option<Vec<_>> = vertices.iter().map(|&vertex| image.points.get(vertex)).collect();
        let there = there?;
        let mean: [f64; 3] = (there.iter().copied().sum::<crate::mesh::Vec3>() / there.len() as f64).into();
        Some(json!([position, mean]))
    });
    let finite = |value: f64, most: f64| if value.is_finite() { most.max(value) } else { most };
    // Both maps on one scale, so that colours compare.
    let most = cells.iter().fold(1.0, |most, cell| finite(cell.k, finite(cell.k_initial, most)));
    let Some(surfaces) = surfaces(&mesh, &boundary, &image.points, &values) else { return Ok(None) };
    Ok(Some(json!({ "surfaces": surfaces, "marker": marker, "most": most }).to_string()))
}

/// K before and after, sorted.
fn sorted(cells: &[CellRow]) -> [(&'static str, Vec<f64>); 2] {
    let sorted = |value: fn(&CellRow) -> f64| {
        let mut values: Vec<f64> = cells.iter().map(value).collect();
        values.sort_unstable_by(f64::total_cmp);
        values
    };
    [("start", sorted(|cell| cell.k_initial)), ("final", sorted(|cell| cell.k))]
}

fn histogram(cells: &[CellRow]) -> Chart {
    let columns = sorted(cells);
    let most = columns.iter().flat_map(|(_, values)| values).copied().filter(|k| k.is_finite()).fold(1.0, f64::max);
    // A conformal map alone has no range.
    let width = most.ln().max(1e-3) / BINS as f64;
    let series = columns.iter().enumerate().map(|(colour, (name, values))| {
        let mut counts = [0usize; BINS + 1];
        values.iter().filter(|k| k.is_finite()).for_each(|k| counts[((k.ln() / width) as usize).min(BINS - 1)] += 1);
        let share = |count: usize| 100.0 * count as f64 / values.len().max(1) as f64;
        let edge = |bin: usize| (bin as f64 * width).exp();
        let points = counts.iter().enumerate().map(|(bin, &count)| [edge(bin), share(count)]).collect();
        let text = |(bin, count): (usize, &usize)| {
            format!("{name}: {count} tets ({:.2} %) with K in {:.3} to {:.3}", share(*count), edge(bin), edge(bin + 1))
        };
        let hover = counts.iter().enumerate().map(text).collect();
        Series { hover, ..Series::new(*name, colour, Style::Steps, points) }
    });
    Chart {
        id: "histogram".into(),
        title: "Tets by their K, before and after".into(),
        x: Axis { logarithmic: true, ..Axis::linear("K") },
        y: Axis::linear("% of the tets"),
        series: series.collect(),
    }
}

fn cumulative(cells: &[CellRow]) -> Chart {
    let series = sorted(cells).into_iter().enumerate().map(|(colour, (name, values))| {
        let last = values.len().saturating_sub(1);
        let count = CURVE_POINTS.min(values.len());
        let ranks = (0..count).map(|index| if count > 1 { index * last / (count - 1) } else { 0 });
        let point = |rank: usize| [values[rank], 100.0 * (rank + 1) as f64 / values.len() as f64];
        let points: Vec<[f64; 2]> = ranks.map(point).filter(|point| point[0].is_finite()).collect();
        let hover = points.iter().map(|[k, share]| format!("{name}: {share:.2} % of the tets have K up to {k:.4}"));
        let hover = hover.collect();
        Series { hover, ..Series::new(name, colour, Style::Line, points) }
    });
    Chart {
        id: "cumulative".into(),
        title: "Share of the tets whose K is at most that".into(),
        x: Axis { logarithmic: true, ..Axis::linear("K") },
        y: Axis::linear("% of the tets"),
        series: series.collect(),
    }
}

fn convergence(trace: &[Row]) -> Chart {
    let series = |name: &str, colour: usize, value: fn(&Row) -> f64| {
        let points = trace.iter().enumerate().map(|(index, row)| [index as f64, value(row)]).collect();
        let hover = trace.iter().map(|row| {
            format!("{}, iteration {}: {name} {}", row.phase, row.iteration, dilatation::number(value(row)))
        });
        Series { hover: hover.collect(), ..Series::new(name, colour, Style::Line, points) }
    };
    let values = trace.iter().flat_map(|row| [row.max_k, row.mean_k]);
    Chart {
        id: "trace".into(),
        title: "The largest and the mean K by iteration".into(),
        x: Axis::linear("iteration, over all phases"),
        y: Axis::logarithmic_beyond(2.0, "K", values),
        series: vec![series("max K", 1, |row| row.max_k), series("mean K", 0, |row| row.mean_k)],
    }
}

/// What a rung of the ladder is, from the bottom up.
const RUNGS: [(&str, usize); 5] = [
    ("quoted, not proved", 5),
    ("proved, of other maps", 4),
    ("proved for this map", 2),
    ("achieved", 1),
    ("start", 0),
];

fn ladder(report: &Value) -> Chart {
    let mut rungs: Vec<(usize, f64, String, String)> = Vec::new();
    for bound in report["bounds"].as_array().into_iter().flatten() {
        let Some(value) = bound["value"].as_f64() else { continue };
        let kind = match (bound["certified"] == true, bound["applies"] == true) {
            (false, _) => 0,
            (true, false) => 1,
            (true, true) => 2,
        };
        let [name, of, scope, reason, source] =
            ["name", "kind", "scope", "reason", "source"].map(|key| bound[key].as_str().unwrap_or("?"));
        let shown = dilatation::lower_bound(value);
        let hover = format!("{name}: {of} >= {shown}<br>{scope}<br>{reason}<br>{source}");
        rungs.push((kind, value, format!("{name} {of} {shown}"), hover));
    }
    let maps =
        [(3, "/final/max_k", "final map"), (4, "/initial/max_k", "start"), (4, "/radial_smooth_k", "radial, smooth")];
    for (kind, pointer, name) in maps {
        if let Some(value) = report.pointer(pointer).and_then(Value::as_f64) {
            let shown = dilatation::number(value);
            rungs.push((kind, value, format!("{name} {shown}"), format!("{name}: largest K {shown}")));
        }
    }
    rungs.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let series = RUNGS.iter().enumerate().filter_map(|(kind, &(name, colour))| {
        let of_kind = || rungs.iter().enumerate().filter(move |(_, rung)| rung.0 == kind);
        let points: Vec<[f64; 2]> = of_kind().map(|(height, rung)| [rung.1, height as f64]).collect();
        let hover = of_kind().map(|(_, rung)| rung.3.clone()).collect();
        (!points.is_empty()).then(|| Series { hover, ..Series::new(name, colour, Style::Bars, points) })
    });
    let series = series.collect();
    let names = rungs.iter().map(|rung| rung.2.clone()).collect();
    Chart {
        id: "bounds".into(),
        title: "Lower bounds, and what the maps reach".into(),
        x: Axis::logarithmic_beyond(50.0, "K", rungs.iter().map(|rung| rung.1)),
        y: Axis { names, ..Axis::default() },
        series,
    }
}

/// What the bars say on hovering, for those who do not hover.
fn bounds_table(report: &Value) -> String {
    let row = |bound: &Value| {
        let [name, of, scope, reason, source] =
            ["name", "kind", "scope", "reason", "source"].map(|key| text(bound[key].as_str().unwrap_or("?")));
        let yes = |key: &str| if bound[key] == true { "yes" } else { "no" };
        format!(
            "<tr><td>{name}</td><td>{of} &ge; {}</td><td>{}</td><td>{}</td><td>{scope}; {reason}</td><td>{source}</td></tr>\n",
            bound["value"].as_f64().map_or_else(|| "?".into(), dilatation::lower_bound),
            yes("certified"),
            yes("applies")
        )
    };
    let rows: String = report["bounds"].as_array().into_iter().flatten().map(row).collect();
    format!(
        "<details><summary>The bounds as a table</summary><div class=\"scroll\" tabindex=\"0\"><table><thead><tr><th>bound</th>\
         <th>value</th><th>proved</th><th>applies</th><th>for which maps</th><th>source</th></tr></thead><tbody>{rows}\
         </tbody></table></div></details>\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bottleneck_of_a_small_solid_has_digits() {
        // A solid some 0.00126 across: four figures take six decimals.
        let report = json!({
            "domain": { "volume": 2e-9 },
            "bottleneck": { "active": 3, "places": 1, "interior": false, "place": { "vertex": 5, "position": [0.00123, 0.0, -1e-9] } }
        });
        let words = bottleneck(&report).unwrap();
        assert!(words.contains("the vertex 5 at (0.001230, 0.000000, 0.000000)"), "{words}");
    }
}

//! The page of a run, from its record, its maps and its trace: those at hand, or those of its files.

use std::path::Path;

use serde::Deserialize;

use super::chart::{Axis, Chart, Series, Style};
use super::page::{Page, chart, paragraph, text};
use super::viewer::{Viewed, viewer};
use super::{PageError, read_text};
use crate::bound::LowerBound;
use crate::dilatation::{lower_bound, number, upper_bound};
use crate::mesh::io::{read_tet_file, read_tets};
use crate::mesh::{Boundary, Place, TetMesh, TopologyError, Unit, Vec3};
use crate::optimize::TraceRow;
use crate::report::findings::CUT_SHORT;
use crate::report::words::{decimals, percent, point};
use crate::report::{CellRow, MapFigures, Report, START, summary};

/// Bins of a histogram of K.
const BINS: usize = 48;
/// Points of a cumulative curve.
const CURVE_POINTS: usize = 300;

/// Relative distance below the largest K within which a tet counts as active.
const ACTIVE: f64 = 1e-3;

/// What a page shows.
pub(super) struct Shown<'a> {
    pub report: &'a Report,
    pub cells: &'a [CellRow],
    pub trace: &'a [TraceRow],
    pub mesh: &'a TetMesh,
    pub boundary: &'a Boundary,
    /// Image positions started from, if they are known.
    pub start: Option<&'a [Vec3]>,
    /// Image positions arrived at.
    pub image: &'a [Vec3],
}

/// The files of a run, read.
pub(super) struct Files {
    report: Report,
    cells: Vec<CellRow>,
    trace: Vec<TraceRow>,
    mesh: TetMesh,
    boundary: Boundary,
    start: Option<Vec<Vec3>>,
    image: Vec<Vec3>,
}

fn rows<T: for<'a> Deserialize<'a>>(path: &Path) -> Result<Vec<T>, PageError> {
    let mut reader = csv::Reader::from_path(path).map_err(|error| PageError::broken(path, error))?;
    reader.deserialize().map(|row| row.map_err(|error| PageError::broken(path, error))).collect()
}

impl Files {
    /// Reads the folder of a run.
    pub(super) fn read(folder: &Path) -> Result<Self, PageError> {
        let record = folder.join("report.json");
        let report: Report =
            serde_json::from_str(&read_text(&record)?).map_err(|error| PageError::broken(&record, error))?;
        let cells: Vec<CellRow> = rows(&folder.join("cells.csv"))?;
        let trace: Vec<TraceRow> = rows(&folder.join("trace.csv"))?;
        let [domain_path, image_path] = ["domain.vtu", "image.vtu"].map(|name| folder.join(name));
        let (domain, image) = (read_tets(&domain_path)?, read_tet_file(&image_path)?);
        let start = image.point_vectors.into_iter().find(|(name, _)| name == START).map(|(_, points)| points);
        let image = image.soup.points;
        if image.len() != domain.points.len() {
            return Err(PageError::broken(&image_path, "it has not as many vertices as domain.vtu"));
        }
        if cells.len() != domain.tets.len() {
            return Err(PageError::broken(&folder.join("cells.csv"), "it has not as many rows as domain.vtu has tets"));
        }
        // The sign of a volume may be out of the range of numbers.
        let unit = Unit::of_extreme(&domain.points);
        let mesh = TetMesh::new(unit.take_points(&domain.points), domain.tets);
        let mesh = mesh.map_err(|error| PageError::broken(&domain_path, error))?.in_unit(unit.inverse());
        let boundary = Boundary::of(&mesh).map_err(|error| PageError::broken(&domain_path, error))?;
        Ok(Self { report, cells, trace, mesh, boundary, start, image })
    }

    pub(super) fn shown(&self) -> Shown<'_> {
        Shown {
            report: &self.report,
            cells: &self.cells,
            trace: &self.trace,
            mesh: &self.mesh,
            boundary: &self.boundary,
            start: self.start.as_deref(),
            image: &self.image,
        }
    }
}

/// Figures of the tets of a run, column by column.
pub(super) struct Columns {
    dilatations: [Vec<f64>; 2],
    start: Vec<f64>,
    active: Vec<bool>,
}

impl Columns {
    pub(super) fn of(cells: &[CellRow]) -> Self {
        let column = |value: fn(&CellRow) -> f64| cells.iter().map(value).collect();
        Self {
            dilatations: [column(|cell| cell.k_inner), column(|cell| cell.k_outer)],
            start: column(|cell| cell.k_initial),
            active: cells.iter().map(|cell| cell.active).collect(),
        }
    }
}

impl Shown<'_> {
    /// What the viewer shows, called `name`.
    pub(super) fn viewed<'a>(&'a self, columns: &'a Columns, name: &'a str) -> Viewed<'a> {
        Viewed {
            name,
            mesh: self.mesh,
            boundary: self.boundary,
            image: self.image,
            start: self.start.map(|start| (start, &columns.start[..])),
            dilatations: [&columns.dilatations[0], &columns.dilatations[1]],
            active: &columns.active,
        }
    }
}

/// A map that no config made, with what is known of it.
#[derive(Clone, Copy, Debug)]
pub struct ShownMap<'a> {
    /// What stands above all.
    pub title: &'a str,
    /// The figures, a sentence.
    pub words: &'a str,
    /// The domain.
    pub mesh: &'a TetMesh,
    /// The image of each vertex.
    pub image: &'a [Vec3],
    /// K_I of each tet.
    pub inner: &'a [f64],
    /// K_O of each tet.
    pub outer: &'a [f64],
    /// The largest proved bound that applies.
    pub best_bound: Option<f64>,
    /// One row an iteration.
    pub trace: &'a [TraceRow],
}

/// The page of such a map, an HTML document that needs no network.
///
/// # Errors
/// A mesh whose boundary is no surface.
pub fn page_of_map(shown: &ShownMap) -> Result<String, TopologyError> {
    let boundary = Boundary::of(shown.mesh)?;
    let k: Vec<f64> = shown.inner.iter().zip(shown.outer).map(|(inner, outer)| inner.max(*outer)).collect();
    let most = k.iter().copied().filter(|k| k.is_finite()).fold(1.0, f64::max);
    let active: Vec<bool> = k.iter().map(|&k| k >= most * (1.0 - ACTIVE)).collect();
    let (view, viewer) = viewer(&[Viewed {
        name: "",
        mesh: shown.mesh,
        boundary: &boundary,
        image: shown.image,
        // What was started from is not known.
        start: None,
        dilatations: [shown.inner, shown.outer],
        active: &active,
    }]);
    let mut sections = vec![("In short".to_string(), paragraph(shown.words)), ("Domain and image".into(), view)];
    let mut charts = Vec::new();
    if !shown.trace.is_empty() {
        charts.push(convergence(shown.trace, shown.best_bound));
        sections.push(("Convergence".into(), chart(&charts[0])));
    }
    Ok(Page { title: shown.title.into(), sections, charts, viewer, ..Page::default() }.to_html())
}

/// The page of a run.
pub(super) fn page(shown: &Shown) -> Page {
    let report = shown.report;
    let before_and_after =
        [("start", sorted(shown.cells, |cell| cell.k_initial)), ("final", sorted(shown.cells, |cell| cell.k))];
    let charts = [
        histogram("Tets by their K, before and after", &before_and_after),
        cumulative(&before_and_after),
        convergence(shown.trace, report.achieved.best.best_bound),
        ladder(report),
    ];
    let columns = Columns::of(shown.cells);
    let (view, viewer) = viewer(&[shown.viewed(&columns, "")]);
    let sections = vec![
        ("In short".into(), cards(report)),
        ("Domain and image".into(), view),
        ("In words".into(), in_words(report)),
        (
            "Dilatations before and after".into(),
            format!("<div class=\"pair\">{}{}</div>\n", chart(&charts[0]), chart(&charts[1])),
        ),
        ("Convergence".into(), chart(&charts[2])),
        ("Bounds".into(), chart(&charts[3]) + &bounds_table(&report.achieved.bounds)),
    ];
    Page { title: format!("qcball: {}", report.name), sections, charts: charts.into(), viewer, ..Page::default() }
}

/// The figures that are asked for first.
fn cards(report: &Report) -> String {
    let gap = report.achieved.best.gap.map(upper_bound);
    let bound = report.achieved.best.best_bound.map(lower_bound);
    let onto_ball = report.achieved.last.ball_k.map(|k| upper_bound(k.certified));
    let none = || "none".to_string();
    let cards = [
        ("largest K", number(report.achieved.last.max_k)),
        ("mean K", number(report.achieved.last.mean_k)),
        ("99 % of tets have K up to", number(report.achieved.last.p99_k)),
        ("best proved bound", bound.unwrap_or_else(none)),
        ("gap", gap.unwrap_or_else(none)),
        ("K onto the ball, at most", onto_ball.unwrap_or_else(none)),
        ("bijective", if report.bijective { "yes" } else { "no" }.into()),
    ];
    let cards: String =
        cards.iter().map(|(name, value)| format!("<div><dt>{name}</dt><dd>{}</dd></div>", text(value))).collect();
    format!("<dl class=\"cards\">{cards}</dl>\n")
}

fn in_words(report: &Report) -> String {
    let gap = report.achieved.best.gap.map(upper_bound);
    let bound = report.achieved.best.best_bound.map(lower_bound);
    let (ball, onto_ball) = (&report.achieved.ball, report.achieved.last.ball_k.map(|k| upper_bound(k.certified)));
    let mut words = format!(
        "A mesh of {tets} tets and {vertices} vertices ({solid}) was mapped {start} to the final one the largest K went from \
         {} to {} and the mean K from {} to {}, in {} iteration{}.",
        number(report.achieved.initial.max_k),
        number(report.achieved.last.max_k),
        number(report.achieved.initial.mean_k),
        number(report.achieved.last.mean_k),
        report.achieved.iterations,
        if report.achieved.iterations == 1 { "" } else { "s" },
        start = start_in_words(&report.map),
        solid = report.domain.solid,
        tets = report.domain.tets,
        vertices = report.domain.vertices,
    );
    if let Some(bound) = bound {
        words += &format!(" It is proved that no map of this mesh with this boundary has a largest K below {bound}");
        words += &gap.map_or_else(|| ".".into(), |gap| format!(": the map is within a factor of {gap}."));
    }
    if let (Some(k), Some(share)) = (onto_ball, ball.ball_fraction) {
        words += &format!(
            " The image fills {} of the ball. Followed by the radial map of this polyhedron, it is a map onto the ball whose K is at \
             most {k}{}",
            percent(share),
            if report.achieved.last.ball_k.is_some_and(|k| k.cut_short) { CUT_SHORT } else { "" }
        );
        let bracket = ball.ball_bound.zip(ball.ball_gap).map(|(bound, gap)| {
            let [bound, gap] = [lower_bound(bound), upper_bound(gap)];
            format!("; no quasi-conformal map of the solid onto the ball has a K below {bound}, a factor of {gap}")
        });
        words += &format!("{}.", bracket.unwrap_or_default());
    }
    let mut html = paragraph(&words);
    let known = if report.bijective { "" } else { "not known to be " };
    html += &paragraph(&format!("The map is {known}bijective: {}.", report.bijective_reason));
    html += &paragraph(&format!("{}.", capital(&report.achieved.limit.sentence)));
    html += &bottleneck(report).map(|place| paragraph(&place)).unwrap_or_default();
    for warning in &report.warnings {
        html += &format!("<p class=\"warning\">Warning: {}</p>\n", text(warning));
    }
    html + &format!(
        "<details><summary>The whole summary</summary><pre tabindex=\"0\">{}</pre></details>\n\
         <details><summary>The config</summary><pre tabindex=\"0\">{}</pre></details>\n<p class=\"small\">qcball {}, revision {}, config {}, \
         seed {}</p>\n",
        text(&summary(report)),
        text(&report.config_text),
        text(&report.version),
        text(&report.revision),
        text(&report.config),
        report.seed
    )
}

/// Where the map started from goes, and which it is: only maps about a star centre have the closed form of the smooth radial map.
fn start_in_words(map: &MapFigures) -> String {
    match (map.radial_exponent, map.radial_smooth_k) {
        (Some(_), Some(_)) => "onto the unit ball. From the radial map".to_string(),
        (None, _) if map.boundary_map.is_some() => format!("onto the unit ball. From the map \"{}\"", map.map),
        (Some(_), None) => format!("onto the unit ball. From the map \"{}\"", map.map),
        // Maps in closed form go onto images of their own.
        (None, _) => format!("by the map \"{}\", whose values at the boundary were kept. From this map", map.map),
    }
}

fn capital(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().map(|first| first.to_uppercase().chain(letters).collect()).unwrap_or_default()
}

fn bottleneck(report: &Report) -> Option<String> {
    let bottleneck = report.bottleneck.as_ref()?;
    let decimals = decimals(report.domain.volume);
    let kind = match bottleneck.place {
        Place::Vertex { .. } => "vertex",
        Place::Edge { .. } => "edge",
        Place::Face { .. } => "face",
    };
    let vertices: Vec<String> = bottleneck.place.vertices().iter().map(u32::to_string).collect();
    let count = bottleneck.places;
    let others = if count > 1 { format!(", one of {count} such places") } else { String::new() };
    let inside = if bottleneck.interior { "inside the solid, nearest to" } else { "at" };
    let marked = match (bottleneck.interior, count) {
        (true, _) => "The first of them is",
        (false, 1) => "It is",
        (false, _) => "All are",
    };
    Some(format!(
        "The bottleneck: {} a K within 0.1 % of the largest, {inside} the {kind} {} at {}{others}. {marked} marked in the viewer.",
        if bottleneck.active == 1 { "1 tet has".into() } else { format!("{} tets have", bottleneck.active) },
        vertices.join("-"),
        point(bottleneck.place.position(), decimals)
    ))
}

/// A column of cells, sorted.
pub(super) fn sorted(cells: &[CellRow], value: fn(&CellRow) -> f64) -> Vec<f64> {
    let mut values: Vec<f64> = cells.iter().map(value).collect();
    values.sort_unstable_by(f64::total_cmp);
    values
}

/// Histograms of sorted values of K, each with its name.
pub(super) fn histogram(title: &str, columns: &[(&str, Vec<f64>)]) -> Chart {
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
        title: title.into(),
        x: Axis { logarithmic: true, ..Axis::linear("K") },
        y: Axis::linear("% of the tets"),
        series: series.collect(),
    }
}

/// Which share of sorted values of K is at most how much, of each with its name.
pub(super) fn cumulative(columns: &[(&str, Vec<f64>)]) -> Chart {
    let series = columns.iter().enumerate().map(|(colour, (name, values))| {
        let last = values.len().saturating_sub(1);
        let count = CURVE_POINTS.min(values.len());
        let ranks = (0..count).map(|index| if count > 1 { index * last / (count - 1) } else { 0 });
        let point = |rank: usize| [values[rank], 100.0 * (rank + 1) as f64 / values.len() as f64];
        let points: Vec<[f64; 2]> = ranks.map(point).filter(|point| point[0].is_finite()).collect();
        let hover = points.iter().map(|[k, share]| format!("{name}: {share:.2} % of the tets have K up to {k:.4}"));
        let hover = hover.collect();
        Series { hover, ..Series::new(*name, colour, Style::Line, points) }
    });
    Chart {
        id: "cumulative".into(),
        title: "Share of the tets whose K is at most that".into(),
        x: Axis { logarithmic: true, ..Axis::linear("K") },
        y: Axis::linear("% of the tets"),
        series: series.collect(),
    }
}

fn convergence(trace: &[TraceRow], best_bound: Option<f64>) -> Chart {
    let series = |name: &str, colour: usize, value: fn(&TraceRow) -> f64| {
        let points = trace.iter().enumerate().map(|(index, row)| [index as f64, value(row)]).collect();
        let hover = trace
            .iter()
            .map(|row| format!("{}, iteration {}: {name} {}", row.phase, row.iteration, number(value(row))));
        Series { hover: hover.collect(), ..Series::new(name, colour, Style::Line, points) }
    };
    let values = trace.iter().flat_map(|row| [row.max_k, row.mean_k]);
    let mut all = vec![series("max K", 1, |row| row.max_k), series("mean K", 0, |row| row.mean_k)];
    let starts = || trace.iter().enumerate().filter(|&(at, row)| at == 0 || trace[at - 1].phase != row.phase);
    all.push(Series {
        hover: starts().map(|(_, row)| format!("phase {} begins", row.phase)).collect(),
        ..Series::new("phases", 5, Style::Points, starts().map(|(at, row)| [at as f64, row.max_k]).collect())
    });
    if let Some(bound) = best_bound {
        let points = vec![[0.0, bound], [trace.len().saturating_sub(1) as f64, bound]];
        let hover =
            vec![format!("no map of this mesh with this boundary has a largest K below {}", lower_bound(bound)); 2];
        all.push(Series { hover, ..Series::new("best bound", 2, Style::Line, points) });
    }
    Chart {
        id: "trace".into(),
        title: "The largest and the mean K by iteration".into(),
        x: Axis::linear("iteration, over all phases"),
        y: Axis::logarithmic_beyond(2.0, "K", values),
        series: all,
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

fn ladder(report: &Report) -> Chart {
    let mut rungs: Vec<(usize, f64, String, String)> = Vec::new();
    for bound in &report.achieved.bounds {
        let kind = match (bound.certified, bound.applies) {
            (false, _) => 0,
            (true, false) => 1,
            (true, true) => 2,
        };
        let LowerBound { name, source, kind: of, value, scope, reason, .. } = bound;
        let (of, shown) = (of.symbol(), lower_bound(*value));
        let hover = format!("{name}: {of} >= {shown}<br>{}<br>{reason}<br>{source}", scope.in_words());
        rungs.push((kind, *value, format!("{name} {of} {shown}"), hover));
    }
    let maps = [
        (3, Some(report.achieved.last.max_k), "final map"),
        (4, Some(report.achieved.initial.max_k), "start"),
        (4, report.map.radial_smooth_k, "radial, smooth"),
    ];
    for (kind, value, name) in maps {
        if let Some(value) = value.filter(|value| value.is_finite()) {
            let shown = number(value);
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
fn bounds_table(bounds: &[LowerBound]) -> String {
    let row = |bound: &LowerBound| {
        let [name, scope, reason, source] =
            [bound.name.as_str(), bound.scope.in_words(), bound.reason.as_str(), bound.source].map(text);
        let yes = |yes: bool| if yes { "yes" } else { "no" };
        format!(
            "<tr><td>{name}</td><td>{} &ge; {}</td><td>{}</td><td>{}</td><td>{scope}; {reason}</td><td>{source}</td></tr>\n",
            bound.kind.symbol(),
            lower_bound(bound.value),
            yes(bound.certified),
            yes(bound.applies)
        )
    };
    let rows: String = bounds.iter().map(row).collect();
    format!(
        "<details><summary>The bounds as a table</summary><div class=\"scroll\" tabindex=\"0\"><table><thead><tr><th>bound</th>\
         <th>value</th><th>proved</th><th>applies</th><th>for which maps</th><th>source</th></tr></thead><tbody>{rows}\
         </tbody></table></div></details>\n"
    )
}

//! What a person reads of a run in a terminal.

use super::{
    Achieved, BallFigures, BestBound, CornerFigures, DistortionFigures, DomainFigures, Limit, MapFigures, MapReport,
    RefinedFigures, RefinementFigures, Report, Splits, Times, UntanglingFigures,
};
use crate::bound::{Kind, LowerBound, Scope};
use crate::dilatation::{lower_bound, number, upper_bound};
use crate::measure::{BallDilatation, Bottleneck, Summary};
use crate::mesh::Place;
use crate::mesh::io::on_one_line;
use crate::optimize::StopReason;
use crate::refine::RefineEnd;

/// The width that a text is wrapped to.
const COLUMNS: usize = 80;
/// The share of the ball from which on an image passes for one.
const FULL: f64 = 0.9;
/// K onto the ball over K beyond which the image is too coarse somewhere for K to say much of a map onto the ball; surfaces that are refined
/// by themselves end at 1.25 or little more.
const COARSE: f64 = 3.0;
/// The final largest K over that of the start beyond which a reader is told: more than the polish may spend.
const RISEN: f64 = 1.001;
/// What may help tets that resist untangling.
const REFINE: &str = "refine the mesh there";

/// The report in words and aligned numbers, some 80 columns wide, without colour and without anything that differs from one
/// run to the next.
pub fn summary(report: &Report) -> String {
    let domain = &report.domain;
    let decimals = decimals(domain.volume);
    let centre = domain.centre.map(|position| {
        let radius =
            domain.kernel_radius.map(|r| format!(", kernel radius {}", length(r, decimals))).unwrap_or_default();
        let angle = domain.smallest_angle.map(|a| format!(", rays meet faces at {a:.2} degrees or more"));
        format!("{}{radius}{}", point(position, decimals), angle.unwrap_or_default())
    });
    let mesh = format!(
        "{} vertices ({} on the boundary), {} tets ({} locked), smallest dihedral angle {:.2} degrees",
        domain.vertices, domain.boundary_vertices, domain.tets, domain.locked, domain.smallest_dihedral_angle
    );
    let bijective = format!("{}: {}", if report.bijective { "yes" } else { "no" }, report.bijective_reason);
    let remedy = if domain.centre.is_some() { "refine the mesh there, or move the star centre" } else { REFINE };
    let blocks = [
        labelled("run", &format!("{} ({})", report.name, command_in_words(report))),
        coarse_warning(&report.achieved.ball, &report.achieved.last),
        labelled("solid", &domain.solid),
        centre.map(|centre| labelled("centre", &centre)).unwrap_or_default(),
        labelled("mesh", &mesh),
        report.refinement.map(|refinement| refinement_in_words(refinement, domain)).unwrap_or_default(),
        report.achieved.splits.map(splits_in_words).unwrap_or_default(),
        map_in_words(&report.map).map(|map| labelled("map", &map)).unwrap_or_default(),
        report.corners.as_ref().map(|corners| labelled("corners", &corners_in_words(corners))).unwrap_or_default(),
        format!("\n{}\n", dilatations(&[("start", &report.achieved.initial), ("final", &report.achieved.last)])),
        report
            .achieved
            .untangling
            .as_ref()
            .map(|u| labelled("untangled", &untangling_in_words(u, remedy)))
            .unwrap_or_default(),
        report
            .bottleneck
            .as_ref()
            .map(|b| labelled("bottleneck", &bottleneck_in_words(b, decimals)))
            .unwrap_or_default(),
        refined_line(&report.achieved),
        report.distortion.map(|distortion| distortion_in_words(distortion, report)).unwrap_or_default(),
        labelled("bijective", &bijective),
        labelled("stopped", &stop_in_words(report.achieved.stop, report.achieved.iterations)),
        risen_warning(&report.achieved),
        format!("\n{}", bounds_in_short(&report.achieved)),
        ball_lines(&report.achieved.ball, Some(&report.achieved.initial), &report.achieved.last),
        report.warnings.iter().map(|warning| labelled("warning", warning)).collect(),
    ];
    blocks.concat()
}

/// A map in closed form, or one made from the boundary; the radial ones go without saying.
fn map_in_words(map: &MapFigures) -> Option<String> {
    if map.radial_exponent.is_some() {
        return None;
    }
    let most = map
        .closed_form_k
        .map(|k| format!("; its own K, before any mesh, is at most {}", upper_bound(k)))
        .unwrap_or_default();
    let stretch = map.boundary_map.map(|distortion| {
        let (most, mean) = (number(distortion.max_stretch), number(distortion.mean_stretch));
        format!("; on the boundary s1/s2 is at most {most}, {mean} in the mean")
    });
    Some(format!("{}{most}{}", map.map, stretch.unwrap_or_default()))
}

fn refinement_in_words(refinement: RefinementFigures, domain: &DomainFigures) -> String {
    let text = format!(
        "the surface's {} triangles were halved until there were {} and the radial map of the image onto the ball had K <= {}, \
         which took {} tets; mesh.subdivisions, cells or edge_length ask for another surface",
        refinement.triangles_before,
        domain.boundary_triangles,
        upper_bound(refinement.largest_stretch),
        domain.tets
    );
    labelled("", &text)
}

/// How the map behaves at the corners.
fn corners_in_words(corners: &[CornerFigures]) -> String {
    let exponents = || corners.iter().map(|corner| corner.exponent);
    let (least, most) = (exponents().fold(f64::INFINITY, f64::min), exponents().fold(0.0, f64::max));
    let of = if format!("{least:.4}") == format!("{most:.4}") {
        format!("p = {least:.4}")
    } else {
        format!("p from {least:.4} to {most:.4}")
    };
    let count = corners.len();
    format!("like r^p of the distance r from {count} corner{}, {of}; K is the largest in each tet", s(count))
}

fn distortion_in_words(distortion: DistortionFigures, report: &Report) -> String {
    let text = format!(
        "K has the mean {} and the standard deviation {}; the ratio of volumes, each as a part of the whole, {} and {}, its logarithm \
         the deviation {}",
        number(report.achieved.last.mean_k),
        number(distortion.k_deviation),
        number(distortion.mean_volume_ratio),
        number(distortion.volume_ratio_deviation),
        number(distortion.log_volume_ratio_deviation)
    );
    labelled("distortion", &text)
}

fn splits_in_words(splits: Splits) -> String {
    let collar = match splits.collar {
        0 => String::new(),
        edges => format!(", and {edges} edge{} next to the boundary for the collar", s(edges)),
    };
    let text = format!(
        "{} interior edge{} and {} interior face{} between boundary vertices were split, so that no tet is locked{collar}; the \
         mesh had {} tet{} (--keep-mesh leaves a given one as it is)",
        splits.edges,
        s(splits.edges),
        splits.faces,
        s(splits.faces),
        splits.tets_before,
        s(splits.tets_before)
    );
    labelled("", &text)
}

/// What refinement where the largest K sits came to.
fn refined_line(achieved: &Achieved) -> String {
    let Some(RefinedFigures { tets_before, end, rounds }) = &achieved.refined else { return String::new() };
    let why = match end {
        RefineEnd::BoundaryValues => "the boundary values allow hardly less, on any mesh inside",
        RefineEnd::Stalled => "the last rounds gained too little",
        RefineEnd::Budget => "the next round would add more tets than refine.tets allows",
        RefineEnd::Rounds => "these were all that refine.rounds asks for",
        RefineEnd::NoEdge => "no tet that holds K has an edge left to halve",
        RefineEnd::NotSettled => "the map was not settled",
    };
    let added = rounds.last().map_or(0, |round| round.tets - tets_before);
    let reached = match (rounds.first(), rounds.last()) {
        (Some(first), Some(last)) => {
            format!(", max K {} after the first, {} after the last", number(first.max_k), number(last.max_k))
        }
        _ => String::new(),
    };
    let share = percent(added as f64 / *tets_before as f64);
    let count = rounds.len();
    let text =
        format!("{count} round{} where K sits, {added} tet{} added ({share}){reached}; {why}", s(count), s(added));
    labelled("refined", &text)
}

fn untangling_in_words(untangling: &UntanglingFigures, remedy: &str) -> String {
    let mut steps = format!(
        "{} flipped at the start, {} step{}",
        untangling.flipped_before,
        untangling.iterations,
        s(untangling.iterations)
    );
    if untangling.refinement_splits > 0 {
        let splits = untangling.refinement_splits;
        steps += &format!(", {splits} interior edge{} halved where tets resisted", s(splits));
    }
    if untangling.resisting.is_empty() {
        return steps;
    }
    let list = |ids: Vec<u32>| {
        let more = if ids.len() > 8 { ", ..." } else { "" };
        ids.iter().take(8).map(u32::to_string).collect::<Vec<_>>().join(", ") + more
    };
    let common = if untangling.common_vertices.is_empty() {
        String::new()
    } else {
        format!(" (common vertices: {})", list(untangling.common_vertices.iter().map(|v| v.0).collect()))
    };
    format!(
        "{steps}; {} tet{} left flipped: {}{common}; {remedy}",
        untangling.resisting.len(),
        s(untangling.resisting.len()),
        list(untangling.resisting.iter().map(|t| t.0).collect())
    )
}

/// The same for an optimized map of two given meshes.
pub fn map_summary(report: &MapReport) -> String {
    let mesh = format!(
        "{} vertices ({} fixed), {} tets ({} locked)",
        report.vertices, report.fixed, report.tets, report.locked
    );
    let bounds = if report.achieved.bounds.is_empty() {
        labelled("bounds", "none: not every boundary vertex is fixed")
    } else {
        bounds_table(&report.achieved.bounds, report.achieved.best, &report.achieved.limit)
    };
    let blocks = [
        coarse_warning(&report.achieved.ball, &report.achieved.last),
        labelled("mesh", &mesh),
        report.achieved.splits.map(splits_in_words).unwrap_or_default(),
        format!("\n{}\n", dilatations(&[("start", &report.achieved.initial), ("final", &report.achieved.last)])),
        report
            .achieved
            .untangling
            .as_ref()
            .map(|u| labelled("untangled", &untangling_in_words(u, REFINE)))
            .unwrap_or_default(),
        refined_line(&report.achieved),
        labelled(
            "active",
            &format!("{} tet{} within 0.1 % of the max K", report.achieved.active, s(report.achieved.active)),
        ),
        labelled("stopped", &stop_in_words(report.achieved.stop, report.achieved.iterations)),
        risen_warning(&report.achieved),
        time_line(report.achieved.times),
        format!("\n{bounds}"),
        ball_lines(&report.achieved.ball, Some(&report.achieved.initial), &report.achieved.last),
    ];
    blocks.concat()
}

/// How long a run took, as a line to follow its [`summary`].
pub fn time_line(times: Times) -> String {
    labelled("time", &format!("{:.1} s on {} thread{}", times.seconds, times.threads, s(times.threads)))
}

/// The config with its overrides, as they were typed.
fn command_in_words(report: &Report) -> String {
    let overrides: String = report.overrides.iter().map(|assignment| format!(" --set {assignment}")).collect();
    report.config.clone() + &overrides
}

/// A label and its text, wrapped between words.
fn labelled(label: &str, text: &str) -> String {
    const INDENT: usize = 12;
    let mut lines = format!("{label:<INDENT$}");
    let mut column = INDENT;
    // Names of files and overrides are among the words.
    for (index, word) in on_one_line(text).split(' ').enumerate() {
        let width = word.chars().count();
        if index > 0 && column + 1 + width > COLUMNS {
            lines.push_str(&format!("\n{:INDENT$}", ""));
            column = INDENT;
        } else if index > 0 {
            lines.push(' ');
            column += 1;
        }
        lines.push_str(word);
        column += width;
    }
    lines + "\n"
}

/// A table of dilatations, one row a map.
pub(crate) fn dilatations(maps: &[(&str, &Summary)]) -> String {
    let mut text = format!(
        "{:<8}{:>10}{:>10}{:>10}{:>10}{:>10}{:>10}{:>9}\n",
        "", "max K", "mean K", "median K", "99 % K", "max K_I", "max K_O", "flipped"
    );
    for (name, map) in maps {
        let numbers = [map.max_k, map.mean_k, map.p50_k, map.p99_k, map.max_k_inner, map.max_k_outer];
        let numbers: String = numbers.into_iter().map(|x| format!("{:>10}", number(x))).collect();
        text.push_str(&format!("{name:<8}{numbers}{:>9}\n", map.flipped));
    }
    text
}

/// What goes before all else where the image is far from a ball.
fn coarse_warning(ball: &BallFigures, last: &Summary) -> String {
    let is_coarse = |(fraction, k): &(f64, BallDilatation)| *fraction < FULL || k.certified > COARSE * last.max_k;
    let Some((fraction, k)) = ball.ball_fraction.zip(last.ball_k).filter(is_coarse) else {
        return String::new();
    };
    let text = format!(
        "the image is a polyhedron that fills {} of the ball: K speaks of the map onto this polyhedron, K onto the ball is at \
         most {}; a finer surface, as by mesh.edge_length, comes nearer",
        percent(fraction),
        upper_bound(k.certified)
    );
    labelled("warning", &text)
}

/// A share, rounded down.
pub(super) fn percent(share: f64) -> String {
    format!("{:.2} %", (share * 1e4).floor() / 100.0)
}

/// K onto the ball, and what is known of the least K of all maps of the solid onto the ball.
pub(crate) fn ball_lines(ball: &BallFigures, start: Option<&Summary>, last: &Summary) -> String {
    let Some((fraction, k)) = ball.ball_fraction.zip(last.ball_k) else {
        let reason = ball.ball_reason.as_deref().unwrap_or("it was not computed");
        return labelled("onto ball", &format!("no K onto the ball: {reason}"));
    };
    let start = start.and_then(|start| start.ball_k);
    let start = start.map(|k| format!(" (start {})", upper_bound(k.certified))).unwrap_or_default();
    let text = format!(
        "K onto the ball <= {}{start}, of the map followed by the radial map of its image, which fills {} of the ball",
        upper_bound(k.certified),
        percent(fraction)
    );
    let bracket = ball.ball_bound.zip(ball.ball_gap).map(|(bound, gap)| {
        let text = format!(
            "{} <= K <= {} for the best quasi-conformal map of the solid onto the ball, a factor of {}",
            lower_bound(bound),
            upper_bound(k.certified),
            upper_bound(gap)
        );
        labelled("bracket", &text)
    });
    labelled("onto ball", &text) + &bracket.unwrap_or_default()
}

/// The same of a run, with those that do not apply counted only, if any does.
fn bounds_in_short(achieved: &Achieved) -> String {
    let Achieved { bounds, best, limit, .. } = achieved;
    let (applying, others): (Vec<LowerBound>, Vec<LowerBound>) =
        bounds.iter().cloned().partition(|bound| bound.applies);
    if applying.is_empty() || others.is_empty() {
        return bounds_table(bounds, *best, limit);
    }
    let count = others.len();
    let does = if count == 1 { "does" } else { "do" };
    let others = format!("{count} more {does} not apply to this map; report.json tells why");
    bounds_list(&applying) + &labelled("", &others) + &best_and_limit(*best, limit)
}

/// The bounds, those that apply and the largest first, what the best of them says, and what limits K.
pub(crate) fn bounds_table(bounds: &[LowerBound], best: BestBound, limit: &Limit) -> String {
    bounds_list(bounds) + &best_and_limit(best, limit)
}

fn best_and_limit(best: BestBound, limit: &Limit) -> String {
    labelled("best bound", &best_in_words(best)) + &labelled("limit", &limit.sentence)
}

fn bounds_list(bounds: &[LowerBound]) -> String {
    let mut bounds: Vec<&LowerBound> = bounds.iter().collect();
    bounds.sort_by(|a, b| b.applies.cmp(&a.applies).then(b.value.total_cmp(&a.value)));
    let mut text = format!("{:<18}{:>16}  {:<20}applies\n", "lower bound", "value", "for which maps");
    for bound in bounds {
        let kind = match bound.kind {
            Kind::Inner => "K_I >=",
            Kind::Outer => "K_O >=",
            Kind::K => "K >=",
        };
        let applies = if bound.applies { "yes" } else { "no" };
        let quoted = if bound.certified { "" } else { ", not proved" };
        text.push_str(&format!(
            "{:<18}{kind:>6}{:>10}  {:<20}{applies}{quoted}\n",
            bound.name,
            lower_bound(bound.value),
            scope_in_short(bound.scope)
        ));
        if !bound.applies {
            text.push_str(&labelled("", &bound.reason));
        }
    }
    text
}

/// What is said where the largest K is not what was lowered.
fn risen_warning(achieved: &Achieved) -> String {
    let (start, last) = (achieved.initial.max_k, achieved.last.max_k);
    if last <= RISEN * start {
        return String::new();
    }
    let text = format!(
        "the largest K rose from the start's {} to {}: a soft maximum weighs it against all other tets, and a large optimize.rise \
         against the mean; optimize.objective = \"max\" lowers it",
        number(start),
        number(last)
    );
    labelled("warning", &text)
}

fn best_in_words(best: BestBound) -> String {
    match (best.best_bound, best.gap) {
        (Some(bound), Some(gap)) => {
            format!("K >= {}; the map is within a factor of {} of it", lower_bound(bound), upper_bound(gap))
        }
        (Some(bound), None) => format!("K >= {}; the map has no finite K to compare", lower_bound(bound)),
        (None, _) => "none applies to this map, so no gap is known".into(),
    }
}

fn scope_in_short(scope: Scope) -> &'static str {
    match scope {
        Scope::Shape => "all of the solid",
        Scope::ShapeFixedTrace => "with radial trace",
        Scope::MeshFixedBoundary => "PL on this mesh",
    }
}

fn s(count: usize) -> &'static str {
    if count == 1 { "" } else { "s" }
}

fn bottleneck_in_words(bottleneck: &Bottleneck, decimals: Option<usize>) -> String {
    let point = |coordinates: &[f64; 3]| point(*coordinates, decimals);
    let (place, kind) = match &bottleneck.place {
        Place::Vertex { vertex, position } => (format!("vertex {vertex} at {}", point(position)), "corners"),
        Place::Edge { vertices: [a, b], midpoint } => {
            (format!("the edge {a}-{b} around {}", point(midpoint)), "pieces of sharp edges")
        }
        Place::Face { vertices: [a, b, c], centroid } => {
            (format!("the triangle {a}-{b}-{c} around {}", point(centroid)), "boundary triangles")
        }
    };
    let cells = format!("{} tet{} within 0.1 % of the max K", bottleneck.active, s(bottleneck.active));
    match bottleneck {
        Bottleneck { interior: true, .. } => format!("{cells}, inside the solid, nearest to {place}"),
        Bottleneck { places: 1, .. } => format!("{cells}, at {place}"),
        Bottleneck { places, .. } => format!("{cells}, at {places} {kind}, such as {place}"),
    }
}

/// Decimals of a length in a solid of this volume (in its units cubed): four, and in small units as many as four figures of
/// the solid's size take; none where a power of ten is easier to read, or the volume out of the range of numbers.
pub(super) fn decimals(volume: f64) -> Option<usize> {
    (1e-36..1e36).contains(&volume).then(|| 4 + (-volume.cbrt().log10().ceil()).max(0.0) as usize)
}

/// A length in the domain; no `-0.0000`, which another order of sums would turn into `0.0000`.
fn length(x: f64, decimals: Option<usize>) -> String {
    let Some(decimals) = decimals else { return format!("{:.4e}", x + 0.0) };
    let text = format!("{x:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.bytes().all(|byte| matches!(byte, b'0' | b'.')) => digits.to_owned(),
        _ => text,
    }
}

/// A point in the domain.
pub(super) fn point(coordinates: [f64; 3], decimals: Option<usize>) -> String {
    let [x, y, z] = coordinates.map(|x| length(x, decimals));
    format!("({x}, {y}, {z})")
}

fn stop_in_words(stop: StopReason, iterations: usize) -> String {
    let (why, remedy) = match stop {
        StopReason::Optimal => ("the largest K is at a stationary point (KKT residual at most 1e-6)", ""),
        StopReason::Converged => ("converged", ""),
        StopReason::IterationLimit => ("iteration limit reached", "; a higher one may lower K further"),
        StopReason::TimeLimit => ("time limit reached", "; a longer one may lower K further"),
        StopReason::Cancelled => ("cancelled", "; this is the best map so far"),
        StopReason::NoProgress => ("no step lowered the objective", ""),
        StopReason::NothingFree => ("no vertex is free to move", "; refine the mesh inside"),
        StopReason::StillFlipped => ("tets of the start resisted untangling; nothing was optimized", ""),
    };
    format!("{why} after {iterations} iteration{}{remedy}", s(iterations))
}

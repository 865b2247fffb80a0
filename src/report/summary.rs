//! What a person reads of a run in a terminal.

use super::findings::{ball_lines, best_and_limit, bounds_in_short, bounds_list, coarse_warning};
use super::words::{COLUMNS, decimals, dilatations, labelled, length, percent, point};
use super::{
    Achieved, CornerFigures, DistortionFigures, DomainFigures, MapFigures, MapReport, RefinedFigures,
    RefinementFigures, Report, Splits, Times, UntanglingFigures,
};
use crate::dilatation::{number, upper_bound};
use crate::measure::Bottleneck;
use crate::mesh::Place;
use crate::optimize::StopReason;
use crate::refine::RefineEnd;

/// The final largest K over that of the start beyond which a reader is told: more than the polish may spend.
const RISEN: f64 = 1.001;
/// The largest K before refinement over that after it below which it counts as nothing gained: the polish may spend as much.
const GAINED: f64 = 1.001;
/// What may help tets that resist untangling.
const REFINE: &str = "refine the mesh there";

/// The report in words and aligned numbers, [`COLUMNS`] wide, without colour and without anything that differs from one run to
/// the next.
pub fn summary(report: &Report) -> String {
    summary_within(report, COLUMNS)
}

/// The same for a terminal of so many columns; below 40 some lines are wider.
pub fn summary_within(report: &Report, columns: usize) -> String {
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
        labelled(columns, "run", &format!("{} ({})", report.name, command_in_words(report))),
        coarse_warning(columns, &report.achieved.ball, &report.achieved.last),
        labelled(columns, "solid", &domain.solid),
        centre.map(|centre| labelled(columns, "centre", &centre)).unwrap_or_default(),
        labelled(columns, "mesh", &mesh),
        report.refinement.map(|refinement| refinement_in_words(columns, refinement, domain)).unwrap_or_default(),
        report.achieved.splits.map(|splits| splits_in_words(columns, splits)).unwrap_or_default(),
        map_in_words(&report.map).map(|map| labelled(columns, "map", &map)).unwrap_or_default(),
        report
            .corners
            .as_ref()
            .map(|corners| labelled(columns, "corners", &corners_in_words(corners)))
            .unwrap_or_default(),
        format!(
            "\n{}\n",
            dilatations(columns, &[("start", &report.achieved.initial), ("final", &report.achieved.last)])
        ),
        report
            .achieved
            .untangling
            .as_ref()
            .map(|u| labelled(columns, "untangled", &untangling_in_words(u, report.achieved.stop, remedy)))
            .unwrap_or_default(),
        report
            .bottleneck
            .as_ref()
            .map(|b| labelled(columns, "bottleneck", &bottleneck_in_words(b, decimals)))
            .unwrap_or_default(),
        refined_line(columns, &report.achieved),
        report.distortion.map(|distortion| distortion_in_words(columns, distortion, report)).unwrap_or_default(),
        labelled(columns, "bijective", &bijective),
        labelled(columns, "stopped", &stop_in_words(&report.achieved)),
        risen_warning(columns, &report.achieved),
        format!("\n{}", best_and_limit(columns, report.achieved.best, &report.achieved.limit)),
        ball_lines(columns, &report.achieved.ball, Some(&report.achieved.initial), &report.achieved.last),
        format!("\n{}", bounds_in_short(columns, &report.achieved)),
        report.warnings.iter().map(|warning| labelled(columns, "warning", warning)).collect(),
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

fn refinement_in_words(columns: usize, refinement: RefinementFigures, domain: &DomainFigures) -> String {
    let text = format!(
        "the surface's {} triangles were halved until there were {} and the radial map of the image onto the ball had K <= {}, \
         which took {} tets; mesh.subdivisions, cells or edge_length ask for another surface",
        refinement.triangles_before,
        domain.boundary_triangles,
        upper_bound(refinement.largest_stretch),
        domain.tets
    );
    labelled(columns, "", &text)
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

fn distortion_in_words(columns: usize, distortion: DistortionFigures, report: &Report) -> String {
    let text = format!(
        "K has the mean {} and the standard deviation {}; the ratio of volumes, each as a part of the whole, {} and {}, its logarithm \
         the deviation {}",
        number(report.achieved.last.mean_k),
        number(distortion.k_deviation),
        number(distortion.mean_volume_ratio),
        number(distortion.volume_ratio_deviation),
        number(distortion.log_volume_ratio_deviation)
    );
    labelled(columns, "distortion", &text)
}

fn splits_in_words(columns: usize, splits: Splits) -> String {
    let collar = match splits.collar {
        0 => String::new(),
        edges => format!(", and {edges} edge{} next to the boundary for the collar", s(edges)),
    };
    let corners = match splits.corners {
        0 => String::new(),
        edges => format!(", {edges} edge{} between corners so that no tet has two", s(edges)),
    };
    let text = format!(
        "{} interior edge{} and {} interior face{} between boundary vertices were split, so that no tet is locked{corners}{collar}; the \
         mesh had {} tet{} (--keep-mesh leaves a given one as it is)",
        splits.edges,
        s(splits.edges),
        splits.faces,
        s(splits.faces),
        splits.tets_before,
        s(splits.tets_before)
    );
    labelled(columns, "", &text)
}

/// What refinement where the largest K sits came to.
fn refined_line(columns: usize, achieved: &Achieved) -> String {
    let Some(RefinedFigures { tets_before, surface, max_k_before, end, rounds }) = &achieved.refined else {
        return String::new();
    };
    let why = match end {
        RefineEnd::BoundaryValues => "the boundary values allow hardly less, on any mesh inside",
        RefineEnd::Budget if rounds.is_empty() => "to halve a single edge adds more tets than are allowed",
        RefineEnd::Budget => "the next round would add more tets than are allowed",
        RefineEnd::Rounds => "these were all that were asked for",
        RefineEnd::NoEdge => "no edge is left that gains anything where it is halved",
        RefineEnd::NoGain => {
            "K onto the ball was larger on each of the meshes that were tried, so none was kept; a surface that is finer all over (mesh.cells) may \
             bring it down, or a larger refine.tets"
        }
        RefineEnd::NotSettled => "the map was not settled",
    };
    let added = rounds.last().map_or(0, |round| round.tets.saturating_sub(*tets_before));
    let flipped: usize = rounds.iter().map(|round| round.flipped).sum();
    let flipped = if flipped > 0 { format!(", {flipped} tet{} flipped", s(flipped)) } else { String::new() };
    let (what, settled) = match *surface {
        true => ("K onto the ball", achieved.last.ball_k.map(|k| k.certified)),
        false => ("max K", Some(achieved.last.max_k)),
    };
    let reached = match (rounds.first(), rounds.last()) {
        (Some(first), Some(last)) => {
            let before = max_k_before.map(|k| format!("{} before, ", number(k))).unwrap_or_default();
            let settled = settled.map(|k| format!(", {} once settled", number(k))).unwrap_or_default();
            let [first, last] = [first.max_k, last.max_k].map(number);
            format!(", {what} {before}{first} after the first, {last} after the last{settled}")
        }
        _ => String::new(),
    };
    let least = settled.or(rounds.last().map(|round| round.max_k));
    let gained = max_k_before.zip(least).map_or(1.0, |(before, least)| before / least);
    let nothing = match rounds.last() {
        Some(_) if gained >= GAINED => "",
        None => "",
        Some(_) if *surface => "; they gained nothing",
        Some(_) if added < achieved.active => "; they gained nothing: more tets hold the largest K than were added",
        Some(_) => {
            "; they gained nothing: halving edges inside does not change what holds the largest K, another surface mesh may"
        }
    };
    let share = percent(added as f64 / *tets_before as f64);
    let count = rounds.len();
    let of_surface =
        if *surface { ", on the surface too, for K onto the ball as with objective = \"ball\"" } else { "" };
    let carried = match (&achieved.untangling, achieved.initial.flipped) {
        (None, flipped @ 1..) => {
            format!(
                "; of the start, carried over to this mesh, {flipped} tet{} are flipped, which says nothing of the final map",
                s(flipped)
            )
        }
        _ => String::new(),
    };
    let text = format!(
        "{count} round{} where K sits{of_surface}{flipped}, {added} tet{} added ({share}){reached}{nothing}; {why}{carried}",
        s(count),
        s(added)
    );
    labelled(columns, "refined", &text)
}

fn untangling_in_words(untangling: &UntanglingFigures, stop: StopReason, remedy: &str) -> String {
    if untangling.iterations == 0 && stop == StopReason::IterationLimit {
        return format!("{} flipped at the start, and no step was allowed", untangling.flipped_before);
    }
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
    // What a limit or a signal left flipped may not resist.
    let remedy = if stop == StopReason::StillFlipped { format!("; {remedy}") } else { String::new() };
    format!(
        "{steps}; {} tet{} left flipped: {}{common}{remedy}",
        untangling.resisting.len(),
        s(untangling.resisting.len()),
        list(untangling.resisting.iter().map(|t| t.0).collect())
    )
}

/// The same for an optimized map of two given meshes, in so many columns.
pub fn map_summary(report: &MapReport, columns: usize) -> String {
    let mesh = format!(
        "{} vertices ({} fixed), {} tets ({} locked)",
        report.vertices, report.fixed, report.tets, report.locked
    );
    let Achieved { bounds, best, limit, stop, .. } = &report.achieved;
    let [limit, bounds] = if bounds.is_empty() {
        let why = match stop {
            StopReason::Cancelled => "none: the run was interrupted",
            _ => "none: not every boundary vertex is fixed",
        };
        [labelled(columns, "bounds", why), String::new()]
    } else {
        [best_and_limit(columns, *best, limit), format!("\n{}", bounds_list(columns, bounds))]
    };
    let blocks = [
        coarse_warning(columns, &report.achieved.ball, &report.achieved.last),
        labelled(columns, "mesh", &mesh),
        report.achieved.splits.map(|splits| splits_in_words(columns, splits)).unwrap_or_default(),
        format!(
            "\n{}\n",
            dilatations(columns, &[("start", &report.achieved.initial), ("final", &report.achieved.last)])
        ),
        report
            .achieved
            .untangling
            .as_ref()
            .map(|u| labelled(columns, "untangled", &untangling_in_words(u, report.achieved.stop, REFINE)))
            .unwrap_or_default(),
        refined_line(columns, &report.achieved),
        labelled(
            columns,
            "active",
            &format!("{} tet{} within 0.1 % of the max K", report.achieved.active, s(report.achieved.active)),
        ),
        labelled(columns, "stopped", &stop_in_words(&report.achieved)),
        risen_warning(columns, &report.achieved),
        time_line(report.achieved.times),
        format!("\n{limit}"),
        ball_lines(columns, &report.achieved.ball, Some(&report.achieved.initial), &report.achieved.last),
        bounds,
    ];
    blocks.concat()
}

/// How long a run took, as a line to follow its [`summary`].
pub fn time_line(times: Times) -> String {
    labelled(COLUMNS, "time", &format!("{:.1} s on {} thread{}", times.seconds, times.threads, s(times.threads)))
}

/// The config with its overrides, as they were typed.
fn command_in_words(report: &Report) -> String {
    let overrides: String = report.overrides.iter().map(|assignment| format!(" --set {assignment}")).collect();
    report.config.clone() + &overrides
}

/// What is said where the largest K is not what was lowered.
fn risen_warning(columns: usize, achieved: &Achieved) -> String {
    let (start, last) = (achieved.initial.max_k, achieved.last.max_k);
    if last <= RISEN * start {
        return String::new();
    }
    let text = format!(
        "the largest K rose from the start's {} to {}: a soft maximum weighs it against all other tets, a large optimize.rise against the \
         mean, and what lowers K onto the ball against that; optimize.objective = \"max\" lowers it",
        number(start),
        number(last)
    );
    labelled(columns, "warning", &text)
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

/// Why an optimization ended, in words.
fn stop_in_words(achieved: &Achieved) -> String {
    let &Achieved { stop, kkt, tolerance, iterations, .. } = achieved;
    let untangling = achieved.untangling.as_ref().map_or(0, |untangling| untangling.iterations);
    if stop == StopReason::IterationLimit && iterations + untangling == 0 {
        return "no iteration was allowed: the final map is the start".into();
    }
    let crawled;
    let (why, remedy) = match stop {
        StopReason::Optimal => ("the largest K is at a stationary point (KKT residual at most 1e-6)", ""),
        StopReason::Converged => match kkt {
            None => ("converged", ""),
            Some(kkt) => {
                let residual = kkt.largest();
                crawled = match tolerance.filter(|tolerance| residual <= *tolerance) {
                    Some(tolerance) => format!(
                        "as near to a stationary point as was asked for (KKT residual {residual:.1e}, tolerance {tolerance:e})"
                    ),
                    None => format!(
                        "its steps became too small to gain more, but the largest K is not at a stationary point (KKT \
                         residual {residual:.1e}; 1e-6 or less at one)"
                    ),
                };
                (crawled.as_str(), "")
            }
        },
        StopReason::IterationLimit => ("iteration limit reached", "; a higher one may lower K further"),
        StopReason::TimeLimit => ("time limit reached", "; a longer one may lower K further"),
        StopReason::Cancelled => ("cancelled", "; this is the best map so far"),
        StopReason::NoProgress if achieved.initial == achieved.last => {
            ("no step lowered the objective", ": the final map is the start")
        }
        StopReason::NoProgress => ("no step lowered the objective", ""),
        StopReason::NothingFree => ("no vertex is free to move", "; refine the mesh inside"),
        StopReason::StillFlipped => ("tets of the start resisted untangling; nothing was optimized", ""),
    };
    format!("{why} after {iterations} iteration{}{remedy}", s(iterations))
}

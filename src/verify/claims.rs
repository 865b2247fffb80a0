//! The claims of a report, each held against what the files give.

use std::collections::BTreeSet;

use serde_json::{Value, json};

use super::Findings;
use super::files::Files;
use super::rounding::{Enclosure, enclosed_dilatations};
use super::start::{Again, again};
use crate::bound::LowerBound;
use crate::bound::certificate;
use crate::cancel::Cancel;
use crate::experiment::{Course, Heading, bounds, record};
use crate::measure::{Measured, ball_dilatation, measure};
use crate::mesh::{TetId, Vec3};
use crate::optimize::{OPTIMAL, StopReason, Untangled};
use crate::report::{UntanglingFigures, trace_hash};

/// Relative difference allowed for figures that the same formulas give on any machine, but for the last bits of the
/// elementary functions.
const SAME: f64 = 1e-11;
/// The same for the dilatations of a start that was made again: of thin tets they amplify those bits.
const SAME_START: f64 = 1e-9;
/// The same for bounds, of which the apex bound is searched to this accuracy.
const SAME_BOUND: f64 = 2e-7;
/// The same for a row of the trace: the optimizer decomposes in its own way, and the positions that a lexicographic polish ends
/// with are a row's but for the last digits of the mean.
const SAME_ROW: f64 = 1e-7;
/// The keys of figures that are, or follow from, bounds.
const OF_BOUNDS: [&str; 5] = ["bounds", "best_bound", "gap", "ball_bound", "ball_gap"];
/// Relative distance below the largest K within which a tet counts as active.
const ACTIVE: f64 = 1e-3;

/// Holds all claims against the files.
pub(super) fn check(files: &Files, findings: &mut Findings) {
    let Some(again) = again(files, findings) else { return };
    let (mut before, mut after) = if again.start.corners.is_some() {
        let measure = |image| again.start.measure(image, &Cancel::default());
        let mut before = measure(&again.start.image);
        before.summary.ball_k = measure(&files.start).summary.ball_k;
        (before, measure(&files.image))
    } else {
        let mut before = measure(&again.start.domain, &again.start.image);
        // Halving amplifies last bits, so of the positions in the files, which were held against those made again.
        before.summary.ball_k = ball_dilatation(&files.domain, &files.start).ok();
        (before, again.start.measure(&files.image, &Cancel::default()))
    };
    let told = &files.report.achieved;
    for (found, told) in [(&mut before, &told.initial), (&mut after, &told.last)] {
        let Some((found, told)) = found.summary.ball_k.as_mut().zip(told.ball_k.filter(|told| told.cut_short)) else {
            continue;
        };
        // A search that ended early: what it proves is no less than what is found now, and what it found no more than what is proved.
        if told.certified >= found.sampled && told.sampled <= found.certified {
            *found = told;
        }
    }
    if files.report.achieved.stop == StopReason::Cancelled {
        // An interrupted run may not have come to K onto the ball.
        let told = &files.report.achieved;
        for (found, told) in [(&mut before, &told.initial), (&mut after, &told.last)] {
            found.summary.ball_k = found.summary.ball_k.filter(|_| told.ball_k.is_some());
        }
    }
    if let Some(centre) = again.start.centre.filter(|_| !again.made) {
        radial_trace(files, &centre.position, findings);
    }
    cells_of_start(files, &before, findings);
    let upper = cells(files, &after, findings);
    let known = known_bounds(files, &again, findings);
    findings.begin("no proved bound is above the largest K");
    for bound in known.iter().filter(|bound| bound.applies && bound.certified && bound.value > upper) {
        findings.found(format!(
            "the bound {:?} of {} contradicts the map, whose K is at most {upper}: one of the two is wrong; please report it",
            bound.name, bound.value
        ));
    }
    let gap = files.report.achieved.best.gap;
    findings
        .expect(gap.is_none_or(|gap| gap >= 1.0), || format!("the gap is {gap:?}, but no map is below a proved bound"));
    figures(files, &again, (&before, &after), known, findings);
    trace(files, &again, &before, findings);
    findings.trust("version, revision, threads, times, those of the trace included, and memory");
}

/// Every bound, computed anew; those of a run that was interrupted may be weaker or missing.
fn known_bounds(files: &Files, again: &Again, findings: &mut Findings) -> Vec<LowerBound> {
    if let Some(found) = &files.certificate {
        findings.begin("the certificate proves its bound, with a rounding margin");
        let elements = again.start.corners.as_ref().map(|corners| corners.elements(&files.domain).domain);
        if let Err(rejection) = certificate::check(found, elements.as_ref().unwrap_or(&files.domain), &files.image) {
            findings.found(format!("certificate.json proves nothing: {rejection}"));
        }
    }
    let mut known = bounds(&again.start, &files.image, files.certificate.as_ref(), &Cancel::default());
    if files.report.achieved.stop == StopReason::Cancelled {
        known.retain_mut(|bound| {
            let told =
                files.report.achieved.bounds.iter().find(|told| (told.name, told.kind) == (bound.name, bound.kind));
            bound.value = told.map_or(bound.value, |told| told.value.min(bound.value));
            told.is_some()
        });
    }
    known
}

/// The whole record made anew from the two maps and the bounds, and what only the run itself could know taken from it.
fn figures(
    files: &Files,
    again: &Again,
    (before, after): (&Measured, &Measured),
    known: Vec<LowerBound>,
    findings: &mut Findings,
) {
    findings.begin("every figure, bound, gap and word of the report follows from the config and the two maps");
    let told = &files.report.achieved;
    // Halves of a flipped tet are flipped. Of a mesh that was halved and not made again only that is known.
    let flipped = before.summary.flipped;
    let of_told = told.untangling.as_ref().map_or(0, |untangling| untangling.flipped_before);
    let is_halved = !files.changes.is_empty() || told.untangling.as_ref().is_some_and(|u| u.refinement_splits > 0);
    let flipped_before = match &again.unrefined {
        Some(unrefined) => unrefined.flipped,
        None if is_halved && (1..=flipped).contains(&of_told) => {
            findings.trust("how many tets were flipped before edges were halved");
            of_told
        }
        None => flipped,
    };
    let untangled = Untangled {
        positions: Vec::new(),
        resisting: after.flipped.clone(),
        iterations: told.untangling.as_ref().map_or(0, |untangling| untangling.iterations),
        seconds: 0.0,
    };
    let course = Course {
        untangling: UntanglingFigures::of(
            &files.domain,
            flipped_before,
            &untangled,
            told.untangling.as_ref().map_or(0, |untangling| untangling.refinement_splits),
        ),
        refined: told.refined.clone(),
        stop: told.stop,
        kkt: told.kkt,
        tolerance: told.tolerance,
        iterations: told.iterations,
        times: told.times,
    };
    if told.untangling.is_some() {
        findings.trust("the number of steps of untangling");
    }
    let heading = Heading { name: &again.name, seed: again.seed, source: &again.source };
    let mut found =
        record(&heading, &again.start, &files.image, (before, after), known, course, trace_hash(&files.trace));
    let told = &files.report;
    found.version.clone_from(&told.version);
    found.revision.clone_from(&told.revision);
    if !again.made {
        found.warnings.clone_from(&told.warnings);
    }
    let [told, found] = [told, &found].map(|report| json!(report));
    let (Some(told), Some(found)) = (told.as_object(), found.as_object()) else { return };
    for (key, found) in found {
        let tolerance = match key.as_str() {
            key if OF_BOUNDS.contains(&key) => SAME_BOUND,
            "initial" => SAME_START,
            _ => SAME,
        };
        compare(key, told.get(key).unwrap_or(&Value::Null), found, tolerance, findings);
    }
}

fn cells_of_start(files: &Files, before: &Measured, findings: &mut Findings) {
    findings.begin("K_I, K_O and K of every tet at the start");
    for (row, found) in files.cells.iter().zip(&before.dilatations) {
        let columns =
            [(row.k_inner_initial, found.inner), (row.k_outer_initial, found.outer), (row.k_initial, found.k())];
        findings.expect(columns.iter().all(|&(told, found)| close(told, found, SAME_START)), || {
            format!("tet {}: K at the start is {} in cells.csv, but {} of the start", row.tet, row.k_initial, found.k())
        });
    }
}

/// The largest K, rounded up.
fn cells(files: &Files, measured: &Measured, findings: &mut Findings) -> f64 {
    findings.begin("K_I, K_O and K of every tet lie between their proved ends");
    let threshold = measured.summary.max_k * (1.0 - ACTIVE);
    let on_boundary = files.domain.boundary().vertex_mask();
    let (mut upper, mut undecided): (f64, Vec<TetId>) = (1.0, Vec::new());
    let flipped: BTreeSet<TetId> = measured.flipped.iter().copied().collect();
    for (tet, row) in (0..).map(TetId).zip(&files.cells) {
        let mut enclosures = enclosed_dilatations(&files.domain, files.corners.as_ref(), tet, &files.image);
        if flipped.contains(&tet) {
            enclosures = [Enclosure { lower: f64::INFINITY, upper: f64::INFINITY }; 2];
        }
        let [inner, outer] = enclosures;
        let larger = Enclosure { lower: inner.lower.max(outer.lower), upper: inner.upper.max(outer.upper) };
        upper = upper.max(larger.upper);
        if larger.upper.is_infinite() && !flipped.contains(&tet) {
            undecided.push(tet);
        }
        for (name, value, ends) in
            [("k_inner", row.k_inner, inner), ("k_outer", row.k_outer, outer), ("k", row.k, larger)]
        {
            findings.expect(ends.contains(value), || {
                format!("tet {}: {name} is {value} in cells.csv, but lies in [{}, {}]", tet.0, ends.lower, ends.upper)
            });
        }
        let corners = files.domain.mesh().tets()[tet.index()];
        findings.expect(row.tet == tet.index(), || format!("row {} of cells.csv names tet {}", tet.0, row.tet));
        findings.expect(row.active == (measured.dilatations[tet.index()].k() >= threshold), || {
            format!("tet {}: active is {} in cells.csv", tet.0, row.active)
        });
        findings.expect(row.locked == corners.iter().all(|v| on_boundary[v.index()]), || {
            format!("tet {}: locked is {} in cells.csv", tet.0, row.locked)
        });
    }
    if let Some((first, others)) = undecided.split_first() {
        findings.trust(format!(
            "K of tet {}{}: so thin, in the domain or in the image, that rounding of positions leaves it no upper end",
            first.0,
            if others.is_empty() { String::new() } else { format!(" and of {} more", others.len()) }
        ));
    }
    findings.max_k_upper = Some(upper);
    upper
}

fn trace(files: &Files, again: &Again, before: &Measured, findings: &mut Findings) {
    findings.begin("trace.csv, iterations, stop reason, KKT residual and the two maps agree with each other");
    findings.trust(
        "how the optimization went: trace.csv, the stop reason and the KKT residual, beyond that they agree with each other and \
         with the two maps",
    );
    let (report, rows) = (&files.report, &files.trace);
    let (first, last) = (&before.summary, &report.achieved.last);
    // Of a start that nothing could untangle there are none.
    findings.expect(!rows.is_empty() || last.flipped > 0, || "trace.csv has no row".into());
    findings.expect(report.achieved.iterations == rows.len().saturating_sub(1), || {
        let wanted = report.achieved.iterations.saturating_add(1);
        format!(
            "trace.csv has {} rows, but must have {wanted}: one of the start and one for each of the iterations",
            rows.len()
        )
    });
    // Each row is of a map of this mesh, with these values at the boundary where they do not slide and refinement put no vertices.
    let boundary = files.domain.boundary().vertex_mask().iter().enumerate().filter(|(_, on)| **on);
    // What slid may have come back, where the start is best for the objective.
    let slid = again.slides || { boundary }.any(|(vertex, _)| files.start[vertex] != files.image[vertex]);
    let surface = report.achieved.refined.as_ref().is_some_and(|refined| refined.surface);
    let last_round = rows.last().map_or(0, |row| row.round);
    let mut seconds = 0.0;
    for (index, row) in rows.iter().enumerate() {
        let at = |what: &str| format!("row {index} of trace.csv {what}");
        findings.expect(row.iteration == index, || at(&format!("is of iteration {}", row.iteration)));
        findings.expect(row.seconds >= seconds, || at("is earlier than the one before it"));
        seconds = row.seconds;
        let bound = report.achieved.best.best_bound.filter(|_| !slid && (!surface || row.round == last_round));
        let least = bound.unwrap_or(1.0) * (1.0 - SAME_BOUND);
        findings
            .expect(row.max_k >= least && row.mean_k >= 1.0 - SAME && row.mean_k <= row.max_k * (1.0 + SAME), || {
                at(&format!("has max K {} and mean K {}, which no map has", row.max_k, row.mean_k))
            });
    }
    if let Some(row) = rows.first().filter(|_| first.flipped == 0) {
        // It is of the mesh before any edge was halved, whose tets the mean counts; halved ones have the K of theirs, up to rounding.
        let same = match again.unrefined.as_ref().or(Some(first).filter(|_| files.changes.is_empty())) {
            Some(first) => close(row.max_k, first.max_k, SAME_START) && close(row.mean_k, first.mean_k, SAME_START),
            None => close(row.max_k, first.max_k, SAME_ROW),
        };
        findings.expect(&*row.phase == "start" && same, || "row 0 of trace.csv is not the start".into());
    }
    let passed =
        rows.iter().any(|row| close(row.max_k, last.max_k, SAME_ROW) && close(row.mean_k, last.mean_k, SAME_ROW));
    findings.expect(rows.is_empty() || passed, || "no row of trace.csv has final.max_k and final.mean_k".into());
    // The polish may give back 2e-4 of what was gained. A soft maximum, which has no residual, may fall while max K rises.
    findings.expect(report.achieved.kkt.is_none() || last.max_k <= first.max_k * (1.0 + 3e-4), || {
        format!("final.max_k {} is above initial.max_k {}", last.max_k, first.max_k)
    });
    let stationary = report.achieved.kkt.is_some_and(|kkt| kkt.largest() <= OPTIMAL);
    let agree = match report.achieved.stop {
        StopReason::Optimal => stationary,
        StopReason::Converged => !stationary,
        StopReason::NothingFree => report.achieved.kkt.is_none() && report.achieved.iterations == 0,
        StopReason::StillFlipped => report.achieved.kkt.is_none() && last.flipped > 0,
        StopReason::NoProgress => last.flipped == 0,
        StopReason::IterationLimit | StopReason::TimeLimit | StopReason::Cancelled => true,
    };
    findings.expect(agree, || {
        format!("the stop reason {:?} does not agree with kkt {:?}", report.achieved.stop, report.achieved.kkt)
    });
}

/// With a star centre the boundary values are vouched to be the radial projection: without it, some bounds are void.
fn radial_trace(files: &Files, centre: &Vec3, findings: &mut Findings) {
    findings.begin("the boundary values are the radial projection about the centre");
    let boundary = files.domain.boundary().vertex_mask();
    let points = files.domain.mesh().points().iter().zip(&files.image).zip(boundary);
    for (vertex, ((point, image), _)) in points.enumerate().filter(|(_, (_, on))| **on) {
        let away = (image - (point - centre).normalize()).norm();
        // Twice the rounding of a unit vector, and of a difference of points far from 0; NaN is found as well.
        let room = 1e-12 + 4.0 * f64::EPSILON * point.amax() / (point - centre).norm();
        findings.expect(away <= room, || format!("boundary vertex {vertex} is {away:.1e} off its radial projection"));
    }
}

/// Lists where a reported value differs from one computed anew; numbers may differ by a relative `tolerance`.
fn compare(path: &str, reported: &Value, found: &Value, tolerance: f64, findings: &mut Findings) {
    match (reported, found) {
        (Value::Number(a), Value::Number(b)) => {
            let [a, b] = [a, b].map(|x| x.as_f64().unwrap_or(f64::NAN));
            findings.expect(close(a, b, tolerance), || format!("{path} is reported as {a}, but is {b}"));
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            for (index, (a, b)) in a.iter().zip(b).enumerate() {
                compare(&format!("{path}[{index}]"), a, b, tolerance, findings);
            }
        }
        (Value::Object(a), Value::Object(b)) => {
            for (key, b) in b {
                compare(&format!("{path}.{key}"), a.get(key).unwrap_or(&Value::Null), b, tolerance, findings);
            }
        }
        (a, b) => findings.expect(a == b, || format!("{path} is reported as {a}, but is {b}")),
    }
}

fn close(a: f64, b: f64, tolerance: f64) -> bool {
    a == b || (a - b).abs() <= tolerance * a.abs().max(b.abs())
}

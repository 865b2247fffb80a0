//! The claims of a report, each held against what the files give.

use std::path::Path;

use serde::Deserialize;
use serde_json::{Value, json};

use super::Findings;
use super::files::Files;
use super::rounding::{Enclosure, enclosed_dilatations};
use crate::bound::certificate::{self, Certificate};
use crate::bound::{self, LowerBound};
use crate::config::ConfigSource;
use crate::dilatation::Dilatation;
use crate::map::bijectivity;
use crate::measure::{Measured, bottleneck, measure, summarize};
use crate::mesh::{Orientation, TetId, Vec3, orientation};
use crate::optimize::{KktResidual, OPTIMAL, StopReason};
use crate::report::{BestBound, DomainFigures, Limit, bounds_table, dilatations};

/// Relative difference allowed for figures that the same formulas give on any machine, but for the last bits of the
/// elementary functions.
const SAME: f64 = 1e-11;
/// The same for bounds, of which the apex bound is searched to this accuracy.
const SAME_BOUND: f64 = 2e-7;
/// Relative distance below the largest K within which a tet counts as active.
const ACTIVE: f64 = 1e-3;

/// Holds all claims against the files.
pub(super) fn check(files: &Files, findings: &mut Findings) {
    let measured = measure(&files.domain, &files.image);
    let centre: Option<[f64; 3]> = Option::deserialize(&files.report["domain"]["centre"]).unwrap_or_default();
    let centre = centre.map(Vec3::from);
    let mut known = bound::all(&files.domain, &files.image, centre, centre.is_some());
    known.extend(certificate(files, findings));
    config(&files.report, findings);
    size(files, findings);
    orientations(files, &measured, findings);
    dilatations_of_cells(files, &measured, findings);
    figures(files, &measured, findings);
    initial_figures(files, &measured, findings);
    trace(files, findings);
    if let Some(centre) = centre {
        radial_trace(files, &centre, findings);
    }
    bounds(files, &known, measured.summary.max_k, findings);
    summary(files, &measured, &known, findings);
}

fn config(report: &Value, findings: &mut Findings) {
    findings.begin("the config's text and overrides have the hash that is reported");
    let text = report["config_text"].as_str().unwrap_or_default().to_string();
    let overrides: Option<Vec<String>> = Vec::deserialize(&report["overrides"]).ok();
    let path = report["config"].as_str().unwrap_or_default();
    match ConfigSource::of_text(Path::new(path), text, &overrides.unwrap_or_default()) {
        Ok((source, _)) => findings
            .expect(report["config_hash"] == source.hash(), || "config_hash is not the hash of config_text".into()),
        Err(error) => findings.found(format!("config_text is no config: {error}")),
    }
}

fn size(files: &Files, findings: &mut Findings) {
    findings.begin("the domain has the size, volume and angles that are reported");
    let reported = &files.report["domain"];
    let solid = reported["solid"].as_str().unwrap_or_default().to_string();
    let mut figures = json!(DomainFigures::of(&files.domain, solid, None));
    for untold in ["centre", "kernel_radius", "smallest_angle"] {
        figures[untold] = reported[untold].clone();
    }
    compare("domain", reported, &figures, SAME, findings);
}

fn orientations(files: &Files, measured: &Measured, findings: &mut Findings) {
    findings.begin("orientation of every image tet by exact predicate, and whether the map is bijective");
    let tets = files.domain.mesh().tets();
    let turned = tets.iter().filter(|tet| orientation(tet.map(|v| &files.image[v.index()])) != Orientation::Positive);
    let (turned, reported) = (turned.count(), &files.report["final"]["flipped"]);
    findings.expect(reported == turned && measured.summary.flipped == turned, || {
        format!("{turned} tets of image.vtu are not positive, final.flipped says {reported}")
    });
    let found = bijectivity(&files.domain, &files.image);
    compare("bijective", &files.report["bijective"], &json!(found.bijective), 0.0, findings);
    compare("bijective_reason", &files.report["bijective_reason"], &json!(found.reason), 0.0, findings);
}

fn dilatations_of_cells(files: &Files, measured: &Measured, findings: &mut Findings) {
    findings.begin("K_I, K_O and K of every tet lie between their proved ends");
    let threshold = measured.summary.max_k * (1.0 - ACTIVE);
    let on_boundary = files.domain.boundary().vertex_mask();
    let mut upper: f64 = 1.0;
    let flipped: std::collections::BTreeSet<TetId> = measured.flipped.iter().copied().collect();
    for (tet, row) in (0..).map(TetId).zip(&files.cells) {
        let mut enclosures = enclosed_dilatations(&files.domain, tet, &files.image);
        if flipped.contains(&tet) {
            enclosures = [Enclosure { lower: f64::INFINITY, upper: f64::INFINITY }; 2];
        }
        let [inner, outer] = enclosures;
        let larger = Enclosure { lower: inner.lower.max(outer.lower), upper: inner.upper.max(outer.upper) };
        upper = upper.max(larger.upper);
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
        let volume = files.domain.volumes()[tet.index()];
        findings.expect(close(row.volume, volume, SAME), || {
            format!("tet {}: volume is {} in cells.csv, {volume} in domain.vtu", tet.0, row.volume)
        });
    }
    findings.max_k_upper = Some(upper);
    let reported = number(&files.report["final"]["max_k"]);
    findings.expect(reported <= upper && close(reported, measured.summary.max_k, SAME), || {
        format!("final.max_k is {reported}, but the map has {}, at most {upper}", measured.summary.max_k)
    });
}

fn figures(files: &Files, measured: &Measured, findings: &mut Findings) {
    findings.begin("maximum, means and quantiles of the final map, its active tets and their place");
    compare("final", &files.report["final"], &json!(measured.summary), SAME, findings);
    compare("active", &files.report["active"], &json!(measured.active(ACTIVE).len()), 0.0, findings);
    compare("bottleneck", &files.report["bottleneck"], &json!(bottleneck(&files.domain, measured)), SAME, findings);
}

fn initial_figures(files: &Files, measured: &Measured, findings: &mut Findings) {
    findings.begin("maximum, means and quantiles of the start are those of cells.csv");
    let start: Vec<Dilatation> =
        files.cells.iter().map(|row| Dilatation { inner: row.k_inner_initial, outer: row.k_outer_initial }).collect();
    for (row, dilatation) in files.cells.iter().zip(&start) {
        findings.expect(row.k_initial == dilatation.k() && dilatation.inner >= 1.0 && dilatation.outer >= 1.0, || {
            format!("tet {}: k_initial is {} in cells.csv, not the larger of its two", row.tet, row.k_initial)
        });
    }
    let positive: Vec<bool> = start.iter().map(|dilatation| dilatation.k().is_finite()).collect();
    let reported = &files.report["initial"];
    if positive.iter().all(|&positive| positive) {
        let figures = summarize(files.domain.volumes(), &start, &positive);
        compare("initial", reported, &json!(figures), SAME, findings);
    } else {
        // An infinite K may be of a flipped tet or of a needle; the start's positions are not there to tell.
        let infinite = positive.iter().filter(|&&positive| !positive).count();
        let flipped = reported["flipped"].as_u64().unwrap_or(u64::MAX);
        findings.expect(reported["max_k"].is_null() && flipped <= infinite as u64, || {
            format!("initial.max_k or initial.flipped does not agree with {infinite} infinite K in cells.csv")
        });
    }
    let (before, after) = (number(&reported["max_k"]), measured.summary.max_k);
    // The polish may give back 2e-4 of what was gained.
    findings.expect(after <= before * (1.0 + 3e-4), || format!("final.max_k {after} is above initial.max_k {before}"));
}

fn trace(files: &Files, findings: &mut Findings) {
    findings.begin("trace.csv, iterations, stop reason and KKT residual agree with each other");
    let report = &files.report;
    let rows = &files.trace;
    findings.expect(report["iterations"] == rows.len().saturating_sub(1), || {
        format!("trace.csv has {} rows, one more than iterations, which is {}", rows.len(), report["iterations"])
    });
    for (index, row) in rows.iter().enumerate() {
        findings.expect(row.0 == index, || format!("row {index} of trace.csv is of iteration {}", row.0));
    }
    let last = [number(&report["final"]["max_k"]), number(&report["final"]["mean_k"])];
    let passed = rows.iter().any(|row| close(row.1, last[0], SAME) && close(row.2, last[1], SAME));
    findings.expect(rows.is_empty() || passed, || "no row of trace.csv has final.max_k and final.mean_k".into());
    let Ok(stop) = StopReason::deserialize(&report["stop"]) else {
        return findings.found(format!("stop is {}, which is no stop reason", report["stop"]));
    };
    let Ok(kkt) = Option::<KktResidual>::deserialize(&report["kkt"]) else {
        return findings.found(format!("kkt is {}, which is no KKT residual", report["kkt"]));
    };
    let stationary = kkt.is_some_and(|kkt| kkt.largest() <= OPTIMAL);
    let agree = match stop {
        StopReason::Optimal => stationary,
        StopReason::Converged => !stationary,
        StopReason::NothingFree | StopReason::StillFlipped => kkt.is_none(),
        _ => true,
    };
    findings.expect(agree, || format!("the stop reason {} does not agree with kkt {}", report["stop"], report["kkt"]));
}

fn bounds(files: &Files, known: &[LowerBound], max_k: f64, findings: &mut Findings) {
    findings.begin("every bound is computed anew, and best bound, gap and limit follow from them");
    let report = &files.report;
    compare("bounds", &report["bounds"], &json!(known), SAME_BOUND, findings);
    let best = BestBound::of(known, max_k);
    compare("best_bound", &report["best_bound"], &json!(best.best_bound), SAME_BOUND, findings);
    compare("gap", &report["gap"], &json!(best.gap), SAME_BOUND, findings);
    let ending = StopReason::deserialize(&report["stop"])
        .and_then(|stop| Ok((stop, Option::<KktResidual>::deserialize(&report["kkt"])?)))
        .ok();
    compare("limit", &report["limit"], &json!(Limit::of(max_k, known, ending)), 0.0, findings);
}

/// With a star centre the boundary values are vouched to be the radial projection: without it, some bounds are void.
fn radial_trace(files: &Files, centre: &Vec3, findings: &mut Findings) {
    findings.begin("the boundary values are the radial projection about the centre");
    let boundary = files.domain.boundary().vertex_mask();
    let points = files.domain.mesh().points().iter().zip(&files.image).zip(boundary);
    for (vertex, ((point, image), _)) in points.enumerate().filter(|(_, (_, on))| **on) {
        let away = (image - (point - centre).normalize()).norm();
        // Twice the rounding of a unit vector, for a centre well inside; NaN is found as well.
        findings.expect(away <= 1e-12, || format!("boundary vertex {vertex} is {away:.1e} off its radial projection"));
    }
}

fn summary(files: &Files, measured: &Measured, known: &[LowerBound], findings: &mut Findings) {
    findings.begin("summary.txt shows the final figures and the bounds");
    let row = dilatations(&[("final", &measured.summary)]);
    let row = row.lines().last().unwrap_or_default();
    findings.expect(files.summary.lines().any(|line| line == row), || format!("summary.txt lacks the line {row:?}"));
    let best = BestBound::of(known, measured.summary.max_k);
    let limit = Limit::of(measured.summary.max_k, known, None);
    // The limit's sentence, which comes last, is wrapped and was compared already.
    let table = bounds_table(known, best, &limit);
    let table = table.split("\nlimit ").next().unwrap_or_default();
    findings.expect(files.summary.contains(table), || "summary.txt lacks the table of the bounds".into());
}

/// The bound that the certificate proves, if there is one.
fn certificate(files: &Files, findings: &mut Findings) -> Option<LowerBound> {
    let text = files.certificate.as_ref()?;
    findings.begin("the certificate proves its bound, with a rounding margin");
    let found = serde_json::from_str::<Certificate>(text).map_err(|error| error.to_string());
    let proved = found.and_then(|found| {
        certificate::bound(&found, &files.domain, &files.image).map_err(|rejection| rejection.to_string())
    });
    proved.map_err(|reason| findings.found(format!("certificate.json proves nothing: {reason}"))).ok()
}

/// Lists where a reported value differs from one computed anew; numbers may differ by a relative `tolerance`.
fn compare(path: &str, reported: &Value, found: &Value, tolerance: f64, findings: &mut Findings) {
    match (reported, found) {
        (Value::Number(a), Value::Number(b)) => {
            let [a, b] = [a, b].map(|x| x.as_f64().unwrap_or(f64::NAN));
            findings.expect(a == b || close(a, b, tolerance), || format!("{path} is reported as {a}, but is {b}"));
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            for (index, (a, b)) in a.iter().zip(b).enumerate() {
                compare(&format!("{path}[{index}]"), a, b, tolerance, findings);
            }
        }
        (Value::Object(a), Value::Object(b)) => {
            for key in a.keys().filter(|key| !b.contains_key(*key)) {
                findings.found(format!("{path}.{key} is not known"));
            }
            for (key, b) in b {
                compare(&format!("{path}.{key}"), a.get(key).unwrap_or(&Value::Null), b, tolerance, findings);
            }
        }
        (a, b) => findings.expect(a == b, || format!("{path} is reported as {a}, but is {b}")),
    }
}

/// A number of the report, where `null` stands for infinity.
fn number(value: &Value) -> f64 {
    if value.is_null() { f64::INFINITY } else { value.as_f64().unwrap_or(f64::NAN) }
}

fn close(a: f64, b: f64, tolerance: f64) -> bool {
    a == b || (a - b).abs() <= tolerance * a.abs().max(b.abs())
}

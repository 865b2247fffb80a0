use super::*;
use crate::bound::{BoundName, Kind, LowerBound, Scope};
use crate::domain::Domain;
use crate::measure::{bottleneck, measure};
use crate::mesh::{MeshChanges, TetId, TetMesh, Vec3, VertexId};
use crate::optimize::{KktResidual, StopReason, TraceRow};
use crate::refine::{RefineEnd, Round};
use crate::solid::StarCentre;

/// A corner of a cube split at an inner vertex, whose image is moved; `flip` moves it out.
fn domain_and_images(flip: bool) -> (Domain, Vec<Vec3>, Vec<Vec3>) {
    let points = vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z(), Vec3::new(0.2, 0.2, 0.2)];
    let tets = TetMesh::FACES.map(|[a, b, c]| [a as u32, b as u32, c as u32, 4].map(VertexId)).to_vec();
    let mesh = TetMesh::from_either_orientation(points, tets).unwrap().0;
    let domain = Domain::new(mesh).unwrap();
    let initial = domain.mesh().points().to_vec();
    let mut image = initial.clone();
    image[4] = if flip { Vec3::new(-1.0, 0.1, 0.1) } else { Vec3::new(0.1, 0.3, 0.2) };
    (domain, initial, image)
}

const TIMES: Times =
    Times { threads: 2, seconds: 0.25, untangling_seconds: 0.0, cpu_seconds: Some(0.5), peak_memory_mib: Some(8.0) };

fn bound(value: f64, applies: bool, certified: bool) -> LowerBound {
    let reason = "the boundary is fixed".into();
    LowerBound {
        name: BoundName::Vertex,
        source: "a test",
        kind: Kind::Outer,
        value,
        scope: Scope::MeshFixedBoundary,
        certified,
        applies,
        reason,
        place: None,
    }
}

fn write(flip: bool) -> (tempfile::TempDir, Report) {
    let (domain, initial, image) = domain_and_images(flip);
    let (before, after) = (measure(&domain, &initial), measure(&domain, &image));
    let bounds = vec![bound(1.01, true, true), bound(7.0, false, true), bound(8.0, true, false)];
    let centre = StarCentre { position: Vec3::repeat(0.2), kernel_radius: 0.1, smallest_angle: 0.5 };
    let report = Report {
        name: "case".into(),
        version: Report::VERSION.into(),
        revision: Report::REVISION.into(),
        config: "configs/case.toml".into(),
        config_hash: "0".into(),
        overrides: vec!["mesh.layers=2".into()],
        seed: 3,
        input_hash: None,
        domain: DomainFigures::of(&domain, "cube corner".into(), Some(&centre)),
        bijective: !flip,
        bijective_reason: "no tet is flipped".into(),
        bottleneck: bottleneck(&domain, &after),
        refinement: None,
        corners: None,
        map: MapFigures {
            map: "radial, exponent 1".into(),
            radial_exponent: Some(1.0),
            radial_smooth_k: Some(7.2102),
            closed_form_k: None,
            boundary_map: None,
        },
        distortion: None,
        trace_hash: "0".into(),
        warnings: vec!["this is a test".into()],
        config_text: "[domain]\nsolid = \"cube\"".into(),
        achieved: Achieved {
            splits: None,
            initial: before.summary.clone(),
            untangling: None,
            refined: None,
            last: after.summary.clone(),
            active: 1,
            best: BestBound::of(&bounds, after.summary.max_k),
            limit: Limit::of(after.summary.max_k, &bounds, None, false),
            ball: BallFigures::of(&domain, &image, &bounds, &after.summary),
            bounds,
            stop: StopReason::Converged,
            kkt: None,
            tolerance: Some(1e-5),
            iterations: 1,
            times: TIMES,
        },
    };
    let row = |iteration: usize| TraceRow {
        phase: "p=1".into(),
        iteration,
        objective: 0.1,
        max_k: after.summary.max_k,
        mean_k: 1.0,
        step: 1.0,
        round: 0,
        progress: 0.5,
        seconds: 0.5,
    };
    let folder = tempfile::tempdir().unwrap();
    let record = MapRecord {
        domain: &domain,
        corners: None,
        changes: &MeshChanges::default(),
        initial: &initial,
        image: &image,
        measured_initial: &before,
        measured: &after,
        active: &[TetId(2)],
        trace: &[row(0), row(1)],
        certificate: None,
        units: Default::default(),
    };
    write_results(&folder.path().join("new"), &report, &record).unwrap();
    (folder, report)
}

fn read(folder: &tempfile::TempDir, name: &str) -> String {
    std::fs::read_to_string(folder.path().join("new").join(name)).unwrap()
}

#[test]
fn the_report_has_the_fixed_keys_in_a_fixed_order() {
    let (folder, report) = write(false);
    let text = read(&folder, "report.json");
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    for path in [
        "/domain/vertices",
        "/domain/tets",
        "/domain/locked",
        "/initial/max_k",
        "/initial/mean_k",
        "/initial/flipped",
        "/final/max_k",
        "/final/mean_k",
        "/final/p99_k",
        "/final/flipped",
        "/bounds/0/name",
        "/bounds/0/value",
        "/bounds/0/scope",
        "/bounds/0/certified",
        "/best_bound",
        "/gap",
        "/limit/by",
        "/limit/sentence",
        "/bijective",
        "/stop",
        "/iterations",
        "/seconds",
        "/seed",
        "/threads",
        "/config",
        "/version",
        "/revision",
        "/config_text",
        "/config_hash",
        "/bottleneck/place/kind",
    ] {
        assert!(json.pointer(path).is_some_and(|value| !value.is_null()), "{path} in {text}");
    }
    assert_eq!(json["final"]["max_k"].as_f64().unwrap().to_bits(), report.achieved.last.max_k.to_bits());
    // What differs from run to run is together at the end, so that a comparison can cut it off.
    let keys = "name version revision config config_hash overrides seed input_hash domain refinement map \
                radial_exponent radial_smooth_k closed_form_k boundary_map corners distortion bijective \
                bijective_reason bottleneck trace_hash warnings config_text splits initial untangling refined final \
                active bounds best_bound gap ball_fraction ball_bound ball_gap ball_reason limit stop kkt tolerance iterations \
                threads seconds untangling_seconds cpu_seconds peak_memory_mib";
    let lines = text.lines().filter_map(|line| line.strip_prefix("  \"")?.split_once("\": "));
    assert_eq!(lines.map(|(key, _)| key).collect::<Vec<_>>(), keys.split(' ').collect::<Vec<_>>());
}

#[test]
fn only_a_proved_bound_that_applies_makes_a_gap() {
    let bounds = [bound(1.5, true, true), bound(1.2, true, true), bound(7.0, false, true), bound(8.0, true, false)];
    assert_eq!(BestBound::of(&bounds, 3.0), BestBound { best_bound: Some(1.5), gap: Some(2.0) });
    assert_eq!(BestBound::of(&bounds, 1.5f64.next_down()), BestBound { best_bound: Some(1.5), gap: Some(1.0) });
    assert_eq!(BestBound::of(&bounds, f64::INFINITY), BestBound { best_bound: Some(1.5), gap: None });
    assert_eq!(BestBound::of(&bounds[2..], 3.0), BestBound { best_bound: None, gap: None });
}

#[test]
fn infinities_are_null_in_json_and_inf_in_tables() {
    let (folder, report) = write(true);
    let json: serde_json::Value = serde_json::from_str(&read(&folder, "report.json")).unwrap();
    assert!(json["final"]["max_k"].is_null() && json["gap"].is_null());
    assert!(json["final"]["flipped"].as_u64().unwrap() > 0);
    assert!(read(&folder, "cells.csv").contains(",inf,"));
    assert!(read(&folder, "trace.csv").contains(",inf,"));
    assert!(summary(&report).contains("inf"));
}

#[test]
fn tables_have_a_row_an_entry() {
    let (folder, report) = write(false);
    let trace = read(&folder, "trace.csv");
    assert_eq!(trace.lines().next(), Some("phase,iteration,objective,max_k,mean_k,step,round,progress,seconds"));
    assert_eq!(trace.lines().count(), 3);
    let cells = read(&folder, "cells.csv");
    let mut table = csv::Reader::from_reader(cells.as_bytes());
    let headers: Vec<String> = table.headers().unwrap().iter().map(str::to_string).collect();
    assert_eq!(
        headers.join(" "),
        "tet volume k_inner_initial k_outer_initial k_initial k_inner k_outer k active locked"
    );
    let rows: Vec<csv::StringRecord> = table.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 4);
    let largest = rows.iter().map(|row| row[7].parse::<f64>().unwrap()).fold(0.0, f64::max);
    assert_eq!(largest, report.achieved.last.max_k);
    let active: Vec<&str> = rows.iter().map(|row| &row[8]).collect();
    assert_eq!(active, ["false", "false", "true", "false"]);
    for name in ["domain.vtu", "image.vtu"] {
        assert!(read(&folder, name).contains("Name=\"K_initial\""));
    }
}

#[test]
fn the_summary_is_narrow_and_says_it_all_but_the_time() {
    let (folder, report) = write(false);
    let text = summary(&report);
    assert_eq!(read(&folder, "summary.txt"), text);
    assert!(!text.contains("thread"), "{text}");
    for words in [
        "cube corner",
        "5 vertices (4 on the boundary), 4 tets (0 locked),",
        "bottleneck",
        "yes: no tet is",
        "converged after 1 iteration\n",
        "case (configs/case.toml --set mesh.layers=2)",
        "K_O >=",
        "PL on this mesh",
        "K >= 1.0100",
        "this is a test",
    ] {
        assert!(text.contains(words), "{words} in\n{text}");
    }
    assert_eq!(time_line(TIMES), "time        0.2 s on 2 threads\n");
    let widest = |text: &str| text.lines().map(|line| line.chars().count()).max().unwrap();
    assert!(widest(&text) <= COLUMNS, "{} columns:\n{text}", widest(&text));
    // What limits K stands before the list of the bounds.
    assert!(text.find("\nlimit ").unwrap() < text.find("\nlower bound ").unwrap(), "{text}");
    // In a narrow terminal the same words and numbers, in another order only.
    let words = |text: &str| {
        let mut words: Vec<String> = text.split(|c: char| c.is_whitespace() || c == ',').map(String::from).collect();
        words.retain(|word| !word.is_empty());
        words.sort();
        words
    };
    for columns in 40..COLUMNS {
        let narrow = summary_within(&report, columns);
        assert!(widest(&narrow) <= columns, "{} of {columns} columns:\n{narrow}", widest(&narrow));
        assert_eq!(words(&narrow), words(&text), "{narrow}");
    }
}

#[test]
fn lengths_of_a_solid_in_small_units_keep_four_figures() {
    let (_folder, mut report) = write(false);
    let said = summary(&report);
    assert!(said.contains("(0.2000, 0.2000, 0.2000), kernel radius 0.1000,"), "{said}");
    // The same solid in units a thousand times as large.
    let scale = 1e-3;
    report.domain.volume *= scale * scale * scale;
    report.domain.centre = Some([0.2 * scale, -1e-20, 0.2 * scale]);
    report.domain.kernel_radius = Some(0.1 * scale);
    let said = summary(&report);
    assert!(said.contains("(0.0002000, 0.0000000, 0.0002000), kernel radius 0.0001000,"), "{said}");
}

#[test]
fn the_summary_counts_bounds_that_do_not_apply_and_warns_of_a_largest_k_above_that_of_the_start() {
    let (_folder, mut report) = write(false);
    // A rise that the polish is allowed.
    report.achieved.initial.max_k = report.achieved.last.max_k / 1.0005;
    let said = summary(&report);
    assert!(said.contains("1 more does not apply to this map; report.json tells why"), "{said}");
    assert!(!said.contains("7.0000") && !said.contains("the largest K rose"), "{said}");
    // Where none applies, each says why.
    report.achieved.bounds.iter_mut().for_each(|bound| bound.applies = false);
    assert_eq!(summary(&report).matches("the boundary is fixed").count(), 3);
    report.achieved.initial.max_k = report.achieved.last.max_k / 2.0;
    let said = summary(&report);
    assert!(said.contains("warning     the largest K rose from the start's"), "{said}");
    // A start with flipped tets is above all.
    report.achieved.initial.max_k = f64::INFINITY;
    assert!(!summary(&report).contains("the largest K rose"));
}

#[test]
fn the_summary_tells_what_refinement_came_to_and_where_it_gained_nothing() {
    let (_, mut report) = write(false);
    let max_k = report.achieved.last.max_k;
    let round = |max_k| Round { flipped: 0, edges: 1, tets: 6, max_k };
    let mut told = |before: f64, rounds: Vec<Round>| {
        let max_k_before = Some(before);
        report.achieved.refined =
            Some(RefinedFigures { tets_before: 4, surface: false, max_k_before, end: RefineEnd::Rounds, rounds });
        summary(&report).split_whitespace().collect::<Vec<_>>().join(" ")
    };
    let text = told(2.0 * max_k, vec![round(1.8 * max_k), round(1.5 * max_k)]);
    // What the rounds end at is not yet the final map.
    let settled = format!("after the last, {} once settled", crate::dilatation::number(max_k));
    assert!(text.contains("2 rounds where K sits, 2 tets added (50.00 %)") && text.contains(&settled), "{text}");
    assert!(!text.contains("gained nothing"), "{text}");
    let text = told(max_k, vec![round(max_k)]);
    assert!(text.contains("they gained nothing: halving edges inside"), "{text}");
    assert!(!told(max_k, Vec::new()).contains("gained nothing"));
}

#[test]
fn an_end_that_is_no_optimum_says_so() {
    let (_folder, mut report) = write(false);
    let text = |report: &Report| summary(report).split_whitespace().collect::<Vec<_>>().join(" ");
    report.achieved.kkt = Some(KktResidual { primal: 0.0, dual: 1.0, complementarity: 0.0 });
    let crawled = "stopped its steps became too small to gain more, but the largest K is not at a stationary point (KKT residual 1.0e0; \
                   1e-6 or less at one) after 1 iteration";
    assert!(text(&report).contains(crawled) && !text(&report).contains("converged"), "{}", text(&report));
    // What was asked for was reached, with the residual told to two figures.
    report.achieved.kkt = Some(KktResidual { primal: 0.0, dual: 1.26e-6, complementarity: 0.0 });
    let reached = "stopped as near to a stationary point as was asked for (KKT residual 1.3e-6, tolerance 1e-5) after 1 iteration";
    assert!(text(&report).contains(reached), "{}", text(&report));
    report.achieved.tolerance = None;
    assert!(text(&report).contains("(KKT residual 1.3e-6; 1e-6 or less at one)"), "{}", text(&report));
    (report.achieved.kkt, report.achieved.stop, report.achieved.iterations) = (None, StopReason::IterationLimit, 0);
    assert!(text(&report).contains("stopped no iteration was allowed: the final map is the start"));
    report.achieved.iterations = 3;
    assert!(text(&report).contains("iteration limit reached after 3 iterations"));
}

//! Runs with refinement where the largest K sits, and tampering with their meshes and rounds.

use std::fs;
use std::path::Path;

use qcball::mesh::{Boundary, TetMesh, Vec3};
use serde_json::{Value, json};

use super::folder::{
    Tampering, edit_cell, edit_maps, edit_report, edit_text, every_one_is_found, qcball, report, results,
};

const REFINED: &[&str] = &["refine.rounds=3", "refine.tets=\"60 %\"", "refine.until=0.001"];

/// The same of a run with refinement. Its last vertices are middles of edges.
const TAMPERINGS_OF_REFINEMENT: &[Tampering] = &[
    (
        "a new vertex moved in the domain",
        |f| {
            edit_maps(f, |m| m.domain.soup.points.last_mut().unwrap().x += 1e-6);
        },
        "of domain.vtu",
    ),
    ("a new vertex moved in the start", |f| edit_maps(f, |m| m.start().last_mut().unwrap().x += 1e-6), "of the start"),
    ("an old vertex moved in the domain", |f| edit_maps(f, |m| m.domain.soup.points[40].x += 1e-6), "of domain.vtu"),
    (
        "another edge halved",
        |f| {
            let column = 1;
            edit_cell(f, "refined.csv", 0, column, |from| if from == "0" { "1".into() } else { "0".into() });
        },
        "refined.csv or",
    ),
    ("an edge that is none", |f| edit_cell(f, "refined.csv", 0, 1, |_| "100000".into()), "row 0 of refined.csv"),
    ("the first halving left out", |f| edit_rows(f, "refined.csv", |rows| _ = rows.remove(0)), "refined.csv names"),
    ("a halving left out", |f| edit_rows(f, "refined.csv", |rows| _ = rows.remove(2)), "row 2 of refined.csv"),
    (
        "a halving twice",
        |f| edit_rows(f, "refined.csv", |rows| rows.insert(3, rows[3].clone())),
        "row 4 of refined.csv",
    ),
    ("the last halving left out", leave_out_the_last_halving, "the last, is of vertex"),
    (
        "the last halving twice",
        |f| edit_rows(f, "refined.csv", |rows| rows.extend(rows.last().cloned())),
        "one too many",
    ),
    ("the halvings removed", |f| fs::remove_file(f.join("refined.csv")).unwrap(), "refined.csv is missing"),
    ("another vertex of a flipped tet", |f| edit_cell(f, "flipped.csv", 1, 2, |_| "0".into()), "row 1 of flipped.csv"),
    (
        "another number of a flipped tet",
        |f| edit_cell(f, "flipped.csv", 0, 1, |_| "100000".into()),
        "row 0 of flipped.csv",
    ),
    (
        "flips after more halvings than there are",
        |f| edit_cell(f, "flipped.csv", 0, 0, |_| "9999".into()),
        "row 0 of flipped.csv",
    ),
    ("the last flipped tet left out", |f| leave_out_the_last_row(f, "flipped.csv"), "flipped.csv"),
    ("the flips removed", |f| fs::remove_file(f.join("flipped.csv")).unwrap(), "flipped.csv is missing"),
    ("a round's flips", |f| edit_report(f, "/refined/rounds/0/flipped", |n| json!(n.as_u64().unwrap() + 1)), "flipped"),
    ("a round's edges", |f| edit_report(f, "/refined/rounds/0/edges", |n| json!(n.as_u64().unwrap() + 1)), "edges"),
    ("the tets before", |f| edit_report(f, "/refined/tets_before", |_| json!(1)), "before"),
    ("a round that raises K", |f| edit_report(f, "/refined/rounds/0/max_k", |_| json!(1.0)), "rises"),
    ("the rounds forgotten", |f| edit_report(f, "/refined", |_| Value::Null), "refine"),
];

fn leave_out_the_last_halving(folder: &Path) {
    leave_out_the_last_row(folder, "refined.csv");
}

fn leave_out_the_last_row(folder: &Path, name: &str) {
    edit_rows(folder, name, |rows| _ = rows.pop());
}

/// Changes the rows of a table after its header.
fn edit_rows(folder: &Path, name: &str, edit: impl FnOnce(&mut Vec<String>)) {
    edit_text(folder, name, |text| {
        let mut rows: Vec<String> = text.lines().map(String::from).collect();
        let header = rows.remove(0);
        edit(&mut rows);
        rows.insert(0, header);
        rows.join("\n") + "\n"
    });
}

#[test]
fn a_refined_run_is_verified_and_every_tampering_with_it_is_found() {
    let folder = results(REFINED);
    let refined = report(folder.path()).achieved.refined.expect("rounds were asked for");
    assert!(refined.rounds.iter().map(|round| round.flipped).sum::<usize>() > 0, "{refined:?}");
    let (code, text) = qcball(&["verify"], folder.path());
    assert!(code == Some(0) && text.contains("rounds of refinement"), "{text}");
    every_one_is_found(folder.path(), TAMPERINGS_OF_REFINEMENT);
}

/// The mean of the start counts other tets once edges are halved, if not all have the same K.
#[test]
fn a_refined_run_whose_start_has_many_values_of_k_is_verified() {
    let folder = results(&[REFINED, &["mesh.subdivisions=2", "mesh.layers=3"]].concat());
    let achieved = report(folder.path()).achieved;
    assert!(achieved.initial.mean_k < 0.9 * achieved.initial.max_k && !achieved.refined.unwrap().rounds.is_empty());
    let (code, text) = qcball(&["verify"], folder.path());
    assert_eq!(code, Some(0), "{text}");
    let first = |text: &str| (text.parse::<f64>().unwrap() * 1.001).to_string();
    edit_cell(folder.path(), "trace.csv", 0, 4, first);
    let (code, text) = qcball(&["verify"], folder.path());
    assert!(code == Some(1) && text.contains("row 0 of trace.csv is not the start"), "{text}");
}

/// Without TetGen it says so and passes, unless QCBALL_EXTERNAL_REQUIRED is set.
#[test]
fn a_refined_mesh_of_tetgen_is_held_against_the_solid_and_the_start() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("case.toml");
    let text = "[domain]\nsolid = \"cube\"\n[mesh]\nkind = \"tetgen\"\n[refine]\nrounds = 3\ntets = \"20 %\"\n";
    fs::write(&config, text).unwrap();
    let out = folder.path().join("out");
    let (code, _) = qcball(&["run", &config.display().to_string(), "--quiet", "--threads", "1", "--out"], &out);
    if code == Some(2) && std::env::var_os("QCBALL_EXTERNAL_REQUIRED").is_none() {
        return eprintln!("skipped: TetGen is not there");
    }
    assert_eq!(code, Some(0));
    assert!(!report(&out).achieved.refined.unwrap().rounds.is_empty());
    let (code, text) = qcball(&["verify"], &out);
    assert!(code == Some(0) && !text.contains("and its start"), "{text}");
    every_one_is_found(
        &out,
        &[
            (
                "a new vertex moved in the domain",
                |f| edit_maps(f, |m| m.domain.soup.points.last_mut().unwrap().x += 1e-6),
                "of domain.vtu",
            ),
            (
                "a vertex of the surface moved off it",
                |f| edit_maps(f, |m| m.domain.soup.points[0] *= 1.0 + 1e-6),
                "no start",
            ),
            (
                "a new vertex moved in the start",
                |f| edit_maps(f, |m| m.start().last_mut().unwrap().x += 1e-6),
                "of the start",
            ),
            ("the last halving left out", leave_out_the_last_halving, "refined.csv"),
        ],
    );
}

/// As thin as files are taken: all tets are slivers, of which the report warns once, also where the mesh is taken from it.
#[test]
fn a_sheet_of_slivers_of_tetgens_is_verified() {
    let folder = tempfile::tempdir().unwrap();
    let corners = ["0 0 {}", "1 0 {}", "0 1 {}", "1 1 {}"];
    let points = ["0", "0.001"].map(|z| corners.map(|corner| corner.replace("{}", z)).join("\n")).join("\n");
    let faces =
        "3 0 2 1\n3 1 2 3\n3 4 5 6\n3 5 7 6\n3 0 1 4\n3 1 5 4\n3 2 6 3\n3 3 6 7\n3 0 4 2\n3 2 4 6\n3 1 3 5\n3 3 7 5\n";
    fs::write(folder.path().join("sheet.off"), format!("OFF\n8 12 0\n{points}\n{faces}")).unwrap();
    let config = folder.path().join("case.toml");
    fs::write(&config, "[domain]\nfile = \"sheet.off\"\n[mesh]\nkeep_boundary = true\n").unwrap();
    let out = folder.path().join("out");
    let (code, _) = qcball(&["run", &config.display().to_string(), "--quiet", "--threads", "1", "--out"], &out);
    let is_there = report(&out).domain.centre.is_none();
    if !is_there && std::env::var_os("QCBALL_EXTERNAL_REQUIRED").is_none() {
        return eprintln!("skipped: TetGen is not there");
    }
    let warnings = report(&out).warnings;
    assert!(code == Some(0) && warnings.iter().filter(|words| words.contains("sliver")).count() == 1, "{warnings:?}");
    let (code, text) = qcball(&["verify"], &out);
    assert_eq!(code, Some(0), "{text}");
}

const OF_SURFACE: &[&str] = &["mesh.layers=2", "refine.rounds=4", "refine.tets=\"400 %\"", "refine.surface=true"];

/// Changes the last vertex on the boundary, a new one, in the domain or in the image.
fn last_on_surface(folder: &std::path::Path, of_image: bool, change: fn(&mut Vec3)) {
    edit_maps(folder, |maps| {
        let boundary = Boundary::of(
            &TetMesh::from_either_orientation(maps.domain.soup.points.clone(), maps.domain.soup.tets.clone())
                .unwrap()
                .0,
        );
        let vertex = boundary.unwrap().vertex_mask().iter().rposition(|on| *on).unwrap();
        let soup = if of_image { &mut maps.image.soup } else { &mut maps.domain.soup };
        change(&mut soup.points[vertex]);
    });
}

/// The same of a run with refinement of the surface.
const TAMPERINGS_OF_SURFACE: &[Tampering] = &[
    ("a new vertex moved off its face", |f| last_on_surface(f, false, |p| *p *= 1.0 + 1e-6), "of domain.vtu"),
    (
        "a new vertex moved on the sphere",
        |f| {
            last_on_surface(f, true, |p| {
                let norm = p.norm();
                *p += Vec3::new(1e-6, -2e-6, 1e-6);
                *p *= norm / p.norm();
            });
        },
        "of image.vtu",
    ),
    ("the surface forgotten", |f| edit_report(f, "/refined/surface", |_| json!(false)), "surface"),
    ("a round that raises K", |f| edit_report(f, "/refined/rounds/0/max_k", |_| json!(1.0)), "rises"),
    (
        "another edge halved",
        |f| edit_cell(f, "refined.csv", 0, 1, |from| if from == "0" { "1".into() } else { "0".into() }),
        "refined.csv",
    ),
];

#[test]
fn a_refined_surface_is_verified_and_every_tampering_with_it_is_found() {
    let folder = results(OF_SURFACE);
    let achieved = report(folder.path()).achieved;
    let refined = achieved.refined.expect("rounds were asked for");
    assert!(refined.surface && !refined.rounds.is_empty(), "{refined:?}");
    assert!(achieved.last.ball_k.unwrap().certified < refined.max_k_before.unwrap());
    let (code, text) = qcball(&["verify"], folder.path());
    assert!(code == Some(0) && text.contains("rounds of refinement"), "{text}");
    every_one_is_found(folder.path(), TAMPERINGS_OF_SURFACE);
}

#[test]
fn a_refined_surface_that_slides_is_verified() {
    let folder = results(&[OF_SURFACE, &["boundary.values=\"sliding\""]].concat());
    let (code, text) = qcball(&["verify"], folder.path());
    assert_eq!(code, Some(0), "{text}");
}

/// Corner elements are made again around the corners of the finer mesh; what the map is like there is its own.
#[test]
fn a_refined_surface_with_powers_at_corners_is_verified() {
    for corners in ["1.4", "\"power\""] {
        let corners = format!("boundary.corners={corners}");
        let folder = results(&[OF_SURFACE, &["boundary.values=\"sliding\"", &corners]].concat());
        let achieved = report(folder.path()).achieved;
        let refined = achieved.refined.expect("rounds were asked for");
        assert!(!refined.rounds.is_empty() && achieved.last.ball_k.unwrap().certified < refined.max_k_before.unwrap());
        let (code, text) = qcball(&["verify"], folder.path());
        assert_eq!(code, Some(0), "{text}");
        every_one_is_found(
            folder.path(),
            &[
                ("another exponent", |f| edit_cell(f, "corners.csv", 0, 4, |_| "1.5".into()), "corners.csv"),
                ("the last halving left out", leave_out_the_last_halving, "refined.csv"),
            ],
        );
    }
}

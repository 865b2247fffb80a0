//! `qcball verify` accepts what `qcball run` wrote and finds every way it was tampered with.

mod certificate;
mod folder;
mod forgeries;
mod refined;

use std::fs;

use serde_json::{Value, json};

use folder::{
    Tampering, edit_cell, edit_maps, edit_report, edit_text, every_one_is_found, forge, qcball, results, scale,
};

/// What is done, and a word of what has to be found. Vertex 0 is the centre; those from 79 on lie on the boundary.
const TAMPERINGS: &[Tampering] = &[
    ("an interior image vertex moved by 1e-9", |f| edit_maps(f, |m| m.image.soup.points[40].x += 1e-9), "k_"),
    ("a boundary image vertex moved", |f| edit_maps(f, |m| m.image.soup.points[100].y += 1e-9), "boundary vertex 100"),
    ("a domain vertex moved", |f| edit_maps(f, |m| m.domain.soup.points[40].z += 1e-9), "vertex 40 of domain.vtu"),
    (
        "the domain scaled",
        |f| edit_maps(f, |m| m.domain.soup.points.iter_mut().for_each(|p| *p *= 2.0)),
        "domain.volume",
    ),
    ("an image vertex pushed through a face", |f| edit_maps(f, |m| m.image.soup.points[0].x = 0.9), "final.flipped"),
    ("two vertices of a domain tet exchanged", |f| edit_maps(f, |m| m.domain.soup.tets[3].swap(0, 1)), "tet 3"),
    ("the vertices of an image tet rotated", |f| edit_maps(f, |m| m.image.soup.tets[3][..3].rotate_left(1)), "tet 3"),
    (
        "a tet turned over in both meshes",
        |f| {
            edit_maps(f, |m| {
                m.domain.soup.tets[3].swap(0, 1);
                m.image.soup.tets[3].swap(0, 1);
            });
        },
        "negative volume",
    ),
    (
        "two tets exchanged in both meshes",
        |f| {
            edit_maps(f, |m| {
                m.domain.soup.tets.swap(3, 200);
                m.image.soup.tets.swap(3, 200);
            });
        },
        "not the mesh that the config makes",
    ),
    (
        "a tet left out of both meshes",
        |f| {
            edit_maps(f, |m| {
                for file in [&mut m.domain, &mut m.image] {
                    file.soup.tets.pop();
                    file.cell_data.iter_mut().for_each(|(_, values)| values.truncate(values.len() - 1));
                }
            });
        },
        "rows for",
    ),
    ("K on a cell of image.vtu", |f| edit_maps(f, |m| m.image.cell_data[0].1[5] *= 0.999), "image.vtu is not"),
    ("the start", |f| edit_maps(f, |m| m.start()[40].x += 1e-9), "vertex 40 of the start"),
    ("K of a cell", |f| edit_cell(f, "cells.csv", 5, 7, |_| "1.5".into()), "tet 5"),
    ("K_I of a cell before", |f| edit_cell(f, "cells.csv", 5, 2, |_| "9.5".into()), "tet 5: K at the start"),
    ("the active flag of a cell", |f| edit_cell(f, "cells.csv", 5, 8, |on| (on != "true").to_string()), "active"),
    ("the volume of a cell", |f| edit_cell(f, "cells.csv", 5, 1, |_| "0.5".into()), "cells.csv is not"),
    ("the largest K", |f| scale(f, "/final/max_k", 1.0 - 1e-9), "final.max_k"),
    ("the mean K", |f| scale(f, "/final/mean_k", 1.0 - 1e-9), "final.mean_k"),
    ("a quantile", |f| scale(f, "/final/p99_k", 0.99), "final.p99_k"),
    ("the largest K of the start", |f| scale(f, "/initial/max_k", 2.0), "initial.max_k"),
    ("the number of flipped tets", |f| edit_report(f, "/final/flipped", |_| json!(1)), "flipped"),
    ("a bound raised", |f| scale(f, "/bounds/0/value", 1.0 + 1e-6), "bounds[0].value"),
    ("a bound renamed", |f| edit_report(f, "/bounds/1/name", |_| json!("caraman")), "bounds[1].name"),
    (
        "a bound's scope",
        |f| edit_report(f, "/bounds/1/scope", |_| json!("any qc map of the solid onto the ball")),
        "scope",
    ),
    ("a bound's kind", |f| edit_report(f, "/bounds/0/kind", |_| json!("K_I")), "kind"),
    ("a bound's place", |f| edit_report(f, "/bounds/0/place", |_| json!(null)), "place"),
    (
        "a quoted bound called proved",
        |f| {
            edit_report(f, "/bounds", |bounds| {
                let mut bounds = bounds.clone();
                bounds.as_array_mut().unwrap().iter_mut().for_each(|bound| bound["certified"] = json!(true));
                bounds
            });
        },
        "certified",
    ),
    (
        "a bound of other maps made to apply",
        |f| {
            edit_report(f, "/bounds", |bounds| {
                let mut bounds = bounds.clone();
                bounds.as_array_mut().unwrap().iter_mut().for_each(|bound| bound["applies"] = json!(true));
                bounds
            });
        },
        "applies",
    ),
    (
        "a bound left out",
        |f| {
            edit_report(f, "/bounds", |bounds| json!(bounds.as_array().unwrap()[1..]));
        },
        "bounds",
    ),
    ("the best bound", |f| scale(f, "/best_bound", 1.001), "best_bound"),
    ("the gap", |f| scale(f, "/gap", 0.9999), "gap"),
    ("the limit", |f| edit_report(f, "/limit/sentence", |_| json!("nothing can be better")), "limit"),
    ("bijective", |f| edit_report(f, "/bijective", |_| json!(false)), "bijective"),
    ("the number of active tets", |f| edit_report(f, "/active", |_| json!(1)), "active"),
    ("the bottleneck", |f| edit_report(f, "/bottleneck/tet", |_| json!(7)), "bottleneck"),
    ("the number of vertices", |f| edit_report(f, "/domain/vertices", |_| json!(106)), "domain.vertices"),
    ("the smallest angle", |f| scale(f, "/domain/smallest_dihedral_angle", 1.01), "dihedral"),
    ("the centre", |f| edit_report(f, "/domain/centre", |_| json!([0.1, 0.0, 0.0])), "domain.centre"),
    ("the stop reason", |f| edit_report(f, "/stop", |_| json!("converged")), "stop reason"),
    ("the KKT residual", |f| edit_report(f, "/kkt/dual", |_| json!(0.1)), "kkt"),
    ("the number of iterations", |f| edit_report(f, "/iterations", |_| json!(7)), "iterations"),
    (
        "the config's text",
        |f| {
            edit_report(f, "/config_text", |text| json!(text.as_str().unwrap().replace("layers = 4", "layers = 5")));
        },
        "config_hash",
    ),
    ("an override", |f| edit_report(f, "/overrides", |_| json!(["mesh.layers=5"])), "config_hash"),
    // Of 48 triangles in 300^2 parts, 10 tets each: refused before it is made.
    (
        "a mesh that would take minutes",
        |f| edit_report(f, "/overrides", |_| json!(["mesh.subdivisions=300"])),
        "the config makes a mesh of at least 43200000 tets",
    ),
    (
        "a row of the trace cut",
        |f| {
            edit_text(f, "trace.csv", |text| text.lines().take(20).map(|line| line.to_string() + "\n").collect());
        },
        "trace.csv",
    ),
    (
        "a figure of the summary",
        |f| edit_text(f, "summary.txt", |text| text.replace("\nfinal  ", "\nfinal 1")),
        "summary.txt is not",
    ),
    ("a file removed", |f| fs::remove_file(f.join("cells.csv")).unwrap(), "cells.csv"),
    ("a mesh removed", |f| fs::remove_file(f.join("image.vtu")).unwrap(), "image.vtu"),
    (
        "a mesh cut short",
        |f| {
            let bytes = fs::read(f.join("domain.vtu")).unwrap();
            fs::write(f.join("domain.vtu"), &bytes[..bytes.len() / 2]).unwrap();
        },
        "domain.vtu",
    ),
    ("a certificate of nothing", |f| fs::write(f.join("certificate.json"), "{}").unwrap(), "certificate"),
    (
        "text added to the summary",
        |f| edit_text(f, "summary.txt", |text| text + "proved by nobody\n"),
        "summary.txt is not",
    ),
    (
        "a centre that is none",
        |f| edit_text(f, "report.json", |text| text.replace("\"centre\": [", "\"centre\": [\"0\", ")),
        "no record",
    ),
    (
        "a key too much",
        |f| edit_text(f, "report.json", |text| text.replacen('{', "{\n  \"extra\": 1,", 1)),
        "report.json is not",
    ),
    (
        "a key twice",
        |f| edit_text(f, "report.json", |text| text.replace("  \"seed\": 0,", "  \"seed\": 0,\n  \"seed\": 0,")),
        "report.json",
    ),
    (
        "a flat key twice",
        |f| edit_text(f, "report.json", |text| text.replacen("  \"gap\": ", "  \"gap\": 1.0,\n  \"gap\": ", 1)),
        "report.json",
    ),
    ("the map", |f| edit_report(f, "/map", |_| json!("radial, exponent 2")), "map is reported"),
    ("the map's exponent", |f| edit_report(f, "/radial_exponent", |_| json!(2.0)), "radial_exponent is"),
    ("the smooth map's K", |f| scale(f, "/radial_smooth_k", 0.9), "radial_smooth_k is"),
    ("the seed", |f| edit_report(f, "/seed", |_| json!(7)), "seed is"),
    ("the name", |f| edit_report(f, "/name", |_| json!("other")), "name is"),
    ("the hash of an input", |f| edit_report(f, "/input_hash", |_| json!("0")), "input_hash is"),
    ("a warning", |f| edit_report(f, "/warnings", |_| json!(["all is well"])), "warnings is"),
    ("the hash of the trace", |f| edit_report(f, "/trace_hash", |_| json!("0")), "trace_hash is"),
    (
        "the trace emptied",
        |f| {
            edit_text(f, "trace.csv", |text| text.lines().next().unwrap().to_string() + "\n");
            forge(f, |report| {
                report.achieved.iterations = 0;
                report.achieved.stop = qcball::optimize::StopReason::Optimal;
            });
        },
        "trace.csv has no row",
    ),
    ("the trace in its middle", |f| edit_cell(f, "trace.csv", 9, 2, |_| "0.5".into()), "trace_hash is"),
    ("a file too much", |f| fs::write(f.join("proof.txt"), "it is").unwrap(), "proof.txt is no file of a run"),
    (
        "halvings of another run",
        |f| fs::write(f.join("refined.csv"), "x\n").unwrap(),
        "refined.csv is there, but it has",
    ),
    ("flips of another run", |f| fs::write(f.join("flipped.csv"), "x\n").unwrap(), "flipped.csv is there, but it has"),
    (
        "a second K on the cells",
        |f| {
            edit_text(f, "image.vtu", |text| {
                let at = text.find("<DataArray type=\"Float64\" Name=\"K\"").unwrap();
                let array = &text[at..at + text[at..].find("</DataArray>").unwrap()];
                text.replace("</CellData>", &format!("{array}</DataArray>\n</CellData>"))
            });
        },
        "image.vtu is not",
    ),
    (
        "second points",
        |f| {
            edit_text(f, "domain.vtu", |text| {
                let (from, to) = (text.find("<Points>").unwrap(), text.find("<Cells>").unwrap());
                text.replace("<Cells>", &format!("{}<Cells>", &text[from..to]))
            });
        },
        "domain.vtu is not",
    ),
    ("a gap below 1", |f| edit_report(f, "/gap", |_| json!(0.99)), "gap is"),
    (
        "a column too much",
        |f| edit_text(f, "cells.csv", |text| text.replacen('\n', ",extra\n", 1).replace("e\n", "e,1\n")),
        "cells.csv",
    ),
];

#[test]
fn a_fresh_run_is_verified() {
    let folder = results(&[]);
    let (code, text) = qcball(&["verify"], folder.path());
    assert!(code == Some(0) && text.ends_with("verified\n") && !text.contains("FAILS"), "{text}");
    let (code, text) = qcball(&["verify", "--json"], folder.path());
    let json: Value = serde_json::from_str(&text).unwrap();
    assert!(code == Some(0) && json["verified"] == true && json["discrepancies"] == json!([]), "{text}");
    let report: Value = serde_json::from_str(&fs::read_to_string(folder.path().join("report.json")).unwrap()).unwrap();
    let [upper, reported] = [&json["max_k_upper"], &report["final"]["max_k"]].map(|value| value.as_f64().unwrap());
    // The edges' conditions are below 100, so that rounding is below 1e-10.
    assert!(upper >= reported && upper < reported * (1.0 + 1e-10), "{upper} {reported}");
}

#[test]
fn honest_runs_of_every_kind_are_verified() {
    for overrides in [
        &["optimize.polish=lexicographic", "optimize.levels=2"][..],
        &["domain.solid=star-polyhedron", "domain.amplitude=0.5", "optimize.polish=lexicographic", "optimize.levels=2"],
        &["optimize.objective=soft-max", "optimize.exponent=8"],
        &["optimize.max_iterations=0"],
        &["optimize.time_limit=1e-9"],
        &["map.exponent=optimize", "mesh.grading=2"],
        &["domain.solid=ellipsoid", "domain.radii=[10, 1, 0.5]", "domain.resolution=2"],
    ] {
        let (code, text) = qcball(&["verify"], results(overrides).path());
        assert!(code == Some(0), "{overrides:?}: {text}");
    }
}

#[test]
fn a_boundary_that_slid_is_verified_on_its_sphere() {
    let folder = results(&["boundary.values=sliding"]);
    let (code, text) = qcball(&["verify"], folder.path());
    assert!(code == Some(0), "{text}");
    every_one_is_found(
        folder.path(),
        &[
            (
                "a vertex off the sphere",
                |f| edit_maps(f, |m| m.image.soup.points[100] *= 1.0 + 1e-9),
                "not on the sphere",
            ),
            (
                "a vertex moved along the sphere",
                |f| {
                    edit_maps(f, |m| {
                        let [x, y] = [m.image.soup.points[100].x, m.image.soup.points[100].y];
                        let (sine, cosine) = 1e-6f64.sin_cos();
                        m.image.soup.points[100].x = cosine * x - sine * y;
                        m.image.soup.points[100].y = sine * x + cosine * y;
                    });
                },
                "k_",
            ),
        ],
    );
}

/// What the helpers of these tests write is what was there, but for what they change.
#[test]
fn nothing_is_found_where_nothing_was_changed() {
    let folder = results(&[]);
    edit_maps(folder.path(), |_| {});
    forge(folder.path(), |_| {});
    let (code, text) = qcball(&["verify"], folder.path());
    assert!(code == Some(0), "{text}");
}

#[test]
fn every_tampering_is_found() {
    every_one_is_found(results(&[]).path(), TAMPERINGS);
}

#[test]
fn a_failure_is_told_in_words() {
    let folder = results(&[]);
    scale(folder.path(), "/final/max_k", 0.5);
    let (code, text) = qcball(&["verify"], folder.path());
    assert!(code == Some(1) && text.contains("FAILS") && text.ends_with("NOT verified\n"), "{text}");
    assert!(text.contains("\nmax K <= ") && !text.contains("max K <=  "), "{text}");
    fs::remove_file(folder.path().join("cells.csv")).unwrap();
    let (code, text) = qcball(&["verify"], folder.path());
    assert!(code == Some(1) && text.contains("or run the config again"), "{text}");
}

#[test]
fn what_is_no_results_folder_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(qcball(&["verify"], folder.path()).0, Some(2));
    for text in ["", "{", "[]", "{}", "{\"final\": 3}"] {
        fs::write(folder.path().join("report.json"), text).unwrap();
        assert_eq!(qcball(&["verify"], folder.path()).0, Some(2), "{text}");
    }
}

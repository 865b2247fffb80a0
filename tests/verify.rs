//! `qcball verify` accepts what `qcball run` wrote and finds every way it was tampered with.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use assert_cmd::cargo::cargo_bin;
use qcball::mesh::io::{TetFile, read_tet_file, write_tets};
use serde_json::{Value, json};

fn qcball(arguments: &[&str], folder: &Path) -> (Option<i32>, String) {
    let mut command = Command::new(cargo_bin!("qcball"));
    let output = command.current_dir(env!("CARGO_MANIFEST_DIR")).args(arguments).arg(folder).output().unwrap();
    (output.status.code(), String::from_utf8(output.stdout).unwrap())
}

/// The results of the smoke case.
fn results() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let (code, _) = qcball(&["run", "configs/smoke.toml", "--quiet", "--threads", "1", "--out"], folder.path());
    assert_eq!(code, Some(0));
    folder
}

fn edit_text(folder: &Path, name: &str, edit: impl FnOnce(String) -> String) {
    let path = folder.join(name);
    let text = fs::read_to_string(&path).unwrap();
    let edited = edit(text.clone());
    assert_ne!(text, edited, "{name} was not changed");
    fs::write(path, edited).unwrap();
}

/// Replaces a value of the report, given by its pointer.
fn edit_report(folder: &Path, pointer: &str, edit: impl FnOnce(&Value) -> Value) {
    edit_text(folder, "report.json", |text| {
        let mut report: Value = serde_json::from_str(&text).unwrap();
        let value = report.pointer_mut(pointer).unwrap_or_else(|| panic!("{pointer} is not in the report"));
        *value = edit(value);
        serde_json::to_string_pretty(&report).unwrap()
    });
}

fn scale(folder: &Path, pointer: &str, factor: f64) {
    edit_report(folder, pointer, |value| json!(value.as_f64().unwrap() * factor));
}

fn edit_mesh(folder: &Path, name: &str, edit: impl FnOnce(&mut TetFile)) {
    let path = folder.join(name);
    let mut file = read_tet_file(&path).unwrap();
    edit(&mut file);
    write_tets(&path, &file.soup.points, &file.soup.tets, &file.cell_data).unwrap();
}

/// Changes a field of a row of a table, both counted from 0, the header not counted.
fn edit_cell(folder: &Path, name: &str, row: usize, column: usize, edit: impl FnOnce(&str) -> String) {
    edit_text(folder, name, |text| {
        let mut lines: Vec<String> = text.lines().map(String::from).collect();
        let mut fields: Vec<String> = lines[row + 1].split(',').map(String::from).collect();
        fields[column] = edit(&fields[column]);
        lines[row + 1] = fields.join(",");
        lines.join("\n") + "\n"
    });
}

/// The results of the smoke case with a certificate.
fn certified_results() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["run", "configs/smoke.toml", "--quiet", "--threads", "1", "--set", "bounds.certify=true", "--out"];
    assert_eq!(qcball(&arguments, folder.path()).0, Some(0));
    assert!(folder.path().join("certificate.json").exists());
    folder
}

fn edit_certificate(folder: &Path, edit: impl FnOnce(&mut Value)) {
    edit_text(folder, "certificate.json", |text| {
        let mut certificate: Value = serde_json::from_str(&text).unwrap();
        edit(&mut certificate);
        certificate.to_string()
    });
}

/// The entry of a list of numbers, or of lists of six of them, that is largest in absolute value.
fn largest(list: &mut Value) -> &mut Value {
    let mut numbers: Vec<&mut Value> = Vec::new();
    for entry in list.as_array_mut().unwrap() {
        if entry.is_array() { numbers.extend(entry.as_array_mut().unwrap()) } else { numbers.push(entry) }
    }
    let size = |value: &Value| value.as_f64().unwrap().abs();
    numbers.into_iter().max_by(|a, b| size(a).total_cmp(&size(b))).unwrap()
}

fn scale_largest(list: &mut Value, factor: f64) {
    let entry = largest(list);
    *entry = json!(entry.as_f64().unwrap() * factor);
}

type Tampering = (&'static str, fn(&Path), &'static str);

/// What is done, and a word of what has to be found. Vertex 0 is the centre; those from 79 on lie on the boundary.
const TAMPERINGS: &[Tampering] = &[
    ("an interior image vertex moved by 1e-9", |f| edit_mesh(f, "image.vtu", |m| m.soup.points[40].x += 1e-9), "k_"),
    ("a boundary image vertex moved", |f| edit_mesh(f, "image.vtu", |m| m.soup.points[100].y += 1e-9), "projection"),
    ("a domain vertex moved", |f| edit_mesh(f, "domain.vtu", |m| m.soup.points[40].z += 1e-9), "tet"),
    (
        "the domain scaled",
        |f| edit_mesh(f, "domain.vtu", |m| m.soup.points.iter_mut().for_each(|p| *p *= 2.0)),
        "volume",
    ),
    (
        "an image vertex pushed through a face",
        |f| edit_mesh(f, "image.vtu", |m| m.soup.points[0].x = 0.9),
        "not positive",
    ),
    ("two vertices of a domain tet exchanged", |f| edit_mesh(f, "domain.vtu", |m| m.soup.tets[3].swap(0, 1)), "tet 3"),
    (
        "the vertices of an image tet rotated",
        |f| edit_mesh(f, "image.vtu", |m| m.soup.tets[3][..3].rotate_left(1)),
        "tet 3",
    ),
    (
        "a tet turned over in both meshes",
        |f| {
            for name in ["domain.vtu", "image.vtu"] {
                edit_mesh(f, name, |m| m.soup.tets[3].swap(0, 1));
            }
        },
        "negative volume",
    ),
    (
        "two tets exchanged in both meshes",
        |f| {
            for name in ["domain.vtu", "image.vtu"] {
                edit_mesh(f, name, |m| m.soup.tets.swap(3, 400));
            }
        },
        "tet",
    ),
    (
        "a tet left out of both meshes",
        |f| {
            for name in ["domain.vtu", "image.vtu"] {
                edit_mesh(f, name, |m| {
                    m.soup.tets.pop();
                    m.cell_data.iter_mut().for_each(|(_, values)| values.truncate(values.len() - 1));
                });
            }
        },
        "rows for",
    ),
    ("K on a cell of image.vtu", |f| edit_mesh(f, "image.vtu", |m| m.cell_data[0].1[5] *= 0.999), "K ="),
    ("K of a cell", |f| edit_cell(f, "cells.csv", 5, 7, |_| "1.5".into()), "tet 5"),
    ("K_I of a cell before", |f| edit_cell(f, "cells.csv", 5, 2, |_| "9.5".into()), "initial"),
    ("the active flag of a cell", |f| edit_cell(f, "cells.csv", 5, 8, |on| (on != "true").to_string()), "active"),
    ("the volume of a cell", |f| edit_cell(f, "cells.csv", 5, 1, |_| "0.5".into()), "volume"),
    ("the largest K", |f| scale(f, "/final/max_k", 1.0 - 1e-9), "final.max_k"),
    ("the mean K", |f| scale(f, "/final/mean_k", 1.0 - 1e-9), "final.mean_k"),
    ("a quantile", |f| scale(f, "/final/p99_k", 0.99), "final.p99_k"),
    ("the largest K of the start", |f| scale(f, "/initial/max_k", 2.0), "initial.max_k"),
    ("the number of flipped tets", |f| edit_report(f, "/final/flipped", |_| json!(1)), "flipped"),
    ("a bound raised", |f| scale(f, "/bounds/0/value", 1.0 + 1e-6), "bounds[0].value"),
    ("a bound renamed", |f| edit_report(f, "/bounds/1/name", |_| json!("other")), "bounds[1].name"),
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
    ("the centre", |f| edit_report(f, "/domain/centre", |_| json!([0.1, 0.0, 0.0])), "projection"),
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
        "summary",
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
];

/// The same of a run with a certificate.
const TAMPERINGS_OF_CERTIFICATE: &[Tampering] = &[
    ("an entry of a factor of S", |f| edit_certificate(f, |c| scale_largest(&mut c["lower"], 0.9)), "certificate"),
    ("an entry of a factor of R", |f| edit_certificate(f, |c| scale_largest(&mut c["upper"], 1.1)), "certificate"),
    ("a multiplier of a trace", |f| edit_certificate(f, |c| *largest(&mut c["trace"]) = json!(-1.0)), "certificate"),
    (
        "the level raised",
        |f| edit_certificate(f, |c| c["level"] = json!(c["level"].as_f64().unwrap() * 1.01)),
        "certificate",
    ),
    // Less is proved than the report says.
    (
        "the level lowered",
        |f| edit_certificate(f, |c| c["level"] = json!(c["level"].as_f64().unwrap() * 0.99)),
        "bounds",
    ),
    (
        "a tet's index",
        |f| {
            edit_certificate(f, |c| {
                let last = c["tets"].as_array_mut().unwrap().last_mut().unwrap();
                *last = json!(last.as_u64().unwrap() + 1_000_000);
            });
        },
        "certificate",
    ),
    (
        "two tets exchanged",
        |f| {
            edit_certificate(f, |c| c["tets"].as_array_mut().unwrap().swap(0, 1));
        },
        "certificate",
    ),
    ("a list cut", |f| edit_certificate(f, |c| drop(c["trace"].as_array_mut().unwrap().pop())), "certificate"),
    (
        "a negative multiplier of determinants",
        |f| edit_certificate(f, |c| c["determinant"] = json!(vec![[-1e-9, 1.0]; c["tets"].as_array().unwrap().len()])),
        "certificate",
    ),
    (
        "a multiplier of determinants without its tangent",
        |f| edit_certificate(f, |c| c["determinant"] = json!(vec![[1e-9, 0.0]; c["tets"].as_array().unwrap().len()])),
        "certificate",
    ),
    (
        "a multiplier of cofactors enlarged",
        |f| edit_certificate(f, |c| c["cofactor"] = json!(vec![[[1.0; 9]; 2]; c["tets"].as_array().unwrap().len()])),
        "certificate",
    ),
    ("the file removed", |f| fs::remove_file(f.join("certificate.json")).unwrap(), "bounds"),
    ("the file cut short", |f| edit_text(f, "certificate.json", |text| text[..text.len() / 2].into()), "certificate"),
    (
        "the proved bound raised",
        |f| {
            edit_report(f, "/bounds", |bounds| {
                let mut bounds = bounds.clone();
                let gram = bounds.as_array_mut().unwrap().iter_mut().find(|bound| bound["name"] == "gram").unwrap();
                gram["value"] = json!(gram["value"].as_f64().unwrap() * 1.001);
                bounds
            });
        },
        "value",
    ),
    ("an iteration of the trace", |f| edit_cell(f, "trace.csv", 5, 1, |_| "7".into()), "trace.csv"),
];

#[test]
fn a_fresh_run_is_verified() {
    let folder = results();
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
fn every_tampering_is_found() {
    every_one_is_found(results().path(), TAMPERINGS);
}

#[test]
fn every_tampering_with_a_certificate_is_found() {
    let folder = certified_results();
    let (code, text) = qcball(&["verify"], folder.path());
    assert!(code == Some(0) && text.contains("the certificate proves its bound"), "{text}");
    every_one_is_found(folder.path(), TAMPERINGS_OF_CERTIFICATE);
}

fn every_one_is_found(original: &Path, tamperings: &[Tampering]) {
    for (what, tamper, word) in tamperings {
        let copy = tempfile::tempdir().unwrap();
        for entry in fs::read_dir(original).unwrap() {
            let path = entry.unwrap().path();
            // The folder of plots is made from the files and not looked at.
            if path.is_file() {
                fs::copy(&path, copy.path().join(path.file_name().unwrap())).unwrap();
            }
        }
        tamper(copy.path());
        let (code, text) = qcball(&["verify", "--json"], copy.path());
        assert_eq!(code, Some(1), "{what}: {text}");
        let json: Value = serde_json::from_str(&text).unwrap();
        let found = json["discrepancies"].as_array().unwrap();
        assert!(json["verified"] == false && !found.is_empty(), "{what}: {text}");
        assert!(found.iter().any(|line| line.as_str().unwrap().contains(word)), "{what}: no {word:?} in {text}");
    }
}

#[test]
fn a_failure_is_told_in_words() {
    let folder = results();
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

#[test]
fn a_certificate_is_found_again_from_the_two_meshes() {
    let folder = certified_results();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let report: Value = serde_json::from_str(&fs::read_to_string(at("report.json")).unwrap()).unwrap();
    let bounds = |file: &str, more: &[&str]| {
        let mut arguments = vec!["bounds", "--certify", "--json", "--certificate", file];
        arguments.extend(more);
        let (domain, image) = (at("domain.vtu"), at("image.vtu"));
        let mut command = Command::new(cargo_bin!("qcball"));
        command.args(arguments).args([domain, image]).output().unwrap()
    };
    let output = bounds(&at("again.json"), &[]);
    assert_eq!(output.status.code(), Some(0));
    let printed: Value = serde_json::from_slice(&output.stdout).unwrap();
    let gram = |json: &Value| {
        json["bounds"]
            .as_array()
            .unwrap()
            .iter()
            .find(|bound| bound["name"] == "gram")
            .map(|bound| bound["value"].clone())
    };
    // The same search from the same positions.
    assert!(gram(&printed).is_some() && gram(&printed) == gram(&report), "{printed}");
    assert_eq!(fs::read(at("again.json")).unwrap(), fs::read(at("certificate.json")).unwrap());
    // Without time nothing is found, and the run ended without what was asked.
    let output = bounds(&at("none.json"), &["--time-limit", "1e-9"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("no certificate was found"));
    assert!(!folder.path().join("none.json").exists());
    // The certificate may not replace one of the meshes.
    assert_eq!(bounds(&at("image.vtu"), &[]).status.code(), Some(2));
}

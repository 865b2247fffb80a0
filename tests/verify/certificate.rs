//! Tampering with certificates, and finding them again.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use assert_cmd::cargo::cargo_bin;
use serde_json::{Value, json};

use super::folder::{Tampering, edit_cell, edit_report, edit_text, every_one_is_found, qcball, results};

/// The results of the smoke case with a certificate.
fn certified_results() -> tempfile::TempDir {
    let folder = results(&["bounds.certify=true"]);
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
fn every_tampering_with_a_certificate_is_found() {
    let folder = certified_results();
    let (code, text) = qcball(&["verify"], folder.path());
    assert!(code == Some(0) && text.contains("the certificate proves its bound"), "{text}");
    every_one_is_found(folder.path(), TAMPERINGS_OF_CERTIFICATE);
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

//! `qcball run` as somebody calls it who has a file and no config, and what `--version` and `--dry-run` tell.

use std::fs;
use std::path::Path;
use std::process::Output;

use assert_cmd::Command;
use assert_cmd::cargo::cargo_bin;
use serde_json::Value;

fn qcball(folder: &Path, arguments: &[&str], input: &str) -> Output {
    let mut command = Command::new(cargo_bin!("qcball"));
    command.current_dir(folder).args(arguments).write_stdin(input).output().unwrap()
}

fn printed(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    String::from_utf8(output.stdout.clone()).unwrap()
}

/// An octahedron, in a folder of its own.
fn place() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let off = "OFF\n6 8 0\n1 0 0\n-1 0 0\n0 1 0\n0 -1 0\n0 0 1\n0 0 -1\n\
               3 0 2 4\n3 2 1 4\n3 1 3 4\n3 3 0 4\n3 2 0 5\n3 1 2 5\n3 3 1 5\n3 0 3 5\n";
    fs::create_dir(folder.path().join("parts")).unwrap();
    fs::write(folder.path().join("parts/gem [1].off"), off).unwrap();
    folder
}

const COARSE: [&str; 6] = ["--set", "mesh.subdivisions=1", "--set", "mesh.layers=2", "--set", "optimize.objective=max"];

fn report(folder: &Path, name: &str) -> Value {
    serde_json::from_slice(&fs::read(folder.join("results").join(name).join("report.json")).unwrap()).unwrap()
}

#[test]
fn a_solid_by_its_name_alone_is_run_as_by_the_least_config() {
    let folder = place();
    let by_name = [&["run", "parts/gem [1].off", "--quiet"], &COARSE[..]].concat();
    printed(&qcball(folder.path(), &by_name, ""));
    let config = "name = \"piped\"\n[domain]\nfile = \"parts/gem [1].off\"\n";
    printed(&qcball(folder.path(), &[&["run", "-", "--quiet"], &COARSE[..]].concat(), config));
    let [named, piped] = ["gem [1]", "piped"].map(|name| report(folder.path(), name));
    assert_eq!(named["final"], piped["final"]);
    assert_eq!(named["input_hash"], piped["input_hash"]);
    // Where to look is said last.
    let said = printed(&qcball(folder.path(), &[&["run", "parts/gem [1].off"], &COARSE[..]].concat(), ""));
    assert!(said.ends_with("\nresults     results/gem [1]\npage        results/gem [1]/report.html\n"), "{said}");
    // A folder made without a config is as good as any.
    printed(&qcball(folder.path(), &["verify", "results/gem [1]"], ""));
}

#[test]
fn a_config_on_standard_input_may_lack_a_name_but_not_a_solid() {
    let folder = tempfile::tempdir().unwrap();
    printed(&qcball(folder.path(), &[&["run", "-", "--quiet"], &COARSE[..]].concat(), "[domain]\nsolid = \"cube\"\n"));
    assert_eq!(report(folder.path(), "stdin")["name"], "stdin");
    let output = qcball(folder.path(), &["run", "-"], "");
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && error.contains("no solid is given"), "{error}");
}

#[test]
fn a_dry_run_tells_the_mesh_and_writes_nothing() {
    let folder = place();
    let text = printed(&qcball(folder.path(), &[&["run", "parts/gem [1].off", "--dry-run"], &COARSE[..]].concat(), ""));
    // 8 triangles in 2 layers: an inner tet and an outer prism of 3 tets each, on 6 + 6 + 1 vertices.
    assert!(text.contains("13 vertices (6 on the boundary), 32 tets"), "{text}");
    assert!(text.contains("nothing was written") && !folder.path().join("results").exists(), "{text}");
    assert!(!text.contains("corners  ") && !text.contains("symmetric  ") && !text.contains("refined  "), "{text}");
}

#[test]
fn a_dry_run_tells_of_corners_symmetry_and_refinement() {
    let folder = tempfile::tempdir().unwrap();
    let dry_run = |config: &str| qcball(folder.path(), &["run", "-", "--dry-run"], config);
    let coarse = "[domain]\nsolid = \"cube\"\n[mesh]\nsubdivisions = 1\nlayers = 2\n";
    // 48 cones of 4 tets: a third of 192.
    let text = printed(&dry_run(&format!("{coarse}[refine]\nrounds = 3\ntets = \"33.4 %\"\n")));
    assert!(text.contains("in 3 rounds at most, by 64 tets at most, until K is within 2.0000 %"), "{text}");
    let flags = "[domain]\nsolid = \"cube\"\n[mesh]\nkind = \"flag\"\nlayers = 2\n";
    let powers = "[boundary]\nvalues = \"sliding\"\ncorners = \"power\"\n[optimize]\nsymmetric = true\n";
    let text = printed(&dry_run(&format!("{flags}{powers}")));
    // The solid angle of a corner is pi / 2: p = 4^(1/4).
    assert!(text.contains("from 8 vertices, p = 1.4142, from which better ones are sought"), "{text}");
    // Its start is that of a run without iterations, which seeks none.
    let none = ["run", "-", "--set", "optimize.max_iterations=0", "--json", "--quiet"];
    let report = printed(&qcball(folder.path(), &none, &format!("{flags}{powers}")));
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    assert!((report["corners"][0]["exponent"].as_f64().unwrap() - 2f64.sqrt()).abs() < 1e-12);
    let start = format!("max K {:.4}", report["initial"]["max_k"].as_f64().unwrap());
    assert!(text.contains(&start) && text.contains("the start above is with these"), "{start} {text}");
    assert!(text.contains("its vertices slide") && text.contains("symmetric   9 mirror planes"), "{text}");
    // From such a centre no mirror image is the solid.
    let askew = coarse.replace("[mesh]", "centre = [0.2, 0.1, -0.15]\n[mesh]");
    let output = dry_run(&format!("{askew}[optimize]\nsymmetric = true\n"));
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && error.contains("no mirror plane"), "{error}");
}

#[test]
fn the_long_version_tells_revision_and_features() {
    let folder = tempfile::tempdir().unwrap();
    let text = printed(&qcball(folder.path(), &["--version"], ""));
    assert!(text.contains("revision ") && text.contains("features cli"), "{text}");
    assert_eq!(printed(&qcball(folder.path(), &["-V"], "")).lines().count(), 1);
}

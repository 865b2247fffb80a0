//! `mesh.kind = "flag"` in configs.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use assert_cmd::cargo::cargo_bin;
use serde_json::Value;

/// Exit code, standard output and standard error of a run of `text`.
fn run(folder: &Path, text: &str) -> (i32, String, String) {
    fs::write(folder.join("a.toml"), text).unwrap();
    let arguments = ["run", "a.toml", "--out", "run", "--quiet", "--json", "--threads", "1"];
    let output = Command::new(cargo_bin!("qcball")).current_dir(folder).args(arguments).output().unwrap();
    let [out, err] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    (output.status.code().unwrap(), out, err)
}

#[test]
fn a_run_on_flags_starts_from_the_radial_map_and_is_verified() {
    let folder = tempfile::tempdir().unwrap();
    let config = "[domain]\nsolid = \"octahedron\"\n[mesh]\nkind = \"flag\"\nsectors = 2\nrings = 2\nlayers = 2\n";
    let (code, out, err) = run(folder.path(), config);
    assert_eq!((code, err.as_str()), (0, ""));
    let report: Value = serde_json::from_str(&out).unwrap();
    // 48 flags of 2 (2 * 2 - 1) triangles, each the base of 3 * 2 - 2 tets.
    assert_eq!((&report["domain"]["tets"], &report["domain"]["locked"]), (&(48 * 6 * 4).into(), &0.into()));
    assert_eq!((&report["bijective"], &report["initial"]["flipped"]), (&true.into(), &0.into()));
    assert!(report["splits"].is_null());
    assert!(report["final"]["max_k"].as_f64() < report["initial"]["max_k"].as_f64());
    let verified =
        Command::new(cargo_bin!("qcball")).current_dir(folder.path()).args(["verify", "run"]).output().unwrap();
    assert!(verified.status.success(), "{}", String::from_utf8_lossy(&verified.stdout));
}

#[test]
fn settings_without_sense_are_refused_by_line_and_key() {
    let folder = tempfile::tempdir().unwrap();
    let solid = "[domain]\nsolid = \"cube\"\n[mesh]\n";
    for (lines, part) in [
        ("kind = \"flag\"\nsectors = 0", "a.toml:5: `mesh.sectors` is 0"),
        ("kind = \"flag\"\nrings = 1001", "a.toml:5: `mesh.rings` is 1001"),
        ("kind = \"flag\"\nsubdivisions = 2", "a.toml:5: `subdivisions` is no key of the mesher flag"),
        ("sectors = 2", "`sectors` is no key of the mesher auto"),
        (
            "kind = \"flag\"\nsectors = 1000\nrings = 1000\nlayers = 1000\ngrading = 1\nlayer_grading = 1",
            "ask for fewer sectors, rings or layers",
        ),
        ("kind = \"flag\"\nrings = 1000", "a grading of 1.3 over 1000 rings"),
        ("kind = \"flag\"\n[map]\nkind = \"farthest\"", "cannot start from a shell or flag mesh"),
    ] {
        let (code, out, err) = run(folder.path(), &format!("{solid}{lines}\n"));
        assert_eq!((code, out.as_str()), (2, ""), "{lines}: {err}");
        assert!(err.contains(part), "{lines}: {err}");
        assert!(!folder.path().join("run").exists());
    }
}

//! What machines do to a program: full names, taken places, absurd environments, meshers that do not behave.

use std::fs;
use std::path::Path;
use std::process::Output;

use assert_cmd::Command;
use assert_cmd::cargo::cargo_bin;

fn qcball(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(cargo_bin!("qcball"));
    command.current_dir(folder).args(arguments).env("RAYON_NUM_THREADS", "100000000").output().unwrap()
}

fn error_of(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    String::from_utf8(output.stderr.clone()).unwrap()
}

const SMALL: &str =
    "[domain]\nsolid = \"cube\"\n[mesh]\nsubdivisions = 1\nlayers = 1\n[optimize]\nmax_iterations = 1\n";

#[test]
fn an_absurd_number_of_threads_in_the_environment_is_capped() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("small.toml"), SMALL).unwrap();
    let output = qcball(folder.path(), &["run", "small.toml", "--quiet"]);
    assert!(folder.path().join("results/small/report.json").is_file(), "{output:?}");
}

#[test]
fn a_folder_that_cannot_take_the_results_is_found_before_the_computation() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("small.toml"), SMALL).unwrap();
    fs::create_dir_all(folder.path().join("out/report.json")).unwrap();
    let error = error_of(&qcball(folder.path(), &["run", "small.toml", "--out", "out"]));
    assert!(error.contains("out/report.json") && error.contains("name a file, not a folder"), "{error}");
    assert_eq!(fs::read_dir(folder.path().join("out")).unwrap().count(), 1, "something was written");
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("nowhere", folder.path().join("link")).unwrap();
        let error = error_of(&qcball(folder.path(), &["run", "small.toml", "--out", "link"]));
        assert!(error.contains("cannot write link") && !folder.path().join("nowhere").exists(), "{error}");
    }
}

#[test]
fn control_characters_in_names_are_shown_escaped_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let error = error_of(&qcball(folder.path(), &["measure", "a\u{1b}[31m.mesh", "b.mesh"]));
    assert!(error.contains("a\\u{1b}[31m.mesh") && !error.contains('\u{1b}'), "{error:?}");
    fs::write(folder.path().join("bell.toml"), format!("name = \"a\\u0007b\"\n{SMALL}")).unwrap();
    let error = error_of(&qcball(folder.path(), &["run", "bell.toml"]));
    assert!(error.contains("control characters") && !error.contains('\u{7}'), "{error:?}");
}

#[cfg(unix)]
#[test]
fn a_mesher_that_never_stops_talking_is_ended() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("chatty");
    fs::write(&program, "#!/bin/sh\nexec yes 'a long line of which nothing is wanted'\n").unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    let config = "[domain]\nsolid = \"cube\"\n[mesh]\nkind = \"tetgen\"\nprogram = \"./chatty\"\n";
    fs::write(folder.path().join("chatty.toml"), config).unwrap();
    let error = error_of(&qcball(folder.path(), &["run", "chatty.toml"]));
    assert!(error.contains("it printed more than 64 MiB and was ended"), "{error}");
    assert!(error.starts_with("note: the config has ") && error.contains("chatty run as its mesher"), "{error}");
}

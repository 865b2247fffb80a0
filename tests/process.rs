//! What machines do to a program: full names, taken places, absurd environments, meshers that do not behave.

use std::fs;
use std::path::Path;
use std::process::Output;

use assert_cmd::Command;
use assert_cmd::cargo::cargo_bin;

fn qcball(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(cargo_bin!("qcball"));
    command.current_dir(folder).args(arguments).output().unwrap()
}

fn error_of(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    String::from_utf8(output.stderr.clone()).unwrap()
}

const SMALL: &str =
    "[domain]\nsolid = \"cube\"\n[mesh]\nsubdivisions = 1\nlayers = 1\n[optimize]\nmax_iterations = 1\n";

#[test]
fn an_absurd_number_of_threads_in_the_environment_counts_for_nothing() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("small.toml"), SMALL).unwrap();
    let cores = std::thread::available_parallelism().unwrap().get();
    for absurd in ["100000000", "0", "-3", "many"] {
        let call = |arguments: &[&str]| {
            let mut command = Command::new(cargo_bin!("qcball"));
            command.current_dir(folder.path()).env("RAYON_NUM_THREADS", absurd);
            String::from_utf8(command.args(arguments).output().unwrap().stdout).unwrap()
        };
        let report: serde_json::Value = serde_json::from_str(&call(&["run", "small.toml", "--json"])).unwrap();
        assert_eq!(report["threads"], cores, "{absurd}");
        // These have no option for it, and would start them all.
        let files = ["domain.vtu", "image.vtu"].map(|name| format!("results/small/{name}"));
        for command in ["measure", "bounds"] {
            assert!(!call(&[command, &files[0], &files[1]]).is_empty(), "{absurd}");
        }
    }
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
fn a_line_break_in_a_name_makes_no_line() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    let forged = "a\nerror: forged\u{2028}\u{202e}";
    let shown = r"a\nerror: forged\u{2028}\u{202e}";
    let error = error_of(&qcball(folder.path(), &["measure", &format!("{forged}.mesh"), "b.mesh"]));
    assert!(error.contains(shown) && error.lines().count() == 1, "{error}");
    let config = format!("[domain]\nfile = {:?}\n", format!("{forged}.off")).replace("\\u{2028}", "\\u2028");
    fs::write(place("named.toml"), config.replace("\\u{202e}", "\\u202e")).unwrap();
    let error = error_of(&qcball(folder.path(), &["run", "named.toml"]));
    assert!(error.contains(&format!("the file {shown}.off does not exist")), "{error}");

    // Where it is a config, a folder, or a mesh of a bench.
    let config = format!("{forged}.toml");
    fs::write(place(&config), format!("name = \"small\"\n{SMALL}")).unwrap();
    let output = qcball(folder.path(), &["run", &config, "--out", forged]);
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(
        said.contains(&format!("results     {shown}\n")) && !said.lines().any(|line| line.starts_with("error")),
        "{said}"
    );
    let summary = fs::read_to_string(place(forged).join("summary.txt")).unwrap();
    assert!(summary.contains(shown.split(' ').next().unwrap()) && said.starts_with(&summary), "{summary}");
    fs::create_dir(place("bench")).unwrap();
    fs::copy(place(forged).join("domain.vtu"), place("bench").join(format!("{forged}|-rest.vtu"))).unwrap();
    fs::copy(place(forged).join("image.vtu"), place("bench").join(format!("{forged}|-init.vtu"))).unwrap();
    fs::write(place("bench.toml"), "[optimize]\nmax_iterations = 1\n").unwrap();
    let output = qcball(folder.path(), &["bench", "bench.toml", "bench", "--out", "bench.md"]);
    assert!(output.status.success(), "{output:?}");
    let table = fs::read_to_string(place("bench.md")).unwrap();
    assert!(table.lines().any(|line| line.starts_with(&format!(r"| {shown}\| | "))), "{table}");
}

/// Runs a script of sh with a folder `disk` of 2 MiB below `folder`; nothing where disks cannot be made.
#[cfg(unix)]
fn on_a_small_disk(folder: &Path, script: &str) -> Option<Output> {
    // In a mount namespace of its own, so that nothing stays behind on the machine.
    let script = format!("mkdir -p disk && mount -t tmpfs -o size=2m none disk || exit 77\n{script}");
    let mut command = std::process::Command::new("unshare");
    command.current_dir(folder).args(["--mount", "sh", "-c", &script]).arg(cargo_bin!("qcball"));
    match command.output() {
        Ok(output)
            if output.status.code() == Some(77) || String::from_utf8_lossy(&output.stderr).contains("unshare") =>
        {
            eprintln!("skipped: may not mount: {output:?}");
            None
        }
        Ok(output) => Some(output),
        Err(error) => {
            eprintln!("skipped: no unshare here: {error}");
            None
        }
    }
}

#[cfg(unix)]
#[test]
fn a_full_disk_leaves_a_folder_that_says_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    // A table of 840 kB, and 180 for all else.
    let config = "[domain]\nsolid = \"cube\"\n[mesh]\nsubdivisions = 3\nlayers = 5\n[optimize]\nmax_iterations = 1\n";
    fs::write(folder.path().join("a.toml"), config).unwrap();
    let script = "head -c 1500000 /dev/zero > disk/other
                  \"$0\" run a.toml --out disk/out > shown 2> said; test $? = 1 || exit 3
                  \"$0\" verify disk/out 2> refused; test $? = 2 || exit 4
                  mkdir left; cp disk/out/* left
                  rm disk/other; mount -o remount,size=50m disk || exit 77
                  \"$0\" run a.toml --out disk/out --quiet || exit 5
                  test ! -e disk/out/incomplete.txt || exit 6
                  \"$0\" verify disk/out";
    let Some(output) = on_a_small_disk(folder.path(), script) else { return };
    let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap_or_default();
    let (said, left) = (read("said"), read("left/incomplete.txt"));
    assert_eq!(output.status.code(), Some(0), "{output:?}\n{said}\n{left}");
    assert!(said.contains("No space left on device") && said.contains("incomplete.txt"), "{said}");
    assert!(read("shown").contains("max K"), "the figures are lost: {}", read("shown"));
    assert!(read("refused").contains("its files are not all there, as its incomplete.txt says"), "{}", read("refused"));
    assert!(
        left.contains("Missing: cells.csv, report.json.\ncannot write disk/out/cells.csv: No space left"),
        "{left}"
    );
    for name in ["image.vtu", "domain.vtu", "trace.csv", "cells.csv", "summary.txt", "report.json"] {
        let is_missing = ["cells.csv", "report.json"].contains(&name);
        assert_eq!(folder.path().join("left").join(name).exists(), !is_missing, "{name}: {left}");
    }
}

#[cfg(unix)]
#[test]
fn on_a_full_disk_optimize_says_what_is_missing_and_keeps_what_was_there() {
    let folder = tempfile::tempdir().unwrap();
    let config = "[domain]\nsolid = \"cube\"\n[mesh]\nsubdivisions = 3\nlayers = 5\n[optimize]\nmax_iterations = 1\n";
    fs::write(folder.path().join("a.toml"), config).unwrap();
    let script = "\"$0\" run a.toml --out out --quiet || exit 3
                  echo old > disk/image.vtu
                  head -c 3000000 /dev/zero > disk/other
                  truncate -s -16384 disk/other
                  \"$0\" optimize out/domain.vtu out/image.vtu disk/image.vtu --trace trace.csv > shown 2> said
                  test $? = 1 || exit 4
                  grep -q old disk/image.vtu && test -s trace.csv && test \"$(ls disk)\" = \"$(printf 'image.vtu\\nother')\"";
    let Some(output) = on_a_small_disk(folder.path(), script) else { return };
    let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap_or_default();
    assert_eq!(output.status.code(), Some(0), "{output:?}\n{}", read("said"));
    assert!(read("said").contains("cannot write disk/image.vtu: No space left on device"), "{}", read("said"));
    assert!(read("shown").contains("max K"), "{}", read("shown"));
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

#[cfg(unix)]
#[test]
fn a_program_that_a_config_names_is_told_before_it_runs_and_never_run_to_verify() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("stranger");
    fs::write(&program, "#!/bin/sh\necho ran >> \"$(dirname \"$0\")/ran\"\nexit 1\n").unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    let mesh = "[mesh]\nkind = \"tetgen\"\nprogram = \"./stranger\"\n";
    let config = format!("[domain]\nsolid = \"cube\"\n{mesh}[sweep.grid]\n\"map.exponent\" = [1, 2]\n");
    fs::write(folder.path().join("sweep.toml"), config).unwrap();
    let output = qcball(folder.path(), &["sweep", "sweep.toml", "--out", "sweep"]);
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(said.matches("stranger run as its mesher").count(), 1, "{said}");
    assert!(said.starts_with("note: the config has ") && folder.path().join("ran").is_file(), "{said}");
    fs::remove_file(folder.path().join("ran")).unwrap();

    // A folder of results whose config was made to name it.
    fs::write(folder.path().join("small.toml"), SMALL).unwrap();
    qcball(folder.path(), &["run", "small.toml", "--out", "out", "--quiet"]);
    let record = folder.path().join("out/report.json");
    let forged = fs::read_to_string(&record)
        .unwrap()
        .replace("[mesh]\\nsubdivisions = 1\\nlayers = 1\\n", &mesh.escape_default().to_string());
    assert!(forged.contains("stranger"), "{forged}");
    fs::write(&record, forged).unwrap();
    let output = qcball(folder.path(), &["verify", "out"]);
    assert!(output.status.code() == Some(1) && !folder.path().join("ran").exists(), "{output:?}");
    // Nor does a bench, whose config has no mesher.
    fs::write(folder.path().join("bench.toml"), mesh).unwrap();
    let error = error_of(&qcball(folder.path(), &["bench", "bench.toml", "out"]));
    assert!(error.contains("`mesh` speaks of one run") && !folder.path().join("ran").exists(), "{error}");
}

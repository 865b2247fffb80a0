//! Sweeps through the program itself: killed and resumed, shared out, interrupted, on a full disk; always the same index.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;

use assert_cmd::cargo::cargo_bin;

/// Twelve cases of some ten milliseconds each.
const TWELVE: &str = "[domain]\nsolid = \"cube\"\n[mesh]\nsubdivisions = 1\nlayers = 3\n[optimize]\nobjective = \"soft-max\"\nexponent = 16\n\
                      [sweep.grid]\n\"domain.solid\" = [\"cube\", \"octahedron\", \"icosahedron\"]\n\
                      \"map.exponent\" = { from = 0.5, to = 2, step = 0.5 }\n";

/// A folder with a config named `a.toml`.
struct Place(tempfile::TempDir);

impl Place {
    fn with(config: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("a.toml"), config).unwrap();
        Self(folder)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn command(&self, arguments: &str) -> Command {
        let mut command = Command::new(cargo_bin!("qcball"));
        command.current_dir(self.0.path()).args(arguments.split(' ')).stdin(Stdio::null());
        command
    }

    /// Runs the program; its exit code and what it said.
    fn call(&self, arguments: &str) -> (Option<i32>, String) {
        said(&self.command(arguments).output().unwrap())
    }

    fn start(&self, arguments: &str) -> Child {
        self.command(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    }

    /// The index of a sweep's folder, bit for bit.
    fn index(&self, out: &str) -> [Vec<u8>; 2] {
        ["index.csv", "index.jsonl"].map(|name| fs::read(self.path(out).join(name)).unwrap())
    }

    /// The folders of the cases that are done, and which writing of its report each holds.
    fn done(&self, out: &str) -> BTreeMap<PathBuf, u64> {
        let entries = fs::read_dir(self.path(out).join("cases")).into_iter().flatten().flatten();
        let name = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
        let cases = entries.map(|entry| entry.path()).filter(|path| !name(path).contains(['.', '-']));
        cases.map(|path| (path.clone(), identity(&path.join("report.json")))).collect()
    }
}

fn said(output: &Output) -> (Option<i32>, String) {
    let text = [&output.stdout[..], &output.stderr].concat();
    (output.status.code(), String::from_utf8_lossy(&text).into_owned())
}

/// Differs for a file that was written again.
#[cfg(unix)]
fn identity(path: &Path) -> u64 {
    use std::os::unix::fs::MetadataExt;
    let found = fs::metadata(path).unwrap();
    found.ino() ^ (found.mtime_nsec() as u64).rotate_left(32)
}

#[cfg(not(unix))]
fn identity(_: &Path) -> u64 {
    0
}

fn wait_until(mut holds: impl FnMut() -> bool) {
    while !holds() {
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn a_sweep_killed_and_resumed_has_the_index_of_one_that_was_not() {
    let place = Place::with(TWELVE);
    let (code, text) = place.call("sweep a.toml --out whole");
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("12 of 12 cases done"), "{text}");
    assert!(text.contains("\nresults     whole/index.csv\npage        whole/report.html\n"), "{text}");
    // One job or two, killed as soon as so many cases are done: somewhere in the next ones.
    let mut before = BTreeMap::new();
    for (jobs, kill_at) in [(1, 1), (2, 3), (1, 4), (2, 7), (2, 10)] {
        let mut child = place.start(&format!("sweep a.toml --out killed --jobs {jobs}"));
        wait_until(|| place.done("killed").len() >= kill_at || child.try_wait().unwrap().is_some());
        // SIGKILL.
        child.kill().unwrap();
        child.wait().unwrap();
        let now = place.done("killed");
        assert!(
            before.iter().all(|(case, identity)| now.get(case) == Some(identity)),
            "a done case was computed again"
        );
        before = now;
    }
    let (code, text) = place.call("sweep a.toml --out killed");
    assert_eq!(code, Some(0), "{text}");
    assert_eq!(text.matches("converged").count(), 12 - before.len(), "{text}");
    let after = place.done("killed");
    assert!(before.iter().all(|(case, identity)| after.get(case) == Some(identity)), "a done case was computed again");
    assert_eq!(place.index("killed"), place.index("whole"));
    // What the killed processes left behind is gone.
    assert_eq!(fs::read_dir(place.path("killed/cases")).unwrap().count(), 12);

    // Another time nothing is computed, a new case alone is, and all are after --fresh.
    let (code, text) = place.call("sweep a.toml --out killed --set mesh.layers=3");
    assert!(code == Some(0) && !text.contains("converged"), "{text}");
    fs::write(place.path("a.toml"), TWELVE.replace("\"cube\", \"oct", "\"cube\", \"tetrahedron\", \"oct")).unwrap();
    let (code, text) = place.call("sweep a.toml --out killed");
    assert_eq!((code, text.matches("solid=tetrahedron").count()), (Some(0), 4), "{text}");
    assert_eq!(text.matches("converged").count(), 4, "{text}");
    let (code, text) = place.call("sweep a.toml --out killed --fresh --quiet");
    assert_eq!((code, text.as_str()), (Some(0), ""));
    let again = place.done("killed");
    assert_eq!(again.len(), 16);
    assert!(!cfg!(unix) || after.iter().all(|(case, identity)| again[case] != *identity));
}

#[test]
fn shards_and_an_index_over_them_give_the_same() {
    let place = Place::with(TWELVE);
    assert_eq!(place.call("sweep a.toml --out whole --quiet"), (Some(0), String::new()));
    // All at once, as GNU parallel would.
    let shards = ["1/3", "2/3", "3/3"].map(|shard| place.start(&format!("sweep a.toml --out shared --shard {shard}")));
    for shard in shards {
        let (code, text) = said(&shard.wait_with_output().unwrap());
        assert!(code == Some(0) && text.contains("4 of 4 cases done") && !text.contains("report.html"), "{text}");
    }
    assert!(!place.path("shared/index.csv").exists());
    let (code, text) = place.call("sweep a.toml --out shared --index-only");
    assert!(code == Some(0) && text.contains("12 of 12 cases done"), "{text}");
    assert_eq!(place.index("shared"), place.index("whole"));
    let listed = place.call("sweep a.toml --out shared --dry-run --shard 2/3").1;
    assert_eq!(listed.matches("  done  ").count(), 4, "{listed}");
    assert!(listed.contains("4 of 12 cases, 4 done"), "{listed}");
}

#[test]
fn a_case_that_fails_is_recorded_and_the_exit_code_says_so() {
    // A torus is not star-shaped.
    let place = Place::with(
        "[domain]\nsolid = \"cube\"\n[mesh]\nsubdivisions = 1\nlayers = 2\n[sweep]\ngrid.domain.solid = [\"torus\", \"cube\"]\n",
    );
    for arguments in ["sweep a.toml", "sweep a.toml --index-only"] {
        let (code, text) = place.call(arguments);
        assert_eq!(code, Some(1), "{text}");
        assert!(text.contains("1 of 2 cases done, 1 failed"), "{text}");
        let index = fs::read_to_string(place.path("results/a/index.csv")).unwrap();
        assert!(index.contains(",failed,torus,") && index.contains("1 handle"), "{index}");
        assert!(index.contains(",done,cube,"), "{index}");
    }
    // 10^8 tets are 400 GB at least: refused before they are made.
    let place = Place::with("[domain]\nsolid = \"cube\"\n[sweep]\ngrid.mesh.cells = [100, 90_000_000]\n");
    let (code, text) = place.call("sweep a.toml");
    assert!(code == Some(1) && text.contains("1 of 2 cases done, 1 failed"), "{text}");
    assert!(text.contains("mesh.cells=90000000: failed: it would take about") && text.contains("coarser"), "{text}");
    // A single run takes no notice of the table.
    assert_eq!(place.call("run a.toml --set mesh.layers=2 --quiet").0, Some(0));
}

#[test]
fn the_committed_sweep_has_60_cases() {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/sweep.toml");
    let (code, text) = Place::with("").call(&format!("sweep {} --dry-run", config.display()));
    assert!(code == Some(0) && text.contains("60 of 60 cases, 0 done"), "{text}");
}

#[test]
fn slurm_scripts_hold_whole_paths_and_all_settings() {
    let place = Place::with(TWELVE);
    let (code, text) = place.call("sweep a.toml --out far --set mesh.layers=2 --emit slurm --tasks 5");
    assert!(code == Some(0) && text.contains("12 cases in 5 tasks"), "{text}");
    let script = |name: &str| fs::read_to_string(place.path("far/slurm").join(name)).unwrap();
    let call = format!(
        "exec {} sweep {} --out {} --set mesh.layers=2 ",
        cargo_bin!("qcball").display(),
        place.path("a.toml").display(),
        place.path("far").display()
    );
    let array = script("array.sbatch");
    assert!(array.contains(&format!("{call}--shard \"$SLURM_ARRAY_TASK_ID\"/5 ")), "{array}");
    assert!(array.contains("#SBATCH --array=1-5\n"), "{array}");
    let merge = script("merge.sbatch");
    assert!(merge.contains(&format!("{call}--index-only\n")), "{merge}");
    assert!(script("submit.sh").contains("--dependency=\"afterany:$array\" merge.sbatch"));
}

/// Waits until a process handles SIGINT; false where the system does not tell, or if it ended before.
fn handles_interrupt(child: &mut Child) -> bool {
    let status = PathBuf::from(format!("/proc/{}/status", child.id()));
    loop {
        let Ok(text) = fs::read_to_string(&status) else { return false };
        let Some(mask) = text.lines().find_map(|line| line.strip_prefix("SigCgt:")) else { return false };
        // Signal 2 is the second bit.
        if u64::from_str_radix(mask.trim(), 16).is_ok_and(|mask| mask & 2 != 0) {
            return true;
        }
        if child.try_wait().unwrap().is_some() {
            return false;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn interrupt(child: &Child) {
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
}

/// Some seconds of work, in many steps.
const LONG: &str = "[domain]\nsolid = \"cube\"\n[mesh]\ncells = 12000\nlayers = 6\n";

#[test]
fn an_interrupted_run_writes_its_best_map() {
    let place = Place::with(LONG);
    // Interrupted before it has a map it has nothing to write: later and later, until there is one.
    for pause in (0..10).map(|power| Duration::from_millis(20 << power)) {
        let mut child = place.start("run a.toml");
        if !handles_interrupt(&mut child) {
            eprintln!("skipped: the system does not tell which signals a process handles");
            child.wait().unwrap();
            return;
        }
        std::thread::sleep(pause);
        interrupt(&child);
        let (code, text) = said(&child.wait_with_output().unwrap());
        assert_eq!(code, Some(130), "{text}");
        if text.contains("interrupted before there was a map; nothing was written") {
            assert!(!place.path("results/a").exists(), "{text}");
            continue;
        }
        assert!(text.contains("stopped     cancelled after"), "{text}");
        let report = fs::read_to_string(place.path("results/a/report.json")).unwrap();
        assert!(report.contains("\"stop\": \"cancelled\""), "{report}");
        assert!(place.path("results/a/image.vtu").is_file());
        return;
    }
    panic!("no map in ten seconds");
}

#[test]
fn an_interrupted_sweep_keeps_the_best_map_and_computes_the_case_again() {
    // One case of a second or two, which gets no tolerance that it could meet sooner.
    let place = Place::with(
        "[domain]\nsolid = \"cube\"\n[mesh]\ncells = 3000\nlayers = 4\n[optimize]\npolish = \"none\"\n\
         [sweep]\ngrid.map.exponent = [1.5]\n",
    );
    let folder = |ending: &str| {
        let entries = fs::read_dir(place.path("results/a/cases")).into_iter().flatten().flatten();
        let mut paths = entries.map(|entry| entry.path()).filter(|path| path.is_dir());
        paths.find(|path| path.to_string_lossy().ends_with(ending))
    };
    // Interrupted before its first step a case has nothing to keep, and after its last one nothing is left to interrupt:
    // later and later, from the start each time, until it is in between.
    let mut kept = None;
    for pause in (0..9).map(|power| Duration::from_millis(20 << power)) {
        let mut child = place.start("sweep a.toml --jobs 1");
        if !handles_interrupt(&mut child) {
            eprintln!("skipped: the system does not tell which signals a process handles");
            child.kill().unwrap();
            child.wait().unwrap();
            return;
        }
        std::thread::sleep(pause);
        interrupt(&child);
        let (code, text) = said(&child.wait_with_output().unwrap());
        kept = folder("-incomplete");
        if kept.is_some() {
            assert_eq!(code, Some(130), "{text}");
            assert!(text.contains("interrupted: 0 of 1 cases are done; the same command goes on"), "{text}");
            break;
        }
        assert!(code == Some(130), "the case was done before it could be interrupted: {text}");
    }
    let kept = kept.expect("in ten seconds a case takes its first step");
    let report = fs::read_to_string(kept.join("report.json")).unwrap();
    assert!(report.contains("\"stop\": \"cancelled\""), "{report}");
    assert!(kept.join("image.vtu").is_file());
    let index = fs::read_to_string(place.path("results/a/index.csv")).unwrap();
    let listed = place.call("sweep a.toml --dry-run").1;
    assert!(
        listed.contains("0 done") && listed.contains("  incomplete  ") && !index.contains(",done,"),
        "{listed}{index}"
    );
    // The same command computes it again, as if nothing had been.
    let (code, text) = place.call("sweep a.toml");
    assert_eq!(code, Some(0), "{text}");
    assert!(folder("-incomplete").is_none() && !kept.exists());
    assert_eq!(place.call("sweep a.toml --out whole --quiet").0, Some(0));
    assert_eq!(place.index("results/a"), place.index("whole"));
}

#[test]
fn on_a_full_disk_nothing_is_lost() {
    // In a mount namespace of its own, so that nothing stays behind on the machine.
    let script = "mount -t tmpfs -o size=1200k none disk || exit 77
                  \"$0\" sweep a.toml --out disk/out --jobs 1 2> said; test $? = 1 || exit 3
                  ls disk/out/cases | wc -l > count
                  mount -o remount,size=50m disk || exit 77
                  \"$0\" sweep a.toml --out disk/out --jobs 1 2> again || exit 4
                  cp disk/out/index.csv disk/out/index.jsonl .";
    let place = Place::with(TWELVE);
    fs::create_dir(place.path("disk")).unwrap();
    let mut command = Command::new("unshare");
    command.current_dir(place.0.path()).args(["--mount", "sh", "-c", script]).arg(cargo_bin!("qcball"));
    let Ok(output) = command.output() else {
        eprintln!("skipped: no unshare here");
        return;
    };
    let (code, text) = said(&output);
    if !place.path("said").is_file() || code == Some(77) {
        eprintln!("skipped: may not mount: {text}");
        return;
    }
    let read = |name: &str| fs::read_to_string(place.path(name)).unwrap_or_default();
    assert_eq!(code, Some(0), "{text}{}{}", read("said"), read("again"));
    assert!(
        read("said").contains("No space left on device") && read("said").contains("free some space"),
        "{}",
        read("said")
    );
    assert!(read("said").contains("what was done before is kept"), "{}", read("said"));
    // The second call computed the rest only.
    let kept: usize = read("count").trim().parse().unwrap();
    assert!(0 < kept && kept < 12, "{kept}");
    assert_eq!(read("again").matches("converged").count(), 12 - kept, "{}", read("again"));
    place.call("sweep a.toml --out whole --quiet");
    assert_eq!(["index.csv", "index.jsonl"].map(|name| fs::read(place.path(name)).unwrap()), place.index("whole"));
}

#[test]
fn files_by_a_pattern_are_cases_in_the_order_of_their_names() {
    let place = Place::with("[mesh]\nsubdivisions = 1\nlayers = 2\n[sweep]\nfiles = \"parts [x]/*.off\"\n");
    let (code, error) = place.call("sweep a.toml --dry-run");
    assert!(code == Some(2) && error.contains("no file matches"), "{error}");
    fs::create_dir(place.path("parts [x]")).unwrap();
    let (code, error) = place.call("sweep a.toml --dry-run");
    assert!(code == Some(2) && error.contains("no file matches"), "{error}");
    let octahedron = "OFF\n6 8 0\n1 0 0\n-1 0 0\n0 1 0\n0 -1 0\n0 0 1\n0 0 -1\n\
                      3 0 2 4\n3 2 1 4\n3 1 3 4\n3 3 0 4\n3 2 0 5\n3 1 2 5\n3 3 1 5\n3 0 3 5\n";
    fs::create_dir(place.path("parts x")).unwrap();
    // Brackets are part of the pattern: one letter out of those between them.
    for name in ["b.off", "a.off", "c.stl"] {
        fs::write(place.path("parts x").join(name), octahedron).unwrap();
    }
    let (code, said) = place.call("sweep a.toml --dry-run");
    let order = ["a.off", "b.off", "2 of 2 cases"].map(|part| said.find(part));
    assert!(code == Some(0) && order.iter().all(Option::is_some) && order.is_sorted(), "{said}");
    assert!(!said.contains("c.stl"), "{said}");
}

#[test]
fn what_another_revision_did_is_kept_and_told_and_renewed_on_request() {
    let place = Place::with(TWELVE);
    assert_eq!(place.call("sweep a.toml --out x --quiet").0, Some(0));
    let done = place.done("x");
    let report = done.keys().next().unwrap().join("report.json");
    let mut record: serde_json::Value = serde_json::from_slice(&fs::read(&report).unwrap()).unwrap();
    record["revision"] = "of-old".into();
    fs::write(&report, record.to_string()).unwrap();
    let before = place.done("x");
    let (code, said) = place.call("sweep a.toml --out x");
    assert!(code == Some(0) && said.contains("1 of them by another revision") && place.done("x") == before, "{said}");
    let index = String::from_utf8(place.index("x")[0].clone()).unwrap();
    assert_eq!(index.matches("of-old").count(), 1, "{index}");
    assert!(place.call("sweep a.toml --out x --dry-run").1.contains("by revision of-old"));
    let (code, said) = place.call("sweep a.toml --out x --renew");
    assert!(code == Some(0) && !said.contains("another revision"), "{said}");
    let kept = place.done("x").iter().filter(|&(path, identity)| before.get(path) == Some(identity)).count();
    assert_eq!(kept, 11);
}

#[test]
fn cases_that_the_config_has_no_more_are_removed_on_request() {
    let place = Place::with(TWELVE);
    assert_eq!(place.call("sweep a.toml --out x --quiet").0, Some(0));
    let before = place.done("x");
    fs::write(place.path("x/cases/notes.txt"), "mine").unwrap();
    let narrow = "--set sweep.grid.map.exponent=[1.0,2.0] --out x";
    // Named, and then removed; the other six are those that there were.
    let (code, said) = place.call(&format!("sweep a.toml {narrow} --prune --dry-run"));
    assert!(code == Some(0) && said.matches("would be removed").count() == 6, "{said}");
    assert_eq!(place.done("x"), before);
    let (code, said) = place.call(&format!("sweep a.toml {narrow}"));
    assert!(code == Some(0) && place.done("x") == before, "{said}");
    let (code, said) = place.call(&format!("sweep a.toml {narrow} --prune"));
    assert!(code == Some(0) && said.contains("6 cases that the config does not have were removed"), "{said}");
    let after = place.done("x");
    assert!(after.len() == 6 && after.iter().all(|one| before.get_key_value(one.0) == Some(one)), "{after:?}");
    assert!(place.path("x/cases/notes.txt").is_file());
}

/// The committed sweep on meshes of a few tets: what is asked of sixty cases after a change of the program.
#[test]
fn sixty_cases_of_another_revision_are_indexed_and_not_computed_again() {
    let place = Place::with(&fs::read_to_string("configs/sweep.toml").unwrap());
    let small = "sweep a.toml --set mesh.subdivisions=1 --set mesh.layers=2 --set optimize.max_iterations=2 --out x";
    assert_eq!(place.call(&format!("{small} --quiet")).0, Some(0));
    for case in place.done("x").keys() {
        let report = case.join("report.json");
        let mut record: serde_json::Value = serde_json::from_slice(&fs::read(&report).unwrap()).unwrap();
        record["revision"] = "of-old".into();
        fs::write(&report, record.to_string()).unwrap();
    }
    let before = place.done("x");
    assert_eq!(before.len(), 60);
    for arguments in [small.to_string(), format!("{small} --index-only")] {
        let (code, said) = place.call(&arguments);
        assert!(code == Some(0) && said.contains("60 of them by another revision"), "{said}");
        assert_eq!(place.done("x"), before);
    }
    let index = String::from_utf8(place.index("x")[1].clone()).unwrap();
    assert_eq!(index.matches("\"revision\":\"of-old\"").count(), 60, "{index}");
}

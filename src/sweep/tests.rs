use std::collections::BTreeMap;
use std::fs;

use super::*;
use crate::cancel::Cancel;
use crate::config::InitialMap;
use crate::experiment;

/// A sweep over six tiny cases of the cube.
const SIX: &str = "[domain]\nsolid = \"cube\"\n[mesh]\nsubdivisions = 1\nlayers = 1\n[optimize]\nmax_iterations = 2\n\
                   [sweep.grid]\n\"map.exponent\" = [0.5, 1, 2]\n\"mesh.subdivisions\" = [1, 2]\n";

fn sweep(text: &str) -> Sweep {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("case.toml");
    fs::write(&path, text).unwrap();
    fs::write(folder.path().join("part.obj"), "v 0 0 0\n").unwrap();
    Sweep::read(&path, &[]).unwrap()
}

fn settings() -> SweepSettings {
    SweepSettings { jobs: Some(2), threads: Some(1), cancel: Cancel::default() }
}

fn work(sweep: &Sweep, folder: &SweepFolder, compute: &Compute<'_>) -> Tally {
    folder.prepare().unwrap();
    run(&sweep.cases.iter().collect::<Vec<_>>(), folder, &settings(), compute, &|_, _| {}).unwrap();
    write_index(sweep, folder).unwrap()
}

/// The files of the index, by name.
fn index(folder: &SweepFolder) -> BTreeMap<&'static str, String> {
    let text = |name| (name, fs::read_to_string(folder.path().join(name)).unwrap());
    ["index.csv", "index.jsonl"].map(text).into()
}

#[test]
fn a_case_that_panics_or_fails_is_recorded_stops_no_other_and_is_tried_again() {
    let sweep = sweep(SIX);
    let root = tempfile::tempdir().unwrap();
    let folder = SweepFolder::new(root.path());
    let exponent = |plan: &Plan| match plan.map {
        InitialMap::Auto { exponent } => exponent.unwrap(),
        _ => unreachable!("the sweep starts from radial maps"),
    };
    let tally = work(&sweep, &folder, &|plan, observe| {
        if exponent(plan) == 2.0 {
            panic!("injected");
        }
        if exponent(plan) == 0.5 {
            return Err(experiment::RunError::Threads { threads: 1, message: "injected too".into() });
        }
        experiment::run(plan, observe)
    });
    assert_eq!(tally, Tally { cases: 6, done: 2, not_bijective: 0, failed: 4, other_revision: 0 });
    let recorded = index(&folder);
    assert_eq!(
        recorded["index.csv"].matches(",the program panicked: injected; please report this as a bug").count(),
        2
    );
    assert_eq!(recorded["index.jsonl"].matches("\"status\":\"failed\"").count(), 4);
    assert_eq!(folder.error(&sweep.cases[0].id).unwrap(), "cannot start 1 threads: injected too; ask for fewer");

    // What is done is not computed again; what failed is, and then leaves no trace.
    let tally = work(&sweep, &folder, &|plan, observe| {
        assert_ne!(exponent(plan), 1.0);
        experiment::run(plan, observe)
    });
    assert_eq!(tally, Tally { cases: 6, done: 6, ..Tally::default() });
    let elsewhere = tempfile::tempdir().unwrap();
    let other = SweepFolder::new(elsewhere.path());
    work(&sweep, &other, &experiment::run);
    assert_eq!(index(&folder), index(&other));
    let mut names: Vec<String> = fs::read_dir(root.path().join("cases"))
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    let mut ids: Vec<String> = sweep.cases.iter().map(|case| case.id.clone()).collect();
    names.sort();
    ids.sort();
    assert_eq!(names, ids, "only whole folders are left");
}

#[test]
fn ids_change_with_what_decides_a_result_only() {
    let ids = |text: &str| -> Vec<String> { sweep(text).cases.into_iter().map(|case| case.id).collect() };
    let before = ids(SIX);
    assert!(before.iter().all(|id| id.len() == ID_LETTERS));
    // Another order, a threads key, a wider sweep: the same runs have the same ids.
    let wider = SIX.replace("[0.5, 1, 2]", "[1, 3, 0.5, 2]");
    assert_eq!(before.iter().filter(|id| !ids(&format!("threads = 2\n{wider}")).contains(id)).count(), 0);
    assert_eq!(ids(&wider).len(), 8);
    // Another key: none is kept.
    let other = ids(&SIX.replace("layers = 1", "layers = 2"));
    assert!(before.iter().all(|id| !other.contains(id)));
}

#[test]
fn an_id_changes_with_the_file_of_the_domain() {
    let folder = tempfile::tempdir().unwrap();
    let [config, part] = ["case.toml", "part.obj"].map(|name| folder.path().join(name));
    fs::write(&config, SIX.replace("solid = \"cube\"", "file = \"part.obj\"")).unwrap();
    let id = |text: &str| {
        fs::write(&part, text).unwrap();
        Sweep::read(&config, &[]).unwrap().cases[0].id.clone()
    };
    let first = id("v 0 0 0\n");
    assert_ne!(id("v 0 0 1\n"), first);
    assert_eq!(id("v 0 0 0\n"), first);
}

#[test]
fn the_cores_are_shared_out_among_the_cases() {
    let sweep = sweep(SIX);
    let cores = std::thread::available_parallelism().unwrap().get();
    let seen = |jobs, threads| {
        let root = tempfile::tempdir().unwrap();
        let folder = SweepFolder::new(root.path());
        folder.prepare().unwrap();
        let seen = std::sync::Mutex::new(Vec::new());
        let settings = SweepSettings { jobs, threads, cancel: Cancel::default() };
        let compute = |plan: &Plan, observe: &mut (dyn FnMut(&crate::optimize::TraceRow) + Send)| {
            seen.lock().unwrap().push(plan.threads.unwrap());
            experiment::run(plan, observe)
        };
        run(&sweep.cases.iter().collect::<Vec<_>>(), &folder, &settings, &compute, &|_, _| {}).unwrap();
        seen.into_inner().unwrap()
    };
    assert_eq!(seen(Some(1), None), [cores; 6]);
    assert_eq!(seen(None, Some(3)), [3; 6]);
}

#[test]
fn shards_are_a_partition() {
    let sweep = sweep(SIX);
    for of in 1..=8 {
        for case in &sweep.cases {
            let holders = (1..=of).filter(|number| format!("{number}/{of}").parse::<Shard>().unwrap().holds(case));
            assert_eq!(holders.count(), 1);
        }
    }
    for wrong in ["", "1", "0/3", "4/3", "1/0", "a/b", "1/2/3", "-1/2"] {
        assert!(wrong.parse::<Shard>().is_err(), "{wrong}");
    }
}

#[test]
fn a_case_that_another_process_has_is_left_to_it() {
    let sweep = sweep(SIX);
    let root = tempfile::tempdir().unwrap();
    let folder = SweepFolder::new(root.path());
    folder.prepare().unwrap();
    // A lock belongs to the open file, so that the same process stands for another one here.
    let taken = folder.take(&sweep.cases[3].id).unwrap().unwrap();
    let tally = work(&sweep, &folder, &experiment::run);
    assert_eq!((tally.done, tally.failed), (5, 0));
    drop(taken);
    assert_eq!(work(&sweep, &folder, &experiment::run).done, 6);
}

#[test]
fn a_cancelled_case_is_marked_and_computed_again() {
    let sweep = sweep(SIX);
    let root = tempfile::tempdir().unwrap();
    let folder = SweepFolder::new(root.path());
    folder.prepare().unwrap();
    let settings = SweepSettings { jobs: Some(1), ..settings() };
    let cases: Vec<&Case> = sweep.cases.iter().collect();
    let second = &sweep.cases[1].id;
    run(&cases, &folder, &settings, &experiment::run, &|case, event| {
        // After the second case's first step.
        if case.id == *second && matches!(event, Event::Row(row) if row.iteration == 1) {
            settings.cancel.raise();
        }
    })
    .unwrap();
    let states: Vec<State> = sweep.cases.iter().map(|case| folder.state(&case.id)).collect();
    assert_eq!(states[..3], [State::Done, State::Incomplete, State::Missing]);
    let report = fs::read_to_string(folder.of_case(second, State::Incomplete).join("report.json")).unwrap();
    assert!(report.contains("\"stop\": \"cancelled\"") && report.contains("\"iterations\": 1"), "{report}");
    let tally = work(&sweep, &folder, &experiment::run);
    assert_eq!(tally.done, 6);
    assert!(!folder.of_case(second, State::Incomplete).exists());
}

#[cfg(unix)]
#[test]
fn a_lock_never_follows_a_link() {
    let folder = tempfile::tempdir().unwrap();
    let sweep = folder::SweepFolder::new(folder.path().join("out"));
    sweep.prepare().unwrap();
    let precious = folder.path().join("precious");
    fs::write(&precious, "kept").unwrap();
    std::os::unix::fs::symlink(&precious, folder.path().join("out/cases/.a.lock")).unwrap();
    assert!(sweep.take("a").unwrap_err().to_string().contains("a link or folder stands where the lock goes"));
    assert_eq!(fs::read_to_string(&precious).unwrap(), "kept");
    assert!(sweep.take("b").unwrap().is_some());
}

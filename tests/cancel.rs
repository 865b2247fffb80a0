//! What is interrupted, or runs out of its time, ends at once with what it has, whatever stage it is in.

use std::path::Path;
use std::time::Duration;

use qcball::bound::certificate;
use qcball::experiment::{self, Event, GivenMap, RunError, Stage, optimize_map};
use qcball::mesh::{TetMesh, Vec3, VertexId};
use qcball::optimize::{OptimizeSettings, StopReason, untangle};
use qcball::report::write_results;
use qcball::solid::{Refinement, ShellError, shell_mesh_until};
use qcball::{
    Cancel, Domain, Plan, RadialCoordinates, ShellSettings, Solid, bound, caraman, shell_mesh, star_centre, verify,
};

/// A cube, and its radial map with the vertices inside put at the centre, so that most tets are flat.
fn tangled() -> (Domain, Vec<Vec3>) {
    let surface = Solid::Cube.surface().unwrap();
    let centre = star_centre(&surface, &qcball::CentreChoice::Kernel).unwrap().position;
    let settings = ShellSettings { subdivisions: 2, refinement: None, layers: 4, grading: 1.0 };
    let shell = shell_mesh(&surface, centre, &settings).unwrap();
    let mut image = caraman(&RadialCoordinates::of_shell(&shell), 1.0);
    let domain = Domain::new(shell.mesh).unwrap();
    let on_boundary = domain.boundary().vertex_mask();
    image.iter_mut().zip(on_boundary).filter(|(_, on)| !**on).for_each(|(position, _)| *position = Vec3::zeros());
    (domain, image)
}

#[test]
fn untangling_ends_at_the_time_limit_of_the_optimization_and_when_it_is_cancelled() {
    let (domain, start) = tangled();
    let fixed = domain.boundary().vertex_mask().to_vec();
    let raised = Cancel::default();
    raised.raise();
    let out_of_time = OptimizeSettings { time_limit: Some(Duration::ZERO), ..OptimizeSettings::default() };
    let cancelled = OptimizeSettings { cancel: raised, ..OptimizeSettings::default() };
    for (settings, stop) in [(out_of_time, StopReason::TimeLimit), (cancelled, StopReason::Cancelled)] {
        let untangled = untangle(&domain, &start, &fixed, &settings, &mut |_| {}).unwrap();
        assert!(untangled.iterations == 0 && !untangled.resisting.is_empty(), "{stop:?}");
        let map = GivenMap {
            domain: domain.clone(),
            image: start.clone(),
            exchanged: 0,
            units: Default::default(),
            kept: Vec::new(),
            cell_data: Vec::new(),
            notes: Vec::new(),
        };
        let optimized = optimize_map(map, None, false, &settings, None, &mut |_| {}).unwrap();
        assert_eq!((optimized.report.achieved.stop, optimized.report.achieved.iterations), (stop, 0));
        assert!(optimized.report.achieved.last.flipped > 0);
    }
    // With time it does not resist.
    let untangled = untangle(&domain, &start, &fixed, &OptimizeSettings::default(), &mut |_| {}).unwrap();
    assert!(untangled.iterations > 0 && untangled.resisting.is_empty());
}

#[test]
fn a_run_that_is_interrupted_writes_the_map_it_has_without_what_takes_long_and_is_verified() {
    let folder = tempfile::tempdir().unwrap();
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/smoke.toml");
    // Before the first iteration, and after some.
    for rows in [0, 3] {
        let plan = Plan::read(&config, &[]).unwrap();
        let mut seen = 0;
        let cancel = &plan.optimize.cancel;
        let finished = experiment::run_and_tell(&plan, &mut |event| {
            seen += usize::from(matches!(event, Event::Row(_)));
            if !matches!(event, Event::Stage(Stage::Starting)) && seen >= rows {
                cancel.raise();
            }
        })
        .unwrap();
        let achieved = &finished.report.achieved;
        assert_eq!((achieved.stop, achieved.iterations), (StopReason::Cancelled, rows.saturating_sub(1)));
        assert!(finished.report.bijective && achieved.bounds.is_empty() && achieved.last.ball_k.is_none());
        assert!(achieved.last.max_k <= achieved.initial.max_k);
        let out = folder.path().join(rows.to_string());
        write_results(&out, &finished.report, &finished.record()).unwrap();
        let found = verify::verify(&out).unwrap();
        assert!(found.verified, "{found}");
    }
}

#[test]
fn measuring_that_runs_out_of_its_time_proves_less_and_says_so_and_is_verified() {
    let folder = tempfile::tempdir().unwrap();
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/smoke.toml");
    let of = |cancel: Cancel| {
        let mut plan = Plan::read(&config, &["optimize.max_iterations=0".into()]).unwrap();
        plan.optimize.cancel = cancel;
        experiment::run(&plan, &mut |_| {}).unwrap()
    };
    let (mut run, late) = (of(Cancel::default()), of(Cancel::default().within(Duration::ZERO)));
    let [usual, coarse] = [&run, &late].map(|run| run.report.achieved.last.ball_k.unwrap());
    assert!(coarse.cut_short && !usual.cut_short);
    assert!(coarse.certified > usual.certified && coarse.sampled <= usual.certified, "{coarse:?} {usual:?}");
    let words = "the time limit ended the search";
    let [told, untold] = [&late, &run].map(|run| qcball::report::summary(&run.report).replace("\n            ", " "));
    assert!(told.contains(words) && !untold.contains(words), "{told}");

    // The rest in time; then a bound that is less than what a point of the map has.
    let lower = qcball::measure::BallDilatation { certified: usual.sampled * 0.9, sampled: 1.0, cut_short: true };
    for (name, ball_k, holds) in [("late", coarse, true), ("forged", lower, false)] {
        let achieved = &mut run.report.achieved;
        achieved.last.ball_k = Some(ball_k);
        achieved.ball.ball_gap = achieved.ball.ball_bound.map(|bound| ball_k.certified / bound);
        let out = folder.path().join(name);
        write_results(&out, &run.report, &run.record()).unwrap();
        let found = verify::verify(&out).unwrap();
        assert!(found.verified == holds && found.to_string().contains("ball_k") != holds, "{name}: {found}");
    }
}

/// Millions of tets would take a minute.
#[test]
fn shells_that_are_interrupted_are_no_map() {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/smoke.toml");
    for mesh in ["mesh.subdivisions=800", "mesh.cells=20_000_000", "mesh.edge_length=1e-3"] {
        let plan = Plan::read(&config, &[mesh.into(), "mesh.layers=4".into()]).unwrap();
        let cancel = &plan.optimize.cancel;
        let interrupted = experiment::run_and_tell(&plan, &mut |event| match event {
            Event::Stage(Stage::Starting) => cancel.raise(),
            other => panic!("{mesh}: {other:?}"),
        });
        assert!(matches!(interrupted, Err(RunError::Interrupted)), "{mesh}: {interrupted:?}");
    }
    let surface = Solid::Cube.surface().unwrap();
    let settings = ShellSettings { subdivisions: 1, refinement: Some(Refinement::USUAL), layers: 2, grading: 1.0 };
    let raised = Cancel::default();
    assert!(shell_mesh_until(&surface, Vec3::zeros(), &settings, &raised).is_ok());
    raised.raise();
    assert_eq!(shell_mesh_until(&surface, Vec3::zeros(), &settings, &raised).err(), Some(ShellError::Cancelled));
}

#[test]
fn a_log_has_a_line_a_stage_and_a_line_an_iteration() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("log.txt");
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/smoke.toml");
    let output = assert_cmd::Command::new(assert_cmd::cargo::cargo_bin!("qcball"))
        .current_dir(folder.path())
        .arg("run")
        .arg(config)
        .args(["--verbose", "--set", "optimize.max_iterations=2", "--log"])
        .arg(&log)
        .output()
        .unwrap();
    assert!(output.status.success());
    let text = std::fs::read_to_string(log).unwrap();
    assert_eq!(text, String::from_utf8(output.stderr).unwrap());
    // The start and two iterations.
    assert_eq!(text.lines().filter(|line| line.contains("max K")).count(), 3, "{text}");
    for stage in ["meshing", "optimizing", "measuring", "computing the bounds", "writing", "making the page"] {
        assert_eq!(text.matches(stage).count(), 1, "{stage}: {text}");
    }
}

#[test]
fn bounds_and_certificates_end_when_they_are_cancelled() {
    let points = vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z(), Vec3::new(0.2, 0.2, 0.2)];
    let tets = TetMesh::FACES.map(|[a, b, c]| [a as u32, b as u32, c as u32, 4].map(VertexId)).to_vec();
    let domain = Domain::new(TetMesh::from_either_orientation(points, tets).unwrap().0).unwrap();
    let image: Vec<Vec3> = domain.mesh().points().iter().map(|p| Vec3::new(p.x, 2.0 * p.y, p.z)).collect();
    let cancel = Cancel::default();
    assert!(!bound::all_until(&domain, &image, None, false, &cancel).is_empty());
    assert!(certificate::search(&domain, &image, &cancel.within(Duration::from_secs(60))).is_some());
    cancel.raise();
    assert!(bound::all_until(&domain, &image, None, false, &cancel).is_empty());
    assert!(certificate::search(&domain, &image, &cancel).is_none());
}

/// A mesher that would take an hour is ended with the program, which has written nothing then.
#[test]
#[cfg(unix)]
fn a_signal_ends_a_run_while_it_is_meshing() {
    use std::os::unix::fs::PermissionsExt;
    use std::process::{Command, Stdio};
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("mesher"), "#!/bin/sh\ntouch \"$0.started\"\nsleep 3600\n").unwrap();
    std::fs::set_permissions(at("mesher"), std::fs::Permissions::from_mode(0o755)).unwrap();
    std::fs::write(
        at("a.toml"),
        "[domain]\nsolid = \"cube\"\n[mesh]\nkind = \"tetgen\"\nprogram = \"./mesher\"\nprogram_time_limit = 3600\n",
    )
    .unwrap();
    let mut run = Command::new(assert_cmd::cargo::cargo_bin!("qcball"))
        .current_dir(folder.path())
        .args(["run", "a.toml"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    while !at("mesher.started").exists() {
        assert!(run.try_wait().unwrap().is_none(), "the run ended before its mesher began");
        std::thread::sleep(Duration::from_millis(10));
    }
    assert!(Command::new("kill").args(["-TERM", &run.id().to_string()]).status().unwrap().success());
    let output = run.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(130) && said.contains("interrupted before there was a map"), "{said}");
    assert!(!at("results/a/report.json").exists());
}

/// A mesher whose file never comes to its end, which nothing that reads it looks up from.
#[test]
#[cfg(target_os = "linux")]
fn a_signal_ends_a_run_or_a_sweep_that_has_no_map_yet_whatever_it_does() {
    use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
    use std::process::{Command, Stdio};
    const NONBLOCK: i32 = 0o4000;
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("mesher"), "#!/bin/sh\nmkfifo surface.mesh && pwd > \"$0.folder\"\n").unwrap();
    std::fs::set_permissions(at("mesher"), std::fs::Permissions::from_mode(0o755)).unwrap();
    std::fs::write(at("a.toml"), "[domain]\nsolid = \"cube\"\n[mesh]\nkind = \"tetgen\"\nprogram = \"./mesher\"\n")
        .unwrap();
    let varied = std::fs::read_to_string(at("a.toml")).unwrap() + "[sweep.grid]\n\"optimize.max_iterations\" = [5]\n";
    std::fs::write(at("b.toml"), varied).unwrap();
    let no_map = "interrupted before there was a map";
    for (command, words) in [
        (&["run", "a.toml"][..], no_map),
        (&["run", "a.toml", "--dry-run"], no_map),
        (&["sweep", "b.toml"], "interrupted: 0 of 1 cases are done"),
    ] {
        let _ = std::fs::remove_file(at("mesher.folder"));
        let mut run = Command::new(assert_cmd::cargo::cargo_bin!("qcball"))
            .current_dir(folder.path())
            .env("TMPDIR", folder.path())
            .args(command)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        // It can be opened for writing once it is for reading.
        let writer = loop {
            let meshed_in = std::fs::read_to_string(at("mesher.folder")).unwrap_or_default();
            let pipe = Path::new(meshed_in.trim()).join("surface.mesh");
            match std::fs::OpenOptions::new().write(true).custom_flags(NONBLOCK).open(pipe) {
                Ok(writer) => break writer,
                Err(_) => assert!(run.try_wait().unwrap().is_none(), "the run ended before its mesh was read"),
            }
            std::thread::sleep(Duration::from_millis(10));
        };
        assert!(Command::new("kill").args(["-TERM", &run.id().to_string()]).status().unwrap().success());
        let output = run.wait_with_output().unwrap();
        drop(writer);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(130) && said.contains(words), "{said}");
        assert!(!at("results/a/report.json").exists());
    }
}

/// A file that never comes to its end: nothing is there to be kept yet, and the exit code is that of any signal.
#[test]
#[cfg(target_os = "linux")]
fn a_signal_ends_commands_that_are_still_reading_with_its_exit_code() {
    use std::os::unix::fs::OpenOptionsExt;
    use std::process::{Command, Stdio};
    const NONBLOCK: i32 = 0o4000;
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("a.mesh");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for (command, signal) in [
        (&["measure", "a.mesh", "b.mesh"][..], "-TERM"),
        (&["bounds", "a.mesh", "b.mesh"], "-HUP"),
        (&["optimize", "a.mesh", "b.mesh", "c.mesh"], "-INT"),
    ] {
        let mut run = Command::new(assert_cmd::cargo::cargo_bin!("qcball"))
            .current_dir(folder.path())
            .args(command)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        // It can be opened for writing once it is for reading.
        let writer = loop {
            match std::fs::OpenOptions::new().write(true).custom_flags(NONBLOCK).open(&pipe) {
                Ok(writer) => break writer,
                Err(_) => assert!(run.try_wait().unwrap().is_none(), "{command:?} ended before it read"),
            }
            std::thread::sleep(Duration::from_millis(10));
        };
        assert!(Command::new("kill").args([signal, &run.id().to_string()]).status().unwrap().success());
        let output = run.wait_with_output().unwrap();
        drop(writer);
        assert_eq!(output.status.code(), Some(130), "{command:?}: {output:?}");
    }
}

//! Runs and optimizations that start from given tet meshes.

use std::path::Path;

use assert_cmd::Command;
use qcball::config::Plan;
use qcball::experiment::{self, GivenMap, optimize_map};
use qcball::mesh::io::write_medit;
use qcball::mesh::{TetMesh, Vec3, VertexId};
use qcball::optimize::StopReason;

/// Kuhn's subdivision of an n x n x n grid over [-1, 1]^3: six tets a cell, many of them with four boundary vertices.
fn grid(n: u32) -> (Vec<Vec3>, Vec<[VertexId; 4]>) {
    let at = |i: u32, j: u32, k: u32| i + (n + 1) * (j + (n + 1) * k);
    let coordinate = |i: u32| 2.0 * f64::from(i) / f64::from(n) - 1.0;
    let mut points = vec![Vec3::zeros(); ((n + 1) * (n + 1) * (n + 1)) as usize];
    let mut tets = Vec::new();
    for k in 0..=n {
        for j in 0..=n {
            for i in 0..=n {
                points[at(i, j, k) as usize] = Vec3::new(coordinate(i), coordinate(j), coordinate(k));
                if i < n && j < n && k < n {
                    for [a, b] in [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]] {
                        let mut corner = [i, j, k];
                        let mut tet = [VertexId(at(i, j, k)); 4];
                        for (step, axis) in [a, b, 3 - a - b].into_iter().enumerate() {
                            corner[axis] += 1;
                            tet[step + 1] = VertexId(at(corner[0], corner[1], corner[2]));
                        }
                        tets.push(tet);
                    }
                }
            }
        }
    }
    (points, tets)
}

fn config(folder: &Path, mesh: &str, more: &str) -> std::path::PathBuf {
    let path = folder.join("config.toml");
    std::fs::write(&path, format!("[domain]\nfile = {mesh:?}\ncentre = [0, 0, 0]\n{more}")).unwrap();
    path
}

fn run(folder: &Path, more: &str) -> experiment::Finished {
    let (points, tets) = grid(4);
    write_medit(&folder.join("grid.mesh"), &points, &tets).unwrap();
    let plan = Plan::read(&config(folder, "grid.mesh", more), &[]).unwrap();
    experiment::run(&plan, &mut |_| {}).unwrap()
}

#[test]
fn a_grid_is_freed_of_locked_tets_untangled_and_optimized() {
    let folder = tempfile::tempdir().unwrap();
    let report = run(folder.path(), "").report;
    let splits = report.achieved.splits.unwrap();
    assert!(splits.edges > 0 && splits.tets_before == 6 * 64 && report.domain.tets > splits.tets_before);
    assert_eq!((report.domain.locked, report.achieved.last.flipped, report.bijective), (0, 0, true));
    assert!(matches!(report.achieved.stop, StopReason::Optimal | StopReason::Converged), "{:?}", report.achieved.stop);
    // Half of the tets were stored with either orientation.
    assert!(report.warnings.iter().any(|warning| warning.contains("192 of 384")), "{:?}", report.warnings);
    assert!(report.achieved.best.gap.unwrap() >= 1.0);
}

#[test]
fn a_kept_mesh_names_its_locked_tets() {
    let folder = tempfile::tempdir().unwrap();
    let finished = run(folder.path(), "keep_mesh = true");
    let report = &finished.report;
    assert!(report.domain.locked > 0 && report.achieved.splits.is_none() && report.domain.tets == 384);
    let said = report.warnings.iter().find(|warning| warning.contains("are locked")).unwrap();
    let forced =
        report.achieved.bounds.iter().find(|bound| bound.name == qcball::bound::BoundName::Locked).unwrap().value;
    // Rounded down.
    let shown: f64 = said.rsplit("K >= ").next().unwrap().parse().unwrap();
    assert!(shown <= forced * (1.0 + 1e-9) && forced < shown + 1e-4, "{said}, from {forced}");
    assert!(report.achieved.last.max_k >= forced);
}

#[test]
fn optimize_gives_what_run_gives_from_the_same_start() {
    let folder = tempfile::tempdir().unwrap();
    let finished = run(folder.path(), "");
    let settings = qcball::optimize::OptimizeSettings::default();
    let map = GivenMap {
        domain: finished.domain.clone(),
        image: finished.initial.clone(),
        exchanged: 0,
        units: Default::default(),
        kept: Vec::new(),
        cell_data: Vec::new(),
        notes: Vec::new(),
    };
    let locks = finished.domain.boundary().vertex_mask().to_vec();
    let again = optimize_map(map, Some(locks), false, &settings, None, &mut |_| {}).unwrap();
    assert_eq!(again.positions, finished.outcome.positions);
    assert_eq!(again.report.achieved.last, finished.report.achieved.last);
}

#[test]
fn the_command_writes_the_image_and_the_split_domain() {
    let folder = tempfile::tempdir().unwrap();
    let (points, tets) = grid(2);
    // An affine image of the grid: every vertex but the middle one is on the boundary.
    let image: Vec<Vec3> = points.iter().map(|p| Vec3::new(p.x + 0.3 * p.y, p.y, 2.0 * p.z)).collect();
    let path = |name: &str| folder.path().join(name).display().to_string();
    write_medit(&folder.path().join("rest.mesh"), &points, &tets).unwrap();
    write_medit(&folder.path().join("init.mesh"), &image, &tets).unwrap();
    let optimize = |out: &str, more: &[&str]| {
        let mut command = Command::new(assert_cmd::cargo::cargo_bin!("qcball"));
        command.args(["optimize", &path("rest.mesh"), &path("init.mesh"), &path(out), "--json"]).args(more);
        let output = command.assert().success().get_output().stdout.clone();
        serde_json::from_slice::<serde_json::Value>(&output).unwrap()
    };
    let measure = |rest: &str, image: &str| {
        let mut command = Command::new(assert_cmd::cargo::cargo_bin!("qcball"));
        command.args(["measure", &path(rest), &path(image), "--json"]);
        let output = command.assert().success().get_output().stdout.clone();
        serde_json::from_slice::<serde_json::Value>(&output).unwrap()
    };
    let split = optimize("out.mesh", &[]);
    assert_eq!(split["locked"], 0);
    assert_eq!(measure("out-domain.mesh", "out.mesh")["max_k"], split["final"]["max_k"]);
    let kept = optimize("kept.mesh", &["--keep-mesh"]);
    assert!(kept["locked"].as_u64().unwrap() > 0 && kept["tets"] == 48);
    assert_eq!(measure("rest.mesh", "kept.mesh")["max_k"], kept["final"]["max_k"]);
    // With the boundary values of a linear map, that map is optimal; the polish may give 2e-4 of K for a lower mean.
    for report in [&split, &kept] {
        let (before, after) =
            (report["initial"]["max_k"].as_f64().unwrap(), report["final"]["max_k"].as_f64().unwrap());
        assert!(after <= before * (1.0 + 2e-4 + 1e-12), "{before} {after}");
    }
    // QIS's lock file: a count with a comment, then numbers from 0.
    let all = (0..27).map(|v| v.to_string()).collect::<Vec<_>>().join("\n");
    std::fs::write(folder.path().join("lock.txt"), format!("27 #Vertices Locked\n{all}\n")).unwrap();
    // Nothing is written over what is read.
    let before = std::fs::read(folder.path().join("rest.mesh")).unwrap();
    let mut over = Command::new(assert_cmd::cargo::cargo_bin!("qcball"));
    over.args(["optimize", &path("rest.mesh"), &path("init.mesh"), &path("rest.mesh")]);
    let said = over.assert().code(2).get_output().stderr.clone();
    assert!(String::from_utf8_lossy(&said).contains("would be written over"));
    assert_eq!(std::fs::read(folder.path().join("rest.mesh")).unwrap(), before);
    let locked = optimize("locked.mesh", &["--lock", &path("lock.txt")]);
    assert_eq!((locked["stop"].as_str(), locked["locked"].as_u64()), (Some("nothing-free"), Some(48)));
}

#[test]
fn tets_that_cannot_be_untangled_are_listed() {
    let folder = tempfile::tempdir().unwrap();
    let points = vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z(), Vec3::new(0.8, 0.8, 0.8)];
    let tets = vec![[0, 1, 2, 3].map(VertexId), [1, 2, 3, 4].map(VertexId)];
    let mut image = points.clone();
    image[4] = Vec3::new(-0.5, -0.5, -0.5);
    write_medit(&folder.path().join("rest.mesh"), &points, &tets).unwrap();
    write_medit(&folder.path().join("init.mesh"), &image, &tets).unwrap();
    let mut command = Command::new(assert_cmd::cargo::cargo_bin!("qcball"));
    let paths = ["rest.mesh", "init.mesh", "out.mesh"].map(|name| folder.path().join(name));
    let output = command.arg("optimize").args(&paths).args(["--keep-mesh", "--json"]).assert().code(1);
    let report: serde_json::Value = serde_json::from_slice(&output.get_output().stdout).unwrap();
    assert_eq!(report["untangling"]["resisting"], serde_json::json!([1]));
    assert_eq!(report["stop"], "still-flipped");
    assert!(paths[2].exists());
    // Without a step there is nothing to say of what resists.
    let output = |arguments: &[&str]| {
        let mut command = Command::new(assert_cmd::cargo::cargo_bin!("qcball"));
        let command = command.arg("optimize").args(&paths).args(["--keep-mesh", "--max-iterations", "0"]);
        let output = command.args(arguments).assert().code(1);
        String::from_utf8(output.get_output().stdout.clone()).unwrap().split_whitespace().collect::<Vec<_>>().join(" ")
    };
    let report: serde_json::Value = serde_json::from_str(&output(&["--json"])).unwrap();
    assert_eq!((&report["stop"], &report["untangling"]["flipped_before"]), (&"iteration-limit".into(), &1.into()));
    let summary = output(&[]);
    assert!(summary.contains("untangled 1 flipped at the start, and no step was allowed"), "{summary}");
    assert!(summary.contains("no iteration was allowed") && !summary.contains("refine the mesh"), "{summary}");
}

#[test]
fn a_solid_that_is_not_star_shaped_is_mapped_by_its_boundary_or_from_the_farthest_points() {
    let folder = tempfile::tempdir().unwrap();
    // A block with a notch: the grid without the cells of the upper half of its middle slice.
    let (points, tets) = grid(4);
    let kept: Vec<[VertexId; 4]> = tets
        .into_iter()
        .filter(|tet| {
            let middle: Vec3 = tet.iter().map(|v| points[v.index()]).sum::<Vec3>() / 4.0;
            !(middle.x.abs() < 0.5 && middle.z > 0.5)
        })
        .collect();
    let used: std::collections::BTreeSet<u32> = kept.iter().flatten().map(|v| v.0).collect();
    let number: std::collections::HashMap<u32, u32> = used.iter().enumerate().map(|(n, &v)| (v, n as u32)).collect();
    let points: Vec<Vec3> = used.iter().map(|&v| points[v as usize]).collect();
    let tets: Vec<[VertexId; 4]> = kept.iter().map(|tet| tet.map(|v| VertexId(number[&v.0]))).collect();
    TetMesh::from_either_orientation(points.clone(), tets.clone()).unwrap();
    write_medit(&folder.path().join("notch.mesh"), &points, &tets).unwrap();
    let far = Plan::read(&config(folder.path(), "notch.mesh", "[map]\nkind = \"farthest\""), &[]).unwrap();
    let report = experiment::run(&far, &mut |_| {}).unwrap().report;
    assert!(report.warnings.iter().any(|warning| warning.contains("farthest")));
    assert!(report.map.radial_smooth_k.is_none() && report.domain.centre.is_none());
    // Left to itself, the solid is mapped onto the ball: proved bijective, from positions on the sphere.
    let plan = Plan::read(&config(folder.path(), "notch.mesh", ""), &[]).unwrap();
    let finished = experiment::run(&plan, &mut |_| {}).unwrap();
    assert!(finished.report.bijective && finished.report.achieved.last.max_k.is_finite());
    let boundary = finished.report.map.boundary_map.expect("the boundary was mapped by progressive embedding");
    assert!(boundary.max_stretch > 1.0 && boundary.max_stretch < 100.0);
    let on_boundary = finished.domain.boundary().vertex_mask().iter().zip(&finished.outcome.positions);
    assert!(on_boundary.filter(|(on, _)| **on).all(|(_, p)| (p.norm() - 1.0).abs() < 1e-15));
    // By name, "radial" still says what stands in its way.
    let radial = Plan::read(&config(folder.path(), "notch.mesh", "[map]\nkind = \"radial\""), &[]).unwrap();
    let error = experiment::run(&radial, &mut |_| {}).unwrap_err().to_string();
    assert!(error.contains("not star-shaped") && error.contains("spherical"), "{error}");
}

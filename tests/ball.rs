//! `optimize.objective = "ball"`: what becomes of K onto the ball, and how it is told.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use assert_cmd::cargo::cargo_bin;
use qcball::experiment::{self, Event};
use qcball::optimize::StopReason;
use qcball::report::write_results;
use qcball::{Plan, verify};
use serde_json::Value;

/// Exit code, standard output and standard error.
fn qcball(folder: &Path, arguments: &[&str]) -> (i32, String, String) {
    let output = Command::new(cargo_bin!("qcball")).current_dir(folder).args(arguments).output().unwrap();
    let [out, err] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    (output.status.code().unwrap(), out, err)
}

/// The report of a run of a config, whose results go to the folder `name`.
fn report(folder: &Path, name: &str, config: &str, options: &[&str]) -> Value {
    fs::write(folder.join("a.toml"), config).unwrap();
    let arguments = [&["run", "a.toml", "--out", name, "--quiet", "--json"], options].concat();
    let (code, out, err) = qcball(folder, &arguments);
    assert_eq!((code, err.as_str()), (0, ""), "{config}");
    serde_json::from_str(&out).unwrap()
}

/// A hull of few points in few tets, whose K onto the ball jumps.
fn hull(folder: &Path, off: &str, cells: usize, boundary: &str, optimize: &str) -> String {
    fs::write(folder.join("a.off"), off).unwrap();
    format!("[domain]\nfile = \"a.off\"\n[mesh]\ncells = {cells}\n[boundary]\n{boundary}\n[optimize]\n{optimize}\n")
}

const TETRAHEDRON: &str = "\
OFF
4 4 0
-0.205 -1.123 0.098
0.107 -0.743 2.148
-1.840 0.213 -0.045
0.711 1.885 -0.435
3 0 1 2
3 0 3 1
3 0 2 3
3 1 3 2
";

const HULL: &str = "\
OFF
8 12 0
0.802 -0.203 0.139
-1.553 0.180 0.119
-0.017 -0.763 -0.551
-0.009 0.954 -0.311
1.692 0.697 0.405
-0.404 -2.323 -0.742
-2.004 -0.514 -0.291
-0.658 1.054 -0.188
3 0 4 1
3 0 1 5
3 0 5 4
3 1 4 7
3 1 6 5
3 1 7 6
3 2 3 4
3 2 5 3
3 2 4 5
3 3 7 4
3 3 5 6
3 3 6 7
";

const BIPYRAMID: &str = "\
OFF
5 6 0
-1.187 -0.154 -2.317
2.103 0.464 0.358
-0.369 0.698 0.385
0.555 -0.609 -0.166
0.367 1.195 -0.550
3 0 1 3
3 0 4 1
3 0 3 2
3 0 2 4
3 1 2 3
3 1 4 2
";

const LONG_HULL: &str = "\
OFF
6 8 0
1.517 -0.969 0.643
-0.926 0.975 -0.838
1.745 0.832 -0.004
-0.247 -1.418 -1.536
0.213 -0.364 0.571
-2.014 -1.021 0.181
3 0 3 2
3 0 2 4
3 0 5 3
3 0 4 5
3 1 2 3
3 1 4 2
3 1 3 5
3 1 5 4
";

const BRACKET: &str = "\
OFF
12 20 0
0 0 0
2 0 0
2 1 0
1 1 0
1 2 0
0 2 0
0 0 1
2 0 1
2 1 1
1 1 1
1 2 1
0 2 1
3 0 3 1
3 6 7 9
3 1 3 2
3 7 8 9
3 0 5 3
3 6 9 11
3 3 5 4
3 9 10 11
3 0 1 7
3 0 7 6
3 1 2 8
3 1 8 7
3 2 3 9
3 2 9 8
3 3 4 10
3 3 10 9
3 4 5 11
3 4 11 10
3 5 0 6
3 5 6 11
";

#[test]
fn the_certified_k_is_at_most_that_of_the_start_and_of_the_map_onto_the_polyhedron() {
    let folder = tempfile::tempdir().unwrap();
    // By points of the tets 6,900 and 51,000 of maps whose K is 38,000 and 130,000 between them.
    for (off, cells, boundary) in [(TETRAHEDRON, 100, "corners = 1.1"), (HULL, 200, "corners = 1.3")] {
        let of = |objective: &str, optimize: &str| {
            let config = hull(folder.path(), off, cells, boundary, &format!("objective = \"{objective}\"\n{optimize}"));
            let run = report(folder.path(), objective, &config, &["--threads", "1"]);
            ["initial", "final"].map(|map| run[map]["ball_k"]["certified"].as_f64().unwrap())
        };
        let ([start, ball], [_, polyhedron]) = (of("ball", ""), of("max", "polish = \"none\""));
        assert!(ball <= start.min(polyhedron), "{ball} {start} {polyhedron}");
    }
}

/// Of a coarse hull K onto the ball rises as its image opens. On the way a boundary that slides comes below the bounds for its values in the end, which are
/// those of the start again.
#[test]
fn a_start_that_is_best_is_told_and_verified() {
    let folder = tempfile::tempdir().unwrap();
    let config = hull(folder.path(), BIPYRAMID, 60, "values = \"sliding\"", "objective = \"ball\"");
    let run = report(folder.path(), "run", &config, &["--threads", "1"]);
    assert!(run["initial"] == run["final"] && run["stop"] == "no-progress", "{run}");
    let trace = fs::read_to_string(folder.path().join("run/trace.csv")).unwrap();
    let k = |row: &str| row.split(',').nth(3).unwrap().parse::<f64>().unwrap();
    let bound = run["best_bound"].as_f64().unwrap();
    assert!(trace.lines().skip(1).any(|row| k(row) < bound), "{bound}: {trace}");
    let summary = fs::read_to_string(folder.path().join("run/summary.txt")).unwrap().replace("\n            ", " ");
    assert!(
        summary.contains("no step lowered the objective") && summary.contains(": the final map is the start"),
        "{summary}"
    );
    let (code, said, _) = qcball(folder.path(), &["verify", "run"]);
    assert!(code == 0 && said.ends_with("\nverified\n"), "{said}");
}

/// With the exponents found it ends above what the search had seen with them.
#[test]
fn a_map_that_is_taken_from_the_search_of_exponents_has_its_row_and_is_verified() {
    let folder = tempfile::tempdir().unwrap();
    let boundary = "corners = \"power\"\nvalues = \"sliding\"";
    let config = hull(folder.path(), LONG_HULL, 100, boundary, "objective = \"ball\"");
    let config = config.replace("cells = 100", "subdivisions = 1\nlayers = 2");
    let run = report(folder.path(), "run", &config, &["--threads", "1"]);
    let trace = fs::read_to_string(folder.path().join("run/trace.csv")).unwrap();
    assert!(run["corners"].is_array() && trace.contains("\nfrom the search,"), "{trace}");
    let (code, said, _) = qcball(folder.path(), &["verify", "run"]);
    assert!(code == 0 && said.ends_with("\nverified\n"), "{said}");
}

/// The rounds begin at the start, which is less than the map onto the polyhedron by more than a fifth, and no step from it leads down; but from that map.
#[test]
fn where_no_step_from_the_start_leads_down_rounds_begin_at_the_map_onto_the_polyhedron() {
    let folder = tempfile::tempdir().unwrap();
    let k = |map: &Value| map["ball_k"]["certified"].as_f64().unwrap();
    for values in ["fixed", "sliding"] {
        let config = hull(folder.path(), BRACKET, 100, &format!("values = \"{values}\""), "objective = \"ball\"");
        let config = config.replace("cells = 100", "subdivisions = 1\nlayers = 3");
        let run = report(folder.path(), values, &config, &["--threads", "1"]);
        assert!(k(&run["final"]) < k(&run["initial"]) && run["stop"] == "converged", "{run}");
        let (code, said, _) = qcball(folder.path(), &["verify", values]);
        assert!(code == 0 && said.ends_with("\nverified\n"), "{said}");
    }
}

/// Powers cost more than they gain there, since edges are halved for them. K onto the ball is told after a signal, too.
#[test]
fn after_a_signal_the_better_of_the_maps_with_powers_and_without_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let config = hull(folder.path(), TETRAHEDRON, 100, "corners = \"power\"", "objective = \"ball\"");
    let config = config.replace("cells = 100", "subdivisions = 1\nlayers = 2");
    fs::write(folder.path().join("a.toml"), &config).unwrap();
    let plan = Plan::read(&folder.path().join("a.toml"), &[]).unwrap();
    let cancel = &plan.optimize.cancel;
    // The first row is of the search of exponents, after the map without.
    let finished = experiment::run_and_tell(&plan, &mut |event| {
        if matches!(event, Event::Row(_)) {
            cancel.raise();
        }
    })
    .unwrap();
    let achieved = &finished.report.achieved;
    assert_eq!(achieved.stop, StopReason::Cancelled);
    assert!(finished.corners.is_none() && achieved.iterations > 1, "{achieved:?}");
    let [first, last] = [achieved.initial.ball_k, achieved.last.ball_k].map(|k| k.unwrap().certified);
    assert!(last <= first, "{last} {first}");
    let out = folder.path().join("out");
    write_results(&out, &finished.report, &finished.record()).unwrap();
    let found = verify::verify(&out).unwrap();
    assert!(found.verified, "{found}");
}

#[test]
fn slivers_by_rounding_do_not_raise_the_certified_k_of_a_symmetric_linear_map() {
    let folder = tempfile::tempdir().unwrap();
    let config = "[domain]\nsolid = \"box\"\nsize = [1, 1, 3]\n[mesh]\nkind = \"flag\"\nrings = 3\nlayers = 3\ngrading = 1\nlayer_grading = 1\n\
                  [boundary]\nvalues = \"sliding\"\n[optimize]\nobjective = \"ball\"\nsymmetric = true\n";
    for sectors in [1, 2] {
        let symmetric =
            report(folder.path(), &sectors.to_string(), config, &["--set", &format!("mesh.sectors={sectors}")]);
        let [certified, sampled] =
            ["certified", "sampled"].map(|end| symmetric["final"]["ball_k"][end].as_f64().unwrap());
        // 22.0 and 11.1 with two sectors: tets touch cones beside theirs in vertices, in exact positions. Now as near as bounds of many tets are brought,
        // with what is allowed for the points that are sampled.
        assert!(sampled <= certified && certified <= sampled * 1.01, "{sectors}: {certified} {sampled}");
        let (code, said, _) = qcball(folder.path(), &["verify", &sectors.to_string()]);
        assert!(code == 0 && said.ends_with("\nverified\n"), "{said}");
    }
}

#[test]
fn more_iterations_never_end_with_a_larger_k_onto_the_ball() {
    let folder = tempfile::tempdir().unwrap();
    let config = "[domain]\nsolid = \"box\"\nsize = [1, 1, 2]\n[mesh]\nkind = \"flag\"\nsectors = 3\nrings = 2\nlayers = 3\n\
                  [boundary]\nvalues = \"sliding\"\ncorners = 1.5\n[optimize]\nobjective = \"ball\"\nsymmetric = true\n";
    let of = |most: &str| {
        let run = report(folder.path(), most, config, &["--set", &format!("optimize.max_iterations={most}")]);
        run["final"]["ball_k"]["sampled"].as_f64().unwrap()
    };
    // On the way to the least K onto the polyhedron K onto the ball is 7.8 after 8 steps, 8.0 after 12 and 7.2 after 24.
    let found = ["0", "8", "12", "24", "1000"].map(of);
    assert!(found.is_sorted_by(|a, b| b <= a) && found[4] < 0.9 * found[3], "{found:?}");
}

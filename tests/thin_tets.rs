//! Solids and layers so thin that bounds with estimated rounding were false: no proved bound is above what a map achieves.

use std::path::Path;

use qcball::config::Plan;
use qcball::experiment;

/// The run of a config with few iterations: it ends as an error where a bound contradicts the map.
fn gap(folder: &Path, config: &str) -> Option<f64> {
    let path = folder.join("config.toml");
    std::fs::write(&path, config).unwrap();
    let plan = Plan::read(&path, &["optimize.max_iterations=40".to_string()]).unwrap();
    let finished = experiment::run(&plan, &mut |_| {}).unwrap();
    finished.report.achieved.best.gap
}

#[test]
fn graded_layers_of_built_in_solids() {
    let folder = tempfile::tempdir().unwrap();
    let solids = [
        "solid = \"ellipsoid\"\nradii = [1, 1, 10]\nresolution = 1",
        "solid = \"cube\"",
        "solid = \"icosahedron\"",
        "solid = \"pyramid\"\nsides = 4\nheight = 1",
        "solid = \"box\"\nsize = [1, 1, 2e-4]",
        "solid = \"box\"\nsize = [1, 5e3, 0.7]",
    ];
    for solid in solids {
        for grading in [0.01, 0.001, 100.0] {
            let config = format!("[domain]\n{solid}\n[mesh]\nsubdivisions = 1\nlayers = 4\ngrading = {grading}\n");
            // What the ratio may miss of 1 is the rounding of the measured K: eps times conditions of up to 1e9.
            let gap = gap(folder.path(), &config);
            assert!(gap.is_none_or(|gap| gap >= 1.0 - 1e-6), "{solid} {grading}: {gap:?}");
        }
    }
}

#[test]
fn an_edge_of_a_billionth_of_the_solid() {
    // An octahedron whose top is an edge.
    let surface = "v 1 0 0\nv 0 1 0\nv -1 0 0\nv 0 -1 0\nv 0 0 -1\nv 5e-10 0 1\nv -5e-10 0 1\n\
        f 1 2 6\nf 2 7 6\nf 2 3 7\nf 3 4 7\nf 4 6 7\nf 4 1 6\nf 2 1 5\nf 3 2 5\nf 4 3 5\nf 1 4 5\n";
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("s.obj"), surface).unwrap();
    for grading in [0.001, 0.01, 1.0] {
        let config = format!("[domain]\nfile = \"s.obj\"\n[mesh]\nsubdivisions = 1\nlayers = 4\ngrading = {grading}\n");
        let gap = gap(folder.path(), &config);
        assert!(gap.is_none_or(|gap| gap >= 1.0 - 1e-6), "{grading}: {gap:?}");
    }
}

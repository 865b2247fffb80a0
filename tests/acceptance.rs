//! What was promised of whole runs, through the program itself: published figures, and the same bits for any number of threads.

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use assert_cmd::cargo::cargo_bin;
use serde_json::Value;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Runs a config, given relative to the repository, and leaves the results in `out`.
fn run(config: &str, arguments: &[&str], out: &Path) {
    let mut command = Command::new(cargo_bin!("qcball"));
    command.current_dir(root()).args(["run", config, "--quiet", "--out"]).arg(out).args(arguments);
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{config}: {}", String::from_utf8_lossy(&output.stderr));
}

fn report(out: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(out.join("report.json")).unwrap()).unwrap()
}

fn number(report: &Value, pointer: &str) -> f64 {
    report.pointer(pointer).and_then(Value::as_f64).unwrap_or_else(|| panic!("{pointer} in {report}"))
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes minutes without optimization: cargo test --release")]
fn the_cube_starts_as_published_and_ends_below_the_promised_dilatations() {
    let out = tempfile::tempdir().unwrap();
    run("configs/cube.toml", &[], out.path());
    let report = report(out.path());
    // Published with eight decimals.
    assert!((number(&report, "/initial/max_k") - 5.80100003).abs() < 1e-8, "{}", report["initial"]);
    assert!((number(&report, "/initial/mean_k") - 3.38200390).abs() < 1e-8, "{}", report["initial"]);
    assert!(number(&report, "/final/max_k") <= 5.70, "{}", report["final"]);
    assert!(number(&report, "/final/mean_k") <= 2.50, "{}", report["final"]);
    assert_eq!((number(&report, "/final/flipped"), &report["bijective"]), (0.0, &Value::Bool(true)));
    assert!(number(&report, "/best_bound") <= number(&report, "/final/max_k"));
}

/// The start is linear in the cone over each triangle: its largest K is that of the worst cone, here by nalgebra's SVD.
#[test]
#[cfg_attr(debug_assertions, ignore = "takes minutes without optimization: cargo test --release")]
fn a_star_starts_with_the_dilatation_of_its_worst_cone_and_ends_between_its_bound_and_that() {
    let out = tempfile::tempdir().unwrap();
    let arguments = ["--set", "mesh.subdivisions=1", "--set", "optimize.max_iterations=30"];
    run("configs/star-polyhedron.toml", &arguments, out.path());
    let report = report(out.path());
    let plan = qcball::Plan::read(&root().join("configs/star-polyhedron.toml"), &[]).unwrap();
    let qcball::config::DomainSource::Solid(solid) = plan.domain else { panic!("{:?}", plan.domain) };
    let surface = solid.surface().unwrap();
    let centre: [f64; 3] = serde_json::from_value(report["domain"]["centre"].clone()).unwrap();
    let worst = surface.ids().map(|triangle| {
        let corners = surface.corners(triangle).map(|p| p - qcball::Vec3::from(centre));
        let cone = qcball::mesh::Mat3::from_columns(&corners);
        let image = qcball::mesh::Mat3::from_columns(&corners.map(|p| p.normalize()));
        let mut s: [f64; 3] = (image * cone.try_inverse().unwrap()).singular_values().into();
        s.sort_by(f64::total_cmp);
        (s[2] * s[1] / s[0].powi(2)).max(s[2].powi(2) / (s[1] * s[0]))
    });
    let worst = worst.fold(1.0, f64::max);
    let initial = number(&report, "/initial/max_k");
    // Cones of conditions below 1e3, in f64.
    assert!((initial - worst).abs() < 1e-10 * worst, "{initial} {worst}");
    let (last, bound) = (number(&report, "/final/max_k"), number(&report, "/best_bound"));
    assert!(1.0 < bound && bound <= last && last < initial, "{bound} {last} {initial}");
    assert_eq!((number(&report, "/final/flipped"), &report["bijective"]), (0.0, &Value::Bool(true)));
}

#[test]
fn results_are_the_same_to_the_bit_for_1_2_and_4_threads() {
    // Work is cut into chunks of 1024 tets: the smoke case has one, the octahedron several.
    let cases: [(&str, &[&str]); 2] = [
        ("configs/smoke.toml", &["--set", "domain.centre=centroid"]),
        ("configs/octahedron.toml", &["--set", "mesh.layers=5", "--set", "optimize.max_iterations=6"]),
    ];
    for (config, arguments) in cases {
        let results = |threads: &str| -> Vec<(PathBuf, String)> {
            let out = tempfile::tempdir().unwrap();
            run(config, &[arguments, &["--threads", threads]].concat(), out.path());
            let list = |folder: &Path| fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
            let mut files: Vec<PathBuf> = list(out.path()).chain(list(&out.path().join("plots"))).collect();
            files.retain(|path| path.is_file());
            files.sort();
            files.iter().map(|path| (path.file_name().unwrap().into(), timeless(path))).collect()
        };
        let alone = results("1");
        let names: Vec<&Path> = alone.iter().map(|(name, _)| name.as_path()).collect();
        let tables = ["cells.csv", "domain.vtu", "image.vtu"];
        let plots = ["bounds.svg", "cumulative.svg", "histogram.svg", "trace.svg"];
        let expected = [&tables[..], &plots, &["report.html", "report.json", "summary.txt", "trace.csv"]].concat();
        let expected: Vec<&Path> = expected.into_iter().map(Path::new).collect();
        assert_eq!(names, expected);
        for threads in ["2", "4"] {
            for ((name, one), (_, many)) in alone.iter().zip(results(threads)) {
                assert!(*one == many, "{config}: {} differs between 1 and {threads} threads", name.display());
            }
        }
    }
}

/// A file's text without what tells the time or the number of threads.
fn timeless(path: &Path) -> String {
    let text = fs::read_to_string(path).unwrap();
    let name = path.file_name().unwrap().to_str().unwrap();
    let kept = text.lines().filter_map(|line| match name {
        "report.json" => (![
            "  \"threads\": ",
            "  \"seconds\": ",
            "  \"untangling_seconds\": ",
            "  \"cpu_seconds\": ",
            "  \"peak_memory_mib\": ",
        ]
        .iter()
        .any(|key| line.starts_with(key)))
        .then_some(line),
        // The last column.
        "trace.csv" => line.rsplit_once(',').map(|(kept, _)| kept),
        _ => Some(line),
    });
    kept.collect::<Vec<_>>().join("\n")
}

//! `qcball map`, and what `qcball measure --estimator` says of its images.

use std::path::Path;

use assert_cmd::Command;
use assert_cmd::cargo::cargo_bin;
use qcball::mesh::io::{read_tets, write_medit};
use qcball::{ShellSettings, Solid, Vec3, shell_mesh};
use serde_json::Value;

/// The cube [-1, 1]^3, moved.
fn write_cube(path: &Path, to: Vec3) {
    let settings = ShellSettings { subdivisions: 1, refinement: None, layers: 3, grading: 1.0 };
    let mesh = shell_mesh(&Solid::Cube.surface().unwrap(), Vec3::zeros(), &settings).unwrap().mesh;
    let points: Vec<Vec3> = mesh.points().iter().map(|p| p + to).collect();
    write_medit(path, &points, mesh.tets()).unwrap();
}

/// Exit code, standard output and standard error.
fn qcball(folder: &Path, arguments: &[&str]) -> (i32, String, String) {
    let output = Command::new(cargo_bin!("qcball")).current_dir(folder).args(arguments).output().unwrap();
    let [out, err] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    (output.status.code().unwrap(), out, err)
}

#[test]
fn an_affine_map_is_written_on_the_same_tets_and_measured_exactly_by_every_estimator() {
    let folder = tempfile::tempdir().unwrap();
    write_cube(&folder.path().join("in.mesh"), Vec3::zeros());
    let arguments =
        ["map", "affine", "matrix=[[4, 0, 0], [0, 2, 0], [0, 0, 1]]", "offset=[1, 2, 3]", "in.mesh", "out.vtu"];
    let (code, out, err) = qcball(folder.path(), &arguments);
    assert_eq!((code, err.as_str()), (0, ""));
    assert!(out.contains("sup K_I 8.000000, sup K_O 8.000000"), "{out}");
    let [before, after] = ["in.mesh", "out.vtu"].map(|name| read_tets(&folder.path().join(name)).unwrap());
    assert_eq!(before.tets, after.tets);
    for estimator in ["paper", "volume-ratio", "gradient", "length-ratio"] {
        let arguments = ["measure", "in.mesh", "out.vtu", "--json", "--estimator", estimator, "--weights", "measure"];
        let (code, out, _) = qcball(folder.path(), &arguments);
        let said: Value = serde_json::from_str(&out).unwrap();
        assert_eq!((code, &said["estimated"]["estimator"]), (0, &Value::from(estimator)));
        assert!((said["max_k"].as_f64().unwrap() - 8.0).abs() < 1e-11);
        let of = |place: &str| said["estimated"][place]["max_k"].as_f64().unwrap();
        match estimator {
            "volume-ratio" | "gradient" => {
                assert!((of("vertices") - 8.0).abs() < 1e-11 && (of("cells") - 8.0).abs() < 1e-11)
            }
            // Random directions and edges see at most the singular values.
            _ => assert!(of("vertices") <= 8.0 + 1e-11 && of("cells") <= 8.0 + 1e-11 && of("vertices") > 1.0),
        }
    }
    let (_, without, _) = qcball(folder.path(), &["measure", "in.mesh", "out.vtu", "--json"]);
    assert!(serde_json::from_str::<Value>(&without).unwrap().get("estimated").is_none());
}

#[test]
fn caramans_map_of_a_cube_has_its_closed_form() {
    let folder = tempfile::tempdir().unwrap();
    write_cube(&folder.path().join("in.mesh"), Vec3::new(0.5, 0.0, 0.0));
    let (code, out, err) = qcball(folder.path(), &["map", "caraman", "centre=[0.5, 0, 0]", "in.mesh", "out.mesh"]);
    assert_eq!((code, err.as_str()), (0, ""));
    // ((sqrt 2 + sqrt 6) / 2)^3.
    assert!(out.contains("sup K_I 7.209769, sup K_O 7.209769"), "{out}");
    let image = read_tets(&folder.path().join("out.mesh")).unwrap();
    let farthest = image.points.iter().map(|p| p.norm()).fold(0.0, f64::max);
    assert!((farthest - 1.0).abs() < 1e-14);
}

#[test]
fn a_mirror_image_and_a_torn_mesh_are_told() {
    let folder = tempfile::tempdir().unwrap();
    write_cube(&folder.path().join("in.mesh"), Vec3::new(3.0, 0.0, 0.0));
    let (code, _, err) = qcball(folder.path(), &["map", "power", "exponent=-1", "in.mesh", "out.mesh"]);
    assert_eq!(code, 0);
    assert!(err.contains("mirror image"), "{err}");
    // Across the half-plane y = 0, x > 0.
    let (code, _, err) = qcball(folder.path(), &["map", "folding", "ratio=0.5", "in.mesh", "out.mesh"]);
    assert_eq!(code, 0);
    assert!(err.contains("tets are flipped in the image"), "{err}");
}

#[test]
fn what_cannot_be_mapped_names_the_vertex_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    write_cube(&folder.path().join("in.mesh"), Vec3::zeros());
    for (arguments, part) in [
        (vec!["zorich", "half_side=0.9", "in.mesh", "out.mesh"], "in.mesh: vertex "),
        (vec!["zorich", "half_side=0.9", "in.mesh", "out.mesh"], "move or shrink the mesh"),
        (vec!["power", "exponent=-1", "in.mesh", "out.mesh"], "move the mesh off it"),
        (vec!["power", "exponent=2", "in.mesh", "out.xyz"], "unknown file ending"),
        (vec!["power", "exponent=2", "no.mesh", "out.mesh"], "cannot read"),
        (vec!["power", "exponent=2", "in.mesh", "in.mesh"], "would be written over"),
        (vec!["power", "in.mesh", "out.mesh"], "`exponent` is missing; write for example exponent=1.5"),
        (
            vec!["pow", "in.mesh", "out.mesh"],
            "there is no map `pow`; there are affine, folding, cone, power, zorich1, zorich2, zorich and caraman",
        ),
        (vec!["composition", "in.mesh", "out.mesh"], "`maps` is missing; write for example maps=\"[{ kind"),
        (vec!["caraman", "centre=[2, 0, 0]", "in.mesh", "out.mesh"], "choose another centre"),
        (vec!["caraman", "center=[2, 0, 0]", "in.mesh", "out.mesh"], "centre=[X,Y,Z]"),
        (vec!["caraman", "centre=2", "in.mesh", "out.mesh"], "write three numbers"),
        (vec!["caraman", "exponent=-1", "in.mesh", "out.mesh"], "positive number"),
    ] {
        let (code, out, err) = qcball(folder.path(), &[vec!["map"], arguments.clone()].concat());
        assert_eq!((code, out.as_str()), (2, ""), "{arguments:?}: {err}");
        assert!(err.contains(part), "{arguments:?}: {err}");
        assert!(!folder.path().join("out.mesh").exists());
    }
}

#[test]
fn help_is_in_words_and_offers_what_can_be_given() {
    let folder = tempfile::tempdir().unwrap();
    for command in ["map", "measure"] {
        let (code, out, _) = qcball(folder.path(), &[command, "--help"]);
        assert!(code == 0 && !out.contains('`') && !out.contains("composition"), "{out}");
    }
}

/// A config of a coarse cube with the given table `[map]`, run with further options.
fn run_cube(folder: &Path, map: &str, options: &[&str]) -> (i32, String, String) {
    let config = format!("[domain]\nsolid = \"cube\"\n[mesh]\nsubdivisions = 2\nlayers = 4\n[map]\n{map}\n");
    std::fs::write(folder.join("case.toml"), config).unwrap();
    qcball(folder, &[&["run", "case.toml", "--out", "case", "--threads", "1", "--quiet", "--json"], options].concat())
}

#[test]
fn a_run_from_a_map_in_closed_form_keeps_its_boundary_and_claims_nothing_of_the_ball() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let offset = "{ kind = \"affine\", matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], offset = [0, 3, 0] }";
    let map = format!("kind = \"composition\"\nmaps = [{offset}, {{ kind = \"folding\", ratio = 1.5 }}]");
    let (code, _, err) = run_cube(folder.path(), &map, &["--set", "optimize.max_iterations=0"]);
    assert_eq!((code, err.as_str()), (0, ""));
    // Without a step the image is the map of every vertex, which `qcball map` writes as well.
    let maps = format!("maps=[{offset}, {{ kind = \"folding\", ratio = 1.5 }}]");
    let (code, ..) = qcball(folder.path(), &["map", "composition", &maps, "case/domain.vtu", "exact.vtu"]);
    assert_eq!(code, 0);
    let exact = read_tets(&at("exact.vtu")).unwrap().points;
    assert_eq!(read_tets(&at("case/image.vtu")).unwrap().points, exact);

    let (code, out, _) = run_cube(folder.path(), &map, &[]);
    let report: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((code, &report["bijective"]), (0, &Value::from(true)));
    assert!(report["radial_exponent"].is_null() && report["domain"]["centre"].is_null());
    let scope = |bound: &Value| bound["scope"].as_str().unwrap().contains("ball");
    let bounds = report["bounds"].as_array().unwrap();
    assert!(!bounds.is_empty() && !bounds.iter().any(scope), "{bounds:?}");
    let (start, end) = (report["initial"]["max_k"].as_f64().unwrap(), report["final"]["max_k"].as_f64().unwrap());
    // The folding itself has K = 1.5^2 everywhere; straight edges add to that.
    assert!(2.25 < start && end < start && end >= report["best_bound"].as_f64().unwrap(), "{start} {end}");
    let fixed = read_tets(&at("case/image.vtu")).unwrap().points;
    let kept = fixed.iter().zip(&exact).filter(|(a, b)| a == b).count();
    assert!(kept as u64 >= report["domain"]["boundary_vertices"].as_u64().unwrap() && kept < exact.len());
    let (code, said, _) = qcball(folder.path(), &["verify", "case"]);
    assert!(code == 0 && said.ends_with("\nverified\n"), "{said}");
    let (_, out, _) = run_cube(folder.path(), "kind = \"affine\"\nmatrix = [[4, 0, 0], [0, 2, 0], [0, 0, 1]]", &[]);
    let report: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(report["closed_form_k"], 8.0);
    assert!((report["initial"]["max_k"].as_f64().unwrap() - 8.0).abs() < 1e-12);
}

#[test]
fn runs_from_maps_in_closed_form_are_refused_where_there_is_no_such_map_of_the_solid() {
    let folder = tempfile::tempdir().unwrap();
    let offset = "{ kind = \"affine\", matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], offset = [0, 3, 0] }";
    let inversion = "{ kind = \"power\", exponent = -1 }";
    let reflection = "{ kind = \"affine\", matrix = [[-1, 0, 0], [0, 1, 0], [0, 0, 1]] }";
    let composed = |maps: &[&str]| format!("kind = \"composition\"\nmaps = [{}]", maps.join(", "));
    for (map, words) in [
        ("kind = \"folding\"\nratio = 1.5".to_string(), ["vertex ", "azimuth"]),
        ("kind = \"zorich2\"\nhalf_side = 1.2".to_string(), ["has no image: the zorich2 map", "half_side = 1.2"]),
        (composed(&[offset, inversion]), ["reverses orientation: ", "add a reflection"]),
        // The cube's centre goes to infinity, or far off if it is not quite the origin.
        (composed(&[inversion, reflection]), ["vertex 0 (counted from 0)", "put "]),
    ] {
        let (code, out, err) = run_cube(folder.path(), &map, &[]);
        assert!((code, out.as_str()) == (2, "") && words.iter().all(|word| err.contains(word)), "{map}: {err}");
        assert!(!folder.path().join("case").exists(), "{map}");
    }
    let (code, ..) = run_cube(folder.path(), &composed(&[offset, inversion, reflection]), &[]);
    assert_eq!(code, 0);
}

//! Results do not depend on the unit in which a solid is given: powers of two leave every bit as it is.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use assert_cmd::cargo::cargo_bin;
use qcball::mesh::io::{CellData, read_tets, write_tets};
use qcball::mesh::{Unit, Vec3};
use serde_json::Value;

/// Exponents of the units that are tried beside 1: ordinary ones, and some near the ends of the range of numbers.
const EXPONENTS: [i32; 6] = [3, -30, 260, -270, 980, -990];

fn qcball(arguments: &[&str], folder: &Path) -> Vec<u8> {
    let mut command = Command::new(cargo_bin!("qcball"));
    // Far more than is needed: what hangs is an error.
    command.current_dir(folder).args(arguments).timeout(std::time::Duration::from_secs(600));
    let output = command.output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    output.stdout
}

fn times(point: Vec3, exponent: i32) -> Vec3 {
    // In two steps: 2^-1000 is a number, and 2^1000, but not all their products with coordinates on the way.
    point.map(|x| x * 2f64.powi(exponent / 2) * 2f64.powi(exponent - exponent / 2))
}

/// An octahedron without symmetry.
fn solid(exponent: i32) -> String {
    let corners = [
        [1.37, 0.04, -0.02],
        [-0.81, 0.06, 0.03],
        [0.05, 1.12, 0.01],
        [-0.03, -0.93, 0.08],
        [0.02, 0.07, 0.88],
        [0.09, -0.05, -1.21],
    ];
    let vertices: String = corners
        .iter()
        .map(|&corner| times(corner.into(), exponent))
        .map(|p| format!("v {:e} {:e} {:e}\n", p.x, p.y, p.z))
        .collect();
    vertices + "f 1 3 5\nf 3 2 5\nf 2 4 5\nf 4 1 5\nf 3 1 6\nf 2 3 6\nf 4 2 6\nf 1 4 6\n"
}

/// What a report holds that is no length.
fn scale_free(report: &Value) -> Value {
    let mut report = report.clone();
    let keys = ["/domain/volume", "/domain/centre", "/domain/kernel_radius", "/domain/solid", "/input_hash"];
    for key in keys.into_iter().chain(["/config", "/config_hash", "/config_text", "/name", "/bottleneck/place"]) {
        *report.pointer_mut(key).unwrap_or_else(|| panic!("{key}")) = Value::Null;
    }
    for bound in report["bounds"].as_array_mut().unwrap() {
        bound["place"] = Value::Null;
    }
    let times = ["threads", "seconds", "untangling_seconds", "cpu_seconds", "peak_memory_mib"];
    times.iter().for_each(|key| drop(report.as_object_mut().unwrap().remove(*key)));
    report
}

#[test]
fn a_run_gives_the_same_bits_in_any_unit_and_lengths_in_the_users() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let run = |exponent: i32| -> Value {
        let name = format!("unit{exponent}");
        fs::write(at(&format!("{name}.obj")), solid(exponent)).unwrap();
        let edge = times(Vec3::repeat(0.7), exponent).x;
        let config = format!("[domain]\nfile = \"{name}.obj\"\n[mesh]\nlayers = 2\nedge_length = {edge:e}\n");
        fs::write(at(&format!("{name}.toml")), config).unwrap();
        let (config, out) = (format!("{name}.toml"), format!("out{exponent}"));
        let printed = qcball(&["run", &config, "--json", "--threads", "1", "--out", &out], folder.path());
        qcball(&["verify", &out], folder.path());
        serde_json::from_slice(&printed).unwrap()
    };
    let one = run(0);
    let mesh = |exponent: i32, name: &str| read_tets(&at(&format!("out{exponent}/{name}"))).unwrap();
    for exponent in EXPONENTS {
        let other = run(exponent);
        assert_eq!(scale_free(&other), scale_free(&one), "2^{exponent}");
        for axis in 0..3 {
            let [here, there] = [&one, &other].map(|report| report["domain"]["centre"][axis].as_f64().unwrap());
            assert_eq!(times(Vec3::repeat(here), exponent).x, there, "2^{exponent}");
        }
        let domain = mesh(exponent, "domain.vtu");
        for (here, there) in mesh(0, "domain.vtu").points.iter().zip(&domain.points) {
            assert_eq!(times(*here, exponent), *there, "2^{exponent}");
        }
        assert_eq!(mesh(exponent, "image.vtu"), mesh(0, "image.vtu"), "2^{exponent}");
        // A volume beyond the range of numbers is infinite, which is null, or 0.
        let volume = &other["domain"]["volume"];
        match exponent {
            980 => assert!(volume.is_null()),
            -990 => assert_eq!(volume.as_f64(), Some(0.0)),
            _ => assert!(volume.as_f64().unwrap() > 0.0),
        }
    }
}

#[test]
fn given_meshes_are_measured_bounded_and_optimized_alike_in_any_units() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::write(at("a.obj"), solid(0)).unwrap();
    fs::write(
        at("a.toml"),
        "[domain]\nfile = \"a.obj\"\n[mesh]\nlayers = 2\nsubdivisions = 1\n[optimize]\nmax_iterations = 2\n",
    )
    .unwrap();
    qcball(&["run", "a.toml", "--quiet", "--out", "out"], folder.path());
    let [domain, image] = ["domain", "image"].map(|name| read_tets(&at(&format!("out/{name}.vtu"))).unwrap());
    let written = |exponents: [i32; 2]| {
        for (name, soup, exponent) in [("d.mesh", &domain, exponents[0]), ("i.mesh", &image, exponents[1])] {
            let points: Vec<Vec3> = soup.points.iter().map(|&point| times(point, exponent)).collect();
            write_tets(&at(name), &points, &soup.tets, &CellData::new()).unwrap();
        }
    };
    let json = |arguments: &[&str]| -> Value {
        let mut json: Value = serde_json::from_slice(&qcball(arguments, folder.path())).unwrap();
        for bound in json["bounds"].as_array_mut().into_iter().flatten() {
            bound["place"] = Value::Null;
        }
        let times = ["threads", "seconds", "untangling_seconds", "cpu_seconds", "peak_memory_mib"];
        times.iter().for_each(|key| drop(json.as_object_mut().unwrap().remove(*key)));
        json
    };
    let commands = [
        &["measure", "d.mesh", "i.mesh", "--json"][..],
        &["bounds", "d.mesh", "i.mesh", "--json"],
        &["optimize", "d.mesh", "i.mesh", "o.mesh", "--json", "--threads", "1", "--max-iterations", "30"],
    ];
    written([0, 0]);
    let expected = commands.map(json);
    let optimized = read_tets(&at("o.mesh")).unwrap().points;
    for exponents in [[5, -7], [300, 0], [-280, 10], [970, -960]] {
        written(exponents);
        assert_eq!(commands.map(json), expected, "2^{exponents:?}");
        for (here, there) in optimized.iter().zip(&read_tets(&at("o.mesh")).unwrap().points) {
            assert_eq!(times(*here, exponents[1]), *there, "2^{exponents:?}");
        }
    }
}

/// A solid of size 1 at 1e8: coordinates have 8 digits left.
#[test]
fn a_solid_far_from_the_origin_is_mapped_as_well_as_its_digits_allow() {
    let folder = tempfile::tempdir().unwrap();
    let run = |offset: f64| -> f64 {
        let moved: String = solid(0)
            .lines()
            .map(|line| match line.strip_prefix("v ") {
                Some(numbers) => {
                    let numbers: Vec<f64> = numbers.split(' ').map(|x| x.parse::<f64>().unwrap() + offset).collect();
                    format!("v {} {} {}\n", numbers[0], numbers[1], numbers[2])
                }
                None => format!("{line}\n"),
            })
            .collect();
        fs::write(folder.path().join("a.obj"), moved).unwrap();
        let config = "[domain]\nfile = \"a.obj\"\n[mesh]\nlayers = 2\nsubdivisions = 1\n";
        fs::write(folder.path().join("a.toml"), config).unwrap();
        let printed = qcball(&["run", "a.toml", "--json", "--out", "out"], folder.path());
        qcball(&["verify", "out"], folder.path());
        let report: Value = serde_json::from_slice(&printed).unwrap();
        report["initial"]["max_k"].as_f64().unwrap()
    };
    let (near, far) = (run(0.0), run(1e8));
    // Coordinates are off by 1e-8 of the size; conditions are some tens.
    assert!((near / far - 1.0).abs() < 1e-5, "{near} {far}");
}

#[test]
fn units_take_and_give_back() {
    let points = [Vec3::new(-3e-200, 0.0, 1e-205), Vec3::new(5e-200, 2e-201, 0.0)];
    let unit = Unit::of(&points);
    assert_eq!(unit.give_back_points(&unit.take_points(&points)), points);
}

//! `qcball measure` and `qcball bounds` on maps whose dilatation is known in closed form.

use assert_cmd::Command;
use assert_cmd::cargo::cargo_bin;
use qcball::mesh::io::write_medit;
use qcball::mesh::{Vec3, VertexId};
use serde_json::Value;

const TETS: [[u32; 4]; 2] = [[0, 1, 2, 3], [1, 2, 3, 4]];

fn points() -> Vec<Vec3> {
    vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z(), Vec3::new(1.0, 1.0, 1.0)]
}

/// Points and tets as they stand in a file.
type Mesh<'a> = (&'a [Vec3], [[u32; 4]; 2]);

/// Writes two meshes and asks for JSON on the map between them.
fn ask(command: &str, rest: Mesh, image: Mesh) -> Value {
    serde_json::from_str(&answer(command, rest, image, &["--json"])).unwrap()
}

fn answer(command: &str, rest: Mesh, image: Mesh, flags: &[&str]) -> String {
    let folder = tempfile::tempdir().unwrap();
    for (name, (points, tets)) in [("rest.mesh", rest), ("image.mesh", image)] {
        write_medit(&folder.path().join(name), points, &tets.map(|tet| tet.map(VertexId))).unwrap();
    }
    let mut qcball = Command::new(cargo_bin!("qcball"));
    let output =
        qcball.current_dir(folder.path()).args([command, "rest.mesh", "image.mesh"]).args(flags).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn a_stretch_has_its_closed_form_whatever_the_orientation_of_the_file() {
    // Singular values 4, 2, 1: K_I = 4 * 2 / 1 and K_O = 16 / 2.
    let rest = points();
    let stretched: Vec<Vec3> = rest.iter().map(|p| Vec3::new(4.0 * p.x, 2.0 * p.y, p.z)).collect();
    let turned = TETS.map(|[a, b, c, d]| [a, b, d, c]);
    for (rest_tets, image_tets) in [(TETS, TETS), (turned, turned), (TETS, turned)] {
        let json = ask("measure", (&rest, rest_tets), (&stretched, image_tets));
        for key in ["max_k", "mean_k", "p99_k", "max_k_inner", "max_k_outer"] {
            assert!((json[key].as_f64().unwrap() - 8.0).abs() < 1e-12, "{key}: {json}");
        }
        for (key, value) in [("flipped", 0), ("tets", 2), ("vertices", 5), ("locked", 2)] {
            assert_eq!(json[key], value, "{key}: {json}");
        }
    }
}

#[test]
fn a_mirror_image_that_is_to_be_optimized_is_called_one() {
    let folder = tempfile::tempdir().unwrap();
    let mirrored: Vec<Vec3> = points().iter().map(|p| Vec3::new(p.y, p.x, p.z)).collect();
    for (name, points) in [("rest.mesh", points()), ("image.mesh", mirrored)] {
        write_medit(&folder.path().join(name), &points, &TETS.map(|tet| tet.map(VertexId))).unwrap();
    }
    let ask = |arguments: &[&str]| {
        let output = Command::new(cargo_bin!("qcball")).current_dir(folder.path()).args(arguments).output().unwrap();
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let said = ask(&["optimize", "rest.mesh", "image.mesh", "out.mesh", "--quiet"]);
    assert!(said.contains("2 of 2 tets are turned over") && said.contains("mirror image"), "{said}");
    // What it says to do mends it.
    ask(&["map", "affine", "matrix=[[-1, 0, 0], [0, 1, 0], [0, 0, 1]]", "image.mesh", "OUT.mesh"]);
    assert_eq!(ask(&["optimize", "rest.mesh", "OUT.mesh", "out.mesh", "--quiet"]), "");
}

#[test]
fn a_flipped_tet_makes_k_infinite_which_is_null() {
    let rest = points();
    let mut image = points();
    image[4] = Vec3::new(-1.0, -1.0, -1.0);
    let json = ask("measure", (&rest, TETS), (&image, TETS));
    assert!(json["max_k"].is_null() && json["mean_k"].is_null(), "{json}");
    assert_eq!(json["flipped"], 1);
    assert_eq!(json["max_k_inner_unflipped"], 1.0);
}

#[test]
fn a_mirror_image_is_recognized() {
    let mirrored: Vec<Vec3> = points().iter().map(|p| Vec3::new(-p.x, p.y, p.z)).collect();
    let text = answer("measure", (&points(), TETS), (&mirrored, TETS), &[]);
    assert!(text.contains("inf") && text.contains("mirror image"), "{text}");
}

#[test]
fn locked_tets_prove_their_own_dilatation() {
    let rest = points();
    let stretched: Vec<Vec3> = rest.iter().map(|p| Vec3::new(4.0 * p.x, 2.0 * p.y, p.z)).collect();
    let json = ask("bounds", (&rest, TETS), (&stretched, TETS));
    assert!((json["best_bound"].as_f64().unwrap() - 8.0).abs() < 1e-9, "{json}");
    assert!((json["gap"].as_f64().unwrap() - 1.0).abs() < 1e-9, "{json}");
    let locked = json["bounds"].as_array().unwrap().iter().find(|bound| bound["name"] == "locked").unwrap();
    assert_eq!((&locked["certified"], &locked["applies"]), (&true.into(), &true.into()));
    let text = answer("bounds", (&rest, TETS), (&stretched, TETS), &[]);
    assert!(text.contains("locked") && text.contains("best bound  K >= 8.0000"), "{text}");
}

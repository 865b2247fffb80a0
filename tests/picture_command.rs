//! `qcball picture`: files, endings and refusals.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use assert_cmd::cargo::cargo_bin;
use qcball::mesh::io::{CellData, read_tets, write_tets};
use qcball::mesh::{TetMesh, Vec3};
use qcball::{ShellSettings, Solid, shell_mesh};

fn cube(folder: &Path) {
    let surface = Solid::Cube.surface().unwrap();
    let settings = ShellSettings { subdivisions: 1, refinement: None, layers: 2, grading: 1.0 };
    let mesh: TetMesh = shell_mesh(&surface, Vec3::zeros(), &settings).unwrap().mesh;
    write_tets(&folder.join("rest.mesh"), mesh.points(), mesh.tets(), &CellData::new()).unwrap();
    let image: Vec<Vec3> = mesh.points().iter().map(|p| Vec3::new(p.x, 3.0 * p.y, p.z)).collect();
    for name in ["image.mesh", "image.vtu"] {
        write_tets(&folder.join(name), &image, mesh.tets(), &CellData::new()).unwrap();
    }
}

fn picture(folder: &Path, words: &[&str]) -> (Option<i32>, String) {
    let mut command = Command::new(cargo_bin!("qcball"));
    let output = command.current_dir(folder).arg("picture").args(words).output().unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn every_colour_of_a_map_is_drawn_and_repeated_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    cube(folder.path());
    for colour in ["k", "k-inner", "k-outer", "jacobian", "domain", "curvature", "dihedral"] {
        let bytes = ["a.png", "b.png"].map(|name| {
            let words =
                ["rest.mesh", "image.mesh", name, "--colour", colour, "--cut", "1,1,0,0.3", "--view", "-1,-2,0.5"];
            assert_eq!(picture(folder.path(), &words), (Some(0), String::new()), "{colour}");
            fs::read(folder.path().join(name)).unwrap()
        });
        assert!(bytes[0] == bytes[1] && bytes[0].starts_with(b"\x89PNG"), "{colour}");
    }
    assert_eq!(picture(folder.path(), &["rest.mesh", "alone.png"]).0, Some(0));
    // What a picture wrote may be written over.
    for _ in 0..2 {
        assert_eq!(picture(folder.path(), &["rest.mesh", "image.mesh", "boundary.vtu"]).0, Some(0));
    }
    let data = fs::read_to_string(folder.path().join("boundary.vtu")).unwrap();
    for name in ["K_outer", "mean_curvature_image", "dihedral_angle"] {
        assert!(data.contains(&format!("Name=\"{name}\"")), "{name}");
    }
}

#[test]
fn what_cannot_be_drawn_is_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    cube(folder.path());
    for (words, part) in [
        (&["rest.mesh", "out.gif"][..], "written as .png"),
        (&["rest.mesh", "out.png", "--colour", "k"], "give the image too"),
        (&["rest.mesh", "out.png", "--cut", "1,0,0,-5"], "nothing is left"),
        (&["rest.mesh", "out.png", "--cut", "0,0,0,1"], "a plane is given by"),
        (&["rest.mesh", "out.png", "--view", "0,0,0"], "three numbers, not all 0"),
        (&["rest.mesh", "out.vtu", "--cut", "1,0,0,0"], "leave out --cut"),
        (&["rest.mesh", "rest.mesh"], "would be written over"),
        (&["rest.mesh", "image.vtu"], "name another file to be written, after REST and IMAGE"),
        (&["none.mesh", "out.png"], "cannot read none.mesh"),
    ] {
        let (code, said) = picture(folder.path(), words);
        assert_eq!(code, Some(2), "{words:?}: {said}");
        assert!(said.contains(part), "{words:?}: {said}");
        assert!(!folder.path().join("out.png").exists());
    }
    for name in ["rest.mesh", "image.vtu"] {
        assert!(!read_tets(&folder.path().join(name)).unwrap().tets.is_empty(), "{name}");
    }
}

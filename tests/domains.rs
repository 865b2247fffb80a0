//! What is no domain is refused by every command, whatever it is written in.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use assert_cmd::cargo::cargo_bin;
use qcball::mesh::io::{CellData, write_tets};
use qcball::mesh::{Vec3, VertexId};

/// A mesh in which two tets lie on the same side of a triangle that they share.
struct Folded {
    what: &'static str,
    points: Vec<Vec3>,
    tets: Vec<[VertexId; 4]>,
    /// Two tets that do.
    pair: [u32; 2],
}

fn folded() -> Vec<Folded> {
    let points = |rows: &[[f64; 3]]| rows.iter().map(|&row| row.into()).collect();
    let tets = |rows: &[[u32; 4]]| rows.iter().map(|row| row.map(VertexId)).collect();
    let corner = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let axes =
        [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];
    let fan = [
        [6, 0, 2, 4],
        [6, 2, 1, 4],
        [6, 1, 3, 4],
        [6, 3, 0, 4],
        [6, 2, 0, 5],
        [6, 1, 2, 5],
        [6, 3, 1, 5],
        [6, 0, 3, 5],
    ];
    let octahedron = |what, centre: [f64; 3]| Folded {
        what,
        points: points(&[&axes[..], &[centre]].concat()),
        tets: tets(&fan),
        pair: [0, 1],
    };
    vec![
        Folded {
            what: "two tets over one triangle",
            points: points(&[&corner[..], &[[0.2, 0.2, 2.0]]].concat()),
            tets: tets(&[[0, 1, 2, 3], [0, 1, 2, 4]]),
            pair: [0, 1],
        },
        Folded {
            what: "the same, the second stored with negative volume",
            points: points(&[&corner[..], &[[0.2, 0.2, 2.0]]].concat()),
            tets: tets(&[[0, 1, 2, 3], [0, 2, 1, 4]]),
            pair: [0, 1],
        },
        Folded {
            what: "three tets, the last two in order",
            points: points(&[&corner[..], &[[0.1, 0.1, 0.1], [-0.125, -0.5, -2.0]]].concat()),
            tets: tets(&[[0, 1, 2, 3], [1, 2, 3, 4], [0, 2, 1, 5]]),
            pair: [0, 1],
        },
        octahedron("an octahedron about a point outside of it", [3.0, 0.02, 0.01]),
        octahedron("the same very far outside", [-1e100, 0.02, 0.01]),
    ]
}

fn refusal(folder: &Path, arguments: &[&str]) -> String {
    let output = Command::new(cargo_bin!("qcball")).current_dir(folder).args(arguments).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).split_whitespace().collect::<Vec<_>>().join(" ");
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}{}", String::from_utf8_lossy(&output.stdout));
    assert!(output.stdout.is_empty());
    said
}

#[test]
fn a_folded_mesh_is_refused_with_the_two_tets() {
    for (Folded { what, points, tets, pair: [a, b] }, ending) in
        folded().iter().zip(["mesh", "vtu", "msh", "vtk", "mesh"])
    {
        let folder = tempfile::tempdir().unwrap();
        let file = format!("folded.{ending}");
        write_tets(&folder.path().join(&file), points, tets, &CellData::new()).unwrap();
        fs::write(folder.path().join("a.toml"), format!("[domain]\nfile = \"{file}\"\n")).unwrap();
        let file = file.as_str();
        for arguments in [
            &["run", "a.toml"][..],
            &["optimize", file, file, "out.mesh"],
            &["measure", file, file],
            &["bounds", file, file],
        ] {
            let said = refusal(folder.path(), arguments);
            let wanted = format!("the tets [{a}, {b}] lie on the same side of their common triangle");
            assert!(said.contains(&wanted) && said.contains(file), "{what}, {arguments:?}: {said}");
        }
        assert!(!folder.path().join("out.mesh").exists() && !folder.path().join("results").exists());
    }
}

//! Configs with the table `[analytic]`: the paper's tables of maps with known dilatation.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use assert_cmd::cargo::cargo_bin;
use qcball::comparison::{ComparisonRow, compare};
use qcball::config::{AnalyticPlan, CellsPlan, MeshPlan, Plan};

fn plan(name: &str) -> AnalyticPlan {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs").join(name);
    AnalyticPlan::read(&path).unwrap().expect("the table [analytic]")
}

/// Without the meshes that need a program.
fn voxels_of(name: &str) -> AnalyticPlan {
    let mut plan = plan(name);
    plan.meshes.retain(|mesh| matches!(mesh.cells, CellsPlan::Voxels(_)));
    plan
}

#[test]
fn table_2_is_within_half_a_percent_of_the_exact_dilatation_and_no_worse_than_published() {
    let rows = compare(&voxels_of("table2.toml")).unwrap().rows;
    assert_eq!(rows.len(), 6);
    for row in rows {
        let (exact, published) = (row.supremum.unwrap(), row.published.unwrap());
        assert!((row.estimated / exact - 1.0).abs() < 5e-3 && (row.per_cell / exact - 1.0).abs() < 5e-3, "{row:?}");
        assert!((row.estimated - exact).abs() <= (published - exact).abs(), "{row:?}");
        assert!((row.exact_at_vertices - exact).abs() < 1e-12);
    }
}

#[test]
fn figure_10_errors_of_voxels_fall_with_the_cells_at_second_order() {
    let comparison = compare(&voxels_of("fig10.toml")).unwrap();
    let rows = comparison.rows;
    let points: Vec<[f64; 2]> =
        rows.iter().map(|row| [row.largest_cell.cbrt().ln(), (1.0 - row.estimated / 2.25).ln()]).collect();
    // From the second mesh on, where the torus is more than two cells thick: each cell sees its map linearized, so the error
    // is of second order in its side; 1.6 allows for where the cells happen to lie.
    for pair in points[1..].windows(2) {
        assert!((pair[1][1] - pair[0][1]) / (pair[1][0] - pair[0][0]) > 1.6, "{rows:?}");
    }
    assert!(rows.last().unwrap().estimated > 2.25 * 0.99);
    let [slope] = comparison.slopes.as_slice() else { panic!("one family: {:?}", comparison.slopes) };
    assert!(slope.sizes.len() == rows.len() && slope.line(&slope.estimated).unwrap()[0] > 1.6, "{slope:?}");
}

#[test]
fn figure_11_flips_nothing_in_cones_and_comes_nearer_to_the_supremum() {
    let mut plan = plan("fig11.toml");
    plan.meshes.retain(|mesh| matches!(mesh.cells, CellsPlan::Tets(MeshPlan::Shell(_) | MeshPlan::Auto { .. })));
    let rows = compare(&plan).unwrap().rows;
    assert_eq!(rows.len(), 8);
    // On cells in the cones over the triangles the map for a = 1 is linear: no cell is flipped, and on finer ones its
    // gradient is nearer to the smooth map's.
    let error = |row: &ComparisonRow| (row.per_cell / row.supremum.unwrap() - 1.0).abs();
    for pair in rows.chunks(2) {
        assert!(pair.iter().all(|row| row.flipped == 0), "{pair:?}");
        assert!(pair[0].cells < pair[1].cells && error(&pair[1]) < error(&pair[0]), "{pair:?}");
    }
    // The radial map of the cube, in closed form.
    let cube = rows.iter().find(|row| row.mesh.starts_with("cube")).unwrap();
    assert!((cube.supremum.unwrap() - 7.2102).abs() < 1e-3);
}

#[test]
fn figure_1_inversions_keep_the_willmore_energy_and_rotations_everything() {
    let surfaces = compare(&plan("fig1.toml")).unwrap().surfaces;
    let relative = |a: f64, b: f64| (a / b - 1.0).abs();
    assert_eq!(surfaces.len(), 6);
    for row in &surfaces {
        let willmore = relative(row.after.willmore_energy, row.before.willmore_energy);
        let total = relative(row.after.total_mean_curvature, row.before.total_mean_curvature);
        match row.map.as_str() {
            // Second order in the edge length, about 0.07.
            "power, exponent -1" => assert!(willmore < 5e-3 && total > 0.5, "{row:?}"),
            map if map.contains("0.6") => assert!(willmore < 1e-12 && total < 1e-12, "{row:?}"),
            _ => assert!(willmore > 0.1, "{row:?}"),
        }
    }
}

#[test]
fn pictures_and_meshes_of_a_table_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let text = "[analytic]\nmaps = [{ kind = \"power\", exponent = 1.5 }]\nnotes = [\"A note.\"]\n\
                [analytic.pictures]\ncolours = [\"k\", \"domain\"]\ncuts = [[1, 0, 0, 4.0]]\n\
                [[analytic.meshes]]\ndomain = { solid = \"ball\" }\n\
                place = { matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], offset = [4, 0, 0] }\n";
    for (mesh, cells) in [("voxels = \"cubic(6;0;2)\"", "cubic(6;0;2)"), ("mesh = { layers = 2 }", "shell tets")] {
        fs::write(folder.path().join("small.toml"), format!("{text}{mesh}\n")).unwrap();
        let mut command = Command::new(cargo_bin!("qcball"));
        command.current_dir(folder.path()).args(["run", "small.toml", "--quiet"]).assert().success();
        let file = |name: &str| fs::read(folder.path().join("results/small").join(name)).unwrap();
        let table = String::from_utf8(file("table.md")).unwrap();
        assert!(table.contains(cells) && table.contains("\n- A note.\n"), "{table}");
        for name in ["mesh-1-map-1-k.png", "mesh-1-map-1-domain.png"] {
            assert!(file(name).starts_with(b"\x89PNG\r\n"));
        }
        for name in ["mesh-1-map-1-domain.vtu", "mesh-1-map-1-image.vtu"] {
            assert!(String::from_utf8(file(name)).unwrap().contains("\"Jacobian\""));
        }
    }
}

#[test]
fn figure_7_stays_below_the_supremum_over_the_ball() {
    for row in compare(&voxels_of("fig7.toml")).unwrap().rows {
        // The exact K at the vertices is below the ball's sup, 5.07 (map::analytic::Zorich), which is below the cylinder's.
        assert!(row.exact_at_vertices < 5.071 && (row.supremum.unwrap() - 7.3627).abs() < 1e-4, "{row:?}");
        assert!(row.estimated > 4.5 && row.estimated < 5.071, "{row:?}");
    }
}

#[test]
fn bad_analytic_configs_are_refused_and_nothing_is_written() {
    let mesh = "[[analytic.meshes]]\ndomain = { solid = \"torus\" }\n";
    let map = "maps = [{ kind = \"power\", exponent = 2 }]\n";
    for (text, part) in [
        ("analytic = 1\n".into(), "`analytic`: invalid type: integer `1`, expected the table [analytic]"),
        (format!("[analytic]\nmap = 1\n{mesh}"), "unknown key `analytic.map`"),
        (format!("[analytic]\nmaps = [{{ kind = \"caraman\", exponent = -1 }}]\n{mesh}"), "map 1: exponent is -1"),
        (
            format!(
                "[analytic]\n{map}pictures = {{ colours = [\"k\"], cuts = [[0, 0, 0, 1]] }}\n{mesh}voxels = \"cubic(4;0;2)\"\n"
            ),
            "a plane is given by",
        ),
        (format!("[analytic]\n{map}meshes = []\n"), "analytic.meshes is empty"),
        (format!("[analytic]\nmaps = []\n{mesh}voxels = \"cubic(4;0;2)\"\n"), "analytic.maps is empty"),
        (format!("[analytic]\nmaps = [{{ kind = \"power\" }}]\n{mesh}"), "missing field `exponent`"),
        (format!("[analytic]\nmaps = [{{ kind = \"power\", exponent = 0 }}]\n{mesh}"), "map 1: exponent is 0"),
        (format!("[analytic]\n{map}{mesh}"), "exactly one of `voxels`, `mesh` and `surface`"),
        (format!("[analytic]\n{map}{mesh}voxels = \"cubic(4)\"\n"), "is no voxel grid"),
        (format!("[analytic]\n{map}{mesh}voxels = \"cubic(4;0;2)\"\npublished = [1, 2]\n"), "2 values for 1 maps"),
        (
            format!(
                "[analytic]\n{map}{mesh}voxels = \"cubic(4;0;2)\"\nplace = {{ matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 0]] }}\n"
            ),
            "`place`",
        ),
        (
            format!(
                "[analytic]\n{map}[[analytic.meshes]]\ndomain = {{ solid = \"torus\", height = 2 }}\nvoxels = \"cubic(4;0;2)\"\n"
            ),
            "`height` is no parameter",
        ),
        (format!("[analytic]\n{map}{mesh}voxel = \"cubic(4;0;2)\"\n"), "unknown key `voxel`"),
        (
            format!("[analytic]\nmaps = [{{ kind = \"zorich\", half_side = 1 }}]\n{mesh}voxels = \"cubic(8;0;2)\"\n"),
            "move the solid by `place`",
        ),
    ] {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("bad.toml"), &text).unwrap();
        let output =
            Command::new(cargo_bin!("qcball")).current_dir(folder.path()).args(["run", "bad.toml"]).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{text}: {said}");
        assert!(said.contains(part), "{text}: {said}");
        assert!(!folder.path().join("results/bad/table.md").exists());
    }
    // A config without the table is another kind.
    let cube = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/cube.toml");
    assert!(AnalyticPlan::read(&cube).unwrap().is_none() && Plan::read(&cube, &[]).is_ok());
}

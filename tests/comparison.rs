//! Configs with the table `[analytic]`: the paper's tables of maps with known dilatation.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use assert_cmd::cargo::cargo_bin;
use qcball::comparison::compare;
use qcball::config::{AnalyticPlan, CellsPlan, Plan};

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
    let rows = compare(&voxels_of("table2.toml")).unwrap();
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
    let rows = compare(&voxels_of("fig10.toml")).unwrap();
    let points: Vec<[f64; 2]> =
        rows.iter().map(|row| [row.largest_cell.cbrt().ln(), (1.0 - row.estimated / 2.25).ln()]).collect();
    // From the second mesh on, where the torus is more than two cells thick: each cell sees its map linearized, so the error
    // is of second order in its side; 1.6 allows for where the cells happen to lie.
    for pair in points[1..].windows(2) {
        assert!((pair[1][1] - pair[0][1]) / (pair[1][0] - pair[0][0]) > 1.6, "{rows:?}");
    }
    assert!(rows.last().unwrap().estimated > 2.25 * 0.99);
}

#[test]
fn figure_7_stays_below_the_supremum_over_the_ball() {
    for row in compare(&voxels_of("fig7.toml")).unwrap() {
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
        (format!("[analytic]\n{map}meshes = []\n"), "analytic.meshes is empty"),
        (format!("[analytic]\nmaps = []\n{mesh}voxels = \"cubic(4;0;2)\"\n"), "analytic.maps is empty"),
        (format!("[analytic]\nmaps = [{{ kind = \"power\" }}]\n{mesh}"), "missing field `exponent`"),
        (format!("[analytic]\nmaps = [{{ kind = \"power\", exponent = 0 }}]\n{mesh}"), "map 1: exponent is 0"),
        (format!("[analytic]\n{map}{mesh}"), "exactly one of `voxels` and `mesh`"),
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

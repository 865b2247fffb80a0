//! What qcball writes, meshio and PyVista read; what they write, qcball reads.
//!
//! Needs a Python with both, `python3` or the one named by QCBALL_PYTHON. Where there is none it says so and passes, unless
//! QCBALL_PYTHON_REQUIRED is set, as CI does once it has installed them.

use std::fmt::Write;
use std::path::Path;
use std::process::Command;

use qcball::mesh::io::{CellData, write_tets};
use qcball::mesh::{Vec3, VertexId};

/// Reads every file of a folder with meshio, and with PyVista where that has a reader of its own, and compares it with
/// `expected.json`.
const CHECK: &str = r#"
import json, pathlib, sys
import meshio, numpy, pyvista
folder = pathlib.Path(sys.argv[1])
expected = json.load(open(folder / "expected.json"))
points, tets, k = [numpy.array(expected[key]) for key in ["points", "tets", "K"]]

def same(what, found, wanted):
    found = numpy.asarray(found)
    assert found.shape == wanted.shape, (what, found.shape, wanted.shape)
    # Equal to the bit, -0 too.
    assert found.astype(wanted.dtype).tobytes() == wanted.tobytes(), (what, found, wanted)

read = 0
for path in sorted(folder.iterdir()):
    ending = path.suffix[1:]
    if ending in ["vtu", "vtk", "mesh", "msh", "node", "msh2"]:
        mesh = meshio.read(path, file_format="gmsh" if ending == "msh2" else None)
        (block,) = [block for block in mesh.cells if block.type == "tetra"]
        same(path.name, mesh.points, points)
        same(path.name, block.data, tets)
        assert numpy.issubdtype(block.data.dtype, numpy.integer)
        if ending not in ["mesh", "node"]:
            same(path.name, mesh.cell_data["K"][0], k)
        read += 1
    if ending in ["vtu", "vtk"]:
        grid = pyvista.read(path)
        same(path.name, grid.points, points)
        same(path.name, grid.cells_dict[pyvista.CellType.TETRA], tets)
        same(path.name, grid.cell_data["K"], k)
        same(path.name, grid.cell_data["a <b> & c"], -k)
assert read == 6, read
"#;

/// A Python that imports meshio and PyVista.
pub(super) fn python() -> Option<String> {
    let python = std::env::var("QCBALL_PYTHON").unwrap_or_else(|_| "python3".into());
    let lack = match Command::new(&python).args(["-c", "import meshio, pyvista"]).output() {
        Ok(output) if output.status.success() => return Some(python),
        Ok(output) => String::from_utf8_lossy(&output.stderr).lines().last().unwrap_or_default().to_string(),
        Err(error) => error.to_string(),
    };
    let notice = format!("{python} cannot import meshio and pyvista: {lack}");
    assert!(std::env::var_os("QCBALL_PYTHON_REQUIRED").is_none(), "{notice}");
    eprintln!("skipped: {notice}");
    None
}

/// Runs a program that has to end well.
pub(super) fn succeed(command: &mut Command) {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn meshio_and_pyvista_read_what_was_written() {
    let Some(python) = python() else { return };
    let count = 3000;
    let mut points = vec![Vec3::new(-0.0, 1.0 / 3.0, 1e-9), Vec3::z()];
    points.extend((0..=count).map(|i| {
        let angle = f64::from(i) / f64::from(count) * 3.0;
        Vec3::new(angle.cos(), angle.sin(), 0.1 * (7.0 * angle).sin())
    }));
    let tets: Vec<[VertexId; 4]> = (0..count).map(|i| [0, i + 2, i + 3, 1].map(VertexId)).collect();
    let k: Vec<f64> = (0..count).map(|i| f64::from(i).sqrt() * 1e-7).collect();

    let folder = tempfile::tempdir().unwrap();
    let data: CellData = vec![("K".into(), k.clone()), ("a <b> & c".into(), k.iter().map(|k| -k).collect())];
    for ending in ["vtu", "vtk", "msh", "msh2"] {
        write_tets(&folder.path().join("a").with_extension(ending), &points, &tets, &data).unwrap();
    }
    for ending in ["mesh", "node"] {
        write_tets(&folder.path().join("a").with_extension(ending), &points, &tets, &vec![]).unwrap();
    }
    write_expected(folder.path(), &points, &tets, &k);
    succeed(Command::new(python).args(["-c", CHECK]).arg(folder.path()));
}

fn write_expected(folder: &Path, points: &[Vec3], tets: &[[VertexId; 4]], k: &[f64]) {
    let mut text = String::new();
    let points: Vec<[f64; 3]> = points.iter().map(|&p| p.into()).collect();
    write!(text, "{{\"points\": {points:?}, \"K\": {k:?}, ").unwrap();
    let tets: Vec<[u32; 4]> = tets.iter().map(|tet| tet.map(|v| v.0)).collect();
    write!(text, "\"tets\": {tets:?}}}").unwrap();
    std::fs::write(folder.join("expected.json"), text).unwrap();
}

#[test]
fn what_meshio_and_pyvista_write_is_read() {
    let Some(python) = python() else { return };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/formats/write.py");
    let folder = tempfile::tempdir().unwrap();
    succeed(Command::new(python).arg(script).arg(folder.path()));
    super::fixtures::check(folder.path());
}

//! What qcball writes as VTU, with every kind of array and cell, is what PyVista and meshio read.

use std::process::Command;

use super::python::{python, succeed};
use qcball::mesh::io::{DataArray, Values, write_hexahedra_vtu, write_vtu};
use qcball::mesh::{Vec3, VertexId};
use qcball::picture::BoundaryFigures;
use qcball::solid::{ShellSettings, Solid, shell_mesh, voxelize};

/// Reads `vtu` with both libraries and compares every array with the lines of `expected`, `name kind values...`.
const CHECK: &str = r#"
import sys
import meshio, numpy, pyvista
vtu, expected = sys.argv[1:]
arrays = {}
for line in open(expected):
    name, kind, *values = line.split()
    arrays[name] = numpy.array([float(v) for v in values]).reshape((-1, 3) if kind == "vector" else (-1,))

def same(what, found, wanted):
    found = numpy.asarray(found)
    assert found.shape == wanted.shape, (what, found.shape, wanted.shape)
    assert numpy.array_equal(found.astype(float), wanted), what

grid = pyvista.read(vtu)
mesh = meshio.read(vtu)
(block,) = mesh.cells
assert block.type == "tetra"
for what, points, tets in [
    ("pyvista", grid.points, grid.cells_dict[pyvista.CellType.TETRA]),
    ("meshio", mesh.points, block.data),
]:
    assert numpy.issubdtype(tets.dtype, numpy.integer), (what, tets.dtype)
    same(what + " points", points, arrays["points"])
    same(what + " tets", tets.ravel(), arrays["tets"])
    assert points[tets].shape == (len(tets), 4, 3)
for name, wanted in arrays.items():
    where, _, key = name.partition(".")
    if where == "point":
        same("pyvista " + name, grid.point_data[key], wanted)
        same("meshio " + name, mesh.point_data[key], wanted)
    if where == "cell":
        same("pyvista " + name, grid.cell_data[key], wanted)
        same("meshio " + name, mesh.cell_data[key][0], wanted)
assert set(grid.point_data) == set(mesh.point_data) == {n[6:] for n in arrays if n.startswith("point.")}
assert set(grid.cell_data) == set(mesh.cell_data) == {n[5:] for n in arrays if n.startswith("cell.")}
assert grid.cell_data["flag"].dtype == numpy.uint8
assert grid.volume > 0
"#;

fn line(name: &str, kind: &str, values: impl IntoIterator<Item = f64>) -> String {
    let values: Vec<String> = values.into_iter().map(|v| v.to_string()).collect();
    format!("{name} {kind} {}\n", values.join(" "))
}

/// A fan of `count` tets around the edge from vertex 0 to 1, numbers in every bit of the mantissa.
fn check(python: &str, count: usize) {
    let mut points = vec![Vec3::zeros(), Vec3::z()];
    points.extend((0..=count).map(|i| {
        let angle = i as f64 / count as f64 * 3.0;
        Vec3::new(angle.cos(), angle.sin(), 0.1 * (7.0 * angle).sin())
    }));
    let tets: Vec<[VertexId; 4]> = (0..count as u32).map(|i| [0, i + 2, i + 3, 1].map(VertexId)).collect();
    let mut scalars: Vec<f64> = (0..count).map(|i| (i as f64).sqrt() * 1e-7).collect();
    scalars[0] = f64::INFINITY;
    let flags: Vec<bool> = (0..count).map(|i| i % 3 == 0).collect();
    let heights: Vec<f64> = points.iter().map(|p| p.z).collect();
    let doubled: Vec<Vec3> = points.iter().map(|p| p * 2.0).collect();

    let folder = tempfile::tempdir().unwrap();
    let (vtu, expected) = (folder.path().join("a.vtu"), folder.path().join("expected.txt"));
    let point_data = [
        DataArray { name: "height", values: Values::Scalars(&heights) },
        DataArray { name: "doubled", values: Values::Vectors(&doubled) },
    ];
    let cell_data = [
        DataArray { name: "K", values: Values::Scalars(&scalars) },
        DataArray { name: "flag", values: Values::Flags(&flags) },
    ];
    write_vtu(&vtu, &points, &tets, &point_data, &cell_data).unwrap();
    let flat = |vectors: &[Vec3]| vectors.iter().flat_map(|v| [v.x, v.y, v.z]).collect::<Vec<f64>>();
    let text = [
        line("points", "vector", flat(&points)),
        line("tets", "scalar", tets.iter().flatten().map(|v| f64::from(v.0))),
        line("point.height", "scalar", heights),
        line("point.doubled", "vector", flat(&doubled)),
        line("cell.K", "scalar", scalars),
        line("cell.flag", "scalar", flags.iter().map(|&flag| flag.into())),
    ];
    std::fs::write(&expected, text.concat()).unwrap();
    succeed(Command::new(python).args(["-c", CHECK]).args([&vtu, &expected]));
}

#[test]
fn pyvista_and_meshio_read_what_was_written() {
    let Some(python) = python() else { return };
    // One block; 4096 numbers, which fill a block of 32768 bytes exactly; many blocks with a partial one.
    for count in [1, 4096, 10_001] {
        check(&python, count);
    }
}

/// Reads a mesh of boxes and a surface with both libraries: positive volumes tell the order of the corners.
const CHECK_CELLS: &str = r#"
import sys
import meshio, numpy, pyvista
boxes, surface = sys.argv[1:]
grid = pyvista.read(boxes)
(cells,) = [block.data for block in meshio.read(boxes).cells if block.type == "hexahedron"]
assert numpy.array_equal(cells, grid.cells_dict[pyvista.CellType.HEXAHEDRON])
assert list(grid.celltypes) == [pyvista.CellType.HEXAHEDRON] * grid.n_cells
volumes = grid.compute_cell_sizes()["Volume"]
assert numpy.allclose(volumes, grid.cell_data["volume"], rtol=1e-12), (volumes, grid.cell_data["volume"])

grid = pyvista.read(surface)
kinds = {block.type: block.data for block in meshio.read(surface).cells}
assert set(kinds) == {"triangle", "line"}, kinds
assert numpy.array_equal(kinds["triangle"], grid.cells_dict[pyvista.CellType.TRIANGLE])
assert numpy.array_equal(kinds["line"], grid.cells_dict[pyvista.CellType.LINE])
angles = grid.cell_data["dihedral_angle"]
assert numpy.isnan(angles[: len(kinds["triangle"])]).all() and numpy.isfinite(angles[len(kinds["triangle"]) :]).all()
assert abs(grid.compute_cell_sizes()["Area"].sum() - 24) < 1e-12
"#;

#[test]
fn pyvista_and_meshio_read_boxes_and_surfaces() {
    let Some(python) = python() else { return };
    let surface = Solid::Cube.surface().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let (boxes, boundary) = (folder.path().join("boxes.vtu"), folder.path().join("boundary.vtu"));
    // Cells of several sizes, none on the surface.
    let slanted = Solid::Octahedron.surface().unwrap();
    let voxels = voxelize(&slanted, "voxel(5,6,7;1;2)".parse().unwrap()).unwrap();
    let at = |v: VertexId| voxels.points()[v.index()];
    let volumes: Vec<f64> = voxels.cells().iter().map(|cell| (at(cell[7]) - at(cell[0])).product()).collect();
    let cell_data = [DataArray { name: "volume", values: Values::Scalars(&volumes) }];
    write_hexahedra_vtu(&boxes, voxels.points(), voxels.cells(), &[], &cell_data).unwrap();
    let settings = ShellSettings { subdivisions: 2, refinement: None, layers: 2, grading: 1.0 };
    let mesh = shell_mesh(&surface, Vec3::zeros(), &settings).unwrap().mesh;
    BoundaryFigures::of((&mesh).into(), mesh.points(), None).unwrap().write(&boundary).unwrap();
    succeed(Command::new(python).args(["-c", CHECK_CELLS]).args([&boxes, &boundary]));
}

"""The package as its users call it."""

import dataclasses
import gc
import os
import pathlib
import runpy
import signal
import subprocess
import sys
import sysconfig
import threading

import numpy as np
import pytest

import qcball

HERE = pathlib.Path(__file__).parent
REFERENCE = HERE.parents[2] / "tests" / "reference"
COMMAND = [os.environ["QCBALL_COMMAND"]] if "QCBALL_COMMAND" in os.environ else [sys.executable, "-m", "qcball"]


def bipyramid():
    points = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 2], [0, 0, -2], [0, 0, 0]], float)
    cells = np.array([[6, a, b, top] for a, b in [(0, 1), (1, 2), (2, 3), (3, 0)] for top in (4, 5)])
    return points, cells


def octahedron():
    points = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1.5]], float)
    triangles = [[x, y, z] for x in (0, 1) for y in (2, 3) for z in (4, 5)]
    return points, np.array([t if np.linalg.det(points[t]) > 0 else t[::-1] for t in triangles])


def same(one, other, but=()):
    for field in dataclasses.fields(one):
        if field.name not in but:
            np.testing.assert_equal(getattr(one, field.name), getattr(other, field.name), field.name)


def resident():
    for line in pathlib.Path("/proc/self/status").read_text().splitlines() if sys.platform == "linux" else ():
        if line.startswith("VmRSS:"):
            return 1024 * int(line.split()[1])
    return 0


def dilatations(points, cells, image):
    def edges(p):
        corners = p[cells]
        return np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)

    s1, s2, s3 = np.linalg.svd(edges(image) @ np.linalg.inv(edges(points)), compute_uv=False).T
    return s1 * s2 / s3**2, s1**2 / (s2 * s3)


def test_a_bipyramid_has_the_map_of_least_dilatation():
    # Onto the regular octahedron: the linear map with the singular values 1, 1, 1/2.
    m = qcball.ball_map(*bipyramid())
    assert m.bijective and m.cells.shape == (8, 4) and m.image.dtype == np.float64
    np.testing.assert_allclose(m.K, 4, atol=1e-5)
    np.testing.assert_allclose(m.K_outer, 2, atol=1e-5)
    assert m.max_K == m.K.max() and 1 <= m.gap < 4.0001 and m.trace and "max K" in m.summary()
    # In words too bounds are rounded to the side on which they stay bounds.
    assert float(m.summary().split("best bound ")[1].split(",")[0]) <= m.best_bound
    assert float(m.summary().split("at most ")[1].split(",")[0]) >= m.ball_K


def test_measures_agree_with_numpy():
    points, cells = qcball.read(REFERENCE / "grid-rest.mesh")
    image, _ = qcball.read(REFERENCE / "grid-bent.mesh")
    inner, outer = dilatations(points, cells, image)
    measured = qcball.measure(points, cells, image)
    np.testing.assert_allclose(measured.K_inner, inner, rtol=1e-12)
    np.testing.assert_allclose(measured.K_outer, outer, rtol=1e-12)
    np.testing.assert_array_equal(measured.K, np.maximum(measured.K_inner, measured.K_outer))
    assert measured.flipped.size == 0
    flipped = qcball.measure(points, cells, qcball.read(REFERENCE / "grid-flipped.mesh")[0])
    assert flipped.flipped.size == 6 and np.isinf(flipped.K[flipped.flipped]).all() and np.isinf(flipped.max_K)


def test_arrays_of_any_kind_give_the_same_bits():
    points, cells = bipyramid()
    image = points * [2, 1, 1] + 0.1 * points[:, ::-1] ** 2
    one = qcball.measure(points, cells, image)
    for other in (
        qcball.measure(points.tolist(), cells.tolist(), image.tolist()),
        qcball.measure(np.asfortranarray(points), cells.astype(np.int16), np.asfortranarray(image)),
        qcball.measure(points.repeat(2, axis=0)[::2], cells.astype(np.uint64)[::-1][::-1], image),
    ):
        np.testing.assert_array_equal(one.K, other.K)


def test_threads_do_not_change_a_bit():
    points, cells = qcball.read(REFERENCE / "grid-rest.mesh")
    one, two = (qcball.ball_map(points, cells, threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(one.image, two.image)
    assert one.stop == two.stop and one.bounds == two.bounds


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda p, c: (p[:, :2], c), "points has the shape (7, 2)"),
        (lambda p, c: (p, c[:, :2]), "cells has the shape (8, 2)"),
        (lambda p, c: (p, c[:, :3]), "the surface: "),
        (lambda p, c: (p, c.astype(float)), "cells has the type float64"),
        (lambda p, c: (p, np.where(c == 4, 99, c)), "row 0 of cells is [6, 0, 1, 99]"),
        (lambda p, c: (p, np.where(c == 6, -1, c)), "row 0 of cells is [-1, 0, 1, 4]"),
        (lambda p, c: (np.where(p == 2, np.nan, p), c), "row 4 of points"),
        (lambda p, c: (p, c[:0]), "no tetrahedra"),
        (lambda p, c: ("abc", c), "points must be an array of numbers"),
        (lambda p, c: (p, None), "cells has the shape ()"),
    ],
)
def test_bad_arrays_are_value_errors_that_name_the_row(change, words):
    with pytest.raises(ValueError) as error:
        qcball.ball_map(*change(*bipyramid()))
    assert words in str(error.value)


def test_fixed_vertices_stay():
    points, cells = bipyramid()
    image = points * [1, 1, 0.5]
    image[6] = 0.2, 0.1, 0.05
    held = np.array([True] * 6 + [False])
    m = qcball.optimize(points, cells, image, fixed=held)
    np.testing.assert_array_equal(m.image[:6], image[:6])
    assert m.max_K < qcball.measure(points, cells, image).max_K
    with pytest.raises(ValueError, match="mask of 7 booleans"):
        qcball.optimize(points, cells, image, fixed=[True])


def test_bounds_are_below_what_is_reached():
    m = qcball.ball_map(*bipyramid())
    found = qcball.bounds(m.points, m.cells, m.image)
    assert 1 < found.best <= m.max_K and {"name", "value", "applies"} <= found.bounds[0].keys()


def test_the_kernel_of_a_tetrahedron_is_its_insphere():
    points = [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]
    centre, radius = qcball.star_kernel(points, [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    np.testing.assert_allclose(centre, 0, atol=1e-7)
    assert abs(radius - 3**-0.5) < 1e-7


def test_progress_is_seen_and_its_errors_come_back():
    rows = []
    qcball.ball_map(*bipyramid(), progress=rows.append)
    assert rows and {"phase", "iteration", "max_K"} <= rows[0].keys()
    with pytest.raises(ZeroDivisionError):
        qcball.ball_map(*bipyramid(), progress=lambda row: 1 / 0)


def test_an_interrupt_returns_the_best_map():
    points, cells = qcball.read(REFERENCE / "grid-rest.mesh")
    # A shell starts what runs in its background with the signal ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    # The caller looks for signals every 50 ms; a machine that is too busy for that within seconds is asked again.
    for seconds in (3, 6, 12):
        interrupted = threading.Event()

        def interrupt(_row):
            if not interrupted.is_set():
                interrupted.set()
                signal.raise_signal(signal.SIGINT)
                threading.Event().wait(seconds)

        m = qcball.ball_map(points, cells, progress=interrupt)
        if m.stop == "cancelled":
            break
    signal.signal(signal.SIGINT, before)
    assert m.stop == "cancelled" and np.isfinite(m.max_K)


@pytest.mark.skipif(sys.platform != "linux", reason="needs named pipes that can be tried")
@pytest.mark.parametrize("call", [qcball.run, qcball.sweep])
def test_an_interrupt_ends_what_has_no_map_yet_whatever_it_does(tmp_path, call):
    # A mesher whose file never comes to its end, which nothing that reads it looks up from.
    mesher = tmp_path / "mesher"
    mesher.write_text('#!/bin/sh\nmkfifo surface.mesh && pwd > "$0.folder"\n')
    mesher.chmod(0o755)
    config = '[domain]\nsolid = "cube"\n[mesh]\nkind = "tetgen"\nprogram = "./mesher"\n[sweep.grid]\n"optimize.max_iterations" = [5]\n'
    (tmp_path / "a.toml").write_text(config)
    ended = threading.Event()

    def interrupt():
        while not ended.is_set():
            try:
                # It can be opened for writing once it is for reading.
                folder = (tmp_path / "mesher.folder").read_text().strip()
                pipe = os.open(os.path.join(folder, "surface.mesh"), os.O_WRONLY | os.O_NONBLOCK)
            except OSError:
                ended.wait(0.01)
                continue
            signal.raise_signal(signal.SIGINT)
            # What waits for the file still is let go in the end, and fails.
            ended.wait(60)
            os.close(pipe)
            return

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    thread = threading.Thread(target=interrupt)
    thread.start()
    try:
        if call is qcball.run:
            with pytest.raises(KeyboardInterrupt):
                call(tmp_path / "a.toml")
        else:
            assert not call(tmp_path / "a.toml", out=tmp_path / "out").is_whole
    finally:
        ended.set()
        thread.join()
        signal.signal(signal.SIGINT, before)


def test_a_surface_is_filled_and_its_boundary_slides_or_stays():
    points, triangles = octahedron()
    stays = qcball.ball_map(points, triangles, cells_wanted=300, max_iterations=20)
    assert stays.bijective and len(stays.cells) >= 300 and stays.ball_K > stays.max_K
    spherical = qcball.ball_map(points, triangles, cells_wanted=300, max_iterations=5, boundary="spherical")
    np.testing.assert_array_equal(stays.points, spherical.points)
    assert (stays.image != spherical.image).any()
    slides = qcball.ball_map(points, triangles, cells_wanted=300, max_iterations=20, values="sliding")
    on_sphere = np.linalg.norm(stays.image, axis=1) > 1 - 1e-12
    np.testing.assert_allclose(np.linalg.norm(slides.image[on_sphere], axis=1), 1, rtol=1e-12)
    assert slides.max_K < stays.max_K
    for wrong in ({"boundary": "round"}, {"values": "free"}, {"cells_wanted": 0}, {"threads": -1}, {"time_limit": 0}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            qcball.ball_map(points, triangles, **wrong)


def test_radial_and_spherical_maps():
    points, cells = bipyramid()
    image = qcball.radial_map(points, cells)
    np.testing.assert_allclose(np.linalg.norm(image[:6], axis=1), 1)
    np.testing.assert_allclose(image[4], [0, 0, 1], atol=1e-12)
    assert np.linalg.norm(image[6]) < 1e-9
    points, triangles = octahedron()
    np.testing.assert_allclose(np.linalg.norm(qcball.sphere_map(points, triangles), axis=1), 1)
    with pytest.raises(ValueError, match="6 of the 7 points"):
        qcball.sphere_map(np.vstack([points, [0, 0, 0]]), triangles)


def test_points_go_there_and_back():
    m = qcball.ball_map(*bipyramid())
    x = np.random.default_rng(1).uniform(-0.3, 0.3, (50, 3))
    for onto in ("polyhedron", "ball"):
        np.testing.assert_allclose(m.inverse(m.evaluate(x, onto=onto), onto=onto), x, atol=1e-12)
    np.testing.assert_allclose(m.evaluate(m.points), m.image, atol=1e-12)
    assert m.evaluate(x[0]).shape == (3,) and np.isnan(m.evaluate([9, 9, 9])).all()
    with pytest.raises(ValueError, match="onto"):
        m.evaluate(x, onto="moon")


def test_a_map_is_saved_and_loaded_to_the_bit(tmp_path):
    m = qcball.ball_map(*bipyramid())
    m.save(tmp_path / "map")
    same(m, qcball.load(tmp_path / "map"))
    with pytest.raises(ValueError):
        qcball.load(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError):
        m.save(tmp_path / "file")


def test_a_map_shows_itself_in_a_notebook_and_in_other_packages():
    m = qcball.ball_map(*bipyramid())
    assert m._repr_html_().startswith("<iframe srcdoc=") and "max K 4.0000" in m._repr_html_()
    assert m.to_html().startswith("<!doctype html>") and "viewer-data" in m.to_html()
    meshio = pytest.importorskip("meshio")
    assert isinstance(m.to_meshio(), meshio.Mesh) and (m.to_meshio().cell_data["K"][0] == m.K).all()
    pyvista = pytest.importorskip("pyvista")
    grid = m.to_pyvista()
    assert isinstance(grid, pyvista.UnstructuredGrid) and (grid.cell_data["K"] == m.K).all() and (grid.points == m.image).all()


SOLIDS = {
    "tetrahedron": {},
    "cube": {},
    "octahedron": {},
    "dodecahedron": {},
    "icosahedron": {},
    "box": {"domain.size": [1, 2, 3]},
    "prism": {"domain.sides": 5, "domain.height": 1.5},
    "bipyramid": {"domain.sides": 6, "domain.height": 1.0},
    "ellipsoid": {"domain.radii": [1, 1.5, 2]},
    "star-polyhedron": {"seed": 3},
}


@pytest.mark.parametrize("solid", SOLIDS)
def test_results_are_those_of_the_command_to_the_bit(solid, tmp_path):
    # QCBALL_COMMAND names the command that cargo built, in whose process there is no Python.
    (tmp_path / "a.toml").write_text(f'[domain]\nsolid = "{solid}"\n[mesh]\nsubdivisions = 1\nlayers = 2\n')
    overrides = SOLIDS[solid]
    m = qcball.run(tmp_path / "a.toml", overrides)
    words = [word for key, value in overrides.items() for word in ("--set", f"{key}={value}")]
    subprocess.run([*COMMAND, "run", "a.toml", "--out", "out", "--quiet", *words], cwd=tmp_path, check=False)
    there = qcball.load(tmp_path / "out")
    same(m, there, but=("trace", "report"))
    assert m.report["config_hash"] == there.report["config_hash"] and m.best_bound <= m.max_K
    inner, outer = dilatations(m.points, m.cells, m.image)
    np.testing.assert_allclose(m.K_inner, inner, rtol=1e-12)
    np.testing.assert_allclose(m.K_outer, outer, rtol=1e-12)
    # And the arrays' way is the files' way.
    start = qcball.radial_map(m.points, m.cells)
    improved = qcball.optimize(m.points, m.cells, start, max_iterations=5)
    qcball.Map.save(dataclasses.replace(m, image=start), tmp_path / "start")
    files = ["start/domain.vtu", "start/image.vtu", "improved.vtu"]
    subprocess.run([*COMMAND, "optimize", *files, "--max-iterations", "5", "--quiet"], cwd=tmp_path, check=False)
    np.testing.assert_array_equal(qcball.read(tmp_path / "improved.vtu")[0], improved.image)


def test_a_run_writes_its_files_and_names_what_is_wrong(tmp_path):
    (tmp_path / "a.toml").write_text('[domain]\nsolid = "cube"\n[mesh]\nsubdivisions = 1\nlayers = 1\n')
    rows = []
    m = qcball.run(tmp_path / "a.toml", {"map.exponent": 1.5, "name": "b"}, out=tmp_path / "out", progress=rows.append)
    assert rows and m.report["name"] == "b" and (tmp_path / "out/report.html").is_file()
    same(m, qcball.load(tmp_path / "out"), but=("trace",))
    with pytest.raises(ValueError, match="mesh.layer"):
        qcball.run(tmp_path / "a.toml", {"mesh.layer": 4})
    with pytest.raises(ValueError, match="no value of a config"):
        qcball.run(tmp_path / "a.toml", {"mesh.layers": object()})


def test_a_sweep_is_a_table(tmp_path):
    config = '[domain]\nsolid = "cube"\n[mesh]\nsubdivisions = 1\n[optimize]\nmax_iterations = 3\n[sweep.grid]\n"mesh.layers" = [1, 2]\n'
    (tmp_path / "a.toml").write_text(config)
    sweep = qcball.sweep(tmp_path / "a.toml", out=tmp_path / "out")
    assert sweep.is_whole and [row["status"] for row in sweep.rows] == ["done", "done"]
    assert sweep.load(2).max_K == sweep.rows[1]["results"]["max_k"]
    pytest.importorskip("pandas")
    table = qcball.sweep(tmp_path / "a.toml", out=tmp_path / "out").to_pandas()
    assert list(table["mesh.layers"]) == [1, 2] and (table["max_k"] > 1).all()


def test_the_command_comes_with_the_package(tmp_path):
    script = pathlib.Path(sysconfig.get_path("scripts")) / "qcball"
    for command in ([str(script)], [sys.executable, "-m", "qcball"]):
        said = subprocess.run([*command, "--version"], capture_output=True, text=True, check=True).stdout
        assert said.startswith("qcball ")
        wrong = subprocess.run([*command, "run", "nothing.toml"], capture_output=True, text=True, cwd=tmp_path, check=False)
        assert wrong.returncode == 2 and "nothing.toml" in wrong.stderr
    (tmp_path / "bench.toml").write_text("[optimize]\nmax_iterations = 1\n")
    m = qcball.ball_map(*bipyramid())
    m.save(tmp_path)
    (tmp_path / "domain.vtu").rename(tmp_path / "a-rest.vtu")
    (tmp_path / "image.vtu").rename(tmp_path / "a-init.vtu")
    # It starts itself again for each mesh.
    bench = subprocess.run([str(script), "bench", "bench.toml", "."], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert bench.returncode == 0 and "| a |" in (tmp_path / "results/bench.md").read_text(), bench


@pytest.mark.parametrize("call", ["measure", "evaluate", "ball_map", "bounds"])
def test_memory_and_references_stay_flat(call):
    points, cells = bipyramid()
    image = points * [1, 1, 0.5]
    m = qcball.ball_map(points, cells)
    calls = {
        "measure": lambda: qcball.measure(points, cells, image),
        "evaluate": lambda: m.evaluate(points),
        "ball_map": lambda: qcball.ball_map(points, cells, max_iterations=1, threads=1, progress=lambda row: None),
        "bounds": lambda: qcball.bounds(points, cells, image),
    }
    job = calls[call]
    for _ in range(100):
        job()
    gc.collect()
    before = (sys.getrefcount(points), sys.getrefcount(cells), sys.getrefcount(image), len(gc.get_objects()), resident())
    for _ in range(1000):
        job()
    gc.collect()
    after = (sys.getrefcount(points), sys.getrefcount(cells), sys.getrefcount(image), len(gc.get_objects()), resident())
    assert after[:3] == before[:3] and after[3] - before[3] < 50
    # 1,000 leaks of the smallest array would be 100 kB; allocators give back in pieces of a megabyte and more.
    assert after[4] - before[4] < 4 << 20, (before, after)


@pytest.mark.parametrize("example", sorted((HERE.parent / "examples").glob("*.py")), ids=lambda path: path.stem)
def test_examples_run(example, capsys, tmp_path, monkeypatch):
    if "matplotlib" in example.read_text():
        pytest.importorskip("matplotlib")
        pytest.importorskip("pandas")
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(example), run_name="__main__")
    assert "K" in capsys.readouterr().out

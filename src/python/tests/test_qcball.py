"""The package as its users call it."""

import pathlib
import runpy
import signal
import threading

import numpy as np
import pytest

import qcball

HERE = pathlib.Path(__file__).parent
REFERENCE = HERE.parents[2] / "tests" / "reference"


def bipyramid():
    points = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 2], [0, 0, -2], [0, 0, 0]], float)
    cells = np.array([[6, a, b, top] for a, b in [(0, 1), (1, 2), (2, 3), (3, 0)] for top in (4, 5)])
    return points, cells


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
        (lambda p, c: (p, c[:, :3]), "cells has the shape (8, 3)"),
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


def test_hostile_arrays_give_exceptions_only():
    random = np.random.default_rng(1)
    points, cells = bipyramid()
    types = [np.int8, np.uint8, np.int64, np.uint64, np.float32, np.float64, bool, object]
    outcomes = {True: 0, False: 0}
    for _ in range(2000):
        p = points.copy()
        for _ in range(random.integers(0, 3)):
            p[random.integers(7), random.integers(3)] = random.choice([np.nan, np.inf, 1e300, 1e-300, 0.0, -1.0])
        c = cells.copy()
        for _ in range(random.integers(0, 3)):
            c[random.integers(8), random.integers(4)] = random.choice([-1, 0, 3, 6, 7, 2**31, 2**40])
        c = c[: random.integers(0, 9)].astype(random.choice(types))
        image = p[:: random.choice([1, -1])] if random.integers(2) else p[: random.integers(0, 8)]
        try:
            qcball.measure(p, c, image)
            outcomes[True] += 1
        except (ValueError, OverflowError):
            outcomes[False] += 1
    assert min(outcomes.values()) > 0, outcomes


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
    interrupted = threading.Event()

    def interrupt(_row):
        if not interrupted.is_set():
            interrupted.set()
            signal.raise_signal(signal.SIGINT)
            # The caller looks for signals every 50 ms, on a busy machine later.
            threading.Event().wait(3)

    m = qcball.ball_map(points, cells, progress=interrupt)
    assert m.stop == "cancelled" and np.isfinite(m.max_K)


@pytest.mark.parametrize("example", sorted((HERE.parent / "examples").glob("*.py")), ids=lambda path: path.stem)
def test_examples_run(example, capsys):
    runpy.run_path(str(example), run_name="__main__")
    assert "K" in capsys.readouterr().out

"""Random and hostile inputs give exceptions or results, never a crash: QCBALL_HOSTILE_INPUTS of them, 3,000 if it is not set."""

import os

import numpy as np

import qcball

INPUTS = int(os.environ.get("QCBALL_HOSTILE_INPUTS", "3000"))
SEED = int(os.environ.get("QCBALL_HOSTILE_SEED", "1"))
NUMBERS = [np.nan, np.inf, -np.inf, 1e308, -1e300, 5e-324, 1e-300, 0.0, -0.0, 1.0, -1.0, 1e16]
INDICES = [-1, 0, 3, 5, 6, 7, 255, 256, 2**31 - 1, 2**31, 2**32 - 1, 2**32, 2**40, -(2**63), 2**63 - 1]
INTEGERS = ["i1", "u1", "i2", "u2", ">i4", "u4", "i8", ">u8"]
OTHERS = ["f2", "f4", ">f8", "c16", "?", "O", "U5", "S3", "M8[s]", "m8[s]", "V8"]


def mesh():
    points = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 2], [0, 0, -2], [0, 0, 0]], float)
    tets = np.array([[6, a, b, top] for a, b in [(0, 1), (1, 2), (2, 3), (3, 0)] for top in (4, 5)])
    triangles = np.array([[a, b, 4] for a, b in [(0, 1), (1, 2), (2, 3), (3, 0)]] + [[b, a, 5] for a, b in [(0, 1), (1, 2), (2, 3), (3, 0)]])
    return points, tets, triangles


def shaken(random, array, others):
    """The array with some numbers changed, of another type, order, stride or shape."""
    array = array.copy()
    for _ in range(random.integers(3)):
        array[tuple(random.integers(size) for size in array.shape)] = random.choice(NUMBERS) if array.dtype.kind == "f" else 0
    if array.dtype.kind == "i" and random.random() < 0.4:
        array = array.astype("i8")
        array[tuple(random.integers(size) for size in array.shape)] = INDICES[random.integers(len(INDICES))]
    if random.random() < 0.3:
        kinds = others if random.random() < 0.3 else (INTEGERS if array.dtype.kind == "i" else ["f2", "f4", ">f8", "f8", "g"])
        try:
            with np.errstate(all="ignore"):
                array = array.astype(kinds[random.integers(len(kinds))])
        except (TypeError, ValueError):
            pass
    match random.integers(14):
        case 0:
            return array[: random.integers(len(array) + 1)]
        case 1:
            return array[::-1]
        case 2:
            return np.asfortranarray(array)
        case 3:
            return array.repeat(2, axis=0)[::2]
        case 4:
            return array.T
        case 5:
            return array.ravel()
        case 6:
            return array[None]
        case 7:
            return array[:, : random.integers(array.shape[1] + 1)]
        case 8:
            return np.broadcast_to(array[:1], array.shape)
        case 9:
            return array.tolist()
        case 10:
            return [None, "points", {}, 7, [[1, 2], [3]], b"bytes", object(), np.zeros((0, 3)), np.zeros((3, 0)), np.float64(1)][random.integers(10)]
        case _:
            return array


def test_hostile_inputs_give_exceptions_only():
    points, tets, triangles = mesh()
    image = points * [1, 1, 0.5]
    m = qcball.ball_map(points, tets)
    few = {"max_iterations": 1, "threads": 1}
    calls = [
        lambda p, c, t, q: qcball.measure(p, c, q),
        lambda p, c, t, q: qcball.measure(p, c, q),
        lambda p, c, t, q: qcball.measure(p, c, q),
        lambda p, c, t, q: qcball.bounds(p, c, q),
        lambda p, c, t, q: qcball.radial_map(p, c, centre=q[0]),
        lambda p, c, t, q: qcball.sphere_map(p, t),
        lambda p, c, t, q: qcball.star_kernel(p, t),
        lambda p, c, t, q: m.evaluate(p),
        lambda p, c, t, q: m.inverse(q, onto="ball"),
        lambda p, c, t, q: qcball.ball_map(p, c, **few),
        lambda p, c, t, q: qcball.ball_map(p, t, cells_wanted=50, **few),
        lambda p, c, t, q: qcball.optimize(p, c, q, fixed=np.arange(len(p)) % 2 == 0, **few),
    ]
    outcomes = {True: 0, False: 0}
    for number in range(INPUTS):
        random = np.random.default_rng([SEED, number])
        call = calls[random.integers(len(calls))]
        arguments = [shaken(random, array, OTHERS) for array in (points, tets, triangles, image)]
        try:
            call(*arguments)
            outcomes[True] += 1
        except ValueError:
            outcomes[False] += 1
        except (TypeError, IndexError, KeyError, AttributeError):
            # The calls above look into what they are given themselves.
            outcomes[False] += 1
    print(f"{INPUTS} inputs of seed {SEED}: {outcomes[True]} results, {outcomes[False]} exceptions")
    assert min(outcomes.values()) > INPUTS / 20, outcomes

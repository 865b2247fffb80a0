"""Maps of solids onto the ball with low quasi-conformal dilatation: map, measure, bound.

Points are arrays of shape (n, 3), float64, in any one unit of length; tets (m, 4) and triangles (m, 3), integers that name rows
of the points from 0. Lists, other number types and any memory order are taken too. K_inner = s1 s2 / s3^2 and
K_outer = s1^2 / (s2 s3) with the singular values s1 >= s2 >= s3 of a tet's Jacobian, and K is the larger of them: ratios >= 1
without units, infinite where a tet is flipped.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _qcball

__all__ = ["Map", "Measured", "Bounds", "ball_map", "bounds", "measure", "optimize", "read", "star_kernel"]
__version__ = "0.1.0"

Floats = NDArray[np.float64]
Indices = NDArray[np.uint32]
Progress = bool | Callable[[dict[str, Any]], object]


@dataclass(frozen=True)
class Map:
    """A mesh, its image, and what is known of the map between them."""

    points: Floats
    """The vertices of the domain, (n, 3): those given, then the ones that freed tets with all vertices on the boundary."""
    cells: Indices
    """The tets, (m, 4), all of positive volume."""
    image: Floats
    """The image of each vertex, (n, 3)."""
    K: Floats
    """K on each tet, (m,): the larger of the two below."""
    K_inner: Floats
    """K_I on each tet, (m,)."""
    K_outer: Floats
    """K_O on each tet, (m,)."""
    max_K: float
    """The largest K."""
    mean_K: float
    """The mean of K, each tet counted once."""
    bounds: list[dict[str, Any]] = field(repr=False)
    """Lower bounds for the largest dilatation: name, kind, value, scope, whether it applies to this map, and why."""
    best_bound: float | None
    """The largest proved bound that applies."""
    bijective: bool
    """Whether the map is proved to be one to one."""
    stop: str
    """Why the optimization ended: "optimal", "converged", "time-limit", "cancelled", ..."""
    trace: list[dict[str, Any]] = field(repr=False)
    """One entry an iteration."""

    @property
    def gap(self) -> float | None:
        """max_K / best_bound: 1 for a map that is proved to be the best."""
        return None if self.best_bound is None else self.max_K / self.best_bound

    def summary(self) -> str:
        """The figures in words."""
        bound = "none" if self.best_bound is None else f"{self.best_bound:.4f}"
        return (
            f"{len(self.cells)} tets, max K {self.max_K:.4f}, mean K {self.mean_K:.4f}, best bound {bound}, "
            f"{'bijective' if self.bijective else 'not proved bijective'}, {self.stop}"
        )

    def to_meshio(self) -> Any:
        """The image as a meshio.Mesh with K, K_inner, K_outer on cells and the domain's positions on points."""
        import meshio  # type: ignore[import-untyped, import-not-found, unused-ignore]

        data = {"K": [self.K], "K_inner": [self.K_inner], "K_outer": [self.K_outer]}
        return meshio.Mesh(self.image, [("tetra", self.cells)], point_data={"domain": self.points}, cell_data=data)

    def to_pyvista(self) -> Any:
        """The image as a pyvista.UnstructuredGrid with the same data."""
        import pyvista  # type: ignore[import-untyped, import-not-found, unused-ignore]

        return pyvista.from_meshio(self.to_meshio())


@dataclass(frozen=True)
class Measured:
    """The dilatations of a map, tet by tet."""

    K: Floats
    K_inner: Floats
    K_outer: Floats
    flipped: Indices
    """The tets whose image has no positive volume."""
    max_K: float
    mean_K: float


@dataclass(frozen=True)
class Bounds:
    """Lower bounds for the largest dilatation."""

    bounds: list[dict[str, Any]]
    """Each with name, kind, value, scope, whether it applies, and why."""
    best: float | None
    """The largest proved bound that applies."""


def _points(name: str, given: ArrayLike, finite: bool = True) -> Floats:
    try:
        points = np.ascontiguousarray(given, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be an array of numbers of shape (n, 3): {error}") from None
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"{name} has the shape {points.shape}, but must have the shape (n, 3)")
    if finite:
        bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
        if bad.size:
            raise ValueError(f"row {bad[0]} of {name} holds a number that is not finite: {points[bad[0]].tolist()}")
    return points


def _cells(name: str, given: ArrayLike, corners: int, vertices: int) -> Indices:
    try:
        cells = np.asarray(given)
    except ValueError as error:
        raise ValueError(f"{name} must be an array of integers of shape (m, {corners}): {error}") from None
    if cells.ndim != 2 or cells.shape[1] != corners:
        raise ValueError(f"{name} has the shape {cells.shape}, but must have the shape (m, {corners})")
    if cells.dtype.kind not in "iu":
        raise ValueError(f"{name} has the type {cells.dtype}, but must hold integers")
    bad = np.flatnonzero(((cells < 0) | (cells >= vertices)).any(axis=1))
    if bad.size:
        row = cells[bad[0]].tolist()
        raise ValueError(f"row {bad[0]} of {name} is {row}, but there are the vertices 0 to {vertices - 1} only")
    return np.ascontiguousarray(cells, dtype=np.uint32)


def _bytes(array: NDArray[Any]) -> bytes:
    return array.tobytes()


def _floats(data: bytes, *shape: int) -> Floats:
    return np.frombuffer(data, dtype=np.float64).reshape(*shape).copy() if shape else np.frombuffer(data, np.float64).copy()


def _indices(data: bytes, *shape: int) -> Indices:
    return np.frombuffer(data, dtype=np.uint32).reshape(*shape).copy() if shape else np.frombuffer(data, np.uint32).copy()


def _print(row: dict[str, Any]) -> None:
    print(f"{row['phase']:>10} {row['iteration']:5d}  max K {row['max_K']:.6g}  mean K {row['mean_K']:.6g}")


def _observer(progress: Progress) -> Callable[..., object] | None:
    if progress is False:
        return None
    show: Callable[[dict[str, Any]], object] = _print if progress is True else progress
    names = ("phase", "iteration", "max_K", "mean_K", "progress", "seconds")
    return lambda *row: show(dict(zip(names, row, strict=True)))


def _options(
    time_limit: float | None, max_iterations: int, tolerance: float, polish: bool, threads: int, progress: Progress
) -> dict[str, Any]:
    if time_limit is not None and not 0 < time_limit < 1e9:
        raise ValueError(f"time_limit is {time_limit}, but must be a number of seconds between 0 and 1e9, or None")
    if not 0 < tolerance < 1e9:
        raise ValueError(f"tolerance is {tolerance}, but must be positive")
    if not 0 <= threads <= 1024:
        raise ValueError(f"threads is {threads}, but must be from 0, for all cores, to 1024")
    if max_iterations < 0:
        raise ValueError(f"max_iterations is {max_iterations}, but must not be negative")
    return {
        "time_limit": time_limit,
        "max_iterations": max_iterations,
        "tolerance": tolerance,
        "polish": polish,
        "threads": threads,
        "observe": _observer(progress),
    }


def _limit(certify: bool | float) -> float | None:
    if certify is False:
        return None
    seconds = 60.0 if certify is True else float(certify)
    if not 0 < seconds < 1e9:
        raise ValueError(f"certify is {certify}, but must be True, False or a number of seconds between 0 and 1e9")
    return seconds


def _map(found: dict[str, Any]) -> Map:
    return Map(
        points=_floats(found["points"], -1, 3),
        cells=_indices(found["cells"], -1, 4),
        image=_floats(found["image"], -1, 3),
        K=_floats(found["K"]),
        K_inner=_floats(found["K_inner"]),
        K_outer=_floats(found["K_outer"]),
        max_K=found["max_K"],
        mean_K=found["mean_K"],
        bounds=json.loads(found["bounds"]),
        best_bound=found["best_bound"],
        bijective=found["bijective"],
        stop=json.loads(found["stop"]),
        trace=json.loads(found["trace"]),
    )


def ball_map(
    points: ArrayLike,
    cells: ArrayLike,
    *,
    centre: ArrayLike | None = None,
    exponent: float = 1.0,
    certify: bool | float = False,
    time_limit: float | None = None,
    max_iterations: int = 1000,
    tolerance: float = 1e-6,
    polish: bool = True,
    threads: int = 0,
    progress: Progress = False,
) -> Map:
    """Map a solid, given by its tets, onto the unit ball with the largest K as small as the method can make it.

    Boundary vertices go to the sphere, along the rays from the star centre if there is one, and stay there; all others move. Ctrl-C ends the
    optimization, and the best map so far is returned with stop == "cancelled". The result is the same to the bit for any number
    of threads, unless a time limit or a signal ended it.

    Parameters
    ----------
    points : (n, 3) numbers, in any one unit of length
    cells : (m, 4) integers, tets in either orientation; tets with all vertices on the boundary are split
    centre : the point that goes to the middle of the ball; by default the centre of the largest ball of star centres
    exponent : a point at the fraction t of its ray starts at the radius t ** exponent
    certify : search for a Gram certificate, the best bound there is, for 60 seconds, or for so many
    time_limit : most seconds of optimizing
    max_iterations : most iterations over all phases
    tolerance : in ln K
    polish : at the end lower the mean of K while the largest may rise by 0.02 %
    threads : 0 for all cores
    progress : True prints a line an iteration; a function is called with a dictionary for each

    Raises
    ------
    ValueError
        what is wrong with the arrays, naming the row; a mesh that is no ball
    """
    positions = _points("points", points)
    tets = _cells("cells", cells, 4, len(positions))
    at = None if centre is None else _points("centre", np.reshape(centre, (1, -1)))[0].tolist()
    options = _options(time_limit, max_iterations, tolerance, polish, threads, progress)
    return _map(_qcball.ball_map(_bytes(positions), _bytes(tets), at, exponent, _limit(certify), options))


def optimize(
    points: ArrayLike,
    cells: ArrayLike,
    image: ArrayLike,
    *,
    fixed: ArrayLike | None = None,
    time_limit: float | None = None,
    max_iterations: int = 1000,
    tolerance: float = 1e-6,
    polish: bool = True,
    threads: int = 0,
    progress: Progress = False,
) -> Map:
    """Lower the largest K of any map of any tet mesh, from `image`, (n, 3); flipped tets are untangled first.

    `fixed` is a mask, (n,), of the vertices that stay; by default those of the boundary stay, and tets that they lock are split.
    The other parameters and the errors are those of `ball_map`.
    """
    positions = _points("points", points)
    tets = _cells("cells", cells, 4, len(positions))
    start = _points("image", image)
    mask = None
    if fixed is not None:
        held = np.asarray(fixed)
        if held.dtype != np.bool_ or held.shape != (len(positions),):
            raise ValueError(f"fixed must be a mask of {len(positions)} booleans, but is {held.dtype} of shape {held.shape}")
        mask = held.tolist()
    options = _options(time_limit, max_iterations, tolerance, polish, threads, progress)
    return _map(_qcball.optimize(_bytes(positions), _bytes(tets), _bytes(start), mask, options))


def measure(points: ArrayLike, cells: ArrayLike, image: ArrayLike) -> Measured:
    """The exact dilatations of the piecewise-linear map that takes `points` to `image`, from whatever program.

    Parameters
    ----------
    points, image : (n, 3) numbers
    cells : (m, 4) integers, tets in either orientation

    Raises
    ------
    ValueError
        what is wrong with the arrays, naming the row; a tet of no volume. Flipped tets of the image are none: their K is inf.
    """
    positions = _points("points", points)
    tets = _cells("cells", cells, 4, len(positions))
    found = _qcball.measure(_bytes(positions), _bytes(tets), _bytes(_points("image", image, finite=False)))
    return Measured(
        K=_floats(found["K"]),
        K_inner=_floats(found["K_inner"]),
        K_outer=_floats(found["K_outer"]),
        flipped=_indices(found["flipped"]),
        max_K=found["max_K"],
        mean_K=found["mean_K"],
    )


def bounds(points: ArrayLike, cells: ArrayLike, image: ArrayLike, *, certify: bool | float = False) -> Bounds:
    """Lower bounds for the largest dilatation of maps of this mesh with the boundary values of `image`.

    The inside of `image` matters only to the search for a Gram certificate (`certify`: True for 60 seconds, or so many), which
    starts from it. The other parameters and the errors are those of `measure`.
    """
    positions = _points("points", points)
    tets = _cells("cells", cells, 4, len(positions))
    start = _points("image", image, finite=False)
    found, best = _qcball.bounds(_bytes(positions), _bytes(tets), _bytes(start), _limit(certify))
    return Bounds(json.loads(found), best)


def star_kernel(points: ArrayLike, triangles: ArrayLike) -> tuple[Floats, float]:
    """The largest ball of points that see a whole closed surface from within: its centre, (3,), and its radius.

    Raises
    ------
    ValueError
        what is wrong with the arrays or the surface; a solid that is not star-shaped, with triangles that prove it
    """
    positions = _points("points", points)
    centre, radius = _qcball.star_kernel(_bytes(positions), _bytes(_cells("triangles", triangles, 3, len(positions))))
    return np.array(centre), radius


def read(path: str | os.PathLike[str]) -> tuple[Floats, Indices]:
    """Points and tets of a mesh file: Medit (.mesh), VTU, legacy VTK, Gmsh (.msh), TetGen (.ele, .node)."""
    points, cells = _qcball.read(os.fspath(path))
    return _floats(points, -1, 3), _indices(cells, -1, 4)

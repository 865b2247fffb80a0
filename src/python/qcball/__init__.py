"""Maps of solids onto the ball with low quasi-conformal dilatation: map, measure, bound.

Points are arrays of shape (n, 3), float64, in any one unit of length; tets (m, 4) and triangles (m, 3), integers that name rows
of the points from 0. Lists, other number types and any memory order are taken too. K_inner = s1 s2 / s3^2 and
K_outer = s1^2 / (s2 s3) with the singular values s1 >= s2 >= s3 of a tet's Jacobian, and K is the larger of them: ratios >= 1
without units, infinite where a tet is flipped.

Ctrl-C ends an optimization, which returns its best map with stop == "cancelled".
"""

from __future__ import annotations

import json
import os
import pathlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import _qcball
from ._arrays import (
    Floats,
    Indices,
    Overrides,
    Progress,
    assignments_of,
    bytes_of,
    cells_of,
    floats_of,
    indices_of,
    limit_of,
    observer_of,
    one_of,
    options_of,
    points_of,
    threads_of,
)
from ._map import Bounds, Map, Measured, Sweep, map_of, of_report

__all__ = [
    "Bounds",
    "Map",
    "Measured",
    "Sweep",
    "ball_map",
    "bounds",
    "load",
    "measure",
    "optimize",
    "radial_map",
    "read",
    "run",
    "sphere_map",
    "star_kernel",
    "sweep",
]
__version__ = "0.1.0"


def _found(found: dict[str, Any]) -> Map:
    parsed = {name: json.loads(found[name]) for name in ("bounds", "stop", "trace")}
    return map_of(found | parsed)


def _centre(centre: ArrayLike | None) -> list[float] | None:
    return None if centre is None else [float(x) for x in points_of("centre", np.reshape(np.asarray(centre), (1, -1)))[0]]


def ball_map(
    points: ArrayLike,
    cells: ArrayLike,
    *,
    boundary: str = "auto",
    values: str = "fixed",
    cells_wanted: int | None = None,
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
    """Map a solid onto the unit ball with the largest K as small as the method can make it.

    Parameters
    ----------
    points : (n, 3) numbers
    cells : (m, 4) integers, tets in either orientation, whose union is a ball; tets with all vertices on the boundary are split.
        Or (m, 3) integers, the triangles of a closed surface, which is filled with tets if it is star-shaped
    boundary : where the boundary goes: "radial", along the rays from the centre; "spherical", by `sphere_map`, and where tets of that start
        stay flipped, once more over a collar of added tets; "auto", along rays where the solid is star-shaped and no tet stays flipped
    values : "fixed", the boundary stays there; "sliding", its vertices move on the sphere with the others
    cells_wanted : about how many tets a surface is filled with; by default as many as make the image nearly a ball, as for the command
    centre : the point that goes to the middle of the ball; by default the centre of the largest ball of star centres
    exponent : a point at the fraction t of its ray starts at the radius t ** exponent
    certify : search for a Gram certificate, the best bound there is, for 60 seconds, or for so many
    time_limit : most seconds of optimizing
    max_iterations : most iterations over all phases
    tolerance : in ln K
    polish : at the end lower the mean of K while the largest may rise by 0.02 %
    threads : 0 for all cores; the result is the same to the bit for any number
    progress : True shows a bar with tqdm, or prints a line an iteration; a function is called with a dictionary for each

    Returns
    -------
    Map
        however the optimization ended, which its `stop` tells

    Raises
    ------
    ValueError
        what is wrong with the arrays, naming the row; a mesh that is no ball; a surface that is not star-shaped
    KeyboardInterrupt
        Ctrl-C before there was a map
    """
    positions = points_of("points", points)
    given = np.asarray(cells)
    corners = 3 if given.ndim == 2 and given.shape[1] == 3 else 4
    indices = cells_of("cells", given, corners, len(positions))
    one_of("boundary", boundary, "auto", "radial", "spherical")
    if cells_wanted is not None and not 1 <= cells_wanted <= 18_000_000:
        raise ValueError(f"cells_wanted is {cells_wanted}, but must be from 1 to 18,000,000")
    ball = {
        "centre": _centre(centre),
        "exponent": exponent,
        "boundary": boundary,
        "cells_wanted": cells_wanted,
        "certify": limit_of(certify),
    }
    options = options_of(
        time_limit=time_limit,
        max_iterations=max_iterations,
        tolerance=tolerance,
        polish=polish,
        threads=threads,
        progress=progress,
        values=values,
    )
    return _found(_qcball.ball_map(bytes_of(positions), bytes_of(indices), corners, ball, options))


def optimize(
    points: ArrayLike,
    cells: ArrayLike,
    image: ArrayLike,
    *,
    fixed: ArrayLike | None = None,
    values: str = "fixed",
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
    positions = points_of("points", points)
    tets = cells_of("cells", cells, 4, len(positions))
    start = points_of("image", image)
    mask = None
    if fixed is not None:
        held = np.asarray(fixed)
        if held.dtype != np.bool_ or held.shape != (len(positions),):
            raise ValueError(f"fixed must be a mask of {len(positions)} booleans, but is {held.dtype} of shape {held.shape}")
        mask = [bool(one) for one in held]
    options = options_of(
        time_limit=time_limit,
        max_iterations=max_iterations,
        tolerance=tolerance,
        polish=polish,
        threads=threads,
        progress=progress,
        values=values,
    )
    return _found(_qcball.optimize(bytes_of(positions), bytes_of(tets), bytes_of(start), mask, options))


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
    positions = points_of("points", points)
    tets = cells_of("cells", cells, 4, len(positions))
    found = _qcball.measure(bytes_of(positions), bytes_of(tets), bytes_of(points_of("image", image, finite=False)))
    return Measured(
        K=floats_of(found["K"]),
        K_inner=floats_of(found["K_inner"]),
        K_outer=floats_of(found["K_outer"]),
        flipped=indices_of(found["flipped"]),
        max_K=found["max_K"],
        mean_K=found["mean_K"],
    )


def bounds(points: ArrayLike, cells: ArrayLike, image: ArrayLike, *, certify: bool | float = False) -> Bounds:
    """Lower bounds for the largest dilatation of maps of this mesh with the boundary values of `image`.

    The inside of `image` matters only to the search for a Gram certificate (`certify`: True for 60 seconds, or so many), which
    starts from it. The other parameters and the errors are those of `measure`.
    """
    positions = points_of("points", points)
    tets = cells_of("cells", cells, 4, len(positions))
    start = points_of("image", image, finite=False)
    found, best = _qcball.bounds(bytes_of(positions), bytes_of(tets), bytes_of(start), limit_of(certify))
    return Bounds(json.loads(found), best)


def radial_map(
    points: ArrayLike, cells: ArrayLike, *, centre: ArrayLike | None = None, exponent: float = 1.0
) -> Floats:
    """The radial map of a star-shaped solid onto the unit ball, Caraman's: the image of each vertex, (n, 3).

    A point at the fraction t of its ray from the centre goes to the radius t ** exponent. `centre` is by default that of the
    largest ball of star centres.

    Raises
    ------
    ValueError
        what is wrong with the arrays, naming the row; a mesh that is no ball, or not star-shaped about the centre
    """
    positions = points_of("points", points)
    tets = cells_of("cells", cells, 4, len(positions))
    return floats_of(_qcball.radial_map(bytes_of(positions), bytes_of(tets), _centre(centre), exponent), -1, 3)


def sphere_map(
    points: ArrayLike, triangles: ArrayLike, *, area_weight: float = 0.0, shrinkage_weight: float = 1e-8
) -> Floats:
    """Map a closed surface without handles onto the unit sphere, one to one: the image of each vertex, (n, 3).

    `area_weight` >= 0 trades angles for areas; `shrinkage_weight` >= 0 keeps limbs from shrinking to nothing.

    Raises
    ------
    ValueError
        what is wrong with the arrays or the surface: open edges, handles, points that no triangle names
    """
    positions = points_of("points", points)
    given = cells_of("triangles", triangles, 3, len(positions))
    return floats_of(_qcball.sphere_map(bytes_of(positions), bytes_of(given), area_weight, shrinkage_weight), -1, 3)


def star_kernel(points: ArrayLike, triangles: ArrayLike) -> tuple[Floats, float]:
    """The largest ball of points that see a whole closed surface from within: its centre, (3,), and its radius.

    Raises
    ------
    ValueError
        what is wrong with the arrays or the surface; a solid that is not star-shaped, with triangles that prove it
    """
    positions = points_of("points", points)
    centre, radius = _qcball.star_kernel(bytes_of(positions), bytes_of(cells_of("triangles", triangles, 3, len(positions))))
    return np.array(centre), radius


def read(path: str | os.PathLike[str]) -> tuple[Floats, Indices]:
    """Points and cells of a file: (m, 4) tets of Medit, VTU, VTK, Gmsh and TetGen files, or (m, 3) triangles of OBJ, OFF, PLY, STL,
    VTP and other files that hold a closed surface.

    Raises
    ------
    ValueError
        what is wrong with the file, with its line or element where the format has such
    """
    points, cells, corners = _qcball.read(os.fspath(path))
    return floats_of(points, -1, 3), indices_of(cells, -1, corners)


def run(
    config: str | os.PathLike[str],
    overrides: Overrides | None = None,
    *,
    out: str | os.PathLike[str] | None = None,
    threads: int | None = None,
    progress: Progress = False,
) -> Map:
    """Map a solid as a config file says, with some keys overridden, as in {"mesh.layers": 4}: what `qcball run` does.

    The files of the results are written into the folder `out`, if there is one. `threads` overrides the config's; 0 for all cores.
    A config that names a program as its mesher has that run: know where a config comes from.

    Raises
    ------
    ValueError
        what is wrong with the config or its files
    OSError
        a folder that cannot be written
    KeyboardInterrupt
        Ctrl-C before there was a map; later it returns the best one
    """
    folder = None if out is None else os.fspath(out)
    count = None if threads is None else threads_of(threads)
    found = _qcball.run(os.fspath(config), assignments_of(overrides), folder, count, observer_of(progress))
    return map_of(found | of_report(json.loads(found["report"])) | {"trace": json.loads(found["trace"])})


def sweep(
    config: str | os.PathLike[str],
    overrides: Overrides | None = None,
    *,
    out: str | os.PathLike[str] | None = None,
    jobs: int | None = None,
    threads: int | None = None,
    progress: bool = False,
) -> Sweep:
    """Run every case of a config's table [sweep], `jobs` at a time, and go on where an earlier call was stopped.

    The cases go to the folder `out`, by default results/NAME as those of `qcball sweep`. Errors are those of `run`; a case that
    fails has its error in its row.
    """
    for name, count in (("jobs", jobs), ("threads", threads)):
        if count is not None and not 1 <= count <= 1024:
            raise ValueError(f"{name} is {count}, but must be from 1 to 1024, or None")
    folder = None if out is None else os.fspath(out)

    def show(number: int, of: int, settings: str, how: str) -> None:
        print(f"{number}/{of}  {settings}  {how}", flush=True)

    made = _qcball.sweep(os.fspath(config), assignments_of(overrides), folder, (jobs, threads), show if progress else None)
    rows = [json.loads(line) for line in made[1].splitlines()]
    return Sweep(pathlib.Path(made[0]), rows, made[2])


def load(folder: str | os.PathLike[str]) -> Map:
    """The map of a folder that `Map.save`, `run` or the command `qcball run` wrote, to the bit.

    Raises
    ------
    ValueError
        files that are missing, broken or not of one map
    """
    place = pathlib.Path(folder)
    found = _qcball.load(os.fspath(place))
    try:
        if (place / "map.json").is_file():
            return map_of(found | json.loads((place / "map.json").read_text(encoding="utf-8")))
        figures = of_report(json.loads((place / "report.json").read_text(encoding="utf-8")))
        trace = np.genfromtxt(place / "trace.csv", delimiter=",", names=True, dtype=None, encoding="utf-8", ndmin=1)
    except (OSError, KeyError, TypeError, AttributeError, json.JSONDecodeError) as error:
        raise ValueError(f"{place} has no map.json, nor report.json and trace.csv, that belong to a map: {error!r}") from None
    rows = [dict(zip(trace.dtype.names or (), row.tolist(), strict=True)) for row in trace]
    return map_of(found | figures | {"trace": rows})

"""What comes back: maps, measures, bounds and sweeps."""

from __future__ import annotations

import html
import json
import os
import math
import pathlib
from dataclasses import dataclass, field
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import _qcball
from ._arrays import Floats, Indices, bytes_of, floats_of, indices_of, points_of


def _rounded(value: float, rounding: str) -> str:
    """With four decimals, a bound in the direction in which it stays one."""
    if not math.isfinite(value):
        return str(value)
    return str(Decimal(value).quantize(Decimal("0.0001"), rounding, Context(prec=400)))


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
    ball_K: float | None
    """K onto the ball is at most this: that of the map followed by the radial map of its image, an inscribed polyhedron, onto the ball."""
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
    report: dict[str, Any] | None = field(default=None, repr=False)
    """The whole record of a config's run."""
    is_linear: bool = True
    """Whether the map is linear on each tet; with `boundary.corners` of a config it is not."""

    @property
    def gap(self) -> float | None:
        """max_K / best_bound: 1 for a map that is proved to be the best."""
        return None if self.best_bound is None else self.max_K / self.best_bound

    def summary(self) -> str:
        """The figures in words."""
        bound = "none" if self.best_bound is None else _rounded(self.best_bound, ROUND_FLOOR)
        onto = "" if self.ball_K is None else f", K onto the ball at most {_rounded(self.ball_K, ROUND_CEILING)}"
        return (
            f"{len(self.cells)} tets, max K {self.max_K:.4f}, mean K {self.mean_K:.4f}, best bound {bound}{onto}, "
            f"{'bijective' if self.bijective else 'not proved bijective'}, {self.stop}"
        )

    def evaluate(self, x: ArrayLike, *, onto: str = "polyhedron") -> Floats:
        """Where the map takes the points x, (k, 3) or (3,): the same shape, NaN for points outside of the domain.

        `onto` is "polyhedron", the image of the mesh, or "ball", with each ray of the image stretched to length 1.

        Raises
        ------
        ValueError
            what is wrong with x; a flipped tet; an image that is not star-shaped about 0, onto the ball
        """
        return self._located(x, onto, inverse=False)

    def inverse(self, y: ArrayLike, *, onto: str = "polyhedron") -> Floats:
        """The points that the map takes to the points y, (k, 3) or (3,): the same shape, NaN for points outside of the image.

        `onto` and the errors are those of `evaluate`.
        """
        return self._located(y, onto, inverse=True)

    def _located(self, given: ArrayLike, onto: str, *, inverse: bool) -> Floats:
        if not self.is_linear:
            raise ValueError("the map is like a power at corners; `qcball evaluate` takes its results folder")
        if onto not in ("polyhedron", "ball"):
            raise ValueError(f"onto is {onto!r}, but must be 'polyhedron' or 'ball'")
        at = np.asarray(given)
        rows = points_of("y" if inverse else "x", at[None] if at.ndim == 1 else at, finite=False)
        parts = (bytes_of(self.points), bytes_of(self.cells), bytes_of(self.image))
        return floats_of(_qcball.evaluate(parts, bytes_of(rows), inverse, onto == "ball")).reshape(at.shape)

    def to_meshio(self) -> Any:
        """The image as a meshio.Mesh with K, K_inner, K_outer on cells and the domain's positions on points."""
        import meshio  # type: ignore[import-untyped, import-not-found, unused-ignore]

        data = {"K": [self.K], "K_inner": [self.K_inner], "K_outer": [self.K_outer]}
        return meshio.Mesh(self.image, [("tetra", self.cells)], point_data={"domain": self.points}, cell_data=data)

    def to_pyvista(self) -> Any:
        """The image as a pyvista.UnstructuredGrid with the same data."""
        import pyvista  # type: ignore[import-untyped, import-not-found, unused-ignore]

        grid = pyvista.UnstructuredGrid({pyvista.CellType.TETRA: self.cells.astype(np.int64)}, self.image)
        grid.point_data["domain"] = self.points
        for name, values in (("K", self.K), ("K_inner", self.K_inner), ("K_outer", self.K_outer)):
            grid.cell_data[name] = values
        return grid

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Writes the map into a folder, made if missing: domain.vtu and image.vtu, which ParaView and the command `qcball` take,
        with K on cells, and map.json with the rest. `load` reads it again, to the bit.

        Raises
        ------
        OSError
            a folder that cannot be written
        """
        columns = (bytes_of(self.K), bytes_of(self.K_inner), bytes_of(self.K_outer))
        _qcball.save(os.fspath(folder), bytes_of(self.points), bytes_of(self.cells), bytes_of(self.image), columns)
        names = ("max_K", "mean_K", "ball_K", "bounds", "best_bound", "bijective", "stop", "trace", "report", "is_linear")
        text = json.dumps({name: getattr(self, name) for name in names}, indent=1)
        (pathlib.Path(folder) / "map.json").write_text(text + "\n", encoding="utf-8")

    def to_html(self) -> str:
        """A page that shows both sides of the map with one camera, cut open and coloured by K; it needs no network."""
        parts = (bytes_of(self.points), bytes_of(self.cells), bytes_of(self.image))
        title = "qcball" if self.report is None else f"qcball: {self.report['name']}"
        columns = (bytes_of(self.K_inner), bytes_of(self.K_outer))
        # JSON has no infinity, which flipped tets and the objective of the start have.
        rows = [row for row in self.trace if row["max_k"] is not None and np.isfinite(row["max_k"])]
        trace = [{name: _finite(value) for name, value in row.items()} for row in rows]
        return _qcball.page((title, self.summary() + "."), parts, columns, self.best_bound, json.dumps(trace))

    def _repr_html_(self) -> str:
        """The page in a notebook."""
        page = html.escape(self.to_html(), quote=True)
        return f'<iframe srcdoc="{page}" sandbox="allow-scripts" width="100%" height="760" style="border: 0"></iframe>'


def _finite(value: Any) -> Any:
    return 0.0 if value is None or isinstance(value, float) and not np.isfinite(value) else value


def map_of(found: dict[str, Any]) -> Map:
    return Map(
        points=floats_of(found["points"], -1, 3),
        cells=indices_of(found["cells"], -1, 4),
        image=floats_of(found["image"], -1, 3),
        K=floats_of(found["K"]),
        K_inner=floats_of(found["K_inner"]),
        K_outer=floats_of(found["K_outer"]),
        max_K=found["max_K"],
        mean_K=found["mean_K"],
        ball_K=found["ball_K"],
        bounds=found["bounds"],
        best_bound=found["best_bound"],
        bijective=found["bijective"],
        stop=found["stop"],
        trace=found["trace"],
        report=found.get("report"),
        is_linear=found.get("is_linear", True),
    )


def of_report(report: dict[str, Any]) -> dict[str, Any]:
    """The figures of a config's run under the names of `Map`."""
    last = report["final"]
    ball = last.get("ball_k")
    return {
        "max_K": _number(last["max_k"]),
        "mean_K": _number(last["mean_k"]),
        "ball_K": None if ball is None else ball["certified"],
        "bounds": report["bounds"],
        "best_bound": report["best_bound"],
        "bijective": report["bijective"],
        "stop": report["stop"],
        "report": report,
        "is_linear": report.get("corners") is None,
    }


def _number(value: float | None) -> float:
    # JSON has no infinity.
    return float("inf") if value is None else value


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


@dataclass(frozen=True)
class Sweep:
    """Many runs of one config."""

    folder: pathlib.Path
    """With cases/ID for each case, index.csv and index.jsonl."""
    rows: list[dict[str, Any]] = field(repr=False)
    """One entry a case: case, id, status, settings, results, error."""
    is_whole: bool
    """Whether it came to its end; else the same call goes on."""

    def to_pandas(self) -> Any:
        """A pandas.DataFrame with a row a case: its settings and results as columns."""
        import pandas  # type: ignore[import-untyped, import-not-found, unused-ignore]

        head = ("case", "id", "status", "error")
        return pandas.DataFrame(
            [{name: row[name] for name in head} | row["settings"] | (row["results"] or {}) for row in self.rows]
        )

    def load(self, case: int) -> Map:
        """The map of a case, counted from 1."""
        from . import load

        return load(self.folder / "cases" / next(row["id"] for row in self.rows if row["case"] == case))

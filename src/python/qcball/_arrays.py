"""What comes in as arrays, checked, and what goes to and comes from the compiled half."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.uint32]
Progress = bool | Callable[[dict[str, Any]], object]
Overrides = Mapping[str, Any]


def points_of(name: str, given: ArrayLike, finite: bool = True) -> Floats:
    try:
        numbers = np.asarray(given)
        if numbers.dtype.kind not in "biufO":
            raise ValueError(f"the type is {numbers.dtype}")
        points = np.ascontiguousarray(numbers, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{name} must be an array of numbers of shape (n, 3): {error}") from None
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"{name} has the shape {points.shape}, but must have the shape (n, 3)")
    if finite:
        bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
        if bad.size:
            raise ValueError(f"row {bad[0]} of {name} holds a number that is not finite: {points[bad[0]].tolist()}")
    return points


def cells_of(name: str, given: ArrayLike, corners: int, vertices: int) -> Indices:
    try:
        cells = np.asarray(given)
    except (TypeError, ValueError, OverflowError) as error:
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


def bytes_of(array: NDArray[Any]) -> bytes:
    return array.tobytes()


def floats_of(data: bytes, *shape: int) -> Floats:
    return np.frombuffer(data, dtype=np.float64).reshape(*shape).copy() if shape else np.frombuffer(data, np.float64).copy()


def indices_of(data: bytes, *shape: int) -> Indices:
    return np.frombuffer(data, dtype=np.uint32).reshape(*shape).copy() if shape else np.frombuffer(data, np.uint32).copy()


class _Bar:
    """Progress with tqdm where it is installed, else a line an iteration."""

    def __init__(self) -> None:
        self._bar: Any = None
        try:
            from tqdm.auto import tqdm  # type: ignore[import-untyped, import-not-found, unused-ignore]
        except ImportError:
            return
        self._bar = tqdm(unit=" iterations", bar_format="{n_fmt} iterations, {elapsed}{postfix}")

    def __call__(self, row: dict[str, Any]) -> None:
        words = f"{row['phase']:>10} {row['iteration']:5d}  max K {row['max_K']:.6g}  mean K {row['mean_K']:.6g}"
        if self._bar is None:
            print(words, flush=True)
        else:
            self._bar.set_postfix_str(words, refresh=False)
            self._bar.update()

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()


def observer_of(progress: Progress) -> Callable[..., object] | None:
    if progress is False:
        return None
    show: Callable[[dict[str, Any]], object] = _Bar() if progress is True else progress
    names = ("phase", "iteration", "max_K", "mean_K", "progress", "seconds")
    return lambda *row: show(dict(zip(names, row, strict=True)))


def options_of(
    *,
    time_limit: float | None,
    max_iterations: int,
    tolerance: float,
    polish: bool,
    threads: int,
    progress: Progress,
    values: str = "fixed",
) -> dict[str, Any]:
    if time_limit is not None and not 0 < time_limit < 1e9:
        raise ValueError(f"time_limit is {time_limit}, but must be a number of seconds between 0 and 1e9, or None")
    if not 0 < tolerance < 1e9:
        raise ValueError(f"tolerance is {tolerance}, but must be positive")
    if max_iterations < 0:
        raise ValueError(f"max_iterations is {max_iterations}, but must not be negative")
    one_of("values", values, "fixed", "sliding")
    return {
        "time_limit": time_limit,
        "max_iterations": max_iterations,
        "tolerance": tolerance,
        "polish": polish,
        "sliding": values == "sliding",
        "threads": threads_of(threads),
        "observe": observer_of(progress),
    }


def threads_of(threads: int) -> int:
    if not 0 <= threads <= 1024:
        raise ValueError(f"threads is {threads}, but must be from 0, for all cores, to 1024")
    return threads


def one_of(name: str, given: str, *words: str) -> None:
    if given not in words:
        raise ValueError(f"{name} is {given!r}, but must be one of {', '.join(map(repr, words))}")


def limit_of(certify: bool | float) -> float | None:
    if certify is False:
        return None
    seconds = 60.0 if certify is True else float(certify)
    if not 0 < seconds < 1e9:
        raise ValueError(f"certify is {certify}, but must be True, False or a number of seconds between 0 and 1e9")
    return seconds


def assignments_of(overrides: Overrides | None) -> list[str]:
    """`{"mesh.layers": 4}` as the command line takes it."""
    return [f"{key}={_toml(value)}" for key, value in (overrides or {}).items()]


def _toml(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, (str, os.PathLike)):
        return json.dumps(os.fspath(value))
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{json.dumps(key)} = {_toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (int, float)):
        return repr(value)
    raise ValueError(f"{value!r} is no value of a config: give a boolean, a number, a text or a list of them")

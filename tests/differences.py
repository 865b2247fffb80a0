#!/usr/bin/env python3
"""Differences of an evaluated map onto the ball against its certified K, and its inverse against the map.

    tests/differences.py QCBALL RESULT [POINTS]

At random points of the ball (100,000 by default, the same each time) that are taken back to the solid, no K of central differences may be
above the certified K onto the ball of report.json, and the map must give the points again to 1e-10. Differences across a face of a tet
or of a cone of the boundary mean nothing and are left out.
"""

import csv
import json
import math
import random
import subprocess
import sys
import tempfile
from pathlib import Path

STEP = 1e-6


def dilatation(a):
    """K of a matrix, from the eigenvalues of its Gram matrix (Smith 1961, doi 10.1145/355578.366316)."""
    g = [[sum(a[m][i] * a[m][j] for m in range(3)) for j in range(3)] for i in range(3)]
    mean = (g[0][0] + g[1][1] + g[2][2]) / 3
    off = g[0][1] ** 2 + g[0][2] ** 2 + g[1][2] ** 2
    spread = math.sqrt((sum((g[i][i] - mean) ** 2 for i in range(3)) + 2 * off) / 6)
    if spread == 0:
        return 1.0
    b = [[(g[i][j] - (mean if i == j else 0)) / spread for j in range(3)] for i in range(3)]
    determinant = (
        b[0][0] * (b[1][1] * b[2][2] - b[1][2] * b[2][1])
        - b[0][1] * (b[1][0] * b[2][2] - b[1][2] * b[2][0])
        + b[0][2] * (b[1][0] * b[2][1] - b[1][1] * b[2][0])
    )
    angle = math.acos(max(-1.0, min(1.0, determinant / 2))) / 3
    first, last = (mean + 2 * spread * math.cos(angle + turn) for turn in (0, 2 * math.pi / 3))
    s = [math.sqrt(square) for square in (first, 3 * mean - first - last, last)]
    return max(s[0] * s[1] / s[2] ** 2, s[0] ** 2 / (s[1] * s[2]))


def evaluated(qcball, result, points, folder, *options):
    """The rows that `qcball evaluate` gives for some points."""
    source, target = folder / "points.csv", folder / "images.csv"
    with source.open("w") as file:
        file.write("x,y,z\n")
        file.writelines(",".join(map(repr, point)) + "\n" for point in points)
    command = [qcball, "evaluate", result, source, target, "--onto", "ball", *options]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    with target.open() as file:
        yield from csv.DictReader(file)


def main(qcball, result, count):
    certified = json.loads((Path(result) / "report.json").read_text())["final"]["ball_k"]["certified"]
    random.seed(1)
    in_ball = []
    while len(in_ball) < count:
        y = [random.uniform(-1, 1) for _ in range(3)]
        if sum(c * c for c in y) < 0.996:
            in_ball.append(y)
    with tempfile.TemporaryDirectory() as folder:
        back = evaluated(qcball, result, in_ball, Path(folder), "--inverse")
        points = [[float(row["domain_" + axis]) for axis in "xyz"] for row in back]
        steps = [[STEP * sign * (i == axis) for i in range(3)] for axis in range(3) for sign in (1, -1)]
        around = ([c + s for c, s in zip(x, step)] for x in points for step in [[0.0] * 3, *steps])
        rows = evaluated(qcball, result, around, Path(folder))
        used, largest, off = 0, 1.0, 0.0
        for y in in_ball:
            seven = [next(rows) for _ in range(7)]
            here, *ends = ([float(row["image_" + axis] or "nan") for axis in "xyz"] for row in seven)
            off = max([off, *(abs(a - b) for a, b in zip(here, y))])
            pairs = [ends[0:2], ends[2:4], ends[4:6]]
            central = [[(a[j] - b[j]) / (2 * STEP) for a, b in pairs] for j in range(3)]
            forward = [[(a[j] - here[j]) / STEP for a, _ in pairs] for j in range(3)]
            apart = sum((central[j][i] - forward[j][i]) ** 2 for i in range(3) for j in range(3))
            size = sum(entry**2 for row in central for entry in row)
            if len({row["tet"] for row in seven}) == 1 and apart <= 1e-6 * size:
                used += 1
                largest = max(largest, dilatation(central))
    print(f"{used} of {count} points: K of differences at most {largest:.6g}, certified {certified:.6g}; inverse off by {off:.1e}")
    # Rounding at 1e-16 over the step, times the condition of K in the matrix, below 1000.
    return 0 if used > count / 2 and largest <= certified * (1 + 1e-6) and off <= 1e-10 else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2], int(sys.argv[3]) if len(sys.argv) > 3 else 100_000))

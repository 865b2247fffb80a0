"""A function through the map: the integral over the ball is that over the solid, weighed by how the map stretches volumes."""

import numpy as np
from numpy.typing import NDArray

import qcball

Floats = NDArray[np.float64]

# An octahedron's surface, stretched; the solid is filled with tets.
points = np.array([[2, 0, 0], [-2, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
triangles = [[x, y, z] for x in (0, 1) for y in (2, 3) for z in (4, 5)]
triangles = [t if np.linalg.det(points[t]) > 0 else t[::-1] for t in triangles]
m = qcball.ball_map(points, triangles, cells_wanted=3000, max_iterations=50)
print(m.summary())


def volumes(corners: Floats) -> Floats:
    return np.asarray(np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6)


def f(y: Floats) -> Floats:
    return np.asarray((y**2).sum(axis=-1))


# Four points a tet, with which polynomials of degree 2 are integrated exactly (Keast 1986).
weights = np.full((4, 4), 0.1381966011250105) + np.eye(4) * (1 - 4 * 0.1381966011250105)
inside, images = (np.einsum("qv,tvk->tqk", weights, p[m.cells]) for p in (m.points, m.image))
stretch = volumes(m.image[m.cells]) / volumes(m.points[m.cells])
over_ball = (f(images).mean(axis=1) * volumes(m.image[m.cells])).sum()
over_solid = (f(m.evaluate(inside.reshape(-1, 3))).reshape(-1, 4).mean(axis=1) * stretch * volumes(m.points[m.cells])).sum()
print(f"over the image {over_ball:.12f}, over the solid {over_solid:.12f}; over the round ball {4 * np.pi / 5:.6f}")
there = m.evaluate([0.5, 0.1, -0.2])
print("a point goes to", there, "and comes back as", m.inverse(there))
assert abs(over_ball - over_solid) < 1e-9 and over_ball < 4 * np.pi / 5

"""A mesh of one's own onto the ball: a box of 3 x 2 x 1 in 8 x 6 x 4 cells of six tets each, and the map as a page to look at."""

import itertools
import pathlib

import numpy as np

import qcball

nx, ny, nz = 8, 6, 4
grid = np.stack(np.meshgrid(np.linspace(0, 3, nx + 1), np.linspace(0, 2, ny + 1), np.linspace(0, 1, nz + 1), indexing="ij"), -1)
points = grid.reshape(-1, 3)
number = np.arange(len(points)).reshape(nx + 1, ny + 1, nz + 1)

tets = []
for corner in itertools.product(range(nx), range(ny), range(nz)):
    for axes in itertools.permutations(range(3)):
        at, tet = list(corner), [number[corner]]
        for axis in axes:
            at[axis] += 1
            tet.append(number[tuple(at)])
        tets.append(tet)

m = qcball.ball_map(points, tets, time_limit=60)
print(m.summary())
print("the hardest tet:", m.K.argmax(), "around", m.points[m.cells[m.K.argmax()]].mean(axis=0))

# In a notebook `m` alone shows it; m.to_pyvista().plot(scalars="K") opens a window.
pathlib.Path("own_mesh.html").write_text(m.to_html(), encoding="utf-8")
print("open own_mesh.html in a browser")

"""Two maps of one mesh by the same ruler: the radial map as it is, and improved."""

import numpy as np

import qcball

# A bipyramid of eight tets around the origin, stretched and turned.
points = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 2], [0, 0, -2], [0.1, 0.2, 0]], float)
cells = [[6, a, b, top] for a, b in [(0, 1), (1, 2), (2, 3), (3, 0)] for top in (4, 5)]

radial = points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1)
radial[6] = 0.02, 0.04, 0.3
before = qcball.measure(points, cells, radial)
after = qcball.optimize(points, cells, radial)
print(f"max K {before.max_K:.4f} -> {after.max_K:.4f}, mean K {before.mean_K:.4f} -> {after.mean_K:.4f}")
for name, k in [("before", before.K), ("after", after.K)]:
    print(f"{name:>7}", np.round(np.sort(k), 3))

"""How good can a map of this mesh be? A bound from below, with a certificate that anybody can check."""

import numpy as np

import qcball

points = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)] + [[0.1, 0.0, 0.2]], float)
points[7] *= 1.6
quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
cells = [[8, *triangle] for a, b, c, d in quads for triangle in ([a, b, c], [a, c, d])]

m = qcball.ball_map(points, cells, certify=10)
print(m.summary())
for bound in sorted(m.bounds, key=lambda bound: -bound["value"])[:3]:
    print(f"{bound['name']:>12} {bound['kind']} >= {bound['value']:.6f}  {'applies' if bound['applies'] else 'does not apply'}")
if m.gap is not None:
    print(f"no map of this mesh with this boundary is better by more than {100 * (m.gap - 1):.4f} %")

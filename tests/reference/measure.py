"""The meshes of this folder and their measures, by numpy's SVD: independent of the program they test.

    python tests/reference/measure.py     writes grid-rest.mesh, grid-bent.mesh, grid-flipped.mesh and measures.csv
"""

import itertools
import pathlib

import numpy as np

HERE = pathlib.Path(__file__).parent


def grid():
    """The cube [-1, 1]^3 as 2 x 2 x 2 cubes of six tets each, its points off their places."""
    points = np.array([(i, j, k) for k in range(3) for j in range(3) for i in range(3)], float) - 1
    noise = np.random.default_rng(7).uniform(-0.08, 0.08, points.shape)
    tets = []
    for corner in itertools.product(range(2), repeat=3):
        for axes in itertools.permutations(range(3)):
            at, tet = list(corner), [corner]
            for axis in axes:
                at[axis] += 1
                tet.append(tuple(at))
            tets.append([i + 3 * j + 9 * k for i, j, k in tet])
    points = points + noise
    tets = np.array(tets)
    negative = np.linalg.det(edges(points, tets)) < 0
    tets[negative] = tets[negative][:, [0, 1, 3, 2]]
    return points, tets


def edges(points, tets):
    corners = points[tets]
    return np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)


def bent(p):
    x, y, z = p.T
    return np.stack([x + 0.2 * y * y, 1.5 * y + 0.1 * x * z, z - 0.15 * x * x + 0.1 * y], axis=1)


def write(name, points, tets):
    rows = [f"{x!r} {y!r} {z!r} 0" for x, y, z in points.tolist()]
    cells = [" ".join(str(v + 1) for v in tet) + " 0" for tet in tets.tolist()]
    text = ["MeshVersionFormatted 2", "Dimension 3", "Vertices", str(len(rows)), *rows]
    (HERE / name).write_text("\n".join([*text, "Tetrahedra", str(len(cells)), *cells, "End", ""]))


def boundary(tets):
    faces = np.sort(np.concatenate([tets[:, [i for i in range(4) if i != j]] for j in range(4)]), axis=1)
    unique, counts = np.unique(faces, axis=0, return_counts=True)
    return np.unique(unique[counts == 1])


def measures(rest, image, tets):
    jacobians = edges(image, tets) @ np.linalg.inv(edges(rest, tets))
    s1, s2, s3 = np.linalg.svd(jacobians, compute_uv=False).T
    positive = np.linalg.det(jacobians) > 0
    inner, outer = (s1 * s2 / s3**2)[positive], (s1**2 / (s2 * s3))[positive]
    k = np.maximum(inner, outer)
    on_boundary = boundary(tets)
    locked = np.isin(tets, on_boundary).all(axis=1).sum()
    largest = k.max() if positive.all() else np.inf
    counts = [len(rest), len(tets), len(on_boundary), locked, (~positive).sum()]
    return [*map(int, counts), *map(float, [largest, inner.max(), outer.max(), k.mean()])]


def main():
    rest, tets = grid()
    flipped = bent(rest)
    flipped[13] = [1.5, 0.2, 0.1]
    images = {"grid-bent.mesh": bent(rest), "grid-flipped.mesh": flipped}
    write("grid-rest.mesh", rest, tets)
    lines = ["rest,image,vertices,tets,boundary_vertices,locked,flipped,max_k,k_inner,k_outer,mean_k"]
    for name, image in images.items():
        write(name, image, tets)
        lines.append(",".join(["grid-rest.mesh", name, *map(repr, measures(rest, image, tets))]))
    (HERE / "measures.csv").write_text("\n".join(lines) + "\n")


main()

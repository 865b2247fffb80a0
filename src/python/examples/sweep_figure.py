"""How fine must the mesh be? A sweep over layers and subdivisions of a cube, as a table and a figure."""

import pathlib

import matplotlib

import qcball

matplotlib.use("Agg")
from matplotlib import pyplot  # noqa: E402

config = pathlib.Path("fineness.toml")
config.write_text("""
[domain]
solid = "cube"
[optimize]
polish = "none"
[sweep.grid]
"mesh.subdivisions" = [1, 2]
"mesh.layers" = [1, 2, 3, 4]
""")
table = qcball.sweep(config, out="fineness").to_pandas()
print("K by the fineness of the mesh")
print(table[["mesh.subdivisions", "mesh.layers", "tets", "max_k", "ball_k", "gap"]].to_string(index=False))

figure, axes = pyplot.subplots()
for subdivisions, rows in table.groupby("mesh.subdivisions"):
    axes.plot(rows["tets"], rows["ball_k"], "o-", label=f"{subdivisions} x {subdivisions} triangles for each")
axes.set(xscale="log", xlabel="tets", ylabel="K onto the ball, at most")
axes.legend()
figure.savefig("fineness.png", dpi=150)

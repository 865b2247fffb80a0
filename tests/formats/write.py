"""Writes one small mesh in every way that meshio and VTK know; run as `write.py DIR`.

The files in data/ were made by this with meshio 5.3.5 and VTK 9.7.2. Every coordinate has few digits, so that no writer
rounds it. Files named flat-* hold the surface, the others the tets among cells of lower dimension where the format can.
"""

import pathlib
import sys

import meshio
import numpy as np
import pyvista
from vtkmodules.vtkIOLegacy import vtkUnstructuredGridWriter
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

folder = pathlib.Path(sys.argv[1])
points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1.5, 1.25, 1], [-0.125, -0.5, -2]])
tets = np.array([[0, 1, 2, 3], [1, 2, 3, 4], [0, 2, 1, 5]])
values = [np.array([7.0, 8.0]), np.array([1.5, -0.25, 1e300]), np.array([9.0])]
triangles = np.array([[0, 2, 1], [0, 1, 3]])
mixed = [("triangle", triangles), ("tetra", tets), ("line", np.array([[0, 5]]))]

mesh = meshio.Mesh(points, mixed, cell_data={"K": values})
pure = meshio.Mesh(points, [("tetra", tets)])
block = meshio.Mesh(points, [("tetra", tets)], cell_data={"K": values[1:2]})
for compression in [None, "zlib"]:
    meshio.vtu.write(folder / f"meshio-binary-{compression}.vtu", mesh, binary=True, compression=compression)
meshio.vtu.write(folder / "meshio-ascii.vtu", mesh, binary=False, compression=None)
for binary in [True, False]:
    kind = "binary" if binary else "ascii"
    for version in ["4.2", "5.1"]:
        meshio.vtk.write(folder / f"meshio-{version}-{kind}.vtk", mesh, fmt_version=version, binary=binary)
    meshio.write(folder / f"meshio-41-{kind}.msh", block, file_format="gmsh", binary=binary)
    meshio.write(folder / f"meshio-22-{kind}.msh", mesh, file_format="gmsh22", binary=binary)
meshio.write(folder / "meshio.mesh", meshio.Mesh(points, mixed))
meshio.write(folder / "meshio.node", pure)

grid = pyvista.from_meshio(mesh)
grid.cell_data["vector"] = np.arange(18.0).reshape(6, 3)
grid.cell_data["number of cell"] = np.arange(6, dtype=np.int32)
grid.point_data["height"] = points[:, 2]
grid.field_data["year"] = np.array([2026])


def xml(name, mode, compressed, wide, big_endian=False, base64=False, block=None, compressor="ZLib"):
    writer = vtkXMLUnstructuredGridWriter()
    writer.SetFileName(str(folder / f"vtk-{name}.vtu"))
    writer.SetInputData(grid)
    writer.SetDataMode({"ascii": 0, "binary": 1, "appended": 2}[mode])
    writer.SetEncodeAppendedData(base64)
    getattr(writer, f"SetCompressorTypeTo{compressor if compressed else 'None'}")()
    (writer.SetHeaderTypeToUInt64 if wide else writer.SetHeaderTypeToUInt32)()
    (writer.SetByteOrderToBigEndian if big_endian else writer.SetByteOrderToLittleEndian)()
    if block:
        writer.SetBlockSize(block)
    assert writer.Write()


xml("ascii", "ascii", False, False)
xml("binary", "binary", False, True)
xml("binary-zlib-big-endian", "binary", True, False, big_endian=True)
xml("binary-zlib-blocks", "binary", True, False, block=48)
xml("binary-lz4", "binary", True, False, compressor="LZ4")
xml("appended-raw-lzma", "appended", True, True, compressor="LZMA", block=48)
xml("appended-raw", "appended", False, True)
xml("appended-raw-zlib", "appended", True, False)
xml("appended-base64", "appended", False, False, base64=True)
xml("appended-base64-zlib", "appended", True, True, base64=True)

for version in [42, 51]:
    for kind in ["ascii", "binary"]:
        writer = vtkUnstructuredGridWriter()
        writer.SetFileName(str(folder / f"vtk-{version}-{kind}.vtk"))
        writer.SetInputData(grid)
        writer.SetFileVersion(version)
        (writer.SetFileTypeToASCII if kind == "ascii" else writer.SetFileTypeToBinary)()
        assert writer.Write()

flat = meshio.Mesh(points[:4], [("triangle", np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]))])
for binary in [True, False]:
    kind = "binary" if binary else "ascii"
    meshio.write(folder / f"flat-meshio-{kind}.stl", flat, binary=binary)
    meshio.write(folder / f"flat-meshio-{kind}.ply", flat, binary=binary)
    surface = pyvista.from_meshio(flat).extract_surface(algorithm="dataset_surface")
    surface.save(folder / f"flat-pyvista-{kind}.stl", binary=binary)
    surface.save(folder / f"flat-pyvista-{kind}.ply", binary=binary)
meshio.write(folder / "flat-meshio.off", flat)
meshio.write(folder / "flat-meshio.obj", flat)

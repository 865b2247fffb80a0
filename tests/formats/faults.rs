//! What a refusal says: the file, the line where there are lines, and what is wrong.

use qcball::mesh::io::{TetFile, read_tet_file};
use qcball::mesh::{Vec3, VertexId};

use super::fixtures::data;

/// Reads a kept file after replacing `from`, which occurs once or more, by `to`.
fn read(name: &str, from: &str, to: &str) -> Result<TetFile, String> {
    let folder = tempfile::tempdir().unwrap();
    for partner in ["meshio.node", "meshio.ele"] {
        std::fs::copy(data().join(partner), folder.path().join(partner)).unwrap();
    }
    let text = std::fs::read_to_string(data().join(name)).unwrap();
    assert!(text.contains(from), "{name} lacks {from:?}");
    std::fs::write(folder.path().join(name), text.replacen(from, to, 1)).unwrap();
    read_tet_file(&folder.path().join(name)).map_err(|error| {
        let message = error.to_string();
        let folder = folder.path().display().to_string() + "/";
        message.strip_prefix(&folder).unwrap_or_else(|| panic!("{message} does not start with its file")).to_owned()
    })
}

#[test]
fn faults_name_file_and_line() {
    let cases = [
        ("meshio-5.1-ascii.vtk", "# vtk", "#vtk", "meshio-5.1-ascii.vtk:1: ", "no legacy VTK file"),
        (
            "meshio-5.1-ascii.vtk",
            "UNSTRUCTURED_GRID",
            "STRUCTURED_GRID",
            "meshio-5.1-ascii.vtk:4: ",
            "`STRUCTURED_GRID`",
        ),
        (
            "meshio-5.1-ascii.vtk",
            "1.25",
            "1,25",
            "meshio-5.1-ascii.vtk:6: ",
            "POINTS is `1,25`, but should be a number",
        ),
        ("meshio-5.1-ascii.vtk", "1.25", "nan", "meshio-5.1-ascii.vtk: ", "vertex 4"),
        ("meshio-5.1-ascii.vtk", "POINTS 6 double", "POINTS 6 string", "meshio-5.1-ascii.vtk:5: ", "`string`"),
        ("meshio-4.2-ascii.vtk", "CELLS 6", "CELLS 5", "meshio-4.2-ascii.vtk: ", "announces 5 cells, but lists 6"),
        ("vtk-51-ascii.vtk", "CELL_DATA", "CELL_DATE", "vtk-51-ascii.vtk:35: ", "`CELL_DATE` is no keyword"),
        ("vtk-51-ascii.vtk", "5\n5\n10", "5\n5\n12", "vtk-51-ascii.vtk: ", "cell 2 (counted from 0) is a hexahedron"),
        ("vtk-51-ascii.vtk", "5\n5\n10", "5\n5\n24", "vtk-51-ascii.vtk: ", "a tetrahedron of second order of 4"),
        (
            "vtk-51-ascii.vtk",
            "5\n5\n10",
            "5\n10\n10",
            "vtk-51-ascii.vtk: ",
            "cell 1 (counted from 0) is a tetrahedron of 3",
        ),
        ("vtk-51-ascii.vtk", "0 3 6 10", "0 3 2 10", "vtk-51-ascii.vtk: ", "the offsets are wrong"),
        ("vtk-51-ascii.vtk", "3 1 2 3 4", "3 1 2 3 9", "vtk-51-ascii.vtk: ", "cell 3 names vertex 9"),
        ("vtk-ascii.vtu", "type=\"UnstructuredGrid\"", "type=\"ImageData\"", "vtk-ascii.vtu:1: ", "`ImageData`"),
        ("vtk-ascii.vtu", "</Piece>", "", "vtk-ascii.vtu:", "broken XML"),
        ("vtk-ascii.vtu", "</VTKFile>", "", "vtk-ascii.vtu:", "truncated"),
        ("vtk-ascii.vtu", "1.5 1.25", "1.5 x", "vtk-ascii.vtu:", "the array \"Points\" is `x`"),
        (
            "vtk-ascii.vtu",
            "NumberOfCells=\"6\"",
            "NumberOfCells=\"7\"",
            "vtk-ascii.vtu:",
            "the file ends before the array",
        ),
        (
            "vtk-binary.vtu",
            "Name=\"K\" format=\"binary\"",
            "Name=\"K\" format=\"packed\"",
            "vtk-binary.vtu:",
            "its format is \"packed\"",
        ),
        (
            "meshio-binary-zlib.vtu",
            "vtkZLibDataCompressor",
            "vtkLZ5DataCompressor",
            "meshio-binary-zlib.vtu:2: ",
            "write the file with zlib",
        ),
        (
            "vtk-binary.vtu",
            "NumberOfPoints=\"6\"",
            "NumberOfPoints=\"7\"",
            "vtk-binary.vtu:",
            "it announces 144 bytes, but 168 are needed",
        ),
        ("meshio-22-ascii.msh", "2.2 0 8", "3.0 0 8", "meshio-22-ascii.msh:2: ", "save it as 4.1 or 2.2"),
        (
            "meshio-22-ascii.msh",
            "3 4 2 0 0 1 2 3 4",
            "3 32 2 0 0 1 2 3 4",
            "meshio-22-ascii.msh:17: ",
            "Gmsh's type 32, which are not read",
        ),
        (
            "meshio-22-ascii.msh",
            "4 4 2 0 0 2 3 4 5",
            "4 4 2 0 0 2 3 4 55",
            "meshio-22-ascii.msh: ",
            "the element 4 names the node 55",
        ),
        (
            "meshio-22-ascii.msh",
            "4 4 2 0 0 2 3 4 5",
            "3 4 2 0 0 2 3 4 5",
            "meshio-22-ascii.msh: ",
            "two elements have the tag 3",
        ),
        ("meshio-22-ascii.msh", "$EndNodes", "$EndNotes", "meshio-22-ascii.msh:12: ", "`$EndNotes`"),
        ("meshio-41-ascii.msh", "4.1 0 8", "4.2 0 8", "meshio-41-ascii.msh:2: ", "version `4.2`"),
        ("meshio-41-ascii.msh", "3 0 4 3", "3 0 99 3", "meshio-41-ascii.msh:", "Gmsh's type 99"),
        ("meshio.node", "6 3 0 0", "6 2 0 0", "meshio.node:2: ", "2 coordinates"),
        ("meshio.node", "\n2 ", "\n7 ", "meshio.node:5: ", "vertex 7 stands where number 2 should"),
        ("meshio.ele", "3 4 0", "3 5 0", "meshio.ele:2: ", "the tets have 5 nodes each"),
        ("meshio.ele", "2 0 2 1 5", "2 0 2 1 6", "meshio.ele:5: ", "vertex 6, but the vertices are 0 to 5"),
    ];
    let mut wrong = Vec::new();
    for (name, from, to, place, words) in cases {
        match read(name, from, to) {
            Err(error) if error.starts_with(place) && error.contains(words) => {}
            other => wrong.push(format!("{from:?} to {to:?}: {other:?}")),
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_partner_that_is_missing_is_named() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(data().join("meshio.node"), folder.path().join("alone.node")).unwrap();
    let error = read_tet_file(&folder.path().join("alone.node")).unwrap_err().to_string();
    assert!(error.contains("alone.ele: No such file"), "{error}");
}

#[test]
fn gmsh_tags_may_be_any_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.msh");
    let text = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Comments\nanything 1 2\n$EndComments\n$Elements\n2 3 5 30\n\
                2 1 2 1\n5 40 10 20\n3 1 4 2\n30 40 10 20 7\n6 7 40 20 99\n$EndElements\n$Nodes\n2 5 7 99\n\
                2 1 1 2\n40\n10\n0 0 0 0.1 0.2\n1 0 0 0.3 0.4\n3 1 0 3\n20\n7\n99\n0 1 0\n0 0 1\n1 1 1\n$EndNodes\n\
                $ElementData\n1\n\"part\"\n1\n0\n3\n0\n1\n2\n6 2.5\n5 9\n$EndElementData\n";
    std::fs::write(&path, text).unwrap();
    let file = read_tet_file(&path).unwrap();
    assert_eq!(file.soup.tets, [[0, 1, 2, 3], [3, 0, 2, 4]].map(|tet| tet.map(VertexId)));
    assert_eq!(file.soup.points[1], Vec3::x());
    assert_eq!(file.skipped_cells, 1);
    // No value is given for the first tet.
    let (name, values) = &file.cell_data[0];
    assert_eq!((name.as_str(), values[0].is_nan(), values[1]), ("part", true, 2.5));
}

#[test]
fn tetgen_files_count_from_either_name_their_attributes_and_may_have_more_to_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    put("a.node", "# from one\n4 3 1 1 # with a marker\n\n1 0 0 0 5 -1\n2 1 0 0 5 -1\n3 0 1 0 5 -1\n4 0 0 1 5 -1\n");
    put("a.ele", "1 4 2\n1 1 2 3 4 7 0.5\n# Generated by tetgen\n");
    let file = read_tet_file(&folder.path().join("a.ele")).unwrap();
    assert_eq!(file.soup.tets, [[0, 1, 2, 3].map(VertexId)]);
    assert_eq!(file.cell_data, [("attribute 1".to_owned(), vec![7.0]), ("attribute 2".to_owned(), vec![0.5])]);

    // Markers that the first line does not announce, as Chaste writes them.
    put("b.node", "4 3 0 0\n0 0 0 0 1\n1 1 0 0 1\n2 0 1 0 1\n3 0 0 1 1\n");
    put("b.ele", "1 4 0\n0 0 1 2 3 9 # a region\n");
    let file = read_tet_file(&folder.path().join("b.ele")).unwrap();
    assert_eq!((file.soup.points[3], file.soup.tets), ([0.0, 0.0, 1.0].into(), vec![[0, 1, 2, 3].map(VertexId)]));
    assert!(file.cell_data.is_empty());
}

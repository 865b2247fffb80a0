//! Files written by meshio and VTK, kept in data/; write.py made them.

use std::path::{Path, PathBuf};

use qcball::mesh::io::{read_surface, read_tet_file};
use qcball::mesh::{TetMesh, Vec3, VertexId};

/// The folder of the kept files.
pub fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/formats/data")
}

/// The files of a folder, in the order of their names.
pub fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

const POINTS: [[f64; 3]; 6] =
    [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.5, 1.25, 1.0], [-0.125, -0.5, -2.0]];

/// Reads every file that write.py has put into a folder and compares it with what write.py was given.
pub fn check(folder: &Path) {
    let mut seen = 0;
    for path in files(folder) {
        let name = path.file_name().unwrap().to_str().unwrap();
        if name.starts_with("flat-") {
            check_surface(&path);
        } else {
            check_tets(&path, name);
        }
        seen += 1;
    }
    assert_eq!(seen, 38, "write.py and this test belong together");
}

fn check_tets(path: &Path, name: &str) {
    let file = read_tet_file(path).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(file.soup.points, POINTS.map(Vec3::from), "{name}");
    assert_eq!(file.soup.tets, [[0, 1, 2, 3], [1, 2, 3, 4], [0, 2, 1, 5]].map(|tet| tet.map(VertexId)), "{name}");
    let pure = ["meshio.node", "meshio.ele", "meshio-41-ascii.msh", "meshio-41-binary.msh"].contains(&name);
    assert_eq!(file.skipped_cells, if pure { 0 } else { 3 }, "{name}");
    let mut expected = vec![("K".to_owned(), vec![1.5, -0.25, 1e300])];
    if name.starts_with("vtk-") {
        // An array of vectors, which stood before it, is not read.
        expected.push(("number of cell".into(), vec![2.0, 3.0, 4.0]));
    }
    if ["meshio.mesh", "meshio.node", "meshio.ele"].contains(&name) {
        expected.clear();
    }
    assert_eq!(file.cell_data, expected, "{name}");
    let (_, exchanged) = TetMesh::from_either_orientation(file.soup.points, file.soup.tets).unwrap();
    assert_eq!(exchanged, 0, "{name}");
}

fn check_surface(path: &Path) {
    let soup = read_surface(path).unwrap_or_else(|error| panic!("{error}"));
    let corners = |polygon: &[VertexId]| polygon.iter().map(|v| soup.points[v.index()]).collect::<Vec<_>>();
    let found: Vec<Vec<Vec3>> = soup.polygons.iter().map(|polygon| corners(polygon)).collect();
    let expected = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]].map(|face| face.map(|v: usize| Vec3::from(POINTS[v])));
    assert_eq!(found, expected, "{}", path.display());
    assert_eq!(soup.points.len(), 4, "{}", path.display());
}

#[test]
fn kept_files_of_meshio_and_vtk_are_read() {
    check(&data());
}

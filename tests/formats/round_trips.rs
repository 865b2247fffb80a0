//! What is written is what is read, to the bit where the format can.

use std::path::Path;

use proptest::prelude::*;
use qcball::mesh::io::{CellData, read_tet_file, write_tets};
use qcball::mesh::{Vec3, VertexId};

/// Formats with cell data; Medit, which has none, is tested beside them.
const WITH_DATA: [&str; 6] = ["vtu", "vtk", "msh", "msh2", "node", "ELE"];

/// Any finite number, with the awkward ones more often than chance has them.
fn coordinate() -> impl Strategy<Value = f64> {
    let awkward = [0.0, -0.0, 5e-324, -f64::MIN_POSITIVE, 1e300, -f64::MAX, 0.1, 1.0 / 3.0, 2f64.powi(53) + 2.0];
    prop_oneof![
        1 => prop::sample::select(awkward.to_vec()),
        2 => prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL | prop::num::f64::ZERO | prop::num::f64::NEGATIVE,
    ]
}

fn points(count: usize) -> impl Strategy<Value = Vec<Vec3>> {
    prop::collection::vec(prop::array::uniform3(coordinate()).prop_map(Vec3::from), count)
}

/// Points, tets on them, and cell data.
fn mesh() -> impl Strategy<Value = (Vec<Vec3>, Vec<[VertexId; 4]>, CellData)> {
    (1usize..60, 1usize..80, prop::collection::btree_set("[A-Za-z<>&'%_.:-][ -!#-+--~é]{0,6}[a-z0-9%]", 0..3))
        .prop_flat_map(|(points_count, tets, names)| {
            let tet = prop::array::uniform4(0..points_count as u32).prop_map(|tet| tet.map(VertexId));
            let numbers = prop_oneof![9 => coordinate(), 1 => Just(f64::INFINITY), 1 => Just(f64::NEG_INFINITY)];
            let values = prop::collection::vec(prop::collection::vec(numbers, tets), names.len());
            let data = values.prop_map(move |values| names.iter().cloned().zip(values).collect());
            (points(points_count), prop::collection::vec(tet, tets), data)
        })
}

/// The bits, since -0 equals 0.
fn bits(points: &[Vec3]) -> Vec<[u64; 3]> {
    points.iter().map(|p| [p.x, p.y, p.z].map(f64::to_bits)).collect()
}

fn data_bits(data: &CellData) -> Vec<(String, Vec<u64>)> {
    data.iter().map(|(name, values)| (name.clone(), values.iter().map(|value| value.to_bits()).collect())).collect()
}

/// Writes and reads; whether all came back.
fn comes_back(path: &Path, points: &[Vec3], tets: &[[VertexId; 4]], data: &CellData) {
    write_tets(path, points, tets, data).unwrap();
    let file = read_tet_file(path).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(bits(&file.soup.points), bits(points), "{}", path.display());
    assert_eq!(file.soup.tets, tets, "{}", path.display());
    assert_eq!(data_bits(&file.cell_data), data_bits(data), "{}", path.display());
    assert_eq!(file.skipped_cells, 0);
}

proptest! {
    // Every file is flushed to the disk.
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn tets_and_their_data_come_back((points, tets, data) in mesh()) {
        let folder = tempfile::tempdir().unwrap();
        for ending in WITH_DATA {
            comes_back(&folder.path().join("a").with_extension(ending), &points, &tets, &data);
        }
        comes_back(&folder.path().join("a.mesh"), &points, &tets, &CellData::new());
    }

    #[test]
    fn every_pair_of_formats_agrees((points, tets, data) in mesh(), from in 0..6usize, to in 0..6usize) {
        let folder = tempfile::tempdir().unwrap();
        let [first, second] = [("a", from), ("b", to)].map(|(name, i)| folder.path().join(name).with_extension(WITH_DATA[i]));
        write_tets(&first, &points, &tets, &data).unwrap();
        let file = read_tet_file(&first).unwrap();
        write_tets(&second, &file.soup.points, &file.soup.tets, &file.cell_data).unwrap();
        let again = read_tet_file(&second).unwrap();
        prop_assert_eq!(bits(&again.soup.points), bits(&points));
        prop_assert_eq!(again.soup.tets, tets);
        prop_assert_eq!(data_bits(&again.cell_data), data_bits(&data));
    }
}

#[test]
fn a_large_mesh_comes_back() {
    // Beyond one block of compressed data, and beyond small indices.
    let points: Vec<Vec3> = (0..20_000).map(|i| Vec3::new(f64::from(i).sqrt(), f64::from(i).sin(), 1.0)).collect();
    let tets: Vec<[VertexId; 4]> = (0..19_997).map(|i| [i, i + 1, i + 2, i + 3].map(VertexId)).collect();
    let data =
        vec![("zero".to_owned(), vec![0.0; tets.len()]), ("K".into(), points[3..].iter().map(|p| p.y).collect())];
    let folder = tempfile::tempdir().unwrap();
    for ending in WITH_DATA {
        comes_back(&folder.path().join("a").with_extension(ending), &points, &tets, &data);
    }
}

#[test]
fn what_a_format_cannot_hold_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let refusal = |name: &str, data: &[(&str, f64)]| {
        let data = data.iter().map(|&(name, value)| (name.to_owned(), vec![value])).collect();
        let points = [Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z()];
        write_tets(&at(name), &points, &[[0, 1, 2, 3].map(VertexId)], &data).unwrap_err().to_string()
    };
    assert!(refusal("a.stp", &[]).ends_with(
        "a.stp: unknown file ending \"stp\"; use one of .mesh (Medit), .vtu, .vtk (legacy VTK), .msh (Gmsh 4.1), .msh2 \
         (Gmsh 2.2), .node or .ele (TetGen)"
    ));
    assert!(refusal("a.mesh", &[("K", 1.0)]).contains("Medit's format holds no cell data; use .vtu"));
    assert!(refusal("a.vtk", &[("a\nb", 1.0)]).contains("control character"));
    assert!(refusal("a.msh", &[("a\"", 1.0)]).contains("quotation mark"));
    assert!(refusal("a.vtu", &[("K", 1.0), ("K", 2.0)]).contains("\"K\" of cell data occurs twice"));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "wrote something");
}

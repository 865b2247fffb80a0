use super::*;
use proptest::prelude::*;

const GOOD: &str = "MeshVersionFormatted 2\nDimension 3\nVertices\n4\n0 0 0 0\n1 0 0 0\n0 1 0 0\n0 0 1 0\n\
                    Triangles 1\n1 2 3 7\nTetrahedra\n1\n1 2 3 4 0\nEnd\n";

fn read(text: &str) -> Result<crate::mesh::io::TetFile, Fault> {
    parse(text.as_bytes()).and_then(Contents::into_tets)
}

fn fault(text: &str) -> Fault {
    read(text).unwrap_err()
}

#[test]
fn any_layout_and_order_reads_the_same() {
    let expected = read(GOOD).unwrap();
    assert_eq!(expected.skipped_cells, 1);
    let expected = expected.soup;
    assert_eq!(expected.points[2], Vec3::y());
    assert_eq!(expected.tets, [[0, 1, 2, 3].map(VertexId)]);
    let one_line = GOOD.replace('\n', " ");
    let commented = GOOD.replace('\n', "# nan Tetrahedra 5\r\n\n");
    let tets_first = "MeshVersionFormatted\n1 Dimension\n3 Tetrahedra 1 1 2 3 4 0 Corners 2 1 2 Vertices 4 0 0 0 0 1 0 0 \
                      0 0 1 0 0 0 0 1 0";
    for text in [&one_line, &commented, tets_first] {
        assert_eq!(read(text).unwrap().soup, expected, "{text}");
    }
}

#[test]
fn faults_name_their_line() {
    let cases = [
        ("# only a comment\n", None, "no section `Vertices`"),
        ("OFF\n3 1 0\n", Some(1), "not a Medit mesh"),
        (&GOOD.replace("Dimension 3", "Dimension 2"), Some(2), "dimension"),
        (&GOOD[..GOOD.find("Tetra").unwrap()], None, "a surface, polygons without tets"),
        ("MeshVersionFormatted 2 Dimension 3 Vertices 1 0 0 0 0", None, "no section `Tetrahedra`"),
        (&GOOD.replace("1 2 3 4 0\nEnd\n", "1 2"), Some(12), "room for at most 0"),
        (&GOOD.replace("1 2 3 4 0\nEnd\n", "1 2 3 4     "), Some(13), "truncated"),
        (&GOOD.replace("0 1 0 0\n", "0 one 0 0\n"), Some(7), "`one`"),
        (&GOOD.replace("0 1 0 0\n", "0 1x 0 0\n"), Some(7), "`1x`"),
        (&GOOD.replace("0 1 0 0\n", "0 nan 0 0\n"), Some(7), "finite"),
        (&GOOD.replace("0 1 0 0\n", "0 -inf 0 0\n"), Some(7), "finite"),
        (&GOOD.replace("0 1 0 0\n", "0 1e999 0 0\n"), Some(7), "finite"),
        (&GOOD.replace("0 1 0 0\n", ""), Some(8), "fewer entries"),
        (&GOOD.replace("0 1 0 0\n", "0 1 0 0\n0 1 0 0\n"), Some(9), "more entries"),
        (&GOOD.replace("1 2 3 4 0", "1 2 3 5 0"), Some(13), "vertex 5"),
        (&GOOD.replace("1 2 3 4 0", "0 2 3 4 0"), Some(13), "counts from 1"),
        (&GOOD.replace("1 2 3 4 0", "-1 2 3 4 0"), Some(13), "`-1`"),
        (&GOOD.replace("Vertices\n4", "Vertices\n1000000000000000000"), Some(4), "room for at most"),
        (&GOOD.replace("Vertices\n4", "Vertices\n-4"), Some(4), "`-4`"),
        (&GOOD.replace("Triangles", "Wedges"), Some(9), "split them"),
        (&GOOD.replace("Triangles", "Hexahedra"), Some(10), "names vertex 7"),
        (&GOOD.replace("End", "Vertices 0"), Some(14), "second section"),
    ];
    for (text, line, words) in cases {
        let found = fault(text);
        assert_eq!(found.0, line, "{text}\n{}", found.1);
        assert!(found.1.contains(words), "{text}\n{}", found.1);
    }
}

#[test]
fn missing_folders_and_empty_files_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let empty = folder.path().join("empty.mesh");
    std::fs::write(&empty, " \n").unwrap();
    assert!(matches!(read_medit(folder.path()), Err(ReadError::Directory { .. })));
    assert!(matches!(read_medit(&folder.path().join("none.mesh")), Err(ReadError::Open { .. })));
    assert!(matches!(read_medit(&empty), Err(ReadError::Empty { .. })));
}

proptest! {
    #[test]
    fn positions_survive_to_the_bit(
        coordinates in prop::collection::vec(prop::array::uniform3(prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL), 4..9),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mesh");
        let points: Vec<Vec3> = coordinates.into_iter().map(Vec3::from).collect();
        let tets = vec![[3, 1, 0, 2].map(VertexId)];
        write_medit(&path, &points, &tets).unwrap();
        prop_assert_eq!(read_medit(&path).unwrap(), TetSoup { points, tets, notes: vec![] });
    }

    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let _ = parse(&bytes);
    }

    #[test]
    fn random_damage_never_panics(at in 0..GOOD.len(), length in 0..30usize, put in "[ -~\n]{0,12}") {
        let mut text = GOOD.to_string();
        text.replace_range(at..(at + length).min(GOOD.len()), &put);
        let _ = parse(text.as_bytes());
    }

    #[test]
    fn every_truncation_is_an_error(at in 0..GOOD.find("0\nEnd").unwrap()) {
        // Only the closing `End` may be missing.
        prop_assert!(read(&GOOD[..at]).is_err());
    }
}

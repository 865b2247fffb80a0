//! Files cut short, changed, made of noise or of absurd counts: an error or a mesh, never a panic, a hang or a blow-up.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use assert_cmd::cargo::cargo_bin;
use proptest::prelude::*;
use proptest::sample::Index;
use qcball::mesh::io::{read_surface, read_tet_file, write_tets};
use qcball::mesh::{Vec3, VertexId};

use super::fixtures::{data, files};

/// Far more than any of these small files takes, on a machine with other load.
const LONGEST: Duration = Duration::from_secs(5);

/// The kept files with their bytes, and TetGen's two with each other's name in place.
fn seeds() -> Vec<(String, Vec<u8>)> {
    files(&data())
        .into_iter()
        .map(|path| (path.file_name().unwrap().to_str().unwrap().to_owned(), std::fs::read(&path).unwrap()))
        .collect()
}

/// Reads `bytes` under this name; what is accepted must hold together. Returns whether it was accepted.
fn read(folder: &Path, name: &str, bytes: &[u8]) -> bool {
    if name.ends_with(".node") || name.ends_with(".ele") {
        let partner = if name.ends_with(".node") { "meshio.ele" } else { "meshio.node" };
        if !folder.join(partner).exists() {
            std::fs::copy(data().join(partner), folder.join(partner)).unwrap();
        }
    }
    let path = folder.join(name);
    // A file that is overwritten in place is flushed to the disk when closed (ext4), which takes minutes here.
    let _ = std::fs::remove_file(&path);
    std::fs::write(&path, bytes).unwrap();
    let started = Instant::now();
    let accepted = if name.starts_with("flat-") {
        read_surface(&path).is_ok()
    } else {
        read_tet_file(&path).is_ok_and(|file| {
            let count = file.soup.points.len();
            let named = || file.soup.tets.iter().flatten().filter_map(|v| file.soup.points.get(v.index()));
            assert!(named().all(|point| point.iter().all(|x| x.is_finite())), "{name}");
            assert!(file.soup.tets.iter().flatten().all(|v| v.index() < count), "{name}");
            assert!(file.cell_data.iter().all(|(_, values)| values.len() == file.soup.tets.len()), "{name}");
            true
        })
    };
    assert!(started.elapsed() < LONGEST, "{name}: {:?}", started.elapsed());
    accepted
}

#[derive(Clone, Debug)]
enum Damage {
    Set(Index, u8),
    Remove(Index, usize),
    Repeat(Index, usize),
    /// A number becomes an absurd one.
    Number(Index, &'static str),
    Cut(Index),
}

fn damage() -> impl Strategy<Value = Damage> {
    let numbers =
        ["1000000000000000000", "18446744073709551615", "-1", "4294967296", "0", "99999999999999999999", "nan", "2"];
    prop_oneof![
        4 => (any::<Index>(), any::<u8>()).prop_map(|(at, byte)| Damage::Set(at, byte)),
        1 => (any::<Index>(), 1usize..20).prop_map(|(at, length)| Damage::Remove(at, length)),
        1 => (any::<Index>(), 1usize..40).prop_map(|(at, length)| Damage::Repeat(at, length)),
        3 => (any::<Index>(), prop::sample::select(numbers.to_vec())).prop_map(|(at, with)| Damage::Number(at, with)),
        1 => any::<Index>().prop_map(Damage::Cut),
    ]
}

fn apply(bytes: &mut Vec<u8>, damage: &Damage) {
    if bytes.is_empty() {
        return;
    }
    let length = bytes.len();
    match *damage {
        Damage::Set(at, byte) => bytes[at.index(length)] = byte,
        Damage::Remove(at, count) => {
            let at = at.index(length);
            bytes.drain(at..length.min(at + count));
        }
        Damage::Repeat(at, count) => {
            let at = at.index(length);
            let part = bytes[at..length.min(at + count)].to_vec();
            bytes.splice(at..at, part);
        }
        Damage::Number(at, with) => {
            let at = at.index(length);
            let Some(start) = bytes[at..].iter().position(u8::is_ascii_digit).map(|offset| at + offset) else { return };
            let end = bytes[start..].iter().position(|b| !b.is_ascii_digit()).map_or(length, |offset| start + offset);
            bytes.splice(start..end, with.bytes());
        }
        Damage::Cut(at) => bytes.truncate(at.index(length)),
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1000, ..ProptestConfig::default() })]

    #[test]
    fn changed_files_never_panic(which in any::<Index>(), damages in prop::collection::vec(damage(), 1..4)) {
        let seeds = seeds();
        let (name, mut bytes) = seeds[which.index(seeds.len())].clone();
        damages.iter().for_each(|damage| apply(&mut bytes, damage));
        read(tempfile::tempdir().unwrap().path(), &name, &bytes);
    }

    #[test]
    fn noise_never_panics(which in any::<Index>(), keep in any::<Index>(), noise in prop::collection::vec(any::<u8>(), 0..300)) {
        let seeds = seeds();
        let (name, bytes) = &seeds[which.index(seeds.len())];
        let folder = tempfile::tempdir().unwrap();
        // A binary STL file has no mark of its own, and a header that was never completed still counts the triangles.
        prop_assert!(!read(folder.path(), name, &noise) || name.ends_with(".stl"));
        read(folder.path(), name, &[&bytes[..keep.index(bytes.len())], &noise].concat());
    }
}

/// A cut between two arrays of cell data, or within the last number of a text, cannot be told from a shorter file; any
/// other one must be.
#[test]
fn a_file_of_tets_cut_anywhere_is_refused_or_lacks_no_more_than_data() {
    for (name, bytes) in seeds().iter().filter(|(name, _)| !name.starts_with("flat-")) {
        let folder = tempfile::tempdir().unwrap();
        let whole = read_tet_file(&data().join(name)).unwrap();
        let mut refused = 0;
        for length in 0..bytes.len() {
            if !read(folder.path(), name, &bytes[..length]) {
                refused += 1;
                continue;
            }
            let file = read_tet_file(&folder.path().join(name)).unwrap();
            assert_eq!(file.soup, whole.soup, "{name} cut at {length}");
            for (array, whole) in file.cell_data.iter().zip(&whole.cell_data) {
                let all_but_last = array.1.len() - 1;
                assert_eq!(array.0, whole.0, "{name} cut at {length}");
                assert_eq!(array.1[..all_but_last], whole.1[..all_but_last], "{name} cut at {length}");
            }
        }
        assert!(2 * refused > bytes.len(), "{name}: only {refused} of {} cuts were refused", bytes.len());
    }
}

/// Runs `qcball measure` on two files with a limit on its memory; the reader must refuse them in time.
fn refused_within_limits(folder: &Path, name: &str) -> String {
    let mut command = Command::new("sh");
    command.current_dir(folder).env("RAYON_NUM_THREADS", "1");
    let output = command
        .args(["-c", "ulimit -v 400000; exec timeout 20 \"$0\" measure \"$1\" \"$1\""])
        .arg(cargo_bin!("qcball"))
        .arg(name)
        .output()
        .unwrap();
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{name}: {error}");
    assert!(error.contains(name.split('.').next().unwrap()), "{name}: {error}");
    error
}

#[test]
fn absurd_counts_are_refused_in_little_memory() {
    let folder = tempfile::tempdir().unwrap();
    let absurd = "1000000000000000000";
    // (seed, what is replaced, by what)
    let cases = [
        ("meshio.mesh", "\n6\n", format!("\n{absurd}\n")),
        ("meshio.mesh", "Tetrahedra\n3", format!("Tetrahedra\n{absurd}")),
        ("meshio.node", "6 3 0 0", format!("{absurd} 3 0 0")),
        ("meshio.node", "6 3 0 0", format!("6 3 {absurd} 0")),
        ("meshio.ele", "3 4 0", format!("{absurd} 4 0")),
        ("meshio.ele", "3 4 0", format!("3 4 {absurd}")),
        ("vtk-51-ascii.vtk", "POINTS 6", format!("POINTS {absurd}")),
        ("vtk-51-binary.vtk", "POINTS 6", format!("POINTS {absurd}")),
        ("vtk-51-binary.vtk", "CELLS 7 20", format!("CELLS 7 {absurd}")),
        ("vtk-51-binary.vtk", "CELLS 7 20", format!("CELLS {absurd} 20")),
        ("vtk-51-binary.vtk", "CELL_TYPES 6", format!("CELL_TYPES {absurd}")),
        ("vtk-42-binary.vtk", "CELLS 6 ", format!("CELLS {absurd} ")),
        ("vtk-51-ascii.vtk", "FieldData 2", format!("FieldData {absurd}")),
        ("vtk-51-binary.vtk", "vector 3 6", format!("vector {absurd} {absurd}")),
        ("meshio-22-ascii.msh", "$Nodes\n6", format!("$Nodes\n{absurd}")),
        ("meshio-22-ascii.msh", "$Elements\n6", format!("$Elements\n{absurd}")),
        ("meshio-22-binary.msh", "$Nodes\n6", format!("$Nodes\n{absurd}")),
        ("meshio-22-binary.msh", "$Elements\n6", format!("$Elements\n{absurd}")),
        ("meshio-41-ascii.msh", "\n3 0 0 6\n", format!("\n3 0 0 {absurd}\n")),
        ("meshio-41-ascii.msh", "\n3 0 4 3\n", format!("\n3 0 4 {absurd}\n")),
        ("meshio-41-ascii.msh", "0\n1\n3\n", format!("0\n1\n{absurd}\n")),
        ("meshio-41-ascii.msh", "0\n1\n3\n", format!("0\n{absurd}\n3\n")),
        ("vtk-ascii.vtu", "NumberOfPoints=\"6\"", format!("NumberOfPoints=\"{absurd}\"")),
        ("vtk-binary.vtu", "NumberOfPoints=\"6\"", format!("NumberOfPoints=\"{absurd}\"")),
        ("vtk-binary.vtu", "NumberOfCells=\"6\"", format!("NumberOfCells=\"{absurd}\"")),
        ("vtk-appended-raw.vtu", "NumberOfCells=\"6\"", format!("NumberOfCells=\"{absurd}\"")),
        ("vtk-appended-raw-zlib.vtu", "NumberOfCells=\"6\"", format!("NumberOfCells=\"{absurd}\"")),
        ("vtk-appended-raw.vtu", "offset=\"464\"", format!("offset=\"{absurd}\"")),
    ];
    for (number, (seed, from, to)) in cases.iter().enumerate() {
        let bytes = std::fs::read(data().join(seed)).unwrap();
        let at = bytes.windows(from.len()).position(|window| window == from.as_bytes());
        let at = at.unwrap_or_else(|| panic!("{seed} lacks {from:?}"));
        let bytes = [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat();
        let name = format!("case{number}.{}", seed.rsplit_once('.').unwrap().1);
        for ending in ["node", "ele"] {
            let pair = folder.path().join(format!("case{number}.{ending}"));
            std::fs::copy(data().join("meshio").with_extension(ending), pair).unwrap();
        }
        std::fs::write(folder.path().join(&name), bytes).unwrap();
        refused_within_limits(folder.path(), &name);
    }
}

#[test]
fn a_decompression_bomb_is_refused_in_little_memory() {
    // 2^27 numbers that are all zero: a gigabyte in each of three arrays, about a megabyte in the file.
    let count = 1 << 27;
    let folder = tempfile::tempdir().unwrap();
    let zero = {
        use base64::Engine;
        use std::io::Write;
        let mut header = Vec::new();
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
        let piece = vec![0u8; 1 << 20];
        (0..count * 8 / piece.len()).for_each(|_| encoder.write_all(&piece).unwrap());
        let packed = encoder.finish().unwrap();
        [1, count as u64 * 8, 0, packed.len() as u64].iter().for_each(|size| header.extend(size.to_le_bytes()));
        let engine = base64::engine::general_purpose::STANDARD;
        engine.encode(header) + &engine.encode(packed)
    };
    let array = |name: &str, kind: &str, components: u32| {
        format!(
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"binary\">{zero}</DataArray>"
        )
    };
    let text = format!(
        "<VTKFile type=\"UnstructuredGrid\" byte_order=\"LittleEndian\" header_type=\"UInt64\" \
         compressor=\"vtkZLibDataCompressor\"><UnstructuredGrid><Piece NumberOfPoints=\"{}\" NumberOfCells=\"{count}\">\
         <Points>{}</Points><Cells>{}{}{}</Cells></Piece></UnstructuredGrid></VTKFile>",
        count / 3,
        array("Points", "Float64", 3),
        array("connectivity", "Int64", 1),
        array("offsets", "Int64", 1),
        array("types", "UInt8", 1),
    );
    std::fs::write(folder.path().join("bomb.vtu"), text).unwrap();
    let error = refused_within_limits(folder.path(), "bomb.vtu");
    assert!(error.contains("bomb.vtu:1") && error.contains("announces"), "{error}");
}

#[test]
fn measuring_tells_of_negative_orientation() {
    let folder = tempfile::tempdir().unwrap();
    let points = [Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z(), Vec3::new(1.0, 1.0, 1.0)];
    let [positive, negative] = [[[0, 1, 2, 3], [1, 2, 3, 4]], [[0, 2, 1, 3], [1, 2, 3, 4]]];
    for (name, tets) in [("positive.vtk", positive), ("negative.msh", negative)] {
        write_tets(&folder.path().join(name), &points, &tets.map(|tet| tet.map(VertexId)), &vec![]).unwrap();
    }
    let told = |name: &str| {
        let mut command = assert_cmd::Command::new(cargo_bin!("qcball"));
        let output =
            command.current_dir(folder.path()).args(["measure", name, "positive.vtk", "--json"]).output().unwrap();
        assert!(output.status.success());
        assert!(String::from_utf8_lossy(&output.stdout).contains("\"max_k\": 1"), "{:?}", output.stdout);
        String::from_utf8(output.stderr).unwrap()
    };
    assert_eq!(told("positive.vtk"), "");
    assert_eq!(
        told("negative.msh"),
        "note: 1 of 2 tets of negative.msh were stored with negative orientation; two vertices of each were exchanged\n"
    );
}

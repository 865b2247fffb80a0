//! Every surface reader: good files, each kind of bad file, and random bytes.

use proptest::prelude::*;
use tempfile::TempDir;

use super::*;

const OBJ: &str = "# a tetrahedron in two groups, with texture and normal indices\nmtllib missing.mtl\nv 0 0 0\nv 1 0 0\n\
                   v 0 1 0\nv 0 0 1 # apex\nvn 0 0 1\ng base\nusemtl red\nf 1/1/1 3//1 2\ng sides\nf 1 2 4\nf 2 3 4\n\
                   f -2 1 4\n";
const OFF: &str =
    "OFF # header\n# comment\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1 255 0 0\n3 0 1 3\n3 1 2 3\n3 2 0 3\n";
const PLY: &str = "ply\nformat ascii 1.0\ncomment ours\nelement vertex 4\nproperty float x\nproperty double y\n\
                   property float z\nproperty uchar red\nelement face 4\nproperty list uchar int vertex_indices\n\
                   end_header\n0 0 0 9\n1E0 0 0 9\n0 1. 0 9\n0 0 +1 9\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n";
const STL: &str = "solid\nfacet normal 0 0 -1\n outer loop\n  vertex 0 0 0\n  vertex 0 1 0\n  vertex 1 0 0\n endloop\n\
                   endfacet\nfacet normal 0 -1 0\n outer loop\n  vertex -0 0 0\n  vertex 1 0 0\n  vertex 0 0 1\n endloop\n\
                   endfacet\nendsolid\nsolid second\nfacet normal 1 1 1\n outer loop\n  vertex 1 0 0\n  vertex 0 1 0\n\
                   vertex 0 0 1\n endloop\nendfacet\nfacet normal -1 0 0\n outer loop\n  vertex 0 1 0\n  vertex 0 0 0\n\
                   vertex 0 0 1\n endloop\nendfacet\nendsolid second\n";

fn parse(ending: &str, bytes: &[u8]) -> Result<PolygonSoup, ReadError> {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join(format!("solid.{ending}"));
    std::fs::write(&path, bytes).unwrap();
    read_surface(&path)
}

/// What the error says, without the folder.
fn refusal(ending: &str, text: &str) -> String {
    let message = parse(ending, text.as_bytes()).unwrap_err().to_string();
    message[message.find("solid.").unwrap_or(0)..].to_owned()
}

fn binary_stl(text: &str) -> Vec<u8> {
    let soup = parse("stl", text.as_bytes()).unwrap();
    let mut bytes = vec![b'x'; 80];
    bytes.extend((soup.polygons.len() as u32).to_le_bytes());
    for triangle in &soup.polygons {
        bytes.extend([0; 12]);
        for x in triangle.iter().flat_map(|v| soup.points[v.index()].iter().copied().collect::<Vec<_>>()) {
            bytes.extend((x as f32).to_le_bytes());
        }
        bytes.extend([0; 2]);
    }
    bytes
}

fn binary_ply() -> Vec<u8> {
    let mut bytes = b"ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty double x\nproperty double y\n\
                      property double z\nelement face 1\nproperty list uchar ushort vertex_index\nend_header\n"
        .to_vec();
    for x in [0.0f64, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0] {
        bytes.extend(x.to_be_bytes());
    }
    bytes.push(3);
    for index in [0u16, 1, 2] {
        bytes.extend(index.to_be_bytes());
    }
    bytes
}

#[test]
fn the_same_tetrahedron_from_every_format() {
    let expected = [[0., 0., 0.], [0., 1., 0.], [1., 0., 0.]].map(Vec3::from);
    for (ending, text) in [("obj", OBJ), ("OFF", OFF), ("ply", PLY), ("Stl", STL)] {
        let soup = parse(ending, text.as_bytes()).unwrap();
        assert_eq!((soup.points.len(), soup.polygons.len()), (4, 4), "{ending}");
        let first: Vec<Vec3> = soup.polygons[0].iter().map(|v| soup.points[v.index()]).collect();
        assert_eq!(first, expected, "{ending}");
    }
    let soup = parse("ply", &binary_ply()).unwrap();
    assert_eq!((soup.points[1], soup.polygons), (Vec3::x(), vec![vec![VertexId(0), VertexId(1), VertexId(2)]]));
}

#[test]
fn binary_stl_is_told_from_text_by_its_size() {
    let one_solid = &STL[..STL.find("solid second").unwrap()];
    let mut bytes = binary_stl(one_solid);
    assert_eq!(parse("stl", &bytes).unwrap().points.len(), 4);
    bytes[..6].copy_from_slice(b"solid ");
    assert_eq!(parse("stl", &bytes).unwrap().polygons.len(), 2);
    bytes.truncate(100);
    bytes[0] = b' ';
    assert!(matches!(parse("stl", &bytes), Err(ReadError::Truncated { .. })));
}

#[test]
fn polygons_stay_polygons() {
    let soup = parse("obj", b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nf 1 2 3 4\nf 1 2 5\n").unwrap();
    assert_eq!(soup.polygons.iter().map(Vec::len).collect::<Vec<_>>(), [4, 3]);
}

#[test]
fn files_that_cannot_be_opened() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| folder.path().join(name);
    assert!(matches!(read_surface(&at("none.obj")), Err(ReadError::Open { .. })));
    std::fs::create_dir(at("folder.obj")).unwrap();
    assert!(matches!(read_surface(&at("folder.obj")), Err(ReadError::Directory { .. })));
    for ending in ["obj", "off", "ply", "stl"] {
        assert!(matches!(parse(ending, b" \n"), Err(ReadError::Empty { .. })), "{ending}");
    }
    let unknown =
        "solid.step: unknown file ending \"step\" for a surface; surfaces are read from .obj, .off, .ply, .stl, .vtp, ";
    assert!(refusal("step", "x").starts_with(unknown));
}

#[test]
fn bad_obj_lines_are_named() {
    assert_eq!(
        refusal("obj", &OBJ.replace("f 1 2 4", "f 1 2 5")),
        "solid.obj:12: face 1 (counted from 0) names vertex 5, but the file has 4 vertices, numbered from 1; \
         correct it, or export the file again"
    );
    assert!(refusal("obj", &OBJ.replace("f -2", "f -9")).starts_with("solid.obj:14: face 3"));
    assert!(refusal("obj", &OBJ.replace("f -2", "f 0")).starts_with("solid.obj:14: face 3"));
    assert!(refusal("obj", &OBJ.replace("f -2", "f a")).starts_with("solid.obj:14: face 3"));
    assert!(refusal("obj", &OBJ.replace("usemtl", "material")).starts_with("solid.obj:9: `material` is no keyword"));
    assert!(refusal("obj", &OBJ.replace("v 0 1 0", "v 0 nan 0")).starts_with("solid.obj:5: vertex 2"));
    assert!(refusal("obj", &OBJ.replace("v 0 1 0", "v 0 1e999 0")).starts_with("solid.obj:5: vertex 2"));
    assert!(refusal("obj", &OBJ.replace("v 0 1 0", "v 0 1")).starts_with("solid.obj:5: vertex 2"));
    assert!(refusal("obj", "v 0 0 0\n").contains("no faces"));
}

#[test]
fn bad_off_lines_are_named() {
    assert!(refusal("off", &OFF.replace("4 4 6", "1000000000000000000 4 6")).starts_with("solid.off:3: 1000"));
    assert!(
        refusal("off", &OFF.replace("4 4 6", "4 1000000000000000000 6")).starts_with("solid.off:11: the file ends")
    );
    assert!(refusal("off", &OFF.replace("3 1 2 3", "3 1 2 4")).starts_with("solid.off:10: face 2"));
    assert!(refusal("off", &OFF.replace("3 1 2 3", "3 1 -2 3")).starts_with("solid.off:10: face 2"));
    assert!(refusal("off", &OFF.replace("3 1 2 3", "1000000000000000000 1 2 3")).starts_with("solid.off:10: face 2"));
    assert!(refusal("off", &OFF.replace("0 1 0", "0 inf 0")).starts_with("solid.off:6: vertex 2"));
    assert!(refusal("off", &OFF.replace("0 1 0", "0 1")).starts_with("solid.off:6: vertex 2"));
    assert!(refusal("off", "OFF\n").starts_with("solid.off:1: the file ends too early"));
}

#[test]
fn bad_ply_lines_are_named() {
    let huge = |count: &str| refusal("ply", &PLY.replace("vertex 4", &format!("vertex {count}")));
    // The face lines are then read as vertices, and used up.
    assert!(huge("1000000000000000000").starts_with("solid.ply:19: the file ends too early"));
    assert!(huge("99999999999999999999999").starts_with("solid.ply:4: absurd number"));
    assert!(
        refusal("ply", &PLY.replace("face 4", "face 1000000000000000000")).starts_with("solid.ply:19: the file ends")
    );
    let empty_element = PLY.replace("element face", "element nothing 1000000000000000000\nelement face");
    assert_eq!(parse("ply", empty_element.as_bytes()).unwrap().polygons.len(), 4);
    assert!(refusal("ply", &PLY.replace("3 1 2 3", "3 1 2 4")).starts_with("solid.ply:18: face 2"));
    assert!(refusal("ply", &PLY.replace("3 1 2 3", "9 1 2 3")).starts_with("solid.ply:18: face 2"));
    assert!(refusal("ply", &PLY.replace("0 1. 0", "0 nan 0")).starts_with("solid.ply:14: vertex 2"));
    assert!(refusal("ply", &PLY.replace("0 1. 0", "0 x 0")).starts_with("solid.ply:14: vertex 2"));
    assert!(refusal("ply", &PLY.replace("end_header", "")).contains("end_header"));
    let mut bytes = binary_ply();
    bytes.truncate(bytes.len() - 1);
    assert!(matches!(parse("ply", &bytes), Err(ReadError::Malformed { .. })));
    bytes.truncate(bytes.len() - 6);
    assert!(matches!(parse("ply", &bytes), Err(ReadError::Truncated { .. })));
}

#[test]
fn bad_stl_lines_are_named() {
    assert!(
        refusal("stl", &STL.replace("vertex 1 0 0\n  vertex 0 0 1", "vertex 1 nan 0\n  vertex 0 0 1"))
            .starts_with("solid.stl:9: triangle 1")
    );
    let cut = &STL[..STL.rfind("endfacet").unwrap()];
    assert!(refusal("stl", cut).starts_with("solid.stl:30: the file ends too early"));
    assert!(refusal("stl", &cut[..cut.rfind("endloop").unwrap()]).starts_with("solid.stl:29: the file ends too early"));
    assert!(refusal("stl", &STL.replace("vertex 0 1 0\n  vertex 1", "vortex 0 1 0\n  vertex 1")).contains("`vortex`"));
    assert!(refusal("stl", "hello").contains("binary header"));
}

fn check_never_panics(bytes: &[u8]) {
    let path = Path::new("random");
    let read = [obj::read(path, bytes), off::read(path, bytes), ply::read(path, bytes), stl::read(path, bytes.into())];
    for soup in read.into_iter().flatten() {
        let corners = || soup.polygons.iter().flatten();
        assert!(corners().all(|v| v.index() < soup.points.len()));
        assert!(corners().all(|v| soup.points[v.index()].iter().all(|x| x.is_finite())));
    }
}

proptest! {
    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        check_never_panics(&bytes);
        let after = |header: &str| [header.as_bytes(), &bytes].concat();
        check_never_panics(&after("solid x\n"));
        check_never_panics(&after(&PLY[..PLY.find("0 0 0 9").unwrap()]));
        check_never_panics(&after("OFF\n4 4 6\n"));
        check_never_panics(&[&binary_ply()[..160], &bytes[..]].concat());
    }

    #[test]
    fn mutated_files_never_panic(
        which in 0usize..6,
        places in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0u8..3), 1..8),
    ) {
        let files = [OBJ.as_bytes().to_vec(), OFF.into(), PLY.into(), STL.into(), binary_ply(), binary_stl(STL)];
        let mut bytes = files[which].clone();
        for (place, byte, how) in places {
            let place = place.index(bytes.len());
            match how {
                0 => bytes[place] = byte,
                1 => bytes.insert(place, b'0' + byte % 10),
                _ => { bytes.remove(place); }
            }
        }
        check_never_panics(&bytes);
    }
}

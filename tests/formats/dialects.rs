//! What people's files look like beside what the formats say: each kind with what is to be read of it, or the refusal.

use std::path::Path;

use qcball::mesh::io::{SolidFile, read_solid};
use qcball::mesh::{TetId, TetMesh, edge_matrix};
use qcball::solid::{RepairSettings, Surface};

/// The cube [0, 1]^3 but for its corner (0, 1, 1), which is (0, 1, 2): of its sides x = 0 and y = 1 stay flat and the top is
/// bent along a diagonal, a fold that the files have as two triangles. Volume 1 + 1/6.
const CORNERS: [[i32; 3]; 8] = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 2]];
const FACES: [&[usize]; 7] =
    [&[0, 3, 2, 1], &[4, 5, 6], &[4, 6, 7], &[0, 1, 5, 4], &[1, 2, 6, 5], &[2, 3, 7, 6], &[3, 0, 4, 7]];
const VOLUME: f64 = 7.0 / 6.0;

/// What a file holds: vertices and triangles of the surface, or vertices and tets, as they are used; the volume; a note.
enum Expected {
    Surface(usize, usize, f64, &'static str),
    Tets(usize, usize, f64, &'static str),
    Refused(&'static str),
}
use Expected::{Refused, Surface as IsSurface, Tets};

/// What is found, or how it differs.
fn found(path: &Path) -> Result<(bool, usize, usize, f64, Vec<String>), String> {
    Ok(match read_solid(path).map_err(|error| error.to_string())? {
        SolidFile::Surface(soup) => {
            let surface = Surface::repaired(soup, &RepairSettings::default()).map_err(|error| error.to_string())?;
            let (points, triangles) = (surface.points().len(), surface.triangles().len());
            (true, points, triangles, surface.volume(), surface.notes().to_vec())
        }
        SolidFile::Tets(soup) => {
            let soup = soup.tidied();
            let (mesh, exchanged) =
                TetMesh::from_either_orientation(soup.points, soup.tets).map_err(|error| error.to_string())?;
            assert_eq!(exchanged, 0);
            let volume = |tet| edge_matrix(mesh.corners(TetId(tet))).determinant() / 6.0;
            let volume = (0..mesh.tets().len() as u32).map(volume).sum();
            (false, mesh.points().len(), mesh.tets().len(), volume, soup.notes)
        }
    })
}

fn check(cases: &[(&str, Vec<u8>, Expected)]) {
    let folder = tempfile::tempdir().unwrap();
    let mut wrong = Vec::new();
    for (number, (name, bytes, expected)) in cases.iter().enumerate() {
        let path = folder.path().join(format!("{number}-{name}"));
        std::fs::write(&path, bytes).unwrap();
        let found = found(&path);
        let good = match (expected, &found) {
            (Refused(words), Err(message)) => message.contains(words) && message.contains(name),
            (&IsSurface(points, cells, volume, note), Ok(found)) | (&Tets(points, cells, volume, note), Ok(found)) => {
                let notes = found.4.join("\n");
                let noted = if note.is_empty() { notes.is_empty() } else { notes.contains(note) };
                let is_surface = matches!(expected, IsSurface(..));
                (found.0, found.1, found.2) == (is_surface, points, cells) && (found.3 - volume).abs() < 1e-12 && noted
            }
            _ => false,
        };
        if !good {
            wrong.push(format!("{number}-{name}: {found:?}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

fn solid(note: &'static str) -> Expected {
    IsSurface(8, 12, VOLUME, note)
}

/// The lines of vertices, `start x y z end`.
fn vertices(start: &str, end: &str) -> String {
    CORNERS.map(|[x, y, z]| format!("{start}{x} {y} {z}{end}\n")).concat()
}

/// The lines of faces: `start`, their size if that is wanted, the corners counted from `first`.
fn faces(start: &str, sized: bool, first: usize) -> String {
    let line = |face: &&[usize]| {
        let size = if sized { format!("{} ", face.len()) } else { String::new() };
        let corners: Vec<String> = face.iter().map(|corner| (corner + first).to_string()).collect();
        format!("{start}{size}{}\n", corners.join(" "))
    };
    FACES.iter().map(line).collect()
}

/// The triangles of the solid, each with its three corners.
fn triangles() -> Vec<[[i32; 3]; 3]> {
    let fan = |face: &&[usize]| {
        let corners: Vec<[i32; 3]> = face.iter().map(|&corner| CORNERS[corner]).collect();
        (1..corners.len() - 1).map(|i| [corners[0], corners[i], corners[i + 1]]).collect::<Vec<_>>()
    };
    FACES.iter().flat_map(fan).collect()
}

#[test]
fn obj() {
    let (v, f) = (vertices("v ", ""), faces("f ", false, 1));
    let whole = v.clone() + &f;
    let with = |more: &str| format!("{whole}{more}").into_bytes();
    let coloured: String =
        v.lines().enumerate().map(|(i, line)| format!("{line}{}\n", [" 1 0 0", ""][i % 2])).collect();
    let soup: String = triangles()
        .iter()
        .map(|corners| {
            let lines = corners.map(|[x, y, z]| format!("v {x} {y} {z}\n")).concat();
            lines + "f -3 -2 -1\n"
        })
        .collect();
    // A prism over a pentagram's outline, ten corners of radii 2 and 1: area 10 * 2 * 1 * sin 36 / 2.
    let star = |z: i32| -> String {
        let corner = |i: usize| {
            let (sin, cos) = (i as f64 * std::f64::consts::PI / 5.0).sin_cos();
            let radius = if i % 2 == 0 { 2.0 } else { 1.0 };
            format!("v {:.17} {:.17} {z}\n", radius * cos, radius * sin)
        };
        (0..10).map(corner).collect()
    };
    let numbers = |all: &mut dyn Iterator<Item = usize>| all.map(|i| format!(" {i}")).collect::<String>();
    let sides: String = (1..=10).map(|i| format!("f {i} {} {} {}\n", i % 10 + 1, i % 10 + 11, i + 10)).collect();
    let caps = format!("f{}\nf{}\n", numbers(&mut (1..=10).rev()), numbers(&mut (11..=20)));
    let prism = star(0) + &star(1) + &sides + &caps;
    let area = 10.0 * (std::f64::consts::PI / 5.0).sin();
    let bent = whole.replace("f 5 6 7\nf 5 7 8\n", "f 5 6 7 8\n");
    let wide: Vec<u8> = "\u{feff}".encode_utf16().chain(whole.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    check(&[
        ("mark.obj", format!("\u{feff}{v}v 3 3 3\n{f}").into_bytes(), solid("")),
        ("colours.obj", (coloured + &f).into(), solid("")),
        ("alpha.obj", (vertices("v ", " 0.5 0.2 1 1") + &f).into(), solid("")),
        ("weights.obj", (vertices("v ", " 1.0") + &f).into(), solid("")),
        ("continued.obj", whole.replace("f 1 4 3", "f 1 \\\n 4 \\\n3").into(), solid("")),
        ("returns.obj", whole.replace('\n', "\r").into(), solid("")),
        ("repeat.obj", with("f 1 1 2\n"), solid("1 polygons without area were dropped")),
        ("line.obj", with("f 1 2\n"), solid("1 polygons without area were dropped")),
        (
            "spike.obj",
            whole.replace("f 1 4 3", "f 1 4 4 3 7 3").into(),
            solid("1 polygons name a vertex several times"),
        ),
        ("latin.obj", [b"# Gr\xfc\xdfe\no K\xf6rper\n", whole.as_bytes()].concat(), solid("")),
        ("relative.obj", soup.into(), solid("")),
        ("fortran.obj", whole.replace("v 1 0 0", "v 1D+00 0 0").into(), solid("")),
        ("unused.obj", with("v nan nan -nan(ind)\n"), solid("")),
        ("star.obj", prism.into(), IsSurface(20, 36, area, "")),
        // The shorter diagonal of the top is the fold.
        ("bent.obj", bent.into(), IsSurface(8, 12, VOLUME, "1 polygons are not flat, by up to")),
        ("wide.obj", wide, Refused("UTF-16")),
        ("other.obj", with("garbage\n"), Refused("`garbage` is no keyword of an OBJ file")),
        ("materials.obj", with("newmtl red\nKd 1 0 0\n"), Refused("`Kd` is no keyword of an OBJ file")),
    ]);
}

#[test]
fn stl() {
    let facet = |[a, b, c]: [[i32; 3]; 3]| {
        let vertex = |[x, y, z]: [i32; 3]| format!("      vertex {x} {y} {z}\n");
        let corners = [a, b, c].map(vertex).concat();
        format!("  facet normal 0 0 1\n    outer loop\n{corners}    endloop\n  endfacet\n")
    };
    let body: String = triangles().into_iter().map(facet).collect();
    let text = format!("solid my facet\n{body}endsolid my facet\n");
    let flat = facet([[0, 0, 0], [0, 0, 0], [1, 0, 0]]);
    let binary = |header: &[u8], count: u32| {
        let mut bytes = header.to_vec();
        bytes.resize(80, b' ');
        bytes.extend(count.to_le_bytes());
        for triangle in triangles() {
            bytes.extend([0; 12]);
            bytes.extend(triangle.iter().flatten().flat_map(|&x| (x as f32).to_le_bytes()));
            bytes.extend([7, 7]);
        }
        bytes
    };
    let nan = |words: &str| text.replace("normal 0 0 1", words).into_bytes();
    check(&[
        ("plain.stl", text.clone().into(), solid("")),
        (
            "capitals.stl",
            text.replace("solid", "Solid").replace("facet", "FACET").replace("vertex", "Vertex").into(),
            solid(""),
        ),
        ("mark.stl", format!("\u{feff}{text}").into(), solid("")),
        ("blank.stl", format!("\n  \n {text}").into(), solid("")),
        ("open-end.stl", format!("solid\n{body}").into(), solid("no `endsolid` ends the file")),
        ("headless.stl", body.clone().into(), solid("no `endsolid` ends the file")),
        ("nan.stl", nan("normal nan nan nan"), solid("")),
        ("microsoft.stl", nan("normal -1.#IND 1.#QNAN 0"), solid("")),
        ("normals.stl", nan(""), solid("")),
        ("line.stl", text.replace('\n', " ").into(), solid("")),
        ("returns.stl", text.replace('\n', "\r").into(), solid("")),
        ("remark.stl", format!("{text}; exported by X\n\n\0\0").into(), solid("")),
        ("several.stl", text.replacen("  endfacet\n", "  endfacet\nendsolid a\nsolid b\n", 3).into(), solid("")),
        ("flat.stl", text.replacen("endsolid", &format!("{flat}endsolid"), 1).into(), solid("1 polygons without area")),
        ("cut.stl", text[..text.rfind("vertex").unwrap() + 10].into(), Refused("the file ends too early")),
        ("binary.stl", binary(b"x", 12), solid("")),
        ("solid.stl", binary(b"solid of mine", 12), solid("")),
        ("zero.stl", binary(b"x", 0), solid("the binary header promises 0 triangles, 12 are there")),
        ("minus-one.stl", binary(b"solid\0", u32::MAX), solid("12 are there and were read")),
        ("cut-binary.stl", binary(b"x", 12)[..500].into(), Refused("promises 12 triangles, 8 are there")),
    ]);
}

#[test]
fn off() {
    let (v, f) = (vertices("", ""), faces("", true, 0));
    let whole = |header: &str| format!("{header}{v}{f}").into_bytes();
    let seams: String = triangles().iter().flatten().map(|[x, y, z]| format!("{x} {y} {z}\n")).collect();
    let loose: String = (0..12).map(|i| format!("3 {} {} {}\n", 3 * i, 3 * i + 1, 3 * i + 2)).collect();
    let homogeneous: String = CORNERS.map(|p| format!("{} {} {} 2\n", 2 * p[0], 2 * p[1], 2 * p[2])).concat();
    let mut binary = b"OFF BINARY\n".to_vec();
    binary.extend([8u32, 7, 0].iter().flat_map(|count| count.to_be_bytes()));
    binary.extend(CORNERS.iter().flatten().flat_map(|&x| (x as f32).to_be_bytes()));
    for face in FACES {
        binary.extend((face.len() as u32).to_be_bytes());
        binary.extend(face.iter().flat_map(|&corner| (corner as u32).to_be_bytes()));
        // A colour of one number.
        binary.extend([1u32, 3].iter().flat_map(|word| word.to_be_bytes()));
    }
    check(&[
        ("plain.off", whole("OFF\n8 7 0\n"), solid("")),
        ("mark.off", whole("\u{feff}OFF\n8 7 0\n"), solid("")),
        ("lower.off", whole("off\n8 7 0\n"), solid("")),
        ("joined.off", whole("OFF8 7 0\n"), solid("")),
        ("one-line.off", whole("OFF 8 7 0\n"), solid("")),
        ("bare.off", whole("8 7 0\n"), solid("")),
        ("textures.off", format!("STOFF\n8 7 0\n{}{f}", vertices("", " 0.5 0.5")).into(), solid("")),
        ("colours.off", format!("CNOFF\n8 7 0\n{}{f}", vertices("", " 0 0 1 9 9 9 9")).into(), solid("")),
        ("homogeneous.off", format!("4OFF\n8 7 0\n{homogeneous}{f}").into(), solid("")),
        ("returns.off", format!("OFF\n8 7 0\n{v}{f}").replace('\n', "\r").into(), solid("")),
        ("split.off", format!("OFF\n8 7 0\n{v}{}", f.replace(" 3 2 1", " 3\n2\n 1 255 0 0")).into(), solid("")),
        ("seams.off", format!("OFF\n36 12 0\n{seams}{loose}").into(), solid("28 vertices became one with another")),
        ("unused.off", format!("OFF\n9 7 0\n{v}nan 0 0\n{f}").into(), solid("")),
        ("binary.off", binary.clone(), solid("")),
        ("cut.off", binary[..200].into(), Refused("the file ends too early")),
        ("four.off", whole("4nOFF\n8 7 0\n"), Refused("expected `OFF`")),
    ]);
}

#[test]
fn ply() {
    let (v, f) = (vertices("", ""), faces("", true, 0));
    let header = |more: &str, vertices: usize, faces: usize| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n{more}\
             element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    let with = |kind: &str, value: &str| {
        format!("{}{}{f}", header(&format!("property {kind} more\n"), 8, 7), vertices("", &format!(" {value}")))
            .into_bytes()
    };
    let latin = header("comment Gr~~e\n", 8, 7) + &v + &f;
    let latin = latin.bytes().map(|byte| if byte == b'~' { 0xfc } else { byte }).collect();
    // Five of the sides as faces; the other two, 1 2 6 5 and 2 3 7 6, as strips.
    let strips = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\nelement face 5\n\
                  property list int int other\nproperty list uchar int vertex_indices\nelement tristrips 1\n\
                  property list int int vertex_indices\nend_header\n";
    let some: String = [0, 1, 2, 3, 6]
        .map(|i| {
            let face = FACES[i];
            let corners: Vec<String> = face.iter().map(usize::to_string).collect();
            format!("2 7 7 {} {}\n", face.len(), corners.join(" "))
        })
        .concat();
    let strip = "9 5 1 6 2 -1 6 2 7 3\n";
    let mut binary =
        b"ply\r\nformat binary_little_endian 1.0\r\nelement vertex 8\r\nproperty list uchar float weights\r\n\
                       property double x\r\nproperty double y\r\nproperty double z\r\nelement face 7\r\n\
                       property uchar flag\r\nproperty list uint ushort vertex_index\r\nend_header\r\n"
            .to_vec();
    for corner in CORNERS {
        binary.push(2);
        binary.extend([f32::NAN, 1.0].iter().flat_map(|x| x.to_le_bytes()));
        binary.extend(corner.iter().flat_map(|&x| f64::from(x).to_le_bytes()));
    }
    for face in FACES {
        binary.push(9);
        binary.extend((face.len() as u32).to_le_bytes());
        binary.extend(face.iter().flat_map(|&corner| (corner as u16).to_le_bytes()));
    }
    check(&[
        ("plain.ply", (header("", 8, 7) + &v + &f).into(), solid("")),
        ("mark.ply", ("\u{feff}".to_owned() + &header("", 8, 7) + &v + &f).into(), solid("")),
        ("returns.ply", (header("", 8, 7) + &v + &f).replace('\n', "\r").into(), solid("")),
        ("infinite.ply", with("float", "inf"), solid("")),
        ("microsoft.ply", with("float", "-nan(ind)"), solid("")),
        ("real.ply", with("uchar", "255.0"), solid("")),
        ("list.ply", with("list uchar float", "3 1 nan 2"), solid("")),
        ("latin.ply", latin, solid("")),
        ("line.ply", (header("", 8, 8) + &v + &f + "2 0 1\n").into(), solid("1 polygons without area")),
        ("unused.ply", (header("", 9, 7) + &v + "nan nan nan\n" + &f).into(), solid("")),
        ("strips.ply", format!("{strips}{v}{some}{strip}").into(), solid("")),
        ("binary.ply", binary.clone(), solid("")),
        ("cut.ply", binary[..binary.len() - 3].into(), Refused("face 6 (counted from 0)")),
    ]);
}

/// A cube of volume 1 as 12 tets about its centre, number 8, in the lines of a format.
fn about_centre(first: usize) -> (Vec<[f64; 3]>, Vec<[usize; 4]>) {
    let mut points: Vec<[f64; 3]> = CORNERS.map(|[x, y, z]| [x, y, z.min(1)].map(f64::from)).into();
    points.push([0.5; 3]);
    let faces: [[usize; 4]; 6] = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];
    let tets = faces.iter().flat_map(|&[a, b, c, d]| [[a, c, b, 8], [a, d, c, 8]]).map(|tet| tet.map(|v| v + first));
    (points, tets.collect())
}

fn lines<T: ToString, const N: usize>(rows: &[[T; N]], start: &str, end: &str) -> String {
    let row = |row: &[T; N]| row.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ");
    rows.iter().map(|entries| format!("{start}{}{end}\n", row(entries))).collect()
}

fn cube(note: &'static str) -> Expected {
    Tets(9, 12, 1.0, note)
}

#[test]
fn medit() {
    let (points, tets) = about_centre(1);
    let (v, t) = (lines(&points, "", " 0"), lines(&tets, "", " 1"));
    let file = |v: &str, count: usize, cells: &str| {
        format!("MeshVersionFormatted 2\nDimension 3\nVertices {count}\n{v}{cells}End\n").into_bytes()
    };
    let whole = |v: &str, t: &str| file(v, 9, &format!("Tetrahedra 12\n{t}"));
    let bare = whole(&lines(&points, "", ""), &lines(&tets, "", ""));
    let hexahedron = "Hexahedra 1\n1 2 3 4 5 6 7 8 0\n";
    let second = format!("TetrahedraP2 12\n{}", lines(&tets, "", " 10 10 10 10 10 10 1"));
    let quads =
        "Quadrilaterals 5\n5 6 7 8 0\n1 2 6 5 0\n2 3 7 6 0\n3 4 8 7 0\n4 1 5 8 0\nTriangles 2\n1 4 3 0\n1 3 2 0\n";
    let binary = |version: u32, big: bool| {
        let mut bytes = Vec::new();
        let long = |bytes: &mut Vec<u8>, value: u64, size: usize| {
            let all = value.to_be_bytes();
            let mut some = all[8 - size..].to_vec();
            if !big {
                some.reverse();
            }
            bytes.extend(some);
        };
        let (place, index) = (if version > 2 { 8 } else { 4 }, if version > 3 { 8 } else { 4 });
        let real = |bytes: &mut Vec<u8>, x: f64| match version {
            1 => long(bytes, u64::from((x as f32).to_bits()), 4),
            _ => long(bytes, x.to_bits(), 8),
        };
        long(&mut bytes, 1, 4);
        long(&mut bytes, version.into(), 4);
        let mut section = |number: u64, body: Vec<u8>| {
            long(&mut bytes, number, 4);
            let next = bytes.len() + place + body.len();
            long(&mut bytes, next as u64, place);
            bytes.extend(body);
        };
        let mut body = Vec::new();
        long(&mut body, 3, 4);
        section(3, std::mem::take(&mut body));
        long(&mut body, 9, index);
        for point in &points {
            point.iter().for_each(|&x| real(&mut body, x));
            long(&mut body, 0, index);
        }
        section(4, std::mem::take(&mut body));
        long(&mut body, 12, index);
        for tet in &tets {
            tet.iter().for_each(|&v| long(&mut body, v as u64, index));
            long(&mut body, 1, index);
        }
        section(8, body);
        long(&mut bytes, 54, 4);
        long(&mut bytes, 0, place);
        bytes
    };
    check(&[
        ("plain.mesh", whole(&v, &t), cube("")),
        ("mark.mesh", [b"\xEF\xBB\xBF".to_vec(), whole(&v, &t)].concat(), cube("")),
        ("bare.mesh", bare, cube("")),
        ("fortran.mesh", whole(&v.replace("0.5", "5.0D-01"), &t), cube("")),
        (
            "unused.mesh",
            file(&format!("{v}nan nan nan 0\n"), 10, &format!("Tetrahedra 12\n{t}")),
            cube("1 vertices that"),
        ),
        ("second.mesh", file(&format!("{v}7 7 7 0\n"), 10, &second), cube("12 tets of second or higher order")),
        ("hexahedron.mesh", file(&v, 9, hexahedron), Tets(8, 6, 1.0, "1 hexahedra were split")),
        ("surface.mesh", file(&v, 9, quads), IsSurface(8, 12, 1.0, "")),
        ("first.meshb", binary(1, false), cube("")),
        ("second.mesh", binary(2, false), cube("")),
        ("third.meshb", binary(3, true), cube("")),
        ("fourth.meshb", binary(4, false), cube("")),
        ("cut.meshb", binary(2, false)[..200].into(), Refused("beyond the end")),
        ("wedges.mesh", file(&v, 9, "Wedges 1\n1 2 3 4 5 6 0\n"), Refused("`1` Wedges; split them")),
    ]);
}

#[test]
fn gmsh() {
    let (points, tets) = about_centre(1);
    let numbered = |rows: Vec<String>| -> String {
        rows.into_iter().zip(1..).map(|(row, number)| format!("{number} {row}\n")).collect()
    };
    let row = |point: &[f64; 3]| format!("{} {} {}", point[0], point[1], point[2]);
    let nodes = numbered(points.iter().map(row).collect());
    let parametric = numbered(points.iter().map(|point| row(point) + " 2 5 0.1 0.2").collect());
    let elements =
        |between: &str| numbered(tets.iter().map(|[a, b, c, d]| format!("{between}{a} {b} {c} {d}")).collect());
    let first = format!("$NOD\n9\n{nodes}$ENDNOD\n$ELM\n12\n{}$ENDELM\n", elements("4 0 1 4 "));
    let second = |nodes: &str, count: usize, elements: &str, number: usize| {
        format!(
            "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{count}\n{nodes}$EndNodes\n$Elements\n{number}\n{elements}$EndElements\n"
        )
    };
    let fourth = |text: bool| {
        let mut bytes = format!("$MeshFormat\n4 {} 8\n", u8::from(!text)).into_bytes();
        if text {
            let blocks = format!(
                "2 9\n1 2 1 4\n{}",
                parametric.lines().take(4).map(|line| line.replace(" 2 5", "") + "\n").collect::<String>()
            );
            let rest: String = nodes.lines().skip(4).map(|line| line.to_owned() + "\n").collect();
            bytes.extend(
                format!(
                    "$EndMeshFormat\n$Nodes\n{blocks}1 3 0 5\n{rest}$EndNodes\n$Elements\n1 12\n1 3 4 12\n{}$EndElements\n",
                    elements("")
                )
                .bytes(),
            );
            return bytes;
        }
        let int =
            |bytes: &mut Vec<u8>, values: &[u32]| values.iter().for_each(|value| bytes.extend(value.to_le_bytes()));
        let long =
            |bytes: &mut Vec<u8>, values: &[u64]| values.iter().for_each(|value| bytes.extend(value.to_le_bytes()));
        int(&mut bytes, &[1]);
        bytes.extend(b"\n$EndMeshFormat\n$Nodes\n");
        long(&mut bytes, &[1, 9]);
        int(&mut bytes, &[1, 3, 0]);
        long(&mut bytes, &[9]);
        for (tag, point) in (1..).zip(&points) {
            int(&mut bytes, &[tag]);
            point.iter().for_each(|x| bytes.extend(x.to_le_bytes()));
        }
        bytes.extend(b"\n$EndNodes\n$Elements\n");
        long(&mut bytes, &[1, 12]);
        int(&mut bytes, &[1, 3, 4]);
        long(&mut bytes, &[12]);
        for (tag, tet) in (1..).zip(&tets) {
            int(&mut bytes, &[tag]);
            int(&mut bytes, &tet.map(|v| v as u32));
        }
        bytes.extend(b"\n$EndElements\n");
        bytes
    };
    let twice = elements("4 2 1 1 ")
        + &tets
            .iter()
            .zip(13..)
            .map(|([a, b, c, d], tag)| format!("{tag} 4 2 2 1 {a} {b} {c} {d}\n"))
            .collect::<String>();
    let quads = "1 3 2 1 1 5 6 7 8\n2 3 2 1 1 1 2 6 5\n3 3 2 1 1 2 3 7 6\n4 3 2 1 1 3 4 8 7\n5 3 2 1 1 4 1 5 8\n6 2 2 1 1 1 4 3\n\
                 7 2 2 1 1 1 3 2\n";
    let curved = numbered(tets.iter().map(|[a, b, c, d]| format!("11 2 1 1 {a} {b} {c} {d} 9 9 9 9 9 9")).collect());
    check(&[
        ("first.msh", first.into(), cube("")),
        ("second.msh", second(&nodes, 9, &elements("4 2 1 1 "), 12).into(), cube("")),
        (
            "parameters.msh",
            second(&parametric, 9, &elements("4 2 1 1 "), 12).replace("Nodes", "ParametricNodes").into(),
            cube(""),
        ),
        ("fourth.msh", fourth(true), cube("")),
        ("fourth-binary.msh", fourth(false), cube("")),
        ("groups.msh", second(&nodes, 9, &twice, 24).into(), cube("12 tets that repeat the vertices of another one")),
        (
            "centre.msh",
            second(&format!("{nodes}10 0 0 7\n"), 10, &elements("4 2 1 1 "), 12).into(),
            cube("1 vertices that"),
        ),
        ("curved.msh", second(&nodes, 9, &curved, 12).into(), cube("12 tets of second or higher order")),
        (
            "hexahedron.msh",
            second(&nodes, 9, "1 5 2 1 1 1 2 3 4 5 6 7 8\n", 1).into(),
            Tets(8, 6, 1.0, "1 hexahedra were split"),
        ),
        ("surface.msh", second(&nodes, 9, quads, 7).into(), IsSurface(8, 12, 1.0, "")),
        ("fifth.msh", b"$MeshFormat\n5 0 8\n$EndMeshFormat\n".to_vec(), Refused("version `5` of .msh is not read")),
    ]);
}

#[test]
fn vtk() {
    let (points, tets) = about_centre(0);
    let legacy = |kind: &str, body: &str| {
        format!(
            "# vtk DataFile Version 3.0\nt\nASCII\nDATASET {kind}\nPOINTS 9 double\n{}{body}",
            lines(&points, "", "")
        )
        .into_bytes()
    };
    let types = |kind: &str, count: usize| format!("CELL_TYPES {count}\n{}", format!("{kind}\n").repeat(count));
    let grid = format!("CELLS 12 60\n{}{}", lines(&tets, "4 ", ""), types("10", 12));
    let texts = "CELL_DATA 12\nFIELD f 2\nnames 1 12 string\na%20b\n\nc\nd\ne\nf\ng\nh\ni\nj\nk\nl\nflags 1 12 bit\n\
                 0 1 0 1 0 1 0 1 0 1 0 1\n";
    let voxel = format!("CELLS 1 9\n8 0 1 3 2 4 5 7 6\n{}", types("11", 1));
    let both =
        format!("CELLS 2 12\n6 0 1 3 4 5 7\n6 1 2 3 5 6 7\n{}", types("13", 2)).replace("CELLS 2 12", "CELLS 2 14");
    let pyramids: String =
        ["0 1 2 3", "5 4 7 6", "1 0 4 5", "2 1 5 6", "3 2 6 7", "0 3 7 4"].map(|base| format!("5 {base} 8\n")).concat();
    let pyramids = format!("CELLS 6 36\n{pyramids}{}", types("14", 6));
    let polygons = "POLYGONS 4 20\n4 0 3 2 1\n4 4 5 6 7\n4 0 1 5 4\n4 3 0 4 7\nTRIANGLE_STRIPS 1 7\n6 5 1 6 2 7 3\nLINES 1 3\n2 0 1\n";
    let mut binary =
        b"# vtk DataFile Version 5.1\nt\nBINARY\nDATASET UNSTRUCTURED_GRID\nFIELD f 2\nwords 1 2 string\n\xC5hello\xC0\
                       bits 1 9 bit\n\xFF\x80\nPOINTS 9 double\n"
            .to_vec();
    binary.extend(points.iter().flatten().flat_map(|x| x.to_be_bytes()));
    binary.extend(b"\nCELLS 13 48\nOFFSETS vtktypeint64\n");
    binary.extend((0..13i64).flat_map(|i| (4 * i).to_be_bytes()));
    binary.extend(b"\nCONNECTIVITY vtktypeint64\n");
    binary.extend(tets.iter().flatten().flat_map(|&v| (v as i64).to_be_bytes()));
    binary.extend(b"\nCELL_TYPES 12\n");
    binary.extend([10i32; 12].iter().flat_map(|kind| kind.to_be_bytes()));
    check(&[
        ("texts.vtk", legacy("UNSTRUCTURED_GRID", &(grid + texts)), cube("")),
        ("binary.vtk", binary, cube("")),
        ("voxel.vtk", legacy("UNSTRUCTURED_GRID", &voxel), Tets(8, 6, 1.0, "1 hexahedra were split")),
        ("prisms.vtk", legacy("UNSTRUCTURED_GRID", &both), Tets(8, 6, 1.0, "2 prisms were split")),
        ("pyramids.vtk", legacy("UNSTRUCTURED_GRID", &pyramids), cube("6 pyramids were split")),
        ("polygons.vtk", legacy("POLYDATA", polygons), IsSurface(8, 12, 1.0, "")),
        ("grid.vtk", legacy("STRUCTURED_GRID", ""), Refused("neither an UNSTRUCTURED_GRID nor POLYDATA")),
        (
            "polyhedron.vtk",
            legacy("UNSTRUCTURED_GRID", &format!("CELLS 1 2\n1 0\n{}", types("42", 1))),
            Refused("a polyhedron"),
        ),
    ]);
}

#[test]
fn vtk_in_xml() {
    let (points, tets) = about_centre(0);
    let array = |name: &str, kind: &str, components: usize, text: String| {
        format!(
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"ascii\">{text}</DataArray>"
        )
    };
    let cells = |cells: &[&[usize]], kind: Option<usize>| {
        let mut end = 0;
        let ends: Vec<String> = cells
            .iter()
            .map(|cell| {
                end += cell.len();
                end.to_string()
            })
            .collect();
        let corners: Vec<String> = cells.iter().flat_map(|cell| cell.iter().map(usize::to_string)).collect();
        let kinds =
            kind.map_or_else(String::new, |kind| array("types", "UInt8", 1, format!("{kind} ").repeat(cells.len())));
        array("connectivity", "Int64", 1, corners.join(" ")) + &array("offsets", "Int64", 1, ends.join(" ")) + &kinds
    };
    let piece = |points: &[[f64; 3]], tets: &[[usize; 4]]| {
        let rows: Vec<&[usize]> = tets.iter().map(<[usize; 4]>::as_slice).collect();
        format!(
            "<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\"><Points>{}</Points><Cells>{}</Cells></Piece>\n",
            points.len(),
            tets.len(),
            array("Points", "Float64", 3, lines(points, "", "")),
            cells(&rows, Some(10)),
        )
    };
    let file = |kind: &str, body: &str| {
        format!("<VTKFile type=\"{kind}\" byte_order=\"LittleEndian\">\n<{kind}>{body}</{kind}>\n</VTKFile>\n")
    };
    let empty = "<Piece NumberOfPoints=\"0\" NumberOfCells=\"0\"></Piece>";
    // The tets of every second side in a piece of their own, with the vertices of its own.
    let halves = [0, 1].map(|half| {
        let own: Vec<[usize; 4]> = tets.chunks(2).skip(half).step_by(2).flatten().copied().collect();
        piece(&points, &own)
    });
    let polygons: [&[usize]; 6] =
        [&[0, 3, 2, 1], &[4, 5, 6, 7], &[0, 1, 5, 4], &[1, 2, 6, 5], &[2, 3, 7, 6], &[3, 0, 4, 7]];
    let surface = format!(
        "<Piece NumberOfPoints=\"9\" NumberOfPolys=\"6\"><Points>{}</Points><Polys>{}</Polys></Piece>",
        array("Points", "Float64", 3, lines(&points, "", "")),
        cells(&polygons, None),
    );
    let quads = format!(
        "<Piece NumberOfPoints=\"9\" NumberOfCells=\"6\"><Points>{}</Points><Cells>{}</Cells></Piece>",
        array("Points", "Float64", 3, lines(&points, "", "")),
        cells(&polygons, Some(9)),
    );
    // A bare block of LZ4 may be nothing but literals: their number (15, then bytes that are added), and they.
    let literals = |bytes: &[u8]| {
        let mut block = vec![0xF0];
        let mut rest = bytes.len() - 15;
        while rest >= 255 {
            block.push(255);
            rest -= 255;
        }
        block.push(rest as u8);
        [block, bytes.to_vec()].concat()
    };
    let packed = |bytes: Vec<u8>| {
        use base64::Engine;
        let engine = base64::engine::general_purpose::STANDARD;
        let block = literals(&bytes);
        let head: Vec<u8> =
            [1, bytes.len() as u32, 0, block.len() as u32].iter().flat_map(|size| size.to_le_bytes()).collect();
        engine.encode(head) + &engine.encode(block)
    };
    let bytes_of = |numbers: Vec<i64>| numbers.into_iter().flat_map(i64::to_le_bytes).collect::<Vec<u8>>();
    let binary = |name: &str, kind: &str, components: usize, bytes: Vec<u8>| {
        array(name, kind, components, packed(bytes)).replace("ascii", "binary")
    };
    let lz4 = format!(
        "<Piece NumberOfPoints=\"9\" NumberOfCells=\"12\"><Points>{}</Points><Cells>{}{}{}</Cells></Piece>",
        binary("Points", "Float64", 3, points.iter().flatten().flat_map(|x| x.to_le_bytes()).collect()),
        binary("connectivity", "Int64", 1, bytes_of(tets.iter().flatten().map(|&v| v as i64).collect())),
        binary("offsets", "Int64", 1, bytes_of((1..=12).map(|i| 4 * i).collect())),
        binary("types", "Int64", 1, bytes_of(vec![10; 12])),
    );
    let lz4 = file("UnstructuredGrid", &lz4).replace("<VTKFile", "<VTKFile compressor=\"vtkLZ4DataCompressor\"");
    check(&[
        ("plain.vtu", file("UnstructuredGrid", &piece(&points, &tets)).into(), cube("")),
        ("mark.vtu", ("\u{feff}".to_owned() + &file("UnstructuredGrid", &piece(&points, &tets))).into(), cube("")),
        ("empty.vtu", file("UnstructuredGrid", &(empty.to_owned() + &piece(&points, &tets) + empty)).into(), cube("")),
        ("pieces.vtu", file("UnstructuredGrid", &halves.concat()).into(), cube("")),
        ("polygons.vtp", file("PolyData", &surface).into(), IsSurface(8, 12, 1.0, "")),
        ("quads.vtu", file("UnstructuredGrid", &quads).into(), IsSurface(8, 12, 1.0, "")),
        ("lz4.vtu", lz4.clone().into(), cube("")),
        ("cut.vtu", lz4.replace("NumberOfPoints=\"9\"", "NumberOfPoints=\"8\"").into(), Refused("192 are needed")),
        ("image.vtu", file("ImageData", "").into(), Refused("neither an UnstructuredGrid nor PolyData")),
        (
            "nothing.pvtu",
            file("PUnstructuredGrid", "<Piece Source=\"none.vtu\"/>").into(),
            Refused("\"none.vtu\" is no file"),
        ),
    ]);

    let folder = tempfile::tempdir().unwrap();
    for (name, half) in ["a.vtu", "b.vtu"].iter().zip(&halves) {
        std::fs::write(folder.path().join(name), file("UnstructuredGrid", half)).unwrap();
    }
    let whole = folder.path().join("whole.pvtu");
    std::fs::write(&whole, file("PUnstructuredGrid", "<Piece Source=\"a.vtu\"/><Piece Source=\"b.vtu\"/>")).unwrap();
    let (is_surface, vertices, cells, volume, notes) = found(&whole).unwrap();
    assert_eq!((is_surface, vertices, cells, notes), (false, 9, 12, vec![]));
    assert!((volume - 1.0).abs() < 1e-12);
}

#[test]
fn tetgen_in_capitals() {
    let (points, tets) = about_centre(1);
    let folder = tempfile::tempdir().unwrap();
    let numbered =
        |text: String| -> String { text.lines().zip(1..).map(|(line, i)| format!("{i} {line}\n")).collect() };
    let put = |name: &str, text: String| std::fs::write(folder.path().join(name), text).unwrap();
    put("A.NODE", format!("\u{feff}9 3 0 0\n{}", numbered(lines(&points, "", ""))));
    put("A.ELE", format!("12 10 0\n{}", numbered(lines(&tets, "", " 9 9 9 9 9 9"))));
    for name in ["A.NODE", "A.ELE"] {
        let (is_surface, vertices, cells, volume, notes) = found(&folder.path().join(name)).unwrap();
        assert_eq!((is_surface, vertices, cells), (false, 9, 12));
        assert!((volume - 1.0).abs() < 1e-12 && notes.len() == 1, "{notes:?}");
    }
}

#[test]
fn repairs_on_request() {
    let soup = |text: &str| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.obj");
        std::fs::write(&path, text).unwrap();
        match read_solid(&path).unwrap() {
            SolidFile::Surface(soup) => soup,
            SolidFile::Tets(_) => unreachable!("an OBJ holds no tets"),
        }
    };
    let (v, f) = (vertices("v ", ""), faces("f ", false, 1));
    let none = RepairSettings::default();
    // Each triangle with corners of its own, moved by up to 1e-8.
    let apart: String = triangles()
        .iter()
        .enumerate()
        .map(|(i, corners)| {
            let moved = corners.map(|[x, y, z]| format!("v {} {y} {z}\n", f64::from(x) + 1e-9 * i as f64)).concat();
            moved + "f -3 -2 -1\n"
        })
        .collect();
    assert!(Surface::repaired(soup(&apart), &none).is_err());
    let welded = Surface::repaired(soup(&apart), &RepairSettings { weld: Some(1e-7), ..none }).unwrap();
    assert_eq!((welded.points().len(), welded.triangles().len()), (8, 12));
    assert!(
        (welded.volume() - VOLUME).abs() < 1e-7 && welded.notes()[0].contains("became one"),
        "{:?}",
        welded.notes()
    );

    // A hole of two triangles, and one that the shared corners would close over a bent rim.
    let open = v.clone() + &f.replace("f 2 3 7 6\n", "");
    assert!(Surface::repaired(soup(&open), &none).unwrap_err().to_string().contains("not closed: 4 edges"));
    let filled = Surface::repaired(soup(&open), &RepairSettings { fill_holes: true, ..none }).unwrap();
    assert!((filled.volume() - VOLUME).abs() < 1e-12);
    assert!(filled.notes()[0].starts_with("1 flat holes were filled, the largest "), "{:?}", filled.notes());
    let bent = v.clone() + &f.replace("f 5 6 7\nf 5 7 8\n", "");
    assert!(Surface::repaired(soup(&bent), &RepairSettings { fill_holes: true, ..none }).is_err());

    // A lone triangle beside the solid.
    let two = v + "v 5 5 5\nv 6 5 5\nv 5 6 5\n" + &f + "f 9 10 11\n";
    assert!(Surface::repaired(soup(&two), &none).is_err());
    let largest = Surface::repaired(soup(&two), &RepairSettings { keep_largest: true, ..none }).unwrap();
    assert_eq!((largest.points().len(), largest.triangles().len()), (8, 12));
    assert_eq!(largest.notes(), ["of 2 pieces the largest was kept; 1 triangles of the others were dropped"]);
}

//! OBJ, STL, OFF and PLY.

use super::{CORNERS, Cases, FACES, IsSurface, Refused, VOLUME, faces, solid, triangles, vertices};

pub(super) fn all() -> Cases {
    [obj(), stl(), off(), ply()].into_iter().flatten().collect()
}

fn obj() -> Cases {
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
            let radius = if i.is_multiple_of(2) { 2.0 } else { 1.0 };
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
    vec![
        ("mark.obj", format!("\u{feff}{v}v 3 3 3\n{f}").into_bytes(), solid("")),
        ("colours.obj", (coloured + &f).into(), solid("")),
        ("alpha.obj", (vertices("v ", " 0.5 0.2 1 1") + &f).into(), solid("")),
        ("weights.obj", (vertices("v ", " 1.0") + &f).into(), solid("")),
        ("continued.obj", whole.replace("f 1 4 3", "f 1 \\\n 4 \\\n3").into(), solid("")),
        ("returns.obj", whole.replace('\n', "\r").into(), solid("")),
        ("repeat.obj", with("f 1 1 2\n"), solid("1 polygons without area were dropped")),
        ("line.obj", with("f 1 2\n"), solid("1 polygons without area were dropped")),
        ("bare.obj", with("f\n"), solid("")),
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
    ]
}

fn stl() -> Cases {
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
    vec![
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
    ]
}

fn off() -> Cases {
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
    vec![
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
    ]
}

fn ply() -> Cases {
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
    vec![
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
    ]
}

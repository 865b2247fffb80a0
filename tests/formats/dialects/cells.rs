//! Medit, Gmsh, VTK and TetGen.

use super::{CORNERS, Cases, Expected, IsSurface, Refused, Tets, found};

pub(super) fn all() -> Cases {
    [medit(), gmsh(), vtk(), vtk_in_xml()].into_iter().flatten().collect()
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

fn medit() -> Cases {
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
    vec![
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
    ]
}

fn gmsh() -> Cases {
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
    vec![
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
    ]
}

fn vtk() -> Cases {
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
    vec![
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
    ]
}

fn vtk_in_xml() -> Cases {
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
    vec![
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
    ]
}

#[test]
fn pieces_in_files_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes, _) in vtk_in_xml() {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    let whole = folder.path().join("whole.pvtu");
    let names = "<Piece Source=\"pieces.vtu\"/><Piece Source=\"quads.vtu\"/>";
    let text = format!("<VTKFile type=\"PUnstructuredGrid\"><PUnstructuredGrid>{names}</PUnstructuredGrid></VTKFile>");
    std::fs::write(&whole, text).unwrap();
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

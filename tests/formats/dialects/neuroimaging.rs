//! GIFTI and FreeSurfer's triangles.

use std::io::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};

use super::{CORNERS, Cases, FACES, Refused, solid};

pub(super) fn all() -> Cases {
    [gifti(), freesurfer()].into_iter().flatten().collect()
}

/// The triangles of the solid as numbers of its corners.
fn corners() -> Vec<[usize; 3]> {
    FACES.iter().flat_map(|face| (1..face.len() - 1).map(|i| [face[0], face[i], face[i + 1]])).collect()
}

/// A `DataArray` of three numbers a row.
fn array(intent: &str, kind: &str, rows: usize, more: &str, data: &str) -> String {
    format!(
        "<DataArray Intent=\"NIFTI_INTENT_{intent}\" DataType=\"NIFTI_TYPE_{kind}\" Dimensionality=\"2\" Dim0=\"{rows}\" Dim1=\"3\" \
         {more}>\n<MetaData><MD><Name><![CDATA[Name]]></Name><Value><![CDATA[a < b]]></Value></MD></MetaData>\n\
         <Data>{data}</Data>\n</DataArray>\n"
    )
}

fn file(arrays: &[String]) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<!DOCTYPE GIFTI SYSTEM \"http://gifti.projects.nitrc.org/gifti.dtd\">\n\
         <GIFTI Version=\"1.0\" NumberOfDataArrays=\"{}\">\n<MetaData/>\n<LabelTable/>\n{}</GIFTI>\n",
        arrays.len(),
        arrays.concat()
    )
}

fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn gifti() -> Cases {
    let (points, triangles) = (CORNERS, corners());
    let count = triangles.len();
    let text = "ArrayIndexingOrder=\"RowMajorOrder\" Encoding=\"ASCII\" Endian=\"LittleEndian\"";
    let rows = |rows: &mut dyn Iterator<Item = [String; 3]>| rows.map(|row| row.join(" ") + "\n").collect::<String>();
    let coordinates = rows(&mut points.iter().map(|p| p.map(|x| x.to_string())));
    let numbers = rows(&mut triangles.iter().map(|t| t.map(|v| v.to_string())));
    let point_array = array("POINTSET", "FLOAT32", 8, text, &coordinates);
    let triangle_array = array("TRIANGLE", "INT32", count, text, &numbers);
    let plain = file(&[point_array.clone(), triangle_array.clone()]);

    let little = |numbers: &[i32]| numbers.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let numbers: Vec<i32> = triangles.iter().flatten().map(|&v| v as i32).collect();
    let binary = "Encoding=\"Base64Binary\" Endian=\"LittleEndian\"";
    let packed = "Encoding=\"GZipBase64Binary\" Endian=\"LittleEndian\" ExternalFileName=\"\" ExternalFileOffset=\"\"";
    let floats: Vec<u8> = points.iter().flatten().flat_map(|&x| (x as f32).to_le_bytes()).collect();
    let doubles: Vec<u8> = points.iter().flatten().flat_map(|&x| f64::from(x).to_be_bytes()).collect();
    let of_binary = |points: &str, triangles: &str| {
        file(&[array("POINTSET", "FLOAT32", 8, binary, points), array("TRIANGLE", "INT32", count, binary, triangles)])
    };
    let of_packed = |rows: usize, bytes: &[u8]| {
        file(&[
            array("TRIANGLE", "INT32", count, packed, &STANDARD.encode(zlib(&little(&numbers)))),
            array("POINTSET", "FLOAT32", rows, packed, &STANDARD.encode(zlib(bytes))),
        ])
    };
    let wrapped =
        |text: &str| text.as_bytes().chunks(76).map(|line| [line, b"\n"].concat()).collect::<Vec<_>>().concat();
    let broken_lines = String::from_utf8(wrapped(&STANDARD.encode(&floats))).unwrap();
    // Points column by column, in double precision and the other order of bytes.
    let columns: Vec<u8> =
        (0..3).flat_map(|i| points.iter().flat_map(move |p| f64::from(p[i]).to_be_bytes())).collect();
    let other_order = |bytes: &[u8], more: &str| {
        let more = format!("{more} Encoding=\"Base64Binary\" Endian=\"BigEndian\"");
        file(&[array("POINTSET", "FLOAT64", 8, &more, &STANDARD.encode(bytes)), triangle_array.clone()])
    };
    let curvature = "<DataArray Intent=\"NIFTI_INTENT_SHAPE\" DataType=\"NIFTI_TYPE_FLOAT32\" Dimensionality=\"1\" Dim0=\"8\" \
                     Encoding=\"ASCII\"><Data>1 2 3 4 5 6 7 nan</Data></DataArray>\n";
    let unused = format!("{coordinates}nan nan nan\n");
    let zeros = vec![0u8; 1 << 26];
    let replaced = |from: &str, to: &str| {
        assert!(plain.contains(from), "{from}");
        plain.replacen(from, to, 1).into_bytes()
    };
    vec![
        ("plain.gii", plain.clone().into(), solid("")),
        ("base64.gii", of_binary(&broken_lines, &STANDARD.encode(little(&numbers))).into(), solid("")),
        ("packed.gii", of_packed(8, &floats).into(), solid("")),
        ("whole.gii.gz", gzip(of_packed(8, &floats).as_bytes()), solid("")),
        ("unnamed-gzip.gii", gzip(plain.as_bytes()), solid("")),
        ("big-endian.gii", other_order(&doubles, "").into(), solid("")),
        ("columns.gii", other_order(&columns, "ArrayIndexingOrder=\"ColumnMajorOrder\"").into(), solid("")),
        ("curvature.gii", file(&[curvature.to_owned(), triangle_array.clone(), point_array.clone()]).into(), solid("")),
        (
            "unused.gii",
            file(&[array("POINTSET", "FLOAT32", 9, text, &unused), triangle_array.clone()]).into(),
            solid(""),
        ),
        ("cut.gii", plain[..plain.find("</GIFTI>").unwrap()].into(), Refused("truncated")),
        ("cut-gzip.gii.gz", gzip(plain.as_bytes())[..100].into(), Refused("cannot be decompressed")),
        ("labels.gii", file(&[curvature.to_owned()]).into(), Refused("no array of NIFTI_INTENT_POINTSET")),
        ("two.gii", file(&[point_array.clone(), point_array, triangle_array]).into(), Refused("several arrays")),
        ("other.gii", b"<VTKFile></VTKFile>".to_vec(), Refused("no element `GIFTI`")),
        ("range.gii", replaced("0 3 2", "0 8 2"), Refused("names vertex 8, but there are 8 vertices")),
        ("nan.gii", replaced("1 1 1", "1 nan 1"), Refused("not finite")),
        ("fewer.gii", replaced("Dim0=\"8\"", "Dim0=\"7\""), Refused("more than its 21 numbers")),
        ("more.gii", replaced("Dim0=\"8\"", "Dim0=\"9\""), Refused("NIFTI_INTENT_POINTSET")),
        (
            "absurd.gii",
            replaced("Dim0=\"8\"", "Dim0=\"1000000000000000000\""),
            Refused("more than a file of this size"),
        ),
        ("size.gii", replaced("Dim0=\"8\"", "Dim0=\"many\""), Refused("`Dim0` is \"many\"")),
        ("flat.gii", replaced("Dim1=\"3\"", "Dim1=\"2\""), Refused("its rows have 2 numbers")),
        ("type.gii", replaced("TYPE_FLOAT32", "TYPE_RGB24"), Refused("its type is none that is read")),
        ("float.gii", replaced("TYPE_INT32", "TYPE_FLOAT32"), Refused("whole numbers")),
        ("external.gii", replaced("\"ASCII\"", "\"ExternalFileBinary\""), Refused("in another file")),
        ("encoding.gii", replaced("\"ASCII\"", "\"UUEncode\""), Refused("its encoding is \"UUEncode\"")),
        ("digits.gii", of_binary("AAA!", "").into(), Refused("broken base64")),
        ("short.gii", of_binary(&STANDARD.encode(&floats[..92]), "").into(), Refused("92 bytes, but 8 rows need 96")),
        ("bomb.gii", of_packed(8, &zeros).into(), Refused("more than 96 bytes")),
        ("bomb.gii.gz", gzip(&zeros), Refused("it is damaged or a trap")),
    ]
}

fn freesurfer() -> Cases {
    let triangles = corners();
    let whole = |counts: [u32; 2], corners: &[[usize; 3]]| {
        let mut bytes = b"\xFF\xFF\xFEcreated by somebody on Thu Jan  1 00:00:00 1970\n\n".to_vec();
        bytes.extend(counts.iter().flat_map(|count| count.to_be_bytes()));
        bytes.extend(CORNERS.iter().flatten().flat_map(|&x| (x as f32).to_be_bytes()));
        bytes.extend(corners.iter().flatten().flat_map(|&v| (v as u32).to_be_bytes()));
        bytes
    };
    let count = triangles.len() as u32;
    let plain = whole([8, count], &triangles);
    let mut beyond = triangles.clone();
    beyond[5][1] = 8;
    let volume = b"\0\0\0\x02\0\0\0\0\0\0\0\x14valid = 1\nfilename = brain.mgz\n";
    let mut quadrilaterals = plain.clone();
    quadrilaterals[2] = 0xFF;
    vec![
        ("lh.pial", plain.clone(), solid("")),
        ("bare", plain.clone(), solid("")),
        ("lh.white.volume", [&plain[..], volume].concat(), solid("")),
        ("cut.inflated", plain[..plain.len() - 1].into(), Refused("the list of triangles")),
        ("cut-points.inflated", plain[..100].into(), Refused("the list of points")),
        ("cut-text.inflated", plain[..20].into(), Refused("two lines of text")),
        ("absurd.pial", whole([u32::MAX, count], &triangles), Refused("the list of points")),
        ("range.pial", whole([8, count], &beyond), Refused("cell 5 names vertex 8")),
        ("quadrilaterals.pial", quadrilaterals, Refused("unknown file ending")),
    ]
}

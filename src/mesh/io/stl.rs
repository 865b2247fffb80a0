//! STL surfaces, text or binary, by stl_io.

use std::borrow::Cow;
use std::io::Cursor;
use std::path::Path;

use super::{ReadError, Weld, WriteError, write_atomically};
use crate::mesh::{PolygonSoup, Vec3, VertexId};

/// Bytes before the triangles of a binary file: 80 of free text and a 32-bit count.
const BINARY_HEADER: usize = 84;
/// Bytes of a triangle in a binary file: normal, three corners, 16 bits of attributes.
const BINARY_TRIANGLE: usize = 50;

/// Reads an STL file; corners with equal coordinates (of its single precision) become one vertex, normals are ignored.
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<PolygonSoup, ReadError> {
    if promised_triangles(bytes)
        == Some((bytes.len() as u64).saturating_sub(BINARY_HEADER as u64) / BINARY_TRIANGLE as u64)
        || !bytes.starts_with(b"solid")
    {
        read_binary(path, bytes)
    } else {
        read_text(path, &String::from_utf8_lossy(bytes))
    }
}

/// The count in a binary file's header.
fn promised_triangles(bytes: &[u8]) -> Option<u64> {
    let count = bytes.get(BINARY_HEADER - 4..BINARY_HEADER)?;
    Some(u32::from_le_bytes(count.try_into().expect("four bytes")).into())
}

fn read_binary(path: &Path, bytes: &[u8]) -> Result<PolygonSoup, ReadError> {
    let Some(count) = promised_triangles(bytes) else {
        let message = "neither \"solid\" at the start nor the 84 bytes of a binary header".into();
        return Err(ReadError::Malformed { path: path.into(), line: None, message });
    };
    let there = ((bytes.len() - BINARY_HEADER) / BINARY_TRIANGLE) as u64;
    if count > there {
        let message = format!("the binary header promises {count} triangles, {there} are there");
        return Err(ReadError::Truncated { path: path.into(), line: None, message });
    }
    // Some programs begin the free text of a binary file with "solid", which stl_io takes for a text file.
    let mut bytes = Cow::Borrowed(bytes);
    if bytes.starts_with(b"solid") {
        bytes.to_mut()[0] = b' ';
    }
    collect(path, &bytes, |_| None)
}

fn read_text(path: &Path, text: &str) -> Result<PolygonSoup, ReadError> {
    let last = text.lines().rfind(|line| !line.trim().is_empty()).unwrap_or_default();
    if !last.trim_start().starts_with("endsolid") {
        let message = "no \"endsolid\" in the last line".into();
        return Err(ReadError::Truncated { path: path.into(), line: Some(text.lines().count()), message });
    }
    // stl_io wants a name after "solid" and stops at the first "endsolid"; several solids in a file are one soup here.
    let mut plain = String::from("solid x\n");
    for line in text.lines().skip(1) {
        if !line.trim_start().starts_with("solid") && !line.trim_start().starts_with("endsolid") {
            plain.push_str(line);
        }
        plain.push('\n');
    }
    plain.push_str("endsolid\n");
    let line_of_facet = |facet: usize| {
        let mut facets = text.lines().enumerate().filter(|(_, line)| line.trim_start().starts_with("facet"));
        facets.nth(facet).map(|(index, _)| index + 1)
    };
    collect(path, plain.as_bytes(), line_of_facet)
}

fn collect(
    path: &Path,
    bytes: &[u8],
    line_of_triangle: impl Fn(usize) -> Option<usize>,
) -> Result<PolygonSoup, ReadError> {
    let malformed = |line, message| ReadError::Malformed { path: path.into(), line, message };
    let mut source = Cursor::new(bytes);
    let reader = stl_io::create_stl_reader(&mut source).map_err(|error| malformed(None, error.to_string()))?;
    let mut weld = Weld::default();
    let mut polygons = Vec::new();
    for (index, triangle) in reader.enumerate() {
        let triangle = triangle.map_err(|error| {
            malformed(line_of_triangle(index), format!("triangle {index} (counted from 0): {error}"))
        })?;
        let corners = triangle.vertices.map(|corner| Vec3::new(corner[0].into(), corner[1].into(), corner[2].into()));
        if let Some(corner) = super::first_not_finite(&corners) {
            let message = format!("triangle {index} (counted from 0), corner {corner}: a coordinate is not finite");
            return Err(malformed(line_of_triangle(index), message));
        }
        polygons.push(corners.map(|corner| weld.add(corner)).to_vec());
    }
    if polygons.is_empty() {
        return Err(malformed(None, "the file has no triangles".into()));
    }
    Ok(PolygonSoup { points: weld.points, polygons })
}

/// Writes a binary STL file: single precision, polygons as fans of triangles about their first corner.
pub(super) fn write(path: &Path, soup: &PolygonSoup) -> Result<(), WriteError> {
    let corner = |v: VertexId| {
        let p = &soup.points[v.index()];
        [p.x as f32, p.y as f32, p.z as f32]
    };
    let mut triangles = Vec::new();
    for polygon in &soup.polygons {
        for edge in polygon.windows(2).skip(1) {
            let corners = [polygon[0], edge[0], edge[1]].map(corner);
            if !corners.iter().flatten().all(|x| x.is_finite()) {
                let fault = "a coordinate is beyond the range of STL's single precision, or not finite";
                return Err(WriteError::refused(path, fault, "scale the solid, or use .obj, .off or .ply"));
            }
            triangles.push(stl_io::Triangle {
                normal: stl_io::Normal::new(normal(&corners)),
                vertices: corners.map(stl_io::Vertex::new),
            });
        }
    }
    write_atomically(path, |mut file| stl_io::write_stl(&mut file, triangles.iter()))
}

/// The unit normal of a triangle; zero for a degenerate one, which means that the reader may work it out.
fn normal(corners: &[[f32; 3]; 3]) -> [f32; 3] {
    let [a, b, c] = corners.map(|corner| Vec3::from(corner.map(f64::from)));
    let normal = (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_default();
    [normal.x as f32, normal.y as f32, normal.z as f32]
}

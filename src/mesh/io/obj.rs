//! Wavefront OBJ surfaces, by tobj.

use std::fmt::Write;
use std::path::Path;

use super::write::write_polygon;
use super::{ReadError, Weld, WriteError, first_not_finite, write_atomically};
use crate::mesh::{PolygonSoup, Vec3};

/// Reads the vertices and faces of an OBJ file; objects, groups, materials, normals and texture coordinates are ignored.
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<PolygonSoup, ReadError> {
    let text = String::from_utf8_lossy(bytes);
    let options = tobj::LoadOptions { single_index: false, triangulate: false, ..Default::default() };
    let no_materials = |_: &Path| Ok(Default::default());
    let models = match tobj::load_obj_buf(&mut positions_and_faces(&text).as_bytes(), &options, no_materials) {
        Ok((models, _)) => models,
        Err(error) => return Err(locate(path, &text).unwrap_or_else(|| malformed(path, None, error.to_string()))),
    };

    let mut weld = Weld::default();
    let mut polygons = Vec::new();
    for mesh in models.iter().map(|model| &model.mesh) {
        let points: Vec<Vec3> = mesh.positions.chunks_exact(3).map(Vec3::from_column_slice).collect();
        if let Some(vertex) = first_not_finite(&points) {
            return Err(locate(path, &text).unwrap_or_else(|| ReadError::NotFinite {
                path: path.into(),
                line: None,
                vertex,
            }));
        }
        let mut rest = mesh.indices.as_slice();
        // tobj leaves the arities out where every face is a triangle.
        let arities: Vec<usize> = match mesh.face_arities.as_slice() {
            [] => vec![3; rest.len() / 3],
            arities => arities.iter().map(|&arity| arity as usize).collect(),
        };
        for arity in arities {
            let (polygon, tail) = rest.split_at(arity);
            rest = tail;
            if arity < 3 {
                return Err(locate(path, &text).unwrap_or_else(|| malformed(path, None, TOO_FEW.into())));
            }
            polygons.push(polygon.iter().map(|&index| weld.add(points[index as usize])).collect());
        }
    }
    if polygons.is_empty() {
        return Err(locate(path, &text).unwrap_or_else(|| {
            malformed(path, None, "the file has no faces; export the surface, not only its points".into())
        }));
    }
    Ok(PolygonSoup { points: weld.points, polygons })
}

const TOO_FEW: &str = "a face needs three vertices or more";

/// The `v` and `f` lines, faces reduced to their position indices, every other line blank.
///
/// tobj starts a new model with new indices at each `o`, `g` and `usemtl`, and its arithmetic on texture and normal
/// indices overflows on absurd ones; none of these matter to a solid.
fn positions_and_faces(text: &str) -> String {
    let mut kept = String::with_capacity(text.len());
    for line in text.lines() {
        let line = without_comment(line);
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => kept.push_str(line),
            Some("f") => {
                kept.push('f');
                for word in words {
                    write!(kept, " {}", position_index(word)).expect("writing to a string cannot fail");
                }
            }
            _ => {}
        }
        kept.push('\n');
    }
    kept
}

fn without_comment(line: &str) -> &str {
    line.split('#').next().unwrap_or_default()
}

/// The part of a face's word `position/texture/normal` that names the position.
fn position_index(word: &str) -> &str {
    match word.split('/').next() {
        Some("") | None => "?",
        Some(index) => index,
    }
}

/// Finds the first line that explains a refusal: tobj's errors and values carry no line numbers.
fn locate(path: &Path, text: &str) -> Option<ReadError> {
    let count = text.lines().filter(|line| line.split_whitespace().next() == Some("v")).count();
    let (mut vertices, mut faces) = (0usize, 0usize);
    for (number, line) in text.lines().enumerate().map(|(index, line)| (index + 1, without_comment(line))) {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let values: Vec<Option<f64>> = words.map(|word| word.parse().ok()).collect();
                let count = values.len();
                if !matches!(count, 3 | 4 | 6)
                    || values.iter().any(Option::is_none)
                    || values.get(3) == Some(&Some(0.0)) && count == 4
                {
                    let message = format!(
                        "vertex {vertices} (counted from 0) needs three numbers, then nothing, a weight that is not 0, \
                         or a colour of three numbers: \"{}\"",
                        line.trim()
                    );
                    return Some(malformed(path, Some(number), message));
                }
                if !values.iter().take(3).flatten().all(|x| x.is_finite()) {
                    return Some(ReadError::NotFinite { path: path.into(), line: Some(number), vertex: vertices });
                }
                vertices += 1;
            }
            Some("f") => {
                let mut arity = 0;
                for word in words.map(position_index) {
                    let Ok(index) = word.parse::<i64>() else {
                        let message =
                            format!("face {faces} (counted from 0) has no vertex number in \"{}\"", line.trim());
                        return Some(malformed(path, Some(number), message));
                    };
                    // A negative index counts back from the last vertex read so far.
                    let from_one = if index < 0 { vertices as i128 + 1 + index as i128 } else { index as i128 };
                    if from_one < 1 || from_one > count as i128 {
                        return Some(ReadError::IndexOutOfRange {
                            path: path.into(),
                            line: Some(number),
                            face: faces,
                            index: index.into(),
                            count,
                            first: 1,
                        });
                    }
                    arity += 1;
                }
                if arity < 3 {
                    return Some(malformed(path, Some(number), TOO_FEW.into()));
                }
                faces += 1;
            }
            _ => {}
        }
    }
    None
}

fn malformed(path: &Path, line: Option<usize>, message: String) -> ReadError {
    ReadError::Malformed { path: path.into(), line, message }
}

/// Writes an OBJ file; numbers have as many digits as tell them from all others.
pub(super) fn write(path: &Path, soup: &PolygonSoup) -> Result<(), WriteError> {
    write_atomically(path, |file| {
        soup.points.iter().try_for_each(|p| writeln!(file, "v {:?} {:?} {:?}", p.x, p.y, p.z))?;
        soup.polygons.iter().try_for_each(|polygon| write_polygon(file, "f", polygon, 1))
    })
}

//! Wavefront OBJ surfaces, by tobj.

use std::borrow::Cow;
use std::fmt::Write;
use std::path::Path;

use super::text::{reworded_number, shown};
use super::{ReadError, Weld};
use crate::mesh::{PolygonSoup, Vec3};

/// Keywords that say nothing of the polygons: normals, textures, groups, materials, display, points, lines, free forms.
const HARMLESS: [&str; 47] = [
    "vn",
    "vt",
    "vp",
    "p",
    "l",
    "g",
    "s",
    "mg",
    "o",
    "usemtl",
    "mtllib",
    "usemap",
    "maplib",
    "bevel",
    "c_interp",
    "d_interp",
    "lod",
    "shadow_obj",
    "trace_obj",
    "ctech",
    "stech",
    "cstype",
    "deg",
    "bmat",
    "step",
    "curv",
    "curv2",
    "surf",
    "parm",
    "trim",
    "hole",
    "scrv",
    "sp",
    "end",
    "con",
    "bsp",
    "bzp",
    "cdc",
    "cdp",
    "res",
    "call",
    "csh",
    "newmtl",
    "scmp",
    "dim",
    "group",
    "sg",
];

/// Reads the vertices and faces of an OBJ file; objects, groups, materials, normals, colours and texture coordinates are
/// ignored.
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<PolygonSoup, ReadError> {
    let text = String::from_utf8_lossy(bytes);
    let options = tobj::LoadOptions { single_index: false, triangulate: false, ..Default::default() };
    let no_materials = |_: &Path| Ok(Default::default());
    let kept = positions_and_faces(path, &text)?;
    let models = match tobj::load_obj_buf(&mut kept.as_bytes(), &options, no_materials) {
        Ok((models, _)) => models,
        Err(error) => return Err(locate(path, &text).unwrap_or_else(|| malformed(path, None, error.to_string()))),
    };

    let mut weld = Weld::default();
    let mut polygons = Vec::new();
    for mesh in models.iter().map(|model| &model.mesh) {
        let points: Vec<Vec3> = mesh.positions.chunks_exact(3).map(Vec3::from_column_slice).collect();
        let mut rest = mesh.indices.as_slice();
        // tobj leaves the arities out where every face is a triangle.
        let arities: Vec<usize> = match mesh.face_arities.as_slice() {
            [] => vec![3; rest.len() / 3],
            arities => arities.iter().map(|&arity| arity as usize).collect(),
        };
        // A line "f" without vertices is no face.
        for arity in arities.into_iter().filter(|&arity| arity > 0) {
            let (polygon, tail) = rest.split_at(arity);
            rest = tail;
            let corners = polygon.iter().map(|&index| points[index as usize]);
            if let Some(vertex) = corners.clone().position(|point| !point.iter().all(|x| x.is_finite())) {
                let vertex = polygon[vertex] as usize;
                return Err(locate(path, &text).unwrap_or(ReadError::NotFinite {
                    path: path.into(),
                    line: None,
                    vertex,
                }));
            }
            polygons.push(corners.map(|point| weld.add(point)).collect());
        }
    }
    if polygons.is_empty() {
        return Err(locate(path, &text).unwrap_or_else(|| {
            malformed(path, None, "the file has no faces; export the surface, not only its points".into())
        }));
    }
    Ok(PolygonSoup::new(weld.points, polygons))
}

/// The `v` and `f` lines, vertices reduced to their coordinates (and weight), faces to their position indices, every other
/// line blank.
///
/// tobj starts a new model with new indices at each `o`, `g` and `usemtl`, wants a colour on all vertices or none, and its
/// arithmetic on texture and normal indices overflows on absurd ones; none of these matter to a solid.
fn positions_and_faces(path: &Path, text: &str) -> Result<String, ReadError> {
    let mut kept = String::with_capacity(text.len());
    for (number, line) in lines(text) {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let coloured = line.split_whitespace().count() > 5;
                kept.push('v');
                for word in words.take(if coloured { 3 } else { usize::MAX }) {
                    kept.push(' ');
                    match reworded_number(word) {
                        Some(plain) if word.parse::<f64>().is_err() => kept.push_str(&plain),
                        _ => kept.push_str(word),
                    }
                }
            }
            Some("f" | "fo") => {
                kept.push('f');
                for word in words {
                    write!(kept, " {}", position_index(word)).expect("writing to a string cannot fail");
                }
            }
            Some(word) if !HARMLESS.contains(&word) => {
                let message = format!(
                    "`{}` is no keyword of an OBJ file: it is damaged, or in another format; export it again",
                    shown(word)
                );
                return Err(malformed(path, Some(number), message));
            }
            _ => {}
        }
        kept.push('\n');
    }
    Ok(kept)
}

/// The lines with the number of each, comments left out; one that ends with `\` goes on in the next.
fn lines(text: &str) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let mut rest = (1..).zip(text.lines().map(without_comment));
    std::iter::from_fn(move || {
        let (number, line) = rest.next()?;
        let mut line = Cow::Borrowed(line);
        while line.trim_end().ends_with('\\') {
            let start = line.trim_end().trim_end_matches('\\').to_owned();
            let next = rest.next().map_or("", |(_, next)| next);
            line = Cow::Owned(start + " " + next);
        }
        Some((number, line))
    })
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
    let count = lines(text).filter(|(_, line)| line.split_whitespace().next() == Some("v")).count();
    let (mut vertices, mut faces) = (0usize, 0usize);
    // Where a vertex stands that is not finite, and how often faces name it: one that none names is of no account.
    let mut not_finite: Vec<(usize, usize)> = Vec::new();
    let mut named = vec![false; count];
    for (number, line) in lines(text) {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let number_of = |word: &str| {
                    word.parse().ok().or_else(|| reworded_number(word).and_then(|plain| plain.parse().ok()))
                };
                let values: Vec<Option<f64>> = words.map(number_of).collect();
                let count = values.len();
                if !matches!(count, 3 | 4 | 6 | 7)
                    || values.iter().any(Option::is_none)
                    || values.get(3) == Some(&Some(0.0)) && count == 4
                {
                    let message = format!(
                        "vertex {vertices} (counted from 0) needs three numbers, then nothing, a weight that is not 0, \
                         or a colour of three or four numbers: \"{}\"",
                        shown(&line)
                    );
                    return Some(malformed(path, Some(number), message));
                }
                if !values.iter().take(3).flatten().all(|x| x.is_finite()) {
                    not_finite.push((vertices, number));
                }
                vertices += 1;
            }
            Some("f" | "fo") => {
                for word in words.map(position_index) {
                    let Ok(index) = word.parse::<i64>() else {
                        let message =
                            format!("face {faces} (counted from 0) has no vertex number in \"{}\"", shown(&line));
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
                    named[from_one as usize - 1] = true;
                }
                faces += 1;
            }
            _ => {}
        }
    }
    let (vertex, line) = not_finite.into_iter().find(|&(vertex, _)| named[vertex])?;
    Some(ReadError::NotFinite { path: path.into(), line: Some(line), vertex })
}

fn malformed(path: &Path, line: Option<usize>, message: String) -> ReadError {
    ReadError::Malformed { path: path.into(), line, message }
}

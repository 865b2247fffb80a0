//! Object File Format surfaces: `OFF`, counts, one vertex a line, one face a line.

use std::path::Path;

use super::write::write_polygon;
use super::{ReadError, WriteError, write_atomically};
use crate::mesh::{PolygonSoup, Vec3, VertexId};

/// Reads an OFF file; `#` starts a comment, what follows a vertex's coordinates or a face's indices (colours, normals)
/// is ignored, the header word may be missing and may be `COFF`, `NOFF` or `CNOFF`.
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<PolygonSoup, ReadError> {
    let text = String::from_utf8_lossy(bytes);
    let mut lines = Lines { path, words: text.lines().enumerate().map(split).filter(has_words), line: 1 };

    let mut counts = lines.next("the counts of vertices and faces")?;
    if let Some("OFF" | "COFF" | "NOFF" | "CNOFF") = counts.first().copied() {
        counts.remove(0);
        if counts.is_empty() {
            counts = lines.next("the counts of vertices and faces")?;
        }
    }
    let [vertex_count, face_count] = match counts.as_slice() {
        [vertices, faces, ..] => [lines.number::<u64>(vertices)?, lines.number::<u64>(faces)?],
        _ => return Err(lines.malformed("expected `OFF`, then the counts of vertices, faces and edges".into())),
    };
    if u32::try_from(vertex_count).is_err() {
        return Err(lines.malformed(format!("{vertex_count} vertices are more than can be numbered (2^32)")));
    }

    // No capacity from the header: it may promise anything.
    let mut points = Vec::new();
    for vertex in 0..vertex_count as usize {
        let words = lines.next(&format!("{vertex_count} vertices, {vertex} are there"))?;
        let [x, y, z, ..] = words.as_slice() else {
            return Err(lines.malformed(format!("vertex {vertex} (counted from 0) needs three coordinates")));
        };
        let point = Vec3::new(lines.number(x)?, lines.number(y)?, lines.number(z)?);
        if !point.iter().all(|x| x.is_finite()) {
            return Err(ReadError::NotFinite { path: path.into(), line: Some(lines.line), vertex });
        }
        points.push(point);
    }
    let mut polygons = Vec::new();
    for face in 0..face_count as usize {
        let words = lines.next(&format!("{face_count} faces, {face} are there"))?;
        let arity: usize = lines.number(words[0])?;
        if arity < 3 {
            return Err(lines.malformed(format!("face {face} (counted from 0) has fewer than three vertices")));
        }
        let Some(indices) = words[1..].get(..arity) else {
            return Err(lines.malformed(format!(
                "face {face} (counted from 0) announces {arity} vertices, {} are there",
                words.len() - 1
            )));
        };
        let mut polygon = Vec::with_capacity(arity);
        for word in indices {
            let index: i64 = lines.number(word)?;
            match u32::try_from(index) {
                Ok(vertex) if (vertex as usize) < points.len() => polygon.push(VertexId(vertex)),
                _ => {
                    return Err(ReadError::IndexOutOfRange {
                        path: path.into(),
                        line: Some(lines.line),
                        face,
                        index: index.into(),
                        count: points.len(),
                        first: 0,
                    });
                }
            }
        }
        polygons.push(polygon);
    }
    if polygons.is_empty() {
        return Err(lines.malformed("the file has no faces".into()));
    }
    Ok(PolygonSoup { points, polygons })
}

/// The line's number and its words before a `#`.
fn split((index, line): (usize, &str)) -> (usize, Vec<&str>) {
    (index + 1, line.split('#').next().unwrap_or_default().split_whitespace().collect())
}

fn has_words((_, words): &(usize, Vec<&str>)) -> bool {
    !words.is_empty()
}

/// The lines that hold something, and where we are for the errors.
struct Lines<'a, I> {
    path: &'a Path,
    words: I,
    line: usize,
}

impl<'a, I: Iterator<Item = (usize, Vec<&'a str>)>> Lines<'a, I> {
    fn next(&mut self, promised: &str) -> Result<Vec<&'a str>, ReadError> {
        let Some((line, words)) = self.words.next() else {
            let message = format!("expected {promised}");
            return Err(ReadError::Truncated { path: self.path.into(), line: Some(self.line), message });
        };
        self.line = line;
        Ok(words)
    }

    fn number<T: std::str::FromStr>(&self, word: &str) -> Result<T, ReadError> {
        word.parse().map_err(|_| self.malformed(format!("\"{word}\" is not a number that can stand here")))
    }

    fn malformed(&self, message: String) -> ReadError {
        ReadError::Malformed { path: self.path.into(), line: Some(self.line), message }
    }
}

/// Writes an OFF file; numbers have as many digits as tell them from all others.
pub(super) fn write(path: &Path, soup: &PolygonSoup) -> Result<(), WriteError> {
    write_atomically(path, |file| {
        // The count of edges is not needed by any reader, but has to be there.
        writeln!(file, "OFF\n{} {} 0", soup.points.len(), soup.polygons.len())?;
        soup.points.iter().try_for_each(|p| writeln!(file, "{:?} {:?} {:?}", p.x, p.y, p.z))?;
        soup.polygons.iter().try_for_each(|polygon| write_polygon(file, &polygon.len().to_string(), polygon, 0))
    })
}

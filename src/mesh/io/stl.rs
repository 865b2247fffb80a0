//! STL surfaces, text or binary.
//!
//! Read by ourselves: what people have differs from the format in its keywords' case, blank and missing lines, counts and
//! normals, which a strict reader refuses.

use std::path::Path;

use super::text;
use super::tokens::{Token, Tokens};
use super::{ReadError, Weld};
use crate::mesh::{PolygonSoup, Vec3, VertexId};

/// Bytes before the triangles of a binary file: 80 of free text and a 32-bit count.
const BINARY_HEADER: usize = 84;
/// Bytes of a triangle in a binary file: normal, three corners, 16 bits of attributes.
const BINARY_TRIANGLE: usize = 50;

/// Reads an STL file; corners with equal coordinates (of its single precision) become one vertex, normals are ignored.
pub(super) fn read(path: &Path, bytes: Vec<u8>) -> Result<PolygonSoup, ReadError> {
    // A binary file may start with the word `solid`, and so may its size tell it.
    let is_binary = promised(&bytes).is_some_and(|count| count > 0 && count == room(&bytes));
    if !is_binary && is_text(&bytes) { read_text(path, &text::plain(path, bytes)?) } else { read_binary(path, &bytes) }
}

/// Whether the file starts as a text does.
fn is_text(bytes: &[u8]) -> bool {
    // A mark, and in UTF-16 zeros: that is told to be text, but not read.
    if bytes.starts_with(b"\xFF\xFE") || bytes.starts_with(b"\xFE\xFF") {
        return true;
    }
    let start = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes).trim_ascii_start();
    let begins = |word: &[u8]| start.get(..word.len()).is_some_and(|start| start.eq_ignore_ascii_case(word));
    (begins(b"solid") || begins(b"facet")) && !start[..start.len().min(BINARY_HEADER)].contains(&0)
}

/// The count in a binary file's header.
fn promised(bytes: &[u8]) -> Option<usize> {
    let count = bytes.get(BINARY_HEADER - 4..)?.first_chunk::<4>()?;
    Some(u32::from_le_bytes(*count) as usize)
}

/// How many triangles the bytes after the header hold.
fn room(bytes: &[u8]) -> usize {
    (bytes.len() - BINARY_HEADER) / BINARY_TRIANGLE
}

fn read_binary(path: &Path, bytes: &[u8]) -> Result<PolygonSoup, ReadError> {
    let Some(mut count) = promised(bytes) else {
        let message = "neither \"solid\" at the start nor the 84 bytes of a binary header".into();
        return Err(malformed(path, None, message));
    };
    let (there, mut notes) = (room(bytes), Vec::new());
    let whole = (bytes.len() - BINARY_HEADER).is_multiple_of(BINARY_TRIANGLE);
    if count != there && whole && there > 0 {
        // Programs that write as they go leave 0 or -1 behind.
        notes.push(format!("the binary header promises {count} triangles, {there} are there and were read"));
        count = there;
    }
    if count > there {
        let message = format!("the binary header promises {count} triangles, {there} are there");
        return Err(ReadError::Truncated { path: path.into(), line: None, message });
    }
    let mut facets = Facets { path, weld: Weld::default(), polygons: Vec::new() };
    for triangle in bytes[BINARY_HEADER..].chunks_exact(BINARY_TRIANGLE).take(count) {
        let (numbers, _) = triangle.as_chunks::<4>();
        let corners = numbers[3..12]
            .chunks_exact(3)
            .map(|corner| Vec3::from_iterator(corner.iter().map(|&number| f64::from(f32::from_le_bytes(number)))));
        facets.push(&corners.collect::<Vec<_>>(), None)?;
    }
    facets.finish(notes)
}

/// `facet ... outer loop vertex x y z ... endloop endfacet`, laid out over lines as one likes; several solids are one.
fn read_text(path: &Path, bytes: &[u8]) -> Result<PolygonSoup, ReadError> {
    let mut tokens = Tokens::new(bytes);
    let mut facets = Facets { path, weld: Weld::default(), polygons: Vec::new() };
    let (mut line_of_facet, mut open, mut ended) = (0, false, false);
    let truncated = |tokens: &Tokens, wanted: &str| ReadError::Truncated {
        path: path.into(),
        line: Some(tokens.last_line()),
        message: format!("expected {wanted}"),
    };
    while let Some(token) = tokens.next() {
        // Of a name, a normal (which may be missing, or no numbers) or a comment nothing is wanted.
        if is(token, b"facet") {
            // Or a word of a name, which does no harm.
            line_of_facet = token.line;
        } else if is(token, b"endsolid") {
            ended = true;
        } else if is(token, b"endfacet") {
            open = false;
        } else if is(token, b"outer") && tokens.next_if(|token| is(token, b"loop")).is_some() {
            (open, ended) = (true, false);
            let mut corners: Vec<Vec3> = Vec::new();
            loop {
                let word = tokens.next().ok_or_else(|| truncated(&tokens, "`endloop`"))?;
                if is(word, b"endloop") {
                    break;
                }
                if !is(word, b"vertex") {
                    let message = format!("{} stands where `vertex` or `endloop` should", word.shown());
                    return Err(malformed(path, Some(word.line), message));
                }
                let mut corner = Vec3::zeros();
                for x in &mut corner {
                    let number = tokens.next().ok_or_else(|| truncated(&tokens, "a coordinate"))?;
                    // The format's numbers have single precision, whatever their digits.
                    *x = number.value::<f32>().map(f64::from).ok_or_else(|| {
                        let message = format!("a coordinate is {}, but should be a number", number.shown());
                        malformed(path, Some(number.line), message)
                    })?;
                }
                corners.push(corner);
            }
            if corners.len() < 3 {
                let (face, count) = (facets.polygons.len(), corners.len());
                let message = format!("triangle {face} (counted from 0) has {count} corners");
                return Err(malformed(path, Some(line_of_facet), message));
            }
            facets.push(&corners, Some(line_of_facet))?;
        }
    }
    if open {
        return Err(truncated(&tokens, "`endfacet`"));
    }
    let notes = if ended { None } else { Some("no `endsolid` ends the file: it may have been cut short".to_owned()) };
    facets.finish(notes.into_iter().collect())
}

fn is(token: Token, word: &[u8]) -> bool {
    token.text.eq_ignore_ascii_case(word)
}

struct Facets<'a> {
    path: &'a Path,
    weld: Weld,
    polygons: Vec<Vec<VertexId>>,
}

impl Facets<'_> {
    fn push(&mut self, corners: &[Vec3], line: Option<usize>) -> Result<(), ReadError> {
        if let Some(corner) = super::first_not_finite(corners) {
            let index = self.polygons.len();
            let message = format!("triangle {index} (counted from 0), corner {corner}: a coordinate is not finite");
            return Err(malformed(self.path, line, message));
        }
        self.polygons.push(corners.iter().map(|&corner| self.weld.add(corner)).collect());
        Ok(())
    }

    fn finish(self, notes: Vec<String>) -> Result<PolygonSoup, ReadError> {
        if self.polygons.is_empty() {
            return Err(malformed(self.path, None, "the file has no triangles".into()));
        }
        Ok(PolygonSoup { points: self.weld.points, polygons: self.polygons, notes })
    }
}

fn malformed(path: &Path, line: Option<usize>, message: String) -> ReadError {
    ReadError::Malformed { path: path.into(), line, message }
}

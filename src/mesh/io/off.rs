//! Object File Format surfaces (Geomview): `OFF`, counts, one vertex a line, then the faces.
//!
//! The header word tells what stands at each vertex: `[ST][C][N][4]OFF`, texture, colour, normal, four homogeneous
//! coordinates. It may be missing, and the counts may follow it at once.

use std::path::Path;

use super::tokens::{Token, Tokens};
use super::{NotFinite, ReadError};
use crate::mesh::{PolygonSoup, Vec3, VertexId};

/// Reads an OFF file, text or binary; `#` starts a comment, what follows a vertex's coordinates or a face's indices
/// (colours, normals) is ignored.
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<PolygonSoup, ReadError> {
    let mut source = Source { path, tokens: Tokens::with_comments(bytes), face: 0, vertices: 0 };
    let kind = source.header()?;
    if source.tokens.next_if(|token| token.text.eq_ignore_ascii_case(b"BINARY")).is_some() {
        // A binary file has no comments: these bytes would be taken for some.
        let rest = source.tokens.rest();
        let from = rest.iter().position(|&byte| byte == b'\n').map_or(rest.len(), |end| end + 1);
        return source.binary(kind, &rest[from..]);
    }
    source.text(kind)
}

/// What the header word says of the vertices.
#[derive(Clone, Copy, Default)]
struct Kind {
    homogeneous: bool,
    normals: bool,
    colours: bool,
    textures: bool,
}

impl Kind {
    /// From the header word, which may have the first count at its end.
    fn of(word: &str) -> Option<(Self, &str)> {
        let upper = word.to_ascii_uppercase();
        let (mut prefix, count) = upper.split_once("OFF")?;
        let mut kind = Self::default();
        for (mark, flag) in [
            ("ST", &mut kind.textures),
            ("C", &mut kind.colours),
            ("N", &mut kind.normals),
            ("4", &mut kind.homogeneous),
        ] {
            if let Some(rest) = prefix.strip_prefix(mark) {
                (prefix, *flag) = (rest, true);
            }
        }
        let count = &word[word.len() - count.len()..];
        (prefix.is_empty() && count.bytes().all(|byte| byte.is_ascii_digit())).then_some((kind, count))
    }

    /// The place in space of a vertex's first numbers.
    fn point(self, numbers: [f64; 4]) -> Vec3 {
        let [x, y, z, w] = numbers;
        if self.homogeneous { Vec3::new(x, y, z) / w } else { Vec3::new(x, y, z) }
    }
}

struct Source<'a> {
    path: &'a Path,
    tokens: Tokens<'a>,
    /// The face and the vertex that are read.
    face: u64,
    vertices: usize,
}

impl<'a> Source<'a> {
    fn header(&mut self) -> Result<Kind, ReadError> {
        let wanted = "expected `OFF`, then the counts of vertices, faces and edges";
        let Some(first) = self.tokens.clone().next() else { return Err(self.truncated(wanted)) };
        let Some(word) = std::str::from_utf8(first.text).ok() else { return Err(self.malformed(first, wanted)) };
        let Some((kind, count)) = Kind::of(word) else {
            // The counts alone will do.
            return if word.parse::<u64>().is_ok() { Ok(Kind::default()) } else { Err(self.malformed(first, wanted)) };
        };
        self.tokens.part(word.len() - count.len());
        Ok(kind)
    }

    fn text(mut self, kind: Kind) -> Result<PolygonSoup, ReadError> {
        let wanted = "expected the counts of vertices and faces";
        let line = self.tokens.clone().next().map_or(0, |token| token.line);
        let vertex_count: u64 = self.number(wanted)?;
        let face_count: u64 = self.number(wanted)?;
        if u32::try_from(vertex_count).is_err() {
            let message = format!("{vertex_count} vertices are more than can be numbered (2^32)");
            return Err(ReadError::Malformed { path: self.path.into(), line: Some(line), message });
        }
        self.tokens.rest_of_line();
        // No capacity from the header: it may promise anything.
        let mut points = Vec::new();
        let mut not_finite = NotFinite::default();
        for vertex in 0..vertex_count as usize {
            let promised = format!("expected {vertex_count} vertices, {vertex} are there");
            let Some(first) = self.tokens.clone().next() else { return Err(self.truncated(&promised)) };
            let mut numbers = [1.0; 4];
            for number in numbers.iter_mut().take(if kind.homogeneous { 4 } else { 3 }) {
                match self.tokens.next_if(|token| token.line == first.line) {
                    Some(token) => *number = self.parse(token)?,
                    None => {
                        let message = format!("vertex {vertex} (counted from 0) needs three coordinates");
                        return Err(self.malformed(first, &message));
                    }
                }
            }
            let point = kind.point(numbers);
            not_finite.check(vertex, &point, Some(first.line));
            points.push(point);
            self.tokens.rest_of_line();
        }
        let mut polygons = Vec::new();
        self.vertices = points.len();
        for face in 0..face_count {
            self.face = face;
            let promised = format!("expected {face_count} faces, {face} are there");
            let arity: u64 = self.number(&promised)?;
            // Every index takes a digit and a separator.
            if arity > self.tokens.left() as u64 / 2 + 1 {
                let message = format!("face {face} (counted from 0) announces {arity} vertices, which are not there");
                return Err(self.fault(message));
            }
            let polygon = (0..arity).map(|_| {
                let index = self.number(&format!("face {face} (counted from 0) announces {arity} vertices"))?;
                self.vertex(index)
            });
            polygons.push(polygon.collect::<Result<Vec<_>, _>>()?);
            self.tokens.rest_of_line();
        }
        self.finish(points, polygons, &not_finite)
    }

    /// Big-endian words of 32 bits: counts; the numbers of each vertex; each face's corners and the numbers of its colour.
    fn binary(mut self, kind: Kind, mut bytes: &[u8]) -> Result<PolygonSoup, ReadError> {
        let mut word = |wanted: &str| {
            let (word, rest) = bytes.split_first_chunk::<4>().ok_or_else(|| ReadError::Truncated {
                path: self.path.into(),
                line: None,
                message: wanted.into(),
            })?;
            bytes = rest;
            Ok::<u32, ReadError>(u32::from_be_bytes(*word))
        };
        let wanted = "expected the counts of vertices, faces and edges";
        let [vertex_count, face_count, _] = [word(wanted)?, word(wanted)?, word(wanted)?];
        let more = [(kind.normals, 3), (kind.colours, 4), (kind.textures, 2)];
        let more: usize = more.iter().map(|&(there, count)| if there { count } else { 0 }).sum();
        let (mut points, mut polygons, mut not_finite) = (Vec::new(), Vec::new(), NotFinite::default());
        for vertex in 0..vertex_count as usize {
            let promised = format!("expected {vertex_count} vertices, {vertex} are there");
            let mut numbers = [1.0; 4];
            for number in numbers.iter_mut().take(if kind.homogeneous { 4 } else { 3 }) {
                *number = f32::from_bits(word(&promised)?).into();
            }
            for _ in 0..more {
                word(&promised)?;
            }
            let point = kind.point(numbers);
            not_finite.check(vertex, &point, None);
            points.push(point);
        }
        let mut corners = Vec::new();
        for face in 0..face_count {
            let promised = format!("expected {face_count} faces, {face} are there");
            let mut polygon = Vec::new();
            for _ in 0..word(&promised)? {
                polygon.push(word(&promised)?);
            }
            for _ in 0..word(&promised)? {
                word(&promised)?;
            }
            corners.push(polygon);
        }
        self.vertices = points.len();
        for (face, polygon) in (0..).zip(corners) {
            self.face = face;
            polygons.push(polygon.into_iter().map(|v| self.vertex(v.into())).collect::<Result<Vec<_>, _>>()?);
        }
        self.finish(points, polygons, &not_finite)
    }

    fn finish(
        &self,
        points: Vec<Vec3>,
        polygons: Vec<Vec<VertexId>>,
        not_finite: &NotFinite,
    ) -> Result<PolygonSoup, ReadError> {
        if polygons.is_empty() {
            return Err(self.fault("the file has no faces".into()));
        }
        not_finite.refuse(self.path, polygons.iter().flatten())?;
        Ok(PolygonSoup::new(points, polygons))
    }

    fn vertex(&self, index: i64) -> Result<VertexId, ReadError> {
        match u32::try_from(index) {
            Ok(vertex) if (vertex as usize) < self.vertices => Ok(VertexId(vertex)),
            _ => Err(ReadError::IndexOutOfRange {
                path: self.path.into(),
                line: Some(self.tokens.line()),
                face: self.face as usize,
                index: index.into(),
                count: self.vertices,
                first: 0,
            }),
        }
    }

    fn number<T: std::str::FromStr>(&mut self, promised: &str) -> Result<T, ReadError> {
        match self.tokens.next() {
            Some(token) => self.parse(token),
            None => Err(self.truncated(promised)),
        }
    }

    fn parse<T: std::str::FromStr>(&self, token: Token) -> Result<T, ReadError> {
        token.value().ok_or_else(|| {
            let message = format!("{} is not a number that can stand here", token.shown());
            self.malformed(token, &message)
        })
    }

    fn truncated(&self, promised: &str) -> ReadError {
        ReadError::Truncated { path: self.path.into(), line: Some(self.tokens.last_line()), message: promised.into() }
    }

    fn malformed(&self, token: Token, message: &str) -> ReadError {
        ReadError::Malformed { path: self.path.into(), line: Some(token.line), message: message.into() }
    }

    fn fault(&self, message: String) -> ReadError {
        ReadError::Malformed { path: self.path.into(), line: Some(self.tokens.line()), message }
    }
}

//! Stanford PLY surfaces, text or binary, by ply-rs.

use std::path::Path;

use ply_rs::parser::Parser;
use ply_rs::ply::{ElementDef, Encoding, Property, PropertyAccess};

use super::{ReadError, WriteError, write_atomically};
use crate::mesh::{PolygonSoup, Vec3, VertexId};

/// Reads `x y z` of the element `vertex` and the list `vertex_indices` (or `vertex_index`) of the element `face`.
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<PolygonSoup, ReadError> {
    let malformed = |line, message: String| ReadError::Malformed { path: path.into(), line, message };
    let header_lines = check_header(bytes).map_err(|(line, message)| malformed(Some(line), message))?;
    let parser = Parser::<Element>::new();
    let mut rest = bytes;
    let header = parser.read_header(&mut rest).map_err(|error| malformed(None, one_line(&error)))?;

    let mut source = Source { parser, encoding: header.encoding, rest, line: header_lines };
    let (mut points, mut polygons) = (Vec::new(), Vec::new());
    for (name, definition) in header.elements.iter().filter(|(_, definition)| !definition.properties.is_empty()) {
        // No capacity from the header: it may promise anything. Each element takes a byte at least, so this ends.
        for index in 0..definition.count {
            if source.at_end() {
                let message = format!("the header promises {} of {name}, {index} are there", definition.count);
                return Err(ReadError::Truncated { path: path.into(), line: source.line(), message });
            }
            let element = match source.next(definition) {
                Ok(element) => element,
                Err(message) => {
                    return Err(malformed(source.line(), format!("{name} {index} (counted from 0): {message}")));
                }
            };
            match name.as_str() {
                "vertex" => {
                    let [Some(x), Some(y), Some(z)] = element.position else {
                        return Err(malformed(None, "the element vertex lacks one of the properties x, y, z".into()));
                    };
                    if ![x, y, z].iter().all(|x| x.is_finite()) {
                        return Err(ReadError::NotFinite { path: path.into(), line: source.line(), vertex: index });
                    }
                    points.push(Vec3::new(x, y, z));
                }
                "face" => {
                    let Some(indices) = element.indices else {
                        let message = "the element face lacks the property list vertex_indices".into();
                        return Err(malformed(None, message));
                    };
                    if indices.len() < 3 {
                        let message = format!("face {index} (counted from 0) has fewer than three vertices");
                        return Err(malformed(source.line(), message));
                    }
                    polygons.push((source.line(), indices));
                }
                _ => {}
            }
        }
    }
    if polygons.is_empty() {
        return Err(malformed(None, "the file has no faces".into()));
    }
    // Faces may come before vertices, so their indices are checked last.
    let check = |(face, (line, indices)): (usize, (Option<usize>, Vec<i64>))| {
        let count = points.len();
        let in_range =
            |&index: &i64| u32::try_from(index).ok().filter(|&i| (i as usize) < count).map(VertexId).ok_or(index);
        indices.iter().map(in_range).collect::<Result<Vec<_>, _>>().map_err(|index| ReadError::IndexOutOfRange {
            path: path.into(),
            line,
            face,
            index: index.into(),
            count,
            first: 0,
        })
    };
    let polygons = polygons.into_iter().enumerate().map(check).collect::<Result<_, _>>()?;
    Ok(PolygonSoup { points, polygons })
}

/// Writes a binary PLY file in double precision.
pub(super) fn write(path: &Path, soup: &PolygonSoup) -> Result<(), WriteError> {
    if soup.polygons.iter().any(|polygon| polygon.len() > usize::from(u8::MAX)) {
        return Err(WriteError::refused(path, "a polygon has more than 255 corners", "split it, or use .obj or .off"));
    }
    write_atomically(path, |file| {
        writeln!(file, "ply\nformat binary_little_endian 1.0\nelement vertex {}", soup.points.len())?;
        writeln!(file, "property double x\nproperty double y\nproperty double z")?;
        writeln!(file, "element face {}\nproperty list uchar uint vertex_indices\nend_header", soup.polygons.len())?;
        soup.points.iter().flatten().try_for_each(|x| file.write_all(&x.to_le_bytes()))?;
        for polygon in &soup.polygons {
            file.write_all(&[polygon.len() as u8])?;
            polygon.iter().try_for_each(|v| file.write_all(&v.0.to_le_bytes()))?;
        }
        Ok(())
    })
}

/// Refuses what ply-rs would panic on (a number in the header that may exceed 64 bits); returns how many lines the header has.
fn check_header(bytes: &[u8]) -> Result<usize, (usize, String)> {
    for (index, line) in bytes.split(|&byte| byte == b'\n').enumerate() {
        let number = index + 1;
        let line = String::from_utf8_lossy(line);
        let line = line.trim();
        if number == 1 && line != "ply" {
            return Err((1, "the first line must be \"ply\"".into()));
        }
        if line == "end_header" {
            return Ok(number);
        }
        let too_long = |digits: &str| digits.len() > 19;
        if !line.starts_with("comment")
            && !line.starts_with("obj_info")
            && line.split(|c: char| !c.is_ascii_digit()).any(too_long)
        {
            return Err((number, format!("absurd number in \"{}\"", excerpt(line))));
        }
    }
    Err((1, "no line \"end_header\"".into()))
}

fn excerpt(line: &str) -> String {
    line.chars().take(60).collect()
}

/// ply-rs spreads its messages over several indented lines.
fn one_line(error: &dyn std::fmt::Display) -> String {
    excerpt_words(&error.to_string())
}

fn excerpt_words(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ").chars().take(300).collect()
}

/// The bytes after the header, taken element by element so that an error can name its line or element.
struct Source<'a> {
    parser: Parser<Element>,
    encoding: Encoding,
    rest: &'a [u8],
    /// Lines read so far; meaningful for text files.
    line: usize,
}

impl Source<'_> {
    fn line(&self) -> Option<usize> {
        (self.encoding == Encoding::Ascii).then_some(self.line)
    }

    /// Whether nothing is left, blank lines of a text file apart.
    fn at_end(&self) -> bool {
        match self.encoding {
            Encoding::Ascii => self.rest.iter().all(u8::is_ascii_whitespace),
            _ => self.rest.is_empty(),
        }
    }

    fn next(&mut self, definition: &ElementDef) -> Result<Element, String> {
        let result = match self.encoding {
            Encoding::Ascii => {
                let line = self.next_line();
                self.parser.read_ascii_element(&plain_numbers(&line)?, definition)
            }
            Encoding::BinaryBigEndian => self.parser.read_big_endian_element(&mut self.rest, definition),
            Encoding::BinaryLittleEndian => self.parser.read_little_endian_element(&mut self.rest, definition),
        };
        result.map_err(|error| one_line(&error))
    }

    /// The next line that is not blank; [`Source::at_end`] has told that there is one.
    fn next_line(&mut self) -> String {
        loop {
            let end = self.rest.iter().position(|&byte| byte == b'\n').unwrap_or(self.rest.len());
            let line = String::from_utf8_lossy(&self.rest[..end]).trim().to_owned();
            self.rest = self.rest.get(end + 1..).unwrap_or_default();
            self.line += 1;
            if !line.is_empty() || self.rest.is_empty() {
                return line;
            }
        }
    }
}

/// Rewrites numbers that ply-rs does not know (`.5`, `1.`, `1E3`) as equal ones that it does, and names what is none.
fn plain_numbers(line: &str) -> Result<String, String> {
    let plain = |word: &str| match (word.parse::<i64>(), word.parse::<f64>()) {
        (Ok(_), _) => Ok(word.to_owned()),
        (_, Ok(value)) if value.is_finite() => Ok(format!("{value:?}")),
        (_, Ok(_)) => Err(format!("\"{}\" is not finite", excerpt(word))),
        _ => Err(format!("\"{}\" is not a number", excerpt(word))),
    };
    Ok(line.split_whitespace().map(plain).collect::<Result<Vec<_>, _>>()?.join(" "))
}

/// What is kept of a vertex or a face.
#[derive(Default)]
struct Element {
    position: [Option<f64>; 3],
    indices: Option<Vec<i64>>,
}

impl PropertyAccess for Element {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: String, property: Property) {
        match name.as_str() {
            "x" => self.position[0] = scalar(&property),
            "y" => self.position[1] = scalar(&property),
            "z" => self.position[2] = scalar(&property),
            "vertex_indices" | "vertex_index" => self.indices = integers(property),
            _ => {}
        }
    }
}

fn scalar(property: &Property) -> Option<f64> {
    match *property {
        Property::Char(value) => Some(value.into()),
        Property::UChar(value) => Some(value.into()),
        Property::Short(value) => Some(value.into()),
        Property::UShort(value) => Some(value.into()),
        Property::Int(value) => Some(value.into()),
        Property::UInt(value) => Some(value.into()),
        Property::Float(value) => Some(value.into()),
        Property::Double(value) => Some(value),
        _ => None,
    }
}

fn integers(property: Property) -> Option<Vec<i64>> {
    fn widen<T: Into<i64>>(values: Vec<T>) -> Option<Vec<i64>> {
        Some(values.into_iter().map(Into::into).collect())
    }
    match property {
        Property::ListChar(values) => widen(values),
        Property::ListUChar(values) => widen(values),
        Property::ListShort(values) => widen(values),
        Property::ListUShort(values) => widen(values),
        Property::ListInt(values) => widen(values),
        Property::ListUInt(values) => widen(values),
        _ => None,
    }
}

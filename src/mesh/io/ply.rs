//! Stanford PLY surfaces, text or binary.
//!
//! Read by ourselves: of the values of an element nothing is wanted but positions and indices, whatever the others hold
//! (NaN, numbers in the wrong form, lists of any length), and triangle strips are faces too.

use std::path::Path;

use super::cells::triangles_of_strip;
use super::numbers::{Encoding, Kind};
use super::tokens::{Fault, Tokens};
use super::{NotFinite, ReadError};
use crate::mesh::{PolygonSoup, Vec3, VertexId};

/// Reads `x y z` of the element `vertex`, the list `vertex_indices` (or `vertex_index`) of the element `face`, and the strips
/// of the element `tristrips`.
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<PolygonSoup, ReadError> {
    let malformed = |(line, message)| ReadError::Malformed { path: path.into(), line, message };
    let header = Header::read(bytes).map_err(malformed)?;
    let mut body = Body { tokens: Tokens::starting_at(header.rest, header.lines + 1), encoding: header.encoding };
    let (mut points, mut faces, mut not_finite) = (Vec::new(), Vec::new(), NotFinite::default());
    for element in header.elements.iter().filter(|element| !element.properties.is_empty()) {
        let wanted = element.wanted().map_err(|message| malformed((None, message)))?;
        // No capacity from the header: it may promise anything. Each element takes a byte at least, so this ends.
        for index in 0..element.count {
            if body.at_end() {
                let message = format!("the header promises {} of {}, {index} are there", element.count, element.name);
                return Err(ReadError::Truncated { path: path.into(), line: body.line(), message });
            }
            let values = body.element(element, &wanted).map_err(|(line, message)| {
                let line = line.filter(|_| header.encoding == Encoding::Text);
                malformed((line, format!("{} {index} (counted from 0): {message}", element.name)))
            })?;
            let line = body.line();
            body.end_element();
            match wanted {
                Wanted::Position(_) => {
                    let point = Vec3::from_column_slice(&values.position);
                    not_finite.check(index as usize, &point, line);
                    points.push(point);
                }
                Wanted::Indices(_) if element.name == "tristrips" => {
                    // The strips are parted by -1.
                    let strips = values.indices.split(|&index| index == -1);
                    faces.extend(strips.flat_map(triangles_of_strip).map(|face| (line, face)));
                }
                Wanted::Indices(_) => faces.push((line, values.indices)),
                Wanted::Nothing => {}
            }
        }
    }
    if faces.is_empty() {
        return Err(malformed((None, "the file has no faces".into())));
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
    let polygons: Vec<Vec<VertexId>> = faces.into_iter().enumerate().map(check).collect::<Result<_, _>>()?;
    not_finite.refuse(path, polygons.iter().flatten())?;
    Ok(PolygonSoup::new(points, polygons))
}

/// What the file says of itself.
struct Header<'a> {
    encoding: Encoding,
    elements: Vec<Element>,
    /// How many lines it has.
    lines: usize,
    /// The bytes after it.
    rest: &'a [u8],
}

struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

struct Property {
    name: String,
    /// The type of a list's length; none for one value.
    length: Option<Kind>,
    kind: Kind,
}

/// What of an element is wanted, by the places of its properties.
enum Wanted {
    Position([usize; 3]),
    Indices(usize),
    Nothing,
}

impl<'a> Header<'a> {
    fn read(bytes: &'a [u8]) -> Result<Self, Fault> {
        let mut header = Self { encoding: Encoding::Text, elements: Vec::new(), lines: 0, rest: bytes };
        loop {
            let Some(line) = header.next_line() else {
                return Err((Some(1), "no line \"end_header\"".into()));
            };
            let here = |message: String| (Some(header.lines), message);
            let line = String::from_utf8_lossy(line);
            let words: Vec<&str> = line.split_whitespace().collect();
            if header.lines == 1 {
                if words != ["ply"] {
                    return Err(here("the first line must be \"ply\"".into()));
                }
                continue;
            }
            match words.as_slice() {
                ["end_header"] => return Ok(header),
                ["format", format, ..] => {
                    header.encoding = match *format {
                        "ascii" => Encoding::Text,
                        "binary_little_endian" => Encoding::LittleEndian,
                        "binary_big_endian" => Encoding::BigEndian,
                        _ => return Err(here(format!("the format \"{}\" is not known", super::text::shown(format)))),
                    }
                }
                ["element", name, count] => {
                    let count = count
                        .parse()
                        .map_err(|_| here(format!("absurd number in \"{}\"", super::text::shown(&line))))?;
                    header.elements.push(Element { name: (*name).into(), count, properties: Vec::new() });
                }
                ["property", words @ ..] => {
                    let property = Property::of(words)
                        .ok_or_else(|| here(format!("\"{}\" is no property of PLY", super::text::shown(&line))))?;
                    let message = "a property stands before the first element".into();
                    header.elements.last_mut().ok_or((Some(header.lines), message))?.properties.push(property);
                }
                [] | ["comment" | "obj_info", ..] => {}
                _ => {
                    return Err(here(format!(
                        "\"{}\" is no line of a PLY header, and stands before \"end_header\"",
                        super::text::shown(&line)
                    )));
                }
            }
        }
    }

    /// The next line, ended by `\n`, `\r\n` or (on old machines) `\r`.
    fn next_line(&mut self) -> Option<&'a [u8]> {
        let end = self.rest.iter().position(|byte| matches!(byte, b'\n' | b'\r'))?;
        let (line, rest) = self.rest.split_at(end);
        self.rest = rest.strip_prefix(b"\r\n").unwrap_or(&rest[1..]);
        self.lines += 1;
        Some(line)
    }
}

impl Property {
    fn of(words: &[&str]) -> Option<Self> {
        let (length, kind, name) = match *words {
            ["list", length, kind, name] => (Some(Self::kind(length)?), kind, name),
            [kind, name] => (None, kind, name),
            _ => return None,
        };
        Some(Self { name: name.into(), length, kind: Self::kind(kind)? })
    }

    fn kind(name: &str) -> Option<Kind> {
        Some(match name {
            "char" | "int8" => Kind::Int8,
            "uchar" | "uint8" => Kind::UInt8,
            "short" | "int16" => Kind::Int16,
            "ushort" | "uint16" => Kind::UInt16,
            "int" | "int32" => Kind::Int32,
            "uint" | "uint32" => Kind::UInt32,
            "float" | "float32" => Kind::Float32,
            "double" | "float64" => Kind::Float64,
            _ => return None,
        })
    }
}

impl Element {
    fn wanted(&self) -> Result<Wanted, String> {
        let place = |name: &str| self.properties.iter().position(|property| property.name == name);
        match self.name.as_str() {
            "vertex" => {
                match ["x", "y", "z"].map(|name| place(name).filter(|&at| self.properties[at].length.is_none())) {
                    [Some(x), Some(y), Some(z)] => Ok(Wanted::Position([x, y, z])),
                    _ => Err("the element vertex lacks one of the properties x, y, z".into()),
                }
            }
            "face" | "tristrips" => {
                let list = place("vertex_indices").or_else(|| place("vertex_index"));
                let list = list.filter(|&at| {
                    let Property { length, kind, .. } = self.properties[at];
                    length.is_some() && !matches!(kind, Kind::Float32 | Kind::Float64)
                });
                list.map(Wanted::Indices)
                    .ok_or_else(|| format!("the element {} lacks the property list vertex_indices", self.name))
            }
            _ => Ok(Wanted::Nothing),
        }
    }
}

/// What is kept of an element.
#[derive(Default)]
struct Values {
    position: [f64; 3],
    indices: Vec<i64>,
}

/// The bytes after the header.
struct Body<'a> {
    tokens: Tokens<'a>,
    encoding: Encoding,
}

impl Body<'_> {
    /// The line, in a text.
    fn line(&self) -> Option<usize> {
        (self.encoding == Encoding::Text).then(|| self.tokens.last_line())
    }

    fn at_end(&self) -> bool {
        match self.encoding {
            Encoding::Text => self.tokens.clone().next().is_none(),
            _ => self.tokens.left() == 0,
        }
    }

    /// What stands on an element's line behind its values is passed over.
    fn end_element(&mut self) {
        if self.encoding == Encoding::Text {
            self.tokens.rest_of_line();
        }
    }

    fn element(&mut self, element: &Element, wanted: &Wanted) -> Result<Values, Fault> {
        let mut values = Values::default();
        for (place, property) in element.properties.iter().enumerate() {
            let count = match property.length {
                Some(kind) => self.length(kind)?,
                None => 1,
            };
            match wanted {
                Wanted::Position(places) if places.contains(&place) => {
                    let number = property.kind.read(&mut self.tokens, self.encoding, 1, "a coordinate")?.into_floats();
                    let number = match property.kind {
                        // As many digits as the property has, however many are written.
                        Kind::Float32 => f64::from(number[0] as f32),
                        _ => number[0],
                    };
                    for (axis, _) in places.iter().enumerate().filter(|&(_, &at)| at == place) {
                        values.position[axis] = number;
                    }
                }
                Wanted::Indices(at) if *at == place => {
                    let numbers = property.kind.read(&mut self.tokens, self.encoding, count, "a list of vertices")?;
                    values.indices = numbers.into_integers().expect("lists of floats are refused");
                }
                _ => self.pass(property.kind, count)?,
            }
        }
        Ok(values)
    }

    fn length(&mut self, kind: Kind) -> Result<u64, Fault> {
        let number = kind.read(&mut self.tokens, self.encoding, 1, "the length of a list")?.into_floats()[0];
        // A whole number below 2^53, or too many for any file.
        if number >= 0.0 { Ok(number as u64) } else { Err((self.line(), format!("the length of a list is {number}"))) }
    }

    /// Passes over values, whatever they are.
    fn pass(&mut self, kind: Kind, count: u64) -> Result<(), Fault> {
        if self.encoding == Encoding::Text {
            return (0..count).try_for_each(|_| self.tokens.expect("a value").map(|_| ()));
        }
        let size = usize::try_from(count).ok().and_then(|count| count.checked_mul(kind.size()));
        let size = size.ok_or_else(|| (None, format!("a list of {count} values is longer than the file")))?;
        self.tokens.bytes(size, "the values of an element").map(|_| ())
    }
}

//! GIFTI surfaces, as neuroimaging has them: XML with an array of points and one of triangles, each as text or in base64, plain or
//! compressed; the file itself may be packed by gzip (`.gii.gz`).

use std::borrow::Cow;
use std::io::Read;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::read::{GzDecoder, ZlibDecoder};
use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};

use super::cells::{Cells, Contents, Shape};
use super::numbers::{Encoding, Kind, Numbers};
use super::tokens::{Fault, Tokens, line_at};

/// How many times its size a file may take in memory; arrays of points and triangles, which do not repeat, are far below.
const LARGEST_EXPANSION: u64 = 100;
/// What is allowed on top, so that a small file may hold what it likes.
const SMALL: u64 = 1 << 24;
const POINTS: &str = "NIFTI_INTENT_POINTSET";
const TRIANGLES: &str = "NIFTI_INTENT_TRIANGLE";

/// Reads the points and the triangles of a file; other arrays (curvature, labels) are passed over, and so is the transform to
/// other coordinates, which is affine and read by no map.
pub(super) fn parse(bytes: &[u8]) -> Result<Contents, Fault> {
    let unpacked = unpacked(bytes)?;
    let text = std::str::from_utf8(&unpacked).map_err(|error| {
        (Some(line_at(&unpacked, error.valid_up_to())), "not UTF-8: the file is damaged or no GIFTI".to_owned())
    })?;
    let mut arrays: Vec<(Array, &str, usize)> = Vec::new();
    let (mut is_gifti, mut is_data) = (false, false);
    let mut reader = Reader::from_str(text);
    loop {
        let at = reader.buffer_position() as usize;
        let here = |message: String| (Some(line_at(text.as_bytes(), at)), message);
        match reader.read_event().map_err(|error| here(format!("broken XML: {error}")))? {
            Event::Start(tag) => match tag.name().as_ref() {
                "GIFTI" => is_gifti = true,
                "DataArray" => arrays.push((Array::of(&tag).map_err(here)?, "", at)),
                "Data" => is_data = true,
                _ => {}
            },
            Event::Text(_) if is_data => {
                if let Some((_, data, from)) = arrays.last_mut() {
                    (*data, *from) = (&text[at..reader.buffer_position() as usize], at);
                }
            }
            Event::End(tag) => match tag.name().as_ref() {
                "GIFTI" => break,
                "Data" => is_data = false,
                _ => {}
            },
            Event::Eof if is_gifti => return Err(here("the file ends before `</GIFTI>`: it is truncated".into())),
            Event::Eof => return Err((Some(1), "there is no element `GIFTI`: it is no GIFTI file".into())),
            _ => {}
        }
    }
    let mut budget = (bytes.len() as u64).saturating_mul(LARGEST_EXPANSION).saturating_add(SMALL);
    let mut rows_of = |intent: &str| {
        let mut of_intent = arrays.iter().filter(|(array, ..)| array.intent == intent);
        let (array, data, at) =
            of_intent.next().ok_or_else(|| (None, format!("there is no array of {intent}: the file is no surface")))?;
        let line = line_at(text.as_bytes(), *at);
        match of_intent.next() {
            Some(_) => Err((Some(line), format!("several arrays of {intent}; give each surface a file of its own"))),
            None => array.decode(data, line, &mut budget),
        }
    };
    let coordinates = rows_of(POINTS)?.into_floats();
    let corners = rows_of(TRIANGLES)?.into_integers();
    let corners = corners.ok_or_else(|| (None, "the triangles should be of whole numbers".to_owned()))?;
    let mut cells = Cells::default();
    corners.chunks_exact(3).for_each(|triangle| cells.push(Shape::Polygon(3), triangle));
    cells.finish(coordinates, Vec::new())
}

/// The XML of a file that gzip may have packed.
fn unpacked(bytes: &[u8]) -> Result<Cow<'_, [u8]>, Fault> {
    const GZIP: [u8; 2] = [0x1F, 0x8B];
    if !bytes.starts_with(&GZIP) {
        return Ok(Cow::Borrowed(bytes));
    }
    let most = (bytes.len() as u64).saturating_mul(LARGEST_EXPANSION).saturating_add(SMALL);
    inflated(GzDecoder::new(bytes), most).map(Cow::Owned).map_err(|message| (None, message))
}

/// All that a decoder gives; refused if that is more than `most` bytes.
fn inflated(decoder: impl Read, most: u64) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    let read = decoder.take(most.saturating_add(1)).read_to_end(&mut bytes);
    read.map_err(|error| format!("it cannot be decompressed: {error}; it is damaged or truncated"))?;
    if bytes.len() as u64 > most {
        return Err(format!("it decompresses to more than {most} bytes: it is damaged or a trap"));
    }
    Ok(bytes)
}

/// What a `DataArray` says of its numbers.
struct Array {
    intent: String,
    /// `None` for a type that is not read.
    kind: Option<Kind>,
    encoding: String,
    big_endian: bool,
    by_columns: bool,
    /// Of rows and of numbers in a row.
    sizes: [u64; 2],
}

impl Array {
    fn of(tag: &BytesStart) -> Result<Self, String> {
        let attribute = |name: &str| {
            let found = tag.try_get_attribute(name).map_err(|error| format!("broken XML: {error}"))?;
            let value =
                found.map(|found| found.normalized_value(XmlVersion::Implicit1_0).map(|value| value.into_owned()));
            value.transpose().map(Option::unwrap_or_default).map_err(|error| format!("broken XML: {error}"))
        };
        let size = |name: &str| {
            let text = attribute(name)?;
            // One number in a row, where there is one dimension.
            if text.is_empty() {
                Ok(1)
            } else {
                text.trim().parse().map_err(|_| format!("`{name}` is {text:?}, no size"))
            }
        };
        Ok(Self {
            intent: attribute("Intent")?,
            kind: match attribute("DataType")?.as_str() {
                "NIFTI_TYPE_UINT8" => Some(Kind::UInt8),
                "NIFTI_TYPE_INT32" => Some(Kind::Int32),
                "NIFTI_TYPE_UINT32" => Some(Kind::UInt32),
                "NIFTI_TYPE_INT64" => Some(Kind::Int64),
                "NIFTI_TYPE_FLOAT32" => Some(Kind::Float32),
                "NIFTI_TYPE_FLOAT64" => Some(Kind::Float64),
                _ => None,
            },
            encoding: attribute("Encoding")?,
            big_endian: attribute("Endian")? == "BigEndian",
            by_columns: attribute("ArrayIndexingOrder")? == "ColumnMajorOrder",
            sizes: [size("Dim0")?, size("Dim1")?],
        })
    }

    /// The rows of three numbers each, one after the other; takes what they need from the budget.
    fn decode(&self, data: &str, line: usize, budget: &mut u64) -> Result<Numbers, Fault> {
        let name = format!("the array {}", self.intent);
        let explain = |message: String| (Some(line), format!("{name}: {message}"));
        let kind = self.kind.ok_or_else(|| explain("its type is none that is read".into()))?;
        let [rows, columns] = self.sizes;
        if columns != 3 {
            return Err(explain(format!("its rows have {columns} numbers, not 3")));
        }
        let count = rows.saturating_mul(3);
        let size = count.saturating_mul(kind.size() as u64);
        let trap = || explain(format!("{rows} rows are more than a file of this size holds"));
        *budget = budget.checked_sub(count.saturating_mul(size_of::<f64>() as u64)).ok_or_else(trap)?;
        let bytes = || {
            let digits: Vec<u8> = data.bytes().filter(|byte| !byte.is_ascii_whitespace()).collect();
            STANDARD.decode(digits).map_err(|error| explain(format!("broken base64: {error}")))
        };
        let bytes = match self.encoding.as_str() {
            "ASCII" => {
                let mut tokens = Tokens::starting_at(data.as_bytes(), line);
                let numbers = kind.read(&mut tokens, Encoding::Text, count, &name)?;
                return match tokens.next() {
                    Some(token) => Err((Some(token.line), format!("{name} has more than its {count} numbers"))),
                    None => Ok(self.by_rows(numbers)),
                };
            }
            "Base64Binary" => bytes()?,
            "GZipBase64Binary" => inflated(ZlibDecoder::new(&*bytes()?), size).map_err(explain)?,
            "ExternalFileBinary" => {
                return Err(explain("its numbers are in another file; save it with them inside".into()));
            }
            other => return Err(explain(format!("its encoding is {other:?}"))),
        };
        if bytes.len() as u64 != size {
            return Err(explain(format!("it has {} bytes, but {rows} rows need {size}", bytes.len())));
        }
        Ok(self.by_rows(kind.decode(&bytes, self.big_endian)))
    }

    fn by_rows(&self, numbers: Numbers) -> Numbers {
        fn transposed<T: Copy>(numbers: Vec<T>) -> Vec<T> {
            let rows = numbers.len() / 3;
            (0..numbers.len()).map(|i| numbers[i % 3 * rows + i / 3]).collect()
        }
        match numbers {
            numbers if !self.by_columns => numbers,
            Numbers::Integers(numbers) => Numbers::Integers(transposed(numbers)),
            Numbers::Floats(numbers) => Numbers::Floats(transposed(numbers)),
        }
    }
}

//! The arrays of a `.vtu` file, from text, base64 or raw bytes, decompressed within bounds.

use std::borrow::Cow;
use std::cell::Cell;
use std::io::Read;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::read::ZlibDecoder;

use crate::mesh::io::numbers::{Encoding, Kind, Numbers};
use crate::mesh::io::tokens::{Fault, Tokens, line_at};

/// How many times the size of a file all its arrays may take in memory. zlib goes up to 1032 for bytes that are all the
/// same, as flags may be; but points and indices do not repeat, so that a file with 100 constant arrays is within.
const LARGEST_EXPANSION: u64 = 100;
/// What is allowed on top, so that a small file may hold what it likes.
const SMALL: u64 = 1 << 24;

/// What the root element says of all arrays.
pub(super) struct Layout {
    big_endian: bool,
    /// The type of the numbers that tell sizes.
    header: Kind,
    compressor: Option<Compressor>,
}

/// How blocks are compressed.
#[derive(Clone, Copy)]
enum Compressor {
    Zlib,
    /// Bare blocks of LZ4.
    Lz4,
    /// Streams of XZ.
    Lzma,
}

impl Layout {
    /// From the attributes of `VTKFile`, with VTK's defaults.
    pub(super) fn new(
        byte_order: Option<&str>,
        header_type: Option<&str>,
        compressor: Option<&str>,
    ) -> Result<Self, String> {
        Ok(Self {
            big_endian: match byte_order {
                None | Some("LittleEndian") => false,
                Some("BigEndian") => true,
                Some(other) => return Err(format!("`byte_order` is {other:?}")),
            },
            header: match header_type {
                None | Some("UInt32") => Kind::UInt32,
                Some("UInt64") => Kind::UInt64,
                Some(other) => return Err(format!("`header_type` is {other:?}, but should be UInt32 or UInt64")),
            },
            compressor: match compressor {
                None | Some("") => None,
                Some("vtkZLibDataCompressor") => Some(Compressor::Zlib),
                Some("vtkLZ4DataCompressor") => Some(Compressor::Lz4),
                Some("vtkLZMADataCompressor") => Some(Compressor::Lzma),
                Some(other) => {
                    return Err(format!(
                        "the compressor {other:?} is not known here; write the file with zlib or none"
                    ));
                }
            },
        })
    }
}

/// One `DataArray`.
pub(super) struct Array<'a> {
    pub(super) name: String,
    /// None for a type that is not read.
    pub(super) kind: Option<Kind>,
    pub(super) components: u64,
    /// `ascii`, `binary` or `appended`.
    pub(super) format: String,
    /// Where the array starts in what is appended.
    pub(super) offset: Option<u64>,
    /// The element's text.
    pub(super) text: &'a [u8],
    /// Where the text (or the element, if it has none) starts in the file.
    pub(super) at: usize,
}

/// Decodes arrays, counting what they take.
pub(super) struct Arrays<'a> {
    layout: Layout,
    file: &'a [u8],
    /// Whether what is appended is base64, and the bytes from the first array on.
    appended: Option<(bool, &'a [u8])>,
    /// Where arrays start in what is appended, sorted: each ends where the next one starts.
    offsets: Vec<u64>,
    /// How many bytes the arrays may still take.
    budget: Cell<u64>,
}

impl<'a> Arrays<'a> {
    /// `appended_from` is where the element `AppendedData` starts to hold what it holds.
    pub(super) fn new(
        layout: Layout,
        file: &'a [u8],
        appended_from: Option<(bool, usize)>,
        mut offsets: Vec<u64>,
    ) -> Self {
        offsets.sort_unstable();
        let appended = appended_from.map(|(base64, from)| {
            let rest = file[from..].trim_ascii_start();
            let rest = rest.strip_prefix(b"_").unwrap_or(rest);
            let end = rest.iter().position(|&b| base64 && b == b'<').unwrap_or(rest.len());
            (base64, &rest[..end])
        });
        let budget = Cell::new((file.len() as u64).saturating_mul(LARGEST_EXPANSION).saturating_add(SMALL));
        Self { layout, file, appended, offsets, budget }
    }

    /// The line of a place in the file.
    fn line(&self, at: usize) -> usize {
        line_at(self.file, at)
    }

    /// The array's numbers: as many as `tuples` needs, or as many as are there.
    pub(super) fn decode(&self, array: &Array, tuples: Option<u64>) -> Result<Numbers, Fault> {
        let explain = |message: String| (Some(self.line(array.at)), format!("the array \"{}\": {message}", array.name));
        let kind = array.kind.ok_or_else(|| explain("its type is not a number of 8 to 64 bits".into()))?;
        let count = tuples.map(|tuples| tuples.saturating_mul(array.components));
        if array.format == "ascii" {
            return self.decode_text(array, kind, count);
        }
        let stored = match array.format.as_str() {
            "binary" => Cow::Owned(decode_base64(array.text).map_err(explain)?),
            "appended" => self.appended_bytes(array).map_err(explain)?,
            other => return Err(explain(format!("its format is {other:?}"))),
        };
        let size = count.map(|count| count.saturating_mul(kind.size() as u64));
        let bytes = self.unpack(&stored, size, kind).map_err(explain)?;
        Ok(kind.decode(&bytes, self.layout.big_endian))
    }

    /// [`Arrays::decode`] for indices.
    pub(super) fn integers(&self, array: &Array, tuples: Option<u64>) -> Result<Vec<i64>, Fault> {
        let values = self.decode(array, tuples)?.into_integers();
        values.ok_or_else(|| (Some(self.line(array.at)), format!("the array \"{}\" should be of integers", array.name)))
    }

    fn decode_text(&self, array: &Array, kind: Kind, count: Option<u64>) -> Result<Numbers, Fault> {
        let name = format!("the array \"{}\"", array.name);
        let mut tokens = Tokens::starting_at(array.text, self.line(array.at));
        let count = count.unwrap_or_else(|| tokens.clone().count() as u64);
        let numbers = kind.read(&mut tokens, Encoding::Text, count, &name)?;
        match tokens.next() {
            Some(token) => Err((Some(token.line), format!("{name} has more than the {count} numbers it should have"))),
            None => Ok(numbers),
        }
    }

    fn appended_bytes(&self, array: &Array) -> Result<Cow<'a, [u8]>, String> {
        let (base64, bytes) = self.appended.ok_or("it is said to be appended, but there is no `AppendedData`")?;
        let offset = array.offset.ok_or("it lacks the attribute `offset`")?;
        let after = self.offsets.partition_point(|&other| other <= offset);
        if after >= 2 && self.offsets[after - 2] == offset {
            return Err(format!("another array has the same offset {offset}"));
        }
        let end = self.offsets.get(after).map_or(bytes.len(), |&next| bytes.len().min(next as usize));
        let stored = usize::try_from(offset).ok().and_then(|offset| bytes.get(offset..end));
        let stored = stored.ok_or_else(|| {
            format!("it starts at {offset}, but only {} bytes are appended: the file is truncated", bytes.len())
        })?;
        if base64 { Ok(Cow::Owned(decode_base64(stored)?)) } else { Ok(Cow::Borrowed(stored)) }
    }

    /// Takes the sizes off the front and decompresses; the result has `expected` bytes where that is given.
    fn unpack<'b>(&self, stored: &'b [u8], expected: Option<u64>, kind: Kind) -> Result<Cow<'b, [u8]>, String> {
        let mut rest = stored;
        let Some(compressor) = self.layout.compressor else {
            let size = self.size(&mut rest)?;
            self.check_size(size, expected, kind)?;
            let bytes = usize::try_from(size).ok().and_then(|size| rest.get(..size));
            return bytes.map(Cow::Borrowed).ok_or_else(|| truncated(size, rest.len()));
        };
        let [blocks, block_size, last_size] = [self.size(&mut rest)?, self.size(&mut rest)?, self.size(&mut rest)?];
        // Zero for the last one's size: it is as large as the others.
        let partial = u64::from(last_size > 0 && blocks > 0);
        let whole = (blocks - partial).checked_mul(block_size);
        let total = whole.and_then(|whole| whole.checked_add(last_size * partial)).unwrap_or(u64::MAX);
        self.check_size(total, expected, kind)?;
        let header = blocks.saturating_mul(self.layout.header.size() as u64);
        if header > rest.len() as u64 {
            return Err(truncated(header, rest.len()));
        }
        let (mut sizes, mut data) = rest.split_at(header as usize);
        let mut bytes = Vec::new();
        for block in 0..blocks {
            let size = self.size(&mut sizes)?;
            let Some((packed, tail)) = usize::try_from(size).ok().and_then(|size| data.split_at_checked(size)) else {
                return Err(truncated(size, data.len()));
            };
            data = tail;
            let unpacked = if block + 1 == blocks && partial == 1 { last_size } else { block_size };
            let before = bytes.len() as u64;
            compressor
                .unpack(packed, unpacked, &mut bytes)
                .map_err(|error| format!("block {block} cannot be decompressed: {error}"))?;
            if bytes.len() as u64 - before != unpacked {
                return Err(format!("block {block} does not decompress to the {unpacked} bytes it announces"));
            }
        }
        Ok(Cow::Owned(bytes))
    }

    /// The next number of a header.
    fn size(&self, rest: &mut &[u8]) -> Result<u64, String> {
        let width = self.layout.header.size();
        let Some((digits, tail)) = rest.split_at_checked(width) else {
            return Err(truncated(width as u64, rest.len()));
        };
        *rest = tail;
        let fold = |sum: u64, &byte: &u8| sum << 8 | u64::from(byte);
        Ok(if self.layout.big_endian { digits.iter().fold(0, fold) } else { digits.iter().rev().fold(0, fold) })
    }

    /// Refuses a size that is not the expected one, or with which the file would take too much memory.
    fn check_size(&self, size: u64, expected: Option<u64>, kind: Kind) -> Result<(), String> {
        if let Some(expected) = expected.filter(|&expected| expected != size) {
            return Err(format!("it announces {size} bytes, but {expected} are needed"));
        }
        let needed = (size / kind.size() as u64).saturating_mul(size_of::<f64>() as u64);
        let left = self.budget.get().checked_sub(needed).ok_or_else(|| {
            format!(
                "it announces {size} bytes, over {LARGEST_EXPANSION} times what the file has: it is damaged or a trap"
            )
        })?;
        self.budget.set(left);
        Ok(())
    }
}

impl Compressor {
    /// Appends what a block holds; a block that holds more than `size` bytes fails or is cut, but is not unpacked whole.
    fn unpack(self, packed: &[u8], size: u64, bytes: &mut Vec<u8>) -> Result<(), String> {
        match self {
            // One byte more than there should be tells a block that is too long.
            Self::Zlib => {
                let read = ZlibDecoder::new(packed).take(size.saturating_add(1)).read_to_end(bytes);
                read.map(|_| ()).map_err(|error| error.to_string())
            }
            Self::Lz4 => {
                let (start, size) = (bytes.len(), usize::try_from(size).map_err(|error| error.to_string())?);
                bytes.resize(start + size, 0);
                let there = lz4_flex::block::decompress_into(packed, &mut bytes[start..]);
                bytes.truncate(start + there.map_err(|error| error.to_string())?);
                Ok(())
            }
            Self::Lzma => {
                if xz_size(packed) != Some(size) {
                    return Err("its stream of XZ is damaged or holds another number of bytes".into());
                }
                let mut packed = packed;
                lzma_rs::xz_decompress(&mut packed, bytes).map_err(|error| format!("{error:?}"))
            }
        }
    }
}

/// How many bytes an XZ stream of one LZMA2 block holds, by the heads of its chunks: the decoder keeps a whole block in
/// memory, whatever its size. (XZ format 1.1.0, sections 2.1 and 3.1; the chunks as in liblzma.)
fn xz_size(stream: &[u8]) -> Option<u64> {
    let block = stream.get(12..)?;
    let mut rest = block.get(4 * (usize::from(*block.first()?) + 1)..)?;
    let mut size = 0;
    loop {
        let (&control, tail) = rest.split_first()?;
        let word = |at: usize| Some(u64::from(*tail.get(at)?) << 8 | u64::from(*tail.get(at + 1)?));
        let (chunk, length) = match control {
            0 => break,
            1 | 2 => (word(0)? + 1, 2 + word(0)? + 1),
            0x80.. => {
                let properties = u64::from(control >= 0xC0);
                (u64::from(control & 0x1F) << 16 | word(0)?, 4 + properties + word(2)? + 1)
            }
            _ => return None,
        };
        size += if control >= 0x80 { chunk + 1 } else { chunk };
        rest = tail.get(usize::try_from(length).ok()?..)?;
    }
    // After the end mark: padding and a check of at most 64 bytes, then the index, which starts with 0 and the count 1.
    let after = stream.len() - rest.len() + 1;
    let check = match stream.get(7)? & 0xF {
        0 => 0,
        1 => 4,
        4 => 8,
        10 => 32,
        _ => return None,
    };
    let index = after.next_multiple_of(4) + check;
    // The footer's size of the index, to which the decoder adds 1.
    if stream.get(stream.len() - 8..)?.starts_with(&[0xFF; 4]) {
        return None;
    }
    (stream.get(index..index + 2)? == [0, 1]).then_some(size)
}

fn truncated(needed: u64, there: usize) -> String {
    format!("{needed} bytes are needed, {there} are there: the file is truncated")
}

/// Base64 in one or several parts, each with its own padding, as VTK writes sizes and data.
fn decode_base64(text: &[u8]) -> Result<Vec<u8>, String> {
    let digits: Vec<u8> = text.iter().copied().filter(|b| !b.is_ascii_whitespace()).collect();
    let mut bytes = Vec::with_capacity(digits.len() / 4 * 3);
    for part in digits.chunk_by(|&a, &b| a != b'=' || b == b'=') {
        STANDARD.decode_vec(part, &mut bytes).map_err(|error| format!("broken base64: {error}"))?;
    }
    Ok(bytes)
}

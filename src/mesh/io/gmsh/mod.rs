//! Gmsh's `.msh`, versions 1, 2, 4.0 and 4.1, text or (but for the first) binary.
//!
//! A file is a list of sections `$Name ... $EndName`; nodes and elements carry tags by which others refer to them. Read
//! by ourselves: mshio 0.4.2 (2020) refuses version 2.2, panicked on 55 of 20,000 binary files with one to three random
//! changes, and needs nom 5, syn 1 and num 0.3, which nothing else here does.

mod elements;
mod write;

pub(super) use write::{write_version_2, write_version_4};

use std::collections::HashMap;

use super::cells::Contents;
use super::numbers::{Encoding, Kind};
use super::tokens::{Fault, Token, Tokens};
use elements::Elements;

/// Reads the nodes, the elements and the scalar `$ElementData` of a file; tags may be any distinct numbers.
pub(super) fn parse(bytes: &[u8]) -> Result<Contents, Fault> {
    let mut source = Source {
        tokens: Tokens::new(bytes),
        encoding: Encoding::Text,
        size: Kind::UInt64,
        version: Version::Two,
        line_reliable: true,
    };
    read_sections(&mut source).map_err(|(line, message)| (line.filter(|_| source.line_reliable), message))
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Version {
    One,
    Two,
    /// 4.0, with a tag before each node's and element's numbers.
    Four,
    /// 4.1, with all tags of a block before its coordinates.
    FourOne,
}

/// A file being read, and how its numbers stand in it.
struct Source<'a> {
    tokens: Tokens<'a>,
    encoding: Encoding,
    /// The type of sizes and, from 4.1 on, of tags.
    size: Kind,
    version: Version,
    /// Whether the count of lines can be believed: not after binary numbers.
    line_reliable: bool,
}

impl Source<'_> {
    fn is_text(&self) -> bool {
        self.encoding == Encoding::Text
    }

    fn integers(&mut self, kind: Kind, count: u64, what: &str) -> Result<Vec<i64>, Fault> {
        let numbers = kind.read(&mut self.tokens, self.encoding, count, what)?;
        Ok(numbers.into_integers().expect("an integer type was asked for"))
    }

    fn floats(&mut self, count: u64, what: &str) -> Result<Vec<f64>, Fault> {
        Ok(Kind::Float64.read(&mut self.tokens, self.encoding, count, what)?.into_floats())
    }

    /// `N` integers of one type.
    fn fixed<const N: usize>(&mut self, kind: Kind, what: &str) -> Result<[i64; N], Fault> {
        let numbers = self.integers(kind, N as u64, what)?;
        Ok(numbers.try_into().expect("as many as asked for"))
    }

    /// A count that binary and text files alike write as text, on a line of its own.
    fn text_count(&mut self, least_bytes: usize, what: &str) -> Result<usize, Fault> {
        let count = self.tokens.bounded_count(what, least_bytes)?;
        self.end_text_line();
        Ok(count)
    }

    /// Goes to the first byte of a binary section.
    fn end_text_line(&mut self) {
        if !self.is_text() {
            self.tokens.rest_of_line();
        }
    }

    fn fault(&self, message: String) -> Fault {
        (Some(self.tokens.line()), message)
    }
}

fn read_sections(source: &mut Source) -> Result<Contents, Fault> {
    let (mut has_format, mut nodes, mut elements) = (false, None, None::<Elements>);
    let mut data = Vec::new();
    while let Some(keyword) = source.tokens.next() {
        let Some(name) = keyword.text.strip_prefix(b"$") else {
            let message = format!("{} stands where a section `$Name` should start", keyword.shown());
            return Err((Some(keyword.line), message));
        };
        match name {
            b"MeshFormat" => {
                read_format(source)?;
                has_format = true;
            }
            // Version 1 has no format, and other names.
            b"NOD" if !has_format => {
                (has_format, source.version) = (true, Version::One);
                nodes = Some(Nodes::read(source, false)?);
            }
            b"ELM" if source.version == Version::One => elements.get_or_insert_default().read(source)?,
            _ if !has_format => {
                return Err((Some(keyword.line), "the file does not start with `$MeshFormat`: it is no .msh".into()));
            }
            b"Nodes" | b"ParametricNodes" if nodes.is_some() => {
                return Err((Some(keyword.line), "a second section `$Nodes`".into()));
            }
            b"Nodes" => nodes = Some(Nodes::read(source, false)?),
            b"ParametricNodes" => nodes = Some(Nodes::read(source, true)?),
            b"Elements" => elements.get_or_insert_default().read(source)?,
            b"ElementData" => data.extend(elements::read_data(source)?),
            _ => {
                skip_section(source, keyword, name)?;
                continue;
            }
        }
        let end = source.tokens.expect("the end of a section")?;
        let end_of = |mark: &[u8]| end.text.strip_prefix(mark) == Some(name);
        let is_end = end_of(b"$End") || source.version == Version::One && end_of(b"$END");
        if !is_end {
            let message = format!("{} stands where the section {} should end", end.shown(), keyword.shown());
            return Err((Some(end.line), message));
        }
    }
    let missing = |name| (None, format!("there is no section `{name}`: the file is truncated or holds no mesh"));
    let (nodes, elements) = (nodes.ok_or_else(|| missing("$Nodes"))?, elements.ok_or_else(|| missing("$Elements"))?);
    elements.finish(nodes, data)
}

fn skip_section(source: &mut Source, keyword: Token, name: &[u8]) -> Result<(), Fault> {
    let mark = [b"$End", name].concat();
    if source.tokens.skip_past(&mark) {
        return Ok(());
    }
    Err((Some(keyword.line), format!("there is no `{}`: the file is truncated", mark.escape_ascii())))
}

fn read_format(source: &mut Source) -> Result<(), Fault> {
    let version = source.tokens.expect("the version")?;
    source.version = match version.text {
        b"2" | b"2.0" | b"2.1" | b"2.2" => Version::Two,
        b"4" | b"4.0" => Version::Four,
        b"4.1" => Version::FourOne,
        _ => {
            let message = format!("version {} of .msh is not read; save it as 4.1 or 2.2", version.shown());
            return Err((Some(version.line), message));
        }
    };
    let binary: u8 = source.tokens.number("the file type", "0 (text) or 1 (binary)")?;
    let size = source.tokens.expect("the size of numbers")?;
    source.size = match size.text {
        b"8" => Kind::UInt64,
        b"4" if source.version == Version::FourOne => Kind::UInt32,
        _ => return Err((Some(size.line), format!("the size of numbers is {}, but should be 8", size.shown()))),
    };
    if binary != 0 {
        source.tokens.rest_of_line();
        source.encoding = match source.tokens.bytes(4, "the number that tells the byte order")? {
            [1, 0, 0, 0] => Encoding::LittleEndian,
            [0, 0, 0, 1] => Encoding::BigEndian,
            _ => return Err(source.fault("the number that tells the byte order is not 1".into())),
        };
        source.line_reliable = false;
    }
    Ok(())
}

/// The points, and where each tag stands among them.
struct Nodes {
    coordinates: Vec<f64>,
    places: Places,
}

impl Nodes {
    fn read(source: &mut Source, parametric: bool) -> Result<Self, Fault> {
        let (mut tags, mut coordinates) = (Vec::new(), Vec::new());
        match source.version {
            Version::One | Version::Two => {
                let count = source.text_count(8, "the count of $Nodes")?;
                for _ in 0..count {
                    let [tag] = source.fixed(Kind::Int32, "the number of a node")?;
                    tags.push(tag);
                    coordinates.extend(source.floats(3, "the coordinates of a node")?);
                    if parametric {
                        let [dimension, _] = source.fixed(Kind::Int32, "the entity of a node")?;
                        // On a curve or surface the node has its parameters there.
                        let parameters = if dimension < 3 { dimension.max(0) as u64 } else { 0 };
                        source.floats(parameters, "the parameters of a node")?;
                    }
                }
            }
            Version::Four => {
                source.end_text_line();
                let [blocks, _] = source.fixed(source.size, "the counts of $Nodes")?;
                for _ in 0..blocks.max(0) {
                    let [_, dimension, parametric] = source.fixed(Kind::Int32, "the head of a block of nodes")?;
                    let [count] = source.fixed(source.size, "the count of a block of nodes")?;
                    let columns = columns(dimension, parametric);
                    for _ in 0..source.tokens.check_room(count as u64, 8, "the count of a block of nodes")? {
                        let [tag] = source.fixed(Kind::Int32, "the tag of a node")?;
                        tags.push(tag);
                        let row = source.floats(columns as u64, "the coordinates of a node")?;
                        coordinates.extend_from_slice(&row[..3]);
                    }
                }
            }
            Version::FourOne => {
                source.end_text_line();
                let [blocks, ..] = source.fixed::<4>(source.size, "the counts of $Nodes")?;
                for _ in 0..blocks.max(0) {
                    let [dimension, _, parametric] = source.fixed(Kind::Int32, "the head of a block of nodes")?;
                    let [count] = source.fixed(source.size, "the count of a block of nodes")?;
                    tags.extend(source.integers(source.size, count as u64, "the tags of nodes")?);
                    let columns = columns(dimension, parametric);
                    let numbers = (count as u64).saturating_mul(columns as u64);
                    let rows = source.floats(numbers, "the coordinates of nodes")?;
                    rows.chunks_exact(columns).for_each(|row| coordinates.extend_from_slice(&row[..3]));
                }
            }
        }
        let places = Places::new(&tags).map_err(|tag| (None, format!("two nodes have the tag {tag}")))?;
        Ok(Self { coordinates, places })
    }
}

/// Nodes on a curve or surface may have their parameters behind their coordinates.
fn columns(dimension: i64, parametric: i64) -> usize {
    3 + if parametric == 0 { 0 } else { dimension.clamp(0, 3) as usize }
}

/// Where each tag stands in a list.
enum Places {
    /// The tags are 1, 2, 3 ..., as they mostly are; holds how many.
    InOrder(i64),
    Any(HashMap<i64, i64>),
}

impl Places {
    /// Fails with a tag that occurs twice.
    fn new(tags: &[i64]) -> Result<Self, i64> {
        if (1i64..).zip(tags).all(|(number, &tag)| number == tag) {
            return Ok(Places::InOrder(tags.len() as i64));
        }
        let mut places = HashMap::with_capacity(tags.len());
        for (place, &tag) in (0i64..).zip(tags) {
            if places.insert(tag, place).is_some() {
                return Err(tag);
            }
        }
        Ok(Places::Any(places))
    }

    fn of(&self, tag: i64) -> Option<i64> {
        match self {
            Places::InOrder(count) => (1..=*count).contains(&tag).then(|| tag - 1),
            Places::Any(places) => places.get(&tag).copied(),
        }
    }
}

/// A number of `$ElementData`; meshio 5.3.5 with NumPy 2 writes `np.float64(1.5)`.
fn data_number(token: Token) -> Result<f64, Fault> {
    let text = token.text.strip_prefix(b"np.float64(").and_then(|text| text.strip_suffix(b")")).unwrap_or(token.text);
    Token { text, ..token }.parse("a number of $ElementData", "a number")
}

//! Legacy `.vtk` files, text or binary, versions 1 to 5.1.
//!
//! Three lines (version, title, ASCII or BINARY), then sections that each start with a keyword and their counts. Binary
//! numbers are big-endian. Since 5.0 CELLS holds offsets and connectivity, before it each cell's size and vertices.

use super::cells::{Grid, POLYGON, POLYLINE, STRIP};
use crate::mesh::io::cells::Contents;
use crate::mesh::io::numbers::{Encoding, Kind, Numbers};
use crate::mesh::io::tokens::{Fault, Token, Tokens};

/// Reads the points, cells and scalar cell data of an unstructured grid, or the polygons of POLYDATA.
pub(in crate::mesh::io) fn parse(bytes: &[u8]) -> Result<Contents, Fault> {
    let mut tokens = Tokens::new(bytes);
    if !bytes.starts_with(b"# vtk DataFile Version ") {
        return Err((
            Some(1),
            "the file does not start with `# vtk DataFile Version`: it is no legacy VTK file".into(),
        ));
    }
    tokens.rest_of_line();
    tokens.rest_of_line();
    let encoding = tokens.expect("the word ASCII or BINARY")?;
    let encoding = match encoding.text.to_ascii_uppercase().as_slice() {
        b"ASCII" => Encoding::Text,
        b"BINARY" => Encoding::BigEndian,
        _ => return Err((Some(encoding.line), format!("{} stands for ASCII or BINARY", encoding.shown()))),
    };
    let grid = Grid::default();
    let mut reader = Reader { tokens, encoding, grid, on_cells: None, has_points: false, is_surface: false };
    reader.sections().and_then(|()| reader.grid.into_contents()).map_err(|(line, message)| {
        // After binary data the count of lines is off.
        (line.filter(|_| encoding == Encoding::Text), message)
    })
}

struct Reader<'a> {
    tokens: Tokens<'a>,
    encoding: Encoding,
    grid: Grid,
    /// Whether the arrays that follow are on cells, and on how many cells or points; none before any such section.
    on_cells: Option<(bool, u64)>,
    has_points: bool,
    /// Whether the data set is POLYDATA, whose cells stand in a section for each kind and whose data is not read.
    is_surface: bool,
}

/// What the entries of an array are.
#[derive(Clone, Copy)]
enum Entry {
    Number(Kind),
    Bit,
    Text,
}

impl Reader<'_> {
    fn sections(&mut self) -> Result<(), Fault> {
        let mut has_cells = false;
        while let Some(keyword) = self.tokens.next() {
            match keyword.text.to_ascii_uppercase().as_slice() {
                b"DATASET" => {
                    let dataset = self.tokens.expect("the kind of the data set")?;
                    self.is_surface = dataset.text.eq_ignore_ascii_case(b"POLYDATA");
                    if !self.is_surface && !dataset.text.eq_ignore_ascii_case(b"UNSTRUCTURED_GRID") {
                        let message = format!(
                            "the data set is {}, neither an UNSTRUCTURED_GRID nor POLYDATA; save it as one of these",
                            dataset.shown()
                        );
                        return Err((Some(dataset.line), message));
                    }
                }
                b"POINTS" => {
                    once(keyword, &mut self.has_points)?;
                    let count = self.count("the count of POINTS")?;
                    let kind = self.kind("the type of POINTS")?;
                    self.grid.coordinates = self.values(kind, count.saturating_mul(3), "POINTS")?.into_floats();
                }
                b"CELLS" => {
                    once(keyword, &mut has_cells)?;
                    let (connectivity, ends) = self.cells()?;
                    (self.grid.connectivity, self.grid.ends) = (connectivity, ends);
                }
                name @ (b"VERTICES" | b"LINES" | b"POLYGONS" | b"TRIANGLE_STRIPS") if self.is_surface => {
                    has_cells = true;
                    let kind = match name {
                        b"POLYGONS" => POLYGON,
                        b"TRIANGLE_STRIPS" => STRIP,
                        _ => POLYLINE,
                    };
                    let (connectivity, ends) = self.cells()?;
                    self.grid.extend(&connectivity, &ends, kind);
                }
                b"CELL_TYPES" => {
                    let count = self.count("the count of CELL_TYPES")?;
                    self.grid.types = self.integers(Kind::Int32, count, "CELL_TYPES")?;
                }
                b"CELL_DATA" => self.on_cells = Some((true, self.count("the count of CELL_DATA")?)),
                b"POINT_DATA" => self.on_cells = Some((false, self.count("the count of POINT_DATA")?)),
                b"METADATA" => self.skip_metadata(),
                _ => self.attribute(keyword)?,
            }
        }
        if !self.has_points || !has_cells {
            let missing = match (has_cells, self.is_surface) {
                (true, _) => "POINTS",
                (false, false) => "CELLS",
                (false, true) => "POLYGONS",
            };
            return Err((None, format!("there is no section {missing}: the file is truncated or holds no mesh")));
        }
        Ok(())
    }

    /// The vertices of cells in a row, and where each cell ends there.
    fn cells(&mut self) -> Result<(Vec<i64>, Vec<i64>), Fault> {
        let [first, second] = [self.count("the first count of CELLS")?, self.count("the second count of CELLS")?];
        if self.tokens.next_if(|token| token.text.eq_ignore_ascii_case(b"OFFSETS")).is_none() {
            return self.old_cells(first, second);
        }
        let kind = self.kind("the type of OFFSETS")?;
        let mut offsets = self.integers(kind, first, "OFFSETS")?;
        let keyword = self.tokens.expect("CONNECTIVITY")?;
        if !keyword.text.eq_ignore_ascii_case(b"CONNECTIVITY") {
            return Err((Some(keyword.line), format!("{} stands where CONNECTIVITY should", keyword.shown())));
        }
        let kind = self.kind("the type of CONNECTIVITY")?;
        let connectivity = self.integers(kind, second, "CONNECTIVITY")?;
        if offsets.first().is_some_and(|&start| start != 0) {
            return Err((Some(keyword.line), "the first offset is not 0".into()));
        }
        offsets.drain(..offsets.len().min(1));
        Ok((connectivity, offsets))
    }

    /// Each cell's size, then its vertices; `size` numbers in all.
    fn old_cells(&mut self, count: u64, size: u64) -> Result<(Vec<i64>, Vec<i64>), Fault> {
        let list = self.integers(Kind::Int32, size, "CELLS")?;
        let wrong = |cell: usize| (None, format!("cell {cell} (counted from 0) does not fit into the list of CELLS"));
        let (mut connectivity, mut ends) = (Vec::with_capacity(list.len()), Vec::new());
        let mut rest = list.as_slice();
        while let Some((&length, tail)) = rest.split_first() {
            let cell = ends.len();
            let length = usize::try_from(length).map_err(|_| wrong(cell))?;
            let (vertices, tail) = tail.split_at_checked(length).ok_or_else(|| wrong(cell))?;
            connectivity.extend_from_slice(vertices);
            ends.push(connectivity.len() as i64);
            rest = tail;
        }
        let there = ends.len();
        if there as u64 != count {
            return Err((None, format!("CELLS announces {count} cells, but lists {there}")));
        }
        Ok((connectivity, ends))
    }

    /// One array of CELL_DATA or POINT_DATA, or field data; scalars on cells are kept.
    fn attribute(&mut self, keyword: Token) -> Result<(), Fault> {
        let upper = keyword.text.to_ascii_uppercase();
        if upper == b"FIELD" {
            return self.field();
        }
        let unknown = || (Some(keyword.line), format!("{} is no keyword of a legacy VTK file here", keyword.shown()));
        let (on_cells, count) = self.on_cells.ok_or_else(unknown)?;
        let name = self.tokens.expect("the name of an array")?;
        match upper.as_slice() {
            b"SCALARS" => {
                let kind = self.entry("the type of SCALARS")?;
                let components = match self.tokens.next_if(|token| token.line == keyword.line) {
                    Some(token) => token.parse("the number of components", "a whole number")?,
                    None => 1,
                };
                if self.tokens.next_if(|token| token.text.eq_ignore_ascii_case(b"LOOKUP_TABLE")).is_some() {
                    self.tokens.expect("the name of the lookup table")?;
                }
                self.array(name, kind, components, count, on_cells)
            }
            b"VECTORS" | b"NORMALS" | b"TENSORS" | b"TENSORS6" => {
                let kind = self.entry("the type of an array")?;
                let components = match upper.as_slice() {
                    b"TENSORS" => 9,
                    b"TENSORS6" => 6,
                    _ => 3,
                };
                self.array(name, kind, components, count, false)
            }
            b"TEXTURE_COORDINATES" => {
                let components = self.count("the dimension of TEXTURE_COORDINATES")?;
                let kind = self.entry("the type of TEXTURE_COORDINATES")?;
                self.array(name, kind, components, count, false)
            }
            b"GLOBAL_IDS" | b"PEDIGREE_IDS" => {
                let kind = self.entry("the type of ids")?;
                self.array(name, kind, 1, count, false)
            }
            b"COLOR_SCALARS" => {
                let components = self.count("the number of colour components")?;
                self.colours(name, components, count)
            }
            b"LOOKUP_TABLE" => {
                let size = self.count("the size of the lookup table")?;
                self.colours(name, 4, size)
            }
            _ => Err(unknown()),
        }
    }

    /// Bytes in a binary file, numbers from 0 to 1 in text; not kept.
    fn colours(&mut self, name: Token, components: u64, count: u64) -> Result<(), Fault> {
        let kind = if self.encoding == Encoding::Text { Kind::Float64 } else { Kind::UInt8 };
        self.array(name, Entry::Number(kind), components, count, false)
    }

    fn field(&mut self) -> Result<(), Fault> {
        self.tokens.expect("the name of the field")?;
        let arrays = self.count("the number of arrays of the field")?;
        for _ in 0..arrays {
            let mut name = self.tokens.expect("the name of an array of the field")?;
            while name.text == b"METADATA" {
                self.skip_metadata();
                name = self.tokens.expect("the name of an array of the field")?;
            }
            let components = self.count("the number of components of an array")?;
            let count = self.count("the length of an array")?;
            let kind = self.entry("the type of an array")?;
            let on_cells = self.on_cells.is_some_and(|(on_cells, _)| on_cells);
            self.array(name, kind, components, count, on_cells)?;
        }
        Ok(())
    }

    fn array(&mut self, name: Token, entry: Entry, components: u64, count: u64, keep: bool) -> Result<(), Fault> {
        let name = decode_name(name.text);
        let (total, what) = (count.saturating_mul(components), format!("the array \"{name}\""));
        match entry {
            Entry::Number(kind) => {
                let values = self.values(kind, total, &what)?;
                if keep && components == 1 && !self.is_surface {
                    self.grid.cell_data.push((name, values.into_floats()));
                }
                Ok(())
            }
            // A text file has a digit for each bit, a binary one a byte for eight.
            Entry::Bit if self.encoding == Encoding::Text => self.values(Kind::UInt8, total, &what).map(|_| ()),
            Entry::Bit => self.values(Kind::UInt8, total.div_ceil(8), &what).map(|_| ()),
            Entry::Text => self.pass_texts(total, &what),
        }
    }

    /// Passes over texts: each on a line of its own or, in a binary file, after its length.
    fn pass_texts(&mut self, count: u64, what: &str) -> Result<(), Fault> {
        self.tokens.rest_of_line();
        for _ in 0..self.tokens.check_room(count, 1, what)? {
            if self.encoding == Encoding::Text {
                self.tokens.rest_of_line();
                continue;
            }
            // The two highest bits of the first byte tell how many bytes the length takes; it is in the others.
            let first = self.tokens.bytes(1, what)?[0];
            let more = [7, 3, 1, 0][usize::from(first >> 6)];
            let start = u64::from(first & 0x3F);
            let length = self.tokens.bytes(more, what)?.iter().fold(start, |sum, &byte| sum << 8 | u64::from(byte));
            let length = usize::try_from(length).unwrap_or(usize::MAX);
            self.tokens.bytes(length, what)?;
        }
        Ok(())
    }

    fn skip_metadata(&mut self) {
        self.tokens.rest_of_line();
        while !self.tokens.rest_of_line().trim_ascii().is_empty() {}
    }

    fn count(&mut self, what: &str) -> Result<u64, Fault> {
        self.tokens.number(what, "a whole number >= 0")
    }

    /// The type of the entries that follow.
    fn entry(&mut self, what: &str) -> Result<Entry, Fault> {
        let texts = |token: Token| {
            ["bit", "string", "utf8_string"].iter().position(|name| token.text.eq_ignore_ascii_case(name.as_bytes()))
        };
        let place = self.tokens.clone().next().and_then(texts);
        match place {
            None => self.kind(what).map(Entry::Number),
            Some(place) => {
                self.tokens.next();
                Ok(if place == 0 { Entry::Bit } else { Entry::Text })
            }
        }
    }

    /// The type of the numbers that follow.
    fn kind(&mut self, what: &str) -> Result<Kind, Fault> {
        let token = self.tokens.expect(what)?;
        Ok(match token.text.to_ascii_lowercase().as_slice() {
            b"char" | b"signed_char" | b"vtktypeint8" => Kind::Int8,
            b"unsigned_char" | b"vtktypeuint8" => Kind::UInt8,
            b"short" | b"vtktypeint16" => Kind::Int16,
            b"unsigned_short" | b"vtktypeuint16" => Kind::UInt16,
            // VTK writes its ids as Int32 where it calls them so.
            b"int" | b"vtkidtype" | b"vtktypeint32" => Kind::Int32,
            b"unsigned_int" | b"vtktypeuint32" => Kind::UInt32,
            b"long" | b"vtktypeint64" => Kind::Int64,
            b"unsigned_long" | b"vtktypeuint64" => Kind::UInt64,
            b"float" => Kind::Float32,
            b"double" => Kind::Float64,
            _ => {
                let message = format!("{what} is {}, which is not read here; remove the array", token.shown());
                return Err((Some(token.line), message));
            }
        })
    }

    /// The numbers after a header line.
    fn values(&mut self, kind: Kind, count: u64, what: &str) -> Result<Numbers, Fault> {
        if self.encoding != Encoding::Text {
            self.tokens.rest_of_line();
        }
        kind.read(&mut self.tokens, self.encoding, count, what)
    }

    fn integers(&mut self, kind: Kind, count: u64, what: &str) -> Result<Vec<i64>, Fault> {
        let values = self.values(kind, count, what)?.into_integers();
        values.ok_or_else(|| (Some(self.tokens.line()), format!("{what} has numbers that are not whole")))
    }
}

fn once(keyword: Token, seen: &mut bool) -> Result<(), Fault> {
    if std::mem::replace(seen, true) {
        return Err((Some(keyword.line), format!("a second section {}", keyword.shown())));
    }
    Ok(())
}

/// VTK writes bytes that would break a name, such as spaces, as `%20`.
fn decode_name(text: &[u8]) -> String {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text;
    while let Some((&first, tail)) = rest.split_first() {
        let code = tail.get(..2).filter(|_| first == b'%').and_then(|digits| std::str::from_utf8(digits).ok());
        match code.and_then(|digits| u8::from_str_radix(digits, 16).ok()) {
            Some(byte) => {
                bytes.push(byte);
                rest = &tail[2..];
            }
            None => {
                bytes.push(first);
                rest = tail;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

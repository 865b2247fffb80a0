//! Medit's binary files: words of 32 bits (64 in later versions) that number a section, tell where the next one starts and
//! how many entries there are.

use super::CELLS;
use crate::mesh::io::cells::{Cells, Contents, Shape};
use crate::mesh::io::numbers::{Encoding, Kind};
use crate::mesh::io::tokens::{Fault, Tokens};

/// The numbers of the sections that are no cells.
const DIMENSION: i32 = 3;
const VERTICES: i32 = 4;
const END: i32 = 54;

/// A binary file and how its numbers stand in it.
pub(super) struct File<'a> {
    bytes: &'a [u8],
    encoding: Encoding,
    version: i64,
}

/// A section from its first entry on, with the count of entries.
struct Section<'a> {
    entries: Tokens<'a>,
    count: u64,
}

impl<'a> File<'a> {
    /// The file, if it starts as a binary one does: with 1 in either byte order and a version from 1 to 4.
    pub(super) fn of(bytes: &'a [u8]) -> Option<Self> {
        let encoding = match bytes.first_chunk::<4>()? {
            [1, 0, 0, 0] => Encoding::LittleEndian,
            [0, 0, 0, 1] => Encoding::BigEndian,
            _ => return None,
        };
        Some(Self { bytes, encoding, version: 1 })
    }

    pub(super) fn read(mut self) -> Result<Contents, Fault> {
        let plain = |(_, message): Fault| (None, message);
        self.read_sections().map_err(plain)
    }

    fn read_sections(&mut self) -> Result<Contents, Fault> {
        self.version = self.number(&mut self.at(4)?, Kind::Int32, "the version")?;
        if !(1..=4).contains(&self.version) {
            return Err((None, format!("the file says it is of version {}; 1 to 4 are read", self.version)));
        }
        let (mut place, mut vertices, mut sections) = (8, None, Vec::new());
        while place != 0 {
            let mut tokens = self.at(place)?;
            if tokens.left() == 0 {
                break;
            }
            let number = self.number(&mut tokens, Kind::Int32, "the number of a section")? as i32;
            if number == END {
                break;
            }
            let next = self.number(&mut tokens, self.position(), "where the next section starts")?;
            if next != 0 && next <= place as i64 {
                return Err((None, format!("the section at byte {place} says that the next one starts at {next}")));
            }
            match number {
                DIMENSION => {
                    let dimension = self.number(&mut tokens, Kind::Int32, "the dimension")?;
                    if dimension != 3 {
                        return Err((None, format!("the dimension is {dimension}; a mesh of a solid has 3")));
                    }
                }
                VERTICES => vertices = Some(self.section(tokens, "the count of vertices")?),
                _ => {
                    if let Some(&(_, _, shape, fields)) = CELLS.iter().find(|cell| cell.1 == number) {
                        sections.push((shape, fields, self.section(tokens, "the count of cells")?));
                    }
                }
            }
            place = usize::try_from(next).unwrap_or(0);
        }
        let vertices = vertices.ok_or_else(|| (None, "there is no section of vertices".to_owned()))?;
        if sections.iter().all(|(shape, ..)| *shape == Shape::Other) {
            return Err((None, "there is no section of tetrahedra".into()));
        }
        self.cells(vertices, sections)
    }

    fn cells(&self, mut vertices: Section<'a>, sections: Vec<(Shape, usize, Section<'a>)>) -> Result<Contents, Fault> {
        let mut coordinates = Vec::new();
        let real = if self.version == 1 { Kind::Float32 } else { Kind::Float64 };
        for _ in 0..vertices.count {
            let what = "the coordinates of a vertex";
            coordinates.extend(real.read(&mut vertices.entries, self.encoding, 3, what)?.into_floats());
            self.number(&mut vertices.entries, self.whole(), "the reference of a vertex")?;
        }
        let mut cells = Cells::default();
        for (shape, fields, mut section) in sections {
            if shape == Shape::Other {
                cells.skip(section.count as usize);
                continue;
            }
            for _ in 0..section.count {
                let row = self.whole().read(&mut section.entries, self.encoding, fields as u64 + 1, "a cell")?;
                let row = row.into_integers().expect("integers were asked for");
                // An index of 0 becomes -1, which is none.
                let row: Vec<i64> = row[..fields].iter().map(|index| index.saturating_sub(1)).collect();
                cells.push(shape, &row);
            }
        }
        cells.finish(coordinates, Vec::new())
    }

    fn section(&self, mut tokens: Tokens<'a>, what: &str) -> Result<Section<'a>, Fault> {
        let count = self.number(&mut tokens, self.whole(), what)?;
        // Every entry takes its reference at least.
        let count = tokens.check_room(u64::try_from(count).unwrap_or(u64::MAX), 4, what)?;
        Ok(Section { entries: tokens, count: count as u64 })
    }

    fn at(&self, place: usize) -> Result<Tokens<'a>, Fault> {
        let rest = self.bytes.get(place..);
        rest.map(Tokens::new).ok_or_else(|| (None, format!("a section starts at byte {place}, beyond the end")))
    }

    fn number(&self, tokens: &mut Tokens, kind: Kind, what: &str) -> Result<i64, Fault> {
        let numbers = kind.read(tokens, self.encoding, 1, what)?;
        Ok(numbers.into_integers().expect("integers were asked for")[0])
    }

    /// The type of indices and counts.
    fn whole(&self) -> Kind {
        if self.version >= 4 { Kind::Int64 } else { Kind::Int32 }
    }

    /// The type of places in the file.
    fn position(&self) -> Kind {
        if self.version >= 3 { Kind::Int64 } else { Kind::Int32 }
    }
}

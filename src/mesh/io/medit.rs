//! Medit's meshes, `.mesh` in ASCII and `.meshb` in binary: what TetGen, Gmsh, mmg and meshio read and write.
//!
//! A text is a stream of tokens, laid out over lines as one likes: keyword, count, entries. Indices count from 1, every
//! entry ends with a reference number (some writers leave all of them out), and `#` starts a comment.

mod binary;

use std::path::Path;

use super::cells::{Cells, Contents, Shape};
use super::tokens::{Fault, Token, Tokens};
use super::{ReadError, WriteError, write_atomically};
use crate::mesh::{TetSoup, Vec3, VertexId};

/// The sections of cells: keyword, number in binary files, kind, and how many vertices an entry names.
const CELLS: [(&str, i32, Shape, usize); 12] = [
    ("Edges", 5, Shape::Other, 2),
    ("Triangles", 6, Shape::Polygon(3), 3),
    ("Quadrilaterals", 7, Shape::Polygon(4), 4),
    ("Tetrahedra", 8, Shape::Tet, 4),
    ("Prisms", 9, Shape::Prism, 6),
    ("Hexahedra", 10, Shape::Hexahedron, 8),
    ("TrianglesP2", 24, Shape::Polygon(3), 6),
    ("QuadrilateralsQ2", 27, Shape::Polygon(4), 9),
    ("TetrahedraP2", 30, Shape::Tet, 10),
    ("HexahedraQ2", 33, Shape::Hexahedron, 27),
    ("Pyramids", 49, Shape::Pyramid, 5),
    ("EdgesP2", 25, Shape::Other, 3),
];

/// Sections of other volumes: skipping them would quietly drop a part of the solid.
const OTHER_CELLS: [&str; 4] = ["Wedges", "PrismsP2", "PyramidsP2", "TetrahedraP3"];

/// Reads the vertices and tetrahedra of a Medit file; surface and feature sections are skipped.
///
/// # Errors
/// The path, the line and what is wrong there.
pub fn read_medit(path: &Path) -> Result<TetSoup, ReadError> {
    let contents = parse(&super::text::plain(path, super::read_bytes(path)?)?).map_err(super::at(path))?;
    contents.into_tets().map(|file| file.soup).map_err(super::at(path))
}

/// Writes a Medit file; coordinates have 17 significant digits, so that reading gives the same bits.
///
/// # Errors
/// The path and the system's reason.
pub fn write_medit(path: &Path, points: &[Vec3], tets: &[[VertexId; 4]]) -> Result<(), WriteError> {
    write_atomically(path, |file| {
        writeln!(file, "MeshVersionFormatted 2\nDimension 3\nVertices\n{}", points.len())?;
        for p in points {
            writeln!(file, "{:.16e} {:.16e} {:.16e} 0", p.x, p.y, p.z)?;
        }
        writeln!(file, "Tetrahedra\n{}", tets.len())?;
        for [a, b, c, d] in tets.iter().map(|tet| tet.map(|v| u64::from(v.0) + 1)) {
            writeln!(file, "{a} {b} {c} {d} 0")?;
        }
        writeln!(file, "End")
    })
}

/// A section's entries: how many, and the tokens from the first one on.
struct Section<'a> {
    name: &'static str,
    count: usize,
    entries: Tokens<'a>,
    /// How many numbers an entry has before its reference.
    fields: usize,
    /// How many tokens there are up to the next keyword.
    tokens: usize,
}

impl<'a> Section<'a> {
    /// Reads the count, and refuses one that the rest of the file cannot hold before anything is reserved for it.
    fn open(name: &'static str, tokens: &mut Tokens<'a>, keyword: Token, fields: usize) -> Result<Self, Fault> {
        let token = tokens.next().ok_or_else(|| truncated(keyword.line, name, "its count"))?;
        let count: u64 = token.parse(&format!("the count of {name}"), "a whole number >= 0")?;
        // Every field takes a digit and a separator, but for the last of the file.
        let most = (tokens.left() as u64 + 1) / (2 * fields as u64);
        if count > most || count > u64::from(u32::MAX) {
            let message = format!(
                "{name} announces {count} entries, but the rest of the file has room for at most {most}: the count is \
                 wrong or the file is truncated; write it anew"
            );
            return Err((Some(token.line), message));
        }
        let entries = tokens.clone();
        let mut there = 0;
        while tokens.next_if(|token| !is_keyword(token) || is_non_finite(token)).is_some() {
            there += 1;
        }
        Ok(Self { name, count: count as usize, entries, fields, tokens: there })
    }

    /// Whether there are as many tokens as entries without references have.
    fn lacks_references(&self) -> bool {
        self.count == 0 || self.tokens == self.fields * self.count
    }

    /// Reads every entry with `read`, which is given a source of fields, and passes over its reference if there are
    /// `references`; then checks that nothing is left over.
    fn read(
        mut self,
        references: bool,
        mut read: impl FnMut(&mut dyn FnMut() -> Result<Token<'a>, Fault>) -> Result<(), Fault>,
    ) -> Result<(), Fault> {
        for number in 1..=self.count {
            let (name, count, entries) = (self.name, self.count, &mut self.entries);
            let mut field = || {
                let line = entries.line();
                let token =
                    entries.next().ok_or_else(|| truncated(line, name, &format!("entry {number} of {count}")))?;
                if is_keyword(token) && !is_non_finite(token) {
                    let message = format!(
                        "found {} within entry {number} of the {count} {name}: the section has fewer entries than it \
                         announces, or an entry lacks its reference number",
                        token.shown()
                    );
                    return Err((Some(token.line), message));
                }
                Ok(token)
            };
            read(&mut field)?;
            if references {
                // Some writers give real numbers here; nothing of it is used.
                field()?.parse::<f64>("the reference number that ends an entry", "a number")?;
            }
        }
        match self.entries.next() {
            Some(token) if !is_keyword(token) => {
                let message = format!(
                    "found {} after the last of the {} {}: the section has more entries than it announces, or longer ones",
                    token.shown(),
                    self.count,
                    self.name
                );
                Err((Some(token.line), message))
            }
            _ => Ok(()),
        }
    }
}

fn is_keyword(token: Token) -> bool {
    token.text[0].is_ascii_alphabetic()
}

/// `nan` and `inf` look like keywords, but deserve the message about coordinates.
fn is_non_finite(token: Token) -> bool {
    token.value::<f64>().is_some()
}

fn truncated(line: usize, section: &str, missing: &str) -> Fault {
    (
        Some(line),
        format!("the file ends within {section}, before {missing} is complete: it is truncated; write it anew"),
    )
}

pub(super) fn parse(bytes: &[u8]) -> Result<Contents, Fault> {
    if let Some(file) = binary::File::of(bytes) {
        return file.read();
    }
    let Sections { vertices, cells: sections } = find_sections(bytes)?;
    let references = !vertices.lacks_references() || !sections.iter().all(|(_, section)| section.lacks_references());
    let mut coordinates = Vec::with_capacity(3 * vertices.count);
    // Where a number stands that is not finite: one of a vertex that no tet names is of no account.
    let mut not_finite: Vec<(usize, Token)> = Vec::new();
    vertices.read(references, |field| {
        for _ in 0..3 {
            let token = field()?;
            let x: f64 = token.parse("a coordinate", "a number")?;
            if !x.is_finite() {
                not_finite.push((coordinates.len() / 3, token));
            }
            coordinates.push(x);
        }
        Ok(())
    })?;
    let count = coordinates.len() / 3;
    let mut named = vec![false; if not_finite.is_empty() { 0 } else { count }];
    let mut cells = Cells::default();
    // The triangles of a solid's mesh are of no interest, and TetGen announces more of them than it writes.
    let is_solid = |shape: Shape| !matches!(shape, Shape::Other | Shape::Polygon(_));
    let solid = sections.iter().any(|(shape, section)| is_solid(*shape) && section.count > 0);
    for (shape, section) in sections {
        if shape == Shape::Other || solid && !is_solid(shape) {
            cells.skip(section.count);
            continue;
        }
        let mut vertices = vec![0; section.fields];
        section.read(references, |field| {
            for vertex in &mut vertices {
                let token = field()?;
                let index: u64 = token.parse("a vertex index", "a whole number >= 1")?;
                if index == 0 || index > count as u64 {
                    let message =
                        format!("a cell names vertex {index}, but the vertices are 1 to {count} (Medit counts from 1)");
                    return Err((Some(token.line), message));
                }
                *vertex = index as i64 - 1;
                if let Some(named) = named.get_mut(index as usize - 1) {
                    *named = true;
                }
            }
            cells.push(shape, &vertices);
            Ok(())
        })?;
    }
    if let Some((_, token)) = not_finite.into_iter().find(|&(vertex, _)| named[vertex]) {
        let message = format!("a coordinate is {}; every coordinate must be finite", token.shown());
        return Err((Some(token.line), message));
    }
    cells.finish(coordinates, Vec::new())
}

/// What of a file is of interest.
struct Sections<'a> {
    vertices: Section<'a>,
    cells: Vec<(Shape, Section<'a>)>,
}

/// Walks over the keywords; the sections of interest are read afterwards, since they may come in any order.
fn find_sections(bytes: &[u8]) -> Result<Sections<'_>, Fault> {
    let mut tokens = Tokens::with_comments(bytes);
    let (mut vertices, mut cells) = (None, Vec::<(Shape, Section)>::new());
    let mut first = true;
    while let Some(token) = tokens.next() {
        if std::mem::take(&mut first) && token.text != b"MeshVersionFormatted" {
            let message = format!(
                "the file starts with {}, not with `MeshVersionFormatted`: it is not a Medit mesh",
                token.shown()
            );
            return Err((Some(token.line), message));
        }
        match token.text {
            b"Dimension" => {
                let dimension = tokens.next().ok_or_else(|| truncated(token.line, "Dimension", "its number"))?;
                if dimension.text != b"3" {
                    let message = format!("the dimension is {}; a mesh of a solid has 3", dimension.shown());
                    return Err((Some(dimension.line), message));
                }
            }
            b"Vertices" => {
                let section = Section::open("Vertices", &mut tokens, token, 3)?;
                if vertices.replace(section).is_some() {
                    return Err(second(token));
                }
            }
            b"End" => break,
            name => {
                if let Some(other) = OTHER_CELLS.iter().find(|other| other.as_bytes() == name) {
                    refuse_cells(other, token, &mut tokens)?;
                }
                if let Some(&(name, _, shape, fields)) = CELLS.iter().find(|cell| cell.0.as_bytes() == name) {
                    let section = Section::open(name, &mut tokens, token, fields)?;
                    if cells.iter().any(|(_, other)| other.name == name) {
                        return Err(second(token));
                    }
                    cells.push((shape, section));
                }
            }
        }
    }
    let missing =
        |name: &str| (None, format!("there is no section `{name}`; is this a mesh of a solid in Medit's format?"));
    let vertices = vertices.ok_or_else(|| missing("Vertices"))?;
    if cells.iter().all(|(shape, _)| *shape == Shape::Other) {
        return Err(missing("Tetrahedra"));
    }
    Ok(Sections { vertices, cells })
}

fn second(keyword: Token) -> Fault {
    (Some(keyword.line), format!("a second section {}; join the two into one", keyword.shown()))
}

fn refuse_cells(name: &str, keyword: Token, tokens: &mut Tokens) -> Result<(), Fault> {
    match tokens.next() {
        Some(count) if count.text != b"0" => {
            let message = format!("the mesh has {} {name}; split them into tetrahedra first", count.shown());
            Err((Some(keyword.line), message))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests;

//! Medit `.mesh`, ASCII: what TetGen, Gmsh, mmg and meshio read and write.
//!
//! A file is a stream of tokens, laid out over lines as one likes: keyword, count, entries. Indices count from 1, every
//! entry ends with a reference number, and `#` starts a comment.

use std::path::Path;

use super::tokens::{Fault, Token, Tokens};
use super::{ReadError, TetFile, WriteError, write_atomically};
use crate::mesh::{TetSoup, Vec3, VertexId};

/// Sections of volume cells that are not tetrahedra: skipping them would quietly drop a part of the solid.
const OTHER_CELLS: [&str; 4] = ["Hexahedra", "Prisms", "Pyramids", "Wedges"];

/// Reads the vertices and tetrahedra of a Medit file; surface and feature sections are skipped.
///
/// # Errors
/// The path, the line and what is wrong there.
pub fn read_medit(path: &Path) -> Result<TetSoup, ReadError> {
    super::read_tets_by(parse, path).map(|file| file.soup)
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
#[derive(Clone)]
struct Section<'a> {
    name: &'static str,
    count: usize,
    entries: Tokens<'a>,
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
        Ok(Self { name, count: count as usize, entries: tokens.clone() })
    }

    /// Reads every entry with `read`, which is given a source of fields; then checks that nothing is left over.
    fn read<T>(
        mut self,
        read: impl Fn(&mut dyn FnMut() -> Result<Token<'a>, Fault>) -> Result<T, Fault>,
    ) -> Result<Vec<T>, Fault> {
        let mut all = Vec::with_capacity(self.count);
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
            all.push(read(&mut field)?);
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
            _ => Ok(all),
        }
    }
}

fn is_keyword(token: Token) -> bool {
    token.text[0].is_ascii_alphabetic()
}

/// `nan` and `inf` look like keywords, but deserve the message about coordinates.
fn is_non_finite(token: Token) -> bool {
    std::str::from_utf8(token.text).is_ok_and(|text| text.parse::<f64>().is_ok())
}

fn truncated(line: usize, section: &str, missing: &str) -> Fault {
    (
        Some(line),
        format!("the file ends within {section}, before {missing} is complete: it is truncated; write it anew"),
    )
}

pub(super) fn parse(bytes: &[u8]) -> Result<TetFile, Fault> {
    let Sections { vertices, tetrahedra, skipped_cells } = find_sections(bytes)?;
    let points = vertices.read(|field| {
        let mut point = Vec3::zeros();
        for x in &mut point {
            let token = field()?;
            *x = token.parse("a coordinate", "a number")?;
            if !x.is_finite() {
                let message = format!("a coordinate is {}; every coordinate must be finite", token.shown());
                return Err((Some(token.line), message));
            }
        }
        reference(field()?)?;
        Ok(point)
    })?;
    let tets = tetrahedra.read(|field| {
        let mut tet = [VertexId(0); 4];
        for v in &mut tet {
            let token = field()?;
            let index: u64 = token.parse("a vertex index", "a whole number >= 1")?;
            if index == 0 || index > points.len() as u64 {
                let message = format!(
                    "a tetrahedron names vertex {index}, but the vertices are 1 to {} (Medit counts from 1)",
                    points.len()
                );
                return Err((Some(token.line), message));
            }
            *v = VertexId((index - 1) as u32);
        }
        reference(field()?)?;
        Ok(tet)
    })?;
    Ok(TetFile { soup: TetSoup { points, tets }, cell_data: Vec::new(), point_vectors: Vec::new(), skipped_cells })
}

fn reference(token: Token) -> Result<f64, Fault> {
    // Some writers give real numbers here; nothing of it is used.
    token.parse("the reference number that ends an entry", "a number")
}

/// What of a file is of interest.
struct Sections<'a> {
    vertices: Section<'a>,
    tetrahedra: Section<'a>,
    skipped_cells: usize,
}

/// Walks over the keywords; the two sections of interest are read afterwards, since they may come in either order.
fn find_sections(bytes: &[u8]) -> Result<Sections<'_>, Fault> {
    let mut tokens = Tokens::with_comments(bytes);
    let (mut vertices, mut tetrahedra, mut skipped_cells) = (None, None, 0);
    let mut first = true;
    while let Some(token) = tokens.next() {
        if std::mem::take(&mut first) && token.text != b"MeshVersionFormatted" {
            let message = format!(
                "the file starts with {}, not with `MeshVersionFormatted`: it is not a Medit mesh in ASCII",
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
            b"Vertices" => open_once(&mut vertices, Section::open("Vertices", &mut tokens, token, 4)?, token)?,
            b"Tetrahedra" => open_once(&mut tetrahedra, Section::open("Tetrahedra", &mut tokens, token, 5)?, token)?,
            b"Triangles" | b"Edges" | b"Quadrilaterals" => {
                let count: u32 = tokens.number("a count of cells", "a whole number >= 0")?;
                skipped_cells += count as usize;
            }
            b"End" => break,
            name => {
                if let Some(other) = OTHER_CELLS.iter().find(|other| other.as_bytes() == name) {
                    refuse_cells(other, token, &mut tokens)?;
                }
            }
        }
    }
    let missing =
        |name: &str| (None, format!("there is no section `{name}`; is this a mesh of a solid in Medit's format?"));
    let vertices = vertices.ok_or_else(|| missing("Vertices"))?;
    let tetrahedra = tetrahedra.ok_or_else(|| missing("Tetrahedra"))?;
    Ok(Sections { vertices, tetrahedra, skipped_cells })
}

fn open_once<'a>(slot: &mut Option<Section<'a>>, section: Section<'a>, keyword: Token) -> Result<(), Fault> {
    if slot.is_some() {
        return Err((Some(keyword.line), format!("a second section `{}`; join the two into one", section.name)));
    }
    *slot = Some(section);
    Ok(())
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

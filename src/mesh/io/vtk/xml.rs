//! XML files, `.vtu` and `.vtp`: text, base64 in place, appended raw or as base64, plain or compressed; `.pvtu` names such.

use std::path::Path;

use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};

use super::arrays::{Array, Arrays, Layout};
use super::cells::{Grid, POLYGON, STRIP};
use crate::mesh::io::cells::{Contents, vectors};
use crate::mesh::io::numbers::Kind;
use crate::mesh::io::tokens::{Fault, find, line_at};
use crate::mesh::io::{ReadError, at, read_bytes, text};

/// Reads the points, cells and scalar cell data of an unstructured grid, or the polygons of PolyData; several pieces are
/// joined.
pub(in crate::mesh::io) fn parse(bytes: &[u8]) -> Result<Contents, Fault> {
    grid(bytes)?.into_contents()
}

/// Reads the pieces that a `.pvtu` names, relative to its folder, and joins them.
pub(in crate::mesh::io) fn read_pieces(path: &Path, bytes: &[u8]) -> Result<Contents, ReadError> {
    let mut outline = Outline::default();
    let (text, _) = xml_part(bytes).map_err(at(path))?;
    outline.read(text).map_err(at(path))?;
    let mut grids = Vec::new();
    for source in &outline.sources {
        let piece = path.parent().unwrap_or(Path::new("")).join(source);
        if !piece.is_file() {
            let message = format!("the piece {source:?} is no file; it should be where this file says, beside it");
            return Err(at(path)((None, message)));
        }
        let bytes = text::plain(&piece, read_bytes(&piece)?)?;
        grids.push(grid(&bytes).map_err(at(&piece))?);
    }
    if grids.is_empty() {
        return Err(at(path)((None, "the file names no pieces".into())));
    }
    Grid::joined(grids).and_then(Grid::into_contents).map_err(at(path))
}

fn grid(bytes: &[u8]) -> Result<Grid, Fault> {
    let (text, end) = xml_part(bytes)?;
    let mut outline = Outline::default();
    outline.read(text)?;
    outline.finish(bytes, end)
}

/// The XML up to what is appended, which may be raw bytes and so no XML, and where that starts.
fn xml_part(bytes: &[u8]) -> Result<(&str, usize), Fault> {
    let appended = find(bytes, b"<AppendedData");
    let end = appended.and_then(|at| find(&bytes[at..], b">").map(|length| at + length + 1)).unwrap_or(bytes.len());
    let text = std::str::from_utf8(&bytes[..end]).map_err(|error| {
        let at = error.valid_up_to();
        (Some(line_at(bytes, at)), "the XML part of the file is not UTF-8: the file is damaged or no VTU".to_owned())
    })?;
    Ok((text, end))
}

/// The file without its numbers: which arrays there are, and where.
#[derive(Default)]
struct Outline<'a> {
    layout: Option<Layout>,
    /// Whether the file is PolyData, whose cells stand in a section for each kind and whose data is not read.
    is_surface: bool,
    pieces: Vec<Piece<'a>>,
    /// `Points`, `Cells`, `CellData` or another element that holds arrays.
    section: String,
    /// Whether what is appended is base64; none when nothing is.
    appended_base64: Option<bool>,
    /// The files that hold the pieces.
    sources: Vec<String>,
    /// Where all arrays start in what is appended.
    offsets: Vec<u64>,
}

/// A part of the grid.
#[derive(Default)]
struct Piece<'a> {
    points: u64,
    /// Cells, or the polygons and strips of PolyData.
    cells: [u64; 2],
    /// With the section of each.
    arrays: Vec<(String, Array<'a>)>,
}

impl<'a> Outline<'a> {
    fn read(&mut self, text: &'a str) -> Result<(), Fault> {
        let mut reader = Reader::from_str(text);
        // Elements within an array (its range, its units) have texts of their own.
        let mut depth_in_array: Option<usize> = None;
        loop {
            let at = reader.buffer_position() as usize;
            let here = |message: String| (Some(line_at(text.as_bytes(), at)), message);
            match (reader.read_event().map_err(|error| here(format!("broken XML: {error}")))?, depth_in_array) {
                (Event::Start(_), Some(depth)) => depth_in_array = Some(depth + 1),
                (Event::Start(tag), None) => {
                    self.open(&tag, at).map_err(here)?;
                    match tag.name().as_ref() {
                        "DataArray" => depth_in_array = Some(0),
                        "AppendedData" => return Ok(()),
                        _ => {}
                    }
                }
                (Event::Empty(tag), None) => self.open(&tag, at).map_err(here)?,
                (Event::Text(_), Some(0)) => {
                    let place = at..reader.buffer_position() as usize;
                    let last = self.pieces.last_mut().and_then(|piece| piece.arrays.last_mut());
                    if let Some((_, array)) = last.filter(|(_, array)| array.text.is_empty()) {
                        (array.text, array.at) = (&text.as_bytes()[place], at);
                    }
                }
                (Event::End(_), Some(depth)) => depth_in_array = depth.checked_sub(1),
                (Event::End(tag), None) if tag.name().as_ref() == "VTKFile" => return Ok(()),
                (Event::Eof, _) => return Err(here("the file ends before `</VTKFile>`: it is truncated".into())),
                _ => {}
            }
        }
    }

    /// Takes what is of interest from the tag of an element that starts at `at`.
    fn open(&mut self, tag: &BytesStart, at: usize) -> Result<(), String> {
        let attribute = |name: &str| match tag.try_get_attribute(name) {
            Ok(Some(attribute)) => attribute
                .normalized_value(XmlVersion::Implicit1_0)
                .map(|value| Some(value.into_owned()))
                .map_err(|error| error.to_string()),
            Ok(None) => Ok(None),
            Err(error) => Err(error.to_string()),
        };
        let required = |name: &str| {
            attribute(name)?.ok_or_else(|| format!("`{}` lacks the attribute `{name}`", tag.name().as_ref()))
        };
        match tag.name().as_ref() {
            "VTKFile" => {
                let kind = required("type")?;
                self.is_surface = kind == "PolyData";
                if !["UnstructuredGrid", "PolyData", "PUnstructuredGrid"].contains(&kind.as_str()) {
                    let kind = kind.escape_default();
                    return Err(format!("the file holds `{kind}`, neither an UnstructuredGrid nor PolyData"));
                }
                self.layout = Some(Layout::new(
                    attribute("byte_order")?.as_deref(),
                    attribute("header_type")?.as_deref(),
                    attribute("compressor")?.as_deref(),
                )?);
            }
            "Piece" => {
                if let Some(source) = attribute("Source")? {
                    self.sources.push(source);
                    return Ok(());
                }
                let count = |name: &str| {
                    let text = required(name)?;
                    text.trim().parse().map_err(|_| format!("`{name}` is {text:?}, but should be a whole number >= 0"))
                };
                let cells = if self.is_surface {
                    let strips = if attribute("NumberOfStrips")?.is_some() { count("NumberOfStrips")? } else { 0 };
                    [count("NumberOfPolys")?, strips]
                } else {
                    [count("NumberOfCells")?, 0]
                };
                self.pieces.push(Piece { points: count("NumberOfPoints")?, cells, arrays: Vec::new() });
            }
            "DataArray" => {
                let components = attribute("NumberOfComponents")?.unwrap_or_else(|| "1".into());
                let offset = attribute("offset")?;
                let array = Array {
                    name: attribute("Name")?.unwrap_or_default(),
                    kind: kind(&required("type")?),
                    components: components
                        .trim()
                        .parse()
                        .map_err(|_| "`NumberOfComponents` is no number".to_owned())?,
                    format: required("format")?,
                    offset: offset.map(|text| text.trim().parse().map_err(|_| "`offset` is no number")).transpose()?,
                    text: &[],
                    at,
                };
                self.offsets.extend(array.offset);
                // Data of the whole stands before the pieces.
                if let Some(piece) = self.pieces.last_mut() {
                    piece.arrays.push((self.section.clone(), array));
                }
            }
            "AppendedData" => self.appended_base64 = Some(required("encoding")? == "base64"),
            section @ ("Points" | "Cells" | "PointData" | "CellData" | "FieldData" | "Verts" | "Lines" | "Strips"
            | "Polys") => self.section = section.to_owned(),
            _ => {}
        }
        Ok(())
    }

    fn finish(self, bytes: &'a [u8], appended_from: usize) -> Result<Grid, Fault> {
        let layout = self.layout.ok_or_else(|| (Some(1), "there is no element `VTKFile`: it is no VTU".to_owned()))?;
        if self.pieces.is_empty() {
            return Err(missing("element `Piece`"));
        }
        let appended = self.appended_base64.map(|base64| (base64, appended_from));
        let arrays = Arrays::new(layout, bytes, appended, self.offsets.clone());
        let there = self.pieces.iter().filter(|piece| piece.points > 0 || piece.cells != [0, 0]);
        let mut grids = there
            .map(|piece| if self.is_surface { piece.surface(&arrays, bytes) } else { piece.grid(&arrays, bytes) })
            .collect::<Result<Vec<_>, _>>()?;
        match grids.len() {
            0 => Ok(Grid::default()),
            1 => Ok(grids.remove(0)),
            _ => Grid::joined(grids),
        }
    }
}

fn missing(what: &str) -> Fault {
    (None, format!("there is no {what} in the file"))
}

impl<'a> Piece<'a> {
    fn within(&self, section: &'static str) -> impl Iterator<Item = &Array<'a>> {
        self.arrays.iter().filter(move |(other, _)| other == section).map(|(_, array)| array)
    }

    fn array(&self, section: &'static str, name: &str) -> Result<&Array<'a>, Fault> {
        self.within(section).find(|array| array.name == name).ok_or_else(|| missing(&format!("array `{name}`")))
    }

    fn coordinates(&self, arrays: &Arrays, bytes: &[u8]) -> Result<Vec<f64>, Fault> {
        let coordinates = self.within("Points").next().ok_or_else(|| missing("array of points"))?;
        if coordinates.components != 3 {
            let message = format!("points have {} coordinates, not 3", coordinates.components);
            return Err((Some(line_at(bytes, coordinates.at)), message));
        }
        Ok(arrays.decode(coordinates, Some(self.points))?.into_floats())
    }

    fn grid(&self, arrays: &Arrays, bytes: &[u8]) -> Result<Grid, Fault> {
        let cells = self.cells[0];
        let mut cell_data = Vec::new();
        for array in self.within("CellData").filter(|array| array.components == 1 && array.kind.is_some()) {
            cell_data.push((array.name.clone(), arrays.decode(array, Some(cells))?.into_floats()));
        }
        let mut point_vectors = Vec::new();
        for array in self.within("PointData").filter(|array| array.components == 3 && array.kind.is_some()) {
            let numbers = arrays.decode(array, Some(self.points))?.into_floats();
            point_vectors.push((array.name.clone(), vectors(&numbers)));
        }
        Ok(Grid {
            coordinates: self.coordinates(arrays, bytes)?,
            connectivity: arrays.integers(self.array("Cells", "connectivity")?, None)?,
            ends: arrays.integers(self.array("Cells", "offsets")?, Some(cells))?,
            types: arrays.integers(self.array("Cells", "types")?, Some(cells))?,
            cell_data,
            point_vectors,
        })
    }

    fn surface(&self, arrays: &Arrays, bytes: &[u8]) -> Result<Grid, Fault> {
        let mut grid = Grid { coordinates: self.coordinates(arrays, bytes)?, ..Grid::default() };
        for (section, count, kind) in [("Polys", self.cells[0], POLYGON), ("Strips", self.cells[1], STRIP)] {
            if count > 0 {
                let connectivity = arrays.integers(self.array(section, "connectivity")?, None)?;
                let ends = arrays.integers(self.array(section, "offsets")?, Some(count))?;
                grid.extend(&connectivity, &ends, kind);
            }
        }
        Ok(grid)
    }
}

/// The type of an array; none for strings and bits.
fn kind(name: &str) -> Option<Kind> {
    Some(match name {
        "Int8" => Kind::Int8,
        "UInt8" => Kind::UInt8,
        "Int16" => Kind::Int16,
        "UInt16" => Kind::UInt16,
        "Int32" => Kind::Int32,
        "UInt32" => Kind::UInt32,
        "Int64" => Kind::Int64,
        "UInt64" => Kind::UInt64,
        "Float32" => Kind::Float32,
        "Float64" => Kind::Float64,
        _ => return None,
    })
}

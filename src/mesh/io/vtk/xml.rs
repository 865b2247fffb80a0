//! XML `.vtu` files: text, base64 in place, appended raw or as base64, plain or compressed by zlib.

use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};

use super::arrays::{Array, Arrays, Layout, line_at};
use super::cells::Grid;
use crate::mesh::io::numbers::Kind;
use crate::mesh::io::tet_file::{TetFile, vectors};
use crate::mesh::io::tokens::{Fault, find};

/// Reads the points, tets and scalar cell data of an unstructured grid in one piece.
pub(in crate::mesh::io) fn parse(bytes: &[u8]) -> Result<TetFile, Fault> {
    // What is appended may be raw bytes, which are no XML.
    let appended = find(bytes, b"<AppendedData");
    let end = appended.and_then(|at| find(&bytes[at..], b">").map(|length| at + length + 1)).unwrap_or(bytes.len());
    let text = std::str::from_utf8(&bytes[..end]).map_err(|error| {
        let at = error.valid_up_to();
        (Some(line_at(bytes, at)), "the XML part of the file is not UTF-8: the file is damaged or no VTU".to_owned())
    })?;
    let mut outline = Outline::default();
    outline.read(text)?;
    outline.finish(bytes, end)
}

/// The file without its numbers: which arrays there are, and where.
#[derive(Default)]
struct Outline<'a> {
    layout: Option<Layout>,
    /// Counts of points and cells.
    piece: Option<[u64; 2]>,
    /// `Points`, `Cells`, `CellData` or another element that holds arrays.
    section: String,
    arrays: Vec<(String, Array<'a>)>,
    /// Whether what is appended is base64; none when nothing is.
    appended_base64: Option<bool>,
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
                    if let Some((_, array)) = self.arrays.last_mut().filter(|(_, array)| array.text.is_empty()) {
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
                if kind != "UnstructuredGrid" {
                    return Err(format!("the file holds `{}`, not an UnstructuredGrid", kind.escape_default()));
                }
                self.layout = Some(Layout::new(
                    attribute("byte_order")?.as_deref(),
                    attribute("header_type")?.as_deref(),
                    attribute("compressor")?.as_deref(),
                )?);
            }
            "Piece" => {
                if self.piece.is_some() {
                    return Err("the grid has several pieces; join them into one".into());
                }
                let count = |name: &str| {
                    let text = required(name)?;
                    text.trim().parse().map_err(|_| format!("`{name}` is {text:?}, but should be a whole number >= 0"))
                };
                self.piece = Some([count("NumberOfPoints")?, count("NumberOfCells")?]);
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
                self.arrays.push((self.section.clone(), array));
            }
            "AppendedData" => self.appended_base64 = Some(required("encoding")? == "base64"),
            section @ ("Points" | "Cells" | "PointData" | "CellData" | "FieldData") => {
                self.section = section.to_owned()
            }
            _ => {}
        }
        Ok(())
    }

    fn finish(self, bytes: &'a [u8], appended_from: usize) -> Result<TetFile, Fault> {
        let layout = self.layout.ok_or_else(|| (Some(1), "there is no element `VTKFile`: it is no VTU".to_owned()))?;
        let missing = |what: &str| (None, format!("there is no {what} in the file"));
        let [points, cells] = self.piece.ok_or_else(|| missing("element `Piece`"))?;
        let offsets = self.arrays.iter().filter_map(|(_, array)| array.offset).collect();
        let appended = self.appended_base64.map(|base64| (base64, appended_from));
        let arrays = Arrays::new(layout, bytes, appended, offsets);
        let within = |section: &'static str| {
            self.arrays.iter().filter(move |(where_, _)| where_ == section).map(|(_, array)| array)
        };
        let of_cells = |name: &str| {
            within("Cells").find(|array| array.name == name).ok_or_else(|| missing(&format!("array `{name}`")))
        };

        let coordinates = within("Points").next().ok_or_else(|| missing("array of points"))?;
        if coordinates.components != 3 {
            let message = format!("points have {} coordinates, not 3", coordinates.components);
            return Err((Some(line_at(bytes, coordinates.at)), message));
        }
        let mut cell_data = Vec::new();
        for array in within("CellData").filter(|array| array.components == 1 && array.kind.is_some()) {
            cell_data.push((array.name.clone(), arrays.decode(array, Some(cells))?.into_floats()));
        }
        let grid = Grid {
            coordinates: arrays.decode(coordinates, Some(points))?.into_floats(),
            connectivity: arrays.integers(of_cells("connectivity")?, None)?,
            ends: arrays.integers(of_cells("offsets")?, Some(cells))?,
            types: arrays.integers(of_cells("types")?, Some(cells))?,
            cell_data,
        };
        let mut file = grid.into_tets()?;
        for array in within("PointData").filter(|array| array.components == 3 && array.kind.is_some()) {
            let numbers = arrays.decode(array, Some(points))?.into_floats();
            file.point_vectors.push((array.name.clone(), vectors(&numbers)));
        }
        Ok(file)
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

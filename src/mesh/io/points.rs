//! Lists of points: rows of a CSV file, or the points of a mesh or a surface.

use std::io;
use std::path::Path;

use super::format::ending_of;
use super::vtk::{DataArray, Values, write_points_vtu, write_vtu};
use super::{ReadError, SolidFile, WriteError, read_bytes, read_solid_and_vectors, text, write_atomically};
use crate::mesh::{Vec3, VertexId};

const USE_POINT_ENDING: &str = "use .csv or .vtu";

/// Points with what their file says beside them.
#[derive(Clone, Debug, PartialEq)]
pub struct PointTable {
    /// The positions, to the bit.
    pub points: Vec<Vec3>,
    /// The tets, if the file is a mesh of tets.
    pub tets: Vec<[VertexId; 4]>,
    /// The name of the array of a VTU file that `points` are of, and the file's own points, where the tets are.
    pub array: Option<(String, Vec<Vec3>)>,
    /// The names of a CSV file's columns, else x, y and z.
    header: Vec<String>,
    /// A CSV file's rows, as they are written there.
    rows: Vec<Vec<String>>,
}

/// Reads points: the columns x, y and z of a `.csv` file, whose first line names its columns, or all points of a mesh or
/// surface in any format of [`super::read_tets`] and [`super::read_surface`], in the order of the file.
///
/// # Errors
/// [`ReadError`], with the path and, where the format allows it, the line.
pub fn read_points(path: &Path) -> Result<PointTable, ReadError> {
    read_points_under(path, "")
}

/// The same, but of a `.csv` file that has columns with these names behind `prefix` those, and of a `.vtu` file that has an array of the
/// name `position` behind it on its points that one, as `qcball evaluate` writes them. What it says of other points is then left out. A row that
/// has none of the three is a point of NaN.
///
/// # Errors
/// As [`read_points`].
pub fn read_points_under(path: &Path, prefix: &str) -> Result<PointTable, ReadError> {
    if ending_of(path) == "csv" {
        return read_csv(path, prefix);
    }
    let (solid, arrays) = read_solid_and_vectors(path)?;
    let (points, tets) = match solid {
        SolidFile::Surface(soup) => (soup.points, Vec::new()),
        SolidFile::Tets(soup) => (soup.points, soup.tets),
    };
    let name = format!("{prefix}position");
    let found = arrays.into_iter().find(|(other, values)| *other == name && values.len() == points.len());
    if let Some((_, positions)) = found.filter(|_| !prefix.is_empty()) {
        let field = |x: &f64| if x.is_finite() { x.to_string() } else { String::new() };
        let rows = positions.iter().map(|point| point.iter().map(field).collect()).collect();
        let header = ["x", "y", "z"].map(|axis| format!("{prefix}{axis}")).to_vec();
        return Ok(PointTable { points: positions, tets, array: Some((name, points)), header, rows });
    }
    // Here one counts that no polygon or tet names.
    if let Some(vertex) = super::first_not_finite(&points) {
        return Err(ReadError::NotFinite { path: path.into(), line: None, vertex });
    }
    let rows = points.iter().map(|point| point.iter().map(f64::to_string).collect()).collect();
    Ok(PointTable { points, tets, array: None, header: ["x", "y", "z"].map(String::from).to_vec(), rows })
}

/// What [`read_points_under`] leaves out but for the columns that it reads: what was said of other points.
const OF_OTHERS: [&str; 8] = ["inside", "tet", "image_x", "image_y", "image_z", "domain_x", "domain_y", "domain_z"];

fn read_csv(path: &Path, prefix: &str) -> Result<PointTable, ReadError> {
    let malformed = |line, message| ReadError::Malformed { path: path.into(), line, message };
    let broken = |error: csv::Error| {
        let line = error.position().map(|position| position.line() as usize);
        match error.into_kind() {
            csv::ErrorKind::Io(source) => ReadError::Open { path: path.into(), source },
            csv::ErrorKind::Utf8 { err, .. } => malformed(line, format!("the text is not UTF-8: {err}")),
            csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
                malformed(line, format!("the row has {len} fields, the first line {expected_len}"))
            }
            other => malformed(line, format!("it is no CSV: {other:?}")),
        }
    };
    let text = text::plain(path, read_bytes(path)?)?;
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_slice());
    let header: Vec<String> = reader.headers().map_err(broken)?.iter().map(String::from).collect();
    let column = |name: &str| {
        header.iter().position(|column| column.eq_ignore_ascii_case(name)).ok_or_else(|| {
            let message = format!("there is no column {name}; the first line names the columns, as in x,y,z");
            malformed(Some(1), message)
        })
    };
    let names = ["x", "y", "z"];
    let prefixed = names.map(|name| header.iter().position(|column| *column == format!("{prefix}{name}")));
    let (columns, under) = match prefixed {
        [Some(x), Some(y), Some(z)] if !prefix.is_empty() => ([x, y, z], true),
        _ => ([column("x")?, column("y")?, column("z")?], false),
    };
    let kept: Vec<usize> = (0..header.len())
        .filter(|at| !under || columns.contains(at) || !OF_OTHERS.contains(&header[*at].as_str()))
        .collect();
    let (mut points, mut rows) = (Vec::new(), Vec::new());
    for record in reader.records() {
        let record = record.map_err(broken)?;
        let line = record.position().map(|position| position.line() as usize);
        let mut point = Vec3::zeros();
        if under && columns.iter().all(|&column| record[column].is_empty()) {
            points.push(Vec3::repeat(f64::NAN));
            rows.push(kept.iter().map(|&at| record[at].to_string()).collect());
            continue;
        }
        for (coordinate, column) in point.iter_mut().zip(columns) {
            let text = &record[column];
            let number = text.parse().ok().filter(|number: &f64| number.is_finite());
            *coordinate = number
                .ok_or_else(|| malformed(line, format!("{} is {text:?}; give it a finite number", header[column])))?;
        }
        points.push(point);
        rows.push(kept.iter().map(|&at| record[at].to_string()).collect());
    }
    let header = kept.iter().map(|&at| header[at].clone()).collect();
    Ok(PointTable { points, tets: Vec::new(), array: None, header, rows })
}

/// Whether [`PointTable::write`] knows the ending of `path`: to be asked before any work.
///
/// # Errors
/// The same refusal.
pub fn check_points_can_be_written(path: &Path) -> Result<(), WriteError> {
    match ending_of(path).as_str() {
        "csv" | "vtu" => Ok(()),
        ending => {
            Err(WriteError::refused(path, format!("unknown file ending {ending:?} for points"), USE_POINT_ENDING))
        }
    }
}

impl PointTable {
    /// Writes the points with further columns to a `.csv` file, or with further data to a `.vtu` file, in which the tets are
    /// cells, or each point if there are none. The points of an array stay one there.
    ///
    /// The columns are those of the file that was read, followed by `columns`. A number has all its digits; where there is
    /// none (`None`) its field is empty.
    ///
    /// # Errors
    /// An unknown ending, a column that is there already, or the system's reason; with the path.
    ///
    /// # Panics
    /// If a column or an array has not one entry a point.
    pub fn write(
        &self,
        path: &Path,
        columns: &[(&str, Vec<Option<f64>>)],
        point_data: &[DataArray],
    ) -> Result<(), WriteError> {
        check_points_can_be_written(path)?;
        if ending_of(path) == "vtu" {
            let (places, mut data) = match &self.array {
                None => (&self.points, Vec::new()),
                Some((name, places)) => (places, vec![DataArray { name, values: Values::Vectors(&self.points) }]),
            };
            data.extend_from_slice(point_data);
            return if self.tets.is_empty() {
                write_points_vtu(path, places, &data)
            } else {
                write_vtu(path, places, &self.tets, &data, &[])
            };
        }
        if let Some((name, _)) = columns.iter().find(|(name, _)| self.header.iter().any(|other| other == name)) {
            let fault = format!("the points have a column {name} already");
            return Err(WriteError::refused(path, fault, "rename it where it was read"));
        }
        write_atomically(path, |file| {
            let mut table = csv::Writer::from_writer(file);
            let names = self.header.iter().map(String::as_str).chain(columns.iter().map(|(name, _)| *name));
            table.write_record(names).map_err(io::Error::from)?;
            for (index, row) in self.rows.iter().enumerate() {
                let number = |value: Option<f64>| value.map_or_else(String::new, |number| number.to_string());
                let further = columns.iter().map(|(_, values)| number(values[index]));
                table.write_record(row.iter().cloned().chain(further)).map_err(io::Error::from)?;
            }
            table.flush()
        })
    }
}

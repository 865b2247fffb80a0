//! The files of a results folder: the record and its tables and meshes.

use std::io;
use std::path::Path;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::corners::{CONE, CORNERS, cone_numbers, cone_rows};
use super::figures::boundary_flags;
use super::{Report, summary};
use crate::bound::certificate::Certificate;
use crate::dilatation::Dilatation;
use crate::domain::Domain;
use crate::map::Corners;
use crate::measure::Measured;
use crate::mesh::io::{DataArray, Values, WriteError, write_atomically, write_vtu};
use crate::mesh::{Flips, MeshChanges, TetId, Unit, Vec3, VertexId};
use crate::optimize::TraceRow;

/// The files of a run, but for `certificate.json`, which not every run has; the record comes last.
pub(crate) const FILES: [&str; 6] = ["trace.csv", "cells.csv", "domain.vtu", "image.vtu", "summary.txt", "report.json"];
/// The record, which comes last.
const REPORT: &str = "report.json";
/// What proves the best bound.
const CERTIFICATE: &str = "certificate.json";
/// In a folder that lacks something: what.
pub(crate) const INCOMPLETE: &str = "incomplete.txt";
/// The name of the image positions started from, on the points of both meshes.
pub(crate) const START: &str = "start_position";
/// The file with a row an edge that was halved, of a run with refinement.
pub(crate) const HALVED: &str = "refined.csv";

/// One line of `refined.csv`: a vertex and the two that it was put halfway between, which come before it; in the order of the
/// halvings, all counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct HalvedRow {
    pub vertex: u32,
    pub from: u32,
    pub to: u32,
}

/// The file with a row for each tet that flips took away or made, of a run with refinement.
pub(crate) const FLIPPED: &str = "flipped.csv";

/// One line of `flipped.csv`: the vertices of a tet, after so many halvings: one that goes, with its number, or one that comes in the room of
/// those, all counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct FlippedRow {
    pub after: usize,
    pub tet: Option<u32>,
    pub v0: u32,
    pub v1: u32,
    pub v2: u32,
    pub v3: u32,
}

impl FlippedRow {
    /// The rows of some flips.
    fn rows(flips: &Flips) -> impl Iterator<Item = Self> + '_ {
        let row = |tet: Option<u32>, [v0, v1, v2, v3]: [u32; 4]| Self { after: flips.after, tet, v0, v1, v2, v3 };
        let numbers = |tet: &[VertexId; 4]| tet.map(|v| v.0);
        let old = flips.old.iter().map(move |(id, tet)| row(Some(id.0), numbers(tet)));
        old.chain(flips.new.iter().map(move |tet| row(None, numbers(tet))))
    }

    /// The flips of rows.
    pub fn flips(rows: &[Self]) -> Vec<Flips> {
        let mut flips: Vec<Flips> = Vec::new();
        for row in rows {
            if flips.last().is_none_or(|last| last.after != row.after) {
                flips.push(Flips { after: row.after, ..Flips::default() });
            }
            let last = flips.last_mut().expect("one is there");
            let tet = [row.v0, row.v1, row.v2, row.v3].map(VertexId);
            match row.tet {
                Some(id) => last.old.push((TetId(id), tet)),
                None => last.new.push(tet),
            }
        }
        flips
    }
}

/// The maps behind a report: what its tables and meshes show cell by cell.
#[derive(Clone, Copy, Debug)]
pub struct MapRecord<'a> {
    /// The domain.
    pub domain: &'a Domain,
    /// The corners of the map, with their exponents; `None` where it is piecewise linear.
    pub corners: Option<&'a Corners>,
    /// What refinement did to the mesh.
    pub changes: &'a MeshChanges,
    /// Image positions started from.
    pub initial: &'a [Vec3],
    /// Image positions arrived at.
    pub image: &'a [Vec3],
    /// The map started from, measured.
    pub measured_initial: &'a Measured,
    /// The map arrived at, measured.
    pub measured: &'a Measured,
    /// The tets that attain the largest K.
    pub active: &'a [TetId],
    /// One row an iteration.
    pub trace: &'a [TraceRow],
    /// The certificate of the bound "gram", if one was searched for and found.
    pub certificate: Option<&'a Certificate>,
    /// The units in which lengths of the domain and of the images are counted in memory; in files they are given back.
    pub units: [Unit; 2],
}

/// Writes `report.json`, `summary.txt`, `trace.csv`, `cells.csv`, `domain.vtu` and `image.vtu` into `folder`, made if
/// missing, `corners.csv` if the map has corners, `refined.csv` if edges were halved, `flipped.csv` if tets were flipped and `certificate.json` if there is a
/// certificate; those of an earlier run are removed.
///
/// The report comes last: where it stands, the rest does. Until then `incomplete.txt` says that something is missing. It
/// stays if a file could not be written, says which, and as many of the others as can be are there.
///
/// # Errors
/// The first file that could not be written, and why.
pub fn write_results(folder: &Path, report: &Report, record: &MapRecord) -> Result<(), WriteError> {
    let under_way = "The results are being written, or what wrote them was ended. Until report.json is there and this file is \
                     gone, files are missing or of an earlier run.\n";
    let incomplete = folder.join(INCOMPLETE);
    write_text(&incomplete, under_way)?;
    remove(&folder.join(REPORT))?;
    let faults = write_files(folder, report, record);
    let mut missing: Vec<&str> = faults.iter().map(|(name, _)| *name).filter(|name| *name != REPORT).collect();
    missing.push(REPORT);
    let mut said = format!("The results are not whole. Missing: {}.\n", missing.join(", "));
    faults.iter().for_each(|(_, error)| said += &format!("{error}\n"));
    match faults.into_iter().next() {
        None => remove(&incomplete),
        Some((_, error)) => {
            // Where there is no room for this either, the first words still hold.
            let _ = write_text(&incomplete, &said);
            Err(error)
        }
    }
}

/// The files but for the mark; those that could not be written, in whose place nothing is then left.
fn write_files(folder: &Path, report: &Report, record: &MapRecord) -> Vec<(&'static str, WriteError)> {
    let cells = Cells::of(record);
    let mut data = cells.arrays().to_vec();
    let cones = record.corners.map(cone_numbers);
    data.extend(cones.as_ref().map(|cones| DataArray { name: CONE, values: Values::Scalars(cones) }));
    let [unit, of_image] = record.units;
    let points = &unit.give_back_points(record.domain.mesh().points());
    let [start, image] = &[record.initial, record.image].map(|positions| of_image.give_back_points(positions));
    let mesh = |name: &str, shown: &[Vec3], other_name, other| {
        let point_data = [
            DataArray { name: "boundary", values: Values::Flags(cells.on_boundary) },
            DataArray { name: other_name, values: Values::Vectors(other) },
            DataArray { name: START, values: Values::Vectors(start) },
        ];
        write_vtu(&folder.join(name), shown, record.domain.mesh().tets(), &point_data, &data)
    };
    let [corners, halved, flipped, certificate] = [CORNERS, HALVED, FLIPPED, CERTIFICATE].map(|name| folder.join(name));
    let halvings = || {
        let first = record.domain.mesh().points().len() - record.changes.halved.len();
        let rows = (first as u32..).zip(&record.changes.halved);
        write_csv(&halved, rows.map(|(vertex, [from, to])| HalvedRow { vertex, from: from.0, to: to.0 }))
    };
    let flips = &record.changes.flips;
    // On a disk that fills up, the image is what cannot be had again without the whole computation.
    let written = [
        ("image.vtu", mesh("image.vtu", image, "domain_position", points)),
        ("domain.vtu", mesh("domain.vtu", points, "image_position", image)),
        (CORNERS, record.corners.map_or_else(|| remove(&corners), |found| write_csv(&corners, cone_rows(found)))),
        (HALVED, if record.changes.halved.is_empty() { remove(&halved) } else { halvings() }),
        (
            FLIPPED,
            if flips.is_empty() {
                remove(&flipped)
            } else {
                write_csv(&flipped, flips.iter().flat_map(FlippedRow::rows))
            },
        ),
        (
            CERTIFICATE,
            record.certificate.map_or_else(|| remove(&certificate), |found| write_certificate(&certificate, found)),
        ),
        ("trace.csv", write_trace(&folder.join("trace.csv"), record.trace)),
        ("cells.csv", write_cells(&folder.join("cells.csv"), &cells, record)),
        ("summary.txt", write_text(&folder.join("summary.txt"), &summary(report))),
    ];
    let mut faults: Vec<(&str, WriteError)> =
        written.into_iter().filter_map(|(name, written)| Some((name, written.err()?))).collect();
    if faults.is_empty() {
        faults.extend(write_text(&folder.join(REPORT), &report.to_json()).err().map(|error| (REPORT, error)));
    }
    // What an earlier run left under these names would pass for this one's; if it cannot be removed, the mark tells.
    faults.iter().for_each(|(name, _)| drop(remove(&folder.join(name))));
    faults
}

fn write_text(path: &Path, text: &str) -> Result<(), WriteError> {
    write_atomically(path, |file| file.write_all(text.as_bytes()))
}

/// Removes a file, if there is one.
fn remove(path: &Path) -> Result<(), WriteError> {
    match std::fs::remove_file(path) {
        Err(source) if source.kind() != io::ErrorKind::NotFound => Err(WriteError::new(path, source)),
        _ => Ok(()),
    }
}

/// blake3 of a trace as CSV with all seconds 0, so that it is the same on any machine.
pub(crate) fn trace_hash(trace: &[TraceRow]) -> String {
    let mut hasher = blake3::Hasher::new();
    let timeless = trace.iter().map(|row| TraceRow { seconds: 0.0, ..row.clone() });
    // A hasher takes everything.
    csv_to(&mut hasher, timeless).expect("a row of the trace is a line of CSV");
    hasher.finalize().to_hex().to_string()
}

/// Writes a trace as CSV, a row an iteration.
///
/// # Errors
/// The file and why it could not be written.
pub fn write_trace(path: &Path, trace: &[TraceRow]) -> Result<(), WriteError> {
    write_csv(path, trace.iter())
}

/// Writes a certificate as JSON.
///
/// # Errors
/// The file and why it could not be written.
pub fn write_certificate(path: &Path, certificate: &Certificate) -> Result<(), WriteError> {
    write_text(path, &certificate.to_json())
}

impl MapRecord<'_> {
    /// The rows of `cells.csv`.
    pub(super) fn cell_rows(&self) -> Vec<CellRow> {
        let cells = Cells::of(self);
        (0..cells.k.len()).map(|tet| cells.row(self, tet)).collect()
    }
}

/// What is known of each cell, column by column.
struct Cells<'a> {
    on_boundary: &'a [bool],
    locked: Vec<bool>,
    active: Vec<bool>,
    inner: Vec<f64>,
    outer: Vec<f64>,
    k: Vec<f64>,
    k_initial: Vec<f64>,
    volumes: Vec<f64>,
    image_volumes: Vec<f64>,
}

/// One line of `cells.csv`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct CellRow {
    pub tet: usize,
    pub volume: f64,
    pub k_inner_initial: f64,
    pub k_outer_initial: f64,
    pub k_initial: f64,
    pub k_inner: f64,
    pub k_outer: f64,
    pub k: f64,
    pub active: bool,
    pub locked: bool,
}

impl CellRow {
    /// The dilatations at the start.
    pub(crate) fn before(&self) -> Dilatation {
        Dilatation { inner: self.k_inner_initial, outer: self.k_outer_initial }
    }

    /// The dilatations at the end.
    pub(crate) fn after(&self) -> Dilatation {
        Dilatation { inner: self.k_inner, outer: self.k_outer }
    }
}

impl<'a> Cells<'a> {
    fn of(record: &MapRecord<'a>) -> Self {
        let column = |measured: &Measured, value: fn(Dilatation) -> f64| -> Vec<f64> {
            measured.dilatations.iter().map(|&dilatation| value(dilatation)).collect()
        };
        let (on_boundary, locked) = boundary_flags(record.domain);
        let mut active = vec![false; locked.len()];
        record.active.iter().for_each(|tet| active[tet.index()] = true);
        Self {
            on_boundary,
            locked,
            active,
            inner: column(record.measured, |dilatation| dilatation.inner),
            outer: column(record.measured, |dilatation| dilatation.outer),
            k: column(record.measured, Dilatation::k),
            k_initial: column(record.measured_initial, Dilatation::k),
            volumes: record.domain.volumes().iter().map(|&volume| record.units[0].give_back(volume, 3)).collect(),
            image_volumes: (0..)
                .map(TetId)
                .zip(record.domain.volumes())
                .map(|(tet, volume)| {
                    let of_image = record.domain.jacobian(tet, record.image).determinant() * volume;
                    record.units[1].give_back(of_image, 3)
                })
                .collect(),
        }
    }

    fn arrays(&self) -> [DataArray<'_>; 8] {
        [
            DataArray { name: "K", values: Values::Scalars(&self.k) },
            DataArray { name: "K_inner", values: Values::Scalars(&self.inner) },
            DataArray { name: "K_outer", values: Values::Scalars(&self.outer) },
            DataArray { name: "K_initial", values: Values::Scalars(&self.k_initial) },
            DataArray { name: "active", values: Values::Flags(&self.active) },
            DataArray { name: "locked", values: Values::Flags(&self.locked) },
            DataArray { name: "volume", values: Values::Scalars(&self.volumes) },
            DataArray { name: "volume_image", values: Values::Scalars(&self.image_volumes) },
        ]
    }

    fn row(&self, record: &MapRecord<'a>, tet: usize) -> CellRow {
        let before = &record.measured_initial.dilatations;
        CellRow {
            tet,
            volume: self.volumes[tet],
            k_inner_initial: before[tet].inner,
            k_outer_initial: before[tet].outer,
            k_initial: self.k_initial[tet],
            k_inner: self.inner[tet],
            k_outer: self.outer[tet],
            k: self.k[tet],
            active: self.active[tet],
            locked: self.locked[tet],
        }
    }
}

fn write_csv(path: &Path, rows: impl Iterator<Item = impl Serialize>) -> Result<(), WriteError> {
    write_atomically(path, |file| csv_to(file, rows))
}

/// Writes `cells.csv`, whose numbers are made into text in parallel, some megabytes at once.
fn write_cells(path: &Path, cells: &Cells, record: &MapRecord) -> Result<(), WriteError> {
    /// Few in tests, whose meshes are small.
    const ROWS: usize = if cfg!(test) { 10 } else { 4096 };
    const PIECES: usize = 16;
    write_atomically(path, |file| {
        for first in (0..cells.k.len()).step_by(ROWS * PIECES) {
            let pieces = (0..PIECES).into_par_iter().map(|piece| {
                let start = first + piece * ROWS;
                let rows = (start..cells.k.len().min(start + ROWS)).map(|tet| cells.row(record, tet));
                let mut text = Vec::new();
                table_to(&mut text, start == 0, rows).map(|()| text)
            });
            let pieces: Vec<Vec<u8>> = pieces.collect::<io::Result<_>>()?;
            pieces.iter().try_for_each(|text| file.write_all(text))?;
        }
        Ok(())
    })
}

fn csv_to(file: &mut dyn io::Write, rows: impl Iterator<Item = impl Serialize>) -> io::Result<()> {
    table_to(file, true, rows)
}

/// Writes rows, after the names of their columns if these are asked for.
fn table_to(file: &mut dyn io::Write, named: bool, rows: impl Iterator<Item = impl Serialize>) -> io::Result<()> {
    let mut table = csv::WriterBuilder::new().has_headers(named).from_writer(file);
    for row in rows {
        // Unwrapped, so that a full disk is still told as one.
        table.serialize(row).map_err(|error| match error.into_kind() {
            csv::ErrorKind::Io(error) => error,
            other => io::Error::other(format!("{other:?}")),
        })?;
    }
    table.flush()
}

//! The files of a results folder, as far as they can be read.

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::Value;

use super::{Findings, VerifyError};
use crate::bound::certificate::Certificate;
use crate::domain::Domain;
use crate::map::Corners;
use crate::measure::{Measured, Summary};
use crate::mesh::io::{TetFile, read_tet_file};
use crate::mesh::{MeshChanges, TetId, TetMesh, Unit, Vec3, VertexId};
use crate::optimize::TraceRow;
use crate::report::{
    CORNERS, CellRow, FILES, FLIPPED, FlippedRow, HALVED, HalvedRow, INCOMPLETE, MapRecord, Report, START,
    read_corners, write_results,
};

/// What to do about a file that is missing or broken.
const REMEDY: &str = "copy it from where it was written, or run the config again";
/// The certificate's file.
const CERTIFICATE: &str = "certificate.json";
/// What `qcball report` makes for people, from the other files.
const PAGES: [&str; 2] = ["report.html", "plots"];

/// The folder's content.
pub(super) struct Files {
    pub report: Report,
    pub domain: Domain,
    /// The units in which lengths of the domain and of the images are counted here.
    pub units: [Unit; 2],
    /// Image positions arrived at.
    pub image: Vec<Vec3>,
    /// Image positions started from.
    pub start: Vec<Vec3>,
    /// One row a tet.
    pub cells: Vec<CellRow>,
    pub trace: Vec<TraceRow>,
    pub certificate: Option<Certificate>,
    /// What refinement did to the mesh.
    pub changes: MeshChanges,
    /// The corners of the map, with their exponents.
    pub corners: Option<Corners>,
}

/// The text of the report, which is the record of a run.
pub(super) fn report_text(folder: &Path) -> Result<String, VerifyError> {
    let refuse = |message: String| VerifyError::NoReport { folder: folder.into(), message };
    let text = std::fs::read_to_string(folder.join("report.json")).map_err(|error| {
        let has = |name: &str| folder.join(name).exists();
        if has("cases") || has("index.csv") {
            VerifyError::Sweep { folder: folder.into() }
        } else if has("table.md") {
            VerifyError::Tables { folder: folder.into() }
        } else if has(INCOMPLETE) {
            refuse(format!("its files are not all there, as its {INCOMPLETE} says"))
        } else {
            refuse(format!("its report.json cannot be read ({error})"))
        }
    })?;
    let report: Value =
        serde_json::from_str(&text).map_err(|error| refuse(format!("its report.json is no JSON ({error})")))?;
    match report.get("final") {
        Some(Value::Object(_)) => Ok(text),
        _ => Err(refuse("its report.json has no final map".into())),
    }
}

impl Files {
    /// Reads the files; nothing if they make no map, which is then among the findings.
    pub fn read(folder: &Path, report: &str, findings: &mut Findings) -> Option<Self> {
        findings.begin("the folder has the files of a run and no others, and they can be read");
        let report = serde_json::from_str::<Report>(report);
        let report = report.map_err(|error| findings.found(format!("report.json is no record of a run: {error}"))).ok();
        others(folder, findings);
        let [domain, image] = ["domain.vtu", "image.vtu"].map(|name| {
            let read = read_tet_file(&folder.join(name));
            read.map_err(|error| findings.found(format!("{error}; {REMEDY}"))).ok()
        });
        let cells = table::<CellRow>(&folder.join("cells.csv"), findings);
        let trace = table::<TraceRow>(&folder.join("trace.csv"), findings);
        let certificate = match std::fs::read_to_string(folder.join(CERTIFICATE)) {
            Ok(text) => serde_json::from_str::<Certificate>(&text)
                .map_err(|error| findings.found(format!("certificate.json is no certificate: {error}; {REMEDY}")))
                .ok(),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
            Err(error) => {
                findings.found(format!("certificate.json cannot be read: {error}; {REMEDY}"));
                None
            }
        };
        let refined = folder.join(HALVED);
        let halved = if refined.exists() { table::<HalvedRow>(&refined, findings) } else { Some(Vec::new()) };
        let flipped = folder.join(FLIPPED);
        let flipped = if flipped.exists() { table::<FlippedRow>(&flipped, findings) } else { Some(Vec::new()) };
        let (report, domain, image, cells, trace) = (report?, domain?, image?, cells?, trace?);
        let (halved, flipped) = (halved?, flipped?);
        if let Some(fault) = fault_of_halvings(&halved, domain.soup.points.len()) {
            findings.found(fault);
            return None;
        }
        let halved = halved.iter().map(|row| [row.from, row.to].map(VertexId)).collect();
        let changes = MeshChanges { halved, flips: FlippedRow::flips(&flipped) };

        findings.begin("domain.vtu and image.vtu are one mesh, a ball of positively oriented tets by exact predicate");
        let same = domain.soup.points.len() == image.soup.points.len() && domain.soup.tets == image.soup.tets;
        findings.expect(same, || match domain.soup.tets.iter().zip(&image.soup.tets).position(|(a, b)| a != b) {
            Some(tet) => format!("tet {tet} has other vertices in image.vtu than in domain.vtu"),
            None => "domain.vtu and image.vtu have other numbers of vertices or tets".into(),
        });
        findings.expect(cells.len() == domain.soup.tets.len(), || {
            format!("cells.csv has {} rows for {} tets", cells.len(), domain.soup.tets.len())
        });
        if !same || cells.len() != domain.soup.tets.len() {
            return None;
        }
        let start = vectors(&image, START).map(<[Vec3]>::to_vec).unwrap_or_else(|| {
            findings.found(format!("image.vtu lacks the point data {START:?}"));
            image.soup.points.clone()
        });
        // As the run counted them: what is read from files in a unit of its size.
        let unit = if report.input_hash.is_some() { Unit::of(&domain.soup.points) } else { Unit::default() };
        let data = domain.cell_data;
        let mesh = TetMesh::new(unit.take_points(&domain.soup.points), domain.soup.tets);
        let domain = mesh.map_err(|error| error.to_string());
        let domain = domain.and_then(|mesh| Domain::new(mesh).map_err(|error| error.to_string()));
        let domain = domain.map_err(|error| findings.found(format!("domain.vtu: {error}"))).ok()?;
        let on_boundary = image.soup.points.iter().zip(domain.boundary().vertex_mask()).filter(|(_, on)| **on);
        let of_image = Unit::of_extreme(on_boundary.map(|(point, _)| point));
        let [image, start] = [&image.soup.points, &start].map(|points| of_image.take_points(points));
        findings.begin("the cones at the corners, if there are any, fit together and have the exponents of the report");
        let corners = read_corners(folder, &domain, &data).unwrap_or_else(|error| {
            findings.found(format!("{error}; {REMEDY}"));
            None
        });
        let told =
            report.corners.as_ref().map(|told| told.iter().map(|corner| (corner.vertex, corner.exponent)).collect());
        findings.expect(corners.as_ref().map(Corners::exponents) == told, || {
            format!("{CORNERS} has other corners or exponents than the report")
        });
        let units = [unit, of_image];
        let files = Self { report, domain, units, image, start, cells, trace, certificate, changes, corners };
        files.check_bytes(folder, findings);
        Some(files)
    }

    /// Writes every file once more, from what was read of them: whatever else one holds, or another file contradicts, shows.
    fn check_bytes(&self, folder: &Path, findings: &mut Findings) {
        findings.begin(
            "each file is to the byte what is written for this record and these positions, dilatations and rows",
        );
        let measured =
            |summary: &Summary, dilatations| Measured { dilatations, flipped: Vec::new(), summary: summary.clone() };
        let active: Vec<TetId> =
            (0..).map(TetId).zip(&self.cells).filter(|(_, row)| row.active).map(|(t, _)| t).collect();
        let record = MapRecord {
            domain: &self.domain,
            corners: self.corners.as_ref(),
            changes: &self.changes,
            initial: &self.start,
            image: &self.image,
            measured_initial: &measured(
                &self.report.achieved.initial,
                self.cells.iter().map(CellRow::before).collect(),
            ),
            measured: &measured(&self.report.achieved.last, self.cells.iter().map(CellRow::after).collect()),
            active: &active,
            trace: &self.trace,
            certificate: self.certificate.as_ref(),
            units: self.units,
        };
        let again = tempfile::tempdir().map_err(|error| error.to_string());
        let written = again.and_then(|again| {
            write_results(again.path(), &self.report, &record).map_err(|error| error.to_string()).map(|()| again)
        });
        let again = match written {
            Ok(again) => again,
            Err(error) => return findings.found(format!("the files cannot be written once more: {error}")),
        };
        let further = [
            self.certificate.is_some().then_some(CERTIFICATE),
            self.corners.is_some().then_some(CORNERS),
            (!self.changes.halved.is_empty()).then_some(HALVED),
            (!self.changes.flips.is_empty()).then_some(FLIPPED),
        ];
        for name in FILES.into_iter().chain(further.into_iter().flatten()) {
            let [there, expected] = [folder, again.path()].map(|folder| std::fs::read(folder.join(name)));
            match (there, expected) {
                (Ok(there), Ok(expected)) if there == expected => {}
                (Ok(there), Ok(expected)) => findings.found(difference(name, &there, &expected)),
                (Err(error), _) | (_, Err(error)) => {
                    findings.found(format!("{name} cannot be read: {error}; {REMEDY}"));
                }
            }
        }
        for name in [HALVED, FLIPPED].into_iter().filter(|name| !again.path().join(name).exists()) {
            findings.expect(!folder.join(name).exists(), || {
                format!("{name} is there, but it has no row of this run: take it out of the folder")
            });
        }
        if self.report.revision != Report::REVISION {
            findings.trust(format!(
                "that the program that wrote the folder, {} of revision {}, is the one it calls itself",
                self.report.version, self.report.revision
            ));
        }
    }
}

/// What is wrong with the rows of halvings by themselves: their vertices follow each other, each after the two it is between, up to the last.
fn fault_of_halvings(rows: &[HalvedRow], vertices: usize) -> Option<String> {
    let vertex = |row: &HalvedRow| row.vertex as usize;
    let (first, last) = (vertex(rows.first()?), vertex(rows.last()?));
    let wrong = (first..).zip(rows).position(|(next, row)| vertex(row) != next || row.from.max(row.to) >= row.vertex);
    let name = format!("{HALVED} (counted from 0)");
    match wrong {
        Some(row) if vertex(&rows[row]) != first + row => Some(format!(
            "row {row} of {name} is of vertex {}, but {} comes next: a row is missing there, or one too many",
            rows[row].vertex,
            first + row
        )),
        Some(row) => Some(format!("row {row} of {name} puts no vertex between two that come before it")),
        None if last + 1 != vertices => Some(format!(
            "row {} of {name}, the last, is of vertex {last}, but the last of domain.vtu's {vertices} is {}: rows are missing at its end, or too \
             many",
            rows.len() - 1,
            vertices.saturating_sub(1)
        )),
        None => None,
    }
}

/// Refuses what no run writes.
fn others(folder: &Path, findings: &mut Findings) {
    let known = || FILES.into_iter().chain(PAGES).chain([CERTIFICATE, CORNERS, HALVED, FLIPPED]);
    let names: BTreeSet<String> = match std::fs::read_dir(folder) {
        Ok(entries) => entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect(),
        Err(error) => return findings.found(format!("the folder cannot be listed: {error}")),
    };
    for name in names.iter().filter(|name| !known().any(|known| known == name.as_str())) {
        findings.found(format!("{name} is no file of a run: take it out of the folder"));
    }
    for page in PAGES.into_iter().filter(|page| names.contains(*page)) {
        findings.trust(format!("{page}, made for people from the other files: `qcball report` makes it anew"));
    }
}

/// The first line in which a text differs, or the first byte of what is none.
fn difference(name: &str, there: &[u8], expected: &[u8]) -> String {
    /// Lines are shown up to here.
    const SHOWN: usize = 120;
    let words = format!("{name} is not what is written for this record");
    let (Ok(there_text), Ok(expected_text)) = (std::str::from_utf8(there), std::str::from_utf8(expected)) else {
        return words;
    };
    let lines =
        |text: &'_ str| text.split('\n').map(|line| line.chars().take(SHOWN).collect()).collect::<Vec<String>>();
    let [there, expected] = [there_text, expected_text].map(lines);
    let Some(line) = (0..there.len().max(expected.len())).find(|&line| there.get(line) != expected.get(line)) else {
        return format!("{words}: a line differs from it beyond its first {SHOWN} characters");
    };
    let show = |lines: &[String]| lines.get(line).map_or_else(|| "not there".into(), |line| format!("{line:?}"));
    format!("{words}: line {} is {}, but should be {}", line + 1, show(&there), show(&expected))
}

/// The rows of a CSV file.
fn table<Row: serde::de::DeserializeOwned>(path: &Path, findings: &mut Findings) -> Option<Vec<Row>> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let rows = csv::Reader::from_path(path).and_then(|mut reader| reader.deserialize().collect());
    rows.map_err(|error| findings.found(format!("{name} cannot be read: {error}; {REMEDY}"))).ok()
}

fn vectors<'a>(file: &'a TetFile, name: &str) -> Option<&'a [Vec3]> {
    file.point_vectors.iter().find(|(other, _)| other == name).map(|(_, values)| values.as_slice())
}

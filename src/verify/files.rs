//! The files of a results folder, as far as they can be read.

use std::path::Path;

use serde_json::Value;

use super::{Findings, VerifyError};
use crate::domain::Domain;
use crate::mesh::TetMesh;
use crate::mesh::Vec3;
use crate::mesh::io::{CellData, TetFile, read_tet_file};
use crate::report::CellRow;

/// What to do about a file that is missing or broken.
const REMEDY: &str = "copy it from where it was written, or run the config again";

/// The folder's content.
pub(super) struct Files {
    pub report: Value,
    pub domain: Domain,
    pub image: Vec<Vec3>,
    /// One row a tet.
    pub cells: Vec<CellRow>,
    /// The columns of `trace.csv` that are checked: iteration, max_k and mean_k.
    pub trace: Vec<(usize, f64, f64)>,
    pub summary: String,
    /// The text of `certificate.json`, if there is one.
    pub certificate: Option<String>,
}

/// The report as JSON.
pub(super) fn report(folder: &Path) -> Result<Value, VerifyError> {
    let refuse = |message: String| VerifyError::NoReport { folder: folder.into(), message };
    let text = std::fs::read_to_string(folder.join("report.json")).map_err(|error| {
        let has = |name: &str| folder.join(name).exists();
        if has("cases") || has("index.csv") {
            VerifyError::Sweep { folder: folder.into() }
        } else if has("table.md") {
            VerifyError::Tables { folder: folder.into() }
        } else {
            refuse(format!("its report.json cannot be read ({error})"))
        }
    })?;
    let report: Value =
        serde_json::from_str(&text).map_err(|error| refuse(format!("its report.json is no JSON ({error})")))?;
    match report.get("final") {
        Some(Value::Object(_)) => Ok(report),
        _ => Err(refuse("its report.json has no final map".into())),
    }
}

impl Files {
    /// Reads the rest; nothing if the files make no map, which is then among the findings.
    pub fn read(folder: &Path, report: Value, findings: &mut Findings) -> Option<Self> {
        findings.begin("the files of a run, and certificate.json if it is there, can be read");
        let [domain, image] = ["domain.vtu", "image.vtu"].map(|name| {
            let read = read_tet_file(&folder.join(name));
            read.map_err(|error| findings.found(format!("{error}; {REMEDY}"))).ok()
        });
        let cells = table::<CellRow>(&folder.join("cells.csv"), findings);
        let trace = table::<TraceColumns>(&folder.join("trace.csv"), findings);
        let summary = std::fs::read_to_string(folder.join("summary.txt"))
            .map_err(|error| findings.found(format!("summary.txt cannot be read: {error}; {REMEDY}")))
            .ok();
        let certificate = folder.join("certificate.json");
        let certificate = match certificate.exists().then(|| std::fs::read_to_string(&certificate)).transpose() {
            Ok(text) => text,
            Err(error) => {
                findings.found(format!("certificate.json cannot be read: {error}; {REMEDY}"));
                None
            }
        };
        let (domain, image, cells, trace, summary) = (domain?, image?, cells?, trace?, summary?);

        findings.begin("domain.vtu and image.vtu have the same tets, and the same data on them as cells.csv");
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
        for (name, file) in [("domain.vtu", &domain), ("image.vtu", &image)] {
            compare_cell_data(name, file, &cells, findings);
        }

        findings.begin("the domain is a ball of positively oriented tets, by exact predicate");
        let mesh = TetMesh::new(domain.soup.points, domain.soup.tets).map_err(|error| error.to_string());
        let domain = mesh.and_then(|mesh| Domain::new(mesh).map_err(|error| error.to_string()));
        let domain = domain.map_err(|error| findings.found(format!("domain.vtu: {error}"))).ok()?;
        let trace = trace.into_iter().map(|row| (row.iteration, row.max_k, row.mean_k)).collect();
        Some(Self { report, domain, image: image.soup.points, cells, trace, summary, certificate })
    }
}

#[derive(serde::Deserialize)]
struct TraceColumns {
    iteration: usize,
    max_k: f64,
    mean_k: f64,
}

/// The rows of a CSV file.
fn table<Row: serde::de::DeserializeOwned>(path: &Path, findings: &mut Findings) -> Option<Vec<Row>> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let rows = csv::Reader::from_path(path).and_then(|mut reader| reader.deserialize().collect());
    rows.map_err(|error| findings.found(format!("{name} cannot be read: {error}; {REMEDY}"))).ok()
}

/// Compares the scalars on a mesh's cells with the rows of `cells.csv`, to the bit: both hold all digits.
fn compare_cell_data(name: &str, file: &TetFile, cells: &[CellRow], findings: &mut Findings) {
    let column = |value: fn(&CellRow) -> f64| -> Vec<f64> { cells.iter().map(value).collect() };
    let expected = [
        ("K", column(|row| row.k)),
        ("K_inner", column(|row| row.k_inner)),
        ("K_outer", column(|row| row.k_outer)),
        ("K_initial", column(|row| row.k_initial)),
        ("volume", column(|row| row.volume)),
        ("active", column(|row| f64::from(u8::from(row.active)))),
        ("locked", column(|row| f64::from(u8::from(row.locked)))),
    ];
    for (array, expected) in expected {
        match scalars(&file.cell_data, array) {
            None => findings.found(format!("{name} lacks the cell data {array:?}")),
            Some(values) => {
                if let Some(tet) = values.iter().zip(&expected).position(|(a, b)| a != b) {
                    let (there, here) = (values[tet], expected[tet]);
                    findings.found(format!("{name} gives tet {tet} {array} = {there}, cells.csv {here}"));
                }
            }
        }
    }
}

fn scalars<'a>(data: &'a CellData, name: &str) -> Option<&'a [f64]> {
    data.iter().find(|(other, _)| other == name).map(|(_, values)| values.as_slice())
}

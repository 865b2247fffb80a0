//! `corners.csv` and the number of each tet's cone: the corners of a map in files.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::domain::Domain;
use crate::map::{Cone, Corners};
use crate::mesh::VertexId;
use crate::mesh::io::CellData;

/// The file with a row a cone.
pub(crate) const CORNERS: &str = "corners.csv";
/// The name of the array with the cone of each tet, -1 for a tet in none.
pub(crate) const CONE: &str = "cone";

/// One line of `corners.csv`: the warp of a cone with its apex at the vertex `corner` and three vertices of its base. All
/// count from 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct ConeRow {
    cone: usize,
    corner: u32,
    base_0: u32,
    base_1: u32,
    base_2: u32,
    exponent: f64,
}

/// The rows of `corners.csv`.
pub(super) fn cone_rows(corners: &Corners) -> impl Iterator<Item = ConeRow> {
    corners.cones().iter().enumerate().map(|(cone, &Cone { corner, base, exponent })| {
        let [base_0, base_1, base_2] = base.map(|v| v.0);
        ConeRow { cone, corner: corner.0, base_0, base_1, base_2, exponent }
    })
}

/// The array [`CONE`].
pub(super) fn cone_numbers(corners: &Corners) -> Vec<f64> {
    corners.of_tets().iter().map(|cone| cone.map_or(-1.0, f64::from)).collect()
}

/// Reads the corners of the map of a folder, if it has any; `cell_data` is that of its `domain.vtu`.
///
/// # Errors
/// Why the files give no corners, in words that name the file.
pub(crate) fn read_corners(folder: &Path, domain: &Domain, cell_data: &CellData) -> Result<Option<Corners>, String> {
    let path = folder.join(CORNERS);
    let numbers = cell_data.iter().find(|(name, _)| name == CONE).map(|(_, numbers)| numbers);
    let numbers = match (path.exists(), numbers) {
        (false, None) => return Ok(None),
        (true, Some(numbers)) => numbers,
        (true, None) => return Err(format!("domain.vtu lacks the cell data {CONE:?} that {CORNERS} belongs to")),
        (false, Some(_)) => return Err(format!("{CORNERS} is missing, of which domain.vtu numbers the cones")),
    };
    let rows: Result<Vec<ConeRow>, csv::Error> =
        csv::Reader::from_path(&path).and_then(|mut reader| reader.deserialize().collect());
    let rows = rows.map_err(|error| format!("{CORNERS} cannot be read: {error}"))?;
    if let Some(row) = (0..).zip(&rows).find_map(|(number, row)| (row.cone != number).then_some(number)) {
        return Err(format!("row {row} of {CORNERS} (counted from 0) is of cone {}", rows[row].cone));
    }
    let cone = |row: &ConeRow| Cone {
        corner: VertexId(row.corner),
        base: [row.base_0, row.base_1, row.base_2].map(VertexId),
        exponent: row.exponent,
    };
    let of_tet = |(tet, &number): (usize, &f64)| match number {
        -1.0 => Ok(None),
        _ if number >= 0.0 && number < rows.len() as f64 && number.fract() == 0.0 => Ok(Some(number as u32)),
        _ => Err(format!("tet {tet} of domain.vtu is in cone {number}, which {CORNERS} does not have")),
    };
    let of_tet = numbers.iter().enumerate().map(of_tet).collect::<Result<_, String>>()?;
    let corners = Corners::new(domain, rows.iter().map(cone).collect(), of_tet);
    corners.map(Some).map_err(|error| format!("{CORNERS}: {error}"))
}

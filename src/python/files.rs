//! Meshes and maps in files, and a map as a page.

use std::path::{Path, PathBuf};

use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use qcball::mesh::io::{DataArray, SolidFile, Values, read_solid, read_tet_file, write_vtu};
use qcball::mesh::{TetMesh, Unit};
use qcball::optimize::TraceRow;
use qcball::report::{ShownMap, page_of_map};
use qcball::solid::Surface;
use qcball::{Vec3, VertexId, arrays};

use super::{cells_of, floats, floats_of, indices, points_of, positions, value_error};

/// The arrays on the tets.
const COLUMNS: [&str; 3] = ["K", "K_inner", "K_outer"];

/// Points, cells, and how many corners a cell has: 4, or 3 in a file of a surface.
#[pyfunction]
pub(super) fn read<'py>(py: Python<'py>, path: PathBuf) -> PyResult<(Bound<'py, PyBytes>, Bound<'py, PyBytes>, usize)> {
    let (points, cells, corners) = py.detach(|| solid(&path)).map_err(value_error)?;
    Ok((positions(py, &points), indices(py, &cells), corners))
}

fn solid(path: &Path) -> Result<(Vec<Vec3>, Vec<u32>, usize), String> {
    Ok(match read_solid(path).map_err(|error| error.to_string())? {
        SolidFile::Tets(soup) => (soup.points, soup.tets.iter().flatten().map(|v| v.0).collect(), 4),
        SolidFile::Surface(soup) => {
            let surface = Surface::from_soup(soup).map_err(|error| format!("{}: {error}", path.display()))?;
            (surface.points().to_vec(), surface.triangles().iter().flatten().map(|v| v.0).collect(), 3)
        }
    })
}

/// Writes `domain.vtu` and `image.vtu`; `columns` are K, K_I and K_O of each tet.
#[pyfunction]
pub(super) fn save(
    py: Python<'_>,
    folder: PathBuf,
    points: &[u8],
    tets: &[u8],
    image: &[u8],
    columns: [Vec<u8>; 3],
) -> PyResult<()> {
    let [points, image] = [points, image].map(|rows| points_of(rows).into_iter().map(Vec3::from).collect::<Vec<_>>());
    let tets: Vec<[VertexId; 4]> = cells_of::<4>(tets).into_iter().map(|tet| tet.map(VertexId)).collect();
    let columns = columns.map(|column| floats_of(&column));
    let written = py.detach(|| {
        let data = [0, 1, 2].map(|at| DataArray { name: COLUMNS[at], values: Values::Scalars(&columns[at]) });
        let [there, here] = [("image_position", &image), ("domain_position", &points)]
            .map(|(name, rows)| [DataArray { name, values: Values::Vectors(rows) }]);
        write_vtu(&folder.join("domain.vtu"), &points, &tets, &there, &data)?;
        write_vtu(&folder.join("image.vtu"), &image, &tets, &here, &data)
    });
    // A full disk or a folder that may not be written to.
    written.map_err(|error| pyo3::exceptions::PyOSError::new_err(error.to_string()))
}

/// The map of a folder with `domain.vtu` and `image.vtu`, K as the files have it.
#[pyfunction]
pub(super) fn load(py: Python<'_>, folder: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let [domain, image] = ["domain.vtu", "image.vtu"].map(|name| read_tet_file(&folder.join(name)));
    let (domain, image) = (domain.map_err(value_error)?, image.map_err(value_error)?);
    if image.soup.tets != domain.soup.tets || image.soup.points.len() != domain.soup.points.len() {
        return Err(value_error(format!("{}: domain.vtu and image.vtu are not one mesh", folder.display())));
    }
    let column =
        |name: &str| domain.cell_data.iter().find(|(found, _)| found == name).map(|(_, values)| values.clone());
    let columns = match COLUMNS.map(column) {
        [Some(k), Some(inner), Some(outer)] => [k, inner, outer],
        _ => {
            let [points, image] =
                [&domain, &image].map(|file| file.soup.points.iter().map(|&p| p.into()).collect::<Vec<[f64; 3]>>());
            let tets: Vec<[u32; 4]> = domain.soup.tets.iter().map(|tet| tet.map(|v| v.0)).collect();
            let measured = py.detach(|| arrays::measure(&points, &tets, &image)).map_err(value_error)?;
            [measured.k, measured.k_inner, measured.k_outer]
        }
    };
    let result = PyDict::new(py);
    result.set_item("points", positions(py, &domain.soup.points))?;
    result.set_item("cells", indices(py, &domain.soup.tets.iter().flatten().map(|v| v.0).collect::<Vec<u32>>()))?;
    result.set_item("image", positions(py, &image.soup.points))?;
    for (name, values) in COLUMNS.into_iter().zip(&columns) {
        result.set_item(name, floats(py, values))?;
    }
    Ok(result)
}

/// An HTML document with both sides of a map; `columns` are K_I and K_O of each tet.
#[pyfunction]
pub(super) fn page(
    py: Python<'_>,
    words: (String, String),
    map: (Vec<u8>, Vec<u8>, Vec<u8>),
    columns: [Vec<u8>; 2],
    best_bound: Option<f64>,
    trace: &str,
) -> PyResult<String> {
    let [points, image] = [&map.0, &map.2].map(|rows| points_of(rows).into_iter().map(Vec3::from).collect::<Vec<_>>());
    let tets = cells_of::<4>(&map.1).into_iter().map(|tet| tet.map(VertexId)).collect();
    let [inner, outer] = columns.map(|column| floats_of(&column));
    let trace: Vec<TraceRow> = serde_json::from_str(trace).map_err(value_error)?;
    let (title, words) = words;
    py.detach(|| {
        // The sign of a volume may be out of the range of numbers.
        let unit = Unit::of_extreme(&points);
        let mesh = TetMesh::new(unit.take_points(&points), tets).map_err(|error| error.to_string())?;
        let mesh = &mesh.in_unit(unit.inverse());
        let (title, words) = (title.as_str(), words.as_str());
        page_of_map(&ShownMap {
            title,
            words,
            mesh,
            image: &image,
            inner: &inner,
            outer: &outer,
            best_bound,
            trace: &trace,
        })
        .map_err(|error| error.to_string())
    })
    .map_err(value_error)
}

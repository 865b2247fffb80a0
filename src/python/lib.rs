//! The compiled half of the Python package: bytes of arrays in, bytes of arrays out. `qcball/__init__.py` checks what it is given
//! and says what comes back.

mod files;
mod task;

use std::ffi::OsString;
use std::path::PathBuf;
use std::time::Duration;

use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use qcball::arrays::{self, BallMapSettings, BoundaryMap, MappedMesh};
use qcball::bound::best_applicable;
use qcball::map::Onto;
use qcball::solid::{CentreChoice, StarKernel, Surface};
use qcball::sphere::SphereSettings;
use qcball::{LowerBound, Vec3, VertexId};

use task::{Options, array_error};

fn value_error(error: impl ToString) -> PyErr {
    PyValueError::new_err(error.to_string())
}

fn points_of(bytes: &[u8]) -> Vec<[f64; 3]> {
    floats_of(bytes).as_chunks::<3>().0.to_vec()
}

fn floats_of(bytes: &[u8]) -> Vec<f64> {
    bytes.as_chunks::<8>().0.iter().map(|chunk| f64::from_ne_bytes(*chunk)).collect()
}

fn cells_of<const N: usize>(bytes: &[u8]) -> Vec<[u32; N]> {
    let numbers: Vec<u32> = bytes.as_chunks::<4>().0.iter().map(|chunk| u32::from_ne_bytes(*chunk)).collect();
    numbers.as_chunks::<N>().0.to_vec()
}

fn floats<'py>(py: Python<'py>, numbers: &[f64]) -> Bound<'py, PyBytes> {
    PyBytes::new(py, &numbers.iter().flat_map(|x| x.to_ne_bytes()).collect::<Vec<u8>>())
}

fn positions<'py>(py: Python<'py>, points: &[Vec3]) -> Bound<'py, PyBytes> {
    floats(py, &points.iter().flat_map(|p| [p.x, p.y, p.z]).collect::<Vec<f64>>())
}

fn indices<'py>(py: Python<'py>, numbers: &[u32]) -> Bound<'py, PyBytes> {
    PyBytes::new(py, &numbers.iter().flat_map(|x| x.to_ne_bytes()).collect::<Vec<u8>>())
}

fn json(value: &impl serde::Serialize) -> PyResult<String> {
    serde_json::to_string(value).map_err(|error| PyRuntimeError::new_err(error.to_string()))
}

fn seconds(given: Option<f64>) -> PyResult<Option<Duration>> {
    given.map(Duration::try_from_secs_f64).transpose().map_err(value_error)
}

fn centre_of(centre: Option<[f64; 3]>) -> CentreChoice {
    centre.map_or(CentreChoice::Kernel, |centre| CentreChoice::At(Vec3::from(centre)))
}

fn map_to_python<'py>(py: Python<'py>, map: &MappedMesh) -> PyResult<Bound<'py, PyDict>> {
    let result = PyDict::new(py);
    result.set_item("points", floats(py, map.points.as_flattened()))?;
    result.set_item("cells", indices(py, map.tets.as_flattened()))?;
    result.set_item("image", floats(py, map.image.as_flattened()))?;
    result.set_item("K", floats(py, &map.k))?;
    result.set_item("K_inner", floats(py, &map.k_inner))?;
    result.set_item("K_outer", floats(py, &map.k_outer))?;
    result.set_item("max_K", map.summary.max_k)?;
    result.set_item("mean_K", map.summary.mean_k)?;
    result.set_item("ball_K", map.summary.ball_k.map(|k| k.certified))?;
    result.set_item("bijective", map.bijective)?;
    result.set_item("stop", json(&map.stop)?)?;
    result.set_item("bounds", json(&map.bounds)?)?;
    result.set_item("best_bound", best(&map.bounds))?;
    result.set_item("trace", json(&map.trace)?)?;
    Ok(result)
}

fn best(bounds: &[LowerBound]) -> Option<f64> {
    best_applicable(bounds).map(|bound| bound.value)
}

/// What a caller may set of a map onto the ball.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct BallOptions {
    centre: Option<[f64; 3]>,
    exponent: f64,
    boundary: String,
    cells_wanted: Option<usize>,
    certify: Option<f64>,
}

/// `cells` are tets, or with `corners` = 3 the triangles of a surface.
#[pyfunction]
fn ball_map<'py>(
    py: Python<'py>,
    points: &[u8],
    cells: &[u8],
    corners: usize,
    ball: BallOptions,
    options: Options,
) -> PyResult<Bound<'py, PyDict>> {
    let points = points_of(points);
    let mut settings = BallMapSettings::default();
    settings.centre = centre_of(ball.centre);
    settings.exponent = ball.exponent;
    settings.boundary = match ball.boundary.as_str() {
        "radial" => BoundaryMap::Radial,
        "spherical" => BoundaryMap::Spherical,
        _ => BoundaryMap::Auto,
    };
    settings.certify = seconds(ball.certify)?;
    settings.optimize = options.settings()?;
    let cancel = settings.optimize.cancel.clone();
    let map = if corners == 3 {
        let triangles = cells_of::<3>(cells);
        options.run(py, &cancel, |observe| {
            arrays::ball_map_of_surface(&points, &triangles, ball.cells_wanted, &settings, observe)
        })
    } else {
        let tets = cells_of::<4>(cells);
        options.run(py, &cancel, |observe| arrays::ball_map_observed(&points, &tets, &settings, observe))
    };
    map_to_python(py, &map?.map_err(array_error)?)
}

#[pyfunction]
fn optimize<'py>(
    py: Python<'py>,
    points: &[u8],
    tets: &[u8],
    image: &[u8],
    fixed: Option<Vec<bool>>,
    options: Options,
) -> PyResult<Bound<'py, PyDict>> {
    let (points, tets, image) = (points_of(points), cells_of::<4>(tets), points_of(image));
    let settings = options.settings()?;
    let map = options.run(py, &settings.cancel, |observe| {
        arrays::optimize_observed(&points, &tets, &image, fixed.as_deref(), &settings, observe)
    })?;
    map_to_python(py, &map.map_err(value_error)?)
}

#[pyfunction]
fn measure<'py>(py: Python<'py>, points: &[u8], tets: &[u8], image: &[u8]) -> PyResult<Bound<'py, PyDict>> {
    let (points, tets, image) = (points_of(points), cells_of::<4>(tets), points_of(image));
    let measured = py.detach(|| arrays::measure(&points, &tets, &image)).map_err(value_error)?;
    let result = PyDict::new(py);
    result.set_item("K", floats(py, &measured.k))?;
    result.set_item("K_inner", floats(py, &measured.k_inner))?;
    result.set_item("K_outer", floats(py, &measured.k_outer))?;
    result.set_item("flipped", indices(py, &measured.flipped))?;
    result.set_item("max_K", measured.summary.max_k)?;
    result.set_item("mean_K", measured.summary.mean_k)?;
    Ok(result)
}

#[pyfunction]
fn bounds(
    py: Python<'_>,
    points: &[u8],
    tets: &[u8],
    image: &[u8],
    certify: Option<f64>,
) -> PyResult<(String, Option<f64>)> {
    let (points, tets, image) = (points_of(points), cells_of::<4>(tets), points_of(image));
    let certify = seconds(certify)?;
    let bounds = py.detach(|| arrays::bounds(&points, &tets, &image, certify)).map_err(value_error)?;
    Ok((json(&bounds)?, best(&bounds)))
}

#[pyfunction]
fn star_kernel(py: Python<'_>, points: &[u8], triangles: &[u8]) -> PyResult<([f64; 3], f64)> {
    let points = points_of(points).into_iter().map(Vec3::from).collect();
    let triangles: Vec<[VertexId; 3]> = cells_of::<3>(triangles).into_iter().map(|t| t.map(VertexId)).collect();
    let kernel = py.detach(|| {
        let surface = Surface::from_triangles(points, &triangles).map_err(|error| error.to_string())?;
        StarKernel::of(&surface).map_err(|error| error.to_string())
    });
    let kernel = kernel.map_err(value_error)?;
    Ok((kernel.centre.into(), kernel.radius))
}

#[pyfunction]
fn radial_map<'py>(
    py: Python<'py>,
    points: &[u8],
    tets: &[u8],
    centre: Option<[f64; 3]>,
    exponent: f64,
) -> PyResult<Bound<'py, PyBytes>> {
    let (points, tets, centre) = (points_of(points), cells_of::<4>(tets), centre_of(centre));
    let image = py.detach(|| arrays::radial_map(&points, &tets, &centre, exponent)).map_err(value_error)?;
    Ok(floats(py, image.as_flattened()))
}

#[pyfunction]
fn sphere_map<'py>(
    py: Python<'py>,
    points: &[u8],
    triangles: &[u8],
    area_weight: f64,
    shrinkage_weight: f64,
) -> PyResult<Bound<'py, PyBytes>> {
    let (points, triangles) = (points_of(points), cells_of::<3>(triangles));
    let settings = SphereSettings { area_weight, shrinkage_weight };
    let image = py.detach(|| arrays::sphere_map(&points, &triangles, &settings)).map_err(value_error)?;
    Ok(floats(py, image.as_flattened()))
}

/// NaN where a point lies outside.
#[pyfunction]
fn evaluate<'py>(
    py: Python<'py>,
    map: (Vec<u8>, Vec<u8>, Vec<u8>),
    at: &[u8],
    inverse: bool,
    onto_ball: bool,
) -> PyResult<Bound<'py, PyBytes>> {
    let (points, tets, image) = (points_of(&map.0), cells_of::<4>(&map.1), points_of(&map.2));
    let at = points_of(at);
    let onto = if onto_ball { Onto::Ball } else { Onto::Polyhedron };
    let call = if inverse { arrays::inverse } else { arrays::evaluate };
    let found = py.detach(|| call(&points, &tets, &image, &at, onto)).map_err(value_error)?;
    let found: Vec<[f64; 3]> = found.into_iter().map(|position| position.unwrap_or([f64::NAN; 3])).collect();
    Ok(floats(py, found.as_flattened()))
}

/// The command `qcball`; the exit code.
#[pyfunction]
fn main(py: Python<'_>, program: PathBuf, arguments: Vec<OsString>) -> u8 {
    py.detach(|| qcball::cli::call(&program, &arguments))
}

#[pymodule]
fn _qcball(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(ball_map, module)?)?;
    module.add_function(wrap_pyfunction!(optimize, module)?)?;
    module.add_function(wrap_pyfunction!(measure, module)?)?;
    module.add_function(wrap_pyfunction!(bounds, module)?)?;
    module.add_function(wrap_pyfunction!(star_kernel, module)?)?;
    module.add_function(wrap_pyfunction!(radial_map, module)?)?;
    module.add_function(wrap_pyfunction!(sphere_map, module)?)?;
    module.add_function(wrap_pyfunction!(evaluate, module)?)?;
    module.add_function(wrap_pyfunction!(files::read, module)?)?;
    module.add_function(wrap_pyfunction!(files::save, module)?)?;
    module.add_function(wrap_pyfunction!(files::load, module)?)?;
    module.add_function(wrap_pyfunction!(files::page, module)?)?;
    module.add_function(wrap_pyfunction!(task::run, module)?)?;
    module.add_function(wrap_pyfunction!(task::sweep, module)?)?;
    module.add_function(wrap_pyfunction!(main, module)?)
}

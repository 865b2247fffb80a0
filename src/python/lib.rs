//! The compiled half of the Python package: bytes of arrays in, bytes of arrays out. `qcball/__init__.py` checks what it is given
//! and says what comes back.

use std::sync::{Mutex, PoisonError, mpsc};
use std::time::Duration;

use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use qcball::arrays::{self, BallMapSettings, MappedMesh};
use qcball::bound::best_applicable;
use qcball::mesh::io::read_tets;
use qcball::optimize::{OptimizeSettings, Polish, TraceRow};
use qcball::solid::{CentreChoice, StarKernel, Surface};
use qcball::{LowerBound, Vec3, VertexId};

/// How often a signal is looked for.
const POLL: Duration = Duration::from_millis(50);

fn value_error(error: impl ToString) -> PyErr {
    PyValueError::new_err(error.to_string())
}

fn points_of(bytes: &[u8]) -> Vec<[f64; 3]> {
    let numbers: Vec<f64> = bytes.as_chunks::<8>().0.iter().map(|chunk| f64::from_ne_bytes(*chunk)).collect();
    numbers.as_chunks::<3>().0.to_vec()
}

fn cells_of<const N: usize>(bytes: &[u8]) -> Vec<[u32; N]> {
    let numbers: Vec<u32> = bytes.as_chunks::<4>().0.iter().map(|chunk| u32::from_ne_bytes(*chunk)).collect();
    numbers.as_chunks::<N>().0.to_vec()
}

fn floats<'py>(py: Python<'py>, numbers: &[f64]) -> Bound<'py, PyBytes> {
    PyBytes::new(py, &numbers.iter().flat_map(|x| x.to_ne_bytes()).collect::<Vec<u8>>())
}

fn indices<'py>(py: Python<'py>, numbers: &[u32]) -> Bound<'py, PyBytes> {
    PyBytes::new(py, &numbers.iter().flat_map(|x| x.to_ne_bytes()).collect::<Vec<u8>>())
}

fn json(value: &impl serde::Serialize) -> PyResult<String> {
    serde_json::to_string(value).map_err(|error| PyRuntimeError::new_err(error.to_string()))
}

/// What a caller may set of an optimization, and how he watches it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct Options {
    time_limit: Option<f64>,
    max_iterations: usize,
    tolerance: f64,
    polish: bool,
    threads: usize,
    observe: Option<Py<PyAny>>,
}

impl Options {
    fn settings(&self) -> PyResult<OptimizeSettings> {
        Ok(OptimizeSettings {
            max_iterations: self.max_iterations,
            tolerance: self.tolerance,
            polish: if self.polish { Polish::Mean } else { Polish::None },
            time_limit: self.time_limit.map(Duration::try_from_secs_f64).transpose().map_err(value_error)?,
            ..OptimizeSettings::default()
        })
    }

    /// Does a job on a thread of its own while this one, without the interpreter's lock, waits for signals: one of them, or an
    /// error of the observer, calls `stop`, and the job is expected to end soon with what it has.
    fn run<T: Send>(
        &self,
        py: Python<'_>,
        stop: impl Fn() + Sync,
        job: impl FnOnce(&mut dyn FnMut(&TraceRow)) -> T + Send,
    ) -> PyResult<T> {
        let observer = self.observe.as_ref().map(|observe| observe.clone_ref(py));
        let (threads, stop) = (self.threads, &stop);
        std::thread::scope(|scope| {
            let (done, finished) = mpsc::channel();
            scope.spawn(move || {
                let result = qcball::experiment::on_threads(threads, move || {
                    let mut failed: Option<PyErr> = None;
                    let result = job(&mut |row| {
                        let (Some(observer), None) = (&observer, &failed) else { return };
                        let row = (row.phase.as_str(), row.iteration, row.max_k, row.mean_k, row.progress, row.seconds);
                        failed = Python::attach(|py| observer.call1(py, row)).err();
                        if failed.is_some() {
                            stop();
                        }
                    });
                    (result, failed)
                });
                // Nobody is left to hear if the other side is gone.
                let _ = done.send(result);
            });
            // Only to be shared with the closure that waits.
            let finished = Mutex::new(finished);
            loop {
                let waited = py.detach(|| finished.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(POLL));
                match waited {
                    Ok(Ok((_, Some(error)))) => return Err(error),
                    Ok(Ok((result, None))) => return Ok(result),
                    Ok(Err(error)) => return Err(value_error(error)),
                    Err(mpsc::RecvTimeoutError::Timeout) => {
                        if py.check_signals().is_err() {
                            stop();
                        }
                    }
                    Err(mpsc::RecvTimeoutError::Disconnected) => {
                        return Err(PyRuntimeError::new_err("the computation ended without a result"));
                    }
                }
            }
        })
    }
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

#[pyfunction]
fn ball_map<'py>(
    py: Python<'py>,
    points: &[u8],
    tets: &[u8],
    centre: Option<[f64; 3]>,
    exponent: f64,
    certify: Option<f64>,
    options: Options,
) -> PyResult<Bound<'py, PyDict>> {
    let (points, tets) = (points_of(points), cells_of::<4>(tets));
    let mut settings = BallMapSettings::default();
    settings.centre = centre.map_or(CentreChoice::Kernel, |centre| CentreChoice::At(Vec3::from(centre)));
    settings.exponent = exponent;
    settings.certify = certify.map(Duration::try_from_secs_f64).transpose().map_err(value_error)?;
    settings.optimize = options.settings()?;
    let cancel = settings.optimize.cancel.clone();
    let stop = || {
        cancel.raise();
    };
    let map = options.run(py, stop, |observe| arrays::ball_map_observed(&points, &tets, &settings, observe))?;
    map_to_python(py, &map.map_err(value_error)?)
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
    let cancel = settings.cancel.clone();
    let stop = || {
        cancel.raise();
    };
    let map = options.run(py, stop, |observe| {
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
    let certify = certify.map(Duration::try_from_secs_f64).transpose().map_err(value_error)?;
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
fn read<'py>(py: Python<'py>, path: std::path::PathBuf) -> PyResult<(Bound<'py, PyBytes>, Bound<'py, PyBytes>)> {
    let soup = py.detach(|| read_tets(&path)).map_err(value_error)?;
    let points: Vec<f64> = soup.points.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
    let tets: Vec<u32> = soup.tets.iter().flatten().map(|v| v.0).collect();
    Ok((floats(py, &points), indices(py, &tets)))
}

#[pymodule]
fn _qcball(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(ball_map, module)?)?;
    module.add_function(wrap_pyfunction!(optimize, module)?)?;
    module.add_function(wrap_pyfunction!(measure, module)?)?;
    module.add_function(wrap_pyfunction!(bounds, module)?)?;
    module.add_function(wrap_pyfunction!(star_kernel, module)?)?;
    module.add_function(wrap_pyfunction!(read, module)?)
}

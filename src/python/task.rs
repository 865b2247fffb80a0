//! Work that takes its time: watched, and ended by a signal.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError, mpsc};
use std::time::Duration;

use pyo3::exceptions::{PyKeyboardInterrupt, PyOSError, PyRuntimeError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use qcball::arrays::ArrayError;
use qcball::experiment::{self, Finished, RunError, on_threads};
use qcball::optimize::{BoundaryValues, OptimizeSettings, Polish, TraceRow};
use qcball::report::{write_pages_of, write_results};
use qcball::solid::ShellError;
use qcball::sweep::{Case, Ended, Event, Sweep, SweepFolder, SweepSettings, write_index};
use qcball::{Cancel, Plan};

use super::{floats, indices, json, positions, value_error};

/// How often a signal is looked for.
const POLL: Duration = Duration::from_millis(50);

/// What a caller may set of an optimization, and how he watches it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(super) struct Options {
    time_limit: Option<f64>,
    max_iterations: usize,
    tolerance: f64,
    polish: bool,
    sliding: bool,
    threads: usize,
    observe: Option<Py<PyAny>>,
}

impl Options {
    pub(super) fn settings(&self) -> PyResult<OptimizeSettings> {
        Ok(OptimizeSettings {
            max_iterations: self.max_iterations,
            tolerance: self.tolerance,
            polish: if self.polish { Polish::Mean } else { Polish::None },
            boundary_values: if self.sliding { BoundaryValues::Sliding } else { BoundaryValues::Fixed },
            time_limit: super::seconds(self.time_limit)?,
            ..OptimizeSettings::default()
        })
    }

    /// Does a job on so many threads; the observer sees every row.
    pub(super) fn run<T: Send>(
        &self,
        py: Python<'_>,
        cancel: &Cancel,
        job: impl FnOnce(&mut (dyn FnMut(&TraceRow) + Send)) -> T + Send,
    ) -> PyResult<T> {
        let watch = Watch::new(py, &self.observe, cancel);
        let threads = self.threads;
        let done = waited(py, cancel, || {
            on_threads(threads, || {
                job(&mut |row| {
                    watch.call(|| {
                        (row.phase.to_string(), row.iteration, row.max_k, row.mean_k, row.progress, row.seconds)
                    });
                })
            })
        })?;
        watch.ended()?;
        done.map_err(value_error)
    }
}

/// An error before there was a map: the caller's own signal, or a fault of the arrays.
pub(super) fn array_error(error: ArrayError) -> PyErr {
    match error {
        ArrayError::Shell(ShellError::Cancelled) => PyKeyboardInterrupt::new_err("there was no map yet"),
        error => value_error(error),
    }
}

/// A function of the caller; its first error ends the work.
struct Watch<'a> {
    observer: Option<Py<PyAny>>,
    cancel: &'a Cancel,
    failed: Mutex<Option<PyErr>>,
}

impl<'a> Watch<'a> {
    fn new(py: Python<'_>, observer: &Option<Py<PyAny>>, cancel: &'a Cancel) -> Self {
        Self { observer: observer.as_ref().map(|observer| observer.clone_ref(py)), cancel, failed: Mutex::new(None) }
    }

    fn failed(&self) -> std::sync::MutexGuard<'_, Option<PyErr>> {
        self.failed.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn call<A: for<'py> pyo3::call::PyCallArgs<'py>>(&self, arguments: impl FnOnce() -> A) {
        let Some(observer) = &self.observer else { return };
        if self.failed().is_some() {
            return;
        }
        // Never with the lock held: the interpreter may wait for another thread that wants it.
        if let Err(error) = Python::attach(|py| observer.call1(py, arguments()).map(|_| ())) {
            *self.failed() = Some(error);
            self.cancel.raise();
        }
    }

    fn ended(self) -> PyResult<()> {
        match self.failed.into_inner().unwrap_or_else(PoisonError::into_inner) {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }
}

/// Does a job on a thread of its own while this one, without the interpreter's lock, waits for signals: one of them raises
/// `cancel`, and the job is expected to end soon with what it has.
fn waited<T: Send>(py: Python<'_>, cancel: &Cancel, job: impl FnOnce() -> T + Send) -> PyResult<T> {
    std::thread::scope(|scope| {
        let (done, finished) = mpsc::channel();
        scope.spawn(move || {
            // Nobody is left to hear if the other side is gone.
            let _ = done.send(job());
        });
        // Only to be shared with the closure that waits.
        let finished = Mutex::new(finished);
        loop {
            let waited = py.detach(|| finished.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(POLL));
            match waited {
                Ok(result) => return Ok(result),
                Err(mpsc::RecvTimeoutError::Timeout) => {
                    if py.check_signals().is_err() {
                        cancel.raise();
                    }
                }
                Err(mpsc::RecvTimeoutError::Disconnected) => {
                    return Err(PyRuntimeError::new_err("the computation ended without a result"));
                }
            }
        }
    })
}

fn os_error(error: impl ToString) -> PyErr {
    PyOSError::new_err(error.to_string())
}

/// A run of a config; its files go to `out`, if there is one. The program of a mesher that the config names comes back too.
#[pyfunction]
pub(super) fn run<'py>(
    py: Python<'py>,
    config: PathBuf,
    overrides: Vec<String>,
    out: Option<PathBuf>,
    threads: Option<usize>,
    observe: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let mut plan = Plan::read(&config, &overrides).map_err(|error| value_error(with_help(&error)))?;
    if let Some(threads) = threads {
        plan.threads = Some(threads).filter(|&threads| threads > 0);
    }
    let cancel = plan.optimize.cancel.clone();
    let watch = Watch::new(py, &observe, &cancel);
    let finished = waited(py, &cancel, || {
        experiment::run_or_leave(&plan, &mut |row| {
            watch.call(|| (row.phase.to_string(), row.iteration, row.max_k, row.mean_k, row.progress, row.seconds));
        })
    })?;
    watch.ended()?;
    let finished = finished.map_err(|error| match error {
        RunError::Interrupted => PyKeyboardInterrupt::new_err("there was no map yet"),
        error => value_error(error),
    })?;
    if let Some(folder) = out {
        py.detach(|| {
            write_results(&folder, &finished.report, &finished.record()).map_err(|error| error.to_string())?;
            write_pages_of(&folder, &finished.report, &finished.record()).map_err(|error| error.to_string())
        })
        .map_err(os_error)?;
    }
    finished_to_python(py, &finished)
}

fn with_help(error: &qcball::config::ConfigError) -> String {
    format!("{error}; {}", error.help())
}

fn finished_to_python<'py>(py: Python<'py>, finished: &Finished) -> PyResult<Bound<'py, PyDict>> {
    let Finished { report, domain, outcome, measured, units, corners, .. } = finished;
    let column = |value: fn(&qcball::Dilatation) -> f64| measured.dilatations.iter().map(value).collect::<Vec<f64>>();
    let result = PyDict::new(py);
    result.set_item("points", positions(py, &units[0].give_back_points(domain.mesh().points())))?;
    result.set_item("cells", indices(py, &domain.mesh().tets().iter().flatten().map(|v| v.0).collect::<Vec<u32>>()))?;
    result.set_item("image", positions(py, &units[1].give_back_points(&outcome.positions)))?;
    result.set_item("K", floats(py, &column(|d| d.k())))?;
    result.set_item("K_inner", floats(py, &column(|d| d.inner)))?;
    result.set_item("K_outer", floats(py, &column(|d| d.outer)))?;
    result.set_item("trace", json(&outcome.trace)?)?;
    result.set_item("report", report.to_json())?;
    result.set_item("linear", corners.is_none())?;
    Ok(result)
}

/// A sweep: its folder and the rows of its index as JSON, and whether it came to its end.
#[pyfunction]
pub(super) fn sweep(
    py: Python<'_>,
    config: PathBuf,
    overrides: Vec<String>,
    out: Option<PathBuf>,
    workers: (Option<usize>, Option<usize>),
    observe: Option<Py<PyAny>>,
) -> PyResult<(PathBuf, String, bool)> {
    let sweep = Sweep::read(&config, &overrides).map_err(|error| value_error(with_help(&error)))?;
    let folder = SweepFolder::new(out.unwrap_or_else(|| PathBuf::from("results").join(&sweep.name)));
    folder.prepare().map_err(os_error)?;
    let (jobs, threads) = workers;
    let settings = SweepSettings { jobs, threads: threads.or(sweep.threads), cancel: Cancel::default() };
    let cases: Vec<&Case> = sweep.cases.iter().collect();
    let watch = Watch::new(py, &observe, &settings.cancel);
    let ran = waited(py, &settings.cancel, || {
        qcball::sweep::run(&cases, &folder, &settings, &experiment::run_or_leave, &|case, event| {
            if let Event::Ended(ended) = event {
                watch.call(|| (case.number, cases.len(), case.in_words(), how(ended)));
            }
        })
        .and_then(|()| write_index(&sweep, &folder))
    })?;
    watch.ended()?;
    ran.map_err(os_error)?;
    let index = std::fs::read_to_string(folder.path().join("index.jsonl"))?;
    Ok((folder.path().to_path_buf(), index, !settings.cancel.is_raised()))
}

fn how(ended: &Ended) -> String {
    match ended {
        Ended::Done(report) => format!("max K {:.4}", report.achieved.last.max_k),
        Ended::Cancelled => "interrupted".into(),
        Ended::Failed(message) => format!("failed: {message}"),
        Ended::Elsewhere => "another process has it".into(),
    }
}

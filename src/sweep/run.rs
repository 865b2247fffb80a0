//! Working through the cases of a sweep.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::Case;
use super::folder::{State, SweepFolder};
use super::memory::{MemoryGate, Refusal, estimate};
use crate::cancel::Cancel;
use crate::config::Plan;
use crate::experiment::{Finished, RunError};
use crate::mesh::io::WriteError;
use crate::optimize::{StopReason, TraceRow};
use crate::report::{Report, write_results};

/// How many cases run at a time, and what ends them.
#[derive(Clone, Debug)]
pub struct SweepSettings {
    /// Most cases at a time, at least 1; `None` for as many as the cores allow.
    pub jobs: Option<usize>,
    /// Number of threads of each case, at least 1; `None` shares the cores among the cases that run.
    pub threads: Option<usize>,
    /// Ends the running cases after their current iteration; no other is started.
    pub cancel: Cancel,
}

/// What makes a run of a plan: [`experiment::run`](crate::experiment::run), or [`run_or_leave`](crate::experiment::run_or_leave) where a signal
/// may cancel it.
pub type Compute<'a> = dyn Fn(&Plan, &mut (dyn FnMut(&TraceRow) + Send)) -> Result<Finished, RunError> + Sync + 'a;

/// What happens to a case.
#[derive(Debug)]
pub enum Event<'a> {
    /// It starts.
    Started,
    /// An iteration is over.
    Row(&'a TraceRow),
    /// It came to an end.
    Ended(&'a Ended),
}

/// How a case ended.
#[derive(Debug)]
pub enum Ended {
    /// Its results are in its folder.
    Done(Box<Report>),
    /// It was cancelled; its best iterate is in a folder that says so, and nothing if it had none.
    Cancelled,
    /// Why it failed; recorded in its folder.
    Failed(String),
    /// Another process has it.
    Elsewhere,
}

/// Runs the cases that are not done yet, several at a time; `observe` hears of each. A case that failed before is tried
/// again.
///
/// A case that fails or panics is recorded and does not stop the others. Which case is computed when, and on how many
/// threads, changes no result.
///
/// # Errors
/// A folder that cannot be written. No other case is started then; what was done before is kept.
pub fn run(
    cases: &[&Case],
    folder: &SweepFolder,
    settings: &SweepSettings,
    compute: &Compute<'_>,
    observe: &(dyn Fn(&Case, Event<'_>) + Sync),
) -> Result<(), WriteError> {
    let (done, waiting): (Vec<&Case>, Vec<&Case>) =
        cases.iter().copied().partition(|case| folder.state(&case.id) == State::Done);
    done.iter().for_each(|case| folder.clear_lock(&case.id));
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let jobs = settings.jobs.unwrap_or(cores / settings.threads.unwrap_or(1).min(cores)).clamp(1, waiting.len().max(1));
    let work = Work {
        folder,
        settings,
        compute,
        observe,
        cores,
        jobs,
        gate: MemoryGate::new(),
        unfinished: AtomicUsize::new(waiting.len()),
        fault: Mutex::new(None),
    };
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..jobs {
            scope.spawn(|| {
                while let Some(case) = waiting.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if !work.goes_on() {
                        break;
                    }
                    if let Err(error) = work.case(case) {
                        work.fault().get_or_insert(error);
                    }
                    work.unfinished.fetch_sub(1, Ordering::Relaxed);
                }
            });
        }
    });
    match work.fault().take() {
        None => Ok(()),
        Some(error) => Err(error),
    }
}

/// What the threads of a sweep share.
struct Work<'a> {
    folder: &'a SweepFolder,
    settings: &'a SweepSettings,
    compute: &'a Compute<'a>,
    observe: &'a (dyn Fn(&Case, Event<'_>) + Sync),
    cores: usize,
    jobs: usize,
    gate: MemoryGate,
    unfinished: AtomicUsize,
    /// The first folder that could not be written.
    fault: Mutex<Option<WriteError>>,
}

impl Work<'_> {
    fn fault(&self) -> std::sync::MutexGuard<'_, Option<WriteError>> {
        self.fault.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    fn goes_on(&self) -> bool {
        !self.settings.cancel.is_raised() && self.fault().is_none()
    }

    /// Takes a case, runs it and puts its folder in place.
    fn case(&self, case: &Case) -> Result<(), WriteError> {
        let ended = match self.folder.take(&case.id)? {
            None => Ended::Elsewhere,
            // Another process may have done it since this one looked.
            Some(_) if self.folder.state(&case.id) == State::Done => Ended::Elsewhere,
            Some(_taken) => match self.gate.enter(estimate(&case.plan), &self.settings.cancel) {
                Ok(_permit) => self.compute(case)?,
                Err(Refusal::Cancelled) => Ended::Cancelled,
                Err(Refusal::TooLarge { needed, available }) => {
                    let [needed, available] = [needed, available].map(|bytes| bytes as f64 / 1024f64.powi(3));
                    let message = format!(
                        "it would take about {needed:.1} GiB of memory, and {available:.1} GiB are available; ask for a \
                         coarser mesh"
                    );
                    self.folder.put_failed(&case.id, &message)?;
                    Ended::Failed(message)
                }
            },
        };
        (self.observe)(case, Event::Ended(&ended));
        Ok(())
    }

    fn compute(&self, case: &Case) -> Result<Ended, WriteError> {
        let mut plan = case.plan.clone();
        let running = self.jobs.min(self.unfinished.load(Ordering::Relaxed)).max(1);
        plan.threads = Some(self.settings.threads.unwrap_or(self.cores / running).max(1));
        plan.optimize.cancel = self.settings.cancel.clone();
        (self.observe)(case, Event::Started);
        let finished = catch_unwind(AssertUnwindSafe(|| {
            (self.compute)(&plan, &mut |row: &TraceRow| (self.observe)(case, Event::Row(row)))
        }));
        let failed = match finished {
            Ok(Ok(finished)) => return self.put(case, finished),
            Ok(Err(error)) => error.to_string(),
            Err(payload) => format!("the program panicked: {}; please report this as a bug", said(payload.as_ref())),
        };
        // The signal that cancels also ends a mesher's process: that is no fault of the case.
        if self.settings.cancel.is_raised() {
            return Ok(Ended::Cancelled);
        }
        self.folder.put_failed(&case.id, &failed)?;
        Ok(Ended::Failed(failed))
    }

    fn put(&self, case: &Case, finished: Finished) -> Result<Ended, WriteError> {
        let cancelled = finished.report.achieved.stop == StopReason::Cancelled;
        let state = if cancelled { State::Incomplete } else { State::Done };
        self.folder.put(&case.id, state, |part| write_results(part, &finished.report, &finished.record()))?;
        Ok(if cancelled { Ended::Cancelled } else { Ended::Done(Box::new(finished.report)) })
    }
}

/// The message of a panic.
fn said(payload: &(dyn Any + Send)) -> &str {
    let text = payload.downcast_ref::<&str>().copied();
    text.or_else(|| payload.downcast_ref::<String>().map(String::as_str)).unwrap_or("without a message")
}

//! Work that is left where it does not look up from what it does.

use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};

use super::{Event, Finished, RunError, Stage, run_and_tell};
use crate::cancel::Cancel;
use crate::config::Plan;
use crate::optimize::TraceRow;

/// How long work that has no map yet is waited for after it was cancelled.
const GRACE: Duration = Duration::from_secs(1);

/// How often is looked whether it was.
const POLL: Duration = Duration::from_millis(50);

/// What a run tells, to another thread.
enum Told {
    Stage(Stage),
    Row(TraceRow),
}

/// [`run`](super::run), but when it is cancelled before there is a map it ends within a second or so: not all that reads, meshes and maps to begin
/// with looks at the flag. It is done on a thread of its own, which is left to itself then and ends at its next look.
///
/// # Errors
/// As [`run`](super::run).
pub fn run_or_leave(plan: &Plan, observe: &mut (dyn FnMut(&TraceRow) + Send)) -> Result<Finished, RunError> {
    run_and_tell_or_leave(plan, &mut |event| {
        if let Event::Row(row) = event {
            observe(row);
        }
    })
}

/// [`run_and_tell`], left as [`run_or_leave`] is.
///
/// # Errors
/// As [`run`](super::run).
pub(crate) fn run_and_tell_or_leave(plan: &Plan, tell: &mut dyn FnMut(Event)) -> Result<Finished, RunError> {
    let owned = plan.clone();
    left_before_map(&plan.optimize.cancel, move |tell| run_and_tell(&owned, tell), tell)
}

/// Work that tells its stages and rows, in the same way.
///
/// # Errors
/// Those of the work; [`RunError::Interrupted`].
pub(crate) fn left_before_map<T: Send + 'static, E: From<RunError> + Send + 'static>(
    cancel: &Cancel,
    work: impl FnOnce(&mut (dyn FnMut(Event) + Send)) -> Result<T, E> + Send + 'static,
    tell: &mut dyn FnMut(Event),
) -> Result<T, E> {
    let (told, hear) = mpsc::channel();
    let (heard, go_on) = mpsc::channel();
    let work = move || {
        work(&mut move |event| {
            let told = match event {
                Event::Stage(stage) => told.send(Told::Stage(stage)),
                Event::Row(row) => told.send(Told::Row(row.clone())),
            };
            // As if it were told here; nobody is there any more if the work was left.
            if told.is_ok() {
                let _ = go_on.recv();
            }
        })
    };
    let failed = |error: std::io::Error| RunError::Threads { threads: 1, message: error.to_string() };
    let work = std::thread::Builder::new().spawn(work).map_err(failed)?;
    let (mut has_map, mut since) = (false, None::<Instant>);
    loop {
        match hear.recv_timeout(POLL) {
            Ok(Told::Stage(stage)) => {
                has_map |= stage == Stage::Optimizing;
                tell(Event::Stage(stage));
            }
            Ok(Told::Row(row)) => tell(Event::Row(&row)),
            Err(RecvTimeoutError::Disconnected) => {
                return work.join().unwrap_or_else(|payload| std::panic::resume_unwind(payload));
            }
            Err(RecvTimeoutError::Timeout) => {
                if !has_map && cancel.is_raised() && since.get_or_insert_with(Instant::now).elapsed() > GRACE {
                    return Err(RunError::Interrupted.into());
                }
                continue;
            }
        }
        // It may have ended by a panic meanwhile.
        let _ = heard.send(());
    }
}

//! Runs that are left where they do not look up from what they do.

use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};

use super::{Event, Finished, RunError, Stage, run_and_tell};
use crate::config::Plan;
use crate::optimize::TraceRow;

/// How long a run that has no map yet is waited for after it was cancelled.
pub(crate) const GRACE: Duration = Duration::from_secs(1);

/// How often is looked whether it was.
const POLL: Duration = Duration::from_millis(50);

/// What a run tells, to another thread.
enum Told {
    HasMap,
    Row(TraceRow),
}

/// [`run`](super::run), but when it is cancelled before there is a map it ends within a second or so: not all that reads, meshes and maps to begin
/// with looks at the flag. It is done on a thread of its own, which is left to itself then and ends at its next look.
///
/// # Errors
/// As [`run`](super::run).
pub fn run_or_leave(plan: &Plan, observe: &mut (dyn FnMut(&TraceRow) + Send)) -> Result<Finished, RunError> {
    let cancel = &plan.optimize.cancel;
    let (told, hear) = mpsc::channel();
    let (heard, go_on) = mpsc::channel();
    let plan = plan.clone();
    let work = move || {
        run_and_tell(&plan, &mut move |event| {
            let told = match event {
                Event::Stage(Stage::Optimizing) => told.send(Told::HasMap),
                Event::Stage(_) => return,
                Event::Row(row) => told.send(Told::Row(row.clone())),
            };
            // As if the observer were called here; nobody is there any more if the run was left.
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
            Ok(Told::HasMap) => has_map = true,
            Ok(Told::Row(row)) => observe(&row),
            Err(RecvTimeoutError::Disconnected) => {
                return work.join().unwrap_or_else(|payload| std::panic::resume_unwind(payload));
            }
            Err(RecvTimeoutError::Timeout) => {
                if !has_map && cancel.is_raised() && since.get_or_insert_with(Instant::now).elapsed() > GRACE {
                    return Err(RunError::Interrupted);
                }
                continue;
            }
        }
        // It may have ended by a panic meanwhile.
        let _ = heard.send(());
    }
}

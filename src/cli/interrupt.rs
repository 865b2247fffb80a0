//! Ctrl-C and the like: the best iterates are still written.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::Failure;
use super::output::{fault, show_error};
use crate::cancel::Cancel;
use crate::experiment::{GRACE, RunError};

/// Exit code of a program that a signal ended: 128 + SIGINT.
pub(super) const EXIT_CODE: u8 = 130;

/// A flag that the first SIGINT, SIGTERM or SIGHUP raises; the second ends the program at once.
pub(super) fn cancel_on_signal() -> Cancel {
    cancel_run_on_signal(&Arc::new(AtomicBool::new(true)))
}

/// The same for a run, which has nothing to write before there is a map: not all that reads, meshes and maps to begin with looks at the flag, and
/// where it has not ended by itself soon after the signal, the program does.
pub(super) fn cancel_run_on_signal(has_map: &Arc<AtomicBool>) -> Cancel {
    let cancel = Cancel::default();
    let (raised, has_map) = (cancel.clone(), Arc::clone(has_map));
    // Without a handler a signal ends the program as it always did.
    let _ = ctrlc::set_handler(move || {
        if raised.raise() {
            fault("interrupted a second time: ended at once, and what was not yet written is lost");
            std::process::exit(i32::from(EXIT_CODE));
        }
        if has_map.load(Ordering::Relaxed) {
            return;
        }
        std::thread::sleep(GRACE);
        if !has_map.load(Ordering::Relaxed) {
            show_error(&Failure::Run(RunError::Interrupted));
            std::process::exit(i32::from(EXIT_CODE));
        }
    });
    cancel
}

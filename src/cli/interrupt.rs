//! Ctrl-C and the like: the best iterates are still written.

use std::time::{Duration, Instant};

use super::output::fault;
use crate::cancel::Cancel;

/// Exit code of a program that a signal ended: 128 + SIGINT.
pub(super) const EXIT_CODE: u8 = 130;

/// Signals no later than this after the first one are the same: `timeout` sends it to the process and to its group.
const ONE_SIGNAL: Duration = Duration::from_millis(300);

/// A flag that the first SIGINT, SIGTERM or SIGHUP raises; the second ends the program at once.
pub(super) fn cancel_on_signal() -> Cancel {
    let cancel = Cancel::default();
    let raised = cancel.clone();
    let mut first = None;
    // Without a handler a signal ends the program as it always did.
    let _ = ctrlc::set_handler(move || {
        raised.raise();
        if first.get_or_insert_with(Instant::now).elapsed() > ONE_SIGNAL {
            fault("interrupted a second time: ended at once, and what was not yet written is lost");
            std::process::exit(i32::from(EXIT_CODE));
        }
    });
    cancel
}

//! Ctrl-C and the like: the best iterates are still written.

use super::output::fault;
use crate::cancel::Cancel;

/// Exit code of a program that a signal ended: 128 + SIGINT.
pub(super) const EXIT_CODE: u8 = 130;

/// A flag that the first SIGINT, SIGTERM or SIGHUP raises; the second ends the program at once.
pub(super) fn cancel_on_signal() -> Cancel {
    let cancel = Cancel::default();
    let raised = cancel.clone();
    // Without a handler a signal ends the program as it always did.
    let _ = ctrlc::set_handler(move || {
        if raised.raise() {
            fault("interrupted a second time: ended at once, and what was not yet written is lost");
            std::process::exit(i32::from(EXIT_CODE));
        }
    });
    cancel
}

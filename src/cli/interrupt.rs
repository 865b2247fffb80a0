//! Ctrl-C and the like: the best iterates are still written.

use std::sync::OnceLock;
use std::time::{Duration, Instant};

use super::output::fault;
use crate::cancel::Cancel;

/// Exit code of a program that a signal ended: 128 + SIGINT.
pub(super) const EXIT_CODE: u8 = 130;

/// Signals no later than this after the first one are the same: `timeout` sends it to the process and to its group.
const ONE_SIGNAL: Duration = Duration::from_millis(300);

/// What the first signal raises, from when on there is something to keep.
static RAISED: OnceLock<Cancel> = OnceLock::new();

/// The signals so far.
#[derive(Default)]
struct Signals {
    first: Option<Instant>,
}

impl Signals {
    /// Whether one that comes now is another than the first.
    fn is_second(&mut self, now: Instant) -> bool {
        now.saturating_duration_since(*self.first.get_or_insert(now)) > ONE_SIGNAL
    }
}

/// From now on a SIGINT, SIGTERM or SIGHUP ends the program with [`EXIT_CODE`]: at once, or, where [`cancel_on_signal`] was called, with the second.
pub(super) fn heed_signals() {
    let mut signals = Signals::default();
    // Without a handler a signal ends the program as it always did.
    let _ = ctrlc::set_handler(move || {
        let Some(cancel) = RAISED.get() else { std::process::exit(i32::from(EXIT_CODE)) };
        cancel.raise();
        if signals.is_second(Instant::now()) {
            fault("interrupted a second time: ended at once, and what was not yet written is lost");
            std::process::exit(i32::from(EXIT_CODE));
        }
    });
}

/// A flag that the first SIGINT, SIGTERM or SIGHUP raises from now on; the second ends the program at once.
pub(super) fn cancel_on_signal() -> Cancel {
    RAISED.get_or_init(Cancel::default).clone()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signal_that_is_sent_twice_is_one_and_the_next_is_the_second() {
        let mut signals = Signals::default();
        let first = Instant::now();
        let ends = [0, 1, 300, 301, 10_000].map(|after| signals.is_second(first + Duration::from_millis(after)));
        assert_eq!(ends, [false, false, false, true, true]);
    }
}

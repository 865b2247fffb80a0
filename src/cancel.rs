//! Ending work from outside: a flag that anybody may raise, and a deadline.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Ends work before it is done: long stages look at it every second or more often, and return the best they have.
///
/// Clones share the flag, so that another thread, or the handler of a signal, can raise it; each has its own deadline.
#[derive(Clone, Debug, Default)]
pub struct Cancel {
    raised: Arc<AtomicBool>,
    deadline: Option<Instant>,
}

impl Cancel {
    /// Raises the flag.
    pub fn raise(&self) {
        self.raised.store(true, Ordering::Relaxed);
    }

    /// Whether the flag is up.
    pub fn is_raised(&self) -> bool {
        self.raised.load(Ordering::Relaxed)
    }

    /// The same flag with a deadline that far from now, or with its own if that is earlier.
    pub fn within(&self, limit: Duration) -> Self {
        // A deadline beyond what a clock can hold is none.
        let deadline = Instant::now().checked_add(limit);
        Self { raised: self.raised.clone(), deadline: self.deadline.into_iter().chain(deadline).min() }
    }

    /// The time up to the deadline, 0 from there on; `None` without one.
    pub fn time_left(&self) -> Option<Duration> {
        self.deadline.map(|deadline| deadline.saturating_duration_since(Instant::now()))
    }

    /// The same, or where work is to end, what leaves a second to judge its results.
    pub fn or_a_second_more(&self) -> Self {
        if self.is_due() { Self::default().within(Duration::from_secs(1)) } else { self.clone() }
    }

    /// Whether work is to end: the flag is up or the deadline has passed.
    pub fn is_due(&self) -> bool {
        self.is_raised() || self.time_left().is_some_and(|left| left.is_zero())
    }
}

/// Settings are the same whoever may cancel them.
impl PartialEq for Cancel {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clones_share_the_flag_and_the_earlier_deadline_counts() {
        let cancel = Cancel::default();
        assert!(!cancel.is_due() && cancel.time_left().is_none());
        let far = cancel.within(Duration::from_secs(1000));
        let past = far.within(Duration::ZERO);
        assert!(!far.is_due() && past.is_due() && !past.is_raised());
        // Later deadlines do not give time back, and those past all clocks are none.
        assert!(past.within(Duration::from_secs(1000)).is_due());
        assert!(cancel.within(Duration::MAX).time_left().is_none_or(|left| left > Duration::from_secs(1_000_000_000)));
        past.raise();
        assert!(far.is_due() && cancel.is_raised());
        let more = far.or_a_second_more();
        assert!(!more.is_raised() && more.time_left().is_some_and(|left| left <= Duration::from_secs(1)));
    }
}

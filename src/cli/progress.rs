//! The progress of an optimization on standard error.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::optimize::TraceRow;

/// Ticks of the whole bar; the share that is done is an estimate anyway.
const TICKS: u64 = 1000;

/// A bar with phase, iteration, max K, mean K, step and time left; nothing where standard error is no terminal or `quiet`.
pub(super) struct Progress {
    bar: ProgressBar,
}

impl Progress {
    pub(super) fn new(quiet: bool) -> Self {
        let style = ProgressStyle::with_template("{bar:24} {percent:>3} %  {msg}  {eta} left")
            .expect("the template is well-formed");
        // indicatif draws nothing by itself where standard error is no terminal.
        let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        Self { bar: ProgressBar::with_draw_target(Some(TICKS), target).with_style(style) }
    }

    pub(super) fn show(&self, row: &TraceRow) {
        self.bar.set_message(format!(
            "{} #{}  max K {:.4}  mean {:.4}  step {:.2}",
            row.phase, row.iteration, row.max_k, row.mean_k, row.step
        ));
        self.bar.set_position((row.progress * TICKS as f64) as u64);
    }

    pub(super) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

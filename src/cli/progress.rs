//! The progress of a run or an optimization on standard error, and in a log.

use std::fs::File;
use std::io::{self, IsTerminal, Write};
use std::path::PathBuf;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::experiment::Stage;
use crate::mesh::io::WriteError;
use crate::optimize::TraceRow;

/// Ticks of the whole bar; the share that is done is an estimate anyway.
const TICKS: u64 = 1000;
/// Time between two lines where standard error is no terminal, and before the first.
const EVERY: Duration = Duration::from_secs(5);
/// Share done and seconds gone from which on a guess at the time left is worth something.
const TELLING: (f64, f64) = (0.05, 1.0);

/// How much is told of the work that goes on.
#[derive(Debug, Args)]
pub(super) struct ProgressArguments {
    /// No progress and no summary.
    #[arg(long)]
    pub quiet: bool,
    /// Tell every stage and every iteration, a line each.
    #[arg(long, short, conflicts_with = "quiet")]
    pub verbose: bool,
    /// Write every stage and every iteration to a file, a line each.
    #[arg(long, value_name = "FILE")]
    pub log: Option<PathBuf>,
}

/// A bar on a terminal, a line every few seconds elsewhere, all lines if that is asked for; and the log.
pub(super) struct Progress {
    bar: ProgressBar,
    lines: Mutex<Lines>,
}

struct Lines {
    start: Instant,
    /// When the first row of the present stage came.
    first_row: Option<Instant>,
    /// When a line was last shown.
    last: Instant,
    shown: Shown,
    log: Option<File>,
}

/// Which lines standard error gets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shown {
    None,
    Some,
    All,
}

impl Progress {
    /// # Errors
    /// A log that cannot be made.
    pub(super) fn new(arguments: &ProgressArguments) -> Result<Self, WriteError> {
        let log = arguments.log.as_ref().map(|path| File::create(path).map_err(|error| WriteError::new(path, error)));
        let is_terminal = io::stderr().is_terminal();
        let shown = match arguments {
            ProgressArguments { quiet: true, .. } => Shown::None,
            ProgressArguments { verbose: true, .. } => Shown::All,
            _ => {
                if is_terminal {
                    Shown::None
                } else {
                    Shown::Some
                }
            }
        };
        let style =
            ProgressStyle::with_template("{bar:24} {percent:>3} %  {msg}").expect("the template is well-formed");
        let with_bar = is_terminal && !arguments.quiet && !arguments.verbose;
        let target = if with_bar { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let now = Instant::now();
        Ok(Self {
            bar: ProgressBar::with_draw_target(Some(TICKS), target).with_style(style),
            lines: Mutex::new(Lines { start: now, first_row: None, last: now, shown, log: log.transpose()? }),
        })
    }

    /// A stage begins.
    pub(super) fn begin(&self, stage: Stage) {
        self.bar.set_message(stage.to_string());
        let mut lines = self.lines.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        lines.first_row = None;
        // After some seconds each stage is news: the next may be silent for long.
        let is_due = lines.start.elapsed() >= EVERY;
        lines.tell(is_due, &stage.to_string());
    }

    /// An iteration is done.
    pub(super) fn show(&self, row: &TraceRow) {
        let mut lines = self.lines.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let spent = lines.first_row.get_or_insert_with(Instant::now).elapsed().as_secs_f64();
        let left = if row.progress > TELLING.0 && spent > TELLING.1 {
            format!("  about {:.0} s left", spent * (1.0 - row.progress) / row.progress)
        } else {
            String::new()
        };
        let text = format!(
            "{} #{}  max K {:.4}  mean {:.4}  step {:.2}",
            row.phase, row.iteration, row.max_k, row.mean_k, row.step
        );
        self.bar.set_message(format!("{text}{left}"));
        self.bar.set_position((row.progress * TICKS as f64) as u64);
        let is_due = lines.last.elapsed() >= EVERY;
        lines.tell(is_due, &format!("{text}  {:.0} %{left}", 100.0 * row.progress));
    }

    pub(super) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Lines {
    /// A line for the log, and for standard error if all are shown, or some and one is due.
    fn tell(&mut self, is_due: bool, text: &str) {
        let line = format!("{:>7.1} s  {text}\n", self.start.elapsed().as_secs_f64());
        if self.shown == Shown::All || self.shown == Shown::Some && is_due {
            self.last = Instant::now();
            // Nothing is left to tell it to if standard error is closed.
            let _ = io::stderr().write_all(line.as_bytes());
        }
        if let Some(log) = &mut self.log {
            // A full disk is told by the results.
            let _ = log.write_all(line.as_bytes());
        }
    }
}

//! `qcball sweep CONFIG.toml`.

use std::collections::{BTreeSet, HashMap};
use std::io::{IsTerminal, stderr};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use clap::{Args, ValueEnum};
use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::output::{fault, note, print};
use super::{Ending, Failure, interrupt, pages_are_written, tell_of_program};
use crate::experiment;
use crate::mesh::io::{WriteError, shown_path};
use crate::report::{Report, write_sweep_pages};
use crate::sweep::{
    Case, Ended, Event, Shard, SlurmJob, State, Sweep, SweepFolder, SweepSettings, Tally, run, write_index, write_slurm,
};

/// SLURM takes arrays of at most this many tasks where nobody configured it otherwise.
const MOST_TASKS: usize = 1000;

/// The cases and how they are run.
#[derive(Debug, Args)]
pub(crate) struct SweepArguments {
    /// A config with a table [sweep]; `qcball schema` describes its keys.
    config: PathBuf,
    /// Override a key of the config for all cases, e.g. --set mesh.layers=4, or the values of one that is varied, e.g.
    /// `--set sweep.grid.mesh.layers=[2,4]`; may be given several times.
    #[arg(long = "set", value_name = "KEY.PATH=VALUE")]
    set: Vec<String>,
    /// The folder of the results instead of results/NAME.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Most cases at a time; by default as many as there are cores, or as the config's `threads` leave room for.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Number of threads of each case, instead of the config's; by default the cases share the cores.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Run only the I-th of N equal shares of the cases, and make no index.
    #[arg(long, value_name = "I/N")]
    shard: Option<Shard>,
    /// Print the cases with their ids and what is done of them, and do nothing.
    #[arg(long, conflicts_with_all = ["fresh", "index_only", "emit"])]
    dry_run: bool,
    /// First remove what was done of these cases before.
    #[arg(long, conflicts_with_all = ["index_only", "emit"])]
    fresh: bool,
    /// First remove what another revision of qcball did of these cases; its results are kept otherwise.
    #[arg(long, conflicts_with_all = ["dry_run", "fresh", "index_only", "emit"])]
    renew: bool,
    /// First remove the cases of this folder that are none of the config's any more; with --dry-run only name them.
    #[arg(long, conflicts_with_all = ["shard", "emit"])]
    prune: bool,
    /// Only make the index anew from the folders of the cases.
    #[arg(long, conflicts_with_all = ["shard", "emit"])]
    index_only: bool,
    /// Write the scripts that run the sweep on another system's queue, and run nothing.
    #[arg(long, value_name = "QUEUE", conflicts_with = "shard")]
    emit: Option<Queue>,
    /// Number of tasks that --emit shares the cases out to; by default one a case, at most 1000.
    #[arg(long, value_name = "N", requires = "emit", value_parser = clap::value_parser!(u16).range(1..))]
    tasks: Option<u16>,
    /// No progress and no summary.
    #[arg(long)]
    quiet: bool,
}

/// A queue of jobs on many machines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Queue {
    /// A job array, and a merge after it.
    Slurm,
}

/// `qcball sweep`.
pub(super) fn sweep(arguments: &SweepArguments, program: &Path) -> Result<Ending, Failure> {
    let sweep = Sweep::read(&arguments.config, &arguments.set)?;
    let root = arguments.out.clone().unwrap_or_else(|| PathBuf::from("results").join(&sweep.name));
    let folder = SweepFolder::new(root);
    let cases: Vec<&Case> =
        sweep.cases.iter().filter(|case| arguments.shard.is_none_or(|shard| shard.holds(case))).collect();
    if arguments.dry_run {
        let others = if arguments.prune { folder.others(&sweep.cases)? } else { Vec::new() };
        let others: String =
            others.iter().map(|id| format!("{id} would be removed: no case of the config\n")).collect();
        return print(&(list(&sweep, &cases, &folder) + &others));
    }
    folder.prepare()?;
    if arguments.prune {
        let removed = folder.prune(&sweep.cases)?.len();
        note(&format!("{removed} cases that the config does not have were removed"));
    }
    if let Some(Queue::Slurm) = arguments.emit {
        return emit(arguments, program, &sweep, &folder);
    }
    if arguments.index_only {
        let tally = write_index(&sweep, &folder)?;
        return end(arguments, tally, &folder, Some("index.csv"));
    }
    cases.iter().filter_map(|case| case.plan.program()).collect::<BTreeSet<_>>().into_iter().for_each(tell_of_program);
    if arguments.fresh {
        cases.iter().try_for_each(|case| folder.forget(&case.id))?;
    }
    if arguments.renew {
        let others = cases.iter().filter(|case| case.other_revision(&folder).is_some());
        others.into_iter().try_for_each(|case| folder.forget(&case.id))?;
    }
    let settings = SweepSettings {
        jobs: arguments.jobs.map(usize::from),
        threads: arguments.threads.map(usize::from).or(sweep.threads),
        cancel: interrupt::cancel_on_signal(),
    };
    let progress = SweepProgress::new(arguments.quiet, &sweep, &cases, &folder);
    let ran = run(&cases, &folder, &settings, &experiment::run_or_leave, &|case, event| progress.show(case, event));
    progress.finish();
    let indexed = || match arguments.shard {
        None => write_index(&sweep, &folder),
        Some(_) => Ok(Tally::of(cases.iter().copied(), &folder)),
    };
    let tally = match ran.and_then(|()| indexed()) {
        Ok(tally) => tally,
        Err(error) => return Ok(stopped(&error)),
    };
    if settings.cancel.is_raised() {
        note(&format!("interrupted: {} of {} cases are done; the same command goes on", tally.done, tally.cases));
        return Ok(Ending::Interrupted);
    }
    end(arguments, tally, &folder, arguments.shard.is_none().then_some("index.csv"))
}

/// A fault of the folder in the middle of the work: cases were written before it, so the input was not refused.
fn stopped(error: &WriteError) -> Ending {
    fault(&format!("{error}; what was done before is kept, and the same command goes on from there"));
    Ending::Unfulfilled
}

fn end(arguments: &SweepArguments, tally: Tally, folder: &SweepFolder, index: Option<&str>) -> Result<Ending, Failure> {
    let unfulfilled = [
        (tally.failed, "failed"),
        (tally.not_bijective, "not known to be bijective"),
        (tally.cases - tally.done - tally.failed, "not done"),
    ];
    // Without an index there is nothing to show yet.
    let page = index.is_none() || pages_are_written(folder.path(), &write_sweep_pages(folder.path()));
    let all = unfulfilled.iter().all(|&(count, _)| count == 0) && page;
    if !arguments.quiet {
        let mut words = format!("{} of {} cases done", tally.done, tally.cases);
        for (count, what) in unfulfilled.into_iter().filter(|&(count, _)| count > 0) {
            words += &format!(", {count} {what}");
        }
        let path = index.map_or(folder.path().to_path_buf(), |name| folder.path().join(name));
        if tally.other_revision > 0 {
            let count = tally.other_revision;
            words += &format!(", {count} of them by another revision of qcball (--renew computes those anew)");
        }
        words += &format!("\nresults     {}\n", shown_path(&path));
        if index.is_some() && page {
            words += &format!("page        {}\n", shown_path(&folder.path().join("report.html")));
        }
        print(&words)?;
    }
    Ok(if all { Ending::Done } else { Ending::Unfulfilled })
}

/// One line a case.
fn list(sweep: &Sweep, cases: &[&Case], folder: &SweepFolder) -> String {
    let mut text = String::new();
    for case in cases {
        let state = folder.state(&case.id).name();
        let by = case.other_revision(folder).map(|revision| format!("  by revision {revision}")).unwrap_or_default();
        text += &format!("{:>5}  {}  {state:<10}  {}{by}\n", case.number, case.id, case.in_words());
    }
    let done = cases.iter().filter(|case| folder.state(&case.id) == State::Done).count();
    text + &format!("{} of {} cases, {done} done, in {}\n", cases.len(), sweep.cases.len(), shown_path(folder.path()))
}

fn emit(arguments: &SweepArguments, program: &Path, sweep: &Sweep, folder: &SweepFolder) -> Result<Ending, Failure> {
    let tasks = arguments.tasks.map_or(sweep.cases.len().min(MOST_TASKS), usize::from);
    let job = SlurmJob {
        name: sweep.name.clone(),
        program: program.into(),
        config: arguments.config.clone(),
        overrides: arguments.set.clone(),
        tasks: tasks.min(sweep.cases.len()),
    };
    let submit = write_slurm(&job, folder)?;
    print(&format!(
        "{} cases in {} tasks; submit them with\nsh {}\n",
        sweep.cases.len(),
        job.tasks,
        shown_path(&submit)
    ))
}

/// Bars on a terminal, a line for each case that ends elsewhere.
struct SweepProgress {
    /// `None` where there is no terminal.
    bars: Option<Bars>,
    quiet: bool,
    cases: usize,
}

struct Bars {
    all: MultiProgress,
    overall: ProgressBar,
    running: Mutex<HashMap<usize, ProgressBar>>,
}

impl SweepProgress {
    fn new(quiet: bool, sweep: &Sweep, cases: &[&Case], folder: &SweepFolder) -> Self {
        let done = cases.iter().filter(|case| folder.state(&case.id) == State::Done).count();
        let left = cases.len() - done;
        if done > 0 && !quiet {
            note(&format!("{done} of {} cases were done before", cases.len()));
        }
        let bars = (!quiet && stderr().is_terminal()).then(|| {
            let all = MultiProgress::with_draw_target(ProgressDrawTarget::stderr());
            let style = ProgressStyle::with_template("{bar:24} {pos}/{len} cases  {elapsed}, {eta} left");
            // Only what is computed now tells how long the rest takes.
            let overall =
                all.add(ProgressBar::new(left as u64).with_style(style.expect("the template is well-formed")));
            overall.enable_steady_tick(std::time::Duration::from_secs(1));
            Bars { all, overall, running: Mutex::default() }
        });
        Self { bars, quiet, cases: sweep.cases.len() }
    }

    fn show(&self, case: &Case, event: Event<'_>) {
        if self.quiet {
            return;
        }
        let ended = match event {
            Event::Ended(ended) => Some(format!(
                "{:>width$}/{} {} {}: {}",
                case.number,
                self.cases,
                case.id,
                case.in_words(),
                how(ended),
                width = self.cases.to_string().len()
            )),
            _ => None,
        };
        match (&self.bars, event, ended) {
            (Some(bars), event, ended) => bars.show(case, &event, ended),
            // Nothing is left to tell it to if standard error is closed.
            (None, _, Some(line)) => drop(std::io::Write::write_all(&mut stderr(), (line + "\n").as_bytes())),
            (None, ..) => {}
        }
    }

    fn finish(&self) {
        if let Some(bars) = &self.bars {
            bars.overall.finish_and_clear();
        }
    }
}

impl Bars {
    fn show(&self, case: &Case, event: &Event<'_>, ended: Option<String>) {
        let mut running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        match event {
            Event::Started => {
                let style = ProgressStyle::with_template("  {wide_msg}").expect("the template is well-formed");
                let bar = self.all.add(ProgressBar::new_spinner().with_style(style));
                bar.set_message(format!("{:>5}  meshing  {}", case.number, case.in_words()));
                running.insert(case.number, bar);
            }
            Event::Row(row) => {
                if let Some(bar) = running.get(&case.number) {
                    // The settings come last, since they may be too long for the line.
                    let at = format!("{} #{}  max K {:.4}", row.phase, row.iteration, row.max_k);
                    bar.set_message(format!("{:>5}  {at}  {}", case.number, case.in_words()));
                }
            }
            Event::Ended(_) => {
                if let Some(bar) = running.remove(&case.number) {
                    bar.finish_and_clear();
                    self.all.remove(&bar);
                }
                // A line above the bars; the terminal is gone if it cannot be written.
                let _ = self.all.println(ended.unwrap_or_default());
                self.overall.inc(1);
            }
        }
    }
}

/// How a case ended, in a few words.
fn how(ended: &Ended) -> String {
    match ended {
        Ended::Done(report) => in_short(report),
        Ended::Cancelled => "interrupted".into(),
        Ended::Failed(message) => format!("failed: {message}"),
        Ended::Elsewhere => "another process has it".into(),
    }
}

fn in_short(report: &Report) -> String {
    let (max_k, mean_k, seconds) =
        (report.achieved.last.max_k, report.achieved.last.mean_k, report.achieved.times.seconds);
    let stop = serde_json::json!(report.achieved.stop);
    format!("max K {max_k:.4}, mean {mean_k:.4}, {}, {seconds:.1} s", stop.as_str().unwrap_or_default())
}

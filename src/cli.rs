//! The command line: arguments in, exit code out. Numbers go to standard output, everything else to standard error.

mod bench;
mod compare;
mod evaluate;
mod inputs;
mod interrupt;
mod map;
mod measure;
mod optimize;
mod output;
mod picture;
mod preview;
mod progress;
mod sphere;
mod sweep;
mod verify;

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, CommandFactory, Parser, Subcommand};
use clap_complete::Shell;

use crate::bench::BenchError;
use crate::comparison::{self, ComparisonError};
use crate::config::{AnalyticPlan, ConfigError, Task, schema};
use crate::experiment::{self, Event, RunError, Stage};
use crate::mesh::io::{ReadError, WriteError, check_file_can_be_put, check_folder_is_writable, shown_path};
use crate::optimize::StopReason;
use crate::report::{
    FILES, INCOMPLETE, PageError, summary_within, time_line, write_case_pages, write_pages, write_pages_of, write_pair,
    write_results,
};
use crate::sweep::TableError;
use crate::verify::VerifyError;
use inputs::refuse_to_write_over;
use output::{columns, fault, note, print, show_error};
use progress::{Progress, ProgressArguments};

#[cfg(feature = "nlopt")]
macro_rules! nlopt {
    () => {
        ", nlopt"
    };
}
#[cfg(not(feature = "nlopt"))]
macro_rules! nlopt {
    () => {
        ""
    };
}

/// What `--version` tells and `-V` leaves out: which program this is, for who finds that it differs from another.
const LONG_VERSION: &str =
    concat!(env!("CARGO_PKG_VERSION"), "\nrevision ", env!("QCBALL_REVISION"), "\nfeatures cli", nlopt!());

/// Ball parameterizations of solids with low quasi-conformal dilatation.
#[derive(Debug, Parser)]
#[command(name = "qcball", version, long_version = LONG_VERSION, propagate_version = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Map a solid onto the unit ball as a config file says; results go to results/NAME.
    Run(RunArguments),
    /// Measure the exact dilatations of the map between two meshes with the same connectivity.
    Measure(measure::MeasureArguments),
    /// Print proved lower bounds for the dilatation of the map between two meshes with the same connectivity.
    Bounds(measure::BoundArguments),
    /// Lower the dilatation of a map given by two meshes: any start, any fixed vertices, any target.
    Optimize(optimize::OptimizeArguments),
    /// Run every case of a config's table [sweep], several at a time; go on where an earlier call was stopped.
    Sweep(sweep::SweepArguments),
    /// Set two sweeps or runs side by side, case by case: what changed in K, in time, and in how they stopped.
    Compare(compare::CompareArguments),
    /// Print chosen columns of a sweep or run as a table: text, CSV, Markdown or LaTeX.
    Table(compare::TableArguments),
    /// Check a results folder from its files alone: connectivity, orientation, dilatations, bounds, gap.
    Verify(verify::VerifyArguments),
    /// Apply a map with a formula (affine, folding, cone, power, zorich, caraman ...) to the vertices of a mesh.
    Map(map::MapArguments),
    /// Give the images of points under the map of a results folder, or the points that go to given ones.
    Evaluate(evaluate::EvaluateArguments),
    /// Map a closed surface without handles onto the unit sphere, one-to-one, with little distortion.
    Sphere(sphere::SphereArguments),
    /// Draw a mesh, or a map beside its domain, cut open and coloured: a PNG without a display.
    Picture(picture::PictureArguments),
    /// Optimize every mesh of a folder and write a table of the results, beside those of other programs.
    Bench(bench::BenchArguments),
    /// Make report.html and the pictures of a results folder anew from its other files, or a page with two runs side by side.
    Report {
        /// The folder of a run or of a sweep.
        folder: PathBuf,
        /// The folder of another run, to be set beside the first.
        beside: Option<PathBuf>,
        /// Where the page of two runs goes.
        #[arg(long, value_name = "FILE", default_value = "compare.html", requires = "beside")]
        out: PathBuf,
        /// Of a sweep, first make the pages of all cases that are done.
        #[arg(long, conflicts_with = "beside")]
        cases: bool,
    },
    /// Print the JSON schema of config files, which describes every key.
    Schema,
    /// Print a completion script for a shell.
    Completions {
        /// The shell.
        shell: Shell,
    },
}

#[derive(Debug, Args)]
struct RunArguments {
    /// A surface or mesh file to be mapped as it is best left to the program, a config file (`qcball schema` describes its keys),
    /// or - for a config on standard input.
    #[arg(value_name = "SOLID|CONFIG")]
    config: PathBuf,
    /// Override a key of the config, e.g. --set mesh.layers=4; may be given several times.
    #[arg(long = "set", value_name = "KEY.PATH=VALUE")]
    set: Vec<String>,
    /// The folder of the results instead of results/NAME.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Number of threads, instead of the config's; 0 for all cores.
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u16).range(0..=1024))]
    threads: Option<u16>,
    /// Keep a given mesh as it is, locked tets included; the same as --set domain.keep_mesh=true.
    #[arg(long)]
    keep_mesh: bool,
    /// Mesh the solid, print what would be solved and how much memory that takes, and write nothing.
    #[arg(long, conflicts_with_all = ["json", "quiet"])]
    dry_run: bool,
    #[command(flatten)]
    told: ProgressArguments,
    /// Print the report as JSON instead of the summary.
    #[arg(long)]
    json: bool,
}

/// How a command that was understood ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ending {
    /// Done.
    Done,
    /// Ended without what was asked for; what there is was written.
    Unfulfilled,
    /// Ended by a signal; what there is was written.
    Interrupted,
}

/// Why a command did nothing.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    #[error(transparent)]
    Config(#[from] ConfigError),
    #[error(transparent)]
    Bench(#[from] BenchError),
    #[error(transparent)]
    Verify(#[from] VerifyError),
    #[error(transparent)]
    Run(#[from] RunError),
    #[error(transparent)]
    Read(#[from] ReadError),
    #[error(transparent)]
    Write(#[from] WriteError),
    #[error(transparent)]
    Comparison(#[from] ComparisonError),
    #[error(
        "{} compares maps of known dilatation; of the options only --out, --threads and --quiet go with it",
        shown_path(path)
    )]
    NoSuchOption { path: PathBuf },
    #[error(transparent)]
    Map(#[from] map::MapFailure),
    #[error(transparent)]
    Evaluate(#[from] evaluate::EvaluateFailure),
    #[error(transparent)]
    Table(#[from] TableError),
    #[error(transparent)]
    Sphere(#[from] sphere::SphereFailure),
    #[error(transparent)]
    Page(#[from] PageError),
    #[error(transparent)]
    Picture(#[from] picture::PictureFailure),
    #[error("{} is read and would be written over; name another file for the result", shown_path(path))]
    OverInput { path: PathBuf },
    /// Standard output is closed or full; the reader of a closed pipe wants no more.
    #[error("cannot write to standard output: {0}")]
    Output(#[source] std::io::Error),
}

/// Runs the command line of this process, whose exit code is that of [`call`].
pub fn main() -> ExitCode {
    let program = std::env::current_exe().unwrap_or_else(|_| "qcball".into());
    let arguments: Vec<OsString> = std::env::args_os().skip(1).collect();
    ExitCode::from(call(&program, &arguments))
}

/// Runs a command line in this process, once; `program` is what has to be run for the same with other arguments.
///
/// The result is the exit code: 0 done; 1 ended without what was asked for, report written; 2 bad input or usage, nothing written;
/// 130 ended by a signal, the best so far written if there was a map.
pub fn call(program: &Path, arguments: &[OsString]) -> u8 {
    experiment::heed_environment();
    let words = std::iter::once(OsString::from("qcball")).chain(arguments.iter().cloned());
    let cli = match Cli::try_parse_from(words) {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version are among these; nothing is left to tell them to if standard output is closed.
            let _ = error.print();
            return u8::try_from(error.exit_code()).unwrap_or(2);
        }
    };
    interrupt::heed_signals();
    let ending = match cli.command {
        Command::Run(arguments) => run(&arguments),
        Command::Measure(arguments) => measure::measure_map(&arguments),
        Command::Bounds(arguments) => measure::bound_map(&arguments),
        Command::Optimize(arguments) => optimize::optimize(&arguments),
        Command::Sweep(arguments) => sweep::sweep(&arguments, program),
        Command::Compare(arguments) => compare::compare_folders(&arguments),
        Command::Table(arguments) => compare::table(&arguments),
        Command::Verify(arguments) => verify::verify_folder(&arguments),
        Command::Map(arguments) => map::map(&arguments),
        Command::Evaluate(arguments) => evaluate::evaluate(&arguments),
        Command::Sphere(arguments) => sphere::sphere(&arguments),
        Command::Picture(arguments) => picture::picture(&arguments),
        Command::Bench(words) => bench::bench(&words, program, arguments),
        Command::Report { folder, beside: Some(other), out, .. } => report_pair(&folder, &other, &out),
        Command::Report { folder, cases, .. } => report(&folder, cases),
        Command::Schema => print(&(schema() + "\n")),
        Command::Completions { shell } => completions(shell),
    };
    match ending {
        Ok(Ending::Done) => 0,
        Ok(Ending::Unfulfilled) => 1,
        Ok(Ending::Interrupted) => interrupt::EXIT_CODE,
        // `qcball schema | head` ends here: no news, and no failure.
        Err(Failure::Output(error)) if error.kind() == std::io::ErrorKind::BrokenPipe => 0,
        Err(failure) => {
            show_error(&failure);
            match failure {
                Failure::Output(_) => 1,
                Failure::Run(RunError::Interrupted) => interrupt::EXIT_CODE,
                _ => 2,
            }
        }
    }
}

fn completions(shell: Shell) -> Result<Ending, Failure> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "qcball", &mut script);
    print(&String::from_utf8_lossy(&script))
}

/// `qcball run` of a config with the table `[analytic]`.
fn run_comparison(arguments: &RunArguments, plan: &AnalyticPlan) -> Result<Ending, Failure> {
    if !arguments.set.is_empty() || arguments.keep_mesh || arguments.json || arguments.dry_run {
        return Err(Failure::NoSuchOption { path: arguments.config.clone() });
    }
    let folder = arguments.out.clone().unwrap_or_else(|| PathBuf::from("results").join(&plan.name));
    check_folder_is_writable(&folder)?;
    let compared = experiment::on_threads(usize::from(arguments.threads.unwrap_or(0)), || comparison::compare(plan))??;
    comparison::write_results(&folder, plan, &compared)?;
    if arguments.told.quiet { Ok(Ending::Done) } else { print(&comparison::table(plan, &compared)) }
}

/// `qcball report`.
fn report(folder: &Path, cases: bool) -> Result<Ending, Failure> {
    if cases {
        let made = write_case_pages(folder)?;
        note(&format!("the pages of {made} cases are made"));
    }
    print(&format!("{}\n", shown_path(&write_pages(folder)?)))
}

/// `qcball report A B`.
fn report_pair(folder: &Path, other: &Path, page: &Path) -> Result<Ending, Failure> {
    write_pair([folder, other], page)?;
    print(&format!("{}\n", shown_path(page)))
}

/// Whether the page of results that are written was made; if not, says so.
fn pages_are_written(folder: &Path, written: &Result<PathBuf, PageError>) -> bool {
    if let Err(error) = written {
        fault(&format!("{error}; the results are whole, and `qcball report {}` makes the page", shown_path(folder)));
    }
    written.is_ok()
}

/// A config from elsewhere may name any program.
fn tell_of_program(program: &Path) {
    note(&format!("the config has {} run as its mesher", shown_path(program)));
}

fn run(arguments: &RunArguments) -> Result<Ending, Failure> {
    let mut overrides = arguments.set.clone();
    if arguments.keep_mesh {
        overrides.push("domain.keep_mesh=true".into());
    }
    let mut plan = match Task::read(&arguments.config, &overrides)? {
        Task::Map(plan) => *plan,
        Task::Compare(plan) => return run_comparison(arguments, &plan),
    };
    if plan.source.text().parse::<toml::Table>().is_ok_and(|table| table.contains_key("sweep")) {
        let config = shown_path(&arguments.config);
        note(&format!("this is one run, without the table [sweep]; `qcball sweep {config}` runs its cases"));
    }
    if let Some(threads) = arguments.threads {
        plan.threads = Some(usize::from(threads)).filter(|&threads| threads > 0);
    }
    let folder = arguments.out.clone().unwrap_or_else(|| PathBuf::from("results").join(&plan.name));
    plan.program().into_iter().for_each(tell_of_program);
    if arguments.dry_run {
        let cancel = interrupt::cancel_on_signal();
        plan.optimize.cancel = cancel.clone();
        let text = experiment::left_before_map(&cancel, move |_| preview::preview(&plan, &folder), &mut |_| {})?;
        return print(&text);
    }
    refuse_to_write_over([&arguments.config], &arguments.told.log)?;
    // Before hours of work, not after.
    check_folder_is_writable(&folder)?;
    FILES.iter().try_for_each(|name| check_file_can_be_put(&folder.join(name)))?;
    plan.optimize.cancel = interrupt::cancel_on_signal();
    let progress = Progress::new(&arguments.told)?;
    let finished = experiment::run_and_tell_or_leave(&plan, &mut |event| match event {
        Event::Stage(stage) => progress.begin(stage),
        Event::Row(row) => progress.show(row),
    });
    progress.begin(Stage::Writing);
    let finished = finished.inspect_err(|_| progress.finish())?;
    let threads = plan.threads.unwrap_or(0);
    let written = experiment::on_threads(threads, || write_results(&folder, &finished.report, &finished.record()))?;
    let mut page = None;
    let whole = match written {
        Ok(()) if plan.optimize.cancel.is_raised() => {
            note(&format!("interrupted: the page was left out; `qcball report {}` makes it", shown_path(&folder)));
            true
        }
        Ok(()) => {
            progress.begin(Stage::Page);
            let made =
                experiment::on_threads(threads, || write_pages_of(&folder, &finished.report, &finished.record()))?;
            let whole = pages_are_written(&folder, &made);
            page = made.ok();
            whole
        }
        Err(error) => {
            let folder = shown_path(&folder);
            fault(&format!(
                "{error}; as many of the results as could be written are in {folder}, and its {INCOMPLETE} says which are missing"
            ));
            false
        }
    };
    progress.finish();
    if arguments.json {
        print(&finished.report.to_json())?;
    } else if !arguments.told.quiet {
        let (summary, time) = (summary_within(&finished.report, columns()), time_line(finished.report.achieved.times));
        let page = page.map(|page| format!("page        {}\n", shown_path(&page))).unwrap_or_default();
        print(&format!("{summary}{time}results     {}\n{page}", shown_path(&folder)))?;
    }
    Ok(match &finished.report {
        report if report.achieved.stop == StopReason::Cancelled => Ending::Interrupted,
        report if report.bijective && whole => Ending::Done,
        _ => Ending::Unfulfilled,
    })
}

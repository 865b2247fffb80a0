//! `qcball optimize REST INIT OUT`: any start, any fixed vertices, any target.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;

use super::inputs::{positive, read_map, refuse_to_write_over, tell_of_mirror};
use super::interrupt::cancel_on_signal;
use super::output::{columns, fault, note, print};
use super::progress::{Progress, ProgressArguments};
use super::{Ending, Failure};
use crate::cancel::Cancel;
use crate::config::{GivenMapSettings, optimize_settings};
use crate::experiment::{RunError, Stage, on_threads, optimize_map, read_locks};
use crate::mesh::io::{CellData, WriteError, check_file_can_be_put, check_tets_can_be_written, shown_path, write_tets};
use crate::optimize::{BoundaryValues, Effort, Engine, Objective, OptimizeSettings, Polish, StopReason};
use crate::refine::{Budget, RefineSettings};
use crate::report::{map_summary, to_json, write_trace};

/// The map and how it is improved.
#[derive(Debug, Args)]
pub(crate) struct OptimizeArguments {
    /// The mesh of the domain.
    rest: PathBuf,
    /// The start: the same tets in the same order, other positions; flipped tets are untangled first.
    init: PathBuf,
    /// Where the optimized image goes; its format follows the ending.
    out: PathBuf,
    /// A file of the fixed vertices, counted from 0; by default those of the boundary.
    #[arg(long, value_name = "FILE")]
    lock: Option<PathBuf>,
    /// Take the settings from the tables `optimize`, `boundary` and `refine` of a config instead of the options below.
    #[arg(
        long,
        value_name = "CONFIG.toml",
        conflicts_with_all = ["sliding", "soft_max", "engine", "no_polish", "effort", "tolerance", "max_iterations", "time_limit"],
    )]
    config: Option<PathBuf>,
    /// Let the vertices of the boundary move on the sphere about the origin on which INIT must have them.
    #[arg(long, conflicts_with = "lock")]
    sliding: bool,
    /// Split no tet, even if all its vertices are fixed.
    #[arg(long)]
    keep_mesh: bool,
    /// Refine the mesh inside where the largest K sits: flip tets and halve edges there, in so many rounds at most; with 0, not at all.
    #[arg(long, value_name = "ROUNDS", conflicts_with_all = ["lock", "keep_mesh", "soft_max", "sliding", "config"])]
    refine: Option<usize>,
    /// Add at most so many tets by that, or "5 %" of those there are.
    #[arg(long, value_name = "TETS", default_value = "10 %", requires = "refine")]
    refine_tets: Budget,
    /// Minimize the soft maximum with this exponent instead of the largest K.
    #[arg(long, value_name = "P", allow_negative_numbers = true, value_parser = positive)]
    soft_max: Option<f64>,
    /// The method that moves the vertices.
    #[arg(long, value_name = "NAME", value_enum, default_value_t)]
    engine: Engine,
    /// Do not lower the mean under a cap after the largest K is settled.
    #[arg(long)]
    no_polish: bool,
    /// How much work the largest K is worth.
    #[arg(long, value_name = "NAME", default_value = "normal")]
    effort: Effort,
    /// Accuracy in ln K at which the last phase ends.
    #[arg(long, default_value_t = OptimizeSettings::default().tolerance, allow_negative_numbers = true, value_parser = positive)]
    tolerance: f64,
    /// Most iterations over all phases, untangling not counted.
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = OptimizeSettings::default().max_iterations)]
    max_iterations: usize,
    /// Most seconds of untangling and optimizing.
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = positive)]
    time_limit: Option<f64>,
    /// Number of threads; 0 for all cores.
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 0, value_parser = clap::value_parser!(u16).range(0..=1024))]
    threads: u16,
    /// Write the trace as CSV, a row an iteration.
    #[arg(long, value_name = "FILE")]
    trace: Option<PathBuf>,
    #[command(flatten)]
    told: ProgressArguments,
    /// Print the figures as JSON instead of the summary.
    #[arg(long)]
    json: bool,
}

/// `qcball optimize`.
pub(super) fn optimize(arguments: &OptimizeArguments) -> Result<Ending, Failure> {
    check_tets_can_be_written(&arguments.out)?;
    check_inputs_are_kept(arguments)?;
    for file in [Some(&arguments.out), arguments.trace.as_ref()].into_iter().flatten() {
        check_file_can_be_put(file)?;
    }
    let kept_by = [(arguments.lock.is_some(), "--lock"), (arguments.keep_mesh, "--keep-mesh")];
    let kept_by = kept_by.into_iter().find_map(|(is_given, option)| is_given.then_some(option));
    let of_config = |path| optimize_settings(path, kept_by);
    let from_config = arguments.config.as_deref().map(of_config).transpose()?;
    if let Some(GivenMapSettings { idle, .. }) = from_config.as_ref().filter(|settings| !settings.idle.is_empty()) {
        note(&format!(
            "of the config only the tables [optimize], [boundary] and [refine] apply to a map that is given, and {} to `qcball run`",
            idle.join(", ")
        ));
    }
    let (from_config, refined_by_config) = from_config.map(|settings| (settings.optimize, settings.refine)).unzip();
    let progress = Progress::new(&arguments.told)?;
    progress.begin(Stage::Reading);
    let map = read_map(&arguments.rest, &arguments.init)?;
    tell_of_mirror(&map, &arguments.init);
    let fixed = match &arguments.lock {
        Some(path) => {
            let locked = read_locks(path, map.kept.len())?;
            Some(locked.into_iter().zip(&map.kept).filter(|(_, kept)| **kept).map(|(locked, _)| locked).collect())
        }
        None => None,
    };
    let settings = OptimizeSettings {
        objective: arguments.soft_max.map_or(Objective::Max, Objective::SoftMax),
        engine: arguments.engine,
        polish: if arguments.no_polish { Polish::None } else { Polish::Mean },
        rise: OptimizeSettings::default().rise,
        boundary_values: if arguments.sliding { BoundaryValues::Sliding } else { BoundaryValues::Fixed },
        effort: arguments.effort,
        tolerance: arguments.tolerance,
        max_iterations: arguments.max_iterations,
        time_limit: arguments.time_limit.map(Duration::from_secs_f64),
        cancel: Cancel::default(),
    };
    let settings = OptimizeSettings { cancel: cancel_on_signal(), ..from_config.unwrap_or(settings) };
    let refinement = arguments.refine.filter(|rounds| *rounds > 0).map(|rounds| RefineSettings {
        rounds,
        tets: arguments.refine_tets,
        ..RefineSettings::default()
    });
    let refinement = refinement.or(refined_by_config.flatten());
    let vertices = map.domain.mesh().points().len();
    progress.begin(Stage::Optimizing);
    let optimized = on_threads(usize::from(arguments.threads), || {
        optimize_map(map, fixed, arguments.keep_mesh, &settings, refinement.as_ref(), &mut |row| progress.show(row))
    })?;
    progress.begin(Stage::Writing);
    let origin = shown_path(&arguments.rest);
    let optimized = optimized.map_err(RunError::at(&origin))?;
    let tets = optimized.domain.mesh().tets();
    let mut files = shown_path(&arguments.out);
    // What one file lacks the room for another may still have; the image is what cannot be had again without the computation.
    let mut written = vec![write_tets(&arguments.out, &optimized.positions, tets, &CellData::new())];
    if optimized.domain.mesh().points().len() != vertices {
        // The image has vertices that REST lacks: the domain it belongs to goes beside it.
        let domain = beside(&arguments.out);
        let points = optimized.unit.give_back_points(optimized.domain.mesh().points());
        written.push(write_tets(&domain, &points, tets, &CellData::new()));
        files = format!("{files}, the split domain in {}", shown_path(&domain));
    }
    written.extend(arguments.trace.as_ref().map(|path| write_trace(path, &optimized.trace)));
    progress.finish();
    let faults: Vec<WriteError> = written.into_iter().filter_map(Result::err).collect();
    faults.iter().for_each(|error| fault(&format!("{error}; the optimization itself came to its end")));
    if arguments.json {
        print(&to_json(&optimized.report))?;
    } else if !arguments.told.quiet {
        print(&format!("{}image       {files}\n", map_summary(&optimized.report, columns())))?;
    }
    Ok(match &optimized.report {
        _ if !faults.is_empty() => Ending::Unfulfilled,
        report if report.achieved.stop == StopReason::Cancelled => Ending::Interrupted,
        report if report.achieved.last.flipped == 0 => Ending::Done,
        _ => Ending::Unfulfilled,
    })
}

/// Refuses to write over what is read: the inputs may have no other copy.
fn check_inputs_are_kept(arguments: &OptimizeArguments) -> Result<(), Failure> {
    let inputs = [Some(&arguments.rest), Some(&arguments.init), arguments.lock.as_ref()];
    let domain = beside(&arguments.out);
    let outputs = [&arguments.out, &domain].into_iter().chain(&arguments.told.log);
    refuse_to_write_over(inputs.into_iter().flatten(), outputs)
}

/// `image.mesh` -> `image-domain.mesh`.
fn beside(out: &Path) -> PathBuf {
    let stem = out.file_stem().unwrap_or_default().to_string_lossy();
    let ending = out.extension().map(|ending| format!(".{}", ending.to_string_lossy())).unwrap_or_default();
    out.with_file_name(format!("{stem}-domain{ending}"))
}

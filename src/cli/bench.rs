//! `qcball bench CONFIG.toml MESHES_DIR`.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use clap::Args;

use super::interrupt::cancel_on_signal;
use super::output::{note, print};
use super::{Ending, Failure};
use crate::bench::{self, Conditions, Peers, Processes};
use crate::config::BenchPlan;
use crate::mesh::io::{on_one_line, shown_path};

/// The meshes and how they are optimized.
#[derive(Debug, Args)]
pub(crate) struct BenchArguments {
    /// A config with the table `optimize`, and `threads` if wished, but without a domain.
    config: PathBuf,
    /// The folder: every NAME-rest.mesh (or another format) is optimized, from NAME-init.mesh or else the radial map.
    meshes: PathBuf,
    /// Figures of other programs: CSV with the columns mesh, peer, max_k, mean_k and cpu_seconds; may be given several times.
    #[arg(long, value_name = "FILE")]
    peers: Vec<PathBuf>,
    /// The table, in Markdown; written anew after each mesh.
    #[arg(long, value_name = "FILE", default_value = "results/bench.md")]
    out: PathBuf,
    /// Number of threads of each optimization, instead of the config's; 0 for all cores.
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u16).range(0..=1024))]
    threads: Option<u16>,
    /// Take only meshes with this in their names; may be given several times.
    #[arg(long, value_name = "PATTERN", allow_hyphen_values = true)]
    only: Vec<String>,
}

/// `qcball bench`.
pub(super) fn bench(arguments: &BenchArguments, program: &Path, words: &[OsString]) -> Result<Ending, Failure> {
    let plan = BenchPlan::read(&arguments.config)?;
    let cases = bench::cases(&arguments.meshes, &arguments.only)?;
    let peers: Vec<Peers> = arguments.peers.iter().map(|path| Peers::read(path)).collect::<Result<_, _>>()?;
    let peers = peers.into_iter().reduce(Peers::with);
    let command: Vec<_> = words.iter().map(|word| word.to_string_lossy()).collect();
    let threads = arguments.threads.map_or(plan.threads, usize::from);
    let conditions = Conditions::now(format!("qcball {}", command.join(" ")), threads);
    let processes = Processes { program: program.into(), cancel: cancel_on_signal() };
    let rows =
        bench::run(&processes, &plan, &conditions, &cases, peers.as_ref(), &arguments.out, |row| match &row.figures {
            Ok(figures) => {
                let max_k = figures.last.max_k.unwrap_or(f64::INFINITY);
                print(&format!(
                    "{:<16} max K {max_k:.4}, {:.1} s, {}\n",
                    on_one_line(&row.name),
                    figures.seconds,
                    figures.stop
                ))
                .map(|_| ())
            }
            Err(message) => {
                note(&format!("{}: {message}", on_one_line(&row.name)));
                Ok::<(), Failure>(())
            }
        })?;
    if processes.cancel.is_raised() {
        note(&format!("interrupted: {} of {} meshes are in the table", rows.len(), cases.len()));
        return Ok(Ending::Interrupted);
    }
    print(&format!("table           {}\n", shown_path(&arguments.out)))?;
    let done = rows.iter().all(|row| row.figures.as_ref().is_ok_and(|figures| figures.last.flipped == 0));
    Ok(if done { Ending::Done } else { Ending::Unfulfilled })
}

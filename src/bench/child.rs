//! One mesh in a process of its own.

use std::ffi::OsString;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

use super::{BenchError, Case, Figures, Peers, Processes};
use crate::child::guarded;
use crate::config::BenchPlan;

/// The programs whose max K is a goal: when had we what they ended with?
pub(super) const GOALS: [&str; 2] = ["qis_conf", "tinyad_k"];

/// How often a signal is looked for.
const POLL: Duration = Duration::from_millis(20);

/// Optimizes a mesh in a new process: the figures, or what that process said was wrong, or that it was ended.
///
/// # Errors
/// [`BenchError::Start`].
pub(super) fn optimize_in_child(
    Processes { program, cancel }: &Processes,
    case: &Case,
    plan: &BenchPlan,
    threads: usize,
    peers: Option<&Peers>,
) -> Result<Result<Figures, String>, BenchError> {
    let start = |source| BenchError::Start { program: program.clone(), source };
    let folder = tempfile::tempdir().map_err(start)?;
    let trace = folder.path().join("trace.csv");
    let mut command = guarded(&[], program, None);
    match &case.init {
        Some(init) => {
            command.arg("optimize").arg(&case.rest).arg(init).arg(folder.path().join("image.mesh"));
            command.arg("--config").arg(plan.source.path()).arg("--trace").arg(&trace);
        }
        None => {
            command.arg("run").arg(plan.source.path()).arg("--out").arg(folder.path());
            command.arg("--set").arg(domain_override(&case.rest));
        }
    }
    command.arg("--threads").arg(threads.to_string()).arg("--json");
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().map_err(start)?;
    // Waiting would close it, and end the child.
    let mut held = child.stdin.take();
    let output = std::thread::scope(|scope| {
        let waiting = scope.spawn(|| child.wait_with_output());
        while !waiting.is_finished() {
            std::thread::sleep(POLL);
            if cancel.is_raised() {
                held = None;
            }
        }
        waiting.join().expect("waiting does not panic")
    });
    drop(held);
    let output = output.map_err(start)?;
    // 1 is a map that is still flipped: an outcome like others.
    if !matches!(output.status.code(), Some(0 | 1)) {
        let said = String::from_utf8_lossy(&output.stderr);
        let said = said.lines().find(|line| line.starts_with("error")).unwrap_or("it said nothing");
        return Ok(Err(format!("{}: {said}", output.status)));
    }
    let goals = GOALS.iter().filter_map(|&peer| {
        let row = peers?.row(&case.name, peer)?;
        Some((peer, row.max_k, row.cpu_seconds))
    });
    // A map that nothing could untangle has no trace.
    let trace = std::fs::read(&trace).unwrap_or_default();
    Ok(Figures::read(&output.stdout, &trace, goals))
}

/// `domain.file="..."`, the path from the root, since those of a config are relative to it.
fn domain_override(rest: &Path) -> OsString {
    let path = std::path::absolute(rest).unwrap_or_else(|_| rest.into());
    format!("domain.file={}", toml::Value::String(path.to_string_lossy().into_owned())).into()
}

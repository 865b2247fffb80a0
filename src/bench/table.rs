//! The table as Markdown.

use std::fmt::Write;

use super::child::GOALS;
use super::{Conditions, Figures, Peers, Row};
use crate::config::BenchPlan;
use crate::dilatation::lower_bound;
use crate::mesh::io::{on_one_line, shown_path};
use crate::report::Report;

/// What stands where there is no figure.
const NOTHING: &str = "-";

/// The file: its conditions, our figures, and those of other programs beside them.
pub(super) fn table(
    plan: &BenchPlan,
    conditions: &Conditions,
    rows: &[Row],
    cases: usize,
    peers: Option<&Peers>,
) -> String {
    let mut text = head(plan, conditions, rows.len(), cases);
    text += &ours(rows);
    if let Some(peers) = peers {
        text += &beside_peers(rows, peers);
    }
    text
}

fn head(plan: &BenchPlan, conditions: &Conditions, done: usize, cases: usize) -> String {
    let cores = conditions.cores.map_or("unknown".into(), |cores| cores.to_string());
    let load = conditions.load.as_deref().unwrap_or("unknown");
    let unfinished =
        if done < cases { format!(" The bench is not at its end: {done} of {cases} meshes.") } else { String::new() };
    format!(
        "# Bench\n\n\
         Made by `{}`; each mesh by a process of its own, one after the other.{unfinished}\n\n\
         - qcball {}, revision {}\n\
         - machine: {cores} cores, load averages at the start {load} over 1, 5 and 15 minutes; {} threads a mesh (0: all \
         cores)\n\
         - settings, from `{}`:\n\n\
         ```toml\n{}\n```\n\n",
        on_one_line(&conditions.command),
        Report::VERSION,
        Report::REVISION,
        conditions.threads,
        shown_path(plan.source.path()),
        plan.source.text().trim_end(),
    )
}

fn ours(rows: &[Row]) -> String {
    let mut text = String::from(
        "Start and final figures are of the mesh as optimized: where tets had to be freed by splits, the split one. *Seconds* \
         are those of a clock, without reading and writing files; *CPU s* and *peak MiB* are of the whole process. *KKT \
         residual*: of the minimax solution before the polish. *Gap*: max K / best bound, the largest one proved for maps of the mesh \
         with its boundary without a search for a certificate.\n\n\
         | mesh | tets | start max K | start mean K | flipped | max K | mean K | flipped at the end | iterations | seconds | CPU s | \
         peak MiB | KKT residual | best bound | gap | stop |\n\
         |---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|---|\n",
    );
    for row in rows {
        let name = cell(&row.name) + if row.radial { " (radial start)" } else { "" };
        match &row.figures {
            Ok(figures) => text += &our_row(&name, figures),
            Err(message) => {
                let blanks = format!("{NOTHING} | ").repeat(14);
                let _ = writeln!(text, "| {name} | {blanks}failed: {} |", cell(message));
            }
        }
    }
    text
}

fn our_row(name: &str, figures: &Figures) -> String {
    format!(
        "| {name} | {} | {} | {} | {} | {} | {} | {} | {} | {:.1} | {} | {} | {} | {} | {} | {} |\n",
        figures.tets,
        dilatation(figures.first.max_k),
        dilatation(figures.first.mean_k),
        figures.first.flipped,
        dilatation(figures.last.max_k),
        dilatation(figures.last.mean_k),
        figures.last.flipped,
        figures.iterations,
        figures.seconds,
        or_nothing(figures.cpu_seconds, |seconds| format!("{seconds:.1}")),
        or_nothing(figures.peak_memory_mib, |mib| format!("{mib:.0}")),
        or_nothing(figures.kkt, |residual| format!("{residual:.1e}")),
        or_nothing(figures.best_bound, lower_bound),
        or_nothing(figures.gap, |gap| format!("{gap:.4}")),
        figures.stop,
    )
}

fn beside_peers(rows: &[Row], peers: &Peers) -> String {
    let mut text = String::from(
        "\n## Beside other programs\n\n\
         Their figures and times are those of the files given with `--peers`: measured earlier, under other load, on the meshes \
         as they are in the folder. *K ratio* and *mean ratio*: ours over that of the program with the \
         least max K; below 1 is better. *Until its K*: our CPU seconds until our max K was that program's final one, over its \
         CPU seconds. Ours are the clock's seconds of the trace, untangling included, times the share of the processor that \
         the process had.\n\n\
         | mesh | best peer | its max K | our max K | K ratio | its mean K | our mean K | mean ratio | its CPU s | our CPU s |",
    );
    for goal in GOALS {
        let _ = write!(text, " until {goal}'s K |");
    }
    text += "\n|---|---|--:|--:|--:|--:|--:|--:|--:|--:|";
    text += &"--:|".repeat(GOALS.len());
    text += "\n";
    for row in rows {
        let (Ok(figures), Some(best)) = (&row.figures, peers.best(&row.name)) else { continue };
        let ratio = |ours: Option<f64>, theirs: f64| or_nothing(ours, |ours| format!("{:.4}", ours / theirs));
        let _ = write!(
            text,
            "| {} | {} | {} | {} | {} | {} | {} | {} | {:.1} | {} |",
            cell(&row.name),
            cell(&best.peer),
            best.max_k,
            dilatation(figures.last.max_k),
            ratio(figures.last.max_k, best.max_k),
            best.mean_k,
            dilatation(figures.last.mean_k),
            ratio(figures.last.mean_k, best.mean_k),
            best.cpu_seconds,
            or_nothing(figures.cpu_seconds, |seconds| format!("{seconds:.1}")),
        );
        for goal in GOALS {
            let reach = figures.reached.iter().find(|reach| reach.peer == goal);
            let reach = reach.map_or(NOTHING.into(), |reach| match reach.ours {
                Some(ours) => format!("{ours:.2} s / {:.2} s = {:.2}", reach.theirs, ours / reach.theirs),
                None => "not reached".into(),
            });
            let _ = write!(text, " {reach} |");
        }
        text += "\n";
    }
    text
}

/// A text from outside as a cell of the table.
fn cell(text: &str) -> String {
    on_one_line(text).replace('|', "\\|")
}

/// A K that may be infinite, and of a start very large.
fn dilatation(k: Option<f64>) -> String {
    match k {
        None => "inf".into(),
        Some(k) if k < 1000.0 => format!("{k:.4}"),
        Some(k) => format!("{k:.0}"),
    }
}

fn or_nothing(figure: Option<f64>, shown: impl FnOnce(f64) -> String) -> String {
    figure.map_or(NOTHING.into(), shown)
}

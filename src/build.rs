//! Tells the crate which revision it was built from, for the reports.

use std::path::Path;
use std::process::Command;

/// What decides the program's behaviour, and so whether a build is of the revision or of something edited since.
const SOURCES: [&str; 3] = ["src", "Cargo.toml", "Cargo.lock"];

fn main() {
    for source in SOURCES {
        println!("cargo::rerun-if-changed={source}");
    }
    // The log of HEAD grows with every commit and checkout. A path that does not exist would rerun this every time.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]).filter(|log| Path::new(log).exists()) {
        println!("cargo::rerun-if-changed={log}");
    }
    println!("cargo::rustc-env=QCBALL_REVISION={}", revision().unwrap_or_else(|| "unknown".into()));
}

/// The commit, with `-modified` where the sources differ from it; `None` outside a git checkout of this package.
fn revision() -> Option<String> {
    // A package unpacked below some other repository is not of that repository's revision.
    git(&["ls-files", "--error-unmatch", "Cargo.toml"])?;
    let commit = git(&["rev-parse", "HEAD"])?;
    let status = [&["status", "--porcelain", "--untracked-files=all", "--"], &SOURCES[..]].concat();
    let modified = if git(&status)?.is_empty() { "" } else { "-modified" };
    Some(commit + modified)
}

fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok().filter(|output| output.status.success())?;
    Some(String::from_utf8(output.stdout).ok()?.trim().to_string())
}

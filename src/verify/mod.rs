//! Checking a results folder from its files alone.
//!
//! The config's text gives the domain and the map started from once more, as the run made them; the two meshes give the map
//! arrived at; and from these the whole record is made anew, by the same function that a run calls, and compared with
//! `report.json` figure by figure. Each file is then written once more and compared byte by byte: a key, an array or a line
//! too much shows, and so does a summary that says something else than the record. A folder with a file that no run writes is
//! refused. K of every tet is held between proved ends.
//!
//! What cannot be seen in a result is taken on trust and listed as such ([`Verification::trusted`]): how the optimization went
//! (of the trace, the stop reason and the KKT residual, which is of the map before any polish, only the agreement with each other
//! and with the maps is checked), versions and times, the domain's file where it is not there, and that an external mesher
//! made a mesh. The hashes in a report tie it to the file that they are of: whoever changes one of the two is found, whoever
//! changes both is not, and who wrote them no hash can tell.

mod claims;
mod files;
mod rounding;
mod start;

use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;

use files::Files;

use crate::mesh::io::{on_one_line, shown_path};

/// Why a folder cannot be checked at all.
#[derive(Debug, thiserror::Error)]
pub enum VerifyError {
    /// There is no report.
    #[error("{} is not the folder of a run: {message}; name one that `qcball run` wrote", shown_path(folder))]
    NoReport {
        /// The folder.
        folder: PathBuf,
        /// What is missing.
        message: String,
    },
    /// The folder of a sweep, whose cases have the reports.
    #[error(
        "{0} is the folder of a sweep; verify its cases one by one, for example `qcball verify {0}/cases/ID` with an id from \
         index.csv",
        shown_path(folder)
    )]
    Sweep {
        /// The folder.
        folder: PathBuf,
    },
    /// The folder of a comparison of maps in closed form.
    #[error(
        "{} holds the tables of a config with [analytic], which are not verified: only runs of [domain] are",
        shown_path(folder)
    )]
    Tables {
        /// The folder.
        folder: PathBuf,
    },
}

/// What came of checking a results folder.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verification {
    /// Whether every claim that was checked holds.
    pub verified: bool,
    /// The largest K of the final map rounded up, for exactly the positions in the files; `null` in JSON if infinite, and
    /// none if there is no map to measure.
    pub max_k_upper: Option<f64>,
    /// What was checked, in order.
    pub checks: Vec<Check>,
    /// What differs, in the order it was found.
    pub discrepancies: Vec<String>,
    /// What was taken on trust.
    pub trusted: Vec<String>,
}

/// One thing that was checked.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Check {
    /// What, in words.
    pub what: String,
    /// How many discrepancies it brought up.
    pub discrepancies: usize,
}

/// Checks the folder of a run; `verified` is the answer.
///
/// # Errors
/// The folder holds no report to check.
pub fn verify(folder: &Path) -> Result<Verification, VerifyError> {
    let mut findings = Findings::default();
    let report = files::report_text(folder)?;
    if let Some(files) = Files::read(folder, &report, &mut findings) {
        claims::check(&files, &mut findings);
    }
    Ok(findings.into_verification())
}

/// What was found so far.
#[derive(Default)]
struct Findings {
    checks: Vec<Check>,
    discrepancies: Vec<String>,
    trusted: Vec<String>,
    max_k_upper: Option<f64>,
}

impl Findings {
    /// Begins a check; what is found next belongs to it.
    fn begin(&mut self, what: impl Into<String>) {
        self.checks.push(Check { what: what.into(), discrepancies: 0 });
    }

    /// Records a discrepancy of the check begun last.
    fn found(&mut self, discrepancy: impl Into<String>) {
        if let Some(check) = self.checks.last_mut() {
            check.discrepancies += 1;
        }
        self.discrepancies.push(discrepancy.into());
    }

    /// Records what is not checked.
    fn trust(&mut self, what: impl Into<String>) {
        self.trusted.push(what.into());
    }

    /// Records a discrepancy unless all is well.
    fn expect(&mut self, well: bool, discrepancy: impl FnOnce() -> String) {
        if !well {
            self.found(discrepancy());
        }
    }

    fn into_verification(self) -> Verification {
        let Self { checks, discrepancies, trusted, max_k_upper } = self;
        Verification { verified: discrepancies.is_empty(), max_k_upper, checks, discrepancies, trusted }
    }
}

impl fmt::Display for Verification {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        /// More of them would not be read.
        const NAMED: usize = 20;
        for check in &self.checks {
            let verdict = if check.discrepancies == 0 { "holds" } else { "FAILS" };
            writeln!(f, "{verdict}  {}", check.what)?;
        }
        for discrepancy in self.discrepancies.iter().take(NAMED) {
            writeln!(f, "differs     {}", on_one_line(discrepancy))?;
        }
        if self.discrepancies.len() > NAMED {
            writeln!(f, "            and {} more; --json lists all", self.discrepancies.len() - NAMED)?;
        }
        for what in &self.trusted {
            writeln!(f, "trusted     {}", on_one_line(what))?;
        }
        match self.max_k_upper {
            Some(upper) if upper.is_finite() => {
                writeln!(f, "max K <= {upper} for exactly the positions in image.vtu")?;
            }
            Some(_) => writeln!(f, "max K has no upper end: tets are flipped, or so thin that rounding decides")?,
            None => {}
        }
        writeln!(f, "{}", if self.verified { "verified" } else { "NOT verified" })
    }
}

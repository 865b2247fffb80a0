//! `qcball verify DIR`.

use std::path::PathBuf;

use clap::Args;

use super::output::print;
use super::{Ending, Failure};
use crate::report::to_json;
use crate::verify::verify;

/// The results to be checked.
#[derive(Debug, Args)]
pub(crate) struct VerifyArguments {
    /// A folder that `qcball run` wrote.
    folder: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// `qcball verify`.
pub(super) fn verify_folder(arguments: &VerifyArguments) -> Result<Ending, Failure> {
    let verification = verify(&arguments.folder)?;
    print(&if arguments.json { to_json(&verification) } else { verification.to_string() })?;
    Ok(if verification.verified { Ending::Done } else { Ending::Unfulfilled })
}

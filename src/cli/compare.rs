//! `qcball compare A B` and `qcball table FOLDER`.

use std::path::PathBuf;

use clap::Args;

use super::output::{note, print};
use super::{Ending, Failure};
use crate::sweep::{Results, Table, TableFormat, USUAL_COLUMNS, compare};

/// Two folders of results.
#[derive(Debug, Args)]
pub(crate) struct CompareArguments {
    /// The folder of a sweep or of a run: the one before.
    before: PathBuf,
    /// Another: the one after.
    after: PathBuf,
    /// How the table is written.
    #[arg(long, value_enum, default_value = "text")]
    format: TableFormat,
}

/// A folder of results as a table.
#[derive(Debug, Args)]
pub(crate) struct TableArguments {
    /// The folder of a sweep or of a run.
    folder: PathBuf,
    /// The columns after the settings: those of index.csv, and seconds.
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', default_value = USUAL_COLUMNS)]
    columns: Vec<String>,
    /// How the table is written.
    #[arg(long, value_enum, default_value = "text")]
    format: TableFormat,
}

/// `qcball compare`.
pub(super) fn compare_folders(arguments: &CompareArguments) -> Result<Ending, Failure> {
    let compared = compare(&Results::read(&arguments.before)?, &Results::read(&arguments.after)?)?;
    // Apart from the table, which may go into a file.
    note(&compared.sentence);
    print(&compared.table.write(arguments.format))
}

/// `qcball table`.
pub(super) fn table(arguments: &TableArguments) -> Result<Ending, Failure> {
    print(&Table::of(&Results::read(&arguments.folder)?, &arguments.columns)?.write(arguments.format))
}

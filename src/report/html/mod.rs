//! `report.html`, one file that needs no network, and the pictures in `plots/`: made from a run's record and maps, or from the
//! other files of a results folder alone.

mod chart;
mod page;
mod run;
mod surfaces;
mod svg;
mod sweep;

pub use run::{ShownMap, page_of_map};

use std::path::{Path, PathBuf};

use super::{MapRecord, Report};
use crate::mesh::io::{ReadError, WriteError, shown_path};

/// What a folder holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Run,
    Sweep,
}

/// Why there is no page.
#[derive(Debug, thiserror::Error)]
pub enum PageError {
    /// Neither a run's nor a sweep's folder.
    #[error(
        "{} holds no results: a run's folder has report.json, a sweep's has index.jsonl; name one that `qcball run` or \
         `qcball sweep` wrote",
        shown_path(path)
    )]
    NoResults {
        /// The path.
        path: PathBuf,
    },
    /// A mesh that cannot be read.
    #[error(transparent)]
    Mesh(#[from] ReadError),
    /// A table or record that cannot be read, or that does not fit the others.
    #[error("{}: {message}; run again to make it anew", shown_path(path))]
    Broken {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// A file that cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}

impl PageError {
    fn broken(path: &Path, message: impl ToString) -> Self {
        Self::Broken { path: path.into(), message: message.to_string() }
    }
}

/// Writes `report.html` and `plots/*.svg` into the folder of a run or of a sweep, from its other files, and returns the
/// page's path.
///
/// # Errors
/// A folder that is neither, a file that is broken, or one that cannot be written.
pub fn write_pages(folder: &Path) -> Result<PathBuf, PageError> {
    let kind = if folder.join("report.json").is_file() {
        Kind::Run
    } else if folder.join("index.jsonl").is_file() {
        Kind::Sweep
    } else {
        return Err(PageError::NoResults { path: folder.into() });
    };
    let page = match kind {
        Kind::Run => run::of_folder(folder)?,
        Kind::Sweep => sweep::page(folder)?,
    };
    put(&page, folder)
}

/// The same of a run whose files stand in `folder`, from what they were written from.
///
/// # Errors
/// A file that cannot be written.
pub fn write_pages_of(folder: &Path, report: &Report, record: &MapRecord) -> Result<PathBuf, PageError> {
    let cells = record.cell_rows();
    let page = run::page(&run::Shown {
        report,
        cells: &cells,
        trace: record.trace,
        mesh: &record.domain.mesh().in_unit(record.units[0].inverse()),
        boundary: record.domain.boundary(),
        image: &record.units[1].give_back_points(record.image),
    });
    put(&page, folder)
}

fn put(page: &page::Page, folder: &Path) -> Result<PathBuf, PageError> {
    let path = folder.join("report.html");
    page.write_plots(folder)?;
    page.write(&path)?;
    Ok(path)
}

fn read_text(path: &Path) -> Result<String, PageError> {
    std::fs::read_to_string(path).map_err(|error| PageError::broken(path, format!("cannot be read: {error}")))
}

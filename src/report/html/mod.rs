//! `report.html`, one file that needs no network, and the pictures in `plots/`: made from a run's record and maps, or from the
//! other files of a results folder alone.

mod chart;
mod page;
mod pair;
mod run;
mod svg;
mod sweep;
mod viewer;

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
    /// A folder beside another that is no run's.
    #[error(
        "{} has no report.json: two runs are set side by side; `qcball compare` does it with the cases of two sweeps",
        shown_path(path)
    )]
    NoRun {
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
        Kind::Run => run::page(&run::Files::read(folder)?.shown()),
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
        start: Some(&record.units[1].give_back_points(record.initial)),
        image: &record.units[1].give_back_points(record.image),
    });
    put(&page, folder)
}

/// Cases up to which a sweep makes a page for each, 0.6 MB and more.
const MOST_CASE_PAGES: usize = 100;

/// Writes the page of a sweep, and first those of its cases that are done and have none, unless there are more than a hundred;
/// returns the page's path.
///
/// # Errors
/// A folder that is none of a sweep, a file that is broken, or one that cannot be written.
pub fn write_sweep_pages(folder: &Path) -> Result<PathBuf, PageError> {
    let made = match sweep::done(folder)?.len() {
        0..=MOST_CASE_PAGES => sweep::without_page(folder)?.iter().try_for_each(|case| write_pages(case).map(drop)),
        _ => Ok(()),
    };
    // A case whose page cannot be made is told, and hides no other.
    let page = write_pages(folder)?;
    made.map(|()| page)
}

/// Writes the pages of all cases of a sweep that are done, and returns how many.
///
/// # Errors
/// A folder that is none of a sweep, a file that is broken, or one that cannot be written.
pub fn write_case_pages(folder: &Path) -> Result<usize, PageError> {
    if !folder.join("index.jsonl").is_file() {
        return Err(PageError::NoResults { path: folder.into() });
    }
    let cases = sweep::done(folder)?;
    cases.iter().try_for_each(|case| write_pages(case).map(drop))?;
    Ok(cases.len())
}

/// Writes a page with two runs side by side, from the files of their folders.
///
/// # Errors
/// A folder that is none of a run, a file that is broken, or one that cannot be written.
pub fn write_pair(folders: [&Path; 2], page: &Path) -> Result<(), PageError> {
    for folder in folders {
        if !folder.join("report.json").is_file() {
            return Err(PageError::NoRun { path: folder.into() });
        }
    }
    let [one, other] = folders.map(run::Files::read);
    Ok(pair::page([&one?.shown(), &other?.shown()]).write(page)?)
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

//! File formats, one per file.

mod atomic;
mod medit;
mod vtu;

pub use atomic::{WriteError, check_folder_is_writable, write_atomically};
pub use medit::{read_medit, write_medit};
pub use vtu::{DataArray, Values, write_vtu};

use std::path::{Path, PathBuf};

use super::TetSoup;

/// Why a mesh file could not be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The operating system refused: no such file, a directory, no permission.
    #[error("cannot read {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The file does not hold what its format asks for.
    #[error("{}{}: {message}", path.display(), line.map(|l| format!(":{l}")).unwrap_or_default())]
    Content {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1, where one is to blame.
        line: Option<usize>,
        /// What is wrong and what to do.
        message: String,
    },
    /// The format follows the file's ending, and this one is not known.
    #[error("{}: unknown file ending; known are {known}", path.display())]
    UnknownEnding {
        /// The file.
        path: PathBuf,
        /// The endings that are known.
        known: &'static str,
    },
}

/// Reads a tetrahedral mesh; the format follows the file's ending.
///
/// # Errors
/// Where and why the file could not be read, or that its ending is not known.
pub fn read_tets(path: &Path) -> Result<TetSoup, ReadError> {
    let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
    match ending.as_deref().and_then(|ending| ending.to_str()) {
        Some("mesh") => read_medit(path),
        _ => Err(ReadError::UnknownEnding { path: path.to_path_buf(), known: ".mesh (Medit, ASCII)" }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_endings_are_refused_before_reading() {
        for name in ["a.meshb", "mesh", "a", ""] {
            let error = read_tets(Path::new(name)).unwrap_err();
            assert!(matches!(error, ReadError::UnknownEnding { .. }), "{name}: {error}");
        }
        assert!(matches!(read_tets(Path::new("no/such.MESH")).unwrap_err(), ReadError::Io { .. }));
    }
}

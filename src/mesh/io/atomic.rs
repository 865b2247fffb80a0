//! Files that are whole or not there: written beside their place, then renamed into it.

use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use super::shown_path;

/// Why a file could not be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {source}; {remedy}", shown_path(path))]
pub struct WriteError {
    /// The file or folder.
    pub path: PathBuf,
    /// The system's reason, or ours.
    pub source: io::Error,
    /// What to do about it.
    remedy: &'static str,
}

impl WriteError {
    /// A refusal of the system, with what can be done about it.
    pub(crate) fn new(path: &Path, source: io::Error) -> Self {
        let remedy = match source.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => "free some space or write elsewhere",
            io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => "choose a folder you may write to",
            io::ErrorKind::NotADirectory | io::ErrorKind::AlreadyExists => "a file stands where a folder is needed",
            io::ErrorKind::IsADirectory => "name a file, not a folder",
            io::ErrorKind::NotFound => "the folder does not exist and cannot be made there",
            _ => "check the path or write elsewhere",
        };
        Self { path: path.to_path_buf(), source, remedy }
    }

    /// What the format of the file cannot hold, and what to do instead.
    pub(super) fn refused(path: &Path, fault: impl Into<String>, remedy: &'static str) -> Self {
        let source = io::Error::new(io::ErrorKind::InvalidInput, fault.into());
        Self { path: path.to_path_buf(), source, remedy }
    }
}

/// Writes a file so that at `path` there is at any time either what was there before or the whole new content.
///
/// The content goes to a temporary file in the same folder (made if missing), is flushed to the disk and renamed. A
/// symbolic link is followed, not replaced. A device or pipe, which a rename would destroy, is written to directly.
///
/// # Errors
/// The path and the system's reason; what stood at `path` is then unchanged.
pub fn write_atomically(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), WriteError> {
    replace(path, fill).map_err(|source| WriteError::new(path, source))
}

fn replace(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let target = match fs::metadata(path) {
        Ok(found) if found.is_dir() => return Err(io::ErrorKind::IsADirectory.into()),
        Ok(found) if !found.is_file() => {
            let mut writer = BufWriter::new(fs::OpenOptions::new().write(true).open(path)?);
            fill(&mut writer)?;
            return writer.flush();
        }
        Ok(_) => path.canonicalize()?,
        Err(error) if error.kind() == io::ErrorKind::NotFound => path.to_path_buf(),
        Err(error) => return Err(error),
    };
    let folder = folder_of(&target);
    fs::create_dir_all(folder)?;
    let mut file = temporary_file(folder)?;
    let mut writer = BufWriter::new(file.as_file_mut());
    fill(&mut writer)?;
    writer.flush()?;
    drop(writer);
    file.as_file().sync_all()?;
    file.persist(&target).map_err(|error| error.error)?;
    Ok(())
}

/// Checks that files can be written below `folder`, which need not exist yet; leaves nothing behind.
///
/// Asked before a long run, so that its result does not fall on a full or read-only disk.
///
/// # Errors
/// The folder and the system's reason.
pub fn check_folder_is_writable(folder: &Path) -> Result<(), WriteError> {
    // An empty path is what the parent of a bare relative name is.
    let mut existing = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let found = loop {
        match fs::metadata(existing) {
            // A link to nothing: no folder can be made in its place.
            Err(_) if fs::symlink_metadata(existing).is_ok() => break Err(io::ErrorKind::AlreadyExists.into()),
            Err(error) if error.kind() == io::ErrorKind::NotFound => match existing.parent() {
                Some(parent) if parent.as_os_str().is_empty() => existing = Path::new("."),
                Some(parent) => existing = parent,
                None => break Err(error),
            },
            found => break found,
        }
    };
    found
        .and_then(|found| if found.is_dir() { Ok(()) } else { Err(io::ErrorKind::NotADirectory.into()) })
        .and_then(|()| temporary_file(existing)?.write_all(b"can this folder be written to?"))
        .map_err(|source| WriteError::new(folder, source))
}

/// Checks that a file can be put at `path`: no folder stands there, and its own can be written to, made if need be.
///
/// # Errors
/// The path and the system's reason.
pub fn check_file_can_be_put(path: &Path) -> Result<(), WriteError> {
    match fs::metadata(path) {
        Ok(found) if found.is_dir() => Err(WriteError::new(path, io::ErrorKind::IsADirectory.into())),
        // A device or pipe, which is written to directly.
        Ok(found) if !found.is_file() => Ok(()),
        _ => check_folder_is_writable(folder_of(path)),
    }
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn temporary_file(folder: &Path) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".qcball-");
    // tempfile's default, readable by the owner alone, would outlive the rename; the umask still applies to this.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder).map_err(|error| {
        // tempfile words the error with its random file name, which the caller's message replaces by the real path.
        error.raw_os_error().map_or_else(|| error.kind().into(), io::Error::from_raw_os_error)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn put(path: &Path, text: &str) -> Result<(), WriteError> {
        write_atomically(path, |file| file.write_all(text.as_bytes()))
    }

    fn names(folder: &Path) -> Vec<String> {
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new/report.json");
        put(&path, "old").unwrap();
        let error = write_atomically(&path, |file| {
            file.write_all(b"half of the ne")?;
            Err(io::ErrorKind::StorageFull.into())
        });
        let message = error.unwrap_err().to_string();
        assert!(message.contains("report.json") && message.contains("free some space"), "{message}");
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        put(&path, "new").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");
        assert_eq!(names(path.parent().unwrap()), ["report.json"]);
    }

    #[test]
    fn folders_and_paths_below_files_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        put(&file, "text").unwrap();
        assert!(put(folder.path(), "x").unwrap_err().to_string().contains("name a file, not a folder"));
        for below in [file.join("out"), file.join("deep/out")] {
            let (write, check) = (put(&below, "x").unwrap_err(), check_folder_is_writable(&below).unwrap_err());
            for message in [write.to_string(), check.to_string()] {
                assert!(message.contains("a file stands where a folder is needed"), "{message}");
                assert!(message.contains(below.to_str().unwrap()), "{message}");
            }
        }
        check_folder_is_writable(&folder.path().join("a/b/c")).unwrap();
        check_folder_is_writable(Path::new("not-there")).unwrap();
        check_folder_is_writable(Path::new("")).unwrap();
        assert_eq!(names(folder.path()), ["file"]);
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_devices_written_to_and_files_made_with_the_umask() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (real, link, plain) = (folder.path().join("real"), folder.path().join("link"), folder.path().join("plain"));
        put(&real, "old").unwrap();
        std::os::unix::fs::symlink(&real, &link).unwrap();
        put(&link, "new").unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read_to_string(&real).unwrap(), "new");
        let dangling = folder.path().join("dangling");
        std::os::unix::fs::symlink(folder.path().join("nothing"), &dangling).unwrap();
        for below in [dangling.clone(), dangling.join("deep")] {
            let message = check_folder_is_writable(&below).unwrap_err().to_string();
            assert!(message.contains("a file stands where a folder is needed"), "{message}");
        }
        fs::write(&plain, "").unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&real), mode(&plain));
        if Path::new("/dev/full").exists() {
            let message = put(Path::new("/dev/full"), "x").unwrap_err().to_string();
            assert!(message.contains("/dev/full") && message.contains("No space left"), "{message}");
            assert!(!fs::metadata("/dev/full").unwrap().is_file());
        }
    }
}

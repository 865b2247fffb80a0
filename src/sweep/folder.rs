//! The folder of a sweep: one folder below `cases/` for each case that came to an end.

use std::collections::{BTreeSet, HashSet};
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use super::{Case, ID_LETTERS};
use crate::mesh::io::{WriteError, check_folder_is_writable, write_atomically};

/// The one file of a failed case.
const ERROR: &str = "error.txt";

/// How far a case has come, as its folder tells. The best of those that apply holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum State {
    /// It ended by itself: `cases/ID`.
    Done,
    /// Its input was refused or the program panicked: `cases/ID-failed`.
    Failed,
    /// It was cancelled; its best iterate is in `cases/ID-incomplete`.
    Incomplete,
    /// There is nothing of it.
    Missing,
}

impl State {
    /// The name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Failed => "failed",
            Self::Incomplete => "incomplete",
            Self::Missing => "missing",
        }
    }

    /// The file without which a case's folder is not what it claims to be.
    fn record(self) -> &'static str {
        if self == Self::Failed { ERROR } else { "report.json" }
    }

    /// What a case's folder has after the id.
    fn suffix(self) -> &'static str {
        match self {
            Self::Done | Self::Missing => "",
            Self::Failed => "-failed",
            Self::Incomplete => "-incomplete",
        }
    }
}

/// The folder of a sweep.
#[derive(Clone, Debug)]
pub struct SweepFolder {
    root: PathBuf,
}

/// A case taken by this process; other processes leave it alone until this is dropped.
#[derive(Debug)]
pub(super) struct Taken {
    /// The lock file; `None` where the file system has no locks.
    lock: Option<(PathBuf, File)>,
}

impl Drop for Taken {
    fn drop(&mut self) {
        if let Some((path, _)) = &self.lock {
            // Left behind it is an empty file that nobody holds.
            let _ = fs::remove_file(path);
        }
    }
}

impl SweepFolder {
    /// A folder, which need not exist yet.
    pub fn new(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.root
    }

    fn cases(&self) -> PathBuf {
        self.root.join("cases")
    }

    /// Where the results of a case in a state stand.
    pub fn of_case(&self, id: &str, state: State) -> PathBuf {
        self.cases().join(format!("{id}{}", state.suffix()))
    }

    /// Checks that it can be written to, and makes it.
    ///
    /// # Errors
    /// The folder and the system's reason.
    pub fn prepare(&self) -> Result<(), WriteError> {
        let cases = self.cases();
        check_folder_is_writable(&cases)?;
        fs::create_dir_all(&cases).map_err(|source| WriteError::new(&cases, source))
    }

    /// How far a case has come.
    pub fn state(&self, id: &str) -> State {
        let mut states = [State::Done, State::Failed, State::Incomplete].into_iter();
        states.find(|&state| self.of_case(id, state).join(state.record()).is_file()).unwrap_or(State::Missing)
    }

    /// Why a failed case failed.
    pub fn error(&self, id: &str) -> Option<String> {
        let text = fs::read_to_string(self.of_case(id, State::Failed).join(ERROR)).ok()?;
        Some(text.trim_end().to_string())
    }

    /// Removes what there is of a case.
    ///
    /// # Errors
    /// The folder that could not be removed.
    pub fn forget(&self, id: &str) -> Result<(), WriteError> {
        [State::Done, State::Failed, State::Incomplete].into_iter().try_for_each(|state| self.remove(id, state))
    }

    /// The ids of the cases that stand here and that are none of these, in their order.
    ///
    /// # Errors
    /// The folder that cannot be read.
    pub fn others(&self, cases: &[Case]) -> Result<Vec<String>, WriteError> {
        let folder = self.cases();
        let entries = match fs::read_dir(&folder) {
            Ok(entries) => entries,
            Err(source) if source.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
            Err(source) => return Err(WriteError::new(&folder, source)),
        };
        let known: HashSet<&str> = cases.iter().map(|case| case.id.as_str()).collect();
        let names = entries.flatten().filter_map(|entry| entry.file_name().into_string().ok());
        // Folders of other names are the user's.
        let ids = names.filter_map(|name| {
            let id = name.split_once('-').map_or(name.as_str(), |(id, _)| id);
            let ours = id.len() == ID_LETTERS && id.bytes().all(|byte| byte.is_ascii_hexdigit());
            (ours && !known.contains(id) && self.state(id) != State::Missing).then(|| id.to_string())
        });
        Ok(ids.collect::<BTreeSet<String>>().into_iter().collect())
    }

    /// Removes the cases that stand here and that are none of these, but for those that a process is at, and returns their ids.
    ///
    /// # Errors
    /// The folder that could not be read or removed.
    pub fn prune(&self, cases: &[Case]) -> Result<Vec<String>, WriteError> {
        let mut removed = Vec::new();
        for id in self.others(cases)? {
            if let Some(_taken) = self.take(&id)? {
                self.forget(&id)?;
                removed.push(id);
            }
        }
        Ok(removed)
    }

    fn remove(&self, id: &str, state: State) -> Result<(), WriteError> {
        let folder = self.of_case(id, state);
        match fs::remove_dir_all(&folder) {
            Err(source) if source.kind() != io::ErrorKind::NotFound => Err(WriteError::new(&folder, source)),
            _ => Ok(()),
        }
    }

    /// Takes a case for this process, and clears away what a killed one left of it; `None` if another process has it.
    ///
    /// # Errors
    /// A lock file that cannot be made.
    pub(super) fn take(&self, id: &str) -> Result<Option<Taken>, WriteError> {
        let path = self.lock(id);
        // A link would lock, and make, a file elsewhere.
        if fs::symlink_metadata(&path).is_ok_and(|data| !data.is_file()) {
            let source = io::Error::new(io::ErrorKind::AlreadyExists, "a link or folder stands where the lock goes");
            return Err(WriteError::new(&path, source));
        }
        let file = File::options().write(true).create(true).truncate(false).open(&path);
        let file = file.map_err(|source| WriteError::new(&path, source))?;
        let lock = match file.try_lock() {
            Ok(()) => Some((path, file)),
            Err(TryLockError::WouldBlock) => return Ok(None),
            // A file system without locks: whoever writes last then wins, with the same results.
            Err(TryLockError::Error(_)) => None,
        };
        if lock.is_some() {
            self.clear_parts(id);
        }
        Ok(Some(Taken { lock }))
    }

    /// Removes the lock that a process left which was killed after the last file of a case; one that is held stays.
    pub(super) fn clear_lock(&self, id: &str) {
        if self.lock(id).is_file() {
            // What cannot be removed does no harm.
            drop(self.take(id));
        }
    }

    fn lock(&self, id: &str) -> PathBuf {
        self.cases().join(format!(".{id}.lock"))
    }

    /// Removes the unfinished folders of a case, which only a process that was killed leaves behind.
    fn clear_parts(&self, id: &str) {
        let start = part_prefix(id);
        for entry in fs::read_dir(self.cases()).into_iter().flatten().flatten() {
            if entry.file_name().to_string_lossy().starts_with(&start) {
                // What cannot be removed does no harm.
                let _ = fs::remove_dir_all(entry.path());
            }
        }
    }

    /// Puts a case's folder in its place, filled by `fill`: it is whole or not there. Folders of other states give way.
    ///
    /// # Errors
    /// What could not be written; the case is then as it was.
    pub(super) fn put(
        &self,
        id: &str,
        state: State,
        fill: impl FnOnce(&Path) -> Result<(), WriteError>,
    ) -> Result<(), WriteError> {
        let target = self.of_case(id, state);
        let fault = |source| WriteError::new(&target, source);
        let mut builder = tempfile::Builder::new();
        let prefix = part_prefix(id);
        builder.prefix(&prefix);
        // tempfile's default would keep all others out of the results; the umask still applies to this.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o777));
        let part = builder.tempdir_in(self.cases()).map_err(fault)?;
        fill(part.path())?;
        self.remove(id, state)?;
        fs::rename(part.path(), &target).map_err(fault)?;
        // It is in its place, under another name.
        let _ = part.keep();
        for other in [State::Failed, State::Incomplete].into_iter().filter(|&other| other != state) {
            self.remove(id, other)?;
        }
        Ok(())
    }

    /// Records why a case failed.
    ///
    /// # Errors
    /// What could not be written.
    pub(super) fn put_failed(&self, id: &str, message: &str) -> Result<(), WriteError> {
        self.put(id, State::Failed, |part| write_atomically(&part.join(ERROR), |file| writeln!(file, "{message}")))
    }
}

/// What the folders of a case begin with until they are whole.
fn part_prefix(id: &str) -> String {
    format!(".{id}-part-")
}

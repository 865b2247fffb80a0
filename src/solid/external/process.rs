//! A program found, run with a time limit, and never left behind.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus};
use std::time::Duration;

use super::{ExternalError, ExternalMesher, ExternalSettings};
use crate::cancel::Cancel;
use crate::child::guarded;
use crate::mesh::io::shown_path;

/// The program of a mesher and the time it has left.
pub(super) struct Program {
    mesher: ExternalMesher,
    path: PathBuf,
    limit: Duration,
    /// With the limit as deadline.
    cancel: Cancel,
}

/// Bytes of output after which a program is ended, lest it fill the disk.
const MOST_OUTPUT: u64 = 1 << 26;

/// A run that came to its end by itself.
pub(super) struct Ended {
    pub status: ExitStatus,
    /// The last lines it printed.
    pub words: String,
}

impl Program {
    /// Finds the program: the configured one, else the environment's, else the usual name. The time starts now.
    pub fn find(settings: &ExternalSettings, cancel: &Cancel) -> Result<Self, ExternalError> {
        let &ExternalSettings { mesher, ref program, time_limit: limit, .. } = settings;
        let variable = std::env::var_os(mesher.variable()).filter(|value| !value.is_empty());
        let (path, source) = match (program, variable) {
            (Some(path), _) => (path.clone(), "the config's program"),
            (None, Some(value)) => (PathBuf::from(value), mesher.variable()),
            (None, None) => (PathBuf::from(mesher.program()), ""),
        };
        let found = if path.components().count() == 1 {
            search_path(&path)
        } else {
            // The program is run in another folder.
            std::path::absolute(&path).ok().filter(|path| can_be_run(path))
        };
        let tried = || match (source, path.components().count()) {
            ("", _) => format!("there is no `{}` on PATH", shown_path(&path)),
            (source, 1) => format!("{source} is `{}`, and nothing on PATH has that name", shown_path(&path)),
            (source, _) => format!("{source} is {}, which is no program that may be run", shown_path(&path)),
        };
        let path = found.ok_or_else(|| ExternalError::Missing { mesher, tried: tried() })?;
        Ok(Self { mesher, path, limit, cancel: cancel.within(limit) })
    }

    /// Runs the program in a folder, where its output is collected too: a pipe would fill up and block it.
    pub fn run(&self, arguments: &[&str], folder: &Path) -> Result<Ended, ExternalError> {
        let [output, errors] = ["standard-output", "standard-error"].map(|name| folder.join(name));
        let mut command = self.command();
        command.args(arguments).current_dir(folder);
        // Some read options from the user's home; and a comma in numbers would be the end of every format here.
        command.env("HOME", folder).env("GMSH_HOME", folder).env("LC_ALL", "C");
        command.stdout(File::create(&output).map_err(ExternalError::Files)?);
        command.stderr(File::create(&errors).map_err(ExternalError::Files)?);
        let failed = |source| ExternalError::Run { mesher: self.mesher, source };
        let mut running = Running(command.spawn().map_err(failed)?);
        let too_much =
            || [&output, &errors].into_iter().any(|path| path.metadata().is_ok_and(|data| data.len() > MOST_OUTPUT));
        let status = running.wait(|| self.cancel.is_due() || too_much(), &self.cancel).map_err(failed)?;
        let words = || format!("{}{}", last_lines(&output), last_lines(&errors)).trim_end().to_string();
        match status {
            Some(status) => Ok(Ended { status, words: words() }),
            None if too_much() => Err(ExternalError::Failed {
                mesher: self.mesher,
                status: "it printed more than 64 MiB and was ended".into(),
                words: words(),
            }),
            None if self.cancel.is_raised() => Err(ExternalError::Cancelled(self.mesher)),
            None => Err(ExternalError::TimedOut { mesher: self.mesher, limit: self.limit, words: words() }),
        }
    }

    /// The program behind stdbuf where there is one: Debian's TetGen aborts on every error, and what it said is lost in its
    /// buffer. The limit on processor time is for programs that this one cannot end in time.
    fn command(&self) -> Command {
        let stdbuf = search_path(Path::new("stdbuf")).filter(|_| cfg!(unix));
        let stdbuf = stdbuf.as_ref().and_then(|path| path.to_str());
        let wrapper: Vec<&str> = stdbuf.into_iter().flat_map(|stdbuf| [stdbuf, "-oL"]).collect();
        guarded(&wrapper, &self.path, Some(self.limit.as_secs().saturating_add(10)))
    }
}

/// A child that is killed and reaped, with its group, unless it has ended.
struct Running(Child);

impl Running {
    /// The status, or `None` if it was to end first.
    fn wait(&mut self, is_to_end: impl Fn() -> bool, cancel: &Cancel) -> io::Result<Option<ExitStatus>> {
        let mut pause = Duration::from_millis(1);
        loop {
            if let Some(status) = self.0.try_wait()? {
                return Ok(Some(status));
            }
            if is_to_end() {
                return Ok(None);
            }
            std::thread::sleep(cancel.time_left().map_or(pause, |left| pause.min(left)));
            // Small meshes take milliseconds, large ones minutes.
            pause = (2 * pause).min(Duration::from_millis(50));
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if matches!(self.0.try_wait(), Ok(Some(_))) {
            return;
        }
        #[cfg(unix)]
        if let Some(group) = i32::try_from(self.0.id()).ok().and_then(rustix::process::Pid::from_raw) {
            // An error means that the group is gone already.
            let _ = rustix::process::kill_process_group(group, rustix::process::Signal::KILL);
        }
        // Errors again mean that there is nothing left to end or to reap.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The first program of that name on PATH.
fn search_path(name: &Path) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path)
        // An empty part of PATH means the current folder; a program from there would be a trap, not a mesher.
        .filter(|folder| folder.is_absolute())
        .map(|folder| {
            let path = folder.join(name);
            if name.extension().is_none() { path.with_extension(std::env::consts::EXE_EXTENSION) } else { path }
        })
        .find(|path| can_be_run(path))
}

#[cfg(unix)]
fn can_be_run(path: &Path) -> bool {
    use std::os::unix::fs::PermissionsExt;
    path.metadata().is_ok_and(|data| data.is_file() && data.permissions().mode() & 0o111 != 0)
}

#[cfg(not(unix))]
fn can_be_run(path: &Path) -> bool {
    path.is_file()
}

/// The last lines of a file that say something.
fn last_lines(path: &Path) -> String {
    /// Enough for the longest explanation seen: two intersecting facets and their triangles.
    const LINES: usize = 8;
    let lines = || -> io::Result<String> {
        let mut file = File::open(path)?;
        let start = file.metadata()?.len().saturating_sub(4096);
        file.seek(SeekFrom::Start(start))?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes)?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    };
    // Words that cannot be read are as good as none; the failure itself is told all the same.
    let text = lines().unwrap_or_default();
    // TetGen times its stages and names its files, Gmsh rules lines and counts its errors.
    const NOISE: [&str; 6] = ["seconds:", "Writing ", "-----", "error summary", " warnings", "the full log"];
    let telling =
        |line: &&str| line.chars().any(char::is_alphanumeric) && !NOISE.iter().any(|noise| line.contains(noise));
    let lines: Vec<&str> = text.lines().map(str::trim_end).filter(telling).collect();
    lines[lines.len().saturating_sub(LINES)..].iter().map(|line| format!("  {}\n", line.trim_start())).collect()
}

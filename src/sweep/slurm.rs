//! Scripts that run a sweep as a job array of SLURM.

use std::path::{Path, PathBuf};

use super::SweepFolder;
use crate::mesh::io::{WriteError, write_atomically};

/// A sweep as a job array.
#[derive(Clone, Debug)]
pub struct SlurmJob {
    /// The job's name.
    pub name: String,
    /// This program.
    pub program: PathBuf,
    /// The config.
    pub config: PathBuf,
    /// Overrides of the config.
    pub overrides: Vec<String>,
    /// Number of tasks, at least 1; each takes an equal share of the cases.
    pub tasks: usize,
}

/// Writes `array.sbatch`, `merge.sbatch` and `submit.sh`, which submits the two, into the folder `slurm` of a sweep; gives
/// back the last one's path.
///
/// The paths in them are from the root, since tasks start wherever SLURM puts them.
///
/// # Errors
/// The file that could not be written.
pub fn write_slurm(job: &SlurmJob, folder: &SweepFolder) -> Result<PathBuf, WriteError> {
    let out = absolute(folder.path());
    let scripts = out.join("slurm");
    let sweep = {
        let paths = [absolute(&job.program), absolute(&job.config), out.clone()];
        let [program, config, out] = paths.map(|path| quoted(&path.to_string_lossy()));
        let overrides: String = job.overrides.iter().map(|one| format!(" --set {}", quoted(one))).collect();
        format!("{program} sweep {config} --out {out}{overrides}")
    };
    let tasks = job.tasks;
    let log = |name: &str| scripts.join(format!("{name}.log")).to_string_lossy().into_owned();
    // sbatch takes the rest of a #SBATCH line as words, as a shell would.
    let name = quoted(&format!("--job-name={}", job.name));
    let array = format!(
        "#!/bin/sh\n\
         # One share of the cases; a task that was killed and is run again goes on where it was.\n\
         #SBATCH {name}\n\
         #SBATCH --array=1-{tasks}\n\
         #SBATCH --cpus-per-task=1\n\
         #SBATCH --requeue\n\
         #SBATCH {}\n\
         exec {sweep} --shard \"$SLURM_ARRAY_TASK_ID\"/{tasks} --jobs 1 --threads \"${{SLURM_CPUS_PER_TASK:-1}}\"\n",
        quoted(&format!("--output={}", log("%a"))),
    );
    let merge = format!(
        "#!/bin/sh\n\
         # Makes the index over the cases' folders.\n\
         #SBATCH {name}\n\
         #SBATCH {}\n\
         exec {sweep} --index-only\n",
        quoted(&format!("--output={}", log("merge"))),
    );
    let submit = "#!/bin/sh\n\
        # Submits the array and, for when all its tasks have ended, the merge; prints the merge's job number.\n\
        set -eu\n\
        cd \"$(dirname \"$0\")\"\n\
        array=$(sbatch --parsable array.sbatch)\n\
        exec sbatch --parsable --dependency=\"afterany:$array\" merge.sbatch\n";
    let write = |name: &str, text: &str| -> Result<PathBuf, WriteError> {
        let path = scripts.join(name);
        write_atomically(&path, |file| file.write_all(text.as_bytes()))?;
        Ok(path)
    };
    write("array.sbatch", &array)?;
    write("merge.sbatch", &merge)?;
    write("submit.sh", submit)
}

fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.into())
}

/// A word that a shell takes as it is.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=+,:@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return word.to_string();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_survive_a_shell() {
        for word in ["plain/path.toml", "two words", "it's", "$HOME `id` \"x\" \\", ""] {
            let said = std::process::Command::new("sh").args(["-c", &format!("printf %s {}", quoted(word))]).output();
            assert_eq!(String::from_utf8(said.unwrap().stdout).unwrap(), word);
        }
    }
}

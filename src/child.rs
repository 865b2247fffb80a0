//! Programs that do not outlive this one.

use std::path::Path;
use std::process::{Command, Stdio};

/// Runs `"$@"` and ends its whole process group as soon as standard input closes, which it does when this process is gone,
/// even by a signal that nothing can catch. A program that dies of a signal is answered for by the same signal.
#[cfg(unix)]
const GUARD: &str = r#"
exec 3<&0
"$@" </dev/null 3<&- &
program=$!
{ read -r line <&3; kill -KILL 0; } >/dev/null 2>&1 &
watcher=$!
exec 3<&-
wait "$program" 2>/dev/null
status=$?
kill -KILL "$watcher" 2>/dev/null
[ "$status" -le 128 ] || kill -"$((status - 128))" $$ 2>/dev/null
exit "$status"
"#;

/// A command that runs a program (and what is put before it: `wrapper`) in a process group of its own, for at most so many
/// seconds of processor time, without core dumps. Its standard input is a pipe: while that is held the program lives.
#[cfg(unix)]
pub(crate) fn guarded(wrapper: &[&str], program: &Path, cpu_seconds: Option<u64>) -> Command {
    use std::os::unix::process::CommandExt;
    let limit = cpu_seconds.map_or("unlimited".into(), |seconds| seconds.to_string());
    let script = format!("ulimit -c 0; ulimit -t \"$0\" 2>/dev/null\n{GUARD}");
    let mut command = Command::new("/bin/sh");
    command.args(["-c", &script, &limit]).args(wrapper).arg(program);
    command.process_group(0).stdin(Stdio::piped());
    command
}

/// The program itself where there is no shell to guard it.
#[cfg(not(unix))]
pub(crate) fn guarded(_wrapper: &[&str], program: &Path, _cpu_seconds: Option<u64>) -> Command {
    let mut command = Command::new(program);
    command.stdin(Stdio::piped());
    command
}

#[cfg(all(test, unix))]
mod tests {
    use std::io::Read;

    use super::*;

    #[test]
    fn a_program_ends_when_its_pipe_closes_and_answers_for_its_signals() {
        let sh = Path::new("/bin/sh");
        // It would sleep for a day; its output closes when the last of its group is gone.
        let mut child =
            guarded(&[], sh, None).args(["-c", "sleep 86400 & sleep 86400"]).stdout(Stdio::piped()).spawn().unwrap();
        let mut output = child.stdout.take().unwrap();
        drop(child.stdin.take());
        let mut rest = Vec::new();
        output.read_to_end(&mut rest).unwrap();
        assert!(rest.is_empty() && !child.wait().unwrap().success());

        let ended = |script: &str| {
            let mut child = guarded(&[], sh, Some(10)).args(["-c", script]).spawn().unwrap();
            let held = child.stdin.take();
            let status = child.wait().unwrap();
            drop(held);
            status.to_string()
        };
        assert_eq!(ended("exit 3"), "exit status: 3");
        assert_eq!(ended("kill -ABRT $$"), "signal: 6 (SIGABRT)");
    }
}

//! The command `qcball`.

use std::process::ExitCode;

fn main() -> ExitCode {
    qcball::cli::main()
}

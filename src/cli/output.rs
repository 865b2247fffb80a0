//! What reaches the terminal.

use std::io::{self, Write};

use miette::{Diagnostic, GraphicalReportHandler, GraphicalTheme};

use super::{Ending, Failure};

/// Prints to standard output; unlike `print!`, a closed pipe is an error value and no panic.
pub(super) fn print(text: &str) -> Result<Ending, Failure> {
    let mut output = io::stdout().lock();
    output.write_all(text.as_bytes()).and_then(|()| output.flush()).map_err(Failure::Output)?;
    Ok(Ending::Done)
}

/// Tells on standard error what was done that nobody asked for.
pub(super) fn note(text: &str) {
    // Nothing is left to tell it to if standard error is closed.
    let _ = writeln!(io::stderr(), "note: {text}");
}

/// Tells on standard error of a fault that came after results were written, so that it is not a [`Failure`].
pub(super) fn fault(text: &str) {
    // Nothing is left to tell it to if standard error is closed.
    let _ = writeln!(io::stderr(), "error: {text}");
}

/// Shows a failure on standard error: a config's with its lines, any other in one paragraph.
pub(super) fn show_error(failure: &Failure) {
    let text = match failure {
        Failure::Config(error) => excerpt(error),
        other => format!("error: {other}\n"),
    };
    // Nothing is left to tell it to if standard error is closed.
    let _ = io::stderr().write_all(text.as_bytes());
}

/// The message, the lines it speaks of and the remedy; without colour, and unwrapped, so that it can be searched.
fn excerpt(error: &dyn Diagnostic) -> String {
    let mut text = String::new();
    let handler = GraphicalReportHandler::new_themed(GraphicalTheme::unicode_nocolor())
        .with_wrap_lines(false)
        .without_cause_chain();
    match handler.render_report(&mut text, error) {
        Ok(()) => format!("error: {}", text.trim_start().trim_start_matches(['×', ' '])),
        Err(_) => format!("error: {error}\n"),
    }
}

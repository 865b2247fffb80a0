//! What reaches the terminal.

use std::borrow::Cow;
use std::io::{self, Write};

use annotate_snippets::renderer::DecorStyle;
use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};

use super::{Ending, Failure};
use crate::config::ConfigError;
use crate::mesh::io::is_harmful;
use crate::report::COLUMNS;

/// The text as a terminal may show it: names from files and configs may hold anything.
fn printable(text: &str) -> Cow<'_, str> {
    let is_escaped = |c: char| is_harmful(c) && c != '\n' && c != '\t';
    if !text.contains(is_escaped) {
        return Cow::Borrowed(text);
    }
    text.chars().map(|c| if is_escaped(c) { c.escape_default().to_string() } else { c.to_string() }).collect()
}

/// The width that a summary may have: a terminal's, or what is usual elsewhere.
pub(super) fn columns() -> usize {
    let size = console::Term::stdout().size_checked();
    size.map_or(COLUMNS, |(_, columns)| usize::from(columns).min(COLUMNS))
}

/// Prints to standard output; unlike `print!`, a closed pipe is an error value and no panic.
pub(super) fn print(text: &str) -> Result<Ending, Failure> {
    let mut output = io::stdout().lock();
    output.write_all(printable(text).as_bytes()).and_then(|()| output.flush()).map_err(Failure::Output)?;
    Ok(Ending::Done)
}

/// Tells on standard error what was done that nobody asked for.
pub(super) fn note(text: &str) {
    // Nothing is left to tell it to if standard error is closed.
    let _ = writeln!(io::stderr(), "note: {}", printable(text));
}

/// Tells on standard error of a fault that came after results were written, so that it is not a [`Failure`].
pub(super) fn fault(text: &str) {
    // Nothing is left to tell it to if standard error is closed.
    let _ = writeln!(io::stderr(), "error: {}", printable(text));
}

/// Shows a failure on standard error: a config's with its lines, any other in one paragraph.
pub(super) fn show_error(failure: &Failure) {
    let text = match failure {
        Failure::Config(error) => excerpt(error),
        other => format!("error: {other}\n"),
    };
    // Nothing is left to tell it to if standard error is closed.
    let _ = io::stderr().write_all(printable(&text).as_bytes());
}

/// The message, the lines it speaks of and the remedy; without colour, and unwrapped, so that it can be searched.
fn excerpt(error: &ConfigError) -> String {
    let message = error.to_string();
    let mut report = vec![Group::with_title(Level::ERROR.primary_title(&message))];
    if let ConfigError::Content { text, span: Some(span), .. } = error {
        let lines = Snippet::source(&**text).annotation(AnnotationKind::Primary.span(span.clone()).label("here"));
        report = vec![Level::ERROR.primary_title(&message).element(lines)];
    }
    report.push(Group::with_title(Level::HELP.secondary_title(error.help())));
    format!("{}\n", Renderer::plain().decor_style(DecorStyle::Unicode).render(&report))
}

//! What can be wrong with a config, told with the file, the line, the key and a remedy.

use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::mesh::io::shown_path;

/// What is wrong with a config or with an override of it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// The operating system refused: no such file, a directory, not UTF-8.
    #[error("cannot read {}: {source}", shown_path(path))]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
        /// What to do.
        help: String,
    },
    /// The file's text is at fault.
    #[error("{}{}: {message}", shown_path(path), line.map(|l| format!(":{l}")).unwrap_or_default())]
    Content {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1, where one is to blame.
        line: Option<usize>,
        /// What is wrong.
        message: Box<str>,
        /// What to do.
        help: String,
        /// The text, for the excerpt.
        text: Box<str>,
        /// Where in the text, in bytes.
        span: Option<Range<usize>>,
    },
    /// An override is at fault, not the file.
    #[error("--set {assignment}: {message}")]
    Override {
        /// The override as typed.
        assignment: String,
        /// What is wrong.
        message: String,
        /// What to do.
        help: String,
    },
}

/// A config that can be run, as short as they come.
pub(super) const EXAMPLE: &str = "[domain]\nsolid = \"cube\"      # or: file = \"part.obj\"\ncentre = \"kernel\"";

/// What to do where there is no config.
pub(super) fn least_config() -> String {
    format!("name a surface, a mesh or a TOML file; the least that one has is\n{EXAMPLE}")
}

/// What to do with a file that does not even claim to be a config: most likely the solid itself was named.
pub(super) fn not_a_config(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    format!("a config is a TOML file; if {name} is the solid, write a config beside it:\n[domain]\nfile = {name:?}")
}

/// A fault of some key, before it is known whether the file or an override set it.
#[derive(Debug)]
pub(super) struct Fault {
    pub(super) key: Vec<String>,
    pub(super) message: String,
    pub(super) help: String,
}

impl Fault {
    pub(super) fn at(key: &[&str], message: String, help: impl Into<String>) -> Self {
        Self { key: key.iter().map(|part| part.to_string()).collect(), message, help: help.into() }
    }
}

impl ConfigError {
    /// What to do about it.
    pub fn help(&self) -> &str {
        match self {
            Self::Read { help, .. } | Self::Content { help, .. } | Self::Override { help, .. } => help,
        }
    }

    pub(super) fn content(path: &Path, text: &str, span: Option<Range<usize>>, message: String, help: String) -> Self {
        let line = span.as_ref().map(|span| 1 + text.as_bytes()[..span.start].iter().filter(|&&b| b == b'\n').count());
        Self::Content { path: path.to_path_buf(), line, message: message.into(), help, text: text.into(), span }
    }
}

/// What serde said of a key or value, in the words of a config: message and help.
pub(super) fn reworded(message: &str, key: Option<&str>) -> (String, String) {
    let schema = "`qcball schema` describes every key";
    // serde quotes the wrong name first and the known ones after it, each between backticks.
    let mut names = message.split('`').skip(1).step_by(2);
    let unknown = ["unknown field", "unknown variant"].into_iter().find(|start| message.starts_with(start));
    if let (Some(unknown), Some(wrong)) = (unknown, names.next()) {
        let mut known: Vec<&str> = names.collect();
        // The top level of a run; configs with [analytic] have a type of their own.
        if known.contains(&"domain") && known.contains(&"bounds") {
            if wrong == "analytic" {
                let what = "a config with the table [analytic] compares maps of known dilatation";
                return (what.into(), format!("`qcball run` takes it, as a file without the other tables; {schema}"));
            }
            known.push("analytic");
        }
        let nearest = known
            .iter()
            .map(|name| (strsim::damerau_levenshtein(wrong, name), *name))
            .min()
            // Half of the letters wrong is no misspelling.
            .filter(|(distance, _)| 2 * distance <= wrong.len())
            .map(|(_, name)| format!("did you mean `{name}`? "))
            .unwrap_or_default();
        let what = match (unknown, key) {
            ("unknown field", Some(key)) => format!("unknown key `{key}`"),
            ("unknown field", None) => format!("unknown key `{wrong}`"),
            (_, Some(key)) => format!("`{key}` cannot be `{wrong}`"),
            (_, None) => format!("unknown value `{wrong}`"),
        };
        return (what, format!("{nearest}known here: {}; {schema}", known.join(", ")));
    }
    let plain = message
        .replace("expected i64", "expected a whole number")
        .replace("expected f64", "expected a number")
        .replace("wanted string or table", "expected a word between quotes")
        .replace("a sequence", "a list");
    let what = key.map_or(plain.clone(), |key| format!("`{key}`: {plain}"));
    (what, schema.to_string())
}

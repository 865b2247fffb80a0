//! The text of a config with the overrides of the command line, and the way back from a key to its place.

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use toml::de::{DeTable, DeValue};

use super::Config;
use super::error::{ConfigError, Fault, least_config, not_a_config, reworded};

/// A config file as read, with the overrides that were applied to it.
#[derive(Clone, Debug)]
pub struct ConfigSource {
    path: PathBuf,
    text: String,
    overrides: Vec<Override>,
    merged: toml::Table,
}

#[derive(Clone, Debug)]
struct Override {
    typed: String,
    key: Vec<String>,
}

impl ConfigSource {
    /// Reads a config and applies overrides of the form `key.path=value`, the value in TOML or else a string.
    ///
    /// # Errors
    /// A fault of the file, which must hold known keys and right types by itself, or of the first override that brings
    /// in a wrong key or type.
    pub fn read(path: &Path, overrides: &[String]) -> Result<(Self, Config), ConfigError> {
        let text = fs::read_to_string(path).map_err(|source| {
            let help = if is_toml(path) || !path.is_file() { least_config() } else { not_a_config(path) };
            ConfigError::Read { path: path.to_path_buf(), source, help }
        })?;
        Self::of_text(path, text, overrides)
    }

    /// The same of a text that is at hand; `path` only names it.
    ///
    /// # Errors
    /// As [`ConfigSource::read`].
    pub fn of_text(path: &Path, text: String, overrides: &[String]) -> Result<(Self, Config), ConfigError> {
        let fault = |error: toml::de::Error| {
            let span = error.span();
            let key = span.as_ref().and_then(|span| key_at(&text, span));
            let (message, help) = reworded(error.message(), key.as_deref());
            let help = if is_toml(path) { help } else { not_a_config(path) };
            ConfigError::content(path, &text, span, message, help)
        };
        let mut config: Config = toml::from_str(&text).map_err(fault)?;
        let merged: toml::Table = toml::from_str(&text).map_err(fault)?;
        let mut source = Self { path: path.to_path_buf(), text, overrides: Vec::new(), merged };
        for typed in overrides {
            config = source.apply(typed)?;
        }
        Ok((source, config))
    }

    /// The file's path as it was given.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The file's text.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The overrides as typed.
    pub fn overrides(&self) -> impl Iterator<Item = &str> {
        self.overrides.iter().map(|one| one.typed.as_str())
    }

    /// Whether the file or an override gives a key or table of the top level.
    pub(super) fn has(&self, key: &str) -> bool {
        self.merged.contains_key(key)
    }

    /// A hash of the merged keys and values, whatever their order and layout in the file; without `threads`, on which
    /// no result depends.
    pub fn hash(&self) -> String {
        let mut table = self.merged.clone();
        table.remove("threads");
        // The value sorts its keys, and validation has refused the infinities that JSON lacks.
        let canonical = serde_json::json!(table).to_string();
        blake3::hash(canonical.as_bytes()).to_hex().to_string()
    }

    fn apply(&mut self, typed: &str) -> Result<Config, ConfigError> {
        let fault = |message: String, help: String| ConfigError::Override { assignment: typed.into(), message, help };
        let form = || "write --set key.path=value, for example --set mesh.layers=4".to_string();
        let (key, value) =
            typed.split_once('=').ok_or_else(|| fault("there is no `=` between key and value".into(), form()))?;
        let key: Vec<String> = key.split('.').map(|part| part.trim().to_string()).collect();
        if key.iter().any(String::is_empty) {
            return Err(fault("a part of the key is empty".into(), form()));
        }
        let (last, tables) = key.split_last().expect("splitting gives at least one part");
        let mut table = &mut self.merged;
        for name in tables {
            table = table
                .entry(name)
                .or_insert_with(|| toml::Value::Table(toml::Table::new()))
                .as_table_mut()
                .ok_or_else(|| fault(format!("`{name}` is a value, not a table with keys"), form()))?;
        }
        table.insert(last.clone(), value_of(value));
        let config = Config::deserialize(toml::Value::Table(self.merged.clone())).map_err(|error| {
            let (message, help) = reworded(error.message(), Some(&key.join(".")));
            fault(message, help)
        })?;
        self.overrides.push(Override { typed: typed.into(), key });
        Ok(config)
    }

    /// Says a fault of a key where the key was last set: in an override, or at its line in the file.
    pub(super) fn error(&self, fault: Fault) -> ConfigError {
        let Fault { key, message, help } = fault;
        match self.overrides.iter().rev().find(|one| key.starts_with(&one.key.iter().map(|k| &**k).collect::<Vec<_>>()))
        {
            Some(one) => ConfigError::Override { assignment: one.typed.clone(), message, help },
            None => ConfigError::content(&self.path, &self.text, span_of(&self.text, &key), message, help),
        }
    }
}

/// Whether a file means to be a config.
fn is_toml(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml"))
}

/// What stands after the `=` of an override: TOML if it is, else a string, so that quotes may be left out.
fn value_of(text: &str) -> toml::Value {
    toml::from_str::<toml::Table>(&format!("value = {text}"))
        .ok()
        // A line break could smuggle in more keys.
        .filter(|table| table.len() == 1)
        .and_then(|mut table| table.remove("value"))
        .unwrap_or_else(|| toml::Value::String(text.trim().to_string()))
}

/// Where the deepest part of the key that the text has stands.
fn span_of(text: &str, key: &[&str]) -> Option<Range<usize>> {
    let parsed = DeTable::parse(text).ok()?;
    let mut table = parsed.get_ref();
    let mut span = None;
    for part in key {
        let Some((name, value)) = table.iter().find(|(name, _)| name.get_ref() == part) else { break };
        span = Some(name.span());
        match value.get_ref() {
            DeValue::Table(inner) => table = inner,
            // The key and its value, so that the excerpt underlines both.
            _ => span = Some(name.span().start..value.span().end),
        }
    }
    span
}

/// The dotted key at whose name or value a fault lies.
fn key_at(text: &str, fault: &Range<usize>) -> Option<String> {
    fn search(table: &DeTable, fault: &Range<usize>, prefix: &str) -> Option<String> {
        table.iter().find_map(|(name, value)| {
            let key = format!("{prefix}{}", name.get_ref());
            let holds = |span: Range<usize>| span.start <= fault.start && fault.end <= span.end;
            match value.get_ref() {
                // A table's own span may cover its header only, or all of it: look inside first.
                DeValue::Table(inner) => search(inner, fault, &format!("{key}.")),
                _ => None,
            }
            .or_else(|| (holds(name.span()) || holds(value.span())).then_some(key))
        })
    }
    search(DeTable::parse(text).ok()?.get_ref(), fault, "")
}

//! The text of a config with the overrides of the command line, and the way back from a key to its place.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use toml::de::{DeTable, DeValue};

use super::Config;
use super::error::{ConfigError, Fault, least_config, not_a_config, reworded};
use crate::mesh::io::{SurfaceFormat, TetFormat};

/// What stands for standard input in the place of a file's name.
pub(super) const STANDARD_INPUT: &str = "-";

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
    /// Where the file asks for it; `None` for those of the command line.
    place: Option<Vec<String>>,
}

/// One key of one case of a sweep, and its value there.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// The key's parts.
    pub(super) key: Vec<String>,
    /// The value.
    pub value: toml::Value,
    /// The key of the config under which the sweep names it.
    pub(super) place: Vec<String>,
}

impl Setting {
    /// The key, its parts joined by dots.
    pub fn key(&self) -> String {
        self.key.join(".")
    }
}

/// `key=value` as `--set` takes it.
impl std::fmt::Display for Setting {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let value = match &self.value {
            toml::Value::String(text) if value_of(text) == self.value => text.clone(),
            other => other.to_string(),
        };
        write!(formatter, "{}={value}", self.key())
    }
}

impl ConfigSource {
    /// Reads a config, from standard input for `-`, and applies overrides of the form `key.path=value`, the value in TOML or else a string.
    ///
    /// # Errors
    /// A fault of the file, which must hold known keys and right types by itself, or of the first override that brings
    /// in a wrong key or type.
    pub fn read(path: &Path, overrides: &[String]) -> Result<(Self, Config), ConfigError> {
        Self::of_text(path, text_of(path)?, overrides)
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
        if let Some((name, span)) = listed_table(&text) {
            let help = format!("write [{name}], not [[{name}]]");
            return Err(ConfigError::content(path, &text, Some(span), is_listed(name), help));
        }
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

    /// The same config with the settings of a case of its sweep.
    ///
    /// # Errors
    /// A wrong key or type, at its place in the table `[sweep]`.
    pub(super) fn with_settings(&self, settings: &[Setting]) -> Result<(Self, Config), ConfigError> {
        let mut source = self.clone();
        let mut config = Config::default();
        for setting in settings {
            let one =
                Override { typed: setting.to_string(), key: setting.key.clone(), place: Some(setting.place.clone()) };
            config = source.insert(one, setting.value.clone())?;
        }
        Ok((source, config))
    }

    /// The override of the command line that sets a key, a part of it or a table it stands in, if one does.
    pub(super) fn override_of(&self, key: &[String]) -> Option<&str> {
        let overlaps = |one: &&Override| key.starts_with(&one.key) || one.key.starts_with(key);
        self.overrides.iter().find(overlaps).map(|one| one.typed.as_str())
    }

    /// How far into the file a key stands; `None` where it does not.
    pub(super) fn position_of(&self, key: &[String]) -> Option<usize> {
        span_of(&self.text, key).map(|span| span.start)
    }

    /// A hash of the merged keys and values, whatever their order and layout in the file; without `threads`, on which
    /// no result depends, and `sweep`, whose cases have their settings merged in.
    pub fn hash(&self) -> String {
        let mut table = self.merged.clone();
        table.remove("threads");
        table.remove("sweep");
        // The value sorts its keys, and validation has refused the infinities that JSON lacks.
        let canonical = serde_json::json!(table).to_string();
        blake3::hash(canonical.as_bytes()).to_hex().to_string()
    }

    /// The merged keys, their parts joined by dots, and their values in TOML; without `name` and `sweep`.
    pub fn settings(&self) -> BTreeMap<String, String> {
        fn flatten(prefix: &str, table: &toml::Table, into: &mut BTreeMap<String, String>) {
            for (key, value) in table {
                match value.as_table() {
                    Some(inner) => flatten(&format!("{prefix}{key}."), inner, into),
                    None => drop(into.insert(format!("{prefix}{key}"), value.to_string())),
                }
            }
        }
        let mut table = self.merged.clone();
        table.remove("name");
        table.remove("sweep");
        let mut settings = BTreeMap::new();
        flatten("", &table, &mut settings);
        settings
    }

    fn apply(&mut self, typed: &str) -> Result<Config, ConfigError> {
        let refused = |message: String, help: String| ConfigError::Override { assignment: typed.into(), message, help };
        let form = || "write --set key.path=value, for example --set mesh.layers=4".to_string();
        let (key, value) =
            typed.split_once('=').ok_or_else(|| refused("there is no `=` between key and value".into(), form()))?;
        let key: Vec<String> = key.split('.').map(|part| part.trim().to_string()).collect();
        if key.iter().any(String::is_empty) {
            return Err(refused("a part of the key is empty".into(), form()));
        }
        let key = self.spelled(key);
        self.insert(Override { typed: typed.into(), key, place: None }, value_of(value))
    }

    /// A key, one that a sweep varies in the spelling of the file, which may have it whole between quotes.
    fn spelled(&self, key: Vec<String>) -> Vec<String> {
        let [sweep, axes, varied @ ..] = &key[..] else { return key };
        let whole = varied.join(".");
        let table = self.merged.get(sweep).filter(|_| sweep == "sweep").and_then(|sweep| sweep.get(axes)?.as_table());
        if table.is_some_and(|table| table.contains_key(&whole)) {
            vec![sweep.clone(), axes.clone(), whole]
        } else {
            key
        }
    }

    /// Sets a key; the config is then checked for known keys and right types.
    fn insert(&mut self, one: Override, value: toml::Value) -> Result<Config, ConfigError> {
        let (last, tables) = one.key.split_last().expect("a key has at least one part");
        let mut table = &mut self.merged;
        for name in tables {
            table =
                table.entry(name).or_insert_with(|| toml::Value::Table(toml::Table::new())).as_table_mut().ok_or_else(
                    || {
                        let message = format!("`{name}` is a value, not a table with keys");
                        one.fault(
                            &self.path,
                            &self.text,
                            message,
                            "name a key of the config, for example mesh.layers".into(),
                        )
                    },
                )?;
        }
        if let ([], Some(name), true) = (tables, table_named(last), value.is_array()) {
            let help = format!("name a key of the table, {name}.KEY, or write {name}={{KEY=VALUE}}");
            return Err(one.fault(&self.path, &self.text, is_listed(name), help));
        }
        table.insert(last.clone(), value);
        let config = Config::deserialize(toml::Value::Table(self.merged.clone())).map_err(|error| {
            let (message, help) = reworded(error.message(), Some(&one.key.join(".")));
            one.fault(&self.path, &self.text, message, help)
        })?;
        self.overrides.push(one);
        Ok(config)
    }

    /// Says a fault of a key where the key was last set: in an override, or at its line in the file.
    pub(super) fn error(&self, fault: Fault) -> ConfigError {
        let Fault { key, message, help } = fault;
        match self.overrides.iter().rev().find(|one| key.starts_with(&one.key)) {
            Some(one) => one.fault(&self.path, &self.text, message, help),
            None => ConfigError::content(&self.path, &self.text, span_of(&self.text, &key), message, help),
        }
    }
}

impl Override {
    /// A fault of this key: in the command line or, for a case of a sweep, at its place in the file.
    fn fault(&self, path: &Path, text: &str, message: String, help: String) -> ConfigError {
        match &self.place {
            None => ConfigError::Override { assignment: self.typed.clone(), message, help },
            Some(place) => ConfigError::content(path, text, span_of(text, place), message, help),
        }
    }
}

/// The text of the config that a path stands for: the file's, that of standard input for `-`, and for a file that holds a solid
/// the least config, which names it.
pub(super) fn text_of(path: &Path) -> Result<String, ConfigError> {
    let name = path.file_name().and_then(|name| name.to_str());
    let text = match name {
        Some(STANDARD_INPUT) => io::read_to_string(io::stdin()),
        Some(name) if path.is_file() && holds_a_solid(path) => Ok(toml::Table::from_iter([(
            "domain".into(),
            toml::Table::from_iter([("file".into(), name.into())]).into(),
        )])
        .to_string()),
        _ => fs::read_to_string(path),
    };
    text.map_err(|source| {
        let help = if is_toml(path) || !path.is_file() { least_config() } else { not_a_config(path) };
        ConfigError::Read { path: path.to_path_buf(), source, help }
    })
}

fn holds_a_solid(path: &Path) -> bool {
    SurfaceFormat::of(path).is_some() || TetFormat::of(path).is_some()
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

/// The table of a config that has this name.
fn table_named(name: &str) -> Option<&'static str> {
    const TABLES: [&str; 8] = ["domain", "mesh", "map", "boundary", "optimize", "refine", "bounds", "sweep"];
    TABLES.into_iter().find(|table| name == *table)
}

fn is_listed(name: &str) -> String {
    format!("`{name}` is a list, where the table [{name}] is expected")
}

/// A table of a config that stands as a list of such, which serde would take for the values of its keys in a row.
fn listed_table(text: &str) -> Option<(&'static str, Range<usize>)> {
    let parsed = DeTable::parse(text).ok()?;
    parsed.get_ref().iter().find_map(|(name, value)| {
        let table = table_named(name.get_ref())?;
        matches!(value.get_ref(), DeValue::Array(_)).then(|| (table, name.span()))
    })
}

/// Where the deepest part of the key that the text has stands.
fn span_of(text: &str, key: &[String]) -> Option<Range<usize>> {
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
pub(super) fn key_at(text: &str, fault: &Range<usize>) -> Option<String> {
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

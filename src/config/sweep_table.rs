//! The table `[sweep]` as typed.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::Deserialize;

/// The table `[sweep]`: the cases of `qcball sweep`. At least one key must be varied.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "the table [sweep]")]
pub struct SweepTable {
    /// The surface and mesh files to be mapped one after the other: a pattern such as "parts/*.stl", relative to the config file. They
    /// vary slowest of all.
    pub files: Option<String>,
    /// Keys of this file with the values they take, e.g. "map.exponent" = [0.5, 1, 2] or "mesh.layers" = { from = 2, to =
    /// 8, step = 2 }: every value of one with every value of the others. The last key varies fastest.
    #[schemars(with = "BTreeMap<String, Axis>")]
    pub grid: toml::Table,
    /// The same, but the keys of this table go together: their first values, then their second ones and so on.
    #[schemars(with = "BTreeMap<String, Axis>")]
    pub zip: toml::Table,
    /// The cases to leave out: each entry holds keys that are varied, with a value or a list of them, and leaves out the
    /// cases that agree with all its keys.
    #[schemars(with = "Vec<BTreeMap<String, serde_json::Value>>")]
    pub exclude: Vec<toml::Table>,
    /// Seeds of the random solids: a list or range, or how many, counted from 0. They vary fastest of all.
    #[schemars(with = "Option<Seeds>")]
    pub seeds: Option<toml::Value>,
}

/// The values that a sweep gives to a key.
#[derive(Clone, Debug, JsonSchema)]
#[serde(untagged)]
pub enum Axis {
    /// One after the other.
    List(#[schemars(with = "Vec<serde_json::Value>")] Vec<toml::Value>),
    /// Equally spaced.
    Range(RangeTable),
}

/// The value of `sweep.seeds`.
#[derive(Clone, Debug, JsonSchema)]
#[serde(untagged)]
pub enum Seeds {
    /// The seeds 0, 1 and so on.
    Count(#[schemars(range(min = 1))] i64),
    /// These.
    Axis(Axis),
}

/// Equally spaced values, rounded to 12 significant digits: exactly one of `step` and `steps` must be given.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RangeTable {
    /// The first value.
    pub from: Number,
    /// The last one, or what no value goes beyond.
    pub to: Number,
    /// The distance between neighbours; negative if `to` is less than `from`.
    pub step: Option<Number>,
    /// The number of values, `from` and `to` included.
    #[schemars(range(min = 1))]
    pub steps: Option<i64>,
}

/// A number of a range. The values are whole where all numbers given are and none falls between.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected a number")]
pub enum Number {
    /// Without a decimal point.
    Whole(i64),
    /// With one.
    Real(f64),
}

//! What `qcball run` is asked for: a map, or maps of known dilatation compared.

use std::path::Path;

use super::source::text_of;
use super::{AnalyticPlan, ConfigError, ConfigSource, Plan};

/// What a config asks for.
#[derive(Clone, Debug)]
pub enum Task {
    /// A map of a solid.
    Map(Box<Plan>),
    /// A comparison, by the table `[analytic]`, which takes no overrides.
    Compare(AnalyticPlan),
}

impl Task {
    /// Reads a config, from standard input for `-`, or takes the least one of a surface or mesh file, and applies the overrides.
    ///
    /// # Errors
    /// As [`Plan::read`] and [`AnalyticPlan::read`].
    pub fn read(path: &Path, overrides: &[String]) -> Result<Self, ConfigError> {
        let text = text_of(path)?;
        if let Some(plan) = AnalyticPlan::of_text(path, &text)? {
            return Ok(Self::Compare(plan));
        }
        let (source, config) = ConfigSource::of_text(path, text, overrides)?;
        Plan::of_source(&source, &config).map(|plan| Self::Map(Box::new(plan)))
    }
}

//! Configs of which only the settings of the optimisation count.

use std::path::Path;

use super::error::{ConfigError, Fault};
use super::limits::whole;
use super::{Config, ConfigSource, CornersName, CornersValue, ObjectiveName, plan, refine};
use crate::map::CornerChoice;
use crate::optimize::OptimizeSettings;
use crate::refine::RefineSettings;

/// How a folder of meshes is optimised.
#[derive(Clone, Debug)]
pub struct BenchPlan {
    /// The config it was made from.
    pub source: ConfigSource,
    /// Number of threads of each optimisation.
    pub threads: usize,
}

impl BenchPlan {
    /// Reads a config that has `threads` (1 if it is left out) and the table `[optimize]` at most.
    ///
    /// # Errors
    /// The first fault, with the file, line and key to blame, and what to do.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let (source, config) = ConfigSource::read(path, &[])?;
        let made = || -> Result<usize, Fault> {
            for key in ["name", "seed", "domain", "mesh", "map", "refine", "sweep", "bounds"] {
                if source.has(key) {
                    let message = format!("`{key}` speaks of one run, but a bench takes the meshes of a folder");
                    return Err(Fault::at(&[key], message, "keep `threads` and the table [optimize] only"));
                }
            }
            of_given_maps(&config)?;
            whole(config.threads, 1, 0..=1024, &["threads"])
        };
        match made() {
            Ok(threads) => Ok(Self { source, threads }),
            Err(fault) => Err(source.error(fault)),
        }
    }
}

/// The settings in the tables `[optimize]`, `[boundary]` and `[refine]` of a config, whatever else it has; `kept_by`: the option with which
/// a mesh cannot be refined, if there is one.
///
/// # Errors
/// The first fault, with the file, line and key to blame, and what to do.
pub fn optimize_settings(
    path: &Path,
    kept_by: Option<&str>,
) -> Result<(OptimizeSettings, Option<RefineSettings>), ConfigError> {
    let (source, config) = ConfigSource::read(path, &[])?;
    let made = || {
        if let Some((key, option)) = config.refine.asked_by().zip(kept_by) {
            let message = format!("`{}` asks for refinement, with which {option} does not go", key.join("."));
            return Err(Fault::at(&key, message, "leave out the one or the other"));
        }
        Ok((of_given_maps(&config)?, refine::plan(&config, None, &CornerChoice::Linear)?))
    };
    made().map_err(|fault| source.error(fault))
}

/// The settings that a map without a solid behind it can be optimized with.
fn of_given_maps(config: &Config) -> Result<OptimizeSettings, Fault> {
    let (optimize, boundary) = (&config.optimize, &config.boundary);
    let asked = [
        (["optimize", "symmetric"], optimize.symmetric),
        (["optimize", "objective"], optimize.objective == ObjectiveName::Ball),
        (["boundary", "corners"], !matches!(boundary.corners, None | Some(CornersValue::Named(CornersName::Linear)))),
        (["boundary", "corner_vertices"], boundary.corner_vertices.is_some()),
        (["boundary", "collar"], boundary.collar != 0.0),
    ];
    let Some((key, _)) = asked.into_iter().find(|(_, is_asked)| *is_asked) else { return plan::optimize(config) };
    let message = format!("`{}` is for `qcball run`, which reads the map from the solid's own config", key.join("."));
    Err(Fault::at(&key, message, "remove the key, or write a config with the solid"))
}

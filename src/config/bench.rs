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

/// What a config says of the optimization of a map that is there.
#[derive(Clone, Debug)]
pub struct GivenMapSettings {
    /// Its tables `[optimize]` and `[boundary]`.
    pub optimize: OptimizeSettings,
    /// Its table `[refine]`.
    pub refine: Option<RefineSettings>,
    /// What else it has that a run would heed.
    pub idle: Vec<&'static str>,
}

/// The settings in the tables `[optimize]`, `[boundary]` and `[refine]` of a config, whatever else it has; `kept_by`: the option with which
/// a mesh cannot be refined, if there is one.
///
/// # Errors
/// The first fault, with the file, line and key to blame, and what to do.
pub fn optimize_settings(path: &Path, kept_by: Option<&str>) -> Result<GivenMapSettings, ConfigError> {
    /// All but the seed and the name, which change nothing for a solid of a file.
    const OF_RUNS: [(&str, &str); 6] = [
        ("threads", "threads"),
        ("domain", "[domain]"),
        ("mesh", "[mesh]"),
        ("map", "[map]"),
        ("bounds", "[bounds]"),
        ("sweep", "[sweep]"),
    ];
    let (source, config) = ConfigSource::read(path, &[])?;
    let idle = OF_RUNS.into_iter().filter(|(key, _)| source.has(key)).map(|(_, words)| words).collect();
    let made = || {
        if let Some((key, option)) = config.refine.asked_by().zip(kept_by) {
            let message = format!("`{}` asks for refinement, with which {option} does not go", key.join("."));
            return Err(Fault::at(&key, message, "leave out the one or the other"));
        }
        let refine = refine::plan(&config, None, &CornerChoice::Linear)?;
        Ok(GivenMapSettings { optimize: of_given_maps(&config)?, refine, idle })
    };
    made().map_err(|fault| source.error(fault))
}

/// The settings that a map without a solid behind it can be optimized with.
fn of_given_maps(config: &Config) -> Result<OptimizeSettings, Fault> {
    let (optimize, boundary) = (&config.optimize, &config.boundary);
    let powers = !matches!(boundary.corners, None | Some(CornersValue::Named(CornersName::Linear)));
    // Each with what it needs and what is done instead.
    let asked = [
        (
            ["optimize", "symmetric"],
            optimize.symmetric,
            "looks for a map that mirrors the solid about its star centre, and of two meshes no star centre is known",
            "remove it",
        ),
        (
            ["optimize", "objective"],
            optimize.objective == ObjectiveName::Ball,
            "= \"ball\" looks for a map onto the whole ball, and the map of two meshes may have any image; K onto the ball is told where there \
             is one",
            "take \"max\"",
        ),
        (
            ["boundary", "corners"],
            powers,
            "makes maps that are powers at corners, which no file of positions alone can hold",
            "take \"linear\"",
        ),
        (
            ["boundary", "corner_vertices"],
            boundary.corner_vertices.is_some(),
            "names corners for maps that are powers there, which no file of positions alone can hold",
            "remove it",
        ),
        (
            ["boundary", "collar"],
            boundary.collar != 0.0,
            "splits tets before there is a map, and this map is there",
            "remove it",
        ),
    ];
    let Some((key, _, why, instead)) = asked.into_iter().find(|(_, is_asked, ..)| *is_asked) else {
        return plan::optimize(config);
    };
    let help = format!("{instead}, or have the solid mapped by `qcball run`: domain.file = the mesh of the domain");
    Err(Fault::at(&key, format!("`{}` {why}", key.join(".")), help))
}

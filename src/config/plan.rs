//! What a config means: checked, with paths resolved and choices as types.

use std::path::{Component, Path, PathBuf};
use std::time::Duration;

use super::error::{ConfigError, EXAMPLE, Fault};
use super::limits::{between, positive, whole};
use super::solid::{self, Solid};
use super::{CentreName, CentreValue, Config, ConfigSource, Engine, MapKind, MeshKind, MeshTable, ObjectiveName};

/// A run that can be started.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Name of the run.
    pub name: String,
    /// The config it was made from.
    pub source: ConfigSource,
    /// Seed of the random solids.
    pub seed: u64,
    /// Number of threads; `None` for all cores.
    pub threads: Option<usize>,
    /// What is mapped.
    pub domain: DomainSource,
    /// Its star centre.
    pub centre: Centre,
    /// How it is filled with tets.
    pub mesh: MeshPlan,
    /// The map to start from.
    pub map: InitialMap,
    /// How the map is improved.
    pub optimize: OptimizePlan,
}

/// Where the domain comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum DomainSource {
    /// A built-in solid.
    Solid(Solid),
    /// A file that was there when the config was read.
    File(PathBuf),
}

/// How the star centre is found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Centre {
    /// A deep point of the kernel.
    Kernel,
    /// The centre of mass.
    Centroid,
    /// The middle of the bounding box.
    BoundingBox,
    /// The star centre whose radial map has the least K.
    Optimize,
    /// This point.
    At([f64; 3]),
}

/// A shell mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshPlan {
    /// How finely the surface is split.
    pub fineness: Fineness,
    /// Number of layers, >= 1.
    pub layers: usize,
    /// Ratio of the thicknesses of successive layers outward, > 0.
    pub grading: f64,
}

/// How finely the surface of a shell mesh is split.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fineness {
    /// Each triangle into the square of this number, >= 1.
    Subdivisions(usize),
    /// Until no edge is longer than this, in the solid's own units.
    EdgeLength(f64),
    /// Until there are at least this many tets.
    Cells(usize),
}

/// The map to start from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum InitialMap {
    /// Caraman's radial map, with radii t^exponent.
    Radial {
        /// > 0; 1 maps rays linearly.
        exponent: f64,
    },
}

/// How the map is improved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OptimizePlan {
    /// What is made small.
    pub objective: Objective,
    /// The method.
    pub engine: Engine,
    /// Relative decrease a step below which a phase ends, in `[0, 1)`.
    pub tolerance: f64,
    /// Most iterations over all phases.
    pub max_iterations: usize,
    /// Most time, if limited.
    pub time_limit: Option<Duration>,
}

/// What is made small.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Objective {
    /// The largest K.
    Max {
        /// The last exponent of the continuation, if not the built-in one.
        last_exponent: Option<f64>,
    },
    /// One soft maximum.
    SoftMax {
        /// Its exponent, > 0.
        exponent: f64,
    },
}

impl Plan {
    /// Reads a config, applies the overrides `key.path=value` and checks what they mean together.
    ///
    /// # Errors
    /// The first fault, with the file, line and key or the override to blame, and what to do.
    pub fn read(path: &Path, overrides: &[String]) -> Result<Self, ConfigError> {
        let (source, config) = ConfigSource::read(path, overrides)?;
        Self::new(&source, &config).map_err(|fault| source.error(fault))
    }

    fn new(source: &ConfigSource, config: &Config) -> Result<Self, Fault> {
        Ok(Self {
            name: name(source.path(), config)?,
            source: source.clone(),
            seed: whole(Some(config.seed), 0, 0..=i64::MAX, &["seed"])? as u64,
            threads: Some(whole(config.threads, 0, 0..=1024, &["threads"])?).filter(|&threads| threads > 0),
            domain: domain(source.path(), config)?,
            centre: centre(config)?,
            mesh: mesh(&config.mesh)?,
            map: match config.map.kind {
                MapKind::Radial => {
                    InitialMap::Radial { exponent: positive(config.map.exponent, 1.0, &["map", "exponent"])? }
                }
            },
            optimize: optimize(config)?,
        })
    }
}

fn name(config_path: &Path, config: &Config) -> Result<String, Fault> {
    let stem = || config_path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let name = config.name.clone().unwrap_or_else(stem);
    // The name becomes a folder below results/, and must not lead out of it.
    let mut parts = Path::new(&name).components();
    match (parts.next(), parts.next()) {
        (Some(Component::Normal(only)), None) if only == name.as_str() && !name.contains(['\\', '\0']) => Ok(name),
        _ => Err(Fault::at(
            &["name"],
            format!("the name {name:?} cannot be the name of a folder"),
            "give a name without slashes, for example name = \"cube-fine\"",
        )),
    }
}

fn domain(config_path: &Path, config: &Config) -> Result<DomainSource, Fault> {
    let domain = &config.domain;
    let source = match (domain.solid, &domain.file) {
        (Some(_), Some(_)) => {
            let message = "both `solid` and `file` are given".to_string();
            return Err(Fault::at(&["domain", "file"], message, "keep one of them"));
        }
        (None, None) => {
            let message = "no solid is given: [domain] needs exactly one of `solid` and `file`".to_string();
            return Err(Fault::at(&["domain"], message, format!("the least a config has is\n{EXAMPLE}")));
        }
        (Some(name), None) => DomainSource::Solid(solid::build(name, config)?),
        (None, Some(file)) => {
            let path = config_path.parent().unwrap_or(Path::new("")).join(file);
            if !path.is_file() {
                let why = if path.exists() { "is not a file" } else { "does not exist" };
                let message = format!("the file {} {why}", path.display());
                return Err(Fault::at(&["domain", "file"], message, "paths are relative to the config file"));
            }
            DomainSource::File(path)
        }
    };
    solid::check_parameters(domain)?;
    Ok(source)
}

fn centre(config: &Config) -> Result<Centre, Fault> {
    Ok(match &config.domain.centre {
        None | Some(CentreValue::Named(CentreName::Kernel)) => Centre::Kernel,
        Some(CentreValue::Named(CentreName::Centroid)) => Centre::Centroid,
        Some(CentreValue::Named(CentreName::Bbox)) => Centre::BoundingBox,
        Some(CentreValue::Named(CentreName::Optimize)) => Centre::Optimize,
        Some(CentreValue::At(point)) if point.iter().all(|x| x.is_finite()) => Centre::At(*point),
        Some(CentreValue::At(point)) => {
            let message = format!("the centre {point:?} is not finite");
            return Err(Fault::at(&["domain", "centre"], message, "give three finite coordinates"));
        }
    })
}

fn mesh(table: &MeshTable) -> Result<MeshPlan, Fault> {
    let MeshKind::Shell = table.kind;
    let given = [
        ("subdivisions", table.subdivisions.is_some()),
        ("edge_length", table.edge_length.is_some()),
        ("cells", table.cells.is_some()),
    ];
    let mut given = given.into_iter().filter(|(_, given)| *given).map(|(key, _)| key);
    if let (Some(first), Some(second)) = (given.next(), given.next()) {
        let message = format!("`{first}` and `{second}` both say how fine the mesh is");
        return Err(Fault::at(&["mesh", second], message, "keep one of them"));
    }
    let fineness = if table.edge_length.is_some() {
        Fineness::EdgeLength(positive(table.edge_length, 1.0, &["mesh", "edge_length"])?)
    } else if table.cells.is_some() {
        Fineness::Cells(whole(table.cells, 1, 1..=100_000_000, &["mesh", "cells"])?)
    } else {
        Fineness::Subdivisions(whole(table.subdivisions, 1, 1..=1000, &["mesh", "subdivisions"])?)
    };
    Ok(MeshPlan {
        fineness,
        layers: whole(table.layers, 8, 1..=10_000, &["mesh", "layers"])?,
        grading: positive(table.grading, 1.0, &["mesh", "grading"])?,
    })
}

fn optimize(config: &Config) -> Result<OptimizePlan, Fault> {
    /// Some thirty years: longer than any run, and far from the largest `Duration`.
    const LONGEST: f64 = 1e9;
    let table = &config.optimize;
    let key = ["optimize", "exponent"];
    let exponent = table.exponent.map(|given| positive(Some(given), 48.0, &key)).transpose()?;
    let objective = match (table.objective, exponent) {
        (ObjectiveName::Max, last_exponent) => Objective::Max { last_exponent },
        (ObjectiveName::SoftMax, Some(exponent)) => Objective::SoftMax { exponent },
        (ObjectiveName::SoftMax, None) => {
            let message = "the objective \"soft-max\" needs an `exponent`".to_string();
            return Err(Fault::at(&["optimize", "objective"], message, "add for example exponent = 48"));
        }
    };
    let seconds =
        table.time_limit.map(|given| positive(Some(given), 600.0, &["optimize", "time_limit"])).transpose()?;
    Ok(OptimizePlan {
        objective,
        engine: table.engine,
        tolerance: between(table.tolerance, 2e-4, 0.0..1.0, &["optimize", "tolerance"])?,
        max_iterations: whole(table.max_iterations, 500, 0..=1_000_000_000, &["optimize", "max_iterations"])?,
        time_limit: seconds.map(|seconds| Duration::from_secs_f64(seconds.min(LONGEST))),
    })
}

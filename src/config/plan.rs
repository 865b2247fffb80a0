//! What a config means: checked, with paths resolved and choices as types.

use std::path::{Component, Path, PathBuf};
use std::time::Duration;

use super::boundary;
use super::error::{ConfigError, EXAMPLE, Fault};
use super::limits::{duration, positive, whole};
use super::map::{self, InitialMap};
use super::mesh::{self, MeshPlan};
use super::source::STANDARD_INPUT;
use super::{Config, ConfigSource, DomainTable, MapKind, ObjectiveName, OptimizeTable, PolishName, refine, solid};
use crate::bound::certificate::DEFAULT_TIME_LIMIT;
use crate::map::CornerChoice;
use crate::mesh::io::{ReadError, SolidFile, SurfaceFormat, TetFormat, read_solid, shown_path};
use crate::mesh::{Unit, VertexId};
use crate::optimize::{Objective, OptimizeSettings, Polish};
use crate::refine::RefineSettings;
use crate::solid::{CentreChoice, ExternalSettings, Refinement, RepairSettings, ShellSettings, Solid};

/// The largest exponent of a soft maximum: with larger ones its terms are too far apart for the sum to have any but the largest.
const MOST_EXPONENT: f64 = 1e6;

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
    /// What may be done to a surface file.
    pub repair: RepairSettings,
    /// Whether a given mesh keeps its connectivity, locked tets included.
    pub keep_mesh: bool,
    /// Its star centre.
    pub centre: CentreChoice,
    /// How it is filled with tets.
    pub mesh: MeshPlan,
    /// The map to start from.
    pub map: InitialMap,
    /// The most tets that a collar may add, as a share of all.
    pub collar: f64,
    /// How it behaves at the corners of the solid.
    pub corners: CornerChoice,
    /// Which vertices are corners, ascending; `None` for those that the solid's shape tells.
    pub corner_vertices: Option<Vec<VertexId>>,
    /// How the map is improved.
    pub optimize: OptimizeSettings,
    /// Whether the map is to commute with the mesh's mirror planes.
    pub symmetric: bool,
    /// Whether K onto the ball is made small rather than that onto the polyhedron.
    pub onto_ball: bool,
    /// How the mesh is refined where the largest K sits; none if it stays as it is.
    pub refine: Option<RefineSettings>,
    /// The longest search for a Gram certificate; none if there shall be no search.
    pub certify: Option<Duration>,
}

/// Where the domain comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum DomainSource {
    /// A built-in solid.
    Solid(Solid),
    /// A surface file that was there when the config was read.
    Surface(PathBuf),
    /// A file of cells, usually tets, that was there when the config was read.
    Mesh(PathBuf),
}

impl std::fmt::Display for DomainSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Solid(solid) => write!(f, "{solid}"),
            Self::Surface(path) | Self::Mesh(path) => write!(f, "{}", shown_path(path)),
        }
    }
}

impl Plan {
    /// Reads a config, from standard input for `-`, or takes the least one of a surface or mesh file, applies the overrides `key.path=value` and checks what they mean together.
    ///
    /// # Errors
    /// The first fault, with the file, line and key or the override to blame, and what to do.
    pub fn read(path: &Path, overrides: &[String]) -> Result<Self, ConfigError> {
        let (source, config) = ConfigSource::read(path, overrides)?;
        Self::of_source(&source, &config)
    }

    /// The program that the config itself names as its mesher: one from elsewhere may name any.
    pub fn program(&self) -> Option<&Path> {
        match &self.mesh {
            MeshPlan::External(ExternalSettings { program, .. }) => program.as_deref(),
            MeshPlan::Auto { .. } | MeshPlan::Shell(_) | MeshPlan::Flag(_) => None,
        }
    }

    /// The same of a config that was read.
    pub(crate) fn of_source(source: &ConfigSource, config: &Config) -> Result<Self, ConfigError> {
        Self::new(source, config).map_err(|fault| source.error(fault))
    }

    pub(super) fn new(source: &ConfigSource, config: &Config) -> Result<Self, Fault> {
        let domain = domain(source.path(), config)?;
        let is_mesh = matches!(domain, DomainSource::Mesh(_));
        let map = map::plan(config, is_mesh)?;
        let corners = boundary::corners(config, &map)?;
        let mesh = mesh::plan(&config.mesh, source.path())?;
        Ok(Self {
            name: name(source.path(), config)?,
            source: source.clone(),
            seed: whole(Some(config.seed), 0, 0..=i64::MAX, &["seed"])?,
            threads: Some(whole(config.threads, 0, 0..=1024, &["threads"])?).filter(|&threads| threads > 0),
            repair: repair(config)?,
            keep_mesh: config.domain.keep_mesh,
            centre: solid::centre(config)?,
            collar: boundary::collar(config, &mesh)?,
            mesh,
            domain,
            symmetric: config.optimize.symmetric,
            onto_ball: config.optimize.objective == ObjectiveName::Ball,
            refine: refine::plan(config, Some(&map), &corners)?,
            corner_vertices: boundary::corner_vertices(config, corners)?,
            corners,
            map,
            optimize: optimize(config)?,
            certify: certify(config)?,
        })
    }
}

impl Plan {
    /// The plan with its lengths counted in another unit.
    pub(crate) fn in_unit(&self, unit: Unit) -> Self {
        let length = |length| unit.take(length, 1);
        let of_shells = |settings: &ShellSettings| {
            let mut settings = settings.clone();
            if let Some(Refinement::EdgeLength(edge)) = &mut settings.refinement {
                *edge = length(*edge);
            }
            settings
        };
        let of_external = |settings: &ExternalSettings| {
            let mut settings = settings.clone();
            settings.max_volume = settings.max_volume.map(|volume| unit.take(volume, 3));
            if let Some(sizing) = &mut settings.sizing {
                sizing.edge_length = length(sizing.edge_length);
                sizing.feature_edge_length = length(sizing.feature_edge_length);
            }
            settings
        };
        let mesh = match &self.mesh {
            MeshPlan::Auto { shell, external, shell_keys } => MeshPlan::Auto {
                shell: of_shells(shell),
                external: of_external(external),
                shell_keys: shell_keys.clone(),
            },
            MeshPlan::Shell(settings) => MeshPlan::Shell(of_shells(settings)),
            // Counted in parts of the solid.
            MeshPlan::Flag(settings) => MeshPlan::Flag(settings.clone()),
            MeshPlan::External(settings) => MeshPlan::External(of_external(settings)),
        };
        let centre = match &self.centre {
            CentreChoice::At(point) => CentreChoice::At(point.map(length)),
            rule => rule.clone(),
        };
        Self { mesh, centre, ..self.clone() }
    }
}

pub(super) fn name(config_path: &Path, config: &Config) -> Result<String, Fault> {
    let stem = || match config_path.file_stem().unwrap_or_default().to_string_lossy() {
        stem if stem == STANDARD_INPUT => "stdin".into(),
        stem => stem.into_owned(),
    };
    let name = config.name.clone().unwrap_or_else(stem);
    // The name becomes a folder below results/, and must not lead out of it.
    let mut parts = Path::new(&name).components();
    match (parts.next(), parts.next()) {
        (Some(Component::Normal(only)), None)
            if only == name.as_str() && !name.contains(|c: char| c == '\\' || c.is_control()) =>
        {
            Ok(name)
        }
        _ => Err(Fault::at(
            &["name"],
            format!("the name {name:?} cannot be the name of a folder"),
            "give a name without slashes and control characters, for example name = \"cube-fine\"",
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
                let message = format!("the file {} {why}", shown_path(&path));
                return Err(Fault::at(&["domain", "file"], message, "paths are relative to the config file"));
            }
            let is_surface = SurfaceFormat::of(&path).is_some();
            if !is_surface && TetFormat::of(&path).is_none() {
                let ending = path.extension().unwrap_or_default().to_string_lossy().into_owned();
                let message = ReadError::UnknownEnding { path, ending, wanted: "solid" }.to_string();
                return Err(Fault::at(&["domain", "file"], message, "export the solid in one of these formats"));
            }
            // What a file of cells holds is told by its content, but that is read twice only where it matters here.
            let matters = mesh::first_given(&config.mesh).is_some()
                || config.map.kind == MapKind::Farthest
                || first_repair(domain).is_some();
            let is_surface = is_surface || matters && matches!(read_solid(&path), Ok(SolidFile::Surface(_)));
            if is_surface { DomainSource::Surface(path) } else { DomainSource::Mesh(path) }
        }
    };
    solid::check_parameters(domain)?;
    let is_mesh = matches!(source, DomainSource::Mesh(_));
    if is_mesh && let Some(key) = mesh::first_given(&config.mesh) {
        let message = format!("`{key}` speaks of a mesh to be made, but `domain.file` is a mesh already");
        return Err(Fault::at(&["mesh", key], message, "remove the key, or give a surface as domain.file"));
    }
    if let Some(key) = first_repair(domain)
        && !matches!(source, DomainSource::Surface(_))
    {
        let message = format!("`{key}` speaks of a surface file, and the domain is none");
        return Err(Fault::at(&["domain", key], message, "remove the key, or give a surface as domain.file"));
    }
    if domain.keep_mesh && !is_mesh {
        let message = "`keep_mesh` speaks of a given mesh, but the mesh of this run is made".to_string();
        return Err(Fault::at(&["domain", "keep_mesh"], message, "remove the key, or give a mesh as domain.file"));
    }
    Ok(source)
}

/// The first key of repairs that is given.
fn first_repair(domain: &DomainTable) -> Option<&'static str> {
    let keys =
        [("weld", domain.weld.is_some()), ("keep_largest", domain.keep_largest), ("fill_holes", domain.fill_holes)];
    keys.into_iter().find(|(_, given)| *given).map(|(key, _)| key)
}

fn repair(config: &Config) -> Result<RepairSettings, Fault> {
    let DomainTable { weld, keep_largest, fill_holes, .. } = config.domain;
    if let Some(weld) = weld
        && !(weld > 0.0 && weld <= 0.01)
    {
        let message = format!("`domain.weld` is {weld}, but must be greater than 0 and at most 0.01");
        let help = "it is a part of the bounding box's diagonal, for example 1e-7";
        return Err(Fault::at(&["domain", "weld"], message, help));
    }
    Ok(RepairSettings { weld, keep_largest, fill_holes })
}

fn certify(config: &Config) -> Result<Option<Duration>, Fault> {
    let table = &config.bounds;
    let key = ["bounds", "certify_time_limit"];
    let example = DEFAULT_TIME_LIMIT.as_secs_f64();
    match table.certify_time_limit {
        Some(_) if !table.certify => {
            let message = "`certify_time_limit` limits a search that `certify` does not ask for".to_string();
            Err(Fault::at(&key, message, "add certify = true, or remove the key"))
        }
        Some(seconds) => duration(seconds, example, &key).map(Some),
        None => Ok(table.certify.then_some(DEFAULT_TIME_LIMIT)),
    }
}

pub(super) fn optimize(config: &Config) -> Result<OptimizeSettings, Fault> {
    let table = &config.optimize;
    let default = OptimizeSettings::default();
    let key = ["optimize", "exponent"];
    let objective = match (table.objective, table.exponent) {
        (ObjectiveName::Max | ObjectiveName::Ball, None) => Objective::Max,
        (ObjectiveName::SoftMax, Some(exponent)) if exponent > MOST_EXPONENT && exponent.is_finite() => {
            let message = format!("`optimize.exponent` is {exponent}, but must be at most {MOST_EXPONENT:e}");
            let help = "the soft maximum with it is the largest K but for rounding: take objective = \"max\"";
            return Err(Fault::at(&key, message, help));
        }
        (ObjectiveName::SoftMax, Some(exponent)) => Objective::SoftMax(positive(Some(exponent), 48.0, &key)?),
        (name @ (ObjectiveName::Max | ObjectiveName::Ball), Some(_)) => {
            let name = if name == ObjectiveName::Max { "max" } else { "ball" };
            let message = format!("the objective \"{name}\" takes no `exponent`");
            return Err(Fault::at(&key, message, "remove it, or add objective = \"soft-max\""));
        }
        (ObjectiveName::SoftMax, None) => {
            let message = "the objective \"soft-max\" needs an `exponent`".to_string();
            return Err(Fault::at(&["optimize", "objective"], message, "add for example exponent = 48"));
        }
    };
    let boundary_values = config.boundary.values;
    if let Err(error) = table.engine.check(objective, boundary_values) {
        return Err(Fault::at(
            &["optimize", "engine"],
            error.to_string(),
            "\"newton\" is for every objective and size",
        ));
    }
    let key = ["optimize", "max_iterations"];
    Ok(OptimizeSettings {
        objective,
        engine: table.engine,
        polish: polish(table, default.polish)?,
        rise: rise(table, default.rise)?,
        boundary_values,
        effort: table.effort,
        tolerance: positive(table.tolerance, default.tolerance, &["optimize", "tolerance"])?,
        max_iterations: whole(table.max_iterations, default.max_iterations as i64, 0..=1_000_000_000, &key)?,
        time_limit: table.time_limit.map(|given| duration(given, 600.0, &["optimize", "time_limit"])).transpose()?,
        cancel: default.cancel,
    })
}

fn rise(table: &OptimizeTable, default: f64) -> Result<f64, Fault> {
    let key = ["optimize", "rise"];
    let Some(rise) = table.rise else { return Ok(default) };
    if !matches!(table.polish, None | Some(PolishName::Mean)) || table.objective != ObjectiveName::Max {
        let message = "only the polish \"mean\" takes `rise`".to_string();
        return Err(Fault::at(&key, message, "remove it, or use objective = \"max\" and polish = \"mean\""));
    }
    if !(rise > 0.0 && rise <= 10.0) {
        let message = format!("`optimize.rise` is {rise}, but must be greater than 0 and at most 10");
        return Err(Fault::at(&key, message, "it is relative to the largest K, for example 0.1"));
    }
    Ok(rise)
}

fn polish(table: &OptimizeTable, default: Polish) -> Result<Polish, Fault> {
    let key = ["optimize", "levels"];
    if table.levels.is_some() && table.polish != Some(PolishName::Lexicographic) {
        let message = "only the polish \"lexicographic\" takes `levels`".to_string();
        return Err(Fault::at(&key, message, "remove it, or add polish = \"lexicographic\""));
    }
    match (table.polish, table.objective) {
        (None, _) => Ok(default),
        (Some(PolishName::Mean), ObjectiveName::Max) => Ok(Polish::Mean),
        (Some(PolishName::Lexicographic), ObjectiveName::Max) => {
            Ok(Polish::Lexicographic { levels: whole(table.levels, 3, 2..=1_000_000, &key)? })
        }
        (Some(PolishName::None), ObjectiveName::Max) => Ok(Polish::None),
        (Some(_), ObjectiveName::SoftMax | ObjectiveName::Ball) => {
            let message = "only the objective \"max\" is polished".to_string();
            Err(Fault::at(&["optimize", "polish"], message, "remove it, or use objective = \"max\""))
        }
    }
}

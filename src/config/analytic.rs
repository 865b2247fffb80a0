//! Configs that ask no map to be improved, but maps of known dilatation to be estimated on several meshes.

use std::fs;
use std::path::Path;

use schemars::JsonSchema;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};

use super::error::{ConfigError, Fault, reworded};
use super::mesh::{self, MeshPlan};
use super::source::key_at;
use super::{Config, DomainTable, MeshTable, plan, solid};
use crate::estimate::{Estimator, Weights};
use crate::map::AnalyticMap;
use crate::map::analytic::Affine;
use crate::picture::{Colour, Cut};
use crate::solid::{CentreChoice, Solid, Voxels};

/// A config with the table `[analytic]`, key by key as typed.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, expecting = "a config")]
pub(super) struct AnalyticConfig {
    /// Name of the run. Default: the config file's name without its ending.
    name: Option<String>,
    /// Maps of known dilatation and the meshes that they are estimated on.
    analytic: AnalyticTable,
}

/// The table `[analytic]`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, expecting = "the table [analytic]")]
struct AnalyticTable {
    /// The maps, each with its `kind` and parameters.
    maps: Vec<MapPlan>,
    /// How K is estimated. Default: "paper".
    estimator: Option<Estimator>,
    /// The meshes.
    meshes: Vec<AnalyticMesh>,
    /// Sentences that stand below the table. Default: none.
    #[serde(default)]
    notes: Vec<String>,
    /// Pictures of each map on each mesh, and the meshes with their figures as VTU. Default: none.
    pictures: Option<PicturesTable>,
}

/// The table `[analytic.pictures]`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, expecting = "the table [analytic.pictures]")]
struct PicturesTable {
    /// What is shown, a picture each.
    colours: Vec<Colour>,
    /// Planes [nx, ny, nz, d]: what lies beyond all of them, nx x + ny y + nz z > d, is cut away. Default: nothing is.
    #[serde(default)]
    cuts: Vec<[f64; 4]>,
}

/// One of `[[analytic.meshes]]`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, expecting = "a table of [[analytic.meshes]]")]
struct AnalyticMesh {
    /// A built-in solid with its parameters, as in the table `[domain]` of other configs. Its `centre` is that of the map
    /// "caraman" and of shell meshes.
    domain: DomainTable,
    /// An affine map that puts the solid into its place. Default: it stays where it is.
    place: Option<Affine>,
    /// The solid is filled with boxes: "cubic(n;d;k)" or "voxel(nx,ny,nz;d;k)". Exactly one of `voxels`, `mesh` and
    /// `surface` is given.
    voxels: Option<String>,
    /// The solid is filled with tets, as in the table `[mesh]` of other configs.
    mesh: Option<MeshTable>,
    /// true: nothing but the surface is mapped, and its invariants are compared before and after.
    #[serde(default)]
    surface: bool,
    /// How cells count at a vertex. Default, as in the paper: "equal" for boxes, "solid-angle" for tets.
    weights: Option<Weights>,
    /// The published max K of each map, in the order of `maps`. Default: none.
    published: Option<Vec<f64>>,
    /// The published mean K of each map. Default: none.
    published_mean: Option<Vec<f64>>,
}

/// A map as a config gives it.
#[derive(Clone, Debug, PartialEq, JsonSchema)]
#[serde(untagged)]
pub enum MapPlan {
    /// One that keys give whole.
    Formula(AnalyticMap),
    /// The radial map of each mesh's own solid onto the unit ball.
    Caraman(CaramanPlan),
}

/// `kind = "caraman"` and its exponent.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaramanPlan {
    /// The name of the map.
    pub kind: CaramanName,
    /// The exponent a > 0 of eq. 20. Default: 1.
    #[serde(default = "one")]
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub exponent: f64,
}

/// The one name of [`CaramanPlan`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CaramanName {
    /// Caraman's map.
    Caraman,
}

fn one() -> f64 {
    1.0
}

impl<'de> Deserialize<'de> for MapPlan {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let table = toml::Table::deserialize(deserializer)?;
        // Not by serde's `untagged`, whose message would be that no kind fits.
        let read = if table.get("kind").and_then(|kind| kind.as_str()) == Some("caraman") {
            table.try_into().map(Self::Caraman)
        } else {
            table.try_into().map(Self::Formula)
        };
        read.map_err(|error: toml::de::Error| D::Error::custom(error.message()))
    }
}

impl MapPlan {
    fn check(&self) -> Result<(), String> {
        match self {
            Self::Formula(map) => map.check().map_err(|error| error.to_string()),
            Self::Caraman(CaramanPlan { exponent, .. }) if *exponent > 0.0 && exponent.is_finite() => Ok(()),
            Self::Caraman(CaramanPlan { exponent, .. }) => {
                Err(format!("exponent is {exponent}, but it must be a positive number"))
            }
        }
    }
}

/// Maps, meshes and an estimator.
#[derive(Clone, Debug, PartialEq)]
pub struct AnalyticPlan {
    /// Name of the run.
    pub name: String,
    /// The config's text.
    pub text: String,
    /// The maps, checked.
    pub maps: Vec<MapPlan>,
    /// How K is estimated.
    pub estimator: Estimator,
    /// The meshes.
    pub meshes: Vec<AnalyticMeshPlan>,
    /// Sentences below the table.
    pub notes: Vec<String>,
    /// What is shown of each map on each mesh, a picture each.
    pub colours: Vec<Colour>,
    /// What is cut away in the pictures.
    pub cuts: Vec<Cut>,
}

/// A mesh that the maps are applied to.
#[derive(Clone, Debug, PartialEq)]
pub struct AnalyticMeshPlan {
    /// The solid.
    pub solid: Solid,
    /// What puts it into its place.
    pub place: Option<Affine>,
    /// The centre of radial maps and of shell meshes.
    pub centre: CentreChoice,
    /// Its cells.
    pub cells: CellsPlan,
    /// How cells count at a vertex.
    pub weights: Weights,
    /// The published max K of each map, or none.
    pub published: Vec<Option<f64>>,
    /// The published mean K of each map, or none.
    pub published_mean: Vec<Option<f64>>,
}

/// What a solid is filled with.
#[derive(Clone, Debug, PartialEq)]
pub enum CellsPlan {
    /// Boxes.
    Voxels(Voxels),
    /// Tets.
    Tets(MeshPlan),
    /// Nothing.
    Surface,
}

impl AnalyticPlan {
    /// Reads a config with the table `[analytic]`; none if the file has no such table or is no TOML, which is for
    /// [`super::Plan::read`] to say.
    ///
    /// # Errors
    /// The first fault, with the file, the line where there is one, and what to do.
    pub fn read(path: &Path) -> Result<Option<Self>, ConfigError> {
        fs::read_to_string(path).map_or(Ok(None), |text| Self::of_text(path, &text))
    }

    /// The same of a text that is at hand; `path` only names it.
    pub(super) fn of_text(path: &Path, text: &str) -> Result<Option<Self>, ConfigError> {
        let has_table = toml::from_str::<toml::Table>(text).is_ok_and(|table| table.contains_key("analytic"));
        if !has_table {
            return Ok(None);
        }
        let config: AnalyticConfig = toml::from_str(text).map_err(|error| {
            let key = error.span().and_then(|span| key_at(text, &span));
            let (message, help) = reworded(error.message(), key.as_deref());
            ConfigError::content(path, text, error.span(), message, help)
        })?;
        let made = Self::new(path, text, config);
        made.map(Some).map_err(|fault| ConfigError::content(path, text, None, fault.message, fault.help))
    }

    fn new(path: &Path, text: &str, config: AnalyticConfig) -> Result<Self, Fault> {
        let AnalyticConfig { name, analytic } = config;
        let name = plan::name(path, &Config { name, ..Config::default() })?;
        for (key, count) in [("maps", analytic.maps.len()), ("meshes", analytic.meshes.len())] {
            if count == 0 {
                return Err(Fault::at(&["analytic", key], format!("analytic.{key} is empty"), "give one at least"));
            }
        }
        for (index, map) in analytic.maps.iter().enumerate() {
            map.check().map_err(|error| {
                Fault::at(&["analytic", "maps"], format!("map {}: {error}", index + 1), "correct the parameter")
            })?;
        }
        let maps = analytic.maps.len();
        let meshes = analytic.meshes.into_iter().enumerate().map(|(index, mesh)| {
            mesh_plan(mesh, path, maps).map_err(|fault| Fault {
                message: format!("mesh {} of [[analytic.meshes]]: {}", index + 1, fault.message),
                ..fault
            })
        });
        let PicturesTable { colours, cuts } =
            analytic.pictures.unwrap_or(PicturesTable { colours: Vec::new(), cuts: Vec::new() });
        let cuts = cuts.into_iter().map(|[x, y, z, offset]| {
            let help = "give [nx, ny, nz, d], where nx, ny, nz are not all 0";
            Cut::new([x, y, z].into(), offset)
                .map_err(|error| Fault::at(&["analytic", "pictures"], error.to_string(), help))
        });
        Ok(Self {
            name,
            text: text.to_owned(),
            meshes: meshes.collect::<Result<_, _>>()?,
            notes: analytic.notes,
            colours,
            cuts: cuts.collect::<Result<_, _>>()?,
            maps: analytic.maps,
            estimator: analytic.estimator.unwrap_or(Estimator::Paper),
        })
    }
}

fn mesh_plan(mesh: AnalyticMesh, path: &Path, maps: usize) -> Result<AnalyticMeshPlan, Fault> {
    let refuse = |message: &str, help: &str| Err(Fault::at(&["analytic", "meshes"], message.to_owned(), help));
    let domain = &mesh.domain;
    if domain.file.is_some() || domain.keep_mesh {
        return refuse("only built-in solids are estimated", "give domain.solid and its parameters, nothing else");
    }
    let Some(name) = domain.solid else {
        return refuse("no solid is given", "for example domain = { solid = \"torus\", radii = [1, 0.5] }");
    };
    solid::check_parameters(domain)?;
    if let Some(place) = &mesh.place {
        let placed = AnalyticMap::Affine(place.clone()).check();
        placed
            .map_err(|error| Fault::at(&["analytic", "meshes"], format!("`place`: {error}"), "correct the matrix"))?;
    }
    let cells = match (&mesh.voxels, &mesh.mesh, mesh.surface) {
        (Some(text), None, false) => {
            CellsPlan::Voxels(text.parse().map_err(|error: crate::solid::VoxelizeError| {
                Fault::at(&["analytic", "meshes"], error.to_string(), "for example voxels = \"cubic(10;2;2)\"")
            })?)
        }
        (None, Some(table), false) => CellsPlan::Tets(mesh::plan(table, path)?),
        (None, None, true) => CellsPlan::Surface,
        _ => {
            return refuse(
                "exactly one of `voxels`, `mesh` and `surface` must be given",
                "for example voxels = \"cubic(10;2;2)\"",
            );
        }
    };
    let of_each_map = |key: &str, values: Option<Vec<f64>>| match values {
        None => Ok(vec![None; maps]),
        Some(values) if values.len() == maps => Ok(values.into_iter().map(Some).collect()),
        Some(values) => {
            let message = format!("`{key}` has {} values for {maps} maps", values.len());
            Err(Fault::at(&["analytic", "meshes"], message, "give one for each map, or leave it out"))
        }
    };
    let by_default = match cells {
        CellsPlan::Voxels(_) => Weights::Equal,
        CellsPlan::Tets(_) | CellsPlan::Surface => Weights::SolidAngle,
    };
    let config = Config { domain: mesh.domain, ..Config::default() };
    Ok(AnalyticMeshPlan {
        solid: solid::build(name, &config)?,
        place: mesh.place,
        centre: solid::centre(&config)?,
        cells,
        weights: mesh.weights.unwrap_or(by_default),
        published: of_each_map("published", mesh.published)?,
        published_mean: of_each_map("published_mean", mesh.published_mean)?,
    })
}

//! Configs that ask no map to be improved, but maps of known dilatation to be estimated on several meshes.

use std::fs;
use std::path::Path;

use serde::Deserialize;

use super::error::{ConfigError, Fault, reworded};
use super::mesh::{self, MeshPlan};
use super::{Config, DomainTable, MeshTable, plan, solid};
use crate::estimate::{Estimator, Weights};
use crate::map::AnalyticMap;
use crate::map::analytic::Affine;
use crate::solid::{Solid, Voxels};

/// A config with the table `[analytic]`, key by key as typed.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct AnalyticConfig {
    /// Name of the run. Default: the config file's name without its ending.
    name: Option<String>,
    analytic: AnalyticTable,
}

/// The table `[analytic]`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct AnalyticTable {
    /// The maps, each with its `kind` and parameters.
    maps: Vec<AnalyticMap>,
    /// How K is estimated. Default: "paper".
    estimator: Option<Estimator>,
    /// The meshes.
    meshes: Vec<AnalyticMesh>,
}

/// One of `[[analytic.meshes]]`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct AnalyticMesh {
    /// A built-in solid with its parameters, as in the table `[domain]` of other configs.
    domain: DomainTable,
    /// An affine map that puts the solid into its place. Default: it stays where it is.
    place: Option<Affine>,
    /// The solid is filled with boxes: "cubic(n;d;k)" or "voxel(nx,ny,nz;d;k)". Exactly one of `voxels` and `mesh` is given.
    voxels: Option<String>,
    /// The solid is filled with tets, as in the table `[mesh]` of other configs.
    mesh: Option<MeshTable>,
    /// How cells count at a vertex. Default, as in the paper: "equal" for boxes, "solid-angle" for tets.
    weights: Option<Weights>,
    /// The published max K of each map, in the order of `maps`. Default: none.
    published: Option<Vec<f64>>,
}

/// Maps, meshes and an estimator.
#[derive(Clone, Debug, PartialEq)]
pub struct AnalyticPlan {
    /// Name of the run.
    pub name: String,
    /// The config's text.
    pub text: String,
    /// The maps, checked.
    pub maps: Vec<AnalyticMap>,
    /// How K is estimated.
    pub estimator: Estimator,
    /// The meshes.
    pub meshes: Vec<AnalyticMeshPlan>,
}

/// A mesh that the maps are applied to.
#[derive(Clone, Debug, PartialEq)]
pub struct AnalyticMeshPlan {
    /// The solid.
    pub solid: Solid,
    /// What puts it into its place.
    pub place: Option<Affine>,
    /// Its cells.
    pub cells: CellsPlan,
    /// How cells count at a vertex.
    pub weights: Weights,
    /// The published max K of each map, or none.
    pub published: Vec<Option<f64>>,
}

/// What a solid is filled with.
#[derive(Clone, Debug, PartialEq)]
pub enum CellsPlan {
    /// Boxes.
    Voxels(Voxels),
    /// Tets.
    Tets(MeshPlan),
}

impl AnalyticPlan {
    /// Reads a config with the table `[analytic]`; none if the file has no such table or is no TOML, which is for
    /// [`super::Plan::read`] to say.
    ///
    /// # Errors
    /// The first fault, with the file, the line where there is one, and what to do.
    pub fn read(path: &Path) -> Result<Option<Self>, ConfigError> {
        let Ok(text) = fs::read_to_string(path) else { return Ok(None) };
        let has_table = toml::from_str::<toml::Table>(&text).is_ok_and(|table| table.contains_key("analytic"));
        if !has_table {
            return Ok(None);
        }
        let config: AnalyticConfig = toml::from_str(&text).map_err(|error| {
            let (message, help) = reworded(error.message(), None);
            ConfigError::content(path, &text, error.span(), message, help)
        })?;
        let made = Self::new(path, &text, config);
        made.map(Some).map_err(|fault| ConfigError::content(path, &text, None, fault.message, fault.help))
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
        Ok(Self {
            name,
            text: text.to_owned(),
            meshes: meshes.collect::<Result<_, _>>()?,
            maps: analytic.maps,
            estimator: analytic.estimator.unwrap_or(Estimator::Paper),
        })
    }
}

fn mesh_plan(mesh: AnalyticMesh, path: &Path, maps: usize) -> Result<AnalyticMeshPlan, Fault> {
    let refuse = |message: &str, help: &str| Err(Fault::at(&["analytic", "meshes"], message.to_owned(), help));
    let domain = &mesh.domain;
    if domain.file.is_some() || domain.centre.is_some() || domain.keep_mesh {
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
    let cells = match (&mesh.voxels, &mesh.mesh) {
        (Some(text), None) => CellsPlan::Voxels(text.parse().map_err(|error: crate::solid::VoxelizeError| {
            Fault::at(&["analytic", "meshes"], error.to_string(), "for example voxels = \"cubic(10;2;2)\"")
        })?),
        (None, Some(table)) => CellsPlan::Tets(mesh::plan(table, path)?),
        _ => {
            return refuse(
                "exactly one of `voxels` and `mesh` must be given",
                "for example voxels = \"cubic(10;2;2)\"",
            );
        }
    };
    let published = match mesh.published {
        None => vec![None; maps],
        Some(values) if values.len() == maps => values.into_iter().map(Some).collect(),
        Some(values) => {
            let message = format!("`published` has {} values for {maps} maps", values.len());
            return refuse(&message, "give one for each map, or leave it out");
        }
    };
    let by_default = match cells {
        CellsPlan::Voxels(_) => Weights::Equal,
        CellsPlan::Tets(_) => Weights::SolidAngle,
    };
    let config = Config { domain: mesh.domain, ..Config::default() };
    Ok(AnalyticMeshPlan {
        solid: solid::build(name, &config)?,
        place: mesh.place,
        cells,
        weights: mesh.weights.unwrap_or(by_default),
        published,
    })
}

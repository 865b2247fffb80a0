//! The table `[refine]`.

use schemars::JsonSchema;
use serde::Deserialize;

use super::error::Fault;
use super::limits::{positive, whole};
use super::{Config, InitialMap, MeshKind, ObjectiveName};
use crate::map::CornerChoice;
use crate::optimize::BoundaryValues;
use crate::refine::{Budget, RefineSettings};

/// The most that `refine.tets` may be.
const MOST_TETS: i64 = 1_000_000_000;

/// The table `[refine]`: rounds in which tets are flipped and edges halved inside, where K is large, before the largest K is settled again. The
/// surface stays as it is, and so do the values there, unless `surface` is true.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "the table [refine]")]
pub struct RefineTable {
    /// Most rounds, at least 0; each may add an equal part of the tets. Default: 8, which are enough, or 12 with `surface`, where this
    /// table has another key, else 0: no refinement.
    #[schemars(range(min = 0, max = 1000))]
    pub rounds: Option<i64>,
    /// Most tets that may be added in all: a number, or a share such as "5 %" of those there are. Default: "10 %", or "600 %" with
    /// `surface`.
    pub tets: Option<BudgetValue>,
    /// Relative distance, > 0, from the best bound that refinement inside cannot change within which it ends. Default: 0.02.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub until: Option<f64>,
    /// Whether edges of the surface are halved as well, the solid staying what it is and new vertices going where the boundary map sends them.
    /// What is lowered is K onto the ball then, as with objective = "ball", which takes several times as many tets as there are.
    /// Default: false.
    pub surface: Option<bool>,
}

/// The value of `refine.tets`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "tets are a number or a share such as \"5 %\"")]
pub enum BudgetValue {
    /// So many.
    Tets(#[schemars(range(min = 0))] i64),
    /// A share in per cent.
    Share(String),
}

impl RefineTable {
    /// The key that asks for refinement, if one does.
    pub(super) fn asked_by(&self) -> Option<[&'static str; 2]> {
        let keys = [
            ("rounds", self.rounds.is_some()),
            ("tets", self.tets.is_some()),
            ("until", self.until.is_some()),
            ("surface", self.surface.is_some()),
        ];
        let (key, _) = keys.into_iter().find(|(_, is_given)| *is_given)?;
        (self.rounds != Some(0)).then_some(["refine", key])
    }
}

/// What a checked `[refine]` means; none without rounds.
pub(super) fn plan(
    config: &Config,
    map: Option<&InitialMap>,
    corners: &CornerChoice,
) -> Result<Option<RefineSettings>, Fault> {
    let table = &config.refine;
    let surface = table.surface.unwrap_or(false);
    let default = if surface { RefineSettings::of_surface() } else { RefineSettings::default() };
    let rounds: usize = whole(table.rounds, default.rounds as i64, 0..=1000, &["refine", "rounds"])?;
    let key = ["refine", "tets"];
    let tets = match &table.tets {
        None => default.tets,
        Some(BudgetValue::Tets(count @ 0..=MOST_TETS)) => Budget::Tets(*count as usize),
        Some(BudgetValue::Tets(count)) => {
            let message = format!("`refine.tets` is {count}, but must lie between 0 and {MOST_TETS}");
            return Err(Fault::at(
                &key,
                message,
                "the default is \"10 %\" of the tets that there are, \"600 %\" with the surface",
            ));
        }
        Some(BudgetValue::Share(text)) => match text.parse() {
            Ok(budget @ Budget::Share(_)) => budget,
            _ => {
                let message = format!("`refine.tets` is {text:?}, which is no share");
                return Err(Fault::at(&key, message, "write a number, or for example \"5 %\""));
            }
        },
    };
    let until = positive(table.until, default.until, &["refine", "until"])?;
    let Some(asked_by) = table.asked_by() else { return Ok(None) };
    let slides = config.boundary.values != BoundaryValues::Fixed;
    // Each with what is in the way, if it is.
    let reasons = [
        (
            config.optimize.objective != ObjectiveName::Max || config.optimize.engine.solves_epigraph(),
            "refinement lowers the largest K by the interior-point method, which this [optimize] does not come to",
            "objective = \"max\" and an engine other than \"mma\", \"ccsaq\" and \"slsqp\"",
        ),
        (config.domain.keep_mesh, "a mesh that is kept as it is cannot be refined", "no domain.keep_mesh"),
        (
            slides && !surface,
            "refinement inside keeps the boundary, whose values are to slide here",
            "refine.surface = true, or no boundary.values",
        ),
        (config.optimize.symmetric, "refinement knows nothing of mirror planes", "no optimize.symmetric"),
        (
            *corners != CornerChoice::Linear && !surface,
            "refinement inside alone is of piecewise-linear maps",
            "refine.surface = true, or no boundary.corners",
        ),
        (
            *corners != CornerChoice::Linear && surface && config.mesh.kind == MeshKind::Flag,
            "the cones of flags cannot be refined",
            "another mesh.kind, or no boundary.corners",
        ),
        (
            surface && map.is_none(),
            "`refine.surface` is for `qcball run`, which knows the solid and its boundary map",
            "a config with the solid",
        ),
        (
            surface && matches!(map, Some(InitialMap::Formula(_) | InitialMap::Farthest { .. })),
            "this map has no values for new vertices of the surface",
            "map.kind = \"radial\" or \"spherical\"",
        ),
    ];
    let there = || reasons.iter().filter(|(is_there, ..)| *is_there);
    if there().next().is_some() {
        let of = |pick: fn(&(bool, &'static str, &'static str)) -> &'static str| there().map(pick).collect::<Vec<_>>();
        let (messages, needed) = (of(|reason| reason.1).join("; "), of(|reason| reason.2).join("; "));
        return Err(Fault::at(&asked_by, messages, format!("remove [refine], or take {needed}")));
    }
    Ok(Some(RefineSettings { rounds, tets, until, surface }))
}

//! The table `[refine]`.

use schemars::JsonSchema;
use serde::Deserialize;

use super::error::Fault;
use super::limits::{positive, whole};
use super::{Config, ObjectiveName};
use crate::map::CornerChoice;
use crate::optimize::BoundaryValues;
use crate::refine::{Budget, RefineSettings};

/// The most that `refine.tets` may be.
const MOST_TETS: i64 = 1_000_000_000;

/// The table `[refine]`: rounds in which edges are halved inside, where K is large, before the largest K is settled again. The
/// surface stays as it is, and so do the values there.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "the table [refine]")]
pub struct RefineTable {
    /// Most rounds, at least 0; each may add an equal part of the tets. Default: 8, which are enough, where this table has another
    /// key, else 0: no refinement.
    #[schemars(range(min = 0, max = 1000))]
    pub rounds: Option<i64>,
    /// Most tets that may be added in all: a number, or a share such as "5 %" of those there are. Default: "10 %".
    pub tets: Option<BudgetValue>,
    /// Relative distance, > 0, from the best bound that refinement inside cannot change within which it ends. Default: 0.02.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub until: Option<f64>,
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
        let keys = [("rounds", self.rounds.is_some()), ("tets", self.tets.is_some()), ("until", self.until.is_some())];
        let (key, _) = keys.into_iter().find(|(_, is_given)| *is_given)?;
        (self.rounds != Some(0)).then_some(["refine", key])
    }
}

/// What a checked `[refine]` means; none without rounds.
pub(super) fn plan(config: &Config, corners: &CornerChoice) -> Result<Option<RefineSettings>, Fault> {
    let table = &config.refine;
    let default = RefineSettings::default();
    let rounds: usize = whole(table.rounds, default.rounds as i64, 0..=1000, &["refine", "rounds"])?;
    let key = ["refine", "tets"];
    let tets = match &table.tets {
        None => default.tets,
        Some(BudgetValue::Tets(count @ 0..=MOST_TETS)) => Budget::Tets(*count as usize),
        Some(BudgetValue::Tets(count)) => {
            let message = format!("`refine.tets` is {count}, but must lie between 0 and {MOST_TETS}");
            return Err(Fault::at(&key, message, "the default is \"10 %\" of the tets that there are"));
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
    let refuse = |message: &str, help: &str| Err(Fault::at(&asked_by, message.into(), help));
    if config.optimize.objective != ObjectiveName::Max || config.optimize.engine.solves_epigraph() {
        return refuse(
            "refinement lowers the largest K by the interior-point method, which this [optimize] does not come to",
            "remove it, or use objective = \"max\" and engine = \"newton\"",
        );
    }
    if config.domain.keep_mesh {
        return refuse("a mesh that is kept as it is cannot be refined", "remove it, or domain.keep_mesh");
    }
    if config.boundary.values != BoundaryValues::Fixed {
        return refuse(
            "refinement keeps the boundary, whose values are to slide here",
            "remove it, or boundary.values",
        );
    }
    if config.optimize.symmetric {
        return refuse("refinement knows nothing of mirror planes", "remove it, or optimize.symmetric");
    }
    if *corners != CornerChoice::Linear {
        return refuse("only piecewise-linear maps can be refined", "remove it, or boundary.corners");
    }
    Ok(Some(RefineSettings { rounds, tets, until }))
}

//! Maps one after the other.

use serde::{Deserialize, Serialize};

use super::{AnalyticMap, ClosedForm, MapError};
use crate::dilatation::Dilatation;
use crate::linalg::svd;
use crate::mesh::{Mat3, Vec3};

/// The first map, then the second, and so on. No maps make the identity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Composition {
    /// The maps in the order in which they are applied.
    pub maps: Vec<AnalyticMap>,
}

impl ClosedForm for Composition {
    fn name(&self) -> &'static str {
        "composed"
    }

    fn check(&self) -> Result<(), MapError> {
        self.maps.iter().try_for_each(AnalyticMap::check)
    }

    fn value(&self, x: &Vec3) -> Result<Vec3, MapError> {
        self.maps.iter().try_fold(*x, |at, map| map.value(&at))
    }

    /// By the chain rule.
    fn jacobian(&self, x: &Vec3) -> Result<Mat3, MapError> {
        let mut at = *x;
        let mut product = Mat3::identity();
        for map in &self.maps {
            product = map.jacobian(&at)? * product;
            at = map.value(&at)?;
        }
        Ok(product)
    }

    fn dilatation(&self, x: &Vec3) -> Result<Dilatation, MapError> {
        Ok(Dilatation::of_stretches(svd(&self.jacobian(x)?).values))
    }

    fn max_dilatation(&self) -> Option<Dilatation> {
        None
    }
}

//! The radial power map (paper eq. 14, 15).

use serde::{Deserialize, Serialize};

use super::{ClosedForm, MapError};
use crate::dilatation::Dilatation;
use crate::mesh::{Mat3, Vec3};

/// x -> |x|^(a-1) x, a not 0.
///
/// The stretches are |x|^(a-1) times 1, 1, |a|: for |a| >= 1, K_I = |a| and K_O = a^2; for |a| <= 1, K_I = a^-2 and
/// K_O = 1 / |a|, whatever the domain. For a < 0 the map reverses orientation and has no value at 0; a = -1 is the
/// inversion in the unit sphere, conformal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Power {
    /// a.
    pub exponent: f64,
}

impl ClosedForm for Power {
    fn name(&self) -> &'static str {
        "power"
    }

    fn check(&self) -> Result<(), MapError> {
        if self.exponent != 0.0 && self.exponent.is_finite() {
            Ok(())
        } else {
            let requirement = "it must be a number other than 0";
            Err(MapError::Parameter { parameter: "exponent", value: self.exponent, requirement })
        }
    }

    fn value(&self, x: &Vec3) -> Result<Vec3, MapError> {
        let norm = x.norm();
        if norm > 0.0 {
            // Not |x|^(a-1) x, which overflows near 0 where the image does not.
            Ok(x / norm * norm.powf(self.exponent))
        } else if self.exponent > 0.0 {
            Ok(Vec3::zeros())
        } else {
            Err(self.outside(x, "with a negative exponent the origin goes to infinity; move the mesh off it"))
        }
    }

    fn jacobian(&self, x: &Vec3) -> Result<Mat3, MapError> {
        let norm = x.norm();
        if norm == 0.0 {
            return Err(self.outside(x, "at the origin it has no invertible derivative"));
        }
        let direction = x / norm;
        let radial = (self.exponent - 1.0) * direction * direction.transpose();
        Ok(norm.powf(self.exponent - 1.0) * (Mat3::identity() + radial))
    }

    fn dilatation(&self, _: &Vec3) -> Result<Dilatation, MapError> {
        Ok(Dilatation::of_stretches([1.0, 1.0, self.exponent]))
    }

    fn max_dilatation(&self) -> Option<Dilatation> {
        Some(Dilatation::of_stretches([1.0, 1.0, self.exponent]))
    }
}

//! The folding of a wedge onto another (paper eq. 11, 13).

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use super::{ClosedForm, Cylindrical, MapError, positive};
use crate::dilatation::Dilatation;
use crate::mesh::{Mat3, Vec3};

/// Cylindrical coordinates (r, phi, z) -> (r, q phi, z), phi in [0, 2 pi) with q phi < 2 pi.
///
/// The stretches are 1, q, 1 everywhere: for q >= 1, K_I = q and K_O = q^2; for q <= 1, K_I = q^-2 and K_O = 1 / q. The map
/// jumps at the half-plane y = 0, x > 0, where phi does: a mesh must lie on one side of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Folding {
    /// q = beta / alpha > 0: the angle of the image wedge over that of the wedge.
    pub ratio: f64,
}

impl Folding {
    /// The azimuth of the image.
    fn image_azimuth(&self, x: &Vec3) -> Result<f64, MapError> {
        let azimuth = x.y.atan2(x.x);
        let azimuth = if azimuth < 0.0 { azimuth + TAU } else { azimuth };
        let image = self.ratio * azimuth;
        if image < TAU || self.ratio <= 1.0 {
            Ok(image)
        } else {
            Err(self.outside(
                x,
                format!(
                    "its azimuth {azimuth:.6} is not below 2 pi / {} = {:.6}; turn the mesh about the z-axis into the wedge \
                     between y = 0, x > 0 and that angle",
                    self.ratio,
                    TAU / self.ratio
                ),
            ))
        }
    }
}

impl ClosedForm for Folding {
    fn name(&self) -> &'static str {
        "folding"
    }

    fn check(&self) -> Result<(), MapError> {
        positive("ratio", self.ratio)
    }

    fn value(&self, x: &Vec3) -> Result<Vec3, MapError> {
        let (sine, cosine) = self.image_azimuth(x)?.sin_cos();
        let radius = x.x.hypot(x.y);
        Ok(Vec3::new(radius * cosine, radius * sine, x.z))
    }

    fn jacobian(&self, x: &Vec3) -> Result<Mat3, MapError> {
        let frame = Cylindrical::of(x).ok_or_else(|| self.outside(x, "on the z-axis it has no derivative"))?;
        let (sine, cosine) = self.image_azimuth(x)?.sin_cos();
        let (outward, around) = (Vec3::new(cosine, sine, 0.0), Vec3::new(-sine, cosine, 0.0));
        Ok(outward * frame.outward.transpose()
            + self.ratio * around * frame.around.transpose()
            + Vec3::z() * Vec3::z().transpose())
    }

    fn dilatation(&self, x: &Vec3) -> Result<Dilatation, MapError> {
        self.image_azimuth(x)?;
        Ok(Dilatation::of_stretches([1.0, self.ratio, 1.0]))
    }

    fn max_dilatation(&self) -> Option<Dilatation> {
        Some(Dilatation::of_stretches([1.0, self.ratio, 1.0]))
    }
}

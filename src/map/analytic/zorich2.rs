//! The second factor of the Zorich map: a round cylinder onto a half-space (paper eq. 17).

use std::f64::consts::FRAC_PI_2;

use serde::{Deserialize, Serialize};

use super::{ClosedForm, Cylindrical, MapError, SLACK, positive};
use crate::dilatation::Dilatation;
use crate::mesh::{Mat3, Vec3};

/// Cylindrical coordinates (r, phi, z), r <= l, to spherical ones: radius e^(z/l), azimuth phi, polar angle pi r / (2 l).
///
/// With s = r / l the stretches are e^(z/l) / l times 1, pi / 2 and m = sin(pi s / 2) / s in [1, pi / 2], so
/// K_I = m pi / 2 and K_O = pi^2 / (4 m); pi^2 / 4 is the supremum of both, of K_I on the axis and of K_O on the mantle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Zorich2 {
    /// l > 0: the radius of the cylinder.
    pub half_side: f64,
}

impl Zorich2 {
    /// m at s = r / l.
    pub(super) fn around(fraction: f64) -> f64 {
        if fraction == 0.0 { FRAC_PI_2 } else { (FRAC_PI_2 * fraction).sin() / fraction }
    }

    /// s = r / l.
    fn fraction(&self, x: &Vec3) -> Result<f64, MapError> {
        let fraction = x.x.hypot(x.y) / self.half_side;
        if fraction <= SLACK {
            Ok(fraction)
        } else {
            let radius = self.half_side;
            Err(self.outside(
                x,
                format!("its distance from the z-axis must be at most half_side = {radius}; move or shrink the mesh"),
            ))
        }
    }
}

impl ClosedForm for Zorich2 {
    fn name(&self) -> &'static str {
        "zorich2"
    }

    fn check(&self) -> Result<(), MapError> {
        positive("half_side", self.half_side)
    }

    fn value(&self, x: &Vec3) -> Result<Vec3, MapError> {
        let (sine, cosine) = (FRAC_PI_2 * self.fraction(x)?).sin_cos();
        let outward = Cylindrical::of(x).map_or_else(Vec3::zeros, |frame| frame.outward);
        Ok((x.z / self.half_side).exp() * (sine * outward + cosine * Vec3::z()))
    }

    fn jacobian(&self, x: &Vec3) -> Result<Mat3, MapError> {
        let fraction = self.fraction(x)?;
        let (sine, cosine) = (FRAC_PI_2 * fraction).sin_cos();
        let scale = (x.z / self.half_side).exp() / self.half_side;
        let Some(frame) = Cylindrical::of(x) else {
            return Ok(scale * Mat3::from_diagonal(&Vec3::new(FRAC_PI_2, FRAC_PI_2, 1.0)));
        };
        let along = sine * frame.outward + cosine * Vec3::z();
        let down = cosine * frame.outward - sine * Vec3::z();
        Ok(scale
            * (along * Vec3::z().transpose()
                + FRAC_PI_2 * down * frame.outward.transpose()
                + Self::around(fraction) * frame.around * frame.around.transpose()))
    }

    fn dilatation(&self, x: &Vec3) -> Result<Dilatation, MapError> {
        let around = Self::around(self.fraction(x)?);
        Ok(Dilatation { inner: FRAC_PI_2 * around, outer: FRAC_PI_2 * FRAC_PI_2 / around })
    }

    fn max_dilatation(&self) -> Option<Dilatation> {
        Some(Dilatation { inner: FRAC_PI_2 * FRAC_PI_2, outer: FRAC_PI_2 * FRAC_PI_2 })
    }
}

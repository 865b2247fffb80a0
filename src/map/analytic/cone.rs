//! The map of a cone onto another (paper eq. 12).

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use super::{ClosedForm, Cylindrical, MapError, SLACK, positive};
use crate::dilatation::Dilatation;
use crate::mesh::{Mat3, Vec3};

/// Spherical coordinates (r, phi, theta) -> (r, phi, q theta), theta the angle from the positive z-axis.
///
/// The stretches are 1, q and m(theta) = sin(q theta) / sin(theta), which is q on the axis and monotone in theta (x cot x
/// falls). As logarithms of K_I and K_O are convex in ln m, both have their suprema at the axis or at the cone's mantle.
/// Towards q theta = pi, or theta = pi, m tends to 0 or infinity: on the whole domain of the formula K has no bound.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Cone {
    /// q = beta / alpha > 0: the half-angle of the image cone over that of the cone.
    pub ratio: f64,
    /// The half-angle of the domain in radians, at most min(pi, pi / q); that if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angle: Option<f64>,
}

impl Cone {
    fn half_angle(&self) -> f64 {
        self.angle.unwrap_or(self.widest())
    }

    fn widest(&self) -> f64 {
        PI.min(PI / self.ratio)
    }

    /// The angle of a point from the positive z-axis.
    fn polar_angle(&self, x: &Vec3) -> Result<f64, MapError> {
        let angle = x.x.hypot(x.y).atan2(x.z);
        if angle <= self.half_angle() * SLACK {
            Ok(angle)
        } else {
            let limit = self.half_angle();
            Err(self.outside(
                x,
                format!(
                    "its angle {angle:.6} from the z-axis is above the cone's {limit:.6}; move the mesh into the cone"
                ),
            ))
        }
    }

    /// The stretch along the circles of latitude.
    fn around(&self, angle: f64) -> f64 {
        if angle == 0.0 { self.ratio } else { (self.ratio * angle).sin() / angle.sin() }
    }
}

impl ClosedForm for Cone {
    fn name(&self) -> &'static str {
        "cone"
    }

    fn check(&self) -> Result<(), MapError> {
        positive("ratio", self.ratio)?;
        let angle = self.half_angle();
        positive("angle", angle)?;
        if angle <= self.widest() * SLACK {
            Ok(())
        } else {
            let requirement = "it must be at most pi and pi / ratio (radians)";
            Err(MapError::Parameter { parameter: "angle", value: angle, requirement })
        }
    }

    fn value(&self, x: &Vec3) -> Result<Vec3, MapError> {
        let (sine, cosine) = (self.ratio * self.polar_angle(x)?).sin_cos();
        let norm = x.norm();
        let outward = Cylindrical::of(x).map_or_else(Vec3::zeros, |frame| frame.outward);
        Ok(norm * (sine * outward + cosine * Vec3::z()))
    }

    fn jacobian(&self, x: &Vec3) -> Result<Mat3, MapError> {
        let angle = self.polar_angle(x)?;
        if x.norm() == 0.0 {
            return Err(self.outside(x, "at the apex it has no derivative"));
        }
        let Some(frame) = Cylindrical::of(x) else {
            // On the axis the map stretches by q across.
            return Ok(Mat3::from_diagonal(&Vec3::new(self.ratio, self.ratio, 1.0)));
        };
        let along = |(sine, cosine): (f64, f64)| sine * frame.outward + cosine * Vec3::z();
        let down = |(sine, cosine): (f64, f64)| cosine * frame.outward - sine * Vec3::z();
        let (from, to) = (angle.sin_cos(), (self.ratio * angle).sin_cos());
        Ok(along(to) * along(from).transpose()
            + self.ratio * down(to) * down(from).transpose()
            + self.around(angle) * frame.around * frame.around.transpose())
    }

    fn dilatation(&self, x: &Vec3) -> Result<Dilatation, MapError> {
        let angle = self.polar_angle(x)?;
        Ok(Dilatation::of_stretches([1.0, self.ratio, self.around(angle)]))
    }

    fn max_dilatation(&self) -> Option<Dilatation> {
        let angle = self.half_angle();
        let axis = Dilatation::of_stretches([1.0, self.ratio, self.ratio]);
        if self.ratio == 1.0 {
            return Some(axis);
        }
        // The sine of a rounded pi is not 0.
        let mantle = if angle >= self.widest() * (2.0 - SLACK) {
            Dilatation::FLIPPED
        } else {
            Dilatation::of_stretches([1.0, self.ratio, self.around(angle)])
        };
        Some(Dilatation { inner: axis.inner.max(mantle.inner), outer: axis.outer.max(mantle.outer) })
    }
}

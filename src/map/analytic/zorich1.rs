//! The first factor of the Zorich map: a square cylinder onto a round one (paper eq. 16).

use serde::{Deserialize, Serialize};

use super::{ClosedForm, Cylindrical, MapError, SLACK, positive};
use crate::dilatation::Dilatation;
use crate::mesh::{Mat3, Vec3};

/// Stretches along its rays, in each plane z = const, the square |x|, |y| <= l onto the disc of radius l.
///
/// At the angle psi in [0, pi/4] from the nearer axis of the square, with t = tan psi and c = cos psi, the map is c times the
/// shear [[1, -t], [0, 1]] across the z-axis and 1 along it: the stretches are c sigma >= 1 >= c / sigma,
/// sigma = (t + sqrt(t^2 + 4)) / 2, so K_I = sigma^3 / c and K_O = c sigma^3. Both grow with t (their logarithms have the
/// derivatives 3 / sqrt(t^2 + 4) +- t / (1 + t^2) > 0); on the diagonals t = 1, sigma is the golden ratio g,
/// K_I = sqrt(2) g^3 = 5.9907 and K_O = g^3 / sqrt(2).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Zorich1 {
    /// l > 0.
    pub half_side: f64,
}

/// A point of the square as seen from its centre.
pub(super) struct InSquare {
    /// The larger of |x| and |y|: the radius of the image.
    pub(super) reach: f64,
    /// The tangent of the angle from the nearer axis, in [-1, 1]: positive if the azimuth grows away from the axis.
    pub(super) tangent: f64,
}

impl InSquare {
    pub(super) fn of(x: &Vec3) -> Self {
        if x.x.abs() >= x.y.abs() {
            Self { reach: x.x.abs(), tangent: if x.x == 0.0 { 0.0 } else { x.y / x.x } }
        } else {
            Self { reach: x.y.abs(), tangent: -x.x / x.y }
        }
    }

    /// c = cos psi.
    pub(super) fn cosine(&self) -> f64 {
        1.0 / 1f64.hypot(self.tangent)
    }
}

impl Zorich1 {
    /// Where a point lies in the square.
    pub(super) fn place(&self, x: &Vec3) -> Result<InSquare, MapError> {
        let place = InSquare::of(x);
        if place.reach <= self.half_side * SLACK {
            Ok(place)
        } else {
            let side = self.half_side;
            Err(self.outside(x, format!("|x| and |y| must be at most half_side = {side}; move or shrink the mesh")))
        }
    }
}

impl ClosedForm for Zorich1 {
    fn name(&self) -> &'static str {
        "zorich1"
    }

    fn check(&self) -> Result<(), MapError> {
        positive("half_side", self.half_side)
    }

    fn value(&self, x: &Vec3) -> Result<Vec3, MapError> {
        let place = self.place(x)?;
        let outward = Cylindrical::of(x).map_or_else(Vec3::zeros, |frame| frame.outward);
        Ok(place.reach * outward + x.z * Vec3::z())
    }

    fn jacobian(&self, x: &Vec3) -> Result<Mat3, MapError> {
        let place = self.place(x)?;
        let frame = Cylindrical::of(x).ok_or_else(|| self.outside(x, "on the z-axis it has no derivative"))?;
        let across = frame.outward * (frame.outward - place.tangent * frame.around).transpose()
            + frame.around * frame.around.transpose();
        Ok(place.cosine() * across + Vec3::z() * Vec3::z().transpose())
    }

    fn dilatation(&self, x: &Vec3) -> Result<Dilatation, MapError> {
        let place = self.place(x)?;
        Ok(stretches(place.tangent.abs(), place.cosine()))
    }

    fn max_dilatation(&self) -> Option<Dilatation> {
        Some(stretches(1.0, std::f64::consts::FRAC_1_SQRT_2))
    }
}

/// The dilatations at tangent t and cosine c.
fn stretches(t: f64, c: f64) -> Dilatation {
    let sigma = 0.5 * (t + t.hypot(2.0));
    Dilatation { inner: sigma.powi(3) / c, outer: c * sigma.powi(3) }
}

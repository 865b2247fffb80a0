//! The Zorich map of a square cylinder onto a half-space (paper eq. 16-18).

use std::f64::consts::FRAC_PI_2;

use serde::{Deserialize, Serialize};

use super::{ClosedForm, MapError, Zorich1, Zorich2, positive};
use crate::dilatation::Dilatation;
use crate::mesh::{Mat3, Vec3};

/// Z = Z2 after Z1, on |x|, |y| <= l.
///
/// With t, c of [`Zorich1`] and m of [`Zorich2`] at s = max(|x|, |y|) / l, the Jacobian is a similarity times the block
/// c [[pi/2, -t pi/2], [0, m]] and a 1. The block's singular values p >= q have p q = c^2 m pi / 2 and
/// p^2 + q^2 = pi^2 / 4 + c^2 m^2. K_I and K_O are largest at the edges of the cylinder, t = 1 and m = 1: K_I = 7.3627,
/// K_O = 5.7826. (That this is the maximum over all c in [1/sqrt 2, 1], m in [1, pi/2] is checked on a grid, not proved.)
/// A ball of radius l at the origin stays at s <= 1/sqrt 2 where t = 1, and has sup K = 5.07.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Zorich {
    /// l > 0; for a model at the origin the paper takes l = a R with R the radius of its bounding cylinder, a >= 1.
    pub half_side: f64,
}

impl Zorich {
    fn factors(&self) -> (Zorich1, Zorich2) {
        (Zorich1 { half_side: self.half_side }, Zorich2 { half_side: self.half_side })
    }

    fn renamed(&self, error: MapError) -> MapError {
        match error {
            MapError::Outside { at, reason, .. } => MapError::Outside { map: self.name(), at, reason },
            other => other,
        }
    }
}

/// The dilatations for cos psi = c and the stretch m along the circles of latitude.
fn dilatation(c: f64, m: f64) -> Dilatation {
    let product = c * c * m * FRAC_PI_2;
    // p - q from (p - q)^2 = (pi/2 - c^2 m)^2 + c^2 m^2 (1 - c^2): no digits are lost where p and q are close.
    let difference = (FRAC_PI_2 - c * c * m).hypot(c * m * ((1.0 - c) * (1.0 + c)).sqrt());
    let larger = 0.5 * (difference + difference.hypot(2.0 * product.sqrt()));
    Dilatation::of_stretches([larger, product / larger, 1.0])
}

impl ClosedForm for Zorich {
    fn name(&self) -> &'static str {
        "zorich"
    }

    fn check(&self) -> Result<(), MapError> {
        positive("half_side", self.half_side)
    }

    fn value(&self, x: &Vec3) -> Result<Vec3, MapError> {
        let (first, second) = self.factors();
        first.value(x).and_then(|y| second.value(&y)).map_err(|error| self.renamed(error))
    }

    fn jacobian(&self, x: &Vec3) -> Result<Mat3, MapError> {
        let (first, second) = self.factors();
        let both = || Ok(second.jacobian(&first.value(x)?)? * first.jacobian(x)?);
        both().map_err(|error| self.renamed(error))
    }

    fn dilatation(&self, x: &Vec3) -> Result<Dilatation, MapError> {
        let place = self.factors().0.place(x).map_err(|error| self.renamed(error))?;
        Ok(dilatation(place.cosine(), Zorich2::around(place.reach / self.half_side)))
    }

    fn max_dilatation(&self) -> Option<Dilatation> {
        Some(dilatation(std::f64::consts::FRAC_1_SQRT_2, 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nowhere_more_than_at_the_edges_of_the_cylinder() {
        let most = Zorich { half_side: 1.0 }.max_dilatation().unwrap();
        // The factor allows for rounding at the maximum itself.
        for i in 0..=400 {
            for j in 0..=400 {
                let tangent = f64::from(i) / 400.0;
                let at = dilatation(1.0 / 1f64.hypot(tangent), Zorich2::around(f64::from(j) / 400.0));
                assert!(at.inner <= most.inner * (1.0 + 1e-14) && at.outer <= most.outer * (1.0 + 1e-14));
            }
        }
        // p^2 + q^2 = pi^2 / 4 + 1/2 and p q = pi / 4, by the other formula.
        let (sum, product) = (FRAC_PI_2.powi(2) + 0.5, FRAC_PI_2 / 2.0);
        let [plus, minus] = [(sum + 2.0 * product).sqrt(), (sum - 2.0 * product).sqrt()];
        let (p, q) = (0.5 * (plus + minus), 0.5 * (plus - minus));
        assert!((most.inner - p / (q * q)).abs() < 1e-13 && (most.outer - p * p / q).abs() < 1e-13);
    }

    #[test]
    fn a_ball_of_the_cylinders_radius_stays_below_5_08() {
        // At distance 1 on the diagonals x = y of the plane z = 0.
        let at = Zorich { half_side: 1.0 }.dilatation(&Vec3::new(0.5f64.sqrt(), 0.5f64.sqrt(), 0.0)).unwrap();
        assert!((at.k() - 5.07).abs() < 5e-3, "{at:?}");
    }
}

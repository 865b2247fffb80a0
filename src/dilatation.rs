//! The dilatations of one Jacobian (paper eq. 4-8).

use serde::{Deserialize, Deserializer, Serialize};

use crate::linalg::{Mat3, svd};

/// Inner and outer dilatation of an orientation-preserving linear map; both scale-free ratios in `[1, inf]`.
///
/// With singular values s1 >= s2 >= s3 > 0: `inner = s1 s2 / s3^2`, `outer = s1^2 / (s2 s3)`. Both are 1 exactly for
/// similarities, invariant under similarities on either side, exchanged by inversion of the map, and with
/// H = s1 / s3: `inner * outer = H^3`, `H^(3/2) <= max(inner, outer) <= H^2`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Dilatation {
    /// K_I.
    pub inner: f64,
    /// K_O.
    pub outer: f64,
}

impl Dilatation {
    /// The dilatation of a map that does not preserve orientation or is singular: infinite.
    pub const FLIPPED: Self = Self { inner: f64::INFINITY, outer: f64::INFINITY };

    /// The dilatations of the linear map `jacobian`: [`Dilatation::FLIPPED`] where its determinant is not positive, and
    /// growing without bound as det -> 0.
    pub fn of(jacobian: &Mat3) -> Self {
        Self::of_singular_values(svd(jacobian).values)
    }

    /// The dilatations of the linear map with the signed singular values `s1 >= s2 >= |s3|`, as for [`Dilatation::of`].
    pub fn of_singular_values([s1, s2, s3]: [f64; 3]) -> Self {
        if s3 <= 0.0 {
            return Self::FLIPPED;
        }
        Self { inner: (s1 / s3) * (s2 / s3), outer: (s1 / s2) * (s1 / s3) }
    }

    /// The dilatations of a linear map with the given singular values, in any order and of any sign: those of |det|, so
    /// that a map that reverses orientation counts like its mirror image. Infinite if one of them is 0.
    pub fn of_stretches(stretches: [f64; 3]) -> Self {
        let mut stretches = stretches.map(f64::abs);
        stretches.sort_unstable_by(|a, b| b.total_cmp(a));
        let [s1, s2, s3] = stretches;
        if s3 == 0.0 { Self::FLIPPED } else { Self { inner: (s1 / s3) * (s2 / s3), outer: (s1 / s2) * (s1 / s3) } }
    }

    /// K = max(K_I, K_O).
    pub fn k(self) -> f64 {
        self.inner.max(self.outer)
    }
}

/// Reads a number of JSON, where `null` stands for infinity.
///
/// # Errors
/// What is neither.
pub(crate) fn null_is_infinite<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
}

/// A dilatation in at most 9 characters, rounded to nearest.
pub(crate) fn number(x: f64) -> String {
    if !x.is_finite() {
        "inf".into()
    } else if x < 1e4 {
        format!("{x:.4}")
    } else {
        format!("{x:.3e}")
    }
}

/// A lower bound like a [`number`], but rounded down, so that no more is claimed than is proved.
pub(crate) fn lower_bound(x: f64) -> String {
    towards(x, -last_digit(x), number)
}

/// An upper bound like a [`number`], but rounded up.
#[cfg(feature = "cli")]
pub(crate) fn upper_bound(x: f64) -> String {
    towards(x, last_digit(x), number)
}

/// An upper bound with that many decimals, rounded up.
#[cfg(feature = "cli")]
pub(crate) fn rounded_up(x: f64, decimals: usize) -> String {
    towards(x, 0.1f64.powi(decimals as i32), |x| format!("{x:.decimals$}"))
}

/// One unit of the last digit that a [`number`] shows.
fn last_digit(x: f64) -> f64 {
    if x < 1e4 { 1e-4 } else { 10f64.powf(x.log10().floor() - 3.0) }
}

/// What `show` makes of `x`, which it rounds to nearest, or of `x + unit` if that was on the other side of `x`.
fn towards(x: f64, unit: f64, show: impl Fn(f64) -> String) -> String {
    /// Relative, so that a closed form is shown as it is known whatever its last bits: 4 - 1e-12 as 4.0000.
    const ROUNDING: f64 = 1e-9;
    let nearest = show(x);
    // The difference is NaN, and nothing is changed, where x is infinite.
    let other_side = nearest.parse().is_ok_and(|shown: f64| (x - shown) * unit.signum() > ROUNDING * x.abs());
    if other_side { show(x + unit) } else { nearest }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_rounded_to_the_safe_side() {
        let cases = [
            (4.98705, "4.9870", "4.9871"),
            (4.98709, "4.9870", "4.9871"),
            (4.98701, "4.9870", "4.9871"),
            (3.7, "3.7000", "3.7000"),
            (4.0 - 1e-12, "4.0000", "4.0000"),
            (4.0 + 1e-12, "4.0000", "4.0000"),
            (9999.99996, "9999.9999", "10000.0000"),
            (1e4, "1.000e4", "1.000e4"),
            (99_996.0, "9.999e4", "1.000e5"),
            (100_040.0, "1.000e5", "1.001e5"),
            (f64::INFINITY, "inf", "inf"),
        ];
        for (x, down, up) in cases {
            assert_eq!((lower_bound(x), upper_bound(x)), (down.into(), up.into()), "{x}");
        }
        assert_eq!([rounded_up(4.71, 1), rounded_up(50.0, 1), rounded_up(50.0, 4)], ["4.8", "50.0", "50.0000"]);
    }

    use proptest::prelude::*;

    fn matrix() -> impl Strategy<Value = Mat3> {
        prop::array::uniform9(-1.0..1.0f64)
            .prop_map(|entries| Mat3::from_row_slice(&entries))
            .prop_filter("well-conditioned and positive", |m| m.determinant() > 1e-3)
    }

    proptest! {
        #[test]
        fn identities(a in matrix()) {
            let d = Dilatation::of(&a);
            let s = svd(&a).values;
            let h = s[0] / s[2];
            // Condition up to about 1e4 for det > 1e-3, so relative errors stay near 1e4 * eps = 2e-12.
            let close = |x: f64, y: f64| (x - y).abs() <= 1e-10 * y;
            prop_assert!(close(d.inner * d.outer, h.powi(3)));
            prop_assert!(d.k() >= h.powf(1.5) * (1.0 - 1e-10) && d.k() <= h * h * (1.0 + 1e-10));
            prop_assert!(d.outer <= d.inner.powi(2) * (1.0 + 1e-10) && d.inner <= d.outer.powi(2) * (1.0 + 1e-10));
            let inverse = Dilatation::of(&a.try_inverse().unwrap());
            prop_assert!(close(inverse.inner, d.outer) && close(inverse.outer, d.inner));
            let turned = Dilatation::of(&(nalgebra::Rotation3::from_euler_angles(0.1, 0.2, 0.3) * a * 7.5));
            prop_assert!(close(turned.inner, d.inner) && close(turned.outer, d.outer));
        }
    }

    #[test]
    fn closed_forms() {
        let d = Dilatation::of(&Mat3::from_diagonal(&nalgebra::Vector3::new(1.0, 4.0, 2.0)));
        assert_eq!((d.inner, d.outer), (8.0, 8.0));
        assert_eq!(Dilatation::of(&Mat3::identity()), Dilatation { inner: 1.0, outer: 1.0 });
        let mirror = Mat3::from_diagonal(&nalgebra::Vector3::new(1.0, 1.0, -1.0));
        assert_eq!(Dilatation::of(&mirror), Dilatation::FLIPPED);
        assert_eq!(Dilatation::of(&Mat3::zeros()), Dilatation::FLIPPED);
    }
}

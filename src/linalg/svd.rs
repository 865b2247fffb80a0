//! Singular value decomposition of 3x3 matrices: sorted, signed, accurate to the last bits.

use super::{Mat3, Vec3};

/// `a = left * diag(values) * right^T` with rotations `left` and `right`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Svd {
    /// Rotation whose columns are the left singular vectors.
    pub left: Mat3,
    /// `values[0] >= values[1] >= |values[2]|`; the last one carries the sign of the determinant.
    pub values: [f64; 3],
    /// Rotation whose columns are the right singular vectors.
    pub right: Mat3,
}

/// Cosine between two columns below which they count as orthogonal: a few units in the last place, so that the error of
/// a singular value (quadratic in it) is far below rounding.
const ORTHOGONAL: f64 = 1e-15;

/// Sweeps always needed so far: 5 to 7 (cyclic Jacobi converges quadratically); the cap only bounds the loop.
const MAX_SWEEPS: usize = 30;

/// The signed singular value decomposition by one-sided (Hestenes) Jacobi rotations on the columns of `a` itself.
///
/// Working on `a`, not on `a^T a`, keeps small relative differences between singular values: near-conformal Jacobians,
/// where K - 1 is small, are where a cubic on `a^T a` loses half of the digits. Singular values of a determinant 0
/// matrix come out as 0 with an arbitrary orthonormal completion. Entries must be finite and neither overflow nor
/// underflow when squared.
pub fn svd(a: &Mat3) -> Svd {
    let mut columns = [a.column(0).into_owned(), a.column(1).into_owned(), a.column(2).into_owned()];
    let mut right = [Vec3::x(), Vec3::y(), Vec3::z()];
    for _ in 0..MAX_SWEEPS {
        let mut rotated = false;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let (pp, qq, pq) = (columns[p].norm_squared(), columns[q].norm_squared(), columns[p].dot(&columns[q]));
            if pq == 0.0 || pq.abs() <= ORTHOGONAL * (pp * qq).sqrt() {
                continue;
            }
            rotated = true;
            let zeta = (qq - pp) / (2.0 * pq);
            let tangent = zeta.signum() / (zeta.abs() + (1.0 + zeta * zeta).sqrt());
            let cosine = 1.0 / (1.0 + tangent * tangent).sqrt();
            let sine = cosine * tangent;
            for vectors in [&mut columns, &mut right] {
                let (u, v) = (vectors[p], vectors[q]);
                vectors[p] = u * cosine - v * sine;
                vectors[q] = u * sine + v * cosine;
            }
        }
        if !rotated {
            break;
        }
    }
    let norms = columns.map(|c| c.norm());
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| norms[j].total_cmp(&norms[i]));
    let [first, second, third] = order;
    // Both factors are made rotations by construction; the sign of the determinant lands on the last value.
    let right = [right[first], right[second], right[first].cross(&right[second])];
    let u0 = if norms[first] > 0.0 { columns[first] / norms[first] } else { Vec3::x() };
    let u1 = if norms[second] > 0.0 { columns[second] / norms[second] } else { any_orthogonal(&u0) };
    let u2 = u0.cross(&u1);
    // The third column of a * right, up to the sign that the cross product may have changed.
    let last = a * right[2];
    let sign = if last.dot(&u2) < 0.0 { -1.0 } else { 1.0 };
    Svd {
        left: Mat3::from_columns(&[u0, u1, u2]),
        values: [norms[first], norms[second], sign * norms[third]],
        right: Mat3::from_columns(&right),
    }
}

fn any_orthogonal(u: &Vec3) -> Vec3 {
    let axis = if u.x.abs() < 0.6 { Vec3::x() } else { Vec3::y() };
    u.cross(&axis).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn rotation() -> impl Strategy<Value = Mat3> {
        (prop::array::uniform3(-1.0..1.0f64), -3.1..3.1f64).prop_filter_map("axis", |(axis, angle)| {
            let axis = nalgebra::Unit::try_new(Vec3::from(axis), 1e-3)?;
            Some(nalgebra::Rotation3::from_axis_angle(&axis, angle).into_inner())
        })
    }

    /// Singular values that include repeated, near-repeated, tiny, huge and signed ones.
    fn values() -> impl Strategy<Value = [f64; 3]> {
        let pick = prop_oneof![Just(1.0), Just(1.0 + 1e-9), Just(1e-8), Just(1e-60), Just(1e60), 0.1..10.0f64,];
        (prop::array::uniform3(pick), any::<bool>()).prop_map(|(mut s, negative)| {
            s.sort_by(|a, b| b.total_cmp(a));
            if negative {
                s[2] = -s[2];
            }
            s
        })
    }

    proptest! {
        #[test]
        fn rebuilds_sorted_and_signed(u in rotation(), v in rotation(), s in values()) {
            let a = u * Mat3::from_diagonal(&Vec3::from(s)) * v.transpose();
            let d = svd(&a);
            // Backward error of one-sided Jacobi: a modest multiple of eps * |a|; 1e-14 leaves a factor of about 45.
            let scale = s[0];
            let rebuilt = d.left * Mat3::from_diagonal(&Vec3::from(d.values)) * d.right.transpose();
            prop_assert!((rebuilt - a).norm() <= 1e-14 * scale);
            prop_assert!(d.values[0] >= d.values[1] && d.values[1] >= d.values[2].abs());
            for (got, want) in d.values.iter().zip(s) {
                prop_assert!((got - want).abs() <= 1e-14 * scale);
            }
            for rotation in [d.left, d.right] {
                prop_assert!((rotation.transpose() * rotation - Mat3::identity()).norm() <= 1e-14);
                prop_assert!((rotation.determinant() - 1.0).abs() <= 1e-14);
            }
        }
    }

    #[test]
    fn near_conformal_keeps_the_difference() {
        // A cubic on a^T a would return s1 - s3 with an absolute error of sqrt(eps) here.
        let (u, v) = (
            nalgebra::Rotation3::from_euler_angles(0.3, 1.1, -0.7).into_inner(),
            nalgebra::Rotation3::from_euler_angles(-1.2, 0.4, 2.0).into_inner(),
        );
        let a = u * Mat3::from_diagonal(&Vec3::new(1.0 + 1e-10, 1.0, 1.0 - 1e-10)) * v;
        let d = svd(&a);
        // Forming `a` rounds at 1e-16 an entry, hence 1e-15.
        assert!((d.values[0] - d.values[2] - 2e-10).abs() < 1e-15);
    }

    #[test]
    fn zero_and_rank_one_have_an_orthonormal_completion() {
        for a in [Mat3::zeros(), Vec3::new(1.0, 2.0, 2.0) * Vec3::x().transpose()] {
            let d = svd(&a);
            assert!((d.left.determinant() - 1.0).abs() < 1e-14);
            assert!(d.values[1] == 0.0 && d.values[2] == 0.0);
        }
    }
}

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
/// a singular value (at most of first order in it) is of the size of rounding.
const ORTHOGONAL: f64 = 1e-15;

/// Bound on the cosine between two columns, over the relative gap of their squared norms, below which a sweep is the last
/// one. That quotient is also the angle of the rotation, so what the sweep's later rotations bring back into a cosine that
/// was made 0 is of the order of the square of this, below [`ORTHOGONAL`].
const SETTLED: f64 = 1e-8;

/// Sweeps over the Gram matrix: after three nothing but rounding is left off the diagonal of most.
const GRAM_SWEEPS: usize = 3;

/// Sweeps over the columns needed: 1, for some in a hundred 2, of 500,000 matrices of condition up to 1e4 none 3. The cap
/// only bounds the loop.
const MAX_SWEEPS: usize = 30;

/// Matrices that [`svds`] is best called with at once.
pub const LANES: usize = 8;

/// Axis pairs (p, q) of a sweep and the third axis.
const PAIRS: [(usize, usize, usize); 3] = [(0, 1, 2), (0, 2, 1), (1, 2, 0)];

/// The signed singular value decomposition by one-sided (Hestenes) Jacobi rotations on the columns of `a` itself, from a
/// first frame that nearly diagonalises `a^T a`.
///
/// Ending on `a`, not on `a^T a`, keeps small relative differences between singular values: near-conformal Jacobians,
/// where K - 1 is small, are where a cubic on `a^T a` loses half of the digits. Singular values of a determinant 0
/// matrix come out as 0 with an arbitrary orthonormal completion. Entries must be finite, and their fourth powers neither
/// overflow nor underflow.
pub fn svd(a: &Mat3) -> Svd {
    let [decomposition] = svds(&[*a]);
    decomposition
}

/// The same of several matrices, bit for bit; with [`LANES`] of them in less than half of the time, since the rotations of
/// `a^T a` are computed in lock step, which hides the latency of their divisions and roots.
pub fn svds<const N: usize>(matrices: &[Mat3; N]) -> [Svd; N] {
    let frames = gram_frames(matrices);
    std::array::from_fn(|lane| from_frame(&matrices[lane], frames[lane]))
}

/// For each matrix three orthonormal vectors that nearly diagonalise `a^T a`, by a fixed number of Jacobi's sweeps.
fn gram_frames<const N: usize>(matrices: &[Mat3; N]) -> [[Vec3; 3]; N] {
    let gram = |i: usize, j: usize| -> [f64; N] {
        std::array::from_fn(|lane| matrices[lane].column(i).dot(&matrices[lane].column(j)))
    };
    let mut diagonal = [0, 1, 2].map(|i| gram(i, i));
    // The entry off the diagonal of the two axes other than the index.
    let mut off = [gram(1, 2), gram(0, 2), gram(0, 1)];
    let mut frame: [[[f64; N]; 3]; 3] = [0, 1, 2].map(|i| [0, 1, 2].map(|j| [f64::from(u8::from(i == j)); N]));
    for (p, q, r) in [PAIRS; GRAM_SWEEPS].into_iter().flatten() {
        let (mut at_p, mut at_q, between) = (diagonal[p], diagonal[q], off[r]);
        let (mut from_p, mut from_q) = (off[q], off[p]);
        let (mut cosine, mut sine) = ([0.0; N], [0.0; N]);
        // Without branches and on plain arrays, so that the compiler makes vector instructions of it.
        for lane in 0..N {
            let half = 0.5 * (at_q[lane] - at_p[lane]);
            let pq = between[lane];
            // The smallest number keeps 0 / 0 away.
            let root = (pq * pq + half * half).sqrt() + f64::MIN_POSITIVE;
            let tangent = pq.copysign(pq * half) / (half.abs() + root);
            cosine[lane] = 1.0 / (1.0 + tangent * tangent).sqrt();
            sine[lane] = cosine[lane] * tangent;
            at_p[lane] -= tangent * pq;
            at_q[lane] += tangent * pq;
        }
        rotate(&mut from_p, &mut from_q, &cosine, &sine);
        (diagonal[p], diagonal[q]) = (at_p, at_q);
        (off[r], off[q], off[p]) = ([0.0; N], from_p, from_q);
        let (mut first, mut second) = (frame[p], frame[q]);
        for (x, y) in first.iter_mut().zip(&mut second) {
            rotate(x, y, &cosine, &sine);
        }
        (frame[p], frame[q]) = (first, second);
    }
    std::array::from_fn(|lane| [0, 1, 2].map(|i| Vec3::new(frame[i][0][lane], frame[i][1][lane], frame[i][2][lane])))
}

fn rotate<const N: usize>(x: &mut [f64; N], y: &mut [f64; N], cosine: &[f64; N], sine: &[f64; N]) {
    for lane in 0..N {
        let (u, v) = (x[lane], y[lane]);
        x[lane] = u * cosine[lane] - v * sine[lane];
        y[lane] = u * sine[lane] + v * cosine[lane];
    }
}

/// One-sided Jacobi from `a * right`, whose columns are nearly orthogonal.
fn from_frame(a: &Mat3, mut right: [Vec3; 3]) -> Svd {
    let mut columns = right.map(|v| a * v);
    for _ in 0..MAX_SWEEPS {
        let mut settled = true;
        for (p, q, _) in PAIRS {
            let (pp, qq, pq) = (columns[p].norm_squared(), columns[q].norm_squared(), columns[p].dot(&columns[q]));
            let scale = (pp * qq).sqrt();
            if pq == 0.0 || pq.abs() <= ORTHOGONAL * scale {
                continue;
            }
            settled &= pq.abs() * pp.max(qq) <= SETTLED * (qq - pp).abs() * scale;
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
        if settled {
            break;
        }
    }
    let norms = columns.map(|c| c.norm());
    let mut order = [0, 1, 2];
    for (i, j) in [(0, 1), (1, 2), (0, 1)] {
        if norms[order[i]] < norms[order[j]] {
            order.swap(i, j);
        }
    }
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
        fn several_at_once_are_the_same_bits(entries in prop::array::uniform32(-1.0..1.0f64)) {
            let matrices: [Mat3; LANES] = std::array::from_fn(|i| Mat3::from_fn(|r, c| entries[(5 * i + 3 * r + c) % 32]));
            prop_assert_eq!(svds(&matrices), matrices.map(|a| svd(&a)));
        }

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

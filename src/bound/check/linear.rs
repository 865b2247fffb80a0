//! Maps of tets and triangles with all vertices fixed.

use super::{Point, gradients};
use crate::bound::Kind;
use crate::linalg::interval::{Interval, cross, difference, dot, exact_vector, norm_squared};
use crate::mesh::Vec3;

/// A number at most K of the linear map A that takes the corners of a tet to their images, from two vectors v and w: nearly K for
/// the right singular vectors of the largest and the smallest singular value; nothing if the map is not shown to preserve
/// orientation.
///
/// `K_O = s1^3 / d >= |A v|^3 / (|v|^3 d)` and, the largest singular value of cof A being s1 s2,
/// `K_I = (s1 s2)^3 / d^2 >= |cof A w|^3 / (|w|^3 d^2)`, with d = det A, for any v and w.
pub(in crate::bound) fn locked(corners: [Point; 4], image: [Vec3; 4], [v, w]: [Vec3; 2]) -> Option<f64> {
    let g = gradients(corners)?;
    let edges = [1, 2, 3].map(|i| difference(&image[i], &image[0]));
    let determinant = dot(edges[0], cross(edges[1], edges[2])) * dot(g[1], cross(g[2], g[3]));
    if determinant.lower.is_nan() || determinant.lower <= 0.0 {
        return None;
    }
    // A = sum of e_i g_i^T, cof A = sum of (e_i x e_j) (g_i x g_j)^T over the cyclic pairs.
    let combination = |vectors: [[Interval; 3]; 3], weights: [Interval; 3]| {
        [0, 1, 2].map(|row| (0..3).map(|i| vectors[i][row] * weights[i]).sum::<Interval>())
    };
    let (exact_v, exact_w) = (exact_vector(&v), exact_vector(&w));
    let stretched = combination(edges, [1, 2, 3].map(|i| dot(g[i], exact_v)));
    let normals = [cross(edges[1], edges[2]), cross(edges[2], edges[0]), cross(edges[0], edges[1])];
    let areas = combination(normals, [(2, 3), (3, 1), (1, 2)].map(|(i, j)| dot(cross(g[i], g[j]), exact_w)));
    let ratio = |vector: [Interval; 3], unit: [Interval; 3]| {
        let square = norm_squared(vector) / norm_squared(unit);
        square * square.sqrt()
    };
    let outer = ratio(stretched, exact_v) / determinant;
    let inner = ratio(areas, exact_w) / determinant.square();
    Some(outer.lower.max(inner.lower)).filter(|value| value.is_finite())
}

/// Whether the linear map A that takes the corners of a tet to their images is shown to preserve orientation and to have a
/// dilatation of that kind below `level`.
///
/// `K_O = s1^3 / d < k` if `(k d)^(2/3) I - A^T A` is positive definite, and `K_I = |cof A|^3 / d^2 < k` if
/// `k^(2/3) d^(4/3) I - (cof A)^T cof A` is; that is, if their leading minors are positive.
pub(in crate::bound) fn is_below(corners: [Point; 4], image: [Vec3; 4], kind: Kind, level: f64) -> bool {
    let Some(g) = gradients(corners) else { return false };
    let edges = [1, 2, 3].map(|i| difference(&image[i], &image[0]));
    let determinant = dot(edges[0], cross(edges[1], edges[2])) * dot(g[1], cross(g[2], g[3]));
    if determinant.lower.is_nan() || determinant.lower <= 0.0 {
        return false;
    }
    // The columns of A and of its matrix of cofactors.
    let columns = [0, 1, 2].map(|j| [0, 1, 2].map(|row| (0..3).map(|i| edges[i][row] * g[i + 1][j]).sum::<Interval>()));
    let [a, b, c] = columns;
    let cofactors = [cross(b, c), cross(c, a), cross(a, b)];
    let above = |square: Interval, columns: [[Interval; 3]; 3]| {
        let m = [0, 1, 2].map(|i| {
            [0, 1, 2].map(|j| {
                let product = -dot(columns[i], columns[j]);
                if i == j { square + product } else { product }
            })
        });
        let minors = [m[0][0], m[0][0] * m[1][1] - m[0][1].square(), dot(m[0], cross(m[1], m[2]))];
        minors.iter().all(|minor| minor.lower > 0.0)
    };
    let root = Interval::exactly(level).cbrt();
    let outer = || above((root * determinant.cbrt()).square(), columns);
    let inner = || above((root * determinant.cbrt().square()).square(), cofactors);
    (kind == Kind::Inner || outer()) && (kind == Kind::Outer || inner())
}

/// A number at most the ratio r1 / r2 >= 1 of the singular values of the linear map that takes one triangle to another; nothing
/// if one of them is not shown to have an area.
///
/// With sides a, b and their images a', b', `r1 / r2 + r2 / r1 = 2 c`,
/// `2 c |a x b| |a' x b'| = |b|^2 |a'|^2 - 2 (a . b) (a' . b') + |a|^2 |b'|^2`, since the squares of r1 and r2 are the eigenvalues of the
/// image's Gram matrix relative to the domain's. So r1 / r2 = c + (c^2 - 1)^(1/2).
pub(in crate::bound) fn stretch_ratio(domain: [Vec3; 3], image: [Vec3; 3]) -> Option<f64> {
    let sides = |[p, q, r]: [Vec3; 3]| [difference(&q, &p), difference(&r, &p)];
    let ([a, b], [c, d]) = (sides(domain), sides(image));
    let two = Interval::exactly(2.0);
    let sum = norm_squared(b) * norm_squared(c) - two * dot(a, b) * dot(c, d) + norm_squared(a) * norm_squared(d);
    let areas = norm_squared(cross(a, b)).sqrt() * norm_squared(cross(c, d)).sqrt();
    let half_sum = (sum * (two * areas).reciprocal()?).lower.max(1.0);
    let half_sum = Interval::exactly(half_sum);
    let ratio = half_sum + (half_sum.square() - Interval::ONE).sqrt();
    ratio.lower.is_finite().then_some(ratio.lower.max(1.0))
}

/// A number at most `1 / cos(theta)`, theta the angle between the normal of a triangle's plane and the ray from `centre` to its
/// first corner; nothing unless the triangle is shown to face away from the centre.
pub(in crate::bound) fn slant([p, q, r]: [Vec3; 3], centre: &Vec3) -> Option<f64> {
    let (ray, normal) = (difference(&p, centre), cross(difference(&q, &p), difference(&r, &p)));
    let height = dot(ray, normal);
    let ratio = (norm_squared(ray).sqrt() * norm_squared(normal).sqrt()) / height;
    (height.lower > 0.0 && ratio.lower.is_finite()).then_some(ratio.lower.max(1.0))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::dilatation::Dilatation;
    use crate::linalg::svd;
    use crate::mesh::Mat3;

    #[test]
    fn the_ratio_of_a_known_stretch() {
        let triangle = [Vec3::new(0.3, 0.1, 0.0), Vec3::new(1.2, -0.4, 0.0), Vec3::new(0.5, 2.0, 0.0)];
        let turn = nalgebra::Rotation3::from_euler_angles(0.4, 1.0, -0.8);
        for ratio in [1.0, 1.0 + 1e-9, 3.0, 1e5] {
            let image = triangle.map(|p| turn * Vec3::new(ratio * 0.7 * p.x, 0.7 * p.y, p.z));
            let found = stretch_ratio(triangle, image).unwrap();
            // The image has errors of eps and a condition of 5 times the ratio; near a similarity the ratio is 1 plus the root
            // of what the intervals leave of it.
            assert!(
                found <= ratio * (1.0 + 1e-15 * ratio) && found >= ratio * (1.0 - 1e-13 * ratio) - 1e-7,
                "{ratio} {found}"
            );
        }
    }

    #[test]
    fn degenerate_triangles_bound_nothing() {
        let triangle = [Vec3::x(), Vec3::y(), Vec3::z()];
        let flat = [Vec3::x(), Vec3::y(), (Vec3::x() + Vec3::y()) * 0.5];
        assert_eq!(stretch_ratio(triangle, flat), None);
        assert_eq!(stretch_ratio(triangle, [Vec3::x(); 3]), None);
        assert_eq!(stretch_ratio(triangle, [Vec3::x() * f64::NAN; 3]), None);
        assert_eq!(slant(triangle, &Vec3::repeat(1.0)), None);
        assert_eq!(slant(flat, &Vec3::zeros()), None);
        let up = slant(triangle, &Vec3::zeros()).unwrap();
        assert!(up <= 3f64.sqrt() && up > 3f64.sqrt() - 1e-14);
    }

    proptest! {
        #[test]
        fn never_above_the_truth(entries in prop::array::uniform9(-1.0..1.0f64), wrong in prop::array::uniform3(-1.0..1.0f64)) {
            let a = Mat3::from_row_slice(&entries);
            let decomposition = svd(&a);
            let s = decomposition.values;
            prop_assume!(s[2] > 1e-3);
            let corners = [Vec3::new(0.2, 0.1, 0.5), Vec3::new(1.0, 0.0, 0.1), Vec3::new(-0.3, 0.8, 0.0), Vec3::new(0.1, 0.2, 1.5)];
            let image = corners.map(|p| a * p);
            let triangle = |tet: [Vec3; 4]| [tet[0], tet[1], tet[2]];
            let ratio = stretch_ratio(triangle(corners), triangle(image)).unwrap();
            prop_assert!(ratio <= s[0] / s[2] * (1.0 + 1e-12));
            // The image's rounding: eps times the condition of both, below 1e5.
            let k = Dilatation::of(&a).k();
            let vectors = [0, 2].map(|i| decomposition.right.column(i).into_owned());
            let corners = corners.each_ref().map(exact_vector);
            let found = locked(corners, image, vectors).unwrap();
            prop_assert!(found <= k * (1.0 + 1e-9) && found >= k * (1.0 - 1e-9), "{found} {k}");
            prop_assert!(locked(corners, image, [Vec3::from(wrong); 2]).is_none_or(|found| found <= k * (1.0 + 1e-9)));
            let Dilatation { inner, outer } = Dilatation::of(&a);
            for (kind, value) in [(Kind::Inner, inner), (Kind::Outer, outer), (Kind::K, k)] {
                prop_assert!(is_below(corners, image, kind, value * (1.0 + 1e-8)));
                prop_assert!(!is_below(corners, image, kind, value * (1.0 - 1e-8)));
            }
            prop_assert!(!is_below(corners, image.map(|p| -p), Kind::K, 1e300));
        }
    }
}

//! How wide a triangle of the image's boundary opens as seen from the centre.
//!
//! A triangle with corners on the unit sphere whose plane lies at the distance h from the centre reaches to the angle a with cos a = h
//! about its normal. The radial map of its cone onto the cone's part of the ball takes a point at the angle b to itself times cos b / h;
//! in polar coordinates about the normal its derivative is cos b / h times the shear [[1, -tan b], [0, 1]], whose singular values
//! are s and 1 / s with s - 1 / s = tan b: K = s^3, largest where b = a. As h -> 0 it has no bound, though each tet may keep its K.

use crate::mesh::{Mat3, Vec3};

/// The distance of a triangle's plane from the origin over that of its first corner: positive where the triangle faces away from the
/// origin, NaN where it has no plane.
pub fn opening([a, b, c]: [&Vec3; 3]) -> f64 {
    let normal = (b - a).cross(&(c - a));
    normal.dot(a) / (normal.norm() * a.norm())
}

/// An [`opening`] and its first two derivatives where the first corner's distance from the origin is kept.
#[derive(Clone, Copy, Debug)]
pub struct OpeningDerivatives {
    /// The opening.
    pub value: f64,
    /// The derivative in each corner.
    pub gradient: [Vec3; 3],
    /// The second derivatives, rows by the first corner named.
    pub hessian: [[Mat3; 3]; 3],
}

impl OpeningDerivatives {
    /// Those of the distance h = d / |n| with d = det(a, b, c) and the normal n = (b - a) x (c - a), over the first corner's. All are NaN where
    /// the triangle has no plane.
    pub fn of(corners: [&Vec3; 3]) -> Self {
        let [a, b, c] = corners;
        let normal = (b - a).cross(&(c - a));
        let (length, determinant) = (normal.norm(), normal.dot(a));
        let of_determinant = [b.cross(c), c.cross(a), a.cross(b)];
        // dn = opposite x d(corner), and |n| changes by n . dn / |n|.
        let opposite = [c - b, a - c, b - a];
        let of_normal = opposite.map(|edge| edge.cross_matrix());
        let of_length = of_normal.map(|turn| turn.transpose() * normal / length);
        let radius = a.norm();
        let (h, scale) = (determinant / length, 1.0 / (length * radius));
        let gradient = [0, 1, 2].map(|i| (of_determinant[i] - of_length[i] * h) * scale);
        let second = |i: usize, j: usize| {
            // Second derivatives of d and of n . n / 2 between two corners, in the order in which they run round the triangle.
            let mixed = |i: usize| {
                let third = corners[(i + 2) % 3];
                (-third.cross_matrix(), -normal.cross_matrix())
            };
            let (of_determinant_twice, of_normal_twice) = match (j + 3 - i) % 3 {
                0 => (Mat3::zeros(), Mat3::zeros()),
                1 => mixed(i),
                _ => {
                    let (determinant, normal) = mixed(j);
                    (determinant.transpose(), normal.transpose())
                }
            };
            let of_length_twice = (of_normal[i].transpose() * of_normal[j] + of_normal_twice
                - of_length[i] * of_length[j].transpose())
                / length;
            let products = of_determinant[i] * of_length[j].transpose() + of_length[i] * of_determinant[j].transpose();
            let twice = of_length[i] * of_length[j].transpose() * (2.0 * h);
            (of_determinant_twice - of_length_twice * h + (twice - products) / length) * scale
        };
        let hessian = [0, 1, 2].map(|i| [0, 1, 2].map(|j| second(i, j)));
        Self { value: h / radius, gradient, hessian }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_derivatives_of_an_opening_match_differences() {
        let corners = [Vec3::new(0.9, 0.1, 0.3), Vec3::new(0.2, 0.8, 0.4), Vec3::new(0.1, 0.3, 0.9)];
        let radius = corners[0].norm();
        // With the first corner's distance as it is here.
        let at = |corners: &[Vec3; 3]| {
            let [a, b, c] = corners;
            let derivatives = OpeningDerivatives::of([a, b, c]);
            let scale = a.norm() / radius;
            (opening([a, b, c]) * scale, derivatives.gradient.map(|g| g * scale))
        };
        let derivatives = OpeningDerivatives::of([&corners[0], &corners[1], &corners[2]]);
        assert!((derivatives.value - at(&corners).0).abs() < 1e-15);
        let h = 1e-5;
        for i in 0..3 {
            for axis in 0..3 {
                let [mut more, mut less] = [corners, corners];
                more[i][axis] += h;
                less[i][axis] -= h;
                let ((above, slopes_above), (below, slopes_below)) = (at(&more), at(&less));
                // h^2 times third derivatives of order 10, and 1e-16 / h.
                let slope = (above - below) / (2.0 * h);
                assert!((slope - derivatives.gradient[i][axis]).abs() < 1e-8);
                for j in 0..3 {
                    let second = (slopes_above[j] - slopes_below[j]) / (2.0 * h);
                    let error = (second - derivatives.hessian[j][i].column(axis)).norm();
                    assert!(error < 1e-8, "corners {j} and {i}: {error:e}");
                }
            }
        }
    }
}

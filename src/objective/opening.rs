//! How wide a triangle of the image's boundary opens as seen from the centre.
//!
//! A triangle with corners on the unit sphere whose plane lies at the distance h from the centre reaches to the angle a with cos a = h
//! about its normal. The radial map of its cone onto the cone's part of the ball takes a point at the angle b to itself times cos b / h;
//! in polar coordinates about the normal its derivative is cos b / h times the shear [[1, -tan b], [0, 1]], whose singular values
//! are s and 1 / s with s - 1 / s = tan b: K = s^3, largest where b = a. As h -> 0 it has no bound, though each tet may keep its K.

use crate::mesh::Vec3;

/// The distance of a triangle's plane from the origin over that of its first corner: positive where the triangle faces away from the
/// origin, NaN where it has no plane.
pub fn opening([a, b, c]: [&Vec3; 3]) -> f64 {
    let normal = (b - a).cross(&(c - a));
    normal.dot(a) / (normal.norm() * a.norm())
}

/// How fast the distance of a triangle's plane from the origin changes where its corners move so: the foot of the origin's
/// perpendicular moves along the normal as the corners do, by its barycentric coordinates.
pub(super) fn change_of_distance([a, b, c]: [&Vec3; 3], motion: [Vec3; 3]) -> f64 {
    let normal = (b - a).cross(&(c - a));
    let square = normal.norm_squared();
    let foot = normal * (normal.dot(a) / square);
    let share = |from: &Vec3, to: &Vec3| normal.dot(&(from - foot).cross(&(to - foot))) / square;
    let moved = motion[0] * share(b, c) + motion[1] * share(c, a) + motion[2] * share(a, b);
    normal.dot(&moved) / square.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_change_of_distance_is_the_derivative() {
        let corners = [Vec3::new(0.9, 0.1, 0.3), Vec3::new(0.2, 0.8, 0.4), Vec3::new(0.1, 0.3, 0.9)];
        let motion = [Vec3::new(0.3, -0.2, 0.1), Vec3::new(-0.1, 0.4, 0.2), Vec3::new(0.2, 0.1, -0.5)];
        let distance = |t: f64| {
            let [a, b, c] = [0, 1, 2].map(|i| corners[i] + motion[i] * t);
            opening([&a, &b, &c]) * a.norm()
        };
        let h = 1e-5;
        // The error of central differences is h^2 times a third derivative of order 1, and 1e-16 / h.
        let difference = (distance(h) - distance(-h)) / (2.0 * h);
        let change = change_of_distance([&corners[0], &corners[1], &corners[2]], motion);
        assert!((change - difference).abs() < 1e-9, "{change} {difference}");
    }
}

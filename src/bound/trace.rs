//! The trace bound: triangles whose three vertices are fixed (bounds.md B1).

use super::{Kind, LowerBound, Place, rounded_down, strongest, three_halves_power, with_inner_and_outer};
use crate::domain::Domain;
use crate::mesh::{TetMesh, Vec3};

/// `K >= r^(3/2)`, and `K_I >= r`, `K_O >= r`, where r = r1 / r2 is the largest ratio of the two singular values of the
/// linear map of a triangle with three fixed vertices: of the boundary, or interior with all vertices on the boundary.
///
/// Holds for every piecewise-linear map of this mesh with these boundary positions.
///
/// **Proof**. In a tet at the triangle s1 >= |A v| >= s3 for every unit vector v; along the two principal directions of the
/// triangle's map this says s1 >= r1 and s3 <= r2, so H >= r. Attained, without shear, by the normal stretch
/// sqrt(r1 r2).
///
/// In floats: r is lowered by 64 eps times the condition of both triangles; degenerate ones bound nothing.
pub fn trace(domain: &Domain, image: &[Vec3]) -> Option<LowerBound> {
    let (mesh, boundary) = (domain.mesh(), domain.boundary());
    let fixed = mesh
        .tets()
        .iter()
        .flat_map(|tet| TetMesh::FACES.map(|face| face.map(|i| tet[i])))
        .filter(|triangle| triangle.iter().all(|&v| boundary.contains(v)));
    let ratios = fixed.filter_map(|triangle| {
        let ratio = stretch_ratio(triangle.map(|v| mesh.points()[v.index()]), triangle.map(|v| image[v.index()]))?;
        Some((ratio, triangle))
    });
    let (ratio, triangle) = strongest(ratios)?;
    Some(LowerBound::of_mesh(
        "trace",
        "docs of qcball::bound::trace",
        Kind::K,
        three_halves_power(ratio),
        Place::face(mesh, triangle),
        with_inner_and_outer("any PL map of this mesh with these boundary positions", ratio),
    ))
}

/// r1 / r2 of the linear map that takes one triangle to another, rounded down; nothing if one of them is degenerate.
fn stretch_ratio(domain: [Vec3; 3], image: [Vec3; 3]) -> Option<f64> {
    let ([x1, x2, y2], domain_condition) = frame(domain)?;
    let ([u1, u2, v2], image_condition) = frame(image)?;
    // M = [[u1, u2], [0, v2]] [[x1, x2], [0, y2]]^-1, upper triangular; its larger singular value from
    // (s1 +- s2)^2 = |M|^2 +- 2 det M, the smaller one from the determinant, which has no cancellation.
    let (a, d) = (u1 / x1, v2 / y2);
    let b = (u2 - a * x2) / y2;
    let larger = 0.5 * ((a + d).hypot(b) + (a - d).hypot(b));
    rounded_down((larger / a) * (larger / d), 64.0 * f64::EPSILON * (domain_condition + image_condition))
}

/// Two sides of a triangle in an orthonormal frame of its plane, `(x1, 0)` and `(x2, y2)`, and the condition of the pair
/// (sum of squared lengths over twice the area); nothing for a triangle so thin that rounding decides its area.
pub(super) fn frame([p, q, r]: [Vec3; 3]) -> Option<([f64; 3], f64)> {
    let (first, second) = (q - p, r - p);
    let (length, area) = (first.norm(), first.cross(&second).norm());
    let condition = (first.norm_squared() + second.norm_squared()) / area;
    // Also false for NaN.
    (condition < 1e12).then(|| ([length, first.dot(&second) / length, area / length], condition))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_ratio_of_a_known_stretch() {
        let triangle = [Vec3::new(0.3, 0.1, 0.0), Vec3::new(1.2, -0.4, 0.0), Vec3::new(0.5, 2.0, 0.0)];
        let turn = nalgebra::Rotation3::from_euler_angles(0.4, 1.0, -0.8);
        for ratio in [1.0, 1.0 + 1e-9, 3.0, 1e5] {
            let image = triangle.map(|p| turn * Vec3::new(ratio * 0.7 * p.x, 0.7 * p.y, p.z));
            let found = stretch_ratio(triangle, image).unwrap();
            // Rounded down by 64 eps (condition below 5 of the one and 5 * ratio of the other).
            assert!(found <= ratio * (1.0 + 1e-15) && found >= ratio * (1.0 - 1e-13 * ratio), "{ratio} {found}");
        }
    }

    #[test]
    fn degenerate_triangles_bound_nothing() {
        let triangle = [Vec3::x(), Vec3::y(), Vec3::z()];
        let flat = [Vec3::x(), Vec3::y(), (Vec3::x() + Vec3::y()) * 0.5];
        assert_eq!(stretch_ratio(triangle, flat), None);
        assert_eq!(stretch_ratio(triangle, [Vec3::x(); 3]), None);
        assert_eq!(stretch_ratio(triangle, [Vec3::x() * f64::NAN; 3]), None);
    }

    proptest! {
        #[test]
        fn never_above_the_ratio_of_singular_values(entries in prop::array::uniform9(-1.0..1.0f64)) {
            let a = crate::mesh::Mat3::from_row_slice(&entries);
            let s = crate::linalg::svd(&a).values;
            prop_assume!(s[2].abs() > 1e-3);
            let triangle = [Vec3::new(0.2, 0.1, 0.5), Vec3::new(1.0, 0.0, 0.1), Vec3::new(-0.3, 0.8, 0.0)];
            let ratio = stretch_ratio(triangle, triangle.map(|p| a * p)).unwrap();
            prop_assert!(ratio <= s[0] / s[2].abs() * (1.0 + 1e-12));
        }
    }
}

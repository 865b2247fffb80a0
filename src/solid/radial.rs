//! The dilatation of the radial map, in closed form.

use super::Surface;
use crate::mesh::Vec3;

/// The max K of the radial map of a polyhedron onto the unit ball, f(x) = u(x) x/|x| with u = |x| over the length of the
/// ray through x (paper eq. 20 with a = 1), about a centre that sees every triangle from within.
///
/// In the cone over a triangle whose plane is at distance h, at the angle theta from its normal, Df is cos(theta)/h times
/// a unit shear by t = tan theta: K = K_I = K_O = sigma^3 with sigma = (t + sqrt(t^2 + 4))/2 = exp(asinh(t/2)). The
/// largest t of a triangle is at its vertex farthest from the centre. Infinite if the centre lies in the plane of a
/// triangle or behind it. A ratio: no units.
pub fn radial_max_dilatation(surface: &Surface, centre: &Vec3) -> f64 {
    let largest = FacePlane::all(surface).iter().map(|plane| plane.squared_tangent(centre)).fold(0.0, f64::max);
    (3.0 * (largest.sqrt() / 2.0).asinh()).exp()
}

/// A triangle with the outward unit normal of its plane.
pub(super) struct FacePlane {
    pub(super) normal: Vec3,
    pub(super) corners: [Vec3; 3],
}

impl FacePlane {
    pub(super) fn all(surface: &Surface) -> Vec<Self> {
        surface.ids().map(|id| Self { normal: surface.normal(id), corners: surface.corners(id) }).collect()
    }

    /// The distance of the plane from a point inside; negative if the point is in front of it.
    pub(super) fn distance(&self, centre: &Vec3) -> f64 {
        self.normal.dot(&(self.corners[0] - centre))
    }

    /// The square of the largest tangent of the angle between the normal and a ray from the centre to a corner; infinite
    /// if the centre is not behind the plane.
    pub(super) fn squared_tangent(&self, centre: &Vec3) -> f64 {
        let distance = self.distance(centre);
        let reach = self.corners.iter().map(|corner| self.reach(corner, centre)).fold(0.0, f64::max);
        if distance > 0.0 { reach / (distance * distance) } else { f64::INFINITY }
    }

    /// The squared distance from a corner to the foot of the perpendicular from the centre.
    fn reach(&self, corner: &Vec3, centre: &Vec3) -> f64 {
        let ray = corner - centre;
        (ray - self.normal * self.normal.dot(&ray)).norm_squared()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solid::Solid;

    #[test]
    fn closed_forms_of_the_regular_solids() {
        let root = f64::sqrt;
        let cube = ((root(2.0) + root(6.0)) / 2.0).powi(3);
        let cases = [
            (Solid::Tetrahedron, (root(2.0) + root(3.0)).powi(3), 1e-13),
            (Solid::Cube, cube, 1e-13),
            (Solid::Octahedron, cube, 1e-13),
            // Published with three decimals (bounds.md, table C).
            (Solid::Dodecahedron, 3.064, 2e-4),
            (Solid::Icosahedron, 3.064, 2e-4),
            (Solid::Prism { sides: 3, height: 1.0 }, 22.091, 1e-4),
            (Solid::Pyramid { sides: 4, height: 0.5f64.sqrt() }, 76.013, 1e-4),
            (Solid::Pyramid { sides: 4, height: 1.0 }, 31.145, 1e-4),
        ];
        for (solid, expected, tolerance) in cases {
            let dilatation = radial_max_dilatation(&solid.surface().unwrap(), &Vec3::zeros());
            assert!((dilatation / expected - 1.0).abs() < tolerance, "{solid:?}: {dilatation}");
        }
    }

    #[test]
    fn infinite_where_a_face_is_not_seen() {
        let cube = Solid::Cube.surface().unwrap();
        assert_eq!(radial_max_dilatation(&cube, &Vec3::x()), f64::INFINITY);
        assert_eq!(radial_max_dilatation(&cube, &(2.0 * Vec3::x())), f64::INFINITY);
    }
}

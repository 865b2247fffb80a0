//! The dilatation of the radial map, in closed form.

use super::Surface;
use crate::mesh::Vec3;

/// The max K of the radial map of a polyhedron onto the unit ball, f(x) = u(x)^a x/|x| with u = |x| over the length of the
/// ray through x (paper eq. 20), about a centre that sees every triangle from within.
///
/// In the cone over a triangle whose plane is at distance h, at the angle theta from its normal and with t = tan theta, Df is
/// a similarity times the block [[a, -a t], [0, 1]] and a 1. The block's singular values s1 >= 1 >= s3 have s1 s3 = a and
/// s1^2 + s3^2 = a^2 (1 + t^2) + 1, so K_O = s1^3 / a and K_I = s1^3 / a^2; both grow with t, which is largest at the
/// triangle's vertex farthest from the centre. For a = 1, K = sigma^3 with sigma = (t + sqrt(t^2 + 4))/2.
/// Infinite if the centre lies in the plane of a triangle or behind it. A ratio: no units.
pub fn radial_max_dilatation(surface: &Surface, centre: &Vec3, exponent: f64) -> f64 {
    let (a, squared) = (exponent, largest_squared_tangent(surface, centre));
    let sum = a * a * (1.0 + squared) + 1.0;
    // sum^2 - 4 a^2 by factors, which keeps the digits near a = 1, t = 0.
    let root = (((a - 1.0).powi(2) + a * a * squared) * (sum + 2.0 * a)).sqrt();
    (0.5 * (sum + root)).powf(1.5) / a.min(a * a)
}

/// The exponent a for which [`radial_max_dilatation`] is least, in (0, 1].
///
/// For a >= 1, K = s1^3 / a grows with a. For a <= 1, K = s1^3 / a^2; with z = s1^2 and c = 1 + t^2, a^2 = z (z - 1) / (c z - 1)
/// and K = sqrt(z) (c z - 1) / (z - 1), which is stationary where c z^2 - (3 c - 1) z + 1 = 0: at the larger root. A ball
/// about its centre (t = 0) keeps a = 1.
pub fn best_radial_exponent(surface: &Surface, centre: &Vec3) -> f64 {
    let squared = largest_squared_tangent(surface, centre);
    let c = 1.0 + squared;
    // (3 c - 1)^2 - 4 c by factors: (c - 1) (9 c - 1).
    let z = (3.0 * c - 1.0 + (squared * (9.0 * c - 1.0)).sqrt()) / (2.0 * c);
    if z > 1.0 && c.is_finite() { (z * (z - 1.0) / (c * z - 1.0)).sqrt().min(1.0) } else { 1.0 }
}

fn largest_squared_tangent(surface: &Surface, centre: &Vec3) -> f64 {
    FacePlane::all(surface).iter().map(|plane| plane.squared_tangent(centre)).fold(0.0, f64::max)
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
            // In closed form, to three decimals.
            (Solid::Dodecahedron, 3.064, 2e-4),
            (Solid::Icosahedron, 3.064, 2e-4),
            (Solid::Prism { sides: 3, height: 1.0 }, 22.091, 1e-4),
            (Solid::Pyramid { sides: 4, height: 0.5f64.sqrt() }, 76.013, 1e-4),
            (Solid::Pyramid { sides: 4, height: 1.0 }, 31.145, 1e-4),
        ];
        for (solid, expected, tolerance) in cases {
            let dilatation = radial_max_dilatation(&solid.surface().unwrap(), &Vec3::zeros(), 1.0);
            assert!((dilatation / expected - 1.0).abs() < tolerance, "{solid:?}: {dilatation}");
        }
    }

    #[test]
    fn infinite_where_a_face_is_not_seen() {
        let cube = Solid::Cube.surface().unwrap();
        assert_eq!(radial_max_dilatation(&cube, &Vec3::x(), 1.0), f64::INFINITY);
        assert_eq!(radial_max_dilatation(&cube, &(2.0 * Vec3::x()), 1.0), f64::INFINITY);
    }

    #[test]
    fn the_best_exponent_is_a_minimum() {
        for solid in [Solid::Tetrahedron, Solid::Cube, Solid::Icosahedron] {
            let surface = solid.surface().unwrap();
            let k = |a: f64| radial_max_dilatation(&surface, &Vec3::zeros(), a);
            let best = best_radial_exponent(&surface, &Vec3::zeros());
            assert!(best > 0.0 && best < 1.0);
            // A fine grid finds nothing lower, and the neighbours are higher by the second-order term.
            assert!((1..4000).all(|i| k(f64::from(i) * 5e-4) >= k(best) * (1.0 - 1e-13)), "{solid:?}");
            assert!(k(best * 1.01) > k(best) && k(best * 0.99) > k(best));
        }
        // Tetrahedron, t^2 = 8: z = (13 + 4 sqrt 10) / 9, K = sqrt(z) (9 z - 1) / (z - 1).
        let surface = Solid::Tetrahedron.surface().unwrap();
        let z = (13.0 + 4.0 * 10f64.sqrt()) / 9.0;
        let expected = z.sqrt() * (9.0 * z - 1.0) / (z - 1.0);
        let best = best_radial_exponent(&surface, &Vec3::zeros());
        assert!((radial_max_dilatation(&surface, &Vec3::zeros(), best) / expected - 1.0).abs() < 1e-12);
    }
}

//! Dilatations between proved ends.

use crate::domain::{Domain, edge_matrix};
use crate::linalg::svd;
use crate::map::Corners;
use crate::mesh::{Mat3, TetId, Vec3};

/// A number that is known to lie between two others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Enclosure {
    pub lower: f64,
    pub upper: f64,
}

impl Enclosure {
    /// Whether a reported number can be this one.
    pub fn contains(self, value: f64) -> bool {
        self.lower <= value && value <= self.upper || value == self.upper
    }
}

/// K_I and K_O of one tet's map, for exactly the positions given, outward rounded; `[1, inf]` where rounding decides.
///
/// The Jacobian is computed as J = Y X^-1 with the edge matrices Y of the image and X of the domain. To first order, edges
/// are exact to eps, the inverse by cofactors to 16 eps times the condition |X| |X^-1|, and the product to 4 eps, so that
/// with twice that for the higher orders |dJ| <= delta = 64 eps |X| |X^-1| |Y| |X^-1|, to which the decomposition
/// adds at most 64 eps |J| (its test allows 45). By Weyl's inequality no singular value is off by more than delta, hence
///
/// ```text
/// (s1 - d) (s2 - d) / (s3 + d)^2 <= K_I <= (s1 + d) (s2 + d) / (s3 - d)^2
/// (s1 - d)^2 / ((s2 + d) (s3 + d)) <= K_O <= (s1 + d)^2 / ((s2 - d) (s3 - d))
/// ```
///
/// and the last operations are covered by a factor of 1 -+ 16 eps. An a-priori error bound, not interval arithmetic.
///
/// Where the tet lies in a warped cone, both are the largest of N = J (I + (p-1) u n^T) at up to four u, each of which is off by at
/// most 32 eps |u| |n| of itself, being a quotient by the height n.x of a point, with n from a cross product; |u| |n| >= 1.
pub(super) fn enclosed_dilatations(
    domain: &Domain,
    corners: Option<&Corners>,
    tet: TetId,
    image: &[Vec3],
) -> [Enclosure; 2] {
    let positions = domain.mesh().tets()[tet.index()].map(|v| image[v.index()]);
    let rest = domain.mesh().corners(tet);
    let [edges, images] = [edge_matrix(rest), edge_matrix(positions)];
    let inverse = domain.inverse_edges()[tet.index()].norm();
    let jacobian = domain.jacobian(tet, image);
    let plain = edges.norm() * inverse * images.norm() * inverse;
    let Some(warp) = corners.and_then(|corners| corners.warp(tet)).filter(|warp| warp.exponent() != 1.0) else {
        return enclosed(&jacobian, 64.0 * f64::EPSILON * (plain + jacobian.norm()));
    };
    let of_projection = |u: Vec3| {
        let factor = warp.factor(&u);
        let slant = u.norm() * warp.gradient().norm();
        let warped = jacobian * factor;
        let error =
            plain * factor.norm() + jacobian.norm() * slant * (factor - Mat3::identity()).norm() + warped.norm();
        enclosed(&warped, 64.0 * f64::EPSILON * error)
    };
    let larger = |a: Enclosure, b: Enclosure| Enclosure { lower: a.lower.max(b.lower), upper: a.upper.max(b.upper) };
    let both = |a: [Enclosure; 2], b: [Enclosure; 2]| [larger(a[0], b[0]), larger(a[1], b[1])];
    // A tet has a vertex that is not the corner.
    warp.projections(rest)
        .map(of_projection)
        .reduce(both)
        .unwrap_or([Enclosure { lower: 1.0, upper: f64::INFINITY }; 2])
}

/// K_I and K_O of a matrix that is off by at most `error`.
fn enclosed(jacobian: &Mat3, error: f64) -> [Enclosure; 2] {
    let values = svd(jacobian).values;
    let [low, high] = [-error, error].map(|shift| values.map(|value| value + shift));
    let enclosure = |least: f64, most: f64| {
        let room = 16.0 * f64::EPSILON;
        // Also for NaN.
        if low[2] > 0.0 && most.is_finite() {
            Enclosure { lower: (least * (1.0 - room)).max(1.0 - room), upper: most * (1.0 + room) }
        } else {
            Enclosure { lower: 1.0, upper: f64::INFINITY }
        }
    };
    [
        enclosure((low[0] / high[2]) * (low[1] / high[2]), (high[0] / low[2]) * (high[1] / low[2])),
        enclosure((low[0] / high[1]) * (low[0] / high[2]), (high[0] / low[1]) * (high[0] / low[2])),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::fixtures::{cube, fan};

    #[test]
    fn the_ends_of_a_known_map_are_close_and_on_either_side() {
        let domain = Domain::new(fan(&cube(), Vec3::new(0.3, 0.2, -0.1))).unwrap();
        let image: Vec<Vec3> = domain.mesh().points().iter().map(|p| Vec3::new(p.x, 4.0 * p.y, 2.0 * p.z)).collect();
        for tet in 0..12 {
            for enclosure in enclosed_dilatations(&domain, None, TetId(tet), &image) {
                assert!(enclosure.contains(8.0) && enclosure.upper - enclosure.lower < 1e-10, "{enclosure:?}");
                assert!(!enclosure.contains(8.0 + 1e-10) && !enclosure.contains(8.0 - 1e-10));
            }
        }
    }

    #[test]
    fn a_flat_image_has_no_upper_end() {
        let domain = Domain::new(fan(&cube(), Vec3::zeros())).unwrap();
        let mut image = domain.mesh().points().to_vec();
        image[8] = Vec3::x();
        let ends = (0..12).map(|tet| enclosed_dilatations(&domain, None, TetId(tet), &image));
        assert_eq!(ends.filter(|[inner, _]| inner.upper.is_infinite()).count(), 2);
    }
}

//! Whether a piecewise-linear map of a ball onto a polyhedron in the unit ball is bijective, and why.

use serde::Serialize;

use crate::domain::Domain;
use crate::mesh::{Orientation, TetId, Vec3, orientation};

/// Whether a map is bijective, with the reason.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Bijectivity {
    /// True only if it is proved.
    pub bijective: bool,
    /// The proof in a sentence, or what stands in its way.
    pub reason: String,
}

/// Decides whether the piecewise-linear map of `domain` (a ball) to `image` is a homeomorphism onto its image.
///
/// If the boundary image is a surface star-shaped about 0 (each triangle positively oriented with 0 by exact predicate, and
/// the solid angles of all sum to 4 pi, so that central projection to the sphere is a covering of degree one), it is an
/// embedded sphere. If moreover every tet is positively oriented, the map has degree one over the inside of that sphere
/// and each of its points is covered by positive tets only, hence exactly once.
pub fn bijectivity(domain: &Domain, image: &[Vec3]) -> Bijectivity {
    let no = |reason: String| Bijectivity { bijective: false, reason };
    let origin = Vec3::zeros();
    let flipped = domain
        .mesh()
        .tets()
        .iter()
        .filter(|tet| orientation(tet.map(|v| &image[v.index()])) != Orientation::Positive)
        .count();
    if flipped > 0 {
        return no(format!("{flipped} tets are flipped or flat in the image"));
    }
    let mut angle = 0.0;
    for (index, triangle) in domain.boundary().triangles().iter().enumerate() {
        let corners = triangle.map(|v| &image[v.index()]);
        if orientation([&origin, corners[0], corners[1], corners[2]]) != Orientation::Positive {
            let TetId(tet) = domain.boundary().owners()[index];
            return no(format!("the boundary image is not star-shaped about 0: its triangle of tet {tet} faces away"));
        }
        angle += solid_angle(corners);
    }
    // The sum is a multiple of 4 pi, so half of that is a wide margin for rounding.
    let sheets = (angle / (4.0 * std::f64::consts::PI)).round();
    if sheets != 1.0 {
        return no(format!("the boundary image covers the sphere {sheets} times"));
    }
    Bijectivity {
        bijective: true,
        reason: "every tet is positively oriented by exact predicate and the boundary image is star-shaped about 0"
            .into(),
    }
}

/// The solid angle of a triangle seen from 0 (van Oosterom and Strackee 1983), steradians, positive if 0 sees its back.
fn solid_angle([a, b, c]: [&Vec3; 3]) -> f64 {
    let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
    let numerator = a.dot(&b.cross(c));
    2.0 * numerator.atan2(la * lb * lc + a.dot(b) * lc + a.dot(c) * lb + b.dot(c) * la)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{RadialCoordinates, caraman};
    use crate::solid::{ShellSettings, Solid, shell_mesh};

    fn cube() -> (Domain, Vec<Vec3>) {
        let settings = ShellSettings { subdivisions: 1, refinement: None, layers: 2, grading: 1.0 };
        let shell = shell_mesh(&Solid::Cube.surface().unwrap(), Vec3::zeros(), &settings).unwrap();
        let image = caraman(&RadialCoordinates::of_shell(&shell), 1.0);
        (Domain::new(shell.mesh).unwrap(), image)
    }

    #[test]
    fn the_radial_map_is_bijective() {
        let (domain, image) = cube();
        assert!(bijectivity(&domain, &image).bijective);
    }

    #[test]
    fn a_vertex_pushed_through_a_face_is_not() {
        let (domain, mut image) = cube();
        image[0] = Vec3::new(0.9, 0.8, 0.7);
        let said = bijectivity(&domain, &image);
        assert!(!said.bijective && said.reason.contains("flipped"));
    }
}

//! Whether a piecewise-linear map of a ball onto a polyhedron in the unit ball is bijective, and why.

use serde::Serialize;

use crate::domain::Domain;
use crate::mesh::{Orientation, TetId, Vec3, View, orientation};
use crate::solid::{StarKernel, Surface};

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
/// If the boundary image is a surface star-shaped about some point (each triangle positively oriented with it by exact
/// predicate, and the solid angles of all sum to 4 pi, so that central projection to a sphere is a covering of degree one), it
/// is an embedded sphere. If moreover every tet is positively oriented, the map has degree one over the inside of that sphere
/// and each of its points is covered by positive tets only, hence exactly once.
///
/// The point is 0 for images that are the ball, and else one of the kernel, if there is any. Of images that are star-shaped
/// about no point nothing is proved here.
pub fn bijectivity(domain: &Domain, image: &[Vec3]) -> Bijectivity {
    let no = |reason: String| Bijectivity { bijective: false, reason };
    let flipped = domain
        .mesh()
        .tets()
        .iter()
        .filter(|tet| orientation(tet.map(|v| &image[v.index()])) != Orientation::Positive)
        .count();
    if flipped > 0 {
        return no(format!("{flipped} tets are flipped or flat in the image"));
    }
    let boundary = domain.boundary();
    let triangles = || boundary.triangles().iter().map(|triangle| triangle.map(|v| &image[v.index()]));
    let yes = |about: &str| Bijectivity {
        bijective: true,
        reason: format!(
            "every tet is positively oriented by exact predicate and the boundary image is star-shaped about {about}"
        ),
    };
    let seen = View::from(&Vec3::zeros(), triangles());
    if seen == View::Covers(1) {
        return yes("0");
    }
    let centre = kernel_point(domain, image);
    if centre.is_some_and(|centre| View::from(&centre, triangles()) == View::Covers(1)) {
        return yes("a point inside");
    }
    match seen {
        View::FacesAway(index) => {
            let TetId(tet) = boundary.owners()[index];
            no(format!("the boundary image is not star-shaped about 0: its triangle of tet {tet} faces away"))
        }
        View::Covers(times) => no(format!("the boundary image covers the sphere {times} times")),
    }
}

/// A point that sees the whole boundary image from within, if there is one.
fn kernel_point(domain: &Domain, image: &[Vec3]) -> Option<Vec3> {
    let surface = Surface::from_triangles(image.to_vec(), domain.boundary().triangles()).ok()?;
    Some(StarKernel::of(&surface).ok()?.centre)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{AnalyticMap, RadialCoordinates, caraman};
    use crate::solid::{ShellSettings, Solid, shell_mesh};

    fn cube(subdivisions: u32) -> (Domain, Vec<Vec3>) {
        let settings = ShellSettings { subdivisions, refinement: None, layers: 6, grading: 1.0 };
        let shell = shell_mesh(&Solid::Cube.surface().unwrap(), Vec3::zeros(), &settings).unwrap();
        let image = caraman(&RadialCoordinates::of_shell(&shell), 1.0);
        (Domain::new(shell.mesh).unwrap(), image)
    }

    fn all_are_positive(domain: &Domain, image: &[Vec3]) -> bool {
        let tets = domain.mesh().tets().iter();
        tets.map(|tet| tet.map(|v| &image[v.index()])).all(|corners| orientation(corners) == Orientation::Positive)
    }

    #[test]
    fn the_radial_map_is_bijective() {
        let (domain, image) = cube(1);
        assert!(bijectivity(&domain, &image).bijective);
    }

    #[test]
    fn images_away_from_the_origin_are_looked_at_from_a_point_inside() {
        let (domain, image) = cube(4);
        let moved: Vec<Vec3> = image.iter().map(|p| p + Vec3::new(5.0, 0.0, 1.0)).collect();
        let said = bijectivity(&domain, &moved);
        assert!(said.bijective && said.reason.ends_with("a point inside"), "{}", said.reason);
        // Folded by 1.4 radians to both sides, its ends see no common point.
        let words = ["maps=[{ kind = 'affine', matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], offset = [0, 3, 0] }, \
                      { kind = 'folding', ratio = 3 }]"
            .to_string()];
        let folding = AnalyticMap::from_words("composition", &words).unwrap();
        let bent = folding.apply(domain.mesh().points()).unwrap();
        assert!(all_are_positive(&domain, &bent) && !bijectivity(&domain, &bent).bijective);
    }

    #[test]
    fn a_vertex_pushed_through_a_face_is_not() {
        let (domain, mut image) = cube(1);
        image[0] = Vec3::new(0.9, 0.8, 0.7);
        let said = bijectivity(&domain, &image);
        assert!(!said.bijective && said.reason.contains("flipped"));
    }
}

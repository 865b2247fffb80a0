//! Whether a piecewise-linear map of a ball onto a polyhedron in the unit ball is bijective, and why.

use serde::Serialize;

use crate::domain::Domain;
use crate::mesh::{Orientation, TetId, Vec3, View, orientation};

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
    let triangles = boundary.triangles().iter().map(|triangle| triangle.map(|v| &image[v.index()]));
    match View::from(&Vec3::zeros(), triangles) {
        View::FacesAway(index) => {
            let TetId(tet) = boundary.owners()[index];
            return no(format!("the boundary image is not star-shaped about 0: its triangle of tet {tet} faces away"));
        }
        View::Covers(1) => {}
        View::Covers(times) => return no(format!("the boundary image covers the sphere {times} times")),
    }
    Bijectivity {
        bijective: true,
        reason: "every tet is positively oriented by exact predicate and the boundary image is star-shaped about 0"
            .into(),
    }
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

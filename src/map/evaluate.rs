//! A piecewise-linear map and its inverse at any points, onto the image polyhedron or on to the ball.

use serde::Serialize;

use super::corner::Corners;
use super::locate::{Locator, Place};
use super::radial::{RayEnd, Rays};
use crate::domain::Domain;
use crate::mesh::{Orientation, TetId, Vec3, View, orientation};
use crate::solid::Surface;

/// What a map is taken onto.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Onto {
    /// The image of the mesh: the map is linear on each tet.
    Polyhedron,
    /// The unit ball: the piecewise-linear map followed by the radial map of its image, which must be star-shaped about 0.
    /// With zeta(y) the boundary point of the image on the ray of y, it takes y to y / |zeta(y)|.
    Ball,
}

/// Why a map is not evaluated.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EvaluatorError {
    /// A tet of the image has no positive volume, so that the map has no inverse on it.
    #[error("tet {tet} (counted from 0) is flipped or flat in the image; optimize the map first")]
    Flipped {
        /// The first such tet.
        tet: u32,
    },
    /// No radial map of the image onto the ball.
    #[error(
        "the image is not star-shaped about 0 and has no radial map onto the ball; take the map onto the polyhedron"
    )]
    NotStarShaped,
}

/// The image of a point, or the point of an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Located {
    /// The tet that holds the point, where corners are warped the warped one: of those that share it, the one of the lowest
    /// number.
    pub tet: TetId,
    /// Where it goes.
    pub position: Vec3,
}

/// The piecewise-linear map of a domain and its inverse, for many points: the tets are kept in trees.
///
/// In which tet a point lies is decided by exact predicates. A point outside of the mesh by at most 1e-12 of its size, or by the rounding
/// of its coordinates, counts as one of the boundary. An image that overlaps itself has several inverses; the one in the tet of the lowest
/// number is given.
///
/// ```
/// use qcball::map::{Evaluator, Onto};
/// use qcball::{CentreChoice, Domain, RadialCoordinates, ShellSettings, Solid, Vec3, caraman, shell_mesh, star_centre};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let surface = Solid::Cube.surface()?;
/// let centre = star_centre(&surface, &CentreChoice::Kernel)?.position;
/// let settings = ShellSettings { subdivisions: 1, refinement: None, layers: 2, grading: 1.0 };
/// let shell = shell_mesh(&surface, centre, &settings)?;
/// let image = caraman(&RadialCoordinates::of_shell(&shell), 1.0);
/// let domain = Domain::new(shell.mesh)?;
///
/// let map = Evaluator::new(&domain, &image, Onto::Ball)?;
/// let x = Vec3::new(0.3, -0.2, 0.1);
/// let y = map.at(&x).expect("x lies in the cube").position;
/// // The radial map keeps the share of the ray, here 0.3 of the way from the centre to the surface.
/// assert!((y.norm() - 0.3).abs() < 1e-14);
/// let back = map.inverse(&y).expect("y lies in the ball").position;
/// assert!((back - x).norm() < 1e-14);
/// assert_eq!(map.at(&Vec3::new(1.5, 0.0, 0.0)), None);
/// # Ok(())
/// # }
/// ```
pub struct Evaluator<'a> {
    domain: &'a Domain,
    image: &'a [Vec3],
    in_domain: Locator,
    in_image: Locator,
    /// The rays from 0 to the boundary of the image, for a map onto the ball.
    rays: Option<Rays>,
    corners: Option<&'a Corners>,
}

impl<'a> Evaluator<'a> {
    /// The map that takes the domain's vertices to `image`, one position a vertex, in any units; onto the ball it is
    /// scale-free.
    ///
    /// # Errors
    /// A tet that is flipped in the image; for a map onto the ball, an image that is not star-shaped about 0.
    ///
    /// # Panics
    /// If `image` has fewer positions than the domain has vertices.
    pub fn new(domain: &'a Domain, image: &'a [Vec3], onto: Onto) -> Result<Self, EvaluatorError> {
        let tets = domain.mesh().tets();
        let flipped = tets.iter().position(|tet| {
            let corners = tet.map(|v| &image[v.index()]);
            let finite = corners.iter().all(|corner| corner.iter().all(|x| x.is_finite()));
            !finite || orientation(corners) != Orientation::Positive
        });
        if let Some(tet) = flipped {
            return Err(EvaluatorError::Flipped { tet: tet as u32 });
        }
        let rays = match onto {
            Onto::Polyhedron => None,
            Onto::Ball => Some(rays(domain, image).ok_or(EvaluatorError::NotStarShaped)?),
        };
        let in_domain = Locator::new(domain.mesh().points(), tets);
        let in_image = Locator::new(image, tets);
        Ok(Self { domain, image, in_domain, in_image, rays, corners: None })
    }

    /// The same map after the warps of corners of the domain.
    pub fn with_corners(self, corners: &'a Corners) -> Self {
        Self { corners: Some(corners), ..self }
    }

    /// The image of a point of the domain; `None` outside.
    pub fn at(&self, point: &Vec3) -> Option<Located> {
        let warp = self.corners.and_then(|corners| corners.warp(self.in_domain.find(point)?.tet));
        let warped = warp.map_or(*point, |warp| warp.at(point));
        let Place { tet, weights } = self.in_domain.find(&warped)?;
        let position = mean(self.domain.mesh().tets()[tet.index()].map(|v| self.image[v.index()]), weights);
        let Some(rays) = &self.rays else { return Some(Located { tet, position }) };
        let radius = position.norm();
        if radius == 0.0 {
            return Some(Located { tet, position });
        }
        // Up to rounding a boundary point is on the sphere; no image is beyond it.
        let fraction = (radius * rays.reciprocal_length(&(position / radius), RayEnd::Only)?).min(1.0);
        Some(Located { tet, position: position * (fraction / radius) })
    }

    /// The point of the domain that goes to a point of the image; `None` outside of the image.
    pub fn inverse(&self, point: &Vec3) -> Option<Located> {
        let radius = point.norm();
        let in_image = match &self.rays {
            Some(rays) if radius > 0.0 && radius.is_finite() => {
                point / rays.reciprocal_length(&(point / radius), RayEnd::Only)?
            }
            _ => *point,
        };
        let place = self.in_image.find(&in_image)?;
        let warp = self.corners.and_then(|corners| corners.warp(place.tet)).filter(|warp| warp.exponent() != 1.0);
        let corners = self.domain.mesh().corners(place.tet);
        let position =
            warp.map_or_else(|| mean(corners, place.weights), |warp| warp.inverse_of_mean(corners, place.weights));
        Some(Located { tet: place.tet, position })
    }
}

fn mean(corners: [Vec3; 4], weights: [f64; 4]) -> Vec3 {
    corners.iter().zip(weights).map(|(corner, weight)| corner * weight).sum()
}

/// The rays from 0 to the boundary of an image that is star-shaped about it.
fn rays(domain: &Domain, image: &[Vec3]) -> Option<Rays> {
    let triangles = domain.boundary().triangles();
    let corners = triangles.iter().map(|triangle| triangle.map(|v| &image[v.index()]));
    if View::from(&Vec3::zeros(), corners) != View::Covers(1) {
        return None;
    }
    let surface = Surface::from_triangles(image.to_vec(), triangles).ok()?;
    Some(Rays::new(&surface, Vec3::zeros()))
}

#[cfg(test)]
mod tests {
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{RngCore, SeedableRng};

    use super::*;
    use crate::map::{RadialCoordinates, caraman};
    use crate::mesh::fixtures::{cube, fan};
    use crate::solid::{ShellSettings, Solid, shell_mesh};

    /// A shell mesh and a map of it whose interior vertices are moved a little, so that it is linear in no cone.
    fn bent(solid: &Solid) -> (Domain, Vec<Vec3>) {
        let settings = ShellSettings { subdivisions: 2, refinement: None, layers: 4, grading: 1.2 };
        let shell = shell_mesh(&solid.surface().unwrap(), Vec3::zeros(), &settings).unwrap();
        let mut image = caraman(&RadialCoordinates::of_shell(&shell), 1.0);
        let domain = Domain::new(shell.mesh).unwrap();
        for (point, on_boundary) in image.iter_mut().zip(domain.boundary().vertex_mask()) {
            if !on_boundary {
                *point += Vec3::new(0.03, 0.02 * point.x, -0.02 * point.y);
            }
        }
        (domain, image)
    }

    /// Numbers from -1 to 1.
    fn numbers(seed: u64) -> impl FnMut() -> f64 {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        move || f64::from(random.next_u32()) / f64::from(u32::MAX) * 2.0 - 1.0
    }

    #[test]
    fn the_inverse_and_the_map_give_each_point_back() {
        for solid in [Solid::Cube, Solid::Tetrahedron] {
            let (domain, image) = bent(&solid);
            for onto in [Onto::Polyhedron, Onto::Ball] {
                let map = Evaluator::new(&domain, &image, onto).unwrap();
                let mut number = numbers(1);
                let mut found = 0;
                for _ in 0..20_000 {
                    let y = Vec3::new(number(), number(), number());
                    let Some(x) = map.inverse(&y) else { continue };
                    found += 1;
                    let back = map.at(&x.position).unwrap().position;
                    // x is rounded at 1e-16 of its size, which the map stretches by less than 100; the weights at 1e-16
                    // times the condition of a tet, below 1e4.
                    assert!((back - y).norm() < 1e-11, "{solid} {onto:?}: {y:?}");
                }
                // The ball has 0.52 of the volume of its box, the inscribed tetrahedra's image less.
                assert!((5_000..11_000).contains(&found), "{solid} {onto:?}: {found}");
            }
        }
    }

    #[test]
    fn vertices_go_to_their_images_exactly_and_shared_points_to_the_lowest_tet() {
        let (domain, image) = bent(&Solid::Cube);
        let map = Evaluator::new(&domain, &image, Onto::Polyhedron).unwrap();
        let lowest = |holds: &dyn Fn(&[crate::VertexId; 4]) -> bool| {
            TetId(domain.mesh().tets().iter().position(holds).unwrap() as u32)
        };
        for (vertex, point) in (0..).map(crate::VertexId).zip(domain.mesh().points()) {
            let found = map.at(point).unwrap();
            assert_eq!(found.position, image[vertex.index()]);
            assert_eq!(found.tet, lowest(&|tet| tet.contains(&vertex)));
            assert_eq!(map.inverse(&image[vertex.index()]).unwrap().position, *point);
        }
        // The middle of an edge of two coordinates that are exact in binary: every tet at the edge holds it, exactly.
        let fan = Domain::new(fan(&cube(), Vec3::zeros())).unwrap();
        let positions = fan.mesh().points().to_vec();
        let map = Evaluator::new(&fan, &positions, Onto::Polyhedron).unwrap();
        for tet in fan.mesh().tets() {
            let middle = (positions[tet[0].index()] + positions[tet[1].index()]) / 2.0;
            let first = fan.mesh().tets().iter().position(|other| tet[..2].iter().all(|v| other.contains(v))).unwrap();
            assert!(map.at(&middle).unwrap().tet.index() <= first);
            assert_eq!(map.at(&middle).unwrap().position, middle);
        }
    }

    #[test]
    fn outside_is_none_and_the_boundary_is_not_outside() {
        let (domain, image) = bent(&Solid::Icosahedron);
        let map = Evaluator::new(&domain, &image, Onto::Ball).unwrap();
        let mut number = numbers(2);
        for _ in 0..2_000 {
            let direction = Vec3::new(number(), number(), number()).normalize();
            // On the sphere up to rounding, and a thousandth outside.
            let x = map.inverse(&direction).expect("on the sphere");
            assert_eq!(map.inverse(&(direction * 1.001)), None);
            let back = map.at(&x.position).expect("on the boundary").position;
            assert!((back - direction).norm() < 1e-11 && back.norm() <= 1.0 + 1e-15);
            assert_eq!(map.at(&(x.position * 1.001)), None);
        }
        for nowhere in [Vec3::repeat(f64::NAN), Vec3::repeat(f64::INFINITY), Vec3::repeat(1e300)] {
            assert_eq!((map.at(&nowhere), map.inverse(&nowhere)), (None, None));
        }
        assert_eq!(
            map.inverse(&Vec3::zeros()).map(|found| map.at(&found.position).unwrap().position.norm() < 1e-15),
            Some(true)
        );
    }

    #[test]
    fn a_solid_far_from_0_holds_the_points_that_its_inverse_gives() {
        let (near, image) = bent(&Solid::Cube);
        // A unit in the last place of its coordinates is 1.2e-10 of its half-extent.
        let far: Vec<Vec3> = near.mesh().points().iter().map(|p| p + Vec3::new(1e6, -1e6, 1e6)).collect();
        let domain = Domain::new(crate::TetMesh::new(far.clone(), near.mesh().tets().to_vec()).unwrap()).unwrap();
        let map = Evaluator::new(&domain, &image, Onto::Ball).unwrap();
        assert!(far.iter().all(|point| map.at(point).is_some()));
        let mut number = numbers(3);
        for _ in 0..2_000 {
            let direction = Vec3::new(number(), number(), number()).normalize();
            let x = map.inverse(&direction).expect("on the sphere").position;
            let back = map.at(&x).expect("on the boundary").position;
            // Four units of the last place, stretched by less than 100.
            assert!((back - direction).norm() < 1e-7, "{direction:?}: {back:?}");
            // A millionth of the size outside is outside.
            let centre = Vec3::new(1e6, -1e6, 1e6);
            assert_eq!(map.at(&(centre + (x - centre) * (1.0 + 1e-6))), None);
        }
    }

    #[test]
    fn what_has_no_inverse_or_no_ball_is_refused() {
        let (domain, image) = bent(&Solid::Cube);
        let moved: Vec<Vec3> = image.iter().map(|point| point + Vec3::x() * 5.0).collect();
        assert!(Evaluator::new(&domain, &moved, Onto::Polyhedron).is_ok());
        assert_eq!(Evaluator::new(&domain, &moved, Onto::Ball).err(), Some(EvaluatorError::NotStarShaped));
        let mut flipped = image.clone();
        flipped[0] = Vec3::new(2.0, 0.0, 0.0);
        assert!(matches!(Evaluator::new(&domain, &flipped, Onto::Ball), Err(EvaluatorError::Flipped { .. })));
    }
}

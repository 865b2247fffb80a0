//! The image of the boundary, and how far it determines the angles inside.

use crate::domain::Domain;
use crate::mesh::angle::Angle;
use crate::mesh::{BoundaryEdges, Vec3, View};

/// The image positions of the boundary vertices; those of interior vertices are never read.
///
/// The boundary fixes the sum of the image angles around a boundary edge or vertex only up to whole turns. If the image
/// boundary is embedded, every orientation-preserving piecewise-linear map with these boundary positions is injective
/// (over each generic point of space the number of its preimages is the degree, which is the winding number of an
/// embedded sphere, 0 or 1), and there are no further turns. Where embedding is not established, the bounds allow for
/// any number of turns and so hold for maps that are not injective, too.
#[derive(Clone, Copy, Debug)]
pub struct BoundaryImage<'a> {
    positions: &'a [Vec3],
    injective: bool,
}

impl<'a> BoundaryImage<'a> {
    /// Takes one position a vertex and looks whether the image boundary is star-shaped, hence embedded, about the origin or
    /// about the mean of its vertices.
    pub fn new(domain: &Domain, edges: &BoundaryEdges, positions: &'a [Vec3]) -> Self {
        let on_boundary = domain.boundary().vertex_mask();
        let vertices = positions.iter().zip(on_boundary).filter(|(_, on)| **on).map(|(p, _)| p);
        let mean = vertices.clone().sum::<Vec3>() / vertices.count() as f64;
        let injective = edges.left_out().is_empty()
            && [Vec3::zeros(), mean].iter().any(|centre| {
                let triangles = domain.boundary().triangles().iter();
                View::from(centre, triangles.map(|triangle| triangle.map(|v| &positions[v.index()]))) == View::Covers(1)
            });
        Self { positions, injective }
    }

    /// One position a vertex; only those of boundary vertices mean anything.
    pub fn positions(&self) -> &'a [Vec3] {
        self.positions
    }

    /// Whether every orientation-preserving piecewise-linear map with this boundary is known to be injective.
    pub fn injective(&self) -> bool {
        self.injective
    }

    /// The angles `principal + 2 pi k`, k = 0, 1, ..., that a sum of image angles below `limit` can have, as far as they
    /// matter for a comparison with the angle `domain`: up to the first that is not below it.
    ///
    /// None if the angle is not defined.
    pub(super) fn possible_angles(self, principal: Angle, domain: Angle, limit: f64) -> impl Iterator<Item = Angle> {
        let turns = if self.injective { 0..1 } else { 0..i64::MAX };
        let mut passed = false;
        turns
            .map(move |turns| principal.plus_half_turns(2 * turns))
            .take_while(move |angle| angle.lower() < limit && angle.upper().is_finite())
            .filter(|angle| angle.upper() > 0.0)
            .take_while(move |angle| {
                let wanted = !passed;
                passed = angle.lower() >= domain.upper();
                wanted
            })
    }

    /// Whether `principal` is the only one of the possible angles below `limit`.
    pub(super) fn is_unique(self, principal: Angle, limit: f64) -> bool {
        principal.lower() > 0.0 && (self.injective || principal.plus_half_turns(2).lower() >= limit)
    }
}

/// A number at least `count * pi`, below which the angles of so many tets at an edge lie.
pub(super) fn half_turns(count: usize) -> f64 {
    Angle::ZERO.plus_half_turns(count as i64).upper()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use super::*;
    use crate::linalg::interval::Interval;
    use crate::mesh::fixtures::{cube, fan};

    fn exactly(value: f64) -> Angle {
        Angle::within(Interval::exactly(value))
    }

    #[test]
    fn turns_are_allowed_for_only_where_the_image_may_be_wound() {
        let known = BoundaryImage { positions: &[], injective: true };
        let unknown = BoundaryImage { positions: &[], injective: false };
        let values = |image: BoundaryImage, principal: f64, domain: f64, limit: f64| -> Vec<f64> {
            let angles = image.possible_angles(exactly(principal), exactly(domain), limit);
            angles.map(|angle| (1e12 * angle.value()).round() * 1e-12).collect()
        };
        let rounded = |angle: f64| (1e12 * angle).round() * 1e-12;
        assert_eq!(values(known, 1.0, 3.0, 100.0), [1.0]);
        assert_eq!(values(unknown, 1.0, 3.0, 100.0), [1.0, rounded(1.0 + TAU)]);
        // Opening edges need no further turn, and three tets cannot make one of more than 3 pi.
        assert_eq!(values(unknown, 3.0, 1.0, 100.0), [3.0]);
        assert_eq!(values(unknown, 4.0, 5.0, 3.0 * PI), [4.0]);
        assert!(unknown.is_unique(exactly(4.0), 3.0 * PI) && !unknown.is_unique(exactly(1.0), 3.0 * PI));
        // A non-positive angle is not the true one.
        assert_eq!(values(unknown, -1.0, 3.0, 100.0), [rounded(TAU - 1.0)]);
    }

    #[test]
    fn star_shaped_boundaries_are_recognised_wherever_they_are() {
        let domain = Domain::new(fan(&cube(), Vec3::zeros())).unwrap();
        let edges = BoundaryEdges::of(domain.mesh(), domain.boundary());
        let injective = |image: &[Vec3]| BoundaryImage::new(&domain, &edges, image).injective();
        let points = domain.mesh().points();
        let moved = |f: &dyn Fn(&Vec3) -> Vec3| -> Vec<Vec3> { points.iter().map(f).collect() };
        assert!(injective(points));
        assert!(injective(&moved(&|p| p + Vec3::x() * 7.0)));
        assert!(!injective(&moved(&|p| -p)));
        assert!(!injective(&moved(&|p| Vec3::new(p.x, p.y, 0.0))));
        assert!(!injective(&moved(&|p| p * f64::NAN)));
    }
}

//! Points of tets at which a map onto the ball is looked at, and what it is there.

use super::cones::{Cone, Cones};
use super::pieces::{THIN, Weights, part, within};
use super::polygon::Shadow;
use super::{NotOntoBall, onto_ball};
use crate::dilatation::Dilatation;
use crate::domain::{Afterwards, Domain, Turning};
use crate::map::{self, Corners};
use crate::mesh::{Mat3, TetId, Vec3, edge_matrix};

/// Points nearer to 0 than this part of their tet's farthest corner have no direction: that of 0, where cuts meet, is rounding.
const AT_CENTRE: f64 = 1e-9;

/// What the map onto the ball is at a point of a tet.
#[derive(Clone, Debug)]
pub(crate) struct Factor {
    /// K there.
    pub k: f64,
    /// R.
    pub right: Mat3,
    /// L, and what becomes of it where the corners move, those of the tet alone.
    pub afterwards: Afterwards,
    /// The boundary triangle whose cone the point's image lies in.
    pub triangle: usize,
}

/// What a corner of a part of a tet knows: R, and L with the corner's weights.
type End = (Option<Mat3>, Option<(Mat3, Weights)>);

/// The radial map of an image onto the ball, after a map of a domain to that image.
pub(crate) struct OntoBall<'a> {
    domain: &'a Domain,
    corners: Option<&'a Corners>,
    image: &'a [Vec3],
    pub(super) cones: Cones,
}

impl<'a> OntoBall<'a> {
    /// Takes a map, with the warps of corners if it has any.
    ///
    /// # Errors
    /// The image is not a polyhedron inscribed in a sphere about 0 and star-shaped about 0.
    pub fn new(domain: &'a Domain, corners: Option<&'a Corners>, image: &'a [Vec3]) -> Result<Self, NotOntoBall> {
        let cones = Cones::new(&onto_ball(domain, image)?);
        Ok(Self { domain, corners, image, cones })
    }

    /// The cone that a tet is warped with; `None` if it is not.
    pub(super) fn warped_cone(&self, tet: TetId) -> Option<&'a map::Cone> {
        self.corners.and_then(|corners| corners.warped_cone(tet))
    }

    /// K of a tet that has no warp in the direction of a corner of the cone of that index, by plain arithmetic; infinite where there is none.
    pub(super) fn at_corner(&self, tet: TetId, index: usize, corner: &Vec3) -> f64 {
        let jacobian = self.domain.jacobian(tet, self.image);
        shear(self.cones.get(index), corner).map_or(f64::INFINITY, |shear| Dilatation::of(&(shear * jacobian)).k())
    }

    /// The largest K at the corners of the parts, in cones whose radial map has more than a K of `stretch`, of any tet inside of the image with the
    /// piecewise-linear map from `rest` to `images`; 1 if there are none.
    pub fn largest(&self, rest: &[Vec3; 4], images: &[Vec3; 4], stretch: f64) -> f64 {
        let Some(inverse) = edge_matrix(*rest).try_inverse() else { return f64::INFINITY };
        let jacobian = edge_matrix(*images) * inverse;
        let size = images.iter().map(|y| y.norm()).fold(0.0, f64::max);
        let (mut largest, shadow) = (1.0f64, Shadow::of(images));
        self.cones.for_each_near(shadow.cap(), stretch, &mut |index| {
            let cone = self.cones.get(index);
            if shadow.nearly_misses(cone) {
                return;
            }
            for weights in within(images, cone).into_iter().flatten() {
                let y = images.iter().zip(&weights).map(|(p, w)| p * *w).sum::<Vec3>() / weights.iter().sum::<f64>();
                if let Some(left) = shear(cone, &y).filter(|_| y.norm() > AT_CENTRE * size) {
                    largest = largest.max(Dilatation::of(&(left * jacobian)).k());
                }
            }
        });
        largest
    }

    /// The largest K at the corners of [`OntoBall::factors`].
    pub(super) fn sampled(&self, tet: TetId) -> f64 {
        self.factors_on(tet, THIN, 0.0).iter().map(|factor| factor.k).fold(1.0, f64::max)
    }

    /// The factors at the corners of the parts of a tet in single cones, of cones whose radial map has more than a K of `stretch`. On such a
    /// part K has its maximum at a corner, up to the curvature of L and R. The apex of a warped tet has an R in each direction, 0 an L.
    ///
    /// Even the thinnest part counts: a map that is made better to where a tet would reach into a cone of larger K reaches there in the end.
    pub fn factors(&self, tet: TetId, stretch: f64) -> Vec<Factor> {
        self.factors_on(tet, 0.0, stretch)
    }

    /// The same on the parts of the tet larger than `thin`, relative to its volume.
    fn factors_on(&self, tet: TetId, thin: f64, stretch: f64) -> Vec<Factor> {
        let rest = self.domain.mesh().corners(tet);
        let images = self.domain.mesh().tets()[tet.index()].map(|v| self.image[v.index()]);
        let jacobian = self.domain.jacobian(tet, self.image);
        let warp = self.warped_cone(tet).and_then(|_| self.corners?.warp(tet));
        let size = images.iter().map(|y| y.norm()).fold(0.0, f64::max);
        let (mut found, shadow) = (Vec::new(), Shadow::of(&images));
        self.cones.for_each_near(shadow.cap(), stretch, &mut |index| {
            let cone = self.cones.get(index);
            if shadow.nearly_misses(cone) {
                return;
            }
            let mut corners: Vec<Weights> = Vec::new();
            for simplex in within(&images, cone).into_iter().filter(|simplex| part(simplex) > thin) {
                corners.extend(simplex);
            }
            corners.sort_unstable_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
            corners.dedup();
            let of = |points: &[Vec3; 4], weights: &Weights| -> Vec3 {
                points.iter().zip(weights).map(|(p, w)| p * *w).sum::<Vec3>() / weights.iter().sum::<f64>()
            };
            let triangle = self.domain.boundary().triangles()[index];
            let places = self.domain.mesh().tets()[tet.index()].map(|v| triangle.iter().position(|w| *w == v));
            let ends: Vec<End> = corners
                .iter()
                .map(|weights| {
                    let right = match warp {
                        None => Some(Mat3::identity()),
                        Some(warp) => warp.projections([of(&rest, weights); 4]).next().map(|u| warp.factor(&u)),
                    };
                    let y = of(&images, weights);
                    let left = shear(cone, &y).filter(|_| y.norm() > AT_CENTRE * size);
                    (right, left.map(|left| (left, *weights)))
                })
                .collect();
            let mut take = |right: Mat3, (left, weights): (Mat3, Weights)| {
                let k = Dilatation::of(&(left * jacobian * right)).k();
                let turning = places.iter().any(Option::is_some).then(|| {
                    let change = turning(cone, &images, &places, &weights, &(jacobian * right));
                    Box::new(Turning { from: images, change })
                });
                found.push(Factor { k, right, afterwards: Afterwards { left, turning }, triangle: index });
            };
            for end in &ends {
                match *end {
                    (Some(right), Some(left)) => take(right, left),
                    (None, Some(left)) => {
                        ends.iter().filter_map(|(right, _)| *right).for_each(|right| take(right, left))
                    }
                    (Some(right), None) => ends.iter().filter_map(|(_, left)| *left).for_each(|left| take(right, left)),
                    (None, None) => {}
                }
            }
        });
        found
    }
}

/// The derivatives of the shear times `jacobian` in each coordinate of each corner of a tet, at the point with these weights in the cone of a
/// boundary triangle, whose corners are those of the tet at the `places` that have one.
fn turning(
    cone: &Cone,
    images: &[Vec3; 4],
    places: &[Option<usize>; 4],
    weights: &Weights,
    jacobian: &Mat3,
) -> [[Mat3; 3]; 4] {
    let normal = Vec3::from(cone.normal.map(|entry| entry.middle()));
    let total: f64 = weights.iter().sum();
    let y: Vec3 = images.iter().zip(weights).map(|(p, w)| p * (*w / total)).sum();
    let (along, square) = (normal.dot(&y), y.norm_squared());
    std::array::from_fn(|corner| {
        // The normal is the sum of the products of its corners in turn.
        let across = places[corner].map_or(Vec3::zeros(), |k| cone.corners[(k + 1) % 3] - cone.corners[(k + 2) % 3]);
        std::array::from_fn(|axis| {
            let unit = Vec3::from_fn(|row, _| f64::from(u8::from(row == axis)));
            let (dy, dn) = (unit * (weights[corner] / total), unit.cross(&across));
            let change = (dy * normal.transpose() + y * dn.transpose()) / along
                - y * normal.transpose() * ((dn.dot(&y) + normal.dot(&dy)) / (along * along))
                - (dy * y.transpose() + y * dy.transpose()) / square
                + y * y.transpose() * (2.0 * y.dot(&dy) / (square * square));
            change * jacobian
        })
    })
}

/// The shear of the radial map on a cone in a direction; `None` where the direction is not in front of the cone's plane.
fn shear(cone: &Cone, y: &Vec3) -> Option<Mat3> {
    let normal = Vec3::from(cone.normal.map(|entry| entry.middle()));
    let along = normal.dot(y);
    let shear = Mat3::identity() + y * normal.transpose() / along - y * y.transpose() / y.norm_squared();
    (along > 0.0 && shear.iter().all(|x| x.is_finite())).then_some(shear)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turning_is_the_derivative_of_the_shear_times_the_jacobian() {
        let triangle = [Vec3::new(0.9, 0.1, 0.3), Vec3::new(0.2, 0.8, 0.4), Vec3::new(0.1, 0.3, 0.9)];
        let jacobian = Mat3::new(1.0, 0.2, -0.1, 0.3, 1.2, 0.1, 0.0, -0.2, 0.8);
        // A tet below the triangle, and one that has an edge of it.
        for places in [[Some(0), Some(1), Some(2), None], [Some(2), None, Some(1), None]] {
            let others = [Vec3::new(0.3, 0.2, 0.4), Vec3::new(0.4, 0.4, 0.3), Vec3::zeros(), Vec3::new(0.2, 0.3, 0.4)];
            let images: [Vec3; 4] = std::array::from_fn(|v| places[v].map_or(others[v], |k: usize| triangle[k]));
            let weights = [0.5, 0.3, 0.1, 0.1];
            let whole = |images: &[Vec3; 4]| {
                let mut moved = triangle;
                (0..4).for_each(|v| {
                    if let Some(k) = places[v] {
                        moved[k] = images[v]
                    }
                });
                let y = images.iter().zip(weights).map(|(p, w)| p * w).sum::<Vec3>();
                shear(&Cone::over(&moved), &y).unwrap() * jacobian
            };
            let change = turning(&Cone::over(&triangle), &images, &places, &weights, &jacobian);
            let h = 1e-5;
            for (corner, axis) in (0..4).flat_map(|corner| (0..3).map(move |axis| (corner, axis))) {
                let [less, more] = [-h, h].map(|step| {
                    let mut images = images;
                    images[corner][axis] += step;
                    whole(&images)
                });
                // Truncation h^2 times a third derivative of order 10, rounding 1e-16 / h.
                let difference = (more - less) / (2.0 * h);
                assert!((difference - change[corner][axis]).norm() < 1e-8, "{corner} {axis}");
            }
        }
    }
}

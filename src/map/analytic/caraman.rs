//! Caraman's radial map of a star-shaped polyhedron, in closed form (paper eq. 19, 20).

use super::{ClosedForm, MapError};
use crate::dilatation::Dilatation;
use crate::mesh::{Mat3, Vec3};
use crate::solid::Surface;

/// A surface that is not star-shaped about the centre.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "triangle {triangle} of the surface (counted from 0) does not see the centre from within; choose another centre"
)]
pub struct CaramanError {
    /// The triangle.
    pub triangle: usize,
}

/// f(x) = u(x)^a y/|y| with y = x - centre and u = |y| over the length of the ray through x, a > 0, onto the unit ball.
///
/// In the cone over a triangle u = g . y for a fixed vector g, normal to the triangle. At the angle theta between y and g, with
/// t = tan theta, Df is a similarity times the block [[a, -a t], [0, 1]] and a 1: with
/// s1 s3 = a and s1^2 + s3^2 = a^2 (1 + t^2) + 1, K_O = s1^3 / a and K_I = s1^3 / a^2. Both grow with t, which is largest at
/// a corner of a triangle.
///
/// The cone of a point is found by going through all triangles: [`super::super::by_ray_casting`] is the way for many points of a
/// fine surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Caraman {
    exponent: f64,
    centre: Vec3,
    /// The inverse of each triangle's corners as columns, from the centre.
    cones: Vec<Mat3>,
}

impl Caraman {
    /// The map of the solid in `surface`, star-shaped about `centre`.
    ///
    /// # Errors
    /// The first triangle whose plane does not have the centre behind it.
    pub fn new(surface: &Surface, centre: Vec3, exponent: f64) -> Result<Self, CaramanError> {
        let cone = |(index, id)| {
            let corners = Mat3::from_columns(&surface.corners(id).map(|corner| corner - centre));
            let inverse = (corners.determinant() > 0.0).then(|| corners.try_inverse()).flatten();
            inverse.ok_or(CaramanError { triangle: index })
        };
        let cones = surface.ids().enumerate().map(cone).collect::<Result<_, _>>()?;
        Ok(Self { exponent, centre, cones })
    }

    /// The exponent a.
    pub fn exponent(&self) -> f64 {
        self.exponent
    }

    /// y and the gradient of u at x; y is 0 at the centre, where the gradient means nothing.
    fn place(&self, x: &Vec3) -> Result<(Vec3, Vec3), MapError> {
        let offset = x - self.centre;
        let weights = |cone: &&Mat3| (*cone * offset).min();
        let cone = self.cones.iter().max_by(|a, b| weights(a).total_cmp(&weights(b))).expect("a surface has triangles");
        let gradient = cone.row_sum().transpose();
        // Rounding of the inverse, at the condition of a cone below 1e4, moves u by less than this.
        if gradient.dot(&offset) <= 1.0 + 1e-11 {
            Ok((offset, gradient))
        } else {
            Err(self.outside(x, "it lies outside of the solid; give the surface that the mesh fills"))
        }
    }

    /// The dilatations at t^2.
    fn at(&self, squared_tangent: f64) -> Dilatation {
        let a = self.exponent;
        let sum = a * a * (1.0 + squared_tangent) + 1.0;
        // sum^2 - 4 a^2 by factors, which keeps the digits near a = 1, t = 0.
        let root = (((a - 1.0).powi(2) + a * a * squared_tangent) * (sum + 2.0 * a)).sqrt();
        let cube = (0.5 * (sum + root)).powf(1.5);
        Dilatation { inner: cube / (a * a), outer: cube / a }
    }
}

impl ClosedForm for Caraman {
    fn name(&self) -> &'static str {
        "caraman"
    }

    fn check(&self) -> Result<(), MapError> {
        super::positive("exponent", self.exponent)
    }

    fn value(&self, x: &Vec3) -> Result<Vec3, MapError> {
        let (offset, gradient) = self.place(x)?;
        if offset.norm() == 0.0 {
            return Ok(Vec3::zeros());
        }
        Ok(offset.normalize() * gradient.dot(&offset).min(1.0).powf(self.exponent))
    }

    fn jacobian(&self, x: &Vec3) -> Result<Mat3, MapError> {
        let (offset, gradient) = self.place(x)?;
        let norm = offset.norm();
        if norm == 0.0 {
            return Err(self.outside(x, "at the centre it has no derivative"));
        }
        let (direction, fraction) = (offset / norm, gradient.dot(&offset));
        let across = (Mat3::identity() - direction * direction.transpose()) * (fraction / norm);
        Ok(fraction.powf(self.exponent - 1.0) * (self.exponent * direction * gradient.transpose() + across))
    }

    fn dilatation(&self, x: &Vec3) -> Result<Dilatation, MapError> {
        let (offset, gradient) = self.place(x)?;
        if offset.norm() == 0.0 {
            return Err(self.outside(x, "at the centre it has no derivative"));
        }
        Ok(self.at(gradient.cross(&offset).norm_squared() / gradient.dot(&offset).powi(2)))
    }

    fn max_dilatation(&self) -> Option<Dilatation> {
        let steepest = self.cones.iter().map(|cone| {
            let gradient = cone.row_sum().transpose();
            // A corner has u = 1. The cone's inverse was invertible, being an inverse.
            let corners = cone.try_inverse().expect("the inverse of a matrix");
            corners.column_iter().map(|corner| gradient.cross(&corner).norm_squared()).fold(0.0, f64::max)
        });
        Some(self.at(steepest.fold(0.0, f64::max)))
    }
}

//! The point about which a solid is mapped radially.

use super::kernel::{NAMED_FACES, hidden_triangles};
use super::{KernelError, StarKernel, Surface};
use crate::mesh::Vec3;

/// The nearest centre that is offered for one that is refused keeps this part of the kernel's radius from its boundary.
const NEAREST_MARGIN: f64 = 0.01;

/// How to choose the centre.
#[derive(Clone, Debug, PartialEq)]
pub enum CentreChoice {
    /// The centre of the largest ball in the kernel.
    Kernel,
    /// The centroid of the solid's volume.
    Centroid,
    /// The centre of the bounding box (the paper's choice in section 3.5).
    BoundingBox,
    /// A given point.
    At(Vec3),
    /// The centre for which the radial map has the least max K; needs the cargo feature `nlopt`.
    Optimize,
}

impl CentreChoice {
    /// The point this names for any solid, star-shaped or not; `None` for the rules that look for a star centre.
    pub fn point(&self, surface: &Surface) -> Option<Vec3> {
        match self {
            Self::Kernel | Self::Optimize => None,
            Self::Centroid => Some(surface.centroid()),
            Self::BoundingBox => {
                let (low, high) = surface.bounding_box();
                Some((low + high) / 2.0)
            }
            Self::At(position) => Some(*position),
        }
    }
}

/// Why a solid has no such centre.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CentreError {
    /// The solid has no centre at all.
    #[error(transparent)]
    Kernel(#[from] KernelError),
    /// A given coordinate is NaN or infinite.
    #[error("the centre {0:?} has a coordinate that is not finite")]
    NotFinite([f64; 3]),
    /// The chosen centre does not see the whole surface.
    #[error(
        "the solid is not star-shaped about {position:?}: {count} triangles are seen edge-on or from behind, such as \
         {faces:?} (counted from 0); the nearest centre that works is about {nearest:?}, and \"kernel\" finds the deepest"
    )]
    Outside {
        /// The centre.
        position: [f64; 3],
        /// How many triangles it does not see from within.
        count: usize,
        /// Up to eight of them.
        faces: Vec<u32>,
        /// The nearest point at a small distance inside the kernel.
        nearest: [f64; 3],
    },
    /// [`CentreChoice::Optimize`] without the feature.
    #[error("this build cannot optimize the centre: build with the cargo feature `nlopt` (which is on by default)")]
    NotBuiltIn,
}

/// A centre about which a solid is star-shaped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StarCentre {
    /// Where it is; it sees every triangle from within, by exact predicate.
    pub position: Vec3,
    /// The radius of the largest ball in the kernel, in the solid's units of length.
    pub kernel_radius: f64,
    /// The alpha of the paper's geometric condition (section 2.4): the least angle, in radians, between a ray from the
    /// centre and the plane of the triangle that it meets.
    pub smallest_angle: f64,
}

/// Chooses the centre and proves that the solid is star-shaped about it.
///
/// # Errors
/// The solid is not star-shaped, or not about this centre: with triangles to show it, and the nearest centre that works.
pub fn star_centre(surface: &Surface, choice: &CentreChoice) -> Result<StarCentre, CentreError> {
    let kernel = StarKernel::of(surface)?;
    let position = match (choice, choice.point(surface)) {
        (_, Some(point)) => point,
        (CentreChoice::Optimize, None) => optimize(surface, &kernel)?,
        (_, None) => kernel.centre,
    };
    if !position.iter().all(|x| x.is_finite()) {
        return Err(CentreError::NotFinite(position.into()));
    }
    let hidden = hidden_triangles(surface, &position);
    if !hidden.is_empty() {
        let margin = NEAREST_MARGIN * kernel.radius;
        return Err(CentreError::Outside {
            position: position.into(),
            count: hidden.len(),
            faces: hidden.iter().take(NAMED_FACES).map(|triangle| triangle.0).collect(),
            nearest: kernel.nearest(surface, &position, margin)?.map(|x| in_few_digits(x, margin)).into(),
        });
    }
    let smallest_angle = smallest_angle(surface, &position);
    Ok(StarCentre { position, kernel_radius: kernel.radius, smallest_angle })
}

/// A coordinate rounded to be read and typed in, by less than a tenth of `margin`.
fn in_few_digits(x: f64, margin: f64) -> f64 {
    let (tenths, rounded) = ((0.1 * margin).log10().floor() as i32, |digits: f64| (x * digits).round() / digits + 0.0);
    Some(rounded(10f64.powi(-tenths))).filter(|x| x.is_finite()).unwrap_or(x)
}

#[cfg(feature = "nlopt")]
fn optimize(surface: &Surface, kernel: &StarKernel) -> Result<Vec3, CentreError> {
    Ok(super::optimal_centre::optimal_centre(surface, kernel))
}

#[cfg(not(feature = "nlopt"))]
fn optimize(_: &Surface, _: &StarKernel) -> Result<Vec3, CentreError> {
    Err(CentreError::NotBuiltIn)
}

/// The least angle between a ray from the centre and the plane of its triangle. Its sine is distance of the plane over
/// length of the ray, least in each triangle at the vertex farthest from the centre.
fn smallest_angle(surface: &Surface, centre: &Vec3) -> f64 {
    let sine = |triangle| {
        let corners = surface.corners(triangle).map(|p| p - centre);
        let farthest = corners.iter().map(Vec3::norm).fold(0.0, f64::max);
        surface.normal(triangle).dot(&corners[0]) / farthest
    };
    // Rounding may lift the sine above 1; NaN cannot win a minimum.
    surface.ids().map(sine).fold(1.0, f64::min).max(0.0).asin()
}

#[cfg(test)]
mod tests;

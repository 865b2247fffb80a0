//! Maps of closed surfaces of genus 0 onto the sphere.
//!
//! Progressive embedding (Praun & Hoppe 2003, "Spherical parametrization and remeshing", ACM TOG 22(3)): edges are contracted
//! until a tetrahedron is left, which is put on the sphere; then the contractions are undone one by one, each vertex going to
//! a point that sees its neighbours' ring from within, and the vertices around are moved to lower the distortion. In exact
//! arithmetic an edge to contract and a point to go to always exist, whatever the surface: no triangle is ever flipped.

mod distortion;
mod embed;
mod kernel;
mod relax;
mod rings;
mod simplify;

pub use distortion::SphereDistortion;

use crate::mesh::{Vec3, View};
use crate::solid::{Surface, SurfaceError};

/// What a map onto the sphere weighs.
#[derive(Clone, Debug, PartialEq)]
pub struct SphereSettings {
    /// Weight of the square root of area over image area of each triangle, >= 0, beside the ratio of its singular values,
    /// which is at least 1. It keeps what sticks out (limbs, fins) from shrinking to nothing: with 0, image areas of 1e-24 were
    /// seen; more than 1e-5 costs angles. Areas are relative to the whole. Default: 1e-8.
    pub shrinkage_weight: f64,
    /// Weight of the mean of that ratio of areas and of its inverse, >= 0: the larger, the more areas are kept at the cost of
    /// angles. Default: 0, angles only.
    pub area_weight: f64,
}

impl Default for SphereSettings {
    fn default() -> Self {
        Self { shrinkage_weight: 1e-8, area_weight: 0.0 }
    }
}

/// Why there is no map onto the sphere.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SphereError {
    /// The triangles are no closed surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// The surface has handles.
    #[error(
        "the surface has {genus} handle{}, and only a surface without can be mapped onto a sphere; cut or fill {}",
        if *genus == 1 { "" } else { "s" }, if *genus == 1 { "it" } else { "them" }
    )]
    Genus {
        /// How many.
        genus: usize,
    },
    /// A weight that is no weight.
    #[error("the {name} is {value}, but must be finite and at least 0")]
    Weight {
        /// The setting's name.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// Rounding left no place for a vertex.
    #[error(
        "no place for vertex {vertex} (counted from 0) at {at:?} was found on the sphere, whose triangles there are below \
         rounding; remesh the surface there, or raise the shrinkage weight"
    )]
    NoPlace {
        /// The vertex.
        vertex: usize,
        /// Where it is on the surface.
        at: [f64; 3],
    },
}

/// A map of a closed surface onto the unit sphere, one-to-one when the image triangles are projected from the centre: every
/// image triangle is seen from the centre from within, by exact predicate, and together they cover the sphere once.
#[derive(Clone, Debug, PartialEq)]
pub struct SphereMap {
    positions: Vec<Vec3>,
}

impl SphereMap {
    /// The image of each vertex of the surface, a unit vector up to rounding.
    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// The same, without the map.
    pub fn into_positions(self) -> Vec<Vec3> {
        self.positions
    }
}

/// Maps a closed surface of genus 0 onto the unit sphere with little distortion. The same for the same input, to the bit.
///
/// Time grows little faster than the number of triangles: some 10 s for 100,000.
///
/// ```
/// use qcball::{Solid, sphere::{SphereDistortion, SphereSettings, sphere_map}};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let surface = Solid::Dodecahedron.surface()?;
/// let map = sphere_map(&surface, &SphereSettings::default())?;
/// assert!(map.positions().iter().all(|p| (p.norm() - 1.0).abs() < 1e-15));
/// assert!(SphereDistortion::of(&surface, map.positions()).max_stretch < 2.0);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// Handles, a weight that is negative or not finite, or triangles so thin that rounding leaves no place for a vertex.
pub fn sphere_map(surface: &Surface, settings: &SphereSettings) -> Result<SphereMap, SphereError> {
    for (name, value) in [("shrinkage weight", settings.shrinkage_weight), ("area weight", settings.area_weight)] {
        if !(value.is_finite() && value >= 0.0) {
            return Err(SphereError::Weight { name, value });
        }
    }
    if surface.genus() > 0 {
        return Err(SphereError::Genus { genus: surface.genus() });
    }
    let no_place = |vertex: usize| SphereError::NoPlace { vertex, at: surface.points()[vertex].into() };
    let positions = embed::embed(surface, settings).map_err(no_place)?;
    let corners = surface.triangles().iter().map(|triangle| triangle.map(|v| &positions[v.index()]));
    match View::from(&Vec3::zeros(), corners) {
        View::Covers(1) => Ok(SphereMap { positions }),
        View::FacesAway(triangle) => Err(no_place(surface.triangles()[triangle][0].index())),
        View::Covers(_) => Err(no_place(0)),
    }
}

#[cfg(test)]
mod tests;

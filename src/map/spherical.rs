//! Starts for a solid of any shape: its boundary onto the sphere, its inside in balance.

use super::{harmonic, hyperbolic_harmonic};
use crate::domain::Domain;
use crate::mesh::Vec3;
use crate::solid::Surface;
use crate::sphere::{SphereDistortion, SphereError, SphereSettings, sphere_map};

/// Two maps of a domain into the ball with the same boundary values on the sphere; each may have flipped tets.
#[derive(Clone, Debug, PartialEq)]
pub struct SphericalStarts {
    /// Image positions, hyperbolic harmonic inside: what is long and thin keeps its room.
    pub hyperbolic: Vec<Vec3>,
    /// Image positions, harmonic inside: fewer flipped tets, of sizes that may differ by many orders more.
    pub harmonic: Vec<Vec3>,
    /// How far the boundary's map is from a similarity.
    pub distortion: SphereDistortion,
}

/// Maps the boundary of a domain onto the unit sphere by progressive embedding ([`sphere_map`]), with these weights, and the inside after it
/// ([`hyperbolic_harmonic`] and [`harmonic()`]).
///
/// # Errors
/// A domain that is not a ball, or a boundary on which [`sphere_map`] fails.
pub fn spherical_starts(domain: &Domain, settings: &SphereSettings) -> Result<SphericalStarts, SphereError> {
    // The surface's vertices are those of the boundary, in their order.
    let surface = Surface::from_triangles(domain.mesh().points().to_vec(), domain.boundary().triangles())?;
    let on_sphere = sphere_map(&surface, settings)?;
    let mut boundary_image = vec![Vec3::zeros(); domain.mesh().points().len()];
    let on_boundary = domain.boundary().vertex_mask().iter().zip(&mut boundary_image).filter(|(on, _)| **on);
    on_boundary.zip(on_sphere.positions()).for_each(|((_, image), position)| *image = *position);
    Ok(SphericalStarts {
        hyperbolic: hyperbolic_harmonic(domain, &boundary_image),
        harmonic: harmonic(domain, &boundary_image),
        distortion: SphereDistortion::of(&surface, on_sphere.positions()),
    })
}

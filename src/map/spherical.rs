//! Starts for a solid of any shape: its boundary onto the sphere, its inside in balance.

use super::{harmonic, hyperbolic_harmonic};
use crate::domain::Domain;
use crate::mesh::{Vec3, collar};
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

/// Weight of the areas in the boundary map over a collar. A heart of 610 tets, 14 vertices of them inside, keeps flipped tets with 0 and any
/// collar, and with 0.03 to 0.5 and none; with this and collars of a half on it has none.
pub const AREA_WEIGHT_OVER_COLLAR: f64 = 0.2;

/// The starts of a domain over a [`collar()`] of as many tets again, with areas weighed in the boundary map, for one whose tets resist
/// untangling from those without; the domain with its collar, whose first vertices are those that were given, and how many edges were halved for
/// it.
///
/// `None` where rounding makes halves of tets flat, and where [`spherical_starts`] fails.
pub fn spherical_starts_over_collar(domain: &Domain) -> Option<(Domain, SphericalStarts, usize)> {
    let mesh = domain.mesh();
    let collar = collar(mesh, domain.boundary(), 2 * mesh.tets().len());
    let domain = Domain::new(collar.mesh().ok()?).ok()?;
    let weights = SphereSettings { area_weight: AREA_WEIGHT_OVER_COLLAR, ..SphereSettings::default() };
    let starts = spherical_starts(&domain, &weights).ok()?;
    Some((domain, starts, collar.edge_splits()))
}

//! The first half of a run: from what the plan names to a domain with radial coordinates.

use std::path::Path;

use super::error::{Fault, RunError};
use crate::config::{DomainSource, MapKind, Plan};
use crate::domain::Domain;
use crate::map::{RadialCoordinates, RayEnd, by_ray_casting};
use crate::mesh::io::{read_surface, read_tets};
use crate::mesh::{PolygonSoup, TetMesh, Vec3, VertexId, full_boundary};
use crate::report::Splits;
use crate::solid::{StarCentre, Surface, best_radial_exponent, radial_max_dilatation, shell_mesh, star_centre};

/// A domain, its star centre and where its vertices lie on the rays from there.
pub(super) struct Start {
    /// The solid or its file, in words.
    pub origin: String,
    pub domain: Domain,
    /// The star centre; `None` for the map "farthest".
    pub centre: Option<StarCentre>,
    pub exponent: f64,
    /// Largest K of the smooth radial map, if there is a star centre.
    pub smooth_k: Option<f64>,
    pub coordinates: Vec<RadialCoordinates>,
    /// The splits that freed locked tets, if the mesh was given and needed any.
    pub splits: Option<Splits>,
    pub warnings: Vec<String>,
}

impl Start {
    pub fn of(plan: &Plan) -> Result<Self, RunError> {
        match &plan.domain {
            DomainSource::Solid(solid) => Self::of_surface(solid.to_string(), solid.surface()?, plan),
            DomainSource::Surface(path) => {
                let origin = path.display().to_string();
                let surface = Surface::from_soup(read_surface(path)?).map_err(RunError::at(&origin))?;
                Self::of_surface(origin, surface, plan)
            }
            DomainSource::Mesh(path) => Self::of_mesh(path, plan),
        }
    }

    fn of_surface(origin: String, surface: Surface, plan: &Plan) -> Result<Self, RunError> {
        let centre = star_centre(&surface, &plan.centre).map_err(RunError::at(&origin))?;
        let shell = shell_mesh(&surface, centre.position, &plan.mesh).map_err(RunError::at(&origin))?;
        let coordinates = RadialCoordinates::of_shell(&shell);
        let domain = Domain::new(shell.mesh).map_err(RunError::at(&origin))?;
        let mut warnings = Vec::new();
        if surface.was_inside_out() {
            warnings.push("the surface was inside out; all its triangles were reversed".into());
        }
        let (exponent, smooth_k) = exponent(plan, &surface, &centre);
        let smooth_k = Some(smooth_k);
        Ok(Self { origin, domain, centre: Some(centre), exponent, smooth_k, coordinates, splits: None, warnings })
    }

    fn of_mesh(path: &Path, plan: &Plan) -> Result<Self, RunError> {
        let origin = path.display().to_string();
        let soup = read_tets(path)?;
        let count = soup.tets.len();
        let (mesh, exchanged) =
            TetMesh::from_either_orientation(soup.points, soup.tets).map_err(RunError::at(&origin))?;
        let mut warnings = Vec::new();
        if exchanged > 0 {
            warnings.push(format!(
                "{exchanged} of {count} tets were stored with negative orientation; two vertices of each were exchanged"
            ));
        }
        let (domain, splits) = freed(Domain::new(mesh).map_err(RunError::at(&origin))?, plan.keep_mesh)
            .map_err(|fault| RunError::Fault { origin: origin.clone(), fault })?;
        let surface = boundary_surface(&domain).map_err(RunError::at(&origin))?;
        let fault = |fault| RunError::Fault { origin: origin.clone(), fault };
        // The plan allows "farthest" only with a rule that names a point for any solid.
        let (position, centre, end) = match (plan.map.kind, plan.centre.point(&surface)) {
            (MapKind::Farthest, Some(point)) => (point, None, RayEnd::Farthest),
            _ => {
                let centre = star_centre(&surface, &plan.centre).map_err(RunError::at(&origin))?;
                (centre.position, Some(centre), RayEnd::Only)
            }
        };
        if end == RayEnd::Farthest {
            warnings.push(
                "each ray ends at its farthest boundary point: the image is a part of the ball, and only the orientation of \
                 the tets is known of it, so that it may overlap itself"
                    .into(),
            );
        }
        let coordinates = radial_coordinates(&domain, &surface, position, end).map_err(fault)?;
        let (exponent, smooth_k) = match &centre {
            Some(centre) => {
                let (exponent, smooth_k) = exponent(plan, &surface, centre);
                (exponent, Some(smooth_k))
            }
            None => (plan.map.exponent.unwrap_or(1.0), None),
        };
        Ok(Self { origin, domain, centre, exponent, smooth_k, coordinates, splits, warnings })
    }
}

/// The exponent of the plan, or the best one, and the largest K of the smooth radial map with it.
fn exponent(plan: &Plan, surface: &Surface, centre: &StarCentre) -> (f64, f64) {
    let exponent = plan.map.exponent.unwrap_or_else(|| best_radial_exponent(surface, &centre.position));
    (exponent, radial_max_dilatation(surface, &centre.position, exponent))
}

/// The domain with its boundary made a full subcomplex, unless the mesh is to be kept.
fn freed(domain: Domain, keep_mesh: bool) -> Result<(Domain, Option<Splits>), Fault> {
    if keep_mesh {
        return Ok((domain, None));
    }
    let full = full_boundary(domain.mesh(), domain.boundary())?;
    if full.parents.is_empty() {
        return Ok((domain, None));
    }
    let splits = Splits { edges: full.edge_splits, faces: full.face_splits, tets_before: domain.mesh().tets().len() };
    Ok((Domain::new(full.mesh)?, Some(splits)))
}

/// The boundary of a mesh as a surface, its vertices renumbered.
fn boundary_surface(domain: &Domain) -> Result<Surface, Fault> {
    let boundary = domain.boundary();
    let mut number = vec![VertexId(0); domain.mesh().points().len()];
    let mut points = Vec::new();
    for (vertex, point) in domain.mesh().points().iter().enumerate() {
        if boundary.vertex_mask()[vertex] {
            number[vertex] = VertexId(points.len() as u32);
            points.push(*point);
        }
    }
    let polygons = boundary.triangles().iter().map(|t| t.map(|v| number[v.index()]).to_vec()).collect();
    Ok(Surface::from_soup(PolygonSoup { points, polygons })?)
}

/// Radial coordinates of all vertices, those of the boundary at the ends of their rays.
fn radial_coordinates(
    domain: &Domain,
    surface: &Surface,
    centre: Vec3,
    end: RayEnd,
) -> Result<Vec<RadialCoordinates>, Fault> {
    let mut coordinates = by_ray_casting(surface, centre, domain.mesh().points(), end)?;
    for (at, &on_boundary) in coordinates.iter_mut().zip(domain.boundary().vertex_mask()) {
        // With "farthest" a boundary point may lie before the end of its ray.
        if on_boundary && (end == RayEnd::Only || at.fraction > 1.0 - 1e-9) {
            at.fraction = 1.0;
        }
    }
    Ok(coordinates)
}

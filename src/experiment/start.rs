//! The first half of a run: from what the plan names to a domain with radial coordinates.

use std::path::Path;

use super::error::{Fault, RunError};
use crate::config::{DomainSource, MapKind, MeshPlan, Plan};
use crate::domain::Domain;
use crate::map::{RadialCoordinates, RayEnd, by_ray_casting};
use crate::mesh::io::{read_surface, read_tets};
use crate::mesh::{PolygonSoup, TetMesh, Vec3, VertexId, full_boundary};
use crate::report::Splits;
use crate::solid::{
    StarCentre, Surface, best_radial_exponent, external_mesh, radial_max_dilatation, shell_mesh, star_centre,
};

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
    /// The splits that freed locked tets, if the mesh was not made in shells and needed any.
    pub splits: Option<Splits>,
    pub warnings: Vec<String>,
}

impl Start {
    pub fn of(plan: &Plan) -> Result<Self, RunError> {
        let origin = match &plan.domain {
            DomainSource::Solid(solid) => solid.to_string(),
            DomainSource::Surface(path) | DomainSource::Mesh(path) => path.display().to_string(),
        };
        let at = |fault| RunError::Fault { origin: origin.clone(), fault };
        let mut start = match &plan.domain {
            DomainSource::Solid(solid) => Self::of_surface(&solid.surface()?, plan).map_err(at),
            DomainSource::Surface(path) => {
                let surface = Surface::from_soup(read_surface(path)?).map_err(RunError::at(&origin))?;
                Self::of_surface(&surface, plan).map_err(at)
            }
            DomainSource::Mesh(path) => Self::of_mesh(path, plan),
        }?;
        start.origin = origin;
        Ok(start)
    }

    fn of_surface(surface: &Surface, plan: &Plan) -> Result<Self, Fault> {
        let mut start = match &plan.mesh {
            MeshPlan::Shell(settings) => {
                let centre = star_centre(surface, &plan.centre)?;
                let shell = shell_mesh(surface, centre.position, settings)?;
                let coordinates = RadialCoordinates::of_shell(&shell);
                let (exponent, smooth_k) = exponent(plan, surface, Some(&centre));
                let (domain, centre) = (Domain::new(shell.mesh)?, Some(centre));
                let (origin, splits, warnings) = (String::new(), None, Vec::new());
                Self { origin, domain, centre, exponent, smooth_k, coordinates, splits, warnings }
            }
            MeshPlan::External(settings) => {
                Self::of_domain(Domain::new(external_mesh(surface, settings)?)?, surface, plan)?
            }
        };
        if surface.was_inside_out() {
            start.warnings.push("the surface was inside out; all its triangles were reversed".into());
        }
        Ok(start)
    }

    fn of_mesh(path: &Path, plan: &Plan) -> Result<Self, RunError> {
        let origin = path.display().to_string();
        let soup = read_tets(path)?;
        let count = soup.tets.len();
        let (mesh, exchanged) =
            TetMesh::from_either_orientation(soup.points, soup.tets).map_err(RunError::at(&origin))?;
        let domain = Domain::new(mesh).map_err(RunError::at(&origin))?;
        let at = |fault| RunError::Fault { origin: origin.clone(), fault };
        let surface = boundary_surface(&domain).map_err(at)?;
        let mut start = Self::of_domain(domain, &surface, plan).map_err(at)?;
        if exchanged > 0 {
            start.warnings.push(format!(
                "{exchanged} of {count} tets were stored with negative orientation; two vertices of each were exchanged"
            ));
        }
        Ok(start)
    }

    /// Frees a mesh's locked tets and casts rays through its vertices.
    fn of_domain(domain: Domain, surface: &Surface, plan: &Plan) -> Result<Self, Fault> {
        let (domain, splits) = freed(domain, plan.keep_mesh)?;
        let mut warnings = Vec::new();
        // The plan allows "farthest" only with a rule that names a point for any solid.
        let (position, centre, end) = match (plan.map.kind, plan.centre.point(surface)) {
            (MapKind::Farthest, Some(point)) => (point, None, RayEnd::Farthest),
            _ => {
                let centre = star_centre(surface, &plan.centre)?;
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
        let coordinates = radial_coordinates(&domain, surface, position, end)?;
        let (exponent, smooth_k) = exponent(plan, surface, centre.as_ref());
        Ok(Self { origin: String::new(), domain, centre, exponent, smooth_k, coordinates, splits, warnings })
    }
}

/// The exponent of the plan, or the best one, and the largest K of the smooth radial map with it.
fn exponent(plan: &Plan, surface: &Surface, centre: Option<&StarCentre>) -> (f64, Option<f64>) {
    // The plan asks for the best one only with a star centre.
    let Some(centre) = centre else { return (plan.map.exponent.unwrap_or(1.0), None) };
    let exponent = plan.map.exponent.unwrap_or_else(|| best_radial_exponent(surface, &centre.position));
    (exponent, Some(radial_max_dilatation(surface, &centre.position, exponent)))
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

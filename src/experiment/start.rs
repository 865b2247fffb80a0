//! The first half of a run: from what the plan names to a domain with radial coordinates.

use std::path::Path;

use super::error::{Fault, RunError};
use crate::config::{DomainSource, MeshPlan, Plan};
use crate::domain::Domain;
use crate::map::{RadialCoordinates, by_ray_casting};
use crate::mesh::io::{read_surface, read_tets};
use crate::mesh::{PolygonSoup, TetMesh, Vec3, VertexId, full_boundary};
use crate::report::Splits;
use crate::solid::{ExternalSettings, StarCentre, Surface, external_mesh, shell_mesh, star_centre};

/// A domain, its star centre and where its vertices lie on the rays from there.
pub(super) struct Start {
    /// The solid or its file, in words.
    pub origin: String,
    pub domain: Domain,
    pub centre: StarCentre,
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
        let (domain, coordinates, splits) = match &plan.mesh {
            MeshPlan::Shell(settings) => {
                let shell = shell_mesh(&surface, centre.position, settings).map_err(RunError::at(&origin))?;
                let coordinates = RadialCoordinates::of_shell(&shell);
                (Domain::new(shell.mesh).map_err(RunError::at(&origin))?, coordinates, None)
            }
            MeshPlan::External(settings) => external(&surface, centre.position, settings)
                .map_err(|fault| RunError::Fault { origin: origin.clone(), fault })?,
        };
        let mut warnings = Vec::new();
        if surface.was_inside_out() {
            warnings.push("the surface was inside out; all its triangles were reversed".into());
        }
        Ok(Self { origin, domain, centre, coordinates, splits, warnings })
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
        let centre = star_centre(&surface, &plan.centre).map_err(RunError::at(&origin))?;
        let coordinates = radial_coordinates(&domain, &surface, centre.position)
            .map_err(|fault| RunError::Fault { origin: origin.clone(), fault })?;
        Ok(Self { origin, domain, centre, coordinates, splits, warnings })
    }
}

/// A domain made by an external mesher, its radial coordinates, and the splits that freed its locked tets.
fn external(
    surface: &Surface,
    centre: Vec3,
    settings: &ExternalSettings,
) -> Result<(Domain, Vec<RadialCoordinates>, Option<Splits>), Fault> {
    let (domain, splits) = freed(Domain::new(external_mesh(surface, settings)?)?, false)?;
    let coordinates = radial_coordinates(&domain, surface, centre)?;
    Ok((domain, coordinates, splits))
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
fn radial_coordinates(domain: &Domain, surface: &Surface, centre: Vec3) -> Result<Vec<RadialCoordinates>, Fault> {
    let mut coordinates = by_ray_casting(surface, centre, domain.mesh().points())?;
    for (at, &on_boundary) in coordinates.iter_mut().zip(domain.boundary().vertex_mask()) {
        if on_boundary {
            at.fraction = 1.0;
        }
    }
    Ok(coordinates)
}

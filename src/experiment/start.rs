//! The first half of a run: from what the plan names to a domain and the map to start from.

use std::path::Path;

use super::error::{Fault, RunError};
use crate::config::{DomainSource, InitialMap, MeshPlan, Plan};
use crate::domain::Domain;
use crate::map::{AnalyticMap, RadialCoordinates, RayEnd, caraman};
use crate::mesh::io::{read_surface, read_tets};
use crate::mesh::{Orientation, TetMesh, Vec3, full_boundary, orientation};
use crate::report::{MapFigures, Splits};
use crate::solid::{
    StarCentre, Surface, best_radial_exponent, external_mesh, flag_mesh, radial_max_dilatation, shell_mesh, star_centre,
};

/// A domain and a map of it.
pub(super) struct Start {
    /// The solid or its file, in words.
    pub origin: String,
    pub domain: Domain,
    /// The star centre of the radial map; `None` for other maps.
    pub centre: Option<StarCentre>,
    /// Image positions.
    pub image: Vec<Vec3>,
    pub map: MapFigures,
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
                let domain = Domain::new(shell.mesh)?;
                match &plan.map {
                    InitialMap::Formula(map) => Self::of_formula(domain, map)?,
                    _ => Self::of_rays(domain, surface, Some(centre), &coordinates, plan),
                }
            }
            MeshPlan::Flag(settings) => {
                let centre = star_centre(surface, &plan.centre)?;
                let flags = flag_mesh(surface, centre.position, settings)?;
                Self::of_domain(Domain::new(flags.mesh)?, surface, plan)?
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
        let surface = Surface::from_triangles(domain.mesh().points().to_vec(), domain.boundary().triangles());
        let surface = surface.map_err(RunError::at(&origin))?;
        let mut start = Self::of_domain(domain, &surface, plan).map_err(at)?;
        if exchanged > 0 {
            start.warnings.push(format!(
                "{exchanged} of {count} tets were stored with negative orientation; two vertices of each were exchanged"
            ));
        }
        Ok(start)
    }

    /// Frees a mesh's locked tets and maps its vertices.
    fn of_domain(domain: Domain, surface: &Surface, plan: &Plan) -> Result<Self, Fault> {
        let (domain, splits) = freed(domain, plan.keep_mesh)?;
        let (position, centre, end) = match (&plan.map, plan.centre.point(surface)) {
            (InitialMap::Formula(map), _) => return Ok(Self { splits, ..Self::of_formula(domain, map)? }),
            // The plan allows "farthest" only with a rule that names a point for any solid.
            (InitialMap::Farthest { .. }, Some(point)) => (point, None, RayEnd::Farthest),
            _ => {
                let centre = star_centre(surface, &plan.centre)?;
                (centre.position, Some(centre), RayEnd::Only)
            }
        };
        let coordinates = RadialCoordinates::of_domain(&domain, surface, position, end)?;
        let mut start = Self { splits, ..Self::of_rays(domain, surface, centre, &coordinates, plan) };
        if end == RayEnd::Farthest {
            start.warnings.push(
                "each ray ends at its farthest boundary point: the image is a part of the ball, and only the orientation of \
                 the tets is known of it, so that it may overlap itself"
                    .into(),
            );
        }
        Ok(start)
    }

    /// Caraman's map or its extension.
    fn of_rays(
        domain: Domain,
        surface: &Surface,
        centre: Option<StarCentre>,
        coordinates: &[RadialCoordinates],
        plan: &Plan,
    ) -> Self {
        let position = centre.map(|centre| centre.position);
        let (kind, given) = match &plan.map {
            InitialMap::Farthest { exponent } => ("farthest", Some(*exponent)),
            InitialMap::Radial { exponent } => ("radial", *exponent),
            InitialMap::Formula(_) => ("radial", None),
        };
        let best = || position.map(|position| best_radial_exponent(surface, &position));
        let exponent = given.or_else(best).unwrap_or(1.0);
        let map = MapFigures {
            map: format!("{kind}, exponent {exponent}"),
            radial_exponent: Some(exponent),
            radial_smooth_k: position.map(|position| radial_max_dilatation(surface, &position, exponent)),
            closed_form_k: None,
        };
        let image = caraman(coordinates, exponent);
        Self { origin: String::new(), domain, centre, image, map, splits: None, warnings: Vec::new() }
    }

    /// A map in closed form, of the vertices.
    fn of_formula(domain: Domain, formula: &AnalyticMap) -> Result<Self, Fault> {
        let points = domain.mesh().points();
        let image = formula.apply(points).map_err(|(vertex, error)| {
            let [x, y, z] = points[vertex].into();
            Fault::Map { vertex, at: [x, y, z], error: Box::new(error) }
        })?;
        if let Some(vertex) = far_outside(&domain, &image) {
            return Err(Fault::Torn { vertex });
        }
        let tets = domain.mesh().tets();
        let flipped = tets.iter().filter(|tet| orientation(tet.map(|v| &image[v.index()])) == Orientation::Negative);
        let flipped = flipped.count();
        // A few may be: those of a coarse mesh that a curved image needs finer.
        if 2 * flipped > tets.len() {
            return Err(Fault::Mirrored { flipped, tets: tets.len() });
        }
        let map = MapFigures {
            map: formula.to_string(),
            radial_exponent: None,
            radial_smooth_k: None,
            closed_form_k: formula.max_dilatation().map(|dilatation| dilatation.k()).filter(|k| k.is_finite()),
        };
        let (origin, centre, splits, warnings) = (String::new(), None, None, Vec::new());
        Ok(Self { origin, domain, centre, image, map, splits, warnings })
    }
}

/// A vertex whose image is no part of the image of a ball: beyond the box around the boundary's image by more than the
/// length of its diagonal, which leaves room for what bulges between the vertices.
fn far_outside(domain: &Domain, image: &[Vec3]) -> Option<usize> {
    let of_boundary = || image.iter().zip(domain.boundary().vertex_mask()).filter(|(_, on)| **on).map(|(p, _)| *p);
    let low = of_boundary().reduce(|a, b| a.inf(&b))?;
    let high = of_boundary().reduce(|a, b| a.sup(&b))?;
    let room = (high - low).norm();
    image.iter().position(|p| (low - p).max() > room || (p - high).max() > room)
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

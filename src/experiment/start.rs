//! The first half of a run: from what the plan names to a domain and the map to start from.

mod instead;

use std::collections::BTreeMap;
use std::path::Path;

use super::corners::{Flags, corners};
use super::error::{Fault, RunError};
use super::mesher::{grazed, instead_of_shells, is_grazed, mesh_of_any_solid, more_cells};
use super::splits::{between_corners, freed, halved_for_corners, row_of_change};
use super::warped::chamber;
use crate::cancel::Cancel;
use crate::config::{DomainSource, InitialMap, MeshPlan, Plan};
use crate::dilatation::number;
use crate::domain::Domain;
use crate::map::{AnalyticMap, Corners, RadialCoordinates, RayEnd, SphericalStarts, caraman, spherical_starts};
use crate::measure::{Measured, measure_onto_ball_until, measure_warped_onto_ball};
use crate::mesh::io::{ReadError, SolidFile, read_solid, read_surface, shown_path};
use crate::mesh::{
    MeshChanges, Orientation, PolygonSoup, Subdivision, TetMesh, TetSoup, Unit, Vec3, VertexId, orientation,
};
use crate::refine::Middles;
use crate::report::{MapFigures, RefinementFigures, Splits};
use crate::solid::{
    CentreError, ExternalSettings, KernelError, Refinement, ShellError, ShellSettings, StarCentre, Surface,
    best_radial_exponent, check_filled, external_mesh, flag_mesh, inscribed_stretch, radial_max_dilatation,
    shell_mesh_until, star_centre,
};
use crate::sphere::SphereSettings;

/// A domain and a map of it.
#[derive(Clone)]
pub(crate) struct Start {
    /// The solid or its file, in words.
    pub origin: String,
    /// blake3 of the file; `None` for built-in solids.
    pub input_hash: Option<String>,
    pub domain: Domain,
    /// The units in which lengths of the domain and of the image are counted here.
    pub units: [Unit; 2],
    /// The star centre of the radial map; `None` for other maps.
    pub centre: Option<StarCentre>,
    /// Image positions.
    pub image: Vec<Vec3>,
    /// Others with the same boundary, to begin again with where tets resist; spherical starts only.
    pub second: Option<Vec<Vec3>>,
    /// Whether a spherical start may take the place of this radial one, where its tets resist untangling.
    pub may_be_spherical: bool,
    /// Whether one over a collar may take the place of a spherical one, likewise.
    pub may_have_collar: bool,
    pub map: MapFigures,
    /// How the surface was refined, if that was left to the program.
    pub refinement: Option<RefinementFigures>,
    /// The splits that parted corners and freed locked tets, if the mesh needed any.
    pub splits: Option<Splits>,
    /// The flags of a flag mesh.
    pub flags: Option<Flags>,
    /// The corners of a map that is not piecewise linear there.
    pub corners: Option<Corners>,
    /// Whether its maps are to commute with the mirror planes of the domain.
    pub symmetric: bool,
    pub warnings: Vec<String>,
}

impl Start {
    /// # Errors
    /// What is wrong with the solid; [`RunError::Interrupted`] if the plan's work was cancelled before there was a map.
    pub fn of(plan: &Plan) -> Result<Self, RunError> {
        match Self::without_corners(plan).and_then(|start| start.with_corners(plan)) {
            // A mesher that was ended is no fault of the input.
            Err(_) if plan.optimize.cancel.is_raised() => Err(RunError::Interrupted),
            start => start,
        }
    }

    /// The cones of the corners, if the plan warps them.
    fn with_corners(self, plan: &Plan) -> Result<Self, RunError> {
        let corners = corners(&self.domain, self.flags.as_ref(), plan).map_err(RunError::at(&self.origin))?;
        let is_compared = self.seeks_powers_on_halves(plan);
        let mut warnings = self.warnings;
        warnings.extend(self.splits.and_then(|splits| halved_for_corners(splits, is_compared)));
        Ok(Self { corners, symmetric: plan.symmetric, warnings, ..self })
    }

    /// Measures the map with these images of the vertices, onto the ball too, unless that is cancelled; at a deadline its upper end is coarse.
    pub fn measure(&self, image: &[Vec3], cancel: &Cancel) -> Measured {
        match &self.corners {
            None => measure_onto_ball_until(&self.domain, image, cancel),
            Some(corners) => {
                let chamber = chamber(self, image);
                measure_warped_onto_ball(&self.domain, corners, image, chamber.as_deref(), cancel)
            }
        }
    }

    fn without_corners(plan: &Plan) -> Result<Self, RunError> {
        match &plan.domain {
            DomainSource::Solid(solid) => {
                let origin = solid.to_string();
                let start =
                    Self::of_surface(&solid.surface()?, plan, Unit::default()).map_err(RunError::at(&origin))?;
                Ok(Self { origin, ..start })
            }
            DomainSource::Surface(path) => Self::of_polygons(read_surface(path)?, path, plan),
            DomainSource::Mesh(path) => match read_solid(path)? {
                SolidFile::Surface(soup) => Self::of_polygons(soup, path, plan),
                SolidFile::Tets(soup) => {
                    let mut soup = soup.tidied();
                    let unit = Unit::of_extreme(&soup.points);
                    soup.points = unit.take_points(&soup.points);
                    let start =
                        Self::of_mesh(soup, &plan.in_unit(unit), unit).map_err(RunError::at(&named(path, unit)))?;
                    start.of_file(path, unit)
                }
            },
        }
    }

    fn of_polygons(soup: PolygonSoup, path: &Path, plan: &Plan) -> Result<Self, RunError> {
        let (surface, unit) = surface_of(soup, path, plan)?;
        let start = Self::of_surface(&surface, &plan.in_unit(unit), unit).map_err(RunError::at(&named(path, unit)))?;
        start.of_file(path, unit)
    }

    /// The same on a domain that is there, where an external mesher made it from the plan's solid; lengths of the domain are
    /// counted in `unit`.
    pub fn on(plan: &Plan, settings: &ExternalSettings, domain: Domain, unit: Unit) -> Result<Self, RunError> {
        let (path, surface) = match &plan.domain {
            DomainSource::Solid(solid) => (None, solid.surface()?),
            DomainSource::Surface(path) | DomainSource::Mesh(path) => {
                let (surface, of_file) = surface_of(read_surface(path)?, path, plan)?;
                (Some(path), surface.in_unit(unit.times(of_file.inverse())))
            }
        };
        let origin = path.map_or_else(|| plan.domain.to_string(), |path| named(path, unit));
        check_filled(domain.mesh(), &surface, settings).map_err(RunError::at(&origin))?;
        let (plan_as_given, plan) = (plan, plan.in_unit(unit));
        let mut start = Self::of_domain(domain, &surface, &plan, unit).map_err(RunError::at(&origin))?;
        start.warn_of(&surface);
        let start = match path {
            Some(path) => start.of_file(path, unit)?,
            None => Self { origin, ..start },
        };
        start.with_corners(plan_as_given)
    }

    /// What came from a file, its domain counted in a unit; from here on the unit follows from its size, so that nothing
    /// depends on the one in the file.
    fn of_file(self, path: &Path, unit: Unit) -> Result<Self, RunError> {
        let rest = Unit::of(self.domain.mesh().points());
        Ok(Self {
            origin: shown_path(path),
            input_hash: Some(hash_of(path)?),
            domain: self.domain.in_unit(rest),
            units: [unit.times(rest), self.units[1]],
            centre: self.centre.map(|centre| StarCentre {
                position: centre.position.map(|x| rest.take(x, 1)),
                kernel_radius: rest.take(centre.kernel_radius, 1),
                ..centre
            }),
            ..self
        })
    }

    fn warn_of(&mut self, surface: &Surface) {
        self.warnings.extend_from_slice(surface.notes());
        if surface.was_inside_out() {
            self.warnings.push("the surface was inside out; all its triangles were reversed".into());
        }
    }

    fn of_surface(surface: &Surface, plan: &Plan, unit: Unit) -> Result<Self, Fault> {
        let mut start = match &plan.mesh {
            MeshPlan::Shell(settings) => {
                Self::of_shells(surface, star_centre(surface, &plan.centre)?, settings, plan, unit)?
            }
            MeshPlan::Flag(settings) => {
                let centre = star_centre(surface, &plan.centre)?;
                let flags = flag_mesh(surface, centre.position, settings)?;
                let of_mesh = Flags::of(&flags);
                Self { flags: Some(of_mesh), ..Self::of_domain(Domain::new(flags.mesh)?, surface, plan, unit)? }
            }
            MeshPlan::External(settings) => Self::of_domain(
                Domain::new(external_mesh(surface, settings, &plan.optimize.cancel)?)?,
                surface,
                plan,
                unit,
            )?,
            MeshPlan::Auto { shell, external, shell_keys } => match star_centre(surface, &plan.centre) {
                Err(CentreError::Kernel(KernelError::NotStarShaped { .. }))
                    if !matches!(plan.map, InitialMap::Radial { .. }) =>
                {
                    let mesh = mesh_of_any_solid(surface, external, &plan.optimize.cancel)?;
                    let mut start = Self::of_domain(Domain::new(mesh)?, surface, plan, unit)?;
                    start.warnings.extend((!shell_keys.is_empty()).then(|| {
                        format!(
                            "the solid is not star-shaped, so that it was not meshed in shells, and the keys of [mesh] that \
                             are for shells had no effect: {}",
                            shell_keys.join(", ")
                        )
                    }));
                    start
                }
                centre => {
                    let centre = centre?;
                    match instead_of_shells(surface, &centre, external, shell_keys, plan) {
                        Some(mesh) => Self::of_domain(Domain::new(mesh)?, surface, plan, unit)?,
                        None => Self::of_shells(surface, centre, shell, plan, unit)?,
                    }
                }
            },
        };
        start.warn_of(surface);
        Ok(start)
    }

    fn of_shells(
        surface: &Surface,
        centre: StarCentre,
        settings: &ShellSettings,
        plan: &Plan,
        unit: Unit,
    ) -> Result<Self, Fault> {
        let shell = shell_mesh_until(surface, centre.position, settings, &plan.optimize.cancel)?;
        let idle =
            (plan.collar > 0.0).then(|| "the solid was meshed in shells, so that boundary.collar had no effect".into());
        let mut coordinates = RadialCoordinates::of_shell(&shell);
        let mut refinement = None;
        let mut warning = more_cells(surface, settings, &shell);
        if let Some(Refinement::Ball(wanted)) = settings.refinement {
            let largest_stretch = inscribed_stretch(&shell.surface, &centre.position);
            if largest_stretch > wanted {
                warning = Some(format!(
                    "the surface was refined up to {} tets and no further: the radial map of its image onto the ball has a K of {} still, \
                     not {wanted}; mesh.cells asks for more tets",
                    shell.mesh.tets().len(),
                    number(largest_stretch)
                ));
            }
            refinement = Some(RefinementFigures { triangles_before: surface.triangles().len(), largest_stretch });
        }
        let domain = Domain::new(shell.mesh)?;
        if plan.optimize.cancel.is_raised() {
            return Err(ShellError::Cancelled.into());
        }
        let (domain, splits) = between_corners(domain, plan)?;
        if splits.is_some() {
            coordinates = RadialCoordinates::of_domain(&domain, surface, centre.position, RayEnd::Only)?;
        }
        let start = match &plan.map {
            InitialMap::Formula(map) => Self::of_formula(domain, map, unit)?,
            InitialMap::Spherical { weights } => Self::of_sphere(domain, weights)?,
            _ => Self::of_rays(domain, surface, Some(centre), &coordinates, plan),
        };
        let slivers = is_grazed(&centre, plan).then(|| {
            format!(
                "{}, so that cones over them are slivers: with TetGen or Gmsh its boundary is mapped as that of any solid, where \
                 mesh.kind and the keys of shells are left out (mesh.kind = \"tetgen\" tells why not)",
                grazed(&centre)
            )
        });
        let warnings = start.warnings.into_iter().chain(slivers).chain(warning).chain(idle).collect();
        Ok(Self { refinement, splits, warnings, ..start })
    }

    fn of_mesh(soup: TetSoup, plan: &Plan, unit: Unit) -> Result<Self, Fault> {
        let TetSoup { points, tets, notes } = soup;
        let count = tets.len();
        let (mesh, exchanged) = TetMesh::from_either_orientation(points, tets)?;
        let domain = Domain::new(mesh)?;
        let surface = Surface::from_triangles(domain.mesh().points().to_vec(), domain.boundary().triangles())?;
        let mut start = Self::of_domain(domain, &surface, plan, unit)?;
        start.warnings.extend(notes);
        if exchanged > 0 {
            start.warnings.push(format!(
                "{exchanged} of {count} tets were stored with negative orientation; two vertices of each were exchanged"
            ));
        }
        Ok(start)
    }

    /// Frees a mesh's locked tets, parts its corners and maps its vertices.
    fn of_domain(domain: Domain, surface: &Surface, plan: &Plan, unit: Unit) -> Result<Self, Fault> {
        let may_have_collar = plan.collar == 0.0
            && !plan.keep_mesh
            && !matches!(plan.mesh, MeshPlan::Flag(_))
            && match &plan.map {
                InitialMap::Auto { .. } => true,
                InitialMap::Spherical { weights } => *weights == SphereSettings::default(),
                _ => false,
            };
        Ok(Self { may_have_collar, ..Self::of_freed(freed(domain, plan)?, surface, plan, unit)? })
    }

    fn of_freed(
        (domain, splits): (Domain, Option<Splits>),
        surface: &Surface,
        plan: &Plan,
        unit: Unit,
    ) -> Result<Self, Fault> {
        let (position, centre, end) = match (&plan.map, plan.centre.point(surface)) {
            (InitialMap::Formula(map), _) => return Ok(Self { splits, ..Self::of_formula(domain, map, unit)? }),
            // The plan allows "farthest" only with a rule that names a point for any solid.
            (InitialMap::Farthest { .. }, Some(point)) => (point, None, RayEnd::Farthest),
            (InitialMap::Spherical { weights }, _) => return Ok(Self { splits, ..Self::of_sphere(domain, weights)? }),
            (map, _) => match star_centre(surface, &plan.centre) {
                Err(CentreError::Kernel(KernelError::NotStarShaped { .. }))
                    if matches!(map, InitialMap::Auto { .. }) =>
                {
                    return Ok(Self { splits, ..Self::of_sphere(domain, &SphereSettings::default())? });
                }
                centre => {
                    let centre = centre?;
                    if is_grazed(&centre, plan)
                        && let Ok(start) = Self::of_sphere(domain.clone(), &SphereSettings::default())
                    {
                        let warning = format!(
                            "{}: its boundary was mapped as that of any solid; map.kind = \"radial\" keeps to the rays",
                            grazed(&centre)
                        );
                        return Ok(Self { splits, warnings: vec![warning], ..start });
                    }
                    (centre.position, Some(centre), RayEnd::Only)
                }
            },
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
            InitialMap::Auto { exponent } | InitialMap::Radial { exponent } => ("radial", *exponent),
            InitialMap::Spherical { .. } | InitialMap::Formula(_) => ("radial", None),
        };
        let best = || position.map(|position| best_radial_exponent(surface, &position));
        let exponent = given.or_else(best).unwrap_or(1.0);
        let map = MapFigures {
            map: format!("{kind}, exponent {exponent}"),
            radial_exponent: Some(exponent),
            radial_smooth_k: position.map(|position| radial_max_dilatation(surface, &position, exponent)),
            closed_form_k: None,
            boundary_map: None,
        };
        let may_be_spherical = matches!(plan.map, InitialMap::Auto { .. });
        Self { centre, may_be_spherical, ..Self::with(domain, caraman(coordinates, exponent), map) }
    }

    /// The boundary onto the sphere by progressive embedding, the inside in balance between its neighbours.
    fn of_sphere(domain: Domain, weights: &SphereSettings) -> Result<Self, Fault> {
        let starts = spherical_starts(&domain, weights)?;
        Ok(Self::of_starts(domain, starts))
    }

    fn of_starts(domain: Domain, starts: SphericalStarts) -> Self {
        let map = MapFigures {
            map: Self::FIRST.into(),
            radial_exponent: None,
            radial_smooth_k: None,
            closed_form_k: None,
            boundary_map: Some(starts.distortion),
        };
        Self { second: Some(starts.harmonic), ..Self::with(domain, starts.hyperbolic, map) }
    }

    /// A map of a domain, in units of 1 and with nothing to say of where it is from.
    fn with(domain: Domain, image: Vec<Vec3>, map: MapFigures) -> Self {
        Self {
            origin: String::new(),
            input_hash: None,
            units: [Unit::default(); 2],
            domain,
            centre: None,
            image,
            second: None,
            may_be_spherical: false,
            may_have_collar: false,
            map,
            refinement: None,
            splits: None,
            flags: None,
            corners: None,
            symmetric: false,
            warnings: Vec::new(),
        }
    }

    /// The same on the mesh as refinement changed it, of the surface or inside alone.
    ///
    /// # Errors
    /// The row of the results' table that names what is no edge, or no tet that could be flipped; or a tet that rounding made flat.
    pub fn changed(self, changes: &MeshChanges, of_surface: bool) -> Result<Self, String> {
        if changes.is_empty() {
            return Ok(self);
        }
        let mut subdivision = Subdivision::of(self.domain.mesh());
        subdivision.change(changes).map_err(row_of_change)?;
        let mesh = subdivision.mesh().map_err(|error| error.to_string())?;
        let domain = Domain::new(mesh).map_err(|error| error.to_string())?;
        let middles = Middles { of_surface, centre: self.centre.map(|centre| centre.position) };
        let image = middles.extended_start(&domain, &changes.halved, self.image);
        let corners = self.corners.map(|corners| corners.around(&domain)).transpose();
        let corners = corners.map_err(|error| error.to_string())?;
        Ok(Self { domain, image, corners, ..self })
    }

    /// The same with the exponents that a map of it has, at the corners of both.
    pub fn with_exponents_of(self, other: Option<&Corners>) -> Self {
        let exponents: BTreeMap<VertexId, f64> =
            other.map(Corners::exponents).unwrap_or_default().into_iter().collect();
        let own: BTreeMap<VertexId, f64> =
            self.corners.as_ref().map(Corners::exponents).unwrap_or_default().into_iter().collect();
        let exponent = |v: VertexId| exponents.get(&v).copied().unwrap_or(own[&v]);
        Self { corners: self.corners.map(|corners| corners.with_exponents(exponent)), ..self }
    }

    /// A map in closed form, of the vertices as they were given.
    fn of_formula(domain: Domain, formula: &AnalyticMap, unit: Unit) -> Result<Self, Fault> {
        let points = unit.give_back_points(domain.mesh().points());
        let image = formula.apply(&points).map_err(|(vertex, error)| {
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
            boundary_map: None,
        };
        // Where nothing is out of range, as it is: the closed form may be of a map onto the unit ball.
        let unit =
            Unit::of_extreme(image.iter().zip(domain.boundary().vertex_mask()).filter(|(_, on)| **on).map(|(p, _)| p));
        let image = unit.take_points(&image);
        Ok(Self { units: [Unit::default(), unit], ..Self::with(domain, image, map) })
    }
}

/// The closed surface of a file's polygons, and the unit in which it is counted.
fn surface_of(mut soup: PolygonSoup, path: &Path, plan: &Plan) -> Result<(Surface, Unit), RunError> {
    // Points that no polygon names are of no account.
    let unit = Unit::of_extreme(soup.polygons.iter().flatten().filter_map(|v| soup.points.get(v.index())));
    soup.points = unit.take_points(&soup.points);
    let surface = Surface::repaired(soup, &plan.repair).map_err(RunError::at(&named(path, unit)))?;
    Ok((surface, unit))
}

/// A file in an error, which may name places.
fn named(path: &Path, unit: Unit) -> String {
    let counted = if unit.is_one() { String::new() } else { format!(" (lengths counted in {unit})") };
    shown_path(path) + &counted
}

/// blake3 of a file.
fn hash_of(path: &Path) -> Result<String, ReadError> {
    let bytes = std::fs::read(path).map_err(|source| ReadError::Open { path: path.into(), source })?;
    Ok(blake3::hash(&bytes).to_hex().to_string())
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

#[cfg(test)]
mod tests;

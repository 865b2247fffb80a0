//! The front doors: plain arrays in, plain arrays out, one call each.
//!
//! Points are `[f64; 3]` in any one unit of length, tets four indices into them, counted from 0, in either orientation. What is
//! wrong with an array is an [`ArrayError`] that names its row; nothing here panics on an input.

mod error;
mod maps;
#[cfg(test)]
mod tests;

use std::time::Duration;

use crate::bound::certificate::{self, Certificate};
use crate::bound::{self, LowerBound, confront};
use crate::cancel::Cancel;
use crate::domain::Domain;
use crate::map::{
    RadialCoordinates, RayEnd, SphericalStarts, bijectivity, caraman, spherical_starts, spherical_starts_over_collar,
};
use crate::measure::{Summary, measure as measure_domain, measure_onto_ball};
use crate::mesh::{MeshError, TetMesh, Unit, Vec3, VertexId, full_boundary};
use crate::optimize::{
    BoundaryValues, Freed, OptimizeSettings, Outcome, StopReason, Tangled, TraceRow, free_and_optimize_one_of,
};
use crate::solid::{
    CentreChoice, CentreError, KernelError, Refinement, ShellSettings, Surface, shell_mesh_until, star_centre,
};
use crate::sphere::SphereSettings;

pub use error::ArrayError;
use maps::rows;
pub use maps::{evaluate, inverse, radial_map, sphere_map};

/// Where the boundary goes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BoundaryMap {
    /// Along the rays from the star centre where there is one, else by [`sphere_map`].
    #[default]
    Auto,
    /// Along the rays from the star centre; a solid without one is refused.
    Radial,
    /// By [`sphere_map`], whatever the solid.
    Spherical,
}

/// Settings of [`ball_map`].
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct BallMapSettings {
    /// The point that goes to the centre of the ball.
    pub centre: CentreChoice,
    /// Where the boundary goes.
    pub boundary: BoundaryMap,
    /// A point at the fraction t of its ray starts at the radius t^exponent; > 0.
    pub exponent: f64,
    /// How the start is improved.
    pub optimize: OptimizeSettings,
    /// How long a Gram certificate, the best bound there is, may be searched for; not at all if `None`.
    pub certify: Option<Duration>,
}

impl Default for BallMapSettings {
    fn default() -> Self {
        let optimize = OptimizeSettings::default();
        Self { centre: CentreChoice::Kernel, boundary: BoundaryMap::Auto, exponent: 1.0, optimize, certify: None }
    }
}

/// A mesh, its image, and what is known of the map between them. Dilatations are ratios >= 1, infinite on flipped tets.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct MappedMesh {
    /// The vertices of the domain: those given, then the ones that freed locked tets.
    pub points: Vec<[f64; 3]>,
    /// The tets, all of positive volume.
    pub tets: Vec<[u32; 4]>,
    /// The image of each vertex.
    pub image: Vec<[f64; 3]>,
    /// K of each tet, the larger of the two below.
    pub k: Vec<f64>,
    /// K_I of each tet.
    pub k_inner: Vec<f64>,
    /// K_O of each tet.
    pub k_outer: Vec<f64>,
    /// Maxima, means and quantiles over the tets.
    pub summary: Summary,
    /// Whether the map is proved to be a homeomorphism onto its image.
    pub bijective: bool,
    /// Lower bounds for the largest dilatation, each with the maps it speaks of.
    pub bounds: Vec<LowerBound>,
    /// What proves the best of them, if one was searched for and found.
    pub certificate: Option<Certificate>,
    /// Why the optimization ended.
    pub stop: StopReason,
    /// One row an iteration.
    pub trace: Vec<TraceRow>,
}

/// What was measured of a map, tet by tet in the order given.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct MeasuredTets {
    /// K of each tet, the larger of the two below.
    pub k: Vec<f64>,
    /// K_I of each tet.
    pub k_inner: Vec<f64>,
    /// K_O of each tet.
    pub k_outer: Vec<f64>,
    /// The tets that are flipped or flat in the image.
    pub flipped: Vec<u32>,
    /// Maxima, means and quantiles over the tets.
    pub summary: Summary,
}

/// Maps a solid, given by its tets, onto the unit ball with the largest dilatation as small as the method can make it. The
/// boundary vertices of a star-shaped solid go to the sphere along the rays from the star centre, those of others by
/// [`crate::sphere::sphere_map`], and stay there. Where tets of the start resist untangling, the other way is tried after the first
/// ([`BoundaryMap::Auto`]), and then one over a collar of as many tets again next to the boundary (unless [`BoundaryMap::Radial`]);
/// `stop` is [`StopReason::StillFlipped`] where tets resist in all of them.
///
/// Tets with all four vertices on the boundary are split, since nothing could change their dilatation, and so are edges about
/// the last tets that a start cannot be untangled at, and those of a collar: `tets` and `points` of the result may have more rows than were
/// given; the points given come first.
///
/// # Errors
/// [`ArrayError`]; how the optimization ends is data in the result.
///
/// ```
/// use qcball::arrays::{ArrayError, BallMapSettings, ball_map};
///
/// # fn main() -> Result<(), ArrayError> {
/// // A bipyramid twice as high as it is wide: eight tets around the origin.
/// let points = [[1., 0., 0.], [0., 1., 0.], [-1., 0., 0.], [0., -1., 0.], [0., 0., 2.], [0., 0., -2.], [0., 0., 0.]];
/// let around = [[0, 1], [1, 2], [2, 3], [3, 0]];
/// let tets: Vec<[u32; 4]> = around.iter().flat_map(|&[a, b]| [[6, a, b, 4], [6, a, b, 5]]).collect();
/// let map = ball_map(&points, &tets, &BallMapSettings::default())?;
///
/// // Onto the regular octahedron, so the best is the linear map with the singular values 1, 1, 1/2: K = K_I = 4.
/// assert!(map.bijective && map.k.len() == 8);
/// for (k, k_outer) in map.k.iter().zip(&map.k_outer) {
///     assert!((k - 4.0).abs() < 1e-5 && (k_outer - 2.0).abs() < 1e-5);
/// }
/// # Ok(())
/// # }
/// ```
pub fn ball_map(points: &[[f64; 3]], tets: &[[u32; 4]], settings: &BallMapSettings) -> Result<MappedMesh, ArrayError> {
    ball_map_observed(points, tets, settings, &mut |_row| {})
}

/// [`ball_map`], with every row of the trace shown to `observe` as it comes.
///
/// # Errors
/// As [`ball_map`].
pub fn ball_map_observed(
    points: &[[f64; 3]],
    tets: &[[u32; 4]],
    settings: &BallMapSettings,
    observe: &mut dyn FnMut(&TraceRow),
) -> Result<MappedMesh, ArrayError> {
    check_exponent(settings.exponent)?;
    let (mesh, unit) = mesh(points, tets)?;
    let given = Domain::new(mesh)?;
    let surface = Surface::from_triangles(given.mesh().points().to_vec(), given.boundary().triangles())?;
    let centre = centre_of(&surface, unit, settings)?;
    let full = full_boundary(given.mesh(), given.boundary());
    let domain = if full.parents().is_empty() { given } else { Domain::new(full.mesh()?)? };
    let radial = match centre {
        Some(centre) => {
            let coordinates = RadialCoordinates::of_domain(&domain, &surface, centre, RayEnd::Only)?;
            Some((centre, caraman(&coordinates, settings.exponent)))
        }
        None => None,
    };
    mapped(BallStart::new(domain, radial, settings.boundary)?, unit, settings, observe)
}

/// The same of a solid given by the triangles of its surface: it is filled with shells of tets about the star centre, which it
/// must have. The surface is refined until there are about `cells` tets, or without a number until it is nearly a ball
/// ([`Refinement::USUAL`]): on a coarse one K onto the ball is large, whatever K.
///
/// # Errors
/// As [`ball_map`]; triangles that are no closed surface, or a solid that is not star-shaped, which needs tets of its own.
pub fn ball_map_of_surface(
    points: &[[f64; 3]],
    triangles: &[[u32; 3]],
    cells: Option<usize>,
    settings: &BallMapSettings,
    observe: &mut dyn FnMut(&TraceRow),
) -> Result<MappedMesh, ArrayError> {
    check_exponent(settings.exponent)?;
    let (surface, unit) = maps::surface(points, triangles)?;
    let centre = match star_centre(&surface, &in_unit(&settings.centre, unit)) {
        Err(CentreError::Kernel(KernelError::NotStarShaped { faces, .. })) => {
            return Err(ArrayError::NotStarShaped { faces });
        }
        centre => centre?.position,
    };
    let refinement = Some(cells.map_or(Refinement::USUAL, Refinement::Cells));
    let shells = ShellSettings { subdivisions: 1, refinement, layers: 8, grading: 1.0 };
    let shell = shell_mesh_until(&surface, centre, &shells, &settings.optimize.cancel)?;
    let radial = (settings.boundary != BoundaryMap::Spherical)
        .then(|| (centre, caraman(&RadialCoordinates::of_shell(&shell), settings.exponent)));
    // A collar is for tets over boundary faces that share an apex, which shells have none of.
    let start = BallStart::new(Domain::new(shell.mesh)?, radial, settings.boundary)?;
    mapped(BallStart { may_have_collar: false, ..start }, unit, settings, observe)
}

/// What a map onto the ball is made from.
#[derive(Clone)]
struct BallStart {
    domain: Domain,
    /// The star centre of a radial start.
    centre: Option<Vec3>,
    image: Vec<Vec3>,
    second: Option<Vec<Vec3>>,
    /// Whether a spherical start may take the place of this radial one, where its tets resist untangling.
    may_be_spherical: bool,
    /// Whether one over a collar may take the place of a spherical one, likewise.
    may_have_collar: bool,
}

impl BallStart {
    /// The radial start, or else the spherical one.
    fn new(domain: Domain, radial: Option<(Vec3, Vec<Vec3>)>, boundary: BoundaryMap) -> Result<Self, ArrayError> {
        let may_have_collar = boundary != BoundaryMap::Radial;
        Ok(match radial {
            Some((centre, image)) => {
                let may_be_spherical = boundary == BoundaryMap::Auto;
                Self { domain, centre: Some(centre), image, second: None, may_be_spherical, may_have_collar }
            }
            None => {
                let starts = spherical_starts(&domain, &SphereSettings::default())?;
                Self { may_have_collar, ..Self::spherical(domain, starts) }
            }
        })
    }

    fn spherical(domain: Domain, starts: SphericalStarts) -> Self {
        let (image, second) = (starts.hyperbolic, Some(starts.harmonic));
        Self { domain, centre: None, image, second, may_be_spherical: false, may_have_collar: false }
    }

    fn in_spherical(&self) -> Option<Self> {
        let starts =
            self.may_be_spherical.then(|| spherical_starts(&self.domain, &SphereSettings::default()).ok())??;
        let may_have_collar = self.may_have_collar;
        Some(Self { may_have_collar, ..Self::spherical(self.domain.clone(), starts) })
    }

    fn over_collar(&self) -> Option<Self> {
        let (domain, starts, _) = self.may_have_collar.then(|| spherical_starts_over_collar(&self.domain))??;
        Some(Self::spherical(domain, starts))
    }

    fn tangled(&self) -> Tangled<'static> {
        let Self { domain, image, second, .. } = self.clone();
        Tangled { domain, start: image, second, fixed: None, may_refine: true }
    }
}

/// From a start or, where its tets resist, from one that may take its place.
fn mapped(
    mut start: BallStart,
    unit: Unit,
    settings: &BallMapSettings,
    observe: &mut dyn FnMut(&TraceRow),
) -> Result<MappedMesh, ArrayError> {
    let others = [BallStart::in_spherical, BallStart::over_collar];
    let (freed, outcome) =
        free_and_optimize_one_of(&mut start, &others, BallStart::tangled, &settings.optimize, observe)?;
    let mut map = improved(freed, outcome, [unit, Unit::default()]);
    // Where the boundary slid, its values are the radial ones no more.
    let radial = settings.optimize.boundary_values == BoundaryValues::Fixed;
    map.bound(start.centre.filter(|_| radial), settings.certify);
    map.arrays()
}

/// The star centre that the boundary goes away from, if it does.
fn centre_of(surface: &Surface, unit: Unit, settings: &BallMapSettings) -> Result<Option<Vec3>, ArrayError> {
    if settings.boundary == BoundaryMap::Spherical {
        return Ok(None);
    }
    match star_centre(surface, &in_unit(&settings.centre, unit)) {
        Err(CentreError::Kernel(KernelError::NotStarShaped { .. })) if settings.boundary == BoundaryMap::Auto => {
            Ok(None)
        }
        centre => Ok(Some(centre?.position)),
    }
}

fn in_unit(choice: &CentreChoice, unit: Unit) -> CentreChoice {
    match choice {
        CentreChoice::At(point) => CentreChoice::At(point.map(|x| unit.take(x, 1))),
        rule => rule.clone(),
    }
}

fn check_exponent(exponent: f64) -> Result<(), ArrayError> {
    if exponent > 0.0 && exponent.is_finite() { Ok(()) } else { Err(ArrayError::Exponent(exponent)) }
}

/// Lowers the dilatation of any map of any tet mesh: `image` is the start, and the vertices with `fixed` true stay where they
/// are; without `fixed`, those of the boundary, and tets that are locked by it are split.
///
/// # Errors
/// [`ArrayError`]; how the optimization ends is data in the result.
pub fn optimize(
    points: &[[f64; 3]],
    tets: &[[u32; 4]],
    image: &[[f64; 3]],
    fixed: Option<&[bool]>,
    settings: &OptimizeSettings,
) -> Result<MappedMesh, ArrayError> {
    optimize_observed(points, tets, image, fixed, settings, &mut |_row| {})
}

/// [`optimize()`], with every row of the trace shown to `observe` as it comes.
///
/// # Errors
/// As [`optimize()`].
pub fn optimize_observed(
    points: &[[f64; 3]],
    tets: &[[u32; 4]],
    image: &[[f64; 3]],
    fixed: Option<&[bool]>,
    settings: &OptimizeSettings,
    observe: &mut dyn FnMut(&TraceRow),
) -> Result<MappedMesh, ArrayError> {
    let (mesh, unit) = mesh(points, tets)?;
    let given = Domain::any_topology(mesh)?;
    let (image, of_image) = positions("image", image, points.len())?;
    if let Some(row) = image.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
        return Err(ArrayError::NotFinite { array: "image", row });
    }
    let (domain, start) = match fixed {
        Some(fixed) => {
            check_length("fixed", fixed.len(), points.len())?;
            (given, image)
        }
        None => {
            let full = full_boundary(given.mesh(), given.boundary());
            let start = full.extend(image);
            (if full.parents().is_empty() { given } else { Domain::any_topology(full.mesh()?)? }, start)
        }
    };
    let on_boundary = domain.boundary().vertex_mask();
    let boundary_is_fixed = fixed.is_none_or(|fixed| on_boundary.iter().zip(fixed).all(|(&on, &fixed)| fixed || !on));
    let tangled = Tangled { domain, start, second: None, fixed, may_refine: true };
    let (freed, outcome) = tangled.free_and_optimize(settings, observe)?;
    let mut map = improved(freed, outcome, [unit, of_image]);
    if boundary_is_fixed {
        map.bound(None, None);
    }
    map.arrays()
}

/// The exact dilatations of the piecewise-linear map that takes `points` to `image`, from whatever program.
///
/// # Errors
/// [`ArrayError`]. An image of flipped tets, or with coordinates that are not finite, is none: their K is infinite.
pub fn measure(points: &[[f64; 3]], tets: &[[u32; 4]], image: &[[f64; 3]]) -> Result<MeasuredTets, ArrayError> {
    let domain = Domain::any_topology(mesh(points, tets)?.0)?;
    let measured = measure_domain(&domain, &positions("image", image, points.len())?.0);
    Ok(MeasuredTets {
        k: measured.dilatations.iter().map(|d| d.k()).collect(),
        k_inner: measured.dilatations.iter().map(|d| d.inner).collect(),
        k_outer: measured.dilatations.iter().map(|d| d.outer).collect(),
        flipped: measured.flipped.iter().map(|tet| tet.0).collect(),
        summary: measured.summary,
    })
}

/// The lower bounds for the largest dilatation of maps of this mesh with these boundary values; `image` is read at the
/// boundary vertices alone, unless a certificate is searched for, which starts from all of it.
///
/// # Errors
/// [`ArrayError`].
pub fn bounds(
    points: &[[f64; 3]],
    tets: &[[u32; 4]],
    image: &[[f64; 3]],
    certify: Option<Duration>,
) -> Result<Vec<LowerBound>, ArrayError> {
    let (mesh, unit) = mesh(points, tets)?;
    let domain = Domain::any_topology(mesh)?;
    let (image, _) = positions("image", image, points.len())?;
    let on_boundary = domain.boundary().vertex_mask();
    if let Some(row) = (0..image.len()).find(|&v| on_boundary[v] && !image[v].iter().all(|x| x.is_finite())) {
        return Err(ArrayError::NotFinite { array: "image", row });
    }
    let (bounds, _) = bounds_of(&domain, &image, None, certify);
    confront(&bounds, &domain, &image, &measure_domain(&domain, &image).summary, ARRAYS)?;
    Ok(given_back(bounds, unit))
}

/// What an error of this program is to be reported with.
const ARRAYS: &str = "the arrays that were given";

/// A map on the way out.
struct Improved {
    domain: Domain,
    /// The units in which lengths of the domain and of the image are counted here.
    units: [Unit; 2],
    image: Vec<Vec3>,
    stop: StopReason,
    trace: Vec<TraceRow>,
    bounds: Vec<LowerBound>,
    certificate: Option<Certificate>,
}

fn improved(freed: Freed, outcome: Outcome, units: [Unit; 2]) -> Improved {
    let domain = freed.domain;
    let (image, stop, trace) = (outcome.positions, outcome.stop, outcome.trace);
    Improved { domain, units, image, stop, trace, bounds: Vec::new(), certificate: None }
}

fn bounds_of(
    domain: &Domain,
    image: &[Vec3],
    centre: Option<Vec3>,
    certify: Option<Duration>,
) -> (Vec<LowerBound>, Option<Certificate>) {
    let mut bounds = bound::all(domain, image, centre, centre.is_some());
    let certificate = certify.and_then(|limit| certificate::search(domain, image, &Cancel::default().within(limit)));
    bounds.extend(certificate.as_ref().and_then(|found| certificate::bound(found, domain, image).ok()));
    (bounds, certificate)
}

impl Improved {
    fn bound(&mut self, centre: Option<Vec3>, certify: Option<Duration>) {
        (self.bounds, self.certificate) = bounds_of(&self.domain, &self.image, centre, certify);
    }

    /// Measures the final positions and hands everything out.
    fn arrays(self) -> Result<MappedMesh, ArrayError> {
        let measured = measure_onto_ball(&self.domain, &self.image);
        confront(&self.bounds, &self.domain, &self.image, &measured.summary, ARRAYS)?;
        Ok(MappedMesh {
            points: rows(&self.units[0].give_back_points(self.domain.mesh().points())),
            tets: self.domain.mesh().tets().iter().map(|tet| tet.map(|v| v.0)).collect(),
            image: rows(&self.units[1].give_back_points(&self.image)),
            k: measured.dilatations.iter().map(|d| d.k()).collect(),
            k_inner: measured.dilatations.iter().map(|d| d.inner).collect(),
            k_outer: measured.dilatations.iter().map(|d| d.outer).collect(),
            summary: measured.summary,
            bijective: bijectivity(&self.domain, &self.image).bijective,
            bounds: given_back(self.bounds, self.units[0]),
            certificate: self.certificate,
            stop: self.stop,
            trace: self.trace,
        })
    }
}

/// Bounds whose places were counted in a unit.
fn given_back(mut bounds: Vec<LowerBound>, unit: Unit) -> Vec<LowerBound> {
    bounds.iter_mut().for_each(|bound| bound.place = bound.place.take().map(|place| unit.give_back_place(place)));
    bounds
}

/// The mesh, and the unit in which its lengths are counted.
fn mesh(points: &[[f64; 3]], tets: &[[u32; 4]]) -> Result<(TetMesh, Unit), MeshError> {
    let points: Vec<Vec3> = points.iter().map(|&p| p.into()).collect();
    let unit = Unit::of(&points);
    let tets = tets.iter().map(|tet| tet.map(VertexId)).collect();
    let (mesh, _exchanged) = TetMesh::from_either_orientation(unit.take_points(&points), tets)?;
    Ok((mesh, unit))
}

fn check_length(array: &'static str, found: usize, wanted: usize) -> Result<(), ArrayError> {
    if found == wanted { Ok(()) } else { Err(ArrayError::Length { array, found, wanted }) }
}

/// Positions, and the unit in which they are counted.
fn positions(array: &'static str, rows: &[[f64; 3]], vertices: usize) -> Result<(Vec<Vec3>, Unit), ArrayError> {
    check_length(array, rows.len(), vertices)?;
    let points: Vec<Vec3> = rows.iter().map(|&p| p.into()).collect();
    let unit = Unit::of(&points);
    Ok((unit.take_points(&points), unit))
}

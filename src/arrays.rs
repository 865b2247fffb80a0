//! The front doors: plain arrays in, plain arrays out, one call each.
//!
//! Points are `[f64; 3]` in any one unit of length, tets four indices into them, counted from 0, in either orientation. What is
//! wrong with an array is an [`ArrayError`] that names its row; nothing here panics on an input.

use std::time::Duration;

use crate::bound::certificate::{self, Certificate};
use crate::bound::{self, Contradiction, LowerBound, confront};
use crate::cancel::Cancel;
use crate::domain::Domain;
use crate::map::{RadialCoordinates, RayEnd, RayError, bijectivity, caraman, spherical_starts};
use crate::measure::{Summary, measure as measure_domain};
use crate::mesh::{MeshError, TetMesh, TopologyError, Unit, Vec3, VertexId, full_boundary};
use crate::optimize::{BoundaryValues, OptimizeError, OptimizeSettings, StopReason, Tangled, TraceRow};
use crate::solid::{CentreChoice, CentreError, KernelError, Surface, SurfaceError, star_centre};
use crate::sphere::SphereError;

/// Settings of [`ball_map`].
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct BallMapSettings {
    /// The point that goes to the centre of the ball.
    pub centre: CentreChoice,
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
        Self { centre: CentreChoice::Kernel, exponent: 1.0, optimize, certify: None }
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

/// What is wrong with the arrays.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ArrayError {
    /// An array of another length than it must have.
    #[error("{array} has {found} rows, but there are {wanted} vertices; give one row a vertex, in the same order")]
    Length {
        /// Which array.
        array: &'static str,
        /// Its rows.
        found: usize,
        /// How many it must have.
        wanted: usize,
    },
    /// A boundary vertex whose image is not finite.
    #[error("row {row} of {array} holds a number that is not finite")]
    NotFinite {
        /// Which array.
        array: &'static str,
        /// The row.
        row: usize,
    },
    /// A setting out of its range.
    #[error("the exponent is {0}, but it must be a positive number")]
    Exponent(f64),
    /// The tets are no mesh.
    #[error("{0} (tets and vertices are counted from 0)")]
    Mesh(#[from] MeshError),
    /// The mesh is not a ball.
    #[error("{0} (vertices are counted from 0)")]
    Topology(#[from] TopologyError),
    /// The boundary of the mesh is no surface of a solid.
    #[error("the boundary of the mesh: {0}")]
    Surface(#[from] SurfaceError),
    /// The solid is not star-shaped, or not about the centre asked for.
    #[error(transparent)]
    Centre(#[from] CentreError),
    /// The boundary has no map onto the sphere.
    #[error(transparent)]
    Sphere(#[from] SphereError),
    /// A vertex lies outside of the boundary.
    #[error(transparent)]
    Ray(#[from] RayError),
    /// The optimization could not start.
    #[error(transparent)]
    Optimize(#[from] OptimizeError),
    /// A bound is above what the map achieves: an error of this program.
    #[error(transparent)]
    Contradiction(#[from] Box<Contradiction>),
}

/// Maps a solid, given by its tets, onto the unit ball with the largest dilatation as small as the method can make it. The
/// boundary vertices of a star-shaped solid go to the sphere along the rays from the star centre, those of others by
/// [`crate::sphere::sphere_map`], and stay there.
///
/// Tets with all four vertices on the boundary are split, since nothing could change their dilatation, and so are edges about
/// the last tets that a start cannot be untangled at: `tets` and `points` of the result may have more rows than were given.
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
    if !(settings.exponent > 0.0 && settings.exponent.is_finite()) {
        return Err(ArrayError::Exponent(settings.exponent));
    }
    let (mesh, unit) = mesh(points, tets)?;
    let given = Domain::new(mesh)?;
    let surface = Surface::from_triangles(given.mesh().points().to_vec(), given.boundary().triangles())?;
    let choice = match &settings.centre {
        CentreChoice::At(point) => CentreChoice::At(point.map(|x| unit.take(x, 1))),
        rule => rule.clone(),
    };
    let centre = match star_centre(&surface, &choice) {
        Err(CentreError::Kernel(KernelError::NotStarShaped { .. })) => None,
        centre => Some(centre?.position),
    };
    let full = full_boundary(given.mesh(), given.boundary());
    let domain = if full.parents().is_empty() { given } else { Domain::new(full.mesh()?)? };
    let (start, second) = match centre {
        Some(centre) => {
            let coordinates = RadialCoordinates::of_domain(&domain, &surface, centre, RayEnd::Only)?;
            (caraman(&coordinates, settings.exponent), None)
        }
        None => {
            let starts = spherical_starts(&domain)?;
            (starts.hyperbolic, Some(starts.harmonic))
        }
    };
    let tangled = Tangled { domain, start, second, fixed: None, may_refine: true };
    let mut map = improved(tangled, [unit, Unit::default()], &settings.optimize, observe)?;
    // Where the boundary slid, its values are the radial ones no more.
    let radial = settings.optimize.boundary_values == BoundaryValues::Fixed;
    map.bound(centre.filter(|_| radial), settings.certify);
    map.arrays()
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
    let mut map = improved(tangled, [unit, of_image], settings, observe)?;
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

fn improved(
    tangled: Tangled<'_>,
    units: [Unit; 2],
    settings: &OptimizeSettings,
    observe: &mut dyn FnMut(&TraceRow),
) -> Result<Improved, ArrayError> {
    let (freed, outcome) = tangled.free_and_optimize(settings, observe)?;
    let domain = freed.domain;
    let (image, stop, trace) = (outcome.positions, outcome.stop, outcome.trace);
    Ok(Improved { domain, units, image, stop, trace, bounds: Vec::new(), certificate: None })
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
        let measured = measure_domain(&self.domain, &self.image);
        confront(&self.bounds, &self.domain, &self.image, &measured.summary, ARRAYS)?;
        let rows = |points: &[Vec3]| points.iter().map(|&p| p.into()).collect();
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::fixtures::{cube, fan};

    /// The cube [-1, 1]^3 as a fan of its surface triangles.
    fn cube_fan() -> (Vec<[f64; 3]>, Vec<[u32; 4]>) {
        let mesh = fan(&cube(), Vec3::zeros());
        (mesh.points().iter().map(|&p| p.into()).collect(), mesh.tets().iter().map(|tet| tet.map(|v| v.0)).collect())
    }

    #[test]
    fn each_fault_of_an_array_names_its_row() {
        let (points, tets) = cube_fan();
        let refused = |points: &[[f64; 3]], tets: &[[u32; 4]]| {
            ball_map(points, tets, &BallMapSettings::default()).expect_err("a fault").to_string()
        };
        let with = |row: usize, tet: [u32; 4]| {
            let mut tets = tets.clone();
            tets[row] = tet;
            tets
        };
        let mut holey = points.clone();
        holey[3][1] = f64::NAN;
        assert!(refused(&holey, &tets).contains("vertex 3 has a coordinate that is not finite"));
        assert!(refused(&points, &with(5, [0, 1, 2, 99])).contains("tet 5 names vertex 99"));
        assert!(refused(&points, &with(5, [0, 1, 1, 8])).contains("tet 5 names vertex 1 twice"));
        assert!(refused(&points, &[]).contains("no tetrahedra"));
        let short = measure(&points, &tets, &points[1..]).unwrap_err().to_string();
        assert!(short.contains("image has 8 rows, but there are 9 vertices"), "{short}");
        let fixed = optimize(&points, &tets, &points, Some(&[true]), &OptimizeSettings::default());
        assert!(fixed.unwrap_err().to_string().contains("fixed has 1 rows"));
        let infinite = optimize(&points, &tets, &holey, None, &OptimizeSettings::default());
        assert!(infinite.unwrap_err().to_string().contains("row 3 of image"));
        assert!(bounds(&points, &tets, &holey, None).unwrap_err().to_string().contains("row 3 of image"));
        let exponent = BallMapSettings { exponent: 0.0, ..Default::default() };
        assert!(ball_map(&points, &tets, &exponent).unwrap_err().to_string().contains("the exponent is 0"));
    }

    #[test]
    fn tets_keep_their_order_and_are_taken_in_either_orientation() {
        let (points, tets) = cube_fan();
        // A stretch by 2, 1, 1: K_I = 2 and K_O = 4 on every tet, however its vertices are ordered.
        let image: Vec<[f64; 3]> = points.iter().map(|&[x, y, z]| [2.0 * x, y, z]).collect();
        let turned: Vec<[u32; 4]> = tets.iter().map(|&[a, b, c, d]| [b, a, c, d]).collect();
        for tets in [&tets, &turned] {
            let measured = measure(&points, tets, &image).unwrap();
            assert!(measured.flipped.is_empty());
            assert!(measured.k_inner.iter().all(|k| (k - 2.0).abs() < 1e-14));
            assert!(measured.k.iter().all(|k| (k - 4.0).abs() < 1e-14));
        }
        let mut pushed = image.clone();
        pushed[8] = [3.0, 0.0, 0.0];
        let measured = measure(&points, &tets, &pushed).unwrap();
        assert_eq!(measured.flipped.len(), 2);
        assert!(measured.flipped.iter().all(|&tet| measured.k[tet as usize] == f64::INFINITY));
    }

    #[test]
    fn results_do_not_depend_on_the_units_of_the_arrays() {
        let (points, tets) = cube_fan();
        let scaled = |rows: &[[f64; 3]], scale: f64| -> Vec<[f64; 3]> {
            rows.iter().map(|row| row.map(|x| x * scale)).collect()
        };
        let settings = BallMapSettings { certify: None, ..Default::default() };
        let one = ball_map(&points, &tets, &settings).unwrap();
        for scale in [2f64.powi(900), 2f64.powi(-900)] {
            let other = ball_map(&scaled(&points, scale), &tets, &settings).unwrap();
            assert_eq!((&other.k, &other.image, other.stop), (&one.k, &one.image, one.stop));
            assert_eq!(other.points, scaled(&one.points, scale));
            let optimized = optimize(&points, &tets, &scaled(&one.image, scale), None, &settings.optimize).unwrap();
            let beside = optimize(&points, &tets, &one.image, None, &settings.optimize).unwrap();
            assert_eq!((optimized.k, optimized.image), (beside.k, scaled(&beside.image, scale)));
        }
    }

    #[test]
    fn locked_tets_are_split_unless_the_caller_says_what_is_fixed() {
        // An octahedron as four tets about an axis that joins two boundary vertices.
        let points = [[1., 0., 0.], [0., 1., 0.], [-1., 0., 0.], [0., -1., 0.], [0., 0., 1.], [0., 0., -1.]]
            .map(|p: [f64; 3]| p);
        let tets = [[4, 5, 0, 1], [4, 5, 1, 2], [4, 5, 2, 3], [4, 5, 3, 0]];
        let settings = OptimizeSettings::default();
        let map = optimize(&points, &tets, &points, None, &settings).unwrap();
        assert_eq!((map.points.len(), map.tets.len(), map.image.len()), (7, 8, 7));
        assert!(map.summary.max_k < 1.0 + 1e-9 && !map.bounds.is_empty());
        let kept = optimize(&points, &tets, &points, Some(&[true; 6]), &settings).unwrap();
        assert_eq!((kept.tets.len(), kept.stop), (4, StopReason::NothingFree));
    }
}

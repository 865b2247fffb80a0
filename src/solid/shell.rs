//! The shell mesher: a star-shaped surface refined, then scaled towards the star centre in layers.
//!
//! Every tet lies in the cone of one surface triangle over the centre, where the radial map with exponent 1 is linear.
//! So at the radial start no tet is flipped, whatever the refinement, K is constant in each cone, and no tet has all
//! its vertices on the boundary.

use super::refine::{halve_longest, refine_onto_ball, subdivide};
use crate::cancel::Cancel;
use crate::mesh::{MeshError, PolygonSoup, TetMesh, Vec3, VertexId};
use crate::solid::{Surface, SurfaceError};

/// How a surface is refined before it is layered; all splits lie on the surface, so sharp edges are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refinement {
    /// Longest edges are halved until none is longer than this (in units of the surface).
    EdgeLength(f64),
    /// Longest edges are halved until the mesh has at least this many tets.
    Cells(usize),
    /// Edges are halved, seen from the star centre, until the surface's radial image on the sphere is so fine that the radial
    /// map of that inscribed polyhedron onto the ball has no K above this, > 1, or the mesh has [`MOST_TETS_FOR_BALL`] tets: see
    /// [`crate::solid::inscribed_stretch`].
    Ball(f64),
}

impl Refinement {
    /// Where the refinement is left to the program: K onto the ball is at most so many times K.
    pub const USUAL: Self = Self::Ball(1.25);
}

/// What a shell mesh is made with.
#[derive(Clone, Debug, PartialEq)]
pub struct ShellSettings {
    /// Every surface triangle is first split into this number squared of similar ones; at least 1.
    pub subdivisions: u32,
    /// Further refinement, if any.
    pub refinement: Option<Refinement>,
    /// Number of layers from centre to boundary, at least 1.
    pub layers: u32,
    /// Ratio of the thickness of a layer to that of the next inner one, > 0; 1 for equal layers.
    pub grading: f64,
}

/// Largest number of tets a shell mesh may have: above it 32-bit tables of the optimizer overflow.
pub const MOST_TETS: usize = 100_000_000;

/// Number of tets beyond which [`Refinement::Ball`] refines no further: a surface of needles, or one thousands of times as wide as it is
/// thick, would otherwise take millions that nobody asked for.
pub const MOST_TETS_FOR_BALL: usize = 500_000;

/// The least thickness of a layer, as a part of the whole: some thousand units in the last place of a vertex.
const LEAST_LAYER: f64 = 1e-12;

/// Why no shell mesh was made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ShellError {
    /// Settings outside their ranges.
    #[error("{0}")]
    Settings(String),
    /// More tets than can be handled.
    #[error("the shell mesh would have {tets} tets, more than {MOST_TETS}: ask for a coarser surface or fewer layers")]
    TooLarge {
        /// Number of tets asked for.
        tets: usize,
    },
    /// The centre does not see the surface well enough for positive volumes in floating point.
    #[error(
        "a cell of the shell mesh is flat or inside out: {0}; the star centre is too close to a face's plane, or the layers are too unequal"
    )]
    Cell(#[from] MeshError),
    /// The refined surface is not one.
    #[error("the refined surface is degenerate: {0}")]
    Surface(#[from] SurfaceError),
    /// [`shell_mesh_until`] was cancelled.
    #[error("the shell mesh was cancelled before it was made")]
    Cancelled,
}

impl ShellSettings {
    /// A number of tets that no mesh of this surface has fewer of, known without meshing; for settings that [`shell_mesh`] takes.
    pub fn least_tets(&self, surface: &Surface) -> usize {
        let per_triangle = 3 * (self.layers as usize).max(1) - 2;
        let triangles = surface.triangles().len().saturating_mul((self.subdivisions as usize).saturating_pow(2));
        let of_refinement = match self.refinement {
            Some(Refinement::Cells(cells)) => cells,
            // No triangle with edges up to this length has a larger area than the equilateral one. Areas in units of the length, since
            // those of a large unit leave the range of numbers.
            Some(Refinement::EdgeLength(length)) => {
                let corners = surface.ids().map(|triangle| surface.corners(triangle).map(|p| p / length));
                let area: f64 = corners.map(|[a, b, c]| (b - a).cross(&(c - a)).norm() / 2.0).sum();
                ((area / (3f64.sqrt() / 4.0)) as usize).saturating_mul(per_triangle)
            }
            Some(Refinement::Ball(_)) | None => 0,
        };
        triangles.saturating_mul(per_triangle).max(of_refinement)
    }
}

/// A shell mesh and how its vertices sit on the rays from the centre.
#[derive(Clone, Debug)]
pub struct ShellMesh {
    /// The tets; vertex 0 is the centre.
    pub mesh: TetMesh,
    /// The refined surface.
    pub surface: Surface,
    /// For each vertex but the centre, the surface vertex on its ray and its fraction u in (0, 1] of that ray.
    pub rays: Vec<(VertexId, f64)>,
}

/// Meshes the solid inside `surface`, star-shaped about `centre`, in layers.
///
/// # Errors
/// See [`ShellError`].
pub fn shell_mesh(surface: &Surface, centre: Vec3, settings: &ShellSettings) -> Result<ShellMesh, ShellError> {
    shell_mesh_until(surface, centre, settings, &Cancel::default())
}

/// [`shell_mesh`], unless it is cancelled, which is looked at all the time: many millions of tets take many seconds. A deadline is of no
/// account.
///
/// # Errors
/// As [`shell_mesh`], and [`ShellError::Cancelled`].
pub fn shell_mesh_until(
    surface: &Surface,
    centre: Vec3,
    settings: &ShellSettings,
    cancel: &Cancel,
) -> Result<ShellMesh, ShellError> {
    check(settings)?;
    let per_triangle = 3 * settings.layers as usize - 2;
    let triangles = surface.triangles().len() * (settings.subdivisions as usize).pow(2);
    let wanted = match settings.refinement {
        Some(Refinement::Cells(cells)) => cells.max(triangles.saturating_mul(per_triangle)),
        _ => triangles.saturating_mul(per_triangle),
    };
    if wanted > MOST_TETS {
        return Err(ShellError::TooLarge { tets: wanted });
    }
    let wanted_still = || !cancel.is_raised();
    let go_on = || if wanted_still() { Ok(()) } else { Err(ShellError::Cancelled) };
    let mut soup = subdivide(surface, settings.subdivisions, wanted_still);
    go_on()?;
    let most = MOST_TETS / per_triangle;
    match settings.refinement {
        Some(Refinement::EdgeLength(wanted)) => {
            halve_longest(&mut soup, |length, triangles| length > wanted && triangles <= most && wanted_still())
        }
        Some(Refinement::Cells(wanted)) => {
            halve_longest(&mut soup, |_, triangles| triangles * per_triangle < wanted && wanted_still())
        }
        Some(Refinement::Ball(wanted)) => {
            let most = MOST_TETS_FOR_BALL / per_triangle;
            refine_onto_ball(&mut soup, &centre, wanted, |triangles| triangles <= most && wanted_still());
        }
        None => {}
    }
    go_on()?;
    if soup.triangles.len() > most {
        return Err(ShellError::TooLarge { tets: soup.triangles.len() * per_triangle });
    }
    let polygons = soup.triangles.into_iter().map(|t| t.map(VertexId).to_vec()).collect();
    let surface = Surface::from_soup(PolygonSoup::new(soup.points, polygons))?;
    go_on()?;
    layered(surface, centre, &layer_fractions(settings.layers, settings.grading))
}

/// What is wrong with a grading that leaves some layers no thickness, and what to do.
pub(super) fn too_steep(name: &str, grading: f64, count: u32, what: &str) -> Option<String> {
    let fractions = layer_fractions(count, grading);
    let thinnest = fractions.windows(2).map(|pair| pair[1] - pair[0]).fold(fractions[0], f64::min);
    // NaN where powers of the grading leave the range of numbers.
    (thinnest.is_nan() || thinnest <= LEAST_LAYER).then(|| {
        format!(
            "a {name} of {grading} over {count} {what} makes some too thin to be told from nothing beside the others; take one nearer to 1, or fewer {what}"
        )
    })
}

fn check(settings: &ShellSettings) -> Result<(), ShellError> {
    let refuse = |message: &str| Err(ShellError::Settings(message.into()));
    if settings.subdivisions == 0 {
        return refuse("subdivisions must be at least 1");
    }
    if settings.layers == 0 {
        return refuse("layers must be at least 1");
    }
    if !(settings.grading.is_finite() && settings.grading > 0.0) {
        return refuse("grading must be a positive number");
    }
    if let Some(steep) = too_steep("grading", settings.grading, settings.layers, "layers") {
        return refuse(&steep);
    }
    match settings.refinement {
        Some(Refinement::EdgeLength(length)) if !(length.is_finite() && length > 0.0) => {
            refuse("edge_length must be a positive number")
        }
        Some(Refinement::Ball(stretch)) if !(stretch.is_finite() && stretch > 1.0) => {
            refuse("the K of the radial map of the image must be allowed to exceed 1")
        }
        _ => Ok(()),
    }
}

/// The fractions u_1 < ... < u_n = 1 of the layers' outer boundaries.
pub(super) fn layer_fractions(layers: u32, grading: f64) -> Vec<f64> {
    let thickness: Vec<f64> = (0..layers).map(|k| grading.powi(k as i32)).collect();
    let total: f64 = thickness.iter().sum();
    let mut sum = 0.0;
    let mut fractions: Vec<f64> = thickness
        .iter()
        .map(|t| {
            sum += t;
            sum / total
        })
        .collect();
    if let Some(last) = fractions.last_mut() {
        *last = 1.0;
    }
    fractions
}

/// Vertex 0 is the centre; vertex `1 + k * n + v` is surface vertex `v` at fraction `fractions[k]`.
fn layered(surface: Surface, centre: Vec3, fractions: &[f64]) -> Result<ShellMesh, ShellError> {
    let count = surface.points().len();
    let (mut points, mut rays) = (vec![centre], Vec::with_capacity(count * fractions.len()));
    for &fraction in fractions {
        for (index, point) in surface.points().iter().enumerate() {
            // The outermost layer is the surface itself, to the bit.
            points.push(if fraction == 1.0 { *point } else { centre + (point - centre) * fraction });
            rays.push((VertexId(index as u32), fraction));
        }
    }
    let vertex = |layer: usize, v: u32| VertexId((1 + layer * count) as u32 + v);
    let mut tets = Vec::with_capacity(surface.triangles().len() * (3 * fractions.len() - 2));
    for triangle in surface.triangles() {
        cone_tets(&mut tets, VertexId(0), triangle.map(|v| v.0), fractions.len(), vertex);
    }
    Ok(ShellMesh { mesh: TetMesh::new(points, tets)?, surface, rays })
}

/// The tets of a cone of layers over a triangle that is counter-clockwise seen from beyond it; `vertex` names the point of a layer
/// over a vertex of the triangle.
pub(super) fn cone_tets(
    tets: &mut Vec<[VertexId; 4]>,
    apex: VertexId,
    triangle: [u32; 3],
    layers: usize,
    vertex: impl Fn(usize, u32) -> VertexId,
) {
    let [a, b, c] = triangle;
    tets.push([apex, vertex(0, a), vertex(0, b), vertex(0, c)]);
    // The diagonal of a prism's side runs from the inner end of the smaller vertex number to the outer end of the
    // larger one: the same seen from both prisms.
    let mut order = [a, b, c];
    order.sort_unstable();
    let [low, mid, high] = order;
    let even = order == [a, b, c] || order == [b, c, a] || order == [c, a, b];
    for layer in 1..layers {
        let (inner, outer) = (|v| vertex(layer - 1, v), |v| vertex(layer, v));
        for tet in [
            [inner(low), inner(mid), inner(high), outer(high)],
            [inner(low), outer(mid), inner(mid), outer(high)],
            [inner(low), outer(low), outer(mid), outer(high)],
        ] {
            tets.push(if even { tet } else { [tet[0], tet[2], tet[1], tet[3]] });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Boundary;
    use crate::solid::Solid;

    fn settings(subdivisions: u32, layers: u32) -> ShellSettings {
        ShellSettings { subdivisions, refinement: None, layers, grading: 1.0 }
    }

    #[test]
    fn cube_is_filled_by_a_ball_without_locked_tets() {
        let surface = Solid::Cube.surface().unwrap();
        let shell = shell_mesh(&surface, Vec3::zeros(), &settings(4, 8)).unwrap();
        // 8 x 8 squares a face, two triangles each; one tet a triangle at the centre and three for each further layer.
        assert_eq!(shell.mesh.tets().len(), 6 * 64 * 2 * 22);
        let boundary = Boundary::of(&shell.mesh).unwrap();
        boundary.check_ball(&shell.mesh).unwrap();
        assert!(shell.mesh.tets().iter().all(|tet| tet.iter().any(|&v| !boundary.contains(v))));
        let volume: f64 = (0..shell.mesh.tets().len() as u32)
            .map(|t| crate::mesh::edge_matrix(shell.mesh.corners(crate::TetId(t))).determinant() / 6.0)
            .sum();
        // 16,896 terms that sum to 8, each rounded at 1e-16 of itself.
        assert!((volume - 8.0).abs() < 1e-12);
    }

    #[test]
    fn grading_makes_a_geometric_series() {
        let fractions = layer_fractions(3, 0.5);
        for (got, want) in fractions.iter().zip([4.0 / 7.0, 6.0 / 7.0, 1.0]) {
            assert!((got - want).abs() < 1e-15);
        }
    }

    #[test]
    fn nonsense_settings_are_refused() {
        let surface = Solid::Cube.surface().unwrap();
        for bad in [
            settings(0, 1),
            settings(1, 0),
            ShellSettings { grading: -1.0, ..settings(1, 1) },
            ShellSettings { grading: 100.0, ..settings(1, 20) },
            ShellSettings { grading: 1e-4, ..settings(1, 8) },
            ShellSettings { grading: 1e300, ..settings(1, 8) },
            ShellSettings { refinement: Some(Refinement::EdgeLength(0.0)), ..settings(1, 1) },
        ] {
            assert!(matches!(shell_mesh(&surface, Vec3::zeros(), &bad), Err(ShellError::Settings(_))));
        }
        assert!(matches!(shell_mesh(&surface, Vec3::zeros(), &settings(100_000, 1)), Err(ShellError::TooLarge { .. })));
    }
}

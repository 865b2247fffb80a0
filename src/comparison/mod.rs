//! Maps of known dilatation on several meshes: published values, the paper's estimates, exact values, side by side.

mod slope;
mod table;

pub use slope::Slope;
pub use table::{table, write_results};

use serde::Serialize;

use crate::cancel::Cancel;
use crate::config::{AnalyticMeshPlan, AnalyticPlan, CaramanPlan, CellsPlan, MapPlan, MeshPlan};
use crate::estimate::{Estimate, EstimateSummary, Estimator, Weights, at_vertices, measure, on_cells};
use crate::map::AnalyticMap;
use crate::map::analytic::{Caraman, CaramanError, MapError};
use crate::mesh::{Cells, TetMesh, Vec3, VoxelMesh};
use crate::picture::{Picture, PictureError, PictureSettings};
use crate::solid::{
    CentreError, Curvature, ExternalError, FlagError, Invariants, ShellError, SolidError, Surface, SurfaceError,
    VoxelizeError, external_mesh, flag_mesh, shell_mesh, star_centre, voxelize,
};

/// Everything that a plan with the table `[analytic]` gives.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// Mesh by mesh, and in each the maps in their order.
    pub rows: Vec<ComparisonRow>,
    /// The meshes that are surfaces only, likewise.
    pub surfaces: Vec<SurfaceRow>,
    /// How the errors fall, wherever three or more meshes of one solid in one place are of one kind.
    pub slopes: Vec<Slope>,
    /// The maps in the order of the rows, if pictures are asked for.
    drawn: Vec<Drawn>,
}

/// One map of one surface.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceRow {
    /// The solid.
    pub mesh: String,
    /// How many triangles.
    pub triangles: usize,
    /// The map and its parameters.
    pub map: String,
    /// Of the surface.
    pub before: Invariants,
    /// Of its image.
    pub after: Invariants,
}

/// A map that is to be shown.
#[derive(Clone, Debug)]
struct Drawn {
    /// `mesh-1-map-1` and so on, counted as in the config.
    name: String,
    mesh: Mesh,
    image: Vec<Vec3>,
    pictures: Vec<(&'static str, Picture)>,
}

/// One map on one mesh; dilatations are scale-free.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ComparisonRow {
    /// The solid and how it is filled.
    pub mesh: String,
    /// How many cells.
    pub cells: usize,
    /// How many vertices.
    pub vertices: usize,
    /// The largest volume of a cell, in the solid's own units cubed.
    pub largest_cell: f64,
    /// The map and its parameters.
    pub map: String,
    /// The published max K.
    pub published: Option<f64>,
    /// Our max K over the vertices by the plan's estimator.
    pub estimated: f64,
    /// The published mean K.
    pub published_mean: Option<f64>,
    /// Our mean over the vertices.
    pub estimated_mean: f64,
    /// The max K of the gradients of the cells: on tets the exact one of the piecewise-linear map, on boxes at their centres.
    /// Infinite if a cell is flipped.
    pub per_cell: f64,
    /// How many cells the vertex map flattens, or turns against most others: the estimates see |J| only and hide them.
    pub flipped: usize,
    /// The largest exact K of the map itself at the vertices, where it has a derivative.
    pub exact_at_vertices: f64,
    /// The exact supremum of K over the map's whole domain of validity, which the mesh need not fill; none for compositions.
    pub supremum: Option<f64>,
}

/// What stands in the way of a row. Meshes count from 1, in the config's order.
#[derive(Debug, thiserror::Error)]
#[error("mesh {mesh}: {fault}")]
pub struct ComparisonError {
    mesh: usize,
    fault: Box<Fault>,
}

#[derive(Debug, thiserror::Error)]
enum Fault {
    #[error(transparent)]
    Solid(#[from] SolidError),
    #[error("after `place`: {0}")]
    Placed(#[from] SurfaceError),
    #[error(transparent)]
    Voxels(#[from] VoxelizeError),
    #[error(transparent)]
    External(#[from] ExternalError),
    #[error(transparent)]
    Centre(#[from] CentreError),
    #[error(transparent)]
    Shell(#[from] ShellError),
    #[error(transparent)]
    Flag(#[from] FlagError),
    #[error("vertex {vertex}: {error}; move the solid by `place`")]
    Map { vertex: usize, error: MapError },
    #[error("`place`: {0}")]
    Place(MapError),
    #[error("its image: {0}")]
    Image(SurfaceError),
    #[error(transparent)]
    Caraman(#[from] CaramanError),
    #[error(transparent)]
    Picture(#[from] PictureError),
}

/// Makes the meshes, maps and measures them.
///
/// # Errors
/// The first mesh that cannot be made or mapped.
pub fn compare(plan: &AnalyticPlan) -> Result<Comparison, ComparisonError> {
    let mut comparison = Comparison { rows: Vec::new(), surfaces: Vec::new(), slopes: Vec::new(), drawn: Vec::new() };
    for (index, mesh_plan) in plan.meshes.iter().enumerate() {
        comparison
            .add(plan, mesh_plan, index + 1)
            .map_err(|fault| ComparisonError { mesh: index + 1, fault: Box::new(fault) })?;
    }
    comparison.slopes = slope::slopes(plan, &comparison.rows);
    Ok(comparison)
}

impl Comparison {
    fn add(&mut self, plan: &AnalyticPlan, mesh_plan: &AnalyticMeshPlan, number: usize) -> Result<(), Fault> {
        let surface = placed(mesh_plan)?;
        let maps = plan.maps.iter().map(|map| map_of(map, mesh_plan, &surface)).collect::<Result<Vec<_>, _>>()?;
        let Some(mesh) = Mesh::of(mesh_plan, &surface)? else {
            for map in &maps {
                self.surfaces.push(surface_row(mesh_plan, &surface, map)?);
            }
            return Ok(());
        };
        for (index, map) in maps.iter().enumerate() {
            let (mut row, image) = row(mesh_plan, &mesh, map, plan.estimator)?;
            (row.published, row.published_mean) = (mesh_plan.published[index], mesh_plan.published_mean[index]);
            self.rows.push(row);
            if !plan.colours.is_empty() {
                let name = format!("mesh-{number}-map-{}", index + 1);
                self.drawn.push(Drawn::new(plan, name, mesh.clone(), image)?);
            }
        }
        Ok(())
    }
}

impl Drawn {
    fn new(plan: &AnalyticPlan, name: String, mesh: Mesh, image: Vec<Vec3>) -> Result<Self, Fault> {
        let picture = |&colour| {
            let settings = PictureSettings { colour, cuts: plan.cuts.clone(), view: PictureSettings::VIEW.into() };
            Ok((colour.name(), Picture::draw(mesh.cells(), mesh.points(), Some(&image), &settings)?))
        };
        let pictures = plan.colours.iter().map(picture).collect::<Result<_, Fault>>()?;
        Ok(Self { name, mesh, image, pictures })
    }
}

/// The map of a mesh.
fn map_of(map: &MapPlan, mesh: &AnalyticMeshPlan, surface: &Surface) -> Result<AnalyticMap, Fault> {
    Ok(match map {
        MapPlan::Formula(map) => map.clone(),
        MapPlan::Caraman(CaramanPlan { exponent, .. }) => {
            let centre = star_centre(surface, &mesh.centre)?.position;
            AnalyticMap::Caraman(Caraman::new(surface, centre, *exponent)?)
        }
    })
}

fn surface_row(plan: &AnalyticMeshPlan, surface: &Surface, map: &AnalyticMap) -> Result<SurfaceRow, Fault> {
    let points = map.apply(surface.points()).map_err(|(vertex, error)| Fault::Map { vertex, error })?;
    let image = Surface::from_triangles(points, surface.triangles()).map_err(Fault::Image)?;
    Ok(SurfaceRow {
        mesh: plan.solid.to_string(),
        triangles: surface.triangles().len(),
        map: map.to_string(),
        before: Curvature::of(surface).invariants(),
        after: Curvature::of(&image).invariants(),
    })
}

#[derive(Clone, Debug)]
enum Mesh {
    Tets(TetMesh),
    Boxes(VoxelMesh),
}

impl Mesh {
    /// None for a surface.
    fn of(plan: &AnalyticMeshPlan, surface: &Surface) -> Result<Option<Self>, Fault> {
        Ok(Some(match &plan.cells {
            CellsPlan::Voxels(voxels) => Self::Boxes(voxelize(surface, *voxels)?),
            CellsPlan::Tets(MeshPlan::External(settings)) => {
                Self::Tets(external_mesh(surface, settings, &Cancel::default())?)
            }
            CellsPlan::Tets(MeshPlan::Shell(settings) | MeshPlan::Auto { shell: settings, .. }) => {
                let centre = star_centre(surface, &plan.centre)?;
                Self::Tets(shell_mesh(surface, centre.position, settings)?.mesh)
            }
            CellsPlan::Tets(MeshPlan::Flag(settings)) => {
                let centre = star_centre(surface, &plan.centre)?;
                Self::Tets(flag_mesh(surface, centre.position, settings)?.mesh)
            }
            CellsPlan::Surface => return Ok(None),
        }))
    }

    fn cells(&self) -> Cells<'_> {
        match self {
            Self::Tets(mesh) => mesh.into(),
            Self::Boxes(mesh) => mesh.into(),
        }
    }

    fn points(&self) -> &[Vec3] {
        match self {
            Self::Tets(mesh) => mesh.points(),
            Self::Boxes(mesh) => mesh.points(),
        }
    }
}

/// The plan's solid in its place.
fn placed(plan: &AnalyticMeshPlan) -> Result<Surface, Fault> {
    let surface = plan.solid.surface()?;
    let Some(place) = &plan.place else { return Ok(surface) };
    let points =
        AnalyticMap::Affine(place.clone()).apply(surface.points()).map_err(|(_, error)| Fault::Place(error))?;
    Ok(Surface::from_triangles(points, surface.triangles())?)
}

/// What is measured of a map, without the published figures, and the image.
fn row(
    plan: &AnalyticMeshPlan,
    mesh: &Mesh,
    map: &AnalyticMap,
    estimator: Estimator,
) -> Result<(ComparisonRow, Vec<Vec3>), Fault> {
    let (cells, points) = (mesh.cells(), mesh.points());
    let image = map.apply(points).map_err(|(vertex, error)| Fault::Map { vertex, error })?;
    let at_vertices = vertices(cells, points, &image, estimator, plan.weights);
    let of_cells = on_cells(cells, points, &image, Estimator::Gradient);
    let turned = |sign: f64| of_cells.iter().filter(|estimate| estimate.jacobian * sign <= 0.0).count();
    let flipped = turned(1.0).min(turned(-1.0));
    let per_cell = if flipped > 0 { f64::INFINITY } else { EstimateSummary::of(&of_cells).max_k };
    let exact = points.iter().filter_map(|point| map.dilatation(point).ok()).map(|dilatation| dilatation.k());
    let filling = match &plan.cells {
        CellsPlan::Voxels(voxels) => voxels.to_string(),
        CellsPlan::Tets(MeshPlan::External(settings)) => format!("{} tets", settings.mesher),
        CellsPlan::Tets(MeshPlan::Shell(_) | MeshPlan::Auto { .. }) => "shell tets".into(),
        CellsPlan::Tets(MeshPlan::Flag(_)) => "flag tets".into(),
        CellsPlan::Surface => "no cells".into(),
    };
    let row = ComparisonRow {
        mesh: format!("{}, {filling}", plan.solid),
        cells: cells.len(),
        vertices: points.len(),
        largest_cell: (0..cells.len()).map(|cell| measure(cells, cell, points)).fold(0.0, f64::max),
        map: map.to_string(),
        published: None,
        published_mean: None,
        estimated: at_vertices.max_k,
        estimated_mean: at_vertices.mean_k,
        per_cell,
        flipped,
        exact_at_vertices: exact.fold(1.0, f64::max),
        supremum: map.max_dilatation().map(|dilatation| dilatation.k()),
    };
    Ok((row, image))
}

fn vertices(cells: Cells, points: &[Vec3], image: &[Vec3], estimator: Estimator, weights: Weights) -> EstimateSummary {
    let estimates = at_vertices(cells, points, image, estimator, weights);
    EstimateSummary::of(&estimates.into_iter().map(|(_, estimate)| estimate).collect::<Vec<Estimate>>())
}

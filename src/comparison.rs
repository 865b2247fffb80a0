//! Maps of known dilatation on several meshes: published values, the paper's estimates, exact values, side by side.

use std::fmt::Write as _;
use std::path::Path;

use serde::Serialize;

use crate::config::{AnalyticMeshPlan, AnalyticPlan, CellsPlan, MeshPlan};
use crate::estimate::{Cells, Estimate, EstimateSummary, Estimator, Weights, at_vertices, measure, on_cells};
use crate::map::AnalyticMap;
use crate::map::analytic::MapError;
use crate::mesh::io::{WriteError, write_atomically};
use crate::mesh::{PolygonSoup, TetMesh, Vec3, VoxelMesh};
use crate::solid::{
    CentreChoice, CentreError, ExternalError, ShellError, SolidError, Surface, SurfaceError, VoxelizeError,
    external_mesh, shell_mesh, star_centre, voxelize,
};

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
    /// The mean over the vertices.
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
    fault: Fault,
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
    #[error("vertex {vertex}: {error}; move the solid by `place`")]
    Map { vertex: usize, error: MapError },
    #[error("`place`: {0}")]
    Place(MapError),
}

/// Makes the meshes, maps and measures them; the rows come mesh by mesh, and in each the maps in their order.
///
/// # Errors
/// The first mesh that cannot be made or mapped.
pub fn compare(plan: &AnalyticPlan) -> Result<Vec<ComparisonRow>, ComparisonError> {
    let mut rows = Vec::new();
    for (index, mesh_plan) in plan.meshes.iter().enumerate() {
        let at = |fault| ComparisonError { mesh: index + 1, fault };
        let mesh = Mesh::of(mesh_plan).map_err(at)?;
        for (map, &published) in plan.maps.iter().zip(&mesh_plan.published) {
            rows.push(row(mesh_plan, &mesh, map, plan.estimator, published).map_err(at)?);
        }
    }
    Ok(rows)
}

enum Mesh {
    Tets(TetMesh),
    Boxes(VoxelMesh),
}

impl Mesh {
    fn of(plan: &AnalyticMeshPlan) -> Result<Self, Fault> {
        let surface = placed(plan)?;
        Ok(match &plan.cells {
            CellsPlan::Voxels(voxels) => Self::Boxes(voxelize(&surface, *voxels)?),
            CellsPlan::Tets(MeshPlan::External(settings)) => Self::Tets(external_mesh(&surface, settings)?),
            CellsPlan::Tets(MeshPlan::Shell(settings)) => {
                let centre = star_centre(&surface, &CentreChoice::Kernel)?;
                Self::Tets(shell_mesh(&surface, centre.position, settings)?.mesh)
            }
        })
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
    let polygons = surface.triangles().iter().map(|triangle| triangle.to_vec()).collect();
    Ok(Surface::from_soup(PolygonSoup { points, polygons })?)
}

fn row(
    plan: &AnalyticMeshPlan,
    mesh: &Mesh,
    map: &AnalyticMap,
    estimator: Estimator,
    published: Option<f64>,
) -> Result<ComparisonRow, Fault> {
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
        CellsPlan::Tets(_) => "tets".into(),
    };
    Ok(ComparisonRow {
        mesh: format!("{}, {filling}", plan.solid),
        cells: cells.len(),
        vertices: points.len(),
        largest_cell: (0..cells.len()).map(|cell| measure(cells, cell, points)).fold(0.0, f64::max),
        map: map.to_string(),
        published,
        estimated: at_vertices.max_k,
        estimated_mean: at_vertices.mean_k,
        per_cell,
        flipped,
        exact_at_vertices: exact.fold(1.0, f64::max),
        supremum: map.max_dilatation().map(|dilatation| dilatation.k()),
    })
}

fn vertices(cells: Cells, points: &[Vec3], image: &[Vec3], estimator: Estimator, weights: Weights) -> EstimateSummary {
    let estimates = at_vertices(cells, points, image, estimator, weights);
    EstimateSummary::of(&estimates.into_iter().map(|(_, estimate)| estimate).collect::<Vec<Estimate>>())
}

/// The rows as a table in Markdown.
pub fn table(plan: &AnalyticPlan, rows: &[ComparisonRow]) -> String {
    let estimator = serde_json::json!(plan.estimator);
    let mut text = format!(
        "# {}\n\nMax K of maps in closed form. \"ours\": over the vertices, by the estimator {estimator}; \"per cell\": of the \
         gradient on each cell, exact for tets; \"exact at vertices\": of the map itself at the mesh's vertices; \"exact sup\": \
         over all points where the map is defined.\n\n\
         | mesh | cells | largest cell | map | paper | ours | per cell | flipped cells | exact at vertices | exact sup |\n\
         |---|---|---|---|---|---|---|---|---|---|\n",
        plan.name
    );
    let optional = |value: Option<f64>| value.map_or_else(|| "-".into(), |value| format!("{value}"));
    for row in rows {
        let supremum = row.supremum.map_or_else(|| "-".into(), |value| format!("{value:.4}"));
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "| {} | {} | {:.3e} | {} | {} | {:.4} | {:.4} | {} | {:.4} | {supremum} |",
            row.mesh,
            row.cells,
            row.largest_cell,
            row.map,
            optional(row.published),
            row.estimated,
            row.per_cell,
            row.flipped,
            row.exact_at_vertices,
        );
    }
    text
}

/// Writes `table.csv` and `table.md` into a folder, made if missing.
///
/// # Errors
/// The first file that could not be written, and why.
pub fn write_tables(folder: &Path, plan: &AnalyticPlan, rows: &[ComparisonRow]) -> Result<(), WriteError> {
    write_atomically(&folder.join("table.csv"), |file| {
        let mut writer = csv::Writer::from_writer(file);
        rows.iter().try_for_each(|row| writer.serialize(row)).map_err(std::io::Error::other)?;
        writer.flush()
    })?;
    write_atomically(&folder.join("table.md"), |file| file.write_all(table(plan, rows).as_bytes()))
}

//! `qcball measure REST IMAGE` and `qcball bounds REST IMAGE`: what can be said of any map that two mesh files give.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use super::output::{note, print};
use super::{Ending, Failure};
use crate::bound::{self, LowerBound};
use crate::domain::Domain;
use crate::measure::{Summary, measure};
use crate::mesh::io::read_tets;
use crate::mesh::{MeshError, TetMesh, TetSoup, TopologyError, Vec3};
use crate::report::{BestBound, bounds_table, dilatations, to_json};

/// The two files of a map.
#[derive(Debug, Args)]
pub(crate) struct MapArguments {
    /// The mesh of the domain (.mesh, .vtu, .vtk, .msh, .node, .ele).
    rest: PathBuf,
    /// The mesh of its image: the same tets in the same order, other positions.
    image: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// What `bounds --json` prints.
#[derive(Serialize)]
struct BoundFigures {
    bounds: Vec<LowerBound>,
    #[serde(flatten)]
    best: BestBound,
    max_k: f64,
}

/// Why two meshes are not a map.
#[derive(Debug, thiserror::Error)]
pub(crate) enum MeasureError {
    #[error("{}: {source} (tets and vertices are counted from 0)", path.display())]
    Mesh { path: PathBuf, source: MeshError },
    #[error("{}: {source} (vertices are counted from 0)", path.display())]
    Topology { path: PathBuf, source: TopologyError },
    #[error(
        "{} and {} are not meshes with the same connectivity: {difference}; a map is measured between a mesh and the same \
         mesh with moved vertices",
        rest.display(),
        image.display()
    )]
    Mismatch { rest: PathBuf, image: PathBuf, difference: String },
}

/// What `measure --json` prints: the figures of the map, then the size of the mesh.
#[derive(Serialize)]
struct Figures<'a> {
    #[serde(flatten)]
    summary: &'a Summary,
    tets: usize,
    vertices: usize,
    locked: usize,
}

/// `qcball measure`.
pub(super) fn measure_map(arguments: &MapArguments) -> Result<Ending, Failure> {
    let (domain, image) = read_map(&arguments.rest, &arguments.image)?;
    let measured = measure(&domain, &image);
    let summary = &measured.summary;
    let (tets, vertices) = (domain.mesh().tets().len(), domain.mesh().points().len());
    let locked = domain.locked_tets().count();
    if arguments.json {
        return print(&to_json(&Figures { summary, tets, vertices, locked }));
    }
    let mirrored = if summary.flipped == tets {
        "Every tet is flipped: the image is a mirror image. Negate one coordinate of it and measure again.\n"
    } else {
        ""
    };
    print(&format!(
        "{tets} tets ({locked} locked), {vertices} vertices\n{}{mirrored}",
        dilatations(&[("map", summary)])
    ))
}

/// `qcball bounds`.
///
/// Two meshes do not tell a star centre, so the bounds for radial boundary values are not among these.
pub(super) fn bound_map(arguments: &MapArguments) -> Result<Ending, Failure> {
    let (domain, image) = read_map(&arguments.rest, &arguments.image)?;
    let max_k = measure(&domain, &image).summary.max_k;
    let bounds = bound::all(&domain, &image, None, false);
    let best = BestBound::of(&bounds, max_k);
    if arguments.json {
        print(&to_json(&BoundFigures { bounds, best, max_k }))
    } else {
        print(&bounds_table(&bounds, best))
    }
}

/// Reads a mesh and its image. The map is given by the vertices: in which order a tet names its four is of no account in
/// either file, and a mesh of negative tets is measured like the same mesh turned positive.
fn read_map(rest_path: &Path, image_path: &Path) -> Result<(Domain, Vec<Vec3>), Failure> {
    let rest = read_tets(rest_path)?;
    let image = read_tets(image_path)?;
    if let Some(difference) = difference(&rest, &image) {
        let (rest, image) = (rest_path.to_path_buf(), image_path.to_path_buf());
        return Err(MeasureError::Mismatch { rest, image, difference }.into());
    }
    let path = || rest_path.to_path_buf();
    let (mesh, exchanged) = TetMesh::from_either_orientation(rest.points, rest.tets)
        .map_err(|source| MeasureError::Mesh { path: path(), source })?;
    if exchanged > 0 {
        note(&format!(
            "{exchanged} of {} tets of {} were stored with negative orientation; two vertices of each were exchanged",
            mesh.tets().len(),
            rest_path.display()
        ));
    }
    let domain = Domain::any_topology(mesh).map_err(|source| MeasureError::Topology { path: path(), source })?;
    Ok((domain, image.points))
}

fn difference(rest: &TetSoup, image: &TetSoup) -> Option<String> {
    let counts = |what: &str, a: usize, b: usize| (a != b).then(|| format!("the first has {a} {what}, the second {b}"));
    counts("vertices", rest.points.len(), image.points.len())
        .or_else(|| counts("tets", rest.tets.len(), image.tets.len()))
        .or_else(|| {
            let (tet, (a, b)) = rest.tets.iter().zip(&image.tets).enumerate().find(|(_, (a, b))| {
                let (mut a, mut b) = (**a, **b);
                a.sort_unstable();
                b.sort_unstable();
                a != b
            })?;
            // As the files count them.
            let [a, b] = [a, b].map(|tet| tet.map(|v| u64::from(v.0) + 1));
            Some(format!("tet {} has the vertices {a:?} in the first, {b:?} in the second (counted from 1)", tet + 1))
        })
}

//! `qcball map NAME k=v ... IN OUT`: a map in closed form applied to the vertices of a mesh.

use std::path::{Path, PathBuf};

use clap::Args;

use super::inputs::{refuse_to_write_over, tell};
use super::output::{note, print};
use super::{Ending, Failure};
use crate::dilatation::Dilatation;
use crate::map::AnalyticMap;
use crate::map::analytic::{Caraman, CaramanError, MapError};
use crate::mesh::io::{CellData, check_tets_can_be_written, read_tets, shown_path, write_tets};
use crate::mesh::{Boundary, MeshError, Orientation, TetMesh, TetSoup, TopologyError, Vec3, orientation};
use crate::solid::{Surface, SurfaceError};

/// The map and the two files.
#[derive(Debug, Args)]
#[command(override_usage = "qcball map <NAME> [KEY=VALUE]... <IN> <OUT>")]
pub(crate) struct MapArguments {
    /// affine (matrix, offset), folding (ratio), cone (ratio, angle), power (exponent), zorich1, zorich2, zorich (half_side),
    /// caraman (exponent, centre).
    name: String,
    /// The parameters as key=value, then the mesh IN and the file OUT for its image, whose format follows its ending.
    #[arg(value_name = "WORDS", num_args = 2.., required = true, allow_hyphen_values = true)]
    words: Vec<String>,
}

/// Why no image was written.
#[derive(Debug, thiserror::Error)]
pub(crate) enum MapFailure {
    #[error("{0}")]
    Map(#[from] MapError),
    #[error("{}: vertex {vertex} (counted from 0): {error}", shown_path(path))]
    Vertex { path: PathBuf, vertex: usize, error: MapError },
    #[error("{}: {error}", shown_path(path))]
    Mesh { path: PathBuf, error: MeshError },
    #[error("{}: {error}", shown_path(path))]
    Topology { path: PathBuf, error: TopologyError },
    #[error("{}: the boundary of the mesh: {error}", shown_path(path))]
    Surface { path: PathBuf, error: SurfaceError },
    #[error("{}: the boundary of the mesh: {error}", shown_path(path))]
    Caraman { path: PathBuf, error: CaramanError },
}

/// `qcball map`.
pub(super) fn map(arguments: &MapArguments) -> Result<Ending, Failure> {
    let (parameters, [input, output]) = arguments.words.split_last_chunk().expect("clap takes two words at least");
    let (input, output) = (&PathBuf::from(input), &PathBuf::from(output));
    if input.to_string_lossy().contains('=') && !input.exists() {
        let message = format!("{} is a parameter: name the mesh IN and the file OUT after them", shown_path(input));
        return Err(MapFailure::from(MapError::Words(message)).into());
    }
    check_tets_can_be_written(output)?;
    refuse_to_write_over([input], [output])?;
    let soup = read_tets(input)?.tidied();
    tell(input, &soup.notes);
    let map = match arguments.name.as_str() {
        "caraman" => caraman(parameters, input, &soup)?,
        name => AnalyticMap::from_words(name, parameters).map_err(MapFailure::from)?,
    };
    let image =
        map.apply(&soup.points).map_err(|(vertex, error)| MapFailure::Vertex { path: input.clone(), vertex, error })?;
    write_tets(output, &image, &soup.tets, &CellData::new())?;
    tell_of_orientation(&soup, &image);
    let most = match map.max_dilatation() {
        Some(Dilatation { inner, outer }) => format!("sup K_I {inner:.6}, sup K_O {outer:.6} where the map is defined"),
        None => "no formula for the supremum of K; at most the product of the maps'".into(),
    };
    print(&format!("{} vertices, {} tets; {most}\n", soup.points.len(), soup.tets.len()))
}

/// Caraman's map of the solid that the mesh fills: the parameters `exponent` (1 if not given) and `centre` (the origin).
fn caraman(parameters: &[String], path: &Path, soup: &TetSoup) -> Result<AnalyticMap, MapFailure> {
    let (mut exponent, mut centre) = (1.0, Vec3::zeros());
    for word in parameters {
        match word.split_once('=') {
            Some(("exponent", _)) => match AnalyticMap::from_words("power", std::slice::from_ref(word))? {
                AnalyticMap::Power(power) if power.exponent > 0.0 => exponent = power.exponent,
                _ => return Err(MapError::Words("caraman: exponent must be a positive number".into()).into()),
            },
            Some(("centre", value)) => centre = vector(value)?,
            _ => {
                let message = format!("caraman: `{word}` is no parameter; there are exponent=A and centre=[X,Y,Z]");
                return Err(MapError::Words(message).into());
            }
        }
    }
    let path = || path.to_path_buf();
    let (mesh, _) = TetMesh::from_either_orientation(soup.points.clone(), soup.tets.clone())
        .map_err(|error| MapFailure::Mesh { path: path(), error })?;
    let boundary = Boundary::of(&mesh).map_err(|error| MapFailure::Topology { path: path(), error })?;
    let surface = Surface::from_triangles(soup.points.clone(), boundary.triangles())
        .map_err(|error| MapFailure::Surface { path: path(), error })?;
    let map = Caraman::new(&surface, centre, exponent).map_err(|error| MapFailure::Caraman { path: path(), error })?;
    Ok(AnalyticMap::Caraman(map))
}

/// `[1, 2, 3]` or `1,2,3`.
fn vector(text: &str) -> Result<Vec3, MapError> {
    let numbers =
        text.trim_start_matches('[').trim_end_matches(']').split(',').map(|number| number.trim().parse::<f64>());
    match numbers.collect::<Result<Vec<f64>, _>>().as_deref() {
        Ok(&[x, y, z]) if [x, y, z].iter().all(|number| number.is_finite()) => Ok(Vec3::new(x, y, z)),
        _ => Err(MapError::Words(format!("caraman: centre is `{text}`; write three numbers as centre=[0, 0, 0.5]"))),
    }
}

/// A map may mirror a mesh, and tear or fold a coarse one: the tets tell.
fn tell_of_orientation(soup: &TetSoup, image: &[Vec3]) {
    let turned = soup.tets.iter().filter(|tet| {
        let of = |points: &[Vec3]| orientation(tet.map(|v| &points[v.index()]));
        let finite = tet.iter().all(|v| image[v.index()].iter().all(|x| x.is_finite()));
        !finite || of(image) == Orientation::Flat || of(image) != of(&soup.points)
    });
    match turned.count() {
        0 => {}
        all if all == soup.tets.len() => note("the image is a mirror image: every tet is flipped"),
        some => note(&format!(
            "{some} of {} tets are flipped in the image: the mesh is too coarse for the map, or crosses a cut of it",
            soup.tets.len()
        )),
    }
}

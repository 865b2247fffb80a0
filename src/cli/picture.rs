//! `qcball picture REST [IMAGE] OUT`: a mesh or a map as a picture, without a display.

use std::path::{Path, PathBuf};

use clap::Args;

use super::inputs::{read_map, refuse_to_write_over, tell};
use super::output::print;
use super::{Ending, Failure};
use crate::mesh::TetMesh;
use crate::mesh::io::{ReadError, read_tets, shown_path};
use crate::picture::{BoundaryFigures, Colour, Cut, Picture, PictureError, PictureSettings};

/// The meshes, what is shown, and the file.
#[derive(Debug, Args)]
#[command(override_usage = "qcball picture [OPTIONS] <REST> [IMAGE] <OUT>")]
pub(crate) struct PictureArguments {
    /// REST, the mesh of the domain; IMAGE, the mesh of its image (the same tets in the same order; may be left out); and OUT,
    /// the file to be written: .png for a picture, .vtu for the boundary with its figures.
    #[arg(value_name = "FILES", num_args = 2..=3, required = true)]
    files: Vec<PathBuf>,
    /// What the colours mean. Default: k if there is an image, else domain.
    #[arg(long, value_name = "NAME", value_enum)]
    colour: Option<Colour>,
    /// Cut away what lies beyond a plane of the domain, nx x + ny y + nz z > d; given several times, what lies beyond all.
    #[arg(long, value_name = "NX,NY,NZ,D", allow_hyphen_values = true)]
    cut: Vec<Cut>,
    /// The direction to the viewer; z points up.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = direction, default_value = "0.72,-0.5,0.48")]
    view: [f64; 3],
}

/// Why nothing was drawn.
#[derive(Debug, thiserror::Error)]
pub(crate) enum PictureFailure {
    #[error("{}: a picture is written as .png, the boundary with its figures as .vtu", shown_path(path))]
    Ending { path: PathBuf },
    #[error("{}: {error}", shown_path(path))]
    Picture { path: PathBuf, error: PictureError },
    #[error("{}: it shows the whole boundary; leave out --{option}, or write a .png", shown_path(path))]
    Option { path: PathBuf, option: &'static str },
    #[error(
        "{}: it holds a mesh of tets, which the boundary's figures would be written over; name another file to be written, after \
         REST and IMAGE",
        shown_path(path)
    )]
    OverMesh { path: PathBuf },
}

/// `qcball picture`.
pub(super) fn picture(arguments: &PictureArguments) -> Result<Ending, Failure> {
    let [rest, image @ .., out] = arguments.files.as_slice() else { unreachable!("clap takes two files at least") };
    let image = image.first();
    refuse_to_write_over([rest, image.unwrap_or(rest)], [out])?;
    let ending = out.extension().map(|ending| ending.to_ascii_lowercase());
    let as_data = match ending.as_ref().and_then(|ending| ending.to_str()) {
        Some("png") => false,
        Some("vtu") => true,
        _ => return Err(PictureFailure::Ending { path: out.clone() }.into()),
    };
    for (option, given) in [("cut", !arguments.cut.is_empty()), ("colour", arguments.colour.is_some())] {
        if as_data && given {
            return Err(PictureFailure::Option { path: out.clone(), option }.into());
        }
    }
    // `picture REST IMAGE` lacks its OUT: the image may have no other copy. What a picture wrote before has no tets.
    if as_data && out.exists() && read_tets(out).is_ok_and(|soup| !soup.tets.is_empty()) {
        return Err(PictureFailure::OverMesh { path: out.clone() }.into());
    }
    let (mesh, image) = match image {
        Some(image) => {
            let map = read_map(rest, image)?;
            (map.domain.mesh().clone(), Some(map.image))
        }
        None => (read_mesh(rest)?, None),
    };
    let (cells, points) = ((&mesh).into(), mesh.points());
    let at = |error| PictureFailure::Picture { path: rest.clone(), error };
    if as_data {
        BoundaryFigures::of(cells, points, image.as_deref()).map_err(at)?.write(out)?;
    } else {
        let by_default = if image.is_some() { Colour::K } else { Colour::Domain };
        let settings = PictureSettings {
            colour: arguments.colour.unwrap_or(by_default),
            cuts: arguments.cut.clone(),
            view: arguments.view.into(),
        };
        Picture::draw(cells, points, image.as_deref(), &settings).map_err(at)?.write_png(out)?;
    }
    print(&format!("{}\n", shown_path(out)))
}

fn read_mesh(path: &Path) -> Result<TetMesh, Failure> {
    let soup = read_tets(path)?.tidied();
    tell(path, &soup.notes);
    let read = TetMesh::from_either_orientation(soup.points, soup.tets);
    let (mesh, _) =
        read.map_err(|error| ReadError::Malformed { path: path.into(), line: None, message: error.to_string() })?;
    Ok(mesh)
}

/// `x,y,z`, not all 0.
fn direction(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[x, y, z]) if [x, y, z].iter().all(|x: &f64| x.is_finite()) && [x, y, z] != [0.0; 3] => Ok([x, y, z]),
        _ => Err("give three numbers, not all 0, as in 1,-1,0.5".into()),
    }
}

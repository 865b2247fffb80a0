//! `qcball evaluate RESULT POINTS OUT`: the map of a results folder, or its inverse, at given points.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use rayon::prelude::*;

use super::inputs::{read_map, refuse_to_write_over};
use super::output::{note, print};
use super::{Ending, Failure};
use crate::map::{Evaluator, EvaluatorError, Located, Onto, bijectivity};
use crate::mesh::io::{DataArray, Values, check_points_can_be_written, read_points_under, read_tet_file, shown_path};
use crate::mesh::{Unit, Vec3};
use crate::report::read_corners;

/// The map, the points and what to do with them.
#[derive(Debug, Args)]
pub(crate) struct EvaluateArguments {
    /// The folder of a run, or another with a domain.vtu and an image.vtu.
    result: PathBuf,
    /// The points: a .csv file with columns x, y and z, or what this command wrote in the other direction, or the points of any mesh
    /// or surface file.
    points: PathBuf,
    /// The file for the points and their images: .csv or .vtu.
    out: PathBuf,
    /// What the map is taken onto.
    #[arg(long, value_name = "IMAGE", value_enum, default_value = "polyhedron")]
    onto: Target,
    /// The points are points of the image; find those of the domain that go there.
    #[arg(long)]
    inverse: bool,
}

/// The words for [`Onto`].
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Target {
    /// The image of the mesh, whose boundary is made of triangles.
    Polyhedron,
    /// The unit ball: each ray of the image is stretched to length 1.
    Ball,
}

/// Why nothing was evaluated.
#[derive(Debug, thiserror::Error)]
pub(crate) enum EvaluateFailure {
    #[error("{} has no domain.vtu and image.vtu; name the folder of a run", shown_path(folder))]
    NoMap { folder: PathBuf },
    #[error("{}: {message}; copy the folder as a whole, or run its config again", shown_path(folder))]
    Corners { folder: PathBuf, message: String },
    #[error("{}: {error}", shown_path(folder))]
    Map { folder: PathBuf, error: EvaluatorError },
}

/// `qcball evaluate`.
pub(super) fn evaluate(arguments: &EvaluateArguments) -> Result<Ending, Failure> {
    let EvaluateArguments { result: folder, points, out, onto, inverse } = arguments;
    check_points_can_be_written(out)?;
    let [domain, image] = ["domain.vtu", "image.vtu"].map(|name| folder.join(name));
    if !(domain.is_file() && image.is_file()) {
        return Err(EvaluateFailure::NoMap { folder: folder.clone() }.into());
    }
    refuse_to_write_over([&domain, &image, points], [out])?;
    // What one direction wrote is what the other reads.
    let table = read_points_under(points, if *inverse { "image_" } else { "domain_" })?;
    let map = read_map(&domain, &image)?;
    let onto = match onto {
        Target::Polyhedron => Onto::Polyhedron,
        Target::Ball => Onto::Ball,
    };
    let data = read_tet_file(&domain)?.cell_data;
    let corners = read_corners(folder, &map.domain, &data)
        .map_err(|message| EvaluateFailure::Corners { folder: folder.clone(), message })?;
    let evaluator = Evaluator::new(&map.domain, &map.image, onto)
        .map_err(|error| EvaluateFailure::Map { folder: folder.clone(), error })?;
    let evaluator = match &corners {
        Some(corners) => evaluator.with_corners(corners),
        None => evaluator,
    };
    if *inverse {
        let proved = bijectivity(&map.domain, &map.image);
        if !proved.bijective {
            note(&format!(
                "{}; of several points that go to one place, that in the tet of the lowest number is given",
                proved.reason
            ));
        }
    }
    let find = |point: &Vec3| match (point.iter().all(|x| x.is_finite()), inverse) {
        (false, _) => None,
        (true, true) => evaluator.inverse(point),
        (true, false) => evaluator.at(point),
    };
    // Lengths of the meshes are counted in units of their own; those of the ball are not.
    let of_image = if matches!(onto, Onto::Ball) { Unit::default() } else { map.units[1] };
    let [from, to] = if *inverse { [of_image, map.units[0]] } else { [map.units[0], of_image] };
    let found: Vec<Option<Located>> = from.take_points(&table.points).par_iter().map(find).collect();
    let found: Vec<Option<Located>> = found
        .into_iter()
        .map(|found| found.map(|found| Located { position: found.position.map(|x| to.give_back(x, 1)), ..found }))
        .collect();

    let inside: Vec<bool> = found.iter().map(Option::is_some).collect();
    let tets: Vec<f64> = found.iter().map(|found| found.map_or(-1.0, |found| found.tet.0.into())).collect();
    let nowhere = Vec3::repeat(f64::NAN);
    let positions: Vec<Vec3> = found.iter().map(|found| found.map_or(nowhere, |found| found.position)).collect();
    let (name, columns) = if *inverse {
        ("domain_position", ["domain_x", "domain_y", "domain_z"])
    } else {
        ("image_position", ["image_x", "image_y", "image_z"])
    };
    let number = |value: &dyn Fn(&Located) -> f64| found.iter().map(|found| found.as_ref().map(value)).collect();
    let columns: [(&str, Vec<Option<f64>>); 5] = [
        ("inside", inside.iter().map(|&inside| Some(f64::from(u8::from(inside)))).collect()),
        ("tet", number(&|found| found.tet.0.into())),
        (columns[0], number(&|found| found.position.x)),
        (columns[1], number(&|found| found.position.y)),
        (columns[2], number(&|found| found.position.z)),
    ];
    let data = [
        DataArray { name, values: Values::Vectors(&positions) },
        DataArray { name: "inside", values: Values::Flags(&inside) },
        DataArray { name: "tet", values: Values::Scalars(&tets) },
    ];
    table.write(out, &columns, &data)?;
    let outside = inside.iter().filter(|&&inside| !inside).count();
    print(&format!("{} points, {outside} of them outside; {}\n", inside.len(), shown_path(out)))
}

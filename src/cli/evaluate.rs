//! `qcball evaluate RESULT POINTS OUT`: the map of a results folder, or its inverse, at given points; `--refine`: as a map without
//! powers at the corners.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use rayon::prelude::*;

use super::inputs::{read_map, refuse_to_write_over};
use super::output::{note, print};
use super::{Ending, Failure};
use crate::dilatation::number;
use crate::domain::Domain;
use crate::experiment::GivenMap;
use crate::map::{Corners, Evaluator, EvaluatorError, Located, Onto, bijectivity};
use crate::measure::{measure, measure_elements};
use crate::mesh::io::{DataArray, Values, check_points_can_be_written, read_points_under, shown_path, write_vtu};
use crate::mesh::{MeshError, TopologyError, Unit, Vec3};
use crate::report::read_corners;
use crate::solid::MOST_TETS;

/// The map, the points and what to do with them.
#[derive(Debug, Args)]
#[command(allow_missing_positional = true)]
pub(crate) struct EvaluateArguments {
    /// The folder of a run, or another with a domain.vtu and an image.vtu.
    result: PathBuf,
    /// The points: a .csv file with columns x, y and z, or the points of any mesh or surface file. Of a .csv or .vtu file that has the
    /// image of each point, such as this command and a run write, --inverse takes these images; without it, where a file has the points
    /// that images come from, those are taken. With --refine, none.
    #[arg(required_unless_present = "refine")]
    points: Option<PathBuf>,
    /// The file for the points and their images: .csv or .vtu. With --refine, the folder for domain.vtu and image.vtu.
    out: PathBuf,
    /// What the map is taken onto.
    #[arg(long, value_name = "IMAGE", value_enum, default_value = "polyhedron")]
    onto: Target,
    /// The points are points of the image (columns image_x, image_y, image_z or the array image_position of what was written without
    /// --inverse); find those of the domain that go there.
    #[arg(long)]
    inverse: bool,
    /// Write the piecewise-linear map, for programs that know of no powers at corners, which agrees with the map at the vertices of a
    /// finer mesh: n^2 layers about each corner, n of them to each halving of the distance.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=16), conflicts_with_all = ["points", "onto", "inverse"])]
    refine: Option<u32>,
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
    #[error(
        "{}: the map is piecewise linear, and has no corners to refine it at; take its domain.vtu and image.vtu",
        shown_path(folder)
    )]
    NoCorners { folder: PathBuf },
    #[error("{}: cut in layers: {error}", shown_path(folder))]
    Topology { folder: PathBuf, error: TopologyError },
    #[error("{}: {error}; ask for less than --refine {n}", shown_path(folder))]
    Flat { folder: PathBuf, error: MeshError, n: u32 },
    #[error("{}: --refine {n} cuts its {tets} tets into more than {MOST_TETS}; ask for less", shown_path(folder))]
    TooLarge { folder: PathBuf, tets: usize, n: u32 },
}

/// `qcball evaluate`.
pub(super) fn evaluate(arguments: &EvaluateArguments) -> Result<Ending, Failure> {
    let EvaluateArguments { result: folder, points, out, onto, inverse, refine } = arguments;
    if refine.is_none() {
        check_points_can_be_written(out)?;
    }
    let [domain, image] = ["domain.vtu", "image.vtu"].map(|name| folder.join(name));
    if !(domain.is_file() && image.is_file()) {
        return Err(EvaluateFailure::NoMap { folder: folder.clone() }.into());
    }
    let refined = ["domain.vtu", "image.vtu"].map(|name| out.join(name));
    refuse_to_write_over([&domain, &image].into_iter().chain(points), refined.iter().chain([out]))?;
    // What one direction wrote is what the other reads.
    let table = points.as_ref().map(|points| read_points_under(points, if *inverse { "image_" } else { "domain_" }));
    let table = table.transpose()?;
    if let Some((points, (array, _))) = points.as_ref().zip(table.as_ref().and_then(|table| table.array.as_ref())) {
        note(&format!("{}: its array {array} is taken, not where its points lie", shown_path(points)));
    }
    let map = read_map(&domain, &image)?;
    let onto = match onto {
        Target::Polyhedron => Onto::Polyhedron,
        Target::Ball => Onto::Ball,
    };
    let corners = read_corners(folder, &map.domain, &map.cell_data)
        .map_err(|message| EvaluateFailure::Corners { folder: folder.clone(), message })?;
    let Some(table) = table else {
        return write_refined(folder, &map, corners.as_ref(), refine.unwrap_or(1), &refined);
    };
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

/// `--refine`: writes the piecewise-linear map, and says what K it has.
fn write_refined(
    folder: &Path,
    map: &GivenMap,
    corners: Option<&Corners>,
    n: u32,
    [domain, image]: &[PathBuf; 2],
) -> Result<Ending, Failure> {
    let folder = folder.to_path_buf();
    let Some(corners) = corners else { return Err(EvaluateFailure::NoCorners { folder }.into()) };
    // Each layer cuts a tet into at most four more.
    let warped = corners.of_tets().iter().flatten().count();
    let tets = map.domain.mesh().tets().len();
    if warped.saturating_mul(4 * (n * n) as usize) > MOST_TETS {
        return Err(EvaluateFailure::TooLarge { folder, tets, n }.into());
    }
    let linear = corners.piecewise_linear(&map.domain, &map.image, n).map_err(|error| EvaluateFailure::Flat {
        folder: folder.clone(),
        error,
        n,
    })?;
    let finer = Domain::any_topology(linear.mesh);
    let finer = finer.map_err(|error| EvaluateFailure::Topology { folder: folder.clone(), error })?;
    let measured = measure(&finer, &linear.image);
    let exact = measure_elements(&map.domain, &corners.elements(&map.domain), &map.image).summary.max_k;
    let tips: Vec<bool> = {
        let mut tips = vec![false; finer.mesh().points().len()];
        corners.exponents().iter().for_each(|(corner, _)| tips[corner.index()] = true);
        tips
    };
    let largest = |at_corners: bool| {
        let tets = finer.mesh().tets().iter().zip(&measured.dilatations);
        let of_them = tets.filter(|(tet, _)| tet.iter().any(|v| tips[v.index()]) == at_corners);
        of_them.map(|(_, dilatation)| dilatation.k()).fold(1.0, f64::max)
    };
    let points = map.units[0].give_back_points(finer.mesh().points());
    let images = map.units[1].give_back_points(&linear.image);
    let k: Vec<f64> = measured.dilatations.iter().map(|dilatation| dilatation.k()).collect();
    let owners: Vec<f64> = linear.owners.iter().map(|tet| tet.0.into()).collect();
    let cells = [
        DataArray { name: "K", values: Values::Scalars(&k) },
        DataArray { name: "tet", values: Values::Scalars(&owners) },
    ];
    for (path, at, name, other) in
        [(domain, &points, "image_position", &images), (image, &images, "domain_position", &points)]
    {
        let data = [DataArray { name, values: Values::Vectors(other) }];
        write_vtu(path, at, finer.mesh().tets(), &data, &cells)?;
    }
    print(&format!(
        "{} tets; K {} at the corners, where the map is linear, {} elsewhere; with powers there it is {}; {} and {}\n",
        k.len(),
        number(largest(true)),
        number(largest(false)),
        number(exact),
        shown_path(domain),
        shown_path(image)
    ))
}

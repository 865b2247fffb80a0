//! `qcball sphere SURFACE OUT`: a closed surface without handles mapped onto the unit sphere.

use std::path::PathBuf;

use clap::Args;

use super::inputs::refuse_to_write_over;
use super::output::{note, print};
use super::{Ending, Failure};
use crate::dilatation::number;
use crate::mesh::PolygonSoup;
use crate::mesh::io::{check_surface_can_be_written, read_surface, shown_path, write_surface};
use crate::report::to_json;
use crate::solid::{Surface, SurfaceError};
use crate::sphere::{SphereDistortion, SphereError, SphereSettings, sphere_map};

/// The two files and what counts.
#[derive(Debug, Args)]
pub(crate) struct SphereArguments {
    /// The surface: closed, connected, without handles.
    surface: PathBuf,
    /// The file for its image: the same triangles, every vertex on the unit sphere. The ending tells the format, .off or .obj.
    out: PathBuf,
    /// How much areas count beside angles, at least 0.
    #[arg(long, value_name = "WEIGHT", allow_negative_numbers = true, default_value_t = SphereSettings::default().area_weight)]
    area_weight: f64,
    /// How much it counts that parts shrink to nothing, at least 0.
    #[arg(long, value_name = "WEIGHT", allow_negative_numbers = true, default_value_t = SphereSettings::default().shrinkage_weight)]
    shrinkage_weight: f64,
    /// Print the figures as JSON.
    #[arg(long)]
    json: bool,
}

/// Why no map was written.
#[derive(Debug, thiserror::Error)]
pub(crate) enum SphereFailure {
    #[error("{}: {error}", shown_path(path))]
    Surface { path: PathBuf, error: SurfaceError },
    #[error("{}: {error}", shown_path(path))]
    Sphere { path: PathBuf, error: SphereError },
}

/// `qcball sphere`.
pub(super) fn sphere(arguments: &SphereArguments) -> Result<Ending, Failure> {
    let path = &arguments.surface;
    refuse_to_write_over([path], [&arguments.out])?;
    check_surface_can_be_written(&arguments.out)?;
    let soup = read_surface(path)?;
    soup.notes.iter().for_each(|text| note(text));
    let given = soup.points.len();
    let surface = Surface::from_soup(soup).map_err(|error| SphereFailure::Surface { path: path.clone(), error })?;
    let settings = SphereSettings { area_weight: arguments.area_weight, shrinkage_weight: arguments.shrinkage_weight };
    let map = sphere_map(&surface, &settings).map_err(|error| SphereFailure::Sphere { path: path.clone(), error })?;
    let distortion = SphereDistortion::of(&surface, map.positions());
    let polygons = surface.triangles().iter().map(|triangle| triangle.to_vec()).collect();
    write_surface(&arguments.out, &PolygonSoup::new(map.into_positions(), polygons))?;
    if surface.was_inside_out() {
        note("the surface was inside out; all its triangles were reversed");
    }
    if given > surface.points().len() {
        note(&format!("{} vertices that no triangle names were dropped", given - surface.points().len()));
    }
    if arguments.json {
        return print(&to_json(&distortion));
    }
    let SphereDistortion { max_stretch, mean_stretch, p99_stretch, log_area_deviation, least_area_ratio } = distortion;
    print(&format!(
        "{} vertices, {} triangles on the sphere, one-to-one and none flipped by exact predicate\n\
         stretch s1/s2  max {}, mean {}, 99 % {}\n\
         area ratio     standard deviation of its logarithm {log_area_deviation:.4}, least {least_area_ratio:.2e}\n",
        surface.points().len(),
        surface.triangles().len(),
        number(max_stretch),
        number(mean_stretch),
        number(p99_stretch),
    ))
}

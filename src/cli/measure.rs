//! `qcball measure REST IMAGE` and `qcball bounds REST IMAGE`: what can be said of any map that two mesh files give.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use serde::Serialize;

use super::inputs::{positive, read_map, refuse_to_write_over};
use super::interrupt::cancel_on_signal;
use super::output::{columns, note, print};
use super::{Ending, Failure};
use crate::bound::certificate::{self, DEFAULT_TIME_LIMIT};
use crate::bound::{self, LowerBound, confront};
use crate::dilatation::number;
use crate::estimate::{self, Estimate, EstimateSummary, Estimator, Weights};
use crate::experiment::{GivenMap, RunError};
use crate::measure::{BallDilatation, Summary, measure_onto_ball};
use crate::mesh::io::shown_path;
use crate::report::{
    BallFigures, BestBound, CONE, CORNERS, Limit, ball_lines, best_and_limit, bounds_list, dilatations, to_json,
    write_certificate,
};

/// The map, and whether to estimate as well.
#[derive(Debug, Args)]
pub(crate) struct MeasureArguments {
    #[command(flatten)]
    map: MapArguments,
    /// Also estimate K at the vertices and on the tets, as the paper does: no bound in either direction, unlike the exact K.
    #[arg(long, value_name = "NAME", value_enum)]
    estimator: Option<Estimator>,
    /// How much each tet at a vertex counts in the estimate.
    #[arg(long, value_name = "NAME", value_enum, default_value = "solid-angle", requires = "estimator")]
    weights: Weights,
}

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

/// The map and how hard to look for bounds.
#[derive(Debug, Args)]
pub(crate) struct BoundArguments {
    #[command(flatten)]
    map: MapArguments,
    /// Search for a Gram certificate too: stronger, and slower.
    #[arg(long)]
    certify: bool,
    /// Most seconds of that search.
    #[arg(long, value_name = "SECONDS", default_value_t = DEFAULT_TIME_LIMIT.as_secs_f64(), allow_negative_numbers = true, value_parser = positive, requires = "certify")]
    time_limit: f64,
    /// Write the certificate as JSON; anybody can check it against the two meshes.
    #[arg(long, value_name = "FILE", requires = "certify")]
    certificate: Option<PathBuf>,
}

/// What `bounds --json` prints.
#[derive(Serialize)]
struct BoundFigures {
    bounds: Vec<LowerBound>,
    #[serde(flatten)]
    best: BestBound,
    #[serde(flatten)]
    ball: BallFigures,
    limit: Limit,
    max_k: f64,
    ball_k: Option<BallDilatation>,
    #[serde(skip_serializing_if = "Option::is_none")]
    note: Option<String>,
}

/// What `measure --json` prints: the figures of the map, then the size of the mesh.
#[derive(Serialize)]
struct Figures<'a> {
    #[serde(flatten)]
    summary: &'a Summary,
    tets: usize,
    vertices: usize,
    locked: usize,
    ball_fraction: Option<f64>,
    ball_reason: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    estimated: Option<Estimated>,
    #[serde(skip_serializing_if = "Option::is_none")]
    note: Option<String>,
}

/// The estimates, if they were asked for.
#[derive(Serialize)]
struct Estimated {
    estimator: Estimator,
    weights: Weights,
    vertices: EstimateSummary,
    cells: EstimateSummary,
}

impl Estimated {
    fn of(map: &GivenMap, estimator: Estimator, weights: Weights) -> Self {
        let mesh = map.domain.mesh();
        let at_vertices = estimate::at_vertices(mesh.into(), mesh.points(), &map.image, estimator, weights);
        let at_vertices: Vec<Estimate> = at_vertices.into_iter().map(|(_, estimate)| estimate).collect();
        let on_cells = estimate::on_cells(mesh.into(), mesh.points(), &map.image, estimator);
        Self { estimator, weights, vertices: EstimateSummary::of(&at_vertices), cells: EstimateSummary::of(&on_cells) }
    }

    fn lines(&self) -> String {
        let line = |place: &str, summary: EstimateSummary| {
            format!(
                "estimate at {place:<9} max K {:>10}   mean K {:>10}\n",
                number(summary.max_k),
                number(summary.mean_k)
            )
        };
        line("vertices", self.vertices) + &line("tets", self.cells)
    }
}

/// What corners have that the meshes by themselves do not; said on standard error too.
fn note_of_powers(rest: &Path, map: &GivenMap) -> Option<String> {
    let beside = rest.with_file_name(CORNERS).is_file();
    let has_powers = beside || map.cell_data.iter().any(|(name, _)| name == CONE);
    let source = if beside { format!("the {CORNERS} beside it") } else { format!("its cell data {CONE:?}") };
    let text = has_powers.then(|| {
        format!(
            "{} has powers at corners, by {source}: these figures are of the piecewise-linear map without them; \
             those with them are in the report of its run, and `qcball verify` measures them anew",
            shown_path(rest)
        )
    });
    text.iter().for_each(|text| note(text));
    text
}

/// `qcball measure`.
pub(super) fn measure_map(arguments: &MeasureArguments) -> Result<Ending, Failure> {
    let map = read_map(&arguments.map.rest, &arguments.map.image)?;
    let note = note_of_powers(&arguments.map.rest, &map);
    let estimated = arguments.estimator.map(|estimator| Estimated::of(&map, estimator, arguments.weights));
    let GivenMap { domain, image, .. } = map;
    let measured = measure_onto_ball(&domain, &image);
    let ball = BallFigures::of(&domain, &image, &[], &measured.summary);
    let summary = &measured.summary;
    let (tets, vertices) = (domain.mesh().tets().len(), domain.mesh().points().len());
    let locked = domain.locked_tets().count();
    if arguments.map.json {
        return print(&to_json(&Figures {
            summary,
            tets,
            vertices,
            locked,
            ball_fraction: ball.ball_fraction,
            ball_reason: ball.ball_reason,
            estimated,
            note,
        }));
    }
    let mirrored = if summary.flipped == tets {
        "Every tet is flipped: the image is a mirror image. Negate one coordinate of it and measure again.\n"
    } else {
        ""
    };
    print(&format!(
        "{tets} tets ({locked} locked), {vertices} vertices\n{}{mirrored}{}{}",
        dilatations(columns(), &[("map", summary)]),
        ball_lines(columns(), &ball, None, summary),
        estimated.map_or_else(String::new, |estimated| estimated.lines())
    ))
}

/// `qcball bounds`.
///
/// Two meshes do not tell a star centre, so the bounds for radial boundary values are not among these.
pub(super) fn bound_map(arguments: &BoundArguments) -> Result<Ending, Failure> {
    let MapArguments { rest, image, json } = &arguments.map;
    if let Some(path) = &arguments.certificate {
        refuse_to_write_over([rest, image], [path])?;
    }
    let map = read_map(rest, image)?;
    let of_powers = note_of_powers(rest, &map);
    let GivenMap { domain, image, units: [unit, _], .. } = map;
    let cancel = cancel_on_signal();
    let summary = measure_onto_ball(&domain, &image).summary;
    let max_k = summary.max_k;
    let mut bounds = bound::all_until(&domain, &image, None, false, &cancel);
    let mut found = true;
    if arguments.certify {
        let certificate =
            certificate::search(&domain, &image, &cancel.within(Duration::from_secs_f64(arguments.time_limit)));
        let bound = certificate.as_ref().and_then(|found| certificate::bound(found, &domain, &image).ok());
        match (&certificate, &arguments.certificate) {
            (Some(certificate), Some(path)) => write_certificate(path, certificate)?,
            (None, _) => {
                found = false;
                note("no certificate was found: the map has flipped tets, or the time limit is too short");
            }
            (Some(_), None) => {}
        }
        bounds.extend(bound);
    }
    let files = format!("{} and {}", shown_path(rest), shown_path(&arguments.map.image));
    confront(&bounds, &domain, &image, &summary, &files).map_err(RunError::from)?;
    bounds.iter_mut().for_each(|bound| bound.place = bound.place.take().map(|place| unit.give_back_place(place)));
    let best = BestBound::of(&bounds, max_k);
    let limit = Limit::of(max_k, &bounds, None, false);
    let ball = BallFigures::of(&domain, &image, &bounds, &summary);
    if *json {
        print(&to_json(&BoundFigures { bounds, best, ball, limit, max_k, ball_k: summary.ball_k, note: of_powers }))?;
    } else {
        let columns = columns();
        let short = best_and_limit(columns, best, &limit) + &ball_lines(columns, &ball, None, &summary);
        print(&format!("{short}\n{}", bounds_list(columns, &bounds)))?;
    }
    Ok(match found {
        _ if cancel.is_raised() => Ending::Interrupted,
        true => Ending::Done,
        false => Ending::Unfulfilled,
    })
}

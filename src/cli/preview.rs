//! `qcball run --dry-run`: what would be solved.

use std::path::Path;

use super::Failure;
use crate::config::Plan;
use crate::dilatation::{number, upper_bound};
use crate::experiment::{self, RunError, Start, mirrors};
use crate::map::{CornerChoice, Corners};
use crate::mesh::io::shown_path;
use crate::optimize::BoundaryValues;
use crate::refine::RefineSettings;
use crate::sweep::memory_of;

/// The mesh and the map started from, what is to become of them, and the memory that is likely to be needed.
pub(super) fn preview(plan: &Plan, folder: &Path) -> Result<String, Failure> {
    let (start, k, mirrors) = experiment::on_threads(plan.threads.unwrap_or(0), || -> Result<_, RunError> {
        let start = Start::of(plan)?;
        let summary = start.measure(&start.image, &experiment::measuring_from_now(&plan.optimize)).summary;
        let mirrors = start.symmetric.then(|| mirrors(&start)).transpose().map_err(RunError::at(&start.origin))?;
        Ok((start, summary, mirrors))
    })??;
    let domain = &start.domain;
    let (vertices, tets) = (domain.mesh().points().len(), domain.mesh().tets().len());
    let boundary = domain.boundary().vertex_mask().iter().filter(|&&on| on).count();
    let mut text: String = start.warnings.iter().map(|warning| format!("warning     {warning}\n")).collect();
    text += &format!("run         {} ({})\nsolid       {}\n", plan.name, shown_path(plan.source.path()), start.origin);
    text += &format!("mesh        {vertices} vertices ({boundary} on the boundary), {tets} tets\n");
    text +=
        &format!("start       {}: max K {:.4}, mean {:.4}, {} flipped\n", start.map.map, k.max_k, k.mean_k, k.flipped);
    if let Some(ball) = k.ball_k {
        text += &format!("onto ball   K onto the ball of the start <= {}\n", upper_bound(ball.certified));
    }
    if plan.optimize.boundary_values == BoundaryValues::Sliding {
        text += "boundary    its vertices slide on the sphere\n";
    }
    text += &start.corners.as_ref().map(|corners| corners_in_words(corners, plan.corners)).unwrap_or_default();
    if let Some(mirrors) = mirrors {
        let (planes, in_chamber) = (mirrors.planes(), mirrors.tets().len());
        text += &format!("symmetric   {planes} mirror planes; {in_chamber} tets between them are solved for\n");
    }
    let added = plan.refine.map_or(0, |refine| refine.tets.of(tets));
    text += &plan.refine.map(|refine| refinement_in_words(refine, tets)).unwrap_or_default();
    let mebibytes = memory_of(tets.saturating_add(added)) >> 20;
    text += &match mebibytes {
        ..1024 => format!("memory      about {mebibytes} MiB\n"),
        _ => format!("memory      about {:.1} GiB\n", mebibytes as f64 / 1024.0),
    };
    Ok(text + &format!("results     would go to {}; nothing was written\n", shown_path(folder)))
}

fn corners_in_words(corners: &Corners, choice: CornerChoice) -> String {
    let exponents = corners.exponents();
    let (least, most) = exponents.iter().fold((f64::INFINITY, 0.0_f64), |(a, b), (_, p)| (a.min(*p), b.max(*p)));
    let of = if least == most { number(least) } else { format!("{} to {}", number(least), number(most)) };
    let sought = if choice == CornerChoice::Power {
        ", from which better ones are sought: the start above is with these, that of the run with those found"
    } else {
        ""
    };
    format!("corners     like r^p of the distance r from {} vertices, p = {of}{sought}\n", exponents.len())
}

fn refinement_in_words(RefineSettings { rounds, tets: budget, until, surface }: RefineSettings, tets: usize) -> String {
    let what = if surface {
        "at the surface too, for K onto the ball".to_string()
    } else {
        format!("until K is within {} % of what the boundary values allow", number(100.0 * until))
    };
    format!("refined     in {rounds} rounds at most, by {} tets at most, {what}\n", budget.of(tets),)
}

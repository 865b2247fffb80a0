//! The optimization of a run's map with warped cones, or between mirror planes.

use super::error::Fault;
use super::start::Start;
use crate::config::Plan;
use crate::map::{CornerChoice, Corners};
use crate::mesh::{BoundaryEdges, Features, Mirrors, TetId, Vec3, VertexId};
use crate::optimize::{Outcome, TraceRow, Untangled, Warped, untangle};

/// The mirror planes of a start's domain, about its star centre, that its image keeps.
pub(crate) fn mirrors(start: &Start) -> Result<Mirrors, Fault> {
    /// Of the radius, far above rounding.
    const NEAR: f64 = 1e-9;
    let (mesh, boundary) = (start.domain.mesh(), start.domain.boundary());
    let features = Features::of(mesh, boundary, &BoundaryEdges::of(mesh, boundary));
    let corners: Vec<Vec3> =
        (0..).zip(mesh.points()).filter(|(v, _)| features.is_corner(VertexId(*v))).map(|(_, point)| *point).collect();
    let kept = |mirrors: &Mirrors| {
        let again = mirrors.unfolded(&mirrors.folded(&start.image));
        let radius = start.image.iter().map(|p| p.norm()).fold(0.0, f64::max);
        again.iter().zip(&start.image).all(|(a, b)| (a - b).norm() <= NEAR * radius)
    };
    let found = start.centre.as_ref().and_then(|centre| Mirrors::of(mesh, &centre.position, &corners));
    found.filter(kept).ok_or(Fault::NoMirrors)
}

/// The tets of a chamber, where the maps of a start are to be symmetric and this one is but for rounding.
pub(super) fn chamber(start: &Start, image: &[Vec3]) -> Option<Vec<TetId>> {
    /// Of the size: half of what K onto the ball of a chamber allows for.
    const NEAR: f64 = 5e-13;
    let centre = start.centre.as_ref().filter(|_| start.symmetric)?.position;
    let mirrors = mirrors(start).ok()?;
    let offsets: Vec<Vec3> = start.domain.mesh().points().iter().map(|p| p - centre).collect();
    let is_symmetric = |positions: &[Vec3]| {
        let size = positions.iter().map(|p| p.norm()).fold(0.0, f64::max);
        let again = mirrors.unfolded(&mirrors.folded(positions));
        again.iter().zip(positions).all(|(a, b)| (a - b).norm() <= NEAR * size)
    };
    (is_symmetric(&offsets) && is_symmetric(image)).then(|| mirrors.tets().to_vec())
}

/// Optimizes the images of the vertices for the exponents that a start's corners have; if they are to be found, for those that a search ends
/// with. Without iterations none are sought. Gives the corners with the exponents arrived at.
pub(super) fn optimize_warped(
    start: &Start,
    plan: &Plan,
    observe: &mut dyn FnMut(&TraceRow),
) -> Result<(Untangled, Outcome, Option<Corners>), Fault> {
    let domain = &start.domain;
    let fixed = domain.boundary().vertex_mask();
    // One time limit for the search and what follows.
    let settings = &plan.optimize.starting_now();
    let mirrors = if plan.symmetric { Some(mirrors(start)?) } else { None };
    let untangled = untangle(domain, &start.image, fixed, settings, observe)?;
    let warped = Warped { domain, corners: None, mirrors: mirrors.as_ref(), onto_ball: plan.onto_ball };
    if !untangled.resisting.is_empty() {
        let outcome = Outcome::still_flipped(untangled.positions.clone(), settings);
        return Ok((untangled, outcome, start.corners.clone()));
    }
    let warped = Warped { corners: start.corners.as_ref(), ..warped };
    if start.corners.is_some() && plan.corners == CornerChoice::Power {
        let (outcome, corners) = warped.optimize_exponents(&untangled.positions, settings, observe)?;
        return Ok((untangled, outcome, Some(corners)));
    }
    let outcome = warped.optimize(&untangled.positions, settings, observe)?;
    Ok((untangled, outcome, start.corners.clone()))
}

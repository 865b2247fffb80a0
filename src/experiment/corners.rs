//! The corners of a run: which cones are warped, and with what exponents.

use std::collections::HashMap;
use std::f64::consts::TAU;

use super::error::Fault;
use super::start::Start;
use crate::config::Plan;
use crate::domain::Domain;
use crate::map::corner::solid_angles;
use crate::map::{Cone, CornerChoice, Corners};
use crate::measure::measure_elements;
use crate::mesh::{BoundaryEdges, Features, Mirrors, Vec3, VertexId};
use crate::optimize::{OptimizeSettings, Outcome, Polish, StopReason, TraceRow, Untangled, Warped, untangle};
use crate::solid::{Flag, FlagMesh};

/// The exponent of a corner of solid angle omega is (2 pi / omega)^s; with s = 1/2 the bound
/// K_I p^2 >= 2 pi / omega for maps that open it to a half-space says nothing more. Best are 0.2 to 0.3 with fixed boundary
/// values and 0.3 to 0.45 with others.
const LARGEST_POWER: f64 = 0.5;
/// The power started from, and that of a search which is over before it began.
const USUAL_POWER: f64 = 0.25;
/// Optimizations of the search for s: golden section leaves 0.045 of the largest, and K is flat there.
const TRIES: usize = 6;

/// The flags of a mesh, and how many tets each has.
#[derive(Clone, Debug)]
pub(crate) struct Flags {
    flags: Vec<Flag>,
    tets_a_flag: usize,
}

impl Flags {
    /// Those of a mesh.
    pub fn of(mesh: &FlagMesh) -> Self {
        Self { flags: mesh.flags.clone(), tets_a_flag: mesh.mesh.tets().len() / mesh.flags.len() }
    }
}

/// The warped cones that a plan asks for, at the corners of the solid; `None` where the map stays piecewise linear.
pub(super) fn corners(domain: &Domain, flags: Option<&Flags>, choice: CornerChoice) -> Result<Option<Corners>, Fault> {
    if choice == CornerChoice::Linear {
        return Ok(None);
    }
    let edges = BoundaryEdges::of(domain.mesh(), domain.boundary());
    let features = Features::of(domain.mesh(), domain.boundary(), &edges);
    let vertices: Vec<VertexId> =
        (0..domain.mesh().points().len() as u32).map(VertexId).filter(|&v| features.is_corner(v)).collect();
    if vertices.is_empty() {
        return Err(Fault::NoCorners);
    }
    let exponents: HashMap<VertexId, f64> = match choice {
        CornerChoice::Exponent(exponent) => vertices.iter().map(|&v| (v, exponent)).collect(),
        _ => by_power(domain, &vertices, USUAL_POWER),
    };
    Ok(Some(match flags {
        Some(Flags { flags, tets_a_flag }) => {
            let (mut cones, mut of_tet) = (Vec::new(), Vec::with_capacity(domain.mesh().tets().len()));
            for Flag { corner, base } in flags {
                let exponent = exponents.get(corner);
                of_tet.extend(std::iter::repeat_n(exponent.map(|_| cones.len() as u32), *tets_a_flag));
                cones.extend(exponent.map(|&exponent| Cone { corner: *corner, base: *base, exponent }));
            }
            Corners::new(domain, cones, of_tet)?
        }
        None => Corners::stars(domain, &vertices.iter().map(|&v| (v, exponents[&v])).collect::<Vec<_>>())?,
    }))
}

/// The exponents (2 pi / omega)^s.
fn by_power(domain: &Domain, vertices: &[VertexId], power: f64) -> HashMap<VertexId, f64> {
    let angles = solid_angles(domain, vertices);
    vertices.iter().zip(angles).map(|(&vertex, angle)| (vertex, (TAU / angle).powf(power))).collect()
}

/// The mirror planes of a start's domain, about its star centre, that its image keeps.
pub(super) fn mirrors(start: &Start) -> Result<Mirrors, Fault> {
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

/// Optimizes the images of the vertices for the exponents that a start's corners have; if they are to be found, for those of the
/// least largest K in a golden section over s. Gives the corners with the exponents arrived at.
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
        let stop = StopReason::of(&settings.cancel).unwrap_or(StopReason::StillFlipped);
        let outcome = Outcome { stop, ..Outcome::still_flipped(untangled.positions.clone()) };
        return Ok((untangled, outcome, start.corners.clone()));
    }
    let corners = match &start.corners {
        Some(corners) if plan.corners == CornerChoice::Power => {
            Some(scanned(Warped { onto_ball: false, ..warped }, &untangled.positions, corners, settings)?)
        }
        corners => corners.clone(),
    };
    let warped = Warped { corners: corners.as_ref(), ..warped };
    let outcome = warped.optimize(&untangled.positions, settings, observe)?;
    Ok((untangled, outcome, corners))
}

/// The corners with the best exponents that a golden section finds, by K onto the polyhedron: those for K onto the ball are about the
/// same.
fn scanned(
    warped: Warped<'_>,
    start: &[Vec3],
    corners: &Corners,
    settings: &OptimizeSettings,
) -> Result<Corners, Fault> {
    let domain = warped.domain;
    let vertices: Vec<VertexId> = corners.exponents().into_iter().map(|(vertex, _)| vertex).collect();
    let of_power = |power: f64| {
        let exponents = by_power(domain, &vertices, power);
        corners.clone().with_exponents(|vertex| exponents[&vertex])
    };
    let unpolished = OptimizeSettings { polish: Polish::None, ..settings.clone() };
    // Each try starts from the best map so far: any images of positive tets will do for any exponents.
    let (mut best, mut positions) = ((f64::INFINITY, USUAL_POWER), start.to_vec());
    let mut least_k = |power: f64| -> Result<f64, Fault> {
        if settings.cancel.is_due() {
            return Ok(f64::INFINITY);
        }
        let corners = of_power(power);
        let warped = Warped { corners: Some(&corners), ..warped };
        let outcome = warped.optimize(&positions, &unpolished, &mut |_| {})?;
        let k = measure_elements(domain, &corners.elements(domain), &outcome.positions).summary.max_k;
        if k < best.0 {
            (best, positions) = ((k, power), outcome.positions);
        }
        Ok(k)
    };
    let golden = (5f64.sqrt() - 1.0) / 2.0;
    let (mut low, mut high) = (0.0, LARGEST_POWER);
    let (mut inner, mut outer) = (high - golden * (high - low), low + golden * (high - low));
    let (mut at_inner, mut at_outer) = (least_k(inner)?, least_k(outer)?);
    for _ in 2..TRIES {
        if at_inner <= at_outer {
            (high, outer, at_outer) = (outer, inner, at_inner);
            inner = high - golden * (high - low);
            at_inner = least_k(inner)?;
        } else {
            (low, inner, at_inner) = (inner, outer, at_outer);
            outer = low + golden * (high - low);
            at_outer = least_k(outer)?;
        }
    }
    let (_, power) = best;
    Ok(of_power(power))
}

//! The largest dilatation settled region by region: few tets decide it, and only what they depend on is solved for.

use super::interior_point::{Goal, MOST_STEPS, Settled, interior_point_phase};
use super::recorder::{PhaseEnd, Recorder};
use super::region::{Region, changeable};
use super::{KktResidual, OPTIMAL, OptimizeSettings};
use crate::linalg::{Method, SparseError};
use crate::mesh::{TetId, Vec3};
use crate::objective::{Assembly, OpeningDerivatives, log_dilatations};

/// Share of the largest ln K above which a tet belongs to the region, from round to round, with the rings of tets about it.
const ROUNDS: [(f64, usize); 5] = [(0.8, 2), (0.7, 3), (0.6, 4), (0.5, 5), (0.0, 0)];

/// Distance in ln K within which tets are of one level.
const LEVEL: f64 = 1e-5;

/// How the minimax problem was left.
pub(super) enum Ending {
    /// As a phase ends, with the residual over all free vertices.
    Settled(PhaseEnd, Option<KktResidual>),
    /// The tets of large K are too many to be solved for at once, at first or after a part of them was.
    TooWide,
}

/// Minimises ln max K from `image`, on growing regions, until none of the active tets reaches beyond the region.
///
/// Where vertices slide, on all of the domain, with the sums that `direct` keeps.
pub(super) fn minimax<'d>(
    whole: &Assembly<'d>,
    direct: &mut Option<Assembly<'d>>,
    image: &mut [Vec3],
    settings: &OptimizeSettings,
    recorder: &mut Recorder<'_>,
) -> Result<Ending, SparseError> {
    let (tolerance, most) = (settings.tolerance, settings.effort.most_free());
    let free = whole.free().len();
    let (mut last, mut too_wide) = (None, false);
    // Sliding regions have no boundary whose triangles could be watched: they are taken whole.
    if whole.unknowns().slides() {
        if free > most {
            return Ok(Ending::TooWide);
        }
        let assembly = with_factor(whole, direct)?;
        let mut iterate = assembly.at(image.to_vec());
        let rim = vec![false; whole.domain().mesh().tets().len()];
        let settled = interior_point_phase(assembly, &mut iterate, Goal::Bound, tolerance, &rim, MOST_STEPS, recorder);
        image.copy_from_slice(iterate.image());
        let tets: Vec<TetId> = (0..rim.len() as u32).map(TetId).collect();
        recorder.multipliers = multipliers(&settled, &tets);
        let kkt = settled.bound.map(|bound| over_all(whole, image, bound, &settled, &tets));
        return Ok(Ending::Settled(settled.end, kkt.flatten()));
    }
    for (share, rings) in ROUNDS {
        let Some(region) = Region::of_large_dilatation(whole, image, share, rings, most) else {
            too_wide = true;
            break;
        };
        let mut assembly = Assembly::new(&region.domain, &region.unknowns, Method::Direct)?;
        if assembly.free().is_empty() {
            continue;
        }
        let mut part = assembly.at(region.restrict(image));
        recorder.part = Some(region.part.clone());
        let rim = region.rim(whole.unknowns());
        let settled =
            interior_point_phase(&mut assembly, &mut part, Goal::Bound, tolerance, &rim, MOST_STEPS, recorder);
        recorder.part = None;
        region.extend(part.image(), image);
        let kkt = settled.bound.map(|bound| over_all(whole, image, bound, &settled, &region.part.tets));
        let optimal = kkt.flatten().is_some_and(|kkt| kkt.largest() <= tolerance.max(OPTIMAL));
        last = Some((settled.end, kkt.flatten()));
        recorder.multipliers = multipliers(&settled, &region.part.tets);
        if settled.end == PhaseEnd::Interrupted || optimal || region.is_whole(free) {
            break;
        }
    }
    if too_wide {
        // The multipliers of a part that others would take further are of no use.
        recorder.multipliers.clear();
    }
    Ok(match last.filter(|_| !too_wide) {
        Some((end, kkt)) => Ending::Settled(end, kkt),
        None => Ending::TooWide,
    })
}

/// The sums over all of the domain whose systems are solved by a factor, made where there are none yet: its analysis takes as long as one or
/// two steps. They leave it to the interior-point method that no triangle opens beyond its least opening.
pub(super) fn with_factor<'a, 'd>(
    whole: &Assembly<'d>,
    direct: &'a mut Option<Assembly<'d>>,
) -> Result<&'a mut Assembly<'d>, SparseError> {
    if direct.is_none() {
        *direct = Some(Assembly::new(whole.domain(), whole.unknowns(), Method::Direct)?.leaving_openings());
    }
    Ok(direct.as_mut().expect("made where there were none"))
}

/// Settles the second largest value of K and so on, `levels` in all: the tets that attain one, to within [`LEVEL`], are
/// held while the largest K of the others is lowered.
pub(super) fn next_levels(
    whole: &Assembly<'_>,
    image: &mut [Vec3],
    levels: usize,
    settings: &OptimizeSettings,
    recorder: &mut Recorder<'_>,
) -> Result<PhaseEnd, SparseError> {
    let mut held = whole.unknowns().clone();
    for _ in 1..levels {
        // Only what is decomposed and which vertices move is asked of it.
        let part = Assembly::new(whole.domain(), &held, Method::Iterative)?;
        let Some(values) = changeable(&part, image) else { break };
        let threshold = values.iter().copied().fold(0.0, f64::max) - LEVEL;
        let tets = whole.domain().mesh().tets();
        for tet in tets.iter().zip(&values).filter(|(_, value)| **value >= threshold).map(|(tet, _)| tet) {
            tet.iter().for_each(|v| held.fix(v.index()));
        }
        if held.count() == 0 {
            break;
        }
        let part = Assembly::new(whole.domain(), &held, Method::Iterative)?;
        if let Ending::Settled(PhaseEnd::Interrupted, _) = minimax(&part, &mut None, image, settings, recorder)? {
            return Ok(PhaseEnd::Interrupted);
        }
    }
    Ok(PhaseEnd::Converged)
}

/// The multipliers of constraints, each with its tet of the whole mesh.
fn multipliers(settled: &Settled, tets: &[TetId]) -> Vec<(TetId, f64)> {
    settled.multipliers.iter().map(|&(tet, _, multiplier)| (tets[tet], multiplier)).collect()
}

/// The residual with respect to all free vertices and all tets, of the multipliers that a region was settled with.
fn over_all(
    whole: &Assembly<'_>,
    image: &[Vec3],
    bound: f64,
    settled: &Settled,
    tets: &[TetId],
) -> Option<KktResidual> {
    let domain = whole.domain();
    let mut gradient = vec![Vec3::zeros(); image.len()];
    let (mut scale, mut sum, mut complementarity) = (0.0, 0.0, 0.0);
    for &(tet, side, multiplier) in &settled.multipliers {
        let tet: TetId = tets[tet];
        let function = log_dilatations(domain, tet, image)?[side];
        for (g, v) in function.gradient.iter().zip(domain.mesh().tets()[tet.index()]) {
            if !whole.unknowns().is_fixed(v.index()) {
                gradient[v.index()] += g * multiplier;
                scale += multiplier * g.norm();
            }
        }
        sum += multiplier;
        complementarity += multiplier * (bound - function.value).abs();
    }
    let mut opened: f64 = 0.0;
    for &(triangle, multiplier) in &settled.openings {
        let triangle_of = domain.boundary().triangles()[triangle];
        let derivatives = OpeningDerivatives::of(triangle_of.each_ref().map(|v| &image[v.index()]));
        for (g, v) in derivatives.gradient.iter().zip(triangle_of) {
            gradient[v.index()] -= g * multiplier;
            scale += multiplier * g.norm();
        }
        let beyond = whole.unknowns().least_openings()[triangle] - derivatives.value;
        opened = opened.max(beyond);
        complementarity += multiplier * beyond.abs();
    }
    let largest = changeable(whole, image)?.into_iter().fold(0.0, f64::max);
    let unknowns = whole.unknowns();
    let tangent = |(v, g): (usize, &Vec3)| unknowns.tangent(v, &image[v], *g).norm_squared();
    let norm = gradient.iter().enumerate().map(tangent).sum::<f64>().sqrt();
    let dual = (norm / scale).max(f64::abs(1.0 - sum));
    Some(KktResidual { primal: (largest - bound).max(opened), dual, complementarity })
}

//! The stage between a start and its optimization: a map without flipped tets, or the tets that resist.

use super::{Shapes, Untangled, flipped_tets, refine_and_untangle, untangle, untangle_locally};
use crate::domain::Domain;
use crate::mesh::Vec3;
use crate::optimize::{
    BoundaryValues, OptimizeError, OptimizeSettings, Outcome, Polish, StopReason, TraceRow, optimize,
};

/// What a map without flipped tets is sought from.
#[derive(Clone, Debug)]
pub struct Tangled<'a> {
    /// The domain.
    pub domain: Domain,
    /// Image positions.
    pub start: Vec<Vec3>,
    /// Others with the same boundary, to begin again with where the first lead nowhere; tets of starts that have such differ in
    /// size by many orders, and are untangled vertex by vertex from the first.
    pub second: Option<Vec<Vec3>>,
    /// The vertices that stay; of the boundary, where this is `None`.
    pub fixed: Option<&'a [bool]>,
    /// Whether edges about the last tets that resist may be halved; never where `fixed` is given.
    pub may_refine: bool,
}

/// A domain and the map that it is optimized from.
#[derive(Clone, Debug)]
pub struct Freed {
    /// The domain, refined where tets resisted.
    pub domain: Domain,
    /// The start, on that domain.
    pub start: Vec<Vec3>,
    /// The map.
    pub untangled: Untangled,
    /// How many tets of the domain that was given the start flips.
    pub flipped_before: usize,
    /// How many edges were halved.
    pub refinement_splits: usize,
    /// Whether this is from the second start.
    pub is_second: bool,
}

impl Tangled<'_> {
    /// Frees a start of flipped tets if it has any, then optimizes; if some resist, the least flipped map is the outcome.
    ///
    /// All vertices are moved together by [`untangle()`], then one by one by [`untangle_locally`], then edges about the last few
    /// tets that resist are halved by [`refine_and_untangle`]; with a second start vertex by vertex at once, and where tets resist
    /// even then by [`Shapes::Thick`], and then from that one again.
    ///
    /// # Errors
    /// As [`untangle()`] and [`optimize()`].
    pub fn free_and_optimize(
        self,
        settings: &OptimizeSettings,
        observe: &mut dyn FnMut(&TraceRow),
    ) -> Result<(Freed, Outcome), OptimizeError> {
        let settings = &settings.starting_now();
        let fixed = self.fixed;
        let freed = self.free(settings, observe)?;
        let fixed = fixed.unwrap_or(freed.domain.boundary().vertex_mask());
        let outcome = optimize_untangled(&freed.domain, &freed.untangled, fixed, settings, observe)?;
        Ok((freed, outcome))
    }

    fn free(self, settings: &OptimizeSettings, observe: &mut dyn FnMut(&TraceRow)) -> Result<Freed, OptimizeError> {
        let mut best = self.attempt(&self.start, self.second.is_some(), settings, observe)?;
        if let Some(second) = &self.second
            && !best.untangled.resisting.is_empty()
            && !settings.cancel.is_due()
        {
            let mut other = self.attempt(second, true, settings, observe)?;
            other.untangled.iterations += best.untangled.iterations;
            other.untangled.seconds += best.untangled.seconds;
            if other.untangled.resisting.len() < best.untangled.resisting.len() {
                best = Attempt { is_second: true, ..other };
            }
        }
        let Attempt { refined, untangled, refinement_splits, is_second } = best;
        let start = if is_second { self.second.unwrap_or(self.start) } else { self.start };
        let flipped_before = flipped_tets(&self.domain, &start).len();
        let (domain, start) = refined.unwrap_or((self.domain, start));
        Ok(Freed { domain, start, untangled, flipped_before, refinement_splits, is_second })
    }

    fn attempt(
        &self,
        start: &[Vec3],
        locally: bool,
        settings: &OptimizeSettings,
        observe: &mut dyn FnMut(&TraceRow),
    ) -> Result<Attempt, OptimizeError> {
        let domain = &self.domain;
        let fixed = self.fixed.unwrap_or(domain.boundary().vertex_mask());
        let mut untangled = if locally {
            untangle_locally(domain, start, fixed, Shapes::Own, settings, observe)
        } else {
            untangle(domain, start, fixed, settings, observe)?
        };
        if !locally && !untangled.resisting.is_empty() && !settings.cancel.is_due() {
            let before = (untangled.iterations, untangled.seconds);
            untangled = untangle_locally(domain, &untangled.positions, fixed, Shapes::Own, settings, observe);
            untangled.iterations += before.0;
            untangled.seconds += before.1;
        }
        let mut attempt = Attempt { refined: None, untangled, refinement_splits: 0, is_second: false };
        if self.may_refine
            && self.fixed.is_none()
            && let Some(refined) = refine_and_untangle(domain, start, &attempt.untangled, settings, observe)
        {
            attempt.refinement_splits = refined.splits;
            attempt.refined = Some((refined.domain, refined.start));
            attempt.untangled = refined.untangled;
        }
        if locally && !attempt.untangled.resisting.is_empty() && !settings.cancel.is_due() {
            let mut thick = untangle_locally(domain, start, fixed, Shapes::Thick, settings, observe);
            thick.iterations += attempt.untangled.iterations;
            thick.seconds += attempt.untangled.seconds;
            if thick.resisting.len() < attempt.untangled.resisting.len() {
                attempt = Attempt { refined: None, untangled: thick, refinement_splits: 0, is_second: false };
            }
        }
        Ok(attempt)
    }
}

/// One way to a map without flipped tets; the refined domain and the start on it, if edges had to be halved.
struct Attempt {
    refined: Option<(Domain, Vec<Vec3>)>,
    untangled: Untangled,
    refinement_splits: usize,
    is_second: bool,
}

/// Frees a start of flipped tets if it has any, then optimizes; if some resist, the least flipped map is the outcome.
///
/// # Errors
/// As [`untangle()`] and [`optimize()`].
pub fn untangle_and_optimize(
    domain: &Domain,
    start: &[Vec3],
    fixed: &[bool],
    settings: &OptimizeSettings,
    observe: &mut dyn FnMut(&TraceRow),
) -> Result<(Untangled, Outcome), OptimizeError> {
    let settings = &settings.starting_now();
    let untangled = untangle(domain, start, fixed, settings, observe)?;
    let outcome = optimize_untangled(domain, &untangled, fixed, settings, observe)?;
    Ok((untangled, outcome))
}

/// Optimizes what was untangled, unless some tets resist. After flips a boundary slides only once all is optimized with its values fixed:
/// far from good, thin tets turn on the sphere by little at each step, and hundreds of steps lead nowhere. It takes a third of the
/// iterations at most.
fn optimize_untangled(
    domain: &Domain,
    untangled: &Untangled,
    fixed: &[bool],
    settings: &OptimizeSettings,
    observe: &mut dyn FnMut(&TraceRow),
) -> Result<Outcome, OptimizeError> {
    if !untangled.resisting.is_empty() {
        let stop = StopReason::of(&settings.cancel).unwrap_or(StopReason::StillFlipped);
        return Ok(Outcome { stop, ..Outcome::still_flipped(untangled.positions.clone()) });
    }
    if untangled.iterations == 0 || settings.boundary_values == BoundaryValues::Fixed {
        return optimize(domain, &untangled.positions, fixed, settings, observe);
    }
    let held = OptimizeSettings {
        boundary_values: BoundaryValues::Fixed,
        polish: Polish::None,
        max_iterations: settings.max_iterations / 3,
        ..settings.clone()
    };
    let first = optimize(domain, &untangled.positions, fixed, &held, observe)?;
    let done = first.trace.len();
    let max_iterations = settings.max_iterations.saturating_sub(done);
    if max_iterations == 0 || settings.cancel.is_due() {
        return Ok(first);
    }
    let seconds = first.trace.last().map_or(0.0, |row| row.seconds);
    // Row 0 of the second is the last map of the first once more.
    let in_sequence =
        |row: &TraceRow| TraceRow { iteration: done + row.iteration, seconds: seconds + row.seconds, ..row.clone() };
    let mut told = |row: &TraceRow| observe(&in_sequence(row));
    let settings = OptimizeSettings { max_iterations, ..settings.clone() };
    let second = optimize(domain, &first.positions, fixed, &settings, &mut told)?;
    let trace = first.trace.into_iter().chain(second.trace.iter().map(in_sequence)).collect();
    Ok(Outcome { trace, ..second })
}

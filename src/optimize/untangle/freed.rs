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
        if settings.max_iterations == 0 {
            // The start is wanted as it is: not the second one for having fewer flips, and on no other mesh.
            let untangled = Untangled::of_start(&self.domain, &self.start);
            let flipped_before = untangled.resisting.len();
            let Self { domain, start, .. } = self;
            return Ok(Freed { domain, start, untangled, flipped_before, refinement_splits: 0, is_second: false });
        }
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

/// [`Tangled::free_and_optimize`] from a start and, as long as tets resist, from others that may take its place, each made from the one tried
/// before it (`None`: not of that one). The start becomes the one that came to the fewest flipped tets, the first of equals.
///
/// # Errors
/// As [`Tangled::free_and_optimize`].
pub fn free_and_optimize_one_of<S: Clone>(
    start: &mut S,
    others: &[fn(&S) -> Option<S>],
    tangled: impl Fn(&S) -> Tangled<'static>,
    settings: &OptimizeSettings,
    observe: &mut dyn FnMut(&TraceRow),
) -> Result<(Freed, Outcome), OptimizeError> {
    let settings = &settings.starting_now();
    let (mut freed, mut outcome) = tangled(start).free_and_optimize(settings, observe)?;
    let mut last: Option<S> = None;
    for other in others {
        if outcome.stop != StopReason::StillFlipped {
            break;
        }
        let Some(next) = other(last.as_ref().unwrap_or(start)) else { continue };
        let (mut of_next, outcome_of_next) = tangled(&next).free_and_optimize(settings, observe)?;
        if of_next.untangled.resisting.len() < freed.untangled.resisting.len() {
            of_next.untangled.iterations += freed.untangled.iterations;
            of_next.untangled.seconds += freed.untangled.seconds;
            (*start, freed, outcome) = (next.clone(), of_next, outcome_of_next);
        }
        last = Some(next);
    }
    Ok((freed, outcome))
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
        return Ok(Outcome::still_flipped(untangled.positions.clone(), settings));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::fixtures::{cube, fan};

    /// The identity of a cube, and its mirror image, which nothing inside makes positive.
    fn tangled(mirrored: &bool) -> Tangled<'static> {
        let domain = Domain::new(fan(&cube(), Vec3::zeros())).unwrap();
        let sign = if *mirrored { -1.0 } else { 1.0 };
        let start = domain.mesh().points().iter().map(|p| Vec3::new(sign * p.x, p.y, p.z)).collect();
        Tangled { domain, start, second: None, fixed: None, may_refine: true }
    }

    fn freed(others: &[fn(&bool) -> Option<bool>], max_iterations: usize) -> (bool, Freed, Outcome) {
        let settings = OptimizeSettings { max_iterations, ..OptimizeSettings::default() };
        let mut start = true;
        let (freed, outcome) = free_and_optimize_one_of(&mut start, others, tangled, &settings, &mut |_| {}).unwrap();
        (start, freed, outcome)
    }

    #[test]
    fn another_start_takes_the_place_of_one_that_resists() {
        let none: fn(&bool) -> Option<bool> = |_| None;
        let (start, of_first, outcome) = freed(&[none], 100);
        assert!(start && outcome.stop == StopReason::StillFlipped);
        assert_eq!((of_first.flipped_before, of_first.untangled.resisting.len()), (12, 12));
        let (start, of_other, outcome) = freed(&[none, |mirrored| Some(!mirrored), |_| panic!("none resists")], 100);
        assert!(!start && outcome.stop == StopReason::Optimal && of_other.untangled.resisting.is_empty());
        assert_eq!(of_other.untangled.iterations, of_first.untangled.iterations);
        // One that is no better does not.
        let (start, ..) = freed(&[|mirrored| Some(*mirrored)], 100);
        assert!(start);
    }

    #[test]
    fn without_a_step_the_first_start_is_left_as_it_is() {
        let (start, freed, outcome) = freed(&[|_| panic!("no other is wanted")], 0);
        assert!(start && outcome.stop == StopReason::IterationLimit && outcome.positions == freed.start);
        assert_eq!((freed.flipped_before, freed.untangled.resisting.len(), freed.untangled.iterations), (12, 12, 0));
        // Nor does a second one of no flips count.
        let Tangled { start: identity, .. } = tangled(&false);
        let two = Tangled { second: Some(identity), ..tangled(&true) };
        let settings = OptimizeSettings { max_iterations: 0, ..OptimizeSettings::default() };
        let (freed, _) = two.clone().free_and_optimize(&settings, &mut |_| {}).unwrap();
        assert_eq!((freed.is_second, freed.flipped_before), (false, 12));
        let (freed, outcome) = two.free_and_optimize(&OptimizeSettings::default(), &mut |_| {}).unwrap();
        assert_eq!((freed.is_second, freed.flipped_before, outcome.stop), (true, 0, StopReason::Optimal));
    }
}

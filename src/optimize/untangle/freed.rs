//! The stage between a start and its optimization: a map without flipped tets, or the tets that resist.

use super::{Shapes, Untangled, refine_and_untangle, untangle, untangle_locally};
use crate::domain::Domain;
use crate::mesh::Vec3;
use crate::optimize::{OptimizeError, OptimizeSettings, Outcome, StopReason, TraceRow, optimize};

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
        let positions = &freed.untangled.positions;
        let outcome = if freed.untangled.resisting.is_empty() {
            optimize(&freed.domain, positions, fixed, settings, observe)?
        } else {
            let stop = StopReason::of(&settings.cancel).unwrap_or(StopReason::StillFlipped);
            Outcome { stop, ..Outcome::still_flipped(positions.clone()) }
        };
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
        let (domain, start) = match refined {
            Some(refined) => refined,
            None => (self.domain, if is_second { self.second.unwrap_or(self.start) } else { self.start }),
        };
        Ok(Freed { domain, start, untangled, refinement_splits, is_second })
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

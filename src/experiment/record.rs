//! The record of a run from what its stages gave: one way for a run and for whoever checks one.

use super::ACTIVE;
use super::start::Start;
use crate::bound::certificate::{self, Certificate};
use crate::bound::{self, LowerBound};
use crate::cancel::Cancel;
use crate::config::ConfigSource;
use crate::dilatation::lower_bound;
use crate::domain::Domain;
use crate::map::bijectivity;
use crate::measure::{Bottleneck, Measured, bottleneck};
use crate::mesh::{Place, Vec3};
use crate::optimize::{KktResidual, StopReason};
use crate::report::{Achieved, BestBound, DomainFigures, Limit, Report, Splits, Times, UntanglingFigures};

/// Under which name and from what a run was made.
pub(crate) struct Heading<'a> {
    pub name: &'a str,
    pub seed: u64,
    pub source: &'a ConfigSource,
}

/// How the optimization went, which its result does not tell.
pub(crate) struct Course {
    pub untangling: Option<UntanglingFigures>,
    pub stop: StopReason,
    pub kkt: Option<KktResidual>,
    pub iterations: usize,
    pub times: Times,
}

impl Course {
    /// What was achieved on this course; `bounds` of which the places are given back already.
    pub fn achieved(
        self,
        splits: Option<Splits>,
        (before, after): (&Measured, &Measured),
        bounds: Vec<LowerBound>,
    ) -> Achieved {
        Achieved {
            splits,
            initial: before.summary.clone(),
            untangling: self.untangling,
            last: after.summary.clone(),
            active: after.active(ACTIVE).len(),
            best: BestBound::of(&bounds, after.summary.max_k),
            limit: Limit::of(after.summary.max_k, &bounds, Some((self.stop, self.kkt))),
            bounds,
            stop: self.stop,
            kkt: self.kkt,
            iterations: self.iterations,
            times: self.times,
        }
    }
}

/// The bounds of a run, the certificate's last.
pub(crate) fn bounds(
    start: &Start,
    image: &[Vec3],
    certificate: Option<&Certificate>,
    cancel: &Cancel,
) -> Vec<LowerBound> {
    let (domain, centre) = (&start.domain, start.centre.map(|centre| centre.position));
    let mut bounds = bound::all_until(domain, image, centre, centre.is_some(), cancel);
    bounds.extend(certificate.and_then(|found| certificate::bound(found, domain, image).ok()));
    bounds
}

/// The record of a run that went from `start` to `image`; `before` and `after` are the two maps, measured.
pub(crate) fn record(
    heading: &Heading<'_>,
    start: &Start,
    image: &[Vec3],
    (before, after): (&Measured, &Measured),
    mut bounds: Vec<LowerBound>,
    course: Course,
    trace_hash: String,
) -> Report {
    let (domain, [unit, _]) = (&start.domain, start.units);
    let given_back = |place: Place| unit.give_back_place(place);
    bounds.iter_mut().for_each(|bound| bound.place = bound.place.take().map(given_back));
    let bottleneck = bottleneck(domain, after).map(|found| Bottleneck { place: given_back(found.place), ..found });
    let bijectivity = bijectivity(domain, image);
    let warnings = start.warnings.iter().cloned().chain(locked_warning(domain, &bounds)).collect();
    Report {
        name: heading.name.into(),
        version: Report::VERSION.into(),
        revision: Report::REVISION.into(),
        config: heading.source.path().display().to_string(),
        config_hash: heading.source.hash(),
        overrides: heading.source.overrides().map(String::from).collect(),
        seed: heading.seed,
        input_hash: start.input_hash.clone(),
        domain: DomainFigures::of(domain, start.origin.clone(), start.centre.as_ref()).given_back(unit),
        map: start.map.clone(),
        bijective: bijectivity.bijective,
        bijective_reason: bijectivity.reason,
        bottleneck,
        trace_hash,
        warnings,
        config_text: heading.source.text().to_string(),
        achieved: course.achieved(start.splits, (before, after), bounds),
    }
}

/// Names the tets that a kept mesh locks, and what they force.
fn locked_warning(domain: &Domain, bounds: &[LowerBound]) -> Option<String> {
    /// More of them would not be read.
    const NAMED: usize = 8;
    let locked: Vec<u32> = domain.locked_tets().map(|tet| tet.0).collect();
    let forced = bounds.iter().find(|bound| bound.name == "locked")?;
    let named: Vec<String> = locked.iter().take(NAMED).map(u32::to_string).collect();
    Some(format!(
        "{} tets are locked, all their vertices being on the boundary: {}{}; whatever the inside does, they force K >= {}",
        locked.len(),
        named.join(", "),
        if locked.len() > NAMED { ", ..." } else { "" },
        lower_bound(forced.value)
    ))
}

//! The record of a run from what its stages gave: one way for a run and for whoever checks one.

use super::ACTIVE;
use super::start::Start;
use crate::bound::certificate::{self, Certificate};
use crate::bound::{self, BoundName, LowerBound};
use crate::cancel::Cancel;
use crate::config::ConfigSource;
use crate::dilatation::lower_bound;
use crate::domain::Domain;
use crate::map::bijectivity;
use crate::measure::{Bottleneck, Measured, bottleneck};
use crate::mesh::{Place, Vec3, slivers};
use crate::optimize::{KktResidual, StopReason};
use crate::report::{
    Achieved, BallFigures, BestBound, CornerFigures, DistortionFigures, DomainFigures, Limit, RefinedFigures, Report,
    Splits, Times, UntanglingFigures,
};

/// Under which name and from what a run was made.
pub(crate) struct Heading<'a> {
    pub name: &'a str,
    pub seed: u64,
    pub source: &'a ConfigSource,
}

/// How the optimization went, which its result does not tell.
pub(crate) struct Course {
    pub untangling: Option<UntanglingFigures>,
    pub refined: Option<RefinedFigures>,
    pub stop: StopReason,
    pub kkt: Option<KktResidual>,
    pub tolerance: Option<f64>,
    pub iterations: usize,
    pub times: Times,
}

impl Course {
    /// What was achieved on this course; `bounds` of which the places are given back already; whether the boundary slid.
    pub fn achieved(
        self,
        splits: Option<Splits>,
        (before, after): (&Measured, &Measured),
        bounds: Vec<LowerBound>,
        ball: BallFigures,
        slid: bool,
    ) -> Achieved {
        Achieved {
            splits,
            initial: before.summary.clone(),
            untangling: self.untangling,
            refined: self.refined,
            last: after.summary.clone(),
            active: after.active(ACTIVE).len(),
            best: BestBound::of(&bounds, after.summary.max_k),
            limit: Limit::of(after.summary.max_k, &bounds, Some((self.stop, self.kkt)), slid),
            ball,
            bounds,
            stop: self.stop,
            kkt: self.kkt,
            tolerance: self.tolerance,
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
    // Where the boundary slid, its values are the radial ones no more.
    let stayed = boundary_stayed(start, image);
    let (mut bounds, proved) = match start.corners.as_ref().map(|corners| (corners, corners.elements(domain))) {
        None => {
            let bounds = bound::all_until(domain, image, centre, centre.is_some() && stayed, cancel);
            (bounds, certificate.map(|found| certificate::bound(found, domain, image)))
        }
        Some((corners, elements)) => {
            let bounds = bound::with_corners(domain, corners, &elements, image, cancel);
            (bounds, certificate.map(|found| bound::gram_with_corners(found, &elements, image)))
        }
    };
    bounds.extend(proved.and_then(Result::ok));
    bounds
}

fn boundary_stayed(start: &Start, image: &[Vec3]) -> bool {
    let on_boundary = start.domain.boundary().vertex_mask();
    (0..image.len()).all(|v| !on_boundary[v] || image[v] == start.image[v])
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
    let ball = BallFigures::of(domain, image, &bounds, &after.summary);
    // A start that was taken from files has them already.
    let mut warnings = start.warnings.clone();
    for warning in locked_warning(domain, &bounds).into_iter().chain(sliver_warning(start, after)) {
        if !warnings.contains(&warning) {
            warnings.push(warning);
        }
    }
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
        refinement: start.refinement,
        map: start.map.clone(),
        corners: start.corners.as_ref().map(|corners| CornerFigures::of(domain, corners, unit)),
        distortion: start.map.boundary_map.and_then(|_| DistortionFigures::of(domain, image, after)),
        bijective: bijectivity.bijective,
        bijective_reason: bijectivity.reason,
        bottleneck,
        trace_hash,
        warnings,
        config_text: heading.source.text().to_string(),
        achieved: course.achieved(start.splits, (before, after), bounds, ball, !boundary_stayed(start, image)),
    }
}

/// Tells of slivers where the largest K is one's, and what the others would give.
fn sliver_warning(start: &Start, after: &Measured) -> Option<String> {
    /// A thousandth of the regular tet's thickness.
    const THIN: f64 = 1e-4;
    let (mesh, unit) = (start.domain.mesh(), start.units[0]);
    let slivers = slivers(mesh, THIN);
    let thinnest = slivers.iter().min_by(|a, b| a.thickness.total_cmp(&b.thickness))?;
    let is_sliver = |t: usize| slivers.binary_search_by_key(&t, |sliver| sliver.tet.index()).is_ok();
    let largest = |of_slivers: bool| {
        let all = after.dilatations.iter().enumerate().filter(|(t, _)| is_sliver(*t) == of_slivers);
        all.map(|(_, dilatation)| dilatation.k()).fold(1.0, f64::max)
    };
    let (thin, others) = (largest(true), largest(false));
    if start.corners.is_some() || thin <= others {
        return None;
    }
    let [x, y, z] = unit.give_back_points(&[mesh.corners(thinnest.tet).iter().sum::<Vec3>() / 4.0])[0].into();
    let others =
        if slivers.len() == mesh.tets().len() { String::new() } else { format!(", of the others {others:.4}") };
    Some(format!(
        "{} of {} tets ({:.2} %) {}, of a volume below {THIN:e} of the cube of the longest edge, and the largest K is {}: \
         {thin:.4}{others}. The thinnest, {:.1e}, is tet {} at ({x:.6}, {y:.6}, {z:.6}); remesh the solid \
         without them",
        slivers.len(),
        mesh.tets().len(),
        100.0 * slivers.len() as f64 / mesh.tets().len() as f64,
        if slivers.len() == 1 { "is a sliver" } else { "are slivers" },
        if slivers.len() == 1 { "its" } else { "one's" },
        thinnest.thickness,
        thinnest.tet.0,
    ))
}

/// Names the tets that a kept mesh locks, and what they force.
fn locked_warning(domain: &Domain, bounds: &[LowerBound]) -> Option<String> {
    /// More of them would not be read.
    const NAMED: usize = 8;
    let locked: Vec<u32> = domain.locked_tets().map(|tet| tet.0).collect();
    let forced = bounds.iter().find(|bound| bound.name == BoundName::Locked)?;
    let named: Vec<String> = locked.iter().take(NAMED).map(u32::to_string).collect();
    Some(format!(
        "{}: {}{}; whatever the inside does, this forces K >= {}",
        match locked.len() {
            1 => "1 tet is locked, all its vertices being on the boundary".into(),
            count => format!("{count} tets are locked, all their vertices being on the boundary"),
        },
        named.join(", "),
        if locked.len() > NAMED { ", ..." } else { "" },
        lower_bound(forced.value)
    ))
}

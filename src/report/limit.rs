//! What keeps the largest K from being smaller, as far as that is proved, in one sentence.

use serde::{Deserialize, Serialize};

use crate::bound::{BoundName, LowerBound, Scope, best_applicable};
use crate::dilatation::{lower_bound, rounded_up};
use crate::mesh::Place;
use crate::optimize::{KktResidual, StopReason};

/// Gap - 1 up to which a map counts as the best there is: the accuracy of the bounds and of the optimizer.
const OPTIMAL: f64 = 1e-6;
/// Gap - 1 up to which the difference is told in per cent rather than explained; the polish alone may spend 2e-4.
const NEARLY: f64 = 1e-3;
/// Factor within which two values count as close.
const CLOSE: f64 = 1.1;
/// KKT residual above which the optimizer has not settled: it is relative, and 1e-6 counts as stationary.
const UNSETTLED: f64 = 1e-3;

/// What limits K.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LimitedBy {
    /// Nothing can be gained: the map attains the best bound.
    ProvedOptimal,
    /// The boundary values: a bound for them comes close to K, and finer meshes would not lower it much.
    BoundaryValues,
    /// The mesh: a bound for this mesh comes close to K, but for the solid with these boundary values it is much lower, or not
    /// known.
    Mesh,
    /// The optimizer, which had not settled when it ended.
    Optimizer,
    /// Not known: K is far from every bound, and no boundary is fixed or the map is stationary.
    Unknown,
}

/// What limits K, for programs and for people.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Limit {
    /// Which of the cases it is.
    pub by: LimitedBy,
    /// The case in one sentence, with its evidence.
    pub sentence: String,
}

impl Limit {
    /// Judges a map whose largest K is `max_k` by its bounds and, if it was optimized, by how that ended and whether its boundary slid:
    /// the bounds then speak of where it slid to, and of no other map onto the sphere.
    pub fn of(
        max_k: f64,
        bounds: &[LowerBound],
        ending: Option<(StopReason, Option<KktResidual>)>,
        slid: bool,
    ) -> Self {
        let say = |by, sentence: String| Self { by, sentence };
        if !max_k.is_finite() {
            return say(
                LimitedBy::Unknown,
                "tets are flipped, so K is infinite and nothing can be said of its limit".into(),
            );
        }
        if bounds.is_empty() {
            let why = match ending {
                Some((StopReason::Cancelled, _)) => "the run was interrupted before bounds were computed",
                _ => "no bound was computed",
            };
            return say(LimitedBy::Unknown, format!("{why}, so what limits K is not known"));
        }
        let Some(best) = best_applicable(bounds) else {
            return say(LimitedBy::Unknown, "no bound applies to this map, so what limits K is not known".into());
        };
        let gap = max_k / best.value;
        let source = match &best.place {
            Some(place) => format!("the bound \"{}\" at {}", best.name, place_in_words(place)),
            None => format!("the bound \"{}\"", best.name),
        };
        let powers = best.scope == Scope::MeshFixedPowers;
        let with = if powers { "these powers at the corners and " } else { "" };
        let optimal = match (powers, slid) {
            (true, _) => "the map is proved optimal for its powers at the corners and its boundary values",
            (false, true) => "the map is proved optimal for its boundary values",
            (false, false) => "the map is proved globally optimal",
        };
        let values = if slid { "the values that the boundary slid to limit" } else { "the boundary values limit" };
        let boundary = if slid { "the boundary values that it slid to" } else { "this boundary" };
        let maps = format!("map of this mesh with {with}{boundary}");
        if gap <= 1.0 + OPTIMAL {
            let sentence = format!("{optimal}: by {source} no {maps} has a smaller largest K");
            return say(LimitedBy::ProvedOptimal, sentence);
        }
        if gap <= 1.0 + NEARLY {
            let sentence = format!(
                "{optimal} up to {} %: by {source} no {maps} has a largest K below {}",
                rounded_up(100.0 * (1.0 - 1.0 / gap), 4),
                lower_bound(best.value)
            );
            return say(LimitedBy::ProvedOptimal, sentence);
        }
        let room = rounded_up(100.0 * (1.0 - 1.0 / gap), 1);
        if gap <= CLOSE {
            // What the surface and its values alone prove holds on every mesh inside.
            let of_boundary = matches!(best.name, BoundName::Trace | BoundName::EdgeRatio | BoundName::Vertex);
            let others = if powers { ", and so may other powers" } else { "" };
            return match limit_of_fine_meshes(bounds) {
                Some(fine) if fine * CLOSE < best.value => say(
                    LimitedBy::Mesh,
                    format!(
                        "the mesh limits K: by {source} no {maps} can gain more than {room} %, while finer meshes are bound \
                         by {} only, so refining there may help",
                        lower_bound(fine)
                    ),
                ),
                None if !of_boundary => say(
                    LimitedBy::Mesh,
                    format!(
                        "this mesh limits K: by {source} no {maps} can gain more than {room} %, but one of a mesh refined \
                         there may{others}"
                    ),
                ),
                _ => say(
                    LimitedBy::BoundaryValues,
                    format!("{with}{values} K: by {source} no {maps} can gain more than {room} %"),
                ),
            };
        }
        match ending.and_then(unsettled) {
            Some(how) => say(
                LimitedBy::Optimizer,
                format!("the optimizer may limit K: {how}, and {source} leaves room for up to {room} %"),
            ),
            None => say(
                LimitedBy::Unknown,
                format!(
                    "what limits K is not proved: {source} leaves room for up to {room} %, which another local optimum may \
                     use or a stronger bound may close"
                ),
            ),
        }
    }
}

/// The largest bound known for fine meshes with these boundary values; none without such bounds.
fn limit_of_fine_meshes(bounds: &[LowerBound]) -> Option<f64> {
    bounds.iter().filter(|bound| bound.scope == Scope::ShapeFixedTrace).map(|bound| bound.value).reduce(f64::max)
}

/// How an optimization ended before it settled; nothing if it did settle, or nothing is known against it.
fn unsettled((stop, kkt): (StopReason, Option<KktResidual>)) -> Option<String> {
    let residual = kkt.map(|kkt| kkt.largest());
    match stop {
        StopReason::IterationLimit => Some("it reached its iteration limit".into()),
        StopReason::TimeLimit => Some("it reached its time limit".into()),
        StopReason::Cancelled => Some("it was interrupted".into()),
        StopReason::StillFlipped => Some("it could not begin".into()),
        _ => residual
            .filter(|&r| r > UNSETTLED)
            .map(|r| format!("its steps became too small before K was stationary (its KKT residual is {r:.0e})")),
    }
}

fn place_in_words(place: &Place) -> String {
    match place {
        Place::Vertex { vertex, .. } => format!("vertex {vertex}"),
        Place::Edge { vertices: [a, b], .. } => format!("the edge {a}-{b}"),
        Place::Face { vertices: [a, b, c], .. } => format!("the triangle {a}-{b}-{c}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bound::Kind;

    fn bound(scope: Scope, value: f64) -> LowerBound {
        let applies = scope == Scope::MeshFixedBoundary;
        LowerBound {
            name: BoundName::Apex,
            source: "a test",
            kind: Kind::K,
            value,
            scope,
            certified: true,
            applies,
            reason: String::new(),
            place: Some(Place::Vertex { vertex: 7, position: [0.0; 3] }),
        }
    }

    #[test]
    fn each_case_is_told_by_its_evidence() {
        use LimitedBy::{BoundaryValues, Mesh, Optimizer, ProvedOptimal, Unknown};
        let mesh = |value| bound(Scope::MeshFixedBoundary, value);
        let smooth = |value| bound(Scope::ShapeFixedTrace, value);
        let kkt = |dual| Some(KktResidual { primal: 0.0, dual, complementarity: 0.0 });
        let settled = Some((StopReason::Optimal, kkt(1e-7)));
        let crawling = Some((StopReason::Converged, kkt(0.1)));
        let limited = Some((StopReason::IterationLimit, None));
        let interrupted = Some((StopReason::Cancelled, None));
        let cases = [
            (
                4.0,
                vec![mesh(4.0)],
                settled,
                ProvedOptimal,
                "proved globally optimal: by the bound \"apex\" at vertex 7",
            ),
            (4.0 * (1.0 + 0.9e-6), vec![mesh(4.0)], limited, ProvedOptimal, "proved globally optimal: by"),
            (4.0 * 1.0002, vec![mesh(4.0)], settled, ProvedOptimal, "proved globally optimal up to 0.0200 %"),
            // Bounds are rounded down, the room, here 0.2494 %, up.
            (4.0, vec![mesh(3.99999)], settled, ProvedOptimal, "has a largest K below 3.9999"),
            (4.01, vec![mesh(4.0)], settled, Mesh, "more than 0.3 %"),
            (4.2, vec![mesh(4.0)], settled, Mesh, "this mesh limits K"),
            (
                4.2,
                vec![LowerBound { name: BoundName::Trace, ..mesh(4.0) }],
                settled,
                BoundaryValues,
                "the boundary values limit K",
            ),
            (4.2, vec![mesh(4.0), smooth(3.9)], settled, BoundaryValues, "more than 4.8 %"),
            (4.2, vec![mesh(4.0), smooth(3.0)], settled, Mesh, "finer meshes are bound by 3.0000 only"),
            (8.0, vec![mesh(4.0), smooth(3.0)], crawling, Optimizer, "its KKT residual is 1e-1"),
            (8.0, vec![mesh(4.0)], limited, Optimizer, "it reached its iteration limit"),
            (8.0, vec![mesh(4.0)], interrupted, Optimizer, "it was interrupted"),
            (8.0, vec![mesh(4.0)], settled, Unknown, "not proved"),
            (8.0, vec![mesh(4.0)], None, Unknown, "50.0 %"),
            (8.0, vec![smooth(4.0)], settled, Unknown, "no bound applies"),
            (8.0, vec![], interrupted, Unknown, "was interrupted before bounds were computed"),
            (8.0, vec![], settled, Unknown, "no bound was computed"),
            (f64::INFINITY, vec![mesh(4.0)], None, Unknown, "flipped"),
        ];
        for (max_k, bounds, ending, by, words) in cases {
            let limit = Limit::of(max_k, &bounds, ending, false);
            assert!(limit.by == by && limit.sentence.contains(words), "{max_k}: {limit:?}");
        }
        // Another map onto the sphere is not spoken of.
        let limit = Limit::of(4.0, &[mesh(4.0)], settled, true);
        assert!(limit.by == ProvedOptimal && limit.sentence.contains("boundary values that it slid to"), "{limit:?}");
        // Nor are other exponents.
        let powers = [LowerBound { applies: true, ..bound(Scope::MeshFixedPowers, 4.0) }];
        for (max_k, words) in [
            (
                4.0,
                "optimal for its powers at the corners and its boundary values: by the bound \"apex\" at vertex 7 no map of this mesh with these powers",
            ),
            (4.2, "but one of a mesh refined there may, and so may other powers"),
        ] {
            let limit = Limit::of(max_k, &powers, settled, false);
            assert!(limit.sentence.contains(words), "{limit:?}");
        }
    }
}

//! What a summary says of the bounds, of what limits K, and of the ball.

use super::words::{TABLE, labelled, percent};
use super::{Achieved, BallFigures, BestBound, Limit};
use crate::bound::{Kind, LowerBound, Scope};
use crate::dilatation::{lower_bound, upper_bound};
use crate::measure::{BallDilatation, Summary};

/// The share of the ball from which on an image passes for one.
const FULL: f64 = 0.9;
/// K onto the ball over K beyond which the image is too coarse somewhere for K to say much of a map onto the ball; surfaces that are refined
/// by themselves end at 1.25 or little more.
const COARSE: f64 = 3.0;

/// What is said of a K onto the ball whose search was ended.
pub(crate) const CUT_SHORT: &str = "; the time limit ended the search for it, so that this bound is coarse";

/// What goes before all else where the image is far from a ball.
pub(super) fn coarse_warning(columns: usize, ball: &BallFigures, last: &Summary) -> String {
    let is_coarse =
        |(fraction, k): &(f64, BallDilatation)| *fraction < FULL || (!k.cut_short && k.certified > COARSE * last.max_k);
    let Some((fraction, k)) = ball.ball_fraction.zip(last.ball_k).filter(is_coarse) else {
        return String::new();
    };
    let text = format!(
        "the image is a polyhedron that fills {} of the ball: K speaks of the map onto this polyhedron, K onto the ball is at \
         most {}; a finer surface comes nearer",
        percent(fraction),
        upper_bound(k.certified)
    );
    labelled(columns, "warning", &text)
}

/// K onto the ball, and what is known of the least K of all maps of the solid onto the ball.
pub(crate) fn ball_lines(columns: usize, ball: &BallFigures, start: Option<&Summary>, last: &Summary) -> String {
    let Some((fraction, k)) = ball.ball_fraction.zip(last.ball_k) else {
        let reason = ball.ball_reason.as_deref().unwrap_or("it was not computed");
        return labelled(columns, "onto ball", &format!("no K onto the ball: {reason}"));
    };
    let start = start.and_then(|start| start.ball_k);
    let start = start.map(|k| format!(" (start {})", upper_bound(k.certified))).unwrap_or_default();
    let text = format!(
        "K onto the ball <= {}{start}, of the map followed by the radial map of its image, which fills {} of the ball{}",
        upper_bound(k.certified),
        percent(fraction),
        if k.cut_short { CUT_SHORT } else { "" }
    );
    let bracket = ball.ball_bound.zip(ball.ball_gap).map(|(bound, gap)| {
        let text = format!(
            "{} <= K <= {} for the best quasi-conformal map of the solid onto the ball, a factor of {}",
            lower_bound(bound),
            upper_bound(k.certified),
            upper_bound(gap)
        );
        labelled(columns, "bracket", &text)
    });
    labelled(columns, "onto ball", &text) + &bracket.unwrap_or_default()
}

/// The bounds of a run, with those that do not apply counted only, if any does.
pub(super) fn bounds_in_short(columns: usize, achieved: &Achieved) -> String {
    let (applying, others): (Vec<LowerBound>, Vec<LowerBound>) =
        achieved.bounds.iter().cloned().partition(|bound| bound.applies);
    if applying.is_empty() || others.is_empty() {
        return bounds_list(columns, &achieved.bounds);
    }
    let count = others.len();
    let does = if count == 1 { "does" } else { "do" };
    let others = format!("{count} more {does} not apply to this map; report.json tells why");
    bounds_list(columns, &applying) + &labelled(columns, "", &others)
}

/// What limits K, and what the best of the bounds says.
pub(crate) fn best_and_limit(columns: usize, best: BestBound, limit: &Limit) -> String {
    labelled(columns, "limit", &limit.sentence) + &labelled(columns, "best bound", &best_in_words(best))
}

/// The bounds, if there are any, those that apply and the largest first; in two lines each where there is no room for one.
pub(crate) fn bounds_list(columns: usize, bounds: &[LowerBound]) -> String {
    if bounds.is_empty() {
        return String::new();
    }
    let mut bounds: Vec<&LowerBound> = bounds.iter().collect();
    bounds.sort_by(|a, b| b.applies.cmp(&a.applies).then(b.value.total_cmp(&a.value)));
    let is_narrow = columns < TABLE;
    let [gap, heads] = match is_narrow {
        true => ["\n  ", "\n  for which maps, applies"],
        false => ["  ", "  for which maps      applies"],
    };
    let mut text = format!("{:<18}{:>16}{heads}\n", "lower bound", "value");
    for bound in bounds {
        let kind = match bound.kind {
            Kind::Inner => "K_I >=",
            Kind::Outer => "K_O >=",
            Kind::K => "K >=",
        };
        let applies = if bound.applies { "yes" } else { "no" };
        let quoted = if bound.certified { "" } else { ", not proved" };
        let scope = scope_in_short(bound.scope);
        let scope = if is_narrow { format!("{scope}, ") } else { format!("{scope:<20}") };
        text.push_str(&format!(
            "{:<18}{kind:>6}{:>10}{gap}{scope}{applies}{quoted}\n",
            bound.name,
            lower_bound(bound.value)
        ));
        if !bound.applies {
            text.push_str(&labelled(columns, "", &bound.reason));
        }
    }
    text
}

fn best_in_words(best: BestBound) -> String {
    match (best.best_bound, best.gap) {
        (Some(bound), Some(gap)) => {
            format!("K >= {}; the map is within a factor of {} of it", lower_bound(bound), upper_bound(gap))
        }
        (Some(bound), None) => format!("K >= {}; the map has no finite K to compare", lower_bound(bound)),
        (None, _) => "none is known that applies to this map, and so no gap".into(),
    }
}

fn scope_in_short(scope: Scope) -> &'static str {
    match scope {
        Scope::Shape => "all of the solid",
        Scope::ShapeFixedTrace => "with radial trace",
        Scope::MeshFixedBoundary => "PL on this mesh",
        Scope::MeshFixedPowers => "with these powers",
    }
}

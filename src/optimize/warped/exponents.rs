//! The exponents of corners that make the largest K small.
//!
//! The least largest K for given exponents, V, has by the envelope theorem the derivative sum of multiplier times d ln K / d ln p in the
//! logarithm of a corner's exponent, over the elements of its cones. Corners hardly see each other: with a share w of the multipliers in
//! the cones of a corner, V is there about w times a function of its own exponent, whose slope, the sum divided by w, is led to 0
//! for each corner by a secant method of its own, from the best exponents so far and with steps that halve where they do not lower K.
//!
//! That finds a local minimum, and where p = 1 there is no slope: V has a kink there, at which the elements of a tet are one. So the search
//! first tries exponents on the line from 1 to those it is given. Where a few large triangles hold K, V jumps with the exponents from
//! one local optimum of the map to another; on such small meshes common exponents are tried too, each from the start.

use std::collections::BTreeMap;

use super::{Warped, went_to_its_end};
use crate::dilatation::Dilatation;
use crate::map::Corners;
use crate::measure::measure;
use crate::mesh::{TetId, Vec3, VertexId};
use crate::optimize::{OptimizeError, OptimizeSettings, Outcome, Polish, Start, TraceRow};

/// Powers of the given exponents that are tried first.
const ALONG: [f64; 3] = [1.0, 0.5, 0.0];
/// The same where none are better than those: from 1 on either side of its kink.
const FROM_LINEAR: [f64; 2] = [0.2, 0.07];
/// Exponents tried at all corners alike reach from 1 to the first entry, evenly in their logarithms: as many as make up one optimization of a mesh
/// of so many tets, at most so many. Without, the search ended up to 1.7 times above the best of six exponents on 48 meshes of 32 to 64 tets in random
/// tetrahedra, sliding; from 100 tets on it did not.
const COMMON: (f64, usize, usize) = (1.8, 1500, 10);
/// Exponents tried at all corners alike where K onto the ball is what counts: of coarse meshes it takes them where that onto the polyhedron does not.
const COMMON_ONTO_BALL: [f64; 2] = [1.1, 1.25];
/// Rounds in which K onto the ball is lowered with exponents that are tried, where it is what counts. That of the map onto the polyhedron tells little.
const ROUNDS: usize = 8;
/// Most steps of the secant method.
const STEPS: usize = 5;
/// Fall of ln K below which there is no other: K is flat at the best exponents.
const GAIN: f64 = 2e-4;
/// Second derivative of ln K in ln p to begin with, and between which it is believed; 1.5 to 3 at corners of cubes and tetrahedra, far more
/// across a kink, behind which K rises.
const CURVATURE: [f64; 4] = [0.7, 2.0, 8.0, 50.0];
/// The largest change of ln p at a time.
const LARGEST: f64 = 0.3;
/// Share of the multipliers below which a corner does not tell what it needs.
const LEAST_SHARE: f64 = 0.02;
/// Half the change of ln p over which ln K is differentiated; the next term is its square times a third derivative of order 1.
const STEP: f64 = 1e-4;
/// How far above the least K of the search an optimization from the start may end, in ln K, for its map to be kept.
const WORSE: f64 = 1e-3;

/// Exponents, with the map that was found for them.
#[derive(Clone, Debug)]
pub struct BestExponents {
    /// The corners with these exponents.
    pub corners: Corners,
    /// The largest K, onto the ball if that is what counts, if it was sought.
    pub max_k: Option<f64>,
    /// Image positions.
    pub image: Vec<Vec3>,
}

/// What was tried.
struct Trial {
    k: f64,
    corners: Corners,
    image: Vec<Vec3>,
    /// For each corner its share of the multipliers, and their mean of d ln K / d ln p there.
    slopes: BTreeMap<u32, (f64, f64)>,
}

impl Trial {
    /// The share and the slope of a corner that tells what it needs.
    fn slope(&self, corner: u32) -> Option<(f64, f64)> {
        self.slopes.get(&corner).copied().filter(|(share, _)| *share > LEAST_SHARE)
    }
}

impl Warped<'_> {
    /// Moves the vertices so that the objective falls ([`Warped::optimize`]), for the best of the [`exponents`](Self::exponents) tried. Where
    /// K ends clearly above that which the search has seen with them, it goes on from the map of that.
    ///
    /// # Errors
    /// As [`optimize()`](crate::optimize::optimize()).
    ///
    /// # Panics
    /// Without corners.
    pub fn optimize_exponents(
        &self,
        start: &[Vec3],
        settings: &OptimizeSettings,
        observe: &mut dyn FnMut(&TraceRow),
    ) -> Result<(Outcome, Corners), OptimizeError> {
        let found = self.exponents(start, settings, observe)?;
        let warped = Warped { corners: Some(&found.corners), ..*self };
        let (plain, _) = warped.elements();
        let (mut outcome, mut k) = if self.onto_ball {
            warped.optimize_onto_ball(&plain, start, settings, observe)?
        } else {
            let outcome = warped.optimize(start, settings, observe)?;
            let k = measure(&plain, &self.restricted(&outcome.positions)).summary.max_k;
            (outcome, k)
        };
        let is_worse = found.max_k.is_some_and(|least| k.ln() > least.ln() + WORSE);
        // A signal in the search leaves what it has, of unknown K onto the ball, and nothing but the start from here on.
        let is_interrupted = found.max_k.is_some() && settings.cancel.is_raised();
        if self.onto_ball && (is_worse || is_interrupted) {
            let mut of_search = Outcome { positions: found.image, ..outcome.clone() };
            let seconds = outcome.trace.last().map_or(0.0, |row| row.seconds);
            let least = found.max_k.unwrap_or(f64::INFINITY);
            warped.tell(&mut of_search, &plain, ("from the search", least.ln(), 1.0, seconds), observe);
            let settled = warped.settle_onto_ball(of_search.clone(), usize::MAX, settings, observe)?;
            // Points of the tets are what it went by, and in wide ones K is larger between them.
            let judging = OptimizeSettings { cancel: settings.cancel.or_a_second_more(), ..settings.clone() };
            let k_of = |image: &[Vec3]| warped.certified_onto_ball(image, &judging);
            if is_interrupted {
                k = k_of(&outcome.positions);
            }
            for other in [settled, of_search] {
                let k_of_other = k_of(&other.positions);
                if k_of_other < k {
                    (outcome, k) = (other, k_of_other);
                }
            }
        } else if is_worse {
            let rows = outcome.trace.len();
            let seconds = outcome.trace.last().map_or(0.0, |row| row.seconds);
            let left =
                if went_to_its_end(outcome.stop) { (settings.max_iterations + 1).saturating_sub(rows) } else { 0 };
            let of_rest = OptimizeSettings { max_iterations: left, ..settings.clone() };
            let later = |row: &TraceRow| TraceRow {
                phase: if row.iteration == 0 { "from the search".into() } else { row.phase.clone() },
                iteration: rows + row.iteration,
                seconds: seconds + row.seconds,
                ..row.clone()
            };
            let rest =
                self.solved(&plain, Start::Settled, &found.image, &of_rest, &mut |row, _| observe(&later(row)))?;
            outcome.trace.extend(rest.trace.iter().map(later));
            let stop = if left > 0 { rest.stop } else { outcome.stop };
            outcome = Outcome { trace: outcome.trace, stop, ..rest };
        }
        Ok((outcome, found.corners))
    }

    /// The exponents of least largest K, onto the polyhedron or the ball, among the ones tried: those that the corners have and none among them, and those
    /// from which no small change lowers it by much. Corners that the mirror planes exchange have the same. Without iterations
    /// those that the corners have. `observe` is told of each trial's iterations, in phases with the trial's number.
    ///
    /// # Errors
    /// As [`optimize()`](crate::optimize::optimize()).
    ///
    /// # Panics
    /// Without corners.
    pub fn exponents(
        &self,
        start: &[Vec3],
        settings: &OptimizeSettings,
        observe: &mut dyn FnMut(&TraceRow),
    ) -> Result<BestExponents, OptimizeError> {
        let given = self.corners.expect("there are corners");
        if settings.max_iterations == 0 {
            return Ok(BestExponents { corners: given.clone(), max_k: None, image: start.to_vec() });
        }
        let settings = OptimizeSettings { polish: Polish::None, ..settings.clone() };
        let mut trials = 0;
        let observe = &mut |row: &TraceRow| {
            trials += usize::from(row.iteration == 0);
            observe(&TraceRow {
                phase: format!("powers {trials}, {}", row.phase).into(),
                progress: 0.0,
                ..row.clone()
            });
        };
        let logs: BTreeMap<VertexId, f64> = given.exponents().into_iter().map(|(v, p)| (v, p.ln())).collect();
        let to_the = |power: f64| given.clone().with_exponents(|vertex| (logs[&vertex] * power).exp());
        let alike = (COMMON.1 / self.tets().len().max(1)).min(COMMON.2);
        let of_all = |exponent: f64| given.clone().with_exponents(|_| exponent);
        let common = (1..=alike).map(|i| of_all(COMMON.0.powf(i as f64 / alike as f64)));
        let onto_ball = COMMON_ONTO_BALL.into_iter().filter(|_| self.onto_ball).map(of_all);
        let mut best: Option<Trial> = None;
        let tried = ALONG.into_iter().map(to_the).chain(common).map(|corners| (corners, alike < 2));
        for (corners, is_near) in tried.chain(onto_ball.map(|corners| (corners, false))) {
            // On larger meshes the map of other exponents is as good a start, and nearer.
            let (known, from) = match &best {
                Some(best) if is_near => (Start::Settled, &best.image[..]),
                _ => (Start::Anywhere, start),
            };
            let below = best.as_ref().map_or(f64::INFINITY, |best| best.k);
            let trial = self.tried(corners, (known, from), below, &settings, observe)?;
            if best.as_ref().is_none_or(|best| trial.k < best.k) {
                best = Some(trial);
            }
            if settings.cancel.is_due() {
                break;
            }
        }
        let mut best = best.expect("something was tried");
        if best.corners.exponents().iter().all(|(_, exponent)| *exponent == 1.0) {
            for power in FROM_LINEAR {
                if settings.cancel.is_due() {
                    break;
                }
                let trial = self.tried(to_the(power), (Start::Settled, &best.image), best.k, &settings, observe)?;
                if trial.k < best.k {
                    best = trial;
                    break;
                }
            }
        }
        let Trial { k, corners, image, .. } = self.settled(best, &settings, observe)?;
        Ok(BestExponents { corners, max_k: Some(k), image })
    }

    /// Leads the slopes of all corners to 0, as long as that lowers K.
    fn settled(
        &self,
        mut best: Trial,
        settings: &OptimizeSettings,
        observe: &mut dyn FnMut(&TraceRow),
    ) -> Result<Trial, OptimizeError> {
        let mut curvatures: BTreeMap<u32, f64> = BTreeMap::new();
        let mut reach = 1.0f64;
        for _ in 0..STEPS {
            let curvature = |corner: u32| curvatures.get(&corner).copied().unwrap_or(CURVATURE[1]);
            let change = |corner: u32| {
                let (_, slope) = best.slope(corner)?;
                Some(reach * (-slope / curvature(corner)).clamp(-LARGEST, LARGEST))
            };
            let fall = |&corner: &u32| {
                best.slope(corner)
                    .map_or(0.0, |(share, slope)| reach * share * slope * slope / (2.0 * curvature(corner)))
            };
            let promised: f64 = best.slopes.keys().map(fall).sum();
            if promised < GAIN || settings.cancel.is_due() {
                break;
            }
            let logs: BTreeMap<VertexId, f64> =
                best.corners.exponents().into_iter().map(|(v, p)| (v, p.ln())).collect();
            let moved = |vertex: VertexId| (logs[&vertex] + change(self.alike(vertex)).unwrap_or(0.0)).exp();
            let corners = best.corners.clone().with_exponents(moved);
            let trial = self.tried(corners, (Start::Settled, &best.image), best.k, settings, observe)?;
            let fell = trial.k < best.k;
            let largest = if fell { CURVATURE[2] } else { CURVATURE[3] };
            let secants: Vec<(u32, f64)> = { best.slopes.keys() }
                .filter_map(|&corner| {
                    let ((_, before), (_, after)) = (best.slope(corner)?, trial.slope(corner)?);
                    let change = change(corner).filter(|change| change.abs() > 1e-3)?;
                    Some((corner, ((after - before) / change).clamp(CURVATURE[0], largest)))
                })
                .collect();
            curvatures.extend(secants);
            if fell {
                (best, reach) = (trial, (2.0 * reach).min(1.0));
            } else {
                reach *= 0.5;
            }
        }
        Ok(best)
    }

    /// The best that is found with these exponents; K onto the ball is certified if it may be `below` this one, and else infinite.
    fn tried(
        &self,
        corners: Corners,
        (known, from): (Start, &[Vec3]),
        below: f64,
        settings: &OptimizeSettings,
        observe: &mut dyn FnMut(&TraceRow),
    ) -> Result<Trial, OptimizeError> {
        let warped = Warped { corners: Some(&corners), ..*self };
        let (plain, owners) = warped.elements();
        let (outcome, k, first) = if self.onto_ball {
            let (outcome, first) = warped.lowered_onto_ball(&plain, (known, from), (ROUNDS, settings), observe)?;
            // At a limit what is certified is coarse, but all there is.
            let may_be_below =
                settings.cancel.is_due() || warped.k_below(&outcome.positions, below, settings).is_some();
            let k = if may_be_below { warped.certified_onto_ball(&outcome.positions, settings) } else { f64::INFINITY };
            (outcome, k, first)
        } else {
            let outcome = self.solved(&plain, known, from, settings, &mut |row, _| observe(row))?;
            let k = measure(&plain, &self.restricted(&outcome.positions)).summary.max_k;
            (outcome.clone(), k, outcome)
        };
        let slopes = self.slopes(&corners, &owners, &first.multipliers, &first.positions);
        Ok(Trial { k, corners, image: outcome.positions, slopes })
    }

    /// A number that corners have in common if and only if they are to have the same exponent.
    fn alike(&self, corner: VertexId) -> u32 {
        self.mirrors.map_or(corner.0, |mirrors| mirrors.in_chamber(corner.index()))
    }

    /// For each corner its share of the multipliers, and their mean of d ln K / d ln p there.
    fn slopes(
        &self,
        corners: &Corners,
        owners: &[TetId],
        multipliers: &[(TetId, f64)],
        image: &[Vec3],
    ) -> BTreeMap<u32, (f64, f64)> {
        // The place of each element among those of its tet.
        let mut seen = vec![0; owners.len()];
        let places: Vec<usize> = owners
            .iter()
            .map(|tet| {
                seen[tet.index()] += 1;
                seen[tet.index()] - 1
            })
            .collect();
        let nearby = [-STEP, STEP].map(|step| {
            let exponents: BTreeMap<VertexId, f64> = corners.exponents().into_iter().collect();
            corners.clone().with_exponents(|vertex| exponents[&vertex] * step.exp())
        });
        let mut sums: BTreeMap<u32, [f64; 2]> = BTreeMap::new();
        for (index, &(element, multiplier)) in multipliers.iter().enumerate() {
            let tet = self.tet_of_chamber(owners[element.index()]);
            let Some(cone) = corners.warped_cone(tet) else { continue };
            let jacobian = self.domain.jacobian(tet, image);
            let of = |corners: &Corners| {
                Dilatation::of(&(jacobian * corners.factors(self.domain, tet)[places[element.index()]]))
            };
            // A tet that holds both has two entries, that of K_O first.
            let is = |other: Option<&(TetId, f64)>| other.is_some_and(|(tet, _)| *tet == element);
            let side = match (is(multipliers.get(index + 1)), index > 0 && is(multipliers.get(index - 1))) {
                (true, _) => |dilatation: Dilatation| dilatation.outer,
                (false, true) => |dilatation: Dilatation| dilatation.inner,
                (false, false) => |dilatation: Dilatation| dilatation.k(),
            };
            let [less, more] = nearby.each_ref().map(|corners| side(of(corners)).ln());
            let [share, sum] = sums.entry(self.alike(cone.corner)).or_default();
            *share += multiplier;
            *sum += multiplier * (more - less) / (2.0 * STEP);
        }
        sums.into_iter().map(|(corner, [share, sum])| (corner, (share, sum / share))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::Domain;
    use crate::mesh::Subdivision;
    use crate::mesh::fixtures::{cube, fan, split};
    use crate::optimize::BoundaryValues;

    #[test]
    fn slopes_are_the_derivatives_of_the_least_largest_k_and_the_search_lowers_it() {
        let mut parted = Subdivision::of(&split(&fan(&cube(), Vec3::zeros())));
        parted.split_edges(|edge| edge.iter().all(|v| v.0 < 8));
        let domain = Domain::new(parted.mesh().unwrap()).unwrap();
        let image: Vec<Vec3> = { domain.mesh().points().iter() }
            .map(|x| if x.norm() > 0.0 { x * (x.amax() / x.norm()) } else { *x })
            .collect();
        let settings = OptimizeSettings {
            boundary_values: BoundaryValues::Sliding,
            polish: Polish::None,
            tolerance: 1e-9,
            ..OptimizeSettings::default()
        };
        let of = |exponent: f64| {
            let exponents: Vec<(VertexId, f64)> = (0..8).map(|v| (VertexId(v), exponent)).collect();
            Corners::stars(&domain, &exponents).unwrap()
        };
        let solved = |corners: &Corners, start: &[Vec3]| {
            let warped = Warped { domain: &domain, corners: Some(corners), mirrors: None, onto_ball: false };
            let outcome = warped.optimize(start, &settings, &mut |_| {}).unwrap();
            let elements = corners.elements(&domain);
            let k = measure(&elements.domain, &outcome.positions).summary.max_k;
            let slopes = warped.slopes(corners, &elements.owners, &outcome.multipliers, &outcome.positions);
            (k.ln(), slopes.values().map(|(share, slope)| share * slope).sum::<f64>(), outcome.positions)
        };
        let exponent: f64 = 1.2;
        let (ln_k, slope, positions) = solved(&of(exponent), &image);
        let step = 1e-3;
        let [less, more] = [-step, step].map(|by: f64| solved(&of(exponent * by.exp()), &positions).0);
        // The third derivative, of order 1, times step^2, and the accuracy of the solutions over the step.
        let difference = (more - less) / (2.0 * step);
        assert!((slope - difference).abs() < 1e-4 && slope.abs() > 0.1, "{slope} {difference}");
        let corners = of(exponent);
        let warped = Warped { domain: &domain, corners: Some(&corners), mirrors: None, onto_ball: false };
        let found = warped.exponents(&image, &settings, &mut |_| {}).unwrap();
        let (least, _, _) = solved(&found.corners, &image);
        assert!(least < ln_k - 1e-3, "{least} {ln_k} {:?}", found.corners.exponents());
    }
}

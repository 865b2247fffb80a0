//! Maps after warps of corners, symmetric maps, and K onto the ball made small: what is minimized is the largest K of tets that have several
//! matrices each.
//!
//! A map onto the ball has at a point the Jacobian L J R up to a factor: J that of the piecewise-linear map, R that of the warp of a
//! corner if there is one, and L a shear that depends on the direction of the point's image and on the boundary triangle there
//! ([`crate::measure::ball_dilatation`]). With R held as it is at some points of all tets, and L J replaced by its first-order change with the
//! corners of the tet, the largest K is a minimax problem like that without them; it is solved, R and L are taken anew on the way to its
//! solution, and so on as long as K falls. Such a problem does not see what becomes of L where a tet moves into another cone, and K may jump:
//! where the way was not taken to its end, the factors at that end are held beside those of the map in the next problem. At a fixed point all
//! that is left out of the conditions of stationarity is how L changes with those corners of a boundary triangle that its tet does not have,
//! the less the smaller the triangle's image is. With L held, images of triangles 20 degrees wide stopped a box of 1 x 1 x 2 at K 4.44 onto
//! the ball instead of 3.47.
//!
//! A map that commutes with the mirror planes of a domain is known from one chamber, whose vertices stay on their planes. Where
//! the least largest K is attained, it is attained by such a map if the problem were convex; it is not, but nothing better was seen.

mod exponents;

pub use exponents::BestExponents;

use std::time::Instant;

use rayon::prelude::*;

use super::recorder::Observe;
use super::{
    Objective, OptimizeError, OptimizeSettings, Outcome, Polish, Start, StopReason, TraceRow, optimize_unknowns,
    unknowns,
};
use crate::dilatation::Dilatation;
use crate::domain::{Afterwards, Domain};
use crate::map::Corners;
use crate::measure::{Factor, NotOntoBall, OntoBall, Summary, ball_dilatation_until, measure};
use crate::mesh::{Mat3, Mirrors, TetId, Vec3};

/// Relative fall of K onto the ball below which there is no other round: the least that a problem with held factors promises.
const GAIN: f64 = 1e-3;
/// Rounds in a row with a smaller fall, which only add factors, after which there is no other.
const FRUITLESS: usize = 3;
/// How far above the least K onto the ball on the way the last map onto the polyhedron may lie for the rounds to begin with it: with the one of the
/// least they ended at 2.94 on a cube, with the last, 3.31, at 2.90.
const FROM_LAST: f64 = 1.2;
/// Share of the largest ln K above which the factors of a tet are held in view, and the least and most of them that are. With 6 at
/// most, those left out decided: a tet near a corner reaches into dozens of cones.
const NEAR: (f64, usize, usize) = (0.95, 8, 60);
/// Accuracy in ln K of the problems with held factors, far below what a round is to gain.
const ACCURACY: f64 = 1e-4;
/// Shares of the way to the solution of a problem with held factors that are tried: far from where these were taken it says little.
const SHARES: [f64; 6] = [1.0, 0.7, 0.5, 0.25, 0.1, 0.04];
/// Share of the promised fall with which the whole way is taken without a look at others.
const KEPT: f64 = 0.5;

/// A domain whose boundary stays on the sphere or on its place, with what its maps are made of.
#[derive(Clone, Copy)]
pub struct Warped<'d> {
    /// The domain.
    pub domain: &'d Domain,
    /// The warps of corners, if there are any.
    pub corners: Option<&'d Corners>,
    /// The mirror planes of the domain about the origin of the image, if its maps are to be symmetric.
    pub mirrors: Option<&'d Mirrors>,
    /// Whether K onto the ball is made small rather than that onto the polyhedron.
    pub onto_ball: bool,
}

impl Warped<'_> {
    /// Moves the vertices so that the objective falls. For K onto the ball the start, inscribed in a sphere about 0 and star-shaped
    /// about 0, is first improved as without it, unless K onto the ball rises by that; from there on it only falls. The certified K onto the ball ends
    /// no higher than that of the start and of the improved map, unless a limit or a signal ends the work; where the start is best,
    /// [`StopReason::NoProgress`] says so.
    /// The outcome then has no KKT residual, and its trace has a row a round after those of the first map, whose objective is the logarithm of K
    /// onto the ball, as far as points of the tets tell. A round is one iteration.
    ///
    /// # Errors
    /// As [`optimize()`](super::optimize()), and a start that is not onto the ball.
    pub fn optimize(
        &self,
        start: &[Vec3],
        settings: &OptimizeSettings,
        observe: &mut dyn FnMut(&TraceRow),
    ) -> Result<Outcome, OptimizeError> {
        let (plain, _) = self.elements();
        if !self.onto_ball {
            return self.solved(&plain, Start::Anywhere, start, settings, &mut |row, _| observe(row));
        }
        self.optimize_onto_ball(&plain, start, settings, observe).map(|(outcome, _)| outcome)
    }

    /// The same for K onto the ball, with its certified value.
    fn optimize_onto_ball(
        &self,
        plain: &Domain,
        start: &[Vec3],
        settings: &OptimizeSettings,
        observe: &mut dyn FnMut(&TraceRow),
    ) -> Result<(Outcome, f64), OptimizeError> {
        let settings = &settings.starting_now();
        let (mut outcome, first) =
            self.lowered_onto_ball(plain, (Start::Anywhere, start), (usize::MAX, settings), observe)?;
        let mut k = self.certified_onto_ball(&outcome.positions, settings);
        // Points of the tets are what the rounds went by, and in wide ones K is larger between them.
        let mut is_other = false;
        for other in [start, &first.positions] {
            if other == outcome.positions || self.k_below(other, k, settings).is_none() {
                continue;
            }
            let k_of_other = self.certified_onto_ball(other, settings);
            if k_of_other < k {
                (k, outcome.positions, is_other) = (k_of_other, other.to_vec(), true);
            }
        }
        // Rounds that began elsewhere came to nothing better, but those from here may; and where they began at the start, those from the map
        // onto the polyhedron may.
        let of_first = Some(first.positions).filter(|_| outcome.positions == start);
        let of_other = is_other.then(|| outcome.positions.clone());
        for positions in of_other.into_iter().chain(of_first) {
            if !went_to_its_end(outcome.stop) || OntoBall::new(self.domain, self.corners, &positions).is_err() {
                continue;
            }
            let from = Outcome { positions, ..outcome.clone() };
            let settled = self.settle_onto_ball(from, usize::MAX, settings, observe)?;
            let k_of_settled = self.certified_onto_ball(&settled.positions, settings);
            if k_of_settled < k {
                (outcome, k) = (settled, k_of_settled);
            }
        }
        if outcome.stop == StopReason::Converged && outcome.positions == start {
            outcome.stop = StopReason::NoProgress;
        }
        Ok((outcome, k))
    }

    /// Lowers K onto the ball from a start in so many rounds at most; the first map is told too, as it came from the problem onto the polyhedron.
    fn lowered_onto_ball(
        &self,
        plain: &Domain,
        (known, start): (Start, &[Vec3]),
        (rounds, settings): (usize, &OptimizeSettings),
        observe: &mut dyn FnMut(&TraceRow),
    ) -> Result<(Outcome, Outcome), OptimizeError> {
        let settings = OptimizeSettings { objective: Objective::Max, polish: Polish::None, ..settings.starting_now() };
        let (first, least) = self.first(plain, (known, start), &settings, observe)?;
        let mut now = Outcome { kkt: None, multipliers: Vec::new(), ..first.clone() };
        let held = match self.held(&now.positions, &settings) {
            Ok(held) if went_to_its_end(now.stop) && held.k <= FROM_LAST * least.k => held,
            _ => {
                now.positions.clone_from(&least.image);
                self.held(&least.image, &settings)?
            }
        };
        let outcome = self.rounds_onto_ball(now, (held, least), plain, (rounds, &settings), observe)?;
        Ok((outcome, first))
    }

    /// Lowers K onto the ball of a piecewise-linear map that was settled, in so many rounds at most. With a soft maximum as objective that of
    /// the tets' largest K falls, and the largest of all may rise.
    ///
    /// # Errors
    /// As [`Warped::optimize`].
    pub fn settle_onto_ball(
        &self,
        settled: Outcome,
        rounds: usize,
        settings: &OptimizeSettings,
        observe: &mut dyn FnMut(&TraceRow),
    ) -> Result<Outcome, OptimizeError> {
        let held = self.held(&settled.positions, settings)?;
        let least = Least { k: held.k, image: settled.positions.clone() };
        let settings = OptimizeSettings { polish: Polish::None, ..settings.starting_now() };
        let settled = Outcome { kkt: None, multipliers: Vec::new(), ..settled };
        let (plain, _) = self.elements();
        self.rounds_onto_ball(settled, (held, least), &plain, (rounds, &settings), observe)
    }

    /// Lowers K onto the ball of a map with these factors in so many rounds at most; what is returned is no worse than the least.
    fn rounds_onto_ball(
        &self,
        mut now: Outcome,
        (mut held, least): (Held, Least),
        plain: &Domain,
        (rounds, settings): (usize, &OptimizeSettings),
        observe: &mut dyn FnMut(&TraceRow),
    ) -> Result<Outcome, OptimizeError> {
        let (clock, before) = (Instant::now(), now.trace.last().map_or(0.0, |row| row.seconds));
        let (tolerance, max_iterations) = (settings.tolerance.max(ACCURACY), usize::MAX / 2);
        let of_rounds = OptimizeSettings { tolerance, max_iterations, ..settings.clone() };
        let mut fruitless = 0;
        for _ in 0..rounds {
            // What ended the rest is told.
            if !went_to_its_end(now.stop) {
                break;
            }
            if let Some(due) = StopReason::of(&settings.cancel) {
                now.stop = due;
                break;
            }
            if now.trace.len() > settings.max_iterations {
                now.stop = StopReason::IterationLimit;
                break;
            }
            let problem = self.chamber().with_factors_on_both_sides(&held.factors);
            // What was carried over to a finer mesh may have turned an element of a corner over, which no step mends.
            let next = match self.solved(&problem, Start::Settled, &now.positions, &of_rounds, &mut |_, _| {}) {
                Err(OptimizeError::FlippedStart(_)) => {
                    now.stop = StopReason::NoProgress;
                    break;
                }
                next => next?,
            };
            now.stop = next.stop;
            // The first elements are the tets, the further ones of each follow.
            let measured = measure(&problem, &self.restricted(&next.positions)).dilatations;
            let (first, mut further) = measured.split_at(held.factors.len());
            let of_tets = first.iter().zip(&held.factors).map(|(first, factors)| {
                let (of_tet, others) = further.split_at(factors.len() - 1);
                further = others;
                of_tet.iter().map(|dilatation| dilatation.k()).fold(first.k(), f64::max)
            });
            let promised = held.k - largest(of_tets, settings.objective);
            let Some((farthest, best)) = self.on_the_way([&now.positions, &next.positions], held.k, promised, settings)
            else {
                break;
            };
            match best {
                Some(OnTheWay { share, held: trial, image }) => {
                    fruitless = if trial.k < held.k * (1.0 - GAIN) { 0 } else { fruitless + 1 };
                    held = trial;
                    now.positions = image;
                    let seconds = before + clock.elapsed().as_secs_f64();
                    self.tell(&mut now, plain, ("onto the ball", held.k.ln(), share, seconds), observe);
                    if share < 1.0 {
                        held.watch(farthest);
                    }
                }
                None => {
                    fruitless += 1;
                    held.watch(farthest);
                }
            }
            if promised < GAIN * held.k || fruitless == FRUITLESS {
                break;
            }
        }
        now.stop = if now.stop == StopReason::Optimal { StopReason::Converged } else { now.stop };
        if least.k < held.k {
            now.positions = least.image;
        }
        Ok(now)
    }

    /// Adds a row of the map as it is, if there are others: its phase, objective, step and time.
    fn tell(
        &self,
        map: &mut Outcome,
        plain: &Domain,
        (phase, objective, step, seconds): (&str, f64, f64, f64),
        observe: &mut dyn FnMut(&TraceRow),
    ) {
        let Some(last) = map.trace.last().cloned() else { return };
        let Summary { max_k, mean_k, .. } = measure(plain, &self.restricted(&map.positions)).summary;
        let iteration = map.trace.len();
        let row = TraceRow { phase: phase.into(), iteration, objective, max_k, mean_k, step, seconds, ..last };
        observe(&row);
        map.trace.push(row);
    }

    /// The improvement of the start as without the ball, and its iterate of least K onto the ball, the start included. A small K onto the
    /// polyhedron may have a large one onto the ball, on coarse meshes and where triangles open far, by which K falls most of all in the middle
    /// of long faces: a gem's was 8.7 on the way and 13 at the end.
    fn first(
        &self,
        plain: &Domain,
        (known, start): (Start, &[Vec3]),
        settings: &OptimizeSettings,
        observe: &mut dyn FnMut(&TraceRow),
    ) -> Result<(Outcome, Least), OptimizeError> {
        let mut least = Least { k: self.held(start, settings)?.k, image: start.to_vec() };
        let last = self.solved(plain, known, start, settings, &mut |row, image| {
            observe(row);
            let image = self.whole(image);
            if let Some(k) = self.k_below(&image, least.k, settings) {
                least = Least { k, image };
            }
        })?;
        Ok((last, least))
    }

    /// The image of least K onto the ball among some on the way from one to another, if it is below `k`, with the share of the way and its
    /// factors; and what makes K large at the farthest of them. `None` where none is onto the ball. `promised`: the expected fall.
    fn on_the_way(
        &self,
        [from, to]: [&[Vec3]; 2],
        k: f64,
        promised: f64,
        settings: &OptimizeSettings,
    ) -> Option<(Factors, Option<OnTheWay>)> {
        let mut farthest = None;
        let mut best: Option<OnTheWay> = None;
        for share in SHARES {
            let image = self.part_of_the_way([from, to], share, settings);
            let least = best.as_ref().map_or(k, |best| best.held.k);
            // The farthest is what tells more than whether it is better.
            let is_max = settings.objective == Objective::Max;
            if is_max && farthest.is_some() && self.k_below(&image, least, settings).is_none() {
                if best.is_some() {
                    break;
                }
                continue;
            }
            let Ok(trial) = self.held(&image, settings) else { continue };
            farthest.get_or_insert_with(|| trial.large());
            if trial.k < least {
                let enough = share == 1.0 && k - trial.k >= KEPT * promised;
                best = Some(OnTheWay { share, held: trial, image });
                if enough {
                    break;
                }
            } else if best.is_some() {
                break;
            }
        }
        farthest.map(|farthest| (farthest, best))
    }

    /// The tets that are solved for.
    fn tets(&self) -> Vec<TetId> {
        let all = || (0..self.domain.mesh().tets().len() as u32).map(TetId).collect();
        self.mirrors.map_or_else(all, |mirrors| mirrors.tets().to_vec())
    }

    fn chamber(&self) -> Domain {
        self.mirrors
            .map_or_else(|| self.domain.clone(), |mirrors| self.domain.chamber(mirrors.vertices(), mirrors.tets()))
    }

    /// The elements of the tets that are solved for, and whose each is.
    fn elements(&self) -> (Domain, Vec<TetId>) {
        let rights = |tet: TetId| self.corners.map_or(Vec::new(), |corners| corners.factors(self.domain, tet));
        self.chamber().with_factors(|tet| rights(self.tet_of_chamber(tet)))
    }

    fn tet_of_chamber(&self, tet: TetId) -> TetId {
        self.mirrors.map_or(tet, |mirrors| mirrors.tets()[tet.index()])
    }

    fn restricted(&self, image: &[Vec3]) -> Vec<Vec3> {
        self.mirrors.map_or_else(|| image.to_vec(), |mirrors| mirrors.folded(image))
    }

    fn whole(&self, image: &[Vec3]) -> Vec<Vec3> {
        self.mirrors.map_or_else(|| image.to_vec(), |mirrors| mirrors.unfolded(image))
    }

    /// Optimizes a domain that has this one's chamber's vertices; `observe` sees the positions of these.
    fn solved(
        &self,
        domain: &Domain,
        known: Start,
        start: &[Vec3],
        settings: &OptimizeSettings,
        observe: &mut Observe<'_>,
    ) -> Result<Outcome, OptimizeError> {
        let start = self.restricted(start);
        let mut unknowns = unknowns(domain, &start, domain.boundary().vertex_mask(), settings.boundary_values)?;
        if let Some(mirrors) = self.mirrors {
            unknowns = unknowns.within(mirrors.within());
        }
        let outcome = optimize_unknowns(known, domain, &start, &unknowns, settings, observe)?;
        let positions = self.whole(&outcome.positions);
        Ok(Outcome { positions, ..outcome })
    }

    /// Positions between two images; those of the boundary on the sphere again.
    fn part_of_the_way(&self, [from, to]: [&[Vec3]; 2], share: f64, settings: &OptimizeSettings) -> Vec<Vec3> {
        let slides = settings.boundary_values == super::BoundaryValues::Sliding;
        let on_sphere = |v: usize| slides && share < 1.0 && self.domain.boundary().vertex_mask()[v];
        let between = |v: usize| from[v] + (to[v] - from[v]) * share;
        let image: Vec<Vec3> = (0..from.len())
            .map(|v| if on_sphere(v) { between(v) * (from[v].norm() / between(v).norm()) } else { between(v) })
            .collect();
        // Its symmetry is exact again.
        self.mirrors.map_or(image.clone(), |mirrors| mirrors.unfolded(&mirrors.folded(&image)))
    }

    /// The largest K onto the ball, as far as points of the tets tell, if it is below `k` and known before the work is to end.
    fn k_below(&self, image: &[Vec3], k: f64, settings: &OptimizeSettings) -> Option<f64> {
        let onto = OntoBall::new(self.domain, self.corners, image).ok()?;
        let mut tets = self.tets();
        // One that is not below ends the search, and those of large K onto the polyhedron are likely to be.
        tets.sort_by_cached_key(|tet| {
            let k = Dilatation::of(&self.domain.jacobian(*tet, image)).k();
            std::cmp::Reverse(k.to_bits())
        });
        let of_tet = |tet: TetId| {
            let is_known = !settings.cancel.is_due();
            let largest = || onto.factors(tet, 0.0).iter().map(|factor| factor.k).fold(1.0, f64::max);
            Some(if is_known { largest() } else { f64::INFINITY }).filter(|of_tet| *of_tet < k)
        };
        tets.into_par_iter().map(of_tet).try_reduce(|| 1.0, |a, b| Some(a.max(b)))
    }

    /// The largest K onto the ball as it is proved, which no points miss; infinite where there is none or a signal ends the work before.
    fn certified_onto_ball(&self, image: &[Vec3], settings: &OptimizeSettings) -> f64 {
        let chamber = self.corners.and(self.mirrors).map(|_| self.tets());
        let k = ball_dilatation_until(self.domain, self.corners, image, chamber.as_deref(), &settings.cancel);
        k.map_or(f64::INFINITY, |k| k.certified)
    }

    /// All factors of tets of large K onto the ball, and the worst of the others. An image with a flipped tet has infinite K, and so has one
    /// whose factors are not known when the work is to end.
    fn held(&self, image: &[Vec3], settings: &OptimizeSettings) -> Result<Held, NotOntoBall> {
        let onto = OntoBall::new(self.domain, self.corners, image)?;
        let factors = |tet| if settings.cancel.is_due() { Vec::new() } else { onto.factors(tet, 0.0) };
        let all: Vec<Vec<Factor>> = self.tets().into_par_iter().map(factors).collect();
        let is_whole = !settings.cancel.is_due();
        let k = all.iter().flatten().map(|factor| factor.k).fold(1.0, f64::max);
        let least = (NEAR.0 * k.ln()).exp();
        let kept = |of_tet: &Vec<Factor>| -> (Vec<(Mat3, Afterwards)>, usize) {
            let mut sorted: Vec<&Factor> = of_tet.iter().collect();
            sorted.sort_by(|a, b| b.k.total_cmp(&a.k));
            let large = sorted.iter().filter(|factor| factor.k >= least).count().min(NEAR.2);
            sorted.truncate(large.max(NEAR.1));
            let all = if sorted.is_empty() {
                vec![(Mat3::identity(), Afterwards::nothing())]
            } else {
                sorted.into_iter().map(|factor| (factor.right, factor.afterwards.clone())).collect()
            };
            (all, large)
        };
        let (factors, large) = all.iter().map(kept).unzip();
        let of_tets = all.iter().map(|of_tet| of_tet.iter().map(|factor| factor.k).fold(1.0, f64::max));
        let k = if is_whole { largest(of_tets, settings.objective) } else { f64::INFINITY };
        Ok(Held { k, factors, large })
    }
}

/// The largest of some K, or what a soft maximum has in its place: the root of the sum of their powers.
fn largest(ks: impl Iterator<Item = f64>, objective: Objective) -> f64 {
    let ks: Vec<f64> = ks.collect();
    let most = ks.iter().copied().fold(1.0, f64::max);
    match objective {
        Objective::SoftMax(exponent) if most.is_finite() => {
            most * ks.iter().map(|k| (k / most).powf(exponent)).sum::<f64>().powf(1.0 / exponent)
        }
        _ => most,
    }
}

/// Whether nothing from outside ended an optimization.
fn went_to_its_end(stop: StopReason) -> bool {
    matches!(stop, StopReason::Optimal | StopReason::Converged | StopReason::NoProgress)
}

/// For each tet that is solved for its factors R, each with what follows.
type Factors = Vec<Vec<(Mat3, Afterwards)>>;

/// The factors of a map onto the ball.
struct Held {
    /// The largest K onto the ball by those that the map has, or its soft maximum.
    k: f64,
    factors: Factors,
    /// How many of a tet's first factors are there because K is large with them.
    large: Vec<usize>,
}

/// The image of the least K onto the ball so far.
struct Least {
    k: f64,
    image: Vec<Vec3>,
}

/// An image on the way to the solution of a problem with held factors.
struct OnTheWay {
    share: f64,
    held: Held,
    image: Vec<Vec3>,
}

impl Held {
    /// The factors that make K large.
    fn large(&self) -> Factors {
        self.factors.iter().zip(&self.large).map(|(of_tet, &large)| of_tet[..large].to_vec()).collect()
    }

    /// Adds factors that the tets have elsewhere: where a problem with held ones led to, and K was larger than it said.
    fn watch(&mut self, elsewhere: Factors) {
        self.factors.iter_mut().zip(elsewhere).for_each(|(of_tet, more)| of_tet.extend(more));
    }
}

//! The search for a certificate: where to look, and how multipliers become one.

use std::cmp::Reverse;

use rayon::prelude::*;

use super::check::{Checker, Region, Wall};
use super::dual::{Dual, Level};
use super::moments::{Moments, tets_among};
use super::multipliers::Multipliers;
use super::path::{Path, Stage};
use super::relaxed::Barrier;
use super::{Certificate, Outside, Split};
use crate::cancel::Cancel;
use crate::domain::Domain;
use crate::measure::{Measured, measure};
use crate::mesh::{TetId, Vec3, VertexId};

/// Boundary vertices are tried if the largest K at them is at least this fraction of the largest of all.
const NEAR_LARGEST: f64 = 0.6;
/// Most boundary vertices that are tried.
const MOST_VERTICES: usize = 300;
/// Of those, the ones with the highest levels are tried in earnest.
const FINALISTS: usize = 6;
/// No sub-complex of more tets is tried.
const MOST_TETS: usize = 1500;
/// A ring is added as long as the last one raised ln k by this.
const WORTHWHILE: f64 = 1e-3;
/// Accuracy, in ln k, at which the tets that matter are known.
const ROUGH: f64 = 0.02;
/// Accuracy, in ln k, at which the path ends.
const FINE: f64 = 1e-6;
/// Difference in ln k between the level of the relaxed problem and a certificate that is good enough.
const CLOSE: f64 = 2e-4;
/// Tets whose weight is below such a fraction of the largest are left out, to see what remains.
const THRESHOLDS: [f64; 4] = [0.0, 1e-4, 1e-3, 1e-2];
/// Tets count as active, for the places of lifted problems, if K is at least this fraction of the largest.
const ACTIVE: f64 = 1.0 - 1e-3;
/// Most places where lifted problems are solved.
const MOST_PLACES: usize = 6;
/// Most free vertices of a lifted problem to start with: its unknowns are the squares of their coordinates.
const MOST_FREE: usize = 8;
/// Numbers of free vertices to which the sets of the lifted problems are grown.
const GROWTH: [usize; 3] = [4, 6, 8];
/// Fraction of ln K at which the first level of a lifted problem lies.
const FIRST_FRACTION: f64 = 0.85;
/// Ratio of the largest K and the level found above which proofs are split.
const WORTH_SPLITTING: f64 = 1.1;
/// Levels tried with split proofs, as fractions of the way in ln k from the level found to the largest K.
const SPLIT_FRACTIONS: [f64; 5] = [0.2, 0.3, 0.4, 0.5, 0.6];
/// Distance of the first walls from the vertex in a box, in lengths of the shortest edge there.
const FIRST_WALL: f64 = 0.2;
/// Growth of the distance from one trial to the next.
const WALL_RATIO: f64 = 1.25;
/// Most trials of a wall.
const MOST_WALLS: usize = 20;
/// Accuracies of the slack at which parts of a split proof are tried.
const PART_SLACKS: [f64; 3] = [1e-2, 1e-3, 1e-4];
/// Accuracies of the slacks of the levels that are tried one after another.
const SLACKS: [f64; 4] = [1e-3, 1e-4, 1e-5, 3e-6];

/// Searches for a certificate until it finds no better one or the deadline; interior entries of `image` are the map started
/// from.
///
/// First lifted problems with orientation are solved around the active tets, with few free vertices, at most for a third of
/// the time. Then the relaxed problem without orientation is solved roughly around many boundary vertices, those with the largest K first. Its level is
/// about the bound that a certificate there can prove, and so the best of these places are then solved finely, on more and
/// more rings of tets as long as that helps. If that leaves much room below the largest K, proofs around the active tets are
/// split by where one vertex goes. The result depends on nothing but the arguments unless it is ended early.
///
/// `None` if the image has a flipped tet, or nothing was found.
///
/// # Panics
/// If `image` has fewer positions than the domain has vertices.
pub fn search(domain: &Domain, image: &[Vec3], cancel: &Cancel) -> Option<Certificate> {
    let [third, half] =
        [3, 2].map(|part| cancel.time_left().map_or_else(|| cancel.clone(), |left| cancel.within(left / part)));
    let measured = measure(domain, image);
    if !measured.summary.max_k.is_finite() {
        return None;
    }
    let mut search = Search { domain, image, measured: &measured, cancel: cancel.clone(), best: None };
    search.lifted_problems(&third);
    let level_around = |star: Vec<TetId>| {
        if half.is_due() {
            return None;
        }
        let tets = with_neighbours(domain, &star);
        let path = search.rough(tets.clone())?;
        Some((path.log_level(), tets))
    };
    let mut places: Vec<(f64, Vec<TetId>)> =
        stars(domain, &measured).into_par_iter().filter_map(level_around).collect();
    places.sort_by(|a, b| b.0.total_cmp(&a.0));
    // Also where the level is below the best one: more rings may raise it.
    for (_, mut tets) in places.into_iter().take(FINALISTS) {
        let mut reached = f64::NEG_INFINITY;
        while tets.len() <= MOST_TETS && !search.cancel.is_due() {
            let Some(level) = search.on(tets.clone()) else { break };
            let larger = with_neighbours(domain, &tets);
            if level < reached + WORTHWHILE || larger.len() == tets.len() {
                break;
            }
            (reached, tets) = (level, larger);
        }
    }
    search.split_problems();
    search.best
}

/// The same on one sub-complex only.
///
/// # Panics
/// If `image` has fewer positions than the domain has vertices.
pub fn search_on(domain: &Domain, image: &[Vec3], tets: Vec<TetId>, cancel: &Cancel) -> Option<Certificate> {
    let mut search = Search { domain, image, measured: &measure(domain, image), cancel: cancel.clone(), best: None };
    search.on(tets)?;
    search.best
}

struct Search<'a> {
    domain: &'a Domain,
    image: &'a [Vec3],
    measured: &'a Measured,
    cancel: Cancel,
    best: Option<Certificate>,
}

impl<'a> Search<'a> {
    /// Solves the relaxed problem roughly, then finely on the tets that carry weight; the least level of the relaxed problem,
    /// above which no certificate on these tets can be.
    fn on(&mut self, tets: Vec<TetId>) -> Option<f64> {
        let mut path = self.rough(tets)?;
        let level = path.log_level();
        for threshold in [1e-2, 1e-3, 1e-4] {
            let (kept, _) = heavy(path.barriers(), threshold);
            let kept: Vec<TetId> = kept.into_iter().map(|index| path.tets()[index]).collect();
            if let Some(mut fine) = self.path(kept) {
                self.follow_to_the_end(&mut fine);
            }
        }
        if self.best_log() < level - 0.01 {
            self.follow_to_the_end(&mut path);
        }
        Some(level)
    }

    /// The relaxed problem solved roughly.
    fn rough(&self, tets: Vec<TetId>) -> Option<Path<'a>> {
        let mut path = self.path(tets)?;
        while path.stage(&self.cancel) != Stage::Stuck && path.accuracy() > ROUGH {
            path.raise_weight();
        }
        Some(path)
    }

    fn path(&self, tets: Vec<TetId>) -> Option<Path<'a>> {
        let largest = tets.iter().map(|tet| self.measured.dilatations[tet.index()].k()).fold(1.0, f64::max);
        Path::new(self.domain, tets, self.image, largest)
    }

    fn best_log(&self) -> f64 {
        self.best.as_ref().map_or(0.0, |best| best.level.ln())
    }

    /// Follows a path and tries for a certificate at every stage.
    fn follow_to_the_end(&mut self, path: &mut Path<'_>) {
        loop {
            let stage = path.stage(&self.cancel);
            if path.accuracy() < 2.0 * ROUGH {
                self.certify(path);
            }
            if stage == Stage::Stuck || path.accuracy() < FINE || path.log_level() < self.best_log() + CLOSE {
                return;
            }
            path.raise_weight();
        }
    }

    /// Turns the multipliers at a point of the path into the best certificate they give.
    fn certify(&mut self, path: &Path<'_>) {
        let mut last = usize::MAX;
        for threshold in THRESHOLDS {
            let (kept, largest) = heavy(path.barriers(), threshold);
            if kept.len() == last {
                continue;
            }
            last = kept.len();
            let tets: Vec<TetId> = kept.iter().map(|&index| path.tets()[index]).collect();
            let duals: Vec<Dual> = kept.iter().map(|&index| path.barriers()[index].dual()).collect();
            self.certify_duals(&tets, &duals, largest.recip(), path.log_level(), false);
        }
    }

    /// The highest level below `open` that these multipliers prove, if it is above the best.
    fn certify_duals(&mut self, tets: &[TetId], duals: &[Dual], scale: f64, mut open: f64, coupled: bool) {
        /// Halvings of the interval between what is proved and the level of the path.
        const BISECTIONS: usize = 12;
        let Ok(mut checker) = Checker::new(self.domain, tets.to_vec(), coupled, Region::Whole) else { return };
        let mut proved = self.best_log();
        // What raises the best by nothing is found out by one check.
        let mut trial = (proved + 0.1 * CLOSE).max(open - 0.2);
        let mut raised = false;
        for _ in 0..BISECTIONS {
            if !(proved < trial && trial < open) {
                break;
            }
            let (log, level) = (Level::new(trial), trial.exp());
            let multipliers: Vec<Multipliers> = duals.iter().map(|dual| Multipliers::of(dual, log, scale)).collect();
            if checker.check(level, &multipliers, self.image).is_ok() {
                (proved, raised) = (trial, true);
                self.best = Some(Certificate::new(level, tets, &multipliers));
            } else {
                open = trial;
                if !raised {
                    break;
                }
            }
            trial = 0.5 * (proved + open);
        }
    }

    /// Solves lifted problems around the tets with the largest K, with more and more free vertices.
    fn lifted_problems(&mut self, cancel: &Cancel) {
        for seed in self.places() {
            let mut last = 0;
            for size in std::iter::once(seed.len()).chain(GROWTH.into_iter().filter(|&size| size > seed.len())) {
                let free = self.grown(seed.clone(), size);
                if free.len() == last || cancel.is_due() {
                    break;
                }
                last = free.len();
                let before = self.best_log();
                if !self.lifted(&free, cancel) || self.best_log() <= before {
                    break;
                }
            }
        }
    }

    /// The free vertices of active tets, those that share one together; where that makes too many, those of the first.
    fn places(&self) -> Vec<Vec<VertexId>> {
        let tets = self.domain.mesh().tets();
        let threshold = ACTIVE * self.measured.summary.max_k;
        let mut active: Vec<TetId> = (0..tets.len() as u32).map(TetId).filter(|t| self.k(*t) >= threshold).collect();
        active.sort_by(|a, b| self.k(*b).total_cmp(&self.k(*a)));
        // Each with the vertices of its first tet, which has the largest K.
        let mut places: Vec<(Vec<VertexId>, Vec<VertexId>)> = Vec::new();
        for tet in active {
            let free = tets[tet.index()].into_iter().filter(|v| !self.domain.boundary().contains(*v));
            let free: Vec<VertexId> = free.collect();
            let (mut first, mut all) = (free.clone(), free);
            if all.is_empty() {
                continue;
            }
            let (joined, mut apart): (Vec<_>, Vec<_>) =
                places.into_iter().partition(|(_, other)| other.iter().any(|v| all.contains(v)));
            for (index, (other_first, other)) in joined.into_iter().enumerate() {
                if index == 0 {
                    first = other_first;
                }
                all.extend(other);
            }
            all.sort_unstable();
            all.dedup();
            apart.push((first, all));
            places = apart;
        }
        places.truncate(MOST_PLACES);
        places.into_iter().map(|(first, all)| if all.len() <= MOST_FREE { all } else { first }).collect()
    }

    fn k(&self, tet: TetId) -> f64 {
        self.measured.dilatations[tet.index()].k()
    }

    /// The set with free vertices added, each time one of the tet with the largest K among those that touch the set and are
    /// not yet within, until it has `count`; ascending.
    fn grown(&self, mut set: Vec<VertexId>, count: usize) -> Vec<VertexId> {
        let tets = self.domain.mesh().tets();
        let mut order: Vec<TetId> = (0..tets.len() as u32).map(TetId).collect();
        order.sort_by(|a, b| self.k(*b).total_cmp(&self.k(*a)));
        while set.len() < count {
            let outside = |v: &VertexId| !self.domain.boundary().contains(*v) && !set.contains(v);
            let next = order.iter().find_map(|tet| {
                let corners = tets[tet.index()];
                corners.iter().any(|v| set.contains(v)).then(|| corners.into_iter().find(outside)).flatten()
            });
            let Some(next) = next else { break };
            set.push(next);
        }
        set.sort_unstable();
        set
    }

    /// Solves the lifted problem of some free vertices at levels near the least possible one and turns the multipliers into
    /// certificates; whether the least level was found.
    fn lifted(&mut self, free: &[VertexId], cancel: &Cancel) -> bool {
        let tets = tets_among(self.domain, free);
        let largest = tets.iter().map(|tet| self.k(*tet)).fold(1.0, f64::max).ln();
        let mut log = self.best_log().max(FIRST_FRACTION * largest);
        let Some(mut problem) = Moments::new(self.domain, self.image, free, Region::Whole, log) else { return false };
        let mut first = 1.0;
        for accuracy in SLACKS {
            let centred = problem.maximize_slack(first, accuracy, cancel);
            let Some(slope) = problem.slope().filter(|slope| *slope > 0.0) else { return false };
            let next = log - (problem.slack() + 0.5 * problem.accuracy()) / slope;
            if let Some(duals) = problem.duals() {
                let scale = duals.iter().map(Dual::weight).fold(0.0, f64::max).recip();
                self.certify_duals(problem.tets(), &duals, scale, log.max(next) + CLOSE, true);
            }
            // No level above that of the image can be proved.
            if !centred || next > largest + CLOSE || !problem.set_level(next) {
                return false;
            }
            (log, first) = (next, 10.0 * accuracy);
        }
        true
    }
}

impl Search<'_> {
    /// Proofs split by where one vertex goes, at higher and higher levels.
    fn split_problems(&mut self) {
        for free in self.places() {
            let largest = tets_among(self.domain, &free).into_iter().map(|tet| self.k(tet)).fold(1.0, f64::max).ln();
            let first = self.best_log();
            if largest - first < WORTH_SPLITTING.ln() {
                continue;
            }
            for hub in self.hubs(&free) {
                for fraction in SPLIT_FRACTIONS {
                    let level = first + fraction * (largest - first);
                    if level <= self.best_log() {
                        continue;
                    }
                    let Some(certificate) = self.split(&free, hub, level) else { break };
                    self.best = Some(certificate);
                }
            }
        }
    }

    /// The free vertices of tets whose determinants are no quadratic functions, those of most such tets first.
    fn hubs(&self, free: &[VertexId]) -> Vec<VertexId> {
        let mut counts: Vec<(usize, VertexId)> = free.iter().map(|&v| (0, v)).collect();
        for tet in tets_among(self.domain, free) {
            let unknowns = self.domain.mesh().tets()[tet.index()].map(|v| free.binary_search(&v).ok());
            if unknowns.iter().flatten().count() > 2 {
                unknowns.iter().flatten().for_each(|&unknown| counts[unknown].0 += 1);
            }
        }
        counts.retain(|(count, _)| *count > 0);
        counts.sort_by_key(|&(count, v)| (Reverse(count), v));
        counts.into_iter().map(|(_, v)| v).collect()
    }

    /// A certificate for a level that is split at a box around the image of a vertex: each wall of the box is set as near as
    /// the maps beyond it are proved to have a larger K.
    fn split(&self, free: &[VertexId], hub: VertexId, level: f64) -> Option<Certificate> {
        let image = self.image[hub.index()];
        let tets = self.domain.mesh().tets().iter().filter(|corners| corners.contains(&hub)).flatten();
        let shortest =
            tets.filter(|&&v| v != hub).map(|v| (self.image[v.index()] - image).norm()).fold(f64::INFINITY, f64::min);
        let mut ends = [image, image];
        let mut outside = Vec::with_capacity(6);
        for (axis, side) in (0..6).map(|wall| (wall / 2, wall % 2)) {
            let outwards = if side == 0 { -1.0 } else { 1.0 };
            let mut distance = FIRST_WALL * shortest;
            let mut trials = 0..MOST_WALLS;
            outside.push(trials.find_map(|_| {
                let bound = image[axis] + outwards * distance;
                distance *= WALL_RATIO;
                let wall = Wall { vertex: hub, axis, bound, outwards, push: 0.0 };
                let (certificate, push) = self.part(free, Region::Beyond(wall), level)?;
                ends[side][axis] = bound;
                Some(Outside { push, certificate })
            })?);
        }
        let (mut certificate, _) = self.part(free, Region::Inside(hub, ends), level)?;
        let [low, high] = ends.map(|end| [end.x, end.y, end.z]);
        certificate.split = Some(Box::new(Split { vertex: hub.0, low, high, outside }));
        Some(certificate)
    }

    /// A certificate for a level and the maps of a region, and the multiplier of the region's wall.
    fn part(&self, free: &[VertexId], region: Region, level: f64) -> Option<(Certificate, f64)> {
        let mut problem = Moments::new(self.domain, self.image, free, region, level)?;
        let mut checker = Checker::new(self.domain, problem.tets().to_vec(), true, region).ok()?;
        let mut first = 1.0;
        for accuracy in PART_SLACKS {
            if !problem.maximize_slack(first, accuracy, &self.cancel) || problem.slack() > 0.0 {
                return None;
            }
            let duals = problem.duals()?;
            let scale = duals.iter().map(Dual::weight).fold(0.0, f64::max).recip();
            let push = problem.push() * scale;
            let multipliers: Vec<Multipliers> =
                duals.iter().map(|dual| Multipliers::of(dual, Level::new(level), scale)).collect();
            checker.set_push(push);
            if checker.check(level.exp(), &multipliers, self.image).is_ok() {
                return Some((Certificate::new(level.exp(), problem.tets(), &multipliers), push));
            }
            first = accuracy;
        }
        None
    }
}

/// The tets whose weight is at least this fraction of the largest, and the largest.
fn heavy(barriers: &[Barrier], threshold: f64) -> (Vec<usize>, f64) {
    let weights: Vec<f64> = barriers.iter().map(Barrier::weight).collect();
    let largest = weights.iter().copied().fold(0.0, f64::max);
    ((0..weights.len()).filter(|&index| weights[index] >= threshold * largest).collect(), largest)
}

/// The tets at each boundary vertex near which K is among the largest, ascending; largest K first, without those whose
/// worst tet an earlier one has.
fn stars(domain: &Domain, measured: &Measured) -> Vec<Vec<TetId>> {
    let k = |tet: TetId| measured.dilatations[tet.index()].k();
    let mut stars: Vec<Vec<TetId>> = vec![Vec::new(); domain.mesh().points().len()];
    for (tet, corners) in (0..).map(TetId).zip(domain.mesh().tets()) {
        corners.iter().filter(|&&v| domain.boundary().contains(v)).for_each(|v| stars[v.index()].push(tet));
    }
    let worst = |star: &[TetId]| star.iter().copied().reduce(|a, b| if k(b) > k(a) { b } else { a });
    let mut ranked: Vec<(TetId, Vec<TetId>)> =
        stars.into_iter().filter_map(|star| Some((worst(&star)?, star))).collect();
    ranked.sort_by(|a, b| k(b.0).total_cmp(&k(a.0)));
    let mut taken = vec![false; measured.dilatations.len()];
    ranked.retain(|(tet, star)| {
        let wanted = !taken[tet.index()] && k(*tet) >= NEAR_LARGEST * measured.summary.max_k;
        if wanted {
            star.iter().for_each(|tet| taken[tet.index()] = true);
        }
        wanted
    });
    ranked.into_iter().take(MOST_VERTICES).map(|(_, star)| star).collect()
}

/// These tets and all that share a free vertex with one of them, ascending.
fn with_neighbours(domain: &Domain, tets: &[TetId]) -> Vec<TetId> {
    let all = domain.mesh().tets();
    let mut near = vec![false; domain.mesh().points().len()];
    for tet in tets {
        all[tet.index()].iter().for_each(|v| near[v.index()] = !domain.boundary().contains(*v));
    }
    let mut taken = vec![false; all.len()];
    tets.iter().for_each(|tet| taken[tet.index()] = true);
    (0..)
        .map(TetId)
        .zip(all)
        .filter(|(tet, corners)| taken[tet.index()] || corners.iter().any(|v| near[v.index()]))
        .map(|(tet, _)| tet)
        .collect()
}

#[cfg(test)]
mod tests;

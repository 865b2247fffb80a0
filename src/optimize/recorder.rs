//! What every engine reports its iterates to.

use std::collections::BTreeMap;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::{OptimizeSettings, StopReason, TraceRow};
use crate::cancel::Cancel;
use crate::dilatation::Dilatation;
use crate::mesh::{TetId, Vec3};
use crate::objective::Iterate;

/// Whether a phase goes on after an iteration was recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Progress {
    Continue,
    Stop,
}

/// How one phase ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PhaseEnd {
    Converged,
    NoProgress,
    Interrupted,
}

/// Part of the room below a cap that a start may use up, so that it lies inside.
const BELOW_CAP: f64 = 0.95;
/// Steps of the largest K, up to what it may rise to, for each of which the iterate of least mean is kept.
const LEVELS: f64 = 16.0;

/// Iterates from which the mean may be lowered: the one of least mean for each level of the largest K.
///
/// On its way down the largest K first takes the mean with it, and then, from some point on, costs more and more of it.
struct Candidates {
    /// ln(1 + rise).
    room: f64,
    /// By the level: ln K in units of the room's part.
    of_level: BTreeMap<i64, Candidate>,
}

struct Candidate {
    max_k: f64,
    mean_k: f64,
    image: Vec<Vec3>,
}

impl Candidates {
    fn offer(&mut self, max_k: f64, mean_k: f64, image: &[Vec3], best_k: f64) {
        let level = |k: f64| (k.ln() / self.room * LEVELS) as i64;
        let highest = level(best_k) + LEVELS as i64;
        self.of_level.split_off(&(highest + 1));
        // False for what is not finite.
        let is_low = max_k.ln() < highest as f64 * self.room / LEVELS;
        if is_low && self.of_level.get(&level(max_k)).is_none_or(|kept| mean_k < kept.mean_k) {
            self.of_level.insert(level(max_k), Candidate { max_k, mean_k, image: image.to_vec() });
        }
    }

    fn least_mean(&self, highest_k: f64) -> Option<&Candidate> {
        let low = self.of_level.values().filter(|candidate| candidate.max_k <= highest_k);
        low.min_by(|a, b| a.mean_k.total_cmp(&b.mean_k))
    }
}

/// How far a minimax solution is from stationary: the Karush-Kuhn-Tucker conditions of min t subject to 3 |l_i| <= t.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct KktResidual {
    /// Largest violation of a constraint, in ln K.
    pub primal: f64,
    /// Norm of the multipliers' combined gradient relative to the sum of its parts' norms, or the distance of the
    /// multipliers' sum from 1 if that is larger.
    pub dual: f64,
    /// Sum of multiplier times slack over all constraints, in ln K.
    pub complementarity: f64,
}

impl KktResidual {
    /// The largest of the three.
    pub fn largest(&self) -> f64 {
        self.primal.max(self.dual).max(self.complementarity)
    }
}

/// The vertices and tets of a part of the mesh.
#[derive(Clone, Debug)]
pub(super) struct Part {
    pub vertices: Vec<u32>,
    pub tets: Vec<TetId>,
}

/// Sees every row as it comes, and the positions that it tells of.
pub(super) type Observe<'a> = dyn FnMut(&TraceRow, &[Vec3]) + 'a;

/// Takes K of each iterate's tets, keeps the best one and the trace, and watches the limits.
pub(super) struct Recorder<'a> {
    /// The last iterate, and K of each tet there.
    image: Vec<Vec3>,
    dilatations: Vec<f64>,
    /// What the positions passed to [`Recorder::record`] are; `None` for all vertices.
    pub(super) part: Option<Part>,
    start: Instant,
    max_iterations: usize,
    /// Share of the limits kept for the polish.
    reserved: f64,
    /// With the whole time limit as its deadline, and with what is not reserved of it.
    whole: Cancel,
    cancel: Cancel,
    observe: &'a mut Observe<'a>,
    pub(super) rows: Vec<TraceRow>,
    pub(super) best: Vec<Vec3>,
    pub(super) best_k: f64,
    mean_of_best: f64,
    candidates: Option<Candidates>,
    /// See [`Outcome::multipliers`](super::Outcome::multipliers), one entry a constraint.
    pub(super) multipliers: Vec<(TetId, f64)>,
    /// See [`TraceRow::progress`]; set by the phases.
    pub(super) progress: f64,
    /// Whether the next iterate may be the result; not where it violates a constraint that K does not show. Set by the phases.
    pub(super) admits: bool,
}

impl<'a> Recorder<'a> {
    pub(super) fn new(start: &Iterate, settings: &OptimizeSettings, observe: &'a mut Observe<'a>) -> Self {
        let cancel = settings.starting_now().cancel;
        let mut recorder = Self {
            image: start.image().to_vec(),
            dilatations: Vec::new(),
            part: None,
            start: Instant::now(),
            max_iterations: settings.max_iterations,
            reserved: 0.0,
            whole: cancel.clone(),
            cancel,
            observe,
            rows: Vec::new(),
            best: start.image().to_vec(),
            best_k: f64::INFINITY,
            mean_of_best: f64::INFINITY,
            candidates: None,
            multipliers: Vec::new(),
            progress: 0.0,
            admits: true,
        };
        recorder.record("start", f64::INFINITY, 0.0, start);
        recorder
    }

    /// From now on keeps iterates from which the mean may be lowered, whose largest K may lie above the best one by this, relative.
    pub(super) fn keep_candidates(&mut self, rise: f64) {
        self.candidates = Some(Candidates { room: rise.ln_1p(), of_level: BTreeMap::new() });
    }

    /// Takes over positions and dilatations of what has changed.
    fn take(&mut self, iterate: &Iterate) {
        let dilatations = iterate.decompositions().iter().map(|tet| Dilatation::of_singular_values(tet.values).k());
        match &self.part {
            None => {
                self.image.copy_from_slice(iterate.image());
                self.dilatations.clear();
                self.dilatations.extend(dilatations);
            }
            Some(part) => {
                for (&v, position) in part.vertices.iter().zip(iterate.image()) {
                    self.image[v as usize] = *position;
                }
                for (t, dilatation) in part.tets.iter().zip(dilatations) {
                    self.dilatations[t.index()] = dilatation;
                }
            }
        }
    }

    /// The mean of the iterate of least mean whose largest K lies a little below a cap, and that iterate; the best one, if no other was
    /// kept.
    pub(super) fn start_below(&self, cap: f64) -> (f64, Vec<Vec3>) {
        let below = self.best_k + (cap - self.best_k) * BELOW_CAP;
        match self.candidates.as_ref().and_then(|candidates| candidates.least_mean(below)) {
            Some(candidate) if candidate.mean_k < self.mean_of_best => (candidate.mean_k, candidate.image.clone()),
            _ => (self.mean_of_best, self.best.clone()),
        }
    }

    /// The mean of K at the last iterate.
    pub(super) fn mean(&self) -> f64 {
        self.dilatations.iter().sum::<f64>() / self.dilatations.len() as f64
    }

    /// Keeps a share of the limits for later; 0 gives it free again.
    pub(super) fn reserve(&mut self, share: f64) {
        self.reserved = share;
        let left = self.whole.time_left();
        self.cancel = left.map_or_else(|| self.whole.clone(), |left| self.whole.within(left.mul_f64(1.0 - share)));
    }

    /// Which limit stopped it.
    pub(super) fn interruption(&self) -> StopReason {
        // NLopt counts evaluations, of which there may be more than rows: the time tells.
        StopReason::of(&self.cancel).unwrap_or(StopReason::IterationLimit)
    }

    /// What ends the present phase.
    pub(super) fn cancel(&self) -> &Cancel {
        &self.cancel
    }

    pub(super) fn iterations_left(&self) -> usize {
        // Row 0 is the start.
        let limit = (self.max_iterations as f64 * (1.0 - self.reserved)).ceil() as usize;
        (limit + 1).saturating_sub(self.rows.len())
    }

    pub(super) fn record(&mut self, phase: &str, objective: f64, step: f64, iterate: &Iterate) -> Progress {
        self.take(iterate);
        let mean_k = self.mean();
        let max_k = self.dilatations.iter().copied().fold(1.0, f64::max);
        if self.admits && max_k < self.best_k {
            self.best_k = max_k;
            self.mean_of_best = mean_k;
            self.best.clear();
            self.best.extend_from_slice(&self.image);
        }
        if let Some(candidates) = self.candidates.as_mut().filter(|_| self.admits) {
            candidates.offer(max_k, mean_k, &self.image, self.best_k);
        }
        // Rows of a phase share its name: a small piece of memory kept an iteration, amid the large ones of each, leaves the allocator
        // with holes that are just too small for the next, and 600 iterations on 68,000 tets took 3.3 GB.
        let phase = match self.rows.last() {
            Some(last) if &*last.phase == phase => last.phase.clone(),
            _ => phase.into(),
        };
        // A phase may end with a map that is no further iteration: that after the last one allowed takes its place.
        if self.rows.len() > self.max_iterations.max(1) {
            self.rows.pop();
        }
        let row = TraceRow {
            phase,
            iteration: self.rows.len(),
            objective,
            max_k,
            mean_k,
            step,
            round: 0,
            progress: self.progress,
            seconds: self.start.elapsed().as_secs_f64(),
        };
        (self.observe)(&row, &self.image);
        self.rows.push(row);
        let stop = self.cancel.is_due() || self.iterations_left() == 0;
        if stop { Progress::Stop } else { Progress::Continue }
    }
}

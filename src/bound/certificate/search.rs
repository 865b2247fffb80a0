//! The search for a certificate: a barrier method on the relaxed problem in more than three coordinates.

use std::time::Instant;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};

use super::check::Checker;
use super::relaxed::{Barrier, Block, COORDINATES, Level, Position};
use super::{Certificate, Multipliers};
use crate::domain::Domain;
use crate::linalg::BlockCholesky;
use crate::measure::measure;
use crate::mesh::{TetId, Vec3, VertexId};

const ARMIJO: f64 = 1e-4;
const HALVINGS: usize = 40;
const FIRST_SLACK: f64 = 0.1;
const CENTRED: f64 = 0.2;
const STAGE_STEPS: usize = 60;

/// Settings.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Deadline.
    pub deadline: Option<Instant>,
    /// Stabiliser.
    pub stiffness: f64,
    /// Weight ratio.
    pub ratio: f64,
    /// Print.
    pub verbose: bool,
}

/// The relaxed problem of a sub-complex.
struct Relaxation<'a> {
    domain: &'a Domain,
    tets: Vec<TetId>,
    gradients: Vec<[Vec3; 4]>,
    unknowns: Vec<[Option<u32>; 4]>,
    /// Stiffness of the coordinates beyond the third, a tet.
    stiffness: Vec<f64>,
    free: Vec<VertexId>,
    fixed: Vec<Position>,
    system: BlockCholesky,
    starts: Vec<usize>,
    rows: Vec<u32>,
}

struct State {
    barriers: Vec<Barrier>,
    value: f64,
}

struct Linear {
    gradient: Vec<f64>,
    mixed: Vec<f64>,
    by_level: f64,
    by_level_twice: f64,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

impl<'a> Relaxation<'a> {
    fn new(domain: &'a Domain, tets: Vec<TetId>, image: &[Vec3], stiffness: f64) -> Option<Self> {
        let mesh = domain.mesh();
        let gradients: Vec<[Vec3; 4]> = tets
            .iter()
            .map(|tet| {
                let inverse = &domain.inverse_edges()[tet.index()];
                let [g1, g2, g3] = [0, 1, 2].map(|row| inverse.row(row).transpose());
                [-(g1 + g2 + g3), g1, g2, g3]
            })
            .collect();
        let vertices = tets.iter().flat_map(|tet| mesh.tets()[tet.index()]);
        let mut free: Vec<VertexId> = vertices.filter(|&v| !domain.boundary().contains(v)).collect();
        free.sort_unstable();
        free.dedup();
        let unknown = |v: VertexId| free.binary_search(&v).ok().map(|unknown| unknown as u32);
        let unknowns: Vec<[Option<u32>; 4]> = tets.iter().map(|tet| mesh.tets()[tet.index()].map(unknown)).collect();
        let mut edges = Vec::new();
        for tet in &unknowns {
            for row in tet.iter().flatten() {
                edges.extend(tet.iter().flatten().filter(|column| *column < row).map(|column| (*row, *column)));
            }
        }
        let system = BlockCholesky::with_block_size(COORDINATES, free.len(), &edges).ok()?;
        let (starts, rows) = (system.column_starts().to_vec(), system.rows().to_vec());
        let fixed = image
            .iter()
            .map(|p| Position::from_fn(|i, _| if i < 3 { p[i] } else { 0.0 }))
            .collect();
        let stiffness = tets
            .iter()
            .map(|&tet| stiffness / domain.jacobian(tet, image).norm_squared())
            .collect();
        Some(Self { domain, tets, gradients, unknowns, stiffness, free, fixed, system, starts, rows })
    }

    fn state(&self, x: &[Position], log_level: f64) -> Option<State> {
        let level = Level::new(log_level);
        let mut value = 0.0;
        let mut barriers = Vec::with_capacity(self.tets.len());
        for (index, tet) in self.tets.iter().enumerate() {
            let corners = self.domain.mesh().tets()[tet.index()];
            let positions: [&Position; 4] = std::array::from_fn(|i| match self.unknowns[index][i] {
                Some(unknown) => &x[unknown as usize],
                None => &self.fixed[corners[i].index()],
            });
            let edges = [1, 2, 3].map(|i| positions[i] - positions[0]);
            let columns = [0, 1, 2].map(|j| {
                (0..3).map(|i| edges[i] * self.gradients[index][i + 1][j]).sum::<Position>()
            });
            let barrier = Barrier::new(columns, level)?;
            let beyond: f64 = columns.iter().map(|c| c.rows(3, COORDINATES - 3).norm_squared()).sum();
            value += barrier.value + self.stiffness[index] * beyond;
            barriers.push(barrier);
        }
        Some(State { barriers, value })
    }

    fn linearize(&mut self, state: &State, negative: f64) -> Linear {
        const D: usize = COORDINATES;
        let n = D * self.free.len();
        let (mut gradient, mut mixed) = (vec![0.0; n], vec![0.0; n]);
        let (mut by_level, mut by_level_twice) = (0.0, 0.0);
        let values = self.system.values_mut();
        values.fill(0.0);
        for (index, barrier) in state.barriers.iter().enumerate() {
            let derivatives = barrier.derivatives();
            by_level += derivatives.by_level;
            by_level_twice += derivatives.by_level_twice;
            let unknowns = &self.unknowns[index];
            if unknowns.iter().all(Option::is_none) {
                continue;
            }
            let slopes = barrier.gradient(&derivatives, self.stiffness[index]);
            let mixed_slopes = barrier.mixed_gradient(&derivatives);
            let hessian = barrier.hessian(&derivatives, self.stiffness[index], negative);
            let g = self.gradients[index].map(|gradient| barrier.axes.tr_mul(&gradient));
            for i in 0..4 {
                let Some(row) = unknowns[i] else { continue };
                for axis in 0..3 {
                    for c in 0..D {
                        gradient[D * row as usize + c] += g[i][axis] * slopes[axis][c];
                        mixed[D * row as usize + c] += g[i][axis] * mixed_slopes[axis][c];
                    }
                }
                // Columns of the Hessian by vertex i, then contracted with j.
                let half: [Block; 3] = [0, 1, 2].map(|b| {
                    (0..3)
                        .map(|a| {
                            if a >= b { hessian[a][b] * g[i][a] } else { hessian[b][a].transpose() * g[i][a] }
                        })
                        .sum::<Block>()
                });
                for j in 0..4 {
                    let Some(column) = unknowns[j] else { continue };
                    if row < column {
                        continue;
                    }
                    let block = half[0] * g[j][0] + half[1] * g[j][1] + half[2] * g[j][2];
                    let (start, end) = (self.starts[column as usize], self.starts[column as usize + 1]);
                    let k = self.rows[start..end].binary_search(&row).expect("in the pattern");
                    for c in 0..D {
                        let offset = D * D * start + c * D * (end - start) + D * k;
                        for r in 0..D {
                            values[offset + r] += block[(r, c)];
                        }
                    }
                }
            }
        }
        Linear { gradient, mixed, by_level, by_level_twice }
    }
}

/// Searches on `tets`.
pub fn search(domain: &Domain, tets: Vec<TetId>, image: &[Vec3], settings: &Settings) -> Option<Certificate> {
    let measured = measure(domain, image);
    let start_k = tets.iter().map(|t| measured.dilatations[t.index()].k()).fold(1.0, f64::max);
    let mut relaxation = Relaxation::new(domain, tets, image, settings.stiffness)?;
    let mut log_level = start_k.ln() + FIRST_SLACK;
    let base: Vec<Position> = relaxation.free.iter().map(|v| relaxation.fixed[v.index()]).collect();
    // Extra coordinates.
    let mut lengths = vec![f64::INFINITY; base.len()];
    for (index, tet) in relaxation.tets.iter().enumerate() {
        let corners = domain.mesh().tets()[tet.index()].map(|v| image[v.index()]);
        for i in 0..4 {
            if let Some(u) = relaxation.unknowns[index][i] {
                for j in (0..4).filter(|&j| j != i) {
                    lengths[u as usize] = lengths[u as usize].min((corners[i] - corners[j]).norm());
                }
            }
        }
    }
    let mut random = ChaCha8Rng::seed_from_u64(0);
    let noise: Vec<Position> = lengths
        .iter()
        .map(|length| {
            Position::from_fn(|i, _| if i < 3 { 0.0 } else { length * (random.next_u32() as f64 / 4294967296.0 - 0.5) })
        })
        .collect();
    let mut amplitude = 0.2;
    let (mut x, mut state) = loop {
        let x: Vec<Position> = base.iter().zip(&noise).map(|(b, n)| b + n * amplitude).collect();
        if let Some(state) = relaxation.state(&x, log_level) {
            break (x, state);
        }
        amplitude *= 0.5;
        if amplitude < 1e-6 {
            return None;
        }
    };
    let terms = 7.0 * relaxation.tets.len() as f64;
    let first: f64 = state.barriers.iter().map(|b| b.derivatives().by_level).sum();
    let mut weight = -first;
    let mut negative = 1.0f64;
    let mut best: Option<Certificate> = None;
    let mut total_steps = 0;
    let clock = Instant::now();
    loop {
        // Centre.
        let mut end = false;
        for taken in 0..STAGE_STEPS {
            if settings.deadline.is_some_and(|d| Instant::now() > d) {
                end = true;
                break;
            }
            let step = loop {
                let linear = relaxation.linearize(&state, negative);
                let system = &mut relaxation.system;
                system.shift_diagonal(1e-10 * system.largest_diagonal());
                if system.factorize().is_ok() {
                    let mut by_level = linear.mixed.clone();
                    system.solve(&mut by_level);
                    let schur = linear.by_level_twice - dot(&linear.mixed, &by_level);
                    if schur > 0.0 {
                        let mut by_position = linear.gradient.clone();
                        system.solve(&mut by_position);
                        let bg = weight + linear.by_level;
                        let bd = -(bg - dot(&linear.mixed, &by_position)) / schur;
                        let direction: Vec<f64> =
                            by_position.iter().zip(&by_level).map(|(u, w)| -u - w * bd).collect();
                        let slope = dot(&linear.gradient, &direction) + bg * bd;
                        let bt = -1.0 / schur;
                        let tangent: Vec<f64> = by_level.iter().map(|w| -w * bt).collect();
                        if slope < 0.0 {
                            break Some((direction, bd, slope, tangent, bt));
                        }
                    }
                }
                if negative == 0.0 {
                    break None;
                }
                negative = if negative > 0.02 { 0.3 * negative } else { 0.0 };
            };
            let Some((direction, bd, slope, tangent, bt)) = step else {
                end = true;
                break;
            };
            total_steps += 1;
            let moved = |x: &[Position], d: &[f64], length: f64| -> Vec<Position> {
                x.iter()
                    .zip(d.chunks_exact(COORDINATES))
                    .map(|(x, d)| x + Position::from_column_slice(d) * length)
                    .collect()
            };
            if taken > 0 && -slope < CENTRED || taken + 1 == STAGE_STEPS {
                // next weight
                if settings.verbose {
                    let extra: f64 = x.iter().map(|p| p.rows(3, COORDINATES - 3).norm_squared()).sum::<f64>().sqrt();
                    let real: f64 = x.iter().map(|p| p.rows(0, 3).norm_squared()).sum::<f64>().sqrt();
                    eprintln!(
                        "steps {total_steps} gap {:.2e} level {:.5} negative {negative:.3} extra {:.3e} best {:.5} {:.2}s",
                        terms / weight,
                        log_level.exp(),
                        extra / real,
                        best.as_ref().map_or(0.0, |b| b.level),
                        clock.elapsed().as_secs_f64()
                    );
                }
                let next = weight * settings.ratio;
                let mut length = weight * (1.0 - weight / next);
                for _ in 0..HALVINGS {
                    let (trial, trial_level) = (moved(&x, &tangent, length), log_level + length * bt);
                    if let Some(s) = relaxation.state(&trial, trial_level) {
                        (x, log_level, state) = (trial, trial_level, s);
                        break;
                    }
                    length *= 0.7;
                }
                weight = next;
                break;
            }
            let total = state.value + weight * log_level;
            let mut length = 1.0;
            let mut accepted = false;
            for _ in 0..HALVINGS {
                let (trial, trial_level) = (moved(&x, &direction, length), log_level + length * bd);
                if let Some(s) = relaxation.state(&trial, trial_level)
                    && s.value + weight * trial_level <= total + ARMIJO * length * slope
                {
                    (x, log_level, state) = (trial, trial_level, s);
                    accepted = true;
                    break;
                }
                length *= 0.5;
            }
            if !accepted {
                if settings.verbose {
                    eprintln!("no step: slope {slope:.3e}");
                }
                end = taken == 0;
                weight *= settings.ratio;
                break;
            }
            negative = (2.0 * negative).clamp(0.02, 1.0);
        }
        if terms / weight < 0.03 || end {
            extract(&relaxation, &state, log_level, image, &mut best, settings);
        }
        if end || terms / weight < 1e-5 || best.as_ref().is_some_and(|b| log_level - b.level.ln() < 1e-4) {
            return best;
        }
    }
}

fn extract(
    relaxation: &Relaxation<'_>,
    state: &State,
    log_level: f64,
    image: &[Vec3],
    best: &mut Option<Certificate>,
    settings: &Settings,
) {
    let largest = state.barriers.iter().map(Barrier::weight).fold(0.0, f64::max);
    for threshold in [0.0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2] {
        let kept: Vec<usize> =
            (0..state.barriers.len()).filter(|&t| state.barriers[t].weight() >= threshold * largest).collect();
        let tets: Vec<TetId> = kept.iter().map(|&t| relaxation.tets[t]).collect();
        let Ok(mut checker) = Checker::new(relaxation.domain, tets.clone()) else { continue };
        let mut good = best.as_ref().map_or(0.0, |b| b.level.ln());
        let mut bad = log_level;
        let mut trial = good.max(0.5 * (good + bad)).max(log_level - 0.05);
        if good > 0.0 {
            trial = good + 1e-5;
        }
        let mut found = false;
        for _ in 0..24 {
            if !(good < trial && trial < bad) {
                break;
            }
            let level = trial.exp();
            let multipliers: Vec<Multipliers> =
                kept.iter().map(|&t| multipliers(&state.barriers[t], Level::new(trial), 1.0 / largest)).collect();
            match checker.check(level, &multipliers, image) {
                Ok(()) => {
                    good = trial;
                    *best =
                        Some(Certificate { level, tets: tets.iter().map(|t| t.0).collect(), multipliers });
                    found = true;
                }
                Err(e) => {
                    if settings.verbose && !found && best.is_none() {
                        eprintln!("   threshold {threshold:e} level {level:.4}: {e}");
                    }
                    bad = trial;
                    if !found && best.is_some() {
                        break;
                    }
                }
            }
            trial = 0.5 * (good + bad);
            if bad - good < 1e-5 {
                break;
            }
        }
        if settings.verbose && found {
            eprintln!("   threshold {threshold:e} tets {} certified {:.5}", tets.len(), good.exp());
        }
    }
}

fn multipliers(barrier: &Barrier, level: Level, scale: f64) -> Multipliers {
    let factor = |eigenvalues: &Vec3, scale: f64| -> [f64; 6] {
        let matrix = barrier.axes * crate::mesh::Mat3::from_diagonal(&(eigenvalues * scale)) * barrier.axes.transpose();
        match matrix.cholesky() {
            Some(c) => {
                let l = c.l();
                [l[(0, 0)], l[(1, 0)], l[(1, 1)], l[(2, 0)], l[(2, 1)], l[(2, 2)]]
            }
            None => [0.0; 6],
        }
    };
    let budget = barrier.lower.sum() * (1.0 - 1e-13);
    let stretch = budget / (level.ratio * barrier.upper.sum() + level.trace * barrier.trace);
    Multipliers {
        lower: factor(&barrier.lower, scale),
        upper: factor(&barrier.upper, scale * stretch),
        trace: barrier.trace * scale * stretch,
    }
}

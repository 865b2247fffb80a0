//! The lifted problem of a sub-complex with few free vertices: moments of their positions as unknowns, one dense Newton
//! system a step.
//!
//! With `z = (1, x)` and x the 3n displacements of the free vertices from where they start, each in lengths of the
//! shortest edge there, the moments are the entries of a positive semidefinite
//! matrix Z of size 3n + 1 with `Z_00 = 1` in the place of `z z^T`. G, C and d of a tet are linear in them
//! ([`LiftedTet`]), and so *the largest slack with which the conditions of a level k hold* is a convex problem. If it is
//! negative, the multipliers of the conditions are a certificate for k.

use std::time::Instant;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::dual::{Dual, Level};
use super::lifted::{ARGUMENTS, Derivatives, LiftedTet, moment};
use crate::domain::Domain;
use crate::mesh::{TetId, Vec3, VertexId};

/// Sufficient decrease of the Armijo rule.
const ARMIJO: f64 = 1e-4;
/// Halvings of a step before the line search gives up.
const HALVINGS: usize = 40;
/// Half of the squared Newton decrement at which a point counts as centred.
const CENTRED: f64 = 0.1;
/// Growth of the weight from one centred point to the next.
const WEIGHT_RATIO: f64 = 10.0;
/// Most Newton steps at one weight.
const STEPS: usize = 100;
/// Deviation of the positions at the start, in lengths of the shortest edge.
const FIRST_DEVIATION: f64 = 0.05;

/// A point of the central path that maximises `weight * slack` and the logarithms of how far all conditions hold.
pub(super) struct Moments {
    ids: Vec<TetId>,
    tets: Vec<LiftedTet>,
    /// Rows of Z.
    rows: usize,
    point: Point,
    level: Level,
    log_level: f64,
    weight: f64,
}

#[derive(Clone)]
struct Point {
    /// The upper triangle of Z, by columns.
    moments: Vec<f64>,
    deltas: Vec<f64>,
    slack: f64,
}

impl Point {
    fn moved(&self, step: &DVector<f64>, length: f64) -> Self {
        let mut next = self.clone();
        // The first moment is the constant.
        let unknowns = next.moments.iter_mut().skip(1).chain(&mut next.deltas).chain(std::iter::once(&mut next.slack));
        unknowns.zip(step.iter()).for_each(|(unknown, step)| *unknown += length * step);
        next
    }

    fn matrix(&self, rows: usize) -> DMatrix<f64> {
        DMatrix::from_fn(rows, rows, |i, j| self.moments[moment(i.min(j), i.max(j))])
    }
}

impl Moments {
    /// The problem of all tets whose free vertices, one at least, are among these, ascending; it starts at the image with the
    /// positions blurred a little. `None` if there are no such tets, or a tet is flipped.
    pub(super) fn new(domain: &Domain, image: &[Vec3], free: &[VertexId], log_level: f64) -> Option<Self> {
        let mesh = domain.mesh();
        let ids = tets_among(domain, free);
        if ids.is_empty() {
            return None;
        }
        let all: Vec<VertexId> = ids.iter().flat_map(|tet| mesh.tets()[tet.index()]).collect();
        let centre = all.iter().map(|v| image[v.index()]).sum::<Vec3>() / all.len() as f64;
        let size = all.iter().map(|v| (image[v.index()] - centre).norm()).fold(0.0, f64::max);
        let normalized = |v: VertexId| (image[v.index()] - centre) / size;
        let unknown = |v: VertexId| free.binary_search(&v).ok();
        let mut shortest = vec![f64::INFINITY; free.len()];
        for vertices in ids.iter().map(|tet| mesh.tets()[tet.index()]) {
            for (v, length) in vertices.into_iter().filter_map(|v| Some((v, unknown(v)?))) {
                let others = vertices.into_iter().filter(|&other| other != v);
                let lengths = others.map(|other| (normalized(other) - normalized(v)).norm());
                shortest[length] = lengths.fold(shortest[length], f64::min);
            }
        }
        let mut tets = Vec::with_capacity(ids.len());
        for &tet in &ids {
            let inverse = &domain.inverse_edges()[tet.index()];
            let [g1, g2, g3] = [0, 1, 2].map(|row| inverse.row(row).transpose());
            let gradients = [-(g1 + g2 + g3), g1, g2, g3];
            let vertices = mesh.tets()[tet.index()];
            let corners = vertices.map(|v| unknown(v).map(|unknown| (unknown, shortest[unknown])));
            let determinant = domain.jacobian(tet, image).determinant() / size.powi(3);
            if determinant.is_nan() || determinant <= 0.0 {
                return None;
            }
            tets.push(LiftedTet::new(&gradients, &vertices.map(normalized), &corners, determinant, size));
        }
        let rows = 3 * free.len() + 1;
        let pairs = (0..rows).flat_map(|j| (0..=j).map(move |i| (i, j)));
        let first = |(i, j): (usize, usize)| match (i, j) {
            (0, 0) => 1.0,
            _ if i == j => FIRST_DEVIATION * FIRST_DEVIATION,
            _ => 0.0,
        };
        let moments = pairs.map(first).collect();
        let deltas = vec![1.0; tets.len()];
        let point = Point { moments, deltas, slack: 0.0 };
        let mut problem =
            Self { ids, tets, rows, point, level: Level::new(log_level), log_level, weight: f64::INFINITY };
        problem.set_level(log_level).then_some(problem)
    }

    /// The tets.
    pub(super) fn tets(&self) -> &[TetId] {
        &self.ids
    }

    /// The slack of the point: a little below the largest one.
    pub(super) fn slack(&self) -> f64 {
        self.point.slack
    }

    /// How far the largest slack may be above that of a centred point.
    pub(super) fn accuracy(&self) -> f64 {
        (self.rows + LiftedTet::TERMS * self.tets.len()) as f64 / self.weight
    }

    /// Goes to another level, with the slack lowered until all conditions hold; whether there is such a slack.
    pub(super) fn set_level(&mut self, log_level: f64) -> bool {
        (self.level, self.log_level) = (Level::new(log_level), log_level);
        let mut lowered = 0.0;
        for _ in 0..HALVINGS {
            let trial = Point { slack: self.point.slack - lowered, ..self.point.clone() };
            if self.barrier(&trial, &self.level).is_some() {
                // Not at the very edge.
                self.point.slack -= 1.5 * lowered;
                return true;
            }
            lowered = if lowered == 0.0 { 1e-4 } else { 2.0 * lowered };
        }
        false
    }

    /// Follows the central path of the level until the slack is known to this accuracy, from an accuracy not below
    /// `first_accuracy`; whether the last point is centred.
    pub(super) fn maximize_slack(&mut self, first_accuracy: f64, accuracy: f64, deadline: Instant) -> bool {
        let terms = self.accuracy() * self.weight;
        let terms = if terms.is_finite() { terms } else { (self.rows + LiftedTet::TERMS * self.tets.len()) as f64 };
        self.weight = terms / first_accuracy;
        loop {
            if !self.centre(deadline) {
                return false;
            }
            if self.accuracy() <= accuracy * 1.001 {
                return true;
            }
            self.weight = (self.weight * WEIGHT_RATIO).min(terms / accuracy);
        }
    }

    /// The derivative of the largest slack by ln k, at a centred point.
    pub(super) fn slope(&self) -> Option<f64> {
        // A small part of the distance at which conditions that matter hold.
        let step = 1e-3 / self.weight;
        let here = self.barrier(&self.point, &self.level)?;
        let there = self.barrier(&self.point, &Level::new(self.log_level + step))?;
        Some((here - there) / step / self.weight)
    }

    /// The multipliers of the tets.
    pub(super) fn duals(&self) -> Option<Vec<Dual>> {
        let tets = self.tets.iter().zip(&self.point.deltas);
        tets.map(|(tet, &delta)| tet.dual(&self.point.moments, delta, self.point.slack, &self.level)).collect()
    }

    /// The sum of all barriers.
    fn barrier(&self, point: &Point, level: &Level) -> Option<f64> {
        let factor = point.matrix(self.rows).cholesky()?;
        let mut value = -2.0 * factor.l_dirty().diagonal().iter().map(|entry| entry.ln()).sum::<f64>();
        for (tet, &delta) in self.tets.iter().zip(&point.deltas) {
            value += tet.barrier(&point.moments, delta, point.slack, level, None)?;
        }
        value.is_finite().then_some(value)
    }

    fn centre(&mut self, deadline: Instant) -> bool {
        let Some(mut value) = self.barrier(&self.point, &self.level) else { return false };
        for _ in 0..STEPS {
            if Instant::now() > deadline {
                return false;
            }
            let Some((step, slope)) = self.newton_step() else { return false };
            if -slope < 2.0 * CENTRED {
                return true;
            }
            let total = value - self.weight * self.point.slack;
            let objective = |point: &Point| Some(self.barrier(point, &self.level)? - self.weight * point.slack);
            let mut best: Option<(Point, f64)> = None;
            let mut length = 1.0;
            for _ in 0..HALVINGS {
                let next = self.point.moved(&step, length);
                if let Some(reached) = objective(&next).filter(|reached| *reached <= total + ARMIJO * length * slope) {
                    best = Some((next, reached));
                    break;
                }
                length *= 0.5;
            }
            // Far from the path, where a whole step is but a doubling of what is too small, longer ones may do.
            while let Some((_, reached)) = best.as_ref().filter(|_| length >= 1.0 && -slope > 1.0) {
                length *= 2.0;
                let next = self.point.moved(&step, length);
                match objective(&next).filter(|further| further < reached) {
                    Some(further) => best = Some((next, further)),
                    None => break,
                }
            }
            // Otherwise rounding decides.
            let Some((next, reached)) = best else { return -slope < 1.0 };
            value = reached + self.weight * next.slack;
            self.point = next;
        }
        false
    }

    /// The Newton step and the derivative of the objective along it.
    fn newton_step(&self) -> Option<(DVector<f64>, f64)> {
        let moments = self.point.moments.len() - 1;
        let count = moments + self.tets.len() + 1;
        let inverse = self.point.matrix(self.rows).cholesky()?.inverse();
        let pairs: Vec<(usize, usize)> = (0..self.rows).flat_map(|j| (0..=j).map(move |i| (i, j))).skip(1).collect();
        let mut gradient = DVector::zeros(count);
        let mut hessian = DMatrix::zeros(count, count);
        for (column, &(k, l)) in pairs.iter().enumerate() {
            let twice = if k == l { 1.0 } else { 2.0 };
            gradient[column] -= twice * inverse[(k, l)];
            let (at_k, at_l) = (inverse.column(k), inverse.column(l));
            for (row, &(i, j)) in pairs.iter().enumerate().skip(column) {
                let factor = if i == j { 0.5 * twice } else { twice };
                hessian[(row, column)] = factor * (at_k[i] * at_l[j] + at_l[i] * at_k[j]);
            }
        }
        for (index, (tet, &delta)) in self.tets.iter().zip(&self.point.deltas).enumerate() {
            let mut local = Derivatives::zero();
            tet.barrier(&self.point.moments, delta, self.point.slack, &self.level, Some(&mut local))?;
            let places = tet.moments().iter().map(|&place| place.checked_sub(1));
            let places: Vec<Option<usize>> = places.chain([Some(moments + index), Some(count - 1)]).collect();
            let figures = tet.map().nrows();
            let mut map = DMatrix::zeros(ARGUMENTS, places.len());
            map.view_mut((0, 0), tet.map().shape()).copy_from(tet.map());
            (map[(figures, places.len() - 2)], map[(figures + 1, places.len() - 1)]) = (1.0, 1.0);
            let slopes = map.tr_mul(&local.gradient);
            let curvatures = map.tr_mul(&(local.hessian * &map));
            for (column, &to) in places.iter().enumerate() {
                let Some(to) = to else { continue };
                gradient[to] += slopes[column];
                for (row, &from) in places.iter().enumerate() {
                    if let Some(from) = from.filter(|&from| from >= to) {
                        hessian[(from, to)] += curvatures[(row, column)];
                    }
                }
            }
        }
        gradient[count - 1] -= self.weight;
        // Scaled to a unit diagonal: moments of short and long edges differ by orders of magnitude.
        let scale = hessian.diagonal().map(|entry| entry.sqrt().recip());
        for column in 0..count {
            for row in column..count {
                hessian[(row, column)] *= scale[row] * scale[column];
            }
            hessian[(column, column)] += 1e-14;
        }
        let factor: Cholesky<f64, Dyn> = hessian.cholesky()?;
        let mut step = -gradient.component_mul(&scale);
        factor.solve_mut(&mut step);
        let step = step.component_mul(&scale);
        let slope = step.dot(&gradient);
        (slope < 0.0).then_some((step, slope))
    }
}

/// The tets with a free vertex all of whose free vertices are among these, which ascend.
pub(super) fn tets_among(domain: &Domain, free: &[VertexId]) -> Vec<TetId> {
    let among = |v: &VertexId| free.binary_search(v).is_ok();
    let inside = |corners: &[VertexId; 4]| {
        corners.iter().any(among) && corners.iter().all(|v| among(v) || domain.boundary().contains(*v))
    };
    let tets = (0..).map(TetId).zip(domain.mesh().tets());
    tets.filter(|(_, corners)| inside(corners)).map(|(tet, _)| tet).collect()
}

//! The lifted problem of a sub-complex with few free vertices: moments of their positions as unknowns, one dense Newton
//! system a step.
//!
//! With `z = (1, x)` and x the 3n displacements of the free vertices from where they start, each in lengths of the
//! shortest edge there, the moments are the entries of a positive semidefinite
//! matrix Z of size 3n + 1 with `Z_00 = 1` in the place of `z z^T`. G, C and d of a tet are linear in them
//! ([`LiftedTet`]), and so *the largest slack with which the conditions of a level k hold* is a convex problem. If it is
//! negative, the multipliers of the conditions are a certificate for k.
//!
//! With one vertex in a box ([`Region::Inside`]) the unknowns are eight matrices Z, one for each corner that the vertex may
//! be at, with `Z_00` adding up to 1, and the sums of G, C and d over them; and the variance of the vertex that the mixture of
//! corners has too much. A wall ([`Region::Beyond`]) is one more condition, linear in the moments.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::check::{Region, Wall, corner_of_box};
use super::dual::{Dual, Level};
use super::lifted::{ARGUMENTS, Derivatives, LiftedTet, moment};
use crate::cancel::Cancel;
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
    /// Number of matrices Z.
    blocks: usize,
    /// The largest variance of the vertex in a box.
    room: Option<f64>,
    wall: Option<LiftedWall>,
    point: Point,
    level: Level,
    log_level: f64,
    weight: f64,
}

/// A wall in the unknowns: `outwards * (moments[place] - bound)` is at least the slack.
struct LiftedWall {
    place: usize,
    outwards: f64,
    bound: f64,
    /// The length of the unknown's unit.
    unit: f64,
}

impl LiftedWall {
    fn distance(&self, point: &Point) -> f64 {
        self.outwards * (point.moments[self.place] - self.bound) - point.slack
    }
}

#[derive(Clone)]
struct Point {
    /// The upper triangle of each Z, by columns, and the superfluous variance of the vertex in a box.
    moments: Vec<f64>,
    deltas: Vec<f64>,
    slack: f64,
}

impl Point {
    /// The point moved along a step that has no entry for the first moment: the weights of the blocks add up to 1.
    ///
    /// If `curved`, weights, means and *covariances* of the blocks move along straight lines, not the second moments: with small
    /// variances a straight line in those leaves the cone as soon as the mean has moved by a deviation.
    fn moved(&self, step: &DVector<f64>, length: f64, problem: &Moments, curved: bool) -> Self {
        let mut next = self.clone();
        let unknowns = next.moments.iter_mut().skip(1).chain(&mut next.deltas).chain(std::iter::once(&mut next.slack));
        unknowns.zip(step.iter()).for_each(|(unknown, step)| *unknown += length * step);
        next.moments[0] = 1.0 - problem.weights().skip(1).map(|weight| next.moments[weight]).sum::<f64>();
        for first in problem.weights().filter(|_| curved) {
            let [before, after] = [self.moments[first], next.moments[first]];
            let mean = |point: &Self, i: usize, weight: f64| point.moments[first + moment(0, i)] / weight;
            // For the covariance S = X - v v^T / w of a block (w, v, X) to change by its derivative, X changes by w c c^T more, c the
            // change of v / w.
            let change: Vec<f64> = (1..problem.rows).map(|i| mean(&next, i, after) - mean(self, i, before)).collect();
            for j in 1..problem.rows {
                for i in 1..=j {
                    next.moments[first + moment(i, j)] += after * change[i - 1] * change[j - 1];
                }
            }
        }
        next
    }

    fn matrix(&self, rows: usize, block: usize) -> DMatrix<f64> {
        let first = block * block_size(rows);
        DMatrix::from_fn(rows, rows, |i, j| self.moments[first + moment(i.min(j), i.max(j))])
    }
}

impl Moments {
    /// The problem of all tets whose free vertices, one at least, are among these, ascending, in a region; it starts at the
    /// image with the positions blurred a little. `None` if there are no such tets, or a tet is flipped, or the vertex in a
    /// box does not start inside it.
    pub(super) fn new(
        domain: &Domain,
        image: &[Vec3],
        free: &[VertexId],
        region: Region,
        log_level: f64,
    ) -> Option<Self> {
        let mesh = domain.mesh();
        let ids = tets_among(domain, free);
        if ids.is_empty() {
            return None;
        }
        let all: Vec<VertexId> = ids.iter().flat_map(|tet| mesh.tets()[tet.index()]).collect();
        let centre = all.iter().map(|v| image[v.index()]).sum::<Vec3>() / all.len() as f64;
        let size = all.iter().map(|v| (image[v.index()] - centre).norm()).fold(0.0, f64::max);
        let normalized = |v: VertexId| (image[v.index()] - centre) / size;
        let held = region.held();
        let free: Vec<VertexId> = free.iter().copied().filter(|&v| held != Some(v)).collect();
        let unknown = |v: VertexId| free.binary_search(&v).ok();
        let places: Vec<Vec3> = match region {
            Region::Inside(_, box_corners) => (0..8).map(|corner| corner_of_box(box_corners, corner)).collect(),
            _ => vec![Vec3::zeros()],
        };
        let rows = 3 * free.len() + 1;
        let block = block_size(rows);
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
            let at = |place: &Vec3| {
                let position = |v: VertexId| if held == Some(v) { (place - centre) / size } else { normalized(v) };
                LiftedTet::new(&gradients, &vertices.map(position), &corners, determinant, size)
            };
            let corner = vertices.iter().position(|&v| held == Some(v));
            let less = corner.map(|corner| (places.len() * block, gradients[corner] / determinant.cbrt()));
            tets.push(LiftedTet::mixed(places.iter().map(at).collect(), block, less));
        }
        let (weights, variances) = match region {
            Region::Inside(vertex, ends) => {
                let (weights, [spread, room]) = mixture(&image[vertex.index()], ends)?;
                (weights, Some([0.5 * spread / (size * size), room / (size * size)]))
            }
            _ => (vec![1.0], None),
        };
        let pairs: Vec<(usize, usize)> = (0..rows).flat_map(|j| (0..=j).map(move |i| (i, j))).collect();
        let first = |(i, j): (usize, usize)| match (i, j) {
            (0, 0) => 1.0,
            _ if i == j => FIRST_DEVIATION * FIRST_DEVIATION,
            _ => 0.0,
        };
        let mut moments: Vec<f64> =
            weights.iter().flat_map(|weight| pairs.iter().map(move |&pair| weight * first(pair))).collect();
        moments.extend(variances.map(|[spread, _]| spread));
        let wall = match region {
            Region::Beyond(Wall { vertex, axis, bound, outwards, .. }) => {
                let unknown = unknown(vertex)?;
                let unit = shortest[unknown] * size;
                let bound = (bound - image[vertex.index()][axis]) / unit;
                Some(LiftedWall { place: moment(0, 1 + 3 * unknown + axis), outwards, bound, unit })
            }
            _ => None,
        };
        let deltas = vec![1.0; tets.len()];
        let point = Point { moments, deltas, slack: 0.0 };
        let mut problem = Self {
            ids,
            tets,
            rows,
            blocks: places.len(),
            room: variances.map(|[_, room]| room),
            wall,
            point,
            level: Level::new(log_level),
            log_level,
            weight: f64::INFINITY,
        };
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

    /// Number of terms of all barriers.
    fn terms(&self) -> f64 {
        (self.blocks * self.rows + LiftedTet::TERMS * self.tets.len()) as f64
    }

    /// The places of the blocks' weights among the moments.
    fn weights(&self) -> impl Iterator<Item = usize> + use<> {
        let block = block_size(self.rows);
        (0..self.blocks).map(move |index| index * block)
    }

    /// How far the largest slack may be above that of a centred point.
    pub(super) fn accuracy(&self) -> f64 {
        self.terms() / self.weight
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
    pub(super) fn maximize_slack(&mut self, first_accuracy: f64, accuracy: f64, cancel: &Cancel) -> bool {
        let terms = self.terms();
        // At most the weight that the slack of the point is balanced with: with a larger one the centre is hundreds of steps away.
        let Some(balance) = self.balance() else { return false };
        self.weight = (terms / first_accuracy).min(balance);
        loop {
            if !self.centre(cancel) {
                return false;
            }
            if self.accuracy() <= accuracy * 1.001 {
                return true;
            }
            self.weight = (self.weight * WEIGHT_RATIO).min(terms / accuracy);
        }
    }

    /// The derivative of the sum of all barriers by the slack.
    fn balance(&self) -> Option<f64> {
        let mut sum = 0.0;
        for (tet, &delta) in self.tets.iter().zip(&self.point.deltas) {
            let mut local = Derivatives::zero();
            tet.barrier(&self.point.moments, delta, self.point.slack, &self.level, Some(&mut local))?;
            sum += local.gradient[ARGUMENTS - 1];
        }
        sum += self.wall.as_ref().map_or(0.0, |wall| 1.0 / wall.distance(&self.point));
        Some(sum)
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

    /// The multiplier of the wall's condition, in the coordinates of the image; 0 without a wall.
    pub(super) fn push(&self) -> f64 {
        self.wall.as_ref().map_or(0.0, |wall| 1.0 / (wall.distance(&self.point) * wall.unit))
    }

    /// The sum of all barriers.
    fn barrier(&self, point: &Point, level: &Level) -> Option<f64> {
        let mut value = 0.0;
        for block in 0..self.blocks {
            let factor = point.matrix(self.rows, block).cholesky()?;
            value -= 2.0 * factor.l_dirty().diagonal().iter().map(|entry| entry.ln()).sum::<f64>();
        }
        let variance = self.room.map(|room| (point.moments[self.blocks * block_size(self.rows)], room));
        let conditions = variance.map(|(variance, room)| [variance, room - variance]);
        for condition in conditions.into_iter().flatten().chain(self.wall.as_ref().map(|wall| wall.distance(point))) {
            value -= (condition > 0.0).then(|| condition.ln())?;
        }
        for (tet, &delta) in self.tets.iter().zip(&point.deltas) {
            value += tet.barrier(&point.moments, delta, point.slack, level, None)?;
        }
        value.is_finite().then_some(value)
    }

    fn centre(&mut self, cancel: &Cancel) -> bool {
        let Some(mut value) = self.barrier(&self.point, &self.level) else { return false };
        for _ in 0..STEPS {
            if cancel.is_due() {
                return false;
            }
            let Some((step, slope)) = self.newton_step() else { return false };
            if -slope < 2.0 * CENTRED {
                return true;
            }
            let total = value - self.weight * self.point.slack;
            let objective = |point: &Point| Some(self.barrier(point, &self.level)? - self.weight * point.slack);
            // The better one of the two ways to go that far.
            let at = |length: f64| {
                let ways = [false, true].into_iter().filter_map(|curved| {
                    let next = self.point.moved(&step, length, self, curved);
                    objective(&next).map(|reached| (next, reached))
                });
                ways.reduce(|a, b| if b.1 < a.1 { b } else { a })
            };
            let mut best: Option<(Point, f64)> = None;
            let mut length = 1.0;
            for _ in 0..HALVINGS {
                best = at(length).filter(|(_, reached)| *reached <= total + ARMIJO * length * slope);
                if best.is_some() {
                    break;
                }
                length *= 0.5;
            }
            // Far from the path, where a whole step is but a doubling of what is too small, longer ones may do.
            while let Some((_, reached)) = best.as_ref().filter(|_| length >= 1.0 && -slope > 1.0) {
                length *= 2.0;
                match at(length).filter(|(_, further)| further < reached) {
                    Some(further) => best = Some(further),
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
        let moments = self.point.moments.len();
        let count = moments + self.tets.len() + 1;
        let mut gradient = DVector::zeros(count);
        let mut hessian = DMatrix::zeros(count, count);
        let pairs: Vec<(usize, usize)> = (0..self.rows).flat_map(|j| (0..=j).map(move |i| (i, j))).collect();
        for (block, first) in self.weights().enumerate() {
            let inverse = self.point.matrix(self.rows, block).cholesky()?.inverse();
            for (column, &(k, l)) in pairs.iter().enumerate() {
                let twice = if k == l { 1.0 } else { 2.0 };
                gradient[first + column] -= twice * inverse[(k, l)];
                let (at_k, at_l) = (inverse.column(k), inverse.column(l));
                for (row, &(i, j)) in pairs.iter().enumerate().skip(column) {
                    let factor = if i == j { 0.5 * twice } else { twice };
                    hessian[(first + row, first + column)] = factor * (at_k[i] * at_l[j] + at_l[i] * at_k[j]);
                }
            }
        }
        if let Some(room) = self.room {
            let (place, variance) = (moments - 1, self.point.moments[moments - 1]);
            let [low, high] = [1.0 / variance, 1.0 / (room - variance)];
            gradient[place] += high - low;
            hessian[(place, place)] += low * low + high * high;
        }
        if let Some(wall) = &self.wall {
            let inverse = 1.0 / wall.distance(&self.point);
            gradient[wall.place] -= wall.outwards * inverse;
            gradient[count - 1] += inverse;
            hessian[(wall.place, wall.place)] += inverse * inverse;
            hessian[(count - 1, wall.place)] -= wall.outwards * inverse * inverse;
            hessian[(count - 1, count - 1)] += inverse * inverse;
        }
        for (index, (tet, &delta)) in self.tets.iter().zip(&self.point.deltas).enumerate() {
            let mut local = Derivatives::zero();
            tet.barrier(&self.point.moments, delta, self.point.slack, &self.level, Some(&mut local))?;
            let places = tet.moments().iter().copied().chain([moments + index, count - 1]);
            let places: Vec<usize> = places.collect();
            let figures = tet.map().nrows();
            let mut map = DMatrix::zeros(ARGUMENTS, places.len());
            map.view_mut((0, 0), tet.map().shape()).copy_from(tet.map());
            (map[(figures, places.len() - 2)], map[(figures + 1, places.len() - 1)]) = (1.0, 1.0);
            let slopes = map.tr_mul(&local.gradient);
            let curvatures = map.tr_mul(&(local.hessian * &map));
            for (column, &to) in places.iter().enumerate() {
                gradient[to] += slopes[column];
                for (row, &from) in places.iter().enumerate().filter(|(_, from)| **from >= to) {
                    hessian[(from, to)] += curvatures[(row, column)];
                }
            }
        }
        // The first moment is 1 less the other blocks' weights.
        let others: Vec<usize> = self.weights().skip(1).collect();
        let (first_slope, first_column) = (gradient[0], hessian.column(0).into_owned());
        for &column in &others {
            gradient[column] -= first_slope;
            for row in 1..count {
                let (low, high) = (row.min(column), row.max(column));
                hessian[(high, low)] -= first_column[row];
                if row == column {
                    hessian[(row, row)] -= first_column[row];
                }
            }
        }
        for (index, &column) in others.iter().enumerate() {
            for &row in &others[index..] {
                hessian[(row, column)] += first_column[0];
            }
        }
        let (mut gradient, mut hessian) = (gradient.remove_row(0), hessian.remove_row(0).remove_column(0));
        let count = count - 1;
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

/// Number of moments of a matrix Z.
fn block_size(rows: usize) -> usize {
    rows * (rows + 1) / 2
}

/// The weights of the corners of a box that give a point inside, the variance of that mixture and the largest there is in the box.
fn mixture(point: &Vec3, [low, high]: [Vec3; 2]) -> Option<(Vec<f64>, [f64; 2])> {
    let share = (point - low).component_div(&(high - low));
    let weights = (0..8).map(|corner| {
        (0..3).map(|axis| if corner >> axis & 1 == 0 { 1.0 - share[axis] } else { share[axis] }).product::<f64>()
    });
    let spread = (point - low).dot(&(high - point));
    let inside = share.iter().all(|share| *share > 0.0 && *share < 1.0);
    inside.then(|| (weights.collect(), [spread, 0.25 * (high - low).norm_squared()]))
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

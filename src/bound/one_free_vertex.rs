//! The least dilatation of tets that share their one free vertex, from below and above.

use nalgebra::{Matrix4, Vector4};

use super::Kind;
use super::check::free_vertex::{Limit, Term, Tet, excluded};
use super::check::{Point, accepted};
use crate::domain::Domain;
use crate::linalg::interval::Interval;
use crate::linalg::{QuadraticProgram, svd};
use crate::mesh::{Mat3, TetId, Vec3, VertexId, edge_matrix};

/// Relative distance of the two ends at which the search is done.
const ACCURACY: f64 = 1e-7;
/// Residual at which a linear program is solved.
const PROGRAM_ACCURACY: f64 = 1e-12;
/// Fall in the cube root of K promised by a linear program below which nothing more comes of it.
const LEAST_GAIN: f64 = 1e-11;
/// Most linear programs for one vertex; 10 to 30 are usual.
const MOST_PROGRAMS: usize = 60;
/// Most cuts a linear program keeps, the tightest ones.
const MOST_CUTS: usize = 160;
/// Side of the cube, in units of the star's size, in which a start is looked for.
const START_BOX: f64 = 4.0;
/// Condition of a domain tet's edges beyond which it is left out: nothing would remain of its inequalities.
const WORST_CONDITION: f64 = 1e12;

/// The tets at one free vertex whose other three vertices are fixed, as functions of the image position q of the vertex.
///
/// Positions are relative to the mean of the fixed vertices' images, in units of the largest distance from it. Each tet's
/// domain is scaled, which changes no dilatation, so that `A(q) = matrix + q gradient^T` has a unit gradient.
pub(super) struct FreeVertex {
    tets: Vec<FixedFace>,
    start: Option<Vec3>,
}

struct FixedFace {
    /// The tet's corners in the domain, the positions of the fixed ones in the image, and which is free.
    corners: [Point; 4],
    image: [Vec3; 4],
    free: usize,
    /// The factor by which A is larger here than between these positions.
    scale: f64,
    matrix: Mat3,
    gradient: Vec3,
    /// Least and largest stretch of an edge of the fixed face.
    stretches: [f64; 2],
    /// The distances in the domain of the free vertex from the three fixed ones; least.
    nearest: f64,
}

/// `at_zero + slope . q`.
#[derive(Clone, Copy)]
struct Affine {
    at_zero: f64,
    slope: Vec3,
}

impl Affine {
    fn at(&self, q: &Vec3) -> f64 {
        self.at_zero + self.slope.dot(q)
    }
}

/// The inequality `left(q) <= kappa right(q)` that holds wherever a tet's dilatation is at most kappa^3.
#[derive(Clone, Copy)]
struct Cut {
    left: Affine,
    right: Affine,
    /// The right side is at least this where the determinant is positive.
    least: f64,
    tet: usize,
    origin: Origin,
}

/// How a cut came about; e is the determinant at the position tried.
#[derive(Clone, Copy)]
enum Origin {
    Outer { u: Vec3, v: Vec3, e: f64 },
    Inner { u: Vec3, v: Vec3, e: f64 },
    Wall,
}

impl Origin {
    /// The inequality between the positions as they are given, with the tangent for kappa^3, and what its multiplier becomes, for a
    /// factor `scale` between the maps.
    fn limit(self, kappa: f64, scale: f64) -> (Limit, f64) {
        match self {
            Self::Outer { u, v, e } => {
                (Limit::Outer { u, v, b: kappa / (3.0 * e.cbrt().powi(2)) * scale.powi(2) }, scale)
            }
            Self::Inner { u, v, e } => {
                (Limit::Inner { u, v, b: 2.0 * kappa / (3.0 * e.cbrt()) * scale }, scale.powi(2))
            }
            Self::Wall => (Limit::Volume, scale.powi(3)),
        }
    }
}

/// What the search found.
pub(super) struct Least {
    /// Proved: no position has a smaller largest dilatation; 1 where nothing above the floor was accepted.
    pub lower: f64,
    /// Attained at `position`, up to rounding.
    #[cfg_attr(not(test), expect(dead_code, reason = "tests compare it with the lower end"))]
    pub upper: f64,
    /// What proves it.
    #[cfg_attr(not(test), expect(dead_code, reason = "tests prove it again in exact arithmetic"))]
    pub terms: Vec<Term>,
    /// Linear programs solved.
    pub programs: usize,
}

impl FreeVertex {
    /// The vertex and those of its tets whose other vertices are fixed, `image` holding the positions of these.
    ///
    /// A tet that is too thin or has a degenerate fixed face takes no part; nothing if an image position is not finite, or no
    /// tet is left.
    pub fn of(domain: &Domain, vertex: VertexId, tets: &[TetId], image: &[Vec3]) -> Option<Self> {
        let corners = |tet: TetId| domain.mesh().tets()[tet.index()];
        let mut fixed: Vec<VertexId> = tets.iter().flat_map(|&t| corners(t)).filter(|&v| v != vertex).collect();
        fixed.sort_unstable();
        fixed.dedup();
        let origin = fixed.iter().map(|v| image[v.index()]).sum::<Vec3>() / fixed.len() as f64;
        let size = fixed.iter().map(|v| (image[v.index()] - origin).norm()).fold(0.0, f64::max);
        if !(size > 0.0 && size.is_finite()) {
            return None;
        }
        let tets: Vec<FixedFace> = tets
            .iter()
            .filter_map(|&tet| {
                let ids = corners(tet);
                let free = ids.iter().position(|&v| v == vertex)?;
                let image = ids.map(|v| if v == vertex { origin } else { image[v.index()] });
                FixedFace::of(domain.enclosed_corners(tet), image, free, origin, size)
            })
            .collect();
        if tets.is_empty() {
            return None;
        }
        let mut result = Self { tets, start: None };
        result.start = result.natural_start();
        Some(result)
    }

    /// The largest K at the start that [`FreeVertex::least`] takes; infinite if a start has yet to be found.
    pub fn at_start(&self) -> f64 {
        self.start.map_or(f64::INFINITY, |q| self.value(Kind::K, &q).powi(3))
    }

    /// Encloses the least value over q of the largest dilatation of that kind, less tightly where it is found not to exceed
    /// `floor`; nothing if no position with positive determinants is found.
    ///
    /// **Theorem**. With three vertices fixed, A, its adjugate and det A are affine in q, and where det > 0
    /// `K_O <= kappa^3` means `|A| <= kappa det^(1/3)` and `K_I <= kappa^3` means `|adj A| <= kappa det^(2/3)`: a convex
    /// function is at most a concave one. So the sets {K <= k} are convex, and for all unit vectors u, v and all e > 0 each
    /// lies in the half-space
    ///
    /// ```text
    /// u . A(q) v     <= kappa e^(1/3) (2 + det A(q) / e) / 3        for K_O
    /// u . adj A(q) v <= kappa e^(2/3) (1 + 2 det A(q) / e) / 3      for K_I
    /// ```
    ///
    /// (on the right the tangent of a concave power at e). Multipliers >= 0 for which the combination of such
    /// inequalities is violated at every point of a ball that contains {K <= k} prove that this set is empty. Such a ball:
    /// in a tet with H = s1 / s3, the distance of q from a fixed vertex is at most s1 times that in the domain, and
    /// s1 <= H s3 <= H times the stretch of any fixed edge, where `H <= k^(2/3)` (for one of K_I and K_O alone, H <= k).
    ///
    /// **Method**. Cutting planes: the half-spaces with the singular vectors and determinants at the positions tried, a
    /// linear program for the next position and the multipliers. All of that is in floats and only a suggestion: the lower
    /// end is what [`excluded`] accepts of the vectors, tangents and multipliers.
    pub fn least(&self, kind: Kind, floor: f64) -> Option<Least> {
        let mut best = self.start.or_else(|| self.interior_point())?;
        let mut upper = self.value(kind, &best);
        let (mut lower, mut programs, mut witness) = (1.0f64, 0, Vec::new());
        let mut cuts = self.cuts(kind, &best, 0.0);
        let walls: Vec<Cut> = self.tets.iter().enumerate().map(|(i, tet)| tet.wall(i, kind, upper)).collect();
        while programs < MOST_PROGRAMS && lower.powi(3) < upper.powi(3) * (1.0 - ACCURACY) {
            if upper.powi(3) <= floor {
                break;
            }
            programs += 1;
            let radius = self.radius(kind, upper);
            let Some((mut step, model, multipliers)) = next(&cuts, &walls, &best, upper, radius) else { break };
            let combination = || cuts.iter().chain(&walls).zip(multipliers.iter().copied());
            let suggested = suggestion(combination(), upper, radius);
            if suggested > lower {
                lower = suggested;
                // The tangents stay those of `upper`, with which the slopes cancel.
                let term = |(cut, multiplier): (&Cut, f64)| {
                    let (limit, unit) = cut.origin.limit(upper, self.tets[cut.tet].scale);
                    Term { tet: cut.tet, limit, multiplier: multiplier * unit }
                };
                witness = combination().filter(|(_, multiplier)| *multiplier > 0.0).map(term).collect();
            }
            if model > -LEAST_GAIN {
                break;
            }
            // The solver may overstep a wall by its tolerance.
            while !self.value(kind, &(best + step)).is_finite() && step.norm() > f64::EPSILON {
                step *= 0.5;
            }
            let tried = best + step;
            let value = self.value(kind, &tried);
            if !value.is_finite() {
                break;
            }
            if cuts.len() > MOST_CUTS {
                cuts.sort_by(|a, b| {
                    let slack = |cut: &Cut| cut.right.at(&tried) * upper - cut.left.at(&tried);
                    slack(a).total_cmp(&slack(b))
                });
                cuts.truncate(MOST_CUTS / 2);
            }
            cuts.extend(self.cuts(kind, &tried, upper + model));
            if value < upper {
                (best, upper) = (tried, value);
            }
        }
        let terms = witness;
        let lower = self.accepted(kind, lower.powi(3), floor, &terms).unwrap_or(1.0);
        Some(Least { lower, upper: upper.powi(3), terms, programs })
    }

    /// The largest level near `guess` that the terms prove no position to have.
    fn accepted(&self, kind: Kind, guess: f64, floor: f64, witness: &[Term]) -> Option<f64> {
        if guess <= floor {
            return None;
        }
        let tets = self.tets.iter().enumerate();
        let tets = tets.filter_map(|(index, tet)| Some((index, Tet::of(tet.corners, tet.image, tet.free)?)));
        let (kept, tets): (Vec<usize>, Vec<Tet>) = tets.unzip();
        let kept = |term: &Term| Some(Term { tet: kept.binary_search(&term.tet).ok()?, ..*term });
        let terms: Vec<Term> = witness.iter().filter_map(kept).collect();
        accepted(guess, floor, |level| excluded(&tets, kind, level, &terms))
    }

    /// The cube root of the largest dilatation at q; infinite where a determinant is not positive.
    fn value(&self, kind: Kind, q: &Vec3) -> f64 {
        self.tets.iter().map(|tet| tet.value(kind, q)).fold(0.0, f64::max)
    }

    /// The half-spaces by the singular vectors at q, of the tets whose dilatation exceeds kappa^3 there.
    fn cuts(&self, kind: Kind, q: &Vec3, kappa: f64) -> Vec<Cut> {
        let kinds: &[Kind] = match kind {
            Kind::K => &[Kind::Inner, Kind::Outer],
            Kind::Inner => &[Kind::Inner],
            Kind::Outer => &[Kind::Outer],
        };
        let pairs = (0..).zip(&self.tets).flat_map(|tet| kinds.iter().map(move |&kind| (tet, kind)));
        let above = pairs.filter(|((_, tet), kind)| tet.value(*kind, q) >= kappa);
        above.map(|((index, tet), kind)| tet.cut(index, kind, q)).collect()
    }

    /// Radius of a ball about 0 that contains all q with a dilatation of at most kappa^3.
    fn radius(&self, kind: Kind, kappa: f64) -> f64 {
        let ratio = largest_ratio(kind, kappa);
        let reach = self.tets.iter().map(|tet| ratio * tet.stretches[0] * tet.nearest).fold(f64::INFINITY, f64::min);
        1.0 + reach
    }

    /// The mean of the positions in which each tet alone has no shear and a normal stretch between those of its face.
    fn natural_start(&self) -> Option<Vec3> {
        let mean = self.tets.iter().map(FixedFace::natural).sum::<Vec3>() / self.tets.len() as f64;
        self.value(Kind::K, &mean).is_finite().then_some(mean)
    }

    /// A position with positive determinants, as deep inside as a linear program finds it.
    fn interior_point(&self) -> Option<Vec3> {
        let none = Affine { at_zero: 1.0, slope: Vec3::zeros() };
        let planes: Vec<Cut> = self
            .tets
            .iter()
            .map(|tet| {
                let det = tet.determinant();
                let scale = -1.0 / det.slope.norm();
                let left = Affine { at_zero: det.at_zero * scale, slope: det.slope * scale };
                Cut { left, right: none, least: 0.0, tet: 0, origin: Origin::Wall }
            })
            .collect();
        let (point, _, _) = next(&planes, &[], &Vec3::zeros(), 0.0, START_BOX)?;
        self.value(Kind::K, &point).is_finite().then_some(point)
    }
}

/// The largest s1 / s3 where the dilatation is at most kappa^3.
fn largest_ratio(kind: Kind, kappa: f64) -> f64 {
    if kind == Kind::K { kappa.powi(2) } else { kappa.powi(3) }
}

impl FixedFace {
    fn of(corners: [Point; 4], image: [Vec3; 4], free: usize, origin: Vec3, size: f64) -> Option<Self> {
        let face = crate::mesh::TetMesh::FACES[free];
        // Even permutations only, so that determinants keep their signs.
        let order = [free, face[0], face[1], face[2]];
        let (x, y) =
            (order.map(|i| Vec3::from(corners[i].map(Interval::middle))), order.map(|i| (image[i] - origin) / size));
        let edges = edge_matrix(x);
        let inverse = edges.try_inverse()?;
        let condition = edges.norm() * inverse.norm();
        // The barycentric coordinate of the free vertex is 1 minus the three others.
        let gradient = -(inverse.row(0) + inverse.row(1) + inverse.row(2)).transpose();
        let scale = 1.0 / gradient.norm();
        // With the free vertex at 0 the edges from it are the fixed positions themselves.
        let matrix = Mat3::from_columns(&[y[1], y[2], y[3]]) * inverse * scale;
        let gradient = gradient * scale;
        let sides = [(1, 2), (2, 3), (3, 1)].map(|(i, j)| (y[i] - y[j]).norm() / (x[i] - x[j]).norm() * scale);
        let stretches = [sides.into_iter().fold(f64::INFINITY, f64::min), sides.into_iter().fold(0.0, f64::max)];
        let nearest = [1, 2, 3].map(|i| (x[i] - x[0]).norm() / scale).into_iter().fold(f64::INFINITY, f64::min);
        let thick = condition < WORST_CONDITION && edges.determinant() > 0.0;
        let usable = thick && stretches[0] > 0.0 && stretches[1].is_finite() && nearest.is_finite();
        let scale = scale / size;
        usable.then_some(Self { corners, image, free, scale, matrix, gradient, stretches, nearest })
    }

    fn jacobian(&self, q: &Vec3) -> Mat3 {
        self.matrix + q * self.gradient.transpose()
    }

    /// The cube root of a dilatation, infinite where the determinant is not positive.
    fn value(&self, kind: Kind, q: &Vec3) -> f64 {
        let [s1, s2, s3] = svd(&self.jacobian(q)).values;
        let det = s1 * s2 * s3;
        if det.is_nan() || det <= 0.0 {
            return f64::INFINITY;
        }
        let (inner, outer) = (det.cbrt() / s3, s1 / det.cbrt());
        match kind {
            Kind::Inner => inner,
            Kind::Outer => outer,
            Kind::K => inner.max(outer),
        }
    }

    /// det A(q), by the matrix determinant lemma.
    fn determinant(&self) -> Affine {
        let [a, b, c] = [0, 1, 2].map(|i| self.matrix.column(i).into_owned());
        let g = &self.gradient;
        Affine { at_zero: self.matrix.determinant(), slope: b.cross(&c) * g.x + c.cross(&a) * g.y + a.cross(&b) * g.z }
    }

    /// The half-space by the singular vectors and the determinant at q.
    fn cut(&self, tet: usize, kind: Kind, q: &Vec3) -> Cut {
        let decomposition = svd(&self.jacobian(q));
        let [s1, s2, s3] = decomposition.values;
        let e = s1 * s2 * s3;
        let det = self.determinant();
        let (left, power, parts, origin) = if kind == Kind::Outer {
            let [u, v] = [decomposition.left, decomposition.right].map(|vectors| vectors.column(0).into_owned());
            let left = Affine { at_zero: u.dot(&(self.matrix * v)), slope: u * self.gradient.dot(&v) };
            (left, e.cbrt(), [2.0, 1.0], Origin::Outer { u, v, e })
        } else {
            let [u, v] = [decomposition.left, decomposition.right].map(|vectors| vectors.column(2).into_owned());
            (self.adjugate_form(&v, &u), e.cbrt().powi(2), [1.0, 2.0], Origin::Inner { u, v, e })
        };
        let [constant, linear] = [power * parts[0] / 3.0, power * parts[1] / (3.0 * e)];
        let right = Affine { at_zero: constant + linear * det.at_zero, slope: det.slope * linear };
        Cut { left, right, least: constant, tet, origin }
    }

    /// u . adj A(q) v; the rows of the adjugate are the cross products of A's columns.
    fn adjugate_form(&self, u: &Vec3, v: &Vec3) -> Affine {
        let column = |i: usize| self.matrix.column(i % 3).into_owned();
        let mut form = Affine { at_zero: 0.0, slope: Vec3::zeros() };
        for i in 0..3 {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            form.at_zero += u[i] * column(j).cross(&column(k)).dot(v);
            form.slope += (column(k).cross(v) * self.gradient[j] + v.cross(&column(j)) * self.gradient[k]) * u[i];
        }
        form
    }

    /// `det >= (s1 / H)^2 s1`, hence at least that of the largest stretch of a fixed edge, as an inequality without kappa.
    fn wall(&self, tet: usize, kind: Kind, kappa: f64) -> Cut {
        let det = self.determinant();
        let least = self.stretches[1].powi(3) / largest_ratio(kind, kappa).powi(2);
        let left = Affine { at_zero: least - det.at_zero, slope: -det.slope };
        Cut { left, right: Affine { at_zero: 0.0, slope: Vec3::zeros() }, least: 0.0, tet, origin: Origin::Wall }
    }

    /// The position without shear whose normal stretch is the geometric mean of the face's least and largest.
    fn natural(&self) -> Vec3 {
        // A(q) n with n the unit normal of the face, which is the gradient: A(q) n = matrix n + q.
        let normal = svd(&(self.matrix * (Mat3::identity() - self.gradient * self.gradient.transpose())))
            .left
            .column(2)
            .into_owned();
        let stretch = (self.stretches[0] * self.stretches[1]).sqrt();
        let apart = self.matrix * self.gradient;
        let [one, other] = [normal, -normal].map(|normal| normal * stretch - apart);
        if self.value(Kind::K, &one) <= self.value(Kind::K, &other) { one } else { other }
    }
}

/// The step from `best` to the minimum of the largest `left - kappa right`, each in units of its right side at `best`,
/// beyond no wall; that minimum, and the multipliers of cuts and walls. Nothing where numbers are not finite.
fn next(cuts: &[Cut], walls: &[Cut], best: &Vec3, kappa: f64, radius: f64) -> Option<(Vec3, f64, Vec<f64>)> {
    let (mut rows, mut bounds, mut units): (Vec<Vector4<f64>>, Vec<f64>, Vec<f64>) = Default::default();
    for (index, cut) in cuts.iter().chain(walls).enumerate() {
        let is_cut = index < cuts.len();
        let unit = if is_cut { cut.right.at(best) } else { cut.left.slope.norm() };
        let slope = (cut.left.slope - cut.right.slope * kappa) / unit;
        rows.push(slope.push(if is_cut { -1.0 } else { 0.0 }));
        bounds.push((kappa * cut.right.at(best) - cut.left.at(best)) / unit);
        units.push(unit);
    }
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            rows.push(Vector4::ith(axis, sign));
            bounds.push(radius - sign * best[axis]);
        }
    }
    let (quadratic, linear) = (Matrix4::zeros(), Vector4::new(0.0, 0.0, 0.0, 1.0));
    // Whatever accuracy is reached: the multipliers have to prove their bound, and the step has to lower K.
    let optimum = QuadraticProgram { quadratic, linear, rows: &rows, bounds: &bounds }.solve(PROGRAM_ACCURACY);
    let multipliers = optimum.multipliers.iter().zip(units).map(|(z, unit)| z / unit).collect();
    optimum.residual.is_finite().then(|| (optimum.point.xyz(), optimum.point.w, multipliers))
}

/// A kappa below which, but for rounding, no point of the ball with positive determinants satisfies all inequalities; 0 if the
/// multipliers suggest none.
///
/// Let -e be the least value in the ball of the combination of `left - kappa_0 right`. Where the inequalities hold for some
/// kappa, the combination of `left - kappa right` is at most 0, hence (kappa_0 - kappa) times that of `right` at most e.
fn suggestion<'a>(combination: impl Iterator<Item = (&'a Cut, f64)>, kappa: f64, radius: f64) -> f64 {
    let mut sum = Affine { at_zero: 0.0, slope: Vec3::zeros() };
    let mut least = 0.0;
    for (cut, multiplier) in combination {
        sum.at_zero += (cut.left.at_zero - kappa * cut.right.at_zero) * multiplier;
        sum.slope += (cut.left.slope - cut.right.slope * kappa) * multiplier;
        least += cut.least * multiplier;
    }
    let excess = sum.slope.norm() * radius - sum.at_zero;
    let suggested = kappa - excess.max(0.0) / least;
    if suggested > 0.0 { suggested } else { 0.0 }
}

#[cfg(test)]
mod tests;

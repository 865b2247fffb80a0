//! Upper bounds, in intervals, for the dilatations of one tet's map followed by the radial map in one direction.

use crate::linalg::interval::{Interval, cross, difference, dot, exact_vector, norm_squared};
use crate::linalg::svd;
use crate::mesh::{Mat3, Vec3};

/// A matrix by rows.
type Matrix = [[Interval; 3]; 3];
/// A matrix and its inverse.
pub(super) type Pair = [Matrix; 2];

/// Upper bounds of `|M J det X|` and `|J^-1 M^-1 det Y|` in one direction.
pub(super) type Norms = [f64; 2];

/// The linear map J of one tet, up to factors: with the edge matrices X of the domain and Y of the image,
/// `J det X = Y adj X` and `J^-1 det Y = X adj Y`.
pub(super) struct TetMap {
    /// `J det X`.
    forward: Matrix,
    /// `J^-1 det Y`.
    backward: Matrix,
    /// Upper bounds of the norms of both.
    norms: Norms,
    /// `K_O = |J det X|^3 / (det X^2 det Y)` and `K_I = |J^-1 det Y|^3 / (det Y^2 det X)`: the factors, rounded up.
    factors: [f64; 2],
}

impl TetMap {
    /// The map that takes the corners of a tet, as exact numbers, to those of its image; its bounds are infinite where
    /// intervals do not tell that both volumes are positive.
    pub fn new(domain: &[Vec3; 4], image: &[Vec3; 4]) -> Self {
        Self::with(domain, image, norm)
    }

    /// Whether K of that map may be larger than `k`: false is proved. Costs a tenth of [`TetMap::new`], since no matrix is decomposed.
    pub fn may_exceed(domain: &[Vec3; 4], image: &[Vec3; 4], k: f64) -> bool {
        let map = Self::with(domain, image, |_| 0.0);
        // K_O <= k and K_I <= k where both norms are at most the cube roots of k over the factors. Those are rounded, and so
        // are checked.
        let most = map.factors.map(|factor| (k / factor).cbrt() * (1.0 - 1e-12));
        let is_low = |(b, norm): (&Matrix, f64)| norm_is_below(b, norm);
        !(map.largest(most, 0.0) <= k && [(&map.forward, most[0]), (&map.backward, most[1])].into_iter().all(is_low))
    }

    fn with(domain: &[Vec3; 4], image: &[Vec3; 4], norm: impl Fn(&Matrix) -> f64) -> Self {
        let [x, y] = [domain, image].map(edges_by_columns);
        let [adjugate_x, adjugate_y] = [x, y].map(|[a, b, c]| [cross(b, c), cross(c, a), cross(a, b)]);
        let [det_x, det_y] = [dot(x[0], adjugate_x[0]), dot(y[0], adjugate_y[0])];
        let [forward, backward] = [product(&transposed(&y), &adjugate_x), product(&transposed(&x), &adjugate_y)];
        let factor = |square: Interval, det: Interval| match (square * square * det).reciprocal() {
            Some(factor) if square.lower > 0.0 && det.lower > 0.0 => factor.upper,
            _ => f64::INFINITY,
        };
        let factors = [factor(det_x, det_y), factor(det_y, det_x)];
        Self { norms: [norm(&forward), norm(&backward)], forward, backward, factors }
    }

    /// The maps that take the place of this one where its cone is warped with an exponent p: `J (I + (p-1) u n^T)` at the projection
    /// u of each of some corners, with `(I + (p-1) u n^T)^-1 = I + (1/p - 1) u n^T` and determinant p (see [`crate::map::corner`]).
    /// Whatever linear map follows, the largest K over the points that the warp takes to the hull of the corners and the apex is
    /// that of one of them.
    pub fn warped(&self, warp: &ExactWarp, corners: &[[Interval; 3]]) -> Vec<Self> {
        let at = |corner: &[Interval; 3]| {
            let unknown = [[[Interval::WHOLE; 3]; 3]; 2];
            let [factor, inverse] = warp.factors(&[0, 1, 2].map(|i| corner[i] - warp.apex[i])).unwrap_or(unknown);
            let [forward, backward] = [product(&self.forward, &factor), product(&inverse, &self.backward)];
            Self { norms: [norm(&forward), norm(&backward)], forward, backward, ..self.with_exponent(warp) }
        };
        corners.iter().map(at).collect()
    }

    /// The same map, as part of one whose determinant is p times as large.
    pub fn with_exponent(&self, warp: &ExactWarp) -> Self {
        let power = Interval::exactly(warp.exponent);
        let inverse = power.reciprocal().unwrap_or(Interval::WHOLE);
        let factors = [(self.factors[0] * inverse.upper).next_up(), (self.factors[1] * power.upper).next_up()];
        Self { factors, ..*self }
    }

    /// The norms of this map between a radial map and a warp, and those of the inverse.
    pub fn between(&self, [shear, unsheared]: &Pair, [factor, undone]: &Pair) -> Norms {
        let forward = product(shear, &product(&self.forward, factor));
        [norm(&forward), norm(&product(undone, &product(&self.backward, unsheared)))]
    }

    /// Upper bounds of the norms of the map and of its inverse.
    pub fn norms(&self) -> Norms {
        self.norms
    }

    /// The map and its inverse, rounded.
    pub fn middles(&self) -> (Mat3, Mat3) {
        let rounded = |matrix: &Matrix| Mat3::from_fn(|i, j| matrix[i][j].middle());
        (rounded(&self.forward), rounded(&self.backward))
    }

    /// Upper bound of the tet's own K, before the radial map.
    pub fn k(&self) -> f64 {
        self.largest(self.norms, 0.0)
    }

    /// The norms in one direction, as an exact vector of any length, of the radial map on the cone over a plane with this normal, away from 0.
    pub fn at(&self, normal: &[Interval; 3], direction: &Vec3) -> Norms {
        let Some([shear, inverse]) = shears(normal, &exact_vector(direction)) else { return [f64::INFINITY; 2] };
        [norm(&product(&shear, &self.forward)), norm(&product(&self.backward, &inverse))]
    }

    /// Upper bound of K where the norms exceed `norms` by at most the part `excess` of those of the tet's own map.
    pub fn largest(&self, norms: Norms, excess: f64) -> f64 {
        let k = |side: usize| {
            let norm = (norms[side] + (excess * self.norms[side]).next_up()).next_up();
            let square = (norm * norm).next_up();
            ((square * norm).next_up() * self.factors[side]).next_up()
        };
        // NaN, of zero times infinity, is no bound.
        let [outer, inner] = [0, 1].map(k).map(|k| if k.is_nan() { f64::INFINITY } else { k });
        outer.max(inner)
    }
}

/// The warp of a cone with a known apex and exponent.
#[derive(Clone, Copy)]
pub(super) struct ExactWarp {
    apex: [Interval; 3],
    /// A normal of the plane of the base, of any length.
    normal: [Interval; 3],
    exponent: f64,
}

impl ExactWarp {
    /// The warp of the cone with this apex over a triangle.
    pub fn new(apex: &Vec3, [a, b, c]: [&Vec3; 3], exponent: f64) -> Self {
        let normal = cross(difference(b, a), difference(c, a));
        Self { apex: exact_vector(apex), normal, exponent }
    }

    /// The exponent p.
    pub fn exponent(&self) -> f64 {
        self.exponent
    }

    /// The normal of the plane of the base.
    pub fn normal(&self) -> [Interval; 3] {
        self.normal
    }

    /// x - v for the point with some weights of some points.
    pub fn offset(&self, points: &[Vec3; 4], weights: &[f64; 4]) -> [Interval; 3] {
        let term = |axis: usize, (point, weight): (&Vec3, &f64)| {
            (Interval::exactly(point[axis]) - self.apex[axis]) * Interval::exactly(*weight)
        };
        [0, 1, 2].map(|axis| points.iter().zip(weights).map(|pair| term(axis, pair)).sum())
    }

    /// I + (p-1) u n^T and its inverse for an offset from the apex, of any length; none if its height may be 0.
    pub fn factors(&self, offset: &[Interval; 3]) -> Option<Pair> {
        let power = Interval::exactly(self.exponent);
        // u n^T = offset normal^T / normal.offset, whatever the length of the normal.
        let over = dot(self.normal, *offset).reciprocal()?;
        let factor = |share: Interval| {
            let unit = |i: usize, j: usize| Interval::exactly(f64::from(u8::from(i == j)));
            [0, 1, 2].map(|i| [0, 1, 2].map(|j| unit(i, j) + share * offset[i] * self.normal[j] * over))
        };
        Some([factor(power - Interval::ONE), factor(power.reciprocal()? - Interval::ONE)])
    }
}

/// The differences of a tet's corners to its first one.
fn edges_by_columns(corners: &[Vec3; 4]) -> Matrix {
    let [origin, ends @ ..] = corners.map(|p| <[f64; 3]>::from(p).map(Interval::exactly));
    ends.map(|end| [0, 1, 2].map(|i| end[i] - origin[i]))
}

/// `M = I + u v^T` and its inverse `I - u v^T` for the radial map on the cone over a plane with this normal, see [`super`]; none if
/// rounding could turn the direction out of the plane's half-space.
pub(super) fn shears(normal: &[Interval; 3], direction: &[Interval; 3]) -> Option<Pair> {
    let y = *direction;
    let along = dot(*normal, y);
    if along.lower <= 0.0 {
        return None;
    }
    // u v^T = y n^T / (n.y) - y y^T / |y|^2
    let (along, square) = (along.reciprocal()?, dot(y, y).reciprocal()?);
    let v = [0, 1, 2].map(|j| normal[j] * along - y[j] * square);
    let entry = |i: usize, j: usize| y[i] * v[j];
    let unit = |i: usize, j: usize| Interval::exactly(f64::from(u8::from(i == j)));
    let shear = |sign: fn(Interval) -> Interval| [0, 1, 2].map(|i| [0, 1, 2].map(|j| unit(i, j) + sign(entry(i, j))));
    Some([shear(|x| x), shear(|x| -x)])
}

/// Upper bound of the largest singular value of the radial map on the cone over a plane with this normal, in one direction:
/// sigma with sigma - 1 / sigma = tan gamma, see [`super`]; infinite as [`shears`] has none.
pub(super) fn stretch(normal: &[Interval; 3], direction: &Vec3) -> f64 {
    let y = exact_vector(direction);
    let along = dot(*normal, y);
    let Some(over) = along.reciprocal().filter(|_| along.lower > 0.0) else { return f64::INFINITY };
    let tangent = norm_squared(cross(*normal, y)).sqrt() * over;
    let four = Interval::exactly(4.0);
    ((tangent + (tangent.square() + four).sqrt()) * Interval::exactly(0.5)).upper
}

fn transposed(a: &Matrix) -> Matrix {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| a[j][i]))
}

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    a.map(|row| [0, 1, 2].map(|j| row[0] * b[0][j] + row[1] * b[1][j] + row[2] * b[2][j]))
}

/// Upper bound of the largest singular value of a matrix B.
///
/// V is any matrix near the right singular vectors, taken as exact. With `G = (B V)^T (B V)` and `D = V^T V - I` every x = V z
/// has `|B x|^2 = z^T G z <= g |z|^2` and `|x|^2 >= (1 - d) |z|^2`, g and d the largest sums of absolute values in a row of G
/// and D (Gershgorin). So `|B|^2 <= g / (1 - d)` if d < 1, when V is invertible.
fn norm(b: &Matrix) -> f64 {
    let middle = Mat3::from_fn(|i, j| b[i][j].middle());
    if !middle.iter().all(|x| x.is_finite()) {
        return f64::INFINITY;
    }
    let right = svd(&middle).right;
    let v: Matrix = [0, 1, 2].map(|i| [0, 1, 2].map(|j| Interval::exactly(right[(i, j)])));
    let columns = transposed(&product(b, &v));
    let mut defect = gram(&transposed(&v));
    (0..3).for_each(|i| defect[i][i] = defect[i][i] - Interval::ONE);
    let room = Interval::ONE - Interval::exactly(largest_row(&defect));
    match room.reciprocal() {
        Some(over) if room.lower > 0.0 => (largest_row(&gram(&columns)) * over.upper).next_up().sqrt().next_up(),
        _ => f64::INFINITY,
    }
}

/// Whether the largest singular value of B is proved to be less than a number: t^2 - B B^T is positive definite, by the signs of
/// its leading minors (Sylvester).
fn norm_is_below(b: &Matrix, t: f64) -> bool {
    let square = Interval::exactly(t).square();
    let mut rest = gram(b).map(|row| row.map(|x| -x));
    (0..3).for_each(|i| rest[i][i] = square + rest[i][i]);
    let [first, second, third] = rest;
    let minors = [first[0], first[0] * second[1] - first[1].square(), dot(first, cross(second, third))];
    minors.iter().all(|minor| minor.lower > 0.0)
}

/// The scalar products of three vectors.
fn gram(&[a, b, c]: &Matrix) -> Matrix {
    let [ab, bc, ca] = [dot(a, b), dot(b, c), dot(c, a)];
    [[dot(a, a), ab, ca], [ab, dot(b, b), bc], [ca, bc, dot(c, c)]]
}

/// The largest sum of absolute values in a row, rounded up.
fn largest_row(a: &Matrix) -> f64 {
    let row = |row: &[Interval; 3]| row.iter().fold(0.0, |sum: f64, x| (sum + x.upper.max(-x.lower)).next_up());
    a.iter().map(row).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::super::cones::Cone;
    use super::*;
    use crate::dilatation::Dilatation;
    use crate::mesh::edge_matrix;
    use proptest::prelude::*;

    fn tet() -> impl Strategy<Value = [Vec3; 4]> {
        prop::array::uniform4(prop::array::uniform3(-1.0..1.0f64))
            .prop_map(|corners| corners.map(Vec3::from))
            .prop_filter("not thin", |corners| edge_matrix(*corners).determinant() > 1e-2)
    }

    proptest! {
        #[test]
        fn the_bound_is_that_of_the_decomposition_rounded_up(domain in tet(), image in tet(), direction in prop::array::uniform3(0.1..1.0f64)) {
            let jacobian = edge_matrix(image) * edge_matrix(domain).try_inverse().unwrap();
            let map = TetMap::new(&domain, &image);
            let own = Dilatation::of(&jacobian).k();
            // Conditions below 1e3, cubed.
            prop_assert!(map.k() >= own * (1.0 - 1e-9) && map.k() <= own * (1.0 + 1e-9), "{} {own}", map.k());
            prop_assert!(TetMap::may_exceed(&domain, &image, own * (1.0 - 1e-9)));
            prop_assert!(!TetMap::may_exceed(&domain, &image, own * (1.0 + 1e-9)));

            let corners = [Vec3::x(), Vec3::y(), Vec3::z()];
            let (normal, y) = (Cone::over(&corners).normal, Vec3::from(direction));
            // The radial map (x + y + z) / |.| of the plane's distance, differentiated by hand.
            let (n, u) = (Vec3::repeat(1.0), y.normalize());
            let radial = u * n.transpose() + (Mat3::identity() - u * u.transpose()) * n.dot(&u);
            let (bound, want) = (map.largest(map.at(&normal, &y), 0.0), Dilatation::of(&(radial * jacobian)).k());
            prop_assert!(bound >= want * (1.0 - 1e-9) && bound <= want * (1.0 + 1e-9), "{bound} {want}");
            // A shear with sigma - 1 / sigma = tan gamma.
            let tangent = n.cross(&u).norm() / n.dot(&u);
            let sigma = 0.5 * (tangent + (tangent * tangent + 4.0).sqrt());
            prop_assert!((stretch(&normal, &y) - sigma).abs() < 1e-12);
        }
    }

    #[test]
    fn a_tet_whose_volume_rounding_decides_is_bounded_by_nothing() {
        let good = [Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z()];
        let thin =
            [Vec3::zeros(), Vec3::repeat(0.1), Vec3::new(0.3, 0.3, 0.3 + 1e-17), Vec3::new(0.7, 0.7 + 1e-16, 0.7)];
        assert_eq!(TetMap::new(&thin, &good).k(), f64::INFINITY);
        assert_eq!(TetMap::new(&good, &thin).k(), f64::INFINITY);
        // Some 60 roundings by an ulp or two, cubed.
        assert!(TetMap::new(&good, &good).k() < 1.0 + 1e-13);
        assert!(TetMap::may_exceed(&good, &thin, f64::MAX) && TetMap::may_exceed(&good, &good, f64::NAN));
        assert!(!TetMap::may_exceed(&good, &good, 1.0 + 1e-9));
    }
}

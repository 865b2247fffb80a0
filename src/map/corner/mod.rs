//! Corner elements: piecewise-linear maps precomposed with a power of the distance from the corners of the solid.
//!
//! # Why
//!
//! A piecewise-linear map is homogeneous of degree one at a vertex v of the boundary, so that its K_I there is at least the
//! solid angle of the image over that of the domain, whatever the mesh and wherever its vertices go. A map that behaves at
//! v like r -> r^p need only have K_I p^2 at least that.
//!
//! # The warp
//!
//! Let a cone have its apex at v, and let t be the linear function that is 0 at v and 1 on the base of the cone, n its
//! gradient. For an exponent p > 0 the *warp* of the cone is
//!
//! ```text
//! w(x) = v + t(x)^(p-1) (x - v)          p = 1: the identity
//! ```
//!
//! It takes each ray from v to itself, monotonically, and t to t^p, so that the cone goes to itself, its apex and its base
//! stay where they are, and the inverse is the warp of exponent 1/p. On a side of the cone w depends on that side's t
//! alone. The map that a piecewise-linear map f becomes, F = f o w, is therefore continuous if the cones that meet in a
//! side have the same apex, the same t on the side and the same p; it is a homeomorphism if and only if f is, and the
//! images of the triangles of the boundary are those under f. A tet with a corner of the solid among its vertices, with t =
//! 1 on the face opposite to it, is such a cone by itself, the *corner element*, as long as no tet has two corners.
//!
//! # Theorem: the largest K is that of at most four matrices
//!
//! Let f have the Jacobian A on a tet T inside of the cone. With u = (x - v) / t(x), the projection of x - v from the apex
//! to the base,
//!
//! ```text
//! DF(x) = t^(p-1) N(u),     N(u) = A (I + (p-1) u n^T),     det N = p det A
//! ```
//!
//! and *the largest K_O, K_I and K of F over the points that w takes to T are attained at the projections u of vertices of
//! T*: at four points, at three if v itself is a vertex of T (it has no projection, and the others' span what T projects
//! to).
//!
//! Proof. The gradient of t^(p-1) is (p-1) t^(p-2) n, hence Dw = t^(p-1) I + (p-1) t^(p-2) (x - v) n^T, which is t^(p-1)
//! times I + (p-1) u n^T; a positive factor changes no dilatation. Since n.u = t / t = 1, the matrix determinant lemma
//! gives det(I + (p-1) u n^T) = 1 + (p-1) = p and the Sherman-Morrison formula the inverse I - ((p-1)/p) u n^T. So det N is
//! the same for all u, N is affine in u, and so is N^-1 = (I - ((p-1)/p) u n^T) A^-1. With |.| the spectral norm, K_O =
//! |N|^3 / det N and K_I = |N^-1|^3 det N, for |N| = s_1 and det N = s_1 s_2 s_3. A norm of an affine function is convex,
//! and so is its cube: K_O, K_I and their maximum are convex functions of u. x and w(x) have the same u, so u ranges over
//! the central projection of T to the plane t = 1, which is the convex hull of the projections of its vertices; a convex
//! function on a convex hull of points is largest at one of them. QED
//!
//! No bound is sampled, and to whoever minimizes K a warped tet is nothing but up to four ordinary ones with the same four
//! vertices, whose reference matrices are B (I + (p-1) u n^T) in place of B.

mod cones;
mod refined;

pub use cones::{Cone, CornerChoice, CornerError, Corners, Elements, solid_angles};
pub use refined::PiecewiseLinear;

use crate::dilatation::Dilatation;
use crate::mesh::{Mat3, Vec3};

/// The warp w(x) = v + t(x)^(p-1) (x - v) of a cone with the apex v, where t has the constant gradient n and vanishes at v.
///
/// Lengths are in the domain's units, the gradient in their inverse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Warp {
    apex: Vec3,
    gradient: Vec3,
    exponent: f64,
}

impl Warp {
    /// The warp of the cone with this apex over the triangle `base`, which lies in the plane t = 1; `None` if the plane goes
    /// through the apex, or the exponent is not a positive finite number.
    pub fn new(apex: Vec3, base: [Vec3; 3], exponent: f64) -> Option<Self> {
        if !(exponent > 0.0 && exponent.is_finite()) {
            return None;
        }
        let [a, b, c] = base;
        let normal = (b - a).cross(&(c - a));
        let gradient = normal / normal.dot(&(a - apex));
        gradient.iter().all(|x| x.is_finite()).then_some(Self { apex, gradient, exponent })
    }

    /// The corner element: the warp of a tet that has its own corner `apex` (0 to 3) for the apex.
    pub fn of_tet(corners: [Vec3; 4], apex: usize, exponent: f64) -> Option<Self> {
        let base = std::array::from_fn(|i| corners[(apex + 1 + i) % 4]);
        Self::new(corners[apex], base, exponent)
    }

    /// The same cone with another exponent, which must be positive.
    pub fn with_exponent(self, exponent: f64) -> Self {
        Self { exponent, ..self }
    }

    /// The exponent p.
    pub fn exponent(&self) -> f64 {
        self.exponent
    }

    /// n, the gradient of t.
    pub fn gradient(&self) -> &Vec3 {
        &self.gradient
    }

    /// t(x): 0 at the apex, 1 on the base.
    pub fn height(&self, x: &Vec3) -> f64 {
        self.gradient.dot(&(x - self.apex))
    }

    /// w(x) for a point of the cone.
    pub fn at(&self, x: &Vec3) -> Vec3 {
        self.scaled(x, self.exponent)
    }

    /// The point that goes to x.
    pub fn inverse(&self, x: &Vec3) -> Vec3 {
        self.scaled(x, 1.0 / self.exponent)
    }

    /// The point that goes to the mean of a tet's corners with these weights. For p > 1 it is farther from the apex: of a point next to the apex
    /// the coordinates, rounded, do not tell the direction, in which the weights are as good as their own rounding.
    pub fn inverse_of_mean(&self, corners: [Vec3; 4], weights: [f64; 4]) -> Vec3 {
        let offset: Vec3 = corners.iter().zip(weights).map(|(corner, weight)| (corner - self.apex) * weight).sum();
        self.apex + self.stretched(offset, 1.0 / self.exponent)
    }

    fn scaled(&self, x: &Vec3, exponent: f64) -> Vec3 {
        if exponent == 1.0 { *x } else { self.apex + self.stretched(x - self.apex, exponent) }
    }

    /// The offset from the apex that a warp gives to one.
    fn stretched(&self, offset: Vec3, exponent: f64) -> Vec3 {
        // Rounding may put a point of a side near the apex behind it.
        let height = self.gradient.dot(&offset).max(0.0);
        if height == 0.0 { offset } else { offset * height.powf(exponent - 1.0) }
    }

    /// I + (p-1) u n^T: the Jacobian of the warp at x up to a positive factor, for the projection u of x - v to the base.
    pub fn factor(&self, projection: &Vec3) -> Mat3 {
        Mat3::identity() + projection * self.gradient.transpose() * (self.exponent - 1.0)
    }

    /// The projections u of the corners of a tet inside of the cone; none for a corner that is the apex itself.
    pub fn projections(&self, corners: [Vec3; 4]) -> impl Iterator<Item = Vec3> {
        let Self { apex, gradient, .. } = *self;
        corners.into_iter().filter(move |corner| *corner != apex).map(move |corner| {
            let offset = corner - apex;
            offset / gradient.dot(&offset)
        })
    }

    /// The largest K_I and the largest K_O of the map that is `jacobian` after the warp, over the points that the warp
    /// takes to a tet inside of the cone: exact up to rounding. [`Dilatation::FLIPPED`] where det `jacobian` is not
    /// positive.
    pub fn dilatation(&self, jacobian: &Mat3, corners: [Vec3; 4]) -> Dilatation {
        let at = |projection: Vec3| Dilatation::of(&(jacobian * self.factor(&projection)));
        let larger =
            |a: Dilatation, b: Dilatation| Dilatation { inner: a.inner.max(b.inner), outer: a.outer.max(b.outer) };
        self.projections(corners).map(at).reduce(larger).unwrap_or(Dilatation::FLIPPED)
    }
}

#[cfg(test)]
mod tests {
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{RngCore, SeedableRng};

    use super::*;
    use crate::mesh::edge_matrix;

    /// Numbers from 0 to 1.
    fn numbers(seed: u64) -> impl FnMut() -> f64 {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        move || f64::from(random.next_u32()) / f64::from(u32::MAX)
    }

    fn point(number: &mut impl FnMut() -> f64) -> Vec3 {
        Vec3::new(number(), number(), number()) * 2.0 - Vec3::repeat(1.0)
    }

    /// Four random points, positively oriented, of no needle.
    fn tet(number: &mut impl FnMut() -> f64) -> [Vec3; 4] {
        loop {
            let corners = std::array::from_fn(|_| point(number));
            if edge_matrix(corners).determinant() > 0.1 {
                return corners;
            }
        }
    }

    /// Weights from 0 to 1 whose sum is 1.
    fn weights<const N: usize>(number: &mut impl FnMut() -> f64) -> [f64; N] {
        let raw: [f64; N] = std::array::from_fn(|_| -(number() + 1e-9).min(1.0).ln());
        let sum: f64 = raw.iter().sum();
        raw.map(|weight| weight / sum)
    }

    fn mean<const N: usize>(points: &[Vec3; N], weights: [f64; N]) -> Vec3 {
        points.iter().zip(weights).map(|(point, weight)| point * weight).sum()
    }

    #[test]
    fn the_largest_dilatation_of_a_corner_element_is_that_of_its_three_matrices() {
        let mut number = numbers(1);
        for _ in 0..1_000 {
            let (domain, image) = (tet(&mut number), tet(&mut number));
            let warp = Warp::of_tet(domain, 0, 0.2 + 3.0 * number()).unwrap();
            let inverse = edge_matrix(domain).try_inverse().unwrap();
            let jacobian = edge_matrix(image) * inverse;
            let largest = warp.dilatation(&jacobian, domain);
            let ends: Vec<Vec3> = warp.projections(domain).collect();
            let ends: [Vec3; 3] = ends.try_into().unwrap();
            // N as the theorem writes it for the element, by the barycentric coordinates mu of u in the opposite face.
            let linear = |mu: Vec3| {
                let ones = Vec3::repeat(1.0).transpose();
                edge_matrix(image) * (Mat3::identity() + mu * ones * (warp.exponent() - 1.0)) * inverse
            };
            for _ in 0..1_000 {
                let mu = weights(&mut number);
                let n = jacobian * warp.factor(&mean(&ends, mu));
                let Dilatation { inner, outer } = Dilatation::of(&n);
                // Conditions are below 1e4, of n and of the edge matrix.
                assert!(inner <= largest.inner * (1.0 + 1e-9) && outer <= largest.outer * (1.0 + 1e-9));
                assert!((n - linear(Vec3::from(mu))).norm() <= 1e-9 * n.norm());
            }
        }
    }

    #[test]
    fn the_largest_dilatation_of_a_tet_in_a_cone_is_that_of_its_four_matrices() {
        let mut number = numbers(2);
        for _ in 0..300 {
            let cone = tet(&mut number);
            let warp = Warp::of_tet(cone, 3, 0.3 + 2.5 * number()).unwrap();
            // A tet of four points of the cone, and any linear map of it.
            let inside: [Vec3; 4] = std::array::from_fn(|_| mean(&cone, weights(&mut number)));
            let jacobian = edge_matrix(tet(&mut number));
            let largest = warp.dilatation(&jacobian, inside);
            let (mut seen, mut sum) = (1.0f64, 0.0);
            for _ in 0..300 {
                let u = warp.projections([mean(&inside, weights(&mut number)); 4]).next().unwrap();
                let n = jacobian * warp.factor(&u);
                sum += (n.determinant() / (warp.exponent() * jacobian.determinant()) - 1.0).abs();
                seen = seen.max(Dilatation::of(&n).k());
            }
            assert!(seen <= largest.k() * (1.0 + 1e-10) && sum < 300.0 * 1e-10);
        }
    }

    #[test]
    fn the_factor_is_the_derivative_of_the_warp_and_the_inverse_undoes_it() {
        let mut number = numbers(3);
        for _ in 0..1_000 {
            let cone = tet(&mut number);
            let warp = Warp::of_tet(cone, 1, 0.3 + 2.0 * number()).unwrap();
            let x = mean(&cone, weights(&mut number));
            assert!((warp.inverse(&warp.at(&x)) - x).norm() < 1e-13);
            assert!((warp.at(&warp.inverse(&x)) - x).norm() < 1e-13);
            let inner = mean(&cone, [0.2, 0.3, 0.25, 0.25]);
            let step = 1e-6;
            let derivative = |axis: usize| {
                let mut by = Vec3::zeros();
                by[axis] = step;
                (warp.at(&(inner + by)) - warp.at(&(inner - by))) / (2.0 * step)
            };
            let derivative = Mat3::from_columns(&[derivative(0), derivative(1), derivative(2)]);
            let factor = warp.factor(&warp.projections([inner; 4]).next().unwrap());
            // Up to a positive factor; the third derivatives are below 1e6, times step^2 / 6.
            let ratio = (derivative.determinant() / factor.determinant()).cbrt();
            assert!((derivative - factor * ratio).norm() < 1e-6 * derivative.norm());
        }
    }

    #[test]
    fn neighbours_with_one_apex_agree_on_their_side_and_leave_the_base_as_it_is() {
        let mut number = numbers(4);
        for _ in 0..1_000 {
            let [a, b, c, d] = tet(&mut number);
            // On the other side of the face a, b, c; warped about a.
            let e = a + b + c - d - (a + b + c) / 3.0;
            let p = 0.3 + 2.0 * number();
            let (one, other) = (Warp::of_tet([a, b, c, d], 0, p).unwrap(), Warp::of_tet([a, c, b, e], 0, p).unwrap());
            let shared = mean(&[a, b, c], weights(&mut number));
            assert!((one.at(&shared) - other.at(&shared)).norm() < 1e-13);
            let opposite = mean(&[b, c, d], weights(&mut number));
            assert!((one.at(&opposite) - opposite).norm() < 1e-13);
            assert_eq!(one.at(&a), a);
            assert_eq!(one.with_exponent(1.0).at(&shared), shared);
        }
    }

    #[test]
    fn the_corner_of_a_cube_needs_less_with_a_power() {
        // A linear map of the corner of a cube to one whose three right angles are opened to 110 degrees.
        let domain = [Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z()];
        let cosine = 110f64.to_radians().cos();
        let gram = Mat3::from_fn(|i, j| if i == j { 1.0 } else { cosine });
        let open = gram.cholesky().unwrap().l().transpose();
        let k = |p: f64| Warp::of_tet(domain, 0, p).unwrap().dilatation(&open, domain).k();
        assert!((k(1.0) - Dilatation::of(&open).k()).abs() < 1e-12);
        assert!(k(1.2) < 0.9 * k(1.0), "{} {}", k(1.2), k(1.0));
    }

    #[test]
    fn exponents_and_cones_that_are_none_are_refused() {
        let corners = [Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z()];
        for exponent in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(Warp::of_tet(corners, 0, exponent), None);
        }
        assert_eq!(Warp::new(Vec3::zeros(), [Vec3::x(), Vec3::y(), Vec3::x() - Vec3::y()], 2.0), None);
        assert_eq!(Warp::of_tet(corners, 0, 2.0).unwrap().dilatation(&-Mat3::identity(), corners), Dilatation::FLIPPED);
    }
}

//! A few bounds and Gram certificates proved a second time, in exact rational arithmetic and by other formulas than the checkers':
//! functions of the free vertex are known by their values at some points, roots by powers.

#![allow(clippy::suspicious_arithmetic_impl, reason = "a difference is a sum, a quotient a product")]

use std::cmp::Ordering;
use std::ops::{Add, Div, Mul, Sub};
use std::time::Duration;

use num_bigint::{BigInt, Sign};

use super::check::free_vertex::{Limit, Term};
use super::check::linear;
use super::one_free_vertex::FreeVertex;
use super::{Kind, certificate};
use crate::cancel::Cancel;
use crate::domain::Domain;
use crate::linalg::svd;
use crate::mesh::fixtures::{cube, fan, hull};
use crate::mesh::{Mat3, TetId, Vec3, VertexId};

type Point = [Number; 3];
type Matrix = [[Number; 3]; 3];

/// `numerator 2^exponent / denominator`, the denominator positive. Never reduced: sums of equal denominators keep them.
#[derive(Clone, Debug)]
struct Number {
    numerator: BigInt,
    exponent: i64,
    denominator: BigInt,
}

impl Number {
    fn sign(&self) -> Sign {
        self.numerator.sign()
    }

    fn pow(&self, exponent: u32) -> Self {
        Self {
            numerator: self.numerator.pow(exponent),
            exponent: self.exponent * i64::from(exponent),
            denominator: self.denominator.pow(exponent),
        }
    }

    fn reciprocal(&self) -> Self {
        let sign = BigInt::from(if self.sign() == Sign::Minus { -1 } else { 1 });
        let (numerator, denominator) = (&self.denominator * &sign, &self.numerator * &sign);
        Self { numerator, exponent: -self.exponent, denominator }
    }

    /// Nearly the same as an f64, if that is within range.
    fn to_float(&self) -> f64 {
        let leading = |n: &BigInt| {
            let shift = (n.bits() as i64 - 64).max(0);
            ((n >> shift).to_string().parse::<f64>().expect("digits"), shift)
        };
        let ((n, up), (d, down)) = (leading(&self.numerator), leading(&self.denominator));
        n / d * 2f64.powi((self.exponent + up - down) as i32)
    }
}

impl Mul for &Number {
    type Output = Number;

    fn mul(self, other: &Number) -> Number {
        Number {
            numerator: &self.numerator * &other.numerator,
            exponent: self.exponent + other.exponent,
            denominator: &self.denominator * &other.denominator,
        }
    }
}

impl Add for &Number {
    type Output = Number;

    fn add(self, other: &Number) -> Number {
        let exponent = self.exponent.min(other.exponent);
        let [a, b] = [self, other].map(|x| &x.numerator << (x.exponent - exponent));
        if self.denominator == other.denominator {
            return Number { numerator: a + b, exponent, denominator: self.denominator.clone() };
        }
        let numerator = a * &other.denominator + b * &self.denominator;
        Number { numerator, exponent, denominator: &self.denominator * &other.denominator }
    }
}

impl Sub for &Number {
    type Output = Number;

    fn sub(self, other: &Number) -> Number {
        self + &Number { numerator: -&other.numerator, ..other.clone() }
    }
}

macro_rules! by_value {
    ($($operation:ident $function:ident),*) => { $(
        impl $operation<Number> for Number {
            type Output = Number;
            fn $function(self, other: Number) -> Number { (&self).$function(&other) }
        }
        impl $operation<&Number> for Number {
            type Output = Number;
            fn $function(self, other: &Number) -> Number { (&self).$function(other) }
        }
        impl $operation<Number> for &Number {
            type Output = Number;
            fn $function(self, other: Number) -> Number { self.$function(&other) }
        }
    )* };
}
by_value!(Add add, Sub sub, Mul mul);

impl Div<&Number> for Number {
    type Output = Number;

    fn div(self, other: &Number) -> Number {
        self * other.reciprocal()
    }
}

impl std::iter::Sum for Number {
    fn sum<I: Iterator<Item = Number>>(numbers: I) -> Number {
        numbers.reduce(|a, b| a + b).unwrap_or_else(zero)
    }
}

impl PartialEq for Number {
    fn eq(&self, other: &Number) -> bool {
        (self - other).sign() == Sign::NoSign
    }
}

impl PartialOrd for Number {
    fn partial_cmp(&self, other: &Number) -> Option<Ordering> {
        Some((self - other).sign().cmp(&Sign::NoSign))
    }
}

fn exact(x: f64) -> Number {
    assert!(x.is_finite());
    // 1074 doublings make a whole number of any; those with a fraction have far fewer here.
    let (mut whole, mut exponent) = (x, 0);
    while whole.fract() != 0.0 {
        whole *= 2.0;
        exponent -= 1;
    }
    let numerator: BigInt = format!("{whole:.0}").parse().expect("digits");
    Number { numerator, exponent, denominator: BigInt::from(1) }
}

fn whole(n: i64) -> Number {
    exact(n as f64)
}

fn zero() -> Number {
    whole(0)
}

fn point(p: &Vec3) -> Point {
    [exact(p.x), exact(p.y), exact(p.z)]
}

fn minus(a: &Point, b: &Point) -> Point {
    [0, 1, 2].map(|i| &a[i] - &b[i])
}

fn dot(a: &Point, b: &Point) -> Number {
    (0..3).map(|i| &a[i] * &b[i]).sum()
}

fn cofactors(m: &Matrix) -> Matrix {
    [0, 1, 2].map(|i| {
        [0, 1, 2].map(|j| {
            let ([i1, i2], [j1, j2]) = ([1, 2].map(|s| (i + s) % 3), [1, 2].map(|s| (j + s) % 3));
            &m[i1][j1] * &m[i2][j2] - &m[i1][j2] * &m[i2][j1]
        })
    })
}

fn determinant(m: &Matrix) -> Number {
    dot(&m[0], &cofactors(m)[0])
}

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| (0..3).map(|k| &a[i][k] * &b[k][j]).sum()))
}

fn transpose(m: &Matrix) -> Matrix {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| m[j][i].clone()))
}

fn times(m: &Matrix, v: &Point) -> Point {
    [0, 1, 2].map(|i| dot(&m[i], v))
}

fn inner_product(a: &Matrix, b: &Matrix) -> Number {
    (0..3).map(|i| dot(&a[i], &b[i])).sum()
}

/// The Jacobian of the map of a tet.
fn jacobian(corners: &[Point; 4], image: &[Point; 4]) -> Matrix {
    let columns = |p: &[Point; 4]| transpose(&[1, 2, 3].map(|i| minus(&p[i], &p[0])));
    let edges = columns(corners);
    let scale = determinant(&edges).reciprocal();
    let inverse = transpose(&cofactors(&edges)).map(|row| row.map(|entry| entry * &scale));
    product(&columns(image), &inverse)
}

fn power(x: &Number, exponent: u32) -> Number {
    x.pow(exponent)
}

/// A function known to be affine, by its values at 0 and at the unit vectors: the constant and the slope.
fn affine(f: impl Fn(&Point) -> Number) -> (Number, Point) {
    let at = |axis: usize| f(&[0, 1, 2].map(|i| whole(i64::from(i == axis))));
    let constant = f(&[zero(), zero(), zero()]);
    let slope = [0, 1, 2].map(|axis| at(axis) - &constant);
    (constant, slope)
}

/// Whether the terms prove K > level: their sum is positive in a ball.
fn proves(tets: &[([Vec3; 4], [Vec3; 4], usize)], level: f64, terms: &[Term]) -> bool {
    let k = exact(level);
    let points = |p: &[Vec3; 4]| p.each_ref().map(point);
    let others = |free: usize| (0..4).filter(move |&i| i != free);
    let edges = |free: usize| others(free).flat_map(move |i| others(free).filter(move |&j| j > i).map(move |j| (i, j)));
    let stretches = |tet: usize| -> Vec<Number> {
        let (corners, image) = (points(&tets[tet].0), points(&tets[tet].1));
        let square = |p: &[Point; 4], i: usize, j: usize| dot(&minus(&p[i], &p[j]), &minus(&p[i], &p[j]));
        edges(tets[tet].2).map(|(i, j)| square(&image, i, j) / &square(&corners, i, j)).collect()
    };
    let mut constant = zero();
    let mut slope = [zero(), zero(), zero()];
    for term in terms {
        let (corners, image, free) = &tets[term.tet];
        let (corners, image) = (points(corners), points(image));
        let map = |q: &Point| {
            let mut image = image.clone();
            image[*free] = q.clone();
            jacobian(&corners, &image)
        };
        let (u, v, b) = match term.limit {
            Limit::Outer { u, v, b } | Limit::Inner { u, v, b } => (point(&u), point(&v), b),
            Limit::Volume => {
                // l = s^3 / h^2 with h^3 = k^2: l^6 k^8 <= (s^2)^9.
                let largest = stretches(term.tet).into_iter().reduce(|a, b| if b > a { b } else { a }).unwrap();
                let guess = to_float(&largest).powf(1.5) / level.powf(4.0 / 3.0) * (1.0 - 1e-12);
                let least = exact(guess);
                assert!(power(&least, 6) * power(&k, 8) <= power(&largest, 9));
                let (at_zero, along) = affine(|q| &least - determinant(&map(q)));
                constant = constant + exact(term.multiplier) * at_zero;
                slope = [0, 1, 2].map(|i| &slope[i] + exact(term.multiplier) * &along[i]);
                continue;
            }
        };
        // a with 27 a^2 b >= 4 k n^3 or 27 a b^2 >= 4 k n^3, n = |u| |v|: both sides squared.
        let square = dot(&u, &u) * dot(&v, &v);
        let needed = whole(16) * power(&k, 2) * power(&square, 3);
        let root = (4.0 * level * to_float(&square).powf(1.5) / 27.0) * (1.0 + 1e-14);
        let b_exact = exact(b);
        let outer = matches!(term.limit, Limit::Outer { .. });
        let a = if outer {
            let a = exact((root / b).sqrt() * (1.0 + 1e-14));
            assert!(power(&(whole(27) * power(&a, 2) * &b_exact), 2) >= needed);
            a
        } else {
            let a = exact(root / (b * b) * (1.0 + 1e-14));
            assert!(power(&(whole(27) * &a * power(&b_exact, 2)), 2) >= needed);
            a
        };
        let (at_zero, along) = affine(|q| {
            let map = map(q);
            let left = if outer { map.clone() } else { cofactors(&map) };
            dot(&u, &times(&left, &v)) - &a - &b_exact * determinant(&map)
        });
        constant = constant + exact(term.multiplier) * at_zero;
        slope = [0, 1, 2].map(|i| &slope[i] + exact(term.multiplier) * &along[i]);
    }
    // The ball about the image of any fixed vertex: R^6 >= k^4 (s^2 d^2)^3 with s the least stretch, d the distance in the domain.
    (0..tets.len()).flat_map(|tet| others(tets[tet].2).map(move |fixed| (tet, fixed))).any(|(tet, fixed)| {
        let (corners, image, free) = &tets[tet];
        let arm = minus(&point(&corners[*free]), &point(&corners[fixed]));
        let square = stretches(tet).into_iter().reduce(|a, b| if b < a { b } else { a }).unwrap() * dot(&arm, &arm);
        let radius = exact(level.powf(2.0 / 3.0) * to_float(&square).sqrt() * (1.0 + 1e-12));
        assert!(power(&radius, 6) >= power(&k, 4) * power(&square, 3));
        let at_centre = &constant + dot(&slope, &point(&image[fixed]));
        at_centre > zero() && power(&at_centre, 2) > dot(&slope, &slope) * power(&radius, 2)
    })
}

fn to_float(x: &Number) -> f64 {
    x.to_float()
}

/// Fans of a cube and a tetrahedron over moved boundaries: the vertex inside is free.
fn fans() -> Vec<(Domain, Vec<Vec3>)> {
    let tetrahedron = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];
    [cube(), hull(tetrahedron.map(Vec3::from).to_vec())]
        .into_iter()
        .map(|solid| {
            let domain = Domain::new(fan(&solid, Vec3::new(0.1, -0.2, 0.15))).unwrap();
            let moved = |(i, p): (usize, &Vec3)| p + Vec3::new(0.3, -0.2, 0.25) * (1.0 + i as f64).sin();
            let image = domain.mesh().points().iter().enumerate().map(moved).collect();
            (domain, image)
        })
        .collect()
}

#[test]
fn apex_bounds_hold_in_exact_arithmetic() {
    for (domain, image) in fans() {
        let vertex = VertexId(domain.mesh().points().len() as u32 - 1);
        let ids: Vec<TetId> = (0..domain.mesh().tets().len() as u32).map(TetId).collect();
        let least = FreeVertex::of(&domain, vertex, &ids, &image).unwrap().least(Kind::K, 1.0).unwrap();
        assert!(least.lower > 1.1 && least.lower > least.upper * (1.0 - 1e-5), "{} {}", least.lower, least.upper);
        let tets: Vec<([Vec3; 4], [Vec3; 4], usize)> = domain
            .mesh()
            .tets()
            .iter()
            .zip(&ids)
            .map(|(tet, &id)| {
                let free = tet.iter().position(|&v| v == vertex).unwrap();
                (domain.mesh().corners(id), tet.map(|v| image[v.index()]), free)
            })
            .collect();
        assert!(proves(&tets, least.lower, &least.terms));
        // The check can fail: nothing proves more than what a position attains.
        assert!(!proves(&tets, least.upper * (1.0 + 1e-9), &least.terms));
    }
}

#[test]
fn the_dilatation_of_a_locked_tet_is_not_exceeded_in_exact_arithmetic() {
    let corners =
        [Vec3::new(0.2, 0.1, 0.5), Vec3::new(1.0, 0.0, 0.1), Vec3::new(-0.3, 0.8, 0.0), Vec3::new(0.1, 0.2, 1.5)];
    for map in [
        Mat3::new(1.0, 0.7, -0.2, 0.0, 0.8, 0.4, 0.3, 0.0, 2.0),
        Mat3::new(3.0, 0.1, 0.2, -0.1, 0.2, 0.4, 0.3, 0.5, 2.0),
    ] {
        let image = corners.map(|p| map * p);
        let right = svd(&map).right;
        let value = linear::locked(
            corners.each_ref().map(crate::linalg::interval::exact_vector),
            image,
            [0, 2].map(|i| right.column(i).into_owned()),
        )
        .unwrap();
        let a = jacobian(&corners.each_ref().map(point), &image.each_ref().map(point));
        let (d, l) = (determinant(&a), exact(value));
        // K_O >= |A v|^3 / (|v|^3 d) and K_I >= |cof A w|^3 / (|w|^3 d^2), both squared.
        let at_least = |matrix: &Matrix, column: usize, degree: u32| {
            let v = point(&right.column(column).into_owned());
            let stretched = times(matrix, &v);
            power(&dot(&stretched, &stretched), 3) >= power(&l, 2) * power(&dot(&v, &v), 3) * power(&d, 2 * degree)
        };
        assert!(at_least(&a, 0, 1) || at_least(&cofactors(&a), 2, 2), "{value}");
    }
}

/// The maximum of a quadratic function of three variables that is known by its values; nothing if it is not strictly concave.
fn maximum(q: impl Fn(&Point) -> Number) -> Option<Number> {
    let unit = |i: usize, size: i64| [0, 1, 2].map(|j| whole(if i == j { size } else { 0 }));
    let constant = q(&unit(3, 0));
    // q = constant + b . x + x^T H x.
    let b = [0, 1, 2].map(|i| (q(&unit(i, 1)) - q(&unit(i, -1))) * exact(0.5));
    let square = |i: usize| (q(&unit(i, 1)) + q(&unit(i, -1))) * exact(0.5) - &constant;
    let h: Matrix = [0, 1, 2].map(|i| {
        [0, 1, 2].map(|j| {
            if i == j {
                return square(i);
            }
            let both = [0, 1, 2].map(|l| whole(i64::from(l == i || l == j)));
            (q(&both) - &constant - &b[i] - &b[j] - square(i) - square(j)) * exact(0.5)
        })
    });
    let minor = &h[0][0] * &h[1][1] - &h[0][1] * &h[1][0];
    let det = determinant(&h);
    let concave = h[0][0] < zero() && minor > zero() && det < zero();
    // At the maximum 2 H x = -b: constant - b . H^-1 b / 4.
    let inverse_b = times(&transpose(&cofactors(&h)), &b).map(|entry| entry / &det);
    concave.then(|| constant - dot(&b, &inverse_b) * exact(0.25))
}

#[test]
fn gram_certificates_hold_in_exact_arithmetic() {
    for (domain, image) in fans() {
        let vertex = VertexId(domain.mesh().points().len() as u32 - 1);
        let found = certificate::search(&domain, &image, &Cancel::default().within(Duration::from_secs(60)))
            .expect("a start without flipped tets");
        assert!(found.split.is_none() && found.level > 1.1);
        let k = exact(found.level);
        // Two numbers on either side of the cube root.
        let [low, high] = [1.0 - 1e-15, 1.0 + 1e-15].map(|side| exact(found.level.cbrt() * side));
        assert!(power(&low, 3) <= k && k <= power(&high, 3));
        let factor = |l: &[f64; 6]| -> Matrix {
            let [a, b, c, d, e, f] = l.map(exact);
            let lower = [[a, zero(), zero()], [b, c, zero()], [d, e, f]];
            product(&lower, &transpose(&lower))
        };
        let trace = |m: &Matrix| (0..3).map(|i| m[i][i].clone()).sum::<Number>();
        let squares = |entries: &[f64; 9]| entries.iter().map(|&x| power(&exact(x), 2)).sum::<Number>();
        let rows = |entries: &[f64; 9]| [0, 1, 2].map(|i| [0, 1, 2].map(|j| exact(entries[3 * i + j])));
        let mut forms = Vec::new();
        for (i, &tet) in found.tets.iter().enumerate() {
            let (s, r) = (factor(&found.lower[i]), factor(&found.upper[i]));
            let t = factor(&found.volume.get(i).copied().unwrap_or_default());
            let [x, y] = found.cofactor.get(i).copied().unwrap_or_default();
            let [eta, e] = found.determinant.get(i).copied().unwrap_or_default().map(exact);
            let rho = exact(found.trace[i]);
            assert!(rho >= zero() && eta >= zero() && (eta == zero() || e > zero()));
            let volume = determinant(&t);
            let mean = exact(to_float(&volume).max(0.0).cbrt() * (1.0 - 1e-15));
            assert!(power(&mean, 3) <= volume);
            let half = exact(0.5);
            // (|X|^2 + |Y|^2) / 2 is at least the nuclear norm of X Y^T.
            let norm = &half * (squares(&x) + squares(&y));
            let earned = trace(&s) + power(&low, 2) * (whole(3) * mean + whole(3) * &half * &eta * &e);
            let c = whole(1) + power(&high, 2) + power(&high, 4);
            let paid = power(&high, 4) * trace(&r) + c * &rho + power(&high, 3) * norm;
            assert!(earned >= paid, "tet {tet}");
            let gram: Matrix = [0, 1, 2]
                .map(|i| [0, 1, 2].map(|j| &s[i][j] + &t[i][j] - &r[i][j] - if i == j { rho.clone() } else { zero() }));
            forms.push((TetId(tet), gram, product(&rows(&x), &transpose(&rows(&y))), eta, e));
        }
        let largest = maximum(|q| {
            let values = forms.iter().map(|(tet, gram, cofactor, eta, e)| {
                let corners = domain.mesh().corners(*tet).each_ref().map(point);
                let place = |v: VertexId| if v == vertex { q.clone() } else { point(&image[v.index()]) };
                let a = jacobian(&corners, &domain.mesh().tets()[tet.index()].map(place));
                let form = inner_product(gram, &product(&transpose(&a), &a)) - inner_product(cofactor, &cofactors(&a));
                form + eta * (determinant(&a) + power(e, 3) * exact(0.5))
            });
            values.sum()
        });
        assert!(largest.is_some_and(|largest| largest < zero()));
    }
}

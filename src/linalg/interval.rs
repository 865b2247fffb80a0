//! Interval arithmetic with outward rounding, for whatever is called proved.

use std::f64::consts::{FRAC_PI_2, PI};
use std::iter::Sum;
use std::ops::{Add, Div, Mul, Neg, Sub};

use super::Vec3;

/// Two numbers between which a real number lies.
///
/// Every operation rounds to the nearest number, as IEEE 754 prescribes for +, -, *, / and the square root, and then takes the
/// next number outward, so that the result encloses the exact one. Where an operand overflows it is the whole line.
/// Nothing is taken from the library's other functions, whose accuracy is not stated: the cube root is verified by its
/// cube, and the arc tangent is a series with its remainder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Interval {
    pub(crate) lower: f64,
    pub(crate) upper: f64,
}

impl Interval {
    pub(crate) const ZERO: Self = Self::exactly(0.0);
    pub(crate) const ONE: Self = Self::exactly(1.0);
    pub(crate) const WHOLE: Self = Self { lower: f64::NEG_INFINITY, upper: f64::INFINITY };
    /// pi, of which the nearest f64, 3.14159265358979311..., is 1.2e-16 below.
    pub(crate) const PI: Self = Self { lower: PI, upper: PI.next_up() };
    /// pi / 2; halving is exact.
    pub(crate) const HALF_PI: Self = Self { lower: FRAC_PI_2, upper: FRAC_PI_2.next_up() };

    /// A number without error.
    pub(crate) const fn exactly(value: f64) -> Self {
        Self { lower: value, upper: value }
    }

    /// The next numbers outward of the rounded ends.
    #[inline]
    fn around(lower: f64, upper: f64) -> Self {
        if lower.is_nan() | upper.is_nan() {
            return Self::WHOLE;
        }
        Self { lower: next_below(lower), upper: next_above(upper) }
    }

    /// The next numbers outward of the least and the largest of four rounded ones.
    #[inline]
    fn around_all([a, b, c, d]: [f64; 4]) -> Self {
        // Comparisons would pass over the NaN of zero times infinity.
        if a.is_nan() | b.is_nan() | c.is_nan() | d.is_nan() {
            return Self::WHOLE;
        }
        let least = |x: f64, y: f64| if x < y { x } else { y };
        let most = |x: f64, y: f64| if x > y { x } else { y };
        Self::around(least(least(a, b), least(c, d)), most(most(a, b), most(c, d)))
    }

    /// A number near the middle.
    pub(crate) fn middle(self) -> f64 {
        0.5 * self.lower + 0.5 * self.upper
    }

    /// How far the interval reaches from `centre`, rounded up.
    pub(crate) fn distance_from(self, centre: f64) -> f64 {
        (self.upper - centre).max(centre - self.lower).next_up()
    }

    /// Whether both ends are finite.
    pub(crate) fn is_bounded(self) -> bool {
        self.lower.is_finite() && self.upper.is_finite()
    }

    /// The numbers of both intervals, which have to meet.
    pub(crate) fn within(self, other: Self) -> Self {
        Self { lower: self.lower.max(other.lower), upper: self.upper.min(other.upper) }
    }

    /// The absolute value.
    pub(crate) fn abs(self) -> Self {
        if self.lower >= 0.0 {
            self
        } else if self.upper <= 0.0 {
            -self
        } else {
            Self { lower: 0.0, upper: self.upper.max(-self.lower) }
        }
    }

    /// The square, which is not negative.
    pub(crate) fn square(self) -> Self {
        let magnitude = self.abs();
        let square = magnitude * magnitude;
        Self { lower: square.lower.max(0.0), upper: square.upper }
    }

    /// The reciprocal; nothing if the interval contains zero or is not bounded.
    pub(crate) fn reciprocal(self) -> Option<Self> {
        self.is_invertible().then(|| Self::around(1.0 / self.upper, 1.0 / self.lower))
    }

    /// Whether the interval is bounded and does not contain zero.
    #[inline]
    fn is_invertible(self) -> bool {
        self.is_bounded() & ((self.lower > 0.0) | (self.upper < 0.0))
    }

    /// The square root of what is not negative in the interval.
    pub(crate) fn sqrt(self) -> Self {
        let root = Self::around(self.lower.max(0.0).sqrt(), self.upper.max(0.0).sqrt());
        Self { lower: root.lower.max(0.0), upper: root.upper }
    }

    /// The cube root of what is not negative in the interval.
    pub(crate) fn cbrt(self) -> Self {
        Self { lower: cube_root_below(self.lower.max(0.0)), upper: cube_root_above(self.upper.max(0.0)) }
    }

    /// The arc tangent.
    pub(crate) fn atan(self) -> Self {
        Self { lower: atan_of_number(self.lower).lower, upper: atan_of_number(self.upper).upper }
    }

    /// The angle in (-pi, 3 pi / 2) from the first axis to the point (x, y), of which only the part that x and y leave open is
    /// enclosed; the whole line if that may be the origin.
    pub(crate) fn angle(x: Self, y: Self) -> Self {
        if !x.is_bounded() || !y.is_bounded() {
            Self::WHOLE
        } else if x.lower > 0.0 {
            (y / x).atan()
        } else if y.lower > 0.0 {
            Self::HALF_PI - (x / y).atan()
        } else if y.upper < 0.0 {
            -Self::HALF_PI - (x / y).atan()
        } else if x.upper < 0.0 {
            Self::PI + (y / x).atan()
        } else {
            Self::WHOLE
        }
    }
}

impl Add for Interval {
    type Output = Self;

    #[inline]
    fn add(self, other: Self) -> Self {
        Self::around(self.lower + other.lower, self.upper + other.upper)
    }
}

impl Neg for Interval {
    type Output = Self;

    #[inline]
    fn neg(self) -> Self {
        Self { lower: -self.upper, upper: -self.lower }
    }
}

impl Sub for Interval {
    type Output = Self;

    #[inline]
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Interval {
    type Output = Self;

    #[inline]
    fn mul(self, other: Self) -> Self {
        Self::around_all([
            self.lower * other.lower,
            self.lower * other.upper,
            self.upper * other.lower,
            self.upper * other.upper,
        ])
    }
}

impl Div for Interval {
    type Output = Self;

    /// The whole line if the divisor contains zero or is not bounded.
    fn div(self, other: Self) -> Self {
        if !other.is_invertible() {
            return Self::WHOLE;
        }
        Self::around_all([
            self.lower / other.lower,
            self.lower / other.upper,
            self.upper / other.lower,
            self.upper / other.upper,
        ])
    }
}

impl Sum for Interval {
    fn sum<I: Iterator<Item = Self>>(numbers: I) -> Self {
        numbers.fold(Self::ZERO, Add::add)
    }
}

/// A vector without error.
pub(crate) fn exact_vector(vector: &Vec3) -> [Interval; 3] {
    [0, 1, 2].map(|i| Interval::exactly(vector[i]))
}

/// `a - b`.
pub(crate) fn difference(a: &Vec3, b: &Vec3) -> [Interval; 3] {
    [
        Interval::exactly(a.x) - Interval::exactly(b.x),
        Interval::exactly(a.y) - Interval::exactly(b.y),
        Interval::exactly(a.z) - Interval::exactly(b.z),
    ]
}

/// `a . b`.
pub(crate) fn dot(a: [Interval; 3], b: [Interval; 3]) -> Interval {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `a x b`.
pub(crate) fn cross(a: [Interval; 3], b: [Interval; 3]) -> [Interval; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `|a|^2`, which is not negative.
pub(crate) fn norm_squared(a: [Interval; 3]) -> Interval {
    let sum: Interval = a.into_iter().map(Interval::square).sum();
    Interval { lower: sum.lower.max(0.0), upper: sum.upper }
}

/// `f64::next_up` of a number that is not NaN, without its branches: on signs that vary they are mispredicted, which
/// takes longer than all else in an operation.
#[inline]
fn next_above(x: f64) -> f64 {
    // The sum takes -0 to 0. The bits of negative numbers fall as the numbers rise.
    let bits = (x + 0.0).to_bits() as i64;
    let next = f64::from_bits(bits.wrapping_add(1 | (bits >> 63)) as u64);
    if x < f64::INFINITY { next } else { x }
}

/// `f64::next_down` likewise.
#[inline]
fn next_below(x: f64) -> f64 {
    -next_above(-x)
}

/// The arc tangent of a number.
fn atan_of_number(x: f64) -> Interval {
    /// Halvings of an angle of at most pi / 4: the tangent is then at most tan(pi / 32) < 0.0985.
    const HALVINGS: i32 = 3;
    /// The first term left out is below 0.0985^17 / 17 < 5e-19 of the first.
    const TERMS: usize = 8;
    /// 1 / (2 i + 1), rounded outward.
    const OVER_ODD: [Interval; TERMS + 1] = {
        let mut terms = [Interval::ONE; TERMS + 1];
        let mut index = 0;
        while index <= TERMS {
            let term = 1.0 / (2 * index + 1) as f64;
            terms[index] = Interval { lower: term.next_down(), upper: term.next_up() };
            index += 1;
        }
        terms
    };
    if x.is_nan() {
        return Interval::HALF_PI - Interval { lower: 0.0, upper: Interval::PI.upper };
    }
    if x < 0.0 {
        return -atan_of_number(-x);
    }
    if x.is_infinite() {
        return Interval::HALF_PI;
    }
    let beyond = x > 1.0;
    let mut t = if beyond { Interval::ONE / Interval::exactly(x) } else { Interval::exactly(x) };
    for _ in 0..HALVINGS {
        // tan(a / 2) = tan a / (1 + (1 + tan^2 a)^(1/2)).
        t = t / (Interval::ONE + (Interval::ONE + t.square()).sqrt());
    }
    // t - t^3 / 3 + t^5 / 5 - ...: the terms alternate and fall, so that what is left out lies between 0 and its first term.
    let square = t.square();
    let [terms @ .., first_left_out] = OVER_ODD;
    let mut sum = Interval { lower: 0.0, upper: first_left_out.upper };
    for term in terms.into_iter().rev() {
        sum = term - square * sum;
    }
    let angle = Interval::exactly(2f64.powi(HALVINGS)) * t * sum;
    let angle = if beyond { Interval::HALF_PI - angle } else { angle };
    Interval { lower: angle.lower.max(0.0), upper: angle.upper }
}

/// A number at least the cube root of a number that is not negative; that is verified, not taken from the library.
fn cube_root_above(value: f64) -> f64 {
    // The cubes of numbers near the root of a subnormal number are too coarse to step along.
    let value = value.max(f64::MIN_POSITIVE);
    let mut root = value.cbrt();
    loop {
        let cube = Interval::exactly(root) * Interval::exactly(root) * Interval::exactly(root);
        if cube.lower >= value || !root.is_finite() {
            return root;
        }
        root = root.next_up();
    }
}

/// A number at most the cube root of a number that is not negative, and not negative.
fn cube_root_below(value: f64) -> f64 {
    if value.is_nan() || value <= f64::MIN_POSITIVE {
        return 0.0;
    }
    let mut root = value.cbrt();
    loop {
        let cube = Interval::exactly(root) * Interval::exactly(root) * Interval::exactly(root);
        if cube.upper <= value {
            return root;
        }
        root = root.next_down();
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn results_enclose_the_exact_ones() {
        // 0.1 + 0.2 and 0.1 * 3 in exact decimals lie on both sides of their rounded values.
        let sum = Interval::exactly(0.1) + Interval::exactly(0.2);
        assert!(sum.lower < 0.1 + 0.2 && 0.1 + 0.2 < sum.upper);
        let third = Interval::exactly(3.0).reciprocal().unwrap();
        let one = third * Interval::exactly(3.0);
        assert!(one.lower < 1.0 && 1.0 < one.upper && one.upper - one.lower < 1e-15);
        let mixed = Interval { lower: -2.0, upper: 1.0 } * Interval { lower: -1.0, upper: 3.0 };
        assert!(mixed.lower <= -6.0 && mixed.upper >= 3.0 && mixed.distance_from(mixed.middle()) >= 4.5);
        let [x, y] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(|v| v.map(Interval::exactly));
        let z = cross(x, y);
        assert!(z[2].lower <= 1.0 && 1.0 <= z[2].upper && dot(z, x).upper < 1e-300);
        let quotient = Interval { lower: -1.0, upper: 2.0 } / Interval { lower: -4.0, upper: -0.5 };
        assert!(quotient.lower <= -4.0 && quotient.upper >= 2.0 && quotient.upper - quotient.lower < 6.0 + 1e-14);
        assert_eq!(Interval { lower: -3.0, upper: 2.0 }.abs(), Interval { lower: 0.0, upper: 3.0 });
        let [two, eight] = [Interval::exactly(2.0).square().sqrt(), Interval::exactly(8.0).cbrt()];
        for tiny in [0.0, f64::from_bits(1), 1e-310] {
            let root = Interval::exactly(tiny).cbrt();
            assert!(root.lower == 0.0 && root.upper.powi(3) >= tiny && root.upper < 1e-100, "{root:?}");
        }
        assert!([two, eight].iter().all(|root| root.lower <= 2.0 && 2.0 <= root.upper && root.upper < 2.0 + 1e-14));
    }

    #[test]
    fn neighbours_are_those_of_the_library() {
        let tiny = f64::from_bits(1);
        let magnitudes = [0.0, tiny, 2.0 * tiny, f64::MIN_POSITIVE, 1.0, 1.0f64.next_down(), f64::MAX, f64::INFINITY];
        for x in magnitudes.into_iter().flat_map(|x| [x, -x]) {
            assert_eq!(next_above(x).to_bits(), x.next_up().to_bits(), "{x}");
            assert_eq!(next_below(x).to_bits(), x.next_down().to_bits(), "{x}");
        }
    }

    #[test]
    fn overflow_gives_the_whole_line() {
        let huge = Interval::exactly(f64::MAX) * Interval::exactly(2.0);
        assert_eq!(huge.upper, f64::INFINITY);
        assert_eq!(huge * Interval::ZERO, Interval::WHOLE);
        assert_eq!(huge - huge, Interval::WHOLE);
        assert_eq!((huge - huge).reciprocal(), None);
        assert_eq!(Interval { lower: -1.0, upper: 1.0 }.reciprocal(), None);
        assert_eq!(Interval::ONE / Interval { lower: -1.0, upper: 1.0 }, Interval::WHOLE);
        assert_eq!(Interval::angle(huge, Interval::ONE), Interval::WHOLE);
        let right = Interval::exactly(f64::INFINITY).atan();
        assert!(right.lower <= FRAC_PI_2 && FRAC_PI_2 <= right.upper);
    }

    /// Machin: pi / 4 = 4 atan(1/5) - atan(1/239), and atan 1 itself, to the digits of pi beyond those of an f64.
    #[test]
    fn arc_tangents_give_pi() {
        let over = |x: f64| (Interval::ONE / Interval::exactly(x)).atan();
        let four = Interval::exactly(4.0);
        for pi in [four * (four * over(5.0) - over(239.0)), four * Interval::ONE.atan()] {
            // pi - PI = 1.2246e-16 is less than half of a unit in the last place, which makes the interval of pi the right one.
            assert!(pi.lower <= Interval::PI.lower && Interval::PI.upper <= pi.upper && pi.upper - pi.lower < 2e-14);
        }
        assert_eq!(Interval::ZERO.atan().lower, 0.0);
    }

    proptest! {
        /// tan(2 a) = 2 t / (1 - t^2) relates arc tangents of exact rationals: enclosures of both sides meet. The library's
        /// arc tangent, good to a few units in the last place, lies within as many of the enclosure.
        #[test]
        fn arc_tangents_double(numerator in 1u32..1000, denominator in 1000u32..100_000, scale in -60..60i32) {
            let [p, q] = [numerator, denominator].map(|n| Interval::exactly(f64::from(n)));
            let twice = (p / q).atan() + (p / q).atan();
            let double = ((p * q + p * q) / (q * q - p * p)).atan();
            prop_assert!(twice.lower <= double.upper && double.lower <= twice.upper);
            let x = f64::from(numerator) / f64::from(denominator) * 2f64.powi(scale);
            let (found, expected) = (Interval::exactly(x).atan(), x.atan());
            prop_assert!(found.upper - found.lower <= 64.0 * f64::EPSILON * expected, "{x} {found:?}");
            prop_assert!(found.distance_from(expected) <= 64.0 * f64::EPSILON * expected);
        }

        #[test]
        fn angles_turn_once_around(x in -1.0..1.0f64, y in -1.0..1.0f64) {
            prop_assume!(x != 0.0 || y != 0.0);
            let found = Interval::angle(Interval::exactly(x), Interval::exactly(y));
            let turns = ((found.middle() - y.atan2(x)) / (2.0 * PI)).round();
            prop_assert!((found.middle() - 2.0 * PI * turns - y.atan2(x)).abs() < 1e-14);
            prop_assert!(found.upper - found.lower < 1e-14);
        }
    }
}

//! Interval arithmetic with outward rounding, for whatever is called proved.

use std::ops::{Add, Mul, Neg, Sub};

/// Two numbers between which a real number lies.
///
/// Every operation rounds to the nearest number, as IEEE 754 prescribes for +, -, * and /, and then takes the next number
/// outward, so that the result encloses the exact one. Where an operand overflows it is the whole line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Interval {
    pub(crate) lower: f64,
    pub(crate) upper: f64,
}

impl Interval {
    pub(crate) const ZERO: Self = Self::exactly(0.0);
    const WHOLE: Self = Self { lower: f64::NEG_INFINITY, upper: f64::INFINITY };

    /// A number without error.
    pub(crate) const fn exactly(value: f64) -> Self {
        Self { lower: value, upper: value }
    }

    /// The next numbers outward of the rounded ends.
    fn around(lower: f64, upper: f64) -> Self {
        if lower.is_nan() || upper.is_nan() {
            return Self::WHOLE;
        }
        Self { lower: lower.next_down(), upper: upper.next_up() }
    }

    /// A number near the middle.
    pub(crate) fn middle(self) -> f64 {
        0.5 * self.lower + 0.5 * self.upper
    }

    /// How far the interval reaches from `centre`, rounded up.
    pub(crate) fn distance_from(self, centre: f64) -> f64 {
        (self.upper - centre).max(centre - self.lower).next_up()
    }

    /// The reciprocal; nothing if the interval contains zero or is not bounded.
    pub(crate) fn reciprocal(self) -> Option<Self> {
        let bounded = self.lower.is_finite() && self.upper.is_finite();
        (bounded && (self.lower > 0.0 || self.upper < 0.0)).then(|| Self::around(1.0 / self.upper, 1.0 / self.lower))
    }
}

impl Add for Interval {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self::around(self.lower + other.lower, self.upper + other.upper)
    }
}

impl Neg for Interval {
    type Output = Self;

    fn neg(self) -> Self {
        Self { lower: -self.upper, upper: -self.lower }
    }
}

impl Sub for Interval {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Interval {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        let products =
            [self.lower * other.lower, self.lower * other.upper, self.upper * other.lower, self.upper * other.upper];
        // `min` and `max` would pass over the NaN of zero times infinity.
        if products.iter().any(|product| product.is_nan()) {
            return Self::WHOLE;
        }
        let [lower, upper] =
            [f64::min, f64::max].map(|extreme| products.into_iter().reduce(extreme).unwrap_or(f64::NAN));
        Self::around(lower, upper)
    }
}

/// `a . b`.
pub(crate) fn dot(a: [Interval; 3], b: [Interval; 3]) -> Interval {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `a x b`.
pub(crate) fn cross(a: [Interval; 3], b: [Interval; 3]) -> [Interval; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
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
    }

    #[test]
    fn overflow_gives_the_whole_line() {
        let huge = Interval::exactly(f64::MAX) * Interval::exactly(2.0);
        assert_eq!(huge.upper, f64::INFINITY);
        assert_eq!(huge * Interval::ZERO, Interval::WHOLE);
        assert_eq!(huge - huge, Interval::WHOLE);
        assert_eq!((huge - huge).reciprocal(), None);
        assert_eq!(Interval { lower: -1.0, upper: 1.0 }.reciprocal(), None);
    }
}

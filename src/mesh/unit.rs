//! The unit in which a solid is worked on, so that results do not depend on the one in which it was given.

use super::{Place, Vec3};

/// Half-extents between 2^-ORDINARY and 2^ORDINARY are worked with as they are where that is asked for: no product of a dozen
/// of such lengths, and no quotient, leaves the range of numbers.
const ORDINARY: i32 = 40;

/// A power of two. Dividing coordinates by it is exact, unless one is smaller than all others by a factor of 1e290 or more.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Unit {
    exponent: i32,
}

impl Unit {
    /// The unit in which the largest half-extent of some points along the axes lies in [1, 2); 1 if there is no extent.
    pub fn of<'a>(points: impl IntoIterator<Item = &'a Vec3>) -> Self {
        let points = points.into_iter().map(|point| (*point, *point));
        let Some((low, high)) = points.reduce(|(low, high), (p, q)| (low.inf(&p), high.sup(&q))) else {
            return Self::default();
        };
        // Halved first: the whole extent may be beyond the range.
        let half = (0.5 * high - 0.5 * low).max();
        Self { exponent: if half > 0.0 && half.is_finite() { floor_log2(half) } else { 0 } }
    }

    /// The same, but 1 for points of ordinary extent.
    pub fn of_extreme<'a>(points: impl IntoIterator<Item = &'a Vec3>) -> Self {
        let unit = Self::of(points);
        if unit.exponent.abs() <= ORDINARY { Self::default() } else { unit }
    }

    /// Whether lengths stay as they are.
    pub fn is_one(self) -> bool {
        self.exponent == 0
    }

    /// A number in which this unit to the given power is counted, as a number in which 1 is: 1 for lengths, 3 for volumes.
    /// Infinite, or 0, where that is beyond the range of numbers.
    pub fn give_back(self, value: f64, power: i32) -> f64 {
        times_power_of_two(value, power * self.exponent)
    }

    /// The opposite of [`Unit::give_back`].
    pub fn take(self, value: f64, power: i32) -> f64 {
        times_power_of_two(value, -power * self.exponent)
    }

    /// Points given in this unit.
    pub fn give_back_points(self, points: &[Vec3]) -> Vec<Vec3> {
        points.iter().map(|point| point.map(|x| self.give_back(x, 1))).collect()
    }

    /// Points to be counted in this unit.
    pub fn take_points(self, points: &[Vec3]) -> Vec<Vec3> {
        points.iter().map(|point| point.map(|x| self.take(x, 1))).collect()
    }

    /// A place given in this unit.
    pub fn give_back_place(self, mut place: Place) -> Place {
        let (Place::Vertex { position, .. }
        | Place::Edge { midpoint: position, .. }
        | Place::Face { centroid: position, .. }) = &mut place;
        *position = position.map(|x| self.give_back(x, 1));
        place
    }

    /// The unit that is to 1 what 1 is to this one.
    pub fn inverse(self) -> Self {
        Self { exponent: -self.exponent }
    }

    /// The product of two units.
    pub fn times(self, other: Self) -> Self {
        Self { exponent: self.exponent + other.exponent }
    }
}

impl std::fmt::Display for Unit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "2^{}", self.exponent)
    }
}

/// The exponent of the largest power of two up to a positive finite number.
fn floor_log2(x: f64) -> i32 {
    const BIAS: i32 = 1023;
    const MANTISSA: i32 = 52;
    match (x.to_bits() >> MANTISSA) as i32 {
        // Denormal.
        0 => floor_log2(x * 2f64.powi(2 * MANTISSA)) - 2 * MANTISSA,
        biased => biased - BIAS,
    }
}

/// `x * 2^exponent`, rounded at most once: powers of two beyond the range of numbers are taken in steps.
fn times_power_of_two(mut x: f64, mut exponent: i32) -> f64 {
    /// A power of two that is a number, and so is its inverse.
    const STEP: i32 = 1000;
    while exponent > STEP {
        (x, exponent) = (x * 2f64.powi(STEP), exponent - STEP);
    }
    while exponent < -STEP {
        // The last step takes what is left, so that only it can round.
        let step = STEP.min(-exponent - STEP).max(1);
        (x, exponent) = (x * 2f64.powi(-step), exponent + step);
    }
    x * 2f64.powi(exponent)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn taking_and_giving_back_are_exact_over_the_range_of_numbers() {
        for size in [1.5e-308, 3e-300, 1e-80, 0.75, 1.0, 1e8, 1e78, 8e307] {
            let points = [Vec3::new(size, -0.25 * size, 0.0), Vec3::new(-size, 0.125 * size, size)];
            let unit = Unit::of(&points);
            let taken = unit.take_points(&points);
            let half = 0.5 * (taken[0].x - taken[1].x);
            assert!((1.0..2.0).contains(&half), "{size}: {half}");
            assert_eq!(unit.give_back_points(&taken), points);
            // The same bits in any unit of a power of two.
            let mantissa = size / 2f64.powi(floor_log2(size));
            assert_eq!(taken[0].x, mantissa);
        }
        assert!(Unit::of_extreme(&[Vec3::zeros(), Vec3::repeat(1e9)]).is_one());
        assert!(!Unit::of_extreme(&[Vec3::zeros(), Vec3::repeat(1e-13)]).is_one());
        assert!(Unit::of(&[Vec3::repeat(3.0)]).is_one() && Unit::of(&[]).is_one());
        let huge = Unit::of(&[Vec3::zeros(), Vec3::repeat(1e200)]);
        assert_eq!((huge.give_back(1.0, 3), huge.take(1.0, 3)), (f64::INFINITY, 0.0));
    }
}

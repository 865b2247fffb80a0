//! Numbers within limits.

use std::ops::{Range, RangeInclusive};
use std::time::Duration;

use super::error::Fault;

/// A whole number, or its default.
///
/// # Panics
/// When the limits or the default do not fit `N`.
pub(super) fn whole<N: TryFrom<i64>>(
    given: Option<i64>,
    default: i64,
    limits: RangeInclusive<i64>,
    key: &[&'static str],
) -> Result<N, Fault> {
    let number = given.unwrap_or(default);
    if limits.contains(&number) {
        return Ok(N::try_from(number).ok().expect("limits and default fit the type"));
    }
    let (least, most) = limits.into_inner();
    let message = format!("`{}` is {number}, but must lie between {least} and {most}", key.join("."));
    Err(Fault::at(key, message, format!("the default is {default}; `qcball schema` describes every key")))
}

/// A finite number greater than 0, or its default.
pub(super) fn positive(given: Option<f64>, default: f64, key: &[&'static str]) -> Result<f64, Fault> {
    match given {
        None => Ok(default),
        Some(number) if number.is_finite() && number > 0.0 => Ok(number),
        Some(number) => {
            let message = format!("`{}` is {number}, but must be finite and greater than 0", key.join("."));
            Err(Fault::at(key, message, format!("for example {default}; `qcball schema` describes every key")))
        }
    }
}

/// Seconds greater than 0, with an example for who gave none such.
pub(super) fn duration(seconds: f64, example: f64, key: &[&'static str]) -> Result<Duration, Fault> {
    /// Some thirty years: longer than any run, and far from the largest `Duration`.
    const LONGEST: f64 = 1e9;
    Ok(Duration::from_secs_f64(positive(Some(seconds), example, key)?.min(LONGEST)))
}

/// A number in a half-open range, or its default.
pub(super) fn between(
    given: Option<f64>,
    default: f64,
    limits: Range<f64>,
    key: &[&'static str],
) -> Result<f64, Fault> {
    match given {
        None => Ok(default),
        Some(number) if limits.contains(&number) => Ok(number),
        Some(number) => {
            let message = format!(
                "`{}` is {number}, but must be at least {} and less than {}",
                key.join("."),
                limits.start,
                limits.end
            );
            Err(Fault::at(key, message, format!("the default is {default}; `qcball schema` describes every key")))
        }
    }
}

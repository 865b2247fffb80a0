//! The table `[boundary]`: what happens at the corners of the solid.

use super::error::Fault;
use super::limits::positive;
use super::{Config, CornersName, CornersValue, InitialMap};
use crate::map::CornerChoice;

/// What a checked `[boundary]` means.
pub(super) fn corners(config: &Config, map: &InitialMap) -> Result<CornerChoice, Fault> {
    let key = ["boundary", "corners"];
    let choice = match config.boundary.corners {
        None | Some(CornersValue::Named(CornersName::Linear)) => return Ok(CornerChoice::Linear),
        Some(CornersValue::Named(CornersName::Power)) => CornerChoice::Power,
        Some(CornersValue::Exponent(exponent)) => CornerChoice::Exponent(positive(Some(exponent), 1.5, &key)?),
    };
    if !matches!(map, InitialMap::Auto { .. } | InitialMap::Radial { .. }) {
        let message = "powers at the corners are for maps onto the ball".to_string();
        return Err(Fault::at(&key, message, "remove the key, or use the map \"radial\""));
    }
    if config.bounds.certify {
        let message =
            "the Gram certificate speaks of piecewise-linear maps, which one with powers at the corners is not";
        return Err(Fault::at(&["bounds", "certify"], message.to_string(), "remove it, or boundary.corners"));
    }
    Ok(choice)
}

//! The map to start from, and which keys of `[map]` each kind takes.

use super::boundary::EXPONENTS;
use super::error::{Fault, reworded};
use super::limits::positive;
use super::{Config, ExponentName, ExponentValue, MapKind, MapTable, MeshKind, solid};
use crate::map::AnalyticMap;
use crate::map::analytic::MapError;
use crate::solid::CentreChoice;
use crate::sphere::SphereSettings;

/// The map to start from.
#[derive(Clone, Debug, PartialEq)]
pub enum InitialMap {
    /// Radial where the solid is star-shaped, else spherical.
    Auto {
        /// Exponent a > 0 of the radial map; `None` for the best one.
        exponent: Option<f64>,
    },
    /// Caraman's radial map onto the unit ball.
    Radial {
        /// Exponent a > 0, 1 maps rays linearly; `None` for the best one.
        exponent: Option<f64>,
    },
    /// The boundary onto the sphere by progressive embedding, the inside hyperbolic harmonic.
    Spherical {
        /// What the boundary's map weighs.
        weights: SphereSettings,
    },
    /// The radial map's extension to solids that are not star-shaped, with the exponent a > 0.
    Farthest {
        /// Exponent a > 0.
        exponent: f64,
    },
    /// A map in closed form, checked.
    Formula(AnalyticMap),
}

/// What a checked `[map]` means.
pub(super) fn plan(config: &Config, is_mesh: bool) -> Result<InitialMap, Fault> {
    let table = &config.map;
    match table.kind {
        MapKind::Auto => Ok(InitialMap::Auto { exponent: radial_exponent(table)? }),
        MapKind::Radial => Ok(InitialMap::Radial { exponent: radial_exponent(table)? }),
        MapKind::Spherical => spherical(table),
        MapKind::Farthest => farthest(config, is_mesh),
        _ => formula(table).map(InitialMap::Formula),
    }
}

/// The keys that were given, `kind` included.
fn given(table: &MapTable) -> toml::Table {
    toml::Table::try_from(table).expect("numbers, names and lists of them")
}

fn radial_exponent(table: &MapTable) -> Result<Option<f64>, Fault> {
    if let Some(key) = given(table).keys().find(|key| !["kind", "exponent"].contains(&key.as_str())) {
        let message = format!("`{key}` is no parameter of a radial map");
        let help = "remove it, or choose the kind of the map that it belongs to; `qcball schema` describes every key";
        return Err(Fault::at(&["map", key], message, help));
    }
    match table.exponent {
        None => Ok(Some(1.0)),
        Some(ExponentValue::Named(ExponentName::Optimize)) => Ok(None),
        Some(ExponentValue::Given(exponent)) => {
            let exponent = positive(Some(exponent), 1.0, &["map", "exponent"])?;
            if !EXPONENTS.contains(&exponent) {
                let (least, most) = (EXPONENTS.start(), EXPONENTS.end());
                let message = format!("`map.exponent` is {exponent}, but must be a number from {least} to {most}");
                let help = "the largest K of a radial map grows like the square of its exponent, or of 1 over it";
                return Err(Fault::at(&["map", "exponent"], message, help));
            }
            Ok(Some(exponent))
        }
    }
}

fn spherical(table: &MapTable) -> Result<InitialMap, Fault> {
    if let Some(key) = given(table).keys().find(|key| !["kind", "area_weight"].contains(&key.as_str())) {
        let message = format!("`{key}` is no parameter of a spherical map, which has `area_weight`");
        return Err(Fault::at(&["map", key], message, "remove it, or choose the kind of the map that it belongs to"));
    }
    let usual = SphereSettings::default();
    let area_weight = table.area_weight.unwrap_or(usual.area_weight);
    if !(0.0..f64::INFINITY).contains(&area_weight) {
        let message = format!("`map.area_weight` is {area_weight}, but must be finite and at least 0");
        return Err(Fault::at(&["map", "area_weight"], message, "give a number such as 0.1"));
    }
    Ok(InitialMap::Spherical { weights: SphereSettings { area_weight, ..usual } })
}

fn only_radial() -> Fault {
    let message = "the best exponent is known for the map \"radial\" only".to_string();
    Fault::at(&["map", "exponent"], message, "give a number")
}

fn farthest(config: &Config, is_mesh: bool) -> Result<InitialMap, Fault> {
    let exponent = radial_exponent(&config.map)?;
    // All that is wrong at once: each would be the next message after the last.
    let (mut messages, mut helps) = (Vec::new(), Vec::new());
    if !is_mesh && matches!(config.mesh.kind, MeshKind::Auto | MeshKind::Shell | MeshKind::Flag) {
        messages.push("cannot start from a shell or flag mesh, which are for star-shaped solids");
        helps.push("give a mesh as domain.file, or set mesh.kind to \"tetgen\" or \"gmsh\"");
    }
    if !matches!(solid::centre(config)?, CentreChoice::Centroid | CentreChoice::BoundingBox | CentreChoice::At(_)) {
        messages.push("is for solids without a star centre");
        helps.push("set domain.centre to \"centroid\", \"bbox\" or a point [x, y, z]");
    }
    if exponent.is_none() {
        messages.push("has no best exponent");
        helps.push("give map.exponent a number");
    }
    match exponent {
        Some(exponent) if messages.is_empty() => Ok(InitialMap::Farthest { exponent }),
        _ => {
            let message = format!("the map \"farthest\" {}", messages.join(", and it "));
            Err(Fault::at(&["map", "kind"], message, helps.join("; ") + "; or use kind = \"spherical\""))
        }
    }
}

/// Read as one of `[analytic]` is: its own type knows its parameters.
fn formula(table: &MapTable) -> Result<AnalyticMap, Fault> {
    if matches!(table.exponent, Some(ExponentValue::Named(_))) {
        return Err(only_radial());
    }
    let map: AnalyticMap = given(table).try_into().map_err(|error: toml::de::Error| {
        let message = error.message().trim_end();
        // serde quotes the name first, whether it is missing or not known.
        let key = message.split('`').nth(1).unwrap_or("kind");
        let (what, help) = reworded(message, Some(&format!("map.{key}")));
        Fault::at(&["map", key], what, help)
    })?;
    map.check().map_err(|error| {
        let key = if let MapError::Parameter { parameter, .. } = error { parameter } else { "kind" };
        Fault::at(&["map", key], format!("[map]: {error}"), "correct the parameter")
    })?;
    Ok(map)
}

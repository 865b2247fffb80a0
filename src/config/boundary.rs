//! The table `[boundary]`: what happens at the corners of the solid, and next to its boundary.

use std::ops::RangeInclusive;

use serde::de::{Deserialize, Deserializer, Visitor};

use super::error::Fault;
use super::{Config, CornersName, CornersValue, InitialMap, MeshPlan};
use crate::map::CornerChoice;
use crate::mesh::VertexId;

/// Not by serde's `untagged`, which tells no misspelled name.
impl<'de> Deserialize<'de> for CornersValue {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;
        impl Visitor<'_> for Either {
            type Value = CornersValue;

            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("\"linear\", \"power\" or a number")
            }

            fn visit_str<E: serde::de::Error>(self, name: &str) -> Result<CornersValue, E> {
                match name {
                    "linear" => Ok(CornersValue::Named(CornersName::Linear)),
                    "power" => Ok(CornersValue::Named(CornersName::Power)),
                    _ => Err(E::unknown_variant(name, &["linear", "power", "a number"])),
                }
            }

            fn visit_f64<E>(self, exponent: f64) -> Result<CornersValue, E> {
                Ok(CornersValue::Exponent(exponent))
            }

            fn visit_i64<E>(self, exponent: i64) -> Result<CornersValue, E> {
                Ok(CornersValue::Exponent(exponent as f64))
            }
        }
        deserializer.deserialize_any(Either)
    }
}

/// Exponents of distances, from a corner or from the centre: with others r^p leaves the range in which a map and its inverse can be told
/// from rounding.
pub(super) const EXPONENTS: RangeInclusive<f64> = 0.05..=50.0;

/// The most tets that a collar may add, as a share of all.
pub(super) fn collar(config: &Config, mesh: &MeshPlan) -> Result<f64, Fault> {
    /// More would be another mesh.
    const MOST: f64 = 10.0;
    let (collar, key) = (config.boundary.collar, ["boundary", "collar"]);
    if !(0.0..=MOST).contains(&collar) {
        let message = format!("`boundary.collar` is {collar}, but must be at least 0 and at most {MOST}");
        return Err(Fault::at(&key, message, "it is the share of tets that may be added, for example 1.0"));
    }
    if collar > 0.0 && config.domain.keep_mesh {
        let message = "a collar splits tets, and `domain.keep_mesh` forbids that".to_string();
        return Err(Fault::at(&key, message, "remove one of the two"));
    }
    if collar > 0.0 && matches!(mesh, MeshPlan::Shell(_) | MeshPlan::Flag(_)) {
        let message = "a collar is for meshes that are given or made by TetGen or Gmsh".to_string();
        return Err(Fault::at(&key, message, "remove it, or choose another mesh.kind"));
    }
    Ok(collar)
}

/// What a checked `[boundary]` means for the corners.
pub(super) fn corners(config: &Config, map: &InitialMap) -> Result<CornerChoice, Fault> {
    let key = ["boundary", "corners"];
    let choice = match config.boundary.corners {
        None | Some(CornersValue::Named(CornersName::Linear)) => return Ok(CornerChoice::Linear),
        Some(CornersValue::Named(CornersName::Power)) => CornerChoice::Power,
        Some(CornersValue::Exponent(exponent)) if !EXPONENTS.contains(&exponent) => {
            let (least, most) = (EXPONENTS.start(), EXPONENTS.end());
            let message = format!("`boundary.corners` is {exponent}, but must be a number from {least} to {most}");
            return Err(Fault::at(&key, message, "give for example 1.5, or \"power\""));
        }
        Some(CornersValue::Exponent(exponent)) => CornerChoice::Exponent(exponent),
    };
    if !matches!(map, InitialMap::Auto { .. } | InitialMap::Radial { .. } | InitialMap::Spherical { .. }) {
        let message = "powers at the corners are for the maps \"auto\", \"radial\" and \"spherical\"".to_string();
        return Err(Fault::at(&key, message, "remove the key or `map.kind`"));
    }
    Ok(choice)
}

/// The vertices that are to be corners, in ascending order; `None` for those that the solid's shape tells.
pub(super) fn corner_vertices(config: &Config, choice: CornerChoice) -> Result<Option<Vec<VertexId>>, Fault> {
    let key = ["boundary", "corner_vertices"];
    let Some(numbers) = &config.boundary.corner_vertices else { return Ok(None) };
    let refuse = |message: String, advice: &str| Err(Fault::at(&key, message, advice));
    if choice == CornerChoice::Linear {
        let message = "corners are listed, but the map is linear there".to_string();
        return refuse(message, "add corners = \"power\" or an exponent, or remove the list");
    }
    let Ok(mut vertices) = numbers.iter().map(|&v| u32::try_from(v).map(VertexId)).collect::<Result<Vec<_>, _>>()
    else {
        let message = format!("`boundary.corner_vertices` is {numbers:?}, but must be numbers of vertices");
        return refuse(message, "vertices are counted from 0");
    };
    vertices.sort_unstable();
    if vertices.is_empty() {
        return refuse("`boundary.corner_vertices` is empty".into(), "remove it, or corners = \"linear\"");
    }
    if let Some(twice) = vertices.windows(2).find(|pair| pair[0] == pair[1]) {
        return refuse(format!("`boundary.corner_vertices` names {} twice", twice[0].0), "name a vertex once");
    }
    Ok(Some(vertices))
}

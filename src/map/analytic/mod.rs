//! Maps in closed form, with their Jacobians and their exact dilatations (paper §2.3, 2.4).

mod affine;
mod caraman;
mod composition;
mod cone;
mod folding;
mod power;
mod zorich;
mod zorich1;
mod zorich2;

pub use affine::Affine;
pub use caraman::{Caraman, CaramanError};
pub use composition::Composition;
pub use cone::Cone;
pub use folding::Folding;
pub use power::Power;
pub use zorich::Zorich;
pub use zorich1::Zorich1;
pub use zorich2::Zorich2;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::dilatation::Dilatation;
use crate::mesh::{Mat3, Vec3};

/// Why a map has no value, or is none.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MapError {
    /// A parameter out of its range.
    #[error("{parameter} is {value}, but {requirement}")]
    Parameter {
        /// The parameter's name.
        parameter: &'static str,
        /// The value given.
        value: f64,
        /// What it must be.
        requirement: &'static str,
    },
    /// A point outside of the map's domain of validity.
    #[error("the {map} map is not defined at {at:?}: {reason}")]
    Outside {
        /// The map's name.
        map: &'static str,
        /// The point.
        at: [f64; 3],
        /// What the domain is, and what to do.
        reason: String,
    },
    /// Words of a command line that make no map.
    #[error("{0}")]
    Words(String),
}

/// A map that a formula gives; `kind` in a config, with the parameters as further keys.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(tag = "kind", rename_all = "kebab-case", expecting = "a map { kind = ..., ... }")]
pub enum AnalyticMap {
    /// x -> A x + b.
    Affine(Affine),
    /// Multiplies the azimuth (paper eq. 11, 13).
    Folding(Folding),
    /// Multiplies the polar angle (paper eq. 12).
    Cone(Cone),
    /// |x|^(a-1) x (paper eq. 14, 15).
    Power(Power),
    /// A square cylinder onto a round one (paper eq. 16).
    Zorich1(Zorich1),
    /// A round cylinder onto a half-space (paper eq. 17).
    Zorich2(Zorich2),
    /// A square cylinder onto a half-space (paper eq. 18).
    Zorich(Zorich),
    /// The radial map of a star-shaped polyhedron onto the unit ball (paper eq. 20); made from a surface, not from keys.
    #[serde(skip)]
    Caraman(Caraman),
    /// Several maps, one after the other.
    Composition(Composition),
}

/// The maps of the command line, but for a composition, which is easier made by several calls; the last one is [`Caraman::new`], from the mesh that it is applied to.
#[cfg(feature = "cli")]
const NAMES: &str = "affine, folding, cone, power, zorich1, zorich2, zorich and caraman";

/// A value of a parameter without a default.
#[cfg(feature = "cli")]
fn example(key: &str) -> &'static str {
    match key {
        "matrix" => "\"[[2, 0, 0], [0, 1, 0], [0, 0, 1]]\"",
        "maps" => "\"[{ kind = 'folding', ratio = 1.5 }]\"",
        _ => "1.5",
    }
}

/// What every map in closed form knows of itself.
trait ClosedForm {
    /// The name in messages.
    fn name(&self) -> &'static str;

    /// Whether the parameters make a map.
    fn check(&self) -> Result<(), MapError>;

    /// The image of a point.
    fn value(&self, x: &Vec3) -> Result<Vec3, MapError>;

    /// The matrix of partial derivatives, row i those of coordinate i.
    fn jacobian(&self, x: &Vec3) -> Result<Mat3, MapError>;

    /// The dilatations of the Jacobian, of |det| where the map reverses orientation.
    fn dilatation(&self, x: &Vec3) -> Result<Dilatation, MapError>;

    /// The suprema of K_I and of K_O over the domain of validity, if a formula gives them.
    fn max_dilatation(&self) -> Option<Dilatation>;

    fn outside(&self, at: &Vec3, reason: impl Into<String>) -> MapError
    where
        Self: Sized,
    {
        MapError::Outside { map: self.name(), at: (*at).into(), reason: reason.into() }
    }
}

impl std::fmt::Display for AnalyticMap {
    /// The kind and the parameters that were given, but for the angle of a cone.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Affine(Affine { matrix, offset: [0.0, 0.0, 0.0] }) => write!(f, "affine, matrix {matrix:?}"),
            Self::Affine(Affine { matrix, offset }) => write!(f, "affine, matrix {matrix:?}, offset {offset:?}"),
            Self::Folding(Folding { ratio }) => write!(f, "folding, ratio {ratio}"),
            Self::Cone(Cone { ratio, .. }) => write!(f, "cone, ratio {ratio}"),
            Self::Power(Power { exponent }) => write!(f, "power, exponent {exponent}"),
            Self::Zorich1(Zorich1 { half_side }) => write!(f, "zorich1, half side {half_side}"),
            Self::Zorich2(Zorich2 { half_side }) => write!(f, "zorich2, half side {half_side}"),
            Self::Zorich(Zorich { half_side }) => write!(f, "zorich, half side {half_side}"),
            Self::Caraman(map) => write!(f, "caraman, exponent {}", map.exponent()),
            Self::Composition(Composition { maps }) => {
                let names: Vec<String> = maps.iter().map(Self::to_string).collect();
                f.write_str(&names.join(", then "))
            }
        }
    }
}

impl AnalyticMap {
    /// The map with the given name and parameters `key=value`; a value is written as in TOML (`[1, 0, 0]`).
    ///
    /// # Errors
    /// An unknown name or key, a missing one, a value of the wrong type or out of range. `caraman`, which needs a
    /// surface, is not made from words.
    #[cfg(feature = "cli")]
    pub fn from_words(name: &str, words: &[String]) -> Result<Self, MapError> {
        let mut table = toml::Table::new();
        for word in words {
            let (key, value) = word
                .split_once('=')
                .ok_or_else(|| MapError::Words(format!("`{word}` is no parameter; write it as key=value")))?;
            let value = toml::from_str::<toml::Table>(&format!("value = {value}"))
                .ok()
                .and_then(|mut table| table.remove("value"))
                .ok_or_else(|| MapError::Words(format!("`{key}`: {value:?} is no number or list of numbers")))?;
            if table.insert(key.to_owned(), value).is_some() {
                return Err(MapError::Words(format!("`{key}` is given twice")));
            }
        }
        table.insert("kind".into(), name.into());
        let map: Self = table.try_into().map_err(|error: toml::de::Error| {
            let message = error.message().trim_end();
            let missing = message.strip_prefix("missing field `").and_then(|rest| rest.strip_suffix('`'));
            MapError::Words(match missing {
                _ if message.starts_with("unknown variant") => format!("there is no map `{name}`; there are {NAMES}"),
                Some(key) => format!("the map {name}: `{key}` is missing; write for example {key}={}", example(key)),
                None => format!("the map {name}: {message}"),
            })
        })?;
        map.check()?;
        Ok(map)
    }

    fn form(&self) -> &dyn ClosedForm {
        match self {
            Self::Affine(map) => map,
            Self::Folding(map) => map,
            Self::Cone(map) => map,
            Self::Power(map) => map,
            Self::Zorich1(map) => map,
            Self::Zorich2(map) => map,
            Self::Zorich(map) => map,
            Self::Caraman(map) => map,
            Self::Composition(map) => map,
        }
    }

    /// Checks the parameters; to be called once on a map that was read.
    ///
    /// # Errors
    /// The first parameter out of range.
    pub fn check(&self) -> Result<(), MapError> {
        self.form().check()
    }

    /// The image of a point.
    ///
    /// # Errors
    /// A point outside of the domain of validity, or one whose image overflows.
    pub fn value(&self, x: &Vec3) -> Result<Vec3, MapError> {
        let form = self.form();
        let image = form.value(x)?;
        if image.iter().all(|coordinate| coordinate.is_finite()) {
            Ok(image)
        } else {
            let reason = "its image is too large for a number; scale the mesh".to_owned();
            Err(MapError::Outside { map: form.name(), at: (*x).into(), reason })
        }
    }

    /// The exact Jacobian. On the surfaces where a map's formula changes (the diagonals of a Zorich map's square, the cones
    /// over the edges of Caraman's) it is that of one of the sides.
    ///
    /// # Errors
    /// A point outside of the domain of validity, or one where the map has no derivative.
    pub fn jacobian(&self, x: &Vec3) -> Result<Mat3, MapError> {
        self.form().jacobian(x)
    }

    /// The exact dilatations at a point, from the map's formula and not from its Jacobian (a composition's apart). A map that
    /// reverses orientation has those of |det|.
    ///
    /// # Errors
    /// As [`AnalyticMap::jacobian`].
    pub fn dilatation(&self, x: &Vec3) -> Result<Dilatation, MapError> {
        self.form().dilatation(x)
    }

    /// The least upper bounds of K_I and of K_O over the domain of validity; infinite if there is none. Not known of
    /// compositions: there K_I and K_O are at most the products.
    pub fn max_dilatation(&self) -> Option<Dilatation> {
        self.form().max_dilatation()
    }

    /// The images of many points.
    ///
    /// # Errors
    /// The number of the first point without an image, and why.
    pub fn apply(&self, points: &[Vec3]) -> Result<Vec<Vec3>, (usize, MapError)> {
        let images: Vec<Result<Vec3, MapError>> = points.par_iter().map(|point| self.value(point)).collect();
        images.into_iter().enumerate().map(|(index, image)| image.map_err(|error| (index, error))).collect()
    }
}

/// A positive, finite parameter.
fn positive(parameter: &'static str, value: f64) -> Result<(), MapError> {
    if value > 0.0 && value.is_finite() {
        Ok(())
    } else {
        Err(MapError::Parameter { parameter, value, requirement: "it must be a positive number" })
    }
}

/// By how much of itself a bound of a domain may be passed: a few roundings.
const SLACK: f64 = 1.0 + 8.0 * f64::EPSILON;

/// The unit vectors of cylindrical coordinates about the z-axis.
struct Cylindrical {
    /// Away from the axis.
    outward: Vec3,
    /// In the direction of growing azimuth.
    around: Vec3,
}

impl Cylindrical {
    /// None on the axis.
    fn of(x: &Vec3) -> Option<Self> {
        let radius = x.x.hypot(x.y);
        let (cosine, sine) = (x.x / radius, x.y / radius);
        (radius > 0.0).then(|| Self { outward: Vec3::new(cosine, sine, 0.0), around: Vec3::new(-sine, cosine, 0.0) })
    }
}

#[cfg(test)]
mod tests;

//! Maps of a domain: the radial map to the unit ball, harmonic maps inside of a boundary map, maps in closed form, whether a map
//! is bijective, and a map and its inverse at any points.

pub mod analytic;
mod bijective;
pub mod corner;
mod evaluate;
mod harmonic;
mod locate;
mod radial;
mod spherical;

pub use analytic::AnalyticMap;
pub use bijective::{Bijectivity, bijectivity};
pub use corner::{Cone, CornerChoice, CornerError, Corners, Elements, Warp};
pub use evaluate::{Evaluator, EvaluatorError, Located, Onto};
pub use harmonic::{harmonic, hyperbolic_harmonic};
pub use radial::{RadialCoordinates, RayEnd, RayError, Rays, by_ray_casting, caraman};
pub use spherical::{AREA_WEIGHT_OVER_COLLAR, SphericalStarts, spherical_starts, spherical_starts_over_collar};

//! Maps of a domain: the radial map to the unit ball, maps in closed form, and whether a map is bijective.

pub mod analytic;
mod bijective;
mod radial;

pub use analytic::AnalyticMap;
pub use bijective::{Bijectivity, bijectivity};
pub use radial::{RadialCoordinates, RayEnd, RayError, by_ray_casting, caraman};

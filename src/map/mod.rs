//! Maps of a domain to the unit ball.

mod bijective;
mod radial;

pub use bijective::{Bijectivity, bijectivity};
pub use radial::{RadialCoordinates, RayEnd, RayError, by_ray_casting, caraman};

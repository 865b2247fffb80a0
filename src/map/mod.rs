//! Maps of a domain to the unit ball.

mod bijective;
mod radial;

pub use bijective::{Bijectivity, bijectivity};
pub use radial::{RadialCoordinates, RayError, by_ray_casting, caraman, radial_dilatation};

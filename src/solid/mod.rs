//! What a domain can come from: closed triangle surfaces, read or generated, their features and their star centres.

mod fan;
mod surface;

pub use fan::FanError;
pub use surface::{Surface, SurfaceEdge, SurfaceError};

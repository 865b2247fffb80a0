//! What a domain can come from: closed triangle surfaces, read or generated, their features and their star centres.

mod fan;
mod features;
mod generate;
mod platonic;
mod polyhedron;
mod prism;
mod shell;
mod smooth;
mod sphere;
mod star;
mod surface;

pub use fan::FanError;
pub use features::{FeatureAngles, Features};
pub use generate::{Solid, SolidError};
pub use shell::{MOST_TETS, Refinement, ShellError, ShellMesh, ShellSettings, shell_mesh};
pub use surface::{Surface, SurfaceEdge, SurfaceError};

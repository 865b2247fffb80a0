//! What a domain can come from: closed triangle surfaces, read or generated, and their star centres.

mod centre;
#[cfg(feature = "files")]
mod external;
mod faces;
mod flag;
mod generate;
mod inside;
mod invariants;
mod kernel;
#[cfg(feature = "nlopt")]
mod optimal_centre;
mod platonic;
mod polygon;
mod polyhedron;
mod prism;
mod radial;
mod refine;
mod repair;
mod shell;
mod smooth;
mod sphere;
mod star;
mod surface;
mod voxelize;

pub use centre::{CentreChoice, CentreError, StarCentre, star_centre};
#[cfg(feature = "files")]
pub use external::{ExternalError, ExternalMesher, ExternalSettings, Sizing, check_filled, external_mesh};
pub use flag::{Flag, FlagError, FlagMesh, FlagSettings, flag_mesh};
pub use generate::{Solid, SolidError};
pub use inside::{InsideTest, Side};
pub use invariants::{Curvature, Invariants};
pub use kernel::{KernelError, StarKernel};
pub use polygon::PolygonError;
pub use radial::{best_radial_exponent, radial_max_dilatation};
pub use refine::inscribed_stretch;
pub use repair::RepairSettings;
pub use shell::{
    MOST_TETS, MOST_TETS_FOR_BALL, Refinement, ShellError, ShellMesh, ShellSettings, shell_mesh, shell_mesh_until,
};
pub use surface::{Surface, SurfaceEdge, SurfaceError};
pub use voxelize::{Grid, VoxelizeError, Voxels, voxelize};

//! Which solids are left to an external mesher and the spherical start.

use super::error::Fault;
use crate::cancel::Cancel;
use crate::config::{DomainSource, InitialMap, Plan};
use crate::mesh::TetMesh;
use crate::solid::{
    CentreChoice, ExternalError, ExternalMesher, ExternalSettings, Refinement, ShellMesh, ShellSettings, StarCentre,
    Surface, external_mesh,
};

/// The angle in degrees between rays and faces below which a solid counts as star-shaped in name only: the radial map has a K beyond a
/// thousand there, and cones over such faces are slivers.
const GRAZING: f64 = 5.0;

/// Whether the solid of a file is star-shaped so barely that its boundary is better mapped as that of any solid, and nobody asked for rays.
pub(super) fn is_grazed(centre: &StarCentre, plan: &Plan) -> bool {
    centre.smallest_angle.to_degrees() < GRAZING
        && plan.centre == CentreChoice::Kernel
        && matches!(plan.map, InitialMap::Auto { .. })
        && !matches!(plan.domain, DomainSource::Solid(_))
}

/// The same in words, the beginning of a warning.
pub(super) fn grazed(centre: &StarCentre) -> String {
    format!(
        "the solid is star-shaped, but rays from its centre meet faces at {:.2} degrees",
        centre.smallest_angle.to_degrees()
    )
}

/// The mesh of such a solid by an external mesher, if one is there and makes it; `None` for solids that go well in shells, too, and
/// for those whose config has keys for them.
pub(super) fn instead_of_shells(
    surface: &Surface,
    centre: &StarCentre,
    external: &ExternalSettings,
    shell_keys: &[&str],
    plan: &Plan,
) -> Option<TetMesh> {
    let wanted = is_grazed(centre, plan) && shell_keys.is_empty();
    // It may take minutes over a sheet, for nothing.
    let settings = ExternalSettings {
        time_limit: plan.optimize.time_limit.map_or(external.time_limit, |limit| limit.min(external.time_limit)),
        ..external.clone()
    };
    wanted.then(|| mesh_of_any_solid(surface, &settings, &plan.optimize.cancel).ok()).flatten()
}

/// What is said where the surface as it is takes more tets than the config asks for.
pub(super) fn more_cells(surface: &Surface, settings: &ShellSettings, shell: &ShellMesh) -> Option<String> {
    let (triangles, tets) = (surface.triangles().len(), shell.mesh.tets().len());
    let Some(Refinement::Cells(wanted)) = settings.refinement else { return None };
    (tets > wanted && shell.surface.triangles().len() == triangles).then(|| {
        let layers = settings.layers;
        format!(
            "mesh.cells asks for {wanted} tets, but {layers} layers over the surface's {triangles} triangles take {tets}; fewer layers \
             (mesh.layers) or a coarser surface take fewer"
        )
    })
}

/// Fills a solid by another program: TetGen does where it is installed, else Gmsh.
pub(super) fn mesh_of_any_solid(
    surface: &Surface,
    settings: &ExternalSettings,
    cancel: &Cancel,
) -> Result<TetMesh, Fault> {
    let gmsh =
        || external_mesh(surface, &ExternalSettings { mesher: ExternalMesher::Gmsh, ..settings.clone() }, cancel);
    match external_mesh(surface, settings, cancel) {
        Err(ExternalError::Missing { .. }) => match gmsh() {
            Err(ExternalError::Missing { .. }) => Err(Fault::NoMesher),
            mesh => Ok(mesh?),
        },
        mesh => Ok(mesh?),
    }
}

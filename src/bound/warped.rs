//! Bounds for maps that are like powers of the distance at the corners of the solid ([`crate::map::corner`]), with exponents given.

use super::{BoundName, BoundaryImage, LowerBound, Scope, all_until, apex, certificate, locked, vertex_with_powers};
use crate::cancel::Cancel;
use crate::domain::Domain;
use crate::map::{Corners, Elements};
use crate::mesh::{BoundaryEdges, Place, Vec3, VertexId};

/// Which maps those bounds speak of that know the exponents.
const MAPS: &str = "any map of this mesh with these boundary positions, PL but for these powers at the corners";

/// All bounds known for maps of `domain` with these boundary positions that are piecewise linear after the warps of `corners`; see
/// [`super::all`]. `elements` are those of the corners. None speaks of the radial boundary values alone.
///
/// Those that hold for all quasi-conformal maps do. Of those for maps of the mesh, the ones by the dihedral angles at one edge hold,
/// whatever the exponents, if that edge is in no warped cone or on a line through the corner: a warp takes each half-plane through the corner to
/// itself, so that near an inner point of such an edge the angles are those of the piecewise-linear map. The vertex bound
/// ([`vertex_with_powers`]) and those of tets, locked ones and those around a free vertex, hold for the exponents given: to the tets a warped map is
/// nothing but several linear maps each, its elements.
///
/// # Panics
/// If `image` has fewer positions than the domain has vertices.
pub fn with_corners(
    domain: &Domain,
    corners: &Corners,
    elements: &Elements,
    image: &[Vec3],
    cancel: &Cancel,
) -> Vec<LowerBound> {
    let mut bounds = all_until(domain, image, None, false, cancel);
    bounds.retain_mut(|bound| {
        if bound.scope != Scope::MeshFixedBoundary {
            return bound.scope == Scope::Shape;
        }
        bound.reason = "any map of this mesh with these boundary positions, PL but for powers at the corners".into();
        matches!(bound.name, BoundName::EdgeRatio | BoundName::Fan) && keeps_angles(bound, domain, corners)
    });
    if cancel.is_due() {
        return bounds;
    }
    let edges = BoundaryEdges::of(domain.mesh(), domain.boundary());
    let boundary_image = BoundaryImage::new(domain, &edges, image);
    let mut of_powers: Vec<LowerBound> = locked(&elements.domain, image).into_iter().collect();
    of_powers.extend(vertex_with_powers(domain, &edges, boundary_image, &corners.exponents()));
    of_powers.extend(apex(&elements.domain, image, cancel));
    bounds.extend(of_powers.into_iter().map(worded));
    bounds
}

/// The bound that a certificate proves for such maps. Its tets are numbers of elements, as [`certificate::search()`] gives them on
/// the domain of the elements.
///
/// # Errors
/// Why the certificate is rejected.
///
/// # Panics
/// If `image` has fewer positions than the domain has vertices.
pub fn gram_with_corners(
    found: &certificate::Certificate,
    elements: &Elements,
    image: &[Vec3],
) -> Result<LowerBound, certificate::Rejection> {
    Ok(worded(certificate::bound(found, &elements.domain, image)?))
}

/// With the maps it speaks of: others with other exponents may have a smaller K.
fn worded(bound: LowerBound) -> LowerBound {
    let more = bound.reason.split_once("; ").map_or(String::new(), |(_, more)| format!("; {more}"));
    LowerBound { reason: format!("{MAPS}{more}"), scope: Scope::MeshFixedPowers, ..bound }
}

/// Whether the warps take the half-planes at the bound's edge to half-planes.
fn keeps_angles(bound: &LowerBound, domain: &Domain, corners: &Corners) -> bool {
    let Some(Place::Edge { vertices, .. }) = &bound.place else { return false };
    let ends = vertices.map(VertexId);
    let at = |v: VertexId| domain.mesh().points()[v.index()];
    let radial = |corner: VertexId| {
        let [a, b] = ends.map(|v| at(v) - at(corner));
        ends.contains(&corner) || a.cross(&b).norm() <= 1e-9 * a.norm() * b.norm()
    };
    let around =
        domain.mesh().tets().iter().zip(corners.of_tets()).filter(|(tet, _)| ends.iter().all(|v| tet.contains(v)));
    let mut cones = around.filter_map(|(_, cone)| cone.map(|cone| corners.cones()[cone as usize].corner));
    cones.all(radial)
}

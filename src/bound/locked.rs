//! Tets whose four vertices are fixed.

use super::{BoundName, Kind, LowerBound, Place, check, strongest};
use crate::domain::Domain;
use crate::mesh::{TetMesh, Vec3};

/// The largest K of a tet with all four vertices on the boundary: exactly the K that every piecewise-linear map of this
/// mesh with these boundary positions has there. Nothing if there is no such tet, or all of them are flipped.
///
/// A flipped locked tet means that no orientation-preserving map with these boundary positions exists; it has no finite
/// K and is passed over. The place is one of the tet's faces.
///
/// Checked by `check::linear::locked`. Tets too thin for intervals are passed over as well.
pub fn locked(domain: &Domain, image: &[Vec3]) -> Option<LowerBound> {
    let values = domain.locked_tets().filter_map(|tet| {
        let jacobian = domain.jacobian(tet, image);
        let right = jacobian.iter().all(|x| x.is_finite()).then(|| crate::linalg::svd(&jacobian).right)?;
        let images = domain.mesh().tets()[tet.index()].map(|v| image[v.index()]);
        let vectors = [0, 2].map(|i| right.column(i).into_owned());
        Some((check::linear::locked(domain.enclosed_corners(tet), images, vectors)?.max(1.0), tet))
    });
    let (value, tet) = strongest(values)?;
    let corners = domain.mesh().tets()[tet.index()];
    Some(LowerBound::of_mesh(
        BoundName::Locked,
        Kind::K,
        value,
        Place::face(domain.mesh(), TetMesh::FACES[3].map(|i| corners[i])),
        format!("tet {} has all four vertices on the boundary, so its K is fixed", tet.0),
    ))
}

//! Tets whose four vertices are fixed (bounds.md B4.1).

use super::{Kind, LowerBound, Place, rounded_down, strongest};
use crate::dilatation::Dilatation;
use crate::domain::Domain;
use crate::mesh::{TetMesh, Vec3};

/// The largest K of a tet with all four vertices on the boundary: exactly the K that every piecewise-linear map of this
/// mesh with these boundary positions has there. Nothing if there is no such tet, or all of them are flipped.
///
/// A flipped locked tet means that no orientation-preserving map with these boundary positions exists; it has no finite
/// K and is passed over. The place is one of the tet's faces.
///
/// In floats: K is lowered by 64 eps times the condition of the tet's edge matrix times that of its Jacobian.
pub fn locked(domain: &Domain, image: &[Vec3]) -> Option<LowerBound> {
    let values = domain.locked_tets().filter_map(|tet| {
        let jacobian = domain.jacobian(tet, image);
        let [s1, _, s3] = jacobian.iter().all(|x| x.is_finite()).then(|| crate::linalg::svd(&jacobian).values)?;
        let edges = crate::mesh::edge_matrix(domain.mesh().corners(tet));
        let condition = edges.norm() * domain.inverse_edges()[tet.index()].norm() * (s1 / s3);
        let relative_error = 64.0 * f64::EPSILON * condition;
        // Also false for a flipped tet, and for NaN.
        let resolved = s3 > 0.0 && relative_error < 1.0;
        Some((resolved.then(|| rounded_down(Dilatation::of(&jacobian).k(), relative_error))??, tet))
    });
    let (value, tet) = strongest(values)?;
    let corners = domain.mesh().tets()[tet.index()];
    Some(LowerBound::of_mesh(
        "locked",
        "docs of qcball::bound::locked",
        Kind::K,
        value,
        Place::face(domain.mesh(), TetMesh::FACES[3].map(|i| corners[i])),
        format!("tet {} has all four vertices on the boundary, so its K is fixed", tet.0),
    ))
}

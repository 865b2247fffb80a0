//! The trace bound: triangles whose three vertices are fixed.

use super::check::{self, three_halves_power};
use super::{BoundName, Kind, LowerBound, Place, strongest, with_inner_and_outer};
use crate::domain::Domain;
use crate::mesh::{TetMesh, Vec3};

/// `K >= r^(3/2)`, and `K_I >= r`, `K_O >= r`, where r = r1 / r2 is the largest ratio of the two singular values of the
/// linear map of a triangle with three fixed vertices: of the boundary, or interior with all vertices on the boundary.
///
/// Holds for every piecewise-linear map of this mesh with these boundary positions.
///
/// **Proof**. In a tet at the triangle s1 >= |A v| >= s3 for every unit vector v; along the two principal directions of the
/// triangle's map this says s1 >= r1 and s3 <= r2, so H >= r. Attained, without shear, by the normal stretch
/// sqrt(r1 r2).
///
/// Checked by `check::linear::stretch_ratio`; triangles without area, or too thin for intervals, bound nothing.
pub fn trace(domain: &Domain, image: &[Vec3]) -> Option<LowerBound> {
    let (mesh, boundary) = (domain.mesh(), domain.boundary());
    let fixed = mesh
        .tets()
        .iter()
        .flat_map(|tet| TetMesh::FACES.map(|face| face.map(|i| tet[i])))
        .filter(|triangle| triangle.iter().all(|&v| boundary.contains(v)));
    let ratios = fixed.filter_map(|triangle| {
        let [before, after] = [mesh.points(), image].map(|positions| triangle.map(|v| positions[v.index()]));
        Some((check::linear::stretch_ratio(before, after)?, triangle))
    });
    let (ratio, triangle) = strongest(ratios)?;
    Some(LowerBound::of_mesh(
        BoundName::Trace,
        Kind::K,
        three_halves_power(ratio),
        Place::face(mesh, triangle),
        with_inner_and_outer("any PL map of this mesh with these boundary positions", ratio),
    ))
}

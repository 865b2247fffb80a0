//! The trace bound of the smooth problem with the radial boundary values.

use super::check::{linear::slant, three_halves_power};
use super::{BoundName, Kind, LowerBound, Place, Scope, strongest};
use crate::domain::Domain;
use crate::mesh::{Vec3, VertexId};

/// Two bounds from the radial projection of the flat faces about `centre`, with r = 1 / cos(theta), theta the largest
/// angle between a face's normal and the ray to one of its points (attained at a corner):
///
/// - `trace-smooth`: `K_I >= r` and `K_O >= r` for every quasi-conformal map of the solid onto the ball with these boundary
///   values, given as a bound on K;
/// - `trace-smooth-c1`: `K >= r^(3/2)` for those maps that are C^1 up to the boundary there. For the others the power 3/2 is
///   a conjecture, so this one is not certified for its scope.
///
/// The caller vouches that the boundary values are this projection and that `centre` lies strictly inside every face's
/// half-space; a face for which it does not bounds nothing.
///
/// **Proof**. A face at distance h is stretched by cos^2(theta) / h along the ray's trace in it and by cos(theta) / h
/// across, so the ratio of the trace's singular values is r. For maps C^1 up to the boundary [`super::trace()`]'s argument
/// applies to the differential at the point: K >= r^(3/2). In general blow up at the point: K-quasi-conformal maps with
/// normalized boundary values are compact and K_I, K_O lower semicontinuous, the limit is a map of a half-space with
/// linear boundary values M, and the energy of plane waves cos(eta . y) gives
/// `K_O >= |M^T eta|^2 / (|eta|^2 r1 r2)` and K_I at least its inverse, hence both >= r.
///
/// Checked by `check::linear::slant`.
pub fn trace_smooth(domain: &Domain, centre: Vec3) -> Vec<LowerBound> {
    let mesh = domain.mesh();
    let ratios = domain.boundary().triangles().iter().flat_map(|triangle| {
        let [a, b, c] = triangle.map(|v: VertexId| mesh.points()[v.index()]);
        let corners = [[a, b, c], [b, c, a], [c, a, b]].into_iter();
        corners.filter_map(move |corner| Some((slant(corner, &centre)?, *triangle)))
    });
    let Some((ratio, triangle)) = strongest(ratios) else {
        return Vec::new();
    };
    let bound = |name: BoundName, value, certified, reason: &str| LowerBound {
        name,
        source: name.source(),
        kind: Kind::K,
        value,
        scope: Scope::ShapeFixedTrace,
        certified,
        applies: false,
        reason: reason.into(),
        place: Some(Place::face(mesh, triangle)),
    };
    vec![
        bound(
            BoundName::TraceSmooth,
            ratio,
            true,
            "bounds K_I and K_O of maps onto the smooth ball; the measured image is a polyhedron inscribed in it",
        ),
        bound(
            BoundName::TraceSmoothC1,
            three_halves_power(ratio),
            false,
            "proved only for maps that are C^1 up to the boundary; a conjecture for others",
        ),
    ]
}

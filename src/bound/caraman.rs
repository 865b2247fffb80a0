//! The bound by the number of faces that the paper quotes after Caraman 1974 (paper eq. 41).

use super::{BoundName, Kind, LowerBound, Scope};
use crate::mesh::Features;

/// `K_I >= (m - 1) / (m - 3)` for quasi-conformal maps of a convex polyhedron with m >= 4 flat faces onto the ball;
/// nothing for a solid that is not convex.
///
/// **Quoted, not proved**: it does not follow from the wedge bound (for the regular tetrahedron it claims 3, where the
/// wedge bound gives 2.552), and we could neither prove nor refute it. It is reported as uncertified and is never
/// part of a gap.
pub fn caraman(features: &Features) -> Option<LowerBound> {
    let faces = features.flat_faces();
    if !features.is_convex() || faces < 4 {
        return None;
    }
    Some(LowerBound {
        name: BoundName::Caraman,
        source: BoundName::Caraman.source(),
        kind: Kind::Inner,
        value: ((faces as f64 - 1.0) / (faces as f64 - 3.0)).next_down(),
        scope: Scope::Shape,
        certified: false,
        applies: false,
        reason: format!("quoted for a convex polyhedron with {faces} faces; no proof known to us"),
        place: None,
    })
}

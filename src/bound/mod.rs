//! Proved lower bounds for the largest dilatation, one theorem a file, each with its scope and its proof.
//!
//! Every bound is computed from the domain, its boundary and the image positions of the *boundary* vertices alone; the
//! interior of a map can change none of them. All use one chain: with H = s1 / s3,
//! `K_I = s1 s2 / s3^2 >= H`, `K_O = s1^2 / (s2 s3) >= H` and `K_I K_O = H^3`, so a lower bound h on H gives
//! `K >= h^(3/2)`, with equality if and only if `s2^2 = s1 s3`.
//!
//! What holds where the solid is not a convex polyhedron with fixed boundary values:
//!
//! - *Concave edges, angles above pi*: fan, edge-ratio and vertex bounds hold as they stand, with the actual angles on both
//!   sides (they then bound K_O, or both). The wedge bound is for convex edges only: for concave ones with free boundary
//!   values no proof is known.
//! - *Flat edges* are no edges of the solid, but bound like others if their image is not flat; trace and apex bounds see no
//!   edges at all.
//! - *A free boundary*: only [`Scope::Shape`] speaks of it. With the boundary positions a map happens to have, the bounds of
//!   scope [`Scope::MeshFixedBoundary`] hold, but for maps with these positions alone. The vertex bound with a free boundary
//!   is false.
//!
//! Rounding: a value that is called proved is one that a small checker in interval arithmetic accepted (`check`, which says what
//! has to be believed), whatever the search for it did. Degenerate images (a collapsed or folded triangle) bound nothing
//! there: the place is passed over; and so does a tet too thin for the intervals, or less.

mod apex;
mod boundary_image;
mod caraman;
pub mod certificate;
mod check;
mod contradiction;
mod edge_limit;
mod edge_ratio;
mod end_fan;
mod fan;
mod locked;
mod name;
mod one_free_vertex;
mod trace;
mod trace_smooth;
mod vertex;
mod vertex_smooth;
mod warped;
mod wedge;

#[cfg(test)]
mod exact;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};

pub use apex::apex;
pub use boundary_image::BoundaryImage;
pub use caraman::caraman;
pub use contradiction::{Contradiction, confront};
pub use edge_limit::edge_limit;
pub use edge_ratio::edge_ratio;
pub use end_fan::end_fan;
pub use fan::fan;
pub use locked::locked;
pub use name::{BoundName, Source};
pub use trace::trace;
pub use trace_smooth::trace_smooth;
pub use vertex::{vertex, vertex_with_powers};
pub use vertex_smooth::vertex_smooth;
pub use warped::{gram_with_corners, with_corners};
pub use wedge::wedge;

use crate::cancel::Cancel;
use crate::dilatation::lower_bound;
use crate::domain::Domain;
pub use crate::mesh::Place;
use crate::mesh::{BoundaryEdges, Features, Orientation, Vec3, VertexId, orientation};

/// Which dilatation a bound holds for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Kind {
    /// The inner dilatation K_I (and so K).
    #[serde(rename = "K_I")]
    Inner,
    /// The outer dilatation K_O (and so K).
    #[serde(rename = "K_O")]
    Outer,
    /// K = max(K_I, K_O) only.
    #[serde(rename = "K")]
    K,
}

impl Kind {
    /// As formulas write it.
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Inner => "K_I",
            Self::Outer => "K_O",
            Self::K => "K",
        }
    }
}

/// Which maps a bound speaks of. A gap is taken only between a map and a bound whose scope contains it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Scope {
    /// Any quasi-conformal map of the solid onto the smooth ball, boundary values free.
    #[serde(rename = "any qc map of the solid onto the ball")]
    Shape,
    /// Any quasi-conformal map of the solid onto the smooth ball with the radial boundary values.
    #[serde(rename = "qc maps of the solid onto the ball with the radial boundary values")]
    ShapeFixedTrace,
    /// Piecewise-linear maps of this mesh with these boundary positions (`[PL-fix]`): the scope of what we measure.
    #[serde(rename = "PL maps of this mesh with this boundary")]
    MeshFixedBoundary,
    /// The same, but for powers of the distance at the corners, with these exponents.
    #[serde(rename = "maps of this mesh with this boundary, PL but for these powers")]
    MeshFixedPowers,
}

impl Scope {
    /// The maps, in words.
    pub fn in_words(self) -> &'static str {
        match self {
            Self::Shape => "any qc map of the solid onto the ball",
            Self::ShapeFixedTrace => "qc maps of the solid onto the ball with the radial boundary values",
            Self::MeshFixedBoundary => "PL maps of this mesh with this boundary",
            Self::MeshFixedPowers => "maps of this mesh with this boundary, PL but for these powers",
        }
    }
}

/// A lower bound.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct LowerBound {
    /// Which theorem it is.
    pub name: BoundName,
    /// Where that is stated: [`BoundName::source`].
    #[serde(deserialize_with = "name::known_source")]
    pub source: Source,
    /// Which dilatation it bounds.
    pub kind: Kind,
    /// The bound, >= 1 and finite.
    pub value: f64,
    /// Which maps it speaks of.
    pub scope: Scope,
    /// Proved (with the source's proof), not merely quoted.
    pub certified: bool,
    /// Whether the measured map is one of those the bound speaks of, so that the gap may be taken.
    pub applies: bool,
    /// One clause: why it applies or not.
    pub reason: String,
    /// Where it is attained.
    pub place: Option<Place>,
}

impl LowerBound {
    /// A proved bound of scope [`Scope::MeshFixedBoundary`], the scope of what is measured.
    fn of_mesh(name: BoundName, kind: Kind, value: f64, place: Place, reason: impl Into<String>) -> Self {
        let (scope, certified, applies) = (Scope::MeshFixedBoundary, true, true);
        let (source, reason, place) = (name.source(), reason.into(), Some(place));
        Self { name, source, kind, value, scope, certified, applies, reason, place }
    }
}

/// All bounds known for maps of `domain` with these boundary positions, in a fixed order; interior entries of `image` are
/// not read.
///
/// `centre` is the star centre and `radial_trace` whether the boundary positions are the radial projection about it onto
/// a sphere: without both, the bounds for the radial boundary values ([`Scope::ShapeFixedTrace`]) say nothing and are
/// left out, and so they are where a boundary triangle does not face away from the centre. Those of maps onto the ball
/// ([`Scope::Shape`]) are left out of maps onto something else: where the boundary positions lie on no sphere about 0.
///
/// # Panics
/// If `image` has fewer positions than the domain has vertices.
pub fn all(domain: &Domain, image: &[Vec3], centre: Option<Vec3>, radial_trace: bool) -> Vec<LowerBound> {
    all_until(domain, image, centre, radial_trace, &Cancel::default())
}

/// The same until it is cancelled: the bounds that were computed by then.
///
/// # Panics
/// If `image` has fewer positions than the domain has vertices.
pub fn all_until(
    domain: &Domain,
    image: &[Vec3],
    centre: Option<Vec3>,
    radial_trace: bool,
    cancel: &Cancel,
) -> Vec<LowerBound> {
    if cancel.is_due() {
        return Vec::new();
    }
    let edges = BoundaryEdges::of(domain.mesh(), domain.boundary());
    let features = Features::of(domain.mesh(), domain.boundary(), &edges);
    let boundary_image = BoundaryImage::new(domain, &edges, image);
    let is_inscribed = is_inscribed(domain, image);
    let centre = centre.filter(|centre| radial_trace && is_strict_star_centre(domain, centre));
    let theorems: [&dyn Fn() -> Vec<LowerBound>; 12] = [
        &|| locked(domain, image).into_iter().collect(),
        &|| trace(domain, image).into_iter().collect(),
        &|| edge_ratio(domain, &edges, boundary_image).into_iter().collect(),
        &|| fan(domain, &edges, boundary_image).into_iter().collect(),
        &|| end_fan(domain, &edges, boundary_image, cancel).into_iter().collect(),
        &|| vertex(domain, &edges, boundary_image).into_iter().collect(),
        &|| apex(domain, image, cancel),
        &|| is_inscribed.then(|| wedge(domain, &edges)).into_iter().flatten().collect(),
        &|| is_inscribed.then(|| caraman(&features)).into_iter().flatten().collect(),
        &|| centre.map(|_| vertex_smooth(domain)).into_iter().flatten().collect(),
        &|| centre.map(|centre| trace_smooth(domain, centre)).into_iter().flatten().collect(),
        &|| centre.map(|_| edge_limit(domain, &edges)).into_iter().flatten().collect(),
    ];
    theorems.into_iter().filter(|_| !cancel.is_due()).flat_map(|bounds| bounds()).collect()
}

/// The largest of the certified bounds whose scope contains the measured map; each bounds K, whatever its kind. The first
/// of equals.
pub fn best_applicable(bounds: &[LowerBound]) -> Option<&LowerBound> {
    bounds
        .iter()
        .filter(|bound| bound.applies && bound.certified)
        .reduce(|best, next| if next.value > best.value { next } else { best })
}

/// Whether every boundary triangle is seen from outside away from `centre`, by exact predicate: the radial projection is
/// then bi-Lipschitz on the boundary.
fn is_strict_star_centre(domain: &Domain, centre: &Vec3) -> bool {
    let at = |v: VertexId| &domain.mesh().points()[v.index()];
    let faces_away = |&[a, b, c]: &[VertexId; 3]| orientation([centre, at(a), at(b), at(c)]) == Orientation::Positive;
    centre.iter().all(|x| x.is_finite()) && domain.boundary().triangles().iter().all(faces_away)
}

/// Whether the boundary positions lie on a sphere about 0, up to the six digits that files may have.
fn is_inscribed(domain: &Domain, image: &[Vec3]) -> bool {
    let radii = || image.iter().zip(domain.boundary().vertex_mask()).filter(|(_, on)| **on).map(|(p, _)| p.norm());
    let least = radii().fold(f64::INFINITY, f64::min);
    // False for NaN, which the minimum passes over.
    least.is_finite() && radii().all(|radius| radius <= least * (1.0 + 1e-5))
}

/// The clause for a bound on H, which bounds K_I and K_O as well; rounded down like the bound itself.
fn with_inner_and_outer(maps: &str, h: f64) -> String {
    format!("{maps}; also K_I and K_O >= {}", lower_bound(h))
}

/// The candidate of largest value, the first of equals.
fn strongest<P>(candidates: impl Iterator<Item = (f64, P)>) -> Option<(f64, P)> {
    candidates.reduce(|best, next| if next.0 > best.0 { next } else { best })
}

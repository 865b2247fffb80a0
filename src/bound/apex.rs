//! The apex bound: an interior vertex over fixed faces.

use std::cmp::Reverse;

use super::one_free_vertex::FreeVertex;
use super::{BoundName, Kind, LowerBound, Place};
use crate::cancel::Cancel;
use crate::domain::Domain;
use crate::mesh::{TetId, Vec3, VertexId};

/// Most linear programs for all vertices together: some seconds.
const MOST_PROGRAMS: usize = 10_000;

/// `K >= min over p of max over tets of K`, for an interior vertex with image p and those of its tets whose three other
/// vertices lie on the boundary; the strongest over the interior vertices, for K and for K_I and K_O alone.
///
/// Holds for every orientation-preserving piecewise-linear map of this mesh with these boundary positions. It is never
/// below the trace bound of the faces involved, by which it goes beyond with the angles between them.
///
/// **Proof**. K of a tet with three fixed vertices is a quasiconvex function of the fourth, so the minimum is that of a
/// quasiconvex function in three variables; `FreeVertex::least` encloses it, with the theorem of its lower end.
///
/// Vertices are taken in the order of a first guess at their values, and each is left as soon as it cannot exceed the best
/// one so far. On large meshes, or when cancelled, the vertices that remain bound nothing; so does a
/// vertex for which no position with positive determinants is found. A tet that is too thin takes no part. A pure trace
/// question (free boundary values) is beyond this bound: it needs the image of the faces. Concave and flat edges play no part.
///
/// Checked by `check::free_vertex::excluded`.
pub fn apex(domain: &Domain, image: &[Vec3], cancel: &Cancel) -> Vec<LowerBound> {
    let stars = stars(domain, image);
    [Kind::K, Kind::Inner, Kind::Outer]
        .into_iter()
        .filter_map(|kind| {
            let (value, vertex) = strongest_star(&stars, kind, cancel)?;
            Some(LowerBound::of_mesh(
                BoundName::Apex,
                kind,
                value,
                Place::vertex(domain.mesh(), vertex),
                "any PL map of this mesh with these boundary positions",
            ))
        })
        .collect()
}

fn strongest_star(stars: &[(VertexId, FreeVertex)], kind: Kind, cancel: &Cancel) -> Option<(f64, VertexId)> {
    let (mut best, mut place, mut programs) = (1.0, None, 0);
    for (vertex, star) in stars {
        if programs >= MOST_PROGRAMS || cancel.is_due() {
            break;
        }
        let Some(least) = star.least(kind, best) else { continue };
        programs += least.programs;
        if least.lower > best {
            (best, place) = (least.lower, Some(*vertex));
        }
    }
    Some((best, place?))
}

/// The interior vertices over fixed faces, those of the largest K at a first guess first.
fn stars(domain: &Domain, image: &[Vec3]) -> Vec<(VertexId, FreeVertex)> {
    let boundary = domain.boundary();
    let mut tets: Vec<(VertexId, TetId)> = (0..)
        .map(TetId)
        .zip(domain.mesh().tets())
        .filter_map(|(id, tet)| {
            let mut free = tet.iter().filter(|&&v| !boundary.contains(v));
            let (first, second) = (free.next()?, free.next());
            second.is_none().then_some((*first, id))
        })
        .collect();
    tets.sort_unstable();
    let mut stars: Vec<(VertexId, FreeVertex)> = tets
        .chunk_by(|a, b| a.0 == b.0)
        // One tet alone has the trace bound.
        .filter(|star| star.len() > 1)
        .filter_map(|star| {
            let ids: Vec<TetId> = star.iter().map(|&(_, tet)| tet).collect();
            Some((star[0].0, FreeVertex::of(domain, star[0].0, &ids, image)?))
        })
        .collect();
    // Non-negative floats are ordered like their bits.
    stars.sort_by_key(|(vertex, star)| (Reverse(star.at_start().to_bits()), *vertex));
    stars
}

//! The vertex bound of the smooth problem with the radial boundary values.

use std::f64::consts::TAU;

use super::check::factor;
use super::vertex::domain_solid_angles;
use super::{BoundName, Kind, LowerBound, Place, Scope, strongest};
use crate::domain::Domain;
use crate::mesh::VertexId;
use crate::mesh::angle::Angle;

/// `K_I >= 2 pi / omega` and `K_O >= omega / (2 pi)` at a boundary vertex of solid angle omega, for every quasi-conformal
/// map of the solid onto the ball with the radial boundary values; the strongest of either sort that exceeds 1.
///
/// The caller vouches that the boundary values are the radial projection about a point strictly inside every face's
/// half-space: they are then bi-Lipschitz, which the proof needs. With *free* boundary values the claim is false (a power
/// of |x| at the vertex trades it away).
///
/// **Proof**. The modulus M of paths joining |x - v| = a and b in the solid is omega / log^2(b / a) (1 + o(1)) as a -> 0.
/// The images of the two spheres lie in shells |y| / a in [c, C] (quasi-symmetry and bi-Lipschitz boundary values), and
/// integrating along the rays gives M' >= 2 pi / (log(b / a) + O(1))^2. From M' <= K_I M, a -> 0, the first claim; the
/// second from the same for the inverse map.
///
/// Checked by `check::factor`.
pub fn vertex_smooth(domain: &Domain) -> Vec<LowerBound> {
    let half_space = Angle::ZERO.plus_half_turns(2);
    let angles = domain_solid_angles(domain);
    let of = |kind: Kind, wanted: fn(Angle) -> bool| {
        let vertices = (0..).map(VertexId).zip(&angles).filter_map(|(vertex, angle)| Some((vertex, (*angle)?)));
        let candidates =
            vertices.filter(|&(_, angle)| wanted(angle)).map(|(vertex, angle)| (factor(half_space, angle), vertex));
        let (value, vertex) = strongest(candidates.filter(|&(value, _)| value > 1.0 && value.is_finite()))?;
        Some(LowerBound {
            name: BoundName::VertexSmooth,
            source: BoundName::VertexSmooth.source(),
            kind,
            value,
            scope: Scope::ShapeFixedTrace,
            certified: true,
            applies: false,
            reason: "speaks of maps onto the smooth ball; the measured image is a polyhedron inscribed in it".into(),
            place: Some(Place::vertex(domain.mesh(), vertex)),
        })
    };
    let convex = of(Kind::Inner, |angle| angle.upper() < TAU);
    let concave = of(Kind::Outer, |angle| angle.lower() > TAU);
    convex.into_iter().chain(concave).collect()
}

//! Flips where K is large, before edges are halved there: they cost no tets.

use super::RefinedMap;
use super::halving::{WORST_SHAPE, corner_vertices, shape};
use super::surface::Held;
use crate::dilatation::Dilatation;
use crate::domain::{Domain, edge_matrix};
use crate::measure::OntoBall;
use crate::mesh::{Flipping, Flips, Orientation, TetId, TetMesh, Vec3, VertexId, orientation};
use crate::objective::Iterate;

/// Share of the largest K that a tet has at least for which a flip is sought: with 0.5 they take five times as long, and gain no more.
const NEAR: f64 = 0.7;
/// Fall of the largest ln K of the tets that are replaced from which a flip is made. With 0.02 and 0.05 more maps end worse than better.
const LEAST_FALL: f64 = 0.005;

impl RefinedMap {
    /// The mesh with tets of large K flipped, and what was flipped; `None` if there is nothing to. Each flip lowers the largest K of the tets that it replaces, onto
    /// the ball where the surface is refined, in the map that was lowered last. In the best one no tet comes to a larger K than `reached`, or to
    /// lie the wrong way in either.
    pub(super) fn flipped(&self, best: &[Vec3], reached: f64, surface: bool) -> Option<(Domain, Flips)> {
        let (domain, image) = (&self.domain, &self.outcome.positions);
        let mesh = domain.mesh();
        let ids = || (0..mesh.tets().len() as u32).map(TetId);
        let onto = if surface { Some(OntoBall::new(domain, self.corners.as_ref(), image).ok()?) } else { None };
        let logs: Vec<f64> = match &onto {
            Some(_) => Held::of(domain, self.corners.as_ref(), image).ok()?.logs,
            None => Iterate::new(domain, image.clone()).log_dilatations()?,
        };
        let largest = logs.iter().copied().fold(0.0, f64::max);
        let low = super::surface::LOW * largest.exp();
        let corners = corner_vertices(self.corners.as_ref());
        let worth = |tet: &[VertexId; 4], below: f64| {
            // Corner elements are no linear maps.
            if tet.iter().any(|v| corners.contains(v)) {
                return None;
            }
            let on = |positions: &[Vec3]| tet.map(|v| positions[v.index()]);
            let is_positive = |positions: &[Vec3]| orientation(on(positions).each_ref()) == Orientation::Positive;
            let rest = on(mesh.points());
            let inverse = edge_matrix(rest).try_inverse().filter(|_| shape(rest) >= WORST_SHAPE)?;
            let k = |positions: &[Vec3]| Dilatation::of(&(edge_matrix(on(positions)) * inverse)).k();
            let k = match &onto {
                None => Some(k(image)).filter(|_| k(best) <= reached && is_positive(best)),
                Some(onto) => {
                    Some(k(image)).filter(|k| k.ln() < below).map(|k| onto.largest(&rest, &on(image), low / k).max(k))
                }
            }?;
            Some(k.ln()).filter(|log| *log < below && is_positive(mesh.points()) && is_positive(image))
        };
        let mut flipping = Flipping::of(mesh, logs.clone());
        let mut order: Vec<TetId> = ids().filter(|tet| logs[tet.index()] >= largest + NEAR.ln()).collect();
        order.sort_by(|a, b| logs[b.index()].total_cmp(&logs[a.index()]).then(a.cmp(b)));
        order.into_iter().for_each(|tet| flipping.flip(tet, LEAST_FALL, &worth));
        let flips = flipping.made(mesh, self.changes.halved.len())?;
        let mut tets = mesh.tets().to_vec();
        flips.make(&mut tets).expect("each flip replaces tets by others in their room");
        let mesh = TetMesh::new(mesh.points().to_vec(), tets).expect("all are positively oriented");
        Some((Domain::any_topology(mesh).expect("flips leave two tets to a face"), flips))
    }
}

//! Half-edge collapses, cheapest first, from a surface of genus 0 down to a tetrahedron.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use super::rings::Rings;
use crate::mesh::Vec3;

/// A vertex that vanished into `ring[0]`, and its neighbours in order.
#[derive(Clone, Debug)]
pub(super) struct Collapse {
    pub vertex: u32,
    pub ring: Vec<u32>,
}

/// A way to remove `vertex`, as cheap as it was when the vertices had these `changes` behind them together.
#[derive(PartialEq)]
struct Candidate {
    cost: f64,
    vertex: u32,
    into: u32,
    changes: u32,
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    /// The heap gives the greatest first: that is the cheapest one here.
    fn cmp(&self, other: &Self) -> Ordering {
        let key = |c: &Self| (c.vertex, c.into);
        other.cost.total_cmp(&self.cost).then_with(|| key(other).cmp(&key(self)))
    }
}

/// Collapses edges until `left` vertices remain, at least four: in order, the last one first to be undone.
///
/// A surface of genus 0 with more than four vertices always has a contractible edge; `None` means that it had none.
pub(super) fn simplify(points: &[Vec3], rings: &mut Rings, left: usize) -> Option<Vec<Collapse>> {
    let count = points.len();
    let mut changes = vec![0_u32; count];
    let mut collapses = Vec::with_capacity(count.saturating_sub(left));
    while count - collapses.len() > left.max(4) {
        let before = collapses.len();
        let candidate = |rings: &Rings, changes: &[u32], vertex: u32, into: u32| Candidate {
            cost: cost(points, rings, vertex, into),
            vertex,
            into,
            changes: changes[vertex as usize] + changes[into as usize],
        };
        let mut heap: BinaryHeap<Candidate> = (0..count as u32)
            .flat_map(|v| rings.of_vertex(v).iter().map(move |&u| (v, u)))
            .map(|(v, u)| candidate(rings, &changes, v, u))
            .collect();
        // An edge that could not be contracted when its turn came may be later: hence the loop around this one.
        while let Some(Candidate { vertex, into, changes: then, .. }) = heap.pop() {
            let is_gone = [vertex, into].iter().any(|&v| rings.of_vertex(v).is_empty());
            if is_gone
                || then != changes[vertex as usize] + changes[into as usize]
                || !rings.is_contractible(vertex, into)
            {
                continue;
            }
            let ring = rings.collapse(vertex, into);
            ring.iter().for_each(|&w| changes[w as usize] += 1);
            for &w in &ring {
                for &z in rings.of_vertex(w) {
                    heap.push(candidate(rings, &changes, w, z));
                    if !ring.contains(&z) {
                        heap.push(candidate(rings, &changes, z, w));
                    }
                }
            }
            collapses.push(Collapse { vertex, ring });
            if count - collapses.len() <= left.max(4) {
                break;
            }
        }
        if collapses.len() == before {
            return None;
        }
    }
    Some(collapses)
}

/// Squared length of the edge times the worst aspect ratio of the triangles that the collapse makes, more where it leaves or
/// removes a vertex of many neighbours: the coarse surfaces stay fit to be embedded.
fn cost(points: &[Vec3], rings: &Rings, vertex: u32, into: u32) -> f64 {
    /// Beyond this one thin triangle is as bad as another.
    const WORST_ASPECT: f64 = 1e6;
    let at = |v: u32| points[v as usize];
    let end = at(into);
    let others = rings.from(vertex, into).skip(1);
    let aspects = others.clone().zip(others.skip(1)).map(|(b, c)| {
        let (first, second, third) = (at(b) - end, at(c) - at(b), end - at(c));
        // 1 for an equilateral triangle.
        let squares = first.norm_squared() + second.norm_squared() + third.norm_squared();
        (squares / (2.0 * 3.0_f64.sqrt() * first.cross(&second).norm())).min(WORST_ASPECT)
    });
    // A NaN, of a triangle whose three corners agree, is passed over by `max`.
    let aspect = aspects.fold(1.0, f64::max);
    let valence = rings.of_vertex(vertex).len() as f64;
    let valence_after = rings.of_vertex(into).len() as f64 + valence - 4.0;
    let penalty = (1.0 + 0.3 * (valence - 6.0).max(0.0)) * (1.0 + 0.5 * (valence_after - 8.0).max(0.0));
    (at(vertex) - end).norm_squared() * aspect * penalty
}

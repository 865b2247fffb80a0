//! The connectivity of a closed triangle surface as one ring of neighbours a vertex, under collapses and their reverse.

use crate::solid::Surface;

/// For each vertex its neighbours in order: the triangles about `v` are `(v, ring[i], ring[i + 1])`, counter-clockwise seen
/// from outside. Empty for a vertex that is collapsed.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Rings(Vec<Vec<u32>>);

impl Rings {
    pub fn of(surface: &Surface) -> Self {
        // For each vertex the pairs (ring[i], ring[i + 1]), then chained.
        let mut sides: Vec<Vec<(u32, u32)>> = vec![Vec::new(); surface.points().len()];
        for triangle in surface.triangles() {
            for i in 0..3 {
                let [v, a, b] = [0, 1, 2].map(|j| triangle[(i + j) % 3]);
                sides[v.index()].push((a.0, b.0));
            }
        }
        Self(sides.into_iter().map(chained).collect())
    }

    pub fn of_vertex(&self, v: u32) -> &[u32] {
        &self.0[v as usize]
    }

    /// The neighbours of `v` in order, from `first` on.
    pub fn from<'a>(&'a self, v: u32, first: u32) -> impl Iterator<Item = u32> + Clone + 'a {
        let ring = self.of_vertex(v);
        let start = place(ring, first);
        ring[start..].iter().chain(&ring[..start]).copied()
    }

    /// Whether the edge can be contracted without changing the topology of a surface of more than four vertices: its ends have
    /// two common neighbours only.
    pub fn is_contractible(&self, v: u32, u: u32) -> bool {
        let other = self.of_vertex(u);
        self.of_vertex(v).iter().filter(|w| other.contains(w)).count() == 2
    }

    /// Contracts a contractible edge: `v` vanishes into `u`. Returns the ring that `v` had, from `u` on.
    pub fn collapse(&mut self, v: u32, u: u32) -> Vec<u32> {
        let ring: Vec<u32> = self.from(v, u).collect();
        let [_, right, between @ .., left] = &*ring else { unreachable!("a vertex has at least three neighbours") };
        for &w in between {
            let position = place(&self.0[w as usize], v);
            self.0[w as usize][position] = u;
        }
        for &w in [right, left] {
            self.0[w as usize].retain(|&a| a != v);
        }
        let position = place(&self.0[u as usize], v);
        self.0[u as usize].splice(position..=position, between.iter().copied());
        self.0[v as usize] = Vec::new();
        ring
    }

    /// Undoes the latest [`Self::collapse`] that is not undone, which returned `ring`.
    pub fn split(&mut self, v: u32, ring: &[u32]) {
        let [u, right, between @ .., left] = ring else { unreachable!("a vertex has at least three neighbours") };
        let mut of_u: Vec<u32> = self.from(*u, *right).collect();
        of_u.splice(1..=between.len(), [v]);
        self.0[*u as usize] = of_u;
        for &w in between {
            let position = place(&self.0[w as usize], *u);
            self.0[w as usize][position] = v;
        }
        for (&w, after) in [(right, 0), (left, 1)] {
            let position = place(&self.0[w as usize], *u) + after;
            self.0[w as usize].insert(position, v);
        }
        self.0[v as usize] = ring.to_vec();
    }
}

fn place(ring: &[u32], neighbour: u32) -> usize {
    ring.iter().position(|&w| w == neighbour).expect("adjacent vertices are in each other's ring")
}

/// The cycle of pairs `(a, b)` as the list of its first members, from the least one on.
fn chained(mut sides: Vec<(u32, u32)>) -> Vec<u32> {
    sides.sort_unstable();
    let mut ring = Vec::with_capacity(sides.len());
    let mut at = 0;
    for _ in 0..sides.len() {
        let (from, to) = sides[at];
        ring.push(from);
        at = sides.binary_search_by_key(&to, |side| side.0).expect("the link of a vertex of a surface is a cycle");
    }
    ring
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solid::Solid;

    #[test]
    fn splits_undo_collapses() {
        let surface = Solid::Icosahedron.surface().unwrap();
        let whole = Rings::of(&surface);
        let mut rings = whole.clone();
        let mut done = Vec::new();
        let all = surface.points().len() as u32;
        for left in (5..=all as usize).rev() {
            let (v, u) = (0..all)
                .flat_map(|v| rings.of_vertex(v).iter().map(move |&u| (v, u)))
                .find(|&(v, u)| rings.is_contractible(v, u))
                .expect("a sphere of more than four vertices has a contractible edge");
            done.push((v, rings.collapse(v, u)));
            let edges: usize = (0..all).map(|v| rings.of_vertex(v).len()).sum();
            // A sphere of n vertices has 3 n - 6 edges.
            assert_eq!(edges, 2 * (3 * (left - 1) - 6));
        }
        for (v, ring) in done.into_iter().rev() {
            rings.split(v, &ring);
        }
        let from_least = |rings: &Rings, v| {
            let least = *rings.of_vertex(v).iter().min().unwrap();
            rings.from(v, least).collect::<Vec<_>>()
        };
        assert!((0..all).all(|v| from_least(&rings, v) == from_least(&whole, v)));
    }
}

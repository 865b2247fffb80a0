//! The part of a mesh that the largest dilatations depend on, as a mesh of its own.

use super::recorder::Part;
use crate::domain::Domain;
use crate::mesh::{TetId, Vec3, VertexId};
use crate::objective::Assembly;

/// Free vertices about the tets of large K, with all tets that they touch.
pub(super) struct Region {
    /// The vertices and tets of the whole mesh that the region's are.
    pub part: Part,
    /// The region's tets as a mesh.
    pub domain: Domain,
    /// For each vertex of the region, whether it stays where it is: at the region's rim, or because it is fixed.
    pub fixed: Vec<bool>,
}

impl Region {
    /// The free vertices of tets with ln K above `share` of the largest one of all tets with a free vertex, and those up to `rings` tets away; all where
    /// these are more than half. `None` if they are more than `most`, or a tet is flipped.
    pub(super) fn of_large_dilatation(
        assembly: &Assembly<'_>,
        fixed: &[bool],
        image: &[Vec3],
        share: f64,
        rings: usize,
        most: usize,
    ) -> Option<Self> {
        let values = changeable(assembly, fixed, image)?;
        let threshold = share * values.iter().copied().fold(0.0, f64::max);
        Self::around(assembly.domain(), fixed, &|t| values[t] >= threshold, rings, most)
    }

    /// The free vertices of the tets `chosen`, and those up to `rings` tets away; all where these are more than half. `None`
    /// if there are none, or more than `most`.
    pub(super) fn around(
        domain: &Domain,
        fixed: &[bool],
        chosen: &dyn Fn(usize) -> bool,
        rings: usize,
        most: usize,
    ) -> Option<Self> {
        let tets = domain.mesh().tets();
        let mut inside = vec![false; fixed.len()];
        let touch = |inside: &mut Vec<bool>, chosen: &dyn Fn(usize) -> bool| {
            let vertices: Vec<VertexId> = (0..tets.len()).filter(|&t| chosen(t)).flat_map(|t| tets[t]).collect();
            vertices.into_iter().for_each(|v| inside[v.index()] = true);
        };
        touch(&mut inside, chosen);
        for _ in 0..rings {
            let before = inside.clone();
            touch(&mut inside, &|t| tets[t].iter().any(|v| before[v.index()]));
        }
        let all = fixed.iter().filter(|&&fixed| !fixed).count();
        let count = fixed.iter().zip(&inside).filter(|&(&fixed, &inside)| inside && !fixed).count();
        if 2 * count > all && all <= most {
            inside.fill(true);
        } else if count > most {
            return None;
        }
        let free = |v: VertexId| inside[v.index()] && !fixed[v.index()];
        let chosen: Vec<u32> = (0..tets.len() as u32).filter(|&t| tets[t as usize].iter().any(|&v| free(v))).collect();
        if chosen.is_empty() {
            return None;
        }
        let mut vertices: Vec<u32> = chosen.iter().flat_map(|&t| tets[t as usize].map(|v| v.0)).collect();
        vertices.sort_unstable();
        vertices.dedup();
        Some(Self {
            domain: domain.part(&vertices, &chosen),
            fixed: vertices.iter().map(|&v| !free(VertexId(v))).collect(),
            part: Part { vertices, tets: chosen.into_iter().map(TetId).collect() },
        })
    }

    /// The region's share of positions of all vertices.
    pub(super) fn restrict(&self, image: &[Vec3]) -> Vec<Vec3> {
        self.part.vertices.iter().map(|&v| image[v as usize]).collect()
    }

    /// Writes the region's positions into those of all vertices.
    pub(super) fn extend(&self, part: &[Vec3], image: &mut [Vec3]) {
        for (&v, position) in self.part.vertices.iter().zip(part) {
            image[v as usize] = *position;
        }
    }

    /// Whether all free vertices of the whole mesh, of which there are `free`, are free in the region.
    pub(super) fn is_whole(&self, free: usize) -> bool {
        self.fixed.iter().filter(|&&fixed| !fixed).count() == free
    }
}

/// ln K of every tet with a free vertex, 0 for the others, which nothing can change; `None` if a tet is flipped.
pub(super) fn changeable(assembly: &Assembly<'_>, fixed: &[bool], image: &[Vec3]) -> Option<Vec<f64>> {
    let tets = assembly.domain().mesh().tets();
    let mut values = assembly.at(image.to_vec()).log_dilatations()?;
    for (value, tet) in values.iter_mut().zip(tets) {
        if tet.iter().all(|v| fixed[v.index()]) {
            *value = 0.0;
        }
    }
    Some(values)
}

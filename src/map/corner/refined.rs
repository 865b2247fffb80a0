//! Piecewise-linear maps that come near to one with powers at its corners.

use std::collections::HashMap;

use super::Corners;
use crate::domain::Domain;
use crate::mesh::{MeshError, TetId, TetMesh, Vec3, VertexId};

/// A piecewise-linear map.
#[derive(Clone, Debug)]
pub struct PiecewiseLinear {
    /// The domain.
    pub mesh: TetMesh,
    /// Where its vertices go.
    pub image: Vec<Vec3>,
    /// For each of its tets the one of the warped map's domain in whose image its own lies.
    pub owners: Vec<TetId>,
}

impl Corners {
    /// The piecewise-linear map that agrees with the one that takes the domain's vertices to `image`, warped, at the vertices of a mesh that is
    /// finer next to the corners: the tets at a corner are cut at its height over their bases times 2^(-k/n), k from 1 to n^2.
    ///
    /// In such a layer the warp scales by factors that differ by 2^((p-1)/n), so that K of the two maps differ by some small power of that; in
    /// the last one, from 2^-n to the corner, the map is linear on rays, and its K that of exponent 1. Tets of flags that do not reach the
    /// corner are not cut, since that would make slivers of them: there K differs as far as their layers are thick. All vertices of the
    /// domain stay but those within cones, which go to where the warp takes them from.
    ///
    /// # Errors
    /// A layer so thin that rounding made a tet flat.
    pub fn piecewise_linear(&self, domain: &Domain, image: &[Vec3], n: u32) -> Result<PiecewiseLinear, MeshError> {
        let mesh = domain.mesh();
        let mut points = mesh.points().to_vec();
        let mut image = image.to_vec();
        // By the corner and the vertex, as cones agree on t and on the warp up to rounding.
        let mut heights: HashMap<(VertexId, VertexId), f64> = HashMap::new();
        let mut unwarped: Vec<Option<Vec3>> = vec![None; points.len()];
        let mut bases: HashMap<VertexId, f64> = HashMap::new();
        let cone = |tet: TetId| Some((*self.warped_cone(tet)?, *self.warp(tet)?));
        for (index, tet) in (0..).map(TetId).zip(mesh.tets()) {
            let Some((cone, warp)) = cone(index) else { continue };
            let base = bases.entry(cone.corner).or_insert(0.0);
            for &v in tet {
                let x = points[v.index()];
                let height = *heights.entry((cone.corner, v)).or_insert_with(|| warp.height(&x));
                unwarped[v.index()].get_or_insert_with(|| if v == cone.corner { x } else { warp.inverse(&x) });
                if tet.contains(&cone.corner) {
                    *base = base.max(height);
                }
            }
        }
        // Cuts of edges, by their ends and the level; the same from all tets around.
        let mut cuts: HashMap<(VertexId, VertexId, u32), VertexId> = HashMap::new();
        let (mut tets, mut owners) = (Vec::new(), Vec::new());
        for (index, tet) in (0..).map(TetId).zip(mesh.tets()) {
            let Some((cone, warp)) = cone(index).filter(|(cone, _)| tet.contains(&cone.corner)) else {
                tets.push(*tet);
                owners.push(index);
                continue;
            };
            let mut uncut = *tet;
            for level in 1..=n * n {
                let height = bases[&cone.corner] * (-f64::from(level) / f64::from(n) * cone.exponent).exp2();
                // The others are cut on their edges to the corner, in the order of their numbers, so that neighbours cut alike.
                let mut others: Vec<VertexId> = uncut.into_iter().filter(|v| *v != cone.corner).collect();
                others.sort_unstable();
                if others.iter().any(|&v| heights[&(cone.corner, v)] <= height) {
                    continue;
                }
                for v in others {
                    let middle = *cuts.entry((cone.corner, v, level)).or_insert_with(|| {
                        let share = height / heights[&(cone.corner, v)];
                        let tip = cone.corner.index();
                        let between = |at: &[Vec3]| at[tip] + (at[v.index()] - at[tip]) * share;
                        let (x, y) = (between(&points), between(&image));
                        points.push(x);
                        image.push(y);
                        unwarped.push(Some(warp.inverse(&x)));
                        VertexId(points.len() as u32 - 1)
                    });
                    heights.insert((cone.corner, middle), height);
                    tets.push(uncut.map(|w| if w == cone.corner { middle } else { w }));
                    owners.push(index);
                    uncut = uncut.map(|w| if w == v { middle } else { w });
                }
            }
            tets.push(uncut);
            owners.push(index);
        }
        let points = points.into_iter().zip(unwarped).map(|(x, from)| from.unwrap_or(x)).collect();
        Ok(PiecewiseLinear { mesh: TetMesh::new(points, tets)?, image, owners })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::{measure, measure_elements};
    use crate::mesh::Subdivision;
    use crate::mesh::fixtures::{cube, fan};

    #[test]
    fn the_piecewise_linear_map_comes_near_away_from_the_corners() {
        let mut parted = Subdivision::of(&fan(&cube(), Vec3::zeros()));
        parted.split_edges(|edge| edge.iter().all(|v| v.0 < 8));
        let domain = Domain::new(parted.mesh().unwrap()).unwrap();
        let exponents: Vec<(VertexId, f64)> = (0..8).map(|v| (VertexId(v), 1.3 + 0.1 * f64::from(v % 2))).collect();
        let corners = Corners::stars(&domain, &exponents).unwrap();
        // The radial map.
        let image: Vec<Vec3> = domain
            .mesh()
            .points()
            .iter()
            .map(|x| if x.norm() > 0.0 { x * (x.amax() / x.norm()) } else { *x })
            .collect();
        let exact = measure_elements(&domain, &corners.elements(&domain), &image);
        let mut last = f64::INFINITY;
        for n in [2, 4, 8] {
            let map = corners.piecewise_linear(&domain, &image, n).unwrap();
            let finer = Domain::new(map.mesh.clone()).unwrap();
            let volume: f64 = finer.volumes().iter().sum();
            assert!((volume - 8.0).abs() < 1e-12, "{volume}");
            let measured = measure(&finer, &map.image);
            assert!(measured.flipped.is_empty());
            // Off the last layers K comes from both sides to that of the warped map.
            let at_corner = |tet: &[VertexId; 4]| tet.iter().any(|v| v.0 < 8);
            let off = finer
                .mesh()
                .tets()
                .iter()
                .zip(&measured.dilatations)
                .zip(&map.owners)
                .filter(|((tet, _), _)| !at_corner(tet))
                .map(|((_, dilatation), owner)| dilatation.k() / exact.dilatations[owner.index()].k())
                .fold(0.0, f64::max);
            assert!(off < last && off < 1.0 + 2.0 / f64::from(n), "{n}: {off}, {last}");
            last = off;
        }
    }
}

//! Piecewise-linear maps that come near to one with powers at its corners.

use std::collections::{BTreeMap, HashMap};

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

/// How near to a level a vertex is on it, in units of t.
const ON_LEVEL: f64 = 1e-7;

impl Corners {
    /// The piecewise-linear map that agrees with the one that takes the domain's vertices to `image`, warped, at the vertices of a mesh that is
    /// finer next to the corners: there the cones are cut at the heights t = 2^(-k/n), k from 1 to n^2.
    ///
    /// Within a layer the warp goes from one similarity of the rays to another by a factor of 2^((p-1)/n), so that K of the two maps differ
    /// by that at most to some small power; in the last one, from 2^-n to the corner, the map is linear on rays, and its K that
    /// of exponent 1. All vertices of the domain stay but those within cones, which go to where the warp takes them from.
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
        let cone = |tet: TetId| Some((*self.warped_cone(tet)?, *self.warp(tet)?));
        for (index, tet) in (0..).map(TetId).zip(mesh.tets()) {
            let Some((cone, warp)) = cone(index) else { continue };
            for &v in tet {
                let x = points[v.index()];
                heights.entry((cone.corner, v)).or_insert_with(|| warp.height(&x));
                unwarped[v.index()].get_or_insert_with(|| if v == cone.corner { x } else { warp.inverse(&x) });
            }
        }
        // Cuts of edges, by their ends and the level; the same from all tets around.
        let mut cuts: HashMap<(VertexId, VertexId, u32), VertexId> = HashMap::new();
        let (mut tets, mut owners) = (Vec::new(), Vec::new());
        let levels: BTreeMap<VertexId, Vec<f64>> = self
            .exponents()
            .into_iter()
            .map(|(corner, p)| (corner, (1..=n * n).map(|k| (-f64::from(k) / f64::from(n) * p).exp2()).collect()))
            .collect();
        for (index, tet) in (0..).map(TetId).zip(mesh.tets()) {
            let Some((cone, warp)) = cone(index) else {
                tets.push(*tet);
                owners.push(index);
                continue;
            };
            let mut above = vec![*tet];
            for (level, &height) in (0..).zip(&levels[&cone.corner]) {
                let side = |heights: &HashMap<(VertexId, VertexId), f64>, v: VertexId| {
                    let over = heights[&(cone.corner, v)] - height;
                    if over.abs() <= ON_LEVEL * height { 0.0 } else { over }
                };
                let (mut whole, mut uncut) = (Vec::new(), above);
                while let Some(tet) = uncut.pop() {
                    let pairs = (0..4).flat_map(|i| (0..i).map(move |j| (i, j)));
                    let crossing = pairs.filter(|&(i, j)| side(&heights, tet[i]) * side(&heights, tet[j]) < 0.0);
                    // The same one first in all tets around it.
                    let Some((i, j)) = crossing.min_by_key(|&(i, j)| (tet[i].min(tet[j]), tet[i].max(tet[j]))) else {
                        whole.push(tet);
                        continue;
                    };
                    let [a, b] = [tet[i].min(tet[j]), tet[i].max(tet[j])];
                    let middle = *cuts.entry((a, b, level)).or_insert_with(|| {
                        let [low, high] = [a, b].map(|v| side(&heights, v));
                        let between =
                            |at: &[Vec3]| at[a.index()] + (at[b.index()] - at[a.index()]) * (low / (low - high));
                        let (x, y) = (between(&points), between(&image));
                        points.push(x);
                        image.push(y);
                        unwarped.push(Some(warp.inverse(&x)));
                        VertexId(points.len() as u32 - 1)
                    });
                    heights.insert((cone.corner, middle), height);
                    for end in [i, j] {
                        let mut half = tet;
                        half[end] = middle;
                        uncut.push(half);
                    }
                }
                // What lies above is in its layers.
                let is_below = |tet: &[VertexId; 4]| tet.iter().any(|&v| side(&heights, v) < 0.0);
                let (below, done): (Vec<_>, Vec<_>) = whole.into_iter().partition(is_below);
                owners.resize(owners.len() + done.len(), index);
                tets.extend(done);
                above = below;
                if above.is_empty() {
                    break;
                }
            }
            owners.resize(owners.len() + above.len(), index);
            tets.extend(above);
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

//! Wanted edge lengths, finer near the sharp edges of a surface.

use std::f64::consts::PI;

use bvh::aabb::{Aabb, Bounded};
use bvh::bounding_hierarchy::BHShape;
use bvh::bvh::Bvh;
use bvh::point_query::PointDistance;
use nalgebra::Point3;
use rayon::prelude::*;

use crate::mesh::{SHARP, Vec3};
use crate::solid::{Surface, SurfaceEdge};

/// The wanted edge length as a function of the distance to the nearest sharp edge (one that bends by more than [`SHARP`]), and so to
/// the nearest corner: `min(edge_length, feature_edge_length + growth * distance)`.
///
/// A wish, not a bound: meshers aim at it on average.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sizing {
    /// Far from sharp edges, > 0; infinite for no wish.
    pub edge_length: f64,
    /// At sharp edges and corners, > 0.
    pub feature_edge_length: f64,
    /// By how much the wanted length grows per unit of distance, > 0.
    pub growth: f64,
}

impl Sizing {
    /// The usual growth: the length doubles within two edges.
    pub const GROWTH: f64 = 0.5;

    /// The same length everywhere.
    pub fn uniform(edge_length: f64) -> Self {
        Self { edge_length, feature_edge_length: edge_length, growth: Self::GROWTH }
    }

    /// The wanted length at a distance from the nearest sharp edge.
    pub fn at(&self, distance: f64) -> f64 {
        self.edge_length.min(self.feature_edge_length + self.growth * distance)
    }

    pub(super) fn check(&self) -> Result<(), String> {
        let Self { edge_length, feature_edge_length, growth } = *self;
        if edge_length.is_nan() || edge_length <= 0.0 {
            return Err(format!("edge_length is {edge_length}, but must be positive"));
        }
        if !(feature_edge_length.is_finite() && feature_edge_length > 0.0 && feature_edge_length <= edge_length) {
            return Err(format!(
                "feature_edge_length is {feature_edge_length}, but must be positive and no more than the edge_length \
                 {edge_length}"
            ));
        }
        if !(growth.is_finite() && growth > 0.0) {
            return Err(format!("feature_growth is {growth}, but must be a positive number"));
        }
        Ok(())
    }
}

/// Wanted lengths at the nodes of a regular grid, a form that both programs can read. The surface lies inside the
/// outermost layer of cells.
pub(super) struct SizeGrid {
    pub origin: Vec3,
    pub step: Vec3,
    pub counts: [usize; 3],
    /// The last coordinate runs fastest.
    pub sizes: Vec<f64>,
}

impl SizeGrid {
    /// The grid for a sizing; between nodes linear interpolation never exceeds the wanted length.
    pub fn new(surface: &Surface, sizing: &Sizing) -> Self {
        let (low, high) = surface.bounding_box();
        let diagonal = (high - low).norm();
        let mut segments = sharp_segments(surface);
        let is_uniform = segments.is_empty() || sizing.feature_edge_length >= sizing.edge_length;
        let cell = if is_uniform { diagonal } else { cell_size(high - low, sizing) };
        let counts: [usize; 3] = cell_counts(high - low, cell).map(|count| count as usize + 1).into();
        let extent = high - low + Vec3::from_element(2.0 * cell);
        let origin = low - Vec3::from_element(cell);
        let step = extent.component_div(&Vec3::from(counts.map(|count| (count - 1) as f64)));
        let hierarchy = Bvh::build(&mut segments);
        let sizes = (0..counts.iter().product())
            .into_par_iter()
            .map(|node| {
                let at = origin + Vec3::from(indices(node, counts).map(|i| i as f64)).component_mul(&step);
                let distance = hierarchy.nearest_to(at.into(), &segments).map_or(f64::INFINITY, |nearest| nearest.1);
                // The length has the slope `growth`: what a node knows holds at all points of its cells if it speaks
                // for the nearest that a sharp edge can come to them. A length beyond the solid's size says nothing.
                sizing.at((distance - step.norm()).max(0.0)).min(diagonal)
            })
            .collect();
        Self { origin, step, counts, sizes }
    }

    /// The position of a node.
    pub fn position(&self, node: usize) -> Vec3 {
        self.origin + Vec3::from(indices(node, self.counts).map(|i| i as f64)).component_mul(&self.step)
    }

    /// Six tets a cell, all around the diagonal from its least to its greatest corner, so that cells fit together.
    pub fn tets(&self) -> impl Iterator<Item = [usize; 4]> + '_ {
        const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
        let strides = [self.counts[1] * self.counts[2], self.counts[2], 1];
        let is_cell = |&node: &usize| indices(node, self.counts).iter().zip(self.counts).all(|(&i, n)| i + 1 < n);
        (0..self.sizes.len()).filter(is_cell).flat_map(move |node| {
            ORDERS.map(|[a, b, _]| {
                let last = strides.iter().sum::<usize>();
                [node, node + strides[a], node + strides[a] + strides[b], node + last]
            })
        })
    }
}

fn indices(node: usize, counts: [usize; 3]) -> [usize; 3] {
    [node / (counts[1] * counts[2]), node / counts[2] % counts[1], node % counts[2]]
}

/// Cells so small that the length is met to its half at sharp edges, as far as the number of nodes allows.
fn cell_size(extent: Vec3, sizing: &Sizing) -> f64 {
    /// TetGen reads 200,000 background tets in half a second.
    const MOST_NODES: f64 = 40_000.0;
    let mut cell = sizing.feature_edge_length / (2.0 * 3f64.sqrt() * sizing.growth);
    while cell_counts(extent, cell).add_scalar(1.0).product() > MOST_NODES {
        cell *= 1.1;
    }
    cell
}

/// How many cells cover an extent and one more on either side.
fn cell_counts(extent: Vec3, cell: f64) -> Vec3 {
    extent.map(|length| 2.0 + (length / cell).ceil())
}

/// A sharp edge.
struct Segment {
    ends: [Vec3; 2],
    node: usize,
}

fn sharp_segments(surface: &Surface) -> Vec<Segment> {
    let bend = |edge: &&SurfaceEdge| (surface.dihedral_angle(edge) - PI).abs();
    let sharp = surface.edges().iter().filter(|edge| bend(edge) > SHARP);
    sharp.map(|edge| Segment { ends: edge.vertices.map(|v| surface.points()[v.index()]), node: 0 }).collect()
}

impl Bounded<f64, 3> for Segment {
    fn aabb(&self) -> Aabb<f64, 3> {
        let [a, b] = self.ends;
        Aabb::with_bounds(a.inf(&b).into(), a.sup(&b).into())
    }
}

impl BHShape<f64, 3> for Segment {
    fn set_bh_node_index(&mut self, index: usize) {
        self.node = index;
    }

    fn bh_node_index(&self) -> usize {
        self.node
    }
}

impl PointDistance<f64, 3> for Segment {
    fn distance_squared(&self, point: Point3<f64>) -> f64 {
        let [a, b] = self.ends;
        let (along, offset) = (b - a, point.coords - a);
        let t = (offset.dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        (offset - t * along).norm_squared()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{TetMesh, VertexId};
    use crate::solid::Solid;

    /// Distance from a point of the cube [-1, 1]^3 or near it to its nearest edge.
    fn distance_to_cube_edges(p: Vec3) -> f64 {
        let edge = |axis: usize| {
            let beyond = (p[axis].abs() - 1.0).max(0.0);
            let [u, v] = [(axis + 1) % 3, (axis + 2) % 3].map(|other| 1.0 - p[other].abs());
            (beyond * beyond + u * u + v * v).sqrt()
        };
        edge(0).min(edge(1)).min(edge(2))
    }

    #[test]
    fn the_grid_interpolates_the_wanted_length_from_below() {
        let sizing = Sizing { edge_length: 0.6, feature_edge_length: 0.1, growth: 0.4 };
        let grid = SizeGrid::new(&Solid::Cube.surface().unwrap(), &sizing);
        let slack = sizing.growth * 2.0 * grid.step.norm();
        let mut checked = 0;
        for tet in grid.tets() {
            let centre = tet.iter().map(|&node| grid.position(node)).sum::<Vec3>() / 4.0;
            let size = tet.iter().map(|&node| grid.sizes[node]).sum::<f64>() / 4.0;
            if centre.amax() < 1.0 {
                let wanted = sizing.at(distance_to_cube_edges(centre));
                assert!(size <= wanted + 1e-12 && size >= wanted - slack, "{centre:?}: {size} for {wanted}");
                checked += 1;
            }
        }
        assert!(checked > 1000 && slack < 0.35, "{checked} tets, slack {slack}");
    }

    #[test]
    fn the_grids_tets_fill_it() {
        let sizing = Sizing { edge_length: 3.0, feature_edge_length: 0.5, growth: 1.0 };
        let surface = Solid::Box { size: [1.0, 2.0, 3.0] }.surface().unwrap();
        let grid = SizeGrid::new(&surface, &sizing);
        let points = (0..grid.sizes.len()).map(|node| grid.position(node)).collect();
        let tets = grid.tets().map(|tet| tet.map(|node| VertexId(node as u32))).collect();
        let (mesh, _) = TetMesh::from_either_orientation(points, tets).unwrap();
        let domain = crate::Domain::new(mesh).unwrap();
        let extent = grid.position(grid.sizes.len() - 1) - grid.origin;
        assert!((domain.volumes().iter().sum::<f64>() / extent.product() - 1.0).abs() < 1e-12);
        let (low, high) = surface.bounding_box();
        for inside in [low - grid.origin - grid.step, grid.origin + extent - grid.step - high] {
            assert!(inside.min() > -1e-12, "{inside:?}");
        }
    }

    #[test]
    fn extreme_lengths_keep_the_grid_small() {
        let surface = Solid::Cube.surface().unwrap();
        let fine = Sizing { edge_length: f64::INFINITY, feature_edge_length: 1e-9, growth: 10.0 };
        let grid = SizeGrid::new(&surface, &fine);
        assert!(grid.sizes.len() <= 40_000 && grid.sizes.iter().all(|size| size.is_finite() && *size >= 1e-9));
        assert_eq!(SizeGrid::new(&surface, &Sizing::uniform(0.2)).sizes, [0.2; 64]);
        let round = Solid::Ball { radius: 1.0, resolution: 6 }.surface().unwrap();
        assert!(SizeGrid::new(&round, &fine).sizes.iter().all(|size| *size > 1.0));
    }
}

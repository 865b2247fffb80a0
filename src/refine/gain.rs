//! What the largest K gains where an edge is halved: the middle is moved, and all else kept as it is.

use rayon::prelude::*;

use crate::domain::{Afterwards, Domain};
use crate::linalg::{LANES, svds};
use crate::mesh::{Mat3, TetId, Vec3, VertexId};
use crate::objective::of_jacobian;

/// Share of the largest K that a tet at an edge has at least: what is gained elsewhere comes to nothing.
const NEAR: f64 = 0.7;
/// Exponent with which K over the largest K weights what is gained at a tet. With 6 or 20 the maps of 8 rounds are worse.
const WEIGHT: f64 = 10.0;
/// Exponent of the soft maximum over the halves of the tets at an edge. It is so near to the maximum that an edge at a vertex whose
/// whole star holds K has no gain: a piecewise-linear map is the same there on all scales, and only halving what is opposite to it helps.
const EXPONENT: f64 = 40.0;
/// Most steps of the middle; with 8 there is hardly more gained.
const STEPS: usize = 5;
/// Fall in ln K of a step below which there is no further one.
const ROUGH: f64 = 1e-4;

/// An edge, and what is gained where it is halved.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gain {
    /// The ends.
    pub edge: [VertexId; 2],
    /// The fall of a soft maximum of ln K over the tets at the edge, as far as they matter, per tet that is added. Scale-free.
    pub value: f64,
}

/// What decides of a map: ln K of each tet, and the factors R and L with which it has the Jacobian L J R there, where it has others than 1.
pub(super) struct Large<'a> {
    /// The map's domain.
    pub domain: &'a Domain,
    /// The images of its vertices.
    pub image: &'a [Vec3],
    /// ln K of each tet.
    pub logs: &'a [f64],
    /// The factors R of each tet with what follows them; empty where all are 1.
    pub factors: &'a [Vec<(Mat3, Afterwards)>],
}

impl Large<'_> {
    /// How much the gain at a tet counts: as a power of its K over the largest; nothing where it is not near that.
    pub fn weight(&self, tet: TetId, largest: f64) -> f64 {
        let log = self.logs[tet.index()];
        if log < largest + NEAR.ln() { 0.0 } else { (WEIGHT * (log - largest)).exp() }
    }

    /// ln of the largest K.
    pub fn largest(&self) -> f64 {
        self.logs.iter().copied().fold(0.0, f64::max)
    }
}

/// The edges with something to gain of those that may be halved, the best first, by their ends among equals. `at` are the tets at each
/// vertex.
pub(super) fn gains(
    large: &Large<'_>,
    at: &[Vec<TetId>],
    allowed: &(dyn Fn([VertexId; 2]) -> bool + Sync),
) -> Vec<Gain> {
    let (tets, logs, largest) = (large.domain.mesh().tets(), large.logs, large.largest());
    let near = tets.iter().zip(logs).filter(|(_, log)| **log >= largest + NEAR.ln());
    let mut edges: Vec<[VertexId; 2]> =
        near.flat_map(|(tet, _)| (0..4).flat_map(move |i| (0..i).map(move |j| super::pair(tet[i], tet[j])))).collect();
    edges.sort_unstable();
    edges.dedup();
    let gain = |&edge: &[VertexId; 2]| {
        let around = || super::around(edge, tets, at);
        let halves: Vec<Half> = around()
            .flat_map(|tet| edge.map(|end| (tet, end)))
            .flat_map(|(tet, end)| Half::of(large, tet, end))
            .collect();
        let weight: f64 = around().map(|tet| (WEIGHT * (logs[tet.index()] - largest)).exp()).sum();
        Gain { edge, value: weight * fall(&halves) / around().count() as f64 }
    };
    let mut gains: Vec<Gain> =
        edges.par_iter().filter(|edge| allowed(**edge)).map(gain).filter(|gain| gain.value > 0.0).collect();
    gains.sort_by(|a, b| b.value.total_cmp(&a.value).then(a.edge.cmp(&b.edge)));
    gains
}

/// Half of a tet, as the middle of the edge moves by a step: its Jacobian is that of the tet, plus the step times the gradient.
#[derive(Clone, Copy)]
struct Half {
    jacobian: Mat3,
    /// What the step is multiplied by.
    left: Mat3,
    /// The gradient of the middle's barycentric coordinate in the half.
    gradient: Vec3,
}

impl Half {
    /// The half in which the middle has taken the place of this end, once for each pair of factors.
    fn of(large: &Large<'_>, tet: TetId, end: VertexId) -> Vec<Self> {
        let jacobian = large.domain.jacobian(tet, large.image);
        let gradient = gradient(large.domain, tet, end);
        match large.factors.get(tet.index()).map(Vec::as_slice) {
            None | Some([]) => vec![Self { jacobian, left: Mat3::identity(), gradient }],
            Some(factors) => {
                let with = |(right, Afterwards { left, .. }): &(Mat3, Afterwards)| Self {
                    jacobian: left * jacobian * right,
                    left: *left,
                    gradient: right.transpose() * gradient,
                };
                factors.iter().map(with).collect()
            }
        }
    }
}

/// The gradient of the barycentric coordinate of the middle that has taken the place of this end of an edge of a tet.
fn gradient(domain: &Domain, tet: TetId, end: VertexId) -> Vec3 {
    let inverse = &domain.inverse_edges()[tet.index()];
    let row = |i: usize| inverse.row(i).transpose();
    2.0 * match domain.mesh().tets()[tet.index()].iter().position(|v| *v == end) {
        Some(0) | None => -(row(0) + row(1) + row(2)),
        Some(corner) => row(corner - 1),
    }
}

/// The Jacobian of the half of a tet in which the middle of an edge has taken the place of this end and moved by a step.
pub(super) fn half(domain: &Domain, image: &[Vec3], tet: TetId, end: VertexId, step: &Vec3) -> Mat3 {
    domain.jacobian(tet, image) + step * gradient(domain, tet, end).transpose()
}

/// The soft maximum at a step, with its gradient and the mean of the squares of gradients that it is made of.
struct SoftMaximum {
    value: f64,
    gradient: Vec3,
    squares: Mat3,
}

/// `1 / q ln mean of K_I^q + K_O^q` over the halves, q the [`EXPONENT`]; `None` if one is flipped.
fn soft_maximum(halves: &[Half], step: Vec3) -> Option<SoftMaximum> {
    let mut logs = Vec::with_capacity(2 * halves.len());
    for group in halves.chunks(LANES) {
        // The last group is filled up with its last half.
        let of_lane = |lane: usize| &group[lane.min(group.len() - 1)];
        let moved = |lane| of_lane(lane).jacobian + of_lane(lane).left * step * of_lane(lane).gradient.transpose();
        let decompositions = svds(&std::array::from_fn::<_, LANES, _>(moved));
        for (half, decomposition) in group.iter().zip(&decompositions) {
            let of_half = of_jacobian(decomposition)?;
            logs.extend(of_half.map(|(log, derivative)| (log, half.left.transpose() * (derivative * half.gradient))));
        }
    }
    let largest = logs.iter().map(|log| log.0).fold(f64::NEG_INFINITY, f64::max);
    let (mut sum, mut gradient, mut squares) = (0.0, Vec3::zeros(), Mat3::zeros());
    for (log, of_log) in logs {
        let weight = (EXPONENT * (log - largest)).exp();
        sum += weight;
        gradient += of_log * weight;
        squares += of_log * of_log.transpose() * weight;
    }
    let value = largest + (sum / halves.len() as f64).ln() / EXPONENT;
    Some(SoftMaximum { value, gradient: gradient / sum, squares: squares / sum })
}

/// How far the soft maximum falls as the middle moves, by damped Newton steps without the second derivatives of ln K, which
/// those of the maximum exceed by far.
fn fall(halves: &[Half]) -> f64 {
    let mut step = Vec3::zeros();
    let Some(mut here) = soft_maximum(halves, step) else { return 0.0 };
    let before = here.value;
    let mut damping = 0.1;
    for _ in 0..STEPS {
        let SoftMaximum { value, gradient, squares } = &here;
        let hessian =
            (squares - gradient * gradient.transpose() + Mat3::identity() * (damping * squares.trace())) * EXPONENT;
        let Some(inverse) = hessian.try_inverse() else { break };
        let trial = step - inverse * gradient;
        match soft_maximum(halves, trial).filter(|there| there.value < *value) {
            Some(there) => {
                let gained = value - there.value;
                (step, here, damping) = (trial, there, damping / 4.0);
                if gained < ROUGH {
                    break;
                }
            }
            None => damping *= 8.0,
        }
    }
    before - here.value
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::TetMesh;

    /// An octahedron in four tets about the edge from vertex 0, below, to vertex 1, above; in the image the four others are raised.
    fn raised(by: f64) -> (Domain, Vec<Vec3>, Vec<Vec<TetId>>) {
        let [below, above] = [-1.0, 1.0].map(|z| Vec3::new(0.0, 0.0, z));
        let mut points = vec![below, above];
        points.extend([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]].map(|[x, y]| Vec3::new(x, y, 0.0)));
        let tets: Vec<[VertexId; 4]> = [[2, 3], [3, 4], [4, 5], [5, 2]].map(|[a, b]| [0, 1, a, b].map(VertexId)).into();
        let mesh = TetMesh::new(points.clone(), tets).unwrap();
        points[2..].iter_mut().for_each(|p| p.z += by);
        let all: Vec<TetId> = (0..4).map(TetId).collect();
        let at = vec![all.clone(), all, vec![TetId(0), TetId(3)]];
        let at = at.into_iter().chain([[0, 1], [1, 2], [2, 3]].map(|pair| pair.map(TetId).to_vec())).collect();
        (Domain::new(mesh).unwrap(), points, at)
    }

    fn logs(domain: &Domain, image: &[Vec3]) -> Vec<f64> {
        crate::measure::measure(domain, image).dilatations.iter().map(|dilatation| dilatation.k().ln()).collect()
    }

    #[test]
    fn the_middle_goes_where_the_soft_maximum_is_least() {
        let (domain, image, at) = raised(0.4);
        let edge = [VertexId(0), VertexId(1)];
        let logs = logs(&domain, &image);
        let large = Large { domain: &domain, image: &image, logs: &logs, factors: &[] };
        let found = gains(&large, &at, &|other| other == edge);
        assert_eq!(found.iter().map(|gain| gain.edge).collect::<Vec<_>>(), [edge]);
        // By symmetry the best place is on the axis: the largest K of the halves at many places there.
        let halves: Vec<Half> = at[0].iter().flat_map(|&tet| edge.map(|end| Half::of(&large, tet, end)[0])).collect();
        let at_height = |z: f64| soft_maximum(&halves, Vec3::new(0.0, 0.0, z)).unwrap().value;
        let least = (0..400).map(|i| at_height(f64::from(i) * 1e-3)).fold(f64::INFINITY, f64::min);
        // All four tets have the same K, and one is added to each of them. A few steps are not all the way.
        let most = at_height(0.0) - least;
        assert!(most > 0.1 && 0.9 * most < found[0].value && found[0].value < most + 1e-3 * most, "{found:?} {most}");
        // The halves at a step are those of the mesh with the middle there.
        let mesh = TetMesh::new(
            [domain.mesh().points(), &[Vec3::zeros()]].concat(),
            vec![[0, 6, 2, 3].map(VertexId), [6, 1, 2, 3].map(VertexId)],
        );
        let split = Domain::any_topology(mesh.unwrap()).unwrap();
        let positions = [&image[..], &[Vec3::new(0.01, 0.02, 0.3)]].concat();
        for (tet, end) in [(0, edge[1]), (1, edge[0])] {
            let Half { jacobian, gradient, .. } = Half::of(&large, TetId(0), end)[0];
            let moved = jacobian + Vec3::new(0.01, 0.02, 0.3) * gradient.transpose();
            assert!((moved - split.jacobian(TetId(tet), &positions)).norm() < 1e-14);
        }
    }

    #[test]
    fn nothing_is_gained_where_a_map_is_linear() {
        let (domain, _, at) = raised(0.0);
        let image: Vec<Vec3> = domain.mesh().points().iter().map(|p| Vec3::new(2.0 * p.x, p.y + p.x, p.z)).collect();
        // ln K is quasiconvex: of all maps with the values of a linear one at the boundary that one has the least largest K.
        let logs = logs(&domain, &image);
        let large = Large { domain: &domain, image: &image, logs: &logs, factors: &[] };
        let found = gains(&large, &at, &|edge| edge == [VertexId(0), VertexId(1)]);
        assert!(found.iter().all(|gain| gain.value < 1e-12), "{found:?}");
    }
}

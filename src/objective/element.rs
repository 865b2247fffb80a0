//! Value and derivatives of one tet's energy with respect to its four vertices.
//!
//! The derivatives of an isotropic function of a 3x3 matrix are closed forms in its singular value decomposition
//! (Smith, de Goes, Kim 2019, "Analytic eigensystems for isotropic distortion energies", ACM TOG 38(1)): one 3x3 block
//! for the scalings and, for each pair of axes, one "twist" and one "flip" mode.

use super::TetEnergy;
use crate::linalg::{Svd, svd};
use crate::mesh::{Mat3, Vec3};

/// The centred logs l_i of the singular values of a Jacobian; `None` if it does not preserve orientation (det <= 0).
pub fn centred_logs(values: [f64; 3]) -> Option<[f64; 3]> {
    if values[2] <= 0.0 {
        return None;
    }
    let logs = values.map(f64::ln);
    let mean = (logs[0] + logs[1] + logs[2]) / 3.0;
    let centred = logs.map(|l| l - mean);
    centred.iter().all(|l| l.is_finite()).then_some(centred)
}

/// Gradient and positive semidefinite Hessian of one tet's energy.
#[derive(Clone, Debug)]
pub struct ElementDerivatives {
    /// Derivative with respect to each of the four vertex positions.
    pub gradient: [Vec3; 4],
    /// The ten blocks of the Hessian for the local vertex pairs [`ElementDerivatives::PAIRS`].
    pub hessian: [Mat3; 10],
}

impl ElementDerivatives {
    /// Local vertex pairs (row, column) of the blocks.
    pub const PAIRS: [(usize, usize); 10] =
        [(0, 0), (0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (1, 3), (2, 2), (2, 3), (3, 3)];

    /// The derivatives at the Jacobian `jacobian = edges(image) * inverse_edges`; `None` where the energy is infinite.
    ///
    /// The Hessian's negative curvature, mode by mode, is multiplied by `negative` in [0, 1]: 1 gives the true Hessian, 0 a
    /// positive semidefinite one. The scalings' block is split into the convex part in ln s and the part that stems from
    /// the curvature of ln. As det -> 0 the Hessian grows without bound.
    pub fn new<E: TetEnergy>(energy: &E, jacobian: &Mat3, inverse_edges: &Mat3, negative: f64) -> Option<Self> {
        let damp = |curvature: f64| if curvature < 0.0 { negative * curvature } else { curvature };
        let Svd { left, values: s, right } = svd(jacobian);
        let logs = centred_logs(s)?;
        if !logs.iter().all(|&l| energy.value(l).is_finite()) {
            return None;
        }
        let derivatives = logs.map(|l| energy.derivatives(l));
        let [first, second] = [derivatives.map(|d| d.0), derivatives.map(|d| d.1)];
        let gradient = gradient_from(left, s, right, inverse_edges, first);

        // Derivatives with respect to the singular values: the energy sees ln s through the centring projection P.
        let mean_first = (first[0] + first[1] + first[2]) / 3.0;
        let slope = [0, 1, 2].map(|i| (first[i] - mean_first) / s[i]);
        let sum_second: f64 = second.iter().sum();
        let mut scaling = Mat3::zeros();
        for i in 0..3 {
            for j in 0..3 {
                let mut entry = sum_second / 9.0 - (second[i] + second[j]) / 3.0;
                if i == j {
                    entry += second[i] + damp(mean_first - first[i]);
                }
                scaling[(i, j)] = entry / (s[i] * s[j]);
            }
        }
        // For each pair of axes (i, j): the Hessian on (M_ij, M_ji) is [[same, cross], [cross, same]].
        let mut off_diagonal = [[0.0; 2]; 3];
        for (mode, (i, j)) in [(0, 1), (0, 2), (1, 2)].into_iter().enumerate() {
            let twist = damp((slope[i] + slope[j]) / (s[i] + s[j]));
            let difference = s[i] - s[j];
            // The quotient tends to the difference of the scaling block's entries as the two values meet; below 1e-7
            // relative the limit is the more accurate of the two.
            let flip = if difference > 1e-7 * s[i] {
                (slope[i] - slope[j]) / difference
            } else {
                (second[i] + mean_first - first[i]) / (s[i] * s[j])
            };
            let flip = damp(flip);
            off_diagonal[mode] = [0.5 * (flip + twist), 0.5 * (flip - twist)];
        }

        // Gradients of the barycentric coordinates in the right singular frame.
        let rotated = (inverse_edges * right).transpose();
        let weights = [
            -(rotated.column(0) + rotated.column(1) + rotated.column(2)),
            rotated.column(0).into_owned(),
            rotated.column(1).into_owned(),
            rotated.column(2).into_owned(),
        ];
        let block = |v: usize, w: usize| {
            let (a, b) = (&weights[v], &weights[w]);
            let mut inner = scaling.component_mul(&(a * b.transpose()));
            for (mode, (i, j)) in [(0, 1), (0, 2), (1, 2)].into_iter().enumerate() {
                let [same, cross] = off_diagonal[mode];
                inner[(i, i)] += same * a[j] * b[j];
                inner[(j, j)] += same * a[i] * b[i];
                inner[(i, j)] += cross * a[j] * b[i];
                inner[(j, i)] += cross * a[i] * b[j];
            }
            left * inner * left.transpose()
        };
        Some(Self { gradient, hessian: Self::PAIRS.map(|(v, w)| block(v, w)) })
    }
}

/// The gradient with respect to the four vertices of `sum_i f_i(l_i)` with given derivatives `f_i'`.
pub(super) fn gradient_from(left: Mat3, s: [f64; 3], right: Mat3, inverse_edges: &Mat3, first: [f64; 3]) -> [Vec3; 4] {
    let mean = (first[0] + first[1] + first[2]) / 3.0;
    let slope = Vec3::new((first[0] - mean) / s[0], (first[1] - mean) / s[1], (first[2] - mean) / s[2]);
    let stress = left * Mat3::from_diagonal(&slope) * right.transpose() * inverse_edges.transpose();
    let [g1, g2, g3] = [0, 1, 2].map(|i| stress.column(i).into_owned());
    [-(g1 + g2 + g3), g1, g2, g3]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::objective::{Barrier, SoftMax};

    fn value<E: TetEnergy>(energy: &E, jacobian: &Mat3) -> f64 {
        centred_logs(svd(jacobian).values).unwrap().iter().map(|&l| energy.value(l)).sum()
    }

    fn edges(x: &[Vec3; 4]) -> Mat3 {
        crate::domain::edge_matrix(*x)
    }

    /// Central differences at a range of steps: the error must fall like h^2 to rounding, then rise.
    fn check<E: TetEnergy>(energy: &E, image: [Vec3; 4]) {
        let rest = [Vec3::zeros(), Vec3::new(1.0, 0.1, 0.0), Vec3::new(0.2, 1.1, -0.1), Vec3::new(0.1, 0.0, 0.9)];
        let inverse = edges(&rest).try_inverse().unwrap();
        let at = |x: &[Vec3; 4]| ElementDerivatives::new(energy, &(edges(x) * inverse), &inverse, 0.0).unwrap();
        let derivatives = at(&image);
        let scale = derivatives.gradient.iter().map(|g| g.norm()).fold(0.0, f64::max).max(1e-3);
        for vertex in 0..4 {
            for axis in 0..3 {
                let errors = [1e-2, 1e-3, 1e-4, 1e-5].map(|h| {
                    let moved = |sign: f64| {
                        let mut x = image;
                        x[vertex][axis] += sign * h;
                        value(energy, &(edges(&x) * inverse))
                    };
                    ((moved(1.0) - moved(-1.0)) / (2.0 * h) - derivatives.gradient[vertex][axis]).abs() / scale
                });
                // Truncation h^2 times third derivatives (the exponent's cube at most), rounding eps / h: 1e-7 is met
                // near h = 1e-4 or 1e-5.
                let best = errors.iter().copied().fold(f64::INFINITY, f64::min);
                assert!(best < 1e-7, "gradient {vertex} {axis}: {errors:?}");
            }
        }
    }

    fn bent() -> [Vec3; 4] {
        [Vec3::new(0.1, 0.0, 0.0), Vec3::new(1.2, 0.3, 0.1), Vec3::new(-0.1, 0.7, 0.2), Vec3::new(0.3, -0.2, 1.4)]
    }

    #[test]
    fn gradients_match_differences() {
        for p in [0.5, 1.0, 4.0, 16.0] {
            check(&SoftMax::new(p, 0.3), bent());
        }
        check(&Barrier { bound: 2.0 }, bent());
    }

    #[test]
    fn hessian_matches_second_differences_and_its_projection_lies_above() {
        let energy = SoftMax::new(4.0, 0.3);
        let inverse = Mat3::identity();
        let image = bent();
        let jacobian = edges(&image) * inverse;
        let exact = ElementDerivatives::new(&energy, &jacobian, &inverse, 1.0).unwrap();
        let projected = ElementDerivatives::new(&energy, &jacobian, &inverse, 0.0).unwrap();
        for seed in 0..20 {
            let direction: [Vec3; 4] =
                std::array::from_fn(|v| Vec3::from_fn(|r, _| ((seed * 12 + v * 3 + r) as f64 * 1.618).sin()));
            let form = |derivatives: &ElementDerivatives| -> f64 {
                derivatives
                    .hessian
                    .iter()
                    .zip(ElementDerivatives::PAIRS)
                    .map(|(block, (v, w))| {
                        let term = direction[v].dot(&(block * direction[w]));
                        if v == w { term } else { 2.0 * term }
                    })
                    .sum()
            };
            let moved = |step: f64| {
                let x: [Vec3; 4] = std::array::from_fn(|v| image[v] + direction[v] * step);
                value(&energy, &(edges(&x) * inverse))
            };
            let h = 1e-4;
            let second = (moved(h) + moved(-h) - 2.0 * moved(0.0)) / (h * h);
            // Rounding eps / h^2 = 2e-8 and truncation h^2 / 12 times a fourth derivative of at most rate^4 = 4096.
            assert!((form(&exact) - second).abs() <= 1e-4 * second.abs().max(1.0), "{} {second}", form(&exact));
            assert!(form(&projected) >= form(&exact).max(0.0) - 1e-9);
        }
    }

    #[test]
    fn centred_logs_refuse_flips_and_ignore_scale() {
        assert_eq!(centred_logs([2.0, 1.0, 0.0]), None);
        assert_eq!(centred_logs([2.0, 1.0, -0.5]), None);
        let [a, b] = [[2.0, 1.0, 0.5], [2e30, 1e30, 0.5e30]].map(|s| centred_logs(s).unwrap());
        for i in 0..3 {
            assert!((a[i] - b[i]).abs() < 1e-13);
        }
    }
}

//! Value and derivatives of one tet's energy with respect to its four vertices.
//!
//! The derivatives of an isotropic function of a 3x3 matrix are closed forms in its singular value decomposition
//! (Smith, de Goes, Kim 2019, "Analytic eigensystems for isotropic distortion energies", ACM TOG 38(1)): one 3x3 block
//! for the scalings and, for each pair of axes, one "twist" and one "flip" mode.

use super::{NearActive, NearOpening, OpeningDerivatives};
use crate::domain::{Afterwards, Turning};
use crate::linalg::Svd;
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

/// The derivatives of an isotropic function of a 3x3 matrix in the frame of its singular vectors.
#[derive(Clone, Copy, Debug)]
pub struct Spectrum {
    /// Derivatives with respect to the singular values.
    pub slope: [f64; 3],
    /// Curvature along the diagonal: second derivatives with respect to the singular values.
    pub scaling: Mat3,
    /// Curvature of the twist mode `M_ij - M_ji` of the axis pairs (0, 1), (0, 2), (1, 2).
    pub twist: [f64; 3],
    /// Curvature of the flip mode `M_ij + M_ji` of the same pairs.
    pub flip: [f64; 3],
}

/// Axis pairs of the twist and flip modes.
pub(super) const AXIS_PAIRS: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];

impl Spectrum {
    /// The spectrum of a sum of functions of the centred logs l_i, given each one's first two derivatives, at singular
    /// values `s > 0`. Where two of these coincide, so must the derivatives.
    ///
    /// Negative curvature is multiplied by `negative`; the scalings' block is split into its convex part in ln s and the
    /// part that stems from the curvature of ln.
    pub(super) fn of_logs(s: [f64; 3], derivatives: [(f64, f64); 3], negative: f64) -> Self {
        let damp = |curvature: f64| if curvature < 0.0 { negative * curvature } else { curvature };
        let [first, second] = [derivatives.map(|d| d.0), derivatives.map(|d| d.1)];
        // The energy sees ln s through the projection to mean zero.
        let mean = (first[0] + first[1] + first[2]) / 3.0;
        let slope = [0, 1, 2].map(|i| (first[i] - mean) / s[i]);
        let sum_second: f64 = second.iter().sum();
        let mut scaling = Mat3::zeros();
        for i in 0..3 {
            for j in 0..3 {
                let mut entry = sum_second / 9.0 - (second[i] + second[j]) / 3.0;
                if i == j {
                    entry += second[i] + damp(mean - first[i]);
                }
                scaling[(i, j)] = entry / (s[i] * s[j]);
            }
        }
        let twist = AXIS_PAIRS.map(|(i, j)| damp((slope[i] + slope[j]) / (s[i] + s[j])));
        let flip = AXIS_PAIRS.map(|(i, j)| {
            let difference = s[i] - s[j];
            // The quotient tends to a second derivative as the two values meet; below 1e-7 relative the limit is the
            // more accurate of the two.
            damp(if difference > 1e-7 * s[i] {
                (slope[i] - slope[j]) / difference
            } else {
                (second[i] + mean - first[i]) / (s[i] * s[j])
            })
        });
        Self { slope, scaling, twist, flip }
    }
}

/// Gradient and Hessian of one tet's energy.
#[derive(Clone, Debug, Default)]
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

    /// Replaces the derivatives by those of an energy with this spectrum, at the Jacobian
    /// `edges(image) * inverse_edges` with this decomposition.
    pub(super) fn fill(&mut self, decomposition: &Svd, spectrum: &Spectrum, inverse_edges: &Mat3) {
        let Svd { left, right, .. } = decomposition;
        // On (M_ij, M_ji) of an axis pair the Hessian is [[same, cross], [cross, same]].
        let same = [0, 1, 2].map(|mode| 0.5 * (spectrum.flip[mode] + spectrum.twist[mode]));
        let cross = [0, 1, 2].map(|mode| 0.5 * (spectrum.flip[mode] - spectrum.twist[mode]));
        // Gradients of the barycentric coordinates 1, 2, 3 in the right singular frame.
        let rotated = (inverse_edges * right).transpose();
        let weights = [0, 1, 2].map(|i| rotated.column(i).into_owned());
        let block = |v: usize, w: usize| {
            let (a, b) = (&weights[v - 1], &weights[w - 1]);
            let mut inner = spectrum.scaling.component_mul(&(a * b.transpose()));
            for (mode, (i, j)) in AXIS_PAIRS.into_iter().enumerate() {
                inner[(i, i)] += same[mode] * a[j] * b[j];
                inner[(j, j)] += same[mode] * a[i] * b[i];
                inner[(i, j)] += cross[mode] * a[j] * b[i];
                inner[(j, i)] += cross[mode] * a[i] * b[j];
            }
            left * inner * left.transpose()
        };
        let (b11, b12, b13, b22, b23, b33) =
            (block(1, 1), block(1, 2), block(1, 3), block(2, 2), block(2, 3), block(3, 3));
        // The barycentric coordinates add up to 1, so all rows of blocks add up to 0.
        let b01 = -(b11 + b12.transpose() + b13.transpose());
        let b02 = -(b12 + b22 + b23.transpose());
        let b03 = -(b13 + b23 + b33);
        let b00 = -(b01 + b02 + b03);
        self.hessian = [b00, b01, b02, b03, b11, b12, b13, b22, b23, b33];
        self.gradient = gradient_from(decomposition, spectrum.slope, inverse_edges, None);
    }
}

impl ElementDerivatives {
    /// Adds the terms of a triangle of the tet on the boundary, whose vertices are at `image`: the gradient of multiplier * (least - opening), and
    /// to its Hessian what the condensed system has of the constraint.
    pub(super) fn add_opening(&mut self, opening: &NearOpening, image: [&Vec3; 4]) {
        let derivatives = OpeningDerivatives::of(opening.corners.map(|corner| image[corner]));
        let NearActive { slack, multiplier } = opening.constraint;
        for (i, &corner) in opening.corners.iter().enumerate() {
            self.gradient[corner] -= derivatives.gradient[i] * multiplier;
        }
        for (block, (p, q)) in self.hessian.iter_mut().zip(Self::PAIRS) {
            let place = |corner: usize| opening.corners.iter().position(|&of_triangle| of_triangle == corner);
            if let (Some(i), Some(j)) = (place(p), place(q)) {
                let outer = derivatives.gradient[i] * derivatives.gradient[j].transpose();
                *block += outer * (multiplier / slack) - derivatives.hessian[i][j] * multiplier;
            }
        }
    }

    /// The same where something follows the Jacobian: `decomposition` is that of the whole.
    pub(super) fn fill_before(
        &mut self,
        decomposition: &Svd,
        spectrum: &Spectrum,
        inverse_edges: &Mat3,
        afterwards: Option<&Afterwards>,
    ) {
        match afterwards {
            None => self.fill(decomposition, spectrum, inverse_edges),
            Some(Afterwards { left, turning: None }) => {
                self.fill(decomposition, spectrum, inverse_edges);
                self.gradient = self.gradient.map(|g| left.transpose() * g);
                self.hessian = self.hessian.map(|block| left.transpose() * block * left);
            }
            Some(Afterwards { left, turning: Some(turning) }) => {
                self.fill_turning(decomposition, spectrum, inverse_edges, left, turning);
                let derivative = derivative_from(decomposition, spectrum.slope);
                self.gradient = gradient_before(derivative, inverse_edges, afterwards);
            }
        }
    }

    /// The Hessian where the whole is any affine function of the corners.
    fn fill_turning(
        &mut self,
        Svd { left: u, right: v, .. }: &Svd,
        spectrum: &Spectrum,
        inverse_edges: &Mat3,
        left: &Mat3,
        turning: &Turning,
    ) {
        // The derivatives of the whole in each coordinate of each corner, in the frame of its singular vectors.
        let rows = [0, 1, 2].map(|i| inverse_edges.row(i).into_owned());
        let gradients = [-(rows[0] + rows[1] + rows[2]), rows[0], rows[1], rows[2]];
        let changes: [[Mat3; 3]; 4] = std::array::from_fn(|corner| {
            std::array::from_fn(|axis| {
                let whole = left.column(axis) * gradients[corner] + turning.change[corner][axis];
                u.transpose() * whole * v
            })
        });
        let form = |a: &Mat3, b: &Mat3| -> f64 {
            let mut sum = 0.0;
            for i in 0..3 {
                for j in 0..3 {
                    sum += spectrum.scaling[(i, j)] * a[(i, i)] * b[(j, j)];
                }
            }
            for (mode, (i, j)) in AXIS_PAIRS.into_iter().enumerate() {
                let twists = (a[(i, j)] - a[(j, i)]) * (b[(i, j)] - b[(j, i)]);
                let flips = (a[(i, j)] + a[(j, i)]) * (b[(i, j)] + b[(j, i)]);
                sum += 0.5 * (spectrum.twist[mode] * twists + spectrum.flip[mode] * flips);
            }
            sum
        };
        self.hessian = Self::PAIRS.map(|(p, q)| Mat3::from_fn(|r, c| form(&changes[p][r], &changes[q][c])));
    }
}

/// The gradient with respect to the corners of a function with this derivative with respect to the Jacobian and what follows it.
pub(super) fn gradient_before(derivative: Mat3, inverse_edges: &Mat3, afterwards: Option<&Afterwards>) -> [Vec3; 4] {
    let Some(Afterwards { left, turning }) = afterwards else { return gradient_at_corners(derivative, inverse_edges) };
    let mut gradient = gradient_at_corners(left.transpose() * derivative, inverse_edges);
    if let Some(turning) = turning {
        for (g, change) in gradient.iter_mut().zip(&turning.change) {
            *g += Vec3::from_fn(|axis, _| change[axis].dot(&derivative));
        }
    }
    gradient
}

/// The gradient with respect to the four vertices of a function with derivatives `slope` in the singular values.
pub(super) fn gradient_from(
    decomposition: &Svd,
    slope: [f64; 3],
    inverse_edges: &Mat3,
    afterwards: Option<&Afterwards>,
) -> [Vec3; 4] {
    gradient_before(derivative_from(decomposition, slope), inverse_edges, afterwards)
}

/// The derivative with respect to the Jacobian of a function with derivatives `slope` in its singular values.
pub(super) fn derivative_from(Svd { left, right, .. }: &Svd, slope: [f64; 3]) -> Mat3 {
    left * Mat3::from_diagonal(&Vec3::from(slope)) * right.transpose()
}

/// The gradient with respect to the four vertices of a function with this derivative with respect to the Jacobian.
fn gradient_at_corners(derivative: Mat3, inverse_edges: &Mat3) -> [Vec3; 4] {
    let stress = derivative * inverse_edges.transpose();
    let [g1, g2, g3] = [0, 1, 2].map(|i| stress.column(i).into_owned());
    [-(g1 + g2 + g3), g1, g2, g3]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::svd;
    use crate::objective::{Barrier, CappedMean, SoftMax, TetEnergy, Untangling};

    /// The derivatives at a Jacobian, its negative curvature multiplied by `negative`.
    fn derivatives<E: TetEnergy>(energy: &E, jacobian: &Mat3, inverse: &Mat3, negative: f64) -> ElementDerivatives {
        let decomposition = svd(jacobian);
        let spectrum = energy.spectrum(0, decomposition.values, negative).expect("the energy is finite");
        let mut derivatives = ElementDerivatives::default();
        derivatives.fill(&decomposition, &spectrum, inverse);
        derivatives
    }

    fn value<E: TetEnergy>(energy: &E, jacobian: &Mat3) -> f64 {
        energy.value(0, svd(jacobian).values)
    }

    fn edges(x: &[Vec3; 4]) -> Mat3 {
        crate::domain::edge_matrix(*x)
    }

    /// Central differences at a range of steps: the error must fall like h^2 to rounding, then rise.
    fn check<E: TetEnergy>(energy: &E, image: [Vec3; 4]) {
        let rest = [Vec3::zeros(), Vec3::new(1.0, 0.1, 0.0), Vec3::new(0.2, 1.1, -0.1), Vec3::new(0.1, 0.0, 0.9)];
        let inverse = edges(&rest).try_inverse().unwrap();
        let at = |x: &[Vec3; 4]| derivatives(energy, &(edges(x) * inverse), &inverse, 0.0);
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
        check(&CappedMean { weight: 3.0, cap: 2.0 }, bent());
        let inside_out = [bent()[0], bent()[2], bent()[1], bent()[3]];
        for image in [bent(), inside_out] {
            check(&Untangling { epsilon: 0.5 }, image);
        }
    }

    fn check_hessian<E: TetEnergy>(energy: &E, image: [Vec3; 4]) {
        let inverse = Mat3::identity();
        let jacobian = edges(&image) * inverse;
        let exact = derivatives(energy, &jacobian, &inverse, 1.0);
        let projected = derivatives(energy, &jacobian, &inverse, 0.0);
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
                value(energy, &(edges(&x) * inverse))
            };
            let h = 1e-4;
            let second = (moved(h) + moved(-h) - 2.0 * moved(0.0)) / (h * h);
            // Rounding eps / h^2 = 2e-8 and truncation h^2 / 12 times a fourth derivative of at most rate^4 = 4096.
            assert!((form(&exact) - second).abs() <= 1e-4 * second.abs().max(1.0), "{} {second}", form(&exact));
            assert!(form(&projected) >= form(&exact).max(0.0) - 1e-9);
        }
    }

    #[test]
    fn hessians_match_second_differences_and_their_projections_lie_above() {
        check_hessian(&SoftMax::new(4.0, 0.3), bent());
        check_hessian(&Barrier { bound: 2.0 }, bent());
        check_hessian(&CappedMean { weight: 3.0, cap: 2.0 }, bent());
        let inside_out = [bent()[0], bent()[2], bent()[1], bent()[3]];
        for image in [bent(), inside_out] {
            check_hessian(&Untangling { epsilon: 0.5 }, image);
        }
    }

    #[test]
    fn derivatives_of_what_follows_a_jacobian_match_differences() {
        let wave = |seed: usize| (seed as f64 * 1.618).sin();
        let left = Mat3::identity() + Mat3::from_fn(|r, c| 0.2 * wave(3 * r + c));
        let change = std::array::from_fn(|v| {
            std::array::from_fn(|a| Mat3::from_fn(|r, c| 0.3 * wave(27 * v + 9 * a + 3 * r + c + 10)))
        });
        let turning = Some(Box::new(Turning { from: bent().map(|x| x * 0.9), change }));
        for afterwards in [Afterwards { left, turning: None }, Afterwards { left, turning }] {
            let inverse =
                edges(&[Vec3::zeros(), Vec3::x(), Vec3::new(0.2, 1.1, -0.1), Vec3::z()]).try_inverse().unwrap();
            let energy = SoftMax::new(2.0, 0.3);
            let at = |image: &[Vec3; 4]| {
                let decomposition = svd(&afterwards.after(edges(image) * inverse, image));
                let spectrum = energy.spectrum(0, decomposition.values, 1.0).expect("the energy is finite");
                let mut derivatives = ElementDerivatives::default();
                derivatives.fill_before(&decomposition, &spectrum, &inverse, Some(&afterwards));
                derivatives
            };
            let exact = at(&bent());
            let h = 1e-5;
            for (vertex, axis) in (0..4).flat_map(|vertex| (0..3).map(move |axis| (vertex, axis))) {
                let [less, more] = [-h, h].map(|step| {
                    let mut image = bent();
                    image[vertex][axis] += step;
                    image
                });
                let value = |image: &[Vec3; 4]| value(&energy, &afterwards.after(edges(image) * inverse, image));
                let slope = (value(&more) - value(&less)) / (2.0 * h);
                // Truncation h^2 times a third derivative of order 10, rounding 1e-16 / h.
                assert!((slope - exact.gradient[vertex][axis]).abs() < 1e-7, "{vertex} {axis}");
                let [less, more] = [at(&less), at(&more)];
                for (block, &(row, column)) in exact.hessian.iter().zip(&ElementDerivatives::PAIRS) {
                    if column == vertex {
                        let change = (more.gradient[row] - less.gradient[row]) / (2.0 * h);
                        assert!((change - block.column(axis)).norm() < 1e-6, "{row} {column} {axis}");
                    }
                }
            }
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

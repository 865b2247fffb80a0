//! The energy that untangles flipped maps.

use super::TetEnergy;
use super::element::{AXIS_PAIRS, Spectrum};
use crate::mesh::Mat3;

/// ||J||^2 / (3 chi(det J)^(2/3)) with chi(d) = (d + sqrt(epsilon^2 + d^2)) / 2 (Garanzha, Kaporin, Kudryavtseva, Protais,
/// Ray, Sokolov 2021, "Foldover-free maps in 50 lines of code", ACM TOG 40(4), eq. 2-4, without their volume term).
///
/// Finite for every J while epsilon > 0. For epsilon -> 0 it tends to the mean-ratio energy, >= 1 with equality for
/// similarities, where det J > 0, and to infinity elsewhere.
#[derive(Clone, Copy, Debug)]
pub struct Untangling {
    /// The regularisation, in units of the determinant, > 0.
    pub epsilon: f64,
}

impl Untangling {
    /// chi and its first two derivatives.
    fn regularised(&self, determinant: f64) -> (f64, f64, f64) {
        let root = determinant.hypot(self.epsilon);
        // For negative determinants the sum cancels; this form does not.
        let chi = if determinant >= 0.0 {
            0.5 * (determinant + root)
        } else {
            0.5 * self.epsilon * (self.epsilon / (root - determinant))
        };
        (chi, chi / root, 0.5 * (self.epsilon / root).powi(2) / root)
    }
}

impl TetEnergy for Untangling {
    fn value(&self, _tet: usize, s: [f64; 3]) -> f64 {
        let (chi, ..) = self.regularised(s[0] * s[1] * s[2]);
        (s[0] * s[0] + s[1] * s[1] + s[2] * s[2]) / (3.0 * chi.powf(2.0 / 3.0))
    }

    fn spectrum(&self, _tet: usize, s: [f64; 3], negative: f64) -> Option<Spectrum> {
        let damp = |curvature: f64| if curvature < 0.0 { negative * curvature } else { curvature };
        let (chi, chi1, chi2) = self.regularised(s[0] * s[1] * s[2]);
        // The energy is n * g with n = |s|^2 / 3 and g = chi^(-2/3) as a function of the determinant d.
        let n = (s[0] * s[0] + s[1] * s[1] + s[2] * s[2]) / 3.0;
        let g = chi.powf(-2.0 / 3.0);
        let g1 = -2.0 / 3.0 * g / chi * chi1;
        let g2 = 10.0 / 9.0 * g / (chi * chi) * chi1 * chi1 - 2.0 / 3.0 * g / chi * chi2;
        if !(n * g2).is_finite() {
            return None;
        }
        let cofactor = [s[1] * s[2], s[0] * s[2], s[0] * s[1]];
        let slope = [0, 1, 2].map(|i| 2.0 / 3.0 * s[i] * g + n * g1 * cofactor[i]);
        let scaling = Mat3::from_fn(|i, j| {
            let mixed = 2.0 / 3.0 * g1 * (s[i] * cofactor[j] + s[j] * cofactor[i]) + n * g2 * cofactor[i] * cofactor[j];
            if i == j { mixed + 2.0 / 3.0 * g } else { mixed + n * g1 * s[3 - i - j] }
        });
        let third = AXIS_PAIRS.map(|(i, j)| s[3 - i - j]);
        Some(Spectrum {
            slope,
            scaling: damp_eigenvalues(&scaling, negative),
            twist: third.map(|s| damp(2.0 / 3.0 * g + n * g1 * s)),
            flip: third.map(|s| damp(2.0 / 3.0 * g - n * g1 * s)),
        })
    }
}

/// The matrix with its negative eigenvalues multiplied by `negative`.
fn damp_eigenvalues(matrix: &Mat3, negative: f64) -> Mat3 {
    let eigen = matrix.symmetric_eigen();
    if negative == 1.0 || eigen.eigenvalues.iter().all(|&value| value >= 0.0) {
        return *matrix;
    }
    let damped = eigen.eigenvalues.map(|value| if value < 0.0 { negative * value } else { value });
    eigen.eigenvectors * Mat3::from_diagonal(&damped) * eigen.eigenvectors.transpose()
}

//! Multipliers of one tet as the searches find them, before they are made to satisfy the trace condition.

use crate::mesh::Mat3;

/// What the level k asks, as functions of ln k.
#[derive(Clone, Copy, Debug)]
pub(super) struct Level {
    /// `k^(1/3)`.
    pub(super) root: f64,
    /// `k^(2/3)`.
    pub(super) middle: f64,
    /// `k^(4/3)`, the largest ratio of eigenvalues of the Gram matrix.
    pub(super) ratio: f64,
    /// `c = 1 + k^(2/3) + k^(4/3)`, the largest ratio of its trace and smallest eigenvalue.
    pub(super) trace: f64,
}

impl Level {
    pub(super) fn new(log: f64) -> Self {
        let (root, middle) = ((log / 3.0).exp(), (2.0 / 3.0 * log).exp());
        Self { root, middle, ratio: middle * middle, trace: 1.0 + middle + middle * middle }
    }

    /// First and second derivative of `ratio` and of `trace` by ln k.
    pub(super) fn derivatives(self) -> [[f64; 2]; 2] {
        let by = |power: i32| [(2.0 / 3.0f64).powi(power) * self.middle, (4.0 / 3.0f64).powi(power) * self.ratio];
        let ([m1, r1], [m2, r2]) = (by(1), by(2));
        [[r1, r2], [m1 + r1, m2 + r2]]
    }
}

/// The multipliers of one tet in the coordinates of domain and image, with the letters of [the theorem](super).
#[derive(Clone, Copy, Debug)]
pub(super) struct Dual {
    /// S.
    pub(super) lower: Mat3,
    /// T.
    pub(super) volume: Mat3,
    /// R.
    pub(super) upper: Mat3,
    /// rho.
    pub(super) trace: f64,
    /// W.
    pub(super) cofactor: Mat3,
    /// eta and e.
    pub(super) determinant: [f64; 2],
}

impl Dual {
    /// What R and rho, and what W must be multiplied by so that the trace condition of a level is an equality: W by no more than
    /// 1, since larger R and rho lower Q everywhere, and a larger W does not.
    pub(super) fn stretch(&self, level: Level) -> [f64; 2] {
        let [eta, e] = self.determinant;
        // Many more digits than the determinant where T is nearly singular, and as much as the check will find.
        let mean = self.volume.cholesky().map_or(0.0, |factor| factor.l_dirty().diagonal().product().powi(2).cbrt());
        let earned = self.lower.trace() + level.middle * (3.0 * mean + 1.5 * eta * e);
        let bounds = level.ratio * self.upper.trace() + level.trace * self.trace;
        let cofactor = level.root * level.middle * self.cofactor.singular_values().sum();
        if earned >= bounds + cofactor && bounds > 0.0 {
            [(earned - cofactor) / bounds, 1.0]
        } else if bounds + cofactor > 0.0 {
            [earned / (bounds + cofactor); 2]
        } else {
            [1.0; 2]
        }
    }

    /// A size to compare tets by.
    pub(super) fn weight(&self) -> f64 {
        self.lower.trace() + self.volume.trace()
    }
}

//! The algorithms to choose from.

use std::fmt;

use serde::Deserialize;

use super::argmin_phase::ArgminSolver;
use super::{BoundaryValues, Objective, OptimizeError};

/// Most tets that [`Engine::Slsqp`] accepts. Its dense least squares problems grow like the cube of the size: 0.7 s in all
/// at 672 tets, no progress in 40 s at 705 on a mesh with more of its vertices inside.
pub const MOST_TETS_QUADRATIC: usize = 700;
/// Most tets that [`Engine::Mma`] and [`Engine::Ccsaq`] accept: 2 to 8 s at 480 tets. Now and then their dual problems take
/// minutes even at 96 tets, since the crate cannot loosen the tolerance; a time limit is looked at between them only.
pub const MOST_TETS_CONSERVATIVE: usize = 500;

/// Which algorithm moves the vertices.
///
/// The soft maxima are minimised by Newton or one of argmin's solvers. The largest K is settled by our interior-point
/// method or, for the last three engines, by NLopt in the epigraph form: the least t with `3 l_1 <= t` and `-3 l_3 <= t`
/// for every tet. Those start from the map of Newton's soft maxima up to exponent 48, use dense matrices and are for
/// small meshes: an independent check of the others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema, clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Engine {
    /// Projected Newton with a sparse factorization.
    #[default]
    Newton,
    /// argmin's limited-memory BFGS for the soft maxima.
    Lbfgs,
    /// argmin's Newton with conjugate gradients for the soft maxima.
    NewtonCg,
    /// argmin's trust region method with Steihaug's conjugate gradients for the soft maxima.
    TrustRegion,
    /// NLopt's method of moving asymptotes for the largest K, at most 500 tets.
    Mma,
    /// NLopt's conservative convex separable quadratic approximations for the largest K, at most 500 tets.
    Ccsaq,
    /// NLopt's sequential least-squares programming for the largest K, at most 700 tets.
    Slsqp,
}

impl Engine {
    /// Whether this engine can minimise an objective with such boundary values in this build.
    ///
    /// # Errors
    /// [`OptimizeError::NoNlopt`], [`OptimizeError::NotForSoftMax`] or [`OptimizeError::NotSliding`].
    pub fn check(self, objective: Objective, values: BoundaryValues) -> Result<(), OptimizeError> {
        match objective {
            _ if self.solves_epigraph() && cfg!(not(feature = "nlopt")) => Err(OptimizeError::NoNlopt(self)),
            Objective::SoftMax(_) if self.solves_epigraph() => Err(OptimizeError::NotForSoftMax(self)),
            _ if values == BoundaryValues::Sliding && self != Self::Newton => Err(OptimizeError::NotSliding(self)),
            _ => Ok(()),
        }
    }

    pub(super) fn check_size(self, tets: usize) -> Result<(), OptimizeError> {
        let most = match self {
            Self::Slsqp => MOST_TETS_QUADRATIC,
            Self::Mma | Self::Ccsaq => MOST_TETS_CONSERVATIVE,
            _ => return Ok(()),
        };
        if tets > most { Err(OptimizeError::TooManyTets { engine: self, most, tets }) } else { Ok(()) }
    }

    /// Whether the largest K is settled by NLopt instead of our interior-point method.
    pub(crate) fn solves_epigraph(self) -> bool {
        matches!(self, Self::Mma | Self::Ccsaq | Self::Slsqp)
    }

    /// The solver of argmin that minimises the soft maxima; `None` for ours.
    pub(super) fn soft_max_solver(self) -> Option<ArgminSolver> {
        match self {
            Self::Lbfgs => Some(ArgminSolver::Lbfgs),
            Self::NewtonCg => Some(ArgminSolver::NewtonCg),
            Self::TrustRegion => Some(ArgminSolver::TrustRegion),
            Self::Newton | Self::Mma | Self::Ccsaq | Self::Slsqp => None,
        }
    }
}

impl fmt::Display for Engine {
    /// The name in configs and on the command line.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Newton => "newton",
            Self::Lbfgs => "lbfgs",
            Self::NewtonCg => "newton-cg",
            Self::TrustRegion => "trust-region",
            Self::Mma => "mma",
            Self::Ccsaq => "ccsaq",
            Self::Slsqp => "slsqp",
        })
    }
}

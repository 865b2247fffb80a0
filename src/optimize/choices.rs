//! What may be chosen of an optimization: objective, polish, effort, boundary values, and what is known of its start.

use serde::Deserialize;

/// What is minimised.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Objective {
    /// The largest K of all tets.
    Max,
    /// The soft maximum E_p with this exponent p > 0.
    SoftMax(f64),
}

/// What is done after the largest K is settled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Polish {
    /// The mean is lowered while max K may rise by [`rise`](super::OptimizeSettings::rise).
    Mean,
    /// The next largest K is settled with the tets of the largest one held, and so on.
    Lexicographic {
        /// Number of values settled, the largest one included.
        levels: usize,
    },
    /// Nothing.
    None,
}

/// What becomes of fixed vertices on the boundary.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum BoundaryValues {
    /// They stay where they are.
    #[default]
    Fixed,
    /// They may move on the sphere about the origin on which they must be.
    Sliding,
}

/// What is known of a start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// Nothing.
    Anywhere,
    /// It was settled on a mesh that this one refines where K is large: all exponents but the last of a soft maximum are left out, and what
    /// lies far from these places stays where it is.
    Settled,
}

/// How much work the largest K is worth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema, clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Effort {
    /// Until there is at most 1 % left to gain near the map, by the residual.
    Quick,
    /// Until the map is stationary, if at most 20,000 vertices have a say in it; else to the end of the soft maximum with the exponent 128.
    #[default]
    Normal,
    /// The same for up to 60,000 vertices, with which a step takes 20 s and 3 GB; else to the end of that with 1024.
    Thorough,
}

impl Effort {
    /// The accuracy in ln K at which the last phase ends, where this one is asked for.
    pub(crate) fn accuracy(self, tolerance: f64) -> f64 {
        tolerance.max(self.least_tolerance())
    }

    /// The accuracy in ln K below which no more is done. The maximum may be violated by as much as the multipliers say is left.
    fn least_tolerance(self) -> f64 {
        match self {
            Self::Quick => 5e-3,
            Self::Normal | Self::Thorough => 0.0,
        }
    }

    /// The last exponent of the soft maximum on meshes on which the tets of large K are too many to be solved for at once. On a million tets
    /// of a smooth solid 16, as before a part of them was, led to a K of 1.85, and these to 1.74, 1.61 and 1.56, in 1.6, 2 and 4 times the time.
    pub(super) fn last_exponent(self) -> f64 {
        match self {
            Self::Quick => 48.0,
            Self::Normal => 128.0,
            Self::Thorough => f64::INFINITY,
        }
    }

    /// Most free vertices that are solved for at once, directly.
    pub(super) fn most_free(self) -> usize {
        match self {
            // 2 s a step.
            Self::Quick | Self::Normal => 20_000,
            Self::Thorough => 60_000,
        }
    }
}

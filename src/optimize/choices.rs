//! What may be chosen of an optimization: objective, polish, effort, boundary values.

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

/// How much work the largest K is worth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema, clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Effort {
    /// Until there is at most 1 % left to gain near the map, by the residual.
    Quick,
    /// Until the map is stationary, if at most 20,000 vertices have a say in it.
    #[default]
    Normal,
    /// The same for up to 60,000 vertices, with which a step takes 20 s and 3 GB.
    Thorough,
}

impl Effort {
    /// The accuracy in ln K below which no more is done. The maximum may be violated by as much as the multipliers say is left.
    pub(super) fn least_tolerance(self) -> f64 {
        match self {
            Self::Quick => 5e-3,
            Self::Normal | Self::Thorough => 0.0,
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

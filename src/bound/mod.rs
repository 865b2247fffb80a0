//! Proved lower bounds for the largest dilatation, one theorem a file (bounds.md), each with its scope.

use serde::Serialize;

pub use crate::mesh::Place;

/// Which dilatation a bound holds for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Kind {
    /// The inner dilatation K_I (and so K).
    #[serde(rename = "K_I")]
    Inner,
    /// The outer dilatation K_O (and so K).
    #[serde(rename = "K_O")]
    Outer,
    /// K = max(K_I, K_O) only.
    #[serde(rename = "K")]
    K,
}

/// Which maps a bound speaks of. A gap is taken only between a map and a bound whose scope contains it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Scope {
    /// Any quasi-conformal map of the solid onto the smooth ball, boundary values free ([QC] in bounds.md).
    #[serde(rename = "any qc map of the solid onto the ball")]
    Shape,
    /// Any quasi-conformal map of the solid onto the smooth ball with the radial boundary values ([QC-fix]).
    #[serde(rename = "qc maps of the solid onto the ball with the radial boundary values")]
    ShapeFixedTrace,
    /// Piecewise-linear maps of this mesh with these boundary positions ([PL-fix]): the scope of what we measure.
    #[serde(rename = "PL maps of this mesh with this boundary")]
    MeshFixedBoundary,
}

/// A lower bound.
#[derive(Clone, Debug, Serialize)]
pub struct LowerBound {
    /// Short fixed name, e.g. `"vertex"`.
    pub name: &'static str,
    /// Where it comes from, e.g. `"bounds.md B4.4"` or `"paper eq. 44"`.
    pub source: &'static str,
    /// Which dilatation it bounds.
    pub kind: Kind,
    /// The bound, >= 1 and finite.
    pub value: f64,
    /// Which maps it speaks of.
    pub scope: Scope,
    /// Proved (with the source's proof), not merely quoted.
    pub certified: bool,
    /// Whether the measured map is one of those the bound speaks of, so that the gap may be taken.
    pub applies: bool,
    /// One clause: why it applies or not.
    pub reason: String,
    /// Where it is attained.
    pub place: Option<Place>,
}

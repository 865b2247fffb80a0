//! Exact per-tet dilatations of a piecewise-linear map, and what is said of the map from them.

use serde::Serialize;

use crate::dilatation::Dilatation;
use crate::domain::Domain;
use crate::mesh::{TetId, Vec3};

/// What was measured of one piecewise-linear map, from domain and image positions alone.
///
/// All dilatations are scale-free ratios >= 1; a flipped tet (image determinant not positive by exact predicate) has
/// infinite dilatations, and so has every maximum or mean that includes it.
#[derive(Clone, Debug)]
pub struct Measured {
    /// One entry a tet.
    pub dilatations: Vec<Dilatation>,
    /// Tets whose image is not positively oriented, by exact predicate.
    pub flipped: Vec<TetId>,
    /// The maximum and means over all tets.
    pub summary: Summary,
}

/// The figures of a [`Measured`] that reports print.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Largest K; infinite if a tet is flipped.
    pub max_k: f64,
    /// Mean of K over the tets, each counted once; infinite if a tet is flipped.
    pub mean_k: f64,
    /// Mean of K weighted by domain volume.
    pub volume_mean_k: f64,
    /// Median, 90 %, 99 % and 99.9 % quantiles of K over the tets (nearest rank).
    pub p50_k: f64,
    /// See `p50_k`.
    pub p90_k: f64,
    /// See `p50_k`.
    pub p99_k: f64,
    /// See `p50_k`.
    pub p999_k: f64,
    /// Largest K_I.
    pub max_k_inner: f64,
    /// Largest K_O.
    pub max_k_outer: f64,
    /// Number of flipped tets.
    pub flipped: usize,
    /// Largest K_I over the tets that are not flipped.
    pub max_k_inner_unflipped: f64,
    /// Largest K_O over the tets that are not flipped.
    pub max_k_outer_unflipped: f64,
    /// Mean of K over the tets that are not flipped.
    pub mean_k_unflipped: f64,
}

/// Measures the map that takes the domain's vertices to `image` (one position a vertex, same order).
pub fn measure(domain: &Domain, image: &[Vec3]) -> Measured {
    let _ = (domain, image);
    unimplemented!("helper")
}

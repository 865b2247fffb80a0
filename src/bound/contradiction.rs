//! A bound above what a map achieves: one of the two is wrong, and no result.

use super::{Kind, LowerBound, check};
use crate::dilatation::lower_bound;
use crate::domain::Domain;
use crate::measure::Summary;
use crate::mesh::{TetId, Vec3};

/// A bound called proved, and a map in its scope that is proved to lie below it: an error of the program.
#[derive(Clone, Debug, thiserror::Error)]
#[error(
    "internal error: the bound \"{}\" claims {} >= {} for {}, but this map is shown to lie below it; its measured K_I is {}, K_O {}. \
     Nothing else of this result can be believed. Please report it with {files}",
    bound.name, bound.kind.symbol(), lower_bound(bound.value), bound.reason, achieved[0], achieved[1]
)]
pub struct Contradiction {
    /// The bound.
    pub bound: LowerBound,
    /// The largest K_I and K_O measured.
    pub achieved: [f64; 2],
    /// The files from which it can be reproduced.
    pub files: String,
}

/// Sets the bounds that are proved and speak of the map against what it achieves; `files` are those a report of an error needs.
///
/// A measured value below a bound may be rounding, where tets are thin: it counts where interval arithmetic shows that every tet's
/// dilatation is below the bound.
///
/// # Errors
/// The first bound that is contradicted.
///
/// # Panics
/// If `image` has fewer positions than the domain has vertices.
pub fn confront(
    bounds: &[LowerBound],
    domain: &Domain,
    image: &[Vec3],
    measured: &Summary,
    files: &str,
) -> Result<(), Box<Contradiction>> {
    let achieved = [measured.max_k_inner, measured.max_k_outer];
    let proved_below = |bound: &LowerBound| {
        (0..domain.mesh().tets().len() as u32).map(TetId).all(|tet| {
            let images = domain.mesh().tets()[tet.index()].map(|v| image[v.index()]);
            check::linear::is_below(domain.enclosed_corners(tet), images, bound.kind, bound.value)
        })
    };
    let measured_below = |bound: &LowerBound| match bound.kind {
        Kind::Inner => measured.max_k_inner < bound.value,
        Kind::Outer => measured.max_k_outer < bound.value,
        Kind::K => measured.max_k < bound.value,
    };
    let mut claims = bounds.iter().filter(|bound| bound.applies && bound.certified);
    match claims.find(|bound| measured_below(bound) && proved_below(bound)) {
        Some(bound) => Err(Box::new(Contradiction { bound: bound.clone(), achieved, files: files.to_string() })),
        None => Ok(()),
    }
}

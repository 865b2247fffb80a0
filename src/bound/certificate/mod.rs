//! The Gram certificate: a bound for the mesh with its boundary fixed that anybody can check.
//!
//! **What holds.** Let A be the Jacobian of a piecewise-linear map on a tet, `s1 >= s2 >= s3 > 0` its singular values and
//! `d = det A > 0`. The entries of the Gram matrix `G = A^T A` and of the cofactors `C = d A^-T` are quadratic in the
//! vertices' positions, and so is d itself if at most two vertices are free. With `delta = d^(2/3)` and
//! `c = 1 + k^(2/3) + k^(4/3)`, K <= k implies
//!
//! ```text
//! k^(-2/3) delta I <= G <= k^(2/3) delta I        tr G <= c k^(-2/3) delta        |C| <= k^(1/3) delta
//! ```
//!
//! `K_O = s1^3 / d <= k` is `s1^2 <= k^(2/3) delta`, and `K_I = d / s3^3 <= k` is `delta <= k^(2/3) s3^2`, from which the
//! spectral norm of C, `s1 s2 = d / s3`, is at most `k^(1/3) delta`. For the trace let `l_i = ln s_i - ln d / 3`: they lie in the hexagon of
//! sum 0 and `|l_i| <= a = ln k / 3`, on which the convex sum of `exp(2 l_i)` is largest at a vertex `(a, 0, -a)`.
//!
//! **Certificate.** A number k and for each tet of a sub-complex positive semidefinite S, T and R, any W, and rho, eta, e >= 0
//! with eta = 0 if more than two vertices of the tet are free and e > 0 if eta is not zero, such that
//!
//! ```text
//! tr S + k^(2/3) (3 (det T)^(1/3) + 3/2 eta e) >= k^(4/3) tr R + c rho + k |W|_*
//! ```
//!
//! with the nuclear norm of W. Let `M = S + T - R - rho I`. If the quadratic function of the free vertices
//!
//! ```text
//! Q = sum over the tets of <M, G> - <W, C> + eta (d + e^3 / 2)
//! ```
//!
//! is strictly concave and its maximum is negative, then **every map that is orientation-preserving on these tets has K > k
//! on one of them, whatever the free vertices do**. Proof: where all have K <= k,
//!
//! ```text
//! <S, G> >= k^(-2/3) delta tr S            <R, G> <= k^(2/3) delta tr R         rho tr G <= rho c k^(-2/3) delta
//! <T, G> >= 3 (det T det G)^(1/3) = 3 (det T)^(1/3) delta                       <W, C> <= k^(1/3) delta |W|_*
//! d + e^3 / 2 >= 3/2 e delta
//! ```
//!
//! (the last two lower bounds by the inequality of arithmetic and geometric means), so that Q is at least the sum of
//! `k^(-2/3) delta` times the difference of the two sides of the condition, and Q >= 0: a contradiction. Injectivity is not needed. Where
//! eta = 0 on all tets the same holds with `delta = |d|^(2/3)`, and orientation is not needed either.
//!
//! **Split by a box.** Tets with three free vertices know nothing of orientation. Let h be one of these vertices. Every map sends h
//! into a given box or beyond one of its six walls. Beyond a wall, its distance from the wall times a number >= 0 may be added to Q. In the
//! box, h takes the places of the eight corners in turn, as if it were fixed, with the same multipliers for all: d of a tet at
//! h is quadratic in its two other free vertices, and Q has no larger values for h inside the box than at its corners, but for a
//! term of the second order in the size of the box (`check::Checker::check`).
//!
//! **Check** ([`check()`]). From the mesh, the boundary positions and the certificate alone, with all rounding accounted for:
//! gradients, Jacobians, the condition, Q and its gradient by interval arithmetic, with `|W|_*` bounded by half the sum of the
//! squares of X and Y, `W = X Y^T`; concavity by a sparse Cholesky factorization with an a-priori bound on its error; the
//! maximum by `max Q <= Q(x) + |grad Q(x)|^2 / (4 lambda)` at an approximate maximiser x, lambda below the least eigenvalue
//! of minus Q's Hessian / 2. W and eta couple the coordinates: two vertices of a tet with gradients g and h of their
//! barycentric coordinates have the skew block of the vector `(eta A - W) (g x h) / 2`.
//!
//! **Search** ([`search()`]), in two ways.
//! - *Few free vertices* (`moments`): the moments of the free positions are the unknowns of a convex problem in which G, C
//!   and d are linear. The largest slack of its conditions is found by a logarithmic barrier and a dense Newton system, and
//!   the level for which that slack is zero by Newton's method on ln k. The multipliers of the barrier are the certificate. With
//!   a box the corners' moments are the unknowns.
//! - *Many* (`path`): with T, W and eta zero, the free vertices may move in more than three coordinates: with enough of them
//!   local optima are global, and Q is concave there (Burer and Monteiro). It has the sparsity of the mesh, and a logarithmic
//!   barrier and Newton's method solve it on a star of 100 tets in some hundredths of a second.
//!
//! **Limits.** The positions' moments are relaxed, and tets with three free vertices know nothing of orientation, so that the
//! best k is below the least K.

mod check;
mod dual;
mod lifted;
mod moments;
mod multipliers;
mod path;
mod relaxed;
mod search;
#[cfg(test)]
mod tests;

use std::time::Duration;

use serde::{Deserialize, Serialize};

pub use search::{search, search_on};

use super::{BoundName, Kind, LowerBound};
use crate::domain::Domain;
use crate::mesh::{Place, TetId, Vec3, VertexId};
use check::{Checker, Region, Wall};
use multipliers::Multipliers;

/// The longest search where nothing else is said.
pub const DEFAULT_TIME_LIMIT: Duration = Duration::from_secs(60);

/// A certificate; `certificate.json` holds it under these names. Entry i of every list belongs to tet `tets[i]`.
///
/// S and R are given by their Cholesky factors, the lower triangle of L row by row, `[L11, L21, L22, L31, L32, L33]`, with
/// `S = L L^T` in the coordinates of the domain. Tets of the mesh that are not listed have S = R = rho = 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Certificate {
    /// k, at least 1: what is proved is K > k.
    pub level: f64,
    /// Tets of the domain, counted from 0, ascending; elements, where corners are like powers ([`crate::map::Corners::elements`]).
    pub tets: Vec<u32>,
    /// The factor of S, the multiplier of `tau I <= G`.
    pub lower: Vec<[f64; 6]>,
    /// The factor of R, the multiplier of `G <= k^(4/3) tau I`.
    pub upper: Vec<[f64; 6]>,
    /// rho >= 0, the multiplier of `tr G <= c tau`.
    pub trace: Vec<f64>,
    /// The factor of T, the multiplier of `delta^3 <= det G`; all zero if the list is empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub volume: Vec<[f64; 6]>,
    /// X and Y, row by row, with `W = X Y^T` the multiplier of `|C| <= k^(1/3) delta`; all zero if the list is empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cofactor: Vec<[[f64; 9]; 2]>,
    /// eta and e, the multiplier of `delta <= d^(2/3)` and the d^(1/3) at which it is a tangent; all zero if the list is empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub determinant: Vec<[f64; 2]>,
    /// If given, the lists above are a proof only for maps that send a vertex into a box, and those of the other maps are here.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub split: Option<Box<Split>>,
}

/// A proof split by where one vertex goes: into a box or beyond one of its six walls.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Split {
    /// The vertex, not on the boundary, counted from 0.
    pub vertex: u32,
    /// The lowest coordinates of the box, in those of the image.
    pub low: [f64; 3],
    /// The highest.
    pub high: [f64; 3],
    /// Proofs for the maps that send the vertex below `low` and above `high` along the first axis, then the second, then the third.
    pub outside: Vec<Outside>,
}

/// A proof for the maps that send a vertex beyond a wall.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Outside {
    /// The multiplier of the distance beyond the wall, >= 0: the distance times it is added to Q.
    pub push: f64,
    /// The multipliers of the tets.
    pub certificate: Certificate,
}

impl Certificate {
    fn new(level: f64, tets: &[TetId], multipliers: &[Multipliers]) -> Self {
        Self {
            level,
            tets: tets.iter().map(|tet| tet.0).collect(),
            lower: multipliers.iter().map(|m| m.lower).collect(),
            upper: multipliers.iter().map(|m| m.upper).collect(),
            trace: multipliers.iter().map(|m| m.trace).collect(),
            volume: unless_zero(multipliers.iter().map(|m| m.volume).collect()),
            cofactor: unless_zero(multipliers.iter().map(|m| m.cofactor).collect()),
            determinant: unless_zero(multipliers.iter().map(|m| m.determinant).collect()),
            split: None,
        }
    }

    /// Whether the proof speaks of orientation-preserving maps only: eta is not zero on some tet.
    pub fn is_oriented(&self) -> bool {
        let outside = self.split.iter().flat_map(|split| &split.outside);
        self.determinant.iter().any(|[eta, _]| *eta != 0.0) || outside.into_iter().any(|o| o.certificate.is_oriented())
    }

    /// The certificate as it stands in `certificate.json`; every number is read back as the same bits.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("numbers in lists") + "\n"
    }
}

/// The list, or an empty one if all its entries are zero.
fn unless_zero<T: Default + PartialEq>(list: Vec<T>) -> Vec<T> {
    if list.iter().all(|entry| *entry == T::default()) { Vec::new() } else { list }
}

/// Why a certificate proves nothing of a mesh with its boundary.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Rejection {
    /// It is no certificate for this mesh at all.
    #[error("the certificate does not fit the mesh: {0}")]
    Malformed(String),
    /// No vertex of its tets is free.
    #[error("no tet of the certificate has a vertex inside the mesh")]
    NothingFree,
    /// A tet of the domain is so flat that its volume cannot be told from zero.
    #[error("tet {tet} of the domain is too flat for interval arithmetic")]
    Degenerate {
        /// The tet, counted from 0.
        tet: u32,
    },
    /// The sparse factor cannot be held.
    #[error("the sparse factor does not fit in memory")]
    TooLarge,
    /// Multipliers of lower bounds are too small, or one has the wrong sign.
    #[error(
        "tet {tet}: the multipliers S, T and eta do not outweigh R, rho and W at this level, or rho, eta or e is negative, or \
         eta positive without e"
    )]
    TraceCondition {
        /// The tet, counted from 0.
        tet: u32,
    },
    /// eta is used where the determinant is not a quadratic function of the free vertices.
    #[error("tet {tet} has more than two free vertices, so that its eta must be zero")]
    NotQuadratic {
        /// The tet, counted from 0.
        tet: u32,
    },
    /// Q is not concave, or not by enough to show it.
    #[error("the quadratic function of the free vertices is not shown to be strictly concave")]
    NotConcave,
    /// The maximum of Q is not negative, or not by enough to show it.
    #[error("the maximum of the quadratic function of the free vertices is not shown to be negative")]
    NotNegative,
}

/// Checks a certificate for all maps with these boundary positions; interior entries of `image` are not read. Returns the
/// k for which K > k is proved.
///
/// # Errors
/// The first condition that could not be verified.
///
/// # Panics
/// If `image` has fewer positions than the domain has vertices.
pub fn check(certificate: &Certificate, domain: &Domain, image: &[Vec3]) -> Result<f64, Rejection> {
    let Some(split) = &certificate.split else {
        check_in(Region::Whole, certificate, domain, image)?;
        return Ok(certificate.level);
    };
    let malformed = |message: &str| Err(Rejection::Malformed(message.into()));
    let Split { vertex, low, high, outside } = &**split;
    let vertex = VertexId(*vertex);
    if vertex.index() >= domain.mesh().points().len() || domain.boundary().contains(vertex) {
        return malformed("the vertex of its box is not one inside the mesh");
    }
    if !low.iter().zip(high).all(|(low, high)| low < high && low.is_finite() && high.is_finite()) {
        return malformed("its box is empty");
    }
    if outside.len() != 6 {
        return malformed("its box needs six proofs for the outside");
    }
    check_in(Region::Inside(vertex, [Vec3::from(*low), Vec3::from(*high)]), certificate, domain, image)?;
    for (side, Outside { push, certificate: part }) in outside.iter().enumerate() {
        if !(*push >= 0.0 && push.is_finite()) || part.split.is_some() || part.level < certificate.level {
            return malformed("a proof for the outside has a lower level, a negative multiplier or a box of its own");
        }
        let (axis, is_high) = (side / 2, side % 2 == 1);
        let (bound, outwards) = if is_high { (high[axis], 1.0) } else { (low[axis], -1.0) };
        check_in(Region::Beyond(Wall { vertex, axis, bound, outwards, push: *push }), part, domain, image)?;
    }
    Ok(certificate.level)
}

/// Checks the multipliers of a certificate for the maps of a region.
fn check_in(region: Region, certificate: &Certificate, domain: &Domain, image: &[Vec3]) -> Result<(), Rejection> {
    let Certificate { level, tets, lower, upper, trace, volume, cofactor, determinant, split: _ } = certificate;
    let malformed = |message: String| Err(Rejection::Malformed(message));
    let (count, in_mesh) = (tets.len(), domain.mesh().tets().len());
    let optional = [volume.len(), cofactor.len(), determinant.len()];
    if [lower.len(), upper.len(), trace.len()] != [count; 3] || optional.iter().any(|&len| len != 0 && len != count) {
        return malformed("its lists must have one entry for each of its tets".into());
    }
    if let Some(pair) = tets.windows(2).find(|pair| pair[0] >= pair[1]) {
        return malformed(format!("tet {} must not follow tet {}; tets must ascend", pair[1], pair[0]));
    }
    if let Some(&last) = tets.last().filter(|&&last| last as usize >= in_mesh) {
        return malformed(format!("it names tet {last}, but there are only {in_mesh}, counted from 0"));
    }
    if !(*level >= 1.0 && level.is_finite()) {
        return malformed(format!("its level is {level}, but must be finite and at least 1"));
    }
    let factors = lower.iter().chain(upper).chain(volume).flatten();
    let others = trace.iter().chain(cofactor.iter().flatten().flatten()).chain(determinant.iter().flatten());
    if !factors.chain(others).all(|number| number.is_finite()) {
        return malformed("a multiplier is not a finite number".into());
    }
    let multipliers: Vec<Multipliers> = (0..count)
        .map(|i| Multipliers {
            lower: lower[i],
            upper: upper[i],
            trace: trace[i],
            volume: volume.get(i).copied().unwrap_or_default(),
            cofactor: cofactor.get(i).copied().unwrap_or_default(),
            determinant: determinant.get(i).copied().unwrap_or_default(),
        })
        .collect();
    let coupled = multipliers.iter().any(Multipliers::couples_coordinates);
    let tets = tets.iter().map(|&tet| TetId(tet)).collect();
    Checker::new(domain, tets, coupled, region)?.check(*level, &multipliers, image)
}

/// The bound that a certificate proves: K > k for every piecewise-linear map of this mesh with these boundary positions. Its
/// place is the boundary vertex with the largest traces of S around it.
///
/// # Errors
/// Why the certificate is rejected.
///
/// # Panics
/// If `image` has fewer positions than the domain has vertices.
pub fn bound(certificate: &Certificate, domain: &Domain, image: &[Vec3]) -> Result<LowerBound, Rejection> {
    let value = check(certificate, domain, image)?;
    let mut weights = vec![0.0; image.len()];
    for (&tet, factor) in certificate.tets.iter().zip(&certificate.lower) {
        let trace: f64 = factor.iter().map(|entry| entry * entry).sum();
        let corners = domain.mesh().tets()[tet as usize];
        corners.iter().filter(|&&v| domain.boundary().contains(v)).for_each(|v| weights[v.index()] += trace);
    }
    let vertices = (0..).map(VertexId).zip(weights);
    let (centre, _) = vertices.reduce(|a, b| if b.1 > a.1 { b } else { a }).ok_or(Rejection::NothingFree)?;
    let place = Place::vertex(domain.mesh(), centre);
    let maps = if certificate.is_oriented() { "any orientation-preserving PL map" } else { "any PL map" };
    let reason =
        format!("{maps} of this mesh with these boundary positions; certificate on {} tets", certificate.tets.len());
    Ok(LowerBound::of_mesh(BoundName::Gram, Kind::K, value, place, reason))
}

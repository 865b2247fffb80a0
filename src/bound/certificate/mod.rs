//! placeholder

mod check;
mod interval;
mod path;
mod relaxed;
mod search;

use serde::{Deserialize, Serialize};

use check::Checker;
pub use search::search;

use crate::domain::Domain;
use crate::mesh::{TetId, Vec3};

/// The multipliers of one tet.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Multipliers {
    /// The lower triangle, row by row, of L with S = L L^T
    pub lower: [f64; 6],
    /// The same of R.
    pub upper: [f64; 6],
    /// rho.
    pub trace: f64,
}

/// A certificate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Certificate {
    /// k.
    pub level: f64,
    /// The tets, ascending.
    pub tets: Vec<u32>,
    /// One a tet.
    pub multipliers: Vec<Multipliers>,
}

/// Why a certificate proves nothing.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Rejection {
    /// It is no certificate for this mesh at all.
    #[error("malformed certificate: {0}")]
    Malformed(String),
    /// Flat tet.
    #[error("tet {tet} is too flat for interval arithmetic")]
    Degenerate {
        /// The tet, counted from 0.
        tet: u32,
    },
    /// Too large.
    #[error("the sparse factor does not fit in memory")]
    TooLarge,
    /// Trace condition.
    #[error("the multipliers of tet {tet} violate the trace condition tr S >= k^(4/3) tr R + (1 + k^(2/3) + k^(4/3)) rho")]
    TraceCondition {
        /// The tet, counted from 0.
        tet: u32,
    },
    /// Not concave
    #[error("the quadratic form is not verified to be strictly concave in the free vertices")]
    NotConcave,
    /// Not negative.
    #[error("the quadratic form is not verified to be negative")]
    NotNegative,
}

/// check
pub fn check(certificate: &Certificate, domain: &Domain, image: &[Vec3]) -> Result<f64, Rejection> {
    let tets: Vec<TetId> = certificate.tets.iter().map(|&tet| TetId(tet)).collect();
    Checker::new(domain, tets)?.check(certificate.level, &certificate.multipliers, image)?;
    Ok(certificate.level)
}

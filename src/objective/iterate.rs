//! A map as the sums over tets see it: decomposed once, then used by every energy and measurement.

use rayon::prelude::*;

use super::assembly::CHUNK;
use super::element::centred_logs;
use super::extremes::{TetFunction, of_decomposition};
use crate::domain::Domain;
use crate::linalg::{LANES, Svd, svds};
use crate::mesh::{TetId, Vec3};

/// Positions of all vertices, and the singular value decomposition of each tet's Jacobian there: 168 bytes a tet.
#[derive(Clone, Debug)]
pub struct Iterate {
    image: Vec<Vec3>,
    tets: usize,
    /// The last group is filled up with its last tet.
    groups: Vec<[Svd; LANES]>,
}

impl Iterate {
    /// Decomposes the map that takes the domain's vertices to `image`, one position a vertex.
    pub fn new(domain: &Domain, image: Vec<Vec3>) -> Self {
        let tets = domain.mesh().tets().len();
        let jacobian = |tet: usize| domain.jacobian(TetId(tet.min(tets - 1) as u32), &image);
        let groups = (0..tets.div_ceil(LANES))
            .into_par_iter()
            .with_min_len(CHUNK / LANES)
            .map(|group| svds(&std::array::from_fn::<_, LANES, _>(|lane| jacobian(LANES * group + lane))))
            .collect();
        Self { image, tets, groups }
    }

    /// The positions.
    pub fn image(&self) -> &[Vec3] {
        &self.image
    }

    /// The positions alone.
    pub fn into_image(self) -> Vec<Vec3> {
        self.image
    }

    /// The decomposition of every tet's Jacobian.
    pub fn decompositions(&self) -> &[Svd] {
        &self.groups.as_flattened()[..self.tets]
    }

    /// The centred logs of every tet's singular values; `None` where it is flipped.
    pub fn logs(&self) -> impl Iterator<Item = Option<[f64; 3]>> + '_ {
        self.decompositions().iter().map(|decomposition| centred_logs(decomposition.values))
    }

    /// ln K of every tet; `None` if one is flipped.
    pub fn log_dilatations(&self) -> Option<Vec<f64>> {
        self.logs().map(|logs| logs.map(|logs| 3.0 * logs[0].max(-logs[2]))).collect()
    }

    /// `ln K_O` and `ln K_I` of a tet of the domain, see [`log_dilatations`](super::log_dilatations()); `None` if it is
    /// flipped.
    pub fn functions(&self, domain: &Domain, tet: usize) -> Option<[TetFunction; 2]> {
        of_decomposition(&self.decompositions()[tet], domain, TetId(tet as u32))
    }

    /// The largest |l|, so that `max K = exp(3 * largest)`; `None` if a tet is flipped.
    pub fn largest_log(&self) -> Option<f64> {
        let mut largest = 1.0f64;
        for [s1, s2, s3] in self.decompositions().iter().map(|decomposition| decomposition.values) {
            // A maximum would pass over what is not a number.
            if s3 <= 0.0 || s3.is_nan() {
                return None;
            }
            largest = largest.max((s1 / s2) * (s1 / s3)).max((s1 / s3) * (s2 / s3));
        }
        // One log instead of three a tet.
        let log = largest.ln() / 3.0;
        log.is_finite().then_some(log)
    }
}

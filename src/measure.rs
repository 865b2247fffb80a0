//! Exact per-tet dilatations of a piecewise-linear map, and what is said of the map from them.

mod ball;
mod bottleneck;

pub use ball::{
    BallDilatation, NotOntoBall, ball_dilatation, ball_fraction, measure_onto_ball, measure_onto_ball_until,
    measure_warped_onto_ball, warped_ball_dilatation,
};
pub(crate) use ball::{Factor, OntoBall, ball_dilatation_until};
pub use bottleneck::{Bottleneck, bottleneck, bottleneck_places};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::dilatation::{Dilatation, null_is_infinite};
use crate::domain::Domain;
use crate::map::Elements;
use crate::mesh::{Orientation, TetId, Vec3, orientation};

/// What was measured of one piecewise-linear map, from domain and image positions alone.
///
/// All dilatations are scale-free ratios >= 1; a flipped tet (image determinant not positive by exact predicate) has
/// infinite dilatations, and so has every maximum or mean that includes it. A tet that is positive by predicate but so
/// thin, in domain or image, that its Jacobian overflows or its computed determinant is not positive has infinite
/// dilatations too, without being counted as flipped.
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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Largest K; infinite if a tet is flipped.
    #[serde(deserialize_with = "null_is_infinite")]
    pub max_k: f64,
    /// Mean of K over the tets, each counted once; infinite if a tet is flipped.
    #[serde(deserialize_with = "null_is_infinite")]
    pub mean_k: f64,
    /// Mean of K weighted by domain volume; infinite if a tet is flipped.
    #[serde(deserialize_with = "null_is_infinite")]
    pub volume_mean_k: f64,
    /// Median, 90 %, 99 % and 99.9 % quantiles of K over the tets (nearest rank).
    #[serde(deserialize_with = "null_is_infinite")]
    pub p50_k: f64,
    /// See `p50_k`.
    #[serde(deserialize_with = "null_is_infinite")]
    pub p90_k: f64,
    /// See `p50_k`.
    #[serde(deserialize_with = "null_is_infinite")]
    pub p99_k: f64,
    /// See `p50_k`.
    #[serde(deserialize_with = "null_is_infinite")]
    pub p999_k: f64,
    /// Largest K_I.
    #[serde(deserialize_with = "null_is_infinite")]
    pub max_k_inner: f64,
    /// Largest K_O.
    #[serde(deserialize_with = "null_is_infinite")]
    pub max_k_outer: f64,
    /// Number of flipped tets.
    pub flipped: usize,
    /// Largest K_I over the tets that are not flipped; infinite, like the two below, if there is none.
    #[serde(deserialize_with = "null_is_infinite")]
    pub max_k_inner_unflipped: f64,
    /// Largest K_O over the tets that are not flipped.
    #[serde(deserialize_with = "null_is_infinite")]
    pub max_k_outer_unflipped: f64,
    /// Mean of K over the tets that are not flipped.
    #[serde(deserialize_with = "null_is_infinite")]
    pub mean_k_unflipped: f64,
    /// K onto the ball, by [`measure_onto_ball`] alone; `None` where the image is not inscribed in a sphere about 0 and
    /// star-shaped about 0.
    pub ball_k: Option<BallDilatation>,
}

/// Measures the map that takes the domain's vertices to `image` (one position a vertex, same order).
///
/// The result does not depend on the number of threads: tets are measured in parallel and summed in their order.
///
/// # Panics
/// If `image` has fewer positions than the domain has vertices.
pub fn measure(domain: &Domain, image: &[Vec3]) -> Measured {
    let tets = domain.mesh().tets();
    let (dilatations, positive): (Vec<Dilatation>, Vec<bool>) = (0..tets.len() as u32)
        .into_par_iter()
        .map(|index| {
            let corners = tets[index as usize].map(|v| &image[v.index()]);
            let finite = corners.iter().all(|p| p.iter().all(|x| x.is_finite()));
            if !finite || orientation(corners) != Orientation::Positive {
                return (Dilatation::FLIPPED, false);
            }
            let dilatation = Dilatation::of(&domain.jacobian(TetId(index), image));
            (if dilatation.k().is_finite() { dilatation } else { Dilatation::FLIPPED }, true)
        })
        .unzip();
    let flipped: Vec<TetId> =
        (0..).map(TetId).zip(&positive).filter(|(_, positive)| !**positive).map(|(t, _)| t).collect();
    let summary = summarize(domain.volumes(), &dilatations, &positive);
    Measured { dilatations, flipped, summary }
}

/// Measures the map that is the piecewise-linear one to `image` after the warps of corners, by its elements: each tet has the largest
/// K_I and K_O of any of its points. Maxima are exact; means and quantiles count each element once, and weigh it by its part of
/// the tet's volume.
///
/// # Panics
/// If `image` has fewer positions than the domain has vertices.
pub fn measure_elements(domain: &Domain, elements: &Elements, image: &[Vec3]) -> Measured {
    let of_elements = measure(&elements.domain, image);
    let tets = domain.mesh().tets().len();
    let (first, further) = of_elements.dilatations.split_at(tets);
    let mut dilatations = first.to_vec();
    for (dilatation, owner) in further.iter().zip(&elements.owners[tets..]) {
        let largest = &mut dilatations[owner.index()];
        largest.inner = largest.inner.max(dilatation.inner);
        largest.outer = largest.outer.max(dilatation.outer);
    }
    // The elements of a tet are flipped together.
    let flipped: Vec<TetId> = of_elements.flipped.into_iter().filter(|tet| tet.index() < tets).collect();
    let summary = Summary { flipped: flipped.len(), ..of_elements.summary };
    Measured { dilatations, flipped, summary }
}

/// The figures of maps whose dilatations are known; `positive` tells the tets that are not flipped.
pub(crate) fn summarize(volumes: &[f64], dilatations: &[Dilatation], positive: &[bool]) -> Summary {
    let largest = |part: fn(&Dilatation) -> f64| dilatations.iter().map(part).fold(1.0, f64::max);
    let unflipped: Vec<Dilatation> =
        dilatations.iter().zip(positive).filter(|(_, positive)| **positive).map(|(d, _)| *d).collect();
    let of_unflipped = |value: f64| if unflipped.is_empty() { f64::INFINITY } else { value };
    let mut sorted: Vec<f64> = dilatations.iter().map(|d| d.k()).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let weighted: f64 = dilatations.iter().zip(volumes).map(|(d, volume)| d.k() * volume).sum();
    Summary {
        max_k: largest(|d| d.k()),
        mean_k: mean(dilatations),
        volume_mean_k: weighted / volumes.iter().sum::<f64>(),
        p50_k: nearest_rank(&sorted, 500),
        p90_k: nearest_rank(&sorted, 900),
        p99_k: nearest_rank(&sorted, 990),
        p999_k: nearest_rank(&sorted, 999),
        max_k_inner: largest(|d| d.inner),
        max_k_outer: largest(|d| d.outer),
        flipped: dilatations.len() - unflipped.len(),
        max_k_inner_unflipped: of_unflipped(unflipped.iter().map(|d| d.inner).fold(1.0, f64::max)),
        max_k_outer_unflipped: of_unflipped(unflipped.iter().map(|d| d.outer).fold(1.0, f64::max)),
        mean_k_unflipped: of_unflipped(mean(&unflipped)),
        ball_k: None,
    }
}

fn mean(dilatations: &[Dilatation]) -> f64 {
    dilatations.iter().map(|d| d.k()).sum::<f64>() / dilatations.len() as f64
}

/// The nearest-rank quantile: the least entry with at least `permille` thousandths of the entries at or below it.
fn nearest_rank(sorted: &[f64], permille: usize) -> f64 {
    // In integers, since 0.99 * 100 is not 99 in floating point.
    let rank = (permille * sorted.len()).div_ceil(1000).max(1);
    sorted[rank - 1]
}

impl Measured {
    /// The tets with `K >= max K * (1 - tolerance)`, in their order; the flipped ones if there are any.
    pub fn active(&self, tolerance: f64) -> Vec<TetId> {
        let threshold = self.summary.max_k * (1.0 - tolerance);
        (0..).map(TetId).zip(&self.dilatations).filter(|(_, d)| d.k() >= threshold).map(|(tet, _)| tet).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::fixtures::{cube, fan, split};

    fn cube_fan() -> Domain {
        Domain::new(fan(&cube(), Vec3::zeros())).unwrap()
    }

    #[test]
    fn a_linear_map_has_its_dilatation_everywhere() {
        let domain = Domain::new(split(cube_fan().mesh())).unwrap();
        let image: Vec<Vec3> = domain.mesh().points().iter().map(|p| Vec3::new(p.x, 4.0 * p.y, 2.0 * p.z)).collect();
        let s = measure(&domain, &image).summary;
        // Jacobians of tets with condition below 100: relative errors below 1e-12.
        for value in [s.max_k, s.mean_k, s.volume_mean_k, s.p50_k, s.p90_k, s.p99_k, s.p999_k, s.max_k_inner] {
            assert!((value - 8.0).abs() < 1e-11, "{s:?}");
        }
        assert!((s.max_k_outer - 8.0).abs() < 1e-11 && (s.mean_k_unflipped - 8.0).abs() < 1e-11 && s.flipped == 0);
    }

    #[test]
    fn flipped_flat_and_non_finite_tets_are_infinite_and_counted() {
        let domain = cube_fan();
        let move_centre = |to: Vec3| {
            let mut image = domain.mesh().points().to_vec();
            image[8] = to;
            measure(&domain, &image)
        };
        // On the plane of a face two tets are flat; beyond it they are flipped.
        for centre in [Vec3::x(), Vec3::x() * 1.5] {
            let measured = move_centre(centre);
            assert_eq!(measured.summary.flipped, 2);
            assert_eq!(measured.flipped, measured.active(1e-3));
            assert_eq!(measured.summary.max_k, f64::INFINITY);
            assert!(measured.summary.mean_k_unflipped.is_finite() && measured.summary.p50_k.is_finite());
        }
        let nothing = move_centre(Vec3::new(f64::NAN, 0.0, 0.0)).summary;
        assert_eq!((nothing.flipped, nothing.mean_k_unflipped), (12, f64::INFINITY));
    }

    #[test]
    fn a_tet_too_thin_for_its_computed_determinant_is_infinite_but_not_flipped() {
        let domain = cube_fan();
        let mut image = domain.mesh().points().to_vec();
        image[8] = Vec3::new(1.0 - f64::EPSILON / 2.0, 0.0, 0.0);
        image.iter_mut().for_each(|p| *p += Vec3::new(0.0, 0.0, 1e-3));
        let measured = measure(&domain, &image);
        assert_eq!(measured.summary.flipped, 0);
        assert!(measured.summary.max_k > 1e12);
    }

    #[test]
    fn quantiles_are_nearest_ranks() {
        let sorted: Vec<f64> = (1..=100).map(f64::from).collect();
        assert_eq!([500, 900, 990, 999].map(|p| nearest_rank(&sorted, p)), [50.0, 90.0, 99.0, 100.0]);
        assert_eq!(nearest_rank(&[7.0], 500), 7.0);
    }

    #[test]
    fn one_and_four_threads_agree_to_the_bit() {
        let domain = Domain::new(split(&split(cube_fan().mesh()))).unwrap();
        let image: Vec<Vec3> = domain.mesh().points().iter().map(|p| p + p.component_mul(p) * 0.1).collect();
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| measure(&domain, &image).summary)
        };
        assert_eq!(run(1), run(4));
    }
}

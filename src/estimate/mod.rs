//! The paper's numerical dilatation of a vertex map between meshes of tets or of hexahedra (paper §3.1-3.4).
//!
//! [`mod@crate::measure`] says what the piecewise-linear map has, exactly; these say what the smooth map behind it may have, by
//! averages over the cells at a vertex. They are neither upper nor lower bounds of it.

mod gradient;
mod lengths;
mod weights;

pub use gradient::gradient;
pub use weights::{Weights, measure};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::dilatation::Dilatation;
use crate::linalg::svd;
use crate::mesh::{Cells, Mat3, Vec3};

/// How the largest and the least stretch and the Jacobian determinant are estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema, clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Estimator {
    /// The paper's default: stretches from the gradient by random directions, the Jacobian from the volume ratio.
    Paper,
    /// Stretches from the gradient by its singular values, the Jacobian from the volume ratio.
    VolumeRatio,
    /// Stretches and Jacobian from the gradient (eq. 28-34).
    Gradient,
    /// Stretches from the lengths of edges (eq. 26), the Jacobian from the volume ratio.
    LengthRatio,
}

/// How many directions [`Estimator::Paper`] tries: the largest and least |A h| over so many miss the singular values by about
/// a thousandth of their spread. The paper does not say its number.
const DIRECTIONS: u64 = 1000;

/// What was estimated at one vertex or cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The estimated Jacobian determinant; negative where the map reverses orientation.
    pub jacobian: f64,
    /// ||df||, the largest stretch.
    pub largest: f64,
    /// l(df), the least.
    pub least: f64,
}

impl Estimate {
    /// K_I = |J| / l^3 and K_O = ||df||^3 / |J| (paper eq. 4, 5): below 1 where stretches and Jacobian, estimated apart, do
    /// not fit together; infinite where J or l is 0.
    pub fn dilatation(&self) -> Dilatation {
        let jacobian = self.jacobian.abs();
        if jacobian > 0.0 && self.least > 0.0 {
            Dilatation { inner: jacobian / self.least.powi(3), outer: self.largest.powi(3) / jacobian }
        } else {
            Dilatation::FLIPPED
        }
    }
}

/// The largest and the mean K of estimates.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct EstimateSummary {
    /// Largest K.
    pub max_k: f64,
    /// Mean of K, each vertex or cell counted once.
    pub mean_k: f64,
}

impl EstimateSummary {
    /// Of at least one estimate.
    pub fn of(estimates: &[Estimate]) -> Self {
        let dilatations = || estimates.iter().map(|estimate| estimate.dilatation().k());
        Self { max_k: dilatations().fold(0.0, f64::max), mean_k: dilatations().sum::<f64>() / estimates.len() as f64 }
    }
}

/// Estimates the map that takes the vertices of `cells` at `domain` to `image`, at each vertex that belongs to a cell; the
/// vertices come in their order, with their numbers.
///
/// # Panics
/// If there are fewer positions than vertices.
pub fn at_vertices(
    cells: Cells,
    domain: &[Vec3],
    image: &[Vec3],
    estimator: Estimator,
    weights: Weights,
) -> Vec<(u32, Estimate)> {
    let of_cells: Vec<CellValues> =
        (0..cells.len()).into_par_iter().map(|cell| CellValues::of(cells, cell, domain, image)).collect();
    let incidence = cells.incidence(domain.len());
    let at_vertex = |vertex: u32| {
        let around = &incidence[vertex as usize];
        let (mut gradient, mut jacobian, mut total) = (Mat3::zeros(), 0.0, 0.0);
        for &(cell, corner) in around {
            // Normalized weights (eq. 29); Table 1.
            let weight = weights.of(cells, cell as usize, usize::from(corner), domain);
            let values = &of_cells[cell as usize];
            gradient += weight * values.gradient;
            jacobian += weight * values.volume_ratio;
            total += weight;
        }
        let ratios = around
            .iter()
            .map(|&(cell, corner)| lengths::at_corner(cells, cell as usize, usize::from(corner), domain, image));
        estimate(estimator, gradient / total, jacobian / total, ratios.reduce(lengths::widen), u64::from(vertex))
    };
    (0..domain.len() as u32)
        .into_par_iter()
        .filter(|&vertex| !incidence[vertex as usize].is_empty())
        .map(|vertex| (vertex, at_vertex(vertex)))
        .collect()
}

/// Estimates the map on each cell. On a tet the gradient is the exact Jacobian of the piecewise-linear map.
///
/// # Panics
/// If there are fewer positions than vertices.
pub fn on_cells(cells: Cells, domain: &[Vec3], image: &[Vec3], estimator: Estimator) -> Vec<Estimate> {
    (0..cells.len())
        .into_par_iter()
        .map(|cell| {
            let values = CellValues::of(cells, cell, domain, image);
            let corners = 0..cells.corners_of_a_cell();
            let ratios = corners.map(|corner| lengths::at_corner(cells, cell, corner, domain, image));
            estimate(estimator, values.gradient, values.volume_ratio, ratios.reduce(lengths::widen), cell as u64)
        })
        .collect()
}

struct CellValues {
    gradient: Mat3,
    volume_ratio: f64,
}

impl CellValues {
    fn of(cells: Cells, cell: usize, domain: &[Vec3], image: &[Vec3]) -> Self {
        Self {
            gradient: gradient(cells, cell, domain, image),
            volume_ratio: measure(cells, cell, image) / measure(cells, cell, domain),
        }
    }
}

fn estimate(
    estimator: Estimator,
    gradient: Mat3,
    volume_ratio: f64,
    length_ratios: Option<[f64; 2]>,
    seed: u64,
) -> Estimate {
    let [largest, least] = match estimator {
        Estimator::Paper => gradient::random_stretches(&gradient, DIRECTIONS, seed),
        Estimator::VolumeRatio | Estimator::Gradient => {
            let values = svd(&gradient).values;
            [values[0], values[2].abs()]
        }
        Estimator::LengthRatio => length_ratios.expect("every corner has edges"),
    };
    let jacobian = if estimator == Estimator::Gradient { gradient.determinant() } else { volume_ratio };
    Estimate { jacobian, largest, least }
}

#[cfg(test)]
mod tests;

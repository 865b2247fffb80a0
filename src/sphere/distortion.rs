//! How far a map of a surface onto the sphere is from a similarity.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use crate::dilatation::null_is_infinite;
use crate::mesh::Vec3;
use crate::solid::Surface;

/// Distortion of the triangles of a surface under a map to flat image triangles.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SphereDistortion {
    /// Largest ratio s1 / s2 >= 1 of a triangle's singular values; infinite for a triangle without area on either side.
    #[serde(deserialize_with = "null_is_infinite")]
    pub max_stretch: f64,
    /// Its mean over the triangles.
    #[serde(deserialize_with = "null_is_infinite")]
    pub mean_stretch: f64,
    /// Its 99 % quantile.
    #[serde(deserialize_with = "null_is_infinite")]
    pub p99_stretch: f64,
    /// Standard deviation of ln(image area / area) over the triangles.
    #[serde(deserialize_with = "null_is_infinite")]
    pub log_area_deviation: f64,
    /// Least image area over area, both relative to the whole (the sphere's is 4 pi).
    #[serde(deserialize_with = "null_is_infinite")]
    pub least_area_ratio: f64,
}

impl SphereDistortion {
    /// Measures a map with these images of the surface's vertices.
    ///
    /// # Panics
    /// When there is not one image a vertex.
    pub fn of(surface: &Surface, image: &[Vec3]) -> Self {
        assert_eq!(image.len(), surface.points().len(), "one image a vertex");
        let (mut stretches, mut ratios) = (Vec::new(), Vec::new());
        let scale = surface.area() / (4.0 * PI);
        for triangle in surface.triangles() {
            let rest = triangle.map(|v| surface.points()[v.index()]);
            let moved = triangle.map(|v| image[v.index()]);
            stretches.push(stretch(&rest, &moved));
            ratios.push(scale * double_area(&moved) / double_area(&rest));
        }
        stretches.sort_by(f64::total_cmp);
        let count = stretches.len() as f64;
        let logs = || ratios.iter().map(|ratio| ratio.ln());
        let mean_log = logs().sum::<f64>() / count;
        Self {
            max_stretch: stretches[stretches.len() - 1],
            mean_stretch: stretches.iter().sum::<f64>() / count,
            p99_stretch: stretches[((0.99 * count).ceil() as usize).clamp(1, stretches.len()) - 1],
            log_area_deviation: (logs().map(|log| (log - mean_log).powi(2)).sum::<f64>() / count).sqrt(),
            least_area_ratio: ratios.iter().copied().fold(f64::INFINITY, f64::min),
        }
    }
}

fn double_area([a, b, c]: &[Vec3; 3]) -> f64 {
    (b - a).cross(&(c - a)).norm()
}

/// s1 / s2 of the linear map between two triangles, from e = (s1 / s2 + s2 / s1) / 2.
fn stretch(rest: &[Vec3; 3], image: &[Vec3; 3]) -> f64 {
    let areas = double_area(rest) * double_area(image);
    let energy: f64 = (0..3)
        .map(|i| {
            let [at, next, last] = [0, 1, 2].map(|j| (i + j) % 3);
            (rest[next] - rest[at]).dot(&(rest[last] - rest[at])) * (image[last] - image[next]).norm_squared()
        })
        .sum();
    let e = energy / (2.0 * areas);
    if areas > 0.0 && e.is_finite() { e.max(1.0) + (e * e - 1.0).max(0.0).sqrt() } else { f64::INFINITY }
}

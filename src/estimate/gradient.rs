//! The gradient of a vertex map on a cell (paper eq. 28, 31-33), and its stretches.

use std::f64::consts::PI;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};

use crate::domain::edge_matrix;
use crate::mesh::{Cells, Mat3, Vec3};

/// The gradient on one cell, row i that of coordinate i of the image.
///
/// On a tet the Jacobian of the linear map (eq. 28, as a quotient of edge matrices). On a hexahedron the quotient of the
/// differences between the mean positions of opposite faces, in the image and in the domain: on a parallelepiped that is
/// eq. 31, 32 and on a box eq. 33. A linear map has its exact gradient on every cell, which eq. 31 itself gives on
/// parallelepipeds only. Infinite or NaN entries on cells without volume.
pub fn gradient(cells: Cells, cell: usize, domain: &[Vec3], image: &[Vec3]) -> Mat3 {
    let of = |points: &[Vec3]| match cells {
        Cells::Tets(tets) => edge_matrix(Cells::tet(&tets[cell], points)),
        Cells::Hexahedra(cells) => {
            let corners = Cells::hexahedron(&cells[cell], points);
            Mat3::from_columns(&[0, 1, 2].map(|axis| {
                let signed = |i: usize| if i >> axis & 1 == 1 { corners[i] } else { -corners[i] };
                0.25 * (0..8).map(signed).sum::<Vec3>()
            }))
        }
    };
    of(image) * of(domain).try_inverse().unwrap_or_else(|| Mat3::from_element(f64::INFINITY))
}

/// The largest and the least |A h| over random unit vectors h (paper §3.4): the first at most the largest singular value, the
/// second at least the smallest.
pub(super) fn random_stretches(gradient: &Mat3, directions: u64, seed: u64) -> [f64; 2] {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    // 53 random bits, the precision of f64.
    let mut uniform = || (random.next_u64() >> 11) as f64 * 2f64.powi(-53);
    let (mut largest, mut least) = (0.0, f64::INFINITY);
    for _ in 0..directions {
        // Archimedes: the height is uniform.
        let z = 2.0 * uniform() - 1.0;
        let (sine, cosine) = (2.0 * PI * uniform()).sin_cos();
        let across = (1.0 - z * z).sqrt();
        let stretch = (gradient * Vec3::new(across * cosine, across * sine, z)).norm();
        largest = f64::max(largest, stretch);
        least = f64::min(least, stretch);
    }
    [largest, least]
}

//! Seeded random solids that are star-shaped about the origin by construction: a positive radius in each direction.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};

use super::polyhedron::Polyhedron;
use super::sphere::{self, SphereMesh};
use crate::mesh::{PolygonSoup, Vec3, VertexId};

/// Radius 1 + amplitude S / max |S|, S a random combination of the real spherical harmonics of the degrees 1 to `degree`.
///
/// The coefficients of degree l are uniform in (-1, 1) / l, so that the surface is smooth at the scale of the mesh.
pub(super) fn smooth(seed: u64, degree: u32, amplitude: f64, resolution: u32) -> PolygonSoup {
    let SphereMesh { directions, triangles } = sphere::subdivided(resolution);
    let mut random = Uniform::new(seed);
    let count = ((degree + 1) * (degree + 1)) as usize;
    let coefficients: Vec<f64> =
        (1..count).map(|index| random.next() / f64::from((index as f64).sqrt().floor() as u32)).collect();
    let sums: Vec<f64> = directions
        .iter()
        .map(|direction| real_harmonics(degree, direction)[1..].iter().zip(&coefficients).map(|(y, c)| y * c).sum())
        .collect();
    let largest = sums.iter().fold(0.0, |largest: f64, sum| largest.max(sum.abs()));
    let points = directions.iter().zip(&sums).map(|(u, sum)| u * (1.0 + amplitude * sum / largest)).collect();
    PolygonSoup::new(points, triangles.into_iter().map(|t| t.map(VertexId).to_vec()).collect())
}

/// Flat triangles over a sphere triangulation, the radius of each vertex uniform in 1 +- amplitude.
pub(super) fn polyhedral(seed: u64, amplitude: f64, resolution: u32) -> Polyhedron {
    let SphereMesh { directions, triangles } = sphere::subdivided(resolution);
    let mut random = Uniform::new(seed);
    let points = directions.iter().map(|u| u * (1.0 + amplitude * random.next())).collect();
    Polyhedron { points, faces: triangles.into_iter().map(|t| t.to_vec()).collect() }
}

/// Uniform numbers in [-1, 1) from ChaCha8, whose stream is fixed by its definition: a seed means the same solid in
/// every version.
struct Uniform(ChaCha8Rng);

impl Uniform {
    fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    fn next(&mut self) -> f64 {
        // 53 random bits, the precision of f64.
        (self.0.next_u64() >> 11) as f64 * 2f64.powi(-52) - 1.0
    }
}

/// The real, orthonormal spherical harmonics Y_lm at a direction, l = 0 ... degree, m = -l ... l, at index l (l + 1) + m.
///
/// By the recurrences of the associated Legendre functions over sin^m, which leave x and y as polynomials: no pole.
fn real_harmonics(degree: u32, direction: &Vec3) -> Vec<f64> {
    let degree = degree as usize;
    let z = direction.z;
    let mut values = vec![0.0; (degree + 1) * (degree + 1)];
    // (cosine, sine) = real and imaginary part of (x + i y)^m.
    let (mut cosine, mut sine) = (1.0, 0.0);
    // The Legendre function of l = m over sin^m, with the normalization sqrt((2l + 1) / 4 pi (l - m)! / (l + m)!).
    let mut diagonal = (0.25 / std::f64::consts::PI).sqrt();
    for m in 0..=degree {
        if m > 0 {
            (cosine, sine) = (cosine * direction.x - sine * direction.y, sine * direction.x + cosine * direction.y);
            diagonal *= ((2 * m + 1) as f64 / (2 * m) as f64).sqrt();
        }
        let (mut previous, mut current) = (0.0, diagonal);
        let factor = if m == 0 { 1.0 } else { std::f64::consts::SQRT_2 };
        for l in m..=degree {
            values[l * (l + 1) + m] = factor * current * cosine;
            if m > 0 {
                values[l * (l + 1) - m] = factor * current * sine;
            }
            let scale = |l: usize| (((4 * l * l - 1) as f64) / ((l * l - m * m) as f64)).sqrt();
            let (next, last) = (scale(l + 1), if l > m { scale(l) } else { f64::INFINITY });
            (previous, current) = (current, next * (z * current - previous / last));
        }
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn harmonics_obey_the_addition_theorem() {
        // sum over m of Y_lm(u) Y_lm(v) = (2l + 1) / 4 pi P_l(u.v).
        let (u, v) = (Vec3::new(0.3, -0.5, 0.8).normalize(), Vec3::new(-0.6, 0.1, 0.2).normalize());
        let (at_u, at_v) = (real_harmonics(4, &u), real_harmonics(4, &v));
        let x = u.dot(&v);
        let legendre = [1.0, x, (3.0 * x * x - 1.0) / 2.0, (5.0 * x * x - 3.0) * x / 2.0];
        for (l, legendre) in legendre.iter().enumerate() {
            let sum: f64 = (l * l..(l + 1) * (l + 1)).map(|i| at_u[i] * at_v[i]).sum();
            let expected = (2 * l + 1) as f64 / (4.0 * std::f64::consts::PI) * legendre;
            assert!((sum - expected).abs() < 1e-14, "degree {l}: {sum} instead of {expected}");
        }
    }

    #[test]
    fn seeds_keep_their_meaning() {
        let mut random = Uniform::new(7);
        let first = random.next();
        assert_eq!(first, Uniform::new(7).next());
        assert_ne!(first, Uniform::new(8).next());
        assert!((0..1000).all(|_| (-1.0..1.0).contains(&random.next())));
    }
}

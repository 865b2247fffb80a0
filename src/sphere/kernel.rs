//! A point that sees a spherical polygon from within.

use nalgebra::Vector2;

use super::relax::tangents;
use crate::mesh::{Orientation, Vec3, orientation};

/// A point of the sphere from which the polygon `ring` (unit vectors, counter-clockwise seen from outside) is seen from within
/// by exact predicate.
///
/// The kernel of a ring whose triangles `(ring[0], ring[i], ring[i + 1])` all face outward is never empty: it holds the points
/// near `ring[0]` to the left of its two edges there. Taken is the middle of the kernel if the ring lies well inside of the
/// hemisphere about `ring[0]`, else a point on the bisector there. `None` if rounding hides them all.
pub(super) fn kernel_point(ring: &[Vec3]) -> Option<Vec3> {
    middle(ring).filter(|x| sees(x, ring)).or_else(|| {
        let lengths = std::iter::successors(Some(0.5), |length| Some(0.5 * length)).take(50);
        let direction = bisector(ring);
        lengths.map(|length| (ring[0] + length * direction).normalize()).find(|x| sees(x, ring))
    })
}

fn sees(x: &Vec3, ring: &[Vec3]) -> bool {
    let next = ring.iter().cycle().skip(1);
    x.iter().all(|c| c.is_finite())
        && ring.iter().zip(next).all(|(a, b)| orientation([&Vec3::zeros(), x, a, b]) == Orientation::Positive)
}

/// The unit tangent at `ring[0]` halfway from its edge to `ring[1]`, counter-clockwise, to that to the last of the ring.
fn bisector(ring: &[Vec3]) -> Vec3 {
    let (first, second) = tangents(&ring[0]);
    let angle = |to: &Vec3| (to - ring[0]).dot(&second).atan2((to - ring[0]).dot(&first));
    let start = angle(&ring[1]);
    let turn = (angle(&ring[ring.len() - 1]) - start).rem_euclid(std::f64::consts::TAU);
    let (sine, cosine) = (start + 0.5 * turn).sin_cos();
    first * cosine + second * sine
}

/// The mean of the corners of the kernel, cut out edge by edge in the gnomonic plane at `ring[0]`, where great circles are
/// straight; `None` if the ring reaches too far around the sphere for that.
fn middle(ring: &[Vec3]) -> Option<Vec3> {
    /// Least cosine between `ring[0]` and the others.
    const LEAST: f64 = 0.2;
    let (first, second) = tangents(&ring[0]);
    let mut corners = Vec::with_capacity(ring.len());
    for point in ring {
        let offset = point - ring[0];
        let height = 1.0 + offset.dot(&ring[0]);
        if height < LEAST {
            return None;
        }
        corners.push(Vector2::new(offset.dot(&first), offset.dot(&second)) / height);
    }
    let size = corners.iter().map(|corner| corner.norm()).fold(0.0, f64::max);
    corners.iter_mut().for_each(|corner| *corner /= size);
    let mut kernel: Vec<Vector2<f64>> =
        [(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)].map(|(x, y)| Vector2::new(x, y)).into();
    for (i, a) in corners.iter().enumerate() {
        let edge = corners[(i + 1) % corners.len()] - a;
        let left = |p: &Vector2<f64>| edge.perp(&(p - a));
        let mut rest = Vec::with_capacity(kernel.len() + 1);
        for (j, p) in kernel.iter().enumerate() {
            let q = kernel[(j + 1) % kernel.len()];
            let (of_p, of_q) = (left(p), left(&q));
            if of_p >= 0.0 {
                rest.push(*p);
            }
            if of_p * of_q < 0.0 {
                rest.push(p + (q - p) * (of_p / (of_p - of_q)));
            }
        }
        kernel = rest;
        if kernel.len() < 3 {
            return None;
        }
    }
    let mean = kernel.iter().sum::<Vector2<f64>>() * (size / kernel.len() as f64);
    Some((ring[0] + first * mean.x + second * mean.y).normalize())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_is_found_where_the_ring_is_not_convex_or_reaches_far() {
        // A quarter turn about the north pole from x to y, with the pole first; then the same with a notch that leaves a
        // narrow kernel; then three corners of a regular tetrahedron, beyond the hemisphere.
        let unit = |x: f64, y: f64, z: f64| Vec3::new(x, y, z).normalize();
        let rings = [
            vec![Vec3::z(), unit(0.5, 0.0, 1.0), unit(0.5, 0.5, 1.0), unit(0.0, 0.5, 1.0)],
            vec![Vec3::z(), unit(0.5, 0.0, 1.0), unit(0.1, 0.1, 1.0), unit(0.0, 0.5, 1.0)],
            vec![unit(1.0, 1.0, 1.0), unit(-1.0, 1.0, -1.0), unit(-1.0, -1.0, 1.0)],
        ];
        for ring in rings {
            let point = kernel_point(&ring).expect("the triangles at the first corner face outward");
            assert!(sees(&point, &ring) && (point.norm() - 1.0).abs() < 1e-15);
        }
        // Seen clockwise, nothing lies inside.
        assert_eq!(kernel_point(&[Vec3::z(), unit(0.0, 0.5, 1.0), unit(0.5, 0.5, 1.0), unit(0.5, 0.0, 1.0)]), None);
    }
}

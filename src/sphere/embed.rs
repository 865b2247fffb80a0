//! From a tetrahedron on the sphere to the whole surface, vertex by vertex.

use std::f64::consts::PI;

use super::SphereSettings;
use super::kernel::kernel_point;
use super::relax::Relaxation;
use super::rings::Rings;
use super::simplify::{Collapse, simplify};
use crate::mesh::Vec3;
use crate::solid::Surface;

/// Growth of the number of vertices after which all of them are relaxed.
const GROWTH: f64 = 1.15;
/// Sweeps over all vertices then, and at the end.
const SWEEPS: usize = 2;
const LAST_SWEEPS: usize = 20;
/// Newton steps of a new vertex before those of its neighbours.
const FIRST_STEPS: usize = 4;
/// How often the neighbourhood of a ring without a place is relaxed before it is given up.
const ATTEMPTS: usize = 50;

/// Positions on the unit sphere with every triangle facing outward, of a surface of genus 0; else the vertex for which there was
/// no place.
pub(super) fn embed(surface: &Surface, settings: &SphereSettings) -> Result<Vec<Vec3>, usize> {
    // Nothing depends on place and size but underflow.
    let (low, high) = surface.bounding_box();
    let size = (high - low).amax();
    let points: Vec<Vec3> = surface.points().iter().map(|p| (p - low) / size).collect();
    let mut rings = Rings::of(surface);
    let collapses = simplify(&points, &mut rings, 4).ok_or(0_usize)?;
    let mut image = vec![Vec3::zeros(); points.len()];
    let mut placed = start(&rings, &mut image);
    let mut relaxation = Relaxation::new(&points, 4.0 * PI / (surface.area() / (size * size)), settings);
    let mut next_sweep = placed.len() as f64 * GROWTH;
    for Collapse { vertex, ring } in collapses.into_iter().rev() {
        image[vertex as usize] = place(&mut relaxation, &rings, &mut image, &ring).ok_or(vertex as usize)?;
        rings.split(vertex, &ring);
        placed.push(vertex);
        relaxation.relax(&rings, &mut image, vertex, FIRST_STEPS);
        for &w in ring.iter().chain([&vertex]) {
            relaxation.relax(&rings, &mut image, w, 1);
        }
        if placed.len() as f64 >= next_sweep {
            next_sweep = placed.len() as f64 * GROWTH;
            (0..SWEEPS).for_each(|_| placed.iter().for_each(|&v| relaxation.relax(&rings, &mut image, v, 1)));
        }
    }
    (0..LAST_SWEEPS).for_each(|_| placed.iter().for_each(|&v| relaxation.relax(&rings, &mut image, v, 1)));
    Ok(image)
}

/// Puts the four vertices that are left on the sphere as a regular tetrahedron; returns them.
fn start(rings: &Rings, image: &mut [Vec3]) -> Vec<u32> {
    let left: Vec<u32> = (0..image.len() as u32).filter(|&v| !rings.of_vertex(v).is_empty()).collect();
    let (top, below) = (left[0], rings.of_vertex(left[0]));
    // Seen from outside, the ring runs counter-clockwise about the first vertex.
    let corners = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)];
    let signs = [(corners[0], 1.0), (corners[1], -1.0), (corners[2], 1.0), (corners[3], -1.0)];
    for (&v, ((x, y), z)) in [top].iter().chain(below).zip(signs) {
        image[v as usize] = Vec3::new(x, y, z) / 3.0_f64.sqrt();
    }
    left
}

/// A point in the kernel of a ring; where rounding hides it, the neighbourhood is relaxed first.
fn place(relaxation: &mut Relaxation<'_>, rings: &Rings, image: &mut [Vec3], ring: &[u32]) -> Option<Vec3> {
    for _ in 0..ATTEMPTS {
        let corners: Vec<Vec3> = ring.iter().map(|&v| image[v as usize]).collect();
        let point = kernel_point(&corners);
        if point.is_some() {
            return point;
        }
        let around: Vec<u32> = ring.iter().flat_map(|&v| rings.of_vertex(v)).chain(ring).copied().collect();
        around.into_iter().for_each(|v| relaxation.relax(rings, image, v, 3));
    }
    None
}

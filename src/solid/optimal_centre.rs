//! The centre for which the radial map has the least max K.

use std::collections::HashSet;

use nlopt::{Algorithm, Nlopt, Target};

use super::radial::FacePlane;
use super::{StarKernel, Surface};
use crate::mesh::Vec3;

/// Rounds of the outer loop; 2 to 7 sufficed on forty solids, some of 50,000 triangles.
const MAX_ROUNDS: usize = 100;
/// Stop when a round lowers the largest tan^2 by less, relatively, and every corner that matters is in the program.
const LEAST_GAIN: f64 = 1e-10;
/// Corners that a round adds to the program, those of the largest tan^2.
const CORNERS_A_ROUND: usize = 12;
/// Iterations of SLSQP in a round; a program of four variables needs about ten.
const MAX_EVALUATIONS: u32 = 100;

/// Minimizes [`super::radial_max_dilatation`] (which grows with the same angle for every exponent) over the kernel, from the centre of its largest ball.
///
/// K grows with t = tan(theta), and for a corner of a triangle t(centre) is the convex distance from the corner in the
/// triangle's plane over the affine distance of the plane: quasi-convex, hence so is the max over all corners, and there
/// are no local minima to be caught in. The minimum of a max is a kink: BOBYQA and Sbplx stall at it (4 % above the
/// minimum for a random polyhedron), so the problem is put as "least tau with t_i^2 <= tau for all corners i" and solved
/// by SLSQP, by outer approximation: only the corners that were the worst so far are in the program. Each step stays in a
/// box inside the largest ball about the current centre in the kernel, so that no plane is ever crossed.
pub(super) fn optimal_centre(surface: &Surface, kernel: &StarKernel) -> Vec3 {
    let planes = FacePlane::all(surface);
    let mut best = kernel.centre;
    let mut least = largest(&planes, &best);
    if !least.is_finite() || least == 0.0 {
        return best;
    }
    let mut chosen = Vec::new();
    let mut known = HashSet::new();
    choose_worst(&planes, &best, &mut known, &mut chosen);
    let mut trust = 1.0;
    for _ in 0..MAX_ROUNDS {
        let clearance = planes.iter().map(|plane| plane.distance(&best)).fold(f64::INFINITY, f64::min);
        let candidate = solve(&planes, &chosen, &best, least, 0.5 * trust * clearance);
        let value = largest(&planes, &candidate);
        let gain = 1.0 - value / least;
        let grew = choose_worst(&planes, &candidate, &mut known, &mut chosen);
        if gain > 0.0 {
            (best, least) = (candidate, value);
        }
        if gain < LEAST_GAIN && !grew {
            // The program holds all that matters here: a failure means that the box is too large for the solver.
            if gain >= 0.0 || trust < 1e-6 {
                break;
            }
            trust /= 4.0;
        }
    }
    best
}

impl FacePlane {
    /// The corner farthest from the foot of the perpendicular from the centre.
    fn worst_corner(&self, centre: &Vec3) -> usize {
        let reach = |&corner: &usize| (self.corners[corner] - centre).norm_squared();
        (0..3).max_by(|a, b| reach(a).total_cmp(&reach(b))).expect("there are three corners")
    }

    /// tan^2 of the angle at one corner, and its gradient with respect to the centre.
    ///
    /// With v the ray and h = n.v the distance of the plane: |v|^2/h^2 - 1, its gradient 2 (|v|^2 n / h - v) / h^2.
    fn squared_tangent_at(&self, corner: usize, centre: &Vec3) -> (f64, Vec3) {
        let ray = self.corners[corner] - centre;
        let distance = self.normal.dot(&ray);
        let square = ray.norm_squared();
        let gradient = 2.0 * (self.normal * (square / distance) - ray) / (distance * distance);
        (square / (distance * distance) - 1.0, gradient)
    }
}

fn largest(planes: &[FacePlane], centre: &Vec3) -> f64 {
    planes.iter().map(|plane| plane.squared_tangent(centre)).fold(0.0, f64::max)
}

/// Adds the corners that are worst at a centre to the program; returns whether there was a new one.
fn choose_worst(
    planes: &[FacePlane],
    centre: &Vec3,
    known: &mut HashSet<[i64; 6]>,
    chosen: &mut Vec<(usize, usize)>,
) -> bool {
    let mut order: Vec<(f64, usize)> =
        planes.iter().enumerate().map(|(index, plane)| (plane.squared_tangent(centre), index)).collect();
    order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let before = chosen.len();
    for (_, index) in order.into_iter().take(4 * CORNERS_A_ROUND) {
        let plane = &planes[index];
        let corner = plane.worst_corner(centre);
        // Coplanar triangles share corners; twice the same constraint would make SLSQP's least squares singular.
        let normal = plane.normal.map(|x| (x * 1e9).round() as i64);
        let at = plane.corners[corner].map(|x| x.to_bits() as i64);
        if known.insert([normal.x, normal.y, normal.z, at.x, at.y, at.z]) {
            chosen.push((index, corner));
        }
        if chosen.len() - before == CORNERS_A_ROUND {
            break;
        }
    }
    chosen.len() > before
}

/// The centre in the box |x - start| <= half for which the largest tan^2 over the chosen corners is least.
fn solve(planes: &[FacePlane], chosen: &[(usize, usize)], start: &Vec3, least: f64, half: f64) -> Vec3 {
    // Variables of order 1: the move in units of the box, and tau in units of the current largest tan^2.
    let centre = |x: &[f64]| start + half * Vec3::from_column_slice(&x[..3]);
    let objective = |x: &[f64], gradient: Option<&mut [f64]>, _: &mut ()| {
        if let Some(gradient) = gradient {
            gradient.copy_from_slice(&[0.0, 0.0, 0.0, 1.0]);
        }
        x[3]
    };
    let constraints = |result: &mut [f64], x: &[f64], gradient: Option<&mut [f64]>, _: &mut ()| {
        let centre = centre(x);
        let tangents = || chosen.iter().map(|&(plane, corner)| planes[plane].squared_tangent_at(corner, &centre));
        for (value, (tangent, _)) in result.iter_mut().zip(tangents()) {
            *value = tangent / least - x[3];
        }
        for (row, (_, slope)) in gradient.into_iter().flat_map(|gradient| gradient.chunks_exact_mut(4)).zip(tangents())
        {
            row[..3].copy_from_slice((slope * (half / least)).as_slice());
            row[3] = -1.0;
        }
    };
    let mut solver = Nlopt::new(Algorithm::Slsqp, 4, objective, Target::Minimize, ());
    let set = [
        solver.set_lower_bounds(&[-1.0, -1.0, -1.0, 0.0]),
        solver.set_upper_bounds(&[1.0, 1.0, 1.0, f64::INFINITY]),
        solver.add_inequality_mconstraint(chosen.len(), constraints, (), &vec![1e-12; chosen.len()]),
        solver.set_xtol_abs1(1e-12),
        solver.set_maxeval(MAX_EVALUATIONS),
    ];
    let mut x = [0.0, 0.0, 0.0, 1.0];
    // Whatever makes the search stop: its last point counts by the value that the caller finds there.
    if set.iter().all(Result::is_ok) {
        let _ = solver.optimize(&mut x);
    }
    let moved = centre(&x);
    if moved.iter().all(|x| x.is_finite()) { moved } else { *start }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solid::{CentreChoice, Solid, radial_max_dilatation, star_centre};

    /// The least max K over a grid of centres, refined around its best point five times.
    fn grid_search(surface: &Surface) -> f64 {
        let (low, high) = surface.bounding_box();
        let (mut centre, mut half) = ((low + high) / 2.0, (high - low) / 2.0);
        let mut least = f64::INFINITY;
        for _ in 0..6 {
            let middle = centre;
            for index in 0..21 * 21 * 21 {
                let step = |divisor: i32| f64::from(index / divisor % 21 - 10) / 10.0;
                let candidate = middle + half.component_mul(&Vec3::new(step(1), step(21), step(441)));
                let dilatation = radial_max_dilatation(surface, &candidate, 1.0);
                if dilatation < least {
                    (least, centre) = (dilatation, candidate);
                }
            }
            half /= 4.0;
        }
        least
    }

    #[test]
    fn no_worse_than_a_grid_search() {
        let solids = [
            Solid::Pyramid { sides: 4, height: 1.0 },
            Solid::Pyramid { sides: 4, height: 0.5f64.sqrt() },
            Solid::Pyramid { sides: 3, height: 3.0 },
            Solid::Prism { sides: 3, height: 1.0 },
            Solid::Prism { sides: 5, height: 0.4 },
            Solid::PolyhedralStar { seed: 3, amplitude: 0.3, resolution: 1 },
            Solid::PolyhedralStar { seed: 10, amplitude: 0.2, resolution: 1 },
            Solid::PolyhedralStar { seed: 7, amplitude: 0.1, resolution: 2 },
        ];
        for solid in solids {
            let surface = solid.surface().unwrap();
            let centre = star_centre(&surface, &CentreChoice::Optimize).unwrap();
            let found = radial_max_dilatation(&surface, &centre.position, 1.0);
            let grid = grid_search(&surface);
            assert!(found < grid, "{solid:?}: {found} against {grid} on the grid");
        }
    }

    #[test]
    fn symmetry_puts_the_centre_of_the_cube_in_its_middle() {
        let centre = star_centre(&Solid::Cube.surface().unwrap(), &CentreChoice::Optimize).unwrap();
        assert!(centre.position.norm() < 1e-6, "{centre:?}");
    }
}

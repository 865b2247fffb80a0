//! Newton steps of one vertex on the sphere that lower the distortion of the triangles about it and never flip one.

use nalgebra::{Matrix2, Vector2};

use super::SphereSettings;
use super::rings::Rings;
use crate::mesh::{Orientation, Vec3, orientation};

/// Least sine of a rest triangle's angles that is told from 0: flatter ones have a finite energy instead of none.
const LEAST_SINE: f64 = 1e-4;
/// Longest step tried, in radii of the sphere.
const LONGEST_STEP: f64 = 0.5;
/// Halvings of a step before a vertex is left where it is.
const HALVINGS: usize = 30;
/// Sufficient decrease of the Armijo rule.
const ARMIJO: f64 = 1e-4;
/// Relative fall of the energy below which no second step is tried.
const SETTLED: f64 = 1e-6;

/// A triangle about the vertex at x: the energy is, with the rest triangle's cotangents c and double area A times the ratio
/// 4 pi / (area of the surface),
///
/// ```text
/// MIPS + shrinkage (A / D)^(1/2) + area (A / D + D / A) / 2,   MIPS = sum c |opposite edge|^2 / (2 D),   D = det(x, a, b)
/// ```
///
/// MIPS is (s1 / s2 + s2 / s1) / 2 of the map of the triangle up to the square of its size (Hormann & Greiner 2000, "MIPS: an
/// efficient global parametrization method"), >= 1 and infinite for D -> 0. D is positive exactly where the triangle faces
/// outward.
struct Corner {
    a: Vec3,
    b: Vec3,
    /// Of the angles at x, a and b.
    cotangents: [f64; 3],
    area: f64,
}

/// A surface's rest triangles, what its vertices' energy weighs, and a workspace.
pub(super) struct Relaxation<'a> {
    points: &'a [Vec3],
    area_scale: f64,
    settings: &'a SphereSettings,
    corners: Vec<Corner>,
}

impl<'a> Relaxation<'a> {
    /// `area_scale` is the sphere's area over that of the surface.
    pub fn new(points: &'a [Vec3], area_scale: f64, settings: &'a SphereSettings) -> Self {
        Self { points, area_scale, settings, corners: Vec::new() }
    }

    /// At most `steps` Newton steps of a vertex, whose triangles all face outward and go on to do so.
    pub fn relax(&mut self, rings: &Rings, image: &mut [Vec3], vertex: u32, steps: usize) {
        self.gather(rings, image, vertex);
        let mut x = image[vertex as usize];
        for _ in 0..steps {
            let Some(step) = self.newton_step(&x) else { break };
            x = step.position;
            if step.fall < SETTLED {
                break;
            }
        }
        image[vertex as usize] = x;
    }

    fn gather(&mut self, rings: &Rings, image: &[Vec3], vertex: u32) {
        self.corners.clear();
        let ring = rings.of_vertex(vertex);
        let x = self.points[vertex as usize];
        for (i, &a) in ring.iter().enumerate() {
            let b = ring[(i + 1) % ring.len()];
            let [to_a, to_b] = [a, b].map(|v| self.points[v as usize] - x);
            let opposite = to_b - to_a;
            let longest = to_a.norm_squared().max(to_b.norm_squared()).max(opposite.norm_squared());
            let double_area = to_a.cross(&to_b).norm();
            let divisor = double_area.max(LEAST_SINE * longest).max(f64::MIN_POSITIVE);
            let cotangents = [to_a.dot(&to_b), -to_a.dot(&opposite), to_b.dot(&opposite)].map(|dot| dot / divisor);
            let area = (self.area_scale * double_area).max(f64::MIN_POSITIVE);
            self.corners.push(Corner { a: image[a as usize], b: image[b as usize], cotangents, area });
        }
    }

    /// The energy at a point of the sphere; `None` where a triangle does not face outward.
    fn value(&self, x: &Vec3) -> Option<f64> {
        let mut sum = 0.0;
        for corner in &self.corners {
            let (to_a, to_b) = (corner.a - x, corner.b - x);
            // The plain triple product would cancel.
            let determinant = x.dot(&to_a.cross(&to_b));
            if determinant.is_nan() || determinant <= 0.0 {
                return None;
            }
            let [at_x, at_a, at_b] = corner.cotangents;
            let opposite = corner.b - corner.a;
            let dirichlet = at_x * opposite.norm_squared() + at_a * to_b.norm_squared() + at_b * to_a.norm_squared();
            let ratio = corner.area / determinant;
            sum += dirichlet.max(f64::MIN_POSITIVE) / (2.0 * determinant)
                + self.settings.shrinkage_weight * ratio.sqrt()
                + 0.5 * self.settings.area_weight * (ratio + 1.0 / ratio);
        }
        sum.is_finite().then_some(sum)
    }

    /// One step by Armijo's rule along Newton's direction with the Hessian's eigenvalues made positive.
    fn newton_step(&self, x: &Vec3) -> Option<Step> {
        let (first, second) = tangents(x);
        let plane = |v: &Vec3| Vector2::new(v.dot(&first), v.dot(&second));
        let (mut value, mut gradient, mut hessian) = (0.0, Vector2::zeros(), Matrix2::zeros());
        for corner in &self.corners {
            let (to_a, to_b) = (corner.a - x, corner.b - x);
            let determinant = x.dot(&to_a.cross(&to_b));
            let [at_x, at_a, at_b] = corner.cotangents;
            let opposite = to_b - to_a;
            let dirichlet = at_x * opposite.norm_squared() + at_a * to_b.norm_squared() + at_b * to_a.norm_squared();
            let dirichlet = dirichlet.max(f64::MIN_POSITIVE);
            // Logarithmic derivatives; the determinant's gradient a x b is the sum below, without cancellation along the
            // tangents, and its product with x is the determinant: so its radial part is 1.
            let of_dirichlet = -2.0 * (at_a * to_b + at_b * to_a) / dirichlet;
            let of_determinant = (x.cross(&opposite) + to_a.cross(&to_b)) / determinant;
            let radial = of_dirichlet.dot(x) - 1.0;
            let curvature = 2.0 * (at_a + at_b) / dirichlet;
            let (n, d) = (plane(&of_dirichlet), plane(&of_determinant));
            let mips = dirichlet / (2.0 * determinant);
            let slope = n - d;
            value += mips;
            gradient += mips * slope;
            // On the sphere the Hessian is that of space less the radial slope.
            hessian += mips
                * (Matrix2::identity() * (curvature - radial) - n * n.transpose()
                    + d * d.transpose()
                    + slope * slope.transpose());
            let ratio = corner.area / determinant;
            for (weight, power) in [
                (self.settings.shrinkage_weight, 0.5),
                (0.5 * self.settings.area_weight, 1.0),
                (0.5 * self.settings.area_weight, -1.0),
            ] {
                if weight > 0.0 {
                    let term = weight * ratio.powf(power);
                    value += term;
                    gradient -= power * term * d;
                    hessian += power * term * ((power + 1.0) * d * d.transpose() + Matrix2::identity());
                }
            }
        }
        let direction = descent(&hessian, &gradient);
        let slope = gradient.dot(&direction);
        let mut length = (LONGEST_STEP / direction.norm()).min(1.0);
        for _ in 0..HALVINGS {
            let tangent = first * (length * direction.x) + second * (length * direction.y);
            let position = (x + tangent).normalize();
            if let Some(trial) = self.value(&position)
                && trial < value
                && trial <= value + ARMIJO * length * slope
                && self.faces_outward(&position)
            {
                return Some(Step { position, fall: (value - trial) / value });
            }
            length *= 0.5;
        }
        None
    }

    /// By exact predicate, so that rounding never lets a flipped triangle pass.
    fn faces_outward(&self, x: &Vec3) -> bool {
        let centre = Vec3::zeros();
        self.corners.iter().all(|corner| orientation([&centre, x, &corner.a, &corner.b]) == Orientation::Positive)
    }
}

struct Step {
    position: Vec3,
    /// Relative fall of the energy.
    fall: f64,
}

/// The Newton direction, negative curvature counted as positive.
fn descent(hessian: &Matrix2<f64>, gradient: &Vector2<f64>) -> Vector2<f64> {
    let eigen = hessian.symmetric_eigen();
    let floor = 1e-6 * eigen.eigenvalues.amax();
    let along = eigen.eigenvectors.transpose() * gradient;
    -(eigen.eigenvectors * along.zip_map(&eigen.eigenvalues, |slope, curvature| slope / curvature.abs().max(floor)))
}

/// An orthonormal basis of the plane at right angles to a unit vector, right-handed seen from outside.
pub(super) fn tangents(x: &Vec3) -> (Vec3, Vec3) {
    let aside = if x.x.abs() < 0.6 { Vec3::x() } else { Vec3::y() };
    let first = x.cross(&aside).normalize();
    (first, x.cross(&first))
}

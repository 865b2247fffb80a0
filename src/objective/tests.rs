//! Sums over tets against central differences over a range of steps.

use super::{Assembly, Freedom, NearActive, PrimalDual, SoftMax, TetEnergy, Unknowns, log_dilatations};
use crate::domain::Domain;
use crate::linalg::Method;
use crate::mesh::fixtures::{cube, fan, split};
use crate::mesh::{TetId, Vec3};

/// A cube of 48 tets with 13 free vertices, and an image without flipped tets whose singular values are all different.
fn problem() -> (Domain, Vec<Vec3>, Vec<bool>) {
    let domain = Domain::new(split(&fan(&cube(), Vec3::new(0.1, -0.05, 0.02)))).unwrap();
    let bend = |v: usize, axis: usize| 0.06 * ((3 * v + axis) as f64 * 1.618).sin();
    let points = domain.mesh().points();
    let image = points
        .iter()
        .enumerate()
        .map(|(v, p)| p.component_mul(&Vec3::new(1.0, 1.3, 0.8)) + Vec3::from_fn(|axis, _| bend(v, axis)));
    let image = image.collect();
    let fixed = domain.boundary().vertex_mask().to_vec();
    (domain, image, fixed)
}

fn direction(length: usize, seed: usize) -> Vec<f64> {
    (0..length).map(|i| ((i * (2 * seed + 1)) as f64 * 0.7 + seed as f64).sin()).collect()
}

fn moved(assembly: &Assembly<'_>, image: &[Vec3], direction: &[f64], step: f64) -> Vec<Vec3> {
    let mut moved = image.to_vec();
    for (d, &v) in direction.chunks_exact(3).zip(assembly.free()) {
        moved[v as usize] += Vec3::new(d[0], d[1], d[2]) * step;
    }
    moved
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// The least error of a central difference over steps of 1e-2 to 1e-5, relative to the derivative's size. Truncation, h^2
/// times a third derivative of at most the cube of the energies' rate over the square of the smallest edge (0.3), meets
/// rounding, 1e-16 / h, below 1e-7; a wrong entry of the derivative stays at its own size.
fn least_error(derivative: f64, scale: f64, at: impl Fn(f64) -> f64) -> f64 {
    [1e-2, 1e-3, 1e-4, 1e-5]
        .map(|h| ((at(h) - at(-h)) / (2.0 * h) - derivative).abs() / scale)
        .into_iter()
        .fold(f64::INFINITY, f64::min)
}

/// Gradient and Hessian of an energy whose derivatives are exact for `negative` = 1.
fn check<E: TetEnergy>(energy: &E) {
    let (domain, image, fixed) = problem();
    for method in [Method::Direct, Method::Iterative] {
        let mut assembly = Assembly::new(&domain, &Unknowns::of_mask(&fixed), method).unwrap();
        let iterate = assembly.at(image.clone());
        let gradient = assembly.linearize(energy, &iterate, 1.0).unwrap();
        assert_eq!(assembly.gradient(energy, &iterate).unwrap().len(), gradient.len());
        for seed in 0..4 {
            let along = direction(gradient.len(), seed);
            let across = direction(gradient.len(), seed + 4);
            assembly.linearize(energy, &iterate, 1.0).unwrap();
            let product = assembly.system().multiply(&along);
            let at = |h: f64| assembly.at(moved(&assembly, &image, &along, h));
            let slope = dot(&gradient, &along);
            let scale = dot(&gradient, &gradient).sqrt() * dot(&along, &along).sqrt();
            let error = least_error(slope, scale, |h| assembly.value(energy, &at(h)).unwrap());
            assert!(error < 1e-7, "gradient, {method:?}, direction {seed}: {error:e}");
            let scale = dot(&product, &product).sqrt() * dot(&across, &across).sqrt();
            let curvature = dot(&product, &across);
            let error = least_error(curvature, scale, |h| dot(&assembly.gradient(energy, &at(h)).unwrap(), &across));
            assert!(error < 1e-7, "Hessian, {method:?}, direction {seed}: {error:e}");
        }
    }
}

#[test]
fn gradient_and_hessian_of_a_sum_match_differences() {
    check(&SoftMax::new(2.0, 0.3));
}

/// A Lagrangian whose constraints above 0.65 of the bound have multipliers.
fn lagrangian(domain: &Domain, image: &[Vec3], slack: f64, mean_weight: f64) -> PrimalDual {
    let functions: Vec<_> =
        (0..domain.mesh().tets().len()).map(|t| log_dilatations(domain, TetId(t as u32), image).unwrap()).collect();
    let largest = functions.iter().flatten().map(|g| g.value).fold(0.0, f64::max);
    let bound = 1.05 * largest;
    let near_active: Vec<_> = functions
        .iter()
        .enumerate()
        .map(|(t, pair)| {
            pair.map(|g| (g.value > 0.65 * bound).then_some(NearActive { slack, multiplier: 0.1 + 0.01 * t as f64 }))
        })
        .collect();
    assert!(near_active.iter().flatten().flatten().count() > 2);
    PrimalDual { bound, rest_weight: 0.03, mean_weight, near_active, openings: Vec::new() }
}

#[test]
fn gradient_and_hessian_of_the_lagrangian_match_differences() {
    let (domain, image, _) = problem();
    // With slacks without end the condensed system is the Lagrangian's Hessian, but that tets which have nothing but the
    // barrier keep no negative curvature: with a mean, or with the rest's weight at 0, that is of no account.
    check(&lagrangian(&domain, &image, f64::INFINITY, 0.2));
    check(&PrimalDual { rest_weight: 0.0, ..lagrangian(&domain, &image, f64::INFINITY, 0.0) });
}

#[test]
fn the_condensed_system_adds_the_constraints_outer_products() {
    let (domain, image, fixed) = problem();
    let mut assembly = Assembly::new(&domain, &Unknowns::of_mask(&fixed), Method::Direct).unwrap();
    let iterate = assembly.at(image.clone());
    let along = direction(3 * assembly.free().len(), 1);
    let slack = 0.01;
    let [loose, condensed] = [f64::INFINITY, slack].map(|slack| lagrangian(&domain, &image, slack, 0.2));
    // The column of the bound as well: a constraint falls by as much as the bound rises.
    let [mut expected_column, column] = [&loose, &condensed]
        .map(|problem| assembly.gradients_of_logs(&iterate, |tet, logs| [problem.mixed_slopes(tet, logs)]).unwrap())
        .map(|[column]| column);
    let mut product = |problem: &PrimalDual| {
        assembly.linearize(problem, &iterate, 1.0).unwrap();
        assembly.system().multiply(&along)
    };
    let mut expected = product(&loose);
    let got = product(&condensed);
    let displacement = moved(&assembly, &vec![Vec3::zeros(); image.len()], &along, 1.0);
    for (tet, pair) in condensed.near_active.iter().enumerate() {
        let functions = log_dilatations(&domain, TetId(tet as u32), &image).unwrap();
        let corners = domain.mesh().tets()[tet];
        for (constraint, function) in pair.iter().zip(functions) {
            let Some(constraint) = constraint else { continue };
            let change: f64 = function.gradient.iter().zip(corners).map(|(g, v)| g.dot(&displacement[v.index()])).sum();
            for (i, &v) in assembly.free().iter().enumerate() {
                for (g, _) in function.gradient.iter().zip(corners).filter(|(_, corner)| corner.0 == v) {
                    for axis in 0..3 {
                        expected[3 * i + axis] += constraint.multiplier / slack * change * g[axis];
                        expected_column[3 * i + axis] -= constraint.multiplier / slack * g[axis];
                    }
                }
            }
        }
    }
    for (got, expected) in [(got, expected), (column, expected_column)] {
        let scale = dot(&expected, &expected).sqrt();
        for (got, expected) in got.iter().zip(&expected) {
            assert!((got - expected).abs() < 1e-12 * scale);
        }
    }
}

#[test]
fn the_bounds_row_and_column_match_differences() {
    let (domain, image, fixed) = problem();
    let assembly = Assembly::new(&domain, &Unknowns::of_mask(&fixed), Method::Direct).unwrap();
    let iterate = assembly.at(image.clone());
    let problem = lagrangian(&domain, &image, f64::INFINITY, 0.0);
    let [column] = assembly.gradients_of_logs(&iterate, |tet, logs| [problem.mixed_slopes(tet, logs)]).unwrap();
    let with = |h: f64| PrimalDual { bound: problem.bound + h, ..problem.clone() };
    let across = direction(column.len(), 2);
    let scale = dot(&column, &column).sqrt() * dot(&across, &across).sqrt();
    let error =
        least_error(dot(&column, &across), scale, |h| dot(&assembly.gradient(&with(h), &iterate).unwrap(), &across));
    assert!(error < 1e-7, "{error:e}");
    let rest = |h: f64| assembly.sum_of_logs(&iterate, |tet, logs| with(h).rest_bound_derivatives(tet, logs)).unwrap();
    let multipliers: f64 = problem.near_active.iter().flatten().flatten().map(|c| c.multiplier).sum();
    let [first, second] = rest(0.0);
    let slope = problem.rest_weight * first - multipliers;
    let error = least_error(slope, slope.abs(), |h| assembly.value(&with(h), &iterate).unwrap());
    assert!(error < 1e-7, "{error:e}");
    let error = least_error(second, second.abs(), |h| rest(h)[0]);
    assert!(error < 1e-7, "{error:e}");
}

#[test]
fn derivatives_of_what_slides_match_differences_along_the_sphere() {
    let (domain, mut image, fixed) = problem();
    let boundary = domain.boundary().vertex_mask();
    // The corners go to the unit sphere from about 1.8, and what is inside as much nearer to the centre.
    for (position, &on_boundary) in image.iter_mut().zip(boundary) {
        *position = if on_boundary { position.normalize() } else { *position / 1.8 };
    }
    let freedom = fixed.iter().map(|&fixed| if fixed { Freedom::OnSphere } else { Freedom::Free }).collect();
    let mut assembly = Assembly::new(&domain, &Unknowns::new(freedom), Method::Direct).unwrap();
    assert_eq!(assembly.free().len(), image.len());
    let iterate = assembly.at(image.clone());
    let energy = SoftMax::new(2.0, 0.3);
    let gradient = assembly.linearize(&energy, &iterate, 1.0).unwrap();
    for seed in 0..4 {
        let along = assembly.tangent(&image, direction(gradient.len(), seed));
        let product = assembly.system().multiply(&along);
        let at = |h: f64| {
            let moved = assembly.moved(&image, &along, h);
            assert!(moved.iter().zip(boundary).all(|(p, &on)| !on || (p.norm() - 1.0).abs() < 1e-14));
            assembly.value(&energy, &assembly.at(moved)).unwrap()
        };
        let scale = dot(&gradient, &gradient).sqrt() * dot(&along, &along).sqrt();
        let error = least_error(dot(&gradient, &along), scale, at);
        assert!(error < 1e-7, "gradient, direction {seed}: {error:e}");
        // Scaling back to the sphere is a retraction of second order: the second derivative along it is the Hessian's.
        let h = 1e-4;
        let second = (at(h) + at(-h) - 2.0 * at(0.0)) / (h * h);
        let curvature = dot(&product, &along);
        // Rounding 1e-16 / h^2 = 1e-8 of the value, truncation h^2 times a fourth derivative.
        assert!((curvature - second).abs() < 1e-4 * second.abs().max(1.0), "direction {seed}: {curvature} {second}");
    }
}

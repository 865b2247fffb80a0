use super::*;
use crate::linalg::Mat3;
use crate::map::{RadialCoordinates, caraman};
use crate::solid::{ShellSettings, Solid, shell_mesh};

/// A cube in shells and its image.
fn cube(subdivisions: u32, layers: u32, moved: f64) -> (Domain, Vec<Vec3>) {
    let settings = ShellSettings { subdivisions, refinement: None, layers, grading: 1.0 };
    let shell = shell_mesh(&Solid::Cube.surface().unwrap(), Vec3::zeros(), &settings).unwrap();
    let mut image = caraman(&RadialCoordinates::of_shell(&shell), 1.0);
    let domain = Domain::new(shell.mesh).unwrap();
    for (vertex, point) in image.iter_mut().enumerate().filter(|(v, _)| !domain.boundary().vertex_mask()[*v]) {
        let phase = vertex as f64;
        *point += Vec3::new(phase.sin(), (1.7 * phase).cos(), (2.3 * phase).sin()) * moved;
    }
    (domain, image)
}

/// sigma - 1 / sigma = sqrt 2 at the corners of a cube, where tan gamma = sqrt 2.
fn inscribed_cube() -> f64 {
    ((2f64.sqrt() + 6f64.sqrt()) / 2.0).powi(3)
}

#[test]
fn the_identity_of_an_inscribed_cube_has_the_k_of_its_radial_map() {
    let (domain, _) = cube(1, 3, 0.0);
    let corners: Vec<Vec3> = domain.mesh().points().iter().map(|p| p / 3f64.sqrt()).collect();
    // The face centres and edge midpoints of the cube are boundary vertices too, and are not on the sphere.
    assert_eq!(ball_dilatation(&domain, &corners), Err(NotOntoBall::NotInscribed));
    let fan = crate::mesh::fixtures::fan(&crate::mesh::fixtures::cube(), Vec3::new(0.1, 0.2, -0.1));
    let domain = Domain::new(fan).unwrap();
    let found = ball_dilatation(&domain, domain.mesh().points()).unwrap();
    let k = inscribed_cube();
    // Rounding is of no account beside the two tolerances.
    assert!(found.sampled <= k && found.sampled >= k * (1.0 - 1e-8), "{found:?} {k}");
    assert!(found.certified >= k && found.certified <= k * (1.0 + TOLERANCE), "{found:?} {k}");
    let fraction = ball_fraction(&domain, domain.mesh().points()).unwrap();
    assert!((fraction - 2.0 / (3f64.sqrt() * std::f64::consts::PI)).abs() < 1e-12);
}

#[test]
fn images_that_are_no_part_of_a_ball_have_none_and_flipped_ones_an_infinite_one() {
    let (domain, mut image) = cube(2, 2, 0.0);
    let shifted: Vec<Vec3> = image.iter().map(|p| p + Vec3::x() * 0.1).collect();
    assert_eq!(ball_dilatation(&domain, &shifted), Err(NotOntoBall::NotInscribed));
    let mirrored: Vec<Vec3> = image.iter().map(|p| -p).collect();
    assert_eq!(ball_dilatation(&domain, &mirrored), Err(NotOntoBall::NotStarShaped));
    image[0] = Vec3::new(0.9, 0.0, 0.0);
    let found = ball_dilatation(&domain, &image).unwrap();
    assert_eq!((found.certified, found.sampled), (f64::INFINITY, f64::INFINITY));
}

#[test]
fn turning_and_scaling_an_image_changes_only_rounding() {
    let (domain, image) = cube(2, 3, 0.02);
    let k = ball_dilatation(&domain, &image).unwrap();
    let turn = nalgebra::Rotation3::from_euler_angles(0.3, -1.1, 2.0);
    let turned: Vec<Vec3> = image.iter().map(|p| turn * p * 7.3).collect();
    let again = ball_dilatation(&domain, &turned).unwrap();
    // Halving may go elsewhere, which changes the certified value within the tolerance.
    assert!(
        (again.certified / k.certified - 1.0).abs() < TOLERANCE && (again.sampled / k.sampled - 1.0).abs() < TOLERANCE
    );
    // A power of two changes no bit.
    let doubled: Vec<Vec3> = image.iter().map(|p| p * 1024.0).collect();
    assert_eq!(ball_dilatation(&domain, &doubled), Ok(k));
}

#[test]
fn both_ends_meet_and_are_the_same_for_any_number_of_threads() {
    for moved in [0.0, 0.01, 0.03] {
        let (domain, image) = cube(2, 4, moved);
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| ball_dilatation(&domain, &image))
        };
        let found = on(1).unwrap();
        assert_eq!(Ok(found), on(4));
        assert!(found.sampled <= found.certified && found.certified <= found.sampled * 1.01, "{moved}: {found:?}");
    }
}

/// A map followed by the radial map of its image onto the ball, by the formula for points.
struct Composed<'a> {
    domain: &'a Domain,
    image: &'a [Vec3],
}

impl Composed<'_> {
    fn at(&self, tet: usize, point: &Vec3) -> Vec3 {
        let corners = self.domain.mesh().corners(TetId(tet as u32));
        let image = self.domain.mesh().tets()[tet].map(|v| self.image[v.index()]);
        let weights = self.domain.inverse_edges()[tet] * (point - corners[0]);
        let y = image[0] + crate::mesh::edge_matrix(image) * weights;
        // The face that the ray meets is the one whose three determinants are all positive.
        let face = self.domain.boundary().triangles().iter().map(|t| t.map(|v| self.image[v.index()]));
        let of = |[a, b, c]: &[Vec3; 3]| a.cross(b).dot(&y).min(b.cross(c).dot(&y)).min(c.cross(a).dot(&y));
        let [a, b, c] = face.max_by(|s, t| of(s).total_cmp(&of(t))).unwrap();
        let normal = (b - a).cross(&(c - a));
        y.normalize() * (normal.dot(&y) / normal.dot(&a))
    }
}

#[test]
fn finite_differences_of_the_map_onto_the_ball_stay_below_the_certified_k() {
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{RngCore, SeedableRng};
    let mut random = ChaCha8Rng::seed_from_u64(1);
    for moved in [0.0, 0.02] {
        let (domain, image) = cube(2, 3, moved);
        let found = ball_dilatation(&domain, &image).unwrap();
        let map = Composed { domain: &domain, image: &image };
        let tets = domain.mesh().tets().len();
        let mut largest: f64 = 1.0;
        for sample in 0..50_000 {
            let tet = sample % tets;
            let corners = domain.mesh().corners(TetId(tet as u32));
            let weights: [f64; 4] =
                std::array::from_fn(|_| -((random.next_u64() >> 11) as f64 + 0.5).ln() + 53.0 * 2f64.ln());
            let sum: f64 = weights.iter().sum();
            let point: Vec3 = corners.iter().zip(weights).map(|(corner, w)| corner * (w / sum)).sum();
            // Central differences of step h: the function, of size 1, is rounded at 1e-16, which divided by h is 1e-11. Third
            // derivatives are of the order of 1 / |y|^2, times h^2: both below 1e-8 for |y| > 1e-3. Where the step crosses a
            // face of a cone the difference is between two Jacobians, which is no sample, so points near one are passed over.
            let h = 1e-5;
            let steps = [0, 1, 2].map(|i| Vec3::ith(i, h));
            let jacobian = Mat3::from_columns(
                &steps.map(|step| (map.at(tet, &(point + step)) - map.at(tet, &(point - step))) / (2.0 * h)),
            );
            let forward =
                Mat3::from_columns(&steps.map(|step| (map.at(tet, &(point + step)) - map.at(tet, &point)) / h));
            if (jacobian - forward).norm() > 1e-3 * jacobian.norm() {
                continue;
            }
            largest = largest.max(crate::Dilatation::of(&jacobian).k());
        }
        // K is a quotient of products of three singular values, each to 1e-8 over the least of them.
        assert!(largest <= found.certified * (1.0 + 1e-5), "{moved}: {largest} {found:?}");
        assert!(largest >= found.certified * 0.8, "{moved}: {largest} {found:?}");
    }
}

/// A cube of flags with warps of one exponent at all corners, and its radial image with the inside moved.
fn warped_cube(exponent: f64, moved: f64) -> (Domain, Vec<Vec3>, Corners) {
    use crate::map::{Cone, RayEnd};
    use crate::solid::{FlagSettings, flag_mesh};
    let surface = Solid::Cube.surface().unwrap();
    let settings = FlagSettings { sectors: 1, rings: 2, layers: 2, ..FlagSettings::default() };
    let flags = flag_mesh(&surface, Vec3::zeros(), &settings).unwrap();
    let domain = Domain::new(flags.mesh).unwrap();
    let rays = RadialCoordinates::of_domain(&domain, &surface, Vec3::zeros(), RayEnd::Only).unwrap();
    let mut image = caraman(&rays, 1.0);
    for (vertex, point) in image.iter_mut().enumerate().filter(|(v, _)| !domain.boundary().vertex_mask()[*v]) {
        let phase = vertex as f64;
        *point += Vec3::new(phase.sin(), (1.7 * phase).cos(), (2.3 * phase).sin()) * moved;
    }
    let cones = flags.flags.iter().map(|flag| Cone { corner: flag.corner, base: flag.base, exponent }).collect();
    let of_tet = (0..domain.mesh().tets().len()).map(|tet| Some((tet / settings.tets_a_flag()) as u32)).collect();
    let corners = Corners::new(&domain, cones, of_tet).unwrap();
    (domain, image, corners)
}

#[test]
fn a_warp_of_exponent_one_changes_nothing() {
    let (domain, image, corners) = warped_cube(1.0, 0.01);
    assert_eq!(warped_ball_dilatation(&domain, Some(&corners), &image), ball_dilatation(&domain, &image));
}

#[test]
fn differences_of_a_warped_map_onto_the_ball_stay_below_the_certified_k() {
    use crate::map::{Evaluator, Onto};
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{RngCore, SeedableRng};
    // 100,000 take a minute.
    let points = std::env::var("QCBALL_POINTS").map_or(20_000, |points| points.parse().expect("a number of points"));
    for (exponent, moved) in [(1.5, 0.0), (0.8, 0.01)] {
        let (domain, image, corners) = warped_cube(exponent, moved);
        let found = warped_ball_dilatation(&domain, Some(&corners), &image).unwrap();
        assert!(found.sampled <= found.certified, "{found:?}");
        let map = Evaluator::new(&domain, &image, Onto::Ball).unwrap().with_corners(&corners);
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let mut number = || (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64 * 2.0 - 1.0;
        let (step, mut largest, mut counted) = (1e-6, 1.0f64, 0);
        for _ in 0..points {
            let x = Vec3::new(number(), number(), number()) * 0.99;
            let axes = [Vec3::x(), Vec3::y(), Vec3::z()].map(|axis| axis * step);
            let Some(here) = map.at(&x) else { continue };
            let ends = axes.map(|by| [map.at(&(x + by)).unwrap(), map.at(&(x - by)).unwrap()]);
            // Differences across a face of a tet, or of a cone of the boundary, mean nothing.
            let [central, forward] = [0, 1].map(|side| {
                let columns = ends.map(|[a, b]| match side {
                    0 => (a.position - b.position) / (2.0 * step),
                    _ => (a.position - here.position) / step,
                });
                Mat3::from_columns(&columns)
            });
            let whole = ends.iter().flatten().all(|end| end.tet == here.tet);
            if !whole || (central - forward).norm() > 1e-3 * central.norm() {
                continue;
            }
            counted += 1;
            largest = largest.max(crate::Dilatation::of(&central).k());
        }
        // Rounding at 1e-16 / step times the condition of K in the matrix, below 1000.
        assert!(largest <= found.certified * (1.0 + 1e-6), "{exponent}: {largest} {found:?}");
        assert!(counted > points / 2, "{exponent}: {counted}");
        // K is largest at few points, near which random ones may not come; of the moved map in a tet that is nearly flat.
        if moved == 0.0 {
            assert!(found.certified <= found.sampled * 1.0021, "{found:?}");
            assert!(largest >= found.certified * 0.9, "{exponent}: {largest} {found:?}");
        }
    }
}

#[test]
fn a_chamber_bounds_a_symmetric_map_as_all_of_it_does() {
    use crate::cancel::Cancel;
    use crate::measure::measure_warped_onto_ball;
    let (domain, image, corners) = warped_cube(1.5, 0.0);
    let tips: Vec<Vec3> = corners.exponents().iter().map(|(v, _)| domain.mesh().points()[v.index()]).collect();
    let mirrors = crate::mesh::Mirrors::of(domain.mesh(), &Vec3::zeros(), &tips).unwrap();
    assert_eq!(domain.mesh().tets().len(), 48 * mirrors.tets().len());
    let image = mirrors.unfolded(&mirrors.folded(&image));
    let of =
        |part| measure_warped_onto_ball(&domain, &corners, &image, part, &Cancel::default()).summary.ball_k.unwrap();
    let (whole, part) = (of(None), of(Some(mirrors.tets())));
    // The slack that is left to each, 1e-3 and what the search stops at.
    assert!((part.certified / whole.certified - 1.0).abs() < 3e-3, "{part:?} {whole:?}");
    assert!((part.sampled / whole.sampled - 1.0).abs() < 1e-9, "{part:?} {whole:?}");
    // It speaks of nothing else.
    let few = of(Some(&mirrors.tets()[..1]));
    assert!(few.certified < part.sampled, "{few:?}");
}

#[test]
fn what_is_left_when_the_work_or_the_time_is_spent_is_bounded_as_a_whole_and_a_signal_ends_it() {
    let ((plain, of_plain), (warped, of_warped, corners)) = (cube(2, 4, 0.01), warped_cube(1.3, 0.01));
    let raised = Cancel::default();
    raised.raise();
    for (domain, corners, image) in [(&plain, None, &of_plain), (&warped, Some(&corners), &of_warped)] {
        let by = |work: usize, cancel: &Cancel| enclosed_by(domain, corners, image, None, cancel, work).unwrap();
        let [none, one, all] = [0, 1, usize::MAX].map(|work| by(work, &Cancel::default()).unwrap());
        let tets = |k: fn(&Measured) -> f64| match corners {
            None => k(&measure(domain, image)),
            Some(corners) => k(&measure_elements(domain, &corners.elements(domain), image)),
        };
        let most = OntoBall::new(domain, corners, image).unwrap().cones.largest_stretch();
        // K of a product is at most the product; rounding is far below the factor.
        let whole = tets(|measured| measured.summary.max_k) * most * (1.0 + 1e-9);
        assert!(all.certified <= one.certified && one.certified <= none.certified, "{one:?} {all:?}");
        assert!(all.certified < none.certified && none.certified <= whole, "{none:?} {all:?} {whole}");
        assert!(all.sampled <= all.certified && none.sampled <= all.certified, "{none:?} {one:?} {all:?} {whole}");
        assert_eq!(by(usize::MAX, &raised), None);
        // A deadline is told, and leaves no less.
        let late = by(usize::MAX, &Cancel::default().within(std::time::Duration::ZERO));
        assert_eq!(late, Some(BallDilatation { cut_short: true, ..none }));
        assert!(!none.cut_short && !all.cut_short);
    }
}

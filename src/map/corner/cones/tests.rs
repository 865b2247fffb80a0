//! Cones on flags: their widths, faces, the exact largest K, and evaluation.

use super::*;
use crate::Dilatation;
use crate::map::{Evaluator, Onto, RayEnd, by_ray_casting, caraman};
use crate::measure::{measure, measure_elements};
use crate::mesh::Vec3;
use crate::mesh::fixtures::{cube, fan, split};
use crate::solid::{FlagSettings, Solid, Surface, flag_mesh};

/// A cube of flags, its radial image and warps of one exponent at all corners.
fn flags(exponent: f64) -> (Domain, Vec<Vec3>, Corners) {
    let surface = Solid::Cube.surface().unwrap();
    let settings = FlagSettings { sectors: 2, rings: 2, layers: 2, ..FlagSettings::default() };
    let flags = flag_mesh(&surface, Vec3::zeros(), &settings).unwrap();
    let mut rays = by_ray_casting(&surface, Vec3::zeros(), flags.mesh.points(), RayEnd::Only).unwrap();
    let domain = Domain::new(flags.mesh).unwrap();
    for (at, on) in rays.iter_mut().zip(domain.boundary().vertex_mask()) {
        at.fraction = if *on { 1.0 } else { at.fraction };
    }
    let cone = |flag: &crate::solid::Flag| Cone { corner: flag.corner, base: flag.base, exponent };
    let cones: Vec<Cone> = flags.flags.iter().map(cone).collect();
    let of_tet = (0..domain.mesh().tets().len()).map(|tet| Some((tet / settings.tets_a_flag()) as u32)).collect();
    let corners = Corners::new(&domain, cones, of_tet).unwrap();
    (domain, caraman(&rays, 1.0), corners)
}

#[test]
fn cones_of_a_small_solid_far_from_the_origin_fit_as_well_as_its_coordinates_tell() {
    for size in [1.0, 1e-4, 1e-7] {
        let cube = Solid::Cube.surface().unwrap();
        let corners: Vec<Vec3> = cube.points().iter().map(|p| p * size + Vec3::new(0.3, 0.7, 0.9)).collect();
        let triangles: Vec<[VertexId; 3]> = cube.triangles().to_vec();
        let surface = Surface::from_triangles(corners, &triangles).unwrap();
        let settings = FlagSettings { sectors: 2, rings: 2, layers: 2, ..FlagSettings::default() };
        let flags = flag_mesh(&surface, Vec3::new(0.3, 0.7, 0.9), &settings).unwrap();
        let domain = Domain::new(flags.mesh).unwrap();
        let cones = { flags.flags.iter() }.map(|flag| Cone { corner: flag.corner, base: flag.base, exponent: 1.5 });
        let of_tet = (0..domain.mesh().tets().len()).map(|tet| Some((tet / settings.tets_a_flag()) as u32));
        let (cones, mut of_tet): (Vec<Cone>, Vec<Option<u32>>) = (cones.collect(), of_tet.collect());
        assert!(Corners::new(&domain, cones.clone(), of_tet.clone()).is_ok(), "{size}");
        // In the cone of the next flag they do not.
        of_tet[0] = Some(1);
        assert!(Corners::new(&domain, cones, of_tet).is_err(), "{size}");
    }
}

#[test]
fn the_elements_have_the_largest_dilatation_of_the_warped_map() {
    for exponent in [0.7, 1.0, 1.6] {
        let (domain, image, corners) = flags(exponent);
        let elements = corners.elements(&domain);
        let measured = measure_elements(&domain, &elements, &image);
        let largest = measured.dilatations;
        let volume: f64 = elements.domain.volumes().iter().sum();
        assert!((volume - 8.0).abs() < 1e-12);
        assert_eq!(measured.summary.max_k, largest.iter().map(|of_tet| of_tet.k()).fold(1.0, f64::max));
        let mut flipped = image.clone();
        flipped[0] = Vec3::repeat(0.9);
        let there = measure_elements(&domain, &elements, &flipped);
        assert_eq!(there.flipped, measure(&domain, &flipped).flipped);
        assert_eq!((there.summary.flipped, there.summary.max_k), (there.flipped.len(), f64::INFINITY));
        for (tet, largest) in (0..).map(TetId).zip(&largest) {
            let exact =
                corners.warp(tet).unwrap().dilatation(&domain.jacobian(tet, &image), domain.mesh().corners(tet));
            assert!(
                (largest.inner / exact.inner - 1.0).abs() < 1e-11 && (largest.outer / exact.outer - 1.0).abs() < 1e-11
            );
        }
        if exponent == 1.0 {
            assert_eq!(measured.summary, measure(&domain, &image).summary);
        }
    }
}

#[test]
fn differences_of_the_evaluated_map_never_exceed_the_exact_dilatation() {
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{RngCore, SeedableRng};
    let (domain, image, corners) = flags(1.5);
    let largest = measure_elements(&domain, &corners.elements(&domain), &image).dilatations;
    let map = Evaluator::new(&domain, &image, Onto::Polyhedron).unwrap().with_corners(&corners);
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut number = || f64::from(random.next_u32()) / f64::from(u32::MAX) * 2.0 - 1.0;
    let (step, mut counted) = (1e-6, 0);
    for _ in 0..20_000 {
        let x = Vec3::new(number(), number(), number()) * 0.99;
        let here = map.at(&x).unwrap();
        // The inverse, to the rounding of a point that a warp may stretch by 1 / t^(1/2).
        assert!(
            (map.at(&map.inverse(&here.position).unwrap().position).unwrap().position - here.position).norm() < 1e-10
        );
        let axes = [Vec3::x(), Vec3::y(), Vec3::z()].map(|axis| axis * step);
        let ends = axes.map(|by| [map.at(&(x + by)).unwrap(), map.at(&(x - by)).unwrap()]);
        // Differences across a face mean nothing.
        if ends.iter().flatten().any(|end| end.tet != here.tet) {
            continue;
        }
        counted += 1;
        let columns = ends.map(|[a, b]| (a.position - b.position) / (2.0 * step));
        let k = Dilatation::of(&Mat3::from_columns(&columns)).k();
        // Rounding at 1e-16 / step times the condition of K in the matrix, below 100.
        assert!(k <= largest[here.tet.index()].k() * (1.0 + 1e-7), "{k} {:?}", largest[here.tet.index()]);
    }
    assert!(counted > 15_000);
}

#[test]
fn a_solid_far_from_0_holds_the_points_next_to_its_corners_that_the_inverse_gives() {
    for exponent in [0.7, 1.6, 2.5] {
        let (near, image, corners) = flags(exponent);
        let far: Vec<Vec3> = near.mesh().points().iter().map(|p| p + Vec3::new(1e6, -1e6, 1e6)).collect();
        let domain = Domain::new(TetMesh::new(far.clone(), near.mesh().tets().to_vec()).unwrap()).unwrap();
        let corners = Corners::new(&domain, corners.cones().to_vec(), corners.of_tets().to_vec()).unwrap();
        let map = Evaluator::new(&domain, &image, Onto::Ball).unwrap().with_corners(&corners);
        for (point, on) in far.iter().zip(domain.boundary().vertex_mask()) {
            let there = map.at(point).unwrap().position;
            let back = map.inverse(&there).unwrap().position;
            let again = map.at(&back).expect("the inverse lies in the solid").position;
            // Four units of the last place of the domain's coordinates, 1.2e-10, stretched by less than 100; next to a corner, where
            // the map is like r^p, less than the r^p of so near a point.
            let unsure = 1e-8f64.max(1e-9f64.powf(exponent));
            assert!((again - there).norm() < unsure, "{exponent}: {there:?} {again:?}");
            assert!(!on || (there.norm() - 1.0).abs() < 1e-9);
        }
    }
}

#[test]
fn the_stars_of_corners_make_a_continuous_map_with_an_inverse() {
    use crate::mesh::Subdivision;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{RngCore, SeedableRng};
    let exponents: Vec<(VertexId, f64)> = (0..8).map(|v| (VertexId(v), 0.6 + 0.3 * f64::from(v))).collect();
    // All edges between corners halved: of the cube, and the diagonals of its faces.
    let mut parted = Subdivision::of(&fan(&cube(), Vec3::new(0.1, -0.2, 0.05)));
    parted.split_edges(|edge| edge.iter().all(|v| v.0 < 8));
    assert_eq!(parted.edge_splits(), 18);
    let domain = Domain::new(parted.mesh().unwrap()).unwrap();
    let corners = Corners::stars(&domain, &exponents).unwrap();
    // Any positive tets will do: here the cube seen from the centre, bent a little.
    let image: Vec<Vec3> =
        domain.mesh().points().iter().map(|x| x + Vec3::new(x.y * x.z, x.z * x.x, x.x * x.y) * 0.05).collect();
    let mut random = ChaCha8Rng::seed_from_u64(8);
    let mut number = || f64::from(random.next_u32()) / f64::from(u32::MAX);
    let value = |tet: TetId, x: &Vec3| {
        let from = domain.mesh().corners(tet)[0];
        let to = image[domain.mesh().tets()[tet.index()][0].index()];
        to + domain.jacobian(tet, &image) * (corners.warp(tet).map_or(*x, |warp| warp.at(x)) - from)
    };
    let mut sides: HashMap<[VertexId; 3], TetId> = HashMap::new();
    let mut shared = 0;
    for (index, tet) in (0..).map(TetId).zip(domain.mesh().tets()) {
        for face in TetMesh::FACES {
            let mut face = face.map(|i| tet[i]);
            face.sort_unstable();
            let Some(other) = sides.insert(face, index) else { continue };
            for _ in 0..20 {
                let weights: Vec3 = Vec3::new(number(), number(), number());
                let weights = weights / weights.sum();
                let x: Vec3 = (0..3).map(|i| domain.mesh().points()[face[i].index()] * weights[i]).sum();
                // Distances of 1 or so.
                assert!((value(index, &x) - value(other, &x)).norm() < 1e-14);
                shared += 1;
            }
        }
    }
    assert!(shared > 1000);
    let map = Evaluator::new(&domain, &image, Onto::Polyhedron).unwrap().with_corners(&corners);
    for _ in 0..2_000 {
        let x = Vec3::new(number(), number(), number()) * 1.9 - Vec3::repeat(0.95);
        let y = map.at(&x).unwrap().position;
        let back = map.inverse(&y).unwrap().position;
        assert!((map.at(&back).unwrap().position - y).norm() < 1e-10);
    }
}

#[test]
fn corner_elements_fit_unless_a_tet_has_two_corners() {
    let coarse = Domain::new(fan(&cube(), Vec3::zeros())).unwrap();
    let all: Vec<(VertexId, f64)> = (0..8).map(|v| (VertexId(v), 1.4)).collect();
    assert!(matches!(Corners::stars(&coarse, &all), Err(CornerError::TwoCorners { .. })));
    // One corner alone; and tets cut in four still hold the faces with their two corners.
    let one = Corners::stars(&coarse, &all[..1]).unwrap();
    assert_eq!(one.of_tets().iter().flatten().count(), one.cones().len());
    let finer = Domain::new(split(coarse.mesh())).unwrap();
    assert!(matches!(Corners::stars(&finer, &all), Err(CornerError::TwoCorners { .. })));
    assert!(matches!(Corners::stars(&coarse, &[(VertexId(8), 1.4)]), Err(CornerError::Inside { corner: 8 })));
    assert!(matches!(Corners::stars(&coarse, &[(VertexId(0), -1.0)]), Err(CornerError::Cone { corner: 0, .. })));
    let angles = solid_angles(&coarse, &[VertexId(0), VertexId(8)]);
    assert!((angles[0] - std::f64::consts::FRAC_PI_2).abs() < 1e-14);
    assert!((angles[1] - 4.0 * std::f64::consts::PI).abs() < 1e-13);
}

#[test]
fn cones_that_do_not_fit_are_refused() {
    let (domain, _, corners) = flags(1.5);
    let cones = corners.cones().to_vec();
    let of_tet = corners.of_tets().to_vec();
    // One tet left linear, one in a cone of another corner, a corner with two exponents, a base that is moved.
    let mut linear = of_tet.clone();
    linear[0] = None;
    assert!(matches!(Corners::new(&domain, cones.clone(), linear), Err(CornerError::Torn { .. })));
    let mut other = of_tet.clone();
    other[0] = Some(5);
    assert!(Corners::new(&domain, cones.clone(), other).is_err());
    let mut uneven = cones.clone();
    uneven[0].exponent = 1.6;
    assert!(matches!(Corners::new(&domain, uneven, of_tet.clone()), Err(CornerError::Exponents { .. })));
    let mut moved = cones.clone();
    let inner = domain.mesh().tets()[1].into_iter().find(|v| !cones[0].base.contains(v) && *v != cones[0].corner);
    moved[0].base[0] = inner.unwrap();
    assert!(Corners::new(&domain, moved, of_tet.clone()).is_err());
    assert_eq!(Corners::new(&domain, cones, of_tet[1..].to_vec()), Err(CornerError::Range));
    // All cones of one corner left out: the others fit without them.
    let corner = corners.cones()[0].corner;
    let kept = of_tet.iter().map(|cone| cone.filter(|&cone| corners.cones()[cone as usize].corner != corner)).collect();
    assert!(Corners::new(&domain, corners.cones().to_vec(), kept).is_ok());
}

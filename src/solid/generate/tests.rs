use std::f64::consts::PI;

use super::*;
use crate::mesh::Vec3;
use crate::solid::platonic::GOLDEN;

/// Volume, area, and the dihedral angle at the edges of the solid, each to rounding.
fn check(solid: &Solid, volume: f64, area: f64, dihedral: f64) -> Surface {
    let surface = solid.surface().unwrap();
    assert!((surface.volume() / volume - 1.0).abs() < 1e-13, "{solid:?}: volume {}", surface.volume());
    assert!((surface.area() / area - 1.0).abs() < 1e-13, "{solid:?}: area {}", surface.area());
    let smallest = surface.edges().iter().map(|edge| surface.dihedral_angle(edge)).fold(f64::INFINITY, f64::min);
    assert!((smallest - dihedral).abs() < 1e-13, "{solid:?}: dihedral angle {smallest}");
    assert_eq!((surface.genus(), surface.was_inside_out()), (0, false));
    surface
}

#[test]
fn platonic_solids_have_their_closed_forms() {
    let edge = |a: f64| (a * a, a * a * a);
    let root = f64::sqrt;
    let cases = [
        (Solid::Tetrahedron, edge(root(8.0)), root(2.0) / 12.0, root(3.0), (1.0 / 3.0f64).acos(), (14, 24)),
        (Solid::Cube, edge(2.0), 1.0, 6.0, PI / 2.0, (26, 48)),
        (Solid::Octahedron, edge(root(2.0)), root(2.0) / 3.0, 2.0 * root(3.0), (-1.0 / 3.0f64).acos(), (26, 48)),
        (
            Solid::Dodecahedron,
            edge(2.0 / GOLDEN),
            (15.0 + 7.0 * root(5.0)) / 4.0,
            3.0 * root(25.0 + 10.0 * root(5.0)),
            (-1.0 / root(5.0)).acos(),
            (62, 120),
        ),
        (
            Solid::Icosahedron,
            edge(2.0),
            5.0 * (3.0 + root(5.0)) / 12.0,
            5.0 * root(3.0),
            (-root(5.0) / 3.0).acos(),
            (62, 120),
        ),
    ];
    for (solid, (square, cube), volume, area, dihedral, (vertices, triangles)) in cases {
        let surface = check(&solid, volume * cube, area * square, dihedral);
        assert_eq!((surface.points().len(), surface.triangles().len()), (vertices, triangles), "{solid:?}");
        assert!(surface.centroid().norm() < 1e-14);
    }
}

#[test]
fn prisms_and_pyramids_have_their_closed_forms() {
    check(&Solid::Box { size: [1.0, 2.0, 3.0] }, 6.0, 22.0, PI / 2.0);
    check(&Solid::Prism { sides: 3, height: 2.0 }, 3f64.sqrt() / 2.0, 3f64.sqrt() / 2.0 + 6.0, PI / 3.0);
    // All edges equal to 1: half an octahedron of edge 1.
    let pyramid = Solid::Pyramid { sides: 4, height: 0.5f64.sqrt() };
    let surface = check(&pyramid, 2f64.sqrt() / 6.0, 1.0 + 3f64.sqrt(), (1.0 / 3f64.sqrt()).acos());
    assert!(surface.centroid().norm() < 1e-14);
    let octahedron = Solid::Bipyramid { sides: 4, height: 0.5f64.sqrt() };
    check(&octahedron, 2f64.sqrt() / 3.0, 2.0 * 3f64.sqrt(), (-1.0f64 / 3.0).acos());
    let many = Solid::Prism { sides: 100, height: 1.0 }.surface().unwrap();
    assert!((many.volume() - 25.0 / (PI / 100.0).tan()).abs() < 1e-10);
}

#[test]
fn smooth_solids_converge_from_inside_at_second_order() {
    let volume = |solid: Solid| solid.surface().unwrap().volume();
    let ball = |resolution| 1.0 - volume(Solid::Ball { radius: 2.0, resolution }) / (4.0 / 3.0 * PI * 8.0);
    let ellipsoid =
        |resolution| 1.0 - volume(Solid::Ellipsoid { radii: [1.0, 2.0, 3.0], resolution }) / (4.0 / 3.0 * PI * 6.0);
    for error in [&ball as &dyn Fn(u32) -> f64, &ellipsoid] {
        let (coarse, fine) = (error(8), error(16));
        assert!(fine > 0.0 && (coarse / fine / 4.0 - 1.0).abs() < 0.05, "{coarse} then {fine}");
    }
    let torus = |resolution| {
        let surface = Solid::Torus { major_radius: 2.0, minor_radius: 0.5, resolution }.surface().unwrap();
        assert_eq!((surface.genus(), surface.was_inside_out()), (1, false));
        1.0 - surface.volume() / (2.0 * PI * PI * 2.0 * 0.25)
    };
    assert!((torus(16) / torus(32) / 4.0 - 1.0).abs() < 0.05);
}

#[test]
fn a_ball_has_twenty_times_the_square_of_its_resolution() {
    for resolution in 1..6 {
        let surface = Solid::Ball { radius: 1.0, resolution }.surface().unwrap();
        assert_eq!(surface.triangles().len() as u32, 20 * resolution * resolution);
        assert_eq!(surface.points().len() as u32, 10 * resolution * resolution + 2);
        assert!(surface.points().iter().all(|p| (p.norm() - 1.0).abs() < 1e-15));
    }
}

#[test]
fn random_stars_are_star_shaped_about_the_origin_and_repeatable() {
    for seed in 0..5 {
        let smooth = Solid::SmoothStar { seed, degree: 4, amplitude: 0.9, resolution: 8 };
        let polyhedral = Solid::PolyhedralStar { seed, amplitude: 0.9, resolution: 2 };
        for solid in [smooth, polyhedral] {
            let surface = solid.surface().unwrap();
            assert_eq!(surface, solid.surface().unwrap());
            let radii = surface.points().iter().map(Vec3::norm);
            assert!(radii.clone().all(|radius| radius <= 1.9 + 1e-15));
            for triangle in surface.ids() {
                let [a, b, c] = surface.corners(triangle);
                assert!(a.dot(&b.cross(&c)) > 0.0);
            }
        }
    }
    let of = |seed| Solid::SmoothStar { seed, degree: 4, amplitude: 0.5, resolution: 4 }.surface().unwrap();
    assert_ne!(of(1), of(2));
    // The extreme radius is attained: max |S| = 1.
    let extreme = of(1).points().iter().map(|p| (p.norm() - 1.0).abs()).fold(0.0, f64::max);
    assert!((extreme - 0.5).abs() < 1e-14);
}

#[test]
fn nonsense_parameters_are_named() {
    let nan = f64::NAN;
    let cases = [
        (Solid::Box { size: [1.0, 0.0, 1.0] }, "size"),
        (Solid::Box { size: [1.0, nan, 1.0] }, "size"),
        (Solid::Prism { sides: 2, height: 1.0 }, "sides"),
        (Solid::Pyramid { sides: 3, height: -1.0 }, "height"),
        (Solid::Bipyramid { sides: 3, height: f64::INFINITY }, "height"),
        (Solid::Ball { radius: nan, resolution: 3 }, "radius"),
        (Solid::Ball { radius: 1.0, resolution: 0 }, "resolution"),
        (Solid::Ellipsoid { radii: [1.0, 1.0, -1.0], resolution: 3 }, "radii"),
        (Solid::Torus { major_radius: 1.0, minor_radius: 1.0, resolution: 8 }, "minor_radius"),
        (Solid::Torus { major_radius: 1.0, minor_radius: 0.5, resolution: 2 }, "resolution"),
        (Solid::SmoothStar { seed: 0, degree: 0, amplitude: 0.5, resolution: 2 }, "degree"),
        (Solid::SmoothStar { seed: 0, degree: 4, amplitude: 1.0, resolution: 2 }, "amplitude"),
        (Solid::PolyhedralStar { seed: 0, amplitude: nan, resolution: 2 }, "amplitude"),
    ];
    for (solid, expected) in cases {
        match solid.surface() {
            Err(SolidError::Parameter { parameter, .. }) => assert_eq!(parameter, expected, "{solid:?}"),
            other => panic!("{solid:?}: {other:?}"),
        }
    }
    let fine = [
        Solid::Ball { radius: 1.0, resolution: u32::MAX },
        Solid::Prism { sides: u32::MAX, height: 1.0 },
        Solid::Torus { major_radius: 1.0, minor_radius: 1e-12, resolution: 8 },
    ];
    assert!(fine.iter().all(|solid| matches!(solid.surface(), Err(SolidError::TooFine { .. }))));
    assert!(matches!(Solid::Box { size: [1e-200, 1e-200, 1e200] }.surface(), Err(SolidError::Surface(_))));
}

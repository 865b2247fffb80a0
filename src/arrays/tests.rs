use super::*;
use crate::mesh::fixtures::{cube, fan};

/// The cube [-1, 1]^3 as a fan of its surface triangles.
fn cube_fan() -> (Vec<[f64; 3]>, Vec<[u32; 4]>) {
    let mesh = fan(&cube(), Vec3::zeros());
    (mesh.points().iter().map(|&p| p.into()).collect(), mesh.tets().iter().map(|tet| tet.map(|v| v.0)).collect())
}

#[test]
fn each_fault_of_an_array_names_its_row() {
    let (points, tets) = cube_fan();
    let refused = |points: &[[f64; 3]], tets: &[[u32; 4]]| {
        ball_map(points, tets, &BallMapSettings::default()).expect_err("a fault").to_string()
    };
    let with = |row: usize, tet: [u32; 4]| {
        let mut tets = tets.clone();
        tets[row] = tet;
        tets
    };
    let mut holey = points.clone();
    holey[3][1] = f64::NAN;
    assert!(refused(&holey, &tets).contains("vertex 3 has a coordinate that is not finite"));
    assert!(refused(&points, &with(5, [0, 1, 2, 99])).contains("tet 5 names vertex 99"));
    assert!(refused(&points, &with(5, [0, 1, 1, 8])).contains("tet 5 names vertex 1 twice"));
    assert!(refused(&points, &[]).contains("no tetrahedra"));
    let short = measure(&points, &tets, &points[1..]).unwrap_err().to_string();
    assert!(short.contains("image has 8 rows, but there are 9 vertices"), "{short}");
    let fixed = optimize(&points, &tets, &points, Some(&[true]), &OptimizeSettings::default());
    assert!(fixed.unwrap_err().to_string().contains("fixed has 1 rows"));
    let infinite = optimize(&points, &tets, &holey, None, &OptimizeSettings::default());
    assert!(infinite.unwrap_err().to_string().contains("row 3 of image"));
    assert!(bounds(&points, &tets, &holey, None).unwrap_err().to_string().contains("row 3 of image"));
    let exponent = BallMapSettings { exponent: 0.0, ..Default::default() };
    assert!(ball_map(&points, &tets, &exponent).unwrap_err().to_string().contains("the exponent is 0"));
}

#[test]
fn tets_keep_their_order_and_are_taken_in_either_orientation() {
    let (points, tets) = cube_fan();
    // A stretch by 2, 1, 1: K_I = 2 and K_O = 4 on every tet, however its vertices are ordered.
    let image: Vec<[f64; 3]> = points.iter().map(|&[x, y, z]| [2.0 * x, y, z]).collect();
    let turned: Vec<[u32; 4]> = tets.iter().map(|&[a, b, c, d]| [b, a, c, d]).collect();
    for tets in [&tets, &turned] {
        let measured = measure(&points, tets, &image).unwrap();
        assert!(measured.flipped.is_empty());
        assert!(measured.k_inner.iter().all(|k| (k - 2.0).abs() < 1e-14));
        assert!(measured.k.iter().all(|k| (k - 4.0).abs() < 1e-14));
    }
    let mut pushed = image.clone();
    pushed[8] = [3.0, 0.0, 0.0];
    let measured = measure(&points, &tets, &pushed).unwrap();
    assert_eq!(measured.flipped.len(), 2);
    assert!(measured.flipped.iter().all(|&tet| measured.k[tet as usize] == f64::INFINITY));
}

#[test]
fn results_do_not_depend_on_the_units_of_the_arrays() {
    let (points, tets) = cube_fan();
    let scaled =
        |rows: &[[f64; 3]], scale: f64| -> Vec<[f64; 3]> { rows.iter().map(|row| row.map(|x| x * scale)).collect() };
    let settings = BallMapSettings { certify: None, ..Default::default() };
    let one = ball_map(&points, &tets, &settings).unwrap();
    for scale in [2f64.powi(900), 2f64.powi(-900)] {
        let other = ball_map(&scaled(&points, scale), &tets, &settings).unwrap();
        assert_eq!((&other.k, &other.image, other.stop), (&one.k, &one.image, one.stop));
        assert_eq!(other.points, scaled(&one.points, scale));
        let optimized = optimize(&points, &tets, &scaled(&one.image, scale), None, &settings.optimize).unwrap();
        let beside = optimize(&points, &tets, &one.image, None, &settings.optimize).unwrap();
        assert_eq!((optimized.k, optimized.image), (beside.k, scaled(&beside.image, scale)));
    }
}

#[test]
fn locked_tets_are_split_unless_the_caller_says_what_is_fixed() {
    // An octahedron as four tets about an axis that joins two boundary vertices.
    let points =
        [[1., 0., 0.], [0., 1., 0.], [-1., 0., 0.], [0., -1., 0.], [0., 0., 1.], [0., 0., -1.]].map(|p: [f64; 3]| p);
    let tets = [[4, 5, 0, 1], [4, 5, 1, 2], [4, 5, 2, 3], [4, 5, 3, 0]];
    let settings = OptimizeSettings::default();
    let map = optimize(&points, &tets, &points, None, &settings).unwrap();
    assert_eq!((map.points.len(), map.tets.len(), map.image.len()), (7, 8, 7));
    assert!(map.summary.max_k < 1.0 + 1e-9 && !map.bounds.is_empty());
    let kept = optimize(&points, &tets, &points, Some(&[true; 6]), &settings).unwrap();
    assert_eq!((kept.tets.len(), kept.stop), (4, StopReason::NothingFree));
}

#[test]
fn a_surface_is_filled_and_its_boundary_goes_where_it_is_asked_to() {
    let (points, triangles) = cube();
    let points: Vec<[f64; 3]> = points.iter().map(|&p| p.into()).collect();
    let triangles: Vec<[u32; 3]> =
        triangles.iter().flat_map(|p| (2..p.len()).map(|i| [p[0], p[i - 1], p[i]])).collect();
    let mut settings = BallMapSettings::default();
    settings.optimize.max_iterations = 3;
    let of = |settings: &BallMapSettings| {
        ball_map_of_surface(&points, &triangles, Some(500), settings, &mut |_| {}).unwrap()
    };
    let radial = of(&settings);
    assert!(radial.tets.len() >= 500 && radial.bijective);
    // The radial map keeps the direction of a boundary vertex, here from the centre 0.
    let kept = |map: &MappedMesh| {
        let pairs = map.points.iter().zip(&map.image).map(|(&p, &q)| (Vec3::from(p), Vec3::from(q)));
        pairs.filter(|(_, q)| q.norm() > 1.0 - 1e-12).all(|(p, q)| (p.normalize() - q).norm() < 1e-9)
    };
    assert!(kept(&radial));
    settings.boundary = BoundaryMap::Spherical;
    let spherical = of(&settings);
    assert!(!kept(&spherical) && spherical.bijective && spherical.points == radial.points);
}

#[test]
fn a_start_that_resists_has_others_that_may_take_its_place() {
    let domain = Domain::new(fan(&cube(), Vec3::zeros())).unwrap();
    let radial = || Some((Vec3::zeros(), domain.mesh().points().to_vec()));
    let start = |radial, boundary| BallStart::new(domain.clone(), radial, boundary).unwrap();
    let first = start(radial(), BoundaryMap::Auto);
    let spherical = first.in_spherical().expect("a cube has no handles");
    assert!(first.centre.is_some() && spherical.centre.is_none() && spherical.second.is_some());
    assert_eq!(spherical.image, start(None, BoundaryMap::Spherical).image);
    let over_collar = spherical.over_collar().expect("a cube is a ball");
    // The vertices that were given come first, and the collar has up to as many tets again.
    let points = over_collar.domain.mesh().points();
    assert!((13..=24).contains(&over_collar.domain.mesh().tets().len()) && points.len() == over_collar.image.len());
    assert_eq!(points[..9], *domain.mesh().points());
    assert!(spherical.in_spherical().is_none() && over_collar.over_collar().is_none());
    let kept = start(radial(), BoundaryMap::Radial);
    assert!(kept.in_spherical().is_none() && kept.over_collar().is_none());
}

use super::*;
use crate::solid::Solid;
use crate::solid::kernel::tests::prism_over;

#[test]
fn the_smallest_angle_of_the_cube_points_at_its_corners() {
    let cube = Solid::Cube.surface().unwrap();
    for choice in
        [CentreChoice::Kernel, CentreChoice::Centroid, CentreChoice::BoundingBox, CentreChoice::At(Vec3::zeros())]
    {
        let centre = star_centre(&cube, &choice).unwrap();
        assert!((centre.smallest_angle - (1.0 / 3f64.sqrt()).asin()).abs() < 1e-6, "{centre:?}");
        assert!((centre.kernel_radius - 1.0).abs() < 1e-7);
    }
}

#[test]
fn a_centre_outside_is_refused_with_the_nearest_one_inside() {
    let cube = Solid::Cube.surface().unwrap();
    let refused = star_centre(&cube, &CentreChoice::At(Vec3::new(3.0, 0.0, 0.5)));
    let Err(CentreError::Outside { count: 8, faces, nearest, .. }) = refused else { panic!("{refused:?}") };
    assert!(faces.iter().all(|&face| (cube.normal(crate::mesh::TriangleId(face)) - Vec3::x()).norm() < 1e-15));
    // 1 % of the radius inside the face x = 1.
    assert!((Vec3::from(nearest) - Vec3::new(0.99, 0.0, 0.5)).norm() < 1e-6, "{nearest:?}");
    star_centre(&cube, &CentreChoice::At(nearest.into())).unwrap();
}

#[test]
fn a_centre_in_the_plane_of_a_face_is_refused() {
    let outline = [[0., 0.], [2., 0.], [2., 1.], [1., 1.], [1., 2.], [0., 2.]];
    let block = prism_over(&outline, &[&[0, 1, 2, 3, 4, 5]]);
    let at = |x, y| star_centre(&block, &CentreChoice::At(Vec3::new(x, y, 0.5)));
    assert!(at(0.999, 0.5).is_ok());
    assert!(matches!(at(1.0, 0.5), Err(CentreError::Outside { count: 2, .. })));
    assert!(matches!(at(1.5, 0.5), Err(CentreError::Outside { count: 2, .. })));
    assert!(matches!(at(f64::NAN, 0.5), Err(CentreError::NotFinite(_))));
    // The bounding box centre is the inner corner itself.
    assert!(matches!(star_centre(&block, &CentreChoice::BoundingBox), Err(CentreError::Outside { count: 4, .. })));
}

#[test]
fn a_far_away_centre_still_gets_a_suggestion() {
    let cube = Solid::Cube.surface().unwrap();
    let refused = star_centre(&cube, &CentreChoice::At(Vec3::repeat(1e30)));
    let Err(CentreError::Outside { nearest, .. }) = refused else { panic!("{refused:?}") };
    star_centre(&cube, &CentreChoice::At(nearest.into())).unwrap();
}

#[cfg(not(feature = "nlopt"))]
#[test]
fn without_nlopt_the_optimal_centre_is_refused() {
    let cube = Solid::Cube.surface().unwrap();
    assert_eq!(star_centre(&cube, &CentreChoice::Optimize), Err(CentreError::NotBuiltIn));
}

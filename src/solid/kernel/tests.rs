use super::*;
use crate::mesh::{PolygonSoup, VertexId};
use crate::solid::Solid;
use crate::solid::platonic::GOLDEN;

/// Twice the worst accuracy that counts as solved.
const TOLERANCE: f64 = 2.0 * WORST_ACCURACY;

fn surface(points: Vec<Vec3>, polygons: &[&[u32]]) -> Surface {
    let polygons = polygons.iter().map(|polygon| polygon.iter().copied().map(VertexId).collect()).collect();
    Surface::from_soup(PolygonSoup::new(points, polygons)).unwrap()
}

/// The prism of height 1 over an outline, counter-clockwise seen from above, with caps cut into the given polygons.
pub(crate) fn prism_over(outline: &[[f64; 2]], caps: &[&[u32]]) -> Surface {
    let n = outline.len() as u32;
    let points = [0.0, 1.0].iter().flat_map(|&z| outline.iter().map(move |&[x, y]| Vec3::new(x, y, z))).collect();
    let mut polygons: Vec<Vec<u32>> = (0..n).map(|i| vec![i, (i + 1) % n, (i + 1) % n + n, i + n]).collect();
    for cap in caps {
        polygons.push(cap.iter().rev().copied().collect());
        polygons.push(cap.iter().map(|v| v + n).collect());
    }
    surface(points, &polygons.iter().map(Vec::as_slice).collect::<Vec<_>>())
}

/// A block with a slot: U-shaped seen from above.
fn u_block() -> Surface {
    let outline = [[0., 0.], [1., 0.], [2., 0.], [3., 0.], [3., 3.], [2., 3.], [2., 1.], [1., 1.], [1., 3.], [0., 3.]];
    prism_over(&outline, &[&[0, 1, 7, 8, 9], &[1, 2, 6, 7], &[2, 3, 4, 5, 6]])
}

#[test]
fn the_kernel_of_a_regular_polyhedron_is_itself() {
    let root = f64::sqrt;
    let inradii = [
        (Solid::Tetrahedron, 1.0 / root(3.0)),
        (Solid::Cube, 1.0),
        (Solid::Octahedron, 1.0 / root(3.0)),
        (Solid::Dodecahedron, GOLDEN * GOLDEN / root(GOLDEN * GOLDEN + 1.0)),
        (Solid::Icosahedron, GOLDEN * GOLDEN / root(3.0)),
    ];
    for (solid, inradius) in inradii {
        let kernel = StarKernel::of(&solid.surface().unwrap()).unwrap();
        assert!((kernel.radius - inradius).abs() < TOLERANCE * 2.0, "{solid:?}: {kernel:?}");
        assert!(kernel.centre.norm() < 1e-6, "{solid:?}: {kernel:?}");
    }
}

#[test]
fn scale_and_place_do_not_matter() {
    let cube = Solid::Cube.surface().unwrap();
    for (scale, shift) in [(1e-6, 0.0), (1e6, 0.0), (1.0, 1e4)] {
        let points = cube.points().iter().map(|p| scale * p + Vec3::repeat(shift)).collect();
        let polygons = cube.triangles().iter().map(|t| t.to_vec()).collect();
        let kernel = StarKernel::of(&Surface::from_soup(PolygonSoup::new(points, polygons)).unwrap()).unwrap();
        assert!((kernel.radius / scale - 1.0).abs() < 1e-7, "{kernel:?}");
    }
}

#[test]
fn an_l_has_the_square_at_its_corner_as_kernel() {
    let outline = [[0., 0.], [2., 0.], [2., 1.], [1., 1.], [1., 2.], [0., 2.]];
    let kernel = StarKernel::of(&prism_over(&outline, &[&[0, 1, 2, 3, 4, 5]])).unwrap();
    assert!((kernel.radius - 0.5).abs() < TOLERANCE * 2.0);
    assert!((kernel.centre - Vec3::repeat(0.5)).norm() < 1e-6);
}

#[test]
fn a_u_is_refused_with_the_faces_that_conflict() {
    let block = u_block();
    let Err(KernelError::NotStarShaped { faces, .. }) = StarKernel::of(&block) else {
        panic!("a U-shaped block is not star-shaped");
    };
    // The walls of the slot face each other: x < 1 from one, x > 2 from the other.
    let mut walls: Vec<[f64; 2]> = faces
        .iter()
        .map(|&face| {
            let normal = block.normal(TriangleId(face));
            [normal.x, block.corners(TriangleId(face))[0].x]
        })
        .collect();
    walls.sort_by(|a, b| a[0].total_cmp(&b[0]));
    assert_eq!(walls, [[-1.0, 2.0], [1.0, 1.0]]);
}

#[test]
fn a_torus_is_refused() {
    let torus = Solid::Torus { major_radius: 2.0, minor_radius: 1.0, resolution: 12 }.surface().unwrap();
    assert_eq!(StarKernel::of(&torus), Err(KernelError::Handles { handles: 1 }));
}

#[test]
fn a_surface_that_winds_twice_is_refused() {
    // A bipyramid over a pentagram: every face is seen from within, but the ring goes round twice.
    let corner = |i: u32| (f64::from(i) * 4.0 * std::f64::consts::PI / 5.0).sin_cos();
    let mut points: Vec<Vec3> = (0..5).map(|i| Vec3::new(corner(i).1, corner(i).0, 0.0)).collect();
    points.extend([Vec3::z(), -Vec3::z()]);
    let faces: Vec<[u32; 3]> = (0..5).flat_map(|i| [[i, (i + 1) % 5, 5], [(i + 1) % 5, i, 6]]).collect();
    let pentagram = surface(points, &faces.iter().map(<[u32; 3]>::as_slice).collect::<Vec<_>>());
    assert_eq!(pentagram.genus(), 0);
    assert_eq!(StarKernel::of(&pentagram), Err(KernelError::WindsAround { times: 2 }));
}

#[test]
fn fifty_thousand_triangles_have_a_kernel() {
    let ball = Solid::Ball { radius: 1.0, resolution: 50 }.surface().unwrap();
    let kernel = StarKernel::of(&ball).unwrap();
    // The planes' distances lie between those of the smallest and the largest triangle, about edge^2 / 6 below 1.
    assert!(kernel.radius > 0.9997 && kernel.radius < 1.0 && kernel.centre.norm() < 1e-4, "{kernel:?}");
}

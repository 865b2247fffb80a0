//! From a surface file to a star centre.

use std::f64::consts::PI;
use std::path::Path;

use qcball::Domain;
use qcball::mesh::io::read_surface;
use qcball::mesh::{BoundaryEdges, Features, Vec3};
use qcball::solid::{CentreChoice, ShellSettings, StarKernel, Surface, radial_max_dilatation, shell_mesh, star_centre};

#[test]
fn the_gem_is_a_star_shaped_non_convex_polyhedron() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/solids/gem.obj");
    let soup = read_surface(&path).unwrap();
    assert_eq!((soup.points.len(), soup.polygons.len()), (31, 31));
    let gem = Surface::from_soup(soup).unwrap();
    assert_eq!((gem.genus(), gem.was_inside_out()), (0, false));
    // The six upright inner edges of the girdle are concave, and no others.
    let concave = gem.edges().iter().filter(|edge| gem.dihedral_angle(edge) > PI + 1e-6).count();
    assert_eq!(concave, 6);

    let kernel = StarKernel::of(&gem).unwrap();
    let settings = ShellSettings { subdivisions: 1, refinement: None, layers: 1, grading: 1.0 };
    let domain = Domain::new(shell_mesh(&gem, kernel.centre, &settings).unwrap().mesh).unwrap();
    let (mesh, boundary) = (domain.mesh(), domain.boundary());
    // The fans of the kites and quadrilaterals are one flat face each.
    assert_eq!(Features::of(mesh, boundary, &BoundaryEdges::of(mesh, boundary)).flat_faces(), 31);

    // By symmetry the centre is on the axis; the largest ball touches the girdle's walls from tip (1.5, 0) to inner corner
    // (cos 30, sin 30), whose planes are all upright: the distance of the axis from them.
    let wall = 1.5 * 0.5 / (1.5f64 - 0.75f64.sqrt()).hypot(0.5);
    assert!(kernel.radius < wall && kernel.centre.xy().norm() < 1e-6, "{kernel:?}");

    for choice in [CentreChoice::Kernel, CentreChoice::Centroid, CentreChoice::At(Vec3::zeros())] {
        let centre = star_centre(&gem, &choice).unwrap();
        assert!(centre.smallest_angle > 0.1 && radial_max_dilatation(&gem, &centre.position, 1.0).is_finite());
    }
    assert!(star_centre(&gem, &CentreChoice::At(Vec3::new(1.2, 0.0, 0.0))).is_err());
}

use std::f64::consts::{FRAC_PI_2, PI};

use super::*;

/// Axis-parallel cubes [0, 1]^3 shifted, as quads that face outward.
fn cubes(shifts: &[[f64; 3]]) -> PolygonSoup {
    let mut soup = PolygonSoup::new(vec![], vec![]);
    for &shift in shifts {
        let first = soup.points.len() as u32;
        soup.points.extend(
            (0..8).map(|i| Vec3::from(shift) + Vec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2))),
        );
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        soup.polygons.extend(quads.map(|quad| quad.map(|v: u32| VertexId(first + v)).to_vec()));
    }
    soup
}

fn cube() -> PolygonSoup {
    cubes(&[[0.0; 3]])
}

/// Makes vertices with equal coordinates one.
fn welded(mut soup: PolygonSoup) -> PolygonSoup {
    let first = |v: VertexId| soup.points.iter().position(|p| *p == soup.points[v.index()]).unwrap() as u32;
    let polygons = soup.polygons.iter().map(|polygon| polygon.iter().map(|&v| VertexId(first(v))).collect()).collect();
    soup.polygons = polygons;
    soup
}

#[test]
fn the_unit_cube_measures_as_it_should() {
    let surface = Surface::from_soup(cube()).unwrap();
    assert_eq!((surface.points().len(), surface.triangles().len(), surface.edges().len()), (8, 12, 18));
    assert_eq!((surface.genus(), surface.was_inside_out()), (0, false));
    assert!((surface.volume() - 1.0).abs() < 1e-15 && (surface.area() - 6.0).abs() < 1e-14);
    assert!((surface.centroid() - Vec3::repeat(0.5)).norm() < 1e-15);
    assert_eq!(surface.bounding_box(), (Vec3::zeros(), Vec3::repeat(1.0)));
    let (right, flat): (Vec<f64>, Vec<f64>) = surface
        .edges()
        .iter()
        .map(|edge| surface.dihedral_angle(edge))
        .partition(|angle| (angle - FRAC_PI_2).abs() < 1e-15);
    assert_eq!((right.len(), flat), (12, vec![PI; 6]));
}

#[test]
fn concave_edges_have_more_than_a_straight_angle() {
    // An L of three cubes, its inner faces removed by hand: a prism over an L with caps of three squares each.
    let outline = [[0., 0.], [2., 0.], [2., 1.], [1., 1.], [1., 2.], [0., 2.]];
    let points = [0.0, 1.0].iter().flat_map(|&z| outline.map(|[x, y]| Vec3::new(x, y, z))).collect();
    let mut polygons: Vec<Vec<u32>> = (0..6).map(|i| vec![i, (i + 1) % 6, (i + 1) % 6 + 6, i + 6]).collect();
    polygons.push(vec![0, 5, 4, 3, 2, 1]);
    polygons.push(vec![6, 7, 8, 9, 10, 11]);
    let polygons = polygons.into_iter().map(|polygon| polygon.into_iter().map(VertexId).collect()).collect();
    let surface = Surface::from_soup(PolygonSoup::new(points, polygons)).unwrap();
    assert!((surface.volume() - 3.0).abs() < 1e-14);
    let concave = surface.edges().iter().map(|edge| surface.dihedral_angle(edge)).fold(0.0, f64::max);
    assert!((concave - 3.0 * FRAC_PI_2).abs() < 1e-15);
}

#[test]
fn an_inside_out_surface_is_reversed_and_remembered() {
    let mut soup = cube();
    soup.polygons.iter_mut().for_each(|polygon| polygon.reverse());
    let surface = Surface::from_soup(soup).unwrap();
    assert!(surface.was_inside_out() && surface.volume() > 0.0);
    assert!(surface.edges().iter().all(|edge| {
        let [from, to] = edge.vertices;
        let runs = |triangle: TriangleId, a, b| {
            let t = surface.triangles()[triangle.index()];
            (0..3).any(|i| (t[i], t[(i + 1) % 3]) == (a, b))
        };
        runs(edge.triangles[0], from, to) && runs(edge.triangles[1], to, from)
    }));
}

#[test]
fn unused_vertices_are_dropped() {
    let mut soup = cube();
    soup.points.insert(0, Vec3::repeat(7.0));
    soup.polygons.iter_mut().flatten().for_each(|v| v.0 += 1);
    assert_eq!(Surface::from_soup(soup).unwrap(), Surface::from_soup(cube()).unwrap());
}

#[test]
fn faults_are_named() {
    let refuse = |change: &dyn Fn(&mut PolygonSoup)| {
        let mut soup = cube();
        change(&mut soup);
        Surface::from_soup(soup).unwrap_err()
    };
    assert_eq!(refuse(&|soup| soup.polygons.clear()), SurfaceError::Empty);
    assert_eq!(refuse(&|soup| soup.points[3].y = f64::NAN), SurfaceError::NotFinite { vertex: 3 });
    assert_eq!(
        refuse(&|soup| soup.polygons[2][1] = VertexId(8)),
        SurfaceError::VertexOutOfRange { polygon: 2, vertex: 8, count: 8 }
    );
    // A bow tie.
    assert_eq!(
        refuse(&|soup| soup.polygons[2].swap(0, 1)),
        SurfaceError::BadPolygon { polygon: 2, fault: PolygonError::NotCut }
    );
    assert_eq!(
        refuse(&|soup| {
            soup.polygons.pop();
        }),
        SurfaceError::Open { count: 4, from: [1., 0., 0.], to: [1., 1., 0.] }
    );
    assert!(matches!(refuse(&|soup| soup.polygons[3].reverse()), SurfaceError::InconsistentOrientation { .. }));
    let doubled = refuse(&|soup| soup.polygons.push(soup.polygons[0].clone()));
    assert!(matches!(doubled, SurfaceError::OverusedEdge { count: 3 | 4, .. }));
    assert_eq!(
        refuse(&|soup| { *soup = cubes(&[[0.0; 3], [3.0; 3]]) }),
        SurfaceError::Disconnected { count: 2, triangles: 12, at: [0.0; 3] }
    );
    assert_eq!(
        refuse(&|soup| { *soup = welded(cubes(&[[0.0; 3], [1.0; 3]])) }),
        SurfaceError::PinchedVertex { sheets: 2, at: [1.0; 3] }
    );
    let sheet = |soup: &mut PolygonSoup| {
        soup.polygons = [[0, 1, 2], [0, 2, 1]].map(|triangle| triangle.map(VertexId).to_vec()).into();
    };
    assert_eq!(refuse(&sheet), SurfaceError::NoVolume);
}

use super::*;
use crate::map::AnalyticMap;
use crate::mesh::{TetId, TetMesh, VertexId, VoxelMesh};
use crate::solid::{ShellSettings, Solid, Surface, Voxels, shell_mesh, voxelize};

const ESTIMATORS: [Estimator; 4] =
    [Estimator::Paper, Estimator::VolumeRatio, Estimator::Gradient, Estimator::LengthRatio];

fn tets() -> TetMesh {
    let settings = ShellSettings { subdivisions: 1, refinement: None, layers: 3, grading: 1.3 };
    shell_mesh(&Solid::Dodecahedron.surface().unwrap(), Vec3::new(0.05, 0.1, -0.1), &settings).unwrap().mesh
}

/// Turned so that its plane is parallel to the xz-plane, and moved to (0, 2, 0) (paper §3.5).
fn torus(major_radius: f64, minor_radius: f64, resolution: u32) -> Surface {
    let upright = Solid::Torus { major_radius, minor_radius, resolution }.surface().unwrap();
    let points = upright.points().iter().map(|p| Vec3::new(p.x, 2.0 - p.z, p.y)).collect();
    let polygons = upright.triangles().iter().map(|triangle| triangle.to_vec()).collect();
    let surface = Surface::from_soup(crate::mesh::PolygonSoup::new(points, polygons)).unwrap();
    assert!(!surface.was_inside_out() && surface.genus() == 1);
    surface
}

fn voxels(surface: &Surface, text: &str) -> VoxelMesh {
    voxelize(surface, text.parse::<Voxels>().unwrap()).unwrap()
}

fn linear() -> Mat3 {
    Mat3::new(1.2, 0.3, -0.5, 0.1, 0.8, 0.4, -0.2, 0.6, 1.5)
}

#[test]
fn linear_maps_have_their_jacobian_on_tets_boxes_and_parallelepipeds() {
    let (tets, boxes) = (tets(), voxels(&torus(1.0, 0.5, 12), "voxel(6,3,7;1;3)"));
    let shear = Mat3::new(1.0, 0.4, 0.2, 0.0, 0.9, -0.3, 0.0, 0.1, 1.1);
    let sheared: Vec<Vec3> = boxes.points().iter().map(|p| shear * p).collect();
    let mirror = Mat3::from_diagonal(&Vec3::new(1.0, 1.0, -1.0));
    for (cells, domain) in [
        (Cells::from(&tets), tets.points()),
        (Cells::from(&boxes), boxes.points()),
        (Cells::from(&boxes), sheared.as_slice()),
    ] {
        for map in [linear(), mirror * linear()] {
            let image: Vec<Vec3> = domain.iter().map(|p| map * p + Vec3::new(1.0, -2.0, 0.5)).collect();
            let (determinant, values) = (map.determinant(), svd(&map).values.map(f64::abs));
            let exact = |estimate: &Estimate, estimator| {
                // Cells of condition below 50 and positions of order 1 in cells of size 0.05: 1e-13.
                assert!((estimate.jacobian - determinant).abs() < 1e-12, "{estimator:?} {estimate:?} {determinant}");
                let [over, under] = [estimate.largest - values[0], values[2] - estimate.least];
                assert!(over < 1e-12 && under < 1e-12, "{estimator:?} {estimate:?} {values:?}");
                match estimator {
                    Estimator::VolumeRatio | Estimator::Gradient => assert!(over > -1e-12 && under > -1e-12),
                    // The share of directions within an angle d of a given line is about d^2 / 2, of 1000 one in e^-10 has
                    // none within d^2 = 0.02; |A h| is then off by d^2 of the spread of squares at most.
                    Estimator::Paper => {
                        assert!(over > -0.02 * values[0] && under > -0.02 * values[0] * values[0] / values[2])
                    }
                    Estimator::LengthRatio => {}
                }
            };
            for estimator in ESTIMATORS {
                on_cells(cells, domain, &image, estimator).iter().for_each(|estimate| exact(estimate, estimator));
                for weights in Weights::ALL {
                    let estimates = at_vertices(cells, domain, &image, estimator, weights);
                    estimates.iter().for_each(|(_, estimate)| exact(estimate, estimator));
                }
            }
        }
    }
}

/// A map that is not linear, so that formulas can differ.
fn bent(points: &[Vec3]) -> Vec<Vec3> {
    points.iter().map(|p| linear() * p + 0.2 * Vec3::new(p.y * p.z, p.x * p.x, p.x * p.y * p.z)).collect()
}

#[test]
fn gradients_are_the_papers_formulas() {
    // Eq. 28: the sum over the vertices of the inward area-scaled normal of the opposite face times the value, over 3m.
    let mesh = tets();
    let image = bent(mesh.points());
    for tet in 0..mesh.tets().len() {
        let corners = mesh.corners(TetId(tet as u32));
        let volume = measure(Cells::from(&mesh), tet, mesh.points());
        let sum = TetMesh::FACES.iter().zip(mesh.tets()[tet]).fold(Mat3::zeros(), |sum, (face, v)| {
            let [a, b, c] = face.map(|i| corners[i]);
            let inward = -0.5 * (b - a).cross(&(c - a));
            sum + image[v.index()] * inward.transpose()
        });
        let difference = sum / (3.0 * volume) - gradient(Cells::from(&mesh), tet, mesh.points(), &image);
        assert!(difference.norm() < 1e-12);
    }
    // Eq. 33 on boxes: signs of v - centre times the areas of the sides.
    let mesh = voxels(&torus(1.0, 0.5, 12), "voxel(6,3,7;1;3)");
    let image = bent(mesh.points());
    for (index, cell) in mesh.cells().iter().enumerate() {
        let size = mesh.points()[cell[7].index()] - mesh.points()[cell[0].index()];
        let areas = Vec3::new(size.y * size.z, size.x * size.z, size.x * size.y);
        let sum = (0..8).fold(Mat3::zeros(), |sum, i| {
            let sign = Vec3::from_fn(|axis, _| if i >> axis & 1 == 1 { 1.0 } else { -1.0 });
            sum + image[cell[i].index()] * areas.component_mul(&sign).transpose()
        });
        let difference = sum / (4.0 * size.product()) - gradient(Cells::from(&mesh), index, mesh.points(), &image);
        assert!(difference.norm() < 1e-12);
    }
    // Eq. 31 on parallelepipeds: for each face its area-scaled normal, towards the opposite face, times that face's values.
    let shear = Mat3::new(1.0, 0.4, 0.2, 0.0, 0.9, -0.3, 0.0, 0.1, 1.1);
    let domain: Vec<Vec3> = mesh.points().iter().map(|p| shear * p).collect();
    let cells = Cells::from(&mesh);
    for (index, cell) in mesh.cells().iter().enumerate() {
        let corner = |i: usize| domain[cell[i].index()];
        let mut sum = Mat3::zeros();
        for axis in 0..3 {
            let (next, last) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
            let area = (corner(next) - corner(0)).cross(&(corner(last) - corner(0)));
            for upper in [0, 1] {
                // The face on one side of the axis takes the values of the other.
                let inward = if upper == 0 { area } else { -area };
                let opposite = (0..8).filter(|i| i >> axis & 1 == 1 - upper);
                let values: Vec3 = opposite.map(|i| image[cell[i].index()]).sum();
                sum += values * inward.transpose();
            }
        }
        let volume = measure(cells, index, &domain);
        assert!((sum / (4.0 * volume) - gradient(cells, index, &domain, &image)).norm() < 1e-12);
    }
}

#[test]
fn the_weights_are_those_of_table_1() {
    // Two tets at vertex 0: a corner of the unit cube and one twice as high beside it, of half the angle or so.
    let points = vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z(), Vec3::new(-2.0, 0.0, 0.0)];
    let tets = vec![[0, 1, 2, 3].map(VertexId), [0, 2, 4, 3].map(VertexId)];
    let mesh = TetMesh::new(points, tets).unwrap();
    // Stretched by 3 on one side of x = 0 and by 5 on the other: the Jacobians are 3 and 5.
    let image: Vec<Vec3> =
        mesh.points().iter().map(|p| Vec3::new(if p.x > 0.0 { 3.0 } else { 5.0 } * p.x, p.y, p.z)).collect();
    let at_0 =
        |weights| at_vertices(Cells::from(&mesh), mesh.points(), &image, Estimator::VolumeRatio, weights)[0].1.jacobian;
    // Volumes 1/6 and 1/3, solid angles pi/2 both at vertex 0.
    assert!((at_0(Weights::Equal) - 4.0).abs() < 1e-14);
    assert!((at_0(Weights::Measure) - (3.0 + 2.0 * 5.0) / 3.0).abs() < 1e-14);
    assert!((at_0(Weights::SolidAngle) - 4.0).abs() < 1e-14);
    assert!((at_0(Weights::SolidAnglePerMeasure) - (3.0 + 0.5 * 5.0) / 1.5).abs() < 1e-14);
    // At vertex 2 = (0, 1, 0) the solid angles are those of the tets seen from there.
    let angle = |a: usize, b: usize, c: usize| {
        let [a, b, c] = [a, b, c].map(|i| (mesh.points()[i] - Vec3::y()).normalize());
        2.0 * (a.dot(&b.cross(&c)).abs()).atan2(1.0 + a.dot(&b) + b.dot(&c) + c.dot(&a))
    };
    let (first, second) = (angle(0, 1, 3), angle(0, 4, 3));
    let at_2 = at_vertices(Cells::from(&mesh), mesh.points(), &image, Estimator::VolumeRatio, Weights::SolidAngle)[2].1;
    assert!((at_2.jacobian - (3.0 * first + 5.0 * second) / (first + second)).abs() < 1e-14);
}

#[test]
fn hanging_nodes_and_unused_vertices_are_no_trouble() {
    let mesh = voxels(&torus(1.0, 0.5, 12), "cubic(10;1;2)");
    let mut points = mesh.points().to_vec();
    points.push(Vec3::repeat(f64::NAN));
    let estimates = at_vertices(Cells::from(&mesh), &points, &points, Estimator::Paper, Weights::Equal);
    assert_eq!(estimates.len(), mesh.points().len());
    assert!(estimates.iter().all(|(_, estimate)| (estimate.dilatation().k() - 1.0).abs() < 1e-12));
}

/// Paper Table 2: foldings of a torus parallel to the xz-plane, centred at (0, 2, 0). The paper gives no radii; ours are 1 and
/// 0.5, so that the torus lies in the half-space y >= 1.5 and its azimuth below pi.
#[test]
fn table_2_voxels_are_within_half_a_percent_of_the_exact_dilatation() {
    let mesh = voxels(&torus(1.0, 0.5, 48), "cubic(10;2;2)");
    for (ratio, paper, exact) in [("0.5", 3.996, 4.0), ("1.5", 2.249, 2.25), ("2", 3.997, 4.0)] {
        let map = AnalyticMap::from_words("folding", &[format!("ratio={ratio}")]).unwrap();
        let image = map.apply(mesh.points()).unwrap();
        assert_eq!(map.max_dilatation().unwrap().k(), exact);
        let cells = Cells::from(&mesh);
        let at = |estimator| {
            let estimates: Vec<Estimate> = at_vertices(cells, mesh.points(), &image, estimator, Weights::Equal)
                .into_iter()
                .map(|(_, estimate)| estimate)
                .collect();
            EstimateSummary::of(&estimates).max_k
        };
        let per_cell = EstimateSummary::of(&on_cells(cells, mesh.points(), &image, Estimator::Gradient)).max_k;
        let (as_paper, by_svd) = (at(Estimator::Paper), at(Estimator::VolumeRatio));
        println!(
            "{ratio}: paper {paper} | {as_paper:.4} | by SVD {by_svd:.4} | gradient {:.4} | lengths {:.4} | cells {per_cell:.4} | {exact}",
            at(Estimator::Gradient),
            at(Estimator::LengthRatio)
        );
        for value in [as_paper, by_svd, per_cell] {
            assert!((value / exact - 1.0).abs() < 5e-3, "{ratio}: {value} {exact}");
        }
    }
}

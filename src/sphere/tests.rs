use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};

use super::rings::Rings;
use super::simplify::simplify;
use super::*;
use crate::mesh::{PolygonSoup, VertexId};
use crate::solid::Solid;

/// The surface of a set of unit cubes that touch in faces only.
fn polycube(cells: &[[i32; 3]]) -> Surface {
    let mut points: Vec<[i32; 3]> = Vec::new();
    let mut polygons = Vec::new();
    for cell in cells {
        for axis in 0..3 {
            for side in [0, 1] {
                let mut other = *cell;
                other[axis] += 2 * side - 1;
                if cells.contains(&other) {
                    continue;
                }
                let mut corners = [[0, 0], [1, 0], [1, 1], [0, 1]];
                if side == 0 {
                    corners.reverse();
                }
                let polygon = corners.map(|[a, b]| {
                    let mut corner = *cell;
                    corner[axis] += side;
                    corner[(axis + 1) % 3] += a;
                    corner[(axis + 2) % 3] += b;
                    let known = points.iter().position(|p| *p == corner);
                    VertexId(known.unwrap_or_else(|| {
                        points.push(corner);
                        points.len() - 1
                    }) as u32)
                });
                polygons.push(polygon.to_vec());
            }
        }
    }
    let points = points.iter().map(|p| Vec3::from(p.map(f64::from))).collect();
    Surface::from_soup(PolygonSoup::new(points, polygons)).unwrap()
}

/// A square spiral of five turns with an end that climbs out of its plane: 4 of 5 radial maps of it are folded.
fn spiral() -> Surface {
    let mut cells = vec![[0, 0, 0]];
    let mut push = |step: [i32; 3], count: usize| {
        for _ in 0..count {
            let last: [i32; 3] = cells[cells.len() - 1];
            cells.push([0, 1, 2].map(|i| last[i] + step[i]));
        }
    };
    for turn in 0..10 {
        let step = [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]][turn % 4];
        push(step, 2 * (turn / 2 + 1));
    }
    push([0, 0, 1], 3);
    polycube(&cells)
}

#[test]
fn every_surface_without_handles_is_mapped_one_to_one() {
    let solids = [
        Solid::Tetrahedron,
        Solid::Cube,
        Solid::Icosahedron,
        Solid::PolyhedralStar { resolution: 3, amplitude: 0.7, seed: 5 },
    ];
    let surfaces = solids.iter().map(|solid| solid.surface().unwrap()).chain([spiral()]);
    for surface in surfaces {
        let map = sphere_map(&surface, &SphereSettings::default()).unwrap();
        assert!(map.positions().iter().all(|p| (p.norm() - 1.0).abs() < 1e-15));
        // What the constructor proved, seen from here: the areas of the spherical triangles add up to the sphere once.
        let corners = surface.triangles().iter().map(|triangle| triangle.map(|v| &map.positions()[v.index()]));
        assert_eq!(View::from(&Vec3::zeros(), corners), View::Covers(1));
        assert_eq!(sphere_map(&surface, &SphereSettings::default()).unwrap(), map);
    }
}

#[test]
fn a_sphere_is_mapped_by_a_similarity_nearly() {
    // The identity has the least energy of all maps, with a stretch of 1 everywhere.
    let surface = Solid::Ball { radius: 3.0, resolution: 6 }.surface().unwrap();
    let map = sphere_map(&surface, &SphereSettings::default()).unwrap();
    let distortion = SphereDistortion::of(&surface, map.positions());
    assert!(distortion.max_stretch < 1.1 && distortion.mean_stretch < 1.02, "{distortion:?}");
}

#[test]
fn a_weight_of_areas_keeps_them_at_the_cost_of_angles() {
    let surface = Solid::SmoothStar { degree: 4, amplitude: 0.5, resolution: 6, seed: 2 }.surface().unwrap();
    let [angles, areas] = [0.0, 1.0].map(|area_weight| {
        let settings = SphereSettings { area_weight, ..SphereSettings::default() };
        SphereDistortion::of(&surface, sphere_map(&surface, &settings).unwrap().positions())
    });
    assert!(areas.log_area_deviation < 0.7 * angles.log_area_deviation, "{areas:?} {angles:?}");
    assert!(areas.mean_stretch > angles.mean_stretch);
}

#[test]
fn distortion_of_a_known_map() {
    let surface = Solid::Cube.surface().unwrap();
    let image: Vec<Vec3> = surface.points().iter().map(|p| Vec3::new(2.0 * p.x, p.y, p.z)).collect();
    // Stretched by two along x: the faces across x keep their shape, the other two thirds have s1 / s2 = 2.
    let distortion = SphereDistortion::of(&surface, &image);
    assert!((distortion.max_stretch - 2.0).abs() < 1e-12 && (distortion.mean_stretch - 5.0 / 3.0).abs() < 1e-12);
}

#[test]
fn handles_and_weights_are_refused() {
    let torus = Solid::Torus { major_radius: 2.0, minor_radius: 1.0, resolution: 6 }.surface().unwrap();
    let refused = sphere_map(&torus, &SphereSettings::default());
    assert_eq!(refused, Err(SphereError::Genus { genus: 1 }));
    let settings = SphereSettings { area_weight: -1.0, ..SphereSettings::default() };
    let refused = sphere_map(&Solid::Cube.surface().unwrap(), &settings);
    assert_eq!(refused, Err(SphereError::Weight { name: "area weight", value: -1.0 }));
}

/// The surface with its cheapest edges contracted until `left` vertices remain.
fn decimated(surface: &Surface, left: usize) -> Surface {
    let mut rings = Rings::of(surface);
    simplify(surface.points(), &mut rings, left).expect("genus 0");
    let triangles = (0..surface.points().len() as u32).flat_map(|v| {
        let ring = rings.of_vertex(v);
        let next = ring.iter().cycle().skip(1);
        ring.iter().zip(next).filter(move |&(&a, &b)| v < a && v < b).map(move |(&a, &b)| [v, a, b].map(VertexId))
    });
    Surface::from_triangles(surface.points().to_vec(), &triangles.collect::<Vec<_>>()).unwrap()
}

/// The surface with every vertex moved by up to so many mean edge lengths in every direction; it may well cut itself.
fn noisy(surface: &Surface, size: f64, random: &mut ChaCha8Rng) -> Surface {
    let length = |edge: &crate::solid::SurfaceEdge| {
        let [a, b] = edge.vertices.map(|v| surface.points()[v.index()]);
        (b - a).norm()
    };
    let mean = surface.edges().iter().map(length).sum::<f64>() / surface.edges().len() as f64;
    let mut uniform = || f64::from(random.next_u32()) / f64::from(u32::MAX) * 2.0 - 1.0;
    let moved = surface.points().iter().map(|p| p + Vec3::from_fn(|_, _| uniform()) * (size * mean)).collect();
    Surface::from_triangles(moved, surface.triangles()).unwrap()
}

/// Maps so many decimated and noisy versions of surfaces.
fn map_versions(surfaces: &[Surface], count: usize) {
    let mut random = ChaCha8Rng::seed_from_u64(15);
    for version in 0..count {
        let surface = &surfaces[version % surfaces.len()];
        let most = surface.points().len();
        let left = 4 + random.next_u32() as usize % (most - 3);
        let size = [0.0, 0.1, 0.5, 2.0][random.next_u32() as usize % 4];
        let version_of = noisy(&decimated(surface, left), size, &mut random);
        if let Err(error) = sphere_map(&version_of, &SphereSettings::default()) {
            panic!("version {version} ({left} vertices, noise {size}): {error}");
        }
    }
}

#[test]
fn decimated_and_noisy_surfaces_are_mapped() {
    let harmonics = Solid::SmoothStar { degree: 4, amplitude: 0.5, resolution: 4, seed: 1 }.surface().unwrap();
    map_versions(&[harmonics, spiral()], 20);
}

/// `QCBALL_SURFACES=FOLDER cargo test --release --lib a_thousand_versions -- --ignored --nocapture`
#[test]
#[ignore = "takes minutes and a folder of surfaces of genus 0, named by the variable QCBALL_SURFACES"]
fn a_thousand_versions() {
    let folder = std::env::var_os("QCBALL_SURFACES").expect("QCBALL_SURFACES names a folder");
    let mut paths: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| crate::mesh::io::SurfaceFormat::of(path).is_some());
    paths.sort();
    let surfaces: Vec<Surface> =
        paths.iter().map(|path| Surface::from_soup(crate::mesh::io::read_surface(path).unwrap()).unwrap()).collect();
    for (path, surface) in paths.iter().zip(&surfaces) {
        let clock = std::time::Instant::now();
        let map = sphere_map(surface, &SphereSettings::default()).unwrap_or_else(|error| panic!("{path:?}: {error}"));
        let distortion = SphereDistortion::of(surface, map.positions());
        println!(
            "{} {} triangles {distortion:?} {:.1} s",
            path.display(),
            surface.triangles().len(),
            clock.elapsed().as_secs_f64()
        );
    }
    map_versions(&surfaces, 1000);
}

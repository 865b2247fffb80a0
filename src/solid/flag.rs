//! The flag mesher: a star-shaped polyhedron cut into the cones V over O C E, with V a corner, E a point of an edge, C a
//! point of a face and O the star centre: the flags of the polyhedron.
//!
//! Every triangle O C E is meshed in polar coordinates about E, in sectors from C to O and rings around E, so that the mesh
//! looks the same at every distance from an edge; each of its triangles is then the base of a cone over V that is cut into
//! layers. Points on a side that two flags share are computed alike from both.
//!
//! In a flag the linear function that is 0 at V and 1 on O C E is what a warp of the corner needs (see `map::corner`).

use crate::dilatation::Dilatation;
use crate::mesh::{MeshError, TetMesh, Vec3, VertexId, edge_matrix};
use crate::solid::Surface;
use crate::solid::faces::{Faces, flat_faces};
use crate::solid::shell::{MOST_TETS, cone_tets, layer_fractions, too_steep};

/// What a flag mesh is made with.
#[derive(Clone, Debug, PartialEq)]
pub struct FlagSettings {
    /// Sectors about an edge in each flag, from the face to the plane of the edge and the centre; at least 1.
    pub sectors: u32,
    /// Rings around an edge, at least 1.
    pub rings: u32,
    /// Layers from a corner to the bases of its flags, at least 1.
    pub layers: u32,
    /// Ratio of the thickness of a ring to that of the next one nearer to the edge, > 0; 1 for equal ones.
    pub grading: f64,
    /// Ratio of the thickness of a layer to that of the next one nearer to the corner, > 0. A map that is like r^p at the corner
    /// needs no thin ones there, but triangles of the sphere that are small everywhere.
    pub layer_grading: f64,
}

impl Default for FlagSettings {
    /// 280 tets a flag: 13,440 for a cube, which has 48. Their smallest dihedral angle is 0.6 degrees on a regular
    /// tetrahedron and 1.4 on a cube: next to an edge they are long.
    fn default() -> Self {
        Self { sectors: 4, rings: 4, layers: 4, grading: 1.3, layer_grading: 1.3 }
    }
}

impl FlagSettings {
    /// Tets of one flag.
    pub fn tets_a_flag(&self) -> usize {
        self.triangles() * (3 * self.layers as usize - 2)
    }

    /// Triangles of O C E.
    fn triangles(&self) -> usize {
        self.sectors as usize * (2 * self.rings as usize - 1)
    }
}

/// Why no flag mesh was made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FlagError {
    /// Settings outside their ranges.
    #[error("{0}")]
    Settings(String),
    /// More tets than can be handled.
    #[error(
        "the flag mesh would have {flags} flags of {tets_a_flag} tets, more than {MOST_TETS} tets: ask for fewer sectors, rings or \
         layers; flags are for polyhedra of few faces"
    )]
    TooLarge {
        /// Flags of the polyhedron.
        flags: usize,
        /// Tets in each.
        tets_a_flag: usize,
    },
    /// The centre does not see the surface well enough for positive volumes in floating point.
    #[error(
        "a cell of the flag mesh is flat or inside out: {0}; the star centre is too close to a face's plane, or the grading too steep"
    )]
    Cell(#[from] MeshError),
}

/// A flag: the tet of a corner, the centre, a point of a face and one of an edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Flag {
    /// V, a vertex of the polyhedron.
    pub corner: VertexId,
    /// O, C and E.
    pub base: [VertexId; 3],
}

/// A mesh of flags.
#[derive(Clone, Debug)]
pub struct FlagMesh {
    /// The tets; vertex 0 is the centre.
    pub mesh: TetMesh,
    /// The flags. The tets of each stand together, [`FlagSettings::tets_a_flag`] of them, in the order of the flags.
    pub flags: Vec<Flag>,
}

/// Meshes the solid inside `surface`, star-shaped about `centre`, by flags. Coplanar triangles make one face, and straight
/// edges one edge; a face that its centroid does not see as a whole is cut into the given triangles.
///
/// # Errors
/// See [`FlagError`].
pub fn flag_mesh(surface: &Surface, centre: Vec3, settings: &FlagSettings) -> Result<FlagMesh, FlagError> {
    check(settings)?;
    let faces = flat_faces(surface);
    let flags = 2 * faces.loops.iter().map(Vec::len).sum::<usize>();
    let tets_a_flag = settings.tets_a_flag();
    if flags.checked_mul(tets_a_flag).is_none_or(|tets| tets > MOST_TETS) {
        return Err(FlagError::TooLarge { flags, tets_a_flag });
    }
    let bases = Bases::new(&faces, centre, settings);
    let mut best: Option<(f64, FlagMesh)> = None;
    for order in [Order::Numbers, Order::Outward, Order::Inward] {
        let flags = cones(&faces, &bases, settings, order)?;
        let k = radial_dilatation(&flags, tets_a_flag);
        if best.as_ref().is_none_or(|(least, _)| k < *least) {
            best = Some((k, flags));
        }
    }
    let (_, flags) = best.expect("there are three of them");
    Ok(flags)
}

/// The largest K of the piecewise-linear map that agrees at the vertices with the radial one about O.
fn radial_dilatation(flags: &FlagMesh, tets_a_flag: usize) -> f64 {
    let at = |v: VertexId| flags.mesh.points()[v.index()];
    let of_flag = |(flag, tets): (&Flag, &[[VertexId; 4]])| {
        let [o, c, e] = flag.base.map(at);
        let normal = (c - at(flag.corner)).cross(&(e - at(flag.corner)));
        let radial = |x: Vec3| {
            let (offset, distance) = (x - o, normal.dot(&(c - o)));
            // The share of the way to the face, in the direction of the point; 0 at O.
            let scale = normal.dot(&offset) / distance / offset.norm();
            if scale.is_finite() { offset * scale } else { Vec3::zeros() }
        };
        let of_tet = |tet: &[VertexId; 4]| {
            let corners = tet.map(at);
            let inverse = edge_matrix(corners).try_inverse();
            inverse.map_or(f64::INFINITY, |inverse| Dilatation::of(&(edge_matrix(corners.map(radial)) * inverse)).k())
        };
        tets.iter().map(of_tet).fold(1.0, f64::max)
    };
    flags.flags.iter().zip(flags.mesh.tets().chunks(tets_a_flag)).map(of_flag).fold(1.0, f64::max)
}

fn check(settings: &FlagSettings) -> Result<(), FlagError> {
    let refuse = |message: &str| Err(FlagError::Settings(message.into()));
    if settings.sectors == 0 || settings.rings == 0 || settings.layers == 0 {
        return refuse("sectors, rings and layers must be at least 1");
    }
    // The number of tets is formed from these before it is held against the most there may be.
    if settings.sectors > 10_000 || settings.rings > 10_000 || settings.layers > 10_000 {
        return refuse("sectors, rings and layers must be at most 10000");
    }
    if [settings.grading, settings.layer_grading].iter().any(|grading| !(grading.is_finite() && *grading > 0.0)) {
        return refuse("grading and layer_grading must be positive numbers");
    }
    let rings = too_steep("grading", settings.grading, settings.rings, "rings");
    let steep = rings.or_else(|| too_steep("layer_grading", settings.layer_grading, settings.layers, "layers"));
    steep.map_or(Ok(()), |steep| refuse(&steep))
}

/// What the diagonals of the layers follow: they run from the inner end of what comes first. Which is best depends on the solid and on
/// the numbers of rings and sectors; a cube's radial map has K 5.9 with one and 7.8 with another at two of each, 14.4 and 6.7 at
/// three. It is tried.
#[derive(Clone, Copy)]
enum Order {
    /// The numbers of the points.
    Numbers,
    /// Ring by ring from the edge, in each from the face.
    Outward,
    /// The same, in each ring towards the face.
    Inward,
}

/// The points of all triangles O C E, each named once.
struct Bases {
    points: Vec<Vec3>,
    /// Ring and sector of each point.
    places: Vec<(u32, u32)>,
    sectors: u32,
    rings: u32,
    /// The number of faces; of edges.
    faces: u32,
    edges: u32,
}

impl Bases {
    fn new(faces: &Faces, centre: Vec3, settings: &FlagSettings) -> Self {
        let (n, rings) = (settings.sectors, settings.rings);
        let fractions = layer_fractions(rings, settings.grading);
        let middles: Vec<Vec3> =
            faces.edges.iter().map(|ends| (faces.points[ends[0]] + faces.points[ends[1]]) * 0.5).collect();
        let mut points = vec![centre];
        let mut places = vec![(rings, n)];
        // The ends of the sectors, on the line from C to O. The angles at the edges of a face are divided evenly, as far as
        // one division of the line can do that for all of them: in the mean.
        let mut ends = Vec::with_capacity(faces.loops.len() * n as usize);
        for (sides, middle) in faces.sides.iter().zip(&faces.centres) {
            for sector in 0..n {
                let fraction = |&edge: &usize| share(middle, &centre, &middles[edge], f64::from(sector) / f64::from(n));
                let mean = sides.iter().map(fraction).sum::<f64>() / sides.len() as f64;
                ends.push(middle + (centre - middle) * mean);
            }
        }
        points.extend_from_slice(&ends);
        places.extend((0..faces.loops.len()).flat_map(|_| (0..n).map(|sector| (rings, sector))));
        for middle in &middles {
            points.push(*middle);
            points.extend(fractions[..rings as usize - 1].iter().map(|r| middle + (centre - middle) * *r));
            places.extend((0..rings).map(|ring| (ring, n)));
        }
        for (face, sides) in faces.sides.iter().enumerate() {
            for &edge in sides {
                for sector in 0..n as usize {
                    let along = ends[face * n as usize + sector] - middles[edge];
                    points.extend(fractions[..rings as usize - 1].iter().map(|r| middles[edge] + along * *r));
                    places.extend((1..rings).map(|ring| (ring, sector as u32)));
                }
            }
        }
        let (faces, edges) = (faces.loops.len() as u32, faces.edges.len() as u32);
        Self { points, places, sectors: n, rings, faces, edges }
    }

    /// The point of a face's triangle at an edge: `ring` 0 is E, the last one is the line from C to O; sector 0 runs to C,
    /// the last one to O. `side` counts the sides of all faces.
    fn point(&self, face: u32, edge: u32, side: u32, ring: u32, sector: u32) -> u32 {
        let of_edges = 1 + self.faces * self.sectors;
        let of_sides = of_edges + self.edges * self.rings;
        match (ring, sector) {
            (0, _) => of_edges + edge * self.rings,
            (ring, sector) if sector == self.sectors && ring == self.rings => 0,
            (ring, sector) if sector == self.sectors => of_edges + edge * self.rings + ring,
            (ring, sector) if ring == self.rings => 1 + face * self.sectors + sector,
            (ring, sector) => of_sides + (side * self.sectors + sector) * (self.rings - 1) + ring - 1,
        }
    }

    /// The points in an order.
    fn by_rank(&self, order: Order) -> Vec<u32> {
        let mut points: Vec<u32> = (0..self.points.len() as u32).collect();
        points.sort_by_key(|&point| {
            let (ring, sector) = self.places[point as usize];
            match order {
                Order::Numbers => (0, 0, point),
                Order::Outward => (ring, sector, point),
                Order::Inward => (ring, self.sectors - sector, point),
            }
        });
        points
    }

    /// The triangles, positively oriented as bases of a cone whose apex is the start of the side.
    fn triangles(&self, face: u32, edge: u32, side: u32) -> Vec<[u32; 3]> {
        let mut triangles = Vec::new();
        let at = |ring, sector| self.point(face, edge, side, ring, sector);
        for sector in 0..self.sectors {
            triangles.push([at(0, 0), at(1, sector + 1), at(1, sector)]);
            for ring in 1..self.rings {
                let (a, b) = (at(ring, sector), at(ring, sector + 1));
                let (c, d) = (at(ring + 1, sector + 1), at(ring + 1, sector));
                // In turn, so that no direction is preferred.
                let halves = if (sector + ring) % 2 == 0 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
                triangles.extend(halves);
            }
        }
        triangles
    }
}

/// Where the ray from E at a part of the angle between C and O meets the line from C to O, as a part of that line.
fn share(c: &Vec3, o: &Vec3, e: &Vec3, part: f64) -> f64 {
    let (to_c, to_o) = (c - e, o - e);
    let angle = to_c.cross(&to_o).norm().atan2(to_c.dot(&to_o));
    let (near, far) = (to_c.norm() * (part * angle).sin(), to_o.norm() * ((1.0 - part) * angle).sin());
    near / (near + far)
}

/// The layers over the bases, towards the corners.
fn cones(faces: &Faces, bases: &Bases, settings: &FlagSettings, order: Order) -> Result<FlagMesh, FlagError> {
    let by_rank = bases.by_rank(order);
    let mut ranks = vec![0; by_rank.len()];
    (0..).zip(&by_rank).for_each(|(rank, &point)| ranks[point as usize] = rank);
    let layers = settings.layers as usize;
    let fractions = layer_fractions(settings.layers, settings.layer_grading);
    let mut points = bases.points.clone();
    let base = points.len() as u32;
    points.extend_from_slice(&faces.points);
    // For each corner, where the points of its inner layers start, for each base point that it needs.
    let mut inner: Vec<std::collections::HashMap<u32, u32>> = vec![Default::default(); faces.points.len()];
    let (mut tets, mut flags) = (Vec::new(), Vec::new());
    let mut side = 0;
    for (face, (corners, sides)) in (0u32..).zip(faces.loops.iter().zip(&faces.sides)) {
        for (place, &edge) in sides.iter().enumerate() {
            let edge = edge as u32;
            let triangles = bases.triangles(face, edge, side);
            let flag_base = [0, bases.point(face, edge, side, bases.rings, 0), bases.point(face, edge, side, 0, 0)];
            for (corner, turned) in [(corners[place], false), (corners[(place + 1) % corners.len()], true)] {
                let apex = VertexId(base + corner as u32);
                flags.push(Flag { corner: apex, base: flag_base.map(VertexId) });
                for triangle in &triangles {
                    let [a, b, c] = triangle.map(|point| ranks[point as usize]);
                    for &point in triangle {
                        inner[corner].entry(point).or_insert_with(|| {
                            let start = points.len() as u32;
                            let (tip, end) = (faces.points[corner], bases.points[point as usize]);
                            points.extend(fractions[..layers - 1].iter().map(|part| tip + (end - tip) * *part));
                            start
                        });
                    }
                    let vertex = |layer: usize, rank: u32| {
                        let point = by_rank[rank as usize];
                        VertexId(if layer + 1 == layers { point } else { inner[corner][&point] + layer as u32 })
                    };
                    cone_tets(&mut tets, apex, if turned { [a, c, b] } else { [a, b, c] }, layers, vertex);
                }
            }
            side += 1;
        }
    }
    Ok(FlagMesh { mesh: TetMesh::new(points, tets)?, flags })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::domain::Domain;
    use crate::mesh::io::read_surface;
    use crate::mesh::{full_boundary, smallest_dihedral_angle};
    use crate::solid::{CentreChoice, Solid, shell_mesh, star_centre};

    fn mesh(surface: &Surface, settings: &FlagSettings) -> FlagMesh {
        let centre = star_centre(surface, &CentreChoice::Kernel).unwrap().position;
        flag_mesh(surface, centre, settings).unwrap()
    }

    /// Checks a mesh of a solid and gives its smallest dihedral angle in degrees.
    fn checked(surface: &Surface, flags: usize, settings: &FlagSettings) -> f64 {
        let FlagMesh { mesh, flags: found } = mesh(surface, settings);
        assert_eq!((found.len(), mesh.tets().len()), (flags, flags * settings.tets_a_flag()));
        let angle = smallest_dihedral_angle(&mesh);
        let domain = Domain::new(mesh).unwrap();
        let volume: f64 = domain.volumes().iter().sum();
        // As many terms of one sign as there are tets, rounded at 1e-16 of the solid's size cubed each.
        assert!((volume - surface.volume()).abs() < 1e-11 * surface.volume(), "{volume}");
        assert!(full_boundary(domain.mesh(), domain.boundary()).parents().is_empty());
        // The tets of a flag fill the tet V O C E.
        for (flag, tets) in found.iter().zip(domain.volumes().chunks(settings.tets_a_flag())) {
            let [v, o, c, e] =
                [flag.corner, flag.base[0], flag.base[1], flag.base[2]].map(|v| domain.mesh().points()[v.index()]);
            let whole = (o - v).dot(&(c - v).cross(&(e - v))).abs() / 6.0;
            assert!((tets.iter().sum::<f64>() - whole).abs() < 1e-11 * surface.volume());
        }
        angle
    }

    #[test]
    fn solids_of_every_kind_are_filled_by_balls_of_good_tets() {
        let gem = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/solids/gem.obj");
        let gem = Surface::from_soup(read_surface(&gem).unwrap()).unwrap();
        let count = |surface: &Surface| 2 * flat_faces(surface).loops.iter().map(Vec::len).sum::<usize>();
        assert!(count(&gem) > 0);
        let named = [
            // Four flags an edge.
            (Solid::Tetrahedron, 24),
            (Solid::Cube, 48),
            (Solid::Octahedron, 48),
            (Solid::Dodecahedron, 120),
            (Solid::Icosahedron, 120),
            (Solid::Box { size: [1.0, 1.0, 2.0] }, 48),
            (Solid::Prism { sides: 3, height: 1.0 }, 36),
            (Solid::Prism { sides: 6, height: 1.0 }, 72),
            (Solid::Pyramid { sides: 4, height: 1.0 }, 32),
            (Solid::Bipyramid { sides: 5, height: 1.0 }, 60),
        ];
        let named = named.into_iter().map(|(solid, flags)| (solid.surface().unwrap(), flags));
        let flags = count(&gem);
        for (surface, flags) in named.chain([(gem, flags)]) {
            for settings in [
                FlagSettings::default(),
                FlagSettings { sectors: 1, rings: 1, layers: 1, grading: 1.0, layer_grading: 1.0 },
                FlagSettings { sectors: 3, rings: 1, layers: 2, grading: 0.7, layer_grading: 1.4 },
                FlagSettings { sectors: 1, rings: 2, layers: 1, grading: 2.0, layer_grading: 2.0 },
            ] {
                let angle = checked(&surface, flags, &settings);
                // 0.63 (tetrahedron) to 2.5 (dodecahedron): long prisms along the edges.
                assert!(settings != FlagSettings::default() || angle > 0.6, "{flags} flags: {angle} degrees");
            }
        }
    }

    #[test]
    fn the_radial_map_is_not_much_worse_on_fine_flags_than_it_is() {
        use crate::map::{RadialCoordinates, RayEnd, caraman};
        use crate::measure::measure;
        let surface = Solid::Cube.surface().unwrap();
        for settings in [
            FlagSettings::default(),
            FlagSettings { sectors: 2, rings: 2, layers: 2, ..FlagSettings::default() },
            FlagSettings { sectors: 2, rings: 3, layers: 2, ..FlagSettings::default() },
            FlagSettings { sectors: 3, rings: 3, layers: 3, ..FlagSettings::default() },
        ] {
            let flags = mesh(&surface, &settings);
            let told = radial_dilatation(&flags, settings.tets_a_flag());
            let domain = Domain::new(flags.mesh).unwrap();
            let rays = RadialCoordinates::of_domain(&domain, &surface, Vec3::zeros(), RayEnd::Only).unwrap();
            let k = measure(&domain, &caraman(&rays, 1.0)).summary.max_k;
            assert!((k - told).abs() < 1e-9 * k, "{settings:?}: {k} {told}");
            // ((sqrt 2 + sqrt 6) / 2)^3 = 7.21 of the smooth radial map; with the worst of the orders 11 to 14.
            assert!(k < 7.5, "{settings:?}: {k}");
        }
    }

    #[test]
    fn triangulations_of_one_solid_have_the_same_flags() {
        // A cube of triangles that were split: faces and edges are found again.
        let settings = crate::solid::ShellSettings { subdivisions: 3, refinement: None, layers: 1, grading: 1.0 };
        let split = shell_mesh(&Solid::Cube.surface().unwrap(), Vec3::zeros(), &settings).unwrap().surface;
        assert_eq!(split.triangles().len(), 432);
        checked(&split, 48, &FlagSettings::default());
    }

    #[test]
    fn a_face_that_no_point_of_it_sees_is_left_in_triangles() {
        // A prism over an arrow head whose centroid does not see its notch: the two faces stay in triangles.
        let corners = [[0.0, 1.0], [-1.0, -1.0], [0.0, 0.8], [1.0, -1.0]];
        let at = |z: f64| corners.map(|[x, y]| Vec3::new(x, y, z));
        let points: Vec<Vec3> = at(-1.0).into_iter().chain(at(1.0)).collect();
        let quads = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];
        let polygons = quads.iter().map(|quad| quad.iter().map(|&v| VertexId(v)).collect()).collect();
        let surface = Surface::from_soup(crate::mesh::PolygonSoup::new(points, polygons)).unwrap();
        let faces = flat_faces(&surface);
        let mut sides: Vec<usize> = faces.loops.iter().map(Vec::len).collect();
        sides.sort_unstable();
        assert_eq!(sides, [3, 3, 3, 3, 4, 4, 4, 4]);
        checked(&surface, 2 * 28, &FlagSettings::default());
    }

    #[test]
    fn nonsense_settings_are_refused() {
        let surface = Solid::Cube.surface().unwrap();
        let usual = FlagSettings::default();
        for settings in [
            FlagSettings { sectors: 0, ..usual.clone() },
            FlagSettings { rings: 0, ..usual.clone() },
            FlagSettings { layers: 0, ..usual.clone() },
            FlagSettings { grading: f64::NAN, ..usual.clone() },
            FlagSettings { grading: 0.0, ..usual.clone() },
            FlagSettings { layer_grading: -1.0, ..usual.clone() },
            FlagSettings { layers: u32::MAX, ..usual.clone() },
        ] {
            assert!(matches!(flag_mesh(&surface, Vec3::zeros(), &settings), Err(FlagError::Settings(_))));
        }
        let even = FlagSettings { grading: 1.0, layer_grading: 1.0, ..usual.clone() };
        let large = FlagSettings { sectors: 1000, rings: 1000, layers: 1000, ..even };
        assert!(matches!(flag_mesh(&surface, Vec3::zeros(), &large), Err(FlagError::TooLarge { flags: 48, .. })));
        let steep = FlagSettings { layers: 2000, layer_grading: 2.0, sectors: 1, rings: 1, ..usual };
        assert!(matches!(flag_mesh(&surface, Vec3::zeros(), &steep), Err(FlagError::Settings(_))));
        let steep = FlagSettings { rings: 40, grading: 3.0, ..FlagSettings::default() };
        let error = flag_mesh(&surface, Vec3::zeros(), &steep).unwrap_err().to_string();
        assert!(error.starts_with("a grading of 3 over 40 rings") && error.ends_with("or fewer rings"), "{error}");
        // Thin ones that are no rounding are meshed.
        let thin = FlagSettings { rings: 20, grading: 3.0, ..FlagSettings::default() };
        assert!(flag_mesh(&surface, Vec3::zeros(), &thin).is_ok());
    }
}

//! Ball parameterizations of solids with low quasi-conformal dilatation.
//!
//! A solid is filled with tetrahedra, mapped onto the unit ball (radially, if it is star-shaped), and the interior vertices of the image are moved
//! until the largest dilatation of any tetrahedron is as small as the method can make it. The result is measured anew from
//! the final positions and set beside proved lower bounds. The command `qcball run` does this for a config file; this page
//! goes through the library in the order in which data flows.
//!
//! # From arrays
//!
//! [`arrays`] has one call for each purpose, from a program's own arrays and back:
//!
//! ```
//! use qcball::arrays::{ArrayError, BallMapSettings, ball_map};
//!
//! fn main() -> Result<(), ArrayError> {
//!     // A box of 2 x 1 x 1 with a corner pulled out, and the twelve triangles of its surface joined to a point inside.
//!     let mut points: Vec<[f64; 3]> = (0..8).map(|i| [2 * (i & 1), i >> 1 & 1, i >> 2].map(f64::from)).collect();
//!     points[7] = [2.6, 1.3, 1.3];
//!     points.push([1.0, 0.5, 0.5]);
//!     let quads = [[0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]];
//!     let tets: Vec<[u32; 4]> = quads.iter().flat_map(|&[a, b, c, d]| [[8, a, b, c], [8, a, c, d]]).collect();
//!
//!     let map = ball_map(&points, &tets, &BallMapSettings::default())?;
//!
//!     // The image: a position for each vertex, in the unit ball. And K on each tet, the largest of them as small as may be.
//!     for (corners, k) in map.tets.iter().zip(&map.k) {
//!         println!("{corners:?} {k:.4}");
//!     }
//!     println!("at {:?}: largest K {:.4}, {:?}", map.image[8], map.summary.max_k, map.stop);
//!     assert!(map.bijective && map.summary.flipped == 0);
//!     Ok(())
//! }
//! ```
//!
//! [`arrays::optimize`] improves a map that is there already, [`arrays::measure`] says what any program's map does, and
//! [`arrays::bounds`] what no map of the mesh can go below. None needs the features that are on by default: `files`, which reads and
//! writes meshes and calls TetGen and Gmsh, `cli` with config files, reports, pictures and the command line, and `nlopt`.
//! `default-features = false` leaves all three out.
//!
//! # The problem
//!
//! Let s_1 >= s_2 >= s_3 > 0 be the singular values of the Jacobian of an orientation-preserving map. Its *inner*, *outer*
//! and larger dilatations there are
//!
//! ```text
//! K_I = s_1 s_2 / s_3^2        K_O = s_1^2 / (s_2 s_3)        K = max(K_I, K_O)
//! ```
//!
//! All three are at least 1, are 1 exactly for similarities, and do not change under similarities before or after the map;
//! inverting the map exchanges K_I and K_O. With the centred logarithms l_i = ln s_i - (ln s_1 + ln s_2 + ln s_3) / 3,
//!
//! ```text
//! ln K = 3 max_i |l_i|
//! ```
//!
//! so that the problem solved here, *minimize the largest K over all tets*, reads: minimize tau subject to |3 l_i| <= tau
//! for the three l_i of every tet.
//!
//! ```
//! use qcball::{Dilatation, linalg::svd, mesh::Mat3, objective::centred_logs};
//!
//! let jacobian = Mat3::from_diagonal(&[1.0, 4.0, 2.0].into());
//! let dilatation = Dilatation::of(&jacobian);
//! assert_eq!((dilatation.inner, dilatation.outer, dilatation.k()), (8.0, 8.0, 8.0));
//!
//! let logs = centred_logs(svd(&jacobian).values).expect("all singular values are positive");
//! let largest = logs.into_iter().map(f64::abs).fold(0.0, f64::max);
//! assert!((dilatation.k().ln() - 3.0 * largest).abs() < 1e-15);
//! ```
//!
//! # The words
//!
//! One word an idea, here, in configs and in reports:
//!
//! - **dilatation**: K_I (inner), K_O (outer) or K, the larger of the two. A ratio without units.
//! - **domain**: the mesh before the map. **image**: vertex positions after it, on the same connectivity.
//! - **trace**: the map on the boundary.
//! - **star centre**: a point that sees the whole surface from within. **kernel**: the set of all star centres.
//! - **locked tet**: one with all four vertices on the boundary, which are fixed; nothing can change its K.
//! - **full boundary**: no interior edge or face has all its vertices on the boundary, so no tet is locked.
//! - **flipped tet**: one whose image has no positive volume; its dilatations are infinite.
//! - **active tets**: those that attain the largest K. **bottleneck**: the vertex, edge or face of the domain they sit on.
//! - **bound**: a lower bound for the largest dilatation, with its **scope**, the maps it speaks of.
//! - **gap**: achieved K / best bound, taken only where the map is in the bound's scope.
//! - **K onto the ball**: the largest K of the map followed by the radial map of its image, a polyhedron inscribed in the ball, onto
//!   the ball. Plain K is that of the map onto the polyhedron.
//! - **bracket**: the least K of all quasi-conformal maps of the solid onto the ball, between a bound and a K onto the ball.
//! - **sweep**: runs of one config with some keys varied. **case**: one of them, with its **settings** of those keys.
//!
//! # The pipeline
//!
//! ```text
//! config.toml -> Plan                     refuse early; name the file, the line and the key
//!             -> Surface                  generate a Solid or read a file; checked to be closed and orientable
//!             -> StarCentre               a point of the kernel; proved to see every triangle
//!             -> ShellMesh                layers of tets in the cones over the surface triangles; or a mesh is given
//!             -> Domain                   a topological ball, with reference gradients, volumes and boundary
//!             -> initial positions        Caraman's radial map; progressive embedding of the boundary and a harmonic
//!                                         map inside; or a map in closed form; untangled if necessary
//!             -> Outcome                  optimized positions, stop reason, a row for each iteration
//!             -> Measured, Bijectivity    from the final positions alone
//!             -> LowerBounds              from the domain and the boundary positions alone
//!             -> Report -> results/NAME/  report.json is the record; tables and meshes are views of it
//! ```
//!
//! [`experiment::run`] is this list with one call a stage. By hand, on a small mesh of the cube:
//!
//! ```
//! use qcball::{
//!     CentreChoice, Domain, OptimizeSettings, RadialCoordinates, ShellSettings, Solid, bijectivity, caraman, measure,
//!     optimize, shell_mesh, star_centre,
//! };
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // The cube [-1, 1]^3 as 48 triangles, and the centre of the largest ball in its kernel.
//! let surface = Solid::Cube.surface()?;
//! let centre = star_centre(&surface, &CentreChoice::Kernel)?;
//!
//! // 48 cones of three layers: 48 * 7 tets.
//! let settings = ShellSettings { subdivisions: 1, refinement: None, layers: 3, grading: 1.0 };
//! let shell = shell_mesh(&surface, centre.position, &settings)?;
//! let radial = caraman(&RadialCoordinates::of_shell(&shell), 1.0);
//! let domain = Domain::new(shell.mesh)?;
//! let initial = measure(&domain, &radial).summary;
//!
//! // The boundary stays on the sphere; everything else moves.
//! let fixed = domain.boundary().vertex_mask();
//! let outcome = optimize(&domain, &radial, fixed, &OptimizeSettings::default(), &mut |_row| {})?;
//!
//! // What counts is measured from the final positions, not taken from the optimizer.
//! let reached = measure(&domain, &outcome.positions).summary;
//! assert!(reached.max_k < initial.max_k && reached.mean_k < initial.mean_k);
//! assert!(bijectivity(&domain, &outcome.positions).bijective);
//!
//! // No map of this mesh with this trace can go below the best bound.
//! let bounds = qcball::bound::all(&domain, &outcome.positions, Some(centre.position), true);
//! let best = qcball::bound::best_applicable(&bounds).expect("a cube has corners");
//! assert!(1.0 < best.value && best.value <= reached.max_k);
//! # Ok(())
//! # }
//! ```
//!
//! The same from a config file, with two keys overridden, up to the [`Report`]:
//!
//! ```
//! use std::path::Path;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let overrides = ["mesh.subdivisions=1", "mesh.layers=3"].map(String::from);
//! let plan = qcball::Plan::read(Path::new("configs/cube.toml"), &overrides)?;
//! let finished = qcball::experiment::run(&plan, &mut |_row| {})?;
//! assert_eq!(finished.report.domain.tets, 48 * 7);
//! assert!(finished.report.bijective);
//! print!("{}", qcball::report::summary(&finished.report));
//! # Ok(())
//! # }
//! ```
//!
//! # Domain and start
//!
//! A [`Surface`] is closed, connected and oriented, or it is an error that names the fault. [`star_centre`] finds the
//! kernel by linear programming and checks by exact predicate that the chosen centre sees every triangle from within. In a
//! shell mesh each tet lies in the cone of one surface triangle over the centre. There the radial map
//!
//! ```text
//! f(x) = u(x)^a zeta(x) / |zeta(x)|        zeta(x): the boundary point on the ray of x,  u(x) = |x| / |zeta(x)|
//! ```
//!
//! is linear for a = 1, so that no tet of the start is flipped and K is constant in each cone. For given meshes the
//! start may have flipped tets: [`mesh::full_boundary`] frees the locked ones and [`optimize::untangle()`] moves the vertices
//! until every image volume is positive, or says which tets resist.
//!
//! A solid that is not star-shaped has no such map. There [`sphere::sphere_map`] takes the boundary to the sphere with no
//! triangle flipped, [`map::hyperbolic_harmonic`] follows inside, and [`optimize::untangle_locally`] and
//! [`optimize::refine_and_untangle`] free the tets that are flipped, which may differ in size by many orders.
//!
//! # Optimizing
//!
//! The largest K is approached through soft maxima
//!
//! ```text
//! E_p = 3 / (2 p)  ln sum over tets and i of 2 cosh(2 p l_i),    ln max K <= E_p <= ln max K + 3 ln(6 tets) / (2 p)
//! ```
//!
//! with p = 1, 4, 16, each from the minimum of the last, by projected Newton steps (or L-BFGS); then by a primal-dual
//! interior-point method on the constraints |3 l_i| <= tau, until the conditions of stationarity hold to 1e-6 with
//! multipliers for the active tets. Every accepted step keeps all image determinants positive. How it ended is a
//! [`StopReason`](optimize::StopReason), never an error. The result is the iterate of least *measured* K. It is a local
//! optimum: the problem is not convex.
//!
//! # Measuring
//!
//! For a piecewise-linear map the Jacobian is constant on each tet, so the largest K over the tets is exact, up to the
//! rounding of one singular value decomposition. [`measure()`] needs only a domain and positions, from whatever program.
//!
//! ```
//! use qcball::{Domain, TetMesh, Vec3, VertexId, measure};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // One corner of a cube, split in two; the second tet shares the face 1 2 3.
//! let points = vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z(), Vec3::repeat(1.0)];
//! let tets = vec![[0, 1, 2, 3].map(VertexId), [4, 1, 3, 2].map(VertexId)];
//! let domain = Domain::new(TetMesh::new(points, tets)?)?;
//!
//! // Stretching by two along x: s = (2, 1, 1), so K_I = 2 and K_O = 4 on both tets.
//! let mut image: Vec<Vec3> = domain.mesh().points().iter().map(|p| Vec3::new(2.0 * p.x, p.y, p.z)).collect();
//! let stretched = measure(&domain, &image).summary;
//! assert!((stretched.max_k_inner - 2.0).abs() < 1e-14 && (stretched.max_k_outer - 4.0).abs() < 1e-14);
//!
//! // Pushing the last vertex through the shared face flips its tet.
//! image[4] = Vec3::repeat(0.1);
//! let flipped = measure(&domain, &image);
//! assert_eq!((flipped.flipped.len(), flipped.summary.max_k), (1, f64::INFINITY));
//! # Ok(())
//! # }
//! ```
//!
//! K speaks of the map onto the image, a polyhedron whose corners lie on the sphere. A cube mapped onto an inscribed cube has K = 1
//! and is no ball: [`measure::measure_onto_ball`] measures the map onto the ball that the image's radial map makes of it, and bounds
//! it from above for certain ([`measure::BallDilatation`]).
//!
//! ```
//! use qcball::{CentreChoice, Domain, RadialCoordinates, ShellSettings, Solid, caraman, shell_mesh, star_centre};
//! use qcball::measure::{ball_fraction, measure_onto_ball};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let surface = Solid::Cube.surface()?;
//! let centre = star_centre(&surface, &CentreChoice::Kernel)?.position;
//! let settings = ShellSettings { subdivisions: 2, refinement: None, layers: 2, grading: 1.0 };
//! let shell = shell_mesh(&surface, centre, &settings)?;
//! let image = caraman(&RadialCoordinates::of_shell(&shell), 1.0);
//! let domain = Domain::new(shell.mesh)?;
//! let summary = measure_onto_ball(&domain, &image).summary;
//! let onto_ball = summary.ball_k.expect("the image is inscribed in the ball");
//! assert!(summary.max_k < onto_ball.sampled && onto_ball.sampled <= onto_ball.certified);
//! assert!(0.9 < ball_fraction(&domain, &image)? && ball_fraction(&domain, &image)? < 1.0);
//! # Ok(())
//! # }
//! ```
//!
//! # Bounds
//!
//! [`bound`] holds one theorem a file. Each [`LowerBound`] says which dilatation it bounds, for which maps (its
//! [`Scope`](bound::Scope)), and whether the measured map is one of these: a theorem about maps of the smooth solid says
//! nothing about a piecewise-linear map onto a polyhedron inscribed in the ball, and no gap is taken between the two. The
//! bounds never see the interior of a map:
//!
//! ```
//! use qcball::{CentreChoice, Domain, RadialCoordinates, ShellSettings, Solid, Vec3, caraman, shell_mesh, star_centre};
//! use qcball::bound::{BoundName, all, best_applicable};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let surface = Solid::Cube.surface()?;
//! let centre = star_centre(&surface, &CentreChoice::Kernel)?.position;
//! let settings = ShellSettings { subdivisions: 1, refinement: None, layers: 2, grading: 1.0 };
//! let shell = shell_mesh(&surface, centre, &settings)?;
//! let mut image = caraman(&RadialCoordinates::of_shell(&shell), 1.0);
//! let domain = Domain::new(shell.mesh)?;
//! let bounds = all(&domain, &image, Some(centre), true);
//!
//! // On the smooth ball a cube's corner of solid angle pi / 2 opens to 2 pi: K_I >= 4 for every qc map with this trace.
//! let smooth = bounds.iter().find(|bound| bound.name == BoundName::VertexSmooth).expect("a cube has corners");
//! assert!((smooth.value - 4.0).abs() < 1e-12 && !smooth.applies);
//!
//! // Onto the inscribed polyhedron the corner opens less, and so does what is proved for this mesh.
//! let best = best_applicable(&bounds).expect("a cube has corners");
//! assert!(best.certified && best.applies);
//!
//! // Vertex 0 is the centre: where it goes is of no account.
//! image[0] = Vec3::repeat(f64::NAN);
//! let again = all(&domain, &image, Some(centre), true);
//! assert_eq!(best.value, best_applicable(&again).expect("as before").value);
//! # Ok(())
//! # }
//! ```
//!
//! A value that is called proved was accepted by a small checker in interval arithmetic, from the positions alone, whatever found
//! it; [`bound::confront`] ends a run whose map lies below one. The strongest bound, which takes a search, is the Gram certificate
//! ([`bound::certificate`]): data from which anybody can prove it again.
//!
//! # Determinism
//!
//! Tets are handled in parallel and gathered in a fixed order, and the sparse factorization runs on one thread: a result is
//! the same to the bit for any number of threads, unless a time limit ended the run. What is read from files is counted in the
//! power of two nearest below its size ([`mesh::Unit`]) and given back in the file's unit, so that no result depends on that unit
//! and none of it leaves the range of numbers on the way.
//!
//! # The modules
//!
//! [`guide`] is text only: what the command does, a chapter a topic. The others follow in this order; outside of tests, a module uses only what stands above it. From [`picture`] on they belong to the feature `cli`; [`mesh::io`], `child` and the external meshers to `files`.
//!
//! | module | what it holds |
//! |---|---|
//! | [`cancel`] | ending work from outside, and deadlines; `child`: programs that do not outlive this one |
//! | [`linalg`] | the signed 3x3 singular value decomposition; the sparse positive definite solve; intervals |
//! | [`dilatation`] | K_I, K_O and K of one Jacobian |
//! | [`mesh`] | ids, units, tet meshes, boxes and soups, topology, sharp features, full boundary; `io`: a format a file |
//! | [`solid`] | built-in solids, closed surfaces and their invariants, star kernel and centre, the shell and flag meshers, voxels |
//! | [`mod@sphere`] | boundary maps: closed surfaces without handles onto the sphere |
//! | [`domain`] | a mesh that is a ball, with reference gradients and volumes |
//! | [`map`] | the radial map; harmonic maps inside of a boundary map; whether a map is bijective; a map and its inverse at any points; `analytic`: maps in closed form |
//! | [`mod@measure`] | dilatations of all tets, their quantiles, the active tets, the bottleneck; K onto the ball |
//! | [`estimate`] | the paper's estimates of K at vertices and cells, of tets and hexahedra |
//! | [`objective`] | energies of one tet and their sum with gradient and Hessian |
//! | [`mod@optimize`] | continuation, Newton, L-BFGS, minimax, untangling |
//! | [`bound`] | lower bounds, a theorem a file; `check`: what has to be believed of them |
//! | [`mod@refine`] | rounds of refinement where the largest K sits |
//! | [`arrays`] | the front doors: plain arrays in, plain arrays out |
//! | [`picture`] | pictures of meshes and maps without a display, and the same figures as data |
//! | [`config`] | the config as typed and the plan it means |
//! | [`comparison`] | maps of known dilatation on several meshes: published, estimated and exact values |
//! | [`report`] | the record of a run, its files, its summary and its page; the page of a sweep |
//! | [`experiment`] | one run from plan to report; the optimization of a given map |
//! | [`mod@verify`] | a results folder checked against itself, from its files alone |
//! | [`mod@bench`] | a folder of meshes optimized one by one, beside the figures of other programs |
//! | [`sweep`] | many runs from one config, resumed and shared out, and the index over them |
//! | [`cli`] | the command line |
//!
//! The paper all this starts from is Naitsat, Saucan and Zeevi, *Volumetric Quasi-conformal Mappings*, GRAPP 2015,
//! doi 10.5220/0005298900460057; "paper eq. N" in these pages is an equation of it.

pub mod guide;

pub mod cancel;

#[cfg(feature = "files")]
mod child;

#[doc(hidden)]
pub mod linalg;

pub mod dilatation;

pub mod mesh;

pub mod solid;

pub mod sphere;

pub mod domain;

pub mod map;

pub mod measure;

pub mod estimate;

#[doc(hidden)]
pub mod objective;

pub mod optimize;

pub mod bound;

pub mod refine;

pub mod arrays;

#[cfg(feature = "cli")]
pub mod picture;

#[cfg(feature = "cli")]
pub mod config;

#[cfg(feature = "cli")]
pub mod comparison;

#[cfg(feature = "cli")]
pub mod report;

#[cfg(feature = "cli")]
pub mod experiment;

#[cfg(feature = "cli")]
pub mod verify;

#[cfg(feature = "cli")]
pub mod bench;

#[cfg(feature = "cli")]
pub mod sweep;

#[cfg(feature = "cli")]
pub mod cli;

pub use bound::LowerBound;
pub use cancel::Cancel;
#[cfg(feature = "cli")]
pub use config::Plan;
pub use dilatation::Dilatation;
pub use domain::Domain;
pub use map::{RadialCoordinates, bijectivity, caraman};
pub use measure::{Measured, measure};
pub use mesh::{TetId, TetMesh, Vec3, VertexId};
pub use optimize::{OptimizeSettings, Outcome, optimize};
#[cfg(feature = "cli")]
pub use report::Report;
pub use solid::{CentreChoice, ShellSettings, Solid, Surface, shell_mesh, star_centre};

//! The config file: [`Config`] as it was typed, [`Plan`] as it is meant.
//!
//! Every table is flat and every key optional in [`Config`], so that each message can name a key and a line; what the
//! keys mean together is decided once, in [`Plan`].

mod analytic;
mod bench;
mod boundary;
mod error;
mod limits;
mod map;
mod mesh;
mod plan;
mod refine;
mod solid;
mod source;
mod sweep;
mod sweep_table;
mod task;

pub use analytic::{AnalyticMeshPlan, AnalyticPlan, CaramanName, CaramanPlan, CellsPlan, MapPlan};
pub use bench::{BenchPlan, GivenMapSettings, optimize_settings};
pub use error::ConfigError;
pub use map::InitialMap;
pub use mesh::MeshPlan;
pub use plan::{DomainSource, Plan};
pub use refine::{BudgetValue, RefineTable};
pub use solid::SolidName;
pub use source::{ConfigSource, Setting};
pub use sweep::{CasePlan, MOST_CASES, SweepPlan};
pub use sweep_table::{Axis, Number, RangeTable, Seeds, SweepTable};
pub use task::Task;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::map::AnalyticMap;
use crate::optimize::{BoundaryValues, Effort, Engine};

/// A qcball config file, key by key as typed.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Name of the run; results go to results/NAME. Default: the config file's name without its ending.
    pub name: Option<String>,
    /// Seed of the random solids. Default: 0.
    #[schemars(range(min = 0))]
    pub seed: i64,
    /// Number of threads; 0 or absent means all cores. The result is the same to the bit for any number.
    #[schemars(range(min = 0, max = 1024))]
    pub threads: Option<i64>,
    /// The solid to be mapped onto the unit ball.
    pub domain: DomainTable,
    /// How the solid is filled with tetrahedra.
    pub mesh: MeshTable,
    /// The map to start from.
    pub map: MapTable,
    /// What the map is like at the boundary.
    pub boundary: BoundaryTable,
    /// How the map is improved.
    pub optimize: OptimizeTable,
    /// How the mesh is refined where the largest K sits.
    pub refine: RefineTable,
    /// What `qcball sweep` varies; a single run takes no notice of it.
    pub sweep: Option<SweepTable>,
    /// How bounds are looked for.
    pub bounds: BoundsTable,
}

/// The table `[domain]`: exactly one of `solid` and `file`, and what the solid needs.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "the table [domain]")]
pub struct DomainTable {
    /// A built-in solid. Exactly one of `solid` and `file` must be given.
    pub solid: Option<SolidName>,
    /// A surface or mesh file, relative to the config file; its format follows its ending.
    pub file: Option<String>,
    /// Number of sides of the base polygon, at least 3 (prism, pyramid, bipyramid). Default: 4.
    #[schemars(range(min = 3, max = 100_000))]
    pub sides: Option<i64>,
    /// Height over a regular base polygon with sides of length 1, of each half for a bipyramid (prism, pyramid,
    /// bipyramid). Default: 1.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub height: Option<f64>,
    /// The three edge lengths (box). Default: [1, 2, 3].
    pub size: Option<Vec<f64>>,
    /// Radius (ball). Default: 1.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub radius: Option<f64>,
    /// The three semi-axes (ellipsoid; default [1, 2, 3]), or the radius of the ring and of its tube (torus; default
    /// [2, 1]).
    pub radii: Option<Vec<f64>>,
    /// How far the surface leaves the unit sphere, relative to its radius, between 0 and 1 (star-harmonics,
    /// star-polyhedron). Default: 0.3.
    #[schemars(range(min = 0, max = 1))]
    pub amplitude: Option<f64>,
    /// Highest degree of the spherical harmonics (star-harmonics). Default: 4.
    #[schemars(range(min = 1, max = 16))]
    pub degree: Option<i64>,
    /// How finely a curved or random surface is triangulated: segments to an edge of a projected icosahedron, 20
    /// resolution^2 triangles (ball, ellipsoid, star-harmonics, star-polyhedron), or round the tube, at least 3 (torus).
    /// Default: 8.
    #[schemars(range(min = 1, max = 1000))]
    pub resolution: Option<i64>,
    /// Vertices of a surface file no farther apart than this part of its bounding box's diagonal become one, as where a
    /// program split them at a seam and rounded; up to 0.01. Default: only those at the same place do.
    #[schemars(range(max = 0.01), extend("exclusiveMinimum" = 0))]
    pub weld: Option<f64>,
    /// Of a surface file that falls into pieces keep the one with the largest area. Default: false.
    pub keep_largest: bool,
    /// Fill the flat holes of a surface file. Default: false.
    pub fill_holes: bool,
    /// Keep a given mesh as it is. Default: false, interior edges and faces between boundary vertices are split, so that
    /// no tet is locked by the fixed boundary.
    pub keep_mesh: bool,
    /// The star centre: "kernel" (a deep point of the set of all star centres; the default), "centroid", "bbox" (the
    /// middle of the bounding box), "optimize" (the one with the least initial K) or a point [x, y, z].
    pub centre: Option<CentreValue>,
}

/// The value of `domain.centre`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "the centre is \"kernel\", \"centroid\", \"bbox\", \"optimize\" or a point [x, y, z]")]
pub enum CentreValue {
    /// One of the named rules.
    Named(CentreName),
    /// A point in the solid's own coordinates.
    At([f64; 3]),
}

/// A rule that finds the star centre.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CentreName {
    /// A deep point of the kernel, the set of all star centres.
    Kernel,
    /// The centre of mass.
    Centroid,
    /// The middle of the bounding box.
    Bbox,
    /// The star centre whose radial map has the least K.
    Optimize,
}

/// The table `[mesh]`.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "the table [mesh]")]
pub struct MeshTable {
    /// The mesher. Default: "auto", which is "shell", cones over the surface triangles cut into layers, where the solid is
    /// star-shaped, else TetGen where it is installed, else Gmsh; each takes its own keys. "flag": a polyhedron cut into cones
    /// from its corners over triangles of the centre, a face's and an edge's middle, polar about the edges. "tetgen" and "gmsh"
    /// run the program of that name.
    pub kind: MeshKind,
    /// Each surface triangle is first split into this number squared, at least 1 (shell). Default: 1; and if
    /// neither this nor `edge_length` nor `cells` is given, edges are halved until the image is nearly a ball: until the radial
    /// map of the image polyhedron onto the ball has no K above 1.25, or there are 500,000 tetrahedra.
    #[schemars(range(min = 1, max = 1000))]
    pub subdivisions: Option<i64>,
    /// In the solid's own units, > 0. shell: halve the longest edges until none is longer; not together with `cells`.
    /// tetgen, gmsh: the edge length aimed at, away from sharp edges if those have their own; with `keep_boundary`, in
    /// the interior. Default: no wish.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub edge_length: Option<f64>,
    /// Halve the longest edges until there are at least this many tetrahedra (shell). Not together with `edge_length`.
    #[schemars(range(min = 1, max = 90_000_000))]
    pub cells: Option<i64>,
    /// Number of layers, at least 1. shell: from the centre to the surface, default 8, at most 10000. flag: from a corner to the
    /// middle of the solid, default 4, at most 1000.
    #[schemars(range(min = 1, max = 10_000))]
    pub layers: Option<i64>,
    /// Ratio of the thicknesses of successive layers, > 0. shell: outward, default 1, all equally thick. flag: of
    /// rings away from the edge, default 1.3.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub grading: Option<f64>,
    /// Ratio of the thicknesses of successive layers away from the corner, > 0 (flag). Default: `grading`. Nearer to 1 where
    /// corners = "power".
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub layer_grading: Option<f64>,
    /// Sectors about an edge from a face to the plane of edge and centre, at least 1 (flag). Default: 4.
    #[schemars(range(min = 1, max = 1000))]
    pub sectors: Option<i64>,
    /// Rings around an edge, at least 1 (flag). Default: 4.
    #[schemars(range(min = 1, max = 1000))]
    pub rings: Option<i64>,
    /// The edge length aimed at along sharp edges and at corners, > 0 and at most `edge_length` (tetgen, gmsh). An edge is
    /// sharp if its faces turn by more than 20 degrees. Default: `edge_length`.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub feature_edge_length: Option<f64>,
    /// How much the edge length aimed at grows per unit of distance from the sharp edges, > 0 (tetgen, gmsh; needs
    /// `feature_edge_length`). Default: 0.5.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub feature_growth: Option<f64>,
    /// No tetrahedron is larger than this, in the solid's own units cubed (tetgen, gmsh). Default: no limit.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub max_volume: Option<f64>,
    /// The ratio of circumradius to shortest edge that no tetrahedron should exceed, > 1 (tetgen). Below 1.2 TetGen may
    /// never end. Default: 1.4.
    #[schemars(extend("exclusiveMinimum" = 1))]
    pub quality: Option<f64>,
    /// Keep the surface's triangles as the boundary instead of refining them on the same faces (tetgen, gmsh). Default:
    /// false.
    pub keep_boundary: Option<bool>,
    /// The mesher's program: a name on PATH, or a path relative to the config file (tetgen, gmsh). Default: what
    /// QCBALL_TETGEN or QCBALL_GMSH names in the environment, else tetgen or gmsh.
    pub program: Option<String>,
    /// The mesher's program is ended after so many seconds, > 0 (tetgen, gmsh). Default: 120.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub program_time_limit: Option<f64>,
}

/// A mesher.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MeshKind {
    /// Shells where the solid is star-shaped, else TetGen or Gmsh.
    #[default]
    Auto,
    /// Cones over the surface triangles, cut into layers.
    Shell,
    /// Cones over the flags of a polyhedron.
    Flag,
    /// The program TetGen.
    Tetgen,
    /// The program Gmsh.
    Gmsh,
}

/// The table `[boundary]`.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "the table [boundary]")]
pub struct BoundaryTable {
    /// Whether the vertices of the boundary stay where the start has them on the sphere, "fixed" (the default), or may move on
    /// it, "sliding", which takes the engine "newton".
    pub values: BoundaryValues,
    /// The most tets that a collar may add, as a share of all, >= 0. A collar halves edges next to the boundary, longest first,
    /// where one vertex is the apex over several boundary faces, which limits K where the boundary is fixed: 2.5 times as many
    /// tets lowered the mean K of animals by a third. Given meshes, tetgen and gmsh. Default: 0, none.
    pub collar: f64,
    /// How the map behaves at the corners of the solid. Default: "linear", piecewise linear as everywhere. A number p from 0.05 to
    /// 50: like r^p of the distance r, with that exponent at every corner; "power": with the exponents that make the largest K least, found by a
    /// search, which takes several optimizations, or without powers where edges had to be halved for them and that costs more. A corner of a flag mesh has the cones of its flags for this, one of another mesh the
    /// tets around it; edges that join two corners are halved first.
    pub corners: Option<CornersValue>,
    /// The vertices that are corners, by their numbers in the mesh, counted from 0: those of a mesh file as they stand there.
    /// Default: where three edges sharper than 30 degrees meet, or the angles of the boundary's triangles are 30 degrees off 360.
    #[schemars(length(min = 1), inner(range(min = 0)))]
    pub corner_vertices: Option<Vec<i64>>,
}

/// The value of `boundary.corners`.
#[derive(Clone, Copy, Debug, JsonSchema)]
#[schemars(untagged)]
pub enum CornersValue {
    /// One of the named ways.
    Named(CornersName),
    /// The exponent of every corner.
    Exponent(f64),
}

/// How a map behaves at corners.
#[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema)]
#[schemars(rename_all = "kebab-case")]
pub enum CornersName {
    /// Piecewise linear.
    Linear,
    /// Like powers of the distance.
    Power,
}

/// The table `[map]`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "the table [map]")]
pub struct MapTable {
    /// The map to start from. Default: "auto", which is "radial", Caraman's, where the solid is star-shaped, else "spherical":
    /// the boundary by progressive embedding and the inside in balance, for any solid that is a ball. "farthest" takes the
    /// farthest boundary point on each ray: a map into a part of the ball that may overlap itself. The others are maps in
    /// closed form onto images of their own, whose values at the boundary vertices are kept.
    pub kind: MapKind,
    /// Exponent a from 0.05 to 50 of the radial map: the point at the fraction t of the way to the surface goes to radius t^a; or
    /// "optimize", the exponent with the least K. Default: 1. Of the map |x|^(a-1) x (power): any number but 0.
    pub exponent: Option<ExponentValue>,
    /// The matrix A of x -> A x + b, by rows (affine).
    pub matrix: Option<[[f64; 3]; 3]>,
    /// The vector b of x -> A x + b (affine). Default: [0, 0, 0].
    pub offset: Option<[f64; 3]>,
    /// What the azimuth (folding) or the polar angle (cone) is multiplied by, > 0.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub ratio: Option<f64>,
    /// The half-angle of the domain in radians, at most min(pi, pi / ratio) (cone). Default: that.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub angle: Option<f64>,
    /// Half a side of the square, or the radius of the round cylinder, > 0 (zorich1, zorich2, zorich).
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub half_side: Option<f64>,
    /// How much areas count beside angles in the boundary's map onto the sphere, >= 0 (spherical). Default: 0, angles only.
    #[schemars(range(min = 0.0))]
    pub area_weight: Option<f64>,
    /// Maps in the order in which they are applied, each with its `kind` and parameters (composition).
    pub maps: Option<Vec<AnalyticMap>>,
}

/// The value of `map.exponent`.
#[derive(Clone, Copy, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "the exponent is a number or \"optimize\"")]
pub enum ExponentValue {
    /// A rule.
    Named(ExponentName),
    /// A number.
    Given(f64),
}

/// A rule that finds the exponent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ExponentName {
    /// The exponent for which the radial map about the star centre has the least K.
    Optimize,
}

/// A map to start from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MapKind {
    /// Radial where the solid is star-shaped, else spherical.
    #[default]
    Auto,
    /// Caraman's radial map; "caraman" names it as well.
    #[serde(alias = "caraman")]
    Radial,
    /// The boundary onto the sphere by progressive embedding, the inside hyperbolic harmonic.
    Spherical,
    /// Its extension to solids that are not star-shaped: each ray up to the farthest boundary point.
    Farthest,
    /// x -> A x + b.
    Affine,
    /// Multiplies the azimuth.
    Folding,
    /// Multiplies the polar angle.
    Cone,
    /// |x|^(a-1) x.
    Power,
    /// A square cylinder onto a round one.
    Zorich1,
    /// A round cylinder onto a half-space.
    Zorich2,
    /// A square cylinder onto a half-space.
    Zorich,
    /// Several maps in closed form, one after the other.
    Composition,
}

/// The table `[optimize]`.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "the table [optimize]")]
pub struct OptimizeTable {
    /// What is made small. Default: "max", the largest K of any tetrahedron.
    pub objective: ObjectiveName,
    /// Whether to look for a map that commutes with the mirror planes of the mesh through the star centre, on one of the parts between
    /// them: for solids and meshes that have such planes, as those of mesh.kind = "flag" have the solid's. Default: false.
    pub symmetric: bool,
    /// Exponent p > 0, at most 1e6, of the objective "soft-max", which needs it and alone takes it.
    #[schemars(range(max = 1e6), extend("exclusiveMinimum" = 0))]
    pub exponent: Option<f64>,
    /// The method that moves the vertices. Default: "newton", projected Newton with a sparse factorization. "lbfgs",
    /// "newton-cg" and "trust-region" minimize the soft maxima; "mma", "ccsaq" and "slsqp" the largest K, on small meshes.
    pub engine: Engine,
    /// What follows the objective "max" when the largest K is settled: "mean" (the default) lowers the mean while the
    /// largest K may rise by `rise`, "lexicographic" lowers the next largest K and so on, "none" does nothing.
    pub polish: Option<PolishName>,
    /// How far the largest K may rise for the mean's sake, relative, in (0, 10]; the polish "mean" alone takes it. Default: 2e-4.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub rise: Option<f64>,
    /// Number of largest values of K that the polish "lexicographic" settles, at least 2. Default: 3.
    #[schemars(range(min = 2))]
    pub levels: Option<i64>,
    /// How much work the largest K is worth: "quick" ends where at most 1 % is left to gain near the map, by the residual; "normal" (the
    /// default) where the map is stationary, if at most 20,000 vertices have a say in it; "thorough" does that for up to 60,000,
    /// with which a step takes 20 s and 3 GB.
    pub effort: Effort,
    /// Accuracy in ln K at which the last phase ends, > 0; with the effort "quick" it ends at 5e-3 in any case. Default: 1e-6.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub tolerance: Option<f64>,
    /// Most iterations over all phases, untangling not counted; 0 measures the start only. Default: 1000.
    #[schemars(range(min = 0))]
    pub max_iterations: Option<i64>,
    /// Most seconds of untangling and optimizing, > 0, and of a mesher that is tried where shells would do; one that there is no mesh without has
    /// mesh.program_time_limit. Default: no limit. A run that ends by it need not be repeatable.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub time_limit: Option<f64>,
}

/// The table `[bounds]`.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "the table [bounds]")]
pub struct BoundsTable {
    /// Search for a Gram certificate, the strongest bound for the mesh with its boundary, which takes some seconds; it goes to
    /// certificate.json. Default: false.
    pub certify: bool,
    /// Most seconds of that search, > 0. Default: 60. A search that ends by it need not be repeatable.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub certify_time_limit: Option<f64>,
}

/// What follows a settled largest K.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PolishName {
    /// The mean is lowered under a cap on the largest K.
    Mean,
    /// The next largest K is settled with the tets of the largest one held, and so on.
    Lexicographic,
    /// Nothing.
    None,
}

/// What is made small.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ObjectiveName {
    /// The largest K, by continuation of soft maxima and an interior-point method.
    #[default]
    Max,
    /// One soft maximum.
    SoftMax,
    /// K onto the ball, of the map followed by the radial map of its image onto the ball: rounds of "max" with the latter's shears held.
    Ball,
}

/// Either kind of config file.
#[derive(JsonSchema)]
#[serde(untagged)]
#[schemars(title = "A qcball config file")]
#[expect(dead_code, reason = "it stands for the schema only")]
enum ConfigFile {
    /// A solid that is mapped onto the ball, by `qcball run` and `qcball sweep`.
    Map(Box<Config>),
    /// Maps of known dilatation that are estimated, by `qcball run`.
    Analytic(analytic::AnalyticConfig),
}

/// The JSON schema of the config file, with every key's meaning and default.
pub fn schema() -> String {
    let schema = schemars::schema_for!(ConfigFile);
    serde_json::to_string_pretty(&schema).expect("a schema has string keys and finite numbers")
}

#[cfg(test)]
mod tests;

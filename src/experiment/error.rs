//! Why a run or an optimisation could not be made from its input.

use std::path::PathBuf;

use crate::bound::Contradiction;
use crate::map::analytic::MapError;
use crate::map::{CornerError, RayError};
use crate::mesh::io::{ReadError, shown_path};
use crate::mesh::{MeshError, TopologyError};
use crate::optimize::OptimizeError;
use crate::solid::{CentreError, ExternalError, FlagError, ShellError, SolidError, SurfaceError};
use crate::sphere::SphereError;

/// What is wrong with the input of a run; found before any optimisation.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// A file cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// A named solid cannot be made with its parameters.
    #[error("the solid cannot be made: {0}")]
    Solid(#[from] SolidError),
    /// A stage refused what the solid or file gave it.
    #[error("{origin}: {fault}")]
    Fault {
        /// The solid or its file.
        origin: String,
        /// What is wrong.
        fault: Fault,
    },
    /// An error of the program: no result.
    #[error(transparent)]
    Contradiction(#[from] Box<Contradiction>),
    /// Two meshes do not belong together.
    #[error(
        "{} and {} are not meshes with the same connectivity: {difference}; a map is given by a mesh and the same mesh with \
         moved vertices",
        shown_path(rest),
        shown_path(image)
    )]
    Mismatch {
        /// The domain's file.
        rest: PathBuf,
        /// The image's file.
        image: PathBuf,
        /// Where they differ.
        difference: String,
    },
    /// It was interrupted before there was a map.
    #[error("interrupted before there was a map; nothing was written")]
    Interrupted,
    /// The threads asked for cannot be had.
    #[error("cannot start {threads} threads: {message}; ask for fewer")]
    Threads {
        /// How many were asked for.
        threads: usize,
        /// The system's word.
        message: String,
    },
}

/// How somebody learns the numbers of corners.
const HOW_TO_FIND: &str = "without the key the corners are those that the solid's shape tells, and report.json of such a run, with max_iterations = 0 \
     for one, lists them under `corners` with their numbers and positions; the numbers of all vertices are those of domain.vtu and of a mesh file, \
     counted from 0";

/// What a stage can refuse.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// The polygons are no closed surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// There is no star centre, or not the one asked for.
    #[error(transparent)]
    Centre(#[from] CentreError),
    /// No shell mesh.
    #[error(transparent)]
    Shell(#[from] ShellError),
    /// No flag mesh.
    #[error(transparent)]
    Flag(#[from] FlagError),
    /// No warps of the corners.
    #[error("boundary.corners: {0}")]
    Corner(#[from] CornerError),
    /// Powers at corners that a solid has not.
    #[error("boundary.corners: the solid has no corners; remove the key")]
    NoCorners,
    /// A corner that is none.
    #[error(
        "boundary.corner_vertices: {}; {HOW_TO_FIND}",
        if (*vertex as usize) < *vertices {
            format!("vertex {vertex} lies inside of the mesh, and corners lie on its boundary")
        } else {
            format!("there is no vertex {vertex}, the mesh has those from 0 to {}", vertices - 1)
        }
    )]
    CornerVertex {
        /// The vertex.
        vertex: u32,
        /// How many there are.
        vertices: usize,
    },
    /// A corner that no flag has.
    #[error(
        "boundary.corner_vertices: vertex {vertex} is no corner of the polyhedron that the flags are of; name only such, or choose another \
         mesh.kind; {HOW_TO_FIND}"
    )]
    NoFlags {
        /// The vertex.
        vertex: u32,
    },
    /// A symmetric map of what has no symmetry.
    #[error(
        "optimize.symmetric: the mesh has no mirror plane through the star centre that the start keeps; remove the key, or mesh the solid \
         by mesh.kind = \"flag\", which keeps those of a polyhedron"
    )]
    NoMirrors,
    /// No mesh from TetGen or Gmsh.
    #[error(transparent)]
    External(#[from] ExternalError),
    /// No program that fills a solid of any shape.
    #[error(
        "the solid is not star-shaped, so that it cannot be meshed in shells, and there is neither TetGen nor Gmsh to mesh it: \
         install one (Debian: apt-get install tetgen), or say where it is with QCBALL_TETGEN=/path/to/tetgen or \
         QCBALL_GMSH=/path/to/gmsh in the environment; or give a tetrahedral mesh made elsewhere as domain.file"
    )]
    NoMesher,
    /// The boundary has no map onto the sphere.
    #[error(transparent)]
    Sphere(#[from] SphereError),
    /// The tets are no mesh.
    #[error("{0} (tets and vertices are counted from 0)")]
    Mesh(#[from] MeshError),
    /// The mesh is not a ball.
    #[error("{0} (vertices are counted from 0)")]
    Topology(#[from] TopologyError),
    /// A ray misses the boundary.
    #[error(transparent)]
    Ray(#[from] RayError),
    /// A vertex outside of the domain of a map in closed form.
    #[error(
        "vertex {vertex} (counted from 0) at ({:.6}, {:.6}, {:.6}) has no image: {error}; put the solid elsewhere by an affine \
         map before this one: [map] kind = \"composition\", maps = [{{ kind = \"affine\", matrix = ..., offset = ... }}, ...]",
        at[0], at[1], at[2]
    )]
    Map {
        /// The vertex.
        vertex: usize,
        /// Where it is.
        at: [f64; 3],
        /// Why it has no image.
        error: Box<MapError>,
    },
    /// A map in closed form that reverses orientation.
    #[error(
        "the map reverses orientation: {flipped} of {tets} tets are flipped; add a reflection, which keeps K: [map] kind = \
         \"composition\", maps = [..., {{ kind = \"affine\", matrix = [[-1, 0, 0], [0, 1, 0], [0, 0, 1]] }}]"
    )]
    Mirrored {
        /// How many tets are flipped.
        flipped: usize,
        /// Of how many.
        tets: usize,
    },
    /// A solid with a point in it where a map in closed form has no value.
    #[error(
        "the image of vertex {vertex} (counted from 0) lies far outside of that of the boundary: the solid holds a point where \
         the map has no value; put it elsewhere by an affine map before this one, in a composition"
    )]
    Torn {
        /// The vertex.
        vertex: usize,
    },
    /// The optimisation could not start.
    #[error(transparent)]
    Optimize(#[from] OptimizeError),
    /// An error of the program: no result.
    #[error(transparent)]
    Contradiction(#[from] Box<Contradiction>),
}

impl RunError {
    /// Names the solid or file a fault was found in.
    pub(crate) fn at<F: Into<Fault>>(origin: &str) -> impl Fn(F) -> Self {
        move |fault| Self::Fault { origin: origin.to_string(), fault: fault.into() }
    }
}

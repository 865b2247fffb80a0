//! What can go wrong with a program that is not ours, in its words and ours.

use std::io;
use std::time::Duration;

use super::ExternalMesher;
use crate::mesh::MeshError;
use crate::mesh::io::ReadError;

/// Why an external mesher made no mesh.
#[derive(Debug, thiserror::Error)]
pub enum ExternalError {
    /// The program is not there.
    #[error(
        "{mesher} is needed, but {tried}; install it (Debian: apt-get install {}), or say where it is with program = \
         \"/path/to/{}\" under [mesh] or {}=/path/to/{} in the environment; or do without: kind = \"shell\" under [mesh] \
         meshes any star-shaped solid, and domain.file may be a tetrahedral mesh made elsewhere",
        mesher.program(), mesher.program(), mesher.variable(), mesher.program()
    )]
    Missing {
        /// The mesher.
        mesher: ExternalMesher,
        /// Where it was looked for.
        tried: String,
    },
    /// Settings outside their ranges.
    #[error("{0}")]
    Settings(String),
    /// The temporary files cannot be written.
    #[error("cannot work in the folder for temporary files (TMPDIR chooses another): {0}")]
    Files(#[source] io::Error),
    /// The system did not start the program or lost it.
    #[error("cannot run {mesher}: {source}")]
    Run {
        /// The mesher.
        mesher: ExternalMesher,
        /// The system's reason.
        source: io::Error,
    },
    /// The program was ended.
    #[error(
        "{mesher} was ended after {} s without a mesh; raise program_time_limit, or ask for larger tets or a less strict \
         quality{}", limit.as_secs_f64(), said(words)
    )]
    TimedOut {
        /// The mesher.
        mesher: ExternalMesher,
        /// The time it had.
        limit: Duration,
        /// What it said until then.
        words: String,
    },
    /// It was interrupted from outside.
    #[error("{0} was interrupted")]
    Cancelled(ExternalMesher),
    /// The program failed by its own account, or died.
    #[error("{mesher} failed ({status}){}", said_at_the_end(*mesher, words))]
    Failed {
        /// The mesher.
        mesher: ExternalMesher,
        /// Its exit status or the signal it died of.
        status: String,
        /// What it said.
        words: String,
    },
    /// The program claims success and left no tets.
    #[error("{mesher} ended without an error and without a mesh{}", said_at_the_end(*mesher, words))]
    NoMesh {
        /// The mesher.
        mesher: ExternalMesher,
        /// What it said.
        words: String,
    },
    /// Its output is no mesh file.
    #[error("the output of {mesher} cannot be read: {source}")]
    Unreadable {
        /// The mesher.
        mesher: ExternalMesher,
        /// What is wrong with it.
        source: Box<ReadError>,
    },
    /// Its tets are no mesh.
    #[error("{mesher} made a mesh that is none: {source} (tets and vertices are counted from 0)")]
    Mesh {
        /// The mesher.
        mesher: ExternalMesher,
        /// What is wrong.
        source: MeshError,
    },
    /// Its mesh fills something else than the surface.
    #[error(
        "the mesh of {mesher} does not fill the surface: {difference}; the usual cause is a surface that cuts through itself"
    )]
    OtherSolid {
        /// The mesher.
        mesher: ExternalMesher,
        /// Where they differ.
        difference: String,
    },
    /// TetGen would work for minutes and fail.
    #[error(
        "the solid is too thin for tets of good shape: as a sheet of its volume and surface it is {thickness:.1e} thick, and they would be about \
         {tets:.0e}; keep_boundary = true under [mesh] takes its triangles as they are, and flat tets, or thicken the solid"
    )]
    TooThin {
        /// Twice the volume over the area of the surface.
        thickness: f64,
        /// How many tets of that size fill it.
        tets: f64,
    },
    /// It would not make the tets small enough.
    #[error(
        "{mesher} leaves a tet of volume {largest:e}, more than max_volume = {limit:e}; {}",
        if *boundary_was_kept {
            "tets on a kept boundary are as large as its triangles: set keep_boundary = false, refine the surface, or \
             raise max_volume"
        } else {
            "raise max_volume, or give an edge_length"
        }
    )]
    TooCoarse {
        /// The mesher.
        mesher: ExternalMesher,
        /// The volume of the largest tet.
        largest: f64,
        /// What was asked for.
        limit: f64,
        /// Whether the boundary was to be kept.
        boundary_was_kept: bool,
    },
}

/// The program's words as the end of a message.
fn said(words: &str) -> String {
    if words.is_empty() { "; it said nothing".into() } else { format!("; it said:\n{words}") }
}

/// The same of a program that ended by itself: one without a word may be another program.
fn said_at_the_end(mesher: ExternalMesher, words: &str) -> String {
    if words.is_empty() {
        format!(
            "; it said nothing: see that the program that mesh.program, {} or PATH names is {mesher}",
            mesher.variable()
        )
    } else {
        said(words)
    }
}

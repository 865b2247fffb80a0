//! Low-dilatation parameterizations of solids onto the unit ball.

pub mod linalg;

pub mod dilatation;

pub mod mesh;

pub mod solid;

pub mod domain;

pub mod map;

pub mod measure;

pub mod objective;

pub mod optimize;

pub mod bound;

pub mod config;

pub mod report;

pub mod experiment;

pub mod cli;

pub use dilatation::Dilatation;
pub use domain::Domain;
pub use mesh::{TetId, TetMesh, VertexId};

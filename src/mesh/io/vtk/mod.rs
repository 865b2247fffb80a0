//! VTK's two formats of unstructured grids and of polygons: legacy `.vtk` and XML `.vtu`, `.vtp`.
//!
//! Read by ourselves. vtkio 0.7.0-rc2, the one crate for both, reads good files well, but it believes the sizes it finds:
//! a compressed `.vtu` of 957 bytes with one to three random changes made it panic in 4 % of 3,000 cases, and ask for 2 GB
//! at once in some of 20,000. A legacy file that is cut in its cell data, or has a misspelled keyword there, is read as a
//! file without that data, and an error is "Parse error: Tag", with no line. It also takes 10 s to build, and the
//! stable release (0.6.3) reads no `.vtu` of meshio at all.

mod arrays;
mod cells;
mod legacy;
mod write_legacy;
mod write_xml;
mod xml;

pub(super) use legacy::parse as parse_legacy;
pub(super) use write_legacy::write_legacy;
pub(super) use xml::{parse as parse_xml, read_pieces};

pub use write_xml::{DataArray, Values, write_hexahedra_vtu, write_points_vtu, write_surface_vtu, write_vtu};

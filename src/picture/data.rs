//! The figures of pictures as data for other viewers.

use std::path::Path;

use super::PictureError;
use super::figures::{CellFigures, OnBoundary};
use crate::mesh::io::{DataArray, Values, WriteError, write_surface_vtu};
use crate::mesh::{Cells, Vec3, VertexId};

/// The boundary of a mesh of tets, with what pictures show of it.
#[derive(Clone, Debug)]
pub struct BoundaryFigures<'a> {
    domain: &'a [Vec3],
    before: OnBoundary,
    after: Option<(&'a [Vec3], OnBoundary, Vec<CellFigures>)>,
}

impl<'a> BoundaryFigures<'a> {
    /// The figures of the boundary of `cells` with vertices at `domain`, and of the map to `image` if there is one.
    ///
    /// # Errors
    /// A mesh of boxes, or a boundary that is no closed surface.
    ///
    /// # Panics
    /// If there are fewer positions than vertices.
    pub fn of(cells: Cells, domain: &'a [Vec3], image: Option<&'a [Vec3]>) -> Result<Self, PictureError> {
        let before = OnBoundary::of(cells, domain)?;
        let after = match image {
            Some(image) => Some((image, OnBoundary::of(cells, image)?, CellFigures::all(cells, domain, image))),
            None => None,
        };
        Ok(Self { domain, before, after })
    }

    /// Writes a VTU file: the boundary's triangles, with `K`, `K_inner` and `K_outer` of their tets if there is an image, then
    /// its edges, with the `dihedral_angle` inside in degrees and with an image the `dihedral_angle_image`; where a
    /// cell is of the other kind its entry is NaN. On points: `mean_curvature`, and with an image the `image_position` and the
    /// `mean_curvature_image`.
    ///
    /// # Errors
    /// The path and the system's reason.
    pub fn write(&self, path: &Path) -> Result<(), WriteError> {
        let Self { domain, before, after } = self;
        let (triangles, edges) = (before.triangles.len(), before.dihedral_angles.len());
        let on_edges = |surface: &OnBoundary| -> Vec<f64> {
            let angles = surface.dihedral_angles.iter().map(|(_, angle)| *angle);
            std::iter::repeat_n(f64::NAN, triangles).chain(angles).collect()
        };
        let mut of_cells = vec![("dihedral_angle", on_edges(before))];
        let mut point_data =
            vec![DataArray { name: "mean_curvature", values: Values::Scalars(&before.mean_curvature) }];
        if let Some((image, after, figures)) = after {
            let of_owners = |figure: fn(&CellFigures) -> f64| -> Vec<f64> {
                let values = before.owners.iter().map(|&owner| figure(&figures[owner]));
                values.chain(std::iter::repeat_n(f64::NAN, edges)).collect()
            };
            of_cells.extend([
                ("dihedral_angle_image", on_edges(after)),
                ("K", of_owners(|figures| figures.dilatation.k())),
                ("K_inner", of_owners(|figures| figures.dilatation.inner)),
                ("K_outer", of_owners(|figures| figures.dilatation.outer)),
            ]);
            let curvature = Values::Scalars(&after.mean_curvature);
            point_data.push(DataArray { name: "mean_curvature_image", values: curvature });
            point_data.push(DataArray { name: "image_position", values: Values::Vectors(image) });
        }
        let cell_data: Vec<DataArray> =
            of_cells.iter().map(|(name, values)| DataArray { name, values: Values::Scalars(values) }).collect();
        let edges: Vec<[VertexId; 2]> = before.dihedral_angles.iter().map(|(edge, _)| *edge).collect();
        write_surface_vtu(path, domain, &before.triangles, &edges, &point_data, &cell_data)
    }
}

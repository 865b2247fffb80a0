//! The figures that are shown: of cells, of vertices and of edges of the boundary.

use std::collections::HashMap;

use super::{Colour, PictureError};
use crate::dilatation::Dilatation;
use crate::estimate::{Estimate, Estimator, on_cells};
use crate::mesh::{Cells, PolygonSoup, Vec3, VertexId};
use crate::solid::{Curvature, Surface};

/// The figures of a picture. What a colour does not ask for is empty.
#[derive(Clone, Debug, Default)]
pub(super) struct Figures {
    /// One a cell; infinite where it is flipped.
    pub(super) cells: Vec<f64>,
    /// One a vertex, for each panel; 0 off the boundary.
    pub(super) vertices: Vec<Vec<f64>>,
    /// Of the boundary's edges, lower vertex first, for each panel.
    pub(super) edges: Vec<HashMap<[VertexId; 2], f64>>,
}

/// Those of one panel that are not of cells.
#[derive(Clone, Copy, Debug)]
pub(super) struct PanelFigures<'a> {
    pub(super) vertices: Option<&'a [f64]>,
    pub(super) edges: Option<&'a HashMap<[VertexId; 2], f64>>,
}

impl Figures {
    pub(super) fn of(
        colour: Colour,
        cells: Cells,
        domain: &[Vec3],
        image: Option<&[Vec3]>,
    ) -> Result<Self, PictureError> {
        let panels = || std::iter::once(domain).chain(image);
        let of_map = |figure: fn(&CellFigures) -> f64| {
            let image = image.ok_or(PictureError::NoMap { colour })?;
            let values = CellFigures::all(cells, domain, image).iter().map(figure).collect();
            Ok(Self { cells: values, ..Self::default() })
        };
        match colour {
            Colour::K => of_map(|figures| figures.dilatation.k()),
            Colour::KInner => of_map(|figures| figures.dilatation.inner),
            Colour::KOuter => of_map(|figures| figures.dilatation.outer),
            Colour::Jacobian => of_map(|figures| figures.jacobian),
            Colour::Domain => Ok(Self::default()),
            Colour::Curvature => {
                let vertices = panels().map(|points| Ok(OnBoundary::of(cells, points)?.mean_curvature));
                Ok(Self { vertices: vertices.collect::<Result<_, PictureError>>()?, ..Self::default() })
            }
            Colour::Dihedral => {
                let edges = panels().map(|points| Ok(OnBoundary::of(cells, points)?.dihedral_angles));
                let edges = edges.map(|edges| edges.map(HashMap::from_iter));
                Ok(Self { edges: edges.collect::<Result<_, PictureError>>()?, ..Self::default() })
            }
        }
    }

    /// The figures of a panel, counted from 0.
    pub(super) fn panel(&self, column: usize) -> PanelFigures<'_> {
        PanelFigures { vertices: self.vertices.get(column).map(Vec::as_slice), edges: self.edges.get(column) }
    }

    /// All figures of all panels.
    pub(super) fn all(&self) -> impl Iterator<Item = f64> {
        let vertices = self.vertices.iter().flatten().copied();
        self.cells.iter().copied().chain(vertices).chain(self.edges.iter().flat_map(HashMap::values).copied())
    }
}

/// What a map does on one cell.
#[derive(Clone, Copy, Debug)]
pub(super) struct CellFigures {
    /// Of the gradient: exact on tets, at the middle of boxes.
    pub(super) dilatation: Dilatation,
    /// The ratio of the volumes, positive for most cells; infinite where the cell is flipped against them.
    pub(super) jacobian: f64,
}

impl CellFigures {
    pub(super) fn all(cells: Cells, domain: &[Vec3], image: &[Vec3]) -> Vec<Self> {
        let estimates = on_cells(cells, domain, image, Estimator::Gradient);
        // The image may be a mirror image as a whole.
        let positive = estimates.iter().filter(|estimate| estimate.jacobian > 0.0).count();
        let sign = if 2 * positive >= estimates.len() { 1.0 } else { -1.0 };
        let figures = |estimate: &Estimate| match estimate.jacobian * sign {
            jacobian if jacobian > 0.0 => Self { dilatation: estimate.dilatation(), jacobian },
            _ => Self { dilatation: Dilatation::FLIPPED, jacobian: f64::INFINITY },
        };
        estimates.iter().map(figures).collect()
    }
}

/// The curvature of the boundary of a mesh of tets, by the mesh's own vertices.
#[derive(Clone, Debug)]
pub(super) struct OnBoundary {
    /// Counter-clockwise seen from outside, unless the mesh is inside out.
    pub(super) triangles: Vec<[VertexId; 3]>,
    /// The tet of each triangle.
    pub(super) owners: Vec<usize>,
    /// One a vertex, 1 / length; 0 off the boundary.
    pub(super) mean_curvature: Vec<f64>,
    /// Each edge, lower vertex first, with the angle inside: degrees in (0, 360).
    pub(super) dihedral_angles: Vec<([VertexId; 2], f64)>,
}

impl OnBoundary {
    pub(super) fn of(cells: Cells, points: &[Vec3]) -> Result<Self, PictureError> {
        if let Cells::Hexahedra(_) = cells {
            return Err(PictureError::Boxes);
        }
        let (owners, polygons): (Vec<usize>, Vec<Vec<VertexId>>) = cells.boundary_faces().into_iter().unzip();
        let triangles: Vec<[VertexId; 3]> = polygons.iter().map(|face| [face[0], face[1], face[2]]).collect();
        let surface = Surface::from_soup(PolygonSoup::new(points.to_vec(), polygons))?;
        let curvature = Curvature::of(&surface);
        // A surface drops the vertices inside and keeps the order of the others.
        let mut used: Vec<VertexId> = triangles.iter().flatten().copied().collect();
        used.sort_unstable();
        used.dedup();
        let mut mean_curvature = vec![0.0; points.len()];
        used.iter().zip(&curvature.mean).for_each(|(vertex, mean)| mean_curvature[vertex.index()] = *mean);
        let angles = surface.edges().iter().zip(&curvature.dihedral_angles).map(|(edge, angle)| {
            let [a, b] = edge.vertices.map(|v| used[v.index()]);
            ([a.min(b), a.max(b)], angle.to_degrees())
        });
        Ok(Self { triangles, owners, mean_curvature, dihedral_angles: angles.collect() })
    }
}

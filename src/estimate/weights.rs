//! The measure of cells and the weights of cells at a vertex (paper eq. 23-25, Table 1).

use serde::{Deserialize, Serialize};

use crate::domain::edge_matrix;
use crate::mesh::{Cells, Vec3};

/// How much each cell at a vertex counts (paper Table 1); the weights are normalized to the sum 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema, clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Weights {
    /// All cells count the same: the paper's choice on boxes.
    Equal,
    /// The volume of the cell.
    Measure,
    /// The solid angle of the cell at the vertex: the paper's choice on tets. All cells count the same in a mesh of boxes.
    SolidAngle,
    /// The solid angle over the volume.
    SolidAnglePerMeasure,
}

impl Weights {
    /// All four.
    pub const ALL: [Self; 4] = [Self::Equal, Self::Measure, Self::SolidAngle, Self::SolidAnglePerMeasure];

    pub(super) fn of(self, cells: Cells, cell: usize, corner: usize, domain: &[Vec3]) -> f64 {
        let solid_angle = || {
            let at = |corner: usize| &domain[cells.vertices(cell)[corner].index()];
            solid_angle_of(at(corner), cells.neighbours(corner).map(at))
        };
        match self {
            Self::Equal => 1.0,
            Self::Measure => measure(cells, cell, domain),
            Self::SolidAngle => solid_angle(),
            Self::SolidAnglePerMeasure => solid_angle() / measure(cells, cell, domain),
        }
    }
}

/// The solid angle of the cone at `apex` over three points, in steradians; van Oosterom and Strackee 1983:
/// `tan(omega / 2) = |a . (b x c)| / (1 + a.b + b.c + c.a)` with unit vectors.
fn solid_angle_of(apex: &Vec3, points: [&Vec3; 3]) -> f64 {
    let [a, b, c] = points.map(|p| (p - apex).normalize());
    2.0 * a.dot(&b.cross(&c)).abs().atan2(1.0 + a.dot(&b) + b.dot(&c) + c.dot(&a))
}

/// The signed volume of a cell: of a tet by eq. 24, of a hexahedron (corners in binary order) by eq. 25, which is exact where
/// the faces are plane.
pub fn measure(cells: Cells, cell: usize, points: &[Vec3]) -> f64 {
    match cells {
        Cells::Tets(tets) => edge_matrix(Cells::tet(&tets[cell], points)).determinant() / 6.0,
        Cells::Hexahedra(cells) => {
            let x = Cells::hexahedron(&cells[cell], points);
            let e = |i: usize, j: usize| x[i] - x[j];
            e(7, 0).dot(&(e(1, 0).cross(&e(3, 5)) + e(4, 0).cross(&e(5, 6)) + e(2, 0).cross(&e(6, 3)))) / 6.0
        }
    }
}

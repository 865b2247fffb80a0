//! Affine maps: the same Jacobian everywhere (paper §2.3).

use serde::{Deserialize, Serialize};

use super::{ClosedForm, MapError};
use crate::dilatation::Dilatation;
use crate::linalg::svd;
use crate::mesh::{Mat3, Vec3};

/// x -> A x + b, with det A not 0; negative for a mirror image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Affine {
    /// A, by rows.
    pub matrix: [[f64; 3]; 3],
    /// b; 0 if not given.
    #[serde(default)]
    pub offset: [f64; 3],
}

impl Affine {
    fn linear(&self) -> Mat3 {
        Mat3::from_fn(|row, column| self.matrix[row][column])
    }
}

impl ClosedForm for Affine {
    fn name(&self) -> &'static str {
        "affine"
    }

    fn check(&self) -> Result<(), MapError> {
        let value = self.linear().determinant();
        let finite = self.matrix.iter().flatten().chain(&self.offset).all(|entry| entry.is_finite());
        if finite && value != 0.0 {
            Ok(())
        } else {
            let requirement = "it must not be 0, and all entries must be finite";
            Err(MapError::Parameter { parameter: "the determinant of `matrix`", value, requirement })
        }
    }

    fn value(&self, x: &Vec3) -> Result<Vec3, MapError> {
        Ok(self.linear() * x + Vec3::from(self.offset))
    }

    fn jacobian(&self, _: &Vec3) -> Result<Mat3, MapError> {
        Ok(self.linear())
    }

    fn dilatation(&self, _: &Vec3) -> Result<Dilatation, MapError> {
        Ok(Dilatation::of_stretches(svd(&self.linear()).values))
    }

    fn max_dilatation(&self) -> Option<Dilatation> {
        Some(Dilatation::of_stretches(svd(&self.linear()).values))
    }
}

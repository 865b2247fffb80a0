//! The soft maximum as argmin's solvers see it: a function of the displacement of the free vertices.

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use argmin::core::{CostFunction, Error, Gradient, Hessian};
use argmin_math::ArgminDot;

use super::line_search::dot;
use crate::mesh::Vec3;
use crate::objective::{Assembly, Iterate, SoftMax};

/// `scale * E_p` as a function of the displacement of the free vertices from `start`, in units of `unit`; infinite where a
/// tet is flipped.
pub(super) struct Displacement<'a, 'd> {
    /// Shared and exclusive by turns: second derivatives are assembled in its workspace.
    pub(super) assembly: &'a RefCell<&'a mut Assembly<'d>>,
    pub(super) start: Vec<Vec3>,
    pub(super) exponent: f64,
    /// A length of the image's size, so that argmin's absolute constants mean the same at any size.
    pub(super) unit: f64,
    pub(super) scale: f64,
    /// Most products with one Hessian.
    pub(super) products: usize,
}

impl Displacement<'_, '_> {
    /// The map at a displacement.
    fn at(&self, displacement: &[f64]) -> Iterate {
        let image = self.moved(displacement);
        self.assembly.borrow().at(image)
    }

    /// The image at a displacement.
    pub(super) fn moved(&self, displacement: &[f64]) -> Vec<Vec3> {
        self.assembly.borrow().moved(&self.start, displacement, self.unit)
    }

    /// The energy centred at a map, and its sum there; `None` if a tet is flipped.
    fn energy(&self, iterate: &Iterate) -> Option<(SoftMax, f64)> {
        let energy = SoftMax::new(self.exponent, iterate.largest_log()?);
        Some((energy, self.assembly.borrow().value(&energy, iterate)?))
    }

    /// The derivative of `scale * E_p` with respect to ln of the sum, times the unit.
    fn outer(&self) -> f64 {
        1.5 / self.exponent * self.scale * self.unit
    }
}

fn flipped() -> Error {
    Error::msg("derivatives were asked for at a map with a flipped tet")
}

impl CostFunction for Displacement<'_, '_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, displacement: &Self::Param) -> Result<f64, Error> {
        let value = self.energy(&self.at(displacement)).map(|(energy, sum)| self.scale * energy.log_k(sum));
        Ok(value.unwrap_or(f64::INFINITY))
    }
}

impl Gradient for Displacement<'_, '_> {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;

    fn gradient(&self, displacement: &Self::Param) -> Result<Vec<f64>, Error> {
        let iterate = self.at(displacement);
        let (energy, sum) = self.energy(&iterate).ok_or_else(flipped)?;
        let mut gradient = self.assembly.borrow().gradient(&energy, &iterate).ok_or_else(flipped)?;
        gradient.iter_mut().for_each(|g| *g *= self.outer() / sum);
        Ok(gradient)
    }
}

impl<'a, 'd> Hessian for Displacement<'a, 'd> {
    type Param = Vec<f64>;
    type Hessian = SoftMaxHessian<'a, 'd>;

    fn hessian(&self, displacement: &Self::Param) -> Result<Self::Hessian, Error> {
        let iterate = self.at(displacement);
        let (energy, sum) = self.energy(&iterate).ok_or_else(flipped)?;
        let mut assembly = self.assembly.borrow_mut();
        let mut gradient = assembly.linearize(&energy, &iterate, NEGATIVE).ok_or_else(flipped)?;
        gradient.iter_mut().for_each(|g| *g /= sum);
        Ok(SoftMaxHessian {
            assembly: self.assembly,
            gradient: gradient.into(),
            sum,
            factor: self.outer() * self.unit,
            left: Rc::new(Cell::new(self.products)),
        })
    }
}

/// Share of the tets' negative curvature that is kept: with all of it the conjugate gradients see the true Hessian, and
/// convergence at the end is fast; both solvers can deal with directions of negative curvature.
const NEGATIVE: f64 = 1.0;

/// `factor * (H / S - g g^T)`: the Hessian of a multiple of ln S, H assembled for the sum S and g its relative gradient.
///
/// H is in the assembly's workspace, so only the youngest of these is valid; argmin's solvers hold one (and clones of it).
#[derive(Clone)]
pub(super) struct SoftMaxHessian<'a, 'd> {
    assembly: &'a RefCell<&'a mut Assembly<'d>>,
    gradient: Rc<[f64]>,
    sum: f64,
    factor: f64,
    /// How many products may still be asked for.
    left: Rc<Cell<usize>>,
}

impl ArgminDot<Vec<f64>, Vec<f64>> for SoftMaxHessian<'_, '_> {
    /// The product; 0 once the budget is spent: the conjugate gradients of argmin's Newton-CG have no limit of their own, but
    /// end where they see no curvature, with the direction found so far.
    fn dot(&self, direction: &Vec<f64>) -> Vec<f64> {
        let Some(left) = self.left.get().checked_sub(1) else { return vec![0.0; direction.len()] };
        self.left.set(left);
        let mut product = self.assembly.borrow_mut().system().multiply(direction);
        let along = dot(&self.gradient, direction);
        for (entry, g) in product.iter_mut().zip(self.gradient.iter()) {
            *entry = self.factor * (*entry / self.sum - g * along);
        }
        product
    }
}

//! ln K_O and ln K_I of every tet with their gradients: the constraints of the epigraph form.

use super::element::{centred_logs, derivative_from, gradient_before};
use crate::domain::Domain;
use crate::linalg::{Svd, svd};
use crate::mesh::{Mat3, TetId, Vec3};

/// A function of one tet and its derivatives with respect to the tet's four vertices.
#[derive(Clone, Copy, Debug)]
pub struct TetFunction {
    /// The value.
    pub value: f64,
    /// The derivatives.
    pub gradient: [Vec3; 4],
}

/// `ln K_O = 3 l_1` and `ln K_I = -3 l_3` of a tet; `None` if it is flipped.
///
/// Where the two largest (least) singular values coincide the first (second) has no gradient; one of its generalised
/// gradients is given.
pub fn log_dilatations(domain: &Domain, tet: TetId, image: &[Vec3]) -> Option<[TetFunction; 2]> {
    of_decomposition(&svd(&domain.jacobian(tet, image)), domain, tet)
}

/// The same of a Jacobian with this decomposition, each with its derivative with respect to the Jacobian's entries.
pub fn of_jacobian(decomposition: &Svd) -> Option<[(f64, Mat3); 2]> {
    let s = decomposition.values;
    let logs = centred_logs(s)?;
    Some([(0, 3.0), (2, -3.0)].map(|(axis, factor)| {
        // dl_a / ds_i = (delta_ai - 1/3) / s_i.
        let slope = [0, 1, 2].map(|i| factor * (f64::from(u8::from(i == axis)) - 1.0 / 3.0) / s[i]);
        (factor * logs[axis], derivative_from(decomposition, slope))
    }))
}

/// [`log_dilatations`] from the decomposition of the tet's Jacobian.
pub(super) fn of_decomposition(decomposition: &Svd, domain: &Domain, tet: TetId) -> Option<[TetFunction; 2]> {
    let of_jacobian = of_jacobian(decomposition)?;
    Some(of_jacobian.map(|(value, derivative)| {
        let inverse_edges = &domain.inverse_edges()[tet.index()];
        TetFunction { value, gradient: gradient_before(derivative, inverse_edges, domain.afterwards(tet)) }
    }))
}

//! ln K_O and ln K_I of every tet with their gradients: the constraints of the epigraph form.

use super::element::{centred_logs, gradient_before, gradient_from};
use crate::domain::Domain;
use crate::linalg::{Svd, svd};
use crate::mesh::{TetId, Vec3};

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

/// The same from the decomposition of the tet's Jacobian.
pub(super) fn of_decomposition(decomposition: &Svd, domain: &Domain, tet: TetId) -> Option<[TetFunction; 2]> {
    let s = decomposition.values;
    let logs = centred_logs(s)?;
    Some([(0, 3.0), (2, -3.0)].map(|(axis, factor)| {
        // dl_a / ds_i = (delta_ai - 1/3) / s_i.
        let slope = [0, 1, 2].map(|i| factor * (f64::from(u8::from(i == axis)) - 1.0 / 3.0) / s[i]);
        let gradient = gradient_from(decomposition, slope, &domain.inverse_edges()[tet.index()]);
        let gradient = gradient_before(gradient, domain.afterwards(tet));
        TetFunction { value: factor * logs[axis], gradient }
    }))
}

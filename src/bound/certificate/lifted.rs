//! One tet of the lifted problem: its Gram matrix, cofactors and determinant as linear functions of moments, and its barrier.

use nalgebra::{DMatrix, DVector, SMatrix, SVector};

use super::dual::{Dual, Level};
use crate::mesh::{Mat3, Vec3};

/// Figures of a tet that are linear in the moments: six entries of G, nine of C, and d.
const FIGURES: usize = 16;
/// The place of d among them.
const DETERMINANT: usize = 15;
/// The place of delta among the arguments of the barrier.
const SIZE: usize = 16;
/// The place of the slack.
const SLACK: usize = 17;
/// Number of arguments: the figures, delta and the slack.
pub(super) const ARGUMENTS: usize = 18;
/// Rows and columns of the six entries of a symmetric matrix.
const ENTRIES: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

/// A tet whose Jacobian is divided by the cube root of the determinant that it has at the start.
pub(super) struct LiftedTet {
    /// The moments that the figures depend on; 0 is the constant 1.
    moments: Vec<usize>,
    /// The figures as functions of these moments.
    map: DMatrix<f64>,
    /// Whether d is a quadratic function of the free vertices: at most two are free.
    has_determinant: bool,
    /// The cube root of the determinant of the Jacobian at the start, in plain coordinates.
    scale: f64,
}

/// The barrier of a tet and its derivatives by the figures, delta and the slack.
pub(super) struct Derivatives {
    pub(super) gradient: SVector<f64, ARGUMENTS>,
    pub(super) hessian: SMatrix<f64, ARGUMENTS, ARGUMENTS>,
}

/// The index of the moment `z_i z_j` of `z = (1, positions)`, `i <= j`.
pub(super) fn moment(i: usize, j: usize) -> usize {
    j * (j + 1) / 2 + i
}

impl LiftedTet {
    /// A tet with these gradients of barycentric coordinates and these positions of its corners at the start. A free corner
    /// has the number of its vertex and a length: the unknowns are its displacements in such lengths, so that moments are
    /// about 1. Positions are those of the image divided by `size`; `determinant`, positive, is that of their Jacobian.
    pub(super) fn new(
        gradients: &[Vec3; 4],
        positions: &[Vec3; 4],
        corners: &[Option<(usize, f64)>; 4],
        determinant: f64,
        size: f64,
    ) -> Self {
        let mut fixed_part = Mat3::zeros();
        // Free vertices and their gradients.
        let mut free: Vec<(usize, Vec3)> = Vec::new();
        for ((corner, gradient), position) in corners.iter().zip(gradients).zip(positions) {
            let gradient = gradient / determinant.cbrt();
            fixed_part += position * gradient.transpose();
            if let Some((vertex, length)) = corner {
                free.push((*vertex, gradient * *length));
            }
        }
        let count = 3 * free.len() + 1;
        let places: Vec<usize> = std::iter::once(0)
            .chain(free.iter().flat_map(|(vertex, _)| (0..3).map(move |coordinate| 1 + 3 * vertex + coordinate)))
            .collect();
        // Each entry of the Jacobian as a function of (1, displacements of the free corners).
        let entry = |row: usize, column: usize| {
            let mut function = DVector::zeros(count);
            function[0] = fixed_part[(row, column)];
            for (index, (_, gradient)) in free.iter().enumerate() {
                function[1 + 3 * index + row] = gradient[column];
            }
            function
        };
        let mut forms: Vec<DMatrix<f64>> = Vec::with_capacity(FIGURES);
        for (i, j) in ENTRIES {
            forms.push((0..3).map(|row| entry(row, i) * entry(row, j).transpose()).sum());
        }
        for (row, column) in (0..9).map(|index| (index / 3, index % 3)) {
            let ([r1, r2], [c1, c2]) = ([1, 2].map(|i| (row + i) % 3), [1, 2].map(|i| (column + i) % 3));
            forms.push(entry(r1, c1) * entry(r2, c2).transpose() - entry(r1, c2) * entry(r2, c1).transpose());
        }
        let has_determinant = free.len() <= 2;
        let mut form = DMatrix::zeros(count, count);
        if has_determinant {
            // det(F + H) = det F + <cof F, H> + <F, cof H>, since cof H has rank 1 at most.
            form[(0, 0)] = fixed_part.determinant();
            let cofactors = cofactors(&fixed_part);
            for (index, (_, gradient)) in free.iter().enumerate() {
                let slope = cofactors * gradient;
                (0..3).for_each(|coordinate| form[(0, 1 + 3 * index + coordinate)] = slope[coordinate]);
            }
            if let [(_, first), (_, second)] = free[..] {
                let axis = fixed_part * first.cross(&second);
                for i in 0..3 {
                    form[(1 + (i + 1) % 3, 4 + (i + 2) % 3)] = axis[i];
                    form[(1 + (i + 2) % 3, 4 + (i + 1) % 3)] = -axis[i];
                }
            }
        }
        forms.push(form);
        let pairs: Vec<(usize, usize)> = (0..count).flat_map(|j| (0..=j).map(move |i| (i, j))).collect();
        let map = DMatrix::from_fn(FIGURES, pairs.len(), |figure, pair| {
            let (i, j) = pairs[pair];
            let form = &forms[figure];
            if i == j { form[(i, i)] } else { form[(i, j)] + form[(j, i)] }
        });
        let moments = pairs.iter().map(|&(i, j)| moment(places[i].min(places[j]), places[i].max(places[j]))).collect();
        Self { moments, map, has_determinant, scale: determinant.cbrt() * size }
    }

    /// The tet as one of a mixture: its figures are the sums of those of the parts, the moments of which follow each other in blocks of
    /// `block`, less the squared change of the Jacobian along a gradient times the moment of the given number.
    pub(super) fn mixed(parts: Vec<Self>, block: usize, less: Option<(usize, Vec3)>) -> Self {
        let (has_determinant, scale) = (parts[0].has_determinant, parts[0].scale);
        let mut moments = Vec::new();
        let mut columns: Vec<DVector<f64>> = Vec::new();
        for (index, part) in parts.iter().enumerate() {
            moments.extend(part.moments.iter().map(|place| place + index * block));
            columns.extend(part.map.column_iter().map(|column| column.into_owned()));
        }
        if let Some((place, gradient)) = less {
            moments.push(place);
            let mut column = DVector::zeros(FIGURES);
            for (entry, (i, j)) in ENTRIES.into_iter().enumerate() {
                column[entry] = -gradient[i] * gradient[j];
            }
            columns.push(column);
        }
        Self { moments, map: DMatrix::from_columns(&columns), has_determinant, scale }
    }

    /// Number of terms of its barrier, the parameter that the accuracy of a centred point is counted by.
    pub(super) const TERMS: usize = 16;

    /// The moments that the figures depend on.
    pub(super) fn moments(&self) -> &[usize] {
        &self.moments
    }

    /// The map from these moments to the figures.
    pub(super) fn map(&self) -> &DMatrix<f64> {
        &self.map
    }

    fn figures(&self, moments: &[f64]) -> SVector<f64, FIGURES> {
        let mut figures = SVector::zeros();
        for (column, &index) in self.moments.iter().enumerate() {
            for figure in 0..FIGURES {
                figures[figure] += self.map[(figure, column)] * moments[index];
            }
        }
        figures
    }

    /// The barrier: minus the logarithms of how far all conditions of the level hold with `slack` to spare; `None` where one
    /// does not. Derivatives are added if wanted.
    pub(super) fn barrier(
        &self,
        moments: &[f64],
        delta: f64,
        slack: f64,
        level: &Level,
        mut derivatives: Option<&mut Derivatives>,
    ) -> Option<f64> {
        let figures = self.figures(moments);
        let (gram, cofactors, determinant) = parts(&figures);
        let (identity, root) = (Mat3::identity(), level.root);
        let least = 1.0 / level.middle;
        let mut value = 0.0;
        // k^(-2/3) delta I <= G <= k^(2/3) delta I.
        let mut bases = [(0, Mat3::zeros()); 8];
        for (index, (i, j)) in ENTRIES.into_iter().enumerate() {
            let mut basis = Mat3::zeros();
            (basis[(i, j)], basis[(j, i)]) = (1.0, 1.0);
            bases[index] = (index, basis);
        }
        (bases[6], bases[7]) = ((SIZE, -least * identity), (SLACK, -identity));
        value += add_block(&(gram - identity * (least * delta + slack)), &bases, &mut derivatives)?;
        let gram_bases = bases;
        bases[..6].iter_mut().for_each(|(_, basis)| *basis = -*basis);
        bases[6].1 = identity * level.middle;
        value += add_block(&(identity * (level.middle * delta - slack) - gram), &bases, &mut derivatives)?;
        // tr G <= c k^(-2/3) delta.
        let most = level.trace * least;
        let mut slope = SVector::<f64, ARGUMENTS>::zeros();
        [0, 3, 5].into_iter().for_each(|diagonal| slope[diagonal] = -1.0);
        (slope[SIZE], slope[SLACK]) = (most, -1.0);
        value += add_logarithm(most * delta - slack - gram.trace(), &slope, &mut derivatives)?;
        // |C| <= k^(1/3) delta.
        let mut block = SMatrix::<f64, 6, 6>::identity() * (root * delta - slack);
        block.fixed_view_mut::<3, 3>(0, 3).copy_from(&cofactors);
        block.fixed_view_mut::<3, 3>(3, 0).copy_from(&cofactors.transpose());
        let mut bases = [(0, SMatrix::<f64, 6, 6>::zeros()); 11];
        for (index, (argument, basis)) in bases[..9].iter_mut().enumerate() {
            let (row, column) = (index / 3, 3 + index % 3);
            *argument = 6 + index;
            (basis[(row, column)], basis[(column, row)]) = (1.0, 1.0);
        }
        bases[9] = (SIZE, SMatrix::identity() * root);
        bases[10] = (SLACK, -SMatrix::identity());
        value += add_block(&block, &bases, &mut derivatives)?;
        // delta <= d^(2/3), or delta <= (det G)^(1/3) where d is no function of the moments.
        let mut slope = SVector::<f64, ARGUMENTS>::zeros();
        (slope[SIZE], slope[SLACK]) = (-1.0, -1.0);
        if self.has_determinant {
            if determinant <= 0.0 {
                return None;
            }
            let power = determinant.cbrt().powi(2);
            slope[DETERMINANT] = 2.0 / 3.0 * power / determinant;
            let spare = power - delta - slack;
            value += add_logarithm(spare, &slope, &mut derivatives)?;
            if let Some(derivatives) = &mut derivatives {
                derivatives.hessian[(DETERMINANT, DETERMINANT)] +=
                    2.0 / 9.0 * power / (determinant * determinant * spare);
            }
            let mut slope = SVector::<f64, ARGUMENTS>::zeros();
            slope[DETERMINANT] = 1.0;
            value += add_logarithm(determinant, &slope, &mut derivatives)?;
        } else {
            let inverse = gram.cholesky()?.inverse();
            let mean = gram.determinant().cbrt();
            let images = [0, 1, 2, 3, 4, 5].map(|entry| inverse * gram_bases[entry].1);
            (0..6).for_each(|entry| slope[entry] = mean / 3.0 * images[entry].trace());
            let spare = mean - delta - slack;
            value += add_logarithm(spare, &slope, &mut derivatives)?;
            if let Some(derivatives) = &mut derivatives {
                for (i, j) in (0..36).map(|index| (index / 6, index % 6)) {
                    let second = images[i].trace() * images[j].trace() / 9.0 - (images[i] * images[j]).trace() / 3.0;
                    derivatives.hessian[(i, j)] -= mean * second / spare;
                }
            }
            value += add_block(&gram, &gram_bases[..6], &mut derivatives)?;
        }
        value.is_finite().then_some(value)
    }

    /// The multipliers of the barrier's conditions at a point where it is finite.
    pub(super) fn dual(&self, moments: &[f64], delta: f64, slack: f64, level: &Level) -> Option<Dual> {
        let figures = self.figures(moments);
        let (gram, _, determinant) = parts(&figures);
        let identity = Mat3::identity();
        let least = 1.0 / level.middle;
        let inverse = |matrix: Mat3| matrix.cholesky().map(|factor| factor.inverse());
        let mut derivatives = Derivatives::zero();
        self.barrier(moments, delta, slack, level, Some(&mut derivatives))?;
        let area = self.scale * self.scale;
        let mut dual = Dual {
            lower: inverse(gram - identity * (least * delta + slack))? / area,
            upper: inverse(identity * (level.middle * delta - slack) - gram)? / area,
            trace: 1.0 / (level.trace * least * delta - slack - gram.trace()) / area,
            volume: Mat3::zeros(),
            cofactor: Mat3::from_fn(|row, column| derivatives.gradient[6 + 3 * row + column]) / area,
            determinant: [0.0; 2],
        };
        if self.has_determinant {
            let weight = -derivatives.gradient[DETERMINANT];
            dual.determinant = [weight / (area * self.scale), determinant.cbrt() * self.scale];
        } else {
            let mean = gram.determinant().cbrt();
            dual.volume = inverse(gram)? * ((1.0 + mean / 3.0 / (mean - delta - slack)) / area);
        }
        Some(dual)
    }
}

impl Derivatives {
    pub(super) fn zero() -> Self {
        Self { gradient: SVector::zeros(), hessian: SMatrix::zeros() }
    }
}

fn parts(figures: &SVector<f64, FIGURES>) -> (Mat3, Mat3, f64) {
    let mut gram = Mat3::zeros();
    for (index, (i, j)) in ENTRIES.into_iter().enumerate() {
        (gram[(i, j)], gram[(j, i)]) = (figures[index], figures[index]);
    }
    (gram, Mat3::from_fn(|row, column| figures[6 + 3 * row + column]), figures[DETERMINANT])
}

/// `cof A`, the derivative of `det A`.
fn cofactors(a: &Mat3) -> Mat3 {
    let columns = [0, 1, 2].map(|i| a.column(i).into_owned());
    Mat3::from_columns(&[0, 1, 2].map(|i| columns[(i + 1) % 3].cross(&columns[(i + 2) % 3])))
}

/// `-ln det` of a matrix whose derivatives by some arguments are given; `None` if it is not positive definite.
fn add_block<const D: usize>(
    block: &SMatrix<f64, D, D>,
    bases: &[(usize, SMatrix<f64, D, D>)],
    derivatives: &mut Option<&mut Derivatives>,
) -> Option<f64> {
    let factor = block.cholesky()?;
    let l = factor.l_dirty();
    let value = -2.0 * (0..D).map(|i| l[(i, i)].ln()).sum::<f64>();
    if let Some(derivatives) = derivatives {
        let inverse = factor.inverse();
        let images: Vec<SMatrix<f64, D, D>> = bases.iter().map(|(_, basis)| inverse * basis).collect();
        for (&(row, _), image) in bases.iter().zip(&images) {
            derivatives.gradient[row] -= image.trace();
            let transposed = image.transpose();
            for (&(column, _), other) in bases.iter().zip(&images) {
                derivatives.hessian[(row, column)] += transposed.dot(other);
            }
        }
    }
    Some(value)
}

/// `-ln` of a number with this gradient; `None` if it is not positive.
fn add_logarithm(
    number: f64,
    slope: &SVector<f64, ARGUMENTS>,
    derivatives: &mut Option<&mut Derivatives>,
) -> Option<f64> {
    if !(number > 0.0 && number.is_finite()) {
        return None;
    }
    if let Some(derivatives) = derivatives {
        derivatives.gradient -= slope / number;
        derivatives.hessian += slope * slope.transpose() / (number * number);
    }
    Some(-number.ln())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn number(seed: usize) -> f64 {
        (seed as f64 * 12.9898 + 4.0).sin()
    }

    /// A tet with the numbers of free corners from 0 on, its Jacobian at displacements z and the moments of z.
    fn tet(free: usize) -> (LiftedTet, Mat3, Vec<f64>) {
        let vector = |seed: usize| Vec3::from_fn(|i, _| 0.2 * number(3 * seed + i));
        let [a, b, c] = [0, 1, 2].map(|i| Vec3::ith(i, 1.0) + vector(i));
        let positions = [vector(4), a + vector(5), b + vector(6), c + vector(7)];
        let edges = Mat3::from_columns(&[a, b, c].map(|corner| corner - vector(4)));
        let inverse = edges.try_inverse().unwrap();
        let [g1, g2, g3] = [0, 1, 2].map(|row| inverse.row(row).transpose());
        let gradients = [-(g1 + g2 + g3), g1, g2, g3];
        let corners = std::array::from_fn(|i| (i < free).then_some((i, 0.5)));
        let at = |displaced: f64| -> Mat3 {
            let ends = (0..4).map(|i| positions[i] + if i < free { vector(i + 20) * displaced } else { Vec3::zeros() });
            ends.zip(&gradients).map(|(end, gradient)| end * gradient.transpose()).sum()
        };
        let determinant = at(0.0).determinant();
        assert!(determinant > 0.0);
        let z: Vec<f64> =
            std::iter::once(1.0).chain((0..free).flat_map(|i| [0, 1, 2].map(|c| vector(i + 20)[c] / 0.5))).collect();
        let pairs = (0..z.len()).flat_map(|j| (0..=j).map(move |i| (i, j)));
        let moments = pairs.map(|(i, j)| z[i] * z[j]).collect();
        (LiftedTet::new(&gradients, &positions, &corners, determinant, 2.0), at(1.0) / determinant.cbrt(), moments)
    }

    #[test]
    fn figures_are_those_of_the_jacobian() {
        for free in 1..=4 {
            let (tet, jacobian, moments) = tet(free);
            let (gram, found, d) = parts(&tet.figures(&moments));
            assert!((gram - jacobian.transpose() * jacobian).norm() < 1e-13);
            assert!((found - cofactors(&jacobian)).norm() < 1e-13);
            let product = cofactors(&jacobian).transpose() * jacobian;
            assert!((product - Mat3::identity() * jacobian.determinant()).norm() < 1e-13);
            assert!(free > 2 || (d - jacobian.determinant()).abs() < 1e-13);
        }
    }

    #[test]
    fn derivatives_match_differences_and_multipliers_the_gradient() {
        for free in 1..=4 {
            let (tet, _, mut moments) = tet(free);
            let level = Level::new(7.0f64.ln());
            (1..=3 * free).for_each(|i| moments[moment(i, i)] += 1e-3);
            let (delta, slack) = (0.9, -2.0);
            let mut derivatives = Derivatives::zero();
            tet.barrier(&moments, delta, slack, &level, Some(&mut derivatives)).unwrap();
            for seed in 0..5 {
                let moved: Vec<f64> =
                    (0..moments.len()).map(|i| if i == 0 { 0.0 } else { number(i + 91 * seed) }).collect();
                let mut direction = SVector::<f64, ARGUMENTS>::zeros();
                direction.fixed_rows_mut::<FIGURES>(0).copy_from(&tet.figures(&moved));
                (direction[SIZE], direction[SLACK]) = (number(seed), number(seed + 7));
                let at = |step: f64| {
                    let moments: Vec<f64> = moments.iter().zip(&moved).map(|(a, b)| a + step * b).collect();
                    let (delta, slack) = (delta + step * direction[SIZE], slack + step * direction[SLACK]);
                    tet.barrier(&moments, delta, slack, &level, None).unwrap()
                };
                // Truncation h^2 times third and fourth derivatives of some hundreds; rounding 1e-15 / h and / h^2.
                let h = 1e-4;
                let (up, middle, down) = (at(h), at(0.0), at(-h));
                let first = derivatives.gradient.dot(&direction);
                let second = direction.dot(&(derivatives.hessian * direction));
                let size = 10.0 + second.abs();
                assert!(((up - down) / (2.0 * h) - first).abs() < 1e-4 * size, "{free}: {first}");
                assert!(((up + down - 2.0 * middle) / (h * h) - second).abs() < 1e-3 * size, "{free}: {second}");
            }
            // Minus the gradient by G is the form of the multipliers.
            let dual = tet.dual(&moments, delta, slack, &level).unwrap();
            let form = (dual.lower + dual.volume - dual.upper - Mat3::identity() * dual.trace) * tet.scale.powi(2);
            for (index, (i, j)) in ENTRIES.into_iter().enumerate() {
                let expected = form[(i, j)] * if i == j { -1.0 } else { -2.0 };
                assert!((derivatives.gradient[index] - expected).abs() < 1e-9 * form.norm());
            }
        }
    }
}

//! The check of a certificate: interval arithmetic and one sparse Cholesky factorization with an a-priori error bound.

use super::Rejection;
use super::interval::{Interval, cross, dot};
use super::multipliers::Multipliers;
use crate::domain::Domain;
use crate::linalg::BlockCholesky;
use crate::mesh::{TetId, Vec3, VertexId};

/// Solutions of the maximiser with the gradient taken anew: the factor is that of a shifted matrix.
const REFINEMENTS: usize = 4;

/// A sub-complex prepared for checks at several levels and with several multipliers.
pub(super) struct Checker<'a> {
    domain: &'a Domain,
    tets: Vec<TetId>,
    /// Gradients of the barycentric coordinates of each tet.
    gradients: Vec<[[Interval; 3]; 4]>,
    /// The unknown of each vertex of each tet; none for vertices of the boundary.
    unknowns: Vec<[Option<u32>; 4]>,
    /// The free vertices, by unknown.
    free: Vec<VertexId>,
    /// Rows of the lower triangle of minus Lambda22, columns of which start at `starts`.
    starts: Vec<usize>,
    rows: Vec<u32>,
    factor: BlockCholesky,
}

impl<'a> Checker<'a> {
    /// Prepares the sub-complex of some tets.
    ///
    /// # Errors
    /// A tet too flat for interval arithmetic; a system that cannot be held.
    pub(super) fn new(domain: &'a Domain, tets: Vec<TetId>) -> Result<Self, Rejection> {
        let mesh = domain.mesh();
        let gradients = tets
            .iter()
            .map(|&tet| gradients(mesh.corners(tet)).ok_or(Rejection::Degenerate { tet: tet.0 }))
            .collect::<Result<_, _>>()?;
        let vertices = tets.iter().flat_map(|tet| mesh.tets()[tet.index()]);
        let mut free: Vec<VertexId> = vertices.filter(|&v| !domain.boundary().contains(v)).collect();
        free.sort_unstable();
        free.dedup();
        if free.is_empty() {
            return Err(Rejection::NothingFree);
        }
        let unknown = |v: VertexId| free.binary_search(&v).ok().map(|unknown| unknown as u32);
        let unknowns: Vec<[Option<u32>; 4]> = tets.iter().map(|tet| mesh.tets()[tet.index()].map(unknown)).collect();
        let edges: Vec<(u32, u32)> = unknowns.iter().flat_map(pairs).map(|(_, _, row, column)| (row, column)).collect();
        let edges: Vec<(u32, u32)> = edges.into_iter().filter(|(row, column)| row > column).collect();
        let factor = BlockCholesky::with_block_size(1, free.len(), &edges).map_err(|_| Rejection::TooLarge)?;
        let (starts, rows) = (factor.column_starts().to_vec(), factor.rows().to_vec());
        Ok(Self { domain, tets, gradients, unknowns, free, starts, rows, factor })
    }

    /// Whether the multipliers, one a tet, prove K > `level` for every choice of the free vertices.
    ///
    /// # Errors
    /// The first condition that could not be verified.
    pub(super) fn check(&mut self, level: f64, multipliers: &[Multipliers], image: &[Vec3]) -> Result<(), Rejection> {
        for (tet, multipliers) in self.tets.iter().zip(multipliers) {
            if !multipliers.satisfy_the_trace_condition(level) {
                return Err(Rejection::TraceCondition { tet: tet.0 });
            }
        }
        let forms: Vec<[[Interval; 3]; 3]> = multipliers.iter().map(Multipliers::form).collect();
        let (scale, smallest) = self.factorize(&forms)?;
        let fixed = |v: VertexId| self.domain.boundary().contains(v).then(|| image[v.index()]);
        let corners = self.tets.iter().flat_map(|tet| self.domain.mesh().tets()[tet.index()]);
        let Some(any) = corners.into_iter().find_map(fixed) else { return Err(Rejection::NotConcave) };
        let mut positions = image.to_vec();
        self.free.iter().for_each(|v| positions[v.index()] = any);
        for _ in 0..REFINEMENTS {
            let (_, gradient) = self.evaluate(&forms, &positions);
            for coordinate in 0..3 {
                let mut step: Vec<f64> =
                    gradient.iter().zip(&scale).map(|(g, scale)| 0.5 * scale * g[coordinate].middle()).collect();
                self.factor.solve(&mut step);
                for ((vertex, step), scale) in self.free.iter().zip(step).zip(&scale) {
                    positions[vertex.index()][coordinate] += scale * step;
                }
            }
        }
        let (mut largest, gradient) = self.evaluate(&forms, &positions);
        // max over d of r . d - d^T (-Lambda22) d <= |D r|^2 / (4 smallest eigenvalue of D (-Lambda22) D).
        let quarter = Interval::exactly(4.0 * smallest).reciprocal().ok_or(Rejection::NotConcave)?;
        for (gradient, &scale) in gradient.iter().zip(&scale) {
            let scaled = gradient.map(|g| g * Interval::exactly(scale));
            largest = largest + dot(scaled, scaled) * quarter;
        }
        if largest.upper < 0.0 { Ok(()) } else { Err(Rejection::NotNegative) }
    }

    /// Factorises `D (-Lambda22) D - s I` with powers of two D that make the diagonal about 1; returns D and a positive
    /// lower bound for the smallest eigenvalue of `D (-Lambda22) D`.
    ///
    /// If the Cholesky factorization of a matrix A in floating point runs to its end, with sums in any order, then
    /// `|L L^T - A| <= g |L| |L|^T` entry by entry with `g = (n + 1) u / (1 - (n + 1) u)`, and so A is above
    /// `-g / (1 - g) tr A` (Higham, Accuracy and Stability, Theorems 10.3 and 10.5; Rump, BIT 2006). We take more than
    /// four times that, for factorizations that multiply by reciprocals, and the radii of the entries' intervals.
    fn factorize(&mut self, forms: &[[[Interval; 3]; 3]]) -> Result<(Vec<f64>, f64), Rejection> {
        let count = self.free.len();
        let mut entries = vec![Interval::ZERO; self.rows.len()];
        for ((form, gradients), unknowns) in forms.iter().zip(&self.gradients).zip(&self.unknowns) {
            let images = gradients.map(|gradient| form.map(|row| dot(row, gradient)));
            for (i, j, row, column) in pairs(unknowns) {
                let slot = self.slot(row, column);
                entries[slot] = entries[slot] - dot(images[i], gradients[j]);
            }
        }
        let mut scale = Vec::with_capacity(count);
        for &start in &self.starts[..count] {
            let diagonal = entries[start];
            if !(diagonal.lower > 0.0 && diagonal.upper.is_finite()) {
                return Err(Rejection::NotConcave);
            }
            scale.push((-0.5 * diagonal.upper.log2()).round().exp2());
        }
        let mut radii = vec![0.0f64; count];
        let mut trace = 0.0;
        let values = self.factor.values_mut();
        for column in 0..count {
            for slot in self.starts[column]..self.starts[column + 1] {
                let row = self.rows[slot] as usize;
                let entry = entries[slot] * Interval::exactly(scale[row]) * Interval::exactly(scale[column]);
                values[slot] = entry.middle();
                let radius = entry.distance_from(values[slot]);
                radii[row] = (radii[row] + radius).next_up();
                if row == column {
                    trace += values[slot];
                } else {
                    radii[column] = (radii[column] + radius).next_up();
                }
            }
        }
        let radius = radii.iter().copied().fold(0.0, f64::max);
        let error = 4.0 * (count as f64 + 10.0) * f64::EPSILON * trace + 2.0 * radius + f64::MIN_POSITIVE;
        if error.is_nan() || error >= 1e-3 {
            return Err(Rejection::NotConcave);
        }
        self.factor.shift_diagonal(-2.0 * error);
        self.factor.factorize().map_err(|_| Rejection::NotConcave)?;
        Ok((scale, error))
    }

    /// Q at some positions and its gradient there by the free vertices.
    fn evaluate(&self, forms: &[[[Interval; 3]; 3]], positions: &[Vec3]) -> (Interval, Vec<[Interval; 3]>) {
        let mut value = Interval::ZERO;
        let mut gradient = vec![[Interval::ZERO; 3]; self.free.len()];
        for (((form, gradients), unknowns), tet) in
            forms.iter().zip(&self.gradients).zip(&self.unknowns).zip(&self.tets)
        {
            let corners = self.domain.mesh().tets()[tet.index()].map(|v| positions[v.index()]);
            let edges = [1, 2, 3].map(|i| difference(corners[i], corners[0]));
            for coordinate in 0..3 {
                // A row of the Jacobian, and its product with twice M.
                let row =
                    [0, 1, 2].map(|j| dot(edges.map(|edge| edge[coordinate]), [1, 2, 3].map(|i| gradients[i][j])));
                let product = form.map(|entries| dot(entries, row));
                value = value + dot(product, row);
                let twice = product.map(|entry| entry + entry);
                for (gradient_of_vertex, unknown) in gradients.iter().zip(unknowns) {
                    if let Some(unknown) = unknown {
                        let slope = &mut gradient[*unknown as usize][coordinate];
                        *slope = *slope + dot(twice, *gradient_of_vertex);
                    }
                }
            }
        }
        (value, gradient)
    }

    fn slot(&self, row: u32, column: u32) -> usize {
        let start = self.starts[column as usize];
        let rows = &self.rows[start..self.starts[column as usize + 1]];
        start + rows.binary_search(&row).expect("the pattern holds every pair of vertices of a tet")
    }
}

/// The pairs (i, j, unknown of i, unknown of j) of free vertices of a tet with the first unknown not below the second.
fn pairs(unknowns: &[Option<u32>; 4]) -> impl Iterator<Item = (usize, usize, u32, u32)> + use<> {
    let unknowns = *unknowns;
    (0..4).flat_map(move |i| {
        (0..4).filter_map(move |j| {
            let (row, column) = (unknowns[i]?, unknowns[j]?);
            (row >= column).then_some((i, j, row, column))
        })
    })
}

fn difference(a: Vec3, b: Vec3) -> [Interval; 3] {
    [0, 1, 2].map(|i| Interval::exactly(a[i]) - Interval::exactly(b[i]))
}

/// The gradients of the barycentric coordinates; nothing if intervals cannot tell the volume from zero.
fn gradients([x0, x1, x2, x3]: [Vec3; 4]) -> Option<[[Interval; 3]; 4]> {
    let [a, b, c] = [x1, x2, x3].map(|x| difference(x, x0));
    let normals = [cross(b, c), cross(c, a), cross(a, b)];
    let inverse = dot(a, normals[0]).reciprocal()?;
    let [g1, g2, g3] = normals.map(|normal| normal.map(|entry| entry * inverse));
    Some([[0, 1, 2].map(|i| -(g1[i] + g2[i] + g3[i])), g1, g2, g3])
}

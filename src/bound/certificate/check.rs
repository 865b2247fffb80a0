//! The check of a certificate: interval arithmetic and one sparse Cholesky factorization with an a-priori error bound.

use super::Rejection;
use super::multipliers::Multipliers;
use crate::bound::check::gradients;
use crate::domain::Domain;
use crate::linalg::BlockCholesky;
use crate::linalg::interval::{Interval, cross, difference, dot};
use crate::mesh::{TetId, Vec3, VertexId};

/// Solutions of the maximiser with the gradient taken anew: the factor is that of a shifted matrix.
const REFINEMENTS: usize = 4;

type Matrix = [[Interval; 3]; 3];

/// A sub-complex prepared for checks at several levels and with several multipliers.
pub(super) struct Checker<'a> {
    domain: &'a Domain,
    region: Region,
    tets: Vec<TetId>,
    /// Gradients of the barycentric coordinates of each tet.
    gradients: Vec<[[Interval; 3]; 4]>,
    /// The unknown of each vertex of each tet; none for vertices of the boundary and the held one.
    unknowns: Vec<[Option<u32>; 4]>,
    /// The free vertices, by unknown.
    free: Vec<VertexId>,
    /// Coordinates of a block: 3, or 1 if all multipliers leave the three coordinates apart and the matrix is the same for
    /// each.
    size: usize,
    /// Rows of the lower triangle of minus Lambda22, columns of which start at `starts`.
    starts: Vec<usize>,
    rows: Vec<u32>,
    factor: BlockCholesky,
}

/// The maps that a check speaks of.
#[derive(Clone, Copy, Debug)]
pub(super) enum Region {
    /// All with the boundary positions.
    Whole,
    /// Those that send a free vertex beyond a wall.
    Beyond(Wall),
    /// Those that send it into a box, the lowest and highest corner of which are given.
    Inside(VertexId, [Vec3; 2]),
}

/// The half-space `outwards * (x_axis - bound) >= 0` for the image of a free vertex.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wall {
    pub(super) vertex: VertexId,
    pub(super) axis: usize,
    pub(super) bound: f64,
    /// 1 or -1.
    pub(super) outwards: f64,
    /// The multiplier of the condition, >= 0.
    pub(super) push: f64,
}

impl Region {
    /// The vertex that takes the places of the box's corners instead of being free.
    pub(super) fn held(&self) -> Option<VertexId> {
        if let Self::Inside(vertex, _) = self { Some(*vertex) } else { None }
    }
}

/// The quadratic function of one tet: `<M, G> - <W, C> + eta d` and a constant.
struct Form {
    gram: Matrix,
    /// W and eta, unless both are zero.
    oriented: Option<(Matrix, Interval)>,
    constant: Interval,
}

impl Form {
    fn new(multipliers: &Multipliers) -> Self {
        let oriented = multipliers
            .couples_coordinates()
            .then(|| (multipliers.cofactor_form(), Interval::exactly(multipliers.determinant[0])));
        Self { gram: multipliers.form(), oriented, constant: multipliers.constant() }
    }
}

impl<'a> Checker<'a> {
    /// Prepares the sub-complex of some tets; `coupled` if multipliers may have W or eta other than zero.
    ///
    /// # Errors
    /// A tet too flat for interval arithmetic; a system that cannot be held.
    pub(super) fn new(domain: &'a Domain, tets: Vec<TetId>, coupled: bool, region: Region) -> Result<Self, Rejection> {
        let mesh = domain.mesh();
        let gradients = tets
            .iter()
            .map(|&tet| gradients(domain.enclosed_corners(tet)).ok_or(Rejection::Degenerate { tet: tet.0 }))
            .collect::<Result<_, _>>()?;
        let vertices = tets.iter().flat_map(|tet| mesh.tets()[tet.index()]);
        let mut free: Vec<VertexId> =
            vertices.filter(|&v| !domain.boundary().contains(v) && region.held() != Some(v)).collect();
        free.sort_unstable();
        free.dedup();
        if free.is_empty() {
            return Err(Rejection::NothingFree);
        }
        let unknown = |v: VertexId| free.binary_search(&v).ok().map(|unknown| unknown as u32);
        let unknowns: Vec<[Option<u32>; 4]> = tets.iter().map(|tet| mesh.tets()[tet.index()].map(unknown)).collect();
        let edges: Vec<(u32, u32)> = unknowns.iter().flat_map(pairs).map(|(_, _, row, column)| (row, column)).collect();
        let edges: Vec<(u32, u32)> = edges.into_iter().filter(|(row, column)| row > column).collect();
        let size = if coupled { 3 } else { 1 };
        let factor = BlockCholesky::with_block_size(size, free.len(), &edges).map_err(|_| Rejection::TooLarge)?;
        let (starts, rows) = (factor.column_starts().to_vec(), factor.rows().to_vec());
        Ok(Self { domain, region, tets, gradients, unknowns, free, size, starts, rows, factor })
    }

    /// Sets the multiplier of the region's wall.
    pub(super) fn set_push(&mut self, push: f64) {
        if let Region::Beyond(wall) = &mut self.region {
            wall.push = push;
        }
    }

    /// Whether the multipliers, one a tet, prove K > `level` for every choice of the free vertices in the region.
    ///
    /// In a box the vertex h takes the place of each corner in turn. With the other vertices fixed, C and d are affine in its
    /// position x, and the Gram matrices contribute `a |x|^2` with `a = sum over its tets of g^T M g`, g the gradient of its
    /// barycentric coordinate. Written with the weights of the corners of a box of half widths b, `|x|^2` falls short of the
    /// corners' mean by at most `|b|^2`, so that Q at x is at most the largest Q at a corner plus `max(0, -a) |b|^2`.
    ///
    /// # Errors
    /// The first condition that could not be verified.
    pub(super) fn check(&mut self, level: f64, multipliers: &[Multipliers], image: &[Vec3]) -> Result<(), Rejection> {
        for ((tet, unknowns), multipliers) in self.tets.iter().zip(&self.unknowns).zip(multipliers) {
            if multipliers.is_oriented() && unknowns.iter().flatten().count() > 2 {
                return Err(Rejection::NotQuadratic { tet: tet.0 });
            }
            if !multipliers.satisfy_the_trace_condition(level) {
                return Err(Rejection::TraceCondition { tet: tet.0 });
            }
        }
        let forms: Vec<Form> = multipliers.iter().map(Form::new).collect();
        assert!(
            self.size == 3 || forms.iter().all(|form| form.oriented.is_none()),
            "coupled forms need blocks of three"
        );
        let largest = match self.region {
            Region::Whole | Region::Beyond(_) => self.maximum(&forms, image)?,
            Region::Inside(vertex, [low, high]) => {
                let mut image = image.to_vec();
                let mut largest = f64::NEG_INFINITY;
                for corner in 0..8 {
                    image[vertex.index()] = corner_of_box([low, high], corner);
                    largest = largest.max(self.maximum(&forms, &image)?);
                }
                let half_widths = difference(&high, &low).map(|width| width * Interval::exactly(0.5));
                let curvature = self.curvature(&forms, vertex);
                let loss = Interval::exactly((-curvature.lower).max(0.0)) * dot(half_widths, half_widths);
                (Interval::exactly(largest) + loss).upper
            }
        };
        if largest < 0.0 { Ok(()) } else { Err(Rejection::NotNegative) }
    }

    /// The coefficient of the square of a vertex's position in Q.
    fn curvature(&self, forms: &[Form], vertex: VertexId) -> Interval {
        let mut sum = Interval::ZERO;
        for ((form, gradients), tet) in forms.iter().zip(&self.gradients).zip(&self.tets) {
            let corners = self.domain.mesh().tets()[tet.index()];
            for (_, &gradient) in corners.iter().zip(gradients).filter(|(corner, _)| **corner == vertex) {
                sum = sum + dot(form.gram.map(|row| dot(row, gradient)), gradient);
            }
        }
        sum
    }

    /// A number at least the maximum of Q over the free vertices.
    fn maximum(&mut self, forms: &[Form], image: &[Vec3]) -> Result<f64, Rejection> {
        let (scale, smallest) = self.factorize(forms, image)?;
        let fixed = |v: VertexId| self.domain.boundary().contains(v).then(|| image[v.index()]);
        let corners = self.tets.iter().flat_map(|tet| self.domain.mesh().tets()[tet.index()]);
        let Some(any) = corners.into_iter().find_map(fixed) else { return Err(Rejection::NotConcave) };
        let mut positions = image.to_vec();
        self.free.iter().for_each(|v| positions[v.index()] = any);
        for _ in 0..REFINEMENTS {
            let (_, gradient) = self.evaluate(forms, &positions);
            for first in (0..3).step_by(self.size) {
                let coordinates = first..first + self.size;
                let slopes = |(g, scale): (&[Interval; 3], &f64)| {
                    let (g, scale) = (*g, *scale);
                    coordinates.clone().map(move |coordinate| 0.5 * scale * g[coordinate].middle())
                };
                let mut step: Vec<f64> = gradient.iter().zip(&scale).flat_map(slopes).collect();
                self.factor.solve(&mut step);
                for ((vertex, step), scale) in self.free.iter().zip(step.chunks_exact(self.size)).zip(&scale) {
                    for (coordinate, step) in coordinates.clone().zip(step) {
                        positions[vertex.index()][coordinate] += scale * step;
                    }
                }
            }
        }
        let (mut largest, gradient) = self.evaluate(forms, &positions);
        // max over d of r . d - d^T (-Lambda22) d <= |D r|^2 / (4 smallest eigenvalue of D (-Lambda22) D).
        let quarter = Interval::exactly(4.0 * smallest).reciprocal().ok_or(Rejection::NotConcave)?;
        for (gradient, &scale) in gradient.iter().zip(&scale) {
            let scaled = gradient.map(|g| g * Interval::exactly(scale));
            largest = largest + dot(scaled, scaled) * quarter;
        }
        Ok(if largest.upper.is_nan() { f64::INFINITY } else { largest.upper })
    }

    /// Factorises `D (-Lambda22) D - s I` with powers of two D, one a vertex, that make the diagonal about 1; returns D and a
    /// positive lower bound for the smallest eigenvalue of `D (-Lambda22) D`.
    ///
    /// If the Cholesky factorization of a matrix A in floating point runs to its end, with sums in any order, then
    /// `|L L^T - A| <= g |L| |L|^T` entry by entry with `g = (n + 1) u / (1 - (n + 1) u)`, and so A is above
    /// `-g / (1 - g) tr A` (Higham, Accuracy and Stability, Theorems 10.3 and 10.5; Rump, BIT 2006). We take more than
    /// four times that, for factorizations that multiply by reciprocals, and the radii of the entries' intervals.
    fn factorize(&mut self, forms: &[Form], image: &[Vec3]) -> Result<(Vec<f64>, f64), Rejection> {
        let size = self.size;
        let count = self.free.len();
        let mut entries = vec![Interval::ZERO; size * size * self.rows.len()];
        for (index, form) in forms.iter().enumerate() {
            let (gradients, unknowns) = (&self.gradients[index], &self.unknowns[index]);
            let images = gradients.map(|gradient| form.gram.map(|row| dot(row, gradient)));
            for (i, j, row, column) in pairs(unknowns) {
                let entry = dot(images[i], gradients[j]);
                for coordinate in 0..size {
                    let slot = self.slot(row, column, coordinate, coordinate);
                    entries[slot] = entries[slot] - entry;
                }
                if let Some((cofactor, determinant)) = form.oriented.as_ref().filter(|_| i != j) {
                    let normal = cross(gradients[i], gradients[j]);
                    let axis = cofactor.map(|row| -dot(row, normal));
                    let edge = self.fixed_image(index, normal, image);
                    let half = Interval::exactly(0.5);
                    let axis = [0, 1, 2].map(|k| (axis[k] + *determinant * edge[k]) * half);
                    // (h_i x h_j) . axis = - h_i . (axis x h_j).
                    for (k, entry) in axis.into_iter().enumerate() {
                        let (next, last) = ((k + 1) % 3, (k + 2) % 3);
                        let (up, down) = (self.slot(row, column, last, next), self.slot(row, column, next, last));
                        entries[up] = entries[up] + entry;
                        entries[down] = entries[down] - entry;
                    }
                }
            }
        }
        let mut scale = Vec::with_capacity(count);
        for &start in &self.starts[..count] {
            // The three entries of a vertex on the diagonal are the same.
            let diagonal = entries[size * size * start];
            if !(diagonal.lower > 0.0 && diagonal.upper.is_finite()) {
                return Err(Rejection::NotConcave);
            }
            scale.push((-0.5 * diagonal.upper.log2()).round().exp2());
        }
        let mut radii = vec![0.0f64; size * count];
        let mut trace = 0.0;
        let values = self.factor.values_mut();
        for column in 0..count {
            let (start, end) = (self.starts[column], self.starts[column + 1]);
            for (k, &row) in self.rows[start..end].iter().enumerate() {
                let row = row as usize;
                for (r, c) in (0..size * size).map(|i| (i % size, i / size)) {
                    let slot = size * size * start + c * size * (end - start) + size * k + r;
                    let entry = entries[slot] * Interval::exactly(scale[row]) * Interval::exactly(scale[column]);
                    values[slot] = entry.middle();
                    let radius = entry.distance_from(values[slot]);
                    radii[size * row + r] = (radii[size * row + r] + radius).next_up();
                    // Blocks on the diagonal are stored whole, others only below it.
                    if row != column {
                        radii[size * column + c] = (radii[size * column + c] + radius).next_up();
                    } else if r == c {
                        trace += values[slot];
                    }
                }
            }
        }
        let radius = radii.iter().copied().fold(0.0, f64::max);
        let dimension = (size * count) as f64;
        let error = 4.0 * (dimension + 10.0) * f64::EPSILON * trace + 2.0 * radius + f64::MIN_POSITIVE;
        if error.is_nan() || error >= 1e-3 {
            return Err(Rejection::NotConcave);
        }
        self.factor.shift_diagonal(-2.0 * error);
        self.factor.factorize().map_err(|_| Rejection::NotConcave)?;
        Ok((scale, error))
    }

    /// The Jacobian's product with a vector to which the gradients of the free corners are orthogonal: only the fixed corners
    /// count. Zero if there are less than two, where it is not needed.
    fn fixed_image(&self, index: usize, vector: [Interval; 3], image: &[Vec3]) -> [Interval; 3] {
        let corners = self.domain.mesh().tets()[self.tets[index].index()];
        let fixed: Vec<usize> = (0..4).filter(|&i| self.unknowns[index][i].is_none()).collect();
        let [first, second] = fixed[..] else { return [Interval::ZERO; 3] };
        let edge = difference(&image[corners[second].index()], &image[corners[first].index()]);
        // The gradients add up to zero, so that those of the two fixed corners have opposite products with the vector.
        let share = dot(self.gradients[index][second], vector);
        edge.map(|entry| entry * share)
    }

    /// Q at some positions and its gradient there by the free vertices.
    fn evaluate(&self, forms: &[Form], positions: &[Vec3]) -> (Interval, Vec<[Interval; 3]>) {
        let mut value = Interval::ZERO;
        let mut gradient = vec![[Interval::ZERO; 3]; self.free.len()];
        for (((form, gradients), unknowns), tet) in
            forms.iter().zip(&self.gradients).zip(&self.unknowns).zip(&self.tets)
        {
            let corners = self.domain.mesh().tets()[tet.index()].map(|v| positions[v.index()]);
            let edges = [1, 2, 3].map(|i| difference(&corners[i], &corners[0]));
            let jacobian: Matrix = [0, 1, 2].map(|coordinate| {
                [0, 1, 2].map(|j| dot(edges.map(|edge| edge[coordinate]), [1, 2, 3].map(|i| gradients[i][j])))
            });
            // Rows of the derivative by the Jacobian.
            let mut slopes = jacobian.map(|row| {
                let product = form.gram.map(|entries| dot(entries, row));
                value = value + dot(product, row);
                product.map(|entry| entry + entry)
            });
            value = value + form.constant;
            if let Some((cofactor, determinant)) = &form.oriented {
                for i in 0..3 {
                    let (next, last) = ((i + 1) % 3, (i + 2) % 3);
                    let row_of_cofactors = cross(jacobian[next], jacobian[last]);
                    value = value - dot(cofactor[i], row_of_cofactors);
                    if i == 0 {
                        value = value + *determinant * dot(jacobian[0], row_of_cofactors);
                    }
                    let (a, b) = (cross(cofactor[next], jacobian[last]), cross(jacobian[next], cofactor[last]));
                    for j in 0..3 {
                        slopes[i][j] = slopes[i][j] - a[j] - b[j] + *determinant * row_of_cofactors[j];
                    }
                }
            }
            for (gradient_of_vertex, unknown) in gradients.iter().zip(unknowns) {
                if let Some(unknown) = unknown {
                    let slope = &mut gradient[*unknown as usize];
                    for coordinate in 0..3 {
                        slope[coordinate] = slope[coordinate] + dot(slopes[coordinate], *gradient_of_vertex);
                    }
                }
            }
        }
        if let Region::Beyond(wall) = self.region
            && let Ok(unknown) = self.free.binary_search(&wall.vertex)
        {
            let slope = Interval::exactly(wall.push) * Interval::exactly(wall.outwards);
            let place = Interval::exactly(positions[wall.vertex.index()][wall.axis]);
            value = value + slope * (place - Interval::exactly(wall.bound));
            gradient[unknown][wall.axis] = gradient[unknown][wall.axis] + slope;
        }
        (value, gradient)
    }

    /// The place of entry `(r, c)` of the block of two unknowns.
    fn slot(&self, row: u32, column: u32, r: usize, c: usize) -> usize {
        let (start, end) = (self.starts[column as usize], self.starts[column as usize + 1]);
        let k = self.rows[start..end].binary_search(&row).expect("the pattern holds every pair of vertices of a tet");
        self.size * self.size * start + c * self.size * (end - start) + self.size * k + r
    }
}

/// One of the eight corners of a box.
pub(super) fn corner_of_box([low, high]: [Vec3; 2], corner: usize) -> Vec3 {
    Vec3::from_fn(|axis, _| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] })
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

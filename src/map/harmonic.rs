//! Interior starts: the vertices inside balanced between their neighbours, for given images of the boundary vertices.

use crate::domain::Domain;
use crate::linalg::{BlockConjugateGradients, reverse_cuthill_mckee};
use crate::mesh::{Mat3, Vec3};

/// Puts every interior vertex at the mean of its neighbours, the boundary vertices staying where they are: the discrete
/// harmonic map with uniform weights. It may have flipped tets; what is long and thin on the boundary comes out small.
///
/// # Panics
/// When there is not one position a vertex. Those of interior vertices are not looked at.
pub fn harmonic(domain: &Domain, boundary_image: &[Vec3]) -> Vec<Vec3> {
    /// Each solve leaves a hundredth of the residual.
    const SOLVES: usize = 6;
    let mut springs = Springs::of(domain, boundary_image);
    let mut positions = vec![Vec3::zeros(); springs.free.len()];
    springs.fill(|springs| {
        for rim in 0..springs.rim.len() {
            springs.add_diagonal(springs.rim[rim].0, &Mat3::identity());
        }
        for edge in 0..springs.inner.len() {
            let (row, column) = springs.inner[edge];
            springs.add_diagonal(row, &Mat3::identity());
            springs.add_diagonal(column, &Mat3::identity());
            springs.set_edge(edge, &-Mat3::identity());
        }
    });
    for _ in 0..SOLVES {
        let mut force = vec![Vec3::zeros(); positions.len()];
        for &(i, end) in &springs.rim {
            force[i as usize] += end - positions[i as usize];
        }
        for &(i, j) in &springs.inner {
            let pull = positions[j as usize] - positions[i as usize];
            force[i as usize] += pull;
            force[j as usize] -= pull;
        }
        let Some(step) = springs.solve(&force) else { break };
        positions.iter_mut().zip(&step).for_each(|(position, step)| *position += step);
    }
    springs.spread(&positions, boundary_image)
}

/// The same in hyperbolic space: the ball is its Poincare model, and the boundary vertices, which must lie on the unit sphere,
/// are ideal points. Minimised is
///
/// ```text
/// sum over inner edges d(x_i, x_j)^2 / 2  +  sum over edges to the boundary of ln(|x - xi|^2 / (1 - |x|^2))
/// ```
///
/// with d the hyperbolic distance and the Busemann function of xi, which stands for the distance to an ideal point. Both are
/// geodesically convex, so the minimum is the only one; it does not depend on where the sphere's points are within a Moebius
/// map. It may have more flipped tets than [`harmonic()`], but what is long and thin on the boundary keeps its room inside.
///
/// Newton's method in normal coordinates about each vertex, 6 to 10 steps, from the harmonic map. The derivatives of d^2 / 2 in
/// curvature -1: the Hessian is 1 along the geodesic and d coth d across, and off the diagonal, by parallel transport, -1 along
/// and -d / sinh d across.
///
/// # Panics
/// As [`harmonic()`].
pub fn hyperbolic_harmonic(domain: &Domain, boundary_image: &[Vec3]) -> Vec<Vec3> {
    const STEPS: usize = 60;
    /// Sufficient decrease of the Armijo rule.
    const ARMIJO: f64 = 1e-4;
    const HALVINGS: usize = 25;
    /// Longest move of a vertex in one step, as a hyperbolic length.
    const LONGEST_MOVE: f64 = 5.0;
    /// Relative fall of the energy that ends the iteration: where untangling begins, no more digits count.
    const SETTLED: f64 = 1e-7;
    let start = harmonic(domain, boundary_image);
    let mut springs = Springs::of(domain, boundary_image);
    let mut points: Vec<Point> = springs.free.iter().map(|&v| Point::near(&start[v as usize])).collect();
    let Some(mut energy) = springs.energy(&points) else { return start };
    for _ in 0..STEPS {
        let force = springs.linearize(&points);
        let Some(step) = springs.solve(&force) else { break };
        let slope: f64 = -step.iter().zip(&force).map(|(step, force)| step.dot(force)).sum::<f64>();
        let longest = step.iter().map(|step| step.norm()).fold(0.0, f64::max);
        let mut length = (LONGEST_MOVE / longest).min(1.0);
        let found = (0..HALVINGS).find_map(|_| {
            let trial: Vec<Point> =
                points.iter().zip(&step).map(|(point, step)| point.moved(&(step * length))).collect();
            let value = springs.energy(&trial).filter(|value| *value <= energy + ARMIJO * length * slope);
            length *= 0.5;
            value.map(|value| (value, trial))
        });
        let Some((value, trial)) = found else { break };
        let fall = energy - value;
        (points, energy) = (trial, value);
        if fall < SETTLED * energy.abs() {
            break;
        }
    }
    let positions: Vec<Vec3> = points.iter().map(|point| point.position).collect();
    springs.spread(&positions, boundary_image)
}

/// A point of the Poincare ball, with 1 - |x|^2 to full relative accuracy however near it is to the sphere.
#[derive(Clone, Copy, Debug)]
struct Point {
    position: Vec3,
    depth: f64,
}

impl Point {
    fn near(position: &Vec3) -> Self {
        /// The largest radius of a start.
        const LARGEST: f64 = 1.0 - 1e-9;
        let radius = position.norm();
        let position = if radius > LARGEST { position * (LARGEST / radius) } else { *position };
        Self { position, depth: 1.0 - position.norm_squared() }
    }

    /// The point at the end of the geodesic with this initial velocity, in the frame of unit vectors that are parallel to the
    /// axes: Moebius addition of tanh(|v| / 2) v / |v|.
    fn moved(&self, velocity: &Vec3) -> Self {
        let length = velocity.norm();
        if length == 0.0 {
            return *self;
        }
        let x = &self.position;
        let z = velocity * ((0.5 * length).tanh() / length);
        let (xz, zz) = (x.dot(&z), z.norm_squared());
        let divisor = 1.0 + 2.0 * xz + x.norm_squared() * zz;
        let position = ((1.0 + 2.0 * xz + zz) * x + self.depth * z) / divisor;
        Self { position, depth: self.depth / (0.5 * length).cosh().powi(2) / divisor }
    }

    /// The distance to another point.
    fn distance(&self, other: &Self) -> f64 {
        let squared = (other.position - self.position).norm_squared() / self.depth / other.depth;
        2.0 * squared.sqrt().asinh()
    }

    /// The unit vector, in the same frame, of the geodesic to a point of the ball or of the sphere; zero at the point itself.
    fn direction(&self, to: &Vec3) -> Vec3 {
        let offset = to - self.position;
        let direction = self.depth * offset - offset.norm_squared() * self.position;
        direction.try_normalize(0.0).unwrap_or_else(Vec3::zeros)
    }
}

/// The edges of a domain with an end inside, and a matrix of 3x3 blocks with their pattern.
struct Springs {
    /// The interior vertices.
    free: Vec<u32>,
    /// Edges between interior vertices, as (larger, smaller) positions in `free`, by columns as in the matrix.
    inner: Vec<(u32, u32)>,
    /// Edges to the boundary: the interior end and the image of the other.
    rim: Vec<(u32, Vec3)>,
    system: BlockConjugateGradients,
}

impl Springs {
    fn of(domain: &Domain, boundary_image: &[Vec3]) -> Self {
        let mesh = domain.mesh();
        assert_eq!(boundary_image.len(), mesh.points().len(), "one position a vertex");
        let mut edges: Vec<[u32; 2]> = Vec::with_capacity(6 * mesh.tets().len());
        for tet in mesh.tets() {
            edges.extend((0..4).flat_map(|i| (0..i).map(move |j| [tet[i].0.max(tet[j].0), tet[i].0.min(tet[j].0)])));
        }
        edges.sort_unstable();
        edges.dedup();
        let inside = |v: u32| !domain.boundary().vertex_mask()[v as usize];
        let mut free: Vec<u32> = (0..mesh.points().len() as u32).filter(|&v| inside(v)).collect();
        let unknowns = |free: &[u32]| {
            let mut unknown_of = vec![u32::MAX; mesh.points().len()];
            (0..).zip(free).for_each(|(i, &v)| unknown_of[v as usize] = i);
            unknown_of
        };
        let between = |unknown_of: &[u32]| -> Vec<(u32, u32)> {
            let inner = edges.iter().filter(|edge| edge.iter().all(|&v| inside(v)));
            let pairs = inner.map(|edge| edge.map(|v| unknown_of[v as usize]));
            pairs.map(|[a, b]| (a.max(b), a.min(b))).collect()
        };
        let order = reverse_cuthill_mckee(free.len(), &between(&unknowns(&free)));
        free = order.into_iter().map(|i| free[i as usize]).collect();
        let unknown_of = unknowns(&free);
        let mut inner = between(&unknown_of);
        inner.sort_unstable_by_key(|&(row, column)| (column, row));
        let rim = edges.iter().filter_map(|&[a, b]| match (inside(a), inside(b)) {
            (true, false) => Some((unknown_of[a as usize], boundary_image[b as usize])),
            (false, true) => Some((unknown_of[b as usize], boundary_image[a as usize])),
            _ => None,
        });
        let rim = rim.collect();
        let system = BlockConjugateGradients::new(free.len(), &inner);
        Self { free, inner, rim, system }
    }

    /// All positions: those of the boundary as given.
    fn spread(&self, positions: &[Vec3], boundary_image: &[Vec3]) -> Vec<Vec3> {
        let mut image = boundary_image.to_vec();
        for (&v, position) in self.free.iter().zip(positions) {
            image[v as usize] = *position;
        }
        image
    }

    /// The hyperbolic energy; `None` if it is not finite.
    fn energy(&self, points: &[Point]) -> Option<f64> {
        let distances = self.inner.iter().map(|&(i, j)| points[i as usize].distance(&points[j as usize]));
        let inner: f64 = distances.map(|distance| 0.5 * distance * distance).sum();
        let rim = self.rim.iter().map(|(i, end)| {
            let point = &points[*i as usize];
            ((point.position - end).norm_squared() / point.depth).ln()
        });
        let energy = inner + rim.sum::<f64>();
        energy.is_finite().then_some(energy)
    }

    /// Fills the system with the Hessian of the hyperbolic energy; the negative gradient.
    fn linearize(&mut self, points: &[Point]) -> Vec<Vec3> {
        let mut force = vec![Vec3::zeros(); points.len()];
        self.fill(|springs| {
            for rim in 0..springs.rim.len() {
                let (i, end) = springs.rim[rim];
                let direction = points[i as usize].direction(&end);
                force[i as usize] += direction;
                springs.add_diagonal(i, &(Mat3::identity() - direction * direction.transpose()));
            }
            for edge in 0..springs.inner.len() {
                let (i, j) = springs.inner[edge];
                let (first, second) = (&points[i as usize], &points[j as usize]);
                let distance = first.distance(second);
                let (there, back) = (first.direction(&second.position), second.direction(&first.position));
                force[i as usize] += distance * there;
                force[j as usize] += distance * back;
                // d coth d and d / sinh d, which tend to 1 for d -> 0.
                let (across, coupled) =
                    if distance < 1e-8 { (1.0, 1.0) } else { (distance / distance.tanh(), distance / distance.sinh()) };
                for (v, along) in [(i, there), (j, back)] {
                    let along = along * along.transpose();
                    springs.add_diagonal(v, &(along + across * (Mat3::identity() - along)));
                }
                // From the frame at j to that at i: along the geodesic, and by the least rotation of `-back` to `there`.
                let along = -there * back.transpose();
                springs.set_edge(edge, &-(along + coupled * (rotation(&-back, &there) - along)));
            }
        });
        force
    }

    /// Clears the system, has it filled and makes it ready to solve.
    fn fill(&mut self, fill: impl FnOnce(&mut Self)) {
        self.system.values_mut().fill(0.0);
        fill(self);
    }

    fn add_diagonal(&mut self, vertex: u32, block: &Mat3) {
        self.add(vertex as usize, 0, block);
    }

    /// Sets the block of an inner edge, (row, column) of the matrix.
    fn set_edge(&mut self, edge: usize, block: &Mat3) {
        let column = self.inner[edge].1 as usize;
        // Each column of the pattern is its diagonal block and then its edges, in their order.
        let place = edge + column + 1 - self.system.column_starts()[column];
        self.add(column, place, block);
    }

    fn add(&mut self, column: usize, place: usize, block: &Mat3) {
        let (start, end) = (self.system.column_starts()[column], self.system.column_starts()[column + 1]);
        let height = 3 * (end - start);
        let values = &mut self.system.values_mut()[9 * start..];
        for c in 0..3 {
            for r in 0..3 {
                values[c * height + 3 * place + r] += block[(r, c)];
            }
        }
    }

    /// An approximate solution of the system; `None` if it breaks down.
    fn solve(&mut self, right_hand_side: &[Vec3]) -> Option<Vec<Vec3>> {
        self.system.factorize().ok()?;
        let mut solution: Vec<f64> = right_hand_side.iter().flat_map(|v| [v.x, v.y, v.z]).collect();
        self.system.solve(&mut solution);
        let solution: Vec<Vec3> = solution.chunks_exact(3).map(Vec3::from_column_slice).collect();
        solution.iter().all(|v| v.iter().all(|x| x.is_finite())).then_some(solution)
    }
}

/// The rotation in the plane of two unit vectors that takes the first to the second; the identity where either is zero or
/// they are opposite, where any would do.
fn rotation(from: &Vec3, to: &Vec3) -> Mat3 {
    let cosine = from.dot(to);
    let axis = from.cross(to);
    let cross = Mat3::new(0.0, -axis.z, axis.y, axis.z, 0.0, -axis.x, -axis.y, axis.x, 0.0);
    if 1.0 + cosine > 1e-12 { Mat3::identity() + cross + cross * cross / (1.0 + cosine) } else { Mat3::identity() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solid::{ShellSettings, Solid, shell_mesh};

    /// Shells of an icosahedron, its boundary vertices on the unit sphere.
    fn ball() -> (Domain, Vec<Vec3>) {
        let surface = Solid::Icosahedron.surface().unwrap();
        let settings = ShellSettings { subdivisions: 2, refinement: None, layers: 3, grading: 1.0 };
        let domain = Domain::new(shell_mesh(&surface, Vec3::zeros(), &settings).unwrap().mesh).unwrap();
        let image = domain.mesh().points().iter().map(|p| p.try_normalize(0.0).unwrap_or_else(Vec3::zeros)).collect();
        (domain, image)
    }

    #[test]
    fn harmonic_vertices_are_the_means_of_their_neighbours() {
        let (domain, boundary) = ball();
        let image = harmonic(&domain, &boundary);
        let springs = Springs::of(&domain, &boundary);
        let mut residual = vec![Vec3::zeros(); springs.free.len()];
        for &(i, end) in &springs.rim {
            residual[i as usize] += end - image[springs.free[i as usize] as usize];
        }
        for &(i, j) in &springs.inner {
            let pull = image[springs.free[j as usize] as usize] - image[springs.free[i as usize] as usize];
            residual[i as usize] += pull;
            residual[j as usize] -= pull;
        }
        // Six solves to a hundredth each.
        assert!(residual.iter().all(|r| r.norm() < 1e-9));
    }

    #[test]
    fn the_hyperbolic_energy_has_the_gradient_and_hessian_it_says() {
        let (domain, boundary) = ball();
        let mut springs = Springs::of(&domain, &boundary);
        let points: Vec<Point> = (0..springs.free.len())
            .map(|i| Point::near(&Vec3::from_fn(|axis, _| 0.5 * ((3 * i + axis) as f64 * 1.7).sin())))
            .collect();
        let velocity: Vec<Vec3> =
            (0..points.len()).map(|i| Vec3::from_fn(|axis, _| ((3 * i + axis) as f64 * 0.9).cos())).collect();
        let force = springs.linearize(&points);
        let flat: Vec<f64> = velocity.iter().flat_map(|v| [v.x, v.y, v.z]).collect();
        let product = springs.system.multiply(&flat);
        let second: f64 = product.iter().zip(&flat).map(|(a, b)| a * b).sum();
        let first: f64 = -force.iter().zip(&velocity).map(|(f, v)| f.dot(v)).sum::<f64>();
        let at = |t: f64| {
            let moved: Vec<Point> = points.iter().zip(&velocity).map(|(p, v)| p.moved(&(v * t))).collect();
            springs.energy(&moved).unwrap()
        };
        // Along geodesics of all vertices at once; errors of h^2 and of rounding over h^2.
        let h = 1e-4;
        let (up, down, here) = (at(h), at(-h), at(0.0));
        assert!(((up - down) / (2.0 * h) - first).abs() < 1e-6 * first.abs().max(1.0));
        assert!(((up - 2.0 * here + down) / (h * h) - second).abs() < 1e-4 * second.abs());
    }

    #[test]
    fn the_hyperbolic_map_commutes_with_moebius_maps() {
        let (domain, boundary) = ball();
        let image = hyperbolic_harmonic(&domain, &boundary);
        // Moving the ideal points by a translation of hyperbolic space moves the whole map with them.
        let shift = Point::near(&Vec3::new(0.3, -0.4, 0.2));
        let translated = |y: &Vec3| {
            let (x, xy, yy) = (&shift.position, shift.position.dot(y), y.norm_squared());
            ((1.0 + 2.0 * xy + yy) * x + shift.depth * y) / (1.0 + 2.0 * xy + x.norm_squared() * yy)
        };
        let moved = hyperbolic_harmonic(&domain, &boundary.iter().map(&translated).collect::<Vec<_>>());
        for (v, (there, here)) in moved.iter().zip(&image).enumerate() {
            assert!((there - translated(here)).norm() < 1e-3, "vertex {v}");
        }
    }
}

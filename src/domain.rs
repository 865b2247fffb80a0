//! The domain of a map: a mesh that is a topological ball, with its reference operators.

use crate::linalg::interval::{Interval, cross, difference, dot, exact_vector};
pub use crate::mesh::edge_matrix;
use crate::mesh::{Boundary, Mat3, TetId, TetMesh, TopologyError, Unit, Vec3, VertexId};

/// The factor R = I + (p-1) u n^T of an element, by the exact positions of vertices: n is normal to the plane of the base, u along the way
/// from the apex to a corner of the element, and n.u = 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shear {
    /// The apex.
    pub apex: VertexId,
    /// Three vertices of the base's plane.
    pub base: [VertexId; 3],
    /// p > 0.
    pub exponent: f64,
    /// The corner.
    pub at: VertexId,
}

/// What follows the Jacobian J R of an element: L, so that the whole is L J R, and to first order what becomes of L where the corners move.
#[derive(Clone, Debug)]
pub(crate) struct Afterwards {
    /// L.
    pub left: Mat3,
    /// What is added; `None` for nothing.
    pub turning: Option<Box<Turning>>,
}

/// A matrix linear in how far the corners of a tet have moved.
#[derive(Clone, Debug)]
pub(crate) struct Turning {
    /// Where it is 0.
    pub from: [Vec3; 4],
    /// The derivative with respect to each coordinate of each corner.
    pub change: [[Mat3; 3]; 4],
}

impl Afterwards {
    /// Nothing.
    pub fn nothing() -> Self {
        Self { left: Mat3::identity(), turning: None }
    }

    /// The whole, for a Jacobian with these positions of the tet's corners.
    pub fn after(&self, jacobian: Mat3, corners: &[Vec3; 4]) -> Mat3 {
        let Self { left, turning } = self;
        turning.as_ref().map_or(left * jacobian, |turning| left * jacobian + turning.at(corners))
    }
}

impl Turning {
    fn at(&self, corners: &[Vec3; 4]) -> Mat3 {
        let of_corner = |((change, from), to): ((&[Mat3; 3], &Vec3), &Vec3)| {
            let moved = to - from;
            change[0] * moved.x + change[1] * moved.y + change[2] * moved.z
        };
        self.change.iter().zip(&self.from).zip(corners).map(of_corner).sum()
    }
}

/// A tetrahedral mesh of a topological ball with what every stage needs of it; images are positions on its connectivity.
#[derive(Clone, Debug)]
pub struct Domain {
    mesh: TetMesh,
    boundary: Boundary,
    inverse_edges: Vec<Mat3>,
    volumes: Vec<f64>,
    /// What follows each tet's Jacobian; empty for nothing.
    afterwards: Vec<Afterwards>,
    /// What each tet's reference matrix is that of the mesh times; empty for nothing.
    shears: Vec<Option<Shear>>,
}

impl Domain {
    /// Takes a mesh that must be a ball.
    ///
    /// # Errors
    /// Why the mesh is not a topological ball.
    pub fn new(mesh: TetMesh) -> Result<Self, TopologyError> {
        let boundary = Boundary::of(&mesh)?;
        boundary.check_ball(&mesh)?;
        Ok(Self::with_boundary(mesh, boundary))
    }

    /// Takes a mesh of any topology, for measuring maps between meshes that are not balls.
    ///
    /// # Errors
    /// A triangle that belongs to three or more tets.
    pub fn any_topology(mesh: TetMesh) -> Result<Self, TopologyError> {
        let boundary = Boundary::of(&mesh)?;
        Ok(Self::with_boundary(mesh, boundary))
    }

    fn with_boundary(mesh: TetMesh, boundary: Boundary) -> Self {
        let (inverse_edges, volumes) = (0..mesh.tets().len() as u32)
            .map(|tet| {
                let edges = edge_matrix(mesh.corners(TetId(tet)));
                let determinant = edges.determinant();
                // Positive by exact predicate; the rounded determinant of a needle may still vanish, and K is then
                // infinite rather than NaN.
                (edges.try_inverse().unwrap_or_else(|| Mat3::from_element(f64::INFINITY)), determinant / 6.0)
            })
            .unzip();
        Self { mesh, boundary, inverse_edges, volumes, afterwards: Vec::new(), shears: Vec::new() }
    }

    /// The domain with each tet once for each of its `factors` R, its reference matrix multiplied by R, and as it is if it has
    /// none: for maps whose Jacobians on a tet are J R, with J that of the piecewise-linear map. Also the tet that each element
    /// comes from: the first elements are the tets in their order. The boundary is that of the mesh, and the elements of a tet share its volume.
    pub(crate) fn with_factors(&self, factors: impl Fn(TetId) -> Vec<Mat3>) -> (Self, Vec<TetId>) {
        let ids = || (0..self.mesh.tets().len() as u32).map(TetId);
        let factors: Vec<Vec<Mat3>> = ids().map(factors).collect();
        let further = ids().flat_map(|tet| std::iter::repeat_n(tet, factors[tet.index()].len().saturating_sub(1)));
        let owners: Vec<TetId> = ids().chain(further).collect();
        let tets = owners.iter().map(|tet| self.mesh.tets()[tet.index()]).collect();
        let mesh = TetMesh::new(self.mesh.points().to_vec(), tets).expect("the tets of a mesh");
        let first = factors.iter().map(|of_tet| of_tet.first());
        let further = factors.iter().flat_map(|of_tet| of_tet.iter().skip(1).map(Some));
        let inverse_edges = owners.iter().zip(first.chain(further)).map(|(tet, factor)| {
            let plain = self.inverse_edges[tet.index()];
            factor.map_or(plain, |factor| plain * factor)
        });
        let volume = |tet: &TetId| self.volumes[tet.index()] / factors[tet.index()].len().max(1) as f64;
        let domain = Self {
            mesh,
            boundary: self.boundary.clone(),
            inverse_edges: inverse_edges.collect(),
            volumes: owners.iter().map(volume).collect(),
            afterwards: Vec::new(),
            shears: Vec::new(),
        };
        (domain, owners)
    }

    /// The same with a factor R and what follows it for each of a tet's elements, for maps whose Jacobians on a tet are L J R. No tet has
    /// none.
    pub(crate) fn with_factors_on_both_sides(&self, factors: &[Vec<(Mat3, Afterwards)>]) -> Self {
        let (domain, _) = self.with_factors(|tet| factors[tet.index()].iter().map(|(right, _)| *right).collect());
        let first = factors.iter().map(|of_tet| of_tet[0].1.clone());
        let further = factors.iter().flat_map(|of_tet| of_tet[1..].iter().map(|(_, after)| after.clone()));
        Self { afterwards: first.chain(further).collect(), ..domain }
    }

    /// Some tets as a domain of their own, with their reference matrices. Its vertices are `vertices`, ascending, in which all of
    /// the tets' are. A part has no boundary: what is done with parts, minimizing over the images of vertices, asks for none.
    pub(crate) fn part(&self, vertices: &[u32], tets: &[TetId]) -> Self {
        let local = |v: VertexId| VertexId(vertices.binary_search(&v.0).expect("every corner is listed") as u32);
        let mesh = TetMesh::new(
            vertices.iter().map(|&v| self.mesh.points()[v as usize]).collect(),
            tets.iter().map(|tet| self.mesh.tets()[tet.index()].map(local)).collect(),
        );
        Self {
            mesh: mesh.expect("tets of a valid mesh"),
            boundary: Boundary::none(vertices.len()),
            inverse_edges: tets.iter().map(|tet| self.inverse_edges[tet.index()]).collect(),
            volumes: tets.iter().map(|tet| self.volumes[tet.index()]).collect(),
            afterwards: tets.iter().filter_map(|tet| self.afterwards.get(tet.index()).cloned()).collect(),
            shears: tets.iter().filter_map(|tet| self.shears.get(tet.index()).copied()).collect(),
        }
    }

    /// The same part with the boundary that it has in the mesh.
    pub(crate) fn chamber(&self, vertices: &[u32], tets: &[TetId]) -> Self {
        let local = |v: VertexId| VertexId(vertices.binary_search(&v.0).expect("every corner is listed") as u32);
        Self { boundary: self.boundary.part(tets, vertices.len(), local), ..self.part(vertices, tets) }
    }

    /// The same domain with lengths counted in another unit.
    pub fn in_unit(&self, unit: Unit) -> Self {
        Self::with_boundary(self.mesh.in_unit(unit), self.boundary.clone())
    }

    /// The mesh.
    pub fn mesh(&self) -> &TetMesh {
        &self.mesh
    }

    /// The boundary of the mesh.
    pub fn boundary(&self) -> &Boundary {
        &self.boundary
    }

    /// The volume of each tet, in the domain's units cubed.
    pub fn volumes(&self) -> &[f64] {
        &self.volumes
    }

    /// The inverse of each tet's edge matrix `[x1 - x0, x2 - x0, x3 - x0]`: the reference gradient operator
    /// (rows are the gradients of the barycentric coordinates 1, 2, 3; 1 / length).
    pub fn inverse_edges(&self) -> &[Mat3] {
        &self.inverse_edges
    }

    /// The Jacobian of the piecewise-linear map that takes the mesh's vertices to `image`, on one tet.
    pub fn jacobian(&self, tet: TetId, image: &[Vec3]) -> Mat3 {
        let corners = self.mesh.tets()[tet.index()].map(|v: VertexId| image[v.index()]);
        let jacobian = edge_matrix(corners) * self.inverse_edges[tet.index()];
        self.afterwards(tet).map_or(jacobian, |afterwards| afterwards.after(jacobian, &corners))
    }

    /// What follows the Jacobian of a tet, if anything.
    pub(crate) fn afterwards(&self, tet: TetId) -> Option<&Afterwards> {
        self.afterwards.get(tet.index())
    }

    /// The same with the factors of its elements by exact positions, for [`Domain::enclosed_corners`].
    pub(crate) fn with_shears(self, shears: Vec<Option<Shear>>) -> Self {
        Self { shears, ..self }
    }

    /// Four points, in intervals, of which the map of a tet to the images of its corners is the linear one: the corners; of an element with
    /// the factor R what R^-1 = I - (1 - 1/p) u n^T makes of them, relative to the apex, by the Sherman-Morrison formula. They are unbounded if
    /// the corner of u may lie in the plane of the apex.
    pub(crate) fn enclosed_corners(&self, tet: TetId) -> [[Interval; 3]; 4] {
        let corners = self.mesh.corners(tet);
        let Some(Shear { apex, base, exponent, at }) = self.shears.get(tet.index()).copied().flatten() else {
            return corners.map(|x| exact_vector(&x));
        };
        let [v, a, b, c, x] = [apex, base[0], base[1], base[2], at].map(|v| &self.mesh.points()[v.index()]);
        let (normal, way) = (cross(difference(b, a), difference(c, a)), difference(x, v));
        let inverse = Interval::exactly(exponent).reciprocal();
        let Some((inverse, over)) = inverse.zip(dot(normal, way).reciprocal()) else {
            return [[Interval::WHOLE; 3]; 4];
        };
        corners.map(|x| {
            let offset = difference(&x, v);
            let share = (Interval::ONE - inverse) * over * dot(normal, offset);
            [0, 1, 2].map(|i| offset[i] - share * way[i])
        })
    }

    /// The tets all of whose vertices lie on the boundary: with a fixed boundary nothing can change their dilatation.
    pub fn locked_tets(&self) -> impl Iterator<Item = TetId> + '_ {
        (0..)
            .map(TetId)
            .zip(self.mesh.tets())
            .filter(|(_, tet)| tet.iter().all(|&v| self.boundary.contains(v)))
            .map(|(id, _)| id)
    }
}

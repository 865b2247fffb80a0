//! The corners of a domain with their exponents: which cones are warped, and that the warps fit together.

use std::collections::{BTreeMap, HashMap};

use super::Warp;
use crate::domain::{Domain, Shear};
use crate::mesh::{Mat3, TetId, TetMesh, VertexId};

/// How far, in units of t (0 at the corner, 1 on the base), the cones of a corner may disagree at a common vertex, or a
/// vertex lie off the base: points of flat faces and straight edges are computed with rounding.
const FITS: f64 = 1e-9;
/// By how many units of the last place of the coordinates such points may be off: of a small solid far from the origin that is more.
const ROUNDINGS: f64 = 16.0;

/// How a map behaves at the corners of a solid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CornerChoice {
    /// Piecewise linear, as everywhere.
    Linear,
    /// Like the power of the distance with this exponent > 0, at every corner.
    Exponent(f64),
    /// Like powers, with exponents to be found.
    Power,
}

/// A cone over a triangle, with its apex in a corner of the solid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    /// The apex, a vertex of the boundary.
    pub corner: VertexId,
    /// Three vertices of the plane t = 1.
    pub base: [VertexId; 3],
    /// The exponent p > 0 of the corner, the same for all its cones.
    pub exponent: f64,
}

/// The cones of a domain that are warped, and which tets lie in them; the others stay piecewise linear.
#[derive(Clone, Debug, PartialEq)]
pub struct Corners {
    cones: Vec<Cone>,
    warps: Vec<Warp>,
    of_tet: Vec<Option<u32>>,
}

/// A domain in which a warped tet is up to four, each with a reference matrix of its own.
///
/// The dilatations of the warped map on a tet are the largest ones of its elements, for any images of the vertices: to
/// minimize or bound them is to do so here.
#[derive(Clone, Debug)]
pub struct Elements {
    /// The elements, as tets of a domain whose mesh has some of its tets several times. The first ones are the tets in
    /// their order; the boundary is that of the mesh.
    pub domain: Domain,
    /// The tet that each element belongs to.
    pub owners: Vec<TetId>,
}

/// Why cones give no continuous map of the domain onto itself. Tets and vertices count from 0.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CornerError {
    /// An exponent that is none, or a cone without height.
    #[error(
        "cone {cone} at vertex {corner} with the exponent {exponent} is none: give a positive exponent and three points of a base"
    )]
    Cone {
        /// The cone.
        cone: usize,
        /// Its corner.
        corner: u32,
        /// Its exponent.
        exponent: f64,
    },
    /// Cones of one corner with different exponents.
    #[error("the cones at vertex {corner} have the exponents {exponents:?}; give a corner one exponent")]
    Exponents {
        /// The corner.
        corner: u32,
        /// Two of them.
        exponents: [f64; 2],
    },
    /// A corner inside.
    #[error("vertex {corner} lies inside of the solid; a corner is a vertex of the boundary")]
    Inside {
        /// The vertex.
        corner: u32,
    },
    /// A tet with two corners; [`Subdivision::split_edges`](crate::mesh::Subdivision::split_edges) halves the edges between them.
    #[error(
        "tet {tet} has two corners, vertices {corners:?}: the edge between them has to be halved (which domain.keep_mesh and \
         mesh.keep_boundary forbid), or leave corners = \"linear\""
    )]
    TwoCorners {
        /// The tet.
        tet: u32,
        /// The corners.
        corners: [u32; 2],
    },
    /// Names of tets, cones or vertices that do not exist.
    #[error("a cone is named that does not exist, or there is not one entry a tet")]
    Range,
    /// Two neighbours disagree on their common face.
    #[error("the warps of tets {tets:?} disagree on their common face")]
    Torn {
        /// The tets.
        tets: [u32; 2],
    },
    /// A triangle of the boundary is moved off itself, or a tet sticks out of its cone.
    #[error("tet {tet} does not fit into its cone: a side of it is neither on a ray from the corner nor on the base")]
    Misfit {
        /// The tet.
        tet: u32,
    },
}

impl Corners {
    /// Takes cones, and for each tet the one it lies in. Checks, up to rounding, that the warps fit together: then they
    /// make a homeomorphism of the domain that takes each boundary triangle of a flat face to that face.
    ///
    /// The tets of the cones at a corner fill a region that is star-shaped about the corner. Each of its outer faces is
    /// either on the boundary of the domain and in a plane through the corner, or has t = 1; on its inner faces the cones
    /// agree on t. So t is continuous in the region and linear on every ray from the corner, and the warp takes the region
    /// to itself, leaving its faces of t = 1 as they are.
    ///
    /// # Errors
    /// See [`CornerError`].
    pub fn new(domain: &Domain, cones: Vec<Cone>, of_tet: Vec<Option<u32>>) -> Result<Self, CornerError> {
        let points = domain.mesh().points();
        let known = |v: &VertexId| v.index() < points.len();
        let in_range = cones.iter().all(|cone| known(&cone.corner) && cone.base.iter().all(known))
            && of_tet.len() == domain.mesh().tets().len()
            && of_tet.iter().flatten().all(|&cone| (cone as usize) < cones.len());
        if !in_range {
            return Err(CornerError::Range);
        }
        let mut exponent_of: HashMap<VertexId, f64> = HashMap::new();
        let mut warps = Vec::with_capacity(cones.len());
        for (number, &Cone { corner, base, exponent }) in cones.iter().enumerate() {
            let at = |v: VertexId| points[v.index()];
            let warp = Warp::new(at(corner), base.map(at), exponent);
            warps.push(warp.ok_or(CornerError::Cone { cone: number, corner: corner.0, exponent })?);
            let first = *exponent_of.entry(corner).or_insert(exponent);
            if first != exponent {
                return Err(CornerError::Exponents { corner: corner.0, exponents: [first, exponent] });
            }
            if !domain.boundary().contains(corner) {
                return Err(CornerError::Inside { corner: corner.0 });
            }
        }
        let corners = Self { cones, warps, of_tet };
        corners.check(domain)?;
        Ok(corners)
    }

    /// Corner elements: the tets around each of the given vertices, each a cone of its own.
    ///
    /// # Errors
    /// A tet with two of the vertices, a vertex inside, an exponent that is none.
    pub fn stars(domain: &Domain, exponents: &[(VertexId, f64)]) -> Result<Self, CornerError> {
        let exponent_of: HashMap<VertexId, f64> = exponents.iter().copied().collect();
        let (mut cones, mut of_tet) = (Vec::new(), Vec::with_capacity(domain.mesh().tets().len()));
        for (index, tet) in domain.mesh().tets().iter().enumerate() {
            let found: Vec<usize> = (0..4).filter(|&i| exponent_of.contains_key(&tet[i])).collect();
            match *found {
                [] => of_tet.push(None),
                [i] => {
                    let base = std::array::from_fn(|k| tet[(i + 1 + k) % 4]);
                    of_tet.push(Some(cones.len() as u32));
                    cones.push(Cone { corner: tet[i], base, exponent: exponent_of[&tet[i]] });
                }
                [i, j, ..] => {
                    return Err(CornerError::TwoCorners { tet: index as u32, corners: [tet[i].0, tet[j].0] });
                }
            }
        }
        Self::new(domain, cones, of_tet)
    }

    /// Corner elements with the same exponents on another mesh, in which the corners have the same numbers.
    ///
    /// # Errors
    /// As [`Corners::stars`].
    pub fn around(&self, domain: &Domain) -> Result<Self, CornerError> {
        Self::stars(domain, &self.exponents())
    }

    /// The cones.
    pub fn cones(&self) -> &[Cone] {
        &self.cones
    }

    /// For each tet, the cone it lies in.
    pub fn of_tets(&self) -> &[Option<u32>] {
        &self.of_tet
    }

    /// The warp of the cone that holds a tet.
    pub fn warp(&self, tet: TetId) -> Option<&Warp> {
        self.of_tet[tet.index()].map(|cone| &self.warps[cone as usize])
    }

    /// The cone that holds a tet, if its warp is not the identity.
    pub fn warped_cone(&self, tet: TetId) -> Option<&Cone> {
        self.of_tet[tet.index()].map(|cone| &self.cones[cone as usize]).filter(|cone| cone.exponent != 1.0)
    }

    /// The same cones with other exponents, all positive: one for each corner.
    pub fn with_exponents(mut self, exponent: impl Fn(VertexId) -> f64) -> Self {
        for (cone, warp) in self.cones.iter_mut().zip(&mut self.warps) {
            cone.exponent = exponent(cone.corner);
            *warp = warp.with_exponent(cone.exponent);
        }
        self
    }

    /// The matrices I + (p-1) u n^T of which one makes K largest on a tet; none outside of the cones.
    pub(crate) fn factors(&self, domain: &Domain, tet: TetId) -> Vec<Mat3> {
        match self.warp(tet).filter(|warp| warp.exponent() != 1.0) {
            None => Vec::new(),
            Some(warp) => warp.projections(domain.mesh().corners(tet)).map(|u| warp.factor(&u)).collect(),
        }
    }

    /// The corners, each once, with their exponents, in the order of the vertices.
    pub fn exponents(&self) -> Vec<(VertexId, f64)> {
        let of_corner: BTreeMap<VertexId, f64> = self.cones.iter().map(|cone| (cone.corner, cone.exponent)).collect();
        of_corner.into_iter().collect()
    }

    /// The ordinary tets that the warped ones are to whoever minimizes or bounds K.
    pub fn elements(&self, domain: &Domain) -> Elements {
        let (elements, owners) = domain.with_factors(|tet| self.factors(domain, tet));
        // How many elements of each tet came before.
        let mut seen = vec![0; domain.mesh().tets().len()];
        let shears = owners.iter().map(|&tet| {
            let &Cone { corner, base, exponent } = self.warped_cone(tet)?;
            seen[tet.index()] += 1;
            // As `factors` takes them.
            let apex = domain.mesh().points()[corner.index()];
            let corners = domain.mesh().tets()[tet.index()].into_iter();
            let at = { corners }.filter(|v| domain.mesh().points()[v.index()] != apex).nth(seen[tet.index()] - 1)?;
            Some(Shear { apex: corner, base, exponent, at })
        });
        let shears = shears.collect();
        Elements { domain: elements.with_shears(shears), owners }
    }

    fn check(&self, domain: &Domain) -> Result<(), CornerError> {
        let mesh = domain.mesh();
        let height = |warp: &Warp, v: VertexId| warp.height(&mesh.points()[v.index()]);
        let largest = mesh.points().iter().map(|p| p.amax()).fold(0.0, f64::max);
        let fits = |warp: &Warp| FITS + ROUNDINGS * f64::EPSILON * largest * warp.gradient().norm();
        let mut faces: HashMap<[u32; 3], u32> = HashMap::new();
        for (index, tet) in (0u32..).zip(mesh.tets()) {
            let warp = self.warp(TetId(index));
            let within = |warp: &Warp| {
                let fits = fits(warp);
                tet.iter().all(|&v| (-fits..=1.0 + fits).contains(&height(warp, v)))
            };
            if warp.is_some_and(|warp| !within(warp)) {
                return Err(CornerError::Misfit { tet: index });
            }
            for face in TetMesh::FACES {
                let face = face.map(|i| tet[i]);
                let mut key = face.map(|v| v.0);
                key.sort_unstable();
                let Some(other) = faces.remove(&key) else {
                    faces.insert(key, index);
                    continue;
                };
                if !self.agree([other, index], face, &height, &fits) {
                    return Err(CornerError::Torn { tets: [other, index] });
                }
            }
        }
        // What is left has one tet: the boundary.
        for (triangle, owner) in domain.boundary().triangles().iter().zip(domain.boundary().owners()) {
            let Some(cone) = self.of_tet[owner.index()] else { continue };
            let warp = &self.warps[cone as usize];
            let [a, b, c] = triangle.map(|v| mesh.points()[v.index()]);
            let normal = (b - a).cross(&(c - a));
            let tip = mesh.points()[self.cones[cone as usize].corner.index()];
            let size = (a - tip).norm().max((b - tip).norm()).max((c - tip).norm());
            let fits = fits(warp);
            let radial = normal.dot(&(a - tip)).abs() <= fits * normal.norm() * size;
            if !radial && !triangle.iter().all(|&v| (height(warp, v) - 1.0).abs() <= fits) {
                return Err(CornerError::Misfit { tet: owner.0 });
            }
        }
        Ok(())
    }

    /// Whether the warps of two tets are the same on their common face: both leave it as it is, or they have one corner,
    /// and the same t there.
    fn agree(
        &self,
        tets: [u32; 2],
        face: [VertexId; 3],
        height: &dyn Fn(&Warp, VertexId) -> f64,
        fits: &dyn Fn(&Warp) -> f64,
    ) -> bool {
        let cones = tets.map(|tet| self.of_tet[tet as usize].map(|cone| cone as usize));
        let still = |cone: Option<usize>| {
            let on_base = |warp: &Warp| face.iter().all(|&v| (height(warp, v) - 1.0).abs() <= fits(warp));
            cone.is_none_or(|cone| on_base(&self.warps[cone]))
        };
        let same = |a: usize, b: usize| {
            let [a, b] = [a, b].map(|cone| (&self.cones[cone], &self.warps[cone]));
            let fits = fits(a.1).max(fits(b.1));
            a.0.corner == b.0.corner && face.iter().all(|&v| (height(a.1, v) - height(b.1, v)).abs() <= fits)
        };
        match cones {
            [Some(a), Some(b)] if a == b || same(a, b) => true,
            [a, b] => still(a) && still(b),
        }
    }
}

/// The solid angle of the domain at each vertex of a list, in steradians.
pub fn solid_angles(domain: &Domain, vertices: &[VertexId]) -> Vec<f64> {
    let position: HashMap<VertexId, usize> = vertices.iter().enumerate().map(|(i, &v)| (v, i)).collect();
    let mut angles = vec![0.0; vertices.len()];
    for (index, tet) in (0..).map(TetId).zip(domain.mesh().tets()) {
        for i in 0..4 {
            if let Some(&vertex) = position.get(&tet[i]) {
                let corners = domain.mesh().corners(index);
                let [a, b, c] = TetMesh::FACES[i].map(|k| &corners[k]);
                angles[vertex] += crate::mesh::angle::tet_solid_angle(&corners[i], [a, b, c]).value();
            }
        }
    }
    angles
}

#[cfg(test)]
mod tests;

//! The vertex bound: solid angles of a boundary vertex's star.

use super::boundary_image::half_turns;
use super::check::factor;
use super::{BoundName, BoundaryImage, Kind, LowerBound, Place, strongest};
use crate::domain::Domain;
use crate::linalg::interval::Interval;
use crate::mesh::angle::{Angle, tet_solid_angle};
use crate::mesh::{BoundaryEdges, VertexId};

/// `K_I >= omega' / omega` and `K_O >= omega / omega'` at a boundary vertex, omega the solid angle of its star in the
/// domain and omega' in the image; the strongest over the vertices of either sort.
///
/// Holds for every orientation-preserving piecewise-linear map of this mesh with these boundary positions, and no mesh
/// refinement removes it, a piecewise-linear map being homogeneous of degree one at a vertex.
///
/// **Proof**. The map w -> A w / |A w| of directions has the area Jacobian det A / |A w|^3, which lies in
/// `[1 / K_O, K_I]`; sum over the tets of the star. The total omega' of their images is determined by the boundary: a
/// tet's solid angle is the sum of its three dihedral angles there minus pi, and in the sum the interior edges at the
/// vertex contribute whole turns and the boundary edges the angles beta between the image triangles, so with e interior
/// edges and t tets `omega' = sum beta + 2 pi e - pi t`, up to further turns if the map is not injective at the vertex. Where
/// omega' >= omega more turns only help; where omega' < omega and more turns cannot be excluded ([`BoundaryImage`]), the
/// value is the least over all of them and claimed for K alone.
///
/// Checked by `check::factor`. Vertices with a degenerate or folded image triangle, or where the boundary
/// is not a manifold, bound nothing.
pub fn vertex(domain: &Domain, edges: &BoundaryEdges, image: BoundaryImage) -> Vec<LowerBound> {
    vertex_with_powers(domain, edges, image, &[])
}

/// The same for maps like r^p at some vertices, with their exponents p > 0 ([`crate::map::corner`]): `K_I p^2 >= omega' / omega` and
/// `K_O >= p^2 omega / omega'` there.
///
/// **Proof**. Such a map is at the vertex F = A o w with w homogeneous of degree p and A of degree one. On |x| = 1 let J be the area Jacobian of the map
/// x -> F / |F| of directions. F being homogeneous of degree p, DF x = p F and `det DF = p |F|^3 J`. Hence
/// `K_I = det DF |DF^-1|^3 >= p |F|^3 J / (p |F|)^3 = J / p^2` and `K_O = |DF|^3 / det DF >= p^2 / J`; integrate J and 1 / J as above. At
/// the other vertices of a warped cone the warp has a derivative, linear in each tet, that takes tangent cones to themselves, so that there
/// all is as without it.
pub fn vertex_with_powers(
    domain: &Domain,
    edges: &BoundaryEdges,
    image: BoundaryImage,
    powers: &[(VertexId, f64)],
) -> Vec<LowerBound> {
    let mut stars = stars(domain, edges, image);
    for &(vertex, exponent) in powers {
        if let Some(star) = &mut stars[vertex.index()] {
            star.domain = star.domain.times(Interval::exactly(exponent).square());
        }
    }
    let bounds: Vec<(Kind, f64, VertexId)> = (0..)
        .map(VertexId)
        .zip(&stars)
        .filter_map(|(vertex, star)| {
            let (kind, value) = star.as_ref()?.bound(image)?;
            Some((kind, value, vertex))
        })
        .collect();
    let of = |wanted: &dyn Fn(Kind) -> bool| {
        let candidates =
            bounds.iter().filter(|bound| wanted(bound.0)).map(|&(kind, value, vertex)| (value, (kind, vertex)));
        let (value, (kind, vertex)) = strongest(candidates)?;
        Some(LowerBound::of_mesh(
            BoundName::Vertex,
            kind,
            value,
            Place::vertex(domain.mesh(), vertex),
            "any PL map of this mesh with these boundary positions",
        ))
    };
    [of(&|kind| kind == Kind::Inner), of(&|kind| kind != Kind::Inner)].into_iter().flatten().collect()
}

/// The star of a boundary vertex.
struct Star {
    /// omega, times p^2.
    domain: Angle,
    /// omega' up to turns.
    principal: Angle,
    tets: usize,
}

impl Star {
    fn bound(&self, image: BoundaryImage) -> Option<(Kind, f64)> {
        let limit = half_turns(2 * self.tets);
        let (principal, domain) = (self.principal, self.domain);
        let value =
            image.possible_angles(principal, domain, limit).map(|angle| factor(angle, domain)).reduce(f64::min)?;
        let kind = if principal.lower() >= domain.upper() {
            Kind::Inner
        } else if image.is_unique(principal, limit) {
            Kind::Outer
        } else {
            Kind::K
        };
        value.is_finite().then_some((kind, value))
    }
}

/// The star of each vertex; nothing for interior vertices and those at which the image boundary has no angles.
fn stars(domain: &Domain, edges: &BoundaryEdges, image: BoundaryImage) -> Vec<Option<Star>> {
    let boundary = domain.boundary();
    let mut tets = vec![0; domain.mesh().points().len()];
    let mut arms: Vec<[VertexId; 2]> = Vec::new();
    for tet in domain.mesh().tets() {
        for &vertex in tet.iter().filter(|&&v| boundary.contains(v)) {
            tets[vertex.index()] += 1;
            arms.extend(tet.iter().filter(|&&other| other != vertex).map(|&other| [vertex, other]));
        }
    }
    arms.sort_unstable();
    arms.dedup();
    let mut interior_arms = vec![0; tets.len()];
    for arm in arms.iter().filter(|&&arm| edges.position(arm).is_none()) {
        interior_arms[arm[0].index()] += 1;
    }
    let mut angle_sums = vec![Some(Angle::ZERO); tets.len()];
    for edge in edges.edges() {
        let angle = edge.image_angle(image.positions());
        for end in edge.ends {
            let sum = &mut angle_sums[end.index()];
            *sum = sum.zip(angle).map(|(sum, angle)| sum + angle);
        }
    }
    for end in edges.left_out().iter().flatten() {
        angle_sums[end.index()] = None;
    }
    let solid_angles = domain_solid_angles(domain);
    (0..tets.len())
        .map(|v| {
            let principal = angle_sums[v]?.plus_half_turns(2 * interior_arms[v] - tets[v]);
            Some(Star { domain: solid_angles[v]?, principal, tets: tets[v] as usize })
        })
        .collect()
}

/// The solid angle of the domain at each boundary vertex, in steradians in `(0, 4 pi)`: the sum over its tets, in their
/// order. Nothing at interior vertices.
pub(super) fn domain_solid_angles(domain: &Domain) -> Vec<Option<Angle>> {
    let boundary = domain.boundary();
    let points = domain.mesh().points();
    let mut angles: Vec<Option<Angle>> = boundary.vertex_mask().iter().map(|&on| on.then_some(Angle::ZERO)).collect();
    for tet in domain.mesh().tets() {
        for (i, vertex) in tet.iter().enumerate().filter(|(_, v)| boundary.contains(**v)) {
            let others = crate::mesh::TetMesh::FACES[i].map(|j| &points[tet[j].index()]);
            let sum = &mut angles[vertex.index()];
            *sum = sum.map(|sum| sum + tet_solid_angle(&points[vertex.index()], others));
        }
    }
    angles
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::fixtures::{cube, fan, split};
    use crate::mesh::{Mat3, Vec3};

    #[test]
    fn the_image_boundary_knows_the_solid_angles_of_the_star() {
        // A dented cube under a shear: the corner pushed in has a solid angle above 2 pi.
        let mut solid = cube();
        solid.0[7] *= -0.3;
        let domain = Domain::new(split(&split(&fan(&solid, Vec3::from_element(-0.6))))).unwrap();
        let shear = Mat3::new(1.0, 0.7, -0.2, 0.0, 0.8, 0.4, 0.0, 0.0, 2.0);
        let image: Vec<Vec3> = domain.mesh().points().iter().map(|p| shear * p).collect();
        let sheared = crate::mesh::TetMesh::new(image.clone(), domain.mesh().tets().to_vec()).unwrap();
        let expected = domain_solid_angles(&Domain::new(sheared).unwrap());
        let edges = BoundaryEdges::of(domain.mesh(), domain.boundary());
        let stars = stars(&domain, &edges, BoundaryImage::new(&domain, &edges, &image));
        for (vertex, star) in stars.iter().enumerate() {
            let Some(star) = star else {
                assert!(vertex >= 8);
                continue;
            };
            let angle = expected[vertex].unwrap();
            assert!(star.principal.lower() <= angle.upper() && angle.lower() <= star.principal.upper());
            assert!(star.principal.upper() - star.principal.lower() < 1e-11);
        }
        assert!(stars[7].as_ref().is_some_and(|star| star.domain.lower() > std::f64::consts::TAU));
    }
}

//! The surface: where new vertices of it go, what K onto the ball says of a map, and which edges of the surface make it large.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::gain::{Large, half};
use super::halving::edges_of;
use crate::dilatation::Dilatation;
use crate::domain::{Afterwards, Domain};
use crate::map::Corners;
use crate::measure::{Factor, NotOntoBall, OntoBall};
use crate::mesh::{Mat3, TetId, Vec3, VertexId};

/// Share of the largest K of the map onto the polyhedron below which K onto the ball is not looked at.
pub(super) const LOW: f64 = 0.5;
/// Share of the largest ln K onto the ball above which all factors of a tet are held, and the least and most of them that are.
const NEAR: (f64, usize, usize) = (0.9, 2, 24);
/// Length of an edge's image over that of the longest of its triangle from which halving it brings the triangle nearer to the sphere.
const LONG: f64 = 0.8;
/// Share of the spread of ln K onto the ball of a tet on a triangle's cone that halving an edge of the triangle is taken to gain.
const GAINED: f64 = 0.25;

/// Where new vertices go, which were put halfway between two others.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Middles {
    /// Whether some of them are on the surface, whose vertices are mapped to a sphere about 0.
    pub of_surface: bool,
    /// The centre of a radial boundary map; any other one is taken to be halfway on the sphere.
    pub centre: Option<Vec3>,
}

impl Middles {
    /// A map with its values at the new vertices: halfway again, and at the boundary on the sphere. In a map whose boundary slid the
    /// middles of edges with an image that is not radial any more are halfway on the sphere, too.
    pub fn extended(&self, domain: &Domain, edges: &[[VertexId; 2]], image: Vec<Vec3>) -> Vec<Vec3> {
        self.extended_where(domain, edges, image, |v| domain.boundary().contains(v))
    }

    /// The same of the map started from. A radial one is radial inside, too: flat tets next to the surface may be turned over by what is halfway.
    pub fn extended_start(&self, domain: &Domain, edges: &[[VertexId; 2]], image: Vec<Vec3>) -> Vec<Vec3> {
        self.extended_where(domain, edges, image, |v| self.centre.is_some() || domain.boundary().contains(v))
    }

    fn extended_where(
        &self,
        domain: &Domain,
        edges: &[[VertexId; 2]],
        mut image: Vec<Vec3>,
        on_ray: impl Fn(VertexId) -> bool,
    ) -> Vec<Vec3> {
        for ends in edges {
            let images = ends.map(|v| image[v.index()]);
            let new = VertexId(image.len() as u32);
            let on_ray = self.of_surface && on_ray(new);
            let middle = || self.on_ray(images, ends.map(|v| &domain.mesh().points()[v.index()]));
            image.push(if on_ray { middle() } else { (images[0] + images[1]) / 2.0 });
        }
        image
    }

    /// The image of the middle of an edge at the mean distance from 0 of the images of its ends.
    fn on_ray(&self, [a, b]: [Vec3; 2], ends: [&Vec3; 2]) -> Vec3 {
        /// Of the radius: the digits of files.
        const RADIAL: f64 = 1e-5;
        let radius = (a.norm() + b.norm()) / 2.0;
        let on_its_ray = |image: &Vec3, end: &Vec3, centre: &Vec3| {
            let direction = end - centre;
            (image * direction.norm() - direction * image.norm()).norm() <= RADIAL * radius * direction.norm()
        };
        let radial = self.centre.filter(|centre| on_its_ray(&a, ends[0], centre) && on_its_ray(&b, ends[1], centre));
        let direction = radial.map_or(a + b, |centre| ends[0] + ends[1] - centre * 2.0);
        let norm = direction.norm();
        if norm > 0.0 { direction * (radius / norm) } else { (a + b) / 2.0 }
    }

    /// Whether the halves of these tets at an edge of the surface keep their orientation when its middle goes to the sphere.
    pub fn keep(
        &self,
        domain: &Domain,
        image: &[Vec3],
        edge: [VertexId; 2],
        mut around: impl Iterator<Item = TetId>,
    ) -> bool {
        let [a, b] = edge.map(|v| image[v.index()]);
        let step = self.on_ray([a, b], edge.map(|v| &domain.mesh().points()[v.index()])) - (a + b) / 2.0;
        around.all(|tet| edge.iter().all(|end| half(domain, image, tet, *end, &step).determinant() > 0.0))
    }
}

/// A map onto the ball as far as its tets of large K tell.
pub(super) struct Held {
    /// ln K of each tet: onto the ball, or onto the polyhedron where it is small.
    pub logs: Vec<f64>,
    /// The factors R of each tet, with what follows them.
    pub factors: Vec<Vec<(Mat3, Afterwards)>>,
    /// For each tet the boundary triangle in whose cone its K is largest, and how far ln K is there above its mean on that cone.
    spreads: Vec<Option<(usize, f64)>>,
}

impl Held {
    /// Looks at a map.
    pub fn of(domain: &Domain, corners: Option<&Corners>, image: &[Vec3]) -> Result<Self, NotOntoBall> {
        let onto = OntoBall::new(domain, corners, image)?;
        let tets = (0..domain.mesh().tets().len() as u32).into_par_iter().map(TetId);
        let plain = |tet: TetId| {
            let jacobian = domain.jacobian(tet, image);
            let warp = corners.and_then(|corners| corners.warp(tet));
            warp.map_or_else(
                || Dilatation::of(&jacobian),
                |warp| warp.dilatation(&jacobian, domain.mesh().corners(tet)),
            )
        };
        let plain: Vec<f64> = tets.clone().map(|tet| plain(tet).k()).collect();
        let low = LOW * plain.iter().copied().fold(1.0, f64::max);
        let all: Vec<Vec<Factor>> = tets
            .map(|tet| {
                let mut factors = onto.factors(tet, low / plain[tet.index()]);
                factors.sort_by(|a, b| b.k.total_cmp(&a.k));
                factors
            })
            .collect();
        let of_tet = |tet: usize| all[tet].first().map_or(plain[tet], |factor| factor.k);
        let largest = (0..all.len()).map(of_tet).fold(1.0, f64::max);
        let least = (NEAR.0 * largest.ln()).exp();
        let kept = |factors: &Vec<Factor>| -> Vec<(Mat3, Afterwards)> {
            let large = factors.iter().filter(|factor| factor.k >= least).count().clamp(NEAR.1, NEAR.2);
            let kept = factors.iter().take(large).map(|factor| (factor.right, factor.afterwards.clone()));
            let kept: Vec<(Mat3, Afterwards)> = kept.collect();
            if kept.is_empty() { vec![(Mat3::identity(), Afterwards::nothing())] } else { kept }
        };
        let spread = |tet: usize| {
            let worst = all[tet].first()?;
            let of_triangle = || all[tet].iter().filter(|factor| factor.triangle == worst.triangle);
            let mean = of_triangle().map(|factor| factor.k.ln()).sum::<f64>() / of_triangle().count() as f64;
            Some((worst.triangle, worst.k.ln() - mean))
        };
        Ok(Self {
            logs: (0..all.len()).map(|tet| of_tet(tet).ln()).collect(),
            factors: all.iter().map(kept).collect(),
            spreads: (0..all.len()).map(spread).collect(),
        })
    }

    /// The largest K.
    pub fn k(&self) -> f64 {
        self.logs.iter().copied().fold(0.0, f64::max).exp()
    }

    /// What halving edges of the surface gains, each times the tets about it: the spread of K on the cones of triangles that open too far. At a
    /// corner of the solid K is large on all scales, and its mean does not fall.
    pub fn gains(&self, large: &Large<'_>) -> BTreeMap<[VertexId; 2], f64> {
        let triangles = large.domain.boundary().triangles();
        let largest = large.largest();
        let mut of_triangle = vec![0.0; triangles.len()];
        for (tet, spread) in (0..).map(TetId).zip(&self.spreads) {
            if let Some((triangle, spread)) = spread {
                of_triangle[*triangle] += large.weight(tet, largest) * GAINED * spread;
            }
        }
        let mut of_edges: BTreeMap<[VertexId; 2], f64> = BTreeMap::new();
        for (triangle, gain) in triangles.iter().zip(of_triangle).filter(|(_, gain)| *gain > 0.0) {
            let edges = edges_of(triangle);
            let length = |[a, b]: [VertexId; 2]| (large.image[a.index()] - large.image[b.index()]).norm();
            let longest = edges.into_iter().map(length).fold(0.0, f64::max);
            for edge in edges.into_iter().filter(|edge| length(*edge) >= LONG * longest) {
                *of_edges.entry(edge).or_default() += gain;
            }
        }
        of_edges
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::fixtures::{cube, fan};

    #[test]
    fn middles_go_where_the_boundary_map_sends_them() {
        let domain = Domain::new(fan(&cube(), Vec3::zeros())).unwrap();
        let centre = Vec3::new(0.3, -0.2, 0.1);
        let radial = |p: &Vec3| (p - centre).normalize() * 2.0;
        let image: Vec<Vec3> = domain.mesh().points().iter().map(radial).collect();
        let middles = Middles { of_surface: true, centre: Some(centre) };
        let [a, b] = [0, 1].map(|v: usize| domain.mesh().points()[v]);
        let at = middles.on_ray([image[0], image[1]], [&a, &b]);
        assert!((at - radial(&((a + b) / 2.0))).norm() < 1e-14, "{at}");
        // Any other map has it halfway on the sphere, and so has a radial one that slid.
        let halfway = (image[0] + image[1]).normalize() * 2.0;
        let other = Middles { centre: None, ..middles };
        assert!((other.on_ray([image[0], image[1]], [&a, &b]) - halfway).norm() < 1e-14);
        let slid = (image[0] + Vec3::new(0.1, 0.2, -0.1)).normalize() * 2.0;
        let halfway = (slid + image[1]).normalize() * 2.0;
        assert!((middles.on_ray([slid, image[1]], [&a, &b]) - halfway).norm() < 1e-14);
        // Between opposite directions there is none.
        assert_eq!(other.on_ray([Vec3::x(), -Vec3::x()], [&a, &b]), Vec3::zeros());
    }
}

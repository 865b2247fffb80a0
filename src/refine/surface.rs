//! The surface: where new vertices of it go, what K onto the ball says of a map, and which edges of the surface make it large.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::gain::{Gain, Large};
use super::{around, pair};
use crate::dilatation::Dilatation;
use crate::domain::Domain;
use crate::measure::{Factor, NotOntoBall, OntoBall};
use crate::mesh::{Mat3, TetId, Vec3, VertexId};

/// Share of the largest K of the map onto the polyhedron below which K onto the ball is not looked at.
const LOW: f64 = 0.5;
/// Share of the largest ln K onto the ball above which all factors of a tet are held, and the least and most of them that are.
const NEAR: (f64, usize, usize) = (0.9, 2, 24);
/// Length of an edge's image over that of the longest of its triangle from which it may be halved.
const LONG: f64 = 0.8;
/// Share of the shear's part of ln K onto the ball that halving an edge of its triangle is taken to gain.
const GAINED: f64 = 0.5;

/// Extends positions to the vertices that were put halfway between others: halfway again inside, and on the sphere on which the boundary's
/// are at the boundary of the domain: in the direction from `centre` to the new vertex, if the boundary map is radial, else halfway.
pub(crate) fn extend_on_sphere(
    domain: &Domain,
    parents: &[[VertexId; 2]],
    centre: Option<&Vec3>,
    mut image: Vec<Vec3>,
) -> Vec<Vec3> {
    for ends in parents {
        let [a, b] = ends.map(|v| image[v.index()]);
        let new = VertexId(image.len() as u32);
        image.push(if domain.boundary().contains(new) {
            let direction = centre.map_or(a + b, |centre| domain.mesh().points()[new.index()] - centre);
            direction * ((a.norm() + b.norm()) / 2.0 / direction.norm())
        } else {
            (a + b) / 2.0
        });
    }
    image
}

/// A map onto the ball as far as its tets of large K tell.
pub(super) struct Held {
    /// ln K of each tet: onto the ball, or onto the polyhedron where it is small.
    pub logs: Vec<f64>,
    /// The pairs of factors of each tet.
    pub factors: Vec<Vec<[Mat3; 2]>>,
    /// For each tet the boundary triangle in whose cone its K is largest, and by how much ln K is larger than onto the polyhedron.
    shears: Vec<Option<(usize, f64)>>,
}

impl Held {
    /// Looks at a map.
    pub fn of(domain: &Domain, image: &[Vec3]) -> Result<Self, NotOntoBall> {
        let onto = OntoBall::new(domain, None, image)?;
        let tets = (0..domain.mesh().tets().len() as u32).into_par_iter().map(TetId);
        let plain: Vec<f64> = tets.clone().map(|tet| Dilatation::of(&domain.jacobian(tet, image)).k()).collect();
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
        let kept = |factors: &Vec<Factor>| -> Vec<[Mat3; 2]> {
            let large = factors.iter().filter(|factor| factor.k >= least).count().clamp(NEAR.1, NEAR.2);
            let kept: Vec<[Mat3; 2]> = factors.iter().take(large).map(|factor| factor.both).collect();
            if kept.is_empty() { vec![[Mat3::identity(); 2]] } else { kept }
        };
        let shear = |tet: usize| all[tet].first().map(|factor| (factor.triangle, (factor.k / plain[tet]).ln()));
        Ok(Self {
            logs: (0..all.len()).map(|tet| of_tet(tet).ln()).collect(),
            factors: all.iter().map(kept).collect(),
            shears: (0..all.len()).map(shear).collect(),
        })
    }

    /// The largest K.
    pub fn k(&self) -> f64 {
        self.logs.iter().copied().fold(0.0, f64::max).exp()
    }

    /// What halving edges of the surface gains: an image that opens too far there shears what goes on to the ball.
    pub fn gains(&self, large: &Large<'_>, at: &[Vec<TetId>], allowed: &dyn Fn([VertexId; 2]) -> bool) -> Vec<Gain> {
        let triangles = large.domain.boundary().triangles();
        let (tets, largest) = (large.domain.mesh().tets(), large.largest());
        let mut of_triangle = vec![0.0; triangles.len()];
        for (tet, shear) in (0..).map(TetId).zip(&self.shears) {
            if let Some((triangle, shear)) = shear {
                of_triangle[*triangle] += large.weight(tet, largest) * GAINED * shear.max(0.0);
            }
        }
        let mut of_edges: BTreeMap<[VertexId; 2], f64> = BTreeMap::new();
        for (triangle, gain) in triangles.iter().zip(of_triangle).filter(|(_, gain)| *gain > 0.0) {
            let edges = [[0, 1], [1, 2], [2, 0]].map(|[i, j]| pair(triangle[i], triangle[j]));
            let length = |[a, b]: [VertexId; 2]| (large.image[a.index()] - large.image[b.index()]).norm();
            let longest = edges.into_iter().map(length).fold(0.0, f64::max);
            for edge in edges.into_iter().filter(|edge| length(*edge) >= LONG * longest) {
                *of_edges.entry(edge).or_default() += gain;
            }
        }
        let added = |edge| around(edge, tets, at).count() as f64;
        let of_edges = of_edges.into_iter().filter(|(edge, _)| allowed(*edge));
        of_edges.map(|(edge, gain)| Gain { edge, value: gain / added(edge) }).collect()
    }
}

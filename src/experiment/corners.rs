//! The corners of a run: which cones are warped, and with what exponents.

use std::collections::HashMap;
use std::f64::consts::TAU;

use super::error::Fault;
use crate::config::Plan;
use crate::domain::Domain;
use crate::map::corner::solid_angles;
use crate::map::{Cone, CornerChoice, Corners};
use crate::mesh::{BoundaryEdges, Features, VertexId};
use crate::solid::{Flag, FlagMesh};

/// The power s of 2 pi / omega from which exponents are sought. Best are 0.2 to 0.3 with fixed boundary values and 0.3 to 0.45 with
/// others.
const USUAL_POWER: f64 = 0.25;

/// The flags of a mesh, and how many tets each has.
#[derive(Clone, Debug)]
pub(crate) struct Flags {
    flags: Vec<Flag>,
    tets_a_flag: usize,
}

impl Flags {
    /// Those of a mesh.
    pub fn of(mesh: &FlagMesh) -> Self {
        Self { flags: mesh.flags.clone(), tets_a_flag: mesh.mesh.tets().len() / mesh.flags.len() }
    }
}

/// The vertices that are corners of a plan's map, ascending: those it names, or where the solid has corners.
pub(super) fn corner_vertices(domain: &Domain, plan: &Plan) -> Result<Vec<VertexId>, Fault> {
    let boundary = domain.boundary();
    if let Some(named) = &plan.corner_vertices {
        let vertices = domain.mesh().points().len();
        return match named.iter().find(|v| v.index() >= vertices || !boundary.contains(**v)) {
            Some(&VertexId(vertex)) => Err(Fault::CornerVertex { vertex, vertices }),
            None => Ok(named.clone()),
        };
    }
    let features = Features::of(domain.mesh(), boundary, &BoundaryEdges::of(domain.mesh(), boundary));
    let all = (0..domain.mesh().points().len() as u32).map(VertexId);
    let vertices: Vec<VertexId> = all.filter(|&v| features.is_corner(v)).collect();
    if vertices.is_empty() { Err(Fault::NoCorners) } else { Ok(vertices) }
}

/// The warped cones that a plan asks for, at the corners of the solid; `None` where the map stays piecewise linear.
pub(super) fn corners(domain: &Domain, flags: Option<&Flags>, plan: &Plan) -> Result<Option<Corners>, Fault> {
    if plan.corners == CornerChoice::Linear {
        return Ok(None);
    }
    let vertices = corner_vertices(domain, plan)?;
    let exponents: HashMap<VertexId, f64> = match plan.corners {
        CornerChoice::Exponent(exponent) => vertices.iter().map(|&v| (v, exponent)).collect(),
        _ => by_power(domain, &vertices),
    };
    if let Some(Flags { flags, .. }) = flags {
        let is_none = |v: &&VertexId| flags.iter().all(|flag| flag.corner != **v);
        if let Some(vertex) = vertices.iter().find(is_none) {
            return Err(Fault::NoFlags { vertex: vertex.0 });
        }
    }
    Ok(Some(match flags {
        Some(Flags { flags, tets_a_flag }) => {
            let (mut cones, mut of_tet) = (Vec::new(), Vec::with_capacity(domain.mesh().tets().len()));
            for Flag { corner, base } in flags {
                let exponent = exponents.get(corner);
                of_tet.extend(std::iter::repeat_n(exponent.map(|_| cones.len() as u32), *tets_a_flag));
                cones.extend(exponent.map(|&exponent| Cone { corner: *corner, base: *base, exponent }));
            }
            Corners::new(domain, cones, of_tet)?
        }
        None => Corners::stars(domain, &vertices.iter().map(|&v| (v, exponents[&v])).collect::<Vec<_>>())?,
    }))
}

/// The exponents to begin a search with: (2 pi / omega)^s at a corner of solid angle omega, by which the bound K_I p^2 >= 2 pi / omega
/// of maps that open it to a half-space is that of the power 1 - 2 s.
fn by_power(domain: &Domain, vertices: &[VertexId]) -> HashMap<VertexId, f64> {
    let angles = solid_angles(domain, vertices);
    vertices.iter().zip(angles).map(|(&vertex, angle)| (vertex, (TAU / angle).powf(USUAL_POWER))).collect()
}

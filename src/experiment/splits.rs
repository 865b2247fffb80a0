//! The splits that a mesh needs before it is mapped: edges between corners, locked tets, the collar; and what is told of those that cannot be.

use super::corners::corner_vertices;
use super::error::Fault;
use crate::config::{MeshPlan, Plan};
use crate::domain::Domain;
use crate::map::CornerChoice;
use crate::mesh::{ChangeError, Subdivision, collar, full_boundary};
use crate::report::{FLIPPED, HALVED, Splits};

/// The domain without edges between corners, with its boundary made a full subcomplex, unless the mesh is to be kept, and the collar
/// that the plan asks for.
pub(super) fn freed(domain: Domain, plan: &Plan) -> Result<(Domain, Option<Splits>), Fault> {
    let tets_before = domain.mesh().tets().len();
    let (mut domain, of_corners) = between_corners(domain, plan)?;
    let mut splits = of_corners.unwrap_or(Splits { tets_before, ..Splits::default() });
    if !plan.keep_mesh {
        let full = full_boundary(domain.mesh(), domain.boundary());
        (splits.edges, splits.faces) = (full.edge_splits(), full.face_splits());
        domain = taken(domain, &full)?;
    }
    if plan.collar > 0.0 {
        let tets = domain.mesh().tets().len();
        let collar = collar(domain.mesh(), domain.boundary(), tets + (plan.collar * tets as f64) as usize);
        splits.collar = collar.edge_splits();
        domain = taken(domain, &collar)?;
    }
    let any = splits.corners + splits.edges + splits.faces + splits.collar > 0;
    Ok((domain, any.then_some(splits)))
}

/// The domain with edges that join two corners halved, where the map is like powers at the tets around each and the mesh may be changed.
pub(super) fn between_corners(domain: Domain, plan: &Plan) -> Result<(Domain, Option<Splits>), Fault> {
    let keeps = match &plan.mesh {
        // The flags have one corner each.
        MeshPlan::Flag(_) => true,
        MeshPlan::External(settings) => settings.keep_boundary,
        MeshPlan::Auto { external, .. } => external.keep_boundary,
        MeshPlan::Shell(_) => false,
    };
    if plan.corners == CornerChoice::Linear || plan.keep_mesh || keeps {
        return Ok((domain, None));
    }
    let corners = corner_vertices(&domain, plan)?;
    let mut halves = Subdivision::of(domain.mesh());
    halves.split_edges(|edge| edge.iter().all(|v| corners.binary_search(v).is_ok()));
    let tets_before = domain.mesh().tets().len();
    let splits = Splits { corners: halves.edge_splits(), tets_before, ..Splits::default() };
    Ok((taken(domain, &halves)?, (splits.corners > 0).then_some(splits)))
}

/// What edges that were halved between corners may cost; `is_compared`: the map without powers, on the mesh as it is, was made too.
pub(super) fn halved_for_corners(splits: Splits, is_compared: bool) -> Option<String> {
    let edges = splits.corners;
    let advice = match is_compared {
        true => {
            "can raise K; the map without powers, on the mesh as it is, was made as well and is no better, but more tets may gain"
        }
        false => {
            "raises K, which may be more than the powers gain: compare with boundary.corners = \"linear\", which leaves the mesh as it is, or ask for more tets"
        }
    };
    let halved = if edges == 1 {
        "1 edge from corner to corner was".into()
    } else {
        format!("{edges} edges from corner to corner were")
    };
    (edges > 0).then(|| {
        format!("{halved} halved, since the map can be like a power at one corner of a tet only; on a mesh so coarse that {advice}")
    })
}

fn taken(domain: Domain, subdivision: &Subdivision) -> Result<Domain, Fault> {
    if subdivision.parents().is_empty() { Ok(domain) } else { Ok(Domain::new(subdivision.mesh()?)?) }
}

/// The row of the results' table that names what cannot be halved or flipped.
pub(super) fn row_of_change(error: ChangeError) -> String {
    let (row, file, reason) = match error {
        ChangeError::Halving(row, reason) => (row, HALVED, reason),
        ChangeError::Flip(row, reason) => (row, FLIPPED, reason),
    };
    format!("row {row} of {file} (counted from 0): {reason}")
}

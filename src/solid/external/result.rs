//! What an external mesher returned, held against the surface it was given.

use std::collections::{HashMap, HashSet};

use super::{ExternalError, ExternalMesher, ExternalSettings, tet_volume};
use crate::mesh::{Boundary, TetId, TetMesh, TetSoup, Vec3, VertexId};
use crate::solid::Surface;

/// Vertices nearer than this times the surface's diagonal are one: Gmsh writes 14 digits.
const SAME: f64 = 1e-12;
/// Relative difference of volumes that rounding explains.
const VOLUME: f64 = 1e-9;

/// The mesh without unused vertices, the surface's own vertices at their exact places, if it fills the surface and has
/// the boundary that was asked for.
pub(super) fn checked(soup: TetSoup, surface: &Surface, settings: &ExternalSettings) -> Result<TetMesh, ExternalError> {
    let mesher = settings.mesher;
    // Gmsh keeps the vertices of its geometry, TetGen those of removed parts.
    let TetSoup { mut points, tets, .. } = soup.tidied();
    let found = Matches::of(surface, &points);
    for (at, surface_vertex) in found.of_mesh.iter().enumerate() {
        if let Some(vertex) = surface_vertex {
            points[at] = surface.points()[vertex.index()];
        }
    }
    let (mesh, _) =
        TetMesh::from_either_orientation(points, tets).map_err(|source| ExternalError::Mesh { mesher, source })?;
    let other = |difference: String| ExternalError::OtherSolid { mesher, difference };
    if let Some(vertex) = found.missing {
        let at: [f64; 3] = surface.points()[vertex.index()].into();
        return Err(other(format!("no vertex of the mesh lies at the surface's vertex {at:?}")));
    }
    let volume: f64 = (0..mesh.tets().len() as u32).map(|tet| tet_volume(&mesh, TetId(tet))).sum();
    if (volume / surface.volume() - 1.0).abs() > VOLUME {
        return Err(other(format!("its volume is {volume}, the surface's {}", surface.volume())));
    }
    if settings.keep_boundary {
        check_boundary(&mesh, surface, &found, mesher)?;
    }
    Ok(mesh)
}

/// Which vertices of the mesh are vertices of the surface.
struct Matches {
    of_mesh: Vec<Option<VertexId>>,
    /// A vertex of the surface that the mesh lacks.
    missing: Option<VertexId>,
}

impl Matches {
    fn of(surface: &Surface, points: &[Vec3]) -> Self {
        let (low, high) = surface.bounding_box();
        let near = SAME * (high - low).norm();
        // Cells far wider than `near`, so that a match lies in the same cell or just across a border.
        let cell = |p: &Vec3, shift: Vec3| -> [i64; 3] {
            ((p - low) / (16.0 * near) + 0.5 * shift).map(|x| x.floor() as i64).into()
        };
        let mut by_cell: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
        for (vertex, point) in points.iter().enumerate() {
            by_cell.entry(cell(point, Vec3::zeros())).or_default().push(vertex);
        }
        let mut found = Self { of_mesh: vec![None; points.len()], missing: None };
        for (number, point) in (0..).map(VertexId).zip(surface.points()) {
            let corners = (0..8).map(|i| Vec3::from([0, 1, 2].map(|axis| f64::from((i >> axis & 1) * 2 - 1))));
            let candidates = corners.flat_map(|corner| by_cell.get(&cell(point, corner))).flatten();
            let distance = |vertex: usize| (points[vertex] - point).norm();
            match candidates.copied().min_by(|&a, &b| distance(a).total_cmp(&distance(b))) {
                Some(vertex) if distance(vertex) <= near => found.of_mesh[vertex] = Some(number),
                _ => found.missing = found.missing.or(Some(number)),
            }
        }
        found
    }
}

fn check_boundary(
    mesh: &TetMesh,
    surface: &Surface,
    found: &Matches,
    mesher: ExternalMesher,
) -> Result<(), ExternalError> {
    let other = |difference: String| ExternalError::OtherSolid { mesher, difference };
    let boundary = Boundary::of(mesh).map_err(|source| other(source.to_string()))?;
    // Starting with the least vertex, so that turned triangles are equal and reversed ones are not.
    let turned = |mut triangle: [VertexId; 3]| {
        let least = (0..3).min_by_key(|&i| triangle[i]).expect("three vertices");
        triangle.rotate_left(least);
        triangle
    };
    let wanted: HashSet<[VertexId; 3]> = surface.triangles().iter().map(|&t| turned(t)).collect();
    let kept = |triangle: &[VertexId; 3]| match triangle.map(|v| found.of_mesh[v.index()]) {
        [Some(a), Some(b), Some(c)] => wanted.contains(&turned([a, b, c])),
        _ => false,
    };
    let strangers = boundary.triangles().iter().filter(|triangle| !kept(triangle)).count();
    if strangers > 0 || boundary.triangles().len() != wanted.len() {
        return Err(other(format!(
            "the boundary was to be kept, but {strangers} of its {} triangles are not among the surface's {}",
            boundary.triangles().len(),
            wanted.len()
        )));
    }
    Ok(())
}

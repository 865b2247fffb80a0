//! Small solids for tests: a star-shaped polyhedron and the fan of tets over its faces.

use super::{TetMesh, Vec3, VertexId};

/// Corners, and faces as corner lists counter-clockwise seen from outside.
pub(crate) type Polyhedron = (Vec<Vec3>, Vec<Vec<u32>>);

/// The cube `[-1, 1]^3`; corner i has the sign of bit 0, 1, 2 of i in x, y, z.
pub(crate) fn cube() -> Polyhedron {
    let sign = |bit: bool| if bit { 1.0 } else { -1.0 };
    let points = (0..8).map(|i| Vec3::new(sign(i & 1 != 0), sign(i & 2 != 0), sign(i & 4 != 0))).collect();
    hull(points)
}

/// The convex hull of a few points in convex position, faces found by trying every triple: exact enough for solids whose
/// coplanar corners agree to 1e-9.
pub(crate) fn hull(points: Vec<Vec3>) -> Polyhedron {
    let mut faces: Vec<Vec<u32>> = Vec::new();
    for i in 0..points.len() {
        for j in 0..points.len() {
            for k in 0..points.len() {
                if i == j || j == k || i == k {
                    continue;
                }
                let normal = (points[j] - points[i]).cross(&(points[k] - points[i])).normalize();
                let height = |p: &Vec3| normal.dot(&(p - points[i]));
                if points.iter().any(|p| height(p) > 1e-9) {
                    continue;
                }
                let on_plane: Vec<usize> = (0..points.len()).filter(|&v| height(&points[v]) > -1e-9).collect();
                let mean = on_plane.iter().map(|&v| points[v]).sum::<Vec3>() / on_plane.len() as f64;
                let first = points[on_plane[0]] - mean;
                let turn = |v: usize| {
                    let arm = points[v] - mean;
                    normal.dot(&first.cross(&arm)).atan2(first.dot(&arm)).rem_euclid(std::f64::consts::TAU)
                };
                let mut face = on_plane.clone();
                face[1..].sort_by(|&a, &b| turn(a).total_cmp(&turn(b)));
                let face: Vec<u32> = face.into_iter().map(|v| v as u32).collect();
                if !faces.contains(&face) {
                    faces.push(face);
                }
            }
        }
    }
    (points, faces)
}

/// Every face cut into triangles from its first corner, each joined to `centre`, which becomes the last vertex.
pub(crate) fn fan((corners, faces): &Polyhedron, centre: Vec3) -> TetMesh {
    let mut points = corners.clone();
    points.push(centre);
    let apex = corners.len() as u32;
    let triangles = faces.iter().flat_map(|face| face[1..].windows(2).map(|pair| [face[0], pair[0], pair[1]]));
    let tets = triangles.map(|[a, b, c]| [apex, a, b, c].map(VertexId)).collect();
    TetMesh::new(points, tets).expect("the fixture is star-shaped about its centre")
}

/// The mesh with every tet cut in four at its centroid, so that a fan has free vertices and edges enough to play with.
pub(crate) fn split(mesh: &TetMesh) -> TetMesh {
    let (mut points, mut tets) = (mesh.points().to_vec(), Vec::new());
    for tet in mesh.tets() {
        let middle = VertexId(points.len() as u32);
        points.push(tet.iter().map(|v| mesh.points()[v.index()]).sum::<Vec3>() / 4.0);
        for replaced in 0..4 {
            let mut piece = *tet;
            piece[replaced] = middle;
            tets.push(piece);
        }
    }
    TetMesh::new(points, tets).expect("the centroid is inside the tet")
}

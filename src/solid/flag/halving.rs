//! Halving the edges of the surface of a flag mesh.

use std::collections::HashMap;

use super::{FlagError, FlagMesh};
use crate::mesh::{Boundary, TetMesh, VertexId};
use crate::solid::MOST_TETS;

/// The edges of a tet.
const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

/// The mesh with all edges of its surface halved: a tet with a face on the surface is cut in four, one with an edge there in two. No
/// other has a part of the surface, of which a flag holds one triangle, V C E. Nothing is left to choose, so that mirror images stay such.
pub(super) fn halved_surface(FlagMesh { mesh, flags }: FlagMesh) -> Result<FlagMesh, FlagError> {
    let boundary = Boundary::of(&mesh).expect("a triangle has two tets at most");
    let mut points = mesh.points().to_vec();
    let mut middles: HashMap<[VertexId; 2], VertexId> = HashMap::new();
    let key = |a: VertexId, b: VertexId| [a.min(b), a.max(b)];
    for &[a, b, c] in boundary.triangles() {
        for (a, b) in [(a, b), (b, c), (c, a)] {
            middles.entry(key(a, b)).or_insert_with(|| {
                points.push((mesh.points()[a.index()] + mesh.points()[b.index()]) * 0.5);
                VertexId(points.len() as u32 - 1)
            });
        }
    }
    let mut tets = Vec::with_capacity(mesh.tets().len() + 3 * boundary.triangles().len());
    for tet in mesh.tets() {
        let middle = |i: usize, j: usize| middles.get(&key(tet[i], tet[j])).copied();
        let with = |replaced: &[(usize, Option<VertexId>)]| {
            let mut piece = *tet;
            replaced.iter().for_each(|&(i, vertex)| piece[i] = vertex.unwrap_or(piece[i]));
            piece
        };
        let halved: Vec<[usize; 2]> = EDGES.into_iter().filter(|&[i, j]| middle(i, j).is_some()).collect();
        match halved[..] {
            [] => tets.push(*tet),
            [[i, j]] => tets.extend([(i, j), (j, i)].map(|(i, j)| with(&[(j, middle(i, j))]))),
            // In the order of `EDGES`, the first two edges of a face have its first corner in common.
            [[a, b], [_, c], ..] => {
                let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
                tets.extend([
                    with(&[(b, ab), (c, ca)]),
                    with(&[(a, ab), (c, bc)]),
                    with(&[(a, ca), (b, bc)]),
                    with(&[(a, bc), (b, ca), (c, ab)]),
                ]);
            }
        }
        if tets.len() > MOST_TETS {
            return Err(FlagError::TooLarge { flags: flags.len(), tets_a_flag: tets.len() / flags.len() });
        }
    }
    Ok(FlagMesh { mesh: TetMesh::new(points, tets)?, flags })
}

//! How well shaped the tets of a mesh are.

use super::{TetId, TetMesh, edge_matrix};

/// The smallest dihedral angle of any tet, in degrees, in `(0, 70.53]` (the upper end is the regular tet's).
///
/// Between faces i and j of a tet, pi minus the angle of their outward normals, by `atan2`: accurate for slivers, where
/// the arc cosine loses half the digits.
pub fn smallest_dihedral_angle(mesh: &TetMesh) -> f64 {
    let mut smallest = f64::INFINITY;
    for tet in 0..mesh.tets().len() as u32 {
        let corners = mesh.corners(TetId(tet));
        let normals = TetMesh::FACES.map(|face| {
            let [a, b, c] = face.map(|i| corners[i]);
            (b - a).cross(&(c - a))
        });
        for i in 0..4 {
            for j in 0..i {
                let angle = normals[i].cross(&normals[j]).norm().atan2(-normals[i].dot(&normals[j]));
                smallest = smallest.min(angle);
            }
        }
    }
    smallest.to_degrees()
}

/// A tet far thinner than it is long.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sliver {
    /// The tet.
    pub tet: TetId,
    /// Its volume over the cube of its longest edge, in (0, 0.118], the upper end being the regular tet's.
    pub thickness: f64,
}

/// The tets of a thickness below a given one, in their order.
pub fn slivers(mesh: &TetMesh, below: f64) -> Vec<Sliver> {
    let thickness = |tet: TetId| {
        let corners = mesh.corners(tet);
        let edges = (0..4).flat_map(|i| (0..i).map(move |j| (corners[i] - corners[j]).norm_squared()));
        edge_matrix(corners).determinant() / 6.0 / edges.fold(0.0, f64::max).powf(1.5)
    };
    let all = (0..mesh.tets().len() as u32).map(TetId).map(|tet| Sliver { tet, thickness: thickness(tet) });
    all.filter(|sliver| sliver.thickness < below).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Vec3, VertexId};

    fn angle(points: [Vec3; 4]) -> f64 {
        let tets = vec![[0, 1, 2, 3].map(VertexId)];
        smallest_dihedral_angle(&TetMesh::from_either_orientation(points.to_vec(), tets).unwrap().0)
    }

    #[test]
    fn slivers_are_told_by_volume_over_length_cubed() {
        // The corner of a cube flattened to a height h: volume h / 6, longest edge sqrt 2.
        let corner = |height: f64| [Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z() * height];
        let mesh = |height| TetMesh::new(corner(height).to_vec(), vec![[0, 1, 2, 3].map(VertexId)]).unwrap();
        assert_eq!(slivers(&mesh(1.0), 0.01), []);
        let found = slivers(&mesh(1e-3), 1e-4);
        assert_eq!(found[0].tet, TetId(0));
        assert!((found[0].thickness / (1e-3 / 6.0 / 8f64.sqrt()) - 1.0).abs() < 1e-14);
    }

    #[test]
    fn closed_forms() {
        let regular = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]].map(Vec3::from);
        assert!((angle(regular) - (1.0f64 / 3.0).acos().to_degrees()).abs() < 1e-12);
        // The corner of a cube: 90 degrees at the axes, atan(sqrt 2) at the slanted face.
        let corner = [Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z()];
        assert!((angle(corner) - 2.0f64.sqrt().atan().to_degrees()).abs() < 1e-12);
        // A sliver: flattening the corner along z to a height h leaves atan(h sqrt 2) at the hypotenuse.
        let height = 1e-9;
        let sliver = [Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z() * height];
        let expected = (height * 2.0f64.sqrt()).to_degrees();
        assert!((angle(sliver) - expected).abs() < 1e-12 * expected);
    }
}

//! What files hold, before it is checked to be a solid.

use std::collections::HashSet;

use super::{Vec3, VertexId};

/// Points and polygons as a surface file holds them: nothing is checked but that indices are in range, and that points are
/// finite where a polygon names them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PolygonSoup {
    /// Vertex positions.
    pub points: Vec<Vec3>,
    /// Polygons, counter-clockwise seen from outside if the file is in order.
    pub polygons: Vec<Vec<VertexId>>,
    /// What was done to the file's content that nobody asked for, a sentence each without its full stop.
    pub notes: Vec<String>,
}

/// Points and tetrahedra as a mesh file holds them: nothing is checked but that indices are in range, and that points are
/// finite where a tet names them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TetSoup {
    /// Vertex positions.
    pub points: Vec<Vec3>,
    /// Tetrahedra in the file's own vertex order, which may be of either orientation.
    pub tets: Vec<[VertexId; 4]>,
    /// What was done to the file's content that nobody asked for, a sentence each without its full stop.
    pub notes: Vec<String>,
}

impl PolygonSoup {
    /// A soup of which there is nothing to tell.
    pub fn new(points: Vec<Vec3>, polygons: Vec<Vec<VertexId>>) -> Self {
        Self { points, polygons, notes: Vec::new() }
    }
}

impl TetSoup {
    /// Which vertices some tet names.
    pub fn named_vertices(&self) -> Vec<bool> {
        let mut named = vec![false; self.points.len()];
        self.tets.iter().flatten().for_each(|v| named[v.index()] = true);
        named
    }

    /// Without vertices that no tet names, such as a CAD program's centres of arcs, and without tets whose four vertices an
    /// earlier one has, such as members of two groups; the others keep their order. A note tells of each kind.
    pub fn tidied(mut self) -> Self {
        let mut seen = HashSet::with_capacity(self.tets.len());
        let before = self.tets.len();
        self.tets.retain(|tet| {
            let mut sorted = *tet;
            sorted.sort_unstable();
            seen.insert(sorted)
        });
        if self.tets.len() < before {
            let count = before - self.tets.len();
            self.notes.push(format!("{count} tets that repeat the vertices of another one were dropped"));
        }
        let named = self.named_vertices();
        let count = named.iter().filter(|&&named| !named).count();
        if count > 0 {
            self.notes.push(format!("{count} vertices that belong to no tet were dropped"));
            let mut next = 0;
            let number: Vec<VertexId> = named
                .iter()
                .map(|&named| {
                    next += u32::from(named);
                    VertexId(next.saturating_sub(1))
                })
                .collect();
            self.tets.iter_mut().flatten().for_each(|v| *v = number[v.index()]);
            let mut named = named.into_iter();
            self.points.retain(|_| named.next() == Some(true));
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_tet_names_goes_and_the_rest_keeps_its_order() {
        let at = |x: f64| Vec3::new(x, x * x, 1.0);
        let points = vec![at(f64::NAN), at(1.0), at(2.0), at(9.0), at(3.0), at(4.0)];
        let tets = [[1, 2, 4, 5], [5, 4, 2, 1]].map(|tet| tet.map(VertexId)).to_vec();
        let soup = TetSoup { points, tets, notes: vec![] }.tidied();
        assert_eq!(soup.points, [1.0, 2.0, 3.0, 4.0].map(at));
        assert_eq!(soup.tets, [[0, 1, 2, 3].map(VertexId)]);
        assert_eq!(
            soup.notes,
            [
                "1 tets that repeat the vertices of another one were dropped",
                "2 vertices that belong to no tet were dropped"
            ]
        );
        assert_eq!(soup.clone().tidied(), soup);
    }
}

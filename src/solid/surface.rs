//! Closed triangle surfaces: the boundary of a solid, checked.

use crate::mesh::{DisjointSets, PolygonSoup, TriangleId, Unit, Vec3, VertexId};

use super::polygon::PolygonError;
use super::repair::{RepairSettings, Triangles, welded_at_once, welded_within};

/// Why polygons do not bound a solid. All numbers count from 0, in the order of the file or generator.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SurfaceError {
    /// No polygon at all.
    #[error("the surface has no triangles; export it again with its faces")]
    Empty,
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} (counted from 0) has a coordinate that is not finite; give it three numbers")]
    NotFinite {
        /// The vertex.
        vertex: usize,
    },
    /// A polygon names a vertex that does not exist.
    #[error("polygon {polygon} names vertex {vertex}, but there are only {count} (counted from 0)")]
    VertexOutOfRange {
        /// The polygon.
        polygon: usize,
        /// The vertex it names.
        vertex: u32,
        /// How many vertices there are.
        count: usize,
    },
    /// A polygon cannot be cut into triangles.
    #[error("polygon {polygon} (vertices and polygons are counted from 0) {fault}")]
    BadPolygon {
        /// The polygon.
        polygon: usize,
        /// What is wrong with it.
        fault: PolygonError,
    },
    /// An edge has a triangle on one side only.
    #[error(
        "the surface is not closed: {count} edges have a triangle on one side only, such as the one from {from:?} to \
         {to:?}; fill the holes, or merge vertices that should be one (in a config domain.fill_holes, domain.weld)"
    )]
    Open {
        /// How many such edges there are.
        count: usize,
        /// One end of the first.
        from: [f64; 3],
        /// Its other end.
        to: [f64; 3],
    },
    /// Three or more triangles share an edge.
    #[error(
        "{count} triangles (the first three: {triangles:?}) share the edge from {from:?} to {to:?}; keep two of them"
    )]
    OverusedEdge {
        /// How many triangles share it.
        count: usize,
        /// The first three of them.
        triangles: [u32; 3],
        /// One end.
        from: [f64; 3],
        /// The other end.
        to: [f64; 3],
    },
    /// Several sheets of the surface touch in a vertex only.
    #[error("{sheets} sheets of the surface meet in nothing but the vertex at {at:?}; pull them apart")]
    PinchedVertex {
        /// How many sheets.
        sheets: usize,
        /// Where.
        at: [f64; 3],
    },
    /// Two neighbours have opposite orientations.
    #[error(
        "triangles {triangles:?} run their common edge from {from:?} to {to:?} in the same direction: \
         reverse the vertex order of one of them"
    )]
    InconsistentOrientation {
        /// The two triangles.
        triangles: [u32; 2],
        /// One end of the edge.
        from: [f64; 3],
        /// The other end.
        to: [f64; 3],
    },
    /// The surface falls apart.
    #[error(
        "the surface has {count} separate pieces, one of them with {triangles} triangles at {at:?}; keep one piece (in \
         a config domain.keep_largest; an inner piece would be a cavity)"
    )]
    Disconnected {
        /// How many pieces.
        count: usize,
        /// Number of triangles of the smallest piece, the first of several.
        triangles: usize,
        /// A vertex of that piece.
        at: [f64; 3],
    },
    /// The surface encloses nothing.
    #[error("the surface encloses no volume: its sides lie on one another; give it a thickness")]
    NoVolume,
}

/// An edge of a surface with its two triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SurfaceEdge {
    /// Its ends.
    pub vertices: [VertexId; 2],
    /// The triangle that runs the edge from the first end to the second, then the one that runs it back.
    pub triangles: [TriangleId; 2],
}

/// A closed, connected, oriented 2-manifold of triangles; each is counter-clockwise seen from outside.
///
/// Not checked: that the surface does not cut through itself. A solid that passes [`super::star_centre`] does not.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    points: Vec<Vec3>,
    triangles: Vec<[VertexId; 3]>,
    edges: Vec<SurfaceEdge>,
    was_inside_out: bool,
    notes: Vec<String>,
}

impl Surface {
    /// The same surface with lengths counted in another unit.
    pub fn in_unit(&self, unit: Unit) -> Self {
        Self { points: unit.take_points(&self.points), ..self.clone() }
    }

    /// Checks polygons and cuts those of more than three vertices into triangles.
    ///
    /// Vertices that no polygon names are dropped, the others keep their order; triangles keep the order of their
    /// polygons. Polygons without area are dropped, and where the surface is not closed otherwise, vertices at the same
    /// place become one; see [`Surface::notes`]. A surface that is inside out (negative volume) is reversed as a whole.
    ///
    /// # Errors
    /// The first fault, with its place.
    pub fn from_soup(soup: PolygonSoup) -> Result<Self, SurfaceError> {
        Self::repaired(soup, &RepairSettings::default())
    }

    /// The same, with repairs that have to be asked for.
    ///
    /// # Errors
    /// As [`Surface::from_soup`].
    pub fn repaired(soup: PolygonSoup, settings: &RepairSettings) -> Result<Self, SurfaceError> {
        if let Some(tolerance) = settings.weld {
            let (welded, spared) = welded_within(&soup, tolerance);
            return Self::of_triangles(told(Triangles::of(&welded)?, spared), settings);
        }
        match Self::of_triangles(Triangles::of(&soup)?, settings) {
            Err(error @ SurfaceError::Open { .. }) => match welded_at_once(&soup) {
                (_, 0) => Err(error),
                (welded, spared) => Self::of_triangles(told(Triangles::of(&welded)?, spared), settings),
            },
            made => made,
        }
    }

    fn of_triangles(mut soup: Triangles, settings: &RepairSettings) -> Result<Self, SurfaceError> {
        if settings.keep_largest {
            soup.keep_largest();
        }
        if settings.fill_holes {
            soup.fill_holes();
        }
        let Triangles { points, mut triangles, notes } = soup;
        let points = drop_unused(points, &mut triangles);
        let edges = pair_edges(&points, &triangles)?;
        check_links(&points, &triangles, &edges)?;
        let mut surface = Self { points, triangles, edges, was_inside_out: false, notes };
        let volume = surface.volume();
        if volume == 0.0 {
            return Err(SurfaceError::NoVolume);
        }
        if volume < 0.0 {
            surface.was_inside_out = true;
            surface.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
            surface.edges.iter_mut().for_each(|edge| edge.triangles.swap(0, 1));
        }
        Ok(surface)
    }

    /// The same of triangles; points that none of them uses are dropped.
    ///
    /// # Errors
    /// As [`Surface::from_soup`].
    pub fn from_triangles(points: Vec<Vec3>, triangles: &[[VertexId; 3]]) -> Result<Self, SurfaceError> {
        let polygons = triangles.iter().map(|triangle| triangle.to_vec()).collect();
        Self::from_soup(PolygonSoup::new(points, polygons))
    }

    /// Vertex positions, each used by some triangle.
    pub fn points(&self) -> &[Vec3] {
        &self.points
    }

    /// Triangles, counter-clockwise seen from outside.
    pub fn triangles(&self) -> &[[VertexId; 3]] {
        &self.triangles
    }

    /// Each edge once, sorted by its vertices.
    pub fn edges(&self) -> &[SurfaceEdge] {
        &self.edges
    }

    /// Whether the given triangles faced inward and have all been reversed.
    pub fn was_inside_out(&self) -> bool {
        self.was_inside_out
    }

    /// What was done to the given polygons that nobody asked for, a sentence each without its full stop.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The corners of a triangle.
    pub fn corners(&self, triangle: TriangleId) -> [Vec3; 3] {
        self.triangles[triangle.index()].map(|v| self.points[v.index()])
    }

    /// The outward normal of a triangle, of length twice the area.
    pub fn area_vector(&self, triangle: TriangleId) -> Vec3 {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(&(c - a))
    }

    /// The outward unit normal of a triangle.
    pub fn normal(&self, triangle: TriangleId) -> Vec3 {
        self.area_vector(triangle).normalize()
    }

    /// Number of handles: V - E + F = 2 - 2 genus; 0 for a sphere.
    pub fn genus(&self) -> usize {
        (2 + self.edges.len() - self.points.len() - self.triangles.len()) / 2
    }

    /// Total area.
    pub fn area(&self) -> f64 {
        self.ids().map(|triangle| self.area_vector(triangle).norm() / 2.0).sum()
    }

    /// Enclosed volume; positive unless still under construction.
    pub fn volume(&self) -> f64 {
        let origin = self.bounding_box().0;
        self.ids().map(|triangle| cone_volume(self.corners(triangle).map(|p| p - origin))).sum()
    }

    /// Centroid of the enclosed volume.
    pub fn centroid(&self) -> Vec3 {
        // Relative to a corner of the bounding box: far from the origin the cones' volumes would cancel.
        let origin = self.bounding_box().0;
        let (mut moment, mut volume) = (Vec3::zeros(), 0.0);
        for triangle in self.ids() {
            let corners = self.corners(triangle).map(|p| p - origin);
            let cone = cone_volume(corners);
            volume += cone;
            moment += cone * (corners[0] + corners[1] + corners[2]) / 4.0;
        }
        origin + moment / volume
    }

    /// The least and the greatest coordinates.
    pub fn bounding_box(&self) -> (Vec3, Vec3) {
        let first = self.points[0];
        self.points.iter().fold((first, first), |(low, high), point| (low.inf(point), high.sup(point)))
    }

    /// The angle inside the solid between the two triangles of an edge, in radians: pi where they are coplanar, more
    /// where the edge is concave; in (0, 2 pi).
    pub fn dihedral_angle(&self, edge: &SurfaceEdge) -> f64 {
        let [first, second] = edge.triangles.map(|triangle| self.normal(triangle));
        let [from, to] = edge.vertices.map(|v| self.points[v.index()]);
        std::f64::consts::PI - first.cross(&second).dot(&(to - from).normalize()).atan2(first.dot(&second))
    }

    /// All triangle numbers.
    pub fn ids(&self) -> impl Iterator<Item = TriangleId> + use<> {
        (0..self.triangles.len() as u32).map(TriangleId)
    }
}

/// The triangles with a note of how many vertices became one with another.
fn told(mut triangles: Triangles, spared: usize) -> Triangles {
    if spared > 0 {
        let vertices = if spared == 1 { "vertex" } else { "vertices" };
        triangles.notes.push(format!("{spared} {vertices} became one with another at the same place"));
    }
    triangles
}

/// Signed volume of the tetrahedron from the origin to a triangle.
fn cone_volume([a, b, c]: [Vec3; 3]) -> f64 {
    a.dot(&b.cross(&c)) / 6.0
}

fn drop_unused(points: Vec<Vec3>, triangles: &mut [[VertexId; 3]]) -> Vec<Vec3> {
    let mut used = vec![false; points.len()];
    triangles.iter().flatten().for_each(|v| used[v.index()] = true);
    let mut next = 0;
    let renumbered: Vec<u32> = used
        .iter()
        .map(|&used| {
            next += u32::from(used);
            next.wrapping_sub(1)
        })
        .collect();
    triangles.iter_mut().flatten().for_each(|v| *v = VertexId(renumbered[v.index()]));
    points.into_iter().zip(used).filter(|&(_, used)| used).map(|(point, _)| point).collect()
}

/// Finds the two triangles of each edge; refuses edges with one, three or more, or two of the same direction.
fn pair_edges(points: &[Vec3], triangles: &[[VertexId; 3]]) -> Result<Vec<SurfaceEdge>, SurfaceError> {
    if triangles.is_empty() {
        return Err(SurfaceError::Empty);
    }
    // (smaller vertex, larger vertex, triangle, whether the triangle runs the edge backward)
    let mut sides = Vec::with_capacity(3 * triangles.len());
    for (index, triangle) in triangles.iter().enumerate() {
        for i in 0..3 {
            let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
            sides.push((a.min(b), a.max(b), index as u32, a > b));
        }
    }
    sides.sort_unstable();
    let at = |v: VertexId| points[v.index()].into();
    let groups = || sides.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1));
    if let Some(group) = groups().find(|group| group.len() > 2) {
        return Err(SurfaceError::OverusedEdge {
            count: group.len(),
            triangles: [group[0].2, group[1].2, group[2].2],
            from: at(group[0].0),
            to: at(group[0].1),
        });
    }
    let mut open = groups().filter(|group| group.len() == 1);
    if let Some(group) = open.next() {
        return Err(SurfaceError::Open { count: 1 + open.count(), from: at(group[0].0), to: at(group[0].1) });
    }
    groups()
        .map(|group| {
            let (forward, backward) = if group[0].3 { (group[1], group[0]) } else { (group[0], group[1]) };
            if forward.3 == backward.3 {
                return Err(SurfaceError::InconsistentOrientation {
                    triangles: [group[0].2, group[1].2],
                    from: at(group[0].0),
                    to: at(group[0].1),
                });
            }
            let triangles = [TriangleId(forward.2), TriangleId(backward.2)];
            Ok(SurfaceEdge { vertices: [forward.0, forward.1], triangles })
        })
        .collect()
}

/// Checks that the triangles around each vertex form one cycle and that the surface is connected.
fn check_links(points: &[Vec3], triangles: &[[VertexId; 3]], edges: &[SurfaceEdge]) -> Result<(), SurfaceError> {
    let corner = |triangle: TriangleId, vertex: VertexId| {
        let local = triangles[triangle.index()].iter().position(|&v| v == vertex);
        3 * triangle.0 + local.expect("an edge's triangles contain its ends") as u32
    };
    let mut sheets = DisjointSets::new(3 * triangles.len());
    let mut pieces = DisjointSets::new(triangles.len());
    for edge in edges {
        let [first, second] = edge.triangles;
        pieces.join(first.0, second.0);
        for vertex in edge.vertices {
            sheets.join(corner(first, vertex), corner(second, vertex));
        }
    }
    if sheets.count() > points.len() {
        let mut count = vec![0; points.len()];
        for (index, vertex) in triangles.iter().flatten().enumerate() {
            count[vertex.index()] += usize::from(sheets.root(index as u32) == index as u32);
        }
        if let Some(vertex) = count.iter().position(|&count| count > 1) {
            return Err(SurfaceError::PinchedVertex { sheets: count[vertex], at: points[vertex].into() });
        }
    }
    match pieces.count() {
        1 => Ok(()),
        count => {
            let mut sizes = vec![0; triangles.len()];
            (0..triangles.len()).for_each(|triangle| sizes[pieces.root(triangle as u32) as usize] += 1);
            let roots = (0..sizes.len()).filter(|&root| sizes[root] > 0);
            let smallest = roots.min_by_key(|&root| sizes[root]).expect("there are several pieces");
            let at = points[triangles[smallest][0].index()].into();
            Err(SurfaceError::Disconnected { count, triangles: sizes[smallest], at })
        }
    }
}

#[cfg(test)]
mod tests;

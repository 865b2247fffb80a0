//! Cutting a polygon into a fan of triangles.

use std::f64::consts::TAU;

use crate::mesh::{Vec3, VertexId};

/// How far a polygon's vertices may lie from its plane, as a part of its largest extent.
///
/// Files with six significant digits bend flat polygons by about 1e-6. Above 1e-4 the choice of the diagonals begins to
/// change the solid, and is not ours to make.
const PLANAR_TOLERANCE: f64 = 1e-4;

/// Why a polygon cannot be cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FanError {
    /// One or two vertices.
    #[error("has fewer than three vertices; remove it")]
    TooFewVertices,
    /// One vertex twice.
    #[error("names vertex {vertex} twice, vertices at one place counting as one; name it once, or remove the polygon")]
    RepeatedVertex {
        /// The vertex.
        vertex: u32,
    },
    /// Zero area.
    #[error("has no area: its vertices lie on one line; merge two of them")]
    Collinear,
    /// Vertices out of the plane.
    #[error("is not flat; triangulate it")]
    NotPlanar,
    /// No vertex sees the whole polygon.
    #[error("cannot be cut into a fan of triangles from any of its vertices; triangulate it")]
    NoFan,
}

/// Cuts a polygon into the fan from its first vertex, or from the first one whose fan triangulates it.
///
/// A fan triangulates the polygon if its triangles all turn the polygon's way, none has zero area and their angles at
/// the apex stay below a full turn; the convex polygon is the usual case, where only vertices on straight sides matter.
pub(super) fn triangulate(points: &[Vec3], polygon: &[VertexId]) -> Result<Vec<[VertexId; 3]>, FanError> {
    let n = polygon.len();
    if n < 3 {
        return Err(FanError::TooFewVertices);
    }
    let mut sorted = polygon.to_vec();
    sorted.sort_unstable();
    if let Some(pair) = sorted.windows(2).find(|pair| pair[0] == pair[1]) {
        return Err(FanError::RepeatedVertex { vertex: pair[0].0 });
    }
    let at = |i: usize| points[polygon[i % n].index()];
    if n == 3 {
        return match collinear([at(0), at(1), at(2)]) {
            true => Err(FanError::Collinear),
            false => Ok(vec![[polygon[0], polygon[1], polygon[2]]]),
        };
    }
    // The vector area, relative to a vertex for the sake of polygons far from the origin.
    let area: Vec3 = (1..n - 1).map(|i| (at(i) - at(0)).cross(&(at(i + 1) - at(0)))).sum();
    let extent = (1..n).map(|i| (at(i) - at(0)).norm()).fold(0.0, f64::max);
    let Some(normal) = area.try_normalize(0.0) else {
        return Err(FanError::Collinear);
    };
    if (1..n).any(|i| (at(i) - at(0)).dot(&normal).abs() > PLANAR_TOLERANCE * extent) {
        return Err(FanError::NotPlanar);
    }
    let fan = |apex: usize| (1..n - 1).map(move |i| [apex, apex + i, apex + i + 1]);
    let triangulates = |apex: &usize| {
        let turn: Option<f64> = fan(*apex)
            .map(|triangle| {
                let [a, b, c] = triangle.map(at);
                let turns_along = (b - a).cross(&(c - a)).dot(&normal) > 0.0;
                (turns_along && !collinear([a, b, c])).then(|| (b - a).angle(&(c - a)))
            })
            .sum();
        turn.is_some_and(|turn| turn < TAU)
    };
    let apex = (0..n).find(triangulates).ok_or(FanError::NoFan)?;
    Ok(fan(apex).map(|triangle| triangle.map(|i| polygon[i % n])).collect())
}

/// Whether three points lie on one line, exactly: their projections on the three coordinate planes all do.
fn collinear(corners: [Vec3; 3]) -> bool {
    [(0, 1), (1, 2), (2, 0)].into_iter().all(|(i, j)| {
        let [a, b, c] = corners.map(|p| robust::Coord { x: p[i], y: p[j] });
        robust::orient2d(a, b, c) == 0.0
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut(points: &[[f64; 3]]) -> Result<Vec<[u32; 3]>, FanError> {
        let points: Vec<Vec3> = points.iter().map(|&p| p.into()).collect();
        let polygon: Vec<VertexId> = (0..points.len() as u32).map(VertexId).collect();
        Ok(triangulate(&points, &polygon)?.into_iter().map(|t| t.map(|v| v.0)).collect())
    }

    const SQUARE: [[f64; 3]; 4] = [[0., 0., 1.], [1., 0., 1.], [1., 1., 1.], [0., 1., 1.]];

    #[test]
    fn a_convex_polygon_is_fanned_from_its_first_vertex() {
        assert_eq!(cut(&SQUARE), Ok(vec![[0, 1, 2], [0, 2, 3]]));
    }

    #[test]
    fn a_vertex_on_a_side_moves_the_apex() {
        let mut house = SQUARE.to_vec();
        house.insert(1, [0.5, 0., 1.]);
        assert_eq!(cut(&house), Ok(vec![[1, 2, 3], [1, 3, 4], [1, 4, 0]]));
    }

    #[test]
    fn polygons_without_a_fan_are_refused() {
        let mut bent = SQUARE;
        bent[2][2] += 0.01;
        assert_eq!(cut(&bent), Err(FanError::NotPlanar));
        // A star of six points: no vertex sees all others.
        let star: Vec<[f64; 3]> = (0..12)
            .map(|i| {
                let (sin, cos) = (f64::from(i) * TAU / 12.0).sin_cos();
                let radius = if i % 2 == 0 { 1.0 } else { 0.2 };
                [radius * cos, radius * sin, 0.0]
            })
            .collect();
        assert_eq!(cut(&star), Err(FanError::NoFan));
        assert_eq!(cut(&[[0., 0., 0.], [1., 1., 1.], [3., 3., 3.]]), Err(FanError::Collinear));
        assert_eq!(cut(&SQUARE[..2]), Err(FanError::TooFewVertices));
    }

    #[test]
    fn collinearity_is_exact() {
        assert!(cut(&[[0.1, 0.1, 0.1], [0.2, 0.2, 0.2], [0.4, 0.4, 0.4]]).is_err());
        assert!(cut(&[[0.1, 0.1, 0.1], [0.2, 0.2, 0.2], [0.4, 0.4, 0.4 + 1e-16]]).is_ok());
    }
}

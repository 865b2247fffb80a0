//! How a closed surface looks from a point.

use std::f64::consts::{PI, TAU};

use super::angle::{Angle, tet_solid_angle};
use super::{Orientation, Vec3, orientation};

/// What a point sees of a closed oriented surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum View {
    /// The triangle at this position in the list is seen edge-on, from outside or not at all (a NaN, a rounding error of
    /// its angle that is out of hand).
    FacesAway(usize),
    /// Every triangle is seen from within, by exact predicate, and together they cover the sphere of directions so often.
    ///
    /// Then central projection is a covering of the sphere, branched at most at vertices; it is one-to-one, and the
    /// surface embedded and star-shaped about the point, exactly if this is 1.
    Covers(i64),
}

impl View {
    /// Looks from `centre` at triangles that are counter-clockwise seen from outside.
    pub(crate) fn from<'a>(centre: &Vec3, triangles: impl Iterator<Item = [&'a Vec3; 3]>) -> Self {
        let mut seen = Angle::ZERO;
        for (index, [a, b, c]) in triangles.enumerate() {
            let finite = [centre, a, b, c].iter().all(|p| p.iter().all(|x| x.is_finite()));
            if !finite || orientation([centre, a, b, c]) != Orientation::Positive {
                return Self::FacesAway(index);
            }
            seen = seen + tet_solid_angle(centre, [a, b, c]);
            // The sum is a multiple of 4 pi, so that less than that tells which.
            if seen.upper() - seen.lower() >= TAU {
                return Self::FacesAway(index);
            }
        }
        Self::Covers((seen.value() / (4.0 * PI)).round() as i64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::fixtures::cube;

    fn view(points: &[Vec3], centre: Vec3) -> View {
        let squares = cube().1;
        let triangles: Vec<[u32; 3]> = squares.iter().flat_map(|f| [[f[0], f[1], f[2]], [f[0], f[2], f[3]]]).collect();
        View::from(&centre, triangles.iter().map(|triangle| triangle.map(|v| &points[v as usize])))
    }

    #[test]
    fn a_cube_covers_the_sphere_once_from_within_and_faces_away_from_outside() {
        let points = cube().0;
        assert_eq!(view(&points, Vec3::new(0.9, -0.9, 0.5)), View::Covers(1));
        for outside in [Vec3::x(), Vec3::x() * 2.0, Vec3::repeat(f64::NAN)] {
            assert!(matches!(view(&points, outside), View::FacesAway(_)), "{outside:?}");
        }
        let mirrored: Vec<Vec3> = points.iter().map(|p| -p).collect();
        assert_eq!(view(&mirrored, Vec3::zeros()), View::FacesAway(0));
    }
}

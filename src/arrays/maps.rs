//! Maps that nothing improves, and what a map does with points.

use rayon::prelude::*;

use super::{ArrayError, mesh, positions};
use crate::domain::Domain;
use crate::map::{Evaluator, Located, Onto, RadialCoordinates, RayEnd, caraman};
use crate::mesh::{Unit, Vec3, VertexId};
use crate::solid::{CentreChoice, Surface, star_centre};
use crate::sphere::{SphereSettings, sphere_map as map_onto_sphere};

/// Caraman's radial map of a star-shaped solid, given by its tets, onto the unit ball: the image of each vertex. A point at the
/// fraction t of its ray from the centre to the boundary goes to the radius t^exponent, exponent > 0.
///
/// # Errors
/// [`ArrayError`]: arrays that are no mesh of a ball, an exponent that is none, a solid that is not star-shaped about the centre.
pub fn radial_map(
    points: &[[f64; 3]],
    tets: &[[u32; 4]],
    centre: &CentreChoice,
    exponent: f64,
) -> Result<Vec<[f64; 3]>, ArrayError> {
    super::check_exponent(exponent)?;
    let (mesh, unit) = mesh(points, tets)?;
    let domain = Domain::new(mesh)?;
    let surface = Surface::from_triangles(domain.mesh().points().to_vec(), domain.boundary().triangles())?;
    let centre = star_centre(&surface, &super::in_unit(centre, unit))?.position;
    let coordinates = RadialCoordinates::of_domain(&domain, &surface, centre, RayEnd::Only)?;
    Ok(rows(&caraman(&coordinates, exponent)))
}

/// Maps a closed surface without handles onto the unit sphere ([`crate::sphere`]): the image of each vertex. Every image triangle
/// is seen from the centre from within, by exact predicate, and together they cover the sphere once.
///
/// # Errors
/// [`ArrayError`]: triangles that are no closed surface, handles, weights that are none, or points that are no vertices of it.
pub fn sphere_map(
    points: &[[f64; 3]],
    triangles: &[[u32; 3]],
    settings: &SphereSettings,
) -> Result<Vec<[f64; 3]>, ArrayError> {
    let (surface, _) = surface(points, triangles)?;
    let found = surface.points().len();
    if found != points.len() {
        return Err(ArrayError::NotVertices { points: points.len(), found });
    }
    Ok(rows(map_onto_sphere(&surface, settings)?.positions()))
}

/// Where the piecewise-linear map that takes `points` to `image` takes the points `at`, in the unit of `image`, or for a map onto
/// the ball in the ball; `None` for those outside of the mesh.
///
/// # Errors
/// [`ArrayError`]; among others a flipped tet of the image, or for a map onto the ball an image that is not star-shaped about 0.
pub fn evaluate(
    points: &[[f64; 3]],
    tets: &[[u32; 4]],
    image: &[[f64; 3]],
    at: &[[f64; 3]],
    onto: Onto,
) -> Result<Vec<Option<[f64; 3]>>, ArrayError> {
    located(points, tets, image, at, onto, false)
}

/// The points that the map takes to the points `at` of its image, or for a map onto the ball of the ball; `None` for those outside
/// of the image.
///
/// # Errors
/// As [`evaluate`].
pub fn inverse(
    points: &[[f64; 3]],
    tets: &[[u32; 4]],
    image: &[[f64; 3]],
    at: &[[f64; 3]],
    onto: Onto,
) -> Result<Vec<Option<[f64; 3]>>, ArrayError> {
    located(points, tets, image, at, onto, true)
}

fn located(
    points: &[[f64; 3]],
    tets: &[[u32; 4]],
    image: &[[f64; 3]],
    at: &[[f64; 3]],
    onto: Onto,
    inverse: bool,
) -> Result<Vec<Option<[f64; 3]>>, ArrayError> {
    let (mesh, unit) = mesh(points, tets)?;
    let domain = Domain::any_topology(mesh)?;
    let (image, of_image) = positions("image", image, points.len())?;
    let evaluator = Evaluator::new(&domain, &image, onto)?;
    // The ball has its own unit.
    let of_image = if onto == Onto::Ball { Unit::default() } else { of_image };
    let (from, to) = if inverse { (of_image, unit) } else { (unit, of_image) };
    let find = |point: &[f64; 3]| -> Option<[f64; 3]> {
        let point = Vec3::from(point.map(|x| from.take(x, 1)));
        // A point that is nowhere is outside.
        let point = Some(point).filter(|point| point.iter().all(|x| x.is_finite()))?;
        let Located { position, .. } = if inverse { evaluator.inverse(&point) } else { evaluator.at(&point) }?;
        Some(<[f64; 3]>::from(position).map(|x| to.give_back(x, 1)))
    };
    Ok(at.par_iter().map(find).collect())
}

/// The closed surface of triangles, and the unit in which it is counted.
pub(super) fn surface(points: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<(Surface, Unit), ArrayError> {
    let points: Vec<Vec3> = points.iter().map(|&point| point.into()).collect();
    let unit = Unit::of(&points);
    let triangles: Vec<[VertexId; 3]> = triangles.iter().map(|triangle| triangle.map(VertexId)).collect();
    if let Some((row, triangle)) =
        triangles.iter().enumerate().find(|(_, t)| t.iter().any(|v| v.index() >= points.len()))
    {
        return Err(ArrayError::NoSuchVertex { row, triangle: triangle.map(|v| v.0), vertices: points.len() });
    }
    if let Some(row) = points.iter().position(|point| !point.iter().all(|x| x.is_finite())) {
        return Err(ArrayError::NotFinite { array: "points", row });
    }
    let surface = Surface::from_triangles(unit.take_points(&points), &triangles).map_err(ArrayError::Triangles)?;
    Ok((surface, unit))
}

pub(super) fn rows(points: &[Vec3]) -> Vec<[f64; 3]> {
    points.iter().map(|&point| point.into()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::fixtures::{cube, fan};

    type Arrays = (Vec<[f64; 3]>, Vec<[u32; 4]>);

    fn cube_fan() -> Arrays {
        let mesh = fan(&cube(), Vec3::zeros());
        (rows(mesh.points()), mesh.tets().iter().map(|tet| tet.map(|v| v.0)).collect())
    }

    #[test]
    fn the_radial_map_keeps_directions_and_fractions_in_any_unit() {
        let (points, tets) = cube_fan();
        for scale in [1.0, 2f64.powi(700)] {
            let scaled: Vec<[f64; 3]> = points.iter().map(|point| point.map(|x| scale * x)).collect();
            let image = radial_map(&scaled, &tets, &CentreChoice::At([0.1 * scale, 0.0, 0.0].into()), 2.0).unwrap();
            for (point, image) in points.iter().zip(&image) {
                let [ray, image] = [Vec3::from(*point) - Vec3::new(0.1, 0.0, 0.0), Vec3::from(*image)];
                let (length, radius) = (ray.norm(), image.norm());
                assert!((image - radius * ray / length).norm() < 1e-14);
                // The centre of the cube is the fraction 1/11 of its ray, which ends at x = -1.
                let expected = if length < 0.5 { (0.1f64 / 1.1).powi(2) } else { 1.0 };
                assert!((radius - expected).abs() < 1e-13, "{point:?}: {radius}");
            }
        }
        let refused = radial_map(&points, &tets, &CentreChoice::Kernel, f64::NAN).unwrap_err();
        assert!(matches!(refused, ArrayError::Exponent(_)));
    }

    #[test]
    fn a_cube_goes_onto_the_sphere_and_faults_name_the_row() {
        let (points, triangles) = cube();
        let points = rows(&points);
        let triangles: Vec<[u32; 3]> =
            triangles.iter().flat_map(|p| (2..p.len()).map(|i| [p[0], p[i - 1], p[i]])).collect();
        let image = sphere_map(&points, &triangles, &SphereSettings::default()).unwrap();
        assert!(image.len() == 8 && image.iter().all(|&p| (Vec3::from(p).norm() - 1.0).abs() < 1e-15));
        let refused = |points: &[[f64; 3]], triangles: &[[u32; 3]]| {
            sphere_map(points, triangles, &SphereSettings::default()).unwrap_err().to_string()
        };
        let more = [&points[..], &[[5.0; 3]]].concat();
        assert!(refused(&more, &triangles).contains("8 of the 9 points"), "{}", refused(&more, &triangles));
        let mut wild = triangles.clone();
        wild[3][1] = 77;
        assert!(refused(&points, &wild).starts_with("row 3 of triangles is ["), "{}", refused(&points, &wild));
        assert!(refused(&points, &triangles[1..]).starts_with("the surface: "));
    }

    #[test]
    fn a_stretch_is_evaluated_and_inverted_in_any_units() {
        let (points, tets) = cube_fan();
        let stretch = |[x, y, z]: [f64; 3]| [2.0 * x + 1.0, y, 0.5 * z];
        let at = [[0.25, -0.5, 0.75], [1.5, 0.0, 0.0], [f64::NAN, 0.0, 0.0], [0.0; 3]];
        for scale in [1.0, 2f64.powi(-800)] {
            let image: Vec<[f64; 3]> = points.iter().map(|&p| stretch(p).map(|x| x * scale)).collect();
            let found = evaluate(&points, &tets, &image, &at, Onto::Polyhedron).unwrap();
            assert_eq!(found[1..3], [None, None]);
            let there: Vec<[f64; 3]> = [found[0], found[3]].map(Option::unwrap).to_vec();
            let back = inverse(&points, &tets, &image, &there, Onto::Polyhedron).unwrap();
            for ((&from, to), back) in [&at[0], &at[3]].into_iter().zip(&there).zip(back) {
                let (to, back) = (Vec3::from(to.map(|x| x / scale)), Vec3::from(back.unwrap()));
                assert!((to - Vec3::from(stretch(from))).norm() < 1e-14 && (back - Vec3::from(from)).norm() < 1e-14);
            }
        }
        let mut flipped = points.clone();
        flipped[8] = [3.0, 0.0, 0.0];
        assert!(matches!(evaluate(&points, &tets, &flipped, &at, Onto::Ball), Err(ArrayError::Evaluator(_))));
    }
}

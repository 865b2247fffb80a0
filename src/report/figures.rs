//! Figures that reports state of a domain and of its bounds.

use serde::{Deserialize, Serialize};

use crate::bound::{LowerBound, Scope, best_applicable};
use crate::dilatation::null_is_infinite;
use crate::domain::Domain;
use crate::map::Corners;
use crate::map::corner::solid_angles;
use crate::measure::{Measured, Summary, ball_fraction};
use crate::mesh::{Subdivision, TetId, Unit, Vec3, VertexId, smallest_dihedral_angle};
use crate::optimize::Untangled;
use crate::refine::{RefineEnd, Round};
use crate::solid::StarCentre;
use crate::sphere::SphereDistortion;

/// The size and shape of a domain.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DomainFigures {
    /// What it is of, in words: a solid's name or a file.
    pub solid: String,
    /// Number of vertices.
    pub vertices: usize,
    /// Number of tets.
    pub tets: usize,
    /// Number of tets all of whose vertices lie on the boundary, so that nothing can change their dilatation.
    pub locked: usize,
    /// Number of vertices on the boundary.
    pub boundary_vertices: usize,
    /// Number of triangles of the boundary.
    pub boundary_triangles: usize,
    /// Volume, in the solid's units cubed.
    #[serde(deserialize_with = "null_is_infinite")]
    pub volume: f64,
    /// Smallest dihedral angle of any tet, in degrees.
    pub smallest_dihedral_angle: f64,
    /// The star centre, in the solid's units.
    pub centre: Option<[f64; 3]>,
    /// Radius of the largest ball of star centres, in the solid's units.
    pub kernel_radius: Option<f64>,
    /// The alpha of the paper's geometric condition: the least angle between a ray from `centre` and the plane of the
    /// triangle that it meets, in degrees.
    pub smallest_angle: Option<f64>,
}

impl DomainFigures {
    /// Counts and measures `domain`; what is known of its star centre, if it has one, is taken as given.
    pub fn of(domain: &Domain, solid: String, centre: Option<&StarCentre>) -> Self {
        let mesh = domain.mesh();
        Self {
            solid,
            vertices: mesh.points().len(),
            tets: mesh.tets().len(),
            locked: domain.locked_tets().count(),
            boundary_vertices: domain.boundary().vertex_mask().iter().filter(|&&on| on).count(),
            boundary_triangles: domain.boundary().triangles().len(),
            volume: domain.volumes().iter().sum(),
            smallest_dihedral_angle: smallest_dihedral_angle(mesh),
            centre: centre.map(|centre| centre.position.into()),
            kernel_radius: centre.map(|centre| centre.kernel_radius),
            smallest_angle: centre.map(|centre| centre.smallest_angle.to_degrees()),
        }
    }
}

impl DomainFigures {
    /// The same of a domain whose lengths were counted in a unit.
    pub(crate) fn given_back(self, unit: Unit) -> Self {
        Self {
            volume: unit.give_back(self.volume, 3),
            centre: self.centre.map(|centre| centre.map(|x| unit.give_back(x, 1))),
            kernel_radius: self.kernel_radius.map(|radius| unit.give_back(radius, 1)),
            ..self
        }
    }
}

/// A corner at which a map is like a power of the distance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CornerFigures {
    /// The vertex.
    pub vertex: VertexId,
    /// Where it is, in the solid's units.
    pub position: [f64; 3],
    /// The solid angle of the domain there, in steradians.
    pub solid_angle: f64,
    /// The exponent p > 0 of the distance.
    pub exponent: f64,
}

impl CornerFigures {
    /// The corners of a domain whose lengths are counted in `unit`.
    pub(crate) fn of(domain: &Domain, corners: &Corners, unit: Unit) -> Vec<Self> {
        let exponents = corners.exponents();
        let vertices: Vec<VertexId> = exponents.iter().map(|(vertex, _)| *vertex).collect();
        let angles = solid_angles(domain, &vertices);
        let figures = |((vertex, exponent), solid_angle): ((VertexId, f64), f64)| Self {
            vertex,
            position: domain.mesh().points()[vertex.index()].map(|x| unit.give_back(x, 1)).into(),
            solid_angle,
            exponent,
        };
        exponents.into_iter().zip(angles).map(figures).collect()
    }
}

/// What is known of the map started from without measuring it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MapFigures {
    /// Its kind and parameters, in words.
    pub map: String,
    /// Exponent a of a radial map; `null` for other maps.
    pub radial_exponent: Option<f64>,
    /// The largest K of the smooth radial map, in closed form, which `initial.max_k` tends to on finer meshes; none without
    /// a star centre.
    pub radial_smooth_k: Option<f64>,
    /// The least upper bound of K of another map, over all points where it is defined; none where it is infinite or no
    /// formula is known. On fine meshes `initial.max_k` exceeds it by little.
    pub closed_form_k: Option<f64>,
    /// How far the boundary's map onto the sphere is from a similarity; `null` unless it was made by progressive embedding.
    pub boundary_map: Option<SphereDistortion>,
}

/// How the surface of a solid was refined for a shell mesh whose config left that to the program.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RefinementFigures {
    /// Triangles of the surface before; after, they are the domain's boundary triangles.
    pub triangles_before: usize,
    /// The largest K of the radial map of the image polyhedron onto the ball, after.
    pub largest_stretch: f64,
}

/// How a map spreads angles and volumes over the tets, each counted once: what papers on volume parameterization report.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DistortionFigures {
    /// Standard deviation of K; its mean is `final.mean_k`.
    pub k_deviation: f64,
    /// Mean and standard deviation of the ratio of image volume to volume, each as a part of the whole.
    pub mean_volume_ratio: f64,
    /// See `mean_volume_ratio`.
    pub volume_ratio_deviation: f64,
    /// Standard deviation of that ratio's logarithm.
    pub log_volume_ratio_deviation: f64,
}

impl DistortionFigures {
    /// The figures of a map with these image positions; `None` if a tet is flipped.
    pub fn of(domain: &Domain, image: &[Vec3], measured: &Measured) -> Option<Self> {
        let volumes: Vec<f64> = (0..domain.mesh().tets().len() as u32)
            .map(|t| domain.jacobian(TetId(t), image).determinant() * domain.volumes()[t as usize])
            .collect();
        if measured.summary.flipped > 0 || volumes.iter().any(|volume| volume.is_nan() || *volume <= 0.0) {
            return None;
        }
        let scale = domain.volumes().iter().sum::<f64>() / volumes.iter().sum::<f64>();
        let ratios: Vec<f64> = volumes.iter().zip(domain.volumes()).map(|(of, volume)| scale * of / volume).collect();
        let (mean_volume_ratio, volume_ratio_deviation) = moments(&ratios);
        let (_, log_volume_ratio_deviation) = moments(&ratios.iter().map(|ratio| ratio.ln()).collect::<Vec<_>>());
        let (_, k_deviation) =
            moments(&measured.dilatations.iter().map(|dilatation| dilatation.k()).collect::<Vec<_>>());
        Some(Self { k_deviation, mean_volume_ratio, volume_ratio_deviation, log_volume_ratio_deviation })
    }
}

/// Mean and standard deviation.
fn moments(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    (mean, (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count).sqrt())
}

/// The splits that made a given mesh's boundary a full subcomplex, so that no tet is locked, and those for corners and the collar.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Splits {
    /// Interior edges between boundary vertices that were halved.
    pub edges: usize,
    /// Interior faces between boundary vertices that were split at their centre.
    pub faces: usize,
    /// Edges between corners of the solid that were halved, for a map that is like powers there.
    #[serde(default)]
    pub corners: usize,
    /// Edges of the collar that were halved.
    #[serde(default)]
    pub collar: usize,
    /// Number of tets before.
    pub tets_before: usize,
}

impl Splits {
    /// Those that made a mesh of one with so many tets.
    pub fn of(subdivision: &Subdivision, tets_before: usize) -> Self {
        let (edges, faces) = (subdivision.edge_splits(), subdivision.face_splits());
        Self { edges, faces, corners: 0, collar: 0, tets_before }
    }
}

/// How a start with flipped tets was untangled.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct UntanglingFigures {
    /// Flipped tets of the start, on the mesh before any edge was halved.
    pub flipped_before: usize,
    /// Newton steps of all vertices together, or sweeps of one step a vertex.
    pub iterations: usize,
    /// Interior edges that were halved about the last tets that resisted.
    #[serde(default)]
    pub refinement_splits: usize,
    /// Tets that are still flipped.
    pub resisting: Vec<TetId>,
    /// Vertices that two or more of those share, most shared first: where to refine.
    pub common_vertices: Vec<VertexId>,
}

impl UntanglingFigures {
    /// The figures of an untangling from a start with that many flipped tets; `None` if there was nothing to do.
    pub fn of(domain: &Domain, flipped_before: usize, untangled: &Untangled, refinement_splits: usize) -> Option<Self> {
        if flipped_before == 0 {
            return None;
        }
        let mut uses = std::collections::BTreeMap::new();
        for tet in &untangled.resisting {
            for vertex in domain.mesh().tets()[tet.index()] {
                *uses.entry(vertex).or_insert(0usize) += 1;
            }
        }
        let mut common: Vec<(VertexId, usize)> = uses.into_iter().filter(|&(_, count)| count > 1).collect();
        common.sort_by_key(|&(vertex, count)| (std::cmp::Reverse(count), vertex));
        Some(Self {
            flipped_before,
            iterations: untangled.iterations,
            refinement_splits,
            resisting: untangled.resisting.clone(),
            common_vertices: common.into_iter().map(|(vertex, _)| vertex).collect(),
        })
    }
}

/// How the mesh was refined where the largest K sits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RefinedFigures {
    /// How many tets there were.
    pub tets_before: usize,
    /// Whether edges of the surface were halved as well; what is told of K here is onto the ball then.
    #[serde(default)]
    pub surface: bool,
    /// The largest K on them; `null` where the map was not settled.
    #[serde(default)]
    pub max_k_before: Option<f64>,
    /// Why there was no further round.
    pub end: RefineEnd,
    /// The rounds.
    pub rounds: Vec<Round>,
}

/// The largest lower bound that speaks of the measured map, and how far above it the map is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BestBound {
    /// The largest bound that is proved and applies, if any does.
    pub best_bound: Option<f64>,
    /// Achieved K / best bound, >= 1 and 1 where the map is proved to be best; none without a bound or a finite K. The K of a
    /// map is not below a proved bound: a measured one may be, by its rounding (more is a [`crate::bound::Contradiction`]), and
    /// the quotient is then taken for 1.
    pub gap: Option<f64>,
}

impl BestBound {
    /// The best of `bounds` for a map whose largest K is `max_k`.
    pub fn of(bounds: &[LowerBound], max_k: f64) -> Self {
        let best_bound = best_applicable(bounds).map(|bound| bound.value);
        Self { best_bound, gap: best_bound.map(|bound| (max_k / bound).max(1.0)).filter(|gap| gap.is_finite()) }
    }
}

/// What a map says of the maps of its solid onto the ball, by way of `final.ball_k`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BallFigures {
    /// The share of the ball's volume that the image fills; `null` where there is no K onto the ball.
    pub ball_fraction: Option<f64>,
    /// The largest proved bound for every quasi-conformal map of the solid onto the ball, if there is one.
    pub ball_bound: Option<f64>,
    /// K onto the ball, certified, over that bound: the least K of all such maps lies between the two. None where one of them
    /// is not known or not finite.
    pub ball_gap: Option<f64>,
    /// Why there is no K onto the ball; `null` if there is one, or if the run was interrupted before it was found.
    pub ball_reason: Option<String>,
}

impl BallFigures {
    /// The figures of a map with these bounds, measured by [`crate::measure::measure_onto_ball`].
    pub fn of(domain: &Domain, image: &[Vec3], bounds: &[LowerBound], measured: &Summary) -> Self {
        let fraction = ball_fraction(domain, image);
        let of_solid = bounds.iter().filter(|bound| bound.certified && bound.scope == Scope::Shape);
        let ball_bound = of_solid.map(|bound| bound.value).reduce(f64::max);
        let gap = measured.ball_k.zip(ball_bound).map(|(k, bound)| k.certified / bound);
        Self {
            ball_fraction: fraction.ok(),
            ball_bound,
            ball_gap: gap.filter(|gap| gap.is_finite()),
            ball_reason: fraction.err().map(|reason| reason.to_string()),
        }
    }
}

/// For each vertex, whether it lies on the boundary, and for each tet, whether all its vertices do.
pub(super) fn boundary_flags(domain: &Domain) -> (&[bool], Vec<bool>) {
    let on_boundary = domain.boundary().vertex_mask();
    let locked = |tet: &[VertexId; 4]| tet.iter().all(|v| on_boundary[v.index()]);
    (on_boundary, domain.mesh().tets().iter().map(locked).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::measure;
    use crate::mesh::fixtures::{cube, fan};

    #[test]
    fn volumes_of_a_cube_whose_centre_moves() {
        let domain = Domain::new(fan(&cube(), Vec3::zeros())).unwrap();
        let mut image = domain.mesh().points().to_vec();
        image.iter_mut().for_each(|p| *p *= 3.0);
        let similar = DistortionFigures::of(&domain, &image, &measure(&domain, &image)).unwrap();
        assert!((similar.mean_volume_ratio - 1.0).abs() < 1e-15 && similar.volume_ratio_deviation < 1e-15);
        // The heights over the faces at x = 1 and -1 become 1/2 and 3/2 of what they were, of two tets of twelve each.
        image[8].x += 1.5;
        let moved = DistortionFigures::of(&domain, &image, &measure(&domain, &image)).unwrap();
        assert!((moved.mean_volume_ratio - 1.0).abs() < 1e-15);
        assert!((moved.volume_ratio_deviation - (4.0 * 0.25 / 12.0f64).sqrt()).abs() < 1e-14);
        image[8].x += 1.5;
        assert_eq!(DistortionFigures::of(&domain, &image, &measure(&domain, &image)), None);
    }
}

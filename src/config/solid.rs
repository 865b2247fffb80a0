//! The built-in solids, and which parameters each takes.

use schemars::JsonSchema;
use serde::Deserialize;

use super::error::Fault;
use super::limits::{between, positive, whole};
use super::{CentreName, CentreValue, Config, DomainTable};
use crate::mesh::Vec3;
use crate::solid::{CentreChoice, Solid};

/// The name of a built-in solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SolidName {
    /// The regular tetrahedron.
    Tetrahedron,
    /// The cube.
    Cube,
    /// The regular octahedron.
    Octahedron,
    /// The regular dodecahedron.
    Dodecahedron,
    /// The regular icosahedron.
    Icosahedron,
    /// A right prism over a regular polygon.
    Prism,
    /// A right pyramid over a regular polygon.
    Pyramid,
    /// Two pyramids base to base.
    Bipyramid,
    /// A rectangular box.
    Box,
    /// A ball, as a polyhedron inscribed in the sphere.
    Ball,
    /// A solid torus. No star-shaped solid: for the surface tools only.
    Torus,
    /// An ellipsoid, as a polyhedron inscribed in it.
    Ellipsoid,
    /// A random smooth star shape: spherical harmonics.
    StarHarmonics,
    /// A random star-shaped polyhedron.
    StarPolyhedron,
}

/// One row a parameter: its key, whether it was given, and the solids it belongs to.
fn parameters(domain: &DomainTable) -> [(&'static str, bool, &'static [SolidName]); 8] {
    use SolidName::{Ball, Bipyramid, Box, Ellipsoid, Prism, Pyramid, StarHarmonics, StarPolyhedron, Torus};
    let based: &[SolidName] = &[Prism, Pyramid, Bipyramid];
    [
        ("sides", domain.sides.is_some(), based),
        ("height", domain.height.is_some(), based),
        ("size", domain.size.is_some(), &[Box]),
        ("radius", domain.radius.is_some(), &[Ball]),
        ("radii", domain.radii.is_some(), &[Ellipsoid, Torus]),
        ("amplitude", domain.amplitude.is_some(), &[StarHarmonics, StarPolyhedron]),
        ("degree", domain.degree.is_some(), &[StarHarmonics]),
        ("resolution", domain.resolution.is_some(), &[Ball, Torus, Ellipsoid, StarHarmonics, StarPolyhedron]),
    ]
}

/// Refuses the parameters that do not belong to the solid, or any if the domain is a file.
pub(super) fn check_parameters(domain: &DomainTable) -> Result<(), Fault> {
    for (key, given, owners) in parameters(domain) {
        if given && !domain.solid.is_some_and(|solid| owners.contains(&solid)) {
            let owners: Vec<String> = owners.iter().map(|&owner| spelled(owner)).collect();
            let of = domain.solid.map_or("a file".to_string(), |solid| format!("the solid {}", spelled(solid)));
            let message = format!("`{key}` is no parameter of {of}");
            return Err(Fault::at(&["domain", key], message, format!("remove it, or choose {}", owners.join(" or "))));
        }
    }
    Ok(())
}

/// A solid's name as it stands in a config.
pub(super) fn spelled(solid: SolidName) -> String {
    // "StarHarmonics" -> "star-harmonics", the same rule as serde's kebab-case.
    let mut text = String::new();
    for letter in format!("{solid:?}").chars() {
        if letter.is_uppercase() && !text.is_empty() {
            text.push('-');
        }
        text.extend(letter.to_lowercase());
    }
    text
}

/// The solid that a checked `[domain]` means.
pub(super) fn build(name: SolidName, config: &Config) -> Result<Solid, Fault> {
    let domain = &config.domain;
    let sides = || whole(domain.sides, 4, 3..=100_000, &["domain", "sides"]);
    let height = || positive(domain.height, 1.0, &["domain", "height"]);
    let resolution = |least| whole(domain.resolution, 8, least..=1000, &["domain", "resolution"]);
    let amplitude = || between(domain.amplitude, 0.3, 0.0..1.0, &["domain", "amplitude"]);
    let seed = || whole(Some(config.seed), 0, 0..=i64::MAX, &["seed"]);
    Ok(match name {
        SolidName::Tetrahedron => Solid::Tetrahedron,
        SolidName::Cube => Solid::Cube,
        SolidName::Octahedron => Solid::Octahedron,
        SolidName::Dodecahedron => Solid::Dodecahedron,
        SolidName::Icosahedron => Solid::Icosahedron,
        SolidName::Prism => Solid::Prism { sides: sides()?, height: height()? },
        SolidName::Pyramid => Solid::Pyramid { sides: sides()?, height: height()? },
        SolidName::Bipyramid => Solid::Bipyramid { sides: sides()?, height: height()? },
        SolidName::Box => Solid::Box { size: lengths(&domain.size, [1.0, 2.0, 3.0], "size")? },
        SolidName::Ball => {
            Solid::Ball { radius: positive(domain.radius, 1.0, &["domain", "radius"])?, resolution: resolution(1)? }
        }
        SolidName::Torus => {
            let [major_radius, minor_radius] = lengths(&domain.radii, [2.0, 1.0], "radii")?;
            if major_radius <= minor_radius {
                let message = format!("the ring's radius {major_radius} is not larger than the tube's {minor_radius}");
                return Err(Fault::at(&["domain", "radii"], message, "give [ring, tube] with ring > tube"));
            }
            // A tube has three segments or more.
            Solid::Torus { major_radius, minor_radius, resolution: resolution(3)? }
        }
        SolidName::Ellipsoid => {
            Solid::Ellipsoid { radii: lengths(&domain.radii, [1.0, 2.0, 3.0], "radii")?, resolution: resolution(1)? }
        }
        SolidName::StarHarmonics => Solid::SmoothStar {
            amplitude: amplitude()?,
            degree: whole(domain.degree, 4, 1..=16, &["domain", "degree"])?,
            resolution: resolution(1)?,
            seed: seed()?,
        },
        SolidName::StarPolyhedron => {
            Solid::PolyhedralStar { amplitude: amplitude()?, resolution: resolution(1)?, seed: seed()? }
        }
    })
}

fn lengths<const N: usize>(given: &Option<Vec<f64>>, default: [f64; N], key: &'static str) -> Result<[f64; N], Fault> {
    let Some(given) = given else { return Ok(default) };
    <[f64; N]>::try_from(given.as_slice())
        .ok()
        .filter(|lengths| lengths.iter().all(|x| x.is_finite() && *x > 0.0))
        .ok_or_else(|| {
            let message = format!("`{key}` is {given:?}, but must be {N} lengths, all finite and greater than 0");
            Fault::at(&["domain", key], message, format!("for example {key} = {default:?}"))
        })
}

/// The star centre that a config asks for.
pub(super) fn centre(config: &Config) -> Result<CentreChoice, Fault> {
    Ok(match &config.domain.centre {
        None | Some(CentreValue::Named(CentreName::Kernel)) => CentreChoice::Kernel,
        Some(CentreValue::Named(CentreName::Centroid)) => CentreChoice::Centroid,
        Some(CentreValue::Named(CentreName::Bbox)) => CentreChoice::BoundingBox,
        Some(CentreValue::Named(CentreName::Optimize)) => CentreChoice::Optimize,
        Some(CentreValue::At(point)) if point.iter().all(|x| x.is_finite()) => CentreChoice::At(Vec3::from(*point)),
        Some(CentreValue::At(point)) => {
            let message = format!("the centre {point:?} is not finite");
            return Err(Fault::at(&["domain", "centre"], message, "give three finite coordinates"));
        }
    })
}

//! The solids that can be asked for by name.

use super::polyhedron::Polyhedron;
use super::{Surface, SurfaceError, platonic, prism, smooth, star};
use crate::mesh::PolygonSoup;

/// The finest surface that is generated. A mesh over it would not fit in memory long before.
const MAX_TRIANGLES: f64 = 1e7;

/// Why a solid cannot be generated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SolidError {
    /// A parameter has a value that makes no solid.
    #[error("{parameter} is {value}, but {requirement}")]
    Parameter {
        /// The parameter's name.
        parameter: &'static str,
        /// The value given.
        value: f64,
        /// What it must be.
        requirement: &'static str,
    },
    /// The surface would have more triangles than any mesher can use.
    #[error("this would make {triangles:.0} triangles; lower `resolution` or `sides` to stay below ten million")]
    TooFine {
        /// How many triangles.
        triangles: f64,
    },
    /// The parameters are so extreme that the surface breaks down in rounding.
    #[error("the parameters are too extreme: {0}")]
    Surface(#[from] SurfaceError),
}

/// A solid by name and parameters.
///
/// Polyhedra have every face cut barycentrically, into (centroid, corner, edge midpoint): a cube has 48 triangles and 26
/// vertices. The others have `resolution` segments to each edge of a projected icosahedron (20 resolution^2 triangles)
/// or round the tube of the torus.
#[derive(Clone, Debug, PartialEq)]
pub enum Solid {
    /// Edge 2 sqrt 2: every second corner of the cube [-1, 1]^3.
    Tetrahedron,
    /// [-1, 1]^3.
    Cube,
    /// Edge sqrt 2, corners at distance 1 on the axes.
    Octahedron,
    /// Edge sqrt 5 - 1, circumscribed to the cube [-1, 1]^3.
    Dodecahedron,
    /// Edge 2, circumradius sqrt(1 + g^2), g the golden ratio.
    Icosahedron,
    /// A box centred at the origin.
    Box {
        /// Its edge lengths along x, y and z.
        size: [f64; 3],
    },
    /// A prism over a regular polygon with sides of length 1, axis z, centred at the origin.
    Prism {
        /// Number of sides of the polygon.
        sides: u32,
        /// Its height.
        height: f64,
    },
    /// A pyramid over a regular polygon with sides of length 1, axis z, its centroid at the origin; with four sides and
    /// height 1 / sqrt 2 all edges are equal.
    Pyramid {
        /// Number of sides of the polygon.
        sides: u32,
        /// Its height.
        height: f64,
    },
    /// Two pyramids on a common regular polygon with sides of length 1 in the plane z = 0.
    Bipyramid {
        /// Number of sides of the polygon.
        sides: u32,
        /// The height of each of the two.
        height: f64,
    },
    /// A ball about the origin; vertices on the sphere, so that the polyhedron lies inside the ball.
    Ball {
        /// Its radius.
        radius: f64,
        /// Segments to an edge of the icosahedron.
        resolution: u32,
    },
    /// An ellipsoid about the origin, vertices on the smooth surface.
    Ellipsoid {
        /// Semi-axes along x, y and z.
        radii: [f64; 3],
        /// Segments to an edge of the icosahedron.
        resolution: u32,
    },
    /// A torus about the z-axis, vertices on the smooth surface. Not star-shaped.
    Torus {
        /// Distance from the axis to the centre of the tube.
        major_radius: f64,
        /// Radius of the tube, less than the other.
        minor_radius: f64,
        /// Segments round the tube; along the tube as many as make them of about the same length.
        resolution: u32,
    },
    /// A random smooth solid, star-shaped about the origin: its radius is 1 + amplitude S, S a sum of spherical
    /// harmonics with max |S| = 1 over the vertices.
    SmoothStar {
        /// Same seed, same solid.
        seed: u64,
        /// The highest degree of the harmonics, 1 to 16.
        degree: u32,
        /// How far the radius may move from 1, in [0, 1).
        amplitude: f64,
        /// Segments to an edge of the icosahedron.
        resolution: u32,
    },
    /// A random polyhedron with triangular faces, star-shaped about the origin: over each vertex of a subdivided
    /// icosahedron a radius uniform in 1 +- amplitude.
    PolyhedralStar {
        /// Same seed, same solid.
        seed: u64,
        /// How far the radius may move from 1, in [0, 1).
        amplitude: f64,
        /// Segments to an edge of the icosahedron: 20 resolution^2 faces.
        resolution: u32,
    },
}

impl std::fmt::Display for Solid {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Tetrahedron => f.write_str("tetrahedron"),
            Self::Cube => f.write_str("cube"),
            Self::Octahedron => f.write_str("octahedron"),
            Self::Dodecahedron => f.write_str("dodecahedron"),
            Self::Icosahedron => f.write_str("icosahedron"),
            Self::Box { size: [x, y, z] } => write!(f, "box {x} x {y} x {z}"),
            Self::Prism { sides, height } => write!(f, "prism with {sides} sides, height {height}"),
            Self::Pyramid { sides, height } => write!(f, "pyramid with {sides} sides, height {height}"),
            Self::Bipyramid { sides, height } => write!(f, "bipyramid with {sides} sides, heights {height}"),
            Self::Ball { radius, .. } => write!(f, "ball of radius {radius}"),
            Self::Ellipsoid { radii: [x, y, z], .. } => write!(f, "ellipsoid with semi-axes {x}, {y}, {z}"),
            Self::Torus { major_radius, minor_radius, .. } => {
                write!(f, "torus with radii {major_radius} and {minor_radius}")
            }
            Self::SmoothStar { seed, .. } => write!(f, "smooth random star shape, seed {seed}"),
            Self::PolyhedralStar { seed, .. } => write!(f, "random star-shaped polyhedron, seed {seed}"),
        }
    }
}

impl Solid {
    /// The solid's surface.
    ///
    /// # Errors
    /// The first parameter that makes no sense, by name.
    pub fn surface(&self) -> Result<Surface, SolidError> {
        self.check()?;
        Ok(Surface::from_soup(self.soup())?)
    }

    fn soup(&self) -> PolygonSoup {
        let polyhedron: Polyhedron = match *self {
            Solid::Tetrahedron => platonic::tetrahedron(),
            Solid::Cube => platonic::cuboid([2.0; 3]),
            Solid::Octahedron => platonic::octahedron(),
            Solid::Dodecahedron => platonic::dodecahedron(),
            Solid::Icosahedron => platonic::icosahedron(),
            Solid::Box { size } => platonic::cuboid(size),
            Solid::Prism { sides, height } => prism::prism(sides, height),
            Solid::Pyramid { sides, height } => prism::pyramid(sides, height),
            Solid::Bipyramid { sides, height } => prism::bipyramid(sides, height),
            Solid::PolyhedralStar { seed, amplitude, resolution } => star::polyhedral(seed, amplitude, resolution),
            Solid::Ball { radius, resolution } => return smooth::ellipsoid([radius; 3], resolution),
            Solid::Ellipsoid { radii, resolution } => return smooth::ellipsoid(radii, resolution),
            Solid::Torus { major_radius, minor_radius, resolution } => {
                return smooth::torus(major_radius, minor_radius, resolution);
            }
            Solid::SmoothStar { seed, degree, amplitude, resolution } => {
                return star::smooth(seed, degree, amplitude, resolution);
            }
        };
        polyhedron.barycentric()
    }

    fn check(&self) -> Result<(), SolidError> {
        match *self {
            Solid::Tetrahedron | Solid::Cube | Solid::Octahedron | Solid::Dodecahedron | Solid::Icosahedron => Ok(()),
            Solid::Box { size } => size.iter().try_for_each(|&length| positive("size", length)),
            Solid::Prism { sides, height } | Solid::Pyramid { sides, height } | Solid::Bipyramid { sides, height } => {
                positive("height", height)?;
                at_least("sides", sides, 3, "a polygon has three sides or more")?;
                not_too_fine(12.0 * f64::from(sides))
            }
            Solid::Ball { radius, resolution } => {
                positive("radius", radius)?;
                check_resolution(resolution, 20.0)
            }
            Solid::Ellipsoid { radii, resolution } => {
                radii.iter().try_for_each(|&radius| positive("radii", radius))?;
                check_resolution(resolution, 20.0)
            }
            Solid::Torus { major_radius, minor_radius, resolution } => {
                positive("major_radius", major_radius)?;
                positive("minor_radius", minor_radius)?;
                if minor_radius >= major_radius {
                    let requirement = "it must be less than major_radius, or the torus would cut through itself";
                    return Err(SolidError::Parameter { parameter: "minor_radius", value: minor_radius, requirement });
                }
                at_least("resolution", resolution, 3, "a tube needs three segments or more")?;
                let segments = smooth::torus_segments(major_radius, minor_radius, resolution);
                not_too_fine(2.0 * f64::from(resolution) * segments)
            }
            Solid::SmoothStar { degree, amplitude, resolution, .. } => {
                check_amplitude(amplitude)?;
                at_least("degree", degree, 1, "degree 0 is the ball")?;
                if degree > 16 {
                    let requirement = "degrees above 16 need a finer mesh than is useful";
                    return Err(SolidError::Parameter { parameter: "degree", value: degree.into(), requirement });
                }
                check_resolution(resolution, 20.0)
            }
            Solid::PolyhedralStar { amplitude, resolution, .. } => {
                check_amplitude(amplitude)?;
                check_resolution(resolution, 120.0)
            }
        }
    }
}

fn positive(parameter: &'static str, value: f64) -> Result<(), SolidError> {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(SolidError::Parameter { parameter, value, requirement: "it must be a positive, finite length" })
}

fn at_least(parameter: &'static str, value: u32, least: u32, requirement: &'static str) -> Result<(), SolidError> {
    if value >= least {
        return Ok(());
    }
    Err(SolidError::Parameter { parameter, value: value.into(), requirement })
}

fn check_amplitude(value: f64) -> Result<(), SolidError> {
    if (0.0..1.0).contains(&value) {
        return Ok(());
    }
    let requirement = "it must lie in [0, 1) for the solid to stay star-shaped";
    Err(SolidError::Parameter { parameter: "amplitude", value, requirement })
}

fn check_resolution(resolution: u32, triangles: f64) -> Result<(), SolidError> {
    at_least("resolution", resolution, 1, "it counts segments, one at least")?;
    not_too_fine(triangles * f64::from(resolution) * f64::from(resolution))
}

fn not_too_fine(triangles: f64) -> Result<(), SolidError> {
    if triangles <= MAX_TRIANGLES { Ok(()) } else { Err(SolidError::TooFine { triangles }) }
}

#[cfg(test)]
mod tests;

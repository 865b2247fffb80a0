//! Pictures of meshes and of maps, drawn without a display (the kinds of paper Figures 3-11), and the same figures as data.
//!
//! Polygons are projected in parallel and drawn through a depth buffer: sections and images are not convex, so that no order
//! of the polygons from back to front would do, and the kept drawing crates have no depth.

mod colour;
mod cut;
mod data;
mod figures;
mod raster;
mod sheet;

pub use colour::Colour;
pub(crate) use colour::dilatation_colours;
pub use cut::Cut;
pub use data::BoundaryFigures;

use std::path::Path;

use colour::Paint;
use cut::{Corner, Polygon, Side};
use figures::Figures;
use raster::Canvas;
use sheet::Sheet;

use crate::mesh::io::WriteError;
use crate::mesh::{Cells, Vec3};
use crate::solid::SurfaceError;

/// Side of a panel, in pixels.
const PANEL: usize = 560;
/// Each pixel is the mean of so many squared.
const SAMPLES: usize = 3;
/// Half the width of the line of a mesh edge, in pixels.
const HALF_LINE: f64 = 0.35;
/// The same of an edge that shows its angle.
const HALF_WIDE_LINE: f64 = 1.5;

/// What a picture shows and from where.
#[derive(Clone, Debug, PartialEq)]
pub struct PictureSettings {
    /// What the colours mean.
    pub colour: Colour,
    /// What lies beyond all these planes of the domain is cut away, the same points of the image.
    pub cuts: Vec<Cut>,
    /// The direction to the viewer; its length is of no account.
    pub view: Vec3,
}

impl PictureSettings {
    /// The direction to the viewer unless another is given: x, y and z are all seen, and no face of a cube from its edge.
    pub const VIEW: [f64; 3] = [0.72, -0.5, 0.48];
}

/// Why there is no picture.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PictureError {
    /// No image was given, but a dilatation or a Jacobian is asked for.
    #[error("{colour:?} is a figure of a map: give the image too, or choose another colour")]
    NoMap {
        /// What was asked for.
        colour: Colour,
    },
    /// A plane without a normal.
    #[error("a plane is given by nx, ny, nz, d, all finite, with nx, ny, nz not all 0")]
    Plane,
    /// No direction.
    #[error("the direction to the viewer must be finite and not 0")]
    View,
    /// A position that is NaN or infinite.
    #[error("vertex {vertex} (counted from 0) is not finite")]
    NotFinite {
        /// The vertex.
        vertex: usize,
    },
    /// The planes leave nothing.
    #[error("nothing is left of the mesh; move the plane, or turn it round by negating its four numbers")]
    NothingLeft,
    /// Curvatures and angles are those of a closed surface of triangles.
    #[error("mean curvature and dihedral angles: the boundary: {0}")]
    Surface(#[from] SurfaceError),
    /// Curvatures and angles of a mesh of boxes.
    #[error("mean curvature and dihedral angles are of meshes of tets only")]
    Boxes,
}

/// A picture of a mesh, or of a mesh beside its image.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    sheet: Sheet,
}

impl Picture {
    /// Draws the boundary of `cells` with vertices at `domain`, and beside it the same at `image` if there is one. Where the
    /// cuts went through, the section is drawn; the image of a section is the section's image under the map that is linear
    /// on tets.
    ///
    /// # Errors
    /// What cannot be shown, see [`PictureError`].
    ///
    /// # Panics
    /// If there are fewer positions than vertices.
    pub fn draw(
        cells: Cells,
        domain: &[Vec3],
        image: Option<&[Vec3]>,
        settings: &PictureSettings,
    ) -> Result<Self, PictureError> {
        let view = View::towards(&settings.view)?;
        let panels: Vec<&[Vec3]> = std::iter::once(domain).chain(image).collect();
        for points in &panels {
            if let Some(vertex) = points.iter().position(|point| !point.iter().all(|x| x.is_finite())) {
                return Err(PictureError::NotFinite { vertex });
            }
        }
        let figures = Figures::of(settings.colour, cells, domain, image)?;
        let paint = Paint::new(settings.colour, &figures, domain);
        let mut sheet = Sheet::new(panels.len() * PANEL, PANEL);
        for (column, points) in panels.iter().enumerate() {
            let polygons = cut::polygons(cells, domain, points, figures.panel(column), &settings.cuts);
            if polygons.is_empty() {
                return Err(PictureError::NothingLeft);
            }
            let canvas = panel(&view, points, &polygons, &paint);
            sheet.place(column * PANEL, &canvas, SAMPLES);
            sheet.title(column * PANEL + PANEL / 2, ["domain", "image"][column]);
        }
        sheet.legend(&paint);
        Ok(Self { sheet })
    }

    /// Writes the picture as a PNG.
    ///
    /// # Errors
    /// The path and the system's reason.
    pub fn write_png(&self, path: &Path) -> Result<(), WriteError> {
        self.sheet.write_png(path)
    }
}

/// A parallel projection: the rows are to the right, up and towards the viewer.
struct View([Vec3; 3]);

impl View {
    /// z points up, or y if the view is along z.
    fn towards(viewer: &Vec3) -> Result<Self, PictureError> {
        let viewer = viewer.try_normalize(0.0).filter(|v| v.iter().all(|x| x.is_finite())).ok_or(PictureError::View)?;
        let along_z = viewer.x.hypot(viewer.y) < 1e-9;
        let right = (if along_z { Vec3::y() } else { Vec3::z() }).cross(&viewer).normalize();
        Ok(Self([right, viewer.cross(&right), viewer]))
    }

    fn apply(&self, point: &Vec3) -> Vec3 {
        Vec3::from(self.0.map(|axis| axis.dot(point)))
    }
}

/// Draws the polygons; the scale is that of all points, cut away or not.
fn panel(view: &View, points: &[Vec3], polygons: &[Polygon], paint: &Paint) -> Canvas {
    const PIXELS: f64 = (PANEL * SAMPLES) as f64;
    /// The part of the panel that the mesh fills.
    const FILLED: f64 = 0.84;
    let projected = || points.iter().map(|point| view.apply(point));
    let low = projected().reduce(|a, b| a.inf(&b)).expect("a mesh has points");
    let high = projected().reduce(|a, b| a.sup(&b)).expect("a mesh has points");
    let middle = (low + high) / 2.0;
    let scale = FILLED * PIXELS / (high - low).xy().max().max(f64::MIN_POSITIVE);
    let place = |point: &Vec3| {
        let at = (view.apply(point) - middle) * scale;
        Vec3::new(0.5 * PIXELS + at.x, 0.52 * PIXELS - at.y, at.z)
    };
    // From above the viewer's left shoulder.
    let light = (view.0[2] + 0.45 * view.0[1] - 0.25 * view.0[0]).normalize();
    let mut canvas = Canvas::new(PANEL * SAMPLES);
    for polygon in polygons {
        let last = polygon.corners.len() - 1;
        for i in 1..last {
            let corners = [0, i, i + 1].map(|corner| &polygon.corners[corner].0);
            // Opposite to the first, second and third corner of the triangle.
            let sides = [
                polygon.corners[i].1,
                if i + 1 == last { polygon.corners[last].1 } else { Side::Hidden },
                if i == 1 { polygon.corners[0].1 } else { Side::Hidden },
            ];
            triangle(&mut canvas, corners, sides, polygon, paint, &place, &light);
        }
    }
    canvas
}

fn triangle(
    canvas: &mut Canvas,
    corners: [&Corner; 3],
    sides: [Side; 3],
    polygon: &Polygon,
    paint: &Paint,
    place: &dyn Fn(&Vec3) -> Vec3,
    light: &Vec3,
) {
    let [a, b, c] = corners.map(|corner| corner.shown);
    let normal = (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_default();
    // The image of a flipped tet shows its back; both sides are lit.
    let brightness = 0.72 + 0.28 * normal.dot(light).abs();
    let placed = corners.map(|corner| place(&corner.shown));
    let doubled_area = (placed[1] - placed[0]).xy().perp(&(placed[2] - placed[0]).xy()).abs();
    let heights: [f64; 3] =
        std::array::from_fn(|i| doubled_area / (placed[(i + 1) % 3] - placed[(i + 2) % 3]).xy().norm());
    canvas.triangle(placed, &|weights| {
        for i in 0..3 {
            let distance = weights[i] * heights[i] / SAMPLES as f64;
            match sides[i] {
                Side::Edge(value) if distance < HALF_WIDE_LINE && paint.stands_out(value) => {
                    return paint.of_value(value);
                }
                Side::Plain | Side::Edge(_) if distance < HALF_LINE => {
                    return paint.of(polygon, corners, weights).map(|part| 0.5 * brightness * part);
                }
                _ => {}
            }
        }
        paint.of(polygon, corners, weights).map(|part| brightness * part)
    });
}

#[cfg(test)]
mod tests;

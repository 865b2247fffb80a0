//! What the viewer of a page draws: the boundary and cuts of the domain, with their images, packed for the page.
//!
//! A cut is where a plane meets the tets of the domain; its image is piecewise linear like the map. The whole mesh is not
//! embedded: the page stays small for large meshes.

use std::collections::HashMap;
use std::io::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use serde::Serialize;

use crate::mesh::{Boundary, TetMesh, Vec3};

/// Bytes that the cuts of a page may take before they are compressed.
const CUT_BYTES: usize = 9_000_000;
/// Triangles of a boundary beyond which a page has no viewer: some 10 MB.
const MOST_TRIANGLES: usize = 300_000;
/// Steps of a coordinate of 16 bits.
const STEPS: f64 = 65_535.0;

/// The values of each tet, one entry a tet.
#[derive(Debug, Default)]
pub(super) struct CellValues {
    pub(super) inner: Vec<f64>,
    pub(super) outer: Vec<f64>,
    pub(super) start: Vec<f64>,
    pub(super) active: Vec<bool>,
}

/// The surfaces in the form that the script of the page reads: arrays as base64 of zlib of little-endian numbers.
#[derive(Serialize)]
pub(super) struct Surfaces {
    /// The least coordinates and the extents of domain and image, to which the 16 bits of a coordinate refer.
    frames: [Frame; 2],
    /// Of the tets that are seen somewhere, in the order in which surfaces refer to them.
    cells: Cells,
    boundary: Surface,
    /// For x, y and z the cuts from low to high.
    cuts: [Vec<Cut>; 3],
}

#[derive(Clone, Copy, Serialize)]
struct Frame {
    least: [f64; 3],
    extent: [f64; 3],
}

/// f32, but for `tet` (u32) and `active` (u8).
#[derive(Serialize)]
struct Cells {
    tet: String,
    inner: String,
    outer: String,
    start: String,
    active: String,
}

#[derive(Serialize)]
struct Surface {
    /// u16: x, y and z in the domain, then in the image.
    points: String,
    /// u32: the three corners of each triangle.
    triangles: String,
    /// u32: the cell of each triangle.
    cells: String,
}

#[derive(Serialize)]
struct Cut {
    level: f64,
    #[serde(flatten)]
    surface: Surface,
}

/// A surface before it is packed; triangles refer to tets.
#[derive(Default)]
struct Triangles {
    points: Vec<[Vec3; 2]>,
    corners: Vec<[u32; 3]>,
    tets: Vec<u32>,
}

impl Triangles {
    fn bytes(&self) -> usize {
        12 * self.points.len() + 16 * self.corners.len()
    }
}

/// The surfaces of a map, or `None` if its boundary alone is too large for a page.
///
/// The centre plane of the bounding box is always among the cuts of an axis. `values` and `image` have an entry a tet and
/// one a vertex.
pub(super) fn surfaces(mesh: &TetMesh, boundary: &Boundary, image: &[Vec3], values: &CellValues) -> Option<Surfaces> {
    if boundary.triangles().len() > MOST_TRIANGLES {
        return None;
    }
    let frames = [mesh.points(), image].map(Frame::around);
    let cuts = cuts(mesh, image, &frames[0]);
    let mut seen = Seen::default();
    let boundary = seen.pack(&outside(mesh, boundary, image), &frames);
    let cuts = cuts.map(|cuts| {
        let pack =
            |(level, triangles): &(f64, Triangles)| Cut { level: *level, surface: seen.pack(triangles, &frames) };
        cuts.iter().map(pack).collect()
    });
    let single = |column: &[f64]| packed(seen.tets.iter().flat_map(|&tet| (column[tet as usize] as f32).to_le_bytes()));
    let cells = Cells {
        tet: packed(seen.tets.iter().flat_map(|tet| tet.to_le_bytes())),
        inner: single(&values.inner),
        outer: single(&values.outer),
        start: single(&values.start),
        active: packed(seen.tets.iter().map(|&tet| u8::from(values.active[tet as usize]))),
    };
    Some(Surfaces { frames, cells, boundary, cuts })
}

impl Frame {
    fn around(points: &[Vec3]) -> Self {
        let first = points.first().copied().unwrap_or_default();
        let least = points.iter().fold(first, |least, point| least.inf(point));
        let extent = points.iter().fold(first, |most, point| most.sup(point)) - least;
        Self { least: least.into(), extent: extent.into() }
    }

    fn steps(&self, point: &Vec3) -> [u16; 3] {
        [0, 1, 2].map(|axis| {
            let fraction = (point[axis] - self.least[axis]) / self.extent[axis];
            // A cast of what is beyond the range, NaN included, ends at its ends.
            (fraction * STEPS).round() as u16
        })
    }
}

/// The numbering of the tets that are seen.
#[derive(Default)]
struct Seen {
    tets: Vec<u32>,
    number: HashMap<u32, u32>,
}

impl Seen {
    fn pack(&mut self, triangles: &Triangles, frames: &[Frame; 2]) -> Surface {
        let points =
            triangles.points.iter().flat_map(|[domain, image]| [frames[0].steps(domain), frames[1].steps(image)]);
        let cells: Vec<u32> = triangles.tets.iter().map(|&tet| self.number(tet)).collect();
        Surface {
            points: packed(points.flatten().flat_map(u16::to_le_bytes)),
            triangles: packed(triangles.corners.iter().flatten().flat_map(|index| index.to_le_bytes())),
            cells: packed(cells.iter().flat_map(|cell| cell.to_le_bytes())),
        }
    }

    fn number(&mut self, tet: u32) -> u32 {
        let tets = &mut self.tets;
        *self.number.entry(tet).or_insert_with(|| {
            tets.push(tet);
            tets.len() as u32 - 1
        })
    }
}

fn packed(bytes: impl Iterator<Item = u8>) -> String {
    let bytes: Vec<u8> = bytes.collect();
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
    let packed = encoder.write_all(&bytes).and_then(|()| encoder.finish());
    STANDARD.encode(packed.expect("memory takes all that is written"))
}

fn outside(mesh: &TetMesh, boundary: &Boundary, image: &[Vec3]) -> Triangles {
    let mut surface = Triangles::default();
    let mut number = vec![u32::MAX; mesh.points().len()];
    for (triangle, owner) in boundary.triangles().iter().zip(boundary.owners()) {
        surface.corners.push(triangle.map(|vertex| {
            let vertex = vertex.index();
            if number[vertex] == u32::MAX {
                number[vertex] = surface.points.len() as u32;
                surface.points.push([mesh.points()[vertex], image[vertex]]);
            }
            number[vertex]
        }));
        surface.tets.push(owner.0);
    }
    surface
}

/// As many cuts across each axis as there is room for, evenly spaced.
fn cuts(mesh: &TetMesh, image: &[Vec3], frame: &Frame) -> [Vec<(f64, Triangles)>; 3] {
    let mut made = [0, 1, 2].map(|_| Vec::new());
    // Odd numbers, so that the middle is among them.
    for count in [15, 9, 5, 3, 1] {
        made = [0, 1, 2].map(|_| Vec::new());
        let mut bytes = 0;
        for (axis, index) in (0..3).flat_map(|axis| (1..=count).map(move |index| (axis, index))) {
            let level = frame.least[axis] + frame.extent[axis] * (index as f64) / (count + 1) as f64;
            let triangles = cut(mesh, image, axis, level);
            bytes += triangles.bytes();
            made[axis].push((level, triangles));
            if bytes > CUT_BYTES && count > 1 {
                break;
            }
        }
        if bytes <= CUT_BYTES {
            break;
        }
    }
    made
}

/// Where the plane at `level` across an axis meets the tets. What lies in the plane counts as above it, so that a layer of
/// tets which ends at the plane shows its last faces once.
fn cut(mesh: &TetMesh, image: &[Vec3], axis: usize, level: f64) -> Triangles {
    let points = mesh.points();
    let mut surface = Triangles::default();
    let mut crossings: HashMap<(u32, u32), u32> = HashMap::new();
    for (tet, corners) in mesh.tets().iter().enumerate() {
        let is_above = corners.map(|v| points[v.index()][axis] >= level);
        if is_above == [true; 4] || is_above == [false; 4] {
            continue;
        }
        let (above, below): (Vec<u32>, Vec<u32>) =
            corners.iter().map(|v| v.0).partition(|&v| points[v as usize][axis] >= level);
        let mut crossing = |(a, b): (u32, u32)| {
            *crossings.entry((a.min(b), a.max(b))).or_insert_with(|| {
                let [low, high] = [a, b].map(|v| v as usize);
                let t = (level - points[low][axis]) / (points[high][axis] - points[low][axis]);
                surface.points.push([points[low].lerp(&points[high], t), image[low].lerp(&image[high], t)]);
                surface.points.len() as u32 - 1
            })
        };
        let polygon: Vec<u32> = match (&below[..], &above[..]) {
            (&[a], &[b, c, d]) => [(a, b), (a, c), (a, d)].map(&mut crossing).to_vec(),
            (&[a, b, c], &[d]) => [(a, d), (b, d), (c, d)].map(&mut crossing).to_vec(),
            (&[a, b], &[c, d]) => [(a, c), (a, d), (b, d), (b, c)].map(&mut crossing).to_vec(),
            _ => continue,
        };
        for pair in polygon[1..].windows(2) {
            let triangle = [polygon[0], pair[0], pair[1]];
            let [a, b, c] = triangle.map(|index| surface.points[index as usize][0]);
            // Tets that touch the plane in a point or an edge show nothing.
            if (b - a).cross(&(c - a)).norm() > 0.0 {
                surface.corners.push(triangle);
                surface.tets.push(tet as u32);
            }
        }
    }
    surface
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::fixtures::{cube, fan, split};

    fn area(surface: &Triangles, side: usize) -> f64 {
        let at = |index: u32| surface.points[index as usize][side];
        surface.corners.iter().map(|&[a, b, c]| 0.5 * (at(b) - at(a)).cross(&(at(c) - at(a))).norm()).sum()
    }

    #[test]
    fn a_cut_covers_the_section_once_and_is_mapped_with_the_mesh() {
        let mesh = split(&split(&fan(&cube(), Vec3::zeros())));
        let frame = Frame::around(mesh.points());
        // A linear map is linear on every tet: sections across z are stretched by 2 * 3.
        let image: Vec<Vec3> = mesh.points().iter().map(|p| Vec3::new(2.0 * p.x, 3.0 * p.y, p.z)).collect();
        let section = frame.extent[0] * frame.extent[1];
        // Through vertices and faces of the mesh, and between them.
        for fraction in [0.25, 0.3, 0.5, 0.77] {
            let surface = cut(&mesh, &image, 2, frame.least[2] + fraction * frame.extent[2]);
            // Some hundred triangles, each exact to a few units of rounding.
            assert!((area(&surface, 0) - section).abs() < 1e-12 * section, "{fraction}");
            assert!((area(&surface, 1) - 6.0 * section).abs() < 6e-12 * section, "{fraction}");
        }
    }

    #[test]
    fn large_meshes_get_fewer_cuts_but_always_the_middle() {
        let mesh = split(&fan(&cube(), Vec3::zeros()));
        let cuts = cuts(&mesh, mesh.points(), &Frame::around(mesh.points()));
        assert!(cuts.iter().all(|cuts| cuts.len() == 15 && cuts[7].0.abs() < 1e-15));
    }
}

//! What the viewer of a page draws: a map, packed. The page cuts and colours it by itself.

use std::collections::HashMap;

use flate2::Compression;
use serde::Serialize;
use serde_json::json;

use super::page::{self, paragraph};
use crate::measure::bottleneck_places;
use crate::mesh::{Boundary, TetId, TetMesh, Vec3, VertexId};
use crate::picture::dilatation_colours;

/// Tets beyond which a page holds those at the boundary and at the middle planes alone: some 12 MB.
const MOST_TETS: usize = 400_000;
/// Triangles of a boundary beyond which a page has no viewer: some 10 MB.
const MOST_TRIANGLES: usize = 300_000;
/// Steps of a coordinate of 16 bits.
const STEPS: f64 = 65_535.0;
/// Colours of the bar of K.
const COLOURS: usize = 17;

/// A map to be viewed.
pub(super) struct Viewed<'a> {
    /// What it is called beside another; nothing if it is alone.
    pub(super) name: &'a str,
    pub(super) mesh: &'a TetMesh,
    pub(super) boundary: &'a Boundary,
    /// The image of each vertex.
    pub(super) image: &'a [Vec3],
    /// The image of each vertex under the map started from, and K of each tet there; none where it is not known.
    pub(super) start: Option<(&'a [Vec3], &'a [f64])>,
    /// K_I, K_O of each tet.
    pub(super) dilatations: [&'a [f64]; 2],
    /// Whether a tet attains the largest K.
    pub(super) active: &'a [bool],
}

/// A map in the form that the script of the page reads: arrays as base64 of zlib of little-endian numbers.
#[derive(Serialize)]
struct Packed<'a> {
    name: &'a str,
    /// The least coordinates and the extents of domain, image and, if there is one, image of the start, to which the 16 bits of
    /// a coordinate refer.
    frames: Vec<Frame>,
    /// u16: x, y and z of each vertex in each frame.
    points: String,
    /// u32: the vertices of each tet.
    tets: String,
    /// Whether these are all tets, and cuts other than through the middle therefore possible.
    whole: bool,
    /// u32: the number of each tet in the mesh; empty where these are all tets, in order.
    numbers: String,
    /// u32: the corners of each triangle of the boundary.
    triangles: String,
    /// u32: the tet of each triangle.
    owners: String,
    /// f32.
    inner: String,
    /// f32.
    outer: String,
    /// f32; empty where the start is not known.
    start: String,
    /// u8.
    active: String,
    /// Where the bottleneck is, in each frame.
    marks: Vec<Vec<[f64; 3]>>,
}

#[derive(Clone, Copy, Serialize)]
struct Frame {
    least: [f64; 3],
    extent: [f64; 3],
}

/// The controls and the place of the viewer, and the JSON of what it draws; without maps that are small enough, words instead.
pub(super) fn viewer(maps: &[Viewed]) -> (String, Option<String>) {
    if maps.iter().any(|map| map.boundary.triangles().len() > MOST_TRIANGLES) {
        let words = "The boundary is too large for a page; open domain.vtu and image.vtu in ParaView.";
        return (paragraph(words), None);
    }
    let maps: Vec<Packed> = maps.iter().map(|map| packed_map(map, MOST_TETS)).collect();
    (
        include_str!("viewer.html").into(),
        Some(json!({ "maps": maps, "colours": dilatation_colours(COLOURS) }).to_string()),
    )
}

fn packed_map<'a>(map: &Viewed<'a>, most_tets: usize) -> Packed<'a> {
    let mesh = map.mesh;
    let sides: Vec<&[Vec3]> = [mesh.points(), map.image].into_iter().chain(map.start.map(|(start, _)| start)).collect();
    let frames: Vec<Frame> = sides.iter().map(|points| Frame::around(points)).collect();
    let whole = mesh.tets().len() <= most_tets;
    let kept: Vec<TetId> = if whole { all(mesh).collect() } else { seen(mesh, map.boundary, &frames[0]) };
    let mut numbers = Numbers::default();
    let tets: Vec<u32> = kept.iter().flat_map(|tet| mesh.tets()[tet.index()]).map(|v| numbers.of(v)).collect();
    let position: HashMap<u32, u32> = kept.iter().zip(0..).map(|(tet, at)| (tet.0, at)).collect();
    let triangles: Vec<u32> = map.boundary.triangles().iter().flatten().map(|&v| numbers.of(v)).collect();
    let owners: Vec<u32> = map.boundary.owners().iter().map(|owner| position[&owner.0]).collect();
    let points = numbers.vertices.iter().flat_map(|v| {
        let steps = sides.iter().zip(&frames).flat_map(|(points, frame)| frame.steps(&points[v.index()]));
        steps.collect::<Vec<u16>>()
    });
    let points: Vec<u16> = points.collect();
    let singles = |column: &[f64]| packed(kept.iter().flat_map(|tet| (column[tet.index()] as f32).to_le_bytes()));
    let integers = |numbers: &[u32]| packed(numbers.iter().flat_map(|number| number.to_le_bytes()));
    Packed {
        name: map.name,
        points: packed(points.iter().flat_map(|step| step.to_le_bytes())),
        tets: integers(&tets),
        whole,
        numbers: if whole { String::new() } else { integers(&kept.iter().map(|tet| tet.0).collect::<Vec<u32>>()) },
        triangles: integers(&triangles),
        owners: integers(&owners),
        inner: singles(map.dilatations[0]),
        outer: singles(map.dilatations[1]),
        start: map.start.map(|(_, k)| singles(k)).unwrap_or_default(),
        active: packed(kept.iter().map(|tet| u8::from(map.active[tet.index()]))),
        marks: marks(map, &sides),
        frames,
    }
}

fn all(mesh: &TetMesh) -> impl Iterator<Item = TetId> {
    (0..mesh.tets().len() as u32).map(TetId)
}

/// The tets at the boundary, and those that the middle planes of the bounding box meet.
fn seen(mesh: &TetMesh, boundary: &Boundary, frame: &Frame) -> Vec<TetId> {
    let mut shown = vec![false; mesh.tets().len()];
    boundary.owners().iter().for_each(|owner| shown[owner.index()] = true);
    let meets = |tet: TetId| {
        let corners = mesh.corners(tet);
        (0..3).any(|axis| {
            let middle = frame.least[axis] + 0.5 * frame.extent[axis];
            // Coordinates are rounded to steps: what touches the plane may be across it.
            let room = frame.extent[axis] / STEPS;
            corners.iter().any(|p| p[axis] <= middle + room) && corners.iter().any(|p| p[axis] >= middle - room)
        })
    };
    all(mesh).filter(|&tet| shown[tet.index()] || meets(tet)).collect()
}

/// Where the bottleneck is marked, in each frame: at the middle of each of its places, or of the worst tet if it is inside.
fn marks(map: &Viewed, sides: &[&[Vec3]]) -> Vec<Vec<[f64; 3]>> {
    let active: Vec<TetId> = all(map.mesh).filter(|tet| map.active[tet.index()]).collect();
    let places = bottleneck_places(map.mesh, map.boundary, &active);
    let mut corners: Vec<Vec<VertexId>> =
        places.iter().map(|place| place.vertices().iter().map(|&v| VertexId(v)).collect()).collect();
    if corners.is_empty() {
        corners.extend(active.first().map(|tet| map.mesh.tets()[tet.index()].to_vec()));
    }
    let middle = |points: &[Vec3], place: &[VertexId]| -> [f64; 3] {
        (place.iter().map(|v| points[v.index()]).sum::<Vec3>() / place.len() as f64).into()
    };
    corners.iter().map(|place| sides.iter().map(|points| middle(points, place)).collect()).collect()
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

/// The numbering of the vertices that are used, by first use.
#[derive(Default)]
struct Numbers {
    vertices: Vec<VertexId>,
    number: HashMap<u32, u32>,
}

impl Numbers {
    fn of(&mut self, vertex: VertexId) -> u32 {
        let vertices = &mut self.vertices;
        *self.number.entry(vertex.0).or_insert_with(|| {
            vertices.push(vertex);
            vertices.len() as u32 - 1
        })
    }
}

fn packed(bytes: impl Iterator<Item = u8>) -> String {
    page::packed(bytes, Compression::fast())
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use base64::Engine;
    use base64::engine::general_purpose::STANDARD;
    use flate2::read::ZlibDecoder;

    use super::*;
    use crate::mesh::fixtures::{cube, fan, split};

    fn integers(text: &str) -> Vec<u32> {
        let mut bytes = Vec::new();
        ZlibDecoder::new(&STANDARD.decode(text).unwrap()[..]).read_to_end(&mut bytes).unwrap();
        bytes.chunks_exact(4).map(|four| u32::from_le_bytes(four.try_into().unwrap())).collect()
    }

    #[test]
    fn a_mesh_that_is_too_large_keeps_its_boundary_and_its_middle() {
        let mesh = (0..3).fold(fan(&cube(), Vec3::zeros()), |mesh, _| split(&mesh));
        let boundary = Boundary::of(&mesh).unwrap();
        let ones = vec![1.0; mesh.tets().len()];
        let active = vec![true; mesh.tets().len()];
        let map = Viewed {
            name: "",
            mesh: &mesh,
            boundary: &boundary,
            image: mesh.points(),
            start: None,
            dilatations: [&ones, &ones],
            active: &active,
        };
        let [whole, part] = [mesh.tets().len(), mesh.tets().len() - 1].map(|most| packed_map(&map, most));
        assert!(whole.whole && integers(&whole.tets).len() == 4 * mesh.tets().len());
        let numbers = integers(&part.numbers);
        assert!(whole.numbers.is_empty() && !part.whole && !numbers.is_empty() && numbers.len() < mesh.tets().len());
        // Every triangle's tet is there, and has its corners.
        let [tets, triangles, owners] = [&part.tets, &part.triangles, &part.owners].map(|text| integers(text));
        for (triangle, &owner) in triangles.chunks_exact(3).zip(&owners) {
            let tet = &tets[4 * owner as usize..][..4];
            assert!(triangle.iter().all(|corner| tet.contains(corner)));
        }
        // All eight corners of the cube are marked, where they are.
        assert_eq!(whole.marks.len(), 8);
        assert!(whole.marks.iter().all(|mark| mark[0] == mark[1] && mark[0].iter().all(|x| x.abs() == 1.0)));
    }
}

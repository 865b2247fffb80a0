//! FreeSurfer's binary surfaces of triangles, such as `lh.pial`: a mark, two lines that say who made the file, counts, coordinates in
//! single precision and vertex numbers, all big-endian. Their names have no ending of their own, so that the mark tells them.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::cells::{Cells, Contents, Shape};
use super::numbers::{Encoding, Kind};
use super::tokens::{Fault, Tokens};

/// The first three bytes of a file of triangles; others, for files of quadrilaterals, are older than 2000.
const TRIANGLES: [u8; 3] = [0xFF, 0xFF, 0xFE];

/// Whether a file starts with the mark.
pub(super) fn has_mark(path: &Path) -> bool {
    let mut mark = [0; 3];
    File::open(path).and_then(|mut file| file.read_exact(&mut mark)).is_ok() && mark == TRIANGLES
}

/// Reads the points and the triangles; what follows (the volume they were made from, commands) is passed over.
pub(super) fn parse(bytes: &[u8]) -> Result<Contents, Fault> {
    let rest = bytes.strip_prefix(&TRIANGLES).ok_or_else(|| (None, "the mark FF FF FE is not there".to_owned()))?;
    // "created by ... on ...", then a line that is empty or says something else.
    let lines = rest.iter().enumerate().filter(|(_, byte)| **byte == b'\n').map(|(at, _)| at);
    let start = lines.take(2).nth(1).ok_or_else(|| (None, "the two lines of text do not end".to_owned()))? + 1;
    let mut tokens = Tokens::new(&rest[start..]);
    let mut read = |kind: Kind, count, what: &str| {
        // Lines mean nothing in what is binary.
        kind.read(&mut tokens, Encoding::BigEndian, count, what).map_err(|(_, message)| (None, message))
    };
    let counts = read(Kind::UInt32, 2, "the header")?.into_integers();
    let [points, triangles] = counts.as_deref().and_then(|counts| counts.try_into().ok()).unwrap_or([0; 2]);
    let coordinates = read(Kind::Float32, 3 * points as u64, "the list of points")?.into_floats();
    let corners =
        read(Kind::UInt32, 3 * triangles as u64, "the list of triangles")?.into_integers().unwrap_or_default();
    let mut cells = Cells::default();
    corners.chunks_exact(3).for_each(|triangle| cells.push(Shape::Polygon(3), triangle));
    cells.finish(coordinates, Vec::new())
}

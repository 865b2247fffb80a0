//! What several commands take: numbers, maps of two files, and files that must not be written over.

use std::path::{Path, PathBuf};

use super::Failure;
use super::output::note;
use crate::experiment::GivenMap;
use crate::mesh::io::shown_path;
use crate::optimize::flipped_tets;

/// Parses a positive number below 1e9.
pub(super) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value < 1e9 => Ok(value),
        _ => Err("give a positive number below 1e9".into()),
    }
}

/// Reads a map from its two files, and tells if the first one's tets had to be turned.
pub(super) fn read_map(rest: &Path, image: &Path) -> Result<GivenMap, Failure> {
    let map = GivenMap::read(rest, image)?;
    tell(rest, &map.notes);
    if map.exchanged > 0 {
        note(&format!(
            "{} of {} tets of {} were stored with negative orientation; two vertices of each were exchanged",
            map.exchanged,
            map.domain.mesh().tets().len(),
            shown_path(rest)
        ));
    }
    Ok(map)
}

/// Tells of a map that is mirrored, if this one looks so.
pub(super) fn tell_of_mirror(map: &GivenMap, image: &Path) {
    let tets = map.domain.mesh().tets().len();
    let flipped = flipped_tets(&map.domain, &map.image).len();
    if flipped as f64 > MIRRORED * tets as f64 {
        note(&format!(
            "{flipped} of {tets} tets are turned over by this map: {image} looks like a mirror image, and no moving of vertices mends that; \
             reflect it, which keeps every K: qcball map affine \"matrix=[[-1, 0, 0], [0, 1, 0], [0, 0, 1]]\" {image} OUT",
            image = shown_path(image)
        ));
    }
}

/// The share of flipped tets beyond which a map passes for one that is mirrored: of random positions half are.
const MIRRORED: f64 = 0.9;

/// Tells what reading did to a file.
pub(super) fn tell(path: &Path, notes: &[String]) {
    notes.iter().for_each(|text| note(&format!("{}: {text}", shown_path(path))));
}

/// Fails if an output is one of the inputs.
pub(super) fn refuse_to_write_over<'a>(
    inputs: impl IntoIterator<Item = &'a PathBuf>,
    outputs: impl IntoIterator<Item = &'a PathBuf> + Clone,
) -> Result<(), Failure> {
    // What does not exist yet is no input.
    let same = |a: &Path, b: &Path| matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b);
    let hit = inputs.into_iter().find(|input| outputs.clone().into_iter().any(|output| same(input, output)));
    hit.map_or(Ok(()), |input| Err(Failure::OverInput { path: input.clone() }))
}

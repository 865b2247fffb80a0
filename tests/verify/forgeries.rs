//! Whole folders that are presented as the results of another config.

use std::fs;
use std::path::Path;

use super::folder::{copy, forge, is_refused, qcball, report, results};

/// Presents a run as that of another config: everything that names the run is taken from the honest one.
fn presented_as(forged: &Path, honest: &Path) {
    let honest = report(honest);
    forge(forged, |report| {
        report.config_text.clone_from(&honest.config_text);
        report.config_hash.clone_from(&honest.config_hash);
        report.overrides.clone_from(&honest.overrides);
        report.name.clone_from(&honest.name);
        report.map.clone_from(&honest.map);
        report.domain.solid.clone_from(&honest.domain.solid);
        report.domain.centre = honest.domain.centre;
        report.domain.kernel_radius = honest.domain.kernel_radius;
        report.domain.smallest_angle = honest.domain.smallest_angle;
    });
}

#[test]
fn another_map_or_solid_is_not_taken_for_the_configs() {
    let honest = results(&[]);
    let identity = ["map.kind=affine", "map.matrix=[[1, 0, 0], [0, 1, 0], [0, 0, 1]]"];
    for (what, overrides, word) in [
        ("the identity as the radial map", &identity[..], "boundary vertex 79 of image.vtu is not at its place"),
        ("a box as the cube", &["domain.solid=box", "domain.size=[1, 1, 2]"], "domain.vtu is not"),
        ("an octahedron as the cube", &["domain.solid=octahedron"], "domain.vtu is not"),
        ("another exponent", &["map.exponent=1.5"], "the start is not at its place"),
    ] {
        let forged = results(overrides);
        let (code, text) = qcball(&["verify"], forged.path());
        assert_eq!(code, Some(0), "{what}, as what it is: {text}");
        presented_as(forged.path(), honest.path());
        is_refused(what, forged.path(), word);
    }
}

#[test]
fn a_domain_from_a_file_is_held_against_the_file_and_trusted_without_it() {
    let place = tempfile::tempdir().unwrap();
    let at = |name: &str| place.path().join(name);
    let surface = "v 1 0 0\nv -1 0 0\nv 0 1 0\nv 0 -1 0\nv 0 0 1\nv 0 0 -1\nf 1 3 5\nf 3 2 5\nf 2 4 5\nf 4 1 5\n\
                   f 3 1 6\nf 2 3 6\nf 4 2 6\nf 1 4 6\n";
    fs::write(at("solid.obj"), surface).unwrap();
    fs::write(at("a.toml"), "[domain]\nfile = \"solid.obj\"\n[mesh]\nlayers = 2\nsubdivisions = 1\n").unwrap();
    let out = at("out");
    let config = at("a.toml");
    let arguments = ["run", config.to_str().unwrap(), "--quiet", "--threads", "1", "--out"];
    assert_eq!(qcball(&arguments, &out).0, Some(0));
    let (code, text) = qcball(&["verify"], &out);
    assert!(code == Some(0) && !text.contains("which is not here"), "{text}");
    // Another solid in the file's place, and none.
    fs::write(at("solid.obj"), surface.replace("v 1 0 0", "v 1.25 0 0")).unwrap();
    is_refused("another file", copy(&out).path(), "input_hash is reported");
    fs::remove_file(at("solid.obj")).unwrap();
    let (code, text) = qcball(&["verify"], &out);
    assert!(code == Some(0) && text.contains("solid.obj, which is not here (blake3 "), "{text}");
}

use super::*;
use crate::config::ConfigSource;

#[test]
fn a_radial_start_has_a_spherical_one_in_reserve_if_the_map_was_left_open() {
    let start = |map: &str| {
        let text = format!("[domain]\nsolid = \"octahedron\"\n[mesh]\nlayers = 2\nsubdivisions = 2\n{map}");
        let (source, config) = ConfigSource::of_text(Path::new("a.toml"), text, &[]).unwrap();
        Start::of(&Plan::of_source(&source, &config).unwrap()).unwrap()
    };
    let radial = start("");
    let spherical = radial.in_spherical().expect("an octahedron has no handles");
    assert!(spherical.centre.is_none() && spherical.second.is_some() && spherical.in_spherical().is_none());
    assert_eq!((spherical.warnings.len(), spherical.map.map.as_str()), (radial.warnings.len() + 1, Start::FIRST));
    let on_sphere = spherical.image.iter().zip(spherical.domain.boundary().vertex_mask()).filter(|(_, on)| **on);
    assert!(on_sphere.into_iter().all(|(p, _)| (p.norm() - 1.0).abs() < 1e-15));
    // What a report says of the map tells which of the two it began with.
    assert_eq!(radial.clone().told_by(Start::FIRST).image, spherical.image);
    assert_eq!(Some(radial.clone().told_by(Start::SECOND).image), spherical.second);
    assert_eq!(radial.clone().told_by(&radial.map.map).image, radial.image);
    assert!(start("[map]\nkind = \"radial\"").in_spherical().is_none());
}

#[test]
fn a_start_on_a_mesh_that_may_change_has_one_over_a_collar_in_reserve() {
    let folder = tempfile::tempdir().unwrap();
    let cube = crate::mesh::fixtures::fan(&crate::mesh::fixtures::cube(), Vec3::zeros());
    let path = folder.path().join("cube.mesh");
    crate::mesh::io::write_tets(&path, cube.points(), cube.tets(), &Vec::new()).unwrap();
    let start = |keys: &str| {
        let text = format!("[domain]\nfile = {path:?}\n{keys}");
        let (source, config) = ConfigSource::of_text(Path::new("a.toml"), text, &[]).unwrap();
        Start::of(&Plan::of_source(&source, &config).unwrap()).unwrap()
    };
    let radial = start("");
    let over_collar = radial.in_spherical().and_then(|spherical| spherical.over_collar()).expect("a cube is a ball");
    // The one vertex inside is the apex over all 12 faces; each split halves an edge to it, up to twice as many tets.
    let splits = over_collar.splits.unwrap();
    assert!(splits.collar > 0 && splits.tets_before == 12);
    assert!((13..=24).contains(&over_collar.domain.mesh().tets().len()));
    assert!(over_collar.over_collar().is_none() && over_collar.centre.is_none());
    let on_sphere = over_collar.image.iter().zip(over_collar.domain.boundary().vertex_mask()).filter(|(_, on)| **on);
    assert!(on_sphere.into_iter().all(|(p, _)| (p.norm() - 1.0).abs() < 1e-15));
    // What a report says of the map tells how it began.
    let told = radial.clone().told_by(&over_collar.map.map);
    assert_eq!((told.image, told.domain.mesh().tets()), (over_collar.image.clone(), over_collar.domain.mesh().tets()));
    let second = over_collar.map.map.replace(Start::FIRST, Start::SECOND);
    assert_eq!(Some(radial.told_by(&second).image), over_collar.second);
    for keys in [
        "keep_mesh = true",
        "[boundary]\ncollar = 1",
        "[map]\nkind = \"radial\"",
        "[map]\nkind = \"spherical\"\narea_weight = 1",
    ] {
        assert!(start(keys).over_collar().is_none(), "{keys}");
    }
    assert!(start("[map]\nkind = \"spherical\"").over_collar().is_some());
}

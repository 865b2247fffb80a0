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

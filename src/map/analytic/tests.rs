use std::f64::consts::{FRAC_PI_2, PI};

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};

use super::*;
use crate::linalg::svd;
use crate::solid::Solid;

const POINTS: usize = 10_000;

fn map(text: &str) -> AnalyticMap {
    let map: AnalyticMap = toml::from_str(text).unwrap();
    map.check().unwrap();
    map
}

fn caraman(solid: &Solid, centre: Vec3, exponent: f64) -> AnalyticMap {
    AnalyticMap::Caraman(Caraman::new(&solid.surface().unwrap(), centre, exponent).unwrap())
}

/// Every map, with several parameters; each is defined somewhere in [-1, 1]^3.
fn maps() -> Vec<AnalyticMap> {
    let mut maps: Vec<AnalyticMap> = [
        "kind = 'affine'\nmatrix = [[1, 2, 0], [0, 3, -1], [0.5, 0, 2]]\noffset = [1, -2, 3]",
        "kind = 'affine'\nmatrix = [[1, 0, 0], [0, 1, 0], [0, 0, -2.5]]",
        "kind = 'folding'\nratio = 0.5",
        "kind = 'folding'\nratio = 1.5",
        "kind = 'folding'\nratio = 2",
        "kind = 'cone'\nratio = 0.4\nangle = 2.5",
        "kind = 'cone'\nratio = 1.0",
        "kind = 'cone'\nratio = 2.0\nangle = 1.2",
        "kind = 'power'\nexponent = 1.5",
        "kind = 'power'\nexponent = 0.3",
        "kind = 'power'\nexponent = -1",
        "kind = 'power'\nexponent = -2.5",
        "kind = 'zorich1'\nhalf_side = 0.9",
        "kind = 'zorich2'\nhalf_side = 1.1",
        "kind = 'zorich'\nhalf_side = 0.7",
        "kind = 'zorich'\nhalf_side = 1.3",
    ]
    .map(map)
    .into();
    maps.push(caraman(&Solid::Cube, Vec3::zeros(), 1.0));
    maps.push(caraman(&Solid::Octahedron, Vec3::new(0.1, -0.05, 0.2), 0.6));
    maps.push(caraman(&Solid::Tetrahedron, Vec3::zeros(), 2.0));
    maps
}

/// Points of the map's domain of validity in [-1, 1]^3, none of them at less than 0.1 from the z-axis.
fn points(map: &AnalyticMap, count: usize) -> Vec<Vec3> {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let mut next = || (random.next_u64() >> 11) as f64 * 2f64.powi(-52) - 1.0;
    let candidates = std::iter::repeat_with(|| Vec3::new(next(), next(), next()));
    candidates.filter(|x| x.x.hypot(x.y) > 0.1 && map.value(x).is_ok()).take(count).collect()
}

#[test]
fn closed_dilatations_are_those_of_the_jacobian_and_below_their_supremum() {
    for map in maps() {
        let most = map.max_dilatation().unwrap();
        for x in points(&map, POINTS) {
            let [s1, s2, s3] = svd(&map.jacobian(&x).unwrap()).values.map(f64::abs);
            let closed = map.dilatation(&x).unwrap();
            // Entries of the Jacobian round at a few eps of s1, K at a few eps of s1 / s3 < 40: below 1e-13.
            for (value, exact) in [(s1 * s2 / (s3 * s3), closed.inner), (s1 * s1 / (s2 * s3), closed.outer)] {
                assert!((value - exact).abs() <= 1e-12 * exact, "{map:?} at {x:?}: {value} {exact}");
            }
            assert!(
                closed.inner <= most.inner * (1.0 + 1e-13) && closed.outer <= most.outer * (1.0 + 1e-13),
                "{map:?}"
            );
        }
    }
}

#[test]
fn jacobians_are_those_of_central_differences() {
    // Truncation is step^2 / 6 times third derivatives, which are below 1e3 |J| at 0.1 from the axis, and rounding
    // eps |f| / step: together below 4e-8 |J| here.
    let step = 6e-6;
    for map in maps() {
        let mut skipped = 0;
        for x in points(&map, POINTS) {
            let jacobian = map.jacobian(&x).unwrap();
            for axis in 0..3 {
                let at = |sign: f64| {
                    let y = x + sign * step * Vec3::ith(axis, 1.0);
                    Some((map.value(&y).ok()?, map.jacobian(&y).ok()?))
                };
                let (Some((after, right)), Some((before, left))) = (at(1.0), at(-1.0)) else {
                    skipped += 1;
                    continue;
                };
                // Across a surface where the formula changes there is no derivative to compare with.
                if (right - left).norm() > 1e-2 * jacobian.norm() {
                    skipped += 1;
                    continue;
                }
                let difference = (after - before) / (2.0 * step);
                let error = (difference - jacobian.column(axis)).norm();
                assert!(error <= 4e-8 * jacobian.norm(), "{map:?} at {x:?}: {error}");
            }
        }
        assert!(skipped <= 3 * POINTS / 100, "{map:?}: {skipped}");
    }
}

#[test]
fn suprema_are_the_published_ones() {
    let most = |text: &str| map(text).max_dilatation().unwrap();
    let close = |got: Dilatation, inner: f64, outer: f64| {
        assert!((got.inner - inner).abs() < 1e-13 * inner && (got.outer - outer).abs() < 1e-13 * outer, "{got:?}");
    };
    // Paper §2.3 and Table 2.
    close(most("kind = 'folding'\nratio = 2"), 2.0, 4.0);
    close(most("kind = 'folding'\nratio = 1.5"), 1.5, 2.25);
    close(most("kind = 'folding'\nratio = 0.5"), 4.0, 2.0);
    close(most("kind = 'power'\nexponent = 1.5"), 1.5, 2.25);
    close(most("kind = 'power'\nexponent = 0.5"), 4.0, 2.0);
    close(most("kind = 'power'\nexponent = -1"), 1.0, 1.0);
    close(most("kind = 'power'\nexponent = -2"), 2.0, 4.0);
    let golden = 0.5 * (1.0 + 5f64.sqrt());
    close(most("kind = 'zorich1'\nhalf_side = 3"), 2f64.sqrt() * golden.powi(3), golden.powi(3) / 2f64.sqrt());
    close(most("kind = 'zorich2'\nhalf_side = 3"), PI * PI / 4.0, PI * PI / 4.0);
    // A half-space onto a cone: stretches 1, 1/2, 1/2 on the axis (K_O = 4), 1, sin(pi/4), 1/2 at the mantle (K_I = 2 sqrt 2).
    close(most("kind = 'cone'\nratio = 0.5\nangle = 1.5707963267948966"), 8f64.sqrt(), 4.0);
    // On all of space it has no bound.
    assert_eq!(most("kind = 'cone'\nratio = 0.5").k(), f64::INFINITY);
    assert_eq!(most("kind = 'cone'\nratio = 3").k(), f64::INFINITY);
    // The radial map of the cube, in closed form.
    let cube = caraman(&Solid::Cube, Vec3::zeros(), 1.0).max_dilatation().unwrap();
    let sigma: f64 = 0.5 * (2f64.sqrt() + 6f64.sqrt());
    close(cube, sigma.powi(3), sigma.powi(3));
}

#[test]
fn images_are_where_they_should_be() {
    let at = |text: &str, x: [f64; 3]| map(text).value(&x.into()).unwrap();
    let near = |x: Vec3, y: [f64; 3]| assert!((x - Vec3::from(y)).norm() < 1e-15, "{x:?} {y:?}");
    near(at("kind = 'folding'\nratio = 2", [0.0, 2.0, 5.0]), [-2.0, 0.0, 5.0]);
    near(at("kind = 'cone'\nratio = 2", [1.0, 0.0, 1.0]), [2f64.sqrt(), 0.0, 0.0]);
    near(at("kind = 'power'\nexponent = -1", [0.0, 2.0, 0.0]), [0.0, 0.5, 0.0]);
    // The square's boundary onto the circle, this onto the plane.
    near(at("kind = 'zorich1'\nhalf_side = 1", [1.0, 1.0, 3.0]), [0.5f64.sqrt(), 0.5f64.sqrt(), 3.0]);
    near(at("kind = 'zorich'\nhalf_side = 1", [1.0, 0.5, 0.0]), [0.8f64.sqrt(), 0.2f64.sqrt(), 0.0]);
    near(at("kind = 'zorich'\nhalf_side = 2", [0.0, 0.0, 2.0]), [0.0, 0.0, 1f64.exp()]);
    near(caraman(&Solid::Cube, Vec3::zeros(), 2.0).value(&Vec3::new(0.5, 0.0, 0.0)).unwrap(), [0.25, 0.0, 0.0]);
}

#[test]
fn a_map_and_its_inverse_compose_to_the_identity() {
    let both = map("kind = 'composition'\nmaps = [{kind = 'folding', ratio = 0.5}, {kind = 'power', exponent = 3}, \
         {kind = 'power', exponent = 0.3333333333333333}, {kind = 'folding', ratio = 2}]");
    assert_eq!(both.max_dilatation(), None);
    for x in points(&both, 1000) {
        assert!((both.value(&x).unwrap() - x).norm() < 1e-14);
        // The factors have condition 3 at most.
        assert!((both.jacobian(&x).unwrap() - Mat3::identity()).norm() < 1e-13);
        assert!(both.dilatation(&x).unwrap().k() < 1.0 + 1e-12);
    }
}

#[test]
fn points_outside_and_wrong_parameters_are_errors_that_say_so() {
    let refused = |text: &str, x: [f64; 3], part: &str| {
        let message = map(text).value(&x.into()).unwrap_err().to_string();
        assert!(message.contains(part), "{message}");
    };
    refused("kind = 'folding'\nratio = 2", [1.0, -1.0, 0.0], "turn the mesh about the z-axis");
    refused("kind = 'cone'\nratio = 2", [1.0, 0.0, -1.0], "above the cone's 1.570796");
    refused("kind = 'power'\nexponent = -1", [0.0; 3], "goes to infinity");
    refused("kind = 'power'\nexponent = 90", [0.0, 1e9, 0.0], "too large");
    refused("kind = 'zorich'\nhalf_side = 1", [1.1, 0.0, 0.0], "the zorich map");
    refused("kind = 'zorich2'\nhalf_side = 1", [0.9, 0.9, 0.0], "distance from the z-axis");
    let outside = caraman(&Solid::Cube, Vec3::zeros(), 1.0).value(&Vec3::new(0.0, 1.1, 0.0)).unwrap_err();
    assert!(outside.to_string().contains("outside of the solid"));

    let words = |name: &str, words: &[&str]| {
        let words: Vec<String> = words.iter().map(|word| (*word).to_owned()).collect();
        AnalyticMap::from_words(name, &words)
    };
    let zorich = AnalyticMap::Zorich(Zorich { half_side: 2.0 });
    assert_eq!(words("zorich", &["half_side=2"]), Ok(zorich));
    for (name, given, part) in [
        ("folding", vec!["ratio=0"], "ratio is 0, but it must be a positive number"),
        ("folding", vec!["ratio"], "write it as key=value"),
        ("folding", vec!["ratio=abc"], "is no number"),
        ("folding", vec!["ratio=1", "ratio=2"], "given twice"),
        ("folding", vec!["angle=1"], "unknown field `angle`"),
        ("folding", vec![], "`ratio` is missing; write for example ratio=1.5"),
        ("fold", vec!["ratio=1"], "there is no map `fold`; there are affine, folding, "),
        ("cone", vec!["ratio=2", "angle=1.6"], "at most pi and pi / ratio"),
        ("power", vec!["exponent=0"], "other than 0"),
        ("affine", vec!["matrix=[[1, 0, 0], [0, 1, 0], [1, 1, 0]]"], "determinant"),
    ] {
        let message = words(name, &given).unwrap_err().to_string();
        assert!(message.contains(part), "{message}");
    }
    // The half-space of a Zorich map ends at its boundary plane.
    assert!(
        map("kind = 'zorich2'\nhalf_side = 1").value(&Vec3::new(1.0, 0.0, 0.0)).unwrap().z.abs() < FRAC_PI_2 * 1e-15
    );
}

//! No bound exceeds the dilatation of any positively oriented map that was tried: random meshes, boundaries and maps.
//!
//! 60 seeded cases of thick tets, 1000 with powers at corners and 300 of thin ones; `QCBALL_PROPERTY_CASES=10000 cargo test --release --test bounds_property` tries
//! as many as it says of each. Case i has the seed i.

use std::time::Duration;

use qcball::bound::{self, BoundName, Kind, LowerBound};
use qcball::map::Corners;
use qcball::measure::{Summary, measure_elements};
use qcball::mesh::{TetId, TetMesh, Vec3, VertexId};
use qcball::optimize::Polish;
use qcball::{
    Cancel, Domain, OptimizeSettings, RadialCoordinates, ShellSettings, Solid, caraman, measure, optimize, shell_mesh,
};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};

struct Random(ChaCha8Rng);

impl Random {
    /// In [-1, 1).
    fn number(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * 2f64.powi(-52) - 1.0
    }

    fn vector(&mut self) -> Vec3 {
        Vec3::from_fn(|_, _| self.number())
    }

    /// The points, those wanted moved by `scale` at most along each axis, or less until `is_good`.
    fn moved(
        &mut self,
        points: &[Vec3],
        mut scale: f64,
        wanted: impl Fn(usize) -> bool,
        is_good: impl Fn(&[Vec3]) -> bool,
    ) -> Vec<Vec3> {
        let noise: Vec<Vec3> = points.iter().map(|_| self.vector()).collect();
        loop {
            let moved: Vec<Vec3> =
                (0..points.len()).map(|v| if wanted(v) { points[v] + noise[v] * scale } else { points[v] }).collect();
            if scale < 1e-6 || is_good(&moved) {
                return moved;
            }
            scale *= 0.7;
        }
    }
}

/// A small mesh of a convex solid, or of one with every boundary vertex moved, and its radial map.
fn random_mesh(random: &mut Random) -> (Domain, Vec<Vec3>) {
    let height = 1.0 + 0.5 * random.number();
    let sides = 3 + random.0.next_u32() % 2;
    let solid = match random.0.next_u32() % 6 {
        0 => Solid::Tetrahedron,
        1 => Solid::Cube,
        2 => Solid::Octahedron,
        3 => Solid::Prism { sides, height },
        4 => Solid::Pyramid { sides, height },
        _ => Solid::Box { size: [1.0, height, 1.0 + 0.6 * random.number()] },
    };
    let layers = 1 + random.0.next_u32() % 2;
    let settings = ShellSettings { subdivisions: 1, refinement: None, layers, grading: 1.0 };
    let shell = shell_mesh(&solid.surface().unwrap(), Vec3::zeros(), &settings).unwrap();
    let radial = caraman(&RadialCoordinates::of_shell(&shell), 1.0);
    let boundary: Vec<bool> = Domain::new(shell.mesh.clone()).unwrap().boundary().vertex_mask().to_vec();
    let convex = random.number() < 0.0;
    let tets = shell.mesh.tets().to_vec();
    let points = random.moved(
        shell.mesh.points(),
        0.5,
        |v| !convex || !boundary[v],
        |points| TetMesh::new(points.to_vec(), tets.clone()).is_ok(),
    );
    let mesh = TetMesh::new(points, tets).unwrap_or(shell.mesh);
    (Domain::new(mesh).unwrap(), radial)
}

/// How many cases to try: what QCBALL_PROPERTY_CASES says, or `few`.
fn cases(few: u64) -> u64 {
    std::env::var("QCBALL_PROPERTY_CASES").ok().and_then(|n| n.parse().ok()).unwrap_or(few)
}

fn achieved(map: &Summary, kind: Kind) -> f64 {
    match kind {
        Kind::Inner => map.max_k_inner,
        Kind::Outer => map.max_k_outer,
        Kind::K => map.max_k,
    }
}

fn check(bounds: &[LowerBound], domain: &Domain, image: &[Vec3], case: u64) -> f64 {
    check_measured(bounds, &measure(domain, image).summary, case)
}

fn check_measured(bounds: &[LowerBound], map: &Summary, case: u64) -> f64 {
    assert_eq!(map.flipped, 0, "case {case}");
    for bound in bounds.iter().filter(|bound| bound.applies && bound.certified) {
        let achieved = achieved(map, bound.kind);
        // What the measured K may be off by: 1e-16 times conditions that stay below 1e5 here.
        assert!(bound.value <= achieved * (1.0 + 1e-10), "case {case}: {achieved} is below {bound:?}");
    }
    map.max_k
}

/// A random mesh with a map of it, onto the ball or onto the mesh itself, boundary values moved or not, by one of these amounts; none
/// if tets are flipped.
fn random_start(random: &mut Random, amounts: [f64; 3]) -> Option<(Domain, Vec<Vec3>)> {
    let (domain, radial) = random_mesh(random);
    let positive = |image: &[Vec3]| measure(&domain, image).summary.flipped == 0;
    let onto_ball = positive(&radial) && random.number() < 0.0;
    let start = if onto_ball { radial } else { domain.mesh().points().to_vec() };
    let amount = amounts[random.0.next_u32() as usize % 3];
    let start = random.moved(&start, amount, |_| true, positive);
    positive(&start).then_some((domain, start))
}

#[test]
fn no_bound_exceeds_a_random_or_an_optimized_map() {
    let cases = cases(60);
    let (mut maps, mut within, mut certified) = (0, 0, 0);
    let mut gaps = Vec::new();
    for case in 0..cases {
        let mut random = Random(ChaCha8Rng::seed_from_u64(case));
        let Some((domain, start)) = random_start(&mut random, [0.0, 0.1, 0.6]) else { continue };
        let positive = |image: &[Vec3]| measure(&domain, image).summary.flipped == 0;
        let fixed = domain.boundary().vertex_mask();
        let mut bounds = bound::all(&domain, &start, None, false);
        if case % 4 == 0 {
            // The limit only keeps a hard case from taking long: whatever is found has to hold.
            let found = bound::certificate::search(&domain, &start, &Cancel::default().within(Duration::from_secs(2)));
            bounds.extend(found.and_then(|found| bound::certificate::bound(&found, &domain, &start).ok()));
        }
        certified += bounds.iter().filter(|bound| bound.name == BoundName::Gram).count();
        check(&bounds, &domain, &start, case);
        for scale in [0.05, 0.3, 0.8] {
            let image = random.moved(&start, scale, |v| !fixed[v], positive);
            if positive(&image) {
                check(&bounds, &domain, &image, case);
                maps += 1;
            }
        }
        let settings = OptimizeSettings { polish: Polish::None, max_iterations: 40, ..OptimizeSettings::default() };
        let outcome = optimize(&domain, &start, fixed, &settings, &mut |_| {}).unwrap();
        let max_k = check(&bounds, &domain, &outcome.positions, case);
        maps += 2;
        let best = bound::best_applicable(&bounds).map_or(1.0, |best| best.value);
        within += usize::from(max_k / best < 1.0 + 1e-5);
        gaps.push(max_k / best);
    }
    gaps.sort_unstable_by(f64::total_cmp);
    let median = gaps[gaps.len() / 2];
    println!(
        "{cases} cases, {maps} maps, median gap {median:.4}, {certified} certificates, {within} proved optimal to 1e-5"
    );
    // Vacuous without maps, and blunt without some that come close.
    assert!(maps as u64 > 3 * cases && within > 0, "{maps} maps, {within} within 1e-5 of a bound");
    assert!(certified > 0);
}

/// Exponents from 0.5 to 2 at some vertices of the boundary, no two of them in a tet.
fn random_corners(random: &mut Random, domain: &Domain) -> Corners {
    let mut exponents: Vec<(VertexId, f64)> = Vec::new();
    let boundary: Vec<VertexId> =
        (0..).map(VertexId).zip(domain.boundary().vertex_mask()).filter(|(_, on)| **on).map(|(v, _)| v).collect();
    for _ in 0..4 {
        let vertex = boundary[random.0.next_u32() as usize % boundary.len()];
        let near = |(other, _): &(VertexId, f64)| {
            domain.mesh().tets().iter().any(|tet| tet.contains(other) && tet.contains(&vertex))
        };
        if !exponents.iter().any(near) {
            exponents.push((vertex, 2f64.powf(random.number())));
        }
    }
    Corners::stars(domain, &exponents).unwrap()
}

/// The bounds of maps that are powers at corners, and a certificate on the elements at one of these.
fn bounds_with(domain: &Domain, corners: &Corners, image: &[Vec3]) -> Vec<LowerBound> {
    let elements = corners.elements(domain);
    let mut bounds = bound::with_corners(domain, corners, &elements, image, &Cancel::default());
    let corner = corners.cones()[0].corner;
    let at_corner = |tet: &TetId| elements.domain.mesh().tets()[tet.index()].contains(&corner);
    let star = (0..elements.owners.len() as u32).map(TetId).filter(at_corner).collect();
    let found = bound::certificate::search_on(&elements.domain, image, star, &Cancel::default());
    bounds.extend(found.and_then(|found| bound::gram_with_corners(&found, &elements, image).ok()));
    bounds
}

/// The bounds for given exponents, and the fan bound whatever they are, of maps that are powers at some vertices.
#[test]
fn no_bound_exceeds_a_map_with_powers_at_corners() {
    const NAMES: [BoundName; 4] = [BoundName::Apex, BoundName::Vertex, BoundName::Gram, BoundName::Fan];
    let cases = cases(1000);
    let mut maps = 0u64;
    // The largest share of what is achieved that bounds reach, and how many others that speak of other exponents exceed it.
    let (mut reached, mut exceeding) = ([0.0f64; 4], [0u64; 4]);
    for case in 0..cases {
        let mut random = Random(ChaCha8Rng::seed_from_u64(case));
        let Some((domain, start)) = random_start(&mut random, [0.0, 0.1, 0.4]) else { continue };
        let positive = |image: &[Vec3]| measure(&domain, image).summary.flipped == 0;
        let corners = random_corners(&mut random, &domain);
        let elements = corners.elements(&domain);
        let bounds = bounds_with(&domain, &corners, &start);
        let measured = |image: &[Vec3]| measure_elements(&domain, &elements, image).summary;
        let fixed = domain.boundary().vertex_mask();
        let mut images = vec![start.clone()];
        images.extend([0.05, 0.3].map(|scale| random.moved(&start, scale, |v| !fixed[v], positive)));
        if case % 8 == 0 {
            let settings = OptimizeSettings { polish: Polish::None, max_iterations: 30, ..OptimizeSettings::default() };
            images.push(optimize(&elements.domain, &start, fixed, &settings, &mut |_| {}).unwrap().positions);
        }
        for image in images.iter().filter(|image| positive(image)) {
            check_measured(&bounds, &measured(image), case);
            maps += 1;
        }
        if images.len() < 4 {
            continue;
        }
        let map = measured(&images[3]);
        let share = |bounds: &[LowerBound], name: BoundName| {
            let of_kind = bounds.iter().filter(|bound| bound.name == name && bound.applies);
            of_kind.map(|bound| bound.value / achieved(&map, bound.kind)).fold(0.0, f64::max)
        };
        let other =
            corners.clone().with_exponents(|v| corners.exponents().iter().find(|(w, _)| *w == v).unwrap().1 / 1.5);
        let false_bounds = bounds_with(&domain, &other, &start);
        for (i, name) in NAMES.into_iter().enumerate() {
            reached[i] = reached[i].max(share(&bounds, name));
            exceeding[i] += u64::from(share(&false_bounds, name) > 1.0);
        }
    }
    println!(
        "{cases} cases, {maps} maps; apex, vertex, Gram and fan reach {reached:.3?} of K; with wrong exponents {exceeding:?} exceed it"
    );
    // Vacuous without maps, blunt without some that come close, and not of these exponents if others would do.
    assert!(
        maps > 2 * cases && reached[0] > 0.999 && reached.iter().all(|&reached| reached > 0.5),
        "{maps} {reached:?}"
    );
    assert!(exceeding[..3].iter().all(|&exceeding| exceeding > 0) && exceeding[3] == 0, "{exceeding:?}");
}

/// A shell mesh with layers of thickness ratio 1e-3 to 1e3 of a solid that may be flat or a needle, up to 1e6 : 1, turned at random, and
/// its radial map with a random exponent; nothing where rounding makes that no mesh.
fn thin_mesh(random: &mut Random) -> Option<(Domain, Vec<Vec3>)> {
    let powers = |random: &mut Random, most: f64| 10f64.powf(most * random.number());
    let thin = random.number() < 0.0;
    let mut length = || if thin { powers(random, 6.0) } else { powers(random, 0.2) };
    let (height, width) = (length(), length());
    let sides = 3 + random.0.next_u32() % 3;
    let solid = match random.0.next_u32() % 7 {
        0 => Solid::Tetrahedron,
        1 => Solid::Octahedron,
        2 => Solid::Box { size: [1.0, height, width] },
        3 => Solid::Prism { sides, height },
        4 => Solid::Pyramid { sides, height },
        5 => Solid::Bipyramid { sides, height },
        _ => Solid::Ellipsoid { radii: [1.0, height.clamp(1e-3, 1e3), width.clamp(1e-3, 1e3)], resolution: 1 },
    };
    let grading = powers(random, 3.0);
    let layers = 1 + random.0.next_u32() % 4;
    let exponent = powers(random, 0.3);
    let settings = ShellSettings { subdivisions: 1, refinement: None, layers, grading };
    let shell = shell_mesh(&solid.surface().ok()?, Vec3::zeros(), &settings).ok()?;
    let radial = caraman(&RadialCoordinates::of_shell(&shell), exponent);
    // Coordinates that are not round, and no longer in a plane where they were.
    let axis = random.vector().normalize();
    let [x, y] = [axis.cross(&random.vector()).normalize(), axis];
    let frame = [x, y, x.cross(&y)];
    let turned = shell.mesh.points().iter().map(|p| frame[0] * p.x + frame[1] * p.y + frame[2] * p.z).collect();
    let mesh = TetMesh::new(turned, shell.mesh.tets().to_vec()).ok()?;
    Some((Domain::new(mesh).ok()?, radial))
}

/// The bounds claim nothing that is shown to be false of the start or of an optimized map, which comes close to some of them.
#[test]
fn no_bound_contradicts_a_map_of_thin_tets() {
    let cases = cases(300);
    let (mut maps, mut claims, mut within) = (0u64, 0u64, 0u64);
    for case in 0..cases {
        let mut random = Random(ChaCha8Rng::seed_from_u64(case));
        let Some((domain, start)) = thin_mesh(&mut random) else { continue };
        let bounds = bound::all(&domain, &start, None, false);
        for bound in &bounds {
            assert!(bound.value >= 1.0 && bound.value.is_finite(), "case {case}: {bound:?}");
        }
        claims += bounds.iter().filter(|bound| bound.applies && bound.certified && bound.value > 1.01).count() as u64;
        let mut hold_against = |image: &[Vec3]| {
            let map = measure(&domain, image).summary;
            assert!(!map.max_k.is_nan(), "case {case}");
            if let Err(contradiction) = bound::confront(&bounds, &domain, image, &map, "the case's seed") {
                panic!("case {case}: {contradiction}");
            }
            maps += 1;
            map.max_k
        };
        if !hold_against(&start).is_finite() {
            continue;
        }
        let settings = OptimizeSettings { polish: Polish::None, max_iterations: 25, ..OptimizeSettings::default() };
        let fixed = domain.boundary().vertex_mask();
        if let Ok(outcome) = optimize(&domain, &start, fixed, &settings, &mut |_| {}) {
            let max_k = hold_against(&outcome.positions);
            let best = bound::best_applicable(&bounds).map_or(1.0, |best| best.value);
            within += u64::from(max_k < best * 1.01);
        }
    }
    println!("{cases} cases, {maps} maps, {claims} bounds above 1.01, {within} maps within 1 % of a bound");
    // Vacuous without maps or claims, and blunt without some that come close.
    assert!(maps > cases && claims > cases && within * 20 > cases, "{maps} {claims} {within}");
}

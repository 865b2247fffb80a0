use super::*;
use crate::map::{RadialCoordinates, caraman};
use crate::measure::{ball_dilatation, warped_ball_dilatation};
use crate::mesh::{Boundary, PolygonSoup, Subdivision};
use crate::optimize::{BoundaryValues, optimize};
use crate::solid::{Refinement, ShellSettings, Solid, Surface, shell_mesh};

/// The cube in few tets and its radial map, optimized without a polish.
fn cube(subdivisions: u32) -> (Domain, Vec<Vec3>, Outcome) {
    let settings = ShellSettings { subdivisions, refinement: None, layers: 2, grading: 1.0 };
    let shell = shell_mesh(&Solid::Cube.surface().unwrap(), Vec3::new(0.2, 0.1, -0.15), &settings).unwrap();
    let start = caraman(&RadialCoordinates::of_shell(&shell), 1.0);
    let domain = Domain::new(shell.mesh).unwrap();
    let settings = OptimizeSettings { polish: Polish::None, ..OptimizeSettings::default() };
    let outcome = optimize(&domain, &start, domain.boundary().vertex_mask(), &settings, &mut |_| {}).unwrap();
    (domain, start, outcome)
}

fn unrefined(domain: Domain, start: Vec<Vec3>, outcome: Outcome, centre: Option<Vec3>) -> Unrefined {
    Unrefined { domain, start, outcome, corners: None, centre }
}

fn refined(refinement: &RefineSettings) -> (Domain, f64, RefinedMap) {
    let (domain, start, outcome) = cube(2);
    let before = measure(&domain, &outcome.positions).summary.max_k;
    let map =
        refine(unrefined(domain.clone(), start, outcome, None), &OptimizeSettings::default(), refinement, &mut |_| {})
            .unwrap();
    (domain, before, map)
}

#[test]
fn k_falls_from_round_to_round_on_the_same_solid_with_the_same_boundary() {
    let settings = RefineSettings { rounds: 6, tets: Budget::Share(1.0), until: 1e-3, surface: false };
    let (domain, before, map) = refined(&settings);
    assert!(!map.rounds.is_empty());
    let mut reached = before;
    for (number, round) in (1..).zip(&map.rounds) {
        // What is carried over has the same dilatations but for rounding.
        assert!(round.max_k <= reached * (1.0 + 1e-10), "round {number}: {} after {reached}", round.max_k);
        reached = round.max_k;
        let rows = map.outcome.trace.iter().filter(|row| row.round <= number);
        // The optimizer has decompositions of its own.
        assert!(rows.map(|row| row.max_k).fold(f64::INFINITY, f64::min) <= round.max_k * (1.0 + 1e-10));
    }
    assert!(reached < before * 0.999 && !map.changes.flips.is_empty(), "{before} -> {reached}");
    // The polish may give back 2e-4 of it.
    let found = measure(&map.domain, &map.outcome.positions).summary;
    assert!(found.flipped == 0 && found.max_k <= reached * (1.0 + 3e-4));
    let bound = unchanging_bound(&domain, &map.outcome.positions).unwrap().value;
    assert!(bound <= found.max_k, "{bound} {}", found.max_k);
    // Solid angles are sums over other tets.
    let again = unchanging_bound(&map.domain, &map.outcome.positions).unwrap().value;
    assert!((bound / again - 1.0).abs() < 1e-12, "{bound} {again}");
    assert!(map.outcome.trace.iter().enumerate().all(|(index, row)| row.iteration == index));

    let mut again = Subdivision::of(domain.mesh());
    again.change(&map.changes).unwrap();
    assert_eq!(&again.mesh().unwrap(), map.domain.mesh());
    assert_eq!(Subdivision::before(map.domain.mesh(), &map.changes).as_ref(), Some(domain.mesh()));
    let surface = |domain: &Domain| {
        let mut triangles = domain.boundary().triangles().to_vec();
        triangles.iter_mut().for_each(|triangle| triangle.sort_unstable());
        triangles.sort_unstable();
        triangles
    };
    assert_eq!(surface(&domain), surface(&map.domain));
    Boundary::of(map.domain.mesh()).unwrap().check_ball(map.domain.mesh()).unwrap();
    let volume = |domain: &Domain| domain.volumes().iter().sum::<f64>();
    assert!((volume(&domain) / volume(&map.domain) - 1.0).abs() < 1e-12);
}

#[test]
fn flips_lower_k_where_they_are_made_and_keep_the_room() {
    let (domain, start, outcome) = cube(2);
    let image = outcome.positions.clone();
    let measured = |domain: &Domain| measure(domain, &image);
    let before = measured(&domain);
    let (changes, rounds, end) = (MeshChanges::default(), Vec::new(), RefineEnd::Rounds);
    let map = RefinedMap { domain, start, outcome, corners: None, changes, max_k_before: None, rounds, end };
    for surface in [false, true] {
        let (flipped, flips) = map.flipped(&image, before.summary.max_k, surface).unwrap();
        let after = measured(&flipped);
        assert!(after.flipped.is_empty() && (surface || after.summary.max_k <= before.summary.max_k));
        let tets = flipped.mesh().tets().len();
        assert_eq!(tets, map.domain.mesh().tets().len() + flips.new.len() - flips.old.len());
        // Of the whole part that is replaced, if not onto the ball.
        let old = flips.old.iter().map(|(tet, _)| before.dilatations[tet.index()].k()).fold(1.0, f64::max);
        let new = after.dilatations[tets - flips.new.len()..].iter().map(|k| k.k()).fold(1.0, f64::max);
        assert!(surface || new < old * 0.9955, "{new} after {old}");
        assert_eq!(flipped.boundary().triangles().len(), map.domain.boundary().triangles().len());
        let volume = |domain: &Domain| domain.volumes().iter().sum::<f64>();
        assert!((volume(&flipped) / volume(&map.domain) - 1.0).abs() < 1e-13);
    }
    // Nothing that would raise the best map above what it has.
    assert!(map.flipped(&image, 1.0, false).is_none());
}

#[test]
fn it_ends_where_it_is_told_to_and_the_same_on_any_number_of_threads() {
    let settings = |rounds, tets, until| RefineSettings { rounds, tets, until, surface: false };
    let (domain, before, none) = refined(&settings(5, Budget::Tets(1), 0.02));
    assert_eq!((none.end, none.changes.halved.len()), (RefineEnd::Budget, 0));
    assert!(measure(&domain, &none.outcome.positions).summary.max_k <= before * (1.0 + 3e-4));
    assert_eq!(refined(&settings(5, Budget::Share(1.0), 1e3)).2.end, RefineEnd::BoundaryValues);
    let (domain, _, two) = refined(&settings(2, Budget::Share(0.3), 1e-3));
    assert_eq!((two.end, two.rounds.len()), (RefineEnd::Rounds, 2));
    assert!(two.domain.mesh().tets().len() <= domain.mesh().tets().len() * 13 / 10);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    let again = pool.install(|| refined(&settings(2, Budget::Share(0.3), 1e-3)).2);
    assert_eq!((again.changes, again.outcome.positions), (two.changes, two.outcome.positions));

    let (domain, start, outcome) = cube(2);
    let cancelled = OptimizeSettings::default();
    cancelled.cancel.raise();
    let map =
        refine(unrefined(domain, start, outcome, None), &cancelled, &RefineSettings::default(), &mut |_| {}).unwrap();
    assert_eq!((map.end, map.rounds.len()), (RefineEnd::NotSettled, 0));
}

#[test]
fn what_is_left_of_an_interrupted_refinement_has_a_row_of_the_trace() {
    let (domain, start, outcome) = cube(2);
    let refinement = RefineSettings { rounds: 3, tets: Budget::Share(0.6), until: 1e-3, surface: false };
    // Ended in so many rows of the rounds; after 0 there is no round, and `None` ends nothing.
    let ended = |after: Option<usize>| {
        let settings = OptimizeSettings::default();
        let (cancel, mut rows) = (settings.cancel.clone(), 0);
        let map = unrefined(domain.clone(), start.clone(), outcome.clone(), None);
        let mut told = Vec::new();
        let mut count = |row: &TraceRow| {
            told.push(row.clone());
            rows += 1;
            if after == Some(rows) {
                cancel.raise();
            }
        };
        let map = refine(map, &settings, &refinement, &mut count).unwrap();
        assert_eq!(map.outcome.trace[map.outcome.trace.len() - told.len()..], told);
        map
    };
    let rows = ended(None).outcome.trace.len() - outcome.trace.len();
    let mut taken_over = 0;
    for after in (1..rows).step_by(7) {
        let map = ended(Some(after));
        let found = measure(&map.domain, &map.outcome.positions).summary;
        let same = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-12;
        let is_of_it = |row: &TraceRow| same(row.max_k, found.max_k) && same(row.mean_k, found.mean_k);
        assert!(map.outcome.trace.iter().any(is_of_it), "after {after} rows: {found:?}");
        taken_over += usize::from(map.outcome.trace.last().is_some_and(|row| &*row.phase == "best"));
    }
    assert!(taken_over > 0);
}

#[test]
fn a_map_onto_the_ball_that_cannot_be_lowered_from_ends_its_rounds_without_an_error() {
    let (domain, _, outcome) = cube(1);
    let mut turned = outcome.positions.clone();
    let inside = (0..turned.len()).find(|v| !domain.boundary().vertex_mask()[*v]).unwrap();
    // Its tets lie on all sides of it: with one beyond the sphere some are turned over. The image of the boundary is what it was.
    turned[inside] = Vec3::new(0.0, 0.0, 1.5);
    assert!(measure(&domain, &turned).summary.flipped > 0);
    let warped = Warped { domain: &domain, corners: None, mirrors: None, onto_ball: true };
    let settled = Outcome { positions: turned.clone(), stop: StopReason::Converged, ..outcome };
    let ended = warped.settle_onto_ball(settled, 3, &OptimizeSettings::default(), &mut |_| {}).unwrap();
    assert_eq!((ended.stop, ended.positions), (StopReason::NoProgress, turned));
}

#[test]
fn a_start_that_could_not_be_untangled_is_left_as_it_is() {
    let (domain, start, _) = cube(2);
    let settings = OptimizeSettings::default();
    let outcome = Outcome::still_flipped(start.clone(), &settings);
    let map = refine(unrefined(domain, start, outcome, None), &settings, &RefineSettings::default(), &mut |_| {});
    assert_eq!(map.unwrap().end, RefineEnd::NotSettled);
}

#[test]
fn a_surface_whose_last_settling_is_cut_short_has_a_row_and_tells_what_ended_it() {
    let (domain, start, outcome) = cube(1);
    let settings = OptimizeSettings::default();
    let refinement = RefineSettings { rounds: 5, ..RefineSettings::of_surface() };
    let map = unrefined(domain, start, outcome, Some(Vec3::new(0.2, 0.1, -0.15)));
    let map = refine(map, &settings, &refinement, &mut |_| {}).unwrap();
    assert!(!map.rounds.is_empty());
    // As a round leaves it that lowered K by halving alone: all rows are of the mesh before.
    let mut kept = map.clone();
    kept.outcome.trace.retain(|row| row.round == 0);
    settings.cancel.raise();
    let left = map.settled_onto_ball(kept, f64::INFINITY, &settings, &mut |_| {}).unwrap();
    let found = measure(&left.domain, &left.outcome.positions).summary;
    let last = left.outcome.trace.last().unwrap();
    assert_eq!((left.outcome.stop, last.iteration + 1), (StopReason::Cancelled, left.outcome.trace.len()));
    assert_eq!((last.max_k, last.mean_k), (found.max_k, found.mean_k));
}

#[test]
fn with_the_surface_the_solid_stays_and_k_onto_the_ball_falls() {
    let (domain, start, outcome) = cube(1);
    let centre = Vec3::new(0.2, 0.1, -0.15);
    let refinement = RefineSettings { rounds: 5, ..RefineSettings::of_surface() };
    let before = ball_dilatation(&domain, &outcome.positions).unwrap();
    let settings = OptimizeSettings::default();
    let refined = |outcome: &Outcome| {
        let (domain, start, outcome) = (domain.clone(), start.clone(), outcome.clone());
        refine(unrefined(domain, start, outcome, Some(centre)), &settings, &refinement, &mut |_| {}).unwrap()
    };
    let map = refined(&outcome);
    // What the rounds tell is certified, too.
    assert!(map.max_k_before.unwrap() <= before.certified * (1.0 + 1e-10), "{map:?} {before:?}");
    let mut reached = map.max_k_before.unwrap();
    for round in &map.rounds {
        assert!(round.max_k <= reached, "{} after {reached}", round.max_k);
        reached = round.max_k;
    }
    let found = ball_dilatation(&map.domain, &map.outcome.positions).unwrap();
    assert!(found.certified < map.max_k_before.unwrap(), "{found:?} after {before:?}");
    // pi over the dihedral angle: no quasi-conformal map onto the ball has a smaller K.
    assert!(2.0 <= found.certified);

    // The same solid: all new vertices of the surface lie on the cube's faces, and its volume and its twelve edges stay.
    let mesh = map.domain.mesh();
    let (boundary, points) = (map.domain.boundary(), mesh.points());
    assert!(boundary.triangles().len() > domain.boundary().triangles().len());
    boundary.check_ball(mesh).unwrap();
    let volume = |domain: &Domain| domain.volumes().iter().sum::<f64>();
    assert!((volume(&map.domain) / 8.0 - 1.0).abs() < 1e-12 && (volume(&domain) / 8.0 - 1.0).abs() < 1e-12);
    for (v, point) in points.iter().enumerate().filter(|(v, _)| boundary.vertex_mask()[*v]) {
        assert!((point.amax() - 1.0).abs() < 1e-15, "vertex {v} at {point}");
        // Where the radial map sends it, in the start as in the end.
        let direction = (point - centre).normalize();
        assert!((map.outcome.positions[v] - direction).norm() < 1e-14, "vertex {v}");
        assert_eq!(map.start[v], map.outcome.positions[v]);
    }
    let mut again = Subdivision::of(domain.mesh());
    again.change(&map.changes).unwrap();
    assert_eq!(&again.mesh().unwrap(), mesh);
    assert_eq!(Subdivision::before(mesh, &map.changes).as_ref(), Some(domain.mesh()));

    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    let again = pool.install(|| refined(&outcome));
    assert_eq!((again.changes, again.outcome.positions), (map.changes, map.outcome.positions));
}

#[test]
fn k_onto_the_ball_ends_no_higher_than_it_is_at_the_start() {
    // The hull of a few points, with long flat triangles: the least K onto the polyhedron goes with a larger one onto the ball than the start has.
    let points = [
        [-0.315068, -0.930018, -0.213302],
        [1.111917, 0.424147, 1.036879],
        [-1.666063, 0.855251, 0.506385],
        [0.498818, -1.691365, -1.743888],
        [-0.889615, -0.468189, 0.305446],
        [-0.045912, 0.520975, -0.642235],
        [0.308703, 0.394154, -0.661137],
    ];
    let triangles =
        [[0, 3, 1], [0, 1, 4], [0, 4, 3], [1, 2, 4], [1, 5, 2], [1, 3, 6], [1, 6, 5], [2, 3, 4], [2, 5, 3], [3, 5, 6]];
    let polygons = triangles.map(|triangle| triangle.map(VertexId).to_vec()).to_vec();
    let points = points.map(|[x, y, z]| Vec3::new(x, y, z)).to_vec();
    let surface = Surface::from_soup(PolygonSoup { points, polygons, notes: Vec::new() }).unwrap();
    let settings = ShellSettings { subdivisions: 1, refinement: Some(Refinement::Cells(300)), layers: 8, grading: 1.0 };
    let shell = shell_mesh(&surface, Vec3::new(0.0259, -0.0491, -0.1712), &settings).unwrap();
    let start = caraman(&RadialCoordinates::of_shell(&shell), 1.0);
    let domain = Domain::new(shell.mesh).unwrap();
    let settings = OptimizeSettings { polish: Polish::None, ..OptimizeSettings::default() };
    let outcome = optimize(&domain, &start, domain.boundary().vertex_mask(), &settings, &mut |_| {}).unwrap();
    let k = |domain: &Domain, image: &[Vec3]| ball_dilatation(domain, image).unwrap().certified;
    let at_start = k(&domain, &start);
    assert!(at_start < k(&domain, &outcome.positions), "this is no such case");
    let refined = |rounds: usize, stop: StopReason| {
        let refinement = RefineSettings { rounds, ..RefineSettings::of_surface() };
        let outcome = Outcome { stop, ..outcome.clone() };
        let map = Unrefined { domain: domain.clone(), start: start.clone(), outcome, corners: None, centre: None };
        refine(map, &OptimizeSettings::default(), &refinement, &mut |_| {}).unwrap()
    };
    for (rounds, stop) in [(0, outcome.stop), (2, outcome.stop), (2, StopReason::TimeLimit)] {
        let map = refined(rounds, stop);
        let found = k(&map.domain, &map.outcome.positions);
        assert!(found <= at_start, "{rounds} rounds, {stop}: {found} from {at_start}");
        assert!(map.max_k_before.is_none_or(|before| found <= before && before <= at_start), "{:?}", map.max_k_before);
        // Its row is there, as verify asks.
        let max_k = measure(&map.domain, &map.outcome.positions).summary.max_k;
        assert!(map.outcome.trace.iter().any(|row| (row.max_k / max_k - 1.0).abs() < 1e-12));
    }
}

#[test]
fn middles_slide_on_the_sphere_with_a_boundary_that_slides() {
    let (domain, start, outcome) = cube(1);
    let refinement = RefineSettings { rounds: 4, tets: Budget::Share(3.0), ..RefineSettings::of_surface() };
    let settings = OptimizeSettings { boundary_values: BoundaryValues::Sliding, ..OptimizeSettings::default() };
    let map = refine(unrefined(domain, start, outcome, None), &settings, &refinement, &mut |_| {}).unwrap();
    assert!(!map.rounds.is_empty());
    let on_sphere = map.domain.boundary().vertex_mask().iter().zip(&map.outcome.positions).filter(|(on, _)| **on);
    for (_, image) in on_sphere {
        assert!((image.norm() - 1.0).abs() < 1e-12, "{image}");
    }
    assert_eq!(measure(&map.domain, &map.outcome.positions).summary.flipped, 0);
}

#[test]
fn elements_at_corners_with_powers_stay_but_for_the_edges_opposite_to_them() {
    let (domain, start, outcome) = cube(1);
    let is_corner = |v: VertexId| domain.mesh().points()[v.index()].iter().all(|x| x.abs() == 1.0);
    let exponents: Vec<(VertexId, f64)> =
        (0..domain.mesh().points().len() as u32).map(VertexId).filter(|v| is_corner(*v)).map(|v| (v, 1.3)).collect();
    assert_eq!(exponents.len(), 8);
    let corners = Corners::stars(&domain, &exponents).unwrap();
    let refinement = RefineSettings { rounds: 5, tets: Budget::Share(4.0), ..RefineSettings::of_surface() };
    let settings = OptimizeSettings { boundary_values: BoundaryValues::Sliding, ..OptimizeSettings::default() };
    let with_corners = Unrefined { corners: Some(corners), ..unrefined(domain.clone(), start, outcome, None) };
    let map = refine(with_corners, &settings, &refinement, &mut |_| {}).unwrap();
    assert!(!map.rounds.is_empty());
    let has_corner = |vertices: &[VertexId]| vertices.iter().any(|v| exponents.iter().any(|(corner, _)| v == corner));
    assert!(!map.changes.halved.iter().any(|edge| has_corner(edge)));
    assert!(!map.changes.flips.iter().any(|flips| flips.old.iter().any(|(_, tet)| has_corner(tet))));
    // The elements are those of the finer mesh, which has more of them, and the map is one onto the ball.
    assert_eq!(map.corners, Some(Corners::stars(&map.domain, &exponents).unwrap()));
    let elements = |domain: &Domain| domain.mesh().tets().iter().filter(|tet| has_corner(&tet[..])).count();
    assert!(elements(&map.domain) > elements(&domain));
    let found = warped_ball_dilatation(&map.domain, map.corners.as_ref(), &map.outcome.positions).unwrap();
    let before = map.max_k_before.unwrap();
    assert!(2.0 <= found.certified && found.certified < before, "{found:?} after {before}");
}

//! One suite for all engines: the same small problems, the same answers.

use std::time::{Duration, Instant};

use qcball::map::{RadialCoordinates, caraman};
use qcball::mesh::{PolygonSoup, VertexId};
use qcball::objective::opening;
use qcball::optimize::{BoundaryValues, Effort, Engine, Objective, OptimizeSettings, Outcome, Polish, StopReason};
use qcball::solid::{ShellSettings, Solid, Surface, shell_mesh};
use qcball::{Domain, Vec3, measure, optimize};

struct Problem {
    name: &'static str,
    domain: Domain,
    start: Vec<Vec3>,
}

impl Problem {
    fn new(name: &'static str, solid: Solid, offset: Vec3, subdivisions: u32, layers: u32) -> Self {
        Self::of_surface(name, &solid.surface().unwrap(), offset, subdivisions, layers)
    }

    fn of_surface(name: &'static str, surface: &Surface, offset: Vec3, subdivisions: u32, layers: u32) -> Self {
        let settings = ShellSettings { subdivisions, refinement: None, layers, grading: 1.0 };
        let shell = shell_mesh(surface, surface.centroid() + offset, &settings).unwrap();
        let start = caraman(&RadialCoordinates::of_shell(&shell), 1.0);
        Self { name, domain: Domain::new(shell.mesh).unwrap(), start }
    }

    fn solve(&self, engine: Engine, objective: Objective, tolerance: f64) -> Outcome {
        let settings = OptimizeSettings {
            objective,
            engine,
            polish: Polish::None,
            tolerance,
            max_iterations: 20_000,
            ..OptimizeSettings::default()
        };
        let clock = Instant::now();
        let outcome =
            optimize(&self.domain, &self.start, self.domain.boundary().vertex_mask(), &settings, &mut |_| {}).unwrap();
        let measured = measure(&self.domain, &outcome.positions).summary;
        let (rows, seconds) = (outcome.trace.len() - 1, clock.elapsed().as_secs_f64());
        println!(
            "{} ({} tets), {engine}, {objective:?}: max K {:.9}, objective {:.10}, {rows} rows, {seconds:.2} s, {:?}",
            self.name,
            self.domain.mesh().tets().len(),
            measured.max_k,
            outcome.trace[rows].objective,
            outcome.stop
        );
        assert_eq!(measured.flipped, 0);
        outcome
    }

    fn max_k(&self, outcome: &Outcome) -> f64 {
        measure(&self.domain, &outcome.positions).summary.max_k
    }
}

fn problems() -> Vec<Problem> {
    vec![
        Problem::new("tetrahedron", Solid::Tetrahedron, Vec3::zeros(), 1, 2),
        Problem::new("off-centre tetrahedron", Solid::Tetrahedron, Vec3::new(0.1, 0.05, -0.05), 1, 2),
        Problem::new("cube", Solid::Cube, Vec3::zeros(), 1, 2),
        Problem::new("off-centre cube", Solid::Cube, Vec3::new(0.1, 0.05, -0.07), 1, 2),
    ]
}

#[test]
fn little_effort_leaves_at_most_a_hundredth_and_takes_fewer_steps() {
    // Of smooth solids, thousands of tets tie in the end, and the last hundredth takes most of the steps.
    let solid = Solid::SmoothStar { amplitude: 0.25, degree: 3, resolution: 5, seed: 1 };
    let problem = Problem::new("smooth star", solid, Vec3::zeros(), 1, 3);
    let solve = |effort| {
        let settings = OptimizeSettings { effort, ..OptimizeSettings::default() };
        let fixed = problem.domain.boundary().vertex_mask();
        optimize(&problem.domain, &problem.start, fixed, &settings, &mut |_| {}).unwrap()
    };
    let [quick, normal, thorough] = [Effort::Quick, Effort::Normal, Effort::Thorough].map(solve);
    assert_eq!([quick.stop, normal.stop], [StopReason::Converged, StopReason::Optimal]);
    // Each was allowed 2e-4 more by the polish.
    assert!(problem.max_k(&quick) <= 1.01 * problem.max_k(&normal), "{}", problem.max_k(&quick));
    assert!(quick.trace.len() < normal.trace.len());
    // Of a small mesh all is solved for at once in any case.
    assert_eq!(normal.positions, thorough.positions);
}

#[test]
fn soft_maxima_agree() {
    for problem in problems() {
        for exponent in [4.0, 8.0] {
            let solve = |engine| {
                let outcome = problem.solve(engine, Objective::SoftMax(exponent), 1e-9);
                outcome.trace.last().unwrap().objective
            };
            let ours = solve(Engine::Newton);
            for engine in [Engine::Lbfgs, Engine::NewtonCg, Engine::TrustRegion] {
                let difference = solve(engine) - ours;
                assert!(difference.abs() < 1e-6, "{}, {engine}, p = {exponent}: {difference:e} in ln K", problem.name);
            }
        }
    }
}

#[test]
fn largest_dilatations_agree_whatever_comes_before_the_barrier() {
    for problem in problems() {
        let ours = problem.max_k(&problem.solve(Engine::Newton, Objective::Max, 1e-6));
        for engine in [Engine::Lbfgs, Engine::NewtonCg, Engine::TrustRegion] {
            let theirs = problem.max_k(&problem.solve(engine, Objective::Max, 1e-6));
            assert!((theirs / ours - 1.0).abs() < 1e-5, "{}, {engine}: {theirs} against {ours}", problem.name);
        }
    }
}

#[cfg(feature = "nlopt")]
const EPIGRAPH: [Engine; 3] = [Engine::Mma, Engine::Ccsaq, Engine::Slsqp];

#[cfg(feature = "nlopt")]
#[test]
fn epigraph_forms_agree_with_the_barrier() {
    for problem in problems() {
        let ours = problem.max_k(&problem.solve(Engine::Newton, Objective::Max, 1e-6));
        for engine in EPIGRAPH {
            let theirs = problem.max_k(&problem.solve(engine, Objective::Max, 1e-6));
            assert!((theirs / ours - 1.0).abs() < 1e-3, "{}, {engine}: {theirs} against {ours}", problem.name);
        }
    }
}

#[test]
fn two_runs_are_equal_to_the_bit() {
    let problem = problems().pop().unwrap();
    let mut cases = vec![Engine::Newton, Engine::Lbfgs, Engine::NewtonCg, Engine::TrustRegion];
    #[cfg(feature = "nlopt")]
    cases.extend(EPIGRAPH);
    for engine in cases {
        let run = || problem.solve(engine, Objective::Max, 1e-6).positions;
        assert_eq!(run(), run(), "{engine}");
    }
}

#[cfg(feature = "nlopt")]
#[test]
fn epigraph_engines_refuse_what_they_cannot_do_and_say_what_can() {
    let large = Problem::new("large cube", Solid::Cube, Vec3::zeros(), 2, 2);
    let run = |objective, engine| {
        let settings = OptimizeSettings { objective, engine, ..OptimizeSettings::default() };
        let fixed = large.domain.boundary().vertex_mask();
        optimize(&large.domain, &large.start, fixed, &settings, &mut |_| {}).unwrap_err().to_string()
    };
    for engine in EPIGRAPH {
        let message = run(Objective::Max, engine);
        assert!(message.contains("768") && message.contains("newton"), "{message}");
        let message = run(Objective::SoftMax(4.0), engine);
        assert!(message.contains("largest K only") && message.contains("trust-region"), "{message}");
    }
}

#[cfg(feature = "nlopt")]
#[test]
fn limits_end_the_epigraph_engines() {
    let problem = problems().pop().unwrap();
    for (max_iterations, time_limit, stop) in
        [(20, None, StopReason::IterationLimit), (10_000, Some(Duration::from_nanos(1)), StopReason::TimeLimit)]
    {
        for engine in EPIGRAPH {
            let settings = OptimizeSettings {
                engine,
                max_iterations,
                time_limit,
                tolerance: 1e-12,
                ..OptimizeSettings::default()
            };
            let fixed = problem.domain.boundary().vertex_mask();
            let outcome = optimize(&problem.domain, &problem.start, fixed, &settings, &mut |_| {}).unwrap();
            assert_eq!(outcome.stop, stop, "{engine}");
        }
    }
}

/// The map that a polish ends with is no iteration beyond the limit.
#[test]
fn no_engine_goes_beyond_the_iteration_limit() {
    let problem = problems().pop().unwrap();
    let fixed = problem.domain.boundary().vertex_mask();
    let mut engines = vec![Engine::Newton, Engine::Lbfgs];
    if cfg!(feature = "nlopt") {
        engines.push(Engine::Mma);
    }
    let mut limited_in_the_polish = 0;
    for engine in engines {
        for max_iterations in (0..60).step_by(3) {
            let settings = OptimizeSettings { engine, max_iterations, ..OptimizeSettings::default() };
            let outcome = optimize(&problem.domain, &problem.start, fixed, &settings, &mut |_| {}).unwrap();
            let rows = outcome.trace.len() - 1;
            assert!(rows <= max_iterations, "{engine}: {rows} of {max_iterations}");
            assert!(outcome.trace.iter().enumerate().all(|(index, row)| row.iteration == index));
            let limited = outcome.stop == StopReason::IterationLimit && &*outcome.trace[rows].phase == "mean";
            limited_in_the_polish += usize::from(limited);
            // The final map has a row.
            let max_k = problem.max_k(&outcome);
            assert!(outcome.trace.iter().any(|row| (row.max_k - max_k).abs() <= 1e-9 * max_k), "{engine}: {max_k}");
        }
    }
    assert!(limited_in_the_polish > 0);
}

#[test]
fn lexicographic_levels_lower_what_lies_below_the_largest() {
    let mut lowered = Vec::new();
    for problem in problems() {
        let largest = |polish| {
            let settings = OptimizeSettings { polish, ..OptimizeSettings::default() };
            let fixed = problem.domain.boundary().vertex_mask();
            let outcome = optimize(&problem.domain, &problem.start, fixed, &settings, &mut |_| {}).unwrap();
            assert_eq!(outcome.stop, StopReason::Optimal, "{}", problem.name);
            let values = measure(&problem.domain, &outcome.positions).dilatations;
            let mut values: Vec<f64> = values.iter().map(|dilatation| dilatation.k()).collect();
            values.sort_by(|a, b| b.total_cmp(a));
            values
        };
        let [first, further] = [Polish::None, Polish::Lexicographic { levels: 4 }].map(largest);
        assert_eq!(first[0], further[0], "{}: the largest is settled before", problem.name);
        // The first value in which they differ by more than the accuracy of a level is the smaller one with more levels.
        let differ = first.iter().zip(&further).find(|(a, b)| (*a / *b).ln().abs() > 2e-5);
        if let Some((first, further)) = differ {
            assert!(further < first, "{}: {further} {first}", problem.name);
            lowered.push(problem.name);
        }
    }
    // Where symmetry makes all large values one, there is nothing to lower; elsewhere there is.
    assert!(!lowered.is_empty());
}

#[test]
fn sliding_boundaries_stay_on_the_sphere_and_reach_less() {
    let mut lower = 0;
    for problem in problems() {
        let mask = problem.domain.boundary().vertex_mask();
        let solve =
            |settings: &OptimizeSettings| optimize(&problem.domain, &problem.start, mask, settings, &mut |_| {});
        let fixed = solve(&OptimizeSettings::default()).unwrap();
        let settings = OptimizeSettings { boundary_values: BoundaryValues::Sliding, ..OptimizeSettings::default() };
        let sliding = solve(&settings).unwrap();
        let on_boundary = |v: &usize| mask[*v];
        for v in (0..mask.len()).filter(on_boundary) {
            assert!((sliding.positions[v].norm() - 1.0).abs() < 1e-12, "{}: vertex {v}", problem.name);
            assert_eq!(fixed.positions[v], problem.start[v]);
        }
        let [fixed, moved] =
            [&fixed, &sliding].map(|outcome| measure(&problem.domain, &outcome.positions).summary.max_k);
        println!("{}: max K {fixed} fixed, {moved} sliding, {:?} {:?}", problem.name, sliding.stop, sliding.kkt);
        assert_eq!(sliding.stop, StopReason::Optimal, "{}", problem.name);
        // Both to 1e-6 in ln K. Where symmetry holds the boundary, there is nothing to gain.
        assert!(moved < fixed * (1.0 + 2e-6), "{}", problem.name);
        lower += usize::from(moved < 0.99 * fixed);
        assert!(qcball::bijectivity(&problem.domain, &sliding.positions).bijective, "{}", problem.name);
        // Only where they are on a sphere, and by Newton only.
        let stretched: Vec<Vec3> = problem.start.iter().map(|p| Vec3::new(p.x, p.y, 1.5 * p.z)).collect();
        let refused = optimize(&problem.domain, &stretched, mask, &settings, &mut |_| {}).unwrap_err().to_string();
        assert!(refused.contains("sphere about the origin"), "{refused}");
        // Folded over itself, though on the sphere.
        let mut folded = problem.start.clone();
        let moved = (0..mask.len()).find(on_boundary).unwrap();
        folded[moved] = -folded[moved];
        assert!(optimize(&problem.domain, &folded, mask, &settings, &mut |_| {}).is_err());
        for engine in [Engine::Lbfgs, Engine::NewtonCg, Engine::TrustRegion] {
            let refused = solve(&OptimizeSettings { engine, ..settings.clone() }).unwrap_err().to_string();
            assert!(refused.contains("use the engine \"newton\""), "{refused}");
        }
    }
    assert!(lower > 0);
}

/// An octahedron with its corners pulled about, whose few large triangles come to their least openings as they slide.
fn irregular(seed: u64) -> Problem {
    let pulled = |corner: u64, axis: u64| ((7 * corner + 3 * axis + 5 * seed) % 11) as f64 / 11.0 - 0.45;
    let points = (0..6).map(|corner| {
        let mut point = Vec3::from_fn(|axis, _| 0.7 * pulled(corner, axis as u64));
        point[corner as usize / 2] += [-1.4, 1.4][corner as usize % 2];
        point
    });
    let octants = (0..8u32).map(|octant| {
        let [x, y, z] = [octant & 1, 2 + (octant >> 1 & 1), 4 + (octant >> 2)];
        // An odd number of negative axes turns the face over.
        let corners = if octant.count_ones() % 2 == 1 { [x, y, z] } else { [x, z, y] };
        corners.map(VertexId).to_vec()
    });
    let surface = Surface::from_soup(PolygonSoup::new(points.collect(), octants.collect())).unwrap();
    Problem::of_surface("irregular octahedron", &surface, Vec3::zeros(), 1, 3)
}

#[test]
fn sliding_triangles_at_their_least_opening_leave_a_stationary_map() {
    let mut at_least = 0;
    for seed in 0..4 {
        let problem = irregular(seed);
        let settings = OptimizeSettings { boundary_values: BoundaryValues::Sliding, ..OptimizeSettings::default() };
        let mask = problem.domain.boundary().vertex_mask();
        let outcome = optimize(&problem.domain, &problem.start, mask, &settings, &mut |_| {}).unwrap();
        assert_eq!(outcome.stop, StopReason::Optimal, "seed {seed}: {:?}", outcome.kkt);
        for triangle in problem.domain.boundary().triangles() {
            let of = |image: &[Vec3]| opening(triangle.map(|v| &image[v.index()]));
            // No wider than 45 degrees about the normal, or than it was, to the tolerance.
            let least = of(&problem.start).min(std::f64::consts::FRAC_1_SQRT_2);
            let reached = of(&outcome.positions) - least;
            assert!(reached >= -2e-6, "seed {seed}, {triangle:?}: {reached:e}");
            at_least += usize::from(reached < 1e-4);
        }
    }
    assert!(at_least > 0);
}

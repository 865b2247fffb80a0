//! One suite for all engines: the same small problems, the same answers.

use std::time::Instant;

use qcball::map::{RadialCoordinates, caraman};
use qcball::optimize::{Engine, Objective, OptimizeSettings, Outcome, Polish};
use qcball::solid::{ShellSettings, Solid, shell_mesh};
use qcball::{Domain, Vec3, measure, optimize};

struct Problem {
    name: &'static str,
    domain: Domain,
    start: Vec<Vec3>,
}

impl Problem {
    fn new(name: &'static str, solid: Solid, offset: Vec3, subdivisions: u32, layers: u32) -> Self {
        let surface = solid.surface().unwrap();
        let settings = ShellSettings { subdivisions, refinement: None, layers, grading: 1.0 };
        let shell = shell_mesh(&surface, surface.centroid() + offset, &settings).unwrap();
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
fn soft_maxima_agree() {
    for problem in problems() {
        for exponent in [4.0, 8.0] {
            let solve = |engine| {
                let outcome = problem.solve(engine, Objective::SoftMax(exponent), 1e-9);
                outcome.trace.last().unwrap().objective
            };
            let ours = solve(Engine::Newton);
            for engine in [Engine::Lbfgs, Engine::NewtonCg, Engine::TrustRegion] {
                let theirs = solve(engine);
                println!("   {:e}", theirs - ours);
            }
        }
    }
}

#[test]
fn epigraphs_agree() {
    for problem in problems() {
        let ours = problem.max_k(&problem.solve(Engine::Newton, Objective::Max, 1e-6));
        for engine in [Engine::Slsqp, Engine::Mma, Engine::Ccsaq] {
            let theirs = problem.max_k(&problem.solve(engine, Objective::Max, 1e-6));
            println!("   {:e}", theirs / ours - 1.0);
        }
    }
}

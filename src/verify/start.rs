//! What the config makes, made again: the domain and the map started from.

use std::path::Path;

use super::Findings;
use super::files::Files;
use crate::cancel::Cancel;
use crate::config::{Config, ConfigSource, DomainSource, InitialMap, MeshPlan, Plan};
use crate::domain::Domain;
use crate::experiment::{RunError, Start};
use crate::map::{CornerChoice, Corners};
use crate::measure::Summary;
use crate::mesh::io::{read_surface, shown_path};
use crate::mesh::{Subdivision, Vec3};
use crate::optimize::BoundaryValues;
use crate::report::{FLIPPED, HALVED};
use crate::solid::{StarCentre, Surface};

/// Distance, relative to the extent of all positions, within which two are the same: elementary functions differ in their last
/// bits from one machine to the next.
const SAME: f64 = 1e-11;
/// Relative amount by which K may rise from one round of refinement to the next, for its rounding.
const SAME_ROUND: f64 = 1e-9;

/// The run's name, seed and config, and what it started from on the domain of the files.
pub(super) struct Again {
    pub name: String,
    pub seed: u64,
    pub source: ConfigSource,
    pub start: Start,
    /// The start before the mesh was refined where the largest K sat, measured; `None` where none were or it was not made again.
    pub unrefined: Option<Summary>,
    /// Whether the start was made from the config, not taken from the files.
    pub made: bool,
    /// Whether the config lets the boundary slide.
    pub slides: bool,
}

/// Makes the domain and the start from the config and holds the files' against them; nothing if there is no config.
pub(super) fn again(files: &Files, findings: &mut Findings) -> Option<Again> {
    findings.begin("the config makes this domain, and the map started from with its values at the boundary");
    let report = &files.report;
    let source = ConfigSource::of_text(Path::new(&report.config), report.config_text.clone(), &report.overrides);
    let (source, config) = source.map_err(|error| findings.found(format!("config_text is no config: {error}"))).ok()?;
    findings.expect(report.config_hash == source.hash(), || "config_hash is not the hash of config_text".into());
    let slides = config.boundary.values == BoundaryValues::Sliding;
    let as_told = |source| Again {
        name: report.name.clone(),
        seed: report.seed,
        source,
        start: told(files),
        unrefined: None,
        made: false,
        slides,
    };
    let plan = match Plan::of_source(&source, &config) {
        Ok(plan) => plan,
        Err(error) => {
            match missing(&source, &config) {
                Some(file) => findings.trust(format!(
                    "that the domain and the start are those of {file}, which is not here (blake3 {}), and name and seed",
                    report.input_hash.as_deref().unwrap_or("unknown")
                )),
                None => findings.found(format!("config_text cannot be run: {error}")),
            }
            return Some(as_told(source));
        }
    };
    // Where the map without powers was better, it was taken.
    let is_without_powers = plan.corners == CornerChoice::Power && files.corners.is_none();
    let corners_of_plan = if is_without_powers { CornerChoice::Linear } else { plan.corners };
    let plan = Plan { corners: corners_of_plan, ..plan };
    if is_without_powers {
        findings.trust("that powers at the corners give nothing better");
    }
    if report.achieved.untangling.as_ref().is_some_and(|untangling| untangling.refinement_splits > 0) {
        findings
            .trust("that the domain is the config's with edges halved where tets resisted untangling, and its start");
        return Some(as_told(source));
    }
    let refined = &report.achieved.refined;
    findings.expect(refined.is_some() == plan.refine.is_some(), || {
        "the report has rounds of refinement that the config does not ask for, or lacks them".into()
    });
    rounds(files, findings);
    let external = matches!(plan.mesh, MeshPlan::External(_))
        || report.domain.centre.is_none() && matches!(plan.mesh, MeshPlan::Auto { .. });
    let unrefined = if external && !files.changes.is_empty() {
        let mesh = Subdivision::before(files.domain.mesh(), &files.changes);
        let Some(unrefined) = mesh.map(Domain::new).and_then(Result::ok) else {
            findings.found(format!(
                "domain.vtu did not come from any mesh by the halvings of {HALVED} and the flips of {FLIPPED}"
            ));
            return Some(as_told(source));
        };
        unrefined
    } else {
        files.domain.clone()
    };
    let (least, there) = (least_tets(&plan, report.domain.centre.is_some()), files.cells.len());
    if least > there {
        findings.found(format!("the config makes a mesh of at least {least} tets, but cells.csv has {there}"));
        return Some(as_told(source));
    }
    let start = match make(&plan, files, unrefined, findings) {
        Ok(start) => {
            let start = if is_without_powers { start.told_to_be_without_powers() } else { start };
            start.told_by(&report.map.map).with_exponents_of(files.corners.as_ref())
        }
        Err(error) => {
            findings.found(format!("the config makes no start: {error}"));
            return Some(as_told(source));
        }
    };
    if let Some(told) = refined {
        let before = start.domain.mesh().tets().len();
        findings.expect(plan.refine.is_some_and(|refine| refine.surface) == told.surface, || {
            "the report's refinement is not the config's, of the surface or inside alone".into()
        });
        findings.expect(told.tets_before == before, || {
            format!("the mesh before the refinement had {before} tets, not {}", told.tets_before)
        });
    }
    let unrefined = (!files.changes.is_empty()).then(|| start.measure(&start.image, &Cancel::default()).summary);
    let start = match start.changed(&files.changes, refined.as_ref().is_some_and(|refined| refined.surface)) {
        Ok(start) => start,
        Err(error) => {
            findings.found(format!("{HALVED} or {FLIPPED} changes what the config's domain does not have: {error}"));
            return Some(as_told(source));
        }
    };
    let [mesh, made] = [&files.domain, &start.domain].map(|domain| domain.mesh());
    if mesh.tets() != made.tets() || mesh.points().len() != made.points().len() {
        let (tets, of_config) = (mesh.tets().len(), made.tets().len());
        findings.found(format!(
            "domain.vtu is not the mesh that the config makes: it has {tets} tets, that one {of_config}, or others"
        ));
        return Some(as_told(source));
    }
    let all = |_: usize| true;
    same(
        "vertex",
        "domain.vtu is not at its place in the config's domain",
        mesh.points(),
        made.points(),
        all,
        findings,
    );
    let on_boundary = files.domain.boundary().vertex_mask();
    if plan.optimize.boundary_values == BoundaryValues::Fixed {
        same(
            "boundary vertex",
            "image.vtu is not at its place in the map started from",
            &files.image,
            &start.image,
            |v| on_boundary[v],
            findings,
        );
    } else {
        // Each step brings a vertex back to its sphere, up to a few bits.
        let off = |v: &usize| {
            let [radius, of_start] = [&files.image, &start.image].map(|image| image[*v].norm());
            on_boundary[*v] && (radius - of_start).abs() > 1e-12 * of_start
        };
        if let Some(vertex) = (0..files.image.len()).find(off) {
            findings.found(format!("boundary vertex {vertex} in image.vtu is not on the sphere"));
        }
    }
    same("vertex", "the start is not at its place in the config's map", &files.start, &start.image, all, findings);
    findings.expect(start.units == files.units, || "the meshes have not the size that the config's have".into());
    corners(&plan, files, start.corners.as_ref(), findings);
    let start = Start { domain: files.domain.clone(), units: files.units, corners: files.corners.clone(), ..start };
    Some(Again { name: plan.name.clone(), seed: plan.seed, source, start, unrefined, made: true, slides })
}

/// Holds the rounds of refinement against the edges that were halved in them and the map that they led to.
fn rounds(files: &Files, findings: &mut Findings) {
    let achieved = &files.report.achieved;
    let Some(refined) = &achieved.refined else {
        return findings
            .expect(files.changes.is_empty(), || format!("{HALVED} is of a refinement that the report does not have"));
    };
    let edges: usize = refined.rounds.iter().map(|round| round.edges).sum();
    let names = |count: usize| if count == 0 { "is missing or empty".into() } else { format!("names {count}") };
    findings.expect(edges == files.changes.halved.len(), || {
        let edges = if edges == 1 { "1 edge".into() } else { format!("{edges} edges") };
        format!("the rounds have halved {edges}, but {HALVED} {}", names(files.changes.halved.len()))
    });
    let [flipped, of_files]: [usize; 2] = [
        refined.rounds.iter().map(|round| round.flipped).sum(),
        files.changes.flips.iter().map(|flips| flips.old.len()).sum(),
    ];
    findings.expect(flipped == of_files, || {
        let tets = if flipped == 1 { "1 tet".into() } else { format!("{flipped} tets") };
        format!("the rounds have flipped {tets}, but {FLIPPED} {}", names(of_files))
    });
    let tets = refined.rounds.last().map_or(refined.tets_before, |round| round.tets);
    findings.expect(tets == files.cells.len(), || {
        format!("the last round ended with {tets} tets, not {}", files.cells.len())
    });
    // Of the optimizer's own decompositions, as the rows of the trace.
    let mut reached = refined.max_k_before.unwrap_or(f64::INFINITY);
    for (index, round) in refined.rounds.iter().enumerate() {
        findings.expect(round.max_k <= reached * (1.0 + SAME_ROUND), || {
            format!("K rises in round {index} of the refinement")
        });
        reached = round.max_k;
    }
    findings
        .trust("which tets the rounds of refinement were made for, and what the rounds before the last had reached");
}

/// Holds the warped cones against those that the config makes, and their exponents against those it gives.
fn corners(plan: &Plan, files: &Files, made: Option<&Corners>, findings: &mut Findings) {
    let cones = |corners: &Corners| corners.cones().iter().map(|cone| (cone.corner, cone.base)).collect::<Vec<_>>();
    let there = files.corners.as_ref();
    let same = there.map(cones) == made.map(cones) && there.map(Corners::of_tets) == made.map(Corners::of_tets);
    findings.expect(same, || "the cones at the corners are not those that the config makes".into());
    match plan.corners {
        CornerChoice::Linear => {}
        CornerChoice::Power => findings.trust("that no exponents at the corners are better"),
        CornerChoice::Exponent(exponent) => {
            let given = there.is_some_and(|corners| corners.cones().iter().all(|cone| cone.exponent == exponent));
            findings.expect(given, || format!("the exponents at the corners are not {exponent}, as the config has it"));
        }
    }
}

/// The start of a plan. External meshers are not run again: the mesh that the files have, before edges were halved, is held against the
/// solid.
fn make(plan: &Plan, files: &Files, unrefined: Domain, findings: &mut Findings) -> Result<Start, RunError> {
    match (&plan.domain, &plan.mesh) {
        (DomainSource::Solid(_) | DomainSource::Surface(_), MeshPlan::External(settings)) => {
            findings.trust(format!(
                "that {} made the tets, of which only that they fill the solid was checked, and the splits",
                settings.mesher
            ));
            let start = Start::on(plan, settings, unrefined, files.units[0])?;
            Ok(Start { splits: files.report.achieved.splits, ..start })
        }
        // Shells have a star centre.
        (DomainSource::Solid(_) | DomainSource::Surface(_), MeshPlan::Auto { external, .. })
            if files.report.domain.centre.is_none()
                && !matches!(plan.map, InitialMap::Formula(_) | InitialMap::Spherical { .. }) =>
        {
            findings.trust(
                "that TetGen or Gmsh made the tets, of which only that they fill the solid was checked, and the splits",
            );
            let start = Start::on(plan, external, unrefined, files.units[0])?;
            Ok(Start { splits: files.report.achieved.splits, warnings: files.report.warnings.clone(), ..start })
        }
        // Which of the two it is depends on the programs of a machine, where a solid is barely star-shaped.
        (DomainSource::Solid(_) | DomainSource::Surface(_), MeshPlan::Auto { shell, .. })
            if files.report.domain.centre.is_some() =>
        {
            Start::of(&Plan { mesh: MeshPlan::Shell(shell.clone()), ..plan.clone() })
        }
        _ => Start::of(plan),
    }
}

/// A number of tets that no mesh by the config has fewer of: a mistaken key may ask for a hundred million. Shells have a star centre, and
/// a config that leaves the mesher open may have called another.
fn least_tets(plan: &Plan, has_centre: bool) -> usize {
    let surface = match &plan.domain {
        DomainSource::Solid(solid) => solid.surface().ok(),
        DomainSource::Surface(path) => {
            read_surface(path).ok().and_then(|soup| Surface::repaired(soup, &plan.repair).ok())
        }
        DomainSource::Mesh(_) => None,
    };
    match (&plan.mesh, surface) {
        (MeshPlan::Shell(settings) | MeshPlan::Auto { shell: settings, .. }, Some(surface)) if has_centre => {
            settings.least_tets(&surface)
        }
        // A tetrahedron has 24 flags, and no solid has fewer.
        (MeshPlan::Flag(settings), _) => 24_usize.saturating_mul(settings.tets_a_flag()),
        _ => 0,
    }
}

/// The config's file of the domain, if it is not where the config says.
fn missing(source: &ConfigSource, config: &Config) -> Option<String> {
    let path = source.path().parent().unwrap_or(Path::new("")).join(config.domain.file.as_ref()?);
    (!path.is_file()).then(|| shown_path(&path))
}

/// The start as the files tell it.
fn told(files: &Files) -> Start {
    let (report, unit) = (&files.report, files.units[0]);
    let centre = report.domain.centre.zip(report.domain.kernel_radius).zip(report.domain.smallest_angle);
    Start {
        origin: report.domain.solid.clone(),
        input_hash: report.input_hash.clone(),
        domain: files.domain.clone(),
        units: files.units,
        centre: centre.map(|((position, kernel_radius), angle)| StarCentre {
            position: position.map(|x| unit.take(x, 1)).into(),
            kernel_radius: unit.take(kernel_radius, 1),
            smallest_angle: angle.to_radians(),
        }),
        image: files.start.clone(),
        second: None,
        may_be_spherical: false,
        may_have_collar: false,
        map: report.map.clone(),
        refinement: report.refinement,
        splits: report.achieved.splits,
        flags: None,
        corners: files.corners.clone(),
        symmetric: false,
        warnings: Vec::new(),
    }
}

/// Expects the positions of the vertices that are `wanted` to be the same.
fn same(
    what: &str,
    fault: &str,
    there: &[Vec3],
    made: &[Vec3],
    wanted: impl Fn(usize) -> bool,
    findings: &mut Findings,
) {
    let extent = made.iter().map(|point| point.amax()).fold(0.0, f64::max);
    for (vertex, (there, made)) in there.iter().zip(made).enumerate().filter(|(vertex, _)| wanted(*vertex)) {
        let away = (there - made).norm();
        // Found as well if it is NaN.
        findings.expect(away <= SAME * extent, || format!("{what} {vertex} of {fault}, but {away:.1e} away"));
    }
}

//! Optimising a map given by two meshes, whatever its target: QIS's inputs work as they are.

use std::path::Path;
use std::time::Instant;

use super::error::{Fault, RunError};
use super::record::Course;
use super::{interrupted, measuring_from_now};
use crate::bound::{self, confront};
use crate::domain::Domain;
use crate::measure::measure_onto_ball_until;
use crate::mesh::io::{CellData, ReadError, TetFile, read_tet_file, read_tets, shown_path};
use crate::mesh::{TetMesh, TetSoup, Unit, Vec3, full_boundary};
use crate::optimize::{BoundaryValues, Freed, OptimizeSettings, Polish, Tangled, TraceRow};
use crate::refine::{RefineSettings, RefinedMap, Unrefined, refine};
use crate::report::{BallFigures, MapReport, RefinedFigures, Splits, Times, UntanglingFigures};

/// A map given by two files: a mesh and the same mesh with moved vertices.
#[derive(Debug)]
pub struct GivenMap {
    /// The domain; of any topology.
    pub domain: Domain,
    /// Image positions.
    pub image: Vec<Vec3>,
    /// How many tets the domain's file stores with negative orientation; two vertices of each were exchanged.
    pub exchanged: usize,
    /// The units in which lengths of the domain and of the image are counted here.
    pub units: [Unit; 2],
    /// Which vertices of the files are those of the domain, in their order; the others belong to no tet.
    pub kept: Vec<bool>,
    /// The scalar arrays on the tets of the domain's file, as they stand there.
    pub cell_data: CellData,
    /// What was done to the domain's file that nobody asked for, a sentence each without its full stop.
    pub notes: Vec<String>,
}

impl GivenMap {
    /// Reads a mesh and its image. The map is given by the vertices: in which order a tet names its four is of no account
    /// in either file, and a mesh of negative tets is taken like the same mesh turned positive.
    ///
    /// # Errors
    /// A file that cannot be read, meshes of different connectivity, or a domain with a flat tet.
    pub fn read(rest: &Path, image: &Path) -> Result<Self, RunError> {
        let (TetFile { soup: first, cell_data, .. }, second) = (read_tet_file(rest)?, read_tets(image)?);
        if let Some(difference) = difference(&first, &second) {
            return Err(RunError::Mismatch { rest: rest.into(), image: image.into(), difference });
        }
        let kept = first.named_vertices();
        let [mut first, mut second] = [first.tidied(), second.tidied()];
        let units = [&mut first, &mut second].map(|soup| {
            let unit = Unit::of(&soup.points);
            soup.points = unit.take_points(&soup.points);
            unit
        });
        let origin = shown_path(rest);
        let (mesh, exchanged) =
            TetMesh::from_either_orientation(first.points, first.tets).map_err(RunError::at(&origin))?;
        let domain = Domain::any_topology(mesh).map_err(RunError::at(&origin))?;
        Ok(Self { domain, image: second.points, exchanged, units, kept, cell_data, notes: first.notes })
    }
}

fn difference(rest: &TetSoup, image: &TetSoup) -> Option<String> {
    let counts = |what: &str, a: usize, b: usize| (a != b).then(|| format!("the first has {a} {what}, the second {b}"));
    counts("vertices", rest.points.len(), image.points.len())
        .or_else(|| counts("tets", rest.tets.len(), image.tets.len()))
        .or_else(|| {
            let (tet, (a, b)) = rest.tets.iter().zip(&image.tets).enumerate().find(|(_, (a, b))| {
                let (mut a, mut b) = (**a, **b);
                a.sort_unstable();
                b.sort_unstable();
                a != b
            })?;
            // As the files count them.
            let [a, b] = [a, b].map(|tet| tet.map(|v| u64::from(v.0) + 1));
            Some(format!("tet {} has the vertices {a:?} in the first, {b:?} in the second (counted from 1)", tet + 1))
        })
}

/// Reads which vertices are fixed: numbers counted from 0, separated by white space; `#` starts a comment. As in QIS, a first
/// line with a comment holds the count of the numbers that follow.
///
/// # Errors
/// What is no vertex number, with its line; a count that does not agree.
pub fn read_locks(path: &Path, vertices: usize) -> Result<Vec<bool>, ReadError> {
    let text = std::fs::read_to_string(path).map_err(|source| ReadError::Open { path: path.into(), source })?;
    let malformed =
        |line: usize, message: String| ReadError::Malformed { path: path.into(), line: Some(line), message };
    let mut fixed = vec![false; vertices];
    let (mut promised, mut found) = (None, 0);
    for (number, line) in text.lines().enumerate() {
        let (words, commented) = match line.split_once('#') {
            Some((words, _)) => (words, true),
            None => (line, false),
        };
        for word in words.split_whitespace() {
            let value: usize = word.parse().map_err(|_| {
                malformed(number + 1, format!("{word:?} is no vertex number; give whole numbers, counted from 0"))
            })?;
            if number == 0 && commented {
                promised = Some(value);
                continue;
            }
            let Some(slot) = fixed.get_mut(value) else {
                let message = format!("vertex {value} does not exist; the mesh has {vertices}, counted from 0");
                return Err(malformed(number + 1, message));
            };
            *slot = true;
            found += 1;
        }
    }
    match promised {
        Some(count) if count != found => {
            Err(malformed(1, format!("{count} vertices are promised, but {found} numbers follow")))
        }
        _ if found == 0 => Err(malformed(
            1,
            "no vertex is named; without fixed vertices a map only drifts: name some, or leave the file out".into(),
        )),
        _ => Ok(fixed),
    }
}

/// An optimised map.
#[derive(Debug)]
pub struct OptimizedMap {
    /// The record.
    pub report: MapReport,
    /// The domain, split if locked tets had to be freed.
    pub domain: Domain,
    /// The unit in which lengths of the domain are counted here.
    pub unit: Unit,
    /// Image positions, as they were given.
    pub positions: Vec<Vec3>,
    /// One row an iteration.
    pub trace: Vec<TraceRow>,
}

/// Moves the vertices of a map that `fixed` does not hold (the boundary's, if `None`); locked tets are freed by splits that
/// leave the boundary as it is, unless `keep_mesh` or `fixed` is given. With `refinement` the mesh is refined where the largest K
/// sits; only where the boundary's vertices are those that are fixed.
///
/// # Errors
/// A system that cannot be held, or a split that rounding made flat; a bound that the map contradicts, an error of the program.
pub fn optimize_map(
    map: GivenMap,
    fixed: Option<Vec<bool>>,
    keep_mesh: bool,
    settings: &OptimizeSettings,
    refinement: Option<&RefineSettings>,
    observe: &mut dyn FnMut(&TraceRow),
) -> Result<OptimizedMap, Fault> {
    let clock = Instant::now();
    let GivenMap { mut domain, mut image, units: [unit, of_image], .. } = map;
    let mut splits = None;
    if fixed.is_none() && !keep_mesh {
        let full = full_boundary(domain.mesh(), domain.boundary());
        if !full.parents().is_empty() {
            splits = Some(Splits::of(&full, domain.mesh().tets().len()));
            image = full.extend(image);
            domain = Domain::any_topology(full.mesh()?)?;
        }
    }
    let tangled = Tangled { domain, start: image, second: None, fixed: fixed.as_deref(), may_refine: !keep_mesh };
    // One time limit for both, and one polish at their end.
    let timed = settings.starting_now();
    let refinement = refinement.filter(|_| fixed.is_none());
    let polish = if refinement.is_some() { Polish::None } else { settings.polish };
    let (freed, mut outcome) = tangled.free_and_optimize(&OptimizeSettings { polish, ..timed.clone() }, observe)?;
    let Freed { mut domain, mut start, untangled, flipped_before, refinement_splits, .. } = freed;
    let mut refined = None;
    if let Some(refinement) = refinement {
        let tets_before = domain.mesh().tets().len();
        let map = Unrefined { domain, start, outcome, corners: None, centre: None };
        let map = refine(map, &timed, refinement, observe)?;
        let RefinedMap { max_k_before, end, rounds, .. } = map;
        (domain, start, outcome) = (map.domain, map.start, map.outcome);
        let surface = refinement.surface;
        refined = Some(RefinedFigures { tets_before, surface, max_k_before, end, rounds });
    }
    let fixed = fixed.unwrap_or_else(|| domain.boundary().vertex_mask().to_vec());
    let before = measure_onto_ball_until(&domain, &start, &measuring_from_now(settings));
    let after = measure_onto_ball_until(&domain, &outcome.positions, &measuring_from_now(settings));
    let boundary_is_fixed = domain.boundary().vertex_mask().iter().zip(&fixed).all(|(&on, &fixed)| fixed || !on);
    let mut bounds = if boundary_is_fixed {
        bound::all_until(&domain, &outcome.positions, None, false, &settings.cancel)
    } else {
        Vec::new()
    };
    confront(&bounds, &domain, &outcome.positions, &after.summary, "the files of the domain and of its image")?;
    bounds.iter_mut().for_each(|bound| bound.place = bound.place.take().map(|place| unit.give_back_place(place)));
    let course = Course {
        untangling: UntanglingFigures::of(&domain, flipped_before, &untangled, refinement_splits),
        refined,
        stop: interrupted(&settings.cancel).unwrap_or(outcome.stop),
        kkt: outcome.kkt,
        tolerance: Some(settings.effort.accuracy(settings.tolerance)),
        iterations: outcome.trace.len().saturating_sub(1),
        times: Times::since(clock, untangled.seconds),
    };
    // What slides is not fixed.
    let slides = settings.boundary_values == BoundaryValues::Sliding;
    let held = |v: usize| fixed[v] && !(slides && domain.boundary().vertex_mask()[v]);
    let ball = BallFigures::of(&domain, &outcome.positions, &bounds, &after.summary);
    let report = MapReport {
        vertices: domain.mesh().points().len(),
        tets: domain.mesh().tets().len(),
        locked: domain.mesh().tets().iter().filter(|tet| tet.iter().all(|v| held(v.index()))).count(),
        fixed: (0..fixed.len()).filter(|&v| held(v)).count(),
        achieved: course.achieved(splits, (&before, &after), bounds, ball, slides),
    };
    let positions = of_image.give_back_points(&outcome.positions);
    Ok(OptimizedMap { report, domain, unit, positions, trace: outcome.trace })
}

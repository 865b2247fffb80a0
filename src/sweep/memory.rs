//! Whether there is memory for another case.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::cancel::Cancel;
use crate::config::{DomainSource, MeshPlan, Plan};
use crate::mesh::io::{SolidFile, read_solid, read_surface};
use crate::solid::{ExternalSettings, Refinement, ShellSettings, Surface};

/// Bytes a tet, and up to how many tets: 3.4 to 3.8 kB were measured on meshes of 10,000 to 100,000 tets (results/bench.md).
const PER_TET: f64 = 4096.0;
const FACTORED: f64 = 1e5;
/// Bytes of each tet beyond: what is solved for directly at once grows no more. Meshes of a million take 1.2 kB a tet in all.
const PER_TET_BEYOND: f64 = 1400.0;
/// What the smallest case needs, in bytes.
const LEAST: f64 = 8.0 * 1024.0 * 1024.0;
/// Time after which memory is looked at again: other programs free some without telling.
const LOOK_AGAIN: Duration = Duration::from_millis(500);

/// Bytes that a case is likely to need; an estimate by its number of tets.
pub(super) fn estimate(plan: &Plan) -> u64 {
    of_tets(tets(plan).unwrap_or(0.0))
}

/// Bytes that a run on so many tets is likely to need.
pub(crate) fn memory_of(tets: usize) -> u64 {
    of_tets(tets as f64)
}

fn of_tets(tets: f64) -> u64 {
    (LEAST + PER_TET * tets.min(FACTORED) + PER_TET_BEYOND * (tets - FACTORED).max(0.0)) as u64
}

/// The number of tets of a case, as nearly as it is known without meshing; `None` if its input is at fault.
fn tets(plan: &Plan) -> Option<f64> {
    let surface = match &plan.domain {
        DomainSource::Mesh(path) => match read_solid(path).ok()? {
            SolidFile::Tets(soup) => return Some(soup.tets.len() as f64),
            SolidFile::Surface(soup) => Surface::from_soup(soup).ok()?,
        },
        DomainSource::Surface(path) => Surface::repaired(read_surface(path).ok()?, &plan.repair).ok()?,
        DomainSource::Solid(solid) => solid.surface().ok()?,
    };
    Some(match &plan.mesh {
        MeshPlan::Auto { shell, external, .. } => shell_tets(&surface, shell).max(external_tets(&surface, external)),
        MeshPlan::Shell(settings) => shell_tets(&surface, settings),
        // Each triangle has at most six flags of its own.
        MeshPlan::Flag(settings) => 6.0 * surface.triangles().len() as f64 * settings.tets_a_flag() as f64,
        MeshPlan::External(settings) => external_tets(&surface, settings),
    })
}

fn shell_tets(surface: &Surface, settings: &ShellSettings) -> f64 {
    let a_cone = 3.0 * f64::from(settings.layers) - 2.0;
    let subdivided = surface.triangles().len() as f64 * f64::from(settings.subdivisions).powi(2) * a_cone;
    match settings.refinement {
        None => subdivided,
        // A last round of bisections may go beyond by as much again.
        Some(Refinement::Cells(cells)) => subdivided.max(2.0 * cells as f64),
        // The sphere takes at least 450 triangles of the circumradius that goes with K = 1.25; halving makes a few times that.
        Some(Refinement::Ball(_)) => subdivided.max(2500.0 * a_cone),
        // Bisection leaves edges between half the wanted length and all of it: triangles of length^2 / 8 at least.
        Some(Refinement::EdgeLength(length)) => subdivided.max(surface.area() * 8.0 / length.powi(2) * a_cone),
    }
}

fn external_tets(surface: &Surface, settings: &ExternalSettings) -> f64 {
    // A regular tet has the volume edge^3 / (6 sqrt 2); those of a mesher are about half as large as asked for.
    let edge_volume = settings.sizing.map_or(f64::INFINITY, |sizing| sizing.edge_length.powi(3) / 72f64.sqrt());
    let volume = edge_volume.min(settings.max_volume.unwrap_or(f64::INFINITY));
    let near_features = settings.sizing.map_or(0.0, |sizing| surface.area() / sizing.feature_edge_length.powi(2));
    2.0 * surface.volume() / volume + 8.0 * near_features + 8.0 * surface.triangles().len() as f64
}

/// Bytes that processes can have without swapping; `None` where the system does not tell.
fn available() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    Some(1024 * line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?)
}

/// Lets cases start as there is memory for them.
pub(super) struct MemoryGate {
    held: Mutex<Held>,
    changed: Condvar,
    available: fn() -> Option<u64>,
}

/// The cases that run.
#[derive(Default)]
struct Held {
    cases: usize,
    bytes: u64,
    /// What was there before the first of them.
    budget: u64,
}

/// Why a case may not start.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Refusal {
    /// It needs more than there is, though no other case runs.
    TooLarge { needed: u64, available: u64 },
    /// The sweep is at its end.
    Cancelled,
}

impl MemoryGate {
    pub(super) fn new() -> Self {
        Self { held: Mutex::default(), changed: Condvar::new(), available }
    }

    fn held(&self) -> MutexGuard<'_, Held> {
        // A count is right whatever panicked beside it.
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until there is memory for a case that needs so much; it is held until the permit is dropped.
    pub(super) fn enter(&self, needed: u64, cancel: &Cancel) -> Result<Permit<'_>, Refusal> {
        let mut held = self.held();
        loop {
            if cancel.is_raised() {
                return Err(Refusal::Cancelled);
            }
            let available = (self.available)().unwrap_or(u64::MAX);
            if held.cases == 0 {
                if needed > available {
                    return Err(Refusal::TooLarge { needed, available });
                }
                held.budget = available;
            }
            // The others may not have taken yet what they will need.
            if needed <= available && held.bytes.saturating_add(needed) <= held.budget {
                held.cases += 1;
                held.bytes += needed;
                return Ok(Permit { gate: self, needed });
            }
            held = self.changed.wait_timeout(held, LOOK_AGAIN).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

/// Memory held for a case.
pub(super) struct Permit<'a> {
    gate: &'a MemoryGate,
    needed: u64,
}

impl Drop for Permit<'_> {
    fn drop(&mut self) {
        let mut held = self.gate.held();
        held.cases -= 1;
        held.bytes -= self.needed;
        drop(held);
        self.gate.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(lines: &str) -> Plan {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.toml");
        std::fs::write(&path, format!("[domain]\nsolid = \"cube\"\n[mesh]\n{lines}\n")).unwrap();
        Plan::read(&path, &[]).unwrap()
    }

    #[test]
    fn shell_meshes_are_counted_and_others_estimated() {
        // 48 cones of 3 * 8 - 2 tets, each surface triangle split into 4.
        assert_eq!(tets(&plan("subdivisions = 2\nlayers = 8")), Some(48.0 * 4.0 * 22.0));
        assert!(tets(&plan("cells = 100_000")).unwrap() >= 1e5);
        // No refinement stops before its edges are short enough: 24 area units in triangles of at most length^2 / 2.
        assert!(tets(&plan("layers = 1\nedge_length = 0.1")).unwrap() >= 24.0 / 0.005);
        // The volume 8 in tets no larger than 0.001.
        assert!(tets(&plan("kind = \"tetgen\"\nmax_volume = 0.001")).unwrap() >= 8000.0);
        assert!(estimate(&plan("cells = 1_000_000")) > 4 * estimate(&plan("cells = 100_000")));
    }

    #[test]
    fn a_case_waits_for_memory_and_one_that_never_fits_is_refused() {
        let gate = MemoryGate { available: || Some(100), ..MemoryGate::new() };
        let cancel = Cancel::default();
        assert_eq!(gate.enter(101, &cancel).err(), Some(Refusal::TooLarge { needed: 101, available: 100 }));
        let first = gate.enter(60, &cancel).ok().unwrap();
        let second = gate.enter(40, &cancel).ok().unwrap();
        std::thread::scope(|scope| {
            let third = scope.spawn(|| gate.enter(50, &cancel).map(|_| ()));
            drop(second);
            assert!(!third.is_finished(), "60 + 50 are more than 100");
            drop(first);
            assert_eq!(third.join().unwrap(), Ok(()));
        });
        let _all = gate.enter(100, &cancel).ok().unwrap();
        cancel.raise();
        assert_eq!(gate.enter(1, &cancel).err(), Some(Refusal::Cancelled));
    }
}

//! The meshers, and which keys of `[mesh]` each takes.

use std::path::{Path, PathBuf};

use super::error::Fault;
use super::limits::{duration, positive, whole};
use super::{MeshKind, MeshTable};
use crate::solid::{ExternalMesher, ExternalSettings, FlagSettings, MOST_TETS, Refinement, ShellSettings, Sizing};

/// How a solid is filled with tets.
#[derive(Clone, Debug, PartialEq)]
pub enum MeshPlan {
    /// Shells where the solid is star-shaped, else TetGen where it is installed, else Gmsh.
    Auto {
        /// What shells are made of.
        shell: ShellSettings,
        /// What TetGen is asked for, and Gmsh where there is none.
        external: ExternalSettings,
        /// Keys that only shells take.
        shell_keys: Vec<&'static str>,
    },
    /// Cones over the surface triangles, cut into layers.
    Shell(ShellSettings),
    /// Cones over the flags of a polyhedron.
    Flag(FlagSettings),
    /// A program of its own.
    External(ExternalSettings),
}

/// Largest value of `cells`: a tenth below the most tets of a shell mesh, since the last halvings go beyond what is wished.
const MOST_CELLS: i64 = MOST_TETS as i64 / 10 * 9;

const BY_LENGTH: &[MeshKind] = &[MeshKind::Auto, MeshKind::Shell, MeshKind::Tetgen, MeshKind::Gmsh];
const SHELL: &[MeshKind] = &[MeshKind::Auto, MeshKind::Shell];
const FLAG: &[MeshKind] = &[MeshKind::Flag];
const LAYERED: &[MeshKind] = &[MeshKind::Auto, MeshKind::Shell, MeshKind::Flag];
const EXTERNAL: &[MeshKind] = &[MeshKind::Auto, MeshKind::Tetgen, MeshKind::Gmsh];
const NAMED: &[MeshKind] = &[MeshKind::Tetgen, MeshKind::Gmsh];
const TETGEN: &[MeshKind] = &[MeshKind::Tetgen];

/// One row a key: its name, whether it was given, and the meshers it belongs to.
fn keys(table: &MeshTable) -> [(&'static str, bool, &'static [MeshKind]); 15] {
    [
        ("subdivisions", table.subdivisions.is_some(), SHELL),
        ("edge_length", table.edge_length.is_some(), BY_LENGTH),
        ("cells", table.cells.is_some(), SHELL),
        ("layers", table.layers.is_some(), LAYERED),
        ("grading", table.grading.is_some(), LAYERED),
        ("layer_grading", table.layer_grading.is_some(), FLAG),
        ("sectors", table.sectors.is_some(), FLAG),
        ("rings", table.rings.is_some(), FLAG),
        ("feature_edge_length", table.feature_edge_length.is_some(), EXTERNAL),
        ("feature_growth", table.feature_growth.is_some(), EXTERNAL),
        ("max_volume", table.max_volume.is_some(), EXTERNAL),
        ("quality", table.quality.is_some(), TETGEN),
        ("keep_boundary", table.keep_boundary.is_some(), EXTERNAL),
        ("program", table.program.is_some(), NAMED),
        ("program_time_limit", table.program_time_limit.is_some(), EXTERNAL),
    ]
}

/// The first key that was given, if any.
pub(super) fn first_given(table: &MeshTable) -> Option<&'static str> {
    let kind = (table.kind != MeshKind::Auto).then_some("kind");
    kind.or_else(|| keys(table).into_iter().find(|(_, given, _)| *given).map(|(key, ..)| key))
}

/// What a checked `[mesh]` means; relative paths are below the config's folder.
pub(super) fn plan(table: &MeshTable, config_path: &Path) -> Result<MeshPlan, Fault> {
    for (key, given, owners) in keys(table) {
        if given && !owners.contains(&table.kind) {
            let owners: Vec<String> = owners.iter().map(|owner| format!("kind = \"{}\"", spelled(*owner))).collect();
            let message = format!("`{key}` is no key of the mesher {}", spelled(table.kind));
            return Err(Fault::at(&["mesh", key], message, format!("remove it, or choose {}", owners.join(" or "))));
        }
    }
    match table.kind {
        MeshKind::Auto => Ok(MeshPlan::Auto {
            shell: shell(table)?,
            external: external(table, ExternalMesher::TetGen, config_path)?,
            shell_keys: keys(table)
                .into_iter()
                .filter(|(_, given, owners)| *given && !owners.contains(&MeshKind::Tetgen))
                .map(|(key, ..)| key)
                .collect(),
        }),
        MeshKind::Shell => shell(table).map(MeshPlan::Shell),
        MeshKind::Flag => flag(table).map(MeshPlan::Flag),
        MeshKind::Tetgen => external(table, ExternalMesher::TetGen, config_path).map(MeshPlan::External),
        MeshKind::Gmsh => external(table, ExternalMesher::Gmsh, config_path).map(MeshPlan::External),
    }
}

/// A mesher's name as it stands in a config.
fn spelled(kind: MeshKind) -> &'static str {
    match kind {
        MeshKind::Auto => "auto",
        MeshKind::Shell => "shell",
        MeshKind::Flag => "flag",
        MeshKind::Tetgen => "tetgen",
        MeshKind::Gmsh => "gmsh",
    }
}

fn shell(table: &MeshTable) -> Result<ShellSettings, Fault> {
    let refinement = match (table.edge_length, table.cells) {
        (Some(_), Some(_)) => {
            let message = "both `edge_length` and `cells` say how far to refine".to_string();
            return Err(Fault::at(&["mesh", "cells"], message, "keep one of them"));
        }
        (Some(length), None) => Some(Refinement::EdgeLength(positive(Some(length), 0.1, &["mesh", "edge_length"])?)),
        (None, Some(cells)) => Some(Refinement::Cells(whole(Some(cells), 10_000, 1..=MOST_CELLS, &["mesh", "cells"])?)),
        // Whoever says nothing of the surface's fineness wants a ball, which an inscribed polyhedron is not by itself.
        (None, None) if table.subdivisions.is_none() => Some(Refinement::USUAL),
        (None, None) => None,
    };
    Ok(ShellSettings {
        subdivisions: whole(table.subdivisions, 1, 1..=1000, &["mesh", "subdivisions"])?,
        refinement,
        layers: whole(table.layers, 8, 1..=10_000, &["mesh", "layers"])?,
        grading: positive(table.grading, 1.0, &["mesh", "grading"])?,
    })
}

fn flag(table: &MeshTable) -> Result<FlagSettings, Fault> {
    let usual = FlagSettings::default();
    let number = |given, usual: u32, key| whole(given, usual.into(), 1..=1000, &["mesh", key]);
    let grading = positive(table.grading, usual.grading, &["mesh", "grading"])?;
    Ok(FlagSettings {
        sectors: number(table.sectors, usual.sectors, "sectors")?,
        rings: number(table.rings, usual.rings, "rings")?,
        layers: number(table.layers, usual.layers, "layers")?,
        grading,
        layer_grading: positive(table.layer_grading, grading, &["mesh", "layer_grading"])?,
    })
}

fn external(table: &MeshTable, mesher: ExternalMesher, config_path: &Path) -> Result<ExternalSettings, Fault> {
    let optional = |given: Option<f64>, example, key| {
        given.map(|number| positive(Some(number), example, &["mesh", key])).transpose()
    };
    let usual = ExternalSettings::new(mesher);
    let quality = match table.quality {
        Some(ratio) if !(ratio.is_finite() && ratio > 1.0) => {
            let message = format!("`mesh.quality` is {ratio}, but must be finite and greater than 1");
            let help = "it is the largest ratio of circumradius to shortest edge, for example 1.4; smaller is better";
            return Err(Fault::at(&["mesh", "quality"], message, help));
        }
        quality => quality,
    };
    Ok(ExternalSettings {
        program: table.program.as_ref().map(|program| resolved(program, config_path)).transpose()?,
        max_volume: optional(table.max_volume, 0.001, "max_volume")?,
        quality,
        keep_boundary: table.keep_boundary.unwrap_or(usual.keep_boundary),
        sizing: sizing(table)?,
        time_limit: match table.program_time_limit {
            Some(seconds) => duration(seconds, 120.0, &["mesh", "program_time_limit"])?,
            None => usual.time_limit,
        },
        ..usual
    })
}

fn sizing(table: &MeshTable) -> Result<Option<Sizing>, Fault> {
    let edge_length = positive(table.edge_length, f64::INFINITY, &["mesh", "edge_length"])?;
    let growth = positive(table.feature_growth, Sizing::GROWTH, &["mesh", "feature_growth"])?;
    let Some(feature_edge_length) = table.feature_edge_length else {
        if table.feature_growth.is_some() {
            let message = "`feature_growth` says nothing without `feature_edge_length`".to_string();
            return Err(Fault::at(&["mesh", "feature_growth"], message, "add for example feature_edge_length = 0.05"));
        }
        return Ok(table.edge_length.map(|_| Sizing::uniform(edge_length)));
    };
    let key = ["mesh", "feature_edge_length"];
    let feature_edge_length = positive(Some(feature_edge_length), 0.05, &key)?;
    if feature_edge_length > edge_length {
        let message = format!(
            "`mesh.feature_edge_length` is {feature_edge_length}, more than `mesh.edge_length`, which is {edge_length}"
        );
        return Err(Fault::at(&key, message, "sharp edges can be meshed more finely than the rest, not more coarsely"));
    }
    Ok(Some(Sizing { edge_length, feature_edge_length, growth }))
}

/// A program: a bare name is left to PATH, anything else is a path.
fn resolved(program: &str, config_path: &Path) -> Result<PathBuf, Fault> {
    let path = Path::new(program);
    match path.components().count() {
        0 => {
            let help = "give a name on PATH or a path; without the key, the usual name is looked up on PATH";
            Err(Fault::at(&["mesh", "program"], "`mesh.program` is empty".to_string(), help))
        }
        1 => Ok(path.to_path_buf()),
        _ => Ok(config_path.parent().unwrap_or(Path::new("")).join(path)),
    }
}

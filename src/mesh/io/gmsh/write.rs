//! `.msh` as text, written; numbers have as many digits as tell them from all others.

use std::io::{self, Write};
use std::path::Path;

use super::elements::TETRAHEDRON;
use crate::mesh::io::{CellData, WriteError, write_atomically};
use crate::mesh::{Vec3, VertexId};

/// Writes version 4.1 with one volume, number 1.
pub(in crate::mesh::io) fn write_version_4(
    path: &Path,
    points: &[Vec3],
    tets: &[[VertexId; 4]],
    cell_data: &CellData,
) -> Result<(), WriteError> {
    write_atomically(path, |file| {
        writeln!(file, "$MeshFormat\n4.1 0 8\n$EndMeshFormat")?;
        let blocks = |count: usize| usize::from(count > 0);
        writeln!(file, "$Nodes\n{} {n} {} {n}", blocks(points.len()), blocks(points.len()), n = points.len())?;
        if !points.is_empty() {
            writeln!(file, "3 1 0 {}", points.len())?;
            (1..=points.len()).try_for_each(|tag| writeln!(file, "{tag}"))?;
            points.iter().try_for_each(|p| writeln!(file, "{:?} {:?} {:?}", p.x, p.y, p.z))?;
        }
        writeln!(file, "$EndNodes\n$Elements")?;
        writeln!(file, "{} {n} {} {n}", blocks(tets.len()), blocks(tets.len()), n = tets.len())?;
        if !tets.is_empty() {
            writeln!(file, "3 1 {TETRAHEDRON} {}", tets.len())?;
        }
        write_tets(file, tets, "")?;
        writeln!(file, "$EndElements")?;
        write_data(file, cell_data)
    })
}

/// Writes version 2.2; every tet has the physical and the elementary label 1.
pub(in crate::mesh::io) fn write_version_2(
    path: &Path,
    points: &[Vec3],
    tets: &[[VertexId; 4]],
    cell_data: &CellData,
) -> Result<(), WriteError> {
    write_atomically(path, |file| {
        writeln!(file, "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{}", points.len())?;
        for (tag, p) in (1..).zip(points) {
            writeln!(file, "{tag} {:?} {:?} {:?}", p.x, p.y, p.z)?;
        }
        writeln!(file, "$EndNodes\n$Elements\n{}", tets.len())?;
        write_tets(file, tets, "4 2 1 1 ")?;
        writeln!(file, "$EndElements")?;
        write_data(file, cell_data)
    })
}

/// One line a tet: its tag, what the version puts there, the tags of its nodes.
fn write_tets(file: &mut dyn Write, tets: &[[VertexId; 4]], between: &str) -> io::Result<()> {
    for (tag, tet) in (1..).zip(tets) {
        let [a, b, c, d] = tet.map(|v| u64::from(v.0) + 1);
        writeln!(file, "{tag} {between}{a} {b} {c} {d}")?;
    }
    Ok(())
}

/// The same in both versions: name, time 0, time step 0, one component, count.
fn write_data(file: &mut dyn Write, cell_data: &CellData) -> io::Result<()> {
    for (name, values) in cell_data {
        writeln!(file, "$ElementData\n1\n\"{name}\"\n1\n0.0\n3\n0\n1\n{}", values.len())?;
        for (tag, value) in (1..).zip(values) {
            writeln!(file, "{tag} {value:?}")?;
        }
        writeln!(file, "$EndElementData")?;
    }
    Ok(())
}

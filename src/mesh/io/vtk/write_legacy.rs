//! Legacy `.vtk`, written: binary, so that positions keep every bit, and version 4.2, which old and new programs read.

use std::io;
use std::path::Path;

use super::cells::TETRA;
use crate::mesh::io::{CellData, WriteError, write_atomically};
use crate::mesh::{Vec3, VertexId};

/// Writes a mesh with scalars on its cells, one number a tet.
pub(in crate::mesh::io) fn write_legacy(
    path: &Path,
    points: &[Vec3],
    tets: &[[VertexId; 4]],
    cell_data: &CellData,
) -> Result<(), WriteError> {
    write_atomically(path, |file| {
        let title = "# vtk DataFile Version 4.2\nwritten by qcball\nBINARY\nDATASET UNSTRUCTURED_GRID";
        writeln!(file, "{title}\nPOINTS {} double", points.len())?;
        points.iter().flatten().try_for_each(|x| file.write_all(&x.to_be_bytes()))?;
        writeln!(file, "\nCELLS {} {}", tets.len(), 5 * tets.len())?;
        for tet in tets {
            file.write_all(&4i32.to_be_bytes())?;
            for v in tet {
                let vertex = i32::try_from(v.0).map_err(|_| io::Error::from(io::ErrorKind::FileTooLarge))?;
                file.write_all(&vertex.to_be_bytes())?;
            }
        }
        writeln!(file, "\nCELL_TYPES {}", tets.len())?;
        tets.iter().try_for_each(|_| file.write_all(&i32::from(TETRA).to_be_bytes()))?;
        writeln!(file)?;
        if !cell_data.is_empty() {
            // A field, not SCALARS: of several SCALARS, VTK reads one unless asked for all.
            writeln!(file, "CELL_DATA {}\nFIELD FieldData {}", tets.len(), cell_data.len())?;
        }
        for (name, values) in cell_data {
            writeln!(file, "{} 1 {} double", encode_name(name), values.len())?;
            values.iter().try_for_each(|value| file.write_all(&value.to_be_bytes()))?;
            writeln!(file)?;
        }
        Ok(())
    })
}

/// The name without white space and other bytes that VTK encodes.
fn encode_name(name: &str) -> String {
    let encode = |byte: u8| match byte {
        b'"' | b'%' => format!("%{byte:02X}"),
        33..=126 => char::from(byte).to_string(),
        _ => format!("%{byte:02X}"),
    };
    name.bytes().map(encode).collect()
}

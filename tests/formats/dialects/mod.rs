//! What people's files look like beside what the formats say: each kind with what is to be read of it, or the refusal.

mod cells;
mod neuroimaging;
mod surfaces;

use std::path::Path;

use qcball::mesh::io::{SolidFile, read_solid};
use qcball::mesh::{TetId, TetMesh, edge_matrix};
use qcball::solid::{RepairSettings, Surface};

/// The cube [0, 1]^3 but for its corner (0, 1, 1), which is (0, 1, 2): of its sides x = 0 and y = 1 stay flat and the top is
/// bent along a diagonal, a fold that the files have as two triangles. Volume 1 + 1/6.
const CORNERS: [[i32; 3]; 8] = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 2]];
const FACES: [&[usize]; 7] =
    [&[0, 3, 2, 1], &[4, 5, 6], &[4, 6, 7], &[0, 1, 5, 4], &[1, 2, 6, 5], &[2, 3, 7, 6], &[3, 0, 4, 7]];
const VOLUME: f64 = 7.0 / 6.0;

/// What a file holds: vertices and triangles of the surface, or vertices and tets, as they are used; the volume; a note.
pub enum Expected {
    Surface(usize, usize, f64, &'static str),
    Tets(usize, usize, f64, &'static str),
    Refused(&'static str),
}
use Expected::{Refused, Surface as IsSurface, Tets};

/// What is found, or how it differs.
fn found(path: &Path) -> Result<(bool, usize, usize, f64, Vec<String>), String> {
    Ok(match read_solid(path).map_err(|error| error.to_string())? {
        SolidFile::Surface(soup) => {
            let surface = Surface::repaired(soup, &RepairSettings::default()).map_err(|error| error.to_string())?;
            let (points, triangles) = (surface.points().len(), surface.triangles().len());
            (true, points, triangles, surface.volume(), surface.notes().to_vec())
        }
        SolidFile::Tets(soup) => {
            let soup = soup.tidied();
            let (mesh, exchanged) =
                TetMesh::from_either_orientation(soup.points, soup.tets).map_err(|error| error.to_string())?;
            assert_eq!(exchanged, 0);
            let volume = |tet| edge_matrix(mesh.corners(TetId(tet))).determinant() / 6.0;
            let volume = (0..mesh.tets().len() as u32).map(volume).sum();
            (false, mesh.points().len(), mesh.tets().len(), volume, soup.notes)
        }
    })
}

/// Names, contents and what is expected.
type Cases = Vec<(&'static str, Vec<u8>, Expected)>;

fn check(cases: &Cases) {
    let folder = tempfile::tempdir().unwrap();
    let mut wrong = Vec::new();
    for (number, (name, bytes, expected)) in cases.iter().enumerate() {
        let path = folder.path().join(format!("{number}-{name}"));
        std::fs::write(&path, bytes).unwrap();
        let found = found(&path);
        let good = match (expected, &found) {
            (Refused(words), Err(message)) => message.contains(words) && message.contains(name),
            (&IsSurface(points, cells, volume, note), Ok(found)) | (&Tets(points, cells, volume, note), Ok(found)) => {
                let notes = found.4.join("\n");
                let noted = if note.is_empty() { notes.is_empty() } else { notes.contains(note) };
                let is_surface = matches!(expected, IsSurface(..));
                (found.0, found.1, found.2) == (is_surface, points, cells) && (found.3 - volume).abs() < 1e-12 && noted
            }
            _ => false,
        };
        if !good {
            wrong.push(format!("{number}-{name}: {found:?}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

fn solid(note: &'static str) -> Expected {
    IsSurface(8, 12, VOLUME, note)
}

/// The lines of vertices, `start x y z end`.
fn vertices(start: &str, end: &str) -> String {
    CORNERS.map(|[x, y, z]| format!("{start}{x} {y} {z}{end}\n")).concat()
}

/// The lines of faces: `start`, their size if that is wanted, the corners counted from `first`.
fn faces(start: &str, sized: bool, first: usize) -> String {
    let line = |face: &&[usize]| {
        let size = if sized { format!("{} ", face.len()) } else { String::new() };
        let corners: Vec<String> = face.iter().map(|corner| (corner + first).to_string()).collect();
        format!("{start}{size}{}\n", corners.join(" "))
    };
    FACES.iter().map(line).collect()
}

/// The triangles of the solid, each with its three corners.
fn triangles() -> Vec<[[i32; 3]; 3]> {
    let fan = |face: &&[usize]| {
        let corners: Vec<[i32; 3]> = face.iter().map(|&corner| CORNERS[corner]).collect();
        (1..corners.len() - 1).map(|i| [corners[0], corners[i], corners[i + 1]]).collect::<Vec<_>>()
    };
    FACES.iter().flat_map(fan).collect()
}

#[test]
fn every_file_is_read_or_refused_as_it_should() {
    check(&all());
}

/// All of them.
pub fn all() -> Cases {
    [surfaces::all(), cells::all(), neuroimaging::all()].into_iter().flatten().collect()
}

#[test]
fn repairs_on_request() {
    let soup = |text: &str| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.obj");
        std::fs::write(&path, text).unwrap();
        match read_solid(&path).unwrap() {
            SolidFile::Surface(soup) => soup,
            SolidFile::Tets(_) => unreachable!("an OBJ holds no tets"),
        }
    };
    let (v, f) = (vertices("v ", ""), faces("f ", false, 1));
    let none = RepairSettings::default();
    // Each triangle with corners of its own, moved by up to 1e-8.
    let apart: String = triangles()
        .iter()
        .enumerate()
        .map(|(i, corners)| {
            let moved = corners.map(|[x, y, z]| format!("v {} {y} {z}\n", f64::from(x) + 1e-9 * i as f64)).concat();
            moved + "f -3 -2 -1\n"
        })
        .collect();
    assert!(Surface::repaired(soup(&apart), &none).is_err());
    let welded = Surface::repaired(soup(&apart), &RepairSettings { weld: Some(1e-7), ..none }).unwrap();
    assert_eq!((welded.points().len(), welded.triangles().len()), (8, 12));
    assert!(
        (welded.volume() - VOLUME).abs() < 1e-7 && welded.notes()[0].contains("became one"),
        "{:?}",
        welded.notes()
    );

    // A hole of two triangles, and one that the shared corners would close over a bent rim.
    let open = v.clone() + &f.replace("f 2 3 7 6\n", "");
    assert!(Surface::repaired(soup(&open), &none).unwrap_err().to_string().contains("not closed: 4 edges"));
    let filled = Surface::repaired(soup(&open), &RepairSettings { fill_holes: true, ..none }).unwrap();
    assert!((filled.volume() - VOLUME).abs() < 1e-12);
    assert!(filled.notes()[0].starts_with("1 flat hole was filled, "), "{:?}", filled.notes());
    let bent = v.clone() + &f.replace("f 5 6 7\nf 5 7 8\n", "");
    assert!(Surface::repaired(soup(&bent), &RepairSettings { fill_holes: true, ..none }).is_err());

    // A lone triangle beside the solid.
    let two = v + "v 5 5 5\nv 6 5 5\nv 5 6 5\n" + &f + "f 9 10 11\n";
    assert!(Surface::repaired(soup(&two), &none).is_err());
    let largest = Surface::repaired(soup(&two), &RepairSettings { keep_largest: true, ..none }).unwrap();
    assert_eq!((largest.points().len(), largest.triangles().len()), (8, 12));
    assert_eq!(largest.notes(), ["of 2 pieces the largest was kept; 1 triangles of the others were dropped"]);
}

//! Gmsh in batch: a script, the surface inside it or beside it, the result in Medit's format.
//!
//! A boundary that is kept goes in as a discrete surface, which Gmsh does not touch; one that is refined goes in as a
//! plane face for each triangle, so that every new vertex lies on the surface. (Gmsh's own way to remesh a discrete
//! surface, classify and parametrize, moves the boundary of curved solids.)

use std::collections::HashMap;
use std::fmt::Write;
use std::fs;

use super::sizing::SizeGrid;
use super::{ExternalError, ExternalMesher, Job};
use crate::mesh::io::read_medit;
use crate::mesh::{TetSoup, Vec3, VertexId};
use crate::solid::Surface;

const MESHER: ExternalMesher = ExternalMesher::Gmsh;

/// Gmsh's number for its Delaunay mesher: explains what it refuses, but hardly refines over coarse kept triangles.
const DELAUNAY: u32 = 1;
/// Gmsh's number for HXT, which does, but fails without a reason and knows no way out of hard boundaries.
const HXT: u32 = 10;

/// Runs Gmsh: Delaunay, or for a kept boundary HXT and, should that fail, Delaunay.
pub(super) fn mesh(job: &Job, max_volume: Option<f64>) -> Result<TetSoup, ExternalError> {
    if job.settings.keep_boundary {
        match run(job, max_volume, HXT) {
            Err(ExternalError::Failed { .. } | ExternalError::NoMesh { .. }) => {}
            ended => return ended,
        }
    }
    run(job, max_volume, DELAUNAY)
}

fn run(job: &Job, max_volume: Option<f64>, algorithm: u32) -> Result<TetSoup, ExternalError> {
    let units = Units::of(job.surface);
    let write = |name: &str, text: String| fs::write(job.folder.join(name), text).map_err(ExternalError::Files);
    let mut script = if job.settings.keep_boundary {
        write("surface.msh", discrete_surface(job.surface, &units))?;
        String::from("Merge \"surface.msh\";\nSurface Loop(1) = {1};\nVolume(1) = {1};\n")
    } else {
        plane_faces(job.surface, &units)
    };
    let _ = writeln!(script, "Mesh.SaveAll = 1;\nMesh.Algorithm3D = {algorithm};");
    if let Some(volume) = max_volume {
        // The edge of a regular tet of that volume; of tets with such edges the largest has some three times that
        // volume, hence the factor 0.7.
        let edge = (6.0 * 2f64.sqrt() * volume).cbrt() * units.scale;
        let _ = writeln!(script, "Mesh.MeshSizeMax = {:e};", 0.7 * edge);
    }
    if let Some(grid) = &job.sizes {
        write("sizes.txt", sizes(grid, &units))?;
        script += "Mesh.MeshSizeFromPoints = 0;\nMesh.MeshSizeExtendFromBoundary = 0;\nField[1] = Structured;\n\
                   Field[1].FileName = \"sizes.txt\";\nField[1].TextFormat = 1;\nBackground Field = 1;\n";
    }
    write("script.geo", script)?;
    // An earlier run's output would pass for this one's.
    let output = job.folder.join("result.mesh");
    if output.exists() {
        fs::remove_file(&output).map_err(ExternalError::Files)?;
    }
    // One thread, so that the same surface gives the same mesh; errors and warnings only.
    let arguments = ["-3", "-nt", "1", "-v", "2", "-format", "mesh", "-o", "result.mesh", "script.geo"];
    let ended = job.program.run(&arguments, job.folder)?;
    if !ended.status.success() {
        return Err(ExternalError::Failed { mesher: MESHER, status: ended.status.to_string(), words: ended.words });
    }
    if !output.exists() {
        return Err(ExternalError::NoMesh { mesher: MESHER, words: ended.words });
    }
    let mut soup =
        read_medit(&output).map_err(|source| ExternalError::Unreadable { mesher: MESHER, source: source.into() })?;
    if soup.tets.is_empty() {
        return Err(ExternalError::NoMesh { mesher: MESHER, words: ended.words });
    }
    soup.points.iter_mut().for_each(|point| *point = units.out(point));
    Ok(soup)
}

/// Gmsh's tolerances and its 14 digits are absolute: it gets the solid in a box of about 1 at the origin.
struct Units {
    origin: Vec3,
    scale: f64,
}

impl Units {
    fn of(surface: &Surface) -> Self {
        let (low, high) = surface.bounding_box();
        // A power of two rounds nothing.
        Self { origin: low, scale: (high - low).amax().log2().ceil().exp2().recip() }
    }

    fn into(&self, point: &Vec3) -> Vec3 {
        (point - self.origin) * self.scale
    }

    fn out(&self, point: &Vec3) -> Vec3 {
        point / self.scale + self.origin
    }
}

/// The triangles as one surface in Gmsh's format 2.2, the last whose text is simple.
fn discrete_surface(surface: &Surface, units: &Units) -> String {
    let mut text = format!("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{}\n", surface.points().len());
    for (number, p) in (1..).zip(surface.points().iter().map(|p| units.into(p))) {
        let _ = writeln!(text, "{number} {:e} {:e} {:e}", p.x, p.y, p.z);
    }
    let _ = writeln!(text, "$EndNodes\n$Elements\n{}", surface.triangles().len());
    for (number, triangle) in (1..).zip(surface.triangles()) {
        let [a, b, c] = triangle.map(|v| v.0 + 1);
        // Type 2 is a triangle; its two tags are the physical and the geometric surface.
        let _ = writeln!(text, "{number} 2 2 1 1 {a} {b} {c}");
    }
    text + "$EndElements\n"
}

/// Points, lines and a plane face for each triangle.
fn plane_faces(surface: &Surface, units: &Units) -> String {
    let mut text = String::new();
    for (number, p) in (1..).zip(surface.points().iter().map(|p| units.into(p))) {
        let _ = writeln!(text, "Point({number}) = {{{:e}, {:e}, {:e}}};", p.x, p.y, p.z);
    }
    let mut lines: HashMap<[VertexId; 2], i64> = HashMap::new();
    for (number, edge) in (1..).zip(surface.edges()) {
        let [a, b] = edge.vertices;
        let _ = writeln!(text, "Line({number}) = {{{}, {}}};", a.0 + 1, b.0 + 1);
        lines.insert([a, b], number);
        lines.insert([b, a], -number);
    }
    for (number, &[a, b, c]) in (1..).zip(surface.triangles()) {
        let [x, y, z] = [[a, b], [b, c], [c, a]].map(|side| lines[&side]);
        let _ = writeln!(text, "Curve Loop({number}) = {{{x}, {y}, {z}}};\nPlane Surface({number}) = {{{number}}};");
    }
    let _ = writeln!(text, "Surface Loop(1) = {{1:{}}};\nVolume(1) = {{1}};", surface.triangles().len());
    text
}

/// The sizes as the text of a structured field: origin, steps, counts, values.
fn sizes(grid: &SizeGrid, units: &Units) -> String {
    let (origin, step) = (units.into(&grid.origin), grid.step * units.scale);
    let [nx, ny, nz] = grid.counts;
    let mut text =
        format!("{} {} {}\n{} {} {}\n{nx} {ny} {nz}\n", origin.x, origin.y, origin.z, step.x, step.y, step.z);
    for row in grid.sizes.chunks(nz) {
        for size in row {
            let _ = write!(text, "{:e} ", size * units.scale);
        }
        text.push('\n');
    }
    text
}

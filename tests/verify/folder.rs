//! Results folders, and how they are tampered with.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use assert_cmd::cargo::cargo_bin;
use qcball::mesh::io::{DataArray, TetFile, Values, read_tet_file, write_vtu};
use qcball::mesh::{TetMesh, Vec3};
use qcball::{Domain, Report};
use serde_json::{Value, json};

pub fn qcball(arguments: &[&str], folder: &Path) -> (Option<i32>, String) {
    let mut command = Command::new(cargo_bin!("qcball"));
    let output = command.current_dir(env!("CARGO_MANIFEST_DIR")).args(arguments).arg(folder).output().unwrap();
    (output.status.code(), String::from_utf8(output.stdout).unwrap())
}

/// The results of the smoke case with these overrides.
pub fn results(overrides: &[&str]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut arguments = vec!["run", "configs/smoke.toml", "--quiet", "--threads", "1"];
    arguments.extend(overrides.iter().flat_map(|assignment| ["--set", assignment]));
    arguments.push("--out");
    assert_eq!(qcball(&arguments, folder.path()).0, Some(0));
    folder
}

pub fn edit_text(folder: &Path, name: &str, edit: impl FnOnce(String) -> String) {
    let path = folder.join(name);
    let text = fs::read_to_string(&path).unwrap();
    let edited = edit(text.clone());
    assert_ne!(text, edited, "{name} was not changed");
    fs::write(path, edited).unwrap();
}

pub fn report(folder: &Path) -> Report {
    serde_json::from_str(&fs::read_to_string(folder.join("report.json")).unwrap()).unwrap()
}

/// Changes the record, and the summary with it.
pub fn forge(folder: &Path, edit: impl FnOnce(&mut Report)) {
    let mut report = report(folder);
    edit(&mut report);
    fs::write(folder.join("summary.txt"), qcball::report::summary(&report)).unwrap();
    fs::write(folder.join("report.json"), report.to_json()).unwrap();
}

/// Replaces a value of the record, given by its pointer; the summary follows.
pub fn edit_report(folder: &Path, pointer: &str, edit: impl FnOnce(&Value) -> Value) {
    forge(folder, |report| {
        let mut json = json!(report);
        let value = json.pointer_mut(pointer).unwrap_or_else(|| panic!("{pointer} is not in the report"));
        *value = edit(value);
        *report = serde_json::from_value(json).unwrap();
    });
}

pub fn scale(folder: &Path, pointer: &str, factor: f64) {
    edit_report(folder, pointer, |value| json!(value.as_f64().unwrap() * factor));
}

/// The two meshes of a folder.
pub struct Maps {
    pub domain: TetFile,
    pub image: TetFile,
}

impl Maps {
    /// The image positions started from.
    pub fn start(&mut self) -> &mut Vec<Vec3> {
        &mut self.image.point_vectors.iter_mut().find(|(name, _)| name == "start_position").unwrap().1
    }
}

/// Changes the meshes, the copies of positions in the other file with them.
pub fn edit_maps(folder: &Path, edit: impl FnOnce(&mut Maps)) {
    let [domain, image] = ["domain.vtu", "image.vtu"].map(|name| read_tet_file(&folder.join(name)).unwrap());
    let mut maps = Maps { domain, image };
    edit(&mut maps);
    let start = maps.start().clone();
    let Maps { domain, image } = maps;
    let (mesh, _) = TetMesh::from_either_orientation(domain.soup.points.clone(), domain.soup.tets.clone()).unwrap();
    let on_boundary = Domain::any_topology(mesh).unwrap().boundary().vertex_mask().to_vec();
    for (name, file, other_name, other) in
        [("domain.vtu", &domain, "image_position", &image), ("image.vtu", &image, "domain_position", &domain)]
    {
        let point_data = [
            DataArray { name: "boundary", values: Values::Flags(&on_boundary) },
            DataArray { name: other_name, values: Values::Vectors(&other.soup.points) },
            DataArray { name: "start_position", values: Values::Vectors(&start) },
        ];
        let flags: Vec<Vec<bool>> =
            file.cell_data.iter().map(|(_, values)| values.iter().map(|&value| value != 0.0).collect()).collect();
        let cell_data: Vec<DataArray> = file
            .cell_data
            .iter()
            .zip(&flags)
            .map(|((name, values), flags)| DataArray {
                name,
                values: match name.as_str() {
                    "active" | "locked" => Values::Flags(flags),
                    _ => Values::Scalars(values),
                },
            })
            .collect();
        write_vtu(&folder.join(name), &file.soup.points, &file.soup.tets, &point_data, &cell_data).unwrap();
    }
}

/// Changes a field of a row of a table, both counted from 0, the header not counted.
pub fn edit_cell(folder: &Path, name: &str, row: usize, column: usize, edit: impl FnOnce(&str) -> String) {
    edit_text(folder, name, |text| {
        let mut lines: Vec<String> = text.lines().map(String::from).collect();
        let mut fields: Vec<String> = lines[row + 1].split(',').map(String::from).collect();
        fields[column] = edit(&fields[column]);
        lines[row + 1] = fields.join(",");
        lines.join("\n") + "\n"
    });
}

pub type Tampering = (&'static str, fn(&Path), &'static str);

/// Copies the files of a folder; that of plots is made from them and not looked at.
pub fn copy(original: &Path) -> tempfile::TempDir {
    let copy = tempfile::tempdir().unwrap();
    for entry in fs::read_dir(original).unwrap() {
        let path = entry.unwrap().path();
        if path.is_file() {
            fs::copy(&path, copy.path().join(path.file_name().unwrap())).unwrap();
        }
    }
    copy
}

/// Expects that every tampering is found, and told with its word.
pub fn every_one_is_found(original: &Path, tamperings: &[Tampering]) {
    for (what, tamper, word) in tamperings {
        let copy = copy(original);
        tamper(copy.path());
        is_refused(what, copy.path(), word);
    }
}

/// Expects a folder to be refused with a word.
pub fn is_refused(what: &str, folder: &Path, word: &str) {
    let (code, text) = qcball(&["verify", "--json"], folder);
    assert_eq!(code, Some(1), "{what}: {text}");
    let json: Value = serde_json::from_str(&text).unwrap();
    let found = json["discrepancies"].as_array().unwrap();
    assert!(json["verified"] == false && !found.is_empty(), "{what}: {text}");
    assert!(found.iter().any(|line| line.as_str().unwrap().contains(word)), "{what}: no {word:?} in {text}");
}

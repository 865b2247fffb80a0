//! `report.html` through the program, and in a real browser where there is one.
//!
//! The browser is `QCBALL_BROWSER`, or Chromium on the PATH; with `QCBALL_BROWSER_REQUIRED` set its absence is a failure.

mod browser;
mod sweep;
mod viewer;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use assert_cmd::cargo::cargo_bin;
use serde_json::Value;

use browser::Browser;

/// Runs the program in the crate's folder; its exit code and what it said.
fn qcball(arguments: &[&str]) -> (Option<i32>, String) {
    let output = Command::new(cargo_bin!("qcball")).args(arguments).stdin(Stdio::null()).output().unwrap();
    let text = [&output.stdout[..], &output.stderr].concat();
    (output.status.code(), String::from_utf8_lossy(&text).into_owned())
}

/// A run of a small cube, or of a larger one, in a folder of its own.
fn run(folder: &Path, subdivisions: u32, layers: u32, iterations: u32) -> PathBuf {
    let out = folder.join("cube");
    let set = [
        format!("mesh.subdivisions={subdivisions}"),
        format!("mesh.layers={layers}"),
        format!("optimize.max_iterations={iterations}"),
    ];
    let mut arguments = vec!["run", "configs/cube.toml", "--quiet", "--out", out.to_str().unwrap()];
    set.iter().for_each(|assignment| arguments.extend(["--set", assignment]));
    assert_eq!(qcball(&arguments).0, Some(0));
    out
}

/// A sweep of six cases in a folder of its own.
fn sweep(folder: &Path) -> PathBuf {
    let (config, out) = (folder.join("a.toml"), folder.join("sweep"));
    let text = "[domain]\nsolid = \"cube\"\n[mesh]\nsubdivisions = 1\nlayers = 3\n[optimize]\nobjective = \"soft-max\"\nexponent = 4\n\
                [sweep.grid]\n\"domain.solid\" = [\"cube\", \"octahedron\", \"icosahedron\"]\n\"map.exponent\" = [1, 2]\n";
    fs::write(&config, text).unwrap();
    let arguments = ["sweep", config.to_str().unwrap(), "--quiet", "--out", out.to_str().unwrap()];
    assert_eq!(qcball(&arguments).0, Some(0));
    out
}

/// The page and the pictures of a folder, by name.
fn pages(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut paths = vec![folder.join("report.html")];
    paths.extend(fs::read_dir(folder.join("plots")).unwrap().map(|entry| entry.unwrap().path()));
    paths.sort();
    paths.into_iter().map(|path| (path.clone(), fs::read(path).unwrap())).collect()
}

#[test]
fn pages_are_remade_to_the_bit_from_the_other_files() {
    let folder = tempfile::tempdir().unwrap();
    for (made, pictures) in [(run(folder.path(), 1, 3, 20), 4), (sweep(folder.path()), 3)] {
        let before = pages(&made);
        assert_eq!(before.len(), 1 + pictures);
        before.iter().for_each(|(path, _)| fs::remove_file(path).unwrap());
        let (code, said) = qcball(&["report", made.to_str().unwrap()]);
        assert_eq!((code, said.trim_end()), (Some(0), made.join("report.html").to_str().unwrap()));
        assert!(pages(&made) == before, "{}", made.display());
        // Nothing is fetched: the one address that a browser would follow by itself is the empty icon.
        let page = String::from_utf8(before.iter().find(|(path, _)| path.ends_with("report.html")).unwrap().1.clone());
        let page = page.unwrap();
        assert!(!page.contains("<script src") && !page.contains("<img") && page.contains("default-src 'none'"));
    }
}

#[test]
fn folders_and_files_that_are_no_results_are_named_with_exit_code_2() {
    let folder = tempfile::tempdir().unwrap();
    let report = |path: &Path| qcball(&["report", path.to_str().unwrap()]);
    for path in [folder.path().to_path_buf(), folder.path().join("not there")] {
        let (code, said) = report(&path);
        assert!(code == Some(2) && said.contains("holds no results") && said.contains("report.json"), "{said}");
    }
    let made = run(folder.path(), 1, 3, 5);
    let good = |name: &str| fs::read_to_string(made.join(name)).unwrap();
    // Keys and text that this version does not know: no script tag in them ends the page's data.
    let mut strange: Value = serde_json::from_str(&good("report.json")).unwrap();
    strange["limit"]["sentence"] = "</script><b>".into();
    strange["future"] = vec![1].into();
    fs::write(made.join("report.json"), strange.to_string()).unwrap();
    assert_eq!(report(&made).0, Some(0));
    assert!(good("report.html").contains("&lt;/script&gt;&lt;b&gt;"));
    let page = good("report.html");
    let cut = |text: &str| text[..text.len() / 2].to_string();
    for name in ["cells.csv", "trace.csv", "domain.vtu", "image.vtu", "report.json"] {
        let whole = good(name);
        fs::write(made.join(name), cut(&whole).replace("iteration", "iterations")).unwrap();
        let (code, said) = report(&made);
        assert!(code == Some(2) && said.contains(name), "{name}: {said}");
        fs::write(made.join(name), whole).unwrap();
    }
    assert_eq!(good("report.html"), page, "a page that cannot be remade stays as it was");
}

/// The page of a mesh of 100,000 tets has the size that the guide states, 2.6 MB. Its K are all different after a few iterations, which
/// packs them as well as they are ever packed.
#[test]
fn a_large_mesh_makes_a_page_of_the_size_that_is_stated() {
    let folder = tempfile::tempdir().unwrap();
    let made = run(folder.path(), 8, 12, 10);
    let record: Value = serde_json::from_slice(&fs::read(made.join("report.json")).unwrap()).unwrap();
    assert!(record["domain"]["tets"].as_u64().unwrap() > 100_000);
    let page = made.join("report.html");
    let bytes = fs::metadata(&page).unwrap().len();
    assert!((2_450_000..2_750_000).contains(&bytes), "{bytes}");
    if let Some(browser) = Browser::find() {
        let seen = browser.open(&page, "").probe;
        println!("100,000 tets: ready after {} ms, complete after {} ms", seen["ready"], seen["complete"]);
        assert_eq!(seen["errors"], serde_json::json!([]));
    }
}

#[test]
fn a_narrow_window_has_the_image_below_the_domain_and_no_page_wider_than_it() {
    let Some(browser) = Browser::find() else { return };
    let folder = tempfile::tempdir().unwrap();
    let look = "
        seen.narrow = matchMedia('(max-width: 640px)').matches;
        seen.width = [document.documentElement.scrollWidth, innerWidth];
        const box = document.getElementById('viewer');
        seen.rooms = box?.viewer.scenes.map(box.viewer.room).map(({ left, top, height }) => [left, Math.round((top - height) / height)]);
    ";
    for page in [run(folder.path(), 1, 3, 5), sweep(folder.path())].map(|folder| folder.join("report.html")) {
        let seen = browser.open_at(400, &page, look).probe;
        assert_eq!(seen["errors"], serde_json::json!([]));
        assert!(seen["narrow"] == true && seen["width"] == serde_json::json!([400, 400]), "{seen}");
        assert!(seen["rooms"].is_null() || seen["rooms"] == serde_json::json!([[0, -1], [0, 0]]), "{seen}");
    }
}

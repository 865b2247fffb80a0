//! Bad input is refused before anything is written: exit code 2, an error that names the culprit, an unchanged folder.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use assert_cmd::Command;
use assert_cmd::cargo::cargo_bin;

/// A command line that must be refused.
struct Case {
    /// Arguments, separated by blanks; relative paths are below the case's own folder.
    arguments: String,
    /// Files that are there before, by relative path; a path that ends in `/` is an empty folder.
    files: Vec<(String, Vec<u8>)>,
    /// What the error must say.
    words: Vec<String>,
}

fn case(arguments: &str, files: &[(&str, &str)], words: &[&str]) -> Case {
    Case {
        arguments: arguments.into(),
        files: files.iter().map(|(path, text)| (path.to_string(), text.as_bytes().to_vec())).collect(),
        words: words.iter().map(|word| word.to_string()).collect(),
    }
}

const CUBE: &str = "[domain]\nsolid = \"cube\"\n";
const TET: &str = "MeshVersionFormatted 2\nDimension 3\nVertices\n5\n0 0 0 0\n1 0 0 0\n0 1 0 0\n0 0 1 0\n2 2 2 0\n\
                   Tetrahedra\n2\n1 2 3 4 0\n2 3 4 5 0\nEnd\n";

/// The config `text` as `a.toml`, and what the error says.
fn config(text: &str, words: &[&str]) -> Case {
    case("run a.toml", &[("a.toml", text)], words)
}

/// `--set` on a good config.
fn set(assignment: &str, words: &[&str]) -> Case {
    case(&format!("run a.toml --set {assignment}"), &[("a.toml", CUBE)], words)
}

/// The good mesh `a.mesh` measured against `text` as `b.mesh`.
fn image(text: &str, words: &[&str]) -> Case {
    case("measure a.mesh b.mesh", &[("a.mesh", TET), ("b.mesh", text)], words)
}

fn configs() -> Vec<Case> {
    let below = |table: &str, line: &str| format!("{CUBE}[{table}]\n{line}\n");
    vec![
        case("run none.toml", &[], &["none.toml", "No such file", "solid = \"cube\""]),
        case("run folder", &[("folder/", "")], &["folder", "Is a directory"]),
        case(
            "run a.toml",
            &[("a.toml", "")],
            &["a.toml", "needs exactly one of `solid` and `file`", "solid = \"cube\""],
        ),
        case("run binary.toml", &[("binary.toml", "\u{0}\u{1}")], &["binary.toml:1"]),
        config("# only this\n", &["a.toml", "solid = \"cube\""]),
        config("[domain]\nsolid = \"cube\"\nfile = \"a.toml\"", &["a.toml:3: both `solid` and `file`"]),
        config("[domain]\nfile = \"none.obj\"", &["a.toml:2", "none.obj does not exist", "relative to the config"]),
        config("[domain]\nsolid = \"cubus\"", &["a.toml:2: `domain.solid`", "did you mean `cube`?"]),
        config(
            &below("mesh", "layer = 3"),
            &["a.toml:4: unknown key `mesh.layer`", "did you mean `layers`?", "layer = 3"],
        ),
        config(&below("mesh", "layers = 0"), &["a.toml:4: `mesh.layers` is 0", "between 1 and 10000"]),
        config(&below("mesh", "layers = 1000000000000000000"), &["a.toml:4: `mesh.layers`"]),
        config(
            &below("mesh", "cells = 100_000_000"),
            &["a.toml:4: `mesh.cells` is 100000000", "between 1 and 90000000"],
        ),
        config("[analitic]\n", &["a.toml:1: unknown key `analitic`", "did you mean `analytic`?"]),
        config(&below("mesh", "layers = \"8\""), &["a.toml:4: `mesh.layers`", "a whole number"]),
        config(&below("map", "exponent = -1"), &["a.toml:4: `map.exponent` is -1", "greater than 0"]),
        config(&below("map", "exponent = 1e300"), &["a.toml:4: `map.exponent` is 1", "from 0.05 to 50"]),
        config(
            &below("optimize", "exponent = 1e300\nobjective = \"soft-max\""),
            &["a.toml:4: `optimize.exponent` is 1", "at most 1e6", "objective = \"max\""],
        ),
        config(
            &below("optimize", "exponent = -2.5\nobjective = \"soft-max\""),
            &["a.toml:4: `optimize.exponent` is -2.5"],
        ),
        config(&format!("{CUBE}sides = 5"), &["a.toml:3: `sides` is no parameter of the solid cube", "prism"]),
        config("[domain\nsolid = \"cube\"", &["a.toml:1"]),
    ]
}

/// The corners of a block of three by one by three with a slot, U-shaped seen along y, and its eight sides and six caps.
fn u_block() -> String {
    let outline = [[0, 0], [3, 0], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]];
    let mut text: String = [0, 1].map(|y| outline.map(|[x, z]| format!("v {x} {y} {z}\n")).concat()).concat();
    for (i, next) in (1..=8).zip([2, 3, 4, 5, 6, 7, 8, 1]) {
        text += &format!("f {i} {} {} {next}\n", i + 8, next + 8);
    }
    for cap in [[1, 2, 5, 6], [2, 3, 4, 5], [1, 6, 7, 8]] {
        let [a, b, c, d] = cap;
        text += &format!("f {a} {b} {c} {d}\nf {} {} {} {}\n", d + 8, c + 8, b + 8, a + 8);
    }
    text
}

/// The cube [0, 1]^3 in 8 `v` lines and 6 `f` lines.
const BLOCK: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 0 0 1\nv 1 0 1\nv 0 1 1\nv 1 1 1\n\
                     f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";

/// `text` as the file that a config names as its domain, and what the error says after the file's name.
fn surface(name: &str, text: &str, words: &[&str]) -> Case {
    surface_about("\"kernel\"", name, text, words)
}

fn surface_about(centre: &str, name: &str, text: &str, words: &[&str]) -> Case {
    let config = format!("[domain]\nfile = \"{name}\"\ncentre = {centre}\n");
    let start = format!("error: {name}");
    case("run a.toml", &[("a.toml", &config), (name, text)], &[&[start.as_str()], words].concat())
}

fn surfaces() -> Vec<Case> {
    let block = |words: &[&str], change: &dyn Fn(&str) -> String| surface("b.obj", &change(BLOCK), words);
    let apart = BLOCK.replace("v 0", "v 5").replace("v 1", "v 6");
    let second = BLOCK.lines().filter(|line| line.starts_with('f')).map(|line| {
        let corners = line.split(' ').skip(1).map(|word| (word.parse::<u32>().unwrap() + 8).to_string());
        format!("f {}\n", corners.collect::<Vec<_>>().join(" "))
    });
    let two = format!("{BLOCK}{}{}", &apart[..apart.find('f').unwrap()], second.collect::<String>());
    vec![
        surface("b.obj", "", &["is empty", "export it again"]),
        surface("b.obj", "garbage\n", &["b.obj:1: `garbage` is no keyword of an OBJ file"]),
        surface("b.obj", &BLOCK[..BLOCK.find('f').unwrap()], &["no faces", "export the surface"]),
        surface("b.off", "garbage\n", &["b.off:1: expected `OFF`"]),
        surface("b.ply", "garbage\n", &["b.ply:1: the first line must be \"ply\""]),
        surface("b.stl", "garbage\n", &["neither \"solid\" at the start nor the 84 bytes of a binary header"]),
        case(
            "run a.toml",
            &[("a.toml", "[domain]\nfile = \"part.step\"\n"), ("part.step", "x")],
            &["a.toml:2: part.step: unknown file ending \"step\" for a solid", ".obj", "export the solid"],
        ),
        block(&[":14: face 5", "vertex 9", "8 vertices", "correct it"], &|t| t.replace("2 4 8 6", "2 4 9 6")),
        block(&[":8: vertex 7", "not finite", "give it numbers"], &|t| t.replace("v 1 1 1", "v 1 nan 1")),
        block(&[":8: vertex 7", "needs three numbers"], &|t| t.replace("v 1 1 1", "v 1 one 1")),
        block(&["is not closed: 4 edges", "[1.0, 0.0, 0.0]", "fill the holes", "domain.fill_holes"], &|t| {
            t.replace("f 2 4 8 6\n", "")
        }),
        block(&["in the same direction", "reverse the vertex order"], &|t| t.replace("2 4 8 6", "6 8 4 2")),
        block(&["polygon 0", "its outline crosses itself"], &|t| t.replace("f 1 3 4 2", "f 1 3 2 4")),
        block(&["share the edge", "keep two"], &|t| format!("{t}v 2 2 2\nf 1 2 9\n")),
        surface("b.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 3 2 1\n", &["encloses no volume"]),
        surface("b.obj", &two, &["2 separate pieces", "12 triangles at [0.0, 0.0, 0.0]", "keep one"]),
        // The walls of the slot, x = 1 and x = 2, exclude each other.
        case(
            "run a.toml",
            &[("a.toml", "[domain]\nfile = \"b.obj\"\n[map]\nkind = \"radial\"\n"), ("b.obj", &u_block())],
            &["not star-shaped", "[2.0000, ", "[1.0000, ", "spherical"],
        ),
        surface_about(
            "[3, 0.5, 0.5]",
            "b.obj",
            BLOCK,
            &[
                "not star-shaped about [3.0, 0.5, 0.5]: 2 triangles",
                "[10, 11]",
                "nearest centre that works",
                "\"kernel\"",
            ],
        ),
        config("[domain]\nsolid = \"torus\"", &["torus with radii 2 and 1", "1 handle"]),
        config(
            &format!("{CUBE}centre = [2, 0, 0]\n"),
            &[
                "cube: the solid is not star-shaped about [2.0, 0.0, 0.0]",
                "nearest centre that works is about [0.99, 0.0, 0.0]",
            ],
        ),
        config(
            &format!("{CUBE}[mesh]\nsubdivisions = 1000\nlayers = 10000\n"),
            &["cube: the shell mesh would have 1439904000000 tets", "fewer layers"],
        ),
    ]
}

fn command_lines() -> Vec<Case> {
    vec![
        case("run b.txt", &[("b.txt", BLOCK)], &["b.txt:1", "a config is a TOML file", "file = \"b.txt\""]),
        case("run b.dat", &[("b.dat", "\u{0}")], &["b.dat", "a config is a TOML file", "file = \"b.dat\""]),
        // By its name a solid, which then has to be one.
        case("run b.stl", &[("b.stl", "garbage\n")], &["b.stl", "neither \"solid\" at the start nor the 84 bytes"]),
        case("run b.obj", &[], &["cannot read b.obj: No such file"]),
        case("", &[], &["Usage"]),
        case("rum a.toml", &[], &["run"]),
        case("run", &[], &["CONFIG"]),
        case("run a.toml --threads -1", &[("a.toml", CUBE)], &["--threads"]),
        case("run a.toml --threads 100000", &[("a.toml", CUBE)], &["--threads"]),
        case(
            "optimize a.mesh b.mesh c.mesh --soft-max -2",
            &[],
            &["'-2' for '--soft-max <P>': give a positive number"],
        ),
        case(
            "bounds a.mesh b.mesh --certify --time-limit -1",
            &[],
            &["'-1' for '--time-limit <SECONDS>': give a positive"],
        ),
        case(
            "verify sweep",
            &[("sweep/", ""), ("sweep/index.csv", "")],
            &["sweep is the folder of a sweep", "sweep/cases/ID"],
        ),
        case(
            "verify tables",
            &[("tables/", ""), ("tables/table.md", "")],
            &["tables holds the tables", "not verified"],
        ),
        case("verify other", &[("other/", "")], &["other is not the folder of a run", "`qcball run` wrote"]),
        case("map power exponent=2 a.mesh", &[], &["exponent=2 is a parameter", "the mesh IN and the file OUT"]),
        set("mesh.layers", &["--set mesh.layers: there is no `=`"]),
        set("mesh.layer=3", &["--set mesh.layer=3", "did you mean `layers`?"]),
        set("mesh.layers=0", &["--set mesh.layers=0", "between 1 and 10000"]),
        set("mesh.layers=many", &["--set mesh.layers=many", "a whole number"]),
        set("mesh.kind.x=1", &["--set mesh.kind.x=1"]),
        set("domain.solid=cubus", &["--set domain.solid=cubus", "did you mean `cube`?"]),
    ]
}

fn sweeps() -> Vec<Case> {
    let sweep =
        |lines: &str, words: &[&str]| case("sweep a.toml", &[("a.toml", &format!("{CUBE}[sweep]\n{lines}\n"))], words);
    let good = format!("{CUBE}[sweep]\nseeds = 2\n");
    let call = |arguments: &str, words: &[&str]| {
        case(&format!("sweep a.toml {arguments}"), &[("a.toml", &good), ("plain", "a file")], words)
    };
    let thousand = "{ from = 1, to = 2, steps = 1000 }";
    vec![
        case(
            "sweep a.toml",
            &[("a.toml", "[analytic]\nmaps = []\nmeshes = []\n")],
            &["a.toml:1: a config with the table [analytic]", "`qcball run` takes it"],
        ),
        case("sweep a.toml", &[("a.toml", CUBE)], &["a.toml: there is no table [sweep]", "[sweep.grid]"]),
        sweep("sedes = 2", &["a.toml:4: unknown key `sweep.sedes`", "did you mean `seeds`?", "sedes = 2"]),
        sweep("grid.map.exponnt = [1]", &["a.toml:4: unknown key `map.exponnt`", "did you mean `exponent`?"]),
        sweep("grid.map.exponent = [1, -1]", &["a.toml:4: `map.exponent` is -1", "in the case map.exponent=-1"]),
        sweep("grid.map.exponent = { from = 1, top = 2, step = 1 }", &["a.toml:4", "unknown key `top`", "`to`?"]),
        sweep(
            &format!("grid.map.exponent = {thousand}\ngrid.mesh.grading = {thousand}"),
            &["a.toml:3: the sweep has 1000000 cases", "10000 is the limit", "split the sweep"],
        ),
        call("--set seed=1", &["a.toml:4: `seed` is varied here, but also set by --set seed=1"]),
        call("--shard 3/2", &["--shard", "I/N with 1 <= I <= N"]),
        call("--jobs 0", &["--jobs"]),
        call("--tasks 2", &["--emit"]),
        call("--out plain", &["cannot write plain/cases", "a file stands where a folder is needed"]),
        call("--out plain --index-only", &["cannot write plain/cases"]),
        call("--out /proc/qcball-sweep", &["cannot write /proc/qcball-sweep/cases"]),
    ]
}

fn results_folders() -> Vec<Case> {
    let into = |folder: &str, words: &[&str]| {
        case(&format!("run a.toml --out {folder}"), &[("a.toml", CUBE), ("plain", "a file")], words)
    };
    vec![
        into("plain", &["cannot write plain", "a file stands where a folder is needed"]),
        into("plain/below", &["cannot write plain/below", "a file stands where a folder is needed"]),
        into("/proc/qcball-results", &["cannot write /proc/qcball-results"]),
        into("/dev/full/results", &["cannot write /dev/full/results"]),
        case("run a.toml", &[("a.toml", CUBE), ("results", "a file")], &["cannot write results/a"]),
    ]
}

fn meshes() -> Vec<Case> {
    vec![
        case("measure a.mesh none.mesh", &[("a.mesh", TET)], &["none.mesh", "No such file"]),
        case("bounds none.mesh a.mesh", &[("a.mesh", TET)], &["none.mesh", "No such file"]),
        case("measure none.mesh a.mesh", &[("a.mesh", TET)], &["none.mesh", "No such file"]),
        case("measure a.mesh folder.mesh", &[("a.mesh", TET), ("folder.mesh/", "")], &["folder.mesh is a directory"]),
        case(
            "measure a.mesh a.xyz",
            &[("a.mesh", TET), ("a.xyz", TET)],
            &["a.xyz", "unknown file ending \"xyz\"", ".mesh"],
        ),
        image("", &["b.mesh is empty"]),
        image("garbage", &["b.mesh:1", "`garbage`"]),
        image(&TET[..50], &["b.mesh:4", "room for at most"]),
        image(&TET.replace("2 2 2 0", "2 nan 2 0"), &["b.mesh:9", "finite"]),
        image(&TET.replace("2 2 2 0", "2 two 2 0"), &["b.mesh:9", "`two`"]),
        image(&TET.replace("2 3 4 5 0", "2 3 4 6 0"), &["b.mesh:13", "vertex 6", "1 to 5"]),
        image(&TET.replace("\n5\n", "\n1000000000000000000\n"), &["b.mesh:4", "room for at most"]),
        image(&TET.replace("2 3 4 5 0", "2 3 1 5 0"), &["a.mesh and b.mesh", "tet 2", "[2, 3, 4, 5]", "[2, 3, 1, 5]"]),
        image(&TET.replace("Tetrahedra\n2\n1 2 3 4 0", "Tetrahedra\n1"), &["the first has 2 tets, the second 1"]),
        case(
            "measure flat.mesh flat.mesh",
            &[("flat.mesh", &TET.replace("0 0 1 0", "1 1 0 0"))],
            &["flat.mesh: tet 0 has zero volume", "counted from 0"],
        ),
    ]
}

#[test]
fn bad_input_is_refused_and_nothing_written() {
    for case in [configs(), surfaces(), command_lines(), sweeps(), results_folders(), meshes()].into_iter().flatten() {
        let folder = tempfile::tempdir().unwrap();
        for (path, bytes) in &case.files {
            let path = folder.path().join(path);
            if path.to_string_lossy().ends_with('/') {
                fs::create_dir_all(&path).unwrap();
            } else {
                fs::write(&path, bytes).unwrap();
            }
        }
        let before = contents(folder.path());
        let mut command = Command::new(cargo_bin!("qcball"));
        command.current_dir(folder.path()).timeout(std::time::Duration::from_secs(60));
        let output = command.args(case.arguments.split_whitespace()).output().unwrap();
        let error = String::from_utf8_lossy(&output.stderr);
        let what = format!("qcball {}\n{error}", case.arguments);
        assert_eq!(output.status.code(), Some(2), "{what}");
        assert_eq!(String::from_utf8_lossy(&output.stdout), "", "{what}");
        assert!(!error.contains("panicked"), "{what}");
        for word in &case.words {
            assert!(error.contains(word.as_str()), "{what}\nlacks {word}");
        }
        assert_eq!(contents(folder.path()), before, "{what}\nwrote something");
    }
}

/// Every path below a folder, with its bytes if it is a file.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Option<Vec<u8>>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(contents(&path));
            found.insert(path, None);
        } else {
            let bytes = fs::read(&path).unwrap();
            found.insert(path, Some(bytes));
        }
    }
    found
}

#[test]
fn a_full_disk_is_told_before_the_work() {
    // In a mount namespace of its own, so that nothing stays behind on the machine.
    let script = "mount -t tmpfs -o size=64k none disk || exit 77
                  cat /dev/zero > disk/filler 2> /dev/null
                  exec \"$0\" run a.toml --out disk/out";
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.toml"), CUBE).unwrap();
    fs::create_dir(folder.path().join("disk")).unwrap();
    let mut command = Command::new("unshare");
    command.current_dir(folder.path()).args(["--mount", "sh", "-c", script]).arg(cargo_bin!("qcball"));
    let Ok(output) = command.output() else {
        eprintln!("skipped: no unshare here");
        return;
    };
    let error = String::from_utf8_lossy(&output.stderr);
    if output.status.code() != Some(2) && !error.contains("disk/out") {
        eprintln!("skipped: may not mount: {error}");
        return;
    }
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert!(error.contains("cannot write disk/out: No space left"), "{error}");
}

#[test]
fn standard_output_that_is_closed_or_full_makes_no_panic() {
    let spawn = |output: Stdio| {
        let mut command = std::process::Command::new(cargo_bin!("qcball"));
        let child = command.arg("schema").stdout(output).stderr(Stdio::piped()).spawn().unwrap();
        let output = child.wait_with_output().unwrap();
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    assert_eq!(spawn(writer.into()), (Some(0), String::new()));
    if let Ok(full) = fs::OpenOptions::new().write(true).open("/dev/full") {
        let (code, error) = spawn(full.into());
        assert_eq!(code, Some(1), "{error}");
        assert!(error.contains("cannot write to standard output: No space left"), "{error}");
    }
}

//! `qcball bench` on a folder of two tiny meshes.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use assert_cmd::cargo::cargo_bin;
use qcball::config::BenchPlan;
use qcball::mesh::io::write_medit;
use qcball::mesh::{Vec3, VertexId};

const CONFIG: &str = "[optimize]\nmax_iterations = 40\n";
const PEERS: &str = "mesh,peer,max_k,mean_k,p999_k,flipped,cpu_seconds,peak_rss_mb,ended\n\
                     a,qis_conf,999,9,9,0,10,5,yes\n\
                     a,\"slow, old\",500,8,9,0,20,5,\"yes, or so\"\n\
                     a,slim,-,-,-,-,-,5,CRASH\n\
                     b,tinyad_k,1.0,1.0,1,0,3,5,yes\n";

/// Kuhn's subdivision of a 2 x 2 x 2 grid over [-1, 1]^3: six tets a cell.
fn grid() -> (Vec<Vec3>, Vec<[VertexId; 4]>) {
    let at = |c: [u32; 3]| VertexId(c[0] + 3 * (c[1] + 3 * c[2]));
    let cells: Vec<[u32; 3]> = (0..27).map(|v| [v % 3, v / 3 % 3, v / 9]).collect();
    let points = cells.iter().map(|c| Vec3::from(c.map(|i| f64::from(i) - 1.0))).collect();
    let mut tets = Vec::new();
    for cell in cells.iter().filter(|c| c.iter().all(|&i| i < 2)) {
        for [a, b] in [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]] {
            let mut corner = *cell;
            let mut tet = [at(corner); 4];
            for (step, axis) in [a, b, 3 - a - b].into_iter().enumerate() {
                corner[axis] += 1;
                tet[step + 1] = at(corner);
            }
            tets.push(tet);
        }
    }
    (points, tets)
}

/// A folder with a config, peers' figures and two meshes: `a` with a start, `b` without.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("bench.toml"), CONFIG).unwrap();
    fs::write(folder.path().join("peers.csv"), PEERS).unwrap();
    let meshes = folder.path().join("meshes");
    fs::create_dir(&meshes).unwrap();
    let (points, tets) = grid();
    let sheared: Vec<Vec3> = points.iter().map(|p| Vec3::new(p.x + 0.3 * p.y, p.y, 2.0 * p.z)).collect();
    write_medit(&meshes.join("a-rest.mesh"), &points, &tets).unwrap();
    write_medit(&meshes.join("a-init.mesh"), &sheared, &tets).unwrap();
    write_medit(&meshes.join("b-rest.mesh"), &points, &tets).unwrap();
    folder
}

fn bench(folder: &Path, arguments: &str) -> std::process::Output {
    let mut command = Command::new(cargo_bin!("qcball"));
    command.current_dir(folder).args(arguments.split_whitespace()).output().unwrap()
}

/// The cells of the first row of a table that begins with `name`.
fn row<'a>(section: &'a str, name: &str) -> Vec<&'a str> {
    let line =
        section.lines().find(|line| line.starts_with(&format!("| {name} "))).unwrap_or_else(|| panic!("{section}"));
    line.split('|').map(str::trim).filter(|cell| !cell.is_empty()).collect()
}

#[test]
fn the_table_has_our_figures_and_those_of_the_peers() {
    let folder = folder();
    // In two files.
    let (of_a, of_b) = PEERS.split_at(PEERS.find("\nb,").unwrap() + 1);
    let header = of_a.lines().next().unwrap();
    fs::write(folder.path().join("a.csv"), of_a).unwrap();
    fs::write(folder.path().join("b.csv"), format!("{header}\n{of_b}")).unwrap();
    let output = bench(folder.path(), "bench bench.toml meshes --peers a.csv --peers b.csv");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}\n{}", String::from_utf8_lossy(&output.stderr));
    assert!(said.starts_with("a ") && said.contains("\nb ") && said.contains("results/bench.md"), "{said}");
    let text = fs::read_to_string(folder.path().join("results/bench.md")).unwrap();
    for words in [
        "qcball bench bench.toml meshes --peers a.csv --peers b.csv",
        "max_iterations = 40",
        "1 threads a mesh",
        "under other load",
    ] {
        assert!(text.contains(words), "{words} in\n{text}");
    }
    assert!(!text.contains("not at its end"), "{text}");
    let (ours, beside) = text.split_once("## Beside").unwrap();
    let a = row(ours, "a");
    assert_eq!(a.len(), 16, "{a:?}");
    // The start is linear, so that its K is the same everywhere.
    assert_eq!((a[2], a[4], a[7]), (a[3], "0", "0"));
    let [start, last, iterations, peak] = [2, 5, 8, 11].map(|column: usize| a[column].parse::<f64>().ok());
    assert!(last.unwrap() <= start.unwrap() * 1.001 && iterations.unwrap() <= 40.0, "{a:?}");
    let [bound, gap] = [13, 14].map(|column: usize| a[column].parse::<f64>().unwrap());
    // Both rounded to four decimals.
    assert!(bound >= 1.0 && (gap * bound / last.unwrap() - 1.0).abs() < 3e-4, "{a:?}");
    // Memory is told on Linux only.
    assert_eq!(peak.is_some_and(|peak| peak > 1.0), cfg!(target_os = "linux"), "{a:?}");
    assert_eq!(row(ours, "b (radial start)").len(), 16);
    let a = row(beside, "a");
    // The best of the peers by max K, and the reach of the one that is a goal.
    assert_eq!((a[1], a[2]), ("slow, old", "500"));
    assert!(a[4].parse::<f64>().unwrap() < 0.1 && a[10].contains("/ 10.00 s = ") && a[11] == "-", "{a:?}");
    let b = row(beside, "b");
    assert_eq!((b[1], b[11]), ("tinyad_k", "not reached"));
}

#[test]
fn only_and_out_are_obeyed_and_a_bad_mesh_fails_alone() {
    let folder = folder();
    fs::write(folder.path().join("meshes/bad-rest.mesh"), "garbage").unwrap();
    let output = bench(folder.path(), "bench bench.toml meshes --only=a --out new/table.md --threads 2");
    assert_eq!(output.status.code(), Some(1));
    let text = fs::read_to_string(folder.path().join("new/table.md")).unwrap();
    assert!(text.contains("| a ") && !text.contains("| b ") && !text.contains("## Beside"), "{text}");
    assert!(row(&text, "bad")[15].contains("bad-rest.mesh:1"), "{text}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("note: bad: "));
    assert!(!folder.path().join("results").exists());
}

#[test]
fn bad_input_is_told_in_a_paragraph_and_nothing_written() {
    let folder = folder();
    fs::create_dir(folder.path().join("empty")).unwrap();
    let file = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    file("domain.toml", "[domain]\nsolid = \"cube\"\n");
    file("unknown.toml", "[optimize]\ntolerant = 1\n");
    file("negative.toml", "# bench\n[optimize]\ntolerance = -1\n");
    file("short.csv", &format!("{PEERS}a,slim,3\n"));
    file("word.csv", &PEERS.replace("999", "many"));
    file("columns.csv", "mesh,peer,max_k\n");
    file("nameless.csv", &PEERS.replace("b,tinyad_k", "b,"));
    for (arguments, words) in [
        ("bench none.toml meshes", ["none.toml", "No such file"]),
        ("bench domain.toml meshes", ["domain.toml:1", "`domain` speaks of one run"]),
        ("bench unknown.toml meshes", ["unknown.toml:2", "did you mean `tolerance`?"]),
        ("bench negative.toml meshes", ["negative.toml:3", "greater than 0"]),
        ("bench bench.toml none", ["folder of meshes none", "No such file"]),
        ("bench bench.toml empty", ["no mesh in empty", "NAME-rest.mesh"]),
        ("bench bench.toml meshes --only c", ["no mesh of meshes has c in", "there are a, b"]),
        ("bench bench.toml meshes --peers none.csv", ["none.csv", "No such file"]),
        ("bench bench.toml meshes --peers short.csv", ["short.csv:6", "3 columns"]),
        ("bench bench.toml meshes --peers word.csv", ["word.csv:2", "`max_k` is \"many\""]),
        ("bench bench.toml meshes --peers columns.csv", ["columns.csv:1", "no column `mean_k`"]),
        ("bench bench.toml meshes --peers nameless.csv", ["nameless.csv:5", "`peer` is empty"]),
        ("bench bench.toml meshes --out peers.csv/t.md", ["cannot write peers.csv", "a file stands"]),
        ("optimize x y z.mesh --config bench.toml --tolerance 1", ["--config", "cannot be used with"]),
    ] {
        let output = bench(folder.path(), arguments);
        let error = String::from_utf8_lossy(&output.stderr);
        assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0), "{arguments}\n{error}");
        for word in words {
            assert!(error.contains(word), "{arguments}\n{error}\nlacks {word}");
        }
        assert!(!folder.path().join("results").exists(), "{arguments}");
    }
}

#[test]
fn the_committed_config_is_a_bench() {
    let plan = BenchPlan::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/bench.toml")).unwrap();
    assert_eq!(plan.threads, 1);
}

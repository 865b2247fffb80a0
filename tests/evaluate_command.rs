//! `qcball evaluate`: the map of a run and its inverse at points from files.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use assert_cmd::cargo::cargo_bin;
use qcball::Vec3;
use qcball::mesh::io::{read_points, read_tet_file, read_tets};

/// Exit code, standard output and standard error.
fn qcball(folder: &Path, arguments: &[&str]) -> (i32, String, String) {
    let output = Command::new(cargo_bin!("qcball")).current_dir(folder).args(arguments).output().unwrap();
    let [out, err] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    (output.status.code().unwrap(), out, err)
}

/// A folder with the results of a coarse cube in `run`.
fn cube() -> tempfile::TempDir {
    run("solid = \"cube\"")
}

fn run(domain: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let config = format!("[domain]\n{domain}\n[mesh]\nsubdivisions = 2\nlayers = 3\n[optimize]\nmax_iterations = 5\n");
    fs::write(folder.path().join("cube.toml"), config).unwrap();
    let (code, _, err) = qcball(folder.path(), &["run", "cube.toml", "--out", "run", "--quiet", "--threads", "1"]);
    assert_eq!(code, 0, "{err}");
    folder
}

/// The rows of a CSV file as numbers, NaN where a field is empty, and its header.
fn table(path: &Path) -> (Vec<String>, Vec<Vec<f64>>) {
    let text = fs::read_to_string(path).unwrap();
    let fields = |line: &str| line.split(',').map(String::from).collect::<Vec<_>>();
    let mut lines = text.lines();
    let header = fields(lines.next().unwrap());
    (header, lines.map(|line| fields(line).iter().map(|field| field.parse().unwrap_or(f64::NAN)).collect()).collect())
}

#[test]
fn the_vertices_of_the_domain_go_to_those_of_the_image_to_the_bit_and_back() {
    // Whatever units they are counted in.
    for folder in
        [cube(), run("solid = \"box\"\nsize = [300, 200, 250]"), run("solid = \"box\"\nsize = [3e-5, 2e-5, 2e-5]")]
    {
        there_and_back(folder.path());
    }
}

fn there_and_back(folder: &Path) {
    let at = |name: &str| folder.join(name);
    let [domain, image] = ["run/domain.vtu", "run/image.vtu"].map(|name| read_tets(&at(name)).unwrap().points);
    let (code, out, err) = qcball(folder, &["evaluate", "run", "run/domain.vtu", "there.csv"]);
    assert_eq!((code, err.as_str()), (0, ""));
    assert_eq!(out, format!("{} points, 0 of them outside; there.csv\n", domain.len()));
    let (header, rows) = table(&at("there.csv"));
    assert_eq!(header, ["x", "y", "z", "inside", "tet", "image_x", "image_y", "image_z"]);
    for (row, (x, y)) in rows.iter().zip(domain.iter().zip(&image)) {
        assert_eq!((row[..3].to_vec(), row[3], row[5..].to_vec()), (x.as_slice().to_vec(), 1.0, y.as_slice().to_vec()));
    }
    // The file that was written is one of points, and so is a VTU of it.
    let (code, ..) = qcball(folder, &["evaluate", "run", "run/image.vtu", "back.vtu", "--inverse"]);
    assert_eq!(code, 0);
    assert_eq!(read_points(&at("back.vtu")).unwrap().points, image);
    assert_eq!(read_points(&at("there.csv")).unwrap().points, domain);
    // On to the ball, which has a radius of 1, and back to within rounding.
    let (code, ..) = qcball(folder, &["evaluate", "run", "run/domain.vtu", "ball.csv", "--onto", "ball"]);
    assert_eq!(code, 0);
    let (_, rows) = table(&at("ball.csv"));
    let most = rows.iter().map(|row| Vec3::new(row[5], row[6], row[7]).norm()).fold(0.0, f64::max);
    assert!(rows.iter().all(|row| row[3] == 1.0) && (most - 1.0).abs() < 1e-12, "{most}");
    let (code, said, _) = qcball(folder, &["evaluate", "run", "ball.csv", "again.csv", "--onto", "ball", "--inverse"]);
    assert_eq!(code, 0, "{said}");
    let size = domain.iter().map(|x| x.amax()).fold(0.0, f64::max);
    let (header, rows) = table(&at("again.csv"));
    let first = header.iter().position(|name| name == "domain_x").unwrap();
    for (row, x) in rows.iter().zip(&domain).filter(|(row, _)| row[first].is_finite()) {
        let back = Vec3::new(row[first], row[first + 1], row[first + 2]);
        assert!((back - x).norm() < 1e-9 * size, "{x} {back}");
    }
    // Points of the sphere may be outside by rounding; all others are within.
    assert!(rows.iter().filter(|row| row[first].is_finite()).count() > domain.len() / 4);
}

#[test]
fn points_are_told_to_be_outside_row_by_row_and_other_columns_stay() {
    let folder = cube();
    let at = |name: &str| folder.path().join(name);
    fs::write(at("in.csv"), "name,X,y,z\n\"a,b\",0.1,0.2,0.3\nc,2,0,0\nd, 1 ,-0.25,1e-3\n").unwrap();
    let (code, out, _) = qcball(folder.path(), &["evaluate", "run", "in.csv", "out.csv", "--onto", "ball"]);
    assert_eq!((code, out.as_str()), (0, "3 points, 1 of them outside; out.csv\n"));
    let text = fs::read_to_string(at("out.csv")).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines[0], "name,X,y,z,inside,tet,image_x,image_y,image_z");
    assert!(lines[1].starts_with("\"a,b\",0.1,0.2,0.3,1,"));
    assert_eq!(lines[2], "c,2,0,0,0,,,,");
    // A boundary point goes to the sphere.
    let end: Vec<f64> = lines[3].split(',').skip(6).map(|field| field.parse().unwrap()).collect();
    assert!((Vec3::from_column_slice(&end).norm() - 1.0).abs() < 1e-14);
    // And comes back from there, by a file with its columns renamed.
    let ball: Vec<String> = end.iter().map(f64::to_string).collect();
    fs::write(at("ball.csv"), format!("x,y,z\n{}\n", ball.join(","))).unwrap();
    let arguments = ["evaluate", "run", "ball.csv", "back.csv", "--onto", "ball", "--inverse"];
    assert_eq!(qcball(folder.path(), &arguments).0, 0);
    let (header, rows) = table(&at("back.csv"));
    assert_eq!(header[5..], ["domain_x", "domain_y", "domain_z"]);
    assert!((Vec3::from_column_slice(&rows[0][5..]) - Vec3::new(1.0, -0.25, 1e-3)).norm() < 1e-10);
}

#[test]
fn what_one_direction_wrote_the_other_takes_back() {
    let folder = cube();
    let at = |name: &str| folder.path().join(name);
    fs::write(at("in.csv"), "name,x,y,z\na,0.1,0.2,0.3\nb,2,0,0\nc,-0.7,0.6,0.1\n").unwrap();
    for arguments in [["in.csv", "there.csv"], ["there.csv", "back.csv"], ["back.csv", "again.csv"]] {
        let mut all = vec!["evaluate", "run", arguments[0], arguments[1]];
        all.extend((arguments[0] == "there.csv").then_some("--inverse"));
        let (code, out, err) = qcball(folder.path(), &all);
        assert!(code == 0 && out.starts_with("3 points, 1 of them outside"), "{arguments:?}: {out}{err}");
    }
    let (header, rows) = table(&at("back.csv"));
    assert_eq!(header[4..], ["image_x", "image_y", "image_z", "inside", "tet", "domain_x", "domain_y", "domain_z"]);
    for row in [&rows[0], &rows[2]] {
        // The inverse solves three equations in doubles.
        assert!((0..3).all(|axis| (row[9 + axis] - row[1 + axis]).abs() < 1e-12), "{row:?}");
    }
}

/// Of points alone, and of a mesh, whose vertices are in the domain.
#[test]
fn what_one_direction_wrote_to_a_vtu_the_other_takes_back() {
    let folder = cube();
    let at = |name: &str| folder.path().join(name);
    fs::write(at("in.csv"), "x,y,z\n0.1,0.2,0.3\n2,0,0\n-0.7,0.6,0.1\n").unwrap();
    for (points, outside) in [("in.csv", 1), ("run/domain.vtu", 0)] {
        let given = read_points(&at(points)).unwrap().points;
        let evaluated = |arguments: &[&str], array: Option<&str>| {
            let (code, out, err) = qcball(folder.path(), &[&["evaluate", "run"], arguments].concat());
            let begin = format!("{} points, {outside} of them outside", given.len());
            assert!(code == 0 && out.starts_with(&begin), "{arguments:?}: {out}{err}");
            assert!(array.map_or(err.is_empty(), |name| err.contains(name)), "{arguments:?}: {err}");
        };
        evaluated(&[points, "there.vtu"], None);
        evaluated(&["there.vtu", "back.vtu", "--inverse"], Some("image_position"));
        evaluated(&["back.vtu", "again.csv"], Some("domain_position"));
        evaluated(&["there.vtu", "back.csv", "--inverse"], Some("image_position"));
        // What goes nowhere stays where it was, and nothing comes back to it.
        let back = read_tet_file(&at("back.vtu")).unwrap();
        assert_eq!(back.soup.points, given);
        let array = |name: &str| back.point_vectors.iter().find(|(other, _)| other == name).map(|(_, values)| values);
        let [there, found] = ["image_position", "domain_position"].map(|name| array(name).expect(name));
        let (header, rows) = table(&at("back.csv"));
        assert_eq!(header[..3], ["image_x", "image_y", "image_z"]);
        assert_eq!(header[5..], ["domain_x", "domain_y", "domain_z"]);
        for (index, (point, back)) in given.iter().zip(found).enumerate() {
            if outside == 1 && index == 1 {
                assert!(back.x.is_nan() && there[index].x.is_nan() && rows[index][0].is_nan());
            } else {
                assert!((back - point).norm() < 1e-12, "{point:?}: {back:?}");
                assert_eq!(rows[index][..3], *there[index].as_slice());
            }
        }
    }
}

#[test]
fn what_cannot_be_evaluated_is_refused_and_nothing_written() {
    let folder = cube();
    let at = |name: &str| folder.path().join(name);
    for (name, text) in [
        ("good.csv", "x,y,z\n0,0,0\n"),
        ("short.csv", "x,y,z\n0,0,0\n1,2\n"),
        ("two.csv", "x,y\n0,0\n"),
        ("word.csv", "x,y,z\n0,0,0\n0,nil,0\n"),
        ("nan.csv", "x,y,z\n0,0,NaN\n"),
        ("again.csv", "x,y,z,tet\n0,0,0,1\n"),
    ] {
        fs::write(at(name), text).unwrap();
    }
    for (arguments, part) in [
        (["none", "good.csv", "out.csv"], "none has no domain.vtu and image.vtu; name the folder of a run"),
        (["run", "none.csv", "out.csv"], "cannot read none.csv"),
        (["run", "short.csv", "out.csv"], "short.csv:3: the row has 2 fields, the first line 3"),
        (["run", "two.csv", "out.csv"], "two.csv:1: there is no column z"),
        (["run", "word.csv", "out.csv"], "word.csv:3: y is \"nil\"; give it a finite number"),
        (["run", "nan.csv", "out.csv"], "nan.csv:2: z is \"NaN\""),
        (["run", "good.csv", "out.obj"], "use .csv or .vtu"),
        (["run", "good.csv", "good.csv"], "would be written over"),
        (["run", "again.csv", "out.csv"], "have a column tet already"),
        (["run", "run/domain.vtu", "run/image.vtu"], "would be written over"),
    ] {
        let (code, out, err) = qcball(folder.path(), &[&["evaluate"], &arguments[..]].concat());
        assert_eq!((code, out.as_str()), (2, ""), "{arguments:?}: {err}");
        assert!(err.contains(part), "{arguments:?}: {err}");
        assert!(!at("out.csv").exists());
    }
}

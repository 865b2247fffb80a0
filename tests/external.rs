//! TetGen and Gmsh as meshers, and programs that pass for them and fail in every way.
//!
//! Where a program is missing its tests say so and pass, unless QCBALL_EXTERNAL_REQUIRED is set, as CI does once it has
//! installed both. The failing programs are shell scripts, so those tests need a Unix.

use std::path::Path;
use std::time::{Duration, Instant};

use qcball::mesh::{Boundary, PolygonSoup, TetId, TetMesh, Vec3, VertexId};
use qcball::solid::{ExternalError, ExternalMesher, ExternalSettings, Sizing, Solid, Surface, external_mesh};
use qcball::{Cancel, Domain, domain::edge_matrix};

const BOTH: [ExternalMesher; 2] = [ExternalMesher::TetGen, ExternalMesher::Gmsh];
const STAR: Solid = Solid::PolyhedralStar { seed: 3, amplitude: 0.3, resolution: 3 };

/// The mesh, or `None` if the program is missing and may be.
fn mesh(surface: &Surface, settings: &ExternalSettings) -> Option<TetMesh> {
    match external_mesh(surface, settings, &Cancel::default()) {
        Err(error @ ExternalError::Missing { .. }) if std::env::var_os("QCBALL_EXTERNAL_REQUIRED").is_none() => {
            eprintln!("skipped: {error}");
            None
        }
        result => Some(result.unwrap_or_else(|error| panic!("{settings:?}: {error}"))),
    }
}

fn usual(mesher: ExternalMesher) -> ExternalSettings {
    ExternalSettings::new(mesher)
}

fn volumes(mesh: &TetMesh) -> Vec<f64> {
    (0..mesh.tets().len() as u32).map(|tet| edge_matrix(mesh.corners(TetId(tet))).determinant() / 6.0).collect()
}

/// Circumradius over shortest edge.
fn radius_edge_ratio(corners: [Vec3; 4]) -> f64 {
    let edges = edge_matrix(corners).transpose();
    let halves = 0.5 * Vec3::new(edges.row(0).norm_squared(), edges.row(1).norm_squared(), edges.row(2).norm_squared());
    let radius = edges.try_inverse().map_or(f64::INFINITY, |inverse| (inverse * halves).norm());
    let pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];
    radius / pairs.map(|(i, j)| (corners[i] - corners[j]).norm()).into_iter().fold(f64::INFINITY, f64::min)
}

/// The tets of a mesh of a flat-sided solid fill it: their volumes are positive and have its volume as their sum.
fn fills(mesh: &TetMesh, surface: &Surface, settings: &ExternalSettings) {
    let volumes = volumes(mesh);
    assert!(volumes.iter().all(|&volume| volume > 0.0), "{settings:?}");
    let (sum, whole) = (volumes.iter().sum::<f64>(), surface.volume());
    // Coordinates of distant solids have eps times their distance as their error: 1e5 times 2e-16, relative to the size.
    assert!((sum - whole).abs() < 1e-9 * whole, "{settings:?}: {sum} of {whole}");
    if settings.keep_boundary {
        assert_eq!(Boundary::of(mesh).unwrap().triangles().len(), surface.triangles().len(), "{settings:?}");
    }
}

/// The triangles as sorted corner positions, sorted.
fn triangles_at(points: &[Vec3], triangles: &[[VertexId; 3]]) -> Vec<[[u64; 3]; 3]> {
    let place = |v: &VertexId| <[f64; 3]>::from(points[v.index()]).map(|x| (x + 0.0).to_bits());
    let mut all: Vec<_> = triangles.iter().map(|triangle| [0, 1, 2].map(|i| place(&triangle[i]))).collect();
    all.iter_mut().for_each(|triangle| triangle.sort_unstable());
    all.sort_unstable();
    all
}

#[test]
fn solids_are_filled_with_positive_tets_up_to_their_boundary() {
    for solid in [Solid::Cube, Solid::Icosahedron, STAR] {
        let surface = solid.surface().unwrap();
        for (mesher, keep_boundary) in BOTH.into_iter().flat_map(|mesher| [(mesher, false), (mesher, true)]) {
            let settings = ExternalSettings { keep_boundary, ..usual(mesher) };
            let Some(mesh) = mesh(&surface, &settings) else { continue };
            let volumes = volumes(&mesh);
            assert!(volumes.iter().all(|volume| *volume > 0.0), "{solid} {mesher}");
            let relative = volumes.iter().sum::<f64>() / surface.volume();
            assert!((relative - 1.0).abs() < 1e-9, "{solid} {mesher} {relative}");
            Domain::new(mesh.clone()).unwrap();
            let boundary = Boundary::of(&mesh).unwrap();
            let same = triangles_at(mesh.points(), boundary.triangles())
                == triangles_at(surface.points(), surface.triangles());
            assert!(same || !keep_boundary, "{solid} {mesher}: kept to the bit");
            eprintln!("{solid}, {mesher}, kept {keep_boundary}: {} tets, boundary same {same}", mesh.tets().len());
        }
    }
}

#[test]
fn no_tet_exceeds_the_volume_asked_for() {
    let cube = Solid::Cube.surface().unwrap();
    for mesher in BOTH {
        for limit in [0.05, 0.01, 0.002] {
            let Some(mesh) = mesh(&cube, &ExternalSettings { max_volume: Some(limit), ..usual(mesher) }) else {
                continue;
            };
            let largest = volumes(&mesh).into_iter().fold(0.0, f64::max);
            assert!(largest <= limit, "{mesher} {largest} > {limit}");
            // Within a factor of ten of the least number of tets that the limit allows; but Gmsh's own size, a tenth of
            // the diagonal, makes 1,788 where 160 would do.
            let most = (10.0 * 8.0 / limit).max(2500.0);
            eprintln!("{mesher}, volume {limit}: {} tets, largest {largest}", mesh.tets().len());
            assert!((mesh.tets().len() as f64) < most, "{mesher}: {} tets for {limit}", mesh.tets().len());
        }
    }
}

#[test]
fn a_volume_that_a_kept_boundary_forbids_is_an_error() {
    let cube = Solid::Cube.surface().unwrap();
    let tetgen = ExternalSettings { keep_boundary: true, max_volume: Some(0.01), ..usual(ExternalMesher::TetGen) };
    match external_mesh(&cube, &tetgen, &Cancel::default()) {
        Err(ExternalError::Missing { .. }) => {
            mesh(&cube, &tetgen);
        }
        Err(error @ ExternalError::TooCoarse { .. }) => {
            assert!(error.to_string().contains("set keep_boundary = false"), "{error}");
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn tetgen_keeps_the_radius_edge_ratio() {
    let cube = Solid::Cube.surface().unwrap();
    for ratio in [2.0, 1.4, 1.2] {
        let settings =
            ExternalSettings { max_volume: Some(0.01), quality: Some(ratio), ..usual(ExternalMesher::TetGen) };
        let Some(mesh) = mesh(&cube, &settings) else { return };
        let worst = (0..mesh.tets().len() as u32).map(|tet| radius_edge_ratio(mesh.corners(TetId(tet))));
        let worst = worst.fold(0.0, f64::max);
        eprintln!("quality {ratio}: worst {worst} of {} tets", mesh.tets().len());
        // TetGen's last step improves dihedral angles and may lose a little of the ratio.
        assert!(worst < 1.1 * ratio, "{worst} for {ratio}");
    }
}

#[test]
fn sizing_is_finer_near_sharp_edges() {
    let cube = Solid::Cube.surface().unwrap();
    let sizing = Sizing { edge_length: 0.5, feature_edge_length: 0.1, growth: 0.5 };
    for mesher in BOTH {
        let Some(mesh) = mesh(&cube, &ExternalSettings { sizing: Some(sizing), ..usual(mesher) }) else { continue };
        let (mut near, mut far) = (Vec::new(), Vec::new());
        for tet in mesh.tets() {
            for (i, j) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
                let ends = [tet[i], tet[j]].map(|v| mesh.points()[v.index()]);
                let middle = (ends[0] + ends[1]) / 2.0;
                // In the cube [-1, 1]^3 an edge of it is where two coordinates are 1 in size.
                let mut off: [f64; 3] = middle.map(|x| 1.0 - x.abs()).into();
                off.sort_by(f64::total_cmp);
                match off[0].hypot(off[1]) {
                    distance if distance < 0.05 => near.push((ends[0] - ends[1]).norm()),
                    distance if distance > 0.8 => far.push((ends[0] - ends[1]).norm()),
                    _ => {}
                }
            }
        }
        let mean = |lengths: &[f64]| lengths.iter().sum::<f64>() / lengths.len() as f64;
        let (near, far) = (mean(&near), mean(&far));
        eprintln!("{mesher}: mean edge {near} near, {far} far, {} tets", mesh.tets().len());
        assert!((0.04..0.15).contains(&near) && (0.25..0.75).contains(&far), "{mesher}: {near} near, {far} far");
    }
    for mesher in BOTH {
        // Kept boundary and sizes together, where TetGen 1.5 needs help.
        let sizing = Some(Sizing { edge_length: 0.3, feature_edge_length: 0.1, growth: 0.5 });
        let settings = ExternalSettings { sizing, keep_boundary: true, ..usual(mesher) };
        let star = STAR.surface().unwrap();
        let Some(mesh) = mesh(&star, &settings) else { continue };
        fills(&mesh, &star, &settings);
    }
}

#[test]
fn tiny_huge_and_distant_solids_are_meshed() {
    let cube = Solid::Cube.surface().unwrap();
    for (scale, shift) in [(1e-7, 0.0), (1e7, 0.0), (1.0, 1e5)] {
        let points = cube.points().iter().map(|p| p * scale + Vec3::new(shift, -shift, shift)).collect();
        let polygons = cube.triangles().iter().map(|triangle| triangle.to_vec()).collect();
        let surface = Surface::from_soup(PolygonSoup::new(points, polygons)).unwrap();
        let limit = Some(0.05 * scale * scale * scale);
        for (mesher, keep_boundary) in BOTH.into_iter().flat_map(|mesher| [(mesher, false), (mesher, true)]) {
            let max_volume = limit.filter(|_| !keep_boundary);
            let settings = ExternalSettings { max_volume, keep_boundary, ..usual(mesher) };
            let Some(mesh) = mesh(&surface, &settings) else { continue };
            fills(&mesh, &surface, &settings);
            let largest = volumes(&mesh).into_iter().fold(0.0, f64::max);
            assert!(max_volume.is_none_or(|limit| largest <= limit * (1.0 + 1e-6)), "{settings:?}: {largest}");
        }
    }
}

/// A long box whose end is bent back through its middle: each edge has two triangles, but the surface cuts itself.
fn self_intersecting() -> Surface {
    let outline = [[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [1.9, 2.0], [2.1, -1.0], [2.3, -1.0], [2.3, 1.0], [3.0, 1.0]];
    let outline = outline.iter().chain(&[[3.0, 0.4], [0.0, 0.4]]);
    let flat: Vec<[f64; 2]> = outline.copied().collect();
    let count = flat.len() as u32;
    let points = [0.0, 1.0].iter().flat_map(|&z| flat.iter().map(move |p| Vec3::new(p[0], p[1], z))).collect();
    let centre = |points: &mut Vec<Vec3>, z| {
        points.push(Vec3::new(1.0, 0.2, z));
        VertexId(points.len() as u32 - 1)
    };
    let mut points: Vec<Vec3> = points;
    let (low, high) = (centre(&mut points, -1.0), centre(&mut points, 2.0));
    let mut polygons = Vec::new();
    for i in 0..count {
        let [a, b, c, d] = [i, (i + 1) % count, (i + 1) % count + count, i + count].map(VertexId);
        polygons.extend([vec![a, b, c], vec![a, c, d], vec![low, b, a], vec![high, d, c]]);
    }
    Surface::from_soup(PolygonSoup::new(points, polygons)).unwrap()
}

#[test]
fn a_surface_through_itself_is_refused_in_the_programs_words() {
    let surface = self_intersecting();
    for (mesher, keep_boundary) in BOTH.into_iter().flat_map(|mesher| [(mesher, false), (mesher, true)]) {
        let settings = ExternalSettings { keep_boundary, ..usual(mesher) };
        match external_mesh(&surface, &settings, &Cancel::default()) {
            Err(ExternalError::Missing { .. }) => {
                mesh(&surface, &settings);
            }
            Err(error @ ExternalError::Failed { .. }) => {
                let text = error.to_string();
                let words = if mesher == ExternalMesher::TetGen { "are intersecting" } else { "intersect" };
                assert!(text.contains(words), "{text}");
                eprintln!("{text}");
            }
            other => panic!("{mesher}: {other:?}"),
        }
    }
}

#[test]
fn settings_out_of_range_are_refused() {
    let cube = Solid::Cube.surface().unwrap();
    let base = usual(ExternalMesher::TetGen);
    let sizing = |sizing: Sizing| ExternalSettings { sizing: Some(sizing), ..base.clone() };
    let cases = [
        (ExternalSettings { max_volume: Some(0.0), ..base.clone() }, "max_volume is 0"),
        (ExternalSettings { max_volume: Some(1e-12), ..base.clone() }, "asks for more than 8.0e12 tets"),
        (ExternalSettings { quality: Some(1.0), ..base.clone() }, "quality is 1"),
        (ExternalSettings { quality: Some(f64::NAN), ..base.clone() }, "quality is NaN"),
        (ExternalSettings { quality: Some(1.4), ..usual(ExternalMesher::Gmsh) }, "Gmsh takes no quality"),
        (sizing(Sizing::uniform(-1.0)), "edge_length is -1"),
        (sizing(Sizing { edge_length: 0.1, feature_edge_length: 0.2, growth: 1.0 }), "feature_edge_length is 0.2"),
        (sizing(Sizing { edge_length: 0.1, feature_edge_length: 0.1, growth: f64::NAN }), "feature_growth is NaN"),
    ];
    for (settings, words) in cases {
        let error = external_mesh(&cube, &settings, &Cancel::default()).unwrap_err();
        assert!(matches!(error, ExternalError::Settings(_)) && error.to_string().contains(words), "{error}");
    }
}

#[test]
fn a_sheet_is_refused_before_the_mesher_is_looked_for() {
    let of = |thickness: f64, keep_boundary: bool| {
        let sheet = Solid::Box { size: [1.0, 1.0, thickness] }.surface().unwrap();
        let program = Some("/there/is/none".into());
        let settings = ExternalSettings { keep_boundary, program, ..usual(ExternalMesher::TetGen) };
        external_mesh(&sheet, &settings, &Cancel::default()).unwrap_err()
    };
    // Of a volume of 1e-4 and an area of 2.0004: 2.0004^3 / 1e-8 = 8.0e8 tets.
    let error = of(1e-4, false);
    assert!(matches!(error, ExternalError::TooThin { tets, .. } if (tets / 8.0048e8 - 1.0).abs() < 1e-3), "{error}");
    assert!(error.to_string().contains("keep_boundary = true"), "{error}");
    for error in [of(1e-3, false), of(1e-4, true)] {
        assert!(matches!(error, ExternalError::Missing { .. }), "{error}");
    }
}

/// What a shell script that passes for a mesher leads to.
#[cfg(unix)]
fn with_script(mesher: ExternalMesher, script: &str, limit: Duration, cancel: &Cancel) -> ExternalError {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("mesher");
    std::fs::write(&program, format!("#!/bin/sh\n{script}\n")).unwrap();
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    let settings = ExternalSettings { program: Some(program), time_limit: limit, ..usual(mesher) };
    external_mesh(&Solid::Cube.surface().unwrap(), &settings, cancel).unwrap_err()
}

#[test]
#[cfg(unix)]
fn failures_of_programs_become_errors_with_their_words() {
    let tets = "MeshVersionFormatted 2\\nDimension 3\\nVertices 4\\n0 0 0 0\\n1 0 0 0\\n0 1 0 0\\n0 0 1 0\\nTetrahedra";
    let write = |text: &str| format!("printf '{text}' | tee surface.mesh > result.mesh");
    let cases = [
        ("echo I am sorry; exit 1".into(), vec!["failed (exit status: 1)", "it said:\n  I am sorry"]),
        ("echo dying >&2; kill -SEGV $$".into(), vec!["failed (signal: 11", "dying"]),
        ("exit 3".into(), vec!["failed (exit status: 3)", "it said nothing"]),
        ("echo all went well".into(), vec!["without an error and without a mesh", "all went well"]),
        (write("garbage\\nand more"), vec!["cannot be read", ".mesh:1"]),
        (write(""), vec!["cannot be read", "is empty"]),
        (write(&format!("{tets} 0\\nEnd")), vec!["without a mesh"]),
        (write(&format!("{tets} 1\\n1 2 3 9 0\\nEnd")), vec!["cannot be read"]),
        (write(&format!("{tets} 1\\n1 2 3 4 0\\nEnd")), vec!["does not fill the surface", "no vertex of the mesh"]),
    ];
    for mesher in BOTH {
        for (script, words) in &cases {
            let text = with_script(mesher, script, Duration::from_secs(60), &Cancel::default()).to_string();
            for word in words {
                assert!(text.contains(word) && text.contains(&mesher.to_string()), "{script}\n-> {text}\nlacks {word}");
            }
        }
    }
}

#[test]
#[cfg(unix)]
fn a_program_that_hangs_is_ended_with_all_it_started() {
    let mark = tempfile::tempdir().unwrap();
    // The grandchild would hold on for ten minutes.
    let folder = mark.path().display();
    let script = format!("echo started; echo $$ > {folder}/child; sleep 600 & echo $! > {folder}/grandchild; wait");
    let start = Instant::now();
    let error = with_script(ExternalMesher::TetGen, &script, Duration::from_secs(2), &Cancel::default());
    assert!(matches!(error, ExternalError::TimedOut { .. }), "{error}");
    assert!(error.to_string().contains("ended after 2 s without a mesh; raise program_time_limit"), "{error}");
    assert!(error.to_string().contains("started"), "{error}");
    assert!(start.elapsed() < Duration::from_secs(300));
    if Path::new("/proc/self").exists() {
        // The program runs under a guard, so that both are reaped by init, in its own time.
        let gone = |name: &str| {
            let text = std::fs::read_to_string(mark.path().join(name)).unwrap();
            let status = std::fs::read_to_string(Path::new("/proc").join(text.trim()).join("stat"));
            !status.is_ok_and(|status| !status.contains(") Z "))
        };
        let deadline = Instant::now() + Duration::from_secs(60);
        for name in ["child", "grandchild"] {
            while !gone(name) && Instant::now() < deadline {
                std::thread::sleep(Duration::from_millis(10));
            }
            assert!(gone(name), "the {name} survived");
        }
    }
}

#[test]
#[cfg(unix)]
fn a_program_that_is_interrupted_is_ended() {
    let cancel = Cancel::default();
    let error = std::thread::scope(|scope| {
        let raised = cancel.clone();
        scope.spawn(move || {
            std::thread::sleep(Duration::from_millis(200));
            raised.raise();
        });
        // Were it not ended, the hour would run out the test's own patience.
        with_script(ExternalMesher::Gmsh, "sleep 3600", Duration::from_secs(3600), &cancel)
    });
    assert!(matches!(error, ExternalError::Cancelled(ExternalMesher::Gmsh)), "{error}");
}

#[test]
fn a_missing_program_is_told_with_ways_out() {
    for (kind, variable) in [("tetgen", "QCBALL_TETGEN"), ("gmsh", "QCBALL_GMSH")] {
        let folder = tempfile::tempdir().unwrap();
        let config = format!("[domain]\nsolid = \"cube\"\n[mesh]\nkind = \"{kind}\"\n");
        std::fs::write(folder.path().join("a.toml"), config).unwrap();
        let run = |environment: Option<&str>, arguments: &[&str]| {
            let mut command = assert_cmd::Command::new(assert_cmd::cargo::cargo_bin!("qcball"));
            command.current_dir(folder.path()).env("PATH", "").env_remove(variable).args(["run", "a.toml"]);
            environment.map(|value| command.env(variable, value));
            let output = command.args(arguments).output().unwrap();
            assert_eq!(output.status.code(), Some(2));
            // As one line: the error is wrapped.
            String::from_utf8_lossy(&output.stderr).split_whitespace().collect::<Vec<_>>().join(" ")
        };
        let error = run(None, &[]);
        let ways = [
            format!("there is no `{kind}` on PATH"),
            format!("apt-get install {kind}"),
            format!("{variable}=/path/to/{kind}"),
            format!("program = \"/path/to/{kind}\" under [mesh]"),
            "kind = \"shell\"".into(),
            "domain.file".into(),
        ];
        for way in ways {
            assert!(error.contains(&way), "{error}\nlacks {way}");
        }
        let error = run(Some("/nowhere/at/all"), &[]);
        assert!(error.contains(&format!("{variable} is /nowhere/at/all, which is no program")), "{error}");
        let error = run(Some("/nowhere/at/all"), &["--set", "mesh.program=mine/mesher"]);
        assert!(error.contains("the config's program is") && error.contains("mine/mesher, which is"), "{error}");
        let error = run(None, &["--set", "mesh.program=mesher-7"]);
        assert!(error.contains("the config's program is `mesher-7`, and nothing on PATH"), "{error}");
    }
}

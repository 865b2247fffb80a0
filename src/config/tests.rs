use std::path::Path;

use super::*;
use crate::mesh::Vec3;
use crate::optimize::{Effort, Engine, Objective, OptimizeSettings};
use crate::refine::{Budget, RefineSettings};
use crate::solid::{CentreChoice, ExternalMesher, ExternalSettings, Refinement, ShellSettings, Sizing, Solid};
use crate::sphere::SphereSettings;

/// A config file in a folder of its own, named `case.toml`.
fn plan(text: &str, overrides: &[&str]) -> Result<Plan, ConfigError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("case.toml");
    std::fs::write(&path, text).unwrap();
    for part in ["part.obj", "part.mesh"] {
        std::fs::write(folder.path().join(part), "").unwrap();
    }
    let overrides: Vec<String> = overrides.iter().map(|one| one.to_string()).collect();
    Plan::read(&path, &overrides)
}

/// The message, then the help.
fn refusal(text: &str, overrides: &[&str]) -> String {
    let error = plan(text, overrides).expect_err(text);
    format!("{error}\n{}", error.help())
}

#[test]
fn the_least_config_has_the_documented_defaults() {
    let plan = plan("[domain]\nsolid = \"cube\"", &[]).unwrap();
    assert_eq!(plan.name, "case");
    assert_eq!((plan.seed, plan.threads), (0, None));
    assert_eq!((plan.domain, plan.centre), (DomainSource::Solid(Solid::Cube), CentreChoice::Kernel));
    let shell = ShellSettings { subdivisions: 1, refinement: Some(Refinement::Ball(1.25)), layers: 8, grading: 1.0 };
    let external = ExternalSettings::new(ExternalMesher::TetGen);
    assert_eq!(plan.mesh, MeshPlan::Auto { shell, external, shell_keys: Vec::new() });
    assert_eq!(plan.map, InitialMap::Auto { exponent: Some(1.0) });
    assert_eq!((plan.optimize, plan.certify), (OptimizeSettings::default(), None));
}

#[test]
fn every_key_arrives() {
    let text = "name = \"fine\"\nseed = 7\nthreads = 2\n[domain]\nsolid = \"star-harmonics\"\namplitude = 0.5\n\
                degree = 6\nresolution = 16\ncentre = [0, 0.5, 1]\n[mesh]\nkind = \"shell\"\nsubdivisions = 2\ncells = 1000\nlayers = 3\n\
                grading = 1.5\n[map]\nkind = \"radial\"\nexponent = 2\n[optimize]\nobjective = \"soft-max\"\n\
                exponent = 16\nengine = \"lbfgs\"\neffort = \"quick\"\ntolerance = 1e-3\nmax_iterations = 9\ntime_limit = 0.5\n\
                [bounds]\ncertify = true\ncertify_time_limit = 2.5";
    let plan = plan(text, &[]).unwrap();
    assert_eq!((plan.name.as_str(), plan.seed, plan.threads), ("fine", 7, Some(2)));
    let solid = Solid::SmoothStar { amplitude: 0.5, degree: 6, resolution: 16, seed: 7 };
    assert_eq!((plan.domain, plan.centre), (DomainSource::Solid(solid), CentreChoice::At(Vec3::new(0.0, 0.5, 1.0))));
    let shell = ShellSettings { subdivisions: 2, refinement: Some(Refinement::Cells(1000)), layers: 3, grading: 1.5 };
    assert_eq!(plan.mesh, MeshPlan::Shell(shell));
    assert_eq!(plan.map, InitialMap::Radial { exponent: Some(2.0) });
    let expected = OptimizeSettings {
        objective: Objective::SoftMax(16.0),
        engine: Engine::Lbfgs,
        polish: OptimizeSettings::default().polish,
        rise: OptimizeSettings::default().rise,
        boundary_values: Default::default(),
        effort: Effort::Quick,
        tolerance: 1e-3,
        max_iterations: 9,
        time_limit: Some(std::time::Duration::from_millis(500)),
        cancel: Default::default(),
    };
    assert_eq!(plan.optimize, expected);
    assert_eq!(plan.certify, Some(std::time::Duration::from_millis(2500)));
}

#[test]
fn every_solid_can_be_named_and_takes_its_own_parameters_only() {
    use SolidName::*;
    let solids = [
        (Tetrahedron, ""),
        (Cube, ""),
        (Octahedron, ""),
        (Dodecahedron, ""),
        (Icosahedron, ""),
        (Prism, "sides = 5\nheight = 2"),
        (Pyramid, "sides = 5\nheight = 2"),
        (Bipyramid, "sides = 5\nheight = 2"),
        (Box, "size = [1, 2, 4]"),
        (Ball, "radius = 2\nresolution = 4"),
        (Torus, "radii = [3, 1]\nresolution = 4"),
        (Ellipsoid, "radii = [1, 2, 2.5]\nresolution = 4"),
        (StarHarmonics, "amplitude = 0.1\ndegree = 3\nresolution = 4"),
        (StarPolyhedron, "amplitude = 0.1\nresolution = 4"),
    ];
    let all = "sides = 5\nheight = 2\nsize = [1, 2, 4]\nradius = 2\nradii = [3, 1]\namplitude = 0.1\ndegree = 3\nresolution = 4";
    for (name, parameters) in solids {
        let start = format!("[domain]\nsolid = \"{}\"\n", solid::spelled(name));
        plan(&start, &[]).unwrap();
        plan(&format!("{start}{parameters}"), &[]).unwrap();
        for foreign in all.lines().filter(|line| !parameters.contains(line.split(' ').next().unwrap())) {
            let key = foreign.split(' ').next().unwrap();
            let message = refusal(&format!("{start}{foreign}"), &[]);
            assert!(message.contains(&format!("case.toml:3: `{key}` is no parameter of")), "{name:?} {message}");
        }
    }
    let message = refusal("[domain]\nfile = \"part.obj\"\nsides = 3", &[]);
    assert!(message.contains("case.toml:3: `sides` is no parameter of a file"), "{message}");
    assert!(message.contains("prism or pyramid or bipyramid"), "{message}");
}

#[test]
fn external_meshers_take_their_keys() {
    let mesh = |lines: &str| plan(&format!("[domain]\nsolid = \"cube\"\n[mesh]\n{lines}"), &[]).unwrap().mesh;
    let usual = ExternalSettings::new(ExternalMesher::TetGen);
    assert_eq!(mesh("kind = \"tetgen\""), MeshPlan::External(usual.clone()));
    let all = "kind = \"tetgen\"\nmax_volume = 0.25\nquality = 1.5\nkeep_boundary = true\nedge_length = 0.5\n\
               feature_edge_length = 0.125\nfeature_growth = 0.25\nprogram = \"tetgen-1.6\"\nprogram_time_limit = 2.5";
    let expected = ExternalSettings {
        program: Some("tetgen-1.6".into()),
        max_volume: Some(0.25),
        quality: Some(1.5),
        keep_boundary: true,
        sizing: Some(Sizing { edge_length: 0.5, feature_edge_length: 0.125, growth: 0.25 }),
        time_limit: std::time::Duration::from_millis(2500),
        ..usual
    };
    assert_eq!(mesh(all), MeshPlan::External(expected));
    let gmsh = ExternalSettings::new(ExternalMesher::Gmsh);
    let uniform = ExternalSettings { sizing: Some(Sizing::uniform(0.5)), ..gmsh.clone() };
    assert_eq!(mesh("kind = \"gmsh\"\nedge_length = 0.5"), MeshPlan::External(uniform));
    let features = Sizing { edge_length: f64::INFINITY, feature_edge_length: 0.1, growth: Sizing::GROWTH };
    let features = ExternalSettings { sizing: Some(features), ..gmsh };
    assert_eq!(mesh("kind = \"gmsh\"\nfeature_edge_length = 0.1"), MeshPlan::External(features));
}

#[test]
fn a_programs_path_is_relative_to_the_config() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("case.toml");
    let text = "[domain]\nsolid = \"cube\"\n[mesh]\nkind = \"gmsh\"\nprogram = \"tools/gmsh\"";
    std::fs::write(&path, text).unwrap();
    let MeshPlan::External(settings) = Plan::read(&path, &[]).unwrap().mesh else { panic!("not external") };
    assert_eq!(settings.program, Some(folder.path().join("tools/gmsh")));
}

#[test]
fn meshers_refuse_each_others_keys() {
    let keys = [
        ("subdivisions = 2", "auto shell"),
        ("cells = 9", "auto shell"),
        ("layers = 2", "auto shell flag"),
        ("grading = 2", "auto shell flag"),
        ("layer_grading = 2", "flag"),
        ("edge_length = 0.5", "auto shell tetgen gmsh"),
        ("feature_edge_length = 0.1", "auto tetgen gmsh"),
        ("feature_edge_length = 0.1\nfeature_growth = 0.1", "auto tetgen gmsh"),
        ("max_volume = 0.1", "auto tetgen gmsh"),
        ("quality = 2", "tetgen"),
        ("keep_boundary = false", "auto tetgen gmsh"),
        ("program = \"mesher\"", "tetgen gmsh"),
        ("program_time_limit = 5", "auto tetgen gmsh"),
    ];
    for kind in ["auto", "shell", "flag", "tetgen", "gmsh"] {
        for (lines, owners) in keys {
            let text = format!("[domain]\nsolid = \"cube\"\n[mesh]\nkind = \"{kind}\"\n{lines}");
            if owners.split(' ').any(|owner| owner == kind) {
                plan(&text, &[]).unwrap();
            } else {
                let key = lines.split(' ').next().unwrap();
                let message = refusal(&text, &[]);
                let (what, remedy) =
                    (format!("case.toml:5: `{key}` is no key of the mesher {kind}"), "remove it, or choose kind = ");
                assert!(message.contains(&what) && message.contains(remedy), "{message}");
            }
        }
    }
}

#[test]
fn maps_in_closed_form_are_read_as_in_the_table_analytic() {
    let map = |keys: &str, overrides: &[&str]| {
        plan(&format!("[domain]\nsolid = \"cube\"\n[map]\n{keys}"), overrides).unwrap().map
    };
    let formula = |kind: &str, words: &[&str]| {
        let words: Vec<String> = words.iter().map(|word| word.to_string()).collect();
        InitialMap::Formula(AnalyticMap::from_words(kind, &words).unwrap())
    };
    assert_eq!(map("kind = \"folding\"\nratio = 1", &["map.ratio=1.5"]), formula("folding", &["ratio=1.5"]));
    assert_eq!(map("kind = \"power\"\nexponent = -2", &[]), formula("power", &["exponent=-2"]));
    assert_eq!(map("kind = \"cone\"\nratio = 2\nangle = 0.5", &[]), formula("cone", &["ratio=2", "angle=0.5"]));
    let [matrix, maps] = ["[[1, 0, 0], [0, 1, 0], [0, 0, 2]]", "[{ kind = \"zorich\", half_side = 2 }]"];
    let affine = formula("affine", &[&format!("matrix={matrix}"), "offset=[0, 2, 0]"]);
    assert_eq!(map(&format!("kind = \"affine\"\nmatrix = {matrix}\noffset = [0, 2, 0]"), &[]), affine);
    for kind in ["zorich1", "zorich2", "zorich"] {
        assert_eq!(map(&format!("kind = \"{kind}\"\nhalf_side = 2"), &[]), formula(kind, &["half_side=2"]));
    }
    let composed = formula("composition", &[&format!("maps={maps}")]);
    assert_eq!(map(&format!("kind = \"composition\"\nmaps = {maps}"), &[]), composed);
    assert_eq!(map("kind = \"caraman\"\nexponent = 2", &[]), InitialMap::Radial { exponent: Some(2.0) });
    assert_eq!(map("exponent = 2", &[]), InitialMap::Auto { exponent: Some(2.0) });
    let spherical =
        |area_weight| InitialMap::Spherical { weights: SphereSettings { area_weight, ..SphereSettings::default() } };
    assert_eq!(map("kind = \"spherical\"", &[]), spherical(0.0));
    assert_eq!(map("kind = \"spherical\"\narea_weight = 0.5", &[]), spherical(0.5));
}

#[test]
fn faults_name_line_key_and_remedy() {
    let cube = "[domain]\nsolid = \"cube\"\n";
    let cases: &[(&str, &[&str])] = &[
        ("", &["case.toml: no solid", "[domain]\nsolid = \"cube\""]),
        ("# nothing\n[domain]\n", &["case.toml:2: no solid"]),
        ("[domain]\nsolid = \"cube\"\nfile = \"part.obj\"", &["case.toml:3: both"]),
        (
            "[domain]\nfile = \"none.obj\"",
            &["case.toml:2: the file ", "none.obj does not exist", "relative to the config"],
        ),
        ("[domain]\nfile = \".\"", &["case.toml:2: the file ", "is not a file"]),
        ("[domain]\nsolid = \"cub\"", &["case.toml:2: `domain.solid` cannot be `cub`", "did you mean `cube`?"]),
        ("[domain]\nsolid = 3", &["case.toml:2: `domain.solid`"]),
        ("[domain]\nsolid = \"cube\"\ncentre = [0, 1]", &["case.toml:3: `domain.centre`", "a point [x, y, z]"]),
        ("[domain]\nsolid = \"cube\"\ncentre = \"middle\"", &["case.toml:3: `domain.centre`", "\"kernel\""]),
        ("[domain]\nsolid = \"cube\"\ncentre = [0, nan, 1]", &["case.toml:3", "not finite"]),
        ("[domain]\nsolid = \"box\"\nsize = [1, 2]", &["case.toml:3: `size`", "3 lengths"]),
        ("[domain]\nsolid = \"torus\"\nradii = [1, 2]", &["case.toml:3", "ring > tube"]),
        ("[domain]\nsolid = \"prism\"\nsides = 2", &["case.toml:3: `domain.sides` is 2"]),
        ("[domian]\nsolid = \"cube\"", &["case.toml:1: unknown key `domian`", "did you mean `domain`?"]),
        (&format!("{cube}[mesh]\nlayer = 3"), &["case.toml:4: unknown key `mesh.layer`", "did you mean `layers`?"]),
        (&format!("{cube}[mesh]\nzzz = 3"), &["case.toml:4: unknown key `mesh.zzz`", "known here: kind, subdivisions"]),
        (&format!("{cube}[mesh]\nlayers = 0"), &["case.toml:4: `mesh.layers` is 0", "between 1 and"]),
        (&format!("{cube}[mesh]\nlayers = 2.5"), &["case.toml:4: `mesh.layers`", "a whole number"]),
        (&format!("{cube}[mesh]\nlayers = \"3\""), &["case.toml:4: `mesh.layers`", "a whole number"]),
        (&format!("{cube}[mesh]\ngrading = -1"), &["case.toml:4: `mesh.grading` is -1", "greater than 0"]),
        (&format!("{cube}mesh = {{ cells = 9,\n edge_length = 1 }}"), &["unknown key `domain.mesh`"]),
        (&format!("{cube}[mesh]\ncells = 9\nedge_length = 1"), &["case.toml:4: both `edge_length` and `cells`"]),
        (&format!("{cube}[mesh]\nkind = \"tetgn\""), &["case.toml:4: `mesh.kind` cannot be", "did you mean `tetgen`?"]),
        (&format!("{cube}[mesh]\nkind = \"tetgen\"\nquality = 1"), &["case.toml:5: `mesh.quality` is 1", "1.4"]),
        (&format!("{cube}[mesh]\nkind = \"tetgen\"\nmax_volume = 0"), &["case.toml:5: `mesh.max_volume` is 0"]),
        (&format!("{cube}[mesh]\nkind = \"gmsh\"\nprogram = \"\""), &["case.toml:5: `mesh.program` is empty"]),
        (
            &format!("{cube}[mesh]\nkind = \"gmsh\"\nprogram_time_limit = -1"),
            &["case.toml:5: `mesh.program_time_limit` is -1"],
        ),
        (
            &format!("{cube}[mesh]\nkind = \"gmsh\"\nfeature_growth = 1"),
            &["case.toml:5: `feature_growth` says nothing without `feature_edge_length`"],
        ),
        (
            &format!("{cube}[mesh]\nkind = \"gmsh\"\nedge_length = 0.1\nfeature_edge_length = 0.5"),
            &["case.toml:6: `mesh.feature_edge_length` is 0.5, more than `mesh.edge_length`, which is 0.1"],
        ),
        (
            "[domain]\nfile = \"part.mesh\"\n[mesh]\nkind = \"tetgen\"",
            &["case.toml:4: `kind` speaks of a mesh to be made"],
        ),
        (
            &format!("{cube}[boundary]\ncorners = \"powers\""),
            &["case.toml:4: `boundary.corners` cannot be `powers`", "did you mean `power`?", "linear, power, a number"],
        ),
        (&format!("{cube}[boundary]\ncorners = [1.5]"), &["case.toml:4: `boundary.corners`", "\"power\" or a number"]),
        (&format!("{cube}[map]\nexponent = -2"), &["case.toml:4: `map.exponent` is -2"]),
        (&format!("{cube}[map]\nratio = 2"), &["case.toml:4: `ratio` is no parameter of a radial map"]),
        (&format!("{cube}[map]\nkind = \"folding\""), &["case.toml:3: `map.ratio`: missing field", "qcball schema"]),
        (
            &format!("{cube}[map]\nkind = \"folding\"\nratio = 2\nangle = 1"),
            &["case.toml:6: unknown key `map.angle`", "known here: ratio"],
        ),
        (&format!("{cube}[map]\nkind = \"foldin\""), &["case.toml:4: `map.kind` cannot be", "did you mean `folding`?"]),
        (&format!("{cube}[map]\nkind = \"folding\"\nratio = -2"), &["case.toml:5: [map]: ratio is -2", "positive"]),
        (&format!("{cube}[map]\nkind = \"power\"\nexponent = \"optimize\""), &["case.toml:5: the best exponent"]),
        (
            &format!("{cube}[map]\nkind = \"composition\"\nmaps = [{{ kind = \"fold\", ratio = 2 }}]"),
            &["case.toml:5: `map.maps` cannot be `fold`", "known here: affine"],
        ),
        (&format!("{cube}[map]\nexponent = inf"), &["case.toml:4: `map.exponent` is inf"]),
        (
            &format!("{cube}[optimize]\nexponent = -1\nobjective = \"soft-max\""),
            &["case.toml:4: `optimize.exponent` is -1"],
        ),
        (&format!("{cube}[optimize]\nexponent = 4"), &["case.toml:4: the objective \"max\" takes no `exponent`"]),
        (&format!("{cube}[optimize]\nobjective = \"soft-max\""), &["case.toml:4", "needs an `exponent`"]),
        (&format!("{cube}[bounds]\ncertify_time_limit = 9"), &["case.toml:4", "add certify = true"]),
        (
            &format!("{cube}[bounds]\ncertify = true\ncertify_time_limit = 0"),
            &["case.toml:5: `bounds.certify_time_limit` is 0"],
        ),
        (&format!("{cube}[optimize]\ntolerance = 0"), &["case.toml:4: `optimize.tolerance` is 0"]),
        (&format!("{cube}[optimize]\nmax_iterations = -1"), &["case.toml:4: `optimize.max_iterations` is -1"]),
        ("seed = -1\n[domain]\nsolid = \"cube\"", &["case.toml:1: `seed` is -1"]),
        ("threads = -1\n[domain]\nsolid = \"cube\"", &["case.toml:1: `threads` is -1"]),
        ("name = \"../up\"\n[domain]\nsolid = \"cube\"", &["case.toml:1: the name \"../up\""]),
        ("name = \"\"\n[domain]\nsolid = \"cube\"", &["case.toml:1: the name \"\""]),
        (
            "[[mesh]]\nlayers = 3\n[domain]\nsolid = \"cube\"",
            &["case.toml:1: `mesh` is a list", "write [mesh], not [[mesh]]"],
        ),
        (&format!("{cube}[map]\nkind = \"composition\"\nmaps = [1]"), &["case.toml:5: `map.maps`", "expected a map {"]),
        (&format!("{cube}[map]\nkind = 1"), &["case.toml:4: `map.kind`: expected a word"]),
        ("boundary = 1\n[domain]\nsolid = \"cube\"", &["case.toml:1: `boundary`", "the table [boundary]"]),
        ("[domain\nsolid = \"cube\"", &["case.toml:1: "]),
        ("[domain]\nsolid = \"cube\"\nsolid = \"ball\"", &["case.toml:3: ", "duplicate key"]),
    ];
    for (text, words) in cases {
        let message = refusal(text, &[]);
        for word in *words {
            assert!(message.contains(word), "{text}\n-> {message}\nlacks {word}");
        }
    }
}

#[test]
fn overrides_apply_in_order_and_are_blamed_for_their_own_faults() {
    let cube = "[domain]\nsolid = \"cube\"\n[mesh]\nlayers = 0";
    let good = plan(cube, &["mesh.layers=2", "domain.solid=ball", "domain.resolution = 3", "mesh.layers=5"]).unwrap();
    assert!(
        matches!(&good.mesh, MeshPlan::Auto { shell: ShellSettings { layers: 5, .. }, shell_keys, .. } if shell_keys == &["layers"]),
        "{:?}",
        good.mesh
    );
    assert_eq!(good.domain, DomainSource::Solid(Solid::Ball { radius: 1.0, resolution: 3 }));
    assert_eq!(plan("", &["domain.solid=\"ball\""]).unwrap().source.overrides().count(), 1);
    let cases: &[(&str, &[&str])] = &[
        ("mesh.layers", &["--set mesh.layers: there is no `=`"]),
        ("mesh..layers=1", &["--set mesh..layers=1: a part of the key is empty"]),
        ("mesh.layer=1", &["--set mesh.layer=1: unknown key `mesh.layer`", "did you mean `layers`?"]),
        ("mesh.layers=0", &["--set mesh.layers=0: `mesh.layers` is 0"]),
        ("mesh.layers=many", &["--set mesh.layers=many: `mesh.layers`", "a whole number"]),
        ("mesh={layers=-1}", &["--set mesh={layers=-1}: `mesh.layers` is -1"]),
        ("bounds=[true]", &["--set bounds=[true]: `bounds` is a list", "the table [bounds]", "bounds.KEY"]),
        ("mesh=[]", &["--set mesh=[]: `mesh` is a list"]),
        ("mesh.layers.x=1", &["`layers` is a value, not a table"]),
        ("domain.solid=cub", &["`domain.solid` cannot be `cub`", "did you mean `cube`?"]),
        ("domain.sides=3", &["--set domain.sides=3: `sides` is no parameter of the solid cube"]),
        ("seed=1\nthreads=2", &["--set seed=1\nthreads=2: `seed`"]),
    ];
    for (typed, words) in cases {
        let message = refusal(cube, &[typed]);
        for word in *words {
            assert!(message.contains(word), "{typed}\n-> {message}\nlacks {word}");
        }
    }
    // The fault is the file's, whatever else was overridden.
    assert!(refusal(cube, &["mesh.grading=2"]).contains("case.toml:4: `mesh.layers` is 0"));
}

#[test]
fn the_hash_sees_meaning_not_layout_or_threads() {
    let hash = |text: &str, overrides: &[&str]| plan(text, overrides).unwrap().source.hash();
    let plain = hash("seed = 1\n[domain]\nsolid = \"cube\"\ncentre = \"kernel\"", &[]);
    assert_eq!(plain, hash("threads = 2\nseed=1 # same\ndomain = { centre = \"kernel\", solid = 'cube' }", &[]));
    assert_eq!(plain, hash("[domain]\nsolid = \"cube\"\ncentre = \"kernel\"", &["seed=1"]));
    assert_ne!(plain, hash("seed = 2\n[domain]\nsolid = \"cube\"\ncentre = \"kernel\"", &[]));
}

#[test]
fn the_schema_describes_every_key() {
    let schema: serde_json::Value = serde_json::from_str(&schema()).unwrap();
    let mut described = 0;
    let tables = schema["$defs"].as_object().unwrap().values();
    // Maps in closed form are listed kind by kind, each with its own table.
    for table in tables.filter(|table| table["type"] == "object") {
        for (key, value) in table["properties"].as_object().unwrap() {
            assert!(value["description"].is_string(), "{key} lacks a description");
            described += 1;
        }
        assert_eq!(table["additionalProperties"], false);
    }
    assert_eq!(described, 102, "keys in the schema");
    let text = schema.to_string();
    for solid in ["\"tetrahedron\"", "\"star-polyhedron\""] {
        assert!(text.contains(solid), "{solid}");
    }
}

#[test]
fn a_map_without_a_solid_takes_no_key_that_would_be_passed_over() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("case.toml");
    let read = |text: &str| {
        std::fs::write(&path, text).unwrap();
        optimize_settings(&path, None)
    };
    for (table, key, value) in [
        ("boundary", "corners", "1.5"),
        ("boundary", "corner_vertices", "[0]"),
        ("boundary", "collar", "0.1"),
        ("optimize", "symmetric", "true"),
        ("optimize", "objective", "\"ball\""),
    ] {
        let message = read(&format!("[{table}]\n{key} = {value}\n")).unwrap_err().to_string();
        assert!(message.contains(&format!("`{table}.{key}` ")) && message.contains("case.toml:2"), "{message}");
    }
    let sliding = read("[boundary]\nvalues = \"sliding\"\ncorners = \"linear\"\n[refine]\nrounds = 0\ntets = 5\n");
    assert_eq!(sliding.unwrap().refine, None);
    assert_eq!(
        read("[refine]\nrounds = 2\n").unwrap().refine,
        Some(RefineSettings { rounds: 2, ..RefineSettings::default() })
    );
    // What a run heeds is named, so that one config may serve both.
    let both =
        read("threads = 2\n[domain]\nsolid = \"cube\"\n[mesh]\nlayers = 3\n[optimize]\ntolerance = 1e-3\n[bounds]\n")
            .unwrap();
    assert_eq!((both.idle, both.optimize.tolerance), (vec!["threads", "[domain]", "[mesh]", "[bounds]"], 1e-3));
    assert!(read("[optimize]\ntolerance = 1e-3\n").unwrap().idle.is_empty());
    let message = read("[refine]\nsurface = true\n").unwrap_err().to_string();
    assert!(message.contains("`refine.surface` is for `qcball run`"), "{message}");
    std::fs::write(&path, "[refine]\nrounds = 2\n").unwrap();
    let message = optimize_settings(&path, Some("--lock")).unwrap_err().to_string();
    assert!(message.contains("`refine.rounds` asks") && message.contains("--lock"), "{message}");
}

#[test]
fn a_missing_file_and_a_folder_are_named() {
    let folder = tempfile::tempdir().unwrap();
    for path in [folder.path(), &folder.path().join("none.toml"), Path::new("")] {
        let message = Plan::read(path, &[]).unwrap_err().to_string();
        assert!(message.starts_with(&format!("cannot read {}: ", path.display())), "{message}");
    }
}

proptest::proptest! {
    #[test]
    fn random_text_never_panics(text in "([a-z_.]{0,6}|\\[domain\\]|solid|=|\"cube\"|[0-9eE.+-]{0,4}|[\\[\\]{},\n #'])*") {
        let _ = plan(&text, &[]);
        let _ = plan("", &[&text]);
    }
}

#[cfg(feature = "nlopt")]
#[test]
fn an_engine_for_the_largest_k_is_refused_for_soft_maxima() {
    let start = "[domain]\nsolid = \"cube\"\n[optimize]\nengine = \"slsqp\"\n";
    assert_eq!(plan(start, &[]).unwrap().optimize.engine, Engine::Slsqp);
    let message = plan(&format!("{start}objective = \"soft-max\"\nexponent = 4\n"), &[]).unwrap_err().to_string();
    assert!(message.contains("slsqp") && message.contains("largest K only"), "{message}");
}

#[test]
fn refinement_is_off_without_rounds_and_refused_where_it_cannot_be() {
    let cube = "[domain]\nsolid = \"cube\"\n";
    assert_eq!(plan(cube, &[]).unwrap().refine, None);
    assert_eq!(plan(cube, &["refine.rounds=0", "refine.tets=5"]).unwrap().refine, None);
    let refine = |overrides: &[&str]| plan(cube, overrides).unwrap().refine.unwrap();
    let default = RefineSettings { rounds: 3, ..RefineSettings::default() };
    assert_eq!(refine(&["refine.rounds=3"]), default);
    assert_eq!(refine(&["refine.tets=5"]), RefineSettings { tets: Budget::Tets(5), ..RefineSettings::default() });
    assert_eq!(refine(&["refine.until=0.02"]), RefineSettings::default());
    let given = refine(&["refine.rounds=3", "refine.tets=\"5 %\"", "refine.until=0.1"]);
    assert_eq!(given, RefineSettings { rounds: 3, tets: Budget::Share(0.05), until: 0.1, surface: false });
    assert_eq!(refine(&["refine.rounds=3", "refine.tets=200"]).tets, Budget::Tets(200));
    let sliding = ["refine.surface=true", "boundary.values=\"sliding\""];
    assert_eq!(refine(&sliding), RefineSettings { rounds: 12, tets: Budget::Share(6.0), until: 0.02, surface: true });
    assert!(refine(&["refine.surface=true", "boundary.corners=\"power\""]).surface);
    for (overrides, word) in [
        (&["refine.rounds=-1"][..], "refine.rounds"),
        (&["refine.tets=\"many\""], "5 %"),
        (&["refine.tets=-1"], "the default is \"10 %\""),
        (&["refine.tets=5", "boundary.values=\"sliding\""], "slide"),
        (&["refine.until=0"], "refine.until"),
        (&["refine.rounds=3", "optimize.objective=\"soft-max\"", "optimize.exponent=4"], "interior-point method"),
        (&["refine.rounds=3", "boundary.corners=1.5"], "piecewise-linear"),
        (&["refine.surface=true", "map.kind=\"power\"", "map.exponent=2.0"], "no values for new vertices"),
        (&["refine.rounds=3", "boundary.values=\"sliding\""], "slide"),
        (
            &["refine.rounds=3", "boundary.values=\"sliding\"", "boundary.corners=1.5"],
            "slide here; refinement inside alone",
        ),
        (&["refine.surface=true", "boundary.corners=1.5", "mesh.kind=\"flag\""], "cones of flags"),
    ] {
        let message = refusal(cube, overrides);
        assert!(message.contains(word), "{overrides:?}: {message}");
    }
}

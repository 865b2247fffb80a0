use super::*;

fn sweep(text: &str, overrides: &[&str]) -> Result<SweepPlan, ConfigError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("case.toml");
    std::fs::write(&path, text).unwrap();
    let overrides: Vec<String> = overrides.iter().map(|one| one.to_string()).collect();
    SweepPlan::read(&path, &overrides)
}

/// The cases of a sweep over a cube, each as `--set` would take its settings.
fn cases(lines: &str, overrides: &[&str]) -> Vec<String> {
    let plan = sweep(&format!("[domain]\nsolid = \"cube\"\n{lines}"), overrides).unwrap();
    plan.cases.iter().map(|case| in_words(&case.settings)).collect()
}

#[test]
fn grids_are_products_in_the_order_of_the_file() {
    // Not the alphabet's order; quoted keys and nested tables are the same.
    let text =
        "[sweep.grid]\n\"mesh.layers\" = [3, 2]\nmap.exponent = [0.5, 1]\n\"domain.solid\" = [\"cube\", \"ball\"]";
    let expected: Vec<String> = [3, 2]
        .iter()
        .flat_map(|layers| ["0.5", "1"].map(|exponent| (layers, exponent)))
        .flat_map(|(layers, exponent)| {
            ["cube", "ball"].map(|solid| format!("mesh.layers={layers}, map.exponent={exponent}, domain.solid={solid}"))
        })
        .collect();
    assert_eq!(cases(text, &[]), expected);
}

#[test]
fn an_override_replaces_the_values_of_a_key_in_its_place_whichever_way_the_file_spells_it() {
    let text = "[sweep.grid]\n\"map.exponent\" = [0.5, 1]\nmesh.layers = [3, 2]";
    let overrides = ["sweep.grid.map.exponent=[2]", "sweep.grid.mesh.layers={ from = 4, to = 5, step = 1 }"];
    assert_eq!(cases(text, &overrides), ["map.exponent=2, mesh.layers=4", "map.exponent=2, mesh.layers=5"]);
    // And brings in a key that the file does not vary.
    assert_eq!(cases("", &["sweep.grid.map.exponent=[1,2]"]), ["map.exponent=1", "map.exponent=2"]);
}

#[test]
fn zipped_keys_go_together_and_seeds_vary_fastest() {
    let text = "[sweep]\nseeds = 2\n[sweep.zip]\n\"mesh.layers\" = [1, 2]\n\"mesh.subdivisions\" = { from = 3, to = 5, step = 2 }\n\
                [sweep.grid]\n\"map.exponent\" = [2]";
    let expected = [
        "mesh.layers=1, mesh.subdivisions=3, map.exponent=2, seed=0",
        "mesh.layers=1, mesh.subdivisions=3, map.exponent=2, seed=1",
        "mesh.layers=2, mesh.subdivisions=5, map.exponent=2, seed=0",
        "mesh.layers=2, mesh.subdivisions=5, map.exponent=2, seed=1",
    ];
    assert_eq!(cases(text, &[]), expected);
    assert_eq!(cases("[sweep]\nseeds = [7, 3]", &[]), ["seed=7", "seed=3"]);
    assert_eq!(cases("", &["sweep.seeds=[5]", "mesh.layers=2"]), ["seed=5"]);
}

#[test]
fn ranges_give_the_numbers_a_list_would() {
    let exponents = |range: &str| cases(&format!("[sweep.grid]\nmap.exponent = {range}"), &[]).join(" ");
    let words = |numbers: &str| numbers.split(' ').map(|n| format!("map.exponent={n}")).collect::<Vec<_>>().join(" ");
    assert_eq!(exponents("{ from = 0.1, to = 0.7, step = 0.1 }"), words("0.1 0.2 0.3 0.4 0.5 0.6 0.7"));
    assert_eq!(exponents("{ from = 1, to = 2, steps = 5 }"), words("1.0 1.25 1.5 1.75 2.0"));
    assert_eq!(exponents("{ from = 2, to = 8, step = 4 }"), words("2 6"));
    assert_eq!(exponents("{ from = 9, to = 1, steps = 3 }"), words("9 5 1"));
    assert_eq!(exponents("{ from = 3, to = 1, step = -1 }"), words("3 2 1"));
    assert_eq!(exponents("{ from = 3, to = 3, steps = 1 }"), words("3"));
}

#[test]
fn excluded_cases_are_left_out() {
    let grid = "[sweep.grid]\n\"map.exponent\" = [0.5, 1, 2]\n\"mesh.layers\" = [1, 2]";
    let one = cases(&format!("[sweep]\nexclude = [{{ \"map.exponent\" = 2.0, mesh.layers = 1 }}]\n{grid}"), &[]);
    assert_eq!(one.len(), 5);
    assert!(!one.contains(&"map.exponent=2, mesh.layers=1".to_string()));
    let any = cases(&format!("[sweep]\nexclude = [{{ \"map.exponent\" = [0.5, 2] }}]\n{grid}"), &[]);
    assert_eq!(any, ["map.exponent=1, mesh.layers=1", "map.exponent=1, mesh.layers=2"]);
}

#[test]
fn a_key_may_take_whole_tables() {
    let text = "[sweep.grid]\ndomain = [{ solid = \"cube\" }, { solid = \"prism\", sides = 5 }]";
    let plan = sweep(text, &[]).unwrap();
    assert_eq!(plan.keys, ["domain"]);
    let solids: Vec<_> = plan.cases.iter().map(|case| &case.plan.domain).collect();
    assert_ne!(solids[0], solids[1]);
}

#[test]
fn the_cases_are_plans_of_the_config_with_their_settings() {
    let text = "[domain]\nsolid = \"cube\"\n[mesh]\nlayers = 3\n[sweep.grid]\n\"map.exponent\" = [0.5, 2.0]";
    let plan = sweep(text, &[]).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("case.toml");
    std::fs::write(&path, text).unwrap();
    for (case, exponent) in plan.cases.iter().zip(["0.5", "2.0"]) {
        let alone = Plan::read(&path, &[format!("map.exponent={exponent}")]).unwrap();
        assert_eq!((&case.plan.map, &case.plan.mesh), (&alone.map, &alone.mesh));
        assert_eq!(case.plan.source.hash(), alone.source.hash());
    }
}

#[test]
fn faults_name_the_line_and_the_remedy() {
    let grid = |line: &str| format!("[domain]\nsolid = \"cube\"\n[sweep.grid]\n{line}");
    let sweep_table = |line: &str| format!("[domain]\nsolid = \"cube\"\n[sweep]\n{line}\n");
    let two = "[sweep.grid]\n\"mesh.layers\" = [1, 2]";
    let faults: &[(String, &[&str])] = &[
        ("[domain]\nsolid = \"cube\"".into(), &["case.toml: there is no table [sweep]", "[sweep.grid]"]),
        (sweep_table(""), &["case.toml:3: the sweep varies no key"]),
        (sweep_table("sedes = 3"), &["case.toml:4: unknown key `sweep.sedes`", "did you mean `seeds`?"]),
        ("[sweep.gird]\nx = [1]".into(), &["case.toml:1: unknown key `sweep.gird`", "did you mean `grid`?"]),
        (grid("\"map.exponnt\" = [1]"), &["case.toml:4: unknown key `map.exponnt`", "did you mean `exponent`?"]),
        (grid("map.exponent = 2"), &["case.toml:4: `sweep.grid.map.exponent` is neither a list nor a range"]),
        (grid("\"map.exponent\" = []"), &["case.toml:4: `sweep.grid.map.exponent` has no values"]),
        (grid("\"map.exponent\" = [1, -2]"), &["case.toml:4: `map.exponent` is -2", "in the case map.exponent=-2"]),
        (grid("\"mesh.layers\" = [1, \"x\"]"), &["case.toml:4: `mesh.layers`", "a whole number"]),
        (
            grid("\"mesh.layers\" = { from = 1, too = 2, step = 1 }"),
            &["case.toml:4: `sweep.grid.mesh.layers`: unknown key `too`", "did you mean `to`?"],
        ),
        (grid("\"mesh.layers\" = { from = 1, to = 2 }"), &["case.toml:4", "exactly one of `step` and `steps`"]),
        (grid("\"mesh.layers\" = { from = 1, to = 2, step = 0 }"), &["case.toml:4", "does not lead from"]),
        (grid("\"mesh.layers\" = { from = 1, to = 2, step = -1 }"), &["case.toml:4", "does not lead from"]),
        (grid("\"mesh.layers\" = { from = 1, to = inf, steps = 3 }"), &["case.toml:4", "does not lead from"]),
        (grid("\"mesh.layers\" = { from = 1, to = 2, steps = 1 }"), &["case.toml:4", "2 steps at least"]),
        (grid("\"mesh.layers\" = { from = 1, to = 1e9, step = 1e-3 }"), &["case.toml:4", "10000 is the limit"]),
        (grid("threads = [1, 2]"), &["case.toml:4: `threads` cannot be varied"]),
        (grid("\"mesh..layers\" = [1]"), &["case.toml:4: `mesh..layers` is no key"]),
        (grid("\"mesh.layers\" = [2, 2]"), &["case.toml", "two cases are the same run", "mesh.layers=2"]),
        (grid("\"mesh.layers\" = [2]\nmesh.layers = [3]"), &["`mesh.layers` is varied twice"]),
        (grid("\"mesh.layers\" = [2]\nmesh = [{ layers = 3 }]"), &["varied twice"]),
        (
            grid(
                "\"map.exponent\" = { from = 1, to = 2, steps = 1000 }\n\"mesh.grading\" = { from = 1, to = 2, steps = 1000 }",
            ),
            &["the sweep has 1000000 cases", "10000 is the limit", "split the sweep"],
        ),
        (
            format!("{}[sweep.zip]\n\"mesh.layers\" = [1, 2]\n\"map.exponent\" = [1]", sweep_table("")),
            &["case.toml:7: `map.exponent` has 1 values, but `mesh.layers`", "equally many"],
        ),
        (sweep_table("seeds = 0"), &["case.toml:4: `sweep.seeds` is 0"]),
        (sweep_table("seeds = 1000000"), &["case.toml:4: the sweep has 1000000 cases or more, but 10000 is the limit"]),
        (sweep_table("seeds = [-1]"), &["case.toml:4: `seed` is -1"]),
        (
            sweep_table(&format!("exclude = [{{ \"mesh.layer\" = 1 }}]\n{two}")),
            &["case.toml:4: `mesh.layer` is no key that the sweep varies", "did you mean `mesh.layers`?"],
        ),
        (sweep_table(&format!("exclude = [{{ mesh.layers = 7 }}]\n{two}")), &["case.toml:4: entry 1", "no case"]),
        (sweep_table(&format!("exclude = [{{ mesh.layers = [1, 2] }}]\n{two}")), &["every case is left out"]),
        (sweep_table(&format!("exclude = [{{}}]\n{two}")), &["case.toml:4: an entry without keys"]),
    ];
    for (text, words) in faults {
        let error = sweep(text, &[]).expect_err(text);
        let message = format!("{error}\n{}", error.help());
        for word in *words {
            assert!(message.contains(word), "{text}\n-> {message}\nlacks {word}");
        }
    }
    for set in ["mesh.layers=3", "mesh={layers=3}"] {
        let message = sweep(&grid("\"mesh.layers\" = [1, 2]"), &[set]).unwrap_err().to_string();
        assert!(message.contains(&format!("case.toml:4: `mesh.layers` is varied here, but also set by --set {set}")));
    }
    // The other faults of a case stand at their own place and name the case.
    let text = grid("\"optimize.objective\" = [\"max\", \"soft-max\"]");
    let message = sweep(&text, &[]).unwrap_err().to_string();
    assert!(message.contains("case.toml:4: the objective \"soft-max\" needs an `exponent`"), "{message}");
}

proptest::proptest! {
    #[test]
    fn random_sweeps_never_panic(
        text in "([a-z.]{0,6}|\"mesh.layers\"|=|\\{|\\}|from|to|steps?|,|exclude|seeds|\\[sweep(.grid|.zip)?\\]\n|[0-9eE.+-]{0,9}|[\\[\\]\n ])*"
    ) {
        let _ = sweep(&format!("[domain]\nsolid = \"cube\"\n[sweep]\n{text}"), &[]);
    }
}

//! `report.html` through the program, and in a real browser where there is one.
//!
//! The browser is `QCBALL_BROWSER`, or Chromium on the PATH; with `QCBALL_BROWSER_REQUIRED` set its absence is a failure.

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use assert_cmd::cargo::cargo_bin;
use serde_json::Value;

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

/// The page of a mesh of 100,000 tets has the size that the guide states: 3 MB.
#[test]
fn a_large_mesh_makes_a_page_of_three_megabytes() {
    let folder = tempfile::tempdir().unwrap();
    let made = run(folder.path(), 8, 12, 1);
    let record: Value = serde_json::from_slice(&fs::read(made.join("report.json")).unwrap()).unwrap();
    assert!(record["domain"]["tets"].as_u64().unwrap() > 100_000);
    let page = made.join("report.html");
    let bytes = fs::metadata(&page).unwrap().len();
    assert!((2_500_000..3_500_000).contains(&bytes), "{bytes}");
    if let Some(browser) = Browser::find() {
        let seen = browser.open(&page, "").probe;
        println!("100,000 tets: ready after {} ms, complete after {} ms", seen["ready"], seen["complete"]);
        assert_eq!(seen["errors"], serde_json::json!([]));
    }
}

/// A headless browser.
struct Browser(PathBuf);

/// What came of opening a page.
struct Seen {
    /// What the probe noted, with `errors` of the page and `ready` and `complete` in milliseconds.
    probe: Value,
    /// RGB of the page's top after the probe, row by row, and its width.
    pixels: (Vec<[u8; 3]>, usize),
}

/// Runs before all else in the page: keeps what the console would show as an error.
const KEEP_ERRORS: &str = "<script>window.errors = [];
const keep = (what) => errors.push(String(what));
addEventListener('error', (event) => keep(event.message));
addEventListener('unhandledrejection', (event) => keep(event.reason));
addEventListener('securitypolicyviolation', (event) => keep(`refused: ${event.blockedURI} ${event.violatedDirective}`));
for (const kind of ['error', 'warn']) console[kind] = (...words) => keep(words.join(' '));
</script>";

impl Browser {
    fn find() -> Option<Self> {
        let named = std::env::var_os("QCBALL_BROWSER").map(PathBuf::from);
        let path = std::env::var_os("PATH").unwrap_or_default();
        let known = ["chromium", "chromium-browser", "google-chrome", "chrome"];
        let on_path = || {
            let mut places = std::env::split_paths(&path).flat_map(|folder| known.map(|name| folder.join(name)));
            places.find(|place| place.is_file())
        };
        let found = named.or_else(on_path).map(Self);
        if found.is_none() {
            assert!(std::env::var_os("QCBALL_BROWSER_REQUIRED").is_none(), "no browser, but one is required");
            println!("skipped: no Chromium on the PATH, and QCBALL_BROWSER names none");
        }
        found
    }

    /// Opens a copy of a page in which `script`, the body of an async function, notes what it sees in `seen`.
    fn open(&self, page: &Path, script: &str) -> Seen {
        self.open_at(1400, page, script)
    }

    /// The same in a window so many pixels wide.
    fn open_at(&self, width: u32, page: &Path, script: &str) -> Seen {
        let folder = tempfile::tempdir().unwrap();
        let probe = format!(
            "<script type=\"module\">const root = document.documentElement;
            const seen = {{}};
            const pause = () => new Promise((done) => setTimeout(done, 300));
            while (!root.dataset.complete && !errors.length) await pause();
            try {{ {script} }} catch (error) {{ errors.push(String(error)); }}
            seen.errors = errors;
            for (const when of ['ready', 'complete']) seen[when] = Number(root.dataset[when]);
            const note = document.createElement('pre'); note.id = 'probe'; note.hidden = true;
            note.textContent = JSON.stringify(seen); document.body.append(note);
            parent.postMessage(note.outerHTML, '*');</script></body>"
        );
        let text = fs::read_to_string(page).unwrap();
        let (head, tail) = text.split_at(text.rfind("</body>").unwrap());
        let head = head.replacen("<head>", &format!("<head>{KEEP_ERRORS}"), 1);
        let copy = folder.path().join("page.html");
        fs::write(&copy, head + &probe + &tail["</body>".len()..]).unwrap();
        // No window of Chromium is narrower than 500: a frame is.
        let frame = folder.path().join("frame.html");
        let around = format!(
            "<body style=\"margin: 0\"><iframe src=\"page.html\" style=\"border: 0; width: {width}px; height: 1300px\"></iframe>
            <script>addEventListener('message', ({{ data }}) => document.body.insertAdjacentHTML('beforeend', data));</script></body>"
        );
        fs::write(&frame, around).unwrap();
        let opened = if width < 500 { frame } else { copy };
        let picture = folder.path().join("picture.png");
        let output = Command::new(&self.0)
            .args(["--headless", "--no-sandbox", "--disable-dev-shm-usage", "--hide-scrollbars"])
            .args(["--use-angle=swiftshader", "--enable-unsafe-swiftshader"])
            .arg(format!("--window-size={width},1300"))
            .args(["--virtual-time-budget=120000", "--dump-dom"])
            .arg(format!("--user-data-dir={}", folder.path().join("profile").display()))
            .arg(format!("--screenshot={}", picture.display()))
            .arg(format!("file://{}", opened.display()))
            .stdin(Stdio::null())
            .output()
            .unwrap();
        let page = String::from_utf8_lossy(&output.stdout);
        let noted = page.rsplit_once("<pre id=\"probe\" hidden=\"\">").and_then(|(_, rest)| rest.split_once("</pre>"));
        let noted = noted.unwrap_or_else(|| panic!("no probe: {}", String::from_utf8_lossy(&output.stderr))).0;
        let noted = noted.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
        if let Some(keep) = std::env::var_os("QCBALL_KEEP_SCREENSHOTS") {
            let name = format!("{}.png", std::thread::current().name().unwrap_or("page"));
            fs::copy(&picture, Path::new(&keep).join(name)).unwrap();
        }
        Seen { probe: serde_json::from_str(&noted).unwrap(), pixels: pixels(&picture) }
    }
}

fn pixels(picture: &Path) -> (Vec<[u8; 3]>, usize) {
    let file = std::io::BufReader::new(fs::File::open(picture).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    let samples = info.color_type.samples();
    (bytes.chunks_exact(samples).map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect(), info.width as usize)
}

/// Distinct colours, other than greys and near greys, within a rectangle.
fn colours(seen: &Seen, rectangle: &Value) -> usize {
    let [left, top, right, bottom] =
        ["left", "top", "right", "bottom"].map(|side| rectangle[side].as_f64().unwrap() as usize);
    let (pixels, width) = &seen.pixels;
    let inside = pixels.chunks_exact(*width).take(bottom).skip(top).flat_map(|row| &row[left..right.min(*width)]);
    let vivid = inside.filter(|pixel| pixel.iter().max().unwrap() - pixel.iter().min().unwrap() > 40);
    vivid.collect::<HashSet<_>>().len()
}

#[test]
fn the_viewer_draws_cuts_and_changes_colours_in_a_browser() {
    let Some(browser) = Browser::find() else { return };
    let folder = tempfile::tempdir().unwrap();
    let page = run(folder.path(), 2, 4, 50).join("report.html");
    let seen = browser.open(
        &page,
        "
        const viewer = document.getElementById('viewer');
        const set = async (id, change) => {
          const control = document.getElementById(id);
          change(control);
          control.dispatchEvent(new Event('input'));
          await pause();
          return Plotly.toImage(viewer, { format: 'png', width: 600, height: 300 });
        };
        const eye = (scene) => viewer.layout[scene].camera.eye;
        seen.middle = Number(viewer.dataset.triangles);
        const middle = await set('level', () => {});
        const low = await set('level', (level) => { level.value = 20; });
        seen.low = Number(viewer.dataset.triangles);
        seen.highest = Math.max(...viewer.data[0].i.map((corner) => viewer.data[0].z[corner]));
        seen.at = document.getElementById('at').textContent;
        const whole = await set('axis', (axis) => { axis.value = ''; });
        seen.whole = Number(viewer.dataset.triangles);
        await set('axis', (axis) => { axis.value = '1 0 0'; });
        seen.cutsDiffer = new Set([middle, low, whole]).size;
        const pictures = new Set();
        for (const name of ['k', 'vertex', 'inner', 'outer', 'start', 'active', 'place']) {
          pictures.add(await set('colour', (colour) => { colour.value = name; }));
        }
        seen.colourings = pictures.size;
        // A cut across any direction: none of what is seen lies beyond it. The marks stay.
        await set('axis', (axis) => { axis.value = 'own'; });
        await set('direction', (direction) => { direction.value = '1, 2 -1'; });
        seen.across = document.getElementById('at').textContent;
        const [first] = viewer.data;
        seen.beyond = Math.max(...first.x.map((x, at) => x + 2 * first.y[at] - first.z[at]));
        seen.least = Math.min(...first.x.map((x, at) => x + 2 * first.y[at] - first.z[at]));
        seen.marks = [viewer.data[1].x.length / 6, viewer.data[4].x.length / 6];
        await set('colour', (colour) => { colour.value = 'place'; });
        // Lines of the ball: those within the image have a radius of a tenth, or lie in a plane or cone of 15 degrees.
        const plain = await set('lines', () => {});
        const lined = await set('lines', (lines) => { lines.checked = true; });
        seen.lines = plain !== lined;
        const drawn = viewer.data[5];
        const multiple = (value, of) => Math.abs(value / of - Math.round(value / of)) * of;
        seen.off = Math.max(...drawn.x.map((x, at) => {
          if (x === null) return 0;
          const [y, z] = [drawn.y[at], drawn.z[at]];
          const radius = Math.hypot(x, y, z);
          const degrees = (angle) => (180 * angle) / Math.PI;
          return Math.min(multiple(radius, 0.1), multiple(degrees(Math.atan2(y, x)), 15) / 60, multiple(degrees(Math.asin(z / radius)), 15) / 60);
        }));
        await set('lines', (lines) => { lines.checked = false; });
        // The image of the start: inside, other places than the final ones.
        const final = viewer.data[3].x;
        await set('side', (side) => { side.value = '2'; });
        seen.moved = viewer.data[3].x.filter((x, at) => Math.abs(x - final[at]) > 1e-3).length;
        seen.titles = viewer.layout.annotations.map((one) => one.text);
        await set('side', (side) => { side.value = '1'; });
        await set('axis', (axis) => { axis.value = '1 0 0'; });
        // The opaque pixels of the viewer that are no greys.
        const vivid = async () => {
          const image = new Image();
          const url = await Plotly.toImage(viewer, { format: 'png', width: 600, height: 300 });
          // Not by decode(): the browser's virtual time runs on while another thread decodes.
          await new Promise((done) => { image.onload = done; image.src = url; });
          const context = Object.assign(document.createElement('canvas'), { width: 600, height: 300 }).getContext('2d');
          context.drawImage(image, 0, 0);
          const bytes = context.getImageData(0, 0, 600, 300).data;
          const all = [];
          for (let at = 0; at < bytes.length; at += 4) all.push([...bytes.slice(at, at + 4)]);
          return all.filter(([r, g, b, a]) => a === 255 && Math.max(r, g, b) - Math.min(r, g, b) > 15);
        };
        // Place: a light that is the same everywhere leaves the colours as they are, but for rounding and the marks.
        const own = new Set(viewer.data.flatMap((trace) => trace.facecolor ?? []));
        const near = ([r, g, b]) => [-1, 0, 1].some((x) => [-1, 0, 1].some((y) => [-1, 0, 1].some((z) => own.has(`rgb(${r + x},${g + y},${b + z})`))));
        const placed = await vivid();
        seen.place = [placed.filter(near).length, placed.length];
        seen.placesLegend = !document.getElementById('places').hidden;
        // Active: shaded, so the directions of the two colours of the legend.
        await set('axis', (axis) => { axis.value = ''; });
        await set('colour', (colour) => { colour.value = 'active'; });
        const legend = viewer.data[0].colorscale.map(([, colour]) => [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16)));
        const direction = (colour) => colour.slice(0, 3).map((part) => part / Math.hypot(...colour.slice(0, 3)));
        const along = (one, other) => Math.hypot(...direction(one).map((part, index) => part - direction(other)[index])) < 0.06;
        const shaded = await vivid();
        seen.active = [0, 3].map((index) => shaded.filter((pixel) => along(pixel, legend[index])).length).concat(shaded.length);
        seen.activeLegend = viewer.data.find((trace) => trace.showscale).colorbar.ticktext;
        // K: shaded too, so the directions of the colours of the bar, with what lies between them.
        await set('colour', (colour) => { colour.value = 'k'; });
        const ramp = viewer.data[0].colorscale.map(([, colour]) => [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16)));
        const byK = await vivid();
        seen.k = [byK.filter((pixel) => ramp.some((colour) => along(pixel, colour))).length, byK.length];
        seen.bar = viewer.data.filter((trace) => trace.showscale).length;
        // What stands under the mouse. A browser without a screen draws when it is asked to.
        const { glplot } = viewer._fullLayout.scene._scene;
        const domain = glplot.canvas.getBoundingClientRect();
        const said = document.getElementById('hover');
        const atFirst = said.textContent;
        for (let step = 0; step < 40 && said.textContent === atFirst; step++) {
          glplot.canvas.dispatchEvent(new MouseEvent('mousemove', { clientX: domain.x + domain.width / 2 + step % 9, clientY: domain.y + domain.height / 2, bubbles: true }));
          glplot.redraw();
          await pause();
        }
        seen.hover = said.textContent;
        await set('top', (top) => { top.value = 2; });
        seen.top = Math.exp(viewer.data[0].cmax);
        await set('top', (top) => { top.value = ''; });
        await set('axis', (axis) => { axis.value = '1 0 0'; });
        seen.words = viewer.data[0].text[0];
        const before = eye('scene').x;
        document.querySelector('[data-turn=\"15 0\"]').click();
        await pause();
        seen.turned = eye('scene').x !== before && eye('scene').x === eye('scene2').x;
        viewer.dispatchEvent(new KeyboardEvent('keydown', { key: '+' }));
        await pause();
        seen.linked = eye('scene').z === eye('scene2').z;
        // The wheel over the image moves both; the cameras that are drawn, not those that were asked for.
        const distance = (scene) => Math.hypot(...Object.values(viewer._fullLayout[scene]._scene.getCamera().eye));
        const near0 = distance('scene');
        const canvas = viewer._fullLayout.scene2._scene.glplot.canvas;
        const place = canvas.getBoundingClientRect();
        for (let turn = 0; turn < 3; turn++) {
          canvas.dispatchEvent(new WheelEvent('wheel', { deltaY: 100, clientX: place.x + place.width / 2, clientY: place.y + place.height / 2, bubbles: true, cancelable: true }));
          await pause();
        }
        await pause();
        seen.wheel = [near0, distance('scene'), distance('scene2')];
        document.getElementById('reset').click();
        await pause();
        const look = () => [root.dataset.theme, getComputedStyle(document.body).backgroundColor, document.querySelector('#trace .lines path')?.style.stroke];
        seen.theme = [look()];
        document.getElementById('theme').click();
        await pause();
        seen.theme.push(look());
        document.getElementById('theme').click();
        const named = [...document.querySelectorAll('button, select, input')];
        seen.unnamed = named.filter((one) => !one.textContent.trim() && !one.labels?.length && !one.ariaLabel && !one.dataset.title).map((one) => one.id);
        seen.charts = [...document.querySelectorAll('.chart')].map((one) => one.querySelectorAll('.trace').length);
        seen.box = viewer.getBoundingClientRect().toJSON();
        await set('axis', (axis) => { axis.value = ''; });
        await set('colour', (colour) => { colour.value = 'k'; });
        seen.barBox = viewer.querySelector('.colorbar .cbfills').getBoundingClientRect().toJSON();
        seen.bars = viewer.querySelectorAll('.colorbar').length;
        ",
    );
    let probe = &seen.probe;
    println!("ready after {} ms, complete after {} ms", probe["ready"], probe["complete"]);
    assert_eq!(probe["errors"], serde_json::json!([]), "{probe}");
    // The cube's surface: 6 faces of 8 * 2^2 triangles.
    assert_eq!(probe["whole"], 6 * 32, "{probe}");
    // With a cut face in place of what is cut off: other triangles at each level.
    let shown = ["whole", "middle", "low"].map(|name| probe[name].as_u64().unwrap());
    assert!(shown[1] > 0 && shown[2] > 0 && HashSet::from(shown).len() == 3, "{probe}");
    // A fifth of the way across [-1, 1]; coordinates are stored in 65,535 steps of the extent 2.
    assert_eq!(probe["at"], "z = -0.600");
    assert!((probe["highest"].as_f64().unwrap() + 0.6).abs() < 2.0 / 65_535.0, "{probe}");
    assert_eq!(probe["cutsDiffer"], 3, "{probe}");
    assert_eq!(probe["colourings"], 7, "{probe}");
    // The direction that was put in, a fifth of the way from -4 to 4.
    assert_eq!(probe["across"], "x + 2 y - z = -2.40", "{probe}");
    let number = |name: &str| probe[name].as_f64().unwrap();
    assert!((number("beyond") + 2.4).abs() < 1e-9 && number("least") < -3.9, "{probe}");
    // All eight corners of the cube, beside what is cut off too, in both.
    assert_eq!(probe["marks"], serde_json::json!([8, 8]), "{probe}");
    // The triangles are not small: a radius between two points of one is not that of the point in between, by some (0.5)^2 / 8.
    assert!(probe["lines"] == true && number("off") < 0.04, "{probe}");
    assert!(
        number("moved") > 10.0 && probe["titles"] == serde_json::json!(["domain", "image of the start"]),
        "{probe}"
    );
    // Pixels at the edges of triangles are mixtures: fewer than half of those seen. Colours times a scale are hardly ever another's.
    let count = |name: &str, index: usize| probe[name][index].as_u64().unwrap();
    assert!(count("place", 1) > 10_000 && 2 * count("place", 0) > count("place", 1), "{}", probe["place"]);
    let [rest, active, all] = [0, 1, 2].map(|index| count("active", index));
    // A tenth for the mark of the bottleneck, which has a colour of its own, and for mixtures.
    assert!(active > 50 && rest > 5_000 && 10 * (rest + active) > 9 * all, "{}", probe["active"]);
    assert!(count("k", 1) > 10_000 && 10 * count("k", 0) > 9 * count("k", 1) && probe["bar"] == 1, "{}", probe["k"]);
    assert!(probe["hover"].as_str().unwrap().contains("K_O"), "{}", probe["hover"]);
    assert_eq!(probe["activeLegend"], serde_json::json!(["other tets", "active tets"]));
    assert!(probe["placesLegend"] == true && (probe["top"].as_f64().unwrap() - 2.0).abs() < 1e-9, "{probe}");
    assert!(probe["words"].as_str().unwrap().contains("K_I"), "{probe}");
    assert!(probe["turned"] == true && probe["linked"] == true, "{probe}");
    let [before, domain, image] = [0, 1, 2].map(|index| probe["wheel"][index].as_f64().unwrap());
    assert!((domain - before).abs() > 0.1 * before && (domain - image).abs() < 1e-3 * image, "{probe}");
    for what in 0..3 {
        assert!(probe["theme"][0][what] != probe["theme"][1][what], "{}", probe["theme"]);
    }
    assert_eq!(probe["unnamed"], serde_json::json!([]), "every control has a name");
    assert!(probe["charts"].as_array().unwrap().iter().all(|traces| traces.as_u64().unwrap() > 0), "{probe}");
    // The bar in its colours, and one of it, after all that was chosen and both themes.
    assert!(colours(&seen, &probe["barBox"]) > 50 && probe["bars"] == 1, "{}", colours(&seen, &probe["barBox"]));
    assert!(colours(&seen, &probe["box"]) > 50, "the viewer shows {} colours", colours(&seen, &probe["box"]));
}

#[test]
fn two_runs_stand_side_by_side_in_one_range_of_colours() {
    let folder = tempfile::tempdir().unwrap();
    let [one, other] = ["one", "other"].map(|name| {
        fs::create_dir(folder.path().join(name)).unwrap();
        run(&folder.path().join(name), 1, if name == "one" { 3 } else { 4 }, 20)
    });
    let page = folder.path().join("both.html");
    let both = [&one, &other, &page].map(|path| path.to_str().unwrap());
    let (code, said) = qcball(&["report", both[0], both[1], "--out", both[2]]);
    assert_eq!((code, said.trim_end()), (Some(0), both[2]));
    let text = fs::read_to_string(&page).unwrap();
    let record =
        |folder: &Path| -> Value { serde_json::from_slice(&fs::read(folder.join("report.json")).unwrap()).unwrap() };
    for k in [&one, &other].map(|folder| record(folder)["final"]["max_k"].as_f64().unwrap()) {
        assert!(text.contains(&format!("<td class=\"number\">{k:.4}</td>")), "{k}");
    }
    // What was set otherwise, and nothing else.
    let settings = text.split("id=\"settings\"").nth(1).unwrap().split("</table>").next().unwrap();
    assert_eq!(settings.matches("<tr><td>").count(), 1, "{settings}");
    assert!(settings.contains("<td>mesh.layers</td><td>3</td><td>4</td>"), "{settings}");
    // A folder that holds no run is named.
    let (code, said) = qcball(&["report", both[0], folder.path().to_str().unwrap()]);
    assert!(code == Some(2) && said.contains("has no report.json"), "{said}");
    let Some(browser) = Browser::find() else { return };
    let seen = browser.open(
        &page,
        "
        const viewer = document.getElementById('viewer');
        seen.titles = viewer.layout.annotations.map((one) => one.text);
        seen.tops = [0, 3, 6, 9].map((at) => viewer.data[at].cmax);
        viewer.dispatchEvent(new KeyboardEvent('keydown', { key: '+' }));
        await pause();
        seen.eyes = ['scene', 'scene2', 'scene3', 'scene4'].map((id) => viewer._fullLayout[id]._scene.getCamera().eye.x);
        seen.charts = [...document.querySelectorAll('.chart')].map((one) => one.querySelectorAll('.trace').length);
        seen.box = viewer.getBoundingClientRect().toJSON();
        ",
    );
    let probe = &seen.probe;
    assert_eq!(probe["errors"], serde_json::json!([]), "{probe}");
    assert_eq!(probe["titles"], serde_json::json!(["A: domain", "A: image", "B: domain", "B: image"]));
    for name in ["tops", "eyes"] {
        let all: Vec<f64> = serde_json::from_value(probe[name].clone()).unwrap();
        assert!(all.iter().all(|one| (one - all[0]).abs() < 1e-9), "{probe}");
    }
    assert!(probe["charts"].as_array().unwrap().iter().all(|traces| traces.as_u64().unwrap() > 1), "{probe}");
    assert!(colours(&seen, &probe["box"]) > 50);
}

#[test]
fn a_narrow_window_has_the_image_below_the_domain_and_no_page_wider_than_it() {
    let Some(browser) = Browser::find() else { return };
    let folder = tempfile::tempdir().unwrap();
    let look = "
        seen.narrow = matchMedia('(max-width: 640px)').matches;
        seen.width = [document.documentElement.scrollWidth, innerWidth];
        seen.rooms = document.getElementById('viewer')?.layout.annotations.map((one) => one.y);
    ";
    for page in [run(folder.path(), 1, 3, 5), sweep(folder.path())].map(|folder| folder.join("report.html")) {
        let seen = browser.open_at(400, &page, look).probe;
        assert_eq!(seen["errors"], serde_json::json!([]));
        assert!(seen["narrow"] == true && seen["width"] == serde_json::json!([400, 400]), "{seen}");
        assert!(seen["rooms"].is_null() || seen["rooms"] == serde_json::json!([1, 0.5]), "{seen}");
    }
}

#[test]
fn the_table_of_a_sweep_sorts_and_filters_in_a_browser() {
    let Some(browser) = Browser::find() else { return };
    let folder = tempfile::tempdir().unwrap();
    let made = sweep(folder.path());
    assert_eq!(qcball(&["report", "--cases", made.to_str().unwrap()]).0, Some(0));
    let page = made.join("report.html");
    let seen = browser.open(
        &page,
        "
        const table = document.getElementById('cases');
        const heads = [...table.tHead.rows[0].cells];
        const column = (name) => heads.findIndex((head) => head.textContent === name);
        const read = (name) => [...table.tBodies[0].rows].filter((row) => !row.hidden).map((row) => row.cells[column(name)].textContent);
        seen.rows = read('case');
        const button = heads[column('max_k')].querySelector('button');
        button.click();
        seen.rising = read('max_k').map(Number);
        seen.sort = heads[column('max_k')].getAttribute('aria-sort');
        button.click();
        seen.falling = read('max_k').map(Number);
        heads[column('domain.solid')].querySelector('button').click();
        seen.names = read('domain.solid');
        const filter = document.getElementById('filter');
        const show = (text) => { filter.value = text; filter.dispatchEvent(new Event('input')); };
        show('cube map.exponent>1');
        seen.filtered = read('domain.solid').concat(read('map.exponent'));
        seen.shown = document.getElementById('shown').textContent;
        // The charts follow.
        const points = () => document.querySelectorAll('#explorer .point').length;
        const heat = () => [...document.querySelectorAll('#heat-table td')].map((cell) => cell.textContent);
        seen.points = [points()];
        seen.heat = [heat()];
        show('');
        seen.points.push(points());
        seen.heat.push(heat());
        seen.along = [...document.querySelectorAll('#along .chart')].map((box) => box.querySelectorAll('.point').length);
        const choose = (id, value) => {
          const control = document.getElementById(id);
          control.value = value;
          control.dispatchEvent(new Event('input'));
        };
        seen.colouredBy = document.getElementById('colour-by').value;
        seen.groups = document.querySelector('#explorer .chart').data.filter((trace) => trace.mode === 'markers').map((trace) => [trace.name, trace.marker.color]);
        seen.links = document.querySelector('#explorer .chart').data.flatMap((trace) => trace.customdata ?? []);
        choose('facet', 'domain.solid');
        seen.facets = [...document.querySelectorAll('#explorer figcaption')].map((one) => one.textContent);
        choose('facet', '');
        choose('x', 'map.exponent');
        choose('y', 'max_k');
        seen.axes = ['xaxis', 'yaxis'].map((axis) => document.querySelector('#explorer .chart').layout[axis].title.text);
        choose('colour-by', 'mean_k');
        choose('colour-by', 'domain.solid');
        choose('x', 'max_k');
        choose('y', 'mean_k');
        // No line of a front rises.
        seen.rises = document.querySelector('#explorer .chart').data.filter((trace) => trace.mode === 'lines').map((trace) => trace.y.some((y, at) => at > 0 && y >= trace.y[at - 1]));
        seen.hrefs = [...document.querySelectorAll('#cases a')].map((one) => one.getAttribute('href'));
        await pause();
        scrollTo(0, 0);
        await pause();
        seen.box = document.querySelector('#explorer .chart').getBoundingClientRect().toJSON();
        ",
    );
    let probe = &seen.probe;
    assert_eq!(probe["errors"], serde_json::json!([]), "{probe}");
    assert_eq!(probe["rows"], serde_json::json!(["1", "2", "3", "4", "5", "6"]));
    let numbers = |name: &str| -> Vec<f64> { serde_json::from_value(probe[name].clone()).unwrap() };
    let (rising, falling) = (numbers("rising"), numbers("falling"));
    assert!(rising.len() == 6 && rising.is_sorted(), "{probe}");
    assert!(falling.iter().rev().eq(&rising), "{probe}");
    assert_eq!(probe["sort"], "ascending");
    let names: Vec<String> = serde_json::from_value(probe["names"].clone()).unwrap();
    assert!(names.is_sorted(), "{probe}");
    assert_eq!(probe["filtered"], serde_json::json!(["cube", "2"]));
    assert_eq!(probe["shown"], "1 of 6 cases");
    // One case, and then six: in the chart, in the heat map of three solids and two exponents, and along both keys.
    assert_eq!(probe["points"], serde_json::json!([1, 6]), "{probe}");
    let filled = |at: usize| probe["heat"][at].as_array().unwrap().iter().filter(|cell| **cell != "").count();
    assert_eq!((filled(0), filled(1), probe["heat"][1].as_array().unwrap().len()), (1, 6, 6), "{probe}");
    let along: Vec<u64> = serde_json::from_value(probe["along"].clone()).unwrap();
    assert!(along.len() >= 2 && along[..2] == [6, 6], "{probe}");
    assert_eq!(probe["colouredBy"], "domain.solid");
    let groups: Vec<(String, String)> = serde_json::from_value(probe["groups"].clone()).unwrap();
    assert_eq!(groups.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["cube", "octahedron", "icosahedron"]);
    assert_eq!(groups.iter().map(|(_, colour)| colour).collect::<HashSet<_>>().len(), 3, "{probe}");
    assert_eq!(probe["facets"].as_array().unwrap().len(), 3, "{probe}");
    assert_eq!(probe["axes"], serde_json::json!(["map.exponent", "max_k"]));
    // A front for each solid.
    assert_eq!(probe["rises"], serde_json::json!([false, false, false]), "{probe}");
    // Links and points open the pages of the cases, which were made.
    for links in ["links", "hrefs"] {
        let links: Vec<String> = serde_json::from_value(probe[links].clone()).unwrap();
        let opens = |link: &String| link.ends_with("/report.html") && made.join(link).is_file();
        assert!(links.len() == 6 && links.iter().all(opens), "{links:?}");
    }
    assert!(colours(&seen, &probe["box"]) > 1, "points and the front have colours of their own");
}

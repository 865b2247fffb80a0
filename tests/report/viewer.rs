//! The viewer of a run's page, by its pixels.

use std::collections::HashSet;
use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::browser::{Browser, colours};
use crate::{qcball, run};

/// Helpers of the scripts below. `pixels` has what the viewer draws, without the legend beside it.
const HELP: &str = "
    const box = document.getElementById('viewer');
    const { scenes, room, pick, picture, shown, camera } = box.viewer;
    const canvas = box.querySelector('canvas');
    const set = (id, value) => {
      const control = document.getElementById(id);
      if (control.type === 'checkbox') control.checked = value;
      else control.value = value;
      control.dispatchEvent(new Event('input'));
    };
    const pixels = async () => {
      const image = new Image();
      // Not by decode(): the browser's virtual time runs on while another thread decodes.
      await new Promise((done) => { image.onload = done; image.src = picture(); });
      const { width, height } = image;
      const context = Object.assign(document.createElement('canvas'), { width, height }).getContext('2d');
      context.drawImage(image, 0, 0);
      return { width, height, bytes: context.getImageData(0, 0, width, height).data };
    };
    const at = ({ width, bytes }, x, y) => [...bytes.slice(4 * (width * y + x), 4 * (width * y + x) + 4)];
    const frame = () => canvas.getBoundingClientRect();
    const seenAt = (x, y) => pick({ clientX: frame().left + x + 0.5, clientY: frame().top + y + 0.5 });
    // Each 7th pixel each way that is opaque and within a triangle: its colour, and what is seen there.
    const samples = (image) => {
      const out = [];
      for (let y = 3; y < image.height; y += 7) {
        for (let x = 3; x < image.width; x += 7) {
          const colour = at(image, x, y);
          const found = colour[3] === 255 && seenAt(x, y);
          if (found) out.push({ x, y, colour, found });
        }
      }
      return out;
    };
    const rgb = (text) => [...text.matchAll(/rgb\\(([^)]*)\\)/g)].map((match) => match[1].split(',').map(Number));
    const mark = [25, 211, 218];
    const unit = (colour) => colour.slice(0, 3).map((part) => part / Math.hypot(...colour.slice(0, 3)));
    const angle = (one, other) => Math.hypot(...unit(one).map((part, index) => part - unit(other)[index]));
    const isMark = (colour) => angle(colour, mark) < 0.06;
";

#[test]
fn each_colouring_has_the_colours_of_its_legend() {
    let Some(browser) = Browser::find() else { return };
    let folder = tempfile::tempdir().unwrap();
    let page = run(folder.path(), 2, 4, 50).join("report.html");
    let script = HELP.to_owned()
        + "
        const pictures = new Set();
        seen.part = {};
        set('axis', '1 0 0');
        for (const name of ['k', 'vertex', 'inner', 'outer', 'start']) {
          set('colour', name);
          const image = await pixels();
          pictures.add(picture());
          const legend = rgb(getComputedStyle(document.querySelector('#legend .bar')).backgroundImage);
          const title = document.querySelector('#legend b').textContent;
          // Light changes the length of a colour, not its direction; between two colours of the bar lie mixtures of them.
          const bar = legend.slice(1).flatMap((high, index) => [0, 1, 2, 3].map((step) => high.map((part, axis) => legend[index][axis] + (step / 4) * (part - legend[index][axis])))).concat([legend.at(-1)]);
          const all = samples(image).filter(({ colour }) => !isMark(colour));
          const most = Math.log(box.viewer.most);
          const k = ({ found: { index, triangle } }) => shown()[index].map.values[name]?.[shown()[index].surface.cells[triangle]];
          const place = ({ colour }) => bar.map((one) => angle(colour, one)).reduce((best, one, index, list) => (one < list[best] ? index : best), 0) / (bar.length - 1);
          seen.part[name] = [
            all.filter(({ colour }) => bar.some((one) => angle(colour, one) < 0.03)).length,
            // At the height in the bar that the value of the tet has, give or take a step.
            name === 'vertex' ? all.length : all.filter((one) => Math.abs(place(one) - Math.min(1, Math.log(k(one)) / most)) < 0.05).length,
            all.length, title,
          ];
        }
        // A light that is the same everywhere leaves the colours of places as they are.
        set('colour', 'place');
        pictures.add(picture());
        const placed = samples(await pixels()).filter(({ colour }) => !isMark(colour));
        const expected = ([x, y, z]) => {
          const r = Math.hypot(x, y, z);
          return [Math.min(r, 1), (Math.atan2(y, x) / (2 * Math.PI) + 1) % 1, Math.acos(z / r) / Math.PI].map((part) => 255 * part);
        };
        const far = ({ colour, found: { image } }) => Math.max(...expected(image).map((part, axis) => Math.abs(part - colour[axis])));
        seen.place = [placed.filter((one) => far(one) < 2.5).length, placed.length];
        seen.placeLegend = [...document.querySelectorAll('#legend .bar')].map((bar) => rgb(getComputedStyle(bar).backgroundImage).at(-1));
        seen.placeNames = [...document.querySelectorAll('#legend b')].map((one) => one.textContent);
        set('axis', '');
        set('colour', 'active');
        pictures.add(picture());
        const swatches = [...document.querySelectorAll('#legend .swatch i')].map((one) => rgb(getComputedStyle(one).backgroundColor)[0]);
        const all = samples(await pixels()).filter(({ colour }) => !isMark(colour));
        const active = ({ found: { index, triangle } }) => shown()[index].map.active[shown()[index].surface.cells[triangle]];
        seen.active = [all.filter((one) => active(one)).length, all.filter((one) => angle(one.colour, swatches[active(one) ? 0 : 1]) < 0.03).length, all.length];
        seen.activeNames = [...document.querySelectorAll('#legend .swatch')].map((one) => one.textContent);
        seen.pictures = pictures.size;
        // The range that is asked for, and the bar itself, on the screen.
        set('colour', 'k');
        const labels = () => [...document.querySelectorAll('#legend .bar span')].map((one) => one.textContent);
        set('top', 2);
        seen.labels = labels();
        set('top', '');
        seen.bar = document.querySelector('#legend .bar').getBoundingClientRect().toJSON();
        seen.box = box.getBoundingClientRect().toJSON();
        ";
    let seen = browser.open(&page, &script);
    let probe = &seen.probe;
    println!("ready after {} ms, complete after {} ms", probe["ready"], probe["complete"]);
    assert!(probe["errors"] == json!([]) && probe["contexts"] == 1, "{probe}");
    let count = |value: &Value| value.as_u64().unwrap();
    // Nine in ten: what is at the edges of triangles and marks is mixed.
    for name in ["k", "vertex", "inner", "outer", "start"] {
        let [within, right, all] = [0, 1, 2].map(|at| count(&probe["part"][name][at]));
        assert!(all > 2_000 && 10 * within > 9 * all && 10 * right > 9 * all, "{name} {}", probe["part"]);
    }
    assert_eq!(probe["part"]["outer"][3], "K_O");
    let [right, all] = [0, 1].map(|at| count(&probe["place"][at]));
    assert!(all > 2_000 && 10 * right > 9 * all, "{}", probe["place"]);
    assert_eq!(probe["placeLegend"], json!([[255, 0, 0], [0, 255, 0], [0, 0, 255]]));
    assert_eq!(probe["placeNames"], json!(["radius", "phi", "theta"]));
    let [active, right, all] = [0, 1, 2].map(|at| count(&probe["active"][at]));
    assert!(active > 20 && all - active > 500 && 10 * right > 9 * all, "{}", probe["active"]);
    assert_eq!(probe["activeNames"], json!(["active tets", "other tets"]));
    assert_eq!(probe["pictures"], 7);
    assert_eq!(probe["labels"], json!(["1", "1.5", "2"]));
    assert!(colours(&seen, &probe["bar"]) > 50 && colours(&seen, &probe["box"]) > 50);
}

#[test]
fn the_viewer_cuts_turns_and_tells_what_is_under_the_mouse() {
    let Some(browser) = Browser::find() else { return };
    let folder = tempfile::tempdir().unwrap();
    let page = run(folder.path(), 2, 4, 50).join("report.html");
    let script = HELP.to_owned()
        + "
        const triangles = () => Number(box.dataset.triangles);
        const corners = (column) => { const all = shown()[0].corners[column]; return Array.from({ length: all.length / 3 }, (_, at) => [...all.slice(3 * at, 3 * at + 3)]); };
        seen.middle = triangles();
        const cuts = new Set([picture()]);
        set('level', 20);
        seen.low = triangles();
        seen.highest = Math.max(...corners(0).map(([, , z]) => z));
        seen.at = document.getElementById('at').textContent;
        cuts.add(picture());
        set('axis', '');
        seen.whole = triangles();
        cuts.add(picture());
        seen.cuts = cuts.size;
        // A cut across any direction: none of what is seen lies beyond it. The marks stay.
        set('axis', 'own');
        set('direction', '1, 2 -1');
        seen.across = document.getElementById('at').textContent;
        const heights = corners(0).map(([x, y, z]) => x + 2 * y - z);
        seen.heights = [Math.min(...heights), Math.max(...heights)];
        const marked = await pixels();
        const marks = [0, 0];
        const rooms = scenes.map(room);
        for (let y = 0; y < marked.height; y++) for (let x = 0; x < marked.width; x++) if (at(marked, x, y)[3] === 255 && isMark(at(marked, x, y))) marks[x < rooms[1].left ? 0 : 1]++;
        seen.marks = [marks, shown()[0].map.marks.length];
        // The lines of the ball: what they change is where the image has a radius of a multiple of 0.1, or a longitude or latitude of
        // one of 15 degrees, up to their width.
        const plain = await pixels();
        set('lines', true);
        const lined = await pixels();
        const multiple = (value, of) => Math.abs(value / of - Math.round(value / of)) * of;
        const changed = samples(lined).filter(({ x, y }) => at(plain, x, y).some((part, axis) => Math.abs(part - at(lined, x, y)[axis]) > 60));
        const off = ({ x: across, y: down, found: { image: [x, y, z] } }) => {
          const [radius, axis] = [Math.hypot(x, y, z), Math.hypot(x, y)];
          const step = Math.PI / 12;
          const away = Math.min(multiple(radius, 0.1), multiple(Math.atan2(y, x), step) * axis, multiple(Math.atan2(z, axis), step) * radius);
          // In pixels.
          const next = [seenAt(across + 1, down), seenAt(across, down + 1)].filter(Boolean);
          return away / Math.max(...next.map(({ image }) => Math.hypot(image[0] - x, image[1] - y, image[2] - z)));
        };
        seen.lines = [changed.filter((one) => off(one) < 1.5).length, changed.length];
        set('lines', false);
        const without = picture();
        set('edges', true);
        seen.edges = picture() !== without;
        set('edges', false);
        // The image of the start: inside, other places than the final ones.
        const final = corners(1);
        set('side', '2');
        seen.moved = corners(1).filter(([x], at) => Math.abs(x - final[at][0]) > 1e-3).length;
        seen.titles = [...box.querySelectorAll('.title')].map((one) => one.textContent);
        set('side', '1');
        // Under the mouse.
        set('axis', '1 0 0');
        const domain = room(scenes[0]);
        const inside = { clientX: frame().left + domain.left + domain.width / 2, clientY: frame().top + domain.top + domain.height / 2, bubbles: true };
        canvas.dispatchEvent(new PointerEvent('pointermove', inside));
        seen.hover = document.getElementById('hover').textContent;
        seen.tip = document.getElementById('tip').hidden ? '' : document.getElementById('tip').innerText;
        const { triangle, index } = pick(inside);
        seen.hoverK = shown()[index].map.values.k[shown()[index].surface.cells[triangle]].toFixed(4);
        canvas.dispatchEvent(new PointerEvent('pointermove', { clientX: frame().left + 2, clientY: frame().top + 2, bubbles: true }));
        seen.nothing = document.getElementById('tip').hidden;
        // Buttons, keys, the wheel and dragging change what both show.
        const half = (image, column) => { const { left, width } = rooms[column]; const out = []; for (let y = 0; y < image.height; y += 5) for (let x = Math.ceil(left); x < left + width - 1; x += 5) out.push(at(image, x, y).join()); return out.join(); };
        const seenBoth = async () => { const image = await pixels(); return [half(image, 0), half(image, 1)]; };
        const views = [await seenBoth()];
        document.querySelector('[data-turn=\"15 0\"]').click();
        views.push(await seenBoth());
        box.dispatchEvent(new KeyboardEvent('keydown', { key: '+' }));
        views.push(await seenBoth());
        const before = camera().zoom;
        canvas.dispatchEvent(new WheelEvent('wheel', { deltaY: 100, bubbles: true, cancelable: true }));
        seen.wheel = camera().zoom / before;
        views.push(await seenBoth());
        canvas.dispatchEvent(new PointerEvent('pointerdown', { ...inside, buttons: 1 }));
        window.dispatchEvent(new PointerEvent('pointermove', { ...inside, clientX: inside.clientX + 40, buttons: 1 }));
        window.dispatchEvent(new PointerEvent('pointerup', inside));
        views.push(await seenBoth());
        seen.views = [0, 1].map((column) => new Set(views.map((both) => both[column])).size);
        document.getElementById('reset').click();
        seen.reset = (await seenBoth()).every((half, column) => half === views[0][column]);
        const look = () => [root.dataset.theme, getComputedStyle(document.body).backgroundColor, getComputedStyle(box).backgroundColor, document.querySelector('#trace .lines path')?.style.stroke];
        seen.theme = [look()];
        document.getElementById('theme').click();
        await pause();
        seen.theme.push(look());
        document.getElementById('theme').click();
        const named = [...document.querySelectorAll('button, select, input')];
        seen.unnamed = named.filter((one) => !one.textContent.trim() && !one.labels?.length && !one.ariaLabel && !one.dataset.title).map((one) => one.id);
        seen.charts = [...document.querySelectorAll('.chart')].map((one) => one.querySelectorAll('.trace').length);
        ";
    let seen = browser.open(&page, &script);
    let probe = &seen.probe;
    assert!(probe["errors"] == json!([]) && probe["contexts"] == 1, "{probe}");
    // The cube's surface: 6 faces of 8 * 2^2 triangles.
    assert_eq!(probe["whole"], 6 * 32, "{probe}");
    // With a cut face in place of what is cut off: other triangles at each level.
    let shown = ["whole", "middle", "low"].map(|name| probe[name].as_u64().unwrap());
    assert!(shown[1] > 0 && shown[2] > 0 && HashSet::from(shown).len() == 3 && probe["cuts"] == 3, "{probe}");
    // A fifth of the way across [-1, 1]; coordinates are stored in 65,535 steps of the extent 2.
    assert_eq!(probe["at"], "z = -0.600");
    assert!((probe["highest"].as_f64().unwrap() + 0.6).abs() < 2.0 / 65_535.0, "{probe}");
    // The direction that was put in, a fifth of the way from -4 to 4, in single precision.
    assert_eq!(probe["across"], "x + 2 y - z = -2.40", "{probe}");
    let [least, most] = [0, 1].map(|at| probe["heights"][at].as_f64().unwrap());
    assert!((most + 2.4).abs() < 1e-5 && least < -3.9, "{probe}");
    // All eight corners of the cube, beside what is cut off too, in both.
    assert!(probe["marks"][1] == 8, "{probe}");
    assert!((0..2).all(|side| probe["marks"][0][side].as_u64().unwrap() > 200), "{}", probe["marks"]);
    let [right, all] = [0, 1].map(|at| probe["lines"][at].as_u64().unwrap());
    assert!(all > 100 && 10 * right > 9 * all && probe["edges"] == true, "{}", probe["lines"]);
    assert!(probe["moved"].as_u64().unwrap() > 10, "{probe}");
    assert_eq!(probe["titles"], json!(["domain", "image of the start"]));
    let k = probe["hoverK"].as_str().unwrap();
    for said in ["hover", "tip"].map(|name| probe[name].as_str().unwrap()) {
        assert!(said.contains(&format!("K {k}, K_I")) && said.contains("K_O") && said.contains("image ("), "{said}");
    }
    assert_eq!(probe["nothing"], true);
    assert_eq!(probe["views"], json!([5, 5]), "each of the four changes what both show");
    assert!(probe["wheel"].as_f64().unwrap() > 1.05 && probe["reset"] == true, "{}", probe["wheel"]);
    for what in 0..4 {
        assert!(probe["theme"][0][what] != probe["theme"][1][what], "{}", probe["theme"]);
    }
    assert_eq!(probe["unnamed"], json!([]), "every control has a name");
    assert!(probe["charts"].as_array().unwrap().iter().all(|traces| traces.as_u64().unwrap() > 0), "{probe}");
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
        seen.titles = [...viewer.querySelectorAll('.title')].map((one) => one.textContent);
        // The largest K of both, which all four show in one bar.
        seen.most = [viewer.viewer.most, Math.max(...viewer.viewer.shown().flatMap(({ map }) => [...map.values.k]))];
        seen.bars = viewer.querySelectorAll('.bar').length;
        const rooms = viewer.viewer.scenes.map(viewer.viewer.room);
        seen.rooms = rooms.map(({ left, top }) => [left > 0, top > 100]);
        seen.charts = [...document.querySelectorAll('.chart')].map((one) => one.querySelectorAll('.trace').length);
        seen.box = viewer.getBoundingClientRect().toJSON();
        ",
    );
    let probe = &seen.probe;
    assert_eq!(probe["errors"], json!([]), "{probe}");
    assert_eq!(probe["titles"], json!(["A: domain", "A: image", "B: domain", "B: image"]));
    assert!(probe["most"][0] == probe["most"][1] && probe["bars"] == 1 && probe["contexts"] == 1, "{probe}");
    assert_eq!(probe["rooms"], json!([[false, false], [true, false], [false, true], [true, true]]));
    assert!(probe["charts"].as_array().unwrap().iter().all(|traces| traces.as_u64().unwrap() > 1), "{probe}");
    assert!(colours(&seen, &probe["box"]) > 50);
}

// Domain and image of one map or of several, side by side: one camera, a cutting plane, colours, values under the mouse.
const embedded = document.getElementById("viewer-data");

async function startViewer() {
  const packed = JSON.parse(embedded.textContent);
  const maps = await Promise.all(packed.maps.map(unpackMap));
  const byId = (id) => document.getElementById(id);
  const box = byId("viewer");
  const canvas = box.querySelector("canvas");
  const drawing = drawingOn(canvas, () => update());
  if (!drawing) {
    box.textContent = "This browser draws no WebGL 2: open domain.vtu and image.vtu in ParaView, or this page in another browser.";
    return;
  }
  const hasStart = maps.every((map) => map.sides.length > 2);
  const whole = maps.every((map) => map.whole);
  const remove = (...ones) => ones.forEach((one) => one.remove());
  if (!hasStart) remove(byId("colour").querySelector("[value=start]"), byId("side").closest("label"));
  // What is there of larger meshes is cut through its middle only, and not every tet around a vertex is there.
  if (!whole) remove(byId("axis").querySelector("[value=own]"), byId("colour").querySelector("[value=vertex]"));
  // One range for all, so that colours compare; K of the start, often far larger, ends with the final one's: the last colour goes on.
  const finite = (most, one) => (Number.isFinite(one) && one > most ? one : most);
  const most = maps.reduce((most, { values: { k } }) => k.reduce(finite, most), 1);
  const home = { yaw: -0.88, pitch: 0.57, zoom: 1, pan: [0, 0] };
  let camera = home;
  // What is drawn of each map: its surface, and the places of its corners in domain and image.
  let shown = [];

  const scenes = maps.flatMap((map, index) => ["domain", "image"].map((side, column) => {
    const title = document.createElement("div");
    title.className = "title";
    box.append(title);
    return { index, column, title, words: [map.name, side].filter(Boolean).join(": ") };
  }));
  if (maps.length > 1) box.classList.add("many");

  const imageSide = () => (hasStart ? Number(byId("side").value) : 1);
  const sideOf = (column) => (column === 0 ? 0 : imageSide());

  function surfaceOf(map) {
    const direction = planeDirection();
    if (!direction) return { surface: openSurface(map), words: "" };
    const { heights, least, most } = heightsAcross(map, direction);
    const level = least + ((most - least) * (whole ? Number(byId("level").value) : 50)) / 100;
    const sign = byId("flip").checked ? 1 : -1;
    // Coordinates are rounded to steps: what is nearer than one lies in the plane.
    const step = (most - least) / 65535;
    const over = heights.map((height) => (Math.abs(height - level) <= step ? 0 : sign * (height - level)));
    const terms = direction.map((factor, axis) => [factor, "xyz"[axis]]).filter(([factor]) => factor !== 0);
    const term = ([factor, name]) => `${factor < 0 ? "- " : "+ "}${Math.abs(factor) === 1 ? "" : `${Math.abs(factor)} `}${name}`;
    const words = terms.map(term).join(" ").replace(/^\+ /, "");
    return { surface: openSurface(map, over), words: `${words} = ${level.toPrecision(3)}` };
  }

  // The direction across the cut, or null.
  function planeDirection() {
    const axis = byId("axis").value;
    if (axis === "") return null;
    const parts = (axis === "own" ? byId("direction").value : axis).trim().split(/[\s,]+/).map(Number);
    const good = parts.length === 3 && parts.every(Number.isFinite) && parts.some((part) => part !== 0);
    byId("direction").setCustomValidity(good ? "" : "three numbers, not all 0");
    return good ? parts : [0, 0, 1];
  }

  // Columns as x, y, z one after the other.
  function woven([x, y, z]) {
    const out = new Float32Array(3 * x.length);
    for (let at = 0; at < x.length; at++) {
      out[3 * at] = x[at];
      out[3 * at + 1] = y[at];
      out[3 * at + 2] = z[at];
    }
    return out;
  }

  function open(map, index) {
    const { surface, words } = surfaceOf(map);
    const corners = [0, 1].map((column) => woven(map.sides[sideOf(column)].map((values) => along(surface, values))));
    corners.forEach((place, column) => {
      drawing.upload(`${index} ${column}`, { place, image: corners[1] });
      drawing.upload(`marks ${index} ${column}`, { place: octahedra(map, sideOf(column)) });
    });
    return { map, surface, corners, words };
  }

  // An octahedron around each place of the bottleneck.
  function octahedra({ marks, balls }, side) {
    const size = 0.03 * balls[side].radius;
    const out = [];
    for (const mark of marks) {
      const tip = (axis, sign) => mark[side].map((part, other) => part + (other === axis ? sign * size : 0));
      for (const x of [-1, 1]) for (const y of [-1, 1]) for (const z of [-1, 1]) out.push(tip(0, x), tip(1, y), tip(2, z));
    }
    return new Float32Array(out.flat());
  }

  const colourOf = { active: "#d55e00", rest: "#8fa3b5", mark: "#19d3da", flipped: "#400066" };
  const parts = (colour) => [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16) / 255);
  const choice = () => byId("colour").value;
  const top = () => Math.log(Math.max(Number(byId("top").value) || most, 1.001));

  // A value from 0 to 1 for each corner; 2 where the tet is flipped.
  function colourSurfaces() {
    const last = top();
    const share = (k) => (Number.isFinite(k) ? Math.min(Math.log(k), last) / last : 2);
    shown.forEach(({ map, surface }, index) => {
      let value = [];
      if (choice() === "vertex") value = along(surface, Array.from(byVertex(map), share));
      else if (choice() === "active") value = surface.cells.flatMap((cell) => Array(3).fill(map.active[cell]));
      else if (choice() !== "place") value = surface.cells.flatMap((cell) => Array(3).fill(share(map.values[choice()][cell])));
      else value = Array(3 * surface.cells.length).fill(0);
      for (const column of [0, 1]) drawing.upload(`${index} ${column}`, { value: new Float32Array(value) });
    });
    const ramp = choice() === "active" ? Array(17).fill(colourOf.rest).fill(colourOf.active, 9) : packed.colours;
    return { ramp: ramp.flatMap(parts), flipped: parts(colourOf.flipped), kind: choice() === "place" ? 1 : 0 };
  }
  let colouring = {};

  function element(kind, className, words = "", style = {}) {
    const made = Object.assign(document.createElement(kind), { className, textContent: words });
    Object.assign(made.style, style);
    return made;
  }

  // Values beside a bar from K = 1 to the last colour's.
  function ticks(most) {
    const steps = most < 2 ? 0.1 : most < 4 ? 0.5 : most < 12 ? 1 : 0;
    const values = [];
    if (steps) for (let value = 1; value <= most + 1e-9; value += steps) values.push(Number(value.toFixed(2)));
    else for (let power = 1; power <= most; power *= 10) values.push(...(most < 2000 ? [1, 2, 5] : [1]).map((x) => x * power).filter((x) => x <= most));
    return values;
  }

  function legend() {
    const swatch = (colour, words) => {
      const whole = element("div", "swatch", words);
      whole.prepend(element("i", "", "", { background: colour }));
      return whole;
    };
    const gradient = (...colours) => `linear-gradient(to top, ${colours.join(", ")})`;
    const bar = (background, marks) => {
      const whole = element("div", "bar", "", { background });
      whole.append(...marks.map(([at, words]) => element("span", "", words, { bottom: `${100 * at}%` })));
      return whole;
    };
    const name = element("b", "", byId("colour").selectedOptions[0].textContent);
    const out = [];
    if (choice() === "active") out.push(swatch(colourOf.active, "active tets"), swatch(colourOf.rest, "other tets"));
    else if (choice() === "place") {
      const channels = [["radius", "#f00", [[0, "0"], [1, "1"]]], ["phi", "#0f0", [[0, "0°"], [1, "360°"]]], ["theta", "#00f", [[0, "0°"], [1, "180°"]]]];
      for (const [words, colour, marks] of channels) out.push(element("b", "", words), bar(gradient("#000", colour), marks));
    } else {
      const last = top();
      out.push(name, bar(gradient(...packed.colours), ticks(Math.exp(last)).map((k) => [Math.log(k) / last, Number(k.toPrecision(6)).toLocaleString("en", { useGrouping: false })])));
      if (maps.some(({ values }) => values.k.some((k) => !Number.isFinite(k)))) out.push(swatch(colourOf.flipped, "flipped"));
    }
    byId("legend").className = choice();
    byId("legend").replaceChildren(...out);
  }

  // Domain and image side by side, a row a map; on a narrow window all below each other. The legend has the right margin.
  function room({ index, column }) {
    const [width, height] = [box.clientWidth - byId("legend").offsetWidth, box.clientHeight];
    const [rows, row, columns] = narrow.matches ? [scenes.length, 2 * index + column, 1] : [maps.length, index, 2];
    const words = scenes[0].title.offsetHeight;
    return { left: columns === 1 ? 0 : (column * width) / 2, top: (row * height) / rows + words, width: width / columns, height: height / rows - words };
  }

  function draw() {
    const views = scenes.map((scene) => {
      const rectangle = room(scene);
      const { map } = shown[scene.index];
      const { middle, radius } = map.balls[sideOf(scene.column)];
      const words = scene.column && imageSide() === 2 ? scene.words.replace(/image$/, "image of the start") : scene.words;
      if (scene.title.textContent !== words) scene.title.textContent = words;
      Object.assign(scene.title.style, { left: `${rectangle.left}px`, top: `${rectangle.top - scene.title.offsetHeight}px`, width: `${rectangle.width}px` });
      const name = `${scene.index} ${scene.column}`;
      return { rectangle, middle, radius, surface: name, marks: `marks ${name}`, mark: parts(colourOf.mark) };
    });
    drawing.draw(views, camera, { ...colouring, edges: byId("edges").checked, lines: byId("lines").checked });
  }
  // Once a frame at most, while something moves.
  let asked = false;
  function drawSoon() {
    if (!asked) requestAnimationFrame(() => { asked = false; draw(); });
    asked = true;
  }

  function recolour() {
    byId("top").disabled = ["active", "place"].includes(choice());
    colouring = colourSurfaces();
    legend();
    draw();
  }

  function update() {
    const axis = byId("axis").value;
    byId("level").disabled = !whole || axis === "";
    byId("flip").disabled = axis === "";
    byId("directions").hidden = axis !== "own";
    shown = maps.map(open);
    byId("at").textContent = [...new Set(shown.map((view) => view.words))].join("; ");
    recolour();
    box.dataset.triangles = shown.reduce((sum, view) => sum + view.surface.cells.length, 0);
  }

  // What is seen at a point of the window: a triangle of a scene and the place there in domain and image.
  function pick({ clientX, clientY }) {
    const frame = canvas.getBoundingClientRect();
    const [x, y] = [clientX - frame.left, clientY - frame.top];
    for (const scene of scenes) {
      const rectangle = room(scene);
      const at = [(2 * (x - rectangle.left)) / rectangle.width - 1, 1 - (2 * (y - rectangle.top)) / rectangle.height];
      if (at.some((part) => Math.abs(part) > 1)) continue;
      const { map, corners } = shown[scene.index];
      const { middle, radius } = map.balls[sideOf(scene.column)];
      const { from, along: way } = rayOf(camera, rectangle, at);
      const met = firstMet(corners[scene.column], { from: from.map((part, axis) => radius * part + middle[axis]), along: way.map((part) => radius * part) });
      if (!met) return null;
      const place = (column) => [0, 1, 2].map((axis) => met.weights.reduce((sum, weight, corner) => sum + weight * corners[column][9 * met.triangle + 3 * corner + axis], 0));
      return { ...scene, triangle: met.triangle, domain: place(0), image: place(1) };
    }
    return null;
  }

  function words({ index, triangle, domain, image }) {
    const { map, surface } = shown[index];
    const { k, inner, outer, start } = map.values;
    const cell = surface.cells[triangle];
    const numbers = (values) => values.map((value) => value.toFixed(3)).join(", ");
    return [
      `${map.name ? `${map.name}, ` : ""}tet ${map.numbers[cell] ?? cell}${map.active[cell] ? ", active" : ""}`,
      `K ${k[cell].toFixed(4)}, K_I ${inner[cell].toFixed(4)}, K_O ${outer[cell].toFixed(4)}${hasStart ? `, at the start ${start[cell].toFixed(4)}` : ""}`,
      `domain (${numbers(domain)}), image (${numbers(image)})`,
    ];
  }

  function say(event) {
    const found = pick(event);
    const tip = byId("tip");
    tip.hidden = !found;
    box.style.cursor = found ? "crosshair" : "grab";
    if (!found) return;
    const lines = words(found);
    byId("hover").textContent = lines.join("; ");
    tip.innerText = lines.join("\n");
    const frame = box.getBoundingClientRect();
    const [x, y] = [event.clientX - frame.left, event.clientY - frame.top];
    tip.style.left = `${Math.max(0, Math.min(x + 14, frame.width - tip.offsetWidth - 4))}px`;
    tip.style.top = `${y + 18 + tip.offsetHeight > frame.height ? y - tip.offsetHeight - 8 : y + 18}px`;
  }

  const clamp = (value, least, most) => Math.min(most, Math.max(least, value));
  const radians = (degrees) => (degrees * Math.PI) / 180;
  function turn(sideways, upward) {
    camera = { ...camera, yaw: camera.yaw + radians(sideways), pitch: clamp(camera.pitch + radians(upward), -Math.PI / 2, Math.PI / 2) };
    drawSoon();
  }
  function zoom(factor) {
    camera = { ...camera, zoom: clamp(factor * camera.zoom, 0.02, 20) };
    drawSoon();
  }
  // By pixels of the page.
  function move(x, y) {
    const { width, height } = room(scenes[0]);
    const pixel = (2 * distance * camera.zoom) / (height * lensOf({ width, height })[1]);
    camera = { ...camera, pan: [camera.pan[0] + pixel * x, camera.pan[1] - pixel * y] };
    drawSoon();
  }

  // Fingers and buttons that are down, by their numbers: where they were.
  const down = new Map();
  const held = (event) => [event.clientX, event.clientY];
  canvas.addEventListener("pointerdown", (event) => {
    down.set(event.pointerId, held(event));
    byId("tip").hidden = true;
  });
  canvas.addEventListener("pointermove", (event) => { if (!down.has(event.pointerId)) say(event); });
  canvas.addEventListener("pointerleave", () => { byId("tip").hidden = true; });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  // A drag goes on outside.
  for (const kind of ["pointerup", "pointercancel"]) window.addEventListener(kind, (event) => down.delete(event.pointerId));
  window.addEventListener("pointermove", (event) => {
    if (!down.has(event.pointerId)) return;
    const [before, now] = [down.get(event.pointerId), held(event)];
    const by = now.map((part, axis) => part - before[axis]);
    const other = [...down].find(([number]) => number !== event.pointerId)?.[1];
    down.set(event.pointerId, now);
    if (other) {
      const apart = (point) => Math.hypot(point[0] - other[0], point[1] - other[1]) || 1;
      zoom(apart(before) / apart(now));
      move(by[0] / 2, by[1] / 2);
    } else if (event.shiftKey || event.buttons & 2) move(...by);
    else turn(-0.4 * by[0], 0.4 * by[1]);
  });
  box.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(0.001 * clamp(event.deltaY * (event.deltaMode === 1 ? 33 : 1), -500, 500)));
  }, { passive: false });

  const picture = () => { draw(); return canvas.toDataURL("image/png"); };
  update();
  new ResizeObserver(draw).observe(box);
  for (const id of ["side", "axis", "direction", "level", "flip"]) byId(id).addEventListener("input", update);
  for (const id of ["colour", "top"]) byId(id).addEventListener("input", recolour);
  for (const id of ["edges", "lines"]) byId(id).addEventListener("input", draw);
  for (const button of document.querySelectorAll("[data-turn]")) {
    button.addEventListener("click", () => turn(...button.dataset.turn.split(" ").map(Number)));
  }
  for (const button of document.querySelectorAll("[data-zoom]")) {
    button.addEventListener("click", () => zoom(Number(button.dataset.zoom)));
  }
  byId("reset").addEventListener("click", () => { camera = home; drawSoon(); });
  byId("save").addEventListener("click", () => Object.assign(document.createElement("a"), { href: picture(), download: "qcball.png" }).click());
  const keys = {
    ArrowLeft: () => turn(-15, 0), ArrowRight: () => turn(15, 0), ArrowUp: () => turn(0, 15), ArrowDown: () => turn(0, -15),
    "+": () => zoom(0.8), "-": () => zoom(1.25),
  };
  box.addEventListener("keydown", (event) => {
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  });
  // For the console and the tests.
  box.viewer = { scenes, room, pick, picture, shown: () => shown, camera: () => camera, most };
}

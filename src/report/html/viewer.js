// Domain and image side by side: linked cameras, a cutting plane, colours, values under the mouse.
const embedded = document.getElementById("viewer-data");

async function unpack(text, Type) {
  const letters = atob(text);
  const bytes = new Uint8Array(letters.length);
  for (let at = 0; at < bytes.length; at++) bytes[at] = letters.charCodeAt(at);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Type(await new Response(stream).arrayBuffer());
}

async function unpackSurface(packed, frames) {
  const [steps, triangles, cells] = await Promise.all([
    unpack(packed.points, Uint16Array), unpack(packed.triangles, Uint32Array), unpack(packed.cells, Uint32Array),
  ]);
  const count = steps.length / 6;
  const sides = [0, 1].map((side) => [0, 1, 2].map((axis) => {
    const { least, extent } = frames[side];
    return Float64Array.from({ length: count }, (_, point) => least[axis] + (extent[axis] * steps[6 * point + 3 * side + axis]) / 65535);
  }));
  return { sides, triangles, cells };
}

// The part of a surface on one side of a plane across an axis of the domain; triangles across the plane are cut.
function clip({ sides, triangles, cells }, axis, level, sign) {
  const out = { sides: sides.map((side) => side.map((column) => Array.from(column))), triangles: [], cells: [] };
  const height = (point) => sign * (sides[0][axis][point] - level);
  const crossings = new Map();
  const crossing = (a, b) => {
    const key = a < b ? `${a} ${b}` : `${b} ${a}`;
    if (!crossings.has(key)) {
      const t = height(a) / (height(a) - height(b));
      crossings.set(key, out.sides[0][0].length);
      for (const side of out.sides) for (const column of side) column.push(column[a] + t * (column[b] - column[a]));
    }
    return crossings.get(key);
  };
  for (let triangle = 0; triangle < cells.length; triangle++) {
    const corners = [0, 1, 2].map((corner) => triangles[3 * triangle + corner]);
    const polygon = [];
    corners.forEach((a, corner) => {
      const b = corners[(corner + 1) % 3];
      if (height(a) >= 0) polygon.push(a);
      if (height(a) >= 0 !== height(b) >= 0) polygon.push(crossing(a, b));
    });
    for (let last = 2; last < polygon.length; last++) {
      out.triangles.push(polygon[0], polygon[last - 1], polygon[last]);
      out.cells.push(cells[triangle]);
    }
  }
  return out;
}

function join(one, other) {
  const shift = one.sides[0][0].length;
  return {
    sides: one.sides.map((side, index) => side.map((column, axis) => [...column, ...other.sides[index][axis]])),
    triangles: [...one.triangles, ...Array.from(other.triangles, (corner) => corner + shift)],
    cells: [...one.cells, ...other.cells],
  };
}

async function startViewer() {
  const { surfaces, marker, most, hasStart = true } = JSON.parse(embedded.textContent);
  const byId = (id) => document.getElementById(id);
  if (!hasStart) byId("colour").querySelector("[value=start]").remove();
  const box = byId("viewer");
  const [tet, inner, outer, start, active] = await Promise.all([
    unpack(surfaces.cells.tet, Uint32Array), unpack(surfaces.cells.inner, Float32Array),
    unpack(surfaces.cells.outer, Float32Array), unpack(surfaces.cells.start, Float32Array),
    unpack(surfaces.cells.active, Uint8Array),
  ]);
  const k = inner.map((value, cell) => Math.max(value, outer[cell]));
  const boundary = await unpackSurface(surfaces.boundary, surfaces.frames);
  const unpacked = new Map();
  const home = { eye: { x: 1.2, y: -1.45, z: 1.2 }, up: { x: 0, y: 0, z: 1 }, center: { x: 0, y: 0, z: 0 } };
  let camera = home;
  let shown = boundary;

  async function cutSurface(axis, index) {
    const key = `${axis} ${index}`;
    if (!unpacked.has(key)) unpacked.set(key, await unpackSurface(surfaces.cuts[axis][index], surfaces.frames));
    return unpacked.get(key);
  }

  function centre(surface, side, triangle) {
    const corners = [0, 1, 2].map((corner) => surface.triangles[3 * triangle + corner]);
    return surface.sides[side].map((column) => corners.reduce((sum, corner) => sum + column[corner], 0) / 3);
  }

  // The radius, the angle around the z axis and the angle from it, each from 0 to 1.
  function placeColour([x, y, z]) {
    const radius = Math.hypot(x, y, z);
    const phi = (Math.atan2(y, x) / (2 * Math.PI) + 1) % 1;
    const theta = radius > 0 ? Math.acos(Math.max(-1, Math.min(1, z / radius))) / Math.PI : 0.5;
    return `rgb(${[Math.min(radius, 1), phi, theta].map((part) => Math.round(255 * part)).join(",")})`;
  }

  const colourOf = { active: "#d55e00", rest: "#8fa3b5" };
  const ticks = (most) => {
    const steps = most < 2 ? 0.1 : most < 4 ? 0.5 : most < 12 ? 1 : 0;
    const values = [];
    if (steps) for (let value = 1; value <= most + 1e-9; value += steps) values.push(Number(value.toFixed(2)));
    else for (let power = 1; power <= most; power *= 10) values.push(...[1, 2, 5].map((x) => x * power).filter((x) => x <= most));
    return values;
  };

  function colouring(surface, scene) {
    const choice = byId("colour").value;
    const cells = Array.from(surface.cells);
    // A mesh keeps the colours of its scale when it gets colours of its own, and plotly.js multiplies the two: other traces for those.
    const uid = `${scene} ${choice === "place" ? "own colours" : "values"}`;
    if (choice === "place") {
      return { uid, facecolor: cells.map((_, triangle) => placeColour(centre(surface, 1, triangle))), lighting: { ambient: 1, diffuse: 0, specular: 0, fresnel: 0 } };
    }
    const bar = { thickness: 14, len: 0.8, tickfont: { color: colours().text } };
    if (choice === "active") {
      return {
        uid, intensity: cells.map((cell) => active[cell]), intensitymode: "cell", cmin: 0, cmax: 1, showscale: scene === "scene2",
        colorscale: [[0, colourOf.rest], [0.5, colourOf.rest], [0.5, colourOf.active], [1, colourOf.active]],
        colorbar: { ...bar, tickvals: [0.25, 0.75], ticktext: ["other tets", "active tets"] },
      };
    }
    const values = { k, inner, outer, start }[choice];
    const top = Math.log(Math.max(Math.min(Number(byId("top").value) || most, most), 1.001));
    const label = byId("colour").selectedOptions[0].textContent;
    return {
      uid, intensity: cells.map((cell) => Math.min(Math.log(values[cell]), top)),
      intensitymode: "cell", cmin: 0, cmax: top, colorscale: "Viridis", showscale: scene === "scene2",
      colorbar: {
        ...bar, title: { text: label }, tickvals: ticks(Math.exp(top)).map(Math.log), ticktext: ticks(Math.exp(top)).map(String),
      },
    };
  }

  function words(surface, triangle) {
    const cell = surface.cells[triangle];
    const numbers = (values) => values.map((value) => value.toFixed(3)).join(", ");
    return [
      `tet ${tet[cell]}${active[cell] ? ", active" : ""}`,
      `K ${k[cell].toFixed(4)}, K_I ${inner[cell].toFixed(4)}, K_O ${outer[cell].toFixed(4)}${hasStart ? `, at the start ${start[cell].toFixed(4)}` : ""}`,
      `domain (${numbers(centre(surface, 0, triangle))}), image (${numbers(centre(surface, 1, triangle))})`,
    ];
  }

  // An octahedron around the bottleneck. Not a marker of a scatter3d: its shaders take 0.2 s to compile.
  function bottleneck(scene, side) {
    const trace = { type: "mesh3d", scene, hoverinfo: "skip", flatshading: true, color: "#ff2d55" };
    if (!marker) return { ...trace, visible: false };
    const size = 0.025 * Math.max(...surfaces.frames[side].extent);
    const corners = [0, 1, 2].flatMap((axis) => [size, -size].map((step) => marker[side].map((value, other) => value + (other === axis ? step : 0))));
    const [x, y, z] = [0, 1, 2].map((axis) => corners.map((corner) => corner[axis]));
    const faces = [0, 1].flatMap((i) => [2, 3].flatMap((j) => [4, 5].map((k) => [i, j, k])));
    const [i, j, k] = [0, 1, 2].map((which) => faces.map((face) => face[which]));
    return { ...trace, x, y, z, i, j, k };
  }

  function traces(surface) {
    const text = Array.from(surface.cells, (_, triangle) => words(surface, triangle).join("<br>"));
    const corner = (which) => Array.from({ length: surface.cells.length }, (_, triangle) => surface.triangles[3 * triangle + which]);
    const [i, j, k] = [0, 1, 2].map(corner);
    return ["scene", "scene2"].flatMap((scene, side) => {
      const [x, y, z] = surface.sides[side].map((column) => Array.from(column));
      const mesh = {
        type: "mesh3d", scene, x, y, z, i, j, k, text, hovertemplate: "%{text}<extra></extra>", flatshading: true,
        lighting: { ambient: 0.75, diffuse: 0.35, specular: 0.02, roughness: 0.9 }, ...colouring(surface, scene),
      };
      const lines = { type: "scatter3d", scene, mode: "lines", x: [], y: [], z: [], hoverinfo: "skip", showlegend: false, line: { width: 1, color: "rgba(0,0,0,0.55)" } };
      if (byId("edges").checked) {
        for (let triangle = 0; triangle < surface.cells.length; triangle++) {
          for (const point of [i, j, k, i].map((list) => list[triangle])) {
            lines.x.push(x[point]); lines.y.push(y[point]); lines.z.push(z[point]);
          }
          lines.x.push(null); lines.y.push(null); lines.z.push(null);
        }
      }
      return [mesh, bottleneck(scene, side), lines];
    });
  }

  function layout() {
    const hidden = { visible: false, showspikes: false };
    const scene = { xaxis: hidden, yaxis: hidden, zaxis: hidden, aspectmode: "data", camera, dragmode: "orbit" };
    // On a narrow window the image stands below the domain.
    const places = narrow.matches
      ? [{ x: [0, 0.85], y: [0.5, 1] }, { x: [0, 0.85], y: [0, 0.5] }]
      : [{ x: [0, 0.48], y: [0, 1] }, { x: [0.48, 0.96], y: [0, 1] }];
    const title = (text, { x, y }) => ({
      text, x: (x[0] + x[1]) / 2, y: y[1], xref: "paper", yref: "paper", yanchor: "top", showarrow: false, font: { size: 14, color: colours().dim },
    });
    return {
      scene: { ...scene, domain: places[0] }, scene2: { ...scene, domain: places[1] },
      annotations: [title("domain", places[0]), title("image", places[1])],
      margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "rgba(0,0,0,0)", font: { color: colours().text }, modebar: colours().tools,
      hoverlabel: { align: "left" }, showlegend: false,
    };
  }

  // Plotly's own default draws four times the pixels of the screen.
  const sharp = { ...settings, plotGlPixelRatio: Math.max(1, devicePixelRatio) };
  const draw = () => {
    byId("top").disabled = ["active", "place"].includes(byId("colour").value);
    byId("places").hidden = byId("colour").value !== "place";
    return Plotly.react(box, traces(shown), layout(), sharp);
  };

  async function update() {
    const axis = byId("axis").value;
    byId("level").disabled = byId("flip").disabled = axis === "";
    byId("at").textContent = "";
    if (axis === "") {
      shown = boundary;
    } else {
      const index = Math.min(Number(byId("level").value), surfaces.cuts[axis].length - 1);
      const { level } = surfaces.cuts[axis][index];
      byId("at").textContent = `${"xyz"[axis]} = ${level.toPrecision(3)}`;
      shown = join(clip(boundary, Number(axis), level, byId("flip").checked ? 1 : -1), await cutSurface(axis, index));
    }
    await draw();
    box.dataset.triangles = shown.cells.length;
  }

  function look(to, from) {
    camera = to;
    for (const scene of ["scene", "scene2"]) if (scene !== from) Plotly.relayout(box, { [`${scene}.camera`]: to });
  }

  function turn(sideways, upward) {
    const { x, y, z } = camera.eye;
    const radius = Math.hypot(x, y, z);
    const around = Math.atan2(y, x) + (sideways * Math.PI) / 180;
    const above = Math.max(-1.5, Math.min(1.5, Math.asin(z / radius) + (upward * Math.PI) / 180));
    const flat = radius * Math.cos(above);
    look({ ...camera, up: home.up, eye: { x: flat * Math.cos(around), y: flat * Math.sin(around), z: radius * Math.sin(above) } });
  }

  function zoom(factor) {
    const { x, y, z } = camera.eye;
    look({ ...camera, eye: { x: factor * x, y: factor * y, z: factor * z } });
  }

  const level = byId("level");
  level.max = surfaces.cuts[2].length - 1;
  level.value = (surfaces.cuts[2].length - 1) / 2;
  await update();
  drawn.push(draw);
  narrow.addEventListener("change", draw);
  for (const id of ["axis", "level", "flip", "edges"]) byId(id).addEventListener("input", update);
  for (const id of ["colour", "top"]) byId(id).addEventListener("input", draw);
  for (const name of ["plotly_relayouting", "plotly_relayout"]) {
    box.on(name, (change) => {
      for (const scene of ["scene", "scene2"]) {
        const to = change[`${scene}.camera`];
        if (to && JSON.stringify(to) !== JSON.stringify(camera)) look(to, scene);
      }
    });
  }
  // plotly.js tells of a turn of the wheel before the camera has moved: it is followed until it rests.
  let frames = 0;
  function follow() {
    for (const scene of ["scene", "scene2"]) {
      const to = box._fullLayout[scene]._scene.getCamera();
      const moved = ["x", "y", "z"].some((axis) => Math.abs(to.eye[axis] - camera.eye[axis]) > 1e-6);
      if (moved) {
        frames = 12;
        // Both: the other's new camera would take this one back to where the layout has it.
        look(to);
        break;
      }
    }
    if (--frames > 0) setTimeout(follow, 16);
  }
  box.addEventListener("wheel", () => {
    const resting = frames <= 0;
    frames = 12;
    if (resting) setTimeout(follow, 16);
  }, { passive: true, capture: true });
  box.on("plotly_hover", ({ points: [point] }) => {
    if (point.curveNumber % 3 === 0) byId("hover").textContent = words(shown, point.pointNumber).join("; ");
  });
  for (const button of document.querySelectorAll("[data-turn]")) {
    button.addEventListener("click", () => turn(...button.dataset.turn.split(" ").map(Number)));
  }
  for (const button of document.querySelectorAll("[data-zoom]")) {
    button.addEventListener("click", () => zoom(Number(button.dataset.zoom)));
  }
  byId("reset").addEventListener("click", () => look(home));
  const keys = {
    ArrowLeft: () => turn(-15, 0), ArrowRight: () => turn(15, 0), ArrowUp: () => turn(0, 15), ArrowDown: () => turn(0, -15),
    "+": () => zoom(0.8), "-": () => zoom(1.25),
  };
  box.addEventListener("keydown", (event) => {
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  });
}

if (embedded) await startViewer();
// Times in milliseconds since the page was opened: when the viewer could be used, and when all was drawn.
root.dataset.ready = Math.round(performance.now());
await drawCharts();
root.dataset.complete = Math.round(performance.now());


// Domain and image of one map or of several, side by side: linked cameras, a cutting plane, colours, values under the mouse.
const embedded = document.getElementById("viewer-data");

async function startViewer() {
  const packed = JSON.parse(embedded.textContent);
  const scale = packed.colours.map((colour, at) => [at / (packed.colours.length - 1), colour]);
  const maps = await Promise.all(packed.maps.map(unpackMap));
  const byId = (id) => document.getElementById(id);
  const box = byId("viewer");
  const hasStart = maps.every((map) => map.frames.length > 2);
  const whole = maps.every((map) => map.whole);
  const remove = (...ones) => ones.forEach((one) => one.remove());
  if (!hasStart) remove(byId("colour").querySelector("[value=start]"), byId("side").closest("label"));
  // What is there of larger meshes is cut through its middle only, and not every tet around a vertex is there.
  if (!whole) remove(byId("axis").querySelector("[value=own]"), byId("colour").querySelector("[value=vertex]"));
  // One range for all, so that colours compare; K of the start, often far larger, ends with the final one's: the last colour goes on.
  const most = maps.reduce((most, { values: { k } }) => k.reduce((most, one) => (Number.isFinite(one) && one > most ? one : most), most), 1);
  const home = { eye: { x: 1.2, y: -1.45, z: 1.2 }, up: { x: 0, y: 0, z: 1 }, center: { x: 0, y: 0, z: 0 } };
  let camera = home;
  // What is drawn of each map: its surface, and the places of its points in domain and image.
  let shown = [];

  const scenes = maps.flatMap((map, index) => ["domain", "image"].map((side, column) => {
    const number = 2 * index + column + 1;
    const title = [map.name, side].filter(Boolean).join(": ");
    return { id: number === 1 ? "scene" : `scene${number}`, index, column, title };
  }));
  if (maps.length > 1) box.classList.add("many");

  const imageSide = () => (hasStart ? Number(byId("side").value) : 1);

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

  function open(map) {
    const { surface, words } = surfaceOf(map);
    const sides = [0, imageSide()].map((side) => map.sides[side].map((column) => along(surface, column)));
    return { map, surface, sides, words };
  }

  function centre({ surface, sides }, side, triangle) {
    const corners = [0, 1, 2].map((corner) => surface.triangles[3 * triangle + corner]);
    return sides[side].map((column) => (column[corners[0]] + column[corners[1]] + column[corners[2]]) / 3);
  }

  // The radius, the angle around the z axis and the angle from it, each from 0 to 1.
  function placeColour([x, y, z]) {
    const radius = Math.hypot(x, y, z);
    const phi = (Math.atan2(y, x) / (2 * Math.PI) + 1) % 1;
    const theta = radius > 0 ? Math.acos(Math.max(-1, Math.min(1, z / radius))) / Math.PI : 0.5;
    return `rgb(${[Math.min(radius, 1), phi, theta].map((part) => Math.round(255 * part)).join(",")})`;
  }

  const colourOf = { active: "#d55e00", rest: "#8fa3b5", mark: "#19d3da" };
  const ticks = (most) => {
    const steps = most < 2 ? 0.1 : most < 4 ? 0.5 : most < 12 ? 1 : 0;
    const values = [];
    if (steps) for (let value = 1; value <= most + 1e-9; value += steps) values.push(Number(value.toFixed(2)));
    else for (let power = 1; power <= most; power *= 10) values.push(...[1, 2, 5].map((x) => x * power).filter((x) => x <= most));
    return values;
  };

  function colouring(view, scene) {
    const { map, surface } = view;
    const choice = byId("colour").value;
    // A mesh keeps the colours of its scale when it gets colours of its own, and plotly.js multiplies the two; and it keeps values
    // of triangles when it gets those of points: other traces for those. A blank in the name would leave the bar black.
    const uid = `${scene.id}-${{ place: "own", vertex: "points" }[choice] ?? "cells"}`;
    if (choice === "place") {
      return { uid, facecolor: surface.cells.map((_, triangle) => placeColour(centre(view, 1, triangle))), lighting: { ambient: 1, diffuse: 0, specular: 0, fresnel: 0, facenormalsepsilon: 0 } };
    }
    // The bar belongs to all.
    const showscale = scene.id === "scene2";
    const bar = { thickness: 14, len: 0.8, tickfont: { color: colours().text } };
    if (choice === "active") {
      return {
        uid, showscale, intensity: surface.cells.map((cell) => map.active[cell]), intensitymode: "cell", cmin: 0, cmax: 1,
        colorscale: [[0, colourOf.rest], [0.5, colourOf.rest], [0.5, colourOf.active], [1, colourOf.active]],
        colorbar: { ...bar, tickvals: [0.25, 0.75], ticktext: ["other tets", "active tets"] },
      };
    }
    const values = map.values[choice];
    const top = Math.log(Math.max(Number(byId("top").value) || most, 1.001));
    const logarithms = choice === "vertex" ? along(surface, values.map((value) => Math.min(Math.log(value), top))) : surface.cells.map((cell) => Math.min(Math.log(values[cell]), top));
    const marked = ticks(Math.exp(top));
    return {
      uid, showscale, intensity: logarithms, intensitymode: choice === "vertex" ? "vertex" : "cell", cmin: 0, cmax: top, colorscale: scale,
      colorbar: { ...bar, title: { text: byId("colour").selectedOptions[0].textContent }, tickvals: marked.map(Math.log), ticktext: marked.map(String) },
    };
  }

  function words(view, triangle) {
    const { map, surface } = view;
    const { k, inner, outer, start } = map.values;
    const cell = surface.cells[triangle];
    const numbers = (values) => values.map((value) => value.toFixed(3)).join(", ");
    return [
      `${map.name ? `${map.name}, ` : ""}tet ${map.numbers[cell]}${map.active[cell] ? ", active" : ""}`,
      `K ${k[cell].toFixed(4)}, K_I ${inner[cell].toFixed(4)}, K_O ${outer[cell].toFixed(4)}${hasStart ? `, at the start ${start[cell].toFixed(4)}` : ""}`,
      `domain (${numbers(centre(view, 0, triangle))}), image (${numbers(centre(view, 1, triangle))})`,
    ];
  }

  // An octahedron around each place of the bottleneck. Not markers of a scatter3d: their shaders take 0.2 s to compile.
  function bottleneck({ map }, scene) {
    const side = scene.column && imageSide();
    const size = 0.025 * Math.max(...map.frames[side].extent);
    const [x, y, z, i, j, k] = [[], [], [], [], [], []];
    for (const mark of map.marks) {
      const first = x.length;
      for (const axis of [0, 1, 2]) {
        for (const step of [size, -size]) [x, y, z].forEach((column, other) => column.push(mark[side][other] + (other === axis ? step : 0)));
      }
      for (const a of [0, 1]) for (const b of [2, 3]) for (const c of [4, 5]) [i, j, k].forEach((list, which) => list.push(first + [a, b, c][which]));
    }
    return { type: "mesh3d", scene: scene.id, hoverinfo: "skip", flatshading: true, color: colourOf.mark, x, y, z, i, j, k, visible: x.length > 0 };
  }

  // The normals of the triangles of a surface, of the length that lifts a line off them so that it is seen.
  function lifts({ surface: { triangles } }, [x, y, z], extent) {
    const lift = 0.003 * Math.max(...extent);
    const normals = [];
    for (let at = 0; at < triangles.length; at += 3) {
      const [a, b, c] = triangles.slice(at, at + 3);
      const [u, v] = [b, c].map((corner) => [x[corner] - x[a], y[corner] - y[a], z[corner] - z[a]]);
      const normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
      const length = Math.hypot(...normal) || 1;
      normals.push(normal.map((part) => (lift * part) / length));
    }
    return normals;
  }

  function lines(view, scene) {
    const { surface, segments } = view;
    const columns = view.sides[scene.column];
    const out = [[], [], []];
    const edges = byId("edges").checked;
    if (edges || segments.length > 0) {
      const normals = lifts(view, columns, view.map.frames[scene.column && imageSide()].extent);
      const put = (triangle, place) => out.forEach((column, axis) => column.push(place === null ? null : place(columns[axis]) + normals[triangle][axis]));
      if (edges) {
        for (let triangle = 0; triangle < normals.length; triangle++) {
          for (const corner of [0, 1, 2, 0]) put(triangle, (column) => column[surface.triangles[3 * triangle + corner]]);
          put(triangle, null);
        }
      }
      for (const { triangle, ends } of segments) {
        for (const [a, b, part] of ends) put(triangle, (column) => column[a] + part * (column[b] - column[a]));
        put(triangle, null);
      }
    }
    const [x, y, z] = out;
    return { type: "scatter3d", scene: scene.id, mode: "lines", x, y, z, hoverinfo: "skip", showlegend: false, line: { width: segments.length > 0 ? 2 : 1, color: "rgba(0,0,0,0.75)" } };
  }

  function traces() {
    const texts = shown.map((view) => view.surface.cells.map((_, triangle) => words(view, triangle).join("<br>")));
    return scenes.flatMap((scene) => {
      const view = shown[scene.index];
      const { triangles } = view.surface;
      const corner = (which) => view.surface.cells.map((_, triangle) => triangles[3 * triangle + which]);
      const [x, y, z] = view.sides[scene.column];
      const mesh = {
        type: "mesh3d", scene: scene.id, x, y, z, i: corner(0), j: corner(1), k: corner(2), text: texts[scene.index], hovertemplate: "%{text}<extra></extra>",
        flatshading: true, lighting: { ambient: 0.75, diffuse: 0.35, specular: 0.02, roughness: 0.9, facenormalsepsilon: 0 }, ...colouring(view, scene),
      };
      return [mesh, bottleneck(view, scene), lines(view, scene)];
    });
  }

  // Domain and image side by side, a row a map; on a narrow window all below each other.
  function room({ index, column }) {
    const [rows, row] = narrow.matches ? [scenes.length, 2 * index + column] : [maps.length, index];
    const [left, right] = narrow.matches ? [0, 0.85] : [0.48 * column, 0.48 * (column + 1)];
    return { x: [left, right], y: [1 - (row + 1) / rows, 1 - row / rows] };
  }

  function layout() {
    const hidden = { visible: false, showspikes: false };
    const scene = { xaxis: hidden, yaxis: hidden, zaxis: hidden, aspectmode: "data", camera, dragmode: "orbit" };
    const title = ({ title: text, column, ...place }) => {
      const { x, y } = room({ column, ...place });
      const shownText = column && imageSide() === 2 ? text.replace(/image$/, "image of the start") : text;
      return { text: shownText, x: (x[0] + x[1]) / 2, y: y[1], xref: "paper", yref: "paper", yanchor: "top", showarrow: false, font: { size: 14, color: colours().dim } };
    };
    return {
      ...Object.fromEntries(scenes.map((one) => [one.id, { ...scene, domain: room(one) }])), annotations: scenes.map(title),
      margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "rgba(0,0,0,0)", font: { color: colours().text }, modebar: colours().tools,
      hoverlabel: { align: "left" }, showlegend: false,
    };
  }

  // Plotly's own default draws four times the pixels of the screen.
  const sharp = { ...settings, plotGlPixelRatio: Math.max(1, devicePixelRatio) };
  const draw = () => {
    byId("top").disabled = ["active", "place"].includes(byId("colour").value);
    byId("places").hidden = byId("colour").value !== "place";
    return Plotly.react(box, traces(), layout(), sharp);
  };

  async function update() {
    const axis = byId("axis").value;
    byId("level").disabled = !whole || axis === "";
    byId("flip").disabled = axis === "";
    byId("directions").hidden = axis !== "own";
    shown = maps.map(open);
    for (const view of shown) view.segments = byId("lines").checked ? linesOfBall(view.surface, view.sides[1]) : [];
    byId("at").textContent = [...new Set(shown.map((view) => view.words))].join("; ");
    await draw();
    box.dataset.triangles = shown.reduce((sum, view) => sum + view.surface.cells.length, 0);
  }

  function look(to, from) {
    camera = to;
    for (const { id } of scenes) if (id !== from) Plotly.relayout(box, { [`${id}.camera`]: to });
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

  await update();
  drawn.push(draw);
  narrow.addEventListener("change", draw);
  for (const id of ["side", "axis", "direction", "level", "flip", "edges", "lines"]) byId(id).addEventListener("input", update);
  for (const id of ["colour", "top"]) byId(id).addEventListener("input", draw);
  for (const name of ["plotly_relayouting", "plotly_relayout"]) {
    box.on(name, (change) => {
      for (const { id } of scenes) {
        const to = change[`${id}.camera`];
        if (to && JSON.stringify(to) !== JSON.stringify(camera)) look(to, id);
      }
    });
  }
  // plotly.js tells of a turn of the wheel before the camera has moved: it is followed until it rests.
  let frames = 0;
  function follow() {
    for (const { id } of scenes) {
      const to = box._fullLayout[id]._scene.getCamera();
      const moved = ["x", "y", "z"].some((axis) => Math.abs(to.eye[axis] - camera.eye[axis]) > 1e-6);
      if (moved) {
        frames = 12;
        // All: the others' new cameras would take this one back to where the layout has it.
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
    const scene = scenes[Math.floor(point.curveNumber / 3)];
    if (point.curveNumber % 3 === 0) byId("hover").textContent = words(shown[scene.index], point.pointNumber).join("; ");
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

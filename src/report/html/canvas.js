// Draws surfaces in one WebGL context, each in a rectangle of its own, all seen from the same side.
const vertexShader = `#version 300 es
in vec3 place; in vec3 image; in float value;
uniform mat3 turn; uniform vec3 middle; uniform float scale; uniform vec3 offset; uniform vec4 lens;
out vec3 seen; out vec3 ball; out float shade; out vec3 corner;
void main() {
  seen = turn * ((place - middle) * scale) + offset;
  ball = image; shade = value;
  int number = gl_VertexID % 3;
  corner = vec3(number == 0, number == 1, number == 2);
  gl_Position = vec4(lens.xy * seen.xy, lens.z * seen.z + lens.w, -seen.z);
}`;

// Edges and lines are drawn where a pixel is near one, as its derivatives tell, and fade where they would lie closer than pixels.
const fragmentShader = `#version 300 es
precision highp float;
in vec3 seen; in vec3 ball; in float shade; in vec3 corner;
uniform vec3 ramp[17]; uniform vec3 flipped; uniform int kind; uniform float opacity; uniform bool edges; uniform bool lines;
out vec4 colour;
const float pi = 3.141592653589793;

// How much of a line is here, of those where value is a whole number; step is what value changes by from pixel to pixel.
float line(float value, float step, float width) {
  float pixels = abs(fract(value - 0.5) - 0.5) / max(step, 1e-9);
  return (1.0 - smoothstep(0.5 * width - 0.5, 0.5 * width + 0.5, pixels)) * (1.0 - smoothstep(0.15, 0.4, step));
}

void main() {
  vec3 normal = normalize(cross(dFdx(seen), dFdy(seen)));
  float light = 0.78 + 0.22 * abs(dot(normal, normalize(vec3(0.35, 0.45, 1.0))));
  float radius = length(ball), axis = length(ball.xy);
  if (kind == 1) {
    // The place in the ball is read off the colour, which no light may change.
    float around = fract(atan(ball.y, ball.x) / (2.0 * pi) + 1.0), above = radius > 0.0 ? acos(clamp(ball.z / radius, -1.0, 1.0)) / pi : 0.5;
    colour = vec4(min(radius, 1.0), around, above, 1.0);
  } else if (kind == 2) {
    colour = opacity * vec4(light * ramp[0], 1.0);
  } else {
    float at = 16.0 * clamp(shade, 0.0, 1.0);
    int first = int(min(at, 15.0));
    vec3 base = shade > 1.5 ? flipped : mix(ramp[first], ramp[first + 1], at - float(first));
    colour = vec4(light * base, 1.0);
  }
  if (kind == 2) return;
  float dark = 0.0, white = 0.0;
  if (edges) {
    vec3 step = fwidth(corner);
    vec3 near = 1.0 - smoothstep(0.4, 1.2, corner / step);
    dark = max(near.x, max(near.y, near.z)) * (1.0 - smoothstep(0.15, 0.45, max(step.x, max(step.y, step.z))));
  }
  if (lines) {
    vec2 turned = (ball.x * vec2(dFdx(ball.y), dFdy(ball.y)) - ball.y * vec2(dFdx(ball.x), dFdy(ball.x))) / max(axis * axis, 1e-12);
    float longitude = atan(ball.y, ball.x) * 12.0 / pi, latitude = atan(ball.z, axis) * 12.0 / pi;
    // None at the radius 1, where all of the boundary lies.
    float within = radius < 0.95 ? line(10.0 * radius, 10.0 * fwidth(radius), 1.6) : 0.0;
    white = max(within, max(line(longitude, length(turned) * 12.0 / pi, 1.6), line(latitude, fwidth(latitude), 1.6)));
  }
  colour.rgb = mix(colour.rgb * (1.0 - 0.8 * dark), vec3(1.0), 0.85 * white);
}`;

// The half of the angle of view has this tangent; a ball of radius 1 fills the view from this distance.
const tangent = 0.2;
const distance = 1.04 * Math.hypot(1, tangent) / tangent;

// Axes to the right, upwards and towards the eye.
function axesOf({ yaw, pitch }) {
  const [c, s, p, q] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
  return [[-s, c, 0], [-q * c, -q * s, p], [p * c, p * s, q]];
}

// Factors from places before the eye to the view, from -1 to 1.
function lensOf({ width, height }) {
  const factor = Math.min(1, width / height) / tangent;
  return [(factor * height) / width, factor];
}

// The ray through a point of a view, from -1 to 1 each way, in the coordinates of a ball around the surface: its origin and direction.
function rayOf(camera, rectangle, [x, y]) {
  const axes = axesOf(camera);
  const [fx, fy] = lensOf(rectangle);
  const turn = (v) => [0, 1, 2].map((axis) => axes[0][axis] * v[0] + axes[1][axis] * v[1] + axes[2][axis] * v[2]);
  return { from: turn([-camera.pan[0], -camera.pan[1], distance * camera.zoom]), along: turn([x / fx, y / fy, -1]) };
}

// What draws on a canvas, or null without WebGL 2; calls `again` when a lost context is back and all must be uploaded anew.
function drawingOn(canvas, again) {
  const gl = canvas.getContext("webgl2", { antialias: true });
  if (!gl) return null;
  let program, uniforms, surfaces;
  const names = ["turn", "middle", "scale", "offset", "lens", "ramp", "flipped", "kind", "opacity", "edges", "lines"];
  const attributes = ["place", "image", "value"];

  function begin() {
    program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertexShader], [gl.FRAGMENT_SHADER, fragmentShader]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    attributes.forEach((name, index) => gl.bindAttribLocation(program, index, name));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
      throw new Error(gl.getAttachedShaders(program).map((shader) => gl.getShaderInfoLog(shader)).join() + gl.getProgramInfoLog(program));
    }
    uniforms = Object.fromEntries(names.map((name) => [name, gl.getUniformLocation(program, name)]));
    surfaces = new Map();
  }
  begin();
  canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
  canvas.addEventListener("webglcontextrestored", () => { begin(); again(); });

  // Arrays of a surface by the names of the attributes; those that are not given stay as they are.
  function upload(name, arrays) {
    if (!surfaces.has(name)) surfaces.set(name, { vertices: gl.createVertexArray(), buffers: {}, count: 0 });
    const surface = surfaces.get(name);
    gl.bindVertexArray(surface.vertices);
    attributes.forEach((attribute, index) => {
      if (!arrays[attribute]) return;
      surface.buffers[attribute] ??= gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, surface.buffers[attribute]);
      gl.bufferData(gl.ARRAY_BUFFER, arrays[attribute], gl.STATIC_DRAW);
      gl.enableVertexAttribArray(index);
      gl.vertexAttribPointer(index, attribute === "value" ? 1 : 3, gl.FLOAT, false, 0, 0);
      if (attribute === "place") surface.count = arrays.place.length / 3;
    });
  }

  // Views are rectangles in pixels of the page, from the top left, with the middle and radius of a ball around what is drawn there,
  // the names of surfaces and of marks, and the colour of the marks.
  function draw(views, camera, { ramp, flipped, kind, edges, lines }) {
    const sharp = devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((size) => Math.max(1, Math.round(size * sharp)));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    gl.disable(gl.SCISSOR_TEST);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.SCISSOR_TEST);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(program);
    const away = distance * camera.zoom;
    const [near, far] = [Math.max(0.01, away - 1.2), away + 1.2];
    gl.uniformMatrix3fv(uniforms.turn, true, axesOf(camera).flat());
    gl.uniform3f(uniforms.offset, ...camera.pan, -away);
    gl.uniform3fv(uniforms.flipped, flipped);
    gl.uniform1i(uniforms.edges, edges);
    gl.uniform1i(uniforms.lines, lines);
    for (const { rectangle, middle, radius, surface, marks, mark } of views) {
      const box = [rectangle.left, canvas.clientHeight - rectangle.top - rectangle.height, rectangle.width, rectangle.height];
      const pixels = box.map((size) => Math.round(size * sharp));
      gl.viewport(...pixels);
      gl.scissor(...pixels);
      gl.uniform3fv(uniforms.middle, middle);
      gl.uniform1f(uniforms.scale, 1 / radius);
      gl.uniform4f(uniforms.lens, ...lensOf(rectangle), (far + near) / (near - far), (2 * far * near) / (near - far));
      const put = (name, colours, how) => {
        const { vertices, count } = surfaces.get(name);
        gl.uniform3fv(uniforms.ramp, colours);
        gl.uniform1i(uniforms.kind, how);
        gl.bindVertexArray(vertices);
        gl.drawArrays(gl.TRIANGLES, 0, count);
      };
      put(surface, ramp, kind);
      const colours = Array(17).fill(mark).flat();
      // Marks behind the surface shine through.
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
      gl.depthMask(false);
      gl.depthFunc(gl.GREATER);
      gl.uniform1f(uniforms.opacity, 0.35);
      put(marks, colours, 2);
      gl.disable(gl.BLEND);
      gl.depthMask(true);
      gl.depthFunc(gl.LESS);
      gl.uniform1f(uniforms.opacity, 1);
      put(marks, colours, 2);
    }
  }
  return { upload, draw };
}

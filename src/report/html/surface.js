// A packed map, the surface of it that is seen when a plane cuts it open, and the lines of the ball on that surface.
async function unpack(text, Type) {
  const letters = atob(text);
  const bytes = new Uint8Array(letters.length);
  for (let at = 0; at < bytes.length; at++) bytes[at] = letters.charCodeAt(at);
  if (bytes.length === 0) return new Type(0);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Type(await new Response(stream).arrayBuffer());
}

async function unpackMap(packed) {
  const { frames, name, whole, marks } = packed;
  const integers = ["tets", "numbers", "triangles", "owners"].map((key) => unpack(packed[key], Uint32Array));
  const singles = ["inner", "outer", "start"].map((key) => unpack(packed[key], Float32Array));
  const [tets, numbers, triangles, owners, inner, outer, start] = await Promise.all([...integers, ...singles]);
  const steps = await unpack(packed.points, Uint16Array);
  const active = await unpack(packed.active, Uint8Array);
  const width = 3 * frames.length;
  const count = steps.length / width;
  const sides = frames.map(({ least, extent }, side) => [0, 1, 2].map((axis) => {
    const column = new Float64Array(count);
    for (let at = 0, step = 3 * side + axis; at < count; at++, step += width) column[at] = least[axis] + (extent[axis] * steps[step]) / 65535;
    return column;
  }));
  const k = inner.map((value, cell) => Math.max(value, outer[cell]));
  // Of each vertex the largest K of the tets around it.
  const vertex = new Float32Array(count).fill(1);
  for (let corner = 0; corner < tets.length; corner++) vertex[tets[corner]] = Math.max(vertex[tets[corner]], k[corner >> 2]);
  return { name, frames, whole, marks, sides, count, tets, numbers, triangles, owners, active, values: { k, inner, outer, start, vertex } };
}

// The heights of the vertices of a map over the plane through 0 across a direction, and the least and the largest of them.
function heightsAcross({ sides: [[x, y, z]], count }, [a, b, c]) {
  const heights = new Float64Array(count);
  let [least, most] = [Infinity, -Infinity];
  for (let at = 0; at < count; at++) {
    heights[at] = a * x[at] + b * y[at] + c * z[at];
    if (heights[at] < least) least = heights[at];
    if (heights[at] > most) most = heights[at];
  }
  return { heights, least, most };
}

// The surface that is seen: all of the boundary, or, with heights over a plane, the part of it where they are at least 0 and the
// section there. Its points lie between two vertices of the mesh, at `part` of the way; `cells` are the tets of its triangles.
function openSurface(map, heights) {
  const surface = { from: [], to: [], part: [], triangles: [], cells: [] };
  const known = new Map();
  const point = (a, b) => {
    const [low, high] = a < b ? [a, b] : [b, a];
    const key = low * map.count + high;
    let number = known.get(key);
    if (number === undefined) {
      number = surface.from.length;
      known.set(key, number);
      surface.from.push(low);
      surface.to.push(high);
      surface.part.push(low === high ? 0 : heights[low] / (heights[low] - heights[high]));
    }
    return number;
  };
  const fan = (polygon, cell) => {
    for (let last = 2; last < polygon.length; last++) {
      surface.triangles.push(polygon[0], polygon[last - 1], polygon[last]);
      surface.cells.push(cell);
    }
  };
  const kept = (vertex) => !heights || heights[vertex] >= 0;
  for (let triangle = 0; triangle < map.owners.length; triangle++) {
    const polygon = [];
    for (let corner = 0; corner < 3; corner++) {
      const a = map.triangles[3 * triangle + corner];
      const b = map.triangles[3 * triangle + ((corner + 1) % 3)];
      if (kept(a)) polygon.push(point(a, a));
      if (kept(a) !== kept(b)) polygon.push(point(a, b));
    }
    fan(polygon, map.owners[triangle]);
  }
  if (!heights) return surface;
  for (let cell = 0; cell < map.numbers.length; cell++) {
    const corners = map.tets.subarray(4 * cell, 4 * cell + 4);
    const above = Array.from(corners).filter(kept);
    if (above.length === 0 || above.length === 4) continue;
    // What lies in the plane counts as above it, so that a layer of tets which ends there shows its last faces once; tets that
    // touch the plane in a point or an edge show nothing.
    if (above.length < 3 && above.every((vertex) => heights[vertex] === 0)) continue;
    const below = Array.from(corners).filter((vertex) => !kept(vertex));
    const [a, b, c, d] = [...below, ...above];
    const edges = below.length === 1 ? [[a, b], [a, c], [a, d]] : below.length === 3 ? [[a, d], [b, d], [c, d]] : [[a, c], [a, d], [b, d], [b, c]];
    const polygon = edges.map((ends) => point(...ends));
    // All seen from the side that is cut away, so that the light falls on all alike.
    fan(isMirrored(map, [a, b, c, d]) ? polygon : polygon.reverse(), cell);
  }
  return surface;
}

// Whether a tet with its corners in this order is negatively oriented.
function isMirrored({ sides: [columns] }, [a, b, c, d]) {
  const [u, v, w] = [b, c, d].map((vertex) => columns.map((column) => column[vertex] - column[a]));
  return u[0] * (v[1] * w[2] - v[2] * w[1]) + u[1] * (v[2] * w[0] - v[0] * w[2]) + u[2] * (v[0] * w[1] - v[1] * w[0]) < 0;
}

// A quantity of the vertices at the points of a surface.
function along({ from, to, part }, values) {
  return from.map((low, at) => values[low] + part[at] * (values[to[at]] - values[low]));
}

// Where the lines of the ball lie on a surface: segments in triangles, whose ends are each between two points. `image` holds the points' places.
function linesOfBall({ triangles }, [x, y, z]) {
  const degrees = (angle) => (angle * Math.PI) / 180;
  const radius = x.map((_, at) => Math.hypot(x[at], y[at], z[at]));
  const families = [];
  for (let step = 1; step < 10; step++) families.push(radius.map((r) => r - step / 10));
  for (let angle = 0; angle < 180; angle += 15) {
    const [c, s] = [Math.cos(degrees(angle)), Math.sin(degrees(angle))];
    families.push(x.map((_, at) => c * y[at] - s * x[at]));
  }
  for (let angle = -75; angle < 90; angle += 15) {
    const s = Math.sin(degrees(angle));
    families.push(z.map((height, at) => height - s * radius[at]));
  }
  const segments = [];
  for (const over of families) {
    for (let at = 0; at < triangles.length; at += 3) {
      const ends = [];
      for (let corner = 0; corner < 3; corner++) {
        const [a, b] = [triangles[at + corner], triangles[at + ((corner + 1) % 3)]];
        if (over[a] >= 0 !== over[b] >= 0) ends.push([a, b, over[a] / (over[a] - over[b])]);
      }
      if (ends.length === 2) segments.push({ triangle: at / 3, ends });
    }
  }
  return segments;
}

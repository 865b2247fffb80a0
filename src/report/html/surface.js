// A packed map, and the surface of it that is seen when a plane cuts it open.
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
  const values = { k, inner, outer, start };
  return { name, whole, marks, sides, balls: sides.map(ballAround), count, tets, numbers, triangles, owners, active, values };
}

// Of each vertex the largest K of the tets around it; kept once it was asked for.
function byVertex({ values, count, tets }) {
  if (!values.vertex) {
    values.vertex = new Float32Array(count).fill(1);
    for (let corner = 0; corner < tets.length; corner++) values.vertex[tets[corner]] = Math.max(values.vertex[tets[corner]], values.k[corner >> 2]);
  }
  return values.vertex;
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
// section there. Three corners a triangle, which lie between two vertices of the mesh, at `part` of the way; `cells` are the tets
// of the triangles.
function openSurface(map, heights) {
  const surface = { from: [], to: [], part: [], cells: [] };
  const point = (a, b) => {
    const [low, high] = a < b ? [a, b] : [b, a];
    surface.from.push(low);
    surface.to.push(high);
    surface.part.push(low === high ? 0 : heights[low] / (heights[low] - heights[high]));
  };
  const fan = (polygon, cell) => {
    for (let last = 2; last < polygon.length; last++) {
      for (const corner of [0, last - 1, last]) point(...polygon[corner]);
      surface.cells.push(cell);
    }
  };
  const kept = (vertex) => !heights || heights[vertex] >= 0;
  for (let triangle = 0; triangle < map.owners.length; triangle++) {
    const corners = map.triangles.subarray(3 * triangle, 3 * triangle + 3);
    const polygon = [];
    for (let corner = 0; corner < 3; corner++) {
      const [a, b] = [corners[corner], corners[(corner + 1) % 3]];
      if (kept(a)) polygon.push([a, a]);
      if (kept(a) !== kept(b)) polygon.push([a, b]);
    }
    fan(polygon, map.owners[triangle]);
  }
  if (!heights) return surface;
  for (let cell = 0; cell < map.values.k.length; cell++) {
    const first = 4 * cell;
    let count = 0;
    for (let corner = first; corner < first + 4; corner++) count += heights[map.tets[corner]] >= 0;
    if (count === 0 || count === 4) continue;
    const corners = Array.from(map.tets.subarray(first, first + 4));
    const [above, below] = [corners.filter(kept), corners.filter((vertex) => !kept(vertex))];
    // What lies in the plane counts as above it, so that a layer of tets which ends there shows its last faces once; tets that
    // touch the plane in a point or an edge show nothing.
    if (count < 3 && above.every((vertex) => heights[vertex] === 0)) continue;
    const [a, b, c, d] = [...below, ...above];
    fan(below.length === 1 ? [[a, b], [a, c], [a, d]] : below.length === 3 ? [[a, d], [b, d], [c, d]] : [[a, c], [a, d], [b, d], [b, c]], cell);
  }
  return surface;
}

// A quantity of the vertices at the corners of a surface.
function along({ from, to, part }, values) {
  return from.map((low, at) => (part[at] === 0 ? values[low] : values[low] + part[at] * (values[to[at]] - values[low])));
}

// The middle of the bounding box of points, and the radius of the ball around it that holds them.
function ballAround([x, y, z]) {
  const range = (column) => column.reduce(([least, most], one) => [Math.min(least, one), Math.max(most, one)], [Infinity, -Infinity]);
  const middle = [x, y, z].map((column) => range(column).reduce((sum, one) => sum + one / 2, 0));
  let radius = 0;
  for (let at = 0; at < x.length; at++) radius = Math.max(radius, Math.hypot(x[at] - middle[0], y[at] - middle[1], z[at] - middle[2]));
  return { middle, radius: radius || 1 };
}

// The first triangle that a ray meets, with the weights of its corners there, or null; corners as x, y, z one after the other.
function firstMet(corners, { from, along: way }) {
  let first = null;
  for (let at = 0; at < corners.length; at += 9) {
    const [ax, ay, az] = [corners[at], corners[at + 1], corners[at + 2]];
    const [ux, uy, uz] = [corners[at + 3] - ax, corners[at + 4] - ay, corners[at + 5] - az];
    const [vx, vy, vz] = [corners[at + 6] - ax, corners[at + 7] - ay, corners[at + 8] - az];
    // Moeller and Trumbore 1997.
    const [px, py, pz] = [way[1] * vz - way[2] * vy, way[2] * vx - way[0] * vz, way[0] * vy - way[1] * vx];
    const determinant = ux * px + uy * py + uz * pz;
    if (determinant === 0) continue;
    const [tx, ty, tz] = [from[0] - ax, from[1] - ay, from[2] - az];
    const u = (tx * px + ty * py + tz * pz) / determinant;
    if (u < 0 || u > 1) continue;
    const [qx, qy, qz] = [ty * uz - tz * uy, tz * ux - tx * uz, tx * uy - ty * ux];
    const v = (way[0] * qx + way[1] * qy + way[2] * qz) / determinant;
    if (v < 0 || u + v > 1) continue;
    const depth = (vx * qx + vy * qy + vz * qz) / determinant;
    if (depth > 0 && (!first || depth < first.depth)) first = { triangle: at / 9, depth, weights: [1 - u - v, u, v] };
  }
  return first;
}

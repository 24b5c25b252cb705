// The deformed body: in 3D meshes of WebGL, in 2D polygons of SVG, which every browser draws.
"use strict";

const BINS = 32; // bands of colours in 2D
const GREY = "#cdd5dc";
const body = { webgl: false, points: null, triangles: null, lines: null, faces: new Map() };

const VIEWS = {
  above: { x: 1.0, y: -1.5, z: 0.8 }, below: { x: 1.0, y: -1.5, z: -0.9 },
  front: { x: 0, y: -2, z: 0.05 }, side: { x: 2, y: 0, z: 0.05 },
};

function hasWebgl() {
  try {
    const canvas = document.createElement("canvas");
    return Boolean(canvas.getContext("webgl2") || canvas.getContext("webgl"));
  } catch {
    return false;
  }
}

/** Facets of an array (n, k) as lists of vertices. */
function rows(values, k) {
  const found = [];
  for (let i = 0; i < values.length; i += k) found.push(values.subarray(i, i + k));
  return found;
}

/** Corners of facets in an order around them; DOLFINx numbers those of quadrilaterals by rows. */
function around(facet) {
  return facet.length === 4 ? [facet[0], facet[1], facet[3], facet[2]] : Array.from(facet);
}

function keyOf(facet) {
  return Array.from(facet).sort((a, b) => a - b).join(" ");
}

async function prepareBody() {
  const b = META.body;
  body.webgl = hasWebgl();
  body.points = await array(b.x);
  const cells = rows(await array(b.cells), b.corners).map(around);
  const covered = new Set();
  for (const face of META.surfaces) {
    face.facets = rows(await array(face.cells), face.corners).map(around);
    face.nearest = rows(await array(face.nearest_points), face.corners).flatMap(around);
    face.anchorNodes = await array(face.anchors);
    face.anchorWeights = await array(face.weights);
    face.places = await array(face.place);
    face.across = b.dim === 3 ? acrossOf(face) : null;
    if (face.obstacle) face.obstacleFacets = rows(await array(face.obstacle.cells),
      face.obstacle.corners).map(around);
    if (b.dim === 3) face.facets.forEach((facet) => covered.add(keyOf(facet)));
  }
  body.oriented = b.dim === 3 ? oriented(cells) : null;
  // What is drawn as a contact face is not drawn as a part of the body as well.
  body.cells = cells.filter((cell) => !covered.has(keyOf(cell)));
  const edges = new Map();
  for (const cell of cells)
    cell.forEach((a, i) => {
      const z = cell[(i + 1) % cell.length];
      const key = a < z ? `${a} ${z}` : `${z} ${a}`;
      edges.set(key, (edges.get(key) || 0) + 1);
    });
  body.edges = [...edges.keys()].map((key) => key.split(" ").map(Number));
  body.outline = b.dim === 2
    ? [...edges].filter(([, n]) => n === 1).map(([key]) => key.split(" ").map(Number)) : body.edges;
}

/** Facets of closed surfaces, all turned outwards: neighbours run along an edge in two directions. */
function oriented(cells) {
  const sides = new Map();
  cells.forEach((cell, number) => cell.forEach((a, i) => {
    const z = cell[(i + 1) % cell.length];
    const key = a < z ? `${a} ${z}` : `${z} ${a}`;
    if (!sides.has(key)) sides.set(key, []);
    sides.get(key).push(number);
  }));
  const turned = cells.map(() => null);
  for (let start = 0; start < cells.length; start++) {
    if (turned[start]) continue;
    turned[start] = cells[start];
    const part = [start];
    for (let k = 0; k < part.length; k++) {
      const cell = turned[part[k]];
      cell.forEach((a, i) => {
        const z = cell[(i + 1) % cell.length];
        for (const other of sides.get(a < z ? `${a} ${z}` : `${z} ${a}`)) {
          if (turned[other]) continue;
          const c = cells[other];
          const same = c[(c.indexOf(a) + 1) % c.length] === z;
          turned[other] = same ? [...c].reverse() : c;
          part.push(other);
        }
      });
    }
    const volume = part.reduce((sum, k) => sum + volumeUnder(turned[k]), 0);
    if (volume < 0) for (const k of part) turned[k] = [...turned[k]].reverse();
  }
  return turned;
}

function volumeUnder(cell) {
  let sum = 0;
  const at = (v) => body.points.subarray(3 * v, 3 * v + 3);
  for (let c = 1; c < cell.length - 1; c++) {
    const [p, q, r] = [cell[0], cell[c], cell[c + 1]].map(at);
    sum += p[0] * (q[1] * r[2] - q[2] * r[1]) + p[1] * (q[2] * r[0] - q[0] * r[2]) +
      p[2] * (q[0] * r[1] - q[1] * r[0]);
  }
  return sum;
}

/** Places a little outside of the surface, where lines are not hidden in it. */
function outside(x) {
  const normals = new Float64Array(x.length);
  for (const cell of body.oriented) {
    const [a, b, c] = [cell[0], cell[1], cell[2]].map((v) => [x[3 * v], x[3 * v + 1], x[3 * v + 2]]);
    const [p, q] = [[0, 1, 2].map((k) => b[k] - a[k]), [0, 1, 2].map((k) => c[k] - a[k])];
    const n = [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
    for (const v of cell) for (let k = 0; k < 3; k++) normals[3 * v + k] += n[k];
  }
  const found = Float32Array.from(x);
  for (let i = 0; i < x.length; i += 3) {
    const size = Math.hypot(normals[i], normals[i + 1], normals[i + 2]) || 1;
    for (let k = 0; k < 3; k++) found[i + k] += 0.003 * META.body.size * normals[i + k] / size;
  }
  return found;
}

/** The two axes along which a contact face extends most. */
function acrossOf(face) {
  const range = [0, 1, 2].map((k) => {
    let low = Infinity, high = -Infinity;
    face.facets.forEach((facet) => facet.forEach((v) => {
      const c = body.points[3 * v + k];
      low = Math.min(low, c); high = Math.max(high, c);
    }));
    return high - low;
  });
  return [0, 1, 2].sort((a, b) => range[b] - range[a]).slice(0, 2).sort();
}

/** Where everything is at a state: vertices (n, 3), of the body and of its obstacles. */
async function placesAt(state, scale) {
  const dim = META.body.dim;
  const u = await fieldAt(META.fields.displacement, state);
  const n = u.length / dim;
  const x = new Float32Array(3 * n);
  for (let i = 0; i < n; i++)
    for (let k = 0; k < 3; k++)
      x[3 * i + k] = body.points[3 * i + k] + (k < dim ? scale * u[dim * i + k] : 0);
  const obstacles = new Map();
  for (const face of META.surfaces) {
    if (!face.obstacle) continue;
    const w = await fieldAt(face.obstacle.field, state);
    const start = await array(face.obstacle.x);
    const way = await array(face.obstacle.way);
    const y = new Float32Array(start.length);
    const size = 0.3 * META.body.size;
    const near = [];
    for (let i = 0; i < y.length / 3; i++) {
      let length = 0;
      for (let k = 0; k < 3; k++) {
        const part = k < dim ? scale * (way[dim * i + k] + w[dim * i + k]) : 0;
        y[3 * i + k] = start[3 * i + k] + part;
        length += part * part;
      }
      // An exaggerated gap leads far away where it was large before.
      near.push(Number.isFinite(length) && (scale <= 1 || Math.sqrt(length) < size));
    }
    const plane = face.obstacle.opposite && near.every(Boolean) ? planeBelow(y, x) : null;
    obstacles.set(face.name, plane || { y,
      facets: face.obstacleFacets.filter((facet) => facet.every((v) => near[v])) });
  }
  return { u, x, obstacles };
}

/** A plane obstacle as one rectangle, in 2D a segment, below all of the body; null if it is curved. */
function planeBelow(y, x) {
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [0, 1, 2].map((k) => a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3]);
  const longest = (vectors) => {
    const a = vectors.reduce((best, v) => (dot(v, v) > dot(best, best) ? v : best));
    return a.map((c) => c / (Math.sqrt(dot(a, a)) || 1));
  };
  const from = (places) => rows(places, 3).map((v) => [0, 1, 2].map((k) => v[k] - y[k]));
  const there = from(y);
  const along = longest(there);
  const n = META.body.dim === 2 ? [-along[1], along[0], 0] : longest(there.map((v) => cross(along, v)));
  if (!there.every((v) => Math.abs(dot(v, n)) < 1e-5 * META.body.size)) return null;
  const flattest = [0, 1, 2].reduce((best, k) => (Math.abs(n[k]) < Math.abs(n[best]) - 1e-6 ? k : best));
  const axes = META.body.dim === 2 ? [along]
    : [cross(cross(n, [0, 1, 2].map((k) => Number(k === flattest))), n)].map((a) => longest([a]));
  if (META.body.dim === 3) axes.push(cross(n, axes[0]));
  const rim = 0.04 * META.body.size;
  const above = from(x);
  const ends = axes.map((a) => above.map((v) => dot(v, a)).reduce(
    ([low, high], c) => [Math.min(low, c - rim), Math.max(high, c + rim)], [Infinity, -Infinity]));
  const corners = axes.length === 1 ? ends[0].map((c) => [c])
    : [[0, 0], [1, 0], [1, 1], [0, 1]].map(([i, j]) => [ends[0][i], ends[1][j]]);
  return { y: Float32Array.from(corners.flatMap((c) => [0, 1, 2].map(
    (k) => y[k] + c.reduce((sum, part, i) => sum + part * axes[i][k], 0)))),
  facets: [corners.map((_, i) => i)] };
}

/** What colours the body: values at the vertices, with their range and title. */
async function bodyValues(state, u) {
  const by = byId("body-colour").value;
  if (by === "none") return null;
  const dim = META.body.dim;
  const field = META.fields[by];
  if (field && by !== "displacement") {
    return { values: await fieldAt(field, state), range: [0, field.largest], title: field.label };
  }
  const values = new Float32Array(u.length / dim);
  const k = ["ux", "uy", "uz"].indexOf(by);
  for (let i = 0; i < values.length; i++) {
    if (k >= 0) values[i] = u[dim * i + k];
    else for (let j = 0; j < dim; j++) values[i] += u[dim * i + j] ** 2;
    if (k < 0) values[i] = Math.sqrt(values[i]);
  }
  const range = k >= 0 ? META.fields.displacement.ranges[k] : [0, META.fields.displacement.largest];
  const title = k >= 0 ? `u_${"xyz"[k]}` : "|u|";
  return { values, range, title: withUnit(title, "length") };
}

/** Values of contact points by which a face is coloured; of statuses their colours. */
function faceValues(face, table, by) {
  const n = face.points;
  if (!table || by === "none") return null;
  if (by === "status") {
    const letters = Array.from(table.letters, (code) => String.fromCharCode(code));
    return { colours: letters.map((letter) => statusOf(letter).colour) };
  }
  const values = new Float64Array(n);
  const parts = face.components[by];
  for (let i = 0; i < n; i++) {
    if (parts === 1) values[i] = table[by][i];
    else {
      for (let k = 0; k < parts; k++) values[i] += table[by][parts * i + k] ** 2;
      values[i] = Math.sqrt(values[i]);
    }
  }
  const range = face.ranges[by];
  const colours = Array.from(values, (v) => Number.isNaN(v) ? "#ffffff"
    : colourOf(LIGHT, (v - range[0]) / (range[1] - range[0] || 1)));
  return { values, range, colours, title: titleOf(by) };
}

/** Places (n, 3) of contact points. */
function contactPlaces(face, x) {
  const found = new Float32Array(3 * face.points);
  const k = face.corners;
  for (let i = 0; i < face.points; i++)
    for (let j = 0; j < k; j++) {
      const node = face.anchorNodes[k * i + j], weight = face.anchorWeights[k * i + j];
      for (let c = 0; c < 3; c++) found[3 * i + c] += weight * x[3 * node + c];
    }
  return found;
}

/** Traction on the body at contact points (n, dim). */
function tractions(face, table) {
  const dim = META.body.dim;
  const found = new Float64Array(dim * face.points);
  for (let i = 0; i < face.points; i++)
    for (let k = 0; k < dim; k++)
      found[dim * i + k] = table.shear[dim * i + k] - table.pressure[i] * table.n[dim * i + k];
  return found;
}

function tractionScale() {
  const largest = Math.max(...META.surfaces.map((face) => face.traction || 0));
  return largest > 0 ? 0.15 * META.body.size / largest : 0;
}

async function drawBody() {
  const state = stateNow();
  const target = byId("body");
  if (!state) return nothing(target, "No displacement was recorded at this point.");
  if (META.body.dim === 3 && !body.webgl) {
    return nothing(target, "This browser has no WebGL, so that bodies in 3D are not drawn. " +
      "The diagram, the contact face and the tables work without it.");
  }
  if (target.querySelector(".nothing")) target.replaceChildren();
  const scale = Number(byId("scale").value) || 0;
  const where = await placesAt(state, scale);
  const colour = await bodyValues(state, where.u);
  const tables = await Promise.all(META.surfaces.map((face) => tableAt(face, state)));
  const draw = META.body.dim === 3 ? draw3d : draw2d;
  await draw(where, colour, tables, scale);
  byId("body").dataset.state = state.low + state.share;
}

function nothing(target, text) {
  Plotly.purge(target);
  target.replaceChildren(element("div", text, "nothing"));
  return Promise.resolve();
}

/** Bounds of everything at all states, a little wider. */
function reach(scale) {
  return META.body.bounds.map(([low, high, least, most]) => {
    const ends = [low + scale * Math.min(least, 0), high + scale * Math.max(most, 0)];
    const more = (META.body.dim === 2 && byId("arrows").checked ? 0.14 : 0.04) * META.body.size;
    return [ends[0] - more, ends[1] + more];
  });
}

// -- in the plane -----------------------------------------------------------------------------------

/** Polygons of few colours: one filled trace a colour. */
function filled(polygons, colours, more) {
  const bins = new Map();
  polygons.forEach((polygon, i) => {
    if (!bins.has(colours[i])) bins.set(colours[i], { x: [], y: [] });
    const bin = bins.get(colours[i]);
    for (const [x, y] of polygon) { bin.x.push(x); bin.y.push(y); }
    bin.x.push(polygon[0][0], null); bin.y.push(polygon[0][1], null);
  });
  return [...bins].map(([colour, bin]) => ({ type: "scatter", mode: "lines", x: bin.x, y: bin.y,
    fill: "toself", fillcolor: colour, line: { color: colour, width: 0.7 }, hoverinfo: "skip",
    showlegend: false, ...more }));
}

function binned(scale, part) {
  const at = Math.min(Math.max(Number.isFinite(part) ? part : 0, 0), 1);
  return colourOf(scale, Math.round(at * BINS) / BINS);
}

/** The part of a polygon in which a value, the last entry of its corners, is above a level (or below it). */
function cut(polygon, level, sense) {
  const found = [];
  polygon.forEach((a, i) => {
    const b = polygon[(i + 1) % polygon.length];
    const [p, q] = [sense * (a[2] - level), sense * (b[2] - level)];
    if (p >= 0) found.push(a);
    if (p * q < 0) found.push(a.map((c, k) => c + p / (p - q) * (b[k] - c)));
  });
  return found;
}

/** Bands of colours: the values are linear in triangles; quadrilaterals are divided at their middles. */
function banded(cells, x, colour) {
  const [low, high] = colour.range;
  const polygons = [], shades = [];
  for (const cell of cells) {
    const corners = cell.map((v) => [x[3 * v], x[3 * v + 1],
      BINS * (colour.values[v] - low) / (high - low || 1)]);
    const middle = [0, 1, 2].map((k) => corners.reduce((sum, c) => sum + c[k], 0) / cell.length);
    const triangles = cell.length === 3 ? [corners]
      : corners.map((c, i) => [c, corners[(i + 1) % cell.length], middle]);
    for (const triangle of triangles) {
      const values = triangle.map((c) => c[2]);
      if (!values.every(Number.isFinite)) { polygons.push(triangle); shades.push(GREY); continue; }
      const last = Math.floor(Math.max(...values));
      for (let k = Math.floor(Math.min(...values)); k <= last; k++) {
        const band = cut(cut(triangle, k, 1), k + 1, -1);
        if (band.length > 2) { polygons.push(band); shades.push(colourOf(SCALE, (k + 0.5) / BINS)); }
      }
    }
  }
  return filled(polygons, shades);
}

/** Lines between pairs of vertices. */
function segments(pairs, x, look) {
  const found = { x: [], y: [] };
  for (const [a, b] of pairs) {
    found.x.push(x[3 * a], x[3 * b], null); found.y.push(x[3 * a + 1], x[3 * b + 1], null);
  }
  return { type: "scatter", mode: "lines", ...found, hoverinfo: "skip", showlegend: false,
    line: look };
}

function colourBar(range, scale, title) {
  return { type: "scatter", mode: "markers", x: [null], y: [null], showlegend: false,
    hoverinfo: "skip", marker: { color: [range[0]], cmin: range[0], cmax: range[1],
      colorscale: scale, showscale: true,
      colorbar: { title: { text: plain(title), side: "right" }, thickness: 12, len: 0.95 } } };
}

async function draw2d(where, colour, tables, scale) {
  const x = where.x;
  const data = [];
  const polygon = (cell) => cell.map((v) => [x[3 * v], x[3 * v + 1]]);
  data.push(...(colour ? banded(body.cells, x, colour)
    : filled(body.cells.map(polygon), body.cells.map(() => GREY))));
  if (byId("edges").checked)
    data.push(segments(body.edges, x, { color: "rgba(31,41,51,0.22)", width: 0.6 }));
  data.push(segments(body.outline, x, { color: "#52606d", width: 1 }));
  if (byId("before").checked)
    data.push(segments(body.outline, body.points, { color: "#8a949e", width: 1, dash: "dot" }));
  META.surfaces.forEach((face, number) => {
    const patch = where.obstacles.get(face.name);
    if (patch && byId("obstacles").checked) {
      data.push(segments(patch.facets, patch.y, { color: "#2b343d", width: 3 }));
    }
    data.push(...contact2d(face, tables[number], x, number));
  });
  if (colour) data.push(colourBar(colour.range, SCALE, colour.title));
  const [across, up] = reach(scale);
  const layout = plainLayout({
    xaxis: axis(withUnit("x", "length"), { range: across, constrain: "domain", zeroline: false }),
    yaxis: axis(withUnit("y", "length"), { range: up, scaleanchor: "x", zeroline: false,
      constrain: "domain" }),
    uirevision: `body ${scale}`, showlegend: false, margin: { l: 60, r: 10, t: 12, b: 44 },
  });
  await Plotly.react("body", data, layout, CONFIG);
  listenToPoints("body");
}

function contact2d(face, table, x, number) {
  if (!table) return [];
  const places = contactPlaces(face, x);
  const shown = faceValues(face, table, "status");
  const found = [];
  if (byId("arrows").checked) {
    const t = tractions(face, table);
    const factor = tractionScale();
    const line = { x: [], y: [] };
    for (let i = 0; i < face.points; i++) {
      const [a, b] = [places[3 * i], places[3 * i + 1]];
      const [p, q] = [factor * t[2 * i], factor * t[2 * i + 1]];
      if (!(Math.hypot(p, q) > 0)) continue;
      // Arrows push on the body, with their heads at the points.
      line.x.push(a - p, a, null); line.y.push(b - q, b, null);
    }
    found.push({ type: "scatter", mode: "lines+markers", ...line, hoverinfo: "skip",
      showlegend: false, line: { color: "#c0392b", width: 1.4 },
      marker: { symbol: "arrow", angleref: "previous", standoff: 4, color: "#c0392b",
        size: line.x.map((_, i) => (i % 3 === 1 ? 8 : 0)) } });
  }
  const xs = [], ys = [];
  for (let i = 0; i < face.points; i++) { xs.push(places[3 * i]); ys.push(places[3 * i + 1]); }
  found.push({ type: "scatter", mode: "markers", x: xs, y: ys, showlegend: false,
    customdata: xs.map((_, i) => [number, i]), text: xs.map((_, i) => pointWords(face, table, i)),
    hovertemplate: "%{text}<extra></extra>", marker: { color: shown.colours, size: face.points > 80
      ? 6 : 8, line: { color: "#1f2933", width: 0.8 } } });
  return found;
}

// -- in space ---------------------------------------------------------------------------------------

function mesh3d(x, triangles, more) {
  const [i, j, k] = [[], [], []];
  for (const facet of triangles)
    for (let c = 1; c < facet.length - 1; c++) {
      i.push(facet[0]); j.push(facet[c]); k.push(facet[c + 1]);
    }
  const part = (c) => Array.from({ length: x.length / 3 }, (_, v) => x[3 * v + c]);
  return { type: "mesh3d", x: part(0), y: part(1), z: part(2), i, j, k, hoverinfo: "skip",
    flatshading: true, lighting: { ambient: 0.8, diffuse: 0.35, specular: 0.02, roughness: 0.9,
      facenormalsepsilon: 0, vertexnormalsepsilon: 0 },
    lightposition: { x: 2000, y: -3000, z: 6000 }, ...more };
}

function segments3d(pairs, x, look) {
  const found = { x: [], y: [], z: [] };
  for (const [a, b] of pairs) {
    found.x.push(x[3 * a], x[3 * b], null); found.y.push(x[3 * a + 1], x[3 * b + 1], null);
    found.z.push(x[3 * a + 2], x[3 * b + 2], null);
  }
  return { type: "scatter3d", mode: "lines", ...found, hoverinfo: "skip", showlegend: false,
    line: look };
}

async function draw3d(where, colour, tables, scale) {
  const x = where.x;
  const look = colour
    ? { intensity: Array.from(colour.values), cmin: colour.range[0], cmax: colour.range[1] || 1,
      colorscale: SCALE, colorbar: { title: { text: plain(colour.title), side: "right" },
        thickness: 12, len: 0.9 } }
    : { color: GREY };
  const data = [mesh3d(x, body.cells, look)];
  if (byId("edges").checked)
    data.push(segments3d(body.edges, outside(x), { color: "rgba(31,41,51,0.6)", width: 1.5 }));
  if (byId("before").checked)
    data.push(segments3d(body.edges, body.points, { color: "#b6bec6", width: 1 }));
  META.surfaces.forEach((face, number) => {
    data.push(...contact3d(face, tables[number], x, number));
    const patch = where.obstacles.get(face.name);
    if (patch && byId("obstacles").checked) {
      data.push(mesh3d(patch.y, patch.facets, { color: "#7b8794", opacity: 0.28 }));
    }
  });
  const ranges = reach(scale);
  // To scale: the mode "data" of Plotly takes the extents of the traces, not of the axes.
  const lengths = ranges.map(([low, high]) => high - low);
  const unit = Math.hypot(...lengths) / Math.sqrt(3);
  const [rx, ry, rz] = lengths.map((length) => length / unit);
  const bare = (title, range) => ({ title: { text: title, font: { size: 11 } }, range,
    backgroundcolor: "white", gridcolor: "#e4e9ed", zeroline: false, tickfont: { size: 10 },
    showspikes: false });
  const view = byId("view").value;
  const layout = plainLayout({
    scene: { aspectmode: "manual", aspectratio: { x: rx, y: ry, z: rz },
      xaxis: bare("x", ranges[0]), yaxis: bare("y", ranges[1]), zaxis: bare("z", ranges[2]), camera: { eye: VIEWS[view], up: { x: 0, y: 0, z: 1 },
        center: { x: 0, y: 0, z: -0.08 } } },
    uirevision: view, margin: { l: 0, r: 0, t: 0, b: 0 }, showlegend: false,
  });
  await Plotly.react("body", data, layout, CONFIG);
  listenToPoints("body");
}

/** A contact face, each part of it in the colour of the contact point next to it. */
function contact3d(face, table, x, number) {
  const parts = subdivided(face, x);
  const shown = faceValues(face, table, byId("face-colour").value);
  const colours = parts.owners.flatMap((point) => Array(2).fill(shown ? shown.colours[point] : GREY));
  const found = [mesh3d(parts.x, parts.triangles, { facecolor: colours })];
  if (!table) return found;
  const places = contactPlaces(face, x);
  if (byId("arrows").checked) {
    const t = tractions(face, table);
    const factor = tractionScale();
    const line = { x: [], y: [], z: [] };
    for (let i = 0; i < face.points; i++) {
      const [p, q, r] = [0, 1, 2].map((k) => factor * t[3 * i + k]);
      if (!(Math.hypot(p, q, r) > 0)) continue;
      line.x.push(places[3 * i] - p, places[3 * i], null);
      line.y.push(places[3 * i + 1] - q, places[3 * i + 1], null);
      line.z.push(places[3 * i + 2] - r, places[3 * i + 2], null);
    }
    found.push({ type: "scatter3d", mode: "lines", ...line, hoverinfo: "skip", showlegend: false,
      line: { color: "#c0392b", width: 3 } });
  }
  const at = (c) => Array.from({ length: face.points }, (_, i) => places[3 * i + c]);
  found.push({ type: "scatter3d", mode: "markers", x: at(0), y: at(1), z: at(2), showlegend: false,
    customdata: at(0).map((_, i) => [number, i]), text: at(0).map((_, i) => pointWords(face, table, i)),
    hovertemplate: "%{text}<extra></extra>",
    marker: { size: 2.6, color: shown ? shown.colours : GREY, line: { color: "#1f2933", width: 0.5 } } });
  return found;
}

/** Facets of a contact face cut into a part a corner: vertices, triangles, and whose they are. */
function subdivided(face, x) {
  const places = [], triangles = [], owners = [];
  face.facets.forEach((facet, number) => {
    const first = places.length / 3;
    const k = facet.length;
    const corner = (c) => [0, 1, 2].map((d) => x[3 * facet[c % k] + d]);
    const middle = [0, 1, 2].map((d) => facet.reduce((sum, v) => sum + x[3 * v + d], 0) / k);
    for (let c = 0; c < k; c++) {
      const [a, b] = [corner(c), corner(c + 1)];
      places.push(...a, ...a.map((value, d) => (value + b[d]) / 2));
    }
    places.push(...middle);
    for (let c = 0; c < k; c++) {
      const before = (c + k - 1) % k;
      triangles.push([first + 2 * c, first + 2 * c + 1, first + 2 * k, first + 2 * before + 1]);
      owners.push(face.nearest[k * number + c]);
    }
  });
  return { x: Float32Array.from(places), triangles, owners };
}

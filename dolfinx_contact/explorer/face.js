// The contact face by itself: in 2D tractions along it, in 3D a map of it.
"use strict";

const MOST_ARROWS = 300; // of a map
const TITLES = { un: "gap", ut: "slip", pressure: "pressure", shear: "shear", rn: "normal force",
  rt: "tangential force", status: "status", area: "area", slid: "distance slipped",
  bound: "friction bound" };
const UNITS = { un: "length", ut: "length", pressure: "stress", shear: "stress", rn: "force",
  rt: "force", bound: "stress", slid: "length", x: "length", y: "length", z: "length" };

function titleOf(name) {
  return withUnit(TITLES[name] || name.replace("internal.", ""), UNITS[name]);
}

/** Size of the values of a column of contact points, relative to which round-off is judged. */
function scaleOf(face, name) {
  if ("xyz".includes(name)) return META.body.size;
  const quantity = UNITS[name];
  if (quantity === "stress") return Math.max(...META.surfaces.map((one) => one.traction));
  if (quantity === "force") return Math.max(...META.surfaces.map((one) => one.force));
  const range = face.ranges[name] || [0, 0];
  const own = Math.max(-range[0], range[1]);
  return quantity === "length" ? Math.max(own, META.fields.displacement.largest) : own;
}

function faceNow() {
  return META.surfaces[Number(byId("surface").value)];
}

function pointWords(face, table, i) {
  const letter = String.fromCharCode(table.letters[i]);
  const dim = META.body.dim;
  const along = (name) => tangential(face, table, name, i);
  const place = Array.from(table.x.subarray(dim * i, dim * (i + 1)),
    (c) => written(c, 4, META.body.size));
  const value = (name, number) => written(number, 6, scaleOf(face, name));
  const bound = face.ranges.bound[1] > 0 ? ` (friction bound ${value("bound", table.bound[i])})` : "";
  return [`<b>${plain(face.name)}</b>, point ${i}`, `at (${place.join(", ")})`,
    plain(statusOf(letter).name), `gap ${value("un", table.un[i])}`,
    `pressure ${value("pressure", table.pressure[i])}`,
    `shear ${value("shear", along("shear"))}${bound}`].join("<br>");
}

/** A tangential vector as a number: along t = (-n_y, n_x) in 2D, its length in 3D. */
function tangential(face, table, name, i) {
  if (META.body.dim === 2) {
    const [a, b] = [table[name][2 * i], table[name][2 * i + 1]];
    return -a * table.n[2 * i + 1] + b * table.n[2 * i];
  }
  return Math.hypot(...table[name].subarray(3 * i, 3 * i + 3));
}

async function drawFace() {
  const state = stateNow();
  const face = faceNow();
  const table = !state || !face ? null : await tableAt(face, state);
  const target = byId("face");
  if (!table) {
    return nothing(target, "No contact points were recorded here.");
  }
  if (target.querySelector(".nothing")) target.replaceChildren();
  await (META.body.dim === 2 ? along(face, table) : map(face, table));
  listenToPoints("face");
}

async function along(face, table) {
  const order = Array.from(face.places.keys()).sort((a, b) => face.places[a] - face.places[b]);
  const number = META.surfaces.indexOf(face);
  const s = order.map((i) => face.places[i]);
  const statuses = faceValues(face, table, "status").colours;
  const line = (values, name, colour) => ({ type: "scatter", mode: "lines+markers", x: s,
    y: order.map(values), name, line: { color: colour, width: 1.6 },
    customdata: order.map((i) => [number, i]), text: order.map((i) => pointWords(face, table, i)),
    hovertemplate: "%{text}<extra></extra>",
    marker: { size: face.points > 80 ? 5 : 7, color: order.map((i) => statuses[i]),
      line: { color: colour, width: 1 } } });
  const by = byId("face-colour").value;
  const isTraction = ["status", "pressure", "shear", "bound", "none"].includes(by);
  const data = isTraction
    ? [line((i) => table.pressure[i], "pressure", "#1f2933"),
      line((i) => tangential(face, table, "shear", i), "shear", "#c0392b")]
    : [line((i) => (face.components[by] > 1 ? tangential(face, table, by, i) : table[by][i]),
      TITLES[by] || by, "#1f2933")];
  const most = Math.max(face.ranges.shear[1], face.ranges.bound[1]);
  const [low, high] = isTraction ? [-most, Math.max(face.ranges.pressure[1], most)]
    : [Math.min(0, ...data[0].y), Math.max(0, ...data[0].y)];
  const more = 0.06 * (high - low || 1);
  // The shear lies between the friction bound and its negative.
  if (isTraction && face.ranges.bound[1] > 0) {
    for (const sign of [1, -1]) data.push({ type: "scatter", mode: "lines", x: s,
      y: order.map((i) => sign * table.bound[i]), name: "± friction bound", legendgroup: "bound",
      showlegend: sign > 0, hoverinfo: "skip", line: { color: "#c0392b", width: 1.2, dash: "dot" } });
  }
  data.push(pickedTrace(face, s, data[0].y, order));
  await Plotly.react("face", data, plainLayout({
    xaxis: axis(withUnit("distance along the face", "length")),
    yaxis: axis(isTraction ? withUnit("traction", "stress") : titleOf(by),
      isTraction ? { range: [low - more, high + more] } : {}),
    legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 },
    margin: { l: 64, r: 12, t: 26, b: 44 }, uirevision: face.name + by,
  }), SMALL);
}

function pickedTrace(face, xs, ys, order) {
  const at = order.indexOf(now.point);
  const here = now.surface === META.surfaces.indexOf(face) && at >= 0;
  return { type: "scatter", mode: "markers", x: [here ? xs[at] : null], y: [here ? ys[at] : null],
    hoverinfo: "skip", showlegend: false,
    marker: { symbol: "circle-open", size: 15, color: "#c0392b", line: { width: 2.5 } } };
}

async function map(face, table) {
  const [p, q] = face.across;
  const x = body.points;
  const polygons = [], owners = [];
  const parts = subdivided(face, x);
  parts.triangles.forEach((part, i) => {
    polygons.push(part.map((v) => [parts.x[3 * v + p], parts.x[3 * v + q]]));
    owners.push(parts.owners[i]);
  });
  const by = byId("face-colour").value;
  const shown = faceValues(face, table, by);
  const shades = !shown ? Array(face.points).fill(GREY)
    : shown.values ? Array.from(shown.values, (v) => Number.isNaN(v) ? "#ffffff" : binned(LIGHT,
      (v - shown.range[0]) / (shown.range[1] - shown.range[0] || 1))) : shown.colours;
  const data = filled(polygons, owners.map((point) => shades[point]));
  const places = contactPlaces(face, x);
  const xs = [], ys = [];
  for (let i = 0; i < face.points; i++) { xs.push(places[3 * i + p]); ys.push(places[3 * i + q]); }
  if (byId("arrows").checked) data.push(shearTrace(face, table, xs, ys));
  const number = META.surfaces.indexOf(face);
  data.push({ type: "scatter", mode: "markers", x: xs, y: ys, showlegend: false,
    customdata: xs.map((_, i) => [number, i]), text: xs.map((_, i) => pointWords(face, table, i)),
    hovertemplate: "%{text}<extra></extra>",
    marker: { size: face.points > 400 ? 3 : 5, color: "rgba(31,41,51,0.55)" } });
  data.push(pickedTrace(face, xs, ys, xs.map((_, i) => i)));
  if (shown && shown.values) data.push(colourBar(shown.range, LIGHT, shown.title));
  if (by === "status") data.push(...statusLegend(table));
  await Plotly.react("face", data, plainLayout({
    xaxis: axis(withUnit("xyz"[p], "length"), { constrain: "domain", zeroline: false }),
    yaxis: axis(withUnit("xyz"[q], "length"), { scaleanchor: "x", constrain: "domain",
      zeroline: false }),
    legend: { font: { size: 11 } }, margin: { l: 56, r: 10, t: 10, b: 42 },
    uirevision: face.name,
  }), SMALL);
}

function statusLegend(table) {
  const present = [...new Set(table.letters)].map((code) => String.fromCharCode(code));
  return present.map((letter) => ({ type: "scatter", mode: "markers", x: [null], y: [null],
    name: plain(statusOf(letter).name), hoverinfo: "skip",
    marker: { symbol: "square", size: 11, color: statusOf(letter).colour } }));
}

/** Shear on the body, in the plane of the map. */
function shearTrace(face, table, xs, ys) {
  const [p, q] = face.across;
  const factor = face.ranges.shear[1] > 0 ? 0.1 * META.body.size / face.ranges.shear[1] : 0;
  const line = { x: [], y: [] };
  const every = Math.ceil(face.points / MOST_ARROWS);
  for (let i = 0; i < face.points; i += every) {
    const [a, b] = [table.shear[3 * i + p] * factor, table.shear[3 * i + q] * factor];
    if (!(Math.hypot(a, b) > 0)) continue;
    line.x.push(xs[i], xs[i] + a, null); line.y.push(ys[i], ys[i] + b, null);
  }
  return { type: "scatter", mode: "lines+markers", ...line, hoverinfo: "skip", showlegend: false,
    line: { color: "#1f2933", width: 1.2 }, marker: { symbol: "arrow", angleref: "previous",
      color: "#1f2933", size: line.x.map((_, i) => (i % 3 === 1 ? 7 : 0)) } };
}

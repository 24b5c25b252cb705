// The diagram: any column over any other, series coloured by what is known of their points.
"use strict";

const MOST_MARKED = 1500; // points that have a marker and a tooltip each
const CLICK_POINT = 6; // pixels from a recorded point that select it
const CLICK_LINE = 12; // pixels from a line that select a place on it
const SYMBOLS = {
  fold: "circle", bifurcation: "star", end: "x", event: "line-ns-open", kink: "diamond",
  jump: "triangle-up",
};
const STABILITY = "stable"; // a functional that is 1 or 0, NaN where it is not decided
/** Colours by branch: a word that is the name of no column. */
let SERIES = "series";
while (META.columns.some((c) => c.name === SERIES)) SERIES += " ";
const diagram = { ring: 0, columns: null, words: [], listens: false };

function column(name) {
  const at = META.columns.findIndex((c) => c.name === name);
  return diagram.columns.subarray(at * META.points, (at + 1) * META.points);
}

/** Set values of a column that are round-off of its scale to 0. */
function withoutRoundOff({ name, scale }) {
  const values = column(name);
  values.forEach((value, i) => { if (Math.abs(value) <= ROUND_OFF * scale) values[i] = 0; });
}

function valueAt(series, index, name) {
  return column(name)[META.series[series].first + index];
}

/** Value of a column at the selected place, interpolated between two points. */
function valueNow(name) {
  const low = valueAt(now.series, now.index, name);
  return now.share ? low + now.share * (valueAt(now.series, now.index + 1, name) - low) : low;
}

/** Whether a point is an event, a fold or a bifurcation itself; its statuses are those behind it. */
function turnsAt(s, index) {
  return s.marks.some((m) => m.index === index && !(m.share < 1));
}

/** Statuses at the selected place. */
function wordNow() {
  const s = META.series[now.series];
  return diagram.words[s.first + now.index + (now.share && !turnsAt(s, now.index + 1) ? 1 : 0)];
}

/** What is present at a point: "stick + slip", in the order of the words of statuses. */
function kindsOf(word) {
  const present = new Set();
  for (const letter of word) present.add(statusOf(letter).kind);
  const order = ["open", "stick", "slip"];
  const found = order.filter((kind) => present.has(kind));
  return found.join(" + ") || "clamped";
}

/** The class of every point, for a colour by classes; null for a colour by a number. */
function classes(by) {
  if (by === SERIES) {
    return META.series.flatMap((s) => Array(s.count).fill(s.name));
  }
  if (by === "status") return diagram.words.map(kindsOf);
  if (by === STABILITY) {
    return Array.from(column(by), (v) => (v > 0 ? "stable" : v <= 0 ? "unstable" : "not decided"));
  }
  return null;
}

/** Several statuses at once have colours that no status of a single point has. */
const OF_CLASSES = {
  stable: "#0072B2", unstable: "#D55E00", "not decided": "#8a949e",
  open: "#8a949e", stick: "#0072B2", slip: "#E69F00", "stick + slip": "#882255",
  "open + stick": "#332288", "open + slip": "#D55E00", "open + stick + slip": "#117777",
  clamped: "#555555",
};

/** The colour of every class; those without one of their own in the order of their appearance. */
function coloursOf(kinds) {
  const colours = new Map();
  let number = 0;
  for (const kind of kinds) {
    if (colours.has(kind)) continue;
    colours.set(kind, OF_CLASSES[kind] || LINES[number % LINES.length]);
    number += 1;
  }
  return colours;
}

/** Lines of one class each, and one trace of markers with tooltips. */
function traces(x, y, by) {
  const found = [];
  const kinds = classes(by);
  const colours = kinds ? coloursOf(kinds) : null;
  if (kinds) {
    const lines = new Map();
    META.series.forEach((s) => {
      // The part up to an event has the statuses of the point before it, any other part those of
      // the point to which it leads.
      const turns = new Set(s.marks.filter((m) => !(m.share < 1)).map((m) => m.index));
      for (let i = 0; i < s.count; i++) {
        const at = s.first + i;
        const kind = kinds[turns.has(i) && i > 0 ? at - 1 : at];
        // What is known of single points has its name in the legend too.
        for (const one of [kind, kinds[at]])
          if (!lines.has(one)) lines.set(one, { x: [], y: [], last: -2 });
        if (i === 0) continue;
        const line = lines.get(kind);
        if (line.last !== at - 1) {
          if (line.x.length) { line.x.push(null); line.y.push(null); }
          line.x.push(x[at - 1]); line.y.push(y[at - 1]);
        }
        line.x.push(x[at]); line.y.push(y[at]);
        line.last = at;
      }
    });
    for (const line of lines.values()) if (!line.x.length) { line.x.push(null); line.y.push(null); }
    let number = 0;
    for (const [kind, line] of lines) {
      const dash = by === SERIES ? ["solid", "dash", "dashdot", "dot"][
        Math.floor(number / LINES.length) % 4] : kind === "unstable" ? "dash" : "solid";
      found.push({ type: "scatter", mode: "lines", x: line.x, y: line.y, name: plain(kind),
        line: { color: colours.get(kind), width: 2.2, dash }, hoverinfo: "skip", connectgaps: false });
      number += 1;
    }
  } else {
    META.series.forEach((s) => found.push({ type: "scatter", mode: "lines", showlegend: false,
      x: Array.from(x.subarray(s.first, s.first + s.count)),
      y: Array.from(y.subarray(s.first, s.first + s.count)),
      line: { color: "#b6bec6", width: 1.4 }, hoverinfo: "skip" }));
  }
  found.push(pointsTrace(x, y, by, kinds, colours));
  return found;
}

/** Markers with tooltips: all points, or every so many of a long record. */
function pointsTrace(x, y, by, kinds, colours) {
  const every = Math.ceil(META.points / MOST_MARKED);
  const xs = [], ys = [], data = [], texts = [], shown = [];
  META.series.forEach((s, number) => {
    for (let i = 0; i < s.count; i++) {
      if (i % every && i !== s.count - 1) continue;
      const at = s.first + i;
      xs.push(x[at]); ys.push(y[at]); data.push([number, i]);
      texts.push(tooltip(number, i));
      shown.push(kinds ? colours.get(kinds[at]) : column(by)[at]);
    }
  });
  return { type: "scatter", mode: "markers", x: xs, y: ys, customdata: data, text: texts,
    hovertemplate: "%{text}<extra></extra>", showlegend: false, name: "points",
    marker: { size: META.points > 400 ? 4 : 5.5, color: shown, line: { width: 0 },
      ...(kinds ? {} : { colorscale: SCALE, showscale: true,
        colorbar: { title: { text: plain(label(by)), side: "right" }, thickness: 12 } }) } };
}

function tooltip(series, index) {
  const s = META.series[series];
  const names = [...new Set([META.along, byId("axis-x").value, byId("axis-y").value])];
  const noun = META.along === "gamma" ? "point" : "step";
  const lines = [`<b>${plain(s.name)}</b>, ${noun} ${index}`];
  for (const name of names) lines.push(`${plain(label(name))} = ` +
    writtenOf(name, valueAt(series, index, name)));
  lines.push(plain(runs(diagram.words[s.first + index])).replace(/(.{50,70}?,) /g, "$1<br>"));
  return lines.join("<br>");
}

function markTraces(x, y, xName, yName, names) {
  const kinds = new Map();
  META.series.forEach((s, number) => s.marks.forEach((mark) => {
    if (!kinds.has(mark.kind)) kinds.set(mark.kind, []);
    kinds.get(mark.kind).push([number, mark]);
  }));
  return [...kinds].map(([kind, marks]) => {
    const exact = (name, values) => marks.map(([number, mark]) => {
      if (name in mark.at) return mark.at[name];
      // Between the point before and its own.
      const at = META.series[number].first + mark.index;
      return mark.share < 1 ? values[at - 1] + mark.share * (values[at] - values[at - 1]) : values[at];
    });
    const small = kind === "event";
    const known = Object.keys(SYMBOLS).find((k) => kind.endsWith(k));
    return { type: "scatter", mode: names && !small ? "markers+text" : "markers",
      x: exact(xName, x), y: exact(yName, y), name: plain(kind),
      text: marks.map(() => plain(kind)), textposition: "top center",
      textfont: { size: 11, color: "#3e4c59" }, customdata: marks.map(([n, m]) => [n, m.index]),
      hovertext: marks.map(([n, m]) => `<b>${plain(kind)}</b>, ${plain(META.series[n].name)}, ` +
        `point ${m.index}<br>${plain(m.text).replace(/; /g, "<br>")}`),
      hovertemplate: "%{hovertext}<extra></extra>",
      visible: small && marks.length > 300 ? "legendonly" : true,
      marker: { symbol: SYMBOLS[known] || "square", size: small ? 7 : kind === "bifurcation" ? 13 : 9,
        color: small ? "#52606d" : "#F0E442", line: { color: "#1f2933", width: small ? 1 : 1.2 } } };
  });
}

async function drawDiagram() {
  const [xName, yName, by] = ["axis-x", "axis-y", "colour"].map((id) => byId(id).value);
  const x = column(xName), y = column(yName);
  const data = traces(x, y, by);
  data.push(...markTraces(x, y, xName, yName, byId("names").checked));
  data.push(...countTraces(xName, y));
  diagram.ring = data.length;
  data.push({ type: "scatter", mode: "markers", x: [null], y: [null], showlegend: false,
    hoverinfo: "skip", marker: { symbol: "circle-open", size: 17, color: "#c0392b",
      line: { width: 3 } } });
  const layout = plainLayout({
    xaxis: axis(label(xName), rangeOf(x)), yaxis: axis(label(yName), rangeOf(y)), uirevision: `${xName} ${yName}`,
    legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0, font: { size: 11.5 } },
    margin: { l: 64, r: 16, t: 54, b: 46 },
  });
  await Plotly.react("diagram", data, layout, CONFIG);
  if (!diagram.listens) listenToClicks();
  diagram.listens = true;
  await ringAt();
}

/** Range of an axis: that of the data, with a margin. */
function rangeOf(values) {
  const finite = values.filter(Number.isFinite);
  let low = Infinity, high = -Infinity;
  for (const v of finite) { if (v < low) low = v; if (v > high) high = v; }
  if (!(high > low)) return {};
  const margin = 0.04 * (high - low);
  return { range: [low - margin, high + margin] };
}

/** Listen to clicks anywhere in the diagram; `plotly_click` reports clicks on markers only. */
function listenToClicks() {
  let pressed = null;
  byId("diagram").addEventListener("mousedown", (event) => { pressed = event; }, true);
  document.addEventListener("mouseup", (event) => {
    const still = pressed && Math.hypot(event.clientX - pressed.clientX,
      event.clientY - pressed.clientY) < 4;
    if (still) clickDiagram(event);
    pressed = null;
  }, true);
}

/** Go to the place of the lines that is next to a click: a recorded point, or between two of them. */
function clickDiagram(event) {
  const plot = byId("diagram");
  const frame = plot.getBoundingClientRect();
  const { xaxis, yaxis } = plot._fullLayout;
  const [px, py] = [event.clientX - frame.left - xaxis._offset, event.clientY - frame.top - yaxis._offset];
  if (px < 0 || py < 0 || px > xaxis._length || py > yaxis._length) return;
  const [x, y] = ["axis-x", "axis-y"].map((id) => column(byId(id).value));
  const place = (at) => [xaxis.d2p(x[at]), yaxis.d2p(y[at])];
  let point = { far: CLICK_POINT }, part = { far: CLICK_LINE };
  META.series.forEach((s, series) => {
    for (let index = 0; index < s.count; index++) {
      const [a, b] = place(s.first + index);
      const far = Math.hypot(a - px, b - py);
      if (far < point.far) point = { far, series, index, share: 0 };
      if (index + 1 === s.count) continue;
      const [c, d] = place(s.first + index + 1);
      const square = (c - a) ** 2 + (d - b) ** 2;
      if (!(square > 0)) continue;
      const share = Math.min(Math.max(((px - a) * (c - a) + (py - b) * (d - b)) / square, 0), 1);
      const off = Math.hypot(a + share * (c - a) - px, b + share * (d - b) - py);
      if (off < part.far) part = { far: off, series, index, share };
    }
  });
  const chosen = point.series !== undefined ? point : part;
  if (chosen.series !== undefined) choose(chosen.series, chosen.index, chosen.share);
}

/** A dotted line at every gamma at which solutions were counted. */
function countTraces(xName, y) {
  if (xName !== "gamma") return [];
  let low = Infinity, high = -Infinity;
  for (const value of y) { if (value < low) low = value; if (value > high) high = value; }
  return META.counts.map((count) => ({ type: "scatter", mode: "lines", showlegend: false,
    x: [count.gamma, count.gamma], y: [low, high], hoverinfo: "skip",
    line: { color: count.proved ? "#00694b" : "#9a5b00", width: 1.2, dash: "dot" } }));
}

async function ringAt() {
  const [x, y] = ["axis-x", "axis-y"].map((id) => valueNow(byId(id).value));
  await Plotly.restyle("diagram", { x: [[x]], y: [[y]] }, [diagram.ring]);
}

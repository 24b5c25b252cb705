// Numbers, words and colours.
"use strict";

const LINES = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000"];
// From light to dark, so that a body at rest is light: of displacements and of tractions.
const SCALE = [
  [0, "#f3efe6"], [0.2, "#f6d9a0"], [0.4, "#f0a868"], [0.6, "#dc6a53"], [0.8, "#a83a5b"],
  [1, "#5a1a52"],
];
const LIGHT = [
  [0, "#f4f6f8"], [0.25, "#c6dbef"], [0.5, "#6baed6"], [0.75, "#2171b5"], [1, "#08306b"],
];
const FONT = { family: 'system-ui, "Segoe UI", "DejaVu Sans", sans-serif', size: 12,
  color: "#1f2933" };

const ROUND_OFF = 1e-12; // relative to the scale of a value

/** A number for people; round-off relative to `scale` is written as 0. */
function written(value, digits = 6, scale = 0) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (!Number.isFinite(value)) return String(value);
  if (Math.abs(value) <= ROUND_OFF * scale) return "0";
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-4 || size >= 1e7)) return value.toExponential(digits - 2);
  return String(Number(value.toPrecision(digits)));
}

/** A text as Plotly's labels take it, which know some tags. */
function plain(text) {
  return String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
}

function colourOf(scale, part) {
  const at = Math.min(Math.max(Number.isFinite(part) ? part : 0, 0), 1);
  let i = 1;
  while (i < scale.length - 1 && scale[i][0] < at) i++;
  const [low, a] = scale[i - 1];
  const [high, b] = scale[i];
  const share = (at - low) / (high - low);
  const mix = [1, 3, 5].map((k) => {
    const [from, to] = [a, b].map((colour) => parseInt(colour.slice(k, k + 2), 16));
    return Math.round(from + share * (to - from));
  });
  return `rgb(${mix.join(",")})`;
}

function statusOf(letter) {
  return META.statuses[letter] || { name: letter, colour: "#999999", kind: "" };
}

/** "12 open, 3 stick": runs of one status. */
function runs(word) {
  const found = [];
  for (const letter of word) {
    const last = found[found.length - 1];
    if (last && last[0] === letter) last[1] += 1;
    else found.push([letter, 1]);
  }
  if (found.length > 12) {
    const counts = new Map();
    for (const letter of word) counts.set(letter, (counts.get(letter) || 0) + 1);
    return [...counts].map(([letter, n]) => `${n} ${statusOf(letter).name}`).join(", ");
  }
  return found.map(([letter, n]) => `${n} ${statusOf(letter).name}`).join(", ");
}

function label(name) {
  const column = META.columns.find((c) => c.name === name);
  return column ? column.label : name;
}

/** A value of a column of the diagram, in words. */
function writtenOf(name, value, digits = 6) {
  const column = META.columns.find((c) => c.name === name);
  return written(value, digits, column ? column.scale : 0);
}

/** Place on a series in words: steps of a history or path and points of a branch count from 0. */
function placeInWords(series, index, share = 0) {
  const s = META.series[series];
  const noun = META.along === "gamma" ? "point" : "step";
  const place = share ? `between ${noun}s ${index} and ${index + 1}` : `${noun} ${index}`;
  const last = s.count > 1 ? ` (0 to ${s.count - 1})` : ` (the only ${noun})`;
  return (META.series.length > 1 ? `${s.name}, ` : "") + place + last;
}

function many(n) {
  return `${n} solution${n === 1 ? "" : "s"}`;
}

/** A unit behind a word, if there is one. */
function withUnit(word, quantity) {
  const unit = META.units[quantity];
  return unit ? `${word} [${unit}]` : word;
}

function element(tag, text = "", classes = "") {
  const made = document.createElement(tag);
  made.textContent = text;
  if (classes) made.className = classes;
  return made;
}

function byId(id) {
  return document.getElementById(id);
}

function options(select, pairs, chosen) {
  select.replaceChildren(...pairs.map(([value, text]) => {
    const option = element("option", text);
    option.value = value;
    return option;
  }));
  if (pairs.some(([value]) => value === chosen)) select.value = chosen;
}

/** A layout that all plots share. */
function plainLayout(more) {
  return {
    font: FONT, paper_bgcolor: "white", plot_bgcolor: "white", margin: { l: 64, r: 16, t: 12, b: 46 },
    hovermode: "closest", hoverlabel: { bgcolor: "white", font: FONT, align: "left" }, ...more,
  };
}

function axis(title, more) {
  return { title: { text: plain(title), standoff: 8 }, gridcolor: "#eceff2", zeroline: true,
    zerolinecolor: "#cfd6dc", linecolor: "#9aa5b1", ticks: "outside", tickcolor: "#9aa5b1",
    automargin: true, ...more };
}

// No button of Plotly sends data to a server.
const CONFIG = { responsive: true, displaylogo: false, showSendToCloud: false, plotlyServerURL: "",
  modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d", "toggleSpikelines"] };
const SMALL = { ...CONFIG, displayModeBar: false };

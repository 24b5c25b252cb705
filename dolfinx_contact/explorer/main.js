// What is chosen, and who is told of it.
"use strict";

const now = { series: 0, index: 0, share: 0, surface: 0, point: -1, gamma: 0, playing: false, tab: "points" };
const PAUSE = 90; // milliseconds between points that are played
let drawing = null;
let again = false;

/** The recorded states around the selected place, or null if one was not recorded. */
function stateNow() {
  if (!META.body) return null;
  const s = META.series[now.series];
  const [low, high] = [0, now.share ? 1 : 0].map((k) => diagram.states[s.first + now.index + k]);
  if (low < 0 || high < 0) return null;
  return { low, high, share: now.share, lettersOfHigh: !turnsAt(s, now.index + 1) };
}

/** Go to a point of a series, or to a place between it and the next one if the series is linear. */
async function choose(series, index, share = 0) {
  now.series = Math.min(Math.max(series, 0), META.series.length - 1);
  const last = META.series[now.series].count - 1;
  const inside = META.series[now.series].linear && share > 0 && share < 1 && index >= 0 && index < last;
  now.share = inside ? share : 0;
  now.index = Math.min(Math.max(inside ? index : index + Math.round(share), 0), last);
  byId("series").value = String(now.series);
  byId("slider").max = String(last);
  byId("slider").value = String(now.index);
  byId("where").textContent = `${placeInWords(now.series, now.index, now.share)}:  ` +
    `${label(META.along)} = ${writtenOf(META.along, valueNow(META.along))}`;
  await redraw();
  keep();
}

/** Draw what depends on the point; what is asked for meanwhile is drawn once, at the end. */
async function redraw() {
  if (drawing) { again = true; return drawing; }
  drawing = (async () => {
    do {
      again = false;
      await ringAt();
      if (META.body) { await drawBody(); await drawFace(); }
      if (!now.playing) await drawTab();
    } while (again);
  })().finally(() => { drawing = null; });
  return drawing;
}

async function drawTab() {
  for (const button of document.querySelectorAll(".tabs button")) {
    const mine = button.dataset.tab === now.tab;
    button.classList.toggle("chosen", mine);
    byId(button.dataset.tab).hidden = !mine;
  }
  if (now.tab === "points") await drawPoints();
  else if (now.tab === "values") drawValues();
  else drawSolutions();
}

/** Choose a contact point. */
async function pick(surface, point) {
  now.surface = surface;
  now.point = point;
  byId("surface").value = String(surface);
  now.tab = "points";
  await drawFace();
  await drawTab();
}

const listening = new Set();

function listenToPoints(id) {
  if (listening.has(id)) return;
  listening.add(id);
  byId(id).on("plotly_click", (event) => {
    const point = event.points.find((p) => p.customdata);
    if (point) pick(point.customdata[0], point.customdata[1]);
  });
}

async function play() {
  now.playing = !now.playing;
  byId("play").innerHTML = now.playing ? "&#10074;&#10074;" : "&#9654;";
  if (now.playing && now.index === META.series[now.series].count - 1) await choose(now.series, 0);
  while (now.playing && now.index < META.series[now.series].count - 1) {
    await choose(now.series, now.index + 1);
    await new Promise((done) => setTimeout(done, PAUSE));
  }
  now.playing = false;
  byId("play").innerHTML = "&#9654;";
  await drawTab();
}

const KEYS = {
  ArrowLeft: () => choose(now.series, now.share ? now.index : now.index - 1),
  ArrowRight: () => choose(now.series, now.index + 1),
  Home: () => choose(now.series, 0),
  End: () => choose(now.series, Infinity),
  ArrowUp: () => choose(now.series - 1, now.index),
  ArrowDown: () => choose(now.series + 1, now.index),
  " ": () => play(),
};

const HELP = "Keys: left and right go along, up and down to other branches, Home and End to the " +
  "ends, the space bar plays. A click on a point of the diagram shows it; between two points of a " +
  "piecewise linear branch it shows the interpolated state. A click on a contact point finds it in " +
  "the table.";

function listen() {
  document.addEventListener("keydown", (event) => {
    const typing = ["SELECT", "INPUT"].includes(event.target.tagName) && event.target.id !== "slider";
    if (typing || event.ctrlKey || event.metaKey || event.altKey || !KEYS[event.key]) return;
    if (event.key === " " && event.target.tagName === "BUTTON") return;
    event.preventDefault();
    KEYS[event.key]();
  });
  byId("slider").addEventListener("input", () => choose(now.series, Number(byId("slider").value)));
  byId("series").addEventListener("change", () => choose(Number(byId("series").value), 0));
  byId("back").addEventListener("click", KEYS.ArrowLeft);
  byId("on").addEventListener("click", KEYS.ArrowRight);
  byId("play").addEventListener("click", play);
  for (const id of ["axis-x", "axis-y", "colour", "names"])
    byId(id).addEventListener("change", () => { drawDiagram(); keep(); });
  for (const id of ["body-colour", "scale", "view", "edges", "arrows", "before", "obstacles",
    "surface", "face-colour"])
    byId(id).addEventListener("change", () => { redraw(); keep(); });
  document.querySelectorAll(".tabs button").forEach((button) => button.addEventListener("click",
    () => {
      now.tab = button.dataset.tab;
      if (now.tab === "solutions") now.gamma = valueNow("gamma");
      drawTab();
      keep();
    }));
  byId("help").addEventListener("click", () => say(byId("message").textContent ? "" : HELP));
  listenToTable();
}

// -- what is chosen stands in the address, so that a page that is loaded anew shows the same -----------

const KEPT = ["axis-x", "axis-y", "colour", "body-colour", "scale", "view", "surface", "face-colour"];

function keep() {
  const last = now.index === META.series[now.series].count - 1;
  const words = { series: now.series, index: last ? -1 : now.index, share: now.share, tab: now.tab,
    gamma: now.gamma };
  for (const id of KEPT) words[id] = byId(id).value;
  try {
    history.replaceState(null, "", "#" + new URLSearchParams(words));
  } catch { /* a page within another one may have no address of its own */ }
}

function kept() {
  const words = new URLSearchParams(location.hash.slice(1));
  for (const id of KEPT) {
    const value = words.get(id);
    const select = byId(id);
    const known = select.tagName !== "SELECT" || [...select.options].some((o) => o.value === value);
    if (value !== null && known) select.value = value;
  }
  if (["points", "values", "solutions"].includes(words.get("tab"))) now.tab = words.get("tab");
  if (words.get("gamma") !== null) now.gamma = Number(words.get("gamma")) || 0;
  const index = Number(words.get("index"));
  return words.has("series") ? [Number(words.get("series")) || 0, index < 0 ? Infinity : index,
    Number(words.get("share")) || 0] : null;
}

// -- the beginning -------------------------------------------------------------------------------------

function say(text) {
  byId("message").textContent = text;
}

async function loadLibrary() {
  const text = new TextDecoder().decode(await inflate("library"));
  const script = document.createElement("script");
  script.textContent = text;
  document.head.append(script);
}

function head() {
  byId("title").textContent = META.title;
  byId("about").textContent = META.about;
  byId("notes").replaceChildren(...META.notes.map((note) => element("p", note)));
}

function controls() {
  const columns = META.columns.map((c) => [c.name, c.label]);
  options(byId("axis-x"), columns, META.axes[0]);
  options(byId("axis-y"), columns, META.axes[1]);
  const stable = META.columns.some((c) => c.name === STABILITY);
  options(byId("colour"), [[SERIES, META.along === "gamma" ? "branch" : "one colour"],
    ["status", "status"], ...columns], stable ? STABILITY : META.series.length > 1 ? SERIES : "status");
  options(byId("series"), META.series.map((s, i) => [String(i), s.name]), "0");
  byId("series").hidden = META.series.length < 2;
  document.querySelector('[data-tab="solutions"]').hidden = !META.columns.some(
    (c) => c.name === "gamma");
  if (!META.body) return;
  const axes = ["x", "y", "z"].slice(0, META.body.dim).map((c) => ["u" + c, "u_" + c]);
  const others = Object.entries(META.fields).filter(([name]) => name !== "displacement")
    .map(([name, field]) => [name, field.label]);
  options(byId("body-colour"), [["displacement", "|u|"], ...axes, ...others, ["none", "none"]]);
  options(byId("view"), Object.keys(VIEWS).map((name) => [name, name]));
  byId("view-label").hidden = META.body.dim === 2;
  byId("obstacles-label").hidden = !META.surfaces.some((face) => face.obstacle);
  byId("scale").value = String(META.body.scale);
  options(byId("surface"), META.surfaces.map((face, i) => [String(i), face.name]));
  const first = META.surfaces[0];
  const shown = first ? Object.keys(first.ranges) : [];
  options(byId("face-colour"), [["status", "status"], ...shown.map((name) => [name,
    TITLES[name] || name.replace("internal.", "")]), ["none", "none"]]);
}

/** Where a page begins: a branch where tractions are largest, histories and paths at their end. */
function first() {
  if (META.along !== "gamma") return [0, Infinity];
  if (!META.body) return [0, 0];
  const at = diagram.states.indexOf(META.body.start);
  const series = META.series.findIndex((s) => s.first <= at && at < s.first + s.count);
  return series < 0 ? [0, 0] : [series, at - META.series[series].first];
}

async function begin() {
  head();
  await loadLibrary();
  diagram.columns = await array("columns");
  META.columns.forEach(withoutRoundOff);
  diagram.words = (await array("words")).split("\n");
  diagram.states = await array("states");
  if (META.body) await prepareBody();
  else { byId("main").classList.add("no-body"); now.tab = "values"; }
  document.querySelector('[data-tab="points"]').hidden = !META.body;
  controls();
  const before = kept();
  byId("main").hidden = false;
  listen();
  [now.series, now.index] = before ? [Math.min(before[0], META.series.length - 1), 0] : [0, 0];
  await drawDiagram();
  await choose(...(before || first()));
  say("");
  document.body.dataset.ready = "true";
}

if (typeof DecompressionStream === "undefined") {
  say("This browser cannot unpack the page: it needs DecompressionStream, which browsers have " +
    "since 2023.");
} else {
  begin().catch((error) => { say(`The page cannot be shown: ${error.message}`); throw error; });
}

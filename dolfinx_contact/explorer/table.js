// Tables: of contact points, of what is known of a point, of solutions at a gamma.
"use strict";

const MOST_ROWS = 400;
const sorting = { column: 0, down: false, all: false };

/** Definitions of the columns, as in the guide. */
function keysOfTable() {
  const sign = META.body.dim === 2
    ? "; ut, shear and rt along t = (−n<sub>y</sub>, n<sub>x</sub>), n from the body into the obstacle"
    : "; ut, shear and rt are magnitudes";
  return "un: gap ≥ 0; ut: slip; rn: normal force, ≥ 0 in compression; " +
    `rt: tangential force on the body, opposed to ut${sign}.`;
}

/** Head and rows of the table of contact points. */
function contactRows(face, table) {
  const dim = META.body.dim;
  const bounded = face.ranges.bound[1] > 0;
  const names = ["", ..."xyz".slice(0, dim), "status", "un", "ut", "pressure", "shear",
    ...(bounded ? ["bound"] : []), "rn", "rt"];
  const more = Object.keys(table).filter((name) => name.startsWith("internal.") || name === "slid");
  const found = [];
  for (let i = 0; i < face.points; i++) {
    const along = (name) => tangential(face, table, name, i);
    const place = Array.from(table.x.subarray(dim * i, dim * (i + 1)));
    const status = String.fromCharCode(table.letters[i]);
    found.push([i, ...place, status, table.un[i], along("ut"), table.pressure[i], along("shear"),
      ...(bounded ? [table.bound[i]] : []), table.pressure[i] * table.area[i], along("shear") * table.area[i],
      ...more.map((name) => table[name][i])]);
  }
  const scales = [...names, ...more].map((name) => scaleOf(face, name));
  return { names: [...names, ...more], rows: found, status: dim + 1, scales };
}

async function drawPoints() {
  const target = byId("points");
  const state = stateNow();
  const face = faceNow();
  const table = !state || !face ? null : await tableAt(face, state);
  if (!table) {
    target.replaceChildren(element("p", "No contact points were recorded here.", "nothing"));
    return;
  }
  const { names, rows: found, status, scales } = contactRows(face, table);
  const by = sorting.column;
  const order = (a, b) => (typeof a === "string" ? a.localeCompare(b)
    : (Number.isNaN(a) ? Infinity : a) - (Number.isNaN(b) ? Infinity : b));
  found.sort((a, b) => (sorting.down ? -1 : 1) * order(a[by], b[by]) || a[0] - b[0]);
  const shown = sorting.all ? found : found.slice(0, MOST_ROWS);
  const made = element("table");
  made.createCaption().innerHTML = keysOfTable();
  const head = made.createTHead().insertRow();
  names.forEach((name, i) => {
    const mark = i === by ? (sorting.down ? " ▾" : " ▴") : "";
    const shownName = name === "bound" ? TITLES.bound : name.replace("internal.", "");
    const cell = element("th", (i === 0 ? "#" : withUnit(shownName, UNITS[name])) + mark,
      i === status ? "words" : "");
    cell.dataset.column = i;
    cell.title = TITLES[name] || "";
    head.append(cell);
  });
  const rowsOf = made.createTBody();
  for (const row of shown) {
    const line = rowsOf.insertRow();
    line.dataset.row = row[0];
    if (row[0] === now.point && faceNow() === META.surfaces[now.surface]) line.className = "chosen";
    row.forEach((value, i) => {
      const cell = line.insertCell();
      if (i === status) {
        const key = element("span", "", "key");
        key.style.background = statusOf(value).colour;
        cell.className = "words";
        cell.append(key, statusOf(value).name);
      } else {
        cell.textContent = written(value, 4, scales[i]);
        if (typeof value === "number" && i > 0) cell.title = String(value);
      }
    });
  }
  const parts = [made];
  if (shown.length < found.length) {
    const button = element("button", `show all ${found.length} points`);
    button.addEventListener("click", () => { sorting.all = true; drawPoints(); });
    parts.push(button);
  }
  target.replaceChildren(...parts);
  target.querySelector("tr.chosen")?.scrollIntoView({ block: "nearest" });
}

function listenToTable() {
  byId("points").addEventListener("click", (event) => {
    const head = event.target.closest("th[data-column]");
    const row = event.target.closest("tr[data-row]");
    if (head) {
      const by = Number(head.dataset.column);
      sorting.down = by === sorting.column ? !sorting.down : false;
      sorting.column = by;
      drawPoints();
    } else if (row) pick(META.surfaces.indexOf(faceNow()), Number(row.dataset.row));
  });
}

/** Values at the selected place. */
function drawValues() {
  const s = META.series[now.series];
  const made = element("table");
  const add = (name, value) => {
    const row = made.insertRow();
    row.append(element("td", name, "words"), element("td", value));
  };
  add("place", placeInWords(now.series, now.index, now.share));
  for (const { name } of META.columns) add(label(name), writtenOf(name, valueNow(name), 10));
  const parts = [made];
  const here = now.share ? [] : s.marks.filter((mark) => mark.index === now.index);
  for (const mark of here) parts.unshift(element("p", `${mark.kind}: ${mark.text}`));
  if (now.share) parts.unshift(element("p", "The branch is piecewise linear: the displacement, the " +
    "tractions and the gaps between two of its points are interpolated exactly, other values linearly."));
  const word = wordNow();
  parts.push(element("p", runs(word)), element("code", word.length > 600 ? word.slice(0, 600) + "…" : word));
  if (!now.share && now.index === s.count - 1 && s.ending) parts.push(element("p", `Here it ends: ${s.ending}`));
  byId("values").replaceChildren(...parts);
}

/** Where series cross a gamma: series, the point next to it, and columns between two points. */
function crossings(gamma) {
  const found = [];
  const values = column("gamma");
  META.series.forEach((s, number) => {
    for (let i = 0; i < s.count; i++) {
      const at = s.first + i;
      const here = values[at];
      if (i + 1 < s.count) {
        const next = values[at + 1];
        if ((here < gamma && gamma < next) || (next < gamma && gamma < here)) {
          const share = (gamma - here) / (next - here);
          found.push({ series: number, index: share < 0.5 ? i : i + 1, share, from: i });
        }
      }
      // A stretch of points at this gamma counts once.
      if (here === gamma && !(i > 0 && values[at - 1] === gamma))
        found.push({ series: number, index: i, share: 0, from: i });
    }
  });
  return found;
}

/** The list at a gamma. Its head stays when the list is drawn anew, so that one can go on typing. */
function drawSolutions() {
  const target = byId("solutions");
  if (!byId("gamma")) {
    const input = element("input");
    Object.assign(input, { type: "number", step: "any", id: "gamma" });
    const to = (gamma) => {
      now.gamma = gamma;
      drawSolutions();
      keep();
    };
    input.addEventListener("change", () => { if (input.value !== "") to(Number(input.value)); });
    const here = element("button", "at this point");
    here.type = "button";
    here.addEventListener("click", () => to(valueNow("gamma")));
    const row = element("p");
    row.append(element("span", `Solutions at ${label("gamma")} = `), input, " ", here);
    if (META.counts.length) row.append(element("span", " counted at: "));
    for (const { gamma } of META.counts) {
      const button = element("button", written(gamma), "counted");
      button.type = "button";
      button.addEventListener("click", () => to(gamma));
      row.append(button, " ");
    }
    target.replaceChildren(row, element("div"));
  }
  const typing = document.activeElement === byId("gamma");
  if (!typing) byId("gamma").value = now.gamma;
  const columns = META.columns.filter((c) => c.functional).slice(0, 4);
  const gamma = now.gamma;
  const found = crossings(gamma);
  const parts = [verdict(gamma, found.length)];
  if (found.length) {
    const made = element("table");
    const head = made.createTHead().insertRow();
    for (const name of ["#", "branch"]) head.append(element("th", name, "words"));
    for (const c of columns) head.append(element("th", c.label));
    head.append(element("th", "statuses", "words"));
    const lines = made.createTBody();
    found.forEach((one, i) => {
      const s = META.series[one.series];
      const line = lines.insertRow();
      line.dataset.row = i;
      line.append(element("td", String(i + 1), "words"), element("td", s.name, "words"));
      for (const { name } of columns) {
        const low = valueAt(one.series, one.from, name);
        const high = one.share ? valueAt(one.series, one.from + 1, name) : low;
        line.append(element("td", writtenOf(name, low + one.share * (high - low))));
      }
      line.append(element("td", runs(diagram.words[s.first + one.index]), "words long"));
      line.addEventListener("click", () => choose(one.series, one.from, one.share));
    });
    parts.push(made);
  }
  parts.push(element("p", "Values between two points of a branch are interpolated. A click goes to " +
    "the solution on piecewise linear branches, otherwise to the nearer point."));
  target.lastElementChild.replaceChildren(...parts);
}

/** What is proved, or not, of the number of solutions at gamma. */
function verdict(gamma, crossed) {
  const size = Math.max(Math.abs(gamma), ...META.counts.map((count) => Math.abs(count.gamma)));
  const near = (count) => Math.abs(count.gamma - gamma) <= 1e-9 * size;
  const count = META.counts.find(near);
  if (count && count.proved) {
    const line = element("p", `${many(count.count)}, proved`, "proved");
    line.append(element("span", ` (${count.method || "no others exist"})`, ""));
    return line;
  }
  if (count) {
    return element("p", `at least ${many(count.count)}; that there are no others is not proved ` +
      `(${count.method || "no proof"})`, "open");
  }
  return element("p", `${many(crossed)} on the recorded branches; no proof was given that there ` +
    "are no others", "open");
}

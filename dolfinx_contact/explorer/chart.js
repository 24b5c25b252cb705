// A chart of two parameters: exact curves, and the regions between them, filled and numbered.
"use strict";

function regionWords(region) {
  const counts = [...new Set(region.solutions.map((s) => s.length))].sort((a, b) => a - b);
  const words = counts.map(String).join(" or ");
  const said = counts.length === 1 ? many(counts[0]) : `${words} solutions`;
  return region.proved ? `${said}, proved` : `${said}, at least`;
}

async function drawChart() {
  const chart = META.chart;
  const data = [];
  const seen = new Set();
  for (const region of chart.regions) {
    const x = [], y = [];
    for (const outline of region.outlines) {
      for (const [a, b] of outline) { x.push(a); y.push(b); }
      x.push(outline[0][0], null); y.push(outline[0][1], null);
    }
    const count = region.solutions[0].length;
    const colour = FILLS[count % FILLS.length];
    data.push({ type: "scatter", mode: "lines", x, y, fill: "toself", fillcolor: colour,
      line: { color: colour, width: 0.8 }, hoverinfo: "skip", name: many(count),
      legendgroup: String(count), showlegend: !seen.has(count), legendrank: 100 + count });
    seen.add(count);
  }
  const look = { fold: { color: "#1f2933", width: 2.4 }, event: { color: "#7b8794", width: 1 } };
  const named = new Set();
  for (const curve of chart.curves) {
    data.push({ type: "scatter", mode: "lines", x: curve.points.map((p) => p[0]),
      y: curve.points.map((p) => p[1]), line: look[curve.kind], hoverinfo: "skip",
      name: curve.kind === "fold" ? "folds" : "events", legendgroup: curve.kind,
      showlegend: !named.has(curve.kind), legendrank: 1 });
    named.add(curve.kind);
  }
  const cells = chart.cells;
  data.push({ type: "scatter", mode: "markers", x: cells.map((c) => c.middle[0]),
    y: cells.map((c) => c.middle[1]), name: "places looked at", customdata: cells.map((_, i) => i),
    text: cells.map((c) => `${written(c.middle[0])}, ${written(c.middle[1])}<br>` +
      `${many(c.solutions.length)}${c.proved ? ", proved" : ", at least"}`),
    hovertemplate: "%{text}<extra></extra>",
    marker: { size: 4, color: "rgba(31,41,51,0.30)", symbol: cells.map((c) => (c.proved
      ? "circle" : "x")) } });
  data.push({ type: "scatter", mode: "markers", x: [null], y: [null], hoverinfo: "skip",
    showlegend: false, marker: { symbol: "circle-open", size: 15, color: "#c0392b",
      line: { width: 2.5 } } });
  const annotations = chart.regions.map((region) => ({ x: region.place[0], y: region.place[1],
    text: `<b>${region.number}</b>  ${plain(regionWords(region))}`, showarrow: false,
    bgcolor: "rgba(255,255,255,0.82)", borderpad: 3, font: { size: 12 } }));
  const [across, up] = chart.ranges;
  await Plotly.react("chart", data, plainLayout({
    xaxis: axis(label("mu"), { range: across, showgrid: false, zeroline: false }),
    yaxis: axis(label("gamma"), { range: up, showgrid: false, zeroline: false }),
    annotations, hoverdistance: 40, legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 },
    margin: { l: 64, r: 16, t: 54, b: 50 },
  }), CONFIG);
  byId("chart").on("plotly_click", (event) => {
    const point = event.points.find((p) => p.customdata !== undefined);
    if (point) drawCell(point.customdata, data.length - 1);
  });
  drawCell(null);
}

/** Side panel: the regions, and the solutions at the place that was clicked. */
function drawCell(number, ring) {
  const chart = META.chart;
  const parts = [];
  if (number !== null) {
    const cell = chart.cells[number];
    Plotly.restyle("chart", { x: [[cell.middle[0]]], y: [[cell.middle[1]]] }, [ring]);
    const place = `${label("mu")} = ${written(cell.middle[0])}, ${label("gamma")} = ` +
      written(cell.middle[1]);
    parts.push(element("h3", place), cell.proved
      ? element("p", `${many(cell.solutions.length)}, proved`, "proved")
      : element("p", `at least ${many(cell.solutions.length)}: not decided`, "open"));
    const made = element("table");
    cell.solutions.forEach((word, i) => {
      const row = made.insertRow();
      row.append(element("td", String(i + 1), "words"), element("td", runs(word), "words"));
      const last = row.insertCell();
      last.append(element("code", word));
    });
    parts.push(made);
  } else parts.push(element("p", "A click on a place lists its solutions."));
  parts.push(element("h3", "Regions"));
  const made = element("table");
  for (const region of chart.regions) {
    const row = made.insertRow();
    const key = element("span", "", "key");
    key.style.background = FILLS[region.solutions[0].length % FILLS.length];
    const first = element("td", "", "words");
    first.append(key, `${region.number}`);
    row.append(first, element("td", regionWords(region), region.proved ? "words proved" : "words open"),
      element("td", `${region.looked} place${region.looked === 1 ? "" : "s"} looked at`, "words"));
  }
  parts.push(made, element("p", "What is proved holds at the places that were looked at; that " +
    "nothing changes between curves is not."));
  byId("chart-side").replaceChildren(...parts);
}

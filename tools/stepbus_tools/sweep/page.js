"use strict";
// The charts of a sweep's page. `sweep`: {axes, metrics, units, extremes: run → best or worst,
// columns: name → values, run, failed}.
const dark = matchMedia("(prefers-color-scheme: dark)");
const style = getComputedStyle(document.documentElement);
const shade = (name) => style.getPropertyValue(name).trim();
const at = (id) => document.getElementById(id);
// A metric or axis as it is named beside a chart: with its unit, where it has one.
const named = (name) => (sweep.units[name] ? `${name} [${sweep.units[name]}]` : name);
// It breaks behind its dots, where there is little room.
const broken = (name) => name.replaceAll(".", ".\u200b");
const numeric = (values) => values.every((v) => v === null || typeof v === "number");

function layout(more) {
  const ink = shade("--ink"), line = shade("--line");
  const axis = { gridcolor: line, zerolinecolor: line, automargin: true };
  const { xaxis, yaxis, ...rest } = more;
  return { margin: { t: 30, r: 15, b: 45, l: 60 }, paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)", font: { color: ink }, hovermode: "closest",
    xaxis: { ...axis, ...xaxis }, yaxis: { ...axis, ...yaxis }, ...rest };
}

const draw = (place, traces, more) =>
  Plotly.react(place, traces, layout(more), { responsive: true, displaylogo: false, displayModeBar: false });

const chart = () => Object.assign(document.createElement("div"), { className: "chart" });

function fill(select, names, chosen) {
  select.replaceChildren(...names.map((name) => new Option(name, name, false, name === chosen)));
}

// The rows that have a number in all of some columns.
function rows(...names) {
  return sweep.run.map((_, i) => i).filter((i) =>
    names.every((name) => typeof sweep.columns[name][i] === "number"));
}

const shown = (value) => (typeof value === "number" ? Number(value.toPrecision(5)) : value ?? "–");
const MOST_TICKS = 8;

// The values of an axis that were run, in order, each once.
const order = (name) => [...new Set(sweep.columns[name])].sort((a, b) => (a > b) - (a < b));

// Ticks at the values that were run, where they are few numbers.
function ticks(name) {
  const values = order(name).filter((value) => typeof value === "number");
  if (!values.length || values.length > MOST_TICKS || !numeric(sweep.columns[name])) return {};
  return { tickvals: values, ticktext: values.map((value) => String(shown(value))) };
}

function drawAxes(metric) {
  const places = sweep.axes.map(() => chart());
  at("axes").replaceChildren(...places);
  const values = sweep.columns[metric];
  for (const [index, name] of sweep.axes.entries()) {
    const place = places[index];
    const kept = rows(metric);
    const trace = { x: kept.map((i) => sweep.columns[name][i]), y: kept.map((i) => values[i]),
      text: kept.map((i) => `run ${sweep.run[i]}${sweep.failed[i] ? ", failed" : ""}`),
      mode: "markers", type: "scatter",
      marker: { size: 9, opacity: 0.8,
        color: kept.map((i) => shade(sweep.failed[i] ? "--bad" : "--c0")),
        symbol: kept.map((i) => (sweep.failed[i] ? "x" : "circle")) } };
    const log = sweep.logarithmic.includes(name) ? "log" : undefined;
    const type = numeric(sweep.columns[name]) ? log : "category";
    draw(place, [trace], { xaxis: { title: { text: named(name) }, type, ...ticks(name) }, yaxis: { title: { text: named(metric) } } });
  }
}

// Two axes: the metric as colour, the mean where several runs fall together.
function drawPair(metric) {
  at("pair").replaceChildren();
  if (sweep.axes.length !== 2) return;
  const place = chart();
  at("pair").append(place);
  const [x, y] = sweep.axes, kept = rows(metric);
  const many = new Set(sweep.columns[x]).size * new Set(sweep.columns[y]).size > 2 * sweep.run.length;
  const color = { colorscale: "Viridis", colorbar: { title: { text: named(metric) } } };
  const traces = many
    ? [{ type: "scatter", mode: "markers", x: kept.map((i) => sweep.columns[x][i]),
        y: kept.map((i) => sweep.columns[y][i]), text: kept.map((i) => `run ${sweep.run[i]}`),
        marker: { ...color, size: 9, color: kept.map((i) => sweep.columns[metric][i]) } }]
    : [grid(x, y, metric, kept, color)];
  const type = many ? undefined : "category";
  draw(place, traces, { xaxis: { title: { text: named(x) }, type }, yaxis: { title: { text: named(y) }, type } });
}

function grid(x, y, metric, kept, color) {
  const xs = order(x), ys = order(y), word = (value) => String(shown(value));
  const sums = ys.map(() => xs.map(() => [0, 0]));
  for (const i of kept) {
    const cell = sums[ys.indexOf(sweep.columns[y][i])][xs.indexOf(sweep.columns[x][i])];
    cell[0] += sweep.columns[metric][i];
    cell[1] += 1;
  }
  const z = sums.map((row) => row.map(([sum, count]) => (count ? sum / count : null)));
  return { type: "heatmap", x: xs.map(word), y: ys.map(word), z, ...color };
}

function drawParallel(metric) {
  at("parallel").replaceChildren();
  if (sweep.axes.length < 3) return;
  const place = chart();
  at("parallel").append(place);
  const kept = rows(metric);
  const dimensions = [...sweep.axes, metric].map((name) => dimension(name, kept));
  const line = { color: kept.map((i) => sweep.columns[metric][i]), colorscale: "Viridis",
    showscale: true };
  draw(place, [{ type: "parcoords", dimensions, line }], { margin: { t: 60, r: 40, b: 20, l: 60 } });
}

function dimension(name, kept) {
  const values = kept.map((i) => sweep.columns[name][i]);
  if (numeric(values)) return { label: name, values, ...ticks(name) };
  const words = [...new Set(values.map(String))];
  return { label: name, values: values.map((v) => words.indexOf(String(v))),
    tickvals: words.map((_, i) => i), ticktext: words };
}

function drawFront() {
  const [x, y] = [at("first").value, at("second").value], kept = rows(x, y);
  const better = at("better").selectedIndex;
  const signs = [better === 0 || better === 1 ? 1 : -1, better === 0 || better === 2 ? 1 : -1];
  const points = kept.map((i) => [sweep.columns[x][i], sweep.columns[y][i], sweep.run[i]]);
  const sorted = [...points].sort((a, b) => signs[0] * (a[0] - b[0]) || signs[1] * (a[1] - b[1]));
  let best = Infinity;
  const front = sorted.filter((p) => signs[1] * p[1] < best && ((best = signs[1] * p[1]), true));
  const trace = (found, more) => ({ x: found.map((p) => p[0]), y: found.map((p) => p[1]),
    text: found.map((p) => `run ${p[2]}`), type: "scatter", ...more });
  draw(at("front"), [
    trace(points, { mode: "markers", name: "runs", marker: { opacity: 0.5, color: shade("--soft") } }),
    trace(front, { mode: "lines+markers", name: "Pareto front", line: { color: shade("--c1") } }),
  ], { xaxis: { title: { text: named(x) } }, yaxis: { title: { text: named(y) } }, legend: { orientation: "h", x: 0, y: 1, yanchor: "bottom" } });
}

function drawExtremes(metric) {
  const kept = rows(metric).sort((a, b) => sweep.columns[metric][a] - sweep.columns[metric][b]);
  const chosen = kept.length > 10 ? [...kept.slice(0, 5), ...kept.slice(-5)] : kept;
  const table = document.createElement("table"), head = table.insertRow();
  for (const name of ["run", ...sweep.axes, metric]) {
    head.append(Object.assign(document.createElement("th"), { textContent: broken(named(name)) }));
  }
  for (const i of chosen) {
    const row = table.insertRow();
    row.className = (metric === sweep.metric && sweep.extremes[sweep.run[i]]) || "";
    for (const value of [sweep.run[i], ...[...sweep.axes, metric].map((n) => sweep.columns[n][i])]) {
      row.insertCell().textContent = shown(value);
    }
  }
  table.tabIndex = 0;
  at("extremes").replaceChildren(table);
}

function drawMetric() {
  const metric = at("metric").value;
  for (const show of [drawAxes, drawPair, drawParallel, drawExtremes]) show(metric);
}

fill(at("metric"), sweep.metrics, sweep.metric);
fill(at("first"), sweep.metrics, sweep.metric);
const changes = (name) => new Set(sweep.columns[name]).size > 1;
const other = sweep.metrics.find((m) => !m.startsWith(sweep.metric) && m !== "success" && changes(m));
fill(at("second"), sweep.metrics, other ?? sweep.metric);
at("metric").onchange = drawMetric;
for (const id of ["first", "second", "better"]) at(id).onchange = drawFront;
const drawAll = () => (drawMetric(), drawFront());
dark.onchange = drawAll;
// Paper is narrower than a screen, and a chart has pixels: those of A4 without its margins.
const resized = (size) => () => {
  for (const place of document.querySelectorAll(".chart")) Plotly.relayout(place, size);
};
addEventListener("beforeprint", resized({ width: 680, height: 300 }));
addEventListener("afterprint", resized({ width: null, height: null, autosize: true }));
if (sweep.metrics.length) drawAll();

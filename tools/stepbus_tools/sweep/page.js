"use strict";
// The charts of a sweep's page. `sweep`: {axes, metrics, units, extremes: run → best or worst,
// columns: name → values, run, failed}.
const style = getComputedStyle(document.documentElement);
const shade = (name) => style.getPropertyValue(name).trim();
const at = (id) => document.getElementById(id);
// A metric or axis as it is named beside a chart: with its unit, where it has one.
const named = (name) => (sweep.units[name] ? `${name} [${sweep.units[name]}]` : name);
// It breaks after its dots, where there is little room.
const broken = (name) => name.replaceAll(".", ".\u200b");
const numeric = (values) => values.every((v) => v === null || typeof v === "number");
const shown = (value) => (typeof value === "number" ? Number(value.toPrecision(5)) : value ?? "–");
const node = (tag, className, text = "") =>
  Object.assign(document.createElement(tag), { className, textContent: text });

function fill(select, names, chosen) {
  select.replaceChildren(...names.map((name) => new Option(name, name, false, name === chosen)));
}

// The rows that have a number in all of some columns.
function rows(...names) {
  return sweep.run.map((_, i) => i).filter((i) =>
    names.every((name) => typeof sweep.columns[name][i] === "number"));
}

// Different values: numbers in order, words as they came.
const order = (values) => (numeric(values) ? [...new Set(values)].sort((a, b) => a - b) : [...new Set(values)]);
const reach = (values) => values.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity]);
const MOST_TICKS = 8;

// An axis of a chart: where values stand on it, and its ticks: at all values, where they are few.
function axis(name, kept, { words = !numeric(sweep.columns[name]), few = true } = {}) {
  const values = order(kept.map((i) => sweep.columns[name][i]));
  const place = (value) => (words ? values.indexOf(value) : value);
  const [low, high] = reach(values.map(place));
  const log = !words && sweep.logarithmic.includes(name);
  const room = words ? 0.5 : 0.06 * (high - low) || 0.1 * Math.abs(high) || 1;
  const ticks = values.length <= MOST_TICKS && few ? values.map(place) : words ? values.map(place) : null;
  return { title: named(name), place: (i) => place(sweep.columns[name][i]), log, ticks,
    range: log ? [low / 1.3, high * 1.3] : [low - room, high + room],
    text: (tick) => String(shown(words ? values[tick] : tick)) };
}

const FONT = "12px sans-serif";
let printed = null; // [width, height] of all charts on paper

// Draws shapes over two axes: {x, y, text, color, form: circle, cross, cell or label}, and lines
// through points: {points, color}. What the mouse is at is said below.
function draw(place, x, y, shapes, lines = []) {
  const grid = { stroke: shade("--line"), width: 1 };
  const look = (one) => ({ label: one.title, stroke: shade("--ink"), font: FONT, labelFont: FONT,
    labelSize: 20, grid, ticks: grid,
    ...(one.ticks && { splits: () => one.ticks, values: (_, ticks) => ticks.map(one.text) }) });
  const width = (_, texts) => 20 + 7 * Math.max(2, ...(texts || []).map((t) => String(t).length));
  const tip = node("p", "tip", "\u00a0");
  const paint = (u) => {
    const { ctx, bbox } = u, dot = devicePixelRatio;
    const to = (a, b) => [u.valToPos(a, "x", true), u.valToPos(b, "y", true)];
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    for (const { points, color } of lines) {
      ctx.beginPath();
      points.forEach((point) => ctx.lineTo(...to(...point)));
      Object.assign(ctx, { strokeStyle: color, lineWidth: 1.5 * dot }).stroke();
    }
    for (const { x: a, y: b, text, color, form } of shapes) {
      const [left, top] = to(a, b), size = 4.5 * dot;
      ctx.fillStyle = ctx.strokeStyle = color;
      ctx.beginPath();
      if (form === "cell") {
        const [first, second] = [to(a - 0.5, b + 0.5), to(a + 0.5, b - 0.5)];
        ctx.fillRect(...first, second[0] - first[0], second[1] - first[1]);
      } else if (form === "cross") {
        for (const sign of [-1, 1]) {
          ctx.moveTo(left - size, top - sign * size);
          ctx.lineTo(left + size, top + sign * size);
        }
        Object.assign(ctx, { lineWidth: 2.5 * dot }).stroke();
      } else if (form === "label") {
        Object.assign(ctx, { font: `${11 * dot}px sans-serif`, textAlign: "right", textBaseline: "middle",
          strokeStyle: shade("--paper"), lineWidth: 4 * dot });
        ctx.strokeText(text, left - 1.6 * size, top);
        ctx.fillText(text, left - 1.6 * size, top);
      } else {
        ctx.arc(left, top, size, 0, 2 * Math.PI);
        ctx.fill();
      }
    }
    ctx.restore();
  };
  const point = (u) => {
    const far = (one) => Math.hypot(u.valToPos(one.x, "x") - u.cursor.left, u.valToPos(one.y, "y") - u.cursor.top);
    const cell = (one) => one.form === "cell" && Math.abs(u.posToVal(u.cursor.left, "x") - one.x) < 0.5
      && Math.abs(u.posToVal(u.cursor.top, "y") - one.y) < 0.5;
    const found = shapes.filter((one) => one.form !== "label" && (cell(one) || far(one) < 8)).sort((a, b) => far(a) - far(b));
    tip.textContent = found.length ? found[0].text : "\u00a0";
  };
  place.replaceChildren();
  new uPlot({
    width: printed ? printed[0] : place.clientWidth,
    height: printed ? printed[1] : place.clientHeight - 56,
    scales: { x: { time: false, distr: x.log ? 3 : 1, range: x.range }, y: { range: y.range } },
    axes: [look(x), { ...look(y), size: width, show: !y.hidden }],
    series: [{}, {}],
    legend: { show: false },
    cursor: { drag: { x: false, y: false }, points: { show: false } },
    hooks: { draw: [paint], setCursor: [point] },
  }, [x.range, [null, null]], place);
  place.append(tip);
}

function charts(id, count) {
  const places = Array.from({ length: count }, () => node("div", "chart"));
  at(id).replaceChildren(...places);
  return places;
}

const run = (i) => `run ${sweep.run[i]}${sweep.failed[i] ? ", failed" : ""}`;
const told = (i, ...names) => [run(i), ...names.map((n) => `${n} ${shown(sweep.columns[n][i])}`)].join(", ");

function drawAxes(metric) {
  const places = charts("axes", sweep.axes.length), kept = rows(metric);
  const y = axis(metric, kept, { few: false });
  for (const [index, name] of sweep.axes.entries()) {
    const x = axis(name, kept);
    draw(places[index], x, y, kept.map((i) => ({ x: x.place(i), y: y.place(i), text: told(i, name, metric),
      color: shade(sweep.failed[i] ? "--bad" : "--c0"), form: sweep.failed[i] ? "cross" : "circle" })));
  }
}

// From violet for the least to yellow for the largest, as Viridis of matplotlib.
const VIRIDIS = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
function heat(share) {
  const place = Math.min(0.9999, Math.max(0, share || 0)) * (VIRIDIS.length - 1), i = Math.floor(place);
  return `rgb(${VIRIDIS[i].map((c, k) => Math.round(c + (place - i) * (VIRIDIS[i + 1][k] - c))).join()})`;
}

// What the colours of a metric's values are, and a line that says so.
function colors(metric, values) {
  const [low, high] = reach(values);
  const key = node("p", "key"), bar = node("i", "");
  bar.style.background = `linear-gradient(90deg, ${VIRIDIS.map((c) => `rgb(${c.join()})`).join()})`;
  key.append(`${named(metric)}: ${shown(low)} `, bar, ` ${shown(high)}`);
  return [(value) => heat((value - low) / (high - low)), key];
}

// Two axes: the metric as colour, the mean where several runs fall together.
function drawPair(metric) {
  if (sweep.axes.length !== 2) return;
  const kept = rows(metric), [first, second] = sweep.axes, [place] = charts("pair", 1);
  const count = (name) => new Set(sweep.columns[name]).size;
  const many = count(first) * count(second) > 2 * sweep.run.length;
  const [x, y] = many ? [axis(first, kept), axis(second, kept)]
    : [axis(first, kept, { words: true }), axis(second, kept, { words: true })];
  const cells = new Map();
  for (const i of kept) {
    const key = many ? i : `${x.place(i)},${y.place(i)}`;
    cells.set(key, [...(cells.get(key) ?? []), i]);
  }
  const mean = (found) => found.reduce((sum, i) => sum + sweep.columns[metric][i], 0) / found.length;
  const all = [...cells.values()], [color, key] = colors(metric, all.map(mean));
  draw(place, x, y, all.map((found) => ({ x: x.place(found[0]), y: y.place(found[0]), color: color(mean(found)),
    form: many ? "circle" : "cell", text: many ? told(found[0], first, second, metric)
      : `${first} ${x.text(x.place(found[0]))}, ${second} ${y.text(y.place(found[0]))}: ${metric} ${shown(mean(found))}` })));
  at("pair").append(key);
}

// Three axes or more: a line for each run, through all of its values.
function drawParallel(metric) {
  if (sweep.axes.length < 3) return;
  const kept = rows(metric), [place] = charts("parallel", 1), names = [...sweep.axes, metric];
  const sides = names.map((name) => axis(name, kept));
  const height = (side, place) => (place - side.range[0]) / (side.range[1] - side.range[0]);
  const share = (side, i) => height(side, side.place(i));
  const [color, key] = colors(metric, kept.map((i) => sweep.columns[metric][i]));
  const lines = kept.map((i) => ({ points: sides.map((side, n) => [n, share(side, i)]),
    color: color(sweep.columns[metric][i]) }));
  const ends = kept.flatMap((i) => sides.map((side, n) => ({ x: n, y: share(side, i), text: told(i, ...names),
    color: color(sweep.columns[metric][i]), form: "circle" })));
  const labels = sides.flatMap((side, n) => (side.ticks ?? reach(kept.map(side.place))).map((tick) => ({ x: n,
    y: height(side, tick), text: side.text(tick), color: shade("--ink"), form: "label" })));
  const isWide = place.clientWidth > 160 * names.length;
  const x = { range: [-0.45, names.length - 0.5], ticks: names.map((_, n) => n),
    text: (n) => (isWide ? names[n] : names[n].split(".").pop()) };
  draw(place, x, { range: [0, 1], hidden: true }, [...ends, ...labels], lines);
  at("parallel").append(key);
}

function drawFront() {
  const [first, second] = [at("first").value, at("second").value], kept = rows(first, second);
  const better = at("better").selectedIndex;
  const signs = [better === 0 || better === 1 ? 1 : -1, better === 0 || better === 2 ? 1 : -1];
  const [x, y] = [axis(first, kept, { few: false }), axis(second, kept, { few: false })];
  const points = kept.map((i) => ({ x: x.place(i), y: y.place(i), text: told(i, first, second),
    color: `${shade("--soft")}80`, form: "circle" }));
  const sorted = [...points].sort((a, b) => signs[0] * (a.x - b.x) || signs[1] * (a.y - b.y));
  let best = Infinity;
  const front = sorted.filter((p) => signs[1] * p.y < best && ((best = signs[1] * p.y), true));
  const color = shade("--c1");
  draw(at("front"), x, y, [...points, ...front.map((p) => ({ ...p, color }))],
    [{ points: front.map((p) => [p.x, p.y]), color }]);
  const key = node("p", "key", " Pareto front"), bar = node("i", "");
  bar.style.background = color;
  key.prepend(bar);
  at("front").append(key);
}

function drawExtremes(metric) {
  const kept = rows(metric).sort((a, b) => sweep.columns[metric][a] - sweep.columns[metric][b]);
  const chosen = kept.length > 10 ? [...kept.slice(0, 5), ...kept.slice(-5)] : kept;
  const table = node("table", ""), head = table.insertRow();
  for (const name of ["run", ...sweep.axes, metric]) head.append(node("th", "", broken(named(name))));
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
const drawAll = () => sweep.metrics.length && (drawMetric(), drawFront());
matchMedia("(prefers-color-scheme: dark)").onchange = drawAll;
// Paper is narrower than a screen, and a chart has pixels: those of A4 without its margins.
addEventListener("beforeprint", () => ((printed = [680, 300]), drawAll()));
addEventListener("afterprint", () => ((printed = null), drawAll()));
let width = innerWidth;
addEventListener("resize", () => innerWidth !== width && ((width = innerWidth), drawAll()));
drawAll();

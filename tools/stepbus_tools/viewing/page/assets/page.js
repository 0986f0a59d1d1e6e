"use strict";
// Draws the charts of a report. All of them share one time axis.
const decoded = new Map();
const charts = new Map(); // element -> uPlot, of what is open
const thumbs = new Map(); // the same, of what is folded
let range = null; // [from, to] of all charts, null: the whole run
let degrees = false;

function numbers(index) {
  if (!decoded.has(index)) {
    const text = report.arrays[index];
    const bytes = Uint8Array.from(atob(text.slice(1)), (c) => c.charCodeAt(0));
    const view = text[0] === "d" ? new Float64Array(bytes.buffer) : new Float32Array(bytes.buffer);
    decoded.set(index, Array.from(view, (x) => (Number.isNaN(x) ? null : x)));
  }
  return decoded.get(index);
}

const color = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

// By what to multiply the numbers of a chart, and the unit they have then.
function scale(chart) {
  const unit = chart.unit || "";
  return degrees && unit.startsWith("rad") ? [180 / Math.PI, unit.replace("rad", "°")] : chart.scale;
}

function short(y) {
  if (y === null || y === undefined) return "";
  const size = Math.abs(y);
  return size && (size < 1e-3 || size >= 1e5) ? y.toExponential(1) : String(+y.toPrecision(4));
}

// Ticks with the digits that tell them apart.
function ticksOf(ticks, step) {
  const large = Math.max(...ticks.map(Math.abs));
  const power = Math.floor(Math.log10(step) + 1e-9);
  // A step may be 2.5 of its power.
  const digits = Math.abs(step / 10 ** power - 2.5) < 0.1 ? 1 - power : -power;
  if (large < 1e-3 || large >= 1e6)
    return ticks.map((y) => y && y.toExponential(Math.max(0, Math.floor(Math.log10(large)) + digits)));
  return ticks.map((y) => (y + 0).toFixed(Math.max(0, digits)));
}

const serious = { failure: "--bad", error: "--bad", fault: "--warn", warning: "--warn" };

function marks(chart, factor, small) {
  const draw = (u) => {
    const { ctx } = u;
    const { left, top, width, height } = u.bbox;
    const dot = devicePixelRatio;
    ctx.save();
    ctx.beginPath();
    ctx.rect(left, top, width, height);
    ctx.clip();
    ctx.lineWidth = dot;
    ctx.font = `${11 * dot}px sans-serif`;
    let row = 0;
    // What ended the run lies above all else.
    const last = (one) => one.level === "failure";
    for (const one of [...report.marks].sort((a, b) => last(a) - last(b))) {
      const x = u.valToPos(one.t, "x", true);
      ctx.strokeStyle = ctx.fillStyle = color(serious[one.level] || "--soft");
      ctx.setLineDash(serious[one.level] ? [] : [dot, 5 * dot]);
      ctx.beginPath();
      ctx.moveTo(x, top);
      ctx.lineTo(x, top + height);
      ctx.stroke();
      if (serious[one.level]) {
        if (x < left || x > left + width) continue;
        const isLeft = x < left + width / 2;
        ctx.textAlign = isLeft ? "left" : "right";
        const room = (isLeft ? left + width - x : x - left) - 8 * dot;
        let text = (small ? one.level : `${one.level}: ${one.text}`).replace(/^(.{50,}?) .*/, "$1 …");
        while (text.length > 2 && ctx.measureText(text).width > room)
          text = text.replace(/ ?.( …|…)?$/u, "…");
        ctx.fillText(text, x + (isLeft ? 4 : -4) * dot, top + (12 + 13 * (row++ % 4)) * dot);
      }
    }
    ctx.strokeStyle = color("--bad");
    ctx.setLineDash([5 * dot, 3 * dot]);
    for (const limit of chart.limits) {
      const y = u.valToPos(limit * factor, "y", true);
      ctx.beginPath();
      ctx.moveTo(left, y);
      ctx.lineTo(left + width, y);
      ctx.stroke();
    }
    ctx.restore();
  };
  return { hooks: { draw } };
}

function tables(lines, factor) {
  const each = lines.map((line) => [
    numbers(line.t),
    numbers(line.y).map((y) => (y === null ? null : y * factor)),
  ]);
  const same = lines.every((line) => line.t === lines[0].t);
  return same ? [each[0][0], ...each.map((one) => one[1])] : uPlot.join(each);
}

function zoom(from, to) {
  range = [from, to];
  for (const [, plot] of charts) plot.setScale("x", { min: from, max: to });
  document.getElementById("from").value = +from.toFixed(4);
  document.getElementById("to").value = +to.toFixed(4);
}

function selected(plot) {
  const { left, width } = plot.select;
  if (width > 3) zoom(plot.posToVal(left, "x"), plot.posToVal(left + width, "x"));
  plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
}

const pointed = (type) => type === "mousemove" || type === "mouseleave";

const dashes = [undefined, [6, 3], [2, 3], [8, 3, 2, 3]];

const isWide = (line) => line.role === "reference" || line.role === "command";
const isDotted = (line) => line.role === "target";

function look(line) {
  const dash = line.run ? dashes[line.run % 4] : line.broken ? dashes[1] : undefined;
  return {
    label: line.label,
    stroke: () => color("--c" + line.color) + (isWide(line) ? "59" : ""),
    width: isWide(line) ? 5 : 1.6,
    dash: isDotted(line) ? dashes[2] : dash,
    spanGaps: true,
    points: { show: (u) => u.data[0].length < 3 },
    value: (_, y) => short(y) || "–",
  };
}

// The lines, and limits where they are near.
function reach(chart, factor) {
  return (_, low, high) => {
    const near = chart.near ? chart.limits.map((limit) => limit * factor) : [];
    const [from, to] = [Math.min(low, ...near), Math.max(high, ...near)];
    const room = 0.06 * (to - from) || Math.abs(to) || 1;
    return [from - room, to + room];
  };
}

function draw(element, chart, small = false) {
  const [factor, unit] = scale(chart);
  const label = unit ? `${chart.title} [${unit}]` : chart.title;
  const axis = {
    stroke: () => color("--soft"),
    grid: { stroke: () => color("--line"), width: 1 },
    ticks: { stroke: () => color("--line"), width: 1 },
    font: small ? "10px sans-serif" : "12px sans-serif",
    labelFont: "12px sans-serif",
    labelSize: 18,
  };
  const dash = (_, i) => {
    const line = i ? chart.lines[i - 1] : {};
    return isDotted(line) ? "dotted" : line.broken || line.run ? "dashed" : "solid";
  };
  const end = report.end || 1;
  const options = {
    width: element.clientWidth,
    height: small ? 130 : 280,
    cursor: small ? { show: false } : {
      sync: { key: "t", setSeries: false, filters: { pub: pointed, sub: pointed } },
      drag: { x: true, y: false, setScale: false },
    },
    scales: { x: { time: false, min: 0, max: end }, y: { range: reach(chart, factor) } },
    axes: [
      { ...axis, label: small ? undefined : "time [s]", size: small ? 26 : 50 },
      {
        ...axis,
        label: small ? undefined : label,
        space: small ? 20 : 30,
        size: (_, texts) => Math.max(small ? 36 : 58, (small ? 12 : 20) + (small ? 6 : 7) * Math.max(...(texts || [""]).map((t) => String(t).length))),
        values: (u, ticks, axis, space, step) => ticksOf(ticks, step),
      },
    ],
    series: [
      { label: "t", value: (_, x) => (x === null ? "–" : x.toFixed(3) + " s") },
      ...chart.lines.map(look),
    ],
    legend: { show: !small, markers: { width: (_, i) => (i && isWide(chart.lines[i - 1]) ? 5 : 2), dash } },
    plugins: [marks(chart, factor, small)],
    hooks: small ? {} : { setSelect: [selected] },
  };
  const plot = new uPlot(options, tables(chart.lines, factor), element);
  const [from, to] = (!small && range) || [0, end];
  plot.setScale("x", { min: from, max: to });
  if (small) return thumbs.set(element, plot);
  plot.over.addEventListener("dblclick", () => zoom(0, end));
  charts.set(element, plot);
}

function chartOf(cell) {
  const [group, index] = cell.dataset.chart.split("-");
  return report.groups[group].charts[index];
}

function redraw() {
  for (const [element, plot] of [...charts]) {
    plot.destroy();
    charts.delete(element);
    draw(element, chartOf(element.closest(".cell")));
  }
  for (const [element, plot] of [...thumbs]) {
    plot.destroy();
    thumbs.delete(element);
    thumb(element);
  }
}

function thumb(element) {
  if (!thumbs.has(element) && element.clientWidth)
    draw(element, chartOf(element.closest(".cell")), true);
}

// Drawn when it comes near: a robot may have a hundred.
const near = new IntersectionObserver(
  (entries) => entries.forEach((one) => one.isIntersecting && thumb(one.target)),
  { rootMargin: "600px" },
);

function node(tag, className, ...inside) {
  const made = document.createElement(tag);
  made.className = className;
  made.append(...inside);
  return made;
}

// How lines of some classes are drawn, and what they are of.
function sample(style, text) {
  return node("span", "", node("i", `sample ${style}`), text);
}

const joints = report.groups.filter((group) => group.color !== null);

// Which line is which, where no title says so: joints have theirs.
function legend(chart) {
  const titles = joints.map((group) => group.title);
  const lines = chart.lines.filter((line) => line.role === "measured" && !line.run);
  const names = lines.map((line) => line.label.slice(report.runs[0].length).trim());
  if (names.length < 2 || names.every((name) => titles.includes(name))) return [];
  const shown = lines.map((line, i) =>
    sample(`l${line.color}${line.broken ? " broken" : ""}`, names[i]),
  );
  return [node("span", "legend", ...shown)];
}

function cellOf(group, number, chart, index) {
  const unit = chart.scale[1];
  const small = node("div", "thumb");
  const cell = node("details", "cell");
  cell.dataset.chart = `${number}-${index}`;
  cell.dataset.name = `${group.title} ${chart.title}`;
  small.role = "img";
  small.ariaLabel = `${cell.dataset.name} over time`;
  const name = node("span", "name", chart.title + (unit ? ` [${unit}]` : ""));
  const summary = [name, node("span", "most", chart.said), small, ...legend(chart)];
  cell.append(node("summary", "", ...summary), node("div", "chart"));
  return cell;
}

// Which line is which run's, and which colour which joint's.
function names() {
  if (!report.groups.length || !report.runs[0]) return [];
  const runs = report.runs.map((run, i) => sample(i ? `l6 run${i % 4}` : "l6", run));
  const colors = joints.map((group) =>
    node("span", "", node("i", `f${group.color}`), group.title),
  );
  const shown = [node("p", "legend runs", "Line: ", ...runs)];
  return colors.length ? [...shown, node("p", "legend joints", "Colour: ", ...colors)] : shown;
}

document.getElementById("curves")?.append(...names());

// So many charts share the width of the page.
const full = 4;

for (const [number, group] of report.groups.entries()) {
  const title = node("h3", "", group.title);
  if (group.color !== null) title.prepend(node("i", `swatch f${group.color}`));
  const shown = group.charts.map((chart, index) => cellOf(group, number, chart, index));
  const matrix = node("div", shown.length >= full ? "matrix full" : "matrix", ...shown);
  const box = group.open
    ? node("section", "group", title, matrix)
    : node("details", "group", node("summary", "", title), matrix);
  box.dataset.name = group.title;
  document.getElementById("curves").append(box);
}

const cells = [...document.querySelectorAll(".cell")];
for (const cell of cells) {
  const element = cell.querySelector(".chart");
  near.observe(cell.querySelector(".thumb"));
  cell.addEventListener("toggle", () => {
    const plot = charts.get(element);
    if (cell.open && !plot) draw(element, chartOf(cell));
    if (!cell.open && plot) {
      plot.destroy();
      charts.delete(element);
    }
  });
}

function filter(text) {
  const words = text.toLowerCase().split(/\s+/).filter(Boolean);
  for (const cell of cells) {
    const name = cell.dataset.name.toLowerCase();
    cell.hidden = !words.every((word) => name.includes(word));
  }
  for (const group of document.querySelectorAll(".group")) {
    group.hidden = !group.querySelector(".cell:not([hidden])");
    if (words.length && !group.hidden && group.tagName === "DETAILS") group.open = true;
  }
}

if (cells.length) {
  const [from, to] = [document.getElementById("from"), document.getElementById("to")];
  document.getElementById("bar").hidden = false;
  const end = report.end || 1;
  [from.value, to.value] = [0, +end.toFixed(4)];
  const typed = () => +to.value > +from.value && zoom(+from.value, +to.value);
  from.addEventListener("change", typed);
  to.addEventListener("change", typed);
  document.getElementById("all").addEventListener("click", () => zoom(0, end));
  document.getElementById("filter").addEventListener("input", (event) => filter(event.target.value));
  const unit = document.getElementById("unit");
  const all = report.groups.flatMap((group) => group.charts);
  unit.hidden = !all.some((chart) => (chart.unit || "").startsWith("rad"));
  unit.addEventListener("click", () => {
    degrees = !degrees;
    unit.textContent = degrees ? "show radians" : "show degrees";
    redraw();
  });
  const open = document.getElementById("open");
  open.addEventListener("click", () => {
    const isAny = cells.some((cell) => cell.open);
    for (const cell of cells) cell.open = !isAny && !cell.hidden;
    open.textContent = isAny ? "open all" : "close all";
  });
}

// The scene in motion is another page, packed: it is unpacked when somebody wants it.
for (const box of document.querySelectorAll(".replay"))
  box.addEventListener("toggle", async () => {
    if (!box.open || box.querySelector("iframe")) return;
    const packed = box.querySelector("script").textContent;
    const bytes = Uint8Array.from(atob(packed), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    const html = await new Response(stream).blob();
    const frame = document.createElement("iframe");
    frame.title = "the scene in motion";
    frame.src = URL.createObjectURL(new Blob([html], { type: "text/html" }));
    box.append(frame);
  });

// In the page of `stepbus run --watch`, the next run is looked at as this one was.
const folds = () => [...document.querySelectorAll(".cell, details.group")];
const sought = document.getElementById("filter");
addEventListener("message", ({ data, source }) => {
  if (source !== parent || parent === window) return;
  if (data === "how") {
    const open = folds().filter((one) => one.open).map((one) => one.dataset.name);
    source.postMessage({ range, degrees, open, filter: sought?.value, top: scrollY }, "*");
  } else if (data.open) {
    if (data.range) zoom(...data.range);
    if (data.degrees) document.getElementById("unit").click();
    if (sought && (sought.value = data.filter)) filter(data.filter);
    for (const one of folds()) if (data.open.includes(one.dataset.name)) one.open = true;
    setTimeout(() => scrollTo(0, data.top), 50);
  }
});

// What is folded is not printed.
let opened = [];
addEventListener("beforeprint", () => {
  opened = [...document.querySelectorAll("details:is(.group, header *):not([open])")];
  for (const details of opened) details.open = true;
  document.querySelectorAll(".thumb").forEach(thumb);
});
addEventListener("afterprint", () => {
  for (const details of opened) details.open = false;
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
let width = innerWidth;
addEventListener("resize", () => {
  if (innerWidth !== width) {
    width = innerWidth;
    redraw();
  }
});

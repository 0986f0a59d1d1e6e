"use strict";
// Draws the charts of a report. All of them share one time axis.
const decoded = new Map();
const charts = new Map(); // element -> uPlot
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

function scale(unit) {
  return degrees && unit.startsWith("rad") ? [180 / Math.PI, unit.replace("rad", "°")] : [1, unit];
}

function short(y) {
  if (y === null || y === undefined) return "";
  const size = Math.abs(y);
  return size && (size < 1e-3 || size >= 1e5) ? y.toExponential(1) : String(+y.toPrecision(4));
}

function marks(limits, factor) {
  return {
    hooks: {
      draw: (u) => {
        const { ctx } = u;
        const { left, top, width, height } = u.bbox;
        ctx.save();
        ctx.beginPath();
        ctx.rect(left, top, width, height);
        ctx.clip();
        ctx.lineWidth = devicePixelRatio;
        for (const one of report.marks) {
          const x = u.valToPos(one.t, "x", true);
          const bad = one.level === "error" || one.level === "failure";
          const warn = one.level === "warning" || one.level === "fault";
          ctx.strokeStyle = color(bad ? "--bad" : warn ? "--warn" : "--soft");
          ctx.setLineDash(bad || warn ? [] : [devicePixelRatio, 5 * devicePixelRatio]);
          ctx.beginPath();
          ctx.moveTo(x, top);
          ctx.lineTo(x, top + height);
          ctx.stroke();
        }
        ctx.strokeStyle = color("--bad");
        ctx.setLineDash([2 * devicePixelRatio, 4 * devicePixelRatio]);
        for (const limit of limits) {
          const y = u.valToPos(limit * factor, "y", true);
          ctx.beginPath();
          ctx.moveTo(left, y);
          ctx.lineTo(left + width, y);
          ctx.stroke();
        }
        ctx.restore();
      },
    },
  };
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

function draw(element, chart) {
  const [factor, unit] = scale(chart.unit || "");
  const limits = chart.limits || [];
  const shown = limits.map((x) => +(x * factor).toPrecision(4)).join(" … ");
  element.querySelector("h4").textContent =
    chart.title + (unit ? ` [${unit}]` : "") + (limits.length ? `, limits ${shown}` : "");
  const axis = {
    stroke: () => color("--soft"),
    grid: { stroke: () => color("--line"), width: 1 },
    ticks: { stroke: () => color("--line"), width: 1 },
  };
  const end = report.end || 1;
  const options = {
    width: element.clientWidth,
    height: 230,
    cursor: {
      sync: { key: "t", setSeries: false, filters: { pub: pointed, sub: pointed } },
      drag: { x: true, y: false, setScale: false },
    },
    scales: { x: { time: false, min: 0, max: end }, y: {} },
    axes: [axis, { ...axis, size: 64, values: (_, ticks) => ticks.map(short) }],
    series: [
      { label: "t", value: (_, x) => (x === null ? "–" : x.toFixed(3) + " s") },
      ...chart.lines.map((line, index) => ({
        label: line.label,
        stroke: () => color("--c" + ((line.color === undefined ? index : line.color) % 8)),
        width: 1.5,
        dash: line.dash ? [6, 4] : undefined,
        spanGaps: true,
        points: { show: (u) => u.data[0].length < 3 },
        value: (_, y) => short(y) || "–",
      })),
    ],
    plugins: [marks(limits, factor)],
    hooks: { setSelect: [selected] },
  };
  const plot = new uPlot(options, tables(chart.lines, factor), element);
  const [from, to] = range || [0, end];
  plot.setScale("x", { min: from, max: to });
  plot.over.addEventListener("dblclick", () => zoom(0, end));
  charts.set(element, plot);
}

const seen = new IntersectionObserver(
  (entries) => {
    for (const entry of entries)
      if (entry.isIntersecting && !charts.has(entry.target)) draw(entry.target, entry.target.chart);
  },
  { rootMargin: "300px" },
);

function redraw() {
  for (const [element, plot] of charts) {
    plot.destroy();
    charts.delete(element);
    seen.unobserve(element);
    seen.observe(element);
  }
}

const room = document.getElementById("charts");
for (const group of report.groups) {
  const details = document.createElement("details");
  details.open = group.open;
  const summary = document.createElement("summary");
  summary.textContent = group.title;
  const grid = document.createElement("div");
  grid.className = "charts";
  for (const chart of group.charts) {
    const element = document.createElement("div");
    element.className = "chart";
    element.chart = chart;
    element.append(document.createElement("h4"));
    grid.append(element);
    seen.observe(element);
  }
  details.append(summary, grid);
  room.append(details);
}

if (report.groups.length) {
  const [from, to] = [document.getElementById("from"), document.getElementById("to")];
  document.getElementById("bar").hidden = false;
  const end = report.end || 1;
  [from.value, to.value] = [0, +end.toFixed(4)];
  const typed = () => +to.value > +from.value && zoom(+from.value, +to.value);
  from.addEventListener("change", typed);
  to.addEventListener("change", typed);
  document.getElementById("all").addEventListener("click", () => zoom(0, end));
  const button = document.getElementById("unit");
  const all = report.groups.flatMap((group) => group.charts);
  button.hidden = !all.some((chart) => (chart.unit || "").startsWith("rad"));
  button.addEventListener("click", () => {
    degrees = !degrees;
    button.textContent = degrees ? "show radians" : "show degrees";
    redraw();
  });
}
// On paper, the reader cannot open or scroll to a chart.
let opened = [];
addEventListener("beforeprint", () => {
  opened = [...room.querySelectorAll("details:not([open])")];
  for (const details of opened) details.open = true;
  for (const element of room.querySelectorAll(".chart"))
    if (!charts.has(element)) draw(element, element.chart);
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

"use strict";
// Puts an interactive figure in place of every still one that carries data. The page is complete
// without it, and a figure that fails stays still.
const INK = "#1b1f24", GRID = { stroke: "#d9d9d9", width: 0.5 };
const shown = (value) => (value == null ? "" : String(Number(value.toPrecision(5))));
const FONT = "12px system-ui, sans-serif";
const axis = (label, size) => ({
  label, size, stroke: INK, grid: GRID, ticks: GRID, font: FONT, labelFont: FONT, labelSize: 18, labelGap: 0,
});

function make(parent, tag, properties) {
  const element = Object.assign(document.createElement(tag), properties);
  parent.append(element);
  return element;
}

// Columns of a record are little-endian float32; time is since the first sample.
function columnsOf(live) {
  const [since, ...rest] = live.columns.map((text) => {
    const view = new DataView(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
    return Float32Array.from({ length: view.byteLength / 4 }, (_, k) => view.getFloat32(4 * k, true));
  });
  return [Float64Array.from(since, (s) => (live.origin + s) / live.seconds), ...rest];
}

function valuesOf({ column, minus }, columns) {
  if (minus === undefined) return columns[column];
  return Float64Array.from(columns[column], (value, k) => 1e3 * (value - columns[minus][k]));
}

function seriesOf({ label, color, width, step }) {
  const paths = step && uPlot.paths.stepped({ align: step === "after" ? 1 : -1 });
  return { label, width, stroke: color, points: { show: false }, value: (_, v) => shown(v), ...(paths && { paths }) };
}

// What is painted stays inside the axes.
const clipped = (paint) => (u) => {
  const { left, top, width, height } = u.bbox;
  u.ctx.save();
  u.ctx.beginPath();
  u.ctx.rect(left, top, width, height);
  u.ctx.clip();
  paint(u, u.ctx, u.bbox);
  u.ctx.restore();
};

function drawPanel(box, live, columns, panel, isLast, key) {
  const shade = (u, ctx, { top, height }) => (live.shaded || []).forEach((span) => {
    const [from, to] = span.map((s) => u.valToPos(s / live.seconds, "x", true));
    ctx.fillStyle = "#e4e4e4";
    ctx.fillRect(from, top, to - from, height);
  });
  const level = (u, ctx, { left, width }) => (panel.levels || []).forEach((value) => {
    ctx.fillStyle = INK;
    for (let x = 0; x < width; x += 12) ctx.fillRect(left + x, u.valToPos(value, "y", true), 7, 1.5);
  });
  return new uPlot({
    width: box.clientWidth, height: panel.height + (isLast ? 18 : 0),
    scales: { x: { time: false } },
    axes: [axis(isLast ? live.label : undefined, 28), axis(panel.label, 52)],
    series: [{ label: live.label, value: (_, v) => shown(v) }, ...panel.lines.map(seriesOf)],
    cursor: { sync: { key, scales: ["x", null] }, drag: { x: true, y: false } },
    hooks: { drawClear: [clipped(shade)], draw: [clipped(level)] },
  }, [columns[0], ...panel.lines.map((line) => valuesOf(line, columns))], box);
}

// Zooms by a factor about the middle, and moves by a share of what is in view.
function look(charts, factor, shift) {
  for (const chart of charts) {
    const all = chart.data[0], [first, last] = [all[0], all[all.length - 1]];
    const { min, max } = chart.scales.x;
    const width = Math.min((max - min) * factor, last - first);
    const middle = (min + max) / 2 + shift * (max - min);
    const start = Math.min(Math.max(middle - width / 2, first), last - width);
    chart.setScale("x", { min: start, max: start + width });
  }
}

document.querySelectorAll("figure.has-live").forEach((figure, number) => {
  try {
    const live = JSON.parse(figure.querySelector("script").textContent), columns = columnsOf(live);
    figure.classList.add("scripted", "live");
    const box = figure.querySelector(".plots");
    const charts = live.panels.map((panel, k, { length }) =>
      drawPanel(make(box, "div"), live, columns, panel, k === length - 1, `${number}`));
    for (const button of figure.querySelectorAll("button[data-factor]")) {
      const { factor, shift } = button.dataset;
      button.onclick = () => look(charts, Number(factor), Number(shift));
    }
    figure.querySelector("button.switch").onclick = () => figure.classList.toggle("live");
    new ResizeObserver(() => charts.forEach((chart) => {
      const width = chart.root.parentNode.clientWidth;
      if (width && width !== chart.width) chart.setSize({ width, height: chart.height });
    })).observe(box);
  } catch (problem) {
    figure.classList.remove("scripted", "live");
    console.error(problem);
  }
});

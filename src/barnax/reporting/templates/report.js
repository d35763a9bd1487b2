"use strict";
// Puts an interactive figure in place of every still one that carries data. The page is complete
// without it, and a figure that fails stays still.
const INK = "#1b1f24", GRID = { stroke: "#d9d9d9", width: 0.5 };
const shown = (value) => (value == null ? "–" : String(Number(value.toPrecision(5))));
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
  if (live.kind !== "time") return live.columns;
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

function seriesOf({ label, color, width, marks, step }) {
  const paths = width ? step && uPlot.paths.stepped({ align: step === "after" ? 1 : -1 }) : () => null;
  const points = { show: Boolean(marks), size: 7, fill: marks === "open" ? "#fff" : color };
  return { label, width, stroke: color, points, value: (_, v) => shown(v), ...(paths && { paths }) };
}

// What is painted stays inside the axes, but for a margin in which marks at their edge stand whole.
const clipped = (paint, margin = 0) => (u) => {
  const { left, top, width, height } = u.bbox;
  u.ctx.save();
  u.ctx.beginPath();
  u.ctx.rect(left - margin, top - margin, width + 2 * margin, height + 2 * margin);
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
    scales: { x: { time: false }, y: panel.range ? { range: () => panel.range } : {} },
    axes: [axis(isLast ? live.label : undefined, 28), axis(panel.label, 52)],
    series: [{ label: live.label, value: (_, v) => shown(v) }, ...panel.lines.map(seriesOf)],
    bands: panel.band && [{ series: panel.band.slice(0, 2), fill: panel.band[2] }],
    cursor: { sync: { key, scales: ["x", null] }, drag: { x: true, y: false } },
    hooks: { drawClear: [clipped(shade)], draw: [clipped(level)] },
  }, [columns[0], ...panel.lines.map((line) => valuesOf(line, columns))], box);
}

function drawMap(box, live) {
  const { taus, rmse, steps, colors, marks, labels } = live;
  const ends = taus.map((each) => [each[0], each[each.length - 1]]);
  const lowest = Math.min(...rmse.flat().filter((value) => value !== null));
  const excess = (value) => (value === null ? null : 100 * (value / lowest - 1));
  const cells = (u, ctx) => {
    const edge = (each, k) => Math.sqrt(each[Math.max(k - 1, 0)] * each[Math.min(k, each.length - 1)]);
    const at = (k, scale) => Array.from({ length: taus[k].length + 1 }, (_, n) =>
      u.valToPos(edge(taus[k], n), scale, true));
    const xs = at(0, "x"), ys = at(1, "y");
    rmse.forEach((row, i) => row.forEach((value, j) => {
      if (value === null) return;
      ctx.fillStyle = colors[steps.filter((step) => step <= excess(value)).length - 1];
      ctx.fillRect(xs[i], ys[j + 1], xs[i + 1] - xs[i] + 1, ys[j] - ys[j + 1] + 1);
    }));
  };
  const symbols = (u, ctx) => marks.forEach(({ shape, color, points }) => points.forEach((point) => {
    const place = [u.valToPos(point[0], "x", true), u.valToPos(point[1], "y", true)];
    const font = `${18 * devicePixelRatio}px sans-serif`;
    Object.assign(ctx, { font, textAlign: "center", textBaseline: "middle" });
    Object.assign(ctx, { lineWidth: 4, strokeStyle: "#000", fillStyle: color });
    ctx.strokeText(shape, ...place);
    ctx.fillText(shape, ...place);
  }));
  const readout = make(box, "p", { className: "key", textContent: "\u00a0" });
  const nearest = (each, tau) => each.reduce((best, one, k) =>
    Math.abs(Math.log(one / tau)) < Math.abs(Math.log(each[best] / tau)) ? k : best, 0);
  const tell = (u) => {
    if (!(u.cursor.left >= 0)) return;
    const i = nearest(taus[0], u.posToVal(u.cursor.left, "x"));
    const j = nearest(taus[1], u.posToVal(u.cursor.top, "y"));
    const values = [taus[0][i], taus[1][j], rmse[i][j], excess(rmse[i][j])];
    readout.textContent = values.map((value, k) => `${labels[k]}: ${shown(value)}`).join("; ");
  };
  const scale = { time: false, distr: 3, range: (_, low, high) => [low, high] };
  const chart = new uPlot({
    width: box.clientWidth, height: Math.min(560, 80 + box.clientWidth),
    padding: [12, 14, 0, 0], legend: { show: false },
    scales: { x: scale, y: scale },
    axes: [axis(labels[0], 28), axis(labels[1], 60)],
    series: [{}, { paths: () => null, points: { show: false } }],
    cursor: { drag: { x: true, y: true, uni: 30 }, points: { show: false } },
    hooks: { drawClear: [clipped(cells)], draw: [clipped(symbols, 12 * devicePixelRatio)], setCursor: [tell] },
  }, ends, box);
  const explain = (text, entries) => {
    const key = make(box, "p", { className: "key", textContent: text });
    for (const [background, meaning] of entries) {
      const entry = make(key, "span", { className: "entry" });
      if (background) make(entry, "span", { className: "swatch" }).style.background = background;
      entry.append(meaning);
      key.append(" ");
    }
  };
  explain(`${labels[3]}: `, colors.map((color, k) => [color, steps[k]]));
  explain("", marks.map((mark) => [mark.color !== "#ffffff" && mark.color, `${mark.shape} ${mark.label}`]));
  return chart;
}

// Zooms by a factor about the middle, and moves by a share of what is in view.
function look(charts, scales, factor, shift) {
  const to = (v) => (scales.length > 1 ? Math.log(v) : v), from = (v) => (scales.length > 1 ? Math.exp(v) : v);
  for (const chart of charts) for (const scale of scales) {
    const all = chart.data[scale === "x" ? 0 : 1].map(to), [first, last] = [all[0], all[all.length - 1]];
    const [low, high] = [to(chart.scales[scale].min), to(chart.scales[scale].max)];
    const width = Math.min((high - low) * factor, last - first);
    const middle = (low + high) / 2 + shift * (high - low);
    const start = Math.min(Math.max(middle - width / 2, first), last - width);
    chart.setScale(scale, { min: from(start), max: from(start + width) });
  }
}

document.querySelectorAll("figure.has-live").forEach((figure, number) => {
  try {
    const live = JSON.parse(figure.querySelector("script").textContent), isMap = live.kind === "map";
    figure.classList.add("scripted", "live");
    const box = figure.querySelector(".plots"), columns = isMap ? [] : columnsOf(live);
    const charts = isMap ? [drawMap(box, live)] : live.panels.map((panel, k, { length }) =>
      drawPanel(make(box, "div"), live, columns, panel, k === length - 1 || live.kind === "soc", `${number}`));
    for (const button of figure.querySelectorAll("button[data-factor]")) {
      const { factor, shift } = button.dataset;
      button.onclick = () => look(charts, isMap ? ["x", "y"] : ["x"], Number(factor), Number(shift));
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

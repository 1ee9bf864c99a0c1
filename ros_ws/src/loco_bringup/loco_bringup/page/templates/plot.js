// SPDX-License-Identifier: Apache-2.0
// Signals over a common axis, which uPlot draws.
// Colours of the page are CSS; a canvas wants them plain.
const probe = document.body.appendChild(document.createElement("i"));
probe.hidden = true;
function ink(color) { probe.style.color = color; return getComputedStyle(probe).color; }
async function bytes(text) {
  const packed = new Blob([Uint8Array.from(atob(text), (c) => c.charCodeAt(0))]);
  return new Response(packed.stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer();
}
function values([low, high], differences, log) {
  const scale = (high - low) / 65534;
  let step = 0;
  return Array.from(differences, (difference) => {
    step = ((step + difference) << 16) >> 16;
    if (step === -32768) return null;
    const value = low + (step + 32767) * scale;
    return log ? 10 ** value : value;
  });
}
// A signal that is slower than the axis has values at few of its places: a line is interrupted only
// where they are missing for longer than this many times its usual interval.
const PAUSE = 2.5;
function pauseOf(x, y) {
  const known = x.filter((_, i) => y[i] != null), steps = known.slice(1).map((at, i) => at - known[i]).sort((a, b) => a - b);
  return steps.length ? PAUSE * steps[steps.length >> 1] : Infinity;
}
function brief(value) { return value == null ? "–" : String(+value.toPrecision(4)); }
// Of a logarithmic axis only the powers of ten have a line.
function tens(chart, places) { return places.map((v) => (v > 0 && Math.abs(Math.log10(v) % 1) < 1e-9 ? v : null)); }
function shade(chart, spans, named) {
  const { ctx, bbox } = chart, ratio = devicePixelRatio || 1;
  ctx.save();
  ctx.beginPath(); ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height); ctx.clip();
  ctx.font = `${11 * ratio}px system-ui, sans-serif`; ctx.textBaseline = "top"; ctx.textAlign = "left";
  for (const [color, name, start, end] of spans) {
    const left = Math.max(bbox.left, chart.valToPos(start, "x", true));
    const right = Math.min(bbox.left + bbox.width, chart.valToPos(end, "x", true));
    if (right <= left) continue;
    if (!named) {
      ctx.fillStyle = ink(color); ctx.fillRect(left, bbox.top, right - left, bbox.height);
    } else if (ctx.measureText(name).width + 6 * ratio < right - left) {
      ctx.fillStyle = ink("var(--soft)"); ctx.fillText(name, left + 3 * ratio, bbox.top + 2 * ratio);
    }
  }
  ctx.restore();
}
function save(name, head, rows) {
  const cell = (v) => (v == null ? "" : typeof v === "number" ? +v.toPrecision(7) : `"${v.replaceAll('"', '""')}"`);
  const text = [head, ...rows].map((row) => row.map(cell).join(",") + "\n").join("");
  download(fileOf(text, name, "csv"));
}
function button(parent, text) {
  const made = add(parent, "button", "", text);
  made.type = "button";
  return made;
}
// A button of the legend that switches what has its name, and shows every colour of it.
function toggle(legend, name, colors, dashed, change) {
  const made = button(legend, ""), swatch = add(made, "i", "swatch");
  const parts = dashed && colors.length === 1 ? [...colors, "transparent"] : colors, each = dashed ? 20 : 100 / parts.length;
  swatch.style.background = `repeating-linear-gradient(90deg, ${parts.map((c, k) => `${c} ${k * each}% ${(k + 1) * each}%`)})`;
  made.append(name);
  made.className = "toggle";
  made.setAttribute("aria-pressed", "true");
  made.addEventListener("click", () => {
    const show = made.getAttribute("aria-pressed") !== "true";
    made.setAttribute("aria-pressed", String(show));
    change(show);
  });
}
async function drawPlot(figure, data) {
  const axis = new Float64Array(await bytes(data.x)), steps = new Int16Array(await bytes(data.steps));
  const even = axis.length === 2 && data.count !== 2;
  const x = even ? Array.from({ length: data.count }, (_, i) => axis[0] + i * axis[1]) : Array.from(axis);
  const columns = [], mine = [];
  const next = () => steps.subarray(columns.length * data.count, (columns.length + 1) * data.count);
  const legend = add(figure, "div", "legend"), names = new Map();
  data.panels.forEach((panel, index) => {
    const own = panel.lines.map((line) => columns[columns.push(values(line.ends, next(), panel.log)) - 1]);
    const pauses = own.map((y) => pauseOf(x, y));
    const newest = (k, i) => {  // the last value, unless it is of before a pause
      let j = i;
      while (j > 0 && own[k][j] == null && x[i] - x[j - 1] <= pauses[k]) j--;
      return own[k][j];
    };
    const long = (u, s, first, last, gaps) => data.log ? gaps : gaps.filter(([from, to]) =>
      (to - from) / u.bbox.width * (u.scales.x.max - u.scales.x.min) > pauses[s - 1]);
    const head = add(figure, "div", "head", panel.label + " "), read = add(head, "span", "read");
    const last = index === data.panels.length - 1;
    const look = { stroke: () => ink("var(--soft)"), font: "11px system-ui, sans-serif",
      grid: { stroke: () => ink("var(--line)"), width: 1 }, ticks: { show: false } };
    const chart = new uPlot({
      width: figure.clientWidth, height: data.panels.length === 1 ? 220 : last ? 160 : 130, legend: { show: false },
      scales: { x: { time: false, distr: data.log ? 3 : 1 },
        y: { distr: panel.log ? 3 : 1, ...(panel.limits ? { range: panel.limits } : {}) } },
      cursor: { drag: { x: true, y: false }, points: { size: 6 }, sync: { key: data.axis, scales: ["x", null] } },
      axes: [{ ...look, size: last ? 28 : 16, label: last ? data.axis : undefined, labelSize: 18,
          labelFont: "12px system-ui, sans-serif", values: last ? undefined : (u, ticks) => ticks.map(() => "") },
        { ...look, ...(panel.log ? { grid: { ...look.grid, filter: tens } } : {}), size: 58, values: (u, ticks) => ticks.map((v) => (v == null ? "" : brief(v))) }],
      series: [{}, ...panel.lines.map((line) => ({ label: line.name, width: line.width, stroke: () => ink(line.color),
        dash: line.dashed ? [6, 4] : undefined, gaps: long, points: { show: false } }))],
      hooks: {
        drawClear: [(u) => shade(u, data.spans, false)],
        draw: [(u) => { if (index === 0) shade(u, data.spans, true); }],
        setCursor: [(u) => {
          const i = u.cursor.idx;
          if (data.axis.startsWith("time [s]")) showMoment(i == null ? null : x[i]);
          read.textContent = i == null ? "" : `${data.axis.split(" ")[0]} ${brief(x[i])}: ` +
            panel.lines.map((l, k) => `${l.name} ${brief(newest(k, i))}`).join(" · ");
        }],
      },
    }, [x, ...own], figure);
    panel.lines.forEach((line, k) => {
      if (!names.has(line.name)) names.set(line.name, { ...line, places: [] });
      names.get(line.name).places.push([chart, k + 1]);
    });
    if (data.view) chart.setScale("x", { min: data.view[0], max: data.view[1] });
    charts.push(chart); mine.push(chart);
  });
  for (const [name, { color, dashed, places }] of names) {
    toggle(legend, name, [color], dashed, (show) => places.forEach(([chart, series]) => chart.setSeries(series, { show })));
  }
  const whole = button(legend, "Whole"), csv = button(legend, "Save CSV");
  whole.addEventListener("click", () => charts.filter((c) => c.cursor.sync.key === data.axis).forEach((c) =>
    c.setScale("x", { min: c.data[0][0], max: c.data[0][c.data[0].length - 1] })));
  csv.addEventListener("click", () => save(data.title,
    [data.axis, ...data.panels.flatMap((p) => p.lines.map((l) => `${p.label} ${l.name}`))],
    x.map((at, i) => [at, ...columns.map((c) => c[i])])));
  new ResizeObserver(() => mine.forEach((c) => {
    if (figure.clientWidth && c.width !== figure.clientWidth) c.setSize({ width: figure.clientWidth, height: c.height });
  })).observe(figure);
}

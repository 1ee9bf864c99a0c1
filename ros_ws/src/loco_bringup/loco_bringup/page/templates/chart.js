// SPDX-License-Identifier: Apache-2.0
// Points in a plane: lines, dots and boxes on axes of numbers or names, as SVG.
const SPACE = Object.assign(document.createElement("template"), { innerHTML: "<svg></svg>" })
  .content.firstChild.namespaceURI;
function draw(figure) {
  const data = JSON.parse(figure.querySelector("script").textContent);
  return data.axis ? drawPlot(figure, data) : drawChart(figure, data);
}
function shape(parent, tag, attributes, text) {
  const made = parent.appendChild(document.createElementNS(SPACE, tag));
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text !== undefined) made.textContent = text;
  return made;
}
// Places of the lines of a grid between two ends, about `count` of them.
function ticks([low, high], log, count) {
  if (log) {
    const decades = Math.log10(high / low), parts = decades > 2.5 ? [1] : [1, 2, 5], made = [];
    const every = Math.max(1, Math.ceil(decades / count));
    for (let e = Math.floor(Math.log10(low)); e <= Math.log10(high); e++) {
      if (e % every) continue;
      for (const part of parts) if (part * 10 ** e >= low && part * 10 ** e <= high) made.push(part * 10 ** e);
    }
    if (made.length > 1) return made;
  }
  const rough = (high - low) / count, ten = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].find((k) => k * ten >= rough) * ten;
  const first = Math.ceil(low / step - 1e-9);
  return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, k) => +((first + k) * step).toPrecision(12));
}
function scale(axis, [low, high], from, to) {
  const of = axis.log ? Math.log10 : (v) => v, a = of(low), share = (to - from) / (of(high) - a);
  return {
    to: (value) => from + (of(value) - a) * share,
    back: (pixel) => { const v = a + (pixel - from) / share; return axis.log ? 10 ** v : v; },
  };
}
// Words for a place on an axis; a box on an axis of numbers has an end, too.
function place(axis, low, high) {
  if (axis.names.length) return axis.names[Math.round(high == null ? low : (low + high) / 2)] ?? "";
  return high == null ? brief(low) : `${brief(low)} to ${brief(high)}`;
}
function told(panel, layer, i) {
  const ends = layer.shape === "boxes" ? [layer.right[i], layer.top[i]] : [null, null];
  const name = (axis) => axis.label.split(" [")[0];
  const at = `${name(panel.x)} ${place(panel.x, layer.x[i], ends[0])}`;
  const rise = layer.shape === "boxes" && !panel.y.names.length ? "" : `${name(panel.y)} ${place(panel.y, layer.y[i], ends[1])}`;
  return [layer.texts[i] || layer.name, at, rise].filter(Boolean).join(" · ");
}
async function drawChart(figure, data) {
  const steps = new Int16Array(await bytes(data.steps));
  let used = 0;
  for (const panel of data.panels) for (const layer of panel.layers) {
    layer.shown = true;
    for (const side of ["x", "right", "y", "top"]) {
      if (!layer.ends[side]) continue;
      const log = panel[side === "x" || side === "right" ? "x" : "y"].log;
      layer[side] = values(layer.ends[side], steps.subarray(used, used += layer.count), log);
    }
  }
  const legend = add(figure, "div", "legend"), frames = add(figure, "div", data.panels.length === 4 ? "frames four" : "frames"), names = new Map();
  const mine = data.panels.map((panel) => frame(frames, panel));
  data.panels.forEach((panel, k) => panel.layers.forEach((layer) => {
    if (!layer.count || !layer.name) return;
    if (!names.has(layer.name)) names.set(layer.name, { colors: new Set(), places: [] });
    const named = names.get(layer.name);
    named.places.push([mine[k], layer]); named.colors.add(layer.color); named.dashed = layer.dashed;
  }));
  for (const [name, { colors, dashed, places }] of names) {
    toggle(legend, name, [...colors], dashed, (show) => places.forEach(([drawn, layer]) => { layer.shown = show; drawn(); }));
  }
  button(legend, "Whole").addEventListener("click", () => mine.forEach((drawn, k) => { data.panels[k].view = null; drawn(); }));
  button(legend, "Save CSV").addEventListener("click", () => save(data.title,
    ["frame", "name", "x", "y", "x end", "y end", "text"],
    data.panels.flatMap((p) => p.layers.flatMap((l) => l.x.map((x, i) => {
      const of = (axis, v) => (v != null && axis.names.length && l.shape !== "boxes" ? place(axis, v, null) : v);
      const box = l.shape === "boxes", lane = (axis, v, end) => (box && axis.names.length ? place(axis, v, end) : of(axis, v));
      return [p.title || p.y.label, l.name, lane(p.x, x, l.right?.[i]), lane(p.y, l.y[i], l.top?.[i]),
        box && !p.x.names.length ? l.right[i] : null, box && !p.y.names.length ? l.top[i] : null, l.texts[i] ?? ""];
    })))));
  new ResizeObserver(() => mine.forEach((drawn) => drawn())).observe(figure);
}
// One frame of a chart; returns the function that draws it again.
function frame(parent, panel) {
  const box = add(parent, "div", panel.equal ? "frame equal" : "frame"), words = panel.title ? `${panel.title}: ${panel.y.label}` : panel.y.label;
  add(box, "div", "head", words);
  const read = add(box, "div", "head read", ""), svg = box.appendChild(document.createElementNS(SPACE, "svg"));
  read.setAttribute("aria-live", "polite");
  svg.setAttribute("role", "img"); svg.setAttribute("tabindex", "0");
  svg.setAttribute("aria-label", `${words} over ${panel.x.label}`);
  let x, y, size, ring, start = null, at = null;
  function drawn() {
    const width = box.clientWidth, height = panel.height;
    if (!width) return;
    const long = panel.y.names.reduce((most, name) => Math.max(most, name.length), 0);
    const left = panel.y.names.length ? Math.min(0.4 * width, 6.3 * long + 10) : 50;
    size = { left, right: width - 12, top: 6, bottom: height - 36 };
    let [across, up] = panel.view || [panel.x.ends, panel.y.ends];
    if (panel.equal) {
      const unit = Math.max((across[1] - across[0]) / (size.right - left), (up[1] - up[0]) / (size.bottom - size.top));
      const around = ([a, b], pixels) => [(a + b - unit * pixels) / 2, (a + b + unit * pixels) / 2];
      across = around(across, size.right - left); up = around(up, size.bottom - size.top);
    }
    x = scale(panel.x, across, left, size.right); y = scale(panel.y, up, size.bottom, size.top);
    svg.replaceChildren();
    svg.setAttribute("width", width); svg.setAttribute("height", height);
    grid(svg, panel, across, up, x, y, size);
    const room = { x: left, y: size.top, width: size.right - left, height: size.bottom - size.top };
    // An inner picture cuts off what is outside of it.
    const inside = shape(svg, "svg", { ...room, viewBox: `${left} ${size.top} ${room.width} ${room.height}` });
    for (const layer of panel.layers) if (layer.shown) mark(inside, layer, x, y);
    ring = shape(svg, "circle", { r: 7, class: "ring", visibility: "hidden" });
  }
  // Middle of a mark in pixels.
  function middle([layer, i]) {
    if (layer.shape !== "boxes") return [x.to(layer.x[i]), y.to(layer.y[i])];
    return [(x.to(layer.x[i]) + x.to(layer.right[i])) / 2, (y.to(layer.y[i]) + y.to(layer.top[i])) / 2];
  }
  function nearest(px, py) {
    let best = null, least = 24;
    for (const layer of panel.layers) {
      if (!layer.shown) continue;
      for (let i = 0; i < layer.count; i++) {
        if (layer.x[i] == null || layer.y[i] == null) continue;
        let far;
        if (layer.shape === "boxes") {
          far = px >= x.to(layer.x[i]) && px <= x.to(layer.right[i]) && py <= y.to(layer.y[i]) && py >= y.to(layer.top[i]) ? 8 : 99;
        } else {
          far = Math.hypot(x.to(layer.x[i]) - px, y.to(layer.y[i]) - py) + (layer.shape === "line" ? 3 : 0);
        }
        if (far <= least) [least, best] = [far, [layer, i]];
      }
    }
    return best;
  }
  function show(found) {
    at = found;
    read.textContent = found ? told(panel, ...found) : "";
    svg.style.cursor = found && found[0].links[found[1]] ? "pointer" : "";
    ring.setAttribute("visibility", found ? "visible" : "hidden");
    if (found) { const [cx, cy] = middle(found); ring.setAttribute("cx", cx); ring.setAttribute("cy", cy); }
  }
  function open() { if (at && at[0].links[at[1]]) location.href = at[0].links[at[1]]; }
  function point(event) {
    const seen = svg.getBoundingClientRect();
    return [event.clientX - seen.left, event.clientY - seen.top];
  }
  svg.addEventListener("pointermove", (event) => show(nearest(...point(event))));
  svg.addEventListener("pointerleave", () => show(null));
  svg.addEventListener("pointerdown", (event) => {
    start = event.pointerType === "mouse" ? point(event) : null;
    show(nearest(...point(event)));
  });
  svg.addEventListener("pointerup", (event) => {
    const [a, b] = start || [0, 0], [c, d] = point(event);
    if (start && Math.abs(c - a) > 8 && Math.abs(d - b) > 8) {
      const order = (...ends) => ends.sort((one, two) => one - two);
      panel.view = [order(x.back(a), x.back(c)), order(y.back(b), y.back(d))];
      drawn();
    } else open();
    start = null;
  });
  svg.addEventListener("dblclick", () => { panel.view = null; drawn(); });
  svg.addEventListener("keydown", (event) => {
    const way = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (event.key === "Enter") open();
    if (!way) return;
    event.preventDefault();
    const [px, py] = at ? middle(at) : [size.left, size.bottom];
    let best = null, least = Infinity;
    for (const layer of panel.layers) {
      if (!layer.shown || layer.shape === "line") continue;
      for (let i = 0; i < layer.count; i++) {
        const [dx, dy] = middle([layer, i]).map((v, k) => v - [px, py][k]);
        const on = dx * way[0] + dy * way[1], off = Math.abs(dx * way[1]) + Math.abs(dy * way[0]);
        if (on > 1 && on + 3 * off < least) [least, best] = [on + 3 * off, [layer, i]];
      }
    }
    if (best) show(best);
  });
  drawn();
  return drawn;
}
function grid(svg, panel, across, up, x, y, size) {
  const cut = (name, room) => (name.length * 6.3 > room ? `${name.slice(0, Math.max(1, Math.floor(room / 6.3) - 1))}…` : name);
  const shown = (axis, ends, pixels, each) => {
    if (!axis.names.length) return ticks(ends, axis.log, Math.max(2, pixels / each)).map((at) => [at, brief(at)]);
    const every = Math.ceil((ends[1] - ends[0]) * each / pixels);
    return axis.names.map((name, at) => [at, name]).filter(([at]) => at % every === 0 && at >= ends[0] && at <= ends[1]);
  };
  const widest = panel.x.names.reduce((most, name) => Math.max(most, name.length), 4);
  for (const [value, name] of shown(panel.x, across, size.right - size.left, Math.max(52, 6.6 * widest + 6))) {
    const at = x.to(value);
    shape(svg, "line", { class: "grid", x1: at, x2: at, y1: size.top, y2: size.bottom });
    shape(svg, "text", { x: at, y: size.bottom + 14, "text-anchor": "middle" }, name);
  }
  for (const [value, name] of shown(panel.y, up, size.bottom - size.top, panel.y.names.length ? 13 : 40)) {
    const at = y.to(value);
    shape(svg, "line", { class: "grid", x1: size.left, x2: size.right, y1: at, y2: at });
    shape(svg, "text", { x: size.left - 6, y: at + 4, "text-anchor": "end" }, cut(name, size.left - 8));
  }
  const label = shape(svg, "text", { class: "axis", y: size.bottom + 31, "text-anchor": "middle" }, panel.x.label);
  label.setAttribute("x", Math.min((size.left + size.right) / 2, size.right + 12 - label.getComputedTextLength() / 2));
}
// All marks of a layer as one path.
function mark(parent, layer, x, y) {
  const parts = [], off = { boxes: ["fill", "stroke"] }[layer.shape] || ["stroke", "fill"];
  let begun = false;
  for (let i = 0; i < layer.count; i++) {
    if (layer.x[i] == null || layer.y[i] == null) { begun = false; continue; }
    const px = x.to(layer.x[i]).toFixed(1), py = y.to(layer.y[i]).toFixed(1);
    if (layer.shape === "boxes") parts.push(`M${px},${py}H${x.to(layer.right[i]).toFixed(1)}V${y.to(layer.top[i]).toFixed(1)}H${px}z`);
    else if (layer.shape === "dots") parts.push(`M${px},${py}h0`);
    else parts.push(`${begun ? "L" : "M"}${px},${py}`);
    begun = true;
  }
  const path = shape(parent, "path", { d: parts.join(""), class: layer.shape, style: `${off[0]}:${layer.color};${off[1]}:none` });
  path.setAttribute("stroke-width", layer.shape === "dots" ? 2 * layer.size : layer.size);
  if (layer.dashed) path.setAttribute("stroke-dasharray", "6 4");
}

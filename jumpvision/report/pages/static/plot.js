"use strict";
// A panel of the report's figures, drawn by uPlot: its axes, lines, bands and the part that is dragged; what it has not is
// drawn in its hooks. Point or tap to read, arrows, +, - and 0 do it from the keyboard. The data: JSON in the page (charts.py).
const ROLES = { measured: "--measured", model: "--model", accent: "--accent", green: "--green", amber: "--amber", sky: "--sky", quiet: "--soft", ink: "--ink" };
const VIRIDIS = ["#440154", "#482878", "#3e4a89", "#31688e", "#26828e", "#1f9e89", "#35b779", "#6ece58", "#b5de2b", "#fde725"];
const SIGNED = ["#2166ac", "#67a9cf", "#d1e5f0", "#f7f7f7", "#fddbc7", "#ef8a62", "#b2182b"];
const NEAR = 40; // px from the pointer within which a point is read

const esc = (s) => String(s).replace(/[&<>"]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[c]);
const said = (v, digits = 4) => (v === null || v === undefined ? "–" : String(Number(v.toPrecision(digits))).replace("-", "−"));
const words = (axis) => (axis.unit ? `${axis.label} [${axis.unit}]` : axis.label);
const tags = (series) => series.tags ?? [series.name]; // what the legend can hide
const paint = (series) => `var(${ROLES[series.role] ?? "--ink"})`;
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim(); // of the screen now, or of paper
const ink = (series) => colour(ROLES[series.role] ?? "--ink");
const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));
const font = (k) => `${12 * k}px system-ui, sans-serif`;

function shade(table, share) {
  const place = Math.min(Math.max(share, 0), 1) * (table.length - 1), i = Math.min(Math.floor(place), table.length - 2);
  const a = rgb(table[i]), b = rgb(table[i + 1]);
  return a.map((v, k) => Math.round(v + (place - i) * (b[k] - v)));
}

// A name in lines of at most so many letters; a longer word keeps its line.
function folds(name, most) {
  const lines = [];
  for (const word of String(name).split(" ")) {
    if (lines.length && lines.at(-1).length + 1 + word.length <= most) lines[lines.length - 1] += ` ${word}`;
    else lines.push(word);
  }
  return lines;
}

class Panel {
  constructor(chart, spec, host) {
    Object.assign(this, { chart, spec, host, zoom: null, cursor: null });
    host.innerHTML = `<p class="part">${esc(spec.title)}</p><div class="plot"></div><p class="tip" role="status"></p>`;
    this.plot = host.querySelector(".plot");
    this.tip = host.querySelector(".tip");
    this.plot.tabIndex = 0;
    this.plot.setAttribute("role", "img");
    this.plot.setAttribute("aria-label", `${spec.title}: ${spec.y.label} against ${spec.x.label}. Arrow keys read values, plus and minus zoom, 0 shows all.`);
    this.plot.ondblclick = () => this.chart.range(this, null);
    this.plot.onkeydown = (e) => this.key(e);
    this.ring = Object.assign(document.createElement("div"), { className: "ring", hidden: true });
  }

  shown() { return this.spec.series.filter((s) => !tags(s).some((t) => this.chart.hidden.has(t))); }
  along() { return this.spec.series.some((s) => s.kind === "line"); } // read everything at one x

  // Smallest ranges of x and y that hold what is shown, with a margin.
  extent() {
    const range = (axis, of) => {
      if (axis.names) return [-0.5, axis.names.length - 0.5];
      let lo = Infinity, hi = -Infinity;
      for (const s of this.shown()) {
        for (const [i, v] of s[of].entries()) {
          if (v === null || (axis.log && v <= 0)) continue;
          const e = of === "y" && s.s ? 2 * (s.s[i] ?? 0) : 0;
          lo = Math.min(lo, axis.log ? v : v - e);
          hi = Math.max(hi, v + e);
        }
      }
      if (!(lo <= hi)) [lo, hi] = [axis.log ? 1 : 0, axis.log ? 10 : 1];
      if (axis.zero && !axis.log) [lo, hi] = [Math.min(lo, 0), Math.max(hi, 0)];
      if (axis.range) return axis.range;
      if (axis.log) return [lo / 1.3, hi * 1.3];
      const room = (hi - lo || Math.abs(hi) || 1) * 0.04;
      return [axis.zero && lo === 0 ? 0 : lo - room, axis.zero && hi === 0 ? 0 : hi + room];
    };
    const full = [range(this.spec.x, "x"), range(this.spec.y, "y")];
    if (this.spec.equal) full[0] = full[1] = [Math.min(full[0][0], full[1][0]), Math.max(full[0][1], full[1][1])];
    return full;
  }

  // The lines as uPlot has them: columns over one x, each with its band of 2 s as two lines that are not drawn.
  lines() {
    const lines = this.shown().filter((s) => s.kind === "line"), data = [[]], series = [{}], bands = [], fits = (v) => v !== null && !(this.spec.y.log && v <= 0);
    const xs = data[0] = [...new Set((lines.length ? lines : this.shown()).flatMap((s) => s.x))].filter((v) => v !== null).sort((a, b) => a - b);
    const at = new Map(xs.map((v, i) => [v, i]));
    for (const s of lines) {
      for (const up of s.s ? [2, -2, 0] : [0]) {
        const column = new Array(xs.length); // undefined: of another series' x; null: a gap
        s.x.forEach((v, i) => { if (v !== null) column[at.get(v)] = fits(s.y[i]) ? s.y[i] + up * (s.s?.[i] ?? 0) : null; });
        data.push(column);
        series.push({ stroke: up ? "transparent" : ink(s), width: 1.8, dash: s.dash ? [6, 4] : [], points: { show: false } });
      }
      if (s.s) bands.push({ series: [series.length - 3, series.length - 2], fill: `${ink(s)}33` });
    }
    return { data, series, bands };
  }

  draw() {
    const { spec } = this, w = this.plot.clientWidth, names = spec.y.names, map = spec.series.some((s) => s.kind === "map"), [fx, fy] = this.extent();
    if (!w) return; // in a closed fold
    const left = names ? Math.min(0.42 * w, 14 + 6.6 * Math.max(...names.map((n) => n.length))) : 62;
    this.folded = names?.map((n) => folds(n, Math.floor((left - 10) / 6.6)));
    const tall = Math.max(26, 14 * Math.max(0, ...(this.folded ?? []).map((f) => f.length)) + 6), slant = spec.x.names && (w - left) / spec.x.names.length < 90;
    const height = names && !map ? 46 + names.length * Math.max(tall, 26 * this.shown().length * 0.7) : spec.height ?? 270;
    const scale = (axis, range) => ({ time: false, distr: axis.log ? 3 : 1, range: () => range, dir: axis.names && axis === spec.y ? -1 : 1 });
    const axis = (a, range, space) => {
      const even = (v) => [1, ...(range[1] / range[0] < 20 ? [2, 5] : [])].includes(Number((v / 10 ** Math.floor(Math.log10(v) + 1e-9)).toPrecision(3)));
      const filter = (_, splits) => (a.log ? splits.map((v) => (even(v) ? v : null)) : splits);
      return { stroke: colour("--soft"), font: font(1), labelFont: font(1), grid: { stroke: colour("--grid"), width: 1, show: !a.names, filter }, ticks: { show: false }, gap: 6, labelSize: 18, labelGap: 2,
        label: words(a), space, filter, values: (_, v) => v.map((b) => (b === null ? null : said(b))), ...(a.names && { splits: () => a.names.map((_, i) => i), values: () => a.names }) };
    };
    const { data, series, bands } = this.lines(), [x, y] = [this.zoom?.x ?? fx, this.zoom?.y ?? fy];
    this.u?.destroy();
    this.u = new uPlot({
      width: w, height, padding: [8, map ? 66 : 12, 0, 0], legend: { show: false }, series, bands, scales: { x: scale(spec.x, x), y: scale(spec.y, y) },
      cursor: { drag: { x: !spec.x.names, y: !this.along() && !names, setScale: false, dist: 8, uni: 24 }, points: { show: false }, x: this.along(), y: false, bind: { dblclick: () => null } },
      axes: [{ ...axis(spec.x, x, 75), size: slant ? 66 : 24, rotate: slant ? 35 : 0 }, { ...axis(spec.y, y, height / 7), size: names ? left : left - 20, ...(names && { label: null, values: () => [] }) }],
      hooks: { drawAxes: [(u) => this.below(u)], draw: [(u) => this.above(u)], setCursor: [(u) => { if (u.cursor.event) this.move(u); }], setSelect: [(u) => this.taken(u)] },
    }, data, this.plot);
    this.u.over.append(this.ring);
    this.chart.reset.hidden = !this.chart.panels.some((p) => p.zoom);
  }

  // Work with uPlot's pen, within the axes and so much beyond; X, Y: places on its canvas; k: its pixels in one of CSS.
  pen(u, beyond, work) {
    const { ctx, bbox: b } = u, k = uPlot.pxRatio;
    ctx.save();
    ctx.beginPath();
    ctx.rect(b.left - beyond * k, b.top - beyond * k, b.width + 2 * beyond * k, b.height + 2 * beyond * k);
    ctx.clip();
    Object.assign(ctx, { font: font(k), textAlign: "left", textBaseline: "middle", lineWidth: k });
    work(ctx, b, (v) => u.valToPos(v, "x", true), (v) => u.valToPos(v, "y", true), k);
    ctx.restore();
  }

  below(u) { // spans, rules, maps, names
    const { spec } = this;
    this.pen(u, 0, (c, b, X, Y, k) => {
      c.fillStyle = colour("--accent");
      for (const [from, to, name] of spec.spans ?? []) {
        c.globalAlpha = 0.11;
        c.fillRect(X(from), b.top, Math.max(k, X(to) - X(from)), b.height);
        c.globalAlpha = 1;
        c.fillText(name, X(from) + 4 * k, b.top + 8 * k);
      }
      c.strokeStyle = colour("--soft");
      c.setLineDash([4 * k, 4 * k]);
      const { min, max } = u.scales.x, across = (r) => (r.x === undefined ? [[min, r.y], [max, r.y]] : [[r.x, u.scales.y.min], [r.x, u.scales.y.max]]);
      c.beginPath();
      for (const [p, q] of [...(spec.rules ?? []).map(across), ...(spec.equal ? [[[min, min], [max, max]]] : [])]) { c.moveTo(X(p[0]), Y(p[1])); c.lineTo(X(q[0]), Y(q[1])); }
      c.stroke();
      for (const s of this.shown()) if (s.kind === "map") this.map(c, s, X, Y, k);
    });
    this.pen(u, 1e4, (c, b, X, Y, k) => {
      c.fillStyle = colour("--soft");
      for (const s of this.shown()) if (s.kind === "map") this.bar(c, s, b, k);
      c.textAlign = "right";
      this.folded?.forEach((lines, i) => lines.forEach((line, j) => c.fillText(line, b.left - 7 * k, Y(i) + 14 * k * (j - (lines.length - 1) / 2))));
    });
  }

  above(u) { // points with their bars; bars of categories
    const shown = this.shown();
    this.pen(u, 4, (c, b, X, Y, k) => shown.forEach((s, n) => {
      c.strokeStyle = c.fillStyle = ink(s);
      if (s.kind === "points") this.points(c, s, X, Y, k);
      if (s.kind !== "bars") return;
      const thick = b.height / this.spec.y.names.length / (shown.length + 0.5), zero = this.spec.x.log ? b.left : X(0);
      s.x.forEach((v, i) => { if (v !== null) c.fillRect(Math.min(zero, X(v)), Y(s.y[i]) + (n - shown.length / 2) * thick, Math.max(k, Math.abs(X(v) - zero)), 0.88 * thick); });
    }));
  }

  points(c, s, X, Y, k) {
    const r = (s.size ?? 4) * k, dots = new Path2D(), errors = new Path2D(), joined = new Path2D();
    s.x.forEach((v, i) => {
      if (v === null || s.y[i] === null || (this.spec.y.log && s.y[i] <= 0)) return;
      const x = X(v), y = Y(s.y[i]), e = 2 * (s.s?.[i] ?? 0), low = Y(s.y[i] - e), high = Y(s.y[i] + e);
      if (s.joined) joined.lineTo(x, y);
      if (low - high > 2 * r) { errors.moveTo(x, low); errors.lineTo(x, high); }
      if (s.mark === "square") dots.rect(x - r, y - r, 2 * r, 2 * r);
      else if (s.mark === "triangle") { dots.moveTo(x, y - 1.25 * r); dots.lineTo(x + 1.2 * r, y + 0.85 * r); dots.lineTo(x - 1.2 * r, y + 0.85 * r); dots.closePath(); }
      else { dots.moveTo(x + r, y); dots.arc(x, y, r, 0, 7); }
    });
    c.lineWidth = 1.2 * k;
    c.stroke(errors);
    Object.assign(c, { globalAlpha: 0.7 }).setLineDash([3 * k, 3 * k]);
    c.stroke(joined);
    Object.assign(c, { globalAlpha: 1, lineWidth: 1.6 * k }).setLineDash([]);
    if (s.hollow) c.stroke(dots); else c.fill(dots);
  }

  // z[row][column] over the centres y, x; signed maps have white at zero.
  map(c, s, X, Y, k) {
    const table = s.signed ? SIGNED : VIRIDIS, [lo, hi] = s.limits, half = (a) => (a.length > 1 ? (a.at(-1) - a[0]) / (a.length - 1) / 2 : 0.5), up = !this.spec.y.names;
    const cells = new OffscreenCanvas(s.x.length, s.y.length), image = new ImageData(s.x.length, s.y.length);
    s.z.forEach((row, j) => row.forEach((v, i) => {
      if (v !== null) image.data.set([...shade(table, (v - lo) / (hi - lo || 1)), 255], 4 * ((up ? s.y.length - 1 - j : j) * s.x.length + i));
    }));
    cells.getContext("2d").putImageData(image, 0, 0);
    const [dx, dy] = [half(s.x), half(s.y)], a = X(s.x[0] - dx), [top, bottom] = [Y(s.y[0] - dy), Y(s.y.at(-1) + dy)].sort((p, q) => p - q);
    c.imageSmoothingEnabled = false;
    c.drawImage(cells, a, top, X(s.x.at(-1) + dx) - a, bottom - top);
    Object.assign(c, { fillStyle: "#000", strokeStyle: "#fff" }).setLineDash([]);
    for (const [i, j] of s.dots ?? []) { c.beginPath(); c.arc(X(s.x[i]), Y(s.y[j]), 3 * k, 0, 7); c.fill(); c.stroke(); }
  }

  bar(c, s, b, k) { // of the colours of a map, at its right
    const strip = c.createLinearGradient(0, b.top + b.height, 0, b.top), table = s.signed ? SIGNED : VIRIDIS, [lo, hi] = s.limits, x = b.left + b.width + 10 * k;
    table.forEach((shade, i) => strip.addColorStop(i / (table.length - 1), shade));
    for (const part of [0, 0.5, 1]) c.fillText(said(lo + part * (hi - lo), 3), x + 13 * k, b.top + (1 - part) * b.height);
    c.fillStyle = strip;
    c.fillRect(x, b.top, 9 * k, b.height);
  }

  // --- reading values ---
  places() { // what can be read: [x, y in px, series, index]
    const { u } = this, X = (v) => u.valToPos(v, "x"), Y = (v) => u.valToPos(v, "y");
    return this.shown().flatMap((s) => (s.kind === "map" ? s.z.flatMap((row, j) => row.map((_, i) => [X(s.x[i]), Y(s.y[j]), s, i, j]))
      : s.x.map((v, i) => [v === null || s.y[i] === null ? NaN : X(v), Y(s.y[i]), s, i])))
      .filter(([a, b]) => a >= -1 && a <= u.over.clientWidth + 1 && b >= -4 && b <= u.over.clientHeight + 4);
  }

  read(px, py) {
    const all = this.places(), off = this.along() ? ([a, b]) => Math.abs(a - px) + 1e-3 * Math.abs(b - py) : ([a, b]) => Math.hypot(a - px, b - py);
    return all.length ? all.reduce((best, p) => (off(p) < off(best) ? p : best)) : null;
  }

  show(place) {
    this.cursor = place;
    this.tip.textContent = "";
    this.ring.hidden = !place;
    if (!place) { this.u?.setCursor({ left: -10, top: -10 }, false); return; }
    const [px, py, series, i, j] = place, { spec } = this;
    const value = (s, k) => `${s.name} ${said(s.y[k])}${s.s?.[k] ? ` ± ${said(s.s[k], 2)}` : ""} ${spec.y.unit ?? ""}`.trim();
    const where = (axis, v) => (axis.names ? axis.names[v] : `${axis.label} ${said(v)} ${axis.unit ?? ""}`.trim());
    let text;
    if (series.kind === "map") text = `${where(spec.x, series.x[i])}, ${where(spec.y, series.y[j])}: ${said(series.z[j][i])} ${series.unit ?? ""}`;
    else if (series.kind === "bars") text = `${spec.y.names[series.y[i]]}: ${series.name} ${said(series.x[i])} ${spec.x.unit ?? ""}${series.label ? `, ${series.label[i]}` : ""}`;
    else if (this.along()) {
      const here = this.shown().map((s) => [s, nearest(s.x, series.x[i])]).filter(([s, k]) => k >= 0 && Math.abs(this.u.valToPos(s.x[k], "x") - px) < 4);
      text = `${where(spec.x, series.x[i])}: ${here.map(([s, k]) => value(s, k)).join(", ")}`;
    } else text = `${series.label ? `${series.label[i]}: ` : ""}${where(spec.x, series.x[i])}, ${value(series, i)}`;
    this.tip.textContent = text;
    Object.assign(this.ring.style, { left: `${px}px`, top: `${py}px` });
    this.u.setCursor({ left: px, top: py }, false);
  }

  move(u) {
    const { left, top } = u.cursor, found = left < 0 ? null : this.read(left, top);
    const far = found && !this.along() && found[2].kind === "points" && Math.hypot(found[0] - left, found[1] - top) > NEAR;
    this.chart.point(this, far ? null : found);
  }

  taken(u) { // a part that was drawn with the pointer
    const { left, top, width, height } = u.select, { clientHeight } = u.over, zoom = { x: [left, left + width].map((v) => u.posToVal(v, "x")) };
    if (width < 8) return;
    if (!this.along() && !this.spec.y.names && height > 24 && height < clientHeight) zoom.y = [top + height, top].map((v) => u.posToVal(v, "y"));
    this.chart.range(this, zoom);
  }

  key(e) {
    const all = this.places().sort((p, q) => p[0] - q[0] || p[1] - q[1]), w = this.u.over.clientWidth;
    const now = this.cursor ? all.findIndex((p) => p[2] === this.cursor[2] && p[3] === this.cursor[3] && p[4] === this.cursor[4]) : -1;
    const step = { ArrowRight: 1, ArrowLeft: -1, PageDown: 20, PageUp: -20 }[e.key];
    if (step && all.length) this.chart.point(this, all[now < 0 ? 0 : Math.min(Math.max(now + step, 0), all.length - 1)]);
    else if ((e.key === "+" || e.key === "-") && !this.spec.x.names) {
      const middle = this.cursor?.[0] ?? w / 2, half = (w / 2) * (e.key === "+" ? 0.6 : 1 / 0.6);
      this.chart.range(this, { x: [middle - half, middle + half].map((v) => this.u.posToVal(v, "x")) });
    } else if (e.key === "0" || e.key === "Escape") this.chart.range(this, null);
    else return;
    e.preventDefault();
  }
}

function nearest(x, v) { return x.reduce((best, u, i) => (u !== null && (best < 0 || Math.abs(u - v) < Math.abs(x[best] - v)) ? i : best), -1); }

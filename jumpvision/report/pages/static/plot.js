"use strict";
// The report's figures: a small SVG plotter. Point or tap to read values, drag to zoom, legend to hide; arrows, +, - and
// 0 do the same from the keyboard. What is drawn lies in the page as JSON (see charts.py) and in the table behind.
const ROLES = { measured: "--measured", model: "--model", accent: "--accent", green: "--green", amber: "--amber", sky: "--sky", quiet: "--soft", ink: "--ink" };
const VIRIDIS = ["#440154", "#482878", "#3e4a89", "#31688e", "#26828e", "#1f9e89", "#35b779", "#6ece58", "#b5de2b", "#fde725"];
const SIGNED = ["#2166ac", "#67a9cf", "#d1e5f0", "#f7f7f7", "#fddbc7", "#ef8a62", "#b2182b"];
const PAD = { left: 62, right: 12, top: 8, bottom: 40 };
const NEAR = 40; // px from the pointer within which a point is read

const esc = (s) => String(s).replace(/[&<>"]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[c]);
const said = (v, digits = 4) => (v === null || v === undefined ? "–" : String(Number(v.toPrecision(digits))).replace("-", "−"));
const words = (axis) => (axis.unit ? `${axis.label} [${axis.unit}]` : axis.label);
const tags = (series) => series.tags ?? [series.name]; // what the legend can hide
const paint = (series) => `var(${ROLES[series.role] ?? "--ink"})`;
const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));

function shade(table, share) {
  const place = Math.min(Math.max(share, 0), 1) * (table.length - 1), i = Math.min(Math.floor(place), table.length - 2);
  const a = rgb(table[i]), b = rgb(table[i + 1]);
  return a.map((v, k) => Math.round(v + (place - i) * (b[k] - v)));
}

function scale(lo, hi, from, to, log) {
  const f = log ? Math.log10 : (v) => v, k = (to - from) / (f(hi) - f(lo));
  const at = (v) => from + (f(v) - f(lo)) * k;
  at.back = (p) => { const v = f(lo) + (p - from) / k; return log ? 10 ** v : v; };
  at.ticks = (n) => (log ? decades(lo, hi) : ticks(lo, hi, n));
  return at;
}

function ticks(lo, hi, n) { // about n of them, three at least
  const few = steps(lo, hi, n);
  return few.length > 2 ? few : steps(lo, hi, 2 * n + 1);
}

function steps(lo, hi, n) {
  const raw = (hi - lo) / Math.max(n, 1), power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw * 0.999), out = [];
  for (let v = Math.ceil(lo / step - 1e-9) * step; v <= hi + 1e-9 * step; v += step) out.push(Math.abs(v) < step * 1e-9 ? 0 : v);
  return out;
}

function decades(lo, hi) {
  const out = [], fine = hi / lo < 20 ? [1, 2, 5] : [1];
  for (let e = Math.floor(Math.log10(lo)); e <= Math.log10(hi); e++) for (const m of fine) out.push(m * 10 ** e);
  return out.filter((v) => v >= lo * 0.999 && v <= hi * 1.001);
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
    this.categories = spec.y.names ? spec.y.names.length : 0;
    this.plot.onpointermove = (e) => this.move(e);
    this.plot.onpointerdown = (e) => this.press(e);
    this.plot.onpointerup = (e) => this.release(e);
    this.plot.onpointerleave = () => { if (!this.drag) this.chart.point(this, null); };
    this.plot.ondblclick = () => this.chart.range(this, null);
    this.plot.onkeydown = (e) => this.key(e);
  }

  shown() { return this.spec.series.filter((s) => !tags(s).some((t) => this.chart.hidden.has(t))); }

  // Smallest ranges of x and y that hold what is shown, with a margin.
  extent() {
    const range = (axis, of) => {
      if (axis.names) return [-0.5, axis.names.length - 0.5];
      let lo = Infinity, hi = -Infinity;
      for (const s of this.shown()) {
        for (const [i, v] of s[of].entries()) {
          if (v === null || (axis.log && v <= 0)) continue;
          const e = of === "y" && s.s && s.kind !== "band" ? 2 * (s.s[i] ?? 0) : 0;
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

  draw() {
    const { spec } = this, w = Math.max(this.plot.clientWidth, 200), map = spec.series.find((s) => s.kind === "map");
    const left = spec.y.names ? Math.min(0.42 * w, 14 + 6.6 * Math.max(...spec.y.names.map((n) => n.length))) : PAD.left;
    const folded = spec.y.names?.map((n) => folds(n, Math.floor((left - 10) / 6.6))), tall = Math.max(26, 14 * Math.max(0, ...(folded ?? []).map((f) => f.length)) + 6);
    const h = this.categories && !map ? 46 + this.categories * Math.max(tall, 26 * this.shown().length * 0.7) : spec.height ?? 270;
    const slant = spec.x.names && (w - left) / spec.x.names.length < 90, right = map ? 66 : PAD.right, [fx, fy] = this.extent(), [x0, x1] = this.zoom?.x ?? fx, [y0, y1] = this.zoom?.y ?? fy;
    const x = (this.x = scale(x0, x1, left, w - right, spec.x.log)), top = PAD.top, bottom = h - (slant ? 84 : PAD.bottom);
    const y = (this.y = spec.y.names ? scale(-0.5, this.categories - 0.5, top, bottom) : scale(y0, y1, bottom, top, spec.y.log));
    Object.assign(this, { w, h, left, right: w - right, top, bottom });
    const xt = spec.x.names ? spec.x.names.map((n, i) => [i, n]) : x.ticks(Math.max(2, (w - left) / 75)).map((v) => [v, said(v)]);
    const yt = spec.y.names ? spec.y.names.map((n, i) => [i, n]) : y.ticks((bottom - top) / 40).map((v) => [v, said(v)]);
    const out = [];
    for (const [v] of spec.x.names ? [] : xt) out.push(`<path class="grid" d="M${x(v)} ${top}V${bottom}"/>`);
    for (const [v] of spec.y.names ? [] : yt) out.push(`<path class="grid" d="M${left} ${y(v)}H${w - right}"/>`);
    for (const [v, n] of xt) out.push(`<text transform="translate(${x(v)} ${bottom + 16})${slant ? " rotate(-35)" : ""}" text-anchor="${slant ? "end" : "middle"}">${esc(n)}</text>`);
    for (const [v, n] of yt) {
      const lines = folded?.[v] ?? [n], first = y(v) + 4 - 7 * (lines.length - 1);
      out.push(`<text text-anchor="end">${lines.map((line, i) => `<tspan x="${left - 7}" y="${first + 14 * i}">${esc(line)}</tspan>`).join("")}<title>${esc(n)}</title></text>`);
    }
    out.push(`<text class="axis" x="${(left + w - right) / 2}" y="${h - 4}" text-anchor="middle">${esc(words(spec.x))}</text>`);
    if (!spec.y.names) out.push(`<text class="axis" transform="translate(12 ${(top + bottom) / 2}) rotate(-90)" text-anchor="middle">${esc(words(spec.y))}</text>`);
    const clip = `clip${(Panel.count = (Panel.count ?? 0) + 1)}`;
    out.push(`<clipPath id="${clip}"><rect x="${left}" y="${top - 3}" width="${w - right - left}" height="${bottom - top + 6}"/></clipPath><g clip-path="url(#${clip})">`);
    for (const [a, b, name] of spec.spans ?? []) {
      out.push(`<rect class="span" x="${x(a)}" y="${top}" width="${Math.max(1, x(b) - x(a))}" height="${bottom - top}"/>`);
      if (name) out.push(`<text class="spanname" x="${x(a) + 4}" y="${top + 12}">${esc(name)}</text>`);
    }
    if (spec.equal) out.push(`<path class="rule" d="M${x(x0)} ${y(x0)}L${x(x1)} ${y(x1)}"/>`);
    for (const r of spec.rules ?? []) out.push(r.x === undefined ? `<path class="rule" d="M${left} ${y(r.y)}H${w - right}"/>` : `<path class="rule" d="M${x(r.x)} ${top}V${bottom}"/>`);
    this.shown().forEach((s, i, all) => out.push(this[s.kind](s, i, all.length)));
    out.push(`</g><g class="cursor"></g>`);
    if (map) out.push(this.bar(map));
    this.plot.innerHTML = `<svg viewBox="0 0 ${w} ${h}" width="${w}" height="${h}" aria-hidden="true">${out.join("")}</svg>`;
    this.marks = this.plot.querySelector(".cursor");
    this.chart.reset.hidden = !this.chart.panels.some((p) => p.zoom);
  }

  path(s, up = 0) {
    let d = "", pen = "M";
    s.x.forEach((v, i) => {
      const u = s.y[i] === null ? null : s.y[i] + up * (s.s?.[i] ?? 0);
      if (v === null || u === null || (this.spec.y.log && u <= 0)) { pen = "M"; return; }
      d += `${pen}${this.x(v).toFixed(1)} ${this.y(u).toFixed(1)}`;
      pen = "L";
    });
    return d;
  }

  line(s) { return (s.s ? this.band(s) : "") + `<path class="line" style="stroke:${paint(s)}" stroke-dasharray="${s.dash ? "6 4" : ""}" d="${this.path(s)}"/>`; }

  band(s) { // y +- 2 s
    const keep = s.x.map((_, i) => i).filter((i) => s.x[i] !== null && s.y[i] !== null);
    const cut = { x: keep.map((i) => s.x[i]), y: keep.map((i) => s.y[i]), s: keep.map((i) => s.s[i]) };
    const back = Object.fromEntries(Object.entries(cut).map(([k, v]) => [k, v.toReversed()]));
    return `<path class="band" style="fill:${paint(s)}" d="${this.path(cut, 2)}${this.path(back, -2).replace("M", "L")}Z"/>`;
  }

  points(s) {
    const r = s.size ?? 4, marks = { square: `M-${r} -${r}h${2 * r}v${2 * r}h-${2 * r}z`, triangle: `M0 -${1.25 * r}l${1.2 * r} ${2.1 * r}h-${2.4 * r}z`,
      circle: `M-${r} 0a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 -${2 * r} 0` };
    let bars = "", d = "";
    s.x.forEach((v, i) => {
      if (v === null || s.y[i] === null || (this.spec.y.log && s.y[i] <= 0)) return;
      const px = this.x(v), e = 2 * (s.s?.[i] ?? 0), low = this.y(s.y[i] - e), high = this.y(s.y[i] + e);
      if (Math.abs(high - low) > 2 * r) bars += `M${px.toFixed(1)} ${low.toFixed(1)}V${high.toFixed(1)}`;
      d += (marks[s.mark] ?? marks.circle).replace(/^M(\S+) (\S+?)(?=[a-z])/, (_, a, b) => `M${(px + Number(a)).toFixed(1)} ${(this.y(s.y[i]) + Number(b)).toFixed(1)}`);
    });
    const look = s.hollow ? `fill:none;stroke:${paint(s)}` : `fill:${paint(s)}`;
    const joined = s.joined ? `<path class="joined" style="stroke:${paint(s)}" d="${this.path(s)}"/>` : "";
    return `${joined}<path class="errors" style="stroke:${paint(s)}" d="${bars}"/><path class="dots" style="${look}" d="${d}"/>`;
  }

  bars(s, k, n) {
    const thick = (this.bottom - this.top) / this.categories / (n + 0.5), zero = this.spec.x.log ? this.left : this.x(0);
    return s.x.map((v, i) => {
      if (v === null) return "";
      const a = Math.min(zero, this.x(v)), b = Math.max(zero, this.x(v)), place = this.y(s.y[i]) + (k - n / 2) * thick;
      return `<rect style="fill:${paint(s)}" x="${a}" y="${place}" width="${Math.max(1, b - a)}" height="${0.88 * thick}"/>`;
    }).join("");
  }

  // z[row][column] over the centres y, x; signed maps have white at zero.
  map(s) {
    const table = s.signed ? SIGNED : VIRIDIS, [lo, hi] = s.limits, step = (a) => (a.length > 1 ? (a.at(-1) - a[0]) / (a.length - 1) : 1);
    const canvas = document.createElement("canvas"), up = !this.spec.y.names;
    [canvas.width, canvas.height] = [s.x.length, s.y.length];
    const c = canvas.getContext("2d"), image = c.createImageData(s.x.length, s.y.length);
    s.z.forEach((row, j) => row.forEach((v, i) => {
      if (v !== null) image.data.set([...shade(table, (v - lo) / (hi - lo || 1)), 255], 4 * ((up ? s.y.length - 1 - j : j) * s.x.length + i));
    }));
    c.putImageData(image, 0, 0);
    const [dx, dy] = [step(s.x) / 2, step(s.y) / 2], a = this.x(s.x[0] - dx), b = this.x(s.x.at(-1) + dx);
    const ends = [this.y(s.y[0] - dy), this.y(s.y.at(-1) + dy)].sort((p, q) => p - q);
    const picture = `<image x="${a}" y="${ends[0]}" width="${b - a}" height="${ends[1] - ends[0]}" preserveAspectRatio="none" style="image-rendering:pixelated" href="${canvas.toDataURL()}"/>`;
    return picture + (s.dots ?? []).map(([i, j]) => `<circle cx="${this.x(s.x[i])}" cy="${this.y(s.y[j])}" r="3" fill="#000" stroke="#fff"/>`).join("");
  }

  bar(s) {
    const table = s.signed ? SIGNED : VIRIDIS, x = this.right + 10, high = this.bottom - this.top, n = 48, out = [];
    for (let i = 0; i < n; i++) out.push(`<rect x="${x}" y="${this.top + (i * high) / n}" width="9" height="${high / n + 0.6}" fill="rgb(${shade(table, 1 - i / (n - 1))})"/>`);
    const at = scale(...s.limits, this.bottom, this.top);
    for (const v of at.ticks(4)) out.push(`<text x="${x + 13}" y="${at(v) + 4}">${said(v, 3)}</text>`);
    return out.join("");
  }

  // --- reading values ---
  places() { // [distance measure is in pixels] what can be read: [x, y, series, index]
    return this.shown().flatMap((s) => (s.kind === "map"
      ? s.z.flatMap((row, j) => row.map((_, i) => [this.x(s.x[i]), this.y(s.y[j]), s, i, j]))
      : s.x.map((v, i) => [v === null || s.y[i] === null ? NaN : this.x(v), this.y(s.y[i]), s, i])))
      .filter(([a, b]) => a >= this.left - 1 && a <= this.right + 1 && b >= this.top - 4 && b <= this.bottom + 4);
  }

  along() { return this.spec.series.some((s) => s.kind === "line"); } // read everything at one x

  read(px, py) {
    const all = this.places();
    if (!all.length) return null;
    const off = this.along() ? ([a, b]) => Math.abs(a - px) + 1e-3 * Math.abs(b - py) : ([a, b]) => Math.hypot(a - px, b - py);
    return all.reduce((best, p) => (off(p) < off(best) ? p : best));
  }

  show(place) {
    this.cursor = place;
    if (!this.marks) return;
    this.marks.innerHTML = "";
    this.tip.textContent = "";
    if (!place) return;
    const [px, py, series, i, j] = place, { spec } = this;
    const value = (s, k) => `${s.name} ${said(s.y[k])}${s.s?.[k] ? ` ± ${said(s.s[k], 2)}` : ""} ${spec.y.unit ?? ""}`.trim();
    const where = (axis, v) => (axis.names ? axis.names[v] : `${axis.label} ${said(v)} ${axis.unit ?? ""}`.trim());
    let text;
    if (series.kind === "map") text = `${where(spec.x, series.x[i])}, ${where(spec.y, series.y[j])}: ${said(series.z[j][i])} ${series.unit ?? ""}`;
    else if (series.kind === "bars") text = `${spec.y.names[series.y[i]]}: ${series.name} ${said(series.x[i])} ${spec.x.unit ?? ""}${series.label ? `, ${series.label[i]}` : ""}`;
    else if (this.along()) {
      const here = this.shown().map((s) => [s, nearest(s.x, series.x[i])]).filter(([s, k]) => k >= 0 && Math.abs(this.x(s.x[k]) - px) < 4);
      text = `${where(spec.x, series.x[i])}: ${here.map(([s, k]) => value(s, k)).join(", ")}`;
    } else text = `${series.label ? `${series.label[i]}: ` : ""}${where(spec.x, series.x[i])}, ${value(series, i)}`;
    this.tip.textContent = text;
    this.marks.innerHTML = (this.along() ? `<path d="M${px} ${this.top}V${this.bottom}"/>` : "") + `<circle cx="${px}" cy="${py}" r="6"/>`;
  }

  move(e) {
    const box = this.plot.getBoundingClientRect(), at = [e.clientX - box.left, e.clientY - box.top];
    if (this.drag && e.pointerType === "mouse") {
      const [a, b] = [this.drag[0], at[0]].sort((p, q) => p - q);
      this.marks.innerHTML = `<rect x="${a}" y="${this.top}" width="${b - a}" height="${this.bottom - this.top}"/>`;
      return;
    }
    const found = this.read(...at), far = found && !this.along() && found[2].kind === "points" && Math.hypot(found[0] - at[0], found[1] - at[1]) > NEAR;
    this.chart.point(this, far ? null : found);
  }

  press(e) {
    if (e.pointerType !== "mouse") { this.move(e); return; }
    const box = this.plot.getBoundingClientRect();
    this.drag = [e.clientX - box.left, e.clientY - box.top];
    this.plot.setPointerCapture(e.pointerId);
  }

  release(e) {
    if (!this.drag) return;
    const box = this.plot.getBoundingClientRect(), start = this.drag, end = [e.clientX - box.left, e.clientY - box.top];
    this.drag = null;
    if (Math.abs(end[0] - start[0]) < 8 || this.spec.x.names) { this.move(e); return; }
    const x = [start[0], end[0]].map(this.x.back).sort((p, q) => p - q), zoom = { x };
    if (!this.along() && !this.spec.y.names && Math.abs(end[1] - start[1]) > 24) zoom.y = [start[1], end[1]].map(this.y.back).sort((p, q) => p - q);
    this.chart.range(this, zoom);
  }

  key(e) {
    const all = this.places().sort((p, q) => p[0] - q[0] || p[1] - q[1]);
    const now = this.cursor ? all.findIndex((p) => p[2] === this.cursor[2] && p[3] === this.cursor[3] && p[4] === this.cursor[4]) : -1;
    const step = { ArrowRight: 1, ArrowLeft: -1, PageDown: 20, PageUp: -20 }[e.key];
    if (step && all.length) this.chart.point(this, all[now < 0 ? 0 : Math.min(Math.max(now + step, 0), all.length - 1)]);
    else if ((e.key === "+" || e.key === "-") && !this.spec.x.names) {
      const middle = this.cursor?.[0] ?? (this.left + this.right) / 2, half = ((this.right - this.left) / 2) * (e.key === "+" ? 0.6 : 1 / 0.6);
      this.chart.range(this, { x: [this.x.back(middle - half), this.x.back(middle + half)] });
    } else if (e.key === "0" || e.key === "Escape") this.chart.range(this, null);
    else return;
    e.preventDefault();
  }
}

function nearest(x, v) { return x.reduce((best, u, i) => (u !== null && (best < 0 || Math.abs(u - v) < Math.abs(x[best] - v)) ? i : best), -1); }

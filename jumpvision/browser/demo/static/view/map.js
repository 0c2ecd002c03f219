// The map of jump heights over (f, phase) with the current point; computed in the pauses of the page, coarse before fine.
import { heightOf } from "../physics/jump.js";
import { mm, number, t } from "../words.js";
import { colours, context, label, ticks } from "./draw.js";

const LEFT = 40, RIGHT = 58, TOP = 6, BOTTOM = 34;
const PASSES = { hard: [24, 120], granular: [12, 36] }; // points each way of each pass
const SLICE = 8; // ms of computing at a time, so that a control is answered at once
const spaced = (lo, hi, n) => Array.from({ length: n }, (_, i) => lo + ((i + 0.5) / n) * (hi - lo));

export class HeightMap {
  constructor(canvas, note, pick) {
    Object.assign(this, { canvas, note, point: null, heights: null, run: 0, hover: null });
    this.phase = [0, 2 * Math.PI];
    const place = (e) => {
      const box = canvas.getBoundingClientRect(), [lo, hi] = this.frequency;
      const u = (e.clientX - box.left - LEFT) / (box.width - LEFT - RIGHT), v = 1 - (e.clientY - box.top - TOP) / (box.height - TOP - BOTTOM);
      return u < 0 || u > 1 || v < 0 || v > 1 ? null : [lo + u * (hi - lo), v * 2 * Math.PI];
    };
    canvas.onclick = (e) => { const p = this.frequency && place(e); if (p) pick(...p); };
    canvas.onpointermove = (e) => { this.hover = this.frequency && place(e); this.say(); };
    canvas.onpointerleave = () => { this.hover = null; this.say(); };
    canvas.onkeydown = (e) => {
      const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowDown: [0, -1], ArrowUp: [0, 1] }[e.key];
      if (!step || !this.point) return;
      e.preventDefault();
      const [lo, hi] = this.frequency, turn = 2 * Math.PI;
      const f = Math.min(Math.max(this.point[0] + step[0] * 0.1, lo), hi);
      pick(f, Math.min(Math.max(this.point[1] + step[1] * turn / 100, 0), turn));
    };
  }

  // Nothing known: the map of other ground is not shown.
  forget() {
    this.run++;
    this.heights = this.image = this.top = this.point = null;
    this.progress = "";
    this.draw();
    this.say();
  }

  // Computes the whole map; a later call makes an earlier one stop.
  async refresh(question, frequency) {
    const run = ++this.run;
    this.frequency = frequency;
    for (const n of PASSES[question.ground]) {
      const f = spaced(...frequency, n), phases = spaced(...this.phase, n);
      const heights = Array.from(f, (x) => phases.map((p) => (this.heights ? this.value(x, p) : null)));
      let began = performance.now();
      for (let i = 0; i < n; i++) {
        for (let j = 0; j < n; j++) {
          heights[i][j] = height(question, f[i], phases[j]);
          if (performance.now() - began < SLICE) continue;
          this.say(t("map_part", { n, part: Math.round((100 * (i * n + j)) / (n * n)) }));
          await new Promise((go) => setTimeout(go, SLICE));
          if (run !== this.run) return;
          began = performance.now();
        }
      }
      this.heights = heights;
      this.paint();
      this.draw();
      this.say(t("map_done", { n }));
    }
  }

  value(f, phase) {
    const n = this.heights.length, [lo, hi] = this.frequency;
    const i = Math.min(Math.floor(((f - lo) / (hi - lo)) * n), n - 1), j = Math.min(Math.floor((phase / (2 * Math.PI)) * n), n - 1);
    return this.heights[i][j];
  }

  say(progress = this.progress) {
    this.progress = progress;
    let text = progress || "";
    if (this.hover && this.heights) {
      const v = this.value(...this.hover);
      text = `${number(this.hover[0], 2)} Hz, ${number(this.hover[1] / Math.PI, 2)} π: ${v === null ? t("unknown") : mm(v)}`;
    }
    if (this.note.textContent !== text) this.note.textContent = text;
  }

  paint() {
    const n = this.heights.length;
    this.top = Math.max(1e-4, ...this.heights.flat().filter((v) => v !== null));
    this.image = Object.assign(document.createElement("canvas"), { width: n, height: n });
    const c = this.image.getContext("2d"), data = c.createImageData(n, n);
    this.heights.forEach((column, i) => column.forEach((v, j) => {
      const colour = v === null ? [128, 128, 128] : this.table[Math.round(255 * Math.max(0, v) / this.top)];
      data.data.set([...colour, 255], 4 * ((n - 1 - j) * n + i));
    }));
    c.putImageData(data, 0, 0);
  }

  draw() {
    if (!this.frequency) return;
    const { c, w, h } = context(this.canvas), ink = colours();
    const W = w - LEFT - RIGHT, H = h - TOP - BOTTOM, [lo, hi] = this.frequency;
    const x = (f) => LEFT + ((f - lo) / (hi - lo)) * W, y = (p) => TOP + (1 - p / (2 * Math.PI)) * H;
    if (this.image) {
      c.imageSmoothingEnabled = this.image.width < 150;
      c.drawImage(this.image, LEFT, TOP, W, H);
    } else {
      c.fillStyle = ink.line;
      c.fillRect(LEFT, TOP, W, H);
    }
    c.fillStyle = ink.soft;
    c.textBaseline = "middle";
    c.textAlign = "center";
    for (const f of ticks(lo, hi, 5)) c.fillText(label(f), x(f), h - BOTTOM + 10);
    c.fillText(t("map_axis"), LEFT + W / 2, h - 7);
    c.textAlign = "right";
    for (const [p, text] of [[0, "0"], [0.5, "π/2"], [1, "π"], [1.5, "3π/2"], [2, "2π"]]) {
      c.fillText(text, LEFT - 6, Math.min(Math.max(y(p * Math.PI), TOP + 6), TOP + H - 4));
    }
    if (this.f0 > lo && this.f0 < hi) {
      for (const [colour, width, dash] of [["#0006", 3, []], ["#fff", 1, [3, 4]]]) { // seen on dark and on bright
        c.strokeStyle = colour;
        c.lineWidth = width;
        c.setLineDash(dash);
        c.beginPath(); c.moveTo(x(this.f0), TOP); c.lineTo(x(this.f0), TOP + H); c.stroke();
      }
      c.setLineDash([]);
      c.textAlign = "left";
      c.fillStyle = "#0008";
      c.fillRect(x(this.f0) + 2, TOP + 1, 18, 16);
      c.fillStyle = "#fff";
      c.fillText("f₀", x(this.f0) + 4, TOP + 9);
    }
    if (this.top) { // colour bar
      const left = w - RIGHT + 10;
      for (let i = 0; i < H; i++) {
        c.fillStyle = `rgb(${this.table[Math.round(255 * (1 - i / H))]})`;
        c.fillRect(left, TOP + i, 8, 1.5);
      }
      c.textAlign = "left";
      c.fillStyle = ink.soft;
      for (const v of ticks(0, this.top * 1e3, 4)) c.fillText(label(v), left + 13, Math.min(TOP + H * (1 - v / (this.top * 1e3)), TOP + H - 4));
      c.fillText("mm", left, h - BOTTOM + 10);
    }
    if (this.point) {
      const [f, p] = this.point, turn = 2 * Math.PI;
      const px = Math.min(Math.max(x(f), LEFT), LEFT + W), py = y(((p % turn) + turn) % turn || (p ? turn : 0));
      for (const [colour, width] of [["#000", 4], ["#fff", 2]]) {
        c.strokeStyle = colour;
        c.lineWidth = width;
        c.beginPath(); c.arc(px, py, 6, 0, 7); c.stroke();
      }
      c.lineWidth = 1;
    }
  }
}

// Height of the map's point [m]; null where the motion cannot be followed.
function height(question, frequency, phase) {
  const actuation = { ...question.set.actuation, frequency, phase };
  try {
    const h = heightOf({ ...question, set: { ...question.set, actuation } });
    return Number.isFinite(h) ? h : null;
  } catch { return null; }
}

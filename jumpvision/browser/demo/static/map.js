// The map of jump heights over frequency and phase with the present point; computed in the pauses of the page, coarse
// before fine.
import { page } from "./made.js";
import { colours, context, label, mm, numberText, ticks } from "./draw.js";
import { mapHeight } from "./physics.js";

const MAP_LEFT = 40, MAP_RIGHT = 58, MAP_TOP = 6, MAP_BOTTOM = 34; // px
const TURN = 2 * Math.PI;
const PASSES = { hard: [24, 72], granular: [12, 36] }; // points each way of each pass
const SLICE = 8; // ms of computing at a time, so that a control is answered at once
const KEYS = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowDown: [0, -TURN / 100], ArrowUp: [0, TURN / 100] }; // Hz, rad
const clipped = (v, lo, hi) => Math.min(Math.max(v, lo), hi);

export class HeightMap {
  // frequency: least and greatest [Hz]; pick(frequency [Hz], phase [rad])
  constructor(canvas, note, frequency, pick) {
    Object.assign(this, { canvas, note, frequency, point: null, heights: null, run: 0, hover: null, progress: "" });
    const place = (e) => {
      const box = canvas.getBoundingClientRect(), [lo, hi] = frequency;
      const u = (e.clientX - box.left - MAP_LEFT) / (box.width - MAP_LEFT - MAP_RIGHT), v = 1 - (e.clientY - box.top - MAP_TOP) / (box.height - MAP_TOP - MAP_BOTTOM);
      return u < 0 || u > 1 || v < 0 || v > 1 ? null : [lo + u * (hi - lo), v * TURN];
    };
    const hover = (to) => { this.hover = to; this.say(); };
    canvas.onclick = (e) => { const p = place(e); if (p) pick(...p); };
    canvas.onpointermove = (e) => hover(place(e));
    canvas.onpointerleave = () => hover(null);
    canvas.onkeydown = (e) => {
      const step = KEYS[e.key];
      if (!step) return;
      e.preventDefault();
      pick(clipped(this.point[0] + step[0], ...frequency), clipped(this.point[1] + step[1], 0, TURN));
    };
  }

  // Nothing known: the map of other ground is not shown.
  forget() {
    this.run++;
    this.heights = this.image = null;
    this.say("");
  }

  // Computes the whole map; a later call makes an earlier one stop.
  async refresh(ground, { robot, law }) {
    const run = ++this.run, [lo, hi] = this.frequency;
    for (const n of PASSES[ground]) {
      const heights = [];
      let began = performance.now();
      for (let i = 0; i < n * n; i++) { // one frequency after the other
        const frequency = lo + ((Math.floor(i / n) + 0.5) / n) * (hi - lo), phase = (((i % n) + 0.5) / n) * TURN;
        heights.push(mapHeight({ robot, law: { ...law, frequency, phase } }));
        if (performance.now() - began < SLICE) continue;
        this.say(`${n} × ${n} jumps: ${Math.round((100 * i) / (n * n))} %`);
        await new Promise((go) => setTimeout(go, SLICE));
        if (run !== this.run) return;
        began = performance.now();
      }
      Object.assign(this, { n, heights, highest: Math.max(1e-4, ...heights) });
      this.paint();
      this.draw();
      this.say(`${n} × ${n} jumps`);
    }
  }

  say(progress = this.progress) {
    this.progress = progress;
    let text = progress;
    if (this.hover && this.heights) {
      const [f, phase] = this.hover, [lo, hi] = this.frequency, cell = (share) => Math.min(Math.floor(share * this.n), this.n - 1);
      const height = this.heights[cell((f - lo) / (hi - lo)) * this.n + cell(phase / TURN)];
      text = `${numberText(f, 2)} Hz, ${numberText(phase / Math.PI, 2)} π: ${mm(height)}`;
    }
    if (this.note.textContent !== text) this.note.textContent = text;
  }

  paint() {
    const { n } = this;
    this.image = Object.assign(document.createElement("canvas"), { width: n, height: n });
    const c = this.image.getContext("2d"), data = c.createImageData(n, n);
    this.heights.forEach((v, i) => {
      const colour = page.colours[Math.round((255 * Math.max(0, v)) / this.highest)];
      data.data.set([...colour, 255], 4 * ((n - 1 - (i % n)) * n + Math.floor(i / n)));
    });
    c.putImageData(data, 0, 0);
  }

  draw() {
    const { c, w, h } = context(this.canvas), ink = colours(), W = w - MAP_LEFT - MAP_RIGHT, H = h - MAP_TOP - MAP_BOTTOM, [lo, hi] = this.frequency;
    const x = (f) => MAP_LEFT + ((f - lo) / (hi - lo)) * W, y = (phase) => MAP_TOP + (1 - phase / TURN) * H;
    const text = (said, align, px, py) => { c.textAlign = align; c.fillText(said, px, py); };
    const stroke = (colour, width) => { c.strokeStyle = colour; c.lineWidth = width; c.stroke(); };
    c.textBaseline = "middle";
    c.fillStyle = ink.line;
    if (this.image) c.drawImage(this.image, MAP_LEFT, MAP_TOP, W, H);
    else c.fillRect(MAP_LEFT, MAP_TOP, W, H);
    c.fillStyle = ink.soft;
    for (const f of ticks(lo, hi, 5)) text(label(f), "center", x(f), h - MAP_BOTTOM + 10);
    text("frequency [Hz]", "center", MAP_LEFT + W / 2, h - 7);
    ["0", "π/2", "π", "3π/2", "2π"].forEach((said, i) => text(said, "right", MAP_LEFT - 6, clipped(y((i * TURN) / 4), MAP_TOP + 6, MAP_TOP + H - 4)));
    if (this.image) { // colour bar
      const left = w - MAP_RIGHT + 10;
      for (let i = 0; i < H; i++) {
        c.fillStyle = `rgb(${page.colours[Math.round(255 * (1 - i / H))]})`;
        c.fillRect(left, MAP_TOP + i, 8, 1.5);
      }
      c.fillStyle = ink.soft;
      for (const v of ticks(0, this.highest * 1e3, 4)) text(label(v), "left", left + 13, Math.min(MAP_TOP + H * (1 - v / (this.highest * 1e3)), MAP_TOP + H - 4));
      text("mm", "left", left, h - MAP_BOTTOM + 10);
    }
    if (this.natural > lo && this.natural < hi) { // seen on dark and on bright
      c.beginPath(); c.moveTo(x(this.natural), MAP_TOP); c.lineTo(x(this.natural), MAP_TOP + H);
      stroke("#0006", 3);
      c.setLineDash([3, 4]);
      stroke("#fff", 1);
      c.setLineDash([]);
      c.fillStyle = "#0008";
      c.fillRect(x(this.natural) + 2, MAP_TOP + 1, 18, 16);
      c.fillStyle = "#fff";
      text("f₀", "left", x(this.natural) + 4, MAP_TOP + 9);
    }
    if (!this.point) return;
    c.beginPath(); c.arc(x(this.point[0]), y(this.point[1]), 6, 0, 7);
    stroke("#000", 4);
    stroke("#fff", 2);
  }
}

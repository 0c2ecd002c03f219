// Heights, motor and forces against time, with a play-head and a read-out at the pointer; dragging moves the time.
import { at, colours, context, label, numberText, ticks } from "./draw.js";

const LEFT = 46, RIGHT = 8, TOP = 4, BOTTOM = 24, TITLE = 22; // px
const PANELS = [ // title, unit, shown per SI unit, columns of the motion
  ["Rise of the rod", "mm", 1e3, ["rod"]],
  ["Height of the foot", "mm", 1e3, ["foot"]],
  ["Motor on the rod", "mm", 1e3, ["drive"]],
  ["Force", "N", 1, ["ground", "spring"]],
];

export class Traces {
  constructor(canvas, scrub) {
    this.canvas = canvas;
    this.pointer = null; // s
    const time = (e) => {
      const box = canvas.getBoundingClientRect(), share = (e.clientX - box.left - LEFT) / (box.width - LEFT - RIGHT), [lo, hi] = this.span;
      return lo + Math.min(Math.max(share, 0), 1) * (hi - lo);
    };
    canvas.onpointermove = (e) => {
      this.pointer = time(e);
      if (e.buttons & 1) scrub(this.pointer);
    };
    canvas.onpointerdown = (e) => scrub(time(e));
    canvas.onpointerleave = () => { this.pointer = null; };
  }

  draw(motion, t) {
    const { c, w, h } = context(this.canvas), ink = colours(), height = (h - TOP - BOTTOM) / PANELS.length;
    this.span = [motion.t[0], motion.t.at(-1)];
    const [lo, hi] = this.span, x = (v) => LEFT + ((v - lo) / (hi - lo)) * (w - LEFT - RIGHT), shown = this.pointer ?? t, now = at(motion, shown);
    const text = (said, align, px, y) => { c.textAlign = align; c.fillText(said, px, y); };
    const line = (points) => { c.beginPath(); for (const p of points) c.lineTo(...p); c.stroke(); };
    c.textBaseline = "middle";
    PANELS.forEach(([title, unit, factor, names], k) => {
      const top = TOP + k * height + TITLE, bottom = TOP + (k + 1) * height - 9, values = names.flatMap((n) => motion[n]);
      const low = Math.min(0, factor * Math.min(...values)), high = Math.max(low + 1e-3, factor * Math.max(...values));
      const y = (v) => bottom - ((v - low) / (high - low)) * (bottom - top);
      c.lineWidth = 1;
      c.strokeStyle = ink.line;
      c.fillStyle = ink.soft;
      for (const v of ticks(low, high, 3)) {
        const level = Math.round(y(v)) + 0.5;
        line([[LEFT, level], [w - RIGHT, level]]);
        text(label(v), "right", LEFT - 6, level);
      }
      for (const name of names) {
        c.strokeStyle = c.fillStyle = name === "ground" ? ink.soft : ink.mark;
        c.lineWidth = 1.6;
        c.setLineDash(name === "ground" ? [4, 3] : []);
        line(motion[name].map((v, i) => [x(motion.t[i]), y(v * factor)]));
        c.setLineDash([]);
        c.beginPath(); c.arc(x(shown), y(now[name] * factor), 3, 0, 7); c.fill();
      }
      c.fillStyle = ink.ink;
      text(title, "left", LEFT, top - TITLE / 2);
      c.fillStyle = ink.soft;
      const read = names.map((n) => `${names.length > 1 ? n : ""} ${numberText(now[n] * factor, 1)} ${unit}`.trim());
      text(read.join(", "), "right", w - RIGHT, top - TITLE / 2);
    });
    for (const v of ticks(lo, hi, Math.max(3, w / 110))) if (x(v) < w - RIGHT - 40) text(label(v * 1e3), "center", x(v), h - BOTTOM / 2);
    text("ms", "right", w - RIGHT, h - BOTTOM / 2);
    c.lineWidth = 1;
    c.strokeStyle = ink.soft;
    for (const v of [t, shown]) line([[x(v), TOP], [x(v), h - BOTTOM]]);
  }
}

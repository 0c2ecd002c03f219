// Rod height, motor, forces and power against time, with a play-head and a read-out at the pointer.
import { at, colours, context, label, ticks } from "./draw.js";
import { number, t as word } from "../words.js";

const LEFT = 46, RIGHT = 8, TOP = 4, BOTTOM = 24, TITLE = 22;

export class Traces {
  constructor(canvas, scrub) {
    this.canvas = canvas;
    this.pointer = this.dots = null; // dots: {t, x [m]} beside the rod, as a camera saw it
    const time = (e) => {
      const box = canvas.getBoundingClientRect();
      const share = (e.clientX - box.left - LEFT) / (box.width - LEFT - RIGHT);
      const [lo, hi] = this.span;
      return lo + Math.min(Math.max(share, 0), 1) * (hi - lo);
    };
    canvas.onpointermove = (e) => {
      if (!this.span) return;
      this.pointer = time(e);
      if (e.buttons & 1) scrub(this.pointer);
    };
    canvas.onpointerdown = (e) => { if (this.span) scrub(time(e)); };
    canvas.onpointerleave = () => { this.pointer = null; };
  }

  // The camera's dots in the time shown: [t, x], or [t, x less the model].
  seen(motion, less) {
    const model = { t: motion.t, rod: motion.rod }, rows = this.dots.t.map((s, i) => [s, this.dots.x[i]]);
    return rows.filter(([s]) => s >= motion.t[0] && s <= motion.t.at(-1)).map(([s, x]) => [s, less ? x - at(model, s).rod : x]);
  }

  draw(motion, t, ground) {
    const { c, w, h } = context(this.canvas), ink = colours();
    this.span = [motion.t[0], motion.t.at(-1)];
    const [lo, hi] = this.span, x = (v) => LEFT + ((v - lo) / (hi - lo)) * (w - LEFT - RIGHT);
    const force = [["spring", word("force_spring"), ink.mark, []]];
    if (ground === "granular") force.unshift(["ground", word("force_ground"), ink.soft, [4, 3]]);
    const panels = [
      [word("trace_rod"), "mm", 1e3, [["rod", "", ink.mark, []]]],
      [word("trace_foot"), "mm", 1e3, [["foot", "", ink.mark, []]]],
      [word("trace_drive"), "mm", 1e3, [["drive", "", ink.mark, []]]],
      [word("trace_force"), "N", 1, force],
      [word("trace_power"), "W", 1, [["power", "", ink.mark, []]]],
    ];
    if (this.dots) panels.splice(1, 0, [word("residual"), "mm", 1e3, []]);
    const height = (h - TOP - BOTTOM) / panels.length;
    const shown = this.pointer ?? t, now = at(motion, shown);
    panels.forEach(([title, unit, factor, lines], k) => {
      const top = TOP + k * height + TITLE, bottom = TOP + (k + 1) * height - 9;
      let low = 0, high = 0;
      for (const [name] of lines) for (const v of motion[name]) { low = Math.min(low, v * factor); high = Math.max(high, v * factor); }
      const dots = k < 2 && this.dots ? this.seen(motion, k === 1) : [];
      for (const [, v] of dots) { low = Math.min(low, v * factor); high = Math.max(high, v * factor); }
      if (high - low < 1e-6) high = low + 1;
      const y = (v) => bottom - ((v - low) / (high - low)) * (bottom - top);
      c.textBaseline = "middle";
      c.textAlign = "right";
      c.lineWidth = 1;
      for (const v of ticks(low, high, 3)) {
        c.strokeStyle = ink.line;
        c.beginPath(); c.moveTo(LEFT, Math.round(y(v)) + 0.5); c.lineTo(w - RIGHT, Math.round(y(v)) + 0.5); c.stroke();
        c.fillStyle = ink.soft;
        c.fillText(label(v), LEFT - 6, y(v));
      }
      for (const [name, , colour, dash] of lines) {
        c.strokeStyle = colour;
        c.lineWidth = 1.6;
        c.setLineDash(dash);
        c.beginPath();
        motion[name].forEach((v, i) => c.lineTo(x(motion.t[i]), y(v * factor)));
        c.stroke();
        c.setLineDash([]);
        c.fillStyle = colour;
        c.beginPath(); c.arc(x(shown), y(now[name] * factor), 3, 0, 7); c.fill();
      }
      c.fillStyle = ink.bad;
      for (const [s, v] of dots) { c.beginPath(); c.arc(x(s), y(v * factor), 1.8, 0, 7); c.fill(); }
      c.textAlign = "left";
      c.fillStyle = ink.ink;
      c.fillText(title, LEFT, top - TITLE / 2);
      if (dots.length) {
        const wide = c.measureText(title).width;
        c.fillStyle = ink.bad;
        c.fillText(`● ${word("dots")}`, LEFT + wide + 12, top - TITLE / 2);
      }
      c.textAlign = "right";
      const read = lines.map(([name, said]) => `${said} ${number(now[name] * factor, 1)} ${unit}`.trim());
      c.fillStyle = ink.soft;
      c.fillText(read.join(", "), w - RIGHT, top - TITLE / 2);
    });
    c.textAlign = "center";
    c.fillStyle = ink.soft;
    const places = ticks(lo, hi, Math.max(3, w / 110));
    for (const v of places) if (x(v) < w - RIGHT - 40) c.fillText(label(v * 1e3), x(v), h - BOTTOM / 2);
    c.textAlign = "right";
    c.fillText("ms", w - RIGHT, h - BOTTOM / 2);
    for (const [v, colour] of [[t, ink.ink], [shown, ink.soft]]) {
      c.strokeStyle = colour;
      c.globalAlpha = 0.6;
      c.lineWidth = 1;
      c.beginPath(); c.moveTo(x(v), TOP); c.lineTo(x(v), h - BOTTOM); c.stroke();
      c.globalAlpha = 1;
    }
  }
}

// A flow over the film: what is matched, a map, its vectors, the line of a profile, window and step at the pointer.
import { store, value } from "./store.js";

const DARK = "rgb(0 0 0 / .65)", RED = "#ff6b4a", LINE = "#ffffff";
const SIGNED = ["#2166ac", "#67a9cf", "#d1e5f0", "#f7f7f7", "#fddbc7", "#ef8a62", "#b2182b"], RISING = ["#440154", "#46327e", "#365c8d", "#277f8e", "#1fa187", "#4ac16d", "#a0da39", "#fde725"];
const BRIGHT = ["#8fd8ff", "#35d0a0", "#fde725", "#ffa45c", "#ff5a4a"]; // of arrows on a dark picture
const ZERO_IN_THE_MIDDLE = ["u", "v", "vorticity", "divergence"];
export const colours = (name) => (store.map === "vectors" ? BRIGHT : ZERO_IN_THE_MIDDLE.includes(name) ? SIGNED : RISING);

const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));
function coloured(list) { // a function from 0..1 to [r, g, b]
  const stops = list.map(rgb), n = stops.length - 1;
  return (s) => { const at = Math.max(0, Math.min(n, s * n)), i = Math.min(n - 1, Math.floor(at)), f = at - i; return stops[i].map((v, k) => Math.round(v + f * (stops[i + 1][k] - v))); };
}

// Ends of a colour bar: all but the outermost hundredth of the values; zero in the middle where they have a sign.
export function range(values, name) {
  const sorted = values.filter((v) => v !== null).sort((a, b) => a - b), n = sorted.length;
  if (!n) return [0, 1];
  const low = sorted[Math.floor(0.01 * (n - 1))], high = sorted[Math.ceil(0.99 * (n - 1))], most = Math.max(Math.abs(low), Math.abs(high)) || 1;
  return ZERO_IN_THE_MIDDLE.includes(name) ? [-most, most] : [Math.min(0, low), high > low ? high : low + 1];
}

let made = null; // the map of a flow as a picture, a pixel a vector
function map(flow) {
  if (made?.flow === flow) return made.image;
  const [low, high] = flow.range, of = coloured(colours(flow.name)), image = new OffscreenCanvas(flow.columns.length, flow.rows.length), pen = image.getContext("2d");
  const data = pen.createImageData(image.width, image.height);
  flow.values.forEach((v, i) => { if (v !== null) data.data.set([...of((v - low) / (high - low)), 225], 4 * i); });
  pen.putImageData(data, 0, 0);
  made = { flow, image };
  return image;
}

export function flowOver(pen, { toScreen, k }) {
  const flow = store.flow, gap = value("params.piv", "gap") ?? 1;
  if (store.lit && store.lit.frame === store.frame) {
    const [left, top, width, height] = store.lit.box, [x, y] = toScreen(left - 0.5, top - 0.5);
    pen.imageSmoothingEnabled = k < 2;
    pen.drawImage(store.lit.image, x, y, width * k, height * k);
  }
  if (flow && (flow.mean || (store.frame >= flow.frame && store.frame <= flow.frame + gap))) {
    const step = Math.abs((flow.columns[1] ?? flow.columns[0] + 8) - flow.columns[0]);
    if (store.map !== "vectors") {
      const [x, y] = toScreen(flow.columns[0] - step / 2, flow.rows[0] - step / 2);
      pen.imageSmoothingEnabled = false;
      pen.drawImage(map(flow), x, y, flow.columns.length * step * k, flow.rows.length * step * k);
    }
    arrows(pen, toScreen, flow, step);
  }
  if (store.pointer && store.step === "find" && store.grid) windows(pen, toScreen, k, flow);
  if (flow?.line) {
    const [a, b, c, d] = flow.line, from = toScreen(a, b), to = toScreen(c, d);
    for (const [colour, width] of [[DARK, 5], [LINE, 2]]) {
      pen.strokeStyle = colour; pen.lineWidth = width;
      pen.beginPath(); pen.moveTo(...from); pen.lineTo(...to); pen.stroke();
    }
    for (const [p, full] of [[from, true], [to, false]]) { // a full ring where it begins
      pen.beginPath(); pen.arc(...p, 6, 0, 7); pen.fillStyle = full ? LINE : DARK; pen.fill(); pen.lineWidth = 2; pen.strokeStyle = full ? DARK : LINE; pen.stroke();
    }
  }
}

function arrows(pen, toScreen, flow, step) {
  const good = (i) => flow.reasons[flow.reason[i]] === "", n = flow.columns.length, plain = store.map === "vectors";
  let longest = 1e-30;
  flow.u.forEach((a, i) => { if (a !== null && good(i)) longest = Math.max(longest, Math.hypot(a, flow.v[i])); });
  const scale = 1.6 * step / longest, of = coloured(BRIGHT), [low, high] = flow.range, groups = new Map();
  flow.u.forEach((u, i) => {
    if (!good(i) && !store.rejected) return;
    const shade = !good(i) ? RED : plain ? `rgb(${of(Math.round(12 * (Math.hypot(u, flow.v[i]) - low) / (high - low)) / 12)})` : "#101418";
    if (!groups.has(shade)) groups.set(shade, []);
    groups.get(shade).push(i);
  });
  pen.lineWidth = 1.4;
  for (const [shade, members] of groups) {
    pen.strokeStyle = shade;
    pen.beginPath();
    for (const i of members) {
      const c = flow.columns[i % n], r = flow.rows[Math.floor(i / n)], u = flow.u[i], v = flow.v[i], a = toScreen(c, r);
      if (u === null) { if (flow.reason[i]) { pen.moveTo(a[0] - 2, a[1] - 2); pen.lineTo(a[0] + 2, a[1] + 2); pen.moveTo(a[0] + 2, a[1] - 2); pen.lineTo(a[0] - 2, a[1] + 2); } continue; }
      const b = toScreen(c + u * scale, r - v * scale), angle = Math.atan2(b[1] - a[1], b[0] - a[0]), head = Math.min(5, 0.4 * Math.hypot(b[0] - a[0], b[1] - a[1]));
      pen.moveTo(...a); pen.lineTo(...b);
      pen.lineTo(b[0] - head * Math.cos(angle - 0.5), b[1] - head * Math.sin(angle - 0.5));
      pen.moveTo(...b); pen.lineTo(b[0] - head * Math.cos(angle + 0.5), b[1] - head * Math.sin(angle + 0.5));
    }
    pen.stroke();
  }
}

export function nearest(flow, c, r) { // the vector at a place of the film: its number, column and row; null outside
  const close = (list, v) => list.reduce((best, x, i) => (Math.abs(x - v) < Math.abs(list[best] - v) ? i : best), 0);
  const i = close(flow.columns, c), j = close(flow.rows, r), step = Math.abs((flow.columns[1] ?? 0) - flow.columns[0]) || 8;
  if (Math.abs(flow.columns[i] - c) > step || Math.abs(flow.rows[j] - r) > step) return null;
  return { at: j * flow.columns.length + i, column: flow.columns[i], row: flow.rows[j] };
}

function windows(pen, toScreen, k, flow) { // the window in its size, and the centres about it
  const size = value("params.piv", "window") ?? 24, step = value("params.piv", "step") ?? 8;
  const near = flow && nearest(flow, ...store.pointer), [c, r] = near ? [near.column, near.row] : store.pointer;
  const [x, y] = toScreen(c - size / 2, r - size / 2);
  for (const [colour, width] of [[DARK, 3], ["#ffe08a", 1.5]]) { pen.strokeStyle = colour; pen.lineWidth = width; pen.strokeRect(x, y, size * k, size * k); }
  for (let i = -2; i <= 2; i++) for (let j = -2; j <= 2; j++) {
    const p = toScreen(c + i * step, r + j * step);
    pen.fillStyle = DARK; pen.fillRect(p[0] - 2.5, p[1] - 2.5, 5, 5);
    pen.fillStyle = "#ffe08a"; pen.fillRect(p[0] - 1.5, p[1] - 1.5, 3, 3);
  }
}

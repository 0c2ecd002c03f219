// Under the film, on its clock: the height of the ball in the picture, lost frames, the logs. Drag to move the time, drag a
// log to move it against the film.
import { upward } from "./handles.js";
import { film, mine, on, placed, store, times, value } from "./store.js";
import { frameAt, seek } from "./player.js";
import { shiftLog } from "./check.js";

const canvas = document.getElementById("timeline"), pen = canvas.getContext("2d");
const LEFT = 74, RIGHT = 10, TOP = 6, AXIS = 20;
let due = false;

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const start = (log) => mine(log.section, "start") ?? value(log.section, "start") ?? log.start;

function span() { // of the film, with a tenth of it on either side for the logs
  const time = film() ? times() : [0], a = time[0], b = time.at(-1), pad = store.logs.length ? 0.1 * (b - a || 1) : 0;
  return [a - pad, (b > a ? b : a + 1) + pad];
}
function lanes(height) {
  const found = store.logs.filter((l) => l.t.length).map((log) => ({ log })), own = store.state?.films.some((f) => f.section === "rod_video") ? [{}] : [];
  const all = [...own, ...found], h = (height - TOP - AXIS) / all.length;
  return all.map((lane, i) => ({ ...lane, top: TOP + i * h, h }));
}

export function redraw() {
  if (due) return;
  due = true;
  requestAnimationFrame(() => { due = false; draw(); });
}

function draw() {
  canvas.hidden = !lanes(1).length; // a flow alone has nothing to show over time
  const f = film(), { width, height } = canvas.getBoundingClientRect(), dpr = devicePixelRatio || 1;
  if (!f || !width) return;
  canvas.width = Math.round(width * dpr);
  canvas.height = Math.round(height * dpr);
  pen.setTransform(dpr, 0, 0, dpr, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = "12px system-ui, sans-serif";
  const [a, b] = span(), x = (t) => LEFT + (t - a) / (b - a) * (width - LEFT - RIGHT);
  ticks(a, b, x, height);
  for (const lane of lanes(height)) {
    pen.fillStyle = colour("--soft");
    pen.fillText(lane.log ? lane.log.column.replace(/_m$/, " [m]") : millimetres() ? "ball [mm]" : "ball [px]", 6, lane.top + 14, LEFT - 10);
    pen.strokeStyle = colour("--line");
    pen.lineWidth = 1;
    pen.strokeRect(LEFT, lane.top, width - LEFT - RIGHT, lane.h);
    pen.save();
    pen.beginPath();
    pen.rect(LEFT, lane.top, width - LEFT - RIGHT, lane.h);
    pen.clip();
    if (lane.log) labels(lane, lane.log.y);
    if (lane.log) line(lane.log.t.map((t) => x(t + start(lane.log) - lane.log.start)), lane.log.y, lane, "--log", 1);
    else ball(x, lane);
    pen.restore();
  }
  pen.strokeStyle = colour("--ink");
  pen.lineWidth = 1.5;
  pen.beginPath();
  const now = x(times()[store.frame]);
  pen.moveTo(now, 0); pen.lineTo(now, height - AXIS);
  pen.stroke();
}

function labels(lane, ys, sign = 1) { // the ends of a lane; sign -1: rows, which count down
  const good = ys.filter((v) => v !== null), short = (v) => String(Number(v.toPrecision(3)));
  const ends = [Math.max(...good), Math.min(...good)], [high, low] = sign > 0 ? ends : [ends[1], ends[0]];
  pen.fillStyle = colour("--soft");
  if (lane.h > 26) { pen.fillText(short(high), LEFT + 4, lane.top + 13); pen.fillText(short(low), LEFT + 4, lane.top + lane.h - 5); }
}

function ticks(a, b, x, height) {
  const raw = (b - a) / 6, ten = 10 ** Math.floor(Math.log10(raw)), step = [1, 2, 5, 10].map((m) => m * ten).find((s) => s >= raw);
  const [unit, per] = step < 1e-3 ? ["µs", 1e6] : step < 1 ? ["ms", 1e3] : ["s", 1];
  pen.fillStyle = colour("--soft");
  pen.textAlign = "center";
  for (let t = Math.ceil(a / step) * step; t <= b; t += step) pen.fillText(String(Number((t * per).toPrecision(6))), x(t), height - 5);
  pen.textAlign = "left";
  pen.fillText(`time [${unit}]`, 6, height - 5);
}

function line(xs, ys, lane, name, sign) {
  const good = ys.filter((v) => v !== null), low = Math.min(...good), high = Math.max(...good), room = lane.h - 10;
  const y = (v) => lane.top + 5 + room * (high > low ? (sign > 0 ? high - v : v - low) / (high - low) : 0.5);
  pen.strokeStyle = colour(name);
  pen.lineWidth = 1.5;
  pen.beginPath();
  let open = false;
  ys.forEach((v, i) => {
    if (v === null) { open = false; return; }
    if (open) pen.lineTo(xs[i], y(v)); else { pen.moveTo(xs[i], y(v)); pen.lineTo(xs[i] + 0.5, y(v)); }
    open = true;
  });
  pen.stroke();
  return y;
}

const millimetres = () => 1e3 * (value("rod_video", "scale") ?? 0); // of a pixel; 0 where there is no scale

// The height of a place above the first one, along the rail [mm], or its row or column [px] as long as there is no scale.
function height() {
  const per = millimetres(), along = /x/.test(value("rod_video", "up") ?? "-y") ? 0 : 1;
  if (!per) return (p) => p?.[along] ?? null;
  const first = store.track.rows.findIndex((_, i) => placed(i)), zero = placed(first), angle = upward();
  return (p) => (p ? -per * ((p[0] - zero[0]) * Math.sin(angle) + (p[1] - zero[1]) * Math.cos(angle)) : null);
}

function ball(x, lane) {
  const n = store.track.rows.length;
  if (!n) return;
  const time = times("rod_video");
  const every = Math.max(1, Math.floor(n / 4000)), sign = millimetres() ? 1 : -1;
  if (!store.track.rows.some((_, i) => placed(i))) return;
  const of = height();
  const xs = [], ys = [];
  for (let i = 0; i < n; i += every) { xs.push(x(time[i])); ys.push(of(placed(i))); }
  if (!ys.some((v) => v !== null)) return;
  labels(lane, ys, sign);
  const y = line(xs, ys, lane, "--trace", sign);
  pen.fillStyle = colour("--bad");
  store.track.rows.forEach((r, i) => { if (r[3] && !store.draft.corrections[i]) pen.fillRect(x(time[i]) - 1, lane.top + lane.h - 6, 2, 6); });
  pen.fillStyle = colour("--hand");
  for (const [i, p] of Object.entries(store.draft.corrections)) {
    pen.beginPath();
    pen.arc(x(time[i]), y(of(p)), 4, 0, 7);
    pen.fill();
  }
}

let held = null;
const timeAt = (e) => { const r = canvas.getBoundingClientRect(), [a, b] = span(); return a + (e.clientX - r.left - LEFT) / (r.width - LEFT - RIGHT) * (b - a); };
const perPixel = () => { const r = canvas.getBoundingClientRect(), [a, b] = span(); return (b - a) / (r.width - LEFT - RIGHT); };
canvas.addEventListener("pointerdown", (e) => {
  canvas.setPointerCapture(e.pointerId);
  const y = e.clientY - canvas.getBoundingClientRect().top;
  held = { log: lanes(canvas.getBoundingClientRect().height).find((l) => l.log && y >= l.top && y < l.top + l.h)?.log, t: timeAt(e) };
  if (!held.log) seek(frameAt(timeAt(e)));
});
canvas.addEventListener("pointermove", (e) => {
  if (!held) return;
  const t = timeAt(e);
  if (!held.log) { seek(frameAt(t)); return; }
  if (t !== held.t) shiftLog(held.log, t - held.t, perPixel());
  held.t = t;
});
for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { held = null; });
new ResizeObserver(redraw).observe(canvas);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
on("state section frame track draft preview logs", redraw);

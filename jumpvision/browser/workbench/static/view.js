// The film on its canvas: magnified and moved by hand; clicks become columns and rows. Pixel centres are at integers.
import { emit, film, on, store } from "./store.js";
import { dropped, handles } from "./handles.js";
import { overlay } from "./overlay.js";
import { player, want } from "./player.js";

const CLICK = 6; // px that a pointer may move and still click
const canvas = document.getElementById("film"), pen = canvas.getContext("2d");
const view = { k: 1, x: 0, y: 0, fitted: true }; // screen = (column + 0.5) k + x
const toScreen = (c, r) => [(c + 0.5) * view.k + view.x, (r + 0.5) * view.k + view.y];
const toFilm = (x, y) => [(x - view.x) / view.k - 0.5, (y - view.y) / view.k - 0.5];
let picked = () => {}, drawn = () => {}, due = false;
export const onPick = (work) => { picked = work; };
export const onDraw = (work) => { drawn = work; }; // of a tool that a drag draws: its two ends, and whether it is let go

export function fit() {
  const f = film(), box = canvas.getBoundingClientRect();
  if (!f || !box.width) return;
  view.k = Math.min(box.width / f.columns, box.height / f.rows);
  view.x = (box.width - f.columns * view.k) / 2;
  view.y = (box.height - f.rows * view.k) / 2;
  view.fitted = true;
  redraw();
}

export function zoom(factor, at) {
  const box = canvas.getBoundingClientRect(), [x, y] = at ?? [box.width / 2, box.height / 2];
  const k = Math.max(0.02, Math.min(64, view.k * factor)), by = k / view.k;
  Object.assign(view, { k, x: x - (x - view.x) * by, y: y - (y - view.y) * by, fitted: false });
  redraw();
}

export function redraw() {
  if (due) return;
  due = true;
  requestAnimationFrame(() => { due = false; draw(); });
}

function draw() {
  const f = film(), box = canvas.getBoundingClientRect(), dpr = devicePixelRatio || 1;
  if (!box.width) return;
  const w = Math.round(box.width * dpr), h = Math.round(box.height * dpr);
  if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
  pen.setTransform(dpr, 0, 0, dpr, 0, 0);
  pen.clearRect(0, 0, box.width, box.height);
  if (!f) return;
  want(Math.min(f.columns, f.columns * view.k * dpr));
  if (player.image) {
    pen.imageSmoothingEnabled = view.k * f.columns / player.image.width < 2;
    pen.drawImage(player.image, view.x, view.y, f.columns * view.k, f.rows * view.k);
  }
  overlay(pen, { toScreen, k: view.k, f });
}

const fingers = new Map();
const REACH = { mouse: 10, pen: 14, touch: 22 }; // px from a handle that still take hold of it
let moved = 0, gap = 0, held = null, from = null; // held: the handle; from: where a ruler begins
const at = (e) => { const b = canvas.getBoundingClientRect(); return [e.clientX - b.left, e.clientY - b.top]; };
const rounded = (p) => toFilm(...p).map((v) => Math.round(v * 100) / 100);
function near([x, y], reach) { // the handle that is nearest to a place on the screen
  let best = null, least = reach;
  if (!film() || (store.tool && !store.tool.drag)) return null; // what is being clicked may lie on a handle
  for (const h of handles(toScreen)) {
    const [a, b] = h.screen ?? toScreen(...h.at), d = Math.hypot(a - x, b - y);
    if (d <= least) { best = h; least = d; }
  }
  return best;
}
const spread = () => { const [a, b] = [...fingers.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };

canvas.addEventListener("pointerdown", (e) => {
  canvas.setPointerCapture(e.pointerId);
  fingers.set(e.pointerId, at(e));
  if (fingers.size === 1) {
    moved = 0;
    held = near(at(e), REACH[e.pointerType] ?? 10);
    from = !held && store.tool?.drag ? at(e) : null;
  } else { held = null; from = null; }
  if (fingers.size === 2) gap = spread();
});
canvas.addEventListener("pointermove", (e) => {
  if (!fingers.has(e.pointerId)) { canvas.classList.toggle("grip", e.pointerType === "mouse" && near(at(e), 10) !== null); return; }
  const last = fingers.get(e.pointerId), now = at(e);
  fingers.set(e.pointerId, now);
  moved += Math.hypot(now[0] - last[0], now[1] - last[1]);
  if (fingers.size === 2) {
    const [a, b] = [...fingers.values()];
    zoom(spread() / gap, [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]);
    gap = spread();
    moved = Infinity;
  } else if (held) {
    if (moved > CLICK) { held.set(...rounded(now)); emit("draft"); redraw(); }
  } else if (from) {
    if (moved > CLICK) { drawn(rounded(from), rounded(now), false); redraw(); }
  } else if (moved > CLICK) {
    Object.assign(view, { x: view.x + now[0] - last[0], y: view.y + now[1] - last[1], fitted: false });
    redraw();
  }
});
for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => {
  if (!fingers.has(e.pointerId)) return;
  const was = held, start = from;
  held = null;
  from = null;
  if (end === "pointerup" && moved > CLICK && Number.isFinite(moved)) {
    if (was) dropped(was);
    else if (start) drawn(rounded(start), rounded(at(e)), true);
  }
  if (!fingers.delete(e.pointerId) || end === "pointercancel" || moved > CLICK || fingers.size) return;
  const f = film(), [c, r] = toFilm(...at(e));
  if (f && c > -1 && r > -1 && c < f.columns && r < f.rows) picked(...rounded(at(e)), e.shiftKey);
});
canvas.addEventListener("wheel", (e) => { e.preventDefault(); zoom(Math.exp(-e.deltaY / 400), at(e)); }, { passive: false });

new ResizeObserver(() => (view.fitted ? fit() : redraw())).observe(canvas);
on("state section", () => { player.image = null; if (film()) fit(); else redraw(); });
on("image draft preview track ball pair bed tool frame step fit", redraw);
on("tool", () => canvas.classList.toggle("picking", store.tool !== null));
export const film_at = { toScreen, toFilm }; // for tests
window.workbench = { store, player, view: film_at, emit };

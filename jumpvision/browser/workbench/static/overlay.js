// What is drawn over the film: marks, the ball and its path, vectors, the bed's surface.
import { picks, placed, store, value } from "./store.js";

const BLUE = "#56b4e9", ORANGE = "#e69f00", RED = "#ff6b4a", GREEN = "#35d0a0", DARK = "rgb(0 0 0 / .65)";
const PATH = 400; // frames of the path that are shown

export function overlay(pen, view) {
  const on = (colour, width, path) => {
    pen.beginPath();
    path();
    for (const [c, w] of [[DARK, width + 2], [colour, width]]) { pen.strokeStyle = c; pen.lineWidth = w; pen.stroke(); }
  };
  const cross = ([x, y], s = 9) => { pen.moveTo(x - s, y); pen.lineTo(x + s, y); pen.moveTo(x, y - s); pen.lineTo(x, y + s); };
  const circle = ([x, y], r) => { pen.moveTo(x + r, y); pen.arc(x, y, r, 0, 7); };
  marks(on, cross, view);
  if (store.section === "rod_video") ball(on, cross, circle, view);
  if (store.section === "grain_video" && store.pair) vectors(pen, view);
  if (store.section === "bed_image" && store.bed) {
    on(GREEN, 1.5, () => store.bed.row.forEach((r, c) => {
      if (r === null) return;
      const [x, y] = view.toScreen(c, r), start = c === 0 || store.bed.row[c - 1] === null;
      if (start) pen.moveTo(x, y); else pen.lineTo(x, y);
    }));
  }

  function marks(on, cross, { toScreen, f }) {
    const p = picks();
    for (const key of ["marks", "rail"]) {
      const v = p[key] ?? [];
      on(key === "rail" ? GREEN : ORANGE, 1.5, () => {
        for (let i = 0; i + 1 < v.length; i += 2) cross(toScreen(v[i], v[i + 1]));
        if (v.length === 4) { pen.moveTo(...toScreen(v[0], v[1])); pen.lineTo(...toScreen(v[2], v[3])); }
      });
    }
    if (p.ball) on(ORANGE, 1.5, () => cross(toScreen(...p.ball)));
    const foot = p.foot ?? [value("grain_video", "axis_column"), value("grain_video", "foot_row")];
    if (store.section === "grain_video" && foot[0] != null && foot[1] != null) {
      on(BLUE, 1.5, () => { // the origin and the axes of the field: x right, y up
        const [x, y] = toScreen(...foot);
        pen.moveTo(x - 40, y); pen.lineTo(x + 40, y); pen.lineTo(x + 34, y - 4); pen.moveTo(x + 40, y); pen.lineTo(x + 34, y + 4);
        pen.moveTo(x, y + 40); pen.lineTo(x, y - 40); pen.lineTo(x - 4, y - 34); pen.moveTo(x, y - 40); pen.lineTo(x + 4, y - 34);
      });
    }
    const floor = p.floor ?? (store.section === "bed_image" ? value("bed_image", "floor_row") : undefined);
    if (floor != null) on(BLUE, 1.5, () => { pen.moveTo(...toScreen(-0.5, floor)); pen.lineTo(...toScreen(f.columns - 0.5, floor)); });
    const roi = p.roi ?? (store.section === "grain_video" ? value("grain_video", "roi") : undefined);
    if (roi?.length === 4) {
      const [a, b] = [toScreen(roi[0], roi[1]), toScreen(roi[2], roi[3])];
      on(BLUE, 1.5, () => pen.rect(a[0], a[1], b[0] - a[0], b[1] - a[1]));
    } else if (roi?.length === 2) on(BLUE, 1.5, () => cross(toScreen(...roi)));
    const polygons = p.leave_out ?? (store.section === "grain_video" ? value("grain_video", "leave_out") : undefined) ?? [];
    for (const q of polygons) {
      on(RED, 1.5, () => {
        for (let i = 0; i + 1 < q.length; i += 2) { const s = toScreen(q[i], q[i + 1]); if (i) pen.lineTo(...s); else pen.moveTo(...s); }
        if (q.length >= 6) pen.closePath(); else cross(toScreen(q[0], q[1]), 5);
      });
    }
  }

  function ball(on, cross, circle, { toScreen, k }) {
    const now = placed(store.frame), rows = store.track.rows;
    on("rgb(86 180 233 / .9)", 1, () => {
      let open = false;
      for (let i = Math.max(0, store.frame - PATH); i <= Math.min(rows.length - 1, store.frame + PATH); i++) {
        const q = placed(i);
        if (q && open) pen.lineTo(...toScreen(q[0], q[1])); else if (q) pen.moveTo(...toScreen(q[0], q[1]));
        open = q !== null;
      }
    });
    const hand = store.draft.corrections[store.frame];
    const d = store.ball?.diameter ?? 21;
    if (now) {
      on(hand ? ORANGE : GREEN, 2, () => { circle(toScreen(now[0], now[1]), Math.max(4, 0.5 * d * k)); cross(toScreen(now[0], now[1]), 5); });
    } else if (store.ball && store.frame === store.ball.frame && !rows.length) {
      on(GREEN, 2, () => { circle(toScreen(store.ball.x, store.ball.y), Math.max(4, 0.5 * d * k)); cross(toScreen(store.ball.x, store.ball.y), 5); });
    }
    const raw = rows[store.frame];
    if (hand && raw?.[0] != null) on(BLUE, 1, () => circle(toScreen(raw[0], raw[1]), Math.max(4, 0.5 * d * k)));
  }
}

function vectors(pen, { toScreen, k }) {
  const { x, y, u, v, reason, reasons, frame } = store.pair;
  if (frame !== store.frame) return;
  const longest = Math.max(1e-6, ...u.map((a, i) => (reasons[reason[i]] === "" ? Math.hypot(a, v[i]) : 0)));
  const step = x.length > 1 ? Math.abs(x[1] - x[0]) : 8, scale = 1.6 * step / longest;
  for (const good of [true, false]) {
    if (!good && !store.rejected) continue;
    pen.strokeStyle = good ? GREEN : RED;
    pen.lineWidth = 1.4;
    pen.beginPath();
    for (let i = 0; i < x.length; i++) {
      if ((reasons[reason[i]] === "") !== good) continue;
      const a = toScreen(x[i], y[i]);
      if (u[i] === null) { pen.moveTo(a[0] - 2, a[1] - 2); pen.lineTo(a[0] + 2, a[1] + 2); pen.moveTo(a[0] + 2, a[1] - 2); pen.lineTo(a[0] - 2, a[1] + 2); continue; }
      const b = toScreen(x[i] + u[i] * scale, y[i] + v[i] * scale), angle = Math.atan2(b[1] - a[1], b[0] - a[0]);
      const head = Math.min(5, 0.4 * Math.hypot(b[0] - a[0], b[1] - a[1]));
      pen.moveTo(...a); pen.lineTo(...b);
      pen.lineTo(b[0] - head * Math.cos(angle - 0.5), b[1] - head * Math.sin(angle - 0.5));
      pen.moveTo(...b); pen.lineTo(b[0] - head * Math.cos(angle + 0.5), b[1] - head * Math.sin(angle + 0.5));
    }
    pen.stroke();
  }
}

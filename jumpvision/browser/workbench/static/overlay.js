// What is drawn over the film: marks, the ball and its path, vectors, the bed's surface.
import { flowOver } from "./flow_drawing.js";
import { arm, axes } from "./handles.js";
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
  if (store.section === "grain_video") flowOver(pen, view);
  marks(on, cross, view);
  if (store.section === "rod_video") ball(on, cross, circle, view);
  if (store.bed) { // the bed's surface, or the line over a crater
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
    if (p.marks?.length === 4 && p.distance) {
      const [x, y] = toScreen((p.marks[0] + p.marks[2]) / 2, (p.marks[1] + p.marks[3]) / 2);
      pen.font = "13px system-ui, sans-serif";
      for (const [colour, width] of [[DARK, 4], [null, 0]]) {
        pen.strokeStyle = colour; pen.lineWidth = width; pen.fillStyle = "#fff";
        if (colour) pen.strokeText(`${p.distance} mm`, x + 8, y - 8); else pen.fillText(`${p.distance} mm`, x + 8, y - 8);
      }
    }
    const a = axes();
    if (a) {
      const o = toScreen(...a.o), y = arm(a.angle, o), x = arm(a.angle - Math.PI / 2, o);
      on(BLUE, 2, () => { for (const end of [x, y]) { pen.moveTo(...o); pen.lineTo(...end); } pen.moveTo(o[0] + 4, o[1]); pen.arc(o[0], o[1], 4, 0, 7); pen.moveTo(y[0] + 5, y[1]); pen.arc(y[0], y[1], 5, 0, 7); });
      pen.fillStyle = "#fff";
      pen.font = "bold 13px system-ui, sans-serif";
      for (const [word, [u, v]] of [["x", arm(a.angle - Math.PI / 2, o, 76)], ["y", arm(a.angle, o, 76)]]) pen.fillText(word, u - 4, v + 4);
    }
    const also = store.section === "rod_video" && store.frame === 0 ? store.draft.values["params.track"]?.markers ?? value("params.track", "markers") ?? [] : [];
    also.forEach(([c, r], k) => {
      const [x, y] = toScreen(c, r);
      on(ORANGE, 1.5, () => cross([x, y]));
      pen.fillStyle = "#fff";
      pen.fillText(String(k + 2), x + 8, y - 8);
    });
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
    const model = store.step === "plot" ? store.fit : null;
    if (model?.column) { // the fitted curve, and where it puts the ball in this frame
      on(ORANGE, 1.5, () => {
        let open = false;
        model.column.forEach((c, i) => {
          if (c === null) { open = false; return; }
          if (open) pen.lineTo(...toScreen(c, model.row[i])); else pen.moveTo(...toScreen(c, model.row[i]));
          open = true;
        });
        if (model.column[store.frame] != null) cross(toScreen(model.column[store.frame], model.row[store.frame]), 12);
      });
    }
    if (store.candidates?.frame === store.frame && store.candidates.list.length > 1) {
      pen.font = "12px system-ui, sans-serif";
      for (const [x, y, d, p] of store.candidates.list) {
        const [u, v] = toScreen(x, y), r = Math.max(4, 0.5 * d * k) + 3;
        on("rgb(255 255 255 / .7)", 1, () => circle([u, v], r));
        pen.fillStyle = "#fff";
        pen.fillText(p < 0.01 ? "< 1 %" : `${Math.round(100 * p)} %`, u + r + 3, v + 4);
      }
    }
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


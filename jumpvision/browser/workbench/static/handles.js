// What lies on the film and can be taken hold of: ends of the ruler and the rail, the ball, the foot, corners, the axes.
import { keepLine } from "./flow_line.js";
import { changed, emit, picks, placed, setValue, store, value } from "./store.js";

const ARM = 60; // px on the screen from the origin to the end of an arm of the cross

// The angle of the rail's upward direction from the picture's up, counter-clockwise.
const side = () => ({ "-y": 0, "-x": Math.PI / 2, "+y": Math.PI, "+x": -Math.PI / 2 })[value("rod_video", "up") ?? "-y"];
export const upward = () => side() + (value("calibration", "tilt") ?? 0);

// The origin and the axes of the ball: column, row, and the angle of y from the picture's up, counter-clockwise.
export function axes() {
  if (store.section !== "rod_video") return null;
  const o = store.draft.values.rod_video?.origin ?? value("rod_video", "origin");
  if (o?.length !== 2) return null;
  return { o, up: side(), angle: upward() };
}
export const arm = (angle, [x, y], length = ARM) => [x - Math.sin(angle) * length, y - Math.cos(angle) * length]; // end of y on the screen

function points(key, v) { // ends of a pair of points, or of a polygon
  const out = [];
  for (let i = 0; i + 1 < v.length; i += 2) out.push({ key: `${key}.${i}`, at: [v[i], v[i + 1]], set: (c, r) => { const w = [...v]; w[i] = c; w[i + 1] = r; put(key, w); } });
  return out;
}
const put = (key, v) => { picks()[key] = v; };

// All of them, what is drawn on top first; at: column, row; screen: a place there instead.
export function handles(toScreen) {
  const p = picks(), out = [], s = store.section;
  const a = axes();
  if (a) {
    const at = toScreen(...a.o);
    out.push({ key: "axes.turn", screen: arm(a.angle, at), set: (c, r) => {
      const turned = Math.atan2(-(c - a.o[0]), -(r - a.o[1])) - a.up, tilt = Math.atan2(Math.sin(turned), Math.cos(turned));
      delete p.rail; // two words for one angle: the later one counts
      (store.draft.values.calibration ??= {}).tilt = Number(Math.max(-1.6, Math.min(1.6, tilt)).toFixed(5));
      (store.table.calibration ??= {}).tilt = store.draft.values.calibration.tilt;
    } });
    out.push({ key: "axes.move", at: a.o, set: (c, r) => { (store.draft.values.rod_video ??= {}).origin = [c, r]; } });
  }
  if (p.marks) out.push(...points("marks", p.marks));
  if (p.rail) out.push(...points("rail", p.rail));
  const foot = p.foot ?? (s === "grain_video" && value(s, "axis_column") != null && value(s, "foot_row") != null ? [value(s, "axis_column"), value(s, "foot_row")] : null);
  if (foot?.length === 2) out.push({ key: "foot", at: foot, set: (c, r) => put("foot", [c, r]) });
  const roi = p.roi ?? (s === "grain_video" ? value(s, "roi") : null);
  if (roi?.length === 4) {
    for (const [i, j] of [[0, 1], [2, 1], [2, 3], [0, 3]]) {
      out.push({ key: `roi.${i}.${j}`, at: [roi[i], roi[j]], set: (c, r) => { const w = [...(picks().roi ?? roi)]; w[i] = c; w[j] = r; put("roi", w); } });
    }
  }
  (p.leave_out ?? []).forEach((q, n) => out.push(...points("leave_out", q).map((h, i) => ({ ...h, key: `leave_out.${n}.${i}`, set: (c, r) => { p.leave_out[n][2 * i] = c; p.leave_out[n][2 * i + 1] = r; } }))));
  if (s === "rod_video" && p.ball?.length === 2 && store.step === "scale") out.push({ key: "ball", at: p.ball, set: (c, r) => put("ball", [c, r]) });
  const line = s === "grain_video" && store.flow?.line;
  if (line) {
    for (const i of [0, 2]) out.push({ key: `line.${i}`, at: [line[i], line[i + 1]], set: (c, r) => { line[i] = c; line[i + 1] = r; keepLine(line); } });
  }
  const hand = store.draft.corrections[store.frame];
  if (s === "rod_video" && store.step === "check" && (hand || placed(store.frame))) {
    out.push({ key: "correct", at: hand ?? placed(store.frame).slice(0, 2), set: (c, r) => { store.draft.corrections[store.frame] = [c, r]; } });
  }
  return out;
}

export function placeAxes(c, r) { setValue("rod_video", "origin", [c, r]); emit("draft"); }
export function dropped(handle) { changed(); if (handle.key === "ball") emit("reseed"); if (handle.key === "correct") emit("track"); }

// Undo and redo of every change of the draft. A drag, or what is typed into one field, is one step.
import { changed, emit, on, store } from "./store.js";

const MOST = 200, TOGETHER = 900; // steps kept; ms within which changes of one place are one step
let past = [], future = [], now = "", last = { place: "", at: 0 };

const $ = (id) => document.getElementById(id);
const buttons = () => { $("undo").disabled = !past.length; $("redo").disabled = !future.length; };

// Where two drafts differ, as "picks.rod_video.marks"; "" where in several places.
function place(a, b) {
  const out = [], walk = (p, q, name) => {
    if (JSON.stringify(p) === JSON.stringify(q)) return;
    const plain = (v) => v && typeof v === "object" && !Array.isArray(v);
    if (!plain(p) && !plain(q)) { out.push(name); return; }
    for (const k of new Set([...Object.keys(p ?? {}), ...Object.keys(q ?? {})])) walk(p?.[k], q?.[k], `${name}.${k}`);
  };
  walk(a, b, "");
  return out.length === 1 ? out[0] : "";
}

export function begin() { past = []; future = []; now = JSON.stringify(store.draft); last = { place: "", at: 0 }; buttons(); }

on("changed", () => {
  const next = JSON.stringify(store.draft);
  if (next === now) return;
  const where = place(JSON.parse(now || "{}"), store.draft), at = performance.now();
  const typed = document.activeElement?.matches("input") && where && where === last.place && at - last.at < TOGETHER;
  if (!typed) past = [...past.slice(1 - MOST), now];
  future = [];
  now = next;
  last = { place: where, at };
  buttons();
});

function go(from, to) {
  if (!from.length) return;
  to.push(now);
  now = from.pop();
  last = { place: "", at: 0 };
  store.draft = JSON.parse(now);
  buttons();
  changed();
  emit("undone");
  emit("track");
}
export const undo = () => go(past, future);
export const redo = () => go(future, past);
$("undo").addEventListener("click", undo);
$("redo").addEventListener("click", redo);

// The page: header, transport, steps, keys. What is clicked in the steps stands in scale.js, find.js and check.js.
import { attempt, changed, emit, film, load, on, post, start, store, times, value } from "./store.js";
import "./add.js";
import { watchRun } from "./check.js";
import { button, element, take } from "./fields.js";
import { act, problem, resume } from "./find.js";
import { begin as beginHistory, redo, undo } from "./history.js";
import { begin as beginKeeping, kept, pause } from "./keep.js";
import { play, player, seek, speeds } from "./player.js";
import "./plot.js";
import "./flow_plot.js";
import { onOpen } from "./glance.js";
import { look as lookBack, onJump } from "./report.js";
import { look } from "./scale.js";
import "./timeline.js";
import { fit, zoom } from "./view.js";

const $ = (id) => document.getElementById(id);
const STEPS = ["scale", "find", "check", "plot", "run"];
const WORDS = { rod_video: "Rod", grain_video: "Flow", bed_image: "Bed", crater_image: "Crater" };

export function step(name) {
  store.step = name;
  take(null);
  for (const s of STEPS) {
    const on = s === name;
    $(`tab-${s}`).setAttribute("aria-selected", String(on));
    $(`tab-${s}`).tabIndex = on ? 0 : -1;
    $(`step-${s}`).hidden = !on;
  }
  $("next").hidden = name !== "scale";
  document.body.classList.toggle("wide", name === "plot");
  emit("step");
  if (name === "run") changed();
}

function choose(section) {
  if (player.playing) play(false);
  Object.assign(store, { section, frame: 0, tool: null, bed: null });
  emit("section");
  seek(0);
}

STEPS.forEach((s) => {
  $(`tab-${s}`).addEventListener("click", () => step(s));
  $(`tab-${s}`).addEventListener("keydown", (e) => {
    const by = { ArrowRight: 1, ArrowLeft: -1 }[e.key];
    const there = STEPS.filter((t) => !$(`tab-${t}`).hidden);
    if (by) { e.stopPropagation(); const next = there.at((there.indexOf(s) + by) % there.length); step(next); $(`tab-${next}`).focus(); }
  });
});

on("state", () => {
  const { films, name, experiments } = store.state;
  document.title = `${name} · jumpvision workbench`;
  $("which").hidden = experiments.length < 2;
  $("experiment").replaceChildren(...experiments.map((e) => element("option", { value: e, textContent: e, selected: e === name })));
  $("films").replaceChildren(...films.map((f) => {
    const b = button(WORDS[f.section] ?? f.section, () => choose(f.section));
    b.dataset.section = f.section;
    return b;
  }));
  const none = !films.length; // logs and tracks alone: there is only to run
  document.body.classList.toggle("nofilm", none);
  for (const s of STEPS.slice(0, -1)) $(`tab-${s}`).hidden = none;
  $("facts").textContent = "";
  if (!none) choose(store.section);
  step(none ? "run" : "scale");
  if (none) $("hint").textContent = `${name} has no film or picture. Its logs and tracks need no clicks: run it, or choose another experiment.`;
});
// What was done before a reload is there again: draft, film, frame, step; and the track, which the server has.
on("fresh", pause);
on("begun", () => {
  const was = film() && kept();
  if (was) {
    store.draft = was.draft;
    Object.assign(store.plot, was.plot);
    if (was.section !== store.section && store.state.films.some((f) => f.section === was.section)) choose(was.section);
    emit("undone");
    changed();
    if (STEPS.includes(was.step)) step(was.step);
    seek(was.frame ?? 0);
  }
  beginHistory();
  beginKeeping();
  lookBack().then(() => film() && attempt(resume));
});
on("section", () => {
  const f = film(), { all, usual } = speeds();
  document.body.dataset.section = store.section;
  for (const b of $("films").children) b.setAttribute("aria-pressed", String(b.dataset.section === store.section));
  $("facts").title = [...f.notes, ...store.state.notes].join("\n");
  Object.assign($("scrub"), { max: f.time.length - 1, value: 0 });
  $("speed").replaceChildren(...all.map((s) => element("option", { value: s, textContent: s === 1 ? "1" : `1/${Math.round(1 / s)}`, selected: s === usual })));
  player.speed = usual;
  for (const id of ["play", "back", "forth", "scrub"]) $(id).disabled = f.time.length < 2;
  look(store.draft.picks.rod_video?.ball);
});
on("frame section preview", () => {
  const f = film();
  if (!f) return;
  const clock = f.timed || f.time.length < 2 || value(f.section, "frame_rate") ? [] : ["no clock in the file: give the frame rate"];
  $("facts").textContent = [f.file, f.facts, ...clock].filter(Boolean).join(" · ");
  $("scrub").value = store.frame;
  $("clock").textContent = `${(1e3 * times()[store.frame]).toFixed(3)} ms · ${store.frame} / ${f.time.length - 1}`;
  const t = $("timeline");
  t.setAttribute("aria-valuemax", f.time.length - 1);
  t.setAttribute("aria-valuenow", store.frame);
  t.setAttribute("aria-valuetext", $("clock").textContent);
  $("film").setAttribute("aria-label", `${f.file}, frame ${store.frame}`);
});
on("section", () => { $("act").textContent = { rod_video: "Track the film", grain_video: "Match a pair", bed_image: "Find the surface", crater_image: "Find the line" }[store.section] ?? ""; });
on("tool", () => { $("hint").textContent = store.tool?.hint ?? ""; });
on("playing", () => {
  $("play").textContent = player.playing ? "❚❚" : "▶";
  $("play").setAttribute("aria-label", player.playing ? "Pause" : "Play");
});

$("scrub").addEventListener("input", () => seek(Number($("scrub").value)));
$("play").addEventListener("click", () => play());
$("back").addEventListener("click", () => seek(store.frame - 1));
$("forth").addEventListener("click", () => seek(store.frame + 1));
$("speed").addEventListener("change", () => { player.speed = Number($("speed").value); });
$("zoom-in").addEventListener("click", () => zoom(1.5));
$("zoom-out").addEventListener("click", () => zoom(1 / 1.5));
$("zoom-fit").addEventListener("click", fit);
$("act").addEventListener("click", () => { step("find"); act(); });
async function open(experiment) {
  const state = await attempt(() => post("api/open", { experiment }));
  if (state) load(state);
}
onOpen(open);
$("experiment").addEventListener("change", () => open($("experiment").value));

const KEYS = [
  [[" "], "Play and pause", () => play()],
  [["ArrowLeft"], "Back one frame; with Shift ten", (e) => seek(store.frame - (e.shiftKey ? 10 : 1))],
  [["ArrowRight"], "On one frame; with Shift ten", (e) => seek(store.frame + (e.shiftKey ? 10 : 1))],
  [["Home"], "First frame", () => seek(0)],
  [["End"], "Last frame", () => seek(Infinity)],
  [["1", "2", "3", "4", "5"], "Scale, Find, Check, Plot, Run", (e) => { const s = STEPS[Number(e.key) - 1]; if (!$(`tab-${s}`).hidden) step(s); }],
  [["b"], "Click the ball", () => { step("scale"); take({ key: "ball", numbers: 2, hint: "Click the ball" }); }],
  [["m"], "Draw the ruler", () => { step("scale"); take({ key: "marks", numbers: 4, drag: true, hint: "Drag from one end of a known length to the other, or click both ends" }); }],
  [["t"], "Track, match, or find the surface", () => { step("find"); act(); }],
  [["s"], "Stop the tracker", () => attempt(() => post("api/track/stop"))],
  [["["], "Previous lost frame", () => problem(-1)],
  [["]"], "Next lost frame", () => problem(1)],
  [["c"], "Correct the ball in this frame", () => { step("check"); take({ key: "correct", numbers: 2, hint: "Click where the ball is in this frame" }); }],
  [["Shift+click"], "Mark the ball in this frame and step on", () => {}],
  [["+", "="], "Magnify", () => zoom(1.5)],
  [["-"], "Make smaller", () => zoom(1 / 1.5)],
  [["0"], "Whole picture", fit],
  [["Ctrl+Z"], "Undo; with Shift redo", () => {}],
  [["Escape", "Enter"], "End what is being clicked", () => take(null)],
  [["?"], "This list", () => $("help").showModal()],
];
const OF_A_BALL = ["b", "s", "[", "]", "c", "Shift+click"];
const NAMES = { " ": "Space", ArrowLeft: "←", ArrowRight: "→" };
$("keys").append(...KEYS.flatMap(([keys, words]) => [
  element("dt", { className: OF_A_BALL.includes(keys[0]) ? "ball-only" : "" }, ...keys.map((k) => element("kbd", { textContent: NAMES[k] ?? k }))), element("dd", { className: OF_A_BALL.includes(keys[0]) ? "ball-only" : "", textContent: words })]));
$("help-open").addEventListener("click", () => $("help").showModal());
addEventListener("keydown", (e) => {
  const typed = e.target.matches("input:not([type=range]):not([type=checkbox])");
  if ((e.ctrlKey || e.metaKey) && !e.altKey && e.key.toLowerCase() === "z" && !typed) { e.preventDefault(); if (e.shiftKey) redo(); else undo(); return; }
  if (e.ctrlKey || e.metaKey || e.altKey || document.querySelector("dialog[open]")) return;
  const at = e.target, typing = at.matches("input:not([type=range]):not([type=checkbox]), select, textarea");
  if (e.key === "Escape" && typing) { at.blur(); return; }
  const slides = at.matches("input[type=range]") && /^(Arrow|Home|End)/.test(e.key);
  const presses = at.matches("button, input[type=checkbox], summary") && (e.key === " " || e.key === "Enter");
  if (typing || slides || presses) return;
  const found = KEYS.find(([keys]) => keys.includes(e.key));
  if (!found || !film() || (OF_A_BALL.includes(found[0][0]) && store.section !== "rod_video")) return;
  e.preventDefault();
  found[2](e);
});

onJump(choose);
await attempt(start);
watchRun();
window.workbench.ready = true;


// The flow of the grain film: how it is matched, what of it is shown, and the mean of all pairs.
import { attempt, changed, emit, get, latest, mine, on, post, store, value } from "./store.js";
import { button, element, row, take, valueChoice, valueNumber } from "./fields.js";
import { colours, nearest, range } from "./flow_drawing.js";
import { keepLine } from "./flow_line.js";
import { player, seek } from "./player.js";
import { film_at, redraw } from "./view.js";

const POLL = 300, WAIT = 120; // ms
const MAPS = [["vectors", "vectors alone"], ["speed", "speed"], ["u", "u, to the right"], ["v", "v, up"], ["vorticity", "vorticity"], ["divergence", "divergence"], ["shear_rate", "shear rate"],
  ["swirl", "swirl"], ["u_rms", "u rms"], ["v_rms", "v rms"], ["tke", "turbulent energy"]];
const ONE = ["vectors", "speed", "u", "v", "vorticity", "divergence", "shear_rate", "swirl"], MEAN = ["vectors", "speed", "u", "v", "vorticity", "u_rms", "v_rms", "tke"];
export const words = Object.fromEntries(MAPS);
Object.assign(store, { flow: null, lit: null, map: "vectors", mean: false, grid: true, pointer: null });

const check = (checked, work) => { const c = element("input", { type: "checkbox", checked }); c.addEventListener("change", () => work(c.checked)); return c; };
const slider = (key, text, limits, usual) => valueNumber("params.piv", key, text, { ...limits, usual }).made;
const lit = check(false, () => { light(); });
const live = check(true, (on) => on && store.flow && match());
const counts = element("p", { id: "counts", data: { "aria-live": "polite" } }), now = element("p", { className: "note", data: { "aria-live": "polite" } });
const bar = element("progress", { max: 1, value: 0, hidden: true, data: { "aria-label": "Pairs matched" } });
const all = button("Match all pairs", () => batch()), stop = button("Stop", () => attempt(() => post("api/flow/stop")));
const one = button("Match this pair", () => match(), "main");
stop.hidden = true;
const select = element("select", {}), of = element("select", {}, element("option", { value: "", textContent: "this pair" }), element("option", { value: "mean", textContent: "the mean of all" }));
select.id = "map";
select.addEventListener("change", () => { store.map = select.value; store.flow ? match() : 0; });
of.addEventListener("change", () => { store.mean = of.value !== ""; offer(); match(); });

function offer() { // the maps that there are
  const names = store.mean ? MEAN : ONE;
  if (!names.includes(store.map)) store.map = "vectors";
  select.replaceChildren(...names.map((n) => element("option", { value: n, textContent: words[n], selected: n === store.map })));
}
offer();

export const line = () => take({ key: "line", numbers: 4, drag: true, hint: "Drag a line through the flow",
  put: (ends, done) => { store.flow.line = ends; if (done) { keepLine(ends); changed(); emit("profile"); } else redraw(); } });
export const panel = element("div", {},
  element("div", { className: "buttons" }, one, all, stop), bar, counts, now,
  row("Map", select), row("of", of),
  element("h3", { textContent: "Windows" }),
  slider("window", "Window [px]", { min: 8, max: 96, step: 4, whole: true }, 24),
  slider("step", "Step [px]", { min: 4, max: 64, step: 2, whole: true }, 8),
  row("Show them at the pointer", check(true, (on) => { store.grid = on; redraw(); })),
  element("h3", { textContent: "The light" }),
  valueChoice("params.piv", "background", "Background", [["none", "nothing"], ["minimum", "the minimum of all frames"], ["mean", "their mean"]], "none"),
  slider("clahe", "Local contrast (CLAHE), tiles of [px], 0: off", { min: 0, max: 256, step: 8, whole: true }, 0),
  row("Show the picture as it is matched", lit),
  element("h3", { textContent: "Which vectors are kept" }),
  slider("min_correlation", "Least correlation", { min: 0, max: 0.95, step: 0.05 }, 0.3),
  slider("outlier", "Median test: largest residual", { min: 0.5, max: 10, step: 0.5 }, 2),
  row("Show rejected vectors", check(true, (on) => { store.rejected = on; emit("pair"); })),
  row("Match again at every change", live));

// What the answer rests on: a change of it asks again, where it is to be live.
const ofPairs = () => { const t = store.table; return JSON.stringify([t.grain_video, t.grain_mask, t.robot, t.calibration, t.params?.piv]); };
const basis = () => ofPairs() + JSON.stringify([store.table.params?.flow, store.table.params?.profiles]);
let matched = "", pairs = "";
const alone = () => { store.mean = false; of.value = ""; offer(); };

export const match = latest(() => attempt(async () => {
  if (store.section !== "grain_video") return;
  counts.textContent = "matching ...";
  const old = store.flow, lines = JSON.stringify(store.table.params?.profiles?.lines), from = basis();
  try {
    store.flow = await post("api/flow", { draft: store.draft, frame: store.frame, map: store.map === "vectors" ? "speed" : store.map, mean: store.mean });
  } catch (e) { counts.textContent = ""; store.flow = null; emit("pair"); throw e; }
  const f = store.flow;
  matched = from;
  pairs = ofPairs();
  f.range = range(f.values, f.name);
  if (old?.line && old.lines === lines && JSON.stringify(old.place) !== JSON.stringify(f.place)) { f.line = old.line; keepLine(old.line); changed(); } // it stays where it was drawn
  f.lines = lines;
  say();
  emit("pair");
}));

function say() {
  const f = store.flow, gap = value("params.piv", "gap") ?? 1, why = {};
  for (const r of f.reason) if (f.reasons[r]) why[f.reasons[r]] = (why[f.reasons[r]] ?? 0) + 1;
  counts.textContent = f.mean ? `Mean of ${f.fields} fields.` : `Frames ${f.frame} and ${f.frame + gap}: ${f.measured} of ${f.u.length} vectors measured. ${Object.entries(why).map(([k, v]) => `${v}: ${k}`).join(". ")}`;
  if (f.notes.length) counts.textContent += ` ${f.notes.join(". ")}`;
}

let later = 0;
on("preview", () => {
  if (store.flow?.mean && ofPairs() !== pairs) alone(); // the mean is of other settings
  if (store.flow && live.checked && basis() !== matched) match();
  light();
});
on("frame", () => {
  light();
  clearTimeout(later);
  if (store.flow && live.checked && !store.mean && !player.playing && store.frame !== store.flow.frame) later = setTimeout(match, WAIT);
});
on("section fresh", () => { Object.assign(store, { flow: null, lit: null, pointer: null }); matched = ""; alone(); counts.textContent = ""; now.textContent = ""; });
on("section", () => {
  if (store.section !== "grain_video") return;
  all.hidden = of.parentNode.hidden = store.state.films.find((f) => f.section === "grain_video").time.length < 3;
});
on("earlier", async () => { // fields that the server has: of a run, or of before a reload
  if (store.section !== "grain_video") return;
  const run = await attempt(() => get("api/flow/all"));
  if (run?.running || run?.matched) watch();
});

// The picture as it is matched, in place of the film's.
const light = latest(async () => {
  if (!lit.checked || store.section !== "grain_video") { if (store.lit) { store.lit = null; redraw(); } return; }
  const frame = store.frame, width = Math.round(document.getElementById("film").clientWidth * (devicePixelRatio || 1));
  const found = await attempt(() => post("api/flow/light", { draft: store.draft, frame, width }));
  if (!found) return;
  const image = new Image();
  image.src = found.image;
  await image.decode();
  store.lit = { frame, image, box: found.box };
  redraw();
});

async function batch() {
  if (await attempt(() => post("api/flow/all", { draft: store.draft })) === undefined) return;
  watch();
}
async function watch() {
  let run;
  do {
    run = await attempt(() => get("api/flow/all"));
    if (!run) break;
    all.disabled = run.running;
    stop.hidden = bar.hidden = !run.running;
    if (run.total) { bar.max = run.total; bar.value = run.done; } else bar.removeAttribute("value");
    now.textContent = run.running ? `${run.what}${run.total ? `: ${run.done} of ${run.total}` : ""}` : [run.problem, ...(run.notes ?? []), run.why && `No mean: ${run.why}`].filter(Boolean).join(". ");
    if (run.running) await new Promise((done) => setTimeout(done, POLL));
  } while (run.running);
  if (run?.mean) { store.mean = true; of.value = "mean"; offer(); }
  if (run?.matched) match();
}

// The bar of colours, and the value at the pointer.
const scaleBar = element("div", { id: "colours", hidden: true }, element("p", {}), element("div", {}), element("p", {}), element("output", {}));
document.getElementById("screen").append(scaleBar);
const short = (v) => (v === null ? "none" : String(Number(v.toPrecision(4))));
function legend() {
  const f = store.flow, [title, strip, ends, at] = scaleBar.children;
  scaleBar.hidden = !f || store.section !== "grain_video";
  if (scaleBar.hidden) return;
  title.textContent = `${words[f.name]} [${f.unit}]${f.mean ? `, mean of ${f.fields}` : ""}`;
  strip.style.background = `linear-gradient(to right, ${colours(f.name).join(", ")})`;
  ends.replaceChildren(...f.range.map((v) => element("span", { textContent: short(v) })));
  const near = store.pointer && nearest(f, ...store.pointer);
  at.textContent = near ? `here ${short(f.values[near.at])}` : "";
}
on("pair section", legend);
const canvas = document.getElementById("film");
canvas.addEventListener("pointermove", (e) => {
  if (store.section !== "grain_video") return;
  const box = canvas.getBoundingClientRect();
  store.pointer = film_at.toFilm(e.clientX - box.left, e.clientY - box.top);
  legend();
  if (store.step === "find" && store.grid) redraw();
});
canvas.addEventListener("pointerleave", () => { store.pointer = null; legend(); redraw(); });

// Step 4: columns of the track against each other, a curve through a part of them, and the table. All numbers are the
// server's; here they are drawn.
import { attempt, emit, latest, on, post, Refusal, store } from "./store.js";
import { button, element, row } from "./fields.js";
import { track } from "./find.js";
import { seek } from "./player.js";
import { table } from "./table.js";

const box = document.getElementById("step-plot"), CLICK = 4; // px that a pointer may move and still click
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const CURVES = [["line", "Line"], ["parabola", "Parabola"], ["sine", "Sine"], ["damped", "Damped sine"], ["decay", "Decay"]];

const ys = element("select", {}), xs = element("select", {});
const from = element("input", { type: "text", inputMode: "decimal", autocomplete: "off" }), to = from.cloneNode();
const stage = element("div", { className: "plot", id: "plot", data: { role: "img" } }), rest = element("div", { className: "plot", id: "residual", data: { role: "img", "aria-label": "Residuals" } });
const curves = CURVES.map(([name, words]) => { const b = button(words, () => choose({ curve: store.plot.curve === name ? "" : name })); b.dataset.curve = name; return b; });
const SIMULATED = { // curves that a simulation gives, whole: height against time
  simulated: "As the last run simulated it, from the same rest; no number of it was fitted here.",
  study: "By your own study with its first values, from the same rest; nothing was fitted here.",
};
const [jump, study] = [["simulated", "Simulated jump"], ["study", "Own study"]].map(([curve, words]) => {
  const b = button(words, () => {
    const other = store.plot.body > 1; // the columns are another body's
    Object.assign(store.plot, { x: "time", y: "y", part: null, body: 1, curve: store.plot.curve === curve ? "" : curve });
    if (other) attempt(ask); else { draw(); fit(); }
    emit("plot");
  });
  Object.assign(b, { hidden: true }).dataset.curve = curve;
  return b;
});
curves.push(jump, study);
on("earlier section", () => { jump.hidden = !store.earlier?.held.includes("simulation.csv"); });
on("state", () => { study.hidden = !store.state.study; study.title = store.state.study; });
const said = element("p", { id: "said", data: { "aria-live": "polite" } }), numbers = element("dl", { id: "numbers" }), note = element("p", { className: "note" });
const none = element("div", {}, element("p", { id: "unplotted", data: { "aria-live": "polite" } }), element("div", { className: "buttons" }, button("Track the film", () => track(), "main")));
const body = element("select", {}), which = row("Body", body);
body.addEventListener("change", () => { store.plot.body = Number(body.value); attempt(ask); emit("plot"); });
const some = element("div", {},
  element("div", { className: "pair" }, row("Plot", ys), row("against", xs)), stage,
  element("p", { className: "note", textContent: "Drag over a part to fit a curve to it; click a point to see its frame." }),
  element("div", { className: "choice", data: { role: "group", "aria-label": "Curve" } }, ...curves),
  element("div", { className: "pair" }, row("From", from), row("to", to), button("Whole", () => choose({ part: null }))),
  said, numbers, rest, note);
const sheet = element("div", { hidden: true }, table);
const views = [["some", "Plot", some], ["sheet", "Table", sheet]].map(([name, words, part]) => {
  const b = button(words, () => view(name));
  b.dataset.view = name;
  return [name, b, part];
});
box.append(element("div", { className: "choice", data: { role: "group", "aria-label": "Shown as" } }, ...views.map(([, b]) => b)), which, none, some, sheet);

function view(name) {
  store.plot.view = name;
  show();
  emit("plot");
}

function choose(what) {
  Object.assign(store.plot, what);
  if ("y" in what || "x" in what) Object.assign(store.plot, "x" in what ? { part: null, curve: "" } : { curve: "" });
  draw();
  fit();
  emit("plot");
}
ys.addEventListener("change", () => choose({ y: ys.value }));
xs.addEventListener("change", () => choose({ x: xs.value }));
for (const input of [from, to]) input.addEventListener("change", () => {
  const ends = [from.value, to.value].map(Number);
  if (ends.every(Number.isFinite) && ends[0] < ends[1]) choose({ part: ends });
});

const column = (name) => store.columns.plotted.find((c) => c.name === name);
const label = (c) => `${c.name === "time" ? "t" : c.words} [${c.unit}]`;
function whole() {
  const v = column(store.plot.x).values.filter((a) => a !== null);
  return [v.reduce((a, b) => Math.min(a, b), Infinity), v.reduce((a, b) => Math.max(a, b), -Infinity)];
}

// What was followed, in the units of now; asked for when it is to be seen.
const ask = latest(async () => {
  if (store.step !== "plot" || store.section !== "rod_video") return;
  try {
    if (!store.track.rows.length) throw new Refusal([store.track.running ? "The tracker is at its first frames." : "No track yet: there is nothing to plot."]);
    store.columns = await post("api/columns", { draft: store.draft, ...(store.plot.body > 1 && { body: store.plot.body }) });
    none.hidden = true;
  } catch (e) {
    if (!(e instanceof Refusal)) throw e;
    if (store.plot.body > 1) { store.plot.body = 1; attempt(ask); return; } // it is no longer followed
    store.columns = null;
    none.hidden = false;
    none.firstChild.textContent = e.problems.join(" ");
  }
  show();
  emit("columns");
  await fit();
});

function show() {
  const any = Boolean(store.columns), sheeted = store.plot.view === "sheet";
  for (const [name, b, part] of views) {
    const on = sheeted === (name === "sheet");
    b.setAttribute("aria-pressed", String(on));
    part.hidden = !any || !on;
  }
  which.hidden = !any || store.columns.bodies < 2;
  if (!any) return;
  body.replaceChildren(...Array.from({ length: store.columns.bodies }, (_, k) => element("option", { value: k + 1, textContent: k ? `${k + 1}` : "1, the ball" })));
  body.value = store.plot.body ?? 1;
  const names = store.columns.plotted.map((c) => c.name);
  if (!names.includes(store.plot.y)) store.plot.y = "y";
  if (!names.includes(store.plot.x)) store.plot.x = "time";
  if (!sheeted) draw();
}

const fit = latest(async () => {
  const { x, y, curve, part } = store.plot;
  for (const b of curves) b.setAttribute("aria-pressed", String(b.dataset.curve === curve));
  if (!curve || !store.columns) { store.fit = null; } else {
    const [low, high] = part ?? whole();
    try {
      if (curve in SIMULATED) { note.className = "note"; note.textContent = "simulating ..."; }
      store.fit = curve in SIMULATED ? await post(`api/${curve}`, { draft: store.draft })
        : await post("api/fit", { draft: store.draft, body: store.plot.body ?? 1, x, y, low, high, curve });
      note.className = "note";
      const shared = store.fit.parameters.at(store.fit.said ? -1 : 0);
      note.textContent = !shared ? SIMULATED[curve]
        : store.fit.excess > 1.5 ? `The points scatter ${Math.sqrt(store.fit.excess).toFixed(1)} times as far as their own sigma says, or the curve is another one; every ± is larger by that.`
        : shared.sigma_common > 0.7 * shared.sigma ? "Most of the ± is that of the scale: a longer ruler makes it smaller." : "";
    } catch (e) {
      store.fit = null;
      note.className = "bad";
      note.textContent = e instanceof Refusal ? e.problems.join(" ") : String(e);
    }
  }
  write();
  draw();
  emit("fit");
});

function write() {
  const f = store.fit;
  said.textContent = f?.said ?? "";
  said.hidden = !f?.said;
  rest.hidden = !f;
  if (!f && !store.plot.curve) note.textContent = "";
  const x = store.plot.x === "time" ? "t" : store.plot.x;
  numbers.replaceChildren(...(f ? [["curve", `${f.formula.replaceAll("x/", `${x}/`).replaceAll(" x", ` ${x}`)}, ${x} from ${Number(f.begin.toPrecision(6))}`],
    ...f.parameters.map((p) => [p.name, p.text]), ["residual", `${f.rms_text} rms of ${f.frames} frames`]] : [])
    .flatMap(([k, v]) => [element("dt", { textContent: k }), element("dd", { textContent: v })]));
}

let shown = null, left = null, order = [];
function draw() {
  if (!store.columns || some.hidden) return;
  const options = (select, chosen, list) => {
    if (select.dataset.of !== list.map(label).join()) {
      select.dataset.of = list.map(label).join();
      select.replaceChildren(...list.map((c) => element("option", { value: c.name, textContent: label(c) })));
    }
    select.value = chosen;
  };
  options(ys, store.plot.y, store.columns.plotted.slice(1));
  options(xs, store.plot.x, store.columns.plotted);
  const x = column(store.plot.x), y = column(store.plot.y), timed = x.name === "time";
  order = x.values.map((_, i) => i).filter((i) => x.values[i] !== null);
  if (!timed) order.sort((a, b) => x.values[a] - x.values[b]);
  const pick = (v) => order.map((i) => v[i]);
  const off = (sign) => order.map((i) => (y.values[i] === null || y.sigma === null || y.sigma[i] === null ? null : y.values[i] + sign * y.sigma[i]));
  const f = store.fit, at = pick(x.values);
  const lines = [{}, { show: true, stroke: "transparent", points: { show: false } }, { show: true, stroke: "transparent", points: { show: false } },
    { stroke: colour("--trace"), width: 1, paths: timed ? undefined : () => null, points: { show: order.length < 400 || !timed, size: 5, fill: colour("--trace") } },
    { stroke: colour("--hand"), width: 2, points: { show: false } }];
  const low = off(-1), high = off(1);
  const sizes = stage.clientWidth || 320;
  shown?.destroy();
  shown = new uPlot({ ...common(sizes, Math.max(200, Math.min(280, Math.round(sizes * 0.55))), label(x), label(y)), series: lines,
    bands: timed ? [{ series: [2, 1], fill: colour("--band") }] : [] },
    [at, timed ? low : at.map(() => null), timed ? high : at.map(() => null), pick(y.values), f ? pick(f.curve) : at.map(() => null)], stage);
  hands(shown);
  stage.setAttribute("aria-label", `${label(y)} against ${label(x)}`);
  const [a, b] = store.plot.part ?? whole();
  from.value = Number(a.toPrecision(6));
  to.value = Number(b.toPrecision(6));
  left?.destroy();
  left = null;
  if (!f) return;
  const across = whole(); // as above
  left = new uPlot({ ...common(sizes, 160, label(x), `residual [${y.unit}]`),
    scales: { x: { time: false, range: () => across } },
    series: [{}, { stroke: colour("--soft"), width: 1, paths: () => null, points: { show: true, size: 4, fill: colour("--trace"), stroke: colour("--trace") } }] },
    [at, pick(f.residual)], rest);
  hands(left, false);
}

const common = (width, height, x, y) => {
  const axis = (words, size) => ({ label: words, labelSize: 20, size, stroke: colour("--ink"), font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif",
    grid: { stroke: colour("--line"), width: 1 }, ticks: { stroke: colour("--line"), width: 1, size: 4 } });
  return { width, height, legend: { show: false }, cursor: { drag: { x: false, y: false }, points: { show: false }, y: false },
    scales: { x: { time: false, range: () => whole() } }, axes: [axis(x, 34), { ...axis(y, 56), space: 22, values: (_, v) => v.map((a) => (a === null ? "" : String(Number(a.toPrecision(6))))) }], hooks: { draw: [frameMark], ready: [(u) => { if (store.plot.part) mark(u); }] } };
};

function frameMark(u) { // the frame that the film shows
  const x = column(store.plot.x)?.values[store.frame];
  if (x === null || x === undefined) return;
  const at = Math.round(u.valToPos(x, "x", true)), c = u.ctx;
  if (at < u.bbox.left - 1 || at > u.bbox.left + u.bbox.width + 1) return;
  c.save();
  c.strokeStyle = colour("--ink");
  c.lineWidth = 1.5 * (devicePixelRatio || 1);
  c.beginPath();
  c.moveTo(at, u.bbox.top); c.lineTo(at, u.bbox.top + u.bbox.height);
  c.stroke();
  c.restore();
}

function mark(u) { // the part, as a shade
  const [a, b] = store.plot.part.map((v) => Math.max(0, Math.min(u.over.clientWidth, u.valToPos(v, "x"))));
  u.setSelect({ left: a, width: b - a, top: 0, height: u.over.clientHeight }, false);
}

// A drag takes a part, a click goes to the frame: with mouse, pen or finger.
function hands(u, parts = true) {
  let begin = null;
  const x = (e) => Math.max(0, Math.min(u.over.clientWidth, e.clientX - u.over.getBoundingClientRect().left));
  u.over.style.touchAction = "pan-y";
  u.over.addEventListener("pointerdown", (e) => { begin = x(e); u.over.setPointerCapture(e.pointerId); });
  u.over.addEventListener("pointermove", (e) => {
    if (begin === null || !parts || Math.abs(x(e) - begin) < CLICK) return;
    u.setSelect({ left: Math.min(begin, x(e)), width: Math.abs(x(e) - begin), top: 0, height: u.over.clientHeight }, false);
  });
  u.over.addEventListener("pointercancel", () => { begin = null; });
  u.over.addEventListener("pointerup", (e) => {
    if (begin === null) return;
    const ends = [Math.min(begin, x(e)), Math.max(begin, x(e))];
    begin = null;
    if (ends[1] - ends[0] >= CLICK && parts) choose({ part: ends.map((v) => u.posToVal(v, "x")) });
    else if (order.length) seek(order[u.posToIdx(ends[0])]);
  });
}

on("begun", () => { store.columns = null; });
on("preview step", ask);
const own = [...box.children];
on("section", () => { for (const e of own) e.classList.toggle("elsewhere", store.section !== "rod_video"); });
let polled = 0;
on("track", () => { // of a running tracker four times a second at most
  const now = performance.now();
  if (store.track.running && now - polled < 250) return;
  polled = now;
  attempt(ask);
});
on("frame", () => { if (store.step === "plot") { shown?.redraw(false, false); left?.redraw(false, false); } });
new ResizeObserver(() => { if (shown && stage.clientWidth && Math.abs(shown.width - stage.clientWidth) > 1) draw(); }).observe(stage);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);

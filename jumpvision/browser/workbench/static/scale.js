// Step 1: what is known of the film, clicked or typed. And what a click on the film means.
import { attempt, changed, emit, film, load, on, picks, post, setPick, setValue, store, value } from "./store.js";
import { button, element, pickNumber, place, row, take, valueChoice, valueNumber } from "./fields.js";
import { axes } from "./handles.js";
import { seek } from "./player.js";
import { onDraw, onPick } from "./view.js";

const box = document.getElementById("step-scale");
const FIRST = "rod_video grain_video".split(" "); // sections whose places are those of the first frame

const marks = () => [
  place("marks", "Ruler", 4, "Drag from one end of a known length to the other, or click both ends", true),
  pickNumber("distance", "Its length [mm]"),
];
const rate = (section) => {
  const { made } = valueNumber(section, "frame_rate", "Frame rate [1/s]", { note: "" });
  return element("div", {}, made, valueChoice(section, "clock", "Times are", [["file", "the file's own"], ["declared", "by this frame rate"]], "file"));
};
const parts = {
  rod_video: [
    element("h3", { textContent: "The ball" }),
    place("ball", "Ball", 2, "Click the ball, or whatever is to be followed"),
    pickNumber("ball_diameter", "Its diameter [mm]"),
    element("p", { className: "note", textContent: "The diameter gives the scale to 1 %; a ruler is better." }),
    bodies(),
    element("h3", { textContent: "A known length" }), ...marks(),
    element("h3", { textContent: "Origin and axes" }), cross(),
    place("rail", "Along the rail", 4, "Drag along the rail, or click two points of it", true),
    valueChoice("rod_video", "up", "Up in the picture", [["-y", "up"], ["+y", "down"], ["-x", "left"], ["+x", "right"]], "-y"),
    rate("rod_video"),
  ],
  grain_video: [
    element("h3", { textContent: "A known length" }), ...marks(),
    element("h3", { textContent: "What is matched" }),
    place("roi", "Part to match", 4, "Drag over the part to match, or click two corners", true),
    polygons(), rate("grain_video"),
    valueChoice("grain_video", "pairs", "Pictures", [["", "each with the next"], ["order", "pairs: 1-2, 3-4, ..."], ["names", "pairs A, B by their names"]], ""),
    pairTime(),
    foot(),
  ],
  bed_image: [place("floor", "Floor of the bed", 1, "Click the floor of the bed"), element("h3", { textContent: "A known length" }), ...marks()],
  crater_image: [element("h3", { textContent: "A known length" }), ...marks()],
};
const roles = element("div", { className: "row" }, element("span", { id: "shows", textContent: "This film shows" }),
  element("div", { className: "choice", data: { role: "group", "aria-labelledby": "shows" } }, ...[["rod_video", "a ball"], ["grain_video", "grains or a flow"]].map(([role, words]) => {
    const b = button(words, async () => {
      if (role === store.section) return;
      const state = await attempt(() => post("api/role", { section: store.section, role }));
      if (state) load(state, role);
    });
    b.dataset.role = role;
    return b;
  })));
const made = Object.fromEntries(Object.entries(parts).map(([s, children]) => [s, element("div", {}, ...children)]));
const facts = element("p", { className: "note", id: "scale-now" });
box.append(element("h2", { textContent: "What is known of the film" }), roles, facts, ...Object.values(made));

const others = () => store.draft.values["params.track"]?.markers ?? value("params.track", "markers") ?? [];
function bodies() { // further balls, each followed by itself
  const said = element("span", { className: "note" });
  const add = button("Add", () => take({ key: "markers", numbers: 2, hint: "Click another ball, in the first frame" }));
  add.dataset.tool = "markers";
  const drop = button("Remove last", () => setValue("params.track", "markers", others().slice(0, -1)));
  const out = element("div", { className: "tool" }, element("div", { className: "row" }, element("span", { className: "label", textContent: "Further balls" }), said, add, drop));
  on("state section draft preview tool", () => {
    said.textContent = others().length ? String(others().length) : "none";
    drop.hidden = !others().length;
    add.setAttribute("aria-label", "Add a further ball: click it on the film");
    out.classList.toggle("active", store.tool?.key === "markers");
  });
  return out;
}

function cross() { // the axes of the ball: a cross that is dragged by its middle and turned by its arm
  const said = element("p", { className: "note" });
  const set = button("Place", () => {
    if (axes()) { store.table.rod_video.origin = undefined; setValue("rod_video", "origin", null); return; }
    take({ key: "origin", numbers: 2, hint: "Click where x = 0 and y = 0" });
  });
  set.dataset.tool = "origin";
  const typed = element("input", { type: "text", autocomplete: "off", placeholder: "column, row" });
  typed.addEventListener("change", () => {
    const v = typed.value.split(/[,;\s]+/).filter(Boolean).map(Number);
    if (v.length === 2 && v.every(Number.isFinite)) setValue("rod_video", "origin", v);
  });
  const turn = valueNumber("calibration", "tilt", "Turned by [°]", { factor: 180 / Math.PI, usual: 0 });
  turn.input.addEventListener("input", () => { if (picks().rail) { delete picks().rail; changed(); } }); // the later word counts
  const first = row("Origin", typed);
  first.append(set);
  const out = element("div", { className: "tool" }, first, turn.made, said);
  on("state section draft preview tool", () => {
    const a = axes(), round = (v) => Math.round(v * 10) / 10;
    out.classList.toggle("active", store.tool?.key === "origin");
    set.textContent = a ? "Take away" : "Place";
    set.hidden = Boolean(a) && store.draft.values.rod_video?.origin == null; // it stands in the file
    set.setAttribute("aria-label", a ? "Take the cross away" : "Place the cross: click the origin on the film");
    if (document.activeElement !== typed) typed.value = a ? a.o.map(round).join(", ") : "";
    said.textContent = a ? "Drag the middle of the cross to move it, the end of y to turn it."
      : "None: x and y count from the film's upper left corner.";
  });
  return out;
}

// Of double exposures alone; without it displacements are those of a pair.
function pairTime() {
  const { made } = valueNumber("grain_video", "pair_time", "From A to B [ms]", { factor: 1000 });
  on("state section preview", () => { made.hidden = !value("grain_video", "pairs"); });
  return made;
}

// A foot that goes through the grains is the origin, and is followed and left out: only where there is one.
function foot() {
  const made = element("details", {}, element("summary", { textContent: "A foot goes through the grains" }),
    place("foot", "Foot, on its axis", 2, "Click the foot's lower face on its axis: the origin, x right, y up"));
  on("state", () => { made.open = store.table.grain_video?.foot_row != null || store.state.films.some((f) => f.section === "rod_video"); });
  return made;
}

function polygons() {
  const said = element("span", { className: "note" });
  const draw = button("Draw", () => take({ key: "leave_out", numbers: 0, hint: "Click the corners; Enter or the button ends the polygon" }));
  draw.dataset.tool = "leave_out";
  const out = element("div", { className: "tool" }, element("div", { className: "row" },
    element("label", { textContent: "Polygons left out" }), draw, button("Remove last", () => {
      setPick("leave_out", (picks().leave_out ?? []).slice(0, -1));
    }), said));
  on("state section draft tool", () => {
    const n = (picks().leave_out ?? []).filter((p) => p.length >= 6).length, active = store.tool?.key === "leave_out";
    said.textContent = n ? `${n}` : "none";
    draw.textContent = active ? "End polygon" : "Draw";
    out.classList.toggle("active", active);
  });
  return out;
}

on("state section preview", () => {
  for (const [s, e] of Object.entries(made)) e.hidden = s !== store.section;
  roles.hidden = store.state.exists || !FIRST.includes(store.section);
  for (const b of roles.querySelectorAll("button")) b.setAttribute("aria-pressed", String(b.dataset.role === store.section));
  const scale = store.table[store.section]?.scale, sigma = store.table[store.section]?.scale_sigma;
  facts.textContent = scale ? `Scale: ${Number((1e3 * scale).toPrecision(4))} mm per pixel${sigma ? ` ± ${(100 * sigma / scale).toPrecision(2)} %` : ""}`
    : store.section === "rod_video" ? "No scale yet: a track stays in pixels until a ruler or the ball's diameter is given."
      : "No scale yet: all stays in pixels until a ruler and its length are given.";
});

// A click goes to the tool that is armed; without one, on the rod film, it is the ball.
onPick((c, r, shift) => {
  const tool = store.tool;
  if (store.section === "rod_video" && (tool?.key === "correct" || (shift && !tool))) { // as in Tracker: mark, and step on
    store.draft.corrections[store.frame] = [c, r];
    changed();
    emit("track");
    if (shift || store.stepOn) seek(store.frame + 1);
    return;
  }
  if (tool?.key === "markers") { take(null); setValue("params.track", "markers", [...others(), [c, r]]); return; }
  if (tool?.key === "origin") { take(null); setValue("rod_video", "origin", [c, r]); return; }
  if (!tool) { if (store.section === "rod_video" && ["scale", "find"].includes(store.step)) ballAt(c, r); return; }
  if (tool.key === "leave_out") {
    const all = (picks().leave_out ??= []);
    if (tool.open) all.at(-1).push(c, r); else all.push([c, r]);
    tool.open = true;
    emit("draft");
    return;
  }
  if (tool.put) { // brings its own place for what is drawn, by two clicks too
    tool.ends = [...(tool.ends ?? []), c, r];
    if (tool.ends.length === tool.numbers) { take(null); tool.put(tool.ends, true); }
    return;
  }
  if (tool.key === "ball") { ballAt(c, r); take(null); return; }
  const v = picks()[tool.key], old = Array.isArray(v) && v.length < tool.numbers ? v : [];
  const next = tool.numbers === 1 ? r : [...old, c, r];
  if (tool.numbers > 1 && next.length < tool.numbers) { setPick(tool.key, next); return; }
  take(null);
  if (tool.key === "rail") delete store.draft.values.calibration?.tilt; // two words for one angle: the later one counts
  setPick(tool.key, next);
});
onDraw((a, b, done) => { // a ruler, a rail or a part, from one end to the other
  const { key, put } = store.tool;
  if (put) { if (done) take(null); put([...a, ...b], done); return; }
  picks()[key] = [...a, ...b];
  if (!done) { emit("draft"); return; }
  take(null);
  if (key === "rail") delete store.draft.values.calibration?.tilt;
  changed();
  if (key === "marks" && picks().distance == null) length().focus(); // what comes next is its length
});
const length = () => made[store.section].querySelector("input[data-pick=distance]");

on("tool", () => { // a polygon that is ended is asked for; one of less than three corners is none
  const p = picks();
  if (store.tool?.key === "leave_out" || !p.leave_out) return;
  const whole = p.leave_out.filter((q) => q.length >= 6);
  if (whole.length !== p.leave_out.length || p.leave_out.open !== whole.length) { p.leave_out = whole; whole.open = whole.length; changed(); }
});

on("reseed undone", () => look(store.draft.picks.rod_video?.ball));

function ballAt(c, r) {
  picks("rod_video").ball = [c, r];
  changed();
  look([c, r]);
}

// The ball in the first frame, with or without a click.
export async function look(seed) {
  if (!film() || store.section !== "rod_video") return;
  const frame = FIRST.includes(store.section) ? 0 : store.frame;
  const found = await attempt(() => post("api/find", { section: store.section, frame, ...(seed && { seed }) }));
  store.ball = found ? { ...found, frame } : null;
  store.looked = true;
  emit("ball");
}

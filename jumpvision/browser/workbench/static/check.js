// Steps 3 and 4: lost frames, corrections by hand, logs on the same clock; then what is written, and the run.
import { attempt, changed, emit, get, on, post, setValue, store, value } from "./store.js";
import { button, element, row, take, valueNumber } from "./fields.js";
import { problem, uncorrect } from "./find.js";
import { seek } from "./player.js";

const check = document.getElementById("step-check"), runs = document.getElementById("step-run");
const counts = element("p", {}), why = element("p", { className: "note", data: { "aria-live": "polite" } });
const fix = button("Correct by hand", () => take({ key: "correct", numbers: 2, hint: "Click where the ball is in this frame" }));
fix.dataset.tool = "correct";
const typed = element("input", { type: "text", placeholder: "column, row", autocomplete: "off" });
typed.addEventListener("change", () => {
  const v = typed.value.split(/[,;\s]+/).filter(Boolean).map(Number);
  if (v.length === 2 && v.every(Number.isFinite)) { store.draft.corrections[store.frame] = v; changed(); emit("track"); }
});
const stepOn = element("input", { type: "checkbox" }); // for a finger: with a mouse Shift does it
stepOn.addEventListener("change", () => { store.stepOn = stepOn.checked; });
const list = element("ul", { className: "list" }), logs = element("div", {});
check.append(element("div", { className: "ball-only" }, element("h2", { textContent: "Is it right?" }), counts,
  element("div", { className: "buttons" }, button("‹ Previous lost", () => problem(-1)), button("Next lost ›", () => problem(1)), fix),
  row("After a click: next frame", stepOn), row("Ball in this frame", typed), why, element("h3", { textContent: "Corrected by hand" }), list),
  element("h3", { textContent: "Logs on the film's clock" }), logs);

on("state track frame draft tool", () => {
  const { rows } = store.track, hand = store.draft.corrections, lost = rows.filter((r, i) => r[3] && !hand[i]).length;
  counts.textContent = rows.length ? `${rows.length} frames: ${lost} lost, ${Object.keys(hand).length} corrected.` : "No track yet: step 2 makes one.";
  counts.className = rows.length && !lost ? "good" : "";
  const now = hand[store.frame] ?? rows[store.frame];
  if (document.activeElement !== typed) typed.value = now?.[0] == null ? "" : `${now[0].toFixed(1)}, ${now[1].toFixed(1)}`;
  why.textContent = rows[store.frame]?.[3] ? `Frame ${store.frame}: ${rows[store.frame][3]}` : "";
  fix.setAttribute("aria-pressed", String(store.tool?.key === "correct"));
  list.replaceChildren(...Object.entries(hand).map(([i, p]) => element("li", {},
    button(`Frame ${i}: ${p[0].toFixed(1)}, ${p[1].toFixed(1)}`, () => seek(Number(i))), button("Remove", () => uncorrect(i)))));
});

on("logs", () => {
  const made = store.logs.map((log) => element("div", { className: "tool" },
    element("strong", { textContent: `[${log.section}]` }), ...(log.problem ? [element("p", { className: "bad", textContent: log.problem })]
      : [valueNumber(log.section, "start", "Starts at [s]", { usual: 0 }).made])));
  const sigma = valueNumber("clock", "offset_sigma", "How well that is known, sigma [s]", { usual: 0 }).made;
  logs.replaceChildren(...(made.length ? [...made, sigma, element("p", { className: "note", textContent: "Drag a log under the film until its motion lies on that in the film; sigma is set to the time of one pixel." })]
    : [element("p", { className: "note", textContent: "There are none here." })]));
  emit("preview");
});

const rounded = (v) => Number(v.toPrecision(6));
export function shiftLog(log, by, perPixel) {
  setValue(log.section, "start", rounded((store.draft.values[log.section]?.start ?? value(log.section, "start") ?? 0) + by));
  setValue("clock", "offset_sigma", Number(perPixel.toPrecision(2)));
}

const diff = element("pre", { tabIndex: 0, data: { "aria-label": "What changes in experiment.toml" } }), wrote = element("p", { data: { "aria-live": "polite" } });
const write = button("Write experiment.toml", () => save(), "main");
write.id = "write";
const start = button("Run", () => go(), "main"), halt = button("Stop", () => attempt(() => post("api/run/stop")));
const bar = element("progress", { max: 1, value: 0, data: { "aria-label": "Experiments done" } });
const said = element("p", { id: "run-said", data: { "aria-live": "polite" } }), lines = element("pre", { tabIndex: 0, data: { "aria-label": "Lines of the run" } });
runs.append(element("h2", { textContent: "Write and run" }), diff, element("div", { className: "buttons" }, write), wrote,
  element("h3", { textContent: "The rest" }), element("div", { className: "buttons" }, start, halt), bar, said, element("details", {}, element("summary", { textContent: "Output of the run" }), lines));

on("state preview", () => {
  const p = store.preview, many = (store.state?.experiments.length ?? 0) > 1;
  start.textContent = many ? `Run the campaign (${store.state.experiments.length} experiments)` : "Run this experiment";
  write.disabled = !p || (!p.difference.length && store.state.exists && same());
  if (!p) return;
  diff.replaceChildren(...(p.difference.length ? p.difference : ["Nothing changes in the file."]).map((line) =>
    element("span", { className: line[0] === "+" ? "plus" : line[0] === "-" ? "minus" : "", textContent: `${line}\n` })));
});
const same = () => JSON.stringify(store.state.corrections) === JSON.stringify(store.draft.corrections);

export async function save() {
  const p = store.preview && (await attempt(() => post("api/preview", { draft: store.draft })));
  const done = p && (await attempt(() => post("api/write", { draft: store.draft, seen: store.preview.seen })));
  if (!done) { if (p) { store.preview = p; emit("preview"); } return; }
  wrote.className = "good";
  wrote.textContent = `Written: ${done.written.join(", ")}`;
  Object.assign(store.state, { exists: true, corrections: { ...store.draft.corrections } });
  store.draft = { picks: store.draft.picks, values: {}, corrections: store.draft.corrections }; // marks stay on the film
  changed();
}

async function go() {
  if (await attempt(() => post("api/run")) === undefined) return;
  watchRun();
}

export async function watchRun() {
  for (let began = false; ; began = true) {
    const now = await attempt(() => get("api/run"));
    if (!now) return;
    start.disabled = now.running;
    halt.disabled = !now.running;
    bar.hidden = now.said === undefined;
    if (now.total) { bar.max = now.total; bar.value = now.done; } else if (now.running) bar.removeAttribute("value"); else bar.value = bar.max;
    said.textContent = now.said ?? "";
    lines.hidden = !now.lines?.length;
    lines.textContent = (now.lines ?? []).join("\n");
    lines.scrollTop = lines.scrollHeight;
    if (!now.running) { if (began) emit("ran"); return; }
    await new Promise((done) => setTimeout(done, 500));
  }
}

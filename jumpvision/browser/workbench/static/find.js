// Step 2: the tracker as it runs, one pair of the grain film, the bed's surface.
import { attempt, changed, emit, get, latest, on, placed, post, store } from "./store.js";
import { button, element, row, valueChoice, valueNumber } from "./fields.js";
import { player, seek } from "./player.js";

const box = document.getElementById("step-find"), POLL = 150; // ms
const begin = button("Track the film", () => track(), "main"), stop = button("Stop", () => attempt(() => post("api/track/stop")));
const bar = element("progress", { max: 1, value: 0, data: { "aria-label": "Frames tracked" } });
const said = element("p", { className: "note", data: { "aria-live": "polite" } }), seen = element("p", {});
const follow = element("input", { type: "checkbox", checked: true });
begin.id = "track";

const rod = element("div", {}, seen,
  valueChoice("params.track", "polarity", "The ball is", [["bright", "brighter"], ["dark", "darker"]], "bright"),
  valueChoice("params.track", "method", "Method", [["disc", "disc fit"], ["threshold", "threshold, centroid"], ["template", "as a picture (any target)"]], "disc"),
  valueNumber("params.track", "diameter", "Size in the picture [px]").made,
  slider("params.track", "search", "Search window [diameters]", { min: 0.6, max: 10, step: 0.1 }, 1.5),
  element("div", { className: "buttons" }, begin, stop), bar, row("The film follows the tracker", follow), said);

const counts = element("p", {}), rejected = element("input", { type: "checkbox", checked: true });
rejected.addEventListener("change", () => { store.rejected = rejected.checked; emit("pair"); });
const live = element("input", { type: "checkbox", checked: true });
const grain = element("div", {},
  slider("params.piv", "window", "Window [px]", { min: 8, max: 96, step: 4, whole: true }, 24),
  slider("params.piv", "step", "Step [px]", { min: 4, max: 64, step: 2, whole: true }, 8),
  slider("params.piv", "min_correlation", "Least correlation", { min: 0, max: 0.95, step: 0.05 }, 0.3),
  slider("params.piv", "outlier", "Median test: largest residual", { min: 0.5, max: 10, step: 0.5 }, 2),
  row("Match again at every change", live), row("Show rejected vectors", rejected),
  element("div", { className: "buttons" }, button("Match this pair", () => match(), "main")), counts);
const surface = element("p", {});
const bed = element("div", {}, element("div", { className: "buttons" }, button("Find the surface", () => level(), "main")), surface);
const none = element("p", { className: "note", textContent: "Nothing is searched in this picture here; `jumpvision run` does it." });
const sections = { rod_video: rod, grain_video: grain, bed_image: bed, crater_image: none };
box.append(element("h2", { textContent: "What is found" }), ...Object.values(sections));

function slider(section, key, words, limits, usual) {
  const { made, input } = valueNumber(section, key, words, { ...limits, usual });
  if (section === "params.piv") input.addEventListener("input", () => { if (live.checked && store.pair) match(); });
  return made;
}

on("state section", () => { for (const [s, e] of Object.entries(sections)) e.hidden = s !== store.section; });
on("state ball", () => {
  const b = store.ball;
  seen.className = b ? "good" : "note";
  seen.textContent = b ? `Frame ${b.frame}: a ${b.polarity} ball ${b.diameter.toFixed(1)} px wide.`
    : store.draft.picks.rod_video?.ball ? "No plain ball there: it is followed as a picture."
      : "No single ball stands out in the first frame: click what is to be followed.";
});

export async function track() {
  if (store.track.running) return;
  if (await attempt(() => post("api/track", { draft: store.draft })) === undefined) return;
  store.track = { rows: [], running: true, finished: false };
  emit("track");
  watch();
}

export async function resume() { // a track that the server has, of before a reload
  const now = await get("api/track?since=0");
  if (!now.rows.length && !now.running) return;
  store.track = { rows: [], running: true, finished: false };
  watch();
}

async function watch() {
  let now;
  do {
    now = await attempt(() => get(`api/track?since=${store.track.finished ? 0 : store.track.rows.length}`));
    if (!now) break;
    const t = store.track;
    if (now.finished && !t.finished) { // the end looks at all frames once more
      now = (await attempt(() => get("api/track?since=0"))) ?? now;
      t.rows = now.rows;
    } else t.rows.push(...now.rows);
    Object.assign(t, { running: now.running, finished: now.finished, doing: now.doing ?? "", problem: now.problem ?? "", notes: now.notes ?? [] });
    if (follow.checked && t.running && t.rows.length && !player.playing) seek(t.rows.length - 1);
    emit("track");
    await new Promise((done) => setTimeout(done, POLL));
  } while (store.track.running);
  store.track.running = false;
  emit("track");
}

on("state track", () => {
  const { rows, running, finished, doing, problem, notes } = store.track, n = store.state?.films.find((f) => f.section === "rod_video")?.time.length ?? 1;
  begin.disabled = running;
  stop.disabled = !running;
  bar.max = n;
  bar.value = rows.length;
  const lost = rows.filter((r) => r[3]).length;
  said.textContent = problem ? problem : running ? doing
    : !rows.length ? "" : `${finished ? "Done" : "Stopped"}: ${rows.length - lost} of ${rows.length} frames found, ${lost} lost. ${(notes ?? []).join(". ")}`;
  said.className = problem ? "bad" : "note";
});

const match = latest(() => attempt(async () => {
  counts.textContent = "matching ...";
  const n = store.state.films.find((f) => f.section === "grain_video").time.length, gap = store.table.params?.piv?.gap ?? 1;
  try {
    store.pair = await post("api/pair", { draft: store.draft, frame: Math.min(store.frame, n - 1 - gap) });
  } catch (e) { counts.textContent = ""; throw e; }
  const { x, measured, reason, reasons, frame } = store.pair, why = {};
  for (const r of reason) if (reasons[r]) why[reasons[r]] = (why[reasons[r]] ?? 0) + 1;
  counts.textContent = `Frames ${frame} and ${frame + gap}: ${measured} of ${x.length} vectors measured. ${Object.entries(why).map(([k, v]) => `${v}: ${k}`).join(". ")}`;
  if (frame !== store.frame) seek(frame);
  emit("pair");
}));

const level = latest(() => attempt(async () => {
  store.bed = await post("api/bed", { draft: store.draft, frame: store.frame });
  const n = store.bed.row.length;
  surface.textContent = `Surface in ${n - store.bed.lost} of ${n} columns. ${store.bed.why}`;
  emit("bed");
}));
on("frame", () => { store.bed = null; });

export function act() { // the button of this section
  ({ rod_video: track, grain_video: match, bed_image: level })[store.section]?.();
}

export function problem(direction) { // the next frame that is lost, or corrected
  const n = store.track.rows.length;
  for (let i = store.frame + direction; i >= 0 && i < n; i += direction) if (!placed(i) || store.draft.corrections[i]) return seek(i);
}
export const uncorrect = (i) => { delete store.draft.corrections[i]; changed(); emit("track"); };

// Step 2: the tracker as it runs, the flow, the bed's surface.
import { attempt, changed, emit, get, latest, on, placed, post, store, value } from "./store.js";
import { button, element, row, valueChoice, valueNumber } from "./fields.js";
import { match, panel } from "./flow.js";
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

const surface = element("p", { id: "surface", data: { "aria-live": "polite" } }), packing = element("p", { id: "packing" });
const level = valueNumber("params.bed", "threshold", "Grains are darker than [grey levels]", { min: 0, max: 255, step: 1, usual: 128 });
const bed = element("div", {}, valueChoice("params.bed", "method", "Surface by", [["edge", "edges"], ["threshold", "a threshold"]], "edge"), level.made, element("div", { className: "buttons" }, button("Find the surface", () => find(), "main")), surface, packing);
const line = element("p", { data: { "aria-live": "polite" } }), volume = element("p", { id: "volume" });
const crater = element("div", {}, slider("params.crater", "contrast", "Least contrast of the line (share of the typical)", { min: 0, max: 1, step: 0.02 }, 0.2),
  valueNumber("params.crater", "radius", "Undisturbed beyond [mm]", { factor: 1000 }).made,
  element("div", { className: "buttons" }, button("Find the line", () => find(), "main")), line, volume);
const sections = { rod_video: rod, grain_video: panel, bed_image: bed, crater_image: crater };
box.append(element("h2", { textContent: "What is found" }), ...Object.values(sections));

function slider(section, key, words, limits, usual) {
  const { made } = valueNumber(section, key, words, { ...limits, usual });
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
  const before = store.track, begun = { rows: [], running: true, finished: false };
  store.track = begun; // at once: the old track is no longer shown as this one
  emit("track");
  const answer = await attempt(() => post("api/track", { draft: store.draft }));
  if (store.track !== begun) return; // another experiment meanwhile
  if (answer === undefined) { // refused, and said
    store.track = before;
    emit("track");
  } else watch(true); // and shown to its last frame
}

export async function resume() { // a track that the server has, of before a reload
  const now = await get("api/track?since=0");
  if ((!now.rows.length && !now.running) || store.track.running || store.track.rows.length) return; // a hand was quicker
  store.track = { rows: [], running: true, finished: false };
  watch();
}

async function watch(toEnd = false) {
  const t = store.track; // another track, or another experiment, ends this loop
  let now;
  do {
    now = await attempt(() => get(`api/track?since=${t.finished ? 0 : t.rows.length}`));
    if (!now || store.track !== t) break;
    if (now.finished && !t.finished) { // the end looks at all frames once more
      now = (await attempt(() => get("api/track?since=0"))) ?? now;
      t.rows = now.rows;
    } else t.rows.push(...now.rows);
    Object.assign(t, { running: now.running, finished: now.finished, doing: now.doing ?? "", problem: now.problem ?? "", notes: now.notes ?? [] });
    if (follow.checked && (t.running || toEnd) && t.rows.length && !player.playing) seek(t.rows.length - 1);
    emit("track");
    await new Promise((done) => setTimeout(done, POLL));
  } while (t.running && store.track === t);
  t.running = false;
  if (store.track === t) emit("track");
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

const short = ([v, s], k, unit) => { const digits = s > 0 ? Math.max(0, 1 - Math.floor(Math.log10(k * s))) : 3; return `${(k * v).toFixed(digits)} ± ${(k * s).toFixed(digits)}${unit}`; };
const find = latest(() => attempt(async () => {
  const { section } = store, found = await post(section === "bed_image" ? "api/bed" : "api/crater", { draft: store.draft, frame: store.frame });
  if (section !== store.section) return; // another picture came meanwhile
  store.bed = found;
  (section === "bed_image" ? ofBed : ofCrater)(found, found.row.length);
  emit("bed");
}));
const columns = (what, n, lost, why) => `${what} in ${n - lost} of ${n} columns${why ? `; in the others: ${why}` : ""}.`;
function ofBed({ levels, threshold, height, phi, lacks, lost, why }, n) {
  Object.assign(level.input, { min: Math.floor(levels[0]), max: Math.ceil(levels[1]) });
  if (value("params.bed", "threshold") == null) level.input.dataset.usual = level.input.value = level.made.querySelector("output").textContent = Math.round(threshold);
  packing.textContent = [height && `Height ${short(height, 1e3, " mm")}.`, phi && `Volume fraction phi = ${short(phi, 1, "")}.`, lacks].filter(Boolean).join(" ");
  surface.textContent = columns("Surface", n, lost, why);
}
function ofCrater({ volume: v, depth, radius, lacks, lost, why }, n) {
  line.textContent = columns("Line", n, lost, why);
  volume.textContent = v ? `Volume change ${short(v, 1e6, " cm³")}, ${(1e3 * depth).toFixed(1)} mm deep, undisturbed beyond ${(1e3 * radius).toFixed(1)} mm.` : lacks;
}
on("frame", () => { store.bed = null; });

// What else may be the ball in the frame that is shown, once the film is followed.
const candidates = latest(async () => {
  const frame = store.frame, list = await post("api/candidates", { frame });
  store.candidates = { frame, list };
  emit("image");
});
on("frame", () => {
  if (store.section === "rod_video" && store.track.rows.length && !store.track.running && !player.playing) attempt(candidates);
});
on("section preview", () => { level.made.hidden = value("params.bed", "method") !== "threshold"; });
on("preview", () => { if (store.bed) find(); }); // drawn anew as the slider moves

export function act() { // the button of this section
  ({ rod_video: track, grain_video: match, bed_image: find, crater_image: find })[store.section]?.();
}

export function problem(direction) { // the next frame that is lost, or corrected
  const n = store.track.rows.length;
  for (let i = store.frame + direction; i >= 0 && i < n; i += direction) if (!placed(i) || store.draft.corrections[i]) return seek(i);
}
export const uncorrect = (i) => { delete store.draft.corrections[i]; changed(); emit("track"); };

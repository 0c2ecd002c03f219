// Questions to the server, and what the page knows: whoever changes that says so with emit(topic), whoever shows it
// listens with on(topic). What the server refuses is thrown as Refusal, with its texts.
export class Refusal extends Error {
  constructor(problems) { super(problems.join("\n")); this.problems = problems; }
}

async function answer(reply) {
  const body = await reply.json();
  if (!reply.ok) throw new Refusal(body.problems);
  return body;
}

const gone = new Refusal(["The server does not answer; is `jumpvision open` still running?"]);

export async function get(path) {
  const reply = await fetch(path).catch(() => { throw gone; });
  return answer(reply);
}

export async function post(path, question = {}) {
  const reply = await fetch(path, {
    method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(question),
  }).catch(() => { throw gone; });
  return answer(reply);
}

// Of calls that come while one is under way only the last is made afterwards.
export function latest(work) {
  let busy = false, again = null;
  return async function run(...args) {
    if (busy) { again = args; return; }
    busy = true;
    try { await work(...args); } finally {
      busy = false;
      if (again) { const next = again; again = null; run(...next); }
    }
  };
}

export async function picture(section, frame, width) {
  const reply = await fetch(`api/frame/${section}/${frame}/${width}.jpg`).catch(() => { throw gone; });
  if (!reply.ok) throw new Refusal((await reply.json()).problems);
  return createImageBitmap(await reply.blob());
}

const listeners = {};
export const on = (topics, work) => topics.split(" ").forEach((t) => (listeners[t] ??= []).push(work));
export const emit = (topic) => (listeners[topic] ?? []).forEach((work) => work());

export const store = {
  state: null,        // of the server: films, experiments, given
  table: {},          // tables of the experiment.toml that the draft makes
  preview: null,      // its text, difference and what it was made from
  section: "", frame: 0, step: "scale",
  tool: null,         // {key, numbers, drag}: what a click, or a drag, on the film sets
  draft: { picks: {}, values: {}, corrections: {} },
  ball: null,         // found in the frame that the track begins with
  track: { rows: [], running: false },
  candidates: null,   // of one frame: {frame, list of x, y, diameter, probability}
  bed: null, logs: [], rejected: true, stepOn: false,
  plot: { x: "time", y: "y", curve: "", part: null }, columns: null, fit: null,
};

export const film = () => store.state?.films.find((f) => f.section === store.section);
export const picks = (section = store.section) => (section ? (store.draft.picks[section] ??= {}) : {}); // without a film: none
export const value = (section, key) => section.split(".").reduce((t, part) => t?.[part], store.table)?.[key];
export const mine = (section, key) => store.draft.values[section]?.[key];

// Times of a film's frames on the common clock [s]: its own, or by the frame rate where that is to be taken.
const clocks = {};
export function times(section = store.section) {
  const f = store.state.films.find((g) => g.section === section), t = f.time, n = t.length;
  const { frame_rate: rate, clock, start = 0 } = store.table[section] ?? {}, declared = rate && n > 1 && (!f.timed || clock === "declared");
  const key = `${store.state.folder} ${section} ${declared ? rate : 0} ${start}`;
  if (clocks[section]?.key !== key) {
    const steps = declared ? t.slice(1).map((v, i) => v - t[i]).sort((a, b) => a - b) : [], k = declared ? 1 / (rate * steps[steps.length >> 1]) : 1;
    clocks[section] = { key, time: t.map((v) => start + (v - t[0]) * k) };
  }
  return clocks[section].time;
}

// A place that is shown: hand before what was found.
export const placed = (i) => store.draft.corrections[i] ?? (store.track.rows[i]?.[0] == null ? null : store.track.rows[i]);

export function trouble(error) {
  const box = document.getElementById("trouble");
  if (error && !(error instanceof Refusal)) console.error(error);
  box.hidden = !error;
  box.textContent = error ? (error.problems ?? [String(error)]).join("\n") : "";
}

export async function attempt(work) {
  try { const answer = await work(); trouble(null); return answer; } catch (e) { trouble(e); return undefined; }
}

// Every change of the draft asks what it makes; a draft that is refused leaves the last one standing.
const ask = latest(() => attempt(async () => {
  const made = await post("api/preview", { draft: store.draft });
  Object.assign(store, { preview: made, table: made.table });
  emit("preview");
}));
export function changed() { emit("draft"); emit("changed"); ask(); }

export function setPick(key, v) { picks()[key] = v; changed(); }
export function setValue(section, key, v) { (store.draft.values[section] ??= {})[key] = v; changed(); }

export async function load(state, section = "") {
  Object.assign(store, { state, table: state.given, frame: 0, tool: null, ball: null, bed: null, preview: null,
    track: { rows: [], running: false }, draft: { picks: {}, values: {}, corrections: { ...state.corrections } } });
  store.section = section || (state.films[0]?.section ?? "");
  Object.assign(store, { columns: null, fit: null, plot: { x: "time", y: "y", curve: "", part: null } });
  emit("fresh");
  emit("state");
  emit("begun");
  ask();
  await attempt(async () => { store.logs = await post("api/logs", { draft: store.draft }); emit("logs"); });
}

export const start = async () => load(await get("api/state"));

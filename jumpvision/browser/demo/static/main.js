// State of the page and its conversation with the server. All physics is the server's.
import { build } from "./controls.js";
import { Hand } from "./hand.js";
import { HeightMap } from "./map.js";
import { Robot } from "./robot.js";
import { Traces } from "./traces.js";
import { headline, story, table } from "./words.js";

const $ = (id) => document.getElementById(id);
const still = matchMedia("(prefers-reduced-motion: reduce)");
const page = await (await fetch("api/page")).json();
const fresh = (ground) => structuredClone({ ground, set: page.grounds[ground].defaults, sand: "cone", two: false, hand: null,
  frequency2: page.grounds[ground].defaults.actuation.frequency });
const states = { hard: fresh("hard"), granular: fresh("granular") };
let state = states.hard, answer = null, time = 0, playing = !still.matches, rested = 0, before = 0, dirty = true;

async function post(path, question) {
  const reply = await fetch(path, {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify(question),
  });
  return { ok: reply.ok, ...(await reply.json()) };
}

const question = () => ({ ground: state.ground, set: state.set, hand: state.hand, ...(state.two && { frequency2: state.frequency2 }) });

// One question at a time; what changes meanwhile is asked afterwards.
let busy = false, again = false;
async function ask() {
  again = true;
  if (busy) return;
  busy = true;
  while (again) {
    again = false;
    const asked = question(), from = state;
    let reply;
    try {
      reply = await post("api/jump", asked);
    } catch {
      reply = { ok: false, problems: [{ keys: [], text: "The server does not answer; is `jumpvision demo` still running?" }] };
    }
    if (from !== state) { again = true; continue; }
    if (reply.ok) show(reply, asked); else complain(reply.problems);
  }
  busy = false;
}

function complain(problems) {
  controls.fail(problems);
  $("trouble").hidden = false;
  const kept = answer ? "The last jump that could be computed is shown." : "";
  $("trouble").textContent = `No jump for these values. ${problems.map((p) => p.text).join(". ")}. ${kept}`;
}

function show(reply, asked) {
  const first = answer === null || answer.ground !== asked.ground;
  answer = { ...reply, ground: asked.ground };
  const { motion, numbers } = reply;
  controls.fail([]);
  $("trouble").hidden = true;
  $("headline").textContent = headline(numbers);
  $("story").textContent = story(numbers);
  $("numbers").replaceChildren(...table(numbers, asked).flatMap(([term, value]) => [
    Object.assign(document.createElement("dt"), { textContent: term }), Object.assign(document.createElement("dd"), { textContent: value })]));
  $("robot").setAttribute("aria-label", `The jumping robot: ${headline(numbers)}`);
  robot.fit(motion, asked.set.robot, asked.set.actuation.amplitude, numbers.jump_height_m);
  if (hand.log) time = asked.hand ? asked.hand.t.at(-1) : 0;
  else if (first) time = still.matches ? apex(motion) : motion.t[0];
  time = Math.min(time, motion.t.at(-1));
  map.f0 = numbers.f0_Hz;
  map.point = asked.hand ? null : [asked.set.actuation.frequency, asked.set.actuation.phase];
  map.draw();
  askMap(reply.exact);
  dirty = true;
}

const apex = (motion) => motion.t[motion.rod.indexOf(Math.max(...motion.rod))];

let mapKey = "", mapTimer = 0;
function askMap(exact) {
  const { actuation, ...rest } = state.set, { frequency, phase, kind, ...law } = actuation;
  const key = JSON.stringify([state.ground, rest, law, state.two && state.frequency2]);
  if (key === mapKey || hand.log) return;
  mapKey = key;
  clearTimeout(mapTimer);
  map.run++;
  const asked = { ...question(), hand: null };
  mapTimer = setTimeout(() => map.refresh(asked, exact, controls.range("frequency")), 150);
}

function change(slider, value) {
  if (slider.key === "frequency2") state.frequency2 = value;
  else state.set[slider.section][slider.key] = value;
  if (slider.section === "actuation") byLaw();
  kindOf();
  ask();
}

function byLaw() {
  state.hand = null;
  $("law").hidden = true;
}

// Marks the jump type that the law is, if it is one.
function kindOf() {
  const law = state.set.actuation, { presets } = page.grounds[state.ground];
  const same = (a, b) => Math.abs(a - b) < 0.016;
  const kind = Object.keys(presets).find((k) => same(presets[k].phase, law.phase) && law.cycles === 1 && (law.delay > 0) === (presets[k].delay > 0));
  law.kind = kind ?? "sine";
  for (const input of document.querySelectorAll("input[name=kind]")) input.checked = input.value === law.kind;
}

function enter(ground) {
  state = states[ground];
  mapKey = "";
  clearTimeout(mapTimer);
  map.forget();
  $("law").hidden = !state.hand;
  controls.show(state);
  kindOf();
  ask();
}

const controls = build($("controls"), page, {
  change,
  two(on) { state.two = on; byLaw(); controls.show(state); ask(); },
  sand(law) { state.sand = law; state.set.model.terms = page.sand[law]; controls.show(state); ask(); },
  reset() { states[state.ground] = fresh(state.ground); enter(state.ground); },
});
const robot = new Robot($("robot"), $("grip"));
const traces = new Traces($("traces"), scrubTo);
const map = new HeightMap($("map"), $("map-note"), async (q) => {
  const reply = await post("api/map", q).catch(() => ({ ok: false }));
  return reply.ok ? reply : null;
}, (f, phase) => {
  Object.assign(state.set.actuation, { frequency: Number(f.toFixed(2)), phase: Number(phase.toFixed(3)) });
  byLaw();
  controls.set("frequency", f);
  controls.set("phase", phase);
  kindOf();
  ask();
});
map.table = page.colours;
const hand = new Hand($("grip"), () => ({ scale: robot.scale, travel: robot.size.travel }), {
  begin() { playing = false; robot.held = true; },
  moved(record) { state.hand = record; ask(); },
  end(record) {
    robot.held = false;
    $("hint").hidden = true;
    if (record) {
      state.hand = record;
      $("law").hidden = false;
      time = -0.05;
      playing = !still.matches;
    }
    ask();
  },
});

for (const input of document.querySelectorAll("input[name=ground]")) input.onchange = () => enter(input.value);
for (const input of document.querySelectorAll("input[name=kind]")) {
  input.onchange = () => {
    Object.assign(state.set.actuation, page.grounds[state.ground].presets[input.value]);
    byLaw();
    controls.show(state);
    ask();
  };
}
$("law").onclick = () => { byLaw(); ask(); $("play").focus(); };

function play(on) {
  playing = on;
  if (on && answer && time >= answer.motion.t.at(-1)) time = answer.motion.t[0];
  dirty = true;
}
function scrubTo(t) { playing = false; time = t; dirty = true; }
$("play").onclick = () => play(!playing);
$("scrub").oninput = () => {
  const { t } = answer.motion;
  scrubTo(t[0] + ($("scrub").value / 1000) * (t.at(-1) - t[0]));
};
document.onkeydown = (e) => {
  if (e.key !== " " || e.target.closest("button, select, summary, input[type=radio], input[type=checkbox]")) return;
  e.preventDefault();
  play(!playing);
};

function frame(now) {
  requestAnimationFrame(frame);
  const passed = Math.min(0.1, (now - before) / 1e3);
  before = now;
  if (!answer) return;
  const { motion } = answer, end = motion.t.at(-1);
  if (playing) {
    time += passed * Number($("speed").value);
    if (time >= end) { // rests a moment at the end, then begins again
      time = end;
      rested += passed;
      if (rested > 0.8) { rested = 0; time = motion.t[0]; }
    }
  }
  if (!playing && !dirty && traces.pointer === traces.drawn) return;
  dirty = false;
  traces.drawn = traces.pointer;
  robot.draw(motion, time);
  traces.draw(motion, time, answer.ground);
  $("play").textContent = playing ? "❚❚" : "▶";
  $("play").setAttribute("aria-label", playing ? "Pause" : "Play");
  if (document.activeElement !== $("scrub") || playing) $("scrub").value = Math.round((1000 * (time - motion.t[0])) / (end - motion.t[0]));
  $("clock").textContent = `${Math.round(time * 1e3)} ms`.replace("-", "−");
  $("scrub").setAttribute("aria-valuetext", $("clock").textContent);
}

const redraw = () => { dirty = true; map.draw(); };
addEventListener("resize", redraw);
const sizes = new ResizeObserver(redraw);
for (const canvas of document.querySelectorAll("canvas")) sizes.observe(canvas);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);

enter("hard");
requestAnimationFrame(frame);

// The page: what is set, the jump that follows from it (physics/), and what is shown of it.
import { build } from "./controls.js";
import { Hand } from "./hand.js";
import page from "./page.js";
import { problems } from "./physics/check.js";
import { jump } from "./physics/jump.js";
import { LESSONS, SEALED } from "./play/challenges.js";
import { Saved } from "./play/saved.js";
import { decode, encode, fresh, lawOf, question, take } from "./play/state.js";
import { Energy } from "./view/energy.js";
import { HeightMap } from "./view/map.js";
import { Robot } from "./view/robot.js";
import { Task } from "./view/task.js";
import { Traces } from "./view/traces.js";
import { current, headline, languages, mm, number, rise, speak, story, t, table } from "./words.js";

const $ = (id) => document.getElementById(id);
const still = matchMedia("(prefers-reduced-motion: reduce)");
const states = { hard: fresh("hard"), granular: fresh("granular") };
let state = states.hard, answer = null, time = 0, playing = !still.matches, rested = 0, before = 0, dirty = true;

// Answered at the next frame: a slider that moves faster is answered once.
let asked = false;
function ask() {
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => {
    asked = false;
    const q = structuredClone(question(state)), wrong = problems(q, page.sliders, (s) => isShown(s, state));
    if (wrong.length) { complain(wrong); return; }
    try { show(jump(q), q); } catch (e) {
      if (!e.keys) throw e;
      complain([{ keys: e.keys, word: `bad_${e.message}`, values: {} }]);
    }
  });
}

const isShown = (s, { ground, sand, two }) => (s.only === "" || s.only === ground || (ground === "granular" && s.only === sand))
  && (s.key !== "frequency2" || two);

function complain(list) {
  const said = list.map(({ keys, word, values }) => ({ keys, text: t(word, { ...values, label: values.key && t(`s_${values.key}`) }) }));
  controls.fail(said);
  $("trouble").hidden = false;
  $("trouble").textContent = `${t("trouble")} ${said.map((p) => `${p.text}.`).join(" ")} ${answer ? t("kept") : ""}`;
}

function show(reply, q) {
  const first = answer === null || answer.question.ground !== q.ground;
  answer = { ...reply, question: q };
  const { motion, numbers } = reply;
  controls.fail([]);
  $("trouble").hidden = true;
  tell();
  robot.fit(motion, q.set.robot, q.set.actuation.amplitude, rise(numbers, q.hand));
  if (hand.log) time = q.hand ? q.hand.t.at(-1) : 0;
  else if (first) time = still.matches ? apex(motion) : motion.t[0];
  time = Math.min(time, motion.t.at(-1));
  map.f0 = numbers.f0_Hz;
  map.point = q.hand ? null : [q.set.actuation.frequency, q.set.actuation.phase];
  map.draw();
  askMap();
  remember();
  dirty = true;
}

// The result in words, in the language of the page.
function tell() {
  const { numbers, question: q } = answer;
  $("headline").textContent = headline(numbers, q.hand);
  $("story").textContent = story(numbers, q.hand);
  $("numbers").replaceChildren(...table(numbers, q).flatMap(([term, value]) => [
    Object.assign(document.createElement("dt"), { textContent: term }), Object.assign(document.createElement("dd"), { textContent: value })]));
  $("robot").setAttribute("aria-label", `${t("the_robot")}: ${headline(numbers, q.hand)}`);
  task.tell(answer, state);
  traces.dots = task.sealed.dots(state);
  dirty = true;
}

const apex = (motion) => motion.t[motion.rod.indexOf(Math.max(...motion.rod))];

// The link in the address bar, once the settings rest: browsers refuse many changes a second.
let linkTimer = 0;
function remember() {
  clearTimeout(linkTimer);
  linkTimer = setTimeout(() => history.replaceState(null, "", `#${encode(state)}`), 300);
}

let mapKey = "", mapTimer = 0;
function askMap() {
  const { actuation, ...rest } = state.set, { frequency, phase, kind, ...law } = actuation;
  const key = JSON.stringify([state.ground, state.sand, rest, law, state.two && state.frequency2]);
  if (key === mapKey || hand.log) return;
  mapKey = key;
  clearTimeout(mapTimer);
  map.run++;
  const q = structuredClone({ ...question(state), hand: null });
  mapTimer = setTimeout(() => map.refresh(q, controls.range("frequency")), 150);
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

function enter(ground, goal = states[ground].task) {
  if (goal === SEALED && !states[ground].world) states[ground] = fresh(ground);
  state = states[ground];
  task.set(state, goal);
  mapKey = "";
  clearTimeout(mapTimer);
  map.forget();
  $("law").hidden = !state.hand;
  controls.show(state);
  kindOf();
  ask();
}

const make = () => build($("controls"), page, {
  change,
  two(on) { state.two = on; byLaw(); controls.show(state); ask(); },
  sand(law) { state.sand = law; controls.show(state); ask(); },
  reset() {
    const { task: goal, world } = state;
    states[state.ground] = { ...fresh(state.ground), world };
    enter(state.ground, goal);
  },
}, isShown);

// Everything that is written, in a language.
function talk(name) {
  speak(name);
  const options = (list) => list.map(([value, text]) => Object.assign(document.createElement("option"), { value, textContent: text }));
  $("language").replaceChildren(...options(languages.map((l) => [l, page.words.language[l]])));
  $("language").value = current();
  task.name(state.task);
  $("map").setAttribute("aria-label", `${t("map")}; ${t("map_help")}`);
  $("told").textContent = "";
}
const task = new Task({
  law: () => lawOf(state),
  show(law) { take(state, law); $("law").hidden = !state.hand; controls.show(state); kindOf(); ask(); },
  changed() { remember(); if (answer) tell(); },
  chosen(goal) { enter(state.ground, goal); },
});
talk(navigator.language.slice(0, 2));
let controls = make();
const robot = new Robot($("robot"), $("grip"));
const energy = new Energy($("energy"));
const traces = new Traces($("traces"), scrubTo);
const map = new HeightMap($("map"), $("map-note"), (f, phase) => {
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

for (const input of document.querySelectorAll("input[name=ground]")) input.onchange = () => enter(input.value, state.task);
for (const input of document.querySelectorAll("input[name=kind]")) {
  input.onchange = () => {
    Object.assign(state.set.actuation, page.grounds[state.ground].presets[input.value]);
    byLaw();
    controls.show(state);
    ask();
  };
}
for (const button of document.querySelectorAll("button[data-lesson]")) {
  button.onclick = () => {
    const { kind, goal } = LESSONS[button.dataset.lesson];
    states.hard = fresh("hard");
    Object.assign(states.hard.set.actuation, page.grounds.hard.presets[kind]);
    for (const input of document.querySelectorAll("input[name=ground]")) input.checked = input.value === "hard";
    enter("hard", goal);
  };
}
const saved = new Saved($("saved"), follow);
$("language").onchange = () => {
  talk($("language").value);
  controls = make();
  controls.show(state);
  saved.show();
  if (answer) tell();
  redraw();
};
$("save").onclick = () => {
  const { numbers, question: q } = answer, law = q.set.actuation;
  const how = q.hand ? t("by_hand") : `${number(law.frequency, 2)} Hz`;
  saved.add(`${t(q.ground)}, ${how}: ${mm(rise(numbers, q.hand))}`, encode(state));
  $("runs").hidden = false;
};
$("share").onclick = async () => {
  const link = new URL(`#${encode(state)}`, location.href).href;
  history.replaceState(null, "", link);
  try {
    await navigator.clipboard.writeText(link);
    $("told").textContent = t("shared");
  } catch { $("told").textContent = t("address"); }
};

// Shows the jump of a link, or says that it holds none.
function follow(link) {
  const found = decode(link);
  if (!found) { $("told").textContent = t("bad_link"); return; }
  states[found.ground] = found;
  for (const input of document.querySelectorAll("input[name=ground]")) input.checked = input.value === found.ground;
  enter(found.ground);
}
addEventListener("hashchange", () => { if (location.hash.slice(1) !== encode(state)) follow(location.hash.slice(1)); });
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
  traces.draw(motion, time, answer.question.ground);
  energy.draw(motion, answer.bars, time);
  $("play").textContent = playing ? "❚❚" : "▶";
  $("play").setAttribute("aria-label", t(playing ? "pause" : "play"));
  if (document.activeElement !== $("scrub") || playing) $("scrub").value = Math.round((1000 * (time - motion.t[0])) / (end - motion.t[0]));
  $("clock").textContent = `${Math.round(time * 1e3)} ms`.replace("-", "−");
  $("scrub").setAttribute("aria-valuetext", $("clock").textContent);
}

const redraw = () => { dirty = true; map.draw(); };
addEventListener("resize", redraw);
const sizes = new ResizeObserver(redraw);
for (const canvas of document.querySelectorAll("canvas")) sizes.observe(canvas);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);

saved.show();
$("runs").hidden = !saved.jumps.length;
if (location.hash.length > 1 && decode(location.hash.slice(1))) follow(location.hash.slice(1));
else {
  if (location.hash.length > 1) $("told").textContent = t("bad_link");
  enter("hard");
}
requestAnimationFrame(frame);

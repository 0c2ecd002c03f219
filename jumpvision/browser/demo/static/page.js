// The page: what the knobs say, the jump that follows from it (physics.js), and what is shown of it.
import { page } from "./made.js";
import { mm, numberText } from "./draw.js";
import { HeightMap } from "./map.js";
import { jumpMotion, jumpNumbers } from "./physics.js";
import { RobotView } from "./robot.js";
import { Traces } from "./traces.js";

const MAP_PAUSE = 150; // ms without a change before the map is computed
const END_PAUSE = 0.8; // s at the end of the motion before it begins again
const STEP = 0.005; // s
const $ = (id) => document.getElementById(id);
const element = (tag, props, ...children) => {
  const node = Object.assign(document.createElement(tag), props);
  node.append(...children);
  return node;
};
const radios = (name) => document.querySelectorAll(`input[name=${name}]`);
const still = matchMedia("(prefers-reduced-motion: reduce)");
const jumps = Object.fromEntries(Object.entries(page.grounds).map(([name, { jump }]) => [name, structuredClone(jump)]));
let ground = "hard", motion = null, time = 0, playing = !still.matches, rested = 0, before = 0, isDirty = true;

// --- what is set

const knobs = page.knobs.map((knob) => {
  const id = `knob-${knob.key}`, range = element("input", { type: "range", id, min: knob.lo, max: knob.hi, step: knob.step });
  const value = element("output", { htmlFor: id });
  $("knobs").append(element("div", { className: "row" }, element("label", { htmlFor: id, textContent: knob.label }), value, range));
  const write = (v) => {
    value.textContent = `${Number(v.toFixed(2))} ${knob.unit}`;
    range.setAttribute("aria-valuetext", value.textContent);
  };
  range.oninput = () => {
    write(Number(range.value));
    set({ [knob.key]: Number(range.value) / knob.factor });
  };
  return { ...knob, show(law) { range.value = law[knob.key] * knob.factor; write(law[knob.key] * knob.factor); } };
});

function set(values) {
  Object.assign(jumps[ground].law, values);
  showKind();
  ask();
}

// Marks the jump type that the law is, if it is one.
function showKind() {
  const { law } = jumps[ground], { presets } = page.grounds[ground];
  for (const input of radios("kind")) {
    const { phase, delay } = presets[input.value];
    input.checked = Math.abs(phase - law.phase) < 0.016 && (delay > 0) === (law.delay > 0);
  }
}

function showKnobs() {
  for (const knob of knobs) knob.show(jumps[ground].law);
  showKind();
}

for (const input of radios("kind")) input.onchange = () => { set(page.grounds[ground].presets[input.value]); showKnobs(); };
for (const input of radios("ground")) input.onchange = () => enter(input.value);
$("reset").onclick = () => { jumps[ground] = structuredClone(page.grounds[ground].jump); enter(ground); };

function enter(name) {
  ground = name;
  motion = null;
  map.forget();
  showKnobs();
  ask();
}

// --- the jump

// Answered at the next frame: a knob that moves faster is answered once.
let isAsked = false;
function ask() {
  if (!isAsked) requestAnimationFrame(show);
  isAsked = true;
}

function show() {
  isAsked = false;
  const jump = jumps[ground], { robot, law } = jump, numbers = jumpNumbers(jump), isNew = motion === null;
  motion = jumpMotion(jump, numbers);
  tell(jump, numbers);
  view.fit(motion, jump, numbers.jump_height_m);
  if (isNew) time = still.matches ? motion.t[motion.rod.indexOf(Math.max(...motion.rod))] : motion.t[0];
  time = Math.min(time, motion.t.at(-1));
  map.natural = naturalFrequency(robot);
  map.point = [law.frequency, law.phase];
  map.draw();
  askMap(jump);
  isDirty = true;
}

const naturalFrequency = (robot) => Math.sqrt(robot.spring_stiffness / (robot.motor_mass + robot.rod_mass)) / (2 * Math.PI);

// The map depends on ground, amplitude and delay.
let mapKey = "", mapTimer = 0;
function askMap({ robot, law }) {
  const key = [ground, law.amplitude, law.delay].join();
  if (key === mapKey && map.heights) return;
  mapKey = key;
  map.run++;
  clearTimeout(mapTimer);
  mapTimer = setTimeout(() => map.refresh(ground, { robot, law: { ...law } }), MAP_PAUSE);
}

function tell({ robot, law }, numbers) {
  const { n_jumps: n, flights, stop_s: stop, jump_height_m: height } = numbers, f0 = naturalFrequency(robot), ms = (t) => `${numberText(t * 1e3, 1)}\u00a0ms`;
  $("headline").textContent = n ? `The rod rises ${mm(height)}` : "The foot stays on the ground";
  $("story").textContent = n
    ? `Its greatest rise above rest after the motor stops. ${n === 1 ? "One flight" : `${n} flights`}; the foot lifts off ${ms(flights[0][0])} after the motor starts, which runs for ${ms(stop)}.`
    : `The rod rises ${mm(height)}, the foot does not.`;
  const rows = [["rise of the centre of mass", mm(numbers.com_height_m)], ["flight height g t²/8", mm(numbers.flight_height_m)],
    ["natural frequency f₀", `${numberText(f0, 2)}\u00a0Hz`], ["f / f₀", numberText(law.frequency / f0, 2)]];
  if (robot.bed) rows.push(["deepest point of the foot", mm(numbers.depth_m)], ["mass of the jammed cone", `${numberText(1e3 * Math.max(...motion.cone_mass), 0)}\u00a0g`]);
  $("numbers").replaceChildren(...rows.flatMap(([term, value]) => [element("dt", { textContent: term }), element("dd", { textContent: value })]));
  $("robot").setAttribute("aria-label", `The robot: ${$("headline").textContent}`);
}

// --- the views and their time

const view = new RobotView($("robot"));
const traces = new Traces($("traces"), scrubTo);
const range = page.knobs.find((knob) => knob.key === "frequency");
const map = new HeightMap($("map"), $("map-note"), [range.lo, range.hi], (frequency, phase) => { set({ frequency, phase }); showKnobs(); });

function play(on) {
  playing = on;
  if (on && time >= motion.t.at(-1)) time = motion.t[0];
  isDirty = true;
}
function scrubTo(t) { playing = false; time = Math.min(t, motion.t.at(-1)); isDirty = true; }
$("play").onclick = () => play(!playing);
$("step").onclick = () => scrubTo(time + STEP);
$("scrub").oninput = () => scrubTo(motion.t[0] + ($("scrub").value / 1000) * (motion.t.at(-1) - motion.t[0]));
document.onkeydown = (e) => {
  if (e.key !== " " || e.target.closest("button, select, input[type=radio]")) return;
  e.preventDefault();
  play(!playing);
};

function frame(now) {
  requestAnimationFrame(frame);
  const passed = Math.min(0.1, (now - before) / 1e3);
  before = now;
  if (!motion) return;
  const [begin, end] = [motion.t[0], motion.t.at(-1)];
  if (playing) {
    time = Math.min(end, time + passed * Number($("speed").value));
    rested = time < end ? 0 : rested + passed;
    if (rested > END_PAUSE) time = begin;
  }
  if (!playing && !isDirty && traces.pointer === traces.drawn) return;
  isDirty = false;
  traces.drawn = traces.pointer;
  view.draw(motion, time);
  traces.draw(motion, time);
  $("play").textContent = playing ? "❚❚" : "▶";
  $("play").setAttribute("aria-label", playing ? "Pause" : "Play");
  if (document.activeElement !== $("scrub") || playing) $("scrub").value = Math.round((1000 * (time - begin)) / (end - begin));
  $("clock").textContent = `${numberText(time * 1e3, 0)} ms`;
  $("scrub").setAttribute("aria-valuetext", $("clock").textContent);
}

const redraw = () => { isDirty = true; map.draw(); };
const sizes = new ResizeObserver(redraw);
for (const canvas of document.querySelectorAll("canvas")) sizes.observe(canvas);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
enter("hard");
requestAnimationFrame(frame);

// Tasks on the thesis' robot: which settings are free, and when a jump has done it. Judged by the jump's own numbers;
// the sealed worlds have a judge of their own (world.js).
import page from "../page.js";

const FREE = ["frequency", "phase", "delay", "frequency2"];
export const FLIGHT = 0.02; // m, least height of the flight
export const BOUNCE = 1e-3; // m, most rise of the foot after its landing
export const SEALED = "sealed";
export const CHALLENGES = {
  beat: { on: ["hard"], done: (n) => n.jump_height_m > 0.041 },
  power: { on: ["hard"], done: (n) => n.jump_height_m >= 0.03 && n.peak_power_W < 3.5 },
  stick: { on: ["hard", "granular"], done: (n) => n.stuck.flight >= FLIGHT && n.stuck.bounce <= BOUNCE },
};

// What a teacher's button sets, on the thesis' robot on the hard floor: the jump to begin with and the task.
export const LESSONS = { push: { kind: "single", goal: "beat" }, gravity: { kind: "stutter", goal: "power" }, missing: { kind: "stutter", goal: SEALED } };

// "won", "not_yet" or the key of the setting that may not be changed.
export function judge(name, numbers, state) {
  const { on, done } = CHALLENGES[name];
  if (!on.includes(state.ground)) return "ground";
  if (state.hand) return "by_hand";
  const { defaults } = page.grounds[state.ground];
  for (const { section, key } of page.sliders) {
    if (!FREE.includes(key) && state.set[section]?.[key] !== defaults[section][key]) return `s_${key}`;
  }
  return done(numbers) ? "won" : "not_yet";
}

// The first flight that is high enough, else the highest: its height g t^2/8, and how far the foot rises in what is shown
// of the time after its landing [m].
export function landing({ t, foot }, flights, g) {
  const over = flights.filter((f) => !Number.isNaN(f[1])), height = ([a, b]) => (g * (b - a) ** 2) / 8;
  if (!over.length) return { flight: 0, bounce: 0 };
  const main = over.find((f) => height(f) >= FLIGHT) ?? over.reduce((a, b) => (height(b) > height(a) ? b : a));
  let low = Infinity, bounce = 0;
  t.forEach((at, i) => {
    if (at <= main[1]) return;
    low = Math.min(low, foot[i]);
    bounce = Math.max(bounce, foot[i] - low);
  });
  return { flight: height(main), bounce };
}

// Sealed worlds: a robot that differs from the declared one in one way, or in none. A world is its ground and its number;
// what it hides and the noise of its recordings follow from them. Mechanisms and names of docs/physics.md section 4.
import page from "../page.js";
import { stopOf, trackOf } from "../physics/jump.js";

export const NOISE = 2e-4; // m
export const MOST = 6; // recordings of a world
const RATE = 200; // frames a second
const BEFORE = 0.05, AFTER = 0.6; // s recorded before the motor starts, after it stops
export const REACH = 1.5; // the judge looks up to this times the strongest value that is drawn
const COARSE = 13, FINE = 12, STEP = 1e-3; // values of a first look; steps of the fit; share of the range for derivatives

// Name: [what it does to a question, weakest and strongest value drawn (SI), of both signs, unit shown, times, the ground it needs]
export const EFFECTS = {
  payload: [(q, x) => { q.set.robot.motor_mass += x; }, 0.03, 0.15, true, "g", 1e3],
  spring_stiffness: [(q, x) => { q.set.robot.spring_stiffness += x; }, 100, 400, true, "N/m", 1],
  spring_damping: [(q, x) => { q.set.robot.spring_damping += x; }, 0.5, 4, false, "N s/m", 1],
  tilt: [(q, x) => { q.set.robot.gravity += x; }, 0.08, 0.4, true, "m/s²", 1],
  camera_scale: [(q, x) => { q.scale = 1 + x; }, 0.015, 0.06, true, "%", 100],
  landing_loss: [(q, x) => { q.set.model.e += x; }, 0.05, 0.5, false, "", 1, "hard"],
  foot_mass: [(q, x) => { q.set.robot.foot_mass += x; }, 0.01, 0.04, false, "g", 1e3, "granular"],
  added_mass: [(q, x) => { q.sand = "drag_cone"; q.set.model.C = x; }, 0.5, 3.5, false, "", 1, "granular"],
};
export const NOTHING = "nothing";
export const choices = (ground) => [NOTHING, ...Object.keys(EFFECTS).filter((n) => (EFFECTS[n][6] ?? ground) === ground)];

// A motor law as text: what tells one from another.
export const keyOf = ({ actuation: a, frequency2, hand }) => JSON.stringify([a.frequency, a.amplitude, a.phase, a.cycles, a.delay, frequency2 ?? null, hand ?? null]);

// Uniform numbers in (0, 1) from a text (FNV-1a, then mulberry32).
function chance(text) {
  let a = 2166136261;
  for (const c of text) a = Math.imul(a ^ c.charCodeAt(0), 16777619);
  return () => {
    a = (a + 0x6d2b79f5) | 0;
    let t = Math.imul(a ^ (a >>> 15), 1 | a);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return (((t ^ (t >>> 14)) >>> 0) + 0.5) / 2 ** 32;
  };
}

// What a world hides: {name, value}.
export function hidden(ground, number) {
  const next = chance(`${ground} ${number}`), all = choices(ground), name = all[Math.floor(next() * all.length)];
  if (name === NOTHING) return { name, value: 0 };
  const [, weak, strong, either] = EFFECTS[name], value = weak * (strong / weak) ** next();
  return { name, value: either && next() < 0.5 ? -value : value };
}

// The declared robot with a motor law {actuation, frequency2?, hand?}; on sand a constant drag, without the cone.
export const declared = (ground, law) => structuredClone({ ground, sand: "drag", set: { ...page.grounds[ground].defaults, actuation: law.actuation },
  hand: law.hand ?? null, ...(law.frequency2 && { frequency2: law.frequency2 }) });

// Rise of the rod [m] at the times, with an effect of this size.
function predicted(ground, law, name, value, times) {
  const q = declared(ground, law);
  if (name !== NOTHING) EFFECTS[name][0](q, value);
  return trackOf(q, times).map((x) => x * (q.scale ?? 1));
}

// What the camera sees of a jump in a world: {t [s], x [m]}.
export function recording(ground, number, law) {
  const { name, value } = hidden(ground, number), end = stopOf(declared(ground, law)) + AFTER;
  const t = Array.from({ length: Math.floor((BEFORE + end) * RATE) }, (_, i) => i / RATE - BEFORE);
  const next = chance(`${ground} ${number} ${keyOf(law)}`);
  const noise = () => NOISE * Math.sqrt(-2 * Math.log(next())) * Math.cos(2 * Math.PI * next());
  return { t, x: predicted(ground, law, name, value, t).map((x) => x + noise()) };
}

// Each effect alone, fitted to the recordings [{law, t, x}]: [{name, value, sigma, chi2, p}], p the share of its evidence
// (Laplace's approximation, flat in the range, all alike beforehand); n: readings. pause(): awaited between the fits.
export async function judged(ground, recordings, pause = async () => {}) {
  const found = [];
  for (const name of choices(ground)) {
    const left = (value) => recordings.flatMap((r) => { // residuals over the noise
      try { return predicted(ground, r.law, name, value, r.t).map((x, i) => (r.x[i] - x) / NOISE); } catch { return r.x.map(() => NaN); }
    });
    const cost = (r) => { const sum = r.reduce((s, x) => s + x * x, 0); return Number.isFinite(sum) ? sum : Infinity; };
    found.push({ name, ...await (name === NOTHING ? { value: 0, sigma: 0, chi2: cost(left(0)), evidence: 0 } : fitted(name, left, cost, pause)) });
    await pause();
  }
  const best = Math.max(...found.map((f) => f.evidence - f.chi2 / 2)), weight = (f) => Math.exp(f.evidence - f.chi2 / 2 - best);
  const all = found.reduce((s, f) => s + weight(f), 0);
  return { n: recordings.reduce((n, r) => n + r.t.length, 0), effects: found.map((f) => ({ ...f, p: weight(f) / all })).sort((a, b) => b.p - a.p) };
}

// The best value of one effect: a look over its range, then Gauss and Newton's steps inside it.
async function fitted(name, left, cost, pause) {
  const [, , strong, either] = EFFECTS[name], high = REACH * strong, low = either ? -high : 0, h = STEP * strong;
  let value = 0, r = left(0), chi2 = cost(r), slope = 0;
  for (let i = 0; i < COARSE; i++) {
    const x = low + ((high - low) * i) / (COARSE - 1), there = left(x), c = cost(there);
    if (c < chi2) { value = x; r = there; chi2 = c; }
    await pause();
  }
  for (let i = 0; i < FINE; i++) {
    const way = value + h > high ? -h : h, beside = left(value + way), d = beside.map((x, k) => (x - r[k]) / way);
    slope = cost(d);
    let step = -d.reduce((s, x, k) => s + x * r[k], 0) / slope;
    if (!Number.isFinite(step)) break;
    let moved = false;
    for (let k = 0; k < 8 && !moved; k++, step /= 3) {
      const x = Math.min(Math.max(value + step, low), high), there = left(x), c = cost(there);
      if (c < chi2) { moved = chi2 - c > 1e-3; value = x; r = there; chi2 = c; if (!moved) break; }
      await pause();
    }
    if (!moved) break;
  }
  const sigma = 1 / Math.sqrt(slope);
  let mass = 0; // of the Gaussian inside the range
  for (let i = -400; i <= 400; i++) if (value + (i * sigma) / 80 >= low && value + (i * sigma) / 80 <= high) mass += Math.exp(-0.5 * (i / 80) ** 2) / 80;
  return { value, sigma, chi2, evidence: Math.log((mass * sigma) / (high - low)) };
}

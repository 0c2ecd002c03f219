// A question answered: {ground, set: {robot, actuation, bed, model}, sand, frequency2?, hand?} in SI units. Hard ground
// without foot mass is exact (hard.js); all else is integrated (sand.js).
import { hardJump, hardSamples } from "./hard.js";
import { handPieces, lawPieces, motorAt, peakSpeed } from "./law.js";
import { AIR, ground, Run } from "./sand.js";

const TAIL = 0.6, MOST = 30; // s followed after the motor stops, doubled until a flight has ended
const LEAD = 0.08, AFTER = 0.3, SPACING = 1e-3, LEAST = 600, MOST_POINTS = 2500; // of the motion that is drawn, s and points
const DRIVEN = 400; // samples of the motor's force while it runs, on sand
export const TOLERANCE = 1e-7, COARSE = 1e-6; // of a step: a jump, a point of the map

export const values = ({ set }) => ({ ...set.robot, ...set.bed, ...set.model });
export const isExact = (q) => q.ground === "hard" && !(q.set.robot.foot_mass > 0);
const piecesOf = (q) => (q.hand ? handPieces(q.hand) : lawPieces(q.set.actuation, q.frequency2 ?? q.set.actuation.frequency));
const linspace = (a, b, n) => Array.from({ length: n }, (_, i) => a + ((b - a) * i) / (n - 1));

// Followed until a flight has ended after the motor's stop, if there is one.
function untilLanded(stop, go) {
  for (let tail = TAIL; ; tail *= 2) {
    const motion = go(stop + tail), last = motion.flights.at(-1);
    if (!last || !Number.isNaN(last[1]) || motion.flights.some((f) => f[1] > stop) || tail > MOST) return motion;
  }
}

function integrated(v, q, pieces, tolerance, driven) {
  const run = new Run(ground(v, q.ground === "hard" ? "" : q.sand), pieces, tolerance), { stop } = run;
  run.wanted = driven;
  untilLanded(stop, (end) => { run.until(end); return run; });
  const late = run.flights.findIndex((f) => !(f[1] <= stop)), landed = run.flights.filter((f) => f[1] > stop).map((f) => f[1] - f[0]);
  return { flights: run.flights, rest: run.rest, stop, samples: run.samples, numbers: {
    com_height_m: run.com - run.low, jump_height_m: run.after - run.rest,
    flight_height_m: late < 0 ? 0 : landed.length ? (v.gravity * Math.max(...landed) ** 2) / 8 : NaN,
    n_jumps: late < 0 ? run.flights.length : late + 1, depth_m: run.mode === AIR ? run.floor : Math.max(run.floor, -run.s[2]),
  } };
}

// driven: times at which the samples are kept, where the jump is integrated.
function solved(q, v, pieces, tolerance, driven = []) {
  const stop = pieces.at(-1)[1];
  return isExact(q) ? untilLanded(stop, (end) => hardJump(v, pieces, end)) : integrated(v, q, pieces, tolerance, driven);
}

function samples(q, v, pieces, times, found, tolerance) {
  if (isExact(q)) return hardSamples(hardJump(v, pieces, Math.max(times.at(-1), found.stop)), v, times);
  const run = new Run(ground(v, q.ground === "hard" ? "" : q.sand), pieces, tolerance);
  run.wanted = times;
  run.until(times.at(-1) + 1e-9);
  return run.samples;
}

// Force [N] and power [W] of the motor from the spring's force and X''.
function motorForce(v, pieces, t, spring) {
  const share = v.motor_mass / (v.motor_mass + v.rod_mass), [, rate, accel] = motorAt(pieces, t);
  const force = v.motor_mass * (spring / (v.motor_mass + v.rod_mass) + (1 - share) * accel);
  return [force, force * rate];
}

// Energies [J] more than at rest, and what the motor has given: cumulative power and the impulses of its velocity steps.
// taken: the rest, by ground, spring and grains.
function energies(v, pieces, columns, q) {
  const { t, rod, motor, rodV, footV, foot, stretch, power, spring: pull } = columns, g = v.gravity, foot0 = isExact(q) ? 0 : v.foot_mass;
  const reduced = (v.motor_mass * v.rod_mass) / (v.motor_mass + v.rod_mass), k = v.spring_stiffness;
  const stop = pieces.at(-1)[1], into = motorAt(pieces, pieces[0][0])[1], out = motorAt(pieces, stop - 1e-12)[1];
  const bars = { kinetic: [], height: [], spring: [], motor: [], taken: [] };
  let work = 0;
  t.forEach((now, i) => {
    if (i && now > 0 && t[i - 1] < stop) { // the last step ends with the motor
      const end = Math.min(now, stop), share = (end - t[i - 1]) / (now - t[i - 1]), force = pull[i - 1] + share * (pull[i] - pull[i - 1]);
      const final = now < stop ? power[i] : motorForce(v, pieces, stop - 1e-12, force)[1];
      work += 0.5 * (final + power[i - 1]) * (end - t[i - 1]);
    }
    const given = work + (now >= pieces[0][0] ? 0.5 * reduced * into ** 2 : 0) - (now >= stop ? 0.5 * reduced * out ** 2 : 0);
    const motorV = rodV[i] + motorAt(pieces, now)[1];
    const kinetic = 0.5 * (v.motor_mass * motorV ** 2 + v.rod_mass * rodV[i] ** 2 + foot0 * footV[i] ** 2);
    const height = g * (v.motor_mass * (motor[i] - motor[0]) + v.rod_mass * (rod[i] - rod[0]) + foot0 * (foot[i] - foot[0]));
    const spring = 0.5 * k * (stretch[i] ** 2 - stretch[0] ** 2);
    bars.kinetic.push(kinetic); bars.height.push(height); bars.spring.push(spring); bars.motor.push(given);
    bars.taken.push(given - kinetic - height - spring);
  });
  return bars;
}

// The numbers alone, as those of jumpvision's sweeps.
export function numbersOf(q, tolerance = TOLERANCE) {
  const v = values(q), pieces = piecesOf(q), end = pieces.at(-1)[1], times = linspace(0, end, DRIVEN + 1).slice(0, -1);
  const found = solved(q, v, pieces, tolerance, times), { numbers, stop } = found;
  if (!isExact(q)) {
    const forces = found.samples.map((s, i) => motorForce(v, pieces, times[i], s[4]));
    numbers.peak_force_N = Math.max(...forces.map((f) => f[0]));
    numbers.peak_power_W = Math.max(...forces.map((f) => f[1]));
  }
  return Object.assign(numbers, { lift_off_s: found.flights.length ? found.flights[0][0] : NaN, peak_motor_speed: peakSpeed(pieces), stop_s: stop,
    flights: found.flights, rest: found.rest });
}

// When the motor stops [s].
export const stopOf = (q) => piecesOf(q).at(-1)[1];

// Rise of the rod above rest [m] at increasing times, the first before the motor starts.
export function trackOf(q, times) {
  const rows = samples(q, values(q), piecesOf(q), times, { stop: stopOf(q) }, TOLERANCE);
  return rows.map((r) => r[0] - rows[0][0]);
}

// Only the height of the map [m].
export function heightOf(q) {
  return solved(q, values(q), piecesOf(q), COARSE).numbers.jump_height_m;
}

export function jump(q) {
  const v = values(q), pieces = piecesOf(q), numbers = numbersOf(q), { stop_s: stop, rest, flights } = numbers, M = v.motor_mass + v.rod_mass;
  const landing = flights.find((f) => f[1] > stop)?.[1] ?? stop, first = -LEAD, last = Math.max(landing, stop) + AFTER;
  const spacing = (last - first) / Math.min(MOST_POINTS, Math.max(LEAST, (last - first) / SPACING));
  const lead = Math.ceil(LEAD / spacing), dt = LEAD / lead; // a sample lies where the motor starts
  const t = Array.from({ length: Math.ceil((last - first) / dt) + 1 }, (_, i) => (i - lead) * dt);
  const rows = samples(q, v, pieces, t, { stop }, TOLERANCE), column = (i) => rows.map((r) => r[i]);
  const motion = { t, rod: column(0).map((x) => x - rest), rodV: column(1), foot: column(2), footV: column(3), spring: column(4) };
  motion.drive = t.map((x) => motorAt(pieces, x)[0]);
  motion.motor = motion.rod.map((x, i) => x + motion.drive[i]);
  motion.stretch = motion.rod.map((x, i) => x + rest - motion.foot[i]);
  motion.power = t.map((x, i) => motorForce(v, pieces, x, motion.spring[i])[1]);
  motion.ground = column(5).map((f) => Math.max(0, f));
  Object.assign(motion, hole(q, v, motion.foot));
  const bars = energies(v, pieces, motion, q), f0 = Math.sqrt(v.spring_stiffness / M) / (2 * Math.PI);
  Object.assign(numbers, { f0_Hz: f0, alpha: (M * v.gravity) / (v.spring_stiffness * q.set.actuation.amplitude),
    zeta: v.spring_damping / (2 * Math.sqrt(v.spring_stiffness * M)), f_over_f0: q.set.actuation.frequency / f0,
    driven_m: Math.max(...motion.rod.filter((_, i) => t[i] <= stop)) });
  if (motion.cone_mass) numbers.added_mass_kg = Math.max(...motion.cone_mass);
  return { exact: isExact(q), motion, bars, numbers };
}

// Depth of the hole so far and, with a cone, radius and height of its truncated top below the foot [m], and its mass.
function hole(q, v, foot) {
  if (q.ground === "hard") return {};
  let deep = 0;
  const depth = foot.map((x) => (deep = Math.max(deep, -x)));
  if (q.sand !== "cone") return { hole: depth };
  const p = ground(v, "cone"), cones = depth.map((z) => p.cone(z, 0)), radius = cones.map((c) => c.radius);
  const height = radius.map((r) => (p.R - r) * Math.tan(v.theta));
  return { hole: depth, cone_radius: radius, cone_height: height, cone_mass: cones.map((c) => c.mass) };
}

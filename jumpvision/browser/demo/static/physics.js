// The jumper on a hard floor (its foot has no mass) or on sand, by one integrator of docs/physics.md sections 1 to 3.
// SI units, y up. State [y, y', x_f, x_f']: y = x_r + (m_m/M) X_m, whose equation needs no X_m''; x_f is the foot's
// face. Adaptive steps of Dormand and Prince; an event is the root of a guard over the length of the step itself, so
// that the state at an event has the accuracy of a step.
import { bedLaw } from "./made.js";

const TAIL = 0.6, LONGEST_TAIL = 30; // s followed after the motor stops, doubled until a flight has ended
const LEAD = 0.08, AFTER = 0.3, SPACING = 1e-3; // s drawn before the motor starts and after the landing, s between points
const TOLERANCE = 1e-7, MAP_TOLERANCE = 1e-6; // of a step
const RESOLVE = 1e-6; // s: a motion not seen to begin within this time has not begun
const NOISE = 1e-14; // m or m/s
const MAX_STEPS = 200_000;
const AIR = 0, REST = 1, INTRUDE = 2;

// Dormand and Prince: coefficients of the stages, their times, the error, the dense output.
const A = [[], [1 / 5], [3 / 40, 9 / 40], [44 / 45, -56 / 15, 32 / 9], [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729],
  [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656], [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84]];
const C = [0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1, 1];
const E = [-71 / 57600, 0, 71 / 16695, -71 / 1920, 17253 / 339200, -22 / 525, 1 / 40];
const P = [[1, -8048581381 / 2820520608, 8663915743 / 2820520608, -12715105075 / 11282082432], [0, 0, 0, 0],
  [0, 131558114200 / 32700410799, -68118460800 / 10900136933, 87487479700 / 32700410799],
  [0, -1754552775 / 470086768, 14199869525 / 1410260304, -10690763975 / 1880347072],
  [0, 127303824393 / 49829197408, -318862633887 / 49829197408, 701980252875 / 199316789632],
  [0, -282668133 / 205662961, 2019193451 / 616988883, -1453857185 / 822651844], [0, 40617522 / 29380423, -110615467 / 29380423, 69997945 / 29380423]];

// The motor's place on the rod, X_m = A [sin(2 pi f t + phase) - sin(phase)] for one cycle, which a delay divides into
// two halves: pieces [start, end, offset, A, omega, phase].
function motorPieces({ frequency, amplitude, phase, delay }) {
  const omega = 2 * Math.PI * frequency, half = 0.5 / frequency, offset = -amplitude * Math.sin(phase);
  if (!delay) return [[0, 1 / frequency, offset, amplitude, omega, phase]];
  const again = half + delay;
  return [[0, half, offset, amplitude, omega, phase], [half, again, 2 * offset, 0, 0, 0],
    [again, again + half, offset, amplitude, omega, phase + Math.PI]];
}

// X_m [m] and X_m' [m/s] at h seconds into a piece.
function motorIn([, , offset, amplitude, omega, phase], h) {
  const angle = omega * h + phase;
  return [offset + amplitude * Math.sin(angle), amplitude * omega * Math.cos(angle)];
}

// X_m [m] at the time t, at rest before and after the law.
function motorAt(pieces, t) {
  const piece = pieces.find((p) => t < p[1]) ?? pieces.at(-1);
  return t < 0 ? 0 : motorIn(piece, Math.min(t, piece[1]) - piece[0])[0];
}

// Depth [m] at which the bed carries a load [N].
function restDepth(bed, load) {
  let low = 0, high = 1e-3;
  while (bed(high, 0).static < load) { low = high; high *= 2; }
  for (let i = 0; i < 200 && high - low > 4e-16 * high; i++) {
    const z = 0.5 * (low + high);
    if (bed(z, 0).static < load) low = z; else high = z;
  }
  return high;
}

// Static and whole force [N] of the bed, mass that moves with the foot [kg] and radius of its flat face [m], at a depth
// [m] and a velocity [m/s].
function bedOf({ bed }) {
  if (!bed) return null;
  const at = { ...bed, z: 0, v: 0 };
  return (z, v) => {
    at.z = z;
    at.v = v;
    return bedLaw(at);
  };
}

class Run {
  constructor(robot, pieces, tolerance) {
    const { motor_mass, rod_mass, foot_mass: m, spring_stiffness: k, spring_damping: c, gravity: g } = robot, M = motor_mass + rod_mass;
    this.p = { M, q: motor_mass / M, m, k, c, g, slack: 1e-9 * M * g, bed: bedOf(robot) };
    this.floor = robot.bed ? restDepth(this.p.bed, (M + m) * g) : 0; // deepest place of the foot so far
    this.rest = (-M * g) / k - this.floor;
    this.stop = pieces.at(-1)[1];
    this.pieces = [...pieces, [this.stop, Infinity, motorAt(pieces, this.stop), 0, 0, 0]];
    this.s = Float64Array.of(this.rest, 0, -this.floor, 0);
    this.k = Array.from({ length: 7 }, () => new Float64Array(4));
    const rate = Math.sqrt(k / M);
    this.tolerance = tolerance;
    this.scale = [1, rate, 1, rate].map((r) => r * tolerance * 1e-3);
    this.longest = (2 * Math.PI) / rate / 12;
    this.h = 1e-4;
    this.t = this.piece = 0;
    this.flights = []; // [lift-off, landing], NaN while in the air
    this.highest = this.highestCentre = -Infinity; // rod after the motor's stop, centre of mass
    this.lowCentre = this.centre(this.s)[0];
    this.samples = [];
    this.wanted = [];
    this.mode = REST;
    this.enter(this.settle()); // the motor may start with a velocity
  }

  // Height and velocity of the rod.
  rod(t, s) {
    const piece = this.pieces[this.piece], [x, v] = motorIn(piece, t - piece[0]), { q } = this.p;
    return [s[0] - q * x, s[1] - q * v];
  }

  // Height and velocity of the centre of mass of motor, rod and foot.
  centre(s) {
    const { M, m } = this.p;
    return [(M * s[0] + m * s[2]) / (M + m), (M * s[1] + m * s[3]) / (M + m)];
  }

  // The spring on the rod; relaxed where a foot without mass is in the air.
  force(t, s) {
    const { m, k, c } = this.p, [x, v] = this.rod(t, s);
    return this.mode === AIR && !m ? 0 : -k * (x - s[2]) - c * (v - s[3]);
  }

  rates(t, s, out) {
    const { p } = this, force = this.force(t, s);
    out[0] = s[1];
    out[1] = -p.g + force / p.M;
    out[2] = out[3] = 0;
    if (this.mode === REST || !p.m) return;
    out[2] = s[3];
    if (this.mode === AIR) { out[3] = -p.g - force / p.m; return; }
    const ground = p.bed(-s[2], s[3]);
    out[3] = (ground.force - force - p.m * p.g) / (p.m + ground.mass);
  }

  // State after h; with `error`, its error over the tolerance is left in this.error.
  step(h, error = false) {
    const { k, s, t } = this, x = new Float64Array(4);
    for (let i = 1; i < 7; i++) {
      for (let j = 0; j < 4; j++) {
        let sum = 0;
        for (let n = 0; n < i; n++) sum += A[i][n] * k[n][j];
        x[j] = s[j] + h * sum;
      }
      this.rates(t + C[i] * h, x, k[i]);
    }
    if (error) {
      this.error = 0;
      for (let j = 0; j < 4; j++) {
        let sum = 0;
        for (let n = 0; n < 7; n++) sum += E[n] * k[n][j];
        this.error = Math.max(this.error, Math.abs(h * sum) / (this.scale[j] + this.tolerance * Math.max(Math.abs(s[j]), Math.abs(x[j]))));
      }
    }
    return x;
  }

  // State at a share of the last step.
  dense(share, h) {
    return this.s.map((x, j) => {
      let sum = 0;
      for (let n = 0; n < 7; n++) sum += this.k[n][j] * share * (P[n][0] + share * (P[n][1] + share * (P[n][2] + share * P[n][3])));
      return x + h * sum;
    });
  }

  // What presses the foot at rest down into the ground.
  push(t, s) { return this.force(t, s) + this.p.m * this.p.g; }

  // Positive while the mode lasts. A foot without mass is on the floor while the spring is shorter than relaxed.
  guards(t, s) {
    const { p } = this;
    if (!p.m) { const [x] = this.rod(t, s); return [this.mode === AIR ? x : -x, 1]; }
    if (this.mode === AIR) return [s[2] + this.floor, 1];
    if (this.mode === INTRUDE) return [1, -s[3]];
    const push = this.push(t, s);
    return [push + p.slack, p.bed(this.floor, 0).static + p.slack - push];
  }

  // Mode of a foot at rest on the ground.
  settle() {
    const { p } = this, push = this.push(this.t, this.s);
    if (!p.m) return this.rod(this.t, this.s)[0] > 0 ? AIR : REST;
    if (push < -p.slack) return AIR;
    return push > p.bed(this.floor, 0).static + p.slack ? INTRUDE : REST;
  }

  enter(mode) {
    if (mode === AIR && this.mode === REST) this.flights.push([this.t, NaN]);
    this.mode = mode;
    this.rates(this.t, this.s, this.k[0]);
    this.armed = this.guards(this.t, this.s).map((g) => g > 0);
    if (mode === INTRUDE) this.h = Math.min(this.h, 0.2 * Math.sqrt(this.p.m / this.p.k));
  }

  // Root of f over the length of the step, between lengths a and b where it is > 0 and <= 0 (or turned round).
  locate(f, a, b) {
    let fa = f(a), fb = f(b);
    for (let i = 0; i < 100 && b - a > 1e-15; i++) {
      let m = i % 3 === 2 ? 0.5 * (a + b) : a + ((b - a) * fa) / (fa - fb);
      if (!(m > a && m < b)) m = 0.5 * (a + b);
      const y = f(m);
      if (y === 0) return m;
      if (y > 0) { a = m; fa = y; } else { b = m; fb = y; }
    }
    return b;
  }

  // Goes on until `end`; fills the samples at the wanted times.
  until(end) {
    for (let n = 0; this.t < end; n++) {
      if (n > MAX_STEPS) throw new Error(`more than ${MAX_STEPS} steps`);
      const edge = Math.min(end, this.pieces[this.piece][1]);
      if (this.t < edge) this.advance(edge);
      else { // the motor's velocity may jump
        this.piece++;
        this.enter(this.mode === REST ? this.settle() : this.mode);
      }
    }
  }

  advance(edge) {
    const { t } = this, h = Math.min(this.h, this.longest), last = t + 1.000001 * h >= edge, trial = last ? edge - t : h;
    let next = this.step(trial, true);
    if (!(this.error <= 1)) {
      this.h = trial * Math.max(0.2, 0.9 * this.error ** -0.2 || 0.2);
      return;
    }
    const { error } = this, final = this.guards(t + trial, next), half = this.guards(t + 0.5 * trial, this.dense(0.5, trial));
    let event = -1, taken = trial;
    for (let i = 0; i < 2; i++) {
      if (half[i] > 0 && final[i] > 0) continue;
      if (!this.armed[i] && half[i] <= 0) { // not begun yet, or late in the step
        if (final[i] > 0) continue;
        if (trial > RESOLVE) { this.h = 0.25 * trial; return; }
        if (final[i] < -NOISE && !(this.mode === REST && t < this.held)) { event = i; taken = 0; }
        continue;
      }
      const at = (length) => this.guards(t + length, this.step(length))[i];
      const [a, b] = half[i] > 0 ? [0.5 * trial, trial] : [0, 0.5 * trial];
      if (!(at(b) <= 0) && b < trial) continue;
      const found = this.locate(at, a, b);
      if (found < taken || event < 0) { event = i; taken = found; }
    }
    next = this.step(taken); // the slopes of the step that stands
    this.record(taken, next);
    this.t = event < 0 && last ? edge : t + taken;
    this.s = next;
    [this.k[0], this.k[6]] = [this.k[6], this.k[0]];
    if (event < 0) {
      final.forEach((g, i) => { this.armed[i] ||= g > 0; });
      this.h = last ? Math.max(h, trial) : trial * Math.min(5, 0.9 * Math.max(error, 1e-10) ** -0.2);
    } else this.happen(event, taken);
  }

  // Greatest height along the step of what `place` gives: height and velocity.
  crest(place, taken, next) {
    const { t } = this, low = place(t, this.s), high = place(t + taken, next), best = Math.max(low[0], high[0]);
    if (!(low[1] > 0 && high[1] <= 0)) return best;
    const at = (length) => place(t + length, this.step(length)), top = this.locate((length) => at(length)[1], 0, taken);
    const height = at(top)[0];
    this.step(taken);
    return Math.max(best, height);
  }

  record(taken, next) {
    const { t, p } = this;
    if (t >= this.stop) this.highest = Math.max(this.highest, this.crest((at, s) => this.rod(at, s), taken, next));
    this.highestCentre = Math.max(this.highestCentre, this.crest((_, s) => this.centre(s), taken, next));
    while (this.samples.length < this.wanted.length && this.wanted[this.samples.length] <= t + taken) {
      const at = this.wanted[this.samples.length];
      if (at < t) this.samples.push([this.rest, -this.floor, p.M * p.g, (p.M + p.m) * p.g]);
      else this.samples.push(this.sample(at, this.dense((at - t) / taken || 0, taken)));
    }
  }

  // Rod, foot, force of the spring on the rod and of the ground on the foot, m_f (x_f'' + g) + F_s.
  sample(t, s) {
    const { p } = this, force = this.force(t, s), out = new Float64Array(4), [x] = this.rod(t, s);
    if (this.mode === AIR) return [x, p.m ? s[2] : x, force, 0];
    this.rates(t, s, out);
    return [x, s[2], force, p.m * (out[3] + p.g) + force];
  }

  happen(event, taken) {
    const { p, s } = this;
    if (this.mode === REST) { this.enter(event === 0 ? AIR : INTRUDE); return; }
    if (this.mode === INTRUDE) {
      if (taken === 0) this.held = this.t + RESOLVE; // over before it could be seen
      this.floor = Math.max(this.floor, -s[2]);
      s[2] = -this.floor; s[3] = 0;
      this.mode = REST;
      this.enter(this.t < this.held ? REST : this.settle());
      return;
    }
    this.flights.at(-1)[1] = this.t;
    this.mode = REST;
    s[2] = -this.floor;
    if (p.m) s[3] *= p.m / (p.m + p.bed(this.floor, 0).mass); // shared with the standing cone
    if (s[3] < 0) this.enter(INTRUDE);
    else { s[3] = 0; this.enter(this.settle()); }
  }
}

// Follows a jump {robot, law} until a flight has ended after the motor's stop, if there is one.
function followJump({ robot, law }, tolerance) {
  const run = new Run(robot, motorPieces(law), tolerance);
  for (let tail = TAIL; ; tail *= 2) {
    run.until(run.stop + tail);
    const last = run.flights.at(-1);
    if (!last || !Number.isNaN(last[1]) || run.flights.some((f) => f[1] > run.stop) || tail > LONGEST_TAIL) return run;
  }
}

// Heights [m], flights [s] and the foot's greatest depth [m] of a jump, as those of jumpvision's sweeps.
export function jumpNumbers(jump, tolerance = TOLERANCE) {
  const run = followJump(jump, tolerance), { flights, stop } = run, late = flights.findIndex((f) => !(f[1] <= stop));
  const landed = flights.filter((f) => f[1] > stop).map((f) => f[1] - f[0]);
  return {
    jump_height_m: run.highest - run.rest, com_height_m: run.highestCentre - run.lowCentre,
    flight_height_m: late < 0 ? 0 : landed.length ? (jump.robot.gravity * Math.max(...landed) ** 2) / 8 : NaN,
    n_jumps: late < 0 ? flights.length : late + 1, depth_m: run.mode === AIR ? run.floor : Math.max(run.floor, -run.s[2]), flights, stop_s: stop,
  };
}

// Rows [rod, foot, spring's force, ground's force] of a jump at increasing times.
export function sampleJump({ robot, law }, times, tolerance = TOLERANCE) {
  const run = new Run(robot, motorPieces(law), tolerance);
  run.wanted = times;
  run.until(times.at(-1) + 1e-9);
  return run.samples;
}

// Height of a point of the map [m].
export function mapHeight(jump) {
  const run = followJump(jump, MAP_TOLERANCE);
  return run.highest - run.rest;
}

// The motion that is drawn, columns over equally spaced times t: rise of the rod above rest, foot, motor on the rod,
// stretch of the spring [m], forces [N]; on sand depth of the hole, cone below it (radius, height) [m], its mass [kg].
export function jumpMotion({ robot, law }, { flights, stop_s: stop }) {
  const end = (flights.find((f) => f[1] > stop)?.[1] ?? stop) + AFTER, pieces = motorPieces(law);
  const t = Array.from({ length: Math.ceil((LEAD + end) / SPACING) }, (_, i) => i * SPACING - LEAD);
  const rows = sampleJump({ robot, law }, t), rest = rows[0][0], bed = bedOf(robot);
  const motion = { t, rod: rows.map((r) => r[0] - rest), foot: rows.map((r) => r[1]), drive: t.map((x) => motorAt(pieces, x)),
    stretch: rows.map((r) => r[0] - r[1]), spring: rows.map((r) => r[2]), ground: rows.map((r) => Math.max(0, r[3])) };
  if (!bed) return motion;
  let deep = 0;
  motion.hole = motion.foot.map((x) => (deep = Math.max(deep, -x)));
  const cones = motion.hole.map((z) => bed(z, 0)), { R, theta } = robot.bed;
  motion.cone_radius = cones.map((c) => c.radius);
  motion.cone_height = cones.map((c) => (R - c.radius) * Math.tan(theta));
  motion.cone_mass = cones.map((c) => c.mass);
  return motion;
}

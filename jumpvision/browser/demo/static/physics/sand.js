// A jump with a foot that has mass: on sand (static force, drag, added mass of the cone), or on a hard floor, where the
// foot stops at touchdown. Equations and rules of docs/physics.md sections 1 and 3. State [y, w, x_f, v_f] with
// y = x_r + (m_m/M) X_m, so that X_m'' is not needed. Adaptive steps of Dormand and Prince; an event is the root of a
// guard over the length of the step itself, so the state at an event has the accuracy of a step.
import { motor } from "./law.js";
import laws from "./laws.js";

export const AIR = 0, REST = 1, INTRUDE = 2;
const A = [[], [1 / 5], [3 / 40, 9 / 40], [44 / 45, -56 / 15, 32 / 9], [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729],
  [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656], [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84]];
const C = [0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1, 1];
const E = [-71 / 57600, 0, 71 / 16695, -71 / 1920, 17253 / 339200, -22 / 525, 1 / 40];
const P = [[1, -8048581381 / 2820520608, 8663915743 / 2820520608, -12715105075 / 11282082432], [0, 0, 0, 0],
  [0, 131558114200 / 32700410799, -68118460800 / 10900136933, 87487479700 / 32700410799],
  [0, -1754552775 / 470086768, 14199869525 / 1410260304, -10690763975 / 1880347072],
  [0, 127303824393 / 49829197408, -318862633887 / 49829197408, 701980252875 / 199316789632],
  [0, -282668133 / 205662961, 2019193451 / 616988883, -1453857185 / 822651844], [0, 40617522 / 29380423, -110615467 / 29380423, 69997945 / 29380423]];
const RESOLVE = 1e-6; // s: a motion not seen to begin within this time has not begun
const NOISE = 1e-14; // m or m/s
const STEPS = 200_000;

// The model's numbers from those of the page; sand: "cone", "drag", "drag_cone" (constant drag and the cone's mass) or ""
// (hard floor).
export function ground(value, sand) {
  const M = value.motor_mass + value.rod_mass, { foot_radius: R, spring_stiffness: k, spring_damping: c, gravity: g } = value;
  const p = { M, q: value.motor_mass / M, m: value.foot_mass, k, c, g, sand, e: value.e ?? 0, slack: 1e-9 * M * g };
  if (!sand) return { ...p, static: () => Infinity, ground: () => 0, mass: () => p.m };
  const at = { ...value, R, phi: value.volume_fraction, rho: value.grain_density, z: 0, v: 0 };
  const law = (z, v) => {
    at.z = z;
    at.v = v;
    return laws[sand](at);
  };
  return { ...p, R, cone: law, static: (z) => law(z, 0).static, ground: (z, v) => law(z, v).force, mass: (z) => p.m + law(z, 0).mass };
}

// Depth [m] at which the bed carries the robot; NaN where it cannot.
function settledDepth(p) {
  if (!p.sand) return 0;
  const load = (p.M + p.m) * p.g;
  let lo = 0, hi = 1e-3;
  while (p.static(hi) < load) { lo = hi; hi *= 2; if (hi > 1e3) return NaN; }
  for (let i = 0; i < 200 && hi - lo > 4e-16 * hi; i++) {
    const z = 0.5 * (lo + hi);
    if (p.static(z) < load) lo = z; else hi = z;
  }
  return hi;
}

export class Run {
  constructor(p, pieces, tolerance) {
    Object.assign(this, { p, pieces, tolerance, t: pieces[0][0], h: 1e-4, piece: 0, mode: REST, flights: [], before: -Infinity,
      after: -Infinity, com: -Infinity, samples: [], wanted: [], ended: false });
    this.k = Array.from({ length: 7 }, () => new Float64Array(4));
    this.stop = pieces.at(-1)[1];
    this.floor = settledDepth(p);
    if (!(this.floor >= 0)) throw Object.assign(new Error("bed"), { keys: ["k2"] });
    this.rest = (-p.M * p.g) / p.k - this.floor;
    const last = pieces.at(-1);
    this.all = [...pieces, [this.stop, Infinity, motor(last, last[1] - last[0])[0], 0, 0, 0, 0, 0, 0]];
    this.s = Float64Array.of(this.rest + p.q * motor(pieces[0], 0)[0], 0, -this.floor, 0);
    this.low = this.mass(this.s)[0];
    const rate = Math.sqrt(p.k / p.M);
    this.scale = [1, rate, 1, rate].map((r) => r * tolerance * 1e-3);
    this.longest = (2 * Math.PI) / rate / 12;
  }

  rod(t, s) {
    const row = this.all[this.piece], [x, v] = motor(row, t - row[0]), { q } = this.p;
    return [s[0] - q * x, s[1] - q * v];
  }

  // Height and rate of the centre of mass of motor, rod and foot.
  mass(s) {
    const { M, m } = this.p;
    return [(M * s[0] + m * s[2]) / (M + m), (M * s[1] + m * s[3]) / (M + m)];
  }

  force(t, s) {
    const [x, v] = this.rod(t, s);
    return -this.p.k * (x - s[2]) - this.p.c * (v - s[3]);
  }

  rates(t, s, out) {
    const { p } = this, force = this.force(t, s);
    out[0] = s[1];
    out[1] = -p.g + force / p.M;
    out[2] = this.mode === REST ? 0 : s[3];
    if (this.mode === REST) out[3] = 0;
    else if (this.mode === AIR) out[3] = -p.g - force / p.m;
    else out[3] = (p.ground(-s[2], s[3]) - force - p.m * p.g) / p.mass(-s[2]);
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
      let worst = 0;
      for (let j = 0; j < 4; j++) {
        let sum = 0;
        for (let n = 0; n < 7; n++) sum += E[n] * k[n][j];
        worst = Math.max(worst, Math.abs(h * sum) / (this.scale[j] + this.tolerance * Math.max(Math.abs(s[j]), Math.abs(x[j]))));
      }
      this.error = worst;
    }
    return x;
  }

  dense(share, h) {
    return this.s.map((x, j) => {
      let sum = 0;
      for (let n = 0; n < 7; n++) sum += this.k[n][j] * share * (P[n][0] + share * (P[n][1] + share * (P[n][2] + share * P[n][3])));
      return x + h * sum;
    });
  }

  // Positive while the mode lasts.
  guards(t, s) {
    const { p } = this;
    if (this.mode === AIR) return [s[2] + this.floor, 1];
    if (this.mode === INTRUDE) return [1, -s[3]];
    const push = this.force(t, s) + p.m * p.g;
    return [push + p.slack, p.static(this.floor) + p.slack - push];
  }

  // Mode of a foot at rest on the ground: 0 <= push <= F_p holds it.
  settle() {
    const { p } = this, push = this.force(this.t, this.s) + p.m * p.g;
    if (push < -p.slack) return AIR;
    return push > p.static(this.floor) + p.slack ? INTRUDE : REST;
  }

  enter(mode) {
    if (mode === AIR && this.mode === REST) this.flights.push([this.t, NaN]);
    this.mode = mode;
    this.rates(this.t, this.s, this.k[0]);
    this.now = this.guards(this.t, this.s);
    this.armed = this.now.map((g) => g > 0);
    this.here = this.rod(this.t, this.s);
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

  // Goes on until `end` [s]; fills samples [x_r, v_r, x_f, v_f, F_s, F_GM] at the wanted times.
  until(end) {
    if (!this.now) this.enter(this.settle());
    for (let n = 0; this.t < end; n++) {
      if (n > STEPS) throw Object.assign(new Error("steps"), { keys: [] });
      const edge = Math.min(end, this.all[this.piece][1]);
      if (this.t >= edge) {
        this.piece++;
        this.enter(this.mode === REST ? this.settle() : this.mode);
        continue;
      }
      this.advance(edge);
    }
  }

  advance(edge) {
    const { t } = this, h = Math.min(this.h, this.longest), last = t + 1.000001 * h >= edge, trial = last ? edge - t : h;
    let next = this.step(trial, true);
    if (!(this.error <= 1)) {
      this.h = trial * Math.max(0.2, 0.9 * this.error ** -0.2 || 0.2);
      if (this.h < 1e-13) throw Object.assign(new Error("steps"), { keys: [] });
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
      this.now = final;
      final.forEach((g, i) => { this.armed[i] ||= g > 0; });
      this.h = last ? Math.max(h, trial) : trial * Math.min(5, 0.9 * Math.max(error, 1e-10) ** -0.2);
    } else this.happen(event, taken);
  }

  // Greatest heights, and samples, along the step.
  record(taken, next) {
    const { t, p } = this, a = this.here, b = this.rod(t + taken, next), best = t >= this.stop ? "after" : "before";
    this[best] = Math.max(this[best], a[0], b[0]);
    const low = this.mass(this.s), high = this.mass(next);
    this.com = Math.max(this.com, low[0], high[0]);
    if (a[1] > 0 && b[1] <= 0 && a[0] + a[1] * taken > this[best]) {
      const top = this.locate((l) => this.rod(t + l, this.step(l))[1], 0, taken);
      this[best] = Math.max(this[best], this.rod(t + top, this.step(top))[0]);
      this.step(taken);
    }
    if (low[1] > 0 && high[1] <= 0 && low[0] + low[1] * taken > this.com) {
      const top = this.locate((l) => this.mass(this.step(l))[1], 0, taken);
      this.com = Math.max(this.com, this.mass(this.step(top))[0]);
      this.step(taken);
    }
    while (this.samples.length < this.wanted.length && this.wanted[this.samples.length] <= t + taken) {
      const at = this.wanted[this.samples.length];
      if (at < t) this.samples.push([this.rest, 0, -this.floor, 0, p.M * p.g, (p.M + p.m) * p.g]);
      else this.samples.push(this.sample(at, this.dense((at - t) / taken || 0, taken)));
    }
    this.here = b;
  }

  // x_r, v_r, x_f, v_f, F_s and the ground's force on the foot, F_GM = m_f (a_f + g) + F_s.
  sample(t, s) {
    const { p } = this, force = this.force(t, s), out = new Float64Array(4);
    this.rates(t, s, out);
    return [...this.rod(t, s), s[2], s[3], force, this.mode === AIR ? 0 : p.m * (out[3] + p.g) + force];
  }

  // Rules of an event.
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
    if (!p.sand) s[1] += (Math.sqrt(1 - p.e) - 1) * this.rod(this.t, s)[1];
    s[3] = p.sand ? (s[3] * p.m) / p.mass(this.floor) : 0; // shared with the standing cone
    if (s[3] < 0) this.enter(INTRUDE);
    else { s[3] = 0; this.enter(this.settle()); }
  }
}

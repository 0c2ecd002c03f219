// A jump on hard ground with a massless foot, exact to rounding: closed-form arcs, events by steps that cannot pass a
// root. With f <= 0 and |f'''| <= J, f stays below f + f' h + f'' h^2/2 + J h^3/6: a step to the first positive root of
// that cubic is safe. A flight slower than GRAZE at both ends is followed but not counted.
import { evaluate, makeArc } from "./arc.js";
import { motor } from "./law.js";

const GRAZE = 1e-6; // m/s
const STRIDE = 1; // rad of the fastest oscillation in a step, so that no extremum is stepped over
const SETTLED = 1e-10; // m

// First root in (0, cap] of the cubic, whose value at 0 is <= 0; cap without one.
function safeStep(f, f1, f2, j, cap) {
  const c2 = 0.5 * f2, c3 = j / 6, at = (h) => f + h * (f1 + h * (c2 + h * c3));
  const turns = []; // where the cubic turns round inside the step
  const disc = c2 * c2 - 3 * c3 * f1;
  if (c3 > 0 && disc > 0) { for (const sign of [-1, 1]) turns.push((-c2 + sign * Math.sqrt(disc)) / (3 * c3)); }
  else if (c3 === 0 && c2 !== 0) turns.push(-f1 / (2 * c2));
  let lo = 0;
  for (const end of [...turns.filter((h) => h > 0 && h < cap).sort((a, b) => a - b), cap]) {
    if (at(end) > 0) {
      let a = lo, b = end, h = end; // monotone from a to b: Newton kept in the bracket
      for (let i = 0; i < 60; i++) {
        const y = at(h);
        if (y > 0) b = h; else a = h;
        let next = h - y / (f1 + h * (2 * c2 + 3 * c3 * h));
        if (!(next > a && next < b)) next = 0.5 * (a + b);
        if (Math.abs(next - h) <= 1e-9 * next) return next;
        h = next;
      }
      return a;
    }
    lo = end;
  }
  return cap;
}

// Greatest value of quantity number `which` inside (lo, hi), where its rate falls through zero.
function crest(arc, lo, hi, which) {
  let a = lo, b = hi, best = -Infinity, ra = quantities(arc, a)[which + 3], rb = quantities(arc, b)[which + 3];
  for (let i = 0; i < 80; i++) {
    const m = i % 3 === 2 ? 0.5 * (a + b) : a + ((b - a) * ra) / (ra - rb), now = quantities(arc, m), r = now[which + 3];
    best = Math.max(best, now[which]);
    if (r > 0) { a = m; ra = r; } else { b = m; rb = r; }
    if (r === 0 || b - a < 1e-9 * (hi - lo)) break;
  }
  return best;
}

// y = x + q X, F_m / m_m, F_m X' / m_m, then their rates, then the state.
function quantities(arc, s) {
  const [x, v, a, mx, mv, ma] = evaluate(arc, s), { q, gam, w2, g, piece } = arc, om = piece[7];
  const mj = 6 * piece[5] - piece[6] * om ** 3 * Math.cos(om * s + piece[8]);
  const force = a + ma + g, rate = (1 - q) * mj - 2 * gam * a - w2 * v;
  return [x + q * mx, force, force * mv, v + q * mv, rate, rate * mv + force * ma, x, v, a];
}

// Follows an arc to its event or for `left`: [duration, crossed, x, v]; raises best.
function follow(arc, up, left, moving, x, v, best) {
  const { q, g } = arc, sign = up ? -1 : 1;
  if (up && !moving) { // a parabola
    const s = Math.min((v + Math.sqrt(v * v + 2 * g * Math.max(x, 0))) / g, left), rise = Math.max(Math.min(v / g, s), 0);
    best[0] = Math.max(best[0], x + q * arc.piece[2] + rise * (v - 0.5 * g * rise));
    return [s, s < left, x + s * (v - 0.5 * g * s), v - g * s];
  }
  const pace = Math.sqrt(arc.w2) + arc.piece[7], cap = pace > 0 ? STRIDE / pace : left;
  let s = 0, now = quantities(arc, 0);
  const raise = (list) => { for (const i of list) best[i] = Math.max(best[i], now[i]); };
  const watched = moving ? [0, 1, 2] : [0];
  raise(watched);
  let a = now[8];
  while (s < left) {
    if (!moving && v * v + arc.w2 * (x + g / arc.w2) ** 2 < arc.w2 * SETTLED ** 2) return [left, false, x, v];
    const h = safeStep(Math.min(sign * x, 0), sign * v, sign * a, arc.jerk, Math.min(cap, left - s)), before = now, s0 = s;
    s = Math.min(Math.max(s + h, s * (1 + 4e-16) + 1e-18), left);
    now = quantities(arc, s);
    [x, v, a] = now.slice(6);
    raise(watched);
    for (const i of watched) if (before[i + 3] > 0 && now[i + 3] < 0) best[i] = Math.max(best[i], crest(arc, s0, s, i));
    const size = Math.abs(arc.p[0]) + s * (Math.abs(arc.p[1]) + s * (Math.abs(arc.p[2]) + s * Math.abs(arc.p[3])));
    const rounding = 1e-15 * (size + Math.abs(arc.ps) + Math.abs(arc.pc) + Math.abs(arc.a) + s * Math.abs(arc.b));
    if (sign * v > 0 && sign * x >= -rounding) return [s, true, x, v];
    if (!moving && before[7] > 0 && v <= 0) return [left, false, x, v]; // the first crest of a ring-down is its highest
  }
  return [s, false, x, v];
}

// One jump from rest until `end` [s], not before the motor stops. value: motor_mass, rod_mass, spring_stiffness,
// spring_damping, gravity, e. Gives the arcs [start, arc] and the numbers; a flight is [lift-off, landing] (NaN: in the air).
export function hardJump(value, pieces, end) {
  const mass = value.motor_mass + value.rod_mass, q = value.motor_mass / mass, g = value.gravity;
  const robot = { q, g, w2: value.spring_stiffness / mass, gam: (0.5 * value.spring_damping) / mass };
  const stop = pieces.at(-1)[1], last = pieces.at(-1), rest = -g / robot.w2;
  const all = [...pieces, [stop, end, motor(last, stop - last[0])[0], 0, 0, 0, 0, 0, 0]];
  const arcs = [], flights = [], best = [-Infinity, -Infinity, -Infinity];
  let x = rest, v = 0, motorV = 0, airborne = false, lift = 0, liftV = 0, landingV = 0, com = -Infinity, jumps = 0, longest = 0;
  all.forEach((piece, i) => {
    const ends = i === all.length - 1, [mx, mv] = motor(piece, 0), length = piece[1] - piece[0];
    v -= q * (mv - motorV); // y' does not jump
    if (ends) { com = best[0]; best[0] = x + q * mx; }
    for (let tau = 0; tau < length;) {
      const now = piece[0] + tau, up = x > 0 || (x === 0 && (v > 0 || (v === 0 && -g - q * motor(piece, tau)[2] > 0)));
      if (up && !airborne) { lift = now; liftV = v; }
      if (airborne && !up && Math.max(liftV, landingV) > GRAZE) {
        flights.push([lift, now]);
        if (ends) { longest = Math.max(longest, now - lift); jumps ||= flights.length; }
      }
      airborne = up;
      const arc = makeArc(!up, piece, tau, length - tau, x, v, robot);
      arcs.push([now, arc]);
      const [s, crossed, x1, v1] = follow(arc, up, length - tau, !ends, x, v, best);
      x = crossed ? 0 : x1;
      v = v1;
      tau = crossed ? tau + s : length;
      if (crossed && up) { landingV = -v; v *= Math.sqrt(1 - value.e); }
    }
    if (!ends) motorV = motor(piece, length)[1];
  });
  const cut = airborne && longest === 0;
  if (airborne) flights.push([lift, NaN]);
  return { arcs, flights, rest, stop, numbers: {
    com_height_m: Math.max(com, best[0]) - rest, jump_height_m: best[0] - q * all.at(-1)[2] - rest,
    flight_height_m: cut ? NaN : (g * longest * longest) / 8, n_jumps: jumps || flights.length,
    peak_power_W: value.motor_mass * best[2], peak_force_N: value.motor_mass * best[1],
  } };
}

// Rod, its velocity, foot, its velocity [m, m/s], force of the spring on the rod and of the ground [N] at increasing times.
export function hardSamples({ arcs, rest }, value, times) {
  const mass = value.motor_mass + value.rod_mass;
  let i = 0;
  return times.map((t) => {
    if (t < arcs[0][0]) return [rest, 0, 0, 0, mass * value.gravity, mass * value.gravity];
    while (i + 1 < arcs.length && arcs[i + 1][0] <= t) i++;
    const [start, arc] = arcs[i], [x, v] = evaluate(arc, t - start);
    const force = arc.air ? 0 : -mass * (arc.w2 * x + 2 * arc.gam * v);
    return [x, v, arc.air ? x : 0, arc.air ? v : 0, force, force];
  });
}

// One smooth arc of the robot on hard ground in closed form: the linear flow between two events (docs/physics.md
// section 2). x [m] is the rod above the relaxed spring; grounded x'' + 2 gamma x' + w0^2 x = u, in the air x'' = u;
// u = -g - q X'', q = m_m/M.
import { motor } from "./law.js";

const NEAR = 1e-3; // nearer to resonance the particular solution cancels against the free one

// The arc that leaves (x, v) at tau into a piece. robot: {q, g, w2, gam}.
export function makeArc(grounded, piece, tau, length, x, v, { q, g, w2, gam }) {
  const [, , e0, e1, e2, d3, amp, om] = piece;
  const d2 = e2 + 3 * d3 * tau, d1 = e1 + (2 * e2 + 3 * d3 * tau) * tau, d0 = e0 + (e1 + (e2 + d3 * tau) * tau) * tau;
  const ph = piece[8] + om * tau, sin = amp ? Math.sin(ph) : 0, cos = amp ? Math.cos(ph) : 0;
  const own = { piece: [0, length, d0, d1, d2, d3, amp, om, ph], q, g };
  if (!grounded) {
    const qa = q * amp;
    return { ...own, air: true, w2: 0, gam: 0, p: [x + qa * sin, v + qa * om * cos, -0.5 * g - q * d2, -q * d3], ps: -qa, pc: 0, a: 0, b: 0,
      jerk: 6 * Math.abs(q * d3) + Math.abs(qa) * om ** 3 };
  }
  const over = w2 <= gam * gam, free = Math.sqrt(Math.abs(w2 - gam * gam));
  const p1 = (-6 * q * d3) / w2, p0 = (-g - 2 * q * d2 - 2 * gam * p1) / w2, push = q * amp * om * om;
  const resonant = push !== 0 && !over && Math.hypot(gam, om - free) < NEAR * Math.sqrt(w2);
  let ps = 0, pc = 0, jerk;
  if (resonant) {
    const w0 = Math.sqrt(w2), grown = Math.abs(push) * length;
    jerk = Math.abs(push) * (om + 2 * gam) + (4 * gam * gam + 2 * gam * w0 + w2) * grown;
  } else {
    const real = w2 - om * om, imag = 2 * gam * om, den = real * real + imag * imag;
    if (push !== 0) { ps = (push * real) / den; pc = (-push * imag) / den; }
    jerk = Math.hypot(ps, pc) * om ** 3;
  }
  const xh = x - p0 - ps * sin - pc * cos, vh = v - p1 - om * (ps * cos - pc * sin);
  const ah = -2 * gam * vh - w2 * xh, jh = -2 * gam * ah - w2 * vh;
  jerk += Math.sqrt(jh * jh + w2 * ah * ah);
  return { ...own, air: false, over, free, resonant, push, w2, gam, p: [p0, p1, 0, 0], ps, pc, a: xh, b: vh + gam * xh, jerk };
}

// Response from rest to push sin(omega s + phase) near resonance, with no difference of nearly equal numbers:
// eta = v + gamma x + i Omega x = int exp(lambda (s - r)) u(r) dr, lambda = -gamma + i Omega.
function nearResonance({ gam, free, push, piece }, s) {
  const om = piece[7], ph = piece[8], decay = Math.exp(-gam * s);
  const times = ([a, b], [c, d]) => [a * c - b * d, a * d + b * c];
  const grow = [decay * Math.cos(free * s), decay * Math.sin(free * s)];
  const zr = gam * s, zi = (om - free) * s, zz = zr * zr + zi * zi;
  let near = [grow[0] * s, grow[1] * s];
  if (zz > 0) { // times (exp(z) - 1) / z
    const rise = Math.expm1(zr), half = Math.sin(0.5 * zi), e = [rise * (1 - 2 * half * half) - 2 * half * half, (rise + 1) * Math.sin(zi)];
    near = times(near, [(e[0] * zr + e[1] * zi) / zz, (e[1] * zr - e[0] * zi) / zz]);
  }
  const dr = gam, di = -om - free, dd = dr * dr + di * di, nr = Math.cos(om * s) - grow[0], ni = -Math.sin(om * s) - grow[1];
  const far = [(nr * dr + ni * di) / dd, (ni * dr - nr * di) / dd];
  const one = times([Math.cos(ph), Math.sin(ph)], near), two = times([Math.cos(ph), -Math.sin(ph)], far);
  const eta = [(push * (one[1] - two[1])) / 2, (-push * (one[0] - two[0])) / 2]; // times push / 2i
  const x = eta[1] / free;
  return [x, eta[0] - gam * x];
}

// x, x', x'' of the rod and X, X', X'' of the motor at s.
export function evaluate(arc, s) {
  const { piece, p, gam, w2, q, g } = arc, om = piece[7], [mx, mv, ma] = motor(piece, s);
  let x = ((p[3] * s + p[2]) * s + p[1]) * s + p[0], v = (3 * p[3] * s + 2 * p[2]) * s + p[1];
  if (arc.resonant) {
    const [xr, vr] = nearResonance(arc, s);
    x += xr; v += vr;
  } else if (arc.ps || arc.pc) {
    const sin = Math.sin(om * s + piece[8]), cos = Math.cos(om * s + piece[8]);
    x += arc.ps * sin + arc.pc * cos;
    v += om * (arc.ps * cos - arc.pc * sin);
  }
  if (!arc.air) {
    let c, sn;
    if (arc.over) { // cosh and sinh / kappa without large exponentials
      const kappa = arc.free, slow = Math.exp((-w2 / (gam + kappa)) * s), fade = -Math.expm1(-2 * kappa * s);
      c = slow * (1 - 0.5 * fade);
      sn = slow * (kappa > 0 ? (0.5 * fade) / kappa : s);
    } else {
      const decay = Math.exp(-gam * s);
      c = decay * Math.cos(arc.free * s);
      sn = (decay * Math.sin(arc.free * s)) / arc.free;
    }
    x += arc.a * c + arc.b * sn;
    v += (arc.b - gam * arc.a) * c - (gam * arc.b + (w2 - gam * gam) * arc.a) * sn;
  }
  return [x, v, -g - q * ma - 2 * gam * v - w2 * x, mx, mv, ma];
}

// The motor's motion X_m(t) as pieces [t0, t1, d0, d1, d2, d3, A, omega, phase]: on each, with h = t - t0 [s],
// X = d0 + d1 h + d2 h^2 + d3 h^3 + A sin(omega h + phase) [m]. Written from docs/physics.md section 1.
const TURN = 2 * Math.PI;
const KNOT = 0.02; // s between the control points of a motion by hand

// A [sin(2 pi f t + phase) - sin(phase)]; a delay or a second frequency divides the cycle into two halves.
export function lawPieces(law, frequency2) {
  const { frequency: f, amplitude: A, phase, cycles, delay } = law, offset = -A * Math.sin(phase);
  if (!delay && f === frequency2) return [[0, cycles / f, offset, 0, 0, 0, A, TURN * f, phase]];
  const half = 0.5 / f, second = half + delay, level = -2 * A * Math.sin(phase);
  const out = [[0, half, offset, 0, 0, 0, A, TURN * f, phase]];
  if (delay > 0) out.push([half, second, level, 0, 0, 0, 0, 0, 0]);
  return [...out, [second, second + 0.5 / frequency2, offset, 0, 0, 0, A, TURN * frequency2, phase + Math.PI]];
}

// A uniform cubic B-spline whose control points are the hand's places every KNOT seconds: X' and X'' are continuous,
// and it begins and ends at rest. t [s], x [m].
export function handPieces({ t, x }) {
  const n = Math.max(2, Math.ceil(t.at(-1) / KNOT)), places = [];
  for (let i = 0, j = 0; i <= n; i++) {
    const at = Math.min(i * KNOT, t.at(-1));
    while (j < t.length - 2 && t[j + 1] < at) j++;
    places.push(x[j] + (x[j + 1] - x[j]) * Math.min(1, (at - t[j]) / (t[j + 1] - t[j])));
  }
  const c = [places[0], places[0], places[0], ...places, places[n], places[n], places[n]];
  return c.slice(3).map((_, i) => {
    const [a, b, d, e] = c.slice(i, i + 4), H = KNOT;
    return [i * H, (i + 1) * H, (a + 4 * b + d) / 6, (d - a) / (2 * H), (a - 2 * b + d) / (2 * H * H), (e - 3 * d + 3 * b - a) / (6 * H ** 3),
      0, 0, 0];
  });
}

// X [m], X', X'' at h seconds into a piece.
export function motor(p, h) {
  const angle = p[7] * h + p[8], s = p[6] * Math.sin(angle), c = p[6] * p[7] * Math.cos(angle);
  return [((p[5] * h + p[4]) * h + p[3]) * h + p[2] + s, (3 * p[5] * h + 2 * p[4]) * h + p[3] + c,
    6 * p[5] * h + 2 * p[4] - p[7] * p[7] * s];
}

// The same at the time t; at rest before and after the law.
export function motorAt(pieces, t) {
  const last = pieces.at(-1);
  if (t < pieces[0][0]) return [0, 0, 0];
  if (t >= last[1]) return [motor(last, last[1] - last[0])[0], 0, 0];
  const p = pieces.find((r) => t < r[1]);
  return motor(p, t - p[0]);
}

// Greatest |X'| [m/s]: exact for sinusoids, for the hand's cubics at ends and crests.
export function peakSpeed(pieces) {
  let peak = 0;
  for (const p of pieces) {
    const length = p[1] - p[0];
    if (p[6] && Math.floor((p[7] * length + p[8]) / Math.PI) >= Math.ceil(p[8] / Math.PI)) peak = Math.max(peak, p[6] * p[7]);
    const crest = p[5] ? -p[4] / (3 * p[5]) : 0;
    for (const h of [0, length, Math.min(Math.max(crest, 0), length)]) peak = Math.max(peak, Math.abs(motor(p, h)[1]));
  }
  return peak;
}
